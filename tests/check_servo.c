/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The servo emulator: modes, watchdog, brakes, loops, quantisation, and any bytes at all.
 *
 * Owns: properties of sim/servo.c.
 * Never: compares with a recorded run; looks at a clock.
 */
#include <math.h>
#include <string.h>

#include "sim/servo.h"
#include "tests/check_main.h"
#include "tests/pa10_plant.h"

enum {
    N = PA10_JOINTS,
    DRIVE = DRV_AXIS_SERVO,
    TORQUE = DRV_AXIS_SERVO | DRV_AXIS_TORQUE,
    PARKED = DRV_AXIS_BRAKE
};

static const double start_q[N] = { 0, -0.5, 0, 1, 0, 0.5, 0 };
static const double leaning_q[N] = { 0, -1.2, 0, -0.3, 0, 0, 0 };
static struct plant_model model;
static struct servo servo, twin;

static struct plant_model checked(struct plant_model m)
{
    const char *why = "";
    int result = plant_model_check(&m, &why);
    ck_assert_msg(result == 0, "model refused: joint %d: %s", m.check_joint, why);
    return m;
}

static void set_up(void)
{
    model = checked(pa10_plant());
    servo_init(&servo, &model, NULL, start_q, 1);
}

static void set_up_imperfect(void)
{
    struct plant_model m = pa10_plant();
    for (int i = 0; i < N; i++) {
        m.joint[i].run_coulomb_sigma_nm = 0.01 * m.joint[i].friction[0].f0_nm;
        m.joint[i].wander_sigma_nm = 0.0075 * m.joint[i].friction[0].f0_nm;
        m.joint[i].wander_s = 10;
        m.joint[i].torque_noise_m_nm = 0.001 * m.joint[i].tau_max_m_nm;
    }
    model = checked(m);
    servo_init(&servo, &model, NULL, start_q, 1);
}

static void set_up_format(enum drv_format format)
{
    struct servo_cfg cfg = { .format = format };
    servo_init(&servo, &model, &cfg, start_q, 1);
}

/* In the servo's own format; every answer is held to the reply rule. */
static struct drv_state ask(const struct drv_command *c)
{
    struct hdt_frame in, out;
    struct drv_state s;
    ck_assert_int_eq(drv_command_encode(servo.cfg.format, c, &in), DRV_TELEGRAM_OK);
    ck_assert_int_eq(servo_answer(&servo, &in, &out), 1);
    ck_assert_int_eq(drv_state_decode(servo.cfg.format, &out, &s), DRV_TELEGRAM_OK);
    ck_assert_int_eq(s.seq, c->seq);
    ck_assert_int_eq(s.type, c->type);
    ck_assert_int_eq(s.axis_no, c->axis_no);
    ck_assert_int_eq(s.address, c->address);
    return s;
}

static struct drv_state select_axis(uint8_t type, int axis_no)
{
    struct drv_command c = { .seq = 200, .type = type, .axis_no = (uint8_t)axis_no };
    return ask(&c);
}

static struct drv_state say(uint8_t type)
{
    static uint8_t seq;
    struct drv_command c = { .seq = seq++, .type = type };
    if (type == 'M' || type == 'R' || type == 'A')
        c.axis_no = 1;
    for (int i = 0; i < N; i++)
        c.axis[i].mode = PARKED;
    return ask(&c);
}

/* Cyclic command: axis `index` (or all, -1) gets mode and value, the others hold at speed zero. */
static struct drv_state drive(int index, uint16_t mode, int16_t value)
{
    struct drv_command c = { .seq = 1, .type = DRV_CYCLIC };
    for (int i = 0; i < N; i++) {
        int mine = i == index || index < 0;
        c.axis[i].mode = mine ? mode : DRIVE;
        c.axis[i].torque_dig = mine && (mode & DRV_AXIS_TORQUE) ? value : 0;
        c.axis[i].speed_dig = mine && !(mode & DRV_AXIS_TORQUE) ? value : 0;
    }
    return ask(&c);
}

static void drive_for(int index, uint16_t mode, int16_t value, double span_s)
{
    for (int k = 0; k < span_s * SERVO_RATE_HZ; k++) {
        drive(index, mode, value);
        servo_tick(&servo);
    }
}

