/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Everything that repeats with the wave generator: torque lines and kinematic error.
 *
 * A line turns by little from one inner step to the next, so its sine and cosine are carried along
 * by a polynomial rotation and set anew once per block of steps.
 *
 * Owns: sines of angles.
 * Never: knows what the torques do.
 */
#include <math.h>

#include "sim/plant_parts.h"

static const double TURN_MAX_RAD = 0.3; /* the polynomials are good to 1e-11 up to here */

static struct plant_phase phase_at(double at_rad)
{
    return (struct plant_phase){ at_rad, sin(at_rad), cos(at_rad) };
}

static void carry(struct plant_phase *p, double at_rad)
{
    double d = at_rad - p->at_rad;
    if (!(fabs(d) < TURN_MAX_RAD)) {
        *p = phase_at(at_rad);
        return;
    }
    double x = d * d;
    double s = d * (1 - x * (1.0 / 6) * (1 - x * (1.0 / 20) * (1 - x * (1.0 / 42))));
    double c = 1 - x * 0.5 * (1 - x * (1.0 / 12) * (1 - x * (1.0 / 30) * (1 - x * (1.0 / 56))));
    *p = (struct plant_phase){ at_rad, p->sine * c + p->cosine * s, p->cosine * c - p->sine * s };
}

static double turn_of(const struct plant_line *l, const struct plant_state *s, int index, double angle_rad)
{
    return l->order_rev * angle_rad + l->phase_rad + (l->run_phase ? s->phase_rad[index] : 0);
}

void plant_phases_set(const struct plant_joint *j, const struct plant_state *s, int index,
                      struct plant_phases *p)
{
    double angle = s->th_m_rad[index] / j->ratio;
    for (int i = 0; i < j->lines; i++) {
        p->line[i] = phase_at(turn_of(&j->line[i], s, index, angle));
    }
    for (int i = 0; i < j->errors; i++)
        p->error[i] = phase_at(j->error[i].order_rev * angle + j->error[i].phase_rad);
    p->from_rad = angle;
}

struct plant_periodic plant_periodic_at(const struct plant_joint *j, struct plant_phases *p,
                                        double angle_rad, double speed_radps)
{
    struct plant_periodic sum = { 0 };
    double moved = angle_rad - p->from_rad;
    p->from_rad = angle_rad;
    for (int i = 0; i < j->lines; i++) {
        const struct plant_line *l = &j->line[i];
        carry(&p->line[i], p->line[i].at_rad + l->order_rev * moved);
        double amplitude = l->amplitude_nm + l->per_speed_nmspr * fabs(speed_radps);
        *(l->directed ? &sum.directed_nm : &sum.torque_nm) += amplitude * p->line[i].sine;
        *(l->directed ? &sum.directed_per : &sum.torque_per) += l->per_load * p->line[i].sine;
    }
    for (int i = 0; i < j->errors; i++) {
        const struct plant_error *e = &j->error[i];
        carry(&p->error[i], p->error[i].at_rad + e->order_rev * moved);
        sum.error_rad += e->amplitude_rad * p->error[i].sine;
        sum.error_slope += e->amplitude_rad * e->order_rev * p->error[i].cosine;
    }
    return sum;
}

double plant_lines_energy_j(const struct plant_joint *j, const struct plant_state *s, int index)
{
    double energy = 0, angle = s->th_m_rad[index] / j->ratio;
    for (int i = 0; i < j->lines; i++)
        if (!j->line[i].directed)
            energy -= j->line[i].amplitude_nm / j->line[i].order_rev
                      * cos(turn_of(&j->line[i], s, index, angle));
    return energy;
}
