/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Format A codec: byte vectors worked by hand from the field tables, round trips over random
 * values, every wrong length, random bytes.  The reference decoder below reads fields by a table
 * of offsets and shares no code with the codec.
 */
#include <string.h>

#include "driver/drv_telegram.h"
#include "tests/check_main.h"

/* Independent: little-endian field of `size` bytes at `off`, sign extended when asked. */
static int64_t field(const uint8_t *b, unsigned off, unsigned size, int is_signed)
{
    uint64_t v = 0;
    for (unsigned i = 0; i < size; i++)
        v += (uint64_t)b[off + i] << (8 * i);
    if (is_signed && (v >> (8 * size - 1)) != 0)
        return (int64_t)v - ((int64_t)1 << (8 * size));
    return (int64_t)v;
}

static int16_t boundary_s16(uint64_t *rng)
{
    static const int16_t edge[] = {0, 1, -1, 127, 128, -128, -129, 255, 256, 32767, -32768};
    uint64_t r = test_random(rng);
    return r % 3 == 0 ? edge[(r >> 8) % (sizeof edge / sizeof edge[0])] : (int16_t)(r >> 40);
}

static struct drv_command random_command(uint64_t *rng)
{
    struct drv_command c = {.seq = (uint8_t)test_random(rng), .type = DRV_CYCLIC};
    for (int i = 0; i < DRV_AXES; i++) {
        c.axis[i].mode = (uint8_t)test_random(rng);
        c.axis[i].torque_dig = boundary_s16(rng);
        c.axis[i].speed_dig = boundary_s16(rng);
    }
    return c;
}

static struct drv_state random_state(uint64_t *rng)
{
    struct drv_state s = {.seq = (uint8_t)test_random(rng), .type = DRV_CYCLIC};
    static const int32_t edge[] = {0, -1, 2457600, -2457600, 65535, 65536, INT32_MAX, INT32_MIN};
    for (int i = 0; i < DRV_AXES; i++) {
        uint64_t r = test_random(rng);
        s.axis[i].status = (uint16_t)test_random(rng);
        s.axis[i].count = r % 3 == 0 ? edge[(r >> 8) % 8] : (int32_t)(r >> 32);
        s.axis[i].torque_dig = boundary_s16(rng);
    }
    s.driver_status = (uint16_t)test_random(rng);
    return s;
}

/* The examples of docs/formats.md. */
static struct drv_command example_command(void)
{
    struct drv_command c = {.seq = 42, .type = DRV_CYCLIC};
    for (int i = 0; i < DRV_AXES; i++)
        c.axis[i].mode = DRV_AXIS_BRAKE;
    c.axis[0].mode = c.axis[1].mode = DRV_AXIS_SERVO | DRV_AXIS_TORQUE;
    c.axis[0].torque_dig = 1000;
    c.axis[1].torque_dig = -1;
    c.axis[3].mode = DRV_AXIS_SERVO;
    c.axis[3].speed_dig = -5000;
    c.axis[6].mode = DRV_AXIS_BRAKE | DRV_AXIS_DEADMAN;
    c.axis[6].torque_dig = INT16_MIN;
    c.axis[6].speed_dig = INT16_MAX;
    return c;
}

static struct drv_state example_state(void)
{
    struct drv_state s = {.seq = 127, .type = DRV_CYCLIC};
    s.axis[0].status = DRV_AXIS_LIMIT_POS;
    s.axis[0].count = 3 * 50 * 16384;
    s.axis[0].torque_dig = 1234;
    s.axis[6].status = DRV_ALARM_TIMEOUT << DRV_ALARM_SHIFT | DRV_AXIS_UNCONTROLLABLE |
                       DRV_AXIS_POWER_OFF;
    s.axis[6].count = -1;
    s.axis[6].torque_dig = -30;
    s.driver_status = DRV_DRIVER_HOST_TIMEOUT << DRV_ALARM_SHIFT;
    return s;
}

