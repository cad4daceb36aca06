// SPDX-License-Identifier: Apache-2.0
//
// Generated tables: as near to the model as the report says, refused by name where they cannot be,
// the same bytes on both ways into the core.
//
// Method: the shipped core steps the tables and every term is compared with the double-precision
// terms; numbers pushed beyond the fixed point one at a time; the C source compiled and loaded.
#include "model/tablegen.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <dlfcn.h>

#include "ctrl/hdt.h"
#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "model/terms.hpp"
#include "tests/check_main.h"
#include "tests/effects_arm.hpp"
#include "tests/scratch.hpp"

static hdt_arm load(const char *path)
{
    return hdt::ArmFile::load(path).arm();
}

static hdt_arm pa10()
{
    static const hdt_arm arm = load("model/arms/pa10.toml");
    return arm;
}

struct Made {
    std::unique_ptr<hdt_tables> tables = std::make_unique<hdt_tables>();
    hdt_gen_report report;
};

static Made make(const hdt_arm &arm)
{
    Made made;
    char err[300] = "";
    const int result = hdt_arm_tables(&arm, made.tables.get(), &made.report, err, sizeof err);
    ck_assert_msg(result == 0, "%s", err);
    return made;
}

static hdt_arm with_all_effects()
{
    hdt_arm arm = with_named_effects(pa10());
    for (int j = 0; j < arm.joints; j++) {
        hdt_arm_joint &joint = arm.joint[j];
        joint.torque_gain = 1.05;
        joint.windup_rad = 2e-3;
        joint.bumps = 1;
        joint.bump[0] = {2, 0.1, 0.2};
        joint.has_local = joint.has_table = joint.table_directed = 1;
        joint.table_axis = j % HDT_AXES;
        const double to[HDT_AXES] = {1, 40, 1, 2};
        joint.table.from = joint.table_axis == HDT_AXIS_PHASE ? 0 : 0.1;
        joint.table.to = to[joint.table_axis];
        for (int way = 0; way < 2; way++) {
            joint.local[way].from = -1;
            joint.local[way].to = 1.5;
        }
        for (int k = 0; k < HDT_ARM_CURVE_POINTS; k++) {
            joint.local[0].nm[k] = 1 + std::sin(0.3 * k);
            joint.local[1].nm[k] = 2 + std::sin(0.2 * k);
            joint.table.nm[k] = std::sin(2 * M_PI * k / 64);
        }
    }
    arm.payload_kg = 2;
    arm.payload_com_m[0] = 0.03;
    arm.payload_com_m[2] = 0.07;
    return arm;
}

// One period of the core at a random state, and the same sample in floating point.
static hdt::Sample random_step(const hdt_arm &arm, const hdt_tables &tables, uint64_t *seed,
                               hdt_out *out)
{
    const double counts_per_turn = 16384 * 50;
    hdt::Sample s{0, {}, {}, {}, {}, {}, {}};
    for (Eigen::VectorXd *x : {&s.q, &s.v, &s.a, &s.dir, &s.travel, &s.wound})
        *x = Eigen::VectorXd::Zero(arm.joints);
    hdt_in in = {};
    in.t_us = 1;
    in.mode = HDT_MODE_TORQUE;
    in.fresh = in.active = 0xffffu;
    for (int j = 0; j < arm.joints; j++) {
        in.count[j].raw = static_cast<int32_t>(
            std::lround(test_uniform(seed, arm.joint[j].q_min_rad, arm.joint[j].q_max_rad)
                        / (2 * M_PI) * counts_per_turn));
        in.v_ref[j].raw =
            static_cast<int32_t>(std::lround(std::ldexp(test_uniform(seed, -1, 1), 24)));
        in.a_ref[j].raw =
            static_cast<int32_t>(std::lround(std::ldexp(test_uniform(seed, -3, 3), 16)));
        s.q[j] = in.count[j].raw / counts_per_turn * 2 * M_PI;
        s.v[j] = std::ldexp(in.v_ref[j].raw, -24);
        s.a[j] = std::ldexp(in.a_ref[j].raw, -16);
        if (arm.joint[j].windup_rad > 0)
            s.wound[j] = std::max(-1.0, std::min(1.0, s.v[j] / 700 / arm.joint[j].windup_rad));
        s.dir[j] = std::max(-1.0, std::min(1.0, s.v[j] / hdt::TableDefaults::v_ramp_radps));
        in.q_ref[j].raw = static_cast<int32_t>(std::lround(std::ldexp(s.q[j], 24)));
    }
    hdt_t core;
    ck_assert_int_eq(hdt_init(&core, &tables), HDT_OK);
    ck_assert_int_eq(hdt_step(&core, &in, out), HDT_OK);
    return s;
}

