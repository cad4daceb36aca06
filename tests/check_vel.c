/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Velocity estimate.
 * Goal: the filter is the Butterworth low-pass it claims to be, exact at rest and over counter wrap.
 * Method: a double-precision biquad beside it, sines, gaps, extremes.
 */
#include "ctrl/hdt_vel.h"
#include "tests/core_reference.h"

/* PA-10: 50 * 16384 counts a turn; 700 Hz */
#define RAD_PER_COUNT (2 * REF_PI / 819200)
static int64_t pa10_per_count(void)
{
    return hdt_vel_per_count_q32((uint32_t)llrint(RAD_PER_COUNT * 0x1p44), 700 << 16);
}

START_TEST(test_rate_is_one_over_the_gap)
{
    for (uint32_t dt_us = 16; dt_us <= 25000; dt_us++) {
        const double got = D(hdt_vel_rate_q16(dt_us), 16);
        ck_assert_msg(fabs(got * dt_us * 1e-6 - 1) < 7e-6, "%u us: %g Hz", dt_us, got);
        /* cut, never above; exact where it can be */
        ck_assert_msg(got * dt_us <= 1e6 && (1000000 % dt_us != 0 || got * dt_us == 1e6), "%u us: %.9g Hz",
                      dt_us, got);
    }
}
END_TEST

static void design(double cutoff_hz, double rate_hz, int32_t q28[5])
{
    double b[5];
    ref_butterworth(cutoff_hz, rate_hz, b);
    for (int i = 0; i < 5; i++)
        q28[i] = Q(b[i], 28);
}

START_TEST(test_one_count_a_period_is_its_angle_times_the_rate)
{
    const int64_t per_count = pa10_per_count();
    ck_assert_double_eq_tol(D(per_count, 32), RAD_PER_COUNT * 700, RAD_PER_COUNT * 700 * 1e-6);
    uint64_t r = 1;
    for (int k = 0; k < 100000; k++) {
        const int32_t a = (int32_t)test_random(&r), step = (int32_t)test_uniform(&r, -20000, 20000);
        const int32_t b = (int32_t)(uint32_t)((uint32_t)a + (uint32_t)step); /* wraps now and then */
        const double want = step * D(per_count, 32);
        const double got = D(hdt_vel_difference(b, a, per_count), 24);
        ck_assert_msg(fabs(got - want) <= 0x1p-25, "step %d: %.9g, expected %.9g", step, got, want);
    }
}
END_TEST

START_TEST(test_counter_wrap_is_one_count)
{
    const int64_t per_count = pa10_per_count();
    const int32_t one = hdt_vel_difference(1, 0, per_count);
    ck_assert_int_gt(one, 0);
    ck_assert_int_eq(hdt_vel_difference(INT32_MIN, INT32_MAX, per_count), one);
    ck_assert_int_eq(hdt_vel_difference(INT32_MAX, INT32_MIN, per_count),
                     hdt_vel_difference(0, 1, per_count));
}
END_TEST

START_TEST(test_jump_is_clamped_never_wrapped)
{
    uint64_t r = 2;
    ck_assert_int_eq(hdt_vel_difference(INT32_MAX, 0, pa10_per_count()), INT32_MAX);
    ck_assert_int_eq(hdt_vel_difference(INT32_MIN, 0, pa10_per_count()), -INT32_MAX);
    for (int k = 0; k < 100000; k++) {
        const int64_t per_count = (int64_t)(test_random(&r) % (((uint64_t)1 << 38) + 1));
        const int32_t a = (int32_t)test_random(&r), b = (int32_t)test_random(&r);
        const int32_t v = hdt_vel_difference(b, a, per_count);
        const uint32_t up = (uint32_t)b - (uint32_t)a;
        ck_assert_int_ge(v, -INT32_MAX);
        if (v != 0)
            ck_assert_msg((v > 0) == (up < 0x80000000u), "%d after %d gives %d", b, a, v);
    }
}
END_TEST

