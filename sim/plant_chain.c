/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Rigid-body dynamics of the open chain in link frames: bias torque by recursive Newton-Euler, mass
 * matrix by composite bodies, both with second moments in place of inertia tensors; factor and
 * inverse of symmetric matrices.
 *
 * plant_chain_prepare chooses frames and books inertia so that the constants left are few (struct
 * plant_body): the standard inertial parameters have more numbers than motion can tell apart, and
 * what a joint's axis carries may as well belong to the link before.  Nothing is approximated.
 *
 * Owns: the mechanics of the links.
 * Never: knows gears, rotors or friction.
 */
#include <math.h>
#include <string.h>

#include "sim/plant_parts.h"

enum { W = PLANT_JOINTS_MAX };

/* ---- constants ---- */

/* Any mass: mass, its first moment, its second moment (xx xy xz yy yz zz of the integral of r r'). */
struct heap { double mass, first[3], second[6]; };

static void heap_add(struct heap *a, const struct heap *b)
{
    a->mass += b->mass;
    for (int k = 0; k < 3; k++)
        a->first[k] += b->first[k];
    for (int k = 0; k < 6; k++)
        a->second[k] += b->second[k];
}

/* As seen from a frame whose origin lies at -r. */
static void heap_shift(struct heap *h, const double *r)
{
    static const int at[6][2] = { { 0, 0 }, { 0, 1 }, { 0, 2 }, { 1, 1 }, { 1, 2 }, { 2, 2 } };
    for (int k = 0; k < 6; k++) {
        int a = at[k][0], b = at[k][1];
        h->second[k] += h->first[a] * r[b] + r[a] * h->first[b] + h->mass * r[a] * r[b];
    }
    for (int k = 0; k < 3; k++)
        h->first[k] += h->mass * r[k];
}

/* As seen from a frame turned back about z. */
static void heap_turn_z(struct heap *h, double c, double s)
{
    double x = h->first[0], y = h->first[1];
    const double *v = h->second;
    h->first[0] = c * x - s * y;
    h->first[1] = s * x + c * y;
    double turned[6] = { c * c * v[0] - 2 * c * s * v[1] + s * s * v[3],
                         c * s * (v[0] - v[3]) + (c * c - s * s) * v[1],
                         c * v[2] - s * v[4],
                         s * s * v[0] + 2 * c * s * v[1] + c * c * v[3],
                         s * v[2] + c * v[4],
                         v[5] };
    memcpy(h->second, turned, sizeof turned);
}

/* A link with, on the last one, the payload; in the model's frame. */
static struct heap link_heap(const struct plant_model *m, int i)
{
    const struct plant_joint *j = &m->joint[i];
    const double *in = j->inertia_kgm2;
    double half = (in[0] + in[3] + in[5]) / 2;
    struct heap h = { j->mass_kg,
                      { j->moment_kgm[0], j->moment_kgm[1], j->moment_kgm[2] },
                      { half - in[0], -in[1], -in[2], half - in[3], -in[4], half - in[5] } };
    if (i == m->joints - 1) {
        struct heap load = { .mass = m->payload_kg };
        heap_shift(&load, m->payload_com_m);
        heap_add(&h, &load);
    }
    return h;
}

/* rot = Rz(before) Rx(twist) Rz(after), |before| <= pi/2. */
struct angles { double before_cos, before_sin, before_rad, twist_cos, twist_sin, after_rad; };

static struct angles split(const double *rot)
{
    struct angles a = { 1, 0, 0, 1, 0, 0 };
    double x = rot[2], y = rot[5]; /* the new axis across the old one */
    if (y > 0 || (y == 0 && x < 0)) {
        x = -x;
        y = -y;
    }
    if (x != 0 || y != 0) {
        a.before_rad = atan2(x, -y);
        a.before_cos = cos(a.before_rad);
        a.before_sin = sin(a.before_rad);
    }
    double c = a.before_cos, s = a.before_sin;
    double down = c * rot[5] - s * rot[2], size = hypot(down, rot[8]);
    a.twist_sin = -down / size;
    a.twist_cos = rot[8] / size;
    a.after_rad = atan2(-(c * rot[1] + s * rot[4]), c * rot[0] + s * rot[3]);
    return a;
}

