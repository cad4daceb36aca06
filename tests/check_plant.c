/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The plant against physics: energy, an independent inverse dynamics, catalogue torsion, true
 * stiction, symmetry, and what each imperfection and hidden effect must do.
 *
 * Owns: properties of sim/plant*.
 * Never: compares with a recorded run.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"
#include "tests/plant_rod.h"

enum { N = PA10_JOINTS };

static struct plant_model pa10_checked(void)
{
    struct plant_model m = pa10_plant();
    accept(&m);
    return m;
}

/* The rod without gravity and without friction. */
static struct plant_model free_rod(void)
{
    struct plant_model m = rod();
    m.gravity_mps2[2] = 0;
    pa10_frictionless(&m);
    return m;
}

static void random_pose(uint64_t *rng, double *q)
{
    for (int i = 0; i < N; i++)
        q[i] = test_uniform(rng, -2.5, 2.5);
    q[1] = test_uniform(rng, -1.6, 1.6); /* inside the end stops */
    q[3] = test_uniform(rng, -2.3, 2.3);
}

/* ---- an independent inverse dynamics: link frames, centres of mass, as in Craig's textbook ---- */

struct vec { double x[3]; };

static struct vec vadd(struct vec a, struct vec b)
{
    return (struct vec){ { a.x[0] + b.x[0], a.x[1] + b.x[1], a.x[2] + b.x[2] } };
}
static struct vec vscale(struct vec a, double k)
{
    return (struct vec){ { a.x[0] * k, a.x[1] * k, a.x[2] * k } };
}
static struct vec vcross(struct vec a, struct vec b)
{
    return (struct vec){ { a.x[1] * b.x[2] - a.x[2] * b.x[1], a.x[2] * b.x[0] - a.x[0] * b.x[2],
                           a.x[0] * b.x[1] - a.x[1] * b.x[0] } };
}

/* Rotation parent -> child frame written out: (rot Rz(q))' v, or its transpose. */
static struct vec turn(const struct plant_joint *j, double q, struct vec v, int to_child)
{
    double rz[3][3] = { { cos(q), -sin(q), 0 }, { sin(q), cos(q), 0 }, { 0, 0, 1 } },
           full[3][3] = { { 0 } };
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int k = 0; k < 3; k++)
                full[a][b] += j->rot[3 * a + k] * rz[k][b];
    struct vec out = { { 0 } };
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            out.x[a] += (to_child ? full[b][a] : full[a][b]) * v.x[b];
    return out;
}

/* Link i's mass, centre, and inertia about the centre, payload included, from the parameters. */
static double link_com(const struct plant_model *m, int i, struct vec *com, double inertia[3][3])
{
    static const int at[3][3] = { { 0, 1, 2 }, { 1, 3, 4 }, { 2, 4, 5 } };
    const struct plant_joint *j = &m->joint[i];
    double load = i == m->joints - 1 ? m->payload_kg : 0, mass = j->mass_kg + load, cc = 0, pp = 0;
    for (int k = 0; k < 3; k++) {
        com->x[k] = (j->moment_kgm[k] + load * m->payload_com_m[k]) / mass;
        cc += com->x[k] * com->x[k];
        pp += m->payload_com_m[k] * m->payload_com_m[k];
    }
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            inertia[a][b] = j->inertia_kgm2[at[a][b]]
                            - mass * ((a == b) * cc - com->x[a] * com->x[b])
                            + load * ((a == b) * pp - m->payload_com_m[a] * m->payload_com_m[b]);
    return mass;
}

static void inverse_dynamics(const struct plant_model *m, const double *q, const double *qd,
                             const double *qdd, double *tau)
{
    struct vec w = { { 0 } }, al = { { 0 } };
    struct vec force[PLANT_JOINTS_MAX], moment[PLANT_JOINTS_MAX], offset[PLANT_JOINTS_MAX];
    struct vec acc = { { -m->gravity_mps2[0], -m->gravity_mps2[1], -m->gravity_mps2[2] } };
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        struct vec z = { { 0, 0, 1 } }, r = { { j->trans_m[0], j->trans_m[1], j->trans_m[2] } },
                   com;
        double in[3][3], mass = link_com(m, i, &com, in);
        acc = turn(j, q[i], vadd(acc, vadd(vcross(al, r), vcross(w, vcross(w, r)))), 1);
        w = turn(j, q[i], w, 1);
        al = vadd(turn(j, q[i], al, 1), vadd(vscale(vcross(w, z), qd[i]), vscale(z, qdd[i])));
        w = vadd(w, vscale(z, qd[i]));
        struct vec ac = vadd(acc, vadd(vcross(al, com), vcross(w, vcross(w, com)))), iw = { { 0 } },
                   ia = { { 0 } };
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                iw.x[a] += in[a][b] * w.x[b];
                ia.x[a] += in[a][b] * al.x[b];
            }
        force[i] = vscale(ac, mass);
        moment[i] = vadd(vadd(ia, vcross(w, iw)), vcross(com, force[i]));
        offset[i] = r;
    }
    for (int i = m->joints - 1; i >= 0; i--) {
        if (i < m->joints - 1) {
            struct vec f = turn(&m->joint[i + 1], q[i + 1], force[i + 1], 0);
            struct vec n = turn(&m->joint[i + 1], q[i + 1], moment[i + 1], 0);
            force[i] = vadd(force[i], f);
            moment[i] = vadd(moment[i], vadd(n, vcross(offset[i + 1], f)));
        }
        tau[i] = moment[i].x[2];
    }
}

/* Height energy from positions alone. */
static double potential(const struct plant_model *m, const double *q)
{
    double u = 0;
    for (int i = 0; i < m->joints; i++) {
        struct vec com;
        double in[3][3], mass = link_com(m, i, &com, in);
        for (int k = i; k >= 0; k--) {
            const double *t = m->joint[k].trans_m;
            com = vadd(turn(&m->joint[k], q[k], com, 0), (struct vec){ { t[0], t[1], t[2] } });
        }
        for (int k = 0; k < 3; k++)
            u -= mass * m->gravity_mps2[k] * com.x[k];
    }
    return u;
}

/* ---- chain ---- */

START_TEST(test_forward_then_inverse_dynamics_returns_the_torque)
{
    struct plant_model m = pa10_plant();
    struct plant_chain chain;
    uint64_t rng = 11;
    m.payload_kg = 1.5;
    m.payload_com_m[0] = 0.03;
    m.payload_com_m[2] = 0.12;
    for (int i = 0; i < N; i++) /* products of inertia too */
        m.joint[i].inertia_kgm2[2] = 0.1 * m.joint[i].inertia_kgm2[0];
    m.joint[1].moment_kgm[0] = 0.2;
    m.gravity_mps2[0] = 1;
    accept(&m);
    plant_chain_prepare(&m, &chain);
    for (int trial = 0; trial < 200; trial++) {
        plant_matrix mass, factor;
        double q[N], qd[N], tau[N], bias[N], qdd[N], back[N];
        random_pose(&rng, q);
        for (int i = 0; i < N; i++) {
            qd[i] = test_uniform(&rng, -3, 3);
            tau[i] = test_uniform(&rng, -50, 50);
        }
        plant_chain_terms(&chain, q, qd, mass, bias);
        ck_assert_int_eq(plant_factor(N, mass, factor), 0);
        for (int i = 0; i < N; i++)
            bias[i] = tau[i] - bias[i];
        plant_solve(N, factor, bias, qdd);
        inverse_dynamics(&m, q, qd, qdd, back);
        for (int i = 0; i < N; i++)
            ck_assert_double_eq_tol(back[i], tau[i], 1e-10);
    }
}
END_TEST

/* A turn about a random axis; often one of those that arms are made of. */
static void random_turn(uint64_t *rng, double *rot)
{
    static const double usual[] = { 0, 1e-9, 1.5707963267949, -1.5707963267949, 3.14159265358979 };
    uint64_t kind = test_random(rng) % 10;
    double axis[3] = { kind < 5, 0, 0 }, angle = kind < 5 ? usual[kind] : test_uniform(rng, -3, 3);
    double norm = 0, c = cos(angle), s = sin(angle);
    for (int k = 0; k < 3 && kind >= 5; k++)
        axis[k] = test_uniform(rng, -1, 1);
    for (int k = 0; k < 3; k++)
        norm += axis[k] * axis[k];
    for (int k = 0; k < 3; k++)
        axis[k] /= sqrt(norm);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            rot[3 * a + b] = (a == b) * c + (1 - c) * axis[a] * axis[b];
    rot[1] -= s * axis[2];
    rot[2] += s * axis[1];
    rot[3] += s * axis[2];
    rot[5] -= s * axis[0];
    rot[6] -= s * axis[1];
    rot[7] += s * axis[0];
}

