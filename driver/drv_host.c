/* SPDX-License-Identifier: Apache-2.0 */
/* The phases.  See drv_host.h; drv_host_say.c has the words. */
#include "driver/drv_host.h"

#include <string.h>

#include "ctrl/hdt_q.h"

#define Q24 16777216.0
#define ONE_Q32 ((uint64_t)1 << 32)
#define END_S 0.5 /* 'E' is repeated this long before the end counts as unconfirmed */

/* Minimum-jerk blend: position share, and its first two derivatives in 1/T and 1/T^2. */
static void blend(double x, double *s, double *ds, double *dds)
{
    *s = x * x * x * (10.0 + x * (-15.0 + 6.0 * x));
    *ds = x * x * (30.0 + x * (-60.0 + 30.0 * x));
    *dds = x * (60.0 + x * (-180.0 + 120.0 * x));
}

static int32_t to_fixed(double value, double scale)
{
    double x = value * scale;
    if (x >= 2147483647.0)
        return INT32_MAX;
    if (x <= -2147483647.0)
        return -INT32_MAX;
    return (int32_t)(x >= 0.0 ? x + 0.5 : x - 0.5);
}

static void enter(struct drv_host *h, enum drv_host_phase phase)
{
    h->phase = phase;
    h->phase_us = h->t_us;
}

static double phase_s(const struct drv_host *h)
{
    return (double)(h->t_us - h->phase_us) * 1e-6;
}

/* How long the reference has stood still in this hold; below 0 while it slows down. */
static double stands_s(const struct drv_host *h)
{
    return phase_s(h) - (h->sample >= h->ref.samples ? 0.0 : h->cfg.hold_s);
}

int drv_host_init(struct drv_host *h, const struct hdt_tables *t, const struct hdt_bus *bus,
                  struct drv_ring *ring, const struct drv_reference *ref, const struct drv_host_cfg *cfg)
{
    if (!h || !t || !bus || !ref || !cfg || !ref->q || !ref->v || !ref->a || ref->samples == 0 ||
        ref->joints != t->joints)
        return HDT_ERR_ARG;
    if (cfg->mode != HDT_MODE_TORQUE && cfg->mode != HDT_MODE_VELOCITY)
        return HDT_ERR_ARG;
    /* a joint that is not there never reports, and would be waited for */
    if (ref->joints < 32 && ref->active >> ref->joints != 0)
        return HDT_ERR_ARG;
    memset(h, 0, sizeof *h);
    h->ref = *ref;
    h->cfg = *cfg;
    if (h->cfg.approach_radps <= 0.0)
        h->cfg.approach_radps = 0.25;
    if (h->cfg.answer_s <= 0.0)
        h->cfg.answer_s = 2.0;
    if (h->cfg.hold_s <= 0.0)
        h->cfg.hold_s = 0.3;
    h->in.active = ref->active;
    return drv_cycle_init(&h->cycle, t, bus, ring);
}

/* Remember where the arm stands and how long the way to the first sample takes.  A joint parked outside
 * its range starts from the end of it: a reference outside is a fault, and feedback pulls it back in. */
static void plan_approach(struct drv_host *h)
{
    double farthest = 0.0;
    for (unsigned j = 0; j < h->ref.joints; j++) {
        const struct hdt_joint_tab *tab = &h->cycle.core.tables->joint[j];
        h->from_q24[j] = (int32_t)hdt_clamp(h->out.q[j].raw, tab->q_min_q24, tab->q_max_q24);
        double d = ((double)h->ref.q[j].raw - (double)h->from_q24[j]) / Q24;
        if ((h->ref.active >> j & 1u) && (d < 0 ? -d : d) > farthest)
            farthest = d < 0 ? -d : d;
    }
    /* peak speed of the blend is 15/8 of the mean */
    h->approach_s = 1.875 * farthest / h->cfg.approach_radps;
    if (h->approach_s < 0.3)
        h->approach_s = 0.3;
    h->approached_us = 0.0;
    h->sample = 0;
    h->frac_q32 = 0;
    h->rate_q32 = ONE_Q32;
    h->rate_slope = 0.0;
    enter(h, DRV_HOST_APPROACH);
}

static int approaching(const struct drv_host *h)
{
    return h->phase == DRV_HOST_APPROACH || (h->phase == DRV_HOST_HOLD && h->resume == DRV_HOST_APPROACH);
}

