/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The FMI 3.0 unit by its C interface, as an importer calls it.
 * Goal: the unit is the servo driver and nothing else; states restore bit for bit; a call out of order
 * or a bad value does nothing and says why.
 * Method: the PA-10 compiled in as `make fmu` does; the same servo driver run by hand beside it.
 */
#include <math.h>
#include <string.h>

#include "sim/fmi3.h"
#include "tests/check_main.h"
#include "tests/fmu_direct.h"

enum { JOINTS = 7 };

static int messages;
static fmi3Status last_status;
static char last_category[64], last_message[512];

static void remember(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                     fmi3String message)
{
    ck_assert_ptr_eq(environment, &messages);
    messages++;
    last_status = status;
    snprintf(last_category, sizeof last_category, "%s", category);
    snprintf(last_message, sizeof last_message, "%s", message);
}

static fmi3Instance instantiate(void)
{
    fmi3Instance u = fmi3InstantiateCoSimulation("arm", fmu_the_arm.token, NULL, false, false, false, false,
                                                 NULL,
                                                 0, &messages, remember, NULL);
    ck_assert_ptr_nonnull(u);
    return u;
}

/* Value reference by name: the table's own row, found by what it is called. */
static fmi3ValueReference ref(const char *name, int joint)
{
    for (unsigned k = 0; fmu_row(k) != NULL; k++)
        if (strcmp(fmu_row(k)->name, name) == 0)
            return fmu_reference(k, joint);
    ck_abort_msg("no variable is called %s", name);
    return 0;
}

static void set_real(fmi3Instance u, const char *name, int joint, double value)
{
    fmi3ValueReference r = ref(name, joint);
    ck_assert_int_eq(fmi3SetFloat64(u, &r, 1, &value, 1), fmi3OK);
}

static double get_real(fmi3Instance u, const char *name, int joint)
{
    fmi3ValueReference r = ref(name, joint);
    double value = NAN;
    ck_assert_int_eq(fmi3GetFloat64(u, &r, 1, &value, 1), fmi3OK);
    return value;
}

static unsigned get_word(fmi3Instance u, const char *name, int joint)
{
    fmi3ValueReference r = ref(name, joint);
    uint16_t value = 0;
    ck_assert_int_eq(fmi3GetUInt16(u, &r, 1, &value, 1), fmi3OK);
    return value;
}

static void set_mode(fmi3Instance u, int joint, int64_t mode)
{
    fmi3ValueReference r = ref("mode", joint);
    ck_assert_int_eq(fmi3SetInt64(u, &r, 1, &mode, 1), fmi3OK);
}

static void set_enable(fmi3Instance u, bool enable)
{
    fmi3ValueReference r = ref("enable", 0);
    ck_assert_int_eq(fmi3SetBoolean(u, &r, 1, &enable, 1), fmi3OK);
}

static void set_seed(fmi3Instance u, uint64_t seed)
{
    fmi3ValueReference r = ref("seed", 0);
    ck_assert_int_eq(fmi3SetUInt64(u, &r, 1, &seed, 1), fmi3OK);
}

static void enter(fmi3Instance u)
{
    ck_assert_int_eq(fmi3EnterInitializationMode(u, false, 0, 0, false, 0), fmi3OK);
}

static void start(fmi3Instance u)
{
    enter(u);
    ck_assert_int_eq(fmi3ExitInitializationMode(u), fmi3OK);
}

static fmi3Status try_step(fmi3Instance u, double now_s, double step_s)
{
    bool event = true, end = true, early = true;
    double last = NAN;
    fmi3Status status = fmi3DoStep(u, now_s, step_s, false, &event, &end, &early, &last);
    if (status == fmi3OK) {
        ck_assert(!event && !end && !early);
        ck_assert_double_eq(last, now_s + step_s);
    }
    return status;
}

static void step(fmi3Instance u, double step_s)
{
    ck_assert_int_eq(try_step(u, get_real(u, "time", 0), step_s), fmi3OK);
}

static void apply(fmi3Instance u, const struct direct_input *in)
{
    for (int i = 0; i < JOINTS; i++) {
        set_mode(u, i, in->mode[i]);
        set_real(u, "speed_command", i, in->speed_radps[i]);
        set_real(u, "torque_command", i, in->torque_m_nm[i]);
    }
}

