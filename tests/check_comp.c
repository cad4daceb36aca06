/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms against the double-precision reference, and the physics each must keep.
 * Goal: fixed point is the same model to within stated rounding.  Method: random arms and states.
 */
#include "ctrl/hdt_chain.h"
#include "ctrl/hdt_comp.h"
#include "tests/core_reference.h"

static struct hdt_tables arm;

static void turn_of(const struct hdt_joint_tab *j, struct hdt_motion *m)
{
    hdt_phase_t angle = hdt_comp_phase(j->phase_per_count_q24, m->turned);
    angle.raw += j->phase0;
    hdt_sin_cos(angle, &m->sin_q30, &m->cos_q30);
}

/* A random motion in fixed point, the same in double. */
static void random_motion(uint64_t *r, const struct hdt_joint_tab *j, struct hdt_motion *m,
                          struct ref_motion *d)
{
    memset(m, 0, sizeof *m);
    memset(d, 0, sizeof *d);
    m->turned = (int32_t)test_uniform(r, -3e6, 3e6);
    m->q_q24 = hdt_comp_angle_q24(j, m->turned);
    turn_of(j, m);
    m->v_q24 = Q(test_uniform(r, -4, 4), 24);
    m->q_ref_q24 = Q(test_uniform(r, -4, 4), 24);
    m->v_ref_q24 = Q(test_uniform(r, -1, 1) * pow(10, test_uniform(r, -4, 0.6)), 24);
    m->v_fric_q24 = m->v_ref_q24;
    m->a_ref_q16 = Q(test_uniform(r, -20, 20), 16);
    m->dir_q30 = hdt_comp_direction_q30(j, m->v_ref_q24);
    m->travel_q40 = (int64_t)(test_uniform(r, 0, 1) * pow(10, test_uniform(r, -6, 0)) * 0x1p40);
    m->wound_q30 = Q(test_uniform(r, -1, 1), 30);
    m->cold_q30 = Q(test_uniform(r, 0, 1), 30);
    d->turned = m->turned;
    d->q = D(m->q_q24, 24);
    d->v = D(m->v_q24, 24);
    d->q_ref = D(m->q_ref_q24, 24);
    d->v_ref = D(m->v_ref_q24, 24);
    d->a_ref = D(m->a_ref_q16, 16);
    d->dir = D(m->dir_q30, 30);
    d->travel = D(m->travel_q40, 40);
    d->wound = D(m->wound_q30, 30);
    d->cold = D(m->cold_q30, 30);
    d->load = d->gravity = D(Q(test_uniform(r, -100, 100), 16), 16);
}

static int32_t term_of(int term, const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load)
{
    switch (term) {
    case HDT_TERM_FRICTION: return hdt_comp_friction(j, m);
    case HDT_TERM_RIPPLE: return hdt_comp_ripple(j, m);
    case HDT_TERM_STIFFNESS:
        return j->windup_inv_q8 != 0 ? hdt_comp_hysteresis(j, m, load) : hdt_comp_stiffness(j, m, load);
    case HDT_TERM_LINES: return hdt_comp_lines(j, m);
    case HDT_TERM_LOAD: return hdt_comp_load(j, m, load);
    case HDT_TERM_TEMPERATURE: return hdt_comp_temperature(j, m);
    case HDT_TERM_PRESLIDING: return hdt_comp_presliding(j, m);
    case HDT_TERM_SPRING: return hdt_comp_spring(j, m);
    case HDT_TERM_LOCAL: return hdt_comp_local(j, m);
    case HDT_TERM_TABLE: return hdt_comp_table(j, m, load);
    case HDT_TERM_P: return hdt_comp_p(j, m);
    case HDT_TERM_D: return hdt_comp_d(j, m);
    default: return 0;
    }
}

static const int own_terms[] = {HDT_TERM_FRICTION, HDT_TERM_RIPPLE, HDT_TERM_STIFFNESS, HDT_TERM_LINES,
                                HDT_TERM_LOAD, HDT_TERM_TEMPERATURE, HDT_TERM_PRESLIDING,
                                HDT_TERM_SPRING, HDT_TERM_LOCAL, HDT_TERM_TABLE, HDT_TERM_P, HDT_TERM_D};

