// SPDX-License-Identifier: Apache-2.0
//
// The model file: every way it can be wrong is said with file, line and key; what is right survives
// being changed, written and read again; the PA-10 file says what its sources say.
//
// Method: a small valid file with one line changed for each error; random edits and random bytes
// for the rest; numbers of the paper typed here a second time, in the paper's own signs.
#include "model/arm_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <sstream>

#include "model/rbd.hpp"
#include "model/terms.hpp"
#include "model/text.hpp"
#include "tests/check_main.h"
#include "tests/scratch.hpp"

using hdt::ArmFile;
using hdt::InputError;
using hdt::Quantity;

static const char pa10_path[] = "model/arms/pa10.toml";
static const char paper_path[] = "model/arms/pa10-paper.toml";

// Check's own string comparison would keep a pointer into a temporary.
#define assert_text(found, expected)                                                               \
    do {                                                                                           \
        const std::string found_ = (found);                                                        \
        ck_assert_msg(found_ == (expected), "expected %s\n found %s", (expected), found_.c_str()); \
    } while (0)

// Line numbers of the error table: line 1 is the format, 14 the [[joint]], 30 the ripple.
static const char small_arm[] = R"(format = "hdt-arm"
version = 1
name = "small"
[sources]
S = "made up"
[base]
gravity = { value = [0, 0, -9.81], unit = "m/s^2", sigma = [0, 0, 0.01], source = "S" }
[control]
rate = { value = 700, unit = "Hz", confidence = "high", source = "S" }
velocity_cutoff = { value = 200, unit = "Hz", confidence = "high", source = "S" }
[flange]
origin = { value = [0, 0, 0.1], unit = "m", confidence = "high", source = "S" }
rpy = { value = [0, 0, 0], unit = "rad", confidence = "high", source = "S" }
[[joint]]
name = "A"
origin = { value = [0, 0, 0.2], unit = "m", confidence = "high", source = "S" }
rpy = { value = [0, 0, 0], unit = "rad", confidence = "high", source = "S" }
limits.position = { value = [-3, 3], unit = "rad", confidence = "high", source = "S" }
limits.speed = { value = 1, unit = "rad/s", confidence = "high", source = "S" }
gear.ratio = { value = 50, unit = "1", confidence = "high", source = "S" }
gear.k1 = { value = 1e4, unit = "N m/rad", side = "output", confidence = "low", source = "S" }
gear.k2 = { value = 2e4, unit = "N m/rad", side = "output", confidence = "low", source = "S" }
gear.k3 = { value = 3e4, unit = "N m/rad", side = "output", confidence = "low", source = "S" }
gear.t1 = { value = 10, unit = "N m", side = "output", confidence = "low", source = "S" }
gear.t2 = { value = 40, unit = "N m", side = "output", confidence = "low", source = "S" }
link.mass = { value = 2, unit = "kg", sigma = 0.1, source = "S" }
link.com = { value = [0.1, 0, 0.2], unit = "m", confidence = "low", source = "S" }
link.inertia = { value = [0.1, 0, 0, 0.1, 0, 0.1], unit = "kg m^2", confidence = "low", source = "S" }
friction.valid = { value = [0.02, 0.4], unit = "rad/s", confidence = "low", source = "S" }
[[joint.ripple]]
wave_generator_order = { value = 2, unit = "1", confidence = "low", source = "S" }
amplitude = { value = 1.5, unit = "N m", side = "output", sigma = 0.1, source = "S" }
phase = { value = 0.5, unit = "rad", sigma = 0.1, source = "S" }
[[joint.effect]]
id = "order_line"
order = { value = 7.5, unit = "1", sigma = 0.1, source = "S" }
amplitude = { value = 0.3, unit = "N m", side = "output", sigma = 0.1, source = "S" }
phase = { value = -1, unit = "rad", sigma = 0.1, source = "S" }
directed = true
)";

// The small arm with one line put in place of another; 0 appends.
static std::string changed(int line, const std::string &text)
{
    std::istringstream in(small_arm);
    std::string out, row;
    for (int number = 1; std::getline(in, row); number++)
        out += (number == line ? text : row) + "\n";
    return line == 0 ? out + text + "\n" : out;
}

// One line; what the exception said, or nothing.
static std::string message_of(const std::string &text)
{
    try {
        ArmFile::parse(text, "t.toml");
    } catch (const InputError &error) {
        return error.what();
    }
    return "";
}

struct Wrong {
    int line;
    const char *text, *message;
};

#define OF_KG ", unit = \"kg\", sigma = 0.1, source = \"S\""

