// SPDX-License-Identifier: Apache-2.0
//
// Owns: noise model, whitened Gram matrices, run-split e-values, e-BH (see evidence.hpp).
// Never: knows what a column means.
#include "model/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kRidge = 1e-9;          // of each diagonal
constexpr double kScatterMost = 2;
constexpr Index kWanderKnotsMax = 80;
// Share of white noise assumed beside whatever colour is found.  Lines that move with speed look
// predictable to an autoregression; without this bound, whitening would trade the slow part, which is
// what effects are made of, for the last digits of the fast part.
constexpr double kWhiteShare = 0.15;

// X'X, upper triangle.
MatrixXd squares(const MatrixXd &x)
{
    MatrixXd out = MatrixXd::Zero(x.cols(), x.cols());
    if (x.rows() > 0) // Eigen divides by the row count
        out.selfadjointView<Eigen::Upper>().rankUpdate(x.transpose());
    return out;
}

// Levinson-Durbin: every predictor from 0 to order lags.
void levinson(const VectorXd &acov, NoiseModel &n)
{
    const Index order = acov.size() - 1;
    VectorXd phi(0);
    double var = acov[0];
    n.predictor.assign(1, phi);
    n.innovation_nm.assign(1, std::sqrt(var));
    for (Index m = 1; m <= order; ++m) {
        double num = acov[m];
        for (Index i = 0; i < m - 1; ++i)
            num -= phi[i] * acov[m - 1 - i];
        const double k = num / var;
        VectorXd next(m);
        for (Index i = 0; i < m - 1; ++i)
            next[i] = phi[i] - k * phi[m - 2 - i];
        next[m - 1] = k;
        phi = next;
        var *= 1 - k * k;
        n.predictor.push_back(phi);
        n.innovation_nm.push_back(std::sqrt(var));
    }
    n.coloured_nm = std::sqrt(acov[0]);
}

// Autocovariance over unbroken stretches only.
VectorXd autocovariance(const std::vector<RunRows> &runs, const std::vector<VectorXd> &e, int order)
{
    VectorXd sum = VectorXd::Zero(order + 1);
    double count = 0;
    for (std::size_t r = 0; r < runs.size(); ++r) {
        for (Index t = 0; t < e[r].size(); ++t) {
            const int lags = std::min(order, runs[r].lags[static_cast<std::size_t>(t)]);
            for (int k = 0; k <= lags; ++k)
                sum[k] += e[r][t] * e[r][t - k];
        }
        count += static_cast<double>(e[r].size());
    }
    // by the number of rows, not of pairs: only so it is an autocovariance whatever the gaps (that of the
    // stretches between them, one beside the other), and no predictor grows wild
    VectorXd acov = sum / std::max(count, 1.0);
    acov[0] = std::max(acov[0], 1e-12) * (1 + kWhiteShare);
    return acov;
}

// Mixed-model equations in arrow form: fixed effects common, random effects per run.
struct Mixed {
    MatrixXd xx;
    VectorXd xy;
    double yy = 0, rows = 0;
    std::vector<MatrixXd> xz, zz;
    std::vector<VectorXd> zy;
};

Mixed mixed_products(const std::vector<RunRows> &runs, const std::vector<MatrixXd> &x, const NoiseModel &n)
{
    Mixed m;
    const Index p = x[0].cols();
    m.xx = MatrixXd::Zero(p, p);
    m.xy = VectorXd::Zero(p);
    for (std::size_t r = 0; r < runs.size(); ++r) {
        const MatrixXd xw = whiten(n, runs[r].lags, x[r]), zw = whiten(n, runs[r].lags, runs[r].random);
        const VectorXd yw = whiten(n, runs[r].lags, runs[r].y);
        if (xw.rows() > 0)
            m.xx.selfadjointView<Eigen::Lower>().rankUpdate(xw.transpose());
        m.xy += xw.transpose() * yw;
        m.yy += yw.squaredNorm();
        m.rows += static_cast<double>(yw.size());
        m.xz.push_back(xw.transpose() * zw);
        m.zz.push_back(zw.transpose() * zw);
        m.zy.push_back(zw.transpose() * yw);
    }
    m.xx.triangularView<Eigen::StrictlyUpper>() = m.xx.transpose();
    return m;
}