START_TEST(test_term_agrees_with_the_double_reference)
{
    const int term = own_terms[_i];
    uint64_t r = 100 + (uint64_t)_i;
    double worst = 0;
    for (int n = 0; n < 200; n++) {
        ref_random_arm(&r, 1, &arm);
        const struct hdt_joint_tab *j = &arm.joint[0];
        for (int k = 0; k < 100; k++) {
            struct hdt_motion m;
            struct ref_motion d;
            random_motion(&r, j, &m, &d);
            const double got = D(term_of(term, j, &m, Q(d.load, 16)), 16);
            const double want = ref_term(j, term, &d), error = fabs(got - want);
            worst = fmax(worst, fabs(want));
            ck_assert_msg(error <= ref_tolerance(j, term),
                          "term %d arm %d state %d: %.9g, expected %.9g, off %.2f LSB", term, n, k, got, want,
                          error / LSB_NM);
        }
    }
    ck_assert_double_gt(worst, 1); /* the states did excite the term */
}
END_TEST

START_TEST(test_knots_and_line_ends_are_met_on_both_sides)
{
    uint64_t r = 7;
    for (int n = 0; n < 200; n++) {
        ref_random_arm(&r, 1, &arm);
        struct hdt_joint_tab *j = &arm.joint[0];
        j->windup_inv_q8 = 0;
        for (int32_t step = -2; step <= 2; step++) {
            for (int k = 1; k < 260; k += 3) {
                struct hdt_motion m;
                struct ref_motion d;
                random_motion(&r, j, &m, &d);
                m.v_ref_q24 = (k << j->friction_shift) + step;
                if (n & 1)
                    m.v_ref_q24 = -m.v_ref_q24;
                m.v_fric_q24 = m.v_ref_q24;
                m.dir_q30 = hdt_comp_direction_q30(j, m.v_ref_q24);
                d.v_ref = D(m.v_ref_q24, 24);
                d.dir = D(m.dir_q30, 30);
                ck_assert_double_eq_tol(D(hdt_comp_friction(j, &m), 16), ref_friction(j, &d), 1.1 * LSB_NM);
                const struct hdt_stiffness_tab *s = &j->stiffness[m.dir_q30 < 0];
                const int32_t load = (k & 1 ? s->t1_q16 : s->t2_q16) + step;
                d.load = D(load, 16);
                ck_assert_double_eq_tol(D(hdt_comp_stiffness(j, &m, load), 16), ref_stiffness(j, &d),
                                        1.1 * LSB_NM);
            }
        }
    }
}
END_TEST

START_TEST(test_ripple_at_every_count_of_a_turn_and_around_it)
{
    uint64_t r = 71;
    ref_random_arm(&r, 1, &arm);
    const struct hdt_joint_tab *j = &arm.joint[0];
    for (int32_t turned = -16384; turned < 2 * 16384; turned++) {
        struct hdt_motion m = {0};
        struct ref_motion d = {0};
        m.turned = turned;
        m.dir_q30 = turned & 1 ? 1 << 30 : -(1 << 30);
        d.turned = turned;
        d.dir = D(m.dir_q30, 30);
        ck_assert_double_eq_tol(D(hdt_comp_ripple(j, &m), 16), ref_ripple(j, &d), 1e-12);
    }
}
END_TEST

START_TEST(test_a_curve_is_followed_up_to_the_largest_knots_a_table_holds)
{
    static struct hdt_joint_tab j;
    struct hdt_motion m = {.dir_q30 = 1 << 30};
    j.axis = HDT_AXIS_Q;
    j.table.shift = 10;
    for (int k = 0; k < HDT_CURVE_KNOTS; k++)
        j.table.value_q8[k] = k % 2 ? INT16_MAX : INT16_MIN;
    for (int k = 0; k < HDT_CURVE_KNOTS; k++) {
        m.q_q24 = k << 10;
        ck_assert_int_eq(hdt_comp_table(&j, &m, 0), j.table.value_q8[k] * 256);
        m.q_q24 += 512;
        if (k < HDT_CURVE_KNOTS - 1) /* halfway between the two */
            ck_assert_int_eq(hdt_comp_table(&j, &m, 0), -128);
    }
}
END_TEST

