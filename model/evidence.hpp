// SPDX-License-Identifier: Apache-2.0
//
// Evidence that a residual holds more than noise.  The independent unit is the run: friction
// residuals are strongly coloured, so a count of samples means nothing.
//
// Owns: the noise model (coloured noise plus random effects per run), whitened Gram matrices per
// run, run-split e-values, leave-one-run-out gains, control of false discoveries over everything tried.
// Never: knows what a column means; looks at held-out runs.
#pragma once

#include <vector>

#include <Eigen/Dense>

namespace hdt {

// Rows of one joint in one run, in time order.
struct RunRows {
    Eigen::VectorXd y;              // N.m
    Eigen::MatrixXd fixed;          // nuisance columns, one coefficient for all runs
    Eigen::VectorXd prior;          // precision of those coefficients about zero; empty: free
    Eigen::MatrixXd random;         // columns whose coefficient is drawn anew in every run
    std::vector<int> group;         // variance group of each random column
    std::vector<int> lags;          // unbroken predecessors of each row
};

enum RandomGroup { RG_COULOMB, RG_VISCOUS, RG_OFFSET, RG_FRICTION_WANDER, RG_OFFSET_WANDER, RG_GROUPS };

// Random effects of a healthy joint: Coulomb, viscous and offset scatter from run to run, and slow
// wander of friction and of offset with knots wander_s apart.
void set_random_effects(RunRows &rows, const Eigen::VectorXd &t_s, const Eigen::VectorXd &dir,
                        const Eigen::VectorXd &v_radps, double wander_s);

// Autoregressive noise, exact at the start of every unbroken stretch, plus the random effects.
struct NoiseModel {
    std::vector<Eigen::VectorXd> predictor; // [m]: m coefficients, lag 1 first
    std::vector<double> innovation_nm;      // [m]: standard deviation left after m lags
    double variance[RG_GROUPS] = {};        // of each group's coefficient
    double coloured_nm = 0;                 // standard deviation of the autoregressive part
    int order() const { return static_cast<int>(predictor.size()) - 1; }
    // |A|^2 / sigma^2 at omega rad per row: information per row of a line at that frequency.
    double information(double omega) const;
};

// Normal equations with a trace of ridge: rank-deficient designs are normal, and columns differ in size by
// orders of magnitude, so each by its own diagonal.
Eigen::MatrixXd ridged(Eigen::MatrixXd a);

// Rows divided by the noise's colour; and the transpose of that map.
Eigen::MatrixXd whiten(const NoiseModel &n, const std::vector<int> &lags, const Eigen::MatrixXd &x);
Eigen::VectorXd whiten_adjoint(const NoiseModel &n, const std::vector<int> &lags, const Eigen::VectorXd &w);

// Restricted maximum likelihood with the columns in rich (per run) taken as fixed effects beside
// RunRows::fixed, so that a repeatable effect is not mistaken for noise.
NoiseModel fit_noise(const std::vector<RunRows> &runs, const std::vector<Eigen::MatrixXd> &rich, int order);

// Products of [nuisances | candidate | y], one matrix a run: weighted by the inverse covariance of
// the noise, and plain.
struct Gram {
    Eigen::Index nuisances = 0, columns = 0;
    std::vector<Eigen::MatrixXd> weighted, plain;
    std::vector<Eigen::Index> rows;
    Eigen::MatrixXd prior;          // precision, columns x columns
};

class Evidence {
public:
    Evidence(std::vector<RunRows> runs, NoiseModel noise);
    std::size_t runs() const { return runs_.size(); }
    const NoiseModel &noise() const { return noise_; }
    const std::vector<RunRows> &rows() const { return runs_; }
    double rms_nm() const { return rms_nm_; }     // of y after the nuisances, plain
    // Weak prior: a contribution of ten times the residual is one sigma.
    Gram gram(const std::vector<Eigen::MatrixXd> &x) const;
    // Inverse covariance times (y - nuisances), per run: a candidate's score is x' times this.
    std::vector<Eigen::VectorXd> score() const;
    // x' V^-1 x and x' V^-1 residual of one run, V the noise's covariance.
    void products(std::size_t run, const Eigen::MatrixXd &x, const Eigen::VectorXd &residual,
                  Eigen::MatrixXd *a, Eigen::VectorXd *b) const;

private:
    std::vector<RunRows> runs_;
    NoiseModel noise_;
    struct Prepared { Eigen::MatrixXd base, random, half, half_base, weighted, plain; };
    std::vector<Prepared> prepared_;
    double rms_nm_ = 0;
};

using RunSet = std::vector<char>;               // per run: in or out
std::vector<RunSet> balanced_splits(std::size_t runs, std::size_t most);

// Candidate with the nuisances projected out, over a set of runs.
struct Projected { Eigen::MatrixXd a; Eigen::VectorXd b; Eigen::MatrixXd plain_a; double rows = 0; };
Projected project(const Gram &g, const RunSet &use);

struct GlsFit {
    Eigen::VectorXd nuisance, theta;
    Eigen::MatrixXd covariance;     // of [nuisance; theta]
    double llr = 0;                 // log likelihood ratio against no effect
};
GlsFit gls_fit(const Gram &g, const RunSet &use);
// Covariance that trusts only the scatter between runs, never less than the model's.
Eigen::MatrixXd run_covariance(const Gram &g, const GlsFit &fit);

// The same with each variance no less than the jackknife's: estimates with one run left out at a time.
Eigen::MatrixXd jackknife_covariance(const Gram &g, const Eigen::MatrixXd &covariance);
// Variances of left-out estimates (one per run, columns are runs) of a number.
Eigen::VectorXd jackknife_variance(const Eigen::MatrixXd &left_out);

// Log of the mean over splits of L(theta of one half; other half) / L(0; other half), nuisances
// projected out.  An e-value: its expectation is at most one when there is no effect.
// Several Grams: one theta shared by all of them (joints of one chain), noise independent.
double split_log_e(const std::vector<const Gram *> &g, const std::vector<RunSet> &splits);

struct RunGain {
    std::vector<double> log_likelihood; // per run, parameters from the other runs
    std::vector<double> plain;          // per run: fall of the sum of squares, (N.m)^2
    std::vector<double> contribution;   // per run: mean square of the effect beside the nuisances
    double total = 0, plain_total = 0, rows = 0;
    int informative = 0, better = 0;    // runs that show the effect; of those, runs it helps
};
// One entry per Gram; theta shared by all of them.
std::vector<RunGain> leave_one_run_out(const std::vector<const Gram *> &g);

double log_mean_exp(const std::vector<double> &x, double count);
// e-BH: adjusted value of each log e among all of them; smaller is stronger, at most 1.
std::vector<double> ebh_adjusted(const std::vector<double> &log_e);

} // namespace hdt
