/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the proofs assume of a table beyond the ranges in hdt_tables.c: coefficients of a low-pass that
 * biquad_ok takes.  tests/check_tables.c holds hdt_tables_check to them: the bound is accepted, one
 * beyond is not.
 */
#ifndef PROOF_BOUNDS_H
#define PROOF_BOUNDS_H

#define PROOF_B_MAX_Q28 (1 << 30)        /* b0, b1, b2, none below 0 */
#define PROOF_A1_MAX_Q28 ((1 << 29) - 2) /* magnitude */
#define PROOF_A2_MAX_Q28 ((1 << 28) - 1) /* magnitude */

#endif
