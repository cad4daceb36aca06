// SPDX-License-Identifier: Apache-2.0
//
// The chain of an arm as the core computes it: frames with few numbers, inertia booked onto the
// links so that only what motion can tell apart remains (ctrl/hdt_chain.h).
//
// Owns: the choice of frames, the booking, the rounding of both.
// Never: approximates: any chain of turning joints has such frames.
#pragma once

#include "ctrl/hdt_tables.h"
#include "model/hdt_arm.h"

namespace hdt {

// Geometry, moments, rotor and gravity of every joint, and the bits of the two terms of the chain.
// Throws Refusal naming the key that does not fit.
void make_chain(const hdt_arm &arm, hdt_tables *t);

} // namespace hdt
