// SPDX-License-Identifier: Apache-2.0
//
// The order of a diagnosis: condition, weigh, take in, weigh again, judge on held-out runs, adopt.
//
// Owns: which runs count as independent, rounds of selection, verdicts and their words.
// Never: looks at held-out runs before the choice is made.
#include "model/diagnose.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>
#include <thread>

#include "model/adopt.hpp"
#include "model/candidates.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kEffectsMax = 4;
constexpr std::size_t kRunsMin = 4;
constexpr Index kFriction = 4;             // columns of nuisance_columns
constexpr Index kRowsMin = 400;            // per joint over all fit runs
constexpr double kWorse = 1.5;             // held-out mean square may grow by this: few runs scatter
constexpr double kUnnamedFall = 0.03;      // what no effect explains must be worth a table
constexpr double kPiece_s = 20;
constexpr double kReversalGuard_s = 0.03;  // velocity estimate and gear wind-up settle within this
constexpr const char *kChainIds[] = {"payload", "base_tilt"};

using Works = std::vector<std::unique_ptr<JointWork>>;
using RunBlocks = std::vector<std::vector<BlockRows>>; // [run][joint]

std::string text(const char *format, double a, double b = 0, double c = 0)
{
    char buf[256];
    std::snprintf(buf, sizeof buf, format, a, b, c);
    return buf;
}

// Files cut from one recording follow each other in time: they are one run.
std::size_t independent_runs(const std::vector<Run> &runs)
{
    std::vector<std::pair<double, double>> span;
    for (const Run &r : runs)
        if (r.rows() > 1)
            span.emplace_back(r.t_s.front(), r.t_s.back());
    std::sort(span.begin(), span.end());
    std::size_t n = span.empty() ? 0 : 1;
    for (std::size_t i = 1; i < span.size(); ++i) {
        const double gap = span[i].first - span[i - 1].second;
        n += !(gap >= 0 && gap < 0.1);
    }
    return n;
}

RunBlocks read_blocks(const hdt_arm &arm, const std::vector<Run> &runs, bool to_fit,
                      const DiagnoseOptions &options)
{
    ConditionOptions co;
    co.block_s = options.block_s;
    co.reversal_guard_s = kReversalGuard_s;
    co.soft_margin_nm = fall_margin_nm;
    RunBlocks out;
    for (const Run &r : runs)
        out.push_back(block_rows(arm, condition(r, arm, co), r, to_fit));
    return out;
}

// Too few runs to compare: each is cut into pieces of equal time, at least four in all.
RunBlocks cut_pieces(const RunBlocks &runs)
{
    RunBlocks out;
    for (const auto &joints : runs) {
        double end = 0;
        for (const BlockRows &b : joints)
            end = b.size() > 0 ? std::max(end, b.t_s[b.size() - 1]) : end;
        const auto want = static_cast<int>((kRunsMin + runs.size() - 1) / std::max<std::size_t>(runs.size(), 1));
        const int pieces = std::clamp(static_cast<int>(end / kPiece_s), want, 12);
        for (int p = 0; p < pieces; ++p) {
            std::vector<BlockRows> piece;
            for (const BlockRows &b : joints) {
                const auto at = [&](int k) {
                    const double t = end * k / pieces;
                    return k == pieces ? b.size() : std::lower_bound(b.t_s.data(), b.t_s.data() + b.size(), t) - b.t_s.data();
                };
                piece.push_back(b.slice(at(p), at(p + 1)));
            }
            out.push_back(std::move(piece));
        }
    }
    return out;
}

void parallel(std::size_t n, const std::function<void(std::size_t)> &work)
{
    const std::size_t workers = std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1, 8);
    std::vector<std::exception_ptr> failed(n);
    std::vector<std::thread> pool;
    for (std::size_t w = 0; w < std::min(workers, n); ++w)
        pool.emplace_back([&, w] {
            for (std::size_t i = w; i < n; i += workers) {
                try {
                    work(i);
                } catch (...) {
                    failed[i] = std::current_exception();
                }
            }
        });
    for (std::thread &t : pool)
        t.join();
    for (const auto &f : failed)
        if (f)
            std::rethrow_exception(f);
}