/* Five points of mass anywhere: physical, and nothing is zero. */
static void random_link(uint64_t *rng, struct plant_joint *j)
{
    random_turn(rng, j->rot);
    memset(j->moment_kgm, 0, sizeof j->moment_kgm);
    memset(j->inertia_kgm2, 0, sizeof j->inertia_kgm2);
    j->mass_kg = 0;
    for (int k = 0; k < 3; k++)
        j->trans_m[k] = test_uniform(rng, -0.5, 0.5);
    for (int point = 0; point < 5; point++) {
        double m = test_uniform(rng, 0.1, 2), r[3], *in = j->inertia_kgm2;
        for (int k = 0; k < 3; k++) {
            r[k] = test_uniform(rng, -0.3, 0.3);
            j->moment_kgm[k] += m * r[k];
        }
        j->mass_kg += m;
        in[0] += m * (r[1] * r[1] + r[2] * r[2]);
        in[1] -= m * r[0] * r[1];
        in[2] -= m * r[0] * r[2];
        in[3] += m * (r[0] * r[0] + r[2] * r[2]);
        in[4] -= m * r[1] * r[2];
        in[5] += m * (r[0] * r[0] + r[1] * r[1]);
    }
}

static struct plant_model random_arm(uint64_t *rng, int joints)
{
    struct plant_model m = { .joints = joints, .payload_kg = test_uniform(rng, 0, 3) };
    for (int k = 0; k < 3; k++) {
        m.gravity_mps2[k] = test_uniform(rng, -10, 10);
        m.payload_com_m[k] = test_uniform(rng, -0.3, 0.3);
    }
    for (int i = 0; i < joints; i++)
        random_link(rng, &m.joint[i]);
    return m;
}

/* Column by column, with nothing in common but the parameters. */
static void slow_terms(const struct plant_model *m, const double *q, const double *qd,
                       plant_matrix mass, double *bias)
{
    struct plant_model weightless = *m;
    double still[PLANT_JOINTS_MAX] = { 0 }, column[PLANT_JOINTS_MAX];
    memset(weightless.gravity_mps2, 0, sizeof weightless.gravity_mps2);
    inverse_dynamics(m, q, qd, still, bias);
    for (int j = 0; j < m->joints; j++) {
        double one[PLANT_JOINTS_MAX] = { 0 };
        one[j] = 1;
        inverse_dynamics(&weightless, q, still, one, column);
        for (int i = 0; i < m->joints; i++)
            mass[i * PLANT_JOINTS_MAX + j] = column[i];
    }
}

/* The fast terms rest on a choice of frames and a booking of inertia that must not show: any arm. */
START_TEST(test_terms_of_any_arm_are_those_of_a_textbook)
{
    uint64_t rng = 14;
    for (int trial = 0; trial < 640; trial++) {
        int n = 1 + trial % PLANT_JOINTS_MAX;
        struct plant_model m = random_arm(&rng, n);
        struct plant_chain chain;
        plant_matrix mass, expected;
        double q[PLANT_JOINTS_MAX], qd[PLANT_JOINTS_MAX], bias[PLANT_JOINTS_MAX];
        double torque[PLANT_JOINTS_MAX], most_kgm2 = 0, most_nm = 0;
        for (int i = 0; i < n; i++) {
            q[i] = test_uniform(&rng, -7, 7);
            qd[i] = test_uniform(&rng, -3, 3);
        }
        plant_chain_prepare(&m, &chain);
        plant_chain_terms(&chain, q, qd, mass, bias);
        slow_terms(&m, q, qd, expected, torque);
        for (int i = 0; i < n; i++) {
            most_kgm2 = fmax(most_kgm2, expected[i * PLANT_JOINTS_MAX + i]);
            most_nm = fmax(most_nm, fabs(torque[i]));
        }
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < n; k++)
                ck_assert_double_eq_tol(mass[i * PLANT_JOINTS_MAX + k],
                                        expected[i * PLANT_JOINTS_MAX + k], 1e-12 * most_kgm2);
            ck_assert_double_eq_tol(bias[i], torque[i], 1e-12 * (most_nm + 1));
        }
        double height = potential(&m, q); /* J, some hundred */
        ck_assert_double_eq_tol(plant_chain_height_j(&chain, q), height, 1e-10);
    }
}
END_TEST

/* The whole step, not only its parts: accelerations over a microsecond. */
START_TEST(test_step_accelerates_links_as_newton_and_euler_say)
{
    struct plant_model m = pa10_checked();
    uint64_t rng = 12;
    for (int i = 0; i < N; i++)
        m.joint[i].damping_nmspr = 0;
    for (int trial = 0; trial < 50; trial++) {
        struct plant_state s, before;
        double q[N], qdd[N], need[N];
        random_pose(&rng, q);
        plant_reset(&m, &s, q, 1);
        s.locked = 0x7f;
        for (int i = 0; i < N; i++) {
            s.th_m_rad[i] +=
                test_uniform(&rng, -0.02, 0.02); /* gear torque away from equilibrium */
            s.qd_radps[i] = test_uniform(&rng, -1, 1);
        }
        before = s;
        plant_step(&m, &s, zero_torque, 1e-7);
        for (int i = 0; i < N; i++)
            qdd[i] = (s.qd_radps[i] - before.qd_radps[i]) / 1e-7;
        inverse_dynamics(&m, before.q_rad, before.qd_radps, qdd, need);
        for (int i = 0; i < N; i++) /* over 0.1 us the spring force changes by K v dt ~ 0.01 N.m */
            ck_assert_double_eq_tol(need[i], s.gear_nm[i], 0.02);
    }
}
END_TEST

START_TEST(test_holding_torque_is_gradient_of_potential_energy)
{
    struct plant_model m = pa10_plant();
    uint64_t rng = 13;
    m.payload_kg = 2;
    m.payload_com_m[1] = 0.05;
    m.payload_com_m[2] = 0.1;
    accept(&m);
    for (int trial = 0; trial < 100; trial++) {
        struct plant_state s;
        double q[N];
        random_pose(&rng, q);
        plant_reset(&m, &s, q, 1);
        for (int i = 0; i < N; i++) {
            double up[N], down[N];
            memcpy(up, q, sizeof q);
            memcpy(down, q, sizeof q);
            up[i] += 1e-5;
            down[i] -= 1e-5;
            ck_assert_double_eq_tol(s.gear_nm[i], (potential(&m, up) - potential(&m, down)) / 2e-5,
                                    1e-5);
        }
    }
}
END_TEST

START_TEST(test_horizontal_arm_weighs_what_the_manufacturer_says)
{
    struct plant_model m = pa10_checked();
    struct plant_state s;
    double q[N] = { 0, 1.5707963267949, 0, 0, 0, 0, 0 };
    plant_reset(&m, &s, q, 1);
    ck_assert_double_eq_tol(fabs(s.gear_nm[1]), 80.4,
                            0.5); /* N.m, from the manufacturer's masses */
    ck_assert_double_eq_tol(fabs(s.gear_nm[3]), 21.2, 0.2);
    ck_assert_double_eq_tol(fabs(s.gear_nm[5]), 0.31, 0.05);
}
END_TEST

START_TEST(test_inverse_refuses_what_is_not_positive_definite)
{
    plant_matrix a = { 0 }, b;
    a[0] = a[PLANT_JOINTS_MAX + 1] = 1;
    a[1] = a[PLANT_JOINTS_MAX] = 1;
    ck_assert_int_eq(plant_invert(2, a, b), -1);
    ck_assert_int_eq(plant_factor(2, a, b), -1);
    a[1] = a[PLANT_JOINTS_MAX] = 0.5;
    ck_assert_int_eq(plant_invert(2, a, b), 0);
    ck_assert_double_eq_tol(b[0], 4.0 / 3, 1e-12);
    ck_assert_double_eq_tol(b[1], -2.0 / 3, 1e-12);
    const double wrong[] = { 0, -1, NAN };
    for (int k = 0; k < 3; k++) {
        a[0] = wrong[k];
        ck_assert_int_eq(plant_factor(2, a, b), -1);
        ck_assert_int_eq(plant_invert(2, a, b), -1);
    }
}
END_TEST

