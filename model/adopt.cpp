// SPDX-License-Identifier: Apache-2.0
//
// Owns: names and units of effect numbers, writing them into the model file (see adopt.hpp).
// Never: estimates.
#include "model/adopt.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "model/text.hpp"

namespace hdt {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr const char *kSource = "hdt-diagnose", *kSourceWords = "hdt diagnose, from the logs given to it";
constexpr double kRestMax_rad = 3.2, kTiltKnown_rad = 1;

void cite(ArmFile *file) { file->set_text(std::string("sources.") + kSource, kSourceWords); }

double sd(const MatrixXd &c, Eigen::Index k) { return std::sqrt(std::max(0.0, c(k, k))); }

// Reported torque is the measured one: with gain 1/(1+c) every fitted torque shrinks by that factor.
double gain_scale(const JointWork &w, const JointEstimate &e)
{
    for (std::size_t k = 0; k < w.found.size(); ++k)
        if (w.found[k].family.id == "torque_gain")
            return 1 / (1 + e.theta[k][0]);
    return 1;
}

// A spring's rest shows as a difference between the directions' Coulomb friction.
double spring_rest(const JointEstimate &e, double stiffness)
{
    const double rest = -0.5 * (e.friction[0] - e.friction[1]) / stiffness;
    return std::abs(rest) < kRestMax_rad ? rest : 0;
}

// What the runs carry as far as was known: their own declaration, else the model file's.
struct Carried {
    double least_kg, most_kg;
    Vector3d com_m;
    bool alike, declared;  // the same in every run; by any of the runs
};

Carried carried(const JointWork &w)
{
    const BlockRows &first = w.fit.front();
    Carried out{first.payload_kg, first.payload_kg, first.payload_com_m, true, false};
    for (const auto *runs : {&w.fit, &w.test})
        for (const BlockRows &b : *runs) {
            out.least_kg = std::min(out.least_kg, b.payload_kg);
            out.most_kg = std::max(out.most_kg, b.payload_kg);
            out.alike = out.alike && b.payload_kg == first.payload_kg && b.payload_com_m == out.com_m;
            out.declared = out.declared || b.payload_declared;
        }
    return out;
}

// Mass and moment of the whole payload; the point it stands for.
struct Payload { double mass, mass_sigma; Vector3d com, com_sigma; };

Payload whole_payload(double known_kg, const Vector3d &known_com_m, const Found &f)
{
    const VectorXd &th = *f.chain_theta;
    const MatrixXd &cov = f.chain_covariance;
    Vector3d moment = Vector3d::Zero();
    std::vector<int> axes = f.at.kind == 1 ? std::vector<int>{0, 1, 2} : std::vector<int>{2};
    for (std::size_t i = 0; i < axes.size(); ++i)
        moment[axes[i]] = th[static_cast<Eigen::Index>(i) + 1];
    Payload p{known_kg + th[0], sd(cov, 0), Vector3d::Zero(), Vector3d::Zero()};
    if (std::abs(p.mass) < 1e-9)
        return p;
    p.com = (known_kg * known_com_m + moment) / p.mass;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(i) + 1;
        const double c = p.com[axes[i]];
        p.com_sigma[axes[i]] = std::sqrt(std::max(0.0, cov(k, k) + c * c * cov(0, 0) - 2 * c * cov(0, k)))
                               / std::abs(p.mass);
    }
    return p;
}

// What was added to the known payload is what the effect is; the point is that of the whole, which runs of
// different payloads do not share: theirs is the first moment that was added.
std::vector<EffectParameter> payload_parameters(const JointWork &w, const Found &f)
{
    const Carried known = carried(w);
    const VectorXd &th = *f.chain_theta;
    std::vector<EffectParameter> out = {{"mass_kg", "kg", th[0], sd(f.chain_covariance, 0)}};
    if (known.alike) {
        const Payload p = whole_payload(known.least_kg, known.com_m, f);
        out[0].value = p.mass - known.least_kg;
        const char *const names[] = {"com_x_m", "com_y_m", "com_z_m"};
        for (int i = 0; i < 3; ++i)
            out.push_back({names[i], "m", p.com[i], p.com_sigma[i]});
        return out;
    }
    const char *const names[] = {"first_moment_x_kgm", "first_moment_y_kgm", "first_moment_z_kgm"};
    for (Eigen::Index i = 1; i < th.size(); ++i)
        out.push_back({names[i + 3 - th.size()], "kg m", th[i], sd(f.chain_covariance, i)});
    return out;
}

