/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The driver on nothing but C99 and POSIX 2008: no Check, no Linux, one program for tools/check-posix
 * to build with another C library.  What it prints has to be the same on every system.
 *
 *   posix_loop DIRECTORY      runs a host over loop:, then over unix: with the servo in a process of
 *                             its own, writes a log there, reads it back and replays it
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include "driver/drv_rt.h"
#include "tests/driver_rig.h"

#define SAMPLES 400u

static hdt_rad_t q[SAMPLES * DRV_AXES];
static hdt_radps_t v[SAMPLES * DRV_AXES];
static hdt_radps2_t a[SAMPLES * DRV_AXES];
static struct drv_host host;
static struct drv_record slots[8192];
static struct drv_ring ring;

static void die(const char *what)
{
    fprintf(stderr, "posix_loop: %s\n", what);
    exit(1);
}

static struct drv_reference reference(void)
{
    for (unsigned k = 0; k < SAMPLES; k++)
        for (unsigned j = 0; j < DRV_AXES; j++) {
            q[k * DRV_AXES + j].raw = (int32_t)(k * k * (j + 1u));
            v[k * DRV_AXES + j].raw = (int32_t)(1400u * k * (j + 1u));
        }
    return (struct drv_reference){SAMPLES, DRV_AXES, 0x7f, q, v, a};
}

static void start(const struct hdt_bus *bus)
{
    struct drv_reference ref = reference();
    struct drv_host_cfg cfg = {.mode = HDT_MODE_TORQUE, .settle_s = 0.05};
    if (drv_ring_init(&ring, slots, 8192) != 0
        || drv_host_init(&host, rig_tables(), bus, &ring, &ref, &cfg) != HDT_OK)
        die("the host does not start");
}

/* Records through a log and the core again; returns a number made of every digit. */
static unsigned long replay(const char *dir)
{
    static struct drv_record rec;
    static struct hdt_out again;
    static hdt_t core;
    struct drv_writer_cfg cfg = {.tables = rig_tables()};
    char path[512], err[256];
    unsigned long sum = 0, n = 0;
    for (unsigned j = 0; j < DRV_AXES; j++)
        cfg.ratio[j] = RIG_RATIO;
    (void)snprintf(path, sizeof path, "%s/run.lcm", dir);
    struct drv_writer *w = drv_writer_open(path, &cfg, err, sizeof err);
    if (w == NULL)
        die(err);
    while (drv_ring_pop(&ring, &rec))
        (void)drv_writer_put(w, &rec);
    if (drv_writer_close(w, 1) != 0)
        die("the log cannot be closed");
    struct drv_reader *r = drv_reader_open(path, err, sizeof err);
    if (r == NULL || hdt_init(&core, rig_tables()) != HDT_OK)
        die(err);
    while (drv_reader_next(r, &rec) == 1) {
        if (hdt_step(&core, &rec.in, &again) != HDT_OK
            || memcmp(again.digit, rec.out.digit, sizeof again.digit) != 0)
            die("a replayed digit differs");
        n++;
        for (unsigned j = 0; j < DRV_AXES; j++)
            sum = (sum * 31u + (unsigned long)(uint16_t)again.digit[j].raw) & 0xffffffffu;
    }
    if (drv_reader_error(r)[0] != '\0' || n == 0)
        die(drv_reader_error(r));
    drv_reader_close(r);
    return sum;
}

static void over_loop(const char *dir)
{
    static struct drv_loop loop;
    static struct rig_servo servo;
    struct hdt_bus bus;
    drv_loop_pair(&loop, &bus, &servo.bus);
    start(&bus);
    for (uint64_t t_us = 1000; drv_host_period(&host, t_us) < DRV_HOST_DONE; t_us += 1429)
        rig_serve(&servo);
    printf("loop: %s, %llu periods, %llu lost, digits %08lx\n", drv_host_phase_str(host.phase),
           (unsigned long long)host.cycle.count.periods, (unsigned long long)host.cycle.count.lost,
           replay(dir));
}

/* The servo's process: answers until it is killed. */
static void serve(const char *name)
{
    static struct rig_servo servo;
    struct hdt_clock clock = hdt_clock_posix();
    char err[256];
    if (hdt_bus_open(&servo.bus, name, HDT_BUS_SERVO, err, sizeof err) != 0)
        die(err);
    for (;;) {
        rig_serve(&servo);
        (void)clock.sleep_until_ns(clock.ctx, clock.now_ns(clock.ctx) + 200000u);
    }
}

static void over_unix(const char *dir)
{
    static struct drv_rt rt;
    struct drv_rt_cfg cfg = {.overrun = DRV_OVERRUN_COUNT};
    struct drv_rt_wish wish = {.priority = 1, .cpu = -1, .lock_memory = 1};
    struct hdt_clock clock = hdt_clock_posix();
    struct hdt_bus bus;
    char name[512], line[512];
    (void)snprintf(name, sizeof name, "unix:%s/bus", dir);
    (void)fflush(stdout);
    pid_t servo = fork();
    if (servo == 0)
        serve(name);
    int opened = -1;
    for (unsigned n = 0; n < 500 && opened != 0; n++) {
        (void)clock.sleep_until_ns(clock.ctx, clock.now_ns(clock.ctx) + 10000000u);
        opened = hdt_bus_open(&bus, name, HDT_BUS_HOST, line, sizeof line);
    }
    if (opened != 0)
        die(line);
    start(&bus);
    if (drv_rt_enter(&wish, line, sizeof line) != 0)
        fprintf(stderr, "posix_loop: %s\n", line); /* may be refused: said, not fatal */
    if (drv_rt_init(&rt, &cfg, &clock, rig_tables()->period_ns, NULL, 0) != HDT_OK
        || drv_rt_run(&rt, &host) != 0)
        die("the loop does not run");
    hdt_bus_close(&bus);
    (void)kill(servo, SIGKILL);
    (void)waitpid(servo, NULL, 0);
    (void)unlink(name + strlen("unix:"));
    (void)replay(dir);
    printf("unix: %s, every sample played: %s, replies: %s\n", drv_host_phase_str(host.phase),
           host.sample == SAMPLES ? "yes" : "no", host.cycle.count.received > SAMPLES ? "yes" : "no");
}

int main(int argc, char **argv)
{
    char err[256];
    struct hdt_bus bus;
    if (argc != 2)
        die("usage: posix_loop DIRECTORY");
    over_loop(argv[1]);
    over_unix(argv[1]);
    /* what only Linux has is refused in words, not missing */
    if (hdt_bus_open(&bus, "can:nowhere0", HDT_BUS_HOST, err, sizeof err) == 0
        || strstr(err, "can:nowhere0") == NULL)
        die("can: on a system without it");
    return 0;
}
