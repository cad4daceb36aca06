/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Reset, step and energy of the plant.
 *
 * Verlet: drift half, kick, drift half, friction implicit in the kick.  The links' mass matrix and
 * bias torque turn slowly against the gear's ringing, so they are evaluated once per REFRESH inner
 * steps, at the pose expected in the middle of them.
 *
 * Runge-Kutta: rotors that stand and are not broken away stay fixed for the step, others keep their
 * sense of motion for it; the mesh is where it slips to from where it was at the step's start, which
 * makes its position a function of the stage's angles.  Order four between the steps in which
 * something sticks or lets go; those are met to the first order, and so is what is taken as it is when
 * the step begins: wander, warmth, dwell, dry spot, ripple of the current.
 *
 * Owns: the integration.
 * Never: holds the physics of a part: see plant_parts.h.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"

enum { REFRESH = 16, J = PLANT_JOINTS_MAX };

/* ---- what one instant is ---- */

/* Torques of one joint at one instant. */
struct joint_now {
    double mesh_rad;
    double gear_nm, wave_nm;
    double rotor_nm;                      /* on the rotor, before friction           */
    double link_nm;                       /* on the link, before inertia and gravity */
    double directed_nm;                   /* periodic friction                        */
    double sense, dry_nm;                 /* plant_rub_dry_nm for this sense          */
};

/* What stays the same over a block of inner steps. */
struct block {
    int n, elastic;                       /* joints; has any of them presliding?     */
    int varies[J];                        /* is anything below to be made anew with time? */
    struct plant_chain chain;
    struct plant_gear gear[J];
    double asked_m_nm[J];                 /* motor torque asked for                 */
    double motor_nm[J];                   /* given, output side                     */
    double outside_nm[J];                 /* contact and vibration, on the link     */
    double inertia[J], per_inertia[J], per_ratio[J];
    struct plant_rub rub[J];
    struct plant_phases phases[J];
};

/* fmax costs a call. */
static double more(double a, double b)
{
    return a > b ? a : b;
}

static double cable_nm(const struct plant_joint *j, double q_rad)
{
    return j->fx_spring_nmprad * (q_rad - j->fx_spring_q0_rad);
}

/* Mesh and the torques of gear and wave generator; less_nm: part of the mesh's loss that is not there. */
static void mesh_at(const struct plant_joint *j, const struct plant_gear *g, double less_nm, double th,
                    double ahead, double mesh, struct joint_now *now)
{
    now->mesh_rad = plant_mesh_slip(j, g, less_nm, th, ahead, mesh);
    now->wave_nm = plant_wave_at_nm(j, g, th - now->mesh_rad);
    now->gear_nm = plant_gear_at_nm(j, g, now->mesh_rad - ahead);
}

/* Everything on joint i at rotor angle th (output side) and speed w, link angle q and speed v; mesh:
 * where it was. */
static void joint_at(const struct plant_model *m, struct block *b, int i, double th, double w,
                     double q, double v, double mesh, struct joint_now *now)
{
    const struct plant_joint *j = &m->joint[i];
    const struct plant_gear *g = &b->gear[i];
    struct plant_periodic p = { 0 };
    if (j->lines + j->errors > 0)
        p = plant_periodic_at(j, &b->phases[i], th, w);
    double ahead = q - p.error_rad, damping = j->damping_nmspr * (w - v);
    if (j->soft_nm > 0) {
        mesh_at(j, g, 0, th, ahead, mesh, now);
    } else {
        now->mesh_rad = th;
        now->wave_nm = now->gear_nm = plant_gear_at_nm(j, g, th - ahead);
    }
    double load = fabs(now->gear_nm + damping), wave = fabs(now->wave_nm);
    now->directed_nm = p.directed_nm + p.directed_per * load;
    if (wave < j->soft_nm) /* it comes from the teeth's load, and goes with it */
        now->directed_nm *= wave / j->soft_nm;
    now->sense = w > 0 || (w == 0 && b->motor_nm[i] >= now->wave_nm) ? 1 : -1;
    now->dry_nm = plant_rub_dry_nm(j, &b->rub[i], now->sense, now->sense * w, now->gear_nm + damping,
                                   now->directed_nm);
    if (now->dry_nm < 0 && j->soft_nm > 0) /* what lines take beyond the rotor's friction, the mesh gives */
        mesh_at(j, g, now->dry_nm, th, ahead, mesh, now);
    now->rotor_nm = b->motor_nm[i] - now->wave_nm - now->gear_nm * p.error_slope - damping
                    - p.torque_nm - p.torque_per * load;
    now->gear_nm += damping;
    now->link_nm = now->gear_nm - cable_nm(j, q) + b->outside_nm[i];
    if (q > j->q_max_rad || q < j->q_min_rad)
        now->link_nm += plant_stop_nm(j, q, v);
}

