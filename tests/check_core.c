/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The step as a whole.
 * Goal: a run of the core is a function of its input, agrees with the double-precision model term by
 * term, and is safe for any accepted tables and any input.  Method: random arms on random paths with
 * lost telegrams, the reference run beside it; snapshots; extreme values.
 */
#include "ctrl/hdt.h"
#include "tests/core_reference.h"

static struct hdt_tables arm;
static struct hdt_in in;
static struct hdt_out out;
static hdt_t core;

/* ---- a random run and the reference beside it ------------------------------------------------- */

/* Where a random path is, per joint, and what the reference remembers. */
struct walk {
    double phase[HDT_JOINTS_MAX], rate[HDT_JOINTS_MAX], size[HDT_JOINTS_MAX];
    double t;
    uint64_t t_us;
};
struct reference {
    int seen;
    int32_t count;
    uint64_t t_us;
    double x[3], y[3], travel, wound;
    int dir;
};
static struct walk walk;
static struct reference ref[HDT_JOINTS_MAX];

static void start_walk(uint64_t *r)
{
    memset(&in, 0, sizeof in);
    memset(ref, 0, sizeof ref);
    walk.t = 0;
    walk.t_us = test_random(r) >> 20;
    for (uint32_t j = 0; j < arm.joints; j++) {
        walk.phase[j] = test_uniform(r, 0, 6);
        walk.rate[j] = test_uniform(r, 0.5, 8);
        walk.size[j] = test_uniform(r, 0.05, 0.4) * ref_size(arm.joints);
    }
    in.mode = HDT_MODE_TORQUE;
    in.active = (1u << arm.joints) - 1;
}

/* Next period's input: sine references, counts near them, some telegrams lost. */
static void next_input(uint64_t *r)
{
    const double dt = arm.period_ns * 1e-9;
    walk.t += dt;
    walk.t_us += (uint64_t)llrint(dt * 1e6);
    in.t_us = walk.t_us;
    in.fresh = walk.t <= dt ? ~0u : (uint32_t)(test_random(r) | test_random(r) | test_random(r));
    for (uint32_t j = 0; j < arm.joints; j++) {
        const struct hdt_joint_tab *t = &arm.joint[j];
        const double w = walk.rate[j], x = w * walk.t + walk.phase[j], a = walk.size[j];
        const double q = a * sin(x) + 0.002 * sin(7 * x), per_count = D(t->rad_per_count_q44, 44);
        in.q_ref[j].raw = Q(a * sin(x), 24);
        in.v_ref[j].raw = Q(a * w * cos(x), 24);
        in.a_ref[j].raw = Q(-a * w * w * sin(x), 16);
        in.count[j].raw = t->zero_cnt + t->sign * (int32_t)lrint(q / per_count);
    }
}

/* What the reference says of q, v, travel this period. */
static void follow(uint32_t j, struct ref_motion *m)
{
    const struct hdt_joint_tab *t = &arm.joint[j];
    struct reference *s = &ref[j];
    const double per_count = D(t->rad_per_count_q44, 44);
    double x = s->x[0];
    if (in.fresh >> j & 1) {
        if (s->seen)
            x = t->sign * (double)(in.count[j].raw - s->count) * per_count * 1e6
                / (double)(in.t_us - s->t_us);
        s->seen = 1;
        s->count = in.count[j].raw;
        s->t_us = in.t_us;
    }
    s->x[2] = s->x[1]; s->x[1] = s->x[0]; s->x[0] = x;
    s->y[2] = s->y[1]; s->y[1] = s->y[0];
    s->y[0] = D(arm.biquad_q28[0], 28) * x + D(arm.biquad_q28[1], 28) * s->x[1] +
              D(arm.biquad_q28[2], 28) * s->x[2] - D(arm.biquad_q28[3], 28) * s->y[1] -
              D(arm.biquad_q28[4], 28) * s->y[2];

    m->turned = t->sign * (double)(s->count - t->zero_cnt);
    m->q = m->turned * per_count;
    m->v = s->y[0];
    m->q_ref = D(in.q_ref[j].raw, 24);
    m->v_ref = D(in.v_ref[j].raw, 24);
    m->a_ref = D(in.a_ref[j].raw, 16);
    m->dir = ref_dir(t, m->v_ref);
    const int sign = (m->v_ref > 0) - (m->v_ref < 0);
    if (sign != 0 && sign != s->dir) {
        s->dir = sign;
        s->travel = 0;
    }
    m->travel = s->travel;
    s->travel += fabs(m->v_ref) * arm.period_ns * 1e-9;
    s->wound = fmax(-1, fmin(1, s->wound + m->v_ref * arm.period_ns * 1e-9 * D(t->windup_inv_q8, 8)));
    m->wound = s->wound;
    m->cold = exp(walk.t * log(D(t->cold_decay_q31, 31)));
}

/* Tolerance of a term in a run, N.m: its own, and what q (an LSB), v (below 1e-5 rad/s), load and
 * cold share, which the core worked out itself, bring in. */
