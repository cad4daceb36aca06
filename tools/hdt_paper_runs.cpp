// SPDX-License-Identifier: Apache-2.0
// See hdt_paper_runs.hpp.
#include "tools/hdt_paper_runs.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <mutex>
#include <thread>

#include "ctrl/hdt.h"
#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "tools/hdt_world.hpp"

namespace hdt::paper {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double pi = 3.14159265358979323846;

double gravity_of(const hdt_arm &arm)
{
    return std::hypot(arm.gravity_mps2[0], arm.gravity_mps2[1], arm.gravity_mps2[2]);
}

hdt_arm with_gravity(const hdt_arm &arm, const Eigen::Vector3d &down)
{
    hdt_arm out = arm;
    const double g = gravity_of(arm);
    for (int i = 0; i < 3; i++)
        out.gravity_mps2[i] = g * down[i];
    return out;
}

void stop_if_asked(const Rig &rig)
{
    if (rig.stop != nullptr && rig.stop->load())
        throw Stopped();
}

std::vector<double> first_row(const Reference &r)
{
    const VectorXd start = r.q_rad.row(0);
    return {start.begin(), start.end()};
}

std::string fault_text(const drv_host &host)
{
    if (host.phase == DRV_HOST_SILENT)
        return "the servo never answered";
    std::string text;
    for (uint32_t bit = 1; host.phase == DRV_HOST_FAULTED && bit != 0; bit <<= 1)
        if (host.fault.fault & bit)
            text += (text.empty() ? "" : ", ") + std::string(hdt_fault_str(bit));
    return text;
}

} // namespace

void require_pa10(const hdt_arm &arm)
{
    if (arm.joints != 7)
        throw InputError(std::string(arm.path) + ": expected an arm with the PA-10's seven joints, found " +
                         std::to_string(arm.joints) + " joints; the experiments are laid out for "
                         "model/arms/pa10.toml");
    for (int j = 0; j < arm.joints; j++)
        if (!arm.joint[j].has_inertial || !arm.joint[j].has_gear || !arm.joint[j].has_friction)
            throw InputError(std::string(arm.path) + ": joint." + std::to_string(j + 1) +
                             ": expected masses, gear and friction, found some missing; use an arm the rig "
                             "can simulate");
}

void in_parallel(std::vector<std::function<void()>> jobs, unsigned workers,
                 const std::function<void(double)> &done)
{
    std::mutex lock;
    std::size_t next = 0, through = 0;
    std::exception_ptr failed;
    const auto work = [&] {
        for (;;) {
            std::size_t mine;
            {
                std::lock_guard<std::mutex> hold(lock);
                if (next == jobs.size() || failed)
                    return;
                mine = next++;
            }
            std::exception_ptr error;
            try {
                jobs[mine]();
            } catch (...) {
                error = std::current_exception();
            }
            std::lock_guard<std::mutex> hold(lock);
            if (error && !failed)
                failed = error;
            through++;
            if (done)
                done(static_cast<double>(through) / static_cast<double>(jobs.size()));
        }
    };
    std::vector<std::thread> threads;
    for (unsigned i = 1; i < std::min<std::size_t>(workers, jobs.size()); i++)
        threads.emplace_back(work);
    work();
    for (std::thread &t : threads)
        t.join();
    if (failed)
        std::rethrow_exception(failed);
}

// ---- mounting ----

hdt_arm without_load(const hdt_arm &arm, int joint)
{
    const auto frames = rbd::frames(arm, VectorXd::Zero(arm.joints));
    return with_gravity(arm, -frames[static_cast<std::size_t>(joint - 1)].rot.col(2));
}

hdt_arm mounted_for_sweep(const hdt_arm &arm, int joint, double payload_kg)
{
    // on the wall "up" is the base's x: links that lean to +x stand up
    const bool wall = joint == 1 || joint == 3;
    hdt_arm out = with_gravity(arm, wall ? -Eigen::Vector3d::UnitX() : -Eigen::Vector3d::UnitZ());
    out.payload_kg = payload_kg;
    out.payload_com_m[0] = out.payload_com_m[1] = 0;
    out.payload_com_m[2] = 0.05;
    return out;
}

