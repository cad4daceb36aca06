/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ARCNET in virtual time.  See arcnet.h.
 *
 * Owns: the frame lengths in bits; who holds the token when.
 * Never: waits; an idle ring costs nothing, however long it turns.
 */
#include "sim/arcnet.h"

#include <string.h>

enum { /* bits */
    INVITATION = 39, /* alert 6, EOT and twice the address, 11 bits a byte */
    ENQUIRY = 39,
    REPLY = 17,      /* ACK or NAK: alert, one byte */
    PACKET = 6,      /* alert; the bytes follow */
    BYTE = 11,
    OVERHEAD = 7,    /* SOH, sender, receiver twice, CP, two of check sum */
    SILENT = 253     /* addresses 1..253 */
};

uint32_t arcnet_bit_ns(double rate_mbps)
{
    uint32_t bit_ns = 100;
    for (double rate = 10; rate > 0.1; rate /= 2, bit_ns *= 2)
        if (rate_mbps == rate)
            return bit_ns;
    return 0;
}

static uint64_t bits(const struct arcnet_line *line, unsigned n)
{
    return (uint64_t)n * line->bit_ns;
}

/* From one node's last bit to the other's first: 31.75 bits and the way. */
static uint64_t turn(const struct arcnet_line *line)
{
    return (uint64_t)line->bit_ns * 127 / 4 + line->propagation_ns;
}

static unsigned packet_bits(unsigned data_len)
{
    unsigned more = data_len > ARCNET_SHORT_MAX;
    return PACKET + BYTE * (data_len + OVERHEAD + more);
}

static int sendable(unsigned data_len)
{
    return data_len > 0 && data_len <= ARCNET_LONG_MAX
           && (data_len <= ARCNET_SHORT_MAX || data_len >= ARCNET_LONG_MIN);
}

uint64_t arcnet_token_ns(const struct arcnet_line *line)
{
    return bits(line, INVITATION) + turn(line);
}

uint64_t arcnet_message_ns(const struct arcnet_line *line, unsigned data_len)
{
    if (!sendable(data_len))
        return 0;
    return bits(line, ENQUIRY + REPLY + packet_bits(data_len) + REPLY) + 4 * turn(line);
}

uint64_t arcnet_arrival_ns(const struct arcnet_line *line, unsigned data_len)
{
    if (!sendable(data_len))
        return 0;
    return bits(line, ENQUIRY + REPLY + packet_bits(data_len)) + 2 * turn(line) + line->propagation_ns;
}

uint64_t arcnet_refusal_ns(const struct arcnet_line *line)
{
    return bits(line, ENQUIRY + REPLY) + 2 * turn(line);
}

uint64_t arcnet_rotation_ns(const struct arcnet_line *line, unsigned down_len, unsigned up_len)
{
    return 2 * arcnet_token_ns(line) + arcnet_message_ns(line, down_len) + arcnet_message_ns(line, up_len);
}

uint64_t arcnet_reconfiguration_ns(const struct arcnet_line *line)
{
    uint64_t response_ns = (uint64_t)line->bit_ns * 747 / 4; /* 74.7 us at 2.5 Mbit/s */
    return SILENT * (bits(line, INVITATION) + response_ns) + arcnet_token_ns(line);
}

/* ---- the ring ---- */

static int put(struct arcnet_fifo *f, const struct hdt_frame *frame, uint64_t at_ns)
{
    if (f->count == ARCNET_BUFFERS)
        return HDT_BUS_ERR_AGAIN;
    struct arcnet_frame *slot = &f->slot[(f->head + f->count) % ARCNET_BUFFERS];
    slot->frame = *frame;
    slot->at_ns = at_ns;
    f->count++;
    return HDT_BUS_OK;
}

static void drop(struct arcnet_fifo *f)
{
    f->head = (f->head + 1) % ARCNET_BUFFERS;
    f->count--;
}

static int ring_send(void *ctx, const struct hdt_frame *f)
{
    struct arcnet_end *e = ctx;
    if (f->len == 0 || f->len > ARCNET_SHORT_MAX)
        return HDT_BUS_ERR_FRAME;
    return put(&e->ring->node[e->side].send, f, e->ring->now_ns);
}

