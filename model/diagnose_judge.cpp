// SPDX-License-Identifier: Apache-2.0
//
// What the held-out runs say of the effects found: named, unnamed, suspect or nothing.
//
// Owns: errors on held-out runs, verdicts, detection limits, the next run proposed.
// Never: chooses an effect; writes a model.
#include "model/diagnose_parts.hpp"

#include <algorithm>
#include <cmath>

#include "model/next_run.hpp"
#include "model/text.hpp"

namespace hdt::diag {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// held-out error may grow by this where likelihood gains: few runs scatter
constexpr double kWorse = 1.05;
constexpr double kWorseThanRefit = 1.5;    // its square, against friction fitted again
constexpr double kUnnamedFall = 0.03;      // what no effect explains must be worth a table
constexpr double kFewRunsFall = 0.15;      // of the held-out error, where few runs may name
constexpr double kChainShare = 0.15;       // of the floor: a chain effect's part worth a line on a joint
constexpr double kOverGate = 1.3;          // a detection limit, over what the gates ask for at least
constexpr double kSeparates = 0.3;         // of the noise floor, rms over a run

} // namespace

VectorXd joined(const std::vector<VectorXd> &parts)
{
    Index n = 0;
    for (const VectorXd &p : parts)
        n += p.size();
    VectorXd out(n);
    n = 0;
    for (const VectorXd &p : parts) {
        out.segment(n, p.size()) = p;
        n += p.size();
    }
    return out;
}

double rms(const VectorXd &x)
{
    return x.size() > 0 ? std::sqrt(x.squaredNorm() / static_cast<double>(x.size())) : 0;
}

std::vector<Candidate> list_candidates(const JointWork &w, const Gates &gates)
{
    std::vector<Candidate> tried;
    const auto enter = [&](const Score &s, const std::string &id) {
        Candidate c;
        c.id = id;
        c.log_e = s.log_e;
        c.p_adjusted = s.p_adjusted;
        c.rms_nm = s.rms_nm;
        const double ms = s.gain.rows > 0 ? s.gain.plain_total / s.gain.rows : 0;
        c.gain_nm = (ms < 0 ? -1 : 1) * std::sqrt(std::abs(ms));
        c.note = s.note;
        if (c.note.empty() && s.p_adjusted <= 0.05 && s.rms_nm < w.gate_nm)
            c.note = filled("real but below %.2g N.m", w.gate_nm);
        tried.push_back(std::move(c));
    };
    for (const Score &s : w.scores)
        enter(s, w.families[s.family].named() ? w.families[s.family].id
                                              : "unnamed: " + w.families[s.family].axis);
    if (const auto s = w.weigh_offset(gates)) {
        enter(*s, "torque_offset");
        tried.back().note = "or Coulomb friction that differs by direction: sliding shows both alike";
    }
    std::stable_sort(tried.begin(), tried.end(),
                     [](const Candidate &a, const Candidate &b) { return a.log_e > b.log_e; });
    return tried;
}

