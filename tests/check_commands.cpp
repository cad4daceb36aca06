// SPDX-License-Identifier: Apache-2.0
//
// What the commands do not take, what they say then, and how they end.
// Goal: a wrong command line is 2, a bad file 3, each in words that name it; nothing is compared, fitted or
// simulated that was not asked for; an end before the end is said.
// Method: build/hdt in a directory of its own, virtual time, short logs.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "model/log.hpp"
#include "tests/check_main.h"
#include "tests/shell.hpp"

namespace {

std::string dir;

void set_up() { dir = scratch_dir(); }

void tear_down() { std::filesystem::remove_all(dir); }

Result must(const std::string &line)
{
    Result r = sh(line);
    ck_assert_msg(r.code == 0, "%s: exit code %d: %s", line.c_str(), r.code, r.err.c_str());
    return r;
}

bool holds(const std::string &text, const std::string &words)
{
    return text.find(words) != std::string::npos;
}

// Ends with this code; stderr holds the words; nothing on stdout, no `product` and no part of one left.
Result refused(int code, const std::string &line, const std::string &words,
               const std::string &product = "x.csv")
{
    std::filesystem::remove(dir + "/" + product);
    Result r = sh(line);
    ck_assert_msg(r.code == code, "%s: exit code %d, expected %d: %s", line.c_str(), r.code, code,
                  r.err.c_str());
    ck_assert_msg(holds(r.err, words), "%s: expected \"%s\" in: %s", line.c_str(), words.c_str(),
                  r.err.c_str());
    ck_assert_msg(r.out.empty(), "%s: said %s", line.c_str(), r.out.c_str());
    ck_assert_msg(!std::filesystem::exists(dir + "/" + product), "%s left %s", line.c_str(),
                  product.c_str());
    ck_assert_msg(sh("! ls | grep '[.]part'").code == 0, "%s left a part of a file", line.c_str());
    return r;
}

void spill(const std::string &name, const std::string &bytes)
{
    std::ofstream(dir + "/" + name, std::ios::binary) << bytes;
}

// A short run with noise and, unless it is given, motion of this seed.
std::string run(int seed, const std::string &name, const std::string &options, int motion = 0)
{
    return "$H sim --arm $A --seed " + std::to_string(seed) + " --task excite:seed=" +
           std::to_string(motion != 0 ? motion : seed) + ",seconds=5 --out " + name + " " + options;
}

} // namespace

START_TEST(test_compare_takes_only_like_runs)
{
    must(run(1, "a.csv", "--terms"));
    must(run(2, "b.csv", "--terms", 1));
    must(run(2, "bare.csv", "", 1));
    must(run(2, "other.csv", "--terms"));
    must(run(2, "velocity.csv", "--terms --mode velocity", 1));
    must(run(2, "load.csv", "--terms --payload 1", 1));
    const std::string line = "$H compare --model $A --out x.html --before a.csv --after ";
    must("sed 's/^# arm = .*/# arm = other/' b.csv >arm.csv; cp a.csv copy.csv; ln -s a.csv link.csv");
    refused(3, line + "a.csv", "a.csv: the same measurement as a.csv", "x.html");
    refused(3, line + "./copy.csv", "./copy.csv: the same measurement as a.csv", "x.html");
    refused(3, line + "link.csv", "the same measurement", "x.html");
    refused(3, line + "other.csv", "other.csv: task: expected \"excite:seed=1,seconds=5\" as in a.csv, found "
            "\"excite:seed=2,seconds=5\"", "x.html");
    refused(3, line + "velocity.csv", "velocity.csv: mode: expected \"torque\"", "x.html");
    refused(3, line + "arm.csv", "arm.csv: arm: expected \"pa10\" as in a.csv, found \"other\"", "x.html");
    refused(3, line + "load.csv", "load.csv: payload_kg: expected nothing as in a.csv, found", "x.html");
    refused(3, line + "bare.csv", "bare.csv: expected the feedback's torques", "x.html");
    Result r = sh(line + "b.csv");
    ck_assert_msg(r.code <= 1 && holds(r.out, "feedback torque share"), "%s%s", r.out.c_str(),
                  r.err.c_str());
}
END_TEST

