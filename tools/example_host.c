/* SPDX-License-Identifier: Apache-2.0 */
/* A servo host: loads the plugin, takes the arm over where it stands and holds it for a few seconds.
 *   example_host PLUGIN.so ARM.hdtm BUS [SECONDS]        tables: hdt gen; bus: unix:PATH, can:IFACE */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "driver/hdt_plugin.h"

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
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    in.active = (1u << info.joints) - 1;
    for (double s = 0; s < seconds && out.fault == 0; s += 1e-9 * info.period_ns) {
        t.tv_nsec += (long)info.period_ns;              /* from here on nothing allocates, locks or prints */
        if (t.tv_nsec >= 1000000000) t.tv_sec++, t.tv_nsec -= 1000000000;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        in.t_us = (uint64_t)t.tv_sec * 1000000u + (uint64_t)t.tv_nsec / 1000u;
        if (in.mode == HDT_MODE_IDLE)                   /* brakes are on until a state has come */
            memcpy(in.q_ref, out.q, sizeof in.q_ref);   /* hold where it stands */
        in.mode = in.fresh ? HDT_MODE_TORQUE : in.mode;
        bus->period(arm, &in, &out);
    }
    e = p->stop(arm);                                   /* brakes on, and the servo has said so */
    for (uint32_t j = 0; j < info.joints; j++)
        printf("joint %u  %8.4f rad  %7.2f N m\n", (unsigned)j + 1, out.q[j].raw / 16777216.0,
               out.total[j].raw / 65536.0);
    printf("%s: fault %s, end %s\n", info.name, names->fault(out.fault), p->strerror(e));
    return out.fault != 0 || e != 0 || p->destroy(arm) != 0;
}
