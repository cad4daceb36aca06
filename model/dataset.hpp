// SPDX-License-Identifier: Apache-2.0
//
// From a raw run to rows a regression can use: smooth velocity and acceleration, direction, travel,
// masks, and averaging over short blocks, the same for torque and every regressor, so that fast
// torque lines are neither aliased nor biased.
//
// Owns: conditioning, masks with their counts, block means.
// Never: fits; changes the torque.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"
#include "model/log.hpp"
#include "model/terms.hpp"

namespace hdt {

struct ConditionOptions {
    double block_s = 0.01;
    // slower rows are masked for friction's sake; 0: chosen from the resolver step
    double v_min_radps = 0;
    double reversal_guard_s = 0;    // rows this close to a change of direction are masked too
    double reversal_travel_rad = 0; // and rows with less travel than this behind them since
    // rows this close to the fall of the declared soft wind-up are masked; 0: none
    double soft_margin_nm = 0;
};

// N.m around the fall of the declared soft wind-up that fits of small things leave out.
inline constexpr double fall_margin_nm = 5;

// Why rows were masked; a row is counted once, under the first reason that holds in the order
// gap, spike, saturated, standstill, soft.
struct MaskCount { std::size_t standstill = 0, spike = 0, saturated = 0, gap = 0, soft = 0; };

// Full-rate signals of one run, columns are joints (absent joints are zero and wholly masked).
struct Conditioned {
    std::string name;
    double rate_hz = 0;
    Eigen::VectorXd t_s;            // since the start of the run
    Eigen::MatrixXd q, v, a, dir, tau; // q and tau as logged; dir is 0 at standstill
    Eigen::MatrixXd travel, built_up; // since the turning point; 0.5 until the first, then 1
    Eigen::MatrixXd temp;           // rows x joints, or empty
    double payload_kg = 0;          // declared for this run (run constant, else the arm's)
    Eigen::Vector3d payload_com_m = Eigen::Vector3d::Zero();
    bool payload_declared = false;  // by the run itself: it stands in place of the arm's
    Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> valid;
    std::vector<MaskCount> masked;  // per joint
    std::vector<char> present;      // per joint
    // per joint of the run: joints (1-based) whose angle the run does not have and that move mass this one
    // carries or turn it against gravity; they are taken as standing at zero
    std::vector<std::vector<int>> unknown_angles;
    Eigen::VectorXd smooth_s;       // per joint: half width of the smoother that gave v and a
    Eigen::VectorXd v_noise, a_noise, v_min; // per joint: standard deviations, standstill threshold
    std::vector<Eigen::Index> block_begin; // block b is rows [block_begin[b], block_begin[b+1])

    Sample sample(Eigen::Index row) const;
    // Blocks of joint j with enough valid rows, in time order.
    std::vector<Eigen::Index> blocks(int j) const;
    // Mean over the valid rows of each such block.
    Eigen::VectorXd block_mean(int j, const Eigen::Ref<const Eigen::VectorXd> &full) const;
    // The same for every column at once.
    Eigen::MatrixXd block_means(int j, const Eigen::Ref<const Eigen::MatrixXd> &full) const;
};

// The arm with this run's declared payload in place.
hdt_arm arm_for_run(const hdt_arm &arm, const Conditioned &c);

// Throws InputError when the run does not fit the arm (joint count, unit of q, sampling).
Conditioned condition(const Run &run, const hdt_arm &arm, const ConditionOptions &options);

// The unknown angles of one joint (1-based) in every run as a sentence: which, what is assumed, what to do;
// empty where no run lacks one.
std::string unknown_angle_words(int joint, const std::vector<std::vector<int>> &per_run);

// Torque of every term of the declared model, full rate: [joint] -> rows x HDT_TERMS.
std::vector<Eigen::MatrixXd> declared_terms(const hdt_arm &arm, const Conditioned &c);

} // namespace hdt
