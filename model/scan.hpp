// SPDX-License-Identifier: Apache-2.0
//
// Scan of the residual for torque lines locked to the output angle, of any order per output turn,
// conservative and signed by direction.
//
// Owns: the order grid, the screening statistic, the columns of a line averaged over blocks.
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

// sin and cos of order q, as their means over a block at constant speed; times direction if directed.
Eigen::MatrixXd line_columns(const ScanRows &rows, double order, bool directed);

// Amplitude spectrum over order of a series (plain least squares, one line at a time), N.m.
std::vector<double> order_spectrum(const std::vector<ScanRows> &runs, const std::vector<Eigen::VectorXd> &y,
                                   const OrderGrid &grid, bool directed);

} // namespace hdt
