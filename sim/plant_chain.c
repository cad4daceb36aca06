/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rigid-body dynamics of the open chain, all vectors in base coordinates: pose, mass matrix by
 * composite rigid bodies, bias torque by recursive Newton-Euler, inverse by Cholesky.
 *
 * Owns: the mechanics of the links.
 * Never: knows gears, rotors or friction.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void mat_vec(const double *r, const double *v, double *out)
{
    for (int i = 0; i < 3; i++)
        out[i] = r[3 * i] * v[0] + r[3 * i + 1] * v[1] + r[3 * i + 2] * v[2];
}

static void sym_vec(const double *s, const double *v, double *out)
{
    out[0] = s[0] * v[0] + s[1] * v[1] + s[2] * v[2];
    out[1] = s[1] * v[0] + s[3] * v[1] + s[4] * v[2];
    out[2] = s[2] * v[0] + s[4] * v[1] + s[5] * v[2];
}

/* The joint axis z of a frame. */
static void axis(const double *rot, double *z)
{
    z[0] = rot[2];
    z[1] = rot[5];
    z[2] = rot[8];
}

/* R S R' of a symmetric tensor. */
static void sym_rotate(const double *r, const double *s, double *out)
{
    double rs[9];
    for (int i = 0; i < 3; i++)
        sym_vec(s, r + 3 * i, rs + 3 * i); /* row i of R S, S being symmetric */
    out[0] = dot(rs, r);
    out[1] = dot(rs, r + 3);
    out[2] = dot(rs, r + 6);
    out[3] = dot(rs + 3, r + 3);
    out[4] = dot(rs + 3, r + 6);
    out[5] = dot(rs + 6, r + 6);
}

/* Add the inertia of a point mass: m (c.c E - c c'). */
static void sym_add_point(double *s, double mass, const double *c)
{
    double cc = dot(c, c);
    s[0] += mass * (cc - c[0] * c[0]);
    s[1] -= mass * c[0] * c[1];
    s[2] -= mass * c[0] * c[2];
    s[3] += mass * (cc - c[1] * c[1]);
    s[4] -= mass * c[1] * c[2];
    s[5] += mass * (cc - c[2] * c[2]);
}

static void pose_link(const struct plant_model *m, int i, struct plant_pose *pose)
{
    const struct plant_joint *j = &m->joint[i];
    double moment[3], inertia[6];
    memcpy(moment, j->moment_kgm, sizeof moment);
    memcpy(inertia, j->inertia_kgm2, sizeof inertia);
    pose->mass_kg[i] = j->mass_kg;
    if (i == m->joints - 1) {
        pose->mass_kg[i] += m->payload_kg;
        for (int k = 0; k < 3; k++)
            moment[k] += m->payload_kg * m->payload_com_m[k];
        sym_add_point(inertia, m->payload_kg, m->payload_com_m);
    }
    mat_vec(pose->rot[i], moment, pose->moment_kgm[i]);
    sym_rotate(pose->rot[i], inertia, pose->inertia_kgm2[i]);
}

void plant_chain_pose(const struct plant_model *m, const double *q_rad, struct plant_pose *pose)
{
    static const double identity[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
    static const double zero[3] = { 0, 0, 0 };
    for (int i = 0; i < m->joints; i++) {
        const struct plant_joint *j = &m->joint[i];
        const double *parent = i > 0 ? pose->rot[i - 1] : identity;
        const double *origin = i > 0 ? pose->pos_m[i - 1] : zero;
        double c = cos(q_rad[i]), s = sin(q_rad[i]), step[3], turn[9];
        for (int r = 0; r < 3; r++) { /* rot * Rz(q) */
            const double *row = j->rot + 3 * r;
            turn[3 * r] = row[0] * c + row[1] * s;
            turn[3 * r + 1] = row[1] * c - row[0] * s;
            turn[3 * r + 2] = row[2];
        }
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++)
                pose->rot[i][3 * r + k] = parent[3 * r] * turn[k] + parent[3 * r + 1] * turn[3 + k]
                                          + parent[3 * r + 2] * turn[6 + k];
        mat_vec(parent, j->trans_m, step);
        for (int k = 0; k < 3; k++)
            pose->pos_m[i][k] = origin[k] + step[k];
        pose_link(m, i, pose);
    }
}

/* Links i..end as one body about the base origin. */
struct composite { double mass, moment[3], inertia[6]; };

static void composite_add(struct composite *c, const struct plant_pose *pose, int i)
{
    const double *p = pose->pos_m[i], *h = pose->moment_kgm[i], *s = pose->inertia_kgm2[i];
    double mass = pose->mass_kg[i], ph = 2 * dot(p, h);
    c->mass += mass;
    for (int k = 0; k < 3; k++)
        c->moment[k] += h[k] + mass * p[k];
    c->inertia[0] += s[0] + ph - 2 * p[0] * h[0];
    c->inertia[1] += s[1] - p[0] * h[1] - p[1] * h[0];
    c->inertia[2] += s[2] - p[0] * h[2] - p[2] * h[0];
    c->inertia[3] += s[3] + ph - 2 * p[1] * h[1];
    c->inertia[4] += s[4] - p[1] * h[2] - p[2] * h[1];
    c->inertia[5] += s[5] + ph - 2 * p[2] * h[2];
    sym_add_point(c->inertia, mass, p);
}