START_TEST(test_difference_is_held_at_2_to_the_24_counts)
{
    /* 2^-24 rad/s a count: the clamp shows long before the format ends */
    const int32_t edge = 1 << 24;
    for (int over = -1; over <= 1; over++) {
        const int32_t most = over < 0 ? edge - 1 : edge;
        ck_assert_int_eq(hdt_vel_difference(edge + over, 0, 1 << 8), most);
        ck_assert_int_eq(hdt_vel_difference(-edge - over, 0, 1 << 8), -most);
    }
    ck_assert_int_eq(hdt_vel_difference(INT32_MAX, 0, 1 << 8), edge);
    ck_assert_int_eq(hdt_vel_difference(INT32_MIN, 0, 1 << 8), -edge);
}
END_TEST

START_TEST(test_filter_agrees_with_the_double_biquad)
{
    uint64_t r = 3;
    for (int n = 0; n < 60; n++) {
        const double rate = test_uniform(&r, 200, 2000);
        const double cutoff = rate * pow(10, test_uniform(&r, -2.3, -0.5));
        int32_t q[5];
        double b[5], x1 = 0, x2 = 0, y1 = 0, y2 = 0, worst = 0;
        struct hdt_vel s = {{0, 0}, {0, 0}, 0};
        design(cutoff, rate, q);
        /* not only the symmetric numerator of a Butterworth filter: move weight from b2 to b0 */
        const int32_t moved = (int32_t)(q[2] * test_uniform(&r, 0, 1));
        q[0] += moved;
        q[2] -= moved;
        for (int i = 0; i < 5; i++)
            b[i] = D(q[i], 28);
        for (int k = 0; k < 3000; k++) {
            const int32_t x_q24 = Q(test_uniform(&r, -2, 2), 24);
            const double x = D(x_q24, 24), y = b[0] * x + b[1] * x1 + b[2] * x2 - b[3] * y1 - b[4] * y2;
            const double got = D(hdt_vel_filter(&s, q, x_q24), 24);
            x2 = x1; x1 = x; y2 = y1; y1 = y;
            worst = fmax(worst, fabs(got - y));
        }
        /* rounding passes the poles once: a few LSB over the square root of the relative cut-off */
        ck_assert_msg(worst < 0x1p-24 * (2 + 0.3 * rate / cutoff), "%g of %g Hz: off %g LSB", cutoff, rate,
                      worst * 0x1p24);
    }
}
END_TEST

START_TEST(test_rounding_loses_nothing)
{
    uint64_t r = 7;
    int32_t q[5];
    struct hdt_vel s = {{0, 0}, {0, 0}, 0};
    design(7, 700, q);
    for (int k = 0; k < 10000; k++) {
        const int32_t x_q24 = Q(test_uniform(&r, -2, 2), 24);
        const int64_t sum_q52 = (int64_t)q[0] * x_q24 + (int64_t)q[1] * s.x_q24[0]
                                + (int64_t)q[2] * s.x_q24[1] - (int64_t)q[3] * s.y_q24[0]
                                - (int64_t)q[4] * s.y_q24[1] + s.rest;
        const int32_t y_q24 = hdt_vel_filter(&s, q, x_q24);
        ck_assert_int_eq((int64_t)y_q24 * (1 << 28) + s.rest, sum_q52);
    }
}
END_TEST

START_TEST(test_constant_speed_is_reached_exactly)
{
    const double cutoff[] = {1, 5, 20, 50, 200};
    uint64_t r = 4;
    for (int n = 0; n < 5; n++) {
        int32_t q[5];
        design(cutoff[n], 700, q);
        /* gain at rest of the rounded coefficients, itself within 1e-4 of one down to 1 Hz */
        const double gain = ((double)q[0] + q[1] + q[2]) / (0x1p28 + q[3] + q[4]);
        ck_assert_double_eq_tol(gain, 1, 1e-4);
        for (int k = 0; k < 20; k++) {
            struct hdt_vel s = {{0, 0}, {0, 0}, 0};
            const int32_t x = Q(test_uniform(&r, -2, 2), 24);
            int32_t y = 0;
            for (int i = 0; i < 5000; i++)
                y = hdt_vel_filter(&s, q, x);
            ck_assert_msg(fabs(y - x * gain) <= 1.5, "%g Hz: %d ends at %d", cutoff[n], x, y);
        }
    }
}
END_TEST

