/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The core a second time, in double precision and by other means, and random arms to try both on.
 *
 * Kinematics is worked out in the base frame: gravity as the numeric gradient of the potential
 * energy, inertia by projecting every link's force and moment on every joint axis.  Nothing here
 * uses ctrl code; only the table layout is shared.
 */
#ifndef CORE_REFERENCE_H
#define CORE_REFERENCE_H

#include <math.h>
#include <string.h>

#include "ctrl/hdt_tables.h"
#include "tests/check_main.h"

#define Q(x, n) ((int32_t)lrint((x) * (double)(1ll << (n))))
#define D(x, n) ((double)(x) / (double)(1ll << (n)))
#define LSB_NM 0x1p-16
#define REF_PI 3.14159265358979323846

/* ---- random arms ------------------------------------------------------------------------------ */

/* Butterworth, second order, by the bilinear transform. */
static inline void ref_butterworth(double cutoff_hz, double rate_hz, double b[5])
{
    const double k = tan(REF_PI * cutoff_hz / rate_hz), n = 1 / (1 + sqrt(2) * k + k * k);
    b[0] = k * k * n;
    b[1] = 2 * b[0];
    b[2] = b[0];
    b[3] = 2 * (k * k - 1) * n;
    b[4] = (1 - sqrt(2) * k + k * k) * n;
}

/* The more links the smaller and slower, or the sums of the chain have no room. */
static inline double ref_size(uint32_t joints)
{
    return joints <= 5 ? 1 : 5.0 / joints;
}

/* A twist of any angle, every other a quarter turn; every third link starts where the one before does;
 * every other has no products of inertia. */
static inline void ref_random_link(uint64_t *r, struct hdt_joint_tab *j, double size)
{
    const double twist = test_uniform(r, -REF_PI, REF_PI);
    const int right = test_random(r) & 1, step = test_random(r) % 3 != 0, skew = test_random(r) & 1;
    j->phase0 = (uint32_t)test_random(r);
    j->twist_cos_q30 = right ? 0 : Q(cos(twist), 30);
    j->twist_sin_q30 = right ? 1 << 30 : Q(sin(twist), 30);
    for (int i = 0; i < 2; i++) {
        j->step_q24[i] = step ? Q(size * test_uniform(r, -0.5, 0.5), 24) : 0;
        j->moment_q20[i] = Q(size * test_uniform(r, -5, 5), 20);
    }
    for (int i = 0; i < 5; i++)
        j->second_q20[i] = skew || i == 0 || i == 3 ? Q(size * test_uniform(r, -1, 1), 20) : 0;
    j->rotor_q20 = Q(test_uniform(r, 0, 2), 20);
}

/* What the flags must say. */
static inline void ref_chain_flags(struct hdt_tables *t)
{
    uint32_t far = 0;
    for (uint32_t j = 0; j < t->joints; j++) {
        struct hdt_joint_tab *k = &t->joint[j];
        const int step = j > 0 && (k->step_q24[0] || k->step_q24[1]);
        far |= step ? HDT_CHAIN_FAR : 0;
        k->chain = far | (step ? HDT_CHAIN_STEP : 0);
        if (k->twist_cos_q30 == 0 && k->twist_sin_q30 == 1 << 30)
            k->chain |= HDT_CHAIN_RIGHT;
        if (k->second_q20[1] || k->second_q20[2] || k->second_q20[4])
            k->chain |= HDT_CHAIN_SKEW;
    }
}