/* Do torques that are taken as constant for a step or a few depend on time, angle or age? */
static int varies(const struct plant_joint *j)
{
    return j->fx_warm_s > 0 || j->wander_sigma_nm > 0 || j->fx_dwell_nm != 0 || j->fx_local_nm != 0
           || j->fx_current_ripple != 0 || j->fx_vibration_nm != 0;
}

static void block_begin(const struct plant_model *m, struct plant_state *s, const double *tau_m_nm,
                        struct block *b)
{
    b->n = m->joints;
    b->elastic = 0;
    plant_chain_prepare(m, &b->chain);
    for (int i = 0; i < b->n; i++) {
        const struct plant_joint *j = &m->joint[i];
        b->asked_m_nm[i] = tau_m_nm[i];
        b->inertia[i] = plant_rotor_kgm2(j);
        b->per_inertia[i] = 1 / b->inertia[i];
        b->per_ratio[i] = 1 / j->ratio;
        b->varies[i] = varies(j);
        b->elastic |= j->fx_presliding_nm > 0;
        if (!(j->fx_presliding_nm > 0))
            s->dahl_nm[i] = 0; /* nothing is left of it when it ends */
        plant_gear_prepare(j, &b->gear[i]);
        plant_rub_begin(j, &b->rub[i]);
    }
}

/* Sines of everything periodic, at the state's angles. */
static void block_phases(const struct plant_model *m, const struct plant_state *s, struct block *b)
{
    for (int i = 0; i < b->n; i++)
        if (m->joint[i].lines + m->joint[i].errors > 0)
            plant_phases_set(&m->joint[i], s, i, &b->phases[i]);
}

/* The slow things at the state's instant, for the next span_s; all: also what does not vary. */
static void block_refresh(const struct plant_model *m, const struct plant_state *s, double t_s,
                          double span_s, int all, struct block *b)
{
    for (int i = 0; i < b->n; i++) {
        const struct plant_joint *j = &m->joint[i];
        if (!b->varies[i] && !all)
            continue;
        b->motor_nm[i] =
            plant_motor_nm(j, b->asked_m_nm[i], s->th_m_rad[i] * b->per_ratio[i], s->warm[i]);
        b->outside_nm[i] = -j->fx_contact_nm;
        if (j->fx_vibration_nm != 0)
            b->outside_nm[i] += j->fx_vibration_nm
                                * sin(6.283185307179586 * j->fx_vibration_hz * (t_s + span_s / 2)
                                      + s->phase_rad[i]);
        plant_rub_prepare(j, s, i, &b->rub[i]);
    }
}

/* ---- reset ---- */

/* Rotor and mesh so that the gear carries load_nm at rest and everything is in the middle of its
 * friction. */
