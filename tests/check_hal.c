/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The LinuxCNC component period by period: what its pins make of the arm, when it drives and when it does
 * not.  HAL is tests/hal; the servo is its protocol (driver_rig.h) at the other end of a unix: bus.
 */
#include "driver/linuxcnc/hdt.c"

#include <math.h>
#include <unistd.h>

#include "tests/check_main.h"
#include "tests/driver_rig.h"

#define PERIOD_NS 1428571
#define EVERY_JOINT 0x7fu

static char dir[64], image_path[80], bus_name[90];
static struct rig_servo servo;

static hal_bit_t *bit(const char *name) { return (hal_bit_t *)hal_find(name); }
static hal_float_t *number(const char *name) { return (hal_float_t *)hal_find(name); }
static hal_u32_t *word(const char *name) { return (hal_u32_t *)hal_find(name); }

static void write_image(const struct hdt_tables *t)
{
    static uint8_t image[IMAGE_MAX];
    size_t n = hdt_tables_write(t, image, sizeof image);
    FILE *f = fopen(image_path, "wb");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(image, 1, n, f), n);
    ck_assert_int_eq(fclose(f), 0);
}

/* The component, loaded with these tables beside a servo that answers. */
static void load(const struct hdt_tables *t)
{
    char err[300] = "";
    strcpy(dir, P_tmpdir "/hdt_hal_XXXXXX");
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(image_path, sizeof image_path, "%s/hdtm", dir);
    snprintf(bus_name, sizeof bus_name, "unix:%s/bus", dir);
    write_image(t);
    memset(&hal, 0, sizeof hal);
    memset(&servo, 0, sizeof servo);
    rtapi.now_ns = 1000000000;
    int e = hdt_bus_open(&servo.bus, bus_name, HDT_BUS_SERVO, err, sizeof err);
    ck_assert_msg(e == HDT_BUS_OK, "%s", err);
    tables = image_path;
    bus = bus_name;
    ck_assert_msg(rtapi_app_main() == 0, "%s", rtapi.said);
}

/* The component goes with the test's process: its end would wait for an answer nobody here gives. */
static void leave_directory(void)
{
    hdt_bus_close(&servo.bus);
    unlink(image_path);
    ck_assert_int_eq(rmdir(dir), 0);
}

static void run(int periods)
{
    for (int n = 0; n < periods; n++) {
        rtapi.now_ns += PERIOD_NS;
        hal.function(hal.arg, PERIOD_NS);
        rig_serve(&servo);
    }
}

/* Ready, and driven by an edge of enable. */
static void drive(void)
{
    run(20);
    ck_assert(*bit("hdt.ready"));
    *bit("hdt.enable") = true;
    run(20);
    ck_assert(*bit("hdt.driving"));
}

static uint32_t braked(void)
{
    uint32_t joints = 0;
    for (unsigned j = 0; j < DRV_AXES; j++)
        joints |= servo.last.axis[j].mode == DRV_AXIS_BRAKE ? 1u << j : 0u;
    return joints;
}

static const char *const reference[] = {"hdt.1.q-ref", "hdt.1.v-ref", "hdt.1.a-ref"};

START_TEST(test_a_pin_that_is_no_number_is_a_reference_fault_and_no_motion)
{
    const double none[] = {NAN, INFINITY, -INFINITY};
    struct hdt_tables *t = rig_tables();
    /* also of an arm whose joints turn as far as an angle goes */
    t->joint[1].q_max_q24 = _i & 1 ? INT32_MAX : 3 << 24;
    t->joint[1].q_min_q24 = -t->joint[1].q_max_q24;
    load(t);
    *bit("hdt.velocity-mode") = _i & 2;
    drive();
    ck_assert_uint_eq(braked(), 0);
    *number(reference[_i / 4 % 3]) = none[_i / 12];
    run(1);
    ck_assert_int_eq(the->in.v_ref[1].raw | the->in.a_ref[1].raw, 0);
    ck_assert_int_eq(the->in.q_ref[1].raw, INT32_MIN);
    for (int n = 0; n < 10; n++) {
        ck_assert_uint_eq(*word("hdt.fault-code"), HDT_FAULT_REFERENCE);
        ck_assert_uint_eq(*word("hdt.fault-joints"), 1u << 1);
        ck_assert(!*bit("hdt.driving") && !*bit("hdt.ready"));
        ck_assert_uint_eq(braked(), EVERY_JOINT);
        ck_assert_int_eq(servo.last.axis[1].speed_dig, 0);
        ck_assert_int_eq(servo.last.axis[1].torque_dig, 0);
        run(1);
    }
    leave_directory();
}
END_TEST

START_TEST(test_numbers_beyond_the_core_s_saturate_with_their_sign)
{
    struct hdt_tables *t = rig_tables();
    load(t);
    *bit("hdt.velocity-mode") = true;
    drive();
    *number("hdt.2.v-ref") = 1e30;
    *number("hdt.3.v-ref") = -1e30;
    run(2);
    ck_assert_int_eq(servo.last.axis[2].speed_dig, t->joint[2].spd_max);
    ck_assert_int_eq(servo.last.axis[3].speed_dig, -t->joint[3].spd_max);
    ck_assert_uint_eq(*word("hdt.fault-code"), 0);
    leave_directory();
}
END_TEST