START_TEST(test_directed_terms_vanish_at_standstill)
{
    uint64_t r = 8;
    for (int n = 0; n < 300; n++) {
        ref_random_arm(&r, 1, &arm);
        struct hdt_motion m;
        struct ref_motion d;
        random_motion(&r, &arm.joint[0], &m, &d);
        m.v_ref_q24 = 0;
        m.v_fric_q24 = m.v_ref_q24;
        m.dir_q30 = hdt_comp_direction_q30(&arm.joint[0], 0);
        ck_assert_int_eq(m.dir_q30, 0);
        ck_assert_int_eq(hdt_comp_friction(&arm.joint[0], &m), 0);
        ck_assert_int_eq(hdt_comp_ripple(&arm.joint[0], &m), 0);
        ck_assert_int_eq(hdt_comp_stiffness(&arm.joint[0], &m, Q(d.load, 16)), 0);
        ck_assert_int_eq(hdt_comp_load(&arm.joint[0], &m, Q(d.load, 16)), 0);
        ck_assert_int_eq(hdt_comp_temperature(&arm.joint[0], &m), 0);
        ck_assert_int_eq(hdt_comp_presliding(&arm.joint[0], &m), 0);
        ck_assert_int_eq(hdt_comp_local(&arm.joint[0], &m), 0);
        for (uint32_t k = 0; k < arm.joint[0].lines; k++)
            arm.joint[0].line[k].directed = 1;
        ck_assert_int_eq(hdt_comp_lines(&arm.joint[0], &m), 0);
    }
}
END_TEST

START_TEST(test_direction_ramps_and_stops_at_one)
{
    uint64_t r = 9;
    for (int n = 0; n < 1000; n++) {
        ref_random_arm(&r, 1, &arm);
        const struct hdt_joint_tab *j = &arm.joint[0];
        for (int k = 0; k < 20; k++) {
            const int32_t v = Q(test_uniform(&r, -2, 2) / D(j->v_ramp_inv_q16, 16), 24);
            const double want = ref_dir(j, D(v, 24)), got = D(hdt_comp_direction_q30(j, v), 30);
            ck_assert_double_eq_tol(got, want, 0x1p-30);
        }
        ck_assert_int_eq(hdt_comp_direction_q30(j, INT32_MAX), 1 << 30);
        ck_assert_int_eq(hdt_comp_direction_q30(j, INT32_MIN), -(1 << 30));
    }
}
END_TEST

/* States of every joint, for chain tests. */
static void random_chain(uint64_t *r, struct hdt_motion m[], double q[], double v[], double a[])
{
    for (uint32_t j = 0; j < arm.joints; j++) {
        struct ref_motion d;
        random_motion(r, &arm.joint[j], &m[j], &d);
        m[j].turned = (int32_t)test_uniform(r, -4e5, 4e5);
        turn_of(&arm.joint[j], &m[j]);
        m[j].v_ref_q24 = Q(test_uniform(r, -2, 2) * ref_size(arm.joints), 24);
        m[j].a_ref_q16 = Q(test_uniform(r, -10, 10) * ref_size(arm.joints), 16);
        q[j] = m[j].turned * ((double)arm.joint[j].phase_per_count_q24 * 0x1p-56) * 2 * REF_PI;
        v[j] = D(m[j].v_ref_q24, 24);
        a[j] = D(m[j].a_ref_q16, 16);
    }
}

/* Of all arms of a test: as a share of what was allowed, and as it is. */
struct worst { double share, nm; };

static void assert_torques(int n, const int32_t *got_q16, const double *want_nm, double allowed_nm,
                           struct worst *worst)
{
    for (uint32_t j = 0; j < arm.joints; j++) {
        const double error = fabs(D(got_q16[j], 16) - want_nm[j]);
        worst->share = fmax(worst->share, error / allowed_nm);
        worst->nm = fmax(worst->nm, error);
        ck_assert_msg(error <= allowed_nm, "arm %d joint %u: %.7f expected %.7f, allowed %.7f", n, j,
                      D(got_q16[j], 16), want_nm[j], allowed_nm);
    }
}

