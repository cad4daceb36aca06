/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Gravity and inertia of the chain in fixed point.
 *
 * Owns: formats and bit growth of the recursions:
 *     g m/s^2 q24, h kg.m q20;  w rad/s q24, dw and U rad/s^2 q18, a m/s^2 q18, f N q16, n N.m q16.
 * All are 32 bits, sums of their products 64: two products of 32 bits with sine and cosine (q30) fit,
 * whatever the vectors.  hdt_tables_check takes only tables with which no vector can leave 32 bits
 * (chain_moves), so the one narrowing, low(), never changes a value.
 * Never: keeps state, divides.
 */
#include "ctrl/hdt_chain.h"

struct vec { int32_t x, y, z; };
struct sum { int64_t x, y, z; }; /* of products */

/* x modulo 2^32: x itself, of all that chain_moves bounds; no conversion is left to the compiler. */
static inline int32_t low(int64_t x)
{
    const uint32_t bits = (uint32_t)x;
    return bits <= INT32_MAX ? (int32_t)bits : -(int32_t)~bits - 1;
}

/* a * b + c * d and a * b - c * d, over 2^n */
static inline int32_t dot2(int64_t a, int64_t b, int64_t c, int64_t d, unsigned n)
{
    return low(hdt_shr(a * b + c * d, n));
}

static inline int64_t wide_cross2(int64_t a, int64_t b, int64_t c, int64_t d, unsigned n)
{
    return hdt_shr(a * b - c * d, n);
}

static inline int32_t cross2(int64_t a, int64_t b, int64_t c, int64_t d, unsigned n)
{
    return low(wide_cross2(a, b, c, d, n));
}

/* v += by */
static inline void plus(struct vec *v, const struct vec *by)
{
    v->x = low((int64_t)v->x + by->x);
    v->y = low((int64_t)v->y + by->y);
    v->z = low((int64_t)v->z + by->z);
}

/* v := Rz^T Rx^T v, from the previous link's axes to this link's; right: the twist is a quarter turn. */
static inline void turn_in(const struct hdt_joint_tab *tab, const struct hdt_motion *m, struct vec *v)
{
    const int right = (tab->chain & HDT_CHAIN_RIGHT) != 0;
    const int32_t c = m->cos_q30, s = m->sin_q30, x = v->x;
    const int32_t y = right ? v->z : dot2(tab->twist_cos_q30, v->y, tab->twist_sin_q30, v->z, 30);

    v->z = right ? low(-(int64_t)v->y) : cross2(tab->twist_cos_q30, v->z, tab->twist_sin_q30, v->y, 30);
    v->x = dot2(c, x, s, y, 30);
    v->y = cross2(c, y, s, x, 30);
}

/* v := Rx Rz v, from this link's axes to the previous link's. */
static inline void turn_out(const struct hdt_joint_tab *tab, const struct hdt_motion *m, struct vec *v)
{
    const int right = (tab->chain & HDT_CHAIN_RIGHT) != 0;
    const int32_t c = m->cos_q30, s = m->sin_q30, z = v->z;
    const int32_t x = cross2(c, v->x, s, v->y, 30), y = dot2(s, v->x, c, v->y, 30);

    v->x = x;
    v->y = right ? low(-(int64_t)z) : cross2(tab->twist_cos_q30, y, tab->twist_sin_q30, z, 30);
    v->z = right ? y : dot2(tab->twist_sin_q30, y, tab->twist_cos_q30, z, 30);
}

/* ---- gravity ---- */

void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    int32_t gx[HDT_JOINTS_MAX], gy[HDT_JOINTS_MAX];
    struct vec g = {t->gravity_q24[0], t->gravity_q24[1], t->gravity_q24[2]}, h = {0, 0, 0};

    /* gravity out to the links */
    for (uint32_t j = 0; j < t->joints; j++) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        turn_in(tab, &m[j], &g);
        gx[j] = g.x;
        gy[j] = g.y;
    }

    /* first moments back to the base; q20 * q24 = q44 -> q16 */
    for (uint32_t j = t->joints; j-- > 0;) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        h.x = low((int64_t)h.x + tab->moment_q20[0]);
        h.y = low((int64_t)h.y + tab->moment_q20[1]);
        tau_q16[j] = (int32_t)hdt_within(wide_cross2(h.y, gx[j], h.x, gy[j], 28), HDT_GRAVITY_MAX_Q16);
        turn_out(tab, &m[j], &h);
    }
}

/* ---- inertia ---- */

/* Motion of one link, in its own axes. */
struct link_motion {
    struct vec w, dw; /* rad/s q24, rad/s^2 q18          */
    struct vec a;     /* m/s^2 q18, of the link's origin */
    /* columns x and y of U, rad/s^2 q18; moments and steps have no z */
    struct vec ux, uy;
};

/* Force and moment about its origin that a link's motion takes. */
struct wrench { struct vec f, n; };

/* a^2 + b^2, q24 -> q18.  Overflow: 2^63, hence without a sign. */
static inline int64_t squares(int64_t a, int64_t b)
{
    return (int64_t)(((uint64_t)(a * a) + (uint64_t)(b * b) + ((uint64_t)1 << 29)) >> 30);
}

/* The columns of U: w w^T - |w|^2 + [dw]x. */
static inline void columns(struct link_motion *k)
{
    const int64_t x = k->w.x, y = k->w.y, z = k->w.z, xy = hdt_shr(x * y, 30);

    k->ux.x = low(-squares(y, z));
    k->ux.y = low(xy + k->dw.z);
    k->ux.z = low(hdt_shr(x * z, 30) - k->dw.y);
    k->uy.x = low(xy - k->dw.z);
    k->uy.y = low(-squares(x, z));
    k->uy.z = low(hdt_shr(y * z, 30) + k->dw.x);
}

