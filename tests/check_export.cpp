// SPDX-License-Identifier: Apache-2.0
//
// URDF and MJCF, read back by a reader of this test's own.
// Goal: the file describes the same rigid arm: kinematics, mass, torques; what cannot be a body is refused.
// Method: random arms whose links are clouds of point masses (so possible by construction) in random
// frames; the file is parsed, an arm is rebuilt from its numbers alone and held to the one that was written.
#include "model/export.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>

#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "tests/random_arm.hpp"
#include "tests/shell.hpp"

using hdt::ExportFormat;
using hdt::ExportOptions;
using namespace hdt::rbd;

// ---- a reader of the XML these files use: elements, attributes, comments, the five entities ----

struct Node {
    std::string tag;
    std::map<std::string, std::string> attributes;
    std::vector<std::unique_ptr<Node>> children;

    const Node *child(const std::string &name) const
    {
        for (const auto &c : children)
            if (c->tag == name)
                return c.get();
        return nullptr;
    }
    // Attribute as numbers.
    std::vector<double> numbers(const std::string &key) const
    {
        ck_assert_msg(attributes.count(key) == 1, "<%s> has no %s", tag.c_str(), key.c_str());
        std::istringstream in(attributes.at(key));
        std::vector<double> out;
        for (std::string word; in >> word;)
            out.push_back(std::strtod(word.c_str(), nullptr));
        return out;
    }
};

static std::string unescaped(const std::string &text)
{
    static const std::pair<const char *, const char *> entities[] = {
        {"&lt;", "<"}, {"&gt;", ">"}, {"&quot;", "\""}, {"&apos;", "'"}, {"&amp;", "&"}};
    std::string out;
    for (std::size_t i = 0; i < text.size();) {
        ck_assert_msg(text[i] != '<', "a bare < in an attribute: %s", text.c_str());
        if (text[i] != '&') {
            out += text[i++];
            continue;
        }
        const auto e = std::find_if(std::begin(entities), std::end(entities), [&](const auto &entity) {
            return text.compare(i, std::strlen(entity.first), entity.first) == 0;
        });
        ck_assert_msg(e != std::end(entities), "a bare & in an attribute: %s", text.c_str());
        out += e->second;
        i += std::strlen(e->first);
    }
    return out;
}

static void read_attributes(const std::string &text, Node *node)
{
    std::size_t at = 0;
    while ((at = text.find_first_not_of(" \t\n", at)) != std::string::npos) {
        const std::size_t equals = text.find("=\"", at), end = text.find('"', equals + 2);
        ck_assert_msg(equals != std::string::npos && end != std::string::npos, "broken: %s", text.c_str());
        const std::string key = text.substr(at, equals - at);
        ck_assert_msg(node->attributes.count(key) == 0, "attribute twice: %s", text.c_str());
        node->attributes[key] = unescaped(text.substr(equals + 2, end - equals - 2));
        at = end + 1;
    }
}

static std::unique_ptr<Node> read_xml(const std::string &text)
{
    auto root = std::make_unique<Node>();
    std::vector<Node *> open = {root.get()};
    for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) {
        if (text.compare(at, 4, "<!--") == 0) {
            const std::size_t end = text.find("--", at + 4);
            ck_assert_msg(end != std::string::npos && text[end + 2] == '>', "a comment holds --");
            at = end;
            continue;
        }
        const std::size_t end = text.find('>', at);
        ck_assert(end != std::string::npos);
        std::string inside = text.substr(at + 1, end - at - 1);
        at = end;
        if (inside[0] == '?')
            continue;
        if (inside[0] == '/') {
            ck_assert_str_eq(open.back()->tag.c_str(), inside.c_str() + 1);
            open.pop_back();
            continue;
        }
        const bool leaf = inside.back() == '/';
        if (leaf)
            inside.pop_back();
        auto node = std::make_unique<Node>();
        node->tag = inside.substr(0, inside.find(' '));
        read_attributes(inside.substr(node->tag.size()), node.get());
        open.back()->children.push_back(std::move(node));
        if (!leaf)
            open.push_back(open.back()->children.back().get());
    }
    ck_assert_msg(open.size() == 1, "an element is not closed");
    ck_assert_uint_eq(root->children.size(), 1);
    return std::move(root->children[0]);
}

// ---- what a file says about the arm ----

struct Body { double mass = 0; Vector3d com = Vector3d::Zero(); Matrix3d inertia = Matrix3d::Zero(); };

