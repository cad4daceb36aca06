/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arm as physics: two masses a joint (rotor with wave generator, link), the gear between them,
 * rigid-body dynamics of the chain, friction on the motor side and in the mesh.
 *
 *   rotor --[ wave generator: soft near zero ]-- mesh --[ flexspline: K1 K2 K3 ]-- link
 *     th                 wave(th - z)             z        gear(z + e(th) - q)       q
 *
 *   links:   M(q) qdd + C(q,qd) qd + G(q) = gear - cable spring - end stop - contact
 *   mesh j:  wave = gear + loss, loss against dz/dt; it sticks below it; massless
 *   rotor j: J wd = motor - wave - gear de/dth - conservative lines - friction(w, ...)
 *   w = thd_m / N; e, the kinematic error; a damper in parallel takes part of dth/dt - dq/dt
 *
 * The mesh loses more when the wave generator drives (wave torque along the motion) than when it is
 * driven; in between, while the soft wind-up is passed through, the teeth go over from one flank to
 * the other and the loss with them.  What follows from that, and is put in nowhere: the sharp drop
 * of motor torque before the load crosses zero, torsional hysteresis with memory, the travel that
 * friction takes to build up after a reversal.
 * A joint without soft_nm has no mesh node: wave generator rigid, no loss there.
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
#define PLANT_ERRORS_MAX 4
#define PLANT_CHANGES_MAX 32

/* PLANT_VERLET: position Verlet, friction implicit, rigid bodies evaluated every 16 steps: fast.
 * PLANT_RK4: classical Runge-Kutta, the reference; what changes slowly (warmth, wander, dwell, dry
 * spot, current ripple) is taken at the start of a step. */
enum plant_integrator { PLANT_VERLET, PLANT_RK4 };

/* Magnitude along motion, output side: f0 + fv |v| + fs (1 - exp(-|v| / vc)).  f0 is the breakaway
 * torque: below it a rotor at rest does not move at all.  fs may be negative, not below -f0. */
struct plant_friction { double f0_nm, fv_nmspr, fs_nm, vc_radps; };

/* amplitude * sin(order * th_m / N + phase): torque the motor must give more, when conservative;
 * added to the rotor's friction magnitude, when directed (which never falls below zero by it; in a
 * joint with a mesh it fades with the wave torque within soft_nm).  The amplitude grows by per_load
 * times |gear torque| and per_speed times |speed|; run_phase: phase drawn anew each run. */
struct plant_line {
    double order_rev, amplitude_nm, phase_rad; /* order per output turn */
    int directed, run_phase;
    double per_load, per_speed_nmspr;
};

/* Kinematic error of the wave generator: the mesh is amplitude * sin(order * th_m / N + phase)
 * ahead of th_m / N. */
struct plant_error { double order_rev, amplitude_rad, phase_rad; };

/* Loss in the mesh, output side, at wave-generator torque s along the motion:
 *   back                              s <= -soft,   growing by back_load per N.m beyond
 *   linear from back to drive         within +-soft
 *   drive                             s >= soft,    growing by drive_load per N.m beyond */
struct plant_mesh { double drive_nm, back_nm, drive_load, back_load; };

struct plant_joint {
    /* link: frame fixed in link, rotation about its z; standard inertial parameters about its origin */
    double rot[9], trans_m[3];        /* previous link -> joint frame at q = 0, row-major          */
    double mass_kg, moment_kgm[3], inertia_kgm2[6]; /* xx xy xz yy yz zz                           */
    double q_min_rad, q_max_rad;      /* end stops, link side: spring and damper that only push    */
    double stop_nmprad, stop_nmspr;   /* of the stops; 0: chosen by plant_model_check              */
    /* gear */
    double ratio;
    double k_nmprad[3], t_nm[2];      /* flexspline: K1 K2 K3 over T1 T2 [HDCAT], symmetric         */
    double soft_nmprad, hard_nmprad;  /* wave generator: stiffness within +-soft_nm, and beyond     */
    double soft_nm;                   /* 0: rigid wave generator, and mesh must be all zero          */
    struct plant_mesh mesh;
    struct plant_error error[PLANT_ERRORS_MAX]; int errors;
    double damping_nmspr;             /* of gear and wave generator together                       */
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

