/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The parts plant.c is put together from: chain, gear, friction, random numbers.
 *
 * Owns: the interfaces inside the plant; tests look in here, other rooms use plant.h.
 * Never: keeps state of its own.
 */
#ifndef PLANT_PARTS_H
#define PLANT_PARTS_H

#include "sim/plant.h"

#ifdef __cplusplus
extern "C" {
#endif

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

/* Factor of a symmetric positive definite matrix, of which the lower triangle is read; for
 * plant_solve only.  Errors: -1, not positive definite; the factor is then of no use. */
int plant_factor(int n, const plant_matrix a, plant_matrix factor);
/* x = a^-1 b; x and b may be the same array. */
void plant_solve(int n, const plant_matrix factor, const double *b, double *x);

/* The same by single steps in base coordinates; going. */

struct plant_pose {
    double rot[PLANT_JOINTS_MAX][9], pos_m[PLANT_JOINTS_MAX][3];   /* joint frames in the base */
    double mass_kg[PLANT_JOINTS_MAX];                              /* payload included         */
    double moment_kgm[PLANT_JOINTS_MAX][3];                        /* about the joint origin   */
    double inertia_kgm2[PLANT_JOINTS_MAX][6];                      /* about the joint origin   */
};

/* All trigonometry of the chain happens here, once. */
void plant_chain_pose(const struct plant_model *m, const double *q_rad, struct plant_pose *pose);
/* M(q), composite rigid bodies. */
void plant_chain_mass(const struct plant_model *m, const struct plant_pose *pose, plant_matrix mass);
/* C(q,qd) qd + G(q), recursive Newton-Euler.  With qd = 0: the holding torque. */
void plant_chain_bias(const struct plant_model *m, const struct plant_pose *pose, const double *qd_radps,
                      double *tau_nm);
double plant_chain_potential_j(const struct plant_model *m, const struct plant_pose *pose);
/* Inverse of a symmetric positive definite matrix.  Errors: -1, not positive definite. */
int plant_invert(int n, const plant_matrix a, plant_matrix inverse);

/* plant_gear.c: the piecewise linear spring, and the end stop. */

double plant_gear_nm(const struct plant_joint *j, double delta_rad);
double plant_gear_windup_rad(const struct plant_joint *j, double torque_nm);
double plant_gear_energy_j(const struct plant_joint *j, double delta_rad);
/* Torque on the link, pointing inwards; zero inside the range. */
double plant_stop_nm(const struct plant_joint *j, double q_rad, double qd_radps);
double plant_stop_energy_j(const struct plant_joint *j, double q_rad);

/* plant_friction.c: everything that rubs on the motor side, referred to the output. */

/* Friction of one joint as far as it does not change within a few inner steps. */
struct plant_rub {
    double coulomb_nm[2];             /* run scatter, wander, cold excess included; elastic part taken out */
    double viscous_nmspr[2];
    double elastic_nm;                /* Dahl part */
};

/* What one rotor feels in one inner step. */
struct plant_kick {
    double h_s, inertia_kgm2;         /* output side */
    double drive_nm;                  /* motor torque and gear, before lines and friction */
    double gear_nm;
};

void plant_rub_prepare(const struct plant_joint *j, const struct plant_state *s, int index, struct plant_rub *rub);
/* Speed after the kick; *dahl_nm is advanced, *friction_nm is what acted.  Friction is solved
 * implicitly, so a rotor the torques cannot break away stays at exactly zero. */
double plant_rub_kick(const struct plant_joint *j, const struct plant_rub *rub, const struct plant_kick *k,
                      double angle_rad, double speed_radps, double *dahl_nm, double *friction_nm);
/* Slow states over dt: warming, wander. */
void plant_rub_age(const struct plant_joint *j, struct plant_state *s, int index, double dt_s);
double plant_lines_energy_j(const struct plant_joint *j, double angle_rad);

/* Standard normal from a 64-bit state; the same on every machine up to libm's last digit. */
double plant_gauss(uint64_t *rng);

#ifdef __cplusplus
}
#endif
#endif
