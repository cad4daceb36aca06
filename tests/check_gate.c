/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The gate.
 * Goal: no digit or speed word leaves outside its envelope, and every fault and limit begins at its
 * stated boundary and not before.  Method: both sides of each boundary, one LSB apart, then random
 * input of any size against the envelope alone.
 */
#include "ctrl/hdt_gate.h"
#include "tests/core_reference.h"

#define JOINTS 3
static struct hdt_tables arm;
static struct hdt_gate gate;
static struct hdt_in in;
static struct hdt_out out;
static hdt_radps_t v_cmd[HDT_JOINTS_MAX];
static uint32_t seen;

/* A quiet arm in torque mode: nothing cut, nothing wrong. */
static void set_up(void)
{
    uint64_t r = 1;
    ref_random_arm(&r, JOINTS, &arm);
    memset(&gate, 0, sizeof gate);
    memset(&in, 0, sizeof in);
    memset(&out, 0, sizeof out);
    memset(v_cmd, 0, sizeof v_cmd);
    for (int j = 0; j < JOINTS; j++) {
        struct hdt_joint_tab *t = &arm.joint[j];
        t->sign = 1;
        t->digit_per_nm_q24 = 20 << 24; /* 1000 / 50 */
        t->dig_max = 3000;
        t->dig_slew = 100;
        t->spd_max = 5000;
        t->q_min_q24 = Q(-1.5, 24);
        t->q_max_q24 = Q(2, 24);
        t->v_max_q24 = Q(1, 24);
        t->follow_max_q24 = Q(0.1, 24);
    }
    in.mode = HDT_MODE_TORQUE;
    in.active = in.fresh = seen = (1u << JOINTS) - 1;
}

static void step(void)
{
    hdt_gate_step(&gate, &arm, &in, seen, v_cmd, &out);
}

/* Same command until the slew limit no longer cuts. */
static void settle(void)
{
    for (int k = 0; k < 400; k++)
        step();
}

START_TEST(test_digits_are_torque_times_scale_to_the_nearest)
{
    set_up();
    uint64_t r = 2;
    for (int k = 0; k < 500; k++) {
        arm.joint[1].digit_per_nm_q24 = Q(test_uniform(&r, 1, 100), 24);
        arm.joint[1].dig_max = 32767;
        arm.joint[1].dig_slew = 65535;
        out.total[1].raw = Q(test_uniform(&r, -300, 300), 16);
        step();
        const double want = D(out.total[1].raw, 16) * D(arm.joint[1].digit_per_nm_q24, 24);
        ck_assert_double_le(fabs(out.digit[1].raw - want), 0.5);
        ck_assert_uint_eq(out.limit[1], 0);
    }
}
END_TEST

START_TEST(test_torque_is_cut_at_dig_max_and_not_before)
{
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        out.total[0].raw = side * (150 << 16); /* 3000 digits */
        settle();
        ck_assert_int_eq(out.digit[0].raw, side * 3000);
        ck_assert_uint_eq(out.limit[0], 0);
        out.total[0].raw += side * Q(0.05, 16); /* one digit more */
        settle();
        ck_assert_int_eq(out.digit[0].raw, side * 3000);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_TORQUE);
        out.total[0].raw = (side < 0 ? -INT32_MAX : INT32_MAX);
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 3000);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_TORQUE);
    }
}
END_TEST

START_TEST(test_slew_is_cut_at_dig_slew_and_not_before)
{
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        out.total[0].raw = side * (5 << 16); /* 100 digits */
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 100);
        ck_assert_uint_eq(out.limit[0], 0);
        out.total[0].raw = side * Q(10.05, 16); /* 201: one too many */
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 200);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_SLEW);
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 201);
        ck_assert_uint_eq(out.limit[0], 0);
        out.total[0].raw = 0;
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 101);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_SLEW);
    }
}
END_TEST

START_TEST(test_outside_its_range_a_joint_is_only_pushed_back)
{
    for (int side = -1; side <= 1; side += 2) {
        const int32_t edge = side > 0 ? Q(2, 24) : Q(-1.5, 24);
        set_up();
        in.q_ref[0].raw = edge;
        out.q[0].raw = edge;
        out.total[0].raw = side * (1 << 16);
        step();
        ck_assert_int_eq(out.digit[0].raw, side * 20); /* on the edge: let through */
        ck_assert_uint_eq(out.limit[0], 0);
        out.q[0].raw = edge + side;
        step();
        ck_assert_int_eq(out.digit[0].raw, 0);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_POSITION);
        out.total[0].raw = -side * (1 << 16);
        step();
        ck_assert_int_eq(out.digit[0].raw, -side * 20); /* inward: let through */
        ck_assert_uint_eq(out.limit[0], 0);

        /* the same for speed */
        in.mode = HDT_MODE_VELOCITY;
        v_cmd[0].raw = side * Q(0.1, 24);
        step();
        ck_assert_int_eq(out.speed[0].raw, 0);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_POSITION);
        v_cmd[0].raw = -side * Q(0.1, 24);
        step();
        ck_assert_int_eq(out.speed[0].raw, -side * 500);
        ck_assert_uint_eq(out.fault, 0);
    }
}
END_TEST