/* Some axes by speed, some by torque, now and then one on its brake, and commands past the words. */
static struct direct_input random_input(uint64_t *seed)
{
    struct direct_input in;
    for (int i = 0; i < JOINTS; i++) {
        in.mode[i] = test_random(seed) % 8 == 0 ? 0 : i % 3 == 1 ? 2 : 1;
        in.speed_radps[i] = test_uniform(seed, -0.6, 0.6);
        in.torque_m_nm[i] = test_uniform(seed, -0.5, 0.5);
    }
    if (test_random(seed) % 16 == 0)
        in.torque_m_nm[1] = test_uniform(seed, 30, 60); /* above 32.767: saturates */
    return in;
}

struct outputs { struct direct_output joint[JOINTS]; };

static struct outputs read_all(fmi3Instance u)
{
    struct outputs o;
    memset(&o, 0, sizeof o);
    for (int i = 0; i < JOINTS; i++) {
        o.joint[i].angle_rad = get_real(u, "angle", i);
        o.joint[i].link_rad = get_real(u, "link_angle", i);
        o.joint[i].link_radps = get_real(u, "link_speed", i);
        o.joint[i].reported_m_nm = get_real(u, "motor_torque", i);
        o.joint[i].gear_nm = get_real(u, "gear_torque", i);
        o.joint[i].status = get_word(u, "status", i);
    }
    return o;
}

static void assert_same(const struct outputs *a, const struct outputs *b, const char *what)
{
    for (int i = 0; i < JOINTS; i++) {
        const struct direct_output *x = &a->joint[i], *y = &b->joint[i];
        ck_assert_msg(x->angle_rad == y->angle_rad && x->link_rad == y->link_rad
                          && x->link_radps == y->link_radps && x->reported_m_nm == y->reported_m_nm
                          && x->gear_nm == y->gear_nm && x->status == y->status,
                      "%s: joint %d: angle %.17g and %.17g, link %.17g and %.17g, status %x and %x", what,
                      i + 1,
                      x->angle_rad, y->angle_rad, x->link_rad, y->link_rad, x->status, y->status);
    }
}

static void assert_not_same(const struct outputs *a, const struct outputs *b)
{
    int same = 0;
    for (int i = 0; i < JOINTS; i++)
        same += a->joint[i].link_rad == b->joint[i].link_rad;
    ck_assert_int_lt(same, JOINTS);
}

static struct outputs read_direct(const struct direct *d)
{
    struct outputs o;
    for (int i = 0; i < JOINTS; i++)
        o.joint[i] = direct_read(d, i);
    return o;
}

static void run(fmi3Instance u, uint64_t seed, int steps)
{
    for (int k = 0; k < steps; k++) {
        struct direct_input in = random_input(&seed);
        apply(u, &in);
        step(u, 0.01);
    }
}

/* ---- the arm ---- */

START_TEST(test_unit_is_the_servo_driver_bit_for_bit)
{
    static struct direct d;
    fmi3Instance u = instantiate();
    uint64_t seed = 11;
    double q_rad[JOINTS];
    struct direct_input in;
    memset(&in, 0, sizeof in);
    set_seed(u, 77);
    for (int i = 0; i < JOINTS; i++)
        set_real(u, "start", i, q_rad[i] = test_uniform(&seed, -0.8, 0.8));
    start(u);
    d.model = fmu_the_plant.model;
    direct_begin(&d, q_rad, 77, &in);
    double t_s = 0;
    for (int k = 0; k <= 120; k++) {
        struct outputs want = read_direct(&d), have = read_all(u);
        assert_same(&have, &want, "unit and servo driver");
        in = random_input(&seed);
        apply(u, &in);
        double h_s = test_uniform(&seed, 0.0002, 0.02);
        long ticks = (long)floor((t_s + h_s) * 1504) - (long)floor(t_s * 1504);
        step(u, h_s);
        t_s += h_s;
        direct_ticks(&d, &in, ticks);
    }
    ck_assert_int_eq(d.servo.s.refused, 0);
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_how_a_run_is_cut_into_steps_does_not_matter)
{
    static const double cut_s[] = { 0.0001, 1.0 / 1504, 0.001, 0.0071, 0.5 };
    struct outputs first;
    for (size_t c = 0; c < sizeof cut_s / sizeof cut_s[0]; c++) {
        fmi3Instance u = instantiate();
        uint64_t seed = 5;
        struct direct_input in = random_input(&seed);
        set_real(u, "start", 1, 0.4);
        start(u);
        apply(u, &in);
        int steps = (int)floor(0.5 / cut_s[c] + 1e-9);
        for (int k = 0; k < steps; k++)
            ck_assert_int_eq(try_step(u, k * cut_s[c], cut_s[c]), fmi3OK); /* as an importer counts */
        if (steps * cut_s[c] < 0.5 - 1e-9)
            ck_assert_int_eq(try_step(u, steps * cut_s[c], 0.5 - steps * cut_s[c]), fmi3OK);
        struct outputs o = read_all(u);
        if (c == 0)
            first = o;
        assert_same(&o, &first, "another step");
        fmi3FreeInstance(u);
    }
    ck_assert_double_gt(fabs(first.joint[0].angle_rad), 0.01); /* it did move */
}
END_TEST

