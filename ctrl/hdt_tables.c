/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Tables: the acceptance check, and the .hdtm image by one list of fields for both directions.
 *
 * Owns: what the core accepts, the byte order, the CRC.
 * Never: believes an image: nothing is used before length, CRC and every value are checked.
 */
#include "ctrl/hdt_tables.h"

#define WHOLE_TURN ((uint64_t)1 << 56) /* phase units q24 */
#define NO_LIMIT INT32_MAX             /* -2^31 alone is refused: negating it would overflow */

/* Members that are one or more int32, or uint32 below 2^31, with the range each value may have. */
struct range {
    const char *name;
    size_t at, count;
    int32_t lo, hi;
};
#define RANGE(owner, member, low, high) \
    {#member, offsetof(struct owner, member), sizeof(((struct owner *)NULL)->member) / 4, low, high}

static const struct range head_ranges[] = {
    RANGE(hdt_tables, joints, 1, HDT_JOINTS_MAX),
    RANGE(hdt_tables, period_ns, 31000, 1000000000),
    RANGE(hdt_tables, rate_q16, 1, NO_LIMIT),
    RANGE(hdt_tables, stale_periods, 1, 1000000),
    /* a vector turned stays below 2^31 */
    RANGE(hdt_tables, gravity_q24, -(1 << 30), 1 << 30),
    RANGE(hdt_tables, biquad_q28, -(1 << 30), 1 << 30),
    RANGE(hdt_tables, observer, 0, (1 << HDT_OBSERVED) - 1),
    RANGE(hdt_tables, observer_gain, 0, 1 << 30),
};

static const struct range joint_ranges[] = {
    RANGE(hdt_joint_tab, terms, 0, (1 << HDT_TERMS) - 1),
    RANGE(hdt_joint_tab, sign, -1, 1),
    RANGE(hdt_joint_tab, zero_cnt, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, twist_cos_q30, -(1 << 30), 1 << 30),
    RANGE(hdt_joint_tab, twist_sin_q30, -(1 << 30), 1 << 30),
    RANGE(hdt_joint_tab, step_q24, -NO_LIMIT, NO_LIMIT),
    /* 500 kg.m, 500 kg.m^2: six products with the one and two with the other stay below 2^63 */
    RANGE(hdt_joint_tab, moment_q20, -(500 << 20), 500 << 20),
    RANGE(hdt_joint_tab, second_q20, -(500 << 20), 500 << 20),
    RANGE(hdt_joint_tab, rotor_q20, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, v_lim_q24, 1, 1 << 30),
    RANGE(hdt_joint_tab, a_lim_q16, 1, 1 << 30),
    RANGE(hdt_joint_tab, v_ramp_inv_q16, 1, NO_LIMIT),
    RANGE(hdt_joint_tab, friction_shift, 1, 23),
    /* a rise times a speed stays below 2^62 */
    RANGE(hdt_joint_tab, friction_q16, -(1 << 30), 1 << 30),
    RANGE(hdt_joint_tab, stiffness, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, windup_inv_q8, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, lines, 0, HDT_LINES_MAX),
    RANGE(hdt_joint_tab, load_mu_q24, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, cold_coulomb_q16, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, cold_viscous_q16, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, cold_decay_q31, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, presliding_q16, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, presliding_inv_q8, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, spring_q16, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, spring_q0_q24, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, offset_q16, -NO_LIMIT, NO_LIMIT),
    /* times a difference of two int32 */
    RANGE(hdt_joint_tab, kp_q16, 0, 1 << 30),
    RANGE(hdt_joint_tab, kd_q16, 0, 1 << 30),
    RANGE(hdt_joint_tab, inertia_inv_q20, 0, 1 << 30),
    RANGE(hdt_joint_tab, nm_per_digit_q24, 0, 1 << 30),
    RANGE(hdt_joint_tab, digit_per_nm_q24, 1, NO_LIMIT),
    RANGE(hdt_joint_tab, dig_max, 1, 32767),
    RANGE(hdt_joint_tab, dig_slew, 1, 65535),
    RANGE(hdt_joint_tab, spd_max, 0, 32767),
    RANGE(hdt_joint_tab, q_min_q24, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, q_max_q24, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_joint_tab, v_max_q24, 1, NO_LIMIT),
    RANGE(hdt_joint_tab, follow_max_q24, 0, NO_LIMIT),
    RANGE(hdt_joint_tab, axis, 0, HDT_AXES - 1),
    RANGE(hdt_joint_tab, directed, 0, 1),
};

static const struct range line_ranges[] = {
    RANGE(hdt_line_tab, amplitude_q16, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_line_tab, directed, 0, 1),
};

static const struct range curve_ranges[] = {
    RANGE(hdt_curve_tab, start, -NO_LIMIT, NO_LIMIT),
    RANGE(hdt_curve_tab, shift, 1, 23),
};

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static int64_t magnitude(int64_t x)
{
    return x < 0 ? -x : x;
}

/* Name of the first member out of range, or NULL. */
static const char *out_of_range(const void *owner, const struct range *list, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const int32_t *value = (const int32_t *)(const void *)((const char *)owner + list[i].at);
        for (size_t k = 0; k < list[i].count; k++)
            if (value[k] < list[i].lo || value[k] > list[i].hi)
                return list[i].name;
    }
    return NULL;
}