START_TEST(test_the_core_computes_every_term_of_the_model)
{
    const hdt_arm arm = _i == 0 ? pa10() : with_all_effects();
    const Made made = make(arm);
    const hdt_gen_report &r = made.report;
    // N.m: what the report says, plus the core's own rounding of products
    double bound[HDT_TERMS];
    std::fill(bound, bound + HDT_TERMS, 1e-4);
    bound[HDT_TERM_GRAVITY] += r.term_nm[HDT_TERM_GRAVITY];
    bound[HDT_TERM_INERTIA] += r.term_nm[HDT_TERM_INERTIA];
    bound[HDT_TERM_FRICTION] += r.term_nm[HDT_TERM_FRICTION];
    bound[HDT_TERM_RIPPLE] += r.term_nm[HDT_TERM_RIPPLE];
    bound[HDT_TERM_LINES] += r.term_nm[HDT_TERM_LINES];
    bound[HDT_TERM_LOCAL] += r.term_nm[HDT_TERM_LOCAL];
    bound[HDT_TERM_TABLE] += r.term_nm[HDT_TERM_TABLE];
    // the load comes with the error of gravity and of a spring's rate and angle
    double steepest = 0;
    for (const hdt_arm_joint &j : arm.joint)
        for (const hdt_arm_stiffness &way : j.stiffness)
            for (double slope : way.slope)
                steepest = std::max(steepest, std::fabs(slope));
    bound[HDT_TERM_STIFFNESS] += steepest * (r.term_nm[HDT_TERM_GRAVITY] + 4e-5);
    uint64_t seed = 21;
    double seen[HDT_TERMS] = {};
    for (int round = 0; round < 1000; round++) {
        hdt_out out;
        const hdt::Sample s = random_step(arm, *made.tables, &seed, &out);
        const std::vector<hdt::TermTorque> terms = hdt::arm_terms(arm, s);
        for (int j = 0; j < arm.joints; j++)
            for (int t = 0; t < HDT_TERM_P; t++) {
                const double expected =
                    terms[static_cast<std::size_t>(j)][static_cast<std::size_t>(t)];
                const double found = std::ldexp(out.term[t][j].raw, -16);
                ck_assert_msg(std::fabs(found - expected) <= bound[t],
                              "joint %d %s: core %.6f, model %.6f N.m", j + 1, hdt_term_str(t),
                              found, expected);
                seen[t] = std::max(seen[t], std::fabs(expected));
            }
    }
    for (int t = 0; t < HDT_TERM_P; t++)
        ck_assert_msg(seen[t] > 0.1 || (_i == 0 && t >= HDT_TERM_LINES), "%s was never there",
                      hdt_term_str(t));
}
END_TEST

START_TEST(test_worst_errors_of_the_pa10_stay_under_a_digit)
{
    // a digit is 0.001 N.m motor side, 0.05 N.m at the joint
    const hdt_gen_report report = make(pa10()).report;
    ck_assert_double_lt(report.term_nm[HDT_TERM_FRICTION], 0.0125);
    ck_assert_double_lt(report.term_nm[HDT_TERM_RIPPLE], 0.025);
    ck_assert_double_lt(report.term_nm[HDT_TERM_GRAVITY], 1e-5);
    ck_assert_double_eq(report.term_nm[HDT_TERM_LINES], 0);
    // and they are measured: no table is exact
    ck_assert_double_gt(report.term_nm[HDT_TERM_FRICTION], 1e-4);
    ck_assert_double_gt(report.term_nm[HDT_TERM_RIPPLE], 1e-3);
    ck_assert_double_gt(report.term_nm[HDT_TERM_GRAVITY], 1e-9);
    const hdt_gen_report lines = make(with_all_effects()).report;
    ck_assert_double_gt(lines.term_nm[HDT_TERM_LINES], 0);
    ck_assert_double_lt(lines.term_nm[HDT_TERM_LINES], 1e-4);
    // an amplitude without rounding still has that of the phase: 2^-32 of a turn
    hdt_arm exact = pa10();
    exact.joint[1].lines = 1;
    exact.joint[1].line[0] = {100, 0.5, 0.2, 1};
    ck_assert_double_ge(make(exact).report.term_nm[HDT_TERM_LINES], 0.5 * 2 * M_PI * std::ldexp(1, -32));
}
END_TEST

START_TEST(test_worst_errors_are_those_of_the_numbers_that_were_rounded)
{
    const double off = std::ldexp(1, -18); // a quarter of the last place of q16
    hdt_arm arm = pa10();
    hdt_arm_joint &j = arm.joint[1];
    j.torque_offset_nm = 3 + off;
    j.spring_nmprad = 10 + off;
    j.load_mu = 0.25 + off / 256;
    j.cold_coulomb_nm = 2 + off;
    j.warm_s = 600;
    j.presliding_nm = 2 + off;
    j.presliding_rad = 1 / 256.0;
    j.kp_m_nmprad = (1000 + off) / j.ratio;
    j.kd_m_nmspr = (10 + off) / j.ratio;
    for (hdt_arm_joint &other : arm.joint)
        for (hdt_arm_stiffness &way : other.stiffness)
            way = {{0, 0, 0}, -32, 32, 1 + off};
    const hdt_gen_report &r = make(arm).report;
    const double reach_rad = std::max(-j.q_min_rad, j.q_max_rad);
    uint64_t seed = 5;
    double load_nm = 0; // most of it, gravity and the spring
    for (int pose = 0; pose < 5000; pose++) {
        Eigen::VectorXd q(arm.joints);
        for (int i = 0; i < arm.joints; i++)
            q[i] = test_uniform(&seed, arm.joint[i].q_min_rad, arm.joint[i].q_max_rad);
        load_nm = std::max(load_nm, std::fabs(hdt::rbd::gravity(arm, q)[1] + hdt::spring_nm(j, q[1])));
    }
    const struct { int term; double at_most_nm; } expected[] = {
        {HDT_TERM_OFFSET, off},
        {HDT_TERM_SPRING, off * reach_rad},
        {HDT_TERM_LOAD, off / 256 * load_nm},
        {HDT_TERM_TEMPERATURE, off},
        {HDT_TERM_PRESLIDING, off},
        {HDT_TERM_STIFFNESS, off},
        {HDT_TERM_P, off * hdt::TableDefaults::follow_rad},
        {HDT_TERM_D, off * 2 * j.v_max_radps},
    };
    for (const auto &e : expected)
        ck_assert_msg(r.term_nm[e.term] <= e.at_most_nm * 1.01 && r.term_nm[e.term] >= e.at_most_nm * 0.9,
                      "%s: %g N.m, expected up to %g", hdt_term_str(e.term), r.term_nm[e.term], e.at_most_nm);
    // of the chain: 500 poses and motions up to 128 rad/s^2
    ck_assert_double_gt(r.term_nm[HDT_TERM_INERTIA], 1e-6);
    ck_assert_double_lt(r.term_nm[HDT_TERM_INERTIA], 1e-3);
}
END_TEST

