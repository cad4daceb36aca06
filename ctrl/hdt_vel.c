/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Differenced counts and the low-pass biquad.
 *
 * Owns: the arithmetic of both.
 * Never: divides: a gap is averaged with a reciprocal.
 */
#include "ctrl/hdt_vel.h"

int64_t hdt_vel_per_count_q32(uint32_t rad_per_count_q44, uint32_t rate_q16)
{
    /* q44 * q16 = q60 */
    return (int64_t)(((uint64_t)rad_per_count_q44 * rate_q16) >> 28);
}

int32_t hdt_vel_difference(int32_t count, int32_t previous, int64_t per_count_q32, uint32_t periods)
{
    /* 1/n in q24 */
    static const int32_t inverse_q24[HDT_VEL_GAP_MAX + 1] = {
        0,       16777216, 8388608, 5592405, 4194304, 3355443, 2796203, 2396745, 2097152,
        1864135, 1677722,  1525201, 1398101, 1290555, 1198373, 1118481, 1048576};

    /* modulo 2^32, then signed; 2^24 counts are beyond +-128 rad/s at any resolution in use */
    const uint32_t up = (uint32_t)count - (uint32_t)previous;
    const int64_t difference = up <= INT32_MAX ? (int64_t)up : (int64_t)up - ((int64_t)1 << 32);
    const int64_t counts = hdt_clamp(difference, -((int64_t)1 << 24), (int64_t)1 << 24);

    /* average over the gap: q32 * q24 -> q32, then 2^24 * 2^36 = 2^60, q32 -> q24 */
    const int64_t mean_q32 = hdt_shr(per_count_q32 * inverse_q24[periods], 24);
    return hdt_sat(hdt_shr(counts * mean_q32, 8));
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