static double run_tolerance(const struct hdt_joint_tab *t, int term, const struct ref_motion *m, double chain)
{
    const double q = 0x1p-24, slope = fmax(fabs(D(t->stiffness[m->dir < 0].slope_q24[0], 24)), 2);
    switch (term) {
    case HDT_TERM_GRAVITY: return chain;
    /* the wind-up's travel loses up to half a q30 a period times
     * 1/travel; curves move 10 N.m a knot at most */
    case HDT_TERM_STIFFNESS: return 1.6 * LSB_NM + slope * chain + (t->windup_inv_q8 != 0 ? 1e-3 : 0);
    case HDT_TERM_LOCAL: return 1.1 * LSB_NM + 10 / (double)(1u << t->local[m->dir < 0].shift);
    case HDT_TERM_TABLE:
        return 1.1 * LSB_NM
               + (t->axis == HDT_AXIS_PHASE || t->axis == HDT_AXIS_SPEED
                      ? 0
                      : 10 / (double)(1u << t->table.shift)
                            * (t->axis == HDT_AXIS_LOAD ? chain / LSB_NM + 1 : 1));
    case HDT_TERM_LOAD: return 1.1 * LSB_NM + D(t->load_mu_q24, 24) * chain;
    case HDT_TERM_TEMPERATURE:
        return 1.6 * LSB_NM
               + 4e-5 * (fabs(D(t->cold_coulomb_q16, 16)) + fabs(D(t->cold_viscous_q16, 16) * m->v_ref));
    case HDT_TERM_PRESLIDING: return ref_tolerance(t, term) + 1e-4 * fabs(D(t->presliding_q16, 16));
    case HDT_TERM_SPRING: return 0.6 * LSB_NM + fabs(D(t->spring_q16, 16)) * q;
    case HDT_TERM_P: return 0.6 * LSB_NM + D(t->kp_q16, 16) * q;
    case HDT_TERM_D: return 0.6 * LSB_NM + D(t->kd_q16, 16) * 1e-5;
    default: return ref_tolerance(t, term);
    }
}

static void assert_period_agrees(int n, int k)
{
    struct ref_motion m[HDT_JOINTS_MAX];
    double q[HDT_JOINTS_MAX] = {0}, v[HDT_JOINTS_MAX] = {0}, a[HDT_JOINTS_MAX] = {0};
    double g[HDT_JOINTS_MAX], i[HDT_JOINTS_MAX];
    for (uint32_t j = 0; j < arm.joints; j++) {
        follow(j, &m[j]);
        q[j] = m[j].q;
        v[j] = m[j].v_ref;
        a[j] = m[j].a_ref;
    }
    ref_gravity(&arm, q, g);
    ref_inertia(&arm, q, v, a, i);
    const double chain = ref_gravity_tolerance(&arm);
    const double rigid = ref_inertia_tolerance(&arm);
    for (uint32_t j = 0; j < arm.joints; j++) {
        const struct hdt_joint_tab *t = &arm.joint[j];
        int64_t total = 0;
        m[j].gravity = m[j].load = g[j];
        if (t->terms >> HDT_TERM_SPRING & 1)
            m[j].load += ref_spring(t, &m[j]);
        m[j].inertia = i[j];
        ck_assert_double_eq_tol(D(out.q[j].raw, 24), m[j].q, 0x1p-24);
        ck_assert_double_eq_tol(D(out.v[j].raw, 24), m[j].v, 1e-5);
        for (int term = 0; term < HDT_TERMS; term++) {
            /* at a corner of the three lines either side is right */
            if (term == HDT_TERM_STIFFNESS
                && (fabs(m[j].load - D(t->stiffness[m[j].dir < 0].t1_q16, 16)) < chain
                    || fabs(m[j].load - D(t->stiffness[m[j].dir < 0].t2_q16, 16)) < chain))
                continue;
            const double got = D(out.term[term][j].raw, 16), want = ref_term(t, term, &m[j]);
            const double allowed = term == HDT_TERM_INERTIA ? rigid : run_tolerance(t, term, &m[j], chain);
            ck_assert_msg(fabs(got - want) <= allowed,
                          "arm %d period %d joint %u %s: %.7f expected %.7f +- %.7f", n, k, j,
                          hdt_term_str(term), got, want, allowed);
        }
        for (int term = 0; term < HDT_TERMS; term++)
            total += out.term[term][j].raw;
        ck_assert(out.total[j].raw == total);
        const double digit = D(total, 16) * D(t->digit_per_nm_q24, 24) * t->sign;
        if (out.limit[j] == 0)
            ck_assert_double_le(fabs(out.digit[j].raw - digit), 0.5);
    }
    ck_assert_uint_eq(out.fault, 0);
}

START_TEST(test_every_term_of_a_run_agrees_with_the_double_model)
{
    uint64_t r = 1000 + (uint64_t)_i;
    for (int n = 0; n < 6; n++) {
        ref_random_arm(&r, (uint32_t)_i, &arm);
        arm.stale_periods = 100;
        ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
        start_walk(&r);
        walk.t = -1e-9 * arm.period_ns; /* the cold share is one in the first period */
        for (int k = 0; k < 250; k++) {
            next_input(&r);
            if (k == 0)
                in.fresh = ~0u;
            ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
            assert_period_agrees(n, k);
        }
    }
}
END_TEST