void plant_chain_mass(const struct plant_model *m, const struct plant_pose *pose, plant_matrix mass)
{
    struct composite c = { 0 };
    for (int j = m->joints - 1; j >= 0; j--) {
        composite_add(&c, pose, j);
        const double *p = pose->pos_m[j];
        double z[3], arm[3], momentum[3], angular[3], zp[3], lost[3];
        axis(pose->rot[j], z);
        for (int k = 0; k < 3; k++)
            arm[k] = c.moment[k] - c.mass * p[k];
        cross(z, arm, momentum);
        /* angular momentum about the base origin of a unit turn about joint j */
        sym_vec(c.inertia, z, angular);
        cross(z, p, zp);
        cross(c.moment, zp, lost);
        for (int k = 0; k < 3; k++)
            angular[k] -= lost[k];
        for (int i = 0; i <= j; i++) {
            double zi[3], moved[3];
            axis(pose->rot[i], zi);
            cross(pose->pos_m[i], momentum, moved);
            double value = dot(zi, angular) - dot(zi, moved);
            mass[i * PLANT_JOINTS_MAX + j] = mass[j * PLANT_JOINTS_MAX + i] = value;
        }
    }
}

/* Motion of one joint frame, gravity as an upward acceleration of the base. */
struct motion { double w[3], alpha[3], acc[3]; };

/* Force and moment about its joint origin that a link's motion takes. */
static void link_wrench(const struct plant_pose *pose, int i, const struct motion *v, double *f,
                        double *n)
{
    const double *h = pose->moment_kgm[i], *s = pose->inertia_kgm2[i];
    double wh[3], wwh[3], ah[3], iw[3], wiw[3], ia[3], ha[3];
    cross(v->w, h, wh);
    cross(v->w, wh, wwh);
    cross(v->alpha, h, ah);
    sym_vec(s, v->w, iw);
    cross(v->w, iw, wiw);
    sym_vec(s, v->alpha, ia);
    cross(h, v->acc, ha);
    for (int k = 0; k < 3; k++) {
        f[k] = pose->mass_kg[i] * v->acc[k] + ah[k] + wwh[k];
        n[k] = ia[k] + wiw[k] + ha[k];
    }
}

/* From the frame before to frame i; joints do not accelerate here. */
static void motion_next(struct motion *v, const double *z, const double *r, double speed)
{
    double wr[3], wwr[3], ar[3], wz[3];
    cross(v->w, r, wr);
    cross(v->w, wr, wwr);
    cross(v->alpha, r, ar);
    cross(v->w, z, wz);
    for (int k = 0; k < 3; k++) {
        v->acc[k] += ar[k] + wwr[k];
        v->alpha[k] += wz[k] * speed;
        v->w[k] += z[k] * speed;
    }
}

void plant_chain_bias(const struct plant_model *m, const struct plant_pose *pose,
                      const double *qd_radps, double *tau_nm)
{
    double f[PLANT_JOINTS_MAX][3], n[PLANT_JOINTS_MAX][3];
    struct motion v = { { 0 },
                        { 0 },
                        { -m->gravity_mps2[0], -m->gravity_mps2[1], -m->gravity_mps2[2] } };
    for (int i = 0; i < m->joints; i++) {
        double z[3], r[3];
        axis(pose->rot[i], z);
        for (int k = 0; k < 3; k++)
            r[k] = pose->pos_m[i][k] - (i > 0 ? pose->pos_m[i - 1][k] : 0);
        motion_next(&v, z, r, qd_radps[i]);
        link_wrench(pose, i, &v, f[i], n[i]);
    }
    for (int i = m->joints - 1; i >= 0; i--) {
        double z[3], r[3], carried[3];
        axis(pose->rot[i], z);
        tau_nm[i] = dot(z, n[i]);
        if (i == 0)
            break;
        for (int k = 0; k < 3; k++)
            r[k] = pose->pos_m[i][k] - pose->pos_m[i - 1][k];
        cross(r, f[i], carried);
        for (int k = 0; k < 3; k++) {
            f[i - 1][k] += f[i][k];
            n[i - 1][k] += n[i][k] + carried[k];
        }
    }
}

double plant_chain_potential_j(const struct plant_model *m, const struct plant_pose *pose)
{
    double u = 0;
    for (int i = 0; i < m->joints; i++)
        u -= dot(m->gravity_mps2, pose->moment_kgm[i])
             + pose->mass_kg[i] * dot(m->gravity_mps2, pose->pos_m[i]);
    return u;
}

int plant_invert(int n, const plant_matrix a, plant_matrix inverse)
{
    enum { W = PLANT_JOINTS_MAX };
    plant_matrix l; /* lower triangle of the Cholesky factor, then of its inverse */
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = a[i * W + j];
            for (int k = 0; k < j; k++)
                sum -= l[i * W + k] * l[j * W + k];
            if (i == j && !(sum > 1e-12 * fabs(a[i * W + i]) && sum > 0))
                return -1;
            l[i * W + j] =
                i == j ? 1 / sqrt(sum) : sum * l[j * W + j]; /* reciprocal on the diagonal */
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            double sum = 0;
            for (int k = j; k < i; k++)
                sum -= l[i * W + k] * l[k * W + j];
            l[i * W + j] = sum * l[i * W + i];
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0;
            for (int k = i; k < n; k++)
                sum += l[k * W + i] * l[k * W + j];
            inverse[i * W + j] = inverse[j * W + i] = sum;
        }
    return 0;
}
