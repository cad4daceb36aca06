/* SPDX-License-Identifier: Apache-2.0 */
/*
 * LCM's byte rules by hand: big endian, members in order, an 8-byte fingerprint first.  One
 * function a message walks its members in both directions, so that writing and reading cannot
 * disagree; that both agree with LCM is tested against code from lcm-gen.
 *
 * Owns: the walk over hdt.run_t and hdt.cycle_t.
 * Never: does I/O, allocates, trusts a length.
 */
#include "driver/drv_lcm.h"

#include <string.h>

/* Fingerprints lcm-gen gives the types of hdt_cycle.lcm. */
#define RUN_FINGERPRINT 0x85c5a31de8566967u
#define CYCLE_FINGERPRINT 0xd1878a57772da36cu

/* A place in a message; after the first thing that does not fit, nothing more moves. */
struct walk {
    uint8_t *p;       /* written to only when writing */
    size_t pos, cap;
    int reading, bad;
};

static void walk_be(struct walk *w, uint64_t *v, size_t size)
{
    if (w->bad || w->cap - w->pos < size) {
        w->bad = 1;
        return;
    }
    uint8_t *p = w->p + w->pos;
    w->pos += size;
    if (w->reading) {
        *v = 0;
        for (size_t i = 0; i < size; i++)
            *v = *v << 8 | p[i];
    } else {
        for (size_t i = 0; i < size; i++)
            p[i] = (uint8_t)(*v >> (8 * (size - 1 - i)) & 0xffu);
    }
}

static void walk_u64(struct walk *w, uint64_t *v)
{
    walk_be(w, v, 8);
}

static void walk_u32(struct walk *w, uint32_t *v)
{
    uint64_t x = *v;
    walk_be(w, &x, 4);
    *v = (uint32_t)x;
}

static void walk_u16(struct walk *w, uint16_t *v)
{
    uint64_t x = *v;
    walk_be(w, &x, 2);
    *v = (uint16_t)x;
}

/* Signed members by their bits: an int and its unsigned twin may alias. */
static void walk_s32(struct walk *w, int32_t *v)
{
    walk_u32(w, (uint32_t *)v);
}

static void walk_s16(struct walk *w, int16_t *v)
{
    walk_u16(w, (uint16_t *)v);
}

static void walk_f64(struct walk *w, double *v)
{
    uint64_t x;
    memcpy(&x, v, sizeof x);
    walk_u64(w, &x);
    memcpy(v, &x, sizeof x);
}

static void walk_bytes(struct walk *w, void *b, size_t n)
{
    if (w->bad || w->cap - w->pos < n) {
        w->bad = 1;
        return;
    }
    if (w->reading)
        memcpy(b, w->p + w->pos, n);
    else
        memcpy(w->p + w->pos, b, n);
    w->pos += n;
}

/* A string: its length with the final zero, then both. */
static void walk_string(struct walk *w, char *s, size_t room)
{
    uint32_t len = w->reading ? 0u : (uint32_t)strlen(s) + 1u;
    walk_u32(w, &len);
    if (len == 0 || len > room) {
        w->bad = 1;
        return;
    }
    walk_bytes(w, s, len);
    if (!w->bad && memchr(s, 0, len) != s + len - 1)
        w->bad = 1;
}

static void walk_run(struct walk *w, struct drv_run *run)
{
    walk_u32(w, &run->version);
    walk_u32(w, &run->table_layout);
    walk_u32(w, &run->period_ns);
    walk_u32(w, &run->terms);
    walk_string(w, run->arm, sizeof run->arm);
    walk_bytes(w, run->digest, sizeof run->digest);
    walk_u32(w, &run->joints);
    if (run->joints == 0 || run->joints > HDT_JOINTS_MAX)
        w->bad = 1;
    for (unsigned j = 0; !w->bad && j < run->joints; j++)
        walk_f64(w, &run->ratio[j]);
    walk_string(w, run->constants, sizeof run->constants);
}