static const Wrong wrong_table[] = {
    // not ours
    {1, "format = \"urdf\"", "t.toml:1: format: expected \"hdt-arm\", found the text \"urdf\""},
    {1, "", "t.toml: format: expected \"hdt-arm\", found nothing"},
    {2, "version = 2", "t.toml:2: version: expected 1, the version this program reads, found 2"},
    {2, "", "t.toml: version: expected 1, found nothing"},
    // TOML
    {3, "name = \"small", "t.toml:3: TOML: expected valid TOML, found: "},
    {20, "gear.ratio = { value = 50,, }", "t.toml:20: TOML: expected valid TOML, found: "},
    {16, "name = \"B\"", "t.toml:16: TOML: expected valid TOML, found: "},
    {1, "[,\nformat = \"hdt-arm\"",
     "t.toml:1: TOML: expected valid TOML, found: unexpected character"},
    {14, "[,", "t.toml:14: TOML: expected valid TOML, found: unexpected character"},
    {6, "[=]", "t.toml:6: TOML: expected valid TOML, found: unexpected character"},
    // keys
    {20, "gear.ration = { value = 50, unit = \"1\", confidence = \"high\", source = \"S\" }",
     "t.toml:20: joint.1.gear.ration: expected a key of format hdt-arm (did you mean ratio?), "
     "found \"ration\""},
    {6, "[bass]",
     "t.toml:6: bass: expected a key of format hdt-arm (did you mean base?), found \"bass\""},
    {15, "", "t.toml:14: joint.1.name: expected a text, found nothing"},
    {19, "", "t.toml:18: joint.1.limits.speed: expected a quantity in \"rad/s\", found nothing"},
    {22, "",
     "t.toml:20: joint.1.gear.k2: expected with its group (k1, k2, k3, t1, t2), found nothing"},
    {27, "",
     "t.toml:26: joint.1.link.com: expected with its group (mass, com, inertia), found nothing"},
    {9, "",
     "t.toml:8: control.rate: expected with its group (rate, velocity_cutoff), found nothing"},
    {14, "[joint]", "t.toml:14: joint: expected an array of tables [[joint]], found a table"},
    {5, "\"S T\" = \"x\"",
     "t.toml:5: sources: expected source names of letters, digits, '_' and '-', found \"S T\""},
    // types and shapes
    {3, "name = 7", "t.toml:3: name: expected a text, found 7"},
    {20, "gear.ratio = 50",
     "t.toml:20: joint.1.gear.ratio: expected { value, unit = \"1\", sigma or confidence, "
     "source }, found 50"},
    {26, "link.mass = { value = \"2\"" OF_KG " }",
     "t.toml:26: joint.1.link.mass: expected value a number, found the text \"2\""},
    {26, "link.mass = { value = [2]" OF_KG " }",
     "t.toml:26: joint.1.link.mass: expected value a number, found an array of 1"},
    {16, "origin = { value = [0, 0], unit = \"m\", confidence = \"high\", source = \"S\" }",
     "t.toml:16: joint.1.origin: expected value an array of 3 numbers, found an array of 2"},
    {16, "origin = { value = [0, true, 0], unit = \"m\", confidence = \"high\", source = \"S\" }",
     "t.toml:16: joint.1.origin: expected value an array of 3 numbers, found true in it"},
    {7, "gravity = { value = [0, 0, -9.81], unit = \"m/s^2\", sigma = [0, 0.01], source = \"S\" }",
     "t.toml:7: base.gravity: expected sigma an array of 3 numbers, found an array of 2"},
    {39, "directed = 1", "t.toml:39: joint.1.effect.1.directed: expected true or false, found 1"},
    // fields
    {26, "link.mass = { value = 2, unit = \"g\", sigma = 0.1, source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected unit \"kg\", found \"g\""},
    {26, "link.mass = { value = 2, sigma = 0.1, source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected unit \"kg\", found no unit"},
    {26, "link.mass = { unit = \"kg\", sigma = 0.1, source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected value with 1 number, found none"},
    {26, "link.mass = { value = 2, unit = \"kg\", sigm = 0.1, source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected the fields value, unit, sigma, confidence, source, "
     "side, found \"sigm\" "
     "(did you mean sigma?)"},
    {26, "link.mass = { value = 2, unit = \"kg\", source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected sigma, or confidence = \"high\", \"medium\" or "
     "\"low\", found neither"},
    {26, "link.mass = { value = 2, unit = \"kg\", confidence = \"sure\", source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected confidence \"high\", \"medium\" or \"low\", found "
     "\"sure\""},
    {26, "link.mass = { value = 2, unit = \"kg\", sigma = -1, source = \"S\" }",
     "t.toml:26: joint.1.link.mass: expected a finite sigma of at least 0, found -1"},
    {26, "link.mass = { value = 2, unit = \"kg\", sigma = 1 }",
     "t.toml:26: joint.1.link.mass: expected a source out of [sources], found none"},
    {26, "link.mass = { value = 2, unit = \"kg\", sigma = 1, source = \"T\" }",
     "t.toml:26: joint.1.link.mass: expected a source named in [sources] (did you mean S?), found "
     "\"T\""},
    {21, "gear.k1 = { value = 1e4, unit = \"N m/rad\", confidence = \"low\", source = \"S\" }",
     "t.toml:21: joint.1.gear.k1: expected side = \"output\", found no side"},
    {21,
     "gear.k1 = { value = 1e4, unit = \"N m/rad\", side = \"motor\", confidence = \"low\", source "
     "= \"S\" }",
     "t.toml:21: joint.1.gear.k1: expected side = \"output\", found side = \"motor\""},
    {26, "link.mass = { value = 2, unit = \"kg\", sigma = 1, source = \"S\", side = \"output\" }",
     "t.toml:26: joint.1.link.mass: expected no side, found side = \"output\""},
    // numbers
    {26, "link.mass = { value = nan" OF_KG " }",
     "t.toml:26: joint.1.link.mass: expected a finite number, found nan"},
    {26, "link.mass = { value = -inf" OF_KG " }",
     "t.toml:26: joint.1.link.mass: expected a finite number, found -inf"},
    {26, "link.mass = { value = -2" OF_KG " }",
     "t.toml:26: joint.1.link.mass: expected a number of at least 0, found -2"},
    {20, "gear.ratio = { value = 0, unit = \"1\", confidence = \"high\", source = \"S\" }",
     "t.toml:20: joint.1.gear.ratio: expected a number above 0, found 0"},
    {31,
     "wave_generator_order = { value = 2.5, unit = \"1\", confidence = \"low\", source = \"S\" }",
     "t.toml:31: joint.1.ripple.1.wave_generator_order: expected a whole number from 1 to 4096, "
     "found 2.5"},
    // numbers against each other
    {25,
     "gear.t2 = { value = 10, unit = \"N m\", side = \"output\", confidence = \"low\", source = "
     "\"S\" }",
     "t.toml:25: joint.1.gear.t2: expected above t1 = 10, found 10"},
    // the inside of the gear: all of it or nothing, and no more lost while driven than while driving
    {29,
     "mesh.soft_torque = { value = 10, unit = \"N m\", side = \"output\", confidence = \"low\", source = "
     "\"S\" }",
     "t.toml:29: joint.1.mesh.soft_stiffness: expected with its group (soft_torque, soft_stiffness, "
     "hard_stiffness, drive_loss, back_loss, drive_load, back_load), found nothing"},
    {18,
     "limits.position = { value = [3, -3], unit = \"rad\", confidence = \"high\", source = \"S\" }",
     "t.toml:18: joint.1.limits.position: expected the lower limit first, found 3, -3"},
    {29,
     "friction.valid = { value = [0.4, 0.02], unit = \"rad/s\", confidence = \"low\", source = "
     "\"S\" }",
     "t.toml:29: joint.1.friction.valid: expected the lower speed first, found 0.4, 0.02"},
    {10, "velocity_cutoff = { value = 350, unit = \"Hz\", confidence = \"high\", source = \"S\" }",
     "t.toml:10: control.velocity_cutoff: expected below half of control.rate = 700, found 350"},
    {28,
     "link.inertia = { value = [0.1, 0, 0, 0.1, 0, 0.3], unit = \"kg m^2\", confidence = \"low\", "
     "source = \"S\" }",
     "t.toml:28: joint.1.link.inertia: expected no principal moment above the sum of the other "
     "two, found "
     "principal moments 0.1, 0.1, 0.3"},
    {28,
     "link.inertia = { value = [0.1, 0.2, 0, 0.1, 0, 0.1], unit = \"kg m^2\", confidence = "
     "\"low\", source = \"S\" }",
     "t.toml:28: joint.1.link.inertia: expected an inertia about the com with no negative "
     "principal moment, found"},
    {29,
     "link.first_moment = { value = [0, 0, 0], unit = \"kg m\", confidence = \"low\", source = "
     "\"S\" }",
     "t.toml:27: joint.1.link.com: expected either com and inertia or first_moment and "
     "inertia_origin, found both"},
    {15, "name = \"a name with blanks\"",
     "t.toml:15: joint.1.name: expected 1 to 15 printable characters without blanks, found \"a "
     "name with blanks\""},
    // effects
    {35, "id = \"order_lines\"",
     "t.toml:35: joint.1.effect.1.id: expected an effect id of docs/formats.md (did you mean "
     "order_line?), found "
     "\"order_lines\""},
    {35, "id = \"inertia\"",
     "t.toml:34: joint.1.effect.1.inertia: expected inertia with inertia, found nothing"},
    {36, "",
     "t.toml:34: joint.1.effect.1.order: expected order_line with order, amplitude, phase, "
     "directed, found "
     "nothing"},
    {36, "mu = { value = 1, unit = \"N m/N m\", sigma = 0.1, source = \"S\" }",
     "t.toml:34: joint.1.effect.1.order: expected order_line with order"},
    {39, "directed = true\ngain = { value = 1, unit = \"1\", sigma = 0.1, source = \"S\" }",
     "t.toml:40: joint.1.effect.1.gain: expected order_line with only order, amplitude, phase, "
     "directed, found gain"},
    {39, "directed = true\n[[joint]]\nname = \"A\"",
     "t.toml:41: joint.2.name: expected a name of its own, found \"A\" as for joint 1"},
};