START_TEST(test_compare_reads_only_a_diagnosis_of_its_version)
{
    must(run(1, "a.csv", "--terms") + "; " + run(2, "b.csv", "--terms", 1));
    const std::string line = "$H compare --model $A --out x.html --before a.csv --after b.csv "
                             "--diagnosis d.json";
    const std::string joint = R"({"joint":1,"verdict":"nothing","noise_floor_nm":1,"rms_before_nm":1,)"
                              R"("rms_after_nm":1,"effects":[],"ambiguous_with":[],"next_experiment":""})";
    const std::string head = R"({"format":"hdt-diagnosis","version":)";
    const char *const bad[][2] = {
        {R"({"format":"hdt-ident","version":1,"joints":[]})",
         "d.json: format: expected \"hdt-diagnosis\", found \"hdt-ident\""},
        {"[]", "d.json: format: expected \"hdt-diagnosis\", found nothing"},
        {"{", "d.json: expected JSON"},
        {"", "d.json: expected JSON"},
        {R"({"format":"hdt-diagnosis","version":2,"joints":[]})",
         "d.json: version: this program reads 1, found 2"},
        {R"({"format":"hdt-diagnosis","version":1})", "d.json: not of the shape"},
        {R"({"format":"hdt-diagnosis","version":1,"joints":[{"joint":"a"}]})", "d.json: not of the shape"}};
    for (const auto &[text, words] : bad) {
        spill("d.json", text);
        refused(3, line, words, "x.html");
    }
    std::string foo = head + "1,\"joints\":[" + joint + "]}";
    spill("d.json", foo);
    ck_assert_int_le(sh(line).code, 1);
    foo.replace(foo.find("nothing"), 7, "foo");
    spill("d.json", foo);
    refused(3, line, "d.json: joint 1: verdict: expected named, unnamed, suspect or nothing, found 'foo'",
            "x.html");
}
END_TEST

START_TEST(test_a_run_counts_once)
{
    must(run(1, "a.csv", "") + "; " + run(2, "b.csv", "") + "; cp a.csv copy.csv; ln -s a.csv link.csv");
    for (const char *command : {"$H ident --arm $A", "$H diagnose --model $A"})
        for (const char *runs : {"--fit a.csv a.csv --test b.csv", "--fit a.csv b.csv --test ./a.csv",
                                 "--fit a.csv copy.csv --test b.csv", "--fit a.csv b.csv --test link.csv"}) {
            Result r = refused(3, std::string(command) + " --out d " + runs, "the same measurement as a.csv",
                               "d");
            ck_assert_msg(holds(r.err, "every run once"), "%s", r.err.c_str());
        }
}
END_TEST

START_TEST(test_event_log_converts_to_the_csv_of_its_run)
{
    for (const char *terms : {"", " --terms"}) {
        const std::string how = std::string(" --payload 1.5 ") + terms;
        must(run(1, "a.csv", how) + "; " + run(1, "a.lcm", how));
        Result r = must(std::string("$H log convert a.lcm b.csv") + terms + "; cmp a.csv b.csv");
        ck_assert_msg(holds(r.out, "b.csv: ") && holds(r.out, "joints 1 2 3 4 5 6 7"), "%s", r.out.c_str());
    }
    // who cannot read one says how to go on
    for (const char *line : {"$H ident --arm $A --out x.csv --fit a.lcm", "$H log cut a.lcm x.csv",
                             "$H diagnose --model $A --out x.csv --fit a.csv --test a.lcm",
                             "$H log check a.lcm",
                             "$H compare --model $A --out x.csv --before a.csv --after a.lcm"})
        refused(3, line, "hdt log convert a.lcm a.csv");
    // cut off: nothing is made of it
    must("head -c 100000 a.lcm >cut.lcm");
    refused(3, "$H log convert cut.lcm x.csv", "cut.lcm: at byte");
    refused(3, "$H log convert nowhere.csv x.csv --map nowhere.toml", "nowhere.toml");
    refused(2, "$H log convert a.csv x.csv", "a.csv: is no LCM event log of hdt: a foreign table needs");
    refused(2, "$H log convert a.csv x.csv --map m.toml --terms", "--terms");
}
END_TEST

