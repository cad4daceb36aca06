/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The host's phases and the loop around them, in virtual time: a servo reduced to its protocol on a
 * memory bus, a clock that is late when told to.
 * Goal: what an operator asks for happens, smoothly; brakes are on whenever nobody drives; every
 * stop is confirmed or said not to be; late periods are skipped, counted and dealt with.
 */
#include <errno.h>
#include <stdlib.h>

#include "driver/drv_rt.h"
#include "tests/check_main.h"
#include "tests/driver_rig.h"

#define SAMPLES 2000u
#define PERIOD_US 1429u
#define Q24 16777216.0

struct world {
    struct drv_loop loop;
    struct hdt_bus bus;
    struct rig_servo servo;
    struct hdt_tables tables;
    hdt_rad_t q[SAMPLES * DRV_AXES];
    hdt_radps_t v[SAMPLES * DRV_AXES];
    hdt_radps2_t a[SAMPLES * DRV_AXES];
    struct drv_reference ref;
    struct drv_host host;
    struct drv_host_status status;
    char line[1024];
    uint64_t t_us;
    int32_t most_cnt;             /* a joint moves so far a period at most; 0: any way */
};

/* Joint j moves by 0.2 rad there and back, as a cosine, from 0.1 j rad on. */
static struct world *world_new(struct drv_host_cfg cfg)
{
    static struct world w;
    memset(&w, 0, sizeof w);
    w.tables = *rig_tables();
    drv_loop_pair(&w.loop, &w.bus, &w.servo.bus);
    double omega = 2 * 3.14159265358979 / (SAMPLES * PERIOD_US * 1e-6);
    for (unsigned k = 0; k < SAMPLES; k++)
        for (unsigned j = 0; j < DRV_AXES; j++) {
            double x = omega * k * PERIOD_US * 1e-6, c = __builtin_cos(x), s = __builtin_sin(x);
            w.q[k * DRV_AXES + j].raw = (int32_t)((0.1 * j + 0.1 * (1 - c)) * Q24);
            w.v[k * DRV_AXES + j].raw = (int32_t)(0.1 * omega * s * Q24);
            w.a[k * DRV_AXES + j].raw = (int32_t)(0.1 * omega * omega * c * 65536.0);
        }
    w.ref = (struct drv_reference){SAMPLES, DRV_AXES, 0x7f, w.q, w.v, w.a};
    if (cfg.mode == 0)
        cfg.mode = HDT_MODE_TORQUE;
    ck_assert_int_eq(drv_host_init(&w.host, &w.tables, &w.bus, NULL, &w.ref, &cfg), HDT_OK);
    w.t_us = 1000;
    return &w;
}

/* The arm is where it is told to be, less than a digit of torque apart: a perfect servo. */
static void world_serve(struct world *w)
{
    for (unsigned j = 0; j < DRV_AXES && w->host.in.mode != HDT_MODE_IDLE; j++) {
        int32_t *at = &w->servo.state.axis[j].count;
        int32_t to = (int32_t)(w->host.in.q_ref[j].raw / Q24 * RIG_RATIO * 16384 / 6.283185307);
        if (w->most_cnt != 0 && abs(to - *at) > w->most_cnt)
            to = *at + (to > *at ? w->most_cnt : -w->most_cnt);
        *at = to;
    }
    rig_serve(&w->servo);
}

static int braked(const struct world *w)
{
    if (w->servo.cyclic == 0 || w->servo.commands[(w->servo.answered - 1) % 64].type == DRV_END)
        return 1;
    for (unsigned j = 0; j < DRV_AXES; j++)
        if (w->servo.last.axis[j].mode != DRV_AXIS_BRAKE || w->servo.last.axis[j].torque_dig != 0)
            return 0;
    return 1;
}

/* One period; what must hold in every one. */
static enum drv_host_phase world_period(struct world *w)
{
    w->t_us += PERIOD_US;
    enum drv_host_phase phase = drv_host_period(&w->host, w->t_us);
    world_serve(w);
    if (phase != DRV_HOST_APPROACH && phase != DRV_HOST_RUN && phase != DRV_HOST_HOLD && !braked(w))
        ck_abort_msg("driven in phase %s", drv_host_phase_str(phase));
    drv_host_report(&w->host, &w->status);
    return phase;
}

static void world_until(struct world *w, enum drv_host_phase phase, unsigned at_most)
{
    unsigned n = 0;
    while (world_period(w) != phase)
        if (++n > at_most)
            ck_abort_msg("%s after %u periods, expected %s", drv_host_phase_str(w->host.phase), n,
                         drv_host_phase_str(phase));
}

static const char *said(struct world *w)
{
    drv_host_say(&w->status, &w->tables, w->line, sizeof w->line);
    return w->line;
}

static void assert_says(struct world *w, const char *words)
{
    if (strstr(said(w), words) == NULL)
        ck_abort_msg("expected \"%s\" in \"%s\"", words, w->line);
}

static void break_it(struct world *w, uint32_t fault)
{
    switch (fault) {
    case HDT_FAULT_STALE: w->servo.mute = 1; break;
    case HDT_FAULT_SERVO: w->servo.state.axis[2].status = DRV_ALARM_OVER_VELOCITY << DRV_ALARM_SHIFT; break;
    case HDT_FAULT_REFERENCE:
        for (unsigned k = 0; k < SAMPLES; k++)
            w->q[k * DRV_AXES + 4].raw = 4 << 24;
        break;
    case HDT_FAULT_SPEED: w->tables.joint[1].v_max_q24 = 1 << 24; break;
    case HDT_FAULT_FOLLOWING: w->tables.joint[3].follow_max_q24 = 1 << 22; break;
    default: ck_abort();
    }
}