START_TEST(test_cutoff_is_three_decibel)
{
    const double cutoff[] = {10, 35, 100};
    for (int n = 0; n < 3; n++) {
        int32_t q[5];
        double power = 0;
        struct hdt_vel s = {{0, 0}, {0, 0}, 0};
        design(cutoff[n], 700, q);
        for (int k = 0; k < 7000; k++) {
            const double y = D(hdt_vel_filter(&s, q, Q(sin(2 * REF_PI * cutoff[n] * k / 700), 24)), 24);
            if (k >= 3500)
                power += y * y / 3500;
        }
        ck_assert_double_eq_tol(2 * power, 0.5, 0.002);
    }
}
END_TEST

START_TEST(test_full_scale_square_wave_never_wraps)
{
    /* a wrap would turn the output's sign against the slow input */
    const double cutoff[] = {0.5, 20, 170, 340};
    for (int n = 0; n < 4; n++) {
        int32_t q[5];
        struct hdt_vel s = {{0, 0}, {0, 0}, 0};
        design(cutoff[n], 700, q);
        for (int half = 0; half < 6; half++) {
            const int32_t x = half & 1 ? -INT32_MAX : INT32_MAX;
            int32_t y = 0;
            for (int k = 0; k < 3000; k++) {
                const int32_t before = y;
                y = hdt_vel_filter(&s, q, x);
                if (k > 0) {
                    const double step = fabs((double)y - before);
                    const double most = 0x1p32 * fmin(1, 6 * cutoff[n] / 700 + 0.01);
                    ck_assert_msg(step <= most, "%g Hz: jumps from %d to %d", cutoff[n], before, y);
                }
            }
            ck_assert_double_eq_tol(D(y, 24), D(x, 24), 0.1);
        }
    }
}
END_TEST

/* ---- observer ---- */

static void observer_gains(double cutoff_hz, double rate_hz, int32_t gain[3])
{
    const double p = exp(-2 * 3.14159265358979 * cutoff_hz / rate_hz), r = 1 - p;
    gain[0] = (int32_t)lrint((1 - p * p * p) * 0x1p30);
    gain[1] = (int32_t)lrint(1.5 * r * r * (1 + p) * rate_hz * 0x1p16);
    gain[2] = (int32_t)lrint(r * r * r * rate_hz * rate_hz * 0x1p8);
}

START_TEST(test_observer_given_the_acceleration_does_not_lag)
{
    /* a reversal at 0.03 rad/s in counts of a ratio of 50: with the model's acceleration the estimate is
     * on the true speed; without it the error is an acceleration's, third order, and bounded */
    const double rate = 700, count = 2 * 3.14159265358979 / (50 * 16384), w = 1.5, a = 0.02;
    int32_t gain[3];
    observer_gains(20, rate, gain);
    for (int informed = 0; informed < 2; informed++) {
        struct hdt_obs s = {0, (int64_t)(a * w * 0x1p40), 0, 0};
        double worst = 0;
        for (int k = 0; k < 7000; k++) {
            const double t = k / rate;
            const int64_t y = (int64_t)llrint(floor(a * sin(w * t) / count) * count * 0x1p40);
            s.a_q16 = informed ? (int32_t)lrint(-a * w * w * sin(w * t) * 65536) : 0;
            const double v = hdt_vel_observe(&s, gain, y, 1, (uint32_t)(0x1p32 / rate)) * 0x1p-24;
            if (k > 700)
                worst = fmax(worst, fabs(v - a * w * cos(w * t)));
        }
        /* a count a period is 0.0054 rad/s */
        ck_assert_double_lt(worst, informed ? 1.0e-3 : 1.1e-3);
    }
}
END_TEST

