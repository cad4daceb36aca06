// SPDX-License-Identifier: Apache-2.0
#include "model/tablegen_error.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "model/rbd.hpp"
#include "model/terms.hpp"

namespace hdt {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int states = 500;

double number(int64_t raw, int bits)
{
    return std::ldexp(static_cast<double>(raw), -bits);
}

Matrix3d skew(const Vector3d &v)
{
    Matrix3d m;
    m << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
    return m;
}

// The links of the tables (ctrl/hdt_chain.h): moments and steps have no z.
struct ChainLink {
    Matrix3d rot; // previous link to this one, turned
    Vector3d step, first;
    Matrix3d second;
};

ChainLink chain_link(const hdt_joint_tab &tab, double q_rad)
{
    const double c = number(tab.twist_cos_q30, 30), s = number(tab.twist_sin_q30, 30);
    const double turned = q_rad + number(tab.phase0, 32) * 2 * M_PI;
    double second[5];
    for (int i = 0; i < 5; i++)
        second[i] = number(tab.second_q20[i], 20);
    ChainLink link;
    link.rot << 1, 0, 0, 0, c, -s, 0, s, c;
    link.rot *= Eigen::AngleAxisd(turned, Vector3d::UnitZ()).toRotationMatrix();
    link.step = {number(tab.step_q24[0], 24), number(tab.step_q24[1], 24), 0};
    link.first = {number(tab.moment_q20[0], 20), number(tab.moment_q20[1], 20), 0};
    link.second << second[0], second[1], second[2], second[1], second[3], second[4], second[2], second[4], 0;
    return link;
}

// Joint torques of the tables' links at a motion, the base accelerating, without rotors.
VectorXd chain_nm(const hdt_tables &t, const VectorXd &q, const VectorXd &v, const VectorXd &a,
                  const Vector3d &base_mps2)
{
    const auto n = static_cast<std::size_t>(t.joints);
    std::vector<ChainLink> link(n);
    std::vector<Vector3d> force(n), moment(n);
    Vector3d turning = Vector3d::Zero(), growing = Vector3d::Zero(), moving = base_mps2; // of the link before
    Matrix3d u = Matrix3d::Zero();
    for (std::size_t j = 0; j < n; j++) {
        const auto i = static_cast<Eigen::Index>(j);
        link[j] = chain_link(t.joint[j], q[i]);
        const Matrix3d in = link[j].rot.transpose();
        const Vector3d own = v[i] * Vector3d::UnitZ();
        moving = in * (moving + u * link[j].step);
        turning = in * turning;
        growing = in * growing + turning.cross(own) + a[i] * Vector3d::UnitZ();
        turning += own;
        u = skew(growing) + skew(turning) * skew(turning);
        const Matrix3d m = u * link[j].second;
        force[j] = u * link[j].first;
        moment[j] = Vector3d(m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1))
                    + link[j].first.cross(moving);
    }
    VectorXd tau(static_cast<Eigen::Index>(n));
    Vector3d f = Vector3d::Zero(), m = Vector3d::Zero();
    for (std::size_t j = n; j-- > 0;) {
        f += force[j];
        m += moment[j];
        tau[static_cast<Eigen::Index>(j)] = m[2];
        f = link[j].rot * f;
        m = link[j].rot * m + link[j].step.cross(f);
    }
    return tau;
}

// Spread over the limits by a fixed sequence.
struct Spread {
    uint64_t state = 1;

    double between(double low, double high)
    {
        state = state * 6364136223846793005u + 1442695040888963407u;
        return low + number(static_cast<int64_t>(state >> 11), 53) * (high - low);
    }
};

struct State {
    VectorXd q, v, a, load_nm;
};

State next_state(const hdt_arm &arm, const hdt_tables &t, Spread *spread)
{
    const VectorXd zero = VectorXd::Zero(arm.joints);
    State s{zero, zero, zero, zero};
    for (int j = 0; j < arm.joints; j++) {
        const hdt_arm_joint &joint = arm.joint[j];
        const double a_lim = number(t.joint[j].a_lim_q16, 16);
        s.q[j] = spread->between(joint.q_min_rad, joint.q_max_rad);
        s.v[j] = spread->between(-joint.v_max_radps, joint.v_max_radps);
        s.a[j] = spread->between(-a_lim, a_lim);
    }
    return s;
}

void grow(double *worst_nm, double error_nm)
{
    *worst_nm = std::max(*worst_nm, std::fabs(error_nm));
}

