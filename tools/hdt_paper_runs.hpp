// SPDX-License-Identifier: Apache-2.0
//
// The experiments of Kennedy and Desai 2005 in the rig: the arm mounted as they mounted it, host and
// servo over the bus, torque from the telegrams; and what each run says.
//
// Owns: mounting, motions, what is kept of a run, the measurements made from it.
// Never: looks at the plant for anything but the true link angle, by which closed-loop errors are
// measured; fits (hdt_paper_fit) or prints (hdt_paper).
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "model/task.hpp"
#include "tools/hdt_paper_fit.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::paper {

// What all runs share.
struct Rig {
    hdt_arm arm{};                       // what the arm is, and what the host knows unless told otherwise
    uint64_t individual = 0, seed = 1;
    const std::atomic<bool> *stop = nullptr; // true: runs throw Stopped
};

struct Stopped : std::runtime_error {
    Stopped() : std::runtime_error("stopped") {}
};

// Throws InputError when it is not an arm of this kind (seven joints, gears, friction).
void require_pa10(const hdt_arm &arm);

// Do all jobs, at most `workers` at once; the first exception is thrown again when all have ended.
// `done` is called (from any thread, one at a time) with the share of jobs that are through.
void in_parallel(std::vector<std::function<void()>> jobs, unsigned workers,
                 const std::function<void(double)> &done);

// ---- mounting ----

// Gravity along the joint's own axis with all joints at zero: no load on it anywhere in its range.
// On the PA-10 the wall for joints 2, 4, 6, the pedestal for 1, 3, 5, 7.
hdt_arm without_load(const hdt_arm &arm, int joint);
// As for the load sweeps: wall for joints 1 and 3, pedestal for others; payload at the flange, known.
hdt_arm mounted_for_sweep(const hdt_arm &arm, int joint, double payload_kg);
// The motion of such a sweep, e.g. "sweep:joint=1,speed=0.05,q2=1.57".
std::string sweep_task(int joint, double speed_radps);

// ---- velocity mode: the servo's torque is the estimator ----

// One joint of one run, samples at constant reference speed only.  Torque as the telegrams say it,
// times the gear ratio; angle from the resolver.
struct Trace {
    std::vector<double> q_rad, vref_radps, tau_nm;
};
// Throws InputError when the run ends with a fault, naming it.
Trace velocity_run(const Rig &rig, const hdt_arm &mounted, const std::string &task, int joint, uint64_t seed);

// Mean torque along the motion over whole turns of the wave generator, of every stretch of constant
// speed in order of time.
struct SpeedMean { double speed_radps; bool negative; double mean_nm; double turns; };
std::vector<SpeedMean> speed_means(const Trace &trace, double ratio);

// Samples of one direction averaged into bins of travel.
struct Swept { std::vector<double> q_rad, tau_nm; };
Swept one_way(const Trace &trace, bool negative, double bin_rad);

// ---- torque mode: the closed loop ----

// How a closed loop is set up; terms: mask of hdt_term per joint kept in the host's tables.
struct LoopSetup {
    std::string name;
    hdt_arm host{};                      // the model the host uses
    std::array<uint32_t, 16> terms{};    // kept terms; zero: all the tables have
    double kp_times = 1, kd_times = 1;
    bool follow_fault = true;            // the host's following-error fault
};

// A closed-loop run as it went, one row a host period of the reference.
struct LoopRun {
    std::string fault;                   // empty: ran to its end
    std::vector<double> t_s;
    Eigen::MatrixXd ref_rad, seen_rad, link_rad;             // rows x joints
    Eigen::MatrixXd friction_nm, gravity_nm, stiffness_nm, inertia_nm, feedback_nm, total_nm;
    uint32_t active = 0;
};
LoopRun torque_run(const Rig &rig, const LoopSetup &setup, const Reference &reference, uint64_t seed);

// Eq. (14) once round, entered at full speed from standstill, as eq. (14) says it from t = 0.
Reference lemniscate_at_speed(const hdt_arm &arm);

// What the closed loop is worth.
struct LoopFigures {
    double error_mean_mm = 0, error_max_mm = 0;  // true flange, after the first second
    double first_second_max_mm = 0;
    double seen_mean_mm = 0, seen_max_mm = 0;    // as the host's resolvers say it, after the first second
    double fall_mm = 0;                          // most the flange was below its reference
    double feedback_share = 0;                   // rms of feedback over rms of total torque, driven joints
    std::vector<double> joint_mean_rad, joint_max_rad, joint_feedback_share; // per joint, link side
    std::vector<double> error_mm;                // per row
    Eigen::MatrixXd path_m, reference_m;         // rows x 3
};
LoopFigures figures_of(const hdt_arm &arm, const LoopRun &run);

} // namespace hdt::paper
