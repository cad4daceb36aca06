// SPDX-License-Identifier: Apache-2.0
//
// Diagnosis: what is called adopted is in the model file written, what is not there is called refused with
// its reason, and the error after is that of the file read back.
#include <algorithm>
#include <cmath>
#include <string>

#include <nlohmann/json.hpp>

#include "model/diagnose.hpp"
#include "tests/planar_arm.hpp"
#include "tests/scratch.hpp"

#include "tests/check_main.h"

using namespace hdt;
using planar::Hidden;

namespace {

const ArmFile &arm(bool upright = false)
{
    static const ArmFile file[] = {ArmFile::parse(planar::arm_text(), "planar.toml"),
                                   ArmFile::parse(planar::arm_text(true), "upright.toml")};
    return file[upright];
}

struct Runs { std::vector<Run> fit, test; };

Runs make_runs(const Hidden &h, unsigned long seed, std::size_t fit = 6, const planar::Noise &noise = {})
{
    Runs r;
    for (unsigned long i = 0; i < fit + 2; ++i)
        (i < fit ? r.fit : r.test).push_back(planar::make_run(h, noise, 1000 * seed + i, 30));
    return r;
}

void declare(std::vector<Run> *runs, const std::string &kg, const std::string &com_m)
{
    for (Run &r : *runs) {
        r.constants["payload_kg"] = kg;
        r.constants["payload_com_m"] = com_m;
    }
}

// The file as its reader gets it.
ArmFile read_back(const Diagnosis &d) { return ArmFile::parse(d.model.text(), "written.toml"); }

bool differs(const ArmFile &a, const ArmFile &b, const std::string &key)
{
    return a.has(key) != b.has(key) || (a.has(key) && a.get(key).value != b.get(key).value);
}

int count(const ArmFile &f, int joint, const std::string &id)
{
    const std::string at = "joint." + std::to_string(joint) + ".effect";
    int n = 0;
    for (int k = 1; k <= f.count(at); ++k)
        n += f.get_text(at + "." + std::to_string(k) + ".id") == id;
    return n;
}

// Does the file differ by this effect?  By the file's keys alone.
bool holds(const ArmFile &before, const ArmFile &after, int joint, const Effect &e)
{
    const bool chain = std::any_of(e.parameters.begin(), e.parameters.end(),
                                   [](const EffectParameter &p) { return p.name == "link"; });
    if (e.id == "payload")
        return differs(before, after, "payload.mass");
    if (e.id == "base_tilt")
        return differs(before, after, "base.gravity");
    if (e.id == "link_mass" && chain)
        return differs(before, after,
                       "joint." + std::to_string(std::lround(e.parameters[0].value)) + ".link.mass");
    if (e.id == "unnamed" || e.id == "viscous_nonlinear" || e.id == "stribeck_shape")
        return differs(before, after, "joint." + std::to_string(joint) + ".table.torque");
    return count(after, joint, e.id) > count(before, joint, e.id);
}

// Held-out error of the file read back, by a diagnosis that is given it.
double error_of(const ArmFile &file, const Runs &r, std::size_t joint)
{
    return diagnose(file, {r.fit[0]}, r.test, {}).joints.at(joint).rms_before_nm;
}

void assert_as_written(const ArmFile &given, const Diagnosis &d, const char *what)
{
    const ArmFile back = read_back(d);
    for (const JointDiagnosis &j : d.joints) {
        int adopted = 0;
        for (const Effect &e : j.effects) {
            ck_assert_msg(e.adopted == holds(given, back, j.joint, e), "%s: joint %d, %s called %s: %s", what,
                          j.joint, e.id.c_str(), e.adopted ? "adopted" : "not adopted", j.words.c_str());
            const bool taken = j.verdict == "named" || j.verdict == "unnamed";
            ck_assert_msg(e.refused.empty() == (e.adopted || !taken), "%s: %s", what, j.words.c_str());
            if (!e.refused.empty())
                ck_assert_msg(j.words.find(e.refused) != std::string::npos, "%s: %s", what, j.words.c_str());
            const bool one_of_joint = e.id != "payload" && e.id != "base_tilt" && e.parameters.size() > 0
                                      && e.parameters[0].name != "link" && e.id != "viscous_nonlinear"
                                      && e.id != "stribeck_shape";
            adopted += e.adopted && one_of_joint;
        }
        const std::string effects = "joint." + std::to_string(j.joint) + ".effect";
        ck_assert_int_eq(back.count(effects) - given.count(effects), adopted);
        if (!j.refuses())
            ck_assert_double_eq(j.rms_explained_nm, j.rms_after_nm);
    }
}

struct Kind { const char *id; Hidden hidden; double delay_s; bool adoptable; };

std::vector<Kind> kinds()
{
    std::vector<Kind> c;
    const auto add = [&](const char *id, double Hidden::*size, double value, bool adoptable) {
        Hidden h;
        h.*size = value;
        c.push_back({id, h, 0, adoptable});
    };
    add("payload", &Hidden::payload_kg, 0.5, true);
    add("link_mass", &Hidden::moment_kgm, 0.25, true);
    add("base_tilt", &Hidden::tilt_rad, 0.03, true);
    add("load_friction", &Hidden::load_mu, 0.06, true);
    add("temperature", &Hidden::cold, 0.08, true);
    add("order_line", &Hidden::line_nm, 0.9, true);
    add("inertia", &Hidden::inertia_kgm2, 4, true);
    add("presliding", &Hidden::presliding_nm, 8, true);
    add("torque_gain", &Hidden::gain, 0.05, true);
    add("cable_spring", &Hidden::spring, 1.1, true);
    add("torque_offset", &Hidden::constant_nm, 1.5, true);
    add("local_friction", &Hidden::dry_spot_nm, 4, true);
    add("viscous_nonlinear", &Hidden::square, 80, true);
    add("stribeck_shape", &Hidden::slow_nm, 6, true);
    add("unnamed", &Hidden::own_friction_nm, 4, true);
    add("unnamed", &Hidden::pose_friction_nm, 4, false);
    add("joint_offset", &Hidden::angle_rad, 0.03, false);
    add("drive_efficiency", &Hidden::drive_mu, 0.08, false);
    add("ripple_load", &Hidden::ripple_per_nm, 0.03, false);
    add("coupling", &Hidden::other_kgm2, 5, false);
    add("eccentricity", &Hidden::ahead_rad, 0.05, false);
    add("soft_windup", &Hidden::step_nm, 5, false);
    return c;
}

} // namespace

