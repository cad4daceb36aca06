/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a model must be to be a plant, and the step that suits it.
 *
 * Owns: plant_model_check, plant_now.
 * Never: moves anything.
 */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "sim/plant_parts.h"

enum { POSES = 64, POWER_STEPS = 40 };

/* Inner step times the fastest frequency: keeps the frequency within 1 %.  Unstable from 2 on by
 * Verlet, from 2.8 on by Runge-Kutta. */
static const double STEP_RAD = 0.5;
static const double STEP_RAD_MAX[] = { [PLANT_VERLET] = 1.5, [PLANT_RK4] = 2.5 };
static const double STEP_S_MIN = 1e-7;
static const double REPORT_DELAY_MAX_S = 0.04;

double plant_rotor_kgm2(const struct plant_joint *j)
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

static const char *check_mesh(const struct plant_joint *j)
{
    const struct plant_mesh *m = &j->mesh;
    const double all[] = { m->drive_nm, m->back_nm, m->drive_load, m->back_load };
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        if (!(all[i] >= 0 && isfinite(all[i])))
            return "mesh: negative or not finite";
    if (!(m->drive_load < 1))
        return "mesh: drive_load must be below 1, or nothing comes out of the gear";
    if (m->back_nm > m->drive_nm)
        return "mesh: back_nm above drive_nm";
    if (j->soft_nm == 0)
        return m->drive_nm == 0 && m->back_load == 0
                   ? NULL
                   : "mesh: a loss needs a wave generator that winds up (soft_nm)";
    if (!(j->soft_nm > 0 && j->soft_nmprad > 0 && j->hard_nmprad > 0 && isfinite(j->soft_nm)
          && isfinite(j->soft_nmprad) && isfinite(j->hard_nmprad)))
        return "soft_nm, soft_nmprad, hard_nmprad: must be positive and finite";
    if (!(m->drive_nm - m->back_nm < 2 * j->soft_nm))
        return "mesh: loss grows faster than the torque that drives it; the gear would lock";
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
    const char *wrong = check_mesh(j);
    if (wrong != NULL)
        return wrong;
    if (!(j->damping_nmspr >= 0 && isfinite(j->damping_nmspr)))
        return "damping_nmspr: negative";
    if (!(j->rotor_kgm2_m > 0 && isfinite(j->rotor_kgm2_m)))
        return "rotor_kgm2_m: must be positive";
    if (!(plant_rotor_kgm2(j) > 0 && isfinite(plant_rotor_kgm2(j))))
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
            || l->order_rev == 0 || !isfinite(l->per_load) || !isfinite(l->per_speed_nmspr))
            return "line: order must not be zero, all numbers finite";
    }
    if (j->errors < 0 || j->errors > PLANT_ERRORS_MAX)
        return "errors: out of 0..PLANT_ERRORS_MAX";
    double slope = 0;
    for (int i = 0; i < j->errors; i++) {
        const struct plant_error *e = &j->error[i];
        if (!isfinite(e->order_rev) || !isfinite(e->amplitude_rad) || !isfinite(e->phase_rad))
            return "error: a number is not finite";
        slope += fabs(e->order_rev * e->amplitude_rad);
    }
    if (slope >= 0.5)
        return "error: kinematic error so steep that the gear would nearly turn back";
    return NULL;
}

