// SPDX-License-Identifier: Apache-2.0
//
// Solving and judging the least-squares problem.  Estimates come from QR; only covariances and
// cross-validation use products of columns, one Gram matrix per cluster, so that leaving a cluster
// out is a subtraction.
//
// Owns: the linear algebra of identification.
// Never: decides what is fitted.
#include "model/ident_solve.hpp"

#include <algorithm>
#include <cmath>
#include <future>
#include <limits>

namespace hdt::fit {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double dependent = 1e-4;      // share of a column's norm that must be its own
constexpr double vc_min_radps = 0.003, vc_max_radps = 1;
constexpr int vc_grid = 20;
constexpr double leverage_max = 0.9;    // of one cluster
constexpr Index runs_for_clusters = 4;
constexpr double ridge_least = 1e-3, ridge_most = 1e4;

// Knots outward from the line that holds load 0: above it the upper ones, below it the lower ones.
double *knot_load(hdt_arm_stiffness *k, int knot)
{
    bool first = home_line(*k) == 2 ? knot == 1 : knot == 0;
    return first ? &k->t1_nm : &k->t2_nm;
}

bool knot_is_above(const hdt_arm_stiffness &k, int knot)
{
    int home = home_line(k);
    return home == 0 || (home == 1 && knot == 1);
}

// What grows beyond each knot.
VectorXd kink_column(const JointFitState &j, int way, int knot)
{
    hdt_arm_stiffness k = j.model.stiffness[way];
    Eigen::ArrayXd x = j.rows.load.array() - *knot_load(&k, knot);
    x = knot_is_above(k, knot) ? Eigen::ArrayXd(x.max(0)) : Eigen::ArrayXd(x.min(0));
    return j.rows.share[way].array() * x;
}

// How it changes as the knot moves.
VectorXd knot_column(const JointFitState &j, int way, int knot)
{
    hdt_arm_stiffness k = j.model.stiffness[way];
    double side = knot_is_above(k, knot) ? 1 : -1, at = *knot_load(&k, knot);
    Eigen::ArrayXd beyond = (side * (j.rows.load.array() - at) > 0).cast<double>();
    return -j.model.kink[way][knot] * j.rows.share[way].array() * beyond;
}

VectorXd viscous_column(const JointFitState &j, int way)
{
    return (way == 0 ? 1 : -1) * j.rows.share[way].cwiseProduct(j.rows.speed[way]);
}

VectorXd decay(const JointFitState &j, int way, double vc)
{
    return (-j.rows.speed[way].array() / vc).exp();
}

MatrixXd columns_of(const JointFitState &j, const std::vector<Column> &which)
{
    MatrixXd x(j.rows.rows(), static_cast<Index>(which.size()));
    for (std::size_t k = 0; k < which.size(); k++)
        x.col(static_cast<Index>(k)) = column(j, which[k]);
    return x;
}

double *number(JointModel *m, const Column &c)
{
    switch (c.kind) {
    case F0: return &m->friction[c.way].f0_nm;
    case FV: return &m->friction[c.way].fv_nmspr;
    case FS: return &m->friction[c.way].fs_nm;
    case VC: return &m->friction[c.way].vc_radps;
    case RIPPLE_SIN: return &m->ripple[static_cast<std::size_t>(2 * c.index)];
    case RIPPLE_COS: return &m->ripple[static_cast<std::size_t>(2 * c.index + 1)];
    case KINK_1: return &m->kink[c.way][0];
    case KINK_2: return &m->kink[c.way][1];
    case KNOT_1: return knot_load(&m->stiffness[c.way], 0);
    case KNOT_2: return knot_load(&m->stiffness[c.way], 1);
    }
    return nullptr;
}

void release(JointModel *m, const Column &c)
{
    switch (c.kind) {
    case F0: m->free_f0[c.way] = false; break;
    case FV:
        m->free_fv[c.way] = false;
        m->free_fv[1] = m->free_fv[1] && !m->one_fv;
        m->one_fv = false;
        break;
    case FS: case VC: m->free_fs[c.way] = false; break;
    case RIPPLE_SIN: case RIPPLE_COS: m->free_ripple[static_cast<std::size_t>(c.index)] = 0; break;
    case KINK_1: case KINK_2: case KNOT_1: case KNOT_2: m->free_stiffness[c.way] = false; break;
    }
}

MatrixXd pick(const MatrixXd &x, const std::vector<int> &which)
{
    MatrixXd out(x.rows(), static_cast<Index>(which.size()));
    for (std::size_t k = 0; k < which.size(); k++)
        out.col(static_cast<Index>(k)) = x.col(which[k]);
    return out;
}

// One joint with its own columns taken out: what is left ties it to the others.
struct Reduced {
    MatrixXd r;              // upper triangle of the own columns
    MatrixXd top_shared, shared;
    VectorXd top_y, y;
    std::vector<Column> columns;
    Column bad;
    bool has_bad = false;
};

// Torque the joint's own kept numbers explain.
VectorXd kept_torque(const JointFitState &j)
{
    VectorXd t = own_torque(j);
    JointModel now = j.model;
    for (const Column &c : free_columns(now, false))
        t -= *number(&now, c) * column(j, c);
    return t;
}

Reduced reduce(const Problem &p, const JointFitState &j)
{
    Reduced out;
    out.columns = free_columns(j.model, false);
    VectorXd target = j.rows.y - kept_torque(j);
    for (Index k = 0; k < p.beta.size(); k++)
        if (std::find(p.shared_free.begin(), p.shared_free.end(), k) == p.shared_free.end() && p.beta[k] != 0)
            target -= p.beta[k] * j.rows.shared.col(k);
    MatrixXd x = columns_of(j, out.columns), s = pick(j.rows.shared, p.shared_free);
    Index n = x.cols();
    Eigen::HouseholderQR<MatrixXd> qr(x);
    out.r = qr.matrixQR().topRows(n).triangularView<Eigen::Upper>();
    for (Index k = 0; k < n; k++)
        if (!(std::fabs(out.r(k, k)) > dependent * x.col(k).norm())) {
            out.bad = out.columns[static_cast<std::size_t>(k)];
            out.has_bad = true;
            return out;
        }
    MatrixXd rhs(x.rows(), s.cols() + 1);
    rhs << s, target;
    rhs.applyOnTheLeft(qr.householderQ().adjoint());
    out.top_shared = rhs.topLeftCorner(n, s.cols());
    out.top_y = rhs.col(s.cols()).head(n);
    MatrixXd rest = rhs.bottomRows(rhs.rows() - n);
    if (rest.rows() > rest.cols()) {
        Eigen::HouseholderQR<MatrixXd> small(rest);
        rest = small.matrixQR().topRows(rest.cols()).triangularView<Eigen::Upper>();
    }
    out.shared = rest.leftCols(s.cols());
    out.y = rest.col(s.cols());
    return out;
}

std::vector<Reduced> reduce_all(const Problem &p)
{
    std::vector<std::future<Reduced>> work;
    for (const JointFitState &j : p.joint)
        work.push_back(std::async(std::launch::async, [&] { return reduce(p, j); }));
    std::vector<Reduced> out;
    for (auto &w : work)
        out.push_back(w.get());
    return out;
}

// All joints, without the own columns that depend on earlier ones.
std::vector<Reduced> reduce_independent(Problem *p, std::vector<std::pair<std::size_t, Column>> *released)
{
    for (;;) {
        std::vector<Reduced> r = reduce_all(*p);
        bool again = false;
        for (std::size_t j = 0; j < r.size(); j++)
            if (r[j].has_bad) {
                release(&p->joint[j].model, r[j].bad);
                released->push_back({j, r[j].bad});
                again = true;
            }
        if (!again)
            return r;
    }
}

// The joints' remainders under each other, weighted; last column is torque.
MatrixXd stack(const Problem &p, const std::vector<Reduced> &r)
{
    Index rows = 0, columns = static_cast<Index>(p.shared_free.size()) + 1;
    for (const Reduced &x : r)
        rows += x.shared.rows();
    MatrixXd out = MatrixXd::Zero(rows + columns - 1, columns);
    Index at = 0;
    for (std::size_t j = 0; j < r.size(); j++) {
        Index n = r[j].shared.rows();
        out.middleRows(at, n) << p.joint[j].weight * r[j].shared, p.joint[j].weight * r[j].y;
        at += n;
    }
    // one row for each expectation: number / size = 0
    for (Index k = 0; k < columns - 1 && p.ridge > 0; k++)
        out(rows + k, k) = std::sqrt(p.ridge) / p.shared_size[p.shared_free[static_cast<std::size_t>(k)]];
    return out;
}

// Products of all columns and the residual, per cluster, over all joints; shared columns last.
struct Grams {
    std::vector<MatrixXd> gram;
    std::vector<VectorXd> score;   // columns times the vector given
    VectorXd power;                // of that vector
    VectorXd scale;                // columns were divided by this
    std::vector<Index> begin;      // first column of each joint, then of the shared ones, then all
};

// target: false the residual, true what is to be explained (for prediction).
Grams grams(const Problem &p, const std::vector<int> &shared, bool by_run, bool with_nonlinear, bool target)
{
    Grams g;
    Index columns = 0, clusters = 0;
    for (const JointFitState &j : p.joint) {
        g.begin.push_back(columns);
        columns += static_cast<Index>(free_columns(j.model, with_nonlinear).size());
        const auto &cut = by_run ? j.rows.run_begin : j.rows.piece_begin;
        clusters = std::max(clusters, static_cast<Index>(cut.size()) - 1);
    }
    g.begin.push_back(columns);
    columns += static_cast<Index>(shared.size());
    g.begin.push_back(columns);
    g.gram.assign(static_cast<std::size_t>(clusters), MatrixXd::Zero(columns, columns));
    g.score.assign(static_cast<std::size_t>(clusters), VectorXd::Zero(columns));
    g.power = VectorXd::Zero(clusters);
    Index s0 = g.begin[g.begin.size() - 2], ns = static_cast<Index>(shared.size());
    for (std::size_t k = 0; k < p.joint.size(); k++) {
        const JointFitState &j = p.joint[k];
        MatrixXd own = columns_of(j, free_columns(j.model, with_nonlinear));
        MatrixXd z(own.rows(), own.cols() + ns);
        z << own, pick(j.rows.shared, shared);
        z *= j.weight;
        VectorXd e = j.weight * (target ? VectorXd(j.rows.y - kept_torque(j)) : residual(p, j));
        const auto &cut = by_run ? j.rows.run_begin : j.rows.piece_begin;
        Index no = own.cols(), o0 = g.begin[k];
        for (std::size_t c = 0; c + 1 < cut.size(); c++) {
            auto zc = z.middleRows(cut[c], cut[c + 1] - cut[c]);
            auto ec = e.segment(cut[c], cut[c + 1] - cut[c]);
            MatrixXd zz = zc.transpose() * zc;
            VectorXd ze = zc.transpose() * ec;
            g.gram[c].block(o0, o0, no, no) += zz.topLeftCorner(no, no);
            g.gram[c].block(o0, s0, no, ns) += zz.topRightCorner(no, ns);
            g.gram[c].block(s0, o0, ns, no) += zz.bottomLeftCorner(ns, no);
            g.gram[c].block(s0, s0, ns, ns) += zz.bottomRightCorner(ns, ns);
            g.score[c].segment(o0, no) += ze.head(no);
            g.score[c].segment(s0, ns) += ze.tail(ns);
            g.power[static_cast<Index>(c)] += ec.squaredNorm();
        }
    }
    g.scale = VectorXd::Zero(columns);
    for (const MatrixXd &m : g.gram)
        g.scale += m.diagonal();
    g.scale = g.scale.cwiseSqrt().cwiseMax(1e-300);
    for (std::size_t c = 0; c < g.gram.size(); c++) {
        g.gram[c] = g.scale.cwiseInverse().asDiagonal() * g.gram[c] * g.scale.cwiseInverse().asDiagonal();
        g.score[c] = g.score[c].cwiseQuotient(g.scale);
    }
    return g;
}

// The expectations' part of the sum of products, in the scaled columns; zero for own columns.
VectorXd ridge_diagonal(const Problem &p, const Grams &g, double ridge)
{
    VectorXd d = VectorXd::Zero(g.scale.size());
    Index s0 = g.begin[g.begin.size() - 2];
    for (std::size_t k = 0; k < p.shared_free.size() && ridge > 0; k++) {
        double size = p.shared_size[p.shared_free[k]] * g.scale[s0 + static_cast<Index>(k)];
        d[s0 + static_cast<Index>(k)] = ridge / (size * size);
    }
    return d;
}

// Delete-one-cluster jackknife of the linearised fit.  A cluster that alone excites a number has
// leverage one there; its leverage is capped, which leaves that number an honest large sigma.  What
// an expectation pulls a number away from the truth by is added, the truth being of the size expected.
VectorXd jackknife(const Problem &p, const Grams &g)
{
    Index n = g.scale.size(), clusters = static_cast<Index>(g.gram.size());
    VectorXd pull = ridge_diagonal(p, g, p.ridge);
    MatrixXd all = pull.asDiagonal();
    for (const MatrixXd &m : g.gram)
        all += m;
    Eigen::SelfAdjointEigenSolver<MatrixXd> eig(all);
    // W' all W = I
    const VectorXd &square = eig.eigenvalues();
    VectorXd root = square.cwiseMax(1e-13 * square.maxCoeff()).cwiseSqrt().cwiseInverse();
    MatrixXd w = eig.eigenvectors() * root.asDiagonal();
    VectorXd var = VectorXd::Zero(n);
    for (Index c = 0; c < clusters; c++) {
        Eigen::SelfAdjointEigenSolver<MatrixXd> h(w.transpose() * g.gram[static_cast<std::size_t>(c)] * w);
        VectorXd left = (1 - h.eigenvalues().array().min(leverage_max)).inverse();
        VectorXd d = h.eigenvectors() * left.asDiagonal() * h.eigenvectors().transpose()
                     * (w.transpose() * g.score[static_cast<std::size_t>(c)]);
        var += (w * d).cwiseAbs2();
    }
    double many = static_cast<double>(clusters);
    var *= (many - 1) / many;
    if (p.ridge > 0) {
        MatrixXd off = w * (w.transpose() * pull.asDiagonal()); // change of the fit per unit of truth
        VectorXd size = (pull.array() > 0).select((p.ridge / pull.array().max(1e-300)).sqrt(), 0.0).matrix();
        var += (off * size.asDiagonal()).cwiseAbs2().rowwise().sum();
    }
    return var.cwiseSqrt().cwiseQuotient(g.scale);
}

// Error of the best Stribeck column of this speed, given an orthonormal basis of the others.
double explained(const JointFitState &j, int way, double vc, const MatrixXd &basis, const VectorXd &left)
{
    VectorXd c = j.rows.share[way].array() * (1 - decay(j, way, vc).array());
    double norm = c.squaredNorm();
    c -= basis * (basis.transpose() * c);
    double own = c.squaredNorm();
    if (!(own > dependent * dependent * norm))
        return 0;
    double dot = c.dot(left);
    return dot * dot / own;
}

// Speeds the data can place a Stribeck speed in: from their slowest hundredth to their fastest.
std::pair<double, double> vc_range(const JointFitState &j, int way)
{
    std::vector<double> speed;
    for (Index i = 0; i < j.rows.rows(); i++)
        if (j.rows.share[way][i] > 0.5)
            speed.push_back(j.rows.speed[way][i]);
    std::sort(speed.begin(), speed.end());
    double lo = std::max(vc_min_radps, speed[speed.size() / 100]);
    return {lo, std::max(2 * lo, std::min(vc_max_radps, speed.back()))};
}

double best_vc(const JointFitState &j, int way, const MatrixXd &basis, const VectorXd &left)
{
    auto [slow, fast] = vc_range(j, way);
    auto at = [&](double log_vc) { return explained(j, way, std::exp(log_vc), basis, left); };
    double lo = std::log(slow), hi = std::log(fast), step = (hi - lo) / (vc_grid - 1);
    double best = lo, most = -1;
    for (int k = 0; k < vc_grid; k++) {
        double e = at(lo + k * step);
        if (e > most) {
            most = e;
            best = lo + k * step;
        }
    }
    // golden section around the best knot
    double a = std::max(lo, best - step), b = std::min(hi, best + step);
    const double g = 0.6180339887498949;
    double x1 = b - g * (b - a), x2 = a + g * (b - a), e1 = at(x1), e2 = at(x2);
    for (int k = 0; k < 12; k++) {
        if (e1 > e2) {
            b = x2;
            x2 = x1;
            e2 = e1;
            e1 = at(x1 = b - g * (b - a));
        } else {
            a = x1;
            x1 = x2;
            e1 = e2;
            e2 = at(x2 = a + g * (b - a));
        }
    }
    return std::exp((a + b) / 2);
}

bool search_joint(const Problem &p, JointFitState *j)
{
    bool moved = false;
    for (int way = 0; way < 2; way++) {
        if (!j->model.free_fs[way])
            continue;
        std::vector<Column> others;
        for (const Column &c : free_columns(j->model, false))
            if (c.kind != FS || c.way != way)
                others.push_back(c);
        VectorXd left = residual(p, *j) + j->model.friction[way].fs_nm * column(*j, {FS, way, 0});
        // shared columns that are few move with the friction; many are held
        MatrixXd x = columns_of(*j, others);
        if (p.shared_free.size() == 1 && j->rows.shared.col(p.shared_free[0]).norm() > 0) {
            x.conservativeResize(Eigen::NoChange, x.cols() + 1);
            x.rightCols(1) = j->rows.shared.col(p.shared_free[0]);
        }
        Eigen::HouseholderQR<MatrixXd> qr(x);
        MatrixXd basis = qr.householderQ() * MatrixXd::Identity(x.rows(), x.cols());
        left -= basis * (basis.transpose() * left);
        double vc = best_vc(*j, way, basis, left), &now = j->model.friction[way].vc_radps;
        moved = moved || std::fabs(std::log(vc / now)) > 0.01;
        now = vc;
    }
    return moved;
}

} // namespace

