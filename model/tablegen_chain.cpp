// SPDX-License-Identifier: Apache-2.0
//
// Frames and moments of the core's chain; what they are is in ctrl/hdt_chain.h.
//
// Going from the last link in: rot = Rz(before) Rx(twist) Rz(after).  The turn `after` joins the
// joint's own angle; the turn `before` is taken over by the frame of the link before, and so is the
// way along the joint's axis.  Mass on the axis of a joint does not care for its angle, so mass,
// moment along the axis and second moment along the axis go to the link before.
#include "model/tablegen_chain.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "model/tablegen_fixed.hpp"
#include "model/terms.hpp"

namespace hdt {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using RowMatrix = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>;

constexpr double pi = 3.14159265358979323846;

Matrix3d about_x(double rad)
{
    return Eigen::AngleAxisd(rad, Vector3d::UnitX()).toRotationMatrix();
}

Matrix3d about_z(double rad)
{
    return Eigen::AngleAxisd(rad, Vector3d::UnitZ()).toRotationMatrix();
}

// Mass, first moment, second moment (integral of r r') about some origin in some axes.
struct Heap {
    double mass = 0;
    Vector3d first = Vector3d::Zero();
    Matrix3d second = Matrix3d::Zero();

    Heap &operator+=(const Heap &other)
    {
        mass += other.mass;
        first += other.first;
        second += other.second;
        return *this;
    }
    // as seen from an origin at -r
    Heap shifted(const Vector3d &r) const
    {
        const Matrix3d mixed = first * r.transpose();
        return {mass, first + mass * r, second + mixed + mixed.transpose() + mass * r * r.transpose()};
    }
    Heap turned(const Matrix3d &rot) const
    {
        return {mass, rot * first, rot * second * rot.transpose()};
    }
};

// A link with what is fixed to it: the payload belongs to the last one.
Heap link_heap(const hdt_arm &arm, int j)
{
    const hdt_arm_joint &joint = arm.joint[j];
    Heap heap;
    if (joint.has_inertial) {
        const double *i = joint.inertia_kgm2;
        Matrix3d inertia;
        inertia << i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5];
        heap = {joint.mass_kg, Vector3d(joint.moment_kgm),
                inertia.trace() / 2 * Matrix3d::Identity() - inertia};
    }
    if (j + 1 == arm.joints) {
        const Heap point{arm.payload_kg, Vector3d::Zero(), Matrix3d::Zero()};
        heap += point.shifted(Vector3d(arm.flange_m)
                              + RowMatrix(arm.flange_rot) * Vector3d(arm.payload_com_m));
    }
    return heap;
}

// rot = Rz(before) Rx(twist) Rz(after), 0 <= twist <= pi.
struct Angles {
    double before = 0, twist = 0, after = 0;
};

// Zero, or a whole number of quarter turns, where an arm file's decimals mean it.
double settled(double rad)
{
    const double quarter = std::round(rad / (pi / 2)) * (pi / 2);
    return std::fabs(rad - quarter) < 1e-9 ? quarter : rad;
}

Angles split(const Matrix3d &rot)
{
    Angles a;
    const Vector3d axis = rot.col(2);
    const double across = std::hypot(axis[0], axis[1]);
    a.twist = settled(std::atan2(across, axis[2]));
    if (across > 1e-9)
        a.before = settled(std::atan2(axis[0], -axis[1]));
    const Matrix3d rest = about_x(-a.twist) * about_z(-a.before) * rot;
    a.after = std::atan2(rest(1, 0), rest(0, 0));
    return a;
}

// Cosine or sine, exact at quarter turns.
int32_t part_q30(double x)
{
    return static_cast<int32_t>(std::llround(std::ldexp(x, 30)));
}

struct Link {
    Angles angles;
    Vector3d step = Vector3d::Zero(); // from the frame before to this one, in the axes of that
    Heap own;
};

// Links in the core's frames, and the turn of the base about z that goes with them.
std::vector<Link> links_of(const hdt_arm &arm, double *base_turn)
{
    std::vector<Link> links(static_cast<std::size_t>(arm.joints));
    Heap later;              // what the link after left, in this link's new frame
    double turn = 0, up = 0; // this link's new frame against the model's: about and along z
    for (int j = arm.joints - 1; j >= 0; j--) {
        const hdt_arm_joint &joint = arm.joint[j];
        Link &link = links[static_cast<std::size_t>(j)];
        link.angles = split(RowMatrix(joint.rot));
        link.own = link_heap(arm, j).shifted({0, 0, -up}).turned(about_z(-turn));
        link.own += later;

        // where this frame lies in the frame before, whose z it may move along; the base stays
        const Matrix3d back = about_z(-link.angles.before);
        const Vector3d axis = back * RowMatrix(joint.rot).col(2);
        link.step = back * Vector3d(joint.origin_m) + up * axis;
        up = link.step[2];
        if (j > 0)
            link.step[2] = 0;

        // what lies on this joint's axis
        later = Heap{link.own.mass, link.own.first[2] * axis,
                     link.own.second(2, 2) * axis * axis.transpose()}
                    .shifted(link.step);
        link.angles.after += turn;
        turn = link.angles.before;
    }
    *base_turn = turn;
    return links;
}