Found found_from(const JointWork &w, std::size_t family)
{
    Found f;
    f.family = w.families[family];
    f.at = w.scores[family].at;
    f.p_adjusted = w.scores[family].p_adjusted;
    return f;
}

// One chain effect, if it stands against every joint's own best explanation.
bool take_chain(Works &works, const Gates &gates)
{
    for (const char *id : kChainIds) {
        const auto has = [&](const Found &f) { return f.family.id == id; };
        if (works.empty() || std::any_of(works[0]->found.begin(), works[0]->found.end(), has))
            continue;
        const ChainScore c = weigh_chain(works, id, gates);
        if (!c.passes)
            continue;
        for (std::size_t j = 0; j < works.size(); ++j) {
            JointWork &w = *works[j];
            Found f;
            f.family = *std::find_if(w.families.begin(), w.families.end(), [&](const Family &k) { return k.id == id; });
            f.at = c.at;
            f.chain_theta = c.theta;
            f.chain_covariance = c.covariance;
            f.ambiguous = c.ambiguous[j];
            f.p_adjusted = c.p_adjusted;
            w.found.push_back(std::move(f));
            w.stale = true;
        }
        return true;
    }
    return false;
}

// A joint's own effect; returns true when one was taken in.
bool take_own(JointWork &w, const Choice &c, Found *axis)
{
    if (c.unnamed) {
        *axis = found_from(w, c.families[0]);
        return false;
    }
    for (const std::size_t k : c.families) {
        if (static_cast<int>(w.found.size()) >= kEffectsMax)
            return !c.families.empty();
        Found f = found_from(w, k);
        f.ambiguous = c.ambiguous;
        w.refine(&f);
        w.found.push_back(std::move(f));
        w.stale = true;
    }
    return !c.families.empty();
}

// Rounds until nothing more is found.  axes[j]: a free axis that beat every name, or empty.
void select(Works &works, const Gates &gates, std::vector<Found> *axes)
{
    axes->assign(works.size(), {});
    for (int round = 0; round <= kEffectsMax; ++round) {
        parallel(works.size(), [&](std::size_t j) {
            if (works[j]->stale)
                works[j]->assess(gates);
        });
        if (round == kEffectsMax)
            break;
        if (take_chain(works, gates))
            continue;
        bool any = false;
        for (std::size_t j = 0; j < works.size(); ++j) {
            if (!(*axes)[j].family.id.empty())
                continue;
            const Choice c = choose(*works[j]);
            any = take_own(*works[j], c, &(*axes)[j]) || any;
        }
        if (!any)
            break;
    }
}

// The same fit with the first columns held at zero.
GlsFit fit_from(const Gram &g, Index first, MatrixXd *cov)
{
    Gram part = g;
    const Index n = g.nuisances + g.columns + 1 - first;
    part.nuisances -= first;
    for (auto *list : {&part.weighted, &part.plain})
        for (MatrixXd &m : *list)
            m = m.bottomRightCorner(n, n).eval();
    GlsFit fit = gls_fit(part, RunSet(g.weighted.size(), 1));
    *cov = run_covariance(part, fit);
    return fit;
}

JointEstimate estimate(const JointWork &w, const Found &axis, VectorXd *axis_theta)
{
    const bool with_axis = !axis.family.id.empty();
    const Gram g = with_axis ? w.gram(axis.family, axis.at) : w.evidence().gram({});
    // declared friction stays unless fitting it again helps in runs left out
    const Index kept = left_out_rms(g, kFriction) <= left_out_rms(g) ? kFriction : 0;
    MatrixXd cov;
    const GlsFit fit = fit_from(g, kept, &cov);
    JointEstimate e;
    e.friction = VectorXd::Zero(kFriction);
    e.friction_sigma = VectorXd::Zero(kFriction);
    if (kept == 0) {
        e.friction = fit.nuisance.head(kFriction);
        e.friction_sigma = cov.diagonal().head(kFriction).cwiseMax(0.0).cwiseSqrt();
    }
    Index at = kFriction - kept + w.imperfection_columns();
    for (const Found &f : w.found) {
        const Index k = f.chain_theta ? 0 : f.columns(w.fit[0]).cols();
        e.theta.push_back(fit.nuisance.segment(at, k));
        e.covariance.push_back(cov.block(at, at, k, k));
        at += k;
    }
    *axis_theta = fit.theta;
    return e;
}