START_TEST(test_cold_share_decays_with_host_time_not_with_periods)
{
    uint64_t r = 5;
    ref_random_arm(&r, 1, &arm);
    struct hdt_joint_tab *t = &arm.joint[0];
    t->terms = 1u << HDT_TERM_TEMPERATURE;
    t->cold_coulomb_q16 = 10 << 16;
    t->cold_viscous_q16 = 0;
    t->cold_decay_q31 = (int32_t)llrint(exp(-1 / 100.0) * 0x1p31);
    arm.stale_periods = 1000000;
    ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
    memset(&in, 0, sizeof in);
    in.v_ref[0].raw = 1 << 24;
    in.fresh = 1;
    in.t_us = 12345678901u;
    for (double s = 0; s < 300;) {
        ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
        ck_assert_double_eq_tol(D(out.term[HDT_TERM_TEMPERATURE][0].raw, 16), 10 * exp(-s / 100), 2e-4);
        const uint64_t dt_us = 1 + test_random(&r) % 900000;
        in.t_us += dt_us;
        s += (double)dt_us * 1e-6;
    }
    /* after a pause of 50 s it catches up, a second a period */
    const double before = D(out.term[HDT_TERM_TEMPERATURE][0].raw, 16);
    in.t_us += 50000000;
    for (int k = 0; k < 60; k++, in.t_us++)
        hdt_step(&core, &in, &out);
    ck_assert_double_eq_tol(D(out.term[HDT_TERM_TEMPERATURE][0].raw, 16) / before, exp(-0.5), 0.01);
}
END_TEST

/* A joint turning steadily, one telegram in eight lost, in every mode and under a fault. */
START_TEST(test_observer_follows_the_arm_through_modes_faults_and_jumps)
{
    uint64_t r = 77;
    const double speed = 0.2;
    for (int bits = 0; bits < 1 << HDT_OBSERVED; bits++) {
        ref_random_arm(&r, 2, &arm);
        arm.stale_periods = 100;
        arm.observer = (uint32_t)bits;
        arm.observer_gain[0] = Q(0.2, 30);
        arm.observer_gain[1] = Q(0.02 * arm.rate_q16 / 65536, 16);
        arm.observer_gain[2] = 0;
        memset(&in, 0, sizeof in);
        for (int j = 0; j < 2; j++) {
            arm.joint[j].inertia_inv_q20 = Q(0.01, 20);
            arm.joint[j].nm_per_digit_q24 = Q(0.05, 24);
            arm.joint[j].terms = 1u << HDT_TERM_FRICTION | (j ? 1u << HDT_TERM_INERTIA : 0);
        }
        ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
        double q[2] = {0, 0};
        for (int k = 0; k < 1500; k++) {
            in.t_us = 1000000 + (uint64_t)k * arm.period_ns / 1000;
            in.mode = (uint32_t)(k / 100 % 3);
            in.active = 3;
            in.fresh = k == 0 || test_random(&r) % 8 != 0 ? 3 : 0;
            in.servo_alarm = k == 900;
            for (int j = 0; j < 2; j++) {
                const struct hdt_joint_tab *t = &arm.joint[j];
                q[j] += speed * arm.period_ns * 1e-9 + (k == 1300 ? 0.5 : 0); /* the count jumps once */
                in.fresh |= k == 1300 ? 3 : 0;
                in.count[j].raw = t->zero_cnt + t->sign * (int32_t)lrint(q[j] / D(t->rad_per_count_q44, 44));
                in.q_ref[j].raw = Q(q[j], 24);
                in.v_ref[j].raw = Q(-0.001, 24); /* the reference says the other way */
            }
            ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
            for (int j = 0; j < 2; j++) {
                if (bits == 0) {
                    ck_assert_int_eq(out.v_obs[j].raw, 0);
                    continue;
                }
                if (k == 1300) /* starts again where the arm is */
                    ck_assert_int_eq(out.v_obs[j].raw, 0);
                if (k > 950 && k < 1300) /* no torque under the fault: nothing but the counts */
                    ck_assert_double_eq_tol(D(out.v_obs[j].raw, 24), speed, 0.02);
                if (k > 950 && k < 1300)
                    ck_assert_int_eq(out.term[HDT_TERM_FRICTION][j].raw > 0,
                                     bits >> HDT_OBSERVED_FRICTION & 1);
            }
        }
        ck_assert_uint_eq(out.fault & HDT_FAULT_SERVO, HDT_FAULT_SERVO);
    }
}
END_TEST

START_TEST(test_snapshot_replays_bit_for_bit)
{
    static struct hdt_in tape[400];
    static struct hdt_out first[400];
    uint64_t r = 6;
    for (int n = 0; n < 20; n++) {
        hdt_t snapshot;
        ref_random_arm(&r, 1 + (uint32_t)(test_random(&r) % 16), &arm);
        arm.stale_periods = 100;
        hdt_init(&core, &arm);
        start_walk(&r);
        memset(&snapshot, 0, sizeof snapshot);
        for (int k = 0; k < 400; k++) {
            if (k == 150)
                snapshot = core;
            next_input(&r);
            tape[k] = in;
            ck_assert_int_eq(hdt_step(&core, &tape[k], &first[k]), HDT_OK);
        }
        for (int k = 150; k < 400; k++) {
            memset(&out, 0x5a, sizeof out);
            ck_assert_int_eq(hdt_step(&snapshot, &tape[k], &out), HDT_OK);
            ck_assert(memcmp(&out, &first[k], sizeof out) == 0);
        }
        ck_assert(memcmp(&snapshot, &core, sizeof core) == 0);
    }
}
END_TEST

