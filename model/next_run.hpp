// SPDX-License-Identifier: Apache-2.0
//
// Which task of the menu would tell an effect from its rivals: what each, fitted to the logs at hand,
// would show there, by the declared model alone.
//
// Owns: the list of tasks tried, the predicted separation.
// Never: needs torque of a task that has not been run; runs anything.
#pragma once

#include <string>
#include <vector>

#include "model/candidates.hpp"

namespace hdt {

struct NextRun {
    std::string task;               // of `hdt host --task`; empty when no task could be made for this arm
    double payload_kg = 0;          // known, to be hung on the flange for it; 0: none
    // least over rivals: rms of the difference beside friction, over the floor
    double separation = 0;
    double at_hand = 0;             // the same on the logs at hand
    std::string rival;              // the one that stays closest
};

// effect_nm: the effect's torque on any rows of this joint; rivals: ids of families of w.
NextRun choose_next_run(const hdt_arm &arm, const JointWork &w, const std::vector<std::string> &rivals,
                        const std::function<Eigen::VectorXd(const BlockRows &)> &effect_nm);

// The command line of a task.
std::string host_line(const hdt_arm &arm, const std::string &task);

} // namespace hdt
