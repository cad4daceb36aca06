// SPDX-License-Identifier: Apache-2.0
//
// hdt_arm to hdt_tables: every number rounded to its fixed point, refused by name where it does not
// fit, and the worst error of each table measured against the double-precision terms.
//
// Owns: rounding, defaults, the choice of friction knots.
// Never: changes the model.
#include "model/tablegen.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>

#include <Eigen/Dense>

#include "ctrl/hdt_q.h"
#include "model/hdt_arm.h"
#include "model/rbd.hpp"
#include "model/tablegen_chain.hpp"
#include "model/tablegen_error.hpp"
#include "model/tablegen_fixed.hpp"
#include "model/terms.hpp"

namespace hdt {
namespace {

constexpr double pi = 3.14159265358979323846;

// ---- friction ----

constexpr uint32_t finest_shift = 10; // knots over 0.008 rad/s: below any speed of interest

double friction_span_radps(const hdt_arm_joint &joint)
{
    return std::max(joint.v_max_radps, TableDefaults::friction_span * joint.friction_v_max_radps);
}

// What the core makes of the knots, beyond the last one too.
double knots_nm(const int32_t *knot, uint32_t shift, double speed_radps)
{
    const double place = std::ldexp(speed_radps, 24 - static_cast<int>(shift));
    const int k = static_cast<int>(std::min(std::floor(place), double(HDT_FRICTION_KNOTS - 2)));
    return std::ldexp(knot[k] + (double(knot[k + 1]) - knot[k]) * (place - k), -16);
}

double friction_error_nm(const hdt_arm_friction &f, const int32_t *knot, uint32_t shift,
                         double span_radps)
{
    // denser towards zero, where the curve bends
    constexpr int points = 4000;
    double worst = 0;
    for (int i = 0; i <= points; i++) {
        const double v = span_radps * std::pow(double(i) / points, 2);
        worst = std::max(worst, std::fabs(knots_nm(knot, shift, v) - stribeck_nm(f, v)));
    }
    return worst;
}

void make_friction(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out,
                   double *worst_nm)
{
    const char *names[2] = {"friction.positive", "friction.negative"};
    const double span = friction_span_radps(joint);
    double best = HUGE_VAL;
    out->terms |= 1u << HDT_TERM_FRICTION;
    // the last slope goes on beyond the last knot, as eq. (7) does: fine knots near zero are worth
    // more than knots up to the last speed, so every spacing is tried
    for (uint32_t shift = finest_shift; shift <= 23; shift++) {
        int32_t knots[2][HDT_FRICTION_KNOTS];
        double error = 0;
        for (int way = 0; way < 2; way++) {
            for (int k = 0; k < HDT_FRICTION_KNOTS; k++) {
                const double v = std::ldexp(k, static_cast<int>(shift) - 24);
                knots[way][k] =
                    fixed(key + names[way], stribeck_nm(joint.friction[way], v), 16, -16383, 16383);
            }
            error =
                std::max(error, friction_error_nm(joint.friction[way], knots[way], shift, span));
        }
        if (error < best) {
            best = error;
            out->friction_shift = shift;
            std::memcpy(out->friction_q16, knots, sizeof knots);
        }
        // wider knots than the span cannot be better, and might not be representable
        if (std::ldexp(HDT_FRICTION_KNOTS - 1, static_cast<int>(shift) - 24) >= span)
            break;
    }
    *worst_nm = std::max(*worst_nm, best);
}

// ---- periodic torque ----

double ripple_nm(const hdt_arm_joint &joint, double turn)
{
    double sum = 0;
    for (int i = 0; i < joint.ripples; i++)
        sum += joint.ripple[i].amplitude_nm
               * std::sin(joint.ripple[i].order_rev / joint.ratio * 2 * pi * turn
                          + joint.ripple[i].phase_rad);
    return sum;
}

void make_ripple(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out,
                 double *worst_nm)
{
    constexpr int per_knot = HDT_COUNTS_PER_REV / HDT_RIPPLE_KNOTS;
    for (int i = 0; i < joint.ripples; i++) {
        const double order = joint.ripple[i].order_rev / joint.ratio;
        const std::string at = key + "ripple." + std::to_string(i + 1) + ".wave_generator_order";
        if (!(std::fabs(order - std::round(order)) < 1e-6))
            refuse(at, "a whole number", order);
        if (!(order >= 1 && order <= HDT_RIPPLE_KNOTS / 8))
            refuse(at, "at most " + std::to_string(HDT_RIPPLE_KNOTS / 8), order);
    }
    for (int k = 0; k < HDT_RIPPLE_KNOTS; k++)
        out->ripple_q8[k] = static_cast<int16_t>(fixed(
            key + "ripple amplitudes together", ripple_nm(joint, double(k) / HDT_RIPPLE_KNOTS), 8,
            -32767 / 256.0, 32767 / 256.0));
    for (int count = 0; count < HDT_COUNTS_PER_REV; count++) {
        const int k = count / per_knot, next = (k + 1) % HDT_RIPPLE_KNOTS;
        const double part = double(count % per_knot) / per_knot;
        const double value = ((1 - part) * out->ripple_q8[k] + part * out->ripple_q8[next]) / 256;
        *worst_nm = std::max(
            *worst_nm, std::fabs(value - ripple_nm(joint, double(count) / HDT_COUNTS_PER_REV)));
    }
    out->terms |= 1u << HDT_TERM_RIPPLE;
}

void make_lines(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out,
                double *worst_nm)
{
    const double counts_per_rad = joint.ratio * HDT_COUNTS_PER_REV / (2 * pi);
    for (int i = 0; i < joint.lines; i++) {
        const hdt_arm_line &line = joint.line[i];
        const std::string at = key + "effect (order_line " + std::to_string(i + 1) + ")";
        const double turns_per_count = line.order_rev / (joint.ratio * HDT_COUNTS_PER_REV);
        if (!(turns_per_count > 0 && turns_per_count < 0.25))
            refuse(at + ".order",
                   "above 0 and below " + number_text(0.25 * joint.ratio * HDT_COUNTS_PER_REV),
                   line.order_rev);
        hdt_line_tab &tab = out->line[i];
        tab.amplitude_q16 = fixed(at + ".amplitude", line.amplitude_nm, 16);
        tab.directed = line.directed ? 1 : 0;
        tab.phase0 = static_cast<uint32_t>(turn_part(line.phase_rad / (2 * pi), 32));
        tab.phase_per_count_q24 = turn_part(turns_per_count, 56);
        // the phase drifts by half a unit of its step a count: worst at the position limit
        const double reach =
            std::max(std::fabs(joint.q_min_rad), std::fabs(joint.q_max_rad)) * counts_per_rad;
        const double drift =
            std::fabs(std::ldexp(double(tab.phase_per_count_q24), -56) - turns_per_count) * reach;
        const double phase = drift + std::ldexp(1.0, -32);
        *worst_nm = std::max(
            *worst_nm, std::fabs(line.amplitude_nm) * 2 * pi * phase
                           + std::fabs(std::ldexp(tab.amplitude_q16, -16) - line.amplitude_nm));
        out->terms |= 1u << HDT_TERM_LINES;
    }
    out->lines = static_cast<uint32_t>(joint.lines);
}

// ---- the rest of a joint ----

void make_stiffness(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out)
{
    const char *names[2] = {"stiffness.positive", "stiffness.negative"};
    for (int way = 0; way < 2; way++) {
        const hdt_arm_stiffness &from = joint.stiffness[way];
        const StiffnessLines lines = stiffness_lines(from);
        hdt_stiffness_tab &to = out->stiffness[way];
        to.t1_q16 = fixed(key + names[way] + ".t1", from.t1_nm, 16);
        to.t2_q16 = fixed(key + names[way] + ".t2", from.t2_nm, 16);
        for (int i = 0; i < 3; i++) {
            to.slope_q24[i] = fixed(key + names[way] + ".slope", from.slope[i], 24);
            to.intercept_q16[i] = fixed(key + names[way] + ".zero", lines.intercept_nm[i], 16);
        }
    }
    if (joint.windup_rad > 0)
        out->windup_inv_q8 = fixed(key + "stiffness.travel (1 over it)", 1 / joint.windup_rad, 8, 1 / 256.0,
                                   HUGE_VAL);
    out->terms |= 1u << HDT_TERM_STIFFNESS;
}

// ---- curves ----

// Knots from `from` on, as close as reaches `to`; refuses what a knot cannot say.
template <typename Value>
void make_curve(const std::string &key, double from, double to, int bits, const Value &value,
                hdt_curve_tab *out, double *worst_nm)
{
    const double unit = std::ldexp(1, bits);
    out->start = fixed(key + ": lower end", from, bits);
    while (std::ldexp(HDT_CURVE_KNOTS - 1, int(out->shift)) < (to - from) * unit)
        out->shift++;
    if (out->shift > 23)
        refuse(key + ": span", "at most " + number_text(std::ldexp(256, 23) / unit), to - from);
    const auto at = [&](double place) { return from + std::ldexp(place, int(out->shift)) / unit; };
    for (int k = 0; k < HDT_CURVE_KNOTS; k++)
        out->value_q8[k] = static_cast<int16_t>(fixed(key + ": torque", value(std::fmin(at(k), to)), 8,
                                                      -32767 / 256.0, 32767 / 256.0));
    const auto measure = [&](double place) {
        const int k = std::min(static_cast<int>(place), HDT_CURVE_KNOTS - 2);
        const double made = out->value_q8[k] + (place - k) * (out->value_q8[k + 1] - out->value_q8[k]);
        *worst_nm = std::max(*worst_nm, std::fabs(made / 256 - value(at(place))));
    };
    // the end lies between two knots, of which the later one holds it
    const double end = std::ldexp((to - from) * unit, -int(out->shift));
    for (double place = 0; place < end; place += 1 / 8.0)
        measure(place);
    measure(end);
}

void make_curves(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out,
                 double worst_nm[HDT_TERMS])
{
    out->local[0].shift = out->local[1].shift = out->table.shift = 1;
    if (joint.has_local || joint.bumps > 0) {
        for (int way = 0; way < 2; way++)
            make_curve(key + (joint.has_local ? "friction_by_position" : "effect (local_friction)"),
                       joint.q_min_rad, joint.q_max_rad, 24,
                       [&](double q) { return local_nm(joint, way, q); }, &out->local[way],
                       &worst_nm[HDT_TERM_LOCAL]);
        out->terms |= 1u << HDT_TERM_LOCAL;
    }
    if (!joint.has_table)
        return;
    // the core's units: rad q24, N.m q16, counts of a wave-generator turn, rad/s q24
    static const int bits[HDT_AXES] = {24, 16, 0, 24};
    const double scale = joint.table_axis == HDT_AXIS_PHASE ? HDT_COUNTS_PER_REV : 1;
    make_curve(key + "table", joint.table.from * scale, joint.table.to * scale, bits[joint.table_axis],
               [&](double x) { return curve_nm(joint.table, x / scale); }, &out->table,
               &worst_nm[HDT_TERM_TABLE]);
    out->axis = static_cast<uint32_t>(joint.table_axis);
    out->directed = joint.table_directed ? 1 : 0;
    out->terms |= 1u << HDT_TERM_TABLE;
}

void make_effects(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out)
{
    const auto use = [out](bool wanted, hdt_term term) {
        out->terms |= (wanted ? 1u : 0u) << term;
    };
    out->load_mu_q24 = fixed(key + "effect (load_friction).mu", joint.load_mu, 24);
    use(out->load_mu_q24 != 0, HDT_TERM_LOAD);
    if (joint.warm_s > 0) {
        out->cold_coulomb_q16 =
            fixed(key + "effect (temperature).coulomb", joint.cold_coulomb_nm, 16);
        out->cold_viscous_q16 =
            fixed(key + "effect (temperature).viscous", joint.cold_viscous_nmspr, 16);
        out->cold_decay_q31 =
            fixed(key + "effect (temperature).time_constant",
                  std::min(std::exp(-1 / joint.warm_s), 2147483647 / 2147483648.0), 31);
        use(out->cold_coulomb_q16 != 0 || out->cold_viscous_q16 != 0, HDT_TERM_TEMPERATURE);
    }
    if (joint.presliding_rad > 0) {
        out->presliding_q16 = fixed(key + "effect (presliding).torque", joint.presliding_nm, 16);
        out->presliding_inv_q8 = fixed(key + "effect (presliding).travel (1 over it)",
                                       1 / joint.presliding_rad, 8, 1 / 256.0, HUGE_VAL);
        use(out->presliding_q16 != 0, HDT_TERM_PRESLIDING);
    }
    out->spring_q16 = fixed(key + "effect (cable_spring).stiffness", joint.spring_nmprad, 16);
    out->spring_q0_q24 = fixed(key + "effect (cable_spring).rest", joint.spring_q0_rad, 24);
    use(out->spring_q16 != 0, HDT_TERM_SPRING);
    out->offset_q16 = fixed(key + "effect (torque_offset).torque", joint.torque_offset_nm, 16);
    use(out->offset_q16 != 0, HDT_TERM_OFFSET);
}

void make_scaling(const hdt_arm_joint &joint, const std::string &key, hdt_joint_tab *out)
{
    // the digit factor bounds the ratio below; above, the count step must keep its precision
    const double least = std::ldexp(1000, 24) / 2147483647.0;
    if (!(joint.ratio * joint.torque_gain >= least))
        refuse(key + "gear.ratio (times torque gain)", "at least " + number_text(least),
               joint.ratio * joint.torque_gain);
    if (!(joint.ratio >= 2 && joint.ratio <= 10000))
        refuse(key + "gear.ratio", "a number from 2 to 10000", joint.ratio);
    const double turns_per_count = 1 / (joint.ratio * HDT_COUNTS_PER_REV);
    out->sign = 1;
    out->zero_cnt = 0;
    out->rad_per_count_q44 =
        static_cast<uint32_t>(std::llround(std::ldexp(2 * pi * turns_per_count, 44)));
    out->phase_per_count_q24 = turn_part(turns_per_count, 56);
    out->digit_per_nm_q24 = fixed(key + "gear.ratio", 1000 / (joint.ratio * joint.torque_gain), 24);
    out->nm_per_digit_q24 = fixed(key + "gear.ratio", joint.ratio * joint.torque_gain / 1000, 24, 0, 64);
    out->kp_q16 =
        fixed(key + "feedback.kp (times ratio)", joint.ratio * joint.kp_m_nmprad, 16, 0, 16384);
    out->kd_q16 =
        fixed(key + "feedback.kd (times ratio)", joint.ratio * joint.kd_m_nmspr, 16, 0, 16384);
    out->terms |= (out->kp_q16 != 0 ? 1u : 0u) << HDT_TERM_P;
    out->terms |= (out->kd_q16 != 0 ? 1u : 0u) << HDT_TERM_D;
}

void make_limits(const hdt_arm &arm, const hdt_arm_joint &joint, const std::string &key,
                 hdt_joint_tab *out)
{
    if (!(joint.tau_max_m_nm > 0))
        throw Refusal(
            key
            + "motor.torque_max: expected a quantity for the tables' torque limit, found nothing");
    // rounded down: the limit is never exceeded
    fixed(key + "motor.torque_max (a digit is 0.001)", joint.tau_max_m_nm, 16, 0.001, 32.767);
    out->dig_max = static_cast<int32_t>(std::floor(joint.tau_max_m_nm * 1000 + 1e-9));
    out->dig_slew =
        std::min(65535, static_cast<int32_t>(std::ceil(
                            out->dig_max / (TableDefaults::slew_s * arm.control_rate_hz))));
    // a speed word cannot say more than this, whatever the joint can do
    out->spd_max =
        static_cast<int32_t>(std::min(32767.0, std::floor(joint.v_max_radps / 0.0002 + 1e-9)));
    out->q_min_q24 = fixed(key + "limits.position", joint.q_min_rad, 24);
    out->q_max_q24 = fixed(key + "limits.position", joint.q_max_rad, 24);
    out->v_max_q24 =
        fixed(key + "limits.speed (times " + number_text(TableDefaults::speed_margin) + ")",
              joint.v_max_radps * TableDefaults::speed_margin, 24);
    out->follow_max_q24 = fixed("following limit", TableDefaults::follow_rad, 24);
    const double ramp = joint.has_friction && joint.friction_v_min_radps > 0
                            ? std::min(TableDefaults::v_ramp_radps, joint.friction_v_min_radps / 2)
                            : TableDefaults::v_ramp_radps;
    out->v_ramp_inv_q16 = fixed(key + "friction.valid (1 over its lower speed)", 1 / ramp, 16);
}

void make_joint(const hdt_arm &arm, int j, hdt_joint_tab *out, hdt_gen_report *report)
{
    const hdt_arm_joint &joint = arm.joint[j];
    const std::string key = "joint." + std::to_string(j + 1) + ".";
    make_scaling(joint, key, out);
    make_limits(arm, joint, key, out);
    out->friction_shift = finest_shift;
    if (joint.has_friction)
        make_friction(joint, key, out, &report->term_nm[HDT_TERM_FRICTION]);
    if (joint.ripples > 0)
        make_ripple(joint, key, out, &report->term_nm[HDT_TERM_RIPPLE]);
    if (joint.has_stiffness)
        make_stiffness(joint, key, out);
    make_lines(joint, key, out, &report->term_nm[HDT_TERM_LINES]);
    make_effects(joint, key, out);
    make_curves(joint, key, out, report->term_nm);
}

// Second-order Butterworth low-pass by the bilinear transform, corner prewarped.
void make_biquad(const hdt_arm &arm, int32_t out[5])
{
    const double k = std::tan(pi * arm.velocity_cutoff_hz / arm.control_rate_hz),
                 root2 = std::sqrt(2.0);
    const double scale = 1 / (1 + root2 * k + k * k);
    const double one = std::ldexp(1, 28);
    out[0] = static_cast<int32_t>(std::llround(one * k * k * scale));
    out[2] = out[0];
    out[3] = static_cast<int32_t>(std::llround(one * 2 * (k * k - 1) * scale));
    out[4] = static_cast<int32_t>(std::llround(one * (1 - root2 * k + k * k) * scale));
    // b1 takes the rounding of the others, so that a constant speed passes exactly
    out[1] = static_cast<int32_t>((int64_t(1) << 28) + out[3] + out[4] - out[0] - out[2]);
}

// Triple pole of the observer a quarter of the low-pass's corner (fading-memory filter of degree two): it
// knows the acceleration, so slow is quiet and does not lag.
void make_observer(const hdt_arm &arm, hdt_tables *t)
{
    t->observer = (arm.observe_feedback ? 1u : 0u) << HDT_OBSERVED_FEEDBACK
                  | (arm.observe_friction ? 1u : 0u) << HDT_OBSERVED_FRICTION;
    const double rate = arm.control_rate_hz,
                 p = std::exp(-2 * pi * TableDefaults::observer_share * arm.velocity_cutoff_hz / rate),
                 r = 1 - p;
    t->observer_gain[0] = fixed("control.velocity_cutoff", 1 - p * p * p, 30, 0, 1);
    t->observer_gain[1] = fixed("control.rate", 1.5 * r * r * (1 + p) * rate, 16, 0, 16384);
    t->observer_gain[2] = fixed("control.rate", std::min(r * r * r * rate * rate, 4194303.0), 8);
}

// Inertia each joint turns with the arm at the middle of its range: for the observer.
void make_inertia(const hdt_arm &arm, hdt_tables *t)
{
    const int n = arm.joints;
    Eigen::VectorXd q(n);
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(n);
    for (int j = 0; j < n; j++)
        q[j] = (arm.joint[j].q_min_rad + arm.joint[j].q_max_rad) / 2;
    const Eigen::VectorXd held = rbd::gravity(arm, q);
    for (int j = 0; j < n; j++) {
        Eigen::VectorXd a = zero;
        a[j] = 1;
        const double sum = (rbd::inverse_dynamics(arm, q, zero, a) - held)[j]
                           + reflected_inertia_kgm2(arm.joint[j]);
        // an arm of unknown inertia: the observer goes by the counts alone
        t->joint[j].inertia_inv_q20 = sum > 1 / 1024.0 ? fixed("inertia", 1 / sum, 20) : 0;
    }
}

void make_head(const hdt_arm &arm, hdt_tables *t)
{
    t->magic = HDT_TABLES_MAGIC;
    t->layout = HDT_TABLES_LAYOUT;
    std::memcpy(t->digest, arm.digest, sizeof t->digest);
    if (std::strlen(arm.name) >= sizeof t->name)
        refuse("name", "at most " + std::to_string(sizeof t->name - 1) + " characters",
               double(std::strlen(arm.name)));
    std::memcpy(t->name, arm.name, std::strlen(arm.name));
    t->joints = static_cast<uint32_t>(arm.joints);
    if (!(arm.control_rate_hz > 0))
        throw Refusal("control.rate: expected a quantity for the tables, found nothing");
    if (!(arm.control_rate_hz >= 1 && arm.control_rate_hz <= 20000))
        refuse("control.rate", "a number from 1 to 20000", arm.control_rate_hz);
    if (!(arm.velocity_cutoff_hz >= arm.control_rate_hz / 2000))
        refuse("control.velocity_cutoff", "at least a 2000th of control.rate",
               arm.velocity_cutoff_hz);
    t->period_ns = static_cast<uint32_t>(std::llround(1e9 / arm.control_rate_hz));
    t->rate_q16 = static_cast<uint32_t>(std::llround(std::ldexp(arm.control_rate_hz, 16)));
    t->stale_periods = TableDefaults::stale_periods;
    make_biquad(arm, t->biquad_q28);
    make_observer(arm, t);
}

// Reference motion the terms follow: the speed a fault is at, and any acceleration up to the one the
// core can take of this arm.
void limit_chain(hdt_tables *t)
{
    for (uint32_t j = 0; j < t->joints; j++)
        t->joint[j].v_lim_q24 = t->joint[j].v_max_q24;
    for (double a = TableDefaults::a_lim_radps2; a >= 1; a /= 2) {
        for (uint32_t j = 0; j < t->joints; j++)
            t->joint[j].a_lim_q16 = fixed("a_lim", a, 16);
        const char *where = "";
        int joint = -1;
        if (hdt_tables_check(t, &where, &joint) == HDT_TABLES_OK)
            return;
    }
}

// What in the model makes a member the core does not take, and what would be taken.
std::string cause(const std::string &member)
{
    static const std::map<std::string, std::string> causes = {
        {"v_lim_q24", "limits.speed: expected joint speeds (times 1.2) of 60 rad/s or less together, "
                      "found more up to this joint"},
        {"a_lim_q16", "limits.speed: expected joints slow enough for centripetal accelerations below "
                      "7900 rad/s^2, found more up to this joint"},
        {"step_q24", "origin: expected link origins that accelerate by less than 7900 m/s^2, found "
                     "more at full speed"},
        {"moment_q20", "link.com: expected a holding torque below 16384 N.m and first moments below "
                       "1024 kg.m, all links together, and 500 kg.m or less a link, found more"},
        {"second_q20", "link.inertia: expected forces below 31700 N and moments below 31700 N.m at full "
                       "speed, all links together, and second moments of 500 kg.m^2 or less a link, "
                       "found more"},
        {"stiffness", "stiffness: expected lines below 32767 N.m at every load, found more"},
    };
    const auto known = causes.find(member);
    return known != causes.end() ? known->second
                                 : member + ": expected a number the core takes, found another";
}

void make_tables(const hdt_arm &arm, hdt_tables *t, hdt_gen_report *report)
{
    if (!(arm.joints >= 1 && arm.joints <= HDT_JOINTS_MAX))
        refuse("joint", "1 to " + std::to_string(HDT_JOINTS_MAX) + " joints", arm.joints);
    make_head(arm, t);
    for (int j = 0; j < arm.joints; j++)
        make_joint(arm, j, &t->joint[j], report);
    make_chain(arm, t);
    make_inertia(arm, t);
    limit_chain(t);
    measure_formulas(arm, *t, report->term_nm);
    // the core has the last word on what it takes
    const char *where = "";
    int joint = -1;
    if (hdt_tables_check(t, &where, &joint) != HDT_TABLES_OK)
        throw Refusal((joint >= 0 ? "joint." + std::to_string(joint + 1) + "." : std::string())
                      + cause(where));
}

} // namespace
} // namespace hdt

int hdt_arm_tables(const struct hdt_arm *arm, struct hdt_tables *t, struct hdt_gen_report *report,
                   char *err, size_t errlen)
{
    hdt_gen_report measured = {};
    std::memset(t, 0, sizeof *t);
    try {
        hdt::make_tables(*arm, t, &measured);
    } catch (const std::exception &error) {
        std::memset(t, 0, sizeof *t);
        if (err && errlen > 0)
            std::snprintf(err, errlen, "%s%s%s", arm->path, arm->path[0] ? ": " : "", error.what());
        return -1;
    }
    if (report)
        *report = measured;
    return 0;
}
