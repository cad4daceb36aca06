/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms of one joint: friction, ripple, soft wind-up, torque lines and the other effects, each a
 * torque on the output side for one instant.  Terms of the chain are in hdt_chain.h.
 *
 * Owns: what each term is, its formats and bit growth in fixed point.  The terms of the paper are
 * inline, they run every period on every joint.
 * Never: keeps state (travel and cold share come in), limits a command, knows a mode, divides.
 *
 * Every function is pure.  Overflow: products are 64-bit; a result is +-(2^31 - 1) q16 at most, that
 * is +-32767 N.m, because hdt_tables_check says so or by a clamp; each function says which.
 */
#ifndef HDT_COMP_H
#define HDT_COMP_H

#include "ctrl/hdt.h"

/* One joint at one instant: what the terms need to know. */
struct hdt_motion {
    int32_t turned;       /* counts from zero, joint direction: q = turned * rad per count        */
    int32_t sin_q30, cos_q30; /* of q + phase0 */
    int32_t q_q24;        /* rad, measured        */
    int32_t v_q24;        /* rad/s, measured: filtered, or the observer's */
    int32_t v_fric_q24;   /* rad/s of friction: the reference's, or the observer's; within v_lim */
    int32_t q_ref_q24;    /* rad                  */
    int32_t v_ref_q24;    /* rad/s, within v_lim  */
    int32_t a_ref_q16;    /* rad/s^2, within a_lim */
    int32_t dir_q30;      /* direction of v_fric, -1..1, ramping through zero */
    int64_t travel_q40;   /* rad since the last reversal of the reference, >= 0 */
    int32_t wound_q30;    /* wind-up between the directions' torques, -1..1, where it has a travel */
    int32_t cold_q30;     /* share of the cold excess still there, 0..1 */
};

/* ---- angle ---- */

/* Counts from zero, joint direction.  Overflow: clamped. */
static inline int32_t hdt_comp_turned(const struct hdt_joint_tab *j, int32_t count)
{
    return hdt_sat(((int64_t)count - j->zero_cnt) * j->sign);
}

/* Output angle of that many counts as a number.  Overflow: clamped to +-128 rad. */
static inline int32_t hdt_comp_angle_q24(const struct hdt_joint_tab *j, int32_t turned)
{
    /* below 2^31 * 2^32 = 2^63, q44 -> q24 */
    return hdt_sat(hdt_shr((int64_t)turned * j->rad_per_count_q44, 20));
}

/* The same as a phase; exact.  Overflow: whole turns are bits 56 and up, so wrapping modulo 2^64 drops
 * nothing else. */
static inline hdt_phase_t hdt_comp_phase(uint64_t phase_per_count_q24, int32_t turned)
{
    const hdt_phase_t p = {(uint32_t)(((uint64_t)(int64_t)turned * phase_per_count_q24) >> 24)};
    return p;
}

/* clamp(v / ramp, -1, 1).  Overflow: 2^30 * 2^31 before the clamp. */
static inline int32_t hdt_comp_direction_q30(const struct hdt_joint_tab *j, int32_t v_ref_q24)
{
    /* q24 * q16 = q40 -> q30 */
    return (int32_t)hdt_within(hdt_shr((int64_t)v_ref_q24 * j->v_ramp_inv_q16, 10), (int64_t)1 << 30);
}

/* ---- terms of the paper ---- */

/* dir * (f0 + fv |v| + fs (1 - exp(-|v|/vc))), the bracket from knots per direction [Kennedy and
 * Desai 2005, eq. 7]; beyond the last knot its last slope goes on.
 * Overflow: knots below 2^30, so 2^31 * 2^31; clamped, though hdt_tables_check bounds the curve to v_lim. */
