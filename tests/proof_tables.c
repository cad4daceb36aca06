/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hdt_tables_read for Frama-C's Eva: any bytes, any length; and hdt_init on any memory as tables.
 *
 * The bytes that say how many joints there are take each of the 16 values in a run of its own (JOINTS), and
 * in one run (JOINTS 0) all others.
 *
 * Never: compiled into anything that runs.
 */
#include "ctrl/hdt.h"
#include <__fc_builtin.h>

#define MORE 16 /* bytes beyond the longest image */

static uint8_t image[65536];
static struct hdt_tables tables;
static hdt_t core;

int main(void)
{
    const size_t most = hdt_tables_size(JOINTS == 0 ? 16 : JOINTS) + MORE;
    const size_t size = (size_t)Frama_C_interval(0, (int)most);
    Frama_C_make_unknown((char *)image, most);
    /* bytes 72 to 75, little endian */
    if (JOINTS != 0) {
        image[72] = JOINTS;
        image[73] = image[74] = image[75] = 0;
    } else if (Frama_C_interval(0, 1)) {
        image[72] = (uint8_t)Frama_C_interval(17, 255);
        image[73] = image[74] = image[75] = 0;
    } else {
        image[73] = (uint8_t)Frama_C_interval(1, 255);
    }
    const int e = hdt_tables_read(image, size, &tables);

    /* and the check by itself, and what it lets through to hdt_init */
    Frama_C_make_unknown((char *)&tables, sizeof tables);
    if (JOINTS != 0)
        tables.joints = JOINTS;
    return e + hdt_init(&core, &tables);
}
