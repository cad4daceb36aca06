/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The cycle against a servo's protocol on a memory bus: start, run, faults, end, and a bus that is
 * broken at every call in turn.  The core is the real one.
 */
#include <stdlib.h>

#include "driver/drv_cycle.h"
#include "tests/broken_bus.h"
#include "sim/servo.h"
#include "tests/check_main.h"
#include "tests/driver_rig.h"
#include "tests/pa10_plant.h"

/* Count allocations: the period must make none. */
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
#define COUNTS_MALLOC 1
extern void *__libc_malloc(size_t size);
static unsigned mallocs;
void *malloc(size_t size)
{
    mallocs++;
    return __libc_malloc(size);
}
#else
static unsigned mallocs;
#endif

/* Everything between core and wire, in one place. */
struct rig {
    struct drv_loop loop;
    struct hdt_bus host;          /* the good host end */
    struct rig_servo servo;
    struct drv_cycle c;
    struct hdt_in in;
    struct hdt_out out;
    uint64_t t_us;
    /* spied on at the cycle's own send */
    struct hdt_bus beneath;
    struct drv_command sent;      /* of the last period, taken by the bus; type 0: none */
    unsigned sends_ok;
};

static int spy_send(void *ctx, const struct hdt_frame *f)
{
    struct rig *r = ctx;
    if (drv_command_decode(DRV_FORMAT_A, f, &r->sent) != DRV_TELEGRAM_OK)
        ck_abort_msg("the cycle sent something that is no command");
    int e = r->beneath.send(r->beneath.ctx, f);
    if (e == HDT_BUS_OK)
        r->sends_ok++;
    else
        r->sent.type = 0;
    return e;
}

static int spy_recv(void *ctx, struct hdt_frame *f)
{
    struct rig *r = ctx;
    return r->beneath.recv(r->beneath.ctx, f);
}

static void rig_init(struct rig *r, struct drv_ring *ring)
{
    memset(r, 0, sizeof *r);
    drv_loop_pair(&r->loop, &r->host, &r->servo.bus);
    r->beneath = r->host;
    struct hdt_bus spy = {.ctx = r, .send = spy_send, .recv = spy_recv};
    ck_assert_int_eq(drv_cycle_init(&r->c, rig_tables(), &spy, ring), HDT_OK);
    r->in.mode = HDT_MODE_TORQUE;
    r->in.active = 0x7f;
    r->t_us = 1000;
}

/* One period, checked for what must hold in every one of them; then the servo answers. */
static void rig_period(struct rig *r)
{
    r->t_us += 1429;
    r->in.t_us = r->t_us;
    r->sent.type = 0;
    ck_assert_int_eq(drv_cycle_period(&r->c, &r->in, &r->out), HDT_OK);
    for (unsigned j = 0; r->sent.type == DRV_CYCLIC && j < DRV_AXES; j++) {
        unsigned mode = r->sent.axis[j].mode;
        int torque = r->sent.axis[j].torque_dig, speed = r->sent.axis[j].speed_dig;
        int parked = mode == DRV_AXIS_BRAKE && torque == 0 && speed == 0;
        int driven = (mode & DRV_AXIS_BRAKE) == 0 && r->out.fault == 0 &&
            (r->in.active >> j & 1u) != 0 &&
                     r->c.in_step && torque == r->out.digit[j].raw && speed == r->out.speed[j].raw;
        if (!parked && !driven)
            ck_abort_msg("axis %u: mode %u, torque %d, speed %d, core %d and %d, fault %u", j, mode,
                         torque,
                         speed, r->out.digit[j].raw, r->out.speed[j].raw, r->out.fault);
    }
    ck_assert_uint_eq(r->sends_ok, r->c.count.received + r->c.count.lost + (r->c.want_type != 0));
    rig_serve(&r->servo);
}

static void rig_periods(struct rig *r, unsigned n)
{
    while (n-- > 0)
        rig_period(r);
}

static void assert_all_braked(const struct drv_command *c)
{
    for (unsigned j = 0; j < DRV_AXES; j++) {
        ck_assert_uint_eq(c->axis[j].mode, DRV_AXIS_BRAKE);
        ck_assert_int_eq(c->axis[j].torque_dig, 0);
        ck_assert_int_eq(c->axis[j].speed_dig, 0);
    }
}

START_TEST(test_start_asks_then_brakes_then_drives)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_START);
    ck_assert_int_eq(r.c.link, DRV_LINK_STARTING);
    rig_period(&r);
    ck_assert_int_eq(r.c.link, DRV_LINK_RUNNING);
    ck_assert_uint_eq(r.sent.type, DRV_CYCLIC);
    assert_all_braked(&r.sent);
    ck_assert_uint_eq(r.in.fresh, 0);
    ck_assert_uint_eq(r.in.active, 0x7f); /* the caller's wish is not overwritten */
    rig_period(&r);
    ck_assert_uint_eq(r.in.fresh, 0x7f);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        ck_assert_uint_eq(r.sent.axis[j].mode, DRV_AXIS_SERVO | DRV_AXIS_TORQUE);
        /* offset 1 N.m, no position error: 20 digits of 0.001 N.m at ratio 50 */
        ck_assert_int_eq(r.sent.axis[j].torque_dig, 20);
    }
    ck_assert_uint_eq(r.c.count.periods, 3);
    ck_assert_uint_eq(r.c.count.received, 2);
    ck_assert_uint_eq(r.c.count.lost, 0);
}
END_TEST

START_TEST(test_digit_follows_the_count_the_servo_reported)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 2);
    /* 0.1 rad at joint 3 is 13037.97 counts: feedback -10 N.m, offset +1: -9 N.m = -180 digits */
    r.servo.state.axis[2].count = 13038;
    rig_periods(&r, 2);
    ck_assert_int_eq(r.in.count[2].raw, 13038);
    ck_assert_int_eq(r.sent.axis[2].torque_dig, -180);
    ck_assert_int_eq(r.servo.last.axis[2].torque_dig, -180);
    ck_assert_int_eq(r.sent.axis[1].torque_dig, 20);
}
END_TEST

