/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The plugin: one symbol by which a servo host loads the core at run time, and drives one arm or
 * several through plain structs.
 *
 *     const struct hdt_plugin *p = dlsym(dlopen("libhdt.so.0", RTLD_NOW), HDT_PLUGIN_SYMBOL);
 *
 * Life of an arm.  A call not in its row does nothing and returns HDT_PLUGIN_ERR_STATE:
 *
 *     state      legal calls (besides those that are legal always: state, strerror, extension)
 *     NONE       create -> CREATED
 *     CREATED    load -> LOADED, destroy -> NONE
 *     LOADED     load, info, start -> RUNNING, destroy -> NONE;        bus: open, close
 *     RUNNING    info, clear, stop -> LOADED;  step (no bus is open);  bus: period, restart, counters
 *
 * A thread tag stands before every function:
 *     [main]  may allocate and block: set-up and end, never in the cycle
 *     [rt]    the control thread: never allocates, locks, blocks or prints
 *     [any]   any thread at any time
 * Calls of [main] and [rt] for one arm (but info) must not overlap; one that comes while another runs
 * does nothing and returns HDT_PLUGIN_ERR_BUSY.  Arms are independent of each other.
 *
 * Growth: a new function is a new member at the end, and minor goes up; whatever else changes
 * raises major.  A host asks for what is optional by extension id, "name/revision"; an id that is
 * not there gives NULL.
 *
 * Owns: this ABI.
 * Never: keeps data of its own; all memory is the caller's.
 */
#ifndef HDT_PLUGIN_H
#define HDT_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#include "ctrl/hdt.h"
#include "driver/drv_cycle.h"

