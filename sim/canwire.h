/* SPDX-License-Identifier: Apache-2.0 */
/*
 * CAN as time: how long frames and telegrams are on the wire, at most (every stuff bit there can be).
 *
 *   classical   11-bit identifier, n bytes: 47 + 8 n + floor((34 + 8 n - 1) / 4) bits, three of them
 *               the pause [Davis, Burns, Bril, Lukkien, Controller Area Network schedulability
 *               analysis, 2007, eq. 1 without its rounding]
 *   CAN FD      32 bits at the nominal rate; 28 + 5 (n > 16) + 10 n at the data rate [Bordoloi, Samii,
 *               The frame packing problem for CAN-FD, 2014], and 5 more for the stuff count that ISO
 *               11898-1:2015 added
 *   ISO-TP      first frame, flow control, and as many consecutive frames as it takes, one after the
 *               other, with a flow control again after each four but the last
 *
 * Owns: these formulas.
 * Never: reads a clock, knows what a telegram means.
 */
#ifndef CANWIRE_H
#define CANWIRE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CANWIRE_ISOTP_BLOCK 4 /* as the driver asks for, DRV_ISOTP_BLOCK */

struct canwire_line {
    uint32_t bitrate_bps;      /* nominal                              */
    uint32_t data_bitrate_bps; /* of CAN FD's data phase; 0: classical */
};

/* A frame with so many data bytes, ns; 0 where there is no such frame. */
uint64_t canwire_frame_ns(const struct canwire_line *line, unsigned data_len);
/* A telegram in one CAN FD frame, padded; 0 where it does not fit or the line is classical. */
uint64_t canwire_raw_ns(const struct canwire_line *line, unsigned len);
/* A telegram of up to 4095 bytes by ISO-TP with frames of 8 (classical) or 64 bytes, flow control of
 * the other side included; frames: how many, may be NULL. */
uint64_t canwire_isotp_ns(const struct canwire_line *line, unsigned len, unsigned *frames);

#ifdef __cplusplus
}
#endif
#endif
