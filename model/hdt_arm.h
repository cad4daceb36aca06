/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One arm in SI units, as the model file says it, in a plain C struct; and the C calls that read a
 * model file and turn it into tables.
 *
 * Owns: the numbers everything else is made from: tables, plant, regressors, tasks.
 * Never: holds sigma or source (ArmFile in model/arm_file.hpp keeps those beside the TOML text).
 *
 * All torques output side unless _m.  Friction numbers are magnitudes along the direction of motion:
 *   T(v) = +(f0 + fv v + fs (1 - exp(-v/vc)))          v > 0, friction[0]
 *   T(v) = -(f0 + fv |v| + fs (1 - exp(-|v|/vc)))      v < 0, friction[1]
 */
#ifndef HDT_ARM_H
#define HDT_ARM_H

#include <stddef.h>
#include <stdint.h>

#include "ctrl/hdt_tables.h"

#ifdef __cplusplus
extern "C" {
#endif

#define HDT_ARM_JOINTS_MAX 16
#define HDT_ARM_LINES_MAX 8
#define HDT_ARM_ERRORS_MAX 4
#define HDT_ARM_BUMPS_MAX 4
#define HDT_ARM_CURVE_POINTS 65

struct hdt_arm_friction { double f0_nm, fv_nmspr, fs_nm, vc_radps; };

/* amplitude * sin(order * q + phase), q the output angle; directed: times sign of velocity.
 * An order that is a whole multiple of the ratio is locked to the wave generator. */
struct hdt_arm_line { double order_rev, amplitude_nm, phase_rad; int directed; };

/* Kinematic error: the flexspline is amplitude * sin(order * q + phase) ahead of the motor angle over
 * the ratio. */
struct hdt_arm_error { double order_rev, amplitude_rad, phase_rad; };

/* Inside of the gear, for the simulator only: torsional stiffness of the wave generator within
 * +-soft_nm and beyond; loss in the mesh while the wave generator drives and while it is driven,
 * each growing with the load beyond soft_nm. */
struct hdt_arm_mesh {
    double soft_nm, soft_nmprad, hard_nmprad;
    double drive_nm, back_nm, drive_load, back_load;
};

/* Soft wind-up torque as three lines of load x (gravity torque, output side), one direction. */
struct hdt_arm_stiffness { double slope[3], t1_nm, t2_nm, zero_nm; };

/* Torque over an axis: point k of 65 at from + k (to - from)/64, linear between, held outside. */
struct hdt_arm_curve { double from, to, nm[HDT_ARM_CURVE_POINTS]; };

/* Friction of a place: torque * exp(-((q - at) / width)^2 / 2), times direction. */
struct hdt_arm_bump { double torque_nm, at_rad, width_rad; };

struct hdt_arm_joint {
    char name[16];
    /* geometry: previous link -> joint frame at q = 0; joint turns about its z */
    double origin_m[3], rot[9];
    double q_min_rad, q_max_rad, v_max_radps;
    /* standard inertial parameters about the joint origin; zero mass with a first moment is the
     * form base parameters take */
    int has_inertial;                 /* 0: masses unknown */
    double mass_kg, moment_kgm[3], inertia_kgm2[6];
    /* gear and motor */
    double ratio;
    int has_gear;                     /* catalogue stiffness known */
    double k_nmprad[3], t_nm[2];
    int has_mesh;
    struct hdt_arm_mesh mesh;
    int errors;
    struct hdt_arm_error error[HDT_ARM_ERRORS_MAX];
    double rotor_kgm2_m, wave_generator_kgm2_m;
    double tau_rated_m_nm, tau_max_m_nm;
    /* friction */
    int has_friction;
    struct hdt_arm_friction friction[2];
    double friction_v_min_radps, friction_v_max_radps; /* validity */
    int ripples;                      /* directed lines of whole wave-generator order, Table III  */
    struct hdt_arm_line ripple[HDT_ARM_LINES_MAX];
    int has_stiffness;
    struct hdt_arm_stiffness stiffness[2];
    double windup_rad;                /* travel from no wind-up to one direction's; 0: with the direction */
    int has_local;                    /* friction by position, q in rad, magnitude along the motion */
    struct hdt_arm_curve local[2];
    int has_table;                    /* one more curve, joint-signed */
    int table_axis;                   /* enum hdt_axis; phase in turns of the wave generator, 0..1 */
    int table_directed;               /* times direction of motion */
    struct hdt_arm_curve table;
    /* feedback, motor side as Table VI prints it */
    double kp_m_nmprad, kd_m_nmspr;
    /* effects adopted; neutral values mean absent */
    double torque_gain;               /* 1: measured torque is the true one; tau_true = gain * reported */
    double torque_offset_nm;
    double load_mu;
    double cold_coulomb_nm, cold_viscous_nmspr, warm_s;
    double presliding_nm, presliding_rad;
    double spring_nmprad, spring_q0_rad;
    double extra_inertia_kgm2;        /* output side */
    int lines;
    struct hdt_arm_line line[HDT_LINES_MAX];
    int bumps;
    struct hdt_arm_bump bump[HDT_ARM_BUMPS_MAX];
};

struct hdt_arm {
    char name[64];
    char path[256];
    uint8_t digest[32];               /* SHA-256 of the file's bytes */
    int joints;
    double gravity_mps2[3];
    double flange_m[3], flange_rot[9];/* in the last joint's frame */
    double payload_kg, payload_com_m[3]; /* in the flange frame */
    double control_rate_hz, velocity_cutoff_hz;
    int observe_feedback, observe_friction; /* velocity by the observer: of the D term, of friction */
    struct hdt_arm_joint joint[HDT_ARM_JOINTS_MAX];
};

/* Read a model file.  Errors: -1 and one line in err: file:line: key: expected ..., found ... */
int hdt_arm_load(const char *path, struct hdt_arm *arm, char *err, size_t errlen);

/* Worst error of any joint that rounding to the tables makes, N.m output side: friction, ripple, lines,
 * local and table swept, knots against the curve; the others at states spread over the limits. */
struct hdt_gen_report { double term_nm[HDT_TERMS]; };

/* Fixed point from numbers.  report may be NULL.
 * Errors: -1 and one line naming the key that cannot be represented. */
int hdt_arm_tables(const struct hdt_arm *arm, struct hdt_tables *t, struct hdt_gen_report *report,
                   char *err, size_t errlen);

#ifdef __cplusplus
}
#endif
#endif