void kinks_of(const hdt_arm_stiffness &k, double kink[2])
{
    switch (home_line(k)) {
    case 0: kink[0] = k.slope[1] - k.slope[0]; kink[1] = k.slope[2] - k.slope[1]; break;
    case 1: kink[0] = k.slope[0] - k.slope[1]; kink[1] = k.slope[2] - k.slope[1]; break;
    default: kink[0] = k.slope[1] - k.slope[2]; kink[1] = k.slope[0] - k.slope[1]; break;
    }
}

void slopes_from(const double kink[2], hdt_arm_stiffness *k)
{
    switch (home_line(*k)) {
    case 0: k->slope[1] = k->slope[0] + kink[0]; k->slope[2] = k->slope[1] + kink[1]; break;
    case 1: k->slope[0] = k->slope[1] + kink[0]; k->slope[2] = k->slope[1] + kink[1]; break;
    default: k->slope[1] = k->slope[2] + kink[0]; k->slope[0] = k->slope[1] + kink[1]; break;
    }
}

std::vector<Column> free_columns(const JointModel &m, bool with_nonlinear)
{
    // first those that matter most: a column that depends on earlier ones is the one released
    std::vector<Column> out;
    for (int way = 0; way < 2; way++)
        if (m.free_f0[way])
            out.push_back({F0, way, 0});
    for (std::size_t k = 0; k < m.free_ripple.size(); k++)
        if (m.free_ripple[k]) {
            out.push_back({RIPPLE_SIN, 0, static_cast<int>(k)});
            out.push_back({RIPPLE_COS, 0, static_cast<int>(k)});
        }
    for (int way = 0; way < (m.one_fv ? 1 : 2); way++)
        if (m.free_fv[way])
            out.push_back({FV, way, 0});
    for (int way = 0; way < 2; way++)
        if (m.free_stiffness[way]) {
            for (int knot = 0; knot < (m.cut_off[way] ? 1 : 2); knot++)
                out.push_back({knot == 0 ? KINK_1 : KINK_2, way, 0});
            for (int knot = 0; with_nonlinear && knot < (m.cut_off[way] ? 1 : 2); knot++)
                out.push_back({knot == 0 ? KNOT_1 : KNOT_2, way, 0});
        }
    for (int way = 0; way < 2; way++)
        if (m.free_fs[way]) {
            out.push_back({FS, way, 0});
            if (with_nonlinear && m.friction[way].fs_nm != 0)
                out.push_back({VC, way, 0});
        }
    return out;
}

