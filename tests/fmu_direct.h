/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The run an FMU must repeat, done without it: the servo driver of the same arm, spoken to by
 * telegrams, ticked by hand.  For check_fmu.c and fmu_direct.c.
 *
 * Owns: what the outputs are, a second time.  Never: calls sim/fmu.c.
 */
#ifndef FMU_DIRECT_H
#define FMU_DIRECT_H

#include <math.h>
#include <string.h>

#include "sim/fmu.h"
#include "sim/servo.h"

struct direct {
    struct plant_model model;
    struct servo servo;
    struct drv_state state;              /* last answer */
};

struct direct_input { int mode[DRV_AXES]; double speed_radps[DRV_AXES], torque_m_nm[DRV_AXES]; };
struct direct_output { double angle_rad, link_rad, link_radps, reported_m_nm, gear_nm; unsigned status; };

static inline void direct_send(struct direct *d, const struct direct_input *in, int type)
{
    struct drv_command c;
    struct hdt_frame down, up;
    memset(&c, 0, sizeof c);
    c.type = (uint8_t)type;
    for (int i = 0; i < DRV_AXES; i++) {
        double speed = rint(in->speed_radps[i] / 0.0002), torque = rint(in->torque_m_nm[i] / 0.001);
        c.axis[i].mode = in->mode[i] == 1 ? 2 : in->mode[i] == 2 ? 6 : 1;
        c.axis[i].speed_dig = (int16_t)fmax(-32767, fmin(32767, speed));
        c.axis[i].torque_dig = (int16_t)fmax(-32767, fmin(32767, torque));
    }
    if (drv_command_encode(DRV_FORMAT_A, &c, &down) != 0 || servo_answer(&d->servo, &down, &up) != 1
        || drv_state_decode(DRV_FORMAT_A, &up, &d->state) != 0)
        memset(&d->state, 0xff, sizeof d->state); /* matches nothing */
}

/* d->model is set already and checked. */
static inline void direct_begin(struct direct *d, const double *q_rad, uint64_t seed,
                                const struct direct_input *in)
{
    servo_init(&d->servo, &d->model, NULL, q_rad, seed);
    direct_send(d, in, 'S');
    direct_send(d, in, 'C');
}

static inline void direct_ticks(struct direct *d, const struct direct_input *in, long ticks)
{
    direct_send(d, in, 'C');
    for (long k = 0; k < ticks; k++) {
        servo_tick(&d->servo);
        direct_send(d, in, 'C');
    }
}

static inline struct direct_output direct_read(const struct direct *d, int i)
{
    /* 16384 counts a motor turn; 0.001 N.m a digit */
    struct direct_output o = {
        .angle_rad = d->state.axis[i].count * (2 * acos(-1.0) / (16384 * d->model.joint[i].ratio)),
        .link_rad = d->servo.plant.q_rad[i],
        .link_radps = d->servo.plant.qd_radps[i],
        .reported_m_nm = d->state.axis[i].torque_dig * 0.001,
        .gear_nm = d->servo.plant.gear_nm[i],
        .status = d->state.axis[i].status,
    };
    return o;
}

#endif
