// SPDX-License-Identifier: Apache-2.0
//
// Document to struct hdt_arm: groups complete, limits in order, names unique, inertia possible.
//
// Owns: what keys must say together; conversion to the joint origin.
// Never: changes the document.
#include "model/arm_document.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>

#include <Eigen/Dense>

namespace hdt::arm {

namespace {

struct EffectSpec {
    const char *id;
    std::vector<std::string> numbers; // each required
};

const std::vector<EffectSpec> &effect_table()
{
    static const std::vector<EffectSpec> table = {
        {"torque_gain", {"gain"}},
        {"torque_offset", {"torque"}},
        {"load_friction", {"mu"}},
        {"temperature", {"coulomb", "viscous", "time_constant"}},
        {"presliding", {"torque", "travel"}},
        {"cable_spring", {"stiffness", "rest"}},
        {"inertia", {"inertia"}},
        {"local_friction", {"torque", "at", "width"}},
        {"order_line", {"order", "amplitude", "phase", "directed"}},
    };
    return table;
}

struct Reader {
    const Document &d;

    void need(const std::string &key) const
    {
        if (d.has(key))
            return;
        const KeySpec *spec = find_spec(key);
        if (spec && spec->kind == Kind::Number)
            d.fail(key,
                   std::string("expected a quantity in \"") + spec->unit + "\", found nothing");
        d.fail(key, "expected a text, found nothing");
    }

    double number(const std::string &key) const
    {
        need(key);
        return d.entries.at(key).quantity.value[0];
    }

    // 1 for the second of two words, 0 for the first or none.
    int choice(const std::string &key, const char *first, const char *second) const
    {
        if (!d.has(key) || text(key) == first)
            return 0;
        if (text(key) != second)
            d.fail(key, std::string("expected \"") + first + "\" or \"" + second + "\", found "
                            + quote(text(key).substr(0, 40)));
        return 1;
    }

    double number_or(const std::string &key, double fallback) const
    {
        return d.has(key) ? number(key) : fallback;
    }

    void numbers(const std::string &key, double *out) const
    {
        need(key);
        const std::vector<double> &value = d.entries.at(key).quantity.value;
        std::copy(value.begin(), value.end(), out);
    }

    const std::string &text(const std::string &key) const
    {
        need(key);
        return d.entries.at(key).text;
    }

