/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms of one joint in fixed point; what they mean is in hdt_comp.h.
 *
 * Owns: formats and bit growth of each term.
 * Never: divides, branches on more than a sign, keeps state.
 */
#include "ctrl/hdt_comp.h"

/* a - b, clamped */
static int32_t difference(int32_t a, int32_t b)
{
    return hdt_sat((int64_t)a - b);
}

int32_t hdt_comp_turned(const struct hdt_joint_tab *j, int32_t count)
{
    const int64_t turned = (int64_t)count - j->zero_cnt;
    return hdt_sat(j->sign < 0 ? -turned : turned);
}

int32_t hdt_comp_angle_q24(const struct hdt_joint_tab *j, int32_t turned)
{
    /* below 2^31 * 2^32 = 2^63, q44 -> q24 */
    return hdt_sat(hdt_shr((int64_t)turned * j->rad_per_count_q44, 20));
}

hdt_phase_t hdt_comp_phase(uint64_t phase_per_count_q24, int32_t turned)
{
    /* whole turns are bits 56 and up: wrapping modulo 2^64 drops nothing else */
    const hdt_phase_t p = {(uint32_t)(((uint64_t)(int64_t)turned * phase_per_count_q24) >> 24)};
    return p;
}

int32_t hdt_comp_direction_q30(const struct hdt_joint_tab *j, int32_t v_ref_q24)
{
    /* q24 * q16 = q40 -> q30 */
    const int64_t one = (int64_t)1 << 30;
    return (int32_t)hdt_clamp(hdt_shr((int64_t)v_ref_q24 * j->v_ramp_inv_q16, 10), -one, one);
}

int32_t hdt_comp_friction(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    const int32_t *knot = j->friction_q16[m->dir_q30 < 0];
    const int32_t speed_q24 = hdt_abs(m->v_ref_q24);
    const uint32_t shift = j->friction_shift;

    /* the last interval also serves every higher speed */
    const uint32_t at = (uint32_t)speed_q24 >> shift;
    const uint32_t k = at < HDT_FRICTION_KNOTS - 1 ? at : HDT_FRICTION_KNOTS - 2;
    const int64_t past = speed_q24 - ((int64_t)k << shift);

    /* knots below 2^30, so 2^31 * 2^31 */
    const int64_t rise = hdt_shr(((int64_t)knot[k + 1] - knot[k]) * past, shift);
    return hdt_mul(hdt_sat(knot[k] + rise), m->dir_q30, 30);
}

int32_t hdt_comp_ripple(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    /* two's complement modulo a turn is right for negative counts too */
    const uint32_t phase = (uint32_t)m->turned & (HDT_COUNTS_PER_REV - 1u);
    const uint32_t k = phase >> 4;
    const int32_t part = (int32_t)(phase & 15u);

    /* q8, 16 steps a knot: q12, exact */
    const int32_t here = j->ripple_q8[k];
    const int32_t next = j->ripple_q8[(k + 1u) & (HDT_RIPPLE_KNOTS - 1u)];
    const int32_t value_q12 = here * 16 + (next - here) * part;
    return hdt_mul(value_q12, m->dir_q30, 26);
}

int32_t hdt_comp_stiffness(const struct hdt_joint_tab *j, const struct hdt_motion *m, int32_t load_q16)
{
    const struct hdt_stiffness_tab *s = &j->stiffness[m->dir_q30 < 0];
    const int line = (load_q16 >= s->t1_q16) + (load_q16 > s->t2_q16);

    /* q24 * q16 = q40 -> q16; then the share of a full direction */
    const int64_t value = s->intercept_q16[line] + hdt_shr((int64_t)s->slope_q24[line] * load_q16, 24);
    return hdt_mul(hdt_sat(value), hdt_abs(m->dir_q30), 30);
}

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
    const int64_t viscous = hdt_mul(j->cold_viscous_q16, m->v_ref_q24, 24);
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
    return hdt_mul(j->spring_q16, difference(m->q_q24, j->spring_q0_q24), 24);
}

int32_t hdt_comp_p(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    return hdt_mul(j->kp_q16, difference(m->q_ref_q24, m->q_q24), 24);
}

int32_t hdt_comp_d(const struct hdt_joint_tab *j, const struct hdt_motion *m)
{
    return hdt_mul(j->kd_q16, difference(m->v_ref_q24, m->v_q24), 24);
}
