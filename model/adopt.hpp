// SPDX-License-Identifier: Apache-2.0
//
// From fitted coefficients to numbers with names, and into the model file.
//
// Owns: what each effect's numbers are called, their units, how they combine with numbers already there.
// Never: estimates.
#pragma once

#include <vector>

#include "model/arm_file.hpp"
#include "model/candidates.hpp"
#include "model/diagnose.hpp"

namespace hdt {

// Coefficients of one joint, fitted together.
struct JointEstimate {
    Eigen::VectorXd friction;                    // as nuisance_columns
    Eigen::VectorXd friction_sigma;
    std::vector<Eigen::VectorXd> theta;          // per found effect
    std::vector<Eigen::MatrixXd> covariance;
    double rest_sigma_rad = 0;                   // of a spring found, 0 where there is none
};

// The constant torque that unequal Coulomb friction of the estimate stands for.
EffectParameter offset_parameter(const JointWork &w, const JointEstimate &e);

// Numbers of found effect k, as the diagnosis prints them.
std::vector<EffectParameter> effect_parameters(const hdt_arm &arm, const JointWork &w, const JointEstimate &e,
                                               std::size_t k);
// What was not written, and why: words that end "ID is not adopted: ".
struct Refused {
    std::string id;
    int joint;                                   // 1-based; 0: of the whole arm
    std::size_t found;                           // place in JointWork::found; kNoName: a curve over an axis
    std::string why;
};
constexpr std::size_t kNoName = static_cast<std::size_t>(-1);
struct Adoption {
    std::vector<Refused> refused;                // empty when all was written
    Eigen::VectorXd friction;                    // how much of the estimate's the file has taken in
};
// All found effects of a joint, and the friction fitted beside them where it is wanted and none is refused:
// beside what the file cannot hold it is right only with it.  Chain effects are left to adopt_chain.
Adoption adopt_joint(ArmFile *file, const JointWork &w, const JointEstimate &e, bool with_friction);
// A curve over an axis no name fits, N.m at the axis' knots: theta
// is what was fitted beside the effects found.
Eigen::VectorXd axis_curve_nm(const JointWork &w, const JointEstimate &e, const Eigen::VectorXd &theta);
// That curve as the joint's one table.  Returns why it is not written, empty when it is.
std::string adopt_axis(ArmFile *file, const JointWork &w, const JointEstimate &e, const Found &axis,
                       const Eigen::VectorXd &theta);
// Coulomb and viscous friction on top of the declared one, as nuisance_columns, and nothing
// else.  Taken as it is: what was fitted beside a gain goes through adopt_joint, what is
// refitted alone has no gain found beside it.
void adopt_friction(ArmFile *file, const JointWork &w, const Eigen::VectorXd &change,
                    const Eigen::VectorXd &sigma);
// What concerns the whole arm: a payload's mass and first moment on top of the file's, gravity as it
// lies in the tilted base's frame, a link's mass and inertia.  w: any joint, for its runs, whose own payload
// stands in place of the file's.  Returns as adopt_axis does.
std::string adopt_chain(ArmFile *file, const JointWork &w, const Found &effect);

} // namespace hdt
