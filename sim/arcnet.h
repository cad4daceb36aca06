/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ARCNET as time: what a token pass and a message cost, and a two-node ring between host and servo
 * driver that delivers each frame when the ring would have.  Virtual time; the caller moves it.
 *
 *   token:    ITT                                     39 bits, one turn-around
 *   message:  FBE  ACK  PAC  ACK                      (39 + 17 + PAC + 17) bits, four turn-arounds
 *             PAC = 6 + 11 (N + 7) bits, N data bytes; one byte more above 253
 *   refused:  FBE  NAK                                (39 + 17) bits, two turn-arounds
 *
 * All scales with the bit [COM20020 data sheet: frames; turn-around 12.7 us, response time-out
 * 74.7 us, both at 2.5 Mbit/s].  A node sends one message a token.  A message the receiver has no
 * free buffer for is refused and tried again a rotation later.
 *
 * Owns: the formula, and the ring with its four buffers a node.
 * Never: reads a clock, allocates, draws random numbers, looks into a frame.
 */
#ifndef ARCNET_H
#define ARCNET_H

#include <stdint.h>

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ARCNET_SHORT_MAX 253 /* data bytes of a short packet                 */
#define ARCNET_LONG_MIN 257  /* 254..256 exist in neither                    */
#define ARCNET_LONG_MAX 508
#define ARCNET_BUFFERS 2     /* frames a node holds for sending, and received */

struct arcnet_line {
    uint32_t bit_ns;         /* from arcnet_bit_ns */
    uint32_t propagation_ns; /* one way; 5 a metre of fibre */
};

/* Bit time at 10, 5, 2.5, 1.25, 0.625, 0.3125 or 0.15625 Mbit/s; 0: no rate of the chip. */
uint32_t arcnet_bit_ns(double rate_mbps);

/* Times of the ring, ns; exact in bits, so the same everywhere.  data_len: bytes of a packet, for a
 * telegram its length; those of a length that cannot be sent take 0. */
uint64_t arcnet_token_ns(const struct arcnet_line *line);
uint64_t arcnet_message_ns(const struct arcnet_line *line, unsigned data_len); /* token kept meanwhile    */
uint64_t arcnet_arrival_ns(const struct arcnet_line *line, unsigned data_len); /* until its last bit came */
uint64_t arcnet_refusal_ns(const struct arcnet_line *line);
/* Once around two nodes, each sending so many bytes (0: none). */
uint64_t arcnet_rotation_ns(const struct arcnet_line *line, unsigned down_len, unsigned up_len);
/* A lost token: its sender hears nothing, and invites one address after the other.  From host 255 to
 * servo driver 254 that are 253 without a node, a response time-out each. */
uint64_t arcnet_reconfiguration_ns(const struct arcnet_line *line);

struct arcnet_frame { uint64_t at_ns; struct hdt_frame frame; };
struct arcnet_fifo { struct arcnet_frame slot[ARCNET_BUFFERS]; unsigned head, count; };

struct arcnet_ring {
    struct arcnet_line line;
    uint64_t now_ns;         /* as last told                              */
    uint64_t token_ns;       /* when the token comes to `holder`          */
    int holder;              /* enum hdt_bus_side; the host's turn is first */
    struct arcnet_node {
        struct arcnet_fifo send, received; /* at_ns: handed in; there   */
    } node[2];
    unsigned refuse, lose;   /* faults to come                            */
    uint64_t messages, refused, reconfigurations;
    struct arcnet_end { struct arcnet_ring *ring; int side; } end[2];
};

/* Two ends of a ring at time 0, the token with the host; the memory is the caller's and must stay in
 * place while the buses live.  Their send and receive are of the time last given to arcnet_advance:
 * send returns HDT_BUS_ERR_AGAIN while the node's buffers are full, recv while nothing has arrived.
 * Errors: -1 when line->bit_ns is no bit time of the chip; nothing is changed. */
int arcnet_ring_open(struct arcnet_ring *ring, const struct arcnet_line *line, struct hdt_bus *host,
                     struct hdt_bus *servo);
/* It is now_ns; time that goes back is ignored.  Costs as much as there are messages, not time. */
void arcnet_advance(struct arcnet_ring *ring, uint64_t now_ns);
/* Time of the next thing to happen on the ring when a frame waits or travels: the token's next turn
 * or an arrival; UINT64_MAX when nothing does. */
uint64_t arcnet_next_ns(const struct arcnet_ring *ring);

/* Faults.  The next so many messages are refused as by a full receiver; the next so many token
 * passes are lost, each costing a reconfiguration. */
void arcnet_refuse(struct arcnet_ring *ring, unsigned messages);
void arcnet_lose_token(struct arcnet_ring *ring, unsigned passes);

#ifdef __cplusplus
}
#endif
#endif
