/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Codec of both formats: byte vectors worked by hand from the field tables, round trips over random
 * values, every wrong length, random bytes.  The reference decoder below reads fields by a table
 * of offsets and shares no code with the codec.
 */
#include <math.h>
#include <string.h>

#include "driver/drv_backend.h"
#include "driver/drv_telegram.h"
#include "tests/check_main.h"
#include "tests/example_command.h"

static const enum drv_format formats[2] = {DRV_FORMAT_A, DRV_FORMAT_B};
static const uint8_t types[7] = {'S', 'E', 'T', 'C', 'M', 'R', 'A'};

/* Independent: field of `size` bytes at `off`, little endian in Format A, sign extended when asked. */
static int64_t field(enum drv_format format, const uint8_t *b, unsigned off, unsigned size, int is_signed)
{
    uint64_t v = 0;
    for (unsigned i = 0; i < size; i++)
        v += (uint64_t)b[off + (format == DRV_FORMAT_A ? i : size - 1 - i)] << (8 * i);
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

/* Of this type, and with what the format's telegram of that type carries; the rest zero. */
static struct drv_command random_command(enum drv_format format, uint8_t type, uint64_t *rng)
{
    struct drv_command c = {.seq = (uint8_t)test_random(rng), .type = type};
    if (type == 'M' || type == 'R' || type == 'A')
        c.axis_no = (uint8_t)(1 + test_random(rng) % 7);
    if (type == 'R')
        c.address = (uint8_t)(32 * (test_random(rng) % 8));
    for (int i = 0; type == 'C' && i < DRV_AXES; i++) {
        c.axis[i].mode = (uint16_t)(test_random(rng) & (format == DRV_FORMAT_A ? 0xff : 0xffff));
        c.axis[i].torque_dig = boundary_s16(rng);
        c.axis[i].speed_dig = boundary_s16(rng);
    }
    if (type == 'C' && format == DRV_FORMAT_B)
        c.driver_mode = (uint16_t)test_random(rng);
    return c;
}

static struct drv_state random_state(enum drv_format format, uint8_t type, uint64_t *rng)
{
    struct drv_state s = {.seq = (uint8_t)test_random(rng), .type = type};
    static const int32_t edge[] = {0, -1, 2457600, -2457600, 65535, 65536, INT32_MAX, INT32_MIN};
    if (type == 'M' || type == 'R' || type == 'A')
        s.axis_no = (uint8_t)(1 + test_random(rng) % 7);
    if (type == 'R')
        s.address = (uint8_t)(32 * (test_random(rng) % 8));
    for (int k = 0; type == 'R' && k < DRV_TABLE_WORDS; k++)
        s.word[k] = (uint16_t)test_random(rng);
    for (int i = 0; type == 'C' && i < DRV_AXES; i++) {
        uint64_t r = test_random(rng);
        s.axis[i].status = (uint16_t)test_random(rng);
        s.axis[i].count = r % 3 == 0 ? edge[(r >> 8) % 8] : (int32_t)(r >> 32);
        s.axis[i].speed_dig = format == DRV_FORMAT_B ? boundary_s16(rng) : 0;
        s.axis[i].torque_dig = boundary_s16(rng);
    }
    if (type == 'C')
        s.driver_status = (uint16_t)test_random(rng);
    return s;
}

static int same_command(const struct drv_command *a, const struct drv_command *b)
{
    int same = a->seq == b->seq && a->type == b->type && a->axis_no == b->axis_no &&
               a->address == b->address && a->driver_mode == b->driver_mode;
    for (int i = 0; i < DRV_AXES; i++)
        same = same && a->axis[i].mode == b->axis[i].mode && a->axis[i].torque_dig == b->axis[i].torque_dig &&
               a->axis[i].speed_dig == b->axis[i].speed_dig;
    return same;
}

static int same_state(const struct drv_state *a, const struct drv_state *b)
{
    int same = a->seq == b->seq && a->type == b->type && a->axis_no == b->axis_no &&
               a->address == b->address && a->driver_status == b->driver_status &&
               memcmp(a->word, b->word, sizeof a->word) == 0;
    for (int i = 0; i < DRV_AXES; i++)
        same = same && a->axis[i].status == b->axis[i].status && a->axis[i].count == b->axis[i].count &&
               a->axis[i].speed_dig == b->axis[i].speed_dig && a->axis[i].torque_dig == b->axis[i].torque_dig;
    return same;
}

/* With example_command(), the examples of docs/formats.md. */
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

/* The same arm in Format B: rated torque / 4096 a digit, 4.64 N.m at S1. */
static struct drv_command example_command_b(void)
{
    struct drv_command c = example_command();
    c.axis[0].mode |= DRV_AXIS_STOP_ALL;
    c.axis[0].torque_dig = 883;
    c.axis[6].mode = DRV_AXIS_BRAKE;
    c.driver_mode = DRV_DRIVER_WATCH_DEADMAN;
    return c;
}

static struct drv_state example_state_b(void)
{
    struct drv_state s = example_state();
    s.axis[0].speed_dig = 5000;
    s.axis[0].torque_dig = 1089;
    s.axis[6].speed_dig = -2;
    s.driver_status |= DRV_DRIVER_DEADMAN_ON | DRV_DRIVER_UNCONTROLLABLE;
    return s;
}

START_TEST(test_command_bytes_are_those_of_the_field_table)
{
    /* axis 1 torque 1000 digits, axis 2 torque -1, axis 4 speed -5000 digits (-1 rad/s), axis 7
     * parked; 1000 = 0x03e8, -1 = 0xffff, -5000 = 0xec78 */
    static const uint8_t want[37] = {
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
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_state_bytes_are_those_of_the_field_table)
{
    /* S1: limit +, count 2457600 = 0x00258000 (three output turns of ratio 50), torque 1234 = 0x04d2
     * W2: alarm ff, uncontrollable, power off = 0xcff0, count -1, torque -30 = 0xffe2
     * driver: alarm 05 = 0x0050 */
    uint8_t want[60] = {0x7f, 0x43, 0x01, 0x00, 0x00, 0x80, 0x25, 0x00, 0xd2, 0x04};
    static const uint8_t tail[10] = {0xf0, 0xcf, 0xff, 0xff, 0xff, 0xff, 0xe2, 0xff, 0x50, 0x00};
    memcpy(want + 50, tail, sizeof tail);
    struct drv_state s = example_state();
    struct hdt_frame f;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_format_b_command_bytes_are_those_of_the_field_table)
{
    /* as Format A's example; S1 also stops with the others, 883 = 0x0373; the dead-man switch is watched */
    static const uint8_t want[46] = {
        0x2a, 0x43,                         /* sequence 42, 'C' */
        0x00, 0x16, 0x03, 0x73, 0x00, 0x00, /* S1 torque */
        0x00, 0x06, 0xff, 0xff, 0x00, 0x00, /* S2 torque */
        0x00, 0x01, 0x00, 0x00, 0x00, 0x00, /* S3 brake  */
        0x00, 0x02, 0x00, 0x00, 0xec, 0x78, /* E1 speed  */
        0x00, 0x01, 0x00, 0x00, 0x00, 0x00, /* E2 */
        0x00, 0x01, 0x00, 0x00, 0x00, 0x00, /* W1 */
        0x00, 0x01, 0x80, 0x00, 0x7f, 0xff, /* W2 brake; extremes of both words */
        0x00, 0x08,                         /* dead-man switch watched */
    };
    struct drv_command c = example_command_b();
    struct hdt_frame f;
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_B, &c, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_format_b_state_bytes_are_those_of_the_field_table)
{
    /* S1: limit +, 2457600 = 0x00258000, speed 5000 = 0x1388 (1 rad/s), torque 1089 = 0x0441
     * W2: alarm ff, uncontrollable, power off; count -1; speed -2; torque -30
     * driver: dead-man held, alarm 05, uncontrollable = 0x4051 */
    uint8_t want[74] = {0x7f, 0x43, 0x00, 0x01, 0x00, 0x25, 0x80, 0x00, 0x13, 0x88, 0x04, 0x41};
    static const uint8_t tail[12] = {0xcf, 0xf0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe, 0xff, 0xe2, 0x40, 0x51};
    memcpy(want + 62, tail, sizeof tail);
    struct drv_state s = example_state_b();
    struct hdt_frame f;
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_B, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_uint_eq(f.len, sizeof want);
    ck_assert_mem_eq(f.data, want, sizeof want);
}
END_TEST

START_TEST(test_selecting_telegrams_have_the_bytes_of_the_field_table)
{
    static const struct {
        enum drv_format format;
        struct drv_command c;
        uint8_t want[4];
    } at[] = {
        {DRV_FORMAT_A, {.seq = 3, .type = 'M', .axis_no = 2}, {3, 0x4d, 2, 0}},
        {DRV_FORMAT_B, {.seq = 3, .type = 'M', .axis_no = 2}, {3, 0x4d, 2, 0}},
        {DRV_FORMAT_A, {.seq = 4, .type = 'R', .axis_no = 7, .address = 32}, {4, 0x52, 7, 0x20}},
        {DRV_FORMAT_B, {.seq = 4, .type = 'R', .axis_no = 7, .address = 224}, {4, 0x52, 7, 0xe0}},
        {DRV_FORMAT_A, {.seq = 5, .type = 'A', .axis_no = 6}, {5, 0x41, 6, 0}},
        {DRV_FORMAT_B, {.seq = 5, .type = 'A', .axis_no = 6}, {5, 0x41, 0, 6}},
    };
    for (size_t k = 0; k < sizeof at / sizeof at[0]; k++) {
        struct drv_state s = {.seq = at[k].c.seq, .type = at[k].c.type, .axis_no = at[k].c.axis_no,
                              .address = at[k].c.address};
        struct hdt_frame f;
        ck_assert_int_eq(drv_command_encode(at[k].format, &at[k].c, &f), DRV_TELEGRAM_OK);
        ck_assert_uint_eq(f.len, 4);
        ck_assert_mem_eq(f.data, at[k].want, 4);
        s.word[0] = 0x1234;
        s.word[31] = 0xfedc;
        ck_assert_int_eq(drv_state_encode(at[k].format, &s, &f), DRV_TELEGRAM_OK);
        ck_assert_mem_eq(f.data, at[k].want, 4);
        ck_assert_uint_eq(f.len, at[k].c.type == 'R' ? 68 : 4);
        if (at[k].c.type == 'R') {
            ck_assert_int_eq(field(at[k].format, f.data, 4, 2, 0), 0x1234);
            ck_assert_int_eq(field(at[k].format, f.data, 66, 2, 0), 0xfedc);
        }
    }
}
END_TEST

static void check_command_fields(enum drv_format format, const struct drv_command *c, const uint8_t *b)
{
    unsigned word = format == DRV_FORMAT_B, axis = word ? 6 : 5;
    for (unsigned i = 0; i < DRV_AXES; i++) {
        ck_assert_int_eq(field(format, b, 2 + axis * i, 1 + word, 0), c->axis[i].mode);
        ck_assert_int_eq(field(format, b, 3 + word + axis * i, 2, 1), c->axis[i].torque_dig);
        ck_assert_int_eq(field(format, b, 5 + word + axis * i, 2, 1), c->axis[i].speed_dig);
    }
    if (word)
        ck_assert_int_eq(field(format, b, 44, 2, 0), c->driver_mode);
}

static void check_state_fields(enum drv_format format, const struct drv_state *s, const uint8_t *b)
{
    unsigned more = format == DRV_FORMAT_B ? 2 : 0, axis = 8 + more;
    for (unsigned i = 0; i < DRV_AXES; i++) {
        ck_assert_int_eq(field(format, b, 2 + axis * i, 2, 0), s->axis[i].status);
        ck_assert_int_eq(field(format, b, 4 + axis * i, 4, 1), s->axis[i].count);
        if (more)
            ck_assert_int_eq(field(format, b, 8 + axis * i, 2, 1), s->axis[i].speed_dig);
        ck_assert_int_eq(field(format, b, 8 + more + axis * i, 2, 1), s->axis[i].torque_dig);
    }
    ck_assert_int_eq(field(format, b, 2 + axis * 7, 2, 0), s->driver_status);
}

START_TEST(test_random_commands_come_back_unchanged)
{
    uint64_t rng = 1;
    for (int n = 0; n < 6000; n++) {
        enum drv_format format = formats[n % 2];
        struct drv_command c = random_command(format, types[n / 2 % 7], &rng), back;
        struct hdt_frame f;
        memset(&f, 0xa5, sizeof f);
        memset(&back, 0xa5, sizeof back);
        ck_assert_int_eq(drv_command_encode(format, &c, &f), DRV_TELEGRAM_OK);
        ck_assert_int_eq(f.data[0], c.seq);
        if (c.type == 'C')
            check_command_fields(format, &c, f.data);
        ck_assert_int_eq(drv_command_decode(format, &f, &back), DRV_TELEGRAM_OK);
        ck_assert_msg(same_command(&c, &back), "format %d, type %c", format, c.type);
    }
}
END_TEST

START_TEST(test_random_states_come_back_unchanged)
{
    uint64_t rng = 2;
    for (int n = 0; n < 6000; n++) {
        enum drv_format format = formats[n % 2];
        struct drv_state s = random_state(format, types[n / 2 % 7], &rng), back;
        struct hdt_frame f;
        memset(&f, 0xa5, sizeof f);
        memset(&back, 0xa5, sizeof back);
        ck_assert_int_eq(drv_state_encode(format, &s, &f), DRV_TELEGRAM_OK);
        if (s.type == 'C')
            check_state_fields(format, &s, f.data);
        for (unsigned k = 0; s.type == 'R' && k < DRV_TABLE_WORDS; k++)
            ck_assert_int_eq(field(format, f.data, 4 + 2 * k, 2, 0), s.word[k]);
        ck_assert_int_eq(drv_state_decode(format, &f, &back), DRV_TELEGRAM_OK);
        ck_assert_msg(same_state(&s, &back), "format %d, type %c", format, s.type);
    }
}
END_TEST

START_TEST(test_mode_telegrams_are_two_bytes_both_ways)
{
    for (unsigned i = 0; i < 6; i++) {
        enum drv_format format = formats[i % 2];
        uint8_t type = types[i / 2];
        struct drv_command c = {.seq = 9, .type = type}, cback;
        struct drv_state s = {.seq = 9, .type = type}, sback;
        struct hdt_frame f;
        /* a payload the type does not carry must not leak into the bytes */
        c.axis[3].torque_dig = 77;
        c.axis[3].mode = 0x100;
        c.axis_no = s.axis_no = 200;
        ck_assert_int_eq(drv_command_encode(format, &c, &f), DRV_TELEGRAM_OK);
        ck_assert_uint_eq(f.len, 2);
        ck_assert_uint_eq(f.data[1], type);
        memset(&cback, 0xff, sizeof cback);
        ck_assert_int_eq(drv_command_decode(format, &f, &cback), DRV_TELEGRAM_OK);
        ck_assert_int_eq(cback.axis[3].torque_dig, 0);
        ck_assert_int_eq(cback.axis_no, 0);
        ck_assert_int_eq(drv_state_encode(format, &s, &f), DRV_TELEGRAM_OK);
        ck_assert_uint_eq(f.len, 2);
        memset(&sback, 0xff, sizeof sback);
        ck_assert_int_eq(drv_state_decode(format, &f, &sback), DRV_TELEGRAM_OK);
        ck_assert_int_eq(sback.axis[3].count, 0);
        ck_assert_uint_eq(sback.type, type);
    }
}
END_TEST

/* The only telegrams there are, written out once more: types, lengths, and what may be selected. */
static int valid(enum drv_format format, const struct hdt_frame *f, int up)
{
    uint8_t type = f->data[1];
    int axis_ok = f->data[2] >= 1 && f->data[2] <= 7;
    if (type == 'S' || type == 'E' || type == 'T')
        return f->len == 2;
    if (type == 'C')
        return f->len == (format == DRV_FORMAT_A ? up ? 60 : 37 : up ? 74 : 46);
    if (type == 'M')
        return f->len == 4 && axis_ok && f->data[3] == 0;
    if (type == 'R')
        return f->len == (up ? 68 : 4) && axis_ok && (f->data[3] & 31) == 0;
    if (type == 'A')
        return f->len == 4 && field(format, f->data, 2, 2, 0) >= 1 && field(format, f->data, 2, 2, 0) <= 7;
    return 0;
}

/* Decode both ways: accepted if and only if valid, else the output untouched. */
static void decode_or_refuse(enum drv_format format, const struct hdt_frame *f)
{
    struct drv_command c, c0;
    struct drv_state s, s0;
    memset(&c0, 0x5a, sizeof c0);
    memset(&s0, 0x5a, sizeof s0);
    c = c0;
    s = s0;
    int ec = drv_command_decode(format, f, &c), es = drv_state_decode(format, f, &s);
    int unknown = f->len >= 2 && memchr(types, f->data[1], sizeof types) == NULL;
    /* one assertion a case is slow in Check: one test, and say which case */
    if ((ec == DRV_TELEGRAM_OK) != valid(format, f, 0) || (es == DRV_TELEGRAM_OK) != valid(format, f, 1) ||
        (ec != DRV_TELEGRAM_OK && memcmp(&c, &c0, sizeof c) != 0) ||
        (es != DRV_TELEGRAM_OK && memcmp(&s, &s0, sizeof s) != 0) ||
        (unknown && (ec != DRV_TELEGRAM_TYPE || es != DRV_TELEGRAM_TYPE)))
        ck_abort_msg("format %d, type 0x%02x, %u bytes %02x %02x: command %d, state %d", format, f->data[1],
                     f->len, f->data[2], f->data[3], ec, es);
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
            if (type % 2) { /* an axis there is, whichever way the number is read */
                f.data[2] = 1;
                f.data[3] = 0;
            }
            for (int k = 0; k < 2; k++, cases++)
                decode_or_refuse(formats[k], &f);
        }
    }
    ck_assert_int_eq(cases, 2 * 254 * 256);
}
END_TEST

