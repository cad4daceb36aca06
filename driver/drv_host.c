/* SPDX-License-Identifier: Apache-2.0 */
/* See drv_host.h. */
#include "driver/drv_host.h"

#include <string.h>

#define Q24 16777216.0

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

static void enter(struct drv_host *h, enum drv_host_phase phase, uint64_t t_us)
{
    h->phase = phase;
    h->phase_us = t_us;
}

static double phase_s(const struct drv_host *h, uint64_t t_us)
{
    return (double)(t_us - h->phase_us) * 1e-6;
}

int drv_host_init(struct drv_host *h, const struct hdt_tables *t, const struct hdt_bus *bus,
                  struct drv_ring *ring, const struct drv_reference *ref, const struct drv_host_cfg *cfg)
{
    if (!h || !t || !bus || !ref || !cfg || !ref->q || !ref->v || !ref->a || ref->samples == 0 ||
        ref->joints != t->joints)
        return HDT_ERR_ARG;
    if (cfg->mode != HDT_MODE_TORQUE && cfg->mode != HDT_MODE_VELOCITY)
        return HDT_ERR_ARG;
    memset(h, 0, sizeof *h);
    h->ref = *ref;
    h->cfg = *cfg;
    if (h->cfg.approach_radps <= 0.0)
        h->cfg.approach_radps = 0.25;
    if (h->cfg.answer_s <= 0.0)
        h->cfg.answer_s = 2.0;
    h->in.active = ref->active;
    return drv_cycle_init(&h->cycle, t, bus, ring);
}

/* Remember where the arm stands and how long the way to the first sample takes. */
static void plan_approach(struct drv_host *h)
{
    double farthest = 0.0;
    for (unsigned j = 0; j < h->ref.joints; j++) {
        double d = ((double)h->ref.q[j].raw - (double)h->out.q[j].raw) / Q24;
        h->from_q24[j] = h->out.q[j].raw;
        if ((h->ref.active >> j & 1u) && (d < 0 ? -d : d) > farthest)
            farthest = d < 0 ? -d : d;
    }
    /* peak speed of the blend is 15/8 of the mean */
    h->approach_s = 1.875 * farthest / h->cfg.approach_radps;
    if (h->approach_s < 0.3)
        h->approach_s = 0.3;
}

static void reference_approach(struct drv_host *h, uint64_t t_us)
{
    double s, ds, dds, x = phase_s(h, t_us) / h->approach_s;
    blend(x < 1.0 ? x : 1.0, &s, &ds, &dds);
    for (unsigned j = 0; j < h->ref.joints; j++) {
        double from = (double)h->from_q24[j], d = (double)h->ref.q[j].raw - from;
        h->in.q_ref[j].raw = to_fixed(from + d * s, 1.0);
        h->in.v_ref[j].raw = to_fixed(d * ds / h->approach_s, 1.0);
        h->in.a_ref[j].raw = to_fixed(d * dds / (h->approach_s * h->approach_s), 1.0 / 256.0);
    }
}

static void reference_sample(struct drv_host *h, unsigned k, int moving)
{
    size_t at = (size_t)k * h->ref.joints;
    for (unsigned j = 0; j < h->ref.joints; j++) {
        h->in.q_ref[j] = h->ref.q[at + j];
        h->in.v_ref[j].raw = moving ? h->ref.v[at + j].raw : 0;
        h->in.a_ref[j].raw = moving ? h->ref.a[at + j].raw : 0;
    }
}

/* Set mode and reference of this period; the phases that end do so here. */
static void prepare(struct drv_host *h, uint64_t t_us)
{
    if (h->phase == DRV_HOST_STARTING && (h->seen & h->ref.active) == h->ref.active) {
        plan_approach(h);
        enter(h, DRV_HOST_APPROACH, t_us);
    } else if (h->phase == DRV_HOST_STARTING && phase_s(h, t_us) > h->cfg.answer_s) {
        enter(h, DRV_HOST_SILENT, t_us);
    }
    if (h->phase == DRV_HOST_APPROACH && phase_s(h, t_us) >= h->approach_s)
        enter(h, DRV_HOST_RUN, t_us);
    if (h->phase == DRV_HOST_RUN && h->sample >= h->ref.samples)
        enter(h, DRV_HOST_SETTLE, t_us);
    if (h->phase == DRV_HOST_SETTLE && phase_s(h, t_us) >= h->cfg.settle_s)
        enter(h, DRV_HOST_DONE, t_us);

    h->in.mode = h->cfg.mode;
    switch (h->phase) {
    case DRV_HOST_APPROACH:
        reference_approach(h, t_us);
        break;
    case DRV_HOST_RUN:
        reference_sample(h, h->sample++, 1);
        break;
    case DRV_HOST_SETTLE:
        reference_sample(h, h->ref.samples - 1, 0);
        break;
    default:
        /* not driving: the reference follows the arm, so that nothing jumps later */
        h->in.mode = HDT_MODE_IDLE;
        memcpy(h->in.q_ref, h->out.q, sizeof h->in.q_ref);
        memset(h->in.v_ref, 0, sizeof h->in.v_ref);
        memset(h->in.a_ref, 0, sizeof h->in.a_ref);
    }
}

enum drv_host_phase drv_host_period(struct drv_host *h, uint64_t t_us)
{
    if (h->t0_us == 0) {
        h->t0_us = t_us;
        h->phase_us = t_us;
    }
    prepare(h, t_us);
    if (h->phase == DRV_HOST_DONE || h->phase == DRV_HOST_SILENT || h->phase == DRV_HOST_FAULT) {
        (void)drv_cycle_end(&h->cycle);
        return h->phase;
    }
    h->in.t_us = t_us;
    (void)drv_cycle_period(&h->cycle, &h->in, &h->out);
    h->seen |= h->in.fresh;
    if (h->out.fault != 0)
        enter(h, DRV_HOST_FAULT, t_us);
    return h->phase;
}

void drv_host_stop(struct drv_host *h)
{
    if (h->phase != DRV_HOST_FAULT && h->phase != DRV_HOST_SILENT)
        h->phase = DRV_HOST_DONE;
}

const char *drv_host_phase_str(enum drv_host_phase phase)
{
    static const char *const name[] = { "starting", "approach", "run", "settle",
                                        "done", "fault", "silent" };
    return (unsigned)phase < sizeof name / sizeof name[0] ? name[phase] : "unknown";
}
