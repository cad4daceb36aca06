/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One control period.  See drv_cycle.h for its order and its rules.
 *
 * Owns: sequence, link state, what each axis is told.
 * Never: waits; everything that can fail outside becomes a counter.
 */
#include "driver/drv_cycle.h"

#include <string.h>

/* Sequence numbers stay below 128: Linux's ARCNET stack takes the first byte of a packet for a
 * protocol number, and the ones it knows are all above. */
#define SEQ_MASK 0x7fu

int drv_cycle_init(struct drv_cycle *c, const struct hdt_tables *t, const struct hdt_bus *bus,
                   struct drv_ring *ring)
{
    if (c == NULL)
        return HDT_ERR_ARG;
    memset(c, 0, sizeof *c);
    if (t == NULL || bus == NULL || bus->send == NULL || bus->recv == NULL || t->joints > DRV_AXES)
        return HDT_ERR_ARG;
    c->bus = *bus;
    c->ring = ring;
    return hdt_init(&c->core, t);
}

int drv_cycle_set_format(struct drv_cycle *c, enum drv_format format, const uint16_t *rated_mnm)
{
    if (c == NULL || c->core.tables == NULL || (format != DRV_FORMAT_A && format != DRV_FORMAT_B))
        return HDT_ERR_ARG;
    for (unsigned j = 0; format == DRV_FORMAT_B && j < c->core.tables->joints; j++)
        if (rated_mnm == NULL || rated_mnm[j] == 0)
            return HDT_ERR_ARG;
    c->format = format;
    for (unsigned j = 0; format == DRV_FORMAT_B && j < c->core.tables->joints; j++)
        c->rated_mnm[j] = rated_mnm[j];
    return HDT_OK;
}

static void lose_link(struct drv_cycle *c)
{
    c->want_type = 0;
    c->ask_again = 0;
    c->in_step = 0;
    if (c->link == DRV_LINK_RUNNING)
        c->link = DRV_LINK_STARTING;
}

/* One telegram that decoded.  Returns 1 when it is a state telegram the core should see. */
static int take(struct drv_cycle *c, const struct drv_state *s)
{
    /* no telegram has type 0, which want_type is while nothing is awaited */
    if (s->type != c->want_type || s->seq != c->want_seq) {
        c->count.wrong_seq++;
        return 0;
    }
    c->want_type = 0;
    c->count.received++;
    if (s->type == DRV_START)
        c->link = DRV_LINK_RUNNING;
    if (s->type == DRV_END)
        c->end_answered = 1;
    if (s->type != DRV_CYCLIC)
        return 0;
    c->last = *s;
    for (unsigned j = 0; c->format == DRV_FORMAT_B && j < DRV_AXES; j++)
        c->last.axis[j].torque_dig = drv_torque_from_b(s->axis[j].torque_dig, c->rated_mnm[j]);
    c->started = c->in_step = 1;
    return 1;
}

/* Everything that has arrived.  Returns 1 when the awaited state is among it. */
static int drain(struct drv_cycle *c)
{
    struct hdt_frame f;
    struct drv_state s;
    int fresh = 0;
    for (int n = 0; n < DRV_CYCLE_DRAIN; n++) {
        int e = c->bus.recv(c->bus.ctx, &f);
        if (e == HDT_BUS_ERR_AGAIN)
            break;
        if (e == HDT_BUS_OK && drv_state_decode(c->format, &f, &s) == DRV_TELEGRAM_OK) {
            fresh |= take(c, &s);
        } else if (e == HDT_BUS_OK || e == HDT_BUS_ERR_FRAME) {
            c->count.bad_frames++;
        } else {
            c->count.bus_down++;
            if (c->want_type != 0)
                c->count.lost++;
            lose_link(c);
            break;
        }
    }
    return fresh;
}

/* Axes told servo-on that have been off for too long, by the reply that just came. */
static void watch_power(struct drv_cycle *c)
{
    unsigned most = DRV_CYCLE_ON_MS * 1000000u / c->core.tables->period_ns;
    c->unpowered = 0;
    for (unsigned j = 0; j < DRV_AXES; j++) {
        int on = (c->last.axis[j].status & (DRV_AXIS_POWER_OFF | DRV_AXIS_UNCONTROLLABLE)) == 0;
        if (on || (c->told_on >> j & 1u) == 0)
            c->off[j] = 0;
        else if (c->off[j] <= most)
            c->off[j]++;
        if (c->off[j] > most)
            c->unpowered |= 1u << j;
    }
}