void write_flags(hdt_tables *t)
{
    const auto when = [](bool is, hdt_chain flag) { return is ? static_cast<uint32_t>(flag) : 0u; };
    bool far = false;
    for (uint32_t j = 0; j < t->joints; j++) {
        hdt_joint_tab &tab = t->joint[j];
        const bool step = j > 0 && (tab.step_q24[0] != 0 || tab.step_q24[1] != 0);
        const bool skew = tab.second_q20[1] != 0 || tab.second_q20[2] != 0 || tab.second_q20[4] != 0;
        const bool right = tab.twist_cos_q30 == 0 && tab.twist_sin_q30 == 1 << 30;
        far = far || step;
        tab.chain = when(right, HDT_CHAIN_RIGHT) | when(step, HDT_CHAIN_STEP)
                    | when(far, HDT_CHAIN_FAR) | when(skew, HDT_CHAIN_SKEW);
    }
}

void write_link(const Link &link, const std::string &key, const std::string &body, hdt_joint_tab *out)
{
    out->phase0 = static_cast<uint32_t>(turn_part(link.angles.after / (2 * pi), 32));
    out->twist_cos_q30 = part_q30(std::cos(link.angles.twist));
    out->twist_sin_q30 = part_q30(std::sin(link.angles.twist));
    for (int i = 0; i < 2; i++) {
        out->step_q24[i] = fixed(key + "origin", link.step[i], 24);
        out->moment_q20[i] = fixed(body + ".com", link.own.first[i], 20);
    }
    const Matrix3d &s = link.own.second;
    const double second[5] = {s(0, 0), s(0, 1), s(0, 2), s(1, 1), s(1, 2)};
    for (int i = 0; i < 5; i++)
        out->second_q20[i] = fixed(body + ".inertia", second[i], 20);
}

// The model's own numbers, so that one which is out of any sense is named before the booking spreads it.
void check_numbers(const hdt_arm_joint &joint, const Heap &own, const std::string &key,
                   const std::string &body)
{
    for (int i = 0; i < 3; i++)
        fixed(key + "origin", joint.origin_m[i], 24);
    fixed(body + ".mass", own.mass, 20);
    for (int i = 0; i < 3; i++)
        fixed(body + ".com", own.first[i], 20);
    for (int i = 0; i < 9; i++)
        fixed(body + ".inertia", own.second(i / 3, i % 3), 20);
}

// Does the joint turn any mass: its own link's, or a later one's?
bool moves_mass(const std::vector<Heap> &own, std::size_t j)
{
    double sum = 0;
    for (; j < own.size(); j++)
        sum += own[j].mass + own[j].first.norm();
    return sum > 0;
}

} // namespace

void make_chain(const hdt_arm &arm, hdt_tables *t)
{
    const auto key_of = [](int j) { return "joint." + std::to_string(j + 1) + "."; };
    const auto body_of = [&](int j) {
        return key_of(j) + (j + 1 == arm.joints && arm.payload_kg > 0 ? "link with payload" : "link");
    };
    std::vector<Heap> own;
    for (int j = 0; j < arm.joints; j++) {
        own.push_back(link_heap(arm, j));
        check_numbers(arm.joint[j], own.back(), key_of(j), body_of(j));
    }
    double base_turn = 0;
    const std::vector<Link> links = links_of(arm, &base_turn);
    for (int j = 0; j < arm.joints; j++) {
        const auto at = static_cast<std::size_t>(j);
        hdt_joint_tab &out = t->joint[j];
        write_link(links[at], key_of(j), body_of(j), &out);
        out.rotor_q20 = fixed(key_of(j) + "motor.rotor_inertia (reflected)",
                              reflected_inertia_kgm2(arm.joint[j]), 20, 0, HUGE_VAL);
        const bool gravity = moves_mass(own, at);
        out.terms |= (gravity ? 1u : 0u) << HDT_TERM_GRAVITY;
        if (gravity || own[at].second.norm() > 0 || out.rotor_q20 != 0)
            out.terms |= 1u << HDT_TERM_INERTIA;
    }
    write_flags(t);
    const Vector3d g = about_z(-base_turn) * Vector3d(arm.gravity_mps2);
    for (int i = 0; i < 3; i++)
        t->gravity_q24[i] = fixed("base.gravity", g[i], 24);
}

} // namespace hdt
