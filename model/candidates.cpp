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
constexpr double kWander_s = 2; // about a move: what the model gets wrong lasts as long
constexpr std::size_t kSplits = 16, kPeaks = 5, kPlainPeaks = 3;
constexpr double kHighestOrder = 600, kMotorOrders = 20;
constexpr double kLoose = 5;
constexpr double kStrongPower = 40;  // mean over runs; 2 is noise
constexpr double kTie_nats = 5, kTieShare = 0.995, kAdequate = 0.9;
// ripple read at an angle off by this has lines as far beside its own, times its order
constexpr double kSideband_rad = 0.05;
constexpr double kSetShare = 0.9;    // of the best one's evidence: printed as what it may be too

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

// The Gram without some of its nuisances.
Gram without(const Gram &g, Index first, Index count)
{
    const Index n = g.nuisances + g.columns + 1, rest = n - first - count;
    Gram out = g;
    out.nuisances -= count;
    for (auto *list : {&out.weighted, &out.plain})
        for (MatrixXd &m : *list) {
            MatrixXd less(n - count, n - count);
            less << m.topLeftCorner(first, first), m.topRightCorner(first, rest),
                m.bottomLeftCorner(rest, first), m.bottomRightCorner(rest, rest);
            m = std::move(less);
        }
    return out;
}

} // namespace

// What the model file has no term for has to show more to be worth a name, and most of all what healthy
// joints show some of: friction bent a little otherwise over speed
// than its curve, a hum, curves over some axis.
double gate_factor(const Family &f, const Gates &gates)
{
    const bool healthy = f.id == "viscous_nonlinear" || f.own_phase || f.twin || !f.named();
    return f.adoptable() ? 1 : healthy ? gates.healthy_share : gates.loose_share;
}

JointWork::JointWork(const hdt_arm &arm, int j, std::vector<BlockRows> fit_rows,
                     std::vector<BlockRows> test_rows)
    : joint(j), fit(std::move(fit_rows)), test(std::move(test_rows)), arm_joint_(arm.joint[j]),
      min_rms_nm_(0.0005 * arm.joint[j].ratio) // half a digit of motor torque: rounding would lose less
{
    for (std::size_t r = 0; r < fit.size(); ++r)
        fit[r].index = static_cast<Index>(r);
    families = effect_families(arm, j, fit);
    listed_ = families.size();
}

VectorXd JointWork::target(const BlockRows &b) const
{
    VectorXd y = b.y_nm;
    for (const Found &f : found)
        if (f.chain_theta)
            y -= f.columns(b) * *f.chain_theta;
    return y;
}

