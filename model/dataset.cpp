// SPDX-License-Identifier: Apache-2.0
//
// Conditioning of one run.  Velocity and acceleration come from a local cubic in time (tricube
// weights, every row its own window), which needs no regular sampling and shifts no phase.  Its
// width is the narrowest that keeps the noise of the acceleration small: the torque is not
// filtered, so whatever the acceleration misses would be taken for ripple.
//
// Owns: the smoother, the masks and their order, block bookkeeping.
// Never: fits; changes the torque; fills in a masked row.
#include "model/dataset.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <thread>

#include "model/rbd.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index min_rows = 50;
constexpr Index segment_min_rows = 9;
constexpr double min_rate_hz = 20;
constexpr double v_min_floor_radps = 0.004;
// candidate half widths; the -3 dB point of the acceleration is about 0.6 / half width
constexpr double half_widths_s[] = {0.012, 0.018, 0.025, 0.035, 0.05, 0.07, 0.1, 0.14};
constexpr double a_noise_floor_radps2 = 0.02;
constexpr double a_noise_share = 0.02;      // of the rms acceleration
constexpr double spike_sigmas = 6;
constexpr double spike_window_s = 0.012;    // half width of the local median
constexpr double spike_guard_s = 0.003;
constexpr double spike_scale_s = 0.25;      // the local scale is taken over three of these
constexpr double saturation_share = 0.98;
constexpr double limit_slack_rad = 0.5;
constexpr int carry_poses = 24;             // at which gravity is asked whether an angle matters
constexpr double carry_share = 0.01;        // of the joint's largest gravity torque
constexpr double carry_least_nm = 0.05;

struct Segment { Index begin, end; };

[[noreturn]] void bad(const Run &run, const std::string &what)
{
    throw InputError(run.path + ": " + what);
}

std::string text(const char *format, double x, double y)
{
    char buf[200];
    std::snprintf(buf, sizeof buf, format, x, y);
    return buf;
}

double median(std::vector<double> x)
{
    if (x.empty())
        return 0;
    auto mid = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
    std::nth_element(x.begin(), mid, x.end());
    return *mid;
}

void check_run(const Run &run, const hdt_arm &arm)
{
    std::size_t n = run.rows();
    if (static_cast<Index>(n) < min_rows)
        bad(run,
            text("expected at least %.0f rows, found %.0f: log longer", min_rows, static_cast<double>(n)));
    if (static_cast<int>(run.joint.size()) > arm.joints)
        bad(run, text("expected at most %.0f joints as the arm has, found joint %.0f: "
                      "is this the right arm file?", arm.joints, static_cast<double>(run.joint.size())));
    bool any = false;
    for (std::size_t i = 0; i < n; i++)
        if (!std::isfinite(run.t_s[i]) || (i > 0 && run.t_s[i] <= run.t_s[i - 1]))
            bad(run, text("row %.0f: expected time to advance, found %.9g s", static_cast<double>(i + 1),
                          run.t_s[i]));
    for (std::size_t j = 0; j < run.joint.size(); j++) {
        const Run::Joint &jt = run.joint[j];
        if (!jt.present)
            continue;
        any = true;
        if (jt.q_rad.size() != n || jt.tau_nm.size() != n)
            bad(run, text("joint %.0f: columns shorter than time (%.0f rows)", static_cast<double>(j + 1),
                          static_cast<double>(n)));
        const hdt_arm_joint &aj = arm.joint[j];
        for (std::size_t i = 0; i < n; i++) {
            if (!std::isfinite(jt.q_rad[i]) || !std::isfinite(jt.tau_nm[i]))
                bad(run, text("joint %.0f, row %.0f: expected finite numbers", static_cast<double>(j + 1),
                              static_cast<double>(i + 1)));
            if (aj.q_max_rad > aj.q_min_rad && (jt.q_rad[i] > aj.q_max_rad + limit_slack_rad ||
                                                jt.q_rad[i] < aj.q_min_rad - limit_slack_rad))
                bad(run, text("joint %.0f: q = %.4g rad is outside the arm's position limits: "
                              "degrees, or the wrong arm file?", static_cast<double>(j + 1), jt.q_rad[i]));
        }
    }
    if (!any)
        bad(run, "expected q and tau of at least one joint, found none");
}