START_TEST(test_every_error_says_file_line_key_expected_and_found)
{
    const Wrong &w = wrong_table[_i];
    const std::string message = message_of(changed(w.line, w.text));
    ck_assert_msg(message.compare(0, std::strlen(w.message), w.message) == 0,
                  "line %d \"%s\":\n expected %s\n found %s", w.line, w.text, w.message,
                  message.c_str());
    ck_assert_msg(message.find('\n') == std::string::npos, "more than a line: %s", message.c_str());
}
END_TEST

START_TEST(test_the_small_arm_itself_is_accepted)
{
    assert_text(message_of(small_arm), "");
}
END_TEST

START_TEST(test_too_many_and_no_joints_are_refused)
{
    std::string head(small_arm), joint = head.substr(head.find("[[joint]]"));
    head.resize(head.find("[[joint]]"));
    assert_text(message_of(head), "t.toml: joint: expected at least one [[joint]], found none");
    std::string many = head;
    for (int i = 0; i < 17; i++) {
        std::string next = joint;
        next.replace(next.find("\"A\""), 3, "\"J" + std::to_string(i) + "\"");
        many += next;
        if (i == 15)
            assert_text(message_of(many), "");
    }
    const std::string message = message_of(many);
    ck_assert_msg(message == "t.toml:430: joint: expected at most 16 joints, found 17", "%s",
                  message.c_str());
}
END_TEST

START_TEST(test_too_many_of_a_joints_tables_are_refused)
{
    const std::string ripple =
        "[[joint.ripple]]\n"
        "wave_generator_order = { value = 2, unit = \"1\", confidence = \"low\", source = \"S\" }\n"
        "amplitude = { value = 1.5, unit = \"N m\", side = \"output\", sigma = 0.1, source = \"S\" "
        "}\n"
        "phase = { value = 0.5, unit = \"rad\", sigma = 0.1, source = \"S\" }\n";
    const std::string line =
        "[[joint.effect]]\nid = \"order_line\"\n"
        "order = { value = 7.5, unit = \"1\", sigma = 0.1, source = \"S\" }\n"
        "amplitude = { value = 0.3, unit = \"N m\", sigma = 0.1, source = \"S\" }\n"
        "phase = { value = -1, unit = \"rad\", sigma = 0.1, source = \"S\" }\ndirected = false\n";
    const std::string offset =
        "[[joint.effect]]\nid = \"torque_offset\"\n"
        "torque = { value = 1, unit = \"N m\", sigma = 0.1, source = \"S\" }\n";
    std::string text(small_arm);
    for (int i = 2; i <= 8; i++)
        text += ripple;
    assert_text(message_of(text), "");
    assert_text(message_of(text + ripple),
                "t.toml:30: joint.1.ripple: expected at most 8 ripples a joint, found 9");
    text = small_arm;
    for (int i = 2; i <= 4; i++)
        text += line;
    assert_text(message_of(text + offset), "");
    assert_text(message_of(text + line), "t.toml:59: joint.1.effect.5.id: expected at most 4 "
                                         "order_line effects a joint, found one more");
    assert_text(
        message_of(text + offset + offset),
        "t.toml:62: joint.1.effect.6.id: expected one torque_offset a joint, found a second");
    for (int i = 5; i <= 65; i++)
        text += line;
    assert_text(message_of(text),
                "t.toml:418: joint.1.effect: expected at most 64 tables, found 65");
}
END_TEST

START_TEST(test_roll_pitch_yaw_turn_about_fixed_axes_in_that_order)
{
    ArmFile file = ArmFile::parse(small_arm, "t.toml");
    const double r = 0.3, p = -0.7, y = 1.9;
    file.set("joint.1.rpy", {{r, p, y}, "rad", {}, "S", "", "low"});
    file.set("flange.rpy", {{r, p, y}, "rad", {}, "S", "", "low"});
    file.refresh();
    const double expected[9] = {std::cos(y) * std::cos(p),
                                std::cos(y) * std::sin(p) * std::sin(r) - std::sin(y) * std::cos(r),
                                std::cos(y) * std::sin(p) * std::cos(r) + std::sin(y) * std::sin(r),
                                std::sin(y) * std::cos(p),
                                std::sin(y) * std::sin(p) * std::sin(r) + std::cos(y) * std::cos(r),
                                std::sin(y) * std::sin(p) * std::cos(r) - std::cos(y) * std::sin(r),
                                -std::sin(p),
                                std::cos(p) * std::sin(r),
                                std::cos(p) * std::cos(r)};
    for (int i = 0; i < 9; i++) {
        ck_assert_double_eq_tol(file.arm().joint[0].rot[i], expected[i], 1e-14);
        ck_assert_double_eq_tol(file.arm().flange_rot[i], expected[i], 1e-14);
    }
}
END_TEST