START_TEST(test_step_below_a_tick_waits_for_the_next)
{
    fmi3Instance u = instantiate();
    start(u);
    set_mode(u, 0, 1);
    set_real(u, "speed_command", 0, 0.5);
    struct outputs before = read_all(u);
    step(u, 0.0006); /* a tick is 0.00066 s */
    struct outputs same = read_all(u);
    ck_assert_double_eq(same.joint[0].link_rad, before.joint[0].link_rad);
    ck_assert_uint_ne(same.joint[0].status, before.joint[0].status); /* the command itself has arrived */
    for (int k = 0; k < 20; k++)
        step(u, 0.0006);
    struct outputs after = read_all(u);
    assert_not_same(&after, &before);
    fmi3FreeInstance(u);
}
END_TEST

/* The end of a step is a sum with rounding: still one tick a step, never none and then two. */
START_TEST(test_step_of_a_tick_makes_one_tick)
{
    static struct direct d;
    const double q_rad[JOINTS] = { 0, 0.4 };
    fmi3Instance u = instantiate();
    uint64_t seed = 6;
    struct direct_input in = random_input(&seed), none;
    memset(&none, 0, sizeof none);
    set_real(u, "start", 1, q_rad[1]);
    start(u);
    d.model = fmu_the_plant.model;
    direct_begin(&d, q_rad, 1, &none);
    apply(u, &in);
    for (int k = 0; k < 1000; k++) {
        ck_assert_int_eq(try_step(u, k * (1.0 / 1504), 1.0 / 1504), fmi3OK);
        direct_ticks(&d, &in, 1);
        struct outputs want = read_direct(&d), have = read_all(u);
        assert_same(&have, &want, "a tick");
    }
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_parameters_count_until_initialization_ends)
{
    fmi3Instance u = instantiate();
    fmi3ValueReference seed = ref("seed", 0);
    uint64_t value = 0;
    ck_assert_int_eq(fmi3GetUInt64(u, &seed, 1, &value, 1), fmi3OK);
    ck_assert_uint_eq(value, 1); /* as modelDescription.xml says it starts */
    set_real(u, "start", 2, 0.1);
    enter(u);
    ck_assert_double_eq(get_real(u, "link_angle", 2), 0.1);
    set_real(u, "start", 2, 0.2);
    ck_assert_double_eq(get_real(u, "link_angle", 2), 0.2);
    set_real(u, "start", 2, 0.3);
    ck_assert_int_eq(fmi3ExitInitializationMode(u), fmi3OK);
    ck_assert_double_eq(get_real(u, "link_angle", 2), 0.3);
    ck_assert_double_le(fabs(get_real(u, "angle", 2) - 0.3), 0.01); /* but for the wind-up */
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_unit_with_payload_is_the_servo_driver_with_it)
{
    static struct direct d;
    const double q_rad[JOINTS] = { 0, 0.5 };
    fmi3Instance u = instantiate();
    uint64_t seed = 15;
    struct direct_input in;
    memset(&in, 0, sizeof in);
    d.model = fmu_the_plant.model;
    d.model.payload_kg = 6;
    d.model.payload_com_m[1] = 0.02; /* the PA-10's flange frame is its last link's */
    d.model.step_s = 0;
    ck_assert_int_eq(plant_model_check(&d.model, NULL), 0);
    set_real(u, "start", 1, q_rad[1]);
    set_real(u, "payload_mass", 0, 6);
    set_real(u, "payload_y", 0, 0.02);
    start(u);
    direct_begin(&d, q_rad, 1, &in);
    for (int k = 0; k < 30; k++) {
        in = random_input(&seed);
        apply(u, &in);
        step(u, 15.0 / 1504);
        direct_ticks(&d, &in, 15);
        struct outputs want = read_direct(&d), have = read_all(u);
        assert_same(&have, &want, "with a payload");
    }
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_payload_loads_the_gears_by_its_weight)
{
    /* the arm lies along +x: S2 at 90 degrees.  Flange 1.03 m from S2, 0.58 m from E1. */
    const double x_m = 0.04, z_m = 0.07, mass_kg = 4.5;
    double hold[2][JOINTS], gravity = -fmu_the_plant.model.gravity_mps2[2];
    for (int loaded = 0; loaded < 2; loaded++) {
        fmi3Instance u = instantiate();
        set_real(u, "start", 1, acos(0.0));
        if (loaded) {
            set_real(u, "payload_mass", 0, mass_kg);
            set_real(u, "payload_x", 0, x_m);
            set_real(u, "payload_z", 0, z_m);
        }
        enter(u);
        for (int i = 0; i < JOINTS; i++)
            hold[loaded][i] = get_real(u, "gear_torque", i);
        fmi3FreeInstance(u);
    }
    ck_assert_double_le(fabs(hold[0][1] - hold[1][1] - mass_kg * gravity * (1.03 + z_m)), 1e-9);
    ck_assert_double_le(fabs(hold[0][3] - hold[1][3] - mass_kg * gravity * (0.58 + z_m)), 1e-9);
    ck_assert_double_le(fabs(hold[0][5] - hold[1][5] - mass_kg * gravity * (0.08 + z_m)), 1e-9);
    ck_assert_double_le(fabs(hold[0][0] - hold[1][0]), 1e-9);
}
END_TEST

