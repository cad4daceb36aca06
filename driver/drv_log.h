/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From the cycle to a file without the cycle ever waiting: a single-producer single-consumer ring
 * of records, a writer that takes them to CSV or to an LCM event log, and a reader of the latter.
 *
 * The event log keeps every period's input, and its output but the observed velocity (hdt_out.v_obs), bit
 * for bit: it replays, and what the observer does shows in the torques.  The CSV is a table of
 * measurements: a period without a fresh state has no row.
 *
 * Owns: the ring, the record, the two log formats (docs/formats.md, section Log).
 * Never: blocks the producer: a full ring drops the record and the cycle counts it.
 */
#ifndef DRV_LOG_H
#define DRV_LOG_H

#include <stddef.h>
#include <stdint.h>

#include "ctrl/hdt.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DRV_LOG_VERSION 1

#define DRV_LOG_NONE (-100)
#define DRV_LOG_OTHER_BUILD (-101)
#define DRV_LOG_DAMAGED (-102)

/* Everything one period saw and did: enough to replay it. */
struct drv_record {
    struct hdt_in in;
    struct hdt_out out;
    int16_t torque_dig[HDT_JOINTS_MAX]; /* measured motor torque, as the servo reported it */
    uint16_t status[HDT_JOINTS_MAX];
    uint16_t driver_status;
    uint16_t link;                      /* enum drv_link */
};

/* Capacity is a power of two, at most 2^24; memory is the caller's.  A record is some 1.5 KB; a
 * second at 700 Hz takes 1024 of them. */
struct drv_ring {
    struct drv_record *slot;
    unsigned mask;
    unsigned head, tail; /* head written by the producer, tail by the consumer; acquire/release */
};

int drv_ring_init(struct drv_ring *r, struct drv_record *slots, unsigned count);
/* Producer.  Returns 0, or -1 when full (record dropped).  Wait-free. */
int drv_ring_push(struct drv_ring *r, const struct drv_record *rec);
/* Consumer.  Returns 1 and a record, or 0 when empty.  Wait-free. */
int drv_ring_pop(struct drv_ring *r, struct drv_record *rec);

/* Writer.  path ends in .csv or .lcm; the file is written as PATH.part and takes its own name in
 * drv_writer_close, so nobody reads half a log.  One writer a path at a time. */
struct drv_writer;
struct drv_writer_cfg {
    const struct hdt_tables *tables;    /* must outlive the writer */
    double ratio[HDT_JOINTS_MAX];       /* gear ratio, for output-side torque in the CSV */
    const char *const *constants;       /* "key = value" lines about the run, NULL-ended, or NULL */
    int terms;                          /* CSV: also a column per term and joint, <term>{j}_nm */
    const hdt_t *state;                 /* event log that begins within a run: the core before the
                                         * first record; NULL: as hdt_init leaves it */
};
/* Errors: NULL and a line in err.  Context: not in the cycle. */
struct drv_writer *drv_writer_open(const char *path, const struct drv_writer_cfg *cfg, char *err,
                                   size_t errlen);
/* 0, or -errno of the first write that failed; nothing is written after that. */
int drv_writer_put(struct drv_writer *w, const struct drv_record *rec);
/* 0 and the log is in place, or -errno, no log, and what was at path before is untouched.
 * keep = 0 discards.  w is gone either way; NULL is left alone. */
int drv_writer_close(struct drv_writer *w, int keep);

/* What an event log says about its run. */
#define DRV_CONSTANTS_MAX 4096
struct drv_run {
    uint32_t version;                   /* DRV_LOG_VERSION */
    uint32_t table_layout;              /* HDT_TABLES_LAYOUT the core ran with */
    uint32_t period_ns;
    uint32_t terms;                     /* HDT_TERMS; 13 in logs of tables of layout 1 */
    uint32_t joints;
    char arm[32];
    uint8_t digest[32];                 /* of the model file */
    double ratio[HDT_JOINTS_MAX];
    char constants[DRV_CONSTANTS_MAX];  /* "key = value" lines, newline after each */
};

/* Reader of .lcm logs, for replay and conversion.  Any bytes are safe to open.
 * Errors of open: NULL and a line in err.  Context: not in the cycle. */
struct drv_reader;
struct drv_reader *drv_reader_open(const char *path, char *err, size_t errlen);
const struct drv_run *drv_reader_run(const struct drv_reader *r);
/* 1 and a record, 0 at the end, negative when the file is damaged: drv_reader_error says where. */
int drv_reader_next(struct drv_reader *r, struct drv_record *rec);
/* The tables the core ran with, checked.  HDT_TABLES_OK, an error of hdt_tables_read, or
 * DRV_LOG_NONE when the log has none (written by a version before they were in it). */
int drv_reader_tables(const struct drv_reader *r, struct hdt_tables *out);
/* The core before the first record, with these tables: as hdt_init leaves it unless the log begins
 * within a run.  HDT_OK, an error of hdt_init, DRV_LOG_OTHER_BUILD: the state is a copy of memory, and
 * the host that wrote it lays it out another way, or DRV_LOG_DAMAGED: no core's memory can be that,
 * drv_reader_error says why and no record is given.  *core is to be used after HDT_OK only. */
int drv_reader_start(struct drv_reader *r, const struct hdt_tables *tables, hdt_t *core);
const char *drv_reader_error(const struct drv_reader *r); /* "" while all is well */
void drv_reader_close(struct drv_reader *r);

#ifdef __cplusplus
}
#endif
#endif