START_TEST(test_a_joint_alone_is_the_joint_in_the_crowd)
{
    /* terms of one joint do not depend on how many others there are */
    static struct hdt_tables alone;
    uint64_t r = 7;
    for (int n = 0; n < 50; n++) {
        ref_random_arm(&r, 8, &arm);
        for (uint32_t j = 0; j < 8; j++)
            arm.joint[j].terms &= ~(1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_INERTIA | 1u << HDT_TERM_STIFFNESS
                                    | 1u << HDT_TERM_LOAD | 1u << HDT_TERM_TABLE);
        arm.stale_periods = 100;
        alone = arm;
        alone.joints = 1;
        alone.joint[0] = arm.joint[5];
        ref_chain_flags(&alone);
        hdt_t one;
        struct hdt_in in_one;
        struct hdt_out out_one;
        hdt_init(&core, &arm);
        hdt_init(&one, &alone);
        start_walk(&r);
        for (int k = 0; k < 100; k++) {
            next_input(&r);
            in_one = in;
            in_one.active = in.active >> 5 & 1;
            in_one.fresh = in.fresh >> 5 & 1;
            in_one.count[0] = in.count[5];
            in_one.q_ref[0] = in.q_ref[5];
            in_one.v_ref[0] = in.v_ref[5];
            in_one.a_ref[0] = in.a_ref[5];
            hdt_step(&core, &in, &out);
            hdt_step(&one, &in_one, &out_one);
            ck_assert_int_eq(out.total[5].raw, out_one.total[0].raw);
            ck_assert_int_eq(out.digit[5].raw, out_one.digit[0].raw);
            ck_assert_int_eq(out.v[5].raw, out_one.v[0].raw);
        }
    }
}
END_TEST

START_TEST(test_a_term_not_asked_for_is_zero)
{
    uint64_t r = 8;
    for (int term = 0; term < HDT_TERMS; term++) {
        int used = 0;
        for (int n = 0; n < 20; n++) {
            ref_random_arm(&r, 3, &arm);
            for (uint32_t j = 0; j < 3; j++)
                arm.joint[j].terms = j == 1 ? 1u << term : 0;
            hdt_init(&core, &arm);
            start_walk(&r);
            for (int k = 0; k < 20; k++) {
                next_input(&r);
                hdt_step(&core, &in, &out);
                for (int other = 0; other < HDT_TERMS; other++)
                    for (int j = 0; j < 3; j++)
                        if (j != 1 || other != term)
                            ck_assert_int_eq(out.term[other][j].raw, 0);
                used += out.term[term][1].raw != 0;
                ck_assert_int_eq(out.total[1].raw, out.term[term][1].raw);
            }
        }
        ck_assert_msg(used > 0, "%s never used", hdt_term_str(term));
    }
}
END_TEST

/* ---- start, modes, errors ------------------------------------------------------------------------ */

/* A plain arm at its zero, ready to step. */
static void plain(uint32_t joints)
{
    uint64_t r = 9;
    ref_random_arm(&r, joints, &arm);
    for (uint32_t j = 0; j < joints; j++) {
        arm.joint[j].sign = 1;
        arm.joint[j].terms = 1u << HDT_TERM_OFFSET;
        arm.joint[j].offset_q16 = 1 << 16;
        arm.joint[j].digit_per_nm_q24 = 20 << 24;
        arm.joint[j].dig_max = 3000;
        arm.joint[j].dig_slew = 300;
        arm.joint[j].spd_max = 30000;
    }
    ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
    memset(&in, 0, sizeof in);
    in.mode = HDT_MODE_TORQUE;
    in.active = in.fresh = (1u << joints) - 1;
    for (uint32_t j = 0; j < joints; j++)
        in.count[j].raw = arm.joint[j].zero_cnt;
}

static int tick(void)
{
    in.t_us += (arm.period_ns + 500) / 1000;
    return hdt_step(&core, &in, &out);
}

START_TEST(test_first_count_however_far_is_no_speed)
{
    plain(2);
    in.count[0].raw += (int32_t)(2.9 / D(arm.joint[0].rad_per_count_q44, 44));
    in.q_ref[0].raw = Q(2.9, 24);
    ck_assert_int_eq(tick(), HDT_OK);
    ck_assert_int_eq(out.v[0].raw, 0);
    ck_assert_uint_eq(out.fault, 0);
    ck_assert_int_eq(out.digit[0].raw, 20);

    /* the same for a joint that reports late */
    plain(2);
    in.fresh = 1;
    for (int k = 0; k < 50; k++)
        tick();
    ck_assert_int_eq(out.digit[0].raw, 0);
    in.fresh = 3;
    in.count[1].raw += (int32_t)(2.9 / D(arm.joint[1].rad_per_count_q44, 44));
    tick();
    ck_assert_int_eq(out.v[1].raw, 0);
    ck_assert_uint_eq(out.fault, 0);
    ck_assert_int_eq(out.digit[0].raw, 20);
}
END_TEST

