/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Telegrams of any length over CAN frames of 8 bytes, or of 64: ISO 15765-2 as the kernel does it
 * (can-isotp).  No padding, and no gap between frames: the two nodes are alone.
 *
 * Owns: one ISO-TP socket, and a raw one that receives error frames only.
 * Never: sets up the interface, blocks, sees a segment.
 */
#ifdef __linux__
#define _DEFAULT_SOURCE
#endif

#include "driver/drv_backend.h"

#ifdef __linux__

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/isotp.h>
#include <linux/can/raw.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "driver/drv_can_linux.h"

enum { ERRORS_MAX = 16, FD_DATA = 64 };

struct isotp_bus {
    struct drv_net net;
    int fd, error_fd;
};

static int isotp_send(void *ctx, const struct hdt_frame *f)
{
    struct isotp_bus *b = ctx;
    if (f->len == 0 || f->len > HDT_FRAME_MAX)
        return HDT_BUS_ERR_FRAME;
    if (!drv_net_is_on(&b->net))
        return HDT_BUS_ERR_DOWN;
    if (write(b->fd, f->data, f->len) == (ssize_t)f->len) {
        b->net.health.sent++;
        return HDT_BUS_OK;
    }
    /* EAGAIN: the telegram before is still on its way */
    int e = drv_net_failed(&b->net, errno);
    b->net.health.full += e == HDT_BUS_ERR_AGAIN;
    return e;
}

static void take_errors(struct isotp_bus *b)
{
    struct canfd_frame c;
    for (int k = 0; k < ERRORS_MAX; k++) {
        ssize_t n = read(b->error_fd, &c, sizeof c);
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
            return;
        /* another failure shows at the other socket too, and must not hide what comes after it */
        if (n >= (ssize_t)CAN_MTU && (c.can_id & CAN_ERR_FLAG) != 0)
            drv_can_error(&b->net, c.can_id, c.data);
    }
}

static int isotp_recv(void *ctx, struct hdt_frame *f)
{
    struct isotp_bus *b = ctx;
    uint8_t data[HDT_FRAME_MAX + 1]; /* one more, so that a longer telegram shows */
    ssize_t n = drv_net_recv(&b->net, b->fd, data, sizeof data);
    if (n > 0 && n <= HDT_FRAME_MAX) {
        memcpy(f->data, data, (size_t)n);
        f->len = (uint16_t)n;
        drv_net_took(&b->net, 1);
        return HDT_BUS_OK;
    }
    int error = n < 0 ? errno : EBADMSG;
    /* a segment missing, one too many, a length that cannot be: that telegram is gone */
    if (error == ETIMEDOUT || error == EILSEQ || error == EBADMSG) {
        drv_net_took(&b->net, 0);
        return HDT_BUS_ERR_FRAME;
    }
    /* nobody gives our segments the go-ahead: no peer, but the line is there */
    if (error == ECOMM)
        return HDT_BUS_ERR_DOWN;
    if (drv_net_failed(&b->net, error) == HDT_BUS_ERR_DOWN)
        return HDT_BUS_ERR_DOWN;
    take_errors(b);
    return drv_net_is_on(&b->net) ? HDT_BUS_ERR_AGAIN : HDT_BUS_ERR_DOWN;
}

static int isotp_fd(void *ctx)
{
    return ((const struct isotp_bus *)ctx)->fd;
}

static void isotp_health(void *ctx, struct hdt_bus_health *h)
{
    drv_net_health(&((const struct isotp_bus *)ctx)->net, h);
}

static void isotp_close(void *ctx)
{
    struct isotp_bus *b = ctx;
    if (b->fd >= 0)
        close(b->fd);
    if (b->error_fd >= 0)
        close(b->error_fd);
    drv_net_close(&b->net);
    free(b);
}

