// SPDX-License-Identifier: Apache-2.0
//
// Owns: block signals, candidate columns (see effects.hpp).
// Never: estimates or decides.
#include "model/effects.hpp"

#include <algorithm>
#include <cmath>
#include <thread>

#include "model/rbd.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index kKnots = 8;
constexpr double kMoves_rad = 0.05;
constexpr double kPayloadReach_m = 0.4; // no tool's centre of mass lies further from the flange
// sigma of delay; speed that doubles ripple
constexpr double kHealthyDelay_s = 0.003, kHealthySpeed_radps = 0.2;
constexpr double kBumpWidth_rad[] = {0.04, 0.08, 0.16};
constexpr double kStepWidth_nm[] = {6, 15};
constexpr double kHealthyRise_s = 0.25; // ripple rising by this share of Coulomb friction per rad/s
constexpr double kLateStep_s = 0.01;
constexpr Index kLateSteps = 4;
constexpr std::size_t kPlaces = 3;      // of a search, weighed in full
// beyond these it is something else: a loss that eats the load, a gain no sensor is off by, a slipped joint
constexpr double kLossMost = 0.9, kGainMost = 0.5, kAngleMost_rad = 0.2;
constexpr double kTwoPi = 6.283185307179586;

// Columns of the chain at each block's mean state, all joints at once.
struct ChainColumns { std::vector<MatrixXd> body, own, link, tilt, mass; MatrixXd dgdq; };

// Inertial numbers of a link in the regressor's order.
Eigen::Matrix<double, 10, 1> declared(const hdt_arm_joint &j)
{
    Eigen::Matrix<double, 10, 1> out;
    out << j.mass_kg, Eigen::Map<const Eigen::Vector3d>(j.moment_kgm),
        Eigen::Map<const Eigen::Matrix<double, 6, 1>>(j.inertia_kgm2);
    return j.has_inertial ? out : Eigen::Matrix<double, 10, 1>::Zero();
}

void chain_at(const hdt_arm &arm, const VectorXd &q, const VectorXd &v, const VectorXd &a, Index row,
              ChainColumns *out)
{
    const MatrixXd reg = rbd::regressor(arm, q, v, a);
    hdt_arm tilted = arm;
    VectorXd tilt[2];
    const double *g = arm.gravity_mps2;
    const double turned[2][3] = {{0, -g[2], g[1]}, {g[2], 0, -g[0]}}; // x cross g, y cross g
    for (int k = 0; k < 2; ++k) {
        std::copy(turned[k], turned[k] + 3, tilted.gravity_mps2);
        tilt[k] = rbd::gravity(tilted, q);
    }
    hdt_arm afloat = arm;
    std::fill(afloat.gravity_mps2, afloat.gravity_mps2 + 3, 0.0);
    const VectorXd still = VectorXd::Zero(q.size());
    for (Index j = 0; j < q.size(); ++j) {
        const VectorXd column = rbd::inverse_dynamics(afloat, q, still, VectorXd::Unit(q.size(), j));
        for (Index i = 0; i < q.size(); ++i)
            out->mass[static_cast<std::size_t>(i)](row, j) = column[i];
    }
    constexpr double dq = 1e-4;
    for (Index j = 0; j < q.size(); ++j) {
        const auto k = static_cast<std::size_t>(j);
        out->body[k].row(row) = reg.block(j, reg.cols() - 10, 1, 4);
        out->own[k].row(row) = reg.block(j, 10 * j + 1, 1, 2);
        for (Index l = j; l < q.size(); ++l)
            out->link[k](row, l) = reg.block(j, 10 * l, 1, 10).row(0).dot(declared(arm.joint[l]));
        out->tilt[k](row, 0) = tilt[0][j];
        out->tilt[k](row, 1) = tilt[1][j];
        VectorXd up = q, down = q;
        up[j] += dq;
        down[j] -= dq;
        out->dgdq(row, j) = (rbd::gravity(arm, up)[j] - rbd::gravity(arm, down)[j]) / (2 * dq);
    }
}

ChainColumns chain_columns(const hdt_arm &arm, const Conditioned &c)
{
    const Index blocks = static_cast<Index>(c.block_begin.size()) - 1, n = arm.joints;
    ChainColumns out;
    const auto joints = static_cast<std::size_t>(n);
    out.body.assign(joints, MatrixXd::Zero(blocks, 4));
    out.own.assign(joints, MatrixXd::Zero(blocks, 2));
    out.link.assign(joints, MatrixXd::Zero(blocks, n));
    out.tilt.assign(joints, MatrixXd::Zero(blocks, 2));
    out.mass.assign(joints, MatrixXd::Zero(blocks, n));
    out.dgdq = MatrixXd::Zero(blocks, n);
    const auto part = [&](Index lo, Index hi) {
        for (Index b = lo; b < hi; ++b) {
            const Index begin = c.block_begin[static_cast<std::size_t>(b)];
            const Index rows = c.block_begin[static_cast<std::size_t>(b) + 1] - begin;
            const auto mean = [&](const MatrixXd &m) -> VectorXd {
                return m.middleRows(begin, rows).colwise().mean().transpose();
            };
            chain_at(arm, mean(c.q), mean(c.v), mean(c.a), b, &out);
        }
    };
    // blocks are independent: the split changes no digit
    const Index parts = std::clamp<Index>(static_cast<Index>(std::thread::hardware_concurrency()), 1, 8);
    std::vector<std::thread> pool;
    for (Index p = 1; p < parts; ++p)
        pool.emplace_back(part, blocks * p / parts, blocks * (p + 1) / parts);
    part(0, blocks / parts);
    for (std::thread &t : pool)
        t.join();
    return out;
}

