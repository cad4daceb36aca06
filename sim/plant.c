/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Check, reset, step and energy of the plant.
 *
 * Step: drift half, kick, drift half (position Verlet), friction implicit in the kick.  The links'
 * mass matrix and bias torque turn slowly against the gear's ringing, so they are evaluated once per
 * REFRESH inner steps, at the pose expected in the middle of them.
 *
 * Owns: the integration.
 * Never: holds the physics of a part: see plant_parts.h.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "sim/plant_parts.h"

enum { REFRESH = 16, POSES = 64, POWER_STEPS = 40 };

/* Inner step times the fastest frequency: keeps the frequency within 1 %; unstable from 2 on. */
static const double STEP_RAD = 0.5;
static const double STEP_RAD_MAX = 1.5;
static const double STEP_S_MIN = 1e-7;

static double rotor_inertia(const struct plant_joint *j)
{
    return j->rotor_kgm2_m * j->ratio * j->ratio + j->fx_inertia_kgm2;
}

/* ---- check ---- */

static int finite_all(const double *v, int n)
{
    for (int i = 0; i < n; i++)
        if (!isfinite(v[i]))
            return 0;
    return 1;
}

static const char *check_frame(const struct plant_joint *j)
{
    if (!finite_all(j->rot, 9) || !finite_all(j->trans_m, 3) || !finite_all(j->moment_kgm, 3)
        || !finite_all(j->inertia_kgm2, 6) || !isfinite(j->mass_kg))
        return "link: a number is not finite";
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += j->rot[3 * a + k] * j->rot[3 * b + k];
            if (fabs(sum - (a == b)) > 1e-9)
                return "rot: rows are not orthonormal within 1e-9";
        }
    if (j->mass_kg < 0)
        return "mass_kg: negative";
    if (!(j->q_min_rad < j->q_max_rad))
        return "q_min_rad, q_max_rad: minimum not below maximum";
    if (!(j->stop_nmprad >= 0 && j->stop_nmspr >= 0))
        return "stop_nmprad, stop_nmspr: negative";
    return NULL;
}

static const char *check_drive(const struct plant_joint *j)
{
    if (!(j->ratio >= 1 && isfinite(j->ratio)))
        return "ratio: must be 1 or more";
    for (int i = 0; i < 3; i++)
        if (!(j->k_nmprad[i] > 0 && isfinite(j->k_nmprad[i])))
            return "k_nmprad: torsional stiffness must be positive";
    if (!(j->t_nm[0] >= 0 && j->t_nm[0] <= j->t_nm[1] && isfinite(j->t_nm[1])))
        return "t_nm: must be 0 <= T1 <= T2";
    if (!(j->damping_nmspr >= 0 && isfinite(j->damping_nmspr)))
        return "damping_nmspr: negative";
    if (!(j->rotor_kgm2_m > 0 && isfinite(j->rotor_kgm2_m)))
        return "rotor_kgm2_m: must be positive";
    if (!(rotor_inertia(j) > 0 && isfinite(rotor_inertia(j))))
        return "fx_inertia_kgm2: takes away more inertia than the rotor has";
    if (!(j->tau_max_m_nm > 0 && isfinite(j->tau_max_m_nm)))
        return "tau_max_m_nm: must be positive";
    return NULL;
}

static const char *check_friction(const struct plant_joint *j)
{
    for (int d = 0; d < 2; d++) {
        const struct plant_friction *f = &j->friction[d];
        if (!(f->f0_nm >= 0 && f->fv_nmspr >= 0 && isfinite(f->f0_nm) && isfinite(f->fv_nmspr)))
            return "friction: f0_nm and fv_nmspr must not be negative";
        if (!(isfinite(f->fs_nm) && f->fs_nm >= -f->f0_nm))
            return "friction: fs_nm must not be below -f0_nm";
        if (f->fs_nm != 0 && !(f->vc_radps > 0))
            return "friction: vc_radps must be positive where fs_nm is used";
    }
    if (j->lines < 0 || j->lines > PLANT_LINES_MAX)
        return "lines: out of 0..PLANT_LINES_MAX";
    for (int i = 0; i < j->lines; i++) {
        const struct plant_line *l = &j->line[i];
        if (!isfinite(l->order_rev) || !isfinite(l->amplitude_nm) || !isfinite(l->phase_rad)
            || l->order_rev == 0)
            return "line: order must not be zero, all numbers finite";
    }
    return NULL;
}