// For each kind of effect: its flag, the file read back, and the error of that file on the same held-out
// runs say the same.
START_TEST(test_adopted_is_what_the_file_holds)
{
    const Kind k = kinds()[static_cast<std::size_t>(_i)];
    const bool upright = k.hidden.tilt_rad != 0;
    const Runs r = make_runs(k.hidden, 300 + static_cast<unsigned long>(_i), k.hidden.square != 0 ? 12 : 6);
    const Diagnosis d = diagnose(arm(upright), r.fit, r.test, {});
    const JointDiagnosis &j = d.joints[0];
    assert_as_written(arm(upright), d, k.id);
    const auto at = std::find_if(j.effects.begin(), j.effects.end(),
                                 [&](const Effect &e) { return e.id == k.id; });
    ck_assert_msg(at != j.effects.end(), "%s: %s", k.id, j.words.c_str());
    ck_assert_msg(at->adopted == k.adoptable, "%s: %s", k.id, j.words.c_str());
    // curves become a table, presliding the core's form of it: a few hundredths.  Errors are in the torque of
    // the model given, which a gain adopted makes larger
    const double gain = k.hidden.gain != 0 && at->adopted ? at->parameters[0].value : 1;
    const double back_nm = error_of(read_back(d), r, 0) / gain;
    ck_assert_msg(std::abs(back_nm / j.rms_after_nm - 1) < 0.05, "%s: the file leaves %g, said %g: %s", k.id,
                  back_nm, j.rms_after_nm, j.words.c_str());
    ck_assert_double_le(j.rms_after_nm, 1.15 * j.rms_before_nm);
    if (!k.adoptable)
        ck_assert_msg(j.rms_explained_nm < 0.97 * j.rms_after_nm, "%s: %s", k.id, j.words.c_str());
}
END_TEST

