/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The POSIX monotonic clock.
 *
 * Owns: nothing.
 * Never: looks at the wall clock, which may be set while the arm moves.
 */
#include <errno.h>
#include <time.h>

#include "driver/hdt_bus.h"

static uint64_t posix_now_ns(void *ctx)
{
    struct timespec t;
    (void)ctx;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static int posix_sleep_until_ns(void *ctx, uint64_t t_ns)
{
    struct timespec t;
    (void)ctx;
    t.tv_sec = (time_t)(t_ns / 1000000000u);
    t.tv_nsec = (long)(t_ns % 1000000000u);
    return -clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
}

struct hdt_clock hdt_clock_posix(void)
{
    return (struct hdt_clock){
        .ctx = NULL, .now_ns = posix_now_ns, .sleep_until_ns = posix_sleep_until_ns};
}
