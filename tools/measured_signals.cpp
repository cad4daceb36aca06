// SPDX-License-Identifier: Apache-2.0
//
// Owns: the measures of measured_signals.hpp.
// Never: fits a model file; writes a page.
#include "tools/measured_signals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/dataset.hpp"
#include "model/ident.hpp"

namespace hdt::measured {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Complex = std::complex<double>;

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurn = 2 * M_PI;
constexpr double kPiece_s = 0.5;        // rows farther apart than this are taken as independent
constexpr double kNeighbours = 0.15;    // of an order, each side, or this many steps at least:
constexpr std::size_t kNeighbourSteps = 20;
constexpr Index kRowsMin = 100;

const std::vector<double> *sensor_of(const Run &run, int joint)
{
    const auto found = run.extra.find("tau_sensor" + std::to_string(joint) + "_nm");
    if (found == run.extra.end())
        return nullptr;
    const auto zero = [](double x) { return x == 0; };
    return std::all_of(found->second.begin(), found->second.end(), zero) ? nullptr : &found->second;
}

VectorXd picked(const Conditioned &c, int j, const VectorXd &x, Rows rows)
{
    if (rows == Rows::Every)
        return x;
    if (rows == Rows::Blocks)
        return c.block_mean(j, x);
    VectorXd out(c.valid.col(j).count());
    Index n = 0;
    for (Index i = 0; i < x.size(); ++i)
        if (c.valid(i, j))
            out[n++] = x[i];
    return out;
}

// Amplitude of a line in each direction, as complex numbers, and the rows they were taken from.
struct Directed { Complex up, down; double rows_up = 0, rows_down = 0; };

double amplitude(const Directed &d)
{
    const double rows = d.rows_up + d.rows_down;
    return rows > 0 ? std::sqrt((d.rows_up * std::norm(d.up) + d.rows_down * std::norm(d.down)) / rows) : 0;
}

Directed line_of(const std::vector<Signal> &runs, double order)
{
    Directed d;
    for (const Signal &s : runs)
        for (Index i = 0; i < s.q_rad.size(); ++i) {
            const Complex z = s.residual_nm[i] * std::polar(1.0, -order * s.q_rad[i]);
            (s.dir[i] < 0 ? d.down : d.up) += 2.0 * z;
            (s.dir[i] < 0 ? d.rows_down : d.rows_up) += 1;
        }
    d.up /= std::max(d.rows_up, 1.0);
    d.down /= std::max(d.rows_down, 1.0);
    return d;
}

double travelled_rad(const std::vector<Signal> &runs)
{
    double lo = 1e9, hi = -1e9;
    for (const Signal &s : runs)
        if (s.q_rad.size() > 0) {
            lo = std::min(lo, s.q_rad.minCoeff());
            hi = std::max(hi, s.q_rad.maxCoeff());
        }
    return hi > lo ? hi - lo : 0;
}

double median_of(std::vector<double> x)
{
    if (x.empty())
        return kUnknown;
    const auto mid = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
    std::nth_element(x.begin(), mid, x.end());
    return *mid;
}

double floor_at(const Spectrum &s, std::size_t k)
{
    const auto wide = static_cast<std::size_t>(kNeighbours * s.order(k) / s.step);
    const std::size_t half = std::max(kNeighbourSteps, wide);
    const std::size_t lo = k > half ? k - half : 0, hi = std::min(s.amplitude_nm.size(), k + half + 1);
    return median_of({s.amplitude_nm.begin() + static_cast<std::ptrdiff_t>(lo),
                      s.amplitude_nm.begin() + static_cast<std::ptrdiff_t>(hi)});
}

// Normal equations of one piece of time.
struct Piece { MatrixXd a; VectorXd b; };

std::vector<Piece> pieces_of(const MatrixXd &x, const VectorXd &y, const VectorXd &t_s)
{
    std::vector<Piece> out;
    for (Index i = 0, begin = 0; i <= y.size(); ++i)
        if (i == y.size() || t_s[i] - t_s[begin] >= kPiece_s) {
            const MatrixXd part = x.middleRows(begin, i - begin);
            out.push_back({part.transpose() * part, part.transpose() * y.segment(begin, i - begin)});
            begin = i;
        }
    return out;
}

// Least squares over the pieces and a covariance that trusts only how the pieces scatter.
struct Solved { VectorXd value, sigma; };

Solved solve(const std::vector<Piece> &pieces)
{
    Piece all{MatrixXd::Zero(pieces[0].a.rows(), pieces[0].a.cols()), VectorXd::Zero(pieces[0].b.size())};
    for (const Piece &p : pieces) {
        all.a += p.a;
        all.b += p.b;
    }
    const MatrixXd inverse = all.a.completeOrthogonalDecomposition().pseudoInverse();
    Solved s{inverse * all.b, {}};
    MatrixXd meat = MatrixXd::Zero(all.a.rows(), all.a.cols());
    for (const Piece &p : pieces) {
        const VectorXd score = p.b - p.a * s.value;
        meat += score * score.transpose();
    }
    const double n = static_cast<double>(pieces.size()), used = static_cast<double>(s.value.size());
    const double few = n > used ? n / (n - used) : n;
    s.sigma = (few * inverse * meat * inverse).diagonal().cwiseMax(0.0).cwiseSqrt();
    return s;
}

MatrixXd friction_columns(const Signal &s)
{
    MatrixXd x(s.v_radps.size(), 3);
    x << s.dir, s.v_radps, VectorXd::Ones(s.v_radps.size());
    return x;
}

MatrixXd loss_columns(const Signal &s)
{
    MatrixXd x = MatrixXd::Zero(s.v_radps.size(), Loss::Count);
    for (Index i = 0; i < x.rows(); ++i) {
        const double load = s.sensor_nm[i];
        x(i, Loss::Coulomb) = s.dir[i];
        x(i, Loss::Viscous) = s.v_radps[i];
        x(i, load * s.dir[i] > 0 ? Loss::Drive : Loss::Back) = s.dir[i] * std::abs(load);
        x(i, Loss::Inertia) = s.a_radps2[i];
        x(i, Loss::Offset) = 1;
    }
    return x;
}

// What is left of each run by the fit of the columns `use` to the other runs.
double left_out_nm(const std::vector<MatrixXd> &x, const std::vector<VectorXd> &y,
    const std::vector<Index> &use)
{
    double sum = 0, rows = 0;
    for (std::size_t out = 0; out < x.size(); ++out) {
        MatrixXd a = MatrixXd::Zero(static_cast<Index>(use.size()), static_cast<Index>(use.size()));
        VectorXd b = VectorXd::Zero(a.rows());
        for (std::size_t r = 0; r < x.size(); ++r)
            if (r != out) {
                const MatrixXd part = x[r](Eigen::all, use);
                a += part.transpose() * part;
                b += part.transpose() * y[r];
            }
        const VectorXd fit = a.completeOrthogonalDecomposition().solve(b);
        sum += (y[out] - x[out](Eigen::all, use) * fit).squaredNorm();
        rows += static_cast<double>(y[out].size());
    }
    return rows > 0 ? std::sqrt(sum / rows) : kUnknown;
}

} // namespace

