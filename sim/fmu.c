/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The arm and its servo driver as an FMI 3.0 co-simulation unit.
 *
 *   Instantiated --EnterInitializationMode--> Initialization --Exit--> Step --Terminate--> Terminated
 *   any --Reset--> Instantiated
 *
 * Time inside goes in ticks of 1/1504 s, counted from the start time.  A step ends at the last whole
 * tick not after its end, what is left of it is made up by the next: a run does not depend on how it is
 * cut into steps, but for when inputs change.  The servo driver is spoken to by its telegrams, one
 * before and one after every tick, so its watchdog never bites and commands have its digits.
 *
 * Owns: instances, their states, the order of calls.
 * Never: keeps anything outside an instance; lets a value through that is no number.
 */
#include "sim/fmi3.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/fmu.h"
#include "sim/servo.h"

enum { NAME_MAX_BYTES = 64, MESSAGE_MAX_BYTES = 300 };

static const double TURN_RAD = 6.283185307179586;
static const double TICK_SLACK = 1e-6;       /* of a tick: times are sums of steps */
static const double TIME_SLACK_S = 1e-9;     /* the same for a time, relative above 1 s */
static const double TICKS_MAX = 9007199254740992.0;
static const char ERRORS[] = "logStatusError", DISCARDS[] = "logStatusDiscard", ALARMS[] = "logAlarms";
static const char MAGIC[8] = "HDTFMU1";

enum phase { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, ANY = 15 };

/* Plain: a copy is a snapshot, but for servo.model, which points to the model beside it. */
struct state {
    enum phase phase;
    struct fmu_values values;
    bool begun;                              /* model and servo are those the parameters ask for */
    bool enabled;                            /* what the servo driver was told last */
    bool stop_defined;
    double start_s, stop_s;
    uint64_t ticks;
    uint8_t seq;
    struct plant_model model;
    struct servo servo;
};

struct instance {
    struct state s;
    char name[NAME_MAX_BYTES];
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    bool log_alarms;
};

/* What SerializeFMUState makes; the state follows. */
struct serial_head { char magic[8], token[96]; uint64_t size, sum; };

/* ---- messages ---- */

static fmi3Status say(const struct instance *u, fmi3Status status, const char *category, const char *format,
                      ...)
{
    char text[MESSAGE_MAX_BYTES];
    va_list args;
    if (u == NULL || u->log == NULL)
        return status;
    int used = snprintf(text, sizeof text, "%s: ", u->name);
    va_start(args, format);
    vsnprintf(text + used, sizeof text - (size_t)used, format, args);
    va_end(args);
    u->log(u->environment, status, category, text);
    return status;
}

static const char *phase_name(enum phase phase)
{
    return phase == INSTANTIATED ? "Instantiated" : phase == INITIALIZATION ? "Initialization Mode"
         : phase == STEP         ? "Step Mode"    : "Terminated";
}

/* fmi3OK when a call is legal now; else the message is out. */
static fmi3Status allow(const struct instance *u, const char *call, unsigned phases)
{
    if (u == NULL)
        return fmi3Error;
    if (u->s.phase & phases)
        return fmi3OK;
    return say(u, fmi3Error, ERRORS, "%s: not allowed in %s", call, phase_name(u->s.phase));
}

static fmi3Status not_offered(const struct instance *u, const char *call)
{
    return say(u, fmi3Error, ERRORS, "%s: not offered by this unit, as modelDescription.xml says", call);
}

/* ---- the arm ---- */

static int16_t digits(double value, double per_digit)
{
    double x = nearbyint(value / per_digit);
    return (int16_t)(x > INT16_MAX ? INT16_MAX : x < -INT16_MAX ? -INT16_MAX : x);
}

