/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Differenced counts and the low-pass biquad.
 *
 * Owns: the arithmetic of both.
 * Never: divides but once a step, 32 bits by 32.
 */
#include "ctrl/hdt_vel.h"

uint32_t hdt_vel_rate_q16(uint32_t dt_us)
{
    /* 1e6 q12, then q16 */
    return (4096000000u / dt_us) << 4;
}

int64_t hdt_vel_per_count_q32(uint32_t rad_per_count_q44, uint32_t rate_q16)
{
    /* q44 * q16 = q60 */
    return (int64_t)(((uint64_t)rad_per_count_q44 * rate_q16) >> 28);
}

int32_t hdt_vel_difference(int32_t count, int32_t previous, int64_t per_count_q32)
{
    /* modulo 2^32, then signed; 2^24 counts are beyond +-128 rad/s at any resolution in use */
    const uint32_t up = (uint32_t)count - (uint32_t)previous;
    const int64_t difference = up <= INT32_MAX ? (int64_t)up : (int64_t)up - ((int64_t)1 << 32);
    const int64_t counts = hdt_clamp(difference, -((int64_t)1 << 24), (int64_t)1 << 24);

    /* 2^24 * 2^38 = 2^62, q32 -> q24 */
    return hdt_sat(hdt_shr(counts * per_count_q32, 8));
}

int32_t hdt_vel_filter(struct hdt_vel *s, const int32_t biquad_q28[5], int32_t x_q24)
{
    const int64_t sum_q52 = (int64_t)biquad_q28[0] * x_q24 +
                            (int64_t)biquad_q28[1] * s->x_q24[0] +
                            (int64_t)biquad_q28[2] * s->x_q24[1] -
                            (int64_t)biquad_q28[3] * s->y_q24[0] -
                            (int64_t)biquad_q28[4] * s->y_q24[1] + s->rest;
    const int64_t y = hdt_shr(sum_q52, 28);

    s->rest = (int32_t)(sum_q52 - y * ((int64_t)1 << 28)); /* within half of 2^28 */
    s->x_q24[1] = s->x_q24[0];
    s->x_q24[0] = x_q24;
    s->y_q24[1] = s->y_q24[0];
    s->y_q24[0] = hdt_sat(y);
    return s->y_q24[0];
}
