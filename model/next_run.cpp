// SPDX-License-Identifier: Apache-2.0
//
// Owns: predicted separation of effect and rivals over tasks (see next_run.hpp).
// Never: runs anything.
#include "model/next_run.hpp"

#include <algorithm>
#include <cmath>

#include "model/task.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kRate_hz = 50, kBlock_s = 0.1; // what an effect shows over a task needs no more
constexpr Index kRowsMax = 30000;
constexpr double kKnown_kg = 2;

struct Plan { std::string task; double payload_kg; };

std::vector<Plan> plans(const hdt_arm &arm, int joint)
{
    const std::string j = std::to_string(joint + 1);
    std::vector<Plan> out;
    for (const char *seed : {"11", "12", "13"})
        out.push_back({std::string("excite:seed=") + seed + ",seconds=40", 0});
    std::vector<std::string> poses = {""};
    for (int k = 0; k < std::min(arm.joints, 4); ++k)
        if (k != joint)
            poses.push_back(",q" + std::to_string(k + 1) + "=1.57");
    for (const std::string &pose : poses)
        for (const char *speed : {"0.05", "0.1", "0.3"})
            out.push_back({"sweep:joint=" + j + ",speed=" + speed + pose, 0});
    out.push_back({"friction:joint=" + j, 0});
    out.push_back({"trapezoid:joint=" + j, 0});
    out.push_back({"excite:seed=11,seconds=40", kKnown_kg});
    out.push_back({"sweep:joint=" + j + ",speed=0.1", kKnown_kg});
    return out;
}

// Rows a task would give, torque aside; empty when the arm cannot do it or it is too long.
BlockRows rows_of(const hdt_arm &arm, int joint, const Plan &plan)
{
    BlockRows none;
    none.y_nm = VectorXd(0);
    if (plan.payload_kg > 0 && !arm.joint[0].has_inertial)
        return none;
    hdt_arm loaded = arm;
    if (plan.payload_kg > 0) {
        loaded.payload_kg += plan.payload_kg;
        std::fill(loaded.payload_com_m, loaded.payload_com_m + 3, 0.0);
        loaded.payload_com_m[2] = 0.05;
    }
    try {
        const Reference ref = make_task(loaded, plan.task, kRate_hz);
        if (ref.q_rad.rows() > kRowsMax)
            return none;
        Run run;
        run.path = plan.task;
        for (Index t = 0; t < ref.q_rad.rows(); ++t)
            run.t_s.push_back(static_cast<double>(t) / ref.rate_hz);
        run.joint.resize(static_cast<std::size_t>(ref.q_rad.cols()));
        for (Index k = 0; k < ref.q_rad.cols(); ++k) {
            Run::Joint &to = run.joint[static_cast<std::size_t>(k)];
            to.present = true;
            const VectorXd q = ref.q_rad.col(k);
            to.q_rad.assign(q.data(), q.data() + q.size());
            to.tau_nm.assign(run.t_s.size(), 0.0);
        }
        ConditionOptions co;
        co.block_s = kBlock_s;
        return block_rows(loaded, condition(run, loaded, co), run, false)[static_cast<std::size_t>(joint)];
    } catch (const InputError &) {
        return none; // not a task for this arm
    }
}

// Least-squares coefficients of a rival for the effect's torque on the logs at hand, friction free.
// Returns what is left, sum of squares.
double imitate(const std::vector<BlockRows> &rows, const std::vector<VectorXd> &torque, const Family &f,
               Point at, VectorXd *theta)
{
    MatrixXd a;
    VectorXd b;
    double square = 0;
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const MatrixXd x = f.columns(rows[r], at), n = nuisance_columns(rows[r]);
        MatrixXd m(x.rows(), x.cols() + n.cols());
        m << x, n;
        if (r == 0) {
            a = MatrixXd::Zero(m.cols(), m.cols());
            b = VectorXd::Zero(m.cols());
        }
        a += m.transpose() * m;
        b += m.transpose() * torque[r];
        square += torque[r].squaredNorm();
    }
    const VectorXd scale = a.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
    a = (scale.asDiagonal() * a * scale.asDiagonal()).eval();
    a.diagonal().array() += 1e-8;
    const VectorXd fit = scale.asDiagonal() * a.llt().solve(scale.asDiagonal() * b);
    *theta = fit.head(fit.size() - 4);
    return square - fit.dot(b);
}

struct Rival { const Family *family; Point at; VectorXd theta; };

} // namespace

std::string host_line(const hdt_arm &arm, const std::string &task)
{
    return std::string("hdt host --model ") + (arm.path[0] ? arm.path : "MODEL") + " --bus BUS --task " + task
           + " --out LOG.csv";
}

NextRun choose_next_run(const hdt_arm &arm, const JointWork &w, const std::vector<std::string> &rivals,
                        const std::function<VectorXd(const BlockRows &)> &effect_nm)
{
    std::vector<VectorXd> torque;
    for (const BlockRows &b : w.fit)
        torque.push_back(effect_nm(b));
    std::vector<Rival> others;
    for (const Family &f : w.families) {
        if (std::find(rivals.begin(), rivals.end(), f.id) == rivals.end() || f.own_phase)
            continue;
        Rival best{&f, {}, {}};
        double least = 1e300;
        for (Point at : f.grid) {
            VectorXd theta;
            const double left = imitate(w.fit, torque, f, at, &theta);
            if (left < least) {
                least = left;
                best = {&f, at, theta};
            }
        }
        if (least < 1e300)
            others.push_back(best);
    }
    NextRun out;
    if (others.empty())
        return out;
    const auto separation = [&](const std::vector<BlockRows> &rows, std::string *closest) {
        double least = 1e300;
        for (const Rival &o : others) {
            const double apart = reducible_rms(rows, [&](const BlockRows &b) -> VectorXd {
                return effect_nm(b) - o.family->columns(b, o.at) * o.theta;
            }) / std::max(w.floor_nm, 1e-9);
            if (apart < least) {
                least = apart;
                *closest = o.family->id;
            }
        }
        return least;
    };
    out.at_hand = separation(w.fit, &out.rival);
    for (const Plan &p : plans(arm, w.joint)) {
        const BlockRows rows = rows_of(arm, w.joint, p);
        if (rows.size() < 20)
            continue;
        std::string closest;
        const double apart = separation({rows}, &closest);
        // a task with a known mass takes a hand: it must be worth it
        if (!out.task.empty() && apart <= out.separation * (p.payload_kg > 0 ? 1.2 : 1.02))
            continue;
        out.task = p.task;
        out.payload_kg = p.payload_kg;
        out.separation = apart;
        out.rival = closest;
    }
    return out;
}

} // namespace hdt
