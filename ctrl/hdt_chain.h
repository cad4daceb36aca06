/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Terms of the whole chain: holding torque and rigid-body inertia, by recursion over the links.
 *
 * Frames: link j's z is the axis of joint j, its x the common normal to the next axis, so that a
 * vector goes in by a twist about x and a turn about z, v_link = Rz(angle)^T Rx(twist)^T v_previous,
 * and the origin of the next link lies in the plane z = 0.  What a link carries along its own axis
 * belongs as well to the link before; moved there it leaves each link a first moment (x, y) and a
 * second moment (xx xy xz yy yz), no mass.  The generator does both (model/tablegen_chain.cpp);
 * nothing is approximated.
 *
 * Gravity, from the potential energy U = -sum_k g . h_k.  Turning joint j turns every later moment,
 * so with h_j that of links j..n
 *     dU/dq_j = -g . (z x h_j) = h_y g_x - h_x g_y      in the axes of link j;
 * g is turned out to the links, h gathered back in:  h_j = moment_j + R_{j+1} h_{j+1}.
 *
 * Inertia: Newton-Euler about the link origins without gravity.  With w, dw of the link,
 * U = [dw]x + [w]x [w]x gives the acceleration of a point r beyond that of the origin as U r; so
 *     force = U moment,   moment about the origin = moment x a + the axial vector of U second,
 * of the reference's velocity and acceleration at the measured angle.
 *
 * Owns: the recursions.
 * Never: knows rotors, friction or anything of one joint alone.
 */
#ifndef HDT_CHAIN_H
#define HDT_CHAIN_H

#include "ctrl/hdt_comp.h"

/* N.m q16 of every joint, at most HDT_GRAVITY_MAX_Q16.  Uses sin, cos.
 * Overflow: hdt_tables_check bounds |g| below 2^31 (q24), the sum of all |moment| below 2^30 (q20)
 * and their product below 2^30 (q16), so no vector leaves its 32 bits and the result's clamp never acts. */
void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[]);

/* N.m q16 of every joint.  Uses sin, cos, v_ref, a_ref, which must be within v_lim, a_lim.
 * Overflow: hdt_tables_check works out how fast links and how large forces can become with these
 * limits and takes only tables with which no vector leaves its 32 bits; the result is clamped as hdt_sat. */
void hdt_chain_inertia(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[]);

#endif