START_TEST(test_worst_error_of_a_curve_counts_its_end_between_two_knots)
{
    // steep up to its end, held from there; the knots lie 1/64 N.m apart
    hdt_arm arm = pa10();
    hdt_arm_joint &j = arm.joint[1];
    j.has_table = 1;
    j.table_axis = HDT_AXIS_LOAD;
    j.table.from = 0;
    j.table.to = 2.0 + 0.5 / 64;
    for (int k = 0; k < HDT_ARM_CURVE_POINTS; k++)
        j.table.nm[k] = k;
    const Made made = make(arm);
    const double slope = 64 / j.table.to, knot = std::ldexp(1, int(made.tables->joint[1].table.shift) - 16);
    const double part = std::fmod(j.table.to, knot); // of the last interval
    // the later knot holds the end's value: at the end the chord has come part of the way
    const double missing = slope * part * (1 - part / knot);
    ck_assert_double_gt(missing, 0.05);
    ck_assert_double_eq_tol(made.report.term_nm[HDT_TERM_TABLE], missing, 1 / 256.0);
}
END_TEST

START_TEST(test_friction_holds_up_to_the_joint_speed_and_beyond_validity)
{
    // the core's curve between and beyond the knots against eq. (7), in plain arithmetic
    const hdt_arm arm = pa10();
    const Made made = make(arm);
    for (int j = 0; j < arm.joints; j++) {
        const hdt_joint_tab &tab = made.tables->joint[j];
        const double span = std::max(arm.joint[j].v_max_radps, 0.6),
                     step = std::ldexp(1, int(tab.friction_shift) - 24);
        for (int way = 0; way < 2; way++)
            for (double v = 0; v <= span; v += 0.00037) {
                const int k = std::min(static_cast<int>(v / step), 127);
                const double lower = tab.friction_q16[way][k] / 65536.0,
                             upper = tab.friction_q16[way][k + 1] / 65536.0;
                ck_assert_double_eq_tol(lower + (upper - lower) * (v / step - k),
                                        hdt::stribeck_nm(arm.joint[j].friction[way], v),
                                        made.report.term_nm[HDT_TERM_FRICTION] + 1e-9);
            }
    }
}
END_TEST

START_TEST(test_scaling_and_limits_are_those_of_the_model)
{
    const hdt_arm arm = with_all_effects();
    const Made made = make(arm);
    const hdt_tables &t = *made.tables;
    ck_assert_uint_eq(t.period_ns, 1428571);
    ck_assert_double_eq(t.rate_q16 / 65536.0, 700);
    ck_assert_uint_eq(t.stale_periods, 20);
    ck_assert_str_eq(t.name, "pa10");
    ck_assert(std::memcmp(t.digest, arm.digest, 32) == 0);
    static const double torque[] = {4.64, 4.64, 2, 2, 0.29, 0.29, 0.29};
    for (int j = 0; j < arm.joints; j++) {
        const hdt_joint_tab &tab = t.joint[j];
        ck_assert_int_eq(tab.zero_cnt, 0);
        ck_assert_int_eq(tab.dig_max, static_cast<int32_t>(std::lround(torque[j] * 1000)));
        // full torque within 50 ms, 35 periods, and not a period sooner than needed
        ck_assert_int_ge(tab.dig_slew * 35, tab.dig_max);
        ck_assert_int_lt((tab.dig_slew - 1) * 35, tab.dig_max);
        ck_assert_double_eq_tol(tab.digit_per_nm_q24 / 16777216.0, 1000 / (50 * 1.05), 1e-6);
        ck_assert_double_eq_tol(tab.kp_q16 / 65536.0, 50 * arm.joint[j].kp_m_nmprad, 1e-5);
        ck_assert_double_eq_tol(tab.kd_q16 / 65536.0, 50 * arm.joint[j].kd_m_nmspr, 1e-5);
        ck_assert_double_eq_tol(std::ldexp(tab.rad_per_count_q44, -44) * 16384 * 50, 2 * M_PI,
                                1e-7);
        ck_assert_double_eq_tol(std::ldexp(double(tab.phase_per_count_q24), -56) * 16384 * 50, 1,
                                1e-10);
        ck_assert_double_eq_tol(tab.q_max_q24 / 16777216.0, arm.joint[j].q_max_rad, 1e-7);
        ck_assert_double_eq_tol(tab.v_max_q24 / 16777216.0, 1.2 * arm.joint[j].v_max_radps, 1e-7);
        ck_assert_double_eq_tol(tab.follow_max_q24 / 16777216.0, 0.5, 1e-7);
        ck_assert_int_eq(tab.spd_max,
                         static_cast<int32_t>(std::floor(arm.joint[j].v_max_radps * 5000 + 1e-6)));
        ck_assert_double_eq_tol(tab.rotor_q20 / 1048576.0,
                                hdt::reflected_inertia_kgm2(arm.joint[j]), 1e-6);
    }
}
END_TEST

