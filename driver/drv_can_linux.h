/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What raw CAN and ISO-TP share: error frames.
 *
 * Owns: the meaning of an error frame for the line.
 * Never: opens a socket.
 */
#ifndef DRV_CAN_LINUX_H
#define DRV_CAN_LINUX_H

#include "driver/drv_net_linux.h"

enum { DRV_KIND_CAN = 280 }; /* ARPHRD_CAN */
#define DRV_CAN_MODULES "the modules can (AF_CAN) and can-raw"

/* The classes of error frame that say something about the line: controller, bus off, restarted. */
#define DRV_CAN_ERRORS 0x0144u

/* Put an error frame, its identifier with flags and its 8 bytes, to the line's health. */
void drv_can_error(struct drv_net *n, uint32_t id, const uint8_t *data);

#endif