START_TEST(test_only_axes_and_addresses_there_are_can_be_selected)
{
    for (unsigned bytes = 0; bytes < 65536; bytes++)
        for (unsigned k = 0; k < 12; k++) {
            struct hdt_frame f = {.len = k / 2 < 3 ? 4 : 68};
            f.data[1] = types[4 + k / 2 % 3];
            f.data[2] = (uint8_t)bytes;
            f.data[3] = (uint8_t)(bytes >> 8);
            decode_or_refuse(formats[k % 2], &f);
        }
    for (int k = 0; k < 2; k++)
        for (unsigned i = 4; i < 7; i++)
            for (unsigned axis_no = 0; axis_no < 256; axis_no++) {
                struct drv_command c = {.type = types[i], .axis_no = (uint8_t)axis_no};
                struct drv_state s = {.type = types[i], .axis_no = (uint8_t)axis_no};
                struct hdt_frame f = {.len = 77};
                int want = axis_no >= 1 && axis_no <= 7 ? DRV_TELEGRAM_OK : DRV_TELEGRAM_VALUE;
                ck_assert_int_eq(drv_command_encode(formats[k], &c, &f), want);
                ck_assert(want == DRV_TELEGRAM_OK || f.len == 77);
                ck_assert_int_eq(drv_state_encode(formats[k], &s, &f), want);
            }
    struct drv_command c = {.type = 'R', .axis_no = 1, .address = 31};
    struct hdt_frame f;
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), DRV_TELEGRAM_VALUE);
}
END_TEST

