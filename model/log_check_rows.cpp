// SPDX-License-Identifier: Apache-2.0
// See log_check_rows.hpp.
#include "model/log_check_rows.hpp"

#include <algorithm>
#include <cmath>

#include "model/rbd.hpp"
#include "model/terms.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double about_block_s = 0.02;
constexpr Index moving_min = 60;        // blocks, about a second
constexpr double moving_share = 0.1;    // of the joint's own quick motion
constexpr double both_ways_share = 0.05; // of the moving blocks, at least, in the rarer direction
// without masses the gravity of any goes beside friction, in many columns
constexpr double both_ways_massless = 0.15;
constexpr int turns_massless = 4;
constexpr Index rows_a_column = 10;
constexpr double moving_floor_radps = 0.004;

struct Block { std::size_t begin, end; };

// Blocks that follow each other without a gap, stretch by stretch.
std::vector<std::vector<Block>> stretches(const std::vector<double> &t, double step_s, std::size_t per_block)
{
    const double gap_s = 5 * step_s;
    std::vector<std::vector<Block>> out(1);
    std::size_t begin = 0;
    for (std::size_t i = 1; i <= t.size(); i++) {
        const bool gap = i < t.size() && t[i] - t[i - 1] > gap_s;
        if (i == t.size() || gap || i - begin == per_block) {
            if (i - begin == per_block)
                out.back().push_back({begin, i});
            begin = i;
        }
        if (gap)
            out.emplace_back();
    }
    return out;
}

double mean(const std::vector<double> &x, Block b)
{
    double sum = 0;
    for (std::size_t i = b.begin; i < b.end; i++)
        sum += x[i];
    return sum / static_cast<double>(b.end - b.begin);
}

// Means of one column over all blocks that have neighbours; rate and second difference beside.
void column(const Run &run, const std::vector<std::vector<Block>> &parts, const std::vector<double> &x,
            Index rows, VectorXd *value, VectorXd *rate, VectorXd *second)
{
    if (x.size() != run.rows())
        return;
    value->resize(rows);
    VectorXd d1(rows), d2(rows);
    Index k = 0;
    for (const std::vector<Block> &part : parts)
        for (std::size_t b = 1; b + 1 < part.size(); b++, k++) {
            const Block before = part[b - 1], here = part[b], after = part[b + 1];
            const double t0 = mean(run.t_s, before), t1 = mean(run.t_s, here), t2 = mean(run.t_s, after);
            const double x0 = mean(x, before), x1 = mean(x, here), x2 = mean(x, after);
            d1[k] = (x2 - x0) / (t2 - t0);
            d2[k] = 2 * ((x2 - x1) / (t2 - t1) - (x1 - x0) / (t1 - t0)) / (t2 - t0);
            // the rate is a mean over two blocks: so is what it is held against
            (*value)[k] = rate ? x1 : (x0 + 2 * x1 + x2) / 4;
        }
    if (rate)
        *rate = d1;
    if (second)
        *second = d2;
}

// The model's friction, joint-signed; zero when it has none.
VectorXd friction_of(const hdt_arm_joint &joint, const VectorXd &v)
{
    VectorXd out = VectorXd::Zero(v.size());
    for (Index i = 0; joint.has_friction && i < v.size(); i++)
        out[i] = (v[i] < 0 ? -1 : 1) * stribeck_nm(joint.friction[v[i] < 0], std::fabs(v[i]));
    return out;
}

struct Fit { VectorXd coefficient; double left_nm2 = 0; };

Fit least_squares(const MatrixXd &x, const VectorXd &y)
{
    // columns of one size, so that what counts as dependent does not hang on units
    VectorXd size = x.colwise().norm();
    for (double &s : size)
        s = s > 0 ? s : 1;
    const MatrixXd scaled = x * size.cwiseInverse().asDiagonal();
    Eigen::ColPivHouseholderQR<MatrixXd> qr(scaled.rows(), scaled.cols());
    qr.setThreshold(1e-6);
    qr.compute(scaled);
    const VectorXd c = qr.solve(y);
    return {c.cwiseQuotient(size), (y - scaled * c).squaredNorm()};
}

