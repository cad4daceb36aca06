/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The control core: resolver counts and reference in, torque digits out, once a period.
 *
 *   tau_j = gravity + inertia + friction + ripple + stiffness + ... + kp (q_ref - q) + kd (v_ref - v)
 *   digit_j = gate( digit_per_nm_j * tau_j )
 *
 * Owns: the step, its terms, the velocity estimate, the gate.
 * Never: allocates, blocks, prints, reads a clock, uses floating point or libc beyond
 * memset/memcpy.  Time comes in as an argument, so a run is a function of its inputs.
 *
 * Three words, kept apart: an *error* means the call did nothing (negative return); a *fault* is
 * latched and the output safe until hdt_clear; a *limit* means the command was cut this period.
 */
#ifndef HDT_H
#define HDT_H

#include <stdint.h>

#include "ctrl/hdt_q.h"
#include "ctrl/hdt_tables.h"

#ifdef __cplusplus
extern "C" {
#endif

#define HDT_VERSION_MAJOR 0
#define HDT_VERSION_MINOR 1
#define HDT_VERSION_PATCH 0

enum hdt_err {
    HDT_OK = 0,
    HDT_ERR_ARG = -1,   /* null pointer, unknown mode */
    HDT_ERR_TABLES = -2,/* tables not accepted: ask hdt_tables_check */
    HDT_ERR_TIME = -3   /* t_us did not advance */
};

enum hdt_mode {
    HDT_MODE_IDLE = 0,     /* zero digits, filters run */
    HDT_MODE_TORQUE = 1,   /* digits from model and feedback */
    HDT_MODE_VELOCITY = 2  /* speed words: v_ref plus a position correction; digits zero */
};

/* Latched until hdt_clear.  Any of them: zero digits, zero speed words. */
enum hdt_fault {
    HDT_FAULT_STALE = 1u << 0,     /* no fresh state for stale_periods               */
    HDT_FAULT_SPEED = 1u << 1,     /* measured speed above v_max                     */
    HDT_FAULT_FOLLOWING = 1u << 2, /* |q_ref - q| above follow_max                   */
    HDT_FAULT_SERVO = 1u << 3,     /* the servo reported an alarm (in.servo_alarm)   */
    HDT_FAULT_REFERENCE = 1u << 4  /* reference outside the position limits          */
};

/* Cut this period, per joint; not latched. */
enum hdt_limit {
    HDT_LIM_TORQUE = 1u << 0,
    HDT_LIM_SLEW = 1u << 1,
    HDT_LIM_POSITION = 1u << 2,
    HDT_LIM_SPEED = 1u << 3
};

/* One period's input.  Arrays hold `joints` used entries. */
struct hdt_in {
    uint64_t t_us;                          /* host time of this period, must advance */
    uint64_t count_us;                      /* host time the counts were taken at, as well as it is known;
                                             * 0: t_us.  Velocity is counts over this time        */
    uint32_t mode;                          /* enum hdt_mode */
    uint32_t active;                        /* bit per joint: driven; others get zero and their brake
                                             * stays on */
    uint32_t fresh;                         /* bit per joint: count is new since the last step */
    uint32_t servo_alarm;                   /* bit per joint: the servo reports an alarm */
    hdt_cnt_t count[HDT_JOINTS_MAX];        /* motor-side resolver */
    hdt_rad_t q_ref[HDT_JOINTS_MAX];
    hdt_radps_t v_ref[HDT_JOINTS_MAX];
    hdt_radps2_t a_ref[HDT_JOINTS_MAX];
};

/* One period's output; every term apart, N.m output side, zero where not used. */
struct hdt_out {
    hdt_dig_t digit[HDT_JOINTS_MAX];
    hdt_spd_t speed[HDT_JOINTS_MAX];
    uint32_t fault;                         /* enum hdt_fault, latched */
    uint32_t fault_joints;                  /* bit per joint that raised a fault */
    uint32_t limit[HDT_JOINTS_MAX];         /* enum hdt_limit */
    hdt_rad_t q[HDT_JOINTS_MAX];            /* measured, from counts */
    hdt_radps_t v[HDT_JOINTS_MAX];          /* measured, filtered */
    hdt_radps_t v_obs[HDT_JOINTS_MAX];      /* observed, zero where no observer runs */
    hdt_nm_t term[HDT_TERMS][HDT_JOINTS_MAX];
    hdt_nm_t total[HDT_JOINTS_MAX];         /* sum of terms, before the gate */
};

/* Velocity estimate of one joint: second-order low-pass over differenced counts. */
struct hdt_vel {
    int32_t x_q24[2], y_q24[2];             /* rad/s: past inputs and outputs, newest first */
    int32_t rest;                           /* rounding rest fed into the next output, q52  */
};

/* Velocity observer of one joint: angle, velocity and what the model does not know of acceleration. */
struct hdt_obs {
    int64_t q_q40, v_q40;                   /* rad, rad/s */
    int64_t d_q32;                          /* rad/s^2 beyond the model's */
    int32_t a_q16;                          /* rad/s^2 of the model, from the last period's torque */
};

/* What the gate remembers. */
struct hdt_gate {
    uint32_t fault, fault_joints;
    uint32_t stale[HDT_JOINTS_MAX];         /* periods since the last fresh count */
    int32_t digit[HDT_JOINTS_MAX];          /* last digit, joint direction, for the slew limit */
};

/* State of one arm.  Public so that it can be static and copied: a copy is a snapshot, and a
 * snapshot replays bit for bit.  The members are not interface. */
typedef struct {
    const struct hdt_tables *tables;
    uint64_t t_us;
    uint64_t second_us;                     /* host time not yet counted in cold_q30 */
    uint32_t steps;
    uint32_t seen;                          /* bit per joint: a count has arrived */
    uint32_t observed;                      /* bit per joint: its observer has started */
    uint32_t terms;                         /* terms any joint uses */
    struct hdt_gate gate;
    struct hdt_vel vel[HDT_JOINTS_MAX];
    struct hdt_obs obs[HDT_JOINTS_MAX];
    int32_t count[HDT_JOINTS_MAX];          /* last count */
    uint64_t count_us[HDT_JOINTS_MAX];      /* and its time */
    int32_t dir[HDT_JOINTS_MAX];            /* sign of the last motion of the reference: -1 0 +1 */
    int32_t wound_q30[HDT_JOINTS_MAX];      /* wind-up of the reference's travel, -1..1 */
    int64_t travel_q40[HDT_JOINTS_MAX];     /* rad since the last reversal of the reference */
    int32_t cold_q30[HDT_JOINTS_MAX];       /* share of the cold excess still there */
} hdt_t;

/* Start with these tables.  They must outlive h and not change.
 * Errors: HDT_ERR_ARG, HDT_ERR_TABLES; *h is then all zero and hdt_step refuses it.
 * Context: any thread, before the cycle. */
int hdt_init(hdt_t *h, const struct hdt_tables *tables);

/* One control period.  Zero digits until every active joint has had its first count.
 * Constant time: no data-dependent loop; cost grows with joints and terms in use.
 * Overflow: products are 64-bit; every term saturates at +-32767 N.m; digits are clamped by the
 * gate with the limit bit set; nothing wraps.
 * Errors: HDT_ERR_ARG, HDT_ERR_TABLES (h was never started), HDT_ERR_TIME; *out is then all zero (if given),
 * and h unchanged but for the slew limit, which goes on from zero digits.
 * Context: control thread only, one h at a time. */
int hdt_step(hdt_t *h, const struct hdt_in *in, struct hdt_out *out);

/* Clear latched faults.  Digits restart from zero through the slew limit.
 * Context: between steps. */
int hdt_clear(hdt_t *h);

/* Names for people; never NULL. */
const char *hdt_strerror(int err);
const char *hdt_fault_str(uint32_t one_bit);
const char *hdt_limit_str(uint32_t one_bit);
const char *hdt_term_str(int term); /* lower case, as in log columns: "gravity" */

#ifdef __cplusplus
}
#endif
#endif