struct MixedSolution {
    VectorXd beta;
    std::vector<VectorXd> u;
    double s2 = 1;
};

// One step of expectation-maximisation on the group variances, residual variance scaled to one.
MixedSolution em_step(const Mixed &m, const std::vector<RunRows> &runs, const double *prior_nm2,
                      double prior_weight, double *variance)
{
    const Index p = m.xx.rows();
    std::vector<Eigen::LLT<MatrixXd>> zfac;
    std::vector<MatrixXd> dzx;
    MatrixXd s = m.xx;
    VectorXd b = m.xy;
    for (std::size_t r = 0; r < runs.size(); ++r) {
        MatrixXd d = m.zz[r];
        for (Index k = 0; k < d.rows(); ++k)
            d(k, k) += 1 / variance[runs[r].group[static_cast<std::size_t>(k)]];
        zfac.emplace_back(d);
        dzx.push_back(zfac[r].solve(m.xz[r].transpose()));
        s -= m.xz[r] * dzx[r];
        b -= dzx[r].transpose() * m.zy[r];
    }
    const Eigen::LLT<MatrixXd> sfac(ridged(s));
    MixedSolution out;
    out.beta = sfac.solve(b);
    const MatrixXd half = sfac.matrixL().solve(MatrixXd::Identity(p, p));
    double sum[RG_GROUPS] = {}, count[RG_GROUPS] = {}, fitted = m.xy.dot(out.beta);
    for (std::size_t r = 0; r < runs.size(); ++r) {
        out.u.push_back(zfac[r].solve(m.zy[r] - m.xz[r].transpose() * out.beta));
        fitted += m.zy[r].dot(out.u[r]);
        const VectorXd pev = zfac[r].solve(MatrixXd::Identity(m.zz[r].rows(), m.zz[r].rows())).diagonal()
                             + (half * dzx[r].transpose()).colwise().squaredNorm().transpose();
        for (Index k = 0; k < pev.size(); ++k) {
            const auto g = static_cast<std::size_t>(runs[r].group[static_cast<std::size_t>(k)]);
            sum[g] += out.u[r][k] * out.u[r][k] + pev[k];
            count[g] += 1;
        }
    }
    for (std::size_t g = 0; g < RG_GROUPS; ++g)
        if (count[g] > 0)
            variance[g] = (sum[g] + prior_weight * prior_nm2[g]) / (count[g] + prior_weight);
    out.s2 = std::max(1e-12, (m.yy - fitted) / std::max(1.0, m.rows - static_cast<double>(p)));
    return out;
}

std::vector<MatrixXd> joined_fixed(const std::vector<RunRows> &runs, const std::vector<MatrixXd> &rich)
{
    std::vector<MatrixXd> x;
    for (std::size_t r = 0; r < runs.size(); ++r) {
        const Index nf = runs[r].fixed.cols(), nr = rich.empty() ? 0 : rich[r].cols();
        MatrixXd m(runs[r].y.size(), nf + nr);
        m.leftCols(nf) = runs[r].fixed;
        if (nr > 0)
            m.rightCols(nr) = rich[r];
        x.push_back(std::move(m));
    }
    // unit scale, and columns nothing excites taken out
    const Index p = x[0].cols();
    VectorXd ss = VectorXd::Zero(p);
    double rows = 0;
    for (const MatrixXd &m : x) {
        ss += m.colwise().squaredNorm().transpose();
        rows += static_cast<double>(m.rows());
    }
    for (MatrixXd &m : x)
        for (Index c = 0; c < p; ++c)
            m.col(c) *= ss[c] > 0 ? std::sqrt(rows / ss[c]) : 0;
    return x;
}

} // namespace

MatrixXd ridged(MatrixXd a)
{
    a.diagonal() *= 1 + kRidge;
    a.diagonal().array() += 1e-300;
    return a;
}