START_TEST(test_a_silent_servo_is_asked_every_tenth_period_and_never_driven)
{
    struct rig r;
    rig_init(&r, NULL);
    r.servo.mute = 1;
    for (unsigned n = 0; n < 100; n++) {
        rig_period(&r);
        ck_assert_uint_eq(r.sent.type, n % DRV_CYCLE_RETRY == 0 ? DRV_START : 0);
    }
    ck_assert_uint_eq(r.servo.starts, 10);
    ck_assert_uint_eq(r.servo.cyclic, 0);
    ck_assert_uint_eq(r.c.count.lost, 9); /* the tenth is still awaited */
    ck_assert_uint_eq(r.out.fault, 0);    /* slow to start is not stale */
    r.servo.mute = 0;
    rig_periods(&r, DRV_CYCLE_RETRY + 3);
    ck_assert_int_eq(r.c.link, DRV_LINK_RUNNING);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

START_TEST(test_each_axis_is_told_its_own_mode)
{
    struct rig r;
    rig_init(&r, NULL);
    r.in.active = 0x5b; /* joints 3 and 6 stay parked */
    rig_periods(&r, 4);
    for (unsigned j = 0; j < DRV_AXES; j++)
        ck_assert_uint_eq(r.sent.axis[j].mode,
                          0x5bu >> j & 1u ? DRV_AXIS_SERVO | DRV_AXIS_TORQUE : DRV_AXIS_BRAKE);
    r.in.mode = HDT_MODE_VELOCITY;
    for (unsigned j = 0; j < DRV_AXES; j++)
        r.in.v_ref[j].raw = 1 << 23; /* 0.5 rad/s = 2500 digits of 0.0002 rad/s */
    rig_period(&r);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        ck_assert_uint_eq(r.sent.axis[j].mode, 0x5bu >> j & 1u ? DRV_AXIS_SERVO : DRV_AXIS_BRAKE);
        ck_assert_int_eq(r.sent.axis[j].torque_dig, 0);
        ck_assert_int_eq(r.sent.axis[j].speed_dig, 0x5bu >> j & 1u ? 2500 : 0);
    }
    r.in.mode = HDT_MODE_IDLE;
    rig_period(&r);
    assert_all_braked(&r.sent);
}
END_TEST

static const uint16_t rated_mnm[DRV_AXES] = {4640, 4640, 2000, 2000, 290, 290, 290};

/* One period in Format B, then the servo's answer with this state; returns the command sent. */
static struct drv_command period_b(struct rig *r, struct drv_state s)
{
    struct hdt_frame f;
    struct drv_command c = {0};
    r->t_us += 1429;
    r->in.t_us = r->t_us;
    ck_assert_int_eq(drv_cycle_period(&r->c, &r->in, &r->out), HDT_OK);
    ck_assert_int_eq(r->servo.bus.recv(r->servo.bus.ctx, &f), HDT_BUS_OK);
    ck_assert_int_eq(drv_command_decode(DRV_FORMAT_B, &f, &c), DRV_TELEGRAM_OK);
    s.seq = c.seq;
    s.type = c.type;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_B, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_int_eq(r->servo.bus.send(r->servo.bus.ctx, &f), HDT_BUS_OK);
    return c;
}

START_TEST(test_format_b_is_converted_at_the_wire_and_nowhere_else)
{
    struct rig r;
    struct drv_state s = {0};
    rig_init(&r, NULL);
    r.c.bus = r.host;
    ck_assert_int_eq(drv_cycle_set_format(&r.c, DRV_FORMAT_B, rated_mnm), HDT_OK);
    s.axis[0].torque_dig = 1000; /* 1000 4640 / 4096 = 1132.8 */
    s.axis[4].torque_dig = -4096;
    s.axis[4].count = 100;
    ck_assert_uint_eq(period_b(&r, s).type, DRV_START);
    ck_assert_uint_eq(period_b(&r, s).type, DRV_CYCLIC);
    struct drv_command c = period_b(&r, s);
    /* offset 1 N.m is 20 digits of 0.001 N.m at ratio 50: 17.66 of 4.64/4096, 40.96 of 2.0/4096 */
    static const int want[DRV_AXES] = {18, 18, 41, 41, 0, 282, 282};
    for (unsigned j = 0; j < DRV_AXES; j++) {
        ck_assert_uint_eq(c.axis[j].mode, DRV_AXIS_SERVO | DRV_AXIS_TORQUE | DRV_AXIS_STOP_ALL);
        if (j != 4)
            ck_assert_int_eq(c.axis[j].torque_dig, want[j]);
    }
    /* 100 counts of joint 5: the core's own digits, in the other unit */
    ck_assert_int_eq(c.axis[4].torque_dig, drv_torque_to_b(r.out.digit[4].raw, 290));
    ck_assert_int_eq(r.in.count[4].raw, 100);
    ck_assert_int_ne(r.out.digit[4].raw, 20);
    ck_assert_int_eq(r.c.last.axis[0].torque_dig, 1133);
    ck_assert_int_eq(r.c.last.axis[4].torque_dig, -290);
    ck_assert_uint_eq(c.driver_mode, 0);
    r.in.mode = HDT_MODE_VELOCITY;
    for (unsigned j = 0; j < DRV_AXES; j++)
        r.in.v_ref[j].raw = (int32_t)j << 20;
    c = period_b(&r, s);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        ck_assert_uint_eq(c.axis[j].mode, DRV_AXIS_SERVO | DRV_AXIS_STOP_ALL);
        ck_assert_int_eq(c.axis[j].speed_dig, r.out.speed[j].raw);
    }
    ck_assert_int_gt(c.axis[6].speed_dig, 0);
    ck_assert_uint_eq(r.c.count.bad_frames, 0);
}
END_TEST

/* What of a run reaches the wire, with the limits of a real arm: within dig_max, and from one command to
 * the next within the slew limit (of Format B: and the rounding of two words) or at zero. */
