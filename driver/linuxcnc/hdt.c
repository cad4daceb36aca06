/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arm as a LinuxCNC HAL component, by the plugin: pins in, a period a call of hdt.update, pins out.
 *
 *     loadrt hdt tables=/path/pa10.hdtm bus=unix:/path
 *     addf hdt.update servo-thread
 *
 * docs/porting.md, "LinuxCNC", has every pin with its unit.
 *
 * Owns: pins, and when the arm is driven.
 * Never: in hdt.update: allocates, blocks, prints (but one message when the thread's period is wrong).
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rtapi.h"
#include "rtapi_app.h"
#include "hal.h"

#include "driver/hdt_plugin.h"

MODULE_AUTHOR("hdt-servo");
MODULE_DESCRIPTION("harmonic-drive arm: torque from the hdt core, over its bus");
MODULE_LICENSE("Apache-2.0");

static char *tables;
RTAPI_MP_STRING(tables, "table image of the arm, by hdt gen");
static char *bus;
RTAPI_MP_STRING(bus, "unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE");

#define IMAGE_MAX (1 << 17)
#define RAD(q24) ((q24) / 16777216.0)
#define NM(q16) ((q16) / 65536.0)

struct joint_pins {
    hal_float_t *q_ref, *v_ref, *a_ref;            /* in */
    hal_float_t *q, *v, *torque;                   /* out */
    hal_float_t *term[HDT_TERMS];
    hal_u32_t *limit;
};

struct pins {
    hal_bit_t *enable, *velocity_mode, *clear;     /* in */
    hal_bit_t *ready, *driving, *fault;            /* out */
    hal_u32_t *fault_code, *fault_joints, *received, *lost;
    struct joint_pins joint[HDT_JOINTS_MAX];
};

/* The component is one arm: HAL's functions get it as their argument. */
struct component {
    int id;
    struct pins *pin;
    struct hdt_plugin_arm *arm;
    const struct hdt_plugin *plugin;
    const struct hdt_plugin_bus *bus;
    struct hdt_plugin_info info;
    struct hdt_in in;
    struct hdt_out out, next;                      /* of the last period that went well; of this one */
    uint32_t seen;
    int was_enable, was_clear;                     /* pins a period ago */
    int drive, failed, wrong_period;
};
static struct component *the;                      /* for rtapi_app_exit, which gets no argument */

/* A number to fixed point; beyond what fits it saturates. */
static int32_t fixed(double value, double scale)
{
    double x = value * scale;
    if (x >= 2147483646.5)
        return INT32_MAX;
    return x > -2147483646.5 ? (int32_t)(x < 0 ? x - 0.5 : x + 0.5) : -INT32_MAX;
}

/* One joint's reference while it is driven.  A pin that is no number (nan, inf) makes it a standstill below
 * every lower limit: a reference fault. */
static void read_reference(const struct joint_pins *k, struct hdt_in *in, unsigned j)
{
    const double q = *k->q_ref, v = *k->v_ref, a = *k->a_ref;
    const int numbers = isfinite(q) && isfinite(v) && isfinite(a);
    in->q_ref[j].raw = numbers ? fixed(q, 16777216.0) : INT32_MIN;
    in->v_ref[j].raw = numbers ? fixed(v, 16777216.0) : 0;
    in->a_ref[j].raw = numbers ? fixed(a, 65536.0) : 0;
}

static int ready(const struct component *c)
{
    return c->seen == c->in.active && c->out.fault == 0 && !c->failed && !c->wrong_period;
}

/* An edge of clear while there is a fault.  Without one it would only take the link down. */
static void read_clear(struct component *c)
{
    const int clear = *c->pin->clear;
    if (clear && !c->was_clear && c->out.fault != 0) {
        (void)c->plugin->clear(c->arm);
        (void)c->bus->restart(c->arm);
        c->seen = 0;
    }
    c->was_clear = clear;
}

/* Driving begins with an edge of enable on a ready arm, and with nothing else: whatever put the brakes on,
 * neither its end nor a reset starts motion. */
static void read_enable(struct component *c)
{
    const int enable = *c->pin->enable;
    c->drive = enable && ready(c) && (c->drive || !c->was_enable);
    c->was_enable = enable;
}

static void read_references(struct component *c)
{
    const struct pins *p = c->pin;
    c->in.mode = !c->drive ? HDT_MODE_IDLE : *p->velocity_mode ? HDT_MODE_VELOCITY : HDT_MODE_TORQUE;
    for (unsigned j = 0; j < c->info.joints; j++) {
        /* while idle the reference follows the arm: what is not driven cannot be out of its limits */
        c->in.q_ref[j] = c->out.q[j];
        c->in.v_ref[j].raw = 0;
        c->in.a_ref[j].raw = 0;
        if (c->drive)
            read_reference(&p->joint[j], &c->in, j);
    }
}

static void write_pins(struct component *c)
{
    const struct pins *p = c->pin;
    struct drv_counters count;
    *p->ready = ready(c);
    *p->driving = c->drive && ready(c);
    *p->fault = c->out.fault != 0;
    *p->fault_code = c->out.fault;
    *p->fault_joints = c->out.fault_joints;
    if (c->bus->counters(c->arm, &count) == HDT_OK) {
        *p->received = (hal_u32_t)count.received;
        *p->lost = (hal_u32_t)count.lost;
    }
    for (unsigned j = 0; j < c->info.joints; j++) {
        const struct joint_pins *k = &p->joint[j];
        *k->q = RAD(c->out.q[j].raw);
        *k->v = RAD(c->out.v[j].raw);
        *k->torque = NM(c->out.total[j].raw);
        *k->limit = c->out.limit[j];
        for (int t = 0; t < HDT_TERMS; t++)
            *k->term[t] = NM(c->out.term[t][j].raw);
    }
}

/* hdt.update: one period. */
static void update(void *arg, long period_ns)
{
    struct component *c = arg;
    long off = period_ns - (long)c->info.period_ns;
    if (!c->wrong_period && (off > period_ns / 100 || off < -period_ns / 100)) {
        c->wrong_period = 1;
        rtapi_print_msg(RTAPI_MSG_ERR,
                        "hdt: thread of %ld ns, but the tables are for %lu ns: the arm stays braked; make "
                        "period1 of the thread, or control.rate of the model file, the same\n",
                        period_ns, (unsigned long)c->info.period_ns);
    }
    read_clear(c);
    read_enable(c);
    read_references(c);
    c->in.t_us = (uint64_t)rtapi_get_time() / 1000u;
    /* a period that fails has put the brakes on; the pins keep what was last known */
    c->failed = c->bus->period(c->arm, &c->in, &c->next) != HDT_OK;
    if (!c->failed)
        c->out = c->next;
    c->seen |= c->in.fresh;
    write_pins(c);
}

static int joint_pins(struct component *c, unsigned j)
{
    struct joint_pins *k = &c->pin->joint[j];
    const struct { hal_pin_dir_t dir; hal_float_t **pin; const char *name; } list[] = {
        {HAL_IN, &k->q_ref, "q-ref"}, {HAL_IN, &k->v_ref, "v-ref"}, {HAL_IN, &k->a_ref, "a-ref"},
        {HAL_OUT, &k->q, "q"}, {HAL_OUT, &k->v, "v"}, {HAL_OUT, &k->torque, "torque"},
    };
    int e = 0;
    for (unsigned n = 0; n < sizeof list / sizeof list[0]; n++)
        e |= hal_pin_float_newf(list[n].dir, list[n].pin, c->id, "hdt.%u.%s", j, list[n].name);
    for (int t = 0; t < HDT_TERMS; t++)
        e |= hal_pin_float_newf(HAL_OUT, &k->term[t], c->id, "hdt.%u.term-%s", j, hdt_term_str(t));
    return e | hal_pin_u32_newf(HAL_OUT, &k->limit, c->id, "hdt.%u.limit", j);
}

static int make_pins(struct component *c)
{
    struct pins *p = hal_malloc(sizeof *p);
    if (p == NULL)
        return -ENOMEM;
    memset(p, 0, sizeof *p);
    c->pin = p;
    const struct { hal_pin_dir_t dir; hal_bit_t **pin; const char *name; } bits[] = {
        {HAL_IN, &p->enable, "enable"}, {HAL_IN, &p->velocity_mode, "velocity-mode"},
        {HAL_IN, &p->clear, "clear"}, {HAL_OUT, &p->ready, "ready"},
        {HAL_OUT, &p->driving, "driving"}, {HAL_OUT, &p->fault, "fault"},
    };
    const struct { hal_u32_t **pin; const char *name; } words[] = {
        {&p->fault_code, "fault-code"}, {&p->fault_joints, "fault-joints"},
        {&p->received, "received"}, {&p->lost, "lost"},
    };
    int e = 0;
    for (unsigned n = 0; n < sizeof bits / sizeof bits[0]; n++)
        e |= hal_pin_bit_newf(bits[n].dir, bits[n].pin, c->id, "hdt.%s", bits[n].name);
    for (unsigned n = 0; n < sizeof words / sizeof words[0]; n++)
        e |= hal_pin_u32_newf(HAL_OUT, words[n].pin, c->id, "hdt.%s", words[n].name);
    for (unsigned j = 0; j < c->info.joints; j++)
        e |= joint_pins(c, j);
    return e != 0 ? e : hal_export_funct("hdt.update", update, c, 1, 0, c->id);
}

/* Image of the tables into the arm; a message and a negative errno when it cannot be. */
static int load_tables(struct component *c, char *why, size_t len)
{
    uint8_t *image = malloc(IMAGE_MAX);
    FILE *f = tables != NULL ? fopen(tables, "rb") : NULL;
    int e = -ENOENT;
    if (f == NULL || image == NULL) {
        snprintf(why, len, "tables=%s: cannot be read: expected an image by `hdt gen ARM.toml --out DIR`",
                 tables != NULL ? tables : "(not given)");
    } else {
        size_t n = fread(image, 1, IMAGE_MAX, f);
        e = c->plugin->load(c->arm, image, n, why, len) == HDT_OK ? 0 : -EINVAL;
    }
    if (f != NULL)
        fclose(f);
    free(image);
    return e;
}

/* Everything up to a running arm.  What was begun is undone by take_down. */
static int set_up(struct component *c, char *why, size_t len)
{
    static const struct hdt_plugin_host me = HDT_PLUGIN_HOST;
    void *memory = calloc(1, c->plugin->memory_bytes);
    int e = memory != NULL ? c->plugin->create(&me, memory, c->plugin->memory_bytes, &c->arm)
                           : HDT_PLUGIN_ERR_MEMORY;
    if (e != HDT_OK) {
        snprintf(why, len, "%s", c->plugin->strerror(e));
        free(memory);
        return -ENOMEM;
    }
    if ((e = load_tables(c, why, len)) != 0)
        return e;
    if (c->bus->open(c->arm, bus != NULL ? bus : "", DRV_FORMAT_A, NULL, why, len) != HDT_OK)
        return -ENODEV;
    (void)c->plugin->info(c->arm, &c->info); /* it is loaded */
    c->in.active = (1u << c->info.joints) - 1u;
    e = c->plugin->start(c->arm);
    snprintf(why, len, "%s", c->plugin->strerror(e));
    return e == HDT_OK ? 0 : -EINVAL;
}

static void take_down(struct component *c)
{
    /* first: it takes hdt.update out of its thread */
    if (c->id > 0)
        hal_exit(c->id);
    if (c->plugin->state(c->arm) == HDT_PLUGIN_RUNNING && c->plugin->stop(c->arm) != HDT_OK)
        rtapi_print_msg(RTAPI_MSG_ERR,
                        "hdt: the servo did not confirm the end: make sure that its brakes are on\n");
    if (c->arm != NULL)
        (void)c->plugin->destroy(c->arm);
    free(c->arm);
    free(c);
}

int rtapi_app_main(void)
{
    char why[512] = "";
    struct component *c = calloc(1, sizeof *c);
    if (c == NULL)
        return -ENOMEM;
    c->plugin = &hdt_plugin_entry;
    c->bus = c->plugin->extension(HDT_PLUGIN_EXT_BUS);
    c->id = hal_init("hdt");
    int e = c->id < 0 ? c->id : set_up(c, why, sizeof why);
    if (e == 0 && (e = make_pins(c)) != 0)
        snprintf(why, sizeof why, "pins cannot be made");
    if (e != 0) {
        rtapi_print_msg(RTAPI_MSG_ERR, "hdt: %s\n", why);
        take_down(c);
        return e;
    }
    the = c;
    hal_ready(c->id);
    return 0;
}

void rtapi_app_exit(void)
{
    take_down(the);
    the = NULL;
}
