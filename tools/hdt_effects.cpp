// SPDX-License-Identifier: Apache-2.0
// See hdt_effects.hpp.
#include "tools/hdt_effects.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>

#include "model/text.hpp"
#include "tools/usage_error.hpp"

namespace hdt::rig {

namespace {

using Option = std::pair<const char *, double>; // key, default

// Gives back the numbers of the plant that the size is added to; none: it has put the effect in
// itself, and such an effect cannot begin or end in mid-run.
using Apply = std::function<std::vector<double *>(plant_model &, const hdt_arm &, const HiddenEffect &)>;

struct EffectKind {
    const char *name, *unit, *what;
    std::vector<Option> options;
    Apply apply;
};

const EffectKind &kind_of(const std::string &name);

double option(const HiddenEffect &e, const std::string &key)
{
    for (const auto &[name, value] : e.options)
        if (name == key)
            return value;
    for (const Option &o : kind_of(e.name).options)
        if (key == o.first)
            return o.second;
    return std::numeric_limits<double>::quiet_NaN();
}

plant_joint &joint_of(plant_model &plant, const HiddenEffect &e)
{
    return plant.joint[e.joint - 1];
}

[[noreturn]] void refuse(const HiddenEffect &e, const std::string &why)
{
    throw InputError("--effect " + e.name + ": " + why);
}

// An effect that is one number of the joint.
Apply number(double plant_joint::*field)
{
    return [field](plant_model &p, const hdt_arm &, const HiddenEffect &e) {
        return std::vector<double *>{&(joint_of(p, e).*field)};
    };
}

// One number, and one that says how it fades.
Apply number(double plant_joint::*field, double plant_joint::*second, const char *key)
{
    return [=](plant_model &p, const hdt_arm &, const HiddenEffect &e) {
        joint_of(p, e).*second = option(e, key);
        return std::vector<double *>{&(joint_of(p, e).*field)};
    };
}

plant_line &new_line(plant_model &p, const HiddenEffect &e, double order_rev)
{
    plant_joint &joint = joint_of(p, e);
    if (joint.lines >= PLANT_LINES_MAX)
        refuse(e, "the plant takes at most " + std::to_string(PLANT_LINES_MAX) + " lines a joint");
    plant_line &line = joint.line[joint.lines++];
    line = {};
    line.order_rev = order_rev;
    line.phase_rad = option(e, "phase");
    if (std::isnan(line.phase_rad))
        line.phase_rad = 0;
    return line;
}

std::vector<double *> payload(plant_model &p, const hdt_arm &arm, const HiddenEffect &e)
{
    const double com_m[3] = {0, 0, option(e, "com")};
    if (e.size <= 0)
        refuse(e, "expected a mass above 0 kg");
    if (p.payload_kg > 0) {
        add_payload(p, arm, e.size, com_m);
        return {};
    }
    add_payload(p, arm, e.size, com_m);
    p.payload_kg = 0;
    return {&p.payload_kg};
}

std::vector<double *> link_mass(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    j.mass_kg *= 1 + e.size;
    for (double &x : j.moment_kgm)
        x *= 1 + e.size;
    for (double &x : j.inertia_kgm2)
        x *= 1 + e.size;
    return {};
}

std::vector<double *> base_tilt(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    const double degree = M_PI / 180, tilt = e.size * degree, about = option(e, "about") * degree;
    // gravity in the tilted base: turned the other way about a level axis (Rodrigues)
    const double axis[3] = {std::cos(about), std::sin(about), 0}, c = std::cos(tilt), s = -std::sin(tilt);
    double *g = p.gravity_mps2, along = 0, turned[3];
    for (int i = 0; i < 3; i++)
        along += axis[i] * g[i];
    for (int i = 0; i < 3; i++) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        turned[i] = g[i] * c + (axis[a] * g[b] - axis[b] * g[a]) * s + axis[i] * along * (1 - c);
    }
    std::copy(turned, turned + 3, g);
    return {};
}

std::vector<double *> coupling(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    return {&j.inertia_kgm2[0], &j.inertia_kgm2[3], &j.inertia_kgm2[5]};
}

std::vector<double *> eccentricity(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    j.fx_eccentric_order_rev = option(e, "order");
    j.fx_eccentric_phase_rad = option(e, "phase");
    return {&j.fx_eccentric_rad};
}

std::vector<double *> temperature(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    const double viscous = option(e, "viscous");
    j.fx_warm_s = option(e, "time");
    j.fx_cold_coulomb += e.size;
    j.fx_cold_viscous += std::isnan(viscous) ? 2 * e.size : viscous;
    return {};
}

std::vector<double *> gain_drift(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    if (j.fx_warm_s == 0)
        j.fx_warm_s = option(e, "time");
    return {&j.fx_gain_warm};
}

std::vector<double *> saturation(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    joint_of(p, e).fx_knee_m_nm = option(e, "knee") * joint_of(p, e).tau_max_m_nm;
    return {&joint_of(p, e).fx_knee_share};
}

// Sizes that people give at the output and the motor has on its own side.
std::vector<double *> torque_offset(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    joint_of(p, e).fx_current_offset_m_nm += e.size / joint_of(p, e).ratio;
    return {};
}

std::vector<double *> dead_time(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    j.fx_dead_m_nm += e.size / j.ratio;
    j.fx_dead_width_m_nm = option(e, "width") / j.ratio;
    return {};
}

std::vector<double *> current_ripple(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    joint_of(p, e).fx_current_order_rev = option(e, "motor_order") * joint_of(p, e).ratio;
    return {&joint_of(p, e).fx_current_ripple};
}

std::vector<double *> lost_counts(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    j.fx_resolver_rad += e.size * 2 * M_PI / (16384 * j.ratio);
    return {};
}

std::vector<double *> local_friction(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    j.fx_local_rad = option(e, "at");
    j.fx_local_width_rad = option(e, "width");
    return {&j.fx_local_nm};
}

std::vector<double *> order_line(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_line &line = new_line(p, e, option(e, "order"));
    line.directed = option(e, "directed") != 0;
    return {&line.amplitude_nm};
}

std::vector<double *> cogging(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    return {&new_line(p, e, option(e, "motor_order") * joint_of(p, e).ratio).amplitude_nm};
}

std::vector<double *> ripple_load(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    return {&new_line(p, e, option(e, "order")).per_load};
}

std::vector<double *> ripple_speed(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    return {&new_line(p, e, option(e, "order")).per_speed_nmspr};
}

std::vector<double *> cage_slip(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_line &line = new_line(p, e, option(e, "order"));
    line.run_phase = 1;
    return {&line.amplitude_nm};
}

std::vector<double *> soft_windup(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    if (joint_of(p, e).soft_nm == 0)
        refuse(e, "joint " + std::to_string(e.joint) + " of this arm has no [mesh] in its model file");
    return {&joint_of(p, e).mesh.drive_nm};
}

std::vector<double *> gear_stiffness(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    for (double &k : joint_of(p, e).k_nmprad)
        k *= 1 + e.size;
    return {};
}

std::vector<double *> kinematic_error(plant_model &p, const hdt_arm &, const HiddenEffect &e)
{
    plant_joint &j = joint_of(p, e);
    if (j.errors >= PLANT_ERRORS_MAX)
        refuse(e, "the plant takes at most " + std::to_string(PLANT_ERRORS_MAX) + " a joint");
    plant_error &error = j.error[j.errors++];
    error = {option(e, "motor_order") * j.ratio, 0, option(e, "phase")};
    return {&error.amplitude_rad};
}

const double none = std::numeric_limits<double>::quiet_NaN(); // an option without default

const std::vector<EffectKind> &kinds()
{
    using J = plant_joint;
    static const std::vector<EffectKind> menu = {
        {"payload", "kg", "a body at the flange: no @JOINT", {{"com", 0.05}}, payload},
        {"link_mass", "share", "the link heavier by this share", {}, link_mass},
        {"coupling", "kg m^2", "the link's inertia larger, which other joints feel too", {}, coupling},
        {"base_tilt", "deg", "the base tilted about a level axis at this azimuth: no @JOINT", {{"about", 90}},
         base_tilt},
        {"joint_offset", "rad", "the resolver's zero is off", {}, number(&J::fx_resolver_rad)},
        {"lost_counts", "counts", "the resolver jumps", {{"from", 10}}, lost_counts},
        {"eccentricity", "rad", "the resolver reads ahead by a sine, order per output turn",
         {{"order", 1}, {"phase", 0}}, eccentricity},
        {"cable_spring", "N m/rad", "a hose or cable pulling back to some angle", {{"rest", 0}},
         number(&J::fx_spring_nmprad, &J::fx_spring_q0_rad, "rest")},
        {"contact", "N m", "something pushes the link for a while", {{"from", 10}, {"to", 12}},
         number(&J::fx_contact_nm)},
        {"torque_gain", "share", "the motor gives this share more torque than it reports", {},
         number(&J::fx_torque_gain)},
        {"torque_gain_drift", "share", "the same, coming as the motor warms", {{"time", 30}}, gain_drift},
        {"torque_saturation", "share", "this share is missing beyond a knee, as share of the largest torque",
         {{"knee", 0.3}}, saturation},
        {"torque_offset", "N m", "the current sensor's zero is off", {}, torque_offset},
        {"torque_delay", "s", "the torque is reported late, up to 0.04", {}, number(&J::fx_report_delay_s)},
        {"dead_time", "N m", "torque missing near zero current", {{"width", 10}}, dead_time},
        {"current_ripple", "share", "motor torque rippling in proportion, order per motor turn",
         {{"motor_order", 8}}, current_ripple},
        {"cogging", "N m", "a torque line of some order per motor turn",
         {{"motor_order", 24}, {"phase", 0.7}},
         cogging},
        {"load_friction", "N m/N m", "friction growing with the gear's load", {}, number(&J::fx_load_mu)},
        {"drive_efficiency", "N m/N m", "the same, only while the motor drives the load", {},
         number(&J::fx_drive_mu)},
        {"viscous_nonlinear", "N m s^2/rad^2", "friction times v |v|", {},
         number(&J::fx_quadratic_nms2prad2)},
        {"stribeck_shape", "N m", "more friction at low speed, falling over this speed", {{"speed", 0.03}},
         number(&J::fx_slow_nm, &J::fx_slow_radps, "speed")},
        {"temperature", "share", "cold start: Coulomb and viscous friction higher by this share",
         {{"time", 30}, {"viscous", none}}, temperature},
        {"presliding", "N m", "friction that builds up over some travel after a reversal", {{"travel", 0.02}},
         number(&J::fx_presliding_nm, &J::fx_presliding_rad, "travel")},
        {"dwell_stiction", "N m", "more friction after a stand, per decade of seconds", {{"travel", 0.01}},
         number(&J::fx_dwell_nm, &J::fx_dwell_rad, "travel")},
        {"local_friction", "N m", "a dry spot at some angle", {{"at", 0.3}, {"width", 0.05}}, local_friction},
        {"brake_drag", "N m", "a brake that does not quite let go", {}, number(&J::fx_drag_nm)},
        {"order_line", "N m", "a torque line of some order per output turn",
         {{"order", 37}, {"phase", 0.7}, {"directed", 0}}, order_line},
        {"ripple_load", "N m/N m", "a torque line growing with the gear's load",
         {{"order", 100}, {"phase", 0.7}},
         ripple_load},
        {"ripple_speed", "N m s/rad", "a torque line growing with speed", {{"order", 100}, {"phase", 0.7}},
         ripple_speed},
        {"cage_slip", "N m", "a torque line of an odd order, another phase each run", {{"order", 21.37}},
         cage_slip},
        {"inertia", "kg m^2", "extra inertia on the rotor, referred to the output", {},
         number(&J::fx_inertia_kgm2)},
        {"external_vibration", "N m", "the base shaken from outside", {{"hz", 7.3}},
         number(&J::fx_vibration_nm, &J::fx_vibration_hz, "hz")},
        {"soft_windup", "N m", "the mesh loses more while it is driven forward", {}, soft_windup},
        {"gear_stiffness", "share", "the flexspline stiffer by this share", {}, gear_stiffness},
        {"kinematic_error", "rad", "the gear runs ahead by a sine, order per motor turn",
         {{"motor_order", 2}, {"phase", 0}}, kinematic_error},
        {"run_scatter", "N m", "Coulomb friction scattering from run to run, sigma", {},
         number(&J::run_coulomb_sigma_nm)},
        {"wander", "N m", "friction wandering slowly, sigma", {{"time", 10}},
         number(&J::wander_sigma_nm, &J::wander_s, "time")},
        {"stale_samples", "share", "share of readings that repeat the one before", {},
         number(&J::fx_stale_share)},
    };
    return menu;
}

const EffectKind &kind_of(const std::string &name)
{
    for (const EffectKind &kind : kinds())
        if (name == kind.name)
            return kind;
    throw InputError("--effect: expected NAME=SIZE[@JOINT][:key=value,...], found the name \"" + name +
                     "\"; known effects:\n" + effect_menu());
}

double parse_number(const std::string &text, const std::string &where)
{
    try {
        std::size_t used = 0;
        double value = std::stod(text, &used);
        if (used == text.size() && std::isfinite(value))
            return value;
    } catch (const std::exception &) {
        // falls through to the error below
    }
    throw InputError("--effect " + where + ": expected a number, found \"" + text + "\"");
}

bool known_option(const EffectKind &kind, const std::string &key)
{
    return key == "from" || key == "to"
           || std::any_of(kind.options.begin(), kind.options.end(),
                          [&](const Option &o) { return key == o.first; });
}

void parse_options(const EffectKind &kind, const std::string &text, HiddenEffect *e)
{
    for (std::size_t from = 0; from <= text.size();) {
        std::size_t comma = std::min(text.find(',', from), text.size());
        std::string pair = text.substr(from, comma - from), key = pair.substr(0, pair.find('='));
        if (!known_option(kind, key) || key.size() == pair.size())
            throw InputError("--effect " + e->name + ": unknown option \"" + pair + "\"; the effects are:\n" +
                             effect_menu());
        if (std::any_of(e->options.begin(), e->options.end(), [&](const auto &o) { return o.first == key; }))
            throw InputError("--effect " + e->name + ": option \"" + key + "\" is given twice");
        e->options.emplace_back(key, parse_number(pair.substr(key.size() + 1), e->name + ":" + key));
        from = comma + 1;
    }
}

// Numbers of the plant as offsets: what a scheduled change is made of.
void schedule(plant_model &plant, const HiddenEffect &e, const std::vector<double *> &fields)
{
    const double from = option(e, "from"), to = option(e, "to");
    for (double *field : fields) {
        if (plant.changes >= PLANT_CHANGES_MAX)
            refuse(e, "the plant takes at most " + std::to_string(PLANT_CHANGES_MAX) + " changes in time");
        const auto *base = reinterpret_cast<const char *>(&plant);
        plant.change[plant.changes++] = {
            static_cast<uint32_t>(reinterpret_cast<const char *>(field) - base), e.size,
            std::isnan(from) ? 0 : from, std::isnan(to) ? 1e9 : to};
    }
}

// An effect that has put itself in, as changes: what differs before and after, number by number.
void schedule_difference(plant_model &plant, const plant_model &after, const HiddenEffect &e)
{
    const auto begin = offsetof(plant_model, joint), bytes = sizeof(plant_joint);
    const std::size_t joint = begin + static_cast<std::size_t>(e.joint - 1) * bytes;
    auto differs = [&](std::size_t at, std::size_t count) {
        for (std::size_t k = 0; k < count; k++) {
            double was = 0, is = 0;
            std::copy_n(reinterpret_cast<const char *>(&plant) + at + 8 * k, 8,
                        reinterpret_cast<char *>(&was));
            std::copy_n(reinterpret_cast<const char *>(&after) + at + 8 * k, 8,
                        reinterpret_cast<char *>(&is));
            if (was == is)
                continue;
            HiddenEffect part = e;
            part.size = is - was;
            char *where = reinterpret_cast<char *>(&plant) + at + 8 * k;
            schedule(plant, part, {reinterpret_cast<double *>(where)});
        }
    };
    differs(offsetof(plant_model, gravity_mps2), 7); // and payload_kg, payload_com_m behind it
    differs(joint, bytes / 8);
}

} // namespace