/* Of every size; the part of the arrays that is not used is poisoned. */
START_TEST(test_solution_and_inverse_undo_the_product)
{
    uint64_t rng = 15;
    for (int n = 1; n <= PLANT_JOINTS_MAX; n++) {
        plant_matrix root, a, factor, inverse;
        double b[PLANT_JOINTS_MAX] = { 0 }, x[PLANT_JOINTS_MAX], y[PLANT_JOINTS_MAX];
        for (int k = 0; k < PLANT_JOINTS_MAX * PLANT_JOINTS_MAX; k++) {
            root[k] = test_uniform(&rng, -1, 1);
            a[k] = NAN;
        }
        for (int i = 0; i < n; i++)
            x[i] = test_uniform(&rng, -5, 5);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                double sum = i == j;
                for (int k = 0; k < n; k++)
                    sum += root[i * PLANT_JOINTS_MAX + k] * root[j * PLANT_JOINTS_MAX + k];
                a[i * PLANT_JOINTS_MAX + j] = sum;
                b[i] += sum * x[j];
            }
        ck_assert_int_eq(plant_factor(n, a, factor), 0);
        ck_assert_int_eq(plant_invert(n, a, inverse), 0);
        plant_solve(n, factor, b, y);
        for (int i = 0; i < n; i++) {
            double sum = 0;
            for (int k = 0; k < n; k++)
                sum += inverse[i * PLANT_JOINTS_MAX + k] * b[k];
            ck_assert_double_eq_tol(y[i], x[i], 1e-11);
            ck_assert_double_eq_tol(sum, x[i], 1e-11);
        }
        plant_solve(n, factor, b, b); /* in place */
        ck_assert(memcmp(b, y, (size_t)n * sizeof *b) == 0);
    }
}
END_TEST

/* ---- gear ---- */

START_TEST(test_wind_up_at_rest_is_the_catalogue_torsion)
{
    struct plant_model m = pa10_checked();
    struct plant_state s;
    /* size 32, catalogue: 29 N.m is 5.4e-4 rad, then 7.8e4 N.m/rad, above 108 N.m 9.8e4 N.m/rad */
    const struct { double torque_nm, torsion_rad; } at[] = {
        { 14.5, 14.5 / 5.4e4 }, { 29, 29 / 5.4e4 }, { 80, 29 / 5.4e4 + 51 / 7.8e4 },
        { 108, 29 / 5.4e4 + 79 / 7.8e4 }, { 150, 29 / 5.4e4 + 79 / 7.8e4 + 42 / 9.8e4 } };
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++)
        for (int sign = -1; sign <= 1; sign += 2) {
            ck_assert_double_eq_tol(plant_gear_windup_rad(&m.joint[1], sign * at[k].torque_nm),
                                    sign * at[k].torsion_rad, 1e-12);
            ck_assert_double_eq_tol(plant_gear_nm(&m.joint[1], sign * at[k].torsion_rad),
                                    sign * at[k].torque_nm, 1e-9);
        }
    double q[N] = { 0, -1.5707963267949, 0, 0, 0, 0, 0 };
    plant_reset(&m, &s, q, 1);
    double load = fabs(s.gear_nm[1]), torsion = s.th_m_rad[1] / PA10_RATIO - s.q_rad[1];
    ck_assert_double_eq_tol(torsion, 29 / 5.4e4 + (load - 29) / 7.8e4, 1e-12);
    /* and it is an equilibrium: braked, nothing moves */
    s.locked = 0x7f;
    run(&m, &s, 0, 1);
    for (int i = 0; i < N; i++)
        ck_assert_double_eq_tol(s.q_rad[i], q[i], 1e-9);
}
END_TEST

START_TEST(test_gear_energy_is_the_work_of_its_torque)
{
    struct plant_model m = pa10_checked();
    for (int i = 0; i < N; i++) {
        double work = 0, d = 4e-3;
        for (int k = 0; k < 4000; k++)
            work += plant_gear_nm(&m.joint[i], (k + 0.5) * d / 4000) * d / 4000;
        ck_assert_double_eq_tol(plant_gear_energy_j(&m.joint[i], d), work, 1e-6 * work);
        ck_assert_double_eq_tol(plant_gear_energy_j(&m.joint[i], -d), work, 1e-6 * work);
    }
}
END_TEST

START_TEST(test_resonance_is_that_of_two_masses_and_a_spring)
{
    struct plant_model m = free_rod();
    struct plant_state s;
    double q = 0, before = 0;
    int crossings = 0;
    double first = 0, last = 0;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    s.th_m_rad[0] += 50 * 3e-4; /* within the first line of the spring, 5.6e-4 rad */
    for (int k = 0; k < 20000; k++) {
        plant_step(&m, &s, zero_torque, 5e-5);
        double twist = s.th_m_rad[0] / 50 - s.q_rad[0];
        if (before < 0 && twist >= 0) {
            last = s.t_s - 5e-5 * twist / (twist - before);
            first = crossings++ == 0 ? last : first;
        }
        before = twist;
    }
    double rotor = 1.2e-4 * 2500,
           expected = sqrt(2.5e4 * (1 / rotor + 1 / 0.7)) / 6.283185307179586;
    ck_assert_int_gt(crossings, 20);
    ck_assert_double_eq_tol((crossings - 1) / (last - first), expected, 0.01 * expected);
}
END_TEST

START_TEST(test_end_stop_holds_against_full_torque)
{
    struct plant_model m = pa10_checked();
    struct plant_state s;
    double q[N] = { 0 };
    plant_reset(&m, &s, q, 1);
    run(&m, &s, 100, 6); /* cut to the rated torque of every joint */
    for (int i = 0; i < N; i++) {
        ck_assert_double_gt(s.q_rad[i], m.joint[i].q_max_rad);
        ck_assert_double_lt(s.q_rad[i], m.joint[i].q_max_rad + 0.02);
        ck_assert_double_eq_tol(s.qd_radps[i], 0, 1e-3);
    }
    ck_assert_double_le(plant_stop_nm(&m.joint[0], m.joint[0].q_max_rad + 1e-3, -100),
                        0); /* never pulls */
    ck_assert_double_lt(plant_stop_nm(&m.joint[0], m.joint[0].q_max_rad + 1e-3, 0), -1);
    ck_assert_double_ge(plant_stop_nm(&m.joint[0], m.joint[0].q_min_rad - 1e-3, 100), 0);
    ck_assert_double_gt(plant_stop_nm(&m.joint[0], m.joint[0].q_min_rad - 1e-3, 0), 1);
    ck_assert_double_eq(plant_stop_nm(&m.joint[0], 0, 5), 0);
}
END_TEST

/* ---- energy ---- */

static double energy_drift(struct plant_model *m, const double *q, double step_s, double span_s)
{
    struct plant_state s;
    m->step_s = step_s;
    plant_reset(m, &s, q, 1);
    double first = plant_energy_j(m, &s);
    run(m, &s, 0, span_s);
    return fabs(plant_energy_j(m, &s) - first);
}

START_TEST(test_energy_drift_of_the_falling_arm_is_first_order_in_the_step)
{
    struct plant_model m = pa10_plant();
    double q[N] = { 0, 0.5, 0.3, 1, 0.2, 0.5, 0.1 };
    pa10_frictionless(&m);
    for (int i = 0; i < N; i++) {
        m.joint[i].q_min_rad = -100;
        m.joint[i].q_max_rad = 100;
    }
    accept(&m);
    double h = m.step_s, coarse = energy_drift(&m, q, h, 0.5),
           middle = energy_drift(&m, q, h / 2, 0.5), fine = energy_drift(&m, q, h / 4, 0.5);
    ck_assert_double_lt(coarse, 0.3); /* of some 100 J turned from height into speed */
    ck_assert_double_gt(coarse / middle, 1.7);
    ck_assert_double_lt(coarse / middle, 2.3);
    ck_assert_double_gt(middle / fine, 1.7);
    ck_assert_double_lt(middle / fine, 2.3);
}
END_TEST

