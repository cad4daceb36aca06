/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ARCNET timing: the formula against a table worked out beside it, the ring against a reference that
 * passes every token one by one, and the real cycle over it.
 *
 * Owns: properties of sim/arcnet.c.
 * Never: looks at a clock.
 */
#include <string.h>

#include "sim/arcnet.h"
#include "sim/servo.h"
#include "tests/check_main.h"
#include "tests/driver_rig.h"
#include "tests/pa10_plant.h"

static struct arcnet_line line_at(double mbps)
{
    return (struct arcnet_line){ .bit_ns = arcnet_bit_ns(mbps) };
}

static struct hdt_frame frame_of(unsigned len, unsigned mark)
{
    struct hdt_frame f = { .len = (uint16_t)len };
    memset(f.data, (int)mark, len);
    return f;
}

/* ---- the formula ---- */

START_TEST(test_rotation_times_are_those_of_the_table)
{
    /* both nodes send once a rotation; us at 2.5, 5, 10 Mbit/s; rounded to 0.1 us */
    static const struct {
        unsigned down, up;
        double us[3];
    } row[] = {
        { 0, 0, { 56.6, 28.3, 14.2 } },          { 37, 60, { 709.8, 354.9, 177.5 } },
        { 46, 74, { 811.0, 405.5, 202.8 } },     { 2, 2, { 300.6, 150.3, 75.2 } },
        { 253, 253, { 2509.4, 1254.7, 627.4 } }, { 253, 0, { 1283.0, 641.5, 320.8 } },
        { 508, 508, { 4762.2, 2381.1, 1190.6 } },
    };
    static const double mbps[3] = { 2.5, 5, 10 };
    for (size_t k = 0; k < sizeof row / sizeof row[0]; k++)
        for (int r = 0; r < 3; r++) {
            struct arcnet_line line = line_at(mbps[r]);
            double us = (double)arcnet_rotation_ns(&line, row[k].down, row[k].up) * 1e-3;
            ck_assert_double_eq_tol(us, row[k].us[r], 0.1);
        }
    struct arcnet_line slow = line_at(2.5);
    ck_assert_double_eq_tol((double)arcnet_message_ns(&slow, 37) * 1e-3, 276.0, 0.1);
    ck_assert_double_eq_tol((double)arcnet_message_ns(&slow, 60) * 1e-3, 377.2, 0.1);
    /* a byte more is 11 bits more, 4.4 us */
    ck_assert_uint_eq(arcnet_message_ns(&slow, 38) - arcnet_message_ns(&slow, 37), 4400);
}
END_TEST

START_TEST(test_all_times_scale_with_the_bit_and_propagation_adds)
{
    struct arcnet_line fast = line_at(10);
    for (double mbps = 5; mbps > 0.1; mbps /= 2) {
        struct arcnet_line slow = line_at(mbps);
        uint64_t times = (uint64_t)(10 / mbps);
        ck_assert_uint_eq(arcnet_token_ns(&slow), times * arcnet_token_ns(&fast));
        ck_assert_uint_eq(arcnet_message_ns(&slow, 100), times * arcnet_message_ns(&fast, 100));
        ck_assert_uint_eq(arcnet_arrival_ns(&slow, 100), times * arcnet_arrival_ns(&fast, 100));
        ck_assert_uint_eq(arcnet_refusal_ns(&slow), times * arcnet_refusal_ns(&fast));
        ck_assert_uint_eq(arcnet_reconfiguration_ns(&slow), times * arcnet_reconfiguration_ns(&fast));
    }
    struct arcnet_line far = fast;
    far.propagation_ns = 1000;
    ck_assert_uint_eq(arcnet_token_ns(&far), arcnet_token_ns(&fast) + 1000);
    ck_assert_uint_eq(arcnet_message_ns(&far, 37), arcnet_message_ns(&fast, 37) + 4000);
    ck_assert_uint_eq(arcnet_arrival_ns(&far, 37), arcnet_arrival_ns(&fast, 37) + 3000);
    /* what is left after the arrival is the acknowledgement: 17 bits and its turn-around */
    ck_assert_uint_eq(arcnet_message_ns(&fast, 37) - arcnet_arrival_ns(&fast, 37), 1700 + 2 * 3175);
}
END_TEST