static unsigned alarm_of(uint16_t status)
{
    return (status & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT;
}

static double rotor_rad(int i)
{
    return servo.plant.th_m_rad[i] / PA10_RATIO;
}

/* ---- modes ---- */

START_TEST(test_every_mode_answers_every_type_and_goes_where_the_table_says)
{
    static const uint8_t type[7] = { 'S', 'E', 'T', 'C', 'M', 'R', 'A' };
    enum { STOP = SERVO_STOP, CTRL = SERVO_CONTROL, FREE = SERVO_BRAKE_RELEASE };
    static const int next[3][7] = {
        [STOP] = { CTRL, STOP, FREE, STOP, STOP, STOP, STOP },
        [CTRL] = { CTRL, STOP, CTRL, CTRL, CTRL, CTRL, CTRL },
        [FREE] = { FREE, STOP, FREE, FREE, FREE, FREE, FREE },
    };
    for (int k = 0; k < 2 * 3 * 7; k++) {
        int mode = k / 2 / 7, t = k / 2 % 7;
        set_up_format(k % 2 ? DRV_FORMAT_B : DRV_FORMAT_A);
        ck_assert_int_eq(servo.s.mode, SERVO_STOP);
        if (mode != SERVO_STOP)
            say(mode == SERVO_CONTROL ? DRV_START : DRV_BRAKE_RELEASE);
        ck_assert_int_eq(servo.s.mode, mode);
        say(type[t]);
        ck_assert_int_eq(servo.s.mode, next[mode][t]);
        ck_assert_uint_eq(servo.plant.locked, 0x7f); /* no telegram so far took a brake off */
        servo_tick(&servo);
        ck_assert_int_eq(servo.s.mode, next[mode][t]);
    }
}
END_TEST

START_TEST(test_unknown_types_and_wrong_lengths_get_no_answer)
{
    struct hdt_frame in, out;
    struct servo before;
    for (int b = 0; b < 2; b++) {
        set_up_format(b ? DRV_FORMAT_B : DRV_FORMAT_A);
        say(DRV_START);
        for (int type = 0; type < 256; type++)
            for (unsigned len = 0; len <= HDT_FRAME_MAX; len++) {
                int known = ((type == 'S' || type == 'E' || type == 'T') && len == 2)
                            || (type == 'C' && len == (b ? 46u : 37u));
                if (known) /* M, R and A are of axis 0 here, which there is not */
                    continue;
                memset(&in, 0, sizeof in);
                in.len = (uint16_t)len;
                in.data[1] = (uint8_t)type;
                before = servo;
                ck_assert_int_eq(servo_answer(&servo, &in, &out), 0);
                before.s.refused++;
                before.s.other_format += type == 'C' && len == (b ? 37u : 46u);
                ck_assert(memcmp(&before, &servo, sizeof servo) == 0);
            }
    }
}
END_TEST

/* Commands just in time keep mode `release` going, one too late stops it. */
static void watchdog(enum drv_format format, double own_s, double limit_s, int release)
{
    struct servo_cfg cfg = { .format = format, .watchdog_s = own_s };
    servo_init(&servo, &model, &cfg, start_q, 1);
    say(release ? DRV_BRAKE_RELEASE : DRV_START);
    for (int k = 0; k < 5; k++) {
        drive(-1, DRIVE, 100);
        for (int t = 0; t < (int)(limit_s * SERVO_RATE_HZ); t++)
            servo_tick(&servo);
        ck_assert_int_ne(servo.s.mode, SERVO_STOP);
    }
    ck_assert_uint_eq(servo.plant.locked, 0);
    drive(-1, DRIVE, 100);
    for (int t = 0; t < (int)(limit_s * SERVO_RATE_HZ) + 3; t++) {
        servo_tick(&servo);
        say('R'); /* any other telegram feeds no watchdog */
    }
    ck_assert_int_eq(servo.s.mode, SERVO_STOP);
    ck_assert_uint_eq(servo.plant.locked, 0x7f);
}

START_TEST(test_watchdog_stops_brakes_and_raises_alarms)
{
    for (int k = 0; k < 8; k++) {
        enum drv_format format = k & 1 ? DRV_FORMAT_B : DRV_FORMAT_A;
        double own_s = k & 2 ? 0.1 : 0;
        watchdog(format, own_s, own_s > 0 ? own_s : k & 1 ? 0.010 : 0.4, k & 4);
        struct drv_state s = say(DRV_CYCLIC);
        ck_assert_uint_eq(alarm_of(s.driver_status), DRV_DRIVER_HOST_TIMEOUT);
        ck_assert(s.driver_status & DRV_DRIVER_UNCONTROLLABLE);
        for (int i = 0; i < N; i++) {
            ck_assert_uint_eq(alarm_of(s.axis[i].status), DRV_ALARM_TIMEOUT);
            ck_assert(s.axis[i].status & DRV_AXIS_UNCONTROLLABLE);
            ck_assert(s.axis[i].status & DRV_AXIS_POWER_OFF);
        }
        say(own_s > 0 ? DRV_START : DRV_END); /* either way back clears */
        s = say(DRV_CYCLIC);
        ck_assert_uint_eq(alarm_of(s.driver_status), 0);
        ck_assert_uint_eq(alarm_of(s.axis[0].status), 0);
    }
}
END_TEST

START_TEST(test_stop_needs_no_host)
{
    for (int t = 0; t < 3 * SERVO_RATE_HZ; t++)
        servo_tick(&servo);
    struct drv_state s = say(DRV_CYCLIC);
    ck_assert_uint_eq(s.driver_status, DRV_DRIVER_DEADMAN_ON);
    ck_assert_uint_eq(s.axis[1].status, DRV_AXIS_POWER_OFF);
}
END_TEST

START_TEST(test_brakes_hold_until_control_and_their_bit_say_otherwise)
{
    double held[N];
    model.payload_kg = 8; /* more than friction carries */
    model.payload_com_m[2] = 0.1;
    servo_init(&servo, &model, NULL, leaning_q, 1);
    memcpy(held, servo.plant.th_m_rad, sizeof held);
    drive_for(-1, DRIVE, 500, 0.5); /* in STOP nobody listens */
    ck_assert(memcmp(held, servo.plant.th_m_rad, sizeof held) == 0);
    say(DRV_START);
    for (int k = 0; k < 100; k++)
        servo_tick(&servo);
    ck_assert(memcmp(held, servo.plant.th_m_rad, sizeof held) == 0);
    drive_for(1, PARKED, 0, 0.5); /* one brake on, the others driven */
    ck_assert_uint_eq(servo.plant.locked, 1u << 1);
    ck_assert(servo.plant.th_m_rad[1] == held[1]);
    drive_for(1, 0, 0, 0.5); /* brake off, servo off: it falls, forward and down */
    ck_assert_double_lt(rotor_rad(1), held[1] / PA10_RATIO - 0.05);
    say(DRV_END);
    memcpy(held, servo.plant.th_m_rad, sizeof held);
    for (int k = 0; k < 100; k++)
        servo_tick(&servo);
    ck_assert(memcmp(held, servo.plant.th_m_rad, sizeof held) == 0);
}
END_TEST

START_TEST(test_brake_release_frees_the_arm_and_never_drives_it)
{
    model.payload_kg = 8;
    model.payload_com_m[2] = 0.1;
    servo_init(&servo, &model, NULL, leaning_q, 1);
    say(DRV_BRAKE_RELEASE);
    double before = rotor_rad(1);
    drive_for(1, TORQUE, 4000, 0.3);
    for (int i = 0; i < N; i++)
        ck_assert_double_eq(servo.s.tau_m_nm[i], 0);
    ck_assert_double_lt(rotor_rad(1), before - 0.01);
    struct drv_state s = drive(1, TORQUE, 4000);
    ck_assert(s.axis[1].status & DRV_AXIS_POWER_OFF);
    ck_assert_int_eq(s.axis[1].torque_dig, 0);
}
END_TEST

/* ---- torque and position words ---- */

START_TEST(test_torque_mode_makes_a_millinewtonmetre_a_digit_and_saturates)
{
    say(DRV_START);
    drive_for(2, TORQUE, -1234, 0.01);
    ck_assert_double_eq_tol(servo.s.tau_m_nm[2], -1.234, 1e-12);
    ck_assert_int_eq(drive(2, TORQUE, -1234).axis[2].torque_dig, -1234);
    drive_for(2, TORQUE, 32767, 0.01);
    ck_assert_double_eq(servo.s.tau_m_nm[2], 2.0);
    ck_assert_int_eq(drive(2, TORQUE, 32767).axis[2].torque_dig, 2000);
    drive_for(2, TORQUE, -32768, 0.01);
    ck_assert_double_eq(servo.s.tau_m_nm[2], -2.0);
    drive_for(2, DRV_AXIS_TORQUE, 1234, 0.01); /* servo off */
    ck_assert_double_eq(servo.s.tau_m_nm[2], 0);
}
END_TEST

START_TEST(test_reported_torque_rounds_half_to_even_and_saturates)
{
    const struct {
        double torque_nm;
        int digits;
    } at[] = { { 0.0025, 2 }, { 0.0035, 4 }, { 0.0015, 2 },
               { 0.0005, 0 }, { 0.0026, 3 }, { 100, 32767 } };
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++)
        for (int sign = -1; sign <= 1; sign += 2) {
            struct servo_cfg cfg = { .kp_m_nmspr = {
                                         1e4 } }; /* the loop asks for more than there is */
            model.joint[0].tau_max_m_nm = at[k].torque_nm;
            servo_init(&servo, &model, &cfg, start_q, 1);
            say(DRV_START);
            drive_for(0, DRIVE, (int16_t)(sign * 30000), 0.005);
            ck_assert_double_eq(servo.s.tau_m_nm[0], sign * at[k].torque_nm);
            ck_assert_int_eq(drive(0, DRIVE, 0).axis[0].torque_dig, sign * at[k].digits);
        }
}
END_TEST

