/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The step: counts to motion, motion to terms, terms to the gate.
 *
 * Owns: the order of a period and what is remembered between periods.
 * Never: writes a digit or a speed word (the gate does), knows how a term is made.
 */
#include "ctrl/hdt_chain.h"
#include "ctrl/hdt_comp.h"
#include "ctrl/hdt_gate.h"
#include "ctrl/hdt_vel.h"

#define USE(term) (1u << (term))

/* wind-up and load friction need the holding torque whether or not it is itself commanded */
#define NEED_GRAVITY \
    (USE(HDT_TERM_GRAVITY) | USE(HDT_TERM_STIFFNESS) | USE(HDT_TERM_LOAD) | USE(HDT_TERM_TABLE))
#define NEED_ANGLES (NEED_GRAVITY | USE(HDT_TERM_INERTIA))

/* terms an ideal joint has none of; one branch where none is used */
#define EFFECTS \
    (USE(HDT_TERM_LINES) | USE(HDT_TERM_LOAD) | USE(HDT_TERM_TEMPERATURE) | USE(HDT_TERM_PRESLIDING) | \
     USE(HDT_TERM_SPRING) | USE(HDT_TERM_OFFSET) | USE(HDT_TERM_LOCAL) | USE(HDT_TERM_TABLE))

/* velocity mode: speed added per position error, 1/s */
#define VELOCITY_KPOS 4

int hdt_init(hdt_t *h, const struct hdt_tables *tables)
{
    if (h == NULL)
        return HDT_ERR_ARG;
    *h = (hdt_t){0};
    if (tables == NULL)
        return HDT_ERR_ARG;
    if (hdt_tables_check(tables, NULL, NULL) != HDT_TABLES_OK)
        return HDT_ERR_TABLES;

    h->tables = tables;
    for (uint32_t j = 0; j < tables->joints; j++) {
        h->terms |= tables->joint[j].terms;
        h->count[j] = tables->joint[j].zero_cnt;
        h->cold_q30[j] = (int32_t)1 << 30;
    }
    return HDT_OK;
}

int hdt_clear(hdt_t *h)
{
    if (h == NULL)
        return HDT_ERR_ARG;
    if (h->tables == NULL)
        return HDT_ERR_TABLES;
    hdt_gate_clear(&h->gate);
    return HDT_OK;
}

/* Host time: the cold share falls once a second; at most one second a period is caught up. */
static void pass_time(hdt_t *h, uint64_t t_us)
{
    h->second_us += h->steps == 0 ? 0 : t_us - h->t_us;
    h->t_us = t_us;
    h->steps += h->steps < UINT32_MAX;
    if (h->second_us < 1000000u)
        return;
    h->second_us -= 1000000u;
    for (uint32_t j = 0; j < h->tables->joints; j++)
        h->cold_q30[j] = hdt_mul(h->cold_q30[j], h->tables->joint[j].cold_decay_q31, 31);
}

/* Cold share now: linear within the second. */
static int32_t cold_share(const hdt_t *h, uint32_t j)
{
    /* 2^52 / 1e6: us q0 -> s q30 */
    const uint64_t within = h->second_us < 1000000u ? h->second_us : 1000000u;
    const int64_t part_q30 = (int64_t)((within * 4503599627u) >> 22);
    const int64_t lost_q31 = ((int64_t)1 << 31) - h->tables->joint[j].cold_decay_q31;
    const int64_t drop_q30 = hdt_shr(h->cold_q30[j] * lost_q31, 31);
    return (int32_t)(h->cold_q30[j] - hdt_shr(drop_q30 * part_q30, 30));
}

/* A time between two counts and what it makes of a count; the joints of an arm mostly share it. */
struct pace {
    uint64_t now_us, longest_us;  /* time of these counts; gaps beyond the longest are not spanned */
    uint64_t gap_us;
    uint32_t seen;                /* bit per joint: it had a count before; none if the gap is not spanned */
    uint32_t seen_before, shortest_us, rate_q16;
};