void set_random_effects(RunRows &rows, const VectorXd &t_s, const VectorXd &dir, const VectorXd &v_radps,
                        double wander_s)
{
    const Index n = t_s.size();
    const double span = n > 0 ? t_s[n - 1] - t_s[0] : 0;
    const Index knots = std::clamp<Index>(1 + static_cast<Index>(std::ceil(span / wander_s)), 2,
                                          kWanderKnotsMax);
    const double step = std::max(span, 1e-9) / static_cast<double>(knots - 1);
    rows.random = MatrixXd::Zero(n, 3 + 2 * knots);
    rows.random.col(0) = dir;
    rows.random.col(1) = v_radps;
    rows.random.col(2).setOnes();
    for (Index t = 0; t < n; ++t) {
        const double x = std::clamp((t_s[t] - t_s[0]) / step, 0.0, static_cast<double>(knots - 1));
        const Index k = std::min<Index>(static_cast<Index>(x), knots - 2);
        const double w = x - static_cast<double>(k);
        rows.random(t, 3 + k) = (1 - w) * dir[t];
        rows.random(t, 4 + k) = w * dir[t];
        rows.random(t, 3 + knots + k) = 1 - w;
        rows.random(t, 4 + knots + k) = w;
    }
    rows.group = {RG_COULOMB, RG_VISCOUS, RG_OFFSET};
    rows.group.insert(rows.group.end(), static_cast<std::size_t>(knots), RG_FRICTION_WANDER);
    rows.group.insert(rows.group.end(), static_cast<std::size_t>(knots), RG_OFFSET_WANDER);
}

double NoiseModel::information(double omega) const
{
    const VectorXd &phi = predictor.back();
    double re = 1, im = 0;
    for (Index k = 0; k < phi.size(); ++k) {
        const double w = omega * static_cast<double>(k + 1);
        re -= phi[k] * std::cos(w);
        im += phi[k] * std::sin(w);
    }
    return (re * re + im * im) / (innovation_nm.back() * innovation_nm.back());
}

MatrixXd whiten(const NoiseModel &n, const std::vector<int> &lags, const MatrixXd &x)
{
    MatrixXd w(x.rows(), x.cols());
    for (Index c = 0; c < x.cols(); ++c) {
        for (Index t = 0; t < x.rows(); ++t) {
            const int m = std::min(n.order(), lags[static_cast<std::size_t>(t)]);
            const VectorXd &phi = n.predictor[static_cast<std::size_t>(m)];
            double s = x(t, c);
            for (Index k = 0; k < m; ++k)
                s -= phi[k] * x(t - 1 - k, c);
            w(t, c) = s / n.innovation_nm[static_cast<std::size_t>(m)];
        }
    }
    return w;
}

VectorXd whiten_adjoint(const NoiseModel &n, const std::vector<int> &lags, const VectorXd &w)
{
    VectorXd x = VectorXd::Zero(w.size());
    for (Index t = 0; t < w.size(); ++t) {
        const int m = std::min(n.order(), lags[static_cast<std::size_t>(t)]);
        const VectorXd &phi = n.predictor[static_cast<std::size_t>(m)];
        const double s = w[t] / n.innovation_nm[static_cast<std::size_t>(m)];
        x[t] += s;
        for (Index k = 0; k < m; ++k)
            x[t - 1 - k] -= phi[k] * s;
    }
    return x;
}

NoiseModel fit_noise(const std::vector<RunRows> &runs, const std::vector<MatrixXd> &rich, int order)
{
    constexpr int kOuter = 2, kInner = 12;
    const std::vector<MatrixXd> x = joined_fixed(runs, rich);
    NoiseModel n;
    std::vector<VectorXd> e;
    double v2 = 0, rows = 0;
    for (const RunRows &r : runs) {
        e.push_back(r.y);
        v2 += r.random.col(1).squaredNorm();
        rows += static_cast<double>(r.y.size());
    }
    v2 = std::max(v2 / std::max(rows, 1.0), 1e-9);
    levinson(autocovariance(runs, e, 0), n);
    double var[RG_GROUPS], left_nm2 = 0;
    for (int outer = 0; outer <= kOuter; ++outer) {
        // a healthy joint scatters a little from run to run even when few runs cannot show it
        const double s2 = n.coloured_nm * n.coloured_nm;
        const double prior[RG_GROUPS] = {0.09 * s2, 0.09 * s2 / v2, 0.09 * s2, 0.01 * s2, 0.01 * s2};
        if (outer == 0)
            for (int g = 0; g < RG_GROUPS; ++g)
                var[g] = prior[g];
        const Mixed m = mixed_products(runs, x, n);
        if (outer == 0) // the noise is white as yet, of standard deviation coloured_nm
            left_nm2 = s2 * (m.yy - m.xy.dot(ridged(m.xx).llt().solve(m.xy))) / std::max(rows, 1.0);
        MixedSolution sol;
        for (int i = 0; i < kInner; ++i) {
            sol = em_step(m, runs, prior, 2.0, var);
            // Runs cannot scatter by more than least squares leave.  Without this, large run effects make the
            // slow part of the data worthless, the rest lets fixed effects run
            // wild, and those ask for larger run effects.
            for (int g = 0; g < RG_GROUPS; ++g)
                var[g] = std::min(var[g], kScatterMost * left_nm2 / (g == RG_VISCOUS ? v2 : 1));
        }
        for (std::size_t r = 0; r < runs.size(); ++r)
            e[r] = runs[r].y - x[r] * sol.beta - runs[r].random * sol.u[r];
        if (outer < kOuter)
            levinson(autocovariance(runs, e, order), n);
        else
            for (double &sd : n.innovation_nm)
                sd *= std::sqrt(sol.s2);
    }
    for (int g = 0; g < RG_GROUPS; ++g)
        n.variance[g] = var[g];
    return n;
}