START_TEST(test_report_is_what_the_servo_believes_not_what_the_motor_gives)
{
    double moved[2];
    for (int gain = 0; gain < 2; gain++) {
        model.joint[0].fx_torque_gain = gain ? 0.2 : 0;
        servo_init(&servo, &model, NULL, start_q, 1);
        say(DRV_START);
        drive_for(0, TORQUE, 1200, 0.5);
        ck_assert_int_eq(drive(0, TORQUE, 1200).axis[0].torque_dig, 1200);
        moved[gain] = rotor_rad(0);
    }
    ck_assert_double_gt(moved[1], 1.3 * moved[0]);
}
END_TEST

START_TEST(test_torque_noise_is_in_the_report_only)
{
    double sum = 0, square = 0;
    int n = 20000;
    model.joint[0].torque_noise_m_nm = 0.004;
    servo_init(&servo, &model, NULL, start_q, 1);
    say(DRV_START);
    for (int k = 0; k < n; k++) {
        struct drv_state s = drive(0, TORQUE, 300);
        servo_tick(&servo);
        ck_assert(k < 2 || servo.s.tau_m_nm[0] == 0.3);
        if (k >= 2) {
            sum += s.axis[0].torque_dig - 300;
            square += pow(s.axis[0].torque_dig - 300, 2);
        }
    }
    ck_assert_double_eq_tol(sum / n, 0, 4 * 4 / sqrt(n));
    /* 4 digits of noise and a twelfth of a digit squared of rounding */
    ck_assert_double_eq_tol(sqrt(square / n), sqrt(16 + 1.0 / 12), 4 * 4 / sqrt(2 * n));
}
END_TEST

START_TEST(test_position_word_is_the_rotor_not_the_link)
{
    servo.zero_cnt[1] = 1000;
    say(DRV_START);
    drive_for(1, DRIVE, 500, 0.5);
    struct drv_state s = drive(1, DRIVE, 500);
    for (int i = 0; i < N; i++) {
        double count = servo.plant.th_m_rad[i] / 6.283185307179586 * 16384 + (i == 1 ? 1000 : 0);
        ck_assert_double_le(fabs(s.axis[i].count - count), 0.5);
    }
    double link = servo.plant.q_rad[1] * 50 / 6.283185307179586 * 16384 + 1000;
    ck_assert_double_gt(fabs(s.axis[1].count - link), 20); /* the wind-up, in counts */
}
END_TEST

START_TEST(test_axes_the_arm_lacks_are_zero_and_joints_past_the_telegram_stay_braked)
{
    struct plant_model shorter = pa10_plant(), longer = pa10_plant();
    shorter.joints = 4;
    model = checked(shorter);
    servo_init(&servo, &model, NULL, start_q, 1);
    say(DRV_START);
    drive_for(-1, TORQUE, 500, 0.1);
    struct drv_state s = drive(-1, TORQUE, 500);
    ck_assert_int_eq(s.axis[3].torque_dig, 500);
    for (int i = 4; i < DRV_AXES; i++)
        ck_assert(s.axis[i].status == 0 && s.axis[i].count == 0 && s.axis[i].torque_dig == 0);

    longer.joints = 9;
    longer.joint[7] = longer.joint[5];
    longer.joint[8] = longer.joint[6];
    double q[9] = { 0, 0.5, 0, 0.5, 0, 0.5, 0, 0.5, 0 };
    model = checked(longer);
    servo_init(&servo, &model, NULL, q, 1);
    double held = servo.plant.th_m_rad[7];
    say(DRV_START);
    drive_for(-1, TORQUE, 100, 0.3);
    ck_assert_uint_eq(servo.plant.locked, 3u << 7);
    ck_assert(servo.plant.th_m_rad[7] == held);
}
END_TEST

