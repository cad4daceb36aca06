/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The generated tables: one arm's model in fixed point, as `hdt gen` writes it and the core reads
 * it.  Const during a run.  All torques are output side (joint) unless the name says motor.
 *
 * Owns: the layout, its number, reading the .hdtm image, the acceptance check.
 * Never: allocates, converts from floating point (that is model/tablegen).
 */
#ifndef HDT_TABLES_H
#define HDT_TABLES_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HDT_TABLES_MAGIC 0x4d544448u /* "HDTM" little endian */
#define HDT_TABLES_LAYOUT 2u         /* bump on any change of the structs below */
#define HDT_JOINTS_MAX 16
#define HDT_RIPPLE_KNOTS 1024  /* over one wave-generator turn, 16 counts apart, linear between */
#define HDT_FRICTION_KNOTS 129 /* over |v| = 0 .. 128 << friction_shift, linear between        */
#define HDT_LINES_MAX 4
#define HDT_CURVE_KNOTS 257   /* of a free curve, linear between, its ends held outside */
#define HDT_SPRING_MAX_Q16 (1 << 27) /* N.m  a spring pulls no harder than 2048 */
#define HDT_GRAVITY_MAX_Q16 ((1 << 30) - 1) /* N.m  nor gravity than 16384      */

/* Terms a joint may use; a bit not set costs one branch. */
enum hdt_term {
    HDT_TERM_GRAVITY,     /* holding torque dU/dq, payload included                            */
    HDT_TERM_INERTIA,     /* rigid-body M(q) qdd_ref + C(q,qd_ref) qd_ref + reflected rotor     */
    HDT_TERM_FRICTION,    /* two-sided Stribeck on desired velocity, paper eq. (7)              */
    HDT_TERM_RIPPLE,      /* periodic friction, wave-generator phase, times direction           */
    HDT_TERM_STIFFNESS,   /* soft wind-up, three lines of load per direction, paper Table V     */
    HDT_TERM_LINES,       /* torque lines of any order per output turn (conservative or directed) */
    HDT_TERM_LOAD,        /* load-dependent friction: mu |gravity| * direction                  */
    HDT_TERM_TEMPERATURE, /* cold excess of friction, decaying with time since init             */
    HDT_TERM_PRESLIDING,  /* friction deficit after a reversal, decaying with travel            */
    HDT_TERM_SPRING,      /* cable or hose: k (q - q0)                                          */
    HDT_TERM_OFFSET,      /* constant torque                                                   */
    HDT_TERM_LOCAL,       /* friction by position, a curve per direction, as fed forward in the paper */
    HDT_TERM_TABLE,       /* one curve on an axis of choice                                    */
    HDT_TERM_P,           /* feedback kp (q_ref - q)                                            */
    HDT_TERM_D,           /* feedback kd (v_ref - v_filtered)                                   */
    HDT_TERMS
};

/* Uses of the velocity observer (hdt_vel.h); none: it does not run. */
enum hdt_observed {
    HDT_OBSERVED_FEEDBACK,       /* the D term, in place of the filtered velocity               */
    HDT_OBSERVED_FRICTION,       /* direction and speed of friction, in place of the reference's */
    HDT_OBSERVED
};

/* What a link is spared because its numbers are as simple as they look. */
enum hdt_chain {
    HDT_CHAIN_RIGHT = 1u << 0, /* the twist is a quarter turn: cosine 0, sine 1                */
    HDT_CHAIN_STEP = 1u << 1,  /* the origin is not that of the previous link                  */
    HDT_CHAIN_FAR = 1u << 2,   /* nor that of the first: it accelerates (links 2.. after a step) */
    HDT_CHAIN_SKEW = 1u << 3   /* some second moment xy, xz, yz is not zero                    */
};

/* One direction of motion, [0] positive, [1] negative; the value is joint-signed (it is added as
 * it stands, scaled by |direction|).  Line 1 holds below t1, line 2 up to t2, line 3 above. */
struct hdt_stiffness_tab {
    int32_t t1_q16, t2_q16;      /* N.m  load where line 1 meets 2, and 2 meets 3; t1 <= t2 */
    int32_t intercept_q16[3];    /* N.m  value of each line at zero load                   */
    int32_t slope_q24[3];        /* N.m/N.m                                                */
};