Evidence::Evidence(std::vector<RunRows> runs, NoiseModel noise)
    : runs_(std::move(runs)), noise_(std::move(noise))
{
    for (const RunRows &r : runs_) {
        const Index nf = r.fixed.cols();
        MatrixXd base(r.y.size(), nf + 1);
        base.leftCols(nf) = r.fixed;
        base.col(nf) = r.y;
        Prepared p;
        p.base = whiten(noise_, r.lags, base);
        p.random = whiten(noise_, r.lags, r.random);
        for (Index k = 0; k < p.random.cols(); ++k)
            p.random.col(k) *= std::sqrt(noise_.variance[r.group[static_cast<std::size_t>(k)]]);
        const Index nz = p.random.cols();
        const MatrixXd d = MatrixXd::Identity(nz, nz) + p.random.transpose() * p.random;
        p.half = Eigen::LLT<MatrixXd>(d).matrixL().solve(MatrixXd::Identity(nz, nz));
        p.half_base = p.half * (p.random.transpose() * p.base);
        p.weighted = p.base.transpose() * p.base - p.half_base.transpose() * p.half_base;
        // what is known beforehand of a nuisance is shared out among the runs
        if (r.prior.size() == nf)
            p.weighted.diagonal().head(nf) += r.prior / static_cast<double>(runs_.size());
        p.plain = base.transpose() * base;
        prepared_.push_back(std::move(p));
    }
    const Gram g = gram(std::vector<MatrixXd>());
    MatrixXd sum = MatrixXd::Zero(g.nuisances + 1, g.nuisances + 1);
    double rows = 0;
    for (std::size_t r = 0; r < runs_.size(); ++r) {
        sum += g.plain[r];
        rows += static_cast<double>(g.rows[r]);
    }
    const Index nn = g.nuisances;
    const VectorXd beta = ridged(sum.topLeftCorner(nn, nn)).llt().solve(sum.col(nn).head(nn));
    rms_nm_ = std::sqrt(std::max(0.0, sum(nn, nn) - beta.dot(sum.col(nn).head(nn))) / std::max(rows, 1.0));
}