double rate_of(const Run &run, double *dt_median)
{
    std::vector<double> dt(run.rows() - 1);
    for (std::size_t i = 0; i < dt.size(); i++)
        dt[i] = run.t_s[i + 1] - run.t_s[i];
    *dt_median = median(dt);
    double rate = 1 / *dt_median;
    if (rate < min_rate_hz)
        bad(run, text("expected a sampling rate of at least %.0f Hz, found %.3g Hz: log faster", min_rate_hz,
                      rate));
    return rate;
}

std::vector<Segment> segments(const VectorXd &t, double gap_s)
{
    std::vector<Segment> s;
    Index begin = 0;
    for (Index i = 1; i <= t.size(); i++)
        if (i == t.size() || t[i] - t[i - 1] > gap_s) {
            s.push_back({begin, i});
            begin = i;
        }
    return s;
}

// One row's local cubic: weights that give value, slope and curvature from the window's samples.
struct Window {
    Index lo = 0, hi = 0;
    Eigen::Matrix<double, 4, Eigen::Dynamic> basis; // as many columns as the widest window so far
    Eigen::Matrix<double, 3, Eigen::Dynamic> weight;

    auto weights() const { return weight.leftCols(hi - lo); }
};

void window_at(const VectorXd &t, Segment s, Index i, double half_s, Window *w)
{
    // at least three neighbours on each side, or seven rows at the ends of a segment
    Index lo = std::max(w->lo, s.begin), hi = std::max(w->hi, i + 1);
    while (lo + 3 < i && t[i] - t[lo] > half_s)
        lo++;
    lo = std::max(s.begin, std::min(lo, i - 3));
    while (hi < s.end && (t[hi] - t[i] <= half_s || hi <= i + 3))
        hi++;
    lo = std::max(s.begin, std::min(lo, hi - 7));
    hi = std::min(s.end, std::max(hi, lo + 7));
    Index n = hi - lo;
    if (w->basis.cols() < n) {
        w->basis.resize(4, 2 * n);
        w->weight.resize(3, 2 * n);
    }
    double h = 1.02 * std::max({half_s, t[i] - t[lo], t[hi - 1] - t[i]});
    Eigen::Matrix4d moment = Eigen::Matrix4d::Zero();
    for (Index k = 0; k < n; k++) {
        double u = (t[lo + k] - t[i]) / h, c = 1 - std::fabs(u * u * u), tri = c * c * c;
        Eigen::Vector4d p(1, u, u * u, u * u * u);
        moment += tri * p * p.transpose();
        w->basis.col(k) = tri * p;
    }
    Eigen::Matrix<double, 3, 4> solve =
        moment.ldlt().solve(Eigen::Matrix<double, 4, 3>::Identity()).transpose();
    solve.row(1) /= h;
    solve.row(2) *= 2 / (h * h);
    w->weight.leftCols(n).noalias() = solve * w->basis.leftCols(n);
    w->lo = lo;
    w->hi = hi;
}

// Noise of one position sample, per joint: what a narrow local cubic leaves, never under the
// resolver step's share.
VectorXd position_noise(const VectorXd &t, const MatrixXd &q, const std::vector<Segment> &segs, double dt)
{
    VectorXd sum = VectorXd::Zero(q.cols());
    double dof = 0;
    for (Segment s : segs) {
        Window w;
        w.lo = w.hi = s.begin;
        for (Index i = s.begin + 4; i + 4 < s.end; i++) {
            window_at(t, s, i, 4.5 * dt, &w);
            Eigen::RowVectorXd r = q.row(i) - w.weights().row(0) * q.middleRows(w.lo, w.hi - w.lo);
            sum += r.transpose().cwiseAbs2();
            // E r^2 = sigma^2 ((1 - own weight)^2 + the other weights squared)
            double own = w.weight(0, i - w.lo);
            dof += (1 - own) * (1 - own) + w.weights().row(0).squaredNorm() - own * own;
        }
    }
    VectorXd sigma = VectorXd::Zero(q.cols());
    for (Index j = 0; j < q.cols(); j++) {
        // the smallest step ever seen is the resolver's, or far below its noise
        double step = 0;
        for (Index i = 1; i < q.rows(); i++) {
            double d = std::fabs(q(i, j) - q(i - 1, j));
            if (d > 0 && (step == 0 || d < step))
                step = d;
        }
        sigma[j] = std::max(dof > 0 ? std::sqrt(sum[j] / dof) : 0, step / std::sqrt(12.0));
    }
    return sigma;
}

