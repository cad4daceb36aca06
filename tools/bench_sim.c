/* SPDX-License-Identifier: Apache-2.0 */
/*
 * How fast the simulator is: a 7-joint PA-10 in velocity mode, all joints moving, processor time.
 *
 * Owns: two printed figures: microseconds per inner step, and simulated seconds per second.
 * Never: is a test; timing on a shared machine varies.
 */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "sim/servo.h"
#include "tests/pa10_plant.h"

static void command(struct servo *v, uint8_t type, double t_s)
{
    struct drv_command c = { .seq = 1, .type = type };
    struct hdt_frame in, out;
    for (int i = 0; i < PA10_JOINTS; i++) {
        c.axis[i].mode = DRV_AXIS_SERVO;
        c.axis[i].speed_dig = (int16_t)(1000 * sin(1.5 * t_s + i));
    }
    drv_command_encode(DRV_FORMAT_A, &c, &in);
    servo_answer(v, &in, &out);
}

int main(int argc, char **argv)
{
    double seconds = argc > 1 ? atof(argv[1]) : 60, q[PA10_JOINTS] = { 0, 0.3, 0, 0.8, 0, 0.5, 0 };
    static struct servo v;
    struct plant_model m = pa10_plant();
    const char *why;
    if (plant_model_check(&m, &why) != 0) {
        fprintf(stderr, "bench_sim: joint %d: %s\n", m.check_joint, why);
        return 1;
    }
    servo_init(&v, &m, NULL, q, 1);
    command(&v, DRV_START, 0);
    long ticks = (long)(seconds * SERVO_RATE_HZ);
    clock_t from = clock();
    for (long k = 0; k < ticks; k++) {
        command(&v, DRV_CYCLIC, v.s.t_s);
        servo_tick(&v);
    }
    double used_s = (double)(clock() - from) / CLOCKS_PER_SEC;
    double steps = seconds * SERVO_RATE_HZ * ceil(1.0 / SERVO_RATE_HZ / m.step_s - 1e-6);
    printf("sim: inner step %.1f us, %.3f us of processor each; %.0f x real time (7 joints, servo "
           "included)\n",
           m.step_s * 1e6, used_s / steps * 1e6, seconds / used_s);
    return v.s.mode == SERVO_CONTROL ? 0 : 1;
}