// The runs say 2 kg and carry 1.2: that is a wrong declaration, and no number of the file mends it.
START_TEST(test_payload_the_runs_declare_is_refused)
{
    Hidden h;
    h.payload_kg = 1.2;
    Runs r = make_runs(h, 9);
    declare(&r.fit, "2.0", "0 0 0.07"); // the flange's z is along the second link
    declare(&r.test, "2.0", "0 0 0.07");
    const Diagnosis d = diagnose(arm(), r.fit, r.test, {});
    assert_as_written(arm(), d, "declared payload");
    ck_assert(!d.model.has("payload"));
    ck_assert_uint_eq(d.joints.size(), 2);
    for (const JointDiagnosis &j : d.joints) {
        const Effect &e = j.effects.at(0);
        ck_assert_msg(j.verdict == "named" && e.id == "payload" && !e.adopted, "%s", j.words.c_str());
        ck_assert_double_eq_tol(e.parameters[0].value, -0.8, 0.1);
        for (const EffectParameter &p : e.parameters)
            if (p.name == "com_z_m")
                ck_assert_double_eq_tol(p.value, 0.07, 0.04);
        ck_assert_msg(e.refused.find("payload_kg = 2)") != std::string::npos, "%s", e.refused.c_str());
        ck_assert_msg(e.refused.find("payload_kg = 1.") != std::string::npos, "%s", e.refused.c_str());
        // nothing that is claimed is not there
        ck_assert_double_ge(j.rms_after_nm, 0.8 * j.rms_before_nm);
        ck_assert_double_lt(j.rms_explained_nm, 0.6 * j.rms_before_nm);
        const double back_nm = error_of(read_back(d), r, static_cast<std::size_t>(j.joint - 1));
        ck_assert_double_eq_tol(back_nm, j.rms_after_nm, 1e-9);
    }
    const std::string dir = scratch_dir();
    write_diagnosis(d, dir);
    const auto one = nlohmann::json::parse(slurp(dir + "/diagnosis.json")).at("joints")[0];
    ck_assert(one.at("effects")[0].at("adopted") == false);
    ck_assert(one.at("effects")[0].at("refused") == d.joints[0].effects[0].refused);
    ck_assert(one.at("rms_explained_nm") == d.joints[0].rms_explained_nm);
    ck_assert(slurp(dir + "/report.html").find("payload_kg = 2)") != std::string::npos);
    // what it tells to do mends it
    declare(&r.fit, "1.2", "0 0 0.07");
    declare(&r.test, "1.2", "0 0 0.07");
    for (const JointDiagnosis &j : diagnose(arm(), r.fit, r.test, {}).joints)
        ck_assert_msg(j.verdict == "nothing", "%s", j.words.c_str());
}
END_TEST

// Runs of several payloads, each half a kilogram more than it says: no one point is the payload's.
START_TEST(test_payloads_declared_apart_are_refused_by_their_difference)
{
    Runs r;
    for (unsigned long i = 0; i < 8; ++i) {
        Hidden h;
        const double kg = i % 2 == 0 ? 1 : 0;
        h.payload_kg = kg + 0.5;
        std::vector<Run> one = {planar::make_run(h, {}, 77700 + i, 30)};
        declare(&one, std::to_string(kg), "0 0 0.07");
        (i < 6 ? r.fit : r.test).push_back(one[0]);
    }
    const Diagnosis d = diagnose(arm(), r.fit, r.test, {});
    assert_as_written(arm(), d, "payloads apart");
    const Effect &e = d.joints.at(0).effects.at(0);
    ck_assert_msg(e.id == "payload" && !e.adopted, "%s", d.joints[0].words.c_str());
    ck_assert_double_eq_tol(e.parameters[0].value, 0.5, 0.1);
    for (const EffectParameter &p : e.parameters)
        ck_assert_msg(p.name.rfind("com_", 0) != 0, "%s is no number all runs share", p.name.c_str());
    ck_assert_msg(e.refused.find("payload_kg 0 to 1") != std::string::npos, "%s", e.refused.c_str());
}
END_TEST

// The file's own payload is what is corrected where the runs declare none.
START_TEST(test_payload_of_the_file_is_corrected)
{
    ArmFile with = arm();
    Quantity kg, com;
    kg.value = {2};
    kg.unit = "kg";
    com.value = {0, 0, 0.07};
    com.unit = "m";
    kg.sigma = {0.1};
    com.sigma = {0.01, 0.01, 0.01};
    kg.source = com.source = "T";
    with.set("payload.mass", kg);
    with.set("payload.com", com);
    with.refresh();
    Hidden h;
    h.payload_kg = 1.2;
    const Runs r = make_runs(h, 9);
    const Diagnosis d = diagnose(with, r.fit, r.test, {});
    assert_as_written(with, d, "payload of the file");
    ck_assert_double_eq_tol(d.model.arm().payload_kg, 1.2, 0.1);
    ck_assert_double_eq_tol(d.model.arm().payload_com_m[2], 0.07, 0.04);
}
END_TEST