/* A low-pass whose output for a constant is that constant, stable, and not alternating: then no
 * filter sum can wrap (hdt_vel.h). */
static int biquad_ok(const int32_t b[5])
{
    const int64_t one = (int64_t)1 << 28;
    const int64_t in = (int64_t)b[0] + b[1] + b[2], back = one + b[3] + b[4];
    return b[0] >= 0 && b[1] >= 0 && b[2] >= 0 && magnitude(b[4]) < one &&
           magnitude(b[3]) < one + b[4] && magnitude(in - back) <= 4;
}

/* Cosine and sine of one angle, within 1e-6. */
static int twist_ok(const struct hdt_joint_tab *j)
{
    const int64_t one = (int64_t)1 << 60, tolerance = one / 1000000;
    const int64_t c = j->twist_cos_q30, s = j->twist_sin_q30;
    return magnitude(c * c + s * s - one) <= tolerance;
}

/* What the chain flags of joint `at` must be; far_before: those of the joint before say FAR. */
static uint32_t chain_flags(const struct hdt_joint_tab *j, uint32_t at, int far_before)
{
    const int step = at > 0 && (j->step_q24[0] != 0 || j->step_q24[1] != 0);
    const int skew = j->second_q20[1] != 0 || j->second_q20[2] != 0 || j->second_q20[4] != 0;
    const int right = j->twist_cos_q30 == 0 && j->twist_sin_q30 == (int32_t)1 << 30;
    return (right ? HDT_CHAIN_RIGHT : 0u) | (step ? HDT_CHAIN_STEP : 0u) |
           (step || far_before ? HDT_CHAIN_FAR : 0u) | (skew ? HDT_CHAIN_SKEW : 0u);
}

/* Angle per count and phase per count say the same ratio.  Velocity per count fits its format at any rate:
 * 2^32 (q44) * 2^31 (q16) is below 2^35 in q32. */
static const char *scaling(const struct hdt_joint_tab *j)
{
    if (j->rad_per_count_q44 == 0)
        return "rad_per_count_q44";
    /* q44 rad = 2 pi * 2^-12 phase units q24; 2^50 * 2^23 would not fit, hence the first test */
    if (j->phase_per_count_q24 >= (uint64_t)1 << 42)
        return "phase_per_count_q24";
    const int64_t by_angle = (int64_t)((uint64_t)j->rad_per_count_q44 << 12);
    const int64_t by_phase = (int64_t)((j->phase_per_count_q24 * 1647099u) >> 18);
    if (magnitude(by_angle - by_phase) > (by_angle >> 17) + 65536)
        return "phase_per_count_q24";
    return NULL;
}

