/* SPDX-License-Identifier: Apache-2.0 */
/*
 * From the cycle to a file without the cycle ever waiting: a single-producer single-consumer ring
 * of records, and a writer that drains it to CSV and to an LCM event log.
 *
 * Owns: the ring, the record, the two log formats (docs/formats.md).
 * Never: blocks the producer: a full ring drops the record and counts it.
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

/* Everything one period saw and did: enough to replay it. */
struct drv_record {
    struct hdt_in in;
    struct hdt_out out;
    int16_t torque_dig[HDT_JOINTS_MAX]; /* measured motor torque, as the servo reported it */
    uint16_t status[HDT_JOINTS_MAX];
    uint16_t driver_status;
    uint16_t link;                      /* enum drv_link */
};

/* Capacity is a power of two, at most 2^24; memory is the caller's.  A record is some 2 KB: a second
 * at 700 Hz takes 1024 of them. */
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

/* Writer.  path ends in .csv or .lcm; the file is written under a temporary name and takes its own
 * name in drv_writer_close, so nobody reads half a log. */
struct drv_writer;
struct drv_writer_cfg {
    const struct hdt_tables *tables;
    double ratio[HDT_JOINTS_MAX];       /* gear ratio, for output-side torque in the CSV */
    const char *const *constants;       /* "key = value" lines for the CSV head, NULL-ended; may be NULL */
    int terms;                          /* CSV: also a column per term and joint, <term>{j}_nm */
};
/* Errors: NULL and a line in err.  Context: not in the cycle. */
struct drv_writer *drv_writer_open(const char *path, const struct drv_writer_cfg *cfg, char *err,
                                   size_t errlen);
int drv_writer_put(struct drv_writer *w, const struct drv_record *rec);
/* 0, or negative and the temporary file is removed.  keep = 0 discards. */
int drv_writer_close(struct drv_writer *w, int keep);

#ifdef __cplusplus
}
#endif
#endif
