/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A Linux network interface as a line.  See drv_net_linux.h.
 *
 * Owns: the mapping of errno to bus errors, time stamps on the monotonic clock.
 * Never: knows CAN from ARCNET.
 */
#ifdef __linux__
#define _DEFAULT_SOURCE /* struct ifreq, SO_TIMESTAMPNS */
#endif

#include "driver/drv_net_linux.h"

#ifdef __linux__

#include <errno.h>
#include <fcntl.h>
#include <net/if.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#ifndef SO_RXQ_OVFL
#define SO_RXQ_OVFL 40
#endif
#ifndef SO_TIMESTAMPNS
#define SO_TIMESTAMPNS 35
#endif
#define SCM_STAMP SO_TIMESTAMPNS

/* The kernel's least, some five frames.  More would only age. */
enum { SEND_QUEUE_BYTES = 4608 };

int drv_net_fail(const struct drv_net *n, char *err, size_t errlen, const char *what)
{
    return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "%s:%s: %s: %s", n->bus, n->iface, what,
                        strerror(errno));
}

/* Everything asked of the interface by ioctl; any datagram socket will do for that. */
static int ask(struct drv_net *n, int fd, int hardware, char *err, size_t errlen)
{
    struct ifreq r;
    memset(&r, 0, sizeof r);
    memcpy(r.ifr_name, n->iface, sizeof n->iface);
    if (ioctl(fd, SIOCGIFINDEX, &r) < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "%s:%s: no such interface (%s): see ip link",
                            n->bus, n->iface, strerror(errno));
    n->index = r.ifr_ifindex;
    if (ioctl(fd, SIOCGIFHWADDR, &r) < 0)
        return drv_net_fail(n, err, errlen, "kind of interface not known");
    n->hardware = r.ifr_hwaddr.sa_family;
    n->node = (uint8_t)r.ifr_hwaddr.sa_data[0];
    if (n->hardware != hardware)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "%s:%s: an interface of kind %d, expected %d (linux/if_arp.h): see ip link",
                            n->bus, n->iface, n->hardware, hardware);
    if (ioctl(fd, SIOCGIFMTU, &r) < 0)
        return drv_net_fail(n, err, errlen, "mtu not known");
    n->mtu = r.ifr_mtu;
    if (ioctl(fd, SIOCGIFFLAGS, &r) < 0 || (r.ifr_flags & IFF_UP) == 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "%s:%s: interface is down: ip link set %s up",
                            n->bus, n->iface, n->iface);
    return HDT_BUS_OK;
}

int drv_net_open(struct drv_net *n, const struct drv_net_kind *kind, const char *iface, char *err,
                 size_t errlen)
{
    char path[64];
    memset(n, 0, sizeof *n);
    n->bus = kind->bus;
    n->carrier_fd = -1;
    if (iface[0] == '\0' || strlen(iface) >= sizeof n->iface || strchr(iface, '/') != NULL)
        return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                            "%s:%.40s: expected %s:IFACE, a name of 1 to %d characters", n->bus, iface,
                            n->bus, (int)sizeof n->iface - 1);
    memcpy(n->iface, iface, strlen(iface));
    int fd = drv_net_socket(n, kind, err, errlen);
    if (fd < 0)
        return fd;
    int e = ask(n, fd, kind->hardware, err, errlen);
    if (e != HDT_BUS_OK) {
        close(fd);
        return e;
    }
    (void)snprintf(path, sizeof path, "/sys/class/net/%s/carrier", n->iface);
    n->carrier_fd = open(path, O_RDONLY | O_CLOEXEC);
    n->socket_fd = fd;
    n->health.line = HDT_LINE_ACTIVE; /* until told otherwise */
    return fd;
}

void drv_net_close(struct drv_net *n)
{
    if (n->carrier_fd >= 0)
        close(n->carrier_fd);
    n->carrier_fd = -1;
}