MatrixXd best_acceleration(const Conditioned &c, const Run &run)
{
    MatrixXd a = c.a;
    for (std::size_t j = 0; j < run.joint.size(); ++j) {
        const std::vector<double> &ref = run.joint[j].aref_radps2;
        if (ref.size() == run.rows() && static_cast<Index>(run.rows()) == a.rows())
            a.col(static_cast<Index>(j)) = Eigen::Map<const VectorXd>(ref.data(), a.rows());
    }
    return a;
}

MatrixXd take(const MatrixXd &m, const std::vector<Index> &rows)
{
    MatrixXd out(static_cast<Index>(rows.size()), m.cols());
    for (Index i = 0; i < out.rows(); ++i)
        out.row(i) = m.row(rows[static_cast<std::size_t>(i)]);
    return out;
}

// Linear hats on knots, flat outside them, times a sign.
MatrixXd hats(const VectorXd &x, const VectorXd &sign, const std::vector<double> &knots)
{
    const Index k = static_cast<Index>(knots.size());
    MatrixXd m = MatrixXd::Zero(x.size(), k);
    const double step = knots[1] - knots[0];
    for (Index t = 0; t < x.size(); ++t) {
        const double s = std::clamp((x[t] - knots.front()) / step, 0.0, static_cast<double>(k - 1));
        const Index i = std::min<Index>(static_cast<Index>(s), k - 2);
        const double w = s - static_cast<double>(i);
        m(t, i) = (1 - w) * sign[t];
        m(t, i + 1) = w * sign[t];
    }
    return m;
}

// Rate of the declared torque over unbroken blocks, N.m/s; zero elsewhere.
VectorXd torque_rate(const BlockRows &b)
{
    VectorXd rate = VectorXd::Zero(b.size());
    for (Index t = 1; t + 1 < b.size(); ++t) {
        const auto i = static_cast<std::size_t>(t);
        if (b.block[i + 1] == b.block[i] + 1 && b.block[i - 1] == b.block[i] - 1)
            rate[t] = (b.total[t + 1] - b.total[t - 1]) / (2 * b.block_s);
    }
    return rate;
}

using Signal = std::function<VectorXd(const BlockRows &)>;

// An axis: any smooth curve over a signal, times direction if directed.
void add_axis(std::vector<Family> *out, const std::vector<BlockRows> &runs, const std::string &name,
              const std::vector<std::string> &depends_on, const Signal &signal, bool directed)
{
    std::vector<double> all;
    for (const BlockRows &b : runs) {
        const VectorXd x = signal(b);
        all.insert(all.end(), x.data(), x.data() + x.size());
    }
    if (all.size() < 100)
        return;
    const auto at = [&](double share) {
        const auto i = static_cast<std::ptrdiff_t>(share * static_cast<double>(all.size() - 1));
        std::nth_element(all.begin(), all.begin() + i, all.end());
        return all[static_cast<std::size_t>(i)];
    };
    const double lo = at(0.01), hi = at(0.99);
    if (!(hi - lo > 1e-6 * (std::abs(lo) + std::abs(hi)) + 1e-9))
        return;
    Family f;
    f.id = "unnamed";
    f.axis = directed ? name + ",direction" : name;
    f.depends_on = depends_on;
    if (directed)
        f.depends_on.push_back("direction");
    f.grid = {{}};
    for (Index k = 0; k < kKnots; ++k)
        f.knots.push_back(lo + (hi - lo) * static_cast<double>(k) / static_cast<double>(kKnots - 1));
    f.columns = [signal, directed, knots = f.knots](const BlockRows &b, Point) {
        return hats(signal(b), directed ? b.dir : VectorXd::Ones(b.size()), knots);
    };
    f.roughness = MatrixXd::Zero(kKnots, kKnots);
    for (Index k = 0; k + 2 < kKnots; ++k) {
        VectorXd d = VectorXd::Zero(kKnots);
        d.segment(k, 3) << 1, -2, 1;
        f.roughness += d * d.transpose();
    }
    out->push_back(std::move(f));
}

void add(std::vector<Family> *out, const std::string &id, const std::vector<std::string> &depends_on,
         const std::vector<Point> &grid, std::function<MatrixXd(const BlockRows &, Point)> columns,
         bool refine = false, std::function<bool(const VectorXd &)> plausible = {})
{
    Family f;
    f.id = id;
    f.depends_on = depends_on;
    f.grid = grid;
    f.grid_count = static_cast<double>(grid.size());
    f.columns = std::move(columns);
    f.refine = refine;
    f.plausible = std::move(plausible);
    out->push_back(std::move(f));
}