#ifdef __cplusplus
extern "C" {
#endif

#define HDT_PLUGIN_SYMBOL "hdt_plugin_entry"
#define HDT_PLUGIN_ABI_MAJOR 1
#define HDT_PLUGIN_ABI_MINOR 0
#define HDT_PLUGIN_ABI_PATCH 0

struct hdt_plugin_version {
    uint32_t major, minor, patch;
};

enum hdt_plugin_state {
    HDT_PLUGIN_NONE = 0,    /* no arm in this memory            */
    HDT_PLUGIN_CREATED = 1, /* memory taken, no tables          */
    HDT_PLUGIN_LOADED = 2,  /* tables checked, core at rest     */
    HDT_PLUGIN_RUNNING = 3  /* the control thread may step      */
};

/* Errors of the core (enum hdt_err) pass through; these are added. */
enum hdt_plugin_err {
    HDT_PLUGIN_ERR_STATE = -20,   /* not legal in this state: the table above                  */
    HDT_PLUGIN_ERR_BUSY = -21,    /* another call of this arm is running                       */
    HDT_PLUGIN_ERR_VERSION = -22, /* host and plugin were built against ABIs that do not agree */
    HDT_PLUGIN_ERR_MEMORY = -23,  /* memory too small, misaligned or not zeroed                */
    HDT_PLUGIN_ERR_IMAGE = -24,   /* not a table image this core takes                         */
    HDT_PLUGIN_ERR_BUS = -25      /* the bus: cannot be opened, or did not confirm the end     */
};

/* What the host was built against; filled in by HDT_PLUGIN_HOST. */
struct hdt_plugin_host {
    struct hdt_plugin_version abi;
    uint32_t in_bytes, out_bytes;   /* sizeof struct hdt_in, hdt_out */
};
#define HDT_PLUGIN_HOST                                                               \
    {                                                                                 \
        {HDT_PLUGIN_ABI_MAJOR, HDT_PLUGIN_ABI_MINOR, HDT_PLUGIN_ABI_PATCH},           \
        (uint32_t)sizeof(struct hdt_in), (uint32_t)sizeof(struct hdt_out)             \
    }

/* About the loaded arm. */
struct hdt_plugin_info {
    char name[32];
    uint32_t joints;
    uint32_t period_ns;             /* the tables' control period */
    uint8_t digest[32];             /* SHA-256 of the model file the tables came from */
};

struct hdt_plugin_arm;              /* lives in the caller's memory */

struct hdt_plugin {
    struct hdt_plugin_version abi;  /* stays first in every version */
    uint32_t plugin_bytes;          /* of this struct; members beyond it are not there */
    struct hdt_plugin_version library;
    uint32_t tables_layout;         /* of the images that load takes */
    uint32_t in_bytes, out_bytes;
    size_t memory_bytes;            /* one arm takes */
    size_t memory_align;
    const char *id;                 /* "hdt-servo.arm", for lists of plugins */

    /* [main] Take zeroed memory of memory_bytes for an arm; it stays the caller's and must stay
     * where it is until destroy, which leaves it zeroed.
     * Errors: HDT_ERR_ARG, _VERSION (compare p->abi, in_bytes, out_bytes with the host's), _MEMORY,
     * _STATE (there is an arm in it); *arm is then NULL. */
    int (*create)(const struct hdt_plugin_host *host, void *memory, size_t bytes,
                  struct hdt_plugin_arm **arm);

    /* [main] Check and copy a .hdtm image (`hdt gen`).  Tables loaded before are replaced.
     * Errors: HDT_ERR_ARG, _IMAGE, _STATE, also while a bus is open, _BUSY; each with one line in err
     * (may be NULL): what and where.  After _IMAGE the arm is CREATED. */
    int (*load)(struct hdt_plugin_arm *arm, const uint8_t *image, size_t bytes, char *err, size_t errlen);

    /* [main] What was loaded; may overlap with [rt].  Errors: HDT_ERR_ARG, _STATE. */
    int (*info)(const struct hdt_plugin_arm *arm, struct hdt_plugin_info *info);

    /* [main] The core as after hdt_init: no fault, no memory of an earlier run.
     * Errors: HDT_ERR_ARG, _STATE, _BUSY. */
    int (*start)(struct hdt_plugin_arm *arm);

    /* [rt] One period: hdt_step, for a host that has its own bus.
     * Errors: those of hdt_step, _STATE, _BUSY; *out (if given) is then all zero: no digits. */
    int (*step)(struct hdt_plugin_arm *arm, const struct hdt_in *in, struct hdt_out *out);

    /* [rt] hdt_clear: forget latched faults, between periods.  Errors: HDT_ERR_ARG, _STATE, _BUSY. */
    int (*clear)(struct hdt_plugin_arm *arm);

    /* [main] End of the run.  With a bus: 'E', so that the servo puts its brakes on, repeated until
     * answered, 0.2 s at most (and the wake-up after it).  The arm is LOADED afterwards, whatever is
     * returned.
     * Errors: HDT_ERR_ARG, _STATE, _BUSY, _BUS: nobody confirmed the end. */
    int (*stop)(struct hdt_plugin_arm *arm);

    /* [main] Give the memory back, zeroed; an open bus is closed.  A running arm is not destroyed.
     * Errors: HDT_ERR_ARG, _STATE, _BUSY. */
    int (*destroy)(struct hdt_plugin_arm *arm);

    /* [any] enum hdt_plugin_state; NULL is NONE. */
    int (*state)(const struct hdt_plugin_arm *arm);

    /* [any] One line for people about an error of this ABI; never NULL. */
    const char *(*strerror)(int err);

    /* [any] The struct of an extension, or NULL when the id or its revision is not known. */
    const void *(*extension)(const char *id);
};

/* Names of bits and terms, lower case; never NULL. */
#define HDT_PLUGIN_EXT_NAMES "hdt.names/1"
struct hdt_plugin_names {
    const char *(*fault)(uint32_t one_bit);  /* [any] */
    const char *(*limit)(uint32_t one_bit);  /* [any] */
    const char *(*term)(int term);           /* [any] */
};

/* The PA-10's telegrams over one of the driver's buses, in place of step. */
#define HDT_PLUGIN_EXT_BUS "hdt.bus/1"
struct hdt_plugin_bus {
    /* [main] hdt_bus_open as the host's side, and the telegrams' format; rated_mnm as
     * drv_cycle_set_format has it, NULL with Format A.
     * Errors: HDT_ERR_ARG (also: more joints than a telegram has axes), _STATE (not LOADED, or a bus
     * is open), _BUSY, _BUS (also: a bus that cannot carry the format), each with one line in err (may be
     * NULL). */
    int (*open)(struct hdt_plugin_arm *arm, const char *name, enum drv_format format,
                const uint16_t *rated_mnm, char *err, size_t errlen);

    /* [rt] drv_cycle_period: receive, step, send.
     * Errors: those of drv_cycle_period, _STATE (not RUNNING, or no bus), _BUSY; *out (if given) is
     * then all zero. */
    int (*period)(struct hdt_plugin_arm *arm, struct hdt_in *in, struct hdt_out *out);

    /* [rt] Counters of this run, between periods.  Errors: HDT_ERR_ARG, _STATE, _BUSY. */
    int (*counters)(struct hdt_plugin_arm *arm, struct drv_counters *count);

    /* [rt] drv_cycle_restart: ask for control mode again, between periods, after the servo left it (an
     * alarm, its watchdog).  Latched core faults stay: clear.  Errors: HDT_ERR_ARG, _STATE, _BUSY. */
    int (*restart)(struct hdt_plugin_arm *arm);

    /* [main] Errors: HDT_ERR_ARG, _STATE (not LOADED, or no bus), _BUSY. */
    int (*close)(struct hdt_plugin_arm *arm);
};

/* The one symbol a host looks up. */
extern const struct hdt_plugin hdt_plugin_entry;

#ifdef __cplusplus
}
#endif
#endif
