// SPDX-License-Identifier: Apache-2.0
//
// The declared model in floating point: friction opposes motion, wind-up is continuous, every
// effect is a term of its own and absent when neutral.
//
// Method: physics and symmetry on random arms; a second implementation where a formula has a choice
// (wind-up by integrating its slope); printed values of the paper.
#include "model/terms.hpp"

#include <cmath>
#include <cstring>
#include <vector>

#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "tests/check_main.h"
#include "tests/effects_arm.hpp"

static const double anywhere = 1e-12; // N.m, rounding of a few additions of 100 N.m

static hdt_arm pa10()
{
    static const hdt_arm arm = hdt::ArmFile::load("model/arms/pa10.toml").arm();
    return arm;
}

static hdt::Sample random_sample(const hdt_arm &arm, uint64_t *seed)
{
    hdt::Sample s{test_uniform(seed, 0, 2000), {}, {}, {}, {}, {}};
    for (Eigen::VectorXd *x : {&s.q, &s.v, &s.a, &s.dir, &s.travel})
        x->resize(arm.joints);
    for (int j = 0; j < arm.joints; j++) {
        s.q[j] = test_uniform(seed, arm.joint[j].q_min_rad, arm.joint[j].q_max_rad);
        s.v[j] = test_uniform(seed, -1, 1);
        s.a[j] = test_uniform(seed, -3, 3);
        s.dir[j] = s.v[j] > 0 ? 1 : -1;
        s.travel[j] = test_uniform(seed, 0, 0.01);
    }
    return s;
}

START_TEST(test_stribeck_starts_at_f0_and_ends_on_its_line)
{
    uint64_t seed = 1;
    for (int round = 0; round < 200; round++) {
        const hdt_arm_friction f = {test_uniform(&seed, 0, 50), test_uniform(&seed, 0, 50),
                                    test_uniform(&seed, -20, 20), test_uniform(&seed, 0.01, 0.5)};
        ck_assert_double_eq(hdt::stribeck_nm(f, 0), f.f0_nm);
        // one constant on, the bend has covered 1 - 1/e of itself; far out all of it
        ck_assert_double_eq_tol(hdt::stribeck_nm(f, f.vc_radps),
                                f.f0_nm + f.fv_nmspr * f.vc_radps + f.fs_nm * 0.6321205588285577,
                                anywhere);
        ck_assert_double_eq_tol(hdt::stribeck_nm(f, 60 * f.vc_radps),
                                f.f0_nm + f.fv_nmspr * 60 * f.vc_radps + f.fs_nm, 1e-10);
    }
}
END_TEST

START_TEST(test_friction_of_table_two_has_its_printed_size)
{
    // N.m at 0, .01, .1, .4 rad/s forward and 0, .1, .4 backward, from Table II by hand
    static const double table[7][7] = {{34.96, 35.34, 38.66, 48.80, 36.71, 39.70, 48.39},
                                       {39.97, 41.18, 48.32, 60.35, 41.31, 49.36, 61.55},
                                       {18.31, 18.94, 22.08, 27.59, 18.73, 23.01, 28.59},
                                       {30.44, 31.32, 38.48, 55.76, 30.69, 38.83, 56.92},
                                       {3.71, 3.97, 4.79, 5.09, 4.13, 5.47, 5.82},
                                       {5.51, 6.06, 6.57, 6.74, 5.80, 6.85, 7.02},
                                       {2.30, 2.16, 1.49, 1.37, 2.30, 1.49, 1.43}};
    static const double speed[7] = {0, 0.01, 0.1, 0.4, 0, 0.1, 0.4};
    for (int j = 0; j < 7; j++)
        for (int k = 0; k < 7; k++)
            ck_assert_double_eq_tol(
                hdt::stribeck_nm(pa10().joint[j].friction[k < 4 ? 0 : 1], speed[k]), table[j][k],
                0.0051);
}
END_TEST

// y(x) = zero + the integral of the slope from 0 to x
static double integrated(const hdt_arm_stiffness &k, double x)
{
    const double far = 1e6;
    const double edge[4] = {-far, k.t1_nm, k.t2_nm, far};
    double y = k.zero_nm;
    for (int i = 0; i < 3; i++) {
        const double from = std::fmax(edge[i], std::fmin(0, x)),
                     to = std::fmin(edge[i + 1], std::fmax(0, x));
        if (to > from)
            y += k.slope[i] * (to - from) * (x < 0 ? -1 : 1);
    }
    return y;
}

