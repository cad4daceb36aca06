/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the driver's tests share: tables small enough to compute a digit by hand, and a servo
 * driver reduced to its protocol (it answers, it moves nothing).
 */
#ifndef DRIVER_RIG_H
#define DRIVER_RIG_H

#include <string.h>

#include "driver/drv_cycle.h"

#define RIG_RATIO 50

/* Seven joints, ratio 50, feedback 100 N.m/rad and a constant 1 N.m; 700 Hz; no velocity filter.
 * One set, made anew by every call. */
static inline struct hdt_tables *rig_tables(void)
{
    static struct hdt_tables t;
    memset(&t, 0, sizeof t);
    t.magic = HDT_TABLES_MAGIC;
    t.layout = HDT_TABLES_LAYOUT;
    for (unsigned i = 0; i < sizeof t.digest; i++)
        t.digest[i] = (uint8_t)(17 * i);
    strcpy(t.name, "rig");
    t.joints = DRV_AXES;
    t.period_ns = 1428571;
    t.rate_q16 = 700 << 16;
    t.stale_periods = 30;
    t.gravity_q24[2] = -164527407; /* -9.80665 */
    t.biquad_q28[0] = 1 << 28;
    for (unsigned j = 0; j < t.joints; j++) {
        struct hdt_joint_tab *k = &t.joint[j];
        k->terms = 1u << HDT_TERM_P | 1u << HDT_TERM_OFFSET;
        k->sign = 1;
        k->rad_per_count_q44 = 134929949; /* 2 pi / (50 * 16384) */
        k->phase_per_count_q24 = ((uint64_t)1 << 56) / (RIG_RATIO * 16384);
        k->twist_cos_q30 = 1 << 30;
        k->v_lim_q24 = 4 << 24;
        k->a_lim_q16 = 32 << 16;
        k->v_ramp_inv_q16 = 100 << 16;
        k->friction_shift = 17;
        k->local[0].shift = k->local[1].shift = k->table.shift = 1;
        k->kp_q16 = 100 << 16;
        k->offset_q16 = 1 << 16;
        k->digit_per_nm_q24 = 20 << 24; /* 1000 / 50 */
        k->dig_max = 4640;
        k->dig_slew = 65535;
        k->spd_max = 5000;
        k->q_min_q24 = -(3 << 24);
        k->q_max_q24 = 3 << 24;
        k->v_max_q24 = 100 << 24;
    }
    return &t;
}

/* The limits that hdt gen gives an arm: low-pass of 40 Hz, 50 ms from zero to full torque, 0.5 rad of
 * following, 20 stale periods.  Digits are no longer a product done by hand. */
static inline void rig_real_limits(struct hdt_tables *t)
{
    static const int32_t low_pass[5] = {6855177, 13710353, 6855177, -402605980, 161591231};
    memcpy(t->biquad_q28, low_pass, sizeof low_pass);
    t->stale_periods = 20;
    for (unsigned j = 0; j < t->joints; j++) {
        t->joint[j].dig_slew = 133;
        t->joint[j].follow_max_q24 = 1 << 23;
        t->joint[j].v_max_q24 = 3 << 23;
    }
}

/* The servo driver's protocol: every good telegram is answered by one of its type and sequence. */
struct rig_servo {
    struct hdt_bus bus;
    int mute;                   /* receive, answer nothing */
    int no_clear;               /* as older drivers: does not know 'A' */
    int control;                /* between 'S' and 'E' */
    struct drv_state state;     /* what it reports; type and sequence are filled in */
    struct drv_command last;    /* last cyclic command */
    struct drv_command commands[64]; /* of every type, newest at (answered - 1) % 64 */
    unsigned answered, refused, starts, ends, cyclic;
};

static inline void rig_serve(struct rig_servo *s)
{
    struct hdt_frame f;
    int e;
    while ((e = s->bus.recv(s->bus.ctx, &f)) == HDT_BUS_OK || e == HDT_BUS_ERR_FRAME) {
        struct drv_command c;
        if (e == HDT_BUS_ERR_FRAME || drv_command_decode(DRV_FORMAT_A, &f, &c) != DRV_TELEGRAM_OK) {
            s->refused++;
            continue;
        }
        s->commands[s->answered++ % 64] = c;
        s->starts += c.type == DRV_START;
        s->ends += c.type == DRV_END;
        s->cyclic += c.type == DRV_CYCLIC;
        if (c.type == DRV_CYCLIC)
            s->last = c;
        if (s->mute || (c.type == DRV_CLEAR && s->no_clear))
            continue;
        if (c.type == DRV_START || c.type == DRV_END)
            s->control = c.type == DRV_START;
        if (c.type == DRV_CLEAR)
            s->state.axis[c.axis_no - 1].status &= (uint16_t)~DRV_AXIS_ALARM_MASK;
        s->state.seq = c.seq;
        s->state.type = c.type;
        (void)drv_state_encode(DRV_FORMAT_A, &s->state, &f);
        (void)s->bus.send(s->bus.ctx, &f);
    }
}

#endif