START_TEST(test_rates_and_lengths_there_are_not_give_nothing)
{
    static const double none[] = { 0, -5, 3, 20, 4.999, 0.1, 1e9 };
    for (size_t k = 0; k < sizeof none / sizeof none[0]; k++)
        ck_assert_uint_eq(arcnet_bit_ns(none[k]), 0);
    ck_assert_uint_eq(arcnet_bit_ns(0.15625), 6400);
    struct arcnet_line line = line_at(5);
    for (unsigned len = 0; len < 600; len++) {
        int there = (len >= 1 && len <= 253) || (len >= 257 && len <= 508);
        ck_assert_int_eq(arcnet_message_ns(&line, len) > 0, there);
        ck_assert_int_eq(arcnet_arrival_ns(&line, len) > 0, there);
    }
    struct arcnet_ring ring, before;
    struct hdt_bus host, servo;
    memset(&ring, 0x5a, sizeof ring);
    before = ring;
    line.bit_ns = 150;
    ck_assert_int_eq(arcnet_ring_open(&ring, &line, &host, &servo), -1);
    line.bit_ns = 0;
    ck_assert_int_eq(arcnet_ring_open(&ring, &line, &host, &servo), -1);
    ck_assert(memcmp(&before, &ring, sizeof ring) == 0);
}
END_TEST

/* Facts of the chip, at 2.5 Mbit/s: 253 addresses of 15.6 us and 74.7 us each. */
START_TEST(test_a_lost_token_costs_the_search_for_the_next_node)
{
    struct arcnet_line line = line_at(2.5);
    ck_assert_double_eq_tol((double)arcnet_reconfiguration_ns(&line) * 1e-3, 253 * (15.6 + 74.7) + 28.3, 0.1);
}
END_TEST

/* ---- the ring ---- */

struct rig { struct arcnet_ring ring; struct hdt_bus bus[2]; };

static void open_rig(struct rig *r, double mbps)
{
    struct arcnet_line line = line_at(mbps);
    ck_assert_int_eq(arcnet_ring_open(&r->ring, &line, &r->bus[0], &r->bus[1]), 0);
}

static int hand_in(struct rig *r, int side, uint64_t t_ns, const struct hdt_frame *f)
{
    arcnet_advance(&r->ring, t_ns);
    return r->bus[side].send(r->bus[side].ctx, f);
}

static int fetch(struct rig *r, int side, uint64_t t_ns, struct hdt_frame *f)
{
    arcnet_advance(&r->ring, t_ns);
    return r->bus[side].recv(r->bus[side].ctx, f);
}

START_TEST(test_a_frame_arrives_to_the_nanosecond_when_its_token_came)
{
    /* 5 Mbit/s: a token pass is 39 x 200 + 6350 = 14150 ns, a rotation two of them; a frame of 37 is
     * there after (39 + 17 + 490) x 200 + 2 x 6350 = 121900 ns.  The host's turns: 0, 28300, ... */
    static const struct {
        uint64_t in_ns, there_ns;
        int from;
    } at[] = {
        { 1, 28300 + 121900, HDT_BUS_HOST },          { 28299, 28300 + 121900, HDT_BUS_HOST },
        { 28300, 56600 + 121900, HDT_BUS_HOST }, /* the turn of this very moment is over */
        { 1, 14150 + 121900, HDT_BUS_SERVO },         { 14151, 42450 + 121900, HDT_BUS_SERVO },
        { 2830000000000001, 2830000000028300 + 121900, HDT_BUS_HOST },
    };
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        struct rig r;
        struct hdt_frame f = frame_of(37, 0x77), got;
        open_rig(&r, 5);
        ck_assert_int_eq(hand_in(&r, at[k].from, at[k].in_ns, &f), HDT_BUS_OK);
        ck_assert_int_eq(fetch(&r, !at[k].from, at[k].there_ns - 1, &got), HDT_BUS_ERR_AGAIN);
        ck_assert_int_eq(fetch(&r, !at[k].from, at[k].there_ns, &got), HDT_BUS_OK);
        ck_assert_uint_eq(got.len, 37);
        ck_assert_mem_eq(got.data, f.data, 37);
        ck_assert_int_eq(fetch(&r, !at[k].from, at[k].there_ns, &got), HDT_BUS_ERR_AGAIN);
        ck_assert_int_eq(fetch(&r, at[k].from, at[k].there_ns, &got), HDT_BUS_ERR_AGAIN); /* not one's own */
    }
}
END_TEST