/* Where the frame of a body lies in that of the body before. */
struct place { double r[3], up[3]; };

/* Take what lies along the joint's axis out of a body and return it in the frame before, where it
 * turns with the body before in any case. */
static struct heap axis_part(struct heap *h, const struct place *p)
{
    const double *u = p->up, along = h->first[2], second = h->second[5];
    struct heap out = { h->mass,
                        { along * u[0], along * u[1], along * u[2] },
                        { second * u[0] * u[0], second * u[0] * u[1], second * u[0] * u[2],
                          second * u[1] * u[1], second * u[1] * u[2], second * u[2] * u[2] } };
    heap_shift(&out, p->r);
    h->mass = h->first[2] = h->second[5] = 0;
    return out;
}

static void body_store(struct plant_body *b, const struct heap *h)
{
    memcpy(b->moment_kgm, h->first, sizeof b->moment_kgm);
    memcpy(b->second_kgm2, h->second, sizeof b->second_kgm2);
}

void plant_chain_prepare(const struct plant_model *m, struct plant_chain *c)
{
    struct heap from_after = { 0 };
    double shift = 0, turn_cos = 1, turn_sin = 0, turn_rad = 0; /* own frame against the model's */
    c->joints = m->joints;
    for (int i = m->joints - 1; i >= 0; i--) {
        const struct plant_joint *j = &m->joint[i];
        struct plant_body *b = &c->body[i];
        struct angles a = split(j->rot);
        struct heap h = link_heap(m, i);
        heap_shift(&h, (double[3]){ 0, 0, -shift });
        heap_turn_z(&h, turn_cos, -turn_sin);
        heap_add(&h, &from_after);

        struct place p = { { 0 }, { 0, -a.twist_sin, a.twist_cos } };
        p.r[0] = a.before_cos * j->trans_m[0] + a.before_sin * j->trans_m[1];
        p.r[1] = a.before_cos * j->trans_m[1] - a.before_sin * j->trans_m[0] + shift * p.up[1];
        p.r[2] = j->trans_m[2] + shift * p.up[2];
        b->offset_rad = a.after_rad + turn_rad;
        b->twist_cos = a.twist_cos;
        b->twist_sin = a.twist_sin;
        b->x_m = p.r[0];
        b->y_m = p.r[1];
        shift = p.r[2]; /* the frame before moves along its axis to here; the base cannot */
        if (i > 0)
            p.r[2] = 0;
        from_after = axis_part(&h, &p);
        body_store(b, &h);
        turn_cos = a.before_cos;
        turn_sin = a.before_sin;
        turn_rad = a.before_rad;
    }
    const double *g = m->gravity_mps2, *f = from_after.first;
    c->gravity_mps2[0] = turn_cos * g[0] + turn_sin * g[1];
    c->gravity_mps2[1] = turn_cos * g[1] - turn_sin * g[0];
    c->gravity_mps2[2] = g[2];
    c->base_j = -(c->gravity_mps2[0] * f[0] + c->gravity_mps2[1] * f[1] + c->gravity_mps2[2] * f[2]);
}

/* ---- turning between neighbours ---- */

/* Cosine and sine of joint angle and twist, in an order that keeps the compiler from loading as a
 * pair what libm has just stored one by one (a stall of 30 ns in 7 joints). */
struct turn { double c, ct, s, st; };

/* A vector of the frame before, in the frame of the body. */
static inline void turn_in(const struct turn *t, double *v)
{
    double y = t->ct * v[1] + t->st * v[2], x = v[0];
    v[2] = t->ct * v[2] - t->st * v[1];
    v[0] = t->c * x + t->s * y;
    v[1] = t->c * y - t->s * x;
}

