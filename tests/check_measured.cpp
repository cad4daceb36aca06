// SPDX-License-Identifier: Apache-2.0
//
// What the pages of docs/measured are made of.  First on made-up rows, where the answer is known: lines by
// order and direction, the gear's loss, friction as a share, means over stretches.  Then, when the measured
// data are there, on real logs: bounds on both sides around what the pages print.
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>

#include "model/ident.hpp"
#include "tools/measured_signals.hpp"

#include "tests/check_main.h"

using namespace hdt;
using namespace hdt::measured;
using Eigen::Index;

namespace {

double normal(uint64_t *seed)
{
    double sum = 0;
    for (int k = 0; k < 12; ++k)
        sum += test_uniform(seed, -0.5, 0.5);
    return sum;
}

// To and fro with changing speed, 1 kHz; noise alone in the residual.
Signal motion(uint64_t seed, double seconds, double noise_nm)
{
    Signal s;
    s.joint = 1;
    const auto n = static_cast<Index>(seconds * 1000);
    for (auto *x : {&s.t_s, &s.q_rad, &s.v_radps, &s.a_radps2, &s.dir, &s.tau_nm, &s.residual_nm,
        &s.friction_nm, &s.sensor_nm})
        x->setZero(n);
    const double w1 = 1.1 + 0.1 * static_cast<double>(seed % 5), w2 = 2.7;
    for (Index i = 0; i < n; ++i) {
        const double t = static_cast<double>(i) / 1000;
        s.t_s[i] = t;
        s.q_rad[i] = 1.2 * std::sin(w1 * t) + 0.2 * std::sin(w2 * t);
        s.v_radps[i] = 1.2 * w1 * std::cos(w1 * t) + 0.2 * w2 * std::cos(w2 * t);
        s.a_radps2[i] = -1.2 * w1 * w1 * std::sin(w1 * t) - 0.2 * w2 * w2 * std::sin(w2 * t);
        s.dir[i] = s.v_radps[i] < 0 ? -1 : 1;
        s.residual_nm[i] = noise_nm * normal(&seed);
    }
    return s;
}

START_TEST(test_a_line_is_found_at_its_order_with_its_amplitude_and_taken_off)
{
    Signal s = motion(1, 30, 0.5), fresh = motion(2, 30, 0.5);
    for (Signal *r : {&s, &fresh})
        for (Index i = 0; i < r->q_rad.size(); ++i)
            r->residual_nm[i] += (r->dir[i] > 0 ? 0.5 : 0.2) * std::sin(303.0 * r->q_rad[i] +
                    (r->dir[i] > 0 ? 0.4 : 2.0));
    const std::vector<Line> found = strongest_lines({s}, 600, 3, 4);
    ck_assert_uint_eq(found.size(), 1);
    ck_assert_double_eq_tol(found[0].order, 303, 0.5);
    ck_assert_double_eq_tol(std::abs(found[0].up), 0.5, 0.05);
    ck_assert_double_eq_tol(std::abs(found[0].down), 0.2, 0.05);
    // held out: the line goes, the noise stays, and nothing else comes
    ck_assert_double_eq_tol(rms_nm({fresh}), std::sqrt(0.25 + 0.5 * (0.125 + 0.02)), 0.02);
    ck_assert_double_eq_tol(rms_nm(without_lines({fresh}, found)), 0.5, 0.01);
}
END_TEST

START_TEST(test_a_line_that_changes_sign_with_direction_does_not_cancel)
{
    Signal s = motion(6, 20, 0.5);
    for (Index i = 0; i < s.q_rad.size(); ++i)
        s.residual_nm[i] += 0.4 * s.dir[i] * std::sin(202 * s.q_rad[i]);
    const std::vector<Line> found = strongest_lines({s}, 600, 1, 4);
    ck_assert_uint_eq(found.size(), 1);
    ck_assert_double_eq_tol(found[0].order, 202, 0.5);
    ck_assert_double_eq_tol(found[0].amplitude_nm, 0.4, 0.05);
}
END_TEST

START_TEST(test_noise_has_no_line)
{
    for (uint64_t seed = 1; seed <= 5; ++seed)
        ck_assert_uint_eq(strongest_lines({motion(seed, 20, 1)}, 600, 3, 4).size(), 0);
}
END_TEST

START_TEST(test_a_line_above_half_the_sampling_rate_of_blocks_is_seen_at_full_rate)
{
    Signal s = motion(3, 20, 0.5);
    for (Index i = 0; i < s.q_rad.size(); ++i)
        s.residual_nm[i] += 0.3 * std::cos(1400 * s.q_rad[i]);
    ck_assert_double_eq_tol(line_at({s}, 1400).amplitude_nm, 0.3, 0.03);
    ck_assert_double_gt(line_at({s}, 1400).over_floor, 10);
    ck_assert_double_lt(line_at({s}, 200).over_floor, 3);
}
END_TEST

Signal geared(uint64_t seed, double drive, double back)
{
    Signal s = motion(seed, 10, 0);
    for (Index i = 0; i < s.q_rad.size(); ++i) {
        const double load = s.sensor_nm[i] = 20 * std::sin(s.q_rad[i] + 0.3) + 2 * s.a_radps2[i];
        const double share = load * s.dir[i] > 0 ? drive : back;
        s.tau_nm[i] = load + s.dir[i] * (2.5 + share * std::abs(load)) + 1.5 * s.v_radps[i] +
            0.4 * s.a_radps2[i] + 0.2
                      + 0.3 * normal(&seed);
    }
    return s;
}

START_TEST(test_loss_of_the_gear_comes_back_within_its_sigma)
{
    const Loss l = gear_loss({geared(1, 0.12, 0.05), geared(2, 0.12, 0.05), geared(3, 0.12, 0.05)});
    const double truth[Loss::Count] = {2.5, 1.5, 0.12, 0.05, 0.4, 0.2};
    for (int k = 0; k < Loss::Count; ++k) {
        ck_assert_double_eq_tol(l.value[k], truth[k], 5 * l.sigma[k]);
        ck_assert_double_lt(l.sigma[k], 0.05);
    }
    ck_assert_double_eq_tol(l.left_nm, 0.3, 0.01);
    ck_assert_double_gt(l.left_constant_nm, 0.4); // the load numbers are worth it
    const Loss none = gear_loss({geared(4, 0, 0), geared(5, 0, 0)});
    ck_assert_double_lt(std::abs(none.value[Loss::Drive]), 4 * none.sigma[Loss::Drive]);
    ck_assert_double_eq_tol(none.left_constant_nm, none.left_nm, 0.01);
}
END_TEST

START_TEST(test_loss_needs_two_runs_with_a_sensor)
{
    Signal blind = geared(1, 0.1, 0.1);
    blind.sensor_nm.resize(0);
    try {
        gear_loss({geared(1, 0.1, 0.1), blind});
        ck_abort_msg("one run with a sensor was accepted");
    } catch (const InputError &error) {
        ck_assert_ptr_nonnull(std::strstr(error.what(), "found 1"));
    }
}
END_TEST

START_TEST(test_friction_of_a_run_as_a_share_of_the_models)
{
    Signal s = motion(7, 10, 0.3);
    for (Index i = 0; i < s.dir.size(); ++i) {
        s.friction_nm[i] = s.dir[i] * 3 + s.v_radps[i];
        s.residual_nm[i] += -0.2 * s.friction_nm[i]; // warm
    }
    const FrictionShare share = friction_share(s);
    ck_assert_double_eq_tol(share.share, 0.8, 5 * share.sigma);
    ck_assert_double_lt(share.sigma, 0.01);
    s.friction_nm.setZero();
    ck_assert_double_nan(friction_share(s).share);
}
END_TEST

START_TEST(test_means_over_stretches_lose_noise_and_keep_what_is_slow)
{
    Signal s = motion(8, 20, 1);
    ck_assert_double_eq_tol(rms_of_means_nm({s}, 0.1), 0.1, 0.02); // a hundred rows each
    s.residual_nm.array() += 2;
    ck_assert_double_eq_tol(rms_of_means_nm({s}, 0.5), 2, 0.03);
    ck_assert_double_eq_tol(rms_of_means_nm({s}, 1e-4), rms_nm({s}), 1e-9);
}
END_TEST

// ---- measured ---------------------------------------------------------------------------------

std::string data_path(const std::string &name)
{
    const char *root = std::getenv("HDT_DATA");
    const std::string path = std::string(root ? root : "../shared/data") + "/" + name;
    return std::filesystem::exists(path) ? path : "";
}

std::vector<Signal> of_joint(const ArmFile &arm, const std::vector<Run> &runs, int joint, Rows rows)
{
    std::vector<Signal> out;
    for (const Run &run : runs)
        for (Signal &s : signals(arm, run, rows))
            if (s.joint == joint)
                out.push_back(std::move(s));
    return out;
}

// Two thirds of a run in four pieces, and its last third.
struct Thirds { std::vector<Run> fit, test; };

Thirds thirds(const Run &run)
{
    const double from = run.t_s.front(), span = run.t_s.back() - from;
    Thirds t;
    for (int k = 0; k < 4; ++k)
        t.fit.push_back(cut_run(run, from + span * k / 6, from + span * (k + 1) / 6));
    t.test.push_back(cut_run(run, from + span * 2 / 3, from + span + 1));
    return t;
}

START_TEST(test_kinova_ripple_is_at_motor_orders_and_not_at_two)
{
    const std::string path = data_path("kinova_gen3_dynamapp");
    if (path.empty())
        HDT_SKIP("no Kinova data under HDT_DATA");
    const ArmFile arm = ArmFile::load("model/arms/kinova_gen3.toml");
    const auto steady = [&](int joint) {
        const std::string file = path + "/jointwise_motion/joint_" + std::to_string(joint) + "_trapez.csv";
        return of_joint(arm, {convert_run("model/imports/kinova_gen3.toml", file)}, joint, Rows::Fitted);
    };
    const std::vector<Signal> seven = steady(7), one = steady(1);
    ck_assert_double_eq_tol(line_at(seven, 1200).amplitude_nm, 1.23, 0.1);
    ck_assert_double_gt(line_at(seven, 1200).over_floor, 20);
    ck_assert_double_lt(line_at(seven, 200).amplitude_nm, 0.1);
    ck_assert_double_gt(line_at(one, 2400).over_floor, 10);
    ck_assert_double_lt(line_at(one, 200).over_floor, 3);
    ck_assert_double_lt(line_at(one, 400).over_floor, 3);
}
END_TEST

START_TEST(test_kinova_gear_loses_more_under_load)
{
    const std::string path = data_path("kinova_gen3_dynamapp");
    if (path.empty())
        HDT_SKIP("no Kinova data under HDT_DATA");
    const ArmFile arm = ArmFile::load("model/arms/kinova_gen3.toml");
    std::vector<Run> runs;
    for (const char *file : {"identification_data/RunTrajectory1.csv",
        "validation_data/opti_traj_testing1.csv",
                             "validation_data/opti_traj_testing2.csv"})
        runs.push_back(convert_run("model/imports/kinova_gen3.toml", path + "/" + file));
    const Loss two = gear_loss(of_joint(arm, runs, 2, Rows::Fitted));
    ck_assert_double_gt(two.value[Loss::Drive], 3 * two.sigma[Loss::Drive]);
    ck_assert_double_gt(two.value[Loss::Back], 3 * two.sigma[Loss::Back]);
    ck_assert_double_lt(two.left_nm, 0.8 * two.left_constant_nm);
    // equal drives, equal rotors
    const Loss three = gear_loss(of_joint(arm, runs, 3, Rows::Fitted)),
        six = gear_loss(of_joint(arm, runs, 6, Rows::Fitted));
    ck_assert_double_eq_tol(two.value[Loss::Inertia], three.value[Loss::Inertia], 0.1);
    ck_assert_double_eq_tol(three.value[Loss::Inertia], 0.5, 0.1);
    ck_assert_double_eq_tol(six.value[Loss::Inertia], 0.11, 0.05);
}
END_TEST

START_TEST(test_panda_held_out_beside_the_published_model)
{
    const std::string path = data_path("panda_gaz2019");
    if (path.empty())
        HDT_SKIP("no Panda data under HDT_DATA");
    const Thirds t = thirds(convert_run("model/imports/panda_gaz.toml", path));
    const IdentResult r = identify(ArmFile::load("model/arms/panda.toml"), t.fit, t.test, {});
    ck_assert_uint_eq(r.joints.size(), 7);
    const double published[] = {.234, .535, .226, .267, .125, .084, .057};
    for (const JointFit &j : r.joints) {
        const double other = published[j.joint - 1];
        ck_assert_msg(j.held_out_after_nm < 1.3 * other && j.held_out_after_nm > 0.3 * other,
            "joint %d: %.3f beside %.3f N.m",
                      j.joint, j.held_out_after_nm, other);
        if (j.joint == 2 || j.joint >= 5)
            ck_assert_msg(j.held_out_after_nm < other, "joint %d: %.3f, published %.3f N.m", j.joint,
                j.held_out_after_nm, other);
    }
    // two a motor turn, found in the fit runs, goes from the held-out run
    const std::vector<Line> line = strongest_lines(of_joint(r.model, t.fit, 1, Rows::Fitted), 600, 1, 4);
    ck_assert_uint_eq(line.size(), 1);
    ck_assert_double_eq_tol(line[0].order, 240.5, 1);
    const std::vector<Signal> test = of_joint(r.model, t.test, 1, Rows::Fitted);
    ck_assert_double_lt(rms_nm(without_lines(test, line)), 0.92 * rms_nm(test));
}
END_TEST

START_TEST(test_ur5_lines_are_found_at_multiples_of_the_ratio_and_go)
{
    const std::string path = data_path("ur5_nist_one_run/ur5_halfspeed_payload1.6lb_1.csv");
    if (path.empty())
        HDT_SKIP("no UR5 data under HDT_DATA");
    const Thirds t = thirds(convert_run("model/imports/ur5_nist.toml", path));
    const IdentResult r = identify(ArmFile::load("model/arms/ur5.toml"), t.fit, t.test, {});
    const std::vector<Line> line = strongest_lines(of_joint(r.model, t.fit, 2, Rows::Fitted), 800, 1, 4);
    ck_assert_uint_eq(line.size(), 1);
    ck_assert_double_eq_tol(line[0].order, 505, 1);
    const std::vector<Signal> test = of_joint(r.model, t.test, 2, Rows::Fitted);
    ck_assert_double_lt(rms_nm(without_lines(test, line)), 0.95 * rms_nm(test));
    const std::vector<Line> four = strongest_lines(of_joint(r.model, t.fit, 4, Rows::Fitted), 800, 1, 4);
    ck_assert_uint_eq(four.size(), 1);
    ck_assert_double_eq_tol(four[0].order, 303, 1);
}
END_TEST

START_TEST(test_schunk_friction_falls_within_a_group_and_comes_back)
{
    const std::string path = data_path("schunk_lwa4p_tum");
    if (path.empty())
        HDT_SKIP("no Schunk data under HDT_DATA");
    const auto run = [&](int k) {
        return convert_run("model/imports/schunk_lwa4p.toml", path + "/measurement_" + std::to_string(k));
    };
    std::vector<Run> fit;
    for (const int k : {3, 8, 13, 18, 23, 28, 33, 38, 83, 88, 96, 98})
        fit.push_back(run(k));
    const IdentResult r = identify(ArmFile::load("model/arms/schunk_lwa4p.toml"), fit, {}, {});
    const auto share = [&](int k, int joint) { return friction_share(of_joint(r.model, {run(k)}, joint,
        Rows::Fitted).at(0)).share; };
    for (const int joint : {3, 4}) {
        const double first = share(1, joint), last = share(20, joint), next = share(21, joint);
        ck_assert_msg(first - last > 0.15 && first - last < 0.6, "joint %d: %.2f -> %.2f", joint, first,
            last);
        ck_assert_msg(next - last > 0.1, "joint %d: %.2f, then %.2f", joint, last, next);
    }
}
END_TEST

} // namespace