START_TEST(test_dump_of_a_fault_converts)
{
    must("$H sim --arm $A --task excite:seed=4,seconds=20 --effect contact=200@2:from=8,to=12 --out run.csv "
         "--dump dump.lcm --terms; test $? = 1");
    must("$H log convert dump.lcm dump.csv --terms");
    // the run's own last rows, time counted from another first
    const hdt::Run all = hdt::read_run(dir + "/run.csv"), part = hdt::read_run(dir + "/dump.csv");
    ck_assert_uint_gt(part.rows(), 1000);
    const auto &long_q = all.joint[1].q_rad, &q = part.joint[1].q_rad;
    const auto at = std::search(long_q.begin(), long_q.end(), q.begin(), q.end());
    ck_assert_msg(at != long_q.end(), "not a part of the run");
    ck_assert_int_ne(static_cast<int>(part.extra.at("fault").back()), 0);
}
END_TEST

START_TEST(test_logs_keep_their_names_and_their_sources)
{
    must(run(1, "a.csv", "") + "; cp a.csv keep.csv; ln -s a.csv link.csv");
    refused(2, "$H log cut a.csv x.lcm --to 1", "x.lcm: what is written is CSV", "x.lcm");
    refused(2, "$H log convert a.csv x.lcm --map m.toml", "x.lcm: what is written is CSV", "x.lcm");
    refused(2, "$H log cut a.csv ./a.csv --to 1", "is what is read", "never");
    refused(2, "$H log cut a.csv link.csv --to 1", "is what is read", "never");
    must("cmp a.csv keep.csv");
}
END_TEST

START_TEST(test_a_fit_ends_at_once_when_it_is_told_to)
{
    std::string logs;
    for (int k = 1; k <= 5; k++) {
        const std::string n = std::to_string(k);
        must("$H sim --arm $A --mode velocity --seed " + n + " --task excite:seed=" + n +
             ",seconds=40 --out r" + n + ".csv");
        logs += k == 5 ? " --test r5.csv" : " r" + n + ".csv";
    }
    for (const char *command : {"$H ident --arm $A", "$H diagnose --model $A"})
        for (const auto &[signal, code] : {std::pair{"INT", 130}, {"TERM", 143}}) {
            const std::string line = std::string("timeout --preserve-status -s ") + signal + " 0.4 ";
            Result r = refused(code, line + command + " --out d --fit" + logs, "hdt: interrupted", "d");
            ck_assert_str_eq(r.err.c_str(), "hdt: interrupted\n");
        }
}
END_TEST

START_TEST(test_a_run_that_was_cut_says_so)
{
    for (const char *signal : {"INT", "TERM"}) {
        Result r = sh(std::string("timeout --preserve-status -s ") + signal + " 1 $H sim --arm $A --task "
                      "excite:seed=1,seconds=200 --out cut.csv");
        ck_assert_int_eq(r.code, 1);
        ck_assert_msg(holds(r.err, "hdt sim: done: brakes on; asked for: the run ends at sample "), "%s",
                      r.err.c_str());
        must("$H log check cut.csv");
    }
}
END_TEST

// A host that stands still for a while misses periods.
START_TEST(test_a_host_that_was_late_says_so_and_is_not_ok)
{
    Result r = {};
    for (int attempt = 0; attempt < 5 && !holds(r.err, "overrun policy"); attempt++)
        r = sh("$H servo --arm $A --bus unix:$PWD/bus --task lemniscate 2>/dev/null & s=$!; "
               "for i in $(seq 100); do [ -S bus ] && break; sleep 0.1; done; "
               "$H host --model $A --bus unix:$PWD/bus --overrun stop --overrun-limit 1 --out x.csv & h=$!; "
               "sleep 1; kill -STOP $h; sleep 0.02; kill -CONT $h; wait $h; c=$?; kill $s; wait $s; "
               "rm -f bus; exit $c");
    ck_assert_msg(r.code == 1 && holds(r.err, "were missed (overrun policy): the run ends at sample "),
                  "%d: %s", r.code, r.err.c_str());
}
END_TEST

