// SPDX-License-Identifier: Apache-2.0
//
// What log_check.cpp holds a run's columns against: means over short blocks, the angle's own rate, the
// torque that gravity and friction leave in a sound log.
//
// Owns: block means, rates, the two small fits of torque.
// Never: judges; fits anything that is kept.
#pragma once

#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"
#include "model/log.hpp"

namespace hdt {

// One joint's columns over blocks of about 20 ms, all of the same length; empty where the log has none.
struct CheckColumns {
    Eigen::VectorXd q, tau, v, qref, vref;
    Eigen::VectorXd rate, second;   // first and second difference quotient of q
    Eigen::VectorXd tau_rate, v_rate;
};

struct CheckRows {
    double block_s = 0;             // a block's length
    std::vector<CheckColumns> joint; // as many as the arm has
    Eigen::Index rows = 0;
};

// Blocks with a neighbour on either side and no gap between.
CheckRows check_rows(const Run &run, const hdt_arm &arm);

// y over x: the factor through the origin, and how much of y it explains, as a correlation.
struct Match { double factor = 0, r = 0; };
Match match(const Eigen::VectorXd &x, const Eigen::VectorXd &y);
// The same of what varies: both less their means.
Match match_centred(const Eigen::VectorXd &x, const Eigen::VectorXd &y);

// The share-th part of |x|, 0.5 the median.
double quantile_abs(const Eigen::VectorXd &x, double share);

// What a torque holds of a joint's load and friction, over the blocks in which the joint moves.
// r: partial correlation, 0 when there is nothing to tell it by.
struct TorqueShare {
    Eigen::Index moving = 0;
    int turns = 0;                          // changes of direction
    double forth_share = 0;                 // of the moving blocks
    double load = 0, load_r = 0;            // factor on the model's rigid-body torque; 0 without masses
    double load_sd_nm = 0;                  // what of that torque is not friction's to take
    double friction_nm = 0, friction_r = 0; // mean along the motion
    double friction_model_nm = 0;           // 0: the model has none
    double whole = 0, whole_r = 0;          // factor on load and friction as the model has them
};

// The model's torque, and the columns that a load of unknown masses may have, per joint.
struct LoadColumns {
    std::vector<Eigen::VectorXd> nm;     // rigid body, payload included; empty without masses
    std::vector<Eigen::MatrixXd> any;    // gravity of any masses
};
LoadColumns load_columns(const hdt_arm &arm, const CheckRows &rows);

// Of joint k of the load columns.
TorqueShare torque_share(const Eigen::VectorXd &tau_nm, const hdt_arm_joint &joint,
                         const CheckColumns &motion, const LoadColumns &load, std::size_t k);

// Part of a torque's square that the model's load and friction leave, their size free up to a
// factor of most; at most 2, and -1 when the joint does not move enough to tell.
double torque_left(const Eigen::VectorXd &tau_nm, const hdt_arm_joint &joint, const CheckColumns &motion,
                   const Eigen::VectorXd &load_nm, double most);

} // namespace hdt
