/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Friction of one rotor: two-sided Stribeck with true stiction, periodic lines, and the slow and
 * hidden effects that ride on it (run scatter, wander, cold start, load, presliding).
 *
 * Owns: the friction law and its implicit solution; the random numbers of the plant.
 * Never: knows the chain.
 */
#include <math.h>

#include "sim/plant_parts.h"

void plant_rub_prepare(const struct plant_joint *j, const struct plant_state *s, int index,
                       struct plant_rub *rub)
{
    double cold = j->fx_warm_s > 0 ? 1 - s->warm[index] : 0;
    rub->elastic_nm = j->fx_presliding_nm / 2;
    for (int d = 0; d < 2; d++) {
        const struct plant_friction *f = &j->friction[d];
        rub->coulomb_nm[d] = f->f0_nm * (1 + j->fx_cold_coulomb * cold) + s->run_coulomb_nm[index]
                             + s->wander_nm[index] - rub->elastic_nm;
        rub->viscous_nmspr[d] = f->fv_nmspr * (1 + j->fx_cold_viscous * cold);
    }
}

/* What load and periodic lines add to the friction magnitude, and what lines take as torque whatever
 * the direction. */
struct extra { double friction_nm, torque_nm; };

static struct extra extras(const struct plant_joint *j, const struct plant_kick *k, double angle_rad)
{
    struct extra x = { j->fx_load_mu * fabs(k->gear_nm), 0 };
    for (int i = 0; i < j->lines; i++) {
        double value =
            j->line[i].amplitude_nm * sin(j->line[i].order_rev * angle_rad + j->line[i].phase_rad);
        if (j->line[i].directed)
            x.friction_nm += value;
        else
            x.torque_nm += value;
    }
    return x;
}

double plant_rub_kick(const struct plant_joint *j, const struct plant_rub *rub,
                      const struct plant_kick *k, double angle_rad, double speed_radps,
                      double *dahl_nm, double *friction_nm)
{
    struct extra x = extras(j, k, angle_rad);
    double gain = k->h_s / k->inertia_kgm2;
    double elastic = *dahl_nm; /* stays zero without presliding */
    double free_radps = speed_radps + gain * (k->drive_nm - x.torque_nm - elastic);
    int d = free_radps < 0;
    double sense = d ? -1 : 1;

    /* the curved part at the speed before: it is smooth and small against the set-valued part */
    const struct plant_friction *f = &j->friction[d];
    double along = speed_radps * sense;
    double curved = along > 0 && f->fs_nm != 0 ? f->fs_nm * (1 - exp(-along / f->vc_radps)) : 0;
    double dry = fmax(0, rub->coulomb_nm[d] + x.friction_nm + curved);

    double left = sense * free_radps - gain * dry;
    double speed = left > 0 ? sense * left / (1 + gain * rub->viscous_nmspr[d]) : 0;
    *friction_nm = (free_radps - speed) / gain + elastic;
    if (rub->elastic_nm > 0) {
        double share = fmin(1, fabs(speed) * k->h_s / j->fx_presliding_rad);
        *dahl_nm += share * (sense * rub->elastic_nm - *dahl_nm);
    }
    return speed;
}

void plant_rub_age(const struct plant_joint *j, struct plant_state *s, int index, double dt_s)
{
    if (j->fx_warm_s > 0)
        s->warm[index] += (1 - s->warm[index]) * -expm1(-dt_s / j->fx_warm_s);
    if (j->wander_sigma_nm > 0 && j->wander_s > 0) {
        double keep = exp(-dt_s / j->wander_s);
        s->wander_nm[index] = keep * s->wander_nm[index]
                              + j->wander_sigma_nm * sqrt(1 - keep * keep) * plant_gauss(&s->rng);
    }
}

double plant_lines_energy_j(const struct plant_joint *j, double angle_rad)
{
    double energy = 0;
    for (int i = 0; i < j->lines; i++)
        if (!j->line[i].directed)
            energy -= j->line[i].amplitude_nm / j->line[i].order_rev
                      * cos(j->line[i].order_rev * angle_rad + j->line[i].phase_rad);
    return energy;
}

/* SplitMix64 */
static uint64_t random_bits(uint64_t *rng)
{
    uint64_t z = (*rng += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

double plant_gauss(uint64_t *rng)
{
    /* Box-Muller; the first draw is in (0, 1] so that the logarithm is finite */
    double a = (double)((random_bits(rng) >> 11) + 1) * 0x1p-53;
    double b = (double)(random_bits(rng) >> 11) * 0x1p-53;
    return sqrt(-2 * log(a)) * cos(6.283185307179586 * b);
}