    // All of the names or none: true, false, or an error naming the first that is missing.
    bool group(const std::string &prefix, const std::vector<std::string> &names) const
    {
        std::string all, missing;
        std::size_t have = 0;
        for (const std::string &name : names) {
            all += (all.empty() ? "" : ", ") + name;
            if (d.has(prefix + name))
                have++;
            else if (missing.empty())
                missing = name;
        }
        if (have != 0 && have != names.size())
            d.fail(prefix + missing, "expected with its group (" + all + "), found nothing");
        return have != 0;
    }
};

// Roll, pitch, yaw about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll), row-major.
void rotation(const double rpy[3], double rot[9])
{
    using Eigen::AngleAxisd;
    using Eigen::Vector3d;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> out(rot);
    out = (AngleAxisd(rpy[2], Vector3d::UnitZ()) * AngleAxisd(rpy[1], Vector3d::UnitY())
           * AngleAxisd(rpy[0], Vector3d::UnitX()))
              .toRotationMatrix();
    // right angles give exact zeros and ones, so that planar arms stay planar
    for (int i = 0; i < 9; i++)
        if (std::fabs(rot[i] - std::round(rot[i])) < 1e-15)
            rot[i] = std::round(rot[i]);
}

void copy_name(const Reader &r, const std::string &key, char *out, std::size_t size)
{
    const std::string &name = r.text(key);
    const bool printable = std::all_of(name.begin(), name.end(), [](char c) {
        return std::isgraph(static_cast<unsigned char>(c));
    });
    if (name.empty() || name.size() >= size || !printable)
        r.d.fail(key, "expected 1 to " + std::to_string(size - 1)
                          + " printable characters without blanks, found "
                          + quote(name.substr(0, 80)));
    std::memcpy(out, name.c_str(), name.size() + 1);
}

// No mass distribution has an inertia that is not positive semidefinite or whose largest principal
// moment exceeds the sum of the others.
void check_inertia(const Reader &r, const std::string &key, const Eigen::Matrix3d &inertia)
{
    const Eigen::Vector3d principal =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(inertia, Eigen::EigenvaluesOnly)
            .eigenvalues();
    const double slack = 1e-9 * principal.cwiseAbs().maxCoeff();
    const std::string found = "principal moments " + number_text(principal[0]) + ", "
                              + number_text(principal[1]) + ", " + number_text(principal[2]);
    if (!(principal[0] >= -slack))
        r.d.fail(key, "expected an inertia about the com with no negative principal moment, found "
                          + found);
    if (!(principal[2] <= principal[0] + principal[1] + slack))
        r.d.fail(key,
                 "expected no principal moment above the sum of the other two, found " + found);
}

void read_link(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string link = joint + "link.";
    if (!r.d.has_below(joint + "link"))
        return;
    const bool origin_form = r.d.has(link + "first_moment") || r.d.has(link + "inertia_origin");
    if (origin_form)
        for (const char *other : {"com", "inertia"})
            if (r.d.has(link + other))
                r.d.fail(link + other,
                         "expected either com and inertia or first_moment and inertia_origin, "
                         "found both forms");
    out->has_inertial = 1;
    if (origin_form) {
        r.group(link, {"mass", "first_moment", "inertia_origin"});
        out->mass_kg = r.number(link + "mass");
        r.numbers(link + "first_moment", out->moment_kgm);
        r.numbers(link + "inertia_origin", out->inertia_kgm2);
        return;
    }
    r.group(link, {"mass", "com", "inertia"});
    double com[3], i[6];
    out->mass_kg = r.number(link + "mass");
    r.numbers(link + "com", com);
    r.numbers(link + "inertia", i);
    Eigen::Matrix3d inertia;
    inertia << i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5];
    check_inertia(r, link + "inertia", inertia);
    // parallel axes: about the joint origin
    const Eigen::Vector3d c(com[0], com[1], com[2]);
    inertia += out->mass_kg * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
    for (int axis = 0; axis < 3; axis++)
        out->moment_kgm[axis] = out->mass_kg * com[axis];
    const double about_origin[6] = {inertia(0, 0), inertia(0, 1), inertia(0, 2),
                                    inertia(1, 1), inertia(1, 2), inertia(2, 2)};
    std::copy(about_origin, about_origin + 6, out->inertia_kgm2);
}

void read_drive(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string gear = joint + "gear.", motor = joint + "motor.";
    out->ratio = r.number(gear + "ratio");
    out->has_gear = r.group(gear, {"k1", "k2", "k3", "t1", "t2"}) ? 1 : 0;
    if (out->has_gear) {
        const char *stiffness[3] = {"k1", "k2", "k3"};
        for (int i = 0; i < 3; i++)
            out->k_nmprad[i] = r.number(gear + stiffness[i]);
        out->t_nm[0] = r.number(gear + "t1");
        out->t_nm[1] = r.number(gear + "t2");
        if (!(out->t_nm[0] < out->t_nm[1]))
            r.d.fail(gear + "t2", "expected above t1 = " + number_text(out->t_nm[0]) + ", found "
                                      + number_text(out->t_nm[1]));
    }
    out->wave_generator_kgm2_m = r.number_or(gear + "wave_generator_inertia", 0);
    out->rotor_kgm2_m = r.number_or(motor + "rotor_inertia", 0);
    out->tau_rated_m_nm = r.number_or(motor + "torque_rated", 0);
    out->tau_max_m_nm = r.number_or(motor + "torque_max", 0);
    if (r.group(joint + "feedback.", {"kp", "kd"})) {
        out->kp_m_nmprad = r.number(joint + "feedback.kp");
        out->kd_m_nmspr = r.number(joint + "feedback.kd");
    }
}

void read_mesh(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string mesh = joint + "mesh.", array = joint + "kinematic_error";
    out->has_mesh = r.group(mesh, {"soft_torque", "soft_stiffness", "hard_stiffness", "drive_loss",
                                   "back_loss", "drive_load", "back_load"})
                        ? 1
                        : 0;
    if (out->has_mesh) {
        out->mesh = {r.number(mesh + "soft_torque"),    r.number(mesh + "soft_stiffness"),
                     r.number(mesh + "hard_stiffness"), r.number(mesh + "drive_loss"),
                     r.number(mesh + "back_loss"),      r.number(mesh + "drive_load"),
                     r.number(mesh + "back_load")};
        if (out->mesh.back_nm > out->mesh.drive_nm)
            r.d.fail(mesh + "back_loss", "expected at most drive_loss = " + number_text(out->mesh.drive_nm)
                                             + ", found " + number_text(out->mesh.back_nm));
    }
    out->errors = r.d.count(array);
    if (out->errors > HDT_ARM_ERRORS_MAX)
        r.d.fail(array, "expected at most " + std::to_string(HDT_ARM_ERRORS_MAX)
                            + " kinematic errors a joint, found " + std::to_string(out->errors));
    for (int i = 0; i < out->errors; i++) {
        const std::string at = array + "." + std::to_string(i + 1) + ".";
        out->error[i] = {r.number(at + "wave_generator_order") * out->ratio, r.number(at + "amplitude"),
                         r.number(at + "phase")};
    }
}

void read_friction(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string friction = joint + "friction.";
    out->friction_v_max_radps = out->v_max_radps;
    if (r.d.has(friction + "valid")) {
        double valid[2];
        r.numbers(friction + "valid", valid);
        if (!(valid[0] < valid[1]))
            r.d.fail(friction + "valid", "expected the lower speed first, found "
                                             + number_text(valid[0]) + ", "
                                             + number_text(valid[1]));
        out->friction_v_min_radps = valid[0];
        out->friction_v_max_radps = valid[1];
    }
    out->has_friction =
        r.group(friction, {"positive.f0", "positive.fv", "positive.fs", "positive.vc",
                           "negative.f0", "negative.fv", "negative.fs", "negative.vc"})
            ? 1
            : 0;
    if (!out->has_friction)
        return;
    const char *direction[2] = {"positive.", "negative."};
    for (int i = 0; i < 2; i++) {
        const std::string at = friction + direction[i];
        out->friction[i] = {r.number(at + "f0"), r.number(at + "fv"), r.number(at + "fs"),
                            r.number(at + "vc")};
    }
}

void read_stiffness(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string stiffness = joint + "stiffness.";
    out->has_stiffness =
        r.group(stiffness, {"positive.slope", "positive.t1", "positive.t2", "positive.zero",
                            "negative.slope", "negative.t1", "negative.t2", "negative.zero"})
            ? 1
            : 0;
    if (!out->has_stiffness)
        return;
    const char *direction[2] = {"positive.", "negative."};
    for (int i = 0; i < 2; i++) {
        const std::string at = stiffness + direction[i];
        r.numbers(at + "slope", out->stiffness[i].slope);
        out->stiffness[i].t1_nm = r.number(at + "t1");
        out->stiffness[i].t2_nm = r.number(at + "t2");
        out->stiffness[i].zero_nm = r.number(at + "zero");
        if (!(out->stiffness[i].t1_nm < out->stiffness[i].t2_nm))
            r.d.fail(at + "t2", "expected above t1 = " + number_text(out->stiffness[i].t1_nm)
                                    + ", found " + number_text(out->stiffness[i].t2_nm));
    }
}

void read_ripples(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string array = joint + "ripple";
    const int count = r.d.count(array);
    if (count > HDT_ARM_LINES_MAX)
        r.d.fail(array, "expected at most " + std::to_string(HDT_ARM_LINES_MAX)
                            + " ripples a joint, found " + std::to_string(count));
    for (int i = 0; i < count; i++) {
        const std::string at = array + "." + std::to_string(i + 1) + ".";
        out->ripple[i] = {r.number(at + "wave_generator_order") * out->ratio,
                          r.number(at + "amplitude"), r.number(at + "phase"), 1};
    }
    out->ripples = count;
}

void check_effect_keys(const Reader &r, const std::string &at, const EffectSpec &spec)
{
    std::string all;
    for (const std::string &name : spec.numbers)
        all += (all.empty() ? "" : ", ") + name;
    for (const std::string &name : spec.numbers)
        if (!r.d.has(at + name))
            r.d.fail(at + name,
                     std::string("expected ") + spec.id + " with " + all + ", found nothing");
    for (auto entry = r.d.entries.lower_bound(at);
         entry != r.d.entries.end() && entry->first.compare(0, at.size(), at) == 0; ++entry) {
        const std::string name = entry->first.substr(at.size());
        if (name != "id"
            && std::find(spec.numbers.begin(), spec.numbers.end(), name) == spec.numbers.end())
            r.d.fail(entry->first,
                     std::string("expected ") + spec.id + " with only " + all + ", found " + name);
    }
}

const EffectSpec &find_effect(const Reader &r, const std::string &key)
{
    const std::string &id = r.text(key);
    std::vector<std::string> ids;
    for (const EffectSpec &spec : effect_table()) {
        if (id == spec.id)
            return spec;
        ids.push_back(spec.id);
    }
    static const std::vector<std::string> termless = {
        "joint_offset", "torque_saturation", "torque_delay", "drive_efficiency", "viscous_nonlinear",
        "stribeck_shape", "ripple_load", "ripple_speed", "coupling", "eccentricity",
        "external_vibration", "soft_windup"};
    if (std::find(termless.begin(), termless.end(), id) != termless.end())
        r.d.fail(key, "expected an effect the control core has a term for, found " + quote(id)
                          + ", which diagnosis can name and no table can hold");
    if (id == "payload" || id == "link_mass" || id == "base_tilt")
        r.d.fail(key, "expected an effect of one joint, found " + quote(id)
                          + ", which changes payload, link or base.gravity");
    const std::string near = nearest_of(id.substr(0, 64), ids);
    r.d.fail(key, "expected an effect id of docs/formats.md"
                      + (near.empty() ? "" : " (did you mean " + near + "?)") + ", found "
                      + quote(id.substr(0, 40)));
}

void read_effect(const Reader &r, const std::string &at, const std::string &id, hdt_arm_joint *out)
{
    if (id == "torque_gain") {
        out->torque_gain = r.number(at + "gain");
    } else if (id == "torque_offset") {
        out->torque_offset_nm = r.number(at + "torque");
    } else if (id == "load_friction") {
        out->load_mu = r.number(at + "mu");
    } else if (id == "temperature") {
        out->cold_coulomb_nm = r.number(at + "coulomb");
        out->cold_viscous_nmspr = r.number(at + "viscous");
        out->warm_s = r.number(at + "time_constant");
    } else if (id == "presliding") {
        out->presliding_nm = r.number(at + "torque");
        out->presliding_rad = r.number(at + "travel");
    } else if (id == "cable_spring") {
        out->spring_nmprad = r.number(at + "stiffness");
        out->spring_q0_rad = r.number(at + "rest");
    } else if (id == "inertia") {
        out->extra_inertia_kgm2 = r.number(at + "inertia");
    } else if (id == "local_friction") {
        if (out->bumps == HDT_ARM_BUMPS_MAX)
            r.d.fail(at + "id", "expected at most " + std::to_string(HDT_ARM_BUMPS_MAX)
                                    + " local_friction effects a joint, found one more");
        out->bump[out->bumps++] = {r.number(at + "torque"), r.number(at + "at"), r.number(at + "width")};
    } else {
        if (out->lines == HDT_LINES_MAX)
            r.d.fail(at + "id", "expected at most " + std::to_string(HDT_LINES_MAX)
                                    + " order_line effects a joint, found one more");
        out->line[out->lines++] = {r.number(at + "order"), r.number(at + "amplitude"),
                                   r.number(at + "phase"),
                                   r.d.entries.at(at + "directed").flag ? 1 : 0};
    }
}

void read_effects(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    std::vector<std::string> seen;
    out->torque_gain = 1;
    for (int i = 1; i <= r.d.count(joint + "effect"); i++) {
        const std::string at = joint + "effect." + std::to_string(i) + ".";
        const EffectSpec &spec = find_effect(r, at + "id");
        check_effect_keys(r, at, spec);
        const std::string id(spec.id);
        if (id != "order_line" && id != "local_friction"
            && std::find(seen.begin(), seen.end(), id) != seen.end())
            r.d.fail(at + "id", "expected one " + id + " a joint, found a second");
        seen.push_back(id);
        read_effect(r, at, id, out);
    }
}

void read_curve(const Reader &r, const std::string &span, const std::string &torque, hdt_arm_curve *out)
{
    double ends[2];
    r.numbers(span, ends);
    if (!(ends[0] < ends[1]))
        r.d.fail(span, "expected the lower end first, found " + number_text(ends[0]) + ", "
                           + number_text(ends[1]));
    out->from = ends[0];
    out->to = ends[1];
    r.numbers(torque, out->nm);
}

void read_curves(const Reader &r, const std::string &joint, hdt_arm_joint *out)
{
    const std::string local = joint + "friction_by_position.", table = joint + "table.";
    out->has_local = r.group(local, {"span", "positive", "negative"}) ? 1 : 0;
    if (out->has_local) {
        read_curve(r, local + "span", local + "positive", &out->local[0]);
        read_curve(r, local + "span", local + "negative", &out->local[1]);
    }
    static const char *const axes[HDT_AXES] = {"over_position", "over_load", "over_wave_generator",
                                               "over_speed"};
    int found = 0;
    for (int axis = 0; axis < HDT_AXES; axis++)
        if (r.d.has(table + axes[axis])) {
            out->table_axis = axis;
            if (++found > 1)
                r.d.fail(table + axes[axis], "expected a table over one axis, found a second");
        }
    if (found == 0) {
        for (const char *name : {"torque", "directed"})
            if (r.d.has(table + name))
                r.d.fail(table + name, "expected a table over_position, over_load, over_wave_generator "
                                       "or over_speed, found none of them");
        return;
    }
    const std::string over = table + axes[out->table_axis];
    r.need(table + "torque");
    read_curve(r, over, table + "torque", &out->table);
    if (out->table_axis == HDT_AXIS_PHASE && !(out->table.from == 0 && out->table.to == 1))
        r.d.fail(over, "expected one turn, [0, 1], found " + number_text(out->table.from) + ", "
                           + number_text(out->table.to));
    out->table_directed = r.d.has(table + "directed") && r.d.entries.at(table + "directed").flag ? 1 : 0;
    out->has_table = 1;
}

void read_joint(const Reader &r, int number, hdt_arm *arm)
{
    hdt_arm_joint *out = &arm->joint[number - 1];
    const std::string joint = "joint." + std::to_string(number) + ".";
    copy_name(r, joint + "name", out->name, sizeof out->name);
    for (int other = 1; other < number; other++)
        if (std::strcmp(arm->joint[other - 1].name, out->name) == 0)
            r.d.fail(joint + "name", "expected a name of its own, found " + quote(out->name)
                                         + " as for joint " + std::to_string(other));
    double rpy[3], limits[2];
    r.numbers(joint + "origin", out->origin_m);
    r.numbers(joint + "rpy", rpy);
    rotation(rpy, out->rot);
    r.numbers(joint + "limits.position", limits);
    if (!(limits[0] < limits[1]))
        r.d.fail(joint + "limits.position", "expected the lower limit first, found "
                                                + number_text(limits[0]) + ", "
                                                + number_text(limits[1]));
    out->q_min_rad = limits[0];
    out->q_max_rad = limits[1];
    out->v_max_radps = r.number(joint + "limits.speed");
    read_link(r, joint, out);
    read_drive(r, joint, out);
    read_mesh(r, joint, out);
    read_friction(r, joint, out);
    read_ripples(r, joint, out);
    read_stiffness(r, joint, out);
    read_effects(r, joint, out);
    read_curves(r, joint, out);
    out->windup_rad = r.number_or(joint + "stiffness.travel", 0);
}

void check_sources(const Document &d)
{
    std::vector<std::string> sources;
    for (const auto &[key, entry] : d.entries)
        if (key.compare(0, 8, "sources.") == 0)
            sources.push_back(key.substr(8));
    for (const auto &[key, entry] : d.entries) {
        const std::string &source = entry.quantity.source;
        if (entry.kind != Kind::Number || d.has("sources." + source))
            continue;
        const std::string near = nearest_of(source.substr(0, 64), sources);
        d.fail(key, "expected a source named in [sources]"
                        + (near.empty() ? "" : " (did you mean " + near + "?)") + ", found "
                        + quote(source.substr(0, 40)));
    }
}

} // namespace