std::vector<EffectParameter> line_parameters(const Found &f, const VectorXd &th, const MatrixXd &cov)
{
    const double a = std::max(th.norm(), 1e-12);
    const Eigen::Vector2d along = th / a, across(-along[1], along[0]);
    const double sigma_a = std::sqrt(std::max(0.0, along.dot(cov * along)));
    const double sigma_p = std::sqrt(std::max(0.0, across.dot(cov * across))) / a;
    return {{"order", "1", f.at.x, f.x_sigma},
            {"amplitude_nm", "N m", a, sigma_a},
            {"phase_rad", "rad", std::atan2(th[1], th[0]), sigma_p},
            {"directed", "1", static_cast<double>(f.at.kind), 0}};
}

// Amplitude is the mean over runs; what the runs scatter is its sigma.
std::vector<EffectParameter> vibration_parameters(const JointWork &w, const Found &f, const VectorXd &th)
{
    const double through = std::max(block_gain(f.at.x, w.fit[0].block_s), 0.1);
    const Eigen::Index runs = th.size() / 2;
    VectorXd a(runs);
    for (Eigen::Index r = 0; r < runs; ++r)
        a[r] = th.segment(2 * r, 2).norm() / through;
    const double n = static_cast<double>(runs), mean = a.mean();
    const double scatter = std::sqrt((a.array() - mean).square().sum() / std::max(1.0, n - 1));
    return {{"frequency_hz", "Hz", f.at.x, f.x_sigma}, {"amplitude_nm", "N m", mean, scatter / std::sqrt(n)}};
}

// About an axis that changes no torque of these joints nothing is known.
std::vector<EffectParameter> tilt_parameters(const Found &f)
{
    const char *const names[] = {"about_x_rad", "about_y_rad"};
    std::vector<EffectParameter> out;
    for (Eigen::Index k = 0; k < 2; ++k)
        if (sd(f.chain_covariance, k) < kTiltKnown_rad)
            out.push_back({names[k], "rad", (*f.chain_theta)[k], sd(f.chain_covariance, k)});
    return out;
}

double fastest_radps(const JointWork &w)
{
    double v_max = 0;
    for (const BlockRows &b : w.fit)
        v_max = b.size() > 0 ? std::max(v_max, b.v.cwiseAbs().maxCoeff()) : v_max;
    return v_max;
}

const char *const kGeneric[] = {"c1", "c2", "c3", "c4"};

struct Writer {
    ArmFile *file;
    std::string joint; // "joint.2"

    static Quantity quantity(const EffectParameter &p)
    {
        Quantity q;
        q.value = {p.value};
        q.unit = p.unit;
        q.sigma = {p.sigma};
        q.source = kSource;
        return q;
    }

    // Index of an effect already there, 0 when absent.
    int existing(const std::string &id) const { return file->find(joint + ".effect", id); }

    // Effects of an id that may stand several times.
    int count(const std::string &id) const
    {
        int n = 0;
        for (int k = 1; k <= file->count(joint + ".effect"); ++k)
            n += file->get_text(joint + ".effect." + std::to_string(k) + ".id") == id;
        return n;
    }

    double old(int index, const std::string &number) const
    {
        return file->get(joint + ".effect." + std::to_string(index) + "." + number).value[0];
    }

    void append(const std::string &id, const std::vector<std::pair<std::string, EffectParameter>> &numbers,
                const std::vector<std::pair<std::string, std::string>> &texts = {}) const
    {
        if (id != "order_line" && id != "local_friction")
            if (const int i = existing(id))
                file->erase(joint + ".effect." + std::to_string(i));
        std::vector<std::pair<std::string, std::string>> t = {{"id", id}};
        t.insert(t.end(), texts.begin(), texts.end());
        std::vector<std::pair<std::string, Quantity>> q;
        for (const auto &[name, p] : numbers)
            q.emplace_back(name, quantity(p));
        file->append(joint + ".effect", t, q);
    }
};