/* a * b / 2^n of values >= 0, rounded up; a product of more than 2^62 counts as 2^62. */
static int64_t bound(int64_t a, int64_t b, unsigned n)
{
    const int64_t most = (int64_t)1 << 62;
    /* modulo 2^64; its own comparison is for the proof, which does not see through the division */
    const uint64_t product = (uint64_t)a * (uint64_t)b;
    if (product > (uint64_t)most || (a != 0 && b > most / a))
        return (most >> n) + 1;
    return (int64_t)(product >> n) + 1;
}

/* Friction between the knots and on beyond the last one, up to the speed the terms follow. */
static int friction_ok(const struct hdt_joint_tab *j)
{
    const int64_t past = j->v_lim_q24 - ((int64_t)(HDT_FRICTION_KNOTS - 2) << j->friction_shift);
    for (int way = 0; way < 2; way++) {
        const int32_t *last = &j->friction_q16[way][HDT_FRICTION_KNOTS - 2];
        const int64_t rise = magnitude((int64_t)last[1] - last[0]);
        if (past > 0 && magnitude(last[0]) + bound(rise, past, j->friction_shift) >= INT32_MAX)
            return 0;
    }
    return 1;
}

/* Name of the first wrong member of a joint, or NULL. */
static const char *joint_wrong(const struct hdt_joint_tab *j)
{
    const char *name = out_of_range(j, joint_ranges, COUNT(joint_ranges));
    if (name != NULL)
        return name;
    if (j->sign == 0)
        return "sign";
    if ((name = scaling(j)) != NULL)
        return name;
    if (!twist_ok(j))
        return "twist_cos_q30";
    if (!friction_ok(j))
        return "friction_q16";
    if (j->stiffness[0].t1_q16 > j->stiffness[0].t2_q16 || j->stiffness[1].t1_q16 > j->stiffness[1].t2_q16)
        return "stiffness";
    for (uint32_t k = 0; k < j->lines; k++) {
        if ((name = out_of_range(&j->line[k], line_ranges, COUNT(line_ranges))) != NULL)
            return name;
        if (j->line[k].phase_per_count_q24 >= WHOLE_TURN)
            return "line.phase_per_count_q24";
    }
    const struct hdt_curve_tab *const curve[] = {&j->local[0], &j->local[1], &j->table};
    for (size_t k = 0; k < COUNT(curve); k++)
        if ((name = out_of_range(curve[k], curve_ranges, COUNT(curve_ranges))) != NULL)
            return name;
    if (j->q_min_q24 >= j->q_max_q24)
        return "q_min_q24";
    return NULL;
}

/* Name of the first wrong member outside the joints, or NULL.  *err is set with it. */
static const char *head_wrong(const struct hdt_tables *t, int *err)
{
    *err = HDT_TABLES_NOT_OURS;
    if (t->magic != HDT_TABLES_MAGIC)
        return "magic";
    *err = HDT_TABLES_VERSION;
    if (t->layout != HDT_TABLES_LAYOUT)
        return "layout";
    *err = HDT_TABLES_RANGE;
    const char *name = out_of_range(t, head_ranges, COUNT(head_ranges));
    if (name != NULL)
        return name;
    if (t->name[sizeof t->name - 1] != 0)
        return "name";
    /* period times rate is one second, to 1e-4 */
    const int64_t second = (int64_t)65536 * 1000000000;
    if (magnitude((int64_t)t->period_ns * t->rate_q16 - second) > second / 10000)
        return "rate_q16";
    if (!biquad_ok(t->biquad_q28))
        return "biquad_q28";
    return NULL;
}

static int wrong(const char *name, int at, int err, const char **where, int *joint)
{
    if (where != NULL)
        *where = name;
    if (joint != NULL)
        *joint = at;
    return err;
}

/* How fast links can move and how much they can weigh, gathered from the base outwards.  All are
 * sums of lengths, so no order of additions and no turning can exceed them. */