static Suite *measured_suite(void)
{
    Suite *suite = suite_create("measured");
    TCase *known = tcase_create("known answers");
    tcase_add_test(known, test_a_line_is_found_at_its_order_with_its_amplitude_and_taken_off);
    tcase_add_test(known, test_a_line_that_changes_sign_with_direction_does_not_cancel);
    tcase_add_test(known, test_noise_has_no_line);
    tcase_add_test(known, test_a_line_above_half_the_sampling_rate_of_blocks_is_seen_at_full_rate);
    tcase_add_test(known, test_loss_of_the_gear_comes_back_within_its_sigma);
    tcase_add_test(known, test_loss_needs_two_runs_with_a_sensor);
    tcase_add_test(known, test_friction_of_a_run_as_a_share_of_the_models);
    tcase_add_test(known, test_means_over_stretches_lose_noise_and_keep_what_is_slow);
    suite_add_tcase(suite, known);
    TCase *arms = tcase_create("measured arms");
    tcase_set_timeout(arms, 120);
    tcase_add_test(arms, test_kinova_ripple_is_at_motor_orders_and_not_at_two);
    tcase_add_test(arms, test_kinova_gear_loses_more_under_load);
    tcase_add_test(arms, test_panda_held_out_beside_the_published_model);
    tcase_add_test(arms, test_ur5_lines_are_found_at_multiples_of_the_ratio_and_go);
    tcase_add_test(arms, test_schunk_friction_falls_within_a_group_and_comes_back);
    suite_add_tcase(suite, arms);
    return suite;
}

HDT_CHECK_MAIN(measured_suite())
