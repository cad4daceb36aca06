// SPDX-License-Identifier: Apache-2.0
//
// What the parts of a diagnosis hand each other: from the effects found on a joint to its verdict, the model
// written and its words.  Only model/diagnose*.cpp include it.
//
// Owns: what is known of a joint at each step, and the order of its parts: estimate, judge, adopt, say.
// Never: is seen by a user of model/diagnose.hpp.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "model/adopt.hpp"
#include "model/candidates.hpp"
#include "model/diagnose.hpp"
#include "model/events.hpp"

namespace hdt::diag {

constexpr std::size_t kRunsMin = 4;
constexpr double kClearFall = 0.95;        // of the held-out error, best without the effect
constexpr double kSure = 9;                // three sigma from nothing, squared and per number

using Works = std::vector<std::unique_ptr<JointWork>>;

// How many runs tell of each other's scatter, and whether fewer than that may name.
struct Independent { std::size_t count; bool may_name; };

// What the selection of one joint started from: friction fitted again and nothing else, and whether that is
// more than runs scatter and helps in runs left out.
struct Start { std::vector<Candidate> tried; Eigen::VectorXd refit, refit_sigma; bool refit_stands = false; };

// Residuals on held-out rows, all runs one after the other.
struct HeldOut {
    Eigen::VectorXd before, refit, after;
    std::vector<Eigen::VectorXd> before_by_run, refit_by_run, after_by_run;
};

// A joint's verdict, and all that its adoption, words and pictures need.
struct Judged {
    JointDiagnosis d;
    HeldOut shown;
    JointEstimate e;
    Found axis;
    Eigen::VectorXd axis_theta;
    std::vector<std::size_t> places;   // of d.effects in JointWork::found
    std::string doubt, dropped;        // why it is suspect; what the held-out runs denied beside what stands
    bool adopt = false;
};

// diagnose_estimate.cpp: all found effects of a joint in one fit.
// Generalised least squares with the first columns held at zero; covariance from runs left out.
GlsFit fit_from(const Gram &g, Eigen::Index first, Eigen::MatrixXd *cov);
// axis_theta: what is fitted over the axis beside them, nothing for an empty one.
JointEstimate estimate(const JointWork &w, const Found &axis, Eigen::VectorXd *axis_theta);
// What the declared model gets a little wrong everywhere shows in no scatter of runs: it shows when a
// part of the joint's travel is left out.  Plain least squares, six parts, jackknife.
void widen_by_place(const JointWork &w, JointEstimate *e);
// Effects whose numbers are not three sigma from nothing, or not two where parts of the travel are left
// out, or not possible beside the others, are taken out again.  Returns whether there was one.
bool prune(JointWork &w);
// Torque of found effect k on these rows.
Eigen::VectorXd effect_nm(const JointEstimate &e, const JointWork &w, std::size_t k, const BlockRows &b);

// diagnose_judge.cpp: reads the held-out runs.
Eigen::VectorXd joined(const std::vector<Eigen::VectorXd> &parts);
double rms(const Eigen::VectorXd &x);
// Every family's evidence, best first, for the report.
std::vector<Candidate> list_candidates(const JointWork &w, const Gates &gates);
// Where the held-out runs deny the whole, the part of it found first may stand: w then holds that part.
Judged judge_whole_or_part(const hdt_arm &arm, JointWork &w, const Found &axis, const Start &start,
                           const Independent &runs, const Gates &gates);

// diagnose_adopt.cpp: writes what the verdicts take in; fills in what of it is adopted, what is refused and
// why, and the error after.
void adopt(ArmFile *model, const Works &works, const std::vector<Start> &start, std::vector<Judged> *judged);

// diagnose_words.cpp: the verdict as a sentence, when it is known what the model holds.
void put_all_words(const Independent &runs, const Start &start, const std::vector<Event> &events, Judged *g);

// diagnose_pictures.cpp: points and lines for the report, held-out runs.
void pictures(const JointWork &w, const HeldOut &h, const Found &axis, JointDiagnosis *d);

} // namespace hdt::diag