static const char *check_imperfections(const struct plant_joint *j)
{
    const double all[] = { j->run_coulomb_sigma_nm, j->wander_sigma_nm,   j->wander_s,
                           j->torque_noise_m_nm,    j->fx_load_mu,        j->fx_warm_s,
                           j->fx_presliding_nm,     j->fx_presliding_rad, j->fx_spring_nmprad,
                           j->fx_drive_mu,          j->fx_dwell_nm,       j->fx_dwell_rad,
                           j->fx_dead_m_nm,         j->fx_dead_width_m_nm, j->fx_knee_m_nm,
                           j->fx_local_width_rad,   j->fx_slow_radps,     j->fx_drag_nm,
                           j->fx_vibration_hz,      j->fx_report_delay_s, j->fx_stale_share };
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        if (!(all[i] >= 0 && isfinite(all[i])))
            return "an imperfection or effect that must not be negative is, or is not finite";
    if (!(j->fx_torque_gain > -1 && isfinite(j->fx_torque_gain)))
        return "fx_torque_gain: must be above -1";
    const double finite[] = { j->fx_spring_q0_rad,    j->fx_gain_warm,           j->fx_current_offset_m_nm,
                              j->fx_knee_share,       j->fx_current_ripple,      j->fx_current_order_rev,
                              j->fx_slow_nm,          j->fx_quadratic_nms2prad2, j->fx_local_nm,
                              j->fx_local_rad,        j->fx_contact_nm,          j->fx_vibration_nm,
                              j->fx_resolver_rad,     j->fx_eccentric_rad,       j->fx_eccentric_order_rev,
                              j->fx_eccentric_phase_rad };
    for (size_t i = 0; i < sizeof finite / sizeof finite[0]; i++)
        if (!isfinite(finite[i]))
            return "an effect is not finite (fx_spring_q0_rad to fx_eccentric_phase_rad)";
    if (j->fx_knee_share > 1)
        return "fx_knee_share: above 1, more torque asked would give less";
    if (j->fx_dead_m_nm > 0 && j->fx_dead_width_m_nm == 0)
        return "fx_dead_width_m_nm: a dead time needs the current it fades over";
    if (j->fx_slow_nm != 0 && j->fx_slow_radps == 0)
        return "fx_slow_radps: an excess at low speed needs the speed it falls over";
    if (j->fx_dwell_nm > 0 && j->fx_dwell_rad == 0)
        return "fx_dwell_rad: dwell friction needs the travel it is lost over";
    if (j->fx_local_nm != 0 && j->fx_local_width_rad == 0)
        return "fx_local_width_rad: a dry spot needs a width";
    if (j->fx_gain_warm != 0 && j->fx_warm_s == 0)
        return "fx_warm_s: a gain that drifts needs a thermal time";
    if (j->fx_report_delay_s > REPORT_DELAY_MAX_S)
        return "fx_report_delay_s: above 0.04 s";
    if (j->fx_stale_share >= 1)
        return "fx_stale_share: 1 or more, nothing would ever be read";
    if (!(j->fx_cold_coulomb >= -1 && j->fx_cold_viscous >= -1 && isfinite(j->fx_cold_coulomb)
          && isfinite(j->fx_cold_viscous)))
        return "fx_cold_coulomb, fx_cold_viscous: must be -1 or more";
    if ((j->fx_cold_coulomb != 0 || j->fx_cold_viscous != 0) && j->fx_warm_s == 0)
        return "fx_warm_s: a cold excess needs a thermal time";
    if (j->wander_sigma_nm > 0 && j->wander_s == 0)
        return "wander_s: a wander needs its correlation time";
    if (j->fx_presliding_nm > 0 && j->fx_presliding_rad == 0)
        return "fx_presliding_rad: presliding needs its travel constant";
    if (j->fx_presliding_nm / 2 > fmin(j->friction[0].f0_nm, j->friction[1].f0_nm) + j->mesh.drive_nm)
        return "fx_presliding_nm: more than twice the Coulomb friction there is";
    return NULL;
}

/* Largest eigenvalue of K^1/2 (1 / J + M^-1) K^1/2, by power iteration: the flexsplines, with
 * whatever is on the wave generators' side as light as the rotor. */