START_TEST(test_format_b_counts_torque_in_rated_over_4096_and_reports_speed)
{
    struct servo_cfg cfg = { .format = DRV_FORMAT_B, .watchdog_s = 1, .rated_m_nm = { [2] = 1.5 } };
    servo_init(&servo, &model, &cfg, start_q, 1);
    say(DRV_START);
    drive_for(2, TORQUE, -1234, 0.01);
    ck_assert_double_eq_tol(servo.s.tau_m_nm[2], -1234 * 1.5 / 4096, 1e-12);
    ck_assert_int_eq(drive(2, TORQUE, -1234).axis[2].torque_dig, -1234);
    drive_for(2, TORQUE, 32767, 0.01);
    ck_assert_double_eq(servo.s.tau_m_nm[2], 2.0);
    ck_assert_int_eq(drive(2, TORQUE, 0).axis[2].torque_dig, (int)nearbyint(2.0 / 1.5 * 4096));
    drive_for(3, TORQUE, 4096, 0.01); /* no rated torque given: the model's limit */
    ck_assert_double_eq(servo.s.tau_m_nm[3], model.joint[3].tau_max_m_nm);

    servo_init(&servo, &model, &cfg, start_q, 1);
    say(DRV_START);
    for (int sign = -1; sign <= 1; sign += 2) {
        drive_for(0, DRIVE, (int16_t)(sign * 2000), 0.5); /* 0.4 rad/s */
        ck_assert_double_eq_tol(drive(0, DRIVE, 0).axis[0].speed_dig, sign * 2000, 200);
        ck_assert_int_eq(drive(0, DRIVE, 0).axis[0].speed_dig,
                         (int)nearbyint(servo.s.speed_radps[0] / 0.0002));
    }
    servo.s.speed_radps[0] = 100;
    ck_assert_int_eq(drive(0, DRIVE, 0).axis[0].speed_dig, 32767);
}
END_TEST

/* ---- M, R, A ---- */

static int32_t long_word(const struct drv_state *s, int high, int low)
{
    return (int32_t)((uint32_t)s->word[high] << 16 | s->word[low]);
}

START_TEST(test_table_holds_soft_limits_zero_offset_and_poles)
{
    for (int b = 0; b < 2; b++) {
        struct servo_cfg cfg = { .format = b ? DRV_FORMAT_B : DRV_FORMAT_A, .poles = b ? 4 : 0 };
        servo_init(&servo, &model, &cfg, start_q, 1);
        model.joint[5].q_min_rad = -1.25;
        servo.zero_cnt[5] = -70000;
        for (int i = 0; i < N; i++) {
            struct drv_state s = select_axis('R', i + 1);
            /* degrees as the public driver reads them: 360 x 4 / (65536 50), x in counts */
            double degree = 360.0 * 4 / (65536.0 * 50), per_rad = 180 / 3.14159265358979;
            ck_assert_double_eq_tol(long_word(&s, 18, 19) * degree, model.joint[i].q_max_rad * per_rad, 3e-4);
            ck_assert_double_eq_tol(long_word(&s, 20, 21) * degree, model.joint[i].q_min_rad * per_rad, 3e-4);
            ck_assert_int_eq(long_word(&s, 23, 22), i == 5 ? -70000 : 0);
            ck_assert_uint_eq(s.word[27], b ? 4 : 8);
        }
        struct drv_command c = { .type = 'R', .axis_no = 6, .address = 32 };
        struct drv_state s = ask(&c);
        for (int k = 0; k < DRV_TABLE_WORDS; k++)
            ck_assert_uint_eq(s.word[k], 0);
    }
}
END_TEST

START_TEST(test_zero_is_set_in_stop_only_and_moves_nothing)
{
    for (int b = 0; b < 2; b++) {
        set_up_format(b ? DRV_FORMAT_B : DRV_FORMAT_A);
        int32_t before[N];
        struct drv_state s = say(DRV_CYCLIC);
        for (int i = 0; i < N; i++)
            before[i] = s.axis[i].count;
        ck_assert_int_ne(before[3], 0);
        say(DRV_START);
        select_axis('M', 4);
        ck_assert_int_eq(say(DRV_CYCLIC).axis[3].count, before[3]);
        say(DRV_END);
        double at = rotor_rad(3);
        select_axis('M', 4);
        s = say(DRV_CYCLIC);
        ck_assert_int_eq(s.axis[3].count, 0);
        for (int i = 0; i < N; i++)
            ck_assert_int_eq(s.axis[i].count, i == 3 ? 0 : before[i]);
        ck_assert(rotor_rad(3) == at);
        s = select_axis('R', 4);
        ck_assert_int_eq(long_word(&s, 23, 22), -before[3]);
        ck_assert_uint_eq(alarm_of(say(DRV_CYCLIC).axis[3].status), 0);
    }
}
END_TEST

START_TEST(test_clear_takes_one_axis_and_with_the_last_the_driver)
{
    for (int b = 0; b < 2; b++) {
        watchdog(b ? DRV_FORMAT_B : DRV_FORMAT_A, 0.1, 0.1, 0);
        for (int i = 0; i < N; i++) {
            struct drv_state s = say(DRV_CYCLIC);
            for (int k = 0; k < N; k++)
                ck_assert_uint_eq(alarm_of(s.axis[k].status), k < i ? 0 : DRV_ALARM_TIMEOUT);
            ck_assert_uint_eq(alarm_of(s.driver_status), DRV_DRIVER_HOST_TIMEOUT);
            select_axis('A', i + 1);
        }
        ck_assert_uint_eq(say(DRV_CYCLIC).driver_status, DRV_DRIVER_DEADMAN_ON);
        ck_assert_int_eq(servo.s.mode, SERVO_STOP);
    }
}
END_TEST

START_TEST(test_axes_the_arm_lacks_are_selected_without_effect)
{
    struct plant_model shorter = pa10_plant();
    shorter.joints = 4;
    model = checked(shorter);
    servo_init(&servo, &model, NULL, start_q, 1);
    struct servo before = servo;
    static const uint8_t types[3] = { 'M', 'R', 'A' };
    for (int t = 0; t < 3; t++)
        for (int axis_no = 5; axis_no <= 7; axis_no++) {
            struct drv_state s = select_axis(types[t], axis_no);
            for (int k = 0; k < DRV_TABLE_WORDS; k++)
                ck_assert_uint_eq(s.word[k], 0);
        }
    before.s.answered += 9;
    ck_assert(memcmp(&before, &servo, sizeof servo) == 0);
}
END_TEST

/* ---- switches, and alarms of single axes ---- */

