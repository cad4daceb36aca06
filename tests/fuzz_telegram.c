/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Any bytes as a telegram, as the payload of a CAN FD frame, as an ARCNET packet (libFuzzer).  What is
 * accepted must be what is sent again, byte for byte; what is refused must leave the output alone.
 *
 * The first byte chooses what the rest is: bit 0 format, bit 1 direction, bits 2-3 telegram, CAN, ARCNET.
 */
#include <stdlib.h>
#include <string.h>

#include "driver/drv_backend.h"
#include "driver/drv_telegram.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define HOLDS(what) do { if (!(what)) abort(); } while (0)

static void telegram(enum drv_format format, int up, const struct hdt_frame *f)
{
    struct drv_command c, c0;
    struct drv_state s, s0;
    struct hdt_frame again;
    memset(&c0, 0x5a, sizeof c0);
    memset(&s0, 0x5a, sizeof s0);
    c = c0;
    s = s0;
    memset(&again, 0xa5, sizeof again);
    int e = up ? drv_state_decode(format, f, &s) : drv_command_decode(format, f, &c);
    int len = f->len <= HDT_FRAME_MAX ? drv_telegram_len(format, f->data, f->len, up) : DRV_TELEGRAM_LENGTH;
    HOLDS(e <= 0 && drv_telegram_strerror(e) != NULL);
    if (e != DRV_TELEGRAM_OK) {
        HOLDS(memcmp(&c, &c0, sizeof c) == 0 && memcmp(&s, &s0, sizeof s) == 0);
        return;
    }
    HOLDS(len == (int)f->len);
    e = up ? drv_state_encode(format, &s, &again) : drv_command_encode(format, &c, &again);
    HOLDS(e == DRV_TELEGRAM_OK && again.len == f->len && memcmp(again.data, f->data, f->len) == 0);
    /* a byte less is no telegram */
    again.len--;
    e = up ? drv_state_decode(format, &again, &s) : drv_command_decode(format, &again, &c);
    HOLDS(e != DRV_TELEGRAM_OK);
}

static void can_frame(int up, const uint8_t *data, size_t size)
{
    struct hdt_frame f;
    memset(&f, 0x5a, sizeof f);
    int e = drv_can_trim(data, (unsigned)size, up, &f);
    HOLDS(e == HDT_BUS_OK || e == HDT_BUS_ERR_FRAME);
    if (e == HDT_BUS_OK) {
        HOLDS(f.len <= size && drv_can_padded(f.len) == size && memcmp(f.data, data, f.len) == 0);
        telegram(DRV_FORMAT_A, up, &f);
    }
}

static void arcnet_packet(int up, const uint8_t *data, size_t size)
{
    uint8_t from = up ? DRV_NODE_SERVO : DRV_NODE_HOST, to = up ? DRV_NODE_HOST : DRV_NODE_SERVO;
    uint8_t again[DRV_ARCNET_HEAD + HDT_FRAME_MAX];
    struct hdt_frame f;
    memset(&f, 0x5a, sizeof f);
    int e = drv_arcnet_unpack(from, to, data, size, &f);
    HOLDS(e == 1 || e == 0 || e == HDT_BUS_ERR_FRAME);
    if (e == 1) {
        HOLDS(drv_arcnet_pack(from, to, &f, again) == size && memcmp(again, data, 3) == 0);
        HOLDS(memcmp(again + DRV_ARCNET_HEAD, data + DRV_ARCNET_HEAD, size - DRV_ARCNET_HEAD) == 0);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct hdt_frame f;
    if (size == 0)
        return 0;
    unsigned what = data[0];
    int up = what >> 1 & 1;
    /* in a block of its own length, so that a read past its end is seen */
    uint8_t *rest = malloc(size - 1 > 0 ? size - 1 : 1);
    if (rest == NULL)
        return 0;
    memcpy(rest, data + 1, size - 1);
    memset(&f, 0x77, sizeof f);
    f.len = (uint16_t)(size - 1 < 300 ? size - 1 : 300);
    memcpy(f.data, rest, f.len <= HDT_FRAME_MAX ? f.len : HDT_FRAME_MAX);
    switch (what >> 2 & 3) {
    case 2: can_frame(up, rest, size - 1); break;
    case 3: arcnet_packet(up, rest, size - 1); break;
    default: telegram((what & 1) != 0 ? DRV_FORMAT_B : DRV_FORMAT_A, up, &f);
    }
    free(rest);
    return 0;
}
