// SPDX-License-Identifier: Apache-2.0
// See hdt_paper_results.hpp.
#include "tools/hdt_paper_results.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "ctrl/hdt.h"
#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "model/terms.hpp"

namespace hdt::paper {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double pi = 3.14159265358979323846;
constexpr double table_bin_rad = 2e-4;   // a twentieth of a period of the shortest line, 39 a turn
constexpr double sweep_bin_rad = 4e-4;

constexpr uint32_t bit(int term) { return 1u << term; }
constexpr uint32_t feedback_terms = bit(HDT_TERM_P) | bit(HDT_TERM_D);
constexpr uint32_t friction_terms = bit(HDT_TERM_FRICTION) | bit(HDT_TERM_RIPPLE) | bit(HDT_TERM_LINES);
constexpr uint32_t quasi_static =
    feedback_terms | friction_terms | bit(HDT_TERM_GRAVITY) | bit(HDT_TERM_STIFFNESS);

const std::map<std::string, Part> &menu()
{
    static const std::map<std::string, Part> parts = {
        {"table1", PART_FRICTION},   {"table2", PART_FRICTION},   {"fig4", PART_FRICTION},  {"table3",
                PART_POSITION},
        {"fig5", PART_POSITION},     {"table5", PART_STIFFNESS},  {"fig7", PART_STIFFNESS}, {"fig8",
                PART_LEMNISCATE},
        {"fig9", PART_LEMNISCATE},   {"fig10", PART_JOINT_3},     {"low", PART_LOW},        {"equations",
                PART_EQUATIONS},
        {"table4", PART_EQUATIONS}};
    return parts;
}

double way(int d) { return d == 1 ? -1 : 1; }

} // namespace

std::set<Part> parse_parts(const std::string &text)
{
    std::set<Part> parts;
    std::string names;
    for (const auto &[name, part] : menu()) {
        names += (names.empty() ? "" : ", ") + name;
        if (text.empty())
            parts.insert(part);
    }
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = std::min(text.find(',', at), text.size());
        const auto found = menu().find(text.substr(at, end - at));
        if (found == menu().end())
            throw InputError("--only: expected names with commas out of " + names + "; found \"" +
                             text.substr(at, end - at) + "\"");
        parts.insert(found->second);
        at = end + 1;
    }
    return parts;
}

bool Plan::needs_stiffness() const
{
    return want(PART_STIFFNESS) || want(PART_LEMNISCATE) || want(PART_JOINT_3) || want(PART_LOW);
}

bool Plan::needs_friction() const { return want(PART_FRICTION) || want(PART_POSITION) || needs_stiffness(); }

double Loop::mean(double LoopFigures::*member) const
{
    double sum = 0;
    for (const LoopFigures &f : figures)
        sum += f.*member;
    return sum / static_cast<double>(std::max<std::size_t>(1, figures.size()));
}

double Loop::most(double LoopFigures::*member) const
{
    double most = 0;
    for (const LoopFigures &f : figures)
        most = std::max(most, f.*member);
    return most;
}

std::array<std::vector<SpeedPoint>, 2> points_of(const std::vector<std::vector<SpeedMean>> &trials)
{
    // microradians per second as key: the same reference speed in every trial
    std::array<std::map<long, std::vector<double>>, 2> by_speed;
    for (const auto &trial : trials)
        for (const SpeedMean &m : trial)
            by_speed[m.negative ? 1 : 0][std::lround(m.speed_radps * 1e6)].push_back(m.mean_nm);
    std::array<std::vector<SpeedPoint>, 2> points;
    for (std::size_t d = 0; d < 2; d++)
        for (const auto &[speed, values] : by_speed[d]) {
            SpeedPoint p;
            p.speed_radps = static_cast<double>(speed) * 1e-6;
            p.trials = static_cast<int>(values.size());
            for (double x : values)
                p.mean_nm += x / static_cast<double>(values.size());
            for (double x : values)
                p.sd_nm += (x - p.mean_nm) * (x - p.mean_nm);
            p.sd_nm = p.trials > 1 ? std::sqrt(p.sd_nm / (p.trials - 1)) : 0;
            points[d].push_back(p);
        }
    return points;
}