static void say_alarms(const struct instance *u, const struct drv_state *now, const uint16_t *before)
{
    if (!u->log_alarms)
        return;
    for (int i = 0; i < fmu_the_arm.joints; i++) {
        unsigned alarm = (now->axis[i].status & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT;
        if (alarm != 0 && alarm != (before[i] & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT)
            say(u, fmi3OK, ALARMS, "%s at %.6f s: alarm %02x, %s", fmu_the_arm.joint[i], u->s.servo.s.t_s,
                alarm,
                drv_alarm_str(alarm));
    }
}

static void take_outputs(struct instance *u, const struct drv_state *answer)
{
    struct fmu_values *v = &u->s.values;
    const struct plant_state *plant = &u->s.servo.plant;
    say_alarms(u, answer, v->status);
    v->driver_status = answer->driver_status;
    for (int i = 0; i < fmu_the_arm.joints; i++) {
        v->angle_rad[i] =
            answer->axis[i].count * (TURN_RAD / (SERVO_COUNTS_PER_REV * u->s.model.joint[i].ratio));
        v->reported_m_nm[i] = answer->axis[i].torque_dig * SERVO_TORQUE_NM_PER_DIG;
        v->status[i] = answer->axis[i].status;
        v->link_rad[i] = plant->q_rad[i];
        v->link_radps[i] = plant->qd_radps[i];
        v->gear_nm[i] = plant->gear_nm[i];
    }
}

/* One telegram down, its answer up; outputs only from the cyclic one. */
static void exchange(struct instance *u, enum drv_type type)
{
    static const uint8_t mode[] = { [FMU_BRAKE] = DRV_AXIS_BRAKE, [FMU_VELOCITY] = DRV_AXIS_SERVO,
                                    [FMU_TORQUE] = DRV_AXIS_SERVO | DRV_AXIS_TORQUE };
    const struct fmu_values *v = &u->s.values;
    struct drv_command c = { .seq = u->s.seq, .type = (uint8_t)type };
    struct drv_state answer;
    struct hdt_frame down, up;
    u->s.seq = (u->s.seq + 1) & 0x7f;
    for (int i = 0; i < DRV_AXES; i++) {
        c.axis[i].mode = i < fmu_the_arm.joints ? mode[v->mode[i]] : DRV_AXIS_BRAKE;
        c.axis[i].speed_dig = digits(v->speed_radps[i], SERVO_SPEED_RADPS_PER_DIG);
        c.axis[i].torque_dig = digits(v->torque_m_nm[i], SERVO_TORQUE_NM_PER_DIG);
    }
    if (drv_command_encode(DRV_FORMAT_A, &c, &down) == DRV_TELEGRAM_OK
        && servo_answer(&u->s.servo, &down, &up) == 1
        && drv_state_decode(DRV_FORMAT_A, &up, &answer) == DRV_TELEGRAM_OK && type == DRV_CYCLIC)
        take_outputs(u, &answer);
}

static void command(struct instance *u)
{
    if (u->s.values.enable != u->s.enabled)
        exchange(u, u->s.values.enable ? DRV_START : DRV_END);
    u->s.enabled = u->s.values.enable;
    exchange(u, DRV_CYCLIC);
}

static bool payload_is_the_files(const struct fmu_values *v)
{
    return v->payload_kg == fmu_the_arm.payload_kg && v->payload_m[0] == fmu_the_arm.payload_m[0]
           && v->payload_m[1] == fmu_the_arm.payload_m[1] && v->payload_m[2] == fmu_the_arm.payload_m[2];
}

static void set_payload(struct plant_model *model, const struct fmu_values *v)
{
    model->payload_kg = v->payload_kg;
    for (int i = 0; i < 3; i++) {
        model->payload_com_m[i] = fmu_the_arm.flange_m[i];
        for (int k = 0; k < 3; k++)
            model->payload_com_m[i] += fmu_the_arm.flange_rot[3 * i + k] * v->payload_m[k];
    }
    model->step_s = 0; /* to be chosen again */
}

/* The arm as the parameters have it, at rest; first telegrams exchanged. */
static fmi3Status begin(struct instance *u)
{
    const char *why = NULL;
    struct state *s = &u->s;
    if (s->begun)
        return fmi3OK;
    s->model = fmu_the_plant.model;
    if (!payload_is_the_files(&s->values)) {
        set_payload(&s->model, &s->values);
        if (plant_model_check(&s->model, &why) != 0)
            return say(u, fmi3Error, ERRORS, "no arm can be made from these parameters: %s", why);
    }
    servo_init(&s->servo, &s->model, NULL, s->values.start_rad, s->values.seed);
    s->enabled = false;
    s->seq = 0;
    s->begun = true;
    command(u);
    return fmi3OK;
}

static void reset(struct instance *u)
{
    memset(&u->s, 0, sizeof u->s);
    u->s.phase = INSTANTIATED;
    fmu_defaults(&fmu_the_arm, &u->s.values);
}

/* ---- life ---- */

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String category[])
{
    struct instance *u = instance;
    bool alarms = n == 0;
    if (u == NULL || (n > 0 && category == NULL))
        return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        bool known = false;
        for (int k = 0; k < 3; k++)
            known |= category[i] != NULL
                     && strcmp(category[i], k == 0 ? ERRORS : k == 1 ? DISCARDS : ALARMS) == 0;
        if (!known)
            return say(u, fmi3Error, ERRORS, "fmi3SetDebugLogging: expected %s, %s or %s, found \"%s\"",
                       ERRORS,
                       DISCARDS, ALARMS, category[i] != NULL ? category[i] : "");
        alarms |= strcmp(category[i], ALARMS) == 0;
    }
    if (alarms)
        u->log_alarms = on;
    return fmi3OK;
}