VectorXd column(const JointFitState &j, const Column &c)
{
    double sign = c.way == 0 ? 1 : -1;
    const VectorXd &share = j.rows.share[c.way], &speed = j.rows.speed[c.way];
    double vc = j.model.friction[c.way].vc_radps;
    switch (c.kind) {
    case F0: return sign * share;
    case FV:
        if (j.model.one_fv)
            return viscous_column(j, 0) + viscous_column(j, 1);
        return viscous_column(j, c.way);
    case FS: return sign * share.array() * (1 - decay(j, c.way, vc).array());
    case VC:
        return -sign * j.model.friction[c.way].fs_nm / (vc * vc) * share.array() * speed.array()
               * decay(j, c.way, vc).array();
    case RIPPLE_SIN: return j.rows.ripple.col(2 * c.index);
    case RIPPLE_COS: return j.rows.ripple.col(2 * c.index + 1);
    case KINK_1: return kink_column(j, c.way, 0);
    case KINK_2: return kink_column(j, c.way, 1);
    case KNOT_1: return knot_column(j, c.way, 0);
    case KNOT_2: return knot_column(j, c.way, 1);
    }
    return {};
}

VectorXd own_torque(const JointFitState &j)
{
    const JointModel &m = j.model;
    VectorXd t = VectorXd::Zero(j.rows.rows());
    for (int way = 0; way < 2; way++) {
        const hdt_arm_friction &f = m.friction[way];
        if (f.f0_nm != 0)
            t += f.f0_nm * column(j, {F0, way, 0});
        if (f.fv_nmspr != 0)
            t += f.fv_nmspr * viscous_column(j, way);
        if (f.fs_nm != 0)
            t += f.fs_nm * column(j, {FS, way, 0});
        if (!m.has_stiffness)
            continue;
        const hdt_arm_stiffness &k = m.stiffness[way];
        t.array() += j.rows.share[way].array() * (k.zero_nm + k.slope[home_line(k)] * j.rows.load.array());
        t += m.kink[way][0] * column(j, {KINK_1, way, 0}) + m.kink[way][1] * column(j, {KINK_2, way, 0});
    }
    for (std::size_t k = 0; k < m.ripple.size(); k++)
        t += m.ripple[k] * j.rows.ripple.col(static_cast<Index>(k));
    return t;
}