std::string sweep_task(int joint, double speed_radps)
{
    std::string task = "sweep:joint=" + std::to_string(joint) + ",speed=" + std::to_string(speed_radps);
    // across the joint's axis, so that gravity can act on it
    if (joint == 1)
        task += ",q2=1.5707963";
    if (joint == 3)
        task += ",q4=1.5707963";
    return task;
}

// ---- velocity mode ----

Trace velocity_run(const Rig &rig, const hdt_arm &mounted, const std::string &task, int joint, uint64_t seed)
{
    const Reference reference = make_task(mounted, task, mounted.control_rate_hz);
    const rig::FixedReference fixed(reference);
    const hdt_tables tables = rig::tables_of(mounted);
    const plant_model plant = rig::plant_from_arm(mounted, rig.individual);
    rig::WorldSetup setup;
    setup.mode = HDT_MODE_VELOCITY;
    setup.seed = seed;
    rig::World world(tables, plant, fixed, mounted.control_rate_hz, first_row(reference), setup);
    const std::size_t j = static_cast<std::size_t>(joint - 1);
    const Index column = joint - 1;
    const double nm_per_dig = 0.001 * mounted.joint[j].ratio;
    Trace trace;
    world.play([&](rig::World &w) {
        stop_if_asked(rig);
        const drv_host &host = w.host();
        if (host.phase != DRV_HOST_RUN)
            return true;
        const Index row = static_cast<Index>(host.sample) - 1;
        const double v = reference.v_radps(row, column);
        if (std::fabs(v) < 1e-4 || std::fabs(reference.a_radps2(row, column)) > 1e-9)
            return true;
        trace.q_rad.push_back(host.out.q[j].raw / 16777216.0);
        trace.vref_radps.push_back(v);
        trace.tau_nm.push_back(nm_per_dig * host.cycle.last.axis[j].torque_dig);
        return true;
    });
    if (const std::string fault = fault_text(world.host()); !fault.empty())
        throw InputError("paper, " + task + ": expected a run to its end, found the host's fault \"" + fault +
                         "\"; can this arm carry the load at this speed?");
    return trace;
}

namespace {

// Neighbouring samples of one constant reference speed: [first, last).
std::vector<std::pair<std::size_t, std::size_t>> stretches(const Trace &t)
{
    std::vector<std::pair<std::size_t, std::size_t>> out;
    for (std::size_t i = 0, first = 0; i < t.q_rad.size(); i++)
        if (i + 1 == t.q_rad.size() || std::fabs(t.vref_radps[i + 1] - t.vref_radps[first]) > 1e-6) {
            out.push_back({first, i + 1});
            first = i + 1;
        }
    return out;
}

} // namespace

std::vector<SpeedMean> speed_means(const Trace &trace, double ratio)
{
    const double turn_rad = 2 * pi / ratio, settle_s = 0.1;
    std::vector<SpeedMean> out;
    for (const auto &[first, last] : stretches(trace)) {
        const double v = trace.vref_radps[first], speed = std::fabs(v);
        const double from = std::min(trace.q_rad[first], trace.q_rad[last - 1]),
                     to = std::max(trace.q_rad[first], trace.q_rad[last - 1]);
        const double turns = std::floor((to - from - 2 * settle_s * speed) / turn_rad);
        if (turns < 1)
            continue;
        const double low = (from + to - turns * turn_rad) / 2, high = low + turns * turn_rad;
        double sum = 0, count = 0;
        for (std::size_t i = first; i < last; i++)
            if (trace.q_rad[i] >= low && trace.q_rad[i] < high) {
                sum += trace.tau_nm[i];
                count++;
            }
        out.push_back({speed, v < 0, (v < 0 ? -1 : 1) * sum / count, turns});
    }
    return out;
}

