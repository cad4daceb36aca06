/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Gravity and inertia of the chain in fixed point.
 *
 * Owns: formats and bit growth of the recursions.  A vector is three int64 whose values stay below
 * 2^31, so that a product of two is below 2^62 and a difference of two products below 2^63.
 * Never: keeps state, divides.
 */
#include "ctrl/hdt_chain.h"

/* out := Rz(q)^T rot^T v: from the previous link's axes to this link's.
 * |v| < 2^31 as a vector and a rotation: each sum below 2^61 */
static void to_link(const int32_t rot[9], const struct hdt_motion *m, const int64_t v[3], int64_t out[3])
{
    const int64_t x = hdt_shr(rot[0] * v[0] + rot[3] * v[1] + rot[6] * v[2], 30);
    const int64_t y = hdt_shr(rot[1] * v[0] + rot[4] * v[1] + rot[7] * v[2], 30);
    out[2] = hdt_shr(rot[2] * v[0] + rot[5] * v[1] + rot[8] * v[2], 30);
    out[0] = hdt_shr(m->cos_q30 * x + m->sin_q30 * y, 30);
    out[1] = hdt_shr(m->cos_q30 * y - m->sin_q30 * x, 30);
}

/* out := rot Rz(q) v: from this link's axes to the previous link's. */
static void from_link(const int32_t rot[9], const struct hdt_motion *m, const int64_t v[3], int64_t out[3])
{
    const int64_t x = hdt_shr(m->cos_q30 * v[0] - m->sin_q30 * v[1], 30);
    const int64_t y = hdt_shr(m->sin_q30 * v[0] + m->cos_q30 * v[1], 30);
    out[0] = hdt_shr(rot[0] * x + rot[1] * y + rot[2] * v[2], 30);
    out[1] = hdt_shr(rot[3] * x + rot[4] * y + rot[5] * v[2], 30);
    out[2] = hdt_shr(rot[6] * x + rot[7] * y + rot[8] * v[2], 30);
}

void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    int64_t g[HDT_JOINTS_MAX + 1][3]; /* m/s^2 q24; [0] base, [j+1] link j */
    int64_t h[3] = {0, 0, 0};         /* kg.m q20, of the links after j, in the axes of link j */

    /* gravity out to the links */
    for (int i = 0; i < 3; i++)
        g[0][i] = t->gravity_q24[i];
    for (uint32_t j = 0; j < t->joints; j++)
        to_link(t->joint[j].rot_q30, &m[j], g[j], g[j + 1]);

    /* first moments back to the base; 2 * 2^31 * 2^30, q20 * q24 = q44 -> q16 */
    for (uint32_t j = t->joints; j-- > 0;) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        for (int i = 0; i < 3; i++)
            h[i] += tab->hold_moment_q20[i];
        tau_q16[j] = hdt_sat(hdt_shr(h[1] * g[j + 1][0] - h[0] * g[j + 1][1], 28));
        from_link(tab->rot_q30, &m[j], h, h);
    }
}

static void clamp(int64_t v[3])
{
    for (int i = 0; i < 3; i++)
        v[i] = hdt_sat(v[i]);
}

/* out := a x b / 2^n; |a|, |b| < 2^31.  out may not be a or b. */
static void cross(const int64_t a[3], const int64_t b[3], unsigned n, int64_t out[3])
{
    out[0] = hdt_shr(a[1] * b[2] - a[2] * b[1], n);
    out[1] = hdt_shr(a[2] * b[0] - a[0] * b[2], n);
    out[2] = hdt_shr(a[0] * b[1] - a[1] * b[0], n);
}

/* out := inertia v / 2^24; |inertia| < 2^29 (hdt_tables_check), so each sum is below 2^62 */
static void inertia_times(const int32_t i[6], const int64_t v[3], int64_t out[3])
{
    out[0] = hdt_shr(i[0] * v[0] + i[1] * v[1] + i[2] * v[2], 24);
    out[1] = hdt_shr(i[1] * v[0] + i[3] * v[1] + i[4] * v[2], 24);
    out[2] = hdt_shr(i[2] * v[0] + i[4] * v[1] + i[5] * v[2], 24);
}