START_TEST(test_a_file_that_cannot_be_read_is_named)
{
    char err[200];
    static hdt_arm arm;
    ck_assert_int_eq(hdt_arm_load("no/such/arm.toml", &arm, err, sizeof err), -1);
    ck_assert_str_eq(
        err, "no/such/arm.toml: expected a readable model file, found: No such file or directory");
    ck_assert_int_eq(hdt_arm_load("model", &arm, err, sizeof err), -1);
    ck_assert_str_eq(err, "model: expected a readable model file, found: Is a directory");
    ck_assert_int_eq(hdt_arm_load("/dev/zero", &arm, err, sizeof err), -1);
    ck_assert_str_eq(err, "/dev/zero: expected a model file of at most 4 MiB, found more");
    ck_assert_int_eq(hdt_arm_load("/dev/null", &arm, err, sizeof err), -1);
    ck_assert_str_eq(err, "/dev/null: format: expected \"hdt-arm\", found nothing");
    // a short buffer is filled, not overrun; none is fine too
    char tiny[8];
    ck_assert_int_eq(hdt_arm_load("no/such/arm.toml", &arm, tiny, sizeof tiny), -1);
    ck_assert_str_eq(tiny, "no/such");
    ck_assert_int_eq(hdt_arm_load("no/such/arm.toml", &arm, NULL, 0), -1);
}
END_TEST

// Whatever the bytes: a model, or one line of refusal.
static void must_load_or_refuse(const std::string &text)
{
    try {
        ArmFile::parse(text, "f.toml");
    } catch (const InputError &error) {
        const std::string what = error.what();
        ck_assert_msg(
            what.compare(0, 6, "f.toml") == 0
                && std::none_of(what.begin(), what.end(),
                                [](char c) { return static_cast<unsigned char>(c) < 0x20; }),
            "%s", what.c_str());
    }
}

START_TEST(test_damaged_bytes_never_do_more_than_refuse)
{
    const std::string whole(small_arm);
    for (std::size_t n = 0; n < whole.size(); n++)
        must_load_or_refuse(whole.substr(0, n));
    uint64_t seed = 11;
    for (int round = 0; round < 3000; round++) {
        std::string text = whole;
        for (uint64_t k = test_random(&seed) % 6 + 1; k > 0; k--) {
            const std::size_t at = test_random(&seed) % text.size();
            switch (test_random(&seed) % 3) {
            case 0:
                text[at] = static_cast<char>(test_random(&seed));
                break;
            case 1:
                text.erase(at, test_random(&seed) % 40);
                break;
            default:
                text.insert(at, text.substr(test_random(&seed) % text.size(), 20));
            }
        }
        must_load_or_refuse(text);
    }
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\nx = " + std::string(100000, '['));
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\n" + std::string(100000, 'k') + " = 1");
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\n[sources]\n\"\" = \"\"\n");
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\njoint = [1, [2]]\n");
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\n\"joint.1\" = 3\n");
    must_load_or_refuse("\n\n[,");
    must_load_or_refuse("format = \"hdt-arm\"\nversion = 1\n\"a\\nb\\u001b\" = 3\n");
}
END_TEST

// Bytes between the members of a line are no numbers.
static void clear_padding(hdt_arm_line *line)
{
    hdt_arm_line clean;
    std::memset(&clean, 0, sizeof clean);
    clean.order_rev = line->order_rev;
    clean.amplitude_nm = line->amplitude_nm;
    clean.phase_rad = line->phase_rad;
    clean.directed = line->directed;
    std::memcpy(line, &clean, sizeof clean);
}

static void keep_numbers(hdt_arm *arm)
{
    std::memset(arm->path, 0, sizeof arm->path);
    std::memset(arm->digest, 0, sizeof arm->digest);
    for (hdt_arm_joint &joint : arm->joint) {
        for (hdt_arm_line &line : joint.line)
            clear_padding(&line);
        for (hdt_arm_line &line : joint.ripple)
            clear_padding(&line);
    }
}

// A gear's inside, all seven numbers; loss while driven as given.
static std::string mesh_text(const char *back_loss)
{
    const std::pair<const char *, const char *> numbers[] = {
        {"soft_torque", "10"},  {"soft_stiffness", "1000"}, {"hard_stiffness", "9000"}, {"drive_loss", "3"},
        {"back_loss", back_loss}, {"drive_load", "0.1"},    {"back_load", "0.2"}};
    std::string text;
    for (const auto &[name, value] : numbers) {
        const std::string key(name);
        const char *unit = key.find("stiffness") != std::string::npos ? "N m/rad"
                           : key.find("load") != std::string::npos    ? "N m/N m"
                                                                      : "N m";
        text += "mesh." + key + " = { value = " + value + ", unit = \"" + unit
                + "\", side = \"output\", confidence = \"low\", source = \"S\" }\n";
    }
    return text;
}

START_TEST(test_inside_of_the_gear_is_read_whole_and_in_order)
{
    const std::string base = changed(29, mesh_text("1").c_str()), none = message_of(base);
    ck_assert_str_eq(none.c_str(), "");
    const std::string wrong = message_of(changed(29, mesh_text("4").c_str()));
    ck_assert_msg(wrong.find("joint.1.mesh.back_loss: expected at most drive_loss = 3, found 4") !=
                      std::string::npos,
                  "%s", wrong.c_str());
    const hdt_arm arm = hdt::ArmFile::load(pa10_path).arm();
    for (int j = 0; j < arm.joints; j++) {
        ck_assert_int_eq(arm.joint[j].has_mesh, 1);
        ck_assert_int_eq(arm.joint[j].errors, 1);
        ck_assert_double_eq(arm.joint[j].error[0].order_rev, 2 * arm.joint[j].ratio);
    }
}
END_TEST

