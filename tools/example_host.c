/* SPDX-License-Identifier: Apache-2.0 */
/* A servo host: loads the plugin, takes the arm over where it stands and holds it for a few seconds.
 *   example_host PLUGIN.so ARM.hdtm BUS [SECONDS]        tables: hdt gen; bus: unix:PATH, can:IFACE */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "driver/hdt_plugin.h"

static uint64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

int main(int argc, char **argv)
{
    static unsigned char image[1 << 17];
    static struct hdt_in in;
    static struct hdt_out out;
    static const struct hdt_plugin_host me = HDT_PLUGIN_HOST;
    struct hdt_plugin_arm *arm = NULL;
    struct hdt_plugin_info info;
    char why[256] = "";
    FILE *file = argc > 3 ? fopen(argv[2], "rb") : NULL;
    void *so = argc > 3 ? dlopen(argv[1], RTLD_NOW) : NULL;
    const struct hdt_plugin *p = so ? (const struct hdt_plugin *)dlsym(so, HDT_PLUGIN_SYMBOL) : NULL;
    if (!file || !p || p->abi.major != HDT_PLUGIN_ABI_MAJOR) {
        const char *trouble = !file ? "PLUGIN.so ARM.hdtm BUS?" : so ? "another ABI" : dlerror();
        fprintf(stderr, "example_host: %s\n", trouble);
        return 3;
    }
    size_t size = fread(image, 1, sizeof image, file);
    const struct hdt_plugin_bus *bus = (const struct hdt_plugin_bus *)p->extension(HDT_PLUGIN_EXT_BUS);
    const struct hdt_plugin_names *names =
        (const struct hdt_plugin_names *)p->extension(HDT_PLUGIN_EXT_NAMES);
    int e = p->create(&me, calloc(1, p->memory_bytes), p->memory_bytes, &arm);
    if (e == 0) e = p->load(arm, image, size, why, sizeof why);
    if (e == 0) e = bus->open(arm, argv[3], DRV_FORMAT_A, NULL, why, sizeof why);
    if (e == 0) e = p->info(arm, &info);
    if (e == 0) e = p->start(arm);
    if (e != 0) {
        fprintf(stderr, "example_host: %s: %s\n", p->strerror(e), why);
        return 3;
    }
    double seconds = argc > 4 ? atof(argv[4]) : 2;
    uint64_t start = now_ns(), due = start;
    in.active = (1u << info.joints) - 1;
    while (e == 0 && out.fault == 0 && 1e-9 * (double)(due - start) < seconds) {
        due += info.period_ns;                          /* from here on nothing allocates, locks or prints */
        struct timespec t = {.tv_sec = (time_t)(due / 1000000000u), .tv_nsec = (long)(due % 1000000000u)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        uint64_t now = now_ns();
        due += now > due ? (now - due) / info.period_ns * info.period_ns : 0; /* missed: never made up */
        in.t_us = now / 1000u;
        if (in.mode == HDT_MODE_IDLE)                   /* brakes are on until a state has come */
            memcpy(in.q_ref, out.q, sizeof in.q_ref);   /* hold where it stands */
        in.mode = in.fresh ? HDT_MODE_TORQUE : in.mode;
        e = bus->period(arm, &in, &out);
    }
    int end = p->stop(arm);                             /* brakes on, and the servo has said so */
    for (uint32_t j = 0; j < info.joints; j++)
        printf("joint %u  %8.4f rad  %7.2f N m\n", (unsigned)j + 1, out.q[j].raw / 16777216.0,
               out.total[j].raw / 65536.0);
    printf("%s: %s, fault %s, end %s\n", info.name, p->strerror(e), names->fault(out.fault),
           p->strerror(end));
    return e != 0 || out.fault != 0 || end != 0 || p->destroy(arm) != 0;
}
