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

// Columns of the chain at each block's mean state, all joints at once.
struct ChainColumns { std::vector<MatrixXd> body, own, tilt; MatrixXd dgdq; };

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
    constexpr double dq = 1e-4;
    for (Index j = 0; j < q.size(); ++j) {
        const auto k = static_cast<std::size_t>(j);
        out->body[k].row(row) = reg.block(j, reg.cols() - 10, 1, 4);
        out->own[k].row(row) = reg.block(j, 10 * j + 1, 1, 2);
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
    out.tilt.assign(joints, MatrixXd::Zero(blocks, 2));
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

// Candidates of the load: payload, masses, tilt, offset, gain, springs.
void add_load_families(std::vector<Family> *out, const hdt_arm &arm, int joint, const std::vector<std::string> &poses,
                       const std::vector<BlockRows> &runs)
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
    out->back().plausible = [declared_mu](const VectorXd &th) { return declared_mu + th[0] > 0; };
    add(out, "torque_gain", {"torque"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.total; });
    add(out, "cable_spring", {q}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.q; });
    add(out, "link_mass", {q}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.own; });
    add(out, "joint_offset", {q}, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.dgdq; });
    add(out, "base_tilt", poses, {{}}, [](const BlockRows &b, Point) -> MatrixXd { return b.tilt; });
    out->back().chain = true;
    add(out, "eccentricity", {q, "torque"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd {
        return two(b.total.cwiseProduct(b.q.array().sin().matrix()), b.total.cwiseProduct(b.q.array().cos().matrix()));
    });
    // the load drives the joint: friction shrinks only then
    add(out, "drive_efficiency", {"load", "direction"}, {{}}, [](const BlockRows &b, Point) -> MatrixXd {
        return b.dir.cwiseProduct(b.dir.cwiseProduct(b.gravity).cwiseMax(0.0));
    });
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
    for (int k = 0; k < aj.ripples; ++k)
        for (int directed = 0; directed < 2; ++directed)
            orders.push_back({aj.ripple[k].order_rev, directed});
    if (orders.empty())
        return;
    const std::string q = name_of("q", joint);
    const auto scaled = [](const BlockRows &b, Point p, const VectorXd &by) -> MatrixXd {
        return by.asDiagonal() * line_columns(b.scan(), p.x, p.kind == 1);
    };
    add(out, "ripple_load", {q, "load"}, orders, [scaled](const BlockRows &b, Point p) {
        return scaled(b, p, b.gravity.cwiseAbs());
    });
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
    for (auto member : {&BlockRows::q_all, &BlockRows::a_all, &BlockRows::body, &BlockRows::own, &BlockRows::tilt})
        s.*member = (this->*member).middleRows(begin, n).eval();
    return s;
}

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
        b.tilt = take(chain.tilt[k], b.block);
        b.dgdq = take(chain.dgdq.col(j), b.block);
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
    constexpr double delay_s = 0.003, speed_radps = 0.2, inertia_kgm2 = 10;
    Imperfections out;
    out.columns = MatrixXd::Zero(b.size(), 2 + 8 * joint.ripples);
    out.sigma = VectorXd::Constant(out.columns.cols(), delay_s);
    // rate of the declared torque, over unbroken blocks
    for (Index t = 1; t + 1 < b.size(); ++t) {
        const auto i = static_cast<std::size_t>(t);
        if (b.block[i + 1] == b.block[i] + 1 && b.block[i - 1] == b.block[i] - 1)
            out.columns(t, 1) = (b.total[t + 1] - b.total[t - 1]) / (2 * b.block_s);
    }
    out.columns.col(0) = b.vibration;
    out.sigma[0] = inertia_kgm2;
    const VectorXd speed = b.v.cwiseAbs();
    for (int k = 0; k < joint.ripples; ++k) {
        const double order = joint.ripple[k].order_rev, amplitude = std::abs(joint.ripple[k].amplitude_nm) + 1e-6;
        const MatrixXd line = line_columns(b.scan(), order, false), directed = line_columns(b.scan(), order, true);
        // at speed the rotor answers; wind-up by friction shifts the angle with direction
        out.columns.middleCols(2 + 8 * k, 8) << speed.asDiagonal() * line, speed.asDiagonal() * directed, line, directed;
        out.sigma.segment(2 + 8 * k, 4).setConstant(amplitude / speed_radps);
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
        if (k != joint && moves(runs, k))
            others.push_back({0, k});
    if (!others.empty())
        add(&out, "coupling", {"other joints' acceleration"}, others, [](const BlockRows &b, Point p) -> MatrixXd {
            return b.a_all.col(p.kind);
        });
    add_ripple_families(&out, arm, joint);
    add_axes(&out, joint, runs, arm.joints);
    return out;
}

Family line_family(int joint, const std::vector<LineHit> &hits, double tried)
{
    Family f;
    f.id = "order_line";
    f.depends_on = {name_of("q", joint)};
    for (const LineHit &h : hits)
        f.grid.push_back({h.order, h.directed});
    f.grid_count = std::max(tried, 1.0);
    f.columns = [](const BlockRows &b, Point p) { return line_columns(b.scan(), p.x, p.kind == 1); };
    f.refine = true;
    return f;
}

} // namespace hdt
