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

/* CAN identifiers are the ARCNET node the telegram is for: 254 the servo driver, 255 the host
 * [node numbers: public drivers].  The lower identifier, the command's, wins arbitration, so a
 * command is never delayed by the state of the period before. */
#define DRV_CAN_ID_TO_SERVO 0x0feu
#define DRV_CAN_ID_TO_HOST 0x0ffu
#define DRV_CAN_DATA_MAX 64u

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
