/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The last periods before a fault, as a log that replays.
 *
 *   every period: drv_dump_note   ->   a fault latches: nothing more is taken   ->   drv_dump_write
 *
 * A log that begins within a run replays only from the core's state, so that is kept too, every half
 * of the capacity; a dump begins at the older of the two states and holds between half of the
 * capacity and all of it (less when the run is shorter).
 *
 * Owns: which periods are kept.
 * Never: allocates, blocks; only drv_dump_write, after the run, touches a file.
 */
#ifndef DRV_DUMP_H
#define DRV_DUMP_H

#include "driver/drv_log.h"

#ifdef __cplusplus
extern "C" {
#endif

struct drv_dump {
    struct drv_record *slot;
    unsigned count;
    uint64_t seen;         /* periods noted */
    hdt_t start[2];        /* the core after 0, 1, 2 ... halves of the capacity; the newest two */
    int full;              /* a fault has latched */
};

/* Memory for the records is the caller's; count is even and at least 2.  core: before the first period.
 * Errors: HDT_ERR_ARG.  Context: start-up. */
int drv_dump_init(struct drv_dump *d, struct drv_record *slots, unsigned count, const hdt_t *core);
/* A period that is done.  The one in which a fault latched is the last one kept.
 * Context: control thread; copies a record, now and then a state. */
void drv_dump_note(struct drv_dump *d, const struct drv_record *rec, const hdt_t *core);
/* To an event log, path ending in .lcm; cfg as for drv_writer_open, its state is set here.
 * 0, or -1 and a line in err.  Context: not in the cycle; nothing is noted at the same time. */
int drv_dump_write(const struct drv_dump *d, const char *path, const struct drv_writer_cfg *cfg, char *err,
                   size_t errlen);

#ifdef __cplusplus
}
#endif
#endif
