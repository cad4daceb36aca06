/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Binding a thread to a processor, which POSIX does not have.
 *
 * Owns: one call.
 */
#ifdef __linux__
#define _GNU_SOURCE /* cpu_set_t */
#endif
#include <errno.h>

#include "driver/drv_backend.h"

#ifdef __linux__

#include <sched.h>

int drv_rt_bind_cpu(int cpu)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    if (cpu < 0 || cpu >= CPU_SETSIZE)
        return EINVAL;
    CPU_SET((unsigned)cpu, &set);
    /* 0: the calling thread */
    return sched_setaffinity(0, sizeof set, &set) == 0 ? 0 : errno;
}

#else

int drv_rt_bind_cpu(int cpu)
{
    (void)cpu;
    return ENOTSUP;
}

#endif