START_TEST(test_speed_words_are_cut_at_spd_max_and_not_before)
{
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        in.mode = HDT_MODE_VELOCITY;
        v_cmd[1].raw = side * (1 << 24); /* 1 rad/s: 5000 digits */
        step();
        ck_assert_int_eq(out.speed[1].raw, side * 5000);
        ck_assert_uint_eq(out.limit[1], 0);
        v_cmd[1].raw += side * Q(0.0002, 24);
        step();
        ck_assert_int_eq(out.speed[1].raw, side * 5000);
        ck_assert_uint_eq(out.limit[1], HDT_LIM_SPEED);
        v_cmd[1].raw = (side < 0 ? -INT32_MAX : INT32_MAX);
        step();
        ck_assert_int_eq(out.speed[1].raw, side * 5000);
    }
}
END_TEST

START_TEST(test_modes_keep_to_their_own_output)
{
    set_up();
    out.total[0].raw = 1 << 16;
    v_cmd[0].raw = 1 << 22;
    step();
    ck_assert_int_eq(out.digit[0].raw, 20);
    ck_assert_int_eq(out.speed[0].raw, 0);
    in.mode = HDT_MODE_VELOCITY;
    step();
    ck_assert_int_eq(out.digit[0].raw, 0);
    ck_assert_int_eq(out.speed[0].raw, 1250);
    in.mode = HDT_MODE_IDLE;
    step();
    ck_assert_int_eq(out.digit[0].raw, 0);
    ck_assert_int_eq(out.speed[0].raw, 0);
    ck_assert_uint_eq(out.fault, 0);
}
END_TEST

START_TEST(test_sign_turns_both_outputs_after_the_limits)
{
    set_up();
    arm.joint[0].sign = -1;
    out.q[0].raw = Q(2, 24) + 1;
    in.q_ref[0].raw = Q(2, 24);
    out.total[0].raw = 1 << 16; /* joint direction: outward */
    step();
    ck_assert_uint_eq(out.limit[0], HDT_LIM_POSITION);
    out.total[0].raw = -(1 << 16);
    step();
    ck_assert_int_eq(out.digit[0].raw, 20);
    ck_assert_uint_eq(out.limit[0], 0);
    in.mode = HDT_MODE_VELOCITY;
    v_cmd[0].raw = -Q(0.1, 24);
    step();
    ck_assert_int_eq(out.speed[0].raw, 500);
}
END_TEST

/* One fault each: how to stay just inside, how to step just outside. */
static void inside(int k, int side)
{
    out.q[1].raw = 0;
    if (k == 1)
        out.v[1].raw = side * Q(1, 24);
    if (k == 2)
        in.q_ref[1].raw = side * Q(0.1, 24);
    if (k == 3)
        in.servo_alarm = 1u << JOINTS;
    if (k == 4)
        out.q[1].raw = in.q_ref[1].raw = side > 0 ? Q(2, 24) : Q(-1.5, 24);
}

static void outside(int k, int side)
{
    if (k == 1)
        out.v[1].raw += side;
    if (k == 2)
        in.q_ref[1].raw += side;
    if (k == 3)
        in.servo_alarm |= 2;
    if (k == 4)
        in.q_ref[1].raw += side;
}

