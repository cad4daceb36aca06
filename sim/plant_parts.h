/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The parts plant.c is put together from: chain, gear, lines, motor, friction, random numbers.
 *
 * Owns: the interfaces inside the plant; tests look in here, other rooms use plant.h.
 * Never: keeps state of its own.
 */
#ifndef PLANT_PARTS_H
#define PLANT_PARTS_H

#include <math.h>

#include "sim/plant.h"

#ifdef __cplusplus
extern "C" {
#endif

/* plant_check.c: rotor and what turns with it, output side. */
double plant_rotor_kgm2(const struct plant_joint *j);

/* plant_chain.c: rigid links. */

/* Row-major, row stride PLANT_JOINTS_MAX, joints x joints used. */
typedef double plant_matrix[PLANT_JOINTS_MAX * PLANT_JOINTS_MAX];

/* One link in a frame of the chain's own choice: z is the joint axis, x and the place along z such
 * that the turn from the link before is Rz(q + offset) and then Rx(twist), and the origin has no z
 * in the frame before.  Inertia that turns with the link before in any case (on the axis) is booked
 * there, so that mass, moment along z and second moment along z are zero. */
struct plant_body {
    double twist_cos, twist_sin, offset_rad;
    double x_m, y_m;                       /* origin in the frame before */
    double moment_kgm[2];                  /* x y                                                   */
    double second_kgm2[5];                 /* xx xy xz yy yz of the integral of r r' over the mass  */
};

/* Constants of a chain, payload included.  Plain: a copy is as good. */
struct plant_chain {
    int joints;
    double gravity_mps2[3];                /* in the base as the first body's frame sees it  */
    double base_j;                         /* potential energy of what ended up in the base  */
    struct plant_body body[PLANT_JOINTS_MAX];
};

/* From a model that plant_model_check would accept; whenever links, payload or gravity change. */
void plant_chain_prepare(const struct plant_model *m, struct plant_chain *c);
/* M(q), both triangles, and C(q,qd) qd + G(q); with qd = 0 the bias is the holding torque. */
void plant_chain_terms(const struct plant_chain *c, const double *q_rad, const double *qd_radps,
                       plant_matrix mass_kgm2, double *bias_nm);
/* Potential energy; zero where every mass is at the height of the base's origin. */
double plant_chain_height_j(const struct plant_chain *c, const double *q_rad);

/* Factor of a symmetric positive definite matrix, of which the upper triangle is read; for
 * plant_solve only.  Errors: -1, not positive definite; the factor is then of no use. */
int plant_factor(int n, const plant_matrix a, plant_matrix factor);
/* x = a^-1 b; x and b may be the same array. */
void plant_solve(int n, const plant_matrix factor, const double *b, double *x);

/* Inverse of a symmetric positive definite matrix.  Errors: -1, not positive definite. */
int plant_invert(int n, const plant_matrix a, plant_matrix inverse);

/* plant_gear.c: flexspline, wave generator, mesh, end stop. */

/* Where the lines of torque over wind-up and of loss over torque join: divided out once, for speed. */
struct plant_gear { double corner_rad[2], soft_rad, loss_slope; };

void plant_gear_prepare(const struct plant_joint *j, struct plant_gear *g);
/* g: of the same joint. */
static inline double plant_gear_at_nm(const struct plant_joint *j, const struct plant_gear *g,
                                      double delta_rad)
{
    const double *k = j->k_nmprad, *corner = g->corner_rad;
    double d = fabs(delta_rad);
    double torque = d <= corner[0]   ? k[0] * d
                    : d <= corner[1] ? j->t_nm[0] + k[1] * (d - corner[0])
                                     : j->t_nm[1] + k[2] * (d - corner[1]);
    return delta_rad < 0 ? -torque : torque;
}
double plant_gear_nm(const struct plant_joint *j, double delta_rad);
double plant_gear_windup_rad(const struct plant_joint *j, double torque_nm);
double plant_gear_energy_j(const struct plant_joint *j, double delta_rad);
/* The same of the wave generator; only for joints with a mesh (soft_nm above zero). */
double plant_wave_at_nm(const struct plant_joint *j, const struct plant_gear *g, double windup_rad);
double plant_wave_nm(const struct plant_joint *j, double windup_rad);
double plant_wave_windup_rad(const struct plant_joint *j, double torque_nm);
double plant_wave_energy_j(const struct plant_joint *j, double windup_rad);
/* Loss at a wave torque along the motion. */
double plant_mesh_loss_nm(const struct plant_joint *j, double along_nm);
/* Where the mesh is now that the rotor is at angle_rad and the link at output_rad (kinematic error
 * taken off), having been at mesh_rad; more_nm: loss beyond the law's, may be negative. */
double plant_mesh_slip(const struct plant_joint *j, const struct plant_gear *g, double more_nm,
                       double angle_rad, double output_rad, double mesh_rad);
/* Torque on the link, pointing inwards; zero inside the range. */
double plant_stop_nm(const struct plant_joint *j, double q_rad, double qd_radps);
double plant_stop_energy_j(const struct plant_joint *j, double q_rad);

/* plant_lines.c: what repeats with the wave generator. */

/* Sine and cosine of one line, carried along a small turn by polynomials. */
struct plant_phase { double at_rad, sine, cosine; };

struct plant_phases {
    double from_rad;                  /* rotor angle the phases belong to, output side */
    struct plant_phase line[PLANT_LINES_MAX], error[PLANT_ERRORS_MAX];
};

/* What the lines and errors of a joint come to at one angle. */
struct plant_periodic {
    double directed_nm, torque_nm;    /* friction more; torque the motor must give more */
    double directed_per, torque_per;  /* the same, per N.m of gear torque (magnitude)   */
    double error_rad, error_slope;    /* e and de/dth, output side                       */
};

/* Anew at the state's angle. */
void plant_phases_set(const struct plant_joint *j, const struct plant_state *s, int index,
                      struct plant_phases *p);
/* Carried on to angle_rad, within 1e-9 however far; speed_radps scales the amplitudes. */
struct plant_periodic plant_periodic_at(const struct plant_joint *j, struct plant_phases *p,
                                        double angle_rad, double speed_radps);
/* Of the lines that are conservative, at the state's angle and with its run's phases. */
double plant_lines_energy_j(const struct plant_joint *j, const struct plant_state *s, int index);

/* plant_motor.c: what the motor gives, output side, for a motor-side torque asked for. */
double plant_motor_nm(const struct plant_joint *j, double tau_m_nm, double angle_rad, double warm);

/* plant_friction.c: what rubs on the rotor, referred to the output. */

/* Friction of one joint as far as it does not change within a few inner steps. */
struct plant_rub {
    double coulomb_nm[2];             /* all that does not depend on speed or load, less the elastic part */
    double viscous_nmspr[2];
    double elastic_nm;                /* Dahl part */
    double per_vc_spr[2];             /* by plant_rub_begin, */
    int more;                         /* as is: does anything beyond Coulomb and Stribeck rub?  */
};

/* What one rotor feels in one inner step; torques before friction. */
struct plant_kick {
    double h_s, inertia_kgm2;         /* output side */
    double drive_nm, gear_nm;         /* sum of torques on the rotor; the gear's alone */
    double directed_nm;               /* periodic friction */
    double sense, dry_nm;             /* plant_rub_dry_nm for this sense, as the caller had it */
};

/* exp(-x) for x >= 0, within 1e-13 of it; zero beyond 700. */
double plant_decay(double x);
/* Once per call of plant_step; then prepare as often as the state has moved on. */
void plant_rub_begin(const struct plant_joint *j, struct plant_rub *rub);
void plant_rub_prepare(const struct plant_joint *j, const struct plant_state *s, int index,
                       struct plant_rub *rub);
/* Magnitude along sense (-1, 1) at this speed along it, without viscous and elastic part.  Below
 * zero where lines or elastic part take away more than there is: to be cut by the caller. */
double plant_rub_dry_nm(const struct plant_joint *j, const struct plant_rub *rub, double sense,
                        double along_radps, double gear_nm, double directed_nm);
/* Speed after the kick; *dahl_nm is advanced, *friction_nm is what acted.  Friction is solved
 * implicitly, so a rotor the torques cannot break away stays at exactly zero. */
double plant_rub_kick(const struct plant_joint *j, const struct plant_rub *rub, const struct plant_kick *k,
                      double speed_radps, double *dahl_nm, double *friction_nm);
/* Slow states over dt: warming, wander, stand and travel. */
void plant_rub_age(const struct plant_joint *j, struct plant_state *s, int index, double dt_s);

/* Standard normal, and uniform over (0, 1], from a 64-bit state; the same on every machine up to
 * libm's last digit. */
double plant_gauss(uint64_t *rng);
double plant_uniform(uint64_t *rng);

#ifdef __cplusplus
}
#endif
#endif
