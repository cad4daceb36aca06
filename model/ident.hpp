// SPDX-License-Identifier: Apache-2.0
//
// Identification: a log and an arm file in, the same arm file with its numbers fitted out.
//
// Owns: which terms are fitted, weights, sigma, "not excited", held-out error.
// Never: names a missing effect (diagnose.hpp does).
#pragma once

#include <string>
#include <vector>

#include "model/arm_file.hpp"
#include "model/log.hpp"

namespace hdt {

struct IdentOptions {
    std::vector<int> joints;        // 1-based; empty: all present
    double block_s = 0.01;          // rows are averaged over blocks of this length, regressors too
};

struct FitParameter {
    std::string key, unit;
    double value, sigma;
    bool excited;                   // false: the data cannot tell; the file's value was kept
};

struct JointFit {
    int joint;                      // 1-based
    std::vector<FitParameter> parameters;
    double rms_before_nm, rms_after_nm;         // on the fit runs
    double held_out_before_nm, held_out_after_nm; // on the test runs; NaN without
    std::size_t rows, masked;
    // for pictures, test runs if given, else fit runs
    std::vector<double> t_s, q_rad, v_radps, measured_nm, residual_before_nm, residual_after_nm;
};

struct IdentResult {
    ArmFile model;
    std::vector<JointFit> joints;
};

// Throws InputError when the runs do not fit the arm.
IdentResult identify(const ArmFile &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                     const IdentOptions &options);

// DIR/model.toml, DIR/ident.json, DIR/report.html; each complete or absent.
void write_ident(const IdentResult &r, const std::string &dir);

} // namespace hdt