/* Why this unit cannot be had as asked for; NULL: it can. */
static const char *objection(fmi3String token, bool event_mode, size_t intermediates)
{
    if (token == NULL || strcmp(token, fmu_the_arm.token) != 0)
        return "the instantiation token is not this unit's: modelDescription.xml and binary are of "
               "different builds";
    if (event_mode)
        return "eventModeUsed: this unit has no event mode";
    if (intermediates > 0)
        return "requiredIntermediateVariables: this unit gives no intermediate updates";
    return NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resource_path,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                         fmi3Boolean early_return, const fmi3ValueReference intermediate[],
                                         size_t intermediates, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    struct instance draft = { .environment = environment, .log = log, .log_alarms = logging };
    struct instance *u;
    const char *why = objection(token, event_mode, intermediates);
    (void)resource_path, (void)visible, (void)early_return, (void)intermediate, (void)update;
    snprintf(draft.name, sizeof draft.name, "%s", name != NULL && name[0] != '\0' ? name : fmu_the_arm.name);
    u = why == NULL ? malloc(sizeof *u) : NULL;
    if (u == NULL) {
        say(&draft, fmi3Error, ERRORS, "fmi3InstantiateCoSimulation: %s", why != NULL ? why : "no memory");
        return NULL;
    }
    *u = draft;
    reset(u);
    return u;
}

static fmi3Instance other_kind(fmi3String name, fmi3InstanceEnvironment environment,
                               fmi3LogMessageCallback log)
{
    struct instance draft = { .environment = environment, .log = log };
    snprintf(draft.name, sizeof draft.name, "%s", name != NULL ? name : fmu_the_arm.name);
    say(&draft, fmi3Error, ERRORS, "this unit is for co-simulation only");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resource_path,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)token, (void)resource_path, (void)visible, (void)logging;
    return other_kind(name, environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resource_path,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)token, (void)resource_path, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    return other_kind(name, environment, log);
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start_s, fmi3Boolean stop_defined,
                                       fmi3Float64 stop_s)
{
    struct instance *u = instance;
    (void)tolerance_defined, (void)tolerance; /* the plant's own step has its accuracy */
    if (allow(u, "fmi3EnterInitializationMode", INSTANTIATED) != fmi3OK)
        return fmi3Error;
    if (!isfinite(start_s) || (stop_defined && !(isfinite(stop_s) && stop_s >= start_s)))
        return say(u, fmi3Error, ERRORS,
                   "fmi3EnterInitializationMode: expected start <= stop, found %g and %g s",
                   start_s, stop_s);
    u->s.phase = INITIALIZATION;
    u->s.values.time_s = u->s.start_s = start_s;
    u->s.stop_defined = stop_defined;
    u->s.stop_s = stop_s;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    struct instance *u = instance;
    if (allow(u, "fmi3ExitInitializationMode", INITIALIZATION) != fmi3OK || begin(u) != fmi3OK)
        return fmi3Error;
    u->s.phase = STEP;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    struct instance *u = instance;
    if (allow(u, "fmi3Terminate", STEP) != fmi3OK)
        return fmi3Error;
    u->s.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    struct instance *u = instance;
    if (u == NULL)
        return fmi3Error;
    reset(u);
    return fmi3OK;
}