START_TEST(test_fault_begins_one_lsb_beyond_its_limit_and_latches)
{
    static const uint32_t fault[] = {0, HDT_FAULT_SPEED, HDT_FAULT_FOLLOWING, HDT_FAULT_SERVO,
                                     HDT_FAULT_REFERENCE};
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        for (int j = 0; j < JOINTS; j++)
            out.total[j].raw = side > 0 && _i == 4 ? 0 : 1 << 16;
        inside(_i, side);
        settle();
        ck_assert_uint_eq(out.fault, 0);
        if (!(_i == 4 && side > 0))
            ck_assert_int_eq(out.digit[0].raw, 20);

        outside(_i, side);
        step();
        ck_assert_uint_eq(out.fault, fault[_i]);
        ck_assert_uint_eq(out.fault_joints, 2);
        for (int j = 0; j < JOINTS; j++)
            ck_assert_int_eq(out.digit[j].raw, 0);

        /* back inside it stays, until cleared; then digits restart through the slew limit */
        in.servo_alarm = 0;
        in.q_ref[1].raw = out.q[1].raw = out.v[1].raw = 0;
        settle();
        ck_assert_uint_eq(out.fault, fault[_i]);
        ck_assert_int_eq(out.digit[0].raw, 0);
        hdt_gate_clear(&gate);
        out.total[0].raw = 100 << 16;
        step();
        ck_assert_uint_eq(out.fault | out.fault_joints, 0);
        ck_assert_int_eq(out.digit[0].raw, 100);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_SLEW);
    }
}
END_TEST

START_TEST(test_stale_counts_periods_in_a_row)
{
    for (uint32_t periods = 1; periods < 6; periods++) {
        set_up();
        arm.stale_periods = periods;
        out.total[0].raw = 1 << 16;
        step();
        for (int round = 0; round < 3; round++) {
            in.fresh = 5;
            for (uint32_t k = 1; k < periods; k++) {
                step();
                ck_assert_uint_eq(out.fault, 0);
                ck_assert_int_eq(out.digit[0].raw, 20);
            }
            in.fresh = 7;
            step();
            ck_assert_uint_eq(out.fault, 0);
        }
        in.fresh = 5;
        for (uint32_t k = 0; k < periods; k++)
            step();
        ck_assert_uint_eq(out.fault, HDT_FAULT_STALE);
        ck_assert_uint_eq(out.fault_joints, 2);
        ck_assert_int_eq(out.digit[0].raw, 0);

        /* still silent: clearing does not help; fresh again: it does */
        hdt_gate_clear(&gate);
        step();
        ck_assert_uint_eq(out.fault, HDT_FAULT_STALE);
        in.fresh = 7;
        hdt_gate_clear(&gate);
        step();
        ck_assert_uint_eq(out.fault, 0);
    }
}
END_TEST

START_TEST(test_silence_never_forgets)
{
    set_up();
    gate.stale[1] = UINT32_MAX - 1;
    in.fresh = 5;
    for (int k = 0; k < 4; k++) {
        gate.fault = 0;
        step();
        ck_assert_uint_eq(out.fault, HDT_FAULT_STALE);
    }
}
END_TEST

START_TEST(test_nothing_moves_before_every_driven_joint_was_seen)
{
    set_up();
    for (int j = 0; j < JOINTS; j++)
        out.total[j].raw = 1 << 16;
    seen = 5;
    in.fresh = 5;
    settle();
    ck_assert_uint_eq(out.fault, 0); /* not yet there is not lost */
    for (int j = 0; j < JOINTS; j++)
        ck_assert_int_eq(out.digit[j].raw, 0);
    in.active = 5;
    step();
    ck_assert_int_eq(out.digit[0].raw, 20);
    ck_assert_int_eq(out.digit[1].raw, 0);
    ck_assert_int_eq(out.digit[2].raw, 20);
}
END_TEST

START_TEST(test_a_joint_not_driven_raises_nothing_and_gets_nothing)
{
    set_up();
    in.active = 1;
    in.fresh = 1;
    in.servo_alarm = 6;
    out.v[1].raw = INT32_MAX;
    in.q_ref[2].raw = Q(50, 24);
    out.total[0].raw = out.total[1].raw = 1 << 16;
    settle();
    ck_assert_uint_eq(out.fault, 0);
    ck_assert_int_eq(out.digit[0].raw, 20);
    ck_assert_int_eq(out.digit[1].raw, 0);
}
END_TEST

START_TEST(test_idle_does_not_judge_the_reference)
{
    set_up();
    in.mode = HDT_MODE_IDLE;
    in.q_ref[1].raw = Q(50, 24);
    step();
    ck_assert_uint_eq(out.fault, 0);
    in.mode = HDT_MODE_VELOCITY;
    step();
    ck_assert_uint_eq(out.fault, HDT_FAULT_REFERENCE | HDT_FAULT_FOLLOWING);
}
END_TEST

START_TEST(test_following_limit_of_zero_is_off)
{
    set_up();
    arm.joint[1].follow_max_q24 = 0;
    in.q_ref[1].raw = Q(1.9, 24);
    out.q[1].raw = Q(-1.4, 24);
    step();
    ck_assert_uint_eq(out.fault, 0);
}
END_TEST