/* An edge of clear. */
static void clear_edge(void)
{
    *bit("hdt.clear") = true;
    run(2);
    *bit("hdt.clear") = false;
}

START_TEST(test_only_an_edge_of_enable_on_a_ready_arm_starts_to_drive)
{
    load(rig_tables());
    *bit("hdt.enable") = true;
    run(60);
    ck_assert(*bit("hdt.ready") && !*bit("hdt.driving"));
    ck_assert_uint_eq(braked(), EVERY_JOINT);
    *bit("hdt.enable") = false;
    run(1);
    drive();
    ck_assert_uint_eq(braked(), 0);
    *bit("hdt.enable") = false;
    run(1);
    ck_assert(!*bit("hdt.driving"));
    ck_assert_uint_eq(braked(), EVERY_JOINT);
    leave_directory();
}
END_TEST

START_TEST(test_a_cleared_fault_does_not_start_the_arm)
{
    load(rig_tables());
    drive();
    servo.state.axis[4].status = DRV_ALARM_OVER_CURRENT << DRV_ALARM_SHIFT;
    run(5);
    ck_assert_uint_eq(*word("hdt.fault-code"), HDT_FAULT_SERVO);
    ck_assert_uint_eq(*word("hdt.fault-joints"), 1u << 4);
    clear_edge();
    for (int n = 0; n < 60; n++) {
        run(1);
        ck_assert(!*bit("hdt.driving"));
        ck_assert_uint_eq(braked(), EVERY_JOINT);
    }
    ck_assert(*bit("hdt.ready") && !*bit("hdt.fault"));
    *bit("hdt.enable") = false;
    run(1);
    drive();
    ck_assert_uint_eq(braked(), 0);
    leave_directory();
}
END_TEST

START_TEST(test_clear_without_a_fault_does_nothing)
{
    load(rig_tables());
    drive();
    const unsigned starts = servo.starts;
    *bit("hdt.clear") = true;
    for (int n = 0; n < 30; n++) {
        run(1);
        ck_assert(*bit("hdt.driving") && *bit("hdt.ready"));
        ck_assert_uint_eq(braked(), 0);
    }
    ck_assert_uint_eq(servo.starts, starts);
    /* and the level it was left at is no edge once there is a fault */
    *number("hdt.0.q-ref") = 4;
    run(30);
    ck_assert_uint_eq(*word("hdt.fault-code"), HDT_FAULT_REFERENCE);
    *bit("hdt.clear") = false;
    run(1);
    clear_edge();
    run(30);
    ck_assert(*bit("hdt.ready") && !*bit("hdt.driving"));
    leave_directory();
}
END_TEST

START_TEST(test_a_period_that_fails_keeps_the_angle_and_is_not_driven)
{
    load(rig_tables());
    servo.state.axis[1].count = 20000;
    *number("hdt.1.q-ref") = 0.15;
    drive();
    const double q = *number("hdt.1.q");
    ck_assert_double_eq_tol(q, 20000 * 7.669904e-6, 1e-5);
    if (_i == 1) { /* also a fault is not forgotten */
        *number("hdt.1.q-ref") = 4;
        run(1);
    }
    rtapi.now_ns -= PERIOD_NS; /* time stands still for a period */
    run(1);
    ck_assert_double_eq(*number("hdt.1.q"), q);
    ck_assert(!*bit("hdt.driving") && !*bit("hdt.ready"));
    ck_assert_uint_eq(braked(), EVERY_JOINT);
    ck_assert_uint_eq(*word("hdt.fault-code"), _i == 1 ? HDT_FAULT_REFERENCE : 0);
    /* and what it braked waits for an edge of enable as well */
    for (int n = 0; n < 40; n++) {
        run(1);
        ck_assert(!*bit("hdt.driving") && *bit("hdt.ready") == (_i == 0));
        ck_assert_uint_eq(braked(), EVERY_JOINT);
    }
    leave_directory();
}
END_TEST

static Suite *hal_suite(void)
{
    Suite *s = suite_create("hal");
    TCase *t = tcase_create("pins");
    tcase_add_loop_test(t, test_a_pin_that_is_no_number_is_a_reference_fault_and_no_motion, 0, 36);
    tcase_add_test(t, test_numbers_beyond_the_core_s_saturate_with_their_sign);
    suite_add_tcase(s, t);
    t = tcase_create("driving");
    tcase_add_test(t, test_only_an_edge_of_enable_on_a_ready_arm_starts_to_drive);
    tcase_add_test(t, test_a_cleared_fault_does_not_start_the_arm);
    tcase_add_test(t, test_clear_without_a_fault_does_nothing);
    tcase_add_loop_test(t, test_a_period_that_fails_keeps_the_angle_and_is_not_driven, 0, 2);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(hal_suite())