/* Traffic: when which node hands in how much.  Sparse enough that no node has more than a frame. */
enum { FRAMES = 400 };
struct traffic { uint64_t in_ns; int from; unsigned len; };

static void random_traffic(struct traffic *t, uint64_t seed)
{
    uint64_t now_ns = 0;
    for (int k = 0; k < FRAMES; k++) {
        now_ns += 1000000 + test_random(&seed) % (k % 10 ? 700000 : 50000000);
        t[k] = (struct traffic){ now_ns, (int)(test_random(&seed) % 2),
                                 (unsigned)(1 + test_random(&seed) % 253) };
    }
}

/* Reference: every token pass from time 0 on, in quarter bits of 200 ns, written from the frames of
 * the protocol.  Never more than one frame waits. */
static void reference(const struct traffic *t, uint64_t *there_ns)
{
    uint64_t quarter_ns = 50, now = 0, turn = 127;
    int holder = 0;
    for (int k = 0; k < FRAMES;) {
        if (t[k].from == holder && t[k].in_ns < now * quarter_ns) {
            uint64_t packet = 6 + 11 * (1 + 1 + 2 + 1 + t[k].len + 2);
            now += 4 * 39 + turn + 4 * 17 + turn + 4 * packet;
            there_ns[k] = now * quarter_ns;
            now += turn + 4 * 17 + turn;
            k++;
        }
        now += 4 * 39 + turn;
        holder = !holder;
    }
}

START_TEST(test_ring_agrees_with_every_token_passed_one_by_one)
{
    static struct traffic t[FRAMES];
    static uint64_t want_ns[FRAMES];
    for (uint64_t seed = 1; seed <= 5; seed++) {
        struct rig r;
        random_traffic(t, seed);
        reference(t, want_ns);
        open_rig(&r, 5);
        for (int k = 0; k < FRAMES; k++) {
            struct hdt_frame f = frame_of(t[k].len, (unsigned)k & 0xff), got;
            ck_assert_int_eq(hand_in(&r, t[k].from, t[k].in_ns, &f), HDT_BUS_OK);
            ck_assert_int_eq(fetch(&r, !t[k].from, want_ns[k] - 1, &got), HDT_BUS_ERR_AGAIN);
            ck_assert_int_eq(fetch(&r, !t[k].from, want_ns[k], &got), HDT_BUS_OK);
            ck_assert_uint_eq(got.len, t[k].len);
            ck_assert_mem_eq(got.data, f.data, f.len);
        }
        ck_assert_uint_eq(r.ring.messages, FRAMES);
        ck_assert_uint_eq(r.ring.refused, 0);
    }
}
END_TEST

