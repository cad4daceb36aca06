// SPDX-License-Identifier: Apache-2.0
//
// Logs that do not mean what they say are recognised, and others are left in peace.
// Goal: each way to spoil a log is named with run, joint and kind, on every joint; sound logs, logs with any
// hidden effect, and measured ones give nothing.
// Method: logs of the PA-10 by build/hdt, of a two-joint arm by textbook formulas (planar_arm.hpp), and of
// real arms where they are; then a column is spoilt as people spoil them.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "model/log_check.hpp"
#include "tests/planar_arm.hpp"
#include "tests/shell.hpp"

#include "tests/check_main.h"

using namespace hdt;

namespace {

constexpr double degree = 180 / M_PI, ratio = 50;
using Series = std::vector<double>;

void times(Series &x, double factor)
{
    for (double &v : x)
        v *= factor;
}

// A joint that only has what must be there.
void bare(Run::Joint &j)
{
    j.v_radps.clear();
    j.qref_rad.clear();
    j.vref_radps.clear();
    j.aref_radps2.clear();
}

// What somebody did to joint a, and for exchanges to joint b; the kinds that say so.
struct Spoil {
    const char *name;
    std::function<void(Run &, Run::Joint &a, Run::Joint &b)> how;
    std::vector<std::string> kinds;
    const char *says;
    bool pair = false;
};

const std::vector<Spoil> &spoils()
{
    using J = Run::Joint;
    static const std::vector<Spoil> all = {
        {"angle in degrees", [](Run &, J &a, J &) { times(a.q_rad, degree); }, {"angle_units"}, "in degrees"},
        {"angle and speed in degrees", [](Run &, J &a, J &) {
             times(a.q_rad, degree);
             times(a.v_radps, degree);
             a.qref_rad.clear(), a.vref_radps.clear();
         }, {"angle_units"}, "in degrees"},
        {"angle of the motor", [](Run &, J &a, J &) { times(a.q_rad, ratio); }, {"angle_units"},
         "motor-side"},
        {"speed in degrees", [](Run &, J &a, J &) { times(a.v_radps, degree); }, {"velocity_units"},
         "degrees per second"},
        {"speed of the motor", [](Run &, J &a, J &) { times(a.v_radps, ratio); }, {"velocity_units"},
         "motor-side"},
        {"speed in turns a minute", [](Run &, J &a, J &) { times(a.v_radps, 30 / M_PI); }, {"velocity_units"},
         "turns a minute"},
        {"speed turned round", [](Run &, J &a, J &) { times(a.v_radps, -1); }, {"velocity_sign"},
         "turned round"},
        {"angle turned round", [](Run &, J &a, J &) { times(a.q_rad, -1); }, {"angle_sign"}, "turned round"},
        {"angle and speed turned round", [](Run &, J &a, J &) { times(a.q_rad, -1); times(a.v_radps, -1); },
         {"angle_sign"}, "turned round"},
        {"motion turned round", [](Run &, J &a, J &) { bare(a); times(a.q_rad, -1); },
         {"angle_sign", "torque_sign"}, "should oppose it"},
        {"reference in degrees", [](Run &, J &a, J &) { times(a.qref_rad, degree); }, {"reference_units"},
         "qref"},
        {"torque of the motor", [](Run &, J &a, J &) { times(a.tau_nm, 1 / ratio); }, {"torque_side"},
         "looks motor-side: it is 0.0"},
        {"torque times the ratio twice", [](Run &, J &a, J &) { times(a.tau_nm, ratio); }, {"torque_side"},
         "twice"},
        {"torque in mN m", [](Run &, J &a, J &) { times(a.tau_nm, 1000); }, {"torque_units"}, "thousandths"},
        {"torque digits", [](Run &, J &a, J &) { times(a.tau_nm, 1000 / ratio); }, {"torque_units"},
         "motor-side and in thousandths"},
        {"torque turned round", [](Run &, J &a, J &) { times(a.tau_nm, -1); }, {"torque_sign"},
         "should oppose it"},
        {"speed in place of the angle", [](Run &, J &a, J &) { std::swap(a.q_rad, a.v_radps); },
         {"columns_swapped"}, "exchange q and v"},
        {"torque in place of the angle", [](Run &, J &a, J &) { std::swap(a.q_rad, a.tau_nm); },
         {"columns_swapped"}, "exchange q and tau"},
        {"torque in place of the speed", [](Run &, J &a, J &) { std::swap(a.v_radps, a.tau_nm); },
         {"columns_swapped"}, "exchange tau and v"},
        {"ratio of another gear", [](Run &r, J &a, J &) {
            r.constants["ratio" + std::to_string(&a - r.joint.data() + 1)] = "100"; }, {"gear_ratio"}, "100"},
        {"angles exchanged", [](Run &, J &a, J &b) { std::swap(a.q_rad, b.q_rad); }, {"columns_swapped"},
         "angle of joint", true},
        {"speeds exchanged", [](Run &, J &a, J &b) { std::swap(a.v_radps, b.v_radps); }, {"columns_swapped"},
         "angle of joint", true},
    };
    return all;
}

std::string said(const std::vector<LogFinding> &found)
{
    std::string text;
    for (const LogFinding &f : found)
        text += "\n  " + f.kind + (f.refuse ? " refused " : " warned ") + f.words;
    return text;
}

bool refused_on(const std::vector<LogFinding> &found, int joint, const Spoil &s)
{
    return std::any_of(found.begin(), found.end(), [&](const LogFinding &f) {
        return f.joint == joint && f.refuse && f.words.find(s.says) != std::string::npos &&
               std::find(s.kinds.begin(), s.kinds.end(), f.kind) != s.kinds.end();
    });
}

// Spoils every joint in turn, exchanging with its neighbour; all of them must be found there and only there.
void assert_each_joint_is_told(const hdt_arm &arm, const Run &clean, const Spoil &s)
{
    const std::size_t joints = clean.joint.size();
    for (std::size_t j = 0; j < joints; j++) {
        Run run = clean;
        const std::size_t k = (j + 1) % joints;
        s.how(run, run.joint[j], run.joint[k]);
        const std::vector<LogFinding> found = check_logs(arm, {run});
        const int a = static_cast<int>(j) + 1, b = static_cast<int>(k) + 1;
        ck_assert_msg(refused_on(found, a, s), "%s, joint %d of %s: %s", s.name, a, run.path.c_str(),
                      said(found).c_str());
        ck_assert_msg(!s.pair || refused_on(found, b, s), "%s, joint %d: %s", s.name, b, said(found).c_str());
        for (const LogFinding &f : found) {
            ck_assert_str_eq(f.run.c_str(), run.path.c_str());
            ck_assert_msg(f.joint == a || (s.pair && f.joint == b), "%s, joint %d: %s", s.name, a,
                          said(found).c_str());
            ck_assert_msg(f.words.find(run.path + ": joint " + std::to_string(f.joint)) == 0, "%s",
                          f.words.c_str());
            ck_assert_msg(f.words.find(f.kind == "gear_ratio" ? "50" : ";") != std::string::npos, "%s",
                          f.words.c_str());
        }
    }
}

void assert_left_in_peace(const hdt_arm &arm, const std::vector<Run> &runs)
{
    const std::vector<LogFinding> found = check_logs(arm, runs);
    ck_assert_msg(found.empty(), "%zu findings:%s", found.size(), said(found).c_str());
}

// The PA-10 by build/hdt, simulated once for all tests.
std::vector<Run> sound;
const char *pa10_file = "model/arms/pa10.toml";

const hdt_arm &pa10()
{
    static const ArmFile file = ArmFile::load(pa10_file);
    return file.arm();
}

Run simulate(const std::string &options)
{
    const std::string out = scratch("run.csv");
    const std::string command = build_dir() + "/hdt sim --arm " + pa10_file + " --out " +
                                out + " " + options + " >" + scratch("said") + " 2>&1";
    ck_assert_msg(std::system(command.c_str()) == 0, "%s", command.c_str());
    return read_run(out);
}

std::string excitation(int seed, int seconds)
{
    const std::string n = std::to_string(seed);
    return "--mode velocity --seed " + n + " --task excite:seed=" + n + ",seconds=" + std::to_string(seconds);
}

void simulate_sound()
{
    for (int seed : {51, 52})
        sound.push_back(simulate(excitation(seed, 40)));
}

// The two-joint arm, with the speed and the reference its log could have had.
const hdt_arm &planar_arm()
{
    static const ArmFile file = ArmFile::parse(planar::arm_text(), "planar.toml");
    return file.arm();
}

Run planar_run(const planar::Hidden &hidden, unsigned long seed)
{
    Run run = planar::make_run(hidden, {}, seed, 90);
    for (Run::Joint &j : run.joint) {
        const std::size_t n = j.q_rad.size();
        j.v_radps.assign(n, 0);
        for (std::size_t i = 1; i + 1 < n; i++)
            j.v_radps[i] = (j.q_rad[i + 1] - j.q_rad[i - 1]) / (run.t_s[i + 1] - run.t_s[i - 1]);
        j.qref_rad = j.q_rad;
        j.vref_radps = j.v_radps;
    }
    return run;
}

} // namespace

