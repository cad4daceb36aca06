// SPDX-License-Identifier: Apache-2.0
//
// What `hdt paper` measures and what it makes of it: from the experiments to the numbers of the
// paper's tables and figures.
//
// Owns: the plan of the experiments, their results as plain numbers.
// Never: prints (hdt_paper.cpp does).
#pragma once

#include <array>
#include <set>
#include <string>
#include <vector>

#include "tools/hdt_paper_fit.hpp"
#include "tools/hdt_paper_printed.hpp"
#include "tools/hdt_paper_runs.hpp"

namespace hdt::paper {

constexpr int sweep_joints = 4;
constexpr std::array<double, 4> payloads_kg = {0, 1.5, 3.0, 4.5};
constexpr double slow_radps = 0.01;      // "coulomb friction": torque at this speed
constexpr double sweep_radps = 0.05;     // the paper names no speed for its sweeps

// Parts of the paper, as --only names them.
enum Part { PART_FRICTION, PART_POSITION, PART_STIFFNESS, PART_LEMNISCATE, PART_JOINT_3, PART_LOW,
           PART_EQUATIONS };
// "table1,fig8" to parts; empty: all.  Throws InputError with the menu.
std::set<Part> parse_parts(const std::string &text);

struct Plan {
    Rig rig;
    int trials = 5;
    unsigned workers = 3;
    std::set<Part> parts;
    bool want(Part part) const { return parts.count(part) != 0; }
    // measured anyway, because a wanted part builds on it
    bool needs_stiffness() const;
    bool needs_friction() const;
};

// Directions: [0] positive, [1] negative.
struct JointFriction {
    std::array<std::vector<SpeedPoint>, 2> points;
    std::array<FrictionModelFit, 2> viscous, cubic, stribeck;
};

struct JointPosition {
    std::array<AngleTable, 2> turns;      // whole turns of the wave generator, magnitude along the motion
    std::array<AngleTable, 2> table;      // as much of the range as was swept: the host's lookup table
    std::array<std::vector<AngleLine>, 2> lines;
    std::array<double, 2> rest_rms_nm{};  // of the zero-mean torque less the two lines
    std::array<double, 2> rms_nm{};       // of the zero-mean torque
};

// A sweep of one payload in one direction, after each step of subtraction; joint-signed.
struct Subtracted {
    std::vector<double> q_rad, load_nm, total_nm, less_friction_nm, rest_nm;
    std::vector<double> less_smooth_nm;   // total less gravity and mean friction: periodic part kept
};

struct JointStiffness {
    std::array<std::vector<Subtracted>, 2> sweeps; // one a payload
    std::array<HingeFit, 2> fit;
    std::array<RegionRipple, 2> ripple;
    std::array<double, 2> gravity_at_minus_90_nm{}; // payload 0: half the sum of both ways; model
};

// A closed loop, repeated with other seeds: figures of each, and the first run whole.
struct Loop {
    LoopSetup setup;
    std::string what;
    LoopRun first;
    std::vector<LoopFigures> figures;
    std::string fault;                    // of any repetition
    double mean(double LoopFigures::*member) const;
    double most(double LoopFigures::*member) const;
};

// Where the load stands against the motion: holding it back, in the region of the step as measured,
// or beyond it, driving the joint.
enum Zone { ZONE_AGAINST, ZONE_STEP, ZONE_WITH, ZONES };

// Feedback and error of a sweep of joint 2 by zone.
struct LowRegion {
    std::string name, fault;
    std::array<double, ZONES> error_rad{};     // mean, link side
    std::array<double, ZONES> feedback_nm{};   // rms
    double error_max_rad = 0, feedback_share = 0;
    LoopRun run;
};

struct Results {
    std::array<JointFriction, printed_joints> friction;
    std::array<JointPosition, printed_joints> position;
    std::array<JointStiffness, sweep_joints> stiffness;
    hdt_arm measured{};                   // the file with friction, lines and Table V as measured
    hdt_arm file_with_lines{};            // the file with Table V as measured
    std::vector<Loop> lemniscate;
    Loop joint_3;
    std::vector<LowRegion> low;
    std::array<EquationCheck, 5> equations{};
};

// Run everything the plan wants.  `done`: share of the runs that are through.
Results carry_out(const Plan &plan, const std::function<void(double)> &done);

// Throws std::logic_error for a name no lemniscate loop has.
const Loop &loop_named(const Results &r, const std::string &name);

// Points of one joint from the means of its trials: mean and scatter over trials at each speed.
std::array<std::vector<SpeedPoint>, 2> points_of(const std::vector<std::vector<SpeedMean>> &trials);

// For comparisons: largest difference of two curves over the speeds the paper used, and eq. (6) as the
// mean of both directions.
double curve_gap_nm(const hdt_arm_friction &a, const hdt_arm_friction &b);
double mean_variance(const std::array<FrictionModelFit, 2> &fit);

} // namespace hdt::paper