double JointWork::highest_order() const
{
    return std::max(kHighestOrder, kMotorOrders * arm_joint_.ratio);
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

std::vector<VectorXd> JointWork::residual(const Found &axis) const
{
    const bool with_axis = !axis.family.id.empty();
    const Gram g = with_axis ? gram(axis.family, axis.at) : evidence_->gram({});
    const GlsFit f = gls_fit(g, all_runs(fit.size()));
    std::vector<VectorXd> out;
    for (std::size_t r = 0; r < fit.size(); ++r) {
        const RunRows &rows = evidence_->rows()[r];
        out.push_back(rows.y - rows.fixed * f.nuisance);
        if (with_axis)
            out.back() -= axis.columns(fit[r]) * f.theta;
    }
    return out;
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
            const bool smooth = (!f.named() && own) || f.id == "payload" || f.id == "inertia"
                                || f.id == "torque_gain" || f.id == "base_tilt" || f.id == "viscous_nonlinear"
                                || f.id == "load_friction";
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

namespace {

// What ordinary least squares leaves.
std::vector<VectorXd> plain_residual(const std::vector<RunRows> &rows, const std::vector<MatrixXd> &rich)
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
    std::vector<VectorXd> e;
    for (std::size_t r = 0; r < rows.size(); ++r)
        e.push_back(rows[r].y - x[r] * beta);
    return e;
}

NoiseModel white_noise(double sigma_nm)
{
    NoiseModel n;
    n.predictor = {VectorXd(0)};
    n.innovation_nm = {sigma_nm};
    return n;
}

// Frequencies that stand out of a plain residual so far that they would pass for coloured noise.
std::vector<double> plain_frequencies(const BlockNumbers &blocks, std::vector<VectorXd> residual,
                                      double block_s)
{
    double sum = 1e-12, rows = 1e-12;
    for (const VectorXd &e : residual) {
        sum += e.squaredNorm();
        rows += static_cast<double>(e.size());
    }
    for (VectorXd &e : residual)
        e *= rows / sum;
    const TimeScan scan = scan_times(blocks, residual, white_noise(std::sqrt(sum / rows)),
                                     time_grid(blocks, block_s));
    std::vector<double> out;
    for (std::size_t k : time_peaks(scan, 2)) {
        double power = 0;
        for (const auto &run : scan.power)
            power += run[k] / static_cast<double>(scan.power.size());
        if (power > kStrongPower)
            out.push_back(scan.grid.hz(k));
    }
    return out;
}

} // namespace

// The strongest lines of an ordinary least-squares residual.
std::vector<LineHit> JointWork::plain_lines(const std::vector<VectorXd> &residual,
                                            const OrderGrid &grid) const
{
    return scan_peaks(scan_orders(scan_rows(fit), residual, white_noise(1), grid), kPlainPeaks);
}

BlockNumbers JointWork::block_numbers() const
{
    BlockNumbers out;
    for (const BlockRows &b : fit)
        out.push_back(b.block);
    return out;
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
        if (f.twin) {
            // beside its bounded twin the contribution would read as nothing, and what the twin
            // takes over beyond its bounds as explained
            const Gram alone = without(kept, kFriction, imperfection_columns());
            s.gain.total = std::max(s.gain.total, leave_one_run_out({&alone})[0].total);
            s.gain.informative = s.gain.better = 0;
            for (std::size_t r = 0; r < fit.size(); ++r)
                if (fit[r].size() > 0) {
                    ++s.gain.informative;
                    s.gain.better += s.gain.log_likelihood[r] > 0;
                }
            const VectorXd theta = gls_fit(kept, all_runs(fit.size())).theta;
            s.rms_nm = reducible_rms(fit, [&](const BlockRows &b) -> VectorXd {
                return f.columns(b, s.at) * theta;
            });
        }
        if (f.id == "inertia")
            put_whole_inertia(kept, &s);
    } else {
        s.note = "not excited by these runs";
    }
    if (s.excited && !s.plausible)
        s.note = "estimate has the wrong sign or size for this effect";
    scores[index] = std::move(s);
}

// What inertia is worth: estimated on the reference's acceleration, it acts on vibration
// too, which is then no healthy imperfection.
void JointWork::put_whole_inertia(const Gram &on_reference, Score *s) const
{
    std::vector<MatrixXd> x;
    for (const BlockRows &b : fit)
        x.push_back(b.a + b.vibration);
    const Gram whole = without(evidence_->gram(x), kFriction, 1);
    const RunGain gain = leave_one_run_out({&whole})[0];
    if (gain.plain_total <= s->gain.plain_total)
        return;
    s->gain.plain = gain.plain;
    s->gain.plain_total = gain.plain_total;
    s->rms_nm = contribution_rms(whole, gls_fit(on_reference, all_runs(fit.size())).theta);
}