START_TEST(test_spoilt_columns_are_told_on_every_joint_of_the_pa10)
{
    assert_each_joint_is_told(pa10(), sound[_i % 2], spoils()[static_cast<std::size_t>(_i)]);
}
END_TEST

START_TEST(test_spoilt_columns_are_told_on_another_arm)
{
    for (unsigned long seed = 1; seed <= 3; seed++)
        assert_each_joint_is_told(planar_arm(), planar_run({}, seed), spoils()[static_cast<std::size_t>(_i)]);
}
END_TEST

// A model to be identified: friction and masses off by up to two, each joint its own way.
START_TEST(test_side_and_sign_are_told_against_a_model_that_is_wrong)
{
    hdt_arm arm = pa10();
    const double off[] = {0.5, 2, 0.6, 1.7, 0.5, 2, 0.7};
    for (int j = 0; j < arm.joints; j++) {
        for (hdt_arm_friction &f : arm.joint[j].friction)
            f.f0_nm *= off[j];
        arm.joint[j].mass_kg *= off[6 - j];
        for (double &m : arm.joint[j].moment_kgm)
            m *= off[6 - j];
    }
    assert_left_in_peace(arm, sound);
    for (const Spoil &s : spoils())
        for (std::size_t j = 0; j < 7; j++) {
            const bool side = std::string(s.name) == "torque of the motor";
            if (!side && std::string(s.name) != "torque turned round")
                continue;
            Run run = sound[0];
            s.how(run, run.joint[j], run.joint[j]);
            const std::vector<LogFinding> found = check_logs(arm, {run});
            ck_assert_msg(refused_on(found, static_cast<int>(j) + 1, s), "%s: %s", s.name,
                          said(found).c_str());
        }
}
END_TEST