namespace {

// ---- raw runs ----

struct Raw {
    std::array<std::vector<std::vector<SpeedMean>>, printed_joints> friction;           // [trial]
    std::array<std::array<std::array<Swept, 2>, payloads_kg.size()>, sweep_joints> sweep;
};

uint64_t seed_of(const Plan &plan, int part, int joint, int trial)
{
    return plan.rig.seed * 1000003u + static_cast<uint64_t>(part * 10000 + joint * 100 + trial);
}

std::string friction_task(int joint) { return "friction:joint=" + std::to_string(joint); }

void measure_friction(const Plan &plan, int joint, int trial, std::vector<SpeedMean> *out)
{
    const hdt_arm mounted = without_load(plan.rig.arm, joint);
    const Trace trace = velocity_run(plan.rig, mounted, friction_task(joint), joint, seed_of(plan, 1, joint,
            trial));
    *out = speed_means(trace, mounted.joint[joint - 1].ratio);
}

AngleTable along_motion(const Swept &s, int d, double from, double to, double bin_rad)
{
    std::vector<double> along;
    for (double tau : s.tau_nm)
        along.push_back(way(d) * tau);
    return tabulate(s.q_rad, along, from, to, static_cast<std::size_t>(std::lround((to - from) / bin_rad)));
}

void measure_position(const Plan &plan, int joint, JointPosition *out)
{
    const hdt_arm mounted = without_load(plan.rig.arm, joint);
    const std::string task = "sweep:joint=" + std::to_string(joint) + ",speed=" + std::to_string(slow_radps);
    const Trace trace = velocity_run(plan.rig, mounted, task, joint, seed_of(plan, 2, joint, 0));
    const double turn = 2 * pi / mounted.joint[joint - 1].ratio;
    for (int d = 0; d < 2; d++) {
        const std::size_t k = static_cast<std::size_t>(d);
        // finer than the table's bins, so that each table bin sees an average over its width
        const Swept s = one_way(trace, d == 1, table_bin_rad / 8);
        const auto [low, high] = std::minmax_element(s.q_rad.begin(), s.q_rad.end());
        out->table[k] = along_motion(s, d, *low, *high, table_bin_rad);
        // the beginning is left out: the servo's integral finds the friction there
        const double turns = std::floor((*high - *low - 0.02) / turn), middle = (*low + *high) / 2;
        out->turns[k] = along_motion(s, d, middle - turns * turn / 2, middle + turns * turn / 2,
                                     table_bin_rad);
        // eq. (8) begins at one cycle a turn of the wave generator; what is slower is friction's wander
        out->lines[k] = find_lines(out->turns[k], 2, 0.9 / turn);
        const AngleTable &t = out->turns[k];
        const double mean = t.mean();
        for (std::size_t i = 0; i < t.nm.size(); i++) {
            const double q = t.from_rad + t.step_rad * (static_cast<double>(i) + 0.5), x = t.nm[i] - mean,
                         left = x - lines_nm(out->lines[k], q);
            out->rms_nm[k] += x * x;
            out->rest_rms_nm[k] += left * left;
        }
        out->rms_nm[k] = std::sqrt(out->rms_nm[k] / static_cast<double>(t.nm.size()));
        out->rest_rms_nm[k] = std::sqrt(out->rest_rms_nm[k] / static_cast<double>(t.nm.size()));
    }
}

void measure_sweep(const Plan &plan, int joint, std::size_t payload, std::array<Swept, 2> *out)
{
    const hdt_arm mounted = mounted_for_sweep(plan.rig.arm, joint, payloads_kg[payload]);
    const Trace trace = velocity_run(plan.rig, mounted, sweep_task(joint, sweep_radps), joint,
                                     seed_of(plan, 3, joint, static_cast<int>(payload)));
    for (int d = 0; d < 2; d++)
        (*out)[static_cast<std::size_t>(d)] = one_way(trace, d == 1, sweep_bin_rad);
}

// ---- from runs to numbers ----

void fit_friction(const std::vector<std::vector<SpeedMean>> &trials, JointFriction *out)
{
    out->points = points_of(trials);
    for (std::size_t d = 0; d < 2; d++) {
        out->viscous[d] = fit_viscous(out->points[d]);
        out->cubic[d] = fit_cubic(out->points[d]);
        out->stribeck[d] = fit_stribeck(out->points[d]);
    }
}

VectorXd sweep_pose(const hdt_arm &arm, int joint)
{
    VectorXd q = VectorXd::Zero(arm.joints);
    if (joint == 1)
        q[1] = 1.5707963;
    if (joint == 3)
        q[3] = 1.5707963;
    return q;
}

// Step by step as Fig. 7 (a): total, less friction (the slow table and what eq. (7) grows from that
// speed to this one), less gravity.
Subtracted subtract(const hdt_arm &mounted, int joint, int d, const Swept &swept,
                    const JointFriction &friction,
                    const JointPosition &position)
{
    const std::size_t k = static_cast<std::size_t>(d);
    const hdt_arm_friction curve = stribeck_of(friction.stribeck[k]);
    const double growth_nm = stribeck_nm(curve, sweep_radps) - stribeck_nm(curve, slow_radps);
    const double mean_nm = position.turns[k].mean() + growth_nm;
    VectorXd q = sweep_pose(mounted, joint);
    Subtracted s;
    for (std::size_t i = 0; i < swept.q_rad.size(); i++) {
        q[joint - 1] = swept.q_rad[i];
        const double load = rbd::gravity(mounted, q)[joint - 1],
                     friction_nm = way(d) * (position.table[k].at(swept.q_rad[i]) + growth_nm);
        s.q_rad.push_back(swept.q_rad[i]);
        s.load_nm.push_back(load);
        s.total_nm.push_back(swept.tau_nm[i]);
        s.less_friction_nm.push_back(swept.tau_nm[i] - friction_nm);
        s.rest_nm.push_back(swept.tau_nm[i] - friction_nm - load);
        s.less_smooth_nm.push_back(swept.tau_nm[i] - way(d) * mean_nm - load);
    }
    return s;
}

void append(std::vector<double> &all, const std::vector<double> &more) { all.insert(all.end(), more.begin(),
        more.end()); }

void fit_stiffness(const Plan &plan, int joint, const Raw &raw, const Results &r, JointStiffness *out)
{
    const std::size_t j = static_cast<std::size_t>(joint - 1);
    for (int d = 0; d < 2; d++) {
        const std::size_t k = static_cast<std::size_t>(d);
        std::vector<double> q, load, rest, smooth;
        for (std::size_t p = 0; p < payloads_kg.size(); p++) {
            const hdt_arm mounted = mounted_for_sweep(plan.rig.arm, joint, payloads_kg[p]);
            const Subtracted s = subtract(mounted, joint, d, raw.sweep[j][p][k], r.friction[j],
                                          r.position[j]);
            append(q, s.q_rad);
            append(load, s.load_nm);
            append(rest, s.rest_nm);
            append(smooth, s.less_smooth_nm);
            out->sweeps[k].push_back(s);
        }
        out->fit[k] = fit_hinges(load, rest);
        std::vector<double> cycles;
        for (const AngleLine &line : r.position[j].lines[k])
            cycles.push_back(line.cycles_per_rad);
        out->ripple[k] = ripple_by_region(q, load, smooth, out->fit[k].lines, cycles);
    }
    // half the sum of both ways at the same angle is gravity, as far as friction is the same
    const Subtracted &up = out->sweeps[0][0], &down = out->sweeps[1][0];
    const double turn = 2 * pi / plan.rig.arm.joint[j].ratio;
    const auto near = [turn](const Subtracted &s, std::vector<double> Subtracted::*what) {
        double sum = 0, count = 0;
        const double from = -pi / 2 + 0.03;
        for (std::size_t i = 0; i < s.q_rad.size(); i++)
            if (s.q_rad[i] >= from && s.q_rad[i] < from + turn) {
                sum += (s.*what)[i];
                count++;
            }
        return sum / std::max(1.0, count);
    };
    out->gravity_at_minus_90_nm = {(near(up, &Subtracted::total_nm) + near(down, &Subtracted::total_nm)) / 2,
                                   near(up, &Subtracted::load_nm)};
}

// ---- what the host is told in the closed loops ----

hdt_arm with_measured_lines(const hdt_arm &arm, const Results &r)
{
    hdt_arm out = arm;
    for (std::size_t j = 0; j < sweep_joints; j++) {
        out.joint[j].has_stiffness = 1;
        for (std::size_t d = 0; d < 2; d++)
            out.joint[j].stiffness[d] = r.stiffness[j].fit[d].lines;
    }
    return out;
}

// Friction and lines as measured too: what the authors had, but for their lookup table, in whose
// place the two lines stand.
hdt_arm as_measured(const hdt_arm &arm, const Results &r)
{
    hdt_arm out = with_measured_lines(arm, r);
    for (std::size_t j = 0; j < printed_joints; j++) {
        for (std::size_t d = 0; d < 2; d++)
            out.joint[j].friction[d] = stribeck_of(r.friction[j].stribeck[d]);
        out.joint[j].ripples = 0;
        out.joint[j].lines = 0;
        for (const AngleLine &line : r.position[j].lines[0])
            out.joint[j].line[out.joint[j].lines++] = {2 * pi * line.cycles_per_rad, line.amplitude_nm,
                                                       line.phase_rad, 1};
    }
    return out;
}

// The paper's own set of terms: gravity and wind-up for joints 2 and 4 only, no inertia.
std::array<uint32_t, 16> paper_terms()
{
    std::array<uint32_t, 16> terms{};
    terms.fill(feedback_terms | friction_terms);
    terms[1] = terms[3] = quasi_static;
    return terms;
}

std::array<uint32_t, 16> all_joints(uint32_t mask)
{
    std::array<uint32_t, 16> terms{};
    terms.fill(mask);
    return terms;
}

hdt_arm with_friction_times(const hdt_arm &arm, double times)
{
    hdt_arm out = arm;
    for (hdt_arm_joint &joint : out.joint)
        for (hdt_arm_friction &f : joint.friction) {
            f.f0_nm *= times;
            f.fv_nmspr *= times;
            f.fs_nm *= times;
        }
    return out;
}

std::vector<Loop> lemniscate_loops(const Plan &plan, const Results &r)
{
    std::vector<Loop> loops;
    const auto add = [&](const std::string &name, const std::string &what, const hdt_arm &host,
                         std::array<uint32_t, 16> terms, double kp, double kd) {
        Loop loop;
        loop.setup.name = name;
        loop.what = what;
        loop.setup.host = host;
        loop.setup.terms = terms;
        loop.setup.kp_times = kp;
        loop.setup.kd_times = kd;
        loop.setup.follow_fault = (terms[1] & bit(HDT_TERM_GRAVITY)) != 0 || terms[1] == 0;
        loops.push_back(loop);
    };
    const uint32_t all = ~0u;
    add("measured", "everything as measured, the paper's terms", r.measured, paper_terms(), 1, 1);
    add("measured lines", "the file's terms, Table V as measured", r.file_with_lines, all_joints(all), 1, 1);
    add("as shipped", "the file's terms, Table V as printed", plan.rig.arm, all_joints(all), 1, 1);
    add("no wind-up term", "the file's terms without Table V", plan.rig.arm,
        all_joints(all & ~bit(HDT_TERM_STIFFNESS)), 1, 1);
    add("feedback alone", "no feed-forward", plan.rig.arm, all_joints(feedback_terms), 1, 1);
    add("10 x gains", "no feed-forward, ten times both gains", plan.rig.arm, all_joints(feedback_terms), 10,
        10);
    add("10 x P, 3 x D", "no feed-forward, ten times P and three times D", plan.rig.arm,
        all_joints(feedback_terms), 10, 3);
    // how stale a model may be
    for (const double times : {1.05, 1.1, 0.9})
        add("stale " + std::to_string(std::lround(100 * times)),
            "as the first row, friction fed forward " + std::to_string(std::lround(100 * times)) +
                " % of the measured",
            with_friction_times(r.measured, times), paper_terms(), 1, 1);
    return loops;
}

Loop joint_3_loop(const Results &r)
{
    Loop loop;
    loop.setup.name = "joint 3";
    loop.what = "1.0 rad at 0.1 rad/s from the heaviest pose";
    loop.setup.host = r.measured;
    loop.setup.host.joint[2].kp_m_nmprad = 4.0;
    loop.setup.host.joint[2].kd_m_nmspr = 0.5;
    loop.setup.terms = all_joints(quasi_static);
    return loop;
}

void repeat(const Plan &plan, const Reference &reference, int trial, int part, Loop *loop,
            LoopFigures *figures, std::string *fault)
{
    LoopRun run = torque_run(plan.rig, loop->setup, reference, seed_of(plan, part, 0, trial));
    *figures = figures_of(plan.rig.arm, run);
    *fault = run.fault;
    if (trial == 0)
        loop->first = std::move(run);
}

// ---- the low region ----

void judge_low(const Reference &reference, const hdt_arm_stiffness (&lines)[2], LowRegion *low)
{
    const LoopRun &run = low->run;
    double count[ZONES] = {}, feedback = 0, total = 0;
    for (Index k = 0; k < run.ref_rad.rows(); k++) {
        const double v = reference.v_radps(k, 1);
        if (std::fabs(v) < 1e-4)
            continue;
        const hdt_arm_stiffness &s = lines[v < 0 ? 1 : 0];
        const double load = run.gravity_nm(k, 1), fb = run.feedback_nm(k, 1),
                     error = std::fabs(run.link_rad(k, 1) - run.ref_rad(k, 1));
        const bool above = load > s.t2_nm, inside = load >= s.t1_nm && !above;
        const std::size_t zone = inside ? ZONE_STEP : above == (v > 0) ? ZONE_AGAINST : ZONE_WITH;
        count[zone]++;
        low->error_rad[zone] += error;
        low->feedback_nm[zone] += fb * fb;
        low->error_max_rad = std::max(low->error_max_rad, error);
        feedback += fb * fb;
        total += run.total_nm(k, 1) * run.total_nm(k, 1);
    }
    for (std::size_t zone = 0; zone < ZONES; zone++) {
        low->error_rad[zone] /= std::max(1.0, count[zone]);
        low->feedback_nm[zone] = std::sqrt(low->feedback_nm[zone] / std::max(1.0, count[zone]));
    }
    low->feedback_share = total > 0 ? std::sqrt(feedback / total) : 0;
}

LowRegion sweep_through_low(const Plan &plan, const Results &r, const std::string &name, const hdt_arm &host,
                            uint32_t terms)
{
    LowRegion low;
    low.name = name;
    LoopSetup setup;
    setup.name = name;
    setup.host = host;
    setup.terms = all_joints(terms);
    const Reference reference = make_task(plan.rig.arm, "sweep:joint=2,speed=0.1",
                                          plan.rig.arm.control_rate_hz);
    low.run = torque_run(plan.rig, setup, reference, seed_of(plan, 6, 2, 0));
    low.fault = low.run.fault;
    const hdt_arm_stiffness lines[2] = {r.stiffness[1].fit[0].lines, r.stiffness[1].fit[1].lines};
    judge_low(reference, lines, &low);
    return low;
}

using Jobs = std::vector<std::function<void()>>;

// Longest first, so that no worker is left with a long one at the end.
Jobs raw_jobs(const Plan &plan, Raw *raw, Results *r)
{
    Jobs jobs;
    const bool all = plan.want(PART_FRICTION) || plan.want(PART_POSITION) || plan.want(PART_LEMNISCATE);
    const int joints = !plan.needs_friction() ? 0 : all ? printed_joints : sweep_joints;
    for (int joint = 1; joint <= joints; joint++)
        jobs.push_back([&plan, r, joint] {
            measure_position(plan, joint, &r->position[static_cast<std::size_t>(joint - 1)]);
        });
    for (int joint = 1; joint <= joints; joint++) {
        auto &trials = raw->friction[static_cast<std::size_t>(joint - 1)];
        trials.resize(static_cast<std::size_t>(plan.trials));
        for (int trial = 0; trial < plan.trials; trial++)
            jobs.push_back([&plan, &trials, joint, trial] {
                measure_friction(plan, joint, trial, &trials[static_cast<std::size_t>(trial)]);
            });
    }
    for (int joint = 1; plan.needs_stiffness() && joint <= sweep_joints; joint++)
        for (std::size_t p = 0; p < payloads_kg.size(); p++)
            jobs.push_back([&plan, raw, joint, p] {
                measure_sweep(plan, joint, p, &raw->sweep[static_cast<std::size_t>(joint - 1)][p]);
            });
    return jobs;
}

Jobs fit_jobs(const Plan &plan, const Raw &raw, Results *r)
{
    Jobs jobs;
    for (int joint = 1; joint <= printed_joints; joint++) {
        const std::size_t j = static_cast<std::size_t>(joint - 1);
        if (raw.friction[j].empty())
            continue;
        jobs.push_back([&plan, &raw, r, joint, j] {
            fit_friction(raw.friction[j], &r->friction[j]);
            if (plan.needs_stiffness() && joint <= sweep_joints)
                fit_stiffness(plan, joint, raw, *r, &r->stiffness[j]);
        });
    }
    return jobs;
}

// A loop's repetitions have places of their own, so that threads share nothing.
struct Repeats { std::vector<LoopFigures> figures; std::vector<std::string> faults; };

void add_repeats(const Plan &plan, const Reference &reference, int part, Loop *loop, Repeats *repeats,
                 Jobs *jobs)
{
    repeats->figures.resize(static_cast<std::size_t>(plan.trials));
    repeats->faults.resize(repeats->figures.size());
    for (int trial = 0; trial < plan.trials; trial++)
        jobs->push_back([&plan, &reference, part, loop, repeats, trial] {
            const std::size_t k = static_cast<std::size_t>(trial);
            repeat(plan, reference, trial, part, loop, &repeats->figures[k], &repeats->faults[k]);
        });
}

void take(const Repeats &repeats, Loop *loop)
{
    loop->figures = repeats.figures;
    for (const std::string &fault : repeats.faults)
        if (loop->fault.empty())
            loop->fault = fault;
}

void close_loops(const Plan &plan, Results *r, const std::function<void(double)> &done)
{
    Jobs jobs;
    Reference path, trapezoid;
    std::vector<Repeats> repeats(16);
    if (plan.want(PART_LEMNISCATE)) {
        path = lemniscate_at_speed(plan.rig.arm);
        r->lemniscate = lemniscate_loops(plan, *r);
        for (std::size_t i = 0; i < r->lemniscate.size(); i++)
            add_repeats(plan, path, 4, &r->lemniscate[i], &repeats[i], &jobs);
    }
    if (plan.want(PART_JOINT_3)) {
        trapezoid = make_task(plan.rig.arm, "trapezoid:joint=3", plan.rig.arm.control_rate_hz);
        r->joint_3 = joint_3_loop(*r);
        add_repeats(plan, trapezoid, 5, &r->joint_3, &repeats.back(), &jobs);
    }
    if (plan.want(PART_LOW)) {
        r->low.resize(3);
        jobs.push_back([&plan, r] {
            const uint32_t without = quasi_static & ~bit(HDT_TERM_STIFFNESS);
            r->low[0] = sweep_through_low(plan, *r, "without the lines", r->measured, without);
        });
        jobs.push_back([&plan, r] {
            r->low[1] = sweep_through_low(plan, *r, "with the measured lines", r->measured, quasi_static);
        });
        jobs.push_back([&plan, r] {
            hdt_arm printed = r->measured;
            for (int d = 0; d < 2; d++)
                printed.joint[1].stiffness[d] = plan.rig.arm.joint[1].stiffness[d];
            r->low[2] = sweep_through_low(plan, *r, "with the printed lines", printed, quasi_static);
        });
    }
    in_parallel(jobs, plan.workers, done);
    for (std::size_t i = 0; i < r->lemniscate.size(); i++)
        take(repeats[i], &r->lemniscate[i]);
    take(repeats.back(), &r->joint_3);
}

} // namespace