static inline void ref_random_joint(uint64_t *r, struct hdt_joint_tab *j, double ratio, double size)
{
    const double counts = ratio * 16384;
    j->terms = (1u << HDT_TERMS) - 1;
    j->sign = test_random(r) & 1 ? 1 : -1;
    j->zero_cnt = (int32_t)test_uniform(r, -3e5, 3e5);
    j->rad_per_count_q44 = (uint32_t)llrint(2 * REF_PI / counts * 0x1p44);
    j->phase_per_count_q24 = (uint64_t)llrint(0x1p56 / counts);
    ref_random_link(r, j, size);
    j->v_lim_q24 = Q(4 * size, 24);
    j->a_lim_q16 = Q(32 * size, 16);
    j->v_ramp_inv_q16 = Q(1 / test_uniform(r, 0.001, 0.1), 16);
    j->friction_shift = 14 + (uint32_t)(test_random(r) % 6);
    for (int d = 0; d < 2; d++) {
        for (int k = 0; k < HDT_FRICTION_KNOTS; k++)
            j->friction_q16[d][k] = Q(20 + 0.1 * k + test_uniform(r, -3, 3), 16);
        const double t1 = test_uniform(r, -40, 40);
        j->stiffness[d].t1_q16 = Q(t1, 16);
        j->stiffness[d].t2_q16 = Q(t1 + test_uniform(r, 0, 40), 16);
        for (int k = 0; k < 3; k++) {
            j->stiffness[d].intercept_q16[k] = Q(test_uniform(r, -20, 20), 16);
            j->stiffness[d].slope_q24[k] = Q(test_uniform(r, -2, 2), 24);
        }
    }
    for (int k = 0; k < HDT_RIPPLE_KNOTS; k++)
        j->ripple_q8[k] = (int16_t)Q(test_uniform(r, -5, 5), 8);
    j->windup_inv_q8 = test_random(r) & 1 ? Q(1 / test_uniform(r, 1e-4, 0.05), 8) : 0;
    struct hdt_curve_tab *const curve[] = {&j->local[0], &j->local[1], &j->table};
    j->axis = (uint32_t)(test_random(r) % HDT_AXES);
    j->directed = test_random(r) & 1;
    for (int c = 0; c < 3; c++) {
        const int phase = c == 2 && j->axis == HDT_AXIS_PHASE;
        curve[c]->start = phase ? 0 : Q(test_uniform(r, -4, 0), 24);
        curve[c]->shift = phase ? 6 : 16 + (uint32_t)(test_random(r) % 3);
        for (int k = 0; k < HDT_CURVE_KNOTS; k++)
            curve[c]->value_q8[k] = (int16_t)Q(test_uniform(r, -5, 5), 8);
    }
    j->lines = (uint32_t)(test_random(r) % (HDT_LINES_MAX + 1));
    for (uint32_t k = 0; k < HDT_LINES_MAX; k++) {
        j->line[k].amplitude_q16 = Q(test_uniform(r, -8, 8), 16);
        j->line[k].directed = test_random(r) & 1;
        j->line[k].phase0 = (uint32_t)test_random(r);
        j->line[k].phase_per_count_q24 = (uint64_t)llrint(test_uniform(r, 0.3, 120) * 0x1p56 / counts);
    }
    j->load_mu_q24 = Q(test_uniform(r, 0, 0.3), 24);
    j->cold_coulomb_q16 = Q(test_uniform(r, -10, 10), 16);
    j->cold_viscous_q16 = Q(test_uniform(r, -20, 20), 16);
    j->cold_decay_q31 = (int32_t)llrint(exp(-1 / test_uniform(r, 60, 2000)) * 0x1p31);
    j->presliding_q16 = Q(test_uniform(r, -15, 15), 16);
    j->presliding_inv_q8 = Q(1 / test_uniform(r, 1e-4, 0.05), 8);
    j->spring_q16 = Q(test_uniform(r, -20, 20), 16);
    j->spring_q0_q24 = Q(test_uniform(r, -1, 1), 24);
    j->offset_q16 = Q(test_uniform(r, -5, 5), 16);
    j->kp_q16 = Q(test_uniform(r, 0, 500), 16);
    j->kd_q16 = Q(test_uniform(r, 0, 50), 16);
    j->digit_per_nm_q24 = Q(1000 / ratio, 24);
    j->dig_max = 1 + (int32_t)(test_random(r) % 32767);
    j->dig_slew = 1 + (int32_t)(test_random(r) % 65535);
    j->spd_max = (int32_t)(test_random(r) % 32768);
    j->q_min_q24 = Q(-3, 24);
    j->q_max_q24 = Q(3, 24);
    j->v_max_q24 = Q(6, 24);
    j->follow_max_q24 = 0;
}