std::vector<Signal> signals(const ArmFile &arm, const Run &run, Rows rows)
{
    const IdentOptions as_fitted;
    ConditionOptions options;
    options.reversal_guard_s = as_fitted.reversal_guard_s;
    options.reversal_travel_rad = as_fitted.reversal_travel_rad;
    const Conditioned c = condition(run, arm.arm(), options);
    const std::vector<MatrixXd> terms = declared_terms(arm.arm(), c);
    std::vector<Signal> out;
    for (int j = 0; j < arm.arm().joints; ++j) {
        const auto k = static_cast<std::size_t>(j);
        if (!c.present[k] || c.valid.col(j).count() < kRowsMin)
            continue;
        const auto pick = [&](const VectorXd &x) { return picked(c, j, x, rows); };
        Signal s;
        s.joint = j + 1;
        s.t_s = pick(c.t_s);
        s.q_rad = pick(c.q.col(j));
        s.v_radps = pick(c.v.col(j));
        s.a_radps2 = pick(c.a.col(j));
        s.dir = pick(c.dir.col(j));
        s.tau_nm = pick(c.tau.col(j));
        const double gain = arm.arm().joint[j].torque_gain;
        s.residual_nm = pick(c.tau.col(j) - terms[k].rowwise().sum() / gain);
        s.friction_nm = pick(terms[k].col(HDT_TERM_FRICTION) / gain);
        if (const std::vector<double> *sensor = sensor_of(run, s.joint))
            s.sensor_nm = pick(Eigen::Map<const VectorXd>(sensor->data(), c.t_s.size()));
        out.push_back(std::move(s));
    }
    return out;
}

