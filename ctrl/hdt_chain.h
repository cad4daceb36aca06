/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms of the whole chain: holding torque and rigid-body inertia, by recursion over the links.
 *
 * Gravity, from the potential energy U = -sum_k m_k g . c_k.  Turning joint j moves every later mass
 * by z_j x (c - o_j), so with h_j the first moment of links j..n about the origin of joint j
 *     dU/dq_j = -g . (z_j x h_j) = h_y g_x - h_x g_y      in the axes of link j, where z_j = (0,0,1),
 * g is turned out to the links, h gathered back in:  h_j = hold_moment_j + R_{j+1} h_{j+1}.
 *
 * Inertia: Newton-Euler about the joint origins without gravity; velocity and acceleration are those
 * of the reference, at the measured angle.
 *
 * Owns: the recursions.
 * Never: knows rotors, friction or anything of one joint alone.
 */
#ifndef HDT_CHAIN_H
#define HDT_CHAIN_H

#include "ctrl/hdt_comp.h"

/* N.m q16 of every joint.  Uses sin, cos.
 * Overflow: hdt_tables_check bounds |g| below 2^31 (q24) and the sum of all |h| below 2^30 (q20), so
 * no sum can wrap; the result is clamped as hdt_sat. */
void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[]);

/* N.m q16 of every joint.  Uses sin, cos, v_ref, a_ref.
 * Overflow: link motion is clamped to +-128 rad/s, +-2048 rad/s^2, +-2048 m/s^2 and link forces to
 * +-32767 N, N.m; nothing wraps. */
void hdt_chain_inertia(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[]);

#endif
