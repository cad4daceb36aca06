// SPDX-License-Identifier: Apache-2.0
//
// Is a joint worse with the model as written than with the model given?
//
// Owns: the comparison of two models on the same rows, with its own scatter.
// Never: changes a model.  Included by model/ident*.cpp only.
#pragma once

#include "model/ident_rows.hpp"

namespace hdt::fit {

// Root mean square of measured less declared; NaN without rows.
double error_nm(const JointRows &r);

// True when `after` is clearly worse than `before`: more than three times what the difference of the
// squared errors scatters by from one stretch of time to the next, and more than half a percent.  Rows are
// those of the same runs, conditioned once.  False without rows.
bool clearly_worse(const JointRows &before, const JointRows &after);

} // namespace hdt::fit