static void walk_in(struct walk *w, struct hdt_in *in, unsigned n)
{
    walk_u32(w, &in->mode);
    walk_u32(w, &in->active);
    walk_u32(w, &in->fresh);
    walk_u32(w, &in->servo_alarm);
    walk_u64(w, &in->count_us);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &in->count[j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &in->q_ref[j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &in->v_ref[j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &in->a_ref[j].raw);
}

int drv_lcm_terms_known(uint32_t terms)
{
    return terms == HDT_TERMS || terms == DRV_LCM_TERMS_LAYOUT_1;
}

/* The core's number of a log's term k.  With tables of layout 1 there was neither local nor table. */
static unsigned term_of(uint32_t terms, unsigned k)
{
    const unsigned missing = HDT_TERMS - DRV_LCM_TERMS_LAYOUT_1;
    return terms == DRV_LCM_TERMS_LAYOUT_1 && k >= HDT_TERM_LOCAL ? k + missing : k;
}

static void walk_out(struct walk *w, struct hdt_out *out, unsigned n, uint32_t terms)
{
    for (unsigned j = 0; j < n; j++)
        walk_s16(w, &out->digit[j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s16(w, &out->speed[j].raw);
    walk_u32(w, &out->fault);
    walk_u32(w, &out->fault_joints);
    for (unsigned j = 0; j < n; j++)
        walk_u32(w, &out->limit[j]);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &out->q[j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &out->v[j].raw);
    for (unsigned k = 0; k < terms; k++)
        for (unsigned j = 0; j < n; j++)
            walk_s32(w, &out->term[term_of(terms, k)][j].raw);
    for (unsigned j = 0; j < n; j++)
        walk_s32(w, &out->total[j].raw);
}

static void walk_record(struct walk *w, struct drv_record *rec, uint32_t *version, uint32_t joints,
                        uint32_t terms)
{
    uint32_t has_joints = joints, has_terms = terms;
    walk_u32(w, version);
    walk_u64(w, &rec->in.t_us);
    walk_u32(w, &has_joints);
    walk_u32(w, &has_terms);
    if (has_joints != joints || has_terms != terms || !drv_lcm_terms_known(terms))
        w->bad = 1;
    if (w->bad)
        return;
    walk_in(w, &rec->in, joints);
    walk_out(w, &rec->out, joints, terms);
    for (unsigned j = 0; j < joints; j++)
        walk_s16(w, &rec->torque_dig[j]);
    for (unsigned j = 0; j < joints; j++)
        walk_u16(w, &rec->status[j]);
    walk_u16(w, &rec->driver_status);
    walk_u16(w, &rec->link);
}

size_t drv_lcm_put_run(const struct drv_run *run, uint8_t *buf, size_t cap)
{
    struct walk w = {.p = buf, .cap = cap};
    struct drv_run copy = *run;
    uint64_t print = RUN_FINGERPRINT;
    walk_u64(&w, &print);
    walk_run(&w, &copy);
    return w.bad ? 0 : w.pos;
}

size_t drv_lcm_put_record(const struct drv_record *rec, unsigned joints, uint8_t *buf, size_t cap)
{
    struct walk w = {.p = buf, .cap = cap};
    struct drv_record copy = *rec;
    uint64_t print = CYCLE_FINGERPRINT;
    uint32_t version = DRV_LOG_VERSION;
    walk_u64(&w, &print);
    walk_record(&w, &copy, &version, joints, HDT_TERMS);
    return w.bad ? 0 : w.pos;
}

int drv_lcm_get_run(const uint8_t *buf, size_t len, struct drv_run *run)
{
    struct walk w = {.p = (uint8_t *)(uintptr_t)buf, .cap = len, .reading = 1};
    uint64_t print = 0;
    memset(run, 0, sizeof *run);
    walk_u64(&w, &print);
    struct walk at_version = w;
    walk_u32(&at_version, &run->version);
    if (at_version.bad)
        return DRV_LCM_DAMAGED;
    /* a later version has another fingerprint, but its version still comes first */
    if (run->version != DRV_LOG_VERSION)
        return DRV_LCM_VERSION;
    if (print != RUN_FINGERPRINT)
        return DRV_LCM_TYPE;
    walk_run(&w, run);
    return w.bad || w.pos != len ? DRV_LCM_DAMAGED : DRV_LCM_OK;
}

int drv_lcm_get_record(const uint8_t *buf, size_t len, unsigned joints, uint32_t terms,
                       struct drv_record *rec)
{
    struct walk w = {.p = (uint8_t *)(uintptr_t)buf, .cap = len, .reading = 1};
    uint64_t print = 0;
    uint32_t version = 0;
    memset(rec, 0, sizeof *rec);
    walk_u64(&w, &print);
    if (!w.bad && print != CYCLE_FINGERPRINT)
        return DRV_LCM_TYPE;
    walk_record(&w, rec, &version, joints, terms);
    if (!w.bad && version != DRV_LOG_VERSION)
        return DRV_LCM_VERSION;
    return w.bad || w.pos != len ? DRV_LCM_DAMAGED : DRV_LCM_OK;
}

static void walk_head(struct walk *w, struct drv_lcm_head *h)
{
    walk_u32(w, &h->magic);
    walk_u64(w, &h->number);
    walk_u64(w, &h->t_us);
    walk_u32(w, &h->channel_len);
    walk_u32(w, &h->data_len);
}

void drv_lcm_put_head(const struct drv_lcm_head *h, uint8_t buf[DRV_LCM_HEAD])
{
    struct walk w = {.p = buf, .cap = DRV_LCM_HEAD};
    struct drv_lcm_head copy = *h;
    walk_head(&w, &copy);
}

void drv_lcm_get_head(const uint8_t buf[DRV_LCM_HEAD], struct drv_lcm_head *h)
{
    struct walk w = {.p = (uint8_t *)(uintptr_t)buf, .cap = DRV_LCM_HEAD, .reading = 1};
    walk_head(&w, h);
}
