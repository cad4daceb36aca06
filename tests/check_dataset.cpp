// SPDX-License-Identifier: Apache-2.0
//
// Conditioning: derivatives against closed forms, masks against rows known to be bad, block means
// against a second computation.  Runs are built here from sums of sines; no file is read.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "model/arm_file.hpp"
#include "model/dataset.hpp"

#include "tests/check_main.h"

using hdt::Conditioned;
using hdt::Run;

namespace {

constexpr double count_rad = 2 * M_PI / (50 * 16384.0); // one resolver count at the output

hdt_arm small_arm(int joints)
{
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    arm.joints = joints;
    arm.gravity_mps2[2] = -9.81;
    arm.flange_rot[0] = arm.flange_rot[4] = arm.flange_rot[8] = 1;
    for (int j = 0; j < joints; j++) {
        hdt_arm_joint &a = arm.joint[j];
        a.rot[0] = a.rot[4] = a.rot[8] = 1;
        a.q_min_rad = -3;
        a.q_max_rad = 3;
        a.ratio = 50;
        a.tau_max_m_nm = 4;
        a.torque_gain = 1;
    }
    return arm;
}

struct Truth { double q, v, a; };

// Two sines: about 0.7 rad/s and 2.5 rad/s^2 at most.
Truth motion(double t)
{
    double w1 = 2 * M_PI * 0.25, w2 = 2 * M_PI * 1.1;
    return {0.3 * std::sin(w1 * t) + 0.04 * std::cos(w2 * t),
            0.3 * w1 * std::cos(w1 * t) - 0.04 * w2 * std::sin(w2 * t),
            -0.3 * w1 * w1 * std::sin(w1 * t) - 0.04 * w2 * w2 * std::cos(w2 * t)};
}

double quantised(double q) { return count_rad * std::round(q / count_rad); }

Run make_run(double seconds, double rate_hz, double jitter, uint64_t seed)
{
    Run run;
    run.path = "made.csv";
    run.joint.resize(1);
    run.joint[0].present = true;
    for (double t = 0; t < seconds; t += (1 + test_uniform(&seed, -jitter, jitter)) / rate_hz) {
        Truth m = motion(t);
        run.t_s.push_back(t);
        run.joint[0].q_rad.push_back(quantised(m.q));
        run.joint[0].tau_nm.push_back((m.v > 0 ? 10 : -10) + 3 * m.v + test_uniform(&seed, -0.3, 0.3));
    }
    return run;
}

double rms_error(const Conditioned &c, const Eigen::MatrixXd &x, double Truth::*what)
{
    double sum = 0;
    Eigen::Index n = 0;
    for (Eigen::Index i = 0; i < c.t_s.size(); i++)
        if (c.valid(i, 0)) {
            double e = x(i, 0) - motion(c.t_s[i]).*what;
            sum += e * e;
            n++;
        }
    return std::sqrt(sum / static_cast<double>(n));
}

std::string refusal(const Run &run, const hdt_arm &arm, const hdt::ConditionOptions &o = {})
{
    try {
        hdt::condition(run, arm, o);
    } catch (const hdt::InputError &e) {
        return e.what();
    }
    return "";
}

bool says(const std::string &text, const char *part) { return text.find(part) != std::string::npos; }

} // namespace

// rms speed 0.36 rad/s, rms acceleration 1.5 rad/s^2: errors below are under 0.2 % and 2 % of them
START_TEST(test_derivatives_follow_the_motion_without_lag)
{
    static const double rate[] = {100, 125, 700, 1000, 1504}, jitter[] = {0, 0.45};
    Run run = make_run(12, rate[_i / 2], jitter[_i % 2], 11 + static_cast<uint64_t>(_i));
    Conditioned c = hdt::condition(run, small_arm(1), {});
    ck_assert_double_lt(rms_error(c, c.v, &Truth::v), 7e-4);
    ck_assert_double_lt(rms_error(c, c.a, &Truth::a), 0.03);
    ck_assert_double_lt(std::fabs(c.rate_hz / rate[_i / 2] - 1), 0.05);
    // a lag of 1 ms would show as covariance of the error with the next derivative: 2.2e-3 of it
    double num = 0, den = 0;
    for (Eigen::Index i = 0; i < c.t_s.size(); i++)
        if (c.valid(i, 0)) {
            Truth m = motion(c.t_s[i]);
            num += (c.v(i, 0) - m.v) * m.a;
            den += m.a * m.a;
        }
    ck_assert_double_lt(std::fabs(num / den), 5e-5); // s
}
END_TEST

