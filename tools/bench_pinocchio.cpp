// SPDX-License-Identifier: Apache-2.0
//
// The same arm in Pinocchio: what its gravity, and its gravity and inertia, cost a call, and
// whether the core's terms are those torques.
//
//   bench_pinocchio ARM                  time of a call, median; worst difference over random states
//   bench_pinocchio ARM gravity|inertia N
//                                        just N calls, for an instruction counter (tools/bench-core)
//
// Owns: the printed figures.  Never: is a test; is built without Pinocchio's headers.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <vector>

#include <pinocchio/algorithm/rnea.hpp>

#include "ctrl/hdt.h"
#include "model/hdt_arm.h"

namespace {

constexpr int kStates = 4096, kBatch = 8, kBatches = 20000;

struct State { Eigen::VectorXd q, v, a; };

pinocchio::Model model;
pinocchio::Data data;

// The arm of a model file, without flange and payload.
void build(const hdt_arm &arm)
{
    using Eigen::Map;
    model.gravity.linear() = Map<const Eigen::Vector3d>(arm.gravity_mps2);
    pinocchio::JointIndex last = 0;
    for (int j = 0; j < arm.joints; j++) {
        const hdt_arm_joint &k = arm.joint[j];
        const Eigen::Matrix3d turn = Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(k.rot);
        const pinocchio::SE3 from_last(turn, Map<const Eigen::Vector3d>(k.origin_m));
        last = model.addJoint(last, pinocchio::JointModelRZ(), from_last, "joint " + std::to_string(j + 1));
        const double *i = k.inertia_kgm2; // xx xy xz yy yz zz; theirs xx xy yy xz yz zz
        Eigen::Matrix<double, 10, 1> link;
        link << k.mass_kg, k.moment_kgm[0], k.moment_kgm[1], k.moment_kgm[2], i[0], i[1], i[3], i[2], i[4],
            i[5];
        model.appendBodyToJoint(last, pinocchio::Inertia::FromDynamicParameters(link));
    }
    data = pinocchio::Data(model);
}

std::vector<State> random_states(const hdt_arm &arm)
{
    std::mt19937 random(1);
    std::vector<State> states(kStates);
    const auto uniform = [&](double low, double high) {
        return std::uniform_real_distribution<>(low, high)(random);
    };
    for (State &s : states) {
        s = {Eigen::VectorXd(arm.joints), Eigen::VectorXd(arm.joints), Eigen::VectorXd(arm.joints)};
        for (int j = 0; j < arm.joints; j++) {
            s.q[j] = uniform(arm.joint[j].q_min_rad, arm.joint[j].q_max_rad);
            s.v[j] = uniform(-arm.joint[j].v_max_radps, arm.joint[j].v_max_radps);
            s.a[j] = uniform(-20, 20);
        }
    }
    return states;
}

[[noreturn]] void stop(const char *why)
{
    std::fprintf(stderr, "bench_pinocchio: %s\n", why);
    std::exit(3);
}

// Worst differences of the core's two terms from the library's torques, the rotor's part taken from the file.
void compare(const hdt_arm &arm, const std::vector<State> &states)
{
    static hdt_tables tables;
    static hdt_t core;
    char err[300];
    if (hdt_arm_tables(&arm, &tables, nullptr, err, sizeof err) != 0)
        stop(err);
    for (uint32_t j = 0; j < tables.joints; j++)
        tables.joint[j].terms = 1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_INERTIA;
    if (hdt_init(&core, &tables) != HDT_OK)
        stop("the tables are not accepted");
    double worst_gravity_nm = 0, worst_inertia_nm = 0;
    uint64_t t_us = 0;
    for (State s : states) {
        hdt_in in = {};
        hdt_out out;
        in.t_us = t_us += 1429;
        in.fresh = (1u << tables.joints) - 1u;
        for (int j = 0; j < arm.joints; j++) {
            const hdt_joint_tab &tab = tables.joint[j];
            const double rad_per_count = std::ldexp(tab.rad_per_count_q44, -44);
            const int turned = static_cast<int>(std::lrint(s.q[j] / rad_per_count));
            s.q[j] = turned * rad_per_count; // a whole count
            in.count[j].raw = tab.zero_cnt + tab.sign * turned;
            in.v_ref[j].raw = static_cast<int32_t>(std::lrint(std::ldexp(s.v[j], 24)));
            in.a_ref[j].raw = static_cast<int32_t>(std::lrint(std::ldexp(s.a[j], 16)));
        }
        if (hdt_step(&core, &in, &out) != HDT_OK)
            stop("the core refuses a state");
        const Eigen::VectorXd gravity = pinocchio::computeGeneralizedGravity(model, data, s.q);
        const Eigen::VectorXd whole = pinocchio::rnea(model, data, s.q, s.v, s.a);
        for (int j = 0; j < arm.joints; j++) {
            const double rotor = std::ldexp(tables.joint[j].rotor_q20, -20) * s.a[j];
            worst_gravity_nm = std::max(worst_gravity_nm,
                                        std::abs(std::ldexp(out.term[HDT_TERM_GRAVITY][j].raw, -16)
                                                 - gravity[j]));
            worst_inertia_nm = std::max(worst_inertia_nm,
                                        std::abs(std::ldexp(out.term[HDT_TERM_INERTIA][j].raw, -16) - rotor
                                                 - (whole - gravity)[j]));
        }
    }
    std::printf("pinocchio %s: the core's gravity differs by %.1e N m at most, its inertia by %.1e, over %d "
                "random states\n",
                PINOCCHIO_VERSION, worst_gravity_nm, worst_inertia_nm, kStates);
}

} // namespace