static struct pace pace_of(const hdt_t *h, const struct hdt_in *in)
{
    const uint32_t period_us = h->tables->period_ns / 1000u, quarter_us = period_us / 4u;
    struct pace p;
    p.now_us = in->count_us != 0 ? in->count_us : in->t_us;
    p.longest_us = ((uint64_t)period_us * (2 * HDT_VEL_GAP_MAX + 1)) / 2;
    p.shortest_us = quarter_us > 16u ? quarter_us : 16u;
    p.gap_us = 0;
    p.seen = 0;
    p.seen_before = h->seen;
    p.rate_q16 = 0;
    return p;
}

/* A late host makes a long difference; it must not look like a fast arm. */
static void pace_turns(struct pace *p, uint64_t gap_us)
{
    p->gap_us = gap_us;
    p->seen = gap_us - 1u < p->longest_us ? p->seen_before : 0;
    if (p->seen != 0)
        p->rate_q16 = hdt_vel_rate_q16(gap_us > p->shortest_us ? (uint32_t)gap_us : p->shortest_us);
}

static void forget_motion(hdt_t *h, uint32_t j)
{
    h->vel[j] = (struct hdt_vel){{0, 0}, {0, 0}, 0};
    h->observed &= ~((uint32_t)1 << j);
}

/* Newest count to filtered velocity.  Without a new count the last difference is held, as long as a gap is
 * spanned; after that nothing is known of the joint's motion, and the estimates begin anew. */
static inline int32_t measure_velocity(hdt_t *h, const struct hdt_in *in, uint32_t j, struct pace *p)
{
    const struct hdt_tables *t = h->tables;
    struct hdt_vel *vel = &h->vel[j];
    int32_t x_q24 = vel->x_q24[0];

    if (in->fresh >> j & 1u) {
        const uint64_t gap_us = p->now_us - h->count_us[j];
        if (gap_us != p->gap_us)
            pace_turns(p, gap_us);
        if (p->seen >> j & 1u) {
            const int64_t per_count = hdt_vel_per_count_q32(t->joint[j].rad_per_count_q44, p->rate_q16);
            x_q24 = hdt_vel_difference(in->count[j].raw, h->count[j], per_count) * t->joint[j].sign;
        } else if (gap_us != 0) {
            forget_motion(h, j);
            x_q24 = 0;
        }
        h->count[j] = in->count[j].raw;
        h->count_us[j] = p->now_us;
    } else if (h->gate.stale[j] >= HDT_VEL_GAP_MAX) {
        forget_motion(h, j);
        x_q24 = 0;
    }
    return hdt_vel_filter(vel, t->biquad_q28, x_q24);
}

/* Path of the reference since it last reversed: zero in the period of the reversal. */
static int64_t pass_travel(hdt_t *h, uint32_t j, int32_t v_ref_q24, uint32_t period_q32)
{
    const int32_t sign = (v_ref_q24 > 0) - (v_ref_q24 < 0);
    if (sign != 0 && sign != h->dir[j]) {
        h->dir[j] = sign;
        h->travel_q40[j] = 0;
    }
    const int64_t travel = h->travel_q40[j];

    /* q24 * q32 = q56 -> q40; held at 64 rad */
    const int64_t limit = (int64_t)1 << 46;
    const int64_t sum = travel + hdt_shr((int64_t)hdt_abs(v_ref_q24) * period_q32, 16);
    h->travel_q40[j] = sum < limit ? sum : limit;
    return travel;
}

/* Wind-up follows the reference's travel and stops at either direction's torque. */
static int32_t pass_windup(hdt_t *h, uint32_t j, int32_t v_ref_q24, uint32_t period_q32)
{
    /* q24 * q32 = q56 -> rad q30, at most 2 rad a period; q30 * q8 -> q30 */
    const int64_t one = (int64_t)1 << 30;
    const int64_t step = hdt_within(hdt_shr((int64_t)v_ref_q24 * period_q32, 26), 2 * one);
    const int64_t wound = h->wound_q30[j] + hdt_shr(step * h->tables->joint[j].windup_inv_q8, 8);
    h->wound_q30[j] = (int32_t)hdt_within(wound, one);
    return h->wound_q30[j];
}

