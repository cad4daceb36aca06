/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Loaded before a program (LD_PRELOAD), watches its control thread: the one that sleeps to absolute
 * times.  From its first sleep to its last,
 *   - every call of the malloc family is counted,
 *   - every system call is allowed only if it is one the loop may make: sleep, clock, and a bus'
 *     non-blocking send, receive, connect; any other ends the program at once, by name.
 * What comes between the last sleep and the thread's end is set-down and not counted.
 *
 * Prints "rt_shim: N sleeps, M allocations" at the end; exit code 97 for a system call.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
extern void __libc_free(void *p);

static __thread int control;              /* 1: in the loop */
static __thread unsigned long since;      /* allocations since the last sleep */
static unsigned long sleeps, allocations;

void *malloc(size_t size) { since += (unsigned long)control; return __libc_malloc(size); }
void *calloc(size_t n, size_t size) { since += (unsigned long)control; return __libc_calloc(n, size); }
void *realloc(void *p, size_t size) { since += (unsigned long)control; return __libc_realloc(p, size); }
void free(void *p) { since += (unsigned long)(control && p != NULL); __libc_free(p); }

/* SIGSYS: say which call, and end.  Only the offending thread's own filter brings us here. */
static void on_forbidden(int sig, siginfo_t *info, void *context)
{
    char text[64];
    int n = info->si_syscall, at = 63;
    (void)sig;
    (void)context;
    memcpy(text, "rt_shim: the control thread made system call ", 45);
    text[--at] = '\n';
    do
        text[--at] = (char)('0' + n % 10);
    while ((n /= 10) != 0);
    (void)!write(2, text, 45);
    (void)!write(2, text + at, (size_t)(63 - at));
    _exit(97);
}

#define ALLOW(nr) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (nr), 0, 1), \
                  BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)

static void forbid(void)
{
    static struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        ALLOW(SYS_clock_nanosleep), ALLOW(SYS_clock_gettime),
        ALLOW(SYS_sendto), ALLOW(SYS_recvfrom), ALLOW(SYS_recvmsg), ALLOW(SYS_sendmsg),
        ALLOW(SYS_socket), ALLOW(SYS_connect), ALLOW(SYS_close), ALLOW(SYS_fcntl), ALLOW(SYS_setsockopt),
        /* for the handler, and how a thread ends */
        ALLOW(SYS_write), ALLOW(SYS_exit_group), ALLOW(SYS_exit), ALLOW(SYS_rt_sigreturn),
        ALLOW(SYS_rt_sigprocmask), ALLOW(SYS_madvise), ALLOW(SYS_munmap),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP),
    };
    struct sock_fprog program = {sizeof filter / sizeof filter[0], filter};
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_sigaction = on_forbidden;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGSYS, &action, NULL);
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) {
        fprintf(stderr, "rt_shim: no seccomp filter on this kernel\n");
        _exit(98);
    }
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *t, struct timespec *left)
{
    if (!control && (flags & TIMER_ABSTIME) != 0) {
        control = 1;
        since = 0;
        forbid();
    }
    if (control) {
        __atomic_fetch_add(&sleeps, 1, __ATOMIC_RELAXED);
        __atomic_fetch_add(&allocations, since, __ATOMIC_RELAXED);
        since = 0;
    }
    return syscall(SYS_clock_nanosleep, clock, flags, t, left) == 0 ? 0 : errno;
}

__attribute__((destructor)) static void say(void)
{
    fprintf(stderr, "rt_shim: %lu sleeps, %lu allocations\n", sleeps, allocations);
}
