// SPDX-License-Identifier: Apache-2.0
//
// `hdt velocity`: the closed loop in the rig with the velocity of the D term filtered or observed, and
// friction fed forward for the desired or for the observed velocity; what each is worth.
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>

#include "tools/hdt_cli.hpp"
#include "tools/hdt_paper_runs.hpp"

namespace hdt::cli {

namespace {

struct VelocityOptions {
    std::string arm;
    uint64_t individual = 1, seed = 1;
};

constexpr double pi = 3.14159265358979323846;

// Slow to and fro of all joints about a bent pose, at rest at both ends: reversals at every speed up to
// peak; joints half a second apart, so that one reverses while others move.
Reference to_and_fro(const hdt_arm &arm, double peak_radps, double amplitude_rad)
{
    const double omega = peak_radps / amplitude_rad, wait_s = 0.5, ramp_s = 2 * pi / omega;
    const double total_s = 3 * ramp_s + wait_s * arm.joints;
    Reference ref;
    ref.rate_hz = arm.control_rate_hz;
    ref.active = (1u << arm.joints) - 1;
    ref.name = "to and fro";
    const auto rows = static_cast<Eigen::Index>(total_s * ref.rate_hz);
    ref.q_rad = ref.v_radps = ref.a_radps2 = Eigen::MatrixXd::Zero(rows, arm.joints);
    for (Eigen::Index i = 0; i < rows; i++)
        for (int j = 0; j < arm.joints; j++) {
            // sin^2 starts and ends with speed zero and, over a turn of the sine, three of them
            const double t = std::min(std::max(static_cast<double>(i) / ref.rate_hz - wait_s * j, 0.0),
                                      3 * ramp_s);
            const double x = omega * t, a = amplitude_rad, pose = j % 2 == 1 ? 0.6 : 0.1;
            // minimum-jerk start over the first turn
            const double share = std::min(x / (2 * pi), 1.0), left = std::min((6 * pi - x) / (2 * pi), 1.0);
            const double s = std::min(share, left), ds = (share < 1 ? 1 : left < 1 ? -1 : 0) / (2 * pi);
            const double w = s * s * s * (10 - 15 * s + 6 * s * s), w1 = 30 * s * s * (1 - s) * (1 - s),
                         w2 = 60 * s * (1 - s) * (1 - 2 * s);
            const bool moving = t > 0 && t < 3 * ramp_s;
            ref.q_rad(i, j) = pose + a * w * std::sin(x);
            ref.v_radps(i, j) = moving ? a * omega * (w1 * ds * std::sin(x) + w * std::cos(x)) : 0;
            ref.a_radps2(i, j) = moving ? a * omega * omega
                                              * (w2 * ds * ds * std::sin(x) + 2 * w1 * ds * std::cos(x)
                                                 - w * std::sin(x))
                                        : 0;
        }
    return ref;
}

struct Worth {
    double feedback_share = 0, reversal_mrad = 0, error_mrad = 0, chatter_nm = 0;
};

// Means over driven joints; reversals: worst error of the link within 0.2 s after a change of sign.
Worth worth_of(const paper::LoopRun &run, const Reference &ref)
{
    Worth w;
    const Eigen::Index rows = run.total_nm.rows(), joints = ref.q_rad.cols();
    const auto after = static_cast<Eigen::Index>(0.2 * ref.rate_hz);
    double feedback = 0, total = 0, chatter = 0, error = 0, reversal = 0;
    int reversals = 0;
    for (Eigen::Index j = 0; j < joints; j++) {
        Eigen::Index until = -1;
        double worst = 0, sign = 0;
        for (Eigen::Index i = 1; i < rows; i++) {
            const double off = run.ref_rad(i, j) - run.link_rad(i, j), v = ref.v_radps(i, j);
            feedback += std::pow(run.feedback_nm(i, j), 2);
            total += std::pow(run.total_nm(i, j), 2);
            chatter += std::pow(run.total_nm(i, j) - run.total_nm(i - 1, j), 2);
            error += off * off;
            if (v != 0 && sign * v < 0) {
                until = i + after;
                reversals++;
            }
            sign = v != 0 ? v : sign;
            if (i <= until)
                worst = std::max(worst, std::fabs(off));
            if (i == until) {
                reversal += worst;
                worst = 0;
            }
        }
    }
    const double n = static_cast<double>(rows * joints);
    w.feedback_share = total > 0 ? std::sqrt(feedback / total) : 0;
    w.chatter_nm = std::sqrt(chatter / n);
    w.error_mrad = 1e3 * std::sqrt(error / n);
    w.reversal_mrad = reversals > 0 ? 1e3 * reversal / reversals : 0;
    return w;
}

int run(const VelocityOptions &o)
{
    std::atomic<bool> stop{false};
    paper::Rig rig;
    rig.arm = rig::load_arm(o.arm);
    rig.individual = o.individual;
    rig.seed = o.seed;
    rig.stop = &stop;
    const struct { const char *name; Reference ref; } motions[] = {
        {"lemniscate", make_task(rig.arm, "lemniscate", rig.arm.control_rate_hz)},
        {"to and fro, 0.2 rad/s", to_and_fro(rig.arm, 0.2, 0.2)},
        {"to and fro, 0.05 rad/s", to_and_fro(rig.arm, 0.05, 0.05)},
        {"to and fro, 0.01 rad/s", to_and_fro(rig.arm, 0.01, 0.02)},
    };
    std::printf("| motion | D term | friction | feedback share | reversal mrad | rms error mrad | chatter N "
                "m |\n|---|---|---|---|---|---|---|\n");
    for (const auto &motion : motions)
        for (int way = 0; way < 4; way++) {
            paper::LoopSetup setup;
            setup.host = rig.arm;
            setup.host.observe_feedback = way & 1;
            setup.host.observe_friction = way >> 1;
            const paper::LoopRun run = paper::torque_run(rig, setup, motion.ref, o.seed);
            const Worth w = worth_of(run, motion.ref);
            std::printf("| %s | %s | %s | %.3f | %.3f | %.3f | %.3f |%s%s\n", motion.name,
                        way & 1 ? "observed" : "filtered", way >> 1 ? "observed" : "desired",
                        w.feedback_share, w.reversal_mrad, w.error_mrad, w.chatter_nm,
                        run.fault.empty() ? "" : " ", run.fault.c_str());
            std::fflush(stdout);
        }
    return Ok;
}

} // namespace

void add_velocity(CLI::App &app, int &code)
{
    auto o = std::make_shared<VelocityOptions>();
    CLI::App *sub = app.add_subcommand("velocity",
                                       "filtered against observed velocity in the rig's closed loop");
    sub->add_option("--arm", o->arm, "model file of the arm")->required();
    sub->add_option("--individual", o->individual,
                    "which specimen of the arm; 0 has the file's friction exactly")
        ->capture_default_str()->check(whole_number());
    sub->add_option("--seed", o->seed, "noise and scatter of all runs")
        ->capture_default_str()->check(whole_number());
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