START_TEST(test_torque_and_position_are_never_changed)
{
    Run run = make_run(5, 700, 0.3, 3);
    Conditioned c = hdt::condition(run, small_arm(1), {});
    for (std::size_t i = 0; i < run.rows(); i++) {
        ck_assert(c.tau(static_cast<Eigen::Index>(i), 0) == run.joint[0].tau_nm[i]);
        ck_assert(c.q(static_cast<Eigen::Index>(i), 0) == run.joint[0].q_rad[i]);
    }
}
END_TEST

START_TEST(test_direction_is_right_wherever_it_is_used)
{
    Run run = make_run(12, 700, 0.2, 5);
    hdt_arm arm = small_arm(1);
    Conditioned c = hdt::condition(run, arm, {});
    ck_assert_double_ge(c.v_min[0], 0.004);
    std::size_t still = 0;
    for (Eigen::Index i = 0; i < c.t_s.size(); i++) {
        double v = motion(c.t_s[i]).v;
        if (c.valid(i, 0))
            ck_assert(c.dir(i, 0) == (v > 0 ? 1 : -1));
        else if (c.dir(i, 0) == 0)
            still++;
        ck_assert(std::fabs(c.v(i, 0)) >= c.v_min[0] || c.dir(i, 0) == 0);
    }
    ck_assert_uint_gt(still, 0);
    ck_assert_uint_ge(c.masked[0].standstill, still - c.masked[0].gap);
    // a faster threshold masks more
    hdt::ConditionOptions o;
    o.v_min_radps = 0.1;
    ck_assert_uint_gt(hdt::condition(run, arm, o).masked[0].standstill, 3 * c.masked[0].standstill);
}
END_TEST

START_TEST(test_guard_masks_both_sides_of_a_reversal)
{
    Run run = make_run(12, 700, 0, 5);
    hdt::ConditionOptions o;
    o.reversal_guard_s = 0.05;
    Conditioned c = hdt::condition(run, small_arm(1), o);
    // reversals of the motion, found on a fine grid
    int reversals = 0;
    for (double t = 0.2; t < 11.8; t += 1e-4) {
        if (motion(t).v * motion(t + 1e-4).v > 0)
            continue;
        reversals++;
        for (Eigen::Index i = 0; i < c.t_s.size(); i++)
            if (std::fabs(c.t_s[i] - t) < 0.045)
                ck_assert(!c.valid(i, 0));
    }
    ck_assert_int_gt(reversals, 4);
    ck_assert_int_gt(c.valid.count(), 6000);
}
END_TEST

START_TEST(test_travel_is_the_distance_since_the_reversal)
{
    Run run = make_run(12, 700, 0, 7);
    Conditioned c = hdt::condition(run, small_arm(1), {});
    double q_turn = run.joint[0].q_rad[0], last = 0;
    double worst = 0;
    for (Eigen::Index i = 0; i < c.t_s.size(); i++) {
        double v = motion(c.t_s[i]).v, d = v > 0 ? 1 : -1;
        if (last != 0 && d != last)
            q_turn = motion(c.t_s[i]).q;
        last = d;
        if (c.valid(i, 0))
            worst = std::max(worst, std::fabs(c.travel(i, 0) - std::fabs(c.q(i, 0) - q_turn)));
    }
    ck_assert_double_lt(worst, 5e-4); // rad: v_min is reached a few milliseconds after the turn
}
END_TEST

