/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What our buses cost over the bare thing: a round trip of a command and its state through codec and
 * backend, beside a ping-pong of the same bytes over a socket of the same kind, in turns in one run;
 * and what a cycle costs over the core's step alone.
 *
 *   usage: bench_bus [BUS...]      default: unix: in a temporary directory, loop:
 *
 * Exit 0 when every p50 over a socket is at most 1.2 times the bare one's, 1 when not, 3 for a bus that
 * cannot be opened.  loop: has no socket and is not judged: the bare thing is two copies of memory.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <linux/can.h>
#include <linux/can/isotp.h>
#include <linux/can/raw.h>

#include "driver/drv_backend.h"
#include "driver/drv_cycle.h"
#include "driver/drv_telegram.h"
#include "tests/driver_rig.h"

enum { TRIPS = 200, ROUNDS = 40, DOWN = DRV_COMMAND_LEN, UP = DRV_STATE_LEN };
#define MOST 1.2

static uint64_t now_ns(void)
{
    struct hdt_clock c = hdt_clock_posix();
    return c.now_ns(c.ctx);
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static double quantile(double *v, size_t n, double q)
{
    qsort(v, n, sizeof *v, by_size);
    return v[(size_t)(q * (double)(n - 1))];
}

static void wait_for(int fd)
{
    struct pollfd p = {.fd = fd, .events = POLLIN};
    while (poll(&p, 1, 5000) < 0 && errno == EINTR) { }
}

/* ---- the bare thing ---- */

/* Bytes as they are on that socket: telegrams, or CAN FD frames with them. */
struct bare { int fd; size_t down, up; canid_t id; };

static int bare_can(const char *iface, int isotp, int host, struct bare *b)
{
    struct sockaddr_can a = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(iface)};
    int on = 1;
    canid_t mine = host ? 0x3ffu : 0x3feu, theirs = host ? 0x3feu : 0x3ffu;
    struct can_filter filter = {.can_id = mine, .can_mask = CAN_SFF_MASK};
    struct can_isotp_options options = {.frame_txtime = CAN_ISOTP_FRAME_TXTIME_ZERO};
    struct can_isotp_fc_options pace = {.bs = DRV_ISOTP_BLOCK};
    b->fd = socket(AF_CAN, (isotp ? SOCK_DGRAM : SOCK_RAW) | SOCK_NONBLOCK, isotp ? CAN_ISOTP : CAN_RAW);
    b->id = theirs;
    b->down = isotp ? DOWN : sizeof(struct canfd_frame);
    b->up = isotp ? UP : sizeof(struct canfd_frame);
    a.can_addr.tp.tx_id = theirs;
    a.can_addr.tp.rx_id = mine;
    if (b->fd < 0)
        return -1;
    if (isotp && (setsockopt(b->fd, SOL_CAN_ISOTP, CAN_ISOTP_OPTS, &options, sizeof options) < 0 ||
                  setsockopt(b->fd, SOL_CAN_ISOTP, CAN_ISOTP_RECV_FC, &pace, sizeof pace) < 0))
        return -1;
    if (!isotp && (setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) < 0 ||
                   setsockopt(b->fd, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) < 0))
        return -1;
    return bind(b->fd, (struct sockaddr *)&a, sizeof a);
}

static void fill(const struct bare *b, uint8_t *bytes, size_t len, unsigned telegram)
{
    struct canfd_frame c = {.can_id = b->id, .len = (uint8_t)drv_can_padded(telegram), .flags = CANFD_BRS};
    memset(bytes, 0, len);
    if (len == sizeof c)
        memcpy(bytes, &c, sizeof c);
}

static void bare_echo(const struct bare *b)
{
    uint8_t in[128], out[128];
    fill(b, out, b->up, UP);
    for (;;) {
        wait_for(b->fd);
        while (read(b->fd, in, sizeof in) > 0)
            if (write(b->fd, out, b->up) < 0)
                _exit(4);
    }
}

static void bare_trips(const struct bare *b, double *us)
{
    uint8_t in[128], out[128];
    fill(b, out, b->down, DOWN);
    for (int k = 0; k < TRIPS; k++) {
        uint64_t start = now_ns();
        if (write(b->fd, out, b->down) < 0)
            exit(4);
        do
            wait_for(b->fd);
        while (read(b->fd, in, sizeof in) < 0);
        us[k] = (double)(now_ns() - start) * 1e-3;
    }
}