/* The spring alone: no term is frozen, the integrator is of second order. */
START_TEST(test_energy_ripple_of_the_gear_is_second_order_in_the_step)
{
    double worst[3];
    for (int k = 0; k < 3; k++) {
        struct plant_model m = free_rod();
        struct plant_state s;
        double q = 0;
        accept(&m);
        m.step_s /= 1 << k;
        plant_reset(&m, &s, &q, 1);
        s.th_m_rad[0] += 50 * 3e-4;
        double first = plant_energy_j(&m, &s);
        worst[k] = 0;
        for (int i = 0; i < 300; i++) {
            run(&m, &s, 0, 1e-3);
            worst[k] = fmax(worst[k], fabs(plant_energy_j(&m, &s) / first - 1));
        }
    }
    ck_assert_double_lt(worst[0], 0.1);
    ck_assert_double_eq_tol(worst[0] / worst[1], 4, 0.7);
    ck_assert_double_eq_tol(worst[1] / worst[2], 4, 0.7);
}
END_TEST

START_TEST(test_friction_never_adds_energy)
{
    struct plant_model m = pa10_checked();
    uint64_t rng = 21;
    for (int i = 0; i < N; i++)
        m.joint[i].fx_load_mu = 0.1;
    for (int trial = 0; trial < 10; trial++) {
        struct plant_state s;
        double q[N], before;
        random_pose(&rng, q);
        plant_reset(&m, &s, q, 1);
        for (int i = 0; i < N; i++) {
            s.qd_radps[i] = test_uniform(&rng, -1, 1);
            s.thd_m_radps[i] = 50 * s.qd_radps[i];
        }
        before = plant_energy_j(&m, &s);
        for (int k = 0; k < 1000; k++) {
            run(&m, &s, 0, 1e-3);
            double now = plant_energy_j(&m, &s);
            ck_assert_double_lt(now, before + 1e-4); /* J: ripple of the integrator on some 10 J */
            before = now;
            for (int i = 0; i < N; i++)
                ck_assert_double_ge(s.friction_nm[i] * s.thd_m_radps[i], 0);
        }
    }
}
END_TEST

/* ---- friction ---- */

/* Motor torque at which the net torque on the rotor of a rod at rest is `share` of its breakaway. */
static double drive_m(const struct plant_model *m, const struct plant_state *s, double share)
{
    double f0 = m->joint[0].friction[share < 0].f0_nm;
    return (s->gear_nm[0] + share * f0) / m->joint[0].ratio;
}

START_TEST(test_held_below_breakaway_the_rotor_does_not_creep_at_all)
{
    const double share[] = { 0.5, -0.5, 0.99, -0.99, 0 };
    struct plant_model m = rod();
    accept(&m);
    for (size_t k = 0; k < sizeof share / sizeof share[0]; k++) {
        struct plant_state s;
        double q = 0.4, tau, start;
        plant_reset(&m, &s, &q, 1);
        start = s.th_m_rad[0];
        tau = drive_m(&m, &s, share[k]);
        run(&m, &s, tau, 10);
        ck_assert(memcmp(&start, &s.th_m_rad[0], sizeof start) == 0);
        ck_assert_double_eq(s.thd_m_radps[0], 0);
        ck_assert_double_eq_tol(s.friction_nm[0], tau * 50 - s.gear_nm[0], 1e-9);
    }
    for (int sign = -1; sign <= 1; sign += 2) {
        struct plant_state s;
        double q = 0.4;
        plant_reset(&m, &s, &q, 1);
        double start = s.th_m_rad[0];
        run(&m, &s, drive_m(&m, &s, sign * 1.02), 1);
        ck_assert_double_gt(sign * (s.th_m_rad[0] - start),
                            1e-3); /* the other side of the same edge */
    }
}
END_TEST

START_TEST(test_whole_arm_stands_where_friction_exceeds_gravity)
{
    struct plant_model m = pa10_checked();
    struct plant_state s;
    double q[N] = { 0, 0.2, 0, 0.2, 0, 0.3, 0 }, start[N];
    plant_reset(&m, &s, q, 1);
    memcpy(start, s.th_m_rad, sizeof start);
    run(&m, &s, 0, 10);
    ck_assert(memcmp(start, s.th_m_rad, sizeof start) == 0);
}
END_TEST

/* Friction curve as printed in the paper, eq. (7), at the steady speed a torque leads to. */
START_TEST(test_steady_sliding_obeys_the_two_sided_stribeck_curve)
{
    struct plant_model m = rod();
    m.gravity_mps2[2] = 0;
    accept(&m);
    for (int sign = -1; sign <= 1; sign += 2)
        for (double torque = 20; torque < 45; torque += 3) {
            struct plant_state s;
            const struct plant_friction *f = &m.joint[0].friction[sign < 0];
            double q = 0;
            plant_reset(&m, &s, &q, 1);
            run(&m, &s, sign * torque / 50, 4);
            double v = sign * speed(&m, &s, 0);
            ck_assert_double_gt(v, 0);
            ck_assert_double_eq_tol(
                f->f0_nm + f->fv_nmspr * v + f->fs_nm * (1 - exp(-v / f->vc_radps)), torque, 1e-3);
            ck_assert_double_eq_tol(s.friction_nm[0], sign * torque, 1e-3);
        }
}
END_TEST

/* Friction curves need exp(-x) often; theirs against the library's, densely and where its pieces join. */
START_TEST(test_decay_is_the_exponential_within_1e_13)
{
    double worst = 0;
    for (double x = 0; x < 50; x += 1.7e-5)
        worst = fmax(worst, fabs(plant_decay(x) / exp(-x) - 1));
    for (double x = 50; x < 700; x += 1.3e-3)
        worst = fmax(worst, fabs(plant_decay(x) / exp(-x) - 1));
    for (int k = 0; k < 16000; k++) {
        double join = (k + 0.5) * 0.6931471805599453 / 16;
        const double beside[] = { nextafter(join, 0), join, nextafter(join, 700) };
        for (int i = 0; i < 3; i++)
            worst = fmax(worst, fabs(plant_decay(beside[i]) / exp(-beside[i]) - 1));
    }
    ck_assert_double_lt(worst, 1e-13);
    ck_assert_double_eq(plant_decay(0), 1);
    ck_assert_double_eq(plant_decay(1e-300), 1);
    ck_assert_double_gt(plant_decay(699.999), 0);
    ck_assert_double_eq(plant_decay(700), 0);
    ck_assert_double_eq(plant_decay(HUGE_VAL), 0);
    ck_assert_double_eq(1 - exp(-38), 1); /* beyond, the curve is taken to be flat */
}
END_TEST

START_TEST(test_sliding_rotor_stops_and_stays)
{
    struct plant_model m = rod();
    struct plant_state s;
    double q = 0, held;
    m.gravity_mps2[2] = 0;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    s.thd_m_radps[0] = 50;
    s.qd_radps[0] = 1;
    run(&m, &s, 0, 2);
    held = s.th_m_rad[0];
    ck_assert_double_gt(held, 0.5);
    ck_assert_double_eq(s.thd_m_radps[0], 0);
    run(&m, &s, 0, 3);
    ck_assert(memcmp(&held, &s.th_m_rad[0], sizeof held) == 0);
}
END_TEST

START_TEST(test_locked_rotor_is_held_and_the_gear_still_springs)
{
    struct plant_model m = rod();
    struct plant_state s;
    double q = 0, before, lowest = 0;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    s.locked = 1;
    s.qd_radps[0] = 0.05;
    before = s.th_m_rad[0];
    for (int k = 0; k < 200; k++) {
        run(&m, &s, 2, 1e-3);
        lowest = fmin(lowest, s.q_rad[0]);
    }
    ck_assert(memcmp(&before, &s.th_m_rad[0], sizeof before) == 0);
    ck_assert_double_lt(lowest, -1e-5);
}
END_TEST