START_TEST(test_wind_up_lines_meet_and_pass_zero_where_said)
{
    uint64_t seed = 2;
    for (int round = 0; round < 500; round++) {
        hdt_arm_stiffness k;
        for (double &slope : k.slope)
            slope = test_uniform(&seed, -5, 5);
        k.t1_nm = test_uniform(&seed, -40, 40);
        k.t2_nm = k.t1_nm + test_uniform(&seed, 0.1, 40);
        k.zero_nm = test_uniform(&seed, -5, 5);
        if (round % 10 == 0) // load 0 just at a break point
            (round % 20 == 0 ? k.t1_nm : k.t2_nm) = 0, k.t1_nm = std::fmin(k.t1_nm, k.t2_nm - 0.1);
        ck_assert_double_eq_tol(hdt::stiffness_nm(k, 0), k.zero_nm, anywhere);
        for (int i = 0; i < 50; i++) {
            const double x = test_uniform(&seed, -100, 100);
            ck_assert_double_eq_tol(hdt::stiffness_nm(k, x), integrated(k, x), 1e-10);
        }
        for (const double at : {k.t1_nm, k.t2_nm})
            ck_assert_double_eq_tol(hdt::stiffness_nm(k, std::nextafter(at, -1e9)),
                                    hdt::stiffness_nm(k, std::nextafter(at, 1e9)), 1e-10);
    }
}
END_TEST

START_TEST(test_friction_terms_take_energy_from_motion)
{
    uint64_t seed = 3;
    const hdt_arm arm = with_named_effects(pa10());
    for (int round = 0; round < 500; round++) {
        const hdt::Sample s = random_sample(arm, &seed);
        const std::vector<hdt::TermTorque> terms = hdt::arm_terms(arm, s);
        for (int j = 0; j < arm.joints; j++) {
            const hdt::TermTorque &term = terms[static_cast<std::size_t>(j)];
            ck_assert_double_gt(term[HDT_TERM_FRICTION] * s.v[j], 0);
            ck_assert_double_ge(term[HDT_TERM_LOAD] * s.v[j], 0);
            ck_assert_double_gt(term[HDT_TERM_TEMPERATURE] * s.v[j], 0);
            ck_assert_double_le(term[HDT_TERM_PRESLIDING] * s.v[j], 0); // a deficit
        }
    }
}
END_TEST

START_TEST(test_what_follows_direction_vanishes_at_standstill)
{
    uint64_t seed = 4;
    const hdt_arm arm = with_named_effects(pa10());
    hdt::Sample s = random_sample(arm, &seed);
    s.v.setZero();
    s.dir.setZero();
    for (const hdt::TermTorque &term : hdt::arm_terms(arm, s)) {
        for (const hdt_term t :
             {HDT_TERM_FRICTION, HDT_TERM_RIPPLE, HDT_TERM_STIFFNESS, HDT_TERM_LOAD,
              HDT_TERM_TEMPERATURE, HDT_TERM_PRESLIDING, HDT_TERM_P, HDT_TERM_D})
            ck_assert_double_eq(term[static_cast<std::size_t>(t)], 0);
        ck_assert_double_ne(term[HDT_TERM_LINES], 0); // the conservative line stays
        ck_assert_double_eq(term[HDT_TERM_OFFSET], -0.7);
    }
}
END_TEST

START_TEST(test_half_a_direction_is_half_the_torque)
{
    uint64_t seed = 5;
    hdt_arm arm = with_named_effects(pa10());
    for (int j = 0; j < arm.joints; j++)
        arm.joint[j].lines = 1, arm.joint[j].cold_viscous_nmspr = 0;
    for (int round = 0; round < 100; round++) {
        hdt::Sample s = random_sample(arm, &seed);
        const std::vector<hdt::TermTorque> full = hdt::arm_terms(arm, s);
        s.dir *= 0.5;
        const std::vector<hdt::TermTorque> half = hdt::arm_terms(arm, s);
        for (std::size_t j = 0; j < full.size(); j++)
            for (const hdt_term t :
                 {HDT_TERM_FRICTION, HDT_TERM_RIPPLE, HDT_TERM_STIFFNESS, HDT_TERM_LINES,
                  HDT_TERM_LOAD, HDT_TERM_TEMPERATURE, HDT_TERM_PRESLIDING})
                ck_assert_double_eq_tol(half[j][static_cast<std::size_t>(t)],
                                        0.5 * full[j][static_cast<std::size_t>(t)], anywhere);
    }
}
END_TEST