// Without masses friction still opposes motion, and angles still have limits.
START_TEST(test_an_arm_without_masses_is_told_by_motion_alone)
{
    hdt_arm arm = planar_arm();
    for (int j = 0; j < arm.joints; j++) {
        arm.joint[j].has_inertial = 0;
        arm.joint[j].mass_kg = 0;
        std::fill(arm.joint[j].moment_kgm, arm.joint[j].moment_kgm + 3, 0);
        std::fill(arm.joint[j].inertia_kgm2, arm.joint[j].inertia_kgm2 + 6, 0);
        arm.joint[j].has_friction = 0;
    }
    int told = 0;
    for (unsigned long seed = 1; seed <= 6; seed++) {
        const Run clean = planar_run({}, seed);
        assert_left_in_peace(arm, {clean});
        for (int j = 0; j < 2; j++) {
            Run run = clean;
            times(run.joint[static_cast<std::size_t>(j)].tau_nm, -1);
            for (const LogFinding &f : check_logs(arm, {run}))
                told += f.kind == "torque_sign" && f.joint == j + 1;
        }
    }
    ck_assert_int_ge(told, 8); // the others turn round less than four times
}
END_TEST

START_TEST(test_angles_alone_are_held_against_the_limits)
{
    for (std::size_t j = 0; j < 7; j++) {
        Run run = sound[0];
        for (Run::Joint &joint : run.joint)
            bare(joint);
        times(run.joint[j].q_rad, degree);
        std::vector<LogFinding> found = check_logs(pa10(), {run});
        ck_assert_msg(found.size() == 1 && found[0].kind == "angle_units" && found[0].refuse &&
                      found[0].words.find("degrees") != std::string::npos, "%s", said(found).c_str());
        // and exchanged with the torque
        run = sound[0];
        bare(run.joint[j]);
        std::swap(run.joint[j].q_rad, run.joint[j].tau_nm);
        found = check_logs(pa10(), {run});
        ck_assert_msg(found.size() == 1 && found[0].kind == "columns_swapped", "%s", said(found).c_str());
    }
    Run run = sound[0]; // counted from 0 to 2 pi
    bare(run.joint[0]);
    for (double &q : run.joint[0].q_rad)
        q += 2 * M_PI;
    const std::vector<LogFinding> found = check_logs(pa10(), {run});
    ck_assert_msg(found.size() == 1 && found[0].kind == "angle_range", "%s", said(found).c_str());
    ck_assert_msg(found[0].words.find("subtract 2 pi") != std::string::npos, "%s", found[0].words.c_str());
}
END_TEST