// what an instruction counter looks for
extern "C" {
__attribute__((noinline)) double library_gravity(const void *state)
{
    return pinocchio::computeGeneralizedGravity(model, data, static_cast<const State *>(state)->q)[0];
}

__attribute__((noinline)) double library_inertia(const void *state)
{
    const State &s = *static_cast<const State *>(state);
    return pinocchio::rnea(model, data, s.q, s.v, s.a)[0];
}
}

namespace {

double median_ns(double (*call)(const void *), const std::vector<State> &states)
{
    using clock = std::chrono::steady_clock;
    std::vector<double> ns(kBatches);
    volatile double sink = 0;
    std::size_t k = 0;
    for (double &batch : ns) {
        const auto from = clock::now();
        for (int i = 0; i < kBatch; i++)
            sink = sink + call(&states[k++ % states.size()]);
        batch = std::chrono::duration<double, std::nano>(clock::now() - from).count() / kBatch;
    }
    std::nth_element(ns.begin(), ns.begin() + kBatches / 2, ns.end());
    return ns[kBatches / 2];
}

} // namespace

int main(int argc, char **argv)
{
    const bool counted = argc == 4
                         && (std::strcmp(argv[2], "gravity") == 0 || std::strcmp(argv[2], "inertia") == 0);
    if (argc != 2 && !counted) {
        std::fprintf(stderr, "usage: bench_pinocchio ARM [gravity|inertia N]\n");
        return 2;
    }
    static hdt_arm arm;
    char err[300];
    if (hdt_arm_load(argv[1], &arm, err, sizeof err) != 0)
        stop(err);
    build(arm);
    const std::vector<State> states = random_states(arm);

    if (counted) {
        const auto call = argv[2][0] == 'g' ? library_gravity : library_inertia;
        double sum = 0;
        for (long n = std::strtol(argv[3], nullptr, 10); n > 0; n--)
            sum += call(&states[static_cast<std::size_t>(n) % states.size()]);
        return std::isfinite(sum) ? 0 : 1;
    }
    compare(arm, states);
    std::printf("pinocchio: %d joints, gravity: %.0f ns a call (median)\n", arm.joints,
                median_ns(library_gravity, states));
    std::printf("pinocchio: %d joints, gravity and inertia: %.0f ns a call (median)\n", arm.joints,
                median_ns(library_inertia, states));
    return 0;
}
