// SPDX-License-Identifier: Apache-2.0
//
// Owns: order and frequency grids, screening, block-averaged line columns (see scan.hpp).
// Never: decides.
#include "model/scan.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numeric>

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr std::size_t kSpeedBins = 64;

double sinc(double x)
{
    return std::abs(x) < 1e-6 ? 1 - x * x / 6 : std::sin(x) / x;
}

// Sums over all rows of w sin(order q) and w cos(order q), split by direction, for every order of
// the grid: one rotation per row and order instead of a sine.
struct DirectedSums { std::vector<std::array<double, 4>> at; }; // sin+, cos+, sin-, cos-

DirectedSums line_sums(const std::vector<ScanRows> &runs, const std::vector<VectorXd> &w,
                       const OrderGrid &grid)
{
    const std::size_t n = grid.count();
    DirectedSums s{std::vector<std::array<double, 4>>(n, {0, 0, 0, 0})};
    for (std::size_t r = 0; r < runs.size(); ++r) {
        const ScanRows &d = runs[r];
        for (Index t = 0; t < d.q_rad.size(); ++t) {
            // direction is +-1 on rows that count; in between the row belongs to both by its weight
            const double up = 0.5 * (1 + d.dir[t]) * w[r][t], down = 0.5 * (1 - d.dir[t]) * w[r][t];
            double si = std::sin(grid.first * d.q_rad[t]), co = std::cos(grid.first * d.q_rad[t]);
            const double sd = std::sin(grid.step * d.q_rad[t]), cd = std::cos(grid.step * d.q_rad[t]);
            for (std::size_t k = 0; k < n; ++k) {
                s.at[k][0] += up * si;
                s.at[k][1] += up * co;
                s.at[k][2] += down * si;
                s.at[k][3] += down * co;
                const double next = si * cd + co * sd;
                co = co * cd - si * sd;
                si = next;
            }
        }
    }
    return s;
}

// Rows by speed: enough to know the noise at a line's frequency.
struct SpeedHistogram {
    double step = 0;
    std::array<double, kSpeedBins> rows{};
};

SpeedHistogram speed_histogram(const std::vector<ScanRows> &runs)
{
    SpeedHistogram h;
    double top = 1e-9;
    for (const ScanRows &r : runs)
        top = r.v_radps.size() > 0 ? std::max(top, r.v_radps.cwiseAbs().maxCoeff()) : top;
    h.step = top / static_cast<double>(kSpeedBins);
    for (const ScanRows &r : runs)
        for (Index t = 0; t < r.v_radps.size(); ++t)
            h.rows[std::min(kSpeedBins - 1, static_cast<std::size_t>(std::abs(r.v_radps[t]) / h.step))] += 1;
    return h;
}

} // namespace

std::size_t OrderGrid::count() const
{
    return last < first ? 0 : 1 + static_cast<std::size_t>((last - first) / step + 1e-9);
}

OrderGrid order_grid(const std::vector<ScanRows> &runs, double highest)
{
    double lo = 1e9, hi = -1e9;
    for (const ScanRows &r : runs) {
        if (r.q_rad.size() == 0)
            continue;
        lo = std::min(lo, r.q_rad.minCoeff());
        hi = std::max(hi, r.q_rad.maxCoeff());
    }
    const double range = std::max(hi - lo, 1e-3), resolution = kTwoPi / range;
    OrderGrid g;
    // a line needs one and a half periods within the travel, else it is a slope by another name
    g.first = std::max(1.0, std::ceil(1.5 * resolution));
    g.step = std::clamp(0.5 * resolution, 0.25, 10.0);
    // below the fastest order that two blocks a period can carry at the median speed
    std::vector<double> v;
    for (const ScanRows &r : runs)
        for (Index t = 0; t < r.v_radps.size(); ++t)
            v.push_back(std::abs(r.v_radps[t]));
    double slow = 1e-3;
    if (!v.empty()) {
        const auto mid = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 4);
        std::nth_element(v.begin(), mid, v.end());
        slow = std::max(slow, *mid);
    }
    const double block_s = runs.empty() ? 0.01 : runs[0].block_s;
    g.last = std::min(highest, kTwoPi / slow / (2 * block_s));
    return g;
}

