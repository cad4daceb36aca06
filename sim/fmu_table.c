/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The table of variables.  A row's place gives its value reference: new rows go to the end.
 *
 * Owns: names, units, causality, start values, limits.
 * Never: knows an instance.
 */
#include "sim/fmu.h"

#include <math.h>
#include <string.h>

enum { STRIDE = 16 }; /* references a row; at least DRV_AXES */

#define AT(field) offsetof(struct fmu_values, field)

static const struct fmu_kind table[] = {
    { "time", "s", "simulated time", FMU_FLOAT64, FMU_INDEPENDENT, FMU_CONTINUOUS, 0, AT(time_s) },
    { "seed", NULL, "of the run's noise and scatter", FMU_UINT64, FMU_PARAMETER, FMU_FIXED, 0, AT(seed) },
    { "payload_mass", "kg", "point mass at the flange, in place of the model file's", FMU_FLOAT64,
      FMU_PARAMETER, FMU_FIXED, 0, AT(payload_kg) },
    { "payload_x", "m", "its place in the flange frame", FMU_FLOAT64, FMU_PARAMETER, FMU_FIXED, 0,
      AT(payload_m[0]) },
    { "payload_y", "m", "its place in the flange frame", FMU_FLOAT64, FMU_PARAMETER, FMU_FIXED, 0,
      AT(payload_m[1]) },
    { "payload_z", "m", "its place in the flange frame", FMU_FLOAT64, FMU_PARAMETER, FMU_FIXED, 0,
      AT(payload_m[2]) },
    { "enable", NULL, "servo driver in control mode; false: brakes on; false, then true clears alarms",
      FMU_BOOLEAN, FMU_INPUT, FMU_DISCRETE, 0, AT(enable) },
    { "driver_status", NULL, "status word of the servo driver: alarm number in bits 4 to 11", FMU_UINT16,
      FMU_OUTPUT, FMU_DISCRETE, 0, AT(driver_status) },
    { "start", "rad", "link angle at rest in the beginning", FMU_FLOAT64, FMU_PARAMETER, FMU_FIXED, 1,
      AT(start_rad) },
    { "mode", NULL, "what the axis does: brake, velocity or torque", FMU_ENUMERATION, FMU_INPUT,
      FMU_DISCRETE, 1, AT(mode) },
    { "speed_command", "rad/s", "output side, in mode velocity; digits of 0.0002, at most 6.5534",
      FMU_FLOAT64, FMU_INPUT, FMU_CONTINUOUS, 1, AT(speed_radps) },
    { "torque_command", "N.m", "motor side, in mode torque; digits of 0.001, at most the motor's",
      FMU_FLOAT64, FMU_INPUT, FMU_CONTINUOUS, 1, AT(torque_m_nm) },
    { "angle", "rad", "of the motor by its resolver, over the ratio", FMU_FLOAT64, FMU_OUTPUT,
      FMU_CONTINUOUS, 1, AT(angle_rad) },
    { "link_angle", "rad", "of the link itself, which no sensor of the arm sees", FMU_FLOAT64, FMU_OUTPUT,
      FMU_CONTINUOUS, 1, AT(link_rad) },
    { "link_speed", "rad/s", "of the link itself", FMU_FLOAT64, FMU_OUTPUT, FMU_CONTINUOUS, 1,
      AT(link_radps) },
    { "motor_torque", "N.m", "motor side, as the servo driver reports it", FMU_FLOAT64, FMU_OUTPUT,
      FMU_CONTINUOUS, 1, AT(reported_m_nm) },
    { "gear_torque", "N.m", "on the link through the gear, output side", FMU_FLOAT64, FMU_OUTPUT,
      FMU_CONTINUOUS, 1, AT(gear_nm) },
    { "status", NULL, "status word of the axis: bit 0 limit +, 1 limit -, 4 to 11 alarm number, "
      "14 uncontrollable, 15 power off", FMU_UINT16, FMU_OUTPUT, FMU_DISCRETE, 1, AT(status) },
};

const struct fmu_kind *fmu_row(unsigned k)
{
    return k < sizeof table / sizeof table[0] ? &table[k] : NULL;
}

uint32_t fmu_reference(unsigned k, int joint)
{
    return STRIDE * k + (uint32_t)joint;
}

const struct fmu_kind *fmu_find(const struct fmu_arm *arm, uint32_t reference, int *joint)
{
    const struct fmu_kind *kind = fmu_row(reference / STRIDE);
    *joint = (int)(reference % STRIDE);
    return kind != NULL && *joint < (kind->per_joint ? arm->joints : 1) ? kind : NULL;
}

size_t fmu_size(enum fmu_type type)
{
    static const size_t size[] = { [FMU_FLOAT64] = sizeof(double), [FMU_UINT16] = sizeof(uint16_t),
                                   [FMU_UINT64] = sizeof(uint64_t), [FMU_BOOLEAN] = sizeof(bool),
                                   [FMU_ENUMERATION] = sizeof(int64_t) };
    return size[type];
}

void *fmu_at(struct fmu_values *values, const struct fmu_kind *kind, int joint)
{
    return (char *)values + kind->offset + (size_t)joint * fmu_size(kind->type);
}

void fmu_defaults(const struct fmu_arm *arm, struct fmu_values *values)
{
    memset(values, 0, sizeof *values); /* upright, brakes on, all commands zero */
    values->seed = 1;
    values->enable = true;
    values->payload_kg = arm->payload_kg;
    memcpy(values->payload_m, arm->payload_m, sizeof values->payload_m);
}

int fmu_limits(const struct plant_model *plant, const struct fmu_kind *kind, int joint, double *min,
               double *max)
{
    *min = -HUGE_VAL;
    *max = HUGE_VAL;
    if (kind->offset == AT(start_rad)) {
        *min = plant->joint[joint].q_min_rad;
        *max = plant->joint[joint].q_max_rad;
    } else if (kind->offset == AT(payload_kg)) {
        *min = 0;
    } else if (kind->offset == AT(mode)) {
        *min = FMU_BRAKE;
        *max = FMU_TORQUE;
    } else {
        return 0;
    }
    return 1;
}
