// SPDX-License-Identifier: Apache-2.0
//
// The declared joint model in double precision: what the core computes in fixed point, term
// by term.
//
// Owns: the meaning of every term of hdt_arm, once, in floating point.
// Never: fits anything; knows nothing of hidden effects of the simulator.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"

namespace hdt {

// What a term needs to know of one sample of the whole arm.
struct Sample {
    double t_s;                     // since the run began (cold start)
    Eigen::VectorXd q, v, a;        // output side
    Eigen::VectorXd dir;            // direction of motion, -1..1
    Eigen::VectorXd travel;         // rad since the last reversal
    Eigen::VectorXd wound = {};     // wind-up, -1..1, of joints with a wind-up travel; empty: the direction
};

using TermTorque = std::array<double, HDT_TERMS>;

// Torque of every term of every joint, N.m output side; feedback terms zero.
std::vector<TermTorque> arm_terms(const hdt_arm &arm, const Sample &s);

// Velocity friction magnitude along motion, speed >= 0 [Kennedy and Desai 2005, eq. (7)].
double stribeck_nm(const hdt_arm_friction &f, double speed_radps);

// Soft wind-up torque, joint-signed, of the three lines at load x, for full motion in the set's
// direction: line 1 below t1, line 2 up to t2, line 3 above; continuous; the line that holds load 0
// has the value zero_nm there.
double stiffness_nm(const hdt_arm_stiffness &k, double load_nm);

// The line that holds load 0, from 0.
int home_line(const hdt_arm_stiffness &k);

// The same as value of each line at zero load, N.m.
struct StiffnessLines { double intercept_nm[3]; };
StiffnessLines stiffness_lines(const hdt_arm_stiffness &k);

// Curve at x, its ends held.
double curve_nm(const hdt_arm_curve &c, double x);
// Friction of the place, magnitude along motion in that direction (0 positive, 1 negative).
double local_nm(const hdt_arm_joint &joint, int way, double q_rad);
// The joint's free table.
double table_nm(const hdt_arm_joint &joint, double q_rad, double speed_radps, double load_nm);

// Torque of an adopted cable spring; loads the gear as gravity does.
double spring_nm(const hdt_arm_joint &joint, double q_rad);

// N^2 (rotor + wave generator) + adopted extra inertia, kg.m^2 output side.
double reflected_inertia_kgm2(const hdt_arm_joint &joint);

} // namespace hdt