static void wind_up(const struct plant_joint *j, struct plant_state *s, int i, double load_nm)
{
    struct plant_phases phases;
    double behind = s->q_rad[i] + plant_gear_windup_rad(j, load_nm);
    double ahead = j->soft_nm > 0 ? plant_wave_windup_rad(j, load_nm) : 0, error = 0;
    for (int k = 0; k < 20; k++) { /* the error is small and flat: each round gains a digit or more */
        s->th_m_rad[i] = j->ratio * (behind - error + ahead);
        plant_phases_set(j, s, i, &phases);
        error = plant_periodic_at(j, &phases, s->th_m_rad[i] / j->ratio, 0).error_rad;
    }
    s->mesh_rad[i] = behind - error;
    s->gear_nm[i] = s->wave_nm[i] = load_nm;
}

void plant_reset(const struct plant_model *base, struct plant_state *s, const double *q_rad,
                 uint64_t seed)
{
    static const double rest[J] = { 0 };
    struct plant_model scratch;
    const struct plant_model *m = plant_now(base, 0, &scratch);
    struct plant_chain chain;
    plant_matrix mass;
    double hold_nm[J];
    memset(s, 0, sizeof *s);
    s->rng = seed;
    plant_chain_prepare(m, &chain);
    plant_chain_terms(&chain, q_rad, rest, mass, hold_nm);
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        /* drawn whether used or not: a joint's numbers do not depend on another joint's sigma */
        s->run_coulomb_nm[i] = j->run_coulomb_sigma_nm * plant_gauss(&s->rng);
        s->wander_nm[i] = j->wander_sigma_nm * plant_gauss(&s->rng);
    }
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        s->phase_rad[i] = 6.283185307179586 * plant_uniform(&s->rng);
        s->q_rad[i] = q_rad[i];
        wind_up(j, s, i, hold_nm[i] + cable_nm(j, q_rad[i]) - plant_stop_nm(j, q_rad[i], 0)
                             + j->fx_contact_nm);
    }
}

/* ---- Verlet ---- */

struct links { plant_matrix minv; double drift_radps2[J]; }; /* M^-1, M^-1 (C qd + G) */

static void links_at(const struct block *b, const double *q, const double *qd, struct links *l)
{
    plant_matrix mass;
    double bias[J];
    plant_chain_terms(&b->chain, q, qd, mass, bias);
    if (plant_invert(b->n, mass, l->minv) < 0)
        memset(l->minv, 0, sizeof l->minv); /* refused by the check: links stand still */
    for (int i = 0; i < b->n; i++) {
        double sum = 0;
        for (int k = 0; k < b->n; k++)
            sum += l->minv[i * J + k] * bias[k];
        l->drift_radps2[i] = sum;
    }
}

static void drift(const struct block *b, struct plant_state *s, double h_s)
{
    for (int i = 0; i < b->n; i++) {
        s->q_rad[i] += s->qd_radps[i] * h_s;
        s->th_m_rad[i] += s->thd_m_radps[i] * h_s;
    }
}

static void kick_rotor(const struct plant_model *m, struct plant_state *s, struct block *b, int i,
                       double h_s, double *link_nm)
{
    const struct plant_joint *j = &m->joint[i];
    double speed = s->thd_m_radps[i] * b->per_ratio[i];
    struct joint_now now;
    joint_at(m, b, i, s->th_m_rad[i] * b->per_ratio[i], speed, s->q_rad[i], s->qd_radps[i],
             s->mesh_rad[i], &now);
    s->mesh_rad[i] = now.mesh_rad;
    s->gear_nm[i] = now.gear_nm;
    s->wave_nm[i] = now.wave_nm;
    *link_nm = now.link_nm;
    if (s->locked >> i & 1) {
        s->thd_m_radps[i] = 0;
        s->friction_nm[i] = now.rotor_nm;
        return;
    }
    struct plant_kick k = { h_s,  b->inertia[i], now.rotor_nm, now.gear_nm, now.directed_nm,
                            now.sense, now.dry_nm };
    s->thd_m_radps[i] =
        j->ratio * plant_rub_kick(j, &b->rub[i], &k, speed, &s->dahl_nm[i], &s->friction_nm[i]);
}