START_TEST(test_enable_brakes_and_clears_alarms)
{
    fmi3Instance u = instantiate();
    set_real(u, "start", 1, 1.63); /* limit 1.6406 */
    start(u);
    set_mode(u, 1, 1);
    set_real(u, "speed_command", 1, 0.5);
    for (int k = 0; k < 20; k++)
        step(u, 0.01);
    unsigned alarm = (get_word(u, "status", 1) >> 4) & 0xff;
    ck_assert_uint_eq(alarm, DRV_ALARM_POSITION_LIMIT);
    set_real(u, "speed_command", 1, -0.5);
    double stuck = get_real(u, "link_angle", 1);
    for (int k = 0; k < 10; k++)
        step(u, 0.01);
    ck_assert_double_le(fabs(get_real(u, "link_angle", 1) - stuck), 0.002); /* stopped, brakes on */
    set_enable(u, false);
    step(u, 0.01);
    set_enable(u, true);
    for (int k = 0; k < 20; k++)
        step(u, 0.01);
    ck_assert_uint_eq((get_word(u, "status", 1) >> 4) & 0xff, 0);
    ck_assert_double_lt(get_real(u, "link_angle", 1), stuck - 0.05);
    set_enable(u, false);
    step(u, 0.01);
    ck_assert_uint_eq(get_word(u, "status", 1) & DRV_AXIS_POWER_OFF, DRV_AXIS_POWER_OFF);
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_alarm_is_told_when_alarms_are_logged)
{
    for (int on = 0; on < 2; on++) {
        fmi3Instance u = instantiate();
        const fmi3String alarms = "logAlarms";
        ck_assert_int_eq(fmi3SetDebugLogging(u, on, 1, &alarms), fmi3OK);
        set_real(u, "start", 1, 1.63);
        start(u);
        set_mode(u, 1, 1);
        set_real(u, "speed_command", 1, 0.5);
        messages = 0;
        for (int k = 0; k < 20; k++)
            step(u, 0.01);
        ck_assert_int_eq(messages, on); /* once, not every tick */
        if (on) {
            ck_assert_str_eq(last_category, "logAlarms");
            ck_assert_ptr_nonnull(strstr(last_message, "S2"));
            ck_assert_ptr_nonnull(strstr(last_message, "08"));
        }
        fmi3FreeInstance(u);
    }
}
END_TEST