// The joint's one table; false when it has one already.
bool write_table(const Writer &out, const std::string &axis, const char *unit, double from, double to,
                 bool directed, const std::function<double(double)> &torque_nm, double sigma_nm)
{
    const std::string at = out.joint + ".table.";
    if (out.file->has(at + "torque"))
        return false;
    Quantity span, torque;
    span.value = {from, to};
    span.sigma = {0, 0};
    span.unit = unit;
    for (int k = 0; k < HDT_ARM_CURVE_POINTS; ++k) {
        torque.value.push_back(torque_nm(from + (to - from) * k / (HDT_ARM_CURVE_POINTS - 1)));
        torque.sigma.push_back(sigma_nm);
    }
    torque.unit = "N m";
    span.source = torque.source = kSource;
    out.file->set(at + axis, span);
    out.file->set(at + "torque", torque);
    out.file->set_text(at + "directed", directed ? "true" : "false");
    return true;
}

// One effect of a joint; false when the model has no term for it.
bool write_effect(const Writer &out, const std::string &id, std::vector<EffectParameter> p,
                  double v_max_radps)
{
    const int i = out.existing(id);
    if (id == "torque_gain") {
        out.append(id, {{"gain", p[0]}});
    } else if (id == "load_friction") {
        p[0].value += i ? out.old(i, "mu") : 0;
        out.append(id, {{"mu", p[0]}});
    } else if (id == "inertia") {
        p[0].value += i ? out.old(i, "inertia") : 0;
        out.append(id, {{"inertia", p[0]}});
    } else if (id == "cable_spring") {
        if (i) {
            // two springs in parallel are one
            const double k = out.old(i, "stiffness"), sum = k + p[0].value;
            if (std::abs(sum) < 1e-9)
                return false;
            p[1].value = (k * out.old(i, "rest") + p[0].value * p[1].value) / sum;
            p[0].value = sum;
        }
        out.append(id, {{"stiffness", p[0]}, {"rest", p[1]}});
    } else if (id == "temperature" && !i) {
        out.append(id, {{"coulomb", p[0]}, {"viscous", p[1]}, {"time_constant", p[2]}});
    } else if (id == "presliding") {
        // the model holds one: that which takes more work to turn over
        if (i && out.old(i, "torque") * out.old(i, "travel") > p[0].value * p[1].value)
            return false;
        out.append(id, {{"torque", p[0]}, {"travel", p[1]}});
    } else if (id == "torque_offset") {
        p[0].value += i ? out.old(i, "torque") : 0;
        out.append(id, {{"torque", p[0]}});
    } else if (id == "local_friction") {
        if (out.count(id) >= HDT_LINES_MAX)
            return false;
        out.append(id, {{"torque", p[0]}, {"at", p[1]}, {"width", p[2]}});
    } else if (id == "viscous_nonlinear") {
        const auto curve = [&](double v) { return p[0].value * v * v + p[1].value * v * v * v; };
        return write_table(out, "over_speed", "rad/s", 0, v_max_radps, true, curve,
                           p[0].sigma * v_max_radps * v_max_radps);
    } else if (id == "stribeck_shape") {
        const auto curve = [&](double v) { return p[0].value * std::exp(-v / p[1].value); };
        return write_table(out, "over_speed", "rad/s", 0, v_max_radps, true, curve, p[0].sigma);
    } else if (id == "order_line") {
        if (out.count(id) >= HDT_LINES_MAX)
            return false;
        out.append(id, {{"order", p[0]}, {"amplitude", p[1]}, {"phase", p[2]}},
                   {{"directed", p[3].value > 0.5 ? "true" : "false"}});
    } else {
        return false;
    }
    return true;
}

// Of an effect that write_effect did not take.
std::string why_no_term(const std::string &id)
{
    if (id == "order_line" || id == "local_friction")
        return "the joint has " + std::to_string(HDT_LINES_MAX) + " of them already";
    if (id == "viscous_nonlinear" || id == "stribeck_shape")
        return "the joint's one table is taken";
    if (id == "presliding")
        return "the joint has one already that takes more work to turn over";
    if (id == "temperature")
        return "the joint has one already";
    return id == "cable_spring" ? "it would cancel the spring the joint has"
                                : "the model file has no term for it";
}

