// SPDX-License-Identifier: Apache-2.0
//
// The menu of reference motions.  Everything is built from one smooth move: speed ramps up as a
// minimum-jerk step, stays, ramps down; so acceleration is continuous everywhere.
//
// Owns: the menu and its arguments, the moves, inverse kinematics, the checks every task passes.
// Never: draws from anything but its own seeded generator; reads a clock.
#include "model/task.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <optional>

#include "model/arm_file.hpp"
#include "model/rbd.hpp"

namespace hdt {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double pi = 3.14159265358979323846;
constexpr double rest_s = 0.25;            // standing still before and after, so that filters settle
constexpr double clear_step_s = 0.02;      // clearance is looked at this often: 8 mm at 0.4 m/s
constexpr double samples_max = 2e6;        // 47 minutes at 700 Hz

[[noreturn]] void fail(const std::string &spec, const std::string &what)
{
    std::string line = "task '" + spec + "': " + what + "; tasks are";
    for (const TaskInfo &t : task_menu())
        line += std::string(&t == &task_menu().front() ? " " : " | ") + t.name + (*t.arguments ? ":" : "") +
                t.arguments;
    throw InputError(line);
}

std::string text(const char *format, double a, double b = 0, double c = 0)
{
    char buffer[160];
    std::snprintf(buffer, sizeof buffer, format, a, b, c);
    return buffer;
}

// SplitMix64: the same motion from the same seed on every machine.
class Random {
public:
    explicit Random(uint64_t seed) : state_(seed) {}
    double uniform(double lo, double hi)
    {
        uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return lo + (hi - lo) * static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
    }

private:
    uint64_t state_;
};

struct State { double q, v, a; };

// From one angle to another: ramps of ramp_s, cruise speed speed (less if the way is short).
struct Move {
    double start_s, from, to, speed, ramp_s;

    static Move make(double start_s, double from, double to, double speed, double ramp_s)
    {
        return {start_s, from, to, std::min(speed, std::fabs(to - from) / ramp_s), ramp_s};
    }
    double seconds() const { return speed > 0 ? ramp_s + std::fabs(to - from) / speed : 0; }
    double end_s() const { return start_s + seconds(); }
    State at(double t_s) const
    {
        const double t = t_s - start_s, total = seconds();
        if (t <= 0)
            return {from, 0, 0};
        if (t >= total)
            return {to, 0, 0};
        const double way = to > from ? 1 : -1;
        if (t > total - ramp_s) {
            const State back = ramp(total - t);
            return {to - way * back.q, way * back.v, -way * back.a};
        }
        if (t < ramp_s) {
            const State up = ramp(t);
            return {from + way * up.q, way * up.v, way * up.a};
        }
        return {from + way * speed * (t - ramp_s / 2), way * speed, 0};
    }

private:
    // speed times the minimum-jerk step 10 x^3 - 15 x^4 + 6 x^5 and its integral and derivative
    State ramp(double t) const
    {
        const double x = t / ramp_s, x2 = x * x, x3 = x2 * x;
        return {speed * ramp_s * x3 * x * (2.5 - 3 * x + x2), speed * x3 * (10 - 15 * x + 6 * x2),
                speed / ramp_s * 30 * x2 * (1 - x) * (1 - x)};
    }
};

// Moves of one joint in time order; stands still between them.
struct Track {
    double rest_rad = 0;
    std::vector<Move> moves;
    std::size_t cursor = 0;