static int ring_recv(void *ctx, struct hdt_frame *f)
{
    struct arcnet_end *e = ctx;
    struct arcnet_fifo *in = &e->ring->node[e->side].received;
    if (in->count == 0 || in->slot[in->head].at_ns > e->ring->now_ns)
        return HDT_BUS_ERR_AGAIN;
    *f = in->slot[in->head].frame;
    drop(in);
    return HDT_BUS_OK;
}

int arcnet_ring_open(struct arcnet_ring *ring, const struct arcnet_line *line, struct hdt_bus *host,
                     struct hdt_bus *servo)
{
    int known = 0;
    for (double rate = 10; rate > 0.1; rate /= 2)
        known |= arcnet_bit_ns(rate) == line->bit_ns;
    if (!known)
        return -1;
    memset(ring, 0, sizeof *ring);
    ring->line = *line;
    ring->holder = HDT_BUS_HOST;
    for (int side = 0; side < 2; side++) {
        ring->end[side].ring = ring;
        ring->end[side].side = side;
    }
    *host = (struct hdt_bus){ .ctx = &ring->end[HDT_BUS_HOST], .send = ring_send, .recv = ring_recv };
    *servo = (struct hdt_bus){ .ctx = &ring->end[HDT_BUS_SERVO], .send = ring_send, .recv = ring_recv };
    return 0;
}

/* The holder's turn: at most one message. */
static void take_turn(struct arcnet_ring *r)
{
    struct arcnet_fifo *out = &r->node[r->holder].send, *in = &r->node[!r->holder].received;
    if (out->count == 0)
        return;
    const struct hdt_frame *frame = &out->slot[out->head].frame;
    if (r->refuse > 0 || in->count == ARCNET_BUFFERS) {
        r->refuse -= r->refuse > 0;
        r->refused++;
        r->token_ns += arcnet_refusal_ns(&r->line);
        return;
    }
    (void)put(in, frame, r->token_ns + arcnet_arrival_ns(&r->line, frame->len));
    r->token_ns += arcnet_message_ns(&r->line, frame->len);
    r->messages++;
    drop(out);
}

static void pass_token(struct arcnet_ring *r)
{
    if (r->lose > 0) {
        r->lose--;
        r->reconfigurations++;
        r->token_ns += arcnet_reconfiguration_ns(&r->line);
    } else {
        r->token_ns += arcnet_token_ns(&r->line);
    }
    r->holder = !r->holder;
}

static int idle(const struct arcnet_ring *r)
{
    return r->node[0].send.count == 0 && r->node[1].send.count == 0 && r->lose == 0;
}

void arcnet_advance(struct arcnet_ring *ring, uint64_t now_ns)
{
    if (now_ns < ring->now_ns)
        return;
    while (ring->token_ns <= now_ns) {
        if (idle(ring)) {
            uint64_t around_ns = arcnet_rotation_ns(&ring->line, 0, 0);
            ring->token_ns += (now_ns - ring->token_ns) / around_ns * around_ns;
        }
        take_turn(ring);
        pass_token(ring);
    }
    ring->now_ns = now_ns;
}

uint64_t arcnet_next_ns(const struct arcnet_ring *ring)
{
    uint64_t next_ns = idle(ring) ? UINT64_MAX : ring->token_ns;
    for (int side = 0; side < 2; side++) {
        const struct arcnet_fifo *in = &ring->node[side].received;
        for (unsigned k = 0; k < in->count; k++) {
            uint64_t at_ns = in->slot[(in->head + k) % ARCNET_BUFFERS].at_ns;
            if (at_ns > ring->now_ns && at_ns < next_ns)
                next_ns = at_ns;
        }
    }
    return next_ns;
}

void arcnet_refuse(struct arcnet_ring *ring, unsigned messages)
{
    ring->refuse += messages;
}

void arcnet_lose_token(struct arcnet_ring *ring, unsigned passes)
{
    ring->lose += passes;
}