// Friction fitted beside the effects, by direction; a joint without friction gets a plain group.
void write_friction(const Writer &out, const hdt_arm_joint &aj, const VectorXd &change, const VectorXd &sigma,
                    double v_max_radps)
{
    if (!aj.has_friction) {
        Quantity valid;
        valid.value = {0, v_max_radps};
        valid.sigma = {0, 0};
        valid.unit = "rad/s";
        valid.source = kSource;
        out.file->set(out.joint + ".friction.valid", valid);
    }
    const char *const way[] = {"positive", "negative"};
    for (int d = 0; d < 2; ++d) {
        const std::string at = out.joint + ".friction." + way[d] + ".";
        const double f0 = aj.has_friction ? aj.friction[d].f0_nm : 0;
        const double fv = aj.has_friction ? aj.friction[d].fv_nmspr : 0;
        out.file->set(at + "f0", Writer::quantity({"f0", "N m", std::max(0.0, f0 + change[d]), sigma[d]}));
        out.file->set(at + "fv", Writer::quantity({"fv", "N m s/rad", fv + change[2 + d], sigma[2 + d]}));
        if (!aj.has_friction) {
            out.file->set(at + "fs", Writer::quantity({"fs", "N m", 0, 0}));
            out.file->set(at + "vc", Writer::quantity({"vc", "rad/s", 0.1, 0}));
        }
    }
}

} // namespace

std::vector<EffectParameter> effect_parameters(const hdt_arm &arm, const JointWork &w, const JointEstimate &e,
                                               std::size_t k)
{
    const Found &f = w.found[k];
    const std::string &id = f.family.id;
    if (f.chain_theta && id == "payload")
        return payload_parameters(w, f);
    if (f.chain_theta && id == "base_tilt")
        return tilt_parameters(f);
    if (f.chain_theta)
        return {{"link", "1", static_cast<double>(f.at.kind + 1), 0},
                {"share", "1", (*f.chain_theta)[0], sd(f.chain_covariance, 0)}};
    const double scale = id == "torque_gain" ? 1 : gain_scale(w, e);
    const VectorXd th = scale * e.theta[k];
    const MatrixXd cov = scale * scale * e.covariance[k];
    if (id == "torque_gain") {
        const double old = arm.joint[w.joint].torque_gain, one = 1 + th[0];
        return {{"gain", "1", old / one, old / (one * one) * sd(cov, 0)}};
    }
    if (id == "load_friction")
        return {{"mu", "N m/N m", th[0], sd(cov, 0)}};
    if (id == "inertia")
        return {{"inertia_kgm2", "kg m^2", th[0], sd(cov, 0)}};
    if (id == "cable_spring") {
        const double rest = spring_rest(e, e.theta[k][0]);
        return {{"stiffness_nmprad", "N m/rad", th[0], sd(cov, 0)},
                {"rest_rad", "rad", rest, e.rest_sigma_rad}};
    }
    if (id == "temperature")
        return {{"coulomb_nm", "N m", th[0], sd(cov, 0)},
                {"viscous_nmspr", "N m s/rad", th[1], sd(cov, 1)},
                {"time_constant_s", "s", f.at.x, f.x_sigma}};
    if (id == "presliding")
        return {{"torque_nm", "N m", th[0], sd(cov, 0)}, {"travel_rad", "rad", f.at.x, f.x_sigma}};
    if (id == "order_line")
        return line_parameters(f, th, cov);
    if (id == "torque_saturation")
        return {{"missing", "1", th[0], sd(cov, 0)}, {"knee_nm", "N m", f.at.x, f.x_sigma}};
    if (id == "torque_delay")
        return {{"delay_s", "s", f.at.x, f.x_sigma}, {"share", "1", th[0], sd(cov, 0)}};
    if (id == "joint_offset")
        return {{"angle_rad", "rad", f.at.x * th[0], std::abs(f.at.x) * sd(cov, 0)}};
    if (id == "local_friction")
        return {{"torque_nm", "N m", th[0], sd(cov, 0)},
                {"at_rad", "rad", f.at.x, f.x_sigma},
                {"width_rad", "rad", bump_width_rad(f.at.kind), 0}};
    if (id == "soft_windup")
        return {{"step_positive_nm", "N m", th[0], sd(cov, 0)},
                {"step_negative_nm", "N m", th[1], sd(cov, 1)},
                {"load_nm", "N m", f.at.x, f.x_sigma},
                {"width_nm", "N m", step_width_nm(f.at.kind), 0}};
    if (id == "external_vibration")
        return vibration_parameters(w, f, th);
    if (id == "coupling")
        return {{"joint", "1", static_cast<double>(f.at.kind + 1), 0},
                f.at.x > 0.5 ? EffectParameter{"share", "1", th[0], sd(cov, 0)}
                             : EffectParameter{"inertia_kgm2", "kg m^2", th[0], sd(cov, 0)}};
    if (id == "link_mass")
        return {{"first_moment_x_kgm", "kg m", th[0], sd(cov, 0)},
                {"first_moment_y_kgm", "kg m", th[1], sd(cov, 1)}};
    std::vector<EffectParameter> out;
    for (Eigen::Index i = 0; i < std::min<Eigen::Index>(th.size(), 4); ++i)
        out.push_back({kGeneric[i], "N m per column", th[i], sd(cov, i)});
    if (f.family.refine)
        out.push_back({"scale", id == "stribeck_shape" ? "rad/s" : "1", f.at.x, f.x_sigma});
    return out;
}