static void verlet_step(const struct plant_model *m, struct plant_state *s, struct block *b,
                        const struct links *l, double h_s)
{
    double link_nm[J];
    drift(b, s, h_s / 2);
    for (int i = 0; i < b->n; i++)
        kick_rotor(m, s, b, i, h_s, &link_nm[i]);
    for (int i = 0; i < b->n; i++) {
        const double *row = l->minv + i * J;
        double sum = -l->drift_radps2[i];
        for (int k = 0; k < b->n; k++)
            sum += row[k] * link_nm[k];
        s->qd_radps[i] += h_s * sum;
    }
    drift(b, s, h_s / 2);
}

static void verlet_block(const struct plant_model *m, struct plant_state *s, struct block *b, int count,
                         double h_s)
{
    struct links l;
    double q[J];
    for (int i = 0; i < b->n; i++)
        q[i] = s->q_rad[i] + s->qd_radps[i] * count * h_s / 2;
    links_at(b, q, s->qd_radps, &l);
    for (int k = 0; k < count; k++)
        verlet_step(m, s, b, &l, h_s);
}

/* ---- Runge-Kutta ---- */

/* What is integrated, output side, and its rates. */
struct motion { double q[J], qd[J], th[J], w[J], dahl[J]; };

/* What is fixed for one step: sense of every rotor, 0: it stands. */
struct sticking { double sense[J]; };

/* out = a + h rate; presliding only where there is some. */
static void motion_add(const struct block *b, const struct motion *a, const struct motion *rate, double h,
                       struct motion *out)
{
    for (int i = 0; i < b->n; i++) {
        out->q[i] = a->q[i] + h * rate->q[i];
        out->qd[i] = a->qd[i] + h * rate->qd[i];
        out->th[i] = a->th[i] + h * rate->th[i];
        out->w[i] = a->w[i] + h * rate->w[i];
    }
    for (int i = 0; i < b->n && b->elastic; i++)
        out->dahl[i] = a->dahl[i] + h * rate->dahl[i];
}

static double rotor_rate(const struct plant_joint *j, const struct block *b, int i, double sense,
                         const struct motion *x, const struct joint_now *now, double *friction_nm)
{
    double along = sense * x->w[i];
    double dry = more(0, sense == now->sense ? now->dry_nm
                                             : plant_rub_dry_nm(j, &b->rub[i], sense, along,
                                                                now->gear_nm, now->directed_nm));
    *friction_nm = sense * (dry + b->rub[i].viscous_nmspr[sense < 0] * along) + x->dahl[i];
    return (now->rotor_nm - *friction_nm) * b->per_inertia[i];
}

/* Rates at x, with the joints as they are there; friction torques go into s. */
static void rates(const struct plant_model *m, struct block *b, struct plant_state *s,
                  const struct sticking *st, const struct motion *x, struct motion *rate,
                  struct joint_now *now)
{
    plant_matrix mass, factor;
    double bias[J], link_nm[J];
    for (int i = 0; i < b->n; i++) {
        const struct plant_joint *j = &m->joint[i];
        joint_at(m, b, i, x->th[i], x->w[i], x->q[i], x->qd[i], s->mesh_rad[i], &now[i]);
        rate->q[i] = x->qd[i];
        rate->th[i] = x->w[i];
        rate->w[i] = rate->dahl[i] = 0;
        s->friction_nm[i] = now[i].rotor_nm;
        if (st->sense[i] == 0)
            continue;
        rate->w[i] = rotor_rate(j, b, i, st->sense[i], x, &now[i], &s->friction_nm[i]);
        if (b->rub[i].elastic_nm > 0)
            rate->dahl[i] = fabs(x->w[i]) / j->fx_presliding_rad
                            * (st->sense[i] * b->rub[i].elastic_nm - x->dahl[i]);
    }
    plant_chain_terms(&b->chain, x->q, x->qd, mass, bias);
    for (int i = 0; i < b->n; i++)
        link_nm[i] = now[i].link_nm - bias[i];
    if (plant_factor(b->n, mass, factor) < 0)
        memset(rate->qd, 0, sizeof rate->qd); /* refused by the check */
    else
        plant_solve(b->n, factor, link_nm, rate->qd);
}

