// SPDX-License-Identifier: Apache-2.0
//
// Identification: a log and an arm file in, the same arm file with its numbers fitted out.
//
// Owns: which terms are fitted, weights, sigma, "not excited", held-out error.
// Never: names a missing effect (diagnose.hpp does).
//
// Fitted per joint: two-sided Stribeck friction, the ripple lines and stiffness lines the file
// declares, the build-up of friction after a reversal.  Fitted for the chain: one gravity scale when
// the file has masses (it goes into all masses and first moments alike), else rigid-body base
// parameters, written as first_moment and inertia_origin with zero mass.  Everything else in the file
// is taken as it stands.
#pragma once

#include <string>
#include <vector>

#include "model/arm_file.hpp"
#include "model/log.hpp"

namespace hdt {

struct IdentOptions {
    std::vector<int> joints;        // 1-based; empty: all present
    double block_s = 0.01;          // rows are averaged over blocks of this length, regressors too
    double reversal_guard_s = 0.03; // rows this close to a reversal are not fitted,
    double reversal_travel_rad = 0.002; // nor rows with less travel than this since: not yet sliding
};

struct FitParameter {
    std::string key, unit;
    double value, sigma;            // sigma NaN: not known
    bool excited;                   // false: the data cannot tell; the file's value was kept
};

// One of the friction curves of the paper's Table I on the same rows, all else as fitted.
struct FrictionScore {
    std::string curve;              // viscous, cubic, stribeck
    int numbers;                    // of both directions
    double rms_nm, left_out_nm;     // block means; each run predicted from the others, NaN with one run
    double bic;                     // stretches of time counted, not rows; least is best
};

struct JointFit {
    int joint;                      // 1-based
    std::vector<FitParameter> parameters;
    double rms_before_nm, rms_after_nm;         // on the fit runs, block means
    double held_out_before_nm, held_out_after_nm; // on the test runs; NaN without
    std::size_t rows, masked;       // blocks fitted; full-rate rows masked
    // this joint's own scale of the gravity torque, to be held against the chain's; NaN when the
    // file has no masses or the joint carries no load
    double gravity_scale, gravity_scale_sigma;
    std::vector<FrictionScore> friction;
    // for pictures, test runs if given, else fit runs; friction is what the other terms leave
    std::vector<double> t_s, q_rad, v_radps, measured_nm, residual_before_nm, residual_after_nm, friction_nm;
};

struct IdentResult {
    ArmFile model;
    std::vector<JointFit> joints;
    std::vector<FitParameter> chain; // gravity_scale, or the base parameters chosen
    std::vector<std::string> notes;  // sentences: what could not be told, and why
};

// The errors after are those of the model as written, read back.  A joint that is then clearly worse than
// with the model given, on the test runs or without any on the fit runs, keeps the numbers it had, and
// a note says so; where the masses are to blame, they are kept.
// Throws InputError when the runs do not fit the arm.
IdentResult identify(const ArmFile &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                     const IdentOptions &options);

// DIR/model.toml, DIR/ident.json, DIR/report.html; each complete or absent.
void write_ident(const IdentResult &r, const std::string &dir);

} // namespace hdt
