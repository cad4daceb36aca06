/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SocketCAN: CAN FD raw frames, one telegram a frame, padded with zeros to the next length CAN FD
 * has (docs/formats.md, section CAN mapping).
 *
 * Owns: one raw socket, filtered to the one identifier this side receives and to error frames.
 * Never: sets up the interface (bit rates, mtu, restart: that is ip link), blocks.
 */
#ifdef __linux__
#define _DEFAULT_SOURCE
#endif

#include "driver/drv_backend.h"

#ifdef __linux__

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "driver/drv_can_linux.h"

/* Error frames passed over in one call, so that a storm of them cannot hold the period up. */
enum { ERRORS_MAX = 16 };

struct can_bus {
    struct drv_net net;
    int fd;
    int up;          /* we receive servo -> host telegrams */
    canid_t send_id;
};

void drv_can_error(struct drv_net *n, uint32_t id, const uint8_t *data)
{
    unsigned c = (id & CAN_ERR_CRTL) != 0 ? data[1] : 0u;
    if ((id & CAN_ERR_RESTARTED) != 0)
        drv_net_on(n);
    if ((id & CAN_ERR_BUSOFF) != 0)
        drv_net_off(n);
    n->chip_lost += (c & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    if (n->health.line == HDT_LINE_OFF)
        return;
    if ((c & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0)
        n->health.line = HDT_LINE_PASSIVE;
    else if ((c & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0)
        n->health.line = HDT_LINE_WARNING;
    else if ((c & CAN_ERR_CRTL_ACTIVE) != 0)
        n->health.line = HDT_LINE_ACTIVE;
}

static int can_send(void *ctx, const struct hdt_frame *f)
{
    struct can_bus *b = ctx;
    struct canfd_frame c = {.can_id = b->send_id, .flags = CANFD_BRS};
    unsigned padded = drv_can_padded(f->len);
    if (f->len == 0 || padded == 0)
        return HDT_BUS_ERR_FRAME;
    if (!drv_net_is_on(&b->net))
        return HDT_BUS_ERR_DOWN;
    c.len = (uint8_t)padded;
    memcpy(c.data, f->data, f->len);
    if (write(b->fd, &c, CANFD_MTU) == (ssize_t)CANFD_MTU) {
        b->net.health.sent++;
        return HDT_BUS_OK;
    }
    int e = drv_net_failed(&b->net, errno);
    b->net.health.full += e == HDT_BUS_ERR_AGAIN;
    return e;
}

static int can_recv(void *ctx, struct hdt_frame *f)
{
    struct can_bus *b = ctx;
    struct canfd_frame c;
    for (int k = 0; k < ERRORS_MAX; k++) {
        ssize_t n = drv_net_recv(&b->net, b->fd, &c, sizeof c);
        if (n < 0 && drv_net_failed(&b->net, errno) == HDT_BUS_ERR_DOWN)
            return HDT_BUS_ERR_DOWN;
        if (n < 0)
            return drv_net_is_on(&b->net) ? HDT_BUS_ERR_AGAIN : HDT_BUS_ERR_DOWN;
        if (n >= (ssize_t)CAN_MTU && (c.can_id & CAN_ERR_FLAG) != 0) {
            drv_can_error(&b->net, c.can_id, c.data);
            if (b->net.health.line == HDT_LINE_OFF)
                return HDT_BUS_ERR_DOWN;
            continue;
        }
        /* a classical frame on our identifier is somebody else's mistake */
        int e = n == (ssize_t)CANFD_MTU ? drv_can_trim(c.data, c.len, b->up, f) : HDT_BUS_ERR_FRAME;
        drv_net_took(&b->net, e == HDT_BUS_OK);
        return e;
    }
    return HDT_BUS_ERR_AGAIN;
}

static int can_fd(void *ctx)
{
    return ((const struct can_bus *)ctx)->fd;
}

static void can_health(void *ctx, struct hdt_bus_health *h)
{
    drv_net_health(&((const struct can_bus *)ctx)->net, h);
}

static void can_close(void *ctx)
{
    struct can_bus *b = ctx;
    if (b->fd >= 0)
        close(b->fd);
    drv_net_close(&b->net);
    free(b);
}

static int set_up(struct can_bus *b, char *err, size_t errlen)
{
    int on = 1, off = 0;
    can_err_mask_t errors = DRV_CAN_ERRORS;
    struct can_filter filter = {.can_id = b->up ? DRV_CAN_ID_TO_HOST : DRV_CAN_ID_TO_SERVO,
                                .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
    struct sockaddr_can addr = {.can_family = AF_CAN, .can_ifindex = b->net.index};
    if (setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) < 0 ||
        setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) < 0 ||
        setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) < 0 ||
        setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &off, sizeof off) < 0 ||
        bind(b->fd, (const struct sockaddr *)&addr, sizeof addr) < 0)
        return drv_net_fail(&b->net, err, errlen, "cannot be set up");
    return HDT_BUS_OK;
}

int drv_can_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                 size_t errlen)
{
    static const struct drv_net_kind kind = {"can", DRV_KIND_CAN, AF_CAN, SOCK_RAW, CAN_RAW, DRV_CAN_MODULES};
    struct can_bus *b = calloc(1, sizeof *b);
    if (b == NULL)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "can:%.40s: out of memory", iface);
    b->fd = drv_net_open(&b->net, &kind, iface, err, errlen);
    b->up = side == HDT_BUS_HOST;
    b->send_id = side == HDT_BUS_HOST ? DRV_CAN_ID_TO_SERVO : DRV_CAN_ID_TO_HOST;
    int classical = b->fd >= 0 && b->net.mtu < (int)CANFD_MTU;
    int e = b->fd < 0 || classical ? b->fd : set_up(b, err, errlen);
    if (e < 0 || classical) {
        can_close(b);
        return classical ? drv_isotp_open(bus, iface, side, err, errlen) : e;
    }
    *bus = (struct hdt_bus){.ctx = b, .send = can_send, .recv = can_recv, .close = can_close,
                            .fd = can_fd, .health = can_health};
    return HDT_BUS_OK;
}

#else

int drv_can_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                 size_t errlen)
{
    (void)bus;
    (void)side;
    return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                        "can:%.40s: SocketCAN is Linux only: expected unix:PATH on this system", iface);
}

#endif
