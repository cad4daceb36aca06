// SPDX-License-Identifier: Apache-2.0
//
// Reference motions: what `--task` names.  Computed whole before a run starts, so that the cycle
// only reads arrays.
//
// Owns: the menu of tasks, inverse kinematics, limits of a reference.
// Never: runs anything.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"

namespace hdt {

struct Reference {
    double rate_hz = 0;
    uint32_t active = 0;                     // bit per joint: driven; others stay braked
    Eigen::MatrixXd q_rad, v_radps, a_radps2; // rows: samples, columns: joints
    std::string name;
};

struct TaskInfo { const char *name, *arguments, *what; };
const std::vector<TaskInfo> &task_menu();

// "lemniscate", "lemniscate:laps=2", "excite:seed=7,seconds=40", "sweep:joint=2", "friction:joint=2",
// "trapezoid:joint=3", "hold".  Starts and ends at rest; stays inside the arm's limits.
// Throws InputError naming the task, what is wrong and the menu.
Reference make_task(const hdt_arm &arm, const std::string &spec, double rate_hz);

// Joint angles that bring the flange to a pose, joints not in `free` kept as in seed.
// Throws InputError when out of reach.
Eigen::VectorXd inverse_kinematics(const hdt_arm &arm, const Eigen::Matrix3d &rot, const Eigen::Vector3d &pos,
                                   const Eigen::VectorXd &seed, uint32_t free);

} // namespace hdt