/* Tables the core accepts, every term on. */
static inline void ref_random_arm(uint64_t *r, uint32_t joints, struct hdt_tables *t)
{
    const double rate_hz = test_uniform(r, 200, 2000);
    double b[5];
    memset(t, 0, sizeof *t);
    t->magic = HDT_TABLES_MAGIC;
    t->layout = HDT_TABLES_LAYOUT;
    strcpy(t->name, "random");
    for (int i = 0; i < 32; i++)
        t->digest[i] = (uint8_t)test_random(r);
    t->joints = joints;
    t->period_ns = (uint32_t)llrint(1e9 / rate_hz);
    t->rate_q16 = (uint32_t)llrint(rate_hz * 65536);
    t->stale_periods = 3;
    for (int i = 0; i < 3; i++)
        t->gravity_q24[i] = Q(test_uniform(r, -9.81, 9.81), 24);
    ref_butterworth(test_uniform(r, 0.02, 0.3) * rate_hz, rate_hz, b);
    for (int i = 0; i < 5; i++)
        t->biquad_q28[i] = Q(b[i], 28);
    for (uint32_t j = 0; j < joints; j++)
        ref_random_joint(r, &t->joint[j], test_uniform(r, 30, 320), ref_size(joints));
    ref_chain_flags(t);
}

/* ---- the chain, in the base frame --------------------------------------------------------------- */

struct ref_frame { double rot[9], pos[3]; }; /* of a link, in the base frame */

static inline void ref_cross(const double a[3], const double b[3], double out[3])
{
    const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    memcpy(out, c, sizeof c);
}

static inline double ref_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void ref_turn(const double rot[9], const double v[3], double out[3])
{
    const double c[3] = {ref_dot(rot, v), ref_dot(rot + 3, v), ref_dot(rot + 6, v)};
    memcpy(out, c, sizeof c);
}

static inline void ref_matmul(const double a[9], const double b[9], double out[9])
{
    double c[9];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            c[3 * i + k] = a[3 * i] * b[k] + a[3 * i + 1] * b[3 + k] + a[3 * i + 2] * b[6 + k];
    memcpy(out, c, sizeof c);
}

static inline void ref_frames(const struct hdt_tables *t, const double q[], struct ref_frame f[])
{
    struct ref_frame at = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    for (uint32_t j = 0; j < t->joints; j++) {
        const struct hdt_joint_tab *k = &t->joint[j];
        const double x = q[j] + k->phase0 * (0x1p-32 * 2 * REF_PI);
        const double ct = D(k->twist_cos_q30, 30), st = D(k->twist_sin_q30, 30);
        const double twist[9] = {1, 0, 0, 0, ct, -st, 0, st, ct};
        const double turn[9] = {cos(x), -sin(x), 0, sin(x), cos(x), 0, 0, 0, 1};
        double p[3] = {D(k->step_q24[0], 24), D(k->step_q24[1], 24), 0};
        ref_turn(at.rot, p, p);
        for (int i = 0; i < 3; i++)
            at.pos[i] += p[i];
        ref_matmul(at.rot, twist, at.rot);
        ref_matmul(at.rot, turn, at.rot);
        f[j] = at;
    }
}

/* -sum over links of g . first moment; the links have no mass, it is booked elsewhere */
static inline double ref_potential_j(const struct hdt_tables *t, const double q[])
{
    struct ref_frame f[HDT_JOINTS_MAX];
    double energy = 0;
    ref_frames(t, q, f);
    for (uint32_t j = 0; j < t->joints; j++) {
        const double g[3] = {D(t->gravity_q24[0], 24), D(t->gravity_q24[1], 24), D(t->gravity_q24[2], 24)};
        double s[3] = {D(t->joint[j].moment_q20[0], 20), D(t->joint[j].moment_q20[1], 20), 0};
        ref_turn(f[j].rot, s, s);
        energy -= ref_dot(g, s);
    }
    return energy;
}

