/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Two processes on one machine: a unix socket of type SOCK_SEQPACKET, one telegram a packet.
 * The packet type keeps boundaries, tells when the peer is gone, and pushes back when the peer
 * does not read.  The servo side serves one host at a time; a second one waits its turn.
 *
 * Owns: the socket file (servo side): made in open, removed in close.
 * Never: removes a file that is not a socket, blocks after open, raises SIGPIPE.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "driver/drv_backend.h"

/* Bytes the kernel may queue one way: some 20 telegrams.  More would only age. */
enum { SEND_QUEUE_BYTES = 8192 };

struct unix_bus {
    enum hdt_bus_side side;
    int listen_fd;           /* servo side; else -1 */
    int fd;                  /* connected; -1 while no peer */
    struct sockaddr_un addr;
    dev_t dev;               /* of the socket file we made */
    ino_t ino;
};

static int set_up(int fd)
{
    int flags = fcntl(fd, F_GETFL);
    int bytes = SEND_QUEUE_BYTES;
    if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0 ||
        fcntl(fd, F_SETFD, FD_CLOEXEC) < 0)
        return -1;
    /* a queue of the default size works too, it is only longer */
    (void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    return 0;
}

static int new_socket(void)
{
    int fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    if (fd >= 0 && set_up(fd) < 0) {
        close(fd);
        return -1;
    }
    return fd;
}

/* Returns a connected, non-blocking socket, or -1 and errno. */
static int connect_to(const struct sockaddr_un *addr)
{
    int fd = new_socket();
    if (fd < 0)
        return -1;
    if (connect(fd, (const struct sockaddr *)addr, sizeof *addr) < 0) {
        int e = errno;
        close(fd);
        errno = e;
        return -1;
    }
    return fd;
}

static void drop_peer(struct unix_bus *b)
{
    close(b->fd);
    b->fd = -1;
}

/* A peer, if one can be had without waiting. */
static int have_peer(struct unix_bus *b)
{
    if (b->fd >= 0)
        return 1;
    if (b->side == HDT_BUS_HOST) {
        b->fd = connect_to(&b->addr);
        return b->fd >= 0;
    }
    b->fd = accept(b->listen_fd, NULL, NULL);
    if (b->fd >= 0 && set_up(b->fd) < 0)
        drop_peer(b);
    return b->fd >= 0;
}

static int unix_send(void *ctx, const struct hdt_frame *f)
{
    struct unix_bus *b = ctx;
    if (f->len == 0 || f->len > HDT_FRAME_MAX)
        return HDT_BUS_ERR_FRAME;
    if (!have_peer(b))
        return HDT_BUS_ERR_DOWN;
    if (send(b->fd, f->data, f->len, MSG_NOSIGNAL) >= 0)
        return HDT_BUS_OK;
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS || errno == EINTR)
        return HDT_BUS_ERR_AGAIN;
    drop_peer(b);
    return HDT_BUS_ERR_DOWN;
}

static int unix_recv(void *ctx, struct hdt_frame *f)
{
    struct unix_bus *b = ctx;
    uint8_t buf[HDT_FRAME_MAX + 1]; /* one more, so that a longer packet shows */
    if (!have_peer(b))
        return HDT_BUS_ERR_DOWN;
    ssize_t n = recv(b->fd, buf, sizeof buf, 0);
    if (n > HDT_FRAME_MAX)
        return HDT_BUS_ERR_FRAME;
    if (n > 0) {
        memcpy(f->data, buf, (size_t)n);
        f->len = (uint16_t)n;
        return HDT_BUS_OK;
    }
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR))
        return HDT_BUS_ERR_AGAIN;
    /* end of file or reset: the peer is gone */
    drop_peer(b);
    return HDT_BUS_ERR_DOWN;
}

static int unix_fd(void *ctx)
{
    const struct unix_bus *b = ctx;
    return b->fd >= 0 ? b->fd : b->listen_fd;
}

static void unix_close(void *ctx)
{
    struct unix_bus *b = ctx;
    struct stat st;
    if (b->fd >= 0)
        close(b->fd);
    if (b->listen_fd >= 0) {
        /* another servo may have taken the path over: only our own file goes */
        if (lstat(b->addr.sun_path, &st) == 0 && st.st_dev == b->dev && st.st_ino == b->ino)
            (void)unlink(b->addr.sun_path);
        close(b->listen_fd);
    }
    free(b);
}