START_TEST(test_a_mode_that_does_not_fit_is_refused_not_cut)
{
    struct drv_command c = example_command();
    struct hdt_frame f = {.len = 77};
    c.axis[6].mode = 0x0101;
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), DRV_TELEGRAM_VALUE);
    ck_assert_uint_eq(f.len, 77);
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_B, &c, &f), DRV_TELEGRAM_OK);
}
END_TEST

START_TEST(test_a_format_that_is_not_there_is_refused)
{
    struct drv_command c = {.type = 'S'};
    struct drv_state s = {.type = 'S'};
    struct hdt_frame f = {.len = 2, .data = {0, 'S'}};
    enum drv_format other = (enum drv_format)2;
    ck_assert_int_eq(drv_telegram_len(other, f.data, 2, 0), DRV_TELEGRAM_FORMAT);
    ck_assert_int_eq(drv_command_encode(other, &c, &f), DRV_TELEGRAM_FORMAT);
    ck_assert_int_eq(drv_command_decode(other, &f, &c), DRV_TELEGRAM_FORMAT);
    ck_assert_int_eq(drv_state_encode(other, &s, &f), DRV_TELEGRAM_FORMAT);
    ck_assert_int_eq(drv_state_decode(other, &f, &s), DRV_TELEGRAM_FORMAT);
}
END_TEST