/* Central difference: truncation and rounding below 1e-7 N.m for the arms above. */
static inline void ref_gravity(const struct hdt_tables *t, const double q[], double tau[])
{
    const double step = 1e-4;
    double x[HDT_JOINTS_MAX];
    memcpy(x, q, t->joints * sizeof *q);
    for (uint32_t j = 0; j < t->joints; j++) {
        double e[4];
        for (int k = 0; k < 4; k++) {
            x[j] = q[j] + step * (const double[]){-2, -1, 1, 2}[k];
            e[k] = ref_potential_j(t, x);
        }
        tau[j] = (e[0] - 8 * e[1] + 8 * e[2] - e[3]) / (12 * step);
        x[j] = q[j];
    }
}

/* tau_j = z_j . sum over links k >= j of (N_k + (o_k - o_j) x F_k), rotors apart. */
static inline void ref_inertia(const struct hdt_tables *t, const double q[], const double v[],
                               const double a[], double tau[])
{
    struct ref_frame f[HDT_JOINTS_MAX];
    double w[3] = {0, 0, 0}, dw[3] = {0, 0, 0}, acc[3] = {0, 0, 0}, at[3] = {0, 0, 0};
    ref_frames(t, q, f);
    memset(tau, 0, t->joints * sizeof *tau);
    for (uint32_t k = 0; k < t->joints; k++) {
        const struct hdt_joint_tab *tab = &t->joint[k];
        const double z[3] = {f[k].rot[2], f[k].rot[5], f[k].rot[8]};
        double p[3], u[3], x[3], s[3], in[9], rt[9], l[3], force[3], moment[3];

        /* origin k is fixed in link k-1 */
        for (int i = 0; i < 3; i++)
            p[i] = f[k].pos[i] - at[i];
        ref_cross(w, p, u);
        ref_cross(w, u, u);
        ref_cross(dw, p, x);
        for (int i = 0; i < 3; i++)
            acc[i] += u[i] + x[i];
        ref_cross(w, z, u);
        for (int i = 0; i < 3; i++) {
            dw[i] += z[i] * a[k] + u[i] * v[k];
            w[i] += z[i] * v[k];
        }
        memcpy(at, f[k].pos, sizeof at);

        /* first moment and inertia tensor, from the second moment, in base axes */
        const double e[5] = {D(tab->second_q20[0], 20), D(tab->second_q20[1], 20), D(tab->second_q20[2], 20),
                             D(tab->second_q20[3], 20), D(tab->second_q20[4], 20)};
        const double tensor[9] = {e[3], -e[1], -e[2], -e[1], e[0], -e[4], -e[2], -e[4], e[0] + e[3]};
        s[0] = D(tab->moment_q20[0], 20);
        s[1] = D(tab->moment_q20[1], 20);
        s[2] = 0;
        ref_turn(f[k].rot, s, s);
        for (int i = 0; i < 9; i++) {
            in[i] = tensor[i];
            rt[i] = f[k].rot[i % 3 * 3 + i / 3];
        }
        ref_matmul(f[k].rot, in, in);
        ref_matmul(in, rt, in);

        ref_cross(w, s, u);
        ref_cross(w, u, u);
        ref_cross(dw, s, x);
        for (int i = 0; i < 3; i++)
            force[i] = u[i] + x[i];
        ref_turn(in, w, l);
        ref_cross(w, l, u);
        ref_turn(in, dw, l);
        ref_cross(s, acc, x);
        for (int i = 0; i < 3; i++)
            moment[i] = u[i] + l[i] + x[i];

        for (uint32_t j = 0; j <= k; j++) {
            const double zj[3] = {f[j].rot[2], f[j].rot[5], f[j].rot[8]};
            for (int i = 0; i < 3; i++)
                p[i] = f[k].pos[i] - f[j].pos[i];
            ref_cross(p, force, u);
            tau[j] += ref_dot(zj, moment) + ref_dot(zj, u);
        }
    }
}

