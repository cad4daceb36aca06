// SPDX-License-Identifier: Apache-2.0
//
// Hidden effects by name: what each does to plant and servo, with sign and size, and what is refused.
// Method: one tiny step from the same state with and without it; closed forms; a short run in the servo.
//
// Owns: one expectation for every name of rig::effect_names(); a new effect without one fails.
// Never: compares with a recorded run.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "model/arm_file.hpp"
#include "sim/plant_parts.h"
#include "tools/hdt_effects.hpp"
#include "tools/hdt_rig.hpp"
#include "tests/check_main.h"

using namespace hdt;

namespace {

constexpr double pi = 3.14159265358979323846, g = 9.81, ratio = 50;
constexpr double count_rad = 2 * pi / (16384 * ratio); // output side
using Pose = std::array<double, PLANT_JOINTS_MAX>;

const hdt_arm &pa10()
{
    static const hdt_arm arm = rig::load_arm("model/arms/pa10.toml");
    return arm;
}

// The PA-10, every run alike, its gears without error of their own.
plant_model bare()
{
    static const plant_model made = rig::plant_from_arm(pa10(), 0);
    plant_model m = made;
    for (int i = 0; i < m.joints; i++) {
        m.joint[i].run_coulomb_sigma_nm = m.joint[i].wander_sigma_nm = m.joint[i].torque_noise_m_nm = 0;
        m.joint[i].errors = 0;
    }
    return m;
}

// Its first joint alone: axis upright, nothing to carry.
plant_model single()
{
    plant_model m = bare();
    m.joints = 1;
    m.joint[0].lines = 0;
    return m;
}

plant_model with(plant_model m, const std::string &text)
{
    rig::hide(m, pa10(), rig::parse_effect(text));
    return m;
}

// Torque joint 2's motor needs at rest in a pose with this shoulder angle.
double hold_nm(const plant_model &m, double q2_rad, uint64_t seed = 1)
{
    plant_state s;
    plant_reset(&m, &s, Pose{0, q2_rad}.data(), seed);
    return s.gear_nm[1];
}

// What the effect adds to it.
double held_nm(const std::string &text, double q2_rad)
{
    return hold_nm(with(bare(), text), q2_rad) - hold_nm(bare(), q2_rad);
}

void near(double found, double expected, double within)
{
    ck_assert_double_eq_tol(found, expected, within);
}

// A joint (0-based) at an angle, rotor and link at one speed, motor torque, seed.
struct Probe { int joint; double q_rad, w_radps, tau_m_nm; uint64_t seed; };

plant_state state_of(const plant_model &m, const Probe &p)
{
    plant_state s;
    Pose q{};
    q[static_cast<std::size_t>(p.joint)] = p.q_rad;
    plant_reset(&m, &s, q.data(), p.seed);
    s.qd_radps[p.joint] = p.w_radps;
    s.thd_m_radps[p.joint] = p.w_radps * ratio;
    return s;
}

// Sum of torques on the rotor, friction included: what it gains in a microsecond.
double on_rotor_nm(const plant_model &m, plant_state s, const Probe &p)
{
    double tau[PLANT_JOINTS_MAX] = {};
    tau[p.joint] = p.tau_m_nm;
    plant_step(&m, &s, tau, 1e-6);
    return (s.thd_m_radps[p.joint] / ratio - p.w_radps) * plant_rotor_kgm2(&m.joint[p.joint]) / 1e-6;
}

// What the effect adds to it, from the same state.
double added_nm(const plant_model &m, const std::string &text, const Probe &p)
{
    const plant_state s = state_of(m, p);
    return on_rotor_nm(with(m, text), s, p) - on_rotor_nm(m, s, p);
}

// What the brake must hold, motor torque included: on a rotor that cannot move.
double on_brake_nm(const plant_model &m, const Probe &p, double after_s = 1e-6)
{
    plant_state s = state_of(m, p);
    double tau[PLANT_JOINTS_MAX] = {};
    tau[p.joint] = p.tau_m_nm;
    s.locked = 0x7f;
    for (double t = 0; t < after_s - 1e-9; t += 0.01)
        plant_step(&m, &s, tau, std::min(after_s, 0.01));
    return s.friction_nm[p.joint];
}

double braked_nm(const std::string &text, const Probe &p, double after_s = 1e-6)
{
    return on_brake_nm(with(bare(), text), p, after_s) - on_brake_nm(bare(), p, after_s);
}

double rotor_rad(const Probe &p)
{
    return state_of(bare(), p).th_m_rad[p.joint] / ratio;
}

// The single joint turned at an unshakable speed: friction along the motion and travel, sample by sample.
struct Flywheel {
    plant_model m;
    plant_state s;

