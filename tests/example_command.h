/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Owns: the command of docs/formats.md's examples, whose bytes are written out there and in the tests.
 */
#ifndef EXAMPLE_COMMAND_H
#define EXAMPLE_COMMAND_H

#include "driver/drv_telegram.h"

static inline struct drv_command example_command(void)
{
    struct drv_command c = {.seq = 42, .type = DRV_CYCLIC};
    for (int i = 0; i < DRV_AXES; i++)
        c.axis[i].mode = DRV_AXIS_BRAKE;
    c.axis[0].mode = c.axis[1].mode = DRV_AXIS_SERVO | DRV_AXIS_TORQUE;
    c.axis[0].torque_dig = 1000;
    c.axis[1].torque_dig = -1;
    c.axis[3].mode = DRV_AXIS_SERVO;
    c.axis[3].speed_dig = -5000;
    c.axis[6].mode = DRV_AXIS_BRAKE | DRV_AXIS_DEADMAN;
    c.axis[6].torque_dig = INT16_MIN;
    c.axis[6].speed_dig = INT16_MAX;
    return c;
}

#endif
