// SPDX-License-Identifier: Apache-2.0
//
// Both formats are one walk along the chain; they differ in how a pose and a body are spelt.
//
// Owns: the walk and the two spellings.
// Never: friction, gears; see export.hpp.
#include "model/export.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include "model/arm_file.hpp"
#include "model/terms.hpp"
#include "model/text.hpp"

namespace hdt {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Attributes = std::vector<std::pair<const char *, std::string>>;

std::string numbers(const Vector3d &v)
{
    return number17(v[0]) + " " + number17(v[1]) + " " + number17(v[2]);
}

// Elements, indented, attributes escaped.
class Xml {
public:
    void comment(const std::string &text) { line("<!-- " + text + " -->"); }
    void leaf(const char *tag, const Attributes &attributes = {}) { line(head(tag, attributes) + "/>"); }
    void open(const char *tag, const Attributes &attributes = {})
    {
        line(head(tag, attributes) + ">");
        tags_.push_back(tag);
    }
    void close()
    {
        const std::string tag = tags_.back();
        tags_.pop_back();
        line("</" + tag + ">");
    }
    const std::string &text() const { return text_; }

private:
    static std::string head(const char *tag, const Attributes &attributes)
    {
        std::string out = std::string("<") + tag;
        for (const auto &[key, value] : attributes)
            out += std::string(" ") + key + "=\"" + markup_escaped(value) + "\"";
        return out;
    }
    void line(const std::string &content) { text_ += std::string(2 * tags_.size(), ' ') + content + "\n"; }