/* ---- ours ---- */

static void our_echo(const struct hdt_bus *bus)
{
    struct rig_servo servo = {.bus = *bus};
    for (;;) {
        wait_for(bus->fd(bus->ctx));
        rig_serve(&servo);
    }
}

static int our_trip(const struct hdt_bus *bus, struct drv_command *c, struct drv_state *s)
{
    struct hdt_frame f;
    c->seq = (uint8_t)((c->seq + 1u) & 0x7fu);
    if (drv_command_encode(DRV_FORMAT_A, c, &f) != 0 || bus->send(bus->ctx, &f) != HDT_BUS_OK)
        return -1;
    int e;
    do
        wait_for(bus->fd(bus->ctx));
    while ((e = bus->recv(bus->ctx, &f)) == HDT_BUS_ERR_AGAIN);
    return e == HDT_BUS_OK && drv_state_decode(DRV_FORMAT_A, &f, s) == 0 && s->seq == c->seq ? 0 : -1;
}

static void our_trips(const struct hdt_bus *bus, double *us)
{
    struct drv_command c = {.type = DRV_CYCLIC};
    struct drv_state s;
    for (int k = 0; k < TRIPS; k++) {
        uint64_t start = now_ns();
        if (our_trip(bus, &c, &s) != 0) {
            fprintf(stderr, "bench_bus: a trip failed\n");
            exit(4);
        }
        us[k] = (double)(now_ns() - start) * 1e-3;
    }
}

/* ---- over a socket ---- */

static pid_t child(void)
{
    pid_t pid = fork();
    if (pid == 0)
        (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    return pid;
}

static int bare_pair(const char *name, struct bare ends[2])
{
    int fd[2], isotp = strncmp(name, "isotp:", 6) == 0;
    if (strncmp(name, "unix:", 5) != 0)
        return bare_can(strchr(name, ':') + 1, isotp, 1, &ends[0]) < 0 ||
               bare_can(strchr(name, ':') + 1, isotp, 0, &ends[1]) < 0 ? -1 : 0;
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK, 0, fd) < 0)
        return -1;
    for (int k = 0; k < 2; k++)
        ends[k] = (struct bare){.fd = fd[k], .down = DOWN, .up = UP};
    return 0;
}

/* 0, 1 when over the bound, 3 when it cannot be opened. */
static int over_socket(const char *name)
{
    static double bare_us[TRIPS * ROUNDS], our_us[TRIPS * ROUNDS];
    struct hdt_bus host, servo;
    struct bare ends[2];
    char err[300];
    if (hdt_bus_open(&servo, name, HDT_BUS_SERVO, err, sizeof err) != 0 ||
        hdt_bus_open(&host, name, HDT_BUS_HOST, err, sizeof err) != 0) {
        fprintf(stderr, "bench_bus: %s\n", err);
        return 3;
    }
    if (bare_pair(name, ends) < 0) {
        fprintf(stderr, "bench_bus: %s: no bare socket: %s\n", name, strerror(errno));
        return 3;
    }
    pid_t bare = child();
    if (bare == 0)
        bare_echo(&ends[1]);
    pid_t ours = child();
    if (ours == 0)
        our_echo(&servo);
    bare_trips(&ends[0], bare_us); /* warm */
    our_trips(&host, our_us);
    for (int k = 0; k < ROUNDS; k++) {
        bare_trips(&ends[0], bare_us + TRIPS * k);
        our_trips(&host, our_us + TRIPS * k);
    }
    kill(bare, SIGKILL);
    kill(ours, SIGKILL);
    waitpid(bare, NULL, 0);
    waitpid(ours, NULL, 0);
    close(ends[0].fd);
    close(ends[1].fd);
    hdt_bus_close(&host);
    hdt_bus_close(&servo);
    size_t n = TRIPS * ROUNDS;
    double b = quantile(bare_us, n, 0.5), o = quantile(our_us, n, 0.5);
    printf("%-24.24s p50 %8.2f us, bare %8.2f us: %.2f times (at most %.1f asked); p99 %8.2f, bare %8.2f\n",
           name, o, b, o / b, MOST, quantile(our_us, n, 0.99), quantile(bare_us, n, 0.99));
    return o / b <= MOST ? 0 : 1;
}

