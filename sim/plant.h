/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arm as physics: two masses a joint (rotor with wave generator, link), the gear as a nonlinear
 * spring between them, rigid-body dynamics of the chain, friction on the motor side.
 *
 *   links:   M(q) qdd + C(q,qd) qd + G(q) = gear - cable spring - end stop
 *   rotor j: J wd = N (1 + gain) tau_m - gear - conservative lines - friction(w, ...)
 *   gear(delta) + damping ddelta/dt,  delta = th_m / N - q,  w = thd_m / N
 *
 * A rotor's kinetic energy is that of its own spin; its mass is part of the link that carries it
 * (the usual flexible-joint simplification, good while N is large).
 *
 * Owns: const model, state, one step; the hidden effects are physics here.
 * Never: knows the control core, the diagnosis or its regressors; reads a clock; allocates.
 *
 * Sides: motor-side quantities end in _m (rotor angle, N times the joint angle when unloaded);
 * all others are output side.  The motor-side resolver sees th_m, never q.
 * Outputs belong to the state they are returned with.
 */
#ifndef PLANT_H
#define PLANT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PLANT_JOINTS_MAX 16
#define PLANT_LINES_MAX 8

/* Magnitude along motion, output side: f0 + fv |v| + fs (1 - exp(-|v| / vc)).  f0 is the breakaway
 * torque: below it a rotor at rest does not move at all.  fs may be negative, not below -f0. */
struct plant_friction { double f0_nm, fv_nmspr, fs_nm, vc_radps; };

/* amplitude * sin(order * th_m / N + phase): torque the motor must give more, when conservative;
 * added to the friction magnitude, when directed (which never falls below zero by it). */
struct plant_line { double order_rev, amplitude_nm, phase_rad; int directed; }; /* order per output turn */

struct plant_joint {
    /* link: frame fixed in link, rotation about its z; standard inertial parameters about its origin */
    double rot[9], trans_m[3];        /* previous link -> joint frame at q = 0, row-major          */
    double mass_kg, moment_kgm[3], inertia_kgm2[6]; /* xx xy xz yy yz zz                           */
    double q_min_rad, q_max_rad;      /* end stops, link side: spring and damper that only push    */
    double stop_nmprad, stop_nmspr;   /* of the stops; 0: chosen by plant_model_check              */
    /* gear */
    double ratio;
    double k_nmprad[3], t_nm[2];      /* K1 K2 K3 over T1 T2 [HDCAT], symmetric in torque           */
    double damping_nmspr;             /* of the spring                                            */
    /* rotor */
    double rotor_kgm2_m;              /* rotor and wave generator, motor side                      */
    double tau_max_m_nm;              /* saturation, motor side                                    */
    /* friction on the motor side, numbers referred to the output */
    struct plant_friction friction[2];/* [0] positive, [1] negative                               */
    struct plant_line line[PLANT_LINES_MAX]; int lines;

    /* healthy imperfections, drawn once a run from the seed */
    double run_coulomb_sigma_nm;      /* scatter of Coulomb friction from run to run              */
    double wander_sigma_nm, wander_s; /* slow friction wander (Ornstein-Uhlenbeck)                */
    double torque_noise_m_nm;         /* white noise on the *reported* motor torque               */

    /* hidden effects; zero: absent */
    double fx_torque_gain;            /* motor gives (1 + this) times the torque reported          */
    double fx_load_mu;                /* friction grows by this times |gear torque|                */
    double fx_cold_coulomb, fx_cold_viscous, fx_warm_s; /* excess when cold, relative to f0 and fv; thermal time */
    double fx_presliding_nm, fx_presliding_rad; /* friction missing right after a reversal (twice the
                                         elastic, Dahl, part) and the travel constant of its return */
    double fx_spring_nmprad, fx_spring_q0_rad; /* cable: motor must give k (q - q0) more             */
    double fx_inertia_kgm2;           /* extra rotor inertia, referred to the output               */
};

struct plant_model {
    int joints;
    double gravity_mps2[3];
    double payload_kg, payload_com_m[3]; /* hidden payload, in the last link's frame (flange offset included) */
    double step_s;                    /* inner step, 0: chosen by plant_model_check                */
    int check_joint;                  /* out of plant_model_check: 1-based joint that is wrong, or 0 */
    struct plant_joint joint[PLANT_JOINTS_MAX];
};

struct plant_state {
    double t_s;
    double q_rad[PLANT_JOINTS_MAX], qd_radps[PLANT_JOINTS_MAX];         /* link side */
    double th_m_rad[PLANT_JOINTS_MAX], thd_m_radps[PLANT_JOINTS_MAX];   /* rotor     */
    double dahl_nm[PLANT_JOINTS_MAX];       /* presliding friction state */
    double warm[PLANT_JOINTS_MAX];          /* 0 cold .. 1 warm */
    double run_coulomb_nm[PLANT_JOINTS_MAX], wander_nm[PLANT_JOINTS_MAX];
    uint32_t locked;                        /* bit per joint: brake on, rotor held */
    uint64_t rng;
    /* outputs of this state */
    double gear_nm[PLANT_JOINTS_MAX];       /* torque through the gear, output side */
    double friction_nm[PLANT_JOINTS_MAX];   /* motor-side friction or brake torque over the last inner
                                               step, referred to the output, against motion positive
                                               when motion is positive */
};

/* Check the model, precompute nothing hidden; fills step_s and the stop constants where 0 from the
 * stiffest mode found over the pose space.
 * Errors: -1 with *why (may be NULL) naming what is wrong and check_joint which joint. */
int plant_model_check(struct plant_model *m, const char **why);

/* At rest in the given link pose, gears wound up by gravity so that nothing moves if each motor
 * holds; cold; brakes off; draws the run's scatter from seed. */
void plant_reset(const struct plant_model *m, struct plant_state *s, const double *q_rad, uint64_t seed);

/* Advance by dt_s (any multiple or fraction of the inner step) with constant motor torques,
 * N.m motor side, as the servo's current loop makes them (before gain error).  Torques are cut to
 * tau_max_m_nm; one that is no number counts as zero.  dt_s <= 0 does nothing. */
void plant_step(const struct plant_model *m, struct plant_state *s, const double *tau_m_nm, double dt_s);

/* Mechanical energy, J: links kinetic and potential, rotors kinetic, gear springs, cable springs,
 * conservative lines, end stops. */
double plant_energy_j(const struct plant_model *m, const struct plant_state *s);

#ifdef __cplusplus
}
#endif
#endif
