// SPDX-License-Identifier: Apache-2.0
//
// The build-up of friction after a reversal: its size and the travel it takes, from the rows the
// rest of identification leaves out.
//
// Owns: the fit of the presliding term.
// Never: changes another number.  Included by model/ident*.cpp only.
#pragma once

#include <vector>

#include "model/ident.hpp"

namespace hdt::fit {

// Fit joint `number` (1-based) of the model on what the rest of it leaves; writes the effect
// "presliding" into the file and returns its numbers, or takes it out and returns none where the
// runs do not show it.   file->refresh() is the caller's.
std::vector<FitParameter> fit_presliding(const std::vector<Run> &runs, int number, double block_s, ArmFile *file);

} // namespace hdt::fit