static void say_worst(const char *what, int joints, const struct worst *worst)
{
    if (getenv("HDT_TEST_RESIDUALS"))
        printf("%s %d joints: %.2f of the tolerance, %.1f LSB at most\n", what, joints, worst->share,
               worst->nm / LSB_NM);
}

START_TEST(test_gravity_is_the_gradient_of_potential_energy)
{
    uint64_t r = 20 + (uint64_t)_i;
    struct worst worst = {0, 0};
    for (int n = 0; n < 300; n++) {
        struct hdt_motion m[HDT_JOINTS_MAX];
        double q[HDT_JOINTS_MAX], v[HDT_JOINTS_MAX], a[HDT_JOINTS_MAX], want[HDT_JOINTS_MAX];
        int32_t got[HDT_JOINTS_MAX];
        ref_random_arm(&r, (uint32_t)_i, &arm);
        ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
        random_chain(&r, m, q, v, a);
        hdt_chain_gravity(&arm, m, got);
        ref_gravity(&arm, q, want);
        assert_torques(n, got, want, ref_gravity_tolerance(&arm), &worst);
    }
    say_worst("gravity", _i, &worst);
}
END_TEST

START_TEST(test_inertia_agrees_with_projection_in_the_base_frame)
{
    uint64_t r = 40 + (uint64_t)_i;
    struct worst worst = {0, 0};
    for (int n = 0; n < 300; n++) {
        struct hdt_motion m[HDT_JOINTS_MAX];
        double q[HDT_JOINTS_MAX], v[HDT_JOINTS_MAX], a[HDT_JOINTS_MAX], want[HDT_JOINTS_MAX];
        int32_t got[HDT_JOINTS_MAX];
        ref_random_arm(&r, (uint32_t)_i, &arm);
        random_chain(&r, m, q, v, a);
        hdt_chain_inertia(&arm, m, got);
        ref_inertia(&arm, q, v, a, want);
        assert_torques(n, got, want, ref_inertia_tolerance(&arm), &worst);
    }
    say_worst("inertia", _i, &worst);
}
END_TEST

START_TEST(test_mass_matrix_is_symmetric)
{
    /* with zero speed the torque is M a: M must be symmetric */
    uint64_t r = 60;
    for (int n = 0; n < 100; n++) {
        struct hdt_motion m[HDT_JOINTS_MAX];
        double q[HDT_JOINTS_MAX], v[HDT_JOINTS_MAX], a[HDT_JOINTS_MAX];
        int32_t row[HDT_JOINTS_MAX][HDT_JOINTS_MAX];
        ref_random_arm(&r, 7, &arm);
        random_chain(&r, m, q, v, a);
        for (int k = 0; k < 7; k++) {
            for (int j = 0; j < 7; j++) {
                m[j].v_ref_q24 = 0;
                m[j].a_ref_q16 = j == k ? 1 << 16 : 0;
            }
            hdt_chain_inertia(&arm, m, row[k]);
        }
        for (int k = 0; k < 7; k++)
            for (int j = 0; j < k; j++)
                ck_assert_double_eq_tol(D(row[k][j], 16), D(row[j][k], 16), 0.005);
    }
}
END_TEST

/* Weights and speeds of every joint times `weight` and `speed`, as far as their ranges allow. */
static void grow(const struct hdt_tables *of, double weight, double speed)
{
    arm = *of;
    for (uint32_t j = 0; j < arm.joints; j++) {
        struct hdt_joint_tab *tab = &arm.joint[j];
        memset(tab->stiffness, 0, sizeof tab->stiffness);
        tab->friction_shift = 23;
        for (int i = 0; i < 2; i++)
            tab->moment_q20[i] = (int32_t)fmax(-(500 << 20), fmin(500 << 20, tab->moment_q20[i] * weight));
        for (int i = 0; i < 5; i++)
            tab->second_q20[i] = (int32_t)fmax(-(500 << 20), fmin(500 << 20, tab->second_q20[i] * weight));
        tab->v_lim_q24 = (int32_t)fmin(1 << 30, tab->v_lim_q24 * speed);
        tab->a_lim_q16 = (int32_t)fmin(1 << 30, tab->a_lim_q16 * speed);
    }
}