Gram Evidence::gram(const std::vector<MatrixXd> &x) const
{
    Gram g;
    g.nuisances = runs_[0].fixed.cols();
    g.columns = x.empty() ? 0 : x[0].cols();
    const Index nn = g.nuisances, k = g.columns, n = nn + k + 1;
    VectorXd ss = VectorXd::Zero(k);
    double rows = 0;
    for (std::size_t r = 0; r < runs_.size(); ++r) {
        const Prepared &p = prepared_[r];
        MatrixXd w = MatrixXd::Zero(n, n), plain = MatrixXd::Zero(n, n);
        const auto place = [&](MatrixXd &m, const MatrixXd &bb, const MatrixXd &bx, const MatrixXd &xx) {
            m.topLeftCorner(nn, nn) = bb.topLeftCorner(nn, nn);
            m.col(n - 1).head(nn) = bb.col(nn).head(nn);
            m(n - 1, n - 1) = bb(nn, nn);
            m.block(0, nn, nn, k) = bx.topRows(nn);
            m.block(nn, n - 1, k, 1) = bx.row(nn).transpose();
            m.block(nn, nn, k, k) = xx;
            m.triangularView<Eigen::StrictlyLower>() = m.transpose();
        };
        if (k > 0) {
            const MatrixXd xw = whiten(noise_, runs_[r].lags, x[r]);
            const MatrixXd zx = p.half * (p.random.transpose() * xw);
            MatrixXd base(runs_[r].y.size(), nn + 1);
            base.leftCols(nn) = runs_[r].fixed;
            base.col(nn) = runs_[r].y;
            place(w, p.weighted, p.base.transpose() * xw - p.half_base.transpose() * zx,
                  squares(xw) - squares(zx));
            place(plain, p.plain, base.transpose() * x[r], squares(x[r]));
            ss += x[r].colwise().squaredNorm().transpose();
        } else {
            w = p.weighted;
            plain = p.plain;
        }
        rows += static_cast<double>(runs_[r].y.size());
        g.weighted.push_back(std::move(w));
        g.plain.push_back(std::move(plain));
        g.rows.push_back(runs_[r].y.size());
    }
    const double scale = 10 * std::max(rms_nm_, 1e-9);
    g.prior = (ss / std::max(rows, 1.0) / (scale * scale)).asDiagonal();
    g.prior.diagonal().array() += 1e-12;
    return g;
}

std::vector<VectorXd> Evidence::score() const
{
    const Gram g = gram(std::vector<MatrixXd>());
    const Index nn = g.nuisances;
    MatrixXd sum = MatrixXd::Zero(nn + 1, nn + 1);
    for (const MatrixXd &w : g.weighted)
        sum += w;
    VectorXd coef(nn + 1);
    coef.head(nn) = -ridged(sum.topLeftCorner(nn, nn)).llt().solve(sum.col(nn).head(nn));
    coef[nn] = 1;
    std::vector<VectorXd> out;
    for (std::size_t r = 0; r < runs_.size(); ++r) {
        const Prepared &p = prepared_[r];
        VectorXd e = p.base * coef;
        e -= p.random * (p.half.transpose() * (p.half * (p.random.transpose() * e)));
        out.push_back(whiten_adjoint(noise_, runs_[r].lags, e));
    }
    return out;
}

void Evidence::products(std::size_t run, const MatrixXd &x, const VectorXd &residual, MatrixXd *a,
                        VectorXd *b) const
{
    const Prepared &p = prepared_[run];
    const MatrixXd xw = whiten(noise_, runs_[run].lags, x), zx = p.half * (p.random.transpose() * xw);
    const VectorXd ew = whiten(noise_, runs_[run].lags, residual), ze = p.half * (p.random.transpose() * ew);
    *a = xw.transpose() * xw - zx.transpose() * zx;
    *b = xw.transpose() * ew - zx.transpose() * ze;
}

std::vector<RunSet> balanced_splits(std::size_t runs, std::size_t most)
{
    std::vector<RunSet> out;
    if (runs < 2)
        return out;
    std::uint64_t state = 0x68647473u;
    std::vector<std::size_t> order(runs);
    for (std::size_t tries = 0; out.size() < most && tries < 40 * most; ++tries) {
        std::iota(order.begin(), order.end(), std::size_t{0});
        for (std::size_t i = runs - 1; i > 0; --i) {
            state = state * 6364136223846793005u + 1442695040888963407u;
            std::swap(order[i], order[(state >> 33) % (i + 1)]);
        }
        RunSet train(runs, 0);
        for (std::size_t i = 0; i < runs / 2; ++i)
            train[order[i]] = 1;
        RunSet other(runs);
        for (std::size_t i = 0; i < runs; ++i)
            other[i] = static_cast<char>(!train[i]);
        for (const RunSet &s : {train, other})
            if (out.size() < most && std::find(out.begin(), out.end(), s) == out.end())
                out.push_back(s);
    }
    return out;
}

