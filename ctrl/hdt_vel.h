/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Velocity from resolver counts: differenced, then a second-order low-pass.  Inline: every joint,
 * every period.
 *
 * Owns: the difference, the filter and their state of one joint (struct hdt_vel).
 * Never: looks at limits or modes; allocates; reads a clock (one call is one period); divides but
 * once where the time between counts changes, 32 bits by 32.
 */
#ifndef HDT_VEL_H
#define HDT_VEL_H

#include "ctrl/hdt.h"

/* Longest gap, in periods, the difference still spans; the shortest is a quarter of a period. */
#define HDT_VEL_GAP_MAX 16

/* One over the time between two counts, Hz q16, to 7e-6 for up to 25 ms.  Only for dt_us >= 16. */
static inline uint32_t hdt_vel_rate_q16(uint32_t dt_us)
{
    /* 1e6 q12, then q16 */
    return (4096000000u / dt_us) << 4;
}

/* rad/s of one count at this rate, q32; below 2^38 for the rates and ratios hdt_tables_check takes. */
static inline int64_t hdt_vel_per_count_q32(uint32_t rad_per_count_q44, uint32_t rate_q16)
{
    /* q44 * q16 = q60 */
    return (int64_t)(((uint64_t)rad_per_count_q44 * rate_q16) >> 28);
}

/* Mean velocity since the previous count; counts may wrap.
 * Overflow: clamped to +-128 rad/s. */
static inline int32_t hdt_vel_difference(int32_t count, int32_t previous, int64_t per_count_q32)
{
    /* modulo 2^32, then signed; 2^24 counts are beyond +-128 rad/s at any resolution in use */
    const uint32_t up = (uint32_t)count - (uint32_t)previous, half = (uint32_t)1 << 31;
    const int64_t difference = (int64_t)(up ^ half) - half;
    const int64_t counts = hdt_within(difference, (int64_t)1 << 24);

    /* 2^24 * 2^38 = 2^62, q32 -> q24 */
    return hdt_sat(hdt_shr(counts * per_count_q32, 8));
}

/* One period of y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2 (biquad b0 b1 b2 a1 a2, q28).  The rounding
 * rest is carried over, so a constant input is reached exactly however low the cut-off.
 * Overflow: |b0|+|b1|+|b2| <= 4, |a1| < 2, |a2| < 1 (hdt_tables_check) keep the sum below 2^62;
 * the output is clamped to +-128 rad/s. */
static inline int32_t hdt_vel_filter(struct hdt_vel *s, const int32_t biquad_q28[5], int32_t x_q24)
{
    const int64_t sum_q52 = (int64_t)biquad_q28[0] * x_q24 +
                            (int64_t)biquad_q28[1] * s->x_q24[0] +
                            (int64_t)biquad_q28[2] * s->x_q24[1] -
                            (int64_t)biquad_q28[3] * s->y_q24[0] -
                            (int64_t)biquad_q28[4] * s->y_q24[1] + s->rest;
    const int64_t y = hdt_shr(sum_q52, 28);

    /* sum - y 2^28, within half of 2^28 */
    s->rest = (int32_t)((uint64_t)(sum_q52 + ((int64_t)1 << 27)) & 0x0fffffffu) - ((int32_t)1 << 27);
    s->x_q24[1] = s->x_q24[0];
    s->x_q24[0] = x_q24;
    s->y_q24[1] = s->y_q24[0];
    s->y_q24[0] = hdt_sat(y);
    return s->y_q24[0];
}

/* ---- observer ---- */

/* Count gone, angle known: one period of
 *     e = q - q^;  q^ += g0 e;  v^ += g1 e;  d^ += g2 e        if the count is fresh, then
 *     q^ += v^ dt;  v^ += (a + d^) dt
 * with a the acceleration the model expects of the torque let through last period (hdt_obs.a_q16).
 * Returns the velocity before it goes on to the next period.
 * Overflow: e is clamped to +-0.25 rad (q32, 2^30), q^ to +-256 rad (the angle of counts ends at 128), v^ to
 * +-128 rad/s, a + d^ to +-4096 rad/s^2; gains are at most 2^30, the period 2^32 (q32 of a second), so
 * products stay below 2^62. */
static inline int32_t hdt_vel_observe(struct hdt_obs *s, const int32_t gain[3], int64_t q_q40, int fresh,
                                      uint32_t period_q32)
{
    const int64_t quarter = (int64_t)1 << 30, q_max = (int64_t)1 << 48;
    const int64_t v_max = ((int64_t)1 << 47) - 1, a_max = (int64_t)1 << 28;

    if (fresh) {
        const int64_t e_q32 = hdt_within(hdt_shr(q_q40 - s->q_q40, 8), quarter);
        s->q_q40 += hdt_shr(e_q32 * gain[0], 22);
        s->v_q40 = hdt_within(s->v_q40 + hdt_shr(e_q32 * gain[1], 8), v_max);
        s->d_q32 = hdt_within(s->d_q32 + hdt_shr(e_q32 * gain[2], 8), a_max << 16);
    }
    const int32_t v_q24 = hdt_sat(hdt_shr(s->v_q40, 16));
    const int64_t a_q16 = hdt_within(s->a_q16 + hdt_shr(s->d_q32, 16), a_max);

    /* rad/s q22 * q32 -> q40; rad/s^2 q16 * q32 -> q40 */
    s->q_q40 = hdt_within(s->q_q40 + hdt_shr(hdt_shr(s->v_q40, 18) * period_q32, 14), q_max);
    s->v_q40 = hdt_within(s->v_q40 + hdt_shr(a_q16 * period_q32, 8), v_max);
    return v_q24;
}

#endif