START_TEST(test_a_gap_of_16_periods_is_spanned_and_one_of_17_is_not)
{
    for (uint32_t periods = 15; periods <= 18; periods++) {
        plain(1);
        in.count_us = 1000;
        tick();
        in.count_us += (uint64_t)periods * (arm.period_ns / 1000);
        in.count[0].raw += 1000;
        tick();
        ck_assert_msg((out.v[0].raw != 0) == (periods <= 16), "%u periods: %d", periods, out.v[0].raw);
    }
    in.count_us = 0;
}
END_TEST

/* An arm that moved at 1 rad/s, and then nothing is heard of it for so many periods. */
static void fall_silent(uint32_t periods)
{
    plain(1);
    arm.joint[0].q_max_q24 = Q(100, 24);
    arm.stale_periods = 1000;
    const double per_period = arm.period_ns * 1e-9 / D(arm.joint[0].rad_per_count_q44, 44);
    for (int k = 1; k <= 100; k++) {
        in.count[0].raw = arm.joint[0].zero_cnt + (int32_t)lrint(k * per_period);
        tick();
    }
    ck_assert_double_eq_tol(D(out.v[0].raw, 24), 1, 0.02);
    in.fresh = 0;
    for (uint32_t k = 0; k < periods; k++)
        tick();
}

START_TEST(test_a_speed_is_not_held_longer_than_a_gap_is_spanned)
{
    fall_silent(16);
    ck_assert_double_eq_tol(D(out.v[0].raw, 24), 1, 0.02);
    fall_silent(17);
    ck_assert_int_eq(out.v[0].raw, 0);
    /* two counts of one instant say nothing of speed: it is held */
    fall_silent(0);
    in.fresh = 1;
    in.count_us = in.t_us;
    tick();
    ck_assert_double_eq_tol(D(out.v[0].raw, 24), 1, 0.02);
    in.count_us = 0;
    fall_silent(17);
    /* nor is it still there when the arm, at rest by then, is heard again */
    in.fresh = 1;
    tick();
    ck_assert_int_eq(out.v[0].raw, 0);
    /* nor when it was the host that stood still */
    fall_silent(0);
    in.fresh = 1;
    in.t_us += 1000000;
    tick();
    ck_assert_int_eq(out.v[0].raw, 0);
    tick();
    ck_assert_int_eq(out.v[0].raw, 0);
}
END_TEST

START_TEST(test_late_host_does_not_look_like_speed)
{
    /* steady 1 rad/s, counts taken at uneven times: the estimate uses the time they were taken at */
    plain(1);
    arm.joint[0].q_max_q24 = Q(100, 24);
    uint64_t r = 9;
    double t = 0;
    in.fresh = 1;
    in.count_us = in.t_us + 1;
    for (int k = 0; k < 2000; k++) {
        const uint64_t late_us = (uint64_t)test_uniform(&r, 400, 9000);
        in.count_us += late_us;
        t += (double)late_us * 1e-6;
        in.count[0].raw = arm.joint[0].zero_cnt + (int32_t)lrint(t / D(arm.joint[0].rad_per_count_q44, 44));
        tick();
        if (k > 100)
            ck_assert_double_eq_tol(D(out.v[0].raw, 24), 1, 0.02);
        ck_assert_uint_eq(out.fault, 0);
    }
    in.count_us = 0;
}
END_TEST

START_TEST(test_lost_telegrams_do_not_look_like_speed)
{
    /* steady 1 rad/s; after the filter settled, gaps of up to 16 periods leave the estimate alone */
    plain(1);
    arm.stale_periods = 1000;
    const double step = D(arm.period_ns, 0) * 1e-9 / D(arm.joint[0].rad_per_count_q44, 44);
    arm.joint[0].q_max_q24 = Q(100, 24);
    for (int k = 0; k < 3000; k++) {
        const int gap = k < 500 ? 1 : 1 + k / 500 * 3; /* up to 16 */
        in.fresh = k % gap == 0;
        in.count[0].raw = arm.joint[0].zero_cnt + (int32_t)lrint(k * step);
        tick();
        if (k > 400)
            ck_assert_double_eq_tol(D(out.v[0].raw, 24), 1, 0.01);
        ck_assert_uint_eq(out.fault, 0);
    }
    /* after a longer gap the difference starts anew instead of guessing */
    in.fresh = 0;
    for (int k = 0; k < 40; k++)
        tick();
    in.fresh = 1;
    in.count[0].raw += 100000000;
    tick();
    ck_assert_int_eq(out.v[0].raw, 0);
}
END_TEST