    /* hidden effects; zero: absent.  Motor: what it gives for the torque it reports */
    double fx_torque_gain;            /* (1 + this) times                                          */
    double fx_gain_warm;              /* and this share more once warm (fx_warm_s)                  */
    double fx_current_offset_m_nm;    /* less this: offset of the current sensor                    */
    double fx_dead_m_nm, fx_dead_width_m_nm; /* less this near zero current, against its sign, fading
                                         over the width */
    double fx_knee_m_nm, fx_knee_share; /* beyond the knee this share is missing (saturation)        */
    double fx_current_ripple, fx_current_order_rev; /* torque times (1 + this sin(order th)): phases
                                         unequal */
    /* friction of the rotor */
    double fx_load_mu;                /* grows by this times |gear torque|                          */
    double fx_drive_mu;               /* the same, only while the motor drives the load              */
    double fx_quadratic_nms2prad2;    /* times v |v|; may be negative                               */
    double fx_slow_nm, fx_slow_radps; /* excess at low speed, falling as exp(-|v| / slow)            */
    double fx_cold_coulomb, fx_cold_viscous, fx_warm_s; /* excess when cold, relative to f0 and fv;
                                         thermal time */
    double fx_presliding_nm, fx_presliding_rad; /* friction missing right after a reversal (twice the
                                         elastic, Dahl, part) and the travel constant of its return */
    double fx_dwell_nm, fx_dwell_rad; /* more per decade of seconds stood still, until moved this far */
    double fx_local_nm, fx_local_rad, fx_local_width_rad; /* dry spot: at this angle, this wide         */
    double fx_drag_nm;                /* Coulomb friction more: a brake not quite released           */
    double fx_inertia_kgm2;           /* extra rotor inertia, referred to the output               */
    /* link */
    double fx_spring_nmprad, fx_spring_q0_rad; /* cable: motor must give k (q - q0) more             */
    double fx_contact_nm;             /* something pushes the link back with this torque             */
    double fx_vibration_nm, fx_vibration_hz; /* base shaken from outside, as torque on the link     */
    /* what the servo's resolver and current sensor make of it (sim/servo.c) */
    double fx_resolver_rad;           /* zero offset, output side; scheduled: lost counts           */
    double fx_eccentric_rad, fx_eccentric_order_rev, fx_eccentric_phase_rad; /* reading ahead by this sine */
    double fx_report_delay_s;         /* age of the torque reported, up to 40 ms                     */
    double fx_stale_share;            /* share of ticks whose reading is the one before              */
};

/* A parameter that is another for a while: add to the double at byte `field` of struct plant_model
 * while from_s <= t < to_s.  Several may be active at once. */
struct plant_change { uint32_t field; double add, from_s, to_s; };

struct plant_model {
    int joints;
    double gravity_mps2[3];              /* in the base frame: any mounting */
    double payload_kg, payload_com_m[3]; /* hidden payload, in the last link's frame (flange offset
                                            included) */
    enum plant_integrator integrator;
    double step_s;                    /* inner step, 0: chosen by plant_model_check                */
    struct plant_change change[PLANT_CHANGES_MAX]; int changes;
    int check_joint;                  /* out of plant_model_check: 1-based joint that is wrong, or 0 */
    struct plant_joint joint[PLANT_JOINTS_MAX];
};

struct plant_state {
    double t_s;
    double q_rad[PLANT_JOINTS_MAX], qd_radps[PLANT_JOINTS_MAX];         /* link side */
    double th_m_rad[PLANT_JOINTS_MAX], thd_m_radps[PLANT_JOINTS_MAX];   /* rotor     */
    double mesh_rad[PLANT_JOINTS_MAX];      /* z: the gear's memory, output side */
    double dahl_nm[PLANT_JOINTS_MAX];       /* presliding friction state */
    double still_s[PLANT_JOINTS_MAX], since_rad[PLANT_JOINTS_MAX]; /* last stand, travel since its end */
    double phase_rad[PLANT_JOINTS_MAX];     /* of this run, for what has no phase of its own */
    double warm[PLANT_JOINTS_MAX];          /* 0 cold .. 1 warm */
    double run_coulomb_nm[PLANT_JOINTS_MAX], wander_nm[PLANT_JOINTS_MAX];
    uint32_t locked;                        /* bit per joint: brake on, rotor held */
    uint64_t rng;
    /* outputs of this state */
    double gear_nm[PLANT_JOINTS_MAX];       /* torque on the link through the gear, output side */
    double wave_nm[PLANT_JOINTS_MAX];       /* torque of rotor on mesh, output side; gear_nm if there is
                                               no mesh */
    double friction_nm[PLANT_JOINTS_MAX];   /* motor-side friction or brake torque over the last inner
                                               step, referred to the output, against motion positive
                                               when motion is positive */
};

/* Check the model, with none and with all of its changes; fills step_s and the stop constants where
 * 0 from the stiffest mode found over the pose space.  A step_s given that is too long for the
 * integrator is refused.
 * Errors: -1 with *why (may be NULL) naming what is wrong and check_joint which joint. */
int plant_model_check(struct plant_model *m, const char **why);

/* The model as it is at t_s: m itself when nothing in it changes, else scratch filled. */
const struct plant_model *plant_now(const struct plant_model *m, double t_s, struct plant_model *scratch);

/* At rest in the given link pose, gears wound up by gravity so that nothing moves if each motor
 * holds; cold; brakes off; draws the run's scatter from seed. */
void plant_reset(const struct plant_model *m, struct plant_state *s, const double *q_rad, uint64_t seed);

/* Advance by dt_s (any multiple or fraction of the inner step) with constant motor torques,
 * N.m motor side, as the servo's current loop makes them (before gain error).  Torques are cut to
 * tau_max_m_nm; one that is no number counts as zero.  dt_s <= 0 does nothing.  Changes of the model
 * take effect between calls. */
void plant_step(const struct plant_model *m, struct plant_state *s, const double *tau_m_nm, double dt_s);

/* Mechanical energy, J: links kinetic and potential, rotors kinetic, gear and wave-generator springs,
 * cable springs, conservative lines, end stops. */
double plant_energy_j(const struct plant_model *m, const struct plant_state *s);

#ifdef __cplusplus
}
#endif
#endif
