// SPDX-License-Identifier: Apache-2.0
//
// The PA-10 built by hand from paper Table IV, so that tests of kinematics, dynamics and tasks do
// not lean on the reader of model files.
//
// Owns: nothing but that arm.  Never: reads a file.
#pragma once

#include <cstring>

#include "model/hdt_arm.h"

inline void set_joint(hdt_arm *arm, int j, char axis, double height_m, double mass_kg, double com_m,
                      double limit_deg, double v_max_radps)
{
    // zero pose straight up: world axes at every joint, then z turned onto the joint's axis; the
    // link's centre lies on the arm's axis
    static const double about_z[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const double z_to_y[9] = {1, 0, 0, 0, 0, 1, 0, -1, 0}; // joint z along +y
    static const double y_to_z[9] = {1, 0, 0, 0, 0, -1, 0, 1, 0};
    hdt_arm_joint *k = &arm->joint[j];
    const bool previous_y = j > 0 && arm->joint[j - 1].name[0] == 'y';
    k->name[0] = axis;
    k->ratio = 50;
    k->q_max_rad = limit_deg * 3.14159265358979323846 / 180;
    k->q_min_rad = -k->q_max_rad;
    k->v_max_radps = v_max_radps;
    std::memcpy(k->rot, axis == 'y' ? z_to_y : previous_y ? y_to_z : about_z, sizeof k->rot);
    k->origin_m[previous_y ? 1 : 2] = previous_y ? -height_m : height_m;
    k->has_inertial = 1;
    k->mass_kg = mass_kg;
    k->moment_kgm[axis == 'y' ? 1 : 2] = (axis == 'y' ? -1 : 1) * mass_kg * com_m;
}

// The arm of paper Table IV, drawn from its fig. 6: axes z y z y z y z, all centres on the axis;
// limits of the real PA-10.
inline hdt_arm table_four_arm()
{
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    arm.joints = 7;
    arm.gravity_mps2[2] = -9.81; // as the worked torques
    for (int i = 0; i < 3; ++i)
        arm.flange_rot[4 * i] = 1;
    set_joint(&arm, 0, 'z', 0.115, 0, 0, 177, 1);
    set_joint(&arm, 1, 'y', 0.2, 9.86, 0.32, 94, 1);
    set_joint(&arm, 2, 'z', 0, 0, 0, 174, 2);
    set_joint(&arm, 3, 'y', 0.45, 2.18, 0.17, 137, 2);
    set_joint(&arm, 4, 'z', 0, 0, 0, 255, 6.28);
    set_joint(&arm, 5, 'y', 0.5, 4.34, -0.09, 165, 6.28);
    set_joint(&arm, 6, 'z', 0, 0, 0, 255, 6.28);
    arm.flange_m[2] = 0.08;
    return arm;
}