/* A vector of the body, in the frame before. */
static inline void turn_out(const struct turn *t, double *v)
{
    double x = t->c * v[0] - t->s * v[1], y = t->s * v[0] + t->c * v[1], z = v[2];
    v[0] = x;
    v[1] = t->ct * y - t->st * z;
    v[2] = t->st * y + t->ct * z;
}

static void turns_prepare(const struct plant_chain *c, const double *q_rad, struct turn *turn)
{
    for (int i = 0; i < c->joints; i++) {
        const struct plant_body *b = &c->body[i];
        double angle_rad = q_rad[i] + b->offset_rad;
        turn[i].s = sin(angle_rad);
        turn[i].c = cos(angle_rad);
        turn[i].ct = b->twist_cos;
        turn[i].st = b->twist_sin;
    }
}

/* ---- motion outwards ---- */

/* Of one body: angular speed; acceleration of its origin, gravity as an upward one; and U, which
 * gives the acceleration of a point r beyond that of the origin as U r. */
struct motion { double w[3], alpha[3], acc[3], u[3][3]; };

/* From one body to the next; joints do not accelerate here. */
static inline void motion_next(const struct plant_body *b, const struct turn *t, double speed,
                               struct motion *v)
{
    for (int k = 0; k < 3; k++)
        v->acc[k] += v->u[k][0] * b->x_m + v->u[k][1] * b->y_m;
    turn_in(t, v->acc);
    turn_in(t, v->w);
    turn_in(t, v->alpha);
    v->alpha[0] += v->w[1] * speed;
    v->alpha[1] -= v->w[0] * speed;
    v->w[2] += speed;

    const double *w = v->w, *a = v->alpha;
    double xx = w[0] * w[0], yy = w[1] * w[1], zz = w[2] * w[2];
    double xy = w[0] * w[1], xz = w[0] * w[2], yz = w[1] * w[2];
    v->u[0][0] = -(yy + zz);
    v->u[1][1] = -(xx + zz);
    v->u[2][2] = -(xx + yy);
    v->u[0][1] = xy - a[2];
    v->u[1][0] = xy + a[2];
    v->u[0][2] = xz + a[1];
    v->u[2][0] = xz - a[1];
    v->u[1][2] = yz - a[0];
    v->u[2][1] = yz + a[0];
}

static inline void motion_of_base(const double *gravity, struct motion *v)
{
    for (int k = 0; k < 3; k++) {
        v->acc[k] = -gravity[k];
        v->w[k] = v->alpha[k] = v->u[k][0] = v->u[k][1] = 0;
    }
}

/* Wrenches on bodies, one column each, about the origin of the frame at hand.  Column j < joints:
 * momentum of the bodies from j on per speed of joint j; column `joints`: force and moment that the
 * motion takes.  One more, so that columns come in pairs. */
struct columns { double f[3][W + 2], n[3][W + 2]; };

static inline void columns_clear(struct columns *w, int joints)
{
    for (int axis = 0; axis < 3; axis++)
        for (int k = 0; k < joints + 2; k++)
            w->f[axis][k] = w->n[axis][k] = 0;
}

/* Force, and moment about the origin, that the motion of one body takes: U h, and h x a plus the
 * axial vector of U S, with h and S its first and second moments. */
static inline void wrench_of_motion(const struct plant_body *b, const struct motion *v, double *f,
                                    double *n)
{
    const double *h = b->moment_kgm, *s = b->second_kgm2;
    for (int k = 0; k < 3; k++)
        f[k] = v->u[k][0] * h[0] + v->u[k][1] * h[1];
    n[0] = h[1] * v->acc[2] + (v->u[2][0] * s[1] + v->u[2][1] * s[3] + v->u[2][2] * s[4])
           - (v->u[1][0] * s[2] + v->u[1][1] * s[4]);
    n[1] = (v->u[0][0] * s[2] + v->u[0][1] * s[4])
           - (v->u[2][0] * s[0] + v->u[2][1] * s[1] + v->u[2][2] * s[2]) - h[0] * v->acc[2];
    n[2] = (h[0] * v->acc[1] - h[1] * v->acc[0])
           + (v->u[1][0] * s[0] + v->u[1][1] * s[1] + v->u[1][2] * s[2])
           - (v->u[0][0] * s[1] + v->u[0][1] * s[3] + v->u[0][2] * s[4]);
}

