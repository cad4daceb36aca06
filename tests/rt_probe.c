/* SPDX-License-Identifier: Apache-2.0 */
/* A loop that does what a control thread must not, for rt_shim to catch: nothing, malloc, open. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void *loop(void *what)
{
    struct timespec t;
    void *volatile own = malloc(1); /* this thread's own heap is there */
    free(own);
    clock_gettime(CLOCK_MONOTONIC, &t);
    for (int n = 0; n < 10; n++) {
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        if (n == 5 && strcmp(what, "malloc") == 0) {
            void *volatile p = malloc(17);
            free(p);
        }
        if (n == 5 && strcmp(what, "open") == 0)
            (void)!open("/dev/null", O_RDONLY);
    }
    return NULL;
}

int main(int argc, char **argv)
{
    pthread_t thread;
    return argc != 2 || pthread_create(&thread, NULL, loop, argv[1]) != 0 || pthread_join(thread, NULL) != 0;
}
