// SPDX-License-Identifier: Apache-2.0
//
// Owns: order grid, screening, block-averaged line columns (see scan.hpp).
// Never: decides.
#include "model/scan.hpp"

#include <algorithm>
#include <array>
#include <cmath>

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

DirectedSums line_sums(const std::vector<ScanRows> &runs, const std::vector<VectorXd> &w, const OrderGrid &grid)
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
        std::stable_sort(hits.begin(), hits.end(), [](const LineHit &a, const LineHit &b) { return a.power > b.power; });
        hits.resize(std::min(hits.size(), most));
        out.insert(out.end(), hits.begin(), hits.end());
    }
    return out;
}

MatrixXd line_columns(const ScanRows &rows, double order, bool directed)
{
    MatrixXd x(rows.q_rad.size(), 2);
    for (Index t = 0; t < x.rows(); ++t) {
        const double gain = sinc(0.5 * order * rows.v_radps[t] * rows.block_s) * (directed ? rows.dir[t] : 1.0);
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
