/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Why a host is where it is, in words an operator can act on.
 *
 * Owns: the words.
 * Never: runs in the control thread.
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "driver/drv_host.h"

#define Q24 16777216.0

/* A line that fills up and then stays full. */
struct text {
    char *at;
    size_t left;
};

#ifdef __GNUC__
__attribute__((format(printf, 2, 3)))
#endif
static void add(struct text *t, const char *fmt, ...)
{
    va_list args;
    if (t->left <= 1)
        return;
    va_start(args, fmt);
    int n = vsnprintf(t->at, t->left, fmt, args);
    va_end(args);
    size_t took = n < 0 ? 0 : (size_t)n < t->left ? (size_t)n : t->left - 1;
    t->at += took;
    t->left -= took;
}

static void add_joints(struct text *t, uint32_t joints)
{
    for (unsigned j = 0; j < HDT_JOINTS_MAX; j++)
        if (joints >> j & 1u) {
            add(t, " %u", j + 1);
        }
}

static void add_alarms(struct text *t, const struct drv_host_fault *f)
{
    unsigned driver = (f->driver_status & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT;
    if (driver != 0)
        add(t, "; servo driver: %s (0x%02x)", drv_driver_alarm_str(driver), driver);
    for (unsigned j = 0; j < DRV_AXES; j++) {
        unsigned alarm = (f->status[j] & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT;
        if (alarm != 0)
            add(t, "; axis %u: %s (0x%02x)", j + 1, drv_alarm_str(alarm), alarm);
        else if (f->unpowered >> j & 1u)
            add(t, "; axis %u: servo %s though told on: did it leave control mode?", j + 1,
                f->status[j] & DRV_AXIS_POWER_OFF ? "power off" : "uncontrollable");
    }
}

/* One fault bit with the joint, the value and the limit it passed. */
static void add_fault(struct text *t, const struct drv_host_fault *f, uint32_t bit,
                      const struct hdt_tables *tab)
{
    add(t, " %s", hdt_fault_str(bit));
    if (bit == HDT_FAULT_STALE)
        add(t, ": no state from the servo for more than %lu periods of %.3f ms",
            (unsigned long)tab->stale_periods, tab->period_ns * 1e-6);
    if (bit == HDT_FAULT_SERVO)
        add_alarms(t, f);
    for (unsigned j = 0; j < tab->joints; j++) {
        const struct hdt_joint_tab *k = &tab->joint[j];
        if ((f->joints >> j & 1u) == 0)
            continue;
        if (bit == HDT_FAULT_SPEED)
            add(t, ": joint %u at %.3f rad/s, limit %.3f", j + 1, f->v[j].raw / Q24, k->v_max_q24 / Q24);
        if (bit == HDT_FAULT_FOLLOWING)
            add(t, ": joint %u at %.4f rad, reference %.4f, limit %.4f apart", j + 1, f->q[j].raw / Q24,
                f->q_ref[j].raw / Q24, k->follow_max_q24 / Q24);
        if (bit == HDT_FAULT_FOLLOWING && (f->q[j].raw > k->q_max_q24 || f->q[j].raw < k->q_min_q24))
            add(t, " and outside its range, %.4f to %.4f: bring it back by hand, its brake released",
                k->q_min_q24 / Q24, k->q_max_q24 / Q24);
        if (bit == HDT_FAULT_REFERENCE)
            add(t, ": joint %u reference %.4f rad, limits %.4f to %.4f", j + 1, f->q_ref[j].raw / Q24,
                k->q_min_q24 / Q24, k->q_max_q24 / Q24);
    }
}

static void add_faults(struct text *t, const struct drv_host_status *s, const struct hdt_tables *tab)
{
    for (uint32_t bit = 1; bit != 0; bit <<= 1)
        if (s->fault.fault & bit)
            add_fault(t, &s->fault, bit, tab);
    add(t, ", at %.3f s", (double)s->fault.t_us * 1e-6);
}

static const char *late(enum drv_host_request ask)
{
    return ask == DRV_HOST_ASK_HOLD_LATE || ask == DRV_HOST_ASK_STOP_LATE
               ? "too many periods were missed (overrun policy)" : "asked for";
}

static void add_brakes(struct text *t, const struct drv_host_status *s)
{
    add(t, s->end_confirmed ? " brakes on"
                            : " the servo did not confirm the end: make sure that its brakes are on");
}

void drv_host_say(const struct drv_host_status *s, const struct hdt_tables *tab, char *line, size_t len)
{
    struct text t = {line, len};
    if (len == 0)
        return;
    line[0] = '\0';
    add(&t, "%s:", drv_host_phase_str(s->phase));
    switch (s->phase) {
    case DRV_HOST_IDLE:
        if (s->link != DRV_LINK_RUNNING)
            add(&t, " brakes on; the servo has not answered 'S': is it on, and on this bus?");
        else {
            add(&t, " brakes on; waiting for a first state of joints");
            add_joints(&t, s->active & ~s->seen);
        }
        break;
    case DRV_HOST_READY:
        add(&t, " brakes on; every joint has reported; go starts the motion");
        break;
    case DRV_HOST_APPROACH:
        add(&t, " moving to where the reference starts");
        break;
    case DRV_HOST_RUN:
        add(&t, " following the reference, sample %u of %u", s->sample, s->samples);
        break;
    case DRV_HOST_HOLD:
        if (s->sample >= s->samples)
            add(&t, " standing at the end of the reference, held by torque");
        else
            add(&t, " standing at sample %u of %u, held by torque; %s; go resumes, stop ends", s->sample,
                s->samples, late(s->asked));
        break;
    case DRV_HOST_FAULT:
        add_faults(&t, s, tab);
        add(&t, "; brakes on; remove the cause, then clear");
        break;
    case DRV_HOST_ENDING:
        add(&t, " brakes on; waiting for the servo to confirm the end");
        break;
    case DRV_HOST_DONE:
        add_brakes(&t, s);
        add(&t, "; %s", s->sample >= s->samples ? "the reference was followed to its end" : late(s->asked));
        break;
    case DRV_HOST_FAULTED:
        add_faults(&t, s, tab);
        add(&t, ";");
        add_brakes(&t, s);
        break;
    case DRV_HOST_SILENT:
        if (s->count.received > 0 || s->count.bad_frames > 0)
            add(&t,
                " the servo never sent a state: %s, %llu frames that are no telegram of this format came; "
                "does it speak the other format (--format)?",
                s->count.received > 0 ? "'S' was answered, 'C' was not" : "'S' was not answered",
                (unsigned long long)s->count.bad_frames);
        else
            add(&t, " the servo never answered: expected a state telegram soon after 'S'; is it running on "
                    "this bus?");
        break;
    }
    if (s->errors != 0)
        add(&t, "; %llu periods were refused and not driven: %s", (unsigned long long)s->errors,
            hdt_strerror(s->error));
}
