// SPDX-License-Identifier: Apache-2.0
//
// Owns: evidence for every candidate, gates, choice (see candidates.hpp).
// Never: reads held-out runs to choose.
#include "model/candidates.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int kArOrder = 8; // fewer cannot hold both the slow part and the white share
constexpr double kWander_s = 10;
constexpr std::size_t kSplits = 16, kPeaks = 5, kPlainPeaks = 3;
constexpr double kHighestOrder = 600;
constexpr double kLoose = 5;
constexpr double kTie_nats = 5, kTieShare = 0.95, kAdequate = 0.9;

RunSet all_runs(std::size_t n) { return RunSet(n, 1); }

std::vector<ScanRows> scan_rows(const std::vector<BlockRows> &runs)
{
    std::vector<ScanRows> out;
    for (const BlockRows &b : runs)
        out.push_back(b.scan());
    return out;
}

std::vector<int> unbroken(const std::vector<Index> &block)
{
    std::vector<int> lags(block.size(), 0);
    for (std::size_t i = 1; i < block.size(); ++i)
        lags[i] = block[i] == block[i - 1] + 1 ? std::min(lags[i - 1] + 1, kArOrder) : 0;
    return lags;
}

double contribution_rms(const Gram &g, const VectorXd &theta)
{
    const Projected p = project(g, all_runs(g.weighted.size()));
    return std::sqrt(std::max(0.0, theta.dot(p.plain_a * theta)) / std::max(p.rows, 1.0));
}

// Share of the columns' information left beside the nuisances: none when nothing excites them.
bool is_excited(const Gram &g, const Projected &p)
{
    VectorXd whole = VectorXd::Zero(g.columns);
    for (const MatrixXd &w : g.weighted)
        whole += w.diagonal().segment(g.nuisances, g.columns);
    for (Index k = 0; k < g.columns; ++k)
        if (p.a(k, k) > 1e-6 * whole[k] && p.a(k, k) > 1e-9)
            return true;
    return false;
}

} // namespace

JointWork::JointWork(const hdt_arm &arm, int j, std::vector<BlockRows> fit_rows, std::vector<BlockRows> test_rows)
    : joint(j), fit(std::move(fit_rows)), test(std::move(test_rows)), arm_joint_(arm.joint[j]),
      min_rms_nm_(0.002 * arm.joint[j].ratio) // two digits of motor torque
{
    families = effect_families(arm, j, fit);
}

VectorXd JointWork::target(const BlockRows &b) const
{
    VectorXd y = b.y_nm;
    for (const Found &f : found)
        if (f.chain_theta)
            y -= f.columns(b) * *f.chain_theta;
    return y;
}

MatrixXd JointWork::fixed(const BlockRows &b) const
{
    const MatrixXd friction = nuisance_columns(b), healthy = imperfections(arm_joint_, b).columns;
    MatrixXd m(b.size(), friction.cols() + healthy.cols());
    m << friction, healthy;
    for (const Found &f : found) {
        if (f.chain_theta)
            continue;
        const MatrixXd x = f.columns(b);
        m.conservativeResize(Eigen::NoChange, m.cols() + x.cols());
        m.rightCols(x.cols()) = x;
    }
    return m;
}

Gram JointWork::gram(const Family &f, Point at) const
{
    std::vector<MatrixXd> x;
    for (const BlockRows &b : fit)
        x.push_back(f.columns(b, at));
    Gram g = evidence_->gram(x);
    if (f.roughness.size() > 0) {
        // an axis bends by at most the residual's own size from knot to knot
        const double scale = std::max(evidence_->rms_nm(), 1e-9);
        g.prior += f.roughness / (scale * scale);
    }
    return g;
}

// Smooth things a repeatable effect could look like, so that it is not taken for noise.
std::vector<MatrixXd> JointWork::rich_columns() const
{
    std::vector<MatrixXd> out;
    for (const BlockRows &b : fit) {
        std::vector<MatrixXd> parts;
        Index cols = 0;
        for (const Family &f : families) {
            // other joints' angles reach this one through the payload's columns
            const bool own = f.axis.empty() || f.axis[0] != 'q' || std::atoi(f.axis.c_str() + 1) == joint + 1;
            const bool smooth = (!f.named() && own) || f.id == "payload" || f.id == "inertia" || f.id == "torque_gain"
                                || f.id == "base_tilt" || f.id == "viscous_nonlinear" || f.id == "load_friction";
            if (!smooth)
                continue;
            parts.push_back(f.columns(b, f.grid.back()));
            cols += parts.back().cols();
        }
        MatrixXd m(b.size(), cols);
        Index at = 0;
        for (const MatrixXd &p : parts) {
            m.middleCols(at, p.cols()) = p;
            at += p.cols();
        }
        out.push_back(std::move(m));
    }
    return out;
}