EffectParameter offset_parameter(const JointWork &w, const JointEstimate &e)
{
    const double scale = gain_scale(w, e);
    return {"torque_nm", "N m", 0.5 * scale * (e.friction[0] - e.friction[1]),
            0.5 * scale * std::hypot(e.friction_sigma[0], e.friction_sigma[1])};
}

Adoption adopt_joint(ArmFile *file, const JointWork &w, const JointEstimate &e, bool with_friction)
{
    const Writer out{file, "joint." + std::to_string(w.joint + 1)};
    const hdt_arm arm = file->arm();
    const double scale = gain_scale(w, e);
    VectorXd friction = scale * e.friction;
    Adoption done;
    // what friction hands over to an effect, as fitted
    double moved = 0;
    cite(file);
    for (std::size_t k = 0; k < w.found.size(); ++k) {
        const std::string &id = w.found[k].family.id;
        if (w.found[k].chain_theta)
            continue;
        const std::vector<EffectParameter> p = effect_parameters(arm, w, e, k);
        if (!write_effect(out, id, p, fastest_radps(w))) {
            done.refused.push_back({id, w.joint + 1, k, why_no_term(id)});
        } else if (id == "cable_spring" && p[1].value != 0) {
            // the rest takes over the offset friction's two directions held
            const double offset = 0.5 * (friction[0] - friction[1]);
            friction[0] -= offset;
            friction[1] += offset;
            moved += 0.5 * (e.friction[0] - e.friction[1]);
        }
    }
    if (w.offset) {
        const EffectParameter c = offset_parameter(w, e);
        if (write_effect(out, "torque_offset", {c}, 0)) {
            friction[0] -= c.value;
            friction[1] += c.value;
            moved += c.value / scale;
        }
    }
    if (with_friction && done.refused.empty()) {
        if (!(friction.isZero() && arm.joint[w.joint].has_friction))
            adopt_friction(file, w, friction, scale * e.friction_sigma);
        done.friction = e.friction;
    } else {
        done.friction = Eigen::Vector4d(moved, -moved, 0, 0);
    }
    return done;
}

VectorXd axis_curve_nm(const JointWork &w, const JointEstimate &e, const VectorXd &theta)
{
    return gain_scale(w, e) * theta;
}

std::string adopt_axis(ArmFile *file, const JointWork &w, const JointEstimate &e, const Found &axis,
                       const VectorXd &theta)
{
    const VectorXd at_knots_nm = axis_curve_nm(w, e, theta);
    const Writer out{file, "joint." + std::to_string(w.joint + 1)};
    const std::string &name = axis.family.axis;
    const std::size_t comma = name.find(',');
    const std::string over = name.substr(0, comma), own = "q" + std::to_string(w.joint + 1);
    const std::vector<double> &knots = axis.family.knots;
    const auto curve = [&](double x) {
        const double step = knots[1] - knots[0], last = static_cast<double>(knots.size() - 1);
        const double at = std::clamp((x - knots[0]) / step, 0.0, last);
        const auto k = static_cast<Eigen::Index>(std::min(at, last - 1));
        return at_knots_nm[k] + (at_knots_nm[k + 1] - at_knots_nm[k]) * (at - static_cast<double>(k));
    };
    cite(file);
    const bool known = over == own || over == "load";
    if (known
        && write_table(out, over == own ? "over_position" : "over_load", over == own ? "rad" : "N m",
                       knots.front(), knots.back(), comma != std::string::npos, curve,
                       gain_scale(w, e) * w.floor_nm))
        return "";
    return known ? "the joint's one table is taken" : "the model file has no table over " + name;
}

