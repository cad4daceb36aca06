/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Time on a CAN: known worst cases, and a frame built bit by bit and stuffed as the standard says,
 * which no formula may be below.
 */
#include <string.h>

#include "driver/drv_backend.h"
#include "sim/canwire.h"
#include "tests/check_main.h"

START_TEST(test_frames_take_what_the_literature_says)
{
    /* 135 bits for 8 bytes [Davis et al. 2007]; 55 for none; at 1 Mbit/s a bit is 1 us */
    struct canwire_line classical = {1000000, 0}, slow = {125000, 0};
    struct canwire_line fd = {1000000, 1000000}, fast = {500000, 2000000};
    ck_assert_uint_eq(canwire_frame_ns(&classical, 8), 135000);
    ck_assert_uint_eq(canwire_frame_ns(&classical, 0), 55000);
    ck_assert_uint_eq(canwire_frame_ns(&slow, 8), 8 * 135000);
    ck_assert_uint_eq(canwire_frame_ns(&classical, 9), 0);
    /* 32 + 673 + 5 bits for 64 bytes [Bordoloi, Samii 2014, and the stuff count] */
    ck_assert_uint_eq(canwire_frame_ns(&fd, 64), 710000);
    ck_assert_uint_eq(canwire_frame_ns(&fd, 60), 710000); /* padded */
    ck_assert_uint_eq(canwire_frame_ns(&fd, 16), 32000 + 193000);
    ck_assert_uint_eq(canwire_frame_ns(&fast, 64), 64000 + 339000);
    ck_assert_uint_eq(canwire_frame_ns(&fd, 65), 0);
    ck_assert_uint_eq(canwire_raw_ns(&classical, 2), 0);
    ck_assert_uint_eq(canwire_raw_ns(&fd, 74), 0);
}
END_TEST

/* Bits of a classical frame from start to the end of the CRC, each sixth of five alike put in. */
struct stuffer { unsigned last, run, bits; };

static void put(struct stuffer *s, unsigned bit)
{
    s->bits++;
    s->run = bit == s->last ? s->run + 1 : 1;
    s->last = bit;
    if (s->run == 5) { /* a bit of the other kind, which begins a run of its own */
        s->bits++;
        s->last = !bit;
        s->run = 1;
    }
}

static unsigned stuffed_bits(uint64_t header, unsigned header_bits, const uint8_t *data, unsigned len,
                             unsigned crc)
{
    struct stuffer s = {2, 0, 0};
    for (unsigned i = header_bits; i-- > 0;)
        put(&s, (unsigned)(header >> i) & 1u);
    for (unsigned i = 0; i < 8 * len; i++)
        put(&s, data[i / 8] >> (7 - i % 8) & 1u);
    for (unsigned i = 15; i-- > 0;)
        put(&s, crc >> i & 1u);
    return s.bits + 13; /* CRC and ACK delimiters, ACK, end of frame 7, pause 3 */
}

START_TEST(test_no_frame_is_longer_than_said_and_one_nearly_is)
{
    struct canwire_line line = {1000000, 0};
    uint64_t rng = 1;
    unsigned most = 0;
    for (int n = 0; n < 20000; n++) {
        unsigned len = (unsigned)n % 9;
        uint8_t data[8];
        for (unsigned i = 0; i < 8; i++) {
            static const uint8_t hard[] = {0x00, 0xff, 0x0f, 0x83, 0xe0, 0x7c,
                                           0x1f, 0xc1, 0x3e, 0xf0, 0x78, 0x87};
            data[i] = hard[test_random(&rng) % sizeof hard];
        }
        /* start, identifier 11, RTR, IDE, reserved, length 4: any that can be; any check sum */
        uint64_t header = (test_random(&rng) & 0x7ffu) << 7 | len;
        unsigned bits = stuffed_bits(header, 19, data, len, (unsigned)test_random(&rng) & 0x7fffu);
        ck_assert_uint_le(bits * 1000u, canwire_frame_ns(&line, len));
        if (len == 8 && bits > most)
            most = bits;
    }
    ck_assert_uint_ge(most, 125); /* of 135: the bound is not idle */
    /* the worst there is: runs of five over and over */
    struct stuffer s = {2, 0, 0};
    unsigned bit = 0;
    for (unsigned plain = 0; plain < 34 + 64; plain++) {
        bit = s.run == 1 && s.last != 2 && plain > 4 ? s.last : s.last == 2 ? 0 : s.last;
        put(&s, bit);
    }
    ck_assert_uint_eq(s.bits + 13, 135);
}
END_TEST

START_TEST(test_isotp_counts_frames_as_the_standard_cuts_them)
{
    struct canwire_line classical = {1000000, 0}, fd = {1000000, 4000000};
    static const struct { unsigned len, classical, fd; } at[] = {
        {2, 1, 1}, {7, 1, 1}, {8, 3, 1}, {13, 3, 1}, {14, 4, 1}, {34, 6, 1}, {35, 8, 1}, {37, 8, 1},
        {60, 11, 1}, {62, 11, 1}, {63, 13, 3}, {68, 13, 3}, {74, 14, 3}, {253, 46, 6},
    };
    unsigned frames;
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        ck_assert_uint_gt(canwire_isotp_ns(&classical, at[k].len, &frames), 0);
        ck_assert_uint_eq(frames, at[k].classical);
        ck_assert_uint_gt(canwire_isotp_ns(&fd, at[k].len, &frames), 0);
        ck_assert_uint_eq(frames, at[k].fd);
    }
    ck_assert_int_eq(CANWIRE_ISOTP_BLOCK, DRV_ISOTP_BLOCK);
    /* 37 bytes: first frame, flow control, four of 7, flow control, one of 3 */
    uint64_t three = canwire_frame_ns(&classical, 3), four = canwire_frame_ns(&classical, 4);
    ck_assert_uint_eq(canwire_isotp_ns(&classical, 37, NULL), 5 * 135000 + 2 * three + four);
    ck_assert_uint_eq(canwire_isotp_ns(&classical, 0, NULL), 0);
    ck_assert_uint_eq(canwire_isotp_ns(&classical, 4096, NULL), 0);
}
END_TEST

static Suite *canwire_suite(void)
{
    Suite *s = suite_create("canwire");
    TCase *t = tcase_create("time on the wire");
    tcase_add_test(t, test_frames_take_what_the_literature_says);
    tcase_add_test(t, test_no_frame_is_longer_than_said_and_one_nearly_is);
    tcase_add_test(t, test_isotp_counts_frames_as_the_standard_cuts_them);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(canwire_suite())