/* Every frame in memory of just its own size, so that a sanitizer sees a read past its end. */
START_TEST(test_a_truncated_telegram_is_never_read_past_its_end)
{
    for (unsigned k = 0; k < 28; k++) {
        enum drv_format format = formats[k % 2];
        int up = k >= 14;
        uint64_t rng = k;
        struct drv_command c = random_command(format, types[k / 2 % 7], &rng);
        struct drv_state s = random_state(format, types[k / 2 % 7], &rng);
        struct hdt_frame f;
        ck_assert_int_eq(up ? drv_state_encode(format, &s, &f) : drv_command_encode(format, &c, &f), 0);
        for (unsigned len = 0; len <= f.len; len++) {
            uint8_t *exact = malloc(len ? len : 1);
            memcpy(exact, f.data, len);
            int e = drv_telegram_len(format, exact, len, up);
            free(exact);
            ck_assert_int_eq(e, len == f.len ? (int)len : DRV_TELEGRAM_LENGTH);
        }
    }
    struct hdt_frame f = {.len = 65535, .data = {0, 'C'}};
    struct drv_command c;
    ck_assert_int_eq(drv_command_decode(DRV_FORMAT_A, &f, &c), DRV_TELEGRAM_LENGTH);
}
END_TEST

START_TEST(test_random_frames_reencode_to_the_same_bytes_or_are_refused)
{
    uint64_t rng = 4;
    int accepted[2] = {0, 0};
    for (int n = 0; n < 80000; n++) {
        static const uint16_t lens[] = {2, 4, 37, 46, 60, 68, 74};
        enum drv_format format = formats[n % 2];
        struct hdt_frame f = {0}, again;
        uint64_t r = test_random(&rng);
        f.len = r % 8 < 7 ? lens[r % 8] : (uint16_t)((r >> 8) % (HDT_FRAME_MAX + 1));
        for (unsigned i = 0; i < f.len; i++)
            f.data[i] = (uint8_t)test_random(&rng);
        if (f.len >= 2 && (r >> 32) % 2)
            f.data[1] = types[(r >> 40) % 7];
        if (f.len >= 4 && (r >> 33) % 2) {
            f.data[2] &= 7;
            f.data[3] &= 0xe7;
        }
        struct drv_state s;
        struct drv_command c;
        if (drv_state_decode(format, &f, &s) == DRV_TELEGRAM_OK) {
            ck_assert_int_eq(drv_state_encode(format, &s, &again), DRV_TELEGRAM_OK);
            ck_assert_uint_eq(again.len, f.len);
            ck_assert_mem_eq(again.data, f.data, f.len);
            accepted[format]++;
        }
        if (drv_command_decode(format, &f, &c) == DRV_TELEGRAM_OK) {
            ck_assert_int_eq(drv_command_encode(format, &c, &again), DRV_TELEGRAM_OK);
            ck_assert_uint_eq(again.len, f.len);
            ck_assert_mem_eq(again.data, f.data, f.len);
            accepted[format]++;
        }
    }
    ck_assert_int_gt(accepted[0], 1000); /* the generator does reach the accepting branch */
    ck_assert_int_gt(accepted[1], 1000);
}
END_TEST