static void limits_on_the_wire(enum drv_format format)
{
    static const uint16_t rated[DRV_AXES] = {20000, 20001, 4640, 2000, 290, 65535, 7777};
    struct rig r;
    int32_t before[DRV_AXES] = {0}; /* 0.001 N.m / 4096 */
    unsigned most = 0;
    rig_init(&r, NULL);
    struct hdt_tables t = *rig_tables();
    rig_real_limits(&t);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        t.joint[j].dig_max = 2000 + 37 * (int32_t)j;
        t.joint[j].follow_max_q24 = 0; /* far from the reference, so that torque is at its limit */
        t.joint[j].kp_q16 = 200 << 16;
    }
    ck_assert_int_eq(drv_cycle_init(&r.c, &t, &r.host, NULL), HDT_OK);
    ck_assert_int_eq(drv_cycle_set_format(&r.c, format, rated), HDT_OK);
    for (unsigned n = 0; n < 900; n++) {
        struct drv_state s = {0};
        struct drv_command c = {0};
        struct hdt_frame f;
        for (unsigned j = 0; j < DRV_AXES; j++)
            r.in.q_ref[j].raw = (n / 100 + j) % 3 == 0 ? 2 << 24 : (n / 100 + j) % 3 == 1 ? -(2 << 24) : 0;
        r.in.mode = n % 250 == 240 ? HDT_MODE_IDLE : HDT_MODE_TORQUE;
        r.in.t_us = r.t_us += n % 70 == 60 ? 0 : 1429; /* some are refused */
        (void)drv_cycle_period(&r.c, &r.in, &r.out);
        ck_assert_int_eq(r.servo.bus.recv(r.servo.bus.ctx, &f), HDT_BUS_OK);
        ck_assert_int_eq(drv_command_decode(format, &f, &c), DRV_TELEGRAM_OK);
        s.seq = c.seq;
        s.type = c.type;
        ck_assert_int_eq(drv_state_encode(format, &s, &f), DRV_TELEGRAM_OK);
        ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
        for (unsigned j = 0; c.type == DRV_CYCLIC && j < DRV_AXES; j++) {
            int32_t unit = format == DRV_FORMAT_B ? rated[j] : 4096, now = c.axis[j].torque_dig * unit;
            int32_t limit = t.joint[j].dig_max * 4096, rounding = format == DRV_FORMAT_B ? unit : 0;
            most += abs(now) > limit - unit;
            if (abs(now) > limit)
                ck_abort_msg("axis %u, period %u: %g of %d digits", j + 1, n, now / 4096.0,
                             (int)t.joint[j].dig_max);
            if (now != 0 && abs(now - before[j]) > t.joint[j].dig_slew * 4096 + rounding)
                ck_abort_msg("axis %u, period %u: from %g to %g digits", j + 1, n, before[j] / 4096.0,
                             now / 4096.0);
            before[j] = now;
        }
    }
    ck_assert_uint_eq(r.out.fault, 0);
    ck_assert_uint_gt(most, 1000); /* the limit was reached */
}

START_TEST(test_what_is_sent_keeps_the_limits_in_both_formats)
{
    limits_on_the_wire(_i ? DRV_FORMAT_B : DRV_FORMAT_A);
}
END_TEST