// Power of a line of fixed frequency: each run has its own phase, so only the power can repeat.
void JointWork::weigh_vibration(std::size_t index, const std::vector<RunSet> &splits)
{
    const Family &f = families[index];
    Score s;
    s.family = index;
    std::vector<double> log_e;
    double best = -1;
    for (Point at : f.grid) {
        const auto k = static_cast<std::size_t>(std::lround(at.x / times.grid.step_hz())) - times.grid.first;
        log_e.push_back(time_log_e(times, k, splits));
        double llr = 0;
        for (const auto &run : times.power)
            llr += 0.5 * run[k];
        if (llr <= best)
            continue;
        best = llr;
        s.at = at;
        s.llr = llr;
        s.excited = true;
        s.rms_nm = std::sqrt(time_variance(times, all_runs(fit.size()), k));
        s.gain = {};
        for (std::size_t r = 0; r < fit.size(); ++r) {
            RunSet others = all_runs(fit.size());
            others[r] = 0;
            const double rows = static_cast<double>(fit[r].size());
            const double square = 0.5 * (times.power[r][k] - 2) / times.information[r][k];
            s.gain.log_likelihood.push_back(time_log_ratio(times, r, k, time_variance(times, others, k)));
            s.gain.plain.push_back(rows * square);
            s.gain.contribution.push_back(square);
            s.gain.total += s.gain.log_likelihood.back();
            s.gain.plain_total += s.gain.plain.back();
            s.gain.rows += rows;
            s.gain.informative += rows > 0;
            s.gain.better += s.gain.log_likelihood.back() > 0;
        }
    }
    if (s.excited)
        s.log_e = log_mean_exp(log_e, f.grid_count);
    else
        s.note = "not excited by these runs";
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
        Index at = kFriction + imperfection_columns();
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

std::vector<RunRows> JointWork::run_rows() const
{
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
        r.prior.segment(kFriction, sigma.size()) = sigma.cwiseAbs2().cwiseInverse();
        r.lags = unbroken(b.block);
        set_random_effects(r, b.t_s, b.dir, b.v, kWander_s);
        rows.push_back(std::move(r));
    }
    return rows;
}

// Families whose place has to be searched for first, from the score.
void JointWork::search(const std::vector<LineHit> &lines)
{
    std::vector<MatrixXd> turned;
    for (const BlockRows &b : fit)
        turned.push_back(turned_columns(arm_joint_, b));
    // what turns the ripple by more than wind-up does is not to be taken over by wind-up's columns
    const Gram g = without(evidence_->gram(turned), kFriction, imperfection_columns());
    const Projected p = project(g, all_runs(fit.size()));
    families.push_back(offset_family(arm_joint_, joint, p.a, p.b));
    const std::vector<VectorXd> score = evidence_->score();
    families.push_back(local_family(joint, fit, score));
    families.push_back(windup_family(fit, score));
    times = scan_times(block_numbers(), score, evidence_->noise(),
                       time_grid(block_numbers(), fit[0].block_s));
    std::vector<double> hz;
    for (std::size_t k : time_peaks(times, kPeaks))
        hz.push_back(times.grid.hz(k));
    families.push_back(vibration_family(hz, static_cast<double>(times.grid.count()), fit.size(),
                                        times.grid.step_hz()));
    std::vector<LineHit> hits = lines;
    for (const LineHit &h : scan_peaks(scan, kPeaks)) {
        const auto same = [&](const LineHit &k) { return k.order == h.order && k.directed == h.directed; };
        if (std::none_of(hits.begin(), hits.end(), same))
            hits.push_back(h);
    }
    families.push_back(line_family(joint, hits, 2 * static_cast<double>(scan.grid.count()), scan.grid.step));
}

