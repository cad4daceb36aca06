/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the backends on a Linux network interface (CAN, ISO-TP, ARCNET) share: finding the interface,
 * a socket that never blocks, receive time stamps, whether the line is there.
 *
 * Owns: struct drv_net, the health of one line.
 * Never: sets an interface up, blocks after open, knows what a frame holds.
 */
#ifndef DRV_NET_LINUX_H
#define DRV_NET_LINUX_H

#include <sys/types.h>

#include "driver/drv_backend.h"

struct drv_net {
    const char *bus;      /* for messages */
    char iface[16];
    int index, mtu;
    int hardware;         /* ARPHRD_... of the interface  */
    uint8_t node;         /* first byte of its address, 0 where it has none */
    int socket_fd;        /* as drv_net_open gave it, to ask by     */
    int carrier_fd;       /* the interface's carrier, -1: not known */
    uint64_t stamp_ns;    /* of the datagram received last, telegram or not; 0: none */
    uint32_t socket_lost; /* frames, as the socket counts them      */
    uint32_t chip_lost;   /* times the controller said it lost some */
    struct hdt_bus_health health;
};

/* What is opened where. */
struct drv_net_kind {
    const char *bus;              /* name before the colon, for messages       */
    int hardware;                 /* ARPHRD_... the interface must have        */
    int family, type, protocol;   /* of the socket                             */
    const char *module;           /* to load when the kernel does not know it  */
};

/* Returns a socket of that kind, not bound, after it has found the interface and seen that it is up.
 * Errors: HDT_BUS_ERR_NAME, _DOWN with one line in err; nothing is left open.  Context: start-up. */
int drv_net_open(struct drv_net *n, const struct drv_net_kind *kind, const char *iface, char *err,
                 size_t errlen);
void drv_net_close(struct drv_net *n);
/* Returns a socket of that kind that never blocks, stamps what it receives, and queues a few frames only. */
int drv_net_socket(struct drv_net *n, const struct drv_net_kind *kind, char *err, size_t errlen);
int drv_net_fail(const struct drv_net *n, char *err, size_t errlen, const char *what);

/* One datagram, its time of arrival and the frames lost before it into n; the time goes into its health when
 * drv_net_took says that it was a telegram.  Returns its length, or -1 and errno. */
ssize_t drv_net_recv(struct drv_net *n, int fd, void *data, size_t room);
/* After a send or receive that failed with this errno: HDT_BUS_ERR_AGAIN, or _DOWN and the line off. */
int drv_net_failed(struct drv_net *n, int error);
/* A frame was received: recv gives it (telegram 1), or it was no telegram (0). */
void drv_net_took(struct drv_net *n, int telegram);
void drv_net_off(struct drv_net *n);
void drv_net_on(struct drv_net *n);
void drv_net_health(const struct drv_net *n, struct hdt_bus_health *h);
/* Is the line there?  Costs a system call only while it was not. */
int drv_net_is_on(struct drv_net *n);

#endif
