/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A host's run over one prepared reference, as an operator sees it.
 *
 *   IDLE --a state of every active joint--> READY --go--> APPROACH --> RUN --end of reference--> HOLD
 *   APPROACH, RUN --hold--> HOLD --go--> where it was (after the end: from the start again)
 *   any --core fault--> FAULT --clear--> IDLE
 *   any --stop--> ENDING ('E' until answered: brakes on) --> DONE
 *
 * In IDLE, READY, FAULT and ENDING brakes are on; in HOLD the arm is held by torque, standing still.
 * Without an operator (cfg.operated = 0) READY goes by itself, HOLD becomes ENDING after settle_s of
 * standing still (nobody could say go), a fault ENDING and then FAULTED, and a servo that does not
 * answer SILENT.
 *
 * Owns: the phases, the reference samples handed to the cycle, why the host is where it is.
 * Never: sleeps, reads a clock, allocates; time is an argument, so the same run works in virtual
 * time and in a real-time thread.
 */
#ifndef DRV_HOST_H
#define DRV_HOST_H

#include "driver/drv_cycle.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Samples of a reference, one a period; the arrays are the caller's and hold samples * joints
 * values, joints fastest. */
struct drv_reference {
    unsigned samples, joints;
    uint32_t active;              /* bit per joint */
    const hdt_rad_t *q;
    const hdt_radps_t *v;
    const hdt_radps2_t *a;
};

enum drv_host_phase {
    DRV_HOST_IDLE,
    DRV_HOST_READY,
    DRV_HOST_APPROACH,
    DRV_HOST_RUN,
    DRV_HOST_HOLD,
    DRV_HOST_FAULT,
    DRV_HOST_ENDING,
    DRV_HOST_DONE,                /* from here on the run is over */
    DRV_HOST_FAULTED,
    DRV_HOST_SILENT               /* the servo never answered */
};

/* What an operator, a signal or the overrun policy asks for. */
enum drv_host_request {
    DRV_HOST_ASK_NOTHING,
    DRV_HOST_ASK_GO,              /* READY, HOLD                 */
    DRV_HOST_ASK_HOLD,            /* APPROACH, RUN               */
    DRV_HOST_ASK_HOLD_LATE,       /* the same, for periods missed */
    DRV_HOST_ASK_CLEAR,           /* FAULT                       */
    DRV_HOST_ASK_STOP,            /* always                      */
    DRV_HOST_ASK_STOP_LATE        /* the same, for periods missed */
};

struct drv_host_cfg {
    uint32_t mode;                /* HDT_MODE_TORQUE or HDT_MODE_VELOCITY */
    double approach_radps;        /* peak speed of the approach, output side; 0: 0.25 */
    double settle_s;              /* held standing still before 'E', where nobody operates */
    double answer_s;              /* wait this long for the servo's first answer; 0: 2 */
    double hold_s;                /* slow down to a hold, and up again, in this time; 0: 0.3 */
    int operated;                 /* READY and HOLD wait for drv_host_ask, FAULT for clear or stop */
};

/* What a latched fault looked like, for people. */
struct drv_host_fault {
    uint64_t t_us;                /* since the first period */
    uint32_t fault, joints;       /* enum hdt_fault; bit per joint */
    uint16_t status[DRV_AXES];    /* as the servo reported them */
    uint16_t driver_status;
    uint32_t unpowered;           /* bit per axis: told servo-on, yet reported off: drv_cycle */
    hdt_rad_t q_ref[HDT_JOINTS_MAX], q[HDT_JOINTS_MAX];
    hdt_radps_t v[HDT_JOINTS_MAX];
};

/* Where the host is: small, so that the control thread can copy it out. */
struct drv_host_status {
    uint64_t t_us;                /* since the first period */
    enum drv_host_phase phase;
    enum drv_host_request asked;      /* what brought it here, if anything did */
    enum drv_link link;
    unsigned sample, samples;
    uint32_t active, seen;        /* bit per joint */
    int end_confirmed;            /* the servo has answered 'E' */
    struct drv_host_fault fault;  /* of the last one */
    uint64_t errors;              /* periods that drv_cycle_period refused: nothing was driven in them */
    int error;                    /* why the last of these was, enum hdt_err; 0: none was */
    struct drv_counters count;
};

struct drv_host {
    struct drv_cycle cycle;
    struct drv_reference ref;
    struct drv_host_cfg cfg;
    enum drv_host_phase phase;
    enum drv_host_phase resume;   /* HOLD: what was going on                */
    enum drv_host_phase outcome;  /* ENDING: the phase from DRV_HOST_DONE on that comes then */
    enum drv_host_request asked;
    uint32_t requests;            /* bit per enum drv_host_request, set by any thread */
    uint64_t t0_us, t_us, phase_us; /* first period, this one, start of this phase */
    unsigned sample;
    uint32_t frac_q32;            /* way from sample to the next */
    uint64_t rate_q32;            /* reference time a period: 2^32 in motion, 0 at rest */
    double rate_slope;            /* its change a second, of 1 */
    uint32_t seen;                /* bit per joint: has reported a position */
    int32_t from_q24[HDT_JOINTS_MAX];
    double approach_s, approached_us;
    struct drv_host_fault fault;
    uint64_t errors;              /* periods refused */
    int error, last_error;        /* enum hdt_err: of the last period; of the last one refused */
    struct hdt_in in;             /* of the last period */
    struct hdt_out out;           /* the same; after an error q and v are still those measured last */
};

/* Every period is recorded, so that the log replays from its first record.
 * Errors: HDT_ERR_ARG (also: a reference of another arm, or one that drives a joint the arm has not),
 * HDT_ERR_TABLES.  Context: start-up. */
int drv_host_init(struct drv_host *h, const struct hdt_tables *t, const struct hdt_bus *bus,
                  struct drv_ring *ring, const struct drv_reference *ref, const struct drv_host_cfg *cfg);

/* One period at host time t_us, which must advance: a period the cycle refuses is counted, brakes every
 * axis and is no measurement, and a go waits for one that is not.  Returns the phase after it; from
 * DRV_HOST_DONE on the run is over and further calls do nothing.  Context: control thread. */
enum drv_host_phase drv_host_period(struct drv_host *h, uint64_t t_us);

/* Ask for something at the next period.  Of several asked for between two periods a stop comes first,
 * then a hold, which also drops a go, then the rest: none is overwritten.  What the phase then has no
 * use for is dropped.  Context: any thread. */
void drv_host_ask(struct drv_host *h, enum drv_host_request ask);

/* Ask for an orderly end at the next period (Ctrl-C): brakes on, 'E' until answered. */
void drv_host_stop(struct drv_host *h);

/* Copy out where the host is.  Context: control thread, between periods. */
void drv_host_report(const struct drv_host *h, struct drv_host_status *s);

/* One line for an operator: the phase, why, and what to do; joint, value and limit of a fault.
 * Context: any thread but the control thread. */
void drv_host_say(const struct drv_host_status *s, const struct hdt_tables *t, char *line, size_t len);

const char *drv_host_phase_str(enum drv_host_phase phase);

#ifdef __cplusplus
}
#endif
#endif