/* ---- momentum inwards ---- */

/* Bodies from one on, as one, without mass (see struct plant_body). */
struct composite { double h[3], xx, xy, xz, yy, yz, zz; };

static inline void composite_add(struct composite *c, const struct plant_body *b)
{
    const double *s = b->second_kgm2;
    c->h[0] += b->moment_kgm[0];
    c->h[1] += b->moment_kgm[1];
    c->xx += s[0];
    c->xy += s[1];
    c->xz += s[2];
    c->yy += s[3];
    c->yz += s[4];
}

/* Into the frame before. */
static inline void composite_out(struct composite *c, const struct plant_body *b, const struct turn *t)
{
    double twice = t->s * (c->xx - c->yy) + 2 * t->c * c->xy, cross = t->c * twice - c->xy;
    double xx = c->xx - t->s * twice, yy = c->yy + t->s * twice;
    double xz = t->c * c->xz - t->s * c->yz, yz = t->s * c->xz + t->c * c->yz;
    twice = t->st * (yy - c->zz) + 2 * t->ct * yz;
    turn_out(t, c->h);
    double x = b->x_m, y = b->y_m, *h = c->h;
    c->xx = xx + 2 * x * h[0];
    c->xy = (t->ct * cross - t->st * xz) + (x * h[1] + y * h[0]);
    c->xz = (t->st * cross + t->ct * xz) + x * h[2];
    c->yy = (yy - t->st * twice) + 2 * y * h[1];
    c->yz = (t->ct * twice - yz) + y * h[2];
    c->zz += t->st * twice;
}

/* All columns from `from` to `to` into the frame before, two at a time so that the compiler puts
 * them side by side; one before and one after may go along. */
static inline void columns_out(struct columns *restrict w, int from, int to, const struct plant_body *b,
                               const struct turn *t)
{
    const double c = t->c, s = t->s, ct = t->ct, st = t->st, x = b->x_m, y = b->y_m;
    for (int first = from & ~1; first <= to; first += 2)
        for (int k = first; k < first + 2; k++) {
            double fx = c * w->f[0][k] - s * w->f[1][k], fq = s * w->f[0][k] + c * w->f[1][k];
            double nx = c * w->n[0][k] - s * w->n[1][k], nq = s * w->n[0][k] + c * w->n[1][k];
            double fy = ct * fq - st * w->f[2][k], fz = st * fq + ct * w->f[2][k];
            double ny = ct * nq - st * w->n[2][k], nz = st * nq + ct * w->n[2][k];
            w->f[0][k] = fx;
            w->f[1][k] = fy;
            w->f[2][k] = fz;
            w->n[0][k] = nx + y * fz;
            w->n[1][k] = ny - x * fz;
            w->n[2][k] = nz + (x * fy - y * fx);
        }
}

/* What column i starts with: momentum of the composite turning about its z at 1 rad/s. */
static inline void column_start(struct columns *w, int i, const struct composite *c)
{
    w->f[0][i] = -c->h[1];
    w->f[1][i] = c->h[0];
    w->f[2][i] = 0;
    w->n[0][i] = -c->xz;
    w->n[1][i] = -c->yz;
    w->n[2][i] = c->xx + c->yy;
}

