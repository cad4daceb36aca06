// SPDX-License-Identifier: Apache-2.0
//
// All candidates for one joint, weighed against the same noise model and the same nuisances.
//
// Owns: the evidence for every candidate of a joint or a chain, gates, choice, refinement.
// Never: reads held-out runs to choose; writes a model.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "model/effects.hpp"
#include "model/evidence.hpp"

namespace hdt {

struct Gates {
    double alpha = 0.05;         // false discoveries among everything named
    double floor_share = 0.1;    // nor is one far below what runs scatter anyway
    double loose_share = 1.6;    // what the model file has no term for must show this much more
    double healthy_share = 3.2;   // and this much what healthy joints show some of
    double remnant_share = 0.1;  // of the effects already found: less is their remnant
    int min_runs = 3;            // informative runs the effect must help in
};

// One family against one joint's residual.
struct Score {
    std::size_t family = 0;
    Point at;
    double log_e = -1e9, p_adjusted = 1, llr = 0, rms_nm = 0;
    RunGain gain;
    bool excited = false, plausible = true, passes = false;
    std::string note;
};

// An effect taken into the model: its columns are free beside the nuisances, or, for a chain effect,
// subtracted with the chain's numbers.
struct Found {
    Family family;
    Point at;
    double x_sigma = 0;
    std::optional<Eigen::VectorXd> chain_theta;
    Eigen::MatrixXd chain_covariance;
    std::vector<std::string> ambiguous;
    double p_adjusted = 1;
    Eigen::MatrixXd columns(const BlockRows &b) const { return family.columns(b, at); }
};

class JointWork {
public:
    JointWork(const hdt_arm &arm, int joint, std::vector<BlockRows> fit, std::vector<BlockRows> test);

    int joint;                              // 0-based
    std::vector<BlockRows> fit, test;
    std::vector<Family> families;           // what has to be searched for last
    std::vector<Found> found;
    std::optional<Score> offset;            // a constant torque, taken from unequal Coulomb friction
    std::vector<Score> scores;              // one per family, same order
    OrderScan scan;
    TimeScan times;
    double f0_sigma_nm[2] = {0, 0};         // what the model file says of its Coulomb friction
    double floor_nm = 0, gate_nm = 0;       // gate: what is worth a name on this joint
    double remnant_nm = 0;                  // beside effects already found a new one must exceed this too
    bool stale = true;                      // found has changed since the last assess

    const Evidence &evidence() const { return *evidence_; }
    // y with chain effects taken off; friction, imperfections and found effects, in this order.
    Eigen::VectorXd target(const BlockRows &b) const;
    Eigen::MatrixXd fixed(const BlockRows &b) const;
    // The scan goes to 600 a turn, or to twenty a motor turn.
    double highest_order() const;
    Eigen::Index imperfection_columns() const { return 2 + 8 * arm_joint_.ripples; }
    Gram gram(const Family &f, Point at) const;
    // Fit runs less nuisances and all that was found; axis too unless it is empty.
    std::vector<Eigen::VectorXd> residual(const Found &axis) const;
    // Log likelihood of residuals on held-out runs under this noise: run effects are integrated out.
    double held_out_log_likelihood(const std::vector<Eigen::VectorXd> &residual_nm) const;
    // Fit the noise, scan orders, weigh every family.
    void assess(const Gates &gates);
    // A constant torque, after all else: sliding rows show it only as Coulomb friction that has grown
    // in one direction by what it lost in the other.
    std::optional<Score> weigh_offset(const Gates &gates) const;
    // Is there declared ripple of nearly this order?  Read at a wrong angle it shows such a line.
    bool beside_ripple(double order) const;
    // Best x near found.back().at by maximum likelihood; its sigma from the curvature.
    void refine(Found *f) const;

private:
    hdt_arm_joint arm_joint_;
    double min_rms_nm_;
    std::unique_ptr<Evidence> evidence_;
    std::size_t listed_ = 0;                // families that need no search come first
    std::vector<RunRows> run_rows() const;
    void search(const std::vector<LineHit> &lines);
    void weigh(std::size_t family, const std::vector<RunSet> &splits);
    void put_whole_inertia(const Gram &on_reference, Score *s) const;
    void weigh_vibration(std::size_t family, const std::vector<RunSet> &splits);
    std::vector<Eigen::MatrixXd> rich_columns() const;
    std::vector<LineHit> plain_lines(const std::vector<Eigen::VectorXd> &residual,
                                     const OrderGrid &grid) const;
    BlockNumbers block_numbers() const;
    double found_rms_nm() const;
};

// By how much a family has to exceed the gate.
double gate_factor(const Family &f, const Gates &gates);

// Root mean square of a torque over rows, beside what friction could take over.
double reducible_rms(const std::vector<BlockRows> &rows,
                     const std::function<Eigen::VectorXd(const BlockRows &)> &torque_nm);

// Root mean square of each run's residual with parameters from the other runs.  Nuisance columns
// before `first` are held at zero; of those fitted, `count` from `ignored` on predict nothing.
double left_out_rms(const Gram &g, Eigen::Index first = 0, Eigen::Index ignored = 0, Eigen::Index count = 0);

// What to take in next for one joint; empty when nothing passes.
struct Choice {
    std::vector<std::size_t> families;      // one, or two found only together
    std::vector<std::string> ambiguous;
    bool unnamed = false;                   // an axis explains more than any name
};
Choice choose(const JointWork &w);

// A chain effect over all joints.
struct ChainScore {
    std::string id;
    Point at;
    double log_e = -1e9, p_adjusted = 1;
    Eigen::VectorXd theta;
    Eigen::MatrixXd covariance;
    std::vector<RunGain> gain;              // per joint
    double total = 0;                       // of the joints that show it
    std::vector<double> rms_nm;             // per joint
    bool passes = false;
    std::vector<std::vector<std::string>> ambiguous; // per joint
};
ChainScore weigh_chain(const std::vector<std::unique_ptr<JointWork>> &joints, const std::string &id,
                       const Gates &gates);

} // namespace hdt
