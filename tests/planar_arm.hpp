// SPDX-License-Identifier: Apache-2.0
//
// A two-joint arm in the vertical plane, by textbook formulas, with healthy imperfections and one
// hidden effect: logs for the diagnosis, sharing no code with it.
//
// Owns: the arm as TOML text, motion, torque, noise.
// Never: includes anything of model/ but the run and the arm file it hands over.
#ifndef PLANAR_ARM_HPP
#define PLANAR_ARM_HPP

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "model/arm_file.hpp"
#include "model/log.hpp"

namespace planar {

constexpr double kG = 9.81, kRatio = 50, kRate_hz = 100;
constexpr double kL1 = 0.45, kL2 = 0.5;
constexpr double kM[2] = {9, 6}, kC[2] = {0.2, 0.22}, kI[2] = {0.15, 0.12};       // inertia about the com
constexpr double kF0[2][2] = {{38, 40}, {30, 31}}, kFv[2][2] = {{25, 27}, {40, 41}};
constexpr double kFs[2] = {6, 5}, kVc[2] = {0.1, 0.08};

// upright: the same arm with the base's z up, so that a tilt of the base acts in the arm's plane.
inline std::string arm_text(bool upright = false)
{
    const auto n = [](double x) { return std::to_string(x); };
    std::string s = "format = \"hdt-arm\"\nversion = 1\nname = \"planar\"\n[sources]\nT = \"test\"\n"
                    "[base]\ngravity = { value = " + std::string(upright ? "[0, 0, -9.81]" : "[0, -9.81, 0]")
                    + ", unit = \"m/s^2\", confidence = \"high\", source = \"T\" }\n"
                    "[control]\nrate = { value = 100, unit = \"Hz\", confidence = \"high\", "
                    "source = \"T\" }\n"
                    "velocity_cutoff = { value = 30, unit = \"Hz\", confidence = \"high\", source = \"T\" }\n"
                    "[flange]\norigin = { value = [0.5, 0, 0], unit = \"m\", confidence = \"high\", "
                    "source = \"T\" }\n"
                    "rpy = { value = [0, 1.5707963267948966, 0], unit = \"rad\", confidence = \"high\", "
                    "source = \"T\" }\n";
    const auto q = [](const std::string &key, const std::string &v, const char *unit,
                      const char *side = nullptr) {
        return key + " = { value = " + v + ", unit = \"" + unit + "\""
               + (side ? std::string(", side = \"") + side + "\"" : "")
               + ", confidence = \"high\", source = \"T\" }\n";
    };
    for (int j = 0; j < 2; ++j) {
        s += "[[joint]]\nname = \"J" + std::to_string(j + 1) + "\"\n";
        s += q("origin", j == 0 ? "[0, 0, 0]" : "[0.45, 0, 0]", "m")
             + q("rpy", upright && j == 0 ? "[1.5707963267948966, 0, 0]" : "[0, 0, 0]", "rad");
        s += q("limits.position", "[-3, 3]", "rad") + q("limits.speed", "1", "rad/s");
        s += q("link.mass", n(kM[j]), "kg") + q("link.com", "[" + n(kC[j]) + ", 0, 0]", "m");
        s += q("link.inertia", "[0.01, 0, 0, " + n(kI[j]) + ", 0, " + n(kI[j]) + "]", "kg m^2");
        s += q("gear.ratio", "50", "1");
        s += q("motor.rotor_inertia", "0.0003", "kg m^2", "motor")
             + q("motor.torque_rated", "5", "N m", "motor")
             + q("motor.torque_max", "10", "N m", "motor");
        s += q("friction.valid", "[0.02, 0.4]", "rad/s");
        for (int d = 0; d < 2; ++d) {
            const std::string at = std::string("friction.") + (d == 0 ? "positive." : "negative.");
            s += q(at + "f0", n(kF0[j][d]), "N m", "output")
                 + q(at + "fv", n(kFv[j][d]), "N m s/rad", "output")
                 + q(at + "fs", n(kFs[j]), "N m", "output") + q(at + "vc", n(kVc[j]), "rad/s", "output");
        }
        s += q("feedback.kp", "5", "N m/rad", "motor") + q("feedback.kd", "1", "N m s/rad", "motor");
    }
    return s;
}

// Hidden in joint `joint` (0-based) unless it is the payload.
struct Hidden {
    int joint = 0;
    double payload_kg = 0, payload_x_m = 0.07;
    double load_mu = 0, cold = 0, warm_s = 25, line_nm = 0, line_order = 37, line_phase = 0.7;
    bool line_directed = false;
    double inertia_kgm2 = 0, presliding_nm = 0, presliding_rad = 0.01, gain = 0;
    double spring = 0, spring_rest = 0.4;
    double dry_spot_nm = 0;                 // friction bump at q = 0.3
    // outside every list: friction over the other joint's angle; over the cube of its own, N.m at 1 rad
    double pose_friction_nm = 0, own_friction_nm = 0;
    double tilt_rad = 0, angle_rad = 0;     // base tilted in the plane; resolver of the joint reads short by
    double ahead_rad = 0;                   // resolver reads ahead by this times sin q
    double moment_kgm = 0;                  // of the first link, more than declared
    double drive_mu = 0, square = 0, slow_nm = 0;
    double knee_nm = 0, missing = 0, constant_nm = 0;
    double ripple_per_nm = 0, ripple_per_radps = 0; // order 50
    double other_kgm2 = 0;                  // swung by the other joint
    double hum_nm = 0, hum_hz = 7.3, step_nm = 0, step_at_nm = -20;
    // what begins or ends within a run
    double push_nm = 0, drag_nm = 0, slip_rad = 0, from_s = 0, to_s = 1e9;
};

struct Noise {
    double white = 0.23, coloured = 0.30, phi = 0.93, run_coulomb = 0.40, wander = 0.12, run_viscous = 0.01;
    double delay_s = 0, windup_nmprad = 0;  // healthy imperfections of a real gear and bus
    double fat = 0;                         // share of torque samples three times as noisy
};

struct Motion { std::vector<double> q, v, a; };

// Random moves between -1.4 and 1.4 rad: speed rises and falls as a raised cosine, with short rests.
inline Motion random_motion(std::mt19937_64 &rng, int rows)
{
    constexpr double pi = 3.14159265358979;
    std::uniform_real_distribution<double> u(0, 1);
    Motion m;
    double q = 2.4 * u(rng) - 1.2;
    while (static_cast<int>(m.q.size()) < rows) {
        const double goal = 2.8 * u(rng) - 1.4, speed = 0.03 * std::pow(13.0, u(rng)), acc = 0.5 + u(rng);
        const double dist = std::fabs(goal - q), way = goal > q ? 1 : -1;
        if (dist < 0.05)
            continue;
        const double top = std::min(speed, std::sqrt(acc * dist)), ramp = std::max(0.25, top / acc);
        const double peak = std::min(top, dist / ramp), cruise = (dist - peak * ramp) / peak;
        const double end = 2 * ramp + cruise;
        // distance run while speeding up for t, and its derivatives
        const auto up = [&](double t) { return 0.5 * peak * (t - ramp / pi * std::sin(pi * t / ramp)); };
        for (double t = 0; t < end; t += 1 / kRate_hz) {
            const double s = t < ramp ? t : end - t; // time from the nearer end
            const bool ramps = s < ramp;
            const double v = ramps ? 0.5 * peak * (1 - std::cos(pi * s / ramp)) : peak;
            const double a = ramps ? 0.5 * peak * pi / ramp * std::sin(pi * s / ramp) : 0;
            const double x = t < ramp            ? up(t)
                             : t < ramp + cruise ? 0.5 * peak * ramp + peak * (t - ramp)
                                                 : dist - up(s);
            m.q.push_back(q + way * x);
            m.v.push_back(way * v);
            m.a.push_back(t < ramp ? way * a : -way * a);
        }
        q = goal;
        for (int k = 0; k < 8; ++k)
            m.q.push_back(q), m.v.push_back(0), m.a.push_back(0);
    }
    m.q.resize(static_cast<std::size_t>(rows));
    m.v.resize(static_cast<std::size_t>(rows));
    m.a.resize(static_cast<std::size_t>(rows));
    return m;
}

// Rigid-body torque of the two links and a point mass beyond the second link's end.
inline void rigid(const double *q, const double *v, const double *a, double mp, double xp, double *load,
                  double *tau)
{
    const double c2 = std::cos(q[1]), s2 = std::sin(q[1]), lp = kL2 + xp;
    const double h = kM[1] * kC[1] + mp * lp, m2 = kM[1] + mp;
    const double i2 = kI[1] + kM[1] * kC[1] * kC[1] + mp * lp * lp;
    const double i1 = kI[0] + kM[0] * kC[0] * kC[0] + m2 * kL1 * kL1 + i2 + 2 * kL1 * h * c2;
    const double i12 = i2 + kL1 * h * c2;
    load[0] = kG * ((kM[0] * kC[0] + m2 * kL1) * std::cos(q[0]) + h * std::cos(q[0] + q[1]));
    load[1] = kG * h * std::cos(q[0] + q[1]);
    tau[0] = load[0] + i1 * a[0] + i12 * a[1] - kL1 * h * s2 * (2 * v[0] * v[1] + v[1] * v[1]);
    tau[1] = load[1] + i12 * a[0] + i2 * a[1] + kL1 * h * s2 * v[0] * v[0];
}

inline hdt::Run make_run(const Hidden &hidden, const Noise &noise, unsigned long seed, double seconds = 40)
{
    std::mt19937_64 rng(seed);
    std::normal_distribution<double> gauss(0, 1);
    std::uniform_real_distribution<double> uniform(0, 1);
    const int rows = static_cast<int>(seconds * kRate_hz);
    const Motion m[2] = {random_motion(rng, rows), random_motion(rng, rows)};
    hdt::Run run;
    run.path = "seed" + std::to_string(seed) + ".csv";
    run.joint.resize(2);
    double coulomb[2], viscous[2], wander[2] = {0, 0}, colour[2] = {0, 0}, z[2] = {0, 0}, dir[2] = {0, 0};
    for (int j = 0; j < 2; ++j) {
        run.joint[static_cast<std::size_t>(j)].present = true;
        coulomb[j] = noise.run_coulomb * gauss(rng);
        viscous[j] = 1 + noise.run_viscous * gauss(rng);
        wander[j] = noise.wander * gauss(rng);
    }
    const double keep = std::exp(-1 / (10 * kRate_hz));
    const double hum_phase = hidden.hum_nm != 0 ? 6.283 * uniform(rng) : 0;
    std::vector<double> tau_all[2];
    for (int t = 0; t < rows; ++t) {
        const auto k = static_cast<std::size_t>(t);
        const double q[2] = {m[0].q[k], m[1].q[k]}, v[2] = {m[0].v[k], m[1].v[k]};
        const double a[2] = {m[0].a[k], m[1].a[k]};
        const bool now = t / kRate_hz >= hidden.from_s && t / kRate_hz < hidden.to_s;
        // gravity turned is the first angle turned
        double load[2], tau[2], ql[2], at[2] = {q[0] + hidden.tilt_rad, q[1]};
        at[hidden.joint] += hidden.angle_rad - hidden.ahead_rad * std::sin(q[hidden.joint])
                            + (now ? hidden.slip_rad : 0);
        rigid(at, v, a, hidden.payload_kg, hidden.payload_x_m, load, tau);
        for (int j = 0; j < 2; ++j)
            ql[j] = noise.windup_nmprad > 0 ? at[j] - load[j] / noise.windup_nmprad : at[j];
        rigid(ql, v, a, hidden.payload_kg, hidden.payload_x_m, load, tau);
        run.t_s.push_back(t / kRate_hz);
        for (int j = 0; j < 2; ++j) {
            const bool here = hidden.joint == j;
            const double way = v[j] > 0 ? 1 : v[j] < 0 ? -1 : 0;
            if (way != 0)
                dir[j] = way;
            const int d = dir[j] < 0 ? 1 : 0;
            wander[j] = keep * wander[j] + noise.wander * std::sqrt(1 - keep * keep) * gauss(rng);
            colour[j] = noise.phi * colour[j]
                        + noise.coloured * std::sqrt(1 - noise.phi * noise.phi) * gauss(rng);
            double friction = kF0[j][d] + viscous[j] * kFv[j][d] * std::fabs(v[j])
                              + kFs[j] * (1 - std::exp(-std::fabs(v[j]) / kVc[j])) + coulomb[j] + wander[j];
            // the elastic part of friction follows motion with a length constant
            z[j] = dir[j] + (z[j] - dir[j]) * std::exp(-std::fabs(v[j]) / kRate_hz / hidden.presliding_rad);
            if (here) {
                friction += hidden.load_mu * std::fabs(tau[j]);
                friction *= 1 + hidden.cold * std::exp(-run.t_s.back() / hidden.warm_s);
                friction += hidden.dry_spot_nm * std::exp(-0.5 * std::pow((q[j] - 0.3) / 0.15, 2));
                friction += hidden.pose_friction_nm * std::exp(-0.5 * std::pow((q[1 - j] - 0.3) / 0.4, 2));
                friction += hidden.own_friction_nm * q[j] * q[j] * q[j];
                friction += hidden.drive_mu * std::max(0.0, dir[j] * load[j]) + hidden.square * v[j] * v[j];
                friction += hidden.slow_nm * std::exp(-std::fabs(v[j]) / 0.03) + (now ? hidden.drag_nm : 0);
                const double past_step_nm = dir[j] * load[j] - hidden.step_at_nm;
                friction += 0.5 * hidden.step_nm * (1 + std::tanh(past_step_nm / 3));
            }
            double sum = tau[j] + kRatio * kRatio * 3e-4 * a[j] + dir[j] * friction;
            if (here) {
                sum += 0.5 * hidden.presliding_nm * (z[j] - dir[j]) + hidden.inertia_kgm2 * a[j]
                       + hidden.spring * (q[j] - hidden.spring_rest)
                       + (hidden.line_directed ? dir[j] : 1.0) * hidden.line_nm
                             * std::sin(hidden.line_order * q[j] + hidden.line_phase);
                sum += (hidden.ripple_per_nm * std::fabs(load[j]) + hidden.ripple_per_radps * std::fabs(v[j]))
                           * std::sin(50 * q[j] + hidden.line_phase)
                       + kG * hidden.moment_kgm * std::cos(q[0]) + hidden.constant_nm
                       + hidden.other_kgm2 * a[1 - j]
                       + hidden.hum_nm * std::sin(6.283185307 * hidden.hum_hz * t / kRate_hz + hum_phase)
                       + (now ? hidden.push_nm : 0);
                sum /= 1 + hidden.gain;
                sum += std::copysign(hidden.missing * std::max(0.0, std::fabs(sum) - hidden.knee_nm), sum);
            }
            const double white = noise.white * (uniform(rng) < noise.fat ? 3 : 1);
            tau_all[j].push_back(sum + colour[j] + white * gauss(rng));
            run.joint[static_cast<std::size_t>(j)].q_rad.push_back(std::round(q[j] / 7.67e-6) * 7.67e-6);
        }
    }
    const int late = static_cast<int>(std::lround(noise.delay_s * kRate_hz));
    for (int j = 0; j < 2; ++j)
        for (int t = 0; t < rows; ++t) {
            const double x = tau_all[j][static_cast<std::size_t>(std::max(0, t - late))];
            run.joint[static_cast<std::size_t>(j)].tau_nm.push_back(std::round(x / 0.05) * 0.05);
        }
    return run;
}

inline std::vector<hdt::Run> make_runs(const Hidden &hidden, const Noise &noise, unsigned long seed,
                                       int count)
{
    std::vector<hdt::Run> runs;
    for (int i = 0; i < count; ++i)
        runs.push_back(make_run(hidden, noise, 1000 * seed + static_cast<unsigned long>(i)));
    return runs;
}

} // namespace planar

#endif