Projected project(const Gram &g, const RunSet &use)
{
    const Index nn = g.nuisances, k = g.columns, n = nn + k + 1;
    MatrixXd w = MatrixXd::Zero(n, n), plain = MatrixXd::Zero(n, n);
    Projected out;
    for (std::size_t r = 0; r < use.size(); ++r) {
        if (!use[r])
            continue;
        w += g.weighted[r];
        plain += g.plain[r];
        out.rows += static_cast<double>(g.rows[r]);
    }
    const MatrixXd nx = w.block(0, nn, nn, k + 1);
    const MatrixXd sol = ridged(w.topLeftCorner(nn, nn)).llt().solve(nx);
    const MatrixXd s = w.block(nn, nn, k + 1, k + 1) - nx.transpose() * sol;
    out.a = s.topLeftCorner(k, k);
    out.b = s.col(k).head(k);
    const MatrixXd pnx = plain.block(0, nn, nn, k);
    out.plain_a = plain.block(nn, nn, k, k)
                  - pnx.transpose() * ridged(plain.topLeftCorner(nn, nn)).llt().solve(pnx);
    return out;
}

GlsFit gls_fit(const Gram &g, const RunSet &use)
{
    const Index nn = g.nuisances, k = g.columns, n = nn + k;
    MatrixXd w = MatrixXd::Zero(n + 1, n + 1);
    for (std::size_t r = 0; r < use.size(); ++r)
        if (use[r])
            w += g.weighted[r];
    MatrixXd a = ridged(w.topLeftCorner(n, n));
    a.bottomRightCorner(k, k) += g.prior;
    const Eigen::LLT<MatrixXd> fac(a);
    const VectorXd sol = fac.solve(w.col(n).head(n));
    GlsFit f;
    f.nuisance = sol.head(nn);
    f.theta = sol.tail(k);
    f.covariance = fac.solve(MatrixXd::Identity(n, n));
    const VectorXd null = ridged(w.topLeftCorner(nn, nn)).llt().solve(w.col(n).head(nn));
    f.llr = 0.5 * (sol.dot(w.col(n).head(n)) - null.dot(w.col(n).head(nn)));
    return f;
}

MatrixXd run_covariance(const Gram &g, const GlsFit &fit)
{
    const Index n = g.nuisances + g.columns;
    VectorXd coef(n + 1);
    coef << -fit.nuisance, -fit.theta, 1;
    MatrixXd meat = MatrixXd::Zero(n, n);
    for (const MatrixXd &w : g.weighted) {
        const VectorXd s = (w * coef).head(n);
        meat += s * s.transpose();
    }
    const double runs = static_cast<double>(g.weighted.size());
    meat *= runs / std::max(1.0, runs - 1.0);
    MatrixXd cov = fit.covariance * meat * fit.covariance;
    // entrywise larger variance wins; correlations are the model's
    MatrixXd out = fit.covariance;
    const VectorXd grow = (cov.diagonal().array() / fit.covariance.diagonal().array()).max(1.0).sqrt();
    return grow.asDiagonal() * out * grow.asDiagonal();
}

VectorXd jackknife_variance(const MatrixXd &left_out)
{
    const double runs = static_cast<double>(left_out.cols());
    const VectorXd mean = left_out.rowwise().mean();
    return (runs - 1) / std::max(runs, 1.0) * (left_out.colwise() - mean).rowwise().squaredNorm();
}

MatrixXd jackknife_covariance(const Gram &g, const MatrixXd &covariance)
{
    const std::size_t runs = g.weighted.size();
    if (runs < 2)
        return covariance;
    MatrixXd left_out(g.nuisances + g.columns, static_cast<Index>(runs));
    for (std::size_t r = 0; r < runs; ++r) {
        RunSet use(runs, 1);
        use[r] = 0;
        const GlsFit fit = gls_fit(g, use);
        left_out.col(static_cast<Index>(r)) << fit.nuisance, fit.theta;
    }
    const VectorXd grow =
        (jackknife_variance(left_out).array() / covariance.diagonal().array()).max(1.0).sqrt();
    return grow.asDiagonal() * covariance * grow.asDiagonal();
}

double log_mean_exp(const std::vector<double> &x, double count)
{
    double top = -std::numeric_limits<double>::infinity();
    for (double v : x)
        top = std::max(top, v);
    if (!std::isfinite(top))
        return -1e9;
    double sum = 0;
    for (double v : x)
        sum += std::exp(v - top);
    return top + std::log(sum / count);
}

namespace {

// One set of coefficients for all joints from some of the runs, beside their prior.
VectorXd theta_of_all(const std::vector<const Gram *> &g, const RunSet &use)
{
    MatrixXd a = g[0]->prior;
    VectorXd b = VectorXd::Zero(g[0]->columns);
    for (const Gram *joint : g) {
        const Projected p = project(*joint, use);
        a += p.a;
        b += p.b;
    }
    return ridged(a).llt().solve(b);
}

} // namespace

