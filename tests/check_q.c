/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Helpers of the fixed-point arithmetic.
 * Goal: each does what its line says over its whole range.  Method: 128-bit integers and libm.
 */
#include <math.h>

#include "ctrl/hdt_q.h"
#include "tests/check_main.h"

__extension__ typedef __int128 wide;

/* floor((x + 2^(n-1)) / 2^n) by division */
static wide round_by_division(wide x, unsigned n)
{
    const wide d = (wide)1 << n, y = x + d / 2;
    return y >= 0 ? y / d : -((-y + d - 1) / d);
}

/* Any size, any sign. */
static int64_t any_int64(uint64_t *r, unsigned bits_max)
{
    const int64_t x = (int64_t)(test_random(r) >> (64 - bits_max + test_random(r) % bits_max));
    return test_random(r) & 1 ? -x : x;
}

START_TEST(test_shift_is_division_rounded_to_nearest)
{
    uint64_t r = 1;
    for (int k = 0; k < 300000; k++) {
        const unsigned n = 1 + (unsigned)(test_random(&r) % 62);
        const int64_t x = any_int64(&r, 62);
        ck_assert_msg(hdt_shr(x, n) == (int64_t)round_by_division(x, n), "%lld >> %u", (long long)x, n);
    }
    for (unsigned n = 1; n <= 62; n++)
        for (int64_t x = -5; x <= 5; x++) {
            const int64_t half = (int64_t)1 << (n - 1);
            ck_assert(hdt_shr(half + x, n) == (int64_t)round_by_division((wide)half + x, n));
            ck_assert(hdt_shr(-half + x, n) == (int64_t)round_by_division(-(wide)half + x, n));
        }
    ck_assert(hdt_shr(INT64_MIN, 1) == INT64_MIN / 2);
    ck_assert(hdt_shr(INT64_MAX - 1, 1) == INT64_MAX / 2);
}
END_TEST

START_TEST(test_saturation_is_symmetric_and_exact_inside)
{
    uint64_t r = 2;
    ck_assert_int_eq(hdt_sat(INT32_MAX), INT32_MAX);
    ck_assert_int_eq(hdt_sat((int64_t)INT32_MAX + 1), INT32_MAX);
    ck_assert_int_eq(hdt_sat(-(int64_t)INT32_MAX), -INT32_MAX);
    ck_assert_int_eq(hdt_sat(INT32_MIN), -INT32_MAX);
    ck_assert_int_eq(hdt_sat(INT64_MIN), -INT32_MAX);
    ck_assert_int_eq(hdt_sat(INT64_MAX), INT32_MAX);
    ck_assert_int_eq(hdt_abs(INT32_MIN), INT32_MAX);
    ck_assert_int_eq(hdt_abs(-INT32_MAX), INT32_MAX);
    ck_assert_int_eq(hdt_abs(0), 0);
    for (int k = 0; k < 100000; k++) {
        const int64_t x = any_int64(&r, 34), s = hdt_sat(x);
        ck_assert(s == (x > INT32_MAX ? INT32_MAX : x < -INT32_MAX ? -INT32_MAX : x));
        ck_assert(hdt_abs((int32_t)s) == (s < 0 ? -s : s));
        ck_assert(hdt_clamp(x, -7, 9) == (x > 9 ? 9 : x < -7 ? -7 : x));
        ck_assert(hdt_within(x, 7) == (x > 7 ? 7 : x < -7 ? -7 : x));
    }
}
END_TEST

START_TEST(test_within_holds_at_every_bound_below_2_to_the_62)
{
    /* one step to either side of each bound, and the ends of the format, where x + bound wraps */
    for (int n = 0; n <= 62; n++) {
        for (int64_t off = -1; off <= (n < 62 ? 1 : -1); off++) {
            const int64_t bound = ((int64_t)1 << n) + off;
            const int64_t ends[] = {INT64_MIN, INT64_MIN + 1, -bound - 1, -bound, -bound + 1, 0,
                                    bound - 1, bound, bound + 1, INT64_MAX - 1, INT64_MAX};
            for (size_t k = 0; k < sizeof ends / sizeof ends[0]; k++) {
                const int64_t x = ends[k];
                ck_assert_int_eq(hdt_within(x, bound), x > bound ? bound : x < -bound ? -bound : x);
            }
        }
    }
}
END_TEST

START_TEST(test_product_saturates_instead_of_wrapping)
{
    uint64_t r = 3;
    for (int k = 0; k < 300000; k++) {
        const int32_t a = (int32_t)any_int64(&r, 31), b = (int32_t)any_int64(&r, 31);
        const unsigned n = 1 + (unsigned)(test_random(&r) % 62);
        wide want = round_by_division((wide)a * b, n);
        want = want > INT32_MAX ? INT32_MAX : want < -INT32_MAX ? -INT32_MAX : want;
        ck_assert_msg(hdt_mul(a, b, n) == (int32_t)want, "%d * %d >> %u", a, b, n);
    }
    ck_assert_int_eq(hdt_mul(INT32_MIN, INT32_MIN, 30), INT32_MAX);
    ck_assert_int_eq(hdt_mul(INT32_MIN, INT32_MAX, 30), -INT32_MAX);
}
END_TEST

