/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The servo driver: what happens in one 1504 Hz tick, and what a telegram does.
 *
 * Velocity loop: PI.  The integral works on resolver counts themselves (exact, no lag); the
 * proportional part on a second-order tracking filter of them, as a resolver converter has it.
 * The current loop is taken as ideal: it makes the torque asked for within a tick.
 *
 * Owns: the driver's loops and modes.
 * Never: looks at the plant's link side; only counts reach the loops.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"
#include "sim/servo.h"

enum { SERVE_MAX = 64 }; /* frames a call: a flooding host must not stop time */

static const double TICK_S = 1.0 / SERVO_RATE_HZ;
static const double TURN_RAD = 6.283185307179586;
static const double WATCHDOG_S = 0.4;
static const double TRACK_RADPS = 1200;   /* tracking filter, natural frequency */
static const double TRACK_DAMPING = 0.8;
static const double LOOP_RADPS = 400;     /* velocity loop crossover against the rotor alone */
static const double LOOP_INTEGRAL_RADPS = 120;
static const double LIMIT_MARGIN_RAD = 0.001; /* past a position limit, until the alarm */

static double rad_per_count(const struct plant_joint *j)
{
    return TURN_RAD / (SERVO_COUNTS_PER_REV * j->ratio);
}

static int32_t saturate(double value, double limit)
{
    return (int32_t)(value > limit ? limit : value < -limit ? -limit : value);
}

/* nearbyint rounds half to even in the default rounding mode */
static int32_t resolver(const struct servo *v, int i)
{
    return saturate(nearbyint(v->plant.th_m_rad[i] * (SERVO_COUNTS_PER_REV / TURN_RAD)),
                    2147483647.0);
}

static int axes(const struct servo *v)
{
    return v->model->joints < DRV_AXES ? v->model->joints : DRV_AXES;
}

static void stop(struct servo *v)
{
    v->s.mode = SERVO_STOP;
    v->plant.locked = (1u << v->model->joints) - 1;
    for (int i = 0; i < DRV_AXES; i++)
        v->s.command.axis[i].mode = DRV_AXIS_BRAKE;
    memset(v->s.integral_m_nm, 0, sizeof v->s.integral_m_nm);
    memset(v->s.tau_m_nm, 0, sizeof v->s.tau_m_nm);
}

static void clear_alarms(struct servo *v)
{
    memset(v->s.alarm, 0, sizeof v->s.alarm);
    v->s.driver_alarm = 0;
}

/* The loop faces the rotor above its resonance with the link; a falling friction curve adds a
 * negative damping that the gain must outweigh. */
static void tune(struct servo *v)
{
    for (int i = 0; i < v->model->joints; i++) {
        const struct plant_joint *j = &v->model->joint[i];
        double falling = 0;
        for (int d = 0; d < 2; d++)
            if (j->friction[d].fs_nm < 0)
                falling = fmax(falling, -j->friction[d].fs_nm / j->friction[d].vc_radps
                                            - j->friction[d].fv_nmspr);
        double kp_nmspr = LOOP_RADPS * j->rotor_kgm2_m * j->ratio * j->ratio + falling;
        if (v->cfg.kp_m_nmspr[i] == 0)
            v->cfg.kp_m_nmspr[i] = kp_nmspr / j->ratio;
        if (v->cfg.ki_m_nmprad[i] == 0)
            v->cfg.ki_m_nmprad[i] = LOOP_INTEGRAL_RADPS * v->cfg.kp_m_nmspr[i];
    }
}

void servo_init(struct servo *v, const struct plant_model *model, const struct servo_cfg *cfg,
                const double *q_rad, uint64_t seed)
{
    memset(v, 0, sizeof *v);
    v->model = model;
    if (cfg != NULL)
        v->cfg = *cfg;
    if (v->cfg.watchdog_s == 0)
        v->cfg.watchdog_s = WATCHDOG_S;
    tune(v);
    plant_reset(model, &v->plant, q_rad, seed);
    v->s.rng = ~seed;
    stop(v);
    for (int i = 0; i < model->joints; i++)
        v->s.last_count[i] = resolver(v, i);
}

/* ---- one tick ---- */