START_TEST(test_without_an_operator_the_run_goes_through_by_itself)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1});
    world_until(w, DRV_HOST_APPROACH, 10);
    world_until(w, DRV_HOST_RUN, 4000);
    /* at full rate: the samples as they are, bit for bit */
    for (unsigned k = 0; k < SAMPLES; k++) {
        ck_assert_int_eq(w->host.phase, DRV_HOST_RUN);
        ck_assert_mem_eq(w->host.in.q_ref, &w->q[k * DRV_AXES], sizeof w->q[0] * DRV_AXES);
        ck_assert_mem_eq(w->host.in.v_ref, &w->v[k * DRV_AXES], sizeof w->v[0] * DRV_AXES);
        ck_assert_mem_eq(w->host.in.a_ref, &w->a[k * DRV_AXES], sizeof w->a[0] * DRV_AXES);
        world_period(w);
    }
    ck_assert_int_eq(w->host.phase, DRV_HOST_HOLD);
    world_until(w, DRV_HOST_ENDING, 80);
    world_until(w, DRV_HOST_DONE, 3);
    assert_says(w, "done: brakes on; the reference was followed to its end");
    ck_assert_int_eq(w->servo.control, 0);
    ck_assert_uint_eq(w->servo.ends, 1);
    ck_assert_uint_eq(w->status.count.lost, 0);
    ck_assert_int_eq(world_period(w), DRV_HOST_DONE);
    ck_assert_uint_eq(w->servo.ends, 1);
}
END_TEST

START_TEST(test_an_operator_is_waited_for_with_brakes_on)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    w->servo.mute = 1;
    for (unsigned n = 0; n < 3000; n++)
        ck_assert_int_eq(world_period(w), DRV_HOST_IDLE);
    assert_says(w, "has not answered 'S'");
    w->servo.mute = 0;
    world_until(w, DRV_HOST_READY, 20);
    assert_says(w, "go starts");
    drv_host_ask(&w->host, DRV_HOST_ASK_HOLD); /* nothing to hold: dropped */
    drv_host_ask(&w->host, DRV_HOST_ASK_CLEAR);
    for (unsigned n = 0; n < 1000; n++)
        ck_assert_int_eq(world_period(w), DRV_HOST_READY);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    ck_assert_int_eq(world_period(w), DRV_HOST_APPROACH);
    world_until(w, DRV_HOST_RUN, 4000);
    world_until(w, DRV_HOST_HOLD, SAMPLES + 2);
    for (unsigned n = 0; n < 1000; n++)
        ck_assert_int_eq(world_period(w), DRV_HOST_HOLD);
    assert_says(w, "at the end of the reference");
    drv_host_ask(&w->host, DRV_HOST_ASK_GO); /* once more from the start */
    world_until(w, DRV_HOST_RUN, 4000);
    ck_assert_uint_eq(w->host.sample, 1);
    drv_host_stop(&w->host);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO); /* a stop is not overwritten */
    world_until(w, DRV_HOST_DONE, 4);
    assert_says(w, "asked for");
}
END_TEST

/* Hold and go at this many periods into a phase: position, velocity and acceleration fit together. */
static void hold_and_go(enum drv_host_phase in_phase, unsigned after)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1, .hold_s = 0.2});
    world_until(w, DRV_HOST_READY, 10);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    world_until(w, in_phase, 4000);
    while (after-- > 0)
        world_period(w);
    struct hdt_in before = w->host.in;
    int rested = 0;
    drv_host_ask(&w->host, DRV_HOST_ASK_HOLD);
    for (unsigned n = 0; n < 1200; n++) {
        if (n == 600) {
            ck_assert_int_eq(w->host.phase, DRV_HOST_HOLD);
            assert_says(w, "asked for; go resumes, stop ends");
            drv_host_ask(&w->host, DRV_HOST_ASK_GO);
        }
        world_period(w);
        rested += w->host.in.v_ref[6].raw == 0 && w->host.in.a_ref[6].raw == 0;
        for (unsigned j = 0; j < DRV_AXES; j++) {
            const struct hdt_in *in = &w->host.in;
            double dt = PERIOD_US * 1e-6, v = in->v_ref[j].raw / Q24, v0 = before.v_ref[j].raw / Q24;
            double moved = (in->q_ref[j].raw - before.q_ref[j].raw) / Q24, a = in->a_ref[j].raw / 65536.0;
            /* first order over a period; the rate's corner makes a of one period wrong by half */
            if (moved - v * dt > 2e-5 || moved - v * dt < -2e-5)
                ck_abort_msg("joint %u, period %u: moved %g rad, v_ref dt %g", j + 1, n, moved, v * dt);
            /* at most 0.25 rad/s taken off in 0.2 s, and what the motion itself has */
            double slope = (v - v0) / dt, a_max = 0.25 / 0.2 + 0.5;
            if (slope > a_max || slope < -a_max || a > a_max || a < -a_max)
                ck_abort_msg("joint %u, period %u: slope %g, a_ref %g rad/s^2", j + 1, n, slope, a);
            if (slope - a > 0.03 || slope - a < -0.03)
                ck_abort_msg("joint %u, period %u: v_ref changes by %g rad/s^2, a_ref is %g", j + 1, n, slope,
                             a);
        }
        before = w->host.in;
    }
    ck_assert_int_gt(rested, 400);
    world_until(w, DRV_HOST_HOLD, 6000);
    ck_assert_uint_ge(w->host.sample, SAMPLES);
    ck_assert_mem_eq(w->host.in.q_ref, &w->q[(SAMPLES - 1) * DRV_AXES], sizeof w->q[0] * DRV_AXES);
}

START_TEST(test_a_hold_slows_down_and_go_resumes_without_a_step)
{
    hold_and_go(DRV_HOST_RUN, 300);
    hold_and_go(DRV_HOST_RUN, 901);
    hold_and_go(DRV_HOST_APPROACH, 500);
}
END_TEST