VectorXd residual(const Problem &p, const JointFitState &j)
{
    VectorXd e = j.rows.y - own_torque(j);
    for (Index k = 0; k < p.beta.size(); k++)
        if (p.beta[k] != 0)
            e -= p.beta[k] * j.rows.shared.col(k);
    return e;
}

void restore(const JointModel &from, const Column &c, JointModel *m)
{
    JointModel &source = const_cast<JointModel &>(from);
    std::vector<Kind> kinds = {c.kind};
    if (c.kind == FS || c.kind == VC)
        kinds = {FS, VC};
    else if (c.kind == RIPPLE_SIN || c.kind == RIPPLE_COS)
        kinds = {RIPPLE_SIN, RIPPLE_COS};
    else if (c.kind == KINK_1 || c.kind == KINK_2)
        kinds = {KINK_1, KINK_2, KNOT_1, KNOT_2};
    if (kinds.size() == 4)
        m->cut_off[c.way] = from.cut_off[c.way];
    for (Kind kind : kinds)
        *number(m, {kind, c.way, c.index}) = *number(&source, {kind, c.way, c.index});
}

std::vector<std::pair<std::size_t, Column>> release_dependent(Problem *p)
{
    std::vector<std::pair<std::size_t, Column>> released;
    reduce_independent(p, &released);
    return released;
}