START_TEST(test_mirrored_command_gives_mirrored_motion)
{
    struct plant_model m = pa10_plant();
    struct plant_state a, b;
    double q[N] = { 0.3, 0.5, -0.4, 1, 0.2, -0.5, 0.1 }, mirror[N], tau[N], minus[N];
    for (int i = 0; i < N; i++) {
        m.joint[i].friction[1] = m.joint[i].friction[0];
        for (int k = 0; k < m.joint[i].lines; k++)
            m.joint[i].line[k].phase_rad = 1.5707963267948966; /* even in the angle */
        mirror[i] = -q[i];
    }
    accept(&m);
    plant_reset(&m, &a, q, 1);
    plant_reset(&m, &b, mirror, 1);
    for (int k = 0; k < 1000; k++) {
        for (int i = 0; i < N; i++) {
            tau[i] = m.joint[i].tau_max_m_nm * sin(0.005 * k + i);
            minus[i] = -tau[i];
        }
        plant_step(&m, &a, tau, 1e-3);
        plant_step(&m, &b, minus, 1e-3);
    }
    for (int i = 0; i < N; i++) {
        ck_assert_double_gt(fabs(a.q_rad[i] - q[i]), 1e-3);
        ck_assert_double_eq_tol(a.q_rad[i], -b.q_rad[i], 1e-9);
        ck_assert_double_eq_tol(a.thd_m_radps[i], -b.thd_m_radps[i], 1e-6);
    }
}
END_TEST

/* Newton on the rotor over a microsecond: what is reported as friction is what acted. */
START_TEST(test_reported_friction_closes_the_balance_of_the_rotor)
{
    struct plant_model m = rod();
    uint64_t rng = 41;
    m.joint[0].fx_torque_gain = 0.1;
    m.joint[0].fx_load_mu = 0.05;
    m.joint[0].fx_presliding_nm = 8;
    m.joint[0].fx_presliding_rad = 0.02;
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 300, 2, 0.3, 1, 0, 0, 0 };
    m.joint[0].line[m.joint[0].lines++] = (struct plant_line){ 100, 1.5, 0.7, 0, 0, 0, 0 };
    accept(&m);
    for (int trial = 0; trial < 100; trial++) {
        struct plant_state s;
        double q = test_uniform(&rng, -1, 1), tau = test_uniform(&rng, -1.5, 1.5), dt = 1e-6;
        plant_reset(&m, &s, &q, 1);
        s.thd_m_radps[0] = test_uniform(&rng, -50, 50);
        s.qd_radps[0] = s.thd_m_radps[0] / 50;
        s.dahl_nm[0] = test_uniform(&rng, -4, 4);
        s.wander_nm[0] = test_uniform(&rng, -1, 1);
        double before = speed(&m, &s, 0), line = 1.5 * sin(100 * s.th_m_rad[0] / 50 + 0.7);
        plant_step(&m, &s, &tau, dt);
        double taken = 0.3 * (speed(&m, &s, 0) - before) / dt;
        ck_assert_double_eq_tol(1.1 * 50 * tau - s.gear_nm[0] - line - s.friction_nm[0], taken,
                                0.02);
    }
}
END_TEST

/* ---- hidden effects ---- */

static double hold_nm(const struct plant_model *m, double q_rad)
{
    struct plant_state s;
    plant_reset(m, &s, &q_rad, 1);
    return s.gear_nm[0];
}

START_TEST(test_payload_adds_its_weight_times_its_arm)
{
    struct plant_model bare = rod(), loaded = rod();
    loaded.payload_kg = 0.4;
    loaded.payload_com_m[0] = 0.9;
    accept(&bare);
    accept(&loaded);
    for (double q = -1.5; q < 1.6; q += 0.5) /* about y, x points down when q is positive */
        ck_assert_double_eq_tol(hold_nm(&loaded, q) - hold_nm(&bare, q), -0.4 * 9.81 * 0.9 * cos(q),
                                1e-9);
}
END_TEST

START_TEST(test_cable_spring_must_be_held_against)
{
    struct plant_model bare = rod(), sprung = rod();
    sprung.joint[0].fx_spring_nmprad = 3;
    sprung.joint[0].fx_spring_q0_rad = 0.2;
    accept(&bare);
    accept(&sprung);
    ck_assert_double_eq_tol(hold_nm(&sprung, 1) - hold_nm(&bare, 1), 3 * 0.8, 1e-9);
    ck_assert_double_eq_tol(hold_nm(&sprung, -1) - hold_nm(&bare, -1), 3 * -1.2, 1e-9);
    /* and pulls while it runs: braked in that pose nothing moves */
    struct plant_state s;
    double q = 1;
    plant_reset(&sprung, &s, &q, 1);
    s.locked = 1;
    run(&sprung, &s, 0, 0.2);
    ck_assert_double_eq_tol(s.q_rad[0], 1, 1e-9);
}
END_TEST

/* Angular momentum after 50 ms of 0.4 N.m motor torque on a free rod, and the speed of its rotor. */
static double kicked(struct plant_model m, double *rotor_radps)
{
    struct plant_state s;
    double q = 0;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    run(&m, &s, 0.4, 0.05);
    *rotor_radps = speed(&m, &s, 0);
    return s.qd_radps[0] * 0.7 + *rotor_radps * (1.2e-4 * 2500 + m.joint[0].fx_inertia_kgm2);
}

START_TEST(test_torque_gain_and_inertia_change_momentum_and_speed)
{
    struct plant_model m = free_rod(), gain = m, heavy = m;
    double light_radps, gain_radps, heavy_radps;
    gain.joint[0].fx_torque_gain = 0.07;
    heavy.joint[0].fx_inertia_kgm2 = 2;
    ck_assert_double_eq_tol(kicked(m, &light_radps), 0.4 * 50 * 0.05, 1e-6);
    ck_assert_double_eq_tol(kicked(gain, &gain_radps), 1.07 * 0.4 * 50 * 0.05, 1e-6);
    ck_assert_double_eq_tol(kicked(heavy, &heavy_radps), 0.4 * 50 * 0.05, 1e-6);
    ck_assert_double_eq_tol(gain_radps, 1.07 * light_radps,
                            0.02 * light_radps); /* the spring is not quite linear */
    ck_assert_double_lt(heavy_radps, 0.5 * light_radps);
}
END_TEST

/* Friction of a rod driven steadily at about the same speed. */
static double sliding_nm(const struct plant_model *m, struct plant_state *s, double tau_m_nm,
                         double span_s)
{
    run(m, s, tau_m_nm, span_s);
    ck_assert_double_gt(speed(m, s, 0) * tau_m_nm, 0);
    return fabs(s->friction_nm[0]);
}

START_TEST(test_load_friction_grows_with_gear_torque)
{
    struct plant_model m = rod();
    m.joint[0].fx_load_mu = 0.1;
    accept(&m);
    for (int sign = -1; sign <= 1; sign += 2) {
        /* breakaway: 18 or 19 N.m and a tenth of the weight of 9.81 N.m cos(0) */
        double edge = m.joint[0].friction[sign < 0].f0_nm + 0.1 * 9.81;
        for (int over = 0; over < 2; over++) {
            struct plant_state s;
            double q = 0, start;
            plant_reset(&m, &s, &q, 1);
            ck_assert_double_eq_tol(fabs(s.gear_nm[0]), 9.81, 1e-9);
            start = s.th_m_rad[0];
            run(&m, &s, (s.gear_nm[0] + sign * edge * (over ? 1.005 : 0.995)) / 50, 0.5);
            ck_assert_int_eq(s.th_m_rad[0] != start, over);
        }
    }
}
END_TEST