double split_log_e(const std::vector<const Gram *> &g, const std::vector<RunSet> &splits)
{
    std::vector<double> log_e;
    for (const RunSet &train : splits) {
        RunSet test(train.size());
        for (std::size_t r = 0; r < train.size(); ++r)
            test[r] = static_cast<char>(!train[r]);
        const VectorXd theta = theta_of_all(g, train);
        double sum = 0;
        for (const Gram *joint : g) {
            const Projected p = project(*joint, test);
            sum += theta.dot(p.b) - 0.5 * theta.dot(p.a * theta);
        }
        log_e.push_back(sum);
    }
    return log_mean_exp(log_e, static_cast<double>(std::max<std::size_t>(splits.size(), 1)));
}

namespace {

// What the nuisances take of the candidate's columns, one number for all runs.
MatrixXd taken_over(const Gram &g)
{
    MatrixXd sum = MatrixXd::Zero(g.nuisances + g.columns + 1, g.nuisances + g.columns + 1);
    for (const MatrixXd &m : g.plain)
        sum += m;
    const MatrixXd nuisances = ridged(sum.topLeftCorner(g.nuisances, g.nuisances));
    return nuisances.llt().solve(sum.block(0, g.nuisances, g.nuisances, g.columns));
}

} // namespace

std::vector<RunGain> leave_one_run_out(const std::vector<const Gram *> &g)
{
    const std::size_t runs = g[0]->weighted.size();
    std::vector<RunGain> out(g.size());
    std::vector<MatrixXd> beside;
    for (const Gram *joint : g)
        beside.push_back(taken_over(*joint));
    for (std::size_t r = 0; r < runs; ++r) {
        RunSet use(runs, 1);
        use[r] = 0;
        const VectorXd theta = theta_of_all(g, use);
        for (std::size_t j = 0; j < g.size(); ++j) {
            const Gram &c = *g[j];
            const Index nn = c.nuisances, k = c.columns, n = nn + k + 1;
            MatrixXd w = MatrixXd::Zero(n, n);
            for (std::size_t s = 0; s < runs; ++s)
                if (use[s])
                    w += c.weighted[s];
            const Eigen::LLT<MatrixXd> fac(ridged(w.topLeftCorner(nn, nn)));
            VectorXd with(n), without = VectorXd::Zero(n);
            without.head(nn) = -fac.solve(w.col(n - 1).head(nn));
            without[n - 1] = 1;
            with << -fac.solve(w.col(n - 1).head(nn) - w.block(0, nn, nn, k) * theta), -theta, 1;
            const auto fall = [&](const MatrixXd &m) {
                return without.dot(m * without) - with.dot(m * with);
            };
            VectorXd effect = VectorXd::Zero(n);
            effect << -(beside[j] * theta), theta, 0;
            const double rows = static_cast<double>(c.rows[r]);
            out[j].log_likelihood.push_back(0.5 * fall(c.weighted[r]));
            out[j].plain.push_back(fall(c.plain[r]));
            out[j].contribution.push_back(effect.dot(c.plain[r] * effect) / std::max(rows, 1.0));
            out[j].total += out[j].log_likelihood.back();
            out[j].plain_total += out[j].plain.back();
            out[j].rows += rows;
        }
    }
    for (RunGain &o : out) {
        double mean = 0;
        for (double c : o.contribution)
            mean += c / static_cast<double>(runs);
        for (std::size_t r = 0; r < runs; ++r) {
            const bool shows = o.contribution[r] >= 0.25 * mean;
            o.informative += shows;
            o.better += shows && o.log_likelihood[r] > 0;
        }
    }
    return out;
}

std::vector<double> ebh_adjusted(const std::vector<double> &log_e)
{
    const std::size_t n = log_e.size();
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return log_e[a] > log_e[b]; });
    std::vector<double> out(n, 1);
    double best = 1;
    for (std::size_t i = n; i-- > 0;) {
        const double log_p = std::log(static_cast<double>(n)) - std::log(static_cast<double>(i + 1))
                             - log_e[order[i]];
        best = std::min(best, std::exp(std::min(log_p, 0.0)));
        out[order[i]] = best;
    }
    return out;
}

} // namespace hdt