/* Which way every rotor goes in the step from x: as it goes, or as it is broken away. */
static void decide(const struct plant_model *m, struct block *b, struct plant_state *s,
                   const struct motion *x, struct sticking *st)
{
    for (int i = 0; i < b->n; i++) {
        struct joint_now now;
        st->sense[i] = x->w[i] > 0 ? 1 : x->w[i] < 0 ? -1 : 0;
        if (s->locked >> i & 1)
            st->sense[i] = 0;
        else if (st->sense[i] == 0) {
            joint_at(m, b, i, x->th[i], 0, x->q[i], x->qd[i], s->mesh_rad[i], &now);
            double drive = now.rotor_nm - x->dahl[i], sense = drive < 0 ? -1 : 1;
            double dry = sense == now.sense ? now.dry_nm
                                            : plant_rub_dry_nm(&m->joint[i], &b->rub[i], sense, 0,
                                                               now.gear_nm, now.directed_nm);
            st->sense[i] = fabs(drive) > more(0, dry) ? sense : 0;
        }
    }
}

/* A rotor that has turned back stays where it is if friction holds it there. */
static double settled_radps(const struct plant_model *m, struct block *b, const struct plant_state *s,
                            const struct sticking *st, const struct motion *x, int i)
{
    struct joint_now now;
    if (st->sense[i] == 0)
        return 0;
    if (st->sense[i] * x->w[i] > 0)
        return x->w[i];
    joint_at(m, b, i, x->th[i], 0, x->q[i], x->qd[i], s->mesh_rad[i], &now);
    return fabs(now.rotor_nm - x->dahl[i]) <= more(now.dry_nm, 0) ? 0 : x->w[i];
}

static void motion_get(const struct block *b, const struct plant_state *s, struct motion *x)
{
    for (int i = 0; i < b->n; i++) {
        x->q[i] = s->q_rad[i];
        x->qd[i] = s->qd_radps[i];
        x->th[i] = s->th_m_rad[i] * b->per_ratio[i];
        x->w[i] = s->locked >> i & 1 ? 0 : s->thd_m_radps[i] * b->per_ratio[i];
        x->dahl[i] = s->dahl_nm[i];
    }
}

static void motion_put(const struct plant_model *m, struct block *b, const struct sticking *st,
                       const struct motion *x, struct plant_state *s)
{
    for (int i = 0; i < b->n; i++) {
        double ratio = m->joint[i].ratio, w = settled_radps(m, b, s, st, x, i);
        s->q_rad[i] = x->q[i];
        s->qd_radps[i] = x->qd[i];
        if (st->sense[i] != 0) /* angle times 1 / ratio times ratio need not come back */
            s->th_m_rad[i] = x->th[i] * ratio;
        s->thd_m_radps[i] = w * ratio;
        if (b->elastic)
            s->dahl_nm[i] = x->dahl[i];
    }
}

/* The mesh comes to where the step began with the first stage, and is held there for the others. */
static void rk4_step(const struct plant_model *m, struct plant_state *s, struct block *b, double h_s)
{
    static const double at[] = { 0.5, 0.5, 1 }, weight[] = { 2, 2, 1 };
    struct motion x, stage, rate, sum;
    struct joint_now now[J];
    struct sticking st;
    motion_get(b, s, &x);
    memcpy(stage.dahl, x.dahl, sizeof stage.dahl);
    decide(m, b, s, &x, &st);
    rates(m, b, s, &st, &x, &sum, now);
    for (int i = 0; i < b->n; i++)
        s->mesh_rad[i] = now[i].mesh_rad;
    motion_add(b, &x, &sum, h_s / 2, &stage);
    for (int k = 0; k < 3; k++) {
        if (k > 0)
            motion_add(b, &x, &rate, at[k] * h_s, &stage);
        rates(m, b, s, &st, &stage, &rate, now);
        motion_add(b, &sum, &rate, weight[k], &sum);
    }
    motion_add(b, &x, &sum, h_s / 6, &x);
    motion_put(m, b, &st, &x, s);
}