START_TEST(test_a_symmetric_joint_answers_a_mirrored_motion_with_mirrored_torque)
{
    // a straight arm in a plane: q -> -q mirrors gravity too
    uint64_t seed = 6;
    hdt_arm arm = pa10();
    for (int j = 0; j < arm.joints; j++) {
        hdt_arm_joint &joint = arm.joint[j];
        joint.friction[1] = joint.friction[0];
        joint.ripples = 0;
        joint.load_mu = 0.03;
        hdt_arm_stiffness &back = joint.stiffness[1];
        const hdt_arm_stiffness &front = joint.stiffness[0];
        back = {{front.slope[2], front.slope[1], front.slope[0]},
                -front.t2_nm,
                -front.t1_nm,
                -front.zero_nm};
    }
    for (int round = 0; round < 200; round++) {
        hdt::Sample s = random_sample(arm, &seed);
        for (const int axial : {0, 2, 4, 6})
            s.q[axial] = s.v[axial] = s.a[axial] = 0;
        hdt::Sample mirrored = s;
        mirrored.q = -s.q;
        mirrored.v = -s.v;
        mirrored.a = -s.a;
        mirrored.dir = -s.dir;
        const std::vector<hdt::TermTorque> one = hdt::arm_terms(arm, s),
                                           other = hdt::arm_terms(arm, mirrored);
        for (const std::size_t j : {1u, 3u, 5u})
            for (std::size_t t = 0; t < HDT_TERMS; t++)
                ck_assert_double_eq_tol(one[j][t], -other[j][t], 1e-9);
    }
}
END_TEST

START_TEST(test_each_effect_is_alone_in_its_term)
{
    struct Effect {
        hdt_term term;
        void (*add)(hdt_arm_joint *);
    };
    static const Effect effects[] = {
        {HDT_TERM_LOAD, [](hdt_arm_joint *j) { j->load_mu = 0.1; }},
        {HDT_TERM_TEMPERATURE,
         [](hdt_arm_joint *j) {
             j->cold_coulomb_nm = 2;
             j->warm_s = 600;
         }},
        {HDT_TERM_TEMPERATURE,
         [](hdt_arm_joint *j) {
             j->cold_viscous_nmspr = 2;
             j->warm_s = 600;
         }},
        {HDT_TERM_PRESLIDING,
         [](hdt_arm_joint *j) {
             j->presliding_nm = 2;
             j->presliding_rad = 0.01;
         }},
        {HDT_TERM_SPRING,
         [](hdt_arm_joint *j) {
             j->spring_nmprad = 5;
             j->spring_q0_rad = 10;
         }},
        {HDT_TERM_OFFSET, [](hdt_arm_joint *j) { j->torque_offset_nm = 1; }},
        {HDT_TERM_INERTIA, [](hdt_arm_joint *j) { j->extra_inertia_kgm2 = 1; }},
        {HDT_TERM_LINES,
         [](hdt_arm_joint *j) {
             j->lines = 1;
             j->line[0] = {3, 1, 0.1, 0};
         }},
    };
    uint64_t seed = 7;
    const Effect &effect = effects[_i];
    const hdt_arm plain = pa10();
    hdt_arm arm = plain;
    effect.add(&arm.joint[1]);
    const hdt::Sample s = random_sample(arm, &seed);
    const std::vector<hdt::TermTorque> before = hdt::arm_terms(plain, s),
                                       after = hdt::arm_terms(arm, s);
    for (std::size_t j = 0; j < before.size(); j++)
        for (std::size_t t = 0; t < HDT_TERMS; t++)
            if (j == 1 && t == static_cast<std::size_t>(effect.term))
                ck_assert_double_ne(before[j][t], after[j][t]);
            else if (j == 1 && effect.term == HDT_TERM_SPRING && t == HDT_TERM_STIFFNESS)
                ck_assert_double_eq_tol(after[j][t], // a spring loads the gear as gravity does
                                        std::fabs(s.dir[1])
                                            * hdt::stiffness_nm(arm.joint[1].stiffness[s.dir[1] < 0],
                                                                before[j][HDT_TERM_GRAVITY]
                                                                    + after[j][HDT_TERM_SPRING]),
                                        anywhere);
            else
                ck_assert_double_eq(before[j][t], after[j][t]);
}
END_TEST

START_TEST(test_effects_have_the_size_their_numbers_say)
{
    uint64_t seed = 8;
    hdt_arm arm = with_named_effects(pa10());
    hdt::Sample s = random_sample(arm, &seed);
    s.t_s = 900 * std::log(2.0);
    s.dir.setConstant(-1);
    s.v.setConstant(-0.5);
    s.travel.setConstant(1e-3 * std::log(4.0));
    s.q.setConstant(0.8);
    const Eigen::VectorXd gravity = hdt::rbd::gravity(arm, s.q);
    const std::vector<hdt::TermTorque> terms = hdt::arm_terms(arm, s);
    for (int j = 0; j < arm.joints; j++) {
        const hdt::TermTorque &term = terms[static_cast<std::size_t>(j)];
        ck_assert_double_eq_tol(term[HDT_TERM_TEMPERATURE], 0.5 * (-3 - 4 * 0.5), anywhere);
        ck_assert_double_eq_tol(term[HDT_TERM_PRESLIDING], 0.25, anywhere);
        ck_assert_double_eq_tol(term[HDT_TERM_SPRING], 2 * (0.8 - 0.3), anywhere);
        ck_assert_double_eq_tol(term[HDT_TERM_LOAD], -0.05 * std::fabs(gravity[j] + term[HDT_TERM_SPRING]),
                                anywhere);
        ck_assert_double_eq_tol(term[HDT_TERM_GRAVITY], gravity[j], anywhere);
        ck_assert_double_eq_tol(term[HDT_TERM_LINES],
                                -0.6 * std::sin(100.5 * 0.8 + 0.2) + 0.5 * std::sin(1.5 * 0.8 - 0.4),
                                anywhere);
    }
}
END_TEST

