// SPDX-License-Identifier: Apache-2.0
//
// Scan of the residual for torque lines locked to the output angle, of any order per output turn,
// conservative and signed by direction; and for lines of a frequency fixed in time.
//
// Owns: the grids of order and frequency, the screening statistic,
// the columns of a line averaged over blocks.
// Never: decides; a line found here is one candidate among all others.
#pragma once

#include <vector>

#include <Eigen/Dense>

#include "model/evidence.hpp"

namespace hdt {

// Angle, speed and direction of one joint in one run, block means, and how long a block is.
struct ScanRows { Eigen::VectorXd q_rad, v_radps, dir; double block_s; };

struct OrderGrid { double first = 1, last = 600, step = 1; std::size_t count() const; };

// Orders the travelled range can resolve; order is per output turn.
OrderGrid order_grid(const std::vector<ScanRows> &runs, double highest);

struct LineHit { double order; bool directed; double power; }; // power: log likelihood ratio, screened

// One value per grid order, conservative then directed.
struct OrderScan { OrderGrid grid; std::vector<double> power[2]; };
OrderScan scan_orders(const std::vector<ScanRows> &runs, const std::vector<Eigen::VectorXd> &score,
                      const NoiseModel &noise, const OrderGrid &grid);
// The strongest local maxima of each kind, at least a resolution apart.
std::vector<LineHit> scan_peaks(const OrderScan &scan, std::size_t most);

// Frequencies fixed in time, whatever the speed: those of a Fourier transform over `points` blocks.
// A line's phase is each run's own, so what the runs share is its power.
struct TimeGrid {
    std::size_t points = 0, first = 1, last = 0; // a power of two; bins first..last are looked at
    double block_s = 0.01;
    std::size_t count() const { return last < first ? 0 : last - first + 1; }
    double hz(std::size_t k) const { return static_cast<double>(first + k) * step_hz(); }
    double step_hz() const { return 1 / (static_cast<double>(points) * block_s); }
};
using BlockNumbers = std::vector<std::vector<Eigen::Index>>; // per run: number of each row's block, rising
TimeGrid time_grid(const BlockNumbers &blocks, double block_s);
// Per run and frequency: squared score over information, its mean 2 where there is only noise.  The
// information is the noise model's, or less where the neighbourhood of the frequency shows that the
// model has too little noise there.
struct TimeScan { TimeGrid grid; std::vector<std::vector<double>> power, information; };
TimeScan scan_times(const BlockNumbers &blocks, const std::vector<Eigen::VectorXd> &score,
                    const NoiseModel &noise, const TimeGrid &grid);
// Grid points of the strongest peaks of the power summed over runs, a resolution apart.
std::vector<std::size_t> time_peaks(const TimeScan &scan, std::size_t most);
// Log likelihood ratio of one run: a line of mean square amplitude 2 variance against none.
double time_log_ratio(const TimeScan &scan, std::size_t run, std::size_t k, double variance_nm2);
// The variance runs in use show at grid point k, by moments, at least 0.
double time_variance(const TimeScan &scan, const RunSet &use, std::size_t k);
// Mean over splits of the ratio of one half of the runs at the variance the other half shows: an e-value.
double time_log_e(const TimeScan &scan, std::size_t k, const std::vector<RunSet> &splits);

// sin and cos of order q, as their means over a block at constant speed; times direction if directed.
Eigen::MatrixXd line_columns(const ScanRows &rows, double order, bool directed);

// Amplitude spectrum over order of a series (plain least squares, one line at a time), N.m.
std::vector<double> order_spectrum(const std::vector<ScanRows> &runs, const std::vector<Eigen::VectorXd> &y,
                                   const OrderGrid &grid, bool directed);

} // namespace hdt