// Effects whose numbers are not three sigma from nothing are taken out again.
bool prune(JointWork &w)
{
    VectorXd unused;
    const JointEstimate e = estimate(w, {}, &unused);
    bool any = false;
    for (std::size_t k = w.found.size(); k-- > 0;) {
        if (w.found[k].chain_theta)
            continue;
        const double wald = e.theta[k].dot(e.covariance[k].ldlt().solve(e.theta[k]));
        if (wald >= 9 * static_cast<double>(e.theta[k].size()))
            continue;
        w.found.erase(w.found.begin() + static_cast<std::ptrdiff_t>(k));
        w.stale = any = true;
    }
    return any;
}

// Residuals on held-out rows, all runs one after the other.
struct HeldOut { VectorXd before, refit, after; std::vector<VectorXd> refit_by_run, after_by_run; };

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

double rms(const VectorXd &x) { return x.size() > 0 ? std::sqrt(x.squaredNorm() / static_cast<double>(x.size())) : 0; }

VectorXd effect_nm(const JointEstimate &e, const JointWork &w, std::size_t k, const BlockRows &b)
{
    const Found &f = w.found[k];
    return f.columns(b) * (f.chain_theta ? *f.chain_theta : e.theta[k]);
}

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
    return {joined(before), joined(again), joined(after), again, after};
}

VectorXd axis_signal(const std::string &id, const std::string &axis, const BlockRows &b, std::string *label)
{
    const auto is = [&](std::initializer_list<const char *> ids) {
        return std::any_of(ids.begin(), ids.end(), [&](const char *k) { return id == k || axis.rfind(k, 0) == 0; });
    };
    if (is({"load_friction", "drive_efficiency", "soft_windup", "load"}))
        return *label = "load (gravity torque), N.m", b.gravity;
    if (is({"temperature", "time"}))
        return *label = "time, s", b.t_s;
    if (is({"presliding", "travel"}))
        return *label = "travel since reversal, rad", b.travel;
    if (is({"inertia", "coupling"}))
        return *label = "acceleration, rad/s^2", b.a;
    if (is({"torque_gain", "torque"}))
        return *label = "declared torque, N.m", b.total;
    if (is({"viscous_nonlinear", "stribeck_shape", "v"}))
        return *label = "speed, rad/s", b.v;
    if (axis.size() > 1 && axis[0] == 'q') {
        const int k = std::atoi(axis.c_str() + 1);
        if (k >= 1 && k <= b.q_all.cols())
            return *label = "angle of joint " + std::to_string(k) + ", rad", b.q_all.col(k - 1);
    }
    return *label = "joint angle, rad", b.q;
}

void pictures(const JointWork &w, const HeldOut &h, const Found &axis, JointDiagnosis *d)
{
    const std::string id = !w.found.empty() ? w.found[0].family.id : "";
    std::vector<ScanRows> rows;
    std::vector<VectorXd> before;
    Index at = 0;
    const Index stride = std::max<Index>(1, h.before.size() / 6000);
    double t0 = 0;
    for (const BlockRows &b : w.test) {
        const VectorXd x = axis_signal(id, axis.family.axis, b, &d->axis_label);
        for (Index t = 0; t < b.size(); ++t, ++at) {
            if (at % stride != 0)
                continue;
            d->t_s.push_back(t0 + b.t_s[t]);
            d->axis_x.push_back(x[t]);
            d->residual_before_nm.push_back(h.before[at]);
            d->residual_after_nm.push_back(h.after[at]);
        }
        t0 += b.size() > 0 ? b.t_s[b.size() - 1] : 0;
        rows.push_back(b.scan());
        before.push_back(b.y_nm);
    }
    const OrderGrid grid = order_grid(rows, 600);
    for (std::size_t k = 0; k < grid.count(); ++k)
        d->order.push_back(grid.first + grid.step * static_cast<double>(k));
    const auto larger = [&](const std::vector<VectorXd> &y) {
        std::vector<double> a = order_spectrum(rows, y, grid, false);
        const std::vector<double> b = order_spectrum(rows, y, grid, true);
        for (std::size_t k = 0; k < a.size(); ++k)
            a[k] = std::max(a[k], b[k]);
        return a;
    };
    d->spectrum_before_nm = larger(before);
    d->spectrum_after_nm = larger(h.after_by_run);
}

