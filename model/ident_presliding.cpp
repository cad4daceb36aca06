// SPDX-License-Identifier: Apache-2.0
//
// Right after a reversal friction still has its old sign: the springs of gear and wave generator have
// to unwind.  -dir T exp(-s / s0), s the travel since the turning point; s0 by a grid over its
// logarithm, T linear.  Sigma from leaving out one run after the other.
//
// Owns: one scalar search a joint.
// Never: names an effect (diagnosis does).
#include "model/ident_presliding.hpp"

#include <algorithm>
#include <cmath>

#include "model/ident_model.hpp"

namespace hdt::fit {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double travel_least_rad = 1e-4, travel_most_rad = 0.02;
constexpr int grid = 40;
constexpr double clear_sigmas = 3;
constexpr double worth_share = 0.15; // of the squares near reversals
constexpr double near_share = 0.05;  // a block where the term is below this share of its size is far

double travel_at(double step)
{
    return travel_least_rad * std::pow(travel_most_rad / travel_least_rad, step / (grid - 1));
}

// Sums over one run, for every travel of the grid.
struct Sums { VectorXd xy = VectorXd::Zero(grid), xx = VectorXd::Zero(grid), yy = VectorXd::Zero(grid); };

Sums sums_of(const Conditioned &c, const hdt_arm_joint &joint, int j, const MatrixXd &terms)
{
    Sums out;
    if (!c.present[static_cast<std::size_t>(j)])
        return out;
    const VectorXd total = terms.rowwise().sum();
    const VectorXd y = c.block_mean(j, joint.torque_gain * c.tau.col(j) - total);
    for (int k = 0; k < grid; k++) {
        // from rest it is not known how far friction had built up
        const VectorXd full = (c.built_up.col(j).array() >= 1).cast<double>() * -c.dir.col(j).array()
                              * (-c.travel.col(j).array() / travel_at(k)).exp();
        const VectorXd x = c.block_mean(j, full);
        out.xy[k] = x.dot(y);
        out.xx[k] = x.squaredNorm();
        out.yy[k] = (x.array().abs() > near_share).select(y.array(), 0.0).matrix().squaredNorm();
    }
    return out;
}

struct Best { double torque = 0, travel = 0, share = 0; };

// Size and travel that explain most; the travel between grid points from the parabola through three.
Best best_of(const Sums &s)
{
    VectorXd gain = VectorXd::Zero(grid);
    for (int k = 0; k < grid; k++)
        if (s.xx[k] > 0 && s.xy[k] > 0)
            gain[k] = s.xy[k] * s.xy[k] / s.xx[k];
    Index at = 0;
    if (!(gain.maxCoeff(&at) > 0))
        return {};
    double shift = 0;
    if (at > 0 && at < grid - 1) {
        const double bend = gain[at - 1] - 2 * gain[at] + gain[at + 1];
        shift = bend < 0 ? 0.5 * (gain[at - 1] - gain[at + 1]) / bend : 0;
    }
    const Index other = shift < 0 ? at - 1 : std::min<Index>(at + 1, grid - 1);
    const double there = s.xx[other] > 0 ? s.xy[other] / s.xx[other] : s.xy[at] / s.xx[at];
    const double here = s.xy[at] / s.xx[at], part = std::fabs(shift);
    return {here + part * (there - here), travel_at(static_cast<double>(at) + shift), gain[at] / s.yy[at]};
}

// From the sums of every run, those of one joint.
std::vector<FitParameter> fit_joint(const std::vector<Sums> &each, int number, ArmFile *file)
{
    Sums all;
    for (const Sums &s : each) {
        all.xy += s.xy;
        all.xx += s.xx;
        all.yy += s.yy;
    }
    const Best best = best_of(all);
    double torque_square = 0, travel_square = 0;
    const double n = static_cast<double>(each.size());
    for (const Sums &s : each) { // jackknife over runs
        Sums rest = all;
        rest.xy -= s.xy;
        rest.xx -= s.xx;
        rest.yy -= s.yy;
        const Best b = best_of(rest);
        torque_square += (b.torque - best.torque) * (b.torque - best.torque) * (n - 1) / n;
        travel_square += (b.travel - best.travel) * (b.travel - best.travel) * (n - 1) / n;
    }
    const std::string array = "joint." + std::to_string(number) + ".effect";
    if (const int old = file->find(array, "presliding"))
        file->erase(array + "." + std::to_string(old));
    const hdt_arm_joint &joint = file->arm().joint[number - 1];
    const double sigma = std::sqrt(torque_square), travel_sigma = std::sqrt(travel_square);
    // what is missing at the turning point is friction the one way still, instead of the other
    const double most = 2 * std::max(stribeck_nm(joint.friction[0], 0), stribeck_nm(joint.friction[1], 0));
    if (n < 2 || !(best.torque > clear_sigmas * sigma) || best.share < worth_share || best.torque > most)
        return {};
    file->append(array, {{"id", "presliding"}},
                 {{"torque", quantity({best.torque}, "N m", {sigma}, "")},
                  {"travel", quantity({best.travel}, "rad", {travel_sigma}, "")}});
    const std::string key = array + "." + std::to_string(file->count(array)) + ".";
    return {{key + "torque", "N m", best.torque, sigma, true},
            {key + "travel", "rad", best.travel, travel_sigma, true}};
}

} // namespace

std::vector<std::vector<FitParameter>> fit_presliding(const std::vector<Run> &runs,
                                                      const std::vector<int> &joints, double block_s,
                                                      ArmFile *file)
{
    hdt_arm arm = file->arm();
    for (int number : joints)
        arm.joint[number - 1].presliding_nm = arm.joint[number - 1].presliding_rad = 0;
    ConditionOptions how;
    how.block_s = block_s;
    how.soft_margin_nm = fall_margin_nm;
    std::vector<std::vector<Sums>> sums(joints.size());
    for (const Conditioned &c : condition_all(runs, arm, how)) {
        const std::vector<MatrixXd> terms = declared_terms(arm, c);
        for (std::size_t k = 0; k < joints.size(); k++) {
            const int j = joints[k] - 1;
            sums[k].push_back(sums_of(c, arm.joint[j], j, terms[static_cast<std::size_t>(j)]));
        }
    }
    std::vector<std::vector<FitParameter>> out;
    for (std::size_t k = 0; k < joints.size(); k++)
        out.push_back(fit_joint(sums[k], joints[k], file));
    return out;
}

} // namespace hdt::fit