/* The rate goes towards 0 in a hold and towards 1 in motion; time of the approach goes on at it. */
static void pace(struct drv_host *h, uint64_t dt_us)
{
    double change = (double)dt_us * 1e-6 / h->cfg.hold_s;
    uint64_t step = change < 1.0 ? (uint64_t)(change * (double)ONE_Q32) : ONE_Q32;
    uint64_t left = ONE_Q32 - h->rate_q32;
    uint64_t before = h->rate_q32;
    if (h->phase == DRV_HOST_HOLD)
        h->rate_q32 -= step < h->rate_q32 ? step : h->rate_q32;
    else
        h->rate_q32 += step < left ? step : left;
    h->rate_slope = dt_us == 0
                        ? 0.0
                        : ((double)h->rate_q32 - (double)before) / (double)ONE_Q32 / ((double)dt_us * 1e-6);
    if (approaching(h))
        h->approached_us += (double)dt_us * ((double)h->rate_q32 / (double)ONE_Q32);
}

/* On along the samples, by one period at the present rate. */
static void next_sample(struct drv_host *h)
{
    uint64_t way = h->frac_q32 + h->rate_q32;
    h->sample += (unsigned)(way >> 32);
    h->frac_q32 = (uint32_t)way;
}

static void reference_approach(struct drv_host *h)
{
    double s, ds, dds, x = h->approached_us * 1e-6 / h->approach_s;
    double r = (double)h->rate_q32 / (double)ONE_Q32, slope = h->rate_slope;
    blend(x < 1.0 ? x : 1.0, &s, &ds, &dds);
    for (unsigned j = 0; j < h->ref.joints; j++) {
        double from = (double)h->from_q24[j], d = (double)h->ref.q[j].raw - from;
        double v = d * ds / h->approach_s, a = d * dds / (h->approach_s * h->approach_s);
        h->in.q_ref[j].raw = to_fixed(from + d * s, 1.0);
        h->in.v_ref[j].raw = to_fixed(v * r, 1.0);
        h->in.a_ref[j].raw = to_fixed(a * r * r + v * slope, 1.0 / 256.0);
    }
}

static double between(int32_t a, int32_t b, double share)
{
    return (double)a + ((double)b - (double)a) * share;
}

/* The reference at sample and share of the way to the next; at full rate the samples themselves. */
static void reference_sample(struct drv_host *h)
{
    unsigned k = h->sample < h->ref.samples ? h->sample : h->ref.samples - 1;
    unsigned next = k + 1 < h->ref.samples ? k + 1 : k;
    size_t at = (size_t)k * h->ref.joints, then = (size_t)next * h->ref.joints;
    double share = (double)h->frac_q32 / (double)ONE_Q32;
    double r = (double)h->rate_q32 / (double)ONE_Q32, slope = h->rate_slope;
    for (unsigned j = 0; j < h->ref.joints; j++) {
        double v = between(h->ref.v[at + j].raw, h->ref.v[then + j].raw, share);
        double a = between(h->ref.a[at + j].raw, h->ref.a[then + j].raw, share);
        h->in.q_ref[j].raw = to_fixed(between(h->ref.q[at + j].raw, h->ref.q[then + j].raw, share), 1.0);
        h->in.v_ref[j].raw = to_fixed(v * r, 1.0);
        /* v is q24, a is q16 */
        h->in.a_ref[j].raw = to_fixed(a * r * r + v / 256.0 * slope, 1.0);
    }
}

/* After the end the arm stands, whatever the last sample's speed was. */
static void reference_end(struct drv_host *h)
{
    size_t at = (size_t)(h->ref.samples - 1) * h->ref.joints;
    for (unsigned j = 0; j < h->ref.joints; j++)
        h->in.q_ref[j] = h->ref.q[at + j];
    memset(h->in.v_ref, 0, sizeof h->in.v_ref);
    memset(h->in.a_ref, 0, sizeof h->in.a_ref);
}

static void begin_end(struct drv_host *h, enum drv_host_phase then)
{
    h->outcome = then;
    enter(h, DRV_HOST_ENDING);
    (void)drv_cycle_end(&h->cycle);
}

static void go(struct drv_host *h)
{
    if (h->phase == DRV_HOST_READY || (h->phase == DRV_HOST_HOLD && h->sample >= h->ref.samples)) {
        plan_approach(h);
    } else if (h->phase == DRV_HOST_HOLD) {
        enter(h, h->resume);
    }
}