// The strongest lines of an ordinary least-squares residual.
std::vector<LineHit> JointWork::plain_lines(const std::vector<RunRows> &rows, const std::vector<MatrixXd> &rich,
                                            const OrderGrid &grid) const
{
    const Index nf = rows[0].fixed.cols(), n = nf + rich[0].cols();
    MatrixXd a = MatrixXd::Zero(n, n);
    VectorXd b = VectorXd::Zero(n);
    std::vector<MatrixXd> x;
    for (std::size_t r = 0; r < rows.size(); ++r) {
        MatrixXd m(rows[r].y.size(), n);
        m << rows[r].fixed, rich[r];
        if (m.rows() > 0) // a run in which this joint stands still; Eigen divides by the row count
            a.selfadjointView<Eigen::Lower>().rankUpdate(m.transpose());
        b += m.transpose() * rows[r].y;
        x.push_back(std::move(m));
    }
    // columns differ in size by orders of magnitude
    const VectorXd scale = a.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
    a.triangularView<Eigen::StrictlyUpper>() = a.transpose();
    a = (scale.asDiagonal() * a * scale.asDiagonal()).eval();
    a.diagonal().array() += 1e-8;
    const VectorXd beta = scale.asDiagonal() * a.llt().solve(scale.asDiagonal() * b);
    NoiseModel white;
    white.predictor = {VectorXd(0)};
    white.innovation_nm = {1};
    std::vector<VectorXd> e;
    for (std::size_t r = 0; r < rows.size(); ++r)
        e.push_back(rows[r].y - x[r] * beta);
    return scan_peaks(scan_orders(scan_rows(fit), e, white, grid), kPlainPeaks);
}

void JointWork::weigh(std::size_t index, const std::vector<RunSet> &splits)
{
    const Family &f = families[index];
    Score s;
    s.family = index;
    std::vector<double> log_e;
    double best = -1e300, best_any = -1e300;
    Gram kept;
    bool any_plausible = false;
    for (Point at : f.grid) {
        Gram g = gram(f, at);
        const Projected p = project(g, all_runs(fit.size()));
        if (!is_excited(g, p))
            continue;
        s.excited = true;
        const GlsFit fitted = gls_fit(g, all_runs(fit.size()));
        log_e.push_back(split_log_e({&g}, splits));
        const bool ok = !f.plausible || f.plausible(fitted.theta);
        const double value = fitted.llr - static_cast<double>(g.columns);
        if ((ok && (!any_plausible || value > best)) || (!any_plausible && value > best_any)) {
            (ok ? best : best_any) = value;
            any_plausible = any_plausible || ok;
            s.at = at;
            s.llr = fitted.llr;
            s.rms_nm = contribution_rms(g, fitted.theta);
            kept = std::move(g);
        }
    }
    s.plausible = any_plausible;
    if (s.excited) {
        s.log_e = log_mean_exp(log_e, f.grid_count);
        s.gain = leave_one_run_out({&kept})[0];
    } else {
        s.note = "not excited by these runs";
    }
    if (s.excited && !s.plausible)
        s.note = "estimate has the wrong sign for this effect";
    scores[index] = std::move(s);
}

// What the effects already found do on the fit runs.
double JointWork::found_rms_nm() const
{
    if (found.empty())
        return 0;
    const VectorXd coef = gls_fit(evidence_->gram({}), all_runs(fit.size())).nuisance;
    return reducible_rms(fit, [&](const BlockRows &b) {
        VectorXd y = VectorXd::Zero(b.size());
        Index at = nuisance_columns(b).cols() + imperfection_columns();
        for (const Found &f : found) {
            const MatrixXd x = f.columns(b);
            y += x * (f.chain_theta ? *f.chain_theta : VectorXd(coef.segment(at, x.cols())));
            at += f.chain_theta ? 0 : x.cols();
        }
        return y;
    });
}