std::string name_of(const char *what, Index joint) { return what + std::to_string(joint + 1); }

bool moves(const std::vector<BlockRows> &runs, Index joint)
{
    double lo = 1e9, hi = -1e9;
    for (const BlockRows &b : runs) {
        if (b.size() == 0)
            continue;
        lo = std::min(lo, b.q_all.col(joint).minCoeff());
        hi = std::max(hi, b.q_all.col(joint).maxCoeff());
    }
    return hi - lo > kMoves_rad;
}

std::vector<Point> points(std::initializer_list<double> x)
{
    std::vector<Point> p;
    for (double v : x)
        p.push_back({v, 0});
    return p;
}

MatrixXd two(const VectorXd &a, const VectorXd &b)
{
    MatrixXd m(a.size(), 2);
    m << a, b;
    return m;
}

std::vector<hdt_arm_line> declared_lines(const hdt_arm_joint &joint)
{
    std::vector<hdt_arm_line> lines(joint.ripple, joint.ripple + joint.ripples);
    lines.insert(lines.end(), joint.line, joint.line + joint.lines);
    return lines;
}

// How the declared torque changes with the angle that is read: gravity, springs, and every line of ripple.
Signal slope_of(const hdt_arm_joint &joint)
{
    return [lines = declared_lines(joint), spring = joint.spring_nmprad](const BlockRows &b) -> VectorXd {
        VectorXd out = b.dgdq.array() + spring;
        for (const hdt_arm_line &l : lines) {
            const MatrixXd x = line_columns(b.scan(), l.order_rev, l.directed);
            out += l.amplitude_nm * l.order_rev
                   * (std::cos(l.phase_rad) * x.col(1) - std::sin(l.phase_rad) * x.col(0));
        }
        return out;
    };
}

// Candidates of the load: payload, masses, tilt, offset, gain, springs.
void add_load_families(std::vector<Family> *out, const hdt_arm &arm, int joint,
                       const std::vector<std::string> &poses, const std::vector<BlockRows> &runs)
{
    const std::string q = name_of("q", joint);
    double declared_kg = 1e9;
    for (const BlockRows &b : runs)
        declared_kg = std::min(declared_kg, b.payload_kg);
    // variant 0: mass on the tool axis; 1: anywhere
    add(out, "payload", poses, {{0, 0}, {0, 1}}, [](const BlockRows &b, Point p) -> MatrixXd {
        return p.kind == 1 ? b.body : two(b.body.col(0), b.body.col(3));
    });
    out->back().chain = true;
    // all that hangs there weighs something and is near the flange
    out->back().plausible = [declared_kg](const VectorXd &th) {
        const double mass = declared_kg + th[0];
        return mass > 0 && th.tail(th.size() - 1).norm() < kPayloadReach_m * (mass + declared_kg);
    };
    add(out, "load_friction", {"load", "direction"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd {
        return b.dir.cwiseProduct(b.gravity.cwiseAbs());
    });
    const double declared_mu = arm.joint[joint].load_mu;
    out->back().plausible = [declared_mu](const VectorXd &th) {
        return declared_mu + th[0] > 0 && th[0] < kLossMost;
    };
    add(
        out, "torque_gain", {"torque"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.total; },
        false, [](const VectorXd &th) { return std::abs(th[0]) < kGainMost; });
    add(out, "cable_spring", {q}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.q; });
    const Signal slope = slope_of(arm.joint[joint]);
    std::vector<Point> links;
    for (int k = 0; k < arm.joints; ++k)
        if (arm.joint[k].has_inertial && arm.joint[k].mass_kg > 0)
            links.push_back({0, k});
    if (!links.empty()) {
        // a link heavier all over, which every joint before it feels
        add(
            out, "link_mass", poses, links,
            [](const BlockRows &b, Point p) -> MatrixXd { return b.link.col(p.kind); }, false,
            [](const VectorXd &th) { return th[0] > -1; });
        out->back().chain = true;
    }
    add(out, "link_mass", {q}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.own; });
    add(out, "base_tilt", poses, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.tilt; });
    out->back().chain = true;
    // the resolver reads ahead by a sine of the angle: torque of another angle
    add(out, "eccentricity", {q}, {{}}, [slope](const BlockRows &b, Point) -> MatrixXd {
        const VectorXd by = slope(b);
        return two(by.cwiseProduct(b.q.array().sin().matrix()), by.cwiseProduct(b.q.array().cos().matrix()));
    }, false, [](const VectorXd &th) { return th.norm() < kAngleMost_rad; });
    std::vector<double> size;
    for (const BlockRows &b : runs)
        for (Index t = 0; t < b.size(); ++t)
            size.push_back(std::abs(b.total[t]));
    std::sort(size.begin(), size.end());
    std::vector<Point> knees;
    for (double share : {0.5, 0.65, 0.8, 0.9})
        if (!size.empty() && size.back() > 0)
            knees.push_back({size[static_cast<std::size_t>(share * static_cast<double>(size.size() - 1))],
                             0});
    if (!knees.empty())
        add(out, "torque_saturation", {"torque"}, knees,
            [](const BlockRows &b, Point p) -> MatrixXd {
                return b.total.array().sign() * (b.total.array().abs() - p.x).max(0.0);
            },
            // more current for the same torque, never less
            true, [](const VectorXd &th) { return th[0] > 0; });
    // what is reported is the torque of a while ago: all of it, so that the coefficient is near one
    add(out, "torque_delay", {"torque", "time"}, points({0.01, 0.015, 0.02, 0.03, 0.04}),
        [](const BlockRows &b, Point p) -> MatrixXd {
            const double at = p.x / kLateStep_s;
            const Index i = std::clamp<Index>(static_cast<Index>(at), 0, b.late.cols() - 1);
            const double w = at - static_cast<double>(i);
            const VectorXd before = i == 0 ? VectorXd::Zero(b.size()).eval() : b.late.col(i - 1).eval();
            return (1 - w) * before + w * b.late.col(i);
        },
        true, [](const VectorXd &th) { return th[0] > 0.5 && th[0] < 1.6; });
    out->back().twin = true;
    // the load drives the joint: friction shrinks only then
    add(out, "drive_efficiency", {"load", "direction"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd {
        return b.dir.cwiseProduct(b.dir.cwiseProduct(b.gravity).cwiseMax(0.0));
    }, false, [](const VectorXd &th) { return std::abs(th[0]) < kLossMost; });
}