static fmi3Status check_step(const struct instance *u, double now_s, double step_s)
{
    const struct state *s = &u->s;
    double slack_s = TIME_SLACK_S * fmax(1, fabs(s->values.time_s)), end_s = now_s + step_s;
    if (!(fabs(now_s - s->values.time_s) <= slack_s))
        return say(u, fmi3Error, ERRORS, "fmi3DoStep: expected to go on from %.9g s, found %.9g s",
                   s->values.time_s, now_s);
    if (!(step_s > 0 && (end_s - s->start_s) * SERVO_RATE_HZ < TICKS_MAX))
        return say(u, fmi3Error, ERRORS,
                   "fmi3DoStep: expected a step above 0 s, and a finite one, found %g s",
                   step_s);
    if (s->stop_defined && end_s > s->stop_s + slack_s)
        return say(u, fmi3Error, ERRORS, "fmi3DoStep: %.9g s is past the stop time, %.9g s", end_s,
                   s->stop_s);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now_s, fmi3Float64 step_s, fmi3Boolean no_set_before,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_s)
{
    struct instance *u = instance;
    (void)no_set_before;
    if (allow(u, "fmi3DoStep", STEP) != fmi3OK || check_step(u, now_s, step_s) != fmi3OK)
        return fmi3Error;
    double end_s = now_s + step_s;
    uint64_t until = (uint64_t)floor((end_s - u->s.start_s) * SERVO_RATE_HZ + TICK_SLACK);
    command(u);
    while (u->s.ticks < until) {
        servo_tick(&u->s.servo);
        u->s.ticks++;
        exchange(u, DRV_CYCLIC);
    }
    u->s.values.time_s = end_s;
    if (event_needed != NULL)
        *event_needed = false;
    if (terminate != NULL)
        *terminate = false;
    if (early_return != NULL)
        *early_return = false;
    if (last_s != NULL)
        *last_s = end_s;
    return fmi3OK;
}

/* ---- values ---- */

static fmi3Status find(const struct instance *u, const char *call, fmi3ValueReference reference,
                       enum fmu_type type, const struct fmu_kind **kind, int *joint)
{
    *kind = fmu_find(&fmu_the_arm, reference, joint);
    if (*kind == NULL)
        return say(u, fmi3Error, ERRORS, "%s: no variable has value reference %u", call, (unsigned)reference);
    if ((*kind)->type != type)
        return say(u, fmi3Error, ERRORS, "%s: variable %s (%u) is of another type", call, (*kind)->name,
                   (unsigned)reference);
    return fmi3OK;
}

static fmi3Status check_count(const struct instance *u, const char *call, const void *references, size_t n,
                              const void *values, size_t n_values)
{
    if (u == NULL)
        return fmi3Error;
    if (n != n_values || (n > 0 && (references == NULL || values == NULL)))
        return say(u, fmi3Error, ERRORS, "%s: %zu references with %zu values; no variable is an array", call,
                   n,
                   n_values);
    return fmi3OK;
}

static fmi3Status get(struct instance *u, const char *call, enum fmu_type type,
                      const fmi3ValueReference references[], size_t n, void *values, size_t n_values)
{
    char *to = values;
    if (check_count(u, call, references, n, values, n_values) != fmi3OK)
        return fmi3Error;
    for (size_t i = 0; i < n; i++, to += fmu_size(type)) {
        const struct fmu_kind *kind;
        int joint;
        if (find(u, call, references[i], type, &kind, &joint) != fmi3OK)
            return fmi3Error;
        if (kind->causality == FMU_OUTPUT
            && (allow(u, call, INITIALIZATION | STEP | TERMINATED) != fmi3OK || begin(u) != fmi3OK))
            return fmi3Error;
        memcpy(to, fmu_at(&u->s.values, kind, joint), fmu_size(type));
    }
    return fmi3OK;
}

static fmi3Status may_set(const struct instance *u, const char *call, const struct fmu_kind *kind)
{
    if (kind->causality == FMU_PARAMETER)
        return allow(u, call, INSTANTIATED | INITIALIZATION);
    if (kind->causality == FMU_INPUT)
        return allow(u, call, INSTANTIATED | INITIALIZATION | STEP);
    return say(u, fmi3Error, ERRORS, "%s: %s is neither parameter nor input", call, kind->name);
}