/* The same traffic with time moved in random steps: nothing depends on how often one looks. */
START_TEST(test_time_may_move_in_any_steps)
{
    static struct traffic t[FRAMES];
    uint64_t rng = 7;
    struct rig once, often;
    random_traffic(t, 3);
    open_rig(&once, 2.5);
    open_rig(&often, 2.5);
    for (int k = 0; k < FRAMES; k++) {
        struct hdt_frame f = frame_of(t[k].len, 1), got;
        while (often.ring.now_ns < t[k].in_ns)
            arcnet_advance(&often.ring, often.ring.now_ns + 1 + test_random(&rng) % 90000);
        uint64_t in_ns = often.ring.now_ns;
        arcnet_advance(&often.ring, in_ns - 1); /* back: ignored */
        ck_assert_uint_eq(often.ring.now_ns, in_ns);
        ck_assert_int_eq(hand_in(&once, t[k].from, in_ns, &f), HDT_BUS_OK);
        ck_assert_int_eq(hand_in(&often, t[k].from, in_ns, &f), HDT_BUS_OK);
        ck_assert_uint_eq(once.ring.token_ns, often.ring.token_ns);
        ck_assert_int_eq(once.ring.holder, often.ring.holder);
        while (fetch(&often, !t[k].from, often.ring.now_ns, &got) != HDT_BUS_OK)
            arcnet_advance(&often.ring, arcnet_next_ns(&often.ring));
        uint64_t there_ns = often.ring.now_ns;
        ck_assert_int_eq(fetch(&once, !t[k].from, there_ns - 1, &got), HDT_BUS_ERR_AGAIN);
        ck_assert_int_eq(fetch(&once, !t[k].from, there_ns, &got), HDT_BUS_OK);
    }
    ck_assert_uint_eq(arcnet_next_ns(&often.ring), UINT64_MAX);
}
END_TEST

START_TEST(test_full_buffers_hold_back_and_lose_nothing)
{
    struct rig r;
    struct hdt_frame got;
    unsigned sent = 0, received = 0;
    open_rig(&r, 10);
    while (received < 50) {
        /* a sender that never rests, a receiver that looks every 3 ms */
        uint64_t t_ns = r.ring.now_ns + 100000;
        struct hdt_frame f = frame_of(20, sent);
        int e = hand_in(&r, HDT_BUS_HOST, t_ns, &f);
        ck_assert(e == HDT_BUS_OK || e == HDT_BUS_ERR_AGAIN);
        sent += e == HDT_BUS_OK;
        while (t_ns % 3000000 == 0 && fetch(&r, HDT_BUS_SERVO, t_ns, &got) == HDT_BUS_OK)
            ck_assert_uint_eq(got.data[0], received++ & 0xff); /* in order */
    }
    ck_assert_uint_eq(sent - received, r.ring.node[0].send.count + r.ring.node[1].received.count);
    ck_assert_uint_gt(r.ring.refused, 100);
    ck_assert_uint_lt(sent, 60);
    struct hdt_frame none = { .len = 0 }, longer = { .len = 254 };
    ck_assert_int_eq(hand_in(&r, HDT_BUS_SERVO, 0, &none), HDT_BUS_ERR_FRAME);
    ck_assert_int_eq(hand_in(&r, HDT_BUS_SERVO, 0, &longer), HDT_BUS_ERR_FRAME);
}
END_TEST

/* When a frame handed in at 1 ns is there. */
static uint64_t arrival(unsigned refuse, unsigned lose)
{
    struct rig r;
    struct hdt_frame f = frame_of(37, 1), got;
    open_rig(&r, 5);
    arcnet_advance(&r.ring, 1);
    arcnet_refuse(&r.ring, refuse);
    arcnet_lose_token(&r.ring, lose);
    ck_assert_int_eq(hand_in(&r, HDT_BUS_HOST, 1, &f), HDT_BUS_OK);
    while (fetch(&r, HDT_BUS_SERVO, r.ring.now_ns, &got) != HDT_BUS_OK)
        arcnet_advance(&r.ring, arcnet_next_ns(&r.ring));
    ck_assert_uint_eq(r.ring.refused, refuse);
    ck_assert_uint_eq(r.ring.reconfigurations, lose);
    return r.ring.now_ns;
}

START_TEST(test_a_refusal_costs_a_rotation_and_a_lost_token_a_reconfiguration)
{
    struct arcnet_line line = line_at(5);
    uint64_t around_ns = arcnet_rotation_ns(&line, 0, 0) + arcnet_refusal_ns(&line);
    uint64_t lost_ns = arcnet_reconfiguration_ns(&line) - arcnet_token_ns(&line);
    for (unsigned k = 0; k < 4; k++) {
        ck_assert_uint_eq(arrival(k, 0), arrival(0, 0) + k * around_ns);
        if (k <= 1) /* the servo driver's pass is the only one before the host's turn */
            ck_assert_uint_eq(arrival(0, k), arrival(0, 0) + k * lost_ns);
    }
}
END_TEST

