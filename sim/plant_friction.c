/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Friction of one rotor: two-sided Stribeck with true stiction, and the slow and hidden effects that
 * ride on it (run scatter, wander, cold start, load, presliding, dwell, dry spot, drag).
 *
 * Owns: the friction law and its implicit solution; exp(-x) for it; the random numbers of the plant.
 * Never: knows the chain or the mesh.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"

/* x = n ln 2 / 16 - r with |r| <= ln 2 / 32: a power of two, one of sixteen roots of it, and the series
 * of exp(r), whose next term is below 5e-16. */
double plant_decay(double x)
{
    static const double PER_PART = 23.083120654223414, PART_HIGH = 6.93147180369123816490e-01 / 16,
                        PART_LOW = 1.90821492927058770002e-10 / 16;
    static const double ROOT[16] = { /* 2^(-k / 16) */
        1.0, 0.9576032806985737, 0.9170040432046712, 0.8781260801866497,
        0.8408964152537145, 0.8052451659746271, 0.7711054127039704, 0.7384130729697497,
        0.7071067811865476, 0.6771277734684463, 0.6484197773255048, 0.620928906036742,
        0.5946035575013605, 0.5693943173783458, 0.5452538663326288, 0.5221368912137069
    };
    if (!(x < 700))
        return 0;
    int64_t n = (int64_t)(x * PER_PART + 0.5), bits = (1023 - (n >> 4)) << 52;
    double r = (double)n * PART_HIGH - x + (double)n * PART_LOW, r2 = r * r, power;
    memcpy(&power, &bits, sizeof power);
    double tail = 1.0 / 24 + r * (1.0 / 120) + r2 * (1.0 / 720);
    double series = 1 + r + r2 * (1.0 / 2 + r * (1.0 / 6) + r2 * tail);
    return power * ROOT[n & 15] * series;
}

static double dwell_nm(const struct plant_joint *j, const struct plant_state *s, int index)
{
    if (j->fx_dwell_nm == 0)
        return 0;
    return j->fx_dwell_nm * log10(1 + s->still_s[index]) * exp(-s->since_rad[index] / j->fx_dwell_rad);
}

static double local_nm(const struct plant_joint *j, const struct plant_state *s, int index)
{
    if (j->fx_local_nm == 0)
        return 0;
    double x = (s->th_m_rad[index] / j->ratio - j->fx_local_rad) / j->fx_local_width_rad;
    return j->fx_local_nm * exp(-x * x);
}

void plant_rub_begin(const struct plant_joint *j, struct plant_rub *rub)
{
    rub->more = j->fx_load_mu != 0 || j->fx_drive_mu != 0 || j->fx_slow_nm != 0
                || j->fx_quadratic_nms2prad2 != 0;
    for (int d = 0; d < 2; d++)
        rub->per_vc_spr[d] = j->friction[d].fs_nm != 0 ? 1 / j->friction[d].vc_radps : 0;
}

void plant_rub_prepare(const struct plant_joint *j, const struct plant_state *s, int index,
                       struct plant_rub *rub)
{
    double cold = j->fx_warm_s > 0 ? 1 - s->warm[index] : 0;
    double more_nm = s->run_coulomb_nm[index] + s->wander_nm[index] + j->fx_drag_nm
                     + dwell_nm(j, s, index) + local_nm(j, s, index);
    rub->elastic_nm = j->fx_presliding_nm / 2;
    for (int d = 0; d < 2; d++) {
        const struct plant_friction *f = &j->friction[d];
        /* grease is cold in the mesh too; all of its excess is taken to be on the rotor */
        double cold_nm = (f->f0_nm + j->mesh.drive_nm) * j->fx_cold_coulomb * cold;
        rub->coulomb_nm[d] = f->f0_nm + cold_nm + more_nm - rub->elastic_nm;
        rub->viscous_nmspr[d] = f->fv_nmspr * (1 + j->fx_cold_viscous * cold);
    }
}

double plant_rub_dry_nm(const struct plant_joint *j, const struct plant_rub *rub, double sense,
                        double along_radps, double gear_nm, double directed_nm)
{
    int side = sense < 0;
    double v = along_radps > 0 ? along_radps : 0, x = v * rub->per_vc_spr[side];
    double dry = rub->coulomb_nm[side] + directed_nm, fs = j->friction[side].fs_nm;
    if (x > 0)
        dry += x < 38 ? fs * (1 - plant_decay(x)) : fs; /* 1 - exp(-38) is 1 */
    if (!rub->more)
        return dry;
    dry += j->fx_load_mu * fabs(gear_nm) + j->fx_drive_mu * fmax(0, sense * gear_nm);
    if (j->fx_slow_nm != 0)
        dry += j->fx_slow_nm * plant_decay(v / j->fx_slow_radps);
    return dry + j->fx_quadratic_nms2prad2 * v * v;
}

double plant_rub_kick(const struct plant_joint *j, const struct plant_rub *rub,
                      const struct plant_kick *k, double speed_radps, double *dahl_nm,
                      double *friction_nm)
{
    double gain = k->h_s / k->inertia_kgm2;
    double elastic = *dahl_nm; /* stays zero without presliding */
    double free_radps = speed_radps + gain * (k->drive_nm - elastic);
    double sense = free_radps < 0 ? -1 : 1;

    /* the curved part at the speed before: it is smooth and small against the set-valued part */
    double dry = sense == k->sense ? k->dry_nm
                                   : plant_rub_dry_nm(j, rub, sense, speed_radps * sense,
                                                      k->gear_nm, k->directed_nm);
    double left = sense * free_radps - (dry > 0 ? gain * dry : 0);
    double speed = left > 0 ? sense * left / (1 + gain * rub->viscous_nmspr[sense < 0]) : 0;
    *friction_nm = (free_radps - speed) / gain + elastic;
    if (rub->elastic_nm > 0) {
        double share = fmin(1, fabs(speed) * k->h_s / j->fx_presliding_rad);
        *dahl_nm += share * (sense * rub->elastic_nm - *dahl_nm);
    }
    return speed;
}

/* How long it stood last, and how far it has come since. */
static void age_stand(struct plant_state *s, int index, double ratio, double dt_s)
{
    double moved = fabs(s->thd_m_radps[index]) / ratio * dt_s;
    if (moved > 0) {
        s->since_rad[index] += moved;
    } else {
        if (s->since_rad[index] > 0)
            s->still_s[index] = 0;
        s->since_rad[index] = 0;
        s->still_s[index] += dt_s;
    }
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
    if (j->fx_dwell_nm != 0)
        age_stand(s, index, j->ratio, dt_s);
}

/* SplitMix64 */
static uint64_t random_bits(uint64_t *rng)
{
    uint64_t z = (*rng += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

double plant_uniform(uint64_t *rng)
{
    return (double)((random_bits(rng) >> 11) + 1) * 0x1p-53;
}

double plant_gauss(uint64_t *rng)
{
    /* Box-Muller; the first draw is in (0, 1] so that the logarithm is finite */
    double a = plant_uniform(rng);
    double b = (double)(random_bits(rng) >> 11) * 0x1p-53;
    return sqrt(-2 * log(a)) * cos(6.283185307179586 * b);
}