START_TEST(test_observer_knows_what_its_torque_does)
{
    /* a link of 2 kg.m^2 that weighs 1 N.m swings after a sine: the observed velocity is the true one, also
     * where the torque turns; friction of the observed velocity is that velocity's */
    plain(1);
    struct hdt_joint_tab *t = &arm.joint[0];
    const double dt = arm.period_ns * 1e-9, per_count = D(t->rad_per_count_q44, 44), w = 9;
    double q = 0, v = 0, worst = 0, fastest = 0;
    t->terms |= 1u << HDT_TERM_P | 1u << HDT_TERM_D | 1u << HDT_TERM_FRICTION;
    t->kp_q16 = 400 << 16;
    t->kd_q16 = 20 << 16;
    t->dig_max = 32767;
    t->dig_slew = 65535;
    t->digit_per_nm_q24 = 20 << 24;
    t->nm_per_digit_q24 = Q(0.05, 24);
    t->inertia_inv_q20 = 1 << 19;
    for (int k = 0; k < HDT_FRICTION_KNOTS; k++)
        t->friction_q16[0][k] = t->friction_q16[1][k] = 3 << 16;
    arm.observer = 1u << HDT_OBSERVED_FRICTION;
    const double p = exp(-2 * REF_PI * 3 * dt), r = 1 - p; /* 3 Hz: twice what it follows */
    arm.observer_gain[0] = Q(1 - p * p * p, 30);
    arm.observer_gain[1] = Q(1.5 * r * r * (1 + p) / dt, 16);
    arm.observer_gain[2] = Q(r * r * r / dt / dt, 8);
    ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
    for (int k = 0; k * dt < 6; k++) {
        in.count[0].raw = t->zero_cnt + (int32_t)floor(q / per_count);
        in.q_ref[0].raw = Q(0.2 * sin(w * k * dt), 24);
        ck_assert_int_eq(tick(), HDT_OK);
        ck_assert_uint_eq(out.fault, 0);
        if (k * dt > 2) {
            const double seen = D(out.v_obs[0].raw, 24), f = D(out.term[HDT_TERM_FRICTION][0].raw, 16);
            worst = fmax(worst, fabs(seen - v));
            fastest = fmax(fastest, fabs(v));
            if (fabs(seen) > 0.15) /* beyond any ramp */
                ck_assert_double_eq_tol(f, seen > 0 ? 3 : -3, 1e-3);
        }
        /* what it feeds forward for friction the arm does have */
        const double push = out.digit[0].raw * 0.05 - 1 - D(out.term[HDT_TERM_FRICTION][0].raw, 16);
        q += v * dt + push / 2 * dt * dt / 2;
        v += push / 2 * dt;
    }
    ck_assert_double_gt(fastest, 1);
    ck_assert_double_lt(worst, 0.02 * fastest);
}
END_TEST

START_TEST(test_observer_starts_where_the_arm_is)
{
    /* nearer to zero than the quarter rad at which it starts anew, and at rest: no speed is ever seen */
    plain(1);
    arm.observer = 1u << HDT_OBSERVED_FEEDBACK;
    arm.observer_gain[0] = 1 << 29;
    arm.observer_gain[1] = Q(10, 16);
    arm.observer_gain[2] = 0;
    in.mode = HDT_MODE_IDLE;
    for (int sign = -1; sign <= 1; sign += 2) {
        ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
        in.count[0].raw = arm.joint[0].zero_cnt
                          + sign * (int32_t)(0.2 / D(arm.joint[0].rad_per_count_q44, 44));
        for (int k = 0; k < 20; k++) {
            ck_assert_int_eq(tick(), HDT_OK);
            ck_assert_double_eq_tol(D(out.q[0].raw, 24), sign * 0.2, 1e-3);
            ck_assert_int_eq(out.v_obs[0].raw, 0);
        }
    }
}
END_TEST

START_TEST(test_velocity_mode_adds_four_per_second_of_position_error)
{
    plain(2);
    arm.joint[1].sign = -1;
    in.mode = HDT_MODE_VELOCITY;
    for (int j = 0; j < 2; j++) {
        in.v_ref[j].raw = Q(0.2, 24);
        in.q_ref[j].raw = Q(0.05, 24);
    }
    tick();
    ck_assert_int_eq(out.speed[0].raw, 2000);  /* (0.2 + 4 * 0.05) * 5000 */
    ck_assert_int_eq(out.speed[1].raw, -2000);
    ck_assert_int_eq(out.digit[0].raw, 0);
    ck_assert_int_eq(out.total[0].raw, 1 << 16); /* terms are still told */
}
END_TEST

START_TEST(test_after_a_refused_step_the_slew_begins_at_zero)
{
    plain(1);
    arm.joint[0].offset_q16 = 40 << 16;
    arm.joint[0].dig_slew = 50;
    for (int k = 0; k < 30; k++)
        tick();
    ck_assert_int_eq(out.digit[0].raw, 800);
    ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_ERR_TIME);
    ck_assert_int_eq(out.digit[0].raw, 0);
    tick();
    ck_assert_int_eq(out.digit[0].raw, 50);
    ck_assert_int_eq(hdt_step(&core, &in, NULL), HDT_ERR_ARG);
    tick();
    ck_assert_int_eq(out.digit[0].raw, 50);
}
END_TEST