START_TEST(test_length_of_a_padded_telegram_is_found)
{
    uint8_t b[128] = {0, 'C'};
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 48, 0), 37);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 64, 1), 60);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_B, b, 48, 0), 46);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_B, b, 128, 1), 74);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 36, 0), DRV_TELEGRAM_LENGTH);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 59, 1), DRV_TELEGRAM_LENGTH);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_B, b, 73, 1), DRV_TELEGRAM_LENGTH);
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 1, 1), DRV_TELEGRAM_LENGTH);
    b[1] = 'S';
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 8, 0), 2);
    b[1] = 's';
    ck_assert_int_eq(drv_telegram_len(DRV_FORMAT_A, b, 8, 0), DRV_TELEGRAM_TYPE);
}
END_TEST

/* ---- the torque unit of Format B ---- */

static int16_t nearest(double digits)
{
    double r = nearbyint(digits); /* half to even */
    return (int16_t)(r > 32767 ? 32767 : r < -32768 ? -32768 : r);
}

START_TEST(test_torque_units_convert_exactly_rounded_half_to_even_and_saturate)
{
    static const uint16_t rated[] = {4640, 2000, 290, 4096, 1, 65535};
    for (size_t k = 0; k < sizeof rated / sizeof rated[0]; k++)
        for (int d = -32768; d <= 32767; d++) {
            /* both products are below 2^53 and 4096 is a power of two: these are exact, and the
             * quotient's only rounding cannot reach a half it is not on */
            int16_t from = nearest((double)d * rated[k] / 4096);
            int16_t to = nearest((double)d * 4096 / rated[k]);
            if (drv_torque_from_b((int16_t)d, rated[k]) != from ||
                drv_torque_to_b((int16_t)d, rated[k]) != to)
                ck_abort_msg("rated %u, %d digits: %d and %d, want %d and %d", rated[k], d,
                             drv_torque_from_b((int16_t)d, rated[k]), drv_torque_to_b((int16_t)d, rated[k]),
                             from, to);
        }
    ck_assert_int_eq(drv_torque_from_b(4096, 4640), 4640); /* rated torque */
    ck_assert_int_eq(drv_torque_to_b(290, 290), 4096);
    ck_assert_int_eq(drv_torque_from_b(1, 2048), 0);       /* half a digit, to even */
    ck_assert_int_eq(drv_torque_from_b(3, 2048), 2);
    ck_assert_int_eq(drv_torque_from_b(-3, 2048), -2);
    ck_assert_int_eq(drv_torque_from_b(-32768, 65535), -32768);
    ck_assert_int_eq(drv_torque_to_b(32767, 290), 32767);
    ck_assert_int_eq(drv_torque_to_b(1000, 0), 0);
}
END_TEST

