// SPDX-License-Identifier: Apache-2.0
//
// From verdicts to the model written, and back to what of it can be claimed.
//
// Owns: what the whole arm takes in, what each joint does, what stays out and why, the error after.
// Never: judges; words a sentence.
#include "model/diagnose_parts.hpp"

#include <algorithm>
#include <map>

namespace hdt::diag {

using Eigen::VectorXd;

namespace {

// What concerns the whole arm, once for all joints: why it is refused by id, empty where it is written.
using WholeArm = std::map<std::string, std::string>;

WholeArm adopt_whole_arm(ArmFile *model, const Works &works, const std::vector<Judged> &judged)
{
    WholeArm out;
    for (std::size_t j = 0; j < works.size(); ++j)
        for (const Found &f : works[j]->found)
            if (judged[j].adopt && f.chain_theta && out.count(f.family.id) == 0)
                out[f.family.id] = adopt_chain(model, *works[j], f);
    return out;
}

// Of what was found on a joint, what the model written holds.
struct Held {
    std::vector<bool> found;
    bool offset, axis;
    VectorXd friction;
};

Held of_whole_arm(const JointWork &w, const WholeArm &arm)
{
    Held out{std::vector<bool>(w.found.size(), false), false, false, VectorXd::Zero(kFriction)};
    for (std::size_t k = 0; k < w.found.size(); ++k)
        if (w.found[k].chain_theta) {
            const auto at = arm.find(w.found[k].family.id);
            out.found[k] = at != arm.end() && at->second.empty();
        }
    return out;
}

bool holds_all(const Held &held)
{
    return std::all_of(held.found.begin(), held.found.end(), [](bool yes) { return yes; });
}

// Held-out residual of the model written, run by run.
std::vector<VectorXd> left_by(const JointWork &w, const Judged &g, const Held &held)
{
    std::vector<VectorXd> left;
    for (const BlockRows &b : w.test) {
        VectorXd r = b.y_nm - nuisance_columns(b) * held.friction;
        for (std::size_t k = 0; k < w.found.size(); ++k)
            if (held.found[k])
                r -= effect_nm(g.e, w, k, b);
        if (held.axis)
            r -= g.axis.columns(b) * g.axis_theta;
        left.push_back(std::move(r));
    }
    return left;
}

double rms_left_by(const JointWork &w, const Judged &g, const Held &held)
{
    return rms(joined(left_by(w, g, held)));
}

void mark_adopted(const Held &held, Judged *g)
{
    for (std::size_t k = 0; k < g->d.effects.size(); ++k) {
        Effect &e = g->d.effects[k];
        const std::size_t at = g->places[k];
        e.adopted = at != kNoName ? held.found[at] : e.id == "unnamed" ? held.axis : held.offset;
    }
}

// Every effect listed that is not adopted has its reason: its own, or that it was fitted beside another.
void mark_refused(const std::vector<Refused> &refused, Judged *g)
{
    std::string others;
    for (std::size_t k = 0; k < g->d.effects.size(); ++k)
        for (const Refused &r : refused)
            if (r.found == g->places[k] && r.id == g->d.effects[k].id) {
                g->d.effects[k].refused = r.why;
                others += (others.empty() ? "" : ", ") + r.id;
            }
    for (Effect &e : g->d.effects)
        if (!e.adopted && e.refused.empty())
            e.refused = "it was fitted beside " + others + " and does not help without on the held-out runs";
}

// Chain effects that a joint lists and the file does not take.
std::vector<Refused> refused_of_whole_arm(const JointWork &w, const WholeArm &arm, const Judged &g)
{
    std::vector<Refused> out;
    for (const std::size_t k : g.places)
        if (k != kNoName && w.found[k].chain_theta && !arm.at(w.found[k].family.id).empty())
            out.push_back({w.found[k].family.id, 0, k, arm.at(w.found[k].family.id)});
    return out;
}

// What a joint's verdict takes in.  Where the file cannot hold all of it, the rest was fitted beside what
// is refused: it is written if it helps alone.
void adopt_found(ArmFile *model, const JointWork &w, const WholeArm &arm, Judged *g)
{
    const Held before = of_whole_arm(w, arm);
    Held held = before;
    std::vector<Refused> refused = refused_of_whole_arm(w, arm, *g);
    ArmFile with = *model;
    if (!g->axis.family.id.empty()) {
        const std::string why = adopt_axis(&with, w, g->e, g->axis, g->axis_theta);
        held.axis = why.empty();
        if (!why.empty())
            refused.push_back({"unnamed", w.joint + 1, kNoName, why});
    }
    const Adoption done = adopt_joint(&with, w, g->e, refused.empty());
    for (std::size_t k = 0; k < w.found.size(); ++k)
        held.found[k] = held.found[k] || !w.found[k].chain_theta;
    for (const Refused &r : done.refused)
        held.found[r.found] = false;
    refused.insert(refused.end(), done.refused.begin(), done.refused.end());
    held.offset = w.offset.has_value();
    held.friction = done.friction;
    bool write = true;
    if (!refused.empty() || !holds_all(held)) {
        const double without_nm = rms_left_by(w, *g, before), with_nm = rms_left_by(w, *g, held);
        write = refused.empty() || with_nm < without_nm;
        g->d.rms_after_nm = write ? with_nm : without_nm;
    }
    if (write)
        *model = std::move(with);
    mark_adopted(write ? held : before, g);
    mark_refused(refused, g);
}

// A joint that takes in nothing of its own has its part in what the whole arm takes in; its friction goes
// into the model where that helps beside it too.
void adopt_beside_whole_arm(ArmFile *model, const JointWork &w, const WholeArm &arm, const Start &start,
                            Judged *g)
{
    JointDiagnosis &d = g->d;
    Held held = of_whole_arm(w, arm);
    const bool changes = std::find(held.found.begin(), held.found.end(), true) != held.found.end();
    if (changes) {
        Held refitted = held;
        refitted.friction = start.refit;
        const double plain_nm = rms_left_by(w, *g, held), refitted_nm = rms_left_by(w, *g, refitted);
        d.friction_refitted = d.friction_refitted && refitted_nm < kClearFall * plain_nm;
        held = d.friction_refitted ? refitted : held;
        d.rms_after_nm = d.friction_refitted ? refitted_nm : plain_nm;
        g->shown.after_by_run = left_by(w, *g, held);
        g->shown.after = joined(g->shown.after_by_run);
    }
    if (d.friction_refitted)
        adopt_friction(model, w, start.refit, start.refit_sigma);
    d.rms_explained_nm = d.rms_after_nm;
    mark_adopted(held, g);
}

} // namespace

void adopt(ArmFile *model, const Works &works, const std::vector<Start> &start, std::vector<Judged> *judged)
{
    const WholeArm arm = adopt_whole_arm(model, works, *judged);
    for (std::size_t j = 0; j < works.size(); ++j) {
        Judged &g = (*judged)[j];
        if (g.adopt)
            adopt_found(model, *works[j], arm, &g);
        else
            adopt_beside_whole_arm(model, *works[j], arm, start[j], &g);
    }
    model->refresh();
}

} // namespace hdt::diag