std::string effect_menu()
{
    std::string text;
    for (const EffectKind &kind : kinds()) {
        text += std::string("  ") + kind.name + " (" + kind.unit + "): " + kind.what;
        for (std::size_t i = 0; i < kind.options.size(); i++)
            text += std::string(i == 0 ? "; options " : ", ") + kind.options[i].first;
        text += "\n";
    }
    return text + "  every effect: from, to (s): in the plant only then\n";
}

std::vector<std::string> effect_names()
{
    std::vector<std::string> names;
    for (const EffectKind &kind : kinds())
        names.emplace_back(kind.name);
    return names;
}

HiddenEffect parse_effect(const std::string &text)
{
    HiddenEffect e;
    std::string head = text.substr(0, text.find(':'));
    std::size_t equals = head.find('=');
    e.name = head.substr(0, equals);
    const EffectKind &kind = kind_of(e.name);
    if (equals == std::string::npos)
        throw InputError("--effect " + e.name + ": expected =SIZE in " + kind.unit + ", found nothing");
    std::string size = head.substr(equals + 1);
    std::size_t at = size.find('@');
    if (at != std::string::npos) {
        double joint = parse_number(size.substr(at + 1), e.name + " joint");
        if (joint < 1 || joint > PLANT_JOINTS_MAX || joint != std::floor(joint))
            throw InputError("--effect " + e.name + ": expected a joint from 1, found \"" +
                             size.substr(at + 1) + "\"");
        e.joint = static_cast<int>(joint);
        size.resize(at);
    }
    e.size = parse_number(size, e.name);
    if (head.size() < text.size())
        parse_options(kind, text.substr(head.size() + 1), &e);
    return e;
}