static void assert_same_numbers(const hdt_arm &a, const hdt_arm &b)
{
    hdt_arm left, right;
    std::memcpy(&left, &a, sizeof left);
    std::memcpy(&right, &b, sizeof right);
    keep_numbers(&left);
    keep_numbers(&right);
    ck_assert(std::memcmp(&left, &right, sizeof left) == 0);
}

START_TEST(test_written_file_reads_back_bit_for_bit)
{
    const char *paths[] = {pa10_path, paper_path};
    const std::string path = scratch("round.toml");
    ArmFile first = ArmFile::load(paths[_i]);
    first.save(path);
    const ArmFile second = ArmFile::load(path);
    ck_assert(slurp(path) == first.text());
    ck_assert_msg(second.text() == first.text(), "text changes on the second writing");
    assert_same_numbers(first.arm(), second.arm());
    ck_assert(std::memcmp(first.arm().digest, second.arm().digest, 32) != 0); // comments are gone
    first.refresh();
    ck_assert(std::memcmp(first.arm().digest, second.arm().digest, 32) == 0);
    ck_assert_str_eq(first.arm().path, paths[_i]);
    std::remove(path.c_str());
}
END_TEST

static uint64_t bits_of(double x)
{
    uint64_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    return bits;
}

START_TEST(test_any_finite_number_and_any_text_survive_writing)
{
    uint64_t seed = 5;
    const double special[] = {0.0,
                              -0.0,
                              5e-324,
                              1.7976931348623157e308,
                              123456789012345680000.0,
                              9007199254740993.0,
                              1e15,
                              999999999999999.0,
                              1e16,
                              -1e22,
                              0.1};
    const char *texts[] = {"",
                           "plain",
                           "quote \" backslash \\ tab \t newline \n bell \a delete \x7f",
                           "Umlaut \xc3\xa4, N\xc2\xb7m",
                           "'''\"\"\"",
                           "# = [x]"};
    for (int round = 0; round < 400; round++) {
        ArmFile file = ArmFile::parse(small_arm, "t.toml");
        Quantity q{{}, "m", {}, "S", "", "low"};
        for (int i = 0; i < 3; i++) {
            uint64_t bits = test_random(&seed);
            double x;
            std::memcpy(&x, &bits, sizeof x);
            const double chosen = round < 11 ? special[round] : x;
            q.value.push_back(std::isfinite(chosen) ? chosen : 1);
            q.sigma.push_back(std::fabs(q.value.back()));
        }
        file.set("joint.1.origin", q);
        file.set_text("sources.S", texts[round % 6]);
        const ArmFile back = ArmFile::parse(file.text(), "t.toml");
        const Quantity r = back.get("joint.1.origin");
        for (std::size_t i = 0; i < 3; i++) {
            ck_assert_uint_eq(bits_of(r.value[i]), bits_of(q.value[i]));
            ck_assert_uint_eq(bits_of(r.sigma[i]), bits_of(q.sigma[i]));
        }
        assert_text(r.confidence, "low");
        assert_text(back.get_text("sources.S"), texts[round % 6]);
    }
}
END_TEST

START_TEST(test_set_append_and_erase_change_just_what_they_name)
{
    ArmFile file = ArmFile::load(pa10_path);
    const ArmFile before(file);
    file.set_text("sources.FIT", "a fit");
    file.set("joint.2.friction.positive.f0", {{41.5}, "N m", {0.2}, "FIT", ""});
    ck_assert_double_eq(file.arm().joint[1].friction[0].f0_nm, 39.9709); // not before refresh
    file.append("joint.2.effect", {{"id", "torque_offset"}},
                {{"torque", {{1.5}, "N m", {0.1}, "FIT", "output"}}});
    file.append("joint.2.effect", {{"id", "order_line"}, {"directed", "false"}},
                {{"order", {{50}, "1", {0.1}, "FIT", ""}},
                 {"amplitude", {{2}, "N m", {0.1}, "FIT", ""}},
                 {"phase", {{0.3}, "rad", {0.1}, "FIT", ""}}});
    file.refresh();
    hdt_arm expected = before.arm();
    expected.joint[1].friction[0].f0_nm = 41.5;
    expected.joint[1].torque_offset_nm = 1.5;
    expected.joint[1].lines = 1;
    expected.joint[1].line[0] = {50, 2, 0.3, 0};
    assert_same_numbers(file.arm(), expected);
    assert_same_numbers(ArmFile::parse(file.text(), "t.toml").arm(), expected);
    assert_text(file.get("joint.2.friction.positive.f0").side, "output");
    ck_assert_int_eq(file.count("joint.2.effect"), 2);
    assert_text(file.get_text("joint.2.effect.2.directed"), "false");

    // the first effect goes, the second moves up
    file.erase("joint.2.effect.1");
    ck_assert_int_eq(file.count("joint.2.effect"), 1);
    assert_text(file.get_text("joint.2.effect.1.id"), "order_line");
    ck_assert(!file.has("joint.2.effect.2"));
    file.erase("joint.2.effect");
    ck_assert_int_eq(file.count("joint.2.effect"), 0);
    file.set("joint.2.friction.positive.f0", before.get("joint.2.friction.positive.f0"));
    file.erase("sources.FIT");
    ck_assert(file.text() == before.text());
}
END_TEST

// Which InputError does the action raise?
static std::string refused(const std::function<void()> &action)
{
    try {
        action();
    } catch (const InputError &error) {
        return error.what();
    }
    return "";
}