START_TEST(test_observer_stays_in_its_formats_at_any_input)
{
    uint64_t r = 77;
    for (int n = 0; n < 200; n++) {
        struct hdt_obs s = {0, 0, 0, 0};
        int32_t gain[3];
        for (int i = 0; i < 3; i++)
            gain[i] = (int32_t)(test_random(&r) % ((1u << 30) + 1u));
        const uint32_t period = (uint32_t)(test_random(&r) >> 32);
        for (int k = 0; k < 200; k++) {
            int64_t y = (int64_t)(test_random(&r) >> 17) - ((int64_t)1 << 46);
            y = test_random(&r) & 1 ? s.q_q40 : y;
            if (y > ((int64_t)1 << 47) || y < -((int64_t)1 << 47))
                y = 0;
            s.a_q16 = (int32_t)((int64_t)(test_random(&r) % (1u << 29)) - (1 << 28));
            hdt_vel_observe(&s, gain, y, (int)(test_random(&r) & 1), period);
            ck_assert(llabs(s.v_q40) < (int64_t)1 << 47);
            ck_assert(llabs(s.d_q32) <= (int64_t)1 << 44);
            ck_assert(llabs(s.q_q40) <= (int64_t)1 << 48);
        }
    }
}
END_TEST

START_TEST(test_observer_without_counts_stops_at_256_rad)
{
    const int32_t gain[3] = {0, 0, 0};
    for (int sign = -1; sign <= 1; sign += 2) {
        struct hdt_obs s = {0, sign * (((int64_t)1 << 47) - 1), 0, 0};
        for (int k = 0; k < 100; k++) {
            const int64_t before = llabs(s.q_q40);
            hdt_vel_observe(&s, gain, 0, 0, UINT32_MAX);
            ck_assert(llabs(s.q_q40) > before || before == (int64_t)1 << 48);
        }
        ck_assert_int_eq(s.q_q40, sign * ((int64_t)1 << 48));
    }
}
END_TEST

/* One period of the observer as hdt_vel.h states it, in doubles that hold whole LSBs; the sides of a clamp
 * are returned, so that what is clamped can be held to the last bit. */
static double shr(double x, int n) { return floor(ldexp(x, -n) + 0.5); }
static double held(double x, double most, int *clamped)
{
    *clamped |= fabs(x) > most + 2;
    return fmax(-most, fmin(most, x));
}

START_TEST(test_observer_is_its_equations_within_one_lsb_and_its_clamps_to_the_bit)
{
    const double e_max = 0x1p30, v_max = 0x1p47 - 1, a_max = 0x1p28;
    uint64_t r = 78;
    int at_clamp[4] = {0, 0, 0, 0};
    for (int n = 0; n < 300000; n++) {
        /* magnitudes from one LSB to the whole format */
        const double far = pow(2, test_uniform(&r, 0, 39)), fast = pow(2, test_uniform(&r, 20, 47));
        struct hdt_obs s;
        s.q_q40 = (int64_t)test_uniform(&r, -0x1p47, 0x1p47);
        s.v_q40 = (int64_t)test_uniform(&r, -fast, fast);
        s.d_q32 = (int64_t)ldexp(test_uniform(&r, -1, 1), (int)test_uniform(&r, 20, 45));
        s.d_q32 = llabs(s.d_q32) > (int64_t)1 << 44 ? 0 : s.d_q32;
        s.a_q16 = (int32_t)ldexp(test_uniform(&r, -1, 1), (int)test_uniform(&r, 8, 29));
        const int64_t y = s.q_q40 + (int64_t)test_uniform(&r, -far, far);
        const int32_t gain[3] = {(int32_t)pow(2, test_uniform(&r, 10, 30)),
                                 (int32_t)pow(2, test_uniform(&r, 10, 30)),
                                 (int32_t)pow(2, test_uniform(&r, 5, 30))};
        const uint32_t period = (uint32_t)pow(2, test_uniform(&r, 16, 32));
        const int fresh = n % 3 != 0;
        int far_off = 0, v_held = 0, d_held = 0, a_held = 0;
        double q = (double)s.q_q40, v = (double)s.v_q40, d = (double)s.d_q32;
        if (fresh) {
            const double e = held(shr((double)y - q, 8), e_max, &far_off);
            q += shr(e * gain[0], 22);
            v = held(v + shr(e * gain[1], 8), v_max, &v_held);
            d = held(d + shr(e * gain[2], 8), 0x1p44, &d_held);
        }
        const double told = fmin(shr(v, 16), 0x1p31 - 1), a = held(s.a_q16 + shr(d, 16), a_max, &a_held);
        int after = 0, q_held = 0;
        q = held(q + shr(shr(v, 18) * period, 14), 0x1p48, &q_held);
        v = held(v + shr(a * period, 8), v_max, &after);
        const int32_t got = hdt_vel_observe(&s, gain, y, fresh, period);
        /* angles to 2^49: doubles are whole there; an LSB of v or d
         * either way may be one of what they make */
        ck_assert_msg(fabs((double)s.q_q40 - q) <= 2 + ldexp(period, -14), "%d: angle %.17g, %.17g expected",
                      n, (double)s.q_q40, q);
        ck_assert_msg(fabs((double)s.v_q40 - v) <= (after ? 0 : 2 + ldexp(period, -8) * !(a_held || !fresh)),
                      "%d: speed %.17g, %.17g expected", n, (double)s.v_q40, v);
        ck_assert_msg(fabs((double)s.d_q32 - d) <= (d_held || !fresh ? 0 : 1),
                      "%d: disturbance %.17g, %.17g expected", n, (double)s.d_q32, d);
        ck_assert_msg(fabs(got - fmax(told, -0x1p31 + 1)) <= !v_held, "%d: told %d, %.17g expected", n, got,
                      told);
        at_clamp[0] += far_off;
        at_clamp[1] += v_held && !after;
        at_clamp[2] += d_held;
        at_clamp[3] += a_held;
    }
    for (int i = 0; i < 4; i++)
        ck_assert_int_gt(at_clamp[i], 500);
}
END_TEST