/* The largest arm of that shape that is accepted, grown by one of the two; returns how much it grew. */
static double grow_to_the_limit(const struct hdt_tables *of, int by_speed)
{
    double ok = 0, bad = 1e6;
    for (int i = 0; i < 60; i++) {
        const double k = (ok + bad) / 2;
        grow(of, by_speed ? 1 : k, by_speed ? k : 1);
        *(hdt_tables_check(&arm, NULL, NULL) == HDT_TABLES_OK ? &ok : &bad) = k;
    }
    grow(of, by_speed ? 1 : ok, by_speed ? ok : 1);
    return ok;
}

/* All axes parallel and every weight straight out: with all joints one way, sums are at their largest. */
static void stretch(struct hdt_tables *t)
{
    for (uint32_t j = 0; j < t->joints; j++) {
        struct hdt_joint_tab *tab = &t->joint[j];
        tab->twist_cos_q30 = 1 << 30;
        tab->twist_sin_q30 = 0;
        tab->phase0 = 0;
        tab->step_q24[0] = hdt_abs(tab->step_q24[0]);
        tab->moment_q20[0] = hdt_abs(tab->moment_q20[0]);
        tab->step_q24[1] = tab->moment_q20[1] = 0;
    }
    ref_chain_flags(t);
}

/* What the chain relies on: the largest arms that are accepted, all joints at their limits, are still the
 * law; a vector that left its 32 bits would be off by 2^31 of its last place, 1 kN m and more. */
START_TEST(test_no_vector_leaves_32_bits_in_any_arm_accepted)
{
    uint64_t r = 80 + (uint64_t)_i;
    static struct hdt_tables small;
    double least = 1e6, most_nm = 0;
    for (int n = 0; n < 60; n++) {
        ref_random_arm(&r, (uint32_t)_i, &small);
        const int stretched = n % 3 == 0;
        if (stretched)
            stretch(&small);
        least = fmin(least, grow_to_the_limit(&small, n & 1));
        ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
        for (int k = 0; k < 20; k++) {
            struct hdt_motion m[HDT_JOINTS_MAX];
            double q[HDT_JOINTS_MAX], v[HDT_JOINTS_MAX], a[HDT_JOINTS_MAX], want[HDT_JOINTS_MAX];
            int32_t got[HDT_JOINTS_MAX];
            random_chain(&r, m, q, v, a);
            for (uint32_t j = 0; j < arm.joints; j++) {
                const int way = k < 2 ? k : (int)(test_random(&r) & 1);
                if (stretched && k < 2) {
                    m[j].sin_q30 = 0;
                    m[j].cos_q30 = 1 << 30;
                    q[j] = 0;
                }
                m[j].v_ref_q24 = way ? arm.joint[j].v_lim_q24 : -arm.joint[j].v_lim_q24;
                m[j].a_ref_q16 = way ? arm.joint[j].a_lim_q16 : -arm.joint[j].a_lim_q16;
                v[j] = D(m[j].v_ref_q24, 24);
                a[j] = D(m[j].a_ref_q16, 16);
            }
            hdt_chain_inertia(&arm, m, got);
            ref_inertia(&arm, q, v, a, want);
            for (uint32_t j = 0; j < arm.joints; j++) {
                /* the first joint turns all that weighs */
                const double held = fmax(-32768, fmin(32768, want[j]));
                most_nm = fmax(most_nm, fabs(want[j]));
                ck_assert_msg(fabs(D(got[j], 16) - held) < 1, "arm %d joint %u: %.3f, the law says %.3f",
                              n, j, D(got[j], 16), want[j]);
            }
            hdt_chain_gravity(&arm, m, got);
            ref_gravity(&arm, q, want);
            for (uint32_t j = 0; j < arm.joints; j++)
                ck_assert_double_eq_tol(D(got[j], 16), want[j], 0.1);
        }
    }
    ck_assert_double_gt(least, 1); /* the random arms themselves are accepted */
    ck_assert_double_gt(most_nm, 5000);
}
END_TEST

