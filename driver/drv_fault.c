/* SPDX-License-Identifier: Apache-2.0 */
/* See drv_fault.h. */
#include "driver/drv_fault.h"

#include <string.h>

/* Is this call one that breaks? */
static int due(struct drv_fault *f)
{
    unsigned n = ++f->called, first = f->cfg.nth, calls = f->cfg.calls ? f->cfg.calls : 1u;
    return n >= first && n - first < calls;
}

/* Corrupt or truncate in place; an empty frame has nothing to break. */
static void damage(struct drv_fault *f, struct hdt_frame *frame)
{
    if (frame->len == 0)
        return;
    unsigned at = f->cfg.at % frame->len;
    if (f->cfg.mode == DRV_FAULT_CORRUPT)
        frame->data[at] ^= f->cfg.flip ? f->cfg.flip : 0xffu;
    else
        frame->len = (uint16_t)(at ? at : 1u);
}

static int fault_send(void *ctx, const struct hdt_frame *frame)
{
    struct drv_fault *f = ctx;
    struct hdt_frame copy;
    int e;
    if (!due(f))
        return f->good.send(f->good.ctx, frame);
    f->hits++;
    switch (f->cfg.mode) {
    case DRV_FAULT_DROP:
        return HDT_BUS_OK;
    case DRV_FAULT_AGAIN:
        return HDT_BUS_ERR_AGAIN;
    case DRV_FAULT_DUPLICATE:
        e = f->good.send(f->good.ctx, frame);
        if (e == HDT_BUS_OK)
            (void)f->good.send(f->good.ctx, frame);
        return e;
    case DRV_FAULT_CORRUPT:
    case DRV_FAULT_TRUNCATE:
        copy = *frame;
        damage(f, &copy);
        return f->good.send(f->good.ctx, &copy);
    default:
        return HDT_BUS_ERR_DOWN;
    }
}

static int fault_recv(void *ctx, struct hdt_frame *frame)
{
    struct drv_fault *f = ctx;
    int broken = due(f), e;
    if (broken && (f->cfg.mode == DRV_FAULT_AGAIN || f->cfg.mode == DRV_FAULT_DOWN)) {
        f->hits++;
        return f->cfg.mode == DRV_FAULT_AGAIN ? HDT_BUS_ERR_AGAIN : HDT_BUS_ERR_DOWN;
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
    if (f->cfg.mode == DRV_FAULT_DROP)
        return HDT_BUS_ERR_AGAIN;
    if (f->cfg.mode == DRV_FAULT_DUPLICATE) {
        f->again = *frame;
        f->has_again = 1;
    } else {
        damage(f, frame);
    }
    return e;
}

void drv_fault_wrap(struct drv_fault *f, const struct drv_fault_cfg *cfg,
                    const struct hdt_bus *good, struct hdt_bus *bad)
{
    memset(f, 0, sizeof *f);
    f->good = *good;
    f->cfg = *cfg;
    *bad = (struct hdt_bus){.ctx = f, .send = fault_send, .recv = fault_recv};
}