START_TEST(test_an_arm_parked_outside_its_range_is_brought_back)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1});
    int side = _i ? -1 : 1, farther = 0;
    rig_real_limits(&w->tables);
    w->servo.state.axis[2].count = side * 393748; /* 3.02 rad, limit 3 */
    w->most_cnt = 100;                            /* 0.54 rad/s */
    /* pushed inwards from the first period on, never outwards */
    while (world_period(w) != DRV_HOST_RUN) {
        ck_assert_uint_eq(w->host.out.fault, 0);
        if (w->host.phase != DRV_HOST_APPROACH)
            continue;
        ck_assert_int_le(side * w->host.in.q_ref[2].raw, 3 << 24);
        if (side * w->host.out.q[2].raw <= 3 << 24)
            continue;
        ck_assert_int_le(side * w->servo.last.axis[2].torque_dig, 0);
        farther++;
    }
    ck_assert_int_gt(farther, 0);
    world_until(w, DRV_HOST_DONE, SAMPLES + 100);
    /* further out than a following error may be, feedback may not pull: a fault that says what to do */
    w = world_new((struct drv_host_cfg){.settle_s = 0.1});
    rig_real_limits(&w->tables);
    w->servo.state.axis[2].count = side * 469378; /* 3.6 rad */
    world_until(w, DRV_HOST_FAULTED, 20);
    assert_says(w, "following: joint 3 at ");
    assert_says(w, "limit 0.5000 apart and outside its range, -3.0000 to 3.0000: bring it back by hand");
}
END_TEST

START_TEST(test_a_hold_without_an_operator_stands_for_settle_s_and_ends)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.5, .hold_s = 0.2});
    world_until(w, _i ? DRV_HOST_RUN : DRV_HOST_APPROACH, 4000);
    for (unsigned n = 0; n < 100; n++)
        world_period(w);
    drv_host_ask(&w->host, DRV_HOST_ASK_HOLD_LATE);
    /* 0.2 s to stand and 0.5 s standing */
    unsigned n = 0, stood = 0;
    while (world_period(w) == DRV_HOST_HOLD && n++ < 2000)
        stood += w->host.in.v_ref[6].raw == 0;
    ck_assert_int_eq(w->host.phase, DRV_HOST_ENDING);
    ck_assert_uint_ge(stood, 349);
    ck_assert_uint_le(n, 492);
    world_until(w, DRV_HOST_DONE, 3);
    assert_says(w, "done: brakes on; too many periods were missed (overrun policy)");
}
END_TEST

START_TEST(test_of_several_requests_in_a_period_none_is_overwritten)
{
    static const struct { enum drv_host_request ask[3]; enum drv_host_phase then; } cases[] = {
        {{DRV_HOST_ASK_HOLD, DRV_HOST_ASK_CLEAR, DRV_HOST_ASK_NOTHING}, DRV_HOST_HOLD},
        {{DRV_HOST_ASK_HOLD, DRV_HOST_ASK_GO, DRV_HOST_ASK_NOTHING}, DRV_HOST_HOLD},
        {{DRV_HOST_ASK_GO, DRV_HOST_ASK_HOLD_LATE, DRV_HOST_ASK_CLEAR}, DRV_HOST_HOLD},
        {{DRV_HOST_ASK_HOLD, DRV_HOST_ASK_STOP, DRV_HOST_ASK_HOLD_LATE}, DRV_HOST_ENDING},
        {{DRV_HOST_ASK_STOP_LATE, DRV_HOST_ASK_GO, DRV_HOST_ASK_HOLD}, DRV_HOST_ENDING},
        {{DRV_HOST_ASK_CLEAR, DRV_HOST_ASK_GO, DRV_HOST_ASK_NOTHING}, DRV_HOST_RUN},
    };
    for (unsigned k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        struct world *w = world_new((struct drv_host_cfg){.operated = 1});
        world_until(w, DRV_HOST_READY, 10);
        /* a hold drops a go that came with it, in whatever order */
        drv_host_ask(&w->host, DRV_HOST_ASK_GO);
        drv_host_ask(&w->host, DRV_HOST_ASK_HOLD);
        ck_assert_int_eq(world_period(w), DRV_HOST_READY);
        drv_host_ask(&w->host, DRV_HOST_ASK_GO);
        world_until(w, DRV_HOST_RUN, 4000);
        for (unsigned n = 0; n < 3; n++)
            drv_host_ask(&w->host, cases[k].ask[n]);
        ck_assert_int_eq(world_period(w), cases[k].then);
        /* and in a fault a hold, of no use there, does not keep a clear away */
        if (cases[k].then != DRV_HOST_RUN)
            continue;
        break_it(w, HDT_FAULT_SERVO);
        world_until(w, DRV_HOST_FAULT, 4);
        drv_host_ask(&w->host, DRV_HOST_ASK_CLEAR);
        drv_host_ask(&w->host, DRV_HOST_ASK_HOLD);
        ck_assert_int_eq(world_period(w), DRV_HOST_IDLE);
    }
}
END_TEST

START_TEST(test_a_stall_does_not_make_the_reference_jump)
{
    static const enum drv_host_phase phases[] = {DRV_HOST_APPROACH, DRV_HOST_RUN, DRV_HOST_HOLD};
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    world_until(w, DRV_HOST_READY, 10);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    for (unsigned k = 0; k < 3; k++) {
        if (phases[k] == DRV_HOST_HOLD)
            drv_host_ask(&w->host, DRV_HOST_ASK_HOLD);
        world_until(w, phases[k], 4000);
        for (unsigned n = 0; n < 50; n++)
            world_period(w);
        int32_t before = w->host.in.q_ref[6].raw, v = w->host.in.v_ref[6].raw;
        w->t_us += 20 * PERIOD_US; /* shorter than stale */
        world_period(w);
        ck_assert_int_ne(v, 0);
        ck_assert_double_le((w->host.in.q_ref[6].raw - before) / Q24, v / Q24 * 2.2 * PERIOD_US * 1e-6);
    }
}
END_TEST