double JointWork::held_out_log_likelihood(const std::vector<VectorXd> &residual_nm) const
{
    std::vector<RunRows> rows;
    for (std::size_t r = 0; r < test.size(); ++r) {
        RunRows one;
        one.y = residual_nm[r];
        one.fixed = MatrixXd::Zero(one.y.size(), 1);
        one.lags = unbroken(test[r].block);
        set_random_effects(one, test[r].t_s, test[r].dir, test[r].v, kWander_s);
        rows.push_back(std::move(one));
    }
    double sum = 0;
    for (const MatrixXd &w : Evidence(std::move(rows), evidence_->noise()).gram({}).weighted)
        sum -= 0.5 * w(1, 1);
    return sum;
}

void JointWork::assess(const Gates &gates)
{
    if (!families.empty() && families.back().id == "order_line")
        families.pop_back();
    // friction may move by several times the residual, not without bound where nothing excites it
    double y2 = 0, v2 = 0, all = 0;
    for (const BlockRows &b : fit) {
        y2 += b.y_nm.squaredNorm();
        v2 += b.v.squaredNorm();
        all += static_cast<double>(b.size());
    }
    y2 = std::max(y2 / std::max(all, 1.0), 1e-12);
    v2 /= std::max(all, 1.0);
    std::vector<RunRows> rows;
    for (const BlockRows &b : fit) {
        RunRows r;
        r.y = target(b);
        r.fixed = fixed(b);
        const VectorXd sigma = imperfections(arm_joint_, b).sigma;
        r.prior = VectorXd::Zero(r.fixed.cols());
        r.prior.head(2).setConstant(1 / (kLoose * kLoose * y2));
        r.prior.segment(2, 2).setConstant(v2 / (kLoose * kLoose * y2));
        r.prior.segment(nuisance_columns(b).cols(), sigma.size()) = sigma.cwiseAbs2().cwiseInverse();
        r.lags = unbroken(b.block);
        set_random_effects(r, b.t_s, b.dir, b.v, kWander_s);
        rows.push_back(std::move(r));
    }
    const std::vector<ScanRows> sr = scan_rows(fit);
    const OrderGrid grid = order_grid(sr, kHighestOrder);
    std::vector<MatrixXd> rich = rich_columns();
    // a line moves through the spectrum with speed: left in, it would pass for coloured noise
    std::vector<LineHit> hits = plain_lines(rows, rich, grid);
    for (const LineHit &h : hits)
        for (double side : {-0.25, 0.25})
            for (std::size_t r = 0; r < fit.size(); ++r) {
                rich[r].conservativeResize(Eigen::NoChange, rich[r].cols() + 2);
                rich[r].rightCols(2) = line_columns(sr[r], h.order + side * grid.step, h.directed);
            }
    NoiseModel noise = fit_noise(rows, rich, kArOrder);
    evidence_ = std::make_unique<Evidence>(std::move(rows), std::move(noise));
    scan = scan_orders(sr, evidence_->score(), evidence_->noise(), grid);
    for (const LineHit &h : scan_peaks(scan, kPeaks)) {
        const auto same = [&](const LineHit &k) { return k.order == h.order && k.directed == h.directed; };
        if (std::none_of(hits.begin(), hits.end(), same))
            hits.push_back(h);
    }
    families.push_back(line_family(joint, hits, 2 * static_cast<double>(grid.count())));

    const std::vector<RunSet> splits = balanced_splits(fit.size(), kSplits);
    scores.assign(families.size(), {});
    std::vector<double> log_e;
    for (std::size_t k = 0; k < families.size(); ++k) {
        weigh(k, splits);
        log_e.push_back(scores[k].log_e);
    }
    const std::vector<double> p = ebh_adjusted(log_e);
    // the floor: what the best model found, named or not, leaves on a run it was not fitted on;
    // healthy imperfections are part of it, for no model has a term for them, but vibration once
    // inertia is found
    const auto is_inertia = [](const Found &f) { return f.family.id == "inertia"; };
    const Index explained = std::any_of(found.begin(), found.end(), is_inertia) ? 1 : 0;
    const double base = left_out_rms(evidence_->gram({}), 0, nuisance_columns(fit[0]).cols() + explained,
                                     imperfection_columns() - explained);
    double rows_total = 0, most = 0;
    for (std::size_t k = 0; k < families.size(); ++k) {
        scores[k].p_adjusted = p[k];
        rows_total = std::max(rows_total, scores[k].gain.rows);
        if (p[k] <= gates.alpha)
            most = std::max(most, scores[k].gain.plain_total);
    }
    floor_nm = std::sqrt(std::max(1e-12, base * base - most / std::max(rows_total, 1.0)));
    gate_nm = std::max(min_rms_nm_, gates.floor_share * floor_nm);
    remnant_nm = gates.remnant_share * found_rms_nm();
    for (Score &s : scores)
        s.passes = s.excited && s.plausible && s.p_adjusted <= gates.alpha
                   && s.rms_nm >= gate_nm * (families[s.family].adoptable() ? 1 : gates.loose_share)
                   && s.rms_nm >= remnant_nm
                   && s.gain.better >= gates.min_runs && 3 * s.gain.better >= 2 * s.gain.informative
                   && s.gain.plain_total > 0;
    stale = false;
}

