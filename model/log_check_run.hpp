// SPDX-License-Identifier: Apache-2.0
//
// One run under check: what log_check_motion.cpp and log_check_torque.cpp share.
//
// Owns: the bounds both go by, the way a finding is said, units by their factor.
// Never: read by anything but log_check*.cpp.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/log_check.hpp"
#include "model/log_check_rows.hpp"

namespace hdt::log_check {

constexpr double same_r = 0.95;         // two columns show the same motion
constexpr double other_r = 0.5;         // they do not
constexpr double friction_r = 0.7;      // friction is seen apart from the load
constexpr double moves_share = 0.01;    // of the speed limit: less is standing still

// x within a factor of value, of the same sign.
bool near(double x, double value, double slack);

// What a column that is so many times too large is likely to be; why: the factor in words.
struct Unit { double factor; std::string is, remedy, why; };
// The unit next to a factor; empty `is` when there is none near.
Unit nearest(const std::vector<Unit> &units, double factor, double slack);

class RunCheck {
public:
    RunCheck(const hdt_arm &arm, const Run &run, std::vector<LogFinding> *out);
    void all();

private:
    hdt_arm arm_;                       // with the run's payload
    const Run &run_;
    std::vector<LogFinding> *out_;
    CheckRows rows_;
    std::optional<LoadColumns> load_;   // made when first asked for
    std::vector<char> told_;            // per joint: a refusal was found

    std::size_t joints() const { return rows_.joint.size(); }
    const CheckColumns &at(std::size_t j) const { return rows_.joint[j]; }
    const hdt_arm_joint &joint(std::size_t j) const { return arm_.joint[j]; }
    const LoadColumns &load() { return load_ ? *load_ : load_.emplace(load_columns(arm_, rows_)); }
    bool has(std::size_t j) const { return at(j).q.size() > 0; }
    bool any_told() const;
    bool moves(std::size_t j) const;
    double speed_limit_radps(std::size_t j) const; // 1 where the arm states none
    // joint j, or the whole run when it is joints()
    void say(std::size_t j, const char *kind, double found, double expected, const std::string &what,
             bool refuse = true);

    void name();
    void ratio(std::size_t j);

    // log_check_motion.cpp: columns against each other and against what the arm can do
    bool time_units();
    void places();
    bool speed_is_torque(std::size_t j);
    bool angle_is_torque(std::size_t j);
    bool speed_is_angle(std::size_t j);
    void angle_elsewhere(std::size_t j);
    void motion(std::size_t j);
    void angle(std::size_t j, double factor, const char *against);
    void speed(std::size_t j, double factor);
    void reference(std::size_t j, double factor, const char *column);
    void limits(std::size_t j);
    bool referred(std::size_t j) const;
    double beyond_limits_rad(std::size_t j, double factor, double shift = 0) const;

    // log_check_torque.cpp: torque against motion and the model
    void torque();
    bool friction_drives(std::size_t j);
    bool torque_sign(std::size_t j, const TorqueShare &s);
    bool angle_turned(std::size_t j);
    void load_sign(std::size_t j, const TorqueShare &s);
    void torque_size(const std::vector<double> &factor);
    void torque_constant(const std::vector<TorqueShare> &share);
    bool places_by_torque();
    bool exchanged(std::size_t i, std::size_t k, const std::vector<double> &own);
};

} // namespace hdt::log_check
