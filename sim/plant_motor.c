/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The motor and its current loop as torque: what is given for what is asked.
 *
 * Owns: saturation, gain, offset, dead time, knee and ripple of the motor torque.
 * Never: has a state; the torque reported is the one asked for (sim/servo.c).
 */
#include <math.h>

#include "sim/plant_parts.h"

static double cut(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value == value ? value : 0;
}

double plant_motor_nm(const struct plant_joint *j, double tau_m_nm, double angle_rad, double warm)
{
    double asked = cut(tau_m_nm, j->tau_max_m_nm), given = asked, size = fabs(asked);
    if (j->fx_knee_share != 0 && size > j->fx_knee_m_nm)
        given -= copysign(j->fx_knee_share * (size - j->fx_knee_m_nm), asked);
    if (j->fx_dead_m_nm != 0)
        given -= copysign(fmin(size, j->fx_dead_m_nm * exp(-size / j->fx_dead_width_m_nm)), asked);
    if (j->fx_current_ripple != 0)
        given *= 1 + j->fx_current_ripple * sin(j->fx_current_order_rev * angle_rad);
    given *= 1 + j->fx_torque_gain + j->fx_gain_warm * warm;
    return j->ratio * (given - j->fx_current_offset_m_nm);
}