START_TEST(test_sine_and_cosine_within_2e_9)
{
    uint64_t r = 4;
    double worst = 0;
    for (int k = 0; k < 1000000; k++) {
        /* dense around the eighths, where the polynomials meet, random elsewhere */
        const uint32_t phase = k & 1 ? (uint32_t)test_random(&r)
                                     : ((uint32_t)(k >> 1 & 7) << 29) + (uint32_t)(k >> 4) % 64 - 32;
        int32_t s, c;
        hdt_sin_cos((hdt_phase_t){phase}, &s, &c);
        const double x = phase * (2 * 3.14159265358979323846 * 0x1p-32);
        worst = fmax(worst, fmax(fabs(s * 0x1p-30 - sin(x)), fabs(c * 0x1p-30 - cos(x))));
    }
    ck_assert_double_lt(worst, 2e-9);
}
END_TEST

START_TEST(test_sine_and_cosine_at_every_resolver_phase_and_every_64k_th_of_a_turn)
{
    /* the phases a gear of ratio one would give, and four times as many */
    double worst = 0;
    for (uint32_t k = 0; k < 65536; k++) {
        int32_t s, c;
        hdt_sin_cos((hdt_phase_t){k << 16}, &s, &c);
        const double x = k * (2 * 3.14159265358979323846 * 0x1p-16);
        worst = fmax(worst, fmax(fabs(s * 0x1p-30 - sin(x)), fabs(c * 0x1p-30 - cos(x))));
        ck_assert_msg(fabs((double)s * s + (double)c * c - 0x1p60) < 4e-9 * 0x1p60, "length at %u", k);
        ck_assert(s <= 1 << 30 && s >= -(1 << 30) && c <= 1 << 30 && c >= -(1 << 30));
    }
    ck_assert_double_lt(worst, 2e-9);
}
END_TEST

START_TEST(test_small_shifts_at_every_16_bit_value)
{
    for (int32_t x = -32768; x <= 32767; x++)
        for (unsigned n = 1; n <= 17; n++)
            ck_assert(hdt_shr(x, n) == (int64_t)round_by_division(x, n));
}
END_TEST

START_TEST(test_whole_quarters_are_exact)
{
    const int32_t one = 1 << 30, sine[] = {0, one, 0, -one}, cosine[] = {one, 0, -one, 0};
    for (uint32_t k = 0; k < 4; k++) {
        int32_t s, c;
        hdt_sin_cos((hdt_phase_t){k << 30}, &s, &c);
        ck_assert_int_eq(s, sine[k]);
        ck_assert_int_eq(c, cosine[k]);
    }
}
END_TEST

START_TEST(test_exponential_falls_from_one_to_nothing)
{
    uint64_t r = 5;
    ck_assert_int_eq(hdt_exp_neg(0), 1 << 30);
    ck_assert_int_eq(hdt_exp_neg((uint64_t)24 << 28), 0);
    ck_assert_int_eq(hdt_exp_neg(UINT64_MAX), 0);
    int32_t last = 1 << 30;
    for (uint64_t x = 0; x < (uint64_t)25 << 28; x += 12345) {
        const int32_t e = hdt_exp_neg(x);
        ck_assert_msg(e <= last + 1, "rises at %llu", (unsigned long long)x);
        last = e;
    }
    for (int k = 0; k < 300000; k++) {
        const uint64_t x = test_random(&r) % ((uint64_t)24 << 28);
        const double want = exp(-(double)x * 0x1p-28), error = fabs(hdt_exp_neg(x) * 0x1p-30 - want);
        ck_assert_msg(error <= 5e-7 * want + 1e-9, "exp(-%g): off %g", (double)x * 0x1p-28, error);
    }
}
END_TEST

static Suite *q_suite(void)
{
    Suite *s = suite_create("q");
    TCase *c = tcase_create("helpers");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, test_shift_is_division_rounded_to_nearest);
    tcase_add_test(c, test_saturation_is_symmetric_and_exact_inside);
    tcase_add_test(c, test_within_holds_at_every_bound_below_2_to_the_62);
    tcase_add_test(c, test_product_saturates_instead_of_wrapping);
    tcase_add_test(c, test_sine_and_cosine_within_2e_9);
    tcase_add_test(c, test_sine_and_cosine_at_every_resolver_phase_and_every_64k_th_of_a_turn);
    tcase_add_test(c, test_small_shifts_at_every_16_bit_value);
    tcase_add_test(c, test_whole_quarters_are_exact);
    tcase_add_test(c, test_exponential_falls_from_one_to_nothing);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(q_suite())
