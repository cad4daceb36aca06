// SPDX-License-Identifier: Apache-2.0
//
// The terms of the declared model in floating point; the core's fixed-point twins are in
// ctrl/hdt_comp.c and ctrl/hdt_chain.c.
//
// Owns: the formulas.
// Never: shares code with the simulator.
#include "model/terms.hpp"

#include <algorithm>
#include <cmath>

#include "model/rbd.hpp"

namespace hdt {

double stribeck_nm(const hdt_arm_friction &f, double speed_radps)
{
    return f.f0_nm + f.fv_nmspr * speed_radps - f.fs_nm * std::expm1(-speed_radps / f.vc_radps);
}

int home_line(const hdt_arm_stiffness &k)
{
    return 0 < k.t1_nm ? 0 : 0 <= k.t2_nm ? 1 : 2;
}

StiffnessLines stiffness_lines(const hdt_arm_stiffness &k)
{
    // the line that holds load 0 has the given value there; its neighbours join it at t1 and t2
    const int home = home_line(k);
    StiffnessLines out{};
    out.intercept_nm[home] = k.zero_nm;
    for (int line = home; line > 0; line--) {
        const double joint_nm = line == 1 ? k.t1_nm : k.t2_nm;
        out.intercept_nm[line - 1] =
            out.intercept_nm[line] + (k.slope[line] - k.slope[line - 1]) * joint_nm;
    }
    for (int line = home; line < 2; line++) {
        const double joint_nm = line == 0 ? k.t1_nm : k.t2_nm;
        out.intercept_nm[line + 1] =
            out.intercept_nm[line] + (k.slope[line] - k.slope[line + 1]) * joint_nm;
    }
    return out;
}

double stiffness_nm(const hdt_arm_stiffness &k, double load_nm)
{
    const int line = load_nm < k.t1_nm ? 0 : load_nm <= k.t2_nm ? 1 : 2;
    return stiffness_lines(k).intercept_nm[line] + k.slope[line] * load_nm;
}

double curve_nm(const hdt_arm_curve &c, double x)
{
    const double place = (x - c.from) / (c.to - c.from) * (HDT_ARM_CURVE_POINTS - 1);
    const double held = std::fmin(std::fmax(place, 0), HDT_ARM_CURVE_POINTS - 1);
    const int k = std::min(static_cast<int>(held), HDT_ARM_CURVE_POINTS - 2);
    return c.nm[k] + (c.nm[k + 1] - c.nm[k]) * (held - k);
}

double local_nm(const hdt_arm_joint &joint, int way, double q_rad)
{
    double sum = joint.has_local ? curve_nm(joint.local[way], q_rad) : 0;
    for (int i = 0; i < joint.bumps; i++) {
        const double u = (q_rad - joint.bump[i].at_rad) / joint.bump[i].width_rad;
        sum += joint.bump[i].torque_nm * std::exp(-0.5 * u * u);
    }
    return sum;
}

double table_nm(const hdt_arm_joint &joint, double q_rad, double speed_radps, double load_nm)
{
    const double turns = q_rad * joint.ratio / (2 * M_PI);
    const double x[HDT_AXES] = {q_rad, load_nm, turns - std::floor(turns), speed_radps};
    return curve_nm(joint.table, x[joint.table_axis]);
}

double spring_nm(const hdt_arm_joint &joint, double q_rad)
{
    return joint.spring_nmprad * (q_rad - joint.spring_q0_rad);
}

double reflected_inertia_kgm2(const hdt_arm_joint &joint)
{
    return joint.ratio * joint.ratio * (joint.rotor_kgm2_m + joint.wave_generator_kgm2_m)
           + joint.extra_inertia_kgm2;
}

namespace {

double line_nm(const hdt_arm_line &line, double q_rad, double dir)
{
    const double value = line.amplitude_nm * std::sin(line.order_rev * q_rad + line.phase_rad);
    return line.directed ? value * dir : value;
}

// What depends on one joint alone and on its load.
void joint_terms(const hdt_arm_joint &joint, const Sample &s, int j, double load_nm,
                 TermTorque *out)
{
    const double q = s.q[j], v = s.v[j], dir = s.dir[j];
    TermTorque &term = *out;
    const int way = dir < 0 ? 1 : 0;
    if (joint.has_friction)
        term[HDT_TERM_FRICTION] = dir * stribeck_nm(joint.friction[way], std::fabs(v));
    for (int i = 0; i < joint.ripples; i++)
        term[HDT_TERM_RIPPLE] += line_nm(joint.ripple[i], q, dir);
    if (joint.has_stiffness)
        term[HDT_TERM_STIFFNESS] = std::fabs(dir) * stiffness_nm(joint.stiffness[way], load_nm);
    for (int i = 0; i < joint.lines; i++)
        term[HDT_TERM_LINES] += line_nm(joint.line[i], q, dir);
    term[HDT_TERM_LOAD] = dir * joint.load_mu * std::fabs(load_nm);
    if (joint.warm_s > 0)
        term[HDT_TERM_TEMPERATURE] = std::exp(-s.t_s / joint.warm_s)
                                     * (joint.cold_coulomb_nm * dir + joint.cold_viscous_nmspr * v);
    if (joint.presliding_rad > 0)
        term[HDT_TERM_PRESLIDING] =
            -dir * joint.presliding_nm * std::exp(-s.travel[j] / joint.presliding_rad);
    if (joint.has_stiffness && joint.windup_rad > 0) {
        const double up = stiffness_nm(joint.stiffness[0], load_nm);
        const double down = stiffness_nm(joint.stiffness[1], load_nm);
        const double wound = s.wound.size() > j ? s.wound[j] : dir;
        term[HDT_TERM_STIFFNESS] = 0.5 * (up + down + wound * (up - down));
    }
    term[HDT_TERM_LOCAL] = dir * local_nm(joint, way, q);
    if (joint.has_table)
        term[HDT_TERM_TABLE] = (joint.table_directed ? dir : 1) * table_nm(joint, q, std::fabs(v), load_nm);
    term[HDT_TERM_SPRING] = spring_nm(joint, q);
    term[HDT_TERM_OFFSET] = joint.torque_offset_nm;
}

} // namespace

std::vector<TermTorque> arm_terms(const hdt_arm &arm, const Sample &s)
{
    std::vector<TermTorque> out(static_cast<std::size_t>(arm.joints));
    const Eigen::VectorXd gravity = rbd::gravity(arm, s.q);
    const Eigen::VectorXd moving = rbd::inverse_dynamics(arm, s.q, s.v, s.a) - gravity;
    for (int j = 0; j < arm.joints; j++) {
        TermTorque &term = out[static_cast<std::size_t>(j)];
        term.fill(0);
        term[HDT_TERM_GRAVITY] = gravity[j];
        term[HDT_TERM_INERTIA] = moving[j] + reflected_inertia_kgm2(arm.joint[j]) * s.a[j];
        joint_terms(arm.joint[j], s, j, gravity[j] + spring_nm(arm.joint[j], s.q[j]), &term);
    }
    return out;
}

} // namespace hdt