/* ---- step ---- */

void plant_step(const struct plant_model *base, struct plant_state *s, const double *tau_m_nm,
                double dt_s)
{
    if (!(dt_s > 0))
        return;
    struct plant_model scratch;
    const struct plant_model *m = plant_now(base, s->t_s, &scratch);
    struct block b;
    block_begin(m, s, tau_m_nm, &b);
    /* a last sliver of a step from rounding is not worth a step */
    long steps = (long)ceil(dt_s / m->step_s - 1e-6), done = 0;
    steps = steps < 1 ? 1 : steps;
    double h_s = dt_s / (double)steps;
    while (done < steps) {
        long left = steps - done;
        int count = m->integrator == PLANT_RK4 ? 1 : left < REFRESH ? (int)left : REFRESH;
        double t_s = s->t_s + (double)done * h_s;
        block_refresh(m, s, t_s, count * h_s, done == 0, &b);
        if (m->integrator == PLANT_VERLET || done % REFRESH == 0)
            block_phases(m, s, &b);
        if (m->integrator == PLANT_RK4)
            rk4_step(m, s, &b, h_s);
        else
            verlet_block(m, s, &b, count, h_s);
        for (int i = 0; i < b.n; i++)
            if (b.varies[i])
                plant_rub_age(&m->joint[i], s, i, count * h_s);
        done += count;
    }
    for (int i = 0; i < b.n; i++) {
        struct joint_now now;
        joint_at(m, &b, i, s->th_m_rad[i] * b.per_ratio[i], s->thd_m_radps[i] * b.per_ratio[i],
                 s->q_rad[i], s->qd_radps[i], s->mesh_rad[i], &now);
        s->mesh_rad[i] = now.mesh_rad;
        s->gear_nm[i] = now.gear_nm;
        s->wave_nm[i] = now.wave_nm;
    }
    s->t_s += dt_s;
}

/* ---- energy ---- */

static double springs_j(const struct plant_joint *j, const struct plant_state *s, int i)
{
    struct plant_phases phases;
    double angle = s->th_m_rad[i] / j->ratio, stretch = s->q_rad[i] - j->fx_spring_q0_rad;
    plant_phases_set(j, s, i, &phases);
    double error = plant_periodic_at(j, &phases, angle, 0).error_rad;
    double mesh = j->soft_nm > 0 ? s->mesh_rad[i] : angle;
    double energy = plant_gear_energy_j(j, mesh + error - s->q_rad[i])
                    + j->fx_spring_nmprad * stretch * stretch / 2 + plant_lines_energy_j(j, s, i)
                    + plant_stop_energy_j(j, s->q_rad[i]);
    return j->soft_nm > 0 ? energy + plant_wave_energy_j(j, angle - mesh) : energy;
}

double plant_energy_j(const struct plant_model *base, const struct plant_state *s)
{
    struct plant_model scratch;
    const struct plant_model *m = plant_now(base, s->t_s, &scratch);
    struct plant_chain chain;
    plant_matrix mass;
    double bias[J];
    plant_chain_prepare(m, &chain);
    plant_chain_terms(&chain, s->q_rad, s->qd_radps, mass, bias);
    double energy = plant_chain_height_j(&chain, s->q_rad);
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        double speed = s->thd_m_radps[i] / j->ratio;
        for (int k = 0; k < m->joints; k++)
            energy += s->qd_radps[i] * mass[i * J + k] * s->qd_radps[k] / 2;
        energy += plant_rotor_kgm2(j) * speed * speed / 2 + springs_j(j, s, i);
    }
    return energy;
}
