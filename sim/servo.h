/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The servo driver as the host sees it over the bus: telegrams of Format A or B in and out, modes,
 * brakes, watchdog, emergency stop, velocity loop (PI at 1504 Hz), torque mode, resolver and torque
 * quantisation.
 *
 *   mode           S        E     T              C            M     R      A      watchdog, stop switch
 *   STOP           CONTROL  STOP  BRAKE_RELEASE  state only   zero  table  clear  -
 *   CONTROL        -        STOP  -              obeyed       -     table  clear  STOP + alarm
 *   BRAKE_RELEASE  -        STOP  -              brake bits   -     table  clear  STOP + alarm
 *
 * Every well-formed telegram is answered by one of its own type and sequence number, also where it
 * changes nothing ("-").  'S' and 'T' in STOP and 'E' anywhere clear latched alarms, 'A' those of
 * one axis; what is still wrong comes back.  In STOP all brakes are on and all currents zero; while
 * the emergency stop is pressed there is no way out of it.
 *
 * An alarm of an axis: Format A, all go to STOP.  Format B, that axis halts (brake on, no current)
 * and with it those whose last command has DRV_AXIS_STOP_ALL; the others go on.  A halted axis obeys
 * again with the first cyclic command after its alarm is cleared.
 *
 * Owns: the state machine and loops of the driver; it drives a plant.
 * Never: reads a clock; time is advanced by the caller.
 */
#ifndef SERVO_H
#define SERVO_H

#include <stdint.h>

#include "driver/drv_telegram.h"
#include "driver/hdt_bus.h"
#include "sim/plant.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SERVO_RATE_HZ 1504
#define SERVO_PAST 64 /* ticks of torque kept; the plant's report delay ends at 40 ms */
#define SERVO_COUNTS_PER_REV 16384
#define SERVO_TORQUE_NM_PER_DIG 0.001    /* motor side, Format A */
#define SERVO_RATED_DIG 4096             /* digits of rated torque, Format B */
#define SERVO_SPEED_RADPS_PER_DIG 0.0002 /* output side */

enum servo_mode { SERVO_STOP, SERVO_CONTROL, SERVO_BRAKE_RELEASE };

struct servo_cfg {
    enum drv_format format;
    double watchdog_s;                     /* 0: 0.4 in A [RobWork PA10Driver], 0.01 in B [mhipa10arc] */
    double rated_m_nm[PLANT_JOINTS_MAX];   /* Format B: torque words are of this / 4096; 0: tau_max_m_nm */
    uint16_t poles;                        /* as table word 28 says; 0: 8, see servo.c */
    double kp_m_nmspr[PLANT_JOINTS_MAX];   /* velocity loop, motor torque per output rad/s; 0: tuned from
                                              the model */
    double ki_m_nmprad[PLANT_JOINTS_MAX];  /* the same per output rad; 0: tuned from the model */
    double v_trip_radps;                   /* over-velocity alarm, output side; 0: off */
};

struct servo_state {
    enum servo_mode mode;
    double t_s, last_command_s;
    uint64_t ticks;
    struct drv_command command;            /* last cyclic command */
    uint8_t alarm[PLANT_JOINTS_MAX];       /* enum drv_alarm, latched */
    uint32_t outside;                      /* bit per axis: past a position limit */
    uint32_t halted;                       /* bit per axis: Format B, stopped by an alarm, own or another's */
    int emergency, deadman_released;       /* switches, as servo_emergency_stop and servo_deadman set them */
    uint8_t driver_alarm;                  /* enum drv_driver_alarm, latched */
    double integral_m_nm[PLANT_JOINTS_MAX];
    double tau_m_nm[PLANT_JOINTS_MAX];     /* what the current loops make now */
    int16_t torque_dig[PLANT_JOINTS_MAX];  /* what they report, noise included */
    int16_t past_dig[SERVO_PAST][PLANT_JOINTS_MAX]; /* the same, of the last ticks, for a late report */
    int32_t last_count[PLANT_JOINTS_MAX];  /* resolver at the last tick, zero not added */
    double track_cnt[PLANT_JOINTS_MAX];    /* tracking filter: count ahead of last_count, */
    double speed_radps[PLANT_JOINTS_MAX];  /* and speed, output side                      */
    uint64_t rng;
    uint64_t answered, refused;            /* telegrams */
    uint64_t other_format;                 /* of the refused: good ones of the format not spoken here */
};

struct servo {
    const struct plant_model *model;
    struct servo_cfg cfg;                  /* as given, gains filled in */
    struct servo_state s;
    struct plant_state plant;
    int32_t zero_cnt[PLANT_JOINTS_MAX];    /* resolver count at q = 0; 0 after servo_init, then as set,
                                              or by 'M' */
};

/* In STOP with brakes on, the arm at rest at q_rad.  The model must have passed plant_model_check,
 * outlive v and not change.  cfg may be NULL: all defaults.  Joints past DRV_AXES stay braked. */
void servo_init(struct servo *v, const struct plant_model *model, const struct servo_cfg *cfg,
                const double *q_rad, uint64_t seed);
/* Advance servo and plant by one 1504 Hz tick. */
void servo_tick(struct servo *v);
/* The emergency stop button: pressed (1) stops at once, alarm 11; released (0) lets 'S' and 'T' work
 * again.  The dead-man switch: released (1) while a host has it watched gives STOP and alarm 12. */
void servo_emergency_stop(struct servo *v, int pressed);
void servo_deadman(struct servo *v, int released);
/* Answer one telegram.  Returns 1 and the answer, or 0: no answer (malformed or unknown type; counted). */
int servo_answer(struct servo *v, const struct hdt_frame *in, struct hdt_frame *out);
/* Serve everything waiting on the bus.  Returns telegrams answered, or a bus error. */
int servo_serve(struct servo *v, const struct hdt_bus *bus);

#ifdef __cplusplus
}
#endif
#endif