struct reach {
    int64_t w_q24, dw_q18, u_q18, a_q18; /* |w|, |dw|, |U|, |a|                        */
    int64_t moment_q20, gravity_q24;     /* all first moments; g                       */
    int64_t step_q24;                    /* way from the base                          */
    int64_t f_q16, n_q16;                /* all forces; all moments about the base     */
};

/* Length of (x, y), at most a tenth too long: the longer plus 27/64 (over sqrt(2) - 1) of the shorter. */
static int64_t length(const int32_t v[2])
{
    const int64_t x = magnitude(v[0]), y = magnitude(v[1]);
    return x > y ? x + bound(y, 27, 6) : y + bound(x, 27, 6);
}

/* One link further.  Name of the member that lets a vector of the chain leave 32 bits, or NULL. */
static const char *chain_moves(const struct hdt_joint_tab *j, struct reach *r)
{
    const int64_t vector = (int64_t)31 << 26; /* of 2^31: turning and rounding add less than a thousandth */
    const int64_t moment = length(j->moment_q20), step = length(j->step_q24);
    int64_t second = 0;
    for (int i = 0; i < 5; i++)
        second += magnitude(j->second_q20[i]);

    /* h, and g . h */
    r->moment_q20 += moment;
    if (r->moment_q20 >= (int64_t)1 << 30 || bound(r->moment_q20, r->gravity_q24, 28) > HDT_GRAVITY_MAX_Q16)
        return "moment_q20";

    /* the origin moves with the link before */
    r->a_q18 += bound(r->u_q18, step, 24);
    r->step_q24 += step;
    if (r->a_q18 >= vector)
        return "step_q24";

    /* |w| up to 60 rad/s; |dw| <= that before + a + |w before| v, |U| <= |dw| + w^2 */
    r->dw_q18 += (int64_t)j->a_lim_q16 * 4 + bound(r->w_q24, j->v_lim_q24, 30);
    r->w_q24 += j->v_lim_q24;
    if (r->w_q24 > (int64_t)60 << 24)
        return "v_lim_q24";
    r->u_q18 = r->dw_q18 + bound(r->w_q24, r->w_q24, 30);
    if (r->u_q18 >= vector)
        return "a_lim_q16";

    /* force and moment this link takes, and what its force makes of the way to the base; as the matrix of
     * inertia (yy -xy -xz; -xy xx -yz; -xz -yz xx+yy) has no row above `second`, it makes no vector longer */
    const int64_t f = bound(r->u_q18, moment, 22);
    r->f_q16 += f;
    r->n_q16 += bound(r->u_q18, second, 22) + bound(r->a_q18, moment, 22) + bound(f, r->step_q24, 24);
    return r->f_q16 >= vector || r->n_q16 >= vector ? "second_q20" : NULL;
}

/* Wind-up: no line leaves the format at any load. */
static int stiffness_ok(const struct hdt_joint_tab *j, int64_t gravity_q16)
{
    const int64_t load = gravity_q16 + (j->terms >> HDT_TERM_SPRING & 1u ? HDT_SPRING_MAX_Q16 : 0);
    if (!(j->terms >> HDT_TERM_STIFFNESS & 1u))
        return 1;
    for (int way = 0; way < 2; way++)
        for (int i = 0; i < 3; i++)
            if (magnitude(j->stiffness[way].intercept_q16[i]) +
                    bound(magnitude(j->stiffness[way].slope_q24[i]), load, 24) >= INT32_MAX)
                return 0;
    return 1;
}