START_TEST(test_spikes_are_masked_and_reversals_are_not)
{
    Run run = make_run(20, 1000, 0.1, 9);
    std::vector<char> hit(run.rows(), 0);
    std::size_t spikes = 0;
    for (std::size_t i = 100; i + 3 < run.rows(); i += 200) // 5 Hz, 2 ms wide, both signs
        for (std::size_t k = 0; k < 2; k++) {
            run.joint[0].tau_nm[i + k] += (i / 200) % 2 ? 15 : -6;
            hit[i + k] = 1;
            spikes++;
        }
    Conditioned c = hdt::condition(run, small_arm(1), {});
    for (std::size_t i = 0; i < run.rows(); i++)
        if (hit[i])
            ck_assert(!c.valid(static_cast<Eigen::Index>(i), 0));
    ck_assert_uint_ge(c.masked[0].spike, spikes * 9 / 10);
    ck_assert_uint_le(c.masked[0].spike, spikes * 5); // 3 ms either side of 2 ms
    // without spikes nothing is called one, though the torque steps by 20 N.m at every reversal
    ck_assert_uint_eq(hdt::condition(make_run(20, 1000, 0.1, 9), small_arm(1), {}).masked[0].spike, 0);
}
END_TEST

START_TEST(test_quantised_constant_torque_is_no_spike)
{
    Run run = make_run(10, 700, 0, 13);
    for (std::size_t i = 0; i < run.rows(); i++) // one digit up now and then
        run.joint[0].tau_nm[i] = 20 + (i % 37 == 0 ? 0.05 : 0);
    ck_assert_uint_eq(hdt::condition(run, small_arm(1), {}).masked[0].spike, 0);
}
END_TEST

START_TEST(test_gap_is_not_bridged)
{
    Run whole = make_run(12, 700, 0, 15), run = whole;
    auto cut = [&](auto &x) { x.erase(x.begin() + 2000, x.begin() + 2700); };
    cut(run.t_s);
    cut(run.joint[0].q_rad);
    cut(run.joint[0].tau_nm);
    Conditioned c = hdt::condition(run, small_arm(1), {});
    ck_assert(!c.valid(1999, 0) && !c.valid(2000, 0));
    ck_assert_double_lt(rms_error(c, c.v, &Truth::v), 7e-4);
    ck_assert_double_lt(rms_error(c, c.a, &Truth::a), 0.03);
    ck_assert_uint_gt(c.masked[0].gap, hdt::condition(whole, small_arm(1), {}).masked[0].gap);
    for (std::size_t b = 0; b + 1 < c.block_begin.size(); b++) // no block spans it
        ck_assert(c.block_begin[b + 1] <= 2000 || c.block_begin[b] >= 2000);
}
END_TEST

START_TEST(test_saturated_rows_are_masked)
{
    Run run = make_run(10, 700, 0, 17);
    std::size_t clipped = 0;
    for (std::size_t i = 3000; i < 3500; i++, clipped++)
        run.joint[0].tau_nm[i] = -200; // 50 * 4 N.m
    Conditioned c = hdt::condition(run, small_arm(1), {});
    for (Eigen::Index i = 3000; i < 3500; i++)
        ck_assert(!c.valid(i, 0));
    // the first few rows of it may have gone as a spike or standstill
    ck_assert_uint_ge(c.masked[0].saturated, clipped * 8 / 10);
}
END_TEST

START_TEST(test_every_row_is_valid_or_counted_once)
{
    Run run = make_run(10, 700, 0.4, 19);
    run.joint[0].tau_nm[1234] += 50;
    Conditioned c = hdt::condition(run, small_arm(1), {});
    const hdt::MaskCount &m = c.masked[0];
    ck_assert_uint_eq(m.gap + m.spike + m.saturated + m.standstill +
                          static_cast<std::size_t>(c.valid.count()),
                      run.rows());
}
END_TEST

