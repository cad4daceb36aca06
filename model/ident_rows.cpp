// SPDX-License-Identifier: Apache-2.0
//
// Rows of identification.  Fast columns (ripple) are averaged from full rate, exactly as the torque
// is; rigid-body columns are evaluated at the mean state of the block, which moves little in 10 ms.
//
// Owns: assembling rows run by run.
// Never: solves anything.
#include "model/ident_rows.hpp"

#include <algorithm>
#include <cmath>
#include <future>

#include "model/rbd.hpp"

namespace hdt::fit {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index pieces_wanted = 12; // stretches of time in all runs together

// Mean state of every block, all rows of it.
struct BlockState { MatrixXd q, v, a; };

BlockState block_state(const Conditioned &c)
{
    Index blocks = static_cast<Index>(c.block_begin.size()) - 1, joints = c.q.cols();
    BlockState s{MatrixXd(blocks, joints), MatrixXd(blocks, joints), MatrixXd(blocks, joints)};
    for (Index b = 0; b < blocks; b++) {
        Index lo = c.block_begin[static_cast<std::size_t>(b)];
        Index n = c.block_begin[static_cast<std::size_t>(b + 1)] - lo;
        s.q.row(b) = c.q.middleRows(lo, n).colwise().mean();
        s.v.row(b) = c.v.middleRows(lo, n).colwise().mean();
        s.a.row(b) = c.a.middleRows(lo, n).colwise().mean();
    }
    return s;
}

// Gravity torque of the payload alone: its mass is known and takes no part in the scale.
VectorXd payload_gravity(const hdt_arm &with, const VectorXd &q)
{
    hdt_arm without = with;
    without.payload_kg = 0;
    return rbd::gravity(with, q) - rbd::gravity(without, q);
}

// Shared columns of all joints, [joint] -> blocks x columns; gravity is filled in by the caller.
std::vector<MatrixXd> chain_columns(const hdt_arm &arm, const BlockState &s)
{
    Index blocks = s.q.rows(), n = arm.joints, columns = shared_columns(arm);
    std::vector<MatrixXd> out(static_cast<std::size_t>(n), MatrixXd::Zero(blocks, columns));
    bool known = masses_known(arm);
    for (Index b = 0; b < blocks; b++) {
        if (known) {
            if (arm.payload_kg <= 0)
                continue;
            VectorXd g = payload_gravity(arm, s.q.row(b));
            for (Index j = 0; j < n; j++)
                out[static_cast<std::size_t>(j)](b, 0) = -g[j];
            continue;
        }
        MatrixXd r = rbd::regressor(arm, s.q.row(b), s.v.row(b), s.a.row(b));
        for (Index j = 0; j < n; j++) {
            out[static_cast<std::size_t>(j)].row(b).head(10 * n) = r.row(j).head(10 * n);
            out[static_cast<std::size_t>(j)](b, 10 * n + j) = s.a(b, j);
        }
    }
    return out;
}

// A line that passes faster than this is carried by the rotor's inertia, not by the motor: a speed
// loop's torque shows only part of it, and the smoothed acceleration does not follow either.
constexpr double kRippleHz = 25;

MatrixXd ripple_columns(const hdt_arm_joint &joint, const Conditioned &c, int j)
{
    MatrixXd out(c.t_s.size(), 2 * joint.ripples);
    for (int k = 0; k < joint.ripples; k++) {
        Eigen::ArrayXd angle = joint.ripple[k].order_rev * c.q.col(j).array();
        double v_max_radps = 2 * M_PI * kRippleHz / joint.ripple[k].order_rev;
        Eigen::ArrayXd shown = c.dir.col(j).array() * (c.v.col(j).array().abs() < v_max_radps).cast<double>();
        out.col(2 * k) = angle.sin() * shown;
        out.col(2 * k + 1) = angle.cos() * shown;
    }
    return out;
}

void append(VectorXd *to, const VectorXd &x)
{
    Index n = to->size();
    to->conservativeResize(n + x.size());
    to->tail(x.size()) = x;
}

void append(MatrixXd *to, const MatrixXd &x)
{
    Index n = to->rows();
    to->conservativeResize(n + x.rows(), x.cols());
    to->bottomRows(x.rows()) = x;
}

// Torque of the reported channel in true units, less every term the fit does not touch.
void torque_rows(const hdt_arm_joint &joint, const Conditioned &c, const MatrixXd &terms, int j, JointRows *r)
{
    MatrixXd mean = c.block_means(j, terms);
    VectorXd measured = joint.torque_gain * c.block_mean(j, c.tau.col(j));
    VectorXd declared = mean.rowwise().sum();
    VectorXd fitted = mean.col(HDT_TERM_FRICTION) + mean.col(HDT_TERM_RIPPLE) + mean.col(HDT_TERM_STIFFNESS);
    append(&r->measured, measured);
    append(&r->declared, declared);
    append(&r->friction, measured - declared + mean.col(HDT_TERM_FRICTION));
    append(&r->load, mean.col(HDT_TERM_GRAVITY));
    append(&r->y, measured - declared + fitted);
}

void direction_rows(const Conditioned &c, int j, JointRows *r)
{
    for (int way = 0; way < 2; way++) {
        VectorXd moving = (c.dir.col(j).array() == (way == 0 ? 1 : -1)).cast<double>();
        VectorXd share = c.block_mean(j, moving);
        VectorXd speed = c.block_mean(j, moving.cwiseProduct(c.v.col(j).cwiseAbs()));
        append(&r->share[way], share);
        append(&r->speed[way],
               (share.array() > 0).select(speed.array() / share.array().max(1e-12), 0).matrix());
    }
}

// Stretches of equal duration, so many that all runs together have enough of them.  A run without
// rows of this joint counts too: clusters of all joints then mean the same stretch of time.
void mark(Index rows, Index begin, std::size_t runs, JointRows *r)
{
    r->run_begin.push_back(begin);
    Index many = static_cast<Index>(runs), pieces = std::max<Index>(1, (pieces_wanted + many - 1) / many);
    for (Index p = 0; p < pieces; p++)
        r->piece_begin.push_back(begin + rows * p / pieces);
}

void add_run(const hdt_arm &arm, const Conditioned &c, std::size_t runs, bool with_columns,
             std::vector<JointRows> *out)
{
    hdt_arm mine = arm_for_run(arm, c);
    std::vector<MatrixXd> terms = declared_terms(arm, c), chain;
    if (with_columns)
        chain = chain_columns(mine, block_state(c));
    for (int j = 0; j < arm.joints; j++) {
        JointRows &r = (*out)[static_cast<std::size_t>(j)];
        std::vector<Index> which = c.blocks(j);
        const hdt_arm_joint &joint = arm.joint[j];
        if (c.present[static_cast<std::size_t>(j)])
            r.masked += static_cast<std::size_t>(c.t_s.size() - c.valid.col(j).count());
        Index begin = r.rows(), rows = static_cast<Index>(which.size());
        mark(rows, begin, runs, &r);
        if (rows == 0)
            continue;
        torque_rows(joint, c, terms[static_cast<std::size_t>(j)], j, &r);
        direction_rows(c, j, &r);
        append(&r.t_s, c.block_mean(j, c.t_s));
        append(&r.q, c.block_mean(j, c.q.col(j)));
        append(&r.v, c.block_mean(j, c.v.col(j)));
        if (!with_columns)
            continue;
        append(&r.ripple, c.block_means(j, ripple_columns(joint, c, j)));
        MatrixXd shared(rows, chain[0].cols());
        for (Index k = 0; k < rows; k++)
            shared.row(k) = chain[static_cast<std::size_t>(j)].row(which[static_cast<std::size_t>(k)]);
        if (masses_known(arm)) {
            // gravity of the links; it is in y as the declared term, with scale one
            shared.col(0) += r.load.tail(rows);
            r.y.tail(rows) += shared.col(0);
        }
        append(&r.shared, shared);
    }
}

} // namespace

