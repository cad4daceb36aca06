// SPDX-License-Identifier: Apache-2.0
//
// Where the soft wind-up lines join: the loads that leave the least residual, by variable projection
// over a grid and then ever smaller steps.  A knot stays on its side of load 0.
//
// Owns: the search for knots.
// Never: decides whether a joint has such lines.
#include <algorithm>
#include <array>
#include <cmath>

#include "model/ident_solve.hpp"

namespace hdt::fit {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr int grid = 14;
constexpr double least_step_nm = 0.02, least_gap_nm = 1;

using Knots = std::array<double, 2>; // t1 < t2

// One direction of one joint with everything but its two kinks projected out.
class Direction {
public:
    Direction(const Problem &p, const JointFitState &j, int way) : j_(j), way_(way)
    {
        JointModel rest = j.model;
        std::vector<Column> other;
        VectorXd target = residual(p, j);
        for (const Column &c : free_columns(rest, false)) {
            bool mine = (c.kind == KINK_1 || c.kind == KINK_2) && c.way == way;
            if (!mine)
                other.push_back(c);
        }
        for (int k = 0; k < kinks(); k++)
            target += j.model.kink[way][k] * column(j, {k == 0 ? KINK_1 : KINK_2, way, 0});
        MatrixXd x(j.rows.rows(), static_cast<Index>(other.size()));
        for (std::size_t k = 0; k < other.size(); k++)
            x.col(static_cast<Index>(k)) = column(j, other[k]);
        Eigen::HouseholderQR<MatrixXd> qr(x);
        q_ = qr.householderQ() * MatrixXd::Identity(x.rows(), x.cols());
        y_ = target - q_ * (q_.transpose() * target);
        for (Index i = 0; i < j.rows.rows(); i++)
            if (j.rows.share[way][i] > 0.5)
                load_.push_back(j.rows.load[i]);
        std::sort(load_.begin(), load_.end());
    }

    double low() const { return load_.front(); }
    double high() const { return load_.back(); }
    bool cut_off() const { return j_.model.cut_off[way_]; }

    // Squares explained by kinks there; negative where the loads do not span the lines.
    double gain(const Knots &at)
    {
        if (!(at[1] - at[0] >= least_gap_nm) || !spanned(at))
            return -1;
        hdt_arm_stiffness &k = j_.model.stiffness[way_];
        k.t1_nm = at[0];
        k.t2_nm = at[1];
        MatrixXd x(y_.size(), kinks());
        for (int knot = 0; knot < kinks(); knot++)
            x.col(knot) = column(j_, {knot == 0 ? KINK_1 : KINK_2, way_, 0});
        x -= q_ * (q_.transpose() * x);
        VectorXd score = x.transpose() * y_;
        Eigen::LDLT<MatrixXd> gram(x.transpose() * x);
        return gram.isPositive() ? score.dot(gram.solve(score)) : -1;
    }

private:
    int kinks() const { return cut_off() ? 1 : 2; }

    bool spanned(const Knots &at) const
    {
        auto first = std::lower_bound(load_.begin(), load_.end(), at[0]);
        auto second = std::upper_bound(load_.begin(), load_.end(), at[1]);
        Index below = first - load_.begin(), between = second - first, above = load_.end() - second;
        if (cut_off()) // the outer line is beyond all loads
            (at[0] > 0 ? above : below) = min_region_blocks;
        return std::min({below, between, above}) >= min_region_blocks;
    }

    JointFitState j_;
    int way_;
    MatrixXd q_;
    VectorXd y_;
    std::vector<double> load_;
};

// Of the grid over one side of load 0, and of the knots at hand, the best.
Knots coarse(Direction *d, const Knots &now)
{
    double from = now[0] > 0 ? 0 : d->low(), to = now[0] > 0 ? d->high() : 0;
    double best = d->gain(now), step = (to - from) / grid;
    Knots out = now;
    // a fall that is cut off ends with the loads
    const bool cut = d->cut_off(), up = now[0] > 0;
    for (int a = cut && !up ? 0 : 1; a < (cut && !up ? 1 : grid); a++)
        for (int b = cut && up ? grid : a + 1; b < (cut && up ? grid + 1 : grid); b++) {
            Knots at = {from + a * step, from + b * step};
            double gain = d->gain(at);
            if (gain > best) {
                best = gain;
                out = at;
            }
        }
    return out;
}

Knots refine(Direction *d, Knots at)
{
    double best = d->gain(at), side = at[0];
    if (best < 0) // no knots these loads span
        return at;
    for (double step = std::max(0.5, 0.5 * (at[1] - at[0])); step > least_step_nm; step /= 2)
        for (bool better = true; better;) {
            better = false;
            for (int k = 0; k < 2; k++)
                for (double sign : {-1.0, 1.0}) {
                    if (d->cut_off() && k == (side > 0 ? 1 : 0))
                        continue;
                    Knots to = at;
                    to[static_cast<std::size_t>(k)] += sign * step;
                    bool same_side = to[0] * side > 0 && to[1] * side > 0;
                    double gain = same_side ? d->gain(to) : -1;
                    if (gain > best && gain - best > 1e-9 * std::fabs(best)) {
                        best = gain;
                        at = to;
                        better = true;
                    }
                }
        }
    return at;
}

bool search_joint(const Problem &p, JointFitState *j)
{
    bool moved = false;
    for (int way = 0; way < 2; way++) {
        hdt_arm_stiffness &k = j->model.stiffness[way];
        Knots now = {k.t1_nm, k.t2_nm};
        if (!j->model.free_stiffness[way] || now[0] * now[1] <= 0)
            continue;
        Direction d(p, *j, way);
        Knots at = refine(&d, coarse(&d, now));
        moved = moved || std::fabs(at[0] - now[0]) + std::fabs(at[1] - now[1]) > 4 * least_step_nm;
        k.t1_nm = at[0];
        k.t2_nm = at[1];
    }
    return moved;
}

} // namespace

bool search_knots(Problem *p) { return search_joints(p, search_joint); }

} // namespace hdt::fit
