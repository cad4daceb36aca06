/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The effects of one joint in fixed point; what they mean is in hdt_comp.h.
 *
 * Owns: formats and bit growth of each.
 * Never: divides, branches on more than a sign, keeps state.
 */
#include "ctrl/hdt_comp.h"

int32_t hdt_comp_lines(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    int64_t sum = 0;
    for (uint32_t k = 0; k < j->lines; k++) {
        const struct hdt_line_tab *line = &j->line[k];
        hdt_phase_t phase = hdt_comp_phase(line->phase_per_count_q24, m->turned);
        int32_t sine, cosine;
        phase.raw += line->phase0;
        hdt_sin_cos(phase, &sine, &cosine);
        const int32_t value = hdt_mul(line->amplitude_q16, sine, 30);
        sum += line->directed ? hdt_mul(value, m->dir_q30, 30) : value;
    }
    return hdt_sat(sum);
}

int32_t hdt_comp_load(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16)
{
    return hdt_mul(hdt_mul(j->load_mu_q24, hdt_abs(load_q16), 24), m->dir_q30, 30);
}

int32_t hdt_comp_temperature(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    const int64_t coulomb = hdt_mul(j->cold_coulomb_q16, m->dir_q30, 30);
    const int64_t viscous = hdt_mul(j->cold_viscous_q16, m->v_fric_q24, 24);
    return hdt_mul(hdt_sat(coulomb + viscous), m->cold_q30, 30);
}

int32_t hdt_comp_presliding(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    /* travel / constant in q28, the travel in two halves: below 2^26 * 2^31, and 2^20 * 2^31 */
    const uint64_t travel = (uint64_t)m->travel_q40, inverse = (uint64_t)j->presliding_inv_q8;
    const uint64_t x_q28 = (travel >> 20) * inverse + (((travel & 0xfffffu) * inverse) >> 20);
    const int32_t deficit = hdt_mul(j->presliding_q16, hdt_exp_neg(x_q28), 30);
    return -hdt_mul(deficit, m->dir_q30, 30);
}

int32_t hdt_comp_spring(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    /* 2^31 * 2^32 would not fit */
    const int32_t wound_q24 = hdt_sat((int64_t)m->q_q24 - j->spring_q0_q24);
    return (int32_t)hdt_within(hdt_shr((int64_t)j->spring_q16 * wound_q24, 24), HDT_SPRING_MAX_Q16);
}

int32_t hdt_comp_hysteresis(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16)
{
    /* lines below 2^31, so 2^32 * 2^30 */
    const int64_t up = hdt_comp_windup(&j->stiffness[0], load_q16);
    const int64_t down = hdt_comp_windup(&j->stiffness[1], load_q16);
    return hdt_sat(hdt_shr(up + down + hdt_shr((up - down) * m->wound_q30, 30), 1));
}

/* N.m q16, linear between knots, the ends held outside.
 * Overflow: 2^24 * 2^31; the result lies between two knots, below 2^23, and is clamped there. */
static int64_t curve_q16(const struct hdt_curve_tab *c, int32_t x)
{
    const int64_t last = (int64_t)(HDT_CURVE_KNOTS - 1) << c->shift;
    const int64_t past = hdt_clamp((int64_t)x - c->start, 0, last);
    const int64_t at = past >> c->shift, k = at < HDT_CURVE_KNOTS - 1 ? at : HDT_CURVE_KNOTS - 2;
    const int64_t part = past - (k << c->shift);
    const int64_t here = c->value_q8[k] * (int64_t)256, next = c->value_q8[k + 1] * (int64_t)256;
    return hdt_within(here + hdt_shr((next - here) * part, c->shift), 1 << 23);
}

int32_t hdt_comp_local(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    return (int32_t)hdt_shr(curve_q16(&j->local[m->dir_q30 < 0], m->q_q24) * m->dir_q30, 30);
}

int32_t hdt_comp_table(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16)
{
    int32_t x = m->q_q24;
    if (j->axis == HDT_AXIS_LOAD)
        x = load_q16;
    else if (j->axis == HDT_AXIS_PHASE)
        x = (int32_t)((uint32_t)m->turned & (HDT_COUNTS_PER_REV - 1u));
    else if (j->axis == HDT_AXIS_SPEED)
        x = hdt_abs(m->v_fric_q24);
    const int64_t value = curve_q16(&j->table, x);
    return (int32_t)(j->directed ? hdt_shr(value * m->dir_q30, 30) : value);
}