/* Observed velocity, and the uses the tables give it. */
static void observe(hdt_t *h, const struct hdt_in *in, uint32_t j, uint32_t period_q32,
                    struct hdt_motion *k, struct hdt_out *out)
{
    const struct hdt_tables *t = h->tables;
    const struct hdt_joint_tab *tab = &t->joint[j];
    struct hdt_obs *s = &h->obs[j];
    /* below 2^63, q44 -> q40; no further than +-128 rad */
    const int64_t far_q40 = (int64_t)1 << 47;
    const int64_t q_q40 = hdt_within(hdt_shr((int64_t)k->turned * tab->rad_per_count_q44, 4), far_q40);

    /* it starts, and starts again after a fault of more than a quarter rad, where the arm is */
    const int64_t off = q_q40 - s->q_q40, quarter = (int64_t)1 << 38;
    if (!(h->observed >> j & 1u) || off > quarter || off < -quarter) {
        h->observed |= h->seen & (uint32_t)1 << j;
        s->q_q40 = q_q40;
        s->v_q40 = 0;
        s->d_q32 = 0;
    }
    const int32_t v_q24 = hdt_vel_observe(s, t->observer_gain, q_q40, (int)(in->fresh >> j & 1u), period_q32);
    out->v_obs[j].raw = v_q24;
    if (t->observer >> HDT_OBSERVED_FEEDBACK & 1u)
        k->v_q24 = v_q24;
    if (t->observer >> HDT_OBSERVED_FRICTION & 1u) {
        k->v_fric_q24 = (int32_t)hdt_within(v_q24, tab->v_lim_q24);
        k->dir_q30 = hdt_comp_direction_q30(tab, k->v_fric_q24);
    }
}

/* What the torque let through will accelerate each joint by, as far as the model knows. */
static void expect(hdt_t *h, const struct hdt_in *in, const struct hdt_motion m[], const struct hdt_out *out)
{
    for (uint32_t j = 0; j < h->tables->joints; j++) {
        const struct hdt_joint_tab *tab = &h->tables->joint[j];
        const int driven = (int)(in->active >> j & 1u) && out->fault == 0;
        int64_t a_q16 = 0;
        if (driven && in->mode == HDT_MODE_VELOCITY) {
            a_q16 = m[j].a_ref_q16;
        } else if (driven && in->mode == HDT_MODE_TORQUE) {
            /* torque not spoken for by the model; q24 -> q16, below 2^38; q16 * q20 -> q16 */
            const int64_t used_q16 = hdt_shr((int64_t)h->gate.digit[j] * tab->nm_per_digit_q24, 8);
            const int64_t rest_q16 = used_q16 - out->total[j].raw
                                     + out->term[HDT_TERM_P][j].raw + out->term[HDT_TERM_D][j].raw;
            a_q16 = hdt_shr(hdt_sat(rest_q16) * (int64_t)tab->inertia_inv_q20, 20);
            a_q16 += tab->terms & USE(HDT_TERM_INERTIA) ? m[j].a_ref_q16 : 0;
        }
        h->obs[j].a_q16 = (int32_t)hdt_within(a_q16, (int64_t)1 << 28);
    }
}

static void measure(hdt_t *h, const struct hdt_in *in, struct hdt_motion m[], struct hdt_out *out)
{
    const struct hdt_tables *t = h->tables;
    struct pace pace = pace_of(h, in);
    /* ns to s q32: 2^62 / 1e9 = 4611686018 */
    const uint32_t period_q32 = (uint32_t)(((uint64_t)t->period_ns * 4611686018u) >> 30);

    h->seen |= in->fresh & (((uint32_t)1 << t->joints) - 1u);
    for (uint32_t j = 0; j < t->joints; j++) {
        const struct hdt_joint_tab *tab = &t->joint[j];
        struct hdt_motion *k = &m[j];
        k->v_q24 = measure_velocity(h, in, j, &pace);
        k->turned = hdt_comp_turned(tab, h->count[j]);
        k->q_q24 = hdt_comp_angle_q24(tab, k->turned);
        k->q_ref_q24 = in->q_ref[j].raw;
        k->v_ref_q24 = (int32_t)hdt_within(in->v_ref[j].raw, tab->v_lim_q24);
        k->a_ref_q16 = (int32_t)hdt_within(in->a_ref[j].raw, tab->a_lim_q16);
        k->v_fric_q24 = k->v_ref_q24;
        k->dir_q30 = hdt_comp_direction_q30(tab, k->v_ref_q24);
        k->travel_q40 = tab->terms & USE(HDT_TERM_PRESLIDING) ?
                        pass_travel(h, j, k->v_ref_q24, period_q32) : 0;
        k->wound_q30 = tab->windup_inv_q8 != 0 ? pass_windup(h, j, k->v_ref_q24, period_q32) : 0;
        k->cold_q30 = tab->terms & USE(HDT_TERM_TEMPERATURE) ? cold_share(h, j) : 0;
        if (h->terms & NEED_ANGLES) {
            hdt_phase_t angle = hdt_comp_phase(tab->phase_per_count_q24, k->turned);
            angle.raw += tab->phase0;
            hdt_sin_cos(angle, &k->sin_q30, &k->cos_q30);
        }
        out->q[j].raw = k->q_q24;
        out->v[j].raw = k->v_q24;
        if (t->observer != 0)
            observe(h, in, j, period_q32, k, out);
    }
}

