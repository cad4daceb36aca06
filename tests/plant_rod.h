/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One joint with a rod on it, and the few calls that the tests of the plant share.
 *
 * Owns: the rods' numbers.
 * Never: used outside tests; holds what a test expects.
 */
#ifndef PLANT_ROD_H
#define PLANT_ROD_H

#include <math.h>
#include <string.h>

#include "sim/plant.h"
#include "tests/check_main.h"
#include "tests/pa10_plant.h"

static const double zero_torque[PLANT_JOINTS_MAX] = { 0 };

static inline void accept(struct plant_model *m)
{
    const char *why;
    int ok = plant_model_check(m, &why) == 0;
    ck_assert_msg(ok, "model refused: joint %d: %s", m->check_joint, ok ? "" : why);
}

/* One joint, axis level (y), a rod of 2 kg with its centre 0.5 m out along x; gravity down z. */
static inline struct plant_model rod(void)
{
    struct plant_model m = { .joints = 1, .gravity_mps2 = { 0, 0, -9.81 } };
    struct plant_joint *j = &m.joint[0];
    static const double to_y[9] = { 1, 0, 0, 0, 0, 1, 0, -1, 0 };
    memcpy(j->rot, to_y, sizeof to_y);
    j->mass_kg = 2;
    j->moment_kgm[0] = 1;
    j->inertia_kgm2[0] = 0.01;
    j->inertia_kgm2[3] = j->inertia_kgm2[5] = 0.7;
    j->q_min_rad = -50;
    j->q_max_rad = 50;
    pa10_gear(j, 25);
    j->rotor_kgm2_m = 1.2e-4;
    j->tau_max_m_nm = 2;
    j->friction[0] = (struct plant_friction){ 18, 17, 2.2, 0.043 };
    j->friction[1] = (struct plant_friction){ 19, 18, 2.7, 0.040 };
    j->damping_nmspr = 8;
    return m;
}

/* The rod, weightless, on the gear of PA-10 joint 2 with its mesh; the numbers of model/arms/pa10.toml,
 * and the rotor's share of its friction in both directions.  fx_contact_nm is the load on it. */
static inline struct plant_model geared_rod(void)
{
    struct plant_model m = rod();
    struct plant_joint *j = &m.joint[0];
    m.gravity_mps2[2] = 0;
    pa10_gear(j, 32);
    j->soft_nm = 21;
    j->soft_nmprad = 5.4e4;
    j->hard_nmprad = 29.4e4;
    j->mesh = (struct plant_mesh){ 32.2, 2, 0, 0 };
    j->rotor_kgm2_m = 4.69e-4;
    j->tau_max_m_nm = 4.64;
    j->friction[0] = j->friction[1] = (struct plant_friction){ 7.7709, 35.32, 6.2713, 0.0685 };
    j->damping_nmspr = 75;
    return m;
}

/* Millisecond by millisecond, the same motor torque on every joint. */
static inline void run(const struct plant_model *m, struct plant_state *s, double tau_m_nm, double span_s)
{
    double tau[PLANT_JOINTS_MAX];
    for (int i = 0; i < PLANT_JOINTS_MAX; i++)
        tau[i] = tau_m_nm;
    for (double t = 0; t < span_s - 1e-9; t += 1e-3)
        plant_step(m, s, tau, 1e-3);
}

/* Speed of the rotor, output side. */
static inline double speed(const struct plant_model *m, const struct plant_state *s, int i)
{
    return s->thd_m_radps[i] / m->joint[i].ratio;
}

#endif