struct Smooth { MatrixXd v, a; double v_gain = 0, a_gain = 0; }; // gains: noise out over noise in

Smooth smooth(const VectorXd &t, const MatrixXd &q, const std::vector<Segment> &segs, double half_s)
{
    Smooth out;
    out.v = out.a = MatrixXd::Zero(q.rows(), q.cols());
    double v2 = 0, a2 = 0, n = 0;
    for (Segment s : segs) {
        if (s.end - s.begin < segment_min_rows)
            continue;
        Window w;
        w.lo = w.hi = s.begin;
        for (Index i = s.begin; i < s.end; i++) {
            window_at(t, s, i, half_s, &w);
            out.v.row(i).noalias() = w.weights().row(1) * q.middleRows(w.lo, w.hi - w.lo);
            out.a.row(i).noalias() = w.weights().row(2) * q.middleRows(w.lo, w.hi - w.lo);
            if (t[i] - t[s.begin] > half_s && t[s.end - 1] - t[i] > half_s) {
                v2 += w.weights().row(1).squaredNorm();
                a2 += w.weights().row(2).squaredNorm();
                n++;
            }
        }
    }
    if (n > 0) {
        out.v_gain = std::sqrt(v2 / n);
        out.a_gain = std::sqrt(a2 / n);
    }
    return out;
}

double rms(const VectorXd &x)
{
    return x.size() > 0 ? std::sqrt(x.squaredNorm() / static_cast<double>(x.size())) : 0;
}

// Where the measured acceleration differs from the reference mostly by its own noise, the reference
// is the better regressor.
void prefer_reference(const Run::Joint &jt, const std::vector<Segment> &segs, Index j, Conditioned *c)
{
    auto map = [](const std::vector<double> &x) {
        return Eigen::Map<const VectorXd>(x.data(), static_cast<Index>(x.size()));
    };
    std::size_t n = static_cast<std::size_t>(c->t_s.size());
    VectorXd aref;
    if (jt.aref_radps2.size() == n && map(jt.aref_radps2).allFinite())
        aref = map(jt.aref_radps2);
    else if (jt.vref_radps.size() == n && map(jt.vref_radps).allFinite())
        aref = smooth(c->t_s, map(jt.vref_radps), segs, c->smooth_s[j]).v;
    else
        return;
    // by the median: the ends of a segment are far noisier and masked later
    VectorXd off = (c->a.col(j) - aref).cwiseAbs();
    if (c->a_noise[j] <= 0.5 * 1.4826 * median({off.data(), off.data() + off.size()}))
        return;
    c->a.col(j) = aref;
    c->a_noise[j] = 0;
}

// Per joint the narrowest smoother that is quiet enough; the widest if none is.
void differentiate(const std::vector<Segment> &segs, double dt, Conditioned *c)
{
    VectorXd sigma = position_noise(c->t_s, c->q, segs, dt);
    std::vector<char> done(c->present.size());
    for (std::size_t j = 0; j < done.size(); j++)
        done[j] = !c->present[j];
    double widest = half_widths_s[std::size(half_widths_s) - 1];
    for (double h : half_widths_s) {
        if ((h < 4 * dt && h != widest) || std::count(done.begin(), done.end(), 0) == 0)
            continue;
        Smooth s = smooth(c->t_s, c->q, segs, h);
        for (std::size_t k = 0; k < done.size(); k++) {
            Index j = static_cast<Index>(k);
            double noise = sigma[j] * s.a_gain;
            if (done[k] ||
                (h != widest && noise > std::max(a_noise_floor_radps2, a_noise_share * rms(s.a.col(j)))))
                continue;
            done[k] = 1;
            c->v.col(j) = s.v.col(j);
            c->a.col(j) = s.a.col(j);
            c->smooth_s[j] = h;
            c->a_noise[j] = noise;
            c->v_noise[j] = sigma[j] * s.v_gain;
        }
    }
}