// Candidates of friction and motion.
void add_motion_families(std::vector<Family> *out, int joint)
{
    const std::string v = name_of("v", joint), a = name_of("a", joint);
    add(out, "inertia", {a}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.a; });
    add(out, "temperature", {"time", v, "direction"}, points({10, 18, 32, 56, 100, 180, 320, 560, 1000}),
        [](const BlockRows &b, Point p) -> MatrixXd {
            const VectorXd cold = (-b.t_s / p.x).array().exp();
            return two(b.dir.cwiseProduct(cold), b.v.cwiseProduct(cold));
        },
        // cold friction is larger, never smaller, at a middling speed
        true, [](const VectorXd &th) { return th[0] + 0.2 * th[1] > 0; });
    add(out, "presliding", {"travel", "direction"}, points({0.002, 0.004, 0.008, 0.016, 0.032, 0.064}),
        [](const BlockRows &b, Point p) -> MatrixXd {
            return -b.dir.cwiseProduct(b.built_up).cwiseProduct((-b.travel / p.x).array().exp().matrix());
        },
        true, [](const VectorXd &th) { return th[0] > 0; });
    add(out, "viscous_nonlinear", {v}, {{}}, [](const BlockRows &b, Point) -> MatrixXd {
        return two(b.v.cwiseProduct(b.v.cwiseAbs()), b.v.array().cube().matrix());
    });
    add(out, "stribeck_shape", {v}, points({0.01, 0.02, 0.04, 0.08, 0.16}),
        [](const BlockRows &b, Point p) -> MatrixXd {
            return b.dir.cwiseProduct((-b.v.cwiseAbs() / p.x).array().exp().matrix());
        },
        true);
}

void add_ripple_families(std::vector<Family> *out, const hdt_arm &arm, int joint)
{
    const hdt_arm_joint &aj = arm.joint[joint];
    std::vector<Point> orders;
    const auto declared = [&](double order) {
        return std::any_of(aj.ripple, aj.ripple + aj.ripples,
                           [&](const hdt_arm_line &r) { return r.order_rev == order; });
    };
    for (int directed = 0; directed < 2; ++directed) {
        for (int k = 0; k < aj.ripples; ++k)
            orders.push_back({aj.ripple[k].order_rev, directed});
        // a wave generator's own orders need not be declared to rise with load or speed
        for (double order : {aj.ratio, 2 * aj.ratio})
            if (!declared(order))
                orders.push_back({order, directed});
    }
    const std::string q = name_of("q", joint), v = name_of("v", joint);
    const auto scaled = [](const BlockRows &b, Point p, const VectorXd &by) -> MatrixXd {
        return by.asDiagonal() * line_columns(b.scan(), p.x, p.kind == 1);
    };
    add(out, "ripple_load", {q, "load"}, orders, [scaled](const BlockRows &b, Point p) {
        return scaled(b, p, b.gravity.cwiseAbs());
    });
    // a rotor answers the ripple of a healthy gear too: it takes more than that to be worth a name
    double healthy = kHealthyRise_s * std::max(aj.friction[0].f0_nm, aj.friction[1].f0_nm);
    for (int k = 0; k < aj.ripples; ++k)
        healthy = std::max(healthy, 0.5 * std::abs(aj.ripple[k].amplitude_nm) / kHealthySpeed_radps);
    add(out, "ripple_speed", {q, v}, orders, [scaled](const BlockRows &b, Point p) {
        return scaled(b, p, b.v.cwiseAbs());
    }, false, [healthy](const VectorXd &th) { return th.norm() > healthy; });
    out->back().twin = true;
}