const Loop &loop_named(const Results &r, const std::string &name)
{
    for (const Loop &l : r.lemniscate)
        if (l.setup.name == name)
            return l;
    throw std::logic_error("no closed loop is named " + name);
}

Results carry_out(const Plan &plan, const std::function<void(double)> &done)
{
    Results r;
    Raw raw;
    require_pa10(plan.rig.arm);
    in_parallel(raw_jobs(plan, &raw, &r), plan.workers, [&](double share) { done(0.9 * share); });
    in_parallel(fit_jobs(plan, raw, &r), plan.workers, nullptr);
    r.file_with_lines = plan.needs_stiffness() ? with_measured_lines(plan.rig.arm, r) : plan.rig.arm;
    const bool all_measured = !raw.friction.back().empty();
    r.measured = plan.needs_stiffness() && all_measured ? as_measured(plan.rig.arm, r) : r.file_with_lines;
    close_loops(plan, &r, [&](double share) { done(0.9 + 0.1 * share); });
    if (plan.want(PART_EQUATIONS))
        r.equations = check_equations(table_4, 2000, 1);
    return r;
}

double curve_gap_nm(const hdt_arm_friction &a, const hdt_arm_friction &b)
{
    double worst = 0;
    for (double v = 0.02; v <= 0.4001; v += 0.005)
        worst = std::max(worst, std::fabs(stribeck_nm(a, v) - stribeck_nm(b, v)));
    return worst;
}

double mean_variance(const std::array<FrictionModelFit, 2> &fit) { return (fit[0].variance +
        fit[1].variance) / 2; }

} // namespace hdt::paper