struct Link {
    std::string joint, name;
    Eigen::Isometry3d at = Eigen::Isometry3d::Identity(); // in the link before
    Body body;
    double min = 0, max = 0, speed = 0, effort = 0, armature = 0;
    bool has_body = false;
};

struct Chain {
    std::string name;
    Vector3d gravity = Vector3d::Zero();
    std::vector<Link> links; // moving ones, base first
    Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
    bool has_payload = false;
    Link payload;            // in the flange
};

static Vector3d vec(const std::vector<double> &v, std::size_t from = 0)
{
    ck_assert_uint_ge(v.size(), from + 3);
    return Vector3d(v[from], v[from + 1], v[from + 2]);
}

static Eigen::Isometry3d urdf_pose(const Node *origin)
{
    const Vector3d rpy = vec(origin->numbers("rpy"));
    Eigen::Isometry3d t = Eigen::Isometry3d::Identity();
    t.translation() = vec(origin->numbers("xyz"));
    t.linear() =
        (Eigen::AngleAxisd(rpy[2], Vector3d::UnitZ()) * Eigen::AngleAxisd(rpy[1], Vector3d::UnitY()) *
         Eigen::AngleAxisd(rpy[0], Vector3d::UnitX())).toRotationMatrix();
    return t;
}

static bool urdf_body(const Node *link, Body *b)
{
    const Node *inertial = link->child("inertial");
    if (!inertial)
        return false;
    const Node *i = inertial->child("inertia");
    b->mass = inertial->child("mass")->numbers("value")[0];
    ck_assert(urdf_pose(inertial->child("origin")).linear().isIdentity(0));
    b->com = urdf_pose(inertial->child("origin")).translation();
    const double xx = i->numbers("ixx")[0], xy = i->numbers("ixy")[0], xz = i->numbers("ixz")[0],
                 yy = i->numbers("iyy")[0], yz = i->numbers("iyz")[0], zz = i->numbers("izz")[0];
    b->inertia << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    return true;
}

static Chain read_urdf(const std::string &text)
{
    Chain chain;
    const std::unique_ptr<Node> robot = read_xml(text);
    ck_assert_str_eq(robot->tag.c_str(), "robot");
    chain.name = robot->attributes.at("name");
    std::map<std::string, const Node *> links, joint_of_parent;
    std::map<std::string, int> joint_names;
    for (const auto &n : robot->children) {
        if (n->tag == "link") {
            ck_assert_msg(links.count(n->attributes.at("name")) == 0, "link twice");
            links[n->attributes.at("name")] = n.get();
        } else if (n->tag == "joint") {
            ck_assert_msg(joint_names[n->attributes.at("name")]++ == 0, "joint twice");
            joint_of_parent[n->child("parent")->attributes.at("link")] = n.get();
        }
    }
    std::size_t walked = 1;
    for (std::string at = "base"; joint_of_parent.count(at) != 0; walked++) {
        const Node *joint = joint_of_parent[at];
        Link link;
        link.joint = joint->attributes.at("name");
        link.name = at = joint->child("child")->attributes.at("link");
        ck_assert_msg(links.count(at) == 1, "no link %s", at.c_str());
        link.at = urdf_pose(joint->child("origin"));
        link.has_body = urdf_body(links[at], &link.body);
        if (joint->attributes.at("type") == "revolute") {
            const Node *limit = joint->child("limit");
            ck_assert(vec(joint->child("axis")->numbers("xyz")) == Vector3d::UnitZ());
            link.min = limit->numbers("lower")[0];
            link.max = limit->numbers("upper")[0];
            link.speed = limit->numbers("velocity")[0];
            link.effort = limit->numbers("effort")[0];
            chain.links.push_back(link);
        } else if (at == "flange") {
            ck_assert(!link.has_body);
            chain.flange = link.at;
        } else {
            ck_assert_str_eq(at.c_str(), "payload");
            chain.has_payload = true;
            chain.payload = link;
        }
    }
    ck_assert_uint_eq(walked, links.size());
    return chain;
}

