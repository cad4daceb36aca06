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
#include <map>
#include <numeric>
#include <thread>

#include "model/adopt.hpp"
#include "model/candidates.hpp"
#include "model/events.hpp"
#include "model/next_run.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kEffectsMax = 4;
constexpr std::size_t kRunsMin = 4;
constexpr Index kRowsMin = 400;            // per joint over all fit runs
// held-out error may grow by this where likelihood gains: few runs scatter
constexpr double kWorse = 1.05;
constexpr double kClearFall = 0.95;        // of the held-out error, best without the effect
constexpr double kWorseThanRefit = 1.5;    // its square, against friction fitted again
constexpr double kUnnamedFall = 0.03;      // what no effect explains must be worth a table
constexpr double kFewRunsFall = 0.15;      // of the held-out error, where few runs may name
constexpr double kSure = 9;                // three sigma from nothing, squared and per number
// of the evidence: within it the chain effect first in the list is taken
constexpr double kChainTie = 0.98;
constexpr double kChainShare = 0.15;       // of the floor: a chain effect's part worth a line on a joint
constexpr double kOverGate = 1.3;          // a detection limit, over what the gates ask for at least
constexpr double kSeparates = 0.3;         // of the noise floor, rms over a run
constexpr int kEventPasses = 3;            // the last only fits
constexpr double kPiece_s = 20;
constexpr double kReversalGuard_s = 0.03;  // velocity estimate and gear wind-up settle within this
// lost motion and wind-up of a reversal: no term describes it to the end
constexpr double kReversalTravel_rad = 0.002;
constexpr const char *kChainIds[] = {"payload", "base_tilt", "link_mass"}; // in order of preference

using Works = std::vector<std::unique_ptr<JointWork>>;
using RunBlocks = std::vector<std::vector<BlockRows>>; // [run][joint]

std::string text(const char *format, double a, double b = 0, double c = 0)
{
    char buf[256];
    std::snprintf(buf, sizeof buf, format, a, b, c);
    return buf;
}

// How many runs tell of each other's scatter, and whether fewer than that may name.
struct Independent { std::size_t count; bool may_name; };

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