/* Name of the first wrong member of the joints, or NULL.  *at says which joint. */
static const char *joints_wrong(const struct hdt_tables *t, uint32_t *at)
{
    struct reach reach = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    int far_off = 0;
    for (int i = 0; i < 3; i++)
        reach.gravity_q24 += magnitude(t->gravity_q24[i]);
    for (uint32_t j = 0; j < t->joints; j++) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        const char *name = joint_wrong(tab);
        *at = j;
        if (name != NULL)
            return name;
        if (tab->chain != chain_flags(tab, j, far_off))
            return "chain";
        far_off = (tab->chain & HDT_CHAIN_FAR) != 0;
        if ((name = chain_moves(tab, &reach)) != NULL)
            return name;
    }
    const int64_t gravity_q16 = bound(reach.moment_q20, reach.gravity_q24, 28);
    for (uint32_t j = 0; j < t->joints; j++) {
        *at = j;
        if (!stiffness_ok(&t->joint[j], gravity_q16))
            return "stiffness";
    }
    return NULL;
}

int hdt_tables_check(const struct hdt_tables *t, const char **where, int *joint)
{
    int err;
    uint32_t at = 0;
    const char *name = head_wrong(t, &err);
    if (name != NULL)
        return wrong(name, -1, err, where, joint);
    name = joints_wrong(t, &at);
    if (name != NULL)
        return wrong(name, (int)at, HDT_TABLES_RANGE, where, joint);
    return HDT_TABLES_OK;
}

/* One member of a struct in the image: `count` little-endian values of `width` bytes. */
struct field {
    size_t at, width, count;
};
#define FIELD(owner, member, bytes) \
    {offsetof(struct owner, member), bytes, sizeof(((struct owner *)NULL)->member) / (bytes)}

static const struct field head_fields[] = {
    FIELD(hdt_tables, magic, 4),       FIELD(hdt_tables, layout, 4),
    FIELD(hdt_tables, digest, 1),      FIELD(hdt_tables, name, 1),
    FIELD(hdt_tables, joints, 4),      FIELD(hdt_tables, period_ns, 4),
    FIELD(hdt_tables, rate_q16, 4),    FIELD(hdt_tables, stale_periods, 4),
    FIELD(hdt_tables, gravity_q24, 4), FIELD(hdt_tables, biquad_q28, 4),
    FIELD(hdt_tables, observer, 4),    FIELD(hdt_tables, observer_gain, 4),
};

/* up to the lines */
static const struct field joint_fields[] = {
    FIELD(hdt_joint_tab, terms, 4),           FIELD(hdt_joint_tab, sign, 4),
    FIELD(hdt_joint_tab, zero_cnt, 4),        FIELD(hdt_joint_tab, rad_per_count_q44, 4),
    FIELD(hdt_joint_tab, phase_per_count_q24, 8), FIELD(hdt_joint_tab, chain, 4),
    FIELD(hdt_joint_tab, phase0, 4),          FIELD(hdt_joint_tab, twist_cos_q30, 4),
    FIELD(hdt_joint_tab, twist_sin_q30, 4),   FIELD(hdt_joint_tab, step_q24, 4),
    FIELD(hdt_joint_tab, moment_q20, 4),      FIELD(hdt_joint_tab, second_q20, 4),
    FIELD(hdt_joint_tab, rotor_q20, 4),       FIELD(hdt_joint_tab, v_lim_q24, 4),
    FIELD(hdt_joint_tab, a_lim_q16, 4),
    FIELD(hdt_joint_tab, v_ramp_inv_q16, 4),  FIELD(hdt_joint_tab, friction_shift, 4),
    FIELD(hdt_joint_tab, friction_q16, 4),    FIELD(hdt_joint_tab, ripple_q8, 2),
    FIELD(hdt_joint_tab, stiffness, 4),       FIELD(hdt_joint_tab, windup_inv_q8, 4),
    FIELD(hdt_joint_tab, lines, 4),
};

static const struct field line_fields[] = {
    FIELD(hdt_line_tab, phase_per_count_q24, 8), FIELD(hdt_line_tab, amplitude_q16, 4),
    FIELD(hdt_line_tab, directed, 4),            FIELD(hdt_line_tab, phase0, 4),
};

