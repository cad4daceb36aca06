// SPDX-License-Identifier: Apache-2.0
//
// The three friction curves of the paper's Table I held against each other on the same rows: straight
// line, cubic, Stribeck, each direction with numbers of its own, everything else as fitted.
//
// Owns: the comparison.
// Never: chooses; identification fits Stribeck's curve where the data show it.
#include <algorithm>
#include <cmath>

#include "model/ident_solve.hpp"

namespace hdt::fit {

using Eigen::ArrayXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int vc_grid = 24;
constexpr double vc_least_radps = 0.003, vc_most_radps = 1;

// What friction has to explain: the residual and all friction that was fitted.
VectorXd friction_torque(const Problem &p, const JointFitState &j)
{
    VectorXd y = residual(p, j);
    for (int way = 0; way < 2; way++) {
        const hdt_arm_friction &f = j.model.friction[way];
        const VectorXd along = (way == 0 ? 1 : -1) * j.rows.share[way];
        y += along.cwiseProduct((f.f0_nm + f.fv_nmspr * j.rows.speed[way].array()).matrix());
        if (f.fs_nm != 0)
            y += f.fs_nm * column(j, {FS, way, 0});
    }
    return y;
}

MatrixXd powers(const JointFitState &j, int degree)
{
    MatrixXd x(j.rows.rows(), 2 * (degree + 1));
    for (int way = 0; way < 2; way++) {
        ArrayXd c = (way == 0 ? 1 : -1) * j.rows.share[way].array();
        for (int k = 0; k <= degree; k++, c *= j.rows.speed[way].array())
            x.col(way * (degree + 1) + k) = c;
    }
    return x;
}

VectorXd bend(const JointFitState &j, int way, double vc)
{
    return (way == 0 ? 1 : -1) * j.rows.share[way].array() * (1 - (-j.rows.speed[way].array() / vc).exp());
}

// Least squares from products of runs, columns scaled to one size; a column nothing excites stays at zero.
VectorXd solve_products(MatrixXd a, VectorXd b)
{
    const VectorXd scale = a.diagonal().unaryExpr([](double d) { return d > 0 ? 1 / std::sqrt(d) : 0; });
    a = scale.asDiagonal() * a * scale.asDiagonal();
    a.diagonal().array() += 1e-9;
    return scale.asDiagonal() * a.llt().solve(scale.asDiagonal() * b);
}

// Best speed of each direction's bend, one after the other, beside both straight lines.
void search_bends(const JointFitState &j, const VectorXd &y, MatrixXd *x)
{
    *x = powers(j, 1);
    for (int way = 0; way < 2; way++) {
        MatrixXd with(x->rows(), x->cols() + 1);
        with.leftCols(x->cols()) = *x;
        const MatrixXd base = x->transpose() * *x;
        const VectorXd base_y = x->transpose() * y;
        double best = -1, vc = vc_least_radps;
        for (int k = 0; k <= vc_grid; k++) {
            const double at = vc_least_radps * std::pow(vc_most_radps / vc_least_radps, double(k) / vc_grid);
            const VectorXd column = bend(j, way, at);
            MatrixXd a(with.cols(), with.cols());
            VectorXd b(with.cols());
            const VectorXd cross = x->transpose() * column;
            a << base, cross, cross.transpose(), column.squaredNorm();
            b << base_y, column.dot(y);
            const double explained = solve_products(a, b).dot(b);
            if (explained > best) {
                best = explained;
                vc = at;
            }
        }
        with.rightCols(1) = bend(j, way, vc);
        *x = with;
    }
}

FrictionScore score(const char *name, int numbers, const MatrixXd &x, const VectorXd &y,
                    const JointRows &rows)
{
    std::vector<MatrixXd> a;
    std::vector<VectorXd> b;
    MatrixXd all = MatrixXd::Zero(x.cols(), x.cols());
    VectorXd right = VectorXd::Zero(x.cols());
    for (std::size_t r = 0; r + 1 < rows.run_begin.size(); r++) {
        const Index from = rows.run_begin[r], count = rows.run_begin[r + 1] - from;
        a.push_back(x.middleRows(from, count).transpose() * x.middleRows(from, count));
        b.push_back(x.middleRows(from, count).transpose() * y.segment(from, count));
        all += a.back();
        right += b.back();
    }
    FrictionScore out{name, numbers, 0, 0, 0};
    const double left = (y - x * solve_products(all, right)).squaredNorm(), n = static_cast<double>(y.size());
    out.rms_nm = std::sqrt(left / n);
    double sum = 0;
    for (std::size_t r = 0; r < a.size(); r++) {
        const Index from = rows.run_begin[r], count = rows.run_begin[r + 1] - from;
        const VectorXd theta = solve_products(all - a[r], right - b[r]);
        sum += (y.segment(from, count) - x.middleRows(from, count) * theta).squaredNorm();
    }
    out.left_out_nm = a.size() > 1 ? std::sqrt(sum / n) : std::nan("");
    // rows of one stretch of time are one piece of evidence: friction's residual is coloured
    const double pieces = static_cast<double>(std::max<std::size_t>(rows.piece_begin.size(), 2) - 1);
    out.bic = pieces * std::log(std::max(left / n, 1e-18)) + numbers * std::log(pieces);
    return out;
}

} // namespace

std::vector<FrictionScore> compare_friction(const Problem &p, const JointFitState &j)
{
    const VectorXd y = friction_torque(p, j);
    MatrixXd bends;
    search_bends(j, y, &bends);
    return {score("viscous", 4, powers(j, 1), y, j.rows), score("cubic", 8, powers(j, 3), y, j.rows),
            score("stribeck", 8, bends, y, j.rows)};
}

} // namespace hdt::fit