/* ---- in memory, and the cycle ---- */

/* Nanoseconds of one call, the median of rounds of many. */
#define NS_OF(statement)                                       \
    for (int r_ = 0; r_ < ROUNDS; r_++) {                      \
        uint64_t start_ = now_ns();                            \
        for (int k_ = 0; k_ < 50 * TRIPS; k_++) { statement; } \
        ns[r_] = (double)(now_ns() - start_) / (50 * TRIPS);   \
    }

static void in_memory(void)
{
    static struct drv_loop loop;
    static struct drv_cycle cycle;
    static struct hdt_in in;
    static struct hdt_out out;
    static uint8_t from[DOWN], to[UP], back[UP];
    double ns[ROUNDS], bare, step;
    struct hdt_bus host, end;
    struct drv_command c = {.type = DRV_CYCLIC};
    drv_loop_pair(&loop, &host, &end);
    struct rig_servo servo = {.bus = end};
    struct hdt_frame down = {.len = DOWN}, up = {.len = UP}, f;
    NS_OF(memcpy(to, from, DOWN); __asm__ volatile("" ::: "memory"); memcpy(back, to, UP);
          __asm__ volatile("" ::: "memory"))
    bare = quantile(ns, ROUNDS, 0.5);
    NS_OF(host.send(host.ctx, &down); end.recv(end.ctx, &f); end.send(end.ctx, &up); host.recv(host.ctx, &f))
    printf("%-24s p50 %8.1f ns, two copies %.1f ns (not judged)\n", "loop:, bytes only",
           quantile(ns, ROUNDS, 0.5), bare);
    NS_OF((void)drv_command_encode(DRV_FORMAT_A, &c, &f); host.send(host.ctx, &f); rig_serve(&servo);
          host.recv(host.ctx, &f); (void)drv_state_decode(DRV_FORMAT_A, &f, &servo.state))
    printf("%-24s p50 %8.1f ns\n", "loop:, with the codec", quantile(ns, ROUNDS, 0.5));
    (void)drv_cycle_init(&cycle, rig_tables(), &host, NULL);
    in.mode = HDT_MODE_TORQUE;
    in.active = 0x7f;
    uint64_t t = 0;
    NS_OF(in.t_us = t += 1429; (void)drv_cycle_period(&cycle, &in, &out); rig_serve(&servo))
    double whole = quantile(ns, ROUNDS, 0.5);
    hdt_t core;
    (void)hdt_init(&core, rig_tables());
    struct hdt_in alone = cycle.rec.in;
    NS_OF(alone.t_us = t += 1429; alone.count_us = t; (void)hdt_step(&core, &alone, &out))
    step = quantile(ns, ROUNDS, 0.5);
    printf("%-24s p50 %8.1f ns, of them hdt_step %.1f ns: %.1f ns for telegrams, bus and both ends\n",
           "cycle over loop:", whole, step, whole - step);
}

int main(int argc, char **argv)
{
    char dir[] = P_tmpdir "/hdt_bench_XXXXXX", unix_name[80];
    char *defaults[] = {argv[0], unix_name, (char *)(uintptr_t) "loop:"};
    cpu_set_t one;
    int worst = 0;
    if (mkdtemp(dir) == NULL)
        return 3;
    snprintf(unix_name, sizeof unix_name, "unix:%s/bus", dir);
    if (argc < 2) {
        argc = 3;
        argv = defaults;
    }
    /* all on one processor: then a trip is four system calls and two switches, and nothing else */
    CPU_ZERO(&one);
    CPU_SET(0, &one);
    (void)sched_setaffinity(0, sizeof one, &one);
    for (int k = 1; k < argc; k++) {
        if (strcmp(argv[k], "loop:") == 0) {
            in_memory();
            continue;
        }
        int e = over_socket(argv[k]);
        worst = e > worst ? e : worst;
    }
    (void)rmdir(dir);
    return worst;
}
