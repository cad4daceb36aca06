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

// Fit these joints (1-based) of the model, each on what the rest of the model leaves; writes the
// effect "presliding" into the file and gives its numbers, or takes it out and gives none where the
// runs do not show it.  One list a joint, as asked.  file->refresh() is the caller's.
std::vector<std::vector<FitParameter>> fit_presliding(const std::vector<Run> &runs,
                                                      const std::vector<int> &joints, double block_s,
                                                      ArmFile *file);

} // namespace hdt::fit