int drv_net_socket(struct drv_net *n, const struct drv_net_kind *kind, char *err, size_t errlen)
{
    int on = 1, bytes = SEND_QUEUE_BYTES;
    int fd = socket(kind->family, kind->type | SOCK_NONBLOCK | SOCK_CLOEXEC, kind->protocol);
    if (fd < 0 && (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT))
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "%s:%s: this kernel has no such sockets: load %s, or use unix:PATH", n->bus,
                            n->iface, kind->module);
    if (fd < 0 && errno == EPERM)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "%s:%s: not permitted: run as root or with CAP_NET_RAW", n->bus, n->iface);
    if (fd < 0)
        return drv_net_fail(n, err, errlen, "no socket");
    /* all three make it better, none is needed */
    (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    (void)setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
    (void)setsockopt(fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    return fd;
}

static uint64_t clock_ns(clockid_t which)
{
    struct timespec t;
    (void)clock_gettime(which, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* The kernel stamps by the wall clock.  What counts is the frame's age; one that cannot be, because
 * somebody set that clock in between, is taken as none. */
static uint64_t monotonic_of(const struct timespec *stamp)
{
    uint64_t wall_ns = (uint64_t)stamp->tv_sec * 1000000000u + (uint64_t)stamp->tv_nsec;
    uint64_t age_ns = clock_ns(CLOCK_REALTIME) - wall_ns, now_ns = clock_ns(CLOCK_MONOTONIC);
    return age_ns <= now_ns && age_ns < 10000000000u ? now_ns - age_ns : now_ns;
}

ssize_t drv_net_recv(struct drv_net *n, int fd, void *data, size_t room)
{
    union { struct cmsghdr align; char bytes[256]; } control;
    struct iovec part = {.iov_base = data, .iov_len = room};
    struct msghdr m;
    memset(&m, 0, sizeof m);
    m.msg_iov = &part;
    m.msg_iovlen = 1;
    m.msg_control = control.bytes;
    m.msg_controllen = sizeof control.bytes;
    ssize_t got = recvmsg(fd, &m, 0);
    n->stamp_ns = 0;
    for (struct cmsghdr *c = got < 0 ? NULL : CMSG_FIRSTHDR(&m); c != NULL; c = CMSG_NXTHDR(&m, c)) {
        struct timespec stamp;
        uint32_t lost;
        if (c->cmsg_level != SOL_SOCKET)
            continue;
        if (c->cmsg_type == SCM_STAMP && c->cmsg_len >= CMSG_LEN(sizeof stamp)) {
            memcpy(&stamp, CMSG_DATA(c), sizeof stamp);
            n->stamp_ns = monotonic_of(&stamp);
        } else if (c->cmsg_type == SO_RXQ_OVFL && c->cmsg_len >= CMSG_LEN(sizeof lost)) {
            memcpy(&lost, CMSG_DATA(c), sizeof lost);
            n->socket_lost = lost;
        }
    }
    return got;
}

int drv_net_failed(struct drv_net *n, int error)
{
    if (error == EAGAIN || error == EWOULDBLOCK || error == ENOBUFS || error == EINTR)
        return HDT_BUS_ERR_AGAIN;
    drv_net_off(n);
    return HDT_BUS_ERR_DOWN;
}

void drv_net_took(struct drv_net *n, int telegram)
{
    n->health.received += telegram != 0;
    n->health.foreign += telegram == 0;
    if (telegram)
        n->health.received_ns = n->stamp_ns;
    (void)drv_net_is_on(n); /* one that was off may be back */
}

void drv_net_off(struct drv_net *n)
{
    if (n->health.line != HDT_LINE_OFF)
        n->health.offs++;
    n->health.line = HDT_LINE_OFF;
}

void drv_net_on(struct drv_net *n)
{
    if (n->health.line == HDT_LINE_OFF)
        n->health.restarts++;
    n->health.line = HDT_LINE_ACTIVE;
}

void drv_net_health(const struct drv_net *n, struct hdt_bus_health *h)
{
    *h = n->health;
    h->overruns = (uint64_t)n->socket_lost + n->chip_lost;
}

/* The carrier reads 1 when the line is up, 0 when not, and fails while the interface is down.  Without
 * sysfs the interface's flags must do, which follow a bus off within a second only. */
static int has_carrier(const struct drv_net *n)
{
    char c = '0';
    struct ifreq r;
    if (n->carrier_fd >= 0)
        return pread(n->carrier_fd, &c, 1, 0) == 1 && c == '1';
    memset(&r, 0, sizeof r);
    memcpy(r.ifr_name, n->iface, sizeof n->iface);
    return ioctl(n->socket_fd, SIOCGIFFLAGS, &r) == 0 && (r.ifr_flags & IFF_RUNNING) != 0;
}

int drv_net_is_on(struct drv_net *n)
{
    if (n->health.line != HDT_LINE_OFF)
        return 1;
    if (!has_carrier(n))
        return 0;
    drv_net_on(n);
    return 1;
}

#endif
