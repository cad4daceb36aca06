/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SocketCAN: CAN FD raw frames, one telegram a frame, padded with zeros to the next length CAN FD
 * has (docs/formats.md, section CAN mapping).
 *
 * Owns: one raw socket, filtered to the one identifier this side receives.
 * Never: sets up the interface (bit rates, mtu: that is ip link), blocks.
 */
#ifdef __linux__
#define _DEFAULT_SOURCE /* struct ifreq */
#endif

#include "driver/drv_backend.h"

#ifdef __linux__

#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

struct can_bus {
    int fd;
    int up;          /* we receive servo -> host telegrams */
    canid_t send_id;
};

static int can_send(void *ctx, const struct hdt_frame *f)
{
    struct can_bus *b = ctx;
    struct canfd_frame c = {.can_id = b->send_id, .flags = CANFD_BRS};
    unsigned padded = drv_can_padded(f->len);
    if (f->len == 0 || padded == 0)
        return HDT_BUS_ERR_FRAME;
    c.len = (uint8_t)padded;
    memcpy(c.data, f->data, f->len);
    ssize_t n = write(b->fd, &c, CANFD_MTU);
    if (n == (ssize_t)CANFD_MTU)
        return HDT_BUS_OK;
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS || errno == EINTR))
        return HDT_BUS_ERR_AGAIN;
    return HDT_BUS_ERR_DOWN;
}

static int can_recv(void *ctx, struct hdt_frame *f)
{
    struct can_bus *b = ctx;
    struct canfd_frame c;
    ssize_t n = read(b->fd, &c, sizeof c);
    if (n < 0)
        return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? HDT_BUS_ERR_AGAIN
                                                                        : HDT_BUS_ERR_DOWN;
    if (n >= (ssize_t)CAN_MTU && (c.can_id & CAN_ERR_FLAG) != 0)
        return (c.can_id & CAN_ERR_BUSOFF) != 0 ? HDT_BUS_ERR_DOWN : HDT_BUS_ERR_AGAIN;
    /* a classical frame on our identifier is somebody else's mistake */
    if (n != (ssize_t)CANFD_MTU)
        return HDT_BUS_ERR_FRAME;
    return drv_can_trim(c.data, c.len, b->up, f);
}

static int can_fd(void *ctx)
{
    return ((const struct can_bus *)ctx)->fd;
}

static void can_close(void *ctx)
{
    struct can_bus *b = ctx;
    close(b->fd);
    free(b);
}

/* Is the interface there, up, and set up for CAN FD?  Fills ifr.ifr_ifindex last. */
static int check_iface(int fd, const char *iface, struct ifreq *ifr, char *err, size_t errlen)
{
    memset(ifr, 0, sizeof *ifr);
    memcpy(ifr->ifr_name, iface, strlen(iface));
    if (ioctl(fd, SIOCGIFMTU, ifr) < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "can:%s: no such interface (%s): see ip link", iface,
                            strerror(errno));
    if (ifr->ifr_mtu < (int)CANFD_MTU)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "can:%s: set up for classical CAN (mtu %d), expected CAN FD (mtu %d): "
                            "ip link set %s down, then mtu 72 (vcan) or type can fd on",
                            iface, ifr->ifr_mtu, (int)CANFD_MTU, iface);
    if (ioctl(fd, SIOCGIFFLAGS, ifr) < 0 || (ifr->ifr_flags & IFF_UP) == 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "can:%s: interface is down: ip link set %s up", iface, iface);
    if (ioctl(fd, SIOCGIFINDEX, ifr) < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "can:%s: no index: %s", iface,
                            strerror(errno));
    return HDT_BUS_OK;
}

static int set_up(int fd, const char *iface, enum hdt_bus_side side, char *err, size_t errlen)
{
    struct ifreq ifr;
    int on = 1, off = 0, flags = fcntl(fd, F_GETFL);
    can_err_mask_t errors = CAN_ERR_BUSOFF;
    struct can_filter filter = {
        .can_id = side == HDT_BUS_HOST ? DRV_CAN_ID_TO_HOST : DRV_CAN_ID_TO_SERVO,
        .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG};
    int e = check_iface(fd, iface, &ifr, err, errlen);
    if (e != HDT_BUS_OK)
        return e;
    struct sockaddr_can addr = {.can_family = AF_CAN, .can_ifindex = ifr.ifr_ifindex};
    if (setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) < 0 ||
        setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) < 0 ||
        setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) < 0 ||
        setsockopt(fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &off, sizeof off) < 0 ||
        bind(fd, (const struct sockaddr *)&addr, sizeof addr) < 0 || flags < 0 ||
        fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0 || fcntl(fd, F_SETFD, FD_CLOEXEC) < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "can:%s: cannot be set up: %s", iface,
                            strerror(errno));
    return HDT_BUS_OK;
}

int drv_can_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                 size_t errlen)
{
    if (iface[0] == '\0' || strlen(iface) >= IFNAMSIZ)
        return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                            "can:%.40s: expected can:IFACE, a name of 1 to %d characters", iface,
                            IFNAMSIZ - 1);
    int fd = socket(AF_CAN, SOCK_RAW, CAN_RAW);
    if (fd < 0 && (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT))
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "can:%s: this kernel has no CAN sockets (AF_CAN): load the can and "
                            "can-raw modules, or use unix:PATH", iface);
    if (fd < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "can:%s: no socket: %s", iface,
                            strerror(errno));
    int e = set_up(fd, iface, side, err, errlen);
    struct can_bus *b = e == HDT_BUS_OK ? calloc(1, sizeof *b) : NULL;
    if (b == NULL) {
        close(fd);
        return e != HDT_BUS_OK ? e
                               : drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                                              "can:%s: out of memory", iface);
    }
    b->fd = fd;
    b->up = side == HDT_BUS_HOST;
    b->send_id = side == HDT_BUS_HOST ? DRV_CAN_ID_TO_SERVO : DRV_CAN_ID_TO_HOST;
    *bus = (struct hdt_bus){
        .ctx = b, .send = can_send, .recv = can_recv, .close = can_close, .fd = can_fd};
    return HDT_BUS_OK;
}

#else

int drv_can_open(struct hdt_bus *bus, const char *iface, enum hdt_bus_side side, char *err,
                 size_t errlen)
{
    (void)bus;
    (void)side;
    return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                        "can:%.40s: SocketCAN is Linux only: use unix:PATH on this system", iface);
}

#endif
