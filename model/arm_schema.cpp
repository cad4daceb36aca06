// SPDX-License-Identifier: Apache-2.0
//
// The key table of the model file (docs/formats.md), and the search in it.
//
// Owns: which keys exist, in the order they are written.
// Never: sees a document.
#include "model/arm_document.hpp"

#include <algorithm>
#include <cctype>

namespace hdt::arm {

namespace {

KeySpec text_key(const char *key)
{
    return {key, Kind::Text, "", 0, "", false, Range::Any};
}

KeySpec number_key(const char *key, const char *unit, int count = 1, Range range = Range::Any)
{
    return {key, Kind::Number, unit, count, "", false, range};
}

KeySpec sided_key(const char *key, const char *unit, const char *side, Range range = Range::Any,
                  int count = 1)
{
    return {key, Kind::Number, unit, count, side, true, range};
}

// Effects are output side by definition; the file may say so or leave it out.
KeySpec effect_key(const char *key, const char *unit, Range range = Range::Any)
{
    return {key, Kind::Number, unit, 1, "output", false, range};
}

std::vector<std::string> split(const std::string &key)
{
    std::vector<std::string> parts;
    std::size_t begin = 0;
    for (std::size_t dot = key.find('.'); dot != std::string::npos; dot = key.find('.', begin)) {
        parts.push_back(key.substr(begin, dot - begin));
        begin = dot + 1;
    }
    parts.push_back(key.substr(begin));
    return parts;
}

bool part_matches(const std::string &pattern, const std::string &part)
{
    if (pattern == "#")
        return !part.empty() && part.size() <= 4 && part[0] != '0'
               && std::all_of(part.begin(), part.end(),
                              [](char c) { return c >= '0' && c <= '9'; });
    if (pattern == "*")
        return !part.empty() && std::all_of(part.begin(), part.end(), [](char c) {
            return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-';
        });
    return pattern == part;
}

// Do the first parts of the pattern match all parts of the key?
bool prefix_matches(const std::vector<std::string> &pattern, const std::vector<std::string> &key)
{
    if (pattern.size() < key.size())
        return false;
    for (std::size_t i = 0; i < key.size(); i++)
        if (!part_matches(pattern[i], key[i]))
            return false;
    return true;
}

std::size_t edit_distance(const std::string &a, const std::string &b)
{
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); j++)
        row[j] = j;
    for (std::size_t i = 1; i <= a.size(); i++) {
        std::size_t diagonal = row[0];
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); j++) {
            const std::size_t replace = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
            diagonal = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, replace});
        }
    }
    return row[b.size()];
}