START_TEST(test_cold_friction_decays_with_the_thermal_time)
{
    struct plant_model m = rod(), warm = rod();
    struct plant_state s;
    double q = 0;
    m.gravity_mps2[2] = warm.gravity_mps2[2] = 0;
    m.joint[0].fx_cold_coulomb = 0.25;
    m.joint[0].fx_warm_s = 0.8;
    accept(&m);
    accept(&warm);
    plant_reset(&m, &s, &q, 1);
    /* a motor torque of 22 N.m: above 18, below 18 * 1.25 until exp(-t / 0.8) < (22 / 18 - 1) / 0.25 */
    double start = s.th_m_rad[0], until = -0.8 * log((22.0 / 18 - 1) / 0.25);
    run(&m, &s, 22.0 / 50, until - 0.01);
    ck_assert_double_eq(s.th_m_rad[0], start);
    run(&m, &s, 22.0 / 50, 0.1);
    ck_assert_double_gt(s.th_m_rad[0], start);
    ck_assert_double_eq_tol(s.warm[0], 1 - exp(-s.t_s / 0.8), 1e-9);

    m.joint[0].fx_cold_coulomb = 0;
    m.joint[0].fx_cold_viscous = 1;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    sliding_nm(&m, &s, 0.9, 0.6);
    double v = speed(&m, &s, 0), cold = exp(-s.t_s / 0.8);
    const struct plant_friction *f = &m.joint[0].friction[0];
    double expected =
        f->f0_nm + f->fv_nmspr * (1 + cold) * v + f->fs_nm * (1 - exp(-v / f->vc_radps));
    ck_assert_double_eq_tol(s.friction_nm[0], expected, 0.05);
}
END_TEST

START_TEST(test_presliding_friction_builds_up_over_travel_after_a_reversal)
{
    struct plant_model m = rod();
    struct plant_state s;
    double q = 0, turned = 0;
    m.gravity_mps2[2] = 0;
    m.joint[0].friction[0].fs_nm = m.joint[0].friction[1].fs_nm = 0;
    m.joint[0].fx_presliding_nm = 8;
    m.joint[0].fx_presliding_rad = 0.02;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    double full = sliding_nm(&m, &s, -0.9, 1);
    ck_assert_double_eq_tol(full, 19 + 18 * fabs(speed(&m, &s, 0)),
                            1e-3); /* long after: nothing missing */
    int seen = 0;
    for (int k = 0; k < 2000; k++) {
        double before = speed(&m, &s, 0);
        plant_step(&m, &s, &(double){ 0.9 }, 1e-4);
        double now = speed(&m, &s, 0), angle = s.th_m_rad[0] / 50;
        if (before <= 0 && now > 0)
            turned = angle;
        if (before > 0 && now > 0) {
            double missing = 18 + 17 * now - s.friction_nm[0], travel = angle - turned;
            ck_assert_double_eq_tol(missing, 8 * exp(-travel / 0.02), 0.08);
            seen += missing > 4;
        }
    }
    ck_assert_int_gt(seen, 10);
}
END_TEST

START_TEST(test_conservative_line_is_a_torque_and_directed_line_a_friction)
{
    struct plant_model m = free_rod();
    m.joint[0].friction[0].f0_nm = m.joint[0].friction[1].f0_nm = 10;
    m.joint[0].line[0] = (struct plant_line){ 300, 3, 0.5, 0, 0, 0, 0 };
    m.joint[0].lines = 1;
    accept(&m);
    /* the band of motor torques a rotor at rest stands is shifted, or widened, by the line */
    for (int directed = 0; directed < 2; directed++)
        for (double q = 0; q < 0.02; q += 0.003)
            for (int sign = -1; sign <= 1; sign += 2)
                for (int over = 0; over < 2; over++) {
                    struct plant_state s;
                    m.joint[0].line[0].directed = directed;
                    plant_reset(&m, &s, &q, 1);
                    double line = 3 * sin(300 * q + 0.5), start = s.th_m_rad[0];
                    double edge = sign * 10 + (directed ? sign * line : line);
                    run(&m, &s, (edge + sign * (over ? 0.01 : -0.01)) / 50, 0.02);
                    ck_assert_int_eq(s.th_m_rad[0] != start, over);
                }
}
END_TEST

START_TEST(test_directed_line_never_turns_friction_into_drive)
{
    struct plant_model m = free_rod();
    struct plant_state s;
    double q = 0;
    m.joint[0].friction[0].f0_nm = m.joint[0].friction[1].f0_nm = 1;
    m.joint[0].line[0] = (struct plant_line){ 300, 5, 0, 1, 0, 0, 0 };
    m.joint[0].lines = 1;
    accept(&m);
    plant_reset(&m, &s, &q, 1);
    s.qd_radps[0] = 1;
    s.thd_m_radps[0] = 50;
    for (int k = 0; k < 1000; k++) {
        plant_step(&m, &s, zero_torque, 1e-4);
        ck_assert_double_ge(s.friction_nm[0] * s.thd_m_radps[0], 0);
    }
}
END_TEST

static void step_some(const struct plant_model *m, struct plant_state *s)
{
    double q[N] = { 0.1, 0.5, 0, 1, 0, 0.5, 0 }, tau[N];
    plant_reset(m, s, q, 77);
    for (int k = 0; k < 300; k++) {
        for (int i = 0; i < N; i++)
            tau[i] = m->joint[i].tau_max_m_nm * sin(0.02 * k + i);
        plant_step(m, s, tau, 1e-3);
    }
}

static void imperfect(struct plant_model *m)
{
    for (int i = 0; i < N; i++) {
        struct plant_joint *j = &m->joint[i];
        j->run_coulomb_sigma_nm = 0.01 * j->friction[0].f0_nm;
        j->wander_sigma_nm = 0.0075 * j->friction[0].f0_nm;
        j->wander_s = 10;
        j->torque_noise_m_nm = 0.001;
    }
}

START_TEST(test_effect_of_size_zero_is_bit_identical_to_absent)
{
    struct plant_model absent = pa10_plant(), zero = pa10_plant();
    struct plant_state a, b;
    imperfect(&absent);
    imperfect(&zero);
    for (int i = 0; i < N; i++) { /* everything about the effects but their size */
        zero.joint[i].fx_presliding_rad = 0.02;
        zero.joint[i].fx_spring_q0_rad = 0.3;
        zero.joint[i].fx_warm_s =
            0; /* a thermal time alone warms a state nobody reads: checked apart */
        zero.joint[i].line[zero.joint[i].lines++] = (struct plant_line){ 37, 0, 0.7, i % 2, 0, 0, 0 };
    }
    zero.payload_com_m[2] = 0.13;
    accept(&absent);
    accept(&zero);
    step_some(&absent, &a);
    step_some(&zero, &b);
    ck_assert(memcmp(&a, &b, sizeof a) == 0);
    for (int i = 0; i < N; i++)
        zero.joint[i].fx_warm_s = 5;
    step_some(&zero, &b);
    ck_assert(memcmp(a.th_m_rad, b.th_m_rad, sizeof a.th_m_rad) == 0);
    ck_assert(memcmp(a.q_rad, b.q_rad, sizeof a.q_rad) == 0);
}
END_TEST

/* ---- healthy imperfections, reproducibility ---- */

START_TEST(test_run_scatter_has_its_sigma_and_changes_breakaway)
{
    struct plant_model m = rod();
    double sum = 0, square = 0;
    m.gravity_mps2[2] = 0;
    m.joint[0].run_coulomb_sigma_nm = 0.4;
    accept(&m);
    for (uint64_t seed = 0; seed < 2000; seed++) {
        struct plant_state s;
        double q = 0;
        plant_reset(&m, &s, &q, seed);
        sum += s.run_coulomb_nm[0];
        square += s.run_coulomb_nm[0] * s.run_coulomb_nm[0];
        if (seed < 10) {
            double start = s.th_m_rad[0];
            s.wander_nm[0] = 0.2 - 0.05 * (double)seed; /* adds to it */
            double edge = 18 + s.run_coulomb_nm[0] + s.wander_nm[0];
            run(&m, &s, (edge - 0.01) / 50, 0.1);
            ck_assert_double_eq(s.th_m_rad[0], start);
            run(&m, &s, (edge + 0.01) / 50, 0.1);
            ck_assert_double_gt(s.th_m_rad[0], start);
        }
    }
    ck_assert_double_eq_tol(sum / 2000, 0, 4 * 0.4 / sqrt(2000)); /* four standard errors */
    ck_assert_double_eq_tol(sqrt(square / 2000), 0.4, 4 * 0.4 / sqrt(4000));
}
END_TEST

