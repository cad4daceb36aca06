// SPDX-License-Identifier: Apache-2.0
//
// Torque against motion and the model.  Friction opposes motion whatever the masses are; a model's masses and
// friction may be wrong by a few times, never by the ratio.
//
// Owns: side, unit and sign of torque; joints exchanged as torque shows it.
// Never: believes a number of the model within a factor of four.
#include <algorithm>
#include <cmath>

#include "model/log_check_run.hpp"
#include "model/text.hpp"

namespace hdt::log_check {

using Eigen::VectorXd;

namespace {

constexpr double friction_r_massless = 0.85; // friction is seen apart from gravity of any masses
constexpr double whole_r = 0.7;             // the model's torque is recognised
constexpr double load_r = 0.9;              // the load is seen apart from friction,
constexpr double load_sd_share = 0.1;       // and is so much of it
constexpr double torque_most = 13;          // times the model's, or one in so many, before a log is to blame
constexpr double common_most = 4;           // the same when all joints are off alike:
constexpr double common_slack = 2.5;        // within this,
constexpr std::size_t common_joints = 3;    // and so many at least
constexpr double constant_least = 1.4;      // all off by one factor, as a wrong ratio makes them:
constexpr double constant_slack = 1.2;      // within this
constexpr double torque_slack = 2.5;        // factor around a side's or unit's number
constexpr double motor_slack = 2;           // of the motor's largest torque
constexpr double own_size = 2.5;            // what a model's torque may be wrong by where columns are right,
constexpr double other_size = 1.6;          // and where they are to be called exchanged
constexpr double own_left = 0.15;           // of a torque's square, unexplained: of each of two joints
constexpr double both_left = 0.4;           // and together
constexpr double other_left = 0.1;          // with the two exchanged
constexpr double other_share = 0.25;        // and as part of before

std::vector<Unit> torque_units(double ratio)
{
    const std::string n = number3(ratio);
    return {{1 / ratio, "motor-side", "multiply by the ratio " + n + " or export output-side torque",
             "1/ratio"},
            {ratio, "multiplied by the ratio twice", "divide by the ratio " + n, "the ratio"},
            {1000, "in thousandths of N m", "divide by 1000", "thousandths"},
            {1e-3, "in kN m", "multiply by 1000", "kN m"},
            {1000 / ratio, "motor-side and in thousandths of N m", "multiply by " + n + " and divide by 1000",
             "1000/ratio"},
            {1e-3 / ratio, "motor-side and in kN m", "multiply by 1000 and by " + n, "0.001/ratio"}};
}

const char *kind_of(const Unit &u, double ratio)
{
    const bool side = near(u.factor, ratio, 1.001) || near(u.factor, 1 / ratio, 1.001);
    return u.is.empty() ? "torque_scale" : side ? "torque_side" : "torque_units";
}

// How many times the model's torque the log's is, 0 where nothing tells.  Load and friction together, if they
// are recognised; friction alone must then agree that something is far off.
double torque_factor(const TorqueShare &s)
{
    const bool seen = s.friction_model_nm > 0 && s.friction_r > friction_r && s.friction_nm > 0;
    const double friction = seen ? s.friction_nm / s.friction_model_nm : 0;
    if (s.whole_r < whole_r)
        return friction;
    return seen && std::fabs(std::log(friction)) < std::fabs(std::log(s.whole)) ? friction : s.whole;
}

struct Spread { double least = 1, middle = 1, most = 1; bool enough = false; };

Spread spread_of(std::vector<double> factor)
{
    const auto unknown = [](double f) { return !(f > 0); };
    factor.erase(std::remove_if(factor.begin(), factor.end(), unknown), factor.end());
    std::sort(factor.begin(), factor.end());
    if (factor.size() < common_joints)
        return {};
    return {factor.front(), factor[factor.size() / 2], factor.back(), true};
}

bool alike(const Spread &s, double slack)
{
    return s.enough && near(s.least, s.middle, slack) && near(s.most, s.middle, slack);
}

} // namespace

void RunCheck::torque()
{
    if (!load().nm.empty() && places_by_torque())
        return;
    std::vector<TorqueShare> share(joints());
    std::vector<double> factor(joints(), 0);
    for (std::size_t j = 0; j < joints(); j++) {
        if (has(j))
            share[j] = torque_share(at(j).tau, joint(j), at(j), load(), j);
        if (!torque_sign(j, share[j]))
            factor[j] = torque_factor(share[j]);
    }
    torque_size(factor);
    // an angle turned round turns the load of other joints too
    const bool all_right = !any_told();
    for (std::size_t j = 0; j < joints() && all_right; j++)
        load_sign(j, share[j]);
    if (!any_told())
        torque_constant(share);
}

// Friction along the motion of this angle: the one or the other is turned round.
bool RunCheck::friction_drives(std::size_t j)
{
    const TorqueShare s = torque_share(at(j).tau, joint(j), at(j), load(), j);
    return s.friction_r > friction_r && s.friction_nm < 0;
}

// Does the model's torque fit the log better with this joint turned round, angle and all?
bool RunCheck::angle_turned(std::size_t j)
{
    if (load().nm.empty())
        return false;
    CheckRows other = rows_;
    CheckColumns &c = other.joint[j];
    c.q = -c.q;
    c.rate = -c.rate;
    c.second = -c.second;
    const LoadColumns there = load_columns(arm_, other);
    double torque = 0, angle = 0;
    for (std::size_t i = 0; i < joints(); i++)
        if (moves(i)) {
            const VectorXd tau = i == j ? VectorXd(-at(i).tau) : at(i).tau;
            torque += std::max(0.0, torque_left(tau, joint(i), at(i), load().nm[i], own_size));
            angle += std::max(0.0, torque_left(at(i).tau, joint(i), other.joint[i], there.nm[i], own_size));
        }
    return angle < 0.5 * torque;
}

bool RunCheck::torque_sign(std::size_t j, const TorqueShare &s)
{
    const double least_r = load().nm.empty() ? friction_r_massless : friction_r;
    if (s.friction_r < least_r || s.friction_nm >= 0)
        return false;
    const std::string size = ": friction acts along the motion with " + number3(-s.friction_nm) +
                             " N m, it should oppose it; ";
    if (angle_turned(j))
        say(j, "angle_sign", s.friction_nm, -s.friction_nm, "angle looks turned round" + size +
            "change the sign of q and v");
    else
        say(j, "torque_sign", s.friction_nm, -s.friction_nm, "torque looks turned round" + size +
            "change the sign of tau, or of q and v if it is they");
    return true;
}

// The load is the other way round and friction is not.
void RunCheck::load_sign(std::size_t j, const TorqueShare &s)
{
    const double friction_nm = std::max(s.friction_model_nm, s.friction_nm);
    if (s.friction_r < friction_r || s.load_r < load_r || s.load_sd_nm < load_sd_share * friction_nm ||
        !near(s.load, -1, 2))
        return;
    say(j, "load_sign", s.load, 1, "load looks turned round: it is " + number3(s.load) + " of what the model "
        "expects while friction opposes the motion as it should; is the joint's positive direction the "
        "model's, and base.gravity the way the arm is mounted?");
}

void RunCheck::torque_size(const std::vector<double> &factor)
{
    const Spread all = spread_of(factor);
    const bool common = alike(all, common_slack) && !near(all.middle, 1, common_most);
    const double most = common ? common_most : torque_most;
    for (std::size_t j = 0; j < joints(); j++) {
        const double ratio = joint(j).ratio, motor_nm = joint(j).tau_max_m_nm * ratio;
        const double reached = quantile_abs(at(j).tau, 0.98);
        const bool far = factor[j] > 0 && !near(factor[j], 1, most);
        if (!has(j) || told_[j] || (!far && !(motor_nm > 0 && reached > motor_slack * motor_nm)))
            continue;
        const bool named = factor[j] > 0 && !near(factor[j], 1, common_most);
        const Unit u = nearest(torque_units(ratio), named ? factor[j] : 0, torque_slack);
        const std::string looks = u.is.empty() ? "torque is of another size" : "torque looks " + u.is;
        const std::string remedy = u.is.empty() ? "; look at its unit and side" : "; " + u.remedy;
        if (far)
            say(j, kind_of(u, ratio), factor[j], 1, looks + ": it is " + number3(factor[j]) + " of what the "
                "model expects, " + (u.is.empty() ? "expected 1" : u.why + " is " + number3(u.factor)) +
                remedy);
        else
            say(j, kind_of(u, ratio), reached, motor_nm, looks + ": it reaches " + number3(reached) +
                " N m, the motor's largest is " + number3(motor_nm) + " at the output" + remedy);
    }
}

// One factor on load and friction everywhere is no joint's fault.
void RunCheck::torque_constant(const std::vector<TorqueShare> &share)
{
    std::vector<double> factor;
    for (const TorqueShare &s : share)
        factor.push_back(s.whole_r > same_r ? s.whole : 0);
    const Spread all = spread_of(factor);
    if (alike(all, constant_slack) && !near(all.middle, 1, constant_least))
        say(joints(), "torque_scale", all.middle, 1, "torque of all joints is " + number3(all.middle) +
            " of what the model expects, expected 1: is gear.ratio or the torque constant right?", false);
}

// A pair of joints whose torques fit the model only with columns of the one in place of the other's.
bool RunCheck::places_by_torque()
{
    std::vector<double> own(joints(), -1);
    for (std::size_t j = 0; j < joints(); j++) {
        if (!has(j))
            continue;
        own[j] = torque_left(at(j).tau, joint(j), at(j), load().nm[j], own_size);
        // a sign is no exchange
        if (torque_left(-at(j).tau, joint(j), at(j), load().nm[j], own_size) < 0.5 * own[j])
            own[j] = -1;
    }
    for (std::size_t i = 0; i < joints(); i++)
        for (std::size_t k = i + 1; k < joints(); k++)
            if (std::min(own[i], own[k]) > own_left && own[i] + own[k] > both_left && exchanged(i, k, own))
                return true;
    return false;
}

bool RunCheck::exchanged(std::size_t i, std::size_t k, const std::vector<double> &own)
{
    struct Reading { const char *kind, *what, *remedy; bool angle, torque; };
    static const Reading readings[] = {
        {"columns_swapped", "torque", "exchange their tau", false, true},
        {"columns_swapped", "angle", "exchange their q, v and references", true, false},
        {"joints_exchanged", "joint", "exchange all their columns", true, true},
    };
    for (const Reading &r : readings) {
        CheckRows other = rows_;
        if (r.angle)
            std::swap(other.joint[i], other.joint[k]);
        if (r.angle != r.torque)
            std::swap(other.joint[i].tau, other.joint[k].tau);
        const LoadColumns there = r.angle ? load_columns(arm_, other) : load();
        const auto left = [&](std::size_t j) {
            return torque_left(other.joint[j].tau, joint(j), other.joint[j], there.nm[j], other_size);
        };
        const double in_i = left(i), in_k = left(k), most = std::max(in_i, in_k);
        if (std::min(in_i, in_k) < 0 || most > other_left || in_i + in_k > other_share * (own[i] + own[k]))
            continue;
        for (const auto &[a, b] : {std::pair(i, k), std::pair(k, i)})
            say(a, r.kind, std::sqrt(own[a]), std::sqrt(most), std::string(r.what) +
                " looks to be that of joint " + std::to_string(b + 1) + ": the model misses " +
                number3(100 * std::sqrt(own[a])) + " % of the torque, and " + number3(100 * std::sqrt(most)) +
                " % with the two exchanged; " + r.remedy);
        return true;
    }
    return false;
}

} // namespace hdt::log_check