void add_axes(std::vector<Family> *out, int joint, const std::vector<BlockRows> &runs, Index joints)
{
    const std::string q = name_of("q", joint), v = name_of("v", joint);
    for (bool directed : {false, true}) {
        add_axis(out, runs, q, {q}, [](const BlockRows &b) { return b.q; }, directed);
        add_axis(out, runs, "load", {"load"}, [](const BlockRows &b) { return b.gravity; }, directed);
        add_axis(out, runs, "time", {"time"}, [](const BlockRows &b) { return b.t_s; }, directed);
        for (Index k = 0; k < joints; ++k)
            if (k != joint && moves(runs, k))
                add_axis(out, runs, name_of("q", k), {name_of("q", k)},
                         [k](const BlockRows &b) -> VectorXd { return b.q_all.col(k); }, directed);
    }
    add_axis(out, runs, v, {v}, [](const BlockRows &b) { return b.v; }, false);
    add_axis(out, runs, "torque", {"torque"}, [](const BlockRows &b) { return b.total; }, false);
    // the first travel after a reversal is where friction builds up
    add_axis(out, runs, "travel", {"travel"}, [](const BlockRows &b) -> VectorXd {
        return (b.travel.array() + 1e-3).log().matrix();
    }, true);
}

} // namespace

bool Family::adoptable() const
{
    static const char *const ids[] = {"payload", "load_friction", "torque_gain", "cable_spring", "inertia",
                                      "temperature", "presliding", "order_line"};
    return std::find(std::begin(ids), std::end(ids), id) != std::end(ids);
}

BlockRows BlockRows::slice(Index begin, Index end) const
{
    const Index n = end - begin;
    BlockRows s = *this;
    s.block.assign(block.begin() + begin, block.begin() + end);
    for (auto member : {&BlockRows::t_s, &BlockRows::y_nm, &BlockRows::q, &BlockRows::v, &BlockRows::a,
                        &BlockRows::dir, &BlockRows::travel, &BlockRows::gravity, &BlockRows::total,
                        &BlockRows::dgdq, &BlockRows::vibration, &BlockRows::built_up})
        s.*member = (this->*member).segment(begin, n).eval();
    for (auto member : {&BlockRows::q_all, &BlockRows::a_all, &BlockRows::body, &BlockRows::own,
                        &BlockRows::link, &BlockRows::tilt, &BlockRows::mass, &BlockRows::late})
        s.*member = (this->*member).middleRows(begin, n).eval();
    return s;
}

BlockRows BlockRows::pick(const std::vector<Index> &rows) const
{
    BlockRows s = *this;
    s.block.clear();
    for (Index i : rows)
        s.block.push_back(block[static_cast<std::size_t>(i)]);
    for (auto member : {&BlockRows::t_s, &BlockRows::y_nm, &BlockRows::q, &BlockRows::v, &BlockRows::a,
                        &BlockRows::dir, &BlockRows::travel, &BlockRows::gravity, &BlockRows::total,
                        &BlockRows::dgdq, &BlockRows::vibration, &BlockRows::built_up})
        s.*member = take(this->*member, rows);
    for (auto member : {&BlockRows::q_all, &BlockRows::a_all, &BlockRows::body, &BlockRows::own,
                        &BlockRows::link, &BlockRows::tilt, &BlockRows::mass, &BlockRows::late})
        s.*member = take(this->*member, rows);
    return s;
}

namespace {

// Torque of kLateStep_s, 2 kLateStep_s, ... ago less that of now, every row; before the run began, its
// first.  Friction turns over with the motion, before the speed is high enough to show a direction.
MatrixXd late_torque(VectorXd total, const VectorXd &dir, const VectorXd &t_s)
{
    for (Index t = total.size() - 1; t-- > 0;)
        total[t] = dir[t] == 0 ? total[t + 1] : total[t];
    MatrixXd out(total.size(), kLateSteps);
    for (Index k = 0; k < kLateSteps; ++k) {
        Index i = 0;
        for (Index t = 0; t < total.size(); ++t) {
            const double then = t_s[t] - kLateStep_s * static_cast<double>(k + 1);
            while (i + 1 < t && t_s[i + 1] <= then)
                ++i;
            const double w = t > 0 ? std::clamp((then - t_s[i]) / (t_s[i + 1] - t_s[i]), 0.0, 1.0) : 0;
            out(t, k) = (1 - w) * total[i] + (t > 0 ? w * total[i + 1] : 0) - total[t];
        }
    }
    return out;
}

} // namespace

