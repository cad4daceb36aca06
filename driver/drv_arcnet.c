/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The packet that Linux's ARCNET stack takes and gives in raw mode (linux/if_arcnet.h): sender,
 * receiver, offset of the first byte in the chip's page of 256, a byte unused in short packets; then
 * the telegram.
 *
 * Owns: these four bytes.
 * Never: touches a socket; that is drv_arcnet_linux.c.
 */
#include <string.h>

#include "driver/drv_backend.h"

enum { PAGE = 256, FROM = 0, TO = 1, OFFSET = 2 };

unsigned drv_arcnet_pack(uint8_t from, uint8_t to, const struct hdt_frame *f, uint8_t *packet)
{
    packet[FROM] = from; /* the chip puts its own number there again */
    packet[TO] = to;
    packet[OFFSET] = (uint8_t)(PAGE - f->len);
    packet[OFFSET + 1] = 0;
    memcpy(packet + DRV_ARCNET_HEAD, f->data, f->len);
    return DRV_ARCNET_HEAD + f->len;
}

int drv_arcnet_unpack(uint8_t from, uint8_t to, const uint8_t *packet, size_t len, struct hdt_frame *f)
{
    if (len >= DRV_ARCNET_HEAD && (packet[FROM] != from || packet[TO] != to))
        return 0;
    if (len <= DRV_ARCNET_HEAD || len > DRV_ARCNET_HEAD + HDT_FRAME_MAX ||
        packet[OFFSET] != PAGE - (len - DRV_ARCNET_HEAD))
        return HDT_BUS_ERR_FRAME;
    f->len = (uint16_t)(len - DRV_ARCNET_HEAD);
    memcpy(f->data, packet + DRV_ARCNET_HEAD, f->len);
    return 1;
}