START_TEST(test_block_means_equal_a_second_computation)
{
    Run run = make_run(10, 700, 0.4, 21);
    Conditioned c = hdt::condition(run, small_arm(1), {});
    Eigen::VectorXd mean = c.block_mean(0, c.tau.col(0)), t = c.block_mean(0, c.t_s);
    std::vector<Eigen::Index> which = c.blocks(0);
    ck_assert_uint_eq(which.size(), static_cast<std::size_t>(mean.size()));
    ck_assert_int_gt(mean.size(), 800);
    for (Eigen::Index k = 0; k < mean.size(); k++) {
        double slot = std::floor(t[k] / 0.01 + 1e-6), sum = 0;
        int all = 0, good = 0;
        for (Eigen::Index i = 0; i < c.t_s.size(); i++)
            if (std::floor(c.t_s[i] / 0.01 + 1e-6) == slot) {
                all++;
                if (c.valid(i, 0)) {
                    good++;
                    sum += c.tau(i, 0);
                }
            }
        ck_assert_int_ge(2 * good, all);
        ck_assert_double_eq_tol(mean[k], sum / good, 1e-12 * std::fabs(sum));
        if (k > 0)
            ck_assert_double_gt(t[k], t[k - 1]);
    }
    Eigen::MatrixXd both(c.t_s.size(), 2);
    both << c.tau.col(0), c.q.col(0);
    ck_assert(c.block_means(0, both).col(0) == mean);
}
END_TEST

START_TEST(test_noisy_position_gets_a_wider_smoother)
{
    Run run = make_run(12, 700, 0, 23), noisy = run;
    uint64_t seed = 1;
    for (double &q : noisy.joint[0].q_rad)
        q += test_uniform(&seed, -1e-4, 1e-4);
    Conditioned fine = hdt::condition(run, small_arm(1), {}), c = hdt::condition(noisy, small_arm(1), {});
    ck_assert_double_gt(c.smooth_s[0], 2 * fine.smooth_s[0]);
    // the noise it states is the noise it has
    double e = rms_error(c, c.a, &Truth::a);
    ck_assert_double_lt(c.a_noise[0], 2 * e);
    ck_assert_double_lt(fine.a_noise[0], 0.05);
    ck_assert_double_lt(e, 0.1);
}
END_TEST

START_TEST(test_reference_acceleration_replaces_a_noisy_one_only)
{
    Run run = make_run(12, 700, 0, 25);
    uint64_t seed = 1;
    Run noisy = run;
    for (std::size_t i = 0; i < run.rows(); i++) {
        run.joint[0].aref_radps2.push_back(0.8 * motion(run.t_s[i]).a); // bad tracking
        noisy.joint[0].aref_radps2.push_back(motion(run.t_s[i]).a);
        noisy.joint[0].q_rad[i] += test_uniform(&seed, -1e-2, 1e-2);
    }
    Conditioned c = hdt::condition(run, small_arm(1), {});
    ck_assert_double_lt(rms_error(c, c.a, &Truth::a), 0.03);
    c = hdt::condition(noisy, small_arm(1), {});
    ck_assert_double_lt(rms_error(c, c.a, &Truth::a), 1e-9);
}
END_TEST

START_TEST(test_declared_payload_of_the_run_wins)
{
    hdt_arm arm = small_arm(1);
    arm.payload_kg = 1;
    arm.payload_com_m[2] = 0.1;
    Run run = make_run(3, 700, 0, 27);
    Conditioned c = hdt::condition(run, arm, {});
    ck_assert(hdt::arm_for_run(arm, c).payload_kg == 1 && hdt::arm_for_run(arm, c).payload_com_m[2] == 0.1);
    run.constants["payload_kg"] = "2.5";
    run.constants["payload_com_m"] = "0 0.01 0.07";
    c = hdt::condition(run, arm, {});
    hdt_arm mine = hdt::arm_for_run(arm, c);
    ck_assert(mine.payload_kg == 2.5 && mine.payload_com_m[1] == 0.01 && mine.payload_com_m[2] == 0.07);
    run.constants["payload_com_m"] = "0 0.07";
    ck_assert(says(refusal(run, arm), "made.csv: payload_com_m"));
    run.constants["payload_com_m"] = "0 0 0";
    run.constants["payload_kg"] = "-1";
    ck_assert(says(refusal(run, arm), "payload_kg"));
}
END_TEST