START_TEST(test_torque_comes_back_within_half_a_digit_of_the_coarser_unit)
{
    static const uint16_t rated[] = {4640, 2000, 290};
    for (size_t k = 0; k < 3; k++)
        for (int d = -rated[k]; d <= rated[k]; d++) {
            int back = drv_torque_from_b(drv_torque_to_b((int16_t)d, rated[k]), rated[k]);
            ck_assert_int_le(abs(back - d), rated[k] > 4096 ? 1 : 0);
        }
}
END_TEST

START_TEST(test_unknown_type_is_not_encoded)
{
    for (int k = 0; k < 2; k++)
        for (unsigned type = 0; type < 256; type++) {
            struct drv_command c = {.type = (uint8_t)type};
            struct drv_state s = {.type = (uint8_t)type};
            struct hdt_frame f = {.len = 7};
            if (memchr(types, (int)type, sizeof types) != NULL)
                continue;
            ck_assert_int_eq(drv_command_encode(formats[k], &c, &f), DRV_TELEGRAM_TYPE);
            ck_assert_int_eq(drv_state_encode(formats[k], &s, &f), DRV_TELEGRAM_TYPE);
            ck_assert_uint_eq(f.len, 7);
        }
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
    for (int e = -5; e <= 1; e++)
        for (int other = -5; other < e; other++)
            ck_assert((e == 1 && other == -5) ||
                      strcmp(drv_telegram_strerror(e), drv_telegram_strerror(other)) != 0);
}
END_TEST