void JointWork::refine(Found *f) const
{
    if (!f->family.refine)
        return;
    const bool line = f->family.id == "order_line";
    const auto llr = [&](double x) { return gls_fit(gram(f->family, {x, f->at.kind}), all_runs(fit.size())).llr; };
    // orders are spaced evenly, all else by ratio
    const double span = line ? scan.grid.step : std::log(2.0);
    const auto at = [&](double s) { return line ? f->at.x + s : f->at.x * std::exp(s); };
    double lo = -span, hi = span;
    constexpr double golden = 0.6180339887498949;
    double a = hi - golden * (hi - lo), b = lo + golden * (hi - lo), fa = llr(at(a)), fb = llr(at(b));
    for (int i = 0; i < 24; ++i) {
        if (fa > fb) {
            hi = b;
            b = a;
            fb = fa;
            a = hi - golden * (hi - lo);
            fa = llr(at(a));
        } else {
            lo = a;
            a = b;
            fa = fb;
            b = lo + golden * (hi - lo);
            fb = llr(at(b));
        }
    }
    const double x = at(0.5 * (lo + hi)), best = llr(x);
    const double step = 0.02 * (line ? scan.grid.step : x);
    const double curve = (llr(x + step) - 2 * best + llr(x - step)) / (step * step);
    f->x_sigma = curve < 0 ? 1 / std::sqrt(-curve) : std::abs(line ? scan.grid.step : x);
    f->at.x = x;
    // a line of the gear is locked to the wave generator
    const double locked = std::round(x / arm_joint_.ratio) * arm_joint_.ratio;
    if (line && locked > 0 && std::abs(locked - x) < std::max(3 * f->x_sigma, 0.02 * scan.grid.step)
        && llr(locked) > best - kTie_nats)
        f->at.x = locked;
}

double reducible_rms(const std::vector<BlockRows> &rows, const std::function<VectorXd(const BlockRows &)> &torque_nm)
{
    MatrixXd nn = MatrixXd::Zero(4, 4);
    VectorXd nx = VectorXd::Zero(4);
    double xx = 0, count = 0;
    for (const BlockRows &b : rows) {
        const MatrixXd n = nuisance_columns(b);
        const VectorXd x = torque_nm(b);
        nn += n.transpose() * n;
        nx += n.transpose() * x;
        xx += x.squaredNorm();
        count += static_cast<double>(x.size());
    }
    nn.diagonal().array() += 1e-9 * nn.diagonal().maxCoeff() + 1e-12;
    return std::sqrt(std::max(0.0, xx - nx.dot(nn.llt().solve(nx))) / std::max(count, 1.0));
}

double left_out_rms(const Gram &g, Index first, Index ignored, Index count)
{
    const Index n = g.nuisances + g.columns, free = n - first;
    double sum = 0, rows = 0;
    for (std::size_t r = 0; r < g.weighted.size(); ++r) {
        RunSet use(g.weighted.size(), 1);
        use[r] = 0;
        MatrixXd w = MatrixXd::Zero(n + 1, n + 1);
        for (std::size_t s = 0; s < use.size(); ++s)
            if (use[s])
                w += g.weighted[s];
        w.block(g.nuisances, g.nuisances, g.columns, g.columns) += g.prior;
        MatrixXd a = w.block(first, first, free, free);
        if (free > 0)
            a.diagonal().array() += 1e-9 * a.diagonal().maxCoeff() + 1e-12;
        VectorXd coef = VectorXd::Zero(n + 1);
        coef.segment(first, free) = -a.llt().solve(w.col(n).segment(first, free));
        coef[n] = 1;
        coef.segment(ignored, count).setZero();
        sum += coef.dot(g.plain[r] * coef);
        rows += static_cast<double>(g.rows[r]);
    }
    return std::sqrt(std::max(0.0, sum) / std::max(rows, 1.0));
}