    // Times must not go back by more than a move.
    State at(double t_s)
    {
        if (moves.empty())
            return {rest_rad, 0, 0};
        while (cursor + 1 < moves.size() && moves[cursor + 1].start_s <= t_s)
            ++cursor;
        return moves[cursor].at(t_s);
    }
    double end_rad() const { return moves.empty() ? rest_rad : moves.back().to; }
    double end_s() const { return moves.empty() ? rest_s : moves.back().end_s(); }
    void go(double to, double speed, double ramp_s, double pause_s = 0)
    {
        moves.push_back(Move::make(end_s() + pause_s, end_rad(), to, speed, ramp_s));
    }
};

// The task's text, cut up; every argument is asked for exactly once by a task that knows it.
class Spec {
public:
    Spec(const std::string &whole, int joints);
    const std::string &whole() const { return whole_; }
    const std::string &name() const { return name_; }
    double number(const std::string &key, double fallback, double lo, double hi);
    int joint(int fallback);               // 0-based; fallback 0-based or -1: required
    uint32_t joints();                     // bits; absent: all
    bool posed() const;
    VectorXd pose(const VectorXd &fallback);
    void done() const;                     // throws on an argument nobody asked for

private:
    std::string whole_, name_;
    int count_;
    std::map<std::string, std::string> args_;
    std::optional<std::string> take(const std::string &key);
    double parse(const std::string &key, const std::string &value, double lo, double hi) const;
};

Spec::Spec(const std::string &whole, int joints) : whole_(whole), count_(joints)
{
    const std::size_t colon = whole.find(':');
    name_ = whole.substr(0, colon);
    std::string last;
    std::size_t at = colon == std::string::npos ? whole.size() : colon + 1;
    while (at < whole.size()) {
        const std::size_t end = std::min(whole.find(',', at), whole.size());
        const std::string item = whole.substr(at, end - at);
        const std::size_t equals = item.find('=');
        if (equals != std::string::npos) {
            last = item.substr(0, equals);
            if (!args_.emplace(last, item.substr(equals + 1)).second)
                fail(whole, "argument '" + last + "' given twice");
        } else if (last.empty()) {
            fail(whole, "expected key=value, found '" + item + "'");
        } else {
            args_[last] += "," + item; // a list: joints=2,4
        }
        at = end + 1;
    }
}

std::optional<std::string> Spec::take(const std::string &key)
{
    const auto found = args_.find(key);
    if (found == args_.end())
        return std::nullopt;
    std::string value = found->second;
    args_.erase(found);
    return value;
}

double Spec::parse(const std::string &key, const std::string &value, double lo, double hi) const
{
    char *end = nullptr;
    const double x = std::strtod(value.c_str(), &end);
    if (value.empty() || *end != '\0' || !std::isfinite(x) || x < lo || x > hi)
        fail(whole_,
             key + ": expected a number" + text(" from %g to %g", lo, hi) + ", found '" + value + "'");
    return x;
}

double Spec::number(const std::string &key, double fallback, double lo, double hi)
{
    const auto value = take(key);
    return value ? parse(key, *value, lo, hi) : fallback;
}

int Spec::joint(int fallback)
{
    const auto value = take("joint");
    if (!value && fallback < 0)
        fail(whole_, "joint= is missing");
    const double x = value ? parse("joint", *value, 1, count_) : fallback + 1;
    if (x != std::floor(x) || x > count_)
        fail(whole_, "joint: expected a whole number" + text(" from 1 to %g", count_));
    return static_cast<int>(x) - 1;
}

uint32_t Spec::joints()
{
    const auto value = take("joints");
    if (!value)
        return static_cast<uint32_t>((uint64_t{1} << count_) - 1);
    uint32_t bits = 0;
    for (std::size_t at = 0; at <= value->size();) {
        const std::size_t end = std::min(value->find(',', at), value->size());
        const double x = parse("joints", value->substr(at, end - at), 1, count_);
        if (x != std::floor(x))
            fail(whole_, "joints: expected whole numbers");
        bits |= 1u << (static_cast<unsigned>(x) - 1);
        at = end + 1;
    }
    return bits;
}

bool Spec::posed() const
{
    return std::any_of(args_.begin(), args_.end(), [](const auto &a) { return a.first[0] == 'q'; });
}

VectorXd Spec::pose(const VectorXd &fallback)
{
    VectorXd q = fallback;
    for (int j = 0; j < count_; ++j)
        q[j] = number("q" + std::to_string(j + 1), q[j], -4 * pi, 4 * pi);
    return q;
}

void Spec::done() const
{
    if (!args_.empty())
        fail(whole_, "unknown argument '" + args_.begin()->first + "'");
}

const hdt_arm_joint &joint_of(const hdt_arm &arm, Eigen::Index j) { return arm.joint[j]; }

// The part of a joint's range a task may use: a share of it about the middle.
struct Range { double lo, hi; };

Range share_of_range(const hdt_arm_joint &k, double share)
{
    const double mid = (k.q_min_rad + k.q_max_rad) / 2, half = share * (k.q_max_rad - k.q_min_rad) / 2;
    return {mid - half, mid + half};
}

// Zero where the joint's range has zero well inside, else the middle of the range.
VectorXd neutral_pose(const hdt_arm &arm)
{
    VectorXd q(arm.joints);
    for (Eigen::Index j = 0; j < q.size(); ++j) {
        const Range r = share_of_range(joint_of(arm, j), 0.6);
        q[j] = r.lo < 0 && r.hi > 0 ? 0 : (r.lo + r.hi) / 2;
    }
    return q;
}

// Does the arm stay above its mounting plane and off its own base?  Looks at the joint origins that
// can move, the flange, and points between them; the links' thickness is the margin.
class Clearance {
public:
    explicit Clearance(const hdt_arm &arm) : arm_(arm)
    {
        Random random(1);
        const auto home = rbd::frames(arm, VectorXd::Zero(arm.joints));
        moves_.assign(home.size(), false);
        for (int k = 0; k < 4; ++k) {
            VectorXd q(arm.joints);
            for (double &x : q)
                x = random.uniform(-3, 3);
            const auto f = rbd::frames(arm, q);
            for (std::size_t i = 0; i < f.size(); ++i)
                if ((f[i].pos - home[i].pos).norm() > 1e-3)
                    moves_[i] = true;
        }
        for (std::size_t i = 0; i < home.size(); ++i)
            if (!moves_[i])
                column_top_m_ = std::max(column_top_m_, home[i].pos.z());
    }
    bool clear(const VectorXd &q) const
    {
        const auto f = rbd::frames(arm_, q);
        for (std::size_t i = 0; i < f.size(); ++i) {
            if (!moves_[i])
                continue;
            const Vector3d &from = i > 0 && moves_[i - 1] ? f[i - 1].pos : f[i].pos;
            for (int part = 1; part <= 4; ++part)
                if (!point_clear(from + (f[i].pos - from) * (part / 4.0)))
                    return false;
        }
        return true;
    }

private:
    static constexpr double floor_m = 0.05, column_m = 0.2;
    const hdt_arm &arm_;
    std::vector<bool> moves_;
    double column_top_m_ = 0;