/* ---- states ---- */

START_TEST(test_rollback_repeats_bit_for_bit)
{
    fmi3Instance u = instantiate();
    fmi3FMUState state = NULL;
    start(u);
    run(u, 3, 30);
    ck_assert_int_eq(fmi3GetFMUState(u, &state), fmi3OK);
    run(u, 4, 30);
    struct outputs first = read_all(u);
    run(u, 5, 10);
    struct outputs later = read_all(u);
    assert_not_same(&first, &later);
    for (int k = 0; k < 2; k++) { /* a state may be used again */
        ck_assert_int_eq(fmi3SetFMUState(u, state), fmi3OK);
        ck_assert_double_le(fabs(get_real(u, "time", 0) - 0.3), 1e-12);
        run(u, 4, 30);
        struct outputs again = read_all(u);
        assert_same(&again, &first, "after a rollback");
    }
    ck_assert_int_eq(fmi3FreeFMUState(u, &state), fmi3OK);
    ck_assert_ptr_null(state);
    ck_assert_int_eq(fmi3FreeFMUState(u, &state), fmi3OK);
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_state_travels_as_bytes_to_another_instance)
{
    fmi3Instance u = instantiate(), other = instantiate();
    fmi3FMUState state = NULL, arrived = NULL;
    size_t size = 0;
    set_seed(u, 9);
    set_real(u, "start", 3, 0.7);
    start(u);
    run(u, 6, 20);
    ck_assert_int_eq(fmi3GetFMUState(u, &state), fmi3OK);
    ck_assert_int_eq(fmi3SerializedFMUStateSize(u, state, &size), fmi3OK);
    uint8_t *bytes = malloc(size);
    ck_assert_int_eq(fmi3SerializeFMUState(u, state, bytes, size), fmi3OK);
    run(u, 7, 20);
    struct outputs want = read_all(u);
    fmi3FreeFMUState(u, &state);
    fmi3FreeInstance(u); /* the bytes hold nothing of it */
    ck_assert_int_eq(fmi3DeserializeFMUState(other, bytes, size, &arrived), fmi3OK);
    ck_assert_int_eq(fmi3SetFMUState(other, arrived), fmi3OK);
    run(other, 7, 20);
    struct outputs have = read_all(other);
    assert_same(&have, &want, "in another instance");
    fmi3FreeFMUState(other, &arrived);
    fmi3FreeInstance(other);
    free(bytes);
}
END_TEST

START_TEST(test_damaged_bytes_are_refused)
{
    fmi3Instance u = instantiate();
    fmi3FMUState state = NULL, arrived = NULL;
    size_t size = 0;
    start(u);
    fmi3GetFMUState(u, &state);
    fmi3SerializedFMUStateSize(u, state, &size);
    uint8_t *bytes = malloc(size);
    ck_assert_int_eq(fmi3SerializeFMUState(u, state, bytes, size - 1), fmi3Error);
    ck_assert_int_eq(fmi3SerializeFMUState(u, state, bytes, size), fmi3OK);
    ck_assert_int_eq(fmi3DeserializeFMUState(u, bytes, size - 1, &arrived), fmi3Error);
    uint64_t seed = 21;
    for (int k = 0; k < 200; k++) {
        size_t at = k < 130 ? (size_t)k : (size_t)(test_random(&seed) % size);
        if (at >= 8 + strlen(fmu_the_arm.token) && at < 8 + 96)
            continue; /* only changed where it means something: zeros after the token are held too */
        bytes[at] ^= 0x40;
        ck_assert_msg(fmi3DeserializeFMUState(u, bytes, size, &arrived) == fmi3Error, "byte %zu", at);
        bytes[at] ^= 0x40;
    }
    ck_assert_ptr_null(arrived);
    ck_assert_int_eq(fmi3DeserializeFMUState(u, bytes, size, &arrived), fmi3OK);
    fmi3FreeFMUState(u, &arrived);
    fmi3FreeFMUState(u, &state);
    fmi3FreeInstance(u);
    free(bytes);
}
END_TEST