std::vector<BlockRows> block_rows(const hdt_arm &arm, const Conditioned &c, const Run &run, bool to_fit)
{
    const MatrixXd accel = to_fit ? best_acceleration(c, run) : c.a;
    const hdt_arm mine = arm_for_run(arm, c);
    const ChainColumns chain = chain_columns(mine, c);
    const std::vector<MatrixXd> terms = declared_terms(arm, c);
    std::vector<BlockRows> out;
    for (int j = 0; j < arm.joints; ++j) {
        const auto k = static_cast<std::size_t>(j);
        BlockRows b;
        b.run = c.name;
        b.payload_kg = c.payload_kg;
        b.payload_com_m = c.payload_com_m;
        b.payload_declared = c.payload_declared;
        b.unknown_angles = c.unknown_angles[k];
        b.block = c.blocks(j);
        b.block_s = c.block_begin.size() > 2 ? c.t_s[c.block_begin[1]] - c.t_s[c.block_begin[0]] : 0.01;
        const double gain = arm.joint[j].torque_gain;
        const VectorXd total = terms[k].rowwise().sum();
        MatrixXd full(c.t_s.size(), 11);
        full << c.t_s, gain * c.tau.col(j) - total, c.q.col(j), c.v.col(j), accel.col(j), c.dir.col(j),
            c.travel.col(j), terms[k].col(HDT_TERM_GRAVITY), total,
            c.a.col(j) - accel.col(j), c.built_up.col(j);
        const MatrixXd mean = c.block_means(j, full);
        b.t_s = mean.col(0);
        b.y_nm = mean.col(1);
        b.q = mean.col(2);
        b.v = mean.col(3);
        b.a = mean.col(4);
        b.dir = mean.col(5);
        b.travel = mean.col(6);
        b.gravity = mean.col(7);
        b.total = mean.col(8);
        b.vibration = mean.col(9);
        b.built_up = mean.col(10);
        b.q_all = c.block_means(j, c.q);
        b.a_all = c.block_means(j, accel);
        b.body = take(chain.body[k], b.block);
        b.own = take(chain.own[k], b.block);
        b.link = take(chain.link[k], b.block);
        b.tilt = take(chain.tilt[k], b.block);
        b.dgdq = take(chain.dgdq.col(j), b.block);
        b.late = c.block_means(j, late_torque(total, c.dir.col(j), c.t_s));
        b.mass = take(chain.mass[k], b.block);
        out.push_back(std::move(b));
    }
    return out;
}

MatrixXd nuisance_columns(const BlockRows &b)
{
    MatrixXd n(b.size(), 4);
    n.col(0) = b.dir.cwiseMax(0.0);
    n.col(1) = b.dir.cwiseMin(0.0);
    n.col(2) = b.v.cwiseMax(0.0);
    n.col(3) = b.v.cwiseMin(0.0);
    return n;
}

Imperfections imperfections(const hdt_arm_joint &joint, const BlockRows &b)
{
    constexpr double inertia_kgm2 = 10;
    Imperfections out;
    out.columns = MatrixXd::Zero(b.size(), 2 + 8 * joint.ripples);
    out.sigma = VectorXd::Constant(out.columns.cols(), kHealthyDelay_s);
    out.columns.col(0) = b.vibration;
    out.columns.col(1) = torque_rate(b);
    out.sigma[0] = inertia_kgm2;
    const VectorXd speed = b.v.cwiseAbs();
    for (int k = 0; k < joint.ripples; ++k) {
        const double order = joint.ripple[k].order_rev;
        const double amplitude = std::abs(joint.ripple[k].amplitude_nm) + 1e-6;
        const MatrixXd line = line_columns(b.scan(), order, false);
        const MatrixXd directed = line_columns(b.scan(), order, true);
        // at speed the rotor answers; wind-up by friction shifts the angle with direction
        out.columns.middleCols(2 + 8 * k, 8) << speed.asDiagonal() * line, speed.asDiagonal() * directed,
            line, directed;
        out.sigma.segment(2 + 8 * k, 4).setConstant(amplitude / kHealthySpeed_radps);
        out.sigma.segment(6 + 8 * k, 4).setConstant(0.3 * amplitude);
    }
    return out;
}

std::vector<Family> effect_families(const hdt_arm &arm, int joint, const std::vector<BlockRows> &runs)
{
    std::vector<std::string> poses;
    for (Index k = 0; k < arm.joints; ++k)
        if (moves(runs, k))
            poses.push_back(name_of("q", k));
    std::vector<Family> out;
    add_load_families(&out, arm, joint, poses, runs);
    add_motion_families(&out, joint);
    std::vector<Point> others;
    for (int k = 0; k < arm.joints; ++k)
        if (k != joint && moves(runs, k)) {
            others.push_back({1, k}); // the declared chain's share is wrong
            others.push_back({0, k}); // something else that the other joint swings
        }
    if (!others.empty())
        add(&out, "coupling", {"other joints' acceleration"}, others,
            [](const BlockRows &b, Point p) -> MatrixXd {
                return p.x > 0.5 ? b.mass.col(p.kind).cwiseProduct(b.a_all.col(p.kind)).eval()
                                 : b.a_all.col(p.kind).eval();
            });
    add_ripple_families(&out, arm, joint);
    add_axes(&out, joint, runs, arm.joints);
    return out;
}

Family line_family(int joint, const std::vector<LineHit> &hits, double tried, double step)
{
    Family f;
    f.id = "order_line";
    f.depends_on = {name_of("q", joint)};
    for (const LineHit &h : hits)
        f.grid.push_back({h.order, h.directed});
    f.grid_count = std::max(tried, 1.0);
    f.columns = [](const BlockRows &b, Point p) { return line_columns(b.scan(), p.x, p.kind == 1); };
    f.refine = true;
    f.step = step;
    return f;
}