namespace {

bool tied(double gain, double best)
{
    return gain >= kTieShare * best || gain >= best - kTie_nats;
}

// Two names that only together reach what an axis explains.
std::optional<std::pair<std::size_t, std::size_t>> pair_for(const JointWork &w, double wanted)
{
    std::vector<const Score *> named;
    for (const Score &s : w.scores)
        if (w.families[s.family].named() && !w.families[s.family].chain && s.excited && s.plausible && s.llr > kTie_nats)
            named.push_back(&s);
    std::stable_sort(named.begin(), named.end(), [](const Score *a, const Score *b) { return a->gain.total > b->gain.total; });
    std::optional<std::pair<std::size_t, std::size_t>> out;
    double best = wanted;
    for (std::size_t i = 0; i < std::min<std::size_t>(named.size(), 3); ++i) {
        for (std::size_t k = i + 1; k < named.size(); ++k) {
            const Score &a = *named[i], &b = *named[k];
            std::vector<MatrixXd> x;
            for (const BlockRows &rows : w.fit) {
                const MatrixXd xa = w.families[a.family].columns(rows, a.at), xb = w.families[b.family].columns(rows, b.at);
                MatrixXd both(xa.rows(), xa.cols() + xb.cols());
                both << xa, xb;
                x.push_back(std::move(both));
            }
            const Gram g = w.evidence().gram(x);
            const double total = leave_one_run_out({&g})[0].total;
            if (total > best && total > a.gain.total + 3 * kTie_nats && total > b.gain.total + 3 * kTie_nats) {
                best = total;
                out = {a.family, b.family};
            }
        }
    }
    return out;
}

} // namespace

Choice choose(const JointWork &w)
{
    Choice c;
    const Score *name = nullptr, *axis = nullptr;
    for (const Score &s : w.scores) {
        const Family &f = w.families[s.family];
        if (!s.passes || f.chain)
            continue;
        const Score *&best = f.named() ? name : axis;
        if (!best || s.gain.total > best->gain.total)
            best = &s;
    }
    const double wanted = axis ? axis->gain.total : 0;
    if (name && name->gain.total >= kAdequate * wanted) {
        // the list is in order of preference: the first among equals is named, all are printed
        for (const Score &s : w.scores) {
            const Family &f = w.families[s.family];
            if (!f.named() || !s.excited || !s.plausible || !tied(s.gain.total, name->gain.total))
                continue;
            if (c.families.empty() && s.passes && !f.chain)
                c.families.push_back(s.family);
            else
                c.ambiguous.push_back(f.id);
        }
        return c;
    }
    if (axis) {
        if (const auto both = pair_for(w, 0.97 * wanted)) {
            c.families = {both->first, both->second};
            return c;
        }
        c.unnamed = true;
        c.families.push_back(axis->family);
    }
    return c;
}

