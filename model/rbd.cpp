// SPDX-License-Identifier: Apache-2.0
//
// Rigid-body kinematics and dynamics: one outward pass over the chain for motion, one inward pass
// for forces.
//
// Owns: the chain convention of model/hdt_arm.h in executable form.
// Never: friction, gears, rotors.
#include "model/rbd.hpp"

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace hdt::rbd {
namespace {

using Matrix6x10 = Eigen::Matrix<double, 6, 10>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Vector3d vec3(const double *p) { return Vector3d(p[0], p[1], p[2]); }
Matrix3d mat3(const double *p) { return Eigen::Map<const RowMajor3>(p); }

Matrix3d symmetric(const double *p)
{
    Matrix3d m;
    m << p[0], p[1], p[2], p[1], p[3], p[4], p[2], p[4], p[5];
    return m;
}

// Joint frame turned by q, in the previous link's frame.
Pose step(const hdt_arm_joint &joint, double q_rad)
{
    const double c = std::cos(q_rad), s = std::sin(q_rad);
    Matrix3d turn;
    turn << c, -s, 0, s, c, 0, 0, 0, 1;
    return {mat3(joint.rot) * turn, vec3(joint.origin_m)};
}

Pose flange_in_last(const hdt_arm &arm) { return {mat3(arm.flange_rot), vec3(arm.flange_m)}; }

void expect_size(const hdt_arm &arm, const VectorXd &x, const char *what)
{
    if (x.size() != arm.joints)
        throw std::invalid_argument(std::string("rbd: ") + what + " has " + std::to_string(x.size()) +
                                    " entries, the arm has " + std::to_string(arm.joints) + " joints");
}

// Motion of a frame origin, in that frame.  Gravity enters as the base accelerating against it.
struct Motion { Vector3d w, wd, a; };

Motion outward(const Motion &prev, const Pose &x, double qd, double qdd)
{
    const Vector3d z = Vector3d::UnitZ();
    const Matrix3d rt = x.rot.transpose();
    const Vector3d w_in = rt * prev.w;
    Motion m;
    m.w = w_in + qd * z;
    m.wd = rt * prev.wd + qdd * z + w_in.cross(qd * z);
    m.a = rt * (prev.a + prev.wd.cross(x.pos) + prev.w.cross(prev.w.cross(x.pos)));
    return m;
}

struct Inertial { double mass; Vector3d moment; Matrix3d inertia; };

Inertial link_inertial(const hdt_arm_joint &j)
{
    if (!j.has_inertial)
        return {0, Vector3d::Zero(), Matrix3d::Zero()};
    return {j.mass_kg, vec3(j.moment_kgm), symmetric(j.inertia_kgm2)};
}

Inertial payload_inertial(const hdt_arm &arm)
{
    const Vector3d c = vec3(arm.payload_com_m);
    const double m = arm.payload_kg;
    return {m, m * c, m * (c.squaredNorm() * Matrix3d::Identity() - c * c.transpose())};
}

struct Wrench { Vector3d force, torque; };

// Force and torque at the frame's origin that give the body this motion.
Wrench newton_euler(const Inertial &b, const Motion &m)
{
    const Vector3d l = b.inertia * m.w;
    return {b.mass * m.a + m.wd.cross(b.moment) + m.w.cross(m.w.cross(b.moment)),
            b.inertia * m.wd + m.w.cross(l) + b.moment.cross(m.a)};
}

Matrix3d cross_matrix(const Vector3d &v)
{
    Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

// The 3 x 6 matrix L with I v = L(v) (Ixx Ixy Ixz Iyy Iyz Izz).
Eigen::Matrix<double, 3, 6> inertia_columns(const Vector3d &v)
{
    Eigen::Matrix<double, 3, 6> l;
    l << v.x(), v.y(), v.z(), 0, 0, 0,
         0, v.x(), 0, v.y(), v.z(), 0,
         0, 0, v.x(), 0, v.y(), v.z();
    return l;
}

// newton_euler as a matrix on the ten parameters: force in rows 0..2, torque in rows 3..5.
Matrix6x10 body_columns(const Motion &m)
{
    Matrix6x10 y = Matrix6x10::Zero();
    const Matrix3d w = cross_matrix(m.w);
    y.block<3, 1>(0, 0) = m.a;
    y.block<3, 3>(0, 1) = cross_matrix(m.wd) + w * w;
    y.block<3, 3>(3, 1) = -cross_matrix(m.a);
    y.block<3, 6>(3, 4) = inertia_columns(m.wd) + w * inertia_columns(m.w);
    return y;
}

// The whole chain's motion: entry j is joint frame j, entry n the flange; x are the frame steps.
struct Chain {
    std::array<Pose, HDT_ARM_JOINTS_MAX + 1> x;
    std::array<Motion, HDT_ARM_JOINTS_MAX + 1> m;
};

void move_chain(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd, Chain &c)
{
    expect_size(arm, q, "q");
    expect_size(arm, qd, "qd");
    expect_size(arm, qdd, "qdd");
    Motion m = {Vector3d::Zero(), Vector3d::Zero(), -vec3(arm.gravity_mps2)};
    const std::size_t n = static_cast<std::size_t>(arm.joints);
    for (std::size_t j = 0; j < n; ++j) {
        const Eigen::Index k = static_cast<Eigen::Index>(j);
        c.x[j] = step(arm.joint[j], q[k]);
        m = outward(m, c.x[j], qd[k], qdd[k]);
        c.m[j] = m;
    }
    c.x[n] = flange_in_last(arm);
    c.m[n] = outward(m, c.x[n], 0, 0);
}

} // namespace

std::vector<Pose> frames(const hdt_arm &arm, const VectorXd &q_rad)
{
    expect_size(arm, q_rad, "q");
    std::vector<Pose> out;
    out.reserve(static_cast<std::size_t>(arm.joints) + 1);
    Pose p = {Matrix3d::Identity(), Vector3d::Zero()};
    for (int j = 0; j <= arm.joints; ++j) {
        const Pose x = j < arm.joints ? step(arm.joint[j], q_rad[j]) : flange_in_last(arm);
        p = {p.rot * x.rot, p.pos + p.rot * x.pos};
        out.push_back(p);
    }
    return out;
}

Pose flange(const hdt_arm &arm, const VectorXd &q_rad) { return frames(arm, q_rad).back(); }

MatrixXd jacobian(const hdt_arm &arm, const VectorXd &q_rad)
{
    const std::vector<Pose> f = frames(arm, q_rad);
    MatrixXd jac(6, arm.joints);
    for (int j = 0; j < arm.joints; ++j) {
        const Pose &p = f[static_cast<std::size_t>(j)];
        const Vector3d z = p.rot.col(2);
        jac.block<3, 1>(0, j) = z.cross(f.back().pos - p.pos);
        jac.block<3, 1>(3, j) = z;
    }
    return jac;
}

VectorXd inverse_dynamics(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd)
{
    Chain c;
    move_chain(arm, q, qd, qdd, c);
    const std::size_t n = static_cast<std::size_t>(arm.joints);
    Wrench w = newton_euler(payload_inertial(arm), c.m[n]);
    VectorXd tau(arm.joints);
    for (std::size_t j = n; j-- > 0;) {
        // what the next frame carries, moved to this one
        const Pose &x = c.x[j + 1];
        const Vector3d force = x.rot * w.force;
        const Wrench own = newton_euler(link_inertial(arm.joint[j]), c.m[j]);
        w.torque = own.torque + x.rot * w.torque + x.pos.cross(force);
        w.force = own.force + force;
        tau[static_cast<Eigen::Index>(j)] = w.torque.z();
    }
    return tau;
}

VectorXd gravity(const hdt_arm &arm, const VectorXd &q)
{
    const VectorXd zero = VectorXd::Zero(arm.joints);
    return inverse_dynamics(arm, q, zero, zero);
}

double potential_j(const hdt_arm &arm, const VectorXd &q)
{
    const std::vector<Pose> f = frames(arm, q);
    const Vector3d g = vec3(arm.gravity_mps2);
    double u = 0;
    for (std::size_t j = 0; j < f.size(); ++j) {
        const Inertial b = j + 1 < f.size() ? link_inertial(arm.joint[j]) : payload_inertial(arm);
        u -= g.dot(b.mass * f[j].pos + f[j].rot * b.moment);
    }
    return u;
}

MatrixXd regressor(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd)
{
    Chain c;
    move_chain(arm, q, qd, qdd, c);
    const int n = arm.joints;
    MatrixXd y = MatrixXd::Zero(n, 10 * (n + 1));
    for (int body = 0; body <= n; ++body) {
        Matrix6x10 w = body_columns(c.m[static_cast<std::size_t>(body)]);
        // carry the body's wrench inward, joint by joint
        for (int j = body; j >= 0; --j) {
            if (j < n)
                y.block<1, 10>(j, 10 * body) = w.row(5);
            const Pose &x = c.x[static_cast<std::size_t>(j)];
            const Eigen::Matrix<double, 3, 10> force = x.rot * w.topRows<3>();
            w.bottomRows<3>() = x.rot * w.bottomRows<3>() + cross_matrix(x.pos) * force;
            w.topRows<3>() = force;
        }
    }
    return y;
}

} // namespace hdt::rbd