/* Hex of len bytes, looked for in the text; returns where it ends, or NULL. */
static const char *find_hex(const char *text, const uint8_t *b, unsigned len)
{
    char hex[3 * 10 + 1] = "";
    if (text == NULL)
        return NULL;
    for (unsigned i = 0; i < len; i++)
        sprintf(hex + 3 * i, "%02x ", b[i]);
    hex[3 * len - 1] = '\0';
    const char *at = strstr(text, hex);
    return at ? at + 3 * len - 1 : NULL;
}

/* Head, seven axes, and the rest, one after the other. */
static const char *find_telegram(const char *text, const struct hdt_frame *f, unsigned axis)
{
    const char *at = find_hex(text, f->data, 2);
    for (unsigned i = 0; i < DRV_AXES; i++)
        at = find_hex(at, f->data + 2 + axis * i, axis);
    return f->len > 2 + 7 * axis ? find_hex(at, f->data + 2 + 7 * axis, 2) : at;
}

START_TEST(test_the_format_document_shows_these_bytes)
{
    static char text[400000];
    FILE *doc = fopen("docs/formats.md", "r");
    if (doc == NULL)
        HDT_SKIP("docs/formats.md is not in the working directory");
    size_t n = fread(text, 1, sizeof text - 1, doc);
    fclose(doc);
    ck_assert_uint_lt(n, sizeof text - 1);
    struct drv_command c = example_command(), cb = example_command_b();
    struct drv_state s = example_state(), sb = example_state_b();
    struct hdt_frame f;
    const char *at = strstr(text, "## Telegram");
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), DRV_TELEGRAM_OK);
    ck_assert_ptr_nonnull(at = find_telegram(at, &f, 5));
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_A, &s, &f), DRV_TELEGRAM_OK);
    ck_assert_ptr_nonnull(at = find_telegram(at, &f, 8));
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_B, &cb, &f), DRV_TELEGRAM_OK);
    ck_assert_ptr_nonnull(at = find_telegram(at, &f, 6));
    ck_assert_int_eq(drv_state_encode(DRV_FORMAT_B, &sb, &f), DRV_TELEGRAM_OK);
    ck_assert_ptr_nonnull(at = find_telegram(at, &f, 10));
    /* zero of S2, table of W2, clear of W1 in both formats */
    static const uint8_t select[][4] = {{3, 'M', 2, 0}, {4, 'R', 7, 0}, {5, 'A', 6, 0}, {5, 'A', 0, 6}};
    for (unsigned k = 0; k < 4; k++)
        ck_assert_ptr_nonnull(find_hex(at, select[k], 4));
    /* the command as one CAN FD frame, as candump has it, and by ISO-TP, cut here once more */
    char line[160] = "can0 0FE##1";
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &c, &f), DRV_TELEGRAM_OK);
    for (unsigned i = 0; i < 48; i++)
        sprintf(line + strlen(line), "%02X", i < f.len ? f.data[i] : 0u);
    strcat(line, "\n");
    ck_assert_ptr_nonnull(at = strstr(at, line));
    for (unsigned cut = 0, from = 0; from < f.len; cut++) {
        unsigned most = cut == 0 ? 6 : 7;
        sprintf(line, cut == 0 ? "can0 1FE#10%02X" : "can0 1FE#%02X", cut == 0 ? f.len : 0x20 + cut);
        for (unsigned i = 0; i < most && from < f.len; i++)
            sprintf(line + strlen(line), "%02X", f.data[from++]);
        ck_assert_ptr_nonnull(at = strstr(at, line));
    }
    /* and S as ARCNET packets */
    struct drv_command start = {.seq = 5, .type = DRV_START};
    uint8_t packet[DRV_ARCNET_HEAD + HDT_FRAME_MAX];
    ck_assert_int_eq(drv_command_encode(DRV_FORMAT_A, &start, &f), DRV_TELEGRAM_OK);
    ck_assert_ptr_nonnull(at = find_hex(at, packet,
                                        drv_arcnet_pack(DRV_NODE_HOST, DRV_NODE_SERVO, &f, packet)));
    ck_assert_ptr_nonnull(find_hex(at, packet, drv_arcnet_pack(DRV_NODE_SERVO, DRV_NODE_HOST, &f, packet)));
}
END_TEST

