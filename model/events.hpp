// SPDX-License-Identifier: Apache-2.0
//
// What begins or ends within a run, or lives in one run only: a push, a snag, a brake that drags, a
// joint that slips.  No model could hold it; it has to be told from what repeats, and kept out of a fit.
//
// Owns: the search for such stretches of time in what a joint's model leaves.
// Never: explains what the runs share; reads held-out runs.
#pragma once

#include <string>
#include <vector>

#include "model/candidates.hpp"

namespace hdt {

struct Event {
    int joint = 0;                  // 1-based
    std::string run;                // file
    double from_s = 0, to_s = 0;    // in the run's own time, to half a bin
    // "torque": joint-signed; "friction": against motion; "angle": the resolver's
    std::string kind;
    double torque_nm = 0;           // its size over the stretch; friction: magnitude, torque: joint-signed
    double angle_rad = 0;           // "angle" only
    double log_likelihood = 0;      // gained by it, beside what a search this wide finds in noise
    std::size_t run_index = 0;      // among those to fit
};

// Events of one joint beside all that was found; axis: what explains the rest without a name, or empty.
// Empty too when more than a third of the runs show one: then it is the model that does not fit.
std::vector<Event> find_events(const JointWork &w, const Found &axis);

// Rows outside the events of this joint, with a margin of half a second.
BlockRows without_events(const BlockRows &b, const std::vector<Event> &events);

} // namespace hdt