double rms_nm(const VectorXd &x)
{
    return x.size() > 0 ? std::sqrt(x.squaredNorm() / static_cast<double>(x.size())) : 0;
}

double rms_nm(const std::vector<Signal> &runs)
{
    double sum = 0, rows = 0;
    for (const Signal &s : runs) {
        sum += s.residual_nm.squaredNorm();
        rows += static_cast<double>(s.residual_nm.size());
    }
    return rows > 0 ? std::sqrt(sum / rows) : kUnknown;
}

double rms_of_means_nm(const std::vector<Signal> &runs, double stretch_s)
{
    double squares = 0, stretches = 0;
    for (const Signal &s : runs)
        for (Index i = 0, begin = 0; i <= s.t_s.size(); ++i)
            if (i == s.t_s.size() || s.t_s[i] - s.t_s[begin] >= stretch_s) {
                const double mean = s.residual_nm.segment(begin, i - begin).mean();
                squares += static_cast<double>(i - begin) * mean * mean;
                stretches += static_cast<double>(i - begin);
                begin = i;
            }
    return stretches > 0 ? std::sqrt(squares / stretches) : kUnknown;
}

double friction_alone_nm(const std::vector<Signal> &fit, const std::vector<Signal> &test)
{
    if (fit.empty() || test.empty())
        return kUnknown;
    MatrixXd a = MatrixXd::Zero(3, 3);
    VectorXd b = VectorXd::Zero(3);
    for (const Signal &s : fit) {
        const MatrixXd x = friction_columns(s);
        a += x.transpose() * x;
        b += x.transpose() * s.tau_nm;
    }
    const VectorXd friction = a.completeOrthogonalDecomposition().solve(b);
    double sum = 0, rows = 0;
    for (const Signal &s : test) {
        sum += (s.tau_nm - friction_columns(s) * friction).squaredNorm();
        rows += static_cast<double>(s.tau_nm.size());
    }
    return std::sqrt(sum / rows);
}

Spectrum order_spectrum(const std::vector<Signal> &runs, double highest)
{
    Spectrum out;
    const double range = travelled_rad(runs);
    if (!(range > 0))
        return out;
    // a line needs one and a half periods of travel, else it is a slope by another name
    out.first = std::max(1.0, std::ceil(1.5 * kTurn / range));
    out.step = std::clamp(0.25 * kTurn / range, 0.25, 5.0);
    const auto count = highest < out.first ? 0 : 1 +
        static_cast<std::size_t>((highest - out.first) / out.step);
    std::vector<Directed> sum(count);
    for (const Signal &s : runs)
        for (Index i = 0; i < s.q_rad.size(); ++i) {
            // one rotation a step of order instead of a sine
            Complex z = 2 * s.residual_nm[i] * std::polar(1.0, -out.first * s.q_rad[i]);
            const Complex turn = std::polar(1.0, -out.step * s.q_rad[i]);
            for (Directed &d : sum) {
                (s.dir[i] < 0 ? d.down : d.up) += z;
                z *= turn;
            }
        }
    double up = 0, down = 0;
    for (const Signal &s : runs) {
        down += static_cast<double>((s.dir.array() < 0).count());
        up += static_cast<double>((s.dir.array() >= 0).count());
    }
    for (const Directed &d : sum)
        out.amplitude_nm.push_back(amplitude({d.up / std::max(up, 1.0), d.down / std::max(down, 1.0), up,
            down}));
    return out;
}