// Direction 0 under v_min.  Travel counts from the turning point, the farthest angle reached in the
// direction before: counting from the first row that moves fast enough would lose what came before.
void direction(Index j, Conditioned *c)
{
    double last = 0, turn = c->q(0, j), reach = turn, built_up = 0.5; // from rest, friction builds up by half
    for (Index i = 0; i < c->t_s.size(); i++) {
        double v = c->v(i, j), q = c->q(i, j), d = v >= c->v_min[j] ? 1 : v <= -c->v_min[j] ? -1 : 0;
        if (d != 0 && d != last) {
            if (last != 0) {
                turn = reach;
                built_up = 1;
            }
            reach = q;
            last = d;
        }
        reach = last > 0 ? std::max(reach, q) : last < 0 ? std::min(reach, q) : reach;
        c->dir(i, j) = d;
        c->travel(i, j) = std::fabs(q - turn);
        c->built_up(i, j) = built_up;
    }
}

using Mask = std::vector<char>;

Mask gap_mask(const VectorXd &t, const std::vector<Segment> &segs, double half_s)
{
    Mask m(static_cast<std::size_t>(t.size()), 0);
    for (Segment s : segs)
        for (Index i = s.begin; i < s.end; i++)
            if (s.end - s.begin < segment_min_rows || t[i] - t[s.begin] < half_s / 2 ||
                t[s.end - 1] - t[i] < half_s / 2)
                m[static_cast<std::size_t>(i)] = 1;
    return m;
}

// Short outliers against a running median, which keeps the torque step of a reversal; the scale is
// local, so that ripple at speed is no spike.
Mask spike_mask(const VectorXd &tau, double rate_hz)
{
    Index n = tau.size(), half = std::clamp<Index>(std::lround(spike_window_s * rate_hz), 3, 40);
    VectorXd r(n);
    std::vector<double> w;
    for (Index i = 0; i < n; i++) {
        Index lo = std::max<Index>(0, i - half), hi = std::min(n, i + half + 1);
        w.assign(tau.data() + lo, tau.data() + hi);
        r[i] = std::fabs(tau[i] - median(w));
    }
    double all = median({r.data(), r.data() + n});
    double largest = tau.cwiseAbs().maxCoeff();
    Mask m(static_cast<std::size_t>(n), 0);
    Index chunk = std::max<Index>(30, std::lround(spike_scale_s * rate_hz));
    Index guard = std::lround(spike_guard_s * rate_hz);
    for (Index b = 0; b < n; b += chunk) {
        Index lo = std::max<Index>(0, b - chunk), hi = std::min(n, b + 2 * chunk);
        // quantised torque can have a median deviation of zero
        double scale = 1.4826 * std::max({median({r.data() + lo, r.data() + hi}), all, 1e-3 * largest});
        for (Index i = b; i < std::min(n, b + chunk); i++)
            if (r[i] > spike_sigmas * scale)
                for (Index k = std::max<Index>(0, i - guard); k <= std::min(n - 1, i + guard); k++)
                    m[static_cast<std::size_t>(k)] = 1;
    }
    return m;
}

Mask standstill_mask(const Conditioned &c, Index j, const ConditionOptions &options)
{
    double guard_s = options.reversal_guard_s;
    Index n = c.t_s.size();
    Mask m(static_cast<std::size_t>(n), 0);
    double last = 0, t_free = -1;
    Index first = 0; // rows before it are no longer inside a guard looking backwards
    for (Index i = 0; i < n; i++) {
        double d = c.dir(i, j);
        if (d == 0 || c.t_s[i] < t_free || c.travel(i, j) < options.reversal_travel_rad)
            m[static_cast<std::size_t>(i)] = 1;
        if (d != 0 && last != 0 && d != last && guard_s > 0) {
            t_free = c.t_s[i] + guard_s;
            m[static_cast<std::size_t>(i)] = 1;
            while (first < i && c.t_s[i] - c.t_s[first] > guard_s)
                first++;
            for (Index k = first; k < i; k++)
                m[static_cast<std::size_t>(k)] = 1;
        }
        if (d != 0)
            last = d;
    }
    return m;
}

