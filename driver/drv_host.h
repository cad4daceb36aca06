/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A host's run over one prepared reference: connect, approach, follow, end.
 *
 *   STARTING --first state of all active joints--> APPROACH --at the start--> RUN --done--> SETTLE
 *   SETTLE --> DONE ('E' sent, brakes on);  any core fault --> FAULT (brakes on)
 *
 * Owns: the phases, the reference samples handed to the cycle.
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
    DRV_HOST_STARTING,
    DRV_HOST_APPROACH,
    DRV_HOST_RUN,
    DRV_HOST_SETTLE,
    DRV_HOST_DONE,
    DRV_HOST_FAULT,
    DRV_HOST_SILENT               /* the servo never answered */
};

struct drv_host_cfg {
    uint32_t mode;                /* HDT_MODE_TORQUE or HDT_MODE_VELOCITY */
    double approach_radps;        /* peak speed of the approach, output side; 0: 0.25 */
    double settle_s;              /* held at the end before 'E' */
    double answer_s;              /* wait this long for the servo's first answer; 0: 2 */
};

struct drv_host {
    struct drv_cycle cycle;
    struct drv_reference ref;
    struct drv_host_cfg cfg;
    enum drv_host_phase phase;
    uint64_t t0_us, phase_us;     /* first period; start of this phase */
    unsigned sample;
    uint32_t seen;                /* bit per joint: has reported a position */
    int32_t from_q24[HDT_JOINTS_MAX];
    double approach_s;
    struct hdt_in in;             /* of the last period */
    struct hdt_out out;
};

/* Every period is recorded, so that the log replays from its first record.
 * Errors: HDT_ERR_ARG, HDT_ERR_TABLES.  Context: start-up. */
int drv_host_init(struct drv_host *h, const struct hdt_tables *t, const struct hdt_bus *bus,
                  struct drv_ring *ring, const struct drv_reference *ref, const struct drv_host_cfg *cfg);

/* One period at host time t_us.  Returns the phase after it.  Context: control thread. */
enum drv_host_phase drv_host_period(struct drv_host *h, uint64_t t_us);

/* Ask for an orderly end at the next period (Ctrl-C): brakes on, 'E'. */
void drv_host_stop(struct drv_host *h);

const char *drv_host_phase_str(enum drv_host_phase phase);

#ifdef __cplusplus
}
#endif
#endif