static void widen(const int32_t in[3], int64_t out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = in[i];
}

/* Motion of one link, in its own axes. */
struct link_motion {
    int64_t w[3];  /* rad/s q24                      */
    int64_t dw[3]; /* rad/s^2 q20                    */
    int64_t a[3];  /* m/s^2 q20, of the joint origin */
};

/* Force N q16 and moment about the joint origin N.m q16 that a link's motion takes. */
static void link_wrench(const struct hdt_joint_tab *tab, const struct link_motion *k, int64_t f[3],
                        int64_t n[3])
{
    int64_t s[3], u[3], part[3];
    widen(tab->moment_q20, s);

    /* f = m a + dw x s + w x (w x s);  q20 * q20 -> q16, q24 * q20 -> q20, q24 * q20 -> q16 */
    cross(k->w, s, 24, u);
    clamp(u);
    cross(k->w, u, 28, f);
    cross(k->dw, s, 24, part);
    for (int i = 0; i < 3; i++)
        f[i] += part[i] + hdt_shr(tab->mass_q20 * k->a[i], 24);

    /* n = I dw + w x (I w) + s x a */
    inertia_times(tab->inertia_q20, k->w, u);
    clamp(u);
    cross(k->w, u, 28, n);
    cross(s, k->a, 24, part);
    for (int i = 0; i < 3; i++)
        n[i] += part[i];
    inertia_times(tab->inertia_q20, k->dw, part);
    for (int i = 0; i < 3; i++)
        n[i] += part[i];
}

/* Motion of the previous link to motion of this one. */
static void next_link(const struct hdt_joint_tab *tab, const struct hdt_motion *m, struct link_motion *k)
{
    int64_t p[3], u[3], part[3];
    widen(tab->trans_q24, p);

    /* the joint origin: a + dw x p + w x (w x p), in the previous axes */
    cross(k->w, p, 28, u);
    clamp(u);
    cross(k->w, u, 24, part);
    for (int i = 0; i < 3; i++)
        k->a[i] += part[i];
    cross(k->dw, p, 24, part);
    for (int i = 0; i < 3; i++)
        k->a[i] += part[i];
    clamp(k->a);
    to_link(tab->rot_q30, m, k->a, k->a);
    to_link(tab->rot_q30, m, k->w, k->w);
    to_link(tab->rot_q30, m, k->dw, k->dw);
    clamp(k->w);

    /* the joint's own turning: w += z v, dw += z a + w x z v */
    k->dw[0] += hdt_shr(k->w[1] * m->v_ref_q24, 28);
    k->dw[1] -= hdt_shr(k->w[0] * m->v_ref_q24, 28);
    k->dw[2] += (int64_t)m->a_ref_q16 * 16;
    k->w[2] += m->v_ref_q24;
    clamp(k->w);
    clamp(k->dw);
    clamp(k->a);
}

void hdt_chain_inertia(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    int64_t f[HDT_JOINTS_MAX][3], n[HDT_JOINTS_MAX][3];
    int64_t fs[3] = {0, 0, 0}, ns[3] = {0, 0, 0}; /* of all links from j on, about joint j */
    struct link_motion k = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};

    /* motion out to the links */
    for (uint32_t j = 0; j < t->joints; j++) {
        next_link(&t->joint[j], &m[j], &k);
        link_wrench(&t->joint[j], &k, f[j], n[j]);
    }

    /* force and moment back to the base */
    for (uint32_t j = t->joints; j-- > 0;) {
        int64_t p[3], part[3];
        for (int i = 0; i < 3; i++) {
            fs[i] += f[j][i];
            ns[i] += n[j][i];
        }
        clamp(fs);
        clamp(ns);
        tau_q16[j] = (int32_t)ns[2];

        /* to the previous link's axes and origin */
        widen(t->joint[j].trans_q24, p);
        from_link(t->joint[j].rot_q30, &m[j], fs, fs);
        from_link(t->joint[j].rot_q30, &m[j], ns, ns);
        clamp(fs);
        cross(p, fs, 24, part);
        for (int i = 0; i < 3; i++)
            ns[i] += part[i];
    }
}