START_TEST(test_emergency_stop_stops_and_holds_until_released)
{
    for (int b = 0; b < 2; b++) {
        struct servo_cfg cfg = { .format = b ? DRV_FORMAT_B : DRV_FORMAT_A, .watchdog_s = 1 };
        servo_init(&servo, &model, &cfg, start_q, 1);
        say(DRV_START);
        drive_for(-1, DRIVE, 500, 0.2);
        servo_emergency_stop(&servo, 1);
        ck_assert_int_eq(servo.s.mode, SERVO_STOP);
        ck_assert_uint_eq(servo.plant.locked, 0x7f);
        servo_tick(&servo);
        for (int i = 0; i < N; i++)
            ck_assert_double_eq(servo.s.tau_m_nm[i], 0);
        for (int k = 0; k < 4; k++) { /* nothing leads out of it */
            select_axis("AAST"[k], "\1\2\0\0"[k]);
            say(DRV_END);
            struct drv_state s = say(DRV_CYCLIC);
            ck_assert_int_eq(servo.s.mode, SERVO_STOP);
            ck_assert_uint_eq(alarm_of(s.driver_status), DRV_DRIVER_EMERGENCY_STOP);
            ck_assert(s.driver_status & DRV_DRIVER_EMERGENCY_OPEN);
            for (int i = 0; i < N; i++)
                ck_assert_uint_eq(alarm_of(s.axis[i].status), DRV_ALARM_EMERGENCY_STOP);
        }
        servo_emergency_stop(&servo, 0);
        struct drv_state s = say(DRV_CYCLIC); /* latched, but the switch reads closed */
        ck_assert_uint_eq(alarm_of(s.driver_status), DRV_DRIVER_EMERGENCY_STOP);
        ck_assert(!(s.driver_status & DRV_DRIVER_EMERGENCY_OPEN));
        say(DRV_START);
        ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
        ck_assert_uint_eq(say(DRV_CYCLIC).driver_status, DRV_DRIVER_DEADMAN_ON | DRV_DRIVER_POWER_ON);
    }
}
END_TEST

START_TEST(test_dead_man_switch_counts_only_when_watched)
{
    for (int k = 0; k < 4; k++) {
        int b = k & 1, watched = k & 2;
        struct servo_cfg cfg = { .format = b ? DRV_FORMAT_B : DRV_FORMAT_A, .watchdog_s = 1 };
        struct drv_command c = { .type = DRV_CYCLIC };
        servo_init(&servo, &model, &cfg, start_q, 1);
        if (watched && b)
            c.driver_mode = DRV_DRIVER_WATCH_DEADMAN;
        if (watched && !b)
            c.axis[4].mode = DRV_AXIS_DEADMAN;
        if (!watched && b)
            c.axis[4].mode = 0x0008; /* Format A's bit is none in B */
        say(DRV_START);
        ask(&c);
        servo_tick(&servo);
        ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
        servo_deadman(&servo, 1);
        servo_tick(&servo);
        ck_assert_int_eq(servo.s.mode, watched ? SERVO_STOP : SERVO_CONTROL);
        struct drv_state s = say(DRV_CYCLIC);
        ck_assert_uint_eq(alarm_of(s.driver_status), watched ? DRV_DRIVER_DEADMAN : 0);
        ck_assert_uint_eq(alarm_of(s.axis[0].status), watched ? DRV_ALARM_DEADMAN : 0);
        ck_assert(!(s.driver_status & DRV_DRIVER_DEADMAN_ON));
        say(DRV_START); /* stopping has forgotten who watches */
        servo_tick(&servo);
        ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
        servo_deadman(&servo, 0);
        ck_assert(say(DRV_CYCLIC).driver_status & DRV_DRIVER_DEADMAN_ON);
    }
}
END_TEST

/* Axis 3 too fast; axes with an even index stop on an alarm of another, or none does. */
static struct drv_state axis_alarm(enum drv_format format, int stop_with_others)
{
    struct servo_cfg cfg = { .format = format, .watchdog_s = 1, .v_trip_radps = 0.5 };
    struct drv_command c = { .type = DRV_CYCLIC };
    servo_init(&servo, &model, &cfg, start_q, 1);
    say(DRV_START);
    for (int i = 0; i < N; i++) {
        c.axis[i].mode = (uint16_t)(DRIVE | (stop_with_others && i % 2 == 0 ? DRV_AXIS_STOP_ALL : 0));
        c.axis[i].speed_dig = i == 3 ? 3500 : 200;
    }
    for (int k = 0; k < SERVO_RATE_HZ / 2; k++) {
        ask(&c);
        servo_tick(&servo);
    }
    return ask(&c);
}

START_TEST(test_alarm_of_an_axis_stops_all_in_format_a_and_those_that_ask_in_b)
{
    struct drv_state s = axis_alarm(DRV_FORMAT_A, 1);
    ck_assert_int_eq(servo.s.mode, SERVO_STOP);
    ck_assert_uint_eq(alarm_of(s.axis[3].status), DRV_ALARM_OVER_VELOCITY);
    for (int with = 0; with < 2; with++) {
        s = axis_alarm(DRV_FORMAT_B, with);
        uint32_t halted = with ? 0x5d : 0x08;
        ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
        ck_assert_uint_eq(servo.plant.locked, halted);
        for (int i = 0; i < N; i++) {
            int is = halted >> i & 1;
            ck_assert_uint_eq(alarm_of(s.axis[i].status), i == 3 ? DRV_ALARM_OVER_VELOCITY : 0);
            ck_assert_int_eq((s.axis[i].status & DRV_AXIS_UNCONTROLLABLE) != 0, is);
            ck_assert_int_eq((s.axis[i].status & DRV_AXIS_POWER_OFF) != 0, is);
            ck_assert((servo.s.tau_m_nm[i] == 0) == is);
        }
    }
    /* cleared, it stands until it is told again */
    select_axis('A', 4);
    servo_tick(&servo);
    ck_assert_uint_eq(servo.plant.locked, 0x5d);
    ck_assert_double_eq(servo.s.tau_m_nm[3], 0);
    drive_for(-1, DRIVE, 200, 0.3);
    ck_assert_uint_eq(servo.plant.locked, 0);
    ck_assert_uint_eq(drive(-1, DRIVE, 200).axis[3].status, 0);
    ck_assert_double_eq_tol(servo.plant.thd_m_radps[3] / PA10_RATIO, 0.04, 0.02);
    /* the same while another axis still is in alarm */
    axis_alarm(DRV_FORMAT_B, 0);
    servo.s.alarm[5] = DRV_ALARM_OVER_CURRENT;
    servo_tick(&servo);
    select_axis('A', 4);
    for (int k = 0; k < 5; k++)
        servo_tick(&servo);
    ck_assert_double_eq(servo.s.tau_m_nm[3], 0);
    ck_assert_double_eq(servo.s.tau_m_nm[5], 0);
    ck_assert_uint_eq(servo.s.halted, 0x28);
}
END_TEST