START_TEST(test_a_wrong_change_is_refused_and_changes_nothing)
{
    ArmFile file = ArmFile::parse(small_arm, "t.toml");
    const std::string before = file.text();
    const Quantity mass{{1}, "kg", {0.1}, "S", ""};
    assert_text(
        refused([&] { file.set("joint.1.link.mas", mass); }),
        "t.toml:26: joint.1.link.mas: expected a key of format hdt-arm (did you mean mass?), found "
        "\"joint.1.link.mas\"");
    assert_text(refused([&] { file.set("joint.1.origin", mass); }),
                "t.toml: joint.1.origin: expected value with 3 numbers, found 1");
    assert_text(refused([&] { file.set("joint.3.link.mass", mass); }),
                "t.toml:14: joint.3.link.mass: expected a table up to joint.2, found 3");
    assert_text(refused([&] { file.set("joint.1.name", mass); }),
                "t.toml:15: joint.1.name: expected a text, found a quantity");
    assert_text(refused([&] {
                    file.append("joint.1.effect", {{"id", "inertia"}},
                                {{"inertia", {{NAN}, "kg m^2", {1}, "S", ""}}});
                }),
                "t.toml: joint.1.effect.2.inertia: expected a finite number, found nan");
    ck_assert(refused([&] { file.append("joint.1.link", {}, {}); }) != "");
    ck_assert(refused([&] { file.get("joint.1.feedback.kp"); }) != "");
    ck_assert(refused([&] { file.get("joint.1.name"); }) != "");
    ck_assert(refused([&] { file.set_text("joint.1.effect.1.directed", "maybe"); }) != "");
    ck_assert(file.text() == before);
    // a wind-up whose break points are out of order
    ArmFile wound = ArmFile::load(pa10_path);
    wound.set("joint.3.stiffness.negative.t2", {{2.64}, "N m", {}, "PAPER", "", "low"});
    const std::string crossed = refused([&] { wound.refresh(); });
    ck_assert_msg(
        crossed.find("joint.3.stiffness.negative.t2: expected above t1 = 2.64, found 2.64")
            != std::string::npos,
        "%s", crossed.c_str());
    // what only the whole can tell waits for refresh, which keeps the old numbers
    file.set("joint.1.gear.t2", {{1}, "N m", {0.1}, "S", ""});
    ck_assert(refused([&] { file.refresh(); }) != "");
    ck_assert_double_eq(file.arm().joint[0].t_nm[1], 40);
}
END_TEST

START_TEST(test_save_leaves_no_part_of_a_file)
{
    const ArmFile file = ArmFile::parse(small_arm, "t.toml");
    ck_assert(refused([&] { file.save("/no/such/directory/arm.toml"); }) != "");
    const std::string directory = scratch("dir");
    ck_assert_int_eq(system(("mkdir -p " + directory + "/taken/x").c_str()), 0);
    ck_assert(refused([&] { file.save(directory + "/taken"); }) != "");
    file.save(directory + "/good.toml");
    ck_assert_int_eq(
        system(("test \"$(ls -A " + directory + " | tr '\\n' ' ')\" = 'good.toml taken '").c_str()),
        0);
    ck_assert_int_eq(system(("rm -r " + directory).c_str()), 0);
}
END_TEST

START_TEST(test_digest_is_that_of_sha256sum)
{
    char text[80] = "";
    std::FILE *pipe = popen("sha256sum model/arms/pa10.toml", "r");
    ck_assert(pipe != NULL && std::fscanf(pipe, "%64s", text) == 1);
    pclose(pipe);
    const ArmFile file = ArmFile::load(pa10_path);
    assert_text(hdt::hex(file.arm().digest, sizeof file.arm().digest), text);
}
END_TEST

START_TEST(test_both_inertia_forms_give_the_same_arm)
{
    // a rod of 2 kg about an arbitrary com, moved to the joint origin by hand: I + m (c.c E - c c')
    ArmFile file = ArmFile::parse(small_arm, "t.toml");
    const hdt_arm com_form = file.arm();
    const Quantity com = file.get("joint.1.link.com");
    file.erase("joint.1.link.com");
    file.erase("joint.1.link.inertia");
    file.set("joint.1.link.first_moment", {{0.2, 0, 0.4}, "kg m", {}, "S", "", "low"});
    file.set("joint.1.link.inertia_origin",
             {{0.1 + 2 * 0.04, 0, -2 * 0.1 * 0.2, 0.1 + 2 * 0.05, 0, 0.1 + 2 * 0.01},
              "kg m^2",
              {},
              "S",
              "",
              "low"});
    file.refresh();
    for (int i = 0; i < 3; i++)
        ck_assert_double_eq_tol(file.arm().joint[0].moment_kgm[i], com_form.joint[0].moment_kgm[i],
                                1e-15);
    for (int i = 0; i < 6; i++)
        ck_assert_double_eq_tol(file.arm().joint[0].inertia_kgm2[i],
                                com_form.joint[0].inertia_kgm2[i], 1e-15);
    ck_assert_int_eq(file.arm().joint[0].has_inertial, 1);
    // identified base parameters: mass zero, first moment not, no feasibility asked
    file.set("joint.1.link.mass", {{0}, "kg", {}, "S", "", "low"});
    file.set("joint.1.link.inertia_origin", {{-1, 0, 0, 0, 0, 0}, "kg m^2", {}, "S", "", "low"});
    file.refresh();
    ck_assert_double_eq(file.arm().joint[0].mass_kg, 0);
    // geometry only is a model too
    file.erase("joint.1.link");
    file.refresh();
    ck_assert_int_eq(file.arm().joint[0].has_inertial, 0);
}
END_TEST

// ---- the PA-10 ----

struct TableTwo {
    double f0, fv, fs, vc;
};
// Kennedy and Desai 2005, Table II, as printed: negative rows with the paper's negative F_s and V_c
static const TableTwo table_two[2][7] = {{{34.9647, 29.7153, 2.8103, 0.3376},
                                          {39.9709, 35.3200, 6.2713, 0.0685},
                                          {18.3053, 17.6413, 2.2282, 0.0430},
                                          {30.4416, 28.5552, 19.7181, 0.3278},
                                          {3.7145, 0.7493, 1.0792, 0.0386},
                                          {5.5090, 0.5859, 0.9983, 0.0126},
                                          {2.2980, 0.6062, -1.1803, 0.0759}},
                                         {{36.7050, 26.4796, -2.2885, -0.6172},
                                          {41.3113, 35.8947, -5.9018, -0.0709},
                                          {18.7327, 17.8371, -2.7240, -0.0405},
                                          {30.6897, 29.4670, -21.7854, -0.3676},
                                          {4.1271, 0.7919, -1.3756, -0.0393},
                                          {5.7954, 0.5711, -0.9967, -0.0135},
                                          {2.3027, 0.6836, 1.1470, -0.0690}}};

// eq. (7) as printed, v of either sign
static double equation_seven(const TableTwo &row, double v)
{
    return (v > 0 ? row.f0 : -row.f0) + row.fv * v + row.fs * (1 - std::exp(-v / row.vc));
}