START_TEST(test_a_copy_of_the_ring_goes_on_alike)
{
    struct rig r, copy;
    struct hdt_frame f = frame_of(37, 1);
    open_rig(&r, 5);
    ck_assert_int_eq(hand_in(&r, HDT_BUS_HOST, 12345, &f), HDT_BUS_OK);
    copy = r;
    arcnet_advance(&r.ring, 900000);
    arcnet_advance(&copy.ring, 900000);
    ck_assert(memcmp(&r.ring, &copy.ring, sizeof r.ring) == 0);
}
END_TEST

/* ---- the cycle over it ---- */

enum { HOST_NS = 1428571, TICK_NS = 664894, PERIODS = 699 };

/* A second of the host at 700 Hz, a servo driver that looks 1504 times a second, and a token lost
 * every so often (0: never).  Returns the cycle as it is then. */
static const struct drv_cycle *run_cycle(double mbps, uint64_t lose_every_ns)
{
    static struct drv_cycle c;
    static struct rig_servo servo;
    static struct rig r;
    struct hdt_in in = { .mode = HDT_MODE_TORQUE, .active = 0x7f };
    struct hdt_out out;
    memset(&servo, 0, sizeof servo);
    open_rig(&r, mbps);
    servo.bus = r.bus[HDT_BUS_SERVO];
    ck_assert_int_eq(drv_cycle_init(&c, rig_tables(), &r.bus[HDT_BUS_HOST], NULL), HDT_OK);
    uint64_t host_ns = HOST_NS, tick_ns = TICK_NS, loss_ns = lose_every_ns ? lose_every_ns : UINT64_MAX;
    for (int k = 0; k <= PERIODS;) {
        arcnet_advance(&r.ring, host_ns < tick_ns ? host_ns : tick_ns);
        if (r.ring.now_ns >= loss_ns) {
            arcnet_lose_token(&r.ring, 1);
            loss_ns += lose_every_ns;
        }
        if (r.ring.now_ns == host_ns) {
            in.t_us = host_ns / 1000;
            ck_assert_int_eq(drv_cycle_period(&c, &in, &out), HDT_OK);
            host_ns += HOST_NS;
            k++;
        } else {
            rig_serve(&servo);
            tick_ns += TICK_NS;
        }
    }
    ck_assert_uint_eq(out.fault, 0);
    return &c;
}

START_TEST(test_seven_hundred_hertz_fit_at_2_5_megabit_and_not_at_half_of_it)
{
    static const double enough[] = { 10, 5, 2.5 };
    for (int k = 0; k < 3; k++) {
        const struct drv_cycle *c = run_cycle(enough[k], 0);
        ck_assert_uint_eq(c->count.lost, 0);
        ck_assert_uint_eq(c->count.received, PERIODS);
        ck_assert_uint_eq(c->count.wrong_seq + c->count.send_dropped + c->count.bad_frames, 0);
    }
    /* command, state and tokens take 1.42 ms of the 1.43, and the servo driver looks when it looks:
     * nearly every state is a period late */
    const struct drv_cycle *c = run_cycle(1.25, 0);
    ck_assert_uint_gt(c->count.lost, PERIODS / 2);
    ck_assert_uint_gt(c->count.wrong_seq, PERIODS / 2);
}
END_TEST

START_TEST(test_the_cycle_rides_out_lost_tokens)
{
    /* four of them, 11.5 ms each at 5 Mbit/s: eight periods and what they overlap */
    const struct drv_cycle *c = run_cycle(5, 200000000);
    uint64_t missing = PERIODS - c->count.received;
    ck_assert_uint_ge(missing, 4 * 8);
    ck_assert_uint_le(missing, 4 * 10);
    ck_assert_int_eq(c->link, DRV_LINK_RUNNING);
    ck_assert_uint_eq(c->count.bus_down, 0);
}
END_TEST

