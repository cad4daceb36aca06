/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Scalar types of the core: each says its unit and its fraction bits, each is a one-member
 * struct, so mixing two of them does not compile.  "q16" means 16 fraction bits.
 *
 * Owns: the types and the few arithmetic helpers everything else in ctrl/ is built from.
 * Never: touches memory other than its arguments, uses floating point, shifts a negative value.
 *
 * Every helper is pure; any thread.
 */
#ifndef HDT_Q_H
#define HDT_Q_H

#include <stdint.h>

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

#endif