START_TEST(test_terms_saturate_and_never_wrap)
{
    /* extreme tables, as far as they are accepted, and motion: the sign of a term is the
     * sign of its reference, its size is clamped */
    const int32_t edge[] = {INT32_MAX, -INT32_MAX, 1 << 30, -(1 << 30), 1, 0, -1};
    uint64_t r = 70;
    for (int n = 0; n < 20000; n++) {
        if (n % 100 == 0)
            ref_random_arm(&r, 1, &arm);
        struct hdt_joint_tab *j = &arm.joint[0];
        struct hdt_motion m;
        struct ref_motion d;
        random_motion(&r, j, &m, &d);
#define EDGE edge[test_random(&r) % (sizeof edge / sizeof edge[0])]
        j->kp_q16 = hdt_abs(EDGE) >> 1;
        j->kd_q16 = hdt_abs(EDGE) >> 1;
        j->spring_q16 = EDGE;
        j->spring_q0_q24 = EDGE;
        j->cold_coulomb_q16 = EDGE;
        j->cold_viscous_q16 = EDGE;
        j->load_mu_q24 = hdt_abs(EDGE);
        j->v_ramp_inv_q16 = 1 + (hdt_abs(EDGE) >> 1);
        j->presliding_q16 = EDGE;
        j->presliding_inv_q8 = hdt_abs(EDGE);
        j->line[0].amplitude_q16 = EDGE;
        for (int k = 0; k < 3; k++) {
            j->stiffness[0].slope_q24[k] = j->stiffness[1].slope_q24[k] = EDGE / 128;
            j->stiffness[0].intercept_q16[k] = j->stiffness[1].intercept_q16[k] = EDGE / 2;
        }
        m.v_ref_q24 = (int32_t)hdt_clamp(EDGE, -j->v_lim_q24, j->v_lim_q24);
        m.v_fric_q24 = m.v_ref_q24;
        m.v_q24 = EDGE;
        m.q_ref_q24 = EDGE;
        m.q_q24 = EDGE;
        m.dir_q30 = hdt_comp_direction_q30(j, m.v_ref_q24);
        const int32_t load = EDGE / 2;
        d.q = D(m.q_q24, 24);
        d.v = D(m.v_q24, 24);
        d.q_ref = D(m.q_ref_q24, 24);
        d.v_ref = D(m.v_ref_q24, 24);
        d.dir = D(m.dir_q30, 30);
        d.load = D(load, 16);
        for (size_t k = 0; k < sizeof own_terms / sizeof own_terms[0]; k++) {
            /* inner sums saturate before a direction or share scales them: only the sign and, where
             * nothing saturates, the value are certain */
            const int term = own_terms[k];
            const double want = ref_term(j, term, &d), got = D(term_of(term, j, &m, load), 16);
            ck_assert_double_ge(got, -32768);
            if (fabs(want) > 1 && term != HDT_TERM_LINES && term != HDT_TERM_TEMPERATURE)
                ck_assert_msg(got * want >= 0, "term %d: %.9g for %.9g", term, got, want);
            if (term == HDT_TERM_SPRING || term == HDT_TERM_P || term == HDT_TERM_D) {
                const double span = term == HDT_TERM_SPRING ? d.q - D(j->spring_q0_q24, 24)
                                    : term == HDT_TERM_P    ? d.q_ref - d.q : d.v_ref - d.v;
                const double most = D(term == HDT_TERM_SPRING ? HDT_SPRING_MAX_Q16 : INT32_MAX, 16);
                if (fabs(span) < 127)
                    ck_assert_double_eq_tol(got, fmax(-most, fmin(most, want)), LSB_NM);
            }
        }
    }
}
END_TEST

