/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Velocity from resolver counts: differenced, then a second-order low-pass.
 *
 * Owns: the difference, the filter and their state of one joint (struct hdt_vel).
 * Never: looks at limits or modes; allocates; reads a clock (one call is one period).
 */
#ifndef HDT_VEL_H
#define HDT_VEL_H

#include "ctrl/hdt.h"

/* Longest gap, in periods, the difference still spans; the shortest is a quarter of a period. */
#define HDT_VEL_GAP_MAX 16

/* One over the time between two counts, Hz q16, to 7e-6 for up to 25 ms.  Only for dt_us >= 16. */
uint32_t hdt_vel_rate_q16(uint32_t dt_us);

/* rad/s of one count at this rate, q32; below 2^38 for the rates and ratios hdt_tables_check takes. */
int64_t hdt_vel_per_count_q32(uint32_t rad_per_count_q44, uint32_t rate_q16);

/* Mean velocity since the previous count; counts may wrap.
 * Overflow: clamped to +-128 rad/s. */
int32_t hdt_vel_difference(int32_t count, int32_t previous, int64_t per_count_q32);

/* One period of y = b0 x + b1 x1 + b2 x2 - a1 y1 - a2 y2 (biquad b0 b1 b2 a1 a2, q28).  The rounding
 * rest is carried over, so a constant input is reached exactly however low the cut-off.
 * Overflow: |b0|+|b1|+|b2| <= 4, |a1| < 2, |a2| < 1 (hdt_tables_check) keep the sum below 2^62;
 * the output is clamped to +-128 rad/s. */
int32_t hdt_vel_filter(struct hdt_vel *s, const int32_t biquad_q28[5], int32_t x_q24);

#endif