// Torque alone tells which joint is which, where the two differ.
START_TEST(test_joints_and_torques_exchanged_are_told_by_torque)
{
    const std::pair<std::size_t, std::size_t> pairs[] = {{0, 4}, {1, 4}, {1, 5}, {2, 6}, {3, 5}, {5, 6}};
    for (const auto &[i, k] : pairs)
        for (bool all : {false, true}) {
            Run run = sound[0];
            if (all)
                std::swap(run.joint[i], run.joint[k]);
            else
                std::swap(run.joint[i].tau_nm, run.joint[k].tau_nm);
            const std::vector<LogFinding> found = check_logs(pa10(), {run});
            ck_assert_msg(found.size() == 2, "%zu and %zu: %s", i + 1, k + 1, said(found).c_str());
            for (const LogFinding &f : found)
                ck_assert_msg(f.kind == (all ? "joints_exchanged" : "columns_swapped") && f.refuse, "%s",
                              said(found).c_str());
            ck_assert_int_eq(found[0].joint, static_cast<int>(i) + 1);
            ck_assert_int_eq(found[1].joint, static_cast<int>(k) + 1);
            ck_assert(found[0].words.find("joint " + std::to_string(k + 1)) != std::string::npos);
        }
}
END_TEST

START_TEST(test_time_in_milliseconds_is_told_once)
{
    Run run = sound[0];
    times(run.t_s, 1000);
    Run other = sound[0];
    other.path = "other.csv";
    const std::vector<LogFinding> found = check_logs(pa10(), {other, run, other});
    ck_assert_uint_eq(found.size(), 1);
    ck_assert_str_eq(found[0].run.c_str(), run.path.c_str());
    ck_assert_str_eq(found[0].kind.c_str(), "time_units");
    ck_assert_int_eq(found[0].joint, 0);
    ck_assert(found[0].refuse && found[0].words.find("milliseconds") != std::string::npos);
}
END_TEST

// Twice the torque in every joint is odd, not impossible; in one joint it may be the joint.
START_TEST(test_one_factor_everywhere_is_a_warning)
{
    Run run = sound[0];
    times(run.joint[1].tau_nm, 1.3);
    assert_left_in_peace(pa10(), {run});
    run = sound[0];
    for (Run::Joint &j : run.joint)
        times(j.tau_nm, 2);
    const std::vector<LogFinding> found = check_logs(pa10(), {run});
    ck_assert_msg(found.size() == 1 && found[0].kind == "torque_scale" && !found[0].refuse, "%s",
                  said(found).c_str());
    ck_assert_double_eq_tol(found[0].found, 2, 0.1);
    ck_assert(log_refusals(found).empty());
    ck_assert(log_warnings(found) == found[0].words);
}
END_TEST

// An arm that hangs where the model stands: the load is turned round, friction is not.
START_TEST(test_a_load_the_other_way_is_told_apart_from_a_torque_turned_round)
{
    hdt_arm hanging = planar_arm();
    for (double &g : hanging.gravity_mps2)
        g = -g;
    const std::vector<LogFinding> found = check_logs(hanging, {planar_run({}, 3)});
    ck_assert_uint_eq(found.size(), 2);
    for (const LogFinding &f : found) {
        ck_assert_msg(f.kind == "load_sign" && f.refuse, "%s", said(found).c_str());
        ck_assert_double_eq_tol(f.found, -1, 0.1);
    }
}
END_TEST

