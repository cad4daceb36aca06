/* SPDX-License-Identifier: Apache-2.0 */
/* See broken_bus.h. */
#include "tests/broken_bus.h"

#include <string.h>

/* Is this call one that breaks? */
static int due(struct broken_bus *f)
{
    unsigned n = ++f->called, first = f->cfg.nth, calls = f->cfg.calls ? f->cfg.calls : 1u;
    return n >= first && n - first < calls;
}

/* Corrupt or truncate in place; an empty frame has nothing to break. */
static void damage(struct broken_bus *f, struct hdt_frame *frame)
{
    if (frame->len == 0)
        return;
    unsigned at = f->cfg.at % frame->len;
    if (f->cfg.mode == BROKEN_BUS_CORRUPT)
        frame->data[at] ^= f->cfg.flip ? f->cfg.flip : 0xffu;
    else
        frame->len = (uint16_t)(at ? at : 1u);
}

static int fault_send(void *ctx, const struct hdt_frame *frame)
{
    struct broken_bus *f = ctx;
    struct hdt_frame copy;
    int e;
    if (!due(f))
        return f->good.send(f->good.ctx, frame);
    f->hits++;
    switch (f->cfg.mode) {
    case BROKEN_BUS_DROP:
        return HDT_BUS_OK;
    case BROKEN_BUS_AGAIN:
        return HDT_BUS_ERR_AGAIN;
    case BROKEN_BUS_DUPLICATE:
        e = f->good.send(f->good.ctx, frame);
        if (e == HDT_BUS_OK)
            (void)f->good.send(f->good.ctx, frame);
        return e;
    case BROKEN_BUS_CORRUPT:
    case BROKEN_BUS_TRUNCATE:
        copy = *frame;
        damage(f, &copy);
        return f->good.send(f->good.ctx, &copy);
    default:
        return HDT_BUS_ERR_DOWN;
    }
}

static int fault_recv(void *ctx, struct hdt_frame *frame)
{
    struct broken_bus *f = ctx;
    int broken = due(f), e;
    if (broken && (f->cfg.mode == BROKEN_BUS_AGAIN || f->cfg.mode == BROKEN_BUS_DOWN)) {
        f->hits++;
        return f->cfg.mode == BROKEN_BUS_AGAIN ? HDT_BUS_ERR_AGAIN : HDT_BUS_ERR_DOWN;
    }
    if (f->has_again) {
        f->has_again = 0;
        *frame = f->again;
        e = HDT_BUS_OK;
    } else {
        e = f->good.recv(f->good.ctx, frame);
    }
    if (!broken || e != HDT_BUS_OK)
        return e;
    f->hits++;
    if (f->cfg.mode == BROKEN_BUS_DROP)
        return HDT_BUS_ERR_AGAIN;
    if (f->cfg.mode == BROKEN_BUS_DUPLICATE) {
        f->again = *frame;
        f->has_again = 1;
    } else {
        damage(f, frame);
    }
    return e;
}

void broken_bus_wrap(struct broken_bus *f, const struct broken_bus_cfg *cfg,
                    const struct hdt_bus *good, struct hdt_bus *bad)
{
    memset(f, 0, sizeof *f);
    f->good = *good;
    f->cfg = *cfg;
    *bad = (struct hdt_bus){.ctx = f, .send = fault_send, .recv = fault_recv};
}
