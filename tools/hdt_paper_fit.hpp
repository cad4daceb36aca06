// SPDX-License-Identifier: Apache-2.0
//
// The fits of Kennedy and Desai 2005: friction against speed (Tables I, II), lines of periodic
// friction (Table III), soft wind-up as three lines of load (Table V).
//
// Owns: the fits and what they are worth.
// Never: runs an arm or knows what is in it; pure functions of their arguments, any thread.
#pragma once

#include <complex>
#include <vector>

#include <Eigen/Dense>

#include "model/hdt_arm.h"

namespace hdt::paper {

// ---- friction against speed, one direction, magnitudes along the motion ----

// Mean torque of several trials at one speed.
struct SpeedPoint {
    double speed_radps = 0, mean_nm = 0;
    double sd_nm = 0;                    // of one trial; 0: not known (fewer than two trials)
    int trials = 0;
};

struct FrictionModelFit {
    Eigen::VectorXd parameters;          // viscous F0 Fv; cubic c0 .. c3; Stribeck F0 Fv Fs Vc
    Eigen::VectorXd sigma;               // of the parameters, from the scatter of the trials
    double variance = 0;                 // eq. (6): sum of ((mean - model) / sd of a trial)^2
    double rms_nm = 0;                   // unweighted
};

// Weighted least squares, weight 1 / sd^2; points without sd weigh alike.  Throws
// std::invalid_argument for fewer points than parameters.
FrictionModelFit fit_viscous(const std::vector<SpeedPoint> &points);
FrictionModelFit fit_cubic(const std::vector<SpeedPoint> &points);
// F0 + Fv v + Fs (1 - exp(-v / Vc)): linear in all but Vc, which is searched from half the slowest to
// twice the fastest speed.
FrictionModelFit fit_stribeck(const std::vector<SpeedPoint> &points);
hdt_arm_friction stribeck_of(const FrictionModelFit &fit);

// "MSE per DOF" as Table I prints it: 1 + variance / (6 - parameters) in all its 21 entries.
double printed_mse(double variance, int parameters);

// ---- lines over position ----

// Torque averaged into equal bins of angle.
struct AngleTable {
    double from_rad = 0, step_rad = 0;   // first bin's left edge; width
    std::vector<double> nm;              // no empty bins: those are interpolated
    double at(double q_rad) const;       // linear between bin centres, constant beyond the ends
    double mean() const;
    double to_rad() const { return from_rad + step_rad * static_cast<double>(nm.size()); }
};
// Samples outside [from, to) are left out.  Throws std::invalid_argument when no sample is inside.
AngleTable tabulate(const std::vector<double> &q_rad, const std::vector<double> &nm, double from_rad,
                    double to_rad,
                    std::size_t bins);

// amplitude * sin(2 pi frequency q + phase)
struct AngleLine {
    double cycles_per_rad = 0, amplitude_nm = 0, phase_rad = 0;
};

// In place; the size must be a power of two (else std::invalid_argument).
void fft(std::vector<std::complex<double>> &x);

// One-sided amplitude spectrum of the zero-mean table, Hann window, padded to a power of two.
struct Spectrum { std::vector<double> cycles_per_rad, amplitude_nm; };
Spectrum spectrum(const AngleTable &table);

// The strongest `count` lines at or above `lowest`, found one after the other in the spectrum of
// what the lines before leave; frequencies refined between bins, amplitudes and phases of all
// fitted together at the end.  By frequency.
std::vector<AngleLine> find_lines(const AngleTable &table, std::size_t count, double lowest_cycles_per_rad);
double lines_nm(const std::vector<AngleLine> &lines, double q_rad);

// ---- three lines of load ----

struct HingeFit {
    hdt_arm_stiffness lines{};           // slopes, t1 <= t2, value at load 0
    double rms_nm = 0;                   // of what is left
    double flat_rms_nm = 0;              // of what one straight line leaves
    // change of the torque over the middle region
    double step_nm() const { return lines.slope[1] * (lines.t2_nm - lines.t1_nm); }
};

// The continuous curve of three straight lines with least squares; both hinges free, the middle
// region at least `narrowest` of the load's range, and each region holding 2 % of the points.
// Throws std::invalid_argument for fewer than 20 points or no range.
HingeFit fit_hinges(const std::vector<double> &load_nm, const std::vector<double> &nm, double narrowest =
                    0.01);

// Amplitude of given lines (cycles per rad) inside and outside the middle region: a sine and cosine
// each, fitted together with the three lines' own shape; root of the sum of squared amplitudes.
struct RegionRipple { double inside_nm = 0, outside_nm = 0; };
RegionRipple ripple_by_region(const std::vector<double> &q_rad, const std::vector<double> &load_nm,
                              const std::vector<double> &nm, const hdt_arm_stiffness &lines,
                              const std::vector<double> &cycles_per_rad);

} // namespace hdt::paper