    std::string text_ = "<?xml version=\"1.0\"?>\n";
    std::vector<std::string> tags_;
};

// ---- bodies ----

// A link about its own centre.  Empty: neither mass nor inertia.
struct Body { bool empty; double mass_kg; Vector3d com_m; Matrix3d inertia_kgm2; };

Matrix3d symmetric(const double *p)
{
    Matrix3d m;
    m << p[0], p[1], p[2], p[1], p[3], p[4], p[2], p[4], p[5];
    return m;
}

[[noreturn]] void refuse(const hdt_arm &arm, int joint, const std::string &what)
{
    throw InputError(std::string(arm.path) + ": joint." + std::to_string(joint + 1) + ".link: " + what);
}

std::string mass_text(double mass_kg)
{
    char text[48];
    std::snprintf(text, sizeof text, "mass %g kg", mass_kg);
    return text;
}

// No mass distribution has a negative principal moment, or one above the sum of the others.
void check_body(const hdt_arm &arm, int joint, const Body &b, double scale, ExportFormat format)
{
    const Vector3d p =
        Eigen::SelfAdjointEigenSolver<Matrix3d>(b.inertia_kgm2, Eigen::EigenvaluesOnly).eigenvalues();
    char found[120];
    std::snprintf(found, sizeof found, "found principal moments %.6g, %.6g, %.6g kg m^2 about its centre",
                  p[0], p[1], p[2]);
    const double slack = 1e-9 * scale;
    if (!(p[0] >= -slack) || !(p[2] <= p[0] + p[1] + slack))
        refuse(arm, joint, std::string("expected a body that can exist, ") + found +
                               " (base parameters identified from torques are not bodies; export the file "
                               "they started from)");
    if (format == ExportFormat::Mjcf && !(p[0] > 1e-12 * scale))
        refuse(arm, joint, std::string("expected an inertia above zero about every axis, as MuJoCo wants it "
                                       "of a moving body, ") + found + "; --format urdf can hold it");
}

Body body_of(const hdt_arm &arm, int joint, ExportFormat format)
{
    const hdt_arm_joint &j = arm.joint[joint];
    if (!j.has_inertial)
        refuse(arm, joint, "expected mass, centre and inertia, found none (--format urdf --kinematics writes "
                           "the arm without masses)");
    const Vector3d moment(j.moment_kgm[0], j.moment_kgm[1], j.moment_kgm[2]);
    const Matrix3d about_origin = symmetric(j.inertia_kgm2);
    const double scale = about_origin.cwiseAbs().maxCoeff();
    Body b = {false, j.mass_kg, Vector3d::Zero(), about_origin};
    if (j.mass_kg == 0 && moment.isZero(0) && scale == 0) {
        if (format == ExportFormat::Mjcf)
            refuse(arm, joint, "expected a mass, as MuJoCo wants it of a moving body, found mass 0 kg; "
                               "--format urdf can hold it");
        b.empty = true;
        return b;
    }
    if (!(j.mass_kg > 0))
        refuse(arm, joint, "expected a body that can exist, found " + mass_text(j.mass_kg) +
                               " with a first moment or an inertia (base parameters identified from torques "
                               "are not bodies; export the file they started from)");
    b.com_m = moment / j.mass_kg;
    const double square = b.com_m.squaredNorm();
    b.inertia_kgm2 -= j.mass_kg * (square * Matrix3d::Identity() - b.com_m * b.com_m.transpose());
    // what is left of a difference of equals is rounding
    for (double &x : b.inertia_kgm2.reshaped())
        if (std::fabs(x) <= 1e-15 * scale)
            x = 0;
    check_body(arm, joint, b, scale, format);
    return b;
}

// ---- what both formats need ----

std::string link_name(const hdt_arm &arm, int joint)
{
    return joint < 0 ? "base" : std::string(arm.joint[joint].name) + "_link";
}

Vector3d vec3(const double *p) { return Vector3d(p[0], p[1], p[2]); }
Matrix3d mat3(const double *p) { return Eigen::Map<const RowMajor3>(p); }

// Output side; 0 when the file has no motor torque.
double effort_nm(const hdt_arm_joint &j)
{
    return j.ratio * (j.tau_max_m_nm > 0 ? j.tau_max_m_nm : j.tau_rated_m_nm);
}

// Where the link ends, in its own frame: the next joint's origin or the flange.
Vector3d link_end(const hdt_arm &arm, int joint)
{
    return vec3(joint + 1 < arm.joints ? arm.joint[joint + 1].origin_m : arm.flange_m);
}

// Of the stick figure: a fortieth of the arm stretched out.
double stick_radius_m(const hdt_arm &arm)
{
    double reach = 0;
    for (int j = -1; j < arm.joints; j++)
        reach += link_end(arm, j).norm();
    return std::max(reach / 40, 0.001);
}

std::string origin_comment(const hdt_arm &arm)
{
    return "Made by hdt export from the model file with SHA-256 " + hex(arm.digest, sizeof arm.digest) +
           ".  Do not edit.";
}

// ---- URDF ----

// Roll, pitch, yaw about fixed axes.  Near a pitch of 90 degrees yaw may be anything: roll is what is
// left once yaw is undone, so that the product always returns.
Vector3d rpy(const Matrix3d &r)
{
    const double yaw = std::atan2(r(1, 0), r(0, 0)), c = std::cos(yaw), s = std::sin(yaw);
    const double pitch = std::atan2(-r(2, 0), c * r(0, 0) + s * r(1, 0));
    const double roll = std::atan2(s * r(0, 2) - c * r(1, 2), c * r(1, 1) - s * r(0, 1));
    return Vector3d(roll, pitch, yaw);
}

void urdf_origin(Xml &x, const Vector3d &pos, const Vector3d &angles)
{
    x.leaf("origin", {{"xyz", numbers(pos)}, {"rpy", numbers(angles)}});
}

void urdf_inertial(Xml &x, const Body &b)
{
    const Matrix3d &i = b.inertia_kgm2;
    x.open("inertial");
    urdf_origin(x, b.com_m, Vector3d::Zero());
    x.leaf("mass", {{"value", number17(b.mass_kg)}});
    x.leaf("inertia", {{"ixx", number17(i(0, 0))}, {"ixy", number17(i(0, 1))}, {"ixz", number17(i(0, 2))},
                       {"iyy", number17(i(1, 1))}, {"iyz", number17(i(1, 2))}, {"izz", number17(i(2, 2))}});
    x.close();
}

void urdf_cylinder(Xml &x, const Vector3d &centre, const Vector3d &angles, double radius_m, double length_m)
{
    x.open("visual");
    urdf_origin(x, centre, angles);
    x.open("geometry");
    x.leaf("cylinder", {{"radius", number17(radius_m)}, {"length", number17(length_m)}});
    x.close();
    x.close();
}

void urdf_stick(Xml &x, const hdt_arm &arm, int joint)
{
    const double radius = stick_radius_m(arm);
    const Vector3d end = link_end(arm, joint);
    if (joint >= 0)
        urdf_cylinder(x, Vector3d::Zero(), Vector3d::Zero(), 1.6 * radius, 4 * radius);
    if (end.norm() > radius) {
        const double across = std::hypot(end.x(), end.y());
        const Vector3d tilt(0, std::atan2(across, end.z()), std::atan2(end.y(), end.x()));
        urdf_cylinder(x, end / 2, tilt, radius, end.norm());
    }
}

void urdf_link(Xml &x, const hdt_arm &arm, int joint, bool masses)
{
    x.open("link", {{"name", link_name(arm, joint)}});
    if (masses && joint >= 0) {
        const Body body = body_of(arm, joint, ExportFormat::Urdf);
        if (!body.empty)
            urdf_inertial(x, body);
    }
    urdf_stick(x, arm, joint);
    x.close();
}

void urdf_joint(Xml &x, const hdt_arm &arm, int joint)
{
    const hdt_arm_joint &j = arm.joint[joint];
    x.open("joint", {{"name", j.name}, {"type", "revolute"}});
    x.leaf("parent", {{"link", link_name(arm, joint - 1)}});
    x.leaf("child", {{"link", link_name(arm, joint)}});
    urdf_origin(x, vec3(j.origin_m), rpy(mat3(j.rot)));
    x.leaf("axis", {{"xyz", "0 0 1"}});
    if (effort_nm(j) == 0)
        x.comment("effort 0: the model file has no motor torque");
    x.leaf("limit", {{"lower", number17(j.q_min_rad)}, {"upper", number17(j.q_max_rad)},
                     {"effort", number17(effort_nm(j))}, {"velocity", number17(j.v_max_radps)}});
    x.close();
}

// A joint of the file may have any name: this one gets another.
std::string free_joint_name(const hdt_arm &arm, std::string name)
{
    for (int j = 0; j < arm.joints; j++)
        if (name == arm.joint[j].name) {
            name += "_";
            j = -1;
        }
    return name;
}

void urdf_fixed(Xml &x, const hdt_arm &arm, const std::string &parent, const std::string &child,
                const Vector3d &pos, const Vector3d &angles)
{
    x.open("joint", {{"name", free_joint_name(arm, child + "_fixed")}, {"type", "fixed"}});
    x.leaf("parent", {{"link", parent}});
    x.leaf("child", {{"link", child}});
    urdf_origin(x, pos, angles);
    x.close();
}

std::string urdf(const hdt_arm &arm, bool masses)
{
    Xml x;
    x.open("robot", {{"name", arm.name}});
    x.comment(origin_comment(arm));
    x.comment("URDF holds no gravity; this arm's, in the base frame, m/s^2: " +
              numbers(vec3(arm.gravity_mps2)));
    x.comment("Visuals are a stick figure, not the arm's shape.");
    urdf_link(x, arm, -1, masses);
    for (int j = 0; j < arm.joints; j++) {
        urdf_joint(x, arm, j);
        urdf_link(x, arm, j, masses);
    }
    urdf_fixed(x, arm, link_name(arm, arm.joints - 1), "flange", vec3(arm.flange_m),
               rpy(mat3(arm.flange_rot)));
    x.leaf("link", {{"name", "flange"}});
    if (masses && arm.payload_kg > 0) {
        urdf_fixed(x, arm, "flange", "payload", vec3(arm.payload_com_m), Vector3d::Zero());
        x.open("link", {{"name", "payload"}});
        urdf_inertial(x, {false, arm.payload_kg, Vector3d::Zero(), Matrix3d::Zero()});
        x.close();
    }
    x.close();
    return x.text();
}

// ---- MJCF ----

Attributes mjcf_pose(const std::string &name, const double *origin_m, const double *rot)
{
    const Eigen::Quaterniond q(mat3(rot));
    return {{"name", name},
            {"pos", numbers(vec3(origin_m))},
            {"quat",
             number17(q.w()) + " " + number17(q.x()) + " " + number17(q.y()) + " " + number17(q.z())}};
}

void mjcf_inertial(Xml &x, const Body &b)
{
    const Matrix3d &i = b.inertia_kgm2;
    const Vector3d across(i(0, 1), i(0, 2), i(1, 2));
    x.leaf("inertial", {{"pos", numbers(b.com_m)},
                        {"mass", number17(b.mass_kg)},
                        {"fullinertia", numbers(i.diagonal()) + " " + numbers(across)}});
}

void mjcf_stick(Xml &x, const hdt_arm &arm, int joint)
{
    const double radius = stick_radius_m(arm);
    const Vector3d end = link_end(arm, joint), half(0, 0, 2 * radius);
    if (joint >= 0)
        x.leaf("geom", {{"type", "cylinder"}, {"fromto", numbers(-half) + " " + numbers(half)},
                        {"size", number17(1.6 * radius)}, {"rgba", "0.25 0.35 0.5 1"}});
    if (end.norm() > radius)
        x.leaf("geom", {{"type", "capsule"}, {"fromto", numbers(Vector3d::Zero()) + " " + numbers(end)},
                        {"size", number17(radius)}});
}

void mjcf_joint(Xml &x, const hdt_arm_joint &j, const ExportOptions &options)
{
    Attributes a = {{"name", j.name},
                    {"axis", "0 0 1"},
                    {"range", number17(j.q_min_rad) + " " + number17(j.q_max_rad)}};
    if (effort_nm(j) > 0)
        a.emplace_back("actuatorfrcrange", number17(-effort_nm(j)) + " " + number17(effort_nm(j)));
    if (options.armature)
        a.emplace_back("armature", number17(reflected_inertia_kgm2(j)));
    x.leaf("joint", a);
}

void mjcf_head(Xml &x, const hdt_arm &arm)
{
    x.comment(origin_comment(arm));
    x.comment("Geoms are a stick figure: no mass, no contact.  Torques are those of the rigid arm.");
    x.leaf("compiler", {{"angle", "radian"}, {"autolimits", "true"}, {"inertiafromgeom", "false"},
                        {"balanceinertia", "false"}, {"fusestatic", "false"}});
    x.leaf("option", {{"gravity", numbers(vec3(arm.gravity_mps2))}, {"timestep", "0.001"}});
    x.open("default");
    x.leaf("geom", {{"contype", "0"}, {"conaffinity", "0"}, {"mass", "0"}, {"rgba", "0.8 0.8 0.78 1"}});
    x.close();
    std::string speeds;
    for (int j = 0; j < arm.joints; j++)
        speeds += (j == 0 ? "" : " ") + number17(arm.joint[j].v_max_radps);
    x.open("custom");
    x.comment("MJCF has no limit of speed: rad/s, output side, base first");
    x.leaf("numeric", {{"name", "speed_limit_radps"}, {"data", speeds}});
    x.close();
}

void mjcf_bodies(Xml &x, const hdt_arm &arm, const ExportOptions &options)
{
    x.open("worldbody");
    x.leaf("light", {{"pos", "1 -1 3"}, {"dir", "-0.3 0.3 -1"}});
    mjcf_stick(x, arm, -1);
    for (int j = 0; j < arm.joints; j++) {
        x.open("body", mjcf_pose(link_name(arm, j), arm.joint[j].origin_m, arm.joint[j].rot));
        mjcf_inertial(x, body_of(arm, j, ExportFormat::Mjcf));
        mjcf_joint(x, arm.joint[j], options);
        mjcf_stick(x, arm, j);
    }
    x.open("body", mjcf_pose("flange", arm.flange_m, arm.flange_rot));
    x.leaf("site", {{"name", "flange"}});
    if (arm.payload_kg > 0) {
        x.open("body", {{"name", "payload"}, {"pos", numbers(vec3(arm.payload_com_m))}});
        x.leaf("inertial", {{"pos", "0 0 0"}, {"mass", number17(arm.payload_kg)}, {"diaginertia", "0 0 0"}});
        x.leaf("geom", {{"type", "sphere"}, {"size", number17(1.5 * stick_radius_m(arm))},
                        {"rgba", "0.8 0.5 0.2 1"}});
        x.close();
    }
    for (int j = 0; j <= arm.joints + 1; j++)
        x.close(); // flange, links, worldbody
}

std::string mjcf(const hdt_arm &arm, const ExportOptions &options)
{
    Xml x;
    x.open("mujoco", {{"model", arm.name}});
    mjcf_head(x, arm);
    mjcf_bodies(x, arm, options);
    x.open("actuator");
    x.comment("control: torque at the joint, N.m output side");
    for (int j = 0; j < arm.joints; j++) {
        const hdt_arm_joint &joint = arm.joint[j];
        Attributes a = {{"name", joint.name}, {"joint", joint.name}};
        if (effort_nm(joint) > 0)
            a.emplace_back("ctrlrange", number17(-effort_nm(joint)) + " " + number17(effort_nm(joint)));
        x.leaf("motor", a);
    }
    x.close();
    x.close();
    return x.text();
}

} // namespace

std::string export_text(const hdt_arm &arm, ExportFormat format, const ExportOptions &options)
{
    if (format == ExportFormat::Urdf) {
        if (options.armature)
            throw InputError("--armature: expected with --format mjcf, found urdf, which cannot hold it");
        return urdf(arm, !options.kinematics);
    }
    if (options.kinematics)
        throw InputError("--kinematics: expected with --format urdf, found mjcf: MuJoCo loads no moving body "
                         "without mass");
    return mjcf(arm, options);
}

} // namespace hdt