void add_joint_keys(std::vector<KeySpec> *table)
{
    const Range positive = Range::Positive, non_negative = Range::NonNegative;
    table->insert(
        table->end(),
        {
            text_key("joint.#.name"),
            number_key("joint.#.origin", "m", 3),
            number_key("joint.#.rpy", "rad", 3),
            number_key("joint.#.limits.position", "rad", 2),
            number_key("joint.#.limits.speed", "rad/s", 1, positive),
            number_key("joint.#.link.mass", "kg", 1, non_negative),
            number_key("joint.#.link.com", "m", 3),
            number_key("joint.#.link.inertia", "kg m^2", 6),
            number_key("joint.#.link.first_moment", "kg m", 3),
            number_key("joint.#.link.inertia_origin", "kg m^2", 6),
            number_key("joint.#.gear.ratio", "1", 1, positive),
            text_key("joint.#.gear.size"),
            sided_key("joint.#.gear.k1", "N m/rad", "output", positive),
            sided_key("joint.#.gear.k2", "N m/rad", "output", positive),
            sided_key("joint.#.gear.k3", "N m/rad", "output", positive),
            sided_key("joint.#.gear.t1", "N m", "output", positive),
            sided_key("joint.#.gear.t2", "N m", "output", positive),
            sided_key("joint.#.mesh.soft_torque", "N m", "output", positive),
            sided_key("joint.#.mesh.soft_stiffness", "N m/rad", "output", positive),
            sided_key("joint.#.mesh.hard_stiffness", "N m/rad", "output", positive),
            sided_key("joint.#.mesh.drive_loss", "N m", "output", non_negative),
            sided_key("joint.#.mesh.back_loss", "N m", "output", non_negative),
            sided_key("joint.#.mesh.drive_load", "N m/N m", "output", non_negative),
            sided_key("joint.#.mesh.back_load", "N m/N m", "output", non_negative),
            sided_key("joint.#.gear.wave_generator_inertia", "kg m^2", "motor", non_negative),
            sided_key("joint.#.motor.rotor_inertia", "kg m^2", "motor", non_negative),
            sided_key("joint.#.motor.torque_rated", "N m", "motor", positive),
            sided_key("joint.#.motor.torque_max", "N m", "motor", positive),
            number_key("joint.#.friction.valid", "rad/s", 2, non_negative),
            number_key("joint.#.friction_by_position.span", "rad", 2),
            sided_key("joint.#.friction_by_position.positive", "N m", "output", Range::Any,
                      HDT_ARM_CURVE_POINTS),
            sided_key("joint.#.friction_by_position.negative", "N m", "output", Range::Any,
                      HDT_ARM_CURVE_POINTS),
            number_key("joint.#.table.over_position", "rad", 2),
            sided_key("joint.#.table.over_load", "N m", "output", Range::Any, 2),
            number_key("joint.#.table.over_wave_generator", "1", 2),
            number_key("joint.#.table.over_speed", "rad/s", 2, non_negative),
            sided_key("joint.#.table.torque", "N m", "output", Range::Any, HDT_ARM_CURVE_POINTS),
            {"joint.#.table.directed", Kind::Flag, "", 0, "", false, Range::Any},
            sided_key("joint.#.friction.positive.f0", "N m", "output", non_negative),
            sided_key("joint.#.friction.positive.fv", "N m s/rad", "output"),
            sided_key("joint.#.friction.positive.fs", "N m", "output"),
            sided_key("joint.#.friction.positive.vc", "rad/s", "output", positive),
            sided_key("joint.#.friction.negative.f0", "N m", "output", non_negative),
            sided_key("joint.#.friction.negative.fv", "N m s/rad", "output"),
            sided_key("joint.#.friction.negative.fs", "N m", "output"),
            sided_key("joint.#.friction.negative.vc", "rad/s", "output", positive),
            sided_key("joint.#.stiffness.positive.slope", "N m/N m", "output", Range::Any, 3),
            sided_key("joint.#.stiffness.positive.t1", "N m", "output"),
            sided_key("joint.#.stiffness.positive.t2", "N m", "output"),
            sided_key("joint.#.stiffness.positive.zero", "N m", "output"),
            sided_key("joint.#.stiffness.negative.slope", "N m/N m", "output", Range::Any, 3),
            sided_key("joint.#.stiffness.negative.t1", "N m", "output"),
            sided_key("joint.#.stiffness.negative.t2", "N m", "output"),
            sided_key("joint.#.stiffness.negative.zero", "N m", "output"),
            number_key("joint.#.stiffness.travel", "rad", 1, positive),
            sided_key("joint.#.feedback.kp", "N m/rad", "motor", non_negative),
            sided_key("joint.#.feedback.kd", "N m s/rad", "motor", non_negative),
        });
}

