/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms of one joint: friction, ripple, soft wind-up, torque lines and the other effects, each a
 * torque on the output side for one instant.  Terms of the chain are in hdt_chain.h.
 *
 * Owns: what each term is, in fixed point.
 * Never: keeps state (travel and cold share come in), limits a command, knows a mode.
 *
 * Every function is pure.  Overflow: products are 64-bit, results clamped to +-(2^31 - 1) q16, that
 * is +-32767 N.m; nothing wraps.
 */
#ifndef HDT_COMP_H
#define HDT_COMP_H

#include "ctrl/hdt.h"

/* One joint at one instant: what the terms need to know. */
struct hdt_motion {
    int32_t turned;       /* counts from zero, joint direction: q = turned * rad per count        */
    int32_t sin_q30, cos_q30; /* of q */
    int32_t q_q24;        /* rad, measured        */
    int32_t v_q24;        /* rad/s, measured      */
    int32_t q_ref_q24;    /* rad                  */
    int32_t v_ref_q24;    /* rad/s                */
    int32_t a_ref_q16;    /* rad/s^2              */
    int32_t dir_q30;      /* direction of the reference, -1..1, ramping through zero */
    int64_t travel_q40;   /* rad since the last reversal of the reference, >= 0 */
    int32_t cold_q30;     /* share of the cold excess still there, 0..1 */
};

/* Counts from zero, joint direction. */
int32_t hdt_comp_turned(const struct hdt_joint_tab *j, int32_t count);
/* Output angle of that many counts: as a number (clamped to +-128 rad) and as a phase (exact). */
int32_t hdt_comp_angle_q24(const struct hdt_joint_tab *j, int32_t turned);
hdt_phase_t hdt_comp_phase(uint64_t phase_per_count_q24, int32_t turned);
/* clamp(v_ref / ramp, -1, 1) */
int32_t hdt_comp_direction_q30(const struct hdt_joint_tab *j, int32_t v_ref_q24);

/* dir * (f0 + fv |v| + fs (1 - exp(-|v|/vc))), the bracket from knots per direction [Kennedy and
 * Desai 2005, eq. 7]; beyond the last knot its last slope goes on. */
int32_t hdt_comp_friction(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* dir * r(wave-generator phase) [ibid., Table III] */
int32_t hdt_comp_ripple(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* |dir| * line(load), one of three lines by load, a set for each direction [ibid., Table V] */
int32_t hdt_comp_stiffness(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16);
/* sum of amplitude * sin(order * q + phase), directed lines times dir */
int32_t hdt_comp_lines(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* dir * mu * |load| */
int32_t hdt_comp_load(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16);
/* cold * (coulomb * dir + viscous * v_ref) */
int32_t hdt_comp_temperature(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* -dir * deficit * exp(-travel / constant) */
int32_t hdt_comp_presliding(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* k * (q - q0) */
int32_t hdt_comp_spring(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* kp * (q_ref - q) */
int32_t hdt_comp_p(const struct hdt_joint_tab *j, const struct hdt_motion *m);
/* kd * (v_ref - v) */
int32_t hdt_comp_d(const struct hdt_joint_tab *j, const struct hdt_motion *m);

#endif
