// SPDX-License-Identifier: Apache-2.0
//
// Does a log mean what its header says?  Units, signs, sides and places of its columns against each
// other and against the arm, before anything is fitted.
//
// Owns: what is looked at, where a number is beyond doubt, the words.
// Never: changes a log; fits anything that is kept; says a thing it cannot tell.
#pragma once

#include <string>
#include <vector>

#include "model/hdt_arm.h"
#include "model/log.hpp"

namespace hdt {

// refuse: the log cannot mean what it says, and a fit would be of something else.
// warn: odd, and a fit may still be right.
struct LogFinding {
    std::string run;                // file
    int joint;                      // 1-based; 0: the whole run
    // angle_units angle_sign angle_range velocity_units velocity_sign velocity_other reference_units
    // reference_sign time_units columns_swapped joints_exchanged torque_side torque_units torque_scale
    // torque_sign load_sign gear_ratio arm_name
    std::string kind;
    bool refuse;
    double found, expected;         // the number the words give
    std::string words;              // "RUN: joint J: what; found and expected; what to do"
};

// In the order of runs, then joints.  A run too short or too still to tell by gives nothing.
std::vector<LogFinding> check_logs(const hdt_arm &arm, const std::vector<Run> &runs);

// One line each, the refusals or the warnings; empty when there is none.
std::string log_refusals(const std::vector<LogFinding> &findings);
std::string log_warnings(const std::vector<LogFinding> &findings);

} // namespace hdt
