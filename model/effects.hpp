// SPDX-License-Identifier: Apache-2.0
//
// What a joint model may lack: named effects and free axes, as columns of a linear regression over
// block means.
//
// Owns: block signals of a joint, the list of candidates and their columns.
// Never: estimates or decides; shares nothing with the simulator's hidden effects.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "model/dataset.hpp"
#include "model/scan.hpp"

namespace hdt {

// Block means of one joint in one run, or in a piece of a run.
struct BlockRows {
    std::string run;
    double block_s = 0.01;
    double payload_kg = 0;             // of this run: what its log declares, else the arm's
    Eigen::Vector3d payload_com_m = Eigen::Vector3d::Zero();
    bool payload_declared = false;     // in the log: whatever payload the arm has does not count
    std::vector<Eigen::Index> block;   // block number of each row
    Eigen::VectorXd t_s, y_nm;         // y: gain * reported torque - declared terms
    Eigen::VectorXd q, v, a, dir, travel, gravity, total; // of this joint; total: all declared terms
    Eigen::VectorXd built_up;          // share of full friction reversal: a half before the first turn
    Eigen::VectorXd vibration;         // acceleration beside the one in a; zero where they are the same
    Eigen::MatrixXd q_all, a_all;      // of every joint
    Eigen::MatrixXd body;              // d tau / d (m, mx, my, mz) of a body fixed to the flange
    Eigen::MatrixXd own;               // d tau / d (mx, my) of this joint's link
    Eigen::MatrixXd link;              // d tau / d share by which each link is heavier than declared
    Eigen::MatrixXd tilt;              // d tau / d base tilt about x and y
    Eigen::VectorXd dgdq;              // d gravity / d own angle
    Eigen::MatrixXd mass;              // d tau / d acceleration of each joint, declared chain
    Eigen::MatrixXd late;              // declared torque 10, 20, 30, 40 ms ago, less that of now
    std::vector<int> unknown_angles;   // of the run, as Conditioned has them
    Eigen::Index index = -1;           // number of the run among those to fit; -1: held out

    Eigen::Index size() const { return y_nm.size(); }
    ScanRows scan() const { return {q, v, dir, block_s}; }
    BlockRows slice(Eigen::Index begin, Eigen::Index end) const;
    BlockRows pick(const std::vector<Eigen::Index> &rows) const;
};

// Every joint of a run (0-based), rows without a valid block left out.  To fit, acceleration is the
// reference's where the log has it: the measured one holds vibration that smoothing takes down in
// part, which looks like missing inertia; the reference moves with the joint and with none of that.
std::vector<BlockRows> block_rows(const hdt_arm &arm, const Conditioned &c, const Run &run, bool to_fit);

// Nuisances every candidate is tested beside: Coulomb and viscous friction, free by direction.
// Columns: f0 positive, f0 negative, fv positive, fv negative.
constexpr Eigen::Index kFriction = 4;
Eigen::MatrixXd nuisance_columns(const BlockRows &b);
// Healthy imperfections no name should be given to: vibration (the first column), torque a few
// milliseconds away from position, and declared ripple as the rotor answers it at speed and wind-up
// shifts it.  One prior standard deviation per column.
struct Imperfections { Eigen::MatrixXd columns; Eigen::VectorXd sigma; };
Imperfections imperfections(const hdt_arm_joint &joint, const BlockRows &b);

// Where on a family's scale: a time constant, a travel, an order, ... and which variant.
struct Point { double x = 0; int kind = 0; };

struct Family {
    std::string id;                    // effect id, or "unnamed"
    std::string axis;                  // "unnamed" only
    std::vector<std::string> depends_on;
    std::vector<Point> grid;
    double grid_count = 1;             // what the grid stands for (a scan tries more than it keeps)
    std::function<Eigen::MatrixXd(const BlockRows &, Point)> columns;
    std::function<bool(const Eigen::VectorXd &)> plausible; // sign of the estimate; empty: any
    bool refine = false;               // x is continuous: refined by maximum likelihood
    double step = 0;                   // refined within +- this; 0: within a factor of two
    bool twin = false;                 // the imperfections hold the same columns, within bounds
    bool own_phase = false;            // coefficients are each run's own: nothing a model could hold
    bool chain = false;                // one set of numbers for all joints
    Eigen::MatrixXd roughness;         // axes: second differences of neighbours, columns x columns
    std::vector<double> knots;         // axes
    bool named() const { return id != "unnamed"; }
    // the model file has a term of its own for it, so that numbers can be held to it
    bool adoptable() const;
};

// In order of preference where the data cannot tell two apart.  joint is 0-based.
std::vector<Family> effect_families(const hdt_arm &arm, int joint, const std::vector<BlockRows> &runs);
// Orders of the scan's strongest lines as a family, orders step apart.
Family line_family(int joint, const std::vector<LineHit> &hits, double tried, double step);
// Places where friction is locally higher, the strongest by the score (inverse covariance of the
// noise times residual, per run).
Family local_family(int joint, const std::vector<BlockRows> &runs, const std::vector<Eigen::VectorXd> &score);
// The declared torque of another angle than the one read, less that of the angle read: these columns times
// turned_by(the angle between the two).  Springs and gravity to first order, ripple exactly: a degree turns a
// wave generator's ripple round.
Eigen::MatrixXd turned_columns(const hdt_arm_joint &joint, const BlockRows &b);
Eigen::VectorXd turned_by(const hdt_arm_joint &joint, double angle_rad);
// Angles the resolver may read short by, the likeliest by information and score of turned_columns.
Family offset_family(const hdt_arm_joint &joint, int number, const Eigen::MatrixXd &information,
                     const Eigen::VectorXd &score);
// Loads at which a gear's loss steps up as it begins to drive, mirrored for the other direction.
Family windup_family(const std::vector<BlockRows> &runs, const std::vector<Eigen::VectorXd> &score);
// Frequencies fixed in time, phase free in each run; hits holds Hz.
Family vibration_family(const std::vector<double> &hz, double tried, std::size_t runs, double step_hz);
// Widths of the bumps and steps of the two searches, by Point::kind.
double bump_width_rad(int kind);
double step_width_nm(int kind);
// What averaging over a block leaves of a line of this frequency.
double block_gain(double hz, double block_s);

} // namespace hdt