MatrixXd pick(const MatrixXd &x, const std::vector<Index> &rows)
{
    MatrixXd out(static_cast<Index>(rows.size()), x.cols());
    for (std::size_t i = 0; i < rows.size(); i++)
        out.row(static_cast<Index>(i)) = x.row(rows[i]);
    return out;
}

std::vector<Index> moving_rows(const VectorXd &rate, int *turns)
{
    const double least = std::max(moving_floor_radps, moving_share * quantile_abs(rate, 0.95));
    std::vector<Index> rows;
    for (Index i = 1; i + 1 < rate.size(); i++)
        if (std::fabs(rate[i]) > least && rate[i - 1] * rate[i] > 0 && rate[i] * rate[i + 1] > 0) {
            *turns += !rows.empty() && rate[rows.back()] * rate[i] < 0;
            rows.push_back(i);
        }
    return rows;
}

double share_r(double without, double with)
{
    return without > 0 ? std::sqrt(std::max(0.0, 1 - with / without)) : 0;
}

} // namespace

CheckRows check_rows(const Run &run, const hdt_arm &arm)
{
    CheckRows out;
    out.joint.resize(static_cast<std::size_t>(arm.joints));
    if (run.rows() < 3)
        return out;
    std::vector<double> dt(run.rows() - 1);
    for (std::size_t i = 0; i < dt.size(); i++)
        dt[i] = run.t_s[i + 1] - run.t_s[i];
    std::nth_element(dt.begin(), dt.begin() + static_cast<std::ptrdiff_t>(dt.size() / 2), dt.end());
    const double step_s = dt[dt.size() / 2];
    const double per_block = std::max(1.0, std::round(about_block_s / step_s));
    out.block_s = per_block * step_s;
    const auto parts = stretches(run.t_s, step_s, static_cast<std::size_t>(per_block));
    for (const auto &part : parts)
        out.rows += std::max<Index>(0, static_cast<Index>(part.size()) - 2);
    for (std::size_t j = 0; j < std::min(run.joint.size(), out.joint.size()); j++) {
        const Run::Joint &from = run.joint[j];
        CheckColumns &to = out.joint[j];
        if (!from.present)
            continue;
        column(run, parts, from.q_rad, out.rows, &to.q, &to.rate, &to.second);
        column(run, parts, from.qref_rad, out.rows, &to.qref, nullptr, nullptr);
        column(run, parts, from.vref_radps, out.rows, &to.vref, nullptr, nullptr);
        column(run, parts, from.v_radps, out.rows, &to.v, nullptr, nullptr);
        VectorXd value;
        column(run, parts, from.v_radps, out.rows, &value, &to.v_rate, nullptr);
        column(run, parts, from.tau_nm, out.rows, &to.tau, &to.tau_rate, nullptr);
    }
    return out;
}

Match match(const VectorXd &x, const VectorXd &y)
{
    const double xx = x.squaredNorm(), yy = y.squaredNorm(), xy = x.dot(y);
    if (!(xx > 0) || !(yy > 0))
        return {};
    return {xy / xx, xy / std::sqrt(xx * yy)};
}

Match match_centred(const VectorXd &x, const VectorXd &y)
{
    return match((x.array() - x.mean()).matrix(), (y.array() - y.mean()).matrix());
}

double quantile_abs(const VectorXd &x, double share)
{
    if (x.size() == 0)
        return 0;
    std::vector<double> a(static_cast<std::size_t>(x.size()));
    for (std::size_t i = 0; i < a.size(); i++)
        a[i] = std::fabs(x[static_cast<Index>(i)]);
    auto at = a.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(a.size() - 1));
    std::nth_element(a.begin(), at, a.end());
    return *at;
}