Swept one_way(const Trace &trace, bool negative, double bin_rad)
{
    Swept out;
    double q = 0, tau = 0, count = 0, cell = 0;
    const auto close = [&] {
        if (count > 0) {
            out.q_rad.push_back(q / count);
            out.tau_nm.push_back(tau / count);
        }
        q = tau = count = 0;
    };
    for (std::size_t i = 0; i < trace.q_rad.size(); i++) {
        if ((trace.vref_radps[i] < 0) != negative)
            continue;
        const double here = std::floor(trace.q_rad[i] / bin_rad);
        if (here != cell)
            close();
        cell = here;
        q += trace.q_rad[i];
        tau += trace.tau_nm[i];
        count++;
    }
    close();
    return out;
}

// ---- torque mode ----

namespace {

double term_nm(const drv_host &host, int term, std::size_t j) { return host.out.term[term][j].raw / 65536.0; }

// Rows grow by doubling; cut to size at the end.
void put(MatrixXd &m, Index row, Index joints)
{
    if (row >= m.rows())
        m.conservativeResize(std::max<Index>(1024, 2 * m.rows()), joints);
}

hdt_tables loop_tables(const LoopSetup &setup)
{
    hdt_arm host = setup.host;
    for (hdt_arm_joint &joint : host.joint) {
        joint.kp_m_nmprad *= setup.kp_times;
        joint.kd_m_nmspr *= setup.kd_times;
    }
    hdt_tables tables = rig::tables_of(host);
    for (uint32_t j = 0; j < tables.joints; j++) {
        if (setup.terms[j] != 0)
            tables.joint[j].terms &= setup.terms[j];
        if (!setup.follow_fault)
            tables.joint[j].follow_max_q24 = 0;
    }
    return tables;
}

void keep_row(const drv_host &host, const struct servo &driver, const Reference &reference, LoopRun *run)
{
    const Index row = static_cast<Index>(run->t_s.size()), joints = reference.q_rad.cols();
    for (MatrixXd *m : {&run->ref_rad, &run->seen_rad, &run->link_rad, &run->friction_nm, &run->gravity_nm,
                        &run->stiffness_nm, &run->inertia_nm, &run->feedback_nm, &run->total_nm})
        put(*m, row, joints);
    run->t_s.push_back(static_cast<double>(host.sample - 1) / reference.rate_hz);
    run->ref_rad.row(row) = reference.q_rad.row(static_cast<Index>(host.sample) - 1);
    for (Index c = 0; c < joints; c++) {
        const std::size_t j = static_cast<std::size_t>(c);
        run->seen_rad(row, c) = host.out.q[j].raw / 16777216.0;
        run->link_rad(row, c) = driver.plant.q_rad[j];
        run->gravity_nm(row, c) = term_nm(host, HDT_TERM_GRAVITY, j);
        run->stiffness_nm(row, c) = term_nm(host, HDT_TERM_STIFFNESS, j);
        run->inertia_nm(row, c) = term_nm(host, HDT_TERM_INERTIA, j);
        run->feedback_nm(row, c) = term_nm(host, HDT_TERM_P, j) + term_nm(host, HDT_TERM_D, j);
        run->total_nm(row, c) = host.out.total[j].raw / 65536.0;
        // what is neither: velocity friction, ripple and lines
        run->friction_nm(row, c) = run->total_nm(row, c) - run->gravity_nm(row, c) - run->stiffness_nm(row,
                c) -
                                   run->inertia_nm(row, c) - run->feedback_nm(row, c);
    }
}

} // namespace

LoopRun torque_run(const Rig &rig, const LoopSetup &setup, const Reference &reference, uint64_t seed)
{
    const rig::FixedReference fixed(reference);
    const hdt_tables tables = loop_tables(setup);
    const plant_model plant = rig::plant_from_arm(rig.arm, rig.individual);
    rig::WorldSetup world_setup;
    world_setup.mode = HDT_MODE_TORQUE;
    world_setup.seed = seed;
    rig::World world(tables, plant, fixed, reference.rate_hz, first_row(reference), world_setup);
    LoopRun run;
    run.active = reference.active;
    world.play([&](rig::World &w) {
        stop_if_asked(rig);
        if (w.host().phase == DRV_HOST_RUN)
            keep_row(w.host(), w.driver(), reference, &run);
        return true;
    });
    run.fault = fault_text(world.host());
    const Index rows = static_cast<Index>(run.t_s.size());
    for (MatrixXd *m : {&run.ref_rad, &run.seen_rad, &run.link_rad, &run.friction_nm, &run.gravity_nm,
                        &run.stiffness_nm, &run.inertia_nm, &run.feedback_nm, &run.total_nm})
        m->conservativeResize(rows, reference.q_rad.cols());
    return run;
}

