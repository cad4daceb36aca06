/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A bus that breaks on purpose, at chosen calls: wraps any other bus.  For tests.
 *
 * Owns: which calls break, and how.
 * Never: allocates; the memory is the caller's.
 */
#ifndef BROKEN_BUS_H
#define BROKEN_BUS_H

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

enum broken_bus_mode {
    BROKEN_BUS_DROP,      /* the frame vanishes; a send says ok, a receive says there was none */
    BROKEN_BUS_AGAIN,     /* HDT_BUS_ERR_AGAIN; a frame waiting keeps waiting                 */
    BROKEN_BUS_DOWN,      /* HDT_BUS_ERR_DOWN, as above                                       */
    BROKEN_BUS_CORRUPT,   /* one byte changed: data[at % len] ^= flip                         */
    BROKEN_BUS_DUPLICATE, /* the frame comes twice                                            */
    BROKEN_BUS_TRUNCATE,  /* the frame is cut to at % len bytes, at least 1                   */
    BROKEN_BUS_MODES
};

struct broken_bus_cfg {
    enum broken_bus_mode mode;
    unsigned nth;        /* first call that breaks, from 1; sends and receives count together */
    unsigned calls;      /* how many break from there on; 0: 1 */
    unsigned at;         /* for corrupt and truncate */
    uint8_t flip;        /* for corrupt; 0: 0xff */
};

struct broken_bus {
    struct hdt_bus good;
    struct broken_bus_cfg cfg;
    unsigned called;     /* calls so far */
    unsigned hits;       /* calls that did break something */
    struct hdt_frame again;
    int has_again;       /* the receive to come gets this */
};

/* bad is then the broken view of good; both stay the caller's, and closing bad closes nothing. */
void broken_bus_wrap(struct broken_bus *f, const struct broken_bus_cfg *cfg,
                    const struct hdt_bus *good, struct hdt_bus *bad);

#ifdef __cplusplus
}
#endif
#endif
