/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Single-producer single-consumer ring of log records.  head counts records ever pushed, tail
 * records ever popped; both run freely and their difference is the number waiting.
 *
 * Owns: nothing; the memory is the caller's.
 * Never: blocks, allocates; no call waits for the other side.
 */
#include "driver/drv_log.h"

#define COUNT_MAX (1u << 24) /* far from the wrap of head - tail */

int drv_ring_init(struct drv_ring *r, struct drv_record *slots, unsigned count)
{
    if (r == NULL || slots == NULL || count == 0 || count > COUNT_MAX || (count & (count - 1)) != 0)
        return -1;
    r->slot = slots;
    r->mask = count - 1;
    r->head = r->tail = 0;
    return 0;
}

int drv_ring_push(struct drv_ring *r, const struct drv_record *rec)
{
    unsigned head = __atomic_load_n(&r->head, __ATOMIC_RELAXED);
    unsigned tail = __atomic_load_n(&r->tail, __ATOMIC_ACQUIRE);
    if (head - tail > r->mask)
        return -1;
    r->slot[head & r->mask] = *rec;
    __atomic_store_n(&r->head, head + 1u, __ATOMIC_RELEASE);
    return 0;
}

int drv_ring_pop(struct drv_ring *r, struct drv_record *rec)
{
    unsigned tail = __atomic_load_n(&r->tail, __ATOMIC_RELAXED);
    unsigned head = __atomic_load_n(&r->head, __ATOMIC_ACQUIRE);
    if (head == tail)
        return 0;
    *rec = r->slot[tail & r->mask];
    __atomic_store_n(&r->tail, tail + 1u, __ATOMIC_RELEASE);
    return 1;
}