/* ---- velocity loop ---- */

/* Bounds below: mean over the stretch; the rotor's way against the ideal ramp; speed ripple. */
static void hold_speed(int i, double speed_radps, double ripple_share)
{
    double span_s = fmin(3, 0.8 / fabs(speed_radps)), sum = 0, square = 0, worst = 0;
    int n = (int)(span_s * SERVO_RATE_HZ);
    servo_init(&servo, &model, NULL, start_q, 5);
    say(DRV_START);
    drive_for(i, DRIVE, (int16_t)nearbyint(speed_radps * 5000), 0.5);
    double from = rotor_rad(i), others[N];
    for (int k = 0; k < N; k++)
        others[k] = rotor_rad(k);
    for (int k = 1; k <= n; k++) {
        drive(i, DRIVE, (int16_t)nearbyint(speed_radps * 5000));
        servo_tick(&servo);
        double v = servo.plant.thd_m_radps[i] / PA10_RATIO;
        sum += v / n;
        square += (v - speed_radps) * (v - speed_radps) / n;
        worst = fmax(worst, fabs(rotor_rad(i) - from - speed_radps * k / SERVO_RATE_HZ));
    }
    ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
    ck_assert_msg(fabs(sum - speed_radps) < 0.02 * fabs(speed_radps) + 1e-4,
                  "joint %d: %g for %g rad/s", i + 1, sum, speed_radps);
    ck_assert_msg(worst < 2e-3, "joint %d at %g rad/s: %g rad behind", i + 1, speed_radps, worst);
    ck_assert_msg(sqrt(square) < ripple_share * fabs(speed_radps),
                  "joint %d at %g rad/s: ripple %g", i + 1, speed_radps, sqrt(square));
    for (int k = 0; k < N; k++)
        if (k != i)
            ck_assert_double_eq_tol(rotor_rad(k), others[k], 1e-3);
}

START_TEST(test_velocity_loop_holds_speed_on_every_joint)
{
    static const double at[] = { 0.01, 0.05, 0.1, 0.4 };
    for (int i = 0; i < N; i++)
        for (size_t k = 0; k < sizeof at / sizeof at[0]; k++)
            for (int sign = -1; sign <= 1; sign += 2)
                /* joint 7's friction falls with speed (Table II): at 0.01 rad/s it slips and sticks */
                hold_speed(i, sign * at[k], i == 6 && k == 0 ? 1.0 : 0.2);
}
END_TEST

START_TEST(test_velocity_loop_has_a_gain_margin_of_one_and_a_half)
{
    for (int i = 0; i < N; i++)
        for (int up = 0; up < 2; up++) {
            struct servo_cfg cfg;
            servo_init(&servo, &model, NULL, start_q, 5);
            cfg = servo.cfg;
            for (int k = 0; k < N; k++) {
                cfg.kp_m_nmspr[k] *= up ? 1.5 : 1 / 1.5;
                cfg.ki_m_nmprad[k] *= up ? 1.5 : 1 / 1.5;
            }
            servo_init(&servo, &model, &cfg, start_q, 5);
            say(DRV_START);
            drive_for(i, DRIVE, 1500, 0.5);
            for (int k = 0; k < SERVO_RATE_HZ; k++) {
                drive(i, DRIVE, 1500);
                servo_tick(&servo);
                ck_assert_double_eq_tol(servo.plant.thd_m_radps[i] / PA10_RATIO, 0.3, 0.15);
            }
        }
}
END_TEST

START_TEST(test_speed_mode_brought_to_a_halt_stands)
{
    say(DRV_START);
    drive_for(-1, DRIVE, 1000, 0.3);
    drive_for(-1, DRIVE, 0, 1);
    double at[N];
    for (int i = 0; i < N; i++)
        at[i] = rotor_rad(i);
    drive_for(-1, DRIVE, 0, 3);
    for (int i = 0; i < N; i++)
        ck_assert_double_eq_tol(rotor_rad(i), at[i], 2e-4);
}
END_TEST

START_TEST(test_saturated_loop_does_not_wind_up)
{
    model.joint[0].tau_max_m_nm =
        0.9; /* 45 N.m at the output: slides, but never reaches the speed asked for */
    servo_init(&servo, &model, NULL, start_q, 1);
    say(DRV_START);
    drive_for(0, DRIVE, 10000, 1);
    ck_assert_double_eq(servo.s.tau_m_nm[0], 0.9);
    ck_assert_double_le(fabs(servo.s.integral_m_nm[0]), 0.9);
    drive_for(0, DRIVE, 0, 0.25);
    ck_assert_double_lt(fabs(servo.plant.thd_m_radps[0] / PA10_RATIO), 0.02);
}
END_TEST

START_TEST(test_change_from_torque_to_speed_is_bumpless)
{
    say(DRV_START);
    drive_for(1, DRIVE, 0, 1);
    int16_t hold = (int16_t)nearbyint(servo.plant.gear_nm[1] / PA10_RATIO * 1000);
    drive_for(1, TORQUE, hold, 1);
    double at = rotor_rad(1);
    drive_for(1, DRIVE, 0, 0.01);
    ck_assert_double_eq_tol(servo.s.tau_m_nm[1] * 1000, hold, 0.15 * fabs((double)hold));
    drive_for(1, DRIVE, 0, 1);
    ck_assert_double_eq_tol(rotor_rad(1), at, 1e-4);
    ck_assert_double_gt(fabs((double)hold), 300);
}
END_TEST

/* ---- alarms ---- */