Line line_at(const std::vector<Signal> &runs, double order)
{
    const Directed d = line_of(runs, order);
    Line line{order, amplitude(d), kUnknown, d.up, d.down};
    const Spectrum s = order_spectrum(runs, order * (1 + kNeighbours) + 100);
    if (s.amplitude_nm.empty() || order < s.first)
        return line;
    const auto k = static_cast<std::size_t>(std::lround((order - s.first) / s.step));
    line.over_floor = line.amplitude_nm / floor_at(s, std::min(k, s.amplitude_nm.size() - 1));
    return line;
}

std::vector<Line> strongest_lines(std::vector<Signal> runs, double highest, std::size_t most,
    double over_floor)
{
    std::vector<Line> out;
    while (out.size() < most) {
        const Spectrum s = order_spectrum(runs, highest);
        Line best;
        for (std::size_t k = 1; k + 1 < s.amplitude_nm.size(); ++k) {
            const double a = s.amplitude_nm[k];
            if (a < s.amplitude_nm[k - 1] || a < s.amplitude_nm[k + 1] || a <= best.amplitude_nm)
                continue;
            const double over = a / floor_at(s, k);
            if (over >= over_floor)
                best = {s.order(k), a, over, 0, 0};
        }
        if (best.order == 0)
            return out;
        // between the grid's steps
        for (double step = s.step / 2; step > s.step / 40; step /= 2)
            for (const double at : {best.order - step, best.order + step})
                if (const double a = amplitude(line_of(runs, at)); a > best.amplitude_nm)
                    best = {at, a, best.over_floor, 0, 0};
        const Directed d = line_of(runs, best.order);
        best.up = d.up;
        best.down = d.down;
        runs = without_lines(std::move(runs), {best});
        out.push_back(best);
    }
    return out;
}

std::vector<Signal> without_lines(std::vector<Signal> runs, const std::vector<Line> &lines)
{
    for (Signal &r : runs)
        for (const Line &line : lines)
            for (Index i = 0; i < r.q_rad.size(); ++i)
                r.residual_nm[i] -= std::real((r.dir[i] < 0 ? line.down : line.up) *
                                              std::polar(1.0, line.order * r.q_rad[i]));
    return runs;
}

Loss gear_loss(const std::vector<Signal> &runs)
{
    std::vector<MatrixXd> x;
    std::vector<VectorXd> y;
    std::vector<Piece> pieces;
    Loss out;
    double sum = 0, load = 0;
    for (const Signal &s : runs) {
        if (s.sensor_nm.size() == 0)
            continue;
        x.push_back(loss_columns(s));
        y.push_back(s.tau_nm - s.sensor_nm);
        for (Piece &p : pieces_of(x.back(), y.back(), s.t_s))
            pieces.push_back(std::move(p));
        sum += y.back().squaredNorm();
        load += s.sensor_nm.squaredNorm();
        out.rows += static_cast<std::size_t>(y.back().size());
    }
    if (x.size() < 2)
        throw InputError("gear loss: expected at least two runs with a link sensor (tau_sensor{j}_nm), "
                         "found " +
                         std::to_string(x.size()));
    const Solved fit = solve(pieces);
    out.value = fit.value;
    out.sigma = fit.sigma;
    out.loss_rms_nm = std::sqrt(sum / static_cast<double>(out.rows));
    out.load_rms_nm = std::sqrt(load / static_cast<double>(out.rows));
    out.left_constant_nm = left_out_nm(x, y, {Loss::Coulomb, Loss::Viscous, Loss::Inertia, Loss::Offset});
    out.left_nm = left_out_nm(x, y, {Loss::Coulomb, Loss::Viscous, Loss::Drive, Loss::Back, Loss::Inertia,
        Loss::Offset});
    return out;
}

FrictionShare friction_share(const Signal &s)
{
    if (s.friction_nm.size() < kRowsMin || s.friction_nm.squaredNorm() == 0)
        return {kUnknown, kUnknown};
    const Solved fit = solve(pieces_of(s.friction_nm, s.residual_nm, s.t_s));
    return {1 + fit.value[0], fit.sigma[0]};
}

} // namespace hdt::measured