OrderScan scan_orders(const std::vector<ScanRows> &runs, const std::vector<VectorXd> &score,
                      const NoiseModel &noise, const OrderGrid &grid)
{
    OrderScan out;
    out.grid = grid;
    const DirectedSums s = line_sums(runs, score, grid);
    const SpeedHistogram h = speed_histogram(runs);
    const double block_s = runs.empty() ? 0.01 : runs[0].block_s;
    for (std::size_t k = 0; k < grid.count(); ++k) {
        const double order = grid.first + grid.step * static_cast<double>(k);
        double info = 1e-300;
        for (std::size_t b = 0; b < kSpeedBins; ++b) {
            // variance of the sum: the rows are not weighted by what averaging leaves of the line
            const double advance = order * (static_cast<double>(b) + 0.5) * h.step * block_s;
            info += 0.5 * h.rows[b] * noise.information(advance);
        }
        const double sp = s.at[k][0], cp = s.at[k][1], sm = s.at[k][2], cm = s.at[k][3];
        out.power[0].push_back(0.5 * ((sp + sm) * (sp + sm) + (cp + cm) * (cp + cm)) / info);
        out.power[1].push_back(0.5 * ((sp - sm) * (sp - sm) + (cp - cm) * (cp - cm)) / info);
    }
    return out;
}

std::vector<LineHit> scan_peaks(const OrderScan &scan, std::size_t most)
{
    std::vector<LineHit> out;
    for (int kind = 0; kind < 2; ++kind) {
        std::vector<LineHit> hits;
        const std::vector<double> &p = scan.power[kind];
        for (std::size_t k = 0; k < p.size(); ++k)
            if ((k == 0 || p[k] >= p[k - 1]) && (k + 1 == p.size() || p[k] > p[k + 1]))
                hits.push_back({scan.grid.first + scan.grid.step * static_cast<double>(k), kind == 1, p[k]});
        std::stable_sort(hits.begin(), hits.end(),
                         [](const LineHit &a, const LineHit &b) { return a.power > b.power; });
        hits.resize(std::min(hits.size(), most));
        out.insert(out.end(), hits.begin(), hits.end());
    }
    return out;
}

TimeGrid time_grid(const BlockNumbers &blocks, double block_s)
{
    constexpr double slowest_hz = 0.5, periods = 0.45; // a period every so many blocks is the fastest
    Index most = 64;
    for (const auto &b : blocks)
        most = b.empty() ? most : std::max(most, b.back() - b.front() + 1);
    TimeGrid g;
    g.block_s = block_s;
    // twice as fine as the longest run resolves
    for (g.points = 128; g.points < 2 * static_cast<std::size_t>(most); g.points *= 2) {}
    g.first = static_cast<std::size_t>(std::ceil(slowest_hz / g.step_hz()));
    g.last = static_cast<std::size_t>(periods * static_cast<double>(g.points));
    return g;
}

namespace {

// Where noise is stronger around a frequency than the model says, a line has to stand out of that.
void calm_neighbourhood(std::vector<double> &power, std::vector<double> &information)
{
    constexpr std::ptrdiff_t reach = 40, skip = 4;
    constexpr double median_of_two = 1.3862943611198906; // of a chi square with two degrees of freedom
    const auto n = static_cast<std::ptrdiff_t>(power.size());
    std::vector<double> around, calm(power.size());
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        around.clear();
        for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, k - reach); i < std::min(n, k + reach + 1); ++i)
            if (std::abs(i - k) > skip)
                around.push_back(power[static_cast<std::size_t>(i)]);
        if (around.empty())
            around.push_back(median_of_two);
        const auto mid = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 2);
        std::nth_element(around.begin(), mid, around.end());
        calm[static_cast<std::size_t>(k)] = std::max(1.0, *mid / median_of_two);
    }
    for (std::size_t k = 0; k < power.size(); ++k) {
        power[k] /= calm[k];
        information[k] /= calm[k];
    }
}

} // namespace

namespace {

// In place, radix two.
void fourier(std::vector<std::complex<double>> &x)
{
    const std::size_t n = x.size();
    for (std::size_t i = 1, j = 0; i < n; ++i) {
        std::size_t bit = n / 2;
        for (; j & bit; bit /= 2)
            j ^= bit;
        j ^= bit;
        if (i < j)
            std::swap(x[i], x[j]);
    }
    for (std::size_t half = 1; half < n; half *= 2)
        for (std::size_t k = 0; k < half; ++k) {
            const std::complex<double> turn = std::polar(1.0, -0.5 * kTwoPi * static_cast<double>(k) /
                                                                  static_cast<double>(half));
            for (std::size_t i = k; i < n; i += 2 * half) {
                const std::complex<double> low = x[i], high = turn * x[i + half];
                x[i] = low + high;
                x[i + half] = low - high;
            }
        }
}

} // namespace

