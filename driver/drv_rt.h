/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The real-time thread around a host: what it asks of the system, when it wakes, what its latencies were.
 *
 * One timing rule: periods start at multiples of the period on the monotonic clock, t0 + k period.
 * A wake-up that comes after the next period has begun skips the periods it missed: none is run
 * twice in a row to catch up.  With follow_lead_ns the servo's clock is followed, where it answers at
 * ticks of its own: periods are drawn to start follow_lead before its telegrams come in, each longer or
 * shorter than the period by a share (DRV_RT_FOLLOW_SHARE) at most, so that nothing on the bus can set
 * the rate; where none came the own clock goes on.
 *
 * Owns: the loop, its counts and histograms, what is done about missed periods.
 * Never: in drv_rt_run: allocates, locks, prints, waits for anything but the next period.
 */
#ifndef DRV_RT_H
#define DRV_RT_H

#include <stddef.h>
#include <stdint.h>

#include "driver/drv_host.h"
#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Times in ns by size: eight classes an octave, from below 1024 ns to above 2^34 ns (17 s). */
#define DRV_HIST_CLASSES 194
struct drv_hist {
    uint64_t n, sum_ns, max_ns;
    uint32_t in_class[DRV_HIST_CLASSES];
};
/* Wait-free; any size goes into a class. */
void drv_hist_add(struct drv_hist *h, uint64_t ns);
/* Upper edge of the class that holds this share (0..1) of all, and never above max_ns; 0 when empty.
 * At most an eighth too large. */
uint64_t drv_hist_quantile(const struct drv_hist *h, double share);
/* Upper edge of a class, ns. */
uint64_t drv_hist_edge(unsigned k);

/* What is done when more than overrun_limit periods were missed within a second. */
enum drv_overrun {
    DRV_OVERRUN_COUNT,    /* nothing: they are counted */
    DRV_OVERRUN_HOLD,     /* the arm comes to a hold   */
    DRV_OVERRUN_STOP      /* brakes on, 'E'            */
};

struct drv_rt_cfg {
    enum drv_overrun overrun;
    unsigned overrun_limit;      /* periods missed within a second that are let pass */
    uint32_t follow_lead_ns;     /* 0: own clock; else follow the servo's; less than the period */
};

/* Following, a period differs from the tables' by one part in so many at most: ten times what two quartz
 * clocks do, and half a period is made up within 250. */
#define DRV_RT_FOLLOW_SHARE 500

struct drv_timing {
    uint64_t missed;             /* periods that were skipped, since start            */
    uint64_t unheard;            /* following: periods without the awaited telegram, or without a
                                  * time it came (hdt_bus_health.received_ns)         */
    uint64_t status_dropped;     /* snapshots the mailbox had no room for             */
    struct drv_hist wake;        /* start of a period after it was due                */
    struct drv_hist work;        /* from start to end of a period's work              */
};

/* Snapshots from the control thread to others, a few a second; a full mailbox drops and counts.  One
 * place is kept for the snapshot at the end, which is never dropped. */
#define DRV_RT_MAILS 8
struct drv_rt_mail {
    struct drv_host_status host;
    struct drv_timing timing;
};
struct drv_rt_mailbox {
    struct drv_rt_mail mail[DRV_RT_MAILS];
    unsigned head, tail;
};
/* Consumer.  1 and a snapshot, or 0.  Wait-free. */
int drv_rt_mail_take(struct drv_rt_mailbox *box, struct drv_rt_mail *mail);

struct drv_rt {
    struct drv_rt_cfg cfg;
    struct hdt_clock clock;
    uint32_t period_ns;
    uint64_t next_ns;
    uint64_t second_ns;          /* start of the second that missed_second counts in */
    unsigned missed_second;
    uint64_t received;           /* replies of the servo by the last period, following */
    struct drv_timing timing;
    struct drv_rt_mailbox *box;  /* may be NULL */
    unsigned mail_every, to_mail;
};

/* Errors: HDT_ERR_ARG.  box gets a snapshot every mail_every periods, and one at the end.
 * Context: start-up. */
int drv_rt_init(struct drv_rt *rt, const struct drv_rt_cfg *cfg, const struct hdt_clock *clock,
                uint32_t period_ns, struct drv_rt_mailbox *box, unsigned mail_every);

/* Periods of this host until it is over.  Errors: -errno of the clock (never -EINTR): the host is
 * then ended in the same way.  Context: control thread. */
int drv_rt_run(struct drv_rt *rt, struct drv_host *host);

/* What the calling thread asks of the system before its loop. */
struct drv_rt_wish {
    int priority;                /* SCHED_FIFO; 0: as it is */
    int cpu;                     /* from 0; -1: any */
    int lock_memory;             /* mlockall, present and future */
};
/* Every wish that can be had, and the stack touched so that it is in memory; what cannot be had is
 * said in line, one clause each with the remedy.  Returns how many were refused.
 * Context: the thread itself, start-up. */
int drv_rt_enter(const struct drv_rt_wish *wish, char *line, size_t len);

#ifdef __cplusplus
}
#endif
#endif