/* A period whose time does not advance: refused, no axis driven in it. */
static enum drv_host_phase world_stands_still(struct world *w)
{
    uint64_t errors = w->host.errors;
    enum drv_host_phase phase = drv_host_period(&w->host, w->t_us);
    world_serve(w);
    ck_assert_uint_eq(w->host.errors, errors + 1);
    ck_assert(braked(w));
    drv_host_report(&w->host, &w->status);
    return phase;
}

START_TEST(test_a_refused_period_is_no_measurement)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = _i, .settle_s = 0.1});
    /* 1 rad at every joint; the very first state comes in a period that is refused: not seen */
    for (unsigned j = 0; j < DRV_AXES; j++)
        w->servo.state.axis[j].count = 130380;
    world_period(w);
    world_period(w);
    ck_assert_int_eq(world_stands_still(w), DRV_HOST_IDLE);
    ck_assert_uint_eq(w->status.seen, 0);
    int32_t one = (int32_t)(1.0 * Q24), near = 1 << 12;
    if (_i) {
        world_until(w, DRV_HOST_READY, 3);
        ck_assert_int_le(abs(w->host.out.q[6].raw - one), near);
        ck_assert_int_eq(world_stands_still(w), DRV_HOST_READY);
        ck_assert_int_le(abs(w->host.out.q[6].raw - one), near);
        assert_says(w, "2 periods were refused and not driven: time did not advance");
        /* a go waits for a measurement, and is not lost */
        drv_host_ask(&w->host, DRV_HOST_ASK_GO);
        ck_assert_int_eq(world_stands_still(w), DRV_HOST_READY);
        world_period(w);
        ck_assert_int_eq(w->host.phase, DRV_HOST_READY);
        world_period(w);
        ck_assert_int_eq(w->host.phase, DRV_HOST_APPROACH);
    } else {
        world_until(w, DRV_HOST_APPROACH, 4);
    }
    for (unsigned j = 0; j < DRV_AXES; j++)
        ck_assert_int_le(abs(w->host.in.q_ref[j].raw - one), near);
    /* on the way: one period is lost, the motion goes on from where it was */
    world_until(w, DRV_HOST_RUN, 8000);
    int32_t before = w->host.in.q_ref[6].raw;
    ck_assert_int_eq(world_stands_still(w), DRV_HOST_RUN);
    world_until(w, DRV_HOST_HOLD, SAMPLES + 2);
    ck_assert_int_lt(abs(before - w->q[6].raw), near);
    ck_assert_uint_eq(w->host.out.fault, 0);
}
END_TEST

START_TEST(test_a_stop_nobody_confirms_is_repeated_and_ends)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    world_until(w, DRV_HOST_READY, 10);
    w->servo.mute = 1;
    drv_host_stop(&w->host);
    unsigned n = 0;
    while (world_period(w) != DRV_HOST_DONE)
        ck_assert_uint_lt(++n, 400);
    assert_says(w, "did not confirm the end");
    ck_assert_uint_ge(w->servo.ends, 30); /* every tenth period for half a second */
    ck_assert_uint_ge(n, 340);
}
END_TEST

START_TEST(test_a_servo_that_never_answers_is_silent)
{
    struct world *w = world_new((struct drv_host_cfg){.answer_s = 1});
    w->servo.mute = 1;
    world_until(w, DRV_HOST_SILENT, 720);
    assert_says(w, "never answered");
    ck_assert_uint_eq(w->servo.ends, 1);
}
END_TEST

/* What breaks, and the words it must come with. */
static const struct { uint32_t fault; const char *words[3]; } faults[] = {
    {HDT_FAULT_STALE,
     {"stale: no state from the servo for more than 30 periods of 1.429 ms", "clear", "brakes on"}},
    {HDT_FAULT_SERVO, {"servo", "axis 3: ", "(0x0f)"}},
    {HDT_FAULT_REFERENCE, {"reference: joint 5 reference 4.0000 rad, limits -3.0000 to 3.0000", "clear", ""}},
    {HDT_FAULT_SPEED, {"speed: joint 2 at ", "limit 1.000", ""}},
    {HDT_FAULT_FOLLOWING, {"following: joint 4 at ", "limit 0.2500 apart", ""}},
};

/* Periods until the fault, with the arm of the last two cases pushed away by hand. */
static void until_fault(struct world *w, uint32_t fault)
{
    unsigned n = 0, push = fault == HDT_FAULT_SPEED ? 1u : fault == HDT_FAULT_FOLLOWING ? 3u : 99u;
    while (w->host.phase != DRV_HOST_FAULT && w->host.phase != DRV_HOST_FAULTED) {
        if (++n > 3000)
            ck_abort_msg("no fault: %s", said(w));
        w->t_us += PERIOD_US;
        (void)drv_host_period(&w->host, w->t_us);
        if (push < DRV_AXES)
            w->servo.state.axis[push].count += push == 1 ? 800 : 130;
        rig_serve(&w->servo);
        drv_host_report(&w->host, &w->status);
    }
}

START_TEST(test_a_fault_says_joint_value_and_limit_and_clear_leads_back)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    world_until(w, DRV_HOST_READY, 10);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    world_until(w, DRV_HOST_RUN, 4000);
    break_it(w, faults[_i].fault);
    until_fault(w, faults[_i].fault);
    ck_assert_int_eq(w->host.phase, DRV_HOST_FAULT);
    ck_assert_uint_eq(w->status.fault.fault, faults[_i].fault);
    for (unsigned k = 0; k < 3; k++)
        assert_says(w, faults[_i].words[k]);
    /* it stays, whatever is asked, until cleared; the words stay too */
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    w->servo.mute = 0;
    for (unsigned j = 0; j < DRV_AXES; j++)
        w->servo.state.axis[j].count = 0; /* an alarm stays until 'A' */
    for (unsigned n = 0; n < 100; n++)
        ck_assert_int_eq(world_period(w), DRV_HOST_FAULT);
    assert_says(w, faults[_i].words[0]);
    w->tables = *rig_tables();
    for (unsigned k = 0; k < SAMPLES; k++)
        w->q[k * DRV_AXES + 4].raw = w->q[k * DRV_AXES].raw;
    /* the servo is asked for control mode again, and every joint has to report anew */
    unsigned starts = w->servo.starts;
    drv_host_ask(&w->host, DRV_HOST_ASK_CLEAR);
    ck_assert_int_eq(world_period(w), DRV_HOST_IDLE);
    world_until(w, DRV_HOST_READY, 10);
    ck_assert_uint_eq(w->servo.starts, starts + 1);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    world_until(w, DRV_HOST_RUN, 4000);
    ck_assert_uint_eq(w->host.out.fault, 0);
}
END_TEST