// Smallest effect that these runs would have shown, by family.
void detection_limits(const JointWork &w, const Gates &gates, JointDiagnosis *d)
{
    for (const Family &f : w.families) {
        if (!f.named() || f.grid.empty())
            continue;
        const Gram g = w.gram(f, f.grid[f.grid.size() / 2]);
        const Projected p = project(g, RunSet(g.weighted.size(), 1));
        const double k = static_cast<double>(g.columns);
        // a half of the runs must predict the other half well enough
        const double need = std::log(f.grid_count * static_cast<double>(w.families.size()) / gates.alpha) + k;
        MatrixXd plain = p.plain_a / std::max(p.rows, 1.0);
        plain.diagonal().array() += 1e-9 * plain.diagonal().maxCoeff() + 1e-15;
        const double info = plain.llt().solve(p.a).trace() / k;
        if (!(info > 0) || !(p.plain_a.trace() > 0))
            continue;
        d->detection_limit_nm.emplace_back(f.id, std::max(w.gate_nm, std::sqrt(4 * (need + 2 * std::sqrt(need)) / info)));
    }
}

std::string next_experiment(const std::string &id, const std::vector<std::string> &ambiguous, int joint, std::size_t runs)
{
    const std::string j = std::to_string(joint);
    const auto among = [&](const char *what) {
        return id == what || std::find(ambiguous.begin(), ambiguous.end(), what) != ambiguous.end();
    };
    if (runs < kRunsMin)
        return text("record %.0f more runs of 40 s, each with its own seed: hdt host --task excite:seed=1,seconds=40",
                    static_cast<double>(kRunsMin + 2 - runs));
    if (among("payload") && (among("link_mass") || among("joint_offset") || among("base_tilt") || among("cable_spring")))
        return "two runs with the elbow bent: hdt host --task sweep:joint=" + j + ",q4=1.57";
    if (among("torque_gain") && ambiguous.size() > 0)
        return "the same run with and without a known mass: hdt host --task excite:seed=1,seconds=40";
    if (among("temperature") && (among("viscous_nonlinear") || among("stribeck_shape")))
        return "two fast sweeps from cold, speeds in random order: hdt host --task excite:seed=2,seconds=40";
    if (among("presliding") && ambiguous.size() > 0)
        return "many reversals at several speeds: hdt host --task friction:joint=" + j;
    if (among("base_tilt") || among("joint_offset"))
        return "the same sweep at q1 = 0 and at q1 = 3 rad: hdt host --task sweep:joint=" + j + ",q1=3";
    if (id == "unnamed")
        return "repeat with other speeds and poses: hdt host --task excite:seed=3,seconds=60";
    if (id.empty())
        return "";
    return "confirm on the task that matters: hdt host --task lemniscate";
}

std::string list(const std::vector<std::string> &items)
{
    std::string out;
    for (const std::string &s : items)
        out += (out.empty() ? "" : ", ") + s;
    return out;
}

std::string numbers(const Effect &e)
{
    std::string out;
    for (const EffectParameter &p : e.parameters)
        out += (out.empty() ? "" : ", ") + p.name + " " + text("%.4g", p.value) + text(" +- %.2g", p.sigma);
    return out;
}