START_TEST(test_awkward_but_possible_numbers_are_taken)
{
    hdt_arm arm = with_all_effects();
    hdt_arm_joint &joint = arm.joint[1];
    joint.v_max_radps = 20;             // more than a speed word can say
    joint.friction_v_min_radps = 0.004; // finer than the usual ramp
    joint.warm_s = 1e15;                // never warms up
    joint.line[0].phase_rad = -1e-12;   // a whole turn after rounding
    joint.friction_v_max_radps = 30;
    const Made made = make(arm);
    const hdt_joint_tab &tab = made.tables->joint[1];
    ck_assert_int_eq(tab.spd_max, 32767);
    ck_assert_double_eq_tol(tab.v_ramp_inv_q16 / 65536.0, 1 / 0.002, 1e-4);
    ck_assert_int_eq(tab.cold_decay_q31, INT32_MAX);
    ck_assert_uint_eq(tab.line[0].phase0, 0);
    ck_assert_double_lt(made.report.term_nm[HDT_TERM_FRICTION], 0.1); // over 45 rad/s
    // joints whose friction is not known ramp as the others
    arm.joint[1].has_friction = 0;
    ck_assert_double_eq_tol(make(arm).tables->joint[1].v_ramp_inv_q16 / 65536.0, 100, 1e-4);
}
END_TEST

START_TEST(test_only_terms_the_model_uses_are_on)
{
    hdt_arm arm = pa10();
    const uint32_t all = make(arm).tables->joint[1].terms;
    ck_assert_uint_eq(all, 1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_INERTIA | 1u << HDT_TERM_FRICTION
                               | 1u << HDT_TERM_RIPPLE | 1u << HDT_TERM_STIFFNESS | 1u << HDT_TERM_P
                               | 1u << HDT_TERM_D);
    ck_assert_uint_eq(make(with_all_effects()).tables->joint[1].terms, (1u << HDT_TERMS) - 1);
    for (int j = 0; j < arm.joints; j++) {
        hdt_arm_joint &joint = arm.joint[j];
        joint.has_inertial = joint.has_friction = joint.has_stiffness = joint.ripples = 0;
        joint.kp_m_nmprad = joint.kd_m_nmspr = joint.rotor_kgm2_m = joint.wave_generator_kgm2_m = 0;
    }
    const Made bare = make(arm);
    for (int j = 0; j < arm.joints; j++)
        ck_assert_uint_eq(bare.tables->joint[j].terms, 0);
    // first moments without mass, as identified, still weigh on every joint before them
    arm.joint[5].has_inertial = 1;
    arm.joint[5].mass_kg = 0;
    const Made moment = make(arm);
    ck_assert_uint_eq(moment.tables->joint[2].terms,
                      1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_INERTIA);
    ck_assert_uint_eq(moment.tables->joint[6].terms, 0);
}
END_TEST

START_TEST(test_payload_is_a_heavier_last_link)
{
    hdt_arm with_payload = pa10(), with_link = pa10();
    const double m = 3.2, at[3] = {0.03, -0.02, 0.09};
    with_payload.flange_m[2] = 0.05;
    with_payload.payload_kg = m;
    for (int i = 0; i < 3; i++)
        with_payload.payload_com_m[i] = at[i] - with_payload.flange_m[i];
    hdt_arm_joint &link = with_link.joint[6];
    link.mass_kg += m;
    for (int i = 0; i < 3; i++)
        link.moment_kgm[i] += m * at[i];
    const double square = at[0] * at[0] + at[1] * at[1] + at[2] * at[2];
    static const int row[6] = {0, 0, 0, 1, 1, 2}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int i = 0; i < 6; i++)
        link.inertia_kgm2[i] +=
            m * ((row[i] == column[i] ? square : 0) - at[row[i]] * at[column[i]]);
    const Made a = make(with_payload), b = make(with_link);
    for (int j = 0; j < 7; j++) {
        const hdt_joint_tab &one = a.tables->joint[j], &other = b.tables->joint[j];
        for (int i = 0; i < 2; i++)
            ck_assert_int_le(std::abs(one.moment_q20[i] - other.moment_q20[i]), 1);
        for (int i = 0; i < 5; i++)
            ck_assert_int_le(std::abs(one.second_q20[i] - other.second_q20[i]), 1);
    }
    // and it is there: what lies off the last axis, and what is booked onto links before
    const Made without = make(pa10());
    ck_assert_int_ne(a.tables->joint[6].moment_q20[0], without.tables->joint[6].moment_q20[0]);
    ck_assert_int_ne(a.tables->joint[1].moment_q20[0] + a.tables->joint[1].moment_q20[1],
                     without.tables->joint[1].moment_q20[0] + without.tables->joint[1].moment_q20[1]);
}
END_TEST

// ---- velocity filter ----

static double gain_at(const int32_t b[5], double hz, double rate_hz)
{
    const std::complex<double> z = std::exp(std::complex<double>(0, -2 * M_PI * hz / rate_hz));
    const double one = std::ldexp(1, 28);
    return std::abs((b[0] / one + b[1] / one * z + b[2] / one * z * z)
                    / (1.0 + b[3] / one * z + b[4] / one * z * z));
}