static void clear(struct drv_host *h)
{
    h->seen = 0;
    h->in.servo_alarm = 0;
    drv_cycle_restart(&h->cycle);
    (void)hdt_clear(&h->cycle.core);
    enter(h, DRV_HOST_IDLE);
}

static uint32_t bit_of(enum drv_host_request ask)
{
    return (uint32_t)1 << ask;
}

static void obey_one(struct drv_host *h, enum drv_host_request ask)
{
    switch (ask) {
    case DRV_HOST_ASK_GO:
        if (h->error == HDT_OK)
            go(h);
        else
            drv_host_ask(h, DRV_HOST_ASK_GO); /* not from a period without a measurement */
        break;
    case DRV_HOST_ASK_HOLD:
    case DRV_HOST_ASK_HOLD_LATE:
        if (h->phase == DRV_HOST_APPROACH || h->phase == DRV_HOST_RUN) {
            h->resume = h->phase;
            enter(h, DRV_HOST_HOLD);
        }
        break;
    case DRV_HOST_ASK_CLEAR:
        if (h->phase == DRV_HOST_FAULT)
            clear(h);
        break;
    case DRV_HOST_ASK_STOP:
    case DRV_HOST_ASK_STOP_LATE:
        if (h->phase != DRV_HOST_ENDING)
            begin_end(h, DRV_HOST_DONE);
        break;
    case DRV_HOST_ASK_NOTHING:
        break;
    }
}

/* What was asked for since the last period, until one of them changes the phase. */
static void obey(struct drv_host *h)
{
    static const enum drv_host_request order[] = {DRV_HOST_ASK_STOP,  DRV_HOST_ASK_STOP_LATE,
                                                  DRV_HOST_ASK_HOLD,  DRV_HOST_ASK_HOLD_LATE,
                                                  DRV_HOST_ASK_CLEAR, DRV_HOST_ASK_GO};
    uint32_t asked = __atomic_exchange_n(&h->requests, 0, __ATOMIC_ACQ_REL);
    enum drv_host_phase before = h->phase;
    if (asked & (bit_of(DRV_HOST_ASK_HOLD) | bit_of(DRV_HOST_ASK_HOLD_LATE)))
        asked &= ~bit_of(DRV_HOST_ASK_GO);
    for (unsigned k = 0; k < sizeof order / sizeof order[0] && h->phase == before; k++)
        if (asked & bit_of(order[k])) {
            obey_one(h, order[k]);
            h->asked = h->phase != before ? order[k] : h->asked;
        }
}

/* The phases that end do so here, by themselves. */
static void change_phase(struct drv_host *h)
{
    enum drv_host_phase before = h->phase;
    if (h->phase == DRV_HOST_IDLE && (h->seen & h->ref.active) == h->ref.active)
        enter(h, DRV_HOST_READY);
    else if (h->phase == DRV_HOST_IDLE && !h->cfg.operated && phase_s(h) > h->cfg.answer_s)
        begin_end(h, DRV_HOST_SILENT);
    if (h->phase == DRV_HOST_READY && !h->cfg.operated)
        plan_approach(h);
    if (h->phase == DRV_HOST_APPROACH && h->approached_us * 1e-6 >= h->approach_s)
        enter(h, DRV_HOST_RUN);
    if (h->phase == DRV_HOST_RUN && h->sample >= h->ref.samples) {
        h->resume = DRV_HOST_RUN;
        enter(h, DRV_HOST_HOLD);
    }
    if (h->phase == DRV_HOST_HOLD && !h->cfg.operated && stands_s(h) >= h->cfg.settle_s)
        begin_end(h, DRV_HOST_DONE);
    if (h->phase == DRV_HOST_ENDING &&
        (drv_cycle_ended(&h->cycle) || h->outcome == DRV_HOST_SILENT || phase_s(h) > END_S))
        enter(h, h->outcome);
    /* what was asked for is still why in a hold that ends, and in an end that is over */
    if (h->phase != before && before != DRV_HOST_ENDING && before != DRV_HOST_HOLD)
        h->asked = DRV_HOST_ASK_NOTHING;
}

