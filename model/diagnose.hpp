// SPDX-License-Identifier: Apache-2.0
//
// Diagnosis: what does the residual still hold, which effect does the model lack, how much better
// with it.  Reads logs and a model; nothing else.
//
// Owns: noise floor, candidates, evidence, verdicts, the adopted model.
// Never: shares code with the simulator's hidden effects.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "model/arm_file.hpp"
#include "model/log.hpp"

namespace hdt {

struct DiagnoseOptions {
    std::vector<int> joints;        // 1-based; empty: all present
    double block_s = 0.01;
    // Fewer than four runs name nothing; with this they name what takes 15 % off the held-out error.
    bool few_runs = false;
};

struct EffectParameter { std::string name, unit; double value, sigma; };

struct Effect {
    std::string id;                 // of the id list in docs/formats.md
    std::string axis;               // for "unnamed": what it depends on
    std::vector<std::string> depends_on;
    double rms_nm;                  // of its contribution, held out
    double p_adjusted;              // over everything tried
    std::vector<EffectParameter> parameters;
    std::vector<double> table_x, table_nm; // "unnamed": torque over its axis, flat outside
    bool adopted = false;           // written into the model
    std::string refused;            // why it is not, where the joint's verdict would have it
};

// What lives in a part of one run only: not in the fit, not in the model.
struct RunEvent {
    std::string run;                // file
    double from_s, to_s;
    std::string kind;               // torque, friction, angle
    double torque_nm, angle_rad;    // angle: "angle" only
    double log_likelihood;
};

struct Candidate { std::string id; double log_e, gain_nm, rms_nm, p_adjusted; std::string note; };

struct JointDiagnosis {
    int joint;                      // 1-based
    std::string verdict;            // named, unnamed, suspect, nothing
    // Held-out runs only.  before: the model as given; refit: its Coulomb and viscous friction fitted
    // to the fit runs; after: of the model written; explained: with what was refused as well, else as after.
    // floor: what the best candidate of all, named or not, leaves on a run it was not fitted on.
    double noise_floor_nm, rms_before_nm, rms_refit_nm, rms_after_nm, rms_explained_nm;
    bool friction_refitted = false; // nothing adopted but friction fitted again: after is refit then
    std::vector<Effect> effects;
    std::vector<std::string> ambiguous_with;
    std::string next_experiment;
    std::vector<RunEvent> events;
    std::vector<Candidate> tried;   // all of them, best first
    std::vector<std::pair<std::string, double>> detection_limit_nm; // per effect, when nothing
    std::string words;              // the verdict as a sentence
    bool refuses() const;           // is any of its effects refused?
    // Nothing found, and yet far more left than noise: of 398 healthy joints 99 % have less than 1.7 times
    // their floor, and none more than twice (docs/diagnosis-bench.md, N=3).
    bool unexplained() const { return verdict == "nothing" && rms_after_nm > 2 * noise_floor_nm; }
    // for pictures, held-out runs
    std::vector<double> t_s, axis_x, residual_before_nm, residual_after_nm;
    std::string axis_label;
    std::vector<double> order, spectrum_before_nm, spectrum_after_nm;
};

struct Diagnosis {
    ArmFile model;                  // with the effects adopted
    std::vector<JointDiagnosis> joints;
    std::vector<std::pair<int, std::string>> skipped; // joint (1-based) and why nothing can be said
};

// Throws InputError when a run does not fit the arm or a joint asked for is not in the runs.
// The runs are given back to the heap as soon as their blocks are read.
Diagnosis diagnose(const ArmFile &arm, std::vector<Run> fit, std::vector<Run> test,
                   const DiagnoseOptions &options);

// DIR/diagnosis.json, DIR/model.toml, DIR/report.html; each complete or absent.
void write_diagnosis(const Diagnosis &d, const std::string &dir);

} // namespace hdt
