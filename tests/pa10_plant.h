/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A PA-10 (first generation) as a plant, for the simulator's own tests: built by hand from published
 * numbers, so that these tests need no model file.
 *
 * Sources: masses and centres of mass, manufacturer's set (OpenHRP3 sample PA10); inertias, order of
 * magnitude of the public PA10-7CE set (HuMAns); gears, CSF catalogue sizes 32 32 25 25 17 17 17 at
 * ratio 50; friction, Kennedy & Desai 2005, Tables II and III (orders as whole wave-generator turns).
 *
 * Owns: the numbers.  Never: used outside tests.
 */
#ifndef PA10_PLANT_H
#define PA10_PLANT_H

#include <math.h>
#include <string.h>

#include "sim/plant.h"

#define PA10_JOINTS 7
#define PA10_RATIO 50.0

struct pa10_joint {
    double trans_z, mass, com, inertia_across, inertia_along, limit_deg;
    int size;                       /* CSF */
    double rotor, rated;
    double f0[2], fv[2], fs[2], vc[2];
    double order[2], amplitude[2], phase[2];
};

static const struct pa10_joint pa10_joint[PA10_JOINTS] = {
    { 0.0, 9.78, 0.148, 0.1227, 0.0531, 177, 32, 3.0e-4, 4.64, { 34.9647, 36.7050 }, { 29.7153, 26.4796 },
      { 2.8103, 2.2885 }, { 0.3376, 0.6172 }, { 2, 6 }, { 7.50, 5.05 }, { 2.30, 12.80 } },
    { 0.315, 8.41, 0.06325, 0.0550, 0.0181, 94, 32, 3.0e-4, 4.64, { 39.9709, 41.3113 }, { 35.3200, 35.8947 },
      { 6.2713, 5.9018 }, { 0.0685, 0.0709 }, { 6, 39 }, { 6.00, 2.50 }, { -1.50, -6.90 } },
    { 0.0, 3.51, 0.36056, 0.0081, 0.0057, 174, 25, 8.5e-5, 2.0, { 18.3053, 18.7327 }, { 17.6413, 17.8371 },
      { 2.2282, 2.7240 }, { 0.0430, 0.0405 }, { 5, 30 }, { 0.70, 0.55 }, { 0.10, 5.50 } },
    { 0.45, 4.31, 0.04609, 0.0081, 0.0057, 137, 25, 8.5e-5, 2.0, { 30.4416, 30.6897 }, { 28.5552, 29.4670 },
      { 19.7181, 21.7854 }, { 0.3278, 0.3676 }, { 5, 33 }, { 5.00, 0.10 }, { -3.15, 3.98 } },
    { 0.0, 3.45, 0.3353, 0.0025, 0.0027, 255, 17, 2.3e-6, 0.29, { 3.7145, 4.1271 }, { 0.7493, 0.7919 },
      { 1.0792, 1.3756 }, { 0.0386, 0.0393 }, { 3, 12 }, { 0.50, 0.40 }, { 4.95, 7.50 } },
    { 0.5, 1.46, -0.030, 0.0030, 0.0011, 165, 17, 2.3e-6, 0.29, { 5.5090, 5.7954 }, { 0.5859, 0.5711 },
      { 0.9983, 0.9967 }, { 0.0126, 0.0135 }, { 3, 12 }, { 0.10, 0.50 }, { -1.50, 5.50 } },
    { 0.0, 0.24, 0.051, 2.0e-4, 1.9e-4, 255, 17, 2.3e-6, 0.29, { 2.2980, 2.3027 }, { 0.6062, 0.6836 },
      { -1.1803, -1.1470 }, { 0.0759, 0.0690 }, { 3, 12 }, { 0.10, 0.50 }, { -1.00, 2.50 } },
};

static inline void pa10_gear(struct plant_joint *p, int size)
{
    static const double k32[3] = { 5.4e4, 7.8e4, 9.8e4 }, k25[3] = { 2.5e4, 3.4e4, 4.4e4 },
                        k17[3] = { 0.81e4, 1.1e4, 1.3e4 };
    static const double t32[2] = { 29, 108 }, t25[2] = { 14, 48 }, t17[2] = { 3.9, 12 };
    memcpy(p->k_nmprad, size == 32 ? k32 : size == 25 ? k25 : k17, sizeof k32);
    memcpy(p->t_nm, size == 32 ? t32 : size == 25 ? t25 : t17, sizeof t32);
    p->ratio = PA10_RATIO;
}

/* Links: axes S1 z, S2 y, S3 z, E1 y, E2 z, W1 y, W2 z with the arm upright at zero. */
static inline void pa10_link(struct plant_joint *p, const struct pa10_joint *a, int index)
{
    static const double up[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
    static const double to_y[9] = { 1, 0, 0, 0, 0, 1, 0, -1, 0 };  /* own z is the parent's y */
    static const double to_z[9] = { 1, 0, 0, 0, 0, -1, 0, 1, 0 };
    int across = index % 2; /* turns about y: the arm's axis is this frame's -y */
    memcpy(p->rot, index == 0 ? up : across ? to_y : to_z, sizeof up);
    p->trans_m[2] = a->trans_z;
    p->mass_kg = a->mass;
    p->moment_kgm[across ? 1 : 2] = a->mass * a->com * (across ? -1 : 1);
    double steiner = a->mass * a->com * a->com;
    p->inertia_kgm2[0] = a->inertia_across + steiner;
    p->inertia_kgm2[3] = across ? a->inertia_along : a->inertia_across + steiner;
    p->inertia_kgm2[5] = across ? a->inertia_across + steiner : a->inertia_along;
    p->q_max_rad = a->limit_deg * 3.14159265358979 / 180;
    p->q_min_rad = -p->q_max_rad;
}

/* Every number as published; imperfections and effects zero.  Not yet through plant_model_check. */
static inline struct plant_model pa10_plant(void)
{
    struct plant_model m = { .joints = PA10_JOINTS, .gravity_mps2 = { 0, 0, -9.81 } };
    for (int i = 0; i < PA10_JOINTS; i++) {
        struct plant_joint *p = &m.joint[i];
        const struct pa10_joint *a = &pa10_joint[i];
        pa10_link(p, a, i);
        pa10_gear(p, a->size);
        p->rotor_kgm2_m = a->rotor + (a->size == 32 ? 1.69e-4 : a->size == 25 ? 0.413e-4 : 0.079e-4);
        p->tau_max_m_nm = a->rated;
        p->damping_nmspr = 0.1 * sqrt(p->k_nmprad[0] * p->rotor_kgm2_m) * PA10_RATIO;
        for (int d = 0; d < 2; d++)
            p->friction[d] = (struct plant_friction){ a->f0[d], a->fv[d], a->fs[d], a->vc[d] };
        for (int k = 0; k < 2; k++)
            p->line[p->lines++] =
                (struct plant_line){a->order[k] * PA10_RATIO, a->amplitude[k], a->phase[k], 1, 0, 0, 0};
    }
    return m;
}

/* No friction, no lines, no gear damping: what is left conserves energy. */
static inline void pa10_frictionless(struct plant_model *m)
{
    for (int i = 0; i < m->joints; i++) {
        memset(m->joint[i].friction, 0, sizeof m->joint[i].friction);
        m->joint[i].lines = 0;
        m->joint[i].damping_nmspr = 0;
    }
}

#endif