START_TEST(test_observer_holds_either_bound_of_its_velocity)
{
    /* pushed beyond by the acceleration alone, and by the count alone */
    const int32_t gain[3] = {0, 1 << 30, 0};
    for (int down = 0; down < 2; down++) {
        const int64_t most = ((int64_t)1 << 47) - 1, end = down ? -most : most;
        const int32_t told = down ? -INT32_MAX : INT32_MAX;
        struct hdt_obs s = {0, end, 0, down ? -(1 << 28) : 1 << 28};
        ck_assert_int_eq(hdt_vel_observe(&s, gain, 0, 0, UINT32_MAX), told);
        ck_assert(s.v_q40 == end);
        s = (struct hdt_obs){0, 0, 0, 0};
        ck_assert_int_eq(hdt_vel_observe(&s, gain, down ? -((int64_t)1 << 38) : (int64_t)1 << 38, 1, 0),
                         told);
        ck_assert(s.v_q40 == end);
    }
}
END_TEST

static Suite *vel_suite(void)
{
    Suite *s = suite_create("vel");
    TCase *d = tcase_create("difference"), *f = tcase_create("filter");
    tcase_add_test(d, test_rate_is_one_over_the_gap);
    tcase_add_test(d, test_one_count_a_period_is_its_angle_times_the_rate);
    tcase_add_test(d, test_counter_wrap_is_one_count);
    tcase_add_test(d, test_jump_is_clamped_never_wrapped);
    tcase_add_test(d, test_difference_is_held_at_2_to_the_24_counts);
    tcase_add_test(f, test_filter_agrees_with_the_double_biquad);
    tcase_add_test(f, test_rounding_loses_nothing);
    tcase_add_test(f, test_constant_speed_is_reached_exactly);
    tcase_add_test(f, test_cutoff_is_three_decibel);
    tcase_add_test(f, test_full_scale_square_wave_never_wraps);
    tcase_add_test(f, test_observer_given_the_acceleration_does_not_lag);
    tcase_add_test(f, test_observer_stays_in_its_formats_at_any_input);
    tcase_add_test(f, test_observer_without_counts_stops_at_256_rad);
    tcase_add_test(f, test_observer_is_its_equations_within_one_lsb_and_its_clamps_to_the_bit);
    tcase_add_test(f, test_observer_holds_either_bound_of_its_velocity);
    suite_add_tcase(s, d);
    suite_add_tcase(s, f);
    return s;
}

HDT_CHECK_MAIN(vel_suite())