START_TEST(test_velocity_filter_is_a_second_order_butterworth)
{
    static const double corners[][2] = {{700, 200}, {700, 20}, {1000, 40}, {1504, 700}, {8000, 30}};
    const double rate = corners[_i][0], cutoff = corners[_i][1];
    hdt_arm arm = pa10();
    arm.control_rate_hz = rate;
    arm.velocity_cutoff_hz = cutoff;
    const Made made = make(arm);
    const int32_t *b = made.tables->biquad_q28;
    // constant speed passes exactly, half the rate not at all, the corner at -3 dB
    ck_assert_int_eq(int64_t(b[0]) + b[1] + b[2], (int64_t(1) << 28) + b[3] + b[4]);
    ck_assert_double_eq_tol(gain_at(b, rate / 2, rate), 0, 1e-6);
    ck_assert_double_eq_tol(gain_at(b, cutoff, rate), std::sqrt(0.5), 2e-5);
    // squared gain 1 / (1 + (tan w / tan wc)^4) everywhere
    for (double hz = rate / 50; hz < rate / 2; hz += rate / 50) {
        const double ratio = std::tan(M_PI * hz / rate) / std::tan(M_PI * cutoff / rate);
        ck_assert_double_eq_tol(gain_at(b, hz, rate), 1 / std::sqrt(1 + std::pow(ratio, 4)), 2e-5);
    }
    // poles inside the unit circle and, the bilinear transform undone, at 45 degrees in the left
    // half plane
    const double one = std::ldexp(1, 28), a1 = b[3] / one, a2 = b[4] / one;
    const std::complex<double> pole =
        (-a1 + std::sqrt(std::complex<double>(a1 * a1 - 4 * a2))) / 2.0;
    const std::complex<double> analog =
        (pole - 1.0) / (pole + 1.0) / std::tan(M_PI * cutoff / rate);
    ck_assert_double_lt(std::abs(pole), 1);
    ck_assert_double_eq_tol(analog.real(), -std::sqrt(0.5), 1e-4);
    ck_assert_double_eq_tol(std::fabs(analog.imag()), std::sqrt(0.5), 1e-4);
}
END_TEST

// ---- refusals ----

struct Refused {
    void (*spoil)(hdt_arm *);
    const char *says;
};

static const Refused refused_table[] = {
    {[](hdt_arm *a) { a->joints = 0; }, "joint: expected 1 to 16 joints for the tables, found 0"},
    {[](hdt_arm *a) { a->joints = 17; }, "joint: expected 1 to 16 joints for the tables, found 17"},
    {[](hdt_arm *a) { std::memset(a->name, 'x', 40); },
     "name: expected at most 31 characters for the tables, found 40"},
    {[](hdt_arm *a) { a->control_rate_hz = 0; },
     "control.rate: expected a quantity for the tables, found nothing"},
    {[](hdt_arm *a) { a->control_rate_hz = 1e6; },
     "control.rate: expected a number from 1 to 20000"},
    {[](hdt_arm *a) { a->velocity_cutoff_hz = 0.1; },
     "control.velocity_cutoff: expected at least a 2000th"},
    {[](hdt_arm *a) { a->gravity_mps2[2] = 200; },
     "base.gravity: expected a number from -128 to 128 for the tables, found 200"},
    {[](hdt_arm *a) { a->joint[1].friction[1].f0_nm = 20000; },
     "joint.2.friction.negative: expected a number from -16383 to 16383 for the tables, found "
     "20000"},
    {[](hdt_arm *a) { a->joint[1].ripple[0].amplitude_nm = 200; },
     "joint.2.ripple amplitudes together: expected a number from -127.99609 to 127.99609"},
    {[](hdt_arm *a) { a->joint[1].ripple[1].order_rev = 50 * 129; },
     "joint.2.ripple.2.wave_generator_order: expected at most 128 for the tables, found 129"},
    {[](hdt_arm *a) { a->joint[1].ripple[1].order_rev = 51; },
     "joint.2.ripple.2.wave_generator_order: expected a whole number for the tables, found 1.02"},
    {[](hdt_arm *a) { a->joint[1].stiffness[0].slope[1] = 130; },
     "joint.2.stiffness.positive.slope: expected a number from -128 to 128 for the tables, found "
     "130"},
    {[](hdt_arm *a) { a->joint[1].stiffness[1].t2_nm = 4e4; },
     "joint.2.stiffness.negative.t2: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].stiffness[1].zero_nm = NAN; },
     "joint.2.stiffness.negative.zero: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].ratio = 7; },
     "joint.2.gear.ratio (times torque gain): expected at least 7.8125"},
    {[](hdt_arm *a) { a->joint[1].ratio = 20000; },
     "joint.2.gear.ratio: expected a number from 2 to 10000"},
    {[](hdt_arm *a) { a->joint[1].kp_m_nmprad = 700; },
     "joint.2.feedback.kp (times ratio): expected a number from 0 to 16384"},
    {[](hdt_arm *a) { a->joint[1].kd_m_nmspr = INFINITY; },
     "joint.2.feedback.kd (times ratio): expected a number"},
    {[](hdt_arm *a) { a->joint[1].tau_max_m_nm = 0; },
     "joint.2.motor.torque_max: expected a quantity for the tables' torque limit, found nothing"},
    {[](hdt_arm *a) { a->joint[1].tau_max_m_nm = 33; },
     "joint.2.motor.torque_max (a digit is 0.001): expected a number from 0.001 to 32.767 for the "
     "tables, found 33"},
    {[](hdt_arm *a) { a->joint[1].v_max_radps = 110; },
     "joint.2.limits.speed (times 1.2): expected a number from -128 to 128"},
    {[](hdt_arm *a) { a->joint[1].v_max_radps = 40; },
     "joint.5.limits.speed: expected joint speeds"},
    {[](hdt_arm *a) {
         a->joint[1].moment_kgm[0] = 490;
         a->joint[2].moment_kgm[0] = 490;
         a->joint[3].moment_kgm[0] = 100;
     },
     "joint.4.link.com: expected a holding torque below 16384 N.m"},
    {[](hdt_arm *a) { a->joint[1].moment_kgm[0] = 600; },
     "joint.2.link.com: expected a holding torque below 16384 N.m"},
    {[](hdt_arm *a) { a->joint[6].inertia_kgm2[0] = 2000; },
     "joint.6.link.inertia: expected forces"},
    {[](hdt_arm *a) {
         a->joint[1].spring_nmprad = 10;
         a->joint[1].stiffness[0].slope[1] = 100;
     },
     "joint.2.stiffness: expected lines below 32767 N.m"},
    {[](hdt_arm *a) { a->joint[1].q_max_rad = 130; },
     "joint.2.limits.position: expected a number from -128 to 128"},
    {[](hdt_arm *a) { a->joint[1].mass_kg = 3000; }, "joint.2.link.mass: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].moment_kgm[1] = 3000; },
     "joint.2.link.com: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].inertia_kgm2[5] = NAN; },
     "joint.2.link.inertia: expected a number from"},
    {[](hdt_arm *a) { a->payload_kg = 3000; },
     "joint.7.link with payload.mass: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].origin_m[0] = 200; },
     "joint.2.origin: expected a number from -128 to 128"},
    {[](hdt_arm *a) { a->joint[1].rotor_kgm2_m = 1; },
     "joint.2.motor.rotor_inertia (reflected): expected a number from 0"},
    {[](hdt_arm *a) { a->joint[1].extra_inertia_kgm2 = -2; },
     "joint.2.motor.rotor_inertia (reflected): expected a number from 0"},
    {[](hdt_arm *a) { a->joint[1].load_mu = 200; },
     "joint.2.effect (load_friction).mu: expected a number from"},
    {[](hdt_arm *a) {
         a->joint[1].warm_s = 1;
         a->joint[1].cold_viscous_nmspr = 1e5;
     },
     "joint.2.effect (temperature).viscous: expected a number from"},
    {[](hdt_arm *a) {
         a->joint[1].presliding_nm = 1;
         a->joint[1].presliding_rad = 1e-9;
     },
     "joint.2.effect (presliding).travel (1 over it): expected a number from"},
    {[](hdt_arm *a) { a->joint[1].spring_nmprad = 1e6; },
     "joint.2.effect (cable_spring).stiffness: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].spring_q0_rad = 500; },
     "joint.2.effect (cable_spring).rest: expected a number from"},
    {[](hdt_arm *a) { a->joint[1].torque_offset_nm = -4e4; },
     "joint.2.effect (torque_offset).torque: expected a number from"},
    {[](hdt_arm *a) {
         a->joint[1].lines = 1;
         a->joint[1].line[0] = {3e5, 1, 0, 0};
     },
     "joint.2.effect (order_line 1).order: expected above 0 and below 204800 for the tables, found "
     "300000"},
    {[](hdt_arm *a) {
         a->joint[1].lines = 1;
         a->joint[1].line[0] = {3, 1e9, 0, 0};
     },
     "joint.2.effect (order_line 1).amplitude: expected a number from"},
};