START_TEST(test_log_check_says_what_ident_would)
{
    must(run(1, "a.csv", ""));
    hdt::Run bad = hdt::read_run(dir + "/a.csv");
    bad.joint.push_back(bad.joint[6]);
    hdt::write_run(dir + "/eight.csv", bad);
    Result r = sh("$H log check --arm $A eight.csv");
    ck_assert_int_eq(r.code, 1);
    const std::string words = "eight.csv: expected at most 7 joints as the arm has, found joint 8";
    ck_assert_msg(holds(r.out, words), "%s", r.out.c_str());
    refused(3, "$H ident --arm $A --fit eight.csv --out d", words, "d");
    // another arm's name: said, and taken
    must("sed 's/^# arm = .*/# arm = ur5/' a.csv >named.csv");
    r = must("$H log check --arm $A named.csv");
    ck_assert_msg(holds(r.out, "named.csv: log is of the arm 'ur5', the model of 'pa10'"), "%s",
                  r.out.c_str());
    r = must("$H log check --arm $A a.csv");
    ck_assert_msg(!holds(r.out, "is of the arm"), "%s", r.out.c_str());
}
END_TEST

START_TEST(test_misspelt_words_are_named_with_the_nearest)
{
    const char *const bad[][2] = {
        {"$H simm", "\"simm\": no such command of hdt; did you mean sim?"},
        {"$H frobnicate", "\"frobnicate\": no such command of hdt\n"},
        {"$H ident --fitt x", "\"--fitt\": no such option of hdt ident; did you mean --fit?"},
        {"$H ident --fitt=x", "\"--fitt\": no such option"},
        {"$H sim --arm $A --out x.csv --efect a=1", "\"--efect\": no such option of hdt sim; did you mean "
                                                    "--effect?"},
        {"$H sim --arm $A --out x.csv more", "\"more\": not expected by hdt sim"},
        {"$H log chek x.csv", "\"chek\": no such command of hdt log; did you mean check?"},
        {"$H ident", "hdt ident: --arm is required"},
        {"$H", "hdt: A subcommand is required"}};
    for (const auto &[line, words] : bad)
        refused(2, line, words);
}
END_TEST

START_TEST(test_a_wrong_command_line_is_two)
{
    must(run(1, "a.csv", ""));
    const std::string sim = "$H sim --arm $A --out x.csv --task excite:seed=1,seconds=5 ";
    const std::string end = " --bus unix:$PWD/no ";
    const std::string bad[][2] = {
        {sim + "--mode foo", "--mode: expected torque or velocity, found \"foo\""},
        {sim + "--format C", "--format: expected A or B"},
        {sim + "--effect foo=3", "known effects"},
        {sim + "--effect cable_spring=1@9", "joint 9 of an arm with 7"},
        {sim + "--effect cable_spring=1:rest=0,rest=1", "option \"rest\" is given twice"},
        {sim + "--integrator foo", "expected verlet or rk4"},
        {sim + "--arcnet 3", "--arcnet: expected 10, 5"},
        {sim + "--arcnet nan", "--arcnet: expected a number from 0 to 10, found 'nan'"},
        {sim + "--payload -2", "--payload: expected a number from 0 to 1000, found '-2'"},
        {sim + "--payload nan", "--payload: expected a number from 0 to 1000"},
        {sim + "--seed 1e3", "--seed: expected a whole number"},
        {sim + "--seed -1", "--seed: expected a whole number"},
        {sim + "--seed 99999999999999999999999", "--seed: expected a whole number"},
        {sim + "--individual -3", "--individual: expected a whole number"},
        {sim + "--dump d.csv", "--dump: expected a name ending in .lcm"},
        {"$H sim --arm $A --out x.txt", "x.txt: not a log name"},
        {"$H sim --arm $A --out a.lcm --dump ./a.lcm", "--dump: ./a.lcm is --out"},
        {"$H sim --arm $A --out x.csv --task lemon", "lemniscate"},
        {"$H ident --arm $A --out x.csv --fit a.csv --joints 2,x", "--joints: expected numbers 1 to 16"},
        {"$H ident --arm $A --out x.csv --fit a.csv --joints ''", "--joints: expected numbers 1 to 16"},
        {"$H bus unix:no --answer -5", "--answer: expected a number from 0"},
        {"$H bus unix:no --answer nan", "--answer: expected a number from 0"},
        {"$H bus unix:no --rate nan", "--rate: expected a number from 1"},
        {"$H servo --arm $A --seconds -1" + end, "--seconds: expected a number from 0"},
        {"$H servo --arm $A --seconds nan" + end, "--seconds: expected a number from 0"},
        {"$H servo --arm $A --bus foo", "foo: not a bus"},
        {"$H host --model $A --out x.csv --overrun foo" + end, "--overrun: expected count, hold or stop"},
        {"$H host --model $A --out d.lcm --dump d.lcm" + end, "--dump: d.lcm is --out"},
        {"$H export $A --out x.csv --format foo", "--format: expected urdf or mjcf"},
        {"$H log cut a.csv x.csv --to nan", "--to: expected a number"}};
    for (const auto &[line, words] : bad)
        refused(2, line, words);
    // what was right stays right
    must(sim + "--seed 18446744073709551615 --payload 1.5");
}
END_TEST