/* Mode and reference of this period. */
static void prepare(struct drv_host *h)
{
    h->in.mode = h->cfg.mode;
    switch (h->phase) {
    case DRV_HOST_APPROACH:
        reference_approach(h);
        break;
    case DRV_HOST_RUN:
        reference_sample(h);
        next_sample(h);
        break;
    case DRV_HOST_HOLD:
        if (h->sample >= h->ref.samples) {
            reference_end(h);
        } else if (approaching(h)) {
            reference_approach(h);
        } else {
            reference_sample(h);
            next_sample(h);
        }
        break;
    default:
        /* not driving: the reference follows the arm, so that nothing jumps later */
        h->in.mode = HDT_MODE_IDLE;
        memcpy(h->in.q_ref, h->out.q, sizeof h->in.q_ref);
        memset(h->in.v_ref, 0, sizeof h->in.v_ref);
        memset(h->in.a_ref, 0, sizeof h->in.a_ref);
    }
}

static void latch(struct drv_host *h)
{
    h->fault.t_us = h->t_us - h->t0_us;
    h->fault.fault = h->out.fault;
    h->fault.joints = h->out.fault_joints;
    h->fault.driver_status = h->cycle.last.driver_status;
    h->fault.unpowered = h->cycle.unpowered;
    for (unsigned j = 0; j < DRV_AXES; j++)
        h->fault.status[j] = h->cycle.last.axis[j].status;
    memcpy(h->fault.q_ref, h->in.q_ref, sizeof h->fault.q_ref);
    memcpy(h->fault.q, h->out.q, sizeof h->fault.q);
    memcpy(h->fault.v, h->out.v, sizeof h->fault.v);
    h->asked = DRV_HOST_ASK_NOTHING;
    if (h->cfg.operated)
        enter(h, DRV_HOST_FAULT);
    else
        begin_end(h, DRV_HOST_FAULTED);
}

/* The cycle's period.  One it refuses leaves what was measured before it. */
static void step(struct drv_host *h)
{
    hdt_rad_t q[HDT_JOINTS_MAX];
    hdt_radps_t v[HDT_JOINTS_MAX];
    memcpy(q, h->out.q, sizeof q);
    memcpy(v, h->out.v, sizeof v);
    h->error = drv_cycle_period(&h->cycle, &h->in, &h->out);
    if (h->error == HDT_OK) {
        h->seen |= h->in.fresh;
        return;
    }
    memcpy(h->out.q, q, sizeof q);
    memcpy(h->out.v, v, sizeof v);
    h->last_error = h->error;
    h->errors++;
}

enum drv_host_phase drv_host_period(struct drv_host *h, uint64_t t_us)
{
    if (h->phase >= DRV_HOST_DONE)
        return h->phase;
    if (h->t0_us == 0)
        h->t0_us = h->phase_us = h->t_us = t_us;
    /* after a stall the reference goes on from where it was, it does not jump to where it would be */
    uint64_t dt_us = t_us - h->t_us, most_us = h->cycle.core.tables->period_ns / 500u;
    h->t_us = t_us;
    obey(h);
    pace(h, dt_us < most_us ? dt_us : most_us);
    change_phase(h);
    if (h->phase >= DRV_HOST_DONE)
        return h->phase;
    prepare(h);
    h->in.t_us = t_us;
    step(h);
    if (h->out.fault != 0 && h->phase != DRV_HOST_FAULT && h->phase != DRV_HOST_ENDING)
        latch(h);
    return h->phase;
}

void drv_host_ask(struct drv_host *h, enum drv_host_request ask)
{
    (void)__atomic_fetch_or(&h->requests, bit_of(ask), __ATOMIC_ACQ_REL);
}

void drv_host_stop(struct drv_host *h)
{
    drv_host_ask(h, DRV_HOST_ASK_STOP);
}

void drv_host_report(const struct drv_host *h, struct drv_host_status *s)
{
    s->t_us = h->t_us - h->t0_us;
    s->phase = h->phase;
    s->asked = h->asked;
    s->link = h->cycle.link;
    s->sample = h->sample;
    s->samples = h->ref.samples;
    s->active = h->ref.active;
    s->seen = h->seen;
    s->end_confirmed = h->cycle.link == DRV_LINK_ENDED && h->cycle.end_answered;
    s->fault = h->fault;
    s->errors = h->errors;
    s->error = h->last_error;
    s->count = h->cycle.count;
}

const char *drv_host_phase_str(enum drv_host_phase phase)
{
    static const char *const name[] = {"idle", "ready", "approach", "run", "hold", "fault",
                                       "ending", "done", "faulted", "silent"};
    return (unsigned)phase < sizeof name / sizeof name[0] ? name[phase] : "unknown";
}