START_TEST(test_format_b_wants_a_rated_torque_for_every_joint)
{
    struct rig r;
    struct drv_cycle never;
    uint16_t missing[DRV_AXES];
    rig_init(&r, NULL);
    memset(&never, 0, sizeof never);
    memcpy(missing, rated_mnm, sizeof missing);
    missing[6] = 0;
    ck_assert_int_eq(drv_cycle_set_format(&r.c, DRV_FORMAT_B, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_set_format(&r.c, DRV_FORMAT_B, missing), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_set_format(&r.c, (enum drv_format)7, rated_mnm), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_set_format(&never, DRV_FORMAT_A, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_set_format(NULL, DRV_FORMAT_A, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(r.c.format, DRV_FORMAT_A);
    ck_assert_int_eq(drv_cycle_set_format(&r.c, DRV_FORMAT_A, NULL), HDT_OK);
}
END_TEST

START_TEST(test_a_core_fault_brakes_every_axis_and_the_bus_goes_on)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 4);
    r.in.q_ref[4].raw = 4 << 24; /* outside the limits of joint 5 */
    rig_period(&r);
    ck_assert_uint_eq(r.out.fault, HDT_FAULT_REFERENCE);
    ck_assert_uint_eq(r.out.fault_joints, 1u << 4);
    assert_all_braked(&r.sent);
    r.in.q_ref[4].raw = 0;
    rig_periods(&r, 5);
    assert_all_braked(&r.sent);
    ck_assert_uint_eq(r.sent.type, DRV_CYCLIC);
    ck_assert_uint_eq(r.in.fresh, 0x7f);
    ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
    rig_period(&r);
    ck_assert_int_eq(r.sent.axis[4].torque_dig, 20);
}
END_TEST

START_TEST(test_alarm_bits_reach_the_core)
{
    static const struct { uint16_t axis, driver; uint32_t joints; } cases[] = {
        {DRV_ALARM_OVER_VELOCITY << DRV_ALARM_SHIFT, 0, 1u << 1},
        {0xff0, 0, 1u << 1},
        {0x010, 0, 1u << 1},
        {0, DRV_DRIVER_HOST_TIMEOUT << DRV_ALARM_SHIFT, 0x7f},
        /* no alarms: limits, driver flags */
        {DRV_AXIS_LIMIT_POS | DRV_AXIS_LIMIT_NEG, 0xf00f, 0},
    };
    for (unsigned k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        struct rig r;
        rig_init(&r, NULL);
        rig_periods(&r, 4);
        r.servo.state.axis[1].status = cases[k].axis;
        r.servo.state.driver_status = cases[k].driver;
        rig_periods(&r, 2);
        ck_assert_uint_eq(r.in.servo_alarm, cases[k].joints);
        ck_assert_uint_eq(r.out.fault, cases[k].joints ? HDT_FAULT_SERVO : 0);
        ck_assert_uint_eq(r.out.fault_joints, cases[k].joints);
    }
}
END_TEST

START_TEST(test_an_alarm_of_an_axis_not_driven_stops_the_driven_ones)
{
    /* of a joint that is not driven, and of an axis the arm has no joint for */
    static const struct { unsigned axis, joints, active, told; } cases[] = {{6, 7, 1, 0x7f}, {5, 4, 3, 0xf}};
    for (unsigned k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        struct rig r;
        rig_init(&r, NULL);
        struct hdt_tables t = *rig_tables();
        struct hdt_bus spy = r.c.bus;
        t.joints = cases[k].joints;
        ck_assert_int_eq(drv_cycle_init(&r.c, &t, &spy, NULL), HDT_OK);
        r.in.active = cases[k].active;
        rig_periods(&r, 4);
        ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
        r.servo.state.axis[cases[k].axis].status = DRV_ALARM_POWER_MODULE << DRV_ALARM_SHIFT;
        rig_periods(&r, 2);
        ck_assert_uint_eq(r.in.servo_alarm, cases[k].told);
        ck_assert_uint_eq(r.out.fault, HDT_FAULT_SERVO);
        ck_assert_uint_eq(r.out.fault_joints, cases[k].active);
        assert_all_braked(&r.sent);
        /* and its alarm is cleared before control mode is asked for again */
        drv_cycle_restart(&r.c);
        rig_period(&r);
        ck_assert_uint_eq(r.sent.type, DRV_CLEAR);
        ck_assert_uint_eq(r.sent.axis_no, cases[k].axis + 1);
    }
}
END_TEST

/* Replies in a row after which an axis that stays off is an alarm, at 700 Hz: 50 ms and the first. */
#define OFF_REPLIES 36u

START_TEST(test_an_axis_that_stays_off_though_told_on_is_an_alarm)
{
    static const uint16_t off[] = {DRV_AXIS_POWER_OFF, DRV_AXIS_UNCONTROLLABLE};
    struct rig r;
    rig_init(&r, NULL);
    r.in.active = 0x7d; /* joint 2 is not driven: it may be off */
    r.servo.state.axis[1].status = DRV_AXIS_POWER_OFF;
    rig_periods(&r, 300);
    ck_assert_uint_eq(r.out.fault, 0);
    /* a power stage that takes its time, and one that drops out for as long, are no alarm */
    r.servo.state.axis[4].status = off[_i];
    rig_periods(&r, OFF_REPLIES - 1);
    r.servo.state.axis[4].status = 0;
    rig_periods(&r, 2);
    ck_assert_uint_eq(r.out.fault, 0);
    r.servo.state.axis[4].status = off[_i];
    rig_periods(&r, OFF_REPLIES);
    ck_assert_uint_eq(r.out.fault, 0);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
    rig_period(&r);
    ck_assert_uint_eq(r.in.servo_alarm, 1u << 4);
    ck_assert_uint_eq(r.c.unpowered, 1u << 4);
    ck_assert_uint_eq(r.out.fault, HDT_FAULT_SERVO);
    ck_assert_uint_eq(r.out.fault_joints, 1u << 4);
    assert_all_braked(&r.sent);
    /* told to brake, it is rightly off: clear leads back once it can be switched on */
    rig_periods(&r, 3);
    ck_assert_uint_eq(r.in.servo_alarm, 0);
    r.servo.state.axis[4].status = 0;
    drv_cycle_restart(&r.c);
    ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
    rig_periods(&r, 4);
    ck_assert_uint_eq(r.out.fault, 0);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

/* ---- the emulated servo on the other end: it leaves control mode, whatever the core's limits ---- */

struct emulated {
    struct drv_loop loop;
    struct hdt_bus host, servo_bus;
    struct plant_model model;
    struct servo servo;
    struct drv_cycle c;
    struct hdt_in in;
    struct hdt_out out;
};

static struct emulated *emulated_new(enum drv_format format, uint32_t active)
{
    static struct emulated w;
    static const double q0[PA10_JOINTS] = {0};
    struct servo_cfg cfg = {.format = format};
    const char *why = "";
    memset(&w, 0, sizeof w);
    w.model = pa10_plant();
    ck_assert_msg(plant_model_check(&w.model, &why) == 0, "%s", why);
    drv_loop_pair(&w.loop, &w.host, &w.servo_bus);
    servo_init(&w.servo, &w.model, &cfg, q0, 1);
    ck_assert_int_eq(drv_cycle_init(&w.c, rig_tables(), &w.host, NULL), HDT_OK);
    ck_assert_int_eq(drv_cycle_set_format(&w.c, format, rated_mnm), HDT_OK);
    w.in.mode = HDT_MODE_TORQUE;
    w.in.active = active;
    w.in.t_us = 1000;
    return &w;
}

static void emulated_period(struct emulated *w)
{
    w->in.t_us += 1429;
    ck_assert_int_eq(drv_cycle_period(&w->c, &w->in, &w->out), HDT_OK);
    ck_assert_int_ge(servo_serve(&w->servo, &w->servo_bus), 0);
    servo_tick(&w->servo);
    servo_tick(&w->servo);
}

/* Periods until the core's fault; it must have come within 60 ms. */
static void emulated_faults(struct emulated *w)
{
    for (unsigned n = 0; w->out.fault == 0; n++) {
        ck_assert_uint_lt(n, 60 * 7 / 10);
        emulated_period(w);
    }
    ck_assert_uint_eq(w->out.fault, HDT_FAULT_SERVO);
}

START_TEST(test_a_servo_that_left_control_mode_is_noticed)
{
    enum drv_format format = _i ? DRV_FORMAT_B : DRV_FORMAT_A;
    struct emulated *w = emulated_new(format, 1);
    for (unsigned n = 0; n < 300; n++)
        emulated_period(w);
    ck_assert_uint_eq(w->out.fault, 0);
    ck_assert_int_eq(w->servo.s.mode, SERVO_CONTROL);
    ck_assert_uint_eq(w->servo.plant.locked & 1u, 0);
    /* another axis' alarm */
    w->servo.s.alarm[6] = DRV_ALARM_POWER_MODULE;
    emulated_faults(w);
    ck_assert_uint_eq(w->servo.plant.locked & 1u, 1);
    /* a foreign 'E': no alarm, every 'C' is still answered */
    w = emulated_new(format, 0x7f);
    for (unsigned n = 0; n < 300; n++)
        emulated_period(w);
    ck_assert_uint_eq(w->out.fault, 0);
    struct drv_command end = {.type = DRV_END, .seq = 200};
    struct hdt_frame in, out;
    ck_assert_int_eq(drv_command_encode(format, &end, &in), DRV_TELEGRAM_OK);
    ck_assert_int_eq(servo_answer(&w->servo, &in, &out), 1);
    emulated_faults(w);
    ck_assert_uint_eq(w->c.unpowered, 0x7f);
    /* cleared, it is in control mode again */
    drv_cycle_restart(&w->c);
    ck_assert_int_eq(hdt_clear(&w->c.core), HDT_OK);
    for (unsigned n = 0; n < 300; n++)
        emulated_period(w);
    ck_assert_uint_eq(w->out.fault, 0);
    ck_assert_int_eq(w->servo.s.mode, SERVO_CONTROL);
}
END_TEST

START_TEST(test_restart_clears_the_alarm_of_each_axis_before_it_asks_for_control)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 4);
    for (unsigned j = 0; j < DRV_AXES; j += 3)
        r.servo.state.axis[j].status = DRV_ALARM_OVER_VELOCITY << DRV_ALARM_SHIFT | DRV_AXIS_LIMIT_POS;
    rig_periods(&r, 2);
    ck_assert_uint_eq(r.out.fault_joints, 0x49);
    drv_cycle_restart(&r.c);
    ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
    for (unsigned j = 0; j < DRV_AXES; j += 3) {
        rig_period(&r);
        ck_assert_uint_eq(r.sent.type, DRV_CLEAR);
        ck_assert_uint_eq(r.sent.axis_no, j + 1);
    }
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_START);
    rig_period(&r);
    assert_all_braked(&r.sent);
    rig_period(&r);
    ck_assert_uint_eq(r.out.fault, 0);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
    ck_assert_uint_eq(r.c.count.lost, 1); /* of the state in flight at the restart */
    /* nothing is left to clear the next time */
    drv_cycle_restart(&r.c);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_START);
}
END_TEST

