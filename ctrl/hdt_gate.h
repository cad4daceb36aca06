/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The last check before the bus: nothing else writes digits or speed words.
 *
 * A digit that leaves here is within dig_max, within dig_slew of the one before or zero, never
 * pushes a joint further out of its position range, and is zero under any latched fault, outside
 * torque mode, for a joint not driven, and until every driven joint has been seen.
 *
 * Owns: faults (stale, speed, following, servo, reference), limits (torque, slew, position, speed).
 * Never: knows the model: of a joint's table it reads sign, digit_per_nm and the limits.
 */
#ifndef HDT_GATE_H
#define HDT_GATE_H

#include "ctrl/hdt.h"

/* One period.  Reads mode, active, fresh, servo_alarm and q_ref of in; q, v and total of out; v_cmd
 * is the speed wanted in velocity mode.  Writes digit, speed, fault, fault_joints and limit of out.
 * seen: bit per joint that has ever had a count.
 * Overflow: total * digit_per_nm is 64-bit, then clamped to dig_max. */
void hdt_gate_step(struct hdt_gate *g, const struct hdt_tables *t, const struct hdt_in *in,
                   uint32_t seen, const hdt_radps_t v_cmd[], struct hdt_out *out);

/* The digits of the last period were not sent, or zero was: the slew limit goes on from zero. */
void hdt_gate_zero(struct hdt_gate *g);

/* Forget latched faults; what still holds latches again next period. */
void hdt_gate_clear(struct hdt_gate *g);

#endif
