// SPDX-License-Identifier: Apache-2.0
//
// Tables of the core made from the numbers of a model; the C entry is hdt_arm_tables in hdt_arm.h.
//
// Owns: the choice of scaling and of the limits a model file leaves open; the C source form.
// Never: clips a number that does not fit: it names the key and refuses.
#pragma once

#include <string>

#include "ctrl/hdt_tables.h"

namespace hdt {

// What hdt_arm_tables sets where the model file has no key for it.
struct TableDefaults {
    static constexpr double follow_rad = 0.5;    // following error that is a fault
    static constexpr double slew_s = 0.05;       // from zero to full torque
    static constexpr double speed_margin = 1.2;  // speed that is a fault, over limits.speed
    static constexpr double v_ramp_radps = 0.01; // direction ramps within this, or half the slowest
                                                 // fitted speed if that is less
    static constexpr double a_lim_radps2 = 128;  // reference acceleration the inertia term follows, or
                                                 // the next half of it the core's sums have room for
    static constexpr double observer_share = 0.25; // the observer's corner over control.velocity_cutoff
    static constexpr unsigned stale_periods = 20;
    static constexpr double friction_span = 1.5; // friction is measured over this times valid speed
};

// A C99 source that defines `const struct hdt_tables hdt_tables_NAME`; characters of name that C
// does not allow become '_'.  No date: the same tables give the same bytes.
std::string tables_c_source(const hdt_tables &t, const std::string &name);

} // namespace hdt