START_TEST(test_faults_of_one_period_are_all_told)
{
    set_up();
    in.servo_alarm = 2;
    in.fresh = 5;
    arm.stale_periods = 1;
    out.v[1].raw = arm.joint[1].v_max_q24 + 1;
    in.q_ref[1].raw = arm.joint[1].q_max_q24 + 1;
    step();
    ck_assert_uint_eq(out.fault, HDT_FAULT_SERVO | HDT_FAULT_STALE | HDT_FAULT_SPEED | HDT_FAULT_REFERENCE |
                                     HDT_FAULT_FOLLOWING);
    ck_assert_uint_eq(out.fault_joints, 2);
}
END_TEST

START_TEST(test_every_joint_with_a_fault_is_told)
{
    set_up();
    in.servo_alarm = 5;
    step();
    ck_assert_uint_eq(out.fault_joints, 5);
    in.servo_alarm = 2;
    step();
    ck_assert_uint_eq(out.fault_joints, 7);
}
END_TEST

START_TEST(test_joints_the_arm_does_not_have_count_for_nothing)
{
    set_up();
    in.active = ~0u;
    in.fresh = seen;
    out.total[0].raw = 1 << 16;
    step();
    ck_assert_uint_eq(out.fault, 0);
    ck_assert_int_eq(out.digit[0].raw, 20);
    for (int j = JOINTS; j < HDT_JOINTS_MAX; j++) {
        ck_assert_uint_eq(gate.stale[j], 0);
        ck_assert_int_eq(gate.digit[j], 0);
    }
    /* and what stands behind the gate is not the gate's */
    struct { struct hdt_gate gate; uint32_t behind[4]; } both;
    memset(&both, 0x55, sizeof both);
    hdt_gate_clear(&both.gate);
    for (int i = 0; i < 4; i++)
        ck_assert_uint_eq(both.behind[i], 0x55555555u);
    ck_assert_int_eq(both.gate.digit[HDT_JOINTS_MAX - 1], 0);
}
END_TEST

START_TEST(test_smallest_following_limit_holds)
{
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        arm.joint[0].follow_max_q24 = 1;
        in.q_ref[0].raw = side;
        step();
        ck_assert_uint_eq(out.fault, 0);
        in.q_ref[0].raw = 2 * side;
        step();
        ck_assert_uint_eq(out.fault, HDT_FAULT_FOLLOWING);
    }
}
END_TEST

START_TEST(test_outside_its_range_one_digit_is_cut_and_none_is_no_limit)
{
    for (int side = -1; side <= 1; side += 2) {
        for (int digit = 0; digit < 2; digit++) {
            set_up();
            out.q[0].raw = side > 0 ? arm.joint[0].q_max_q24 + 1 : arm.joint[0].q_min_q24 - 1;
            in.q_ref[0].raw = out.q[0].raw - side;
            out.total[0].raw = side * digit * Q(0.05, 16);
            step();
            ck_assert_int_eq(out.digit[0].raw, 0);
            ck_assert_uint_eq(out.limit[0], digit ? HDT_LIM_POSITION : 0);
            in.mode = HDT_MODE_VELOCITY;
            v_cmd[0].raw = side * digit * Q(0.0002, 24);
            step();
            ck_assert_int_eq(out.speed[0].raw, 0);
            ck_assert_uint_eq(out.limit[0], digit ? HDT_LIM_POSITION : 0);
        }
    }
}
END_TEST

START_TEST(test_limits_of_one_period_are_all_told)
{
    for (int side = -1; side <= 1; side += 2) {
        set_up();
        out.q[0].raw = side > 0 ? arm.joint[0].q_max_q24 + 1 : arm.joint[0].q_min_q24 - 1;
        in.q_ref[0].raw = out.q[0].raw - side;
        out.total[0].raw = side * (1000 << 16);
        step();
        ck_assert_int_eq(out.digit[0].raw, 0);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_TORQUE | HDT_LIM_SLEW | HDT_LIM_POSITION);
        in.mode = HDT_MODE_VELOCITY;
        v_cmd[0].raw = side * Q(100, 24);
        step();
        ck_assert_int_eq(out.speed[0].raw, 0);
        ck_assert_uint_eq(out.limit[0], HDT_LIM_SPEED | HDT_LIM_POSITION);
    }
}
END_TEST

