// SPDX-License-Identifier: Apache-2.0
//
// Hidden effects by name: what `--effect` takes and what it does to a plant.
//
// Owns: the menu of effects, their syntax, their defaults.
// Never: tells the host or the diagnosis what is hidden; shares anything with the diagnosis.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "model/hdt_arm.h"
#include "sim/plant.h"

namespace hdt::rig {

// NAME=SIZE[@JOINT][:key=value,...], e.g. "cable_spring=8@2", "order_line=4@2:order=37",
// "contact=6@4:from=10,to=12".  from and to: seconds of the plant's time.
struct HiddenEffect {
    std::string name;
    double size = 0;
    int joint = 2;                             // 1-based
    std::vector<std::pair<std::string, double>> options;
};

// Throws InputError listing the menu.
HiddenEffect parse_effect(const std::string &text);
// The menu with units, for --help.
std::string effect_menu();
// Their names, in the menu's order.
std::vector<std::string> effect_names();

// Put an effect into the plant.  Throws InputError when it does not fit.
void hide(plant_model &plant, const hdt_arm &arm, const HiddenEffect &effect);

// A file's effects, one a line, with the numbers of their lines; # begins a comment.  Throws InputError,
// also when there is none.
std::vector<std::pair<std::size_t, std::string>> effect_lines(const std::string &path);

// From options (throws UsageError) and from a file ("" for none; throws InputError with file and line).
void hide_all(plant_model &plant, const hdt_arm &arm, const std::vector<std::string> &effects,
              const std::string &effect_file);

// A body at the flange joins what is already there; com in the flange frame.
void add_payload(plant_model &plant, const hdt_arm &arm, double mass_kg, const double *com_m);

} // namespace hdt::rig
