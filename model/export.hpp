// SPDX-License-Identifier: Apache-2.0
//
// The arm as other simulators read it: URDF and MuJoCo's MJCF, as text.
//
// Owns: bodies about their centre of mass, limits at the output, names, XML.
// Never: writes friction, gear stiffness or ripple: what is written is the rigid-body arm, so that its
// torques are those of model/rbd.hpp; makes up a mass; touches a file.
#pragma once

#include <string>

#include "model/hdt_arm.h"

namespace hdt {

enum class ExportFormat { Urdf, Mjcf };

struct ExportOptions {
    bool armature = false;   // MJCF: rotor, wave generator and adopted inertia, output side, at each joint
    bool kinematics = false; // URDF: no masses at all, for an arm that has none
};

// The whole file.  Links are NAME_link for joint NAME, then flange and, when the file declares one,
// payload.  Lengths in m, angles in rad, torque and speed limits output side; numbers read back bit for
// bit.  Throws InputError when a link is not a body the format can hold.
std::string export_text(const hdt_arm &arm, ExportFormat format, const ExportOptions &options);

} // namespace hdt
