/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The log ring: against a counter model in one thread, and torn records hunted with two.
 */
#include <pthread.h>
#include <string.h>
#include <time.h>

#include "driver/drv_log.h"
#include "tests/check_main.h"

static struct drv_record slots[64];

/* A record all of whose words follow from n, so that any mixture of two shows. */
static void fill(struct drv_record *rec, uint64_t n)
{
    uint64_t seed = n;
    uint8_t *p = (uint8_t *)rec;
    for (size_t i = 0; i + 8 <= sizeof *rec; i += 8) {
        uint64_t word = seed = seed * 6364136223846793005u + 1442695040888963407u;
        memcpy(p + i, &word, 8);
    }
    rec->in.t_us = n;
}

static int matches(const struct drv_record *rec, uint64_t n)
{
    static __thread struct drv_record want;
    fill(&want, n);
    return memcmp(rec, &want, sizeof want / 8 * 8) == 0;
}

START_TEST(test_ring_is_a_queue_that_drops_the_newest_when_full)
{
    uint64_t rng = 11;
    for (unsigned count = 1; count <= 64; count *= 2) {
        struct drv_ring ring;
        static struct drv_record rec;
        uint64_t in = 0, out = 0, dropped = 0;
        ck_assert_int_eq(drv_ring_init(&ring, slots, count), 0);
        for (int n = 0; n < 3000; n++) {
            if (test_random(&rng) % 2) {
                fill(&rec, in);
                int full = in - out == count;
                ck_assert_int_eq(drv_ring_push(&ring, &rec), full ? -1 : 0);
                in += !full;
                dropped += full;
            } else {
                memset(&rec, 0x3c, sizeof rec);
                int some = drv_ring_pop(&ring, &rec);
                ck_assert_int_eq(some, in != out);
                if (some)
                    ck_assert(matches(&rec, out++));
            }
        }
        ck_assert(count > 16 || dropped > 0);
    }
}
END_TEST

START_TEST(test_ring_survives_the_wrap_of_its_counters)
{
    struct drv_ring ring;
    static struct drv_record rec;
    ck_assert_int_eq(drv_ring_init(&ring, slots, 8), 0);
    ring.head = ring.tail = (unsigned)-5;
    for (uint64_t n = 0; n < 8; n++) {
        fill(&rec, n);
        ck_assert_int_eq(drv_ring_push(&ring, &rec), 0);
    }
    ck_assert_int_eq(drv_ring_push(&ring, &rec), -1);
    for (uint64_t n = 0; n < 8; n++) {
        ck_assert_int_eq(drv_ring_pop(&ring, &rec), 1);
        ck_assert(matches(&rec, n));
    }
    ck_assert_int_eq(drv_ring_pop(&ring, &rec), 0);
}
END_TEST

START_TEST(test_ring_refuses_sizes_that_are_no_power_of_two)
{
    struct drv_ring ring;
    static const unsigned bad[] = {0, 3, 5, 6, 63, 1u << 25, 0xffffffffu};
    for (unsigned i = 0; i < sizeof bad / sizeof bad[0]; i++)
        ck_assert_int_lt(drv_ring_init(&ring, slots, bad[i]), 0);
    ck_assert_int_lt(drv_ring_init(&ring, NULL, 8), 0);
    ck_assert_int_lt(drv_ring_init(NULL, slots, 8), 0);
}
END_TEST

#define TOTAL 100000u

static struct drv_ring shared;
static uint64_t pushed, refused;
static int finished;

/* Offers every number once: what the ring refuses is gone, as in the cycle. */
static void *produce(void *unused)
{
    static struct drv_record rec;
    (void)unused;
    for (uint64_t n = 0; n < TOTAL; n++) {
        fill(&rec, n);
        if (drv_ring_push(&shared, &rec) == 0)
            pushed++;
        else
            refused++;
    }
    __atomic_store_n(&finished, 1, __ATOMIC_RELEASE);
    return NULL;
}

START_TEST(test_two_threads_never_see_a_torn_doubled_or_reordered_record)
{
    static struct drv_record rec;
    pthread_t t;
    uint64_t popped = 0, next = 0, torn = 0, order = 0;
    ck_assert_int_eq(drv_ring_init(&shared, slots, 16), 0);
    ck_assert_int_eq(pthread_create(&t, NULL, produce, NULL), 0);
    for (;;) {
        int last = __atomic_load_n(&finished, __ATOMIC_ACQUIRE);
        if (drv_ring_pop(&shared, &rec)) {
            popped++;
            order += rec.in.t_us < next;
            torn += !matches(&rec, rec.in.t_us);
            next = rec.in.t_us + 1;
        } else if (last) {
            break;
        } else if (popped % 64 == 0) {
            /* a consumer that lags now and then makes the producer find the ring full */
            struct timespec nap = {.tv_nsec = 100000};
            nanosleep(&nap, NULL);
        }
    }
    ck_assert_int_eq(pthread_join(t, NULL), 0);
    ck_assert_uint_eq(torn, 0);
    ck_assert_uint_eq(order, 0);
    ck_assert_uint_eq(pushed + refused, TOTAL);
    ck_assert_uint_eq(popped, pushed);
    ck_assert_uint_gt(popped, 100);
    ck_assert_uint_gt(refused, 0); /* both branches were met */
}
END_TEST

static Suite *ring_suite(void)
{
    Suite *s = suite_create("ring");
    TCase *t = tcase_create("ring");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_ring_is_a_queue_that_drops_the_newest_when_full);
    tcase_add_test(t, test_ring_survives_the_wrap_of_its_counters);
    tcase_add_test(t, test_ring_refuses_sizes_that_are_no_power_of_two);
    tcase_add_test(t, test_two_threads_never_see_a_torn_doubled_or_reordered_record);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(ring_suite())