// Four lines are all a joint can hold: the fifth is named, refused, and the error stays.
START_TEST(test_a_line_too_many_is_refused)
{
    ArmFile full = arm();
    for (int k = 0; k < HDT_LINES_MAX; ++k) {
        std::vector<std::pair<std::string, Quantity>> numbers;
        const std::pair<const char *, std::pair<double, const char *>> each[] = {
            {"order", {11.0 + 2 * k, "1"}}, {"amplitude", {1e-3, "N m"}}, {"phase", {0, "rad"}}};
        for (const auto &[name, number] : each) {
            Quantity q;
            q.value = {number.first};
            q.unit = number.second;
            q.sigma = {0};
            q.source = "T";
            numbers.emplace_back(name, q);
        }
        full.append("joint.1.effect", {{"id", "order_line"}, {"directed", "false"}}, numbers);
    }
    full.refresh();
    Hidden h;
    h.line_nm = 0.9;
    const Runs r = make_runs(h, 11);
    const Diagnosis d = diagnose(full, r.fit, r.test, {});
    assert_as_written(full, d, "fifth line");
    const JointDiagnosis &j = d.joints[0];
    ck_assert_msg(j.effects.at(0).id == "order_line" && !j.effects[0].adopted, "%s", j.words.c_str());
    ck_assert_msg(j.effects[0].refused.find("4 of them") != std::string::npos, "%s", j.words.c_str());
    ck_assert_double_eq(j.rms_after_nm, j.rms_before_nm);
    ck_assert_double_lt(j.rms_explained_nm, 0.9 * j.rms_before_nm);
}
END_TEST

// Loss with load that goes with less Coulomb friction, which is not written beside a refusal: by itself it
// would make the model worse, so it stays out too.
START_TEST(test_what_does_not_help_alone_is_not_written)
{
    Hidden h;
    h.load_mu = 0.1;
    h.cold = -0.15; // and it does not warm up
    h.warm_s = 1e9;
    h.ripple_per_nm = 0.03;
    const Runs r = make_runs(h, 13);
    const Diagnosis d = diagnose(arm(), r.fit, r.test, {});
    assert_as_written(arm(), d, "fitted beside");
    const JointDiagnosis &j = d.joints[0];
    bool beside = false;
    for (const Effect &e : j.effects)
        beside = beside
                 || (e.id == "load_friction" && e.refused.find("beside ripple_load") != std::string::npos);
    ck_assert_msg(j.verdict == "named" && beside, "%s", j.words.c_str());
    ck_assert(!read_back(d).has("joint.1.effect"));
    ck_assert_double_eq(j.rms_after_nm, j.rms_before_nm);
    ck_assert_double_lt(j.rms_explained_nm, 0.8 * j.rms_before_nm);
}
END_TEST

// What one joint shows of the whole arm is in the model for all: a joint whose held-out runs deny it says
// that it is there, and what error it has with it.
START_TEST(test_joint_that_denies_the_whole_arms_effect_has_it_all_the_same)
{
    Hidden h;
    h.payload_kg = 0.5;
    Runs r = make_runs(h, 12);
    for (std::size_t i = 0; i < r.test.size(); ++i)
        r.test[i].joint[1] = planar::make_run({}, {}, 12006 + i, 30).joint[1];
    const Diagnosis d = diagnose(arm(), r.fit, r.test, {});
    assert_as_written(arm(), d, "denied by one");
    const JointDiagnosis &j = d.joints.at(1);
    ck_assert_str_eq(d.joints[0].verdict.c_str(), "named");
    ck_assert_msg(j.verdict == "suspect" && j.effects.at(0).id == "payload" && j.effects[0].adopted, "%s",
                  j.words.c_str());
    ck_assert_double_gt(j.rms_after_nm, 1.05 * j.rms_before_nm);
    ck_assert_double_eq_tol(error_of(read_back(d), r, 1), j.rms_after_nm, 0.02);
    ck_assert(j.words.find("nothing is adopted") == std::string::npos);
}
END_TEST

static Suite *adopt_suite(void)
{
    Suite *s = suite_create("diagnose_adopt");
    TCase *kept = tcase_create("file");
    tcase_set_timeout(kept, 120);
    tcase_add_loop_test(kept, test_adopted_is_what_the_file_holds, 0, static_cast<int>(kinds().size()));
    suite_add_tcase(s, kept);
    TCase *refused = tcase_create("refused");
    tcase_set_timeout(refused, 120);
    tcase_add_test(refused, test_payload_the_runs_declare_is_refused);
    tcase_add_test(refused, test_payloads_declared_apart_are_refused_by_their_difference);
    tcase_add_test(refused, test_payload_of_the_file_is_corrected);
    tcase_add_test(refused, test_a_line_too_many_is_refused);
    tcase_add_test(refused, test_what_does_not_help_alone_is_not_written);
    tcase_add_test(refused, test_joint_that_denies_the_whole_arms_effect_has_it_all_the_same);
    suite_add_tcase(s, refused);
    return s;
}

HDT_CHECK_MAIN(adopt_suite())
