/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Memory bus: two queues.  The smallest complete backend, and the one to read before writing
 * another.  Both ends belong to one thread.
 *
 * Owns: nothing; the memory is the caller's.
 * Never: allocates, blocks.
 */
#include <string.h>

#include "driver/hdt_bus.h"

static int queue_put(struct drv_loop_queue *q, const struct hdt_frame *f)
{
    if (f->len == 0 || f->len > HDT_FRAME_MAX)
        return HDT_BUS_ERR_FRAME;
    /* head and tail run freely; their difference is the number queued */
    if (q->head - q->tail == DRV_LOOP_DEPTH)
        return HDT_BUS_ERR_AGAIN;
    q->frame[q->head % DRV_LOOP_DEPTH] = *f;
    q->head++;
    return HDT_BUS_OK;
}

static int queue_get(struct drv_loop_queue *q, struct hdt_frame *f)
{
    if (q->head == q->tail)
        return HDT_BUS_ERR_AGAIN;
    *f = q->frame[q->tail % DRV_LOOP_DEPTH];
    q->tail++;
    return HDT_BUS_OK;
}

static int loop_send(void *ctx, const struct hdt_frame *f)
{
    struct drv_loop_end *e = ctx;
    return queue_put(e->side == HDT_BUS_HOST ? &e->loop->to_servo : &e->loop->to_host, f);
}

static int loop_recv(void *ctx, struct hdt_frame *f)
{
    struct drv_loop_end *e = ctx;
    return queue_get(e->side == HDT_BUS_HOST ? &e->loop->to_host : &e->loop->to_servo, f);
}

void drv_loop_pair(struct drv_loop *loop, struct hdt_bus *host, struct hdt_bus *servo)
{
    memset(loop, 0, sizeof *loop);
    loop->end[0].loop = loop->end[1].loop = loop;
    loop->end[0].side = HDT_BUS_HOST;
    loop->end[1].side = HDT_BUS_SERVO;
    *host = (struct hdt_bus){.ctx = &loop->end[0], .send = loop_send, .recv = loop_recv};
    *servo = (struct hdt_bus){.ctx = &loop->end[1], .send = loop_send, .recv = loop_recv};
}