/* A value as a number, where it has limits or may be none. */
static fmi3Status in_range(const struct instance *u, const char *call, const struct fmu_kind *kind, int joint,
                           const void *value)
{
    const char *whose = kind->per_joint ? fmu_the_arm.joint[joint] : "", *dot = kind->per_joint ? "." : "";
    double x = 0, min, max;
    int64_t item;
    if (kind->type == FMU_FLOAT64) {
        memcpy(&x, value, sizeof x);
        if (!isfinite(x))
            return say(u, fmi3Discard, DISCARDS, "%s: %s%s%s: expected a finite number, found %g", call,
                       whose,
                       dot, kind->name, x);
    } else if (kind->type == FMU_ENUMERATION) {
        memcpy(&item, value, sizeof item);
        x = (double)item;
    }
    if (!fmu_limits(&fmu_the_plant.model, kind, joint, &min, &max) || (x >= min && x <= max))
        return fmi3OK;
    return say(u, fmi3Discard, DISCARDS, "%s: %s%s%s: expected %g to %g, found %g", call, whose, dot,
               kind->name, min, max, x);
}

/* All of the values or none. */
static fmi3Status set(struct instance *u, const char *call, enum fmu_type type,
                      const fmi3ValueReference references[], size_t n, const void *values, size_t n_values)
{
    const struct fmu_kind *kind;
    const char *from = values;
    int joint;
    if (check_count(u, call, references, n, values, n_values) != fmi3OK)
        return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (find(u, call, references[i], type, &kind, &joint) != fmi3OK || may_set(u, call, kind) != fmi3OK)
            return fmi3Error;
        if (in_range(u, call, kind, joint, from + i * fmu_size(type)) != fmi3OK)
            return fmi3Discard;
    }
    for (size_t i = 0; i < n; i++) {
        kind = fmu_find(&fmu_the_arm, references[i], &joint);
        memcpy(fmu_at(&u->s.values, kind, joint), from + i * fmu_size(type), fmu_size(type));
    }
    if (n > 0 && u->s.phase != STEP)
        u->s.begun = false;
    return fmi3OK;
}