namespace {

HeldOut held_out(const JointWork &w, const JointEstimate &e, const Found &axis, const VectorXd &axis_theta,
                 const VectorXd &refit)
{
    std::vector<VectorXd> before, again, after;
    for (const BlockRows &b : w.test) {
        before.push_back(b.y_nm);
        again.push_back(b.y_nm - nuisance_columns(b) * refit);
        VectorXd r = b.y_nm - nuisance_columns(b) * e.friction;
        for (std::size_t k = 0; k < w.found.size(); ++k)
            r -= effect_nm(e, w, k, b);
        if (!axis.family.id.empty())
            r -= axis.columns(b) * axis_theta;
        after.push_back(std::move(r));
    }
    return {joined(before), joined(again), joined(after), before, again, after};
}

// Smallest effect that these runs would have shown, by family.
void detection_limits(const JointWork &w, const Gates &gates, JointDiagnosis *d)
{
    for (const Family &f : w.families) {
        if (!f.named() || f.grid.empty() || f.twin || f.own_phase)
            continue;
        const Gram g = w.gram(f, f.grid[f.grid.size() / 2]);
        const Projected p = project(g, RunSet(g.weighted.size(), 1));
        const double k = static_cast<double>(g.columns);
        // a half of the runs must predict the other half well enough
        const double need = std::log(f.grid_count * static_cast<double>(w.families.size()) / gates.alpha) + k;
        const double info = ridged(p.plain_a / std::max(p.rows, 1.0)).llt().solve(p.a).trace() / k;
        if (!(info > 0) || !(p.plain_a.trace() > 0))
            continue;
        // the gates ask for a size of their own, and for most of it in runs left out
        const double gate_nm = kOverGate * w.gate_nm * gate_factor(f, gates);
        d->detection_limit_nm.emplace_back(f.id, std::max(gate_nm, std::sqrt(4 * (need + 2 * std::sqrt(need))
                                                                             / info)));
    }
}

// The run that would tell most, as a line to type.
std::string next_experiment(const hdt_arm &arm, const JointWork &w, const JointEstimate &e,
                            const JointDiagnosis &d, std::size_t runs)
{
    if (runs < kRunsMin)
        return filled("record %.0f more runs of 40 s, each with its own seed: ",
                      static_cast<double>(kRunsMin + 2 - runs))
               + host_line(arm, "excite:seed=1,seconds=40");
    if (d.effects.empty())
        return "";
    const std::string &id = d.effects[0].id;
    if (id == "unnamed")
        return "repeat with other speeds and poses: " + host_line(arm, "excite:seed=3,seconds=60");
    std::size_t k = 0;
    while (k < w.found.size() && w.found[k].family.id != id)
        ++k;
    if (!d.ambiguous_with.empty() && k < w.found.size()) {
        const NextRun n = choose_next_run(arm, w, d.ambiguous_with,
                                          [&](const BlockRows &b) { return effect_nm(e, w, k, b); });
        if (n.task.empty() || n.separation < kSeparates)
            return "no task of the menu tells " + id + " from "
                   + (n.rival.empty() ? d.ambiguous_with[0] : n.rival)
                   + (n.task.empty() ? "" : filled(": at most %.2g of the noise floor apart", n.separation));
        return (n.payload_kg > 0 ? filled("with a known %.3g kg 0.05 m beyond the flange: ", n.payload_kg)
                                 : std::string())
               + host_line(arm, n.task) + " (" + id + " and " + n.rival
               + filled(" would be %.2g of the noise floor apart, %.2g in these runs)", n.separation,
                      n.at_hand);
    }
    if (id == "external_vibration")
        return "the same run with the neighbourhood switched off: "
               + host_line(arm, "excite:seed=1,seconds=40");
    return "confirm on the task that matters: " + host_line(arm, "lemniscate");
}

// Effects whose contribution on this joint counts; chain effects may not reach every joint.
// Returns each one's place in w.found, kNoName for what has none.
std::vector<std::size_t> list_effects(const hdt_arm &arm, const JointWork &w, const JointEstimate &e,
                                      const Found &axis, const VectorXd &axis_theta, JointDiagnosis *d)
{
    std::vector<std::size_t> places;
    for (std::size_t k = 0; k < w.found.size(); ++k) {
        const Found &f = w.found[k];
        Effect out;
        out.id = f.family.id;
        out.depends_on = f.family.depends_on;
        // a phase of its own in every run: nothing held out to compare with
        out.rms_nm = reducible_rms(f.family.own_phase ? w.fit : w.test,
                                   [&](const BlockRows &b) { return effect_nm(e, w, k, b); });
        out.p_adjusted = f.p_adjusted;
        out.parameters = effect_parameters(arm, w, e, k);
        // it is there for the whole chain: a joint that shows little of
        // it says so only where that is much to it
        if (f.chain_theta && out.rms_nm < kChainShare * w.floor_nm)
            continue;
        d->effects.push_back(std::move(out));
        places.push_back(k);
        for (const std::string &a : f.ambiguous)
            if (std::find(d->ambiguous_with.begin(), d->ambiguous_with.end(), a) == d->ambiguous_with.end())
                d->ambiguous_with.push_back(a);
    }
    if (w.offset) {
        Effect out;
        out.id = "torque_offset";
        out.depends_on = {"nothing"};
        out.parameters = {offset_parameter(w, e)};
        out.rms_nm = std::abs(out.parameters[0].value);
        out.p_adjusted = w.offset->p_adjusted;
        d->effects.push_back(std::move(out));
    }
    // what is named already cannot be mistaken for itself
    const auto named = [&](const std::string &a) {
        return std::any_of(d->effects.begin(), d->effects.end(), [&](const Effect &k) { return k.id == a; });
    };
    d->ambiguous_with.erase(std::remove_if(d->ambiguous_with.begin(), d->ambiguous_with.end(), named),
                            d->ambiguous_with.end());
    places.resize(d->effects.size() + (axis.family.id.empty() ? 0 : 1), kNoName);
    if (axis.family.id.empty())
        return places;
    Effect out;
    out.id = "unnamed";
    out.axis = axis.family.axis;
    out.depends_on = axis.family.depends_on;
    out.rms_nm = reducible_rms(w.test,
                               [&](const BlockRows &b) -> VectorXd { return axis.columns(b) * axis_theta; });
    out.p_adjusted = axis.p_adjusted;
    out.table_x = axis.family.knots;
    const VectorXd curve_nm = axis_curve_nm(w, e, axis_theta);
    out.table_nm.assign(curve_nm.data(), curve_nm.data() + curve_nm.size());
    d->effects.push_back(std::move(out));
    return places;
}

bool only_hum(const JointWork &w)
{
    return w.found.size() == 1 && w.found[0].family.own_phase && !w.offset;
}

// A vibration's phase is each run's own: held-out runs can only show half its size at its frequency.
bool hum_held_out(const JointWork &w, const VectorXd &theta_by_run, const HeldOut &h)
{
    const double hz = w.found[0].at.x;
    const double amplitude = std::sqrt(2 * theta_by_run.squaredNorm()
                                       / static_cast<double>(theta_by_run.size()));
    std::size_t shows = 0;
    for (std::size_t r = 0; r < w.test.size(); ++r) {
        MatrixXd x(w.test[r].size(), 2);
        const VectorXd angle = 2 * M_PI * hz * w.test[r].t_s;
        x << angle.array().sin().matrix(), angle.array().cos().matrix();
        const MatrixXd a = x.transpose() * x + 1e-9 * MatrixXd::Identity(2, 2);
        const VectorXd theta = a.llt().solve(x.transpose() * h.refit_by_run[r]);
        shows += theta.norm() > 0.5 * amplitude;
    }
    return 2 * shows >= w.test.size();
}

// Named, unnamed or suspect, and why doubt remains.
std::string judge(const JointWork &w, const JointEstimate &e, const Independent &runs, const HeldOut &h,
                  bool unnamed, JointDiagnosis *d)
{
    d->verdict = unnamed ? "unnamed" : "named";
    const double fall = 1 - rms(h.after) / std::max(rms(h.before), 1e-12);
    // a run's own Coulomb scatter must not decide: judged by likelihood, with a limit in N.m
    const double gain = w.held_out_log_likelihood(h.after_by_run)
                        - std::max(w.held_out_log_likelihood(h.refit_by_run),
                                   w.held_out_log_likelihood(h.before_by_run));
    if (only_hum(w) && !unnamed) {
        if (hum_held_out(w, e.theta[0], h))
            return "";
        d->verdict = "suspect";
        return "the held-out runs do not show that frequency";
    }
    const double *scatter = w.evidence().noise().variance;
    const double limit = std::sqrt(kWorseThanRefit * h.refit.squaredNorm()
                                       / static_cast<double>(h.refit.size())
                                   + 2 * (scatter[RG_COULOMB] + scatter[RG_OFFSET]));
    // few runs know their own noise badly: what falls by enough in N.m needs no likelihood
    const bool falls = rms(h.after) < kClearFall * std::min(rms(h.before), rms(h.refit));
    if (!falls && (!(gain > 0) || rms(h.after) > std::min(limit, kWorse * rms(h.before)))) {
        d->verdict = "suspect";
        return filled("it does not help on the held-out runs (%.3g N.m as given, %.3g with friction fitted "
                      "again, %.3g with it)",
                    rms(h.before), rms(h.refit), rms(h.after));
    }
    if (unnamed && d->effects.size() == 1 && fall < kUnnamedFall) {
        d->verdict = "suspect";
        return filled("an axis without a name has to take %.0f %% off the held-out error, and takes %.1f %%",
                      100 * kUnnamedFall, 100 * fall);
    }
    if (runs.count < kRunsMin && !(runs.may_name && fall >= kFewRunsFall)) {
        d->verdict = "suspect";
        return filled("%.0f independent run(s) are too few to name it (held-out error would go from %.3g to "
                      "%.3g N.m; --few-runs adopts it)",
                    static_cast<double>(runs.count), rms(h.before), rms(h.after));
    }
    return "";
}

// Said where the load of this joint rests on angles its runs do not have; empty otherwise.
std::string unknown_load(const JointWork &w)
{
    std::vector<std::vector<int>> per_run;
    for (const auto *set : {&w.fit, &w.test})
        for (const BlockRows &b : *set)
            per_run.push_back(b.unknown_angles);
    return unknown_angle_words(w.joint + 1, per_run);
}

// Friction that has only grown or shrunk is no effect with a name, but costs as much.
bool take_friction(const Start &start, JointDiagnosis *d)
{
    if (!start.refit_stands || !(d->rms_refit_nm < kClearFall * d->rms_before_nm))
        return false;
    d->friction_refitted = true;
    d->rms_after_nm = d->rms_refit_nm;
    return true;
}

Judged judge_as_found(const hdt_arm &arm, const JointWork &w, const Found &axis, const Start &start,
                      const Independent &runs, const Gates &gates)
{
    Judged out;
    JointDiagnosis &d = out.d;
    d.joint = w.joint + 1;
    d.noise_floor_nm = w.floor_nm;
    out.axis = axis;
    VectorXd &axis_theta = out.axis_theta;
    out.e = estimate(w, axis, &axis_theta);
    widen_by_place(w, &out.e);
    HeldOut h = held_out(w, out.e, axis, axis_theta, start.refit);
    d.rms_before_nm = rms(h.before);
    d.rms_refit_nm = rms(h.refit);
    if (w.offset) {
        // friction fitted by direction holds the offset already: judged beside friction alike both ways
        VectorXd alike = start.refit;
        alike.head(2).setConstant(alike.head(2).mean());
        h = held_out(w, out.e, axis, axis_theta, alike);
    }
    out.places = list_effects(arm, w, out.e, axis, axis_theta, &d);
    d.tried = start.tried;
    if (d.effects.empty()) {
        d.verdict = "nothing";
        detection_limits(w, gates, &d);
    } else {
        out.doubt = judge(w, out.e, runs, h, !axis.family.id.empty(), &d);
    }
    const std::string unknown = unknown_load(w);
    if (!unknown.empty() && !d.effects.empty()) {
        d.verdict = "suspect";
        out.doubt = unknown;
    }
    out.adopt = d.verdict == "named" || d.verdict == "unnamed";
    d.rms_after_nm = d.rms_explained_nm = out.adopt ? rms(h.after) : d.rms_before_nm;
    d.next_experiment = next_experiment(arm, w, out.e, d, runs.count);
    HeldOut &shown = out.shown = h;
    if (d.verdict == "nothing" || d.verdict == "suspect") {
        const bool taken = (runs.count >= kRunsMin || runs.may_name) && unknown.empty()
                           && take_friction(start, &d);
        shown.after = taken ? h.refit : h.before;
        shown.after_by_run = taken ? h.refit_by_run : h.before_by_run;
    }
    return out;
}

// Takes out the last that was found but for what concerns the whole arm; its name, empty when there is none.
std::string drop_last(JointWork &w, Found *axis)
{
    if (!axis->family.id.empty()) {
        *axis = {};
        return "a table over an axis";
    }
    for (std::size_t k = w.found.size(); k-- > 0;)
        if (!w.found[k].chain_theta) {
            const std::string id = w.found[k].family.id;
            w.found.erase(w.found.begin() + static_cast<std::ptrdiff_t>(k));
            return id;
        }
    return "";
}

} // namespace

Judged judge_whole_or_part(const hdt_arm &arm, JointWork &w, const Found &axis, const Start &start,
                           const Independent &runs, const Gates &gates)
{
    Judged whole = judge_as_found(arm, w, axis, start, runs, gates);
    if (whole.d.verdict != "suspect" || runs.count < kRunsMin)
        return whole;
    const std::vector<Found> found = w.found;
    Found left = axis;
    for (std::string dropped = drop_last(w, &left); !dropped.empty() && !w.found.empty();
         dropped = drop_last(w, &left)) {
        w.assess(gates);
        Judged part = judge_as_found(arm, w, left, start, runs, gates);
        if (part.d.verdict == "named") {
            part.dropped = dropped;
            return part;
        }
    }
    w.found = found;
    w.assess(gates);
    return whole;
}

} // namespace hdt::diag