/* ---- terms of one joint -------------------------------------------------------------------------- */

struct ref_motion {
    double turned; /* counts from zero, joint direction */
    double q, v, q_ref, v_ref, a_ref, dir, travel, wound, cold, gravity, inertia;
    double load; /* what the gear has to carry: gravity, and a spring that is in use */
};

static inline double ref_dir(const struct hdt_joint_tab *j, double v_ref)
{
    return fmax(-1, fmin(1, v_ref * D(j->v_ramp_inv_q16, 16)));
}

static inline double ref_friction(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    const int32_t *knot = j->friction_q16[m->dir >= 0 ? 0 : 1];
    const double x = fabs(m->v_ref) * 0x1p24 / (double)(1u << j->friction_shift);
    const int k = (int)fmin(floor(x), 127);
    return m->dir * (D(knot[k], 16) + (D(knot[k + 1], 16) - D(knot[k], 16)) * (x - k));
}

static inline double ref_ripple(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    double x = fmod(m->turned, 16384) / 16;
    if (x < 0)
        x += 1024;
    const int k = (int)floor(x);
    return m->dir
           * (D(j->ripple_q8[k], 8) + (x - k) * (D(j->ripple_q8[(k + 1) % 1024], 8) - D(j->ripple_q8[k], 8)));
}

static inline double ref_spring(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    return D(j->spring_q16, 16) * (m->q - D(j->spring_q0_q24, 24));
}

static inline double ref_windup(const struct hdt_stiffness_tab *s, double x)
{
    const int k = x < D(s->t1_q16, 16) ? 0 : x <= D(s->t2_q16, 16) ? 1 : 2;
    return D(s->intercept_q16[k], 16) + D(s->slope_q24[k], 24) * x;
}

static inline double ref_stiffness(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    if (j->windup_inv_q8 != 0)
        return (1 + m->wound) / 2 * ref_windup(&j->stiffness[0], m->load) +
               (1 - m->wound) / 2 * ref_windup(&j->stiffness[1], m->load);
    return fabs(m->dir) * ref_windup(&j->stiffness[m->dir >= 0 ? 0 : 1], m->load);
}

/* A curve at x in the raw units of its axis. */
static inline double ref_curve(const struct hdt_curve_tab *c, double x)
{
    const double place = fmax(0, fmin(256, (x - c->start) / (double)(1u << c->shift)));
    const int k = (int)fmin(floor(place), 255);
    return D(c->value_q8[k], 8) + (place - k) * (D(c->value_q8[k + 1], 8) - D(c->value_q8[k], 8));
}

static inline double ref_table(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    double phase = fmod(m->turned, 16384);
    phase += phase < 0 ? 16384 : 0;
    const double x[HDT_AXES] = {m->q * 0x1p24, m->load * 0x1p16, phase, fabs(m->v_ref) * 0x1p24};
    return ref_curve(&j->table, x[j->axis]) * (j->directed ? m->dir : 1);
}

static inline double ref_lines(const struct hdt_joint_tab *j, const struct ref_motion *m)
{
    double sum = 0;
    for (uint32_t k = 0; k < j->lines; k++) {
        const double turns = m->turned * ((double)j->line[k].phase_per_count_q24 * 0x1p-56) +
                             (double)j->line[k].phase0 * 0x1p-32;
        sum += D(j->line[k].amplitude_q16, 16) * sin(2 * REF_PI * turns) * (j->line[k].directed ? m->dir : 1);
    }
    return sum;
}

