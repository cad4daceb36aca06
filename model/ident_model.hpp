// SPDX-License-Identifier: Apache-2.0
//
// Between the arm file and the least-squares problem: numbers of a joint in, fitted numbers out,
// with sigma and source.
//
// Owns: which key a fitted number is written to; how the base parameters and the gravity scale
// become links.
// Never: fits.  Included by model/ident*.cpp only.
#pragma once

#include <vector>

#include "model/ident.hpp"
#include "model/ident_solve.hpp"

namespace hdt::fit {

// As the file records a fitted number.  sigma NaN: there is no figure; the file then says low
// confidence.
Quantity quantity(std::vector<double> value, const char *unit, std::vector<double> sigma, const char *side);

// The file's numbers of one joint; nothing is free yet.
JointModel model_of(const hdt_arm_joint &joint);

// sigma of a number from the last estimate_sigma; 0 where it is not free.
double sigma_of(const JointFitState &j, Kind kind, int way, int index);

// Write one joint's friction, ripple and stiffness; list all of them, kept ones too.
std::vector<FitParameter> write_joint(const JointFitState &j, ArmFile *file, std::vector<std::string> *notes);

// Scale masses and first moments of every link by beta[0].
void write_scale(const Problem &p, ArmFile *file);
// Links with zero mass from base parameters; lists those fitted.
std::vector<FitParameter> write_base(const Problem &p, ArmFile *file);

// Columns that can become base parameters: of a link's ten those that do not belong to the link
// before it, and the rotor inertia of joints 2 and up where the file has none.
std::vector<int> base_candidates(const hdt_arm &arm);
// The size such a number can have in an arm of this length that needs the torque logged.
Eigen::VectorXd base_sizes(const hdt_arm &arm, const Problem &p);
// Is this shared column a rotor inertia?  Its joint (0-based), else -1.
int rotor_column(const hdt_arm &arm, int column);

} // namespace hdt::fit
