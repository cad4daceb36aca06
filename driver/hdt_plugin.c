/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The plugin ABI over core and cycle.  See hdt_plugin.h for the table of states.
 *
 * Owns: who may call what when.
 * Never: allocates for an arm; what the bus needs is hdt_bus_open's, before the cycle.
 */
#include "driver/hdt_plugin.h"

#include <stdio.h>
#include <string.h>

#define MAGIC 0x6864745f61726d31u /* "hdt_arm1" */
#define END_NS 200000000u         /* so long for an answer to 'E', */
#define END_LOOK_NS 1000000u      /* looked for so often,          */
#define END_LOOKS 10u             /* and 'E' again after so many   */

struct hdt_plugin_arm {
    uint64_t magic;
    int state;                    /* enum hdt_plugin_state; read by any thread */
    int busy;                     /* a call is running */
    int has_bus;
    enum drv_format format;
    uint16_t rated_mnm[DRV_AXES];
    struct hdt_bus bus;
    struct drv_cycle cycle;
    struct hdt_tables tables;
};

/* What malloc would align to. */
union most_aligned {
    uint64_t u;
    double d;
    void *p;
};
struct with_aligned {
    char c;
    union most_aligned m;
};

static int state_of(const struct hdt_plugin_arm *arm)
{
    if (arm == NULL || arm->magic != MAGIC)
        return HDT_PLUGIN_NONE;
    return __atomic_load_n(&arm->state, __ATOMIC_ACQUIRE);
}

static void set_state(struct hdt_plugin_arm *arm, int state)
{
    __atomic_store_n(&arm->state, state, __ATOMIC_RELEASE);
}

static void leave(struct hdt_plugin_arm *arm)
{
    __atomic_store_n(&arm->busy, 0, __ATOMIC_RELEASE);
}

/* Begin a call that is legal in states of this mask (bit per state); 0, and leave() is due. */
static int enter(struct hdt_plugin_arm *arm, unsigned legal)
{
    if (arm == NULL)
        return HDT_ERR_ARG;
    if (arm->magic != MAGIC)
        return HDT_PLUGIN_ERR_STATE;
    if (__atomic_exchange_n(&arm->busy, 1, __ATOMIC_ACQUIRE) != 0)
        return HDT_PLUGIN_ERR_BUSY;
    if ((legal >> state_of(arm) & 1u) != 0)
        return HDT_OK;
    leave(arm);
    return HDT_PLUGIN_ERR_STATE;
}

#define IN(state) (1u << HDT_PLUGIN_##state)

static int plugin_create(const struct hdt_plugin_host *host, void *memory, size_t bytes,
                         struct hdt_plugin_arm **arm)
{
    struct hdt_plugin_arm *a = memory;
    if (arm != NULL)
        *arm = NULL;
    if (host == NULL || memory == NULL || arm == NULL)
        return HDT_ERR_ARG;
    if (host->abi.major != HDT_PLUGIN_ABI_MAJOR || host->abi.minor > HDT_PLUGIN_ABI_MINOR ||
        host->in_bytes != sizeof(struct hdt_in) || host->out_bytes != sizeof(struct hdt_out))
        return HDT_PLUGIN_ERR_VERSION;
    if (bytes < sizeof *a || (uintptr_t)memory % offsetof(struct with_aligned, m) != 0)
        return HDT_PLUGIN_ERR_MEMORY;
    if (a->magic != 0)
        return a->magic == MAGIC ? HDT_PLUGIN_ERR_STATE : HDT_PLUGIN_ERR_MEMORY;
    memset(a, 0, sizeof *a);
    a->magic = MAGIC;
    set_state(a, HDT_PLUGIN_CREATED);
    *arm = a;
    return HDT_OK;
}

static const char *plugin_strerror(int err)
{
    switch (err) {
    case HDT_PLUGIN_ERR_STATE: return "not legal in this state of the arm";
    case HDT_PLUGIN_ERR_BUSY: return "another call of this arm is running";
    case HDT_PLUGIN_ERR_VERSION: return "host and plugin were built against different ABIs";
    case HDT_PLUGIN_ERR_MEMORY: return "memory too small, misaligned or not zeroed";
    case HDT_PLUGIN_ERR_IMAGE: return "not a table image this core takes";
    case HDT_PLUGIN_ERR_BUS: return "the bus cannot be opened, or the servo did not confirm the end";
    default: return hdt_strerror(err);
    }
}

/* A line into err, if there is room for one, and e back. */
static int refuse(int e, const char *line, char *err, size_t errlen)
{
    if (err != NULL && errlen > 0)
        (void)snprintf(err, errlen, "%s", line);
    return e;
}