START_TEST(test_a_rotor_resists_acceleration_by_ratio_squared)
{
    hdt_arm arm = pa10();
    for (int j = 0; j < arm.joints; j++)
        arm.joint[j].has_inertial = 0;
    hdt::Sample s;
    uint64_t seed = 9;
    s = random_sample(arm, &seed);
    // rotor and wave generator of the size 32 joints, 2500 * (3.0e-4 + 1.69e-4)
    const std::vector<hdt::TermTorque> terms = hdt::arm_terms(arm, s);
    ck_assert_double_eq_tol(terms[0][HDT_TERM_INERTIA], 1.1725 * s.a[0], 1e-9);
    for (std::size_t j = 0; j < terms.size(); j++)
        ck_assert_double_eq(terms[j][HDT_TERM_GRAVITY], 0);
    // constant speed: nothing but the links' own forces
    const hdt_arm whole = pa10();
    s.a.setZero();
    const Eigen::VectorXd moving =
        hdt::rbd::inverse_dynamics(whole, s.q, s.v, s.a) - hdt::rbd::gravity(whole, s.q);
    const std::vector<hdt::TermTorque> steady = hdt::arm_terms(whole, s);
    for (std::size_t j = 0; j < steady.size(); j++)
        ck_assert_double_eq_tol(steady[j][HDT_TERM_INERTIA], moving[static_cast<Eigen::Index>(j)],
                                anywhere);
}
END_TEST

START_TEST(test_ripple_repeats_with_the_wave_generator)
{
    uint64_t seed = 10;
    const hdt_arm arm = pa10();
    hdt::Sample s = random_sample(arm, &seed), turned = s;
    turned.q = s.q.array() + 2 * M_PI / 50;
    const std::vector<hdt::TermTorque> one = hdt::arm_terms(arm, s),
                                       other = hdt::arm_terms(arm, turned);
    for (std::size_t j = 0; j < one.size(); j++) {
        ck_assert_double_eq_tol(one[j][HDT_TERM_RIPPLE], other[j][HDT_TERM_RIPPLE], 1e-9);
        const hdt_arm_line *r = arm.joint[j].ripple;
        const auto at = static_cast<Eigen::Index>(j);
        const double expected =
            r[0].amplitude_nm * std::sin(r[0].order_rev * s.q[at] + r[0].phase_rad)
            + r[1].amplitude_nm * std::sin(r[1].order_rev * s.q[at] + r[1].phase_rad);
        ck_assert_double_eq_tol(one[j][HDT_TERM_RIPPLE], s.dir[at] * expected, anywhere);
    }
}
END_TEST

static Suite *terms_suite(void)
{
    Suite *suite = suite_create("terms");
    TCase *curves = tcase_create("curves");
    tcase_add_test(curves, test_stribeck_starts_at_f0_and_ends_on_its_line);
    tcase_add_test(curves, test_friction_of_table_two_has_its_printed_size);
    tcase_add_test(curves, test_wind_up_lines_meet_and_pass_zero_where_said);
    suite_add_tcase(suite, curves);
    TCase *terms = tcase_create("terms");
    tcase_add_test(terms, test_friction_terms_take_energy_from_motion);
    tcase_add_test(terms, test_what_follows_direction_vanishes_at_standstill);
    tcase_add_test(terms, test_half_a_direction_is_half_the_torque);
    tcase_add_test(terms, test_a_symmetric_joint_answers_a_mirrored_motion_with_mirrored_torque);
    tcase_add_loop_test(terms, test_each_effect_is_alone_in_its_term, 0, 8);
    tcase_add_test(terms, test_effects_have_the_size_their_numbers_say);
    tcase_add_test(terms, test_a_rotor_resists_acceleration_by_ratio_squared);
    tcase_add_test(terms, test_ripple_repeats_with_the_wave_generator);
    suite_add_tcase(suite, terms);
    return suite;
}

HDT_CHECK_MAIN(terms_suite())