START_TEST(test_a_driver_that_does_not_know_clear_is_not_waited_for)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 4);
    r.servo.no_clear = 1;
    r.servo.state.axis[1].status = r.servo.state.axis[5].status = DRV_ALARM_TIMEOUT << DRV_ALARM_SHIFT;
    rig_periods(&r, 2);
    drv_cycle_restart(&r.c);
    ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
    /* one 'A' an axis, as long apart as any question is repeated, then control mode */
    for (unsigned k = 0; k <= 2 * DRV_CYCLE_RETRY; k++) {
        rig_period(&r);
        ck_assert_uint_eq(r.sent.type, k % DRV_CYCLE_RETRY != 0  ? 0
                                       : k < 2 * DRV_CYCLE_RETRY ? DRV_CLEAR
                                                                 : DRV_START);
        ck_assert_uint_eq(r.sent.axis_no, k == 0 ? 2 : k == DRV_CYCLE_RETRY ? 6 : r.sent.axis_no);
    }
    ck_assert_uint_eq(r.c.count.lost, 3);
}
END_TEST

START_TEST(test_late_doubled_and_foreign_telegrams_are_counted_not_used)
{
    struct rig r;
    struct hdt_frame f;
    rig_init(&r, NULL);
    rig_periods(&r, 5);
    ck_assert_uint_eq(r.c.count.received, 4);
    /* the answer waiting, doubled; then one with an old sequence; then noise; then a wrong type */
    struct drv_state s = r.servo.state;
    s.axis[0].count = 1000;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
    s.seq = (uint8_t)(s.seq - 1);
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
    f.len = 59;
    ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
    s.type = DRV_START;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
    rig_period(&r);
    ck_assert_uint_eq(r.c.count.received, 5);
    ck_assert_uint_eq(r.c.count.wrong_seq, 3);
    ck_assert_uint_eq(r.c.count.bad_frames, 1);
    ck_assert_uint_eq(r.c.count.lost, 0);
    ck_assert_int_eq(r.in.count[0].raw, 0);

    /* a reply one period late: lost, then of the wrong sequence, never fresh */
    r.servo.mute = 1;
    rig_period(&r);
    uint8_t missed = r.c.want_seq;
    rig_period(&r);
    ck_assert_uint_eq(r.in.fresh, 0);
    ck_assert_uint_eq(r.c.count.lost, 1);
    s.seq = missed;
    s.type = DRV_CYCLIC;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_int_eq(r.servo.bus.send(r.servo.bus.ctx, &f), HDT_BUS_OK);
    rig_period(&r);
    ck_assert_uint_eq(r.in.fresh, 0);
    ck_assert_uint_eq(r.c.count.wrong_seq, 4);
}
END_TEST

START_TEST(test_silence_longer_than_stale_latches_and_brakes)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 5);
    r.servo.mute = 1;
    unsigned stale = rig_tables()->stale_periods, driven = 0;
    for (unsigned n = 0; n < stale + 5; n++) {
        rig_period(&r);
        driven += r.sent.axis[0].mode != DRV_AXIS_BRAKE;
    }
    ck_assert_uint_eq(r.out.fault, HDT_FAULT_STALE);
    /* the first of these periods still got the answer that was waiting */
    ck_assert_uint_eq(driven, stale);
    assert_all_braked(&r.sent);
    r.servo.mute = 0;
    rig_periods(&r, 3);
    assert_all_braked(&r.sent); /* latched */
}
END_TEST

START_TEST(test_sequence_stays_below_128_through_its_wrap)
{
    struct rig r;
    rig_init(&r, NULL);
    for (unsigned n = 0; n < 400; n++) {
        uint8_t before = r.c.seq;
        rig_period(&r);
        ck_assert_uint_eq(r.sent.seq, (before + 1u) % 128u);
    }
    ck_assert_uint_eq(r.c.count.received, 399);
    ck_assert_uint_eq(r.c.count.lost + r.c.count.wrong_seq, 0);
}
END_TEST