/* Getter and setter of a type that has variables, and of one that has none. */
#define ACCESS(Name, type, kind)                                                                          \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,      \
                             type values[], size_t n_values)                                              \
    {                                                                                                     \
        return get(instance, "fmi3Get" #Name, kind, references, n, values, n_values);                     \
    }                                                                                                     \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,      \
                             const type values[], size_t n_values)                                        \
    {                                                                                                     \
        return set(instance, "fmi3Set" #Name, kind, references, n, values, n_values);                     \
    }
#define NO_ACCESS(Name, type)                                                                             \
    fmi3Status fmi3Get##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,      \
                             type values[], size_t n_values)                                              \
    {                                                                                                     \
        (void)references, (void)values, (void)n_values;                                                   \
        return no_variable(instance, "fmi3Get" #Name, n);                                                 \
    }                                                                                                     \
    fmi3Status fmi3Set##Name(fmi3Instance instance, const fmi3ValueReference references[], size_t n,      \
                             const type values[], size_t n_values)                                        \
    {                                                                                                     \
        (void)references, (void)values, (void)n_values;                                                   \
        return no_variable(instance, "fmi3Set" #Name, n);                                                 \
    }

static fmi3Status no_variable(const struct instance *u, const char *call, size_t n)
{
    if (u == NULL)
        return fmi3Error;
    return n == 0 ? fmi3OK : say(u, fmi3Error, ERRORS, "%s: no variable is of this type", call);
}

ACCESS(Float64, fmi3Float64, FMU_FLOAT64)
ACCESS(UInt16, fmi3UInt16, FMU_UINT16)
ACCESS(UInt64, fmi3UInt64, FMU_UINT64)
ACCESS(Boolean, fmi3Boolean, FMU_BOOLEAN)
ACCESS(Int64, fmi3Int64, FMU_ENUMERATION)
NO_ACCESS(Float32, fmi3Float32)
NO_ACCESS(Int8, fmi3Int8)
NO_ACCESS(UInt8, fmi3UInt8)
NO_ACCESS(Int16, fmi3Int16)
NO_ACCESS(Int32, fmi3Int32)
NO_ACCESS(UInt32, fmi3UInt32)
NO_ACCESS(String, fmi3String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                         size_t size[],
                         fmi3Binary values[], size_t n_values)
{
    (void)references, (void)size, (void)values, (void)n_values;
    return no_variable(instance, "fmi3GetBinary", n);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                         const size_t size[], const fmi3Binary values[], size_t n_values)
{
    (void)references, (void)size, (void)values, (void)n_values;
    return no_variable(instance, "fmi3SetBinary", n);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                        fmi3Clock values[])
{
    (void)references, (void)values;
    return no_variable(instance, "fmi3GetClock", n);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                        const fmi3Clock values[])
{
    (void)references, (void)values;
    return no_variable(instance, "fmi3SetClock", n);
}

/* ---- state ---- */

/* FNV-1a: finds bytes that changed on the way, not an enemy. */
static uint64_t sum_of(const void *bytes, size_t size)
{
    const unsigned char *b = bytes;
    uint64_t sum = 0xcbf29ce484222325u;
    for (size_t i = 0; i < size; i++)
        sum = (sum ^ b[i]) * 0x100000001b3u;
    return sum;
}

static struct serial_head head_of(const struct state *s)
{
    struct serial_head head;
    memset(&head, 0, sizeof head);
    memcpy(head.magic, MAGIC, sizeof head.magic);
    snprintf(head.token, sizeof head.token, "%s", fmu_the_arm.token);
    head.size = sizeof *s;
    head.sum = sum_of(s, sizeof *s);
    return head;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    struct instance *u = instance;
    if (u == NULL || state == NULL)
        return fmi3Error;
    if (*state == NULL)
        *state = malloc(sizeof u->s);
    if (*state == NULL)
        return say(u, fmi3Error, ERRORS, "fmi3GetFMUState: no memory");
    memcpy(*state, &u->s, sizeof u->s);
    ((struct state *)*state)->servo.model = NULL;
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    struct instance *u = instance;
    if (u == NULL || state == NULL)
        return say(u, fmi3Error, ERRORS, "fmi3SetFMUState: no state given");
    memcpy(&u->s, state, sizeof u->s);
    u->s.servo.model = &u->s.model;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    if (instance == NULL)
        return fmi3Error;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    if (instance == NULL || state == NULL || size == NULL)
        return say(instance, fmi3Error, ERRORS, "fmi3SerializedFMUStateSize: no state given");
    *size = sizeof(struct serial_head) + sizeof(struct state);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    if (instance == NULL || state == NULL || bytes == NULL
        || size < sizeof(struct serial_head) + sizeof(struct state))
        return say(instance, fmi3Error, ERRORS,
                   "fmi3SerializeFMUState: no state given, or too few bytes for it");
    struct serial_head head = head_of(state);
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, state, sizeof(struct state));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    struct instance *u = instance;
    struct serial_head head, want;
    if (u == NULL || bytes == NULL || state == NULL)
        return fmi3Error;
    if (size != sizeof head + sizeof(struct state))
        return say(u, fmi3Error, ERRORS, "fmi3DeserializeFMUState: expected %zu bytes, found %zu",
                   sizeof head + sizeof(struct state), size);
    struct state *s = malloc(sizeof *s);
    if (s == NULL)
        return say(u, fmi3Error, ERRORS, "fmi3DeserializeFMUState: no memory");
    memcpy(&head, bytes, sizeof head);
    memcpy(s, bytes + sizeof head, sizeof *s);
    want = head_of(s);
    if (memcmp(&head, &want, sizeof head) != 0) {
        free(s);
        return say(u, fmi3Error, ERRORS, "fmi3DeserializeFMUState: not a state of this unit, or damaged");
    }
    free(*state);
    *state = s;
    return fmi3OK;
}

/* ---- of the standard, and not offered ---- */