hdt_arm derive_arm(const Document &d)
{
    const Reader r{d};
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    copy_name(r, "name", arm.name, sizeof arm.name);
    check_sources(d);
    r.numbers("base.gravity", arm.gravity_mps2);
    if (r.group("control.", {"rate", "velocity_cutoff"})) {
        arm.control_rate_hz = r.number("control.rate");
        arm.velocity_cutoff_hz = r.number("control.velocity_cutoff");
        arm.observe_feedback = r.choice("control.feedback_velocity", "filtered", "observed");
        arm.observe_friction = r.choice("control.friction_velocity", "desired", "observed");
        if (!(arm.velocity_cutoff_hz < arm.control_rate_hz / 2))
            d.fail("control.velocity_cutoff",
                   "expected below half of control.rate = " + number_text(arm.control_rate_hz)
                       + ", found " + number_text(arm.velocity_cutoff_hz));
    }
    double rpy[3];
    r.numbers("flange.origin", arm.flange_m);
    r.numbers("flange.rpy", rpy);
    rotation(rpy, arm.flange_rot);
    if (r.group("payload.", {"mass", "com"})) {
        arm.payload_kg = r.number("payload.mass");
        r.numbers("payload.com", arm.payload_com_m);
    }
    arm.joints = d.count("joint");
    if (arm.joints < 1)
        d.fail("joint", "expected at least one [[joint]], found none");
    if (arm.joints > HDT_ARM_JOINTS_MAX)
        d.fail("joint", "expected at most " + std::to_string(HDT_ARM_JOINTS_MAX) + " joints, found "
                            + std::to_string(arm.joints));
    for (int j = 1; j <= arm.joints; j++)
        read_joint(r, j, &arm);
    return arm;
}

} // namespace hdt::arm