/* What is wrong with an image, in one line. */
static void explain_image(int e, const struct hdt_tables *t, size_t bytes, char *err, size_t errlen)
{
    const char *where = "";
    char at[24] = "";
    int joint = -1;
    if (err == NULL || errlen == 0)
        return;
    if (e == HDT_TABLES_VERSION) {
        (void)snprintf(err, errlen, "tables: layout %lu, this core reads %lu: make them anew with hdt gen",
                       (unsigned long)t->layout, (unsigned long)HDT_TABLES_LAYOUT);
        return;
    }
    if (e == HDT_TABLES_RANGE)
        (void)hdt_tables_check(t, &where, &joint);
    if (joint >= 0)
        (void)snprintf(at, sizeof at, " of joint %d", joint + 1);
    (void)snprintf(err, errlen, "tables of %lu bytes: %s%s%s%s; expected an image as hdt gen writes it",
                   (unsigned long)bytes, hdt_tables_strerror(e), *where ? ": " : "", where, at);
}

static int plugin_load(struct hdt_plugin_arm *arm, const uint8_t *image, size_t bytes, char *err,
                       size_t errlen)
{
    int e = enter(arm, IN(CREATED) | IN(LOADED));
    if (e != HDT_OK)
        return refuse(e, plugin_strerror(e), err, errlen);
    if (image == NULL) {
        e = refuse(HDT_ERR_ARG, "tables: no image: null pointer", err, errlen);
    } else if (arm->has_bus) {
        e = refuse(HDT_PLUGIN_ERR_STATE, "tables: a bus is open: close it first", err, errlen);
    } else {
        e = hdt_tables_read(image, bytes, &arm->tables);
        if (e != 0)
            explain_image(e, &arm->tables, bytes, err, errlen);
        set_state(arm, e == 0 ? HDT_PLUGIN_LOADED : HDT_PLUGIN_CREATED);
        e = e == 0 ? HDT_OK : HDT_PLUGIN_ERR_IMAGE;
    }
    leave(arm);
    return e;
}

static int plugin_info(const struct hdt_plugin_arm *arm, struct hdt_plugin_info *info)
{
    int state = state_of(arm);
    if (arm == NULL || info == NULL)
        return HDT_ERR_ARG;
    if (state != HDT_PLUGIN_LOADED && state != HDT_PLUGIN_RUNNING)
        return HDT_PLUGIN_ERR_STATE;
    memcpy(info->name, arm->tables.name, sizeof info->name);
    memcpy(info->digest, arm->tables.digest, sizeof info->digest);
    info->joints = arm->tables.joints;
    info->period_ns = arm->tables.period_ns;
    return HDT_OK;
}

static int plugin_start(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(LOADED));
    if (e != HDT_OK)
        return e;
    if (arm->has_bus) {
        e = drv_cycle_init(&arm->cycle, &arm->tables, &arm->bus, NULL);
        if (e == HDT_OK)
            e = drv_cycle_set_format(&arm->cycle, arm->format, arm->rated_mnm);
    } else {
        e = hdt_init(&arm->cycle.core, &arm->tables);
    }
    if (e == HDT_OK)
        set_state(arm, HDT_PLUGIN_RUNNING);
    leave(arm);
    return e;
}

static int plugin_step(struct hdt_plugin_arm *arm, const struct hdt_in *in, struct hdt_out *out)
{
    int e = enter(arm, IN(RUNNING));
    if (e == HDT_OK) {
        e = arm->has_bus ? HDT_PLUGIN_ERR_STATE : hdt_step(&arm->cycle.core, in, out);
        leave(arm);
    }
    if (e != HDT_OK && out != NULL)
        memset(out, 0, sizeof *out);
    return e;
}

static int plugin_clear(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(RUNNING));
    if (e != HDT_OK)
        return e;
    e = hdt_clear(&arm->cycle.core);
    leave(arm);
    return e;
}

/* 'E' until it is answered, or END_NS have passed. */
static int end_run(struct drv_cycle *c)
{
    struct hdt_clock clock = hdt_clock_posix();
    uint64_t now = clock.now_ns(clock.ctx), end = now + END_NS;
    for (unsigned n = 0; now < end; n++, now = clock.now_ns(clock.ctx)) {
        if (n % END_LOOKS == 0)
            (void)drv_cycle_end(c);
        (void)clock.sleep_until_ns(clock.ctx, now + END_LOOK_NS < end ? now + END_LOOK_NS : end);
        if (drv_cycle_ended(c))
            return HDT_OK;
    }
    return HDT_PLUGIN_ERR_BUS;
}

static int plugin_stop(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(RUNNING));
    if (e != HDT_OK)
        return e;
    if (arm->has_bus)
        e = end_run(&arm->cycle);
    set_state(arm, HDT_PLUGIN_LOADED);
    leave(arm);
    return e;
}

static int plugin_destroy(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(CREATED) | IN(LOADED));
    if (e != HDT_OK)
        return e;
    hdt_bus_close(&arm->bus);
    memset(arm, 0, sizeof *arm);
    return HDT_OK;
}

