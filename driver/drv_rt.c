/* SPDX-License-Identifier: Apache-2.0 */
/* See drv_rt.h. */
#include "driver/drv_rt.h"

#include <errno.h>
#include <string.h>

#define SECOND_NS 1000000000u
#define FIRST_OCTAVE 10u  /* class 0 is all below 2^10 ns */

void drv_hist_add(struct drv_hist *h, uint64_t ns)
{
    unsigned octave = FIRST_OCTAVE, k = 0;
    while (octave < 34 && ns >> (octave + 1) != 0)
        octave++;
    if (ns >> 34 != 0)
        k = DRV_HIST_CLASSES - 1;
    else if (ns >> FIRST_OCTAVE != 0)
        k = 1 + 8 * (octave - FIRST_OCTAVE) + (unsigned)(ns >> (octave - 3) & 7u);
    h->in_class[k]++;
    h->n++;
    h->sum_ns += ns;
    if (ns > h->max_ns)
        h->max_ns = ns;
}

uint64_t drv_hist_edge(unsigned k)
{
    if (k == 0)
        return (uint64_t)1 << FIRST_OCTAVE;
    return (uint64_t)(8 + (k - 1) % 8 + 1) << (FIRST_OCTAVE + (k - 1) / 8 - 3);
}

uint64_t drv_hist_quantile(const struct drv_hist *h, double share)
{
    uint64_t below = 0;
    for (unsigned k = 0; k < DRV_HIST_CLASSES; k++) {
        below += h->in_class[k];
        if (below != 0 && (double)below >= share * (double)h->n) {
            uint64_t edge = drv_hist_edge(k);
            return k == DRV_HIST_CLASSES - 1 || edge > h->max_ns ? h->max_ns : edge;
        }
    }
    return h->max_ns;
}

int drv_rt_mail_take(struct drv_rt_mailbox *box, struct drv_rt_mail *mail)
{
    unsigned tail = __atomic_load_n(&box->tail, __ATOMIC_RELAXED);
    if (__atomic_load_n(&box->head, __ATOMIC_ACQUIRE) == tail)
        return 0;
    *mail = box->mail[tail % DRV_RT_MAILS];
    __atomic_store_n(&box->tail, tail + 1u, __ATOMIC_RELEASE);
    return 1;
}

/* keep: slots left free; the last one is for the snapshot at the end. */
static void post(struct drv_rt *rt, const struct drv_host *host, unsigned keep)
{
    struct drv_rt_mailbox *box = rt->box;
    unsigned head;
    if (box == NULL)
        return;
    head = __atomic_load_n(&box->head, __ATOMIC_RELAXED);
    if (head - __atomic_load_n(&box->tail, __ATOMIC_ACQUIRE) >= DRV_RT_MAILS - keep) {
        rt->timing.status_dropped++;
        return;
    }
    drv_host_report(host, &box->mail[head % DRV_RT_MAILS].host);
    box->mail[head % DRV_RT_MAILS].timing = rt->timing;
    __atomic_store_n(&box->head, head + 1u, __ATOMIC_RELEASE);
}

int drv_rt_init(struct drv_rt *rt, const struct drv_rt_cfg *cfg, const struct hdt_clock *clock,
                uint32_t period_ns, struct drv_rt_mailbox *box, unsigned mail_every)
{
    if (rt == NULL || cfg == NULL || clock == NULL || clock->now_ns == NULL ||
        clock->sleep_until_ns == NULL || period_ns == 0 || cfg->follow_lead_ns >= period_ns ||
        (box != NULL && mail_every == 0))
        return HDT_ERR_ARG;
    memset(rt, 0, sizeof *rt);
    rt->cfg = *cfg;
    rt->clock = *clock;
    rt->period_ns = period_ns;
    rt->box = box;
    rt->mail_every = mail_every;
    return HDT_OK;
}

/* How much later than on the own grid the next period is to start: the share of a period at most, and
 * nothing when the awaited telegram has not come, or not said when. */
static int64_t follow(struct drv_rt *rt, const struct drv_host *host)
{
    const int64_t period = rt->period_ns, most = period / DRV_RT_FOLLOW_SHARE;
    const uint64_t received = host->cycle.count.received;
    struct hdt_bus_health h;
    hdt_bus_get_health(&host->cycle.bus, &h);
    const int heard = received != rt->received && h.received_ns != 0;
    rt->received = received;
    if (!heard) {
        rt->timing.unheard++;
        return 0;
    }
    /* to the nearest start that is the lead before the telegram, which came before this start, or whole
     * periods from there */
    int64_t late = (int64_t)(h.received_ns - rt->cfg.follow_lead_ns - rt->next_ns) % period;
    if (late < -(period / 2))
        late += period;
    return late > most ? most : late < -most ? -most : late;
}

/* When the period after the one that was due at next_ns is due. */
static uint64_t due_after(struct drv_rt *rt, const struct drv_host *host)
{
    const uint64_t own = rt->next_ns + rt->period_ns;
    return rt->cfg.follow_lead_ns == 0 ? own : own + (uint64_t)follow(rt, host);
}

static int sleep_until(struct drv_rt *rt, uint64_t t_ns)
{
    int e;
    do
        e = rt->clock.sleep_until_ns(rt->clock.ctx, t_ns);
    while (e == -EINTR);
    return e;
}

/* Periods that are over before this one starts are skipped, counted, and dealt with. */
static void skip_missed(struct drv_rt *rt, struct drv_host *host, uint64_t now)
{
    uint64_t missed = now > rt->next_ns ? (now - rt->next_ns) / rt->period_ns : 0;
    if (now - rt->second_ns >= SECOND_NS) {
        rt->second_ns = now;
        rt->missed_second = 0;
    }
    if (missed == 0)
        return;
    rt->next_ns += missed * rt->period_ns;
    rt->timing.missed += missed;
    rt->missed_second += (unsigned)missed;
    if (rt->missed_second <= rt->cfg.overrun_limit || rt->cfg.overrun == DRV_OVERRUN_COUNT)
        return;
    drv_host_ask(host, rt->cfg.overrun == DRV_OVERRUN_HOLD ? DRV_HOST_ASK_HOLD_LATE : DRV_HOST_ASK_STOP_LATE);
}

int drv_rt_run(struct drv_rt *rt, struct drv_host *host)
{
    int broken = 0;
    rt->next_ns = rt->second_ns = rt->clock.now_ns(rt->clock.ctx);
    rt->next_ns += rt->period_ns;
    while (host->phase < DRV_HOST_DONE) {
        int e = sleep_until(rt, rt->next_ns);
        if (e != 0 && broken == 0) {
            broken = e;
            drv_host_stop(host);
        }
        uint64_t start = rt->clock.now_ns(rt->clock.ctx);
        drv_hist_add(&rt->timing.wake, start > rt->next_ns ? start - rt->next_ns : 0);
        skip_missed(rt, host, start);
        (void)drv_host_period(host, start / 1000u);
        drv_hist_add(&rt->timing.work, rt->clock.now_ns(rt->clock.ctx) - start);
        if (rt->box != NULL && rt->to_mail-- == 0) {
            rt->to_mail = rt->mail_every - 1;
            post(rt, host, 1);
        }
        rt->next_ns = due_after(rt, host);
    }
    post(rt, host, 0);
    return broken;
}