namespace {

// A place along some signal, its width by number, and the power of what stands there.
struct Place { double x; int kind; double power; };

// The strongest local maxima, width by width.
std::vector<Place> strongest(std::vector<Place> places)
{
    std::vector<Place> top;
    for (std::size_t i = 0; i < places.size(); ++i) {
        const auto lower = [&](std::size_t k) { return k >= places.size() || places[k].kind != places[i].kind
                                                       || places[k].power <= places[i].power; };
        if (places[i].power > 0 && lower(i - 1) && lower(i + 1))
            top.push_back(places[i]);
    }
    std::stable_sort(top.begin(), top.end(),
                     [](const Place &a, const Place &b) { return a.power > b.power; });
    top.resize(std::min(top.size(), kPlaces));
    return top;
}

// Score and rows over a signal, in equal bins.
struct Bins {
    double lo = 0, width = 1;
    VectorXd score, rows;
    double at(Index k) const { return lo + (static_cast<double>(k) + 0.5) * width; }
};

Bins bins_of(const std::vector<BlockRows> &runs, const std::vector<VectorXd> &score, const Signal &signal,
             const Signal &weight, Index count)
{
    Bins b;
    double hi = -1e300;
    b.lo = 1e300;
    for (const BlockRows &r : runs)
        if (r.size() > 0) {
            const VectorXd x = signal(r);
            b.lo = std::min(b.lo, x.minCoeff());
            hi = std::max(hi, x.maxCoeff());
        }
    b.width = std::max((hi - b.lo) / static_cast<double>(count), 1e-9);
    b.score = b.rows = VectorXd::Zero(count);
    for (std::size_t r = 0; r < runs.size(); ++r) {
        const VectorXd x = signal(runs[r]), w = weight(runs[r]);
        for (Index t = 0; t < x.size(); ++t) {
            const Index k = std::clamp<Index>(static_cast<Index>((x[t] - b.lo) / b.width), 0, count - 1);
            b.score[k] += w[t] * score[r][t];
            b.rows[k] += w[t] * w[t];
        }
    }
    return b;
}

// Share of full loss: 0 below the step, 1 above.
VectorXd loss_step(const VectorXd &load, double at, double width)
{
    return ((load.array() - at) / width + 0.5).max(0.0).min(1.0);
}

// Power of a loss step at each load of the bins, one direction: beside that direction's own Coulomb
// friction; less than three in a hundred rows on one side show no step.
double step_power(const Bins &b, double at, double width)
{
    VectorXd x(b.rows.size());
    for (Index k = 0; k < x.size(); ++k)
        x[k] = b.at(k);
    const VectorXd h = loss_step(x, at, width);
    const double rows = b.rows.sum(), above = h.dot(b.rows), square = h.cwiseAbs2().dot(b.rows);
    const double info = square - above * above / std::max(rows, 1e-9);
    if (above < 0.03 * rows || above > 0.97 * rows || !(info > 0))
        return 0;
    const double score = (h.array() - above / rows).matrix().dot(b.score);
    return score > 0 ? score * score / info : 0;
}

} // namespace

MatrixXd turned_columns(const hdt_arm_joint &joint, const BlockRows &b)
{
    const std::vector<hdt_arm_line> lines = declared_lines(joint);
    MatrixXd m(b.size(), 1 + 2 * static_cast<Index>(lines.size()));
    m.col(0) = b.dgdq.array() + joint.spring_nmprad;
    for (std::size_t k = 0; k < lines.size(); ++k)
        m.middleCols(1 + 2 * static_cast<Index>(k), 2) = line_columns(b.scan(), lines[k].order_rev,
                                                                      lines[k].directed);
    return m;
}

VectorXd turned_by(const hdt_arm_joint &joint, double angle_rad)
{
    const std::vector<hdt_arm_line> lines = declared_lines(joint);
    VectorXd w(1 + 2 * static_cast<Index>(lines.size()));
    w[0] = angle_rad;
    for (std::size_t k = 0; k < lines.size(); ++k) {
        const double phase = lines[k].phase_rad, turned = phase + lines[k].order_rev * angle_rad;
        w[1 + 2 * static_cast<Index>(k)] = lines[k].amplitude_nm * (std::cos(turned) - std::cos(phase));
        w[2 + 2 * static_cast<Index>(k)] = lines[k].amplitude_nm * (std::sin(turned) - std::sin(phase));
    }
    return w;
}

Family offset_family(const hdt_arm_joint &joint, int number, const MatrixXd &information,
                     const VectorXd &score)
{
    Family f;
    f.id = "joint_offset";
    f.depends_on = {name_of("q", number)};
    double highest = 10;
    for (const hdt_arm_line &l : declared_lines(joint))
        highest = std::max(highest, l.order_rev);
    const double step = 0.3 / highest;
    std::vector<Place> places;
    for (double x = step * std::ceil(-kAngleMost_rad / step); x <= kAngleMost_rad; x += step) {
        const VectorXd w = turned_by(joint, x);
        places.push_back({x, 0, w.dot(score) - 0.5 * w.dot(information * w)});
    }
    f.grid_count = static_cast<double>(places.size());
    for (const Place &p : strongest(std::move(places)))
        f.grid.push_back({p.x, 0});
    f.columns = [joint](const BlockRows &b, Point p) -> MatrixXd {
        return turned_columns(joint, b) * turned_by(joint, p.x);
    };
    // the whole of it, so that the coefficient is near one
    f.plausible = [](const VectorXd &th) { return th[0] > 0.5 && th[0] < 1.6; };
    f.twin = true; // wind-up of a healthy joint turns its ripple a little
    return f;
}