START_TEST(test_a_servo_that_left_control_mode_is_said_and_clear_leads_back)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    world_until(w, DRV_HOST_READY, 10);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    world_until(w, DRV_HOST_RUN, 4000);
    /* a foreign 'E': every 'C' is answered as before */
    for (unsigned j = 0; j < DRV_AXES; j++)
        w->servo.state.axis[j].status = j == 3 ? DRV_AXIS_UNCONTROLLABLE : DRV_AXIS_POWER_OFF;
    world_until(w, DRV_HOST_FAULT, 40);
    assert_says(w, "fault: servo; axis 1: servo power off though told on");
    assert_says(w, "; axis 4: servo uncontrollable though told on");
    for (unsigned j = 0; j < DRV_AXES; j++)
        w->servo.state.axis[j].status = 0;
    drv_host_ask(&w->host, DRV_HOST_ASK_CLEAR);
    world_until(w, DRV_HOST_READY, 10);
    drv_host_ask(&w->host, DRV_HOST_ASK_GO);
    world_until(w, DRV_HOST_RUN, 4000);
}
END_TEST

START_TEST(test_a_fault_without_an_operator_ends_the_run_confirmed)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1});
    world_until(w, DRV_HOST_RUN, 4000);
    break_it(w, HDT_FAULT_SERVO);
    until_fault(w, HDT_FAULT_SERVO);
    ck_assert_int_eq(w->host.phase, DRV_HOST_FAULTED);
    assert_says(w, "axis 3");
    ck_assert_int_eq(w->servo.control, 0);
    ck_assert_uint_eq(w->servo.ends, 1);
}
END_TEST

START_TEST(test_a_short_line_is_cut_and_never_overrun)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1});
    char tight[64];
    world_until(w, DRV_HOST_READY, 10);
    w->status.phase = DRV_HOST_FAULT;
    w->status.fault.fault = 0x1f;
    w->status.fault.joints = 0x7f;
    drv_host_say(&w->status, &w->tables, w->line, sizeof w->line);
    for (unsigned n = 0; n <= 40; n++) {
        memset(tight, 'x', sizeof tight);
        drv_host_say(&w->status, &w->tables, tight, n);
        if (n == 0)
            ck_assert_int_eq(tight[0], 'x');
        else
            ck_assert_uint_eq(strlen(tight), n - 1);
        ck_assert_int_eq(tight[n], 'x');
        ck_assert(n == 0 || strncmp(tight, w->line, n - 1) == 0);
    }
    for (int phase = 0; phase < 12; phase++)
        ck_assert_ptr_nonnull(drv_host_phase_str((enum drv_host_phase)phase));
}
END_TEST

/* ---- the loop, with a clock that is late when told to ---------------------------------------- */

struct slow_clock {
    uint64_t now;
    uint64_t late_ns;          /* of the next wake-up */
    unsigned late_at, late_n;  /* from this sleep on, so many of them */
    unsigned late_every;       /* and again after so many; 0: once */
    unsigned sleeps;
    unsigned go_at, stop_at;   /* at these sleeps somebody asks for a go, a stop */
    enum drv_host_phase phase_then;
    enum drv_host_request asked_then;
    int fail, interrupts;
    struct world *w;
    uint64_t slept_ns[2];      /* lengths of sleep to sleep: shortest, longest */
    uint64_t woken_ns;         /* the last time */
};

static uint64_t slow_now(void *ctx)
{
    return ((struct slow_clock *)ctx)->now;
}

static int slow_sleep(void *ctx, uint64_t t)
{
    struct slow_clock *c = ctx;
    if (c->fail) {
        c->now += 1000000;
        return -EINVAL;
    }
    if (c->interrupts > 0 && c->interrupts--)
        return -EINTR;
    world_serve(c->w);
    if (++c->sleeps == c->go_at)
        drv_host_ask(&c->w->host, DRV_HOST_ASK_GO);
    if (c->sleeps == c->stop_at) {
        c->phase_then = c->w->host.phase;
        c->asked_then = c->w->host.asked;
        drv_host_stop(&c->w->host);
    }
    if (t > c->now)
        c->now = t;
    if (c->sleeps > 1) {
        const uint64_t length = c->now - c->woken_ns;
        c->slept_ns[0] = c->slept_ns[0] == 0 || length < c->slept_ns[0] ? length : c->slept_ns[0];
        c->slept_ns[1] = length > c->slept_ns[1] ? length : c->slept_ns[1];
    }
    c->woken_ns = c->now;
    if (c->sleeps >= c->late_at && c->sleeps < c->late_at + c->late_n)
        c->now += c->late_ns;
    if (c->late_every != 0 && c->sleeps == c->late_at)
        c->late_at += c->late_every;
    return 0;
}

static struct drv_rt *rt_new(struct slow_clock *c, struct world *w, struct drv_rt_cfg cfg,
                             struct drv_rt_mailbox *box)
{
    static struct drv_rt rt;
    struct hdt_clock clock = {c, slow_now, slow_sleep};
    c->now = 5000000000u;
    c->w = w;
    ck_assert_int_eq(drv_rt_init(&rt, &cfg, &clock, 1428571, box, 35), HDT_OK);
    return &rt;
}