START_TEST(test_wander_keeps_its_sigma_and_forgets_in_its_time)
{
    struct plant_model m = free_rod();
    struct plant_state s;
    double q = 0, square = 0, product = 0, before = 0;
    int n = 20000;
    m.joint[0].wander_sigma_nm = 0.3;
    m.joint[0].wander_s = 0.05;
    m.joint[0].friction[0].f0_nm = m.joint[0].friction[1].f0_nm = 5;
    accept(&m);
    plant_reset(&m, &s, &q, 3);
    for (int k = 0; k < n; k++) {
        plant_step(&m, &s, zero_torque, 0.01);
        square += s.wander_nm[0] * s.wander_nm[0];
        product += s.wander_nm[0] * before;
        before = s.wander_nm[0];
    }
    /* about n / 10 independent samples: 4 standard errors are 9 % of the variance */
    ck_assert_double_eq_tol(square / n, 0.09, 0.009);
    ck_assert_double_eq_tol(product / square, exp(-0.01 / 0.05), 0.03);
}
END_TEST

START_TEST(test_gauss_is_normal_enough)
{
    uint64_t rng = 5;
    double sum[4] = { 0 };
    int n = 200000, beyond = 0;
    for (int k = 0; k < n; k++) {
        double g = plant_gauss(&rng);
        for (int p = 0; p < 4; p++)
            sum[p] += pow(g, p + 1) / n;
        beyond += fabs(g) > 2;
    }
    ck_assert_double_eq_tol(sum[0], 0, 0.01); /* 4 standard errors: 0.009 */
    ck_assert_double_eq_tol(sum[1], 1, 0.013);
    ck_assert_double_eq_tol(sum[2], 0, 0.035);
    ck_assert_double_eq_tol(sum[3], 3, 0.09);
    ck_assert_double_eq_tol((double)beyond / n, 0.0455, 0.002);
}
END_TEST

START_TEST(test_same_seed_same_bytes_and_a_copy_replays)
{
    struct plant_model m = pa10_plant();
    struct plant_state a, b, copy;
    double q[N] = { 0 };
    imperfect(&m);
    accept(&m);
    step_some(&m, &a);
    step_some(&m, &b);
    ck_assert(memcmp(&a, &b, sizeof a) == 0);
    copy = a;
    run(&m, &a, 0.1, 0.2);
    run(&m, &copy, 0.1, 0.2);
    ck_assert(memcmp(&a, &copy, sizeof a) == 0);
    ck_assert(memcmp(&a, &b, sizeof a) != 0);
    plant_reset(&m, &a, q, 1);
    plant_reset(&m, &b, q, 2);
    ck_assert(memcmp(a.run_coulomb_nm, b.run_coulomb_nm, sizeof a.run_coulomb_nm) != 0);
}
END_TEST

/* How time is cut into calls matters only as much as the integrator's error. */
START_TEST(test_motion_does_not_depend_on_how_time_is_cut)
{
    struct plant_model m = pa10_checked();
    struct plant_state a, b;
    double q[N] = { 0.1, 0.5, 0, 1, 0, 0.5, 0 }, tau[N] = { 2, 1, 1, 1.5, 0.15, 0.2, 0.1 };
    plant_reset(&m, &a, q, 1);
    plant_reset(&m, &b, q, 1);
    for (int k = 0; k < 30; k++)
        plant_step(&m, &a, tau, 0.01);
    for (int k = 0; k < 7000; k++)
        plant_step(&m, &b, tau, 0.3 / 7000);
    ck_assert_double_eq_tol(a.t_s, b.t_s, 1e-9);
    for (int i = 0; i < N; i++) {
        ck_assert_double_gt(fabs(a.q_rad[i] - q[i]), 1e-3);
        ck_assert_double_eq_tol(a.q_rad[i], b.q_rad[i], 2e-3 * fabs(a.q_rad[i] - q[i]) + 1e-5);
    }
}
END_TEST

START_TEST(test_random_torque_never_makes_a_number_that_is_none)
{
    struct plant_model m = pa10_plant();
    struct plant_state s;
    uint64_t rng = 31;
    double q[N] = { 0 }, tau[N];
    imperfect(&m);
    accept(&m);
    plant_reset(&m, &s, q, 1);
    for (int k = 0; k < 10000; k++) {
        if (k % 20 == 0)
            for (int i = 0; i < N; i++)
                tau[i] = m.joint[i].tau_max_m_nm * test_uniform(&rng, -3, 3);
        s.locked = k % 1000 > 900 ? (uint32_t)test_random(&rng) : 0;
        plant_step(&m, &s, tau, 1e-3);
        for (int i = 0; i < N; i++) {
            ck_assert(isfinite(s.q_rad[i]) && isfinite(s.thd_m_radps[i]) && isfinite(s.gear_nm[i]));
            ck_assert_double_lt(fabs(s.q_rad[i]), m.joint[i].q_max_rad + 0.2);
            ck_assert_double_lt(fabs(s.qd_radps[i]), 60);
        }
    }
}
END_TEST

START_TEST(test_torque_is_cut_and_no_number_is_zero)
{
    struct plant_model m = rod();
    struct plant_state a, b;
    double q = 0, huge = 1e9, rated = 2, none = NAN, nothing = 0;
    accept(&m);
    plant_reset(&m, &a, &q, 1);
    b = a;
    plant_step(&m, &a, &huge, 0.1);
    plant_step(&m, &b, &rated, 0.1);
    ck_assert(memcmp(&a, &b, sizeof a) == 0);
    plant_step(&m, &a, &none, 0.1);
    plant_step(&m, &b, &nothing, 0.1);
    ck_assert(memcmp(&a, &b, sizeof a) == 0);
    plant_step(&m, &a, &rated, 0);
    plant_step(&m, &a, &rated, -1);
    plant_step(&m, &a, &rated, NAN);
    ck_assert(memcmp(&a, &b, sizeof a) == 0);
}
END_TEST

/* ---- check ---- */

static void refuse(struct plant_model m, int joint, const char *word)
{
    const char *why = NULL;
    ck_assert_int_eq(plant_model_check(&m, &why), -1);
    ck_assert_ptr_nonnull(why);
    ck_assert_msg(strstr(why, word) != NULL, "\"%s\" does not name %s", why, word);
    ck_assert_int_eq(m.check_joint, joint);
    ck_assert_int_eq(plant_model_check(&m, NULL), -1);
}

#define REFUSED(joint_number, word, change)           \
    do {                                              \
        struct plant_model m = pa10_plant();          \
        struct plant_joint *j = &m.joint[2];          \
        (void)j;                                      \
        change;                                       \
        refuse(m, joint_number, word);                \
    } while (0)

START_TEST(test_check_names_what_is_wrong_and_where)
{
    REFUSED(0, "joints", m.joints = 0);
    REFUSED(0, "joints", m.joints = PLANT_JOINTS_MAX + 1);
    REFUSED(0, "gravity", m.gravity_mps2[1] = NAN);
    REFUSED(0, "payload", m.payload_kg = -1);
    REFUSED(0, "step_s", m.step_s = 1e-3);
    REFUSED(0, "step_s", m.step_s = 1e-9);
    REFUSED(0, "positive definite", m.joint[6].mass_kg = 0; memset(m.joint[6].inertia_kgm2, 0, 48));
    REFUSED(3, "link", j->inertia_kgm2[4] = INFINITY);
    REFUSED(3, "rot", j->rot[0] = 0.999);
    REFUSED(3, "mass_kg", j->mass_kg = -1);
    REFUSED(3, "q_min_rad", j->q_min_rad = j->q_max_rad);
    REFUSED(3, "stop_", j->stop_nmprad = -1);
    REFUSED(3, "ratio", j->ratio = 0);
    REFUSED(3, "k_nmprad", j->k_nmprad[1] = 0);
    REFUSED(3, "t_nm", j->t_nm[0] = 1000);
    REFUSED(3, "damping", j->damping_nmspr = -1);
    REFUSED(3, "rotor", j->rotor_kgm2_m = 0);
    REFUSED(3, "fx_inertia", j->fx_inertia_kgm2 = -100);
    REFUSED(3, "tau_max", j->tau_max_m_nm = 0);
    REFUSED(3, "f0_nm", j->friction[1].f0_nm = -1);
    REFUSED(3, "f0_nm", j->friction[0].f0_nm = -1);
    REFUSED(3, "fs_nm", j->friction[1].fs_nm = -100);
    REFUSED(3, "vc_radps", j->friction[1].vc_radps = 0);
    REFUSED(3, "lines", j->lines = PLANT_LINES_MAX + 1);
    REFUSED(3, "line", j->line[0].order_rev = 0);
    REFUSED(3, "negative", j->fx_load_mu = -0.1);
    REFUSED(3, "fx_torque_gain", j->fx_torque_gain = -1);
    REFUSED(3, "fx_spring_q0", j->fx_spring_q0_rad = NAN);
    REFUSED(3, "fx_cold", j->fx_cold_coulomb = -2);
    REFUSED(3, "fx_warm_s", j->fx_cold_viscous = 0.1);
    REFUSED(3, "wander_s", j->wander_sigma_nm = 0.1);
    REFUSED(3, "fx_presliding_rad", j->fx_presliding_nm = 1);
    REFUSED(3, "fx_presliding_nm", j->fx_presliding_nm = 100; j->fx_presliding_rad = 0.1);
}
END_TEST