static Link mjcf_link(const Node *body)
{
    Link link;
    link.name = body->attributes.at("name");
    link.at.translation() = vec(body->numbers("pos"));
    if (body->attributes.count("quat") != 0) {
        const std::vector<double> q = body->numbers("quat");
        link.at.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
    }
    const Node *inertial = body->child("inertial");
    if (!inertial)
        return link;
    link.has_body = true;
    link.body.mass = inertial->numbers("mass")[0];
    link.body.com = vec(inertial->numbers("pos"));
    if (inertial->attributes.count("fullinertia") == 0) {
        link.body.inertia = vec(inertial->numbers("diaginertia")).asDiagonal();
        return link;
    }
    const std::vector<double> i = inertial->numbers("fullinertia"); // xx yy zz xy xz yz
    ck_assert_uint_eq(i.size(), 6);
    link.body.inertia << i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2];
    return link;
}

static Chain read_mjcf(const std::string &text)
{
    Chain chain;
    const std::unique_ptr<Node> root = read_xml(text);
    ck_assert_str_eq(root->tag.c_str(), "mujoco");
    ck_assert_str_eq(root->child("compiler")->attributes.at("angle").c_str(), "radian");
    chain.name = root->attributes.at("model");
    chain.gravity = vec(root->child("option")->numbers("gravity"));
    const std::vector<double> speeds = root->child("custom")->child("numeric")->numbers("data");
    for (const Node *at = root->child("worldbody")->child("body"); at; at = at->child("body")) {
        Link link = mjcf_link(at);
        const Node *joint = at->child("joint");
        if (joint) {
            link.joint = joint->attributes.at("name");
            ck_assert(vec(joint->numbers("axis")) == Vector3d::UnitZ());
            link.min = joint->numbers("range")[0];
            link.max = joint->numbers("range")[1];
            if (joint->attributes.count("actuatorfrcrange") != 0) {
                link.effort = joint->numbers("actuatorfrcrange")[1];
                ck_assert_double_eq(joint->numbers("actuatorfrcrange")[0], -link.effort);
            }
            if (joint->attributes.count("armature") != 0)
                link.armature = joint->numbers("armature")[0];
            ck_assert_uint_lt(chain.links.size(), speeds.size());
            link.speed = speeds[chain.links.size()];
            chain.links.push_back(link);
        } else if (link.name == "flange") {
            chain.flange = link.at;
        } else {
            ck_assert_str_eq(link.name.c_str(), "payload");
            chain.has_payload = true;
            chain.payload = link;
        }
    }
    ck_assert_uint_eq(chain.links.size(), speeds.size());
    ck_assert_uint_eq(chain.links.size(), root->child("actuator")->children.size());
    return chain;
}

static Chain read_chain(const std::string &text, ExportFormat format)
{
    return format == ExportFormat::Urdf ? read_urdf(text) : read_mjcf(text);
}

// ---- arms ----

static void store(const Matrix3d &i, Vector3d moment, double mass_kg, hdt_arm_joint *k)
{
    const double six[] = {i(0, 0), i(0, 1), i(0, 2), i(1, 1), i(1, 2), i(2, 2)};
    std::memcpy(k->inertia_kgm2, six, sizeof six);
    std::memcpy(k->moment_kgm, moment.data(), sizeof k->moment_kgm);
    k->mass_kg = mass_kg;
}

static Matrix3d point_inertia(double mass_kg, const Vector3d &at)
{
    return mass_kg * (at.squaredNorm() * Matrix3d::Identity() - at * at.transpose());
}

// Eight points with mass: any such cloud is a body.
static void random_body(uint64_t *seed, hdt_arm_joint *k)
{
    Matrix3d inertia = Matrix3d::Zero();
    Vector3d moment = Vector3d::Zero();
    double sum_kg = 0;
    for (int i = 0; i < 8; i++) {
        const Vector3d at = random_vector(seed, 3, 0.3) + Vector3d(0.1, -0.2, 0.15);
        const double mass = test_uniform(seed, 0.05, 1);
        sum_kg += mass;
        moment += mass * at;
        inertia += point_inertia(mass, at);
    }
    store(inertia, moment, sum_kg, k);
    k->has_inertial = 1;
}