bool masses_known(const hdt_arm &arm)
{
    for (int j = 0; j < arm.joints; j++)
        if (arm.joint[j].has_inertial)
            return true;
    return false;
}

Index shared_columns(const hdt_arm &arm) { return masses_known(arm) ? 1 : 11 * arm.joints; }

std::vector<Conditioned> condition_all(const std::vector<Run> &runs, const hdt_arm &arm,
                                       const ConditionOptions &options)
{
    std::vector<std::future<Conditioned>> work;
    for (const Run &run : runs)
        work.push_back(std::async(std::launch::async, [&] { return condition(run, arm, options); }));
    std::vector<Conditioned> out;
    for (auto &w : work)
        out.push_back(w.get());
    return out;
}

std::vector<JointRows> make_rows(const hdt_arm &arm, const std::vector<Conditioned> &runs, bool with_columns)
{
    std::vector<JointRows> out(static_cast<std::size_t>(arm.joints));
    for (std::size_t j = 0; j < out.size(); j++)
        out[j].joint = static_cast<int>(j);
    for (const Conditioned &c : runs)
        add_run(arm, c, runs.size(), with_columns, &out);
    for (JointRows &r : out) {
        r.run_begin.push_back(r.rows());
        r.piece_begin.push_back(r.rows());
    }
    return out;
}

} // namespace hdt::fit