Family local_family(int joint, const std::vector<BlockRows> &runs, const std::vector<VectorXd> &score)
{
    Family f;
    f.id = "local_friction";
    f.depends_on = {name_of("q", joint), "direction"};
    const Bins b = bins_of(
        runs, score, [](const BlockRows &r) { return r.q; }, [](const BlockRows &r) { return r.dir; }, 200);
    const double hi = b.lo + b.width * static_cast<double>(b.rows.size());
    std::vector<Place> places;
    for (int kind = 0; kind < 3; ++kind)
        for (double c = b.lo + kBumpWidth_rad[kind]; c < hi - kBumpWidth_rad[kind];
             c += 0.5 * kBumpWidth_rad[kind]) {
            double sum = 0, info = 1e-12;
            for (Index k = 0; k < b.rows.size(); ++k) {
                const double u = (b.at(k) - c) / kBumpWidth_rad[kind], bump = std::exp(-0.5 * u * u);
                sum += bump * b.score[k];
                info += bump * bump * b.rows[k];
            }
            places.push_back({c, kind, sum > 0 ? sum * sum / info : 0});
        }
    f.grid_count = std::max(1.0, static_cast<double>(places.size()));
    for (const Place &p : strongest(std::move(places)))
        f.grid.push_back({p.x, p.kind});
    f.columns = [](const BlockRows &r, Point p) -> MatrixXd {
        const double w = kBumpWidth_rad[p.kind];
        return r.dir.array() * (-0.5 * ((r.q.array() - p.x) / w).square()).exp();
    };
    f.plausible = [](const VectorXd &th) { return th[0] > 0; };
    f.refine = true;
    f.step = kBumpWidth_rad[0];
    return f;
}

Family windup_family(const std::vector<BlockRows> &runs, const std::vector<VectorXd> &score)
{
    Family f;
    f.id = "soft_windup";
    f.depends_on = {"load", "direction"};
    // load against the motion: the gear drives it where that is positive
    const auto driven = [](const BlockRows &r) -> VectorXd { return r.dir.cwiseProduct(r.gravity); };
    const Bins up =
        bins_of(runs, score, driven, [](const BlockRows &r) -> VectorXd { return r.dir.cwiseMax(0.0); }, 200);
    const Bins down =
        bins_of(runs, score, driven, [](const BlockRows &r) -> VectorXd { return r.dir.cwiseMin(0.0); }, 200);
    const double hi = up.lo + up.width * static_cast<double>(up.rows.size());
    std::vector<Place> places;
    for (int kind = 0; kind < 2; ++kind)
        for (double at = up.lo; at < hi; at += 0.5 * kStepWidth_nm[kind])
            places.push_back({at, kind,
                              step_power(up, at, kStepWidth_nm[kind])
                                  + step_power(down, at, kStepWidth_nm[kind])});
    f.grid_count = std::max(1.0, static_cast<double>(places.size()));
    for (const Place &p : strongest(std::move(places)))
        f.grid.push_back({p.x, p.kind});
    f.columns = [driven](const BlockRows &r, Point p) -> MatrixXd {
        const VectorXd h = loss_step(driven(r), p.x, kStepWidth_nm[p.kind]);
        return two(h.cwiseProduct(r.dir.cwiseMax(0.0)), h.cwiseProduct(r.dir.cwiseMin(0.0)));
    };
    // the loss is larger while the gear drives, in both directions
    f.plausible = [](const VectorXd &th) { return th[0] > 0 && th[1] > 0; };
    f.refine = true;
    f.step = 0.5 * kStepWidth_nm[0];
    return f;
}

double bump_width_rad(int kind) { return kBumpWidth_rad[kind]; }
double step_width_nm(int kind) { return kStepWidth_nm[kind]; }

double block_gain(double hz, double block_s)
{
    const double x = 0.5 * kTwoPi * hz * block_s;
    return std::abs(x) < 1e-6 ? 1 : std::sin(x) / x;
}

Family vibration_family(const std::vector<double> &hz, double tried, std::size_t runs, double step_hz)
{
    Family f;
    f.id = "external_vibration";
    f.depends_on = {"time"};
    for (double x : hz)
        f.grid.push_back({x, 0});
    f.grid_count = std::max(tried, 1.0);
    f.columns = [runs](const BlockRows &b, Point p) -> MatrixXd {
        MatrixXd x = MatrixXd::Zero(b.size(), 2 * static_cast<Index>(runs));
        if (b.index >= 0) {
            x.col(2 * b.index) = (kTwoPi * p.x * b.t_s.array()).sin();
            x.col(2 * b.index + 1) = (kTwoPi * p.x * b.t_s.array()).cos();
        }
        return x;
    };
    f.refine = true;
    f.step = step_hz;
    f.own_phase = true;
    return f;
}

} // namespace hdt
