// SPDX-License-Identifier: Apache-2.0
//
// Rows of identification: per joint, what the fitted terms have to explain, and the raw material of
// their columns, as block means over all runs.
//
// Owns: how torque and regressors become rows, which run and which stretch of time a row is from.
// Never: solves anything.  Included by model/ident*.cpp only.
#pragma once

#include <vector>

#include <Eigen/Dense>

#include "model/dataset.hpp"

namespace hdt::fit {

struct JointRows {
    int joint = 0;                  // 0-based
    Eigen::VectorXd y;              // measured torque less all terms that are not fitted
    Eigen::VectorXd share[2];       // share of the block moving that way: 1 or 0, between at a reversal
    Eigen::VectorXd speed[2];       // mean |v| of that share
    Eigen::MatrixXd ripple;         // sin, cos of every declared line, times direction
    Eigen::VectorXd load;           // declared gravity torque, N.m
    Eigen::MatrixXd shared;         // columns of the parameters the joints have in common
    std::vector<Eigen::Index> run_begin, piece_begin; // first row of every run, of every stretch; then rows
    // not fitted, for the errors and pictures
    Eigen::VectorXd t_s, q, v, measured, declared, friction;
    std::size_t masked = 0;

    Eigen::Index rows() const { return y.size(); }
};

// Columns the joints have in common: 1 when masses are known, else 10 per link (standard
// parameters) and one rotor inertia per joint.
Eigen::Index shared_columns(const hdt_arm &arm);
bool masses_known(const hdt_arm &arm);

// Conditioned on all cores; the order of runs is kept.
std::vector<Conditioned> condition_all(const std::vector<Run> &runs, const hdt_arm &arm,
                                       const ConditionOptions &options);

// One entry per joint of the arm; joints without data have no rows.  with_columns: also what only a
// fit needs (ripple, shared).
std::vector<JointRows> make_rows(const hdt_arm &arm, const std::vector<Conditioned> &runs, bool with_columns);

} // namespace hdt::fit