START_TEST(test_missed_periods_are_skipped_counted_and_never_made_up_for)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    struct slow_clock c = {.late_ns = 5 * 1428571 + 1000, .late_at = 900, .late_n = 3, .interrupts = 7};
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){0}, NULL);
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    ck_assert_int_eq(w->host.phase, DRV_HOST_DONE);
    ck_assert_uint_eq(rt->timing.missed, 3 * 5);
    ck_assert_uint_eq(rt->timing.wake.n, c.sleeps);
    ck_assert_uint_eq(rt->timing.work.n, c.sleeps);
    ck_assert_uint_eq(rt->timing.wake.max_ns, 5 * 1428571 + 1000);
    ck_assert_uint_eq(w->host.sample, SAMPLES); /* none was left out */
    /* back on the grid: the end is a whole number of periods after the start */
    ck_assert_uint_eq((rt->next_ns - 5000000000u) % 1428571, 0);
}
END_TEST

static const struct {
    enum drv_overrun policy;
    unsigned late;
    enum drv_host_phase then;
    const char *words;
} overruns[] = {
    {DRV_OVERRUN_HOLD, 2, DRV_HOST_RUN, "asked for"},
    {DRV_OVERRUN_HOLD, 3, DRV_HOST_DONE, "overrun policy"}, /* nobody is there to say go */
    {DRV_OVERRUN_STOP, 2, DRV_HOST_RUN, "asked for"},
    {DRV_OVERRUN_STOP, 3, DRV_HOST_DONE, "overrun policy"},
    {DRV_OVERRUN_COUNT, 40, DRV_HOST_RUN, "asked for"},
};

START_TEST(test_too_many_missed_periods_hold_or_stop_as_configured)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    /* two periods missed at a time; four in a second are let pass */
    struct slow_clock c = {.late_ns = 2 * 1428571,
                           .late_at = 900,
                           .late_n = overruns[_i].late,
                           .stop_at = 1500};
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){overruns[_i].policy, 4, 0}, NULL);
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    ck_assert_uint_eq(rt->timing.missed, 2 * overruns[_i].late);
    ck_assert_int_eq(c.stop_at > c.sleeps ? w->host.phase : c.phase_then, overruns[_i].then);
    drv_host_report(&w->host, &w->status);
    assert_says(w, overruns[_i].words);
}
END_TEST

START_TEST(test_an_operator_is_told_of_a_hold_for_missed_periods_and_says_go)
{
    struct world *w = world_new((struct drv_host_cfg){.operated = 1, .approach_radps = 2});
    struct slow_clock c = {.late_ns = 2 * 1428571, .late_at = 900, .late_n = 3, .stop_at = 1500};
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){DRV_OVERRUN_HOLD, 4, 0}, NULL);
    c.go_at = 20;
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    ck_assert_int_eq(c.phase_then, DRV_HOST_HOLD);
    ck_assert_int_eq(c.asked_then, DRV_HOST_ASK_HOLD_LATE);
    ck_assert_int_eq(w->host.phase, DRV_HOST_DONE);
}
END_TEST

START_TEST(test_few_missed_periods_a_second_add_up_to_nothing)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    /* one every 720 periods of 1.43 ms; one in a second is let pass */
    struct slow_clock c = {.late_ns = 1428571, .late_at = 720, .late_n = 1, .late_every = 720};
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){DRV_OVERRUN_STOP, 1, 0}, NULL);
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    ck_assert_uint_ge(rt->timing.missed, 3);
    ck_assert_int_eq(w->host.phase, DRV_HOST_DONE);
    ck_assert_uint_eq(w->host.sample, SAMPLES);
}
END_TEST

START_TEST(test_a_clock_that_fails_ends_the_run)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    struct slow_clock c = {.fail = 1};
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){0}, NULL);
    ck_assert_int_eq(drv_rt_run(rt, &w->host), -EINVAL);
    ck_assert_int_eq(w->host.phase, DRV_HOST_DONE);
}
END_TEST

/* ---- the bus as the clock ---- */

/* A bus that knows when a telegram came: at the last tick of the servo's clock, or, without one, so long
 * after the command it answers. */
struct stamped_bus {
    struct hdt_bus bus;          /* beneath */
    struct slow_clock *clock;
    uint64_t tick_ns, answer_ns; /* one of them */
    unsigned mute_at, mute_n;    /* replies from this one on, so many, are no telegrams */
    int stampless;               /* does not know when */
    unsigned replies;
    uint64_t asked_ns, came_ns;
};

static int stamped_send(void *ctx, const struct hdt_frame *f)
{
    struct stamped_bus *b = ctx;
    b->asked_ns = b->clock->now;
    return b->bus.send(b->bus.ctx, f);
}

static int stamped_recv(void *ctx, struct hdt_frame *f)
{
    struct stamped_bus *b = ctx;
    int e = b->bus.recv(b->bus.ctx, f);
    if (e != HDT_BUS_OK)
        return e;
    b->came_ns = b->tick_ns != 0 ? b->clock->now / b->tick_ns * b->tick_ns : b->asked_ns + b->answer_ns;
    if (b->replies++ - b->mute_at < b->mute_n)
        f->data[1] = 'X'; /* something else, with its stamp */
    return e;
}

static void stamped_health(void *ctx, struct hdt_bus_health *h)
{
    struct stamped_bus *b = ctx;
    memset(h, 0, sizeof *h);
    h->received_ns = b->stampless ? 0 : b->came_ns;
}

#define FOLLOW_PERIOD_NS 1428571
#define FOLLOW_MOST_NS (FOLLOW_PERIOD_NS / DRV_RT_FOLLOW_SHARE + 1)