/* Joints that may not be driven on, by the state that just came. */
static uint32_t alarms_of(struct drv_cycle *c, uint32_t active)
{
    uint32_t all = (1u << c->core.tables->joints) - 1u, axes = 0;
    for (unsigned j = 0; j < DRV_AXES; j++)
        if ((c->last.axis[j].status & DRV_AXIS_ALARM_MASK) != 0)
            axes |= 1u << j;
    watch_power(c);
    /* an alarm of the driver or of an axis nobody drives stops those that are driven */
    if ((c->last.driver_status & DRV_AXIS_ALARM_MASK) != 0 || (axes & ~(active & all)) != 0)
        return all;
    return axes | c->unpowered;
}

/* Receive, and fill in what the core gets from the servo. */
static void receive(struct drv_cycle *c, struct hdt_in *in)
{
    unsigned joints = c->core.tables->joints;
    uint32_t all = (1u << joints) - 1u;
    int fresh = drain(c);
    if (c->want_type != 0 && --c->patience == 0) {
        c->count.lost++;
        c->want_type = 0;
    }
    in->fresh = fresh ? all : 0u;
    /* the servo answers a command at once, so the counts are as old as the command: a period */
    in->count_us = c->rec.in.t_us;
    for (unsigned j = 0; j < joints; j++)
        in->count[j].raw = c->last.axis[j].count;
    in->servo_alarm = fresh ? alarms_of(c, in->active) : 0u;
}

static int send_telegram(struct drv_cycle *c, struct drv_command *cmd)
{
    struct hdt_frame f;
    c->seq = (uint8_t)((c->seq + 1u) & SEQ_MASK);
    cmd->seq = c->seq;
    (void)drv_command_encode(c->format, cmd, &f); /* the types sent here all exist */
    int e = c->bus.send(c->bus.ctx, &f);
    if (e == HDT_BUS_OK) {
        c->want_seq = cmd->seq;
        c->want_type = cmd->type;
        c->patience = cmd->type == DRV_CYCLIC ? 1 : DRV_CYCLE_RETRY;
        return e;
    }
    c->count.send_dropped++;
    if (e == HDT_BUS_ERR_DOWN)
        lose_link(c);
    return e;
}

/* 'S' or 'E', at once and then every DRV_CYCLE_RETRY periods until answered. */
static void send_mode(struct drv_cycle *c, uint8_t type)
{
    struct drv_command cmd;
    if (c->ask_again > 1) {
        c->ask_again--;
        return;
    }
    memset(&cmd, 0, sizeof cmd);
    cmd.type = type;
    (void)send_telegram(c, &cmd);
    c->ask_again = DRV_CYCLE_RETRY;
}

/* Format B's word for a digit within dig_max: rounded, but not to a torque beyond dig_max. */
static int16_t torque_b(const struct drv_cycle *c, unsigned j, int16_t dig)
{
    int32_t word = drv_torque_to_b(dig, c->rated_mnm[j]);
    /* both in 0.001 N.m / 4096 */
    int32_t most = c->core.tables->joint[j].dig_max * 4096, is = word * c->rated_mnm[j];
    return (int16_t)(is > most ? word - 1 : is < -most ? word + 1 : word);
}

/* One driven axis, in the units of the format; the core's digits are 0.001 N.m. */
static void command_axis(const struct drv_cycle *c, unsigned j, uint32_t mode, const struct hdt_out *out,
                         struct drv_command *cmd)
{
    int b = c->format == DRV_FORMAT_B;
    uint16_t drive = (uint16_t)(DRV_AXIS_SERVO | (b ? DRV_AXIS_STOP_ALL : 0u));
    if (mode == HDT_MODE_TORQUE) {
        int16_t dig = out->digit[j].raw;
        cmd->axis[j].mode = (uint16_t)(drive | DRV_AXIS_TORQUE);
        cmd->axis[j].torque_dig = b ? torque_b(c, j, dig) : dig;
    } else if (mode == HDT_MODE_VELOCITY) {
        cmd->axis[j].mode = drive;
        cmd->axis[j].speed_dig = out->speed[j].raw;
    }
}

/* 'A' for the next axis with an alarm; 0 when none is left and none awaits its answer. */
static int clear_next(struct drv_cycle *c)
{
    struct drv_command cmd;
    if (c->want_type == DRV_CLEAR)
        return 1;
    if (c->alarms == 0)
        return 0;
    memset(&cmd, 0, sizeof cmd);
    cmd.type = DRV_CLEAR;
    cmd.axis_no = 1;
    while ((c->alarms >> (cmd.axis_no - 1u) & 1u) == 0)
        cmd.axis_no++;
    if (send_telegram(c, &cmd) == HDT_BUS_OK)
        c->alarms &= c->alarms - 1u;
    return 1;
}

