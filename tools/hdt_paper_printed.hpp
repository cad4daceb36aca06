// SPDX-License-Identifier: Apache-2.0
//
// What Kennedy and Desai 2005 print: Tables I to VI as numbers, the gravity equations (9) to (13) as
// they stand and as the gradient of the potential energy.
//
// Owns: the printed numbers, nothing else; units as in the paper (N m output side, rad, s).
// Never: corrects a number.  What was corrected is in the functions named `right`.
#pragma once

#include <array>
#include <vector>

#include "model/hdt_arm.h"

namespace hdt::paper {

constexpr int printed_joints = 7;

// Table I: weighted residual variance, eq. (6), and "MSE per DOF".
struct PrintedModel { double variance, mse; };
struct PrintedModels { PrintedModel viscous, cubic, stribeck; };
extern const std::array<PrintedModels, printed_joints> table_1;

// Table II, as printed: negative rows carry negative Fs and Vc.
struct PrintedStribeck { double f0, fv, fs, vc; };
struct PrintedFriction { PrintedStribeck positive, negative; };
extern const std::array<PrintedFriction, printed_joints> table_2;
// The row as magnitudes along the motion, the form of hdt_arm.
hdt_arm_friction magnitudes(const PrintedStribeck &row);

// Table III: f in cycles per rad of output.
struct PrintedLine { double f, amplitude, phase; };
extern const std::array<std::array<PrintedLine, 2>, printed_joints> table_3;

// Table IV.
struct PrintedMasses { double l2, l4, lc2, lc4, lc6, m2, m4, m6; };
extern const PrintedMasses table_4;

// Table V, as printed; joints 1 to 4, positive then negative direction.
struct PrintedLines { double slope_1, t_1, slope_2, t_2, slope_3, zero; };
extern const std::array<std::array<PrintedLines, 2>, 4> table_5;
// The row as the joint-signed curve of hdt_arm: negative rows are torque along the motion (slopes
// and zero change sign) and hinges out of order are put in order.
hdt_arm_stiffness joint_signed(const PrintedLines &row, bool negative);
// The other way: a measured negative row in the paper's convention.
PrintedLines as_printed(const hdt_arm_stiffness &lines, bool negative);

// Gravity torques of joints 2 to 6 (entries 0 to 4) at joint angles 1 to 6, g = 9.81 m/s^2.
using GravityTorques = std::array<double, 5>;
using SixAngles = std::array<double, 6>;
GravityTorques printed_gravity(const PrintedMasses &m, const SixAngles &q_rad);   // (9) to (13) as printed
GravityTorques right_gravity(const PrintedMasses &m, const SixAngles &q_rad);     // dU/dq, closed form
double potential_j(const PrintedMasses &m, const SixAngles &q_rad);               // by forward kinematics

// Equations against the central difference of potential_j over random poses within +-pi.
struct EquationCheck {
    double printed_nm = 0, printed_negated_nm = 0, right_nm = 0; // worst differences
    double largest_nm = 0;                                       // largest true torque met
};
std::array<EquationCheck, 5> check_equations(const PrintedMasses &m, int poses, unsigned seed);

} // namespace hdt::paper