START_TEST(test_absent_joint_is_wholly_masked)
{
    Run run = make_run(5, 700, 0, 29);
    run.joint.resize(3);
    run.joint[2] = run.joint[0];
    Conditioned c = hdt::condition(run, small_arm(4), {});
    ck_assert(c.present[0] && !c.present[1] && c.present[2] && !c.present[3]);
    ck_assert_int_eq(c.valid.col(1).count() + c.valid.col(3).count(), 0);
    ck_assert_int_gt(c.valid.col(2).count(), 2000);
    ck_assert(c.v.col(0) == c.v.col(2));
    ck_assert(c.blocks(1).empty());
    ck_assert_int_eq(c.block_mean(1, c.t_s).size(), 0);
}
END_TEST

START_TEST(test_a_run_that_does_not_fit_is_refused_by_name)
{
    hdt_arm arm = small_arm(1);
    Run good = make_run(5, 700, 0, 31), run = good;
    ck_assert(refusal(good, arm).empty());

    run.joint.resize(2);
    ck_assert(says(refusal(run, arm), "made.csv: expected at most 1 joints"));
    run = good;
    for (double &q : run.joint[0].q_rad)
        q *= 180 / M_PI;
    ck_assert(says(refusal(run, arm), "degrees"));
    run = good;
    run.t_s[100] = run.t_s[99];
    ck_assert(says(refusal(run, arm), "row 101: expected time to advance"));
    run = good;
    run.joint[0].tau_nm[7] = std::nan("");
    ck_assert(says(refusal(run, arm), "joint 1, row 8"));
    run = good;
    run.joint[0].present = false;
    ck_assert(says(refusal(run, arm), "found none"));
    run = make_run(5, 700, 0, 31);
    run.joint[0].q_rad.pop_back();
    ck_assert(says(refusal(run, arm), "shorter than time"));
    ck_assert(says(refusal(make_run(0.05, 700, 0, 1), arm), "at least 50 rows, found 3"));
    ck_assert(says(refusal(make_run(30, 10, 0, 1), arm), "sampling rate of at least 20 Hz"));
    hdt::ConditionOptions o;
    o.block_s = 0;
    ck_assert(says(refusal(good, arm, o), "block length"));
}
END_TEST

START_TEST(test_declared_terms_are_the_declared_model_row_by_row)
{
    hdt_arm arm = small_arm(2);
    for (int j = 0; j < 2; j++) {
        arm.joint[j].has_friction = 1;
        arm.joint[j].friction[0] = {10, 3, 1, 0.1};
        arm.joint[j].friction[1] = {11, 2, 1, 0.1};
    }
    Run run = make_run(3, 700, 0, 33);
    Conditioned c = hdt::condition(run, arm, {});
    std::vector<Eigen::MatrixXd> terms = hdt::declared_terms(arm, c);
    ck_assert_uint_eq(terms.size(), 2);
    ck_assert_int_eq(terms[0].rows(), c.t_s.size());
    double largest = 0;
    for (Eigen::Index i = 0; i < c.t_s.size(); i++) {
        std::vector<hdt::TermTorque> direct = hdt::arm_terms(arm, c.sample(i));
        for (std::size_t k = 0; k < HDT_TERMS; k++) {
            ck_assert(terms[0](i, static_cast<Eigen::Index>(k)) == direct[0][k]);
            largest = std::max(largest, std::fabs(direct[0][k]));
        }
    }
    ck_assert_double_gt(largest, 10);
}
END_TEST