void put_words(std::size_t runs, JointDiagnosis *d, const std::string &doubt)
{
    const std::string errors = text("held-out error %.3g -> %.3g N.m (noise floor %.3g)", d->rms_before_nm,
                                    d->rms_after_nm, d->noise_floor_nm);
    const std::string few = runs < kRunsMin
        ? text(" Only %.0f independent run(s): pieces of a run are not independent evidence.", static_cast<double>(runs))
        : "";
    std::string names;
    for (const Effect &e : d->effects)
        names += (names.empty() ? "" : " and ") + (e.id == "unnamed" ? "something that depends on " + e.axis : e.id)
                 + (e.parameters.empty() ? "" : " (" + numbers(e) + ")");
    if (d->verdict == "named")
        d->words = "The model lacks " + names + "; " + errors + ".";
    else if (d->verdict == "unnamed")
        d->words = "The model lacks " + names + ", none of the known effects explains it; " + errors
                   + " with a table over that axis, which is not in the model file.";
    else if (d->verdict == "suspect")
        d->words = "Perhaps " + names + ", but " + doubt + "; nothing is adopted; held-out error"
                   + text(" %.3g N.m (noise floor %.3g).", d->rms_before_nm, d->noise_floor_nm);
    else
        d->words = "Nothing is missing that these runs could show; held-out error"
                   + text(" %.3g N.m (noise floor %.3g).", d->rms_before_nm, d->noise_floor_nm);
    if (!d->ambiguous_with.empty() && d->verdict != "nothing")
        d->words += " These runs cannot tell it from " + list(d->ambiguous_with) + ".";
    d->words += few;
}

std::vector<Candidate> list_candidates(const JointWork &w)
{
    std::vector<Candidate> tried;
    for (const Score &s : w.scores) {
        const Family &f = w.families[s.family];
        Candidate c;
        c.id = f.named() ? f.id : "unnamed: " + f.axis;
        c.log_e = s.log_e;
        c.p_adjusted = s.p_adjusted;
        c.rms_nm = s.rms_nm;
        const double ms = s.gain.rows > 0 ? s.gain.plain_total / s.gain.rows : 0;
        c.gain_nm = (ms < 0 ? -1 : 1) * std::sqrt(std::abs(ms));
        c.note = s.note;
        if (c.note.empty() && s.p_adjusted <= 0.05 && s.rms_nm < w.gate_nm)
            c.note = text("real but below %.2g N.m", w.gate_nm);
        tried.push_back(std::move(c));
    }
    std::stable_sort(tried.begin(), tried.end(), [](const Candidate &a, const Candidate &b) { return a.log_e > b.log_e; });
    tried.push_back({"torque_offset", 0, 0, 0, 1, "sliding data cannot tell it from unequal Coulomb friction"});
    return tried;
}

// What the selection of one joint started from.
struct Start { std::vector<Candidate> tried; VectorXd refit; };

// Effects whose contribution on this joint counts; chain effects may not reach every joint.
void list_effects(const hdt_arm &arm, const JointWork &w, const JointEstimate &e, const Found &axis,
                  const VectorXd &axis_theta, JointDiagnosis *d)
{
    for (std::size_t k = 0; k < w.found.size(); ++k) {
        const Found &f = w.found[k];
        Effect out;
        out.id = f.family.id;
        out.depends_on = f.family.depends_on;
        out.rms_nm = reducible_rms(w.test, [&](const BlockRows &b) { return effect_nm(e, w, k, b); });
        out.p_adjusted = f.p_adjusted;
        out.parameters = effect_parameters(arm, w, e, k);
        if (f.chain_theta && out.rms_nm < w.gate_nm)
            continue;
        d->effects.push_back(std::move(out));
        for (const std::string &a : f.ambiguous)
            if (std::find(d->ambiguous_with.begin(), d->ambiguous_with.end(), a) == d->ambiguous_with.end())
                d->ambiguous_with.push_back(a);
    }
    if (axis.family.id.empty())
        return;
    Effect out;
    out.id = "unnamed";
    out.axis = axis.family.axis;
    out.depends_on = axis.family.depends_on;
    out.rms_nm = reducible_rms(w.test, [&](const BlockRows &b) -> VectorXd { return axis.columns(b) * axis_theta; });
    out.p_adjusted = axis.p_adjusted;
    out.table_x = axis.family.knots;
    out.table_nm.assign(axis_theta.data(), axis_theta.data() + axis_theta.size());
    d->effects.push_back(std::move(out));
}