static const char *check_imperfections(const struct plant_joint *j)
{
    const double all[] = { j->run_coulomb_sigma_nm, j->wander_sigma_nm,   j->wander_s,
                           j->torque_noise_m_nm,    j->fx_load_mu,        j->fx_warm_s,
                           j->fx_presliding_nm,     j->fx_presliding_rad, j->fx_spring_nmprad };
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        if (!(all[i] >= 0 && isfinite(all[i])))
            return "an imperfection or effect that must not be negative is, or is not finite";
    if (!(j->fx_torque_gain > -1 && isfinite(j->fx_torque_gain)))
        return "fx_torque_gain: must be above -1";
    if (!isfinite(j->fx_spring_q0_rad))
        return "fx_spring_q0_rad: not finite";
    if (!(j->fx_cold_coulomb >= -1 && j->fx_cold_viscous >= -1 && isfinite(j->fx_cold_coulomb)
          && isfinite(j->fx_cold_viscous)))
        return "fx_cold_coulomb, fx_cold_viscous: must be -1 or more";
    if ((j->fx_cold_coulomb != 0 || j->fx_cold_viscous != 0) && j->fx_warm_s == 0)
        return "fx_warm_s: a cold excess needs a thermal time";
    if (j->wander_sigma_nm > 0 && j->wander_s == 0)
        return "wander_s: a wander needs its correlation time";
    if (j->fx_presliding_nm > 0 && j->fx_presliding_rad == 0)
        return "fx_presliding_rad: presliding needs its travel constant";
    if (j->fx_presliding_nm / 2 > fmin(j->friction[0].f0_nm, j->friction[1].f0_nm))
        return "fx_presliding_nm: more than twice the Coulomb friction there is";
    return NULL;
}

/* Largest eigenvalue of K^1/2 (1 / J + M^-1) K^1/2, by power iteration. */
static double fastest_square(const struct plant_model *m, const plant_matrix minv)
{
    double v[PLANT_JOINTS_MAX], root[PLANT_JOINTS_MAX], rotor[PLANT_JOINTS_MAX], size = 0;
    for (int i = 0; i < m->joints; i++) {
        const double *k = m->joint[i].k_nmprad;
        rotor[i] = 1 / rotor_inertia(&m->joint[i]);
        root[i] = sqrt(fmax(k[0], fmax(k[1], k[2])));
        v[i] = 1 + 0.1 * i; /* not orthogonal to any mode by symmetry */
    }
    for (int step = 0; step < POWER_STEPS; step++) {
        double next[PLANT_JOINTS_MAX], square = 0;
        for (int i = 0; i < m->joints; i++) {
            double sum = root[i] * v[i] * rotor[i];
            for (int k = 0; k < m->joints; k++)
                sum += minv[i * PLANT_JOINTS_MAX + k] * root[k] * v[k];
            next[i] = root[i] * sum;
            square += next[i] * next[i];
        }
        size = sqrt(square);
        for (int i = 0; i < m->joints; i++)
            v[i] = next[i] / size;
    }
    return size;
}

/* Fastest rate (frequency of the stiffest mode, or decay by gear damping) and least link inertia of
 * every joint over the pose space. */
static int check_modes(const struct plant_model *m, double *rate_radps, double *inertia_kgm2)
{
    uint64_t rng = 1;
    double square = 0, decay = 0;
    for (int i = 0; i < m->joints; i++)
        inertia_kgm2[i] = HUGE_VAL;
    for (int p = 0; p < POSES; p++) {
        struct plant_pose pose;
        plant_matrix mass, minv;
        double q[PLANT_JOINTS_MAX];
        for (int i = 0; i < m->joints; i++)
            q[i] = p == 0 ? 0 : 3 * plant_gauss(&rng);
        plant_chain_pose(m, q, &pose);
        plant_chain_mass(m, &pose, mass);
        if (plant_invert(m->joints, mass, minv) < 0)
            return -1;
        square = fmax(square, fastest_square(m, minv));
        for (int i = 0; i < m->joints; i++)
            inertia_kgm2[i] = fmin(inertia_kgm2[i], 1 / minv[i * PLANT_JOINTS_MAX + i]);
    }
    for (int i = 0; i < m->joints; i++)
        decay = fmax(decay, m->joint[i].damping_nmspr
                                * (1 / inertia_kgm2[i] + 1 / rotor_inertia(&m->joint[i])));
    *rate_radps = fmax(sqrt(square), decay);
    return 0;
}

static const char *check_joints(struct plant_model *m)
{
    static const char *(*const check[])(const struct plant_joint *) = {
        check_frame, check_drive, check_friction, check_imperfections
    };
    for (int i = 0; i < m->joints; i++)
        for (size_t c = 0; c < sizeof check / sizeof check[0]; c++) {
            const char *wrong = check[c](&m->joint[i]);
            if (wrong != NULL) {
                m->check_joint = i + 1;
                return wrong;
            }
        }
    return NULL;
}