fmi3Status fmi3EnterEventMode(fmi3Instance instance) { return not_offered(instance, "fmi3EnterEventMode"); }
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { return not_offered(instance, "fmi3EnterStepMode"); }

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return not_offered(instance, "fmi3EnterConfigurationMode");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return not_offered(instance, "fmi3ExitConfigurationMode");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference reference, size_t *n)
{
    (void)reference, (void)n;
    return not_offered(instance, "fmi3GetNumberOfVariableDependencies");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference reference, size_t element[],
                                       fmi3ValueReference independent[], size_t of_element[],
                                       fmi3DependencyKind kind[], size_t n)
{
    (void)reference, (void)element, (void)independent, (void)of_element, (void)kind, (void)n;
    return not_offered(instance, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknown[],
                                        size_t unknowns,
                                        const fmi3ValueReference known[], size_t knowns,
                                        const fmi3Float64 seed[],
                                        size_t seeds, fmi3Float64 sensitivity[], size_t sensitivities)
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)seeds, (void)sensitivity;
    (void)sensitivities;
    return not_offered(instance, "fmi3GetDirectionalDerivative");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknown[],
                                    size_t unknowns,
                                    const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[],
                                    size_t seeds, fmi3Float64 sensitivity[], size_t sensitivities)
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)seeds, (void)sensitivity;
    (void)sensitivities;
    return not_offered(instance, "fmi3GetAdjointDerivative");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                    const fmi3Int32 order[], fmi3Float64 values[], size_t n_values)
{
    (void)reference, (void)n, (void)order, (void)values, (void)n_values;
    return not_offered(instance, "fmi3GetOutputDerivatives");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                  fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
{
    (void)reference, (void)n, (void)interval, (void)qualifier;
    return not_offered(instance, "fmi3GetIntervalDecimal");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                   fmi3UInt64 counter[], fmi3UInt64 resolution[],
                                   fmi3IntervalQualifier qualifier[])
{
    (void)reference, (void)n, (void)counter, (void)resolution, (void)qualifier;
    return not_offered(instance, "fmi3GetIntervalFraction");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                               fmi3Float64 shift[])
{
    (void)reference, (void)n, (void)shift;
    return not_offered(instance, "fmi3GetShiftDecimal");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                fmi3UInt64 counter[], fmi3UInt64 resolution[])
{
    (void)reference, (void)n, (void)counter, (void)resolution;
    return not_offered(instance, "fmi3GetShiftFraction");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                  const fmi3Float64 interval[])
{
    (void)reference, (void)n, (void)interval;
    return not_offered(instance, "fmi3SetIntervalDecimal");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                   const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
{
    (void)reference, (void)n, (void)counter, (void)resolution;
    return not_offered(instance, "fmi3SetIntervalFraction");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                               const fmi3Float64 shift[])
{
    (void)reference, (void)n, (void)shift;
    return not_offered(instance, "fmi3SetShiftDecimal");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference reference[], size_t n,
                                const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
{
    (void)reference, (void)n, (void)counter, (void)resolution;
    return not_offered(instance, "fmi3SetShiftFraction");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return not_offered(instance, "fmi3EvaluateDiscreteStates");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *need_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                    fmi3Boolean *event_defined, fmi3Float64 *event_s)
{
    (void)need_update, (void)terminate, (void)nominals_changed, (void)values_changed, (void)event_defined;
    (void)event_s;
    return not_offered(instance, "fmi3UpdateDiscreteStates");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return not_offered(instance, "fmi3EnterContinuousTimeMode");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_before,
                                       fmi3Boolean *event_mode,
                                       fmi3Boolean *terminate)
{
    (void)no_set_before, (void)event_mode, (void)terminate;
    return not_offered(instance, "fmi3CompletedIntegratorStep");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time_s)
{
    (void)time_s;
    return not_offered(instance, "fmi3SetTime");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 values[], size_t n)
{
    (void)values, (void)n;
    return not_offered(instance, "fmi3SetContinuousStates");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    (void)values, (void)n;
    return not_offered(instance, "fmi3GetContinuousStates");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    (void)values, (void)n;
    return not_offered(instance, "fmi3GetContinuousStateDerivatives");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    (void)values, (void)n;
    return not_offered(instance, "fmi3GetNominalsOfContinuousStates");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 values[], size_t n)
{
    (void)values, (void)n;
    return not_offered(instance, "fmi3GetEventIndicators");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    (void)n;
    return not_offered(instance, "fmi3GetNumberOfEventIndicators");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    (void)n;
    return not_offered(instance, "fmi3GetNumberOfContinuousStates");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time_s)
{
    (void)clock, (void)time_s;
    return not_offered(instance, "fmi3ActivateModelPartition");
}
