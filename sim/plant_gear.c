/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The gear: flexspline as three lines of torque over wind-up, odd, as the catalogue gives them; wave
 * generator as a spring that is soft near zero; the mesh between them, which slides with friction;
 * the kinematic error; and the end stops of the link.
 *
 * The mesh is a Jenkins element with springs on both sides: it sticks while the two springs differ
 * by less than the loss, and gives way just so far that they differ by the loss.  Its position is
 * all the memory the gear has.
 *
 * Owns: torque, wind-up and energy of gear, mesh and stop.
 * Never: knows the rotor's friction or time.
 */
#include <math.h>

#include "sim/plant_parts.h"

void plant_gear_prepare(const struct plant_joint *j, struct plant_gear *g)
{
    const struct plant_mesh *m = &j->mesh;
    g->corner_rad[0] = j->t_nm[0] / j->k_nmprad[0];
    g->corner_rad[1] = g->corner_rad[0] + (j->t_nm[1] - j->t_nm[0]) / j->k_nmprad[1];
    g->soft_rad = j->soft_nm > 0 ? j->soft_nm / j->soft_nmprad : 0;
    g->loss_slope = j->soft_nm > 0 ? (m->drive_nm - m->back_nm) / (2 * j->soft_nm) : 0;
}

/* Value and slope of a piecewise linear law. */
struct slope { double value, slope; };

static inline struct slope gear_at(const struct plant_joint *j, const struct plant_gear *g,
                                   double windup_rad)
{
    double d = fabs(windup_rad);
    double slope = j->k_nmprad[d <= g->corner_rad[0] ? 0 : d <= g->corner_rad[1] ? 1 : 2];
    return (struct slope){ plant_gear_at_nm(j, g, windup_rad), slope };
}

double plant_gear_nm(const struct plant_joint *j, double delta_rad)
{
    struct plant_gear g;
    plant_gear_prepare(j, &g);
    return plant_gear_at_nm(j, &g, delta_rad);
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

/* ---- wave generator ---- */

static inline struct slope wave_at(const struct plant_joint *j, const struct plant_gear *g,
                                   double windup_rad)
{
    double d = fabs(windup_rad), edge = g->soft_rad;
    struct slope at = d <= edge ? (struct slope){ j->soft_nmprad * d, j->soft_nmprad }
                                : (struct slope){ j->soft_nm + j->hard_nmprad * (d - edge), j->hard_nmprad };
    if (windup_rad < 0)
        at.value = -at.value;
    return at;
}

double plant_wave_at_nm(const struct plant_joint *j, const struct plant_gear *g, double windup_rad)
{
    return wave_at(j, g, windup_rad).value;
}

double plant_wave_nm(const struct plant_joint *j, double windup_rad)
{
    struct plant_gear g;
    plant_gear_prepare(j, &g);
    return plant_wave_at_nm(j, &g, windup_rad);
}

double plant_wave_windup_rad(const struct plant_joint *j, double torque_nm)
{
    double t = fabs(torque_nm), d = fmin(t, j->soft_nm) / j->soft_nmprad;
    if (t > j->soft_nm)
        d += (t - j->soft_nm) / j->hard_nmprad;
    return torque_nm < 0 ? -d : d;
}

double plant_wave_energy_j(const struct plant_joint *j, double windup_rad)
{
    double t = fabs(plant_wave_nm(j, windup_rad)), a = fmin(t, j->soft_nm);
    double energy = a * a / (2 * j->soft_nmprad);
    if (t > j->soft_nm)
        energy += (t * t - j->soft_nm * j->soft_nm) / (2 * j->hard_nmprad);
    return energy;
}

/* ---- mesh ---- */

/* Loss over wave torque along the motion. */
static inline struct slope loss_at(const struct plant_joint *j, const struct plant_gear *g,
                                   double along_nm)
{
    const struct plant_mesh *m = &j->mesh;
    double soft = j->soft_nm;
    if (along_nm >= soft)
        return (struct slope){ m->drive_nm + m->drive_load * (along_nm - soft), m->drive_load };
    if (along_nm <= -soft)
        return (struct slope){ m->back_nm - m->back_load * (along_nm + soft), -m->back_load };
    return (struct slope){ m->back_nm + g->loss_slope * (along_nm + soft), g->loss_slope };
}

double plant_mesh_loss_nm(const struct plant_joint *j, double along_nm)
{
    struct plant_gear g;
    plant_gear_prepare(j, &g);
    return loss_at(j, &g, along_nm).value;
}

/* The same, and more_nm, never below zero. */
static inline struct slope loss_and(const struct plant_joint *j, const struct plant_gear *g,
                                    double more_nm, double along_nm)
{
    struct slope l = loss_at(j, g, along_nm);
    l.value += more_nm;
    return l.value > 0 ? l : (struct slope){ 0, 0 };
}

/* What is left of the wave torque behind the mesh, less the gear's torque, at wave wind-up a of a
 * total of all; for motion along +. */
static struct slope surplus_at(const struct plant_joint *j, const struct plant_gear *g, double more_nm,
                               double all, double a)
{
    struct slope w = wave_at(j, g, a), l = loss_and(j, g, more_nm, w.value), f = gear_at(j, g, all - a);
    return (struct slope){ w.value - l.value - f.value, w.slope * (1 - l.slope) + f.slope };
}

/* Root of the surplus, which rises with a: Newton's method lands on the root as soon as it is on
 * the right piece; bisection where it does not settle. */
static double slide(const struct plant_joint *j, const struct plant_gear *g, double more_nm, double all,
                    double a)
{
    enum { NEWTON = 8, BISECT = 60 };
    double scale = 1e-12 * (j->soft_nm + j->t_nm[1] + 1);
    for (int i = 0; i < NEWTON; i++) {
        struct slope s = surplus_at(j, g, more_nm, all, a);
        if (fabs(s.value) <= scale)
            return a;
        a -= s.value / s.slope;
    }
    double span = fabs(all) + plant_wave_windup_rad(j, j->mesh.drive_nm + j->soft_nm) + 1e-3;
    double low = fmin(all, 0) - span, high = fmax(all, 0) + span;
    for (int i = 0; i < BISECT; i++) {
        a = (low + high) / 2;
        if (surplus_at(j, g, more_nm, all, a).value > 0)
            high = a;
        else
            low = a;
    }
    return a;
}

double plant_mesh_slip(const struct plant_joint *j, const struct plant_gear *g, double more_nm,
                       double angle_rad, double output_rad, double mesh_rad)
{
    double a = angle_rad - mesh_rad, all = angle_rad - output_rad;
    double wave = wave_at(j, g, a).value, surplus = wave - gear_at(j, g, all - a).value;
    double sense = surplus < 0 ? -1 : 1;
    if (sense * surplus <= loss_and(j, g, more_nm, sense * wave).value)
        return mesh_rad;
    return angle_rad - sense * slide(j, g, more_nm, sense * all, sense * a);
}

/* ---- end stops ---- */

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