/* after the lines */
static const struct field tail_fields[] = {
    FIELD(hdt_joint_tab, load_mu_q24, 4),      FIELD(hdt_joint_tab, cold_coulomb_q16, 4),
    FIELD(hdt_joint_tab, cold_viscous_q16, 4), FIELD(hdt_joint_tab, cold_decay_q31, 4),
    FIELD(hdt_joint_tab, presliding_q16, 4),   FIELD(hdt_joint_tab, presliding_inv_q8, 4),
    FIELD(hdt_joint_tab, spring_q16, 4),       FIELD(hdt_joint_tab, spring_q0_q24, 4),
    FIELD(hdt_joint_tab, offset_q16, 4),       FIELD(hdt_joint_tab, kp_q16, 4),
    FIELD(hdt_joint_tab, kd_q16, 4),           FIELD(hdt_joint_tab, inertia_inv_q20, 4),
    FIELD(hdt_joint_tab, nm_per_digit_q24, 4), FIELD(hdt_joint_tab, digit_per_nm_q24, 4),
    FIELD(hdt_joint_tab, dig_max, 4),          FIELD(hdt_joint_tab, dig_slew, 4),
    FIELD(hdt_joint_tab, spd_max, 4),          FIELD(hdt_joint_tab, q_min_q24, 4),
    FIELD(hdt_joint_tab, q_max_q24, 4),        FIELD(hdt_joint_tab, v_max_q24, 4),
    FIELD(hdt_joint_tab, follow_max_q24, 4),
};

/* after the tail, three times, then the two numbers of the last */
static const struct field curve_fields[] = {
    FIELD(hdt_curve_tab, start, 4), FIELD(hdt_curve_tab, shift, 4), FIELD(hdt_curve_tab, value_q8, 2),
};

static const struct field axis_fields[] = {
    FIELD(hdt_joint_tab, axis, 4), FIELD(hdt_joint_tab, directed, 4),
};

/* Little endian to and from the machine's own order. */
static void copy_in(void *to, const uint8_t *from, size_t width)
{
    uint64_t bits = 0;
    for (size_t i = width; i-- > 0;)
        bits = bits << 8 | from[i];
    switch (width) {
    case 1: *(uint8_t *)to = (uint8_t)bits; break;
    case 2: *(uint16_t *)to = (uint16_t)bits; break;
    case 4: *(uint32_t *)to = (uint32_t)bits; break;
    default: *(uint64_t *)to = bits; break;
    }
}

static void copy_out(uint8_t *to, const void *from, size_t width)
{
    uint64_t bits;
    switch (width) {
    case 1: bits = *(const uint8_t *)from; break;
    case 2: bits = *(const uint16_t *)from; break;
    case 4: bits = *(const uint32_t *)from; break;
    default: bits = *(const uint64_t *)from; break;
    }
    for (size_t i = 0; i < width; i++)
        to[i] = (uint8_t)(bits >> (8 * i));
}

static size_t fields_size(const struct field *list, size_t count)
{
    size_t size = 0;
    for (size_t i = 0; i < count; i++)
        size += list[i].width * list[i].count;
    return size;
}

static const uint8_t *fields_in(const struct field *list, size_t count, void *owner, const uint8_t *from)
{
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < list[i].count; k++) {
            copy_in((char *)owner + list[i].at + k * list[i].width, from, list[i].width);
            from += list[i].width;
        }
    }
    return from;
}

static uint8_t *fields_out(const struct field *list, size_t count, const void *owner, uint8_t *to)
{
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < list[i].count; k++) {
            copy_out(to, (const char *)owner + list[i].at + k * list[i].width, list[i].width);
            to += list[i].width;
        }
    }
    return to;
}

#define SIZE(list) fields_size(list, COUNT(list))
#define IN(list, owner, from) fields_in(list, COUNT(list), owner, from)
#define OUT(list, owner, to) fields_out(list, COUNT(list), owner, to)