static hdt_arm random_arm(uint64_t *seed, int joints)
{
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    std::strcpy(arm.name, "random");
    std::strcpy(arm.path, "random.toml");
    arm.joints = joints;
    fill(seed, arm.gravity_mps2, 3, 10);
    fill(seed, arm.flange_m, 3, 0.3);
    store(random_rotation(seed), arm.flange_rot);
    arm.payload_kg = test_uniform(seed, 0.1, 5);
    fill(seed, arm.payload_com_m, 3, 0.2);
    for (int j = 0; j < joints; ++j) {
        hdt_arm_joint &k = arm.joint[j];
        std::snprintf(k.name, sizeof k.name, "J%d", j + 1);
        fill(seed, k.origin_m, 3, 0.5);
        store(random_rotation(seed), k.rot);
        k.q_min_rad = test_uniform(seed, -3, -1);
        k.q_max_rad = test_uniform(seed, 1, 3);
        k.v_max_radps = test_uniform(seed, 0.5, 6);
        k.ratio = test_uniform(seed, 30, 160);
        k.tau_max_m_nm = test_uniform(seed, 0.1, 5);
        k.rotor_kgm2_m = test_uniform(seed, 1e-6, 1e-3);
        k.wave_generator_kgm2_m = test_uniform(seed, 1e-6, 1e-3);
        random_body(seed, &k);
    }
    return arm;
}

// The arm a chain describes, from its numbers alone.
static hdt_arm rebuilt(const Chain &chain, const double *gravity)
{
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    arm.joints = (int)chain.links.size();
    std::memcpy(arm.gravity_mps2, gravity, sizeof arm.gravity_mps2);
    for (int j = 0; j < arm.joints; j++) {
        const Link &l = chain.links[(std::size_t)j];
        hdt_arm_joint &k = arm.joint[j];
        store(l.at.linear(), k.rot);
        const Body &b = l.body;
        store(b.inertia + point_inertia(b.mass, b.com), b.mass * b.com, b.mass, &k);
        for (int a = 0; a < 3; a++)
            k.origin_m[a] = l.at.translation()[a];
        k.has_inertial = l.has_body;
    }
    store(chain.flange.linear(), arm.flange_rot);
    for (int a = 0; a < 3; a++) {
        arm.flange_m[a] = chain.flange.translation()[a];
        arm.payload_com_m[a] = chain.payload.at.translation()[a];
    }
    arm.payload_kg = chain.payload.body.mass;
    return arm;
}

static const ExportFormat formats[] = {ExportFormat::Urdf, ExportFormat::Mjcf};

START_TEST(test_file_has_the_arms_kinematics)
{
    for (uint64_t s = 1; s <= 40; s++)
        for (ExportFormat format : formats) {
            uint64_t seed = s;
            const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 16));
            const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
            ck_assert_uint_eq(chain.links.size(), (unsigned)arm.joints);
            const VectorXd q = random_vector(&seed, arm.joints, 3);
            const std::vector<Pose> want = frames(arm, q);
            Eigen::Isometry3d at = Eigen::Isometry3d::Identity();
            for (int j = 0; j <= arm.joints; j++) {
                const std::size_t k = (std::size_t)j;
                if (j < arm.joints)
                    at = at * chain.links[k].at * Eigen::AngleAxisd(q[j], Vector3d::UnitZ());
                else
                    at = at * chain.flange;
                const Pose &p = want[k];
                ck_assert_double_le((at.translation() - p.pos).norm(), 1e-12);
                ck_assert_double_le((at.linear() - p.rot).norm(), 1e-12);
            }
        }
}
END_TEST

