/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Owns: frames with known bytes, and how a bus test sends, receives, waits for and compares them.
 * Never: opens a bus.
 */
#ifndef BUS_FRAMES_H
#define BUS_FRAMES_H

#include <poll.h>
#include <string.h>

#include "driver/hdt_bus.h"
#include "tests/check_main.h"

static inline struct hdt_frame frame_of(unsigned len, uint64_t seed)
{
    struct hdt_frame f = {.len = (uint16_t)len};
    for (unsigned i = 0; i < len; i++)
        f.data[i] = (uint8_t)test_random(&seed);
    return f;
}

static inline int send_to(const struct hdt_bus *b, const struct hdt_frame *f)
{
    return b->send(b->ctx, f);
}

static inline int recv_from(const struct hdt_bus *b, struct hdt_frame *f)
{
    memset(f, 0x77, sizeof *f);
    return b->recv(b->ctx, f);
}

/* Wait, at most 5 s, until something arrives, the peer goes or the link says what is wrong. */
static inline int recv_wait(const struct hdt_bus *b, struct hdt_frame *f)
{
    int e = recv_from(b, f);
    for (int n = 0; e == HDT_BUS_ERR_AGAIN && n < 500; n++) {
        struct pollfd p = {.fd = b->fd(b->ctx), .events = POLLIN};
        poll(&p, 1, 10);
        e = recv_from(b, f);
    }
    return e;
}

static inline void assert_same(const struct hdt_frame *a, const struct hdt_frame *b)
{
    ck_assert_uint_eq(a->len, b->len);
    ck_assert_mem_eq(a->data, b->data, a->len);
}

#endif