    bool point_clear(const Vector3d &p) const
    {
        return p.z() >= floor_m && (p.z() >= column_top_m_ || std::hypot(p.x(), p.y()) >= column_m);
    }
};

Reference empty_reference(const hdt_arm &arm, const Spec &spec, double rate_hz, double seconds)
{
    // a rounding error is no reason for one more sample
    const double samples = std::ceil(seconds * rate_hz - 1e-6) + 1;
    if (!(samples <= samples_max))
        fail(spec.whole(),
             text("%.0f s at %g Hz is too long: at most %.0f samples", seconds, rate_hz, samples_max));
    Reference r;
    r.rate_hz = rate_hz;
    r.name = spec.whole();
    r.q_rad.setZero(static_cast<Eigen::Index>(samples), arm.joints);
    r.v_radps = r.q_rad;
    r.a_radps2 = r.q_rad;
    return r;
}

Reference sample_tracks(const hdt_arm &arm, const Spec &spec, double rate_hz, std::vector<Track> tracks,
                        double at_least_s = 0)
{
    double end = at_least_s;
    for (const Track &t : tracks)
        end = std::max(end, t.end_s() + rest_s);
    Reference r = empty_reference(arm, spec, rate_hz, end);
    for (Eigen::Index j = 0; j < arm.joints; ++j)
        for (Eigen::Index i = 0; i < r.q_rad.rows(); ++i) {
            const State s = tracks[static_cast<std::size_t>(j)].at(static_cast<double>(i) / rate_hz);
            r.q_rad(i, j) = s.q;
            r.v_radps(i, j) = s.v;
            r.a_radps2(i, j) = s.a;
        }
    return r;
}

std::vector<Track> standing(const VectorXd &q)
{
    std::vector<Track> tracks(static_cast<std::size_t>(q.size()));
    for (Eigen::Index j = 0; j < q.size(); ++j)
        tracks[static_cast<std::size_t>(j)].rest_rad = q[j];
    return tracks;
}

void check_limits(const hdt_arm &arm, const Reference &r)
{
    for (Eigen::Index j = 0; j < arm.joints; ++j) {
        const hdt_arm_joint &k = joint_of(arm, j);
        const std::string who = "joint " + std::to_string(j + 1);
        const double lo = r.q_rad.col(j).minCoeff(), hi = r.q_rad.col(j).maxCoeff(),
                     v = r.v_radps.col(j).cwiseAbs().maxCoeff();
        if (lo < k.q_min_rad || hi > k.q_max_rad)
            fail(r.name, who + text(" would go to %.3f rad", lo < k.q_min_rad ? lo : hi) +
                             text(", its limits are %.3f to %.3f rad", k.q_min_rad, k.q_max_rad));
        if (v > k.v_max_radps)
            fail(r.name, who + text(" would move at %.3f rad/s, its limit is %.3f rad/s", v, k.v_max_radps));
    }
}

void check_clear(const hdt_arm &arm, const Reference &r)
{
    const Clearance clearance(arm);
    const Eigen::Index step = std::max<Eigen::Index>(1, static_cast<Eigen::Index>(clear_step_s * r.rate_hz));
    for (Eigen::Index i = 0; i < r.q_rad.rows(); i += step)
        if (!clearance.clear(r.q_rad.row(i).transpose()))
            fail(r.name, text("at %.2f s the arm would come within 0.05 m of its mounting plane or touch its "
                              "base; choose another pose (q1=, q2=, ...)",
                              static_cast<double>(i) / r.rate_hz));
}

// ---- lemniscate ----

// eq. (14) and its first two derivatives by u
struct PathPoint { Vector3d p, dp, ddp; };

PathPoint path_point(double u)
{
    // y = 0.2 c/D, z - 0.1 = 0.2 sin(u)/D with D = 1 + sin(u/2)^2 = (3 - cos u)/2
    const double c = std::cos(u / 2), s = std::sin(u / 2), su = std::sin(u), cu = std::cos(u);
    const double d = (3 - cu) / 2, d1 = su / 2, d2 = cu / 2;
    const auto quotient = [&](double n, double n1, double n2) {
        const double f = n / d, f1 = (n1 - f * d1) / d;
        return std::array<double, 3>{f, f1, (n2 - 2 * f1 * d1 - f * d2) / d};
    };
    const auto y = quotient(0.2 * c, -0.1 * s, -0.05 * c), z = quotient(0.2 * su, 0.2 * cu, -0.2 * su);
    return {{0.6, y[0], 0.1 + z[0]}, {0, y[1], z[1]}, {0, y[2], z[2]}};
}

std::vector<int> bits_of(uint32_t bits, int count)
{
    std::vector<int> out;
    for (int j = 0; j < count; ++j)
        if (bits >> j & 1)
            out.push_back(j);
    return out;
}

MatrixXd columns(const MatrixXd &m, const std::vector<int> &which)
{
    MatrixXd out(m.rows(), static_cast<Eigen::Index>(which.size()));
    for (std::size_t k = 0; k < which.size(); ++k)
        out.col(static_cast<Eigen::Index>(k)) = m.col(which[k]);
    return out;
}

// What is left to go from here to the pose: metres, then a rotation vector, both in the base frame.
VectorXd pose_error(const rbd::Pose &here, const Matrix3d &rot, const Vector3d &pos)
{
    const Eigen::AngleAxisd turn(rot * here.rot.transpose());
    VectorXd e(6);
    e << pos - here.pos, turn.angle() * turn.axis();
    return e;
}

// Damped Newton (Levenberg) on the free joints; the error left is returned in *left.
VectorXd newton(const hdt_arm &arm, const Matrix3d &rot, const Vector3d &pos, VectorXd q,
                const std::vector<int> &free, double *left)
{
    double damping = 1e-4;
    VectorXd e = pose_error(rbd::flange(arm, q), rot, pos);
    for (int i = 0; i < 200 && e.norm() > 1e-14; ++i) {
        const MatrixXd j = columns(rbd::jacobian(arm, q), free);
        MatrixXd a = j * j.transpose();
        a.diagonal().array() += damping;
        VectorXd step = j.transpose() * a.ldlt().solve(e);
        step *= std::min(1.0, 0.5 / std::max(step.cwiseAbs().maxCoeff(), 1e-300));
        VectorXd next = q;
        for (std::size_t k = 0; k < free.size(); ++k)
            next[free[k]] += step[static_cast<Eigen::Index>(k)];
        const VectorXd rest = pose_error(rbd::flange(arm, next), rot, pos);
        if (rest.norm() < e.norm()) {
            q = next;
            e = rest;
            damping = std::max(damping * 0.05, 1e-14);
        } else if ((damping = std::max(damping, 1e-12) * 10) > 1e3) {
            break; // no step helps: at a minimum, or at the last bit
        }
    }
    *left = e.norm();
    return q;
}

constexpr double pose_tolerance = 1e-11;

bool inside_limits(const hdt_arm &arm, const VectorXd &q)
{
    for (Eigen::Index j = 0; j < q.size(); ++j)
        if (q[j] < joint_of(arm, j).q_min_rad || q[j] > joint_of(arm, j).q_max_rad)
            return false;
    return true;
}

// Every way to reach the pose that random starts find, the best first: elbow highest, then the one
// that turns the joints least.
std::vector<VectorXd> all_solutions(const hdt_arm &arm, const Matrix3d &rot, const Vector3d &pos,
                                    uint32_t free)
{
    struct Found { VectorXd q; double height_m; };
    std::vector<Found> found;
    Random random(14);
    const std::vector<int> which = bits_of(free, arm.joints);
    for (int k = 0; k < 150; ++k) {
        VectorXd q = VectorXd::Zero(arm.joints);
        for (int j : which)
            q[j] = random.uniform(std::max(-pi, arm.joint[j].q_min_rad),
                                  std::min(pi, arm.joint[j].q_max_rad));
        double left;
        q = newton(arm, rot, pos, q, which, &left);
        if (left > pose_tolerance)
            continue;
        for (int j : which)
            q[j] = std::remainder(q[j], 2 * pi);
        if (!inside_limits(arm, q))
            continue;
        double top = -std::numeric_limits<double>::infinity();
        for (const rbd::Pose &p : rbd::frames(arm, q))
            top = std::max(top, p.pos.z());
        const auto same = [&](const Found &f) { return (f.q - q).cwiseAbs().maxCoeff() < 1e-6; };
        if (std::none_of(found.begin(), found.end(), same))
            found.push_back({q, std::round(top * 100) / 100});
    }
    std::sort(found.begin(), found.end(), [](const Found &a, const Found &b) {
        return a.height_m != b.height_m ? a.height_m > b.height_m : a.q.squaredNorm() < b.q.squaredNorm();
    });
    std::vector<VectorXd> out;
    for (const Found &f : found)
        out.push_back(f.q);
    return out;
}

// d/du of (J q') along q' at constant q': the part of the second derivative that q'' does not make.
VectorXd curvature(const hdt_arm &arm, const VectorXd &q, const VectorXd &dq)
{
    const double size = dq.norm();
    if (size == 0)
        return VectorXd::Zero(6);
    const double h = 1e-3 / size;
    const auto f = [&](double k) -> VectorXd { return rbd::jacobian(arm, q + k * h * dq) * dq; };
    return (8 * (f(1) - f(-1)) - (f(2) - f(-2))) / (12 * h);
}

Reference follow_path(const hdt_arm &arm, const Spec &spec, double rate_hz, VectorXd q, uint32_t free,
                      double laps)
{
    const Move along = Move::make(rest_s, 0, laps * 4 * pi, 1, 1.5);
    Reference r = empty_reference(arm, spec, rate_hz, along.end_s() + rest_s);
    r.active = free;
    const std::vector<int> which = bits_of(free, arm.joints);
    for (Eigen::Index i = 0; i < r.q_rad.rows(); ++i) {
        const State u = along.at(static_cast<double>(i) / rate_hz);
        const PathPoint p = path_point(u.q);
        double left;
        const VectorXd before = q;
        q = newton(arm, lemniscate_rot(), p.p, q, which, &left);
        // a jump to another branch is no path either
        if (left > pose_tolerance || (i > 0 && (q - before).cwiseAbs().maxCoeff() > 0.2))
            fail(spec.whole(), text("the arm cannot follow eq. (14) at u = %.2f s", u.q));
        const auto solver = columns(rbd::jacobian(arm, q), which).colPivHouseholderQr();
        const auto spread = [&](const Vector3d &linear, const VectorXd &minus) {
            VectorXd rhs = -minus;
            rhs.head<3>() += linear;
            const VectorXd x = solver.solve(rhs);
            VectorXd out = VectorXd::Zero(arm.joints);
            for (std::size_t k = 0; k < which.size(); ++k)
                out[which[k]] = x[static_cast<Eigen::Index>(k)];
            return out;
        };
        const VectorXd dq = spread(p.dp, VectorXd::Zero(6));
        const VectorXd ddq = spread(p.ddp, curvature(arm, q, dq));
        r.q_rad.row(i) = q.transpose();
        r.v_radps.row(i) = dq.transpose() * u.v;
        r.a_radps2.row(i) = (ddq * u.v * u.v + dq * u.a).transpose();
    }
    check_limits(arm, r);
    return r;
}

Reference lemniscate(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    const double laps = spec.number("laps", 1, 1, 100);
    spec.done();
    if (laps != std::floor(laps))
        fail(spec.whole(), "laps: expected a whole number");
    if (arm.joints != 6 && arm.joints != 7)
        fail(spec.whole(),
             text("needs six joints, or seven with joint 3 locked; the arm has %g", arm.joints));
    // paper section V-A: joint 3 is locked
    const uint32_t free = arm.joints == 7 ? 0x7bu : 0x3fu;
    std::string why;
    for (const VectorXd &q : all_solutions(arm, lemniscate_rot(), lemniscate_m(0), free)) {
        try {
            return follow_path(arm, spec, rate_hz, q, free, laps);
        } catch (const InputError &e) {
            // another way round may do; if none does, the best one's trouble is the one to tell
            if (why.empty())
                why = e.what();
        }
    }
    if (!why.empty())
        throw InputError(why);
    fail(spec.whole(),
         "the arm does not reach the start of eq. (14), (0.6, 0.2, 0.1) m with the tool along x");
}

// ---- joint-space tasks ----

constexpr double ramp_s = 0.4;

// One more move for joint j: log-uniform speed, either way, inside its range.
Move draw_move(Random &random, const Track &track, double now_s, double end_s, Range range, double v_max)
{
    const double speed = std::exp(random.uniform(std::log(0.01), std::log(std::min(0.4, 0.9 * v_max))));
    const double seconds = std::min(random.uniform(1.5, 8), end_s - now_s), from = track.end_rad();
    const double length = speed * (seconds - ramp_s), way = random.uniform(0, 1) < 0.5 ? -1 : 1;
    double to = from + way * length;
    if (to < range.lo || to > range.hi)
        to = from - way * length;
    return Move::make(now_s, from, std::clamp(to, range.lo, range.hi), speed, ramp_s);
}

// Is the whole plan clear from now on, every joint finishing its last move and then standing?
bool plan_clear(const Clearance &clearance, const std::vector<Track> &tracks, double now_s)
{
    double end = now_s;
    for (const Track &t : tracks)
        end = std::max(end, t.end_s());
    VectorXd q(static_cast<Eigen::Index>(tracks.size()));
    for (double t = now_s;; t += clear_step_s) {
        for (std::size_t j = 0; j < tracks.size(); ++j)
            q[static_cast<Eigen::Index>(j)] = tracks[j].moves.empty() ? tracks[j].rest_rad
                                                                      : tracks[j].moves.back().at(t).q;
        if (!clearance.clear(q))
            return false;
        if (t > end)
            return true;
    }
}

// All joints move at once and independently.  The plan is always one that may stand still after the
// moves it has, so a joint that finds no clear move waits and nothing is ever stuck.
Reference excite(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    const double seed = spec.number("seed", 1, 0, 9e15), seconds = spec.number("seconds", 40, 5, 3600);
    const uint32_t active = spec.joints();
    const VectorXd home = spec.pose(neutral_pose(arm));
    spec.done();
    const double end = seconds - rest_s, shortest_s = 1;
    const Clearance clearance(arm);
    if (!clearance.clear(home))
        fail(spec.whole(),
             "the start pose touches the mounting plane or the base; choose another (q1=, q2=, ...)");
    Random random(static_cast<uint64_t>(seed));
    std::vector<Track> tracks = standing(home);
    struct Turn { double when_s; Eigen::Index joint; Range range; };
    std::vector<Turn> turns;
    for (int j : bits_of(active, arm.joints)) {
        const Range r = share_of_range(arm.joint[j], 0.6);
        turns.push_back({rest_s, j, {std::max(r.lo, home[j] - 1.5), std::min(r.hi, home[j] + 1.5)}});
        if (!(home[j] >= r.lo && home[j] <= r.hi))
            fail(spec.whole(), text("q%g must lie in the middle 60 %% of its range, %.3f to %.3f rad",
                                    j + 1.0, r.lo, r.hi));
    }
    for (;;) {
        Turn &turn = *std::min_element(turns.begin(), turns.end(),
                                       [](const Turn &a, const Turn &b) { return a.when_s < b.when_s; });
        if (turn.when_s > end - shortest_s)
            break;
        Track &track = tracks[static_cast<std::size_t>(turn.joint)];
        bool moved = false;
        for (int attempt = 0; attempt < 30 && !moved; ++attempt) {
            track.moves.push_back(draw_move(random, track, turn.when_s, end, turn.range,
                                            joint_of(arm, turn.joint).v_max_radps));
            moved = plan_clear(clearance, tracks, turn.when_s);
            if (!moved)
                track.moves.pop_back();
        }
        const double pause = random.uniform(0, 1) < 0.5 ? 0 : random.uniform(0.05, 0.4);
        turn.when_s = moved ? track.end_s() + pause : turn.when_s + 0.5;
    }
    Reference r = sample_tracks(arm, spec, rate_hz, tracks, seconds);
    r.active = active;
    return r;
}

// Paper section IV-D: -90 to +90 deg and back at constant speed, or as much of it as is allowed.
Reference sweep(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    const int j = spec.joint(-1);
    const double speed = spec.number("speed", 0.1, 0.001, 10);
    const VectorXd pose = spec.pose(neutral_pose(arm));
    spec.done();
    const Clearance clearance(arm);
    const Range range = share_of_range(arm.joint[j], 0.98);
    const double step = pi / 180, mid = std::clamp(pose[j], range.lo, range.hi);
    const auto reach = [&](double goal) {
        VectorXd q = pose;
        double at = mid;
        for (q[j] = at; std::fabs(goal - at) > 1e-9; at = q[j]) {
            q[j] = goal > at ? std::min(at + step, goal) : std::max(at - step, goal);
            if (!clearance.clear(q))
                break;
        }
        return at;
    };
    const double lo = reach(std::max(-pi / 2, range.lo)), hi = reach(std::min(pi / 2, range.hi));
    if (hi - lo < 4 * speed * ramp_s)
        fail(spec.whole(),
             text("only %.3f to %.3f rad is free; choose another pose (q1=, q2=, ...)", lo, hi));
    std::vector<Track> tracks = standing(pose);
    Track &track = tracks[static_cast<std::size_t>(j)];
    track.rest_rad = lo;
    track.go(hi, speed, ramp_s);
    track.go(lo, speed, ramp_s, rest_s);
    Reference r = sample_tracks(arm, spec, rate_hz, tracks);
    r.active = 1u << j;
    return r;
}

// Paper section III: mean torque at each of eight speeds, both ways.  At least four whole turns of
// the wave generator at constant speed, so that periodic friction averages out.
Reference friction(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    static const double speeds[] = {0.02, 0.04, 0.06, 0.08, 0.1, 0.2, 0.3, 0.4};
    const int j = spec.joint(-1);
    const double trials = std::floor(spec.number("trials", 1, 1, 20));
    const VectorXd pose = spec.pose(neutral_pose(arm));
    spec.done();
    const double turns = 4 * 2 * pi / std::max(arm.joint[j].ratio, 1.0);
    const double half = turns / 2 + speeds[7] * ramp_s / 2;
    std::vector<Track> tracks = standing(pose);
    Track &track = tracks[static_cast<std::size_t>(j)];
    track.rest_rad = pose[j] - half;
    for (double trial = 0; trial < trials; ++trial)
        for (double v : speeds) {
            track.go(pose[j] + half, v, ramp_s, 0.2);
            track.go(pose[j] - half, v, ramp_s, 0.2);
        }
    Reference r = sample_tracks(arm, spec, rate_hz, tracks);
    r.active = 1u << j;
    return r;
}

// The pose in which gravity loads joint j most: coordinate search from several starts, then every
// joint that hardly matters (2 % in all) back to its neutral angle.
VectorXd heaviest_pose(const hdt_arm &arm, int j, const Clearance &clearance)
{
    const VectorXd neutral = neutral_pose(arm);
    const auto load = [&](const VectorXd &q) { return std::fabs(rbd::gravity(arm, q)[j]); };
    Random random(3);
    VectorXd best = neutral;
    double most = load(best);
    for (int start = 0; start < 16; ++start) {
        VectorXd q = neutral;
        for (Eigen::Index k = 0; k < q.size(); ++k) {
            const Range r = share_of_range(joint_of(arm, k), 0.97);
            q[k] = random.uniform(std::max(r.lo, -pi / 2), std::min(r.hi, pi / 2));
        }
        double here = clearance.clear(q) ? load(q) : 0;
        for (int round = 0; round < 6; ++round)
            for (Eigen::Index k = 0; k < q.size(); ++k) {
                const Range r = share_of_range(joint_of(arm, k), 0.97);
                for (int part = -36; part <= 36; ++part) {
                    VectorXd next = q;
                    next[k] = std::clamp(part * pi / 36, r.lo, r.hi);
                    const double there = load(next);
                    if (there > here * (1 + 1e-9) + 1e-9 && clearance.clear(next)) {
                        q = next;
                        here = there;
                    }
                }
            }
        if (here > most * (1 + 1e-6)) {
            best = q;
            most = here;
        }
    }
    for (Eigen::Index k = 0; k < best.size(); ++k) {
        VectorXd q = best;
        q[k] = neutral[k];
        if (clearance.clear(q) && load(q) >= most * 0.98)
            best = q;
    }
    return best;
}

// Paper section V-A, joint 3: 1.0 rad at 0.1 rad/s, starting where gravity loads the joint most.
Reference trapezoid(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    const int j = spec.joint(2);
    const double distance = spec.number("distance", 1.0, -4 * pi, 4 * pi);
    const double speed = spec.number("speed", 0.1, 0.001, 10);
    const bool posed = spec.posed();
    const auto massless = [](const hdt_arm_joint &k) { return !k.has_inertial; };
    if (!posed && std::all_of(arm.joint, arm.joint + arm.joints, massless))
        fail(spec.whole(),
             "the model has no masses, so its heaviest pose is not known; give the pose (q1=, q2=, ...)");
    const Clearance clearance(arm);
    const VectorXd pose = spec.pose(posed ? neutral_pose(arm) : heaviest_pose(arm, j, clearance));
    spec.done();
    // the other way if this one is not free
    for (const double way : {1.0, -1.0}) {
        std::vector<Track> tracks = standing(pose);
        tracks[static_cast<std::size_t>(j)].go(pose[j] + way * distance, speed, ramp_s);
        Reference r = sample_tracks(arm, spec, rate_hz, tracks);
        r.active = 1u << j;
        try {
            check_limits(arm, r);
            check_clear(arm, r);
            return r;
        } catch (const InputError &) {
            if (way < 0)
                throw;
        }
    }
    fail(spec.whole(), "no way is free");
}

Reference hold(const hdt_arm &arm, Spec &spec, double rate_hz)
{
    const double seconds = spec.number("seconds", 10, 0.1, 36000);
    const VectorXd pose = spec.pose(neutral_pose(arm));
    spec.done();
    Reference r = empty_reference(arm, spec, rate_hz, seconds);
    r.q_rad.rowwise() = pose.transpose();
    r.active = static_cast<uint32_t>((uint64_t{1} << arm.joints) - 1);
    return r;
}

struct MenuEntry { TaskInfo info; Reference (*make)(const hdt_arm &, Spec &, double); bool keeps_clear; };

const std::vector<MenuEntry> &entries()
{
    static const std::vector<MenuEntry> all = {
        {{"lemniscate", "laps=1", "the figure eight of paper eq. (14), tool along x, joint 3 locked"},
         lemniscate,
         false},
        {{"excite", "seed=1,seconds=40,joints=1,2..,q1=..",
          "all joints at once, random moves at 0.01 to 0.4 rad/s"},
         excite,
         true},
        {{"sweep", "joint=J,speed=0.1,q1=..",
          "-90 to +90 deg and back at constant speed, paper section IV-D"},
         sweep,
         true},
        {{"friction", "joint=J,trials=1,q1=..",
          "eight speeds 0.02 to 0.4 rad/s both ways, paper section III"},
         friction,
         true},
        {{"trapezoid", "joint=3,distance=1,speed=0.1,q1=..",
          "one move from the heaviest pose, paper section V-A"},
         trapezoid,
         true},
        {{"hold", "seconds=10,q1=..", "stand still"}, hold, false},
    };
    return all;
}

} // namespace