static double velocity_loop(struct servo *v, int i, double moved_rad)
{
    const struct plant_joint *j = &v->model->joint[i];
    double ref_radps = SERVO_SPEED_RADPS_PER_DIG * v->s.command.axis[i].speed_dig;
    double proportional = v->cfg.kp_m_nmspr[i] * (ref_radps - v->s.speed_radps[i]);
    double more = v->cfg.ki_m_nmprad[i] * (ref_radps * TICK_S - moved_rad);
    double tau = proportional + v->s.integral_m_nm[i] + more;
    /* anti-windup: at saturation the integral only moves back */
    if (fabs(tau) <= j->tau_max_m_nm || tau * more < 0)
        v->s.integral_m_nm[i] =
            fmax(-j->tau_max_m_nm, fmin(j->tau_max_m_nm, v->s.integral_m_nm[i] + more));
    return proportional + v->s.integral_m_nm[i];
}

static double axis_torque(struct servo *v, int i, double moved_rad)
{
    unsigned mode = v->s.command.axis[i].mode;
    double limit = v->model->joint[i].tau_max_m_nm, tau = 0;
    int held = (mode & DRV_AXIS_BRAKE) != 0, servo_on = (mode & DRV_AXIS_SERVO) != 0;
    if (v->s.mode != SERVO_CONTROL || !servo_on)
        v->s.integral_m_nm[i] = 0;
    else if (mode & DRV_AXIS_TORQUE)
        v->s.integral_m_nm[i] = tau = SERVO_TORQUE_NM_PER_DIG * v->s.command.axis[i].torque_dig;
    else if (held)
        v->s.integral_m_nm[i] = 0;
    else
        tau = velocity_loop(v, i, moved_rad);
    return fmax(-limit, fmin(limit, tau));
}

/* Read resolver i: tracking filter on.  Returns the travel since the last tick, output side. */
static double sense(struct servo *v, int i)
{
    int32_t count = resolver(v, i);
    double per_count = rad_per_count(&v->model->joint[i]);
    double moved_cnt = (double)count - v->s.last_count[i];
    v->s.last_count[i] = count;
    /* predict, then correct by the count that came; kept relative to the count, so it never grows */
    double ahead = v->s.track_cnt[i] - moved_cnt + v->s.speed_radps[i] / per_count * TICK_S;
    v->s.speed_radps[i] -= TRACK_RADPS * TRACK_RADPS * TICK_S * ahead * per_count;
    v->s.track_cnt[i] = ahead * (1 - 2 * TRACK_DAMPING * TRACK_RADPS * TICK_S);
    return moved_cnt * per_count;
}

static double angle(const struct servo *v, int i)
{
    return v->s.last_count[i] * rad_per_count(&v->model->joint[i]);
}

static void supervise(struct servo *v)
{
    int tripped = 0;
    if (v->s.mode == SERVO_STOP)
        return;
    for (int i = 0; i < axes(v); i++) {
        const struct plant_joint *j = &v->model->joint[i];
        double q = angle(v, i);
        uint32_t bit = 1u << i;
        if (v->cfg.v_trip_radps > 0 && fabs(v->s.speed_radps[i]) > v->cfg.v_trip_radps)
            v->s.alarm[i] = DRV_ALARM_OVER_VELOCITY;
        if (q <= j->q_max_rad + LIMIT_MARGIN_RAD && q >= j->q_min_rad - LIMIT_MARGIN_RAD) {
            v->s.outside &= ~bit;
        } else if (!(v->s.outside & bit)) { /* on the way out only: a host may drive back in */
            v->s.outside |= bit;
            v->s.alarm[i] = DRV_ALARM_POSITION_LIMIT;
        }
        tripped |= v->s.alarm[i];
    }
    if (v->s.t_s - v->s.last_command_s > v->cfg.watchdog_s) {
        v->s.driver_alarm = DRV_DRIVER_HOST_TIMEOUT;
        memset(v->s.alarm, DRV_ALARM_TIMEOUT, (size_t)axes(v));
        tripped = 1;
    }
    if (tripped)
        stop(v);
}

static void report_torque(struct servo *v, int i)
{
    double noise = v->model->joint[i].torque_noise_m_nm;
    double tau = v->s.tau_m_nm[i] + (noise > 0 ? noise * plant_gauss(&v->s.rng) : 0);
    v->s.torque_dig[i] = (int16_t)saturate(nearbyint(tau / SERVO_TORQUE_NM_PER_DIG), 32767);
}