std::vector<std::pair<std::size_t, Column>> solve(Problem *p)
{
    std::vector<std::pair<std::size_t, Column>> released;
    const std::vector<Reduced> r = reduce_independent(p, &released);
    VectorXd beta = VectorXd::Zero(static_cast<Index>(p->shared_free.size()));
    if (beta.size() > 0) {
        MatrixXd all = stack(*p, r);
        Eigen::ColPivHouseholderQR<MatrixXd> qr(all.leftCols(beta.size()));
        qr.setThreshold(1e-10);
        beta = qr.solve(all.col(beta.size()));
    }
    for (std::size_t k = 0; k < p->shared_free.size(); k++)
        p->beta[p->shared_free[k]] = beta[static_cast<Index>(k)];
    for (std::size_t k = 0; k < r.size(); k++) {
        JointFitState &j = p->joint[k];
        VectorXd own = r[k].r.triangularView<Eigen::Upper>().solve(r[k].top_y - r[k].top_shared * beta);
        for (std::size_t i = 0; i < r[k].columns.size(); i++)
            *number(&j.model, r[k].columns[i]) = own[static_cast<Index>(i)];
        if (j.model.one_fv)
            j.model.friction[1].fv_nmspr = j.model.friction[0].fv_nmspr;
        for (int way = 0; way < 2; way++)
            if (j.model.cut_off[way])
                j.model.kink[way][1] = -j.model.kink[way][0];
        j.rms = std::sqrt(residual(*p, j).squaredNorm() / static_cast<double>(j.rows.rows()));
    }
    return released;
}