void JointWork::assess(const Gates &gates)
{
    families.erase(families.begin() + static_cast<std::ptrdiff_t>(listed_), families.end());
    std::vector<RunRows> rows = run_rows();
    const std::vector<ScanRows> sr = scan_rows(fit);
    const OrderGrid grid = order_grid(sr, highest_order());
    std::vector<MatrixXd> rich = rich_columns();
    // a line moves through the spectrum with speed: left in, it would pass for coloured noise
    const std::vector<VectorXd> residual = plain_residual(rows, rich);
    std::vector<LineHit> hits = plain_lines(residual, grid);
    for (const LineHit &h : hits)
        for (double side : {-0.25, 0.25})
            for (std::size_t r = 0; r < fit.size(); ++r) {
                rich[r].conservativeResize(Eigen::NoChange, rich[r].cols() + 2);
                rich[r].rightCols(2) = line_columns(sr[r], h.order + side * grid.step, h.directed);
            }
    const std::vector<double> hums = plain_frequencies(block_numbers(), residual, fit[0].block_s);
    const Family hum = vibration_family(hums, 1, fit.size(), 0);
    for (double hz : hums)
        for (std::size_t r = 0; r < fit.size(); ++r) {
            const MatrixXd x = hum.columns(fit[r], {hz, 0});
            rich[r].conservativeResize(Eigen::NoChange, rich[r].cols() + x.cols());
            rich[r].rightCols(x.cols()) = x;
        }
    NoiseModel noise = fit_noise(rows, rich, kArOrder);
    evidence_ = std::make_unique<Evidence>(std::move(rows), std::move(noise));
    scan = scan_orders(sr, evidence_->score(), evidence_->noise(), grid);
    search(hits);

    const std::vector<RunSet> splits = balanced_splits(fit.size(), kSplits);
    scores.assign(families.size(), {});
    std::vector<double> log_e;
    for (std::size_t k = 0; k < families.size(); ++k) {
        families[k].own_phase ? weigh_vibration(k, splits) : weigh(k, splits);
        log_e.push_back(scores[k].log_e);
    }
    const std::vector<double> p = ebh_adjusted(log_e);
    // the floor: what the best model found, named or not, leaves on a run it was not fitted on;
    // healthy imperfections are part of it, for no model has a term for them, but vibration once
    // inertia is found
    const auto is_inertia = [](const Found &f) { return f.family.id == "inertia"; };
    const Index explained = std::any_of(found.begin(), found.end(), is_inertia) ? 1 : 0;
    const double base = left_out_rms(evidence_->gram({}), 0, kFriction + explained,
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
    // what is worth a name takes as much off a run left out as an effect of that size would
    const double worth_nm2 = gate_nm * gate_nm;
    for (Score &s : scores)
        s.passes = s.excited && s.plausible && s.p_adjusted <= gates.alpha
                   && s.rms_nm >= gate_nm * gate_factor(families[s.family], gates)
                   && s.rms_nm >= remnant_nm
                   && s.gain.better >= gates.min_runs && 3 * s.gain.better >= 2 * s.gain.informative
                   && s.gain.plain_total >= (families[s.family].twin ? 0 : worth_nm2 * s.gain.rows);
    stale = false;
}

void JointWork::refine(Found *f) const
{
    if (!f->family.refine)
        return;
    const bool line = f->family.id == "order_line";
    const auto llr = [&](double x) {
        return gls_fit(gram(f->family, {x, f->at.kind}), all_runs(fit.size())).llr;
    };
    // places and orders are spaced evenly, all else by ratio
    const bool even = f->family.step > 0;
    const double span = even ? f->family.step : std::log(2.0);
    const auto at = [&](double s) { return even ? f->at.x + s : f->at.x * std::exp(s); };
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
    const double step = 0.02 * (even ? f->family.step : x);
    const double curve = (llr(x + step) - 2 * best + llr(x - step)) / (step * step);
    f->x_sigma = curve < 0 ? 1 / std::sqrt(-curve) : std::abs(even ? f->family.step : x);
    // a run less moves the best place: seen on a few points around it, by the parabola through the best
    constexpr int side = 6;
    const double reach = std::min(even ? f->family.step : 0.3 * x,
                                  std::max(2 * f->x_sigma, 0.02 * (even ? f->family.step : x)));
    std::vector<Gram> near;
    for (int i = -side; i <= side; ++i)
        near.push_back(gram(f->family, {x + reach * i / side, f->at.kind}));
    MatrixXd left_out(1, static_cast<Index>(fit.size()));
    for (std::size_t r = 0; r < fit.size(); ++r) {
        RunSet use = all_runs(fit.size());
        use[r] = 0;
        std::vector<double> value;
        for (const Gram &g : near)
            value.push_back(gls_fit(g, use).llr);
        const std::size_t top = static_cast<std::size_t>(std::max_element(value.begin(), value.end())
                                                         - value.begin());
        double at_top = static_cast<double>(top);
        if (top > 0 && top + 1 < value.size()) {
            const double bend = value[top - 1] - 2 * value[top] + value[top + 1];
            at_top += bend < 0 ? 0.5 * (value[top - 1] - value[top + 1]) / bend : 0;
        }
        left_out(0, static_cast<Index>(r)) = x + reach * (at_top - side) / side;
    }
    if (fit.size() > 1 && !f->family.own_phase)
        f->x_sigma = std::max(f->x_sigma, std::sqrt(jackknife_variance(left_out)[0]));
    f->at.x = x;
    // a line of the gear is locked to the wave generator
    const double locked = std::round(x / arm_joint_.ratio) * arm_joint_.ratio;
    if (line && locked > 0 && std::abs(locked - x) < std::max(3 * f->x_sigma, 0.02 * scan.grid.step)
        && llr(locked) > best - kTie_nats)
        f->at.x = locked;
}

std::optional<Score> JointWork::weigh_offset(const Gates &gates) const
{
    const auto springs = [](const Found &f) { return f.family.id == "cable_spring"; };
    if (std::any_of(found.begin(), found.end(), springs))
        return {}; // whose rest is the same column
    Gram g = evidence_->gram({});
    const Index n = g.nuisances + 1;
    // columns 0 and 1 become their sum, friction of both directions; their difference is the constant
    MatrixXd turn = MatrixXd::Zero(n, n);
    turn(0, 0) = turn(1, 0) = 1;
    turn.block(2, 1, n - 3, n - 3).setIdentity();
    turn(0, n - 2) = 1;
    turn(1, n - 2) = -1;
    turn(n - 1, n - 1) = 1;
    for (auto *list : {&g.weighted, &g.plain})
        for (MatrixXd &m : *list)
            m = (turn.transpose() * m * turn).eval();
    g.nuisances -= 1;
    g.columns = 1;
    const double scale = 10 * std::max(evidence_->rms_nm(), 1e-9);
    g.prior = MatrixXd::Constant(1, 1, 1 / (scale * scale));
    Score s;
    s.excited = true;
    s.log_e = split_log_e({&g}, balanced_splits(fit.size(), kSplits));
    s.p_adjusted = std::exp(std::min(0.0, std::log(static_cast<double>(families.size() + 1)) - s.log_e));
    s.gain = leave_one_run_out({&g})[0];
    s.rms_nm = std::abs(gls_fit(g, all_runs(fit.size())).theta[0]);
    // declared friction may be off by what its file says
    const double declared = 1.5 * std::hypot(f0_sigma_nm[0], f0_sigma_nm[1]);
    s.passes = s.p_adjusted <= gates.alpha
               && s.rms_nm >= std::max({gates.healthy_share * gate_nm, remnant_nm, declared})
               && s.gain.better >= gates.min_runs && 3 * s.gain.better >= 2 * s.gain.informative
               && s.gain.plain_total > 0;
    return s;
}

double reducible_rms(const std::vector<BlockRows> &rows,
                     const std::function<VectorXd(const BlockRows &)> &torque_nm)
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
    return std::sqrt(std::max(0.0, xx - nx.dot(ridged(nn).llt().solve(nx))) / std::max(count, 1.0));
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
        VectorXd coef = VectorXd::Zero(n + 1);
        coef.segment(first, free) =
            -ridged(w.block(first, first, free, free)).llt().solve(w.col(n).segment(first, free));
        coef[n] = 1;
        coef.segment(ignored, count).setZero();
        sum += coef.dot(g.plain[r] * coef);
        rows += static_cast<double>(g.rows[r]);
    }
    return std::sqrt(std::max(0.0, sum) / std::max(rows, 1.0));
}