/* What bus_open asks before anything is opened. */
static int bus_check(struct hdt_plugin_arm *arm, const char *name, enum drv_format format,
                     const uint16_t *rated_mnm, char *err, size_t errlen)
{
    struct drv_cycle *c = &arm->cycle;
    if (arm->has_bus)
        return refuse(HDT_PLUGIN_ERR_STATE, "bus: one is open: close it first", err, errlen);
    if (name == NULL)
        return refuse(HDT_ERR_ARG, "bus: no name: null pointer", err, errlen);
    if (arm->tables.joints > DRV_AXES)
        return refuse(HDT_ERR_ARG, "bus: the arm has more joints than a telegram has axes, 7", err, errlen);
    /* the cycle itself says which format and torques it takes */
    c->core.tables = &arm->tables;
    if (drv_cycle_set_format(c, format, rated_mnm) != HDT_OK)
        return refuse(HDT_ERR_ARG, "bus: expected Format A, or Format B with rated torques above 0",
                      err, errlen);
    if (drv_telegram_fits(format, name, err, errlen) != DRV_TELEGRAM_OK)
        return HDT_PLUGIN_ERR_BUS;
    return HDT_OK;
}

static int bus_open(struct hdt_plugin_arm *arm, const char *name, enum drv_format format,
                    const uint16_t *rated_mnm, char *err, size_t errlen)
{
    int e = enter(arm, IN(LOADED));
    if (e != HDT_OK)
        return refuse(e, plugin_strerror(e), err, errlen);
    e = bus_check(arm, name, format, rated_mnm, err, errlen);
    if (e == HDT_OK && hdt_bus_open(&arm->bus, name, HDT_BUS_HOST, err, errlen) != HDT_BUS_OK)
        e = HDT_PLUGIN_ERR_BUS;
    if (e == HDT_OK) {
        arm->format = format;
        memcpy(arm->rated_mnm, arm->cycle.rated_mnm, sizeof arm->rated_mnm);
        arm->has_bus = 1;
    }
    leave(arm);
    return e;
}

static int bus_period(struct hdt_plugin_arm *arm, struct hdt_in *in, struct hdt_out *out)
{
    int e = enter(arm, IN(RUNNING));
    if (e == HDT_OK) {
        e = arm->has_bus ? drv_cycle_period(&arm->cycle, in, out) : HDT_PLUGIN_ERR_STATE;
        leave(arm);
    }
    if (e != HDT_OK && out != NULL)
        memset(out, 0, sizeof *out);
    return e;
}

static int bus_counters(struct hdt_plugin_arm *arm, struct drv_counters *count)
{
    int e = enter(arm, IN(RUNNING));
    if (e != HDT_OK)
        return e;
    if (count == NULL)
        e = HDT_ERR_ARG;
    else if (!arm->has_bus)
        e = HDT_PLUGIN_ERR_STATE;
    else
        *count = arm->cycle.count;
    leave(arm);
    return e;
}

static int bus_restart(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(RUNNING));
    if (e != HDT_OK)
        return e;
    if (arm->has_bus)
        drv_cycle_restart(&arm->cycle);
    else
        e = HDT_PLUGIN_ERR_STATE;
    leave(arm);
    return e;
}

static int bus_close(struct hdt_plugin_arm *arm)
{
    int e = enter(arm, IN(LOADED));
    if (e != HDT_OK)
        return e;
    if (arm->has_bus)
        hdt_bus_close(&arm->bus);
    else
        e = HDT_PLUGIN_ERR_STATE;
    arm->has_bus = 0;
    leave(arm);
    return e;
}

static const void *plugin_extension(const char *id)
{
    static const struct hdt_plugin_names names = {hdt_fault_str, hdt_limit_str, hdt_term_str};
    static const struct hdt_plugin_bus bus = {bus_open, bus_period, bus_counters, bus_restart, bus_close};
    if (id == NULL)
        return NULL;
    if (strcmp(id, HDT_PLUGIN_EXT_NAMES) == 0)
        return &names;
    if (strcmp(id, HDT_PLUGIN_EXT_BUS) == 0)
        return &bus;
    return NULL;
}

const struct hdt_plugin hdt_plugin_entry = {
    .abi = {HDT_PLUGIN_ABI_MAJOR, HDT_PLUGIN_ABI_MINOR, HDT_PLUGIN_ABI_PATCH},
    .plugin_bytes = sizeof(struct hdt_plugin),
    .library = {HDT_VERSION_MAJOR, HDT_VERSION_MINOR, HDT_VERSION_PATCH},
    .tables_layout = HDT_TABLES_LAYOUT,
    .in_bytes = sizeof(struct hdt_in),
    .out_bytes = sizeof(struct hdt_out),
    .memory_bytes = sizeof(struct hdt_plugin_arm),
    .memory_align = offsetof(struct with_aligned, m),
    .id = "hdt-servo.arm",
    .create = plugin_create,
    .load = plugin_load,
    .info = plugin_info,
    .start = plugin_start,
    .step = plugin_step,
    .clear = plugin_clear,
    .stop = plugin_stop,
    .destroy = plugin_destroy,
    .state = state_of,
    .strerror = plugin_strerror,
    .extension = plugin_extension,
};