static int open_errors(struct isotp_bus *b, const char *iface, char *err, size_t errlen)
{
    static const struct drv_net_kind kind = {"isotp", DRV_KIND_CAN, AF_CAN, SOCK_RAW, CAN_RAW,
                                             DRV_CAN_MODULES};
    can_err_mask_t errors = DRV_CAN_ERRORS;
    struct sockaddr_can addr = {.can_family = AF_CAN};
    b->error_fd = drv_net_open(&b->net, &kind, iface, err, errlen);
    if (b->error_fd < 0)
        return b->error_fd;
    addr.can_ifindex = b->net.index;
    if (setsockopt(b->error_fd, SOL_CAN_RAW, CAN_RAW_FILTER, NULL, 0) < 0 ||
        setsockopt(b->error_fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) < 0 ||
        bind(b->error_fd, (const struct sockaddr *)&addr, sizeof addr) < 0)
        return drv_net_fail(&b->net, err, errlen, "cannot be set up for error frames");
    return HDT_BUS_OK;
}

static int open_telegrams(struct isotp_bus *b, enum hdt_bus_side side, char *err, size_t errlen)
{
    static const struct drv_net_kind kind = {"isotp", DRV_KIND_CAN, AF_CAN, SOCK_DGRAM, CAN_ISOTP,
                                             "the module can-isotp"};
    int host = side == HDT_BUS_HOST;
    struct can_isotp_ll_options fd_frames = {.mtu = CANFD_MTU, .tx_dl = FD_DATA, .tx_flags = CANFD_BRS};
    struct can_isotp_options options;
    struct can_isotp_fc_options pace; /* what we ask of the sender */
    struct sockaddr_can addr = {.can_family = AF_CAN, .can_ifindex = b->net.index};
    addr.can_addr.tp.tx_id = host ? DRV_ISOTP_ID_TO_SERVO : DRV_ISOTP_ID_TO_HOST;
    addr.can_addr.tp.rx_id = host ? DRV_ISOTP_ID_TO_HOST : DRV_ISOTP_ID_TO_SERVO;
    memset(&options, 0, sizeof options);
    options.frame_txtime = CAN_ISOTP_FRAME_TXTIME_ZERO;
    memset(&pace, 0, sizeof pace);
    pace.bs = DRV_ISOTP_BLOCK;
    b->fd = drv_net_socket(&b->net, &kind, err, errlen);
    if (b->fd < 0)
        return b->fd;
    if (setsockopt(b->fd, SOL_CAN_ISOTP, CAN_ISOTP_OPTS, &options, sizeof options) < 0 ||
        setsockopt(b->fd, SOL_CAN_ISOTP, CAN_ISOTP_RECV_FC, &pace, sizeof pace) < 0 ||
        (b->net.mtu >= (int)CANFD_MTU &&
         setsockopt(b->fd, SOL_CAN_ISOTP, CAN_ISOTP_LL_OPTS, &fd_frames, sizeof fd_frames) < 0) ||
        bind(b->fd, (const struct sockaddr *)&addr, sizeof addr) < 0)
        return drv_net_fail(&b->net, err, errlen, "cannot be set up for ISO-TP");
    return HDT_BUS_OK;
}

int drv_isotp_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                   size_t errlen)
{
    struct isotp_bus *b = calloc(1, sizeof *b);
    if (b == NULL)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "isotp:%.40s: out of memory", iface);
    b->fd = -1;
    int e = open_errors(b, iface, err, errlen);
    if (e == HDT_BUS_OK)
        e = open_telegrams(b, side, err, errlen);
    if (e != HDT_BUS_OK) {
        isotp_close(b);
        return e;
    }
    *bus = (struct hdt_bus){.ctx = b, .send = isotp_send, .recv = isotp_recv, .close = isotp_close,
                            .fd = isotp_fd, .health = isotp_health};
    return HDT_BUS_OK;
}

#else

int drv_isotp_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                   size_t errlen)
{
    (void)bus;
    (void)side;
    return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                        "isotp:%.40s: SocketCAN is Linux only: expected unix:PATH on this system", iface);
}

#endif
