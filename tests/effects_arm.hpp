// SPDX-License-Identifier: Apache-2.0
//
// Owns: an arm with every effect that is a number or a line, on each joint, of sizes a real one could have.
// Never: curves, nor the wind-up with a travel, which takes the place of the declared one.
#pragma once

#include "model/hdt_arm.h"

inline hdt_arm with_named_effects(hdt_arm arm)
{
    for (int j = 0; j < arm.joints; j++) {
        hdt_arm_joint &joint = arm.joint[j];
        joint.load_mu = 0.05;
        joint.cold_coulomb_nm = 3;
        joint.cold_viscous_nmspr = 4;
        joint.warm_s = 900;
        joint.presliding_nm = 1;
        joint.presliding_rad = 1e-3;
        joint.spring_nmprad = 2;
        joint.spring_q0_rad = 0.3;
        joint.torque_offset_nm = -0.7;
        joint.extra_inertia_kgm2 = 0.4;
        joint.lines = 2;
        joint.line[0] = {100.5, 0.6, 0.2, 1};
        joint.line[1] = {1.5, 0.5, -0.4, 0};
    }
    return arm;
}
