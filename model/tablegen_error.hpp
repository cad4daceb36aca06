// SPDX-License-Identifier: Apache-2.0
//
// What rounding costs the terms that are formulas: the tables' numbers against the model's, both in
// floating point.  Terms that are tables (friction, ripple, lines, curves) are measured where they are made.
//
// Owns: the states the two are compared at.
// Never: runs the core, whose own rounding of products is held by its tests.
#pragma once

#include "ctrl/hdt_tables.h"
#include "model/hdt_arm.h"

namespace hdt {

// Worst error at 500 states within the limits, N.m output side, of gravity, inertia, stiffness, load,
// temperature, presliding, spring, offset, p and d; the other terms are left as they are.
void measure_formulas(const hdt_arm &arm, const hdt_tables &t, double worst_nm[HDT_TERMS]);

} // namespace hdt
