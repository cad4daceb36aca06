// SPDX-License-Identifier: Apache-2.0
//
// What is looked at in logs of real arms beside a fit: the residual row by row, its lines by order of
// the joint's turn, friction alone, the gear's loss where a link sensor was logged, friction run by run.
//
// Owns: these measures, each a plain function of rows.
// Never: fits a model file; writes a page.
#pragma once

#include <complex>
#include <vector>

#include <Eigen/Dense>

#include "model/arm_file.hpp"
#include "model/log.hpp"

namespace hdt::measured {

// One joint in one run; N.m output side.
struct Signal {
    int joint = 0;                  // 1-based
    Eigen::VectorXd t_s, q_rad, v_radps, a_radps2, dir;
    Eigen::VectorXd tau_nm;         // as logged
    Eigen::VectorXd residual_nm;    // as logged, less what the model says would be
    Eigen::VectorXd friction_nm;    // the model's velocity friction
    Eigen::VectorXd sensor_nm;      // link sensor, logged as tau_sensor{j}_nm; empty when there is none
};

// Every: the log's own rows.  Fitted: those a fit does not mask (standstill, spikes, gaps, just after a
// reversal).  Blocks: means of the fitted rows over the blocks that `hdt ident` uses.
enum class Rows { Every, Fitted, Blocks };

// Joints that the run has and that move.  Throws InputError when the run does not fit the arm.
std::vector<Signal> signals(const ArmFile &arm, const Run &run, Rows rows);

double rms_nm(const Eigen::VectorXd &x); // 0 of nothing
// Over all runs, of the residual.
double rms_nm(const std::vector<Signal> &runs);

// The same of its means over stretches of so many seconds: what a slower look would see.
double rms_of_means_nm(const std::vector<Signal> &runs, double stretch_s);

// Coulomb and viscous friction and an offset fitted to the torque itself, no geometry: what is left on
// other runs, N.m rms.  NaN when either has no rows.
double friction_alone_nm(const std::vector<Signal> &fit, const std::vector<Signal> &test);

// A torque line locked to the joint's angle.  Each direction has its own amplitude and phase, so that
// lines of sensor, gear and friction are all caught; amplitude_nm is their rms over the rows.
struct Line {
    double order = 0;               // periods a joint turn
    double amplitude_nm = 0;
    double over_floor = 0;          // amplitude over the median of its neighbours
    std::complex<double> up, down;  // of exp(i order q), per direction
};

// Amplitude at the orders first, first + step, ...
struct Spectrum {
    double first = 1, step = 1;
    std::vector<double> amplitude_nm;
    double order(std::size_t k) const { return first + step * static_cast<double>(k); }
};
Spectrum order_spectrum(const std::vector<Signal> &runs, double highest);
// The amplitude at one order, with its neighbourhood's median beneath it.
Line line_at(const std::vector<Signal> &runs, double order);
// Strongest first, one at a time, each taken out before the next is looked for; those less than
// over_floor times their neighbourhood are left out.
std::vector<Line> strongest_lines(std::vector<Signal> runs, double highest, std::size_t most,
    double over_floor);
// The runs with these lines taken off the residual.
std::vector<Signal> without_lines(std::vector<Signal> runs, const std::vector<Line> &lines);

// Loss of the gear, motor torque less link sensor, along the motion:
//   loss = dir (c + b |v| + drive |load| or back |load|) + reflected a + offset
// drive: the motor drives the load (load and motion have the same sign); load is the sensor's torque.
struct Loss {
    enum { Coulomb, Viscous, Drive, Back, Inertia, Offset, Count };
    Eigen::Matrix<double, Count, 1> value, sigma; // N.m, N.m s/rad, 1, 1, kg.m^2, N.m
    double load_rms_nm = 0;         // of the sensor
    double loss_rms_nm = 0;         // of motor less sensor
    double left_constant_nm = 0;    // left by a fit without the two load numbers
    double left_nm = 0;             // left by the whole fit, each run by the fit to the others
    std::size_t rows = 0;
};
// sigma is from the scatter of half-second pieces.  Throws InputError with fewer than two runs.
Loss gear_loss(const std::vector<Signal> &runs);

// A run's own friction as a share of the model's: least squares of the residual on the model's friction,
// sigma from the scatter of half-second pieces.  NaN when the run hardly moves.
struct FrictionShare { double share = 0, sigma = 0; };
FrictionShare friction_share(const Signal &run);

} // namespace hdt::measured
