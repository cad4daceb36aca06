/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A bus that breaks on purpose, at chosen calls: wraps any other bus.  For tests.
 *
 * Owns: which calls break, and how.
 * Never: allocates; the memory is the caller's.
 */
#ifndef DRV_FAULT_H
#define DRV_FAULT_H

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

enum drv_fault_mode {
    DRV_FAULT_DROP,      /* the frame vanishes; a send says ok, a receive says there was none */
    DRV_FAULT_AGAIN,     /* HDT_BUS_ERR_AGAIN; a frame waiting keeps waiting                 */
    DRV_FAULT_DOWN,      /* HDT_BUS_ERR_DOWN, as above                                       */
    DRV_FAULT_CORRUPT,   /* one byte changed: data[at % len] ^= flip                         */
    DRV_FAULT_DUPLICATE, /* the frame comes twice                                            */
    DRV_FAULT_TRUNCATE,  /* the frame is cut to at % len bytes, at least 1                   */
    DRV_FAULT_MODES
};

struct drv_fault_cfg {
    enum drv_fault_mode mode;
    unsigned nth;        /* first call that breaks, from 1; sends and receives count together */
    unsigned calls;      /* how many break from there on; 0: 1 */
    unsigned at;         /* for corrupt and truncate */
    uint8_t flip;        /* for corrupt; 0: 0xff */
};

struct drv_fault {
    struct hdt_bus good;
    struct drv_fault_cfg cfg;
    unsigned called;     /* calls so far */
    unsigned hits;       /* calls that did break something */
    struct hdt_frame again;
    int has_again;       /* the receive to come gets this */
};

/* bad is then the broken view of good; both stay the caller's, and closing bad closes nothing. */
void drv_fault_wrap(struct drv_fault *f, const struct drv_fault_cfg *cfg,
                    const struct hdt_bus *good, struct hdt_bus *bad);

#ifdef __cplusplus
}
#endif
#endif
