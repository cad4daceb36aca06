/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The backends behind hdt_bus_open, and the CAN mapping that needs no CAN.
 *
 * Owns: what hdt_bus.c and the backends share.  Not installed: hosts use hdt_bus.h.
 */
#ifndef DRV_BACKEND_H
#define DRV_BACKEND_H

#include "driver/hdt_bus.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One line into err (if there is room), and code back. */
#ifdef __GNUC__
__attribute__((format(printf, 4, 5)))
#endif
int drv_bus_fail(int code, char *err, size_t errlen, const char *fmt, ...);

/* As hdt_bus_open, with what follows the colon. */
int drv_unix_open(struct hdt_bus *bus, const char *path, enum hdt_bus_side side, char *err,
                  size_t errlen);
int drv_can_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                 size_t errlen);
int drv_isotp_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                   size_t errlen);
int drv_arcnet_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                    size_t errlen);

/* The nodes of the servo driver's network [public drivers]. */
#define DRV_NODE_SERVO 0xfeu
#define DRV_NODE_HOST 0xffu

/* An ARCNET packet as Linux has it in raw mode: sender, receiver, two bytes of offset, telegram. */
#define DRV_ARCNET_HEAD 4u
/* Returns its length.  f: 1..HDT_FRAME_MAX bytes; packet: room for HDT_FRAME_MAX + DRV_ARCNET_HEAD. */
unsigned drv_arcnet_pack(uint8_t from, uint8_t to, const struct hdt_frame *f, uint8_t *packet);
/* 1: a telegram from that node to that one; 0: somebody else's; HDT_BUS_ERR_FRAME: no short packet. */
int drv_arcnet_unpack(uint8_t from, uint8_t to, const uint8_t *packet, size_t len, struct hdt_frame *f);

/* CAN identifiers are the ARCNET node the telegram is for.  The lower identifier, the command's, wins
 * arbitration, so a command is never delayed by the state of the period before.  ISO-TP has its own
 * pair, since its frames begin with bytes of the protocol. */
#define DRV_CAN_ID_TO_SERVO 0x0feu
#define DRV_CAN_ID_TO_HOST 0x0ffu
#define DRV_ISOTP_ID_TO_SERVO 0x1feu
#define DRV_ISOTP_ID_TO_HOST 0x1ffu
#define DRV_CAN_DATA_MAX 64u
/* Consecutive frames a receiver takes before the sender waits for the next go-ahead: as many as the
 * oldest controllers hold (SJA1000: 64 bytes, a frame takes 13) while their processor is elsewhere. */
#define DRV_ISOTP_BLOCK 4

/* Payload length a CAN FD frame of at least len bytes has: 0..8 12 16 20 24 32 48 64; 0 when more
 * than 64. */
unsigned drv_can_padded(unsigned len);
/* The telegram in a CAN FD payload, without its padding.
 * Errors: HDT_BUS_ERR_FRAME when it is no telegram, or padded to another length than it needs. */
int drv_can_trim(const uint8_t *data, unsigned len, int up, struct hdt_frame *f);

/* The calling thread runs on this processor only.  0 or an errno; ENOTSUP where there is no such call. */
int drv_rt_bind_cpu(int cpu);

#ifdef __cplusplus
}
#endif
#endif