START_TEST(test_friction_is_equation_seven_with_table_two)
{
    const ArmFile file = ArmFile::load(pa10_path);
    for (int j = 0; j < 7; j++)
        for (double v = 0.001; v < 2; v *= 1.1) {
            const hdt_arm_joint &joint = file.arm().joint[j];
            ck_assert_double_eq_tol(hdt::stribeck_nm(joint.friction[0], v),
                                    equation_seven(table_two[0][j], v), 1e-12);
            ck_assert_double_eq_tol(-hdt::stribeck_nm(joint.friction[1], v),
                                    equation_seven(table_two[1][j], -v), 1e-12);
        }
}
END_TEST

START_TEST(test_ripple_orders_are_table_three_in_wave_generator_turns)
{
    // frequency in cycles per output radian, amplitude, phase
    static const double table[7][6] = {
        {15.87, 7.50, 2.30, 47.60, 5.05, 12.80}, {47.60, 6.00, -1.50, 310.50, 2.50, -6.90},
        {39.65, 0.70, 0.10, 239.20, 0.55, 5.50}, {39.65, 5.00, -3.15, 262.50, 0.10, 3.98},
        {23.80, 0.50, 4.95, 95.80, 0.40, 7.50},  {23.80, 0.10, -1.50, 95.80, 0.50, 5.50},
        {23.80, 0.10, -1.00, 95.80, 0.50, 2.50}};
    const ArmFile file = ArmFile::load(pa10_path);
    for (int j = 0; j < 7; j++) {
        ck_assert_int_eq(file.arm().joint[j].ripples, 2);
        for (int k = 0; k < 2; k++) {
            const hdt_arm_line &ripple = file.arm().joint[j].ripple[k];
            const double per_turn = 2 * M_PI * table[j][3 * k];
            ck_assert_double_eq_tol(ripple.order_rev, per_turn, 0.006 * per_turn);
            ck_assert_double_eq(std::fmod(ripple.order_rev, 50), 0);
            ck_assert_double_eq(ripple.amplitude_nm, table[j][3 * k + 1]);
            ck_assert_double_eq(ripple.phase_rad, table[j][3 * k + 2]);
            ck_assert_int_eq(ripple.directed, 1);
        }
    }
}
END_TEST

START_TEST(test_wind_up_is_table_five_continuous_and_joint_signed)
{
    // values at the two break points, worked out by hand from Table V as printed (value at zero
    // load plus slope times load along each line); negative rows printed along the motion, joint 3
    // negative with its break points in order
    struct Row {
        int joint, way;
        double t1, t2, at_t1, at_t2, at_0;
    };
    static const Row rows[] = {
        {1, 0, -25.36, -12.70, -30.48, -0.98, 2.32},  {1, 1, 12.16, 19.53, 0.68, -13.55, 0.19},
        {2, 0, -23.48, -11.75, -34.64, -3.79, -1.44}, {2, 1, 11.16, 21.75, -0.22, -29.87, 0.45},
        {3, 0, -5.78, -3.49, -9.26, 0.50, 0.81},      {3, 1, 2.64, 5.30, -0.25, -9.82, -0.30},
        {4, 0, -19.58, -16.27, -29.21, -12.40, 2.57}, {4, 1, 15.14, 19.23, -11.75, -28.56, -1.45}};
    const ArmFile file = ArmFile::load(pa10_path);
    for (const Row &row : rows) {
        const hdt_arm_stiffness &lines = file.arm().joint[row.joint - 1].stiffness[row.way];
        const double along = row.way ? -1 : 1;
        ck_assert_double_eq(lines.t1_nm, row.t1);
        ck_assert_double_eq(lines.t2_nm, row.t2);
        ck_assert_double_eq_tol(along * hdt::stiffness_nm(lines, row.t1), row.at_t1, 0.01);
        ck_assert_double_eq_tol(along * hdt::stiffness_nm(lines, row.t2), row.at_t2, 0.01);
        ck_assert_double_eq_tol(along * hdt::stiffness_nm(lines, 0), row.at_0, 1e-12);
    }
    for (int j = 4; j < 7; j++)
        ck_assert_int_eq(file.arm().joint[j].has_stiffness, 0);
}
END_TEST

START_TEST(test_pa10_gains_limits_and_inertia_are_those_of_the_sources)
{
    const ArmFile file = ArmFile::load(pa10_path);
    const hdt_arm &arm = file.arm();
    static const double kp[] = {4, 5, 4, 2, 0.6, 1.2, 0.6},
                        kd[] = {1, 1, 0.5, 0.5, 0.05, 0.15, 0.05},
                        limit_deg[] = {177, 94, 174, 137, 255, 165, 255},
                        reflected[] = {1.1725, 1.1725, 0.31575, 0.31575, 0.0255, 0.0255, 0.0255},
                        torque[] = {4.64, 4.64, 2, 2, 0.29, 0.29, 0.29};
    ck_assert_int_eq(arm.joints, 7);
    ck_assert_double_eq(arm.control_rate_hz, 700);
    ck_assert_double_eq(arm.velocity_cutoff_hz, 200);
    for (int j = 0; j < 7; j++) {
        const hdt_arm_joint &joint = arm.joint[j];
        ck_assert_double_eq(joint.ratio, 50);
        ck_assert_double_eq(joint.kp_m_nmprad, kp[j]);
        ck_assert_double_eq(joint.kd_m_nmspr, kd[j]);
        ck_assert_double_eq_tol(joint.q_max_rad * 180 / M_PI, limit_deg[j], 1e-9);
        ck_assert_double_eq_tol(joint.q_min_rad, -joint.q_max_rad, 1e-15);
        ck_assert_double_eq(joint.tau_max_m_nm, torque[j]);
        ck_assert_double_eq_tol(hdt::reflected_inertia_kgm2(joint), reflected[j], 1e-9);
        ck_assert_int_eq(joint.has_gear, 1);
        ck_assert(joint.k_nmprad[0] < joint.k_nmprad[1] && joint.k_nmprad[1] < joint.k_nmprad[2]);
        ck_assert_double_eq(joint.torque_gain, 1);
    }
}
END_TEST

static Eigen::VectorXd degrees(std::initializer_list<double> angles)
{
    Eigen::VectorXd q = Eigen::VectorXd::Zero(7);
    int j = 0;
    for (const double angle : angles)
        q[j++] = angle * M_PI / 180;
    return q;
}

