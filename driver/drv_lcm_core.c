/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a core's memory can hold, asked of bytes that came out of a file.
 *
 * The core adds and multiplies by these bounds and keeps them itself, period after period; it does not ask
 * again.  Each is where the core clamps, next to the member.
 *
 * Owns: the list.
 * Never: mends a value.
 */
#include "driver/drv_lcm.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

/* A signed member of one joint, in every joint `step` bytes on. */
struct bound {
    const char *name;
    size_t at, step, size;
    int64_t lo, hi;
};
#define BOUND(name, array, first, lo, hi)                                                          \
    {name, offsetof(hdt_t, first), sizeof ((hdt_t *)0)->array[0], sizeof ((hdt_t *)0)->first, lo, hi}
#define WITHIN(name, array, first, most) BOUND(name, array, first, -(most), most)
#define BIT(n) ((int64_t)1 << (n))

/* What is not here may be anything: times, counts and ages are unsigned, or are taken modulo 2^32. */
static const struct bound bounds[] = {
    WITHIN("vel.x_q24[0]", vel, vel[0].x_q24[0], INT32_MAX), /* hdt_vel_difference: hdt_sat */
    WITHIN("vel.x_q24[1]", vel, vel[0].x_q24[1], INT32_MAX),
    WITHIN("vel.y_q24[0]", vel, vel[0].y_q24[0], INT32_MAX), /* hdt_vel_filter: hdt_sat */
    WITHIN("vel.y_q24[1]", vel, vel[0].y_q24[1], INT32_MAX),
    BOUND("vel.rest", vel, vel[0].rest, -BIT(27), BIT(27) - 1),
    WITHIN("obs.q_q40", obs, obs[0].q_q40, BIT(48)),         /* hdt_vel_observe */
    WITHIN("obs.v_q40", obs, obs[0].v_q40, BIT(47) - 1),
    WITHIN("obs.d_q32", obs, obs[0].d_q32, BIT(44)),
    WITHIN("obs.a_q16", obs, obs[0].a_q16, BIT(28)),         /* expect, as all below in hdt_core.c */
    WITHIN("dir", dir, dir[0], 1),                           /* pass_travel */
    BOUND("travel_q40", travel_q40, travel_q40[0], 0, BIT(46)),
    WITHIN("wound_q30", wound_q30, wound_q30[0], BIT(30)),   /* pass_windup */
    BOUND("cold_q30", cold_q30, cold_q30[0], 0, BIT(30)),    /* pass_time: from one, times a share */
};

static int64_t value_of(const hdt_t *core, const struct bound *b, unsigned joint)
{
    const uint8_t *at = (const uint8_t *)core + b->at + joint * b->step;
    int32_t narrow;
    int64_t wide;
    if (b->size == sizeof narrow) {
        memcpy(&narrow, at, sizeof narrow);
        return narrow;
    }
    memcpy(&wide, at, sizeof wide);
    return wide;
}

static int check(const hdt_t *core, const struct bound *b, unsigned joint, char *err, size_t errlen)
{
    const int64_t value = value_of(core, b, joint);
    if (value >= b->lo && value <= b->hi)
        return 0;
    (void)snprintf(err, errlen, "%s of joint %u is %" PRId64 ", expected %" PRId64 " to %" PRId64, b->name,
                   joint + 1, value, b->lo, b->hi);
    return -1;
}

/* Words of a bit per joint, or per fault. */
static int check_masks(const hdt_t *core, uint32_t joints, uint32_t terms, char *err, size_t errlen)
{
    const uint32_t all = ((uint32_t)1 << joints) - 1u;
    const uint32_t faults = HDT_FAULT_STALE | HDT_FAULT_SPEED | HDT_FAULT_FOLLOWING | HDT_FAULT_SERVO |
                            HDT_FAULT_REFERENCE;
    const struct { const char *name; uint32_t value, most; } masks[] = {
        {"seen", core->seen, all},
        {"observed", core->observed, core->seen},       /* observe: only joints seen */
        {"gate.fault", core->gate.fault, faults},
        {"gate.fault_joints", core->gate.fault_joints, core->gate.fault != 0 ? all : 0u},
    };
    for (unsigned n = 0; n < sizeof masks / sizeof masks[0]; n++) {
        if ((masks[n].value & ~masks[n].most) == 0)
            continue;
        (void)snprintf(err, errlen, "%s is 0x%" PRIx32 ", expected no bits but 0x%" PRIx32, masks[n].name,
                       masks[n].value, masks[n].most);
        return -1;
    }
    if (core->terms == terms)
        return 0;
    (void)snprintf(err, errlen, "terms is 0x%" PRIx32 ", 0x%" PRIx32 " in the tables", core->terms, terms);
    return -1;
}

int drv_lcm_check_core(const hdt_t *core, const hdt_t *fresh, char *err, size_t errlen)
{
    const struct hdt_tables *t = fresh->tables;
    if (check_masks(core, t->joints, fresh->terms, err, errlen) != 0)
        return -1;
    for (unsigned j = 0; j < t->joints; j++) {
        const struct bound digit = WITHIN("gate.digit", gate.digit, gate.digit[0], t->joint[j].dig_max);
        if (check(core, &digit, j, err, errlen) != 0)
            return -1;
        for (unsigned n = 0; n < sizeof bounds / sizeof bounds[0]; n++)
            if (check(core, &bounds[n], j, err, errlen) != 0)
                return -1;
    }
    return 0;
}