// Gravity torque of every joint, rows x joints; empty where no joint's soft mask is asked for.
MatrixXd soft_gravity(const hdt_arm &arm, double margin_nm, const Conditioned &c)
{
    bool asked = false;
    for (int j = 0; j < arm.joints; j++)
        asked = asked || (c.present[static_cast<std::size_t>(j)] && arm.joint[j].has_stiffness);
    if (!asked || margin_nm <= 0)
        return {};
    const hdt_arm mine = arm_for_run(arm, c);
    MatrixXd out(c.q.rows(), c.q.cols());
    for (Index i = 0; i < out.rows(); i++)
        out.row(i) = rbd::gravity(mine, c.q.row(i)).transpose();
    return out;
}

// Loads at which the declared soft wind-up falls, and a margin: there a small error of the load is a
// large one of the torque.
Mask soft_mask(const hdt_arm &arm, Index j, double margin_nm, const MatrixXd &gravity, const Conditioned &c)
{
    Mask m(static_cast<std::size_t>(c.t_s.size()), 0);
    const hdt_arm_joint &aj = arm.joint[j];
    if (!aj.has_stiffness || margin_nm <= 0)
        return m;
    for (Index i = 0; i < c.t_s.size(); i++) {
        const hdt_arm_stiffness &k = aj.stiffness[c.dir(i, j) < 0 ? 1 : 0];
        const double load = gravity(i, j) + spring_nm(aj, c.q(i, j));
        m[static_cast<std::size_t>(i)] = load > k.t1_nm - margin_nm && load < k.t2_nm + margin_nm;
    }
    return m;
}

void mask_joint(const hdt_arm &arm, const std::vector<Segment> &segs, Index j,
                const ConditionOptions &options, const MatrixXd &gravity, Conditioned *c)
{
    const hdt_arm_joint &aj = arm.joint[j];
    Mask gap = gap_mask(c->t_s, segs, c->smooth_s[j]);
    Mask spike = spike_mask(c->tau.col(j), c->rate_hz);
    Mask still = standstill_mask(*c, j, options);
    Mask soft = soft_mask(arm, j, options.soft_margin_nm, gravity, *c);
    double limit = saturation_share * aj.tau_max_m_nm * aj.ratio;
    MaskCount &count = c->masked[static_cast<std::size_t>(j)];
    for (Index i = 0; i < c->t_s.size(); i++) {
        std::size_t k = static_cast<std::size_t>(i);
        bool saturated = limit > 0 && std::fabs(c->tau(i, j)) >= limit;
        if (gap[k])
            count.gap++;
        else if (spike[k])
            count.spike++;
        else if (saturated)
            count.saturated++;
        else if (still[k])
            count.standstill++;
        else if (soft[k])
            count.soft++;
        else
            c->valid(i, j) = true;
    }
}

// A file without masses: every link carries something somewhere.
hdt_arm with_masses(hdt_arm arm)
{
    for (int j = 0; j < arm.joints; j++)
        if (arm.joint[j].has_inertial)
            return arm;
    for (int j = 0; j < arm.joints; j++) {
        arm.joint[j].mass_kg = 1;
        for (double &x : arm.joint[j].moment_kgm)
            x = 0.1;
    }
    return arm;
}

// Gravity of every joint with the angles as given and with one of them elsewhere, over poses spread evenly.
void find_unknown_angles(const hdt_arm &given, Conditioned *c)
{
    const hdt_arm arm = with_masses(arm_for_run(given, *c));
    const Index n = arm.joints;
    c->unknown_angles.assign(static_cast<std::size_t>(n), {});
    if (std::count(c->present.begin(), c->present.end(), 0) == 0)
        return;
    MatrixXd moved = MatrixXd::Zero(n, n); // [joint, absent]: most it changes by
    VectorXd most = VectorXd::Zero(n);
    for (int pose = 0; pose < carry_poses; pose++) {
        VectorXd q(n);
        for (Index j = 0; j < n; j++) { // a lattice of irrational steps
            const double step = std::sqrt(2.0 + 3.0 * static_cast<double>(j));
            q[j] = 2 * M_PI * std::fmod(pose * step, 1.0);
        }
        const VectorXd g = rbd::gravity(arm, q);
        most = most.cwiseMax(g.cwiseAbs());
        for (Index a = 0; a < n; a++) {
            if (c->present[static_cast<std::size_t>(a)])
                continue;
            VectorXd elsewhere = q;
            elsewhere[a] += 2 + 0.1 * pose;
            moved.col(a) = moved.col(a).cwiseMax((rbd::gravity(arm, elsewhere) - g).cwiseAbs());
        }
    }
    for (Index j = 0; j < n; j++)
        for (Index a = 0; a < n && c->present[static_cast<std::size_t>(j)]; a++)
            if (moved(j, a) > std::max(carry_least_nm, carry_share * most[j]))
                c->unknown_angles[static_cast<std::size_t>(j)].push_back(static_cast<int>(a) + 1);
}