START_TEST(test_reset_is_a_new_instance)
{
    fmi3Instance u = instantiate();
    start(u);
    run(u, 8, 20);
    struct outputs fresh = read_all(u);
    ck_assert_int_eq(fmi3Reset(u), fmi3OK);
    set_seed(u, 4);
    set_real(u, "start", 0, 1);
    start(u);
    run(u, 8, 20);
    struct outputs other = read_all(u);
    assert_not_same(&fresh, &other);
    ck_assert_int_eq(fmi3Terminate(u), fmi3OK);
    ck_assert_int_eq(fmi3Reset(u), fmi3OK); /* parameters and inputs too are as they were */
    start(u);
    run(u, 8, 20);
    struct outputs again = read_all(u);
    assert_same(&again, &fresh, "after a reset");
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_instances_do_not_touch_each_other)
{
    fmi3Instance alone = instantiate(), a = instantiate(), b = instantiate();
    set_seed(b, 2);
    start(alone);
    start(a);
    start(b);
    run(alone, 9, 40);
    for (int k = 0; k < 4; k++) {
        uint64_t seed = 9; /* the same 40 inputs, in four parts */
        for (int skip = 0; skip < 10 * k; skip++)
            random_input(&seed);
        run(a, seed, 10);
        run(b, 100 + (uint64_t)k, 10);
    }
    struct outputs want = read_all(alone), have = read_all(a), other = read_all(b);
    assert_same(&have, &want, "beside another instance");
    assert_not_same(&have, &other);
    fmi3FreeInstance(alone);
    fmi3FreeInstance(a);
    fmi3FreeInstance(b);
}
END_TEST

/* ---- refusals ---- */

/* The call failed, said so once, and `part` is in what it said. */
#define ck_refused(status, expression, part)                                                        \
    do {                                                                                            \
        messages = 0;                                                                               \
        ck_assert_int_eq(expression, status);                                                       \
        ck_assert_int_eq(messages, 1);                                                              \
        ck_assert_int_eq(last_status, status);                                                      \
        ck_assert_msg(strstr(last_message, part) != NULL, "expected %s in: %s", part, last_message); \
    } while (0)

START_TEST(test_wrong_token_or_mode_gives_no_instance)
{
    messages = 0;
    ck_assert_ptr_null(fmi3InstantiateCoSimulation("arm", "another", NULL, false, false, false, false, NULL,
                                                   0,
                                                   &messages, remember, NULL));
    ck_assert_ptr_nonnull(strstr(last_message, "token"));
    ck_assert_ptr_null(fmi3InstantiateCoSimulation("arm", fmu_the_arm.token, NULL, false, false, true, false,
                                                   NULL,
                                                   0, &messages, remember, NULL));
    ck_assert_ptr_nonnull(strstr(last_message, "event"));
    ck_assert_ptr_null(fmi3InstantiateModelExchange("arm", fmu_the_arm.token, NULL, false, false, &messages,
                                                    remember));
    ck_assert_ptr_null(fmi3InstantiateScheduledExecution("arm", fmu_the_arm.token, NULL, false, false,
                                                         &messages,
                                                         remember, NULL, NULL, NULL));
    ck_assert_int_eq(messages, 4);
    ck_assert_str_eq(last_category, "logStatusError");
    /* without anyone to tell it to, it is still no crash */
    ck_assert_ptr_null(fmi3InstantiateCoSimulation(NULL, NULL, NULL, false, false, false, false, NULL, 0,
                                                   NULL, NULL,
                                                   NULL));
}
END_TEST