/* Only with its change is the model wrong: named as if it stood so. */
START_TEST(test_check_names_the_joint_a_change_makes_wrong)
{
    struct plant_model m = pa10_plant();
    m.change[0] = (struct plant_change){ 0, -1, 1, 2 };
    m.change[0].field = (uint32_t)((char *)&m.joint[4].fx_load_mu - (char *)&m);
    m.changes = 1;
    refuse(m, 5, "negative");
    m.change[0].add = 0.1;
    accept(&m);
    ck_assert_int_eq(m.check_joint, 0);
    m.changes = -1;
    refuse(m, 0, "changes");
    m.changes = PLANT_CHANGES_MAX + 1;
    refuse(m, 0, "changes");
}
END_TEST

START_TEST(test_check_accepts_the_edges)
{
    struct plant_model m = rod();
    struct plant_joint *j = &m.joint[0];
    j->t_nm[0] = j->t_nm[1] = 0; /* a gear of one line */
    j->fx_presliding_nm = 36;    /* all of the smaller Coulomb friction is elastic */
    j->fx_presliding_rad = 0.02;
    j->fx_cold_coulomb = j->fx_cold_viscous = -1;
    j->fx_warm_s = 1;
    while (j->lines < PLANT_LINES_MAX)
        j->line[j->lines++] = (struct plant_line){ 7, 1, 0, 1, 0, 0, 0 };
    accept(&m);
    ck_assert_double_eq_tol(plant_gear_nm(j, 1e-3), 1e-3 * j->k_nmprad[2], 1e-9);
    j->fx_presliding_nm = 36.01;
    refuse(m, 1, "fx_presliding_nm");
}
END_TEST

START_TEST(test_chosen_step_follows_the_fastest_thing_there_is)
{
    struct plant_model m = rod(), damped = rod(), arm = pa10_checked();
    struct plant_chain chain;
    plant_matrix mass, minv;
    double bias[N];
    double mobility = 1 / 0.3 + 1 / 0.7, q[N] = { 0 }, fastest = 0;
    m.joint[0].k_nmprad[1] = 6e4; /* the stiffest of the three lines, wherever it is */
    accept(&m);
    ck_assert_double_eq_tol(m.step_s, 0.5 / sqrt(6e4 * mobility), 1e-9);
    damped.joint[0].damping_nmspr = 500;
    accept(&damped);
    ck_assert_double_eq_tol(damped.step_s, 0.5 / (500 * mobility), 1e-9);
    /* a chain: at least as fast as its fastest joint alone, not much faster */
    plant_chain_prepare(&arm, &chain);
    plant_chain_terms(&chain, q, q, mass, bias);
    ck_assert_int_eq(plant_invert(N, mass, minv), 0);
    for (int i = 0; i < N; i++)
        fastest = fmax(fastest, sqrt(arm.joint[i].k_nmprad[2] * (minv[i * PLANT_JOINTS_MAX + i]
                                     + 1 / (arm.joint[i].rotor_kgm2_m * 2500))));
    ck_assert_double_lt(arm.step_s, 0.5 / fastest);
    ck_assert_double_gt(arm.step_s, 0.25 / fastest);
}
END_TEST

static Suite *plant_suite(void)
{
    Suite *suite = suite_create("plant");
    TCase *chain = tcase_create("chain"), *gear = tcase_create("gear"),
          *energy = tcase_create("energy"), *friction = tcase_create("friction"),
          *effects = tcase_create("effects"), *runs = tcase_create("runs");
    tcase_add_test(chain, test_forward_then_inverse_dynamics_returns_the_torque);
    tcase_add_test(chain, test_terms_of_any_arm_are_those_of_a_textbook);
    tcase_add_test(chain, test_step_accelerates_links_as_newton_and_euler_say);
    tcase_add_test(chain, test_holding_torque_is_gradient_of_potential_energy);
    tcase_add_test(chain, test_horizontal_arm_weighs_what_the_manufacturer_says);
    tcase_add_test(chain, test_inverse_refuses_what_is_not_positive_definite);
    tcase_add_test(chain, test_solution_and_inverse_undo_the_product);
    tcase_add_test(gear, test_wind_up_at_rest_is_the_catalogue_torsion);
    tcase_add_test(gear, test_gear_energy_is_the_work_of_its_torque);
    tcase_add_test(gear, test_resonance_is_that_of_two_masses_and_a_spring);
    tcase_add_test(gear, test_end_stop_holds_against_full_torque);
    tcase_add_test(energy, test_energy_drift_of_the_falling_arm_is_first_order_in_the_step);
    tcase_add_test(energy, test_energy_ripple_of_the_gear_is_second_order_in_the_step);
    tcase_add_test(energy, test_friction_never_adds_energy);
    tcase_add_test(friction, test_held_below_breakaway_the_rotor_does_not_creep_at_all);
    tcase_add_test(friction, test_whole_arm_stands_where_friction_exceeds_gravity);
    tcase_add_test(friction, test_steady_sliding_obeys_the_two_sided_stribeck_curve);
    tcase_add_test(friction, test_decay_is_the_exponential_within_1e_13);
    tcase_add_test(friction, test_sliding_rotor_stops_and_stays);
    tcase_add_test(friction, test_locked_rotor_is_held_and_the_gear_still_springs);
    tcase_add_test(friction, test_reported_friction_closes_the_balance_of_the_rotor);
    tcase_add_test(friction, test_mirrored_command_gives_mirrored_motion);
    tcase_add_test(effects, test_payload_adds_its_weight_times_its_arm);
    tcase_add_test(effects, test_cable_spring_must_be_held_against);
    tcase_add_test(effects, test_torque_gain_and_inertia_change_momentum_and_speed);
    tcase_add_test(effects, test_load_friction_grows_with_gear_torque);
    tcase_add_test(effects, test_cold_friction_decays_with_the_thermal_time);
    tcase_add_test(effects, test_presliding_friction_builds_up_over_travel_after_a_reversal);
    tcase_add_test(effects, test_conservative_line_is_a_torque_and_directed_line_a_friction);
    tcase_add_test(effects, test_directed_line_never_turns_friction_into_drive);
    tcase_add_test(effects, test_effect_of_size_zero_is_bit_identical_to_absent);
    tcase_add_test(runs, test_run_scatter_has_its_sigma_and_changes_breakaway);
    tcase_add_test(runs, test_wander_keeps_its_sigma_and_forgets_in_its_time);
    tcase_add_test(runs, test_gauss_is_normal_enough);
    tcase_add_test(runs, test_same_seed_same_bytes_and_a_copy_replays);
    tcase_add_test(runs, test_motion_does_not_depend_on_how_time_is_cut);
    tcase_add_test(runs, test_random_torque_never_makes_a_number_that_is_none);
    tcase_add_test(runs, test_torque_is_cut_and_no_number_is_zero);
    tcase_add_test(runs, test_check_accepts_the_edges);
    tcase_add_test(runs, test_chosen_step_follows_the_fastest_thing_there_is);
    tcase_add_test(runs, test_check_names_what_is_wrong_and_where);
    tcase_add_test(runs, test_check_names_the_joint_a_change_makes_wrong);
    TCase *all[] = { chain, gear, energy, friction, effects, runs };
    for (size_t k = 0; k < sizeof all / sizeof all[0]; k++) {
        tcase_set_timeout(all[k], 120);
        suite_add_tcase(suite, all[k]);
    }
    return suite;
}

HDT_CHECK_MAIN(plant_suite())