START_TEST(test_over_velocity_stops_the_arm)
{
    struct servo_cfg cfg = { .v_trip_radps = 0.5 };
    servo_init(&servo, &model, &cfg, start_q, 1);
    say(DRV_START);
    drive_for(2, DRIVE, 2000, 0.4); /* 0.4 rad/s is fine */
    ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
    drive_for(2, DRIVE, -3500, 0.4);
    struct drv_state s = say(DRV_CYCLIC);
    ck_assert_int_eq(servo.s.mode, SERVO_STOP);
    ck_assert_uint_eq(alarm_of(s.axis[2].status), DRV_ALARM_OVER_VELOCITY);
    ck_assert_uint_eq(alarm_of(s.axis[1].status), 0);
    ck_assert_uint_eq(alarm_of(s.driver_status), 0);
}
END_TEST

START_TEST(test_position_limit_stops_the_arm_and_lets_it_back)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        double q[N];
        memcpy(q, start_q, sizeof q);
        q[3] = sign * (model.joint[3].q_max_rad - 0.02);
        servo_init(&servo, &model, NULL, q, 1);
        say(DRV_START);
        drive_for(3, DRIVE, (int16_t)(sign * 1000), 0.5);
        struct drv_state s = say(DRV_CYCLIC);
        ck_assert_int_eq(servo.s.mode, SERVO_STOP);
        ck_assert_uint_eq(alarm_of(s.axis[3].status), DRV_ALARM_POSITION_LIMIT);
        ck_assert_uint_eq(s.axis[3].status & 3u,
                          sign > 0 ? DRV_AXIS_LIMIT_POS : DRV_AXIS_LIMIT_NEG);
        say(DRV_START);
        drive_for(3, DRIVE, (int16_t)(-sign * 1000), 0.5);
        ck_assert_int_eq(servo.s.mode, SERVO_CONTROL);
        ck_assert_uint_eq(drive(3, DRIVE, 0).axis[3].status, 0);
    }
}
END_TEST

/* ---- robustness and reproducibility ---- */

START_TEST(test_any_bytes_are_safe_and_numbers_stay_numbers)
{
    static const uint8_t types[] = { 'S', 'E', 'C', 'T', 'C', 'C', 'C', 'S', 'M', 'R', 'A' };
    uint64_t rng = 99;
    set_up_format(_i ? DRV_FORMAT_B : DRV_FORMAT_A);
    for (int k = 0; k < 6 * SERVO_RATE_HZ; k++) {
        struct hdt_frame in, out;
        for (int b = 0; b < HDT_FRAME_MAX; b++)
            in.data[b] = (uint8_t)test_random(&rng);
        in.len = (uint16_t)(test_random(&rng) % (HDT_FRAME_MAX + 1));
        if (test_random(&rng) % 2) { /* well formed, random inside */
            in.data[1] = types[test_random(&rng) % sizeof types];
            in.len = in.data[1] == 'C' ? _i ? DRV_COMMAND_LEN_B : DRV_COMMAND_LEN
                     : strchr("MRA", in.data[1]) ? 4 : 2;
            in.data[2] = in.data[1] == 'A' && _i ? 0 : in.data[1] == 'C' ? in.data[2] : in.data[2] % 9;
            in.data[3] = in.data[1] == 'M' || (in.data[1] == 'A' && !_i) ? 0 : in.data[3];
        }
        if (test_random(&rng) % 4 == 0) {
            struct drv_state s;
            if (servo_answer(&servo, &in, &out))
                ck_assert_int_eq(drv_state_decode(servo.cfg.format, &out, &s), DRV_TELEGRAM_OK);
        }
        if (test_random(&rng) % 512 == 0)
            servo_emergency_stop(&servo, test_random(&rng) % 3 == 0);
        servo_deadman(&servo, test_random(&rng) % 64 == 0);
        servo_tick(&servo);
        for (int i = 0; i < N; i++) {
            ck_assert(isfinite(servo.plant.q_rad[i]) && isfinite(servo.plant.thd_m_radps[i]));
            ck_assert(isfinite(servo.s.tau_m_nm[i]) && isfinite(servo.s.speed_radps[i]));
            ck_assert_double_le(fabs(servo.s.tau_m_nm[i]), model.joint[i].tau_max_m_nm);
        }
        ck_assert(servo.s.mode != SERVO_STOP || servo.plant.locked == 0x7f);
        ck_assert(!servo.s.emergency || servo.s.mode == SERVO_STOP);
    }
    ck_assert_uint_gt(servo.s.answered, 100);
    ck_assert_uint_gt(servo.s.refused, 100);
}
END_TEST

START_TEST(test_same_seed_same_bytes_and_a_copy_replays)
{
    set_up_imperfect();
    say(DRV_START);
    drive_for(1, DRIVE, 700, 0.5);
    twin = servo;
    drive_for(1, DRIVE, -300, 0.5);
    struct servo first = servo;
    servo = twin;
    drive_for(1, DRIVE, -300, 0.5);
    ck_assert(memcmp(&first, &servo, sizeof servo) == 0);
    servo_init(&servo, &model, NULL, start_q, 1);
    say(DRV_START);
    drive_for(1, DRIVE, 700, 0.5);
    ck_assert(memcmp(&twin, &servo, sizeof servo) == 0);
}
END_TEST

/* A bus that plays a list of results, then has nothing more. */
struct script { int result[8], at, sent, send_result; struct hdt_frame frame; };

static int script_recv(void *ctx, struct hdt_frame *f)
{
    struct script *s = ctx;
    *f = s->frame;
    return s->at < 8 ? s->result[s->at++] : HDT_BUS_ERR_AGAIN;
}

static int script_send(void *ctx, const struct hdt_frame *f)
{
    struct script *s = ctx;
    (void)f;
    s->sent++;
    return s->send_result;
}

