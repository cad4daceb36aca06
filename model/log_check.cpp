// SPDX-License-Identifier: Apache-2.0
//
// See log_check.hpp.  Nothing here is tuned to an arm: a unit is off by 57 or 1000, a side by the ratio,
// a sign by -1; what is no log's fault (a wrong mass, a payload, a cold or dragging joint) stays within a
// factor of ten.  docs/formats.md, "What is checked before a fit", has the bounds.
//
// Owns: the order in which one cause hides another; what the log's constants tell.
// Never: compares columns (log_check_motion.cpp, log_check_torque.cpp do).
#include "model/log_check.hpp"

#include <algorithm>
#include <cmath>

#include "model/log_check_run.hpp"
#include "model/text.hpp"

namespace hdt {

namespace log_check {

namespace {

constexpr Eigen::Index rows_min = 25; // blocks, half a second

} // namespace

bool near(double x, double value, double slack)
{
    return x * value > 0 && std::fabs(std::log(x / value)) < std::log(slack);
}

Unit nearest(const std::vector<Unit> &units, double factor, double slack)
{
    Unit best = {1, "", "", ""};
    for (const Unit &u : units)
        if (near(factor, u.factor, slack)) {
            slack = std::exp(std::fabs(std::log(factor / u.factor)));
            best = u;
        }
    return best;
}

RunCheck::RunCheck(const hdt_arm &arm, const Run &run, std::vector<LogFinding> *out)
    : arm_(arm), run_(run), out_(out), rows_(check_rows(run, arm)), told_(rows_.joint.size(), 0)
{
    arm_.payload_kg = run.constant("payload_kg", arm.payload_kg);
    if (const std::vector<double> com_m = run.constant_vector("payload_com_m"); com_m.size() == 3)
        std::copy(com_m.begin(), com_m.end(), arm_.payload_com_m);
}

bool RunCheck::any_told() const
{
    return std::any_of(told_.begin(), told_.end(), [](char t) { return t != 0; });
}

double RunCheck::speed_limit_radps(std::size_t j) const
{
    return joint(j).v_max_radps > 0 ? joint(j).v_max_radps : 1;
}

bool RunCheck::moves(std::size_t j) const
{
    return has(j) && quantile_abs(at(j).rate, 0.95) > moves_share * speed_limit_radps(j);
}

void RunCheck::say(std::size_t j, const char *kind, double found, double expected, const std::string &what,
                   bool refuse)
{
    const bool whole = j >= joints();
    if (refuse)
        told_[whole ? 0 : j] = 1;
    const std::string where = whole ? ": " : ": joint " + std::to_string(j + 1) + ": ";
    out_->push_back({run_.path, whole ? 0 : static_cast<int>(j) + 1, kind, refuse, found, expected,
                     run_.path + where + what});
}

// The log states the ratio it was written with.
void RunCheck::ratio(std::size_t j)
{
    const double logged = run_.constant("ratio" + std::to_string(j + 1), joint(j).ratio);
    if (!near(logged, joint(j).ratio, 1 + 1e-6))
        say(j, "gear_ratio", logged, joint(j).ratio, "log was written with ratio " + number3(logged) +
            ", the model has " + number3(joint(j).ratio) + ": its torque and angle are not this arm's; use "
            "the model it was written with, or correct gear.ratio");
}

// A log of another arm may fit by its count of joints; tables keep 31 characters of the model's name.
void RunCheck::name()
{
    const auto logged = run_.constants.find("arm");
    if (logged == run_.constants.end() || arm_.name[0] == '\0')
        return;
    const std::string model = std::string(arm_.name).substr(0, 31);
    if (logged->second != model)
        say(joints(), "arm_name", 0, 0, "log is of the arm " + shown(logged->second) + ", the model of " +
            shown(model) + ": is this the right model file?", false);
}

void RunCheck::all()
{
    name();
    for (std::size_t j = 0; j < joints(); j++)
        ratio(j);
    if (rows_.rows < rows_min || time_units())
        return;
    places();
    for (std::size_t j = 0; j < joints(); j++)
        if (has(j) && !told_[j])
            motion(j);
    // the model's torque is worth nothing at angles that are not the arm's
    if (!any_told())
        torque();
}

} // namespace log_check

std::vector<LogFinding> check_logs(const hdt_arm &arm, const std::vector<Run> &runs)
{
    std::vector<LogFinding> out;
    for (const Run &run : runs)
        log_check::RunCheck(arm, run, &out).all();
    return out;
}

static std::string lines(const std::vector<LogFinding> &findings, bool refuse)
{
    std::string text;
    for (const LogFinding &f : findings)
        if (f.refuse == refuse)
            text += (text.empty() ? "" : "\n") + f.words;
    return text;
}

std::string log_refusals(const std::vector<LogFinding> &findings) { return lines(findings, true); }
std::string log_warnings(const std::vector<LogFinding> &findings) { return lines(findings, false); }

} // namespace hdt