static double fastest_square(const struct plant_model *m, const plant_matrix minv)
{
    double v[PLANT_JOINTS_MAX], root[PLANT_JOINTS_MAX], rotor[PLANT_JOINTS_MAX], size = 0;
    for (int i = 0; i < m->joints; i++) {
        const double *k = m->joint[i].k_nmprad;
        rotor[i] = 1 / plant_rotor_kgm2(&m->joint[i]);
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
    static const double still[PLANT_JOINTS_MAX] = { 0 };
    struct plant_chain chain;
    uint64_t rng = 1;
    double square = 0, decay = 0;
    plant_chain_prepare(m, &chain);
    for (int i = 0; i < m->joints; i++)
        inertia_kgm2[i] = HUGE_VAL;
    for (int p = 0; p < POSES; p++) {
        plant_matrix mass, minv;
        double q[PLANT_JOINTS_MAX], bias[PLANT_JOINTS_MAX];
        for (int i = 0; i < m->joints; i++)
            q[i] = p == 0 ? 0 : 3 * plant_gauss(&rng);
        plant_chain_terms(&chain, q, still, mass, bias);
        if (plant_invert(m->joints, mass, minv) < 0)
            return -1;
        square = fmax(square, fastest_square(m, minv));
        for (int i = 0; i < m->joints; i++)
            inertia_kgm2[i] = fmin(inertia_kgm2[i], 1 / minv[i * PLANT_JOINTS_MAX + i]);
    }
    for (int i = 0; i < m->joints; i++) /* rotor against a mesh that sticks */
        if (m->joint[i].soft_nm > 0)
            square = fmax(square, fmax(m->joint[i].soft_nmprad, m->joint[i].hard_nmprad)
                                      / plant_rotor_kgm2(&m->joint[i]));
    for (int i = 0; i < m->joints; i++)
        decay = fmax(decay, m->joint[i].damping_nmspr
                                * (1 / inertia_kgm2[i] + 1 / plant_rotor_kgm2(&m->joint[i])));
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
    if (m->integrator != PLANT_VERLET && m->integrator != PLANT_RK4)
        return "integrator: not one of enum plant_integrator";
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
    if (!(m->step_s * rate_radps <= STEP_RAD_MAX[m->integrator] && m->step_s >= STEP_S_MIN))
        return "step_s: too long for the stiffest mode, so unstable, or below 0.1 us; 0 lets the "
               "check choose";
    for (int i = 0; i < m->joints; i++) {
        struct plant_joint *j = &m->joint[i];
        if (j->stop_nmprad == 0)
            j->stop_nmprad = j->k_nmprad[2];
        if (j->stop_nmspr == 0) /* half of critical for the lightest pose */
            j->stop_nmspr = sqrt(j->stop_nmprad * inertia_kgm2[i]);
    }
    return NULL;
}

/* ---- changes ---- */

static void add(struct plant_model *m, const struct plant_change *c)
{
    double value;
    memcpy(&value, (const char *)m + c->field, sizeof value);
    value += c->add;
    memcpy((char *)m + c->field, &value, sizeof value);
}

/* The model must also be a plant with all of its changes at once. */
static const char *check_changes(struct plant_model *m)
{
    if (m->changes < 0 || m->changes > PLANT_CHANGES_MAX)
        return "changes: out of 0..PLANT_CHANGES_MAX";
    if (m->changes == 0)
        return NULL;
    struct plant_model all = *m;
    for (int i = 0; i < m->changes; i++) {
        const struct plant_change *c = &m->change[i];
        size_t last = offsetof(struct plant_model, joint) + (size_t)m->joints * sizeof m->joint[0];
        if (c->field % sizeof(double) != 0 || c->field + sizeof(double) > last)
            return "change: field is not a double of this model";
        if (!isfinite(c->add) || !(c->from_s < c->to_s))
            return "change: add must be finite, from_s before to_s";
        add(&all, c);
    }
    all.changes = 0;
    const char *wrong = check_all(&all);
    m->check_joint = all.check_joint;
    return wrong;
}

const struct plant_model *plant_now(const struct plant_model *m, double t_s,
                                    struct plant_model *scratch)
{
    int changed = 0;
    for (int i = 0; i < m->changes; i++) {
        const struct plant_change *c = &m->change[i];
        if (t_s < c->from_s || t_s >= c->to_s)
            continue;
        if (!changed)
            *scratch = *m;
        changed = 1;
        add(scratch, c);
    }
    if (changed)
        scratch->changes = 0;
    return changed ? scratch : m;
}

int plant_model_check(struct plant_model *m, const char **why)
{
    const char *wrong = check_all(m);
    if (wrong == NULL)
        wrong = check_changes(m);
    if (why != NULL)
        *why = wrong;
    return wrong == NULL ? 0 : -1;
}
