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

/* Any bytes; those at 72 to 75, little endian, say JOINTS, or for 0 what is none of 1 to 16. */
static void any_image(size_t most)
{
    Frama_C_make_unknown((char *)image, most);
    if (JOINTS != 0) {
        image[72] = JOINTS;
        image[73] = image[74] = image[75] = 0;
        return;
    }
    const int where = Frama_C_interval(72, 75);
    image[73] = image[74] = image[75] = 0;
    image[72] = (uint8_t)Frama_C_interval(17, 255);
    if (where == 72) {
        image[72] = (uint8_t)(Frama_C_interval(0, 1) ? 0 : image[72]);
        return;
    }
    /* any of the upper three is not 0, the others anything */
    Frama_C_make_unknown((char *)image + 72, 4);
    if (where == 73)
        image[73] = (uint8_t)Frama_C_interval(1, 255);
    else if (where == 74)
        image[74] = (uint8_t)Frama_C_interval(1, 255);
    else
        image[75] = (uint8_t)Frama_C_interval(1, 255);
}

int main(void)
{
    const size_t most = hdt_tables_size(JOINTS == 0 ? 16 : JOINTS) + MORE;
    const size_t size = (size_t)Frama_C_interval(0, (int)most);
    any_image(most);
    const int read = hdt_tables_read(image, size, &tables);
    Frama_C_show_each_read(read);

    /* and the check by itself, and what it lets through to hdt_init */
    Frama_C_make_unknown((char *)&tables, sizeof tables);
    if (JOINTS != 0)
        tables.joints = JOINTS;
    else
        tables.joints = Frama_C_interval(0, 1) ? 0 : (uint32_t)Frama_C_interval(17, INT32_MAX) + (uint32_t)Frama_C_interval(0, INT32_MAX);
    const int init = hdt_init(&core, &tables);
    Frama_C_show_each_init(init);
    return read + init;
}