START_TEST(test_serve_answers_what_waits_and_passes_failures_on)
{
    struct drv_command c = { .seq = 3, .type = DRV_START };
    struct script s = { .result = { 0, HDT_BUS_ERR_FRAME, 0, HDT_BUS_ERR_AGAIN } };
    struct hdt_bus bus = { .ctx = &s, .send = script_send, .recv = script_recv };
    drv_command_encode(DRV_FORMAT_A, &c, &s.frame);
    ck_assert_int_eq(servo_serve(&servo, &bus), 2);
    ck_assert_int_eq(s.sent, 2);
    ck_assert_uint_eq(servo.s.refused, 1);
    s = (struct script){ .result = { 0, HDT_BUS_ERR_DOWN }, .frame = s.frame };
    ck_assert_int_eq(servo_serve(&servo, &bus), HDT_BUS_ERR_DOWN);
    s = (struct script){ .result = { 0, HDT_BUS_ERR_AGAIN },
                         .send_result = HDT_BUS_ERR_AGAIN,
                         .frame = s.frame };
    ck_assert_int_eq(servo_serve(&servo, &bus), 1);
    uint64_t refused = servo.s.refused; /* an answer this bus cannot carry: not the end of serving */
    s = (struct script){ .result = { 0, 0, HDT_BUS_ERR_AGAIN },
                         .send_result = HDT_BUS_ERR_FRAME,
                         .frame = s.frame };
    ck_assert_int_eq(servo_serve(&servo, &bus), 0);
    ck_assert_uint_eq(servo.s.refused, refused + 2);
    s = (struct script){ .result = { 0, HDT_BUS_ERR_AGAIN },
                         .send_result = HDT_BUS_ERR_DOWN,
                         .frame = s.frame };
    ck_assert_int_eq(servo_serve(&servo, &bus), HDT_BUS_ERR_DOWN);
    s = (struct script){ .result = { 0, HDT_BUS_ERR_AGAIN },
                         .frame = { .len = 2, .data = { 1, 'Z' } } };
    ck_assert_int_eq(servo_serve(&servo, &bus), 0);
    ck_assert_int_eq(s.sent, 0);
}
END_TEST

/* A host that floods must not keep the servo from its next tick. */
static int flood_recv(void *ctx, struct hdt_frame *f)
{
    *f = ((struct script *)ctx)->frame;
    return HDT_BUS_OK;
}

START_TEST(test_serve_comes_back_from_a_flood)
{
    struct drv_command c = { .seq = 3, .type = DRV_CYCLIC };
    struct script s = { .at = 0 };
    struct hdt_bus bus = { .ctx = &s, .send = script_send, .recv = flood_recv };
    drv_command_encode(DRV_FORMAT_A, &c, &s.frame);
    ck_assert_int_gt(servo_serve(&servo, &bus), 1);
}
END_TEST

static Suite *servo_suite(void)
{
    Suite *suite = suite_create("servo");
    TCase *modes = tcase_create("modes"), *words = tcase_create("words"),
          *loop = tcase_create("velocity loop"), *rest = tcase_create("alarms and bytes");
    tcase_add_test(modes, test_every_mode_answers_every_type_and_goes_where_the_table_says);
    tcase_add_test(modes, test_unknown_types_and_wrong_lengths_get_no_answer);
    tcase_add_test(modes, test_watchdog_stops_brakes_and_raises_alarms);
    tcase_add_test(modes, test_stop_needs_no_host);
    tcase_add_test(modes, test_brakes_hold_until_control_and_their_bit_say_otherwise);
    tcase_add_test(modes, test_brake_release_frees_the_arm_and_never_drives_it);
    tcase_add_test(words, test_torque_mode_makes_a_millinewtonmetre_a_digit_and_saturates);
    tcase_add_test(words, test_reported_torque_rounds_half_to_even_and_saturates);
    tcase_add_test(words, test_report_is_what_the_servo_believes_not_what_the_motor_gives);
    tcase_add_test(words, test_torque_noise_is_in_the_report_only);
    tcase_add_test(words, test_position_word_is_the_rotor_not_the_link);
    tcase_add_test(words,
                   test_axes_the_arm_lacks_are_zero_and_joints_past_the_telegram_stay_braked);
    tcase_add_test(words, test_format_b_counts_torque_in_rated_over_4096_and_reports_speed);
    tcase_add_test(modes, test_table_holds_soft_limits_zero_offset_and_poles);
    tcase_add_test(modes, test_zero_is_set_in_stop_only_and_moves_nothing);
    tcase_add_test(modes, test_clear_takes_one_axis_and_with_the_last_the_driver);
    tcase_add_test(modes, test_axes_the_arm_lacks_are_selected_without_effect);
    tcase_add_test(rest, test_emergency_stop_stops_and_holds_until_released);
    tcase_add_test(rest, test_dead_man_switch_counts_only_when_watched);
    tcase_add_test(rest, test_alarm_of_an_axis_stops_all_in_format_a_and_those_that_ask_in_b);
    tcase_add_test(loop, test_velocity_loop_holds_speed_on_every_joint);
    tcase_add_test(loop, test_velocity_loop_has_a_gain_margin_of_one_and_a_half);
    tcase_add_test(loop, test_speed_mode_brought_to_a_halt_stands);
    tcase_add_test(loop, test_saturated_loop_does_not_wind_up);
    tcase_add_test(loop, test_change_from_torque_to_speed_is_bumpless);
    tcase_add_test(rest, test_over_velocity_stops_the_arm);
    tcase_add_test(rest, test_position_limit_stops_the_arm_and_lets_it_back);
    tcase_add_loop_test(rest, test_any_bytes_are_safe_and_numbers_stay_numbers, 0, 2);
    tcase_add_test(rest, test_same_seed_same_bytes_and_a_copy_replays);
    tcase_add_test(rest, test_serve_answers_what_waits_and_passes_failures_on);
    tcase_add_test(rest, test_serve_comes_back_from_a_flood);
    tcase_add_checked_fixture(modes, set_up, NULL);
    tcase_add_checked_fixture(words, set_up, NULL);
    tcase_add_checked_fixture(loop, set_up_imperfect, NULL);
    tcase_add_checked_fixture(rest, set_up, NULL);
    TCase *all[] = { modes, words, loop, rest };
    for (size_t k = 0; k < sizeof all / sizeof all[0]; k++) {
        tcase_set_timeout(all[k], 240);
        suite_add_tcase(suite, all[k]);
    }
    return suite;
}

HDT_CHECK_MAIN(servo_suite())