/* 1400 periods with that bus; what is left of b and c is looked at afterwards. */
static struct drv_rt *follow(struct stamped_bus *b, struct slow_clock *c, uint32_t lead_ns)
{
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    c->stop_at = 1400;
    struct drv_rt *rt = rt_new(c, w, (struct drv_rt_cfg){.follow_lead_ns = lead_ns}, NULL);
    b->bus = w->host.cycle.bus;
    b->clock = c;
    w->host.cycle.bus = (struct hdt_bus){.ctx = b, .send = stamped_send, .recv = stamped_recv,
                                         .health = stamped_health};
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    ck_assert_uint_eq(rt->timing.missed, 0);
    ck_assert_uint_ge(c->sleeps, 1400);
    /* whatever came and whenever, no period is longer or shorter by more than the share */
    ck_assert_uint_ge(c->slept_ns[0], FOLLOW_PERIOD_NS - FOLLOW_MOST_NS);
    ck_assert_uint_le(c->slept_ns[1], FOLLOW_PERIOD_NS + FOLLOW_MOST_NS);
    return rt;
}

static const int ppm[] = {-1000, -100, 0, 100, 1000};
static const uint32_t leads_ns[] = {1, 100000, 300000, 714286, 1000000, 1428570};
enum { PPMS = sizeof ppm / sizeof ppm[0], LEADS = sizeof leads_ns / sizeof leads_ns[0] };

START_TEST(test_a_servo_s_clock_is_followed_whatever_it_is_off_by)
{
    const uint32_t lead = leads_ns[_i / PPMS];
    struct slow_clock c = {.now = 0};
    struct stamped_bus b = {.tick_ns = (uint64_t)(FOLLOW_PERIOD_NS * (1 + ppm[_i % PPMS] * 1e-6))};
    struct drv_rt *rt = follow(&b, &c, lead);
    ck_assert_uint_le(rt->timing.unheard, 2); /* nothing was asked before the first */
    /* periods start the lead before its ticks, to what its clock is off by in three periods */
    const uint64_t after = (c.woken_ns + lead) % b.tick_ns;
    ck_assert_uint_le(after < b.tick_ns / 2 ? after : b.tick_ns - after, 3 * (FOLLOW_PERIOD_NS / 1000 + 1));
}
END_TEST

START_TEST(test_a_servo_that_answers_when_asked_does_not_set_the_rate)
{
    static const uint64_t answers_ns[] = {10000, 250000, 900000};
    struct slow_clock c = {.now = 0};
    struct stamped_bus b = {.answer_ns = answers_ns[_i % 3]};
    follow(&b, &c, leads_ns[_i / 3]);
    const double mean_ns = (double)(c.woken_ns - 5000000000u) / c.sleeps;
    ck_assert_double_eq_tol(mean_ns, FOLLOW_PERIOD_NS, FOLLOW_MOST_NS);
}
END_TEST

START_TEST(test_only_an_awaited_telegram_with_its_time_is_a_tick)
{
    struct slow_clock c = {.now = 0};
    struct stamped_bus b = {.tick_ns = FOLLOW_PERIOD_NS / 3, .mute_n = _i == 0 ? 1400 : 0, .stampless = _i};
    struct drv_rt *rt = follow(&b, &c, 300000);
    ck_assert_uint_eq(rt->timing.unheard, c.sleeps);
    ck_assert_uint_eq(c.slept_ns[0], FOLLOW_PERIOD_NS);
    ck_assert_uint_eq(c.slept_ns[1], FOLLOW_PERIOD_NS);
}
END_TEST

START_TEST(test_a_bus_that_falls_silent_is_replaced_by_the_own_clock)
{
    struct slow_clock c = {.now = 0};
    struct stamped_bus b = {.tick_ns = FOLLOW_PERIOD_NS, .mute_at = 500, .mute_n = 10};
    struct drv_rt *rt = follow(&b, &c, 300000);
    ck_assert_uint_ge(rt->timing.unheard, 10);
    ck_assert_uint_le(rt->timing.unheard, 12);
}
END_TEST