/* Motion of the previous link to motion of this one. */
static inline void next_link(const struct hdt_joint_tab *tab, const struct hdt_motion *m,
                             struct link_motion *k)
{
    const int64_t v = m->v_ref_q24;

    if (tab->chain & HDT_CHAIN_FAR) {
        if (tab->chain & HDT_CHAIN_STEP) {
            const int64_t px = tab->step_q24[0], py = tab->step_q24[1];
            const struct vec step = {dot2(k->ux.x, px, k->uy.x, py, 24), dot2(k->ux.y, px, k->uy.y, py, 24),
                                     dot2(k->ux.z, px, k->uy.z, py, 24)};
            plus(&k->a, &step);
        }
        turn_in(tab, m, &k->a);
    }
    turn_in(tab, m, &k->w);
    turn_in(tab, m, &k->dw);

    /* the joint's own turning: w += z v, dw += z a + w x z v;  q24 * q24 -> q18 */
    k->dw.x = low(k->dw.x + hdt_shr(k->w.y * v, 30));
    k->dw.y = low(k->dw.y - hdt_shr(k->w.x * v, 30));
    k->dw.z = low(k->dw.z + m->a_ref_q16 * (int64_t)4);
    k->w.z = low(k->w.z + v);
    columns(k);
}

/* What products of inertia add to the moment, q38. */
static void skew_moment(const struct hdt_joint_tab *tab, const struct link_motion *k, struct sum *n)
{
    const int64_t xy = tab->second_q20[1], xz = tab->second_q20[2], yz = tab->second_q20[4];
    const int64_t uxx = k->ux.x, uyy = k->uy.y, uzz = low(-squares(k->w.x, k->w.y));
    const int32_t uxz = low(k->ux.z + 2 * (int64_t)k->dw.y), uyz = low(k->uy.z - 2 * (int64_t)k->dw.x);

    n->x += k->ux.z * xy - k->ux.y * xz + (uzz - uyy) * yz;
    n->y += k->uy.x * yz - k->uy.z * xy + (uxx - uzz) * xz;
    n->z += uyz * xz - uxz * yz + (uyy - uxx) * xy;
}

/* q18 * q20 -> q16 */
static inline void link_wrench(const struct hdt_joint_tab *tab, const struct link_motion *k,
                               struct wrench *out)
{
    const int64_t sx = tab->moment_q20[0], sy = tab->moment_q20[1];
    const int64_t xx = tab->second_q20[0], yy = tab->second_q20[3];
    struct sum n = {k->uy.z * yy, -(k->ux.z * xx), k->ux.y * xx - k->uy.x * yy};

    if (tab->chain & HDT_CHAIN_SKEW)
        skew_moment(tab, k, &n);
    if (tab->chain & HDT_CHAIN_FAR) {
        out->f.x = dot2(k->ux.x, sx, k->uy.x, sy, 22);
        out->f.y = dot2(k->ux.y, sx, k->uy.y, sy, 22);
        out->f.z = dot2(k->ux.z, sx, k->uy.z, sy, 22);
        n.x += sy * k->a.z;
        n.y -= sx * k->a.z;
        n.z += sx * k->a.y - sy * k->a.x;
    } else {
        out->f = (struct vec){0, 0, 0};
    }
    out->n.x = low(hdt_shr(n.x, 22));
    out->n.y = low(hdt_shr(n.y, 22));
    out->n.z = low(hdt_shr(n.z, 22));
}

/* Wrench of this and all later links to the axes and origin of the link before. */
static inline void previous_link(const struct hdt_joint_tab *tab, const struct hdt_motion *m, struct vec *f,
                                 struct vec *n)
{
    turn_out(tab, m, n);
    if (tab->chain & HDT_CHAIN_FAR)
        turn_out(tab, m, f);
    if (tab->chain & HDT_CHAIN_STEP) {
        const int64_t px = tab->step_q24[0], py = tab->step_q24[1];
        n->x = low(n->x + hdt_shr(py * f->z, 24));
        n->y = low(n->y - hdt_shr(px * f->z, 24));
        n->z = low(n->z + wide_cross2(px, f->y, py, f->x, 24));
    }
}

void hdt_chain_inertia(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    struct wrench link[HDT_JOINTS_MAX];
    struct vec f = {0, 0, 0}, n = {0, 0, 0}; /* of all links from j on, about the origin of j */

    /* the first link only turns about its own axis */
    struct link_motion k = {{0, 0, m[0].v_ref_q24}, {0, 0, low(m[0].a_ref_q16 * (int64_t)4)},
                            {0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    columns(&k);

    /* motion out to the links */
    for (uint32_t j = 1; j < t->joints; j++) {
        next_link(&t->joint[j], &m[j], &k);
        link_wrench(&t->joint[j], &k, &link[j]);
    }

    /* force and moment back to the base */
    for (uint32_t j = t->joints; j-- > 1;) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        plus(&n, &link[j].n);
        tau_q16[j] = hdt_sat(n.z);
        if (tab->chain & HDT_CHAIN_FAR)
            plus(&f, &link[j].f);
        previous_link(tab, &m[j], &f, &n);
    }

    /* q16 * q20 -> q16 */
    const int64_t polar_q20 = (int64_t)t->joint[0].second_q20[0] + t->joint[0].second_q20[3];
    tau_q16[0] = hdt_sat(n.z + hdt_shr(m[0].a_ref_q16 * polar_q20, 20));
}