// Gravity and inertia; the load the gear carries comes out.
void measure_chain(const hdt_arm &arm, const hdt_tables &t, State *s, double worst_nm[HDT_TERMS])
{
    const VectorXd zero = VectorXd::Zero(arm.joints), held = rbd::gravity(arm, s->q);
    const Vector3d g(t.gravity_q24[0], t.gravity_q24[1], t.gravity_q24[2]);
    const VectorXd holding = chain_nm(t, s->q, zero, zero, std::ldexp(-1, -24) * g);
    const VectorXd moving = rbd::inverse_dynamics(arm, s->q, s->v, s->a) - held;
    const VectorXd rounded = chain_nm(t, s->q, s->v, s->a, Vector3d::Zero());
    for (int j = 0; j < arm.joints; j++) {
        const double rotor = number(t.joint[j].rotor_q20, 20) - reflected_inertia_kgm2(arm.joint[j]);
        grow(&worst_nm[HDT_TERM_GRAVITY], holding[j] - held[j]);
        grow(&worst_nm[HDT_TERM_INERTIA], rounded[j] - moving[j] + rotor * s->a[j]);
        s->load_nm[j] = held[j] + spring_nm(arm.joint[j], s->q[j]);
    }
}

double line_nm(const hdt_stiffness_tab &s, double load_nm)
{
    const int i = load_nm < number(s.t1_q16, 16) ? 0 : load_nm <= number(s.t2_q16, 16) ? 1 : 2;
    return number(s.intercept_q16[i], 16) + number(s.slope_q24[i], 24) * load_nm;
}

void measure_stiffness(const hdt_arm_joint &joint, const hdt_joint_tab &tab, double load_nm, double *worst_nm)
{
    for (int way = 0; way < 2; way++)
        grow(worst_nm, line_nm(tab.stiffness[way], load_nm) - stiffness_nm(joint.stiffness[way], load_nm));
    if (joint.windup_rad > 0) {
        // half of what lies between the directions follows the wind-up
        const double wound = number(tab.windup_inv_q8, 8) * joint.windup_rad - 1;
        const double up = stiffness_nm(joint.stiffness[0], load_nm);
        grow(worst_nm, wound * (up - stiffness_nm(joint.stiffness[1], load_nm)) / 2);
    }
}

// Terms of one joint at one state; `part`, 0..1, goes through the decays.
void measure_joint(const hdt_arm_joint &joint, const hdt_joint_tab &tab, double q, double v, double load_nm,
                   double part, double worst_nm[HDT_TERMS])
{
    constexpr double decays = 5; // of a time constant, of a travel
    if (joint.has_stiffness)
        measure_stiffness(joint, tab, load_nm, &worst_nm[HDT_TERM_STIFFNESS]);
    grow(&worst_nm[HDT_TERM_LOAD], (number(tab.load_mu_q24, 24) - joint.load_mu) * load_nm);
    if (joint.warm_s > 0) {
        const double t_s = part * decays * joint.warm_s;
        const double viscous = number(tab.cold_viscous_q16, 16), speed = std::fabs(v);
        const double rounded = number(tab.cold_coulomb_q16, 16) + viscous * speed;
        const double exact = joint.cold_coulomb_nm + joint.cold_viscous_nmspr * speed;
        grow(&worst_nm[HDT_TERM_TEMPERATURE], std::pow(number(tab.cold_decay_q31, 31), t_s) * rounded
                                                  - std::exp(-t_s / joint.warm_s) * exact);
    }
    if (joint.presliding_rad > 0) {
        const double travel = part * decays * joint.presliding_rad;
        grow(&worst_nm[HDT_TERM_PRESLIDING],
             number(tab.presliding_q16, 16) * std::exp(-travel * number(tab.presliding_inv_q8, 8))
                 - joint.presliding_nm * std::exp(-travel / joint.presliding_rad));
    }
    grow(&worst_nm[HDT_TERM_SPRING],
         number(tab.spring_q16, 16) * (q - number(tab.spring_q0_q24, 24)) - spring_nm(joint, q));
    grow(&worst_nm[HDT_TERM_OFFSET], number(tab.offset_q16, 16) - joint.torque_offset_nm);
    grow(&worst_nm[HDT_TERM_P],
         (number(tab.kp_q16, 16) - joint.ratio * joint.kp_m_nmprad) * number(tab.follow_max_q24, 24));
    grow(&worst_nm[HDT_TERM_D], (number(tab.kd_q16, 16) - joint.ratio * joint.kd_m_nmspr) * 2 * v);
}

} // namespace

void measure_formulas(const hdt_arm &arm, const hdt_tables &t, double worst_nm[HDT_TERMS])
{
    Spread spread;
    for (int i = 0; i <= states; i++) {
        State s = next_state(arm, t, &spread);
        measure_chain(arm, t, &s, worst_nm);
        for (int j = 0; j < arm.joints; j++)
            measure_joint(arm.joint[j], t.joint[j], s.q[j], s.v[j], s.load_nm[j], double(i) / states,
                          worst_nm);
    }
}

} // namespace hdt