static inline double ref_term(const struct hdt_joint_tab *j, int term, const struct ref_motion *m)
{
    switch (term) {
    case HDT_TERM_GRAVITY: return m->gravity;
    case HDT_TERM_INERTIA: return m->inertia + D(j->rotor_q20, 20) * m->a_ref;
    case HDT_TERM_FRICTION: return ref_friction(j, m);
    case HDT_TERM_RIPPLE: return ref_ripple(j, m);
    case HDT_TERM_STIFFNESS: return ref_stiffness(j, m);
    case HDT_TERM_LINES: return ref_lines(j, m);
    case HDT_TERM_LOAD: return D(j->load_mu_q24, 24) * fabs(m->load) * m->dir;
    case HDT_TERM_TEMPERATURE:
        return m->cold * (D(j->cold_coulomb_q16, 16) * m->dir + D(j->cold_viscous_q16, 16) * m->v_ref);
    case HDT_TERM_PRESLIDING:
        return -D(j->presliding_q16, 16) * exp(-m->travel * D(j->presliding_inv_q8, 8)) * m->dir;
    case HDT_TERM_SPRING: return ref_spring(j, m);
    case HDT_TERM_OFFSET: return D(j->offset_q16, 16);
    case HDT_TERM_LOCAL: return m->dir * ref_curve(&j->local[m->dir >= 0 ? 0 : 1], m->q * 0x1p24);
    case HDT_TERM_TABLE: return ref_table(j, m);
    case HDT_TERM_P: return D(j->kp_q16, 16) * (m->q_ref - m->q);
    case HDT_TERM_D: return D(j->kd_q16, 16) * (m->v_ref - m->v);
    default: return NAN;
    }
}

/* Worst fixed-point error a term may have, N.m, when both sides get the same inputs: half an LSB for
 * every rounding on the way, plus what the sine (4e-9) and exponential (5e-7) allow. */
static inline double ref_tolerance(const struct hdt_joint_tab *j, int term)
{
    switch (term) {
    case HDT_TERM_LINES: return 4.1 * LSB_NM;
    case HDT_TERM_PRESLIDING: return 1.1 * LSB_NM + 5e-7 * fabs(D(j->presliding_q16, 16));
    case HDT_TERM_TEMPERATURE: return 1.6 * LSB_NM;
    case HDT_TERM_FRICTION: return 1.1 * LSB_NM;
    case HDT_TERM_STIFFNESS: return (j->windup_inv_q8 != 0 ? 1.6 : 1.1) * LSB_NM;
    case HDT_TERM_LOAD: return 1.1 * LSB_NM;
    case HDT_TERM_OFFSET: return 0;
    case HDT_TERM_LOCAL:
    case HDT_TERM_TABLE: return 1.1 * LSB_NM;
    default: return 0.6 * LSB_NM;
    }
}

/* Every link rounds g (two times a component, q24) and h (the same, q20), and turns both by a sine
 * that may be 4e-9 off; the roundings are independent, so their sum grows with the root. */
static inline double ref_gravity_tolerance(const struct hdt_tables *t)
{
    double h = 0, g = 0;
    for (int i = 0; i < 3; i++)
        g += fabs(D(t->gravity_q24[i], 24));
    for (uint32_t j = 0; j < t->joints; j++)
        for (int i = 0; i < 2; i++)
            h += fabs(D(t->joint[j].moment_q20[i], 20));
    return LSB_NM + sqrt(t->joints) * (0x1p-20 * g + 0x1p-24 * h + 4e-9 * g * h);
}

/* Each link adds roundings of q18, a quarter of one on average, to the acceleration of its points, which its
 * moments feel, and of q16 to force and moment, which the links before feel at their lever arm; independent,
 * so the sum grows with the root. */
static inline double ref_inertia_tolerance(const struct hdt_tables *t)
{
    double moments = 0;
    for (uint32_t j = 0; j < t->joints; j++) {
        for (int i = 0; i < 2; i++)
            moments += fabs(D(t->joint[j].moment_q20[i], 20));
        for (int i = 0; i < 5; i++)
            moments += fabs(D(t->joint[j].second_q20[i], 20));
    }
    return sqrt(t->joints) * (1 + 0.3 * t->joints) * (2 * LSB_NM + 0x1p-20 * moments / t->joints);
}

#endif