const std::vector<TaskInfo> &task_menu()
{
    static const std::vector<TaskInfo> menu = [] {
        std::vector<TaskInfo> m;
        for (const MenuEntry &e : entries())
            m.push_back(e.info);
        return m;
    }();
    return menu;
}

Vector3d lemniscate_m(double u_s) { return path_point(u_s).p; }

Matrix3d lemniscate_rot()
{
    Matrix3d rot;
    rot << 0, 0, 1, 0, 1, 0, -1, 0, 0;
    return rot;
}

VectorXd inverse_kinematics(const hdt_arm &arm, const Matrix3d &rot, const Vector3d &pos,
                            const VectorXd &seed, uint32_t free)
{
    double left;
    const VectorXd q = newton(arm, rot, pos, seed, bits_of(free, arm.joints), &left);
    if (left > pose_tolerance)
        throw InputError(text("inverse kinematics: (%.3f, %.3f, %.3f) m", pos.x(), pos.y(), pos.z()) +
                         text(" in this orientation is out of reach: %.3g (m, rad) is left; move it nearer "
                              "or free more joints",
                              left));
    return q;
}

Reference make_task(const hdt_arm &arm, const std::string &spec, double rate_hz)
{
    if (!(rate_hz >= 10 && rate_hz <= 20000))
        fail(spec, text("control rate: expected 10 to 20000 Hz, found %g", rate_hz));
    Spec cut(spec, arm.joints);
    for (const MenuEntry &e : entries())
        if (cut.name() == e.info.name) {
            Reference r = e.make(arm, cut, rate_hz);
            check_limits(arm, r);
            if (e.keeps_clear)
                check_clear(arm, r);
            return r;
        }
    fail(spec, "unknown task '" + cut.name() + "'");
}

} // namespace hdt
