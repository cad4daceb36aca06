/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a real-time thread asks of a POSIX system: priority, memory that stays, a stack that is there.
 * Binding to a processor is not POSIX: drv_rt_linux.c, and a refusal elsewhere.
 *
 * Owns: the asking, and the words where it is refused.
 * Never: fails a run for it: a host on a desk is worth having too.
 */
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <errno.h>

#include "driver/drv_backend.h"
#include "driver/drv_rt.h"

#define STACK_BYTES 65536u /* more than the loop and all below it take */

/* Touch the stack, a page at a time, so that no page of it faults later. */
static void touch_stack(void)
{
    volatile unsigned char stack[STACK_BYTES];
    for (unsigned k = 0; k < STACK_BYTES; k += 1024)
        stack[k] = 1;
    (void)stack[0];
}

static void refuse(char *line, size_t len, const char *what, int e, const char *remedy)
{
    size_t used = strlen(line);
    if (used < len)
        (void)snprintf(line + used, len - used, "%s%s (%s): %s", used != 0 ? "; " : "", what, strerror(e),
                       remedy);
}

int drv_rt_enter(const struct drv_rt_wish *wish, char *line, size_t len)
{
    int refused = 0, e;
    char none[1] = "";
    if (line == NULL || len == 0) {
        line = none;
        len = sizeof none;
    }
    line[0] = '\0';
    if (wish->lock_memory && mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
        refuse(line, len, "memory is not locked", errno, "raise the memlock limit (ulimit -l unlimited)");
        refused++;
    }
    if (wish->cpu >= 0 && (e = drv_rt_bind_cpu(wish->cpu)) != 0) {
        refuse(line, len, "not bound to the processor", e, "choose one that is there and allowed");
        refused++;
    }
    if (wish->priority > 0) {
        struct sched_param p;
        memset(&p, 0, sizeof p);
        p.sched_priority = wish->priority;
        e = pthread_setschedparam(pthread_self(), SCHED_FIFO, &p);
        if (e != 0) {
            refuse(line, len, "no real-time priority", e,
                   "run as root or raise the rtprio limit (ulimit -r 99)");
            refused++;
        }
    }
    touch_stack();
    return refused;
}