START_TEST(test_error_leaves_state_alone_and_output_zero)
{
    static const struct hdt_out zero;
    plain(2);
    tick();
    hdt_t before = core;
    memset(before.gate.digit, 0, sizeof before.gate.digit); /* what the caller is told to send */
#define REFUSED(h, i, err) \
    do { memset(&out, 0x5a, sizeof out); ck_assert_int_eq(hdt_step(h, i, &out), err); \
         ck_assert(memcmp(&out, &zero, sizeof zero) == 0); \
         ck_assert(memcmp(&core, &before, sizeof core) == 0); } while (0)
    REFUSED(&core, &in, HDT_ERR_TIME); /* same time again */
    in.t_us--;
    REFUSED(&core, &in, HDT_ERR_TIME);
    in.t_us += 2;
    in.mode = HDT_MODE_VELOCITY + 1;
    REFUSED(&core, &in, HDT_ERR_ARG);
    in.mode = UINT32_MAX;
    REFUSED(&core, &in, HDT_ERR_ARG);
    in.mode = HDT_MODE_TORQUE;
    REFUSED(NULL, &in, HDT_ERR_ARG);
    REFUSED(&core, NULL, HDT_ERR_ARG);
    ck_assert_int_eq(hdt_step(&core, &in, NULL), HDT_ERR_ARG);
    ck_assert(memcmp(&core, &before, sizeof core) == 0);
    ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK); /* one microsecond on is enough */
}
END_TEST

START_TEST(test_refused_tables_leave_a_core_that_refuses)
{
    static const hdt_t zero;
    plain(2);
    ck_assert_int_eq(hdt_init(NULL, &arm), HDT_ERR_ARG);
    ck_assert_int_eq(hdt_init(&core, NULL), HDT_ERR_ARG);
    ck_assert(memcmp(&core, &zero, sizeof zero) == 0);
    ck_assert_int_eq(tick(), HDT_ERR_TABLES);
    ck_assert_int_eq(hdt_clear(&core), HDT_ERR_TABLES);
    ck_assert_int_eq(hdt_clear(NULL), HDT_ERR_ARG);
    arm.joint[1].dig_max = 0;
    hdt_t other;
    memset(&other, 0x5a, sizeof other);
    ck_assert_int_eq(hdt_init(&other, &arm), HDT_ERR_TABLES);
    ck_assert(memcmp(&other, &zero, sizeof zero) == 0);
}
END_TEST

START_TEST(test_clear_lets_digits_through_again)
{
    plain(1);
    tick();
    ck_assert_int_eq(out.digit[0].raw, 20);
    in.servo_alarm = 1;
    tick();
    ck_assert_uint_eq(out.fault, HDT_FAULT_SERVO);
    in.servo_alarm = 0;
    tick();
    ck_assert_int_eq(out.digit[0].raw, 0);
    ck_assert_int_eq(hdt_clear(&core), HDT_OK);
    tick();
    ck_assert_int_eq(out.digit[0].raw, 20);
}
END_TEST

/* ---- anything at all -------------------------------------------------------------------------------- */

static int32_t any_int32(uint64_t *r)
{
    static const int32_t edge[] = {0, 1, -1, INT32_MAX, INT32_MIN, -INT32_MAX, 1 << 30, -(1 << 30)};
    const uint64_t x = test_random(r);
    return x & 1 ? edge[x >> 8 & 7] : (int32_t)(x >> 32) >> (x >> 8 & 31);
}

/* Tables of any values, kept if accepted. */
static void any_arm(uint64_t *r)
{
    do {
        ref_random_arm(r, 1 + (uint32_t)(test_random(r) % 16), &arm);
        arm.observer = (uint32_t)(test_random(r) % (1u << HDT_OBSERVED));
        for (int i = 0; i < 3; i++)
            arm.observer_gain[i] = (int32_t)(test_random(r) % ((1u << 30) + 1u));
        for (uint32_t j = 0; j < arm.joints; j++) {
            int32_t *word = (int32_t *)(void *)&arm.joint[j];
            for (int k = 0; k < 200; k++) {
                const size_t at = test_random(r) % (sizeof arm.joint[j] / 4);
                const int32_t before = word[at];
                word[at] = any_int32(r);
                if (hdt_tables_check(&arm, NULL, NULL) != HDT_TABLES_OK)
                    word[at] = before;
            }
        }
    } while (hdt_tables_check(&arm, NULL, NULL) != HDT_TABLES_OK);
}

START_TEST(test_any_accepted_tables_and_any_input_stay_in_the_envelope)
{
    uint64_t r = 2000 + (uint64_t)_i;
    for (int n = 0; n < 25; n++) {
        int32_t last[HDT_JOINTS_MAX] = {0};
        any_arm(&r);
        ck_assert_int_eq(hdt_init(&core, &arm), HDT_OK);
        memset(&in, 0, sizeof in);
        for (int k = 0; k < 60; k++) {
            in.t_us += 1 + test_random(&r) % 3000000;
            in.mode = (uint32_t)(test_random(&r) % 3);
            in.active = (uint32_t)test_random(&r);
            in.fresh = (uint32_t)(test_random(&r) | test_random(&r));
            in.servo_alarm = test_random(&r) % 8 ? 0 : (uint32_t)test_random(&r);
            for (int j = 0; j < HDT_JOINTS_MAX; j++) {
                in.count[j].raw = any_int32(&r);
                in.q_ref[j].raw = any_int32(&r);
                in.v_ref[j].raw = any_int32(&r);
                in.a_ref[j].raw = any_int32(&r);
            }
            ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
            for (uint32_t j = 0; j < arm.joints; j++) {
                const int32_t d = out.digit[j].raw;
                ck_assert_int_le(abs(d), arm.joint[j].dig_max);
                ck_assert(d == 0 || abs(d - last[j]) <= arm.joint[j].dig_slew);
                ck_assert(out.fault == 0 || (d == 0 && out.speed[j].raw == 0));
                for (int term = 0; term < HDT_TERMS; term++)
                    ck_assert_int_gt(out.term[term][j].raw, INT32_MIN);
                last[j] = d;
            }
            if (out.fault != 0 && test_random(&r) % 2) {
                ck_assert_int_eq(hdt_clear(&core), HDT_OK);
                memset(last, 0, sizeof last);
            }
        }
    }
}
END_TEST