#define TERM(t, value) \
    if (has & USE(t)) \
        total += out->term[t][j].raw = (value)

/* The effects joint j uses, into out; their sum. */
static int64_t effects(const struct hdt_joint_tab *tab, const struct hdt_motion *m, int32_t spring,
                       int32_t load, uint32_t j, struct hdt_out *out)
{
    const uint32_t has = tab->terms;
    int64_t total = 0;

    TERM(HDT_TERM_LINES, hdt_comp_lines(tab, m));
    TERM(HDT_TERM_LOAD, hdt_comp_load(tab, m, load));
    TERM(HDT_TERM_TEMPERATURE, hdt_comp_temperature(tab, m));
    TERM(HDT_TERM_PRESLIDING, hdt_comp_presliding(tab, m));
    TERM(HDT_TERM_SPRING, spring);
    TERM(HDT_TERM_OFFSET, tab->offset_q16);
    TERM(HDT_TERM_LOCAL, hdt_comp_local(tab, m));
    TERM(HDT_TERM_TABLE, hdt_comp_table(tab, m, load));
    return total;
}

/* Every term joint j uses, into out; gravity and inertia of the chain come in. */
static inline void joint_terms(const struct hdt_joint_tab *tab, const struct hdt_motion *m, int32_t gravity,
                               int32_t inertia, uint32_t j, struct hdt_out *out)
{
    const uint32_t has = tab->terms;
    int32_t load = gravity; /* what the gear has to carry */
    int32_t spring = 0;
    int64_t total = 0;

    if (has & USE(HDT_TERM_SPRING)) {
        spring = hdt_comp_spring(tab, m);
        load = gravity + spring; /* 2^30 + 2^27 */
    }
    TERM(HDT_TERM_GRAVITY, gravity);
    TERM(HDT_TERM_INERTIA, hdt_sat(inertia + hdt_shr((int64_t)tab->rotor_q20 * m->a_ref_q16, 20)));
    TERM(HDT_TERM_FRICTION, hdt_comp_friction(tab, m));
    TERM(HDT_TERM_RIPPLE, hdt_comp_ripple(tab, m));
    TERM(HDT_TERM_STIFFNESS, tab->windup_inv_q8 != 0 ? hdt_comp_hysteresis(tab, m, load) :
                                                       hdt_comp_stiffness(tab, m, load));
    TERM(HDT_TERM_P, hdt_comp_p(tab, m));
    TERM(HDT_TERM_D, hdt_comp_d(tab, m));
    if (has & EFFECTS)
        total += effects(tab, m, spring, load, j, out);
    out->total[j].raw = hdt_sat(total);
}

#undef TERM

static void compensate(const hdt_t *h, const struct hdt_motion m[], struct hdt_out *out)
{
    const struct hdt_tables *t = h->tables;
    int32_t gravity[HDT_JOINTS_MAX] = {0}, inertia[HDT_JOINTS_MAX] = {0};

    if (h->terms & NEED_GRAVITY)
        hdt_chain_gravity(t, m, gravity);
    if (h->terms & USE(HDT_TERM_INERTIA))
        hdt_chain_inertia(t, m, inertia);
    for (uint32_t j = 0; j < t->joints; j++)
        joint_terms(&t->joint[j], &m[j], gravity[j], inertia[j], j, out);
}

