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
static const double WATCHDOG_A_S = 0.4, WATCHDOG_B_S = 0.01;
/* The public driver that reads the table multiplies by 4 where a line it dropped has poles / 2. */
static const uint16_t POLES = 8;
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

/* What joint i's resolver says; j is that joint as it is now. */
static int32_t resolver(const struct servo *v, const struct plant_joint *j, int i)
{
    double th = v->plant.th_m_rad[i];
    if (j->fx_eccentric_rad != 0)
        th += j->ratio * j->fx_eccentric_rad
              * sin(j->fx_eccentric_order_rev * th / j->ratio + j->fx_eccentric_phase_rad);
    th += j->ratio * j->fx_resolver_rad;
    /* nearbyint rounds half to even in the default rounding mode */
    return saturate(nearbyint(th * (SERVO_COUNTS_PER_REV / TURN_RAD)), 2147483647.0);
}

static int axes(const struct servo *v)
{
    return v->model->joints < DRV_AXES ? v->model->joints : DRV_AXES;
}

/* N.m motor side that a digit of a torque word is */
static double torque_digit(const struct servo *v, int i)
{
    return v->cfg.format == DRV_FORMAT_B ? v->cfg.rated_m_nm[i] / SERVO_RATED_DIG : SERVO_TORQUE_NM_PER_DIG;
}

static void stop(struct servo *v)
{
    v->s.mode = SERVO_STOP;
    v->s.halted = 0;
    v->plant.locked = (1u << v->model->joints) - 1;
    for (int i = 0; i < DRV_AXES; i++)
        v->s.command.axis[i].mode = DRV_AXIS_BRAKE;
    v->s.command.driver_mode = 0;
    memset(v->s.integral_m_nm, 0, sizeof v->s.integral_m_nm);
    memset(v->s.tau_m_nm, 0, sizeof v->s.tau_m_nm);
}

static void stop_all(struct servo *v, enum drv_alarm alarm, enum drv_driver_alarm driver_alarm)
{
    memset(v->s.alarm, (int)alarm, (size_t)axes(v));
    v->s.driver_alarm = (uint8_t)driver_alarm;
    stop(v);
}

/* Axes given by their bits; the driver's own alarm goes when no axis has one left. */
static void clear_alarms(struct servo *v, uint32_t which)
{
    int left = 0;
    for (int i = 0; i < axes(v); i++) {
        if (which >> i & 1u)
            v->s.alarm[i] = 0;
        left |= v->s.alarm[i];
    }
    if (!left)
        v->s.driver_alarm = 0;
    if (v->s.emergency)
        stop_all(v, DRV_ALARM_EMERGENCY_STOP, DRV_DRIVER_EMERGENCY_STOP);
}

void servo_emergency_stop(struct servo *v, int pressed)
{
    v->s.emergency = pressed != 0;
    if (pressed)
        stop_all(v, DRV_ALARM_EMERGENCY_STOP, DRV_DRIVER_EMERGENCY_STOP);
}

void servo_deadman(struct servo *v, int released)
{
    v->s.deadman_released = released != 0;
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
        if (v->cfg.rated_m_nm[i] == 0)
            v->cfg.rated_m_nm[i] = j->tau_max_m_nm;
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
        v->cfg.watchdog_s = v->cfg.format == DRV_FORMAT_B ? WATCHDOG_B_S : WATCHDOG_A_S;
    if (v->cfg.poles == 0)
        v->cfg.poles = POLES;
    tune(v);
    plant_reset(model, &v->plant, q_rad, seed);
    v->s.rng = ~seed;
    stop(v);
    struct plant_model scratch;
    const struct plant_model *now = plant_now(model, 0, &scratch);
    for (int i = 0; i < model->joints; i++)
        v->s.last_count[i] = resolver(v, &now->joint[i], i);
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
    if (v->s.mode != SERVO_CONTROL || !servo_on || (v->s.halted >> i & 1u))
        v->s.integral_m_nm[i] = 0;
    else if (mode & DRV_AXIS_TORQUE)
        v->s.integral_m_nm[i] = tau = torque_digit(v, i) * v->s.command.axis[i].torque_dig;
    else if (held)
        v->s.integral_m_nm[i] = 0;
    else
        tau = velocity_loop(v, i, moved_rad);
    return fmax(-limit, fmin(limit, tau));
}

