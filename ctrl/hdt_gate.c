/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Faults first, then one joint after the other: scale, clamp, slew, position.
 *
 * Owns: the order of the checks; a cut to zero never waits for the slew limit.
 * Never: looks at a term, a reference velocity or a clock.
 */
#include "ctrl/hdt_gate.h"

/* speed words a rad/s */
#define SPEED_DIGIT_PER_RADPS 5000

/* Faults of one joint this period. */
static uint32_t watch(const struct hdt_joint_tab *tab, const struct hdt_in *in, const struct hdt_out *out,
                      uint32_t j, int seen, int stale)
{
    const int64_t q_ref = in->q_ref[j].raw, error = q_ref - out->q[j].raw;
    uint32_t fault = 0;

    if (in->servo_alarm >> j & 1u)
        fault |= HDT_FAULT_SERVO;
    if (seen && stale)
        fault |= HDT_FAULT_STALE;
    if (seen && hdt_abs(out->v[j].raw) > tab->v_max_q24)
        fault |= HDT_FAULT_SPEED;
    if (in->mode != HDT_MODE_IDLE) {
        if (q_ref < tab->q_min_q24 || q_ref > tab->q_max_q24)
            fault |= HDT_FAULT_REFERENCE;
        if (seen && tab->follow_max_q24 > 0 &&
            (error > tab->follow_max_q24 || error < -(int64_t)tab->follow_max_q24))
            fault |= HDT_FAULT_FOLLOWING;
    }
    return fault;
}

/* Does a command of this sign push a joint at q further out? */
static int outward(const struct hdt_joint_tab *tab, int32_t q_q24, int64_t command)
{
    return (q_q24 > tab->q_max_q24 && command > 0) || (q_q24 < tab->q_min_q24 && command < 0);
}

/* Torque to digits, joint direction; last is the digit of the period before. */
static int64_t limit_torque(const struct hdt_joint_tab *tab, int32_t total_q16, int32_t q_q24,
                            int32_t last, uint32_t *limit)
{
    /* q16 * q24 -> whole digits */
    const int64_t wanted = hdt_shr((int64_t)total_q16 * tab->digit_per_nm_q24, 40);
    const int64_t held = hdt_clamp(wanted, -tab->dig_max, tab->dig_max);
    const int64_t digit = hdt_clamp(held, last - tab->dig_slew, last + tab->dig_slew);

    if (held != wanted)
        *limit |= HDT_LIM_TORQUE;
    if (digit != held)
        *limit |= HDT_LIM_SLEW;
    if (outward(tab, q_q24, digit)) {
        *limit |= HDT_LIM_POSITION;
        return 0;
    }
    return digit;
}

/* Velocity to a speed word, joint direction. */
static int64_t limit_speed(const struct hdt_joint_tab *tab, int32_t v_q24, int32_t q_q24, uint32_t *limit)
{
    const int64_t wanted = hdt_shr((int64_t)v_q24 * SPEED_DIGIT_PER_RADPS, 24);
    const int64_t word = hdt_clamp(wanted, -tab->spd_max, tab->spd_max);

    if (word != wanted)
        *limit |= HDT_LIM_SPEED;
    if (outward(tab, q_q24, word)) {
        *limit |= HDT_LIM_POSITION;
        return 0;
    }
    return word;
}

void hdt_gate_step(struct hdt_gate *g, const struct hdt_tables *t, const struct hdt_in *in,
                   uint32_t seen, const hdt_radps_t v_cmd[], struct hdt_out *out)
{
    const uint32_t all = ((uint32_t)1 << t->joints) - 1u;
    const uint32_t active = in->active & all;

    /* faults latch before anything is let through */
    for (uint32_t j = 0; j < t->joints; j++) {
        g->stale[j] = in->fresh >> j & 1u ? 0 : g->stale[j] + (g->stale[j] < UINT32_MAX);
        if (!(active >> j & 1u))
            continue;
        const uint32_t fault = watch(&t->joint[j], in, out, j, (int)(seen >> j & 1u),
                                     g->stale[j] >= t->stale_periods);
        g->fault |= fault;
        if (fault != 0)
            g->fault_joints |= (uint32_t)1 << j;
    }

    const int open = g->fault == 0 && (active & ~seen) == 0;
    for (uint32_t j = 0; j < t->joints; j++) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        const int32_t q = out->q[j].raw;
        const int through = open && (active >> j & 1u);
        int64_t digit = 0, word = 0;

        out->limit[j] = 0;
        if (through && in->mode == HDT_MODE_TORQUE)
            digit = limit_torque(tab, out->total[j].raw, q, g->digit[j], &out->limit[j]);
        else if (through && in->mode == HDT_MODE_VELOCITY)
            word = limit_speed(tab, v_cmd[j].raw, q, &out->limit[j]);

        /* joint direction to count direction */
        g->digit[j] = (int32_t)digit;
        out->digit[j].raw = (int16_t)(digit * tab->sign);
        out->speed[j].raw = (int16_t)(word * tab->sign);
    }
    out->fault = g->fault;
    out->fault_joints = g->fault_joints;
}

void hdt_gate_zero(struct hdt_gate *g)
{
    for (int j = 0; j < HDT_JOINTS_MAX; j++)
        g->digit[j] = 0;
}

void hdt_gate_clear(struct hdt_gate *g)
{
    g->fault = 0;
    g->fault_joints = 0;
    hdt_gate_zero(g);
}