static const char *check_all(struct plant_model *m)
{
    double rate_radps, inertia_kgm2[PLANT_JOINTS_MAX];
    m->check_joint = 0;
    if (m->joints < 1 || m->joints > PLANT_JOINTS_MAX)
        return "joints: out of 1..PLANT_JOINTS_MAX";
    if (!finite_all(m->gravity_mps2, 3))
        return "gravity_mps2: not finite";
    if (!(m->payload_kg >= 0 && isfinite(m->payload_kg)) || !finite_all(m->payload_com_m, 3))
        return "payload_kg: negative or not finite";
    const char *wrong = check_joints(m);
    if (wrong != NULL)
        return wrong;
    if (check_modes(m, &rate_radps, inertia_kgm2) < 0)
        return "links: the mass matrix is not positive definite; the last links need mass and "
               "inertia";
    if (m->step_s == 0)
        m->step_s = STEP_RAD / rate_radps;
    if (!(m->step_s * rate_radps <= STEP_RAD_MAX && m->step_s >= STEP_S_MIN))
        return "step_s: too long for the stiffest mode, or below 0.1 us; 0 lets the check choose";
    for (int i = 0; i < m->joints; i++) {
        struct plant_joint *j = &m->joint[i];
        if (j->stop_nmprad == 0)
            j->stop_nmprad = j->k_nmprad[2];
        if (j->stop_nmspr == 0) /* half of critical for the lightest pose */
            j->stop_nmspr = sqrt(j->stop_nmprad * inertia_kgm2[i]);
    }
    return NULL;
}

int plant_model_check(struct plant_model *m, const char **why)
{
    const char *wrong = check_all(m);
    if (why != NULL)
        *why = wrong;
    return wrong == NULL ? 0 : -1;
}

/* ---- reset ---- */

static double cable_nm(const struct plant_joint *j, double q_rad)
{
    return j->fx_spring_nmprad * (q_rad - j->fx_spring_q0_rad);
}

void plant_reset(const struct plant_model *m, struct plant_state *s, const double *q_rad,
                 uint64_t seed)
{
    static const double rest[PLANT_JOINTS_MAX] = { 0 };
    struct plant_pose pose;
    double hold_nm[PLANT_JOINTS_MAX];
    memset(s, 0, sizeof *s);
    s->rng = seed;
    plant_chain_pose(m, q_rad, &pose);
    plant_chain_bias(m, &pose, rest, hold_nm);
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        double load = hold_nm[i] + cable_nm(j, q_rad[i]) - plant_stop_nm(j, q_rad[i], 0);
        s->q_rad[i] = q_rad[i];
        s->th_m_rad[i] = j->ratio * (q_rad[i] + plant_gear_windup_rad(j, load));
        s->gear_nm[i] = load;
        /* drawn whether used or not: a joint's numbers do not depend on another joint's sigma */
        s->run_coulomb_nm[i] = j->run_coulomb_sigma_nm * plant_gauss(&s->rng);
        s->wander_nm[i] = j->wander_sigma_nm * plant_gauss(&s->rng);
    }
}

/* ---- step ---- */

/* What stays the same over REFRESH inner steps. */
struct block {
    int n;
    plant_matrix minv;
    double drift_radps2[PLANT_JOINTS_MAX];   /* M^-1 (C qd + G) */
    double motor_nm[PLANT_JOINTS_MAX];       /* true motor torque, output side */
    double inertia[PLANT_JOINTS_MAX], per_ratio[PLANT_JOINTS_MAX];
    struct plant_rub rub[PLANT_JOINTS_MAX];
};

static void block_refresh(const struct plant_model *m, const struct plant_state *s, double span_s,
                          struct block *b)
{
    struct plant_pose pose;
    plant_matrix mass;
    double q[PLANT_JOINTS_MAX], bias[PLANT_JOINTS_MAX];
    for (int i = 0; i < b->n; i++)
        q[i] = s->q_rad[i] + s->qd_radps[i] * span_s / 2;
    plant_chain_pose(m, q, &pose);
    plant_chain_mass(m, &pose, mass);
    plant_chain_bias(m, &pose, s->qd_radps, bias);
    if (plant_invert(b->n, mass, b->minv) < 0)
        memset(b->minv, 0, sizeof b->minv); /* refused by the check: links stand still */
    for (int i = 0; i < b->n; i++) {
        double sum = 0;
        for (int k = 0; k < b->n; k++)
            sum += b->minv[i * PLANT_JOINTS_MAX + k] * bias[k];
        b->drift_radps2[i] = sum;
        plant_rub_prepare(&m->joint[i], s, i, &b->rub[i]);
    }
}

