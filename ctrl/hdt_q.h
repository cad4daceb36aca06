/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scalar types of the core: each says its unit and its fraction bits, each is a one-member
 * struct, so mixing two of them does not compile.  "q16" means 16 fraction bits.
 *
 * Owns: the types and the few arithmetic helpers everything else in ctrl/ is built from.
 * Never: touches memory other than its arguments, uses floating point, divides (a 32-bit machine
 * would need a library for it), shifts a negative value left.
 *
 * The one thing taken from the compiler beyond C99: a negative value shifted right keeps its sign,
 * as every compiler for the machines in question defines it; another one does not get past the
 * first declaration below.
 *
 * Every helper is pure; any thread.
 */
#ifndef HDT_Q_H
#define HDT_Q_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct { int32_t raw; } hdt_rad_t;    /* rad       output side  q24  +-128      lsb 6.0e-8 */
typedef struct { int32_t raw; } hdt_radps_t;  /* rad/s     output side  q24  +-128      lsb 6.0e-8 */
typedef struct { int32_t raw; } hdt_radps2_t; /* rad/s^2   output side  q16  +-32768    lsb 1.5e-5 */
typedef struct { int32_t raw; } hdt_nm_t;     /* N.m       output side  q16  +-32768    lsb 1.5e-5 */
typedef struct { int32_t raw; } hdt_cnt_t;    /* resolver count, motor side, HDT_COUNTS_PER_REV a turn */
typedef struct { uint32_t raw; } hdt_phase_t; /* angle, 2^32 a turn; wraps by construction         */
typedef struct { int16_t raw; } hdt_dig_t;    /* torque word: 0.001 N.m motor side a digit         */
typedef struct { int16_t raw; } hdt_spd_t;    /* speed word: 0.0002 rad/s output side a digit      */

/* Resolver counts in one motor (= wave generator) revolution [pa10: 360/(50*16384) deg a digit]. */
#define HDT_COUNTS_PER_REV 16384

typedef char hdt_right_shift_keeps_the_sign[(-3 >> 1) == -2 ? 1 : -1];

/* x / 2^n, to the nearest, halves up; 1 <= n <= 62.
 * Overflow: x must stay half an LSB, 2^(n-1), below 2^63. */
static inline int64_t hdt_shr(int64_t x, unsigned n)
{
    return (x + ((int64_t)1 << (n - 1u))) >> n;
}

/* x within -bound .. bound, 0 <= bound < 2^62.  Modulo 2^64 the range begins at 0 and is one comparison. */
static inline int64_t hdt_within(int64_t x, int64_t bound)
{
    const uint64_t up = (uint64_t)x + (uint64_t)bound;
    if (up > (uint64_t)bound * 2u)
        return x < 0 ? -bound : bound;
    return (int64_t)up - bound;
}

/* Overflow: clamped to +-(2^31 - 1), symmetric so that negation never overflows. */
static inline int32_t hdt_sat(int64_t x)
{
    return (int32_t)hdt_within(x, INT32_MAX);
}

/* a * b / 2^n.  Overflow: 64-bit product, then clamped as hdt_sat. */
static inline int32_t hdt_mul(int32_t a, int32_t b, unsigned n)
{
    return hdt_sat(hdt_shr((int64_t)a * b, n));
}

/* x within lo .. hi. */
static inline int64_t hdt_clamp(int64_t x, int64_t lo, int64_t hi)
{
    return x < lo ? lo : x > hi ? hi : x;
}

/* Overflow: |-2^31| is 2^31 - 1. */
static inline int32_t hdt_abs(int32_t x)
{
    return x >= 0 ? x : x == INT32_MIN ? INT32_MAX : -x;
}

extern const int32_t hdt_sine_q30[320];

/* Sine and cosine, q30, of an angle; within 2e-9, exact at whole quarter turns: the nearest 256th of a
 * turn from the table, turned by the rest u, |u| <= pi/256, with cos u = 1 - u^2/2, sin u = u - u^3/6.
 * Overflow: |u| < 2^30 (q36), so products with the table stay below 2^60. */
static inline void hdt_sin_cos(hdt_phase_t angle, int32_t *sin_q30, int32_t *cos_q30)
{
    const uint32_t shifted = angle.raw + ((uint32_t)1 << 23);
    const uint32_t k = shifted >> 24;
    const int64_t s = hdt_sine_q30[k], c = hdt_sine_q30[k + 64u];

    /* 2^-32 turn -> rad q36: 2 pi * 16 = 26353589 / 2^18 */
    const int64_t rest = (int64_t)(shifted & 0xffffffu) - ((int64_t)1 << 23);
    const int64_t u = hdt_shr(rest * 26353589, 18);
    const int64_t fall = hdt_shr(u * u, 37);                    /* 1 - cos u, q36; 2^21 / 6 = 349525 */
    const int64_t turn = u - hdt_shr(hdt_shr(u * fall, 36) * 349525, 20); /* sin u, q36 */

    *sin_q30 = (int32_t)(s + hdt_shr(c * turn - s * fall, 36));
    *cos_q30 = (int32_t)(c - hdt_shr(s * turn + c * fall, 36));
}

/* exp(-x), q30, for x in q28, x >= 0; within 5e-7 of the value, or 1e-9 absolutely. */
int32_t hdt_exp_neg(uint64_t x_q28);

#ifdef __cplusplus
}
#endif
#endif