// Each run is given back as soon as it is read: ten minutes of seven joints are a tenth of a gigabyte.
RunBlocks read_blocks(const hdt_arm &arm, std::vector<Run> runs, bool to_fit, const DiagnoseOptions &options)
{
    ConditionOptions co;
    co.block_s = options.block_s;
    co.reversal_guard_s = kReversalGuard_s;
    co.reversal_travel_rad = kReversalTravel_rad;
    co.soft_margin_nm = fall_margin_nm;
    RunBlocks out;
    for (Run &r : runs) {
        out.push_back(block_rows(arm, condition(r, arm, co), r, to_fit));
        r = {};
    }
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
        const auto want = static_cast<int>((kRunsMin + runs.size() - 1)
                                           / std::max<std::size_t>(runs.size(), 1));
        const int pieces = std::clamp(static_cast<int>(end / kPiece_s), want, 12);
        for (int p = 0; p < pieces; ++p) {
            std::vector<BlockRows> piece;
            for (const BlockRows &b : joints) {
                const auto at = [&](int k) {
                    const double t = end * k / pieces;
                    return k == pieces
                               ? b.size()
                               : std::lower_bound(b.t_s.data(), b.t_s.data() + b.size(), t) - b.t_s.data();
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

// The chain effect that explains most, if one stands against every joint's own best explanation.
bool take_chain(Works &works, const Gates &gates)
{
    std::vector<ChainScore> scores(std::size(kChainIds));
    parallel(scores.size(), [&](std::size_t k) {
        const auto has = [&](const Found &f) { return f.family.id == kChainIds[k]; };
        if (!works.empty() && std::none_of(works[0]->found.begin(), works[0]->found.end(), has))
            scores[k] = weigh_chain(works, kChainIds[k], gates);
    });
    const ChainScore *best = nullptr;
    for (const ChainScore &c : scores)
        if (c.passes && (!best || c.total > best->total / kChainTie))
            best = &c;
    if (!best)
        return false;
    for (std::size_t j = 0; j < works.size(); ++j) {
        JointWork &w = *works[j];
        Found f;
        f.family = *std::find_if(w.families.begin(), w.families.end(),
                                 [&](const Family &k) { return k.id == best->id && k.chain; });
        f.at = best->at;
        f.chain_theta = best->theta;
        f.chain_covariance = best->covariance;
        f.ambiguous = best->ambiguous[j];
        f.p_adjusted = best->p_adjusted;
        w.found.push_back(std::move(f));
        w.stale = true;
    }
    return true;
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
        if (f.family.id == "order_line" && w.beside_ripple(f.at.x))
            for (const char *id : {"eccentricity", "joint_offset"})
                f.ambiguous.push_back(id);
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
    *cov = jackknife_covariance(part, run_covariance(part, fit));
    return fit;
}

// A spring's rest is half the difference of Coulomb friction over its stiffness: sigma from their joint
// covariance, whether friction is fitted again or kept as declared.
double rest_sigma(const JointWork &w, const Gram &g)
{
    Index at = kFriction + w.imperfection_columns();
    for (const Found &f : w.found) {
        if (f.family.id == "cable_spring") {
            MatrixXd cov;
            const GlsFit fit = fit_from(g, 0, &cov);
            const double k = fit.nuisance[at], rest = -0.5 * (fit.nuisance[0] - fit.nuisance[1]) / k;
            VectorXd d = VectorXd::Zero(cov.rows());
            d[0] = -0.5 / k;
            d[1] = 0.5 / k;
            d[at] = -rest / k;
            return std::sqrt(std::max(0.0, d.dot(cov * d)));
        }
        at += f.chain_theta ? 0 : f.columns(w.fit[0]).cols();
    }
    return 0;
}

// Variances no less than these; correlations stay.
void grow_to(const VectorXd &variance, MatrixXd *covariance)
{
    const VectorXd grow = (variance.array() / covariance->diagonal().array().max(1e-300)).max(1.0).sqrt();
    *covariance = (grow.asDiagonal() * *covariance * grow.asDiagonal()).eval();
}

// Friction kept as declared is known no better than the model file says, and what is estimated beside
// it no better than that allows.
void widen(const JointWork &w, Gram g, JointEstimate *e)
{
    constexpr double exact = 1e6; // precision, 1/(N.m)^2
    for (MatrixXd &m : g.weighted)
        for (Index k = 0; k < kFriction; ++k) {
            const double sigma = k < 2 ? w.f0_sigma_nm[k] : 0;
            m(k, k) += (sigma > 0 ? std::min(exact, 1 / (sigma * sigma)) : exact)
                       / static_cast<double>(g.weighted.size());
        }
    MatrixXd cov;
    (void)fit_from(g, 0, &cov);
    Index at = kFriction + w.imperfection_columns();
    for (std::size_t k = 0; k < e->theta.size(); ++k) {
        const Index n = e->theta[k].size();
        grow_to(cov.diagonal().segment(at, n), &e->covariance[k]);
        at += n;
    }
}

JointEstimate estimate(const JointWork &w, const Found &axis, VectorXd *axis_theta)
{
    const bool with_axis = !axis.family.id.empty();
    const Gram g = with_axis ? w.gram(axis.family, axis.at) : w.evidence().gram({});
    // declared friction stays unless fitting it again helps in runs left out
    const bool declared_serves = left_out_rms(g, kFriction) <= left_out_rms(g);
    const Index kept = declared_serves && !w.offset ? kFriction : 0;
    MatrixXd cov;
    const GlsFit fit = fit_from(g, kept, &cov);
    JointEstimate e;
    e.rest_sigma_rad = rest_sigma(w, g);
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
    if (kept > 0)
        widen(w, g, &e);
    return e;
}

// What the declared model gets a little wrong everywhere shows in no scatter of runs: it shows when a
// part of the joint's travel is left out.  Plain least squares, six parts, jackknife.
void widen_by_place(const JointWork &w, JointEstimate *e)
{
    constexpr int parts = 6;
    std::vector<double> angle;
    for (const BlockRows &b : w.fit)
        angle.insert(angle.end(), b.q.data(), b.q.data() + b.size());
    if (w.found.empty() || angle.size() < 100)
        return;
    std::sort(angle.begin(), angle.end());
    double edge[parts];
    for (std::size_t k = 0; k < parts; ++k)
        edge[k] = angle[(k + 1) * (angle.size() - 1) / parts];
    const Index first = e->friction.isZero() ? kFriction : 0, n = w.fixed(w.fit[0]).cols() - first;
    std::vector<MatrixXd> a(parts, MatrixXd::Zero(n, n));
    std::vector<VectorXd> b(parts, VectorXd::Zero(n));
    for (const BlockRows &rows : w.fit) {
        const MatrixXd x = w.fixed(rows).rightCols(n);
        const VectorXd y = w.target(rows);
        for (Index t = 0; t < rows.size(); ++t) {
            const auto part = std::lower_bound(edge, edge + parts, rows.q[t]) - edge;
            const auto k = static_cast<std::size_t>(std::min<std::ptrdiff_t>(parts - 1, part));
            a[k].selfadjointView<Eigen::Lower>().rankUpdate(x.row(t).transpose());
            b[k] += x.row(t).transpose() * y[t];
        }
    }
    // healthy imperfections stay bounded
    VectorXd bound = VectorXd::Zero(n);
    const VectorXd prior = w.evidence().rows()[0].prior;
    const double noise = w.evidence().rms_nm() * w.evidence().rms_nm();
    const Index n_imperfect = w.imperfection_columns();
    bound.segment(kFriction - first, n_imperfect) = noise * prior.segment(kFriction, n_imperfect);
    MatrixXd left_out(n, parts);
    for (int out = 0; out < parts; ++out) {
        MatrixXd sum = bound.asDiagonal();
        VectorXd right = VectorXd::Zero(n);
        for (std::size_t k = 0; k < parts; ++k)
            if (static_cast<int>(k) != out) {
                sum += a[k];
                right += b[k];
            }
        left_out.col(out) = ridged(sum).selfadjointView<Eigen::Lower>().llt().solve(right);
    }
    const VectorXd variance = jackknife_variance(left_out);
    Index at = kFriction - first + w.imperfection_columns();
    for (std::size_t k = 0; k < e->theta.size(); ++k) {
        const Index count = e->theta[k].size();
        // what is local or has no place cannot be asked this way
        if (w.found[k].family.adoptable() && w.found[k].family.id != "order_line" && count > 0) {
            grow_to(variance.segment(at, count), &e->covariance[k]);
        }
        at += count;
    }
}

// How many sigma an effect's numbers are from nothing, squared and per number.
double wald(const JointEstimate &e, std::size_t k)
{
    return e.theta[k].dot(e.covariance[k].ldlt().solve(e.theta[k])) / static_cast<double>(e.theta[k].size());
}

// Effects whose numbers are not three sigma from nothing, or not two where parts of the travel are left
// out, or not possible beside the others, are taken out again.
bool prune(JointWork &w)
{
    VectorXd unused;
    const JointEstimate e = estimate(w, {}, &unused);
    JointEstimate wide = e;
    widen_by_place(w, &wide);
    bool any = false;
    for (std::size_t k = w.found.size(); k-- > 0;) {
        if (w.found[k].chain_theta || w.found[k].family.own_phase)
            continue;
        const auto &possible = w.found[k].family.plausible;
        if (wald(e, k) >= kSure && wald(wide, k) >= 4 && (!possible || possible(e.theta[k])))
            continue;
        w.found.erase(w.found.begin() + static_cast<std::ptrdiff_t>(k));
        w.stale = any = true;
    }
    return any;
}

// Residuals on held-out rows, all runs one after the other.
struct HeldOut {
    VectorXd before, refit, after;
    std::vector<VectorXd> before_by_run, refit_by_run, after_by_run;
};

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
    return {joined(before), joined(again), joined(after), before, again, after};
}

VectorXd axis_signal(const std::string &id, const std::string &axis, const BlockRows &b, std::string *label)
{
    const auto is = [&](std::initializer_list<const char *> ids) {
        return std::any_of(ids.begin(), ids.end(),
                           [&](const char *k) { return id == k || axis.rfind(k, 0) == 0; });
    };
    if (is({"load_friction", "drive_efficiency", "soft_windup", "load"}))
        return *label = "load (gravity torque), N.m", b.gravity;
    if (is({"temperature", "time", "external_vibration"}))
        return *label = "time, s", b.t_s;
    if (is({"presliding", "travel"}))
        return *label = "travel since reversal, rad", b.travel;
    if (is({"inertia", "coupling"}))
        return *label = "acceleration, rad/s^2", b.a;
    if (is({"torque_gain", "torque_saturation", "torque_delay", "torque"}))
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
    const OrderGrid grid = order_grid(rows, w.highest_order());
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
        return text("record %.0f more runs of 40 s, each with its own seed: ",
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
                   + (n.task.empty() ? "" : text(": at most %.2g of the noise floor apart", n.separation));
        return (n.payload_kg > 0 ? text("with a known %.3g kg 0.05 m beyond the flange: ", n.payload_kg)
                                 : std::string())
               + host_line(arm, n.task) + " (" + id + " and " + n.rival
               + text(" would be %.2g of the noise floor apart, %.2g in these runs)", n.separation,
                      n.at_hand);
    }
    if (id == "external_vibration")
        return "the same run with the neighbourhood switched off: "
               + host_line(arm, "excite:seed=1,seconds=40");
    return "confirm on the task that matters: " + host_line(arm, "lemniscate");
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
        out += (out.empty() ? "" : ", ") + p.name + " " + text("%.4g", p.value)
               + (p.sigma > 0 ? text(" +- %.2g", p.sigma) : "");
    return out;
}

// Of a joint that takes nothing in: whether it has part in what the whole arm takes in.
std::string nothing_adopted(const JointDiagnosis &d)
{
    std::vector<std::string> ids;
    for (const Effect &e : d.effects)
        if (e.adopted)
            ids.push_back(e.id);
    if (ids.empty())
        return "nothing is adopted; held-out error" + text(" %.3g N.m", d.rms_before_nm);
    return "only what other joints show of the whole arm is adopted (" + list(ids) + "); held-out error"
           + text(" %.3g -> %.3g N.m", d.rms_before_nm, d.rms_after_nm);
}

void put_words(std::size_t runs, JointDiagnosis *d, const std::string &doubt)
{
    const std::string errors = text("held-out error %.3g -> %.3g N.m (noise floor %.3g)", d->rms_before_nm,
                                    d->rms_explained_nm, d->noise_floor_nm);
    const std::string few =
        runs < kRunsMin ? text(" Only %.0f independent run(s): pieces of a run are not independent evidence.",
                               static_cast<double>(runs))
                        : "";
    std::string names;
    for (const Effect &e : d->effects)
        names += (names.empty() ? "" : " and ")
                 + (e.id == "unnamed" ? "something that depends on " + e.axis : e.id)
                 + (e.parameters.empty() ? "" : " (" + numbers(e) + ")");
    if (d->verdict == "named")
        d->words = "The model lacks " + names + "; " + errors + ".";
    else if (d->verdict == "unnamed")
        d->words = "The model lacks " + names + ", none of the known effects explains it; " + errors
                   + " with a table over that axis.";
    else if (d->verdict == "suspect")
        d->words = "Perhaps " + names + ", but " + doubt + "; " + nothing_adopted(*d)
                   + text(" (noise floor %.3g).", d->noise_floor_nm);
    else
        d->words = "Nothing is missing that these runs could show; held-out error"
                   + text(" %.3g N.m (noise floor %.3g).", d->rms_before_nm, d->noise_floor_nm);
    const auto is = [&](const char *id) {
        return std::any_of(d->effects.begin(), d->effects.end(), [&](const Effect &e) { return e.id == id; });
    };
    if (d->verdict == "named" && is("torque_offset"))
        d->words += " Sliding cannot tell an offset from Coulomb friction that differs by direction.";
    if (d->verdict == "named" && is("external_vibration"))
        d->words +=
            " A vibration has its own phase in every run: it is no part of a model, look for its source.";
    if (!d->ambiguous_with.empty() && d->verdict != "nothing")
        d->words += " These runs cannot tell it from " + list(d->ambiguous_with) + ".";
    d->words += few;
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
            c.note = text("real but below %.2g N.m", w.gate_nm);
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

// What the selection of one joint started from: friction fitted again and nothing else, and whether that is
// more than runs scatter and helps in runs left out.
struct Start { std::vector<Candidate> tried; VectorXd refit, refit_sigma; bool refit_stands = false; };

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
        return text("it does not help on the held-out runs (%.3g N.m as given, %.3g with friction fitted "
                    "again, %.3g with it)",
                    rms(h.before), rms(h.refit), rms(h.after));
    }
    if (unnamed && d->effects.size() == 1 && fall < kUnnamedFall) {
        d->verdict = "suspect";
        return text("an axis without a name has to take %.0f %% off the held-out error, and takes %.1f %%",
                    100 * kUnnamedFall, 100 * fall);
    }
    if (runs.count < kRunsMin && !(runs.may_name && fall >= kFewRunsFall)) {
        d->verdict = "suspect";
        return text("%.0f independent run(s) are too few to name it (held-out error would go from %.3g to "
                    "%.3g N.m; --few-runs adopts it)",
                    static_cast<double>(runs.count), rms(h.before), rms(h.after));
    }
    return "";
}

void put_events(const std::vector<Event> &events, JointDiagnosis *d)
{
    std::string words;
    for (const Event &e : events) {
        if (e.joint != d->joint)
            continue;
        d->events.push_back({e.run, e.from_s, e.to_s, e.kind, e.torque_nm, e.angle_rad, e.log_likelihood});
        words += (words.empty() ? "" : ", ") + e.run + text(" from %.1f to %.1f s: ", e.from_s, e.to_s)
                 + (e.kind == "angle" ? text("the angle off by %.2g rad", e.angle_rad)
                                      : e.kind + text(" off by %.2g N.m", e.torque_nm));
    }
    if (!words.empty())
        d->words += " In part of a run only, left out of the fit and of the model: " + words + ".";
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

void put_friction(const Start &start, JointDiagnosis *d)
{
    d->words += text(" Its friction has changed: Coulomb %+.3g and %+.3g N.m", start.refit[0], start.refit[1])
                + text(" (positive, negative), viscous %+.3g and %+.3g N.m.s/rad;", start.refit[2],
                       start.refit[3])
                + text(" with that in the model the held-out error is %.3g N.m.", d->rms_after_nm);
}

struct Judged {
    JointDiagnosis d;
    HeldOut shown;
    JointEstimate e;
    Found axis;
    VectorXd axis_theta;
    std::vector<std::size_t> places;   // of d.effects in JointWork::found
    std::string doubt, dropped;        // why it is suspect; what the held-out runs denied beside what stands
    bool adopt = false;
};

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
    out.adopt = d.verdict == "named" || d.verdict == "unnamed";
    d.rms_after_nm = d.rms_explained_nm = out.adopt ? rms(h.after) : d.rms_before_nm;
    d.next_experiment = next_experiment(arm, w, out.e, d, runs.count);
    HeldOut &shown = out.shown = h;
    if (d.verdict == "nothing" || d.verdict == "suspect") {
        const bool taken = (runs.count >= kRunsMin || runs.may_name) && take_friction(start, &d);
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

// Where the held-out runs deny the whole, the part of it found first may stand.
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

// The joints to look at, and why the others are left out.
Works make_works(const hdt_arm &arm, RunBlocks fit, const RunBlocks &test, const DiagnoseOptions &options,
                 std::vector<std::pair<int, std::string>> *skipped)
{
    Works out;
    for (int j = 0; j < arm.joints; ++j) {
        if (!options.joints.empty()
            && std::find(options.joints.begin(), options.joints.end(), j + 1) == options.joints.end())
            continue;
        std::vector<BlockRows> f, t;
        Index rows = 0, held = 0;
        for (auto &run : fit) {
            f.push_back(std::move(run[static_cast<std::size_t>(j)]));
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

void check_options(const hdt_arm &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                   const DiagnoseOptions &o)
{
    if (fit.empty() || test.empty())
        throw InputError("diagnose: expected at least one run to fit and one held out, found "
                         + std::to_string(fit.size()) + " and " + std::to_string(test.size())
                         + ": hdt log cut divides one long log");
    for (int j : o.joints)
        if (j < 1 || j > arm.joints)
            throw InputError("diagnose: joint " + std::to_string(j) + ": expected 1.."
                             + std::to_string(arm.joints));
    for (const Run &f : fit)
        for (const Run &t : test)
            if (!f.path.empty() && f.path == t.path)
                throw InputError(f.path
                                 + ": given both to fit and to test: a held-out run must not be fitted");
}

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

// The model written, and why a part of what was found is not in it.
void put_refused(JointDiagnosis *d)
{
    if (!d->refuses())
        return;
    d->words += text(" Of the model written it is %.3g N.m.", d->rms_after_nm);
    for (const Effect &e : d->effects)
        if (!e.refused.empty())
            d->words += " " + (e.axis.empty() ? e.id : "The curve over " + e.axis) + " is not adopted: "
                        + e.refused + ".";
}

// Last of all, when it is known what the model holds.
void put_all_words(const Independent &runs, const Start &start, const std::vector<Event> &events, Judged *g)
{
    put_words(runs.count, &g->d, g->doubt);
    if (g->d.friction_refitted)
        put_friction(start, &g->d);
    if (!g->dropped.empty())
        g->d.words += " More was looked at (" + g->dropped + "), but does not help on the held-out runs.";
    put_refused(&g->d);
    put_events(events, &g->d);
}

void declared_sigma(const ArmFile &arm, JointWork *w)
{
    const char *const way[] = {"positive", "negative"};
    for (int d = 0; d < 2; ++d) {
        const std::string key = "joint." + std::to_string(w->joint + 1) + ".friction." + way[d] + ".f0";
        if (!arm.has(key))
            continue;
        const Quantity f0 = arm.get(key);
        w->f0_sigma_nm[d] = f0.sigma.empty() ? 0 : f0.sigma[0];
    }
}

// The runs to fit, each joint without its own events.
RunBlocks mask_events(const RunBlocks &runs, const std::vector<Event> &events)
{
    RunBlocks out = runs;
    for (auto &joints : out)
        for (std::size_t j = 0; j < joints.size(); ++j) {
            std::vector<Event> mine;
            for (const Event &e : events)
                if (e.joint == static_cast<int>(j) + 1)
                    mine.push_back(e);
            joints[j] = without_events(joints[j], mine);
        }
    return out;
}

// All that repeats, with its evidence.
void find_effects(Works &works, const Gates &gates, std::vector<Start> *start, std::vector<Found> *axes)
{
    parallel(works.size(), [&](std::size_t j) {
        works[j]->assess(gates);
        const Gram g = works[j]->evidence().gram({});
        MatrixXd cov;
        Start &s = (*start)[j];
        s.refit = fit_from(g, 0, &cov).nuisance.head(kFriction);
        s.refit_sigma = cov.diagonal().head(kFriction).cwiseMax(0.0).cwiseSqrt();
        const MatrixXd of_friction = cov.topLeftCorner(kFriction, kFriction);
        s.refit_stands = s.refit.dot(of_friction.ldlt().solve(s.refit)) >= kSure * kFriction
                         && left_out_rms(g) < left_out_rms(g, kFriction);
        (*start)[j].tried = list_candidates(*works[j], gates);
    });
    select(works, gates, axes);
    parallel(works.size(), [&](std::size_t j) {
        JointWork &w = *works[j];
        // what is left is estimated anew without what was taken out
        while (prune(w))
            w.assess(gates);
        const auto offset = w.weigh_offset(gates);
        if ((*axes)[j].family.id.empty() && offset && offset->passes)
            w.offset = offset;
    });
}

} // namespace

bool JointDiagnosis::refuses() const
{
    return std::any_of(effects.begin(), effects.end(), [](const Effect &e) { return !e.refused.empty(); });
}

Diagnosis diagnose(const ArmFile &arm, std::vector<Run> fit, std::vector<Run> test,
                   const DiagnoseOptions &options)
{
    check_options(arm.arm(), fit, test, options);
    const Gates gates;
    const Independent runs = {independent_runs(fit), options.few_runs};
    RunBlocks fit_blocks = read_blocks(arm.arm(), std::move(fit), true, options);
    const RunBlocks test_blocks = read_blocks(arm.arm(), std::move(test), false, options);
    if (fit_blocks.size() < kRunsMin)
        fit_blocks = cut_pieces(fit_blocks);

    Diagnosis out{arm, {}, {}};
    Works works;
    std::vector<Start> start;
    std::vector<Found> axes;
    std::vector<Event> events;
    for (int pass = 0; pass < kEventPasses; ++pass) {
        out.skipped.clear();
        works = make_works(arm.arm(), mask_events(fit_blocks, events), test_blocks, options, &out.skipped);
        for (auto &w : works)
            declared_sigma(arm, w.get());
        start.assign(works.size(), {});
        find_effects(works, gates, &start, &axes);
        std::vector<std::vector<Event>> more(works.size());
        parallel(works.size(), [&](std::size_t j) { more[j] = find_events(*works[j], axes[j]); });
        const std::size_t before = events.size();
        if (pass + 1 < kEventPasses)
            for (const auto &m : more)
                events.insert(events.end(), m.begin(), m.end());
        if (events.size() == before)
            break;
    }
    std::vector<Judged> judged(works.size());
    parallel(works.size(), [&](std::size_t j) {
        judged[j] = judge_whole_or_part(arm.arm(), *works[j], axes[j], start[j], runs, gates);
    });
    adopt(&out.model, works, start, &judged);
    parallel(works.size(), [&](std::size_t j) {
        Judged &g = judged[j];
        pictures(*works[j], g.shown, g.axis, &g.d);
        put_all_words(runs, start[j], events, &g);
    });
    for (Judged &g : judged)
        out.joints.push_back(std::move(g.d));
    return out;
}

} // namespace hdt