namespace {

bool tied(double gain, double best, double share = kTieShare)
{
    return gain >= share * best || gain >= best - kTie_nats;
}

// Two names that only together reach what an axis explains.
std::optional<std::pair<std::size_t, std::size_t>> pair_for(const JointWork &w, double wanted)
{
    std::vector<const Score *> named;
    for (const Score &s : w.scores)
        if (w.families[s.family].named() && !w.families[s.family].chain && s.excited && s.plausible
            && s.llr > kTie_nats)
            named.push_back(&s);
    std::stable_sort(named.begin(), named.end(),
                     [](const Score *a, const Score *b) { return a->gain.total > b->gain.total; });
    std::optional<std::pair<std::size_t, std::size_t>> out;
    double best = 0.95 * wanted;
    for (std::size_t i = 0; i < std::min<std::size_t>(named.size(), 3); ++i) {
        for (std::size_t k = i + 1; k < named.size(); ++k) {
            const Score &a = *named[i], &b = *named[k];
            std::vector<MatrixXd> x;
            for (const BlockRows &rows : w.fit) {
                const MatrixXd xa = w.families[a.family].columns(rows, a.at);
                const MatrixXd xb = w.families[b.family].columns(rows, b.at);
                MatrixXd both(xa.rows(), xa.cols() + xb.cols());
                both << xa, xb;
                x.push_back(std::move(both));
            }
            const Gram g = w.evidence().gram(x);
            const double total = leave_one_run_out({&g})[0].total;
            // what the model can take is worth more than a little more evidence it cannot use
            const bool taken = w.families[a.family].adoptable() && w.families[b.family].adoptable();
            const double worth = taken ? total : 0.95 * total;
            if (total > wanted && worth > best && total > a.gain.total + 3 * kTie_nats
                && total > b.gain.total + 3 * kTie_nats) {
                best = worth;
                out = {a.family, b.family};
            }
        }
    }
    return out;
}

} // namespace