    explicit Flywheel(const std::string &text, double load_nm = 0) : m(single())
    {
        if (!text.empty())
            m = with(m, text);
        m.joint[0].fx_inertia_kgm2 = 1e9;
        m.joint[0].fx_contact_nm += load_nm;
        plant_reset(&m, &s, Pose{}.data(), 1);
    }
    // Friction along the motion after this travel.
    double turn(double w_radps, double travel_rad)
    {
        s.thd_m_radps[0] = w_radps * ratio;
        const long steps = std::max(1L, std::lround(std::fabs(travel_rad / w_radps) * 1e4));
        const double none[PLANT_JOINTS_MAX] = {};
        for (long k = 0; k < steps; k++)
            plant_step(&m, &s, none, std::fabs(travel_rad / w_radps) / static_cast<double>(steps));
        return s.friction_nm[0] * (w_radps < 0 ? -1 : 1);
    }
    void stand(double span_s)
    {
        const double none[PLANT_JOINTS_MAX] = {};
        s.locked = 1;
        plant_step(&m, &s, none, span_s);
        s.locked = 0;
    }
};

// ---- in the servo ----

struct Sample {
    double q_rad[7], th_m_rad[7];
    int32_t count[7];
    int16_t torque_dig[7];
};

constexpr double tick_s = 1.0 / SERVO_RATE_HZ;

// Turns, stands from 0.5 to 0.7 s, turns again.
double speed_at(double t_s)
{
    return t_s > 0.5 && t_s < 0.7 ? 0 : 0.4 * std::sin(2 * pi * 2 * (t_s < 0.5 ? t_s : t_s - 0.7));
}

void send(servo &v, uint8_t type, double speed_radps)
{
    drv_command c = {};
    hdt_frame in, out;
    c.seq = 1;
    c.type = type;
    for (auto &axis : c.axis) {
        axis.mode = DRV_AXIS_SERVO;
        axis.speed_dig = static_cast<int16_t>(std::lround(speed_radps / SERVO_SPEED_RADPS_PER_DIG));
    }
    drv_command_encode(DRV_FORMAT_A, &c, &in);
    ck_assert_int_eq(servo_answer(&v, &in, &out), 1);
}

// Velocity mode from one pose, every joint at the same speed; started: else braked all the time.
std::vector<Sample> in_servo(const plant_model &m, double span_s, const std::function<double(double)> &speed,
                             bool started = true)
{
    static servo v;
    const Pose start = {0, 0.3, 0, 0.8, 0, 0.5, 0};
    servo_init(&v, &m, nullptr, start.data(), 1);
    if (started)
        send(v, DRV_START, 0);
    std::vector<Sample> samples;
    while (v.s.t_s < span_s) {
        if (started)
            send(v, DRV_CYCLIC, speed(v.s.t_s));
        servo_tick(&v);
        Sample s = {};
        std::copy_n(v.plant.q_rad, 7, s.q_rad);
        std::copy_n(v.plant.th_m_rad, 7, s.th_m_rad);
        std::copy_n(v.s.last_count, 7, s.count);
        std::copy_n(v.s.torque_dig, 7, s.torque_dig);
        samples.push_back(s);
    }
    ck_assert(!started || v.s.mode == SERVO_CONTROL);
    return samples;
}

double none_at(double) { return 0; }
double steady_speed(double) { return 0.4; }

// First tick at which two runs differ; their length if they do not.
std::size_t first_difference(const std::vector<Sample> &a, const std::vector<Sample> &b)
{
    ck_assert_uint_eq(a.size(), b.size());
    std::size_t k = 0;
    while (k < a.size() && std::memcmp(&a[k], &b[k], sizeof a[k]) == 0)
        k++;
    return k;
}

// ---- what each effect must do ----

const plant_joint &s2()
{
    static const plant_model m = bare();
    return m.joint[1];
}

void payload()
{
    // joint 2 to the flange 0.45 + 0.5 + 0.08 m, the body 0.05 m on; leaning forward pulls forward
    for (double q : {-1.2, 0.4, 1.5})
        near(held_nm("payload=1.5", q), -1.5 * g * 1.08 * std::sin(q), 1e-9);
    near(held_nm("payload=2:com=0.2", 1), -2 * g * 1.23 * std::sin(1.0), 1e-9);
}

void link_mass()
{
    const double upper = 8.41 * 0.06325, fore = 4.31 * (0.45 + 0.04609);
    near(held_nm("link_mass=0.2", 1), -0.2 * upper * g * std::sin(1.0), 1e-6);
    near(held_nm("link_mass=0.1@4", 1), -0.1 * fore * g * std::sin(1.0), 1e-6);
}

void coupling()
{
    plant_matrix mass[2];
    const plant_model m[2] = {bare(), with(bare(), "coupling=0.3")};
    for (int k = 0; k < 2; k++) {
        plant_chain chain;
        double bias[PLANT_JOINTS_MAX];
        const Pose q = {0.1, 0.7, 0.2, 0.4, 0.3, 0.2, 0.1}, still = {};
        plant_chain_prepare(&m[k], &chain);
        plant_chain_terms(&chain, q.data(), still.data(), mass[k], bias);
    }
    for (int i = 0; i < 7; i++) // the same about every axis: joints 1 and 2 feel it, which are square
        for (int k = 0; k < 7; k++)
            near(mass[1][i * PLANT_JOINTS_MAX + k] - mass[0][i * PLANT_JOINTS_MAX + k],
                 i == k && i < 2 ? 0.3 : 0, 1e-12);
}

void base_tilt()
{
    const double weight = hold_nm(bare(), pi / 2); // stretched out forward, negative
    ck_assert_double_lt(weight, -75);
    for (double tilt : {5.0, 30.0, 90.0}) // forward: upright is then leaning
        near(hold_nm(with(bare(), "base_tilt=" + std::to_string(tilt)), 0),
             weight * std::sin(tilt * pi / 180), 1e-9);
    near(hold_nm(with(bare(), "base_tilt=90"), -pi / 2), 0, 1e-9); // on the wall, arm pointing up along it
    for (double q2 : {-1.0, 0.5}) // about x: gravity lies along joint 2's axis
        near(hold_nm(with(bare(), "base_tilt=90:about=0"), q2), 0, 1e-9);
    const plant_model wall = with(bare(), "base_tilt=90");
    near(wall.gravity_mps2[0], g, 1e-12);
    near(wall.gravity_mps2[1], 0, 1e-12);
    near(wall.gravity_mps2[2], 0, 1e-12);
}

void joint_offset()
{
    const auto a = in_servo(bare(), 0.01, none_at, false),
               b = in_servo(with(bare(), "joint_offset=0.02"), 0.01, none_at, false);
    near(b.back().count[1] - a.back().count[1], 0.02 / count_rad, 1);
    ck_assert_int_eq(b.back().count[2], a.back().count[2]);
}

void lost_counts()
{
    const auto a = in_servo(bare(), 0.3, none_at, false),
               b = in_servo(with(bare(), "lost_counts=50:from=0.2"), 0.3, none_at, false);
    for (std::size_t k = 0; k < a.size(); k++) // sample k is of the tick that began at k
        ck_assert_int_eq(b[k].count[1] - a[k].count[1], static_cast<double>(k) * tick_s < 0.2 ? 0 : 50);
}

void eccentricity()
{
    const plant_model m = with(bare(), "eccentricity=0.004:order=9,phase=0.5");
    double most = 0, least = 0;
    for (const Sample &s : in_servo(m, 0.4, steady_speed)) {
        const double th = s.th_m_rad[1] / ratio, ahead = s.count[1] * count_rad - th;
        near(ahead, 0.004 * std::sin(9 * th + 0.5), 1.01 * count_rad);
        most = std::max(most, ahead);
        least = std::min(least, ahead);
    }
    ck_assert_double_gt(most - least, 0.002);
}

void cable_spring()
{
    near(held_nm("cable_spring=8:rest=0.2", 1), 8 * 0.8, 1e-9);
    near(held_nm("cable_spring=8:rest=0.2", -1), 8 * -1.2, 1e-9);
}

// Reported torque of the first joint, mean over [from, to), N.m output side.
double mean_nm(const std::vector<Sample> &run, double from_s, double to_s)
{
    double sum = 0;
    long n = 0;
    for (std::size_t k = 0; k < run.size(); k++) {
        const double t = static_cast<double>(k) * tick_s;
        if (t < from_s || t >= to_s)
            continue;
        sum += run[k].torque_dig[0] * SERVO_TORQUE_NM_PER_DIG * ratio;
        n++;
    }
    return sum / static_cast<double>(n);
}

// In the servo, joint 1 at a steady speed: what an effect from 0.8 to 1.2 s adds to the torque reported.
void steady_adds(const std::string &text, double expected_nm, double within_nm)
{
    plant_model m = bare();
    m.joint[0].lines = 0;
    const auto run = in_servo(with(m, text + "@1:from=0.8,to=1.2"), 1.6, [](double) { return 0.15; });
    const double before = mean_nm(run, 0.6, 0.8);
    near(mean_nm(run, 1, 1.2) - before, expected_nm, within_nm);
    near(mean_nm(run, 1.4, 1.6) - before, 0, within_nm);
}

void contact()
{
    near(held_nm("contact=6:from=0", 0.5), 6, 1e-9);
    steady_adds("contact=6", 6, 0.4);
}

void torque_gain()
{
    for (double tau : {-2.0, 0.5, 3.0})
        near(braked_nm("torque_gain=0.07", {1, 0.3, 0, tau, 1}), 0.07 * ratio * tau, 1e-9);
}

void torque_gain_drift()
{
    near(braked_nm("torque_gain_drift=0.1:time=2", {1, 0.3, 0, 3, 1}), 0, 1e-3);
    near(braked_nm("torque_gain_drift=0.1:time=2", {1, 0.3, 0, 3, 1}, 1),
         0.1 * (1 - std::exp(-0.5)) * ratio * 3, 0.1);
}

void torque_saturation()
{
    const double most = s2().tau_max_m_nm, knee = 0.3 * most;
    for (double tau : {0.29 * most, -0.29 * most})
        near(braked_nm("torque_saturation=0.2", {1, 0.3, 0, tau, 1}), 0, 1e-12);
    for (double sign : {-1.0, 1.0})
        near(braked_nm("torque_saturation=0.2", {1, 0.3, 0, sign * 0.8 * most, 1}),
             -sign * 0.2 * (0.8 * most - knee) * ratio, 1e-9);
}

void torque_offset()
{
    for (double tau : {-1.0, 0.0, 2.0}) // the motor gives less than is reported: held, more is asked for
        near(braked_nm("torque_offset=2", {1, 0.3, 0, tau, 1}), -2, 1e-9);
    steady_adds("torque_offset=5", 5, 0.4);
}

void torque_delay()
{
    const auto a = in_servo(bare(), 0.5, speed_at),
               b = in_servo(with(bare(), "torque_delay=0.01"), 0.5, speed_at);
    const std::size_t late = 15; // ticks of 0.66 ms
    int changes = 0;
    for (std::size_t k = late; k < a.size(); k++) {
        ck_assert_int_eq(b[k].torque_dig[1], a[k - late].torque_dig[1]);
        ck_assert_double_eq(b[k].th_m_rad[1], a[k].th_m_rad[1]); // nobody listens: the motion is the same
        changes += a[k].torque_dig[1] != a[k - 1].torque_dig[1];
    }
    ck_assert_int_gt(changes, 100);
}

void dead_time()
{
    const std::string text = "dead_time=2:width=10";
    for (double sign : {-1.0, 1.0}) {
        near(braked_nm(text, {1, 0.3, 0, sign * 1 / ratio, 1}), -sign * 1, 1e-9); // all of it
        near(braked_nm(text, {1, 0.3, 0, sign * 10 / ratio, 1}), -sign * 2 * std::exp(-1), 1e-9);
        near(braked_nm(text, {1, 0.3, 0, sign * 150 / ratio, 1}), 0, 1e-5);
    }
}

void current_ripple()
{
    for (double q : {0.1, 0.103, 0.107, 0.112}) {
        const Probe p = {1, q, 0, 2, 1};
        near(braked_nm("current_ripple=0.02", p),
             0.02 * std::sin(8 * ratio * rotor_rad(p)) * ratio * 2, 1e-6);
    }
}

// A conservative line at rest: the rotor is pushed back by amplitude sin(order th + phase).
void line_is(const std::string &text, double amplitude_nm, double order_rev, double phase_rad)
{
    double span = 0;
    for (int k = 0; k < 12; k++) {
        const Probe p = {1, 0.2 + k * 2 * pi / 12 / order_rev, 0, 0, 1};
        const double expected = -amplitude_nm * std::sin(order_rev * rotor_rad(p) + phase_rad);
        near(braked_nm(text, p), expected, 1e-6 * amplitude_nm);
        span = std::max(span, std::fabs(expected));
    }
    ck_assert_double_gt(span, 0.8 * amplitude_nm);
}

void cogging() { line_is("cogging=2", 2, 24 * ratio, 0.7); }

void order_line()
{
    line_is("order_line=4", 4, 37, 0.7);
    line_is("order_line=4:order=12,phase=-1", 4, 12, -1);
    for (double w : {-0.2, 0.2}) { // directed: friction, against the motion
        const Probe p = {1, 0.9, w, 0, 1};
        const double loaded = std::min(1.0, std::fabs(state_of(bare(), p).wave_nm[1]) / s2().soft_nm);
        ck_assert_double_eq(loaded, 1);
        near(added_nm(bare(), "order_line=4:directed=1", p),
             (w < 0 ? 1 : -1) * 4 * std::sin(37 * rotor_rad(p) + 0.7), 0.02);
    }
}

void cage_slip()
{
    double found[2];
    for (int other = 0; other < 2; other++) {
        const Probe p = {1, 0.4, 0, 0, other ? 2u : 1u};
        const double phase = state_of(bare(), p).phase_rad[1];
        found[other] = braked_nm("cage_slip=2", p);
        near(found[other], -2 * std::sin(21.37 * rotor_rad(p) + phase), 1e-6);
    }
    ck_assert_double_gt(std::fabs(found[0] - found[1]), 0.01);
    near(braked_nm("order_line=2", {1, 0.4, 0, 0, 1}), braked_nm("order_line=2", {1, 0.4, 0, 0, 2}), 1e-9);
}

void ripple_load()
{
    for (double q : {0.2, 0.7, 1.2}) {
        const Probe p = {1, q, 0, 0, 1};
        near(braked_nm("ripple_load=0.1", p),
             -0.1 * std::fabs(hold_nm(bare(), q)) * std::sin(100 * rotor_rad(p) + 0.7), 1e-4);
    }
}

void ripple_speed()
{
    for (double w : {-0.3, 0.1, 0.3}) {
        const Probe p = {1, 0.7, w, 0, 1};
        near(added_nm(bare(), "ripple_speed=5", p),
             -5 * std::fabs(w) * std::sin(100 * rotor_rad(p) + 0.7), 0.01);
    }
}

// Friction that an effect adds along the motion of joint 2 at a shoulder angle.
double rubs_nm(const std::string &text, double q_rad, double w_radps)
{
    return added_nm(bare(), text, {1, q_rad, w_radps, 0, 1}) * (w_radps < 0 ? 1 : -1);
}

void load_friction()
{
    for (double q : {-1.0, 0.3, 1.0})
        for (double w : {-0.2, 0.2})
            near(rubs_nm("load_friction=0.05", q, w), 0.05 * std::fabs(hold_nm(bare(), q)), 0.01);
}

void drive_efficiency()
{
    const double load = hold_nm(bare(), 1); // negative: held back
    near(rubs_nm("drive_efficiency=0.05", 1, -0.2), 0.05 * std::fabs(load), 0.01);
    near(rubs_nm("drive_efficiency=0.05", 1, 0.2), 0, 1e-6);
    near(rubs_nm("drive_efficiency=0.05", -1, 0.2), 0.05 * std::fabs(load), 0.01);
}

void viscous_nonlinear()
{
    for (double w : {-0.5, 0.1, 0.5})
        near(rubs_nm("viscous_nonlinear=8", 0.5, w), 8 * w * w, 1e-3);
    near(rubs_nm("viscous_nonlinear=-8", 0.5, 0.5), -8 * 0.25, 1e-3);
}

void stribeck_shape()
{
    for (double w : {-0.03, 0.01, 0.1})
        near(rubs_nm("stribeck_shape=3:speed=0.03", 0.5, w), 3 * std::exp(-std::fabs(w) / 0.03), 2e-3);
}

void temperature()
{
    const plant_friction &f = s2().friction[0];
    const double dry = 0.2 * (f.f0_nm + s2().mesh.drive_nm);
    near(rubs_nm("temperature=0.2", 0.5, 0.3), dry + 0.4 * f.fv_nmspr * 0.3, 0.01);
    near(rubs_nm("temperature=0.2:viscous=0", 0.5, 0.3), dry, 0.01);
    // 5 s of a thermal time of 5 s: a share 1/e is left
    Flywheel cold("temperature=0.2@1:time=5"), warm("");
    const double left = cold.turn(0.1, 0.5) - warm.turn(0.1, 0.5);
    const plant_joint &j = warm.m.joint[0];
    const double first = 0.2 * (j.friction[0].f0_nm + j.mesh.drive_nm) + 0.4 * j.friction[0].fv_nmspr * 0.1;
    near(left, std::exp(-1) * first, 0.02);
}

void presliding()
{
    Flywheel slow("presliding=6@1:travel=0.02"), plain("");
    for (Flywheel *f : {&slow, &plain})
        f->turn(-0.1, 0.4);
    double travel = 0;
    for (int k = 0; k < 8; k++) {
        travel += 0.005;
        const double missing = plain.turn(0.1, 0.005) - slow.turn(0.1, 0.005);
        near(missing, 6 * std::exp(-travel / 0.02), 0.03);
    }
    Flywheel ended("presliding=6@1:to=1"), whole(""); // in mid-travel: nothing of it stays
    for (Flywheel *f : {&ended, &whole}) {
        f->turn(-0.02, 0.019);
        f->turn(-0.02, 0.002);
    }
    near(ended.turn(0.1, 0.001), whole.turn(0.1, 0.001), 1e-6);
}

void dwell_stiction()
{
    for (double stand_s : {0.9, 9.0, 99.0})
        for (double travel : {1e-5, 0.01}) {
            Flywheel sticky("dwell_stiction=3@1"), plain("");
            sticky.stand(stand_s);
            plain.stand(stand_s);
            near(sticky.turn(0.1, travel) - plain.turn(0.1, travel),
                 3 * std::log10(1 + stand_s) * std::exp(-travel / 0.01), 0.03);
        }
}

void local_friction()
{
    const std::string text = "local_friction=4:at=0.5,width=0.05";
    for (double q : {0.4, 0.45, 0.5, 0.55, 0.8}) {
        const double off = (rotor_rad({1, q, 0, 0, 1}) - 0.5) / 0.05;
        near(rubs_nm(text, q, 0.2), 4 * std::exp(-off * off), 0.01);
        near(rubs_nm(text, q, -0.2), 4 * std::exp(-off * off), 0.01);
    }
    near(rubs_nm(text, 0.8, 0.2), 0, 1e-6);
}

void brake_drag()
{
    for (double w : {-0.3, -0.01, 0.02, 0.3})
        near(rubs_nm("brake_drag=3", 0.5, w), 3, 2e-3);
    steady_adds("brake_drag=5", 5, 0.4);
}

void inertia()
{
    const double j = plant_rotor_kgm2(&s2()); // the same torque: less speed gained
    const Probe p = {1, 0.4, 0.2, 2, 1};
    const plant_state s = state_of(bare(), p);
    near(on_rotor_nm(with(bare(), "inertia=0.3"), s, p), on_rotor_nm(bare(), s, p), 0.01);
    plant_state light = s, heavy = s;
    const plant_model more = with(bare(), "inertia=0.3"), m = bare();
    double tau[PLANT_JOINTS_MAX] = {0, 2};
    plant_step(&m, &light, tau, 1e-6);
    plant_step(&more, &heavy, tau, 1e-6);
    const double gained = light.thd_m_radps[1] - s.thd_m_radps[1];
    near((heavy.thd_m_radps[1] - s.thd_m_radps[1]) / gained, j / (j + 0.3), 1e-3);
}

void external_vibration()
{
    const plant_model m = single(), shaken = with(single(), "external_vibration=3@1");
    plant_matrix mass;
    plant_chain chain;
    double bias[PLANT_JOINTS_MAX];
    const Pose q = {};
    plant_chain_prepare(&m, &chain);
    plant_chain_terms(&chain, q.data(), q.data(), mass, bias);
    for (double t : {0.0, 0.02, 0.05, 0.1}) {
        plant_state a = state_of(m, {0, 0, 0, 0, 1});
        a.t_s = t;
        plant_state b = a;
        const double none[PLANT_JOINTS_MAX] = {};
        plant_step(&m, &a, none, 1e-6);
        plant_step(&shaken, &b, none, 1e-6);
        near((b.qd_radps[0] - a.qd_radps[0]) * mass[0] / 1e-6,
             3 * std::sin(2 * pi * 7.3 * t + a.phase_rad[0]), 1e-3);
    }
}

void soft_windup()
{
    for (double w : {-0.02, 0.02}) {
        const double along = w < 0 ? -1 : 1;
        Flywheel drives("soft_windup=4@1", along * 20), plain("", along * 20);
        Flywheel driven("soft_windup=4@1", along * -60), light("", along * -60);
        for (Flywheel *f : {&drives, &plain, &driven, &light})
            f->turn(w, 0.02);
        near(along * (drives.s.wave_nm[0] - plain.s.wave_nm[0]), 4, 0.01);
        near(driven.s.wave_nm[0] - light.s.wave_nm[0], 0, 0.01);
    }
}

void gear_stiffness()
{
    const Probe p = {1, 1, 0, 0, 1};
    const plant_state stiff = state_of(with(bare(), "gear_stiffness=0.25"), p), soft = state_of(bare(), p);
    near(stiff.mesh_rad[1] - stiff.q_rad[1], (soft.mesh_rad[1] - soft.q_rad[1]) / 1.25, 1e-12);
    ck_assert_double_gt(std::fabs(soft.mesh_rad[1] - soft.q_rad[1]), 5e-4);
    near(stiff.gear_nm[1], soft.gear_nm[1], 1e-9);
}

void kinematic_error()
{
    for (double q : {0.1, 0.12, 0.15}) { // the link is ahead, so the rotor may be behind
        const plant_model m = with(bare(), "kinematic_error=1e-4:phase=0.3");
        const double th = state_of(m, {1, q, 0, 0, 1}).th_m_rad[1] / ratio;
        const double plain = rotor_rad({1, q, 0, 0, 1});
        near(th, plain - 1e-4 * std::sin(2 * ratio * th + 0.3), 1e-9);
    }
}

// Spread of a number over runs that differ by their seed.
double sigma_over_runs(const plant_model &m, double (*of)(const plant_state &), int runs)
{
    double sum = 0, square = 0;
    for (int seed = 1; seed <= runs; seed++) {
        plant_state s;
        plant_reset(&m, &s, Pose{}.data(), static_cast<uint64_t>(seed));
        sum += of(s);
        square += of(s) * of(s);
    }
    return std::sqrt(square / runs - (sum / runs) * (sum / runs));
}

void run_scatter()
{
    const auto number = [](const plant_state &s) { return s.run_coulomb_nm[1]; };
    near(sigma_over_runs(with(bare(), "run_scatter=1.5"), number, 800), 1.5, 4 * 1.5 / std::sqrt(1600));
    const plant_model m = with(bare(), "run_scatter=1.5");
    const Probe p = {1, 0.5, 0.2, 0, 5};
    const plant_state s = state_of(m, p);
    plant_state calm = s;
    calm.run_coulomb_nm[1] = 0;
    near(on_rotor_nm(m, calm, p) - on_rotor_nm(m, s, p), s.run_coulomb_nm[1], 1e-3); // a friction
}

void wander()
{
    const auto number = [](const plant_state &s) { return s.wander_nm[1]; };
    near(sigma_over_runs(with(bare(), "wander=0.5:time=2"), number, 800), 0.5, 4 * 0.5 / std::sqrt(1600));
    const plant_model m = with(single(), "wander=0.5@1:time=2");
    double product = 0, square = 0; // after its time a share 1/e is remembered
    for (uint64_t seed = 1; seed <= 400; seed++) {
        plant_state s = state_of(m, {0, 0, 0, 0, seed});
        const double none[PLANT_JOINTS_MAX] = {}, before = s.wander_nm[0];
        plant_step(&m, &s, none, 2e-2);
        product += before * s.wander_nm[0];
        square += before * before;
    }
    near(product / square, std::exp(-0.01), 4 * std::sqrt(1 - std::exp(-0.02)) / 20);
    ck_assert_double_lt(product / square, 1);
}

void stale_samples()
{
    const auto stale_share = [](const plant_model &m) {
        const auto run = in_servo(m, 1, steady_speed); // some 70 counts a tick
        int same = 0, n = 0;
        for (std::size_t k = run.size() / 4; k < run.size(); k++, n++)
            same += run[k].count[1] == run[k - 1].count[1];
        return static_cast<double>(same) / n;
    };
    ck_assert_double_eq(stale_share(bare()), 0);
    near(stale_share(with(bare(), "stale_samples=0.1")), 0.1, 4 * std::sqrt(0.09 / 1128));
}

struct Expectation { const char *size, *options; void (*check)(); };

const std::map<std::string, Expectation> &expectations()
{
    static const std::map<std::string, Expectation> all = {
        {"payload", {"1.5", "", payload}},
        {"link_mass", {"0.2", "", link_mass}},
        {"coupling", {"0.3", "", coupling}},
        {"base_tilt", {"5", "", base_tilt}},
        {"joint_offset", {"0.02", "", joint_offset}},
        {"lost_counts", {"50", "", lost_counts}},
        {"eccentricity", {"0.004", "", eccentricity}},
        {"cable_spring", {"8", "", cable_spring}},
        {"contact", {"6", "", contact}},
        {"torque_gain", {"0.07", "", torque_gain}},
        {"torque_gain_drift", {"0.1", "", torque_gain_drift}},
        {"torque_saturation", {"0.2", ",knee=0.05", torque_saturation}},
        {"torque_offset", {"2", "", torque_offset}},
        {"torque_delay", {"0.01", "", torque_delay}},
        {"dead_time", {"2", "", dead_time}},
        {"current_ripple", {"0.02", "", current_ripple}},
        {"cogging", {"2", "", cogging}},
        {"load_friction", {"0.05", "", load_friction}},
        {"drive_efficiency", {"0.05", "", drive_efficiency}},
        {"viscous_nonlinear", {"8", "", viscous_nonlinear}},
        {"stribeck_shape", {"3", "", stribeck_shape}},
        {"temperature", {"0.2", "", temperature}},
        {"presliding", {"6", "", presliding}},
        {"dwell_stiction", {"3", "", dwell_stiction}},
        {"local_friction", {"4", "", local_friction}},
        {"brake_drag", {"3", "", brake_drag}},
        {"order_line", {"4", "", order_line}},
        {"ripple_load", {"0.1", "", ripple_load}},
        {"ripple_speed", {"5", "", ripple_speed}},
        {"cage_slip", {"2", "", cage_slip}},
        {"inertia", {"0.3", "", inertia}},
        {"external_vibration", {"3", "", external_vibration}},
        {"soft_windup", {"4", "", soft_windup}},
        {"gear_stiffness", {"0.2", "", gear_stiffness}},
        {"kinematic_error", {"1e-4", "", kinematic_error}},
        {"run_scatter", {"1.5", "", run_scatter}},
        {"wander", {"0.5", "", wander}},
        {"stale_samples", {"0.1", "", stale_samples}},
    };
    return all;
}

START_TEST(test_effect_does_what_its_name_says)
{
    const std::string name = rig::effect_names().at(static_cast<std::size_t>(_i));
    const auto found = expectations().find(name);
    ck_assert_msg(found != expectations().end(), "effect %s has no expectation here", name.c_str());
    found->second.check();
}
END_TEST

// With what every healthy run has: noise, scatter, wander of the seed.
std::vector<Sample> run_with(const std::string &text)
{
    plant_model m = rig::plant_from_arm(pa10(), 0);
    if (!text.empty())
        rig::hide(m, pa10(), rig::parse_effect(text));
    return in_servo(m, 1.0, speed_at);
}

START_TEST(test_effect_shows_and_only_from_its_time_on_and_none_of_it_is_none)
{
    const std::string name = rig::effect_names().at(static_cast<std::size_t>(_i));
    const Expectation &e = expectations().at(name);
    const auto plain = run_with("");
    const auto text = [&](const std::string &size, const std::string &when) {
        return name + "=" + size + ":" + when + e.options;
    };
    const std::size_t shown = first_difference(plain, run_with(text(e.size, "from=0")));
    ck_assert_msg(shown < plain.size() * 9 / 10, "%s does not show in a run", name.c_str());
    const double when = name == "run_scatter" ? 0 : 0.4; // drawn as a run begins
    const std::size_t from = first_difference(plain, run_with(text(e.size, "from=" + std::to_string(when))));
    ck_assert_uint_ge(from, static_cast<std::size_t>(std::ceil(when / tick_s)));
    ck_assert_msg(from < plain.size(), "%s from 0.4 s does not show", name.c_str());
    if (name == "payload")
        return; // of no mass: refused, below
    ck_assert_uint_eq(first_difference(plain, run_with(text("0", "from=0"))), plain.size());
    if (name != "lost_counts" && name != "contact") // those are always for a while
        ck_assert_uint_eq(first_difference(plain, run_with(name + "=0")), plain.size());
}
END_TEST

// What it says when it refuses; empty: it did not.
std::string refusal(const plant_model &m, const hdt_arm &arm, const std::string &text)
{
    plant_model copy = m;
    try {
        rig::hide(copy, arm, rig::parse_effect(text));
    } catch (const InputError &error) {
        return error.what();
    }
    return "";
}

START_TEST(test_what_makes_no_sense_is_refused_by_name)
{
    const std::vector<std::pair<std::string, std::string>> wrong = {
        {"nosuch=1", "\"nosuch\""},           {"payload", "payload: expected =SIZE in kg"},
        {"payload=abc", "payload: expected a number, found \"abc\""},
        {"payload=", "payload: expected a number"},
        {"payload=nan", "payload: expected a number"},
        {"payload=1e999", "payload: expected a number"},
        {"payload=1kg", "payload: expected a number"},
        {"contact=6@0", "contact: expected a joint from 1, found \"0\""},
        {"contact=6@2.5", "contact: expected a joint"},
        {"contact=6@-1", "contact: expected a joint"},
        {"contact=6@9", "contact: joint 9 of an arm with 7"},
        {"contact=6:hz=3", "contact: unknown option \"hz=3\""},
        {"contact=6:from", "contact: unknown option \"from\""},
        {"contact=6:from=x", "contact:from: expected a number"},
        {"contact=6:", "contact: unknown option"},
        {"contact=6:from=3,to=2", "contact: the plant cannot take it: change"},
        {"payload=0", "payload: expected a mass above 0"},
        {"payload=-1", "payload: expected a mass above 0"},
        {"torque_delay=0.05", "torque_delay: the plant cannot take it: fx_report_delay_s"},
        {"torque_delay=-0.01", "torque_delay: the plant cannot take it"},
        {"stale_samples=1", "stale_samples: the plant cannot take it: fx_stale_share"},
        {"torque_gain=-1", "torque_gain: the plant cannot take it: fx_torque_gain"},
        {"torque_saturation=1.1", "torque_saturation: the plant cannot take it: fx_knee_share"},
        {"dead_time=1:width=0", "dead_time: the plant cannot take it: fx_dead_width"},
        {"stribeck_shape=1:speed=0", "stribeck_shape: the plant cannot take it: fx_slow_radps"},
        {"local_friction=1:width=0", "local_friction: the plant cannot take it: fx_local_width"},
        {"dwell_stiction=1:travel=0", "dwell_stiction: the plant cannot take it: fx_dwell_rad"},
        {"presliding=1:travel=0", "presliding: the plant cannot take it: fx_presliding_rad"},
        {"presliding=1000", "presliding: the plant cannot take it: fx_presliding_nm"},
        {"temperature=-2", "temperature: the plant cannot take it: fx_cold"},
        {"temperature=0.1:time=0", "temperature: the plant cannot take it: fx_warm_s"},
        {"order_line=1:order=0", "order_line: the plant cannot take it: line"},
        {"kinematic_error=0.1", "kinematic_error: the plant cannot take it: error"},
        {"soft_windup=100", "soft_windup: the plant cannot take it: mesh"},
        {"inertia=-100", "inertia: the plant cannot take it: fx_inertia"},
        {"brake_drag=-1", "brake_drag: the plant cannot take it"},
        {"gear_stiffness=-1", "gear_stiffness: the plant cannot take it: k_nmprad"},
        {"link_mass=-1.1", "link_mass: the plant cannot take it"},
    };
    for (const auto &[text, words] : wrong) {
        const std::string said = refusal(bare(), pa10(), text);
        ck_assert_msg(said.find(words) != std::string::npos, "%s: expected \"%s\", found \"%s\"",
                      text.c_str(), words.c_str(), said.c_str());
    }
    for (const std::string &name : rig::effect_names()) // and says what there is
        ck_assert(refusal(bare(), pa10(), "nosuch=1").find("  " + name + " (") != std::string::npos);
}
END_TEST

START_TEST(test_more_than_there_is_room_for_is_refused)
{
    plant_model m = bare();
    m.joint[1].lines = PLANT_LINES_MAX;
    ck_assert(refusal(m, pa10(), "cogging=1").find("cogging: the plant takes at most") != std::string::npos);
    m.joint[1].errors = PLANT_ERRORS_MAX;
    ck_assert(refusal(m, pa10(), "kinematic_error=1e-5").find("kinematic_error: the plant takes")
              != std::string::npos);
    m.changes = PLANT_CHANGES_MAX;
    ck_assert(refusal(m, pa10(), "contact=1").find("contact: the plant takes at most") != std::string::npos);
    m = bare();
    m.joint[1].soft_nm = 0;
    m.joint[1].mesh = {};
    ck_assert(refusal(m, pa10(), "soft_windup=1").find("soft_windup: joint 2 of this arm has no [mesh]")
              != std::string::npos);
}
END_TEST

Suite *effects_suite()
{
    Suite *suite = suite_create("plant_effects");
    TCase *each = tcase_create("each"), *runs = tcase_create("runs"), *bad = tcase_create("refused");
    const int names = static_cast<int>(rig::effect_names().size());
    tcase_add_loop_test(each, test_effect_does_what_its_name_says, 0, names);
    tcase_add_loop_test(runs, test_effect_shows_and_only_from_its_time_on_and_none_of_it_is_none, 0, names);
    tcase_add_test(bad, test_what_makes_no_sense_is_refused_by_name);
    tcase_add_test(bad, test_more_than_there_is_room_for_is_refused);
    for (TCase *c : {each, runs, bad}) {
        tcase_set_timeout(c, 120);
        suite_add_tcase(suite, c);
    }
    return suite;
}

} // namespace

HDT_CHECK_MAIN(effects_suite())
