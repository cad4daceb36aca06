/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ARCNET by Linux's own drivers (arc-rawmode and one for the chip): a packet socket for ETH_P_ARCNET.
 *
 * Owns: one packet socket on one interface.
 * Never: sets up the card (node, rate, modules: docs/formats.md, section ARCNET on Linux), blocks.
 */
#ifdef __linux__
#define _DEFAULT_SOURCE
#endif

#include "driver/drv_backend.h"

#ifdef __linux__

#include <arpa/inet.h>
#include <errno.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "driver/drv_net_linux.h"

enum { KIND_ARCNET = 7 /* ARPHRD_ARCNET */, FOREIGN_MAX = 16 };

struct arcnet_bus {
    struct drv_net net;
    int fd;
    uint8_t own, peer;
};

static int arcnet_send(void *ctx, const struct hdt_frame *f)
{
    struct arcnet_bus *b = ctx;
    uint8_t packet[DRV_ARCNET_HEAD + HDT_FRAME_MAX];
    if (f->len == 0 || f->len > HDT_FRAME_MAX)
        return HDT_BUS_ERR_FRAME;
    if (!drv_net_is_on(&b->net))
        return HDT_BUS_ERR_DOWN;
    unsigned len = drv_arcnet_pack(b->own, b->peer, f, packet);
    if (send(b->fd, packet, len, MSG_NOSIGNAL) == (ssize_t)len) {
        b->net.health.sent++;
        return HDT_BUS_OK;
    }
    int e = drv_net_failed(&b->net, errno);
    b->net.health.full += e == HDT_BUS_ERR_AGAIN;
    return e;
}

static int arcnet_recv(void *ctx, struct hdt_frame *f)
{
    struct arcnet_bus *b = ctx;
    uint8_t packet[DRV_ARCNET_HEAD + HDT_FRAME_MAX + 1]; /* one more, so that a longer packet shows */
    for (int k = 0; k < FOREIGN_MAX; k++) {
        ssize_t n = drv_net_recv(&b->net, b->fd, packet, sizeof packet);
        if (n < 0 && drv_net_failed(&b->net, errno) == HDT_BUS_ERR_DOWN)
            return HDT_BUS_ERR_DOWN;
        if (n < 0)
            return drv_net_is_on(&b->net) ? HDT_BUS_ERR_AGAIN : HDT_BUS_ERR_DOWN;
        int mine = drv_arcnet_unpack(b->peer, b->own, packet, (size_t)n, f);
        drv_net_took(&b->net, mine == 1);
        if (mine != 0)
            return mine == 1 ? HDT_BUS_OK : mine;
    }
    return HDT_BUS_ERR_AGAIN;
}

static int arcnet_fd(void *ctx)
{
    return ((const struct arcnet_bus *)ctx)->fd;
}

static void arcnet_health(void *ctx, struct hdt_bus_health *h)
{
    drv_net_health(&((const struct arcnet_bus *)ctx)->net, h);
}

static void arcnet_close(void *ctx)
{
    struct arcnet_bus *b = ctx;
    if (b->fd >= 0)
        close(b->fd);
    drv_net_close(&b->net);
    free(b);
}

static int set_up(struct arcnet_bus *b, const char *iface, char *err, size_t errlen)
{
    /* no protocol until it is bound, or packets of other interfaces come in between */
    static const struct drv_net_kind kind = {"arcnet", KIND_ARCNET, AF_PACKET, SOCK_RAW, 0,
                                             "the module af_packet"};
    b->fd = drv_net_open(&b->net, &kind, iface, err, errlen);
    if (b->fd < 0)
        return b->fd;
    if (b->net.node != 0 && b->net.node != b->own)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "arcnet:%s: the card is node %u, expected %u on this side: load its module "
                            "with node=%u", iface, b->net.node, b->own, b->own);
    struct sockaddr_ll at;
    memset(&at, 0, sizeof at);
    at.sll_family = AF_PACKET;
    at.sll_protocol = htons(ETH_P_ARCNET);
    at.sll_ifindex = b->net.index;
    if (bind(b->fd, (const struct sockaddr *)&at, sizeof at) < 0)
        return drv_net_fail(&b->net, err, errlen, "cannot be bound");
    return HDT_BUS_OK;
}

int drv_arcnet_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                    size_t errlen)
{
    struct arcnet_bus *b = calloc(1, sizeof *b);
    if (b == NULL)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "arcnet:%.40s: out of memory", iface);
    b->net.carrier_fd = -1;
    b->own = side == HDT_BUS_HOST ? DRV_NODE_HOST : DRV_NODE_SERVO;
    b->peer = side == HDT_BUS_HOST ? DRV_NODE_SERVO : DRV_NODE_HOST;
    int e = set_up(b, iface, err, errlen);
    if (e != HDT_BUS_OK) {
        arcnet_close(b);
        return e;
    }
    *bus = (struct hdt_bus){.ctx = b, .send = arcnet_send, .recv = arcnet_recv, .close = arcnet_close,
                            .fd = arcnet_fd, .health = arcnet_health};
    return HDT_BUS_OK;
}

#else

int drv_arcnet_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                    size_t errlen)
{
    (void)bus;
    (void)side;
    return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                        "arcnet:%.40s: needs Linux's ARCNET drivers: expected unix:PATH on this system",
                        iface);
}

#endif