static void send_cyclic(struct drv_cycle *c, const struct hdt_in *in, const struct hdt_out *out,
                        int safe)
{
    struct drv_command cmd;
    uint32_t on = 0;
    unsigned joints = c->core.tables->joints;
    memset(&cmd, 0, sizeof cmd);
    cmd.type = DRV_CYCLIC;
    for (unsigned j = 0; j < DRV_AXES; j++) {
        cmd.axis[j].mode = DRV_AXIS_BRAKE;
        if (safe || j >= joints || (in->active >> j & 1u) == 0)
            continue;
        command_axis(c, j, in->mode, out, &cmd);
        on |= cmd.axis[j].mode & DRV_AXIS_SERVO ? 1u << j : 0u;
    }
    (void)send_telegram(c, &cmd);
    c->told_on = on;
}

static void record(struct drv_cycle *c)
{
    if (c->ring == NULL && c->dump == NULL)
        return;
    for (unsigned j = 0; j < DRV_AXES; j++) {
        c->rec.torque_dig[j] = c->last.axis[j].torque_dig;
        c->rec.status[j] = c->last.axis[j].status;
    }
    c->rec.driver_status = c->last.driver_status;
    c->rec.link = (uint16_t)c->link;
    if (c->dump != NULL)
        drv_dump_note(c->dump, &c->rec, &c->core);
    if (c->ring != NULL && drv_ring_push(c->ring, &c->rec) != 0)
        c->count.log_dropped++;
}

int drv_cycle_period(struct drv_cycle *c, struct hdt_in *in, struct hdt_out *out)
{
    if (c == NULL || in == NULL || out == NULL || c->core.tables == NULL)
        return HDT_ERR_ARG;
    receive(c, in);
    c->rec.in = *in;
    if (!c->started || c->link == DRV_LINK_ENDED)
        c->rec.in.active = 0;
    if (!c->in_step)
        c->rec.in.mode = HDT_MODE_IDLE;
    int e = hdt_step(&c->core, &c->rec.in, &c->rec.out);
    int safe = e != HDT_OK || c->rec.out.fault != 0;
    switch (c->link) {
    case DRV_LINK_STARTING:
        if (!clear_next(c))
            send_mode(c, DRV_START);
        break;
    case DRV_LINK_RUNNING:
        send_cyclic(c, &c->rec.in, &c->rec.out, safe);
        break;
    case DRV_LINK_ENDED:
        if (!c->end_answered)
            send_mode(c, DRV_END);
        break;
    }
    *out = c->rec.out;
    if (e != HDT_OK)
        return e;
    c->count.periods++;
    record(c);
    return HDT_OK;
}

int drv_cycle_end(struct drv_cycle *c)
{
    struct drv_command cmd;
    /* the reply to the last command is usually there: it is not lost */
    (void)drain(c);
    if (c->want_type != 0)
        c->count.lost++;
    c->link = DRV_LINK_ENDED;
    c->end_answered = 0;
    c->want_type = 0;
    memset(&cmd, 0, sizeof cmd);
    cmd.type = DRV_END;
    int e = send_telegram(c, &cmd);
    c->ask_again = e == HDT_BUS_OK ? DRV_CYCLE_RETRY : 0;
    return e;
}

int drv_cycle_ended(struct drv_cycle *c)
{
    if (c->link != DRV_LINK_ENDED)
        return 0;
    if (!c->end_answered)
        (void)drain(c);
    return c->end_answered;
}

void drv_cycle_restart(struct drv_cycle *c)
{
    if (c->want_type != 0)
        c->count.lost++;
    lose_link(c);
    c->link = DRV_LINK_STARTING;
    c->alarms = 0;
    for (unsigned j = 0; j < DRV_AXES; j++)
        if ((c->last.axis[j].status & DRV_AXIS_ALARM_MASK) != 0)
            c->alarms |= 1u << j;
    /* as after init: what the core knows is old, and that is meant */
    c->started = 0;
}

const char *drv_link_str(enum drv_link link)
{
    switch (link) {
    case DRV_LINK_STARTING: return "starting";
    case DRV_LINK_RUNNING: return "running";
    case DRV_LINK_ENDED: return "ended";
    }
    return "unknown";
}