// Named, unnamed or suspect, and why doubt remains.
std::string judge(const JointWork &w, std::size_t runs, const HeldOut &h, bool unnamed, JointDiagnosis *d)
{
    d->verdict = unnamed ? "unnamed" : "named";
    const double fall = 1 - rms(h.after) / std::max(rms(h.before), 1e-12);
    // a run's own Coulomb scatter must not decide: judged by likelihood, with a limit in N.m
    const double gain = w.held_out_log_likelihood(h.after_by_run) - w.held_out_log_likelihood(h.refit_by_run);
    const double *scatter = w.evidence().noise().variance;
    const double least = std::min(rms(h.before), rms(h.refit));
    const double limit = std::sqrt(kWorse * least * least + 2 * (scatter[RG_COULOMB] + scatter[RG_OFFSET]));
    if (!(gain > 0) || rms(h.after) > limit) {
        d->verdict = "suspect";
        return text("it does not help on the held-out runs (%.3g N.m as given, %.3g with friction fitted again, "
                    "%.3g with it)", rms(h.before), rms(h.refit), rms(h.after));
    }
    if (unnamed && d->effects.size() == 1 && fall < kUnnamedFall) {
        d->verdict = "suspect";
        return text("an axis without a name has to take %.0f %% off the held-out error, and takes %.1f %%",
                    100 * kUnnamedFall, 100 * fall);
    }
    if (runs < kRunsMin && fall < 0.15) {
        d->verdict = "suspect";
        return text("%.0f independent run(s) are too few to name it", static_cast<double>(runs));
    }
    return "";
}

struct Judged { JointDiagnosis d; JointEstimate e; bool adopt = false; };

Judged judge_joint(const hdt_arm &arm, JointWork &w, const Found &axis, const Start &start, std::size_t runs, const Gates &gates)
{
    Judged out;
    JointDiagnosis &d = out.d;
    d.joint = w.joint + 1;
    d.noise_floor_nm = w.floor_nm;
    VectorXd axis_theta;
    out.e = estimate(w, axis, &axis_theta);
    const HeldOut h = held_out(w, out.e, axis, axis_theta, start.refit);
    d.rms_before_nm = rms(h.before);
    d.rms_refit_nm = rms(h.refit);
    list_effects(arm, w, out.e, axis, axis_theta, &d);
    d.tried = start.tried;
    std::string doubt;
    if (d.effects.empty()) {
        d.verdict = "nothing";
        detection_limits(w, gates, &d);
    } else {
        doubt = judge(w, runs, h, !axis.family.id.empty(), &d);
    }
    out.adopt = d.verdict == "named" || (d.verdict == "unnamed" && d.effects.size() > 1);
    d.rms_after_nm = d.verdict == "named" || d.verdict == "unnamed" ? rms(h.after) : d.rms_before_nm;
    d.next_experiment = next_experiment(d.effects.empty() ? "" : d.effects[0].id, d.ambiguous_with, d.joint, runs);
    put_words(runs, &d, doubt);
    HeldOut shown = h;
    if (d.verdict == "nothing" || d.verdict == "suspect") {
        shown.after = h.before;
        for (std::size_t r = 0; r < w.test.size(); ++r)
            shown.after_by_run[r] = w.test[r].y_nm;
    }
    pictures(w, shown, axis, &d);
    return out;
}