START_TEST(test_end_is_repeated_until_answered_and_nothing_else_is_sent)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 5);
    r.servo.mute = 1;
    ck_assert_int_eq(drv_cycle_end(&r.c), HDT_BUS_OK);
    ck_assert_uint_eq(r.sent.type, DRV_END);
    rig_serve(&r.servo);
    unsigned cyclic = r.servo.cyclic;
    for (unsigned n = 1; n <= 25; n++) {
        rig_period(&r);
        ck_assert_uint_eq(r.sent.type, n % DRV_CYCLE_RETRY == 0 ? DRV_END : 0);
        for (unsigned j = 0; j < DRV_AXES; j++)
            ck_assert_int_eq(r.out.digit[j].raw, 0);
    }
    r.servo.mute = 0;
    unsigned ends = r.servo.ends;
    rig_periods(&r, 40);
    ck_assert_uint_eq(r.servo.ends, ends + 1); /* answered: no more */
    ck_assert_uint_eq(r.servo.cyclic, cyclic);
    ck_assert_int_eq(r.servo.control, 0);
    ck_assert_int_eq(r.c.link, DRV_LINK_ENDED);
    ck_assert_int_eq(drv_cycle_end(&r.c), HDT_BUS_OK); /* once more is allowed */
    drv_cycle_restart(&r.c);
    rig_periods(&r, 4);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

START_TEST(test_an_orderly_end_loses_no_reply)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 50);
    ck_assert_int_eq(drv_cycle_end(&r.c), HDT_BUS_OK);
    rig_serve(&r.servo);
    rig_periods(&r, 2);
    ck_assert_uint_eq(r.c.count.lost, 0);
    ck_assert_uint_eq(r.c.count.received, r.sends_ok);
}
END_TEST

START_TEST(test_time_standing_still_is_an_error_that_brakes)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 5);
    ck_assert_int_eq(drv_cycle_period(&r.c, &r.in, &r.out), HDT_ERR_TIME); /* same t_us again */
    ck_assert_uint_eq(r.sent.type, DRV_CYCLIC);
    assert_all_braked(&r.sent);
    ck_assert_uint_eq(r.c.count.periods, 5);
    rig_serve(&r.servo);
    rig_period(&r);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

static int noise_recv(void *ctx, struct hdt_frame *f)
{
    unsigned *calls = ctx;
    ++*calls;
    f->len = 3;
    return *calls % 2 ? HDT_BUS_OK : HDT_BUS_ERR_FRAME;
}

START_TEST(test_a_flood_cannot_hold_the_period_up)
{
    struct rig r;
    unsigned calls = 0;
    rig_init(&r, NULL);
    r.c.bus.recv = noise_recv;
    r.c.bus.ctx = &calls;
    /* only receive: the link is ended and answered, so nothing is sent */
    r.c.link = DRV_LINK_ENDED;
    r.c.end_answered = 1;
    for (unsigned n = 1; n <= 3; n++) {
        r.in.t_us = n;
        ck_assert_int_eq(drv_cycle_period(&r.c, &r.in, &r.out), HDT_OK);
        ck_assert_uint_eq(calls, n * DRV_CYCLE_DRAIN);
        ck_assert_uint_eq(r.c.count.bad_frames, calls);
    }
}
END_TEST

START_TEST(test_record_is_what_the_core_saw_and_a_full_ring_only_counts)
{
    static struct drv_record slots[8], rec;
    struct drv_ring ring;
    struct rig r;
    hdt_t replay;
    ck_assert_int_eq(drv_ring_init(&ring, slots, 8), 0);
    rig_init(&r, &ring);
    ck_assert_int_eq(hdt_init(&replay, rig_tables()), HDT_OK);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        r.servo.state.axis[j].torque_dig = (int16_t)(100 * (int)j - 300);
        r.servo.state.axis[j].status = (uint16_t)(1u << j % 2);
    }
    r.servo.state.driver_status = 0x0004;
    for (unsigned n = 0; n < 200; n++) {
        struct hdt_out again;
        r.servo.state.axis[1].count += 37;
        r.servo.mute = n % 17 == 3; /* lost replies are part of a record */
        rig_period(&r);
        ck_assert_int_eq(drv_ring_pop(&ring, &rec), 1);
        ck_assert_int_eq(hdt_step(&replay, &rec.in, &again), HDT_OK);
        ck_assert_mem_eq(&again, &rec.out, sizeof again);
        ck_assert_mem_eq(&again, &r.out, sizeof again);
        ck_assert_uint_eq(rec.link, r.c.link);
        if (n < 2)
            continue;
        ck_assert_uint_eq(rec.driver_status, 4);
        for (unsigned j = 0; j < DRV_AXES; j++) {
            ck_assert_int_eq(rec.torque_dig[j], 100 * (int)j - 300);
            ck_assert_uint_eq(rec.status[j], 1u << j % 2);
        }
    }
    ck_assert_uint_eq(r.c.count.log_dropped, 0);
    rig_periods(&r, 20);
    ck_assert_uint_eq(r.c.count.log_dropped, 12);
    ck_assert_uint_eq(r.out.fault, 0);
}
END_TEST

START_TEST(test_period_allocates_nothing)
{
#ifndef COUNTS_MALLOC
    HDT_SKIP("malloc cannot be counted in this build");
#endif
    static struct drv_record slots[512];
    struct drv_ring ring;
    struct rig r;
    ck_assert_int_eq(drv_ring_init(&ring, slots, 512), 0);
    rig_init(&r, &ring);
    r.c.bus = r.host; /* not through the spy, whose assertions allocate */
    free(malloc(1));
    ck_assert_uint_gt(mallocs, 0); /* the counter counts */
    unsigned in_period = 0;
    for (unsigned n = 0; n < 300; n++) {
        r.t_us += 1429;
        r.in.t_us = r.t_us;
        unsigned before = mallocs;
        (void)drv_cycle_period(&r.c, &r.in, &r.out);
        in_period += mallocs - before;
        rig_serve(&r.servo);
    }
    ck_assert_uint_eq(r.c.count.received, 299);
    ck_assert_uint_eq(in_period, 0);
}
END_TEST