START_TEST(test_pa10_stands_up_straight_and_leans_towards_x)
{
    const ArmFile file = ArmFile::load(pa10_path);
    const hdt::rbd::Pose up = hdt::rbd::flange(file.arm(), degrees({}));
    ck_assert_double_eq_tol((up.pos - Eigen::Vector3d(0, 0, 0.315 + 0.45 + 0.5 + 0.08)).norm(), 0,
                            1e-12);
    ck_assert_double_eq_tol((up.rot - Eigen::Matrix3d::Identity()).norm(), 0, 1e-12);
    const hdt::rbd::Pose flat = hdt::rbd::flange(file.arm(), degrees({0, 90}));
    ck_assert_double_eq_tol((flat.pos - Eigen::Vector3d(1.03, 0, 0.315)).norm(), 0, 1e-12);
    const hdt::rbd::Pose elbow = hdt::rbd::flange(file.arm(), degrees({0, 0, 0, 90}));
    ck_assert_double_eq_tol((elbow.pos - Eigen::Vector3d(0.58, 0, 0.765)).norm(), 0, 1e-12);
    const hdt::rbd::Pose wrist = hdt::rbd::flange(file.arm(), degrees({90, 0, 0, 0, 0, 90}));
    ck_assert_double_eq_tol((wrist.pos - Eigen::Vector3d(0, 0.08, 1.265)).norm(), 0, 1e-12);
}
END_TEST

START_TEST(test_pa10_holds_what_the_manufacturers_masses_weigh)
{
    // arm horizontal: sum of mass times lever, from the floor up
    const ArmFile file = ArmFile::load(pa10_path);
    const Eigen::VectorXd tau = hdt::rbd::gravity(file.arm(), degrees({0, -90}));
    const double wrist = 1.46 * (0.5 - 0.030) + 0.24 * (0.5 + 0.051);
    const double elbow = 4.31 * 0.04609 + 3.45 * 0.3353 + wrist;
    const double shoulder =
        8.41 * 0.06325 + 3.51 * 0.36056 + elbow + 0.45 * (4.31 + 3.45 + 1.46 + 0.24);
    ck_assert_double_eq_tol(tau[1], 9.81 * shoulder, 1e-9);
    ck_assert_double_eq_tol(tau[3], 9.81 * elbow, 1e-9);
    ck_assert_double_eq_tol(tau[1], 80.7, 0.05);
    ck_assert_double_eq_tol(tau[3], 21.3, 0.05);
    ck_assert_double_eq_tol(tau[5], 9.81 * (-1.46 * 0.030 + 0.24 * 0.051), 1e-9);
    ck_assert_double_eq_tol(std::fabs(tau[5]), 0.31, 0.005);
    ck_assert_double_eq_tol(hdt::rbd::gravity(file.arm(), degrees({30})).norm(), 0, 1e-12);
}
END_TEST

START_TEST(test_table_four_masses_hold_the_worked_cases)
{
    const ArmFile file = ArmFile::load(paper_path);
    struct Case {
        Eigen::VectorXd q;
        double tau[5];
    };
    const Case cases[] = {{degrees({0, -90}), {80.83, 0, 21.09, 0, -3.83}},
                          {degrees({0, 90}), {-80.83, 0, -21.09, 0, 3.83}},
                          {degrees({0, 0, 0, 90}), {-21.09, 0, -21.09, 0, 3.83}},
                          {degrees({}), {0, 0, 0, 0, 0}},
                          {degrees({0, 30, 40, 50, 60, 70}), {-51.11, 4.25, -21.01, -3.42, 1.18}}};
    for (const Case &c : cases) {
        const Eigen::VectorXd tau = hdt::rbd::gravity(file.arm(), c.q);
        for (int j = 0; j < 5; j++)
            ck_assert_double_eq_tol(tau[j + 1], c.tau[j], 0.006);
        ck_assert_double_eq_tol(tau[0], 0, 1e-9);
        ck_assert_double_eq_tol(tau[6], 0, 1e-9);
    }
}
END_TEST

static Suite *arm_suite(void)
{
    Suite *suite = suite_create("arm");
    TCase *errors = tcase_create("errors");
    tcase_add_loop_test(errors, test_every_error_says_file_line_key_expected_and_found, 0,
                        static_cast<int>(sizeof wrong_table / sizeof *wrong_table));
    tcase_add_test(errors, test_the_small_arm_itself_is_accepted);
    tcase_add_test(errors, test_too_many_and_no_joints_are_refused);
    tcase_add_test(errors, test_too_many_of_a_joints_tables_are_refused);
    tcase_add_test(errors, test_a_file_that_cannot_be_read_is_named);
    tcase_add_test(errors, test_damaged_bytes_never_do_more_than_refuse);
    tcase_set_timeout(errors, 60);
    suite_add_tcase(suite, errors);
    TCase *document = tcase_create("document");
    tcase_add_loop_test(document, test_written_file_reads_back_bit_for_bit, 0, 2);
    tcase_add_test(document, test_any_finite_number_and_any_text_survive_writing);
    tcase_add_test(document, test_set_append_and_erase_change_just_what_they_name);
    tcase_add_test(document, test_a_wrong_change_is_refused_and_changes_nothing);
    tcase_add_test(document, test_save_leaves_no_part_of_a_file);
    tcase_add_test(document, test_digest_is_that_of_sha256sum);
    tcase_add_test(document, test_roll_pitch_yaw_turn_about_fixed_axes_in_that_order);
    tcase_add_test(document, test_both_inertia_forms_give_the_same_arm);
    tcase_set_timeout(document, 60);
    suite_add_tcase(suite, document);
    TCase *pa10 = tcase_create("pa10");
    tcase_add_test(pa10, test_friction_is_equation_seven_with_table_two);
    tcase_add_test(pa10, test_inside_of_the_gear_is_read_whole_and_in_order);
    tcase_add_test(pa10, test_ripple_orders_are_table_three_in_wave_generator_turns);
    tcase_add_test(pa10, test_wind_up_is_table_five_continuous_and_joint_signed);
    tcase_add_test(pa10, test_pa10_gains_limits_and_inertia_are_those_of_the_sources);
    tcase_add_test(pa10, test_pa10_stands_up_straight_and_leans_towards_x);
    tcase_add_test(pa10, test_pa10_holds_what_the_manufacturers_masses_weigh);
    tcase_add_test(pa10, test_table_four_masses_hold_the_worked_cases);
    suite_add_tcase(suite, pa10);
    return suite;
}

HDT_CHECK_MAIN(arm_suite())