// The joints to look at, and why the others are left out.
Works make_works(const hdt_arm &arm, const RunBlocks &fit, const RunBlocks &test, const DiagnoseOptions &options,
                 std::vector<std::pair<int, std::string>> *skipped)
{
    Works out;
    for (int j = 0; j < arm.joints; ++j) {
        if (!options.joints.empty() && std::find(options.joints.begin(), options.joints.end(), j + 1) == options.joints.end())
            continue;
        std::vector<BlockRows> f, t;
        Index rows = 0, held = 0;
        for (const auto &run : fit) {
            f.push_back(run[static_cast<std::size_t>(j)]);
            rows += f.back().size();
        }
        for (const auto &run : test) {
            t.push_back(run[static_cast<std::size_t>(j)]);
            held += t.back().size();
        }
        if (rows < kRowsMin || held == 0) {
            skipped->emplace_back(j + 1, text("it hardly moves: %.0f blocks to fit, %.0f held out",
                                              static_cast<double>(rows), static_cast<double>(held)));
            continue;
        }
        out.push_back(std::make_unique<JointWork>(arm, j, std::move(f), std::move(t)));
    }
    return out;
}

void check_options(const hdt_arm &arm, const std::vector<Run> &fit, const std::vector<Run> &test, const DiagnoseOptions &o)
{
    if (fit.empty() || test.empty())
        throw InputError("diagnose: expected at least one run to fit and one held out, found "
                         + std::to_string(fit.size()) + " and " + std::to_string(test.size())
                         + ": hdt log cut divides one long log");
    for (int j : o.joints)
        if (j < 1 || j > arm.joints)
            throw InputError("diagnose: joint " + std::to_string(j) + ": expected 1.." + std::to_string(arm.joints));
    for (const Run &f : fit)
        for (const Run &t : test)
            if (!f.path.empty() && f.path == t.path)
                throw InputError(f.path + ": given both to fit and to test: a held-out run must not be fitted");
}

void adopt(ArmFile *model, const Works &works, std::vector<Judged> *judged)
{
    bool payload = false;
    for (std::size_t j = 0; j < works.size(); ++j) {
        Judged &g = (*judged)[j];
        if (!g.adopt)
            continue;
        std::string refused = adopt_joint(model, *works[j], g.e);
        for (Effect &e : g.d.effects) {
            e.adopted = e.id != "unnamed" && refused.find(" " + e.id) == std::string::npos && e.id != "base_tilt";
            if (e.id != "payload" || payload)
                continue;
            for (const Found &f : works[j]->found)
                if (f.chain_theta && f.family.id == "payload")
                    refused += adopt_payload(model, f);
            payload = true;
        }
        if (!refused.empty())
            g.d.words += " " + refused + ".";
    }
    model->refresh();
}

} // namespace

Diagnosis diagnose(const ArmFile &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                   const DiagnoseOptions &options)
{
    check_options(arm.arm(), fit, test, options);
    const Gates gates;
    RunBlocks fit_blocks = read_blocks(arm.arm(), fit, true, options);
    const RunBlocks test_blocks = read_blocks(arm.arm(), test, false, options);
    const std::size_t runs = independent_runs(fit);
    if (fit_blocks.size() < kRunsMin)
        fit_blocks = cut_pieces(fit_blocks);

    Diagnosis out{arm, {}, {}};
    Works works = make_works(arm.arm(), fit_blocks, test_blocks, options, &out.skipped);
    std::vector<Start> start(works.size());
    parallel(works.size(), [&](std::size_t j) {
        works[j]->assess(gates);
        const Gram g = works[j]->evidence().gram({});
        start[j].refit = gls_fit(g, RunSet(g.weighted.size(), 1)).nuisance.head(kFriction);
        start[j].tried = list_candidates(*works[j]);
    });
    std::vector<Found> axes;
    select(works, gates, &axes);
    parallel(works.size(), [&](std::size_t j) {
        if (prune(*works[j]))
            works[j]->assess(gates);
    });
    std::vector<Judged> judged(works.size());
    parallel(works.size(), [&](std::size_t j) {
        judged[j] = judge_joint(arm.arm(), *works[j], axes[j], start[j], runs, gates);
    });
    adopt(&out.model, works, &judged);
    for (Judged &g : judged)
        out.joints.push_back(std::move(g.d));
    return out;
}

} // namespace hdt