START_TEST(test_init_refuses_what_it_cannot_drive)
{
    struct rig r;
    rig_init(&r, NULL);
    struct hdt_tables t = *rig_tables();
    struct drv_cycle c;
    struct hdt_bus half = {.send = r.host.send};
    ck_assert_int_eq(drv_cycle_init(&c, NULL, &r.host, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_init(&c, &t, NULL, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_init(&c, &t, &half, NULL), HDT_ERR_ARG);
    t.joints = DRV_AXES + 1;
    ck_assert_int_eq(drv_cycle_init(&c, &t, &r.host, NULL), HDT_ERR_ARG);
    t.joints = DRV_AXES;
    t.magic ^= 1u;
    ck_assert_int_eq(drv_cycle_init(&c, &t, &r.host, NULL), HDT_ERR_TABLES);
    ck_assert_int_eq(drv_cycle_period(&c, &r.in, &r.out), HDT_ERR_ARG); /* refused, not crashed */
    ck_assert_int_eq(drv_cycle_period(NULL, &r.in, &r.out), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_period(&r.c, NULL, &r.out), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_period(&r.c, &r.in, NULL), HDT_ERR_ARG);
    ck_assert_int_eq(drv_cycle_init(NULL, &t, &r.host, NULL), HDT_ERR_ARG);
}
END_TEST

START_TEST(test_fewer_joints_than_axes_leave_the_rest_braked)
{
    struct rig r;
    rig_init(&r, NULL);
    struct hdt_tables t = *rig_tables();
    t.joints = 4;
    struct hdt_bus spy = r.c.bus;
    ck_assert_int_eq(drv_cycle_init(&r.c, &t, &spy, NULL), HDT_OK);
    r.in.active = ~0u;
    rig_periods(&r, 5);
    ck_assert_uint_eq(r.in.fresh, 0xf);
    for (unsigned j = 0; j < DRV_AXES; j++)
        ck_assert_uint_eq(r.sent.axis[j].mode,
                          j < 4 ? DRV_AXIS_SERVO | DRV_AXIS_TORQUE : DRV_AXIS_BRAKE);
}
END_TEST

/* ---- a bus broken at every call in turn ---------------------------------------------------- */

/* The run that must go well whatever breaks; returns calls the bus saw. */
static unsigned broken_run(struct broken_bus_cfg cfg, struct rig *r, struct broken_bus *f)
{
    rig_init(r, NULL);
    broken_bus_wrap(f, &cfg, &r->host, &r->beneath);
    rig_periods(r, 40);
    return f->called;
}

/* Within this many periods of the last broken call everything runs again: an unanswered 'S' is
 * repeated after DRV_CYCLE_RETRY, then answer, first state. */
#define RECOVERY (2 * DRV_CYCLE_RETRY + 4)

START_TEST(test_one_broken_call_is_counted_and_survived)
{
    enum broken_bus_mode mode = (enum broken_bus_mode)_i;
    unsigned fired = 0;
    for (unsigned n = 1;; n++) {
        struct rig r;
        struct broken_bus f;
        struct broken_bus_cfg cfg = {.mode = mode, .nth = n, .at = n * 7u,
            .flip = (uint8_t)(n * 29u | 1u)};
        if (broken_run(cfg, &r, &f) < n)
            break;
        fired += f.hits;
        rig_periods(&r, RECOVERY);
        /* corrupt payload can look like a runaway or an alarm, and then must fault, not drive */
        if (mode == BROKEN_BUS_CORRUPT)
            ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
        else
            ck_assert_uint_eq(r.out.fault, 0);
        unsigned noticed = (unsigned)(r.c.count.lost + r.c.count.bad_frames + r.c.count.wrong_seq +
                                      r.c.count.send_dropped + r.c.count.bus_down);
        ck_assert_uint_le(noticed, 3);
        /* an empty-handed receive broken into "again" changes nothing; payload damage is not seen */
        if (f.hits && mode != BROKEN_BUS_CORRUPT && mode != BROKEN_BUS_AGAIN)
            ck_assert_uint_ge(noticed, 1);
        uint64_t received = r.c.count.received;
        rig_periods(&r, 10);
        ck_assert_uint_eq(r.c.count.received, received + 10);
        ck_assert_int_eq(r.c.link, DRV_LINK_RUNNING);
        ck_assert_int_eq(r.sent.axis[6].torque_dig, 20);
    }
    ck_assert_uint_gt(fired, 30);
}
END_TEST

START_TEST(test_a_long_break_latches_stale_and_never_drives)
{
    enum broken_bus_mode mode = (enum broken_bus_mode)_i;
    /* two calls a period while nothing arrives: this is longer than stale_periods */
    struct broken_bus_cfg cfg = {.mode = mode, .nth = 40, .calls = 200, .at = 1, .flip = 0x20};
    struct rig r;
    struct broken_bus f;
    rig_init(&r, NULL);
    broken_bus_wrap(&f, &cfg, &r.host, &r.beneath);
    unsigned guard = 0;
    while (f.called < 245 && guard++ < 400)
        rig_period(&r);
    ck_assert_uint_gt(f.hits, 20);
    if (mode == BROKEN_BUS_DUPLICATE) {
        ck_assert_uint_eq(r.out.fault, 0); /* doubles cost nothing but a count */
        ck_assert_uint_gt(r.c.count.wrong_seq, 10);
    } else {
        ck_assert_uint_eq(r.out.fault, HDT_FAULT_STALE);
        for (unsigned j = 0; j < DRV_AXES; j++)
            ck_assert_int_eq(r.out.digit[j].raw, 0);
    }
    rig_periods(&r, RECOVERY);
    ck_assert_int_eq(hdt_clear(&r.c.core), HDT_OK);
    rig_periods(&r, 3);
    ck_assert_int_eq(r.c.link, DRV_LINK_RUNNING);
    ck_assert_int_eq(r.sent.axis[6].torque_dig, 20);
}
END_TEST

START_TEST(test_after_a_broken_link_axes_are_braked_until_a_new_state)
{
    struct rig r;
    struct broken_bus f;
    rig_init(&r, NULL);
    rig_periods(&r, 6);
    /* the next receive finds the peer gone; the servo was restarted meanwhile */
    struct broken_bus_cfg cfg = {.mode = BROKEN_BUS_DOWN, .nth = 1};
    broken_bus_wrap(&f, &cfg, &r.host, &r.beneath);
    rig_period(&r);
    ck_assert_uint_eq(r.c.count.bus_down, 1);
    ck_assert_uint_eq(r.sent.type, DRV_START);
    ck_assert_int_eq(r.out.digit[0].raw, 0);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_CYCLIC);
    assert_all_braked(&r.sent);
    rig_period(&r);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
    ck_assert_uint_eq(r.out.fault, 0); /* shorter than stale_periods */
}
END_TEST

START_TEST(test_a_send_that_finds_the_peer_gone_starts_the_link_over)
{
    struct rig r;
    struct broken_bus f;
    rig_init(&r, NULL);
    rig_periods(&r, 6);
    /* calls of a period: receive the state, receive nothing, send */
    struct broken_bus_cfg cfg = {.mode = BROKEN_BUS_DOWN, .nth = 3};
    broken_bus_wrap(&f, &cfg, &r.host, &r.beneath);
    rig_period(&r);
    ck_assert_uint_eq(f.hits, 1);
    ck_assert_uint_eq(r.c.count.send_dropped, 1);
    ck_assert_int_eq(r.c.link, DRV_LINK_STARTING);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_START);
    rig_period(&r);
    assert_all_braked(&r.sent);
    rig_period(&r);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

START_TEST(test_an_end_the_bus_did_not_take_is_sent_at_the_next_period)
{
    struct rig r;
    struct broken_bus f;
    rig_init(&r, NULL);
    rig_periods(&r, 6);
    /* drv_cycle_end: receive the state, receive nothing, send */
    struct broken_bus_cfg cfg = {.mode = BROKEN_BUS_AGAIN, .nth = 3};
    broken_bus_wrap(&f, &cfg, &r.host, &r.beneath);
    ck_assert_int_eq(drv_cycle_end(&r.c), HDT_BUS_ERR_AGAIN);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_END);
    ck_assert_uint_eq(r.servo.ends, 1);
    ck_assert_int_eq(r.servo.control, 0);
}
END_TEST