START_TEST(test_a_speed_that_is_nothing_known_is_a_warning)
{
    Run run = sound[0];
    uint64_t seed = 1;
    for (double &v : run.joint[3].v_radps)
        v = test_uniform(&seed, -0.2, 0.2);
    const std::vector<LogFinding> found = check_logs(pa10(), {run});
    ck_assert_msg(found.size() == 1 && found[0].kind == "velocity_other" && !found[0].refuse &&
                  found[0].joint == 4,
                  "%s", said(found).c_str());
}
END_TEST

START_TEST(test_all_joints_spoilt_alike_are_all_told)
{
    for (const Spoil &s : spoils()) {
        if (s.pair || std::string(s.name).find("torque") == std::string::npos)
            continue;
        Run run = sound[1];
        for (Run::Joint &j : run.joint)
            s.how(run, j, j);
        const std::vector<LogFinding> found = check_logs(pa10(), {run});
        for (int j = 1; j <= 7; j++)
            ck_assert_msg(refused_on(found, j, s), "%s, joint %d: %s", s.name, j, said(found).c_str());
        const std::string text = log_refusals(found);
        ck_assert_int_eq(std::count(text.begin(), text.end(), '\n'), static_cast<long>(found.size()) - 1);
    }
}
END_TEST

START_TEST(test_sound_logs_are_left_in_peace)
{
    assert_left_in_peace(pa10(), sound);
    for (const char *task : {"lemniscate", "friction:joint=2", "friction:joint=7", "sweep:joint=4",
                             "trapezoid:joint=6", "hold"})
        for (const char *mode : {"torque", "velocity"})
            assert_left_in_peace(pa10(), {simulate(std::string("--task ") + task + " --mode " + mode)});
    for (unsigned long seed = 11; seed <= 22; seed++)
        assert_left_in_peace(planar_arm(), {planar_run({}, seed), planar::make_run({}, {}, seed, 20)});
}
END_TEST

// Every effect of `hdt sim --help`, at the sizes of tools/demo or of docs/diagnosis-bench.md.
const char *const effects[] = {
    "payload=2.5", "payload=6", "link_mass=0.6@2", "coupling=1.5@4", "base_tilt=12", "joint_offset=0.15@2",
    "lost_counts=400@5", "eccentricity=0.08@4", "cable_spring=10@2", "cable_spring=10@6", "contact=6@5",
    "torque_gain=0.3@1", "torque_gain=0.3@4", "torque_gain_drift=0.3@2", "torque_saturation=0.3@2",
    "torque_offset=5@6", "torque_delay=0.03@2", "dead_time=4@7", "current_ripple=0.08@3", "cogging=4@3",
    "load_friction=0.4@2", "drive_efficiency=0.4@4", "viscous_nonlinear=60@7", "stribeck_shape=4@5",
    "temperature=0.6@2", "presliding=15@2", "dwell_stiction=4@6", "local_friction=8@6", "brake_drag=3@7",
    "order_line=4@2", "ripple_load=0.3@4", "ripple_speed=15@5", "cage_slip=6@3", "inertia=25@2",
    "external_vibration=6@5", "soft_windup=5@2", "gear_stiffness=-0.3@2", "kinematic_error=0.002@3",
    "run_scatter=1@6", "wander=3@5", "stale_samples=0.1@3",
};

START_TEST(test_an_effect_is_no_bad_log)
{
    const std::string effect = effects[_i];
    assert_left_in_peace(pa10(), {simulate(excitation(70 + _i, 20) + " --effect " + effect)});
}
END_TEST

START_TEST(test_a_declared_payload_is_expected)
{
    // without the constant its torque would still be no log's fault; with it the load is right
    Run run = simulate(excitation(7, 20) + " --effect payload=6");
    run.constants["payload_kg"] = "6";
    run.constants["payload_com_m"] = "0 0 0.05";
    assert_left_in_peace(pa10(), {run});
}
END_TEST

START_TEST(test_what_cannot_be_told_is_not_said)
{
    assert_left_in_peace(pa10(), {cut_run(sound[0], 0, 0.3)});
    Run still = sound[0]; // nothing moves, whatever the columns are in
    for (Run::Joint &j : still.joint) {
        std::fill(j.q_rad.begin(), j.q_rad.end(), 0.1);
        std::fill(j.v_radps.begin(), j.v_radps.end(), 0.0);
        times(j.tau_nm, -1);
    }
    assert_left_in_peace(pa10(), {still});
    assert_left_in_peace(pa10(), {});
}
END_TEST