void cut_blocks(double block_s, Conditioned *c)
{
    c->block_begin.clear();
    double last = -1;
    for (Index i = 0; i < c->t_s.size(); i++) {
        double b = std::floor(c->t_s[i] / block_s + 1e-6);
        if (b != last)
            c->block_begin.push_back(i);
        last = b;
    }
    c->block_begin.push_back(c->t_s.size());
}

void fill(const Run &run, const hdt_arm &arm, Conditioned *c)
{
    Index n = static_cast<Index>(run.rows()), joints = arm.joints;
    c->name = run.path;
    c->t_s = Eigen::Map<const VectorXd>(run.t_s.data(), n).array() - run.t_s[0];
    c->q = c->v = c->a = c->dir = c->travel = c->built_up = c->tau = MatrixXd::Zero(n, joints);
    c->valid.setConstant(n, joints, false);
    c->masked.assign(static_cast<std::size_t>(joints), {});
    c->present.assign(static_cast<std::size_t>(joints), 0);
    c->smooth_s = c->v_noise = c->a_noise = c->v_min = VectorXd::Zero(joints);
    for (std::size_t j = 0; j < run.joint.size(); j++) {
        const Run::Joint &jt = run.joint[j];
        if (!jt.present)
            continue;
        Index col = static_cast<Index>(j);
        c->present[j] = 1;
        c->q.col(col) = Eigen::Map<const VectorXd>(jt.q_rad.data(), n);
        c->tau.col(col) = Eigen::Map<const VectorXd>(jt.tau_nm.data(), n);
        if (jt.temp_degc.size() == run.rows()) {
            if (c->temp.size() == 0)
                c->temp = MatrixXd::Zero(n, joints);
            c->temp.col(col) = Eigen::Map<const VectorXd>(jt.temp_degc.data(), n);
        }
    }
    c->payload_declared = run.constants.count("payload_kg") > 0 || run.constants.count("payload_com_m") > 0;
    c->payload_kg = run.constant("payload_kg", arm.payload_kg);
    c->payload_com_m = Eigen::Map<const Eigen::Vector3d>(arm.payload_com_m);
    std::vector<double> com = run.constant_vector("payload_com_m");
    if (!com.empty() && com.size() != 3)
        bad(run,
            text("payload_com_m: expected %.0f numbers, found %.0f", 3, static_cast<double>(com.size())));
    if (!com.empty())
        c->payload_com_m = Eigen::Map<const Eigen::Vector3d>(com.data());
    if (!(c->payload_kg >= 0))
        bad(run, text("payload_kg: expected %.0f or more, found %.4g", 0, c->payload_kg));
}

} // namespace

Conditioned condition(const Run &run, const hdt_arm &arm, const ConditionOptions &options)
{
    check_run(run, arm);
    if (!(options.block_s > 0))
        bad(run, text("block length: expected more than %.0f s, found %.4g s", 0, options.block_s));
    Conditioned c;
    double dt;
    c.rate_hz = rate_of(run, &dt);
    fill(run, arm, &c);
    find_unknown_angles(arm, &c);
    std::vector<Segment> segs = segments(c.t_s, std::max(5 * dt, 0.02));
    differentiate(segs, dt, &c);
    const MatrixXd gravity = soft_gravity(arm, options.soft_margin_nm, c);
    for (Index j = 0; j < arm.joints; j++) {
        if (!c.present[static_cast<std::size_t>(j)])
            continue;
        prefer_reference(run.joint[static_cast<std::size_t>(j)], segs, j, &c);
        c.v_min[j] = options.v_min_radps > 0 ? options.v_min_radps
                                             : std::max(v_min_floor_radps, 3 * c.v_noise[j]);
        direction(j, &c);
        mask_joint(arm, segs, j, options, gravity, &c);
    }
    cut_blocks(options.block_s, &c);
    return c;
}