START_TEST(test_what_does_not_fit_is_refused_by_name)
{
    const Refused &r = refused_table[_i];
    auto arm = std::make_unique<hdt_arm>(pa10());
    auto tables = std::make_unique<hdt_tables>();
    char err[400] = "";
    r.spoil(arm.get());
    ck_assert_int_eq(hdt_arm_tables(arm.get(), tables.get(), nullptr, err, sizeof err), -1);
    const std::string expected = std::string("model/arms/pa10.toml: ") + r.says;
    ck_assert_msg(std::strncmp(err, expected.c_str(), expected.size()) == 0,
                  "expected %s\n found %s", expected.c_str(), err);
    // nothing half made stays behind
    const auto zero = std::make_unique<hdt_tables>();
    ck_assert(std::memcmp(tables.get(), zero.get(), sizeof *zero) == 0);
    ck_assert_int_eq(hdt_arm_tables(arm.get(), tables.get(), nullptr, nullptr, 0), -1);
}
END_TEST

// ---- two ways into the core ----

START_TEST(test_same_model_same_bytes)
{
    const Made a = make(with_all_effects()), b = make(with_all_effects());
    ck_assert(std::memcmp(a.tables.get(), b.tables.get(), sizeof *a.tables) == 0);
    ck_assert(hdt::tables_c_source(*a.tables, "x") == hdt::tables_c_source(*b.tables, "x"));
    ck_assert(hdt::tables_c_source(*a.tables, "x").find("hdt_tables_x = {") != std::string::npos);
    ck_assert(hdt::tables_c_source(*a.tables, "x-1 y").find("hdt_tables_x_1_y = {")
              != std::string::npos);
}
END_TEST

