// SPDX-License-Identifier: Apache-2.0
//
// Owns: numbers and covariance of a joint's found effects, fitted together; which are too uncertain to keep.
// Never: reads held-out runs.
#include "model/diagnose_parts.hpp"

#include <algorithm>
#include <cmath>

namespace hdt::diag {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

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

namespace {

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

} // namespace

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

namespace {

// How many sigma an effect's numbers are from nothing, squared and per number.
double wald(const JointEstimate &e, std::size_t k)
{
    return e.theta[k].dot(e.covariance[k].ldlt().solve(e.theta[k])) / static_cast<double>(e.theta[k].size());
}

} // namespace

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

VectorXd effect_nm(const JointEstimate &e, const JointWork &w, std::size_t k, const BlockRows &b)
{
    const Found &f = w.found[k];
    return f.columns(b) * (f.chain_theta ? *f.chain_theta : e.theta[k]);
}

} // namespace hdt::diag
