/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One control period: receive what came, step the core, send the command, hand a record on.
 *
 *   tick k:  recv reply to command k-1  ->  hdt_step  ->  send command k  ->  record
 *
 * The state used at tick k is therefore at most one period old and nothing in the period waits.
 *
 * Owns: the order of a period, the sequence number, the counters.
 * Never: sleeps, allocates, blocks, writes files.  Time is an argument; the caller owns the clock.
 */
#ifndef DRV_CYCLE_H
#define DRV_CYCLE_H

#include "ctrl/hdt.h"
#include "driver/drv_log.h"
#include "driver/drv_telegram.h"
#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where the link to the servo stands. */
enum drv_link {
    DRV_LINK_STARTING, /* 'S' sent, no answer yet    */
    DRV_LINK_RUNNING,  /* cyclic telegrams           */
    DRV_LINK_ENDED     /* 'E' sent                   */
};

/* Counters are ordinary output: copy them out whenever. */
struct drv_counters {
    uint64_t periods, received, lost, bad_frames, wrong_seq, send_dropped, bus_down, log_dropped;
};

struct drv_cycle {
    hdt_t core;
    struct hdt_bus bus;
    struct drv_ring *ring;          /* may be NULL: no log */
    enum drv_link link;
    uint8_t seq;
    uint8_t want_seq;               /* of the reply awaited */
    struct drv_state last;          /* last good state telegram */
    struct drv_counters count;
};

/* What the caller wants this period, in the core's words; counts, fresh and servo_alarm are filled
 * in by the cycle. */
int drv_cycle_init(struct drv_cycle *c, const struct hdt_tables *t, const struct hdt_bus *bus,
                   struct drv_ring *ring);
int drv_cycle_period(struct drv_cycle *c, struct hdt_in *in, struct hdt_out *out);
/* Send 'E': brakes on.  May be called at any time, more than once. */
int drv_cycle_end(struct drv_cycle *c);

#ifdef __cplusplus
}
#endif
#endif