/* CRC-32, reflected polynomial 0xEDB88320, as zlib */
static uint32_t crc32(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xffffffffu;
    /*@ loop unroll 1; */
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

size_t hdt_tables_size(uint32_t joints)
{
    const size_t joint = SIZE(joint_fields) + HDT_LINES_MAX * SIZE(line_fields) + SIZE(tail_fields) +
                         3 * SIZE(curve_fields) + SIZE(axis_fields);
    return SIZE(head_fields) + joints * joint + 4;
}

size_t hdt_tables_write(const struct hdt_tables *t, uint8_t *buf, size_t cap)
{
    if (t->joints < 1 || t->joints > HDT_JOINTS_MAX || cap < hdt_tables_size(t->joints))
        return 0;
    uint8_t *to = OUT(head_fields, t, buf);
    for (uint32_t j = 0; j < t->joints; j++) {
        to = OUT(joint_fields, &t->joint[j], to);
        for (int k = 0; k < HDT_LINES_MAX; k++)
            to = OUT(line_fields, &t->joint[j].line[k], to);
        to = OUT(tail_fields, &t->joint[j], to);
        to = OUT(curve_fields, &t->joint[j].local[0], to);
        to = OUT(curve_fields, &t->joint[j].local[1], to);
        to = OUT(curve_fields, &t->joint[j].table, to);
        to = OUT(axis_fields, &t->joint[j], to);
    }
    const uint32_t crc = crc32(buf, (size_t)(to - buf));
    copy_out(to, &crc, 4);
    return (size_t)(to - buf) + 4;
}

/* Magic, layout, length and CRC, in this order, so that the first thing wrong is the one told. */
static int image_wrong(const uint8_t *image, size_t size, struct hdt_tables *out)
{
    uint32_t magic, layout, crc;
    if (size < 8)
        return HDT_TABLES_SHORT;
    copy_in(&magic, image, 4);
    copy_in(&layout, image + 4, 4);
    if (magic != HDT_TABLES_MAGIC)
        return HDT_TABLES_NOT_OURS;
    if (layout != HDT_TABLES_LAYOUT) {
        out->layout = layout;
        return HDT_TABLES_VERSION;
    }
    if (size < SIZE(head_fields))
        return HDT_TABLES_SHORT;
    (void)IN(head_fields, out, image);
    const uint32_t joints = out->joints;
    *out = (struct hdt_tables){0};
    if (joints < 1 || joints > HDT_JOINTS_MAX || size != hdt_tables_size(joints))
        return HDT_TABLES_SHORT;
    copy_in(&crc, image + size - 4, 4);
    return crc == crc32(image, size - 4) ? HDT_TABLES_OK : HDT_TABLES_CRC;
}

int hdt_tables_read(const uint8_t *image, size_t size, struct hdt_tables *out)
{
    *out = (struct hdt_tables){0};
    const int err = image_wrong(image, size, out);
    if (err != HDT_TABLES_OK)
        return err;

    const uint8_t *from = IN(head_fields, out, image);
    for (uint32_t j = 0; j < out->joints; j++) {
        from = IN(joint_fields, &out->joint[j], from);
        for (int k = 0; k < HDT_LINES_MAX; k++)
            from = IN(line_fields, &out->joint[j].line[k], from);
        from = IN(tail_fields, &out->joint[j], from);
        from = IN(curve_fields, &out->joint[j].local[0], from);
        from = IN(curve_fields, &out->joint[j].local[1], from);
        from = IN(curve_fields, &out->joint[j].table, from);
        from = IN(axis_fields, &out->joint[j], from);
    }
    return hdt_tables_check(out, NULL, NULL);
}

const char *hdt_tables_strerror(int err)
{
    switch (err) {
    case HDT_TABLES_OK: return "no error";
    case HDT_TABLES_SHORT: return "image is cut short, too long, or its joint count is not 1 to 16";
    case HDT_TABLES_NOT_OURS: return "not a table image";
    case HDT_TABLES_VERSION: return "table layout differs from this core's; generate the tables again";
    case HDT_TABLES_CRC: return "checksum does not match: image damaged";
    case HDT_TABLES_RANGE: return "a value is outside what the core takes";
    default: return "unknown error";
    }
}