START_TEST(test_c_source_compiles_to_the_bytes_of_the_image)
{
    const char *paths[] = {"model/arms/pa10.toml", "model/arms/pa10-paper.toml", nullptr};
    hdt_arm arm = paths[_i] ? load(paths[_i]) : with_all_effects();
    if (!paths[_i]) {
        // the awkward numbers: negative, and the longest fractions of a turn
        arm.joint[2].torque_offset_nm = -32767;
        arm.joint[3].line[0] = {204799, -3, -0.1, 1};
    }
    const Made made = make(arm);
    const std::string source = scratch("t.c"), library = scratch("t.so");
    std::ofstream(source) << hdt::tables_c_source(*made.tables, "it");
    const std::string compile =
        "cc -std=c99 -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror -I. -shared -fPIC -o "
        + library + " " + source;
    ck_assert_int_eq(system(compile.c_str()), 0);
    void *handle = dlopen(library.c_str(), RTLD_NOW);
    ck_assert_msg(handle != nullptr, "%s", dlerror());
    const auto *compiled = static_cast<const hdt_tables *>(dlsym(handle, "hdt_tables_it"));
    ck_assert_ptr_nonnull(compiled);

    std::vector<uint8_t> image(hdt_tables_size(made.tables->joints));
    ck_assert_uint_eq(hdt_tables_write(made.tables.get(), image.data(), image.size()),
                      image.size());
    const auto read = std::make_unique<hdt_tables>();
    ck_assert_int_eq(hdt_tables_read(image.data(), image.size(), read.get()), HDT_TABLES_OK);
    ck_assert(std::memcmp(compiled, read.get(), sizeof *read) == 0);
    ck_assert(std::memcmp(compiled, made.tables.get(), sizeof *read) == 0);
    ck_assert_int_eq(hdt_tables_check(compiled, nullptr, nullptr), HDT_TABLES_OK);
    dlclose(handle);
}
END_TEST

static int32_t word_at(const std::vector<uint8_t> &image, std::size_t at)
{
    return static_cast<int32_t>(image[at] | uint32_t(image[at + 1]) << 8
                                | uint32_t(image[at + 2]) << 16 | uint32_t(image[at + 3]) << 24);
}

START_TEST(test_image_is_laid_out_as_documented)
{
    // offsets of docs/formats.md, section Tables
    const Made made = make(with_all_effects());
    const hdt_tables &t = *made.tables;
    std::vector<uint8_t> image(hdt_tables_size(7));
    hdt_tables_write(&t, image.data(), image.size());
    ck_assert_uint_eq(image.size(), 136 + 4986 * 7 + 4);
    ck_assert(std::memcmp(image.data(), "HDTM\2\0\0\0", 8) == 0);
    ck_assert(std::memcmp(&image[8], t.digest, 32) == 0);
    ck_assert(std::memcmp(&image[40], "pa10\0", 5) == 0);
    ck_assert_int_eq(word_at(image, 72), 7);
    ck_assert_int_eq(word_at(image, 80), 700 << 16);
    ck_assert_int_eq(word_at(image, 116), t.biquad_q28[4]);
    ck_assert_int_eq(word_at(image, 120), static_cast<int32_t>(t.observer));
    ck_assert_int_eq(word_at(image, 132), t.observer_gain[2]);
    const std::size_t joint = 136 + 4986;
    const hdt_joint_tab &tab = t.joint[1];
    const std::pair<std::size_t, int32_t> words[] = {
        {0, static_cast<int32_t>(tab.terms)},
        {12, static_cast<int32_t>(tab.rad_per_count_q44)},
        {24, static_cast<int32_t>(tab.chain)},
        {28, static_cast<int32_t>(tab.phase0)},
        {32, tab.twist_cos_q30},
        {36, tab.twist_sin_q30},
        {40, tab.step_q24[0]},
        {48, tab.moment_q20[0]},
        {56, tab.second_q20[0]},
        {72, tab.second_q20[4]},
        {76, tab.rotor_q20},
        {80, tab.v_lim_q24},
        {84, tab.a_lim_q16},
        {88, tab.v_ramp_inv_q16},
        {92, static_cast<int32_t>(tab.friction_shift)},
        {96 + 4 * 129, tab.friction_q16[1][0]},
        {1124, tab.friction_q16[1][128]},
        {3176, tab.stiffness[0].t1_q16},
        {3208, tab.stiffness[1].t1_q16},
        {3236, tab.stiffness[1].slope_q24[2]},
        {3240, tab.windup_inv_q8},
        {3244, 2},
        {3256, tab.line[0].amplitude_q16},
        {3268 + 8, tab.line[1].amplitude_q16},
        {3328, tab.load_mu_q24},
        {3340, tab.cold_decay_q31},
        {3348, tab.presliding_inv_q8},
        {3360, tab.offset_q16},
        {3364, tab.kp_q16},
        {3372, tab.inertia_inv_q20},
        {3376, tab.nm_per_digit_q24},
        {3380, tab.digit_per_nm_q24},
        {3384, tab.dig_max},
        {3400, tab.q_max_q24},
        {3408, tab.follow_max_q24},
        {3412, tab.local[0].start},
        {3416 + 522, static_cast<int32_t>(tab.local[1].shift)},
        {3412 + 2 * 522, tab.table.start},
        {4978, static_cast<int32_t>(tab.axis)},
        {4982, static_cast<int32_t>(tab.directed)}};
    for (const auto &[at, value] : words)
        ck_assert_msg(word_at(image, joint + at) == value, "offset %zu: %d, not %d", at,
                      word_at(image, joint + at), value);
    ck_assert_int_eq(static_cast<int16_t>(image[joint + 3174] | image[joint + 3175] << 8),
                     tab.ripple_q8[1023]);
}
END_TEST

// ---- effects the diagnosis knows ----

// An arm file with one more effect on joint 2.
static std::string with_effect(const std::string &id, const std::string &numbers)
{
    std::ifstream in("model/arms/pa10.toml");
    const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    std::string out, line;
    int joint = 0;
    for (std::istringstream lines(text); std::getline(lines, line);) {
        if (line == "[[joint]]" && ++joint == 3)
            out += "[[joint.effect]]\nid = \"" + id + "\"\n" + numbers;
        out += line + "\n";
    }
    return out;
}