/* A bounded curve: knot k at x = start + (k << shift); x in the units of its axis. */
struct hdt_curve_tab {
    int32_t start;
    uint32_t shift;              /* 1..23 */
    int16_t value_q8[HDT_CURVE_KNOTS]; /* N.m */
};

/* What the free curve is read at. */
enum hdt_axis {
    HDT_AXIS_Q,                  /* rad q24  measured output angle                            */
    HDT_AXIS_LOAD,               /* N.m q16  what the gear carries: gravity and a spring      */
    HDT_AXIS_PHASE,              /* counts   within a wave-generator turn, 0..16383           */
    HDT_AXIS_SPEED,              /* rad/s q24  |v_ref|, or of the observer's (FRICTION)       */
    HDT_AXES
};

/* amplitude * sin(order * q_output + phase), times direction if directed. */
struct hdt_line_tab {
    uint64_t phase_per_count_q24;/* order * phase units per count, modulo one turn (2^56)  */
    int32_t amplitude_q16;       /* N.m */
    uint32_t directed;           /* 0 conservative, 1 times direction of motion */
    uint32_t phase0;             /* 2^32 a turn */
};

struct hdt_joint_tab {
    uint32_t terms;              /* bit (1u << enum hdt_term) */

    /* scaling between resolver counts and output angle */
    int32_t sign;                /* +1 or -1: output angle per count; also turns digits and
                                  * speed words, so every other sign here is the joint's     */
    int32_t zero_cnt;            /* count at q = 0                                           */
    uint32_t rad_per_count_q44;  /* rad output per count                                     */
    uint64_t phase_per_count_q24;/* output phase units (2^32 a turn) per count               */

    /* link geometry and inertia in the frames of hdt_chain.h, which are not the model's */
    uint32_t chain;              /* enum hdt_chain: what the numbers below spare the core     */
    uint32_t phase0;             /* angle between the frames' x axes at q = 0, 2^32 a turn    */
    int32_t twist_cos_q30, twist_sin_q30; /* about x, from the previous axis to this one      */
    int32_t step_q24[2];         /* m  x, y of the link's origin in the previous link's frame; z is 0 */
    int32_t moment_q20[2];       /* kg.m   first moment, x y                                  */
    int32_t second_q20[5];       /* kg.m^2 integral of r r': xx xy xz yy yz; zz is 0          */
    int32_t rotor_q20;           /* kg.m^2 rotor and wave generator, reflected to the output  */
    int32_t v_lim_q24;           /* rad/s   reference speed the terms follow; beyond, they hold it */
    int32_t a_lim_q16;           /* rad/s^2 the same of acceleration                          */

    /* friction */
    int32_t v_ramp_inv_q16;      /* s/rad  1 / ramp: direction = clamp(v_ref / ramp, -1, 1)   */
    uint32_t friction_shift;     /* knot k stands at |v| = k << friction_shift (rad/s q24)    */
    int32_t friction_q16[2][HDT_FRICTION_KNOTS]; /* N.m magnitude along motion, by direction  */
    int16_t ripple_q8[HDT_RIPPLE_KNOTS];         /* N.m by wave-generator phase               */
    struct hdt_stiffness_tab stiffness[2];
    int32_t windup_inv_q8;       /* 1/rad  wind-up passes from one direction's torque to the other's over
                                  * twice this travel, and stays at rest; 0: with the direction   */
    uint32_t lines;              /* number used */
    struct hdt_line_tab line[HDT_LINES_MAX];
    int32_t load_mu_q24;         /* N.m/N.m */
    int32_t cold_coulomb_q16;    /* N.m       excess at time zero                            */
    int32_t cold_viscous_q16;    /* N.m.s/rad excess at time zero                            */
    int32_t cold_decay_q31;      /* share left after one second: exp(-1 s / T)                */
    int32_t presliding_q16;      /* N.m       deficit right after a reversal                  */
    int32_t presliding_inv_q8;   /* 1/rad     one over the travel constant                    */
    int32_t spring_q16;          /* N.m/rad */
    int32_t spring_q0_q24;       /* rad     */
    int32_t offset_q16;          /* N.m     */