START_TEST(test_digits_never_leave_the_envelope)
{
    uint64_t r = 99;
    int let_through = 0;
    for (int n = 0; n < 300; n++) {
        int32_t last[JOINTS] = {0};
        set_up();
        for (int j = 0; j < JOINTS; j++) {
            arm.joint[j].sign = test_random(&r) & 1 ? 1 : -1;
            arm.joint[j].dig_max = 1 + (int32_t)(test_random(&r) % 32767);
            arm.joint[j].dig_slew = 1 + (int32_t)(test_random(&r) % 65535);
            arm.joint[j].spd_max = (int32_t)(test_random(&r) % 32768);
            arm.joint[j].digit_per_nm_q24 = 1 + (int32_t)(test_random(&r) >> 34);
        }
        for (int k = 0; k < 100; k++) {
            in.mode = (uint32_t)(test_random(&r) % 3);
            in.active = (uint32_t)test_random(&r);
            in.fresh = (uint32_t)(test_random(&r) | test_random(&r));
            if (test_random(&r) % 8 == 0)
                hdt_gate_clear(&gate), memset(last, 0, sizeof last);
            for (int j = 0; j < JOINTS; j++) {
                const int wild = test_random(&r) % 50 == 0;
                out.total[j].raw = (int32_t)(test_random(&r) >> (test_random(&r) % 31)) ;
                v_cmd[j].raw = (int32_t)(test_random(&r) >> (test_random(&r) % 31));
                out.q[j].raw = wild ? (int32_t)test_random(&r) : Q(test_uniform(&r, -1.55, 2.05), 24);
                in.q_ref[j].raw = out.q[j].raw;
                out.v[j].raw = Q(test_uniform(&r, -1.005, 1.005), 24);
            }
            step();
            for (int j = 0; j < JOINTS; j++) {
                const struct hdt_joint_tab *t = &arm.joint[j];
                const int32_t d = t->sign * out.digit[j].raw, w = t->sign * out.speed[j].raw;
                ck_assert_int_le(abs(d), t->dig_max);
                ck_assert(d == 0 || abs(d - last[j]) <= t->dig_slew);
                ck_assert_int_le(abs(w), t->spd_max);
                if (out.fault != 0 || !(in.active >> j & 1))
                    ck_assert(d == 0 && w == 0);
                if (in.mode != HDT_MODE_TORQUE)
                    ck_assert_int_eq(d, 0);
                if (in.mode != HDT_MODE_VELOCITY)
                    ck_assert_int_eq(w, 0);
                if (out.q[j].raw > t->q_max_q24)
                    ck_assert(d <= 0 && w <= 0);
                if (out.q[j].raw < t->q_min_q24)
                    ck_assert(d >= 0 && w >= 0);
                let_through += d != 0;
                last[j] = d;
            }
        }
    }
    ck_assert_int_gt(let_through, 1000);
}
END_TEST

static Suite *gate_suite(void)
{
    Suite *s = suite_create("gate");
    TCase *l = tcase_create("limits"), *f = tcase_create("faults"), *e = tcase_create("envelope");
    tcase_add_test(l, test_digits_are_torque_times_scale_to_the_nearest);
    tcase_add_test(l, test_torque_is_cut_at_dig_max_and_not_before);
    tcase_add_test(l, test_slew_is_cut_at_dig_slew_and_not_before);
    tcase_add_test(l, test_outside_its_range_a_joint_is_only_pushed_back);
    tcase_add_test(l, test_speed_words_are_cut_at_spd_max_and_not_before);
    tcase_add_test(l, test_modes_keep_to_their_own_output);
    tcase_add_test(l, test_sign_turns_both_outputs_after_the_limits);
    tcase_add_loop_test(f, test_fault_begins_one_lsb_beyond_its_limit_and_latches, 1, 5);
    tcase_add_test(f, test_stale_counts_periods_in_a_row);
    tcase_add_test(f, test_silence_never_forgets);
    tcase_add_test(f, test_nothing_moves_before_every_driven_joint_was_seen);
    tcase_add_test(f, test_a_joint_not_driven_raises_nothing_and_gets_nothing);
    tcase_add_test(f, test_idle_does_not_judge_the_reference);
    tcase_add_test(f, test_following_limit_of_zero_is_off);
    tcase_add_test(e, test_faults_of_one_period_are_all_told);
    tcase_add_test(e, test_smallest_following_limit_holds);
    tcase_add_test(e, test_every_joint_with_a_fault_is_told);
    tcase_add_test(e, test_joints_the_arm_does_not_have_count_for_nothing);
    tcase_add_test(e, test_outside_its_range_one_digit_is_cut_and_none_is_no_limit);
    tcase_add_test(e, test_limits_of_one_period_are_all_told);
    tcase_add_test(e, test_digits_never_leave_the_envelope);
    suite_add_tcase(s, l);
    suite_add_tcase(s, f);
    suite_add_tcase(s, e);
    return s;
}

HDT_CHECK_MAIN(gate_suite())
