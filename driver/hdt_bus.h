/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the cycle needs from the outside: a bus that moves telegrams and a clock.
 *
 * Owns: the two contracts, the frame, the bus failures, opening a bus by name.
 * Never: knows what a telegram means.
 */
#ifndef HDT_BUS_H
#define HDT_BUS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A telegram image, the same bytes on every bus: sequence, type, payload.
 * 253 is the most an ARCNET short packet carries. */
#define HDT_FRAME_MAX 253
struct hdt_frame {
    uint16_t len;
    uint8_t data[HDT_FRAME_MAX];
};

enum hdt_bus_err {
    HDT_BUS_OK = 0,
    HDT_BUS_ERR_AGAIN = -100, /* nothing to receive; or the send queue is full: frame dropped */
    HDT_BUS_ERR_DOWN = -101,  /* line or peer gone; may come back                             */
    HDT_BUS_ERR_FRAME = -102, /* bytes arrived that are no frame; they are gone               */
    HDT_BUS_ERR_NAME = -103   /* not the name of a bus; from hdt_bus_open only                */
};

/* The line as its controller reports it, worst of sending and receiving. */
enum hdt_line {
    HDT_LINE_UNKNOWN,  /* the bus has no such report        */
    HDT_LINE_ACTIVE,   /* CAN: error active                 */
    HDT_LINE_WARNING,  /* CAN: an error counter above 96    */
    HDT_LINE_PASSIVE,  /* CAN: above 127                    */
    HDT_LINE_OFF       /* bus off, or the interface is down */
};

/* What a bus knows of its line; counters since it was opened. */
struct hdt_bus_health {
    enum hdt_line line;
    uint64_t received_ns; /* when the last frame came that recv gave, monotonic; 0: none, or not known */
    uint64_t sent, received;
    uint64_t full;        /* sends that found the queue full: HDT_BUS_ERR_AGAIN           */
    uint64_t foreign;     /* not between these two nodes, or no frame: HDT_BUS_ERR_FRAME  */
    uint64_t overruns;    /* frames lost before recv: socket queue or controller full     */
    uint64_t offs;        /* times the line went off                                      */
    uint64_t restarts;    /* times it came back                                           */
};

/* Both calls never block.  One thread a bus.  close may be NULL. */
struct hdt_bus {
    void *ctx;
    int (*send)(void *ctx, const struct hdt_frame *f);
    int (*recv)(void *ctx, struct hdt_frame *f);
    void (*close)(void *ctx);
    int (*fd)(void *ctx);     /* to poll on, or -1; may be NULL */
    void (*health)(void *ctx, struct hdt_bus_health *h); /* may be NULL; never blocks */
};

enum hdt_bus_side { HDT_BUS_HOST, HDT_BUS_SERVO };

/* Open a bus:
 *   unix:PATH     two processes.  The servo side creates the socket and must be there first, the host
 *                 side connects; after that either side may restart, the other then reports
 *                 HDT_BUS_ERR_DOWN until the peer is back.
 *   can:IFACE     SocketCAN: where the interface is set up for CAN FD one telegram a frame (at most 64
 *                 bytes), where it is classical CAN as isotp:
 *   isotp:IFACE   SocketCAN by ISO 15765-2 in the kernel, on either kind of interface, any telegram
 *   arcnet:IFACE  Linux's ARCNET in raw mode
 * On can:, isotp: and arcnet: HDT_BUS_ERR_DOWN is bus off or an interface that is down; it lasts until
 * the line is back, and costs a frame at most after that.  loop: has both ends in one process, so it
 * cannot be opened by name: drv_loop_pair makes both.
 * Errors: negative, *bus zeroed, one line in err saying what, where and the remedy.
 * Context: start-up; allocates. */
int hdt_bus_open(struct hdt_bus *bus, const char *name, enum hdt_bus_side side, char *err,
                 size_t errlen);
void hdt_bus_close(struct hdt_bus *bus); /* zeroes *bus; a zeroed bus is left alone */
const char *hdt_bus_strerror(int err);
/* All zero, HDT_LINE_UNKNOWN, where the bus knows nothing.  Context: the thread of the bus. */
void hdt_bus_get_health(const struct hdt_bus *bus, struct hdt_bus_health *h);
const char *hdt_line_str(enum hdt_line line);

/* Monotonic time; never the wall clock. */
struct hdt_clock {
    void *ctx;
    uint64_t (*now_ns)(void *ctx);
    int (*sleep_until_ns)(void *ctx, uint64_t t_ns); /* 0 or -errno; -EINTR after a signal */
};

/* The POSIX clock. */
struct hdt_clock hdt_clock_posix(void);

/* Two ends of a memory bus.  Frames queue up to `depth` (1..16) each way; needs no set-up.
 * The memory is the caller's; keep it while the buses live. */
#define DRV_LOOP_DEPTH 16
struct drv_loop {
    struct drv_loop_queue {
        struct hdt_frame frame[DRV_LOOP_DEPTH];
        unsigned head, tail;
    } to_servo, to_host;
    struct drv_loop_end { struct drv_loop *loop; int side; } end[2];
};
void drv_loop_pair(struct drv_loop *loop, struct hdt_bus *host, struct hdt_bus *servo);

#ifdef __cplusplus
}
#endif
#endif