START_TEST(test_torques_are_right_before_they_saturate)
{
    /* digits go through at full size and direction with every fault limit wide open */
    uint64_t r = 11;
    int32_t largest = 0;
    for (int n = 0; n < 200; n++) {
        plain(3);
        for (int j = 0; j < 3; j++) {
            arm.joint[j].offset_q16 = any_int32(&r);
            if (arm.joint[j].offset_q16 == INT32_MIN)
                arm.joint[j].offset_q16 = 0;
            arm.joint[j].dig_max = 32767;
            arm.joint[j].dig_slew = 65535;
        }
        hdt_init(&core, &arm);
        tick();
        for (int j = 0; j < 3; j++) {
            const double want = fmax(-32767, fmin(32767, D(arm.joint[j].offset_q16, 16) * 20));
            ck_assert_double_le(fabs(out.digit[j].raw - want), 0.5);
            largest = out.digit[j].raw > largest ? out.digit[j].raw : largest;
        }
    }
    ck_assert_int_eq(largest, 32767);
}
END_TEST

START_TEST(test_every_code_has_its_own_name)
{
    for (int a = 0; a < HDT_TERMS; a++)
        for (int b = -1; b < a; b++)
            ck_assert_str_ne(hdt_term_str(a), hdt_term_str(b));
    ck_assert_str_eq(hdt_term_str(HDT_TERM_GRAVITY), "gravity");
    ck_assert_str_eq(hdt_term_str(HDT_TERMS), hdt_term_str(-1));
    for (int a = 0; a < 6; a++)
        for (int b = 0; b < a; b++)
            ck_assert_str_ne(hdt_fault_str(1u << a), hdt_fault_str(1u << b));
    for (int a = 0; a < 5; a++)
        for (int b = 0; b < a; b++)
            ck_assert_str_ne(hdt_limit_str(1u << a), hdt_limit_str(1u << b));
    for (int a = 0; a >= -4; a--)
        for (int b = 0; b > a; b--)
            ck_assert_str_ne(hdt_strerror(a), hdt_strerror(b));
    ck_assert_str_eq(hdt_fault_str(0), "none");
    ck_assert_str_eq(hdt_limit_str(0), "none");
}
END_TEST

static Suite *core_suite(void)
{
    Suite *s = suite_create("core");
    TCase *m = tcase_create("model"), *c = tcase_create("contract"), *a = tcase_create("anything");
    tcase_set_timeout(m, 120);
    tcase_set_timeout(a, 120);
    tcase_add_loop_test(m, test_every_term_of_a_run_agrees_with_the_double_model, 1, HDT_JOINTS_MAX + 1);
    tcase_add_test(m, test_cold_share_decays_with_host_time_not_with_periods);
    tcase_add_test(m, test_observer_follows_the_arm_through_modes_faults_and_jumps);
    tcase_add_test(m, test_snapshot_replays_bit_for_bit);
    tcase_add_test(m, test_a_joint_alone_is_the_joint_in_the_crowd);
    tcase_add_test(m, test_a_term_not_asked_for_is_zero);
    tcase_add_test(c, test_first_count_however_far_is_no_speed);
    tcase_add_test(c, test_a_gap_of_16_periods_is_spanned_and_one_of_17_is_not);
    tcase_add_test(c, test_a_speed_is_not_held_longer_than_a_gap_is_spanned);
    tcase_add_test(c, test_late_host_does_not_look_like_speed);
    tcase_add_test(c, test_lost_telegrams_do_not_look_like_speed);
    tcase_add_test(c, test_observer_knows_what_its_torque_does);
    tcase_add_test(c, test_observer_starts_where_the_arm_is);
    tcase_add_test(c, test_velocity_mode_adds_four_per_second_of_position_error);
    tcase_add_test(c, test_error_leaves_state_alone_and_output_zero);
    tcase_add_test(c, test_after_a_refused_step_the_slew_begins_at_zero);
    tcase_add_test(c, test_refused_tables_leave_a_core_that_refuses);
    tcase_add_test(c, test_clear_lets_digits_through_again);
    tcase_add_test(c, test_every_code_has_its_own_name);
    tcase_add_loop_test(a, test_any_accepted_tables_and_any_input_stay_in_the_envelope, 0, 4);
    tcase_add_test(a, test_torques_are_right_before_they_saturate);
    suite_add_tcase(s, m);
    suite_add_tcase(s, c);
    suite_add_tcase(s, a);
    return s;
}

HDT_CHECK_MAIN(core_suite())