TimeScan scan_times(const BlockNumbers &blocks, const std::vector<VectorXd> &score, const NoiseModel &noise,
                    const TimeGrid &grid)
{
    TimeScan out;
    out.grid = grid;
    for (std::size_t r = 0; r < blocks.size(); ++r) {
        std::vector<std::complex<double>> x(grid.points);
        for (std::size_t t = 0; t < blocks[r].size(); ++t)
            x[static_cast<std::size_t>(blocks[r][t] - blocks[r][0])] = score[r][static_cast<Index>(t)];
        fourier(x);
        std::vector<double> power, information;
        for (std::size_t k = 0; k < grid.count(); ++k) {
            const double omega = kTwoPi * grid.hz(k) * grid.block_s;
            information.push_back(0.5 * static_cast<double>(blocks[r].size()) * noise.information(omega) +
                                  1e-300);
            power.push_back(std::norm(x[grid.first + k]) / information.back());
        }
        calm_neighbourhood(power, information);
        out.power.push_back(std::move(power));
        out.information.push_back(std::move(information));
    }
    return out;
}

std::vector<std::size_t> time_peaks(const TimeScan &scan, std::size_t most)
{
    const std::size_t n = scan.grid.count();
    std::vector<double> sum(n, 0);
    for (const auto &run : scan.power)
        for (std::size_t k = 0; k < n; ++k)
            sum[k] += run[k];
    std::vector<std::size_t> order(n), out;
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return sum[a] > sum[b]; });
    for (std::size_t k : order) {
        const auto near = [k](std::size_t p) { return p < k + 8 && k < p + 8; };
        if (out.size() < most && std::none_of(out.begin(), out.end(), near))
            out.push_back(k);
    }
    return out;
}

double time_log_ratio(const TimeScan &scan, std::size_t run, std::size_t k, double variance_nm2)
{
    const double x = scan.information[run][k] * variance_nm2;
    return -std::log1p(x) + 0.5 * scan.power[run][k] * x / (1 + x);
}

double time_variance(const TimeScan &scan, const RunSet &use, std::size_t k)
{
    double sum = 0, runs = 0;
    for (std::size_t r = 0; r < use.size(); ++r)
        if (use[r]) {
            sum += 0.5 * (scan.power[r][k] - 2) / scan.information[r][k];
            runs += 1;
        }
    return runs > 0 ? std::max(0.0, sum / runs) : 0;
}

double time_log_e(const TimeScan &scan, std::size_t k, const std::vector<RunSet> &splits)
{
    std::vector<double> log_e;
    for (const RunSet &train : splits) {
        const double variance = time_variance(scan, train, k);
        double sum = 0;
        for (std::size_t r = 0; r < train.size(); ++r)
            sum += train[r] ? 0 : time_log_ratio(scan, r, k, variance);
        log_e.push_back(sum);
    }
    return log_mean_exp(log_e, static_cast<double>(std::max<std::size_t>(splits.size(), 1)));
}

MatrixXd line_columns(const ScanRows &rows, double order, bool directed)
{
    MatrixXd x(rows.q_rad.size(), 2);
    for (Index t = 0; t < x.rows(); ++t) {
        const double gain = sinc(0.5 * order * rows.v_radps[t] * rows.block_s) *
                            (directed ? rows.dir[t] : 1.0);
        x(t, 0) = gain * std::sin(order * rows.q_rad[t]);
        x(t, 1) = gain * std::cos(order * rows.q_rad[t]);
    }
    return x;
}

std::vector<double> order_spectrum(const std::vector<ScanRows> &runs, const std::vector<VectorXd> &y,
                                   const OrderGrid &grid, bool directed)
{
    const DirectedSums s = line_sums(runs, y, grid);
    double rows = 1e-9;
    for (const VectorXd &v : y)
        rows += static_cast<double>(v.size());
    const double sign = directed ? -1 : 1;
    std::vector<double> out;
    for (const auto &a : s.at)
        out.push_back(2 * std::hypot(a[0] + sign * a[2], a[1] + sign * a[3]) / rows);
    return out;
}

} // namespace hdt