START_TEST(test_effect_files_are_read_or_refused_by_line)
{
    const std::string sim = "$H sim --arm $A --out x.csv --task excite:seed=1,seconds=5 --effect-file ";
    refused(3, sim + "/tmp", "/tmp: cannot be read: Is a directory");
    refused(3, sim + "/dev/zero", "/dev/zero: expected a text file");
    refused(3, sim + "nowhere", "nowhere: cannot be read");
    spill("f", "# nothing\n\n");
    refused(3, sim + "f", "f: expected one NAME=SIZE[@JOINT] a line, found none");
    spill("f", "# two\ncable_spring=8@2\nfoo=3\n");
    refused(3, sim + "f", "f:3: --effect: expected NAME=SIZE");
    spill("f", "cable_spring=8@9\n");
    refused(3, sim + "f", "f:1: --effect cable_spring: joint 9");
    spill("f", "# DOS\r\n\r\ncable_spring=8@2\r\n");
    must(sim + "f; mv x.csv a.csv");
    must("$H sim --arm $A --out x.csv --task excite:seed=1,seconds=5 --effect cable_spring=8@2");
    must("cmp a.csv x.csv");
}
END_TEST

START_TEST(test_a_model_is_not_written_over_itself)
{
    must(run(1, "a.csv", "") + "; " + run(2, "b.csv", "") + "; mkdir same; cp $A same/model.toml");
    for (const char *line : {"$H ident --arm same/model.toml --fit a.csv --out same",
                             "$H ident --arm ./same/model.toml --fit a.csv --out ./same/",
                             "$H diagnose --model same/model.toml --fit a.csv --test b.csv --out same"})
        refused(2, line, "model.toml is the model that is read: expected another", "same/report.html");
    must("cmp $A same/model.toml");
}
END_TEST

START_TEST(test_ident_says_what_it_left_out)
{
    must(run(1, "a.csv", "--mode velocity"));
    hdt::Run less = hdt::read_run(dir + "/a.csv");
    less.joint[2] = {};
    hdt::write_run(dir + "/less.csv", less);
    Result r = must("$H ident --arm $A --fit less.csv --out d");
    ck_assert_msg(holds(r.out, "joints left out: 3 (no log has"), "%s", r.out.c_str());
    r = must("$H ident --arm $A --fit less.csv --joints 1,2 --out d");
    ck_assert_msg(holds(r.out, "joints left out: 3 4 5 6 7 (not in --joints)\n"), "%s", r.out.c_str());
    ck_assert_msg(holds(r.out, "-      -\n") && !holds(r.out, "nan"), "%s", r.out.c_str());
}
END_TEST