void servo_tick(struct servo *v)
{
    supervise(v);
    plant_step(v->model, &v->plant, v->s.tau_m_nm, TICK_S);
    v->s.t_s = (double)++v->s.ticks * TICK_S;
    for (int i = 0; i < v->model->joints; i++) {
        double moved_rad = sense(v, i);
        report_torque(v, i); /* of the tick just past, as the counts are */
        if (i < DRV_AXES)
            v->s.tau_m_nm[i] = axis_torque(v, i, moved_rad);
    }
}

/* ---- telegrams ---- */

static void set_brakes(struct servo *v)
{
    for (int i = 0; i < axes(v); i++) {
        uint32_t bit = 1u << i;
        if (v->s.command.axis[i].mode & DRV_AXIS_BRAKE)
            v->plant.locked |= bit;
        else
            v->plant.locked &= ~bit;
    }
}

static void obey(struct servo *v, const struct drv_command *c)
{
    switch (c->type) {
    case DRV_END:
        stop(v);
        clear_alarms(v);
        break;
    case DRV_START:
    case DRV_BRAKE_RELEASE:
        if (v->s.mode == SERVO_STOP) {
            clear_alarms(v);
            v->s.mode = c->type == DRV_START ? SERVO_CONTROL : SERVO_BRAKE_RELEASE;
            v->s.last_command_s = v->s.t_s;
        }
        break;
    default: /* DRV_CYCLIC: the decoder lets no other through */
        if (v->s.mode == SERVO_STOP)
            break;
        v->s.command = *c;
        v->s.last_command_s = v->s.t_s;
        set_brakes(v);
    }
}

static uint16_t axis_status(const struct servo *v, int i)
{
    const struct plant_joint *j = &v->model->joint[i];
    unsigned status = (unsigned)v->s.alarm[i] << DRV_ALARM_SHIFT;
    double q = angle(v, i);
    if (q > j->q_max_rad)
        status |= DRV_AXIS_LIMIT_POS;
    if (q < j->q_min_rad)
        status |= DRV_AXIS_LIMIT_NEG;
    if (v->s.alarm[i] != 0)
        status |= DRV_AXIS_UNCONTROLLABLE;
    if (v->s.mode != SERVO_CONTROL || !(v->s.command.axis[i].mode & DRV_AXIS_SERVO))
        status |= DRV_AXIS_POWER_OFF;
    return (uint16_t)status;
}

static void report(const struct servo *v, struct drv_state *s)
{
    for (int i = 0; i < axes(v); i++) {
        s->axis[i].status = axis_status(v, i);
        s->axis[i].count = saturate((double)v->s.last_count[i] + v->zero_cnt[i], 2147483647.0);
        s->axis[i].torque_dig = v->s.torque_dig[i];
    }
    s->driver_status = (uint16_t)(v->s.driver_alarm << DRV_ALARM_SHIFT);
}

int servo_answer(struct servo *v, const struct hdt_frame *in, struct hdt_frame *out)
{
    struct drv_command c;
    if (drv_command_decode(in, &c) != DRV_TELEGRAM_OK) {
        v->s.refused++;
        return 0;
    }
    struct drv_state s = { .seq = c.seq, .type = c.type };
    obey(v, &c);
    report(v, &s);
    if (drv_state_encode(&s, out) != DRV_TELEGRAM_OK) {
        v->s.refused++;
        return 0;
    }
    v->s.answered++;
    return 1;
}

int servo_serve(struct servo *v, const struct hdt_bus *bus)
{
    struct hdt_frame in, out;
    int answered = 0;
    for (int k = 0; k < SERVE_MAX; k++) {
        int got = bus->recv(bus->ctx, &in);
        if (got == HDT_BUS_ERR_AGAIN)
            break;
        if (got == HDT_BUS_ERR_FRAME) {
            v->s.refused++;
            continue;
        }
        if (got < 0)
            return got;
        if (!servo_answer(v, &in, &out))
            continue;
        int sent = bus->send(bus->ctx, &out);
        if (sent < 0 && sent != HDT_BUS_ERR_AGAIN)
            return sent;
        answered++; /* a full queue drops the answer; the host counts it as lost */
    }
    return answered;
}