START_TEST(test_calls_out_of_order_do_nothing)
{
    fmi3Instance u = instantiate();
    fmi3ValueReference angle = ref("angle", 0), begin = ref("start", 0), time = ref("time", 0);
    double x = 0.1;
    ck_refused(fmi3Error, try_step(u, 0, 0.01), "Instantiated");
    ck_refused(fmi3Error, fmi3ExitInitializationMode(u), "Instantiated");
    ck_refused(fmi3Error, fmi3Terminate(u), "Instantiated");
    ck_refused(fmi3Error, fmi3GetFloat64(u, &angle, 1, &x, 1), "Instantiated");
    enter(u);
    ck_refused(fmi3Error, fmi3EnterInitializationMode(u, false, 0, 0, false, 0), "Initialization");
    ck_refused(fmi3Error, try_step(u, 0, 0.01), "Initialization");
    ck_assert_int_eq(fmi3ExitInitializationMode(u), fmi3OK);
    ck_refused(fmi3Error, fmi3SetFloat64(u, &begin, 1, &x, 1), "Step Mode");
    ck_refused(fmi3Error, fmi3SetFloat64(u, &angle, 1, &x, 1), "neither");
    ck_refused(fmi3Error, fmi3SetFloat64(u, &time, 1, &x, 1), "neither");
    ck_refused(fmi3Error, fmi3EnterEventMode(u), "not offered");
    step(u, 0.01);
    ck_assert_int_eq(fmi3Terminate(u), fmi3OK);
    ck_assert_int_eq(fmi3GetFloat64(u, &angle, 1, &x, 1), fmi3OK);
    ck_refused(fmi3Error, try_step(u, 0.01, 0.01), "Terminated");
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_a_step_must_go_on_from_where_the_last_ended)
{
    fmi3Instance u = instantiate();
    ck_assert_int_eq(fmi3EnterInitializationMode(u, true, 1e-4, 10, true, 11), fmi3OK);
    ck_assert_int_eq(fmi3ExitInitializationMode(u), fmi3OK);
    ck_refused(fmi3Error, try_step(u, 0, 0.01), "go on from 10 s");
    ck_refused(fmi3Error, try_step(u, 10, 0), "above 0 s");
    ck_refused(fmi3Error, try_step(u, 10, -0.01), "above 0 s");
    ck_refused(fmi3Error, try_step(u, 10, NAN), "above 0 s");
    ck_refused(fmi3Error, try_step(u, NAN, 0.01), "go on from");
    ck_refused(fmi3Error, try_step(u, 10, 1.5), "past the stop time");
    ck_assert_int_eq(try_step(u, 10, 0.5), fmi3OK);
    ck_refused(fmi3Error, try_step(u, 10, 0.5), "go on from 10.5");
    ck_assert_int_eq(try_step(u, 10.5, 0.5), fmi3OK);
    ck_assert_double_eq(get_real(u, "time", 0), 11);
    fmi3FreeInstance(u);
    u = instantiate();
    ck_refused(fmi3Error, fmi3EnterInitializationMode(u, false, 0, NAN, false, 0), "start");
    ck_refused(fmi3Error, fmi3EnterInitializationMode(u, false, 0, 2, true, 1), "start");
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_bad_values_are_discarded_whole)
{
    fmi3Instance u = instantiate();
    const fmi3ValueReference speeds[] = { ref("speed_command", 0), ref("speed_command", 1) };
    const fmi3ValueReference mode = ref("mode", 2), begin = ref("start", 1), mass = ref("payload_mass", 0);
    double pair[] = { 0.3, NAN }, beyond = 1.7, negative = -1;
    int64_t fourth = 3;
    ck_refused(fmi3Discard, fmi3SetFloat64(u, speeds, 2, pair, 2), "finite");
    ck_assert_double_eq(get_real(u, "speed_command", 0), 0); /* the good one was not taken either */
    ck_refused(fmi3Discard, fmi3SetInt64(u, &mode, 1, &fourth, 1), "S3.mode");
    ck_refused(fmi3Discard, fmi3SetFloat64(u, &begin, 1, &beyond, 1), "S2.start");
    ck_refused(fmi3Discard, fmi3SetFloat64(u, &mass, 1, &negative, 1), "payload_mass");
    pair[1] = INFINITY;
    ck_refused(fmi3Discard, fmi3SetFloat64(u, speeds, 2, pair, 2), "finite");
    fmi3FreeInstance(u);
}
END_TEST

