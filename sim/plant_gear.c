/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The gear as a spring: three lines of torque over wind-up, odd, as the catalogue gives them; and
 * the end stops of the link.
 *
 * Owns: torque, wind-up and energy of gear and stop.
 * Never: knows friction or time.
 */
#include <math.h>

#include "sim/plant_parts.h"

double plant_gear_nm(const struct plant_joint *j, double delta_rad)
{
    const double *k = j->k_nmprad;
    double d = fabs(delta_rad), d1 = j->t_nm[0] / k[0], d2 = d1 + (j->t_nm[1] - j->t_nm[0]) / k[1];
    double torque = d <= d1   ? k[0] * d
                    : d <= d2 ? j->t_nm[0] + k[1] * (d - d1)
                              : j->t_nm[1] + k[2] * (d - d2);
    return delta_rad < 0 ? -torque : torque;
}

double plant_gear_windup_rad(const struct plant_joint *j, double torque_nm)
{
    const double *k = j->k_nmprad;
    double t = fabs(torque_nm), t1 = j->t_nm[0], t2 = j->t_nm[1];
    double d = fmin(t, t1) / k[0];
    if (t > t1)
        d += (fmin(t, t2) - t1) / k[1];
    if (t > t2)
        d += (t - t2) / k[2];
    return torque_nm < 0 ? -d : d;
}

double plant_gear_energy_j(const struct plant_joint *j, double delta_rad)
{
    /* trapezia under the three lines */
    double t = fabs(plant_gear_nm(j, delta_rad)), t1 = j->t_nm[0], t2 = j->t_nm[1];
    double a = fmin(t, t1), energy = a * a / (2 * j->k_nmprad[0]);
    if (t > t1) {
        double b = fmin(t, t2);
        energy += (b * b - t1 * t1) / (2 * j->k_nmprad[1]);
    }
    if (t > t2)
        energy += (t * t - t2 * t2) / (2 * j->k_nmprad[2]);
    return energy;
}

static double stop_depth(const struct plant_joint *j, double q_rad)
{
    return q_rad > j->q_max_rad   ? q_rad - j->q_max_rad
           : q_rad < j->q_min_rad ? q_rad - j->q_min_rad
                                  : 0;
}

double plant_stop_nm(const struct plant_joint *j, double q_rad, double qd_radps)
{
    double depth = stop_depth(j, q_rad);
    if (depth == 0)
        return 0;
    double torque = -j->stop_nmprad * depth - j->stop_nmspr * qd_radps;
    return depth > 0 ? fmin(torque, 0) : fmax(torque, 0);
}

double plant_stop_energy_j(const struct plant_joint *j, double q_rad)
{
    double depth = stop_depth(j, q_rad);
    return j->stop_nmprad * depth * depth / 2;
}
