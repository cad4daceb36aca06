/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The PA-10 with its servo driver, without any FMU, as a filter for tests/fmu_run.py.
 * First line in: seed and the 7 start angles, rad.  Then a line a step: ticks, and mode, speed (rad/s
 * output side) and torque (N.m motor side) of each axis.  A line out a step, the start included: angle,
 * link angle, link speed, motor torque, gear torque, status of each axis, 17 digits.
 *
 * Owns: nothing.  Never: compares.
 */
#include <inttypes.h>
#include <stdio.h>

#include "tests/fmu_direct.h"

static void print(const struct direct *d)
{
    for (int i = 0; i < DRV_AXES; i++) {
        struct direct_output o = direct_read(d, i);
        printf("%.17g %.17g %.17g %.17g %.17g %u%c", o.angle_rad, o.link_rad, o.link_radps, o.reported_m_nm,
               o.gear_nm, o.status, i + 1 < DRV_AXES ? ' ' : '\n');
    }
}

static int read_input(struct direct_input *in)
{
    for (int i = 0; i < DRV_AXES; i++)
        if (scanf("%d %lf %lf", &in->mode[i], &in->speed_radps[i], &in->torque_m_nm[i]) != 3)
            return -1;
    return 0;
}

int main(void)
{
    static struct direct d;
    struct direct_input in = { { 0 }, { 0 }, { 0 } };
    double q_rad[DRV_AXES];
    uint64_t seed;
    long ticks;
    int bad = scanf("%" SCNu64, &seed) != 1;
    for (int i = 0; i < DRV_AXES && !bad; i++)
        bad = scanf("%lf", &q_rad[i]) != 1;
    if (bad) {
        fprintf(stderr, "fmu_direct: expected a seed and %d start angles\n", DRV_AXES);
        return 3;
    }
    d.model = fmu_the_plant.model;
    direct_begin(&d, q_rad, seed, &in);
    print(&d);
    while (scanf("%ld", &ticks) == 1) {
        if (read_input(&in) != 0) {
            fprintf(stderr, "fmu_direct: expected ticks, and mode, speed, torque of %d axes\n", DRV_AXES);
            return 3;
        }
        direct_ticks(&d, &in, ticks);
        print(&d);
    }
    return 0;
}