START_TEST(test_wrong_references_are_refused)
{
    fmi3Instance u = instantiate();
    fmi3ValueReference r = 4000, eighth = ref("speed_command", 0) + JOINTS, seed = ref("seed", 0);
    double x = 0;
    float f = 0;
    ck_refused(fmi3Error, fmi3GetFloat64(u, &r, 1, &x, 1), "4000");
    ck_refused(fmi3Error, fmi3SetFloat64(u, &eighth, 1, &x, 1), "no variable");
    ck_refused(fmi3Error, fmi3GetFloat64(u, &seed, 1, &x, 1), "another type");
    ck_refused(fmi3Error, fmi3GetFloat64(u, &seed, 1, &x, 2), "references");
    ck_refused(fmi3Error, fmi3GetFloat64(u, NULL, 1, &x, 1), "references");
    ck_refused(fmi3Error, fmi3GetFloat32(u, &seed, 1, &f, 1), "of this type");
    ck_assert_int_eq(fmi3GetFloat32(u, NULL, 0, NULL, 0), fmi3OK);
    ck_assert_int_eq(fmi3GetFloat64(NULL, &seed, 1, &x, 1), fmi3Error);
    ck_assert_int_eq(try_step(NULL, 0, 1), fmi3Error);
    const fmi3String unknown = "logEverything";
    ck_refused(fmi3Error, fmi3SetDebugLogging(u, true, 1, &unknown), "logEverything");
    fmi3FreeInstance(u);
    fmi3FreeInstance(NULL);
}
END_TEST

START_TEST(test_table_rows_are_distinct)
{
    int joint, inputs = 0, outputs = 0;
    for (unsigned k = 0; fmu_row(k) != NULL; k++) {
        const struct fmu_kind *a = fmu_row(k);
        size_t end = a->offset + fmu_size(a->type) * (a->per_joint ? DRV_AXES : 1);
        ck_assert_uint_le(end, sizeof(struct fmu_values));
        ck_assert(a->type == FMU_FLOAT64 || a->variability != FMU_CONTINUOUS);
        inputs += a->causality == FMU_INPUT;
        outputs += a->causality == FMU_OUTPUT;
        for (unsigned m = 0; m < k; m++) {
            const struct fmu_kind *b = fmu_row(m);
            ck_assert_str_ne(a->name, b->name);
            size_t size = fmu_size(b->type) * (b->per_joint ? DRV_AXES : 1);
            ck_assert(b->offset + size <= a->offset || end <= b->offset); /* no two share a place */
        }
        ck_assert_ptr_eq(fmu_find(&fmu_the_arm, fmu_reference(k, 0), &joint), a);
        ck_assert_ptr_eq(fmu_find(&fmu_the_arm, fmu_reference(k, JOINTS - 1), &joint),
                         a->per_joint ? a : NULL);
        ck_assert_int_eq(joint, JOINTS - 1);
    }
    ck_assert_int_gt(inputs, 0);
    ck_assert_int_gt(outputs, 0);
    ck_assert_str_eq(fmi3GetVersion(), "3.0");
}
END_TEST

static Suite *fmu_suite(void)
{
    Suite *s = suite_create("fmu");
    TCase *c = tcase_create("arm");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, test_unit_is_the_servo_driver_bit_for_bit);
    tcase_add_test(c, test_how_a_run_is_cut_into_steps_does_not_matter);
    tcase_add_test(c, test_step_below_a_tick_waits_for_the_next);
    tcase_add_test(c, test_step_of_a_tick_makes_one_tick);
    tcase_add_test(c, test_parameters_count_until_initialization_ends);
    tcase_add_test(c, test_unit_with_payload_is_the_servo_driver_with_it);
    tcase_add_test(c, test_payload_loads_the_gears_by_its_weight);
    tcase_add_test(c, test_enable_brakes_and_clears_alarms);
    tcase_add_test(c, test_alarm_is_told_when_alarms_are_logged);
    suite_add_tcase(s, c);
    c = tcase_create("states");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, test_rollback_repeats_bit_for_bit);
    tcase_add_test(c, test_state_travels_as_bytes_to_another_instance);
    tcase_add_test(c, test_damaged_bytes_are_refused);
    tcase_add_test(c, test_reset_is_a_new_instance);
    tcase_add_test(c, test_instances_do_not_touch_each_other);
    suite_add_tcase(s, c);
    c = tcase_create("refusals");
    tcase_add_test(c, test_wrong_token_or_mode_gives_no_instance);
    tcase_add_test(c, test_calls_out_of_order_do_nothing);
    tcase_add_test(c, test_a_step_must_go_on_from_where_the_last_ended);
    tcase_add_test(c, test_bad_values_are_discarded_whole);
    tcase_add_test(c, test_wrong_references_are_refused);
    tcase_add_test(c, test_table_rows_are_distinct);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(fmu_suite())