// By the PA-10's file: joint 2 carries what joints 3 and 4 move; the wrist is 1.7 kg close to its axes, under
// a hundredth of that load until it holds something; joint 7's link has its centre on its axis; joint 1
// stands upright and neither carries nor turns anything against gravity.
START_TEST(test_angles_a_load_rests_on_and_the_run_does_not_have_are_named)
{
    const hdt::ArmFile file = hdt::ArmFile::load("model/arms/pa10.toml");
    Run one = make_run(4, 200, 0, 9), run = one;
    run.joint.assign(7, one.joint[0]);
    for (const auto &unknown : hdt::condition(run, file.arm(), {}).unknown_angles)
        ck_assert(unknown.empty());
    run.joint[0].present = run.joint[6].present = false;
    for (const auto &unknown : hdt::condition(run, file.arm(), {}).unknown_angles)
        ck_assert(unknown.empty());
    for (Run::Joint &j : run.joint)
        j.present = false;
    run.joint[1].present = true;
    Conditioned c = hdt::condition(run, file.arm(), {});
    ck_assert(c.unknown_angles[1] == std::vector<int>({3, 4}));
    ck_assert(c.unknown_angles[3].empty()); // not in the run
    const std::string words = hdt::unknown_angle_words(2, {{}, c.unknown_angles[1], {3}});
    ck_assert(hdt::unknown_angle_words(2, {{}, {}}).empty());
    for (const char *part : {"joint 2: 2 of 3 runs", "joint 3, 4, on", "0 rad", "q4_rad"})
        ck_assert_msg(words.find(part) != std::string::npos, "%s in %s", part, words.c_str());
    // off the axis, the hand's angle counts too
    run.constants["payload_kg"] = "3";
    run.constants["payload_com_m"] = "0.15 0 0.05";
    c = hdt::condition(run, file.arm(), {});
    ck_assert(c.unknown_angles[1] == std::vector<int>({3, 4, 5, 6, 7}));
    // joint 4 alone: 2 and 3 turn its load against gravity
    run.constants.clear();
    run.joint[1].present = false;
    run.joint[3].present = true;
    c = hdt::condition(run, file.arm(), {});
    ck_assert(c.unknown_angles[3] == std::vector<int>({2, 3, 5, 6}));
}
END_TEST

static Suite *dataset_suite(void)
{
    Suite *s = suite_create("dataset");
    TCase *smooth = tcase_create("smoothing");
    tcase_add_loop_test(smooth, test_derivatives_follow_the_motion_without_lag, 0, 10);
    tcase_add_test(smooth, test_torque_and_position_are_never_changed);
    tcase_add_test(smooth, test_noisy_position_gets_a_wider_smoother);
    tcase_add_test(smooth, test_reference_acceleration_replaces_a_noisy_one_only);
    suite_add_tcase(s, smooth);
    TCase *masks = tcase_create("masks");
    tcase_add_test(masks, test_direction_is_right_wherever_it_is_used);
    tcase_add_test(masks, test_guard_masks_both_sides_of_a_reversal);
    tcase_add_test(masks, test_travel_is_the_distance_since_the_reversal);
    tcase_add_test(masks, test_spikes_are_masked_and_reversals_are_not);
    tcase_add_test(masks, test_quantised_constant_torque_is_no_spike);
    tcase_add_test(masks, test_gap_is_not_bridged);
    tcase_add_test(masks, test_saturated_rows_are_masked);
    tcase_add_test(masks, test_every_row_is_valid_or_counted_once);
    suite_add_tcase(s, masks);
    TCase *blocks = tcase_create("blocks");
    tcase_add_test(blocks, test_block_means_equal_a_second_computation);
    tcase_add_test(blocks, test_declared_payload_of_the_run_wins);
    tcase_add_test(blocks, test_absent_joint_is_wholly_masked);
    tcase_add_test(blocks, test_declared_terms_are_the_declared_model_row_by_row);
    tcase_add_test(blocks, test_angles_a_load_rests_on_and_the_run_does_not_have_are_named);
    tcase_add_test(blocks, test_a_run_that_does_not_fit_is_refused_by_name);
    suite_add_tcase(s, blocks);
    return s;
}
HDT_CHECK_MAIN(dataset_suite())