Reference lemniscate_at_speed(const hdt_arm &arm)
{
    // the second of two laps: the first sample nearest the start of the path, at full speed
    const Reference two = make_task(arm, "lemniscate:laps=2", arm.control_rate_hz);
    const Index rows = two.q_rad.rows();
    Index best = rows / 3;
    for (Index i = rows / 3; i < 2 * rows / 3; i++)
        if ((two.q_rad.row(i) - two.q_rad.row(0)).norm() < (two.q_rad.row(best) - two.q_rad.row(0)).norm())
            best = i;
    Reference one = two;
    one.q_rad = two.q_rad.bottomRows(rows - best);
    one.v_radps = two.v_radps.bottomRows(rows - best);
    one.a_radps2 = two.a_radps2.bottomRows(rows - best);
    one.name = "lemniscate at speed";
    return one;
}

namespace {

Eigen::RowVector3d flange_at(const hdt_arm &arm, const MatrixXd &q, Index row)
{
    return rbd::flange(arm, q.row(row).transpose()).pos.transpose();
}

double rms(const VectorXd &x) { return std::sqrt(x.squaredNorm() / static_cast<double>(std::max<Index>(1,
        x.size()))); }

} // namespace

LoopFigures figures_of(const hdt_arm &arm, const LoopRun &run)
{
    const Index rows = run.ref_rad.rows(), joints = run.ref_rad.cols();
    LoopFigures f;
    f.path_m.resize(rows, 3);
    f.reference_m.resize(rows, 3);
    double settled = 0, feedback = 0, total = 0;
    for (Index k = 0; k < rows; k++) {
        f.path_m.row(k) = flange_at(arm, run.link_rad, k);
        f.reference_m.row(k) = flange_at(arm, run.ref_rad, k);
        const double error = 1e3 * (f.path_m.row(k) - f.reference_m.row(k)).norm(),
                     seen = 1e3 * (flange_at(arm, run.seen_rad, k) - f.reference_m.row(k)).norm();
        f.error_mm.push_back(error);
        f.fall_mm = std::max(f.fall_mm, 1e3 * (f.reference_m(k, 2) - f.path_m(k, 2)));
        if (run.t_s[static_cast<std::size_t>(k)] < 1) {
            f.first_second_max_mm = std::max(f.first_second_max_mm, error);
            continue;
        }
        settled++;
        f.error_mean_mm += error;
        f.error_max_mm = std::max(f.error_max_mm, error);
        f.seen_mean_mm += seen;
        f.seen_max_mm = std::max(f.seen_max_mm, seen);
    }
    f.error_mean_mm /= std::max(1.0, settled);
    f.seen_mean_mm /= std::max(1.0, settled);
    for (Index j = 0; j < joints; j++) {
        const VectorXd e = (run.link_rad.col(j) - run.ref_rad.col(j)).cwiseAbs();
        const bool driven = (run.active >> j & 1u) != 0 && rows > 0;
        const double fb = driven ? rms(run.feedback_nm.col(j)) : 0, all = driven
            ? rms(run.total_nm.col(j)) : 0;
        f.joint_mean_rad.push_back(driven ? e.mean() : 0);
        f.joint_max_rad.push_back(driven ? e.maxCoeff() : 0);
        f.joint_feedback_share.push_back(all > 0 ? fb / all : 0);
        feedback += fb * fb;
        total += all * all;
    }
    f.feedback_share = total > 0 ? std::sqrt(feedback / total) : 0;
    return f;
}

} // namespace hdt::paper