/* Tables the check would refuse and any motion: without meaning, but no undefined behaviour (the sanitizers
 * look) and gravity within its bound. */
START_TEST(test_the_chain_takes_any_numbers)
{
    const int32_t edge[] = {1 << 30, -(1 << 30), (1 << 30) - 1, 500 << 20, -(500 << 20), 1 << 20, 0, -1};
    uint64_t r = 90;
    int held = 0;
    ref_random_arm(&r, HDT_JOINTS_MAX, &arm);
    for (int n = 0; n < 5000; n++) {
        struct hdt_motion m[HDT_JOINTS_MAX];
        int32_t got[HDT_JOINTS_MAX];
        memset(m, 0, sizeof m);
        for (int i = 0; i < 3; i++)
            arm.gravity_q24[i] = EDGE;
        for (uint32_t j = 0; j < arm.joints; j++) {
            struct hdt_joint_tab *tab = &arm.joint[j];
            tab->chain = (uint32_t)test_random(&r) & 15u;
            tab->twist_cos_q30 = EDGE;
            tab->twist_sin_q30 = EDGE;
            for (int i = 0; i < 2; i++) {
                tab->step_q24[i] = (int32_t)hdt_clamp(2 * (int64_t)EDGE, -INT32_MAX, INT32_MAX);
                tab->moment_q20[i] = EDGE / 2;
            }
            for (int i = 0; i < 5; i++)
                tab->second_q20[i] = EDGE / 2;
            m[j].sin_q30 = EDGE;
            m[j].cos_q30 = EDGE;
            m[j].v_ref_q24 = EDGE;
            m[j].a_ref_q16 = EDGE;
        }
        hdt_chain_gravity(&arm, m, got);
        for (uint32_t j = 0; j < arm.joints; j++) {
            ck_assert(got[j] >= -HDT_GRAVITY_MAX_Q16 && got[j] <= HDT_GRAVITY_MAX_Q16);
            held += got[j] == -HDT_GRAVITY_MAX_Q16 || got[j] == HDT_GRAVITY_MAX_Q16;
        }
        hdt_chain_inertia(&arm, m, got);
        for (uint32_t j = 0; j < arm.joints; j++)
            ck_assert_int_ne(got[j], INT32_MIN);
    }
    ck_assert_int_gt(held, 1000);
}
END_TEST

static Suite *comp_suite(void)
{
    Suite *s = suite_create("comp");
    TCase *one = tcase_create("joint"), *chain = tcase_create("chain"), *edges = tcase_create("edges");
    tcase_set_timeout(one, 60);
    tcase_set_timeout(chain, 120);
    tcase_set_timeout(edges, 60);
    tcase_add_loop_test(one, test_term_agrees_with_the_double_reference, 0,
                        (int)(sizeof own_terms / sizeof own_terms[0]));
    tcase_add_test(one, test_knots_and_line_ends_are_met_on_both_sides);
    tcase_add_test(one, test_ripple_at_every_count_of_a_turn_and_around_it);
    tcase_add_test(one, test_a_curve_is_followed_up_to_the_largest_knots_a_table_holds);
    tcase_add_test(one, test_directed_terms_vanish_at_standstill);
    tcase_add_test(one, test_direction_ramps_and_stops_at_one);
    tcase_add_loop_test(chain, test_gravity_is_the_gradient_of_potential_energy, 1, HDT_JOINTS_MAX + 1);
    tcase_add_loop_test(chain, test_inertia_agrees_with_projection_in_the_base_frame, 1, HDT_JOINTS_MAX + 1);
    tcase_add_test(chain, test_mass_matrix_is_symmetric);
    tcase_add_loop_test(chain, test_no_vector_leaves_32_bits_in_any_arm_accepted, 1, HDT_JOINTS_MAX + 1);
    tcase_add_test(edges, test_the_chain_takes_any_numbers);
    tcase_add_test(edges, test_terms_saturate_and_never_wrap);
    suite_add_tcase(s, one);
    suite_add_tcase(s, chain);
    suite_add_tcase(s, edges);
    return s;
}

HDT_CHECK_MAIN(comp_suite())