bool search_joints(Problem *p, bool (*search)(const Problem &, JointFitState *))
{
    std::vector<std::future<bool>> work;
    for (JointFitState &j : p->joint)
        work.push_back(std::async(std::launch::async, [p, search, &j] { return search(*p, &j); }));
    bool moved = false;
    for (auto &w : work)
        moved = w.get() || moved;
    return moved;
}

bool search_stribeck(Problem *p) { return search_joints(p, search_joint); }

std::vector<int> independent_shared(const Problem &p, const std::vector<int> &candidates)
{
    Problem with = p;
    with.shared_free = candidates;
    with.ridge = 0;
    MatrixXd all = stack(with, reduce_all(with)).leftCols(static_cast<Index>(candidates.size()));
    Eigen::ColPivHouseholderQR<MatrixXd> qr(all);
    qr.setThreshold(1e-6);
    std::vector<int> out;
    for (Index k = 0; k < qr.rank(); k++)
        out.push_back(candidates[static_cast<std::size_t>(qr.colsPermutation().indices()[k])]);
    std::sort(out.begin(), out.end());
    return out;
}

double best_ridge(const Problem &p)
{
    Grams g = grams(p, p.shared_free, false, false, true);
    MatrixXd all = MatrixXd::Zero(g.scale.size(), g.scale.size());
    VectorXd score = VectorXd::Zero(g.scale.size());
    for (std::size_t c = 0; c < g.gram.size(); c++) {
        all += g.gram[c];
        score += g.score[c];
    }
    double least = std::numeric_limits<double>::infinity(), best = 1;
    for (double ridge = ridge_least; ridge < ridge_most; ridge *= 4) {
        double error = 0;
        for (std::size_t c = 0; c < g.gram.size(); c++) {
            MatrixXd rest = all - g.gram[c];
            // the left-out stretch may hold all there is of an own number: it is then zero, not wild
            rest.diagonal() += ridge_diagonal(p, g, ridge) + VectorXd::Constant(score.size(), 1e-9);
            VectorXd x = rest.ldlt().solve(score - g.score[c]);
            error += g.power[static_cast<Index>(c)] - 2 * x.dot(g.score[c]) + x.dot(g.gram[c] * x);
        }
        if (error < least) {
            least = error;
            best = ridge;
        }
    }
    return best;
}

void estimate_sigma(Problem *p)
{
    Grams pieces = grams(*p, p->shared_free, false, true, false);
    VectorXd sigma = jackknife(*p, pieces);
    Index runs = 0;
    for (const JointFitState &j : p->joint)
        runs = std::max(runs, static_cast<Index>(j.rows.run_begin.size()) - 1);
    // scatter between runs, where there are runs enough to see it; a number only one run excites
    // shows none, so the larger of the two stands
    if (runs >= runs_for_clusters)
        sigma = sigma.cwiseMax(jackknife(*p, grams(*p, p->shared_free, true, true, false)));
    for (std::size_t k = 0; k < p->joint.size(); k++) {
        JointFitState &j = p->joint[k];
        j.columns = free_columns(j.model, true);
        j.sigma = sigma.segment(pieces.begin[k], pieces.begin[k + 1] - pieces.begin[k]);
    }
    p->beta_sigma = VectorXd::Zero(p->beta.size());
    Index s0 = pieces.begin[p->joint.size()];
    for (std::size_t k = 0; k < p->shared_free.size(); k++)
        p->beta_sigma[p->shared_free[k]] = sigma[s0 + static_cast<Index>(k)];
}

} // namespace hdt::fit