namespace {

// Gains of the best other explanation of a joint, and which names tie with the chain's.
double rival(const JointWork &w, const std::string &id, double gain, std::vector<std::string> *ambiguous)
{
    double best = 0;
    for (const Score &s : w.scores) {
        const Family &f = w.families[s.family];
        if (f.id == id || !s.excited)
            continue;
        if (s.passes)
            best = std::max(best, s.gain.total);
        if (f.named() && s.plausible && s.gain.total > 0 && tied(s.gain.total, gain))
            ambiguous->push_back(f.id);
    }
    return best;
}

// Shared numbers of a chain effect at one point of its grid.
struct ChainFit { VectorXd theta; MatrixXd covariance; double llr = 0; std::vector<Gram> grams; };

std::vector<const Gram *> pointers(const std::vector<Gram> &g)
{
    std::vector<const Gram *> out;
    for (const Gram &one : g)
        out.push_back(&one);
    return out;
}

ChainFit fit_chain(std::vector<Gram> grams)
{
    ChainFit f;
    const std::size_t runs = grams[0].weighted.size();
    MatrixXd a = grams[0].prior;
    VectorXd b = VectorXd::Zero(grams[0].columns);
    for (const Gram &g : grams) {
        const Projected p = project(g, all_runs(runs));
        a += p.a;
        b += p.b;
    }
    a.diagonal().array() += 1e-12;
    const Eigen::LLT<MatrixXd> fac(a);
    f.theta = fac.solve(b);
    f.llr = 0.5 * f.theta.dot(b);
    f.covariance = fac.solve(MatrixXd::Identity(a.rows(), a.cols()));
    // variance from the scatter of the runs where that is larger
    MatrixXd meat = MatrixXd::Zero(a.rows(), a.cols());
    for (std::size_t r = 0; r < runs; ++r) {
        RunSet only(runs, 0);
        only[r] = 1;
        VectorXd s = VectorXd::Zero(a.rows());
        for (const Gram &g : grams) {
            const Projected p = project(g, only);
            s += p.b - p.a * f.theta;
        }
        meat += s * s.transpose();
    }
    const VectorXd robust = (f.covariance * meat * f.covariance).diagonal();
    const VectorXd grow = (robust.array() / f.covariance.diagonal().array()).max(1.0).sqrt();
    f.covariance = grow.asDiagonal() * f.covariance * grow.asDiagonal();
    f.grams = std::move(grams);
    return f;
}

// Does it stand against what each joint would say alone?
void judge_chain(const std::vector<std::unique_ptr<JointWork>> &joints, const Gates &gates, ChainScore *c)
{
    double mine = 0, others = 0, plain = 0;
    int better = 0, large = 0;
    bool simpler_ties = false;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        const JointWork &w = *joints[j];
        c->ambiguous.emplace_back();
        const double r = rival(w, c->id, c->gain[j].total, &c->ambiguous.back());
        if (c->rms_nm[j] < 0.5 * w.gate_nm) {
            c->ambiguous.back().clear();
            continue;
        }
        large += c->rms_nm[j] >= std::max(w.gate_nm, w.remnant_nm);
        for (const Score &s : w.scores)
            simpler_ties = simpler_ties || (s.passes && w.families[s.family].named() && !w.families[s.family].chain
                                            && tied(s.gain.total, c->gain[j].total)
                                            && w.families[s.family].columns(w.fit[0], s.at).cols() < c->theta.size());
        mine += c->gain[j].total;
        plain += c->gain[j].plain_total;
        others += r;
        better = std::max(better, c->gain[j].better);
    }
    c->passes = large > 0 && c->p_adjusted <= gates.alpha && better >= gates.min_runs && plain > 0 && mine > 0
                && mine >= kAdequate * others
                // one joint alone does not speak for a chain when fewer numbers say the same
                && !(large == 1 && simpler_ties);
}

} // namespace

ChainScore weigh_chain(const std::vector<std::unique_ptr<JointWork>> &joints, const std::string &id, const Gates &gates)
{
    ChainScore best;
    best.id = id;
    const auto family = [&](const JointWork &w) {
        return std::find_if(w.families.begin(), w.families.end(), [&](const Family &f) { return f.id == id; });
    };
    for (const auto &w : joints)
        if (family(*w) == w->families.end())
            return best;
    if (joints.empty())
        return best;
    const Family &first = *family(*joints[0]);
    const std::vector<RunSet> splits = balanced_splits(joints[0]->fit.size(), kSplits);
    std::vector<double> log_e;
    std::optional<ChainFit> kept;
    for (Point at : first.grid) {
        std::vector<Gram> g;
        for (const auto &w : joints)
            g.push_back(w->gram(*family(*w), at));
        log_e.push_back(split_log_e(pointers(g), splits));
        ChainFit f = fit_chain(std::move(g));
        if (first.plausible && !first.plausible(f.theta))
            continue;
        const double size = static_cast<double>(f.theta.size());
        if (!kept || f.llr - size > kept->llr - static_cast<double>(kept->theta.size())) {
            best.at = at;
            kept = std::move(f);
        }
    }
    best.log_e = log_mean_exp(log_e, static_cast<double>(first.grid.size()));
    // the chain stands once more beside each joint's own list
    const double tried = static_cast<double>(joints[0]->families.size() + 2);
    best.p_adjusted = std::exp(std::min(0.0, std::log(tried) - best.log_e));
    if (!kept)
        return best;
    best.theta = kept->theta;
    best.covariance = kept->covariance;
    best.gain = leave_one_run_out(pointers(kept->grams));
    for (const Gram &g : kept->grams)
        best.rms_nm.push_back(contribution_rms(g, kept->theta));
    judge_chain(joints, gates, &best);
    return best;
}

} // namespace hdt