/* The emulated servo, told speed zero at 700 Hz for 60 ms; one token is lost after 20. */
static enum servo_mode mode_after_a_lost_token(enum drv_format format, double mbps)
{
    static struct plant_model model;
    static struct servo servo;
    static struct rig r;
    static const double q[PA10_JOINTS] = { 0, -0.5, 0, 1, 0, 0.5, 0 };
    struct servo_cfg cfg = { .format = format };
    const char *why = "";
    model = pa10_plant();
    ck_assert_msg(plant_model_check(&model, &why) == 0, "%s", why);
    servo_init(&servo, &model, &cfg, q, 1);
    open_rig(&r, mbps);
    uint64_t host_ns = 0, tick_ns = TICK_NS;
    for (int k = 0; k < 42;) {
        arcnet_advance(&r.ring, host_ns < tick_ns ? host_ns : tick_ns);
        if (r.ring.now_ns == tick_ns) {
            servo_serve(&servo, &r.bus[HDT_BUS_SERVO]);
            servo_tick(&servo);
            tick_ns += TICK_NS;
            continue;
        }
        struct drv_command c = { .seq = (uint8_t)k, .type = k == 0 ? DRV_START : DRV_CYCLIC };
        struct hdt_frame f;
        for (int i = 0; i < PA10_JOINTS; i++)
            c.axis[i].mode = DRV_AXIS_SERVO;
        while (r.bus[HDT_BUS_HOST].recv(r.bus[HDT_BUS_HOST].ctx, &f) == HDT_BUS_OK)
            continue;
        ck_assert_int_eq(drv_command_encode(format, &c, &f), DRV_TELEGRAM_OK);
        (void)r.bus[HDT_BUS_HOST].send(r.bus[HDT_BUS_HOST].ctx, &f);
        if (++k == 14)
            arcnet_lose_token(&r.ring, 1);
        ck_assert(k != 14 || servo.s.mode == SERVO_CONTROL);
        host_ns += HOST_NS;
    }
    ck_assert_uint_eq(r.ring.reconfigurations, 1);
    return servo.s.mode;
}

/* 11.5 ms of silence at 5 Mbit/s against watchdogs of 400 and 10 ms; 5.7 ms at 10. */
START_TEST(test_a_lost_token_trips_the_short_watchdog_of_format_b_at_five_megabit)
{
    ck_assert_int_eq(mode_after_a_lost_token(DRV_FORMAT_A, 5), SERVO_CONTROL);
    ck_assert_int_eq(mode_after_a_lost_token(DRV_FORMAT_B, 5), SERVO_STOP);
    ck_assert_int_eq(mode_after_a_lost_token(DRV_FORMAT_B, 10), SERVO_CONTROL);
}
END_TEST

static Suite *arcnet_suite(void)
{
    Suite *s = suite_create("arcnet");
    TCase *t = tcase_create("formula");
    tcase_add_test(t, test_rotation_times_are_those_of_the_table);
    tcase_add_test(t, test_all_times_scale_with_the_bit_and_propagation_adds);
    tcase_add_test(t, test_rates_and_lengths_there_are_not_give_nothing);
    tcase_add_test(t, test_a_lost_token_costs_the_search_for_the_next_node);
    suite_add_tcase(s, t);
    t = tcase_create("ring");
    tcase_add_test(t, test_a_frame_arrives_to_the_nanosecond_when_its_token_came);
    tcase_add_test(t, test_ring_agrees_with_every_token_passed_one_by_one);
    tcase_add_test(t, test_time_may_move_in_any_steps);
    tcase_add_test(t, test_full_buffers_hold_back_and_lose_nothing);
    tcase_add_test(t, test_a_refusal_costs_a_rotation_and_a_lost_token_a_reconfiguration);
    tcase_add_test(t, test_a_copy_of_the_ring_goes_on_alike);
    suite_add_tcase(s, t);
    t = tcase_create("cycle");
    tcase_add_test(t, test_seven_hundred_hertz_fit_at_2_5_megabit_and_not_at_half_of_it);
    tcase_add_test(t, test_the_cycle_rides_out_lost_tokens);
    tcase_add_test(t, test_a_lost_token_trips_the_short_watchdog_of_format_b_at_five_megabit);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(arcnet_suite())