// Poses no formula for roll, pitch and yaw likes: pitch at, or a hair from, 90 degrees.
START_TEST(test_pose_survives_gimbal_lock)
{
    const double right = std::acos(0.0);
    for (double off : {0.0, 1e-16, 1e-12, 1e-9, 1e-7, -1e-8})
        for (double sign : {-1.0, 1.0}) {
            uint64_t seed = 3;
            hdt_arm arm = random_arm(&seed, 2);
            const Matrix3d rot = (Eigen::AngleAxisd(0.7, Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(sign * (right + off), Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(-1.1, Vector3d::UnitX())).toRotationMatrix();
            store(rot, arm.joint[1].rot);
            for (ExportFormat format : formats) {
                const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
                ck_assert_double_le((chain.links[1].at.linear() - rot).norm(), 1e-14);
            }
        }
}
END_TEST

START_TEST(test_file_has_the_arms_torques)
{
    for (uint64_t s = 1; s <= 40; s++)
        for (ExportFormat format : formats) {
            uint64_t seed = 100 + s;
            const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
            const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
            if (format == ExportFormat::Mjcf)
                ck_assert(chain.gravity == Vector3d(arm.gravity_mps2));
            const hdt_arm again = rebuilt(chain, arm.gravity_mps2);
            const VectorXd q = random_vector(&seed, arm.joints, 3), qd = random_vector(&seed, arm.joints, 2),
                           qdd = random_vector(&seed, arm.joints, 5);
            const VectorXd want = inverse_dynamics(arm, q, qd, qdd);
            const double error = (inverse_dynamics(again, q, qd, qdd) - want).cwiseAbs().maxCoeff();
            ck_assert_double_le(error, 1e-12 * (1 + want.cwiseAbs().maxCoeff()));
        }
}
END_TEST

START_TEST(test_bodies_are_possible_and_masses_sum)
{
    for (uint64_t s = 1; s <= 20; s++)
        for (ExportFormat format : formats) {
            uint64_t seed = 200 + s;
            const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
            const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
            double want = arm.payload_kg, sum = chain.payload.body.mass;
            for (int j = 0; j < arm.joints; j++) {
                const Body &b = chain.links[(std::size_t)j].body;
                const Vector3d p = Eigen::SelfAdjointEigenSolver<Matrix3d>(b.inertia).eigenvalues();
                ck_assert_double_gt(p[0], 0);
                ck_assert_double_le(p[2], p[0] + p[1]);
                want += arm.joint[j].mass_kg;
                sum += b.mass;
            }
            ck_assert_double_eq(sum, want);
            ck_assert(chain.payload.body.inertia.isZero(0));
        }
}
END_TEST

START_TEST(test_limits_are_of_the_output)
{
    uint64_t seed = 7;
    hdt_arm arm = random_arm(&seed, 5);
    arm.joint[2].tau_max_m_nm = 0; // then the rated torque counts
    arm.joint[2].tau_rated_m_nm = 0.7;
    arm.joint[3].tau_max_m_nm = 0; // and this one's is not known
    for (ExportFormat format : formats) {
        const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
        for (std::size_t j = 0; j < 5; j++) {
            const hdt_arm_joint &k = arm.joint[j];
            const Link &l = chain.links[j];
            ck_assert_str_eq(l.joint.c_str(), k.name);
            ck_assert(l.name == std::string(k.name) + "_link");
            ck_assert_double_eq(l.min, k.q_min_rad);
            ck_assert_double_eq(l.max, k.q_max_rad);
            ck_assert_double_eq(l.speed, k.v_max_radps);
            ck_assert_double_eq(l.effort, j == 2 ? 0.7 * k.ratio : j == 3 ? 0 : k.tau_max_m_nm * k.ratio);
            ck_assert_double_eq(l.armature, 0);
        }
    }
}
END_TEST

START_TEST(test_armature_is_rotor_inertia_at_the_output)
{
    uint64_t seed = 8;
    hdt_arm arm = random_arm(&seed, 3);
    arm.joint[1].extra_inertia_kgm2 = 0.25;
    ExportOptions options;
    options.armature = true;
    const Chain chain = read_mjcf(hdt::export_text(arm, ExportFormat::Mjcf, options));
    for (std::size_t j = 0; j < 3; j++) {
        const hdt_arm_joint &k = arm.joint[j];
        const double rotor_kgm2_m = k.rotor_kgm2_m + k.wave_generator_kgm2_m;
        const double want = k.ratio * k.ratio * rotor_kgm2_m + (j == 1 ? 0.25 : 0);
        ck_assert_double_le(std::fabs(chain.links[j].armature - want), 1e-15 * want);
    }
}
END_TEST

START_TEST(test_names_are_escaped_and_never_clash)
{
    uint64_t seed = 9;
    hdt_arm arm = random_arm(&seed, 4);
    std::strcpy(arm.name, "a<b>&\"c'--&amp;");
    std::strcpy(arm.joint[0].name, "<&>\"'");
    std::strcpy(arm.joint[1].name, "flange_fixed");
    std::strcpy(arm.joint[2].name, "flange_fixed_");
    std::strcpy(arm.joint[3].name, "payload");
    for (ExportFormat format : formats) {
        const Chain chain = read_chain(hdt::export_text(arm, format, {}), format); // no name twice
        ck_assert_str_eq(chain.name.c_str(), arm.name);
        for (std::size_t j = 0; j < 4; j++)
            ck_assert_str_eq(chain.links[j].joint.c_str(), arm.joint[j].name);
        ck_assert(chain.has_payload);
    }
}
END_TEST

START_TEST(test_no_payload_no_body)
{
    uint64_t seed = 10;
    hdt_arm arm = random_arm(&seed, 3);
    arm.payload_kg = 0;
    for (ExportFormat format : formats)
        ck_assert(!read_chain(hdt::export_text(arm, format, {}), format).has_payload);
}
END_TEST

START_TEST(test_kinematics_leaves_all_masses_out)
{
    uint64_t seed = 11;
    hdt_arm arm = random_arm(&seed, 4);
    arm.joint[1].has_inertial = 0;
    ExportOptions options;
    options.kinematics = true;
    const std::string text = hdt::export_text(arm, ExportFormat::Urdf, options);
    const Chain chain = read_urdf(text);
    ck_assert_uint_eq(chain.links.size(), 4);
    ck_assert_msg(text.find("inertial") == std::string::npos, "masses were written");
    ck_assert(!chain.has_payload);
}
END_TEST

static void expect_refusal(const hdt_arm &arm, ExportFormat format, const ExportOptions &options,
                           const char *part)
{
    std::string said;
    try {
        hdt::export_text(arm, format, options);
    } catch (const hdt::InputError &e) {
        said = e.what();
    }
    ck_assert_msg(said.find(part) != std::string::npos, "expected \"%s\" in \"%s\"", part, said.c_str());
    ck_assert_msg(said.find('\n') == std::string::npos, "more than one line: %s", said.c_str());
}

START_TEST(test_what_is_no_body_is_refused)
{
    uint64_t seed = 12;
    const hdt_arm good = random_arm(&seed, 3);
    for (ExportFormat format : formats) {
        hdt_arm arm = good;
        arm.joint[2].has_inertial = 0;
        expect_refusal(arm, format, {}, "random.toml: joint.3.link: expected mass, centre and inertia");
        arm = good; // base parameters: a first moment without mass
        arm.joint[1].mass_kg = 0;
        expect_refusal(arm, format, {}, "joint.2.link: expected a body that can exist, found mass 0 kg");
        arm = good; // about the centre this one would be negative
        arm.joint[0].moment_kgm[0] *= 20;
        expect_refusal(arm, format, {}, "joint.1.link: expected a body that can exist, found principal");
        arm = good; // positive, but one principal moment above the sum of the others
        arm.joint[0].moment_kgm[0] = arm.joint[0].moment_kgm[1] = arm.joint[0].moment_kgm[2] = 0;
        const double needle[6] = {1, 0, 0, 1, 0, 2.1};
        std::memcpy(arm.joint[0].inertia_kgm2, needle, sizeof needle);
        expect_refusal(arm, format, {}, "joint.1.link: expected a body that can exist, found principal");
    }
}
END_TEST

// A point mass, and a link of nothing, are bodies to URDF; MuJoCo's own reader would refuse them.
START_TEST(test_point_masses_are_for_urdf)
{
    uint64_t seed = 13;
    hdt_arm arm = random_arm(&seed, 3);
    hdt_arm_joint &point = arm.joint[1], &nothing = arm.joint[0];
    const Vector3d c(0.3, -0.1, 0.7);
    store(point_inertia(3.7, c), 3.7 * c, 3.7, &point);
    expect_refusal(arm, ExportFormat::Mjcf, {}, "joint.2.link: expected an inertia above zero");
    store(Matrix3d::Zero(), Vector3d::Zero(), 0, &nothing);
    expect_refusal(arm, ExportFormat::Mjcf, {}, "joint.1.link: expected a mass");
    const Chain chain = read_urdf(hdt::export_text(arm, ExportFormat::Urdf, {}));
    ck_assert(!chain.links[0].has_body);
    ck_assert_double_le((chain.links[1].body.com - c).norm(), 1e-15);
    ck_assert_double_le(chain.links[1].body.inertia.norm(), 1e-14);
}
END_TEST

START_TEST(test_options_of_the_other_format_are_refused)
{
    uint64_t seed = 14;
    const hdt_arm arm = random_arm(&seed, 2);
    ExportOptions armature, kinematics;
    armature.armature = true;
    kinematics.kinematics = true;
    expect_refusal(arm, ExportFormat::Urdf, armature, "--armature: expected with --format mjcf");
    expect_refusal(arm, ExportFormat::Mjcf, kinematics, "--kinematics: expected with --format urdf");
}
END_TEST

START_TEST(test_shipped_arm_comes_back)
{
    const hdt_arm arm = hdt::ArmFile::load("model/arms/pa10.toml").arm();
    for (ExportFormat format : formats) {
        const Chain chain = read_chain(hdt::export_text(arm, format, {}), format);
        const hdt_arm again = rebuilt(chain, arm.gravity_mps2);
        uint64_t seed = 15;
        for (int k = 0; k < 20; k++) {
            const VectorXd q = random_vector(&seed, 7, 2), qd = random_vector(&seed, 7, 2),
                           qdd = random_vector(&seed, 7, 5);
            const VectorXd want = inverse_dynamics(arm, q, qd, qdd);
            ck_assert_double_le((inverse_dynamics(again, q, qd, qdd) - want).norm(), 1e-12 * want.norm());
        }
        // upright, the flange is 0.315 + 0.45 + 0.5 + 0.08 m above the floor
        ck_assert_double_le((flange(again, VectorXd::Zero(7)).pos - Vector3d(0, 0, 1.345)).norm(), 1e-12);
        ck_assert_double_le(std::fabs(chain.links[0].effort - 232), 1e-9);
    }
}
END_TEST

// ---- the command ----

static int run_hdt(const std::string &arguments, const std::string &err)
{
    const std::string command = build_dir() + "/hdt export " + arguments +
    " >/dev/null 2>" + err;
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

START_TEST(test_command_writes_what_the_library_says)
{
    if (access((build_dir() + "/hdt").c_str(), X_OK) != 0)
        HDT_SKIP("no hdt in this build");
    const std::string dir = scratch_dir(), err = dir + "/err", pa10 = "model/arms/pa10.toml";
    const std::string out = dir + "/arm";
    const hdt_arm arm = hdt::ArmFile::load(pa10).arm();
    ExportOptions armature;
    armature.armature = true;
    ck_assert_int_eq(run_hdt(pa10 + " --format urdf --out " + out, err), 0);
    ck_assert(slurp(out) == hdt::export_text(arm, ExportFormat::Urdf, {}));
    ck_assert_int_eq(run_hdt(pa10 + " --format mjcf --armature --out " + out, err), 0);
    ck_assert(slurp(out) == hdt::export_text(arm, ExportFormat::Mjcf, armature));
    std::remove(out.c_str());
    // refused: a line, no file
    for (const auto &[bad, code] : {std::pair{pa10 + " --format sdf", 2},
                                    {std::string("model/arms/panda.toml --format mjcf"), 3}}) {
        ck_assert_int_eq(run_hdt(bad + " --out " + out, err), code);
        const std::string said = slurp(err);
        ck_assert_int_eq(std::count(said.begin(), said.end(), '\n'), 1);
        ck_assert_msg(said.find("expected") != std::string::npos, "%s", said.c_str());
        ck_assert(access(out.c_str(), F_OK) != 0);
    }
    ck_assert_int_eq(run_hdt("model/arms/panda.toml --format urdf --kinematics --out " + out, err), 0);
    ck_assert_uint_eq(read_urdf(slurp(out)).links.size(), 7);
    std::remove(out.c_str());
    std::remove(err.c_str());
    ck_assert_int_eq(rmdir(dir.c_str()), 0);
}
END_TEST

static Suite *export_suite(void)
{
    Suite *s = suite_create("export");
    TCase *c = tcase_create("same arm");
    tcase_add_test(c, test_file_has_the_arms_kinematics);
    tcase_add_test(c, test_pose_survives_gimbal_lock);
    tcase_add_test(c, test_file_has_the_arms_torques);
    tcase_add_test(c, test_bodies_are_possible_and_masses_sum);
    tcase_add_test(c, test_limits_are_of_the_output);
    tcase_add_test(c, test_armature_is_rotor_inertia_at_the_output);
    tcase_add_test(c, test_names_are_escaped_and_never_clash);
    tcase_add_test(c, test_no_payload_no_body);
    tcase_add_test(c, test_kinematics_leaves_all_masses_out);
    tcase_add_test(c, test_shipped_arm_comes_back);
    suite_add_tcase(s, c);
    c = tcase_create("refusals");
    tcase_add_test(c, test_what_is_no_body_is_refused);
    tcase_add_test(c, test_point_masses_are_for_urdf);
    tcase_add_test(c, test_options_of_the_other_format_are_refused);
    tcase_add_test(c, test_command_writes_what_the_library_says);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(export_suite())
