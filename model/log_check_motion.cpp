// SPDX-License-Identifier: Apache-2.0
//
// Angle, speed and reference of a joint against each other, against those of other joints, and against what
// the arm can do.  The rate of the angle is known from the angle alone: a speed that is 57.3 times it is in
// degrees, one that goes with another joint's is in the wrong place.
//
// Owns: units and signs of motion, columns in the wrong place as motion shows it.
// Never: needs the model's torque, but for which of two signs friction takes.
#include <algorithm>
#include <cmath>

#include "model/log_check_run.hpp"
#include "model/text.hpp"

namespace hdt::log_check {

using Eigen::VectorXd;

namespace {

constexpr double degree = 180 / M_PI, rpm = 30 / M_PI, turn = 2 * M_PI;
constexpr double motor_counts = 16384;      // of the telegram, a motor turn
constexpr double limit_slack_rad = 0.5;     // dataset.cpp refuses beyond it
constexpr double speed_slack = 2;           // of the arm's speed limit, before an angle's rate cannot be true
constexpr double column_slack = 1.3;        // factor between two columns that mean the same
constexpr double place_slack = 1.2;         // the same for a column that has another's name
constexpr double unit_slack = 1.06;         // factor around a unit's number
constexpr double smooth_share = 0.05;       // of its own size, what an angle changes by over a block

std::vector<Unit> angle_units(double ratio)
{
    const std::string n = number3(ratio);
    return {{degree, "in degrees", "multiply by pi/180", ""},
            {ratio, "motor-side", "divide by the ratio " + n, ""},
            {degree * ratio, "motor-side and in degrees", "multiply by pi/180 and divide by " + n, ""},
            {1000, "in thousandths", "divide by 1000", ""},
            {motor_counts * ratio / turn, "in resolver counts", "multiply by 2 pi/(16384 ratio)", ""},
            {1 / degree, "converted from degrees twice", "multiply by 180/pi", ""},
            {1 / ratio, "divided by the ratio twice", "multiply by the ratio " + n, ""},
            {1 / turn, "in turns", "multiply by 2 pi", ""},
            {ratio / turn, "in motor turns", "multiply by 2 pi/ratio", ""}};
}

std::vector<Unit> speed_units(double ratio)
{
    std::vector<Unit> units = angle_units(ratio);
    units[0].is = "in degrees per second";
    units[4] = {rpm, "in turns a minute", "multiply by pi/30", ""};
    units[7] = {rpm * ratio, "in motor turns a minute", "multiply by pi/(30 ratio)", ""};
    units.pop_back();
    return units;
}

bool off(const Match &m) { return std::fabs(m.r) > same_r && !near(m.factor, 1, column_slack); }
bool good(const Match &m) { return m.r > same_r && near(m.factor, 1, column_slack); }
bool turned(double factor) { return near(factor, -1, column_slack); }

Match if_any(const VectorXd &x, const VectorXd &y) { return y.size() > 0 ? match(x, y) : Match{}; }
Match if_any_centred(const VectorXd &x, const VectorXd &y)
{
    return y.size() > 0 ? match_centred(x, y) : Match{};
}

} // namespace

// Every speed off by the same power of a thousand is time's.
bool RunCheck::time_units()
{
    std::size_t seen = 0, moving = 0;
    double factor = 1;
    for (std::size_t j = 0; j < joints(); j++) {
        const Match m = if_any(at(j).rate, at(j).v);
        if (m.r < same_r)
            continue;
        moving++;
        if (seen == 0 || near(m.factor, factor, unit_slack)) {
            factor = m.factor;
            seen++;
        }
    }
    const std::vector<Unit> units = {{1e3, "in milliseconds", "", ""}, {1e6, "in microseconds", "", ""},
                                     {1e-3, "divided by 1000 too often", "", ""}};
    const std::string is = nearest(units, factor, unit_slack).is;
    if (is.empty() || seen < moving || (seen == 1 && joints() > 1))
        return false;
    say(joints(), "time_units", factor, 1, "time looks " + is + ": the logged speeds are " + number3(factor) +
        " times the rate of the angles, expected 1; give t_s in seconds");
    return true;
}

// Columns with another's name.
void RunCheck::places()
{
    for (std::size_t j = 0; j < joints(); j++)
        if (has(j) && !speed_is_torque(j) && !angle_is_torque(j) && !speed_is_angle(j))
            angle_elsewhere(j);
}

bool RunCheck::speed_is_torque(std::size_t j)
{
    const CheckColumns &c = at(j);
    const Match own = if_any(c.rate, c.v), tau = match(c.rate, c.tau);
    if (c.v.size() == 0 || good(own) || tau.r < 0.98 || !near(tau.factor, 1, place_slack))
        return false;
    say(j, "columns_swapped", tau.r, 1, "torque and speed look exchanged: the torque column goes with the "
        "angle's rate (correlation " + number3(tau.r) + "), the speed column does not (" + number3(own.r) +
        "); exchange tau and v");
    return true;
}

bool RunCheck::angle_is_torque(std::size_t j)
{
    const CheckColumns &c = at(j);
    const Match by_speed = if_any(c.tau_rate, c.v), by_reference = if_any_centred(c.tau, c.qref);
    bool found = false;
    if (c.v.size() > 0)
        found = by_speed.r > same_r && near(by_speed.factor, 1, place_slack) &&
                match(c.rate, c.v).r < other_r;
    else if (c.qref.size() > 0)
        found = by_reference.r > 0.99 && near(by_reference.factor, 1, place_slack) &&
                !good(match_centred(c.q, c.qref));
    else {
        // by what an angle can be: q jumps, and tau is within the limits, in motion and smooth
        const double limit = speed_limit_radps(j), tau_fast = quantile_abs(c.tau_rate, 0.98);
        const double spread = (c.tau.array() - c.tau.mean()).matrix().norm();
        found = quantile_abs(c.rate, 0.98) > speed_slack * limit &&
                tau_fast < limit && tau_fast > moves_share * limit &&
                c.tau.minCoeff() > joint(j).q_min_rad - limit_slack_rad &&
                c.tau.maxCoeff() < joint(j).q_max_rad + limit_slack_rad &&
                rows_.block_s * c.tau_rate.norm() < smooth_share * spread;
    }
    if (!found)
        return false;
    const double fast = quantile_abs(c.rate, 0.98);
    say(j, "columns_swapped", fast, joint(j).v_max_radps,
        "angle and torque look exchanged: the torque column moves as the angle should, and the angle column "
        "changes by " + number3(fast) + " a second where the limit is " + number3(joint(j).v_max_radps)
            + " rad/s; exchange q and tau");
    return true;
}

bool RunCheck::speed_is_angle(std::size_t j)
{
    const CheckColumns &c = at(j);
    const Match own = if_any(c.rate, c.v), angle = c.v.size() > 0 ? match(c.v_rate, c.q) : Match{};
    if (std::fabs(own.r) > other_r || angle.r < same_r || !near(angle.factor, 1, place_slack))
        return false;
    say(j, "columns_swapped", angle.r, 1, "angle and speed look exchanged: the angle column is the rate "
        "of the speed column (correlation " + number3(angle.r) + "); exchange q and v");
    return true;
}

// Speed or reference go with another joint's angle.
void RunCheck::angle_elsewhere(std::size_t j)
{
    const CheckColumns &c = at(j);
    struct Column { const char *name; VectorXd CheckColumns::*values; bool rate; };
    static const Column columns[] = {{"v", &CheckColumns::v, true},
                                     {"qref", &CheckColumns::qref, false},
                                     {"vref", &CheckColumns::vref, true}};
    for (const Column &column : columns) {
        const VectorXd &mine = c.*column.values;
        const bool measured = column.values == &CheckColumns::v;
        if (mine.size() == 0 || (!measured && !moves(j)))
            continue;
        const auto against = [&](std::size_t angle, const VectorXd &x) {
            return column.rate ? if_any(at(angle).rate, x) : if_any_centred(at(angle).q, x);
        };
        const Match own = against(j, mine);
        for (std::size_t i = 0; i < joints() && !good(own); i++) {
            if (i == j || !moves(i) || !good(against(i, mine)))
                continue;
            // joints that move together look alike, and one may be stuck: then only if each has the other's
            if ((std::fabs(own.r) > other_r || !measured) && !good(against(j, at(i).*column.values)))
                continue;
            const std::string here = std::to_string(j + 1), there = std::to_string(i + 1);
            const std::string what = measured ? "angles or speeds" : "angles or references";
            say(j, "columns_swapped", own.r, 1,
                column.name + here + " goes with the angle of joint " + there + " (correlation " +
                    number3(against(i, mine).r) + "), not with its own (" + number3(own.r) + "): " + what +
                    " of joints " + here + " and " + there + " look exchanged; exchange them");
            return;
        }
    }
}

// How far the angles, divided by a factor and shifted, leave the joint's limits.
double RunCheck::beyond_limits_rad(std::size_t j, double factor, double shift) const
{
    const hdt_arm_joint &a = joint(j);
    if (a.q_max_rad <= a.q_min_rad)
        return 0;
    const VectorXd q = at(j).q.array() / factor + shift;
    return std::max(q.maxCoeff() - a.q_max_rad, a.q_min_rad - q.minCoeff());
}

void RunCheck::angle(std::size_t j, double factor, const char *against)
{
    const std::string size =
        ": its rate is " + number3(factor) + " of what " + against + " says, expected 1; ";
    const Unit u = nearest(angle_units(joint(j).ratio), std::fabs(factor), unit_slack);
    if (turned(factor))
        say(j, "angle_sign", factor, 1, "angle looks turned round" + size + "change the sign of q");
    else if (u.is.empty())
        say(j, "angle_units", factor, 1, "angle is in no unit known here" + size +
            "give q in rad, output side");
    else
        say(j, "angle_units", factor, 1, "angle looks " + u.is + size + u.remedy);
}

void RunCheck::speed(std::size_t j, double factor)
{
    const std::string size = ": it is " + number3(factor) + " of the angle's rate, expected 1; ";
    const Unit u = nearest(speed_units(joint(j).ratio), std::fabs(factor), unit_slack);
    if (turned(factor))
        say(j, "velocity_sign", factor, 1, "speed looks turned round" + size +
            "change the sign of v, or of q if that is wrong");
    else if (u.is.empty())
        say(j, "velocity_units", factor, 1, "speed is in no unit known here" + size +
            "give v in rad/s, output side");
    else
        say(j, "velocity_units", factor, 1, "speed looks " + u.is + size + u.remedy);
}

// A reference may be missed, so only a sign or a known unit counts.
void RunCheck::reference(std::size_t j, double factor, const char *column)
{
    const std::string size = ": it is " + number3(factor) + " of what is measured, expected 1; ";
    const Unit u = nearest(speed_units(joint(j).ratio), std::fabs(factor), unit_slack);
    if (turned(factor))
        say(j, "reference_sign", factor, 1, std::string(column) + " looks turned round" + size +
            "change its sign, or those of q and v");
    else if (!u.is.empty())
        say(j, "reference_units", factor, 1, std::string(column) + " looks " + u.is + size + u.remedy);
}

// Angles that the arm cannot have, when no other column says by how much they are off.
void RunCheck::limits(std::size_t j)
{
    const CheckColumns &c = at(j);
    const hdt_arm_joint &a = joint(j);
    const double fast = quantile_abs(c.rate, 0.98), least = c.q.minCoeff(), most = c.q.maxCoeff();
    const double beyond = beyond_limits_rad(j, 1), span = a.q_max_rad - a.q_min_rad;
    const bool too_fast = a.v_max_radps > 0 && fast > speed_slack * a.v_max_radps;
    if (beyond < limit_slack_rad && !too_fast)
        return;
    const std::string also = good(if_any(c.rate, c.v)) ? " (speed alike)" : "";
    const std::string size = too_fast && beyond < limit_slack_rad
        ? ": it changes by " + number3(fast) + " rad/s, the arm's limit is " + number3(a.v_max_radps) + "; "
        : ": it goes from " + number3(least) + " to " + number3(most) + " rad, the arm from " +
          number3(a.q_min_rad) + " to " + number3(a.q_max_rad) + "; ";
    const double found = beyond < limit_slack_rad ? fast : most - a.q_max_rad == beyond ? most : least;
    const double limit = beyond < limit_slack_rad ? a.v_max_radps : found == most ? a.q_max_rad : a.q_min_rad;
    for (const auto &[shift, remedy] : {std::pair(-turn, "subtract 2 pi"), std::pair(turn, "add 2 pi")})
        if (!too_fast && beyond_limits_rad(j, 1, shift) < limit_slack_rad) {
            say(j, "angle_range", found, limit, "angle looks a turn off" + size + remedy);
            return;
        }
    if (!too_fast && beyond_limits_rad(j, -1) < limit_slack_rad) {
        say(j, "angle_sign", found, limit, "angle looks turned round" + size + "change the sign of q");
        return;
    }
    // another unit is far outside, not a little; of those that fit, the smallest and what is near it
    const bool far = too_fast || most - least > span || beyond > span;
    const double likely = 0.9 * std::min(degree, a.ratio); // what is smaller is seldom logged
    std::vector<Unit> fits;
    for (const Unit &u : angle_units(a.ratio))
        if (far && u.factor > likely && beyond_limits_rad(j, u.factor) < limit_slack_rad &&
            fast / u.factor < speed_slack * speed_limit_radps(j))
            fits.push_back(u);
    std::sort(fits.begin(), fits.end(), [](const Unit &x, const Unit &y) { return x.factor < y.factor; });
    if (fits.empty())
        say(j, "angle_range", found, limit, "angle cannot be this arm's" + size +
            "is this the right model file?");
    else if (fits.size() > 1 && near(fits[1].factor, fits[0].factor, 2))
        say(j, "angle_units", found, limit, "angle looks " + fits[0].is + " or " + fits[1].is + size +
            fits[0].remedy + ", or " + fits[1].remedy + also);
    else
        say(j, "angle_units", found, limit, "angle looks " + fits[0].is + size + fits[0].remedy + also);
}

// The reference asks for motion, and there is some.
bool RunCheck::referred(std::size_t j) const
{
    const CheckColumns &c = at(j);
    const double least = moves_share * speed_limit_radps(j);
    return moves(j) && (c.vref.size() == 0 || quantile_abs(c.vref, 0.95) > least);
}

// Angle, speed and references of one joint against each other.
void RunCheck::motion(std::size_t j)
{
    const CheckColumns &c = at(j);
    const bool asked = referred(j);
    const Match v = if_any(c.rate, c.v);
    const Match q = asked ? if_any_centred(c.q, c.qref) : Match{};
    const Match w = asked ? if_any(c.rate, c.vref) : Match{};
    const Match &ref = c.qref.size() > 0 ? q : w;
    const double limit = speed_limit_radps(j), v_fast = quantile_abs(c.v, 0.98);
    const double fast = quantile_abs(c.rate, 0.98);
    const bool cannot = fast > speed_slack * limit || beyond_limits_rad(j, 1) > limit_slack_rad;
    if (off(v) && (moves(j) || v_fast > moves_share * limit)) {
        // the angle is at fault when the reference says so too, or when the arm cannot do it
        const bool same = off(ref) && near(ref.factor, v.factor, column_slack);
        const bool shrunk = v.factor > 1 && v_fast < speed_slack * limit && !moves(j);
        if (same || (!good(ref) && (cannot || shrunk || (turned(v.factor) && friction_drives(j)))))
            angle(j, 1 / v.factor, "the logged speed");
        else
            speed(j, v.factor);
    } else if (off(ref) && (good(v) || c.v.size() == 0)) {
        if (cannot || (turned(ref.factor) && friction_drives(j)))
            angle(j, 1 / ref.factor, "the reference");
        else
            reference(j, ref.factor, c.qref.size() > 0 ? "qref" : "vref");
    } else if (good(q) && off(w)) {
        reference(j, w.factor, "vref");
    }
    if (!told_[j])
        limits(j);
    if (!told_[j] && c.v.size() > 0 && moves(j) && std::fabs(v.r) < other_r && quantile_abs(c.v, 0.95) > 0)
        say(j, "velocity_other", v.r, 1, "speed is not the rate of the angle: correlation " + number3(v.r) +
            ", expected 1; look where v comes from", false);
}

} // namespace hdt::log_check