bool JointWork::beside_ripple(double order) const
{
    return std::any_of(arm_joint_.ripple, arm_joint_.ripple + arm_joint_.ripples, [&](const hdt_arm_line &r) {
        return std::abs(r.order_rev - order) <= kSideband_rad * r.order_rev;
    });
}

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
            if (!f.named() || !s.excited || !s.plausible || !tied(s.gain.total, name->gain.total, kSetShare))
                continue;
            if (c.families.empty() && s.passes && !f.chain && tied(s.gain.total, name->gain.total))
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
        if (f.named() && s.plausible && s.gain.total > 0 && tied(s.gain.total, gain, kSetShare))
            ambiguous->push_back(f.id);
    }
    return best;
}

std::vector<const Gram *> pointers(const std::vector<Gram> &g)
{
    std::vector<const Gram *> out;
    for (const Gram &one : g)
        out.push_back(&one);
    return out;
}

// Normal equations of one set of numbers over some runs of all joints, each joint by how far it is trusted.
struct ChainProducts { MatrixXd a; VectorXd b; };

ChainProducts sum_of(const std::vector<Projected> &joints, const std::vector<double> &trust)
{
    ChainProducts out{MatrixXd::Zero(joints[0].a.rows(), joints[0].a.cols()),
                      VectorXd::Zero(joints[0].b.size())};
    for (std::size_t j = 0; j < joints.size(); ++j) {
        out.a += trust[j] * joints[j].a;
        out.b += trust[j] * joints[j].b;
    }
    return out;
}

std::vector<Projected> projections(const std::vector<Gram> &grams, const RunSet &use)
{
    std::vector<Projected> out;
    for (const Gram &g : grams)
        out.push_back(project(g, use));
    return out;
}

VectorXd solved(const ChainProducts &p, const MatrixXd &prior)
{
    return ridged(p.a + prior).llt().solve(p.b);
}

// Shared numbers of a chain effect at one point of its grid.
struct ChainFit { VectorXd theta; double llr = 0; std::vector<Gram> grams; std::vector<double> trust; };

ChainFit fit_chain(std::vector<Gram> grams)
{
    ChainFit f;
    f.trust.assign(grams.size(), 1);
    const ChainProducts p = sum_of(projections(grams, all_runs(grams[0].weighted.size())), f.trust);
    f.theta = solved(p, grams[0].prior);
    f.llr = 0.5 * f.theta.dot(p.b);
    f.grams = std::move(grams);
    return f;
}

// Its numbers once more, each joint trusted by how well what it says alone agrees with what all say.  A
// wrist's noise is small, and what else a payload does there (wind-up, loss) would decide for the whole arm.
void trust_by_agreement(ChainFit *f)
{
    constexpr int rounds = 8;
    const MatrixXd &prior = f->grams[0].prior;
    const std::vector<Projected> joints = projections(f->grams, all_runs(f->grams[0].weighted.size()));
    const double numbers = static_cast<double>(f->theta.size());
    for (int round = 0; round < rounds; ++round) {
        for (std::size_t j = 0; j < joints.size(); ++j) {
            const VectorXd apart = solved({joints[j].a, joints[j].b}, f->grams[j].prior) - f->theta;
            f->trust[j] = std::min(1.0, numbers / std::max(apart.dot(joints[j].a * apart), 1e-12));
        }
        f->theta = solved(sum_of(joints, f->trust), prior);
    }
}

