/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hdt_tables_read for Frama-C's Eva: any bytes, any length; and hdt_init on any memory as tables.
 *
 * The bytes that say how many joints there are take each of the 16 values in a run of its own (JOINTS), and
 * in one run (JOINTS 0) all others.  Frama_C_show_each tells tools/check-proof that the end of each part is
 * reached, and with which results: an analysis that stops early has no alarms either.
 *
 * Never: compiled into anything that runs.
 */
#include "ctrl/hdt.h"
#include <__fc_builtin.h>

#define MORE 16     /* bytes beyond the longest image */
#define MOST 131072 /* longer than the image of 16 joints */

static uint8_t image[MOST];
static struct hdt_tables tables;
static hdt_t core;

/* Any bytes and any length; byte `at` of the image is lo to hi, one of the four that count the joints;
 * those above it are 0, those below anything if `below` and else 0. */
static void read_any(int at, int lo, int hi, int below)
{
    const size_t most = hdt_tables_size(JOINTS == 0 ? 16 : JOINTS) + MORE;
    const size_t size = (size_t)Frama_C_interval(0, (int)most);
    Frama_C_make_unknown((char *)image, most);
    /*@ loop unroll 4; */
    for (int i = 72; i < 76; i++)
        if (i > at || !below)
            image[i] = 0;
    image[at] = (uint8_t)Frama_C_interval(lo, hi);
    const int read = hdt_tables_read(image, size, &tables);
    Frama_C_show_each_read(read);
}

/* The check on any memory of that many joints, and what it lets through to hdt_init. */
static void init_any(uint32_t joints)
{
    Frama_C_make_unknown((char *)&tables, sizeof tables);
    tables.joints = joints;
    const int init = hdt_init(&core, &tables);
    Frama_C_show_each_init(init);
}

int main(void)
{
    if (JOINTS != 0) {
        read_any(72, JOINTS, JOINTS, 0);
        init_any(JOINTS);
        return 0;
    }
    read_any(72, 0, 0, 0);
    read_any(72, 17, 255, 0);
    read_any(73, 1, 255, 1);
    read_any(74, 1, 255, 1);
    read_any(75, 1, 255, 1);
    init_any(0);
    init_any((uint32_t)Frama_C_interval(17, INT32_MAX));
    init_any((uint32_t)Frama_C_interval(0, INT32_MAX) | (uint32_t)1 << 31);
    return 0;
}