START_TEST(test_command_bytes_are_those_of_the_field_table)
{
    /* axis 1 torque 1000 digits, axis 2 torque -1, axis 4 speed -5000 digits (-1 rad/s), axis 7
     * parked; 1000 = 0x03e8, -1 = 0xffff, -5000 = 0xec78 */
    static const uint8_t want[DRV_COMMAND_LEN] = {
        0x2a, 0x43,                   /* sequence 42, 'C' */
        0x06, 0xe8, 0x03, 0x00, 0x00, /* S1 torque */
        0x06, 0xff, 0xff, 0x00, 0x00, /* S2 torque */
        0x01, 0x00, 0x00, 0x00, 0x00, /* S3 brake  */
        0x02, 0x00, 0x00, 0x78, 0xec, /* E1 speed  */
        0x01, 0x00, 0x00, 0x00, 0x00, /* E2 */
        0x01, 0x00, 0x00, 0x00, 0x00, /* W1 */
        0x09, 0x00, 0x80, 0xff, 0x7f, /* W2 brake and dead-man; extremes of both words */
    };
    struct drv_command c = example_command();
    struct hdt_frame f;
    ck_assert_int_eq(drv_command_encode(&c, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_state_bytes_are_those_of_the_field_table)
{
    /* S1: limit +, count 2457600 = 0x00258000 (three output turns of ratio 50), torque 1234 = 0x04d2
     * W2: alarm ff, uncontrollable, power off = 0xcff0, count -1, torque -30 = 0xffe2
     * driver: alarm 05 = 0x0050 */
    uint8_t want[DRV_STATE_LEN] = {0x7f, 0x43, 0x01, 0x00, 0x00, 0x80, 0x25, 0x00, 0xd2, 0x04};
    static const uint8_t tail[10] = {0xf0, 0xcf, 0xff, 0xff, 0xff, 0xff, 0xe2, 0xff, 0x50, 0x00};
    memcpy(want + 50, tail, sizeof tail);
    struct drv_state s = example_state();
    struct hdt_frame f;
    ck_assert_int_eq(drv_state_encode(&s, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_random_commands_come_back_unchanged)
{
    uint64_t rng = 1;
    for (int n = 0; n < 4000; n++) {
        struct drv_command c = random_command(&rng), back;
        struct hdt_frame f;
        memset(&f, 0xa5, sizeof f);
        ck_assert_int_eq(drv_command_encode(&c, &f), DRV_TELEGRAM_OK);
        ck_assert_int_eq(field(f.data, 0, 1, 0), c.seq);
        for (unsigned i = 0; i < DRV_AXES; i++) {
            ck_assert_int_eq(field(f.data, 2 + 5 * i, 1, 0), c.axis[i].mode);
            ck_assert_int_eq(field(f.data, 3 + 5 * i, 2, 1), c.axis[i].torque_dig);
            ck_assert_int_eq(field(f.data, 5 + 5 * i, 2, 1), c.axis[i].speed_dig);
        }
        ck_assert_int_eq(drv_command_decode(&f, &back), DRV_TELEGRAM_OK);
        ck_assert_int_eq(back.seq, c.seq);
        ck_assert_int_eq(back.type, c.type);
        for (int i = 0; i < DRV_AXES; i++) {
            ck_assert_int_eq(back.axis[i].mode, c.axis[i].mode);
            ck_assert_int_eq(back.axis[i].torque_dig, c.axis[i].torque_dig);
            ck_assert_int_eq(back.axis[i].speed_dig, c.axis[i].speed_dig);
        }
    }
}
END_TEST

START_TEST(test_random_states_come_back_unchanged)
{
    uint64_t rng = 2;
    for (int n = 0; n < 4000; n++) {
        struct drv_state s = random_state(&rng), back;
        struct hdt_frame f;
        memset(&f, 0xa5, sizeof f);
        ck_assert_int_eq(drv_state_encode(&s, &f), DRV_TELEGRAM_OK);
        for (unsigned i = 0; i < DRV_AXES; i++) {
            ck_assert_int_eq(field(f.data, 2 + 8 * i, 2, 0), s.axis[i].status);
            ck_assert_int_eq(field(f.data, 4 + 8 * i, 4, 1), s.axis[i].count);
            ck_assert_int_eq(field(f.data, 8 + 8 * i, 2, 1), s.axis[i].torque_dig);
        }
        ck_assert_int_eq(field(f.data, 58, 2, 0), s.driver_status);
        ck_assert_int_eq(drv_state_decode(&f, &back), DRV_TELEGRAM_OK);
        ck_assert_int_eq(back.seq, s.seq);
        ck_assert_int_eq(back.driver_status, s.driver_status);
        for (int i = 0; i < DRV_AXES; i++) {
            ck_assert_int_eq(back.axis[i].status, s.axis[i].status);
            ck_assert_int_eq(back.axis[i].count, s.axis[i].count);
            ck_assert_int_eq(back.axis[i].torque_dig, s.axis[i].torque_dig);
        }
    }
}
END_TEST

START_TEST(test_mode_telegrams_are_two_bytes_both_ways)
{
    static const uint8_t types[] = {DRV_START, DRV_END, DRV_BRAKE_RELEASE};
    for (unsigned i = 0; i < sizeof types; i++) {
        struct drv_command c = {.seq = 9, .type = types[i]}, cback;
        struct drv_state s = {.seq = 9, .type = types[i]}, sback;
        struct hdt_frame f;
        /* a payload the type does not carry must not leak into the bytes */
        c.axis[3].torque_dig = 77;
        ck_assert_int_eq(drv_command_encode(&c, &f), DRV_TELEGRAM_OK);
        ck_assert_uint_eq(f.len, 2);
        ck_assert_uint_eq(f.data[1], types[i]);
        memset(&cback, 0xff, sizeof cback);
        ck_assert_int_eq(drv_command_decode(&f, &cback), DRV_TELEGRAM_OK);
        ck_assert_int_eq(cback.axis[3].torque_dig, 0);
        ck_assert_int_eq(drv_state_encode(&s, &f), DRV_TELEGRAM_OK);
        ck_assert_uint_eq(f.len, 2);
        memset(&sback, 0xff, sizeof sback);
        ck_assert_int_eq(drv_state_decode(&f, &sback), DRV_TELEGRAM_OK);
        ck_assert_int_eq(sback.axis[3].count, 0);
        ck_assert_uint_eq(sback.type, types[i]);
    }
}
END_TEST

/* The only (type, length) pairs there are, written out once more. */
static int valid(uint8_t type, unsigned len, int up)
{
    if (type == 'S' || type == 'E' || type == 'T')
        return len == 2;
    return type == 'C' && len == (up ? 60u : 37u);
}

START_TEST(test_only_exact_type_and_length_are_accepted)
{
    uint64_t rng = 3;
    int cases = 0;
    for (unsigned len = 0; len <= HDT_FRAME_MAX; len++) {
        for (unsigned type = 0; type < 256; type++) {
            struct hdt_frame f = {.len = (uint16_t)len};
            for (unsigned i = 0; i < len; i++)
                f.data[i] = (uint8_t)test_random(&rng);
            f.data[1] = (uint8_t)type;
            struct drv_command c, c0;
            struct drv_state s, s0;
            memset(&c, 0x5a, sizeof c);
            memset(&s, 0x5a, sizeof s);
            c0 = c;
            s0 = s;
            int ec = drv_command_decode(&f, &c), es = drv_state_decode(&f, &s);
            int known = type == 'S' || type == 'E' || type == 'T' || type == 'C';
            /* one assertion a case is slow in Check: count, and say which case at the end */
            if ((ec == DRV_TELEGRAM_OK) != valid((uint8_t)type, len, 0) ||
                (es == DRV_TELEGRAM_OK) != valid((uint8_t)type, len, 1) ||
                (ec != DRV_TELEGRAM_OK && memcmp(&c, &c0, sizeof c) != 0) ||
                (es != DRV_TELEGRAM_OK && memcmp(&s, &s0, sizeof s) != 0) ||
                (len >= 2 && !known && (ec != DRV_TELEGRAM_TYPE || es != DRV_TELEGRAM_TYPE)))
                ck_abort_msg("type 0x%02x, %u bytes: command %d, state %d", type, len, ec, es);
            cases++;
        }
    }
    ck_assert_int_eq(cases, 254 * 256);
}
END_TEST

START_TEST(test_random_frames_reencode_to_the_same_bytes_or_are_refused)
{
    uint64_t rng = 4;
    int accepted = 0;
    for (int n = 0; n < 40000; n++) {
        static const uint16_t lens[] = {2, 37, 60};
        struct hdt_frame f = {0}, again;
        uint64_t r = test_random(&rng);
        f.len = r % 4 < 3 ? lens[r % 4] : (uint16_t)((r >> 8) % (HDT_FRAME_MAX + 1));
        for (unsigned i = 0; i < f.len; i++)
            f.data[i] = (uint8_t)test_random(&rng);
        if (f.len >= 2 && (r >> 32) % 2)
            f.data[1] = "SECT"[(r >> 40) % 4];
        struct drv_state s;
        struct drv_command c;
        if (drv_state_decode(&f, &s) == DRV_TELEGRAM_OK) {
            ck_assert_int_eq(drv_state_encode(&s, &again), DRV_TELEGRAM_OK);
            ck_assert_uint_eq(again.len, f.len);
            ck_assert_mem_eq(again.data, f.data, f.len);
            accepted++;
        }
        if (drv_command_decode(&f, &c) == DRV_TELEGRAM_OK) {
            ck_assert_int_eq(drv_command_encode(&c, &again), DRV_TELEGRAM_OK);
            ck_assert_uint_eq(again.len, f.len);
            ck_assert_mem_eq(again.data, f.data, f.len);
            accepted++;
        }
    }
    ck_assert_int_gt(accepted, 1000); /* the generator does reach the accepting branch */
}
END_TEST

START_TEST(test_length_of_a_padded_telegram_is_found)
{
    uint8_t b[64] = {0, 'C'};
    ck_assert_int_eq(drv_telegram_len(b, 48, 0), 37);
    ck_assert_int_eq(drv_telegram_len(b, 64, 1), 60);
    ck_assert_int_eq(drv_telegram_len(b, 36, 0), DRV_TELEGRAM_LENGTH);
    ck_assert_int_eq(drv_telegram_len(b, 59, 1), DRV_TELEGRAM_LENGTH);
    ck_assert_int_eq(drv_telegram_len(b, 1, 1), DRV_TELEGRAM_LENGTH);
    b[1] = 'S';
    ck_assert_int_eq(drv_telegram_len(b, 8, 0), 2);
    b[1] = 's';
    ck_assert_int_eq(drv_telegram_len(b, 8, 0), DRV_TELEGRAM_TYPE);
}
END_TEST

START_TEST(test_unknown_type_is_not_encoded)
{
    struct drv_command c = {.type = 'X'};
    struct drv_state s = {.type = 0};
    struct hdt_frame f = {.len = 7};
    ck_assert_int_eq(drv_command_encode(&c, &f), DRV_TELEGRAM_TYPE);
    ck_assert_int_eq(drv_state_encode(&s, &f), DRV_TELEGRAM_TYPE);
    ck_assert_uint_eq(f.len, 7);
}
END_TEST

START_TEST(test_every_alarm_number_has_a_name)
{
    static const unsigned known[] = {0,  1,  2,  5,  6,  7,  8,  9,  10,  11,
                                     12, 13, 14, 15, 16, 17, 18, 19, 0xff};
    unsigned named = 0;
    for (unsigned a = 0; a <= 0xffff; a++) {
        ck_assert_ptr_nonnull(drv_alarm_str(a));
        ck_assert_ptr_nonnull(drv_driver_alarm_str(a));
        named += strcmp(drv_alarm_str(a), "alarm number not known") != 0;
    }
    ck_assert_uint_eq(named, sizeof known / sizeof known[0]);
    for (unsigned i = 0; i < sizeof known / sizeof known[0]; i++)
        for (unsigned k = 0; k < i; k++)
            ck_assert_str_ne(drv_alarm_str(known[i]), drv_alarm_str(known[k]));
    for (int e = -3; e <= 1; e++)
        ck_assert_ptr_nonnull(drv_telegram_strerror(e));
}
END_TEST

/* Hex of len bytes, looked for in the text; returns where it ends, or NULL. */
static const char *find_hex(const char *text, const uint8_t *b, unsigned len)
{
    char hex[3 * 8 + 1] = "";
    for (unsigned i = 0; i < len; i++)
        sprintf(hex + 3 * i, "%02x ", b[i]);
    hex[3 * len - 1] = '\0';
    const char *at = strstr(text, hex);
    return at ? at + 3 * len - 1 : NULL;
}

START_TEST(test_the_format_document_shows_these_bytes)
{
    static char text[200000];
    FILE *doc = fopen("docs/formats.md", "r");
    if (doc == NULL)
        HDT_SKIP("docs/formats.md is not in the working directory");
    size_t n = fread(text, 1, sizeof text - 1, doc);
    fclose(doc);
    ck_assert_uint_lt(n, sizeof text - 1);
    struct drv_command c = example_command();
    struct drv_state s = example_state();
    struct hdt_frame f;
    const char *at = strstr(text, "## Telegram");
    ck_assert_int_eq(drv_command_encode(&c, &f), DRV_TELEGRAM_OK);
    at = at ? find_hex(at, f.data, 2) : NULL;
    for (unsigned i = 0; at != NULL && i < DRV_AXES; i++)
        at = find_hex(at, f.data + 2 + 5 * i, 5);
    ck_assert_ptr_nonnull(at);
    ck_assert_int_eq(drv_state_encode(&s, &f), DRV_TELEGRAM_OK);
    at = find_hex(at, f.data, 2);
    for (unsigned i = 0; at != NULL && i < DRV_AXES; i++)
        at = find_hex(at, f.data + 2 + 8 * i, 8);
    at = at ? find_hex(at, f.data + 58, 2) : NULL;
    ck_assert_ptr_nonnull(at);
}
END_TEST

static Suite *telegram_suite(void)
{
    Suite *s = suite_create("telegram");
    TCase *t = tcase_create("bytes");
    tcase_add_test(t, test_command_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_state_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_mode_telegrams_are_two_bytes_both_ways);
    tcase_add_test(t, test_length_of_a_padded_telegram_is_found);
    tcase_add_test(t, test_the_format_document_shows_these_bytes);
    suite_add_tcase(s, t);
    t = tcase_create("round trip");
    tcase_add_test(t, test_random_commands_come_back_unchanged);
    tcase_add_test(t, test_random_states_come_back_unchanged);
    suite_add_tcase(s, t);
    t = tcase_create("refusal");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_only_exact_type_and_length_are_accepted);
    tcase_add_test(t, test_random_frames_reencode_to_the_same_bytes_or_are_refused);
    tcase_add_test(t, test_unknown_type_is_not_encoded);
    tcase_add_test(t, test_every_alarm_number_has_a_name);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(telegram_suite())