/* Read resolver i: tracking filter on.  Returns the travel since the last tick, output side. */
static double sense(struct servo *v, const struct plant_joint *j, int i)
{
    int stale = j->fx_stale_share > 0 && plant_uniform(&v->s.rng) <= j->fx_stale_share;
    int32_t count = stale ? v->s.last_count[i] : resolver(v, j, i);
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

/* Does the last command have the dead-man switch watched? */
static int deadman_watched(const struct servo *v)
{
    unsigned bits = 0;
    if (v->cfg.format == DRV_FORMAT_B)
        return (v->s.command.driver_mode & DRV_DRIVER_WATCH_DEADMAN) != 0;
    for (int i = 0; i < DRV_AXES; i++)
        bits |= v->s.command.axis[i].mode;
    return (bits & DRV_AXIS_DEADMAN) != 0;
}

/* Axes that may not move in Format B: those in alarm, and those that stop with any other. */
static uint32_t in_alarm(const struct servo *v)
{
    uint32_t own = 0, with_others = 0;
    for (int i = 0; i < axes(v); i++) {
        uint32_t bit = 1u << i;
        own |= v->s.alarm[i] ? bit : 0;
        with_others |= v->s.command.axis[i].mode & DRV_AXIS_STOP_ALL ? bit : 0;
    }
    return own ? own | with_others : 0;
}

static void watch_axis(struct servo *v, int i)
{
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
}

static void supervise(struct servo *v)
{
    if (v->s.mode == SERVO_STOP)
        return;
    for (int i = 0; i < axes(v); i++)
        watch_axis(v, i);
    uint32_t alarmed = in_alarm(v);
    if (v->s.t_s - v->s.last_command_s > v->cfg.watchdog_s)
        stop_all(v, DRV_ALARM_TIMEOUT, DRV_DRIVER_HOST_TIMEOUT);
    else if (v->s.deadman_released && deadman_watched(v))
        stop_all(v, DRV_ALARM_DEADMAN, DRV_DRIVER_DEADMAN);
    else if (alarmed && v->cfg.format == DRV_FORMAT_A)
        stop(v);
    else if (alarmed) {
        v->s.halted |= alarmed;
        v->plant.locked |= alarmed;
    }
}

static void report_torque(struct servo *v, const struct plant_joint *j, int i)
{
    double noise = j->torque_noise_m_nm;
    double tau = v->s.tau_m_nm[i] + (noise > 0 ? noise * plant_gauss(&v->s.rng) : 0);
    unsigned late = (unsigned)lround(j->fx_report_delay_s / TICK_S);
    unsigned now = (unsigned)(v->s.ticks % SERVO_PAST);
    v->s.past_dig[now][i] = (int16_t)saturate(nearbyint(tau / torque_digit(v, i)), 32767);
    v->s.torque_dig[i] = v->s.past_dig[(now + SERVO_PAST - late) % SERVO_PAST][i];
}

void servo_tick(struct servo *v)
{
    struct plant_model scratch;
    const struct plant_model *now = plant_now(v->model, v->plant.t_s, &scratch);
    supervise(v);
    plant_step(now, &v->plant, v->s.tau_m_nm, TICK_S);
    v->s.t_s = (double)++v->s.ticks * TICK_S;
    for (int i = 0; i < v->model->joints; i++) {
        double moved_rad = sense(v, &now->joint[i], i);
        report_torque(v, &now->joint[i], i); /* of the tick just past, as the counts are */
        if (i < DRV_AXES)
            v->s.tau_m_nm[i] = axis_torque(v, i, moved_rad);
    }
}

/* ---- telegrams ---- */

static void set_brakes(struct servo *v)
{
    for (int i = 0; i < axes(v); i++) {
        uint32_t bit = 1u << i;
        if ((v->s.command.axis[i].mode & DRV_AXIS_BRAKE) || (v->s.halted & bit))
            v->plant.locked |= bit;
        else
            v->plant.locked &= ~bit;
    }
}

static void leave_stop(struct servo *v, enum servo_mode mode)
{
    if (v->s.mode != SERVO_STOP)
        return;
    clear_alarms(v, ~0u);
    if (v->s.emergency)
        return;
    v->s.mode = mode;
    v->s.last_command_s = v->s.t_s;
}

static void obey_cyclic(struct servo *v, const struct drv_command *c)
{
    if (v->s.mode == SERVO_STOP)
        return;
    v->s.command = *c;
    v->s.last_command_s = v->s.t_s;
    v->s.halted = v->cfg.format == DRV_FORMAT_B ? in_alarm(v) : 0;
    set_brakes(v);
}

static void obey(struct servo *v, const struct drv_command *c)
{
    int i = c->axis_no - 1; /* of 'M' and 'A': the decoder lets only 1..DRV_AXES through */
    switch (c->type) {
    case DRV_END:
        stop(v);
        clear_alarms(v, ~0u);
        break;
    case DRV_START:
        leave_stop(v, SERVO_CONTROL);
        break;
    case DRV_BRAKE_RELEASE:
        leave_stop(v, SERVO_BRAKE_RELEASE);
        break;
    case DRV_ZERO:
        if (v->s.mode == SERVO_STOP && i < axes(v))
            v->zero_cnt[i] = -v->s.last_count[i];
        break;
    case DRV_CLEAR:
        clear_alarms(v, 1u << i);
        break;
    case DRV_CYCLIC:
        obey_cyclic(v, c);
        break;
    default: /* DRV_TABLE: only asks */
        break;
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
    int halted = (v->s.halted >> i & 1u) != 0;
    if (v->s.alarm[i] != 0 || halted)
        status |= DRV_AXIS_UNCONTROLLABLE;
    if (v->s.mode != SERVO_CONTROL || halted || !(v->s.command.axis[i].mode & DRV_AXIS_SERVO))
        status |= DRV_AXIS_POWER_OFF;
    return (uint16_t)status;
}

static uint16_t driver_status(const struct servo *v)
{
    unsigned status = (unsigned)v->s.driver_alarm << DRV_ALARM_SHIFT;
    if (!v->s.deadman_released)
        status |= DRV_DRIVER_DEADMAN_ON;
    if (v->s.mode == SERVO_CONTROL)
        status |= DRV_DRIVER_POWER_ON;
    if (v->s.emergency)
        status |= DRV_DRIVER_EMERGENCY_OPEN;
    if (v->s.driver_alarm != 0)
        status |= DRV_DRIVER_UNCONTROLLABLE;
    return (uint16_t)status;
}

static void report(const struct servo *v, struct drv_state *s)
{
    for (int i = 0; i < axes(v); i++) {
        s->axis[i].status = axis_status(v, i);
        s->axis[i].count = saturate((double)v->s.last_count[i] + v->zero_cnt[i], 2147483647.0);
        s->axis[i].speed_dig =
            (int16_t)saturate(nearbyint(v->s.speed_radps[i] / SERVO_SPEED_RADPS_PER_DIG), 32767);
        s->axis[i].torque_dig = v->s.torque_dig[i];
    }
    s->driver_status = driver_status(v);
}

/* The EEPROM table of axis i, as far as it is known: soft limits, zero offset, poles. */
static void report_table(const struct servo *v, int i, uint8_t address, struct drv_state *s)
{
    if (i >= axes(v) || address != 0)
        return;
    const struct plant_joint *j = &v->model->joint[i];
    double per_count = rad_per_count(j);
    uint32_t high = (uint32_t)saturate(nearbyint(j->q_max_rad / per_count), 2147483647.0);
    uint32_t low = (uint32_t)saturate(nearbyint(j->q_min_rad / per_count), 2147483647.0);
    uint32_t zero = (uint32_t)v->zero_cnt[i];
    s->word[DRV_WORD_LIMIT_POS_HI] = (uint16_t)(high >> 16);
    s->word[DRV_WORD_LIMIT_POS_LO] = (uint16_t)(high & 0xffffu);
    s->word[DRV_WORD_LIMIT_NEG_HI] = (uint16_t)(low >> 16);
    s->word[DRV_WORD_LIMIT_NEG_LO] = (uint16_t)(low & 0xffffu);
    s->word[DRV_WORD_ZERO_HI] = (uint16_t)(zero >> 16);
    s->word[DRV_WORD_ZERO_LO] = (uint16_t)(zero & 0xffffu);
    s->word[DRV_WORD_POLES] = v->cfg.poles;
}

int servo_answer(struct servo *v, const struct hdt_frame *in, struct hdt_frame *out)
{
    struct drv_command c;
    if (drv_command_decode(v->cfg.format, in, &c) != DRV_TELEGRAM_OK) {
        enum drv_format other = v->cfg.format == DRV_FORMAT_A ? DRV_FORMAT_B : DRV_FORMAT_A;
        v->s.refused++;
        v->s.other_format += drv_command_decode(other, in, &c) == DRV_TELEGRAM_OK;
        return 0;
    }
    struct drv_state s = { .seq = c.seq, .type = c.type, .axis_no = c.axis_no, .address = c.address };
    obey(v, &c);
    if (c.type == DRV_CYCLIC)
        report(v, &s);
    if (c.type == DRV_TABLE)
        report_table(v, c.axis_no - 1, c.address, &s);
    if (drv_state_encode(v->cfg.format, &s, out) != DRV_TELEGRAM_OK) {
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
        if (sent == HDT_BUS_ERR_FRAME) { /* longer than this bus carries */
            v->s.refused++;
            continue;
        }
        if (sent < 0 && sent != HDT_BUS_ERR_AGAIN)
            return sent;
        answered++; /* a full queue drops the answer; the host counts it as lost */
    }
    return answered;
}
