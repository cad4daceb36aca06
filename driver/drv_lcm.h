/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Bytes of an LCM event log: the event header and the two messages of hdt_cycle.lcm.
 *
 * Owns: the byte layout, shared by writer and reader.  Not installed: hosts use drv_log.h.
 * Never: does I/O, allocates.
 */
#ifndef DRV_LCM_H
#define DRV_LCM_H

#include "driver/drv_log.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DRV_LCM_MAGIC 0xeda1da01u
#define DRV_LCM_HEAD 28           /* magic, number, time stamp, two lengths */
#define DRV_LCM_CHANNEL_MAX 63    /* LCM's own limit */
#define DRV_LCM_DATA_MAX 8192     /* more than either message takes */
#define DRV_LCM_CHANNEL_RUN "HDT_RUN"
#define DRV_LCM_CHANNEL_CYCLE "HDT_CYCLE"
/* Bytes as they are, no LCM type; a reader that does not know the channel passes over them. */
#define DRV_LCM_CHANNEL_TABLES "HDT_TABLES" /* .hdtm image of the tables */
#define DRV_LCM_CHANNEL_STATE "HDT_STATE"   /* struct drv_lcm_state */
#define DRV_LCM_TABLES_MAX 131072           /* more than an image of 16 joints takes */

/* The core's memory, and what has to be the same for it to mean the same elsewhere. */
struct drv_lcm_state {
    uint32_t order;               /* DRV_LCM_ORDER in the byte order of the writer */
    uint32_t version;             /* of the library: major, minor, patch, a byte each */
    uint32_t layout;              /* of the tables */
    uint32_t size;                /* of hdt_t */
    hdt_t core;                   /* its pointer to the tables is zero */
};
#define DRV_LCM_ORDER 0x48445401u
#define DRV_LCM_LIBRARY (HDT_VERSION_MAJOR << 16 | HDT_VERSION_MINOR << 8 | HDT_VERSION_PATCH)

/* Can this be the memory of a core that began as `fresh`, by hdt_init, and ran?  A core that is not would
 * overflow.  0, or -1 and one line in err: which member, and its bounds. */
int drv_lcm_check_core(const hdt_t *core, const hdt_t *fresh, char *err, size_t errlen);

struct drv_lcm_head {
    uint32_t magic;
    uint64_t number;              /* of the event, from 0 */
    uint64_t t_us;
    uint32_t channel_len, data_len;
};

void drv_lcm_put_head(const struct drv_lcm_head *h, uint8_t buf[DRV_LCM_HEAD]);
void drv_lcm_get_head(const uint8_t buf[DRV_LCM_HEAD], struct drv_lcm_head *h);

/* Bytes written, or 0 when cap is too small. */
size_t drv_lcm_put_run(const struct drv_run *run, uint8_t *buf, size_t cap);
size_t drv_lcm_put_record(const struct drv_record *rec, unsigned joints, uint8_t *buf, size_t cap);

enum drv_lcm_err {
    DRV_LCM_OK = 0,
    DRV_LCM_TYPE = -1,    /* another message type */
    DRV_LCM_VERSION = -2, /* our message, another version: in run->version */
    DRV_LCM_DAMAGED = -3  /* a length or a count that cannot be */
};
/* Errors: enum drv_lcm_err; the output is then not to be used. */
int drv_lcm_get_run(const uint8_t *buf, size_t len, struct drv_run *run);
/* joints and terms as the run says; terms the log does not have are zero. */
int drv_lcm_get_record(const uint8_t *buf, size_t len, unsigned joints, uint32_t terms,
                       struct drv_record *rec);

/* Logs that ran with tables of layout 1 have this many terms: neither local nor table. */
#define DRV_LCM_TERMS_LAYOUT_1 13
/* Is it known which terms a log with that many has? */
int drv_lcm_terms_known(uint32_t terms);

#ifdef __cplusplus
}
#endif
#endif