// Of the numbers, no less than what the runs scatter, one by one and left out.
MatrixXd chain_covariance(const ChainFit &f)
{
    const std::size_t runs = f.grams[0].weighted.size();
    const Index n = f.theta.size();
    const MatrixXd &prior = f.grams[0].prior;
    const ChainProducts all = sum_of(projections(f.grams, all_runs(runs)), f.trust);
    MatrixXd covariance = ridged(all.a + prior).llt().solve(MatrixXd::Identity(n, n));
    MatrixXd meat = MatrixXd::Zero(n, n), left_out(n, static_cast<Index>(runs));
    for (std::size_t r = 0; r < runs; ++r) {
        RunSet only(runs, 0), others(runs, 1);
        only[r] = 1;
        others[r] = 0;
        const ChainProducts one = sum_of(projections(f.grams, only), f.trust);
        const VectorXd s = one.b - one.a * f.theta;
        meat += s * s.transpose();
        left_out.col(static_cast<Index>(r)) = solved(sum_of(projections(f.grams, others), f.trust), prior);
    }
    VectorXd variance = (covariance * meat * covariance).diagonal();
    if (runs > 1)
        variance = variance.cwiseMax(jackknife_variance(left_out));
    const VectorXd grow = (variance.array() / covariance.diagonal().array()).max(1.0).sqrt();
    return grow.asDiagonal() * covariance * grow.asDiagonal();
}

// Does it stand against what each joint would say alone?
void judge_chain(const std::vector<std::unique_ptr<JointWork>> &joints, const Gates &gates, ChainScore *c)
{
    double mine = 0, others = 0, plain = 0;
    int better = 0, large = 0;
    // a load winds up a wrist; a tilt or a link's mass is what it is on every joint
    const bool rigid = c->id != "payload";
    bool simpler_ties = false, denied = false;
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
            simpler_ties = simpler_ties
                           || (s.passes && w.families[s.family].named() && !w.families[s.family].chain
                               && tied(s.gain.total, c->gain[j].total)
                               && w.families[s.family].columns(w.fit[0], s.at).cols()
                                      < std::max<Index>(c->theta.size(), 2));
        denied = denied || (rigid && c->rms_nm[j] >= w.gate_nm && c->gain[j].total < 0);
        mine += c->gain[j].total;
        plain += c->gain[j].plain_total;
        others += r;
        better = std::max(better, c->gain[j].better);
    }
    // a mass, or a tilt, that is not three sigma from nothing is none
    const double sure = std::abs(c->theta[0]) / std::sqrt(std::max(c->covariance(0, 0), 1e-300));
    const double wald = c->theta.dot(c->covariance.ldlt().solve(c->theta))
                        / static_cast<double>(c->theta.size());
    c->passes = large > 0 && !denied && (rigid ? wald >= 9 : sure >= 3)
                && c->p_adjusted <= gates.alpha && better >= gates.min_runs && plain > 0 && mine > 0
                && mine >= (large == 1 && rigid ? kTieShare : kAdequate) * others
                // one joint alone does not speak for a chain when no more numbers say the same
                && !(large == 1 && simpler_ties);
    c->total = mine;
}

} // namespace

ChainScore weigh_chain(const std::vector<std::unique_ptr<JointWork>> &joints, const std::string &id,
                       const Gates &gates)
{
    ChainScore best;
    best.id = id;
    const auto family = [&](const JointWork &w) {
        return std::find_if(w.families.begin(), w.families.end(),
                            [&](const Family &f) { return f.id == id && f.chain; });
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
    trust_by_agreement(&*kept);
    best.theta = kept->theta;
    best.covariance = chain_covariance(*kept);
    best.gain = leave_one_run_out(pointers(kept->grams));
    for (const Gram &g : kept->grams)
        best.rms_nm.push_back(contribution_rms(g, kept->theta));
    judge_chain(joints, gates, &best);
    return best;
}

} // namespace hdt