static Suite *telegram_suite(void)
{
    Suite *s = suite_create("telegram");
    TCase *t = tcase_create("bytes");
    tcase_add_test(t, test_command_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_state_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_format_b_command_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_format_b_state_bytes_are_those_of_the_field_table);
    tcase_add_test(t, test_selecting_telegrams_have_the_bytes_of_the_field_table);
    tcase_add_test(t, test_mode_telegrams_are_two_bytes_both_ways);
    tcase_add_test(t, test_length_of_a_padded_telegram_is_found);
    tcase_add_test(t, test_the_format_document_shows_these_bytes);
    suite_add_tcase(s, t);
    t = tcase_create("round trip");
    tcase_add_test(t, test_random_commands_come_back_unchanged);
    tcase_add_test(t, test_random_states_come_back_unchanged);
    suite_add_tcase(s, t);
    t = tcase_create("torque unit");
    tcase_add_test(t, test_torque_units_convert_exactly_rounded_half_to_even_and_saturate);
    tcase_add_test(t, test_torque_comes_back_within_half_a_digit_of_the_coarser_unit);
    suite_add_tcase(s, t);
    t = tcase_create("refusal");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_only_exact_type_and_length_are_accepted);
    tcase_add_test(t, test_only_axes_and_addresses_there_are_can_be_selected);
    tcase_add_test(t, test_a_mode_that_does_not_fit_is_refused_not_cut);
    tcase_add_test(t, test_a_format_that_is_not_there_is_refused);
    tcase_add_test(t, test_a_truncated_telegram_is_never_read_past_its_end);
    tcase_add_test(t, test_random_frames_reencode_to_the_same_bytes_or_are_refused);
    tcase_add_test(t, test_unknown_type_is_not_encoded);
    tcase_add_test(t, test_every_alarm_number_has_a_name);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(telegram_suite())