/* The path is taken: clear it if it is a socket nobody listens on. */
static int clear_stale(const struct sockaddr_un *addr, char *err, size_t errlen)
{
    struct stat st;
    const char *path = addr->sun_path;
    if (lstat(path, &st) < 0)
        return errno == ENOENT ? HDT_BUS_OK
                               : drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%s: %s", path,
                                              strerror(errno));
    if (!S_ISSOCK(st.st_mode))
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "unix:%s: is there already and is no socket: remove it or choose "
                            "another path",
                            path);
    int fd = connect_to(addr);
    if (fd >= 0 || errno == EAGAIN) {
        if (fd >= 0)
            close(fd);
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "unix:%s: another servo listens there: stop it or choose another path",
                            path);
    }
    if (errno != ECONNREFUSED)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "unix:%s: a socket is there but cannot be tried: %s", path,
                            strerror(errno));
    if (unlink(path) < 0 && errno != ENOENT)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "unix:%s: stale socket cannot be removed: %s", path, strerror(errno));
    return HDT_BUS_OK;
}

static int open_servo(struct unix_bus *b, char *err, size_t errlen)
{
    const char *path = b->addr.sun_path;
    struct stat st;
    b->listen_fd = new_socket();
    if (b->listen_fd < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%s: no socket: %s", path,
                            strerror(errno));
    int e = bind(b->listen_fd, (const struct sockaddr *)&b->addr, sizeof b->addr);
    if (e < 0 && errno == EADDRINUSE) {
        int cleared = clear_stale(&b->addr, err, errlen);
        if (cleared != HDT_BUS_OK)
            return cleared;
        e = bind(b->listen_fd, (const struct sockaddr *)&b->addr, sizeof b->addr);
    }
    if (e < 0)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%s: cannot be made: %s", path,
                            strerror(errno));
    if (listen(b->listen_fd, 4) < 0 || lstat(path, &st) < 0) {
        e = drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%s: cannot listen: %s", path,
                         strerror(errno));
        (void)unlink(path);
        return e;
    }
    b->dev = st.st_dev;
    b->ino = st.st_ino;
    return HDT_BUS_OK;
}

static int open_host(struct unix_bus *b, char *err, size_t errlen)
{
    const char *path = b->addr.sun_path;
    b->fd = connect_to(&b->addr);
    if (b->fd >= 0)
        return HDT_BUS_OK;
    if (errno == ENOENT || errno == ECONNREFUSED)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen,
                            "unix:%s: no servo listens there: start it first "
                            "(hdt servo --bus unix:%s)",
                            path, path);
    return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%s: cannot connect: %s", path,
                        strerror(errno));
}

int drv_unix_open(struct hdt_bus *bus, const char *path, enum hdt_bus_side side, char *err,
                  size_t errlen)
{
    size_t len = strlen(path);
    if (len == 0)
        return drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                            "unix: without a path: expected unix:PATH");
    struct unix_bus *b = calloc(1, sizeof *b);
    if (b == NULL)
        return drv_bus_fail(HDT_BUS_ERR_DOWN, err, errlen, "unix:%.100s: out of memory", path);
    if (len >= sizeof b->addr.sun_path) {
        int e = drv_bus_fail(HDT_BUS_ERR_NAME, err, errlen,
                             "unix:%.40s...: path of %lu bytes, at most %lu: choose a shorter one",
                             path,
                             (unsigned long)len, (unsigned long)sizeof b->addr.sun_path - 1);
        free(b);
        return e;
    }
    b->side = side;
    b->fd = b->listen_fd = -1;
    b->addr.sun_family = AF_UNIX;
    memcpy(b->addr.sun_path, path, len + 1);
    int e = side == HDT_BUS_SERVO ? open_servo(b, err, errlen) : open_host(b, err, errlen);
    if (e != HDT_BUS_OK) {
        if (b->listen_fd >= 0)
            close(b->listen_fd);
        free(b);
        return e;
    }
    *bus = (struct hdt_bus){
        .ctx = b, .send = unix_send, .recv = unix_recv, .close = unix_close, .fd = unix_fd};
    return HDT_BUS_OK;
}