static int ascending(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

START_TEST(test_a_histogram_s_quantiles_are_those_of_the_sorted_times)
{
    static struct drv_hist h;
    static uint64_t t[5000];
    uint64_t seed = 3, sum = 0;
    memset(&h, 0, sizeof h);
    ck_assert_uint_eq(drv_hist_quantile(&h, 0.5), 0);
    for (unsigned k = 0; k < 5000; k++) {
        t[k] = test_random(&seed) >> (30 + test_random(&seed) % 34); /* up to 2^34, every size */
        sum += t[k];
        drv_hist_add(&h, t[k]);
    }
    qsort(t, 5000, sizeof t[0], ascending);
    ck_assert_uint_eq(h.n, 5000);
    ck_assert_uint_eq(h.sum_ns, sum);
    ck_assert_uint_eq(h.max_ns, t[4999]);
    for (unsigned k = 1; k <= 5000; k += 7) {
        uint64_t q = drv_hist_quantile(&h, k / 5000.0), exact = t[k - 1];
        ck_assert_uint_ge(q, exact);
        ck_assert_uint_le(q, exact < 1024 ? 1024 : exact + exact / 8 + 1);
    }
    /* beyond the last class, and the edges themselves */
    drv_hist_add(&h, UINT64_MAX / 2);
    ck_assert_uint_eq(drv_hist_quantile(&h, 1.0), UINT64_MAX / 2);
    for (unsigned k = 0; k + 2 < DRV_HIST_CLASSES; k++) {
        memset(&h, 0, sizeof h);
        drv_hist_add(&h, drv_hist_edge(k) - 1);
        drv_hist_add(&h, drv_hist_edge(k));
        ck_assert_uint_eq(h.in_class[k], 1);
        ck_assert_uint_eq(h.in_class[k + 1], 1);
    }
}
END_TEST

START_TEST(test_a_full_mailbox_drops_and_counts_but_never_the_end)
{
    static struct drv_rt_mailbox box;
    static struct drv_rt_mail mail;
    struct world *w = world_new((struct drv_host_cfg){.settle_s = 0.1, .approach_radps = 2});
    struct slow_clock c = {.stop_at = 1400};
    memset(&box, 0, sizeof box);
    struct drv_rt *rt = rt_new(&c, w, (struct drv_rt_cfg){0}, &box);
    ck_assert_int_eq(drv_rt_run(rt, &w->host), 0);
    /* one every 35 periods from the first on, and one at the end */
    unsigned posted = (c.sleeps + 34) / 35 + 1, taken = 0;
    while (taken < DRV_RT_MAILS - 1 && drv_rt_mail_take(&box, &mail)) {
        ck_assert_int_lt(mail.host.phase, DRV_HOST_DONE);
        ck_assert_uint_eq(mail.host.count.periods, 1 + 35 * taken);
        ck_assert_uint_eq(mail.timing.work.n, 1 + 35 * taken);
        taken++;
    }
    ck_assert_int_eq(drv_rt_mail_take(&box, &mail), 1);
    taken++;
    ck_assert_int_eq(mail.host.phase, DRV_HOST_DONE);
    ck_assert_uint_eq(mail.timing.work.n, rt->timing.work.n);
    ck_assert_int_eq(drv_rt_mail_take(&box, &mail), 0);
    ck_assert_uint_eq(rt->timing.status_dropped, posted - taken);
}
END_TEST

START_TEST(test_init_refuses_what_cannot_run)
{
    struct drv_rt rt;
    struct hdt_clock clock = {NULL, slow_now, slow_sleep}, half = {NULL, slow_now, NULL};
    struct drv_rt_cfg cfg = {0}, long_lead = {.follow_lead_ns = 1428571};
    struct drv_rt_mailbox *box = (struct drv_rt_mailbox *)&rt; /* not touched */
    ck_assert_int_eq(drv_rt_init(NULL, &cfg, &clock, 1, NULL, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, NULL, &clock, 1, NULL, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, &cfg, NULL, 1, NULL, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, &cfg, &half, 1, NULL, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, &cfg, &clock, 0, NULL, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, &cfg, &clock, 1, box, 0), HDT_ERR_ARG);
    ck_assert_int_eq(drv_rt_init(&rt, &long_lead, &clock, 1428571, NULL, 0), HDT_ERR_ARG);
    struct world *w = world_new((struct drv_host_cfg){0});
    struct drv_host_cfg idle = {.mode = HDT_MODE_IDLE};
    ck_assert_int_eq(drv_host_init(&w->host, &w->tables, &w->bus, NULL, &w->ref, &idle), HDT_ERR_ARG);
    ck_assert_int_eq(drv_host_init(&w->host, NULL, &w->bus, NULL, &w->ref, &idle), HDT_ERR_ARG);
    struct drv_host_cfg good = {.mode = HDT_MODE_TORQUE};
    w->ref.active = 0x80; /* an eighth joint: it would never answer */
    ck_assert_int_eq(drv_host_init(&w->host, &w->tables, &w->bus, NULL, &w->ref, &good), HDT_ERR_ARG);
    w->ref.active = 0x40;
    ck_assert_int_eq(drv_host_init(&w->host, &w->tables, &w->bus, NULL, &w->ref, &good), HDT_OK);
}
END_TEST

static Suite *host_suite(void)
{
    Suite *s = suite_create("host");
    TCase *t = tcase_create("phases");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_without_an_operator_the_run_goes_through_by_itself);
    tcase_add_test(t, test_an_operator_is_waited_for_with_brakes_on);
    tcase_add_test(t, test_a_hold_slows_down_and_go_resumes_without_a_step);
    tcase_add_loop_test(t, test_an_arm_parked_outside_its_range_is_brought_back, 0, 2);
    tcase_add_loop_test(t, test_a_hold_without_an_operator_stands_for_settle_s_and_ends, 0, 2);
    tcase_add_test(t, test_of_several_requests_in_a_period_none_is_overwritten);
    tcase_add_test(t, test_a_stall_does_not_make_the_reference_jump);
    tcase_add_loop_test(t, test_a_refused_period_is_no_measurement, 0, 2);
    tcase_add_test(t, test_a_stop_nobody_confirms_is_repeated_and_ends);
    tcase_add_test(t, test_a_servo_that_never_answers_is_silent);
    tcase_add_loop_test(t, test_a_fault_says_joint_value_and_limit_and_clear_leads_back, 0,
                        sizeof faults / sizeof faults[0]);
    tcase_add_test(t, test_a_servo_that_left_control_mode_is_said_and_clear_leads_back);
    tcase_add_test(t, test_a_fault_without_an_operator_ends_the_run_confirmed);
    tcase_add_test(t, test_a_short_line_is_cut_and_never_overrun);
    tcase_add_test(t, test_init_refuses_what_cannot_run);
    suite_add_tcase(s, t);
    t = tcase_create("loop");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_missed_periods_are_skipped_counted_and_never_made_up_for);
    tcase_add_loop_test(t, test_too_many_missed_periods_hold_or_stop_as_configured, 0,
                        sizeof overruns / sizeof overruns[0]);
    tcase_add_test(t, test_an_operator_is_told_of_a_hold_for_missed_periods_and_says_go);
    tcase_add_test(t, test_few_missed_periods_a_second_add_up_to_nothing);
    tcase_add_test(t, test_a_clock_that_fails_ends_the_run);
    tcase_add_loop_test(t, test_a_servo_s_clock_is_followed_whatever_it_is_off_by, 0, PPMS * LEADS);
    tcase_add_loop_test(t, test_a_servo_that_answers_when_asked_does_not_set_the_rate, 0, 3 * LEADS);
    tcase_add_loop_test(t, test_only_an_awaited_telegram_with_its_time_is_a_tick, 0, 2);
    tcase_add_test(t, test_a_bus_that_falls_silent_is_replaced_by_the_own_clock);
    tcase_add_test(t, test_a_histogram_s_quantiles_are_those_of_the_sorted_times);
    tcase_add_test(t, test_a_full_mailbox_drops_and_counts_but_never_the_end);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(host_suite())