LoadColumns load_columns(const hdt_arm &arm, const CheckRows &rows)
{
    const auto n = static_cast<std::size_t>(arm.joints);
    const bool masses =
        std::any_of(arm.joint, arm.joint + n, [](const hdt_arm_joint &j) { return j.has_inertial != 0; });
    LoadColumns out;
    out.any.assign(n, MatrixXd::Zero(rows.rows, 4 * (arm.joints + 1)));
    out.nm.assign(masses ? n : 0, VectorXd::Zero(rows.rows));
    VectorXd q = VectorXd::Zero(arm.joints), v = q, a = q;
    const VectorXd still = q;
    for (Index i = 0; i < rows.rows; i++) {
        for (std::size_t j = 0; j < n; j++) {
            const CheckColumns &c = rows.joint[j];
            if (c.q.size() == 0)
                continue;
            q[static_cast<Index>(j)] = c.q[i];
            v[static_cast<Index>(j)] = c.rate[i];
            a[static_cast<Index>(j)] = c.second[i];
        }
        const MatrixXd y = rbd::regressor(arm, q, still, still);
        const VectorXd tau = masses ? rbd::inverse_dynamics(arm, q, v, a) : VectorXd();
        for (std::size_t j = 0; j < n; j++) {
            for (Index body = 0; body <= arm.joints; body++)
                out.any[j].row(i).segment(4 * body, 4) = y.row(static_cast<Index>(j)).segment(10 * body, 4);
            // what the log holds of it: effects adopted count
            if (masses) {
                const hdt_arm_joint &jt = arm.joint[j];
                const auto col = static_cast<Index>(j);
                const double gain = jt.torque_gain > 0 ? jt.torque_gain : 1;
                const double rotor = reflected_inertia_kgm2(jt) * a[col];
                out.nm[j][i] = (tau[col] + rotor + spring_nm(jt, q[col])) / gain;
            }
        }
    }
    return out;
}

TorqueShare torque_share(const VectorXd &tau_nm, const hdt_arm_joint &joint,
                         const CheckColumns &motion, const LoadColumns &load, std::size_t k)
{
    TorqueShare out;
    const std::vector<Index> rows = moving_rows(motion.rate, &out.turns);
    out.moving = static_cast<Index>(rows.size());
    if (out.moving < moving_min)
        return out;
    const VectorXd y = pick(tau_nm, rows), v = pick(motion.rate, rows), dir = v.cwiseSign();
    out.forth_share = 0.5 * (1 + dir.mean());
    out.friction_model_nm = friction_of(joint, v).cwiseAbs().mean();

    // friction beside the load: the model's, or without masses the gravity of any
    const bool masses = !load.nm.empty();
    const MatrixXd held = masses ? MatrixXd(pick(load.nm[k], rows)) : pick(load.any[k], rows);
    const Index loads = held.cols();
    MatrixXd x(out.moving, loads + 4);
    x << held, VectorXd::Ones(out.moving), pick(motion.second, rows), v, dir;
    const Fit with = least_squares(x, y), without = least_squares(x.leftCols(loads + 2), y);
    const bool both_ways = std::min(out.forth_share, 1 - out.forth_share) >
                           (masses ? both_ways_share : both_ways_massless);
    const bool enough = masses || (out.turns >= turns_massless && out.moving >= rows_a_column * x.cols());
    if (both_ways && enough) {
        out.friction_nm = with.coefficient[loads + 3] + with.coefficient[loads + 2] * v.cwiseAbs().mean();
        out.friction_r = share_r(without.left_nm2, with.left_nm2);
    }
    if (!masses)
        return out;

    const Fit less = least_squares(x.rightCols(4), y), own = least_squares(x.rightCols(4), held.col(0));
    out.load = with.coefficient[0];
    out.load_r = share_r(less.left_nm2, with.left_nm2);
    out.load_sd_nm = std::sqrt(own.left_nm2 / static_cast<double>(out.moving));
    const Match m = match(held.col(0) + friction_of(joint, v), y);
    out.whole = m.factor;
    out.whole_r = m.r;
    return out;
}

double torque_left(const VectorXd &tau_nm, const hdt_arm_joint &joint, const CheckColumns &motion,
                   const VectorXd &load_nm, double most)
{
    int turns = 0;
    const std::vector<Index> rows = moving_rows(motion.rate, &turns);
    if (static_cast<Index>(rows.size()) < moving_min)
        return -1;
    const VectorXd y = pick(tau_nm, rows), v = pick(motion.rate, rows);
    const VectorXd expected = pick(load_nm, rows) + friction_of(joint, v);
    const double size = std::clamp(match(expected, y).factor, 1 / most, most);
    const double all = y.squaredNorm();
    return all > 0 ? std::min(2.0, (y - size * expected).squaredNorm() / all) : 2;
}

} // namespace hdt