static inline int32_t hdt_comp_friction(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    const int32_t *knot = j->friction_q16[m->dir_q30 < 0];
    const uint32_t speed_q24 = (uint32_t)(m->v_fric_q24 < 0 ? -m->v_fric_q24 : m->v_fric_q24);
    const uint32_t shift = j->friction_shift;

    /* the last interval also serves every higher speed */
    const uint32_t at = speed_q24 >> shift;
    const uint32_t k = at < HDT_FRICTION_KNOTS - 1 ? at : HDT_FRICTION_KNOTS - 2;
    const int64_t past = (int64_t)speed_q24 - (int64_t)(k << shift);
    const int64_t value = knot[k] + hdt_shr(((int64_t)knot[k + 1] - knot[k]) * past, shift);
    return (int32_t)hdt_shr(hdt_sat(value) * (int64_t)m->dir_q30, 30);
}

/* dir * r(wave-generator phase) [ibid., Table III].  Overflow: below 2^20 (q12), none. */
static inline int32_t hdt_comp_ripple(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    /* two's complement modulo a turn is right for negative counts too */
    const uint32_t phase = (uint32_t)m->turned & (HDT_COUNTS_PER_REV - 1u);
    const uint32_t k = phase >> 4;
    const int32_t part = (int32_t)(phase & 15u);

    /* q8, 16 steps a knot: q12, exact */
    const int32_t here = j->ripple_q8[k];
    const int32_t next = j->ripple_q8[(k + 1u) & (HDT_RIPPLE_KNOTS - 1u)];
    const int32_t value_q12 = here * 16 + (next - here) * part;
    return (int32_t)hdt_shr((int64_t)value_q12 * m->dir_q30, 26);
}

/* The line of one direction at a load. */
static inline int32_t hdt_comp_windup(const struct hdt_stiffness_tab *s, int32_t load_q16)
{
    const int line = (load_q16 >= s->t1_q16) + (load_q16 > s->t2_q16);

    /* q24 * q16 = q40 -> q16 */
    return hdt_sat(s->intercept_q16[line] + hdt_shr((int64_t)s->slope_q24[line] * load_q16, 24));
}

/* |dir| * line(load), one of three lines by load, a set for each direction [ibid., Table V].
 * Overflow: a line is clamped, though hdt_tables_check bounds it at every load there can be. */
static inline int32_t hdt_comp_stiffness(const struct hdt_joint_tab *j, const struct hdt_motion *m,
                                         int32_t load_q16)
{
    const int64_t share_q30 = m->dir_q30 < 0 ? -m->dir_q30 : m->dir_q30;
    return (int32_t)hdt_shr(hdt_comp_windup(&j->stiffness[m->dir_q30 < 0], load_q16) * share_q30, 30);
}

/* kp * (q_ref - q).  Overflow: 2^30 * 2^32, then clamped. */
static inline int32_t hdt_comp_p(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    return hdt_sat(hdt_shr(j->kp_q16 * ((int64_t)m->q_ref_q24 - m->q_q24), 24));
}

/* kd * (v_ref - v).  Overflow: 2^30 * 2^32, then clamped. */
static inline int32_t hdt_comp_d(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    return hdt_sat(hdt_shr(j->kd_q16 * ((int64_t)m->v_ref_q24 - m->v_q24), 24));
}

/* ---- effects; all clamped ---- */

/* sum of amplitude * sin(order * q + phase), directed lines times dir */
int32_t hdt_comp_lines(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* The same where the wind-up has a travel: (1 + wound)/2 of the positive line, (1 - wound)/2 of the
 * negative one, at rest too. */
int32_t hdt_comp_hysteresis(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16);
/* dir * curve(q), the curve of the direction */
int32_t hdt_comp_local(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* curve(axis), times dir if directed */
int32_t hdt_comp_table(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16);
/* dir * mu * |load| */
int32_t hdt_comp_load(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16);
/* cold * (coulomb * dir + viscous * v_fric) */
int32_t hdt_comp_temperature(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* -dir * deficit * exp(-travel / constant) */
int32_t hdt_comp_presliding(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* k * (q - q0); clamped to HDT_SPRING_MAX_Q16, for the sake of what follows the load */
int32_t hdt_comp_spring(const struct hdt_joint_tab *j, const struct hdt_motion *m);

#endif