Sample Conditioned::sample(Index row) const
{
    return {t_s[row], q.row(row), v.row(row), a.row(row), dir.row(row), travel.row(row)};
}

std::vector<Index> Conditioned::blocks(int j) const
{
    std::vector<Index> out;
    for (std::size_t b = 0; b + 1 < block_begin.size(); b++) {
        Index lo = block_begin[b], n = block_begin[b + 1] - lo;
        Index good = valid.col(j).segment(lo, n).count();
        if (good > 0 && 2 * good >= n)
            out.push_back(static_cast<Index>(b));
    }
    return out;
}

MatrixXd Conditioned::block_means(int j, const Eigen::Ref<const MatrixXd> &full) const
{
    std::vector<Index> which = blocks(j);
    MatrixXd out = MatrixXd::Zero(static_cast<Index>(which.size()), full.cols());
    for (Index k = 0; k < out.rows(); k++) {
        std::size_t b = static_cast<std::size_t>(which[static_cast<std::size_t>(k)]);
        Index good = 0;
        for (Index i = block_begin[b]; i < block_begin[b + 1]; i++)
            if (valid(i, j)) {
                out.row(k) += full.row(i);
                good++;
            }
        out.row(k) /= static_cast<double>(good);
    }
    return out;
}

VectorXd Conditioned::block_mean(int j, const Eigen::Ref<const VectorXd> &full) const
{
    return block_means(j, full);
}

hdt_arm arm_for_run(const hdt_arm &arm, const Conditioned &c)
{
    hdt_arm out = arm;
    out.payload_kg = c.payload_kg;
    Eigen::Map<Eigen::Vector3d>(out.payload_com_m) = c.payload_com_m;
    return out;
}

std::string unknown_angle_words(int joint, const std::vector<std::vector<int>> &per_run)
{
    std::set<int> missing;
    std::size_t runs = 0;
    for (const std::vector<int> &each : per_run) {
        missing.insert(each.begin(), each.end());
        runs += !each.empty();
    }
    std::string list, columns;
    for (int a : missing) {
        list += (list.empty() ? "" : ", ") + std::to_string(a);
        columns += (columns.empty() ? "q" : ", q") + std::to_string(a) + "_rad";
    }
    if (runs == 0)
        return "";
    const std::string me = "joint " + std::to_string(joint);
    return me + ": " + std::to_string(runs) + " of " + std::to_string(per_run.size())
           + " runs do not have the angle of joint " + list + ", on which the load of " + me
           + " depends by the arm file; taken as standing at 0 rad: if not, what is found for " + me
           + " is wrong. Log " + columns + " and their torques too, standing or not";
}

std::vector<MatrixXd> declared_terms(const hdt_arm &arm, const Conditioned &c)
{
    hdt_arm mine = arm_for_run(arm, c);
    Index n = c.t_s.size();
    std::vector<MatrixXd> out(static_cast<std::size_t>(arm.joints), MatrixXd::Zero(n, HDT_TERMS));
    auto rows = [&](Index lo, Index hi) {
        for (Index i = lo; i < hi; i++) {
            std::vector<TermTorque> term = arm_terms(mine, c.sample(i));
            for (std::size_t j = 0; j < out.size(); j++)
                for (std::size_t k = 0; k < HDT_TERMS; k++)
                    out[j](i, static_cast<Index>(k)) = term[j][k];
        }
    };
    // rows are independent: the split changes no digit
    Index parts = std::clamp<Index>(static_cast<Index>(std::thread::hardware_concurrency()), 1, 8);
    std::vector<std::thread> pool;
    for (Index p = 1; p < parts; p++)
        pool.emplace_back(rows, n * p / parts, n * (p + 1) / parts);
    rows(0, n / parts);
    for (std::thread &t : pool)
        t.join();
    return out;
}

} // namespace hdt
