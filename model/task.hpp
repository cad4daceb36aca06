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

// Acceleration is continuous and all three agree: v is the derivative of q, a of v.
struct Reference {
    double rate_hz = 0;
    uint32_t active = 0;                     // bit per joint: driven; others stay braked
    Eigen::MatrixXd q_rad, v_radps, a_radps2; // rows: samples, columns: joints
    std::string name;
};

struct TaskInfo { const char *name, *arguments, *what; };
const std::vector<TaskInfo> &task_menu();

// "lemniscate", "lemniscate:laps=2", "excite:seed=7,seconds=40,joints=2,4", "sweep:joint=2,q4=1.57",
// "friction:joint=2", "trapezoid:joint=3", "hold".  q1, q2, ... set the pose the task starts from or
// is built around.  Starts and ends at rest; stays inside the arm's position and speed limits.  All
// but lemniscate and hold also keep every point beyond the shoulder 0.05 m above the mounting plane
// (base z = 0) and out of the base column.  The same text gives the same motion on every machine.
// Throws InputError naming the task, what is wrong and the menu.
Reference make_task(const hdt_arm &arm, const std::string &spec, double rate_hz);

// A point of paper eq. (14), base frame, at path parameter u (s; period 4 pi), and the orientation
// the flange keeps there: the base turned 90 deg about y, so the tool points
// along base x, well away from the wrist's singularity.
Eigen::Vector3d lemniscate_m(double u_s);
Eigen::Matrix3d lemniscate_rot();

// Joint angles that bring the flange to a pose within 1e-11 m and rad, joints not in `free` kept as
// in seed.  Takes the solution nearest the seed that Newton's method finds; position limits are not
// looked at.  Throws InputError when out of reach.
Eigen::VectorXd inverse_kinematics(const hdt_arm &arm, const Eigen::Matrix3d &rot, const Eigen::Vector3d &pos,
                                   const Eigen::VectorXd &seed, uint32_t free);

} // namespace hdt