void hide(plant_model &plant, const hdt_arm &arm, const HiddenEffect &effect)
{
    if (effect.joint > plant.joints)
        refuse(effect, "joint " + std::to_string(effect.joint) + " of an arm with " +
               std::to_string(plant.joints));
    const bool timed = !std::isnan(option(effect, "from")) || !std::isnan(option(effect, "to"));
    const Apply &apply = kind_of(effect.name).apply;
    plant_model after = plant;
    if (!timed)
        for (double *field : apply(plant, arm, effect))
            *field += effect.size;
    else if (apply(after, arm, effect).empty())
        schedule_difference(plant, after, effect);
    else
        schedule(plant, effect, apply(plant, arm, effect));
    const char *why = nullptr;
    plant.step_s = 0;
    if (plant_model_check(&plant, &why) != 0)
        refuse(effect, std::string("the plant cannot take it: ") + why);
}

void hide_all(plant_model &plant, const hdt_arm &arm, const std::vector<std::string> &effects,
              const std::string &effect_file)
{
    try {
        for (const std::string &text : effects)
            hide(plant, arm, parse_effect(text));
    } catch (const InputError &e) {
        throw UsageError(e.what());
    }
    if (effect_file.empty())
        return;
    for (const auto &[number, text] : effect_lines(effect_file)) {
        try {
            hide(plant, arm, parse_effect(text));
        } catch (const InputError &e) {
            throw InputError(at(effect_file, number) + ": " + e.what());
        }
    }
}

std::vector<std::pair<std::size_t, std::string>> effect_lines(const std::string &path)
{
    const std::string bytes = read_text(path);
    std::vector<std::pair<std::size_t, std::string>> effects;
    LineReader lines(bytes);
    for (std::string_view line; lines.next(line);)
        if (line = trim(line); !line.empty() && line[0] != '#')
            effects.emplace_back(lines.number(), line);
    if (effects.empty())
        throw InputError(path + ": expected one NAME=SIZE[@JOINT] a line, found none");
    return effects;
}

void add_payload(plant_model &plant, const hdt_arm &arm, double mass_kg, const double *com_m)
{
    double before = plant.payload_kg;
    plant.payload_kg += mass_kg;
    for (int i = 0; i < 3; i++) {
        double at = arm.flange_m[i];
        for (int k = 0; k < 3; k++)
            at += arm.flange_rot[3 * i + k] * com_m[k];
        plant.payload_com_m[i] = (before * plant.payload_com_m[i] + mass_kg * at) / plant.payload_kg;
    }
}

} // namespace hdt::rig