START_TEST(test_every_effect_of_the_diagnosis_has_a_term_or_is_refused_by_name)
{
    // numbers of those a joint's effect can hold; payload, link_mass and base_tilt change the arm itself
    static const std::map<std::string, std::pair<std::string, uint32_t>> held = {
        {"torque_gain", {"gain", 0}},
        {"torque_offset", {"torque", 1u << HDT_TERM_OFFSET}},
        {"load_friction", {"mu", 1u << HDT_TERM_LOAD}},
        {"temperature", {"coulomb viscous time_constant", 1u << HDT_TERM_TEMPERATURE}},
        {"presliding", {"torque travel", 1u << HDT_TERM_PRESLIDING}},
        {"cable_spring", {"stiffness rest", 1u << HDT_TERM_SPRING}},
        {"inertia", {"inertia", 0}},
        {"local_friction", {"torque at width", 1u << HDT_TERM_LOCAL}},
        {"order_line", {"order amplitude phase directed", 1u << HDT_TERM_LINES}},
    };
    static const char *const ids[] = {
        "payload", "link_mass", "base_tilt", "joint_offset", "cable_spring", "torque_gain",
        "torque_offset", "torque_saturation", "torque_delay", "load_friction", "drive_efficiency",
        "viscous_nonlinear", "stribeck_shape", "temperature", "presliding", "local_friction",
        "order_line", "ripple_load", "ripple_speed", "inertia", "coupling", "eccentricity",
        "external_vibration", "soft_windup"};
    static const std::map<std::string, std::string> unit = {
        {"gain", "1"}, {"torque", "N m"}, {"mu", "N m/N m"}, {"coulomb", "N m"},
        {"viscous", "N m s/rad"}, {"time_constant", "s"}, {"travel", "rad"}, {"stiffness", "N m/rad"},
        {"rest", "rad"}, {"inertia", "kg m^2"}, {"at", "rad"}, {"width", "rad"}, {"order", "1"},
        {"amplitude", "N m"}, {"phase", "rad"}};
    const std::string path = scratch_dir() + "/arm.toml";
    const uint32_t plain = make(pa10()).tables->joint[1].terms;
    int terms = 0;
    for (const char *id : ids) {
        const auto at = held.find(id);
        std::string numbers;
        if (at != held.end()) {
            std::istringstream names(at->second.first);
            for (std::string name; names >> name;)
                numbers += name == "directed"
                               ? "directed = true\n"
                               : name + " = { value = 0.5, unit = \"" + unit.at(name)
                                     + "\", confidence = \"low\", source = \"MHI\" }\n";
        }
        std::ofstream(path) << with_effect(id, numbers);
        auto arm = std::make_unique<hdt_arm>();
        char err[400] = "";
        const int result = hdt_arm_load(path.c_str(), arm.get(), err, sizeof err);
        if (at == held.end()) {
            ck_assert_msg(result == -1, "%s was taken in silence", id);
            ck_assert_msg(std::strstr(err, id) != nullptr, "%s is not named: %s", id, err);
            continue;
        }
        ck_assert_msg(result == 0, "%s: %s", id, err);
        const uint32_t now = make(*arm).tables->joint[1].terms;
        ck_assert_msg(now == (plain | at->second.second), "%s: terms %x", id, now);
        terms++;
    }
    ck_assert_int_eq(terms, 9);
}
END_TEST

static Suite *tablegen_suite(void)
{
    Suite *suite = suite_create("tablegen");
    TCase *numbers = tcase_create("numbers");
    tcase_add_loop_test(numbers, test_the_core_computes_every_term_of_the_model, 0, 2);
    tcase_add_test(numbers, test_worst_errors_of_the_pa10_stay_under_a_digit);
    tcase_add_test(numbers, test_worst_errors_are_those_of_the_numbers_that_were_rounded);
    tcase_add_test(numbers, test_worst_error_of_a_curve_counts_its_end_between_two_knots);
    tcase_add_test(numbers, test_friction_holds_up_to_the_joint_speed_and_beyond_validity);
    tcase_add_test(numbers, test_scaling_and_limits_are_those_of_the_model);
    tcase_add_test(numbers, test_awkward_but_possible_numbers_are_taken);
    tcase_add_test(numbers, test_only_terms_the_model_uses_are_on);
    tcase_add_test(numbers, test_payload_is_a_heavier_last_link);
    tcase_add_loop_test(numbers, test_velocity_filter_is_a_second_order_butterworth, 0, 5);
    tcase_set_timeout(numbers, 60);
    suite_add_tcase(suite, numbers);
    TCase *refusals = tcase_create("refusals");
    tcase_add_loop_test(refusals, test_what_does_not_fit_is_refused_by_name, 0,
                        static_cast<int>(sizeof refused_table / sizeof *refused_table));
    suite_add_tcase(suite, refusals);
    tcase_add_test(refusals, test_every_effect_of_the_diagnosis_has_a_term_or_is_refused_by_name);
    TCase *ways = tcase_create("ways");
    tcase_add_test(ways, test_same_model_same_bytes);
    tcase_add_test(ways, test_image_is_laid_out_as_documented);
    tcase_add_loop_test(ways, test_c_source_compiles_to_the_bytes_of_the_image, 0, 3);
    tcase_set_timeout(ways, 60);
    suite_add_tcase(suite, ways);
    return suite;
}

HDT_CHECK_MAIN(tablegen_suite())