static void drift(const struct block *b, struct plant_state *s, double h_s)
{
    for (int i = 0; i < b->n; i++) {
        s->q_rad[i] += s->qd_radps[i] * h_s;
        s->th_m_rad[i] += s->thd_m_radps[i] * h_s;
    }
}

/* Torque through the gear now, its damping included. */
static double gear_now(const struct plant_joint *j, const struct plant_state *s, int i,
                       double per_ratio)
{
    return plant_gear_nm(j, s->th_m_rad[i] * per_ratio - s->q_rad[i])
           + j->damping_nmspr * (s->thd_m_radps[i] * per_ratio - s->qd_radps[i]);
}

static void inner_step(const struct plant_model *m, struct plant_state *s, const struct block *b,
                       double h_s)
{
    double link_nm[PLANT_JOINTS_MAX];
    drift(b, s, h_s / 2);
    for (int i = 0; i < b->n; i++) {
        const struct plant_joint *j = &m->joint[i];
        double gear = gear_now(j, s, i, b->per_ratio[i]);
        struct plant_kick k = { h_s, b->inertia[i], b->motor_nm[i] - gear, gear };
        link_nm[i] =
            gear - cable_nm(j, s->q_rad[i]) + plant_stop_nm(j, s->q_rad[i], s->qd_radps[i]);
        if (s->locked >> i & 1) {
            s->thd_m_radps[i] = 0;
            s->friction_nm[i] = k.drive_nm;
            continue;
        }
        double speed =
            plant_rub_kick(j, &b->rub[i], &k, s->th_m_rad[i] * b->per_ratio[i],
                           s->thd_m_radps[i] * b->per_ratio[i], &s->dahl_nm[i], &s->friction_nm[i]);
        s->thd_m_radps[i] = speed * j->ratio;
    }
    for (int i = 0; i < b->n; i++) {
        const double *row = b->minv + i * PLANT_JOINTS_MAX;
        double sum = -b->drift_radps2[i];
        for (int k = 0; k < b->n; k++)
            sum += row[k] * link_nm[k];
        s->qd_radps[i] += h_s * sum;
    }
    drift(b, s, h_s / 2);
}

static double cut(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value == value ? value : 0;
}

void plant_step(const struct plant_model *m, struct plant_state *s, const double *tau_m_nm,
                double dt_s)
{
    if (!(dt_s > 0))
        return;
    struct block b = { .n = m->joints };
    for (int i = 0; i < b.n; i++) {
        const struct plant_joint *j = &m->joint[i];
        b.motor_nm[i] = j->ratio * (1 + j->fx_torque_gain) * cut(tau_m_nm[i], j->tau_max_m_nm);
        b.inertia[i] = rotor_inertia(j);
        b.per_ratio[i] = 1 / j->ratio;
    }
    /* a last sliver of a step from rounding is not worth a step */
    long steps = (long)ceil(dt_s / m->step_s - 1e-6);
    steps = steps < 1 ? 1 : steps;
    double h_s = dt_s / (double)steps;
    while (steps > 0) {
        int count = steps < REFRESH ? (int)steps : REFRESH;
        block_refresh(m, s, count * h_s, &b);
        for (int k = 0; k < count; k++)
            inner_step(m, s, &b, h_s);
        for (int i = 0; i < b.n; i++)
            plant_rub_age(&m->joint[i], s, i, count * h_s);
        steps -= count;
    }
    for (int i = 0; i < b.n; i++)
        s->gear_nm[i] = gear_now(&m->joint[i], s, i, b.per_ratio[i]);
    s->t_s += dt_s;
}

double plant_energy_j(const struct plant_model *m, const struct plant_state *s)
{
    struct plant_pose pose;
    plant_matrix mass;
    plant_chain_pose(m, s->q_rad, &pose);
    plant_chain_mass(m, &pose, mass);
    double energy = plant_chain_potential_j(m, &pose);
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        double angle = s->th_m_rad[i] / j->ratio, speed = s->thd_m_radps[i] / j->ratio;
        double stretch = s->q_rad[i] - j->fx_spring_q0_rad;
        for (int k = 0; k < m->joints; k++)
            energy += s->qd_radps[i] * mass[i * PLANT_JOINTS_MAX + k] * s->qd_radps[k] / 2;
        energy += rotor_inertia(j) * speed * speed / 2 + plant_gear_energy_j(j, angle - s->q_rad[i])
                  + j->fx_spring_nmprad * stretch * stretch / 2 + plant_lines_energy_j(j, angle)
                  + plant_stop_energy_j(j, s->q_rad[i]);
    }
    return energy;
}