void plant_chain_terms(const struct plant_chain *c, const double *q_rad, const double *qd_radps,
                       plant_matrix mass_kgm2, double *bias_nm)
{
    const int n = c->joints;
    struct turn turn[W];
    struct motion v;
    struct columns w;
    struct composite outer = { .zz = 0 };
    double force[W][3], moment[W][3];
    turns_prepare(c, q_rad, turn);
    columns_clear(&w, n);
    motion_of_base(c->gravity_mps2, &v);
    for (int i = 0; i < n; i++) {
        motion_next(&c->body[i], &turn[i], qd_radps[i], &v);
        wrench_of_motion(&c->body[i], &v, force[i], moment[i]);
    }
    for (int i = n - 1; i >= 0; i--) {
        composite_add(&outer, &c->body[i]);
        column_start(&w, i, &outer);
        for (int k = 0; k < 3; k++) {
            w.f[k][n] += force[i][k];
            w.n[k][n] += moment[i][k];
        }
        /* what a joint feels is the moment about its z */
        for (int k = i; k < n; k++)
            mass_kgm2[i * W + k] = mass_kgm2[k * W + i] = w.n[2][k];
        bias_nm[i] = w.n[2][n];
        composite_out(&outer, &c->body[i], &turn[i]);
        columns_out(&w, i, n, &c->body[i], &turn[i]);
    }
}

double plant_chain_height_j(const struct plant_chain *c, const double *q_rad)
{
    double energy = c->base_j, g[3];
    memcpy(g, c->gravity_mps2, sizeof g);
    struct turn turn[W];
    turns_prepare(c, q_rad, turn);
    for (int i = 0; i < c->joints; i++) {
        turn_in(&turn[i], g);
        energy -= g[0] * c->body[i].moment_kgm[0] + g[1] * c->body[i].moment_kgm[1];
    }
    return energy;
}

/* ---- linear equations ---- */

/* Sizes known to the compiler are worth it: loops laid out flat solve 7 equations in a third of the
 * time.  So each is written once, for any n, and called with the usual sizes as constants. */
#define FLAT _Pragma("GCC unroll 8")

/* Upper triangle: U of a = U' D U right of the diagonal, 1 / D on it. */
static inline int factor_n(const int n, const double *a, double *factor)
{
    FLAT for (int j = 0; j < n; j++)
        FLAT for (int i = j; i < n; i++)
            factor[j * W + i] = a[j * W + i];
    FLAT for (int j = 0; j < n; j++) {
        double *row = factor + j * W, pivot = row[j];
        if (!(pivot > 1e-12 * a[j * W + j] && pivot > 0))
            return -1;
        double inverse = 1 / pivot;
        FLAT for (int i = j + 1; i < n; i++) {
            double scaled = row[i] * inverse, *below = factor + i * W;
            FLAT for (int k = i; k < n; k++)
                below[k] -= scaled * row[k];
        }
        FLAT for (int i = j + 1; i < n; i++)
            row[i] *= inverse;
        row[j] = inverse;
    }
    return 0;
}

static inline void solve_n(const int n, const double *factor, const double *b, double *x)
{
    double y[W];
    FLAT for (int j = 0; j < n; j++)
        y[j] = b[j];
    FLAT for (int j = 0; j < n; j++)
        FLAT for (int i = j + 1; i < n; i++)
            y[i] -= factor[j * W + i] * y[j];
    FLAT for (int j = n - 1; j >= 0; j--) {
        double sum = y[j] * factor[j * W + j];
        FLAT for (int i = n - 1; i > j; i--)
            sum -= factor[j * W + i] * y[i];
        x[j] = y[j] = sum;
    }
}

int plant_factor(int n, const plant_matrix a, plant_matrix factor)
{
    return n == 6 ? factor_n(6, a, factor) : n == 7 ? factor_n(7, a, factor) : factor_n(n, a, factor);
}

void plant_solve(int n, const plant_matrix factor, const double *b, double *x)
{
    if (n == 6)
        solve_n(6, factor, b, x);
    else if (n == 7)
        solve_n(7, factor, b, x);
    else
        solve_n(n, factor, b, x);
}

int plant_invert(int n, const plant_matrix a, plant_matrix inverse)
{
    plant_matrix factor;
    if (plant_factor(n, a, factor) < 0)
        return -1;
    for (int i = 0; i < n; i++) {
        double unit[W] = { 0 }; /* rows and columns are the same, up to rounding */
        unit[i] = 1;
        plant_solve(n, factor, unit, inverse + i * W);
    }
    return 0;
}
