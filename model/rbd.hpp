// SPDX-License-Identifier: Apache-2.0
//
// Rigid-body kinematics and dynamics of the chain in double precision.
//
// Owns: forward kinematics, Jacobian, inverse dynamics (recursive Newton-Euler), gravity torque,
// the linear regressor in standard inertial parameters.
// Never: friction, gears, rotors; no state; allocation only of what it returns.
//
// Vectors have one entry per joint of the arm; another size throws std::invalid_argument.  A link
// without inertial numbers (has_inertial 0) has no mass.  The payload is a point mass.
#pragma once

#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"

namespace hdt::rbd {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

struct Pose { Matrix3d rot; Vector3d pos; };

// Every joint frame (turned by its q) in the base frame, then the flange: joints + 1 poses.
std::vector<Pose> frames(const hdt_arm &arm, const VectorXd &q_rad);
// Flange in the base frame.
Pose flange(const hdt_arm &arm, const VectorXd &q_rad);
// 6 x n, rows vx vy vz wx wy wz of the flange, base frame.
MatrixXd jacobian(const hdt_arm &arm, const VectorXd &q_rad);
// Joint torques of links and declared payload (no rotors), N.m output side.
VectorXd inverse_dynamics(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd);
// Holding torque dU/dq, payload included.
VectorXd gravity(const hdt_arm &arm, const VectorXd &q);
// Potential energy of links and payload, J.
double potential_j(const hdt_arm &arm, const VectorXd &q);
// n x 10(n+1): d tau / d (m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz) of each link about its joint
// origin; the last ten columns are a body fixed to the flange, about the flange origin.
MatrixXd regressor(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd);

} // namespace hdt::rbd
