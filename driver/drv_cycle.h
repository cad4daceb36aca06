/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One control period: receive what came, step the core, send the command, hand a record on.
 *
 *   tick k:  recv reply to command k-1  ->  hdt_step  ->  send command k  ->  record
 *
 * The state used at tick k is therefore at most one period old and nothing in the period waits.
 *
 * Owns: the order of a period, the sequence number, the counters, the state of the link.
 * Never: sleeps, allocates, blocks, writes files.  Time is an argument; the caller owns the clock.
 */
#ifndef DRV_CYCLE_H
#define DRV_CYCLE_H

#include "ctrl/hdt.h"
#include "driver/drv_dump.h"
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

/* An 'S', 'A' or 'E' is given up, and the next one sent, after this many periods without an answer; the
 * answer to a 'C' comes within one. */
#define DRV_CYCLE_RETRY 10
/* An axis told servo-on that still reports power off or uncontrollable after this long is in alarm.
 * Not at once: the reply to the command that switches on is of the moment before, and a power stage and
 * its brake take some tens of ms; no source says how long this driver's do. */
#define DRV_CYCLE_ON_MS 50
/* Frames looked at in one period; more than a peer can have answered, so that a flood cannot hold
 * the period up. */
#define DRV_CYCLE_DRAIN 32

/* Counters are ordinary output: copy them out whenever.
 * Every reply awaited is in the end one of received or lost. */
struct drv_counters {
    uint64_t periods;      /* calls of drv_cycle_period that did their work                   */
    uint64_t received;     /* replies of the awaited sequence and type                        */
    uint64_t lost;         /* replies that had not come one period later                      */
    uint64_t bad_frames;   /* no telegram of this format                                      */
    uint64_t wrong_seq;    /* good telegrams nobody awaited: late, doubled, foreign           */
    uint64_t send_dropped; /* commands the bus did not take                                   */
    uint64_t bus_down;     /* periods in which the bus reported its peer gone                 */
    uint64_t log_dropped;  /* records the ring had no room for                                */
};

struct drv_cycle {
    hdt_t core;
    struct hdt_bus bus;
    enum drv_format format;         /* of the telegrams; A unless drv_cycle_set_format says otherwise */
    uint16_t rated_mnm[DRV_AXES];   /* Format B: rated motor torque, 0.001 N.m motor side */
    struct drv_ring *ring;          /* may be NULL: no log; may be set between periods */
    struct drv_dump *dump;          /* the same: what is kept for when a fault latches */
    enum drv_link link;
    uint8_t seq;                    /* of the last command sent, 0..127 */
    uint8_t want_seq;               /* of the reply awaited */
    uint8_t want_type;              /* enum drv_type of the reply awaited; 0: none */
    unsigned patience;              /* periods until the reply awaited counts as lost */
    unsigned ask_again;             /* periods until 'S' or 'E' is sent again; 0 or 1: at the next */
    uint32_t alarms;                /* bit per axis: its alarm is to be cleared before 'S' */
    int started;                    /* a state has arrived since init or restart         */
    int in_step;                    /* a state has arrived since the link was last up    */
    int end_answered;
    uint32_t told_on;               /* bit per axis: told servo-on by the command awaiting its reply */
    uint32_t unpowered;             /* bit per axis: told servo-on for DRV_CYCLE_ON_MS and still off */
    unsigned off[DRV_AXES];         /* replies in a row by which it was so far */
    struct drv_state last;          /* last good state telegram, torque in 0.001 N.m digits */
    struct drv_counters count;
    struct drv_record rec;          /* of this period; too large for a real-time stack */
};

/* Start with these tables on this bus; the first period asks the servo for control mode ('S').
 * Errors: HDT_ERR_ARG (also: more joints than the telegram has axes), HDT_ERR_TABLES.
 * Context: start-up. */
int drv_cycle_init(struct drv_cycle *c, const struct hdt_tables *t, const struct hdt_bus *bus,
                   struct drv_ring *ring);

/* Speak this format from the next period on.  rated_mnm: rated torque of each joint's motor,
 * 0.001 N.m motor side, which Format B's torque words count in; with Format A it may be NULL.
 * The core, the record and `last` have digits of 0.001 N.m in both formats: the conversion is exact,
 * rounded half to even, but towards zero where a command would be beyond dig_max, and saturates at the
 * ends of a word.  In Format B a driven axis also stops on an alarm of another (DRV_AXIS_STOP_ALL), as
 * in Format A every axis does.
 * Errors: HDT_ERR_ARG (no such format; Format B and a joint without rated torque), nothing changed.
 * Context: start-up, after drv_cycle_init and before the first period. */
int drv_cycle_set_format(struct drv_cycle *c, enum drv_format format, const uint16_t *rated_mnm);

/* One period.  `in` says what the caller wants, in the core's words; its count, count_us,
 * fresh and servo_alarm are filled in here, the rest is left as it is.
 *
 * What an axis is told:
 *   driven (in.active), torque mode     servo on, torque mode, digits
 *   driven, velocity mode               servo on, speed mode, speed words
 *   not driven, or idle mode            brake on, zero
 *   any core fault                      brake on, zero, every axis: brakes hold an arm against
 *                                       gravity better than a controller just declared wrong
 *
 * What the core is told differs from what the caller says in two cases, both in the record:
 * - until the servo's first state after init or restart no joint is active, so a servo slow to
 *   start is not a stale one;
 * - from a broken link until the first state after it the mode is idle.  Joints stay active, so the
 *   core's stale fault latches when that takes too long.
 * servo_alarm comes with fresh states only: an alarm seen once is latched by the core, and an old
 * one does not outlive drv_cycle_restart.  It is set
 * - for a joint whose axis reports an alarm;
 * - for every joint when the driver reports one, or an axis that is not driven: the servo stops them all;
 * - for a joint told servo-on whose axis still reports power off or uncontrollable after
 *   DRV_CYCLE_ON_MS (`unpowered`): the servo has left control mode, and says so in no other way.
 *
 * Errors: of hdt_step; then every axis is told brake on, zero, and no record is made.  What the bus
 * does is no error but a counter, since the period has to go on.
 * Context: control thread; no allocation, no lock, non-blocking. */
int drv_cycle_period(struct drv_cycle *c, struct hdt_in *in, struct hdt_out *out);

/* Send 'E': brakes on.  May be called at any time, more than once.  Further periods send nothing
 * but 'E', until it is answered; the core then drives no joint.
 * Errors: of the bus. */
int drv_cycle_end(struct drv_cycle *c);

/* Has the servo answered 'E': are the brakes on?  Receives what has come since; 0 before drv_cycle_end.
 * Context: control thread, or after it has ended; non-blocking. */
int drv_cycle_ended(struct drv_cycle *c);

/* Ask for control mode again, after drv_cycle_end or after the servo left it (its watchdog or an
 * alarm).  Each axis that last reported an alarm is sent an 'A' before, once: an older driver has no
 * 'A' and does not answer, and what is still wrong comes back with the next state.
 * Latched core faults stay; hdt_clear(&c->core) is the caller's decision.
 * Context: between periods. */
void drv_cycle_restart(struct drv_cycle *c);

const char *drv_link_str(enum drv_link link);

#ifdef __cplusplus
}
#endif
#endif