START_TEST(test_gen_names_the_line_of_the_number_that_does_not_fit)
{
    // changed at its first place, in joint 1; the line is so many below the one on which that begins
    const std::string arm = sh("cat $A").out;
    const auto says = [&](const std::string &from, const std::string &to, long more,
                          const std::string &words) {
        const std::size_t at = arm.find(from);
        ck_assert_msg(at != std::string::npos, "%s is not in the arm", from.c_str());
        const long line = 1 + more + std::count(arm.begin(), arm.begin() + static_cast<long>(at), '\n');
        const std::string said = "a.toml:" + std::to_string(line) + ": " + words;
        spill("a.toml", std::string(arm).replace(at, from.size(), to));
        refused(3, "$H gen a.toml --out t", said, "t");
        refused(3, "$H sim --arm a.toml --task hold --out x.csv", said);
    };
    says("gear.ratio = { value = 50", "gear.ratio = { value = 20000", 0,
         "joint.1.gear.ratio: expected a number from 2 to 10000 for the tables, found 20000");
    says("limits.speed = { value = 1", "limits.speed = { value = 100", 0, "joint.1.limits.speed: expected");
    says("velocity_cutoff = { value = 200", "velocity_cutoff = { value = 0.01", 0,
         "control.velocity_cutoff:");
    // the second effect, the first line of its kind
    const std::string known = ", confidence = \"low\", source = \"CHOSEN\" }\n", end = "# ---- joint 2";
    says(end, "[[joint.effect]]\nid = \"torque_offset\"\ntorque = { value = 1, unit = \"N m\"" + known +
              "[[joint.effect]]\nid = \"order_line\"\namplitude = { value = 1, unit = \"N m\"" + known +
              "order = { value = 300000, unit = \"1\"" + known + "phase = { value = 0, unit = \"rad\"" +
              known + "directed = false\n" + end,
         6, "joint.1.effect (order_line 1).order: expected above 0 and below");
}
END_TEST

START_TEST(test_words_that_cannot_be_written_are_no_success)
{
    must(run(1, "a.csv", "") + "; " + run(1, "a.lcm", ""));
    for (const char *line : {"$H log check a.csv", "$H replay a.lcm", "$H gen $A --out t"}) {
        Result r = sh(std::string(line) + " >/dev/full");
        ck_assert_msg(r.code == 3 && holds(r.err, "standard output cannot be written: No space left"),
                      "%d: %s", r.code, r.err.c_str());
    }
    refused(1, "timeout 20 $H top --lcm file://$PWD/a.lcm?speed=0", "hdt top: no status was heard");
}
END_TEST

static Suite *commands_suite(void)
{
    Suite *s = suite_create("commands");
    TCase *t = tcase_create("refusals");
    tcase_set_timeout(t, 120);
    tcase_add_checked_fixture(t, set_up, tear_down);
    tcase_add_test(t, test_compare_takes_only_like_runs);
    tcase_add_test(t, test_compare_reads_only_a_diagnosis_of_its_version);
    tcase_add_test(t, test_a_run_counts_once);
    tcase_add_test(t, test_event_log_converts_to_the_csv_of_its_run);
    tcase_add_test(t, test_dump_of_a_fault_converts);
    tcase_add_test(t, test_logs_keep_their_names_and_their_sources);
    tcase_add_test(t, test_a_fit_ends_at_once_when_it_is_told_to);
    tcase_add_test(t, test_a_run_that_was_cut_says_so);
    tcase_add_test(t, test_a_host_that_was_late_says_so_and_is_not_ok);
    tcase_add_test(t, test_log_check_says_what_ident_would);
    tcase_add_test(t, test_misspelt_words_are_named_with_the_nearest);
    tcase_add_test(t, test_a_wrong_command_line_is_two);
    tcase_add_test(t, test_effect_files_are_read_or_refused_by_line);
    tcase_add_test(t, test_a_model_is_not_written_over_itself);
    tcase_add_test(t, test_ident_says_what_it_left_out);
    tcase_add_test(t, test_gen_names_the_line_of_the_number_that_does_not_fit);
    tcase_add_test(t, test_words_that_cannot_be_written_are_no_success);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(commands_suite())