// Real arms, as imported; logs of HDT_DATA.
START_TEST(test_measured_logs_are_left_in_peace)
{
    namespace fs = std::filesystem;
    const char *set = std::getenv("HDT_DATA");
    const std::string data = set ? set : "../shared/data";
    if (!fs::is_directory(data + "/panda_gaz2019"))
        HDT_SKIP("no measured logs; HDT_DATA names their directory");
    const auto imported = [](const char *map, const std::string &path) {
        return convert_run(std::string("model/imports/") + map + ".toml", path);
    };
    const auto arm = [](const char *name) {
        return ArmFile::load(std::string("model/arms/") + name + ".toml").arm();
    };
    const Run panda = imported("panda_gaz", data + "/panda_gaz2019");
    const Run ur5 = imported("ur5_nist", data + "/ur5_nist_one_run/ur5_halfspeed_payload1.6lb_1.csv");
    assert_left_in_peace(arm("panda"), {panda, cut_run(panda, 0, 4)});
    assert_left_in_peace(arm("ur5"), {ur5, cut_run(ur5, ur5.t_s[0], ur5.t_s[0] + 10)});
    std::vector<Run> kinova, schunk;
    for (const auto &file : fs::recursive_directory_iterator(data + "/kinova_gen3_dynamapp"))
        if (file.path().extension() == ".csv")
            kinova.push_back(imported("kinova_gen3", file.path().string()));
    ck_assert_uint_ge(kinova.size(), 10);
    assert_left_in_peace(arm("kinova_gen3"), kinova);
    for (int k = 1; k <= 100; k++)
        schunk.push_back(imported("schunk_lwa4p",
                                  data + "/schunk_lwa4p_tum/measurement_" + std::to_string(k)));
    assert_left_in_peace(arm("schunk_lwa4p"), schunk);
    // and spoilt they are told
    Run bad = ur5;
    times(bad.joint[1].q_rad, degree);
    times(bad.joint[2].tau_nm, -1);
    ck_assert_str_eq(check_logs(arm("ur5"), {bad})[0].kind.c_str(), "angle_units");
    bad = ur5;
    times(bad.joint[2].tau_nm, -1);
    const std::vector<LogFinding> found = check_logs(arm("ur5"), {bad});
    ck_assert_msg(found.size() == 1 && found[0].kind == "torque_sign" && found[0].joint == 3, "%s",
                  said(found).c_str());
}
END_TEST

static Suite *log_check_suite(void)
{
    Suite *s = suite_create("log check");
    const int kinds = static_cast<int>(spoils().size());
    TCase *bad = tcase_create("bad logs");
    tcase_set_timeout(bad, 60);
    tcase_add_unchecked_fixture(bad, simulate_sound, nullptr);
    tcase_add_loop_test(bad, test_spoilt_columns_are_told_on_every_joint_of_the_pa10, 0, kinds);
    tcase_add_loop_test(bad, test_spoilt_columns_are_told_on_another_arm, 0, kinds);
    tcase_add_test(bad, test_side_and_sign_are_told_against_a_model_that_is_wrong);
    tcase_add_test(bad, test_an_arm_without_masses_is_told_by_motion_alone);
    tcase_add_test(bad, test_angles_alone_are_held_against_the_limits);
    tcase_add_test(bad, test_joints_and_torques_exchanged_are_told_by_torque);
    tcase_add_test(bad, test_time_in_milliseconds_is_told_once);
    tcase_add_test(bad, test_one_factor_everywhere_is_a_warning);
    tcase_add_test(bad, test_a_load_the_other_way_is_told_apart_from_a_torque_turned_round);
    tcase_add_test(bad, test_a_speed_that_is_nothing_known_is_a_warning);
    tcase_add_test(bad, test_all_joints_spoilt_alike_are_all_told);
    tcase_add_test(bad, test_sound_logs_are_left_in_peace);
    tcase_add_loop_test(bad, test_an_effect_is_no_bad_log, 0,
                        static_cast<int>(sizeof effects / sizeof *effects));
    tcase_add_test(bad, test_a_declared_payload_is_expected);
    tcase_add_test(bad, test_what_cannot_be_told_is_not_said);
    tcase_add_test(bad, test_measured_logs_are_left_in_peace);
    suite_add_tcase(s, bad);
    return s;
}

HDT_CHECK_MAIN(log_check_suite())