void add_array_keys(std::vector<KeySpec> *table)
{
    table->insert(table->end(),
                  {
                      number_key("joint.#.ripple.#.wave_generator_order", "1", 1, Range::Whole),
                      sided_key("joint.#.ripple.#.amplitude", "N m", "output"),
                      number_key("joint.#.ripple.#.phase", "rad"),
                      number_key("joint.#.kinematic_error.#.wave_generator_order", "1", 1, Range::Whole),
                      sided_key("joint.#.kinematic_error.#.amplitude", "rad", "output"),
                      number_key("joint.#.kinematic_error.#.phase", "rad"),
                      text_key("joint.#.effect.#.id"),
                      effect_key("joint.#.effect.#.gain", "1", Range::Positive),
                      effect_key("joint.#.effect.#.mu", "N m/N m"),
                      effect_key("joint.#.effect.#.torque", "N m"),
                      effect_key("joint.#.effect.#.travel", "rad", Range::Positive),
                      effect_key("joint.#.effect.#.coulomb", "N m"),
                      effect_key("joint.#.effect.#.viscous", "N m s/rad"),
                      effect_key("joint.#.effect.#.time_constant", "s", Range::Positive),
                      effect_key("joint.#.effect.#.stiffness", "N m/rad"),
                      effect_key("joint.#.effect.#.rest", "rad"),
                      effect_key("joint.#.effect.#.inertia", "kg m^2"),
                      effect_key("joint.#.effect.#.at", "rad"),
                      effect_key("joint.#.effect.#.width", "rad", Range::Positive),
                      effect_key("joint.#.effect.#.order", "1", Range::Positive),
                      effect_key("joint.#.effect.#.amplitude", "N m"),
                      effect_key("joint.#.effect.#.phase", "rad"),
                      {"joint.#.effect.#.directed", Kind::Flag, "", 0, "", false, Range::Any},
                  });
}

} // namespace

const std::vector<KeySpec> &key_table()
{
    static const std::vector<KeySpec> table = [] {
        std::vector<KeySpec> t = {
            text_key("format"),
            text_key("name"),
            text_key("sources.*"),
            number_key("base.gravity", "m/s^2", 3),
            number_key("control.rate", "Hz", 1, Range::Positive),
            number_key("control.velocity_cutoff", "Hz", 1, Range::Positive),
            text_key("control.feedback_velocity"),
            text_key("control.friction_velocity"),
            number_key("flange.origin", "m", 3),
            number_key("flange.rpy", "rad", 3),
            number_key("payload.mass", "kg", 1, Range::NonNegative),
            number_key("payload.com", "m", 3),
        };
        add_joint_keys(&t);
        add_array_keys(&t);
        return t;
    }();
    return table;
}

const KeySpec *find_spec(const std::string &key)
{
    const std::vector<std::string> parts = split(key);
    for (const KeySpec &spec : key_table()) {
        const std::vector<std::string> pattern = split(spec.key);
        if (pattern.size() == parts.size() && prefix_matches(pattern, parts))
            return &spec;
    }
    return nullptr;
}

bool is_table(const std::string &key)
{
    const std::vector<std::string> parts = split(key);
    for (const KeySpec &spec : key_table()) {
        const std::vector<std::string> pattern = split(spec.key);
        if (pattern.size() > parts.size() && prefix_matches(pattern, parts))
            return true;
    }
    return false;
}

bool is_array(const std::string &key)
{
    return is_table(key + ".1") && part_matches("*", key.substr(key.rfind('.') + 1))
           && !is_table(key + ".x") && find_spec(key + ".x") == nullptr;
}

std::string nearest_of(const std::string &name, const std::vector<std::string> &names)
{
    std::string best;
    std::size_t best_distance = std::max<std::size_t>(2, name.size() / 2) + 1;
    for (const std::string &candidate : names) {
        const std::size_t distance = edit_distance(name, candidate);
        if (distance < best_distance) {
            best_distance = distance;
            best = candidate;
        }
    }
    return best;
}

std::string nearest(const std::string &key)
{
    std::vector<std::string> parts = split(key);
    const std::string name = parts.back();
    parts.pop_back();
    std::vector<std::string> sisters;
    if (parts.empty())
        sisters.push_back("version");
    for (const KeySpec &spec : key_table()) {
        const std::vector<std::string> pattern = split(spec.key);
        if (pattern.size() > parts.size() && prefix_matches(pattern, parts)
            && pattern[parts.size()] != "#" && pattern[parts.size()] != "*")
            sisters.push_back(pattern[parts.size()]);
    }
    // a long foreign key must not cost quadratic time
    return nearest_of(name.substr(0, 64), sisters);
}

} // namespace hdt::arm