/* Speed wanted in velocity mode. */
static void follow(const struct hdt_tables *t, const struct hdt_in *in, const struct hdt_out *out,
                   hdt_radps_t v_cmd[])
{
    for (uint32_t j = 0; j < t->joints; j++) {
        const int64_t error_q24 = (int64_t)in->q_ref[j].raw - out->q[j].raw;
        v_cmd[j].raw = hdt_sat(in->v_ref[j].raw + VELOCITY_KPOS * error_q24);
    }
}

/* Why this step cannot be done, or HDT_OK. */
static int refusal(const hdt_t *h, const struct hdt_in *in, const struct hdt_out *out)
{
    if (in == NULL || out == NULL || in->mode > HDT_MODE_VELOCITY)
        return HDT_ERR_ARG;
    if (h->tables == NULL)
        return HDT_ERR_TABLES;
    return h->steps != 0 && in->t_us <= h->t_us ? HDT_ERR_TIME : HDT_OK;
}

int hdt_step(hdt_t *h, const struct hdt_in *in, struct hdt_out *out)
{
    if (out != NULL)
        *out = (struct hdt_out){0};
    if (h == NULL)
        return HDT_ERR_ARG;
    const int err = refusal(h, in, out);
    if (err != HDT_OK) {
        /* the joints get zero this period: the slew limit goes on from there */
        hdt_gate_zero(&h->gate);
        return err;
    }

    struct hdt_motion m[HDT_JOINTS_MAX];
    hdt_radps_t v_cmd[HDT_JOINTS_MAX];
    pass_time(h, in->t_us);
    measure(h, in, m, out);
    compensate(h, m, out);
    if (in->mode == HDT_MODE_VELOCITY)
        follow(h->tables, in, out, v_cmd);
    hdt_gate_step(&h->gate, h->tables, in, h->seen, v_cmd, out);
    if (h->tables->observer != 0)
        expect(h, in, m, out);
    return HDT_OK;
}

const char *hdt_strerror(int err)
{
    switch (err) {
    case HDT_OK: return "no error";
    case HDT_ERR_ARG: return "null pointer or unknown mode";
    case HDT_ERR_TABLES: return "tables missing or not acceptable";
    case HDT_ERR_TIME: return "time did not advance";
    default: return "unknown error";
    }
}

const char *hdt_fault_str(uint32_t one_bit)
{
    switch (one_bit) {
    case 0: return "none";
    case HDT_FAULT_STALE: return "stale";
    case HDT_FAULT_SPEED: return "speed";
    case HDT_FAULT_FOLLOWING: return "following";
    case HDT_FAULT_SERVO: return "servo";
    case HDT_FAULT_REFERENCE: return "reference";
    default: return "unknown";
    }
}

const char *hdt_limit_str(uint32_t one_bit)
{
    switch (one_bit) {
    case 0: return "none";
    case HDT_LIM_TORQUE: return "torque";
    case HDT_LIM_SLEW: return "slew";
    case HDT_LIM_POSITION: return "position";
    case HDT_LIM_SPEED: return "speed";
    default: return "unknown";
    }
}

const char *hdt_term_str(int term)
{
    switch (term) {
    case HDT_TERM_GRAVITY: return "gravity";
    case HDT_TERM_INERTIA: return "inertia";
    case HDT_TERM_FRICTION: return "friction";
    case HDT_TERM_RIPPLE: return "ripple";
    case HDT_TERM_STIFFNESS: return "stiffness";
    case HDT_TERM_LINES: return "lines";
    case HDT_TERM_LOAD: return "load";
    case HDT_TERM_TEMPERATURE: return "temperature";
    case HDT_TERM_PRESLIDING: return "presliding";
    case HDT_TERM_SPRING: return "spring";
    case HDT_TERM_OFFSET: return "offset";
    case HDT_TERM_LOCAL: return "local";
    case HDT_TERM_TABLE: return "table";
    case HDT_TERM_P: return "p";
    case HDT_TERM_D: return "d";
    default: return "unknown";
    }
}
