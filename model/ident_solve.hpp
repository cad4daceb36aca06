// SPDX-License-Identifier: Apache-2.0
//
// The least-squares problem of identification: joints with columns of their own, tied together by
// shared columns, solved by orthogonal decompositions; and what its result is worth.
//
//   y_j = own_j(vc) theta_j + shared_j beta + e_j,   weight 1 / rms(e_j)
//
// Owns: columns, solution, search of the Stribeck speed, covariance by clusters of rows.
// Never: decides what is fitted.  Included by model/ident*.cpp and its test only.
#pragma once

#include <vector>

#include <Eigen/Dense>

#include "model/ident.hpp"
#include "model/ident_rows.hpp"

namespace hdt::fit {

// KINK: change of slope at a knot, outward from load 0; KNOT: the load it is at.
enum Kind { F0, FV, FS, VC, RIPPLE_SIN, RIPPLE_COS, KINK_1, KINK_2, KNOT_1, KNOT_2 };

// way: 0 positive, 1 negative direction; index: ripple line.
struct Column { Kind kind; int way, index; };

// Numbers of one joint, fitted or kept.
struct JointModel {
    hdt_arm_friction friction[2] = {};
    bool free_f0[2] = {}, free_fv[2] = {}, free_fs[2] = {}; // free_fs: and vc
    bool one_fv = false;                // one viscous slope for both directions; its column is way 0's
    std::vector<double> ripple;         // sin, cos of every line
    std::vector<char> free_ripple;      // per line
    bool has_stiffness = false, free_stiffness[2] = {};
    hdt_arm_stiffness stiffness[2] = {};
    double kink[2][2] = {};             // [way]: change of slope at the knots, outward from load 0
    // [way]: the loads end inside the fall; its outer knot is the last load, and beyond it the torque is held
    bool cut_off[2] = {};
};

struct JointFitState {
    JointRows rows;
    JointModel model;
    double weight = 1;
    // of the last solve; sigma 0 for what is not free
    double rms = 0;
    std::vector<Column> columns;
    Eigen::VectorXd sigma;              // per column
};

struct Problem {
    std::vector<JointFitState> joint;   // those with data
    std::vector<int> shared_free;       // indices of shared columns that are fitted
    Eigen::VectorXd shared_size;        // what a shared number is expected to be at most; empty: no idea
    double ridge = 0;                   // weight of that expectation, in rows
    Eigen::VectorXd beta;               // all shared columns; kept ones hold their value
    Eigen::VectorXd beta_sigma;         // 0 where kept
};

// Slope changes of the three lines against the line that holds load 0, and back.
void kinks_of(const hdt_arm_stiffness &k, double kink[2]);
void slopes_from(const double kink[2], hdt_arm_stiffness *k);

// Columns of what is free in this joint; with_nonlinear: also the derivatives to Stribeck speed and
// knots.
std::vector<Column> free_columns(const JointModel &m, bool with_nonlinear);
Eigen::VectorXd column(const JointFitState &j, const Column &c);
// Torque of the joint's own terms at the present numbers.
Eigen::VectorXd own_torque(const JointFitState &j);
Eigen::VectorXd residual(const Problem &p, const JointFitState &j);

// Take the numbers that belong to this column from another model.
void restore(const JointModel &from, const Column &c, JointModel *m);

// Takes own columns that depend on earlier ones out of the fit and names them (joint index, column).
std::vector<std::pair<std::size_t, Column>> release_dependent(Problem *p);

// Solve for everything free; sets numbers and rms.  A column that depends on earlier ones is
// released from the fit and named in the returned list (joint index, column).
std::vector<std::pair<std::size_t, Column>> solve(Problem *p);

// A search that changes numbers of one joint only and says whether one moved, on all joints at once;
// true if one moved.
bool search_joints(Problem *p, bool (*search)(const Problem &, JointFitState *));

// Best Stribeck speed per joint and direction for the present shared numbers; true if one moved.
bool search_stribeck(Problem *p);

// Best knots of the soft wind-up lines, for joints whose lines are fitted; true if one moved.
bool search_knots(Problem *p);
// Blocks in motion that each of the three lines must have, both ways.
constexpr Eigen::Index min_region_blocks = 20;

// Those of the candidates that add anything beyond own columns, which do not depend on each other, and
// each other.
std::vector<int> independent_shared(const Problem &p, const std::vector<int> &candidates);
// The weight of the expected sizes that predicts left-out stretches of time best.
double best_ridge(const Problem &p);

// Straight line, cubic and Stribeck's curve, each fitted to what friction has to explain.
std::vector<FrictionScore> compare_friction(const Problem &p, const JointFitState &j);

// sigma of everything free, from leaving out one run, or one stretch of time, after the other.
void estimate_sigma(Problem *p);

} // namespace hdt::fit
