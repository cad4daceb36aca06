/* SPDX-License-Identifier: Apache-2.0 */
/*
 * CAN as time.  See canwire.h.
 *
 * Owns: the frame lengths in bits.
 * Never: rounds down; a bit begun is a bit.
 */
#include "sim/canwire.h"

enum { FC_LEN = 3, CLASSICAL_MAX = 8, FD_MAX = 64, PDU_MAX = 4095 };

static uint64_t bits_ns(uint64_t bits, uint32_t bps)
{
    return (bits * 1000000000u + bps - 1) / bps;
}

/* Next length a CAN FD frame can have. */
static unsigned fd_len(unsigned len)
{
    static const uint8_t above_8[] = {12, 16, 20, 24, 32, 48, 64};
    for (unsigned i = 0; len > CLASSICAL_MAX && i < sizeof above_8; i++)
        if (len <= above_8[i])
            return above_8[i];
    return len;
}

uint64_t canwire_frame_ns(const struct canwire_line *line, unsigned data_len)
{
    uint64_t n = data_len;
    if (line->bitrate_bps == 0 || data_len > (line->data_bitrate_bps != 0 ? FD_MAX : CLASSICAL_MAX))
        return 0;
    if (line->data_bitrate_bps == 0)
        return bits_ns(47 + 8 * n + (34 + 8 * n - 1) / 4, line->bitrate_bps);
    n = fd_len(data_len);
    return bits_ns(32, line->bitrate_bps)
           + bits_ns(28 + 5 + (n > 16 ? 5u : 0u) + 10 * n, line->data_bitrate_bps);
}

uint64_t canwire_raw_ns(const struct canwire_line *line, unsigned len)
{
    return line->data_bitrate_bps == 0 || len > FD_MAX ? 0 : canwire_frame_ns(line, len);
}

uint64_t canwire_isotp_ns(const struct canwire_line *line, unsigned len, unsigned *frames)
{
    unsigned most = line->data_bitrate_bps != 0 ? FD_MAX : CLASSICAL_MAX, count = 1;
    /* the length of a single frame takes a byte up to 7, two above; of a first frame two */
    unsigned head = len < CLASSICAL_MAX ? 1 : 2;
    uint64_t ns = 0;
    if (len == 0 || len > PDU_MAX || line->bitrate_bps == 0)
        return 0;
    if (len + head <= most) {
        ns = canwire_frame_ns(line, len + head);
    } else {
        unsigned left = len - (most - 2), block = CANWIRE_ISOTP_BLOCK;
        ns = canwire_frame_ns(line, most);
        for (; left > 0; block++, count++) {
            unsigned part = left < most - 1 ? left : most - 1;
            if (block == CANWIRE_ISOTP_BLOCK) {
                ns += canwire_frame_ns(line, FC_LEN);
                count++;
                block = 0;
            }
            ns += canwire_frame_ns(line, part + 1);
            left -= part;
        }
    }
    if (frames != 0)
        *frames = count;
    return ns;
}