START_TEST(test_restart_gives_up_the_reply_in_flight)
{
    struct rig r;
    rig_init(&r, NULL);
    rig_periods(&r, 6);
    drv_cycle_restart(&r.c); /* the servo's answer is already on its way */
    ck_assert_uint_eq(r.c.count.lost, 1);
    rig_period(&r);
    ck_assert_uint_eq(r.sent.type, DRV_START);
    ck_assert_uint_eq(r.c.count.wrong_seq, 1);
    ck_assert_uint_eq(r.in.fresh, 0);
    rig_periods(&r, 3);
    ck_assert_uint_eq(r.c.count.lost, 1);
    ck_assert_int_eq(r.sent.axis[0].torque_dig, 20);
}
END_TEST

static Suite *cycle_suite(void)
{
    Suite *s = suite_create("cycle");
    TCase *t = tcase_create("link");
    tcase_add_test(t, test_start_asks_then_brakes_then_drives);
    tcase_add_test(t, test_a_silent_servo_is_asked_every_tenth_period_and_never_driven);
    tcase_add_test(t, test_sequence_stays_below_128_through_its_wrap);
    tcase_add_test(t, test_end_is_repeated_until_answered_and_nothing_else_is_sent);
    tcase_add_test(t, test_an_orderly_end_loses_no_reply);
    tcase_add_test(t, test_restart_clears_the_alarm_of_each_axis_before_it_asks_for_control);
    tcase_add_test(t, test_a_driver_that_does_not_know_clear_is_not_waited_for);
    tcase_add_test(t, test_init_refuses_what_it_cannot_drive);
    suite_add_tcase(s, t);
    t = tcase_create("command");
    tcase_add_test(t, test_digit_follows_the_count_the_servo_reported);
    tcase_add_test(t, test_each_axis_is_told_its_own_mode);
    tcase_add_test(t, test_format_b_is_converted_at_the_wire_and_nowhere_else);
    tcase_add_loop_test(t, test_what_is_sent_keeps_the_limits_in_both_formats, 0, 2);
    tcase_add_test(t, test_format_b_wants_a_rated_torque_for_every_joint);
    tcase_add_test(t, test_fewer_joints_than_axes_leave_the_rest_braked);
    tcase_add_test(t, test_a_core_fault_brakes_every_axis_and_the_bus_goes_on);
    tcase_add_test(t, test_alarm_bits_reach_the_core);
    tcase_add_test(t, test_an_alarm_of_an_axis_not_driven_stops_the_driven_ones);
    tcase_add_loop_test(t, test_an_axis_that_stays_off_though_told_on_is_an_alarm, 0, 2);
    tcase_add_loop_test(t, test_a_servo_that_left_control_mode_is_noticed, 0, 2);
    tcase_add_test(t, test_silence_longer_than_stale_latches_and_brakes);
    tcase_add_test(t, test_time_standing_still_is_an_error_that_brakes);
    suite_add_tcase(s, t);
    t = tcase_create("counters");
    tcase_add_test(t, test_late_doubled_and_foreign_telegrams_are_counted_not_used);
    tcase_add_test(t, test_a_flood_cannot_hold_the_period_up);
    tcase_add_test(t, test_record_is_what_the_core_saw_and_a_full_ring_only_counts);
    tcase_add_test(t, test_period_allocates_nothing);
    suite_add_tcase(s, t);
    t = tcase_create("broken bus");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, test_one_broken_call_is_counted_and_survived, 0, BROKEN_BUS_MODES);
    tcase_add_loop_test(t, test_a_long_break_latches_stale_and_never_drives, 0, BROKEN_BUS_MODES);
    tcase_add_test(t, test_after_a_broken_link_axes_are_braked_until_a_new_state);
    tcase_add_test(t, test_a_send_that_finds_the_peer_gone_starts_the_link_over);
    tcase_add_test(t, test_an_end_the_bus_did_not_take_is_sent_at_the_next_period);
    tcase_add_test(t, test_restart_gives_up_the_reply_in_flight);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(cycle_suite())