void adopt_friction(ArmFile *file, const JointWork &w, const VectorXd &change, const VectorXd &sigma)
{
    const double v_max = fastest_radps(w);
    cite(file);
    write_friction({file, "joint." + std::to_string(w.joint + 1)}, file->arm().joint[w.joint], change, sigma,
                   v_max);
}

namespace {

// A payload that the runs declare is theirs: no number of the file changes what is computed for them.
std::string why_declared(const Carried &known, const Found &f)
{
    const std::string instead = "in place of the model file's: put into the logs what they carry";
    if (!known.alike)
        return filled("runs declare payloads of their own (payload_kg %.4g to %.4g) ", known.least_kg,
                      known.most_kg)
               + instead + filled(", by these runs %+.4g kg beside what each declares", (*f.chain_theta)[0]);
    const Payload p = whole_payload(known.least_kg, known.com_m, f);
    return filled("these runs declare a payload of their own (payload_kg = %.4g) ", known.least_kg) + instead
           + filled(", by these runs payload_kg = %.4g,", p.mass)
           + filled(" payload_com_m = %.3g %.3g %.3g", p.com[0], p.com[1], p.com[2]);
}

std::string adopt_payload(ArmFile *file, const JointWork &w, const Found &payload)
{
    const Carried known = carried(w);
    const double least_kg = known.least_kg + (*payload.chain_theta)[0];
    if (!(least_kg > 0))
        return filled("it would leave a payload of %.3g kg", least_kg);
    if (known.declared)
        return why_declared(known, payload);
    const Payload p = whole_payload(known.least_kg, known.com_m, payload);
    cite(file);
    Quantity mass, com;
    mass.value = {p.mass};
    mass.sigma = {p.mass_sigma};
    mass.unit = "kg";
    com.value = {p.com[0], p.com[1], p.com[2]};
    com.sigma = {p.com_sigma[0], p.com_sigma[1], p.com_sigma[2]};
    com.unit = "m";
    mass.source = com.source = kSource;
    file->set("payload.mass", mass);
    file->set("payload.com", com);
    return "";
}

void adopt_tilt(ArmFile *file, const Found &tilt)
{
    const hdt_arm arm = file->arm();
    const Vector3d before = Eigen::Map<const Vector3d>(arm.gravity_mps2);
    const Vector3d level = Vector3d((*tilt.chain_theta)[0], (*tilt.chain_theta)[1], 0).cross(before);
    // what was fitted is the part across gravity; the part along it shrinks by as much as the length asks
    const double across = std::min(level.norm(), before.norm());
    const Vector3d after = level * (level.norm() > 0 ? across / level.norm() : 0)
                           + before * std::sqrt(1 - std::pow(across / before.norm(), 2));
    Quantity g;
    g.value = {after[0], after[1], after[2]};
    double sigma = 0;
    for (const EffectParameter &p : tilt_parameters(tilt))
        sigma = std::max(sigma, before.norm() * p.sigma);
    g.sigma = {sigma, sigma, sigma};
    g.unit = "m/s^2";
    g.source = kSource;
    cite(file);
    file->set("base.gravity", g);
}

// Centre of mass stays; inertia grows with the mass.
void adopt_link(ArmFile *file, const Found &heavier)
{
    const std::string link = "joint." + std::to_string(heavier.at.kind + 1) + ".link.";
    const double share = (*heavier.chain_theta)[0], sigma = sd(heavier.chain_covariance, 0);
    cite(file);
    for (const char *key : {"mass", "inertia", "first_moment", "inertia_origin"}) {
        if (!file->has(link + key))
            continue;
        Quantity q = file->get(link + key);
        q.sigma.clear();
        for (double &x : q.value) {
            q.sigma.push_back(sigma * std::abs(x));
            x *= 1 + share;
        }
        q.source = kSource;
        file->set(link + key, q);
    }
}

} // namespace

std::string adopt_chain(ArmFile *file, const JointWork &w, const Found &effect)
{
    const std::string &id = effect.family.id;
    if (id == "payload")
        return adopt_payload(file, w, effect);
    id == "base_tilt" ? adopt_tilt(file, effect) : adopt_link(file, effect);
    return "";
}

} // namespace hdt