    /* feedback and output */
    int32_t kp_q16;              /* N.m/rad   output side */
    int32_t kd_q16;              /* N.m.s/rad output side */
    int32_t inertia_inv_q20;     /* 1/(kg.m^2)  rotor and links at a middle pose, for the observer */
    int32_t nm_per_digit_q24;    /* N.m output a digit                                        */
    int32_t digit_per_nm_q24;    /* digits per N.m output: 1000 / (N * torque gain), positive */

    /* limits, kept by the gate */
    int32_t dig_max;             /* digits, 1..32767; motor side, as the digits themselves     */
    int32_t dig_slew;            /* digits per period, 1..65535                               */
    int32_t spd_max;             /* speed digits, 0..32767                                    */
    int32_t q_min_q24, q_max_q24;/* rad: outside, only torque back inside is let through       */
    int32_t v_max_q24;           /* rad/s measured, filtered; above it HDT_FAULT_SPEED        */
    int32_t follow_max_q24;      /* rad |q_ref - q|; above it HDT_FAULT_FOLLOWING; 0 off       */

    /* curves */
    struct hdt_curve_tab local[2]; /* by q, along the motion, by direction as the friction       */
    struct hdt_curve_tab table;  /* by `axis`, joint-signed, times direction if directed          */
    uint32_t axis;               /* enum hdt_axis */
    uint32_t directed;
};

struct hdt_tables {
    uint32_t magic, layout;
    uint8_t digest[32];          /* SHA-256 of the model file */
    char name[32];               /* arm, zero-terminated */
    uint32_t joints;             /* 1..HDT_JOINTS_MAX */
    uint32_t period_ns;          /* control period */
    uint32_t rate_q16;           /* periods a second, q16 (must agree with period_ns)          */
    uint32_t stale_periods;      /* periods in a row without a fresh state that raise
                                  * HDT_FAULT_STALE, >= 1                                    */
    int32_t gravity_q24[3];      /* m/s^2 in the base frame */
    int32_t biquad_q28[5];       /* velocity low-pass: b0 b1 b2 a1 a2, a0 = 1                 */
    uint32_t observer;           /* bit (1u << enum hdt_observed): what takes the observer's velocity */
    int32_t observer_gain[3];    /* of angle q30, of velocity 1/s q16, of acceleration 1/s^2 q8 */
    struct hdt_joint_tab joint[HDT_JOINTS_MAX];
};

enum hdt_tables_err {
    HDT_TABLES_OK = 0,
    HDT_TABLES_SHORT = -1,   /* image ends early, or carries more than it should */
    HDT_TABLES_NOT_OURS = -2,/* magic */
    HDT_TABLES_VERSION = -3, /* layout number differs from HDT_TABLES_LAYOUT */
    HDT_TABLES_CRC = -4,     /* CRC-32 at the end does not match */
    HDT_TABLES_RANGE = -5    /* a value the core cannot take; hdt_tables_check says which */
};

/* Does the core accept these tables?  Everything hdt_step relies on is checked here, once.
 * Errors: negative; *where then names the field, *joint its joint (from 0) or -1.  Both may be NULL.
 * Context: any thread; not in the cycle. */
int hdt_tables_check(const struct hdt_tables *t, const char **where, int *joint);

/* Read a .hdtm image: fields in the order above, little endian, only `joints` joints, then CRC-32
 * (reflected 0xEDB88320, as zlib).  Checks everything hdt_tables_check does.
 * Errors: negative, *out zeroed; except that HDT_TABLES_VERSION leaves the image's number in
 * out->layout, and HDT_TABLES_RANGE leaves the values, for hdt_tables_check to name the wrong one.
 * Context: any thread; not in the cycle. */
int hdt_tables_read(const uint8_t *image, size_t size, struct hdt_tables *out);

/* Bytes in the image of an arm of that many joints. */
size_t hdt_tables_size(uint32_t joints);

/* The image of t into buf; returns its size, or 0 if cap is too small or joints out of range.
 * Same bytes on every machine. */
size_t hdt_tables_write(const struct hdt_tables *t, uint8_t *buf, size_t cap);

/* One clause for people, never NULL: "image is cut short or too long". */
const char *hdt_tables_strerror(int err);

#ifdef __cplusplus
}
#endif
#endif
