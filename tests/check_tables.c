/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Table image and acceptance check.
 * Goal: an image survives the round trip byte for byte, a damaged one is refused with the right
 * reason, and the check names what is wrong at the exact boundary.  Method: random arms, every
 * truncation, every flipped bit, random bytes, repaired checksums, one member at a time.
 */
#include "ctrl/hdt_comp.h"
#include "tests/core_reference.h"
#include "tests/proof_bounds.h"

static struct hdt_tables arm, back;
static uint8_t image[HDT_JOINTS_MAX * 8192], other[HDT_JOINTS_MAX * 8192];

/* CRC-32 by table, not by bits as the core does it. */
static uint32_t crc_by_table(const uint8_t *data, size_t size)
{
    uint32_t table[256], crc = ~0u;
    for (uint32_t i = 0; i < 256; i++) {
        table[i] = i;
        for (int k = 0; k < 8; k++)
            table[i] = table[i] & 1 ? table[i] >> 1 ^ 0xedb88320u : table[i] >> 1;
    }
    for (size_t i = 0; i < size; i++)
        crc = crc >> 8 ^ table[(crc ^ data[i]) & 255];
    return ~crc;
}

static void put32(uint8_t *at, uint32_t x)
{
    for (int i = 0; i < 4; i++)
        at[i] = (uint8_t)(x >> 8 * i);
}

static uint32_t get32(const uint8_t *at)
{
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static void repair(size_t size)
{
    put32(image + size - 4, crc_by_table(image, size - 4));
}

/* Refused, and nothing of it left behind. */
static void assert_refused(size_t size, int err)
{
    static const struct hdt_tables zero;
    memset(&back, 0xa5, sizeof back);
    ck_assert_int_eq(hdt_tables_read(image, size, &back), err);
    ck_assert(memcmp(&back, &zero, sizeof zero) == 0);
}

START_TEST(test_image_round_trip_is_exact)
{
    uint64_t r = 1;
    for (uint32_t joints = 1; joints <= HDT_JOINTS_MAX; joints++) {
        ref_random_arm(&r, joints, &arm);
        const size_t size = hdt_tables_write(&arm, image, sizeof image);
        ck_assert_uint_eq(size, hdt_tables_size(joints));
        memset(&back, 0xa5, sizeof back);
        ck_assert_int_eq(hdt_tables_read(image, size, &back), HDT_TABLES_OK);
        ck_assert(memcmp(&arm, &back, sizeof arm) == 0);
        ck_assert_uint_eq(hdt_tables_write(&back, other, sizeof other), size);
        ck_assert(memcmp(image, other, size) == 0);
    }
}
END_TEST

START_TEST(test_bytes_are_where_the_format_says)
{
    uint64_t r = 2;
    ref_random_arm(&r, 2, &arm);
    const size_t size = hdt_tables_write(&arm, image, sizeof image);
    ck_assert(memcmp(image, "HDTM", 4) == 0);
    ck_assert_uint_eq(get32(image + 4), HDT_TABLES_LAYOUT);
    ck_assert(memcmp(image + 8, arm.digest, 32) == 0);
    ck_assert_str_eq((const char *)image + 40, "random");
    ck_assert_uint_eq(get32(image + 72), 2);
    ck_assert_uint_eq(get32(image + 76), arm.period_ns);
    ck_assert_uint_eq(get32(image + 80), arm.rate_q16);
    ck_assert_uint_eq(get32(image + 136), arm.joint[0].terms);
    ck_assert_uint_eq(get32(image + 140), (uint32_t)arm.joint[0].sign);
    ck_assert_uint_eq(get32(image + 148), arm.joint[0].rad_per_count_q44);
    ck_assert_uint_eq(get32(image + 152), (uint32_t)arm.joint[0].phase_per_count_q24);
    ck_assert_uint_eq(get32(image + 156), (uint32_t)(arm.joint[0].phase_per_count_q24 >> 32));
    ck_assert_uint_eq(get32(image + size - 8), (uint32_t)arm.joint[1].follow_max_q24);
    ck_assert_uint_eq(get32(image + size - 4), crc_by_table(image, size - 4));
    ck_assert_uint_eq(crc_by_table((const uint8_t *)"123456789", 9), 0xcbf43926u);
}
END_TEST

START_TEST(test_writer_refuses_a_small_buffer)
{
    uint64_t r = 3;
    ref_random_arm(&r, 3, &arm);
    const size_t size = hdt_tables_size(3);
    memset(image, 0x5a, sizeof image);
    ck_assert_uint_eq(hdt_tables_write(&arm, image, size - 1), 0);
    ck_assert_uint_eq(image[0], 0x5a);
    ck_assert_uint_eq(hdt_tables_write(&arm, image, size), size);
    ck_assert_uint_eq(image[size], 0x5a);
    arm.joints = HDT_JOINTS_MAX + 1;
    ck_assert_uint_eq(hdt_tables_write(&arm, image, sizeof image), 0);
    arm.joints = 0;
    ck_assert_uint_eq(hdt_tables_write(&arm, image, sizeof image), 0);
}
END_TEST

START_TEST(test_every_wrong_length_is_short)
{
    uint64_t r = 4;
    ref_random_arm(&r, 2, &arm);
    const size_t size = hdt_tables_write(&arm, image, sizeof image);
    for (size_t n = 0; n < size; n += n < 200 || n > size - 200 ? 1 : 97)
        assert_refused(n, HDT_TABLES_SHORT);
    assert_refused(size + 1, HDT_TABLES_SHORT);
    put32(image + 72, 3);
    assert_refused(size, HDT_TABLES_SHORT);
    put32(image + 72, 0);
    assert_refused(size, HDT_TABLES_SHORT);
    put32(image + 72, 0xffffffffu);
    assert_refused(size, HDT_TABLES_SHORT);
}
END_TEST

START_TEST(test_every_flipped_bit_is_noticed)
{
    uint64_t r = 5;
    ref_random_arm(&r, 1, &arm);
    const size_t size = hdt_tables_write(&arm, image, sizeof image);
    for (size_t n = 0; n < size; n++) {
        image[n] ^= (uint8_t)(1u << (n % 8));
        const int err = hdt_tables_read(image, size, &back);
        if (n < 4)
            ck_assert_int_eq(err, HDT_TABLES_NOT_OURS);
        else if (n < 8)
            ck_assert_int_eq(err, HDT_TABLES_VERSION);
        else if (n >= 72 && n < 76)
            ck_assert_int_eq(err, HDT_TABLES_SHORT);
        else
            ck_assert_int_eq(err, HDT_TABLES_CRC);
        image[n] ^= (uint8_t)(1u << (n % 8));
    }
    ck_assert_int_eq(hdt_tables_read(image, size, &back), HDT_TABLES_OK);
}
END_TEST

START_TEST(test_other_layout_is_recognised_and_told)
{
    uint64_t r = 6;
    ref_random_arm(&r, 1, &arm);
    const size_t size = hdt_tables_write(&arm, image, sizeof image);
    put32(image + 4, HDT_TABLES_LAYOUT + 1);
    ck_assert_int_eq(hdt_tables_read(image, size, &back), HDT_TABLES_VERSION);
    ck_assert_uint_eq(back.layout, HDT_TABLES_LAYOUT + 1);
    /* even if the newer image has another length */
    ck_assert_int_eq(hdt_tables_read(image, 12, &back), HDT_TABLES_VERSION);
}
END_TEST

START_TEST(test_any_bytes_are_read_or_refused)
{
    uint64_t r = 7 + (uint64_t)_i;
    int accepted = 0, ranged = 0;
    ref_random_arm(&r, 1, &arm);
    const size_t size = hdt_tables_write(&arm, other, sizeof other);
    for (int n = 0; n < 3000; n++) {
        size_t use = size;
        memcpy(image, other, size);
        if (n % 3 == 0) {
            use = (size_t)(test_random(&r) % 600);
            for (size_t i = n & 1 ? 8 : 0; i < use; i++)
                image[i] = (uint8_t)test_random(&r);
        } else {
            /* one to four members changed, checksum right */
            for (uint64_t k = 1 + test_random(&r) % 4; k > 0; k--)
                image[8 + test_random(&r) % (size - 12)] = (uint8_t)test_random(&r);
            repair(size);
        }
        const int err = hdt_tables_read(image, use, &back);
        ck_assert_int_le(err, 0);
        accepted += err == HDT_TABLES_OK;
        if (err == HDT_TABLES_RANGE) {
            const char *where = NULL;
            int joint = -2;
            ranged++;
            ck_assert_int_eq(hdt_tables_check(&back, &where, &joint), HDT_TABLES_RANGE);
            ck_assert(where != NULL && joint >= -1 && joint < 1);
        }
    }
    ck_assert_int_gt(accepted, 50);
    ck_assert_int_gt(ranged, 50);
}
END_TEST

/* int32 (or uint32) members with the last value accepted on each side; next is refused */
struct edge { const char *name; size_t at; int64_t lo, hi; };
#define Q3_BELOW (3 * (1 << 24) - 1) /* one LSB below q_max of the random arm */
#define Q_MIN_ABOVE (-3 * (1 << 24) + 1) /* and above q_min */
#define HEAD(m, k, lo, hi) {#m, offsetof(struct hdt_tables, m) + 4 * (k), lo, hi}
#define JOINT(m, k, lo, hi) {#m, offsetof(struct hdt_joint_tab, m) + 4 * (k), lo, hi}
static const struct edge head_edges[] = {
    HEAD(joints, 0, 1, 16),
    HEAD(stale_periods, 0, 1, 1000000),
    HEAD(gravity_q24, 0, -(1 << 30), 1 << 30),
    HEAD(gravity_q24, 2, -(1 << 30), 1 << 30),
    HEAD(observer, 0, 0, (1 << HDT_OBSERVED) - 1),
    HEAD(observer_gain, 0, 0, 1 << 30),
    HEAD(observer_gain, 1, 0, 1 << 30),
    HEAD(observer_gain, 2, 0, 1 << 30),
};
static const struct edge joint_edges[] = {
    JOINT(terms, 0, 0, (1 << HDT_TERMS) - 1),
    JOINT(zero_cnt, 0, -INT32_MAX, INT32_MAX),
    JOINT(moment_q20, 1, -(500 << 20), 500 << 20),
    JOINT(second_q20, 3, -(500 << 20), 500 << 20),
    JOINT(rotor_q20, 0, 0, INT32_MAX),
    JOINT(v_ramp_inv_q16, 0, 1, INT32_MAX),
    JOINT(friction_q16[1], 60, -(1 << 30), 1 << 30),
    JOINT(stiffness[1], 0, -INT32_MAX, 0), /* t1, with t2 = 0 */
    JOINT(lines, 0, 0, 4),
    JOINT(load_mu_q24, 0, 0, INT32_MAX),
    JOINT(cold_coulomb_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(cold_viscous_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(cold_decay_q31, 0, 0, INT32_MAX),
    JOINT(presliding_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(presliding_inv_q8, 0, 0, INT32_MAX),
    JOINT(spring_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(spring_q0_q24, 0, -INT32_MAX, INT32_MAX),
    JOINT(offset_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(kp_q16, 0, 0, 1 << 30),
    JOINT(kd_q16, 0, 0, 1 << 30),
    JOINT(digit_per_nm_q24, 0, 1, INT32_MAX),
    JOINT(dig_max, 0, 1, 32767),
    JOINT(dig_slew, 0, 1, 65535),
    JOINT(spd_max, 0, 0, 32767),
    JOINT(q_min_q24, 0, -INT32_MAX, Q3_BELOW),
    JOINT(v_max_q24, 0, 1, INT32_MAX),
    JOINT(follow_max_q24, 0, 0, INT32_MAX),
    JOINT(friction_shift, 0, 1, 23),
    JOINT(friction_q16[0], 0, -(1 << 30), 1 << 30),
    JOINT(windup_inv_q8, 0, 0, INT32_MAX),
    JOINT(inertia_inv_q20, 0, 0, 1 << 30),
    JOINT(nm_per_digit_q24, 0, 0, 1 << 30),
    {"q_max_q24, or q_min_q24", offsetof(struct hdt_joint_tab, q_max_q24), Q_MIN_ABOVE, INT32_MAX},
    JOINT(axis, 0, 0, HDT_AXES - 1),
    JOINT(directed, 0, 0, 1),
    JOINT(line[3].amplitude_q16, 0, -INT32_MAX, INT32_MAX),
    JOINT(line[3].directed, 0, 0, 1),
    JOINT(local[0].start, 0, -INT32_MAX, INT32_MAX), JOINT(local[0].shift, 0, 1, 23),
    JOINT(local[1].start, 0, -INT32_MAX, INT32_MAX), JOINT(local[1].shift, 0, 1, 23),
    JOINT(table.start, 0, -INT32_MAX, INT32_MAX), JOINT(table.shift, 0, 1, 23),
};

static void assert_edge(const struct edge *e, void *owner, int in_joint)
{
    const int64_t value[] = {e->lo, e->hi, e->lo - 1, e->hi + 1};
    uint32_t *at = (uint32_t *)(void *)((char *)owner + e->at), before = *at;
    for (int k = 0; k < 4; k++) {
        const char *where = "";
        int joint = -2;
        *at = (uint32_t)value[k];
        const int err = hdt_tables_check(&arm, &where, &joint);
        if (k < 2) {
            ck_assert_msg(err == HDT_TABLES_OK, "%s = %lld refused for %s", e->name, (long long)value[k],
                          where);
        } else {
            ck_assert_msg(err == HDT_TABLES_RANGE, "%s = %lld accepted", e->name, (long long)value[k]);
            ck_assert_int_eq(joint, in_joint);
            ck_assert_msg(strstr(e->name, where) != NULL, "%s named %s", e->name, where);
        }
    }
    *at = before;
}

START_TEST(test_check_draws_every_line_where_it_says)
{
    uint64_t r = 8;
    ref_random_arm(&r, 16, &arm);
    arm.joint[1].stiffness[1].t2_q16 = 0;
    arm.joint[1].stiffness[1].t1_q16 = -1;
    /* nothing but the range decides: no weight for gravity, no slope
     * that friction could follow beyond its knots */
    for (int j = 0; j < 16; j++)
        memset(arm.joint[j].moment_q20, 0, sizeof arm.joint[j].moment_q20);
    for (int way = 0; way < 2; way++)
        arm.joint[1].friction_q16[way][127] = arm.joint[1].friction_q16[way][128];
    arm.joint[1].lines = 4;
    for (size_t k = 0; k < sizeof head_edges / sizeof head_edges[0]; k++)
        assert_edge(&head_edges[k], &arm, -1);
    for (size_t k = 0; k < sizeof joint_edges / sizeof joint_edges[0]; k++)
        assert_edge(&joint_edges[k], &arm.joint[1], 1);
}
END_TEST

/* One coefficient of the low-pass, the others such that the table is good but for it. */
static int takes_biquad(int64_t b0, int64_t b1, int64_t b2, int64_t a1, int64_t a2)
{
    const int64_t b[5] = {b0, b1, b2, a1, a2};
    for (int i = 0; i < 5; i++)
        arm.biquad_q28[i] = (int32_t)b[i];
    const char *where = "";
    const int err = hdt_tables_check(&arm, &where, NULL);
    if (err != HDT_TABLES_OK)
        ck_assert_str_eq(where, "biquad_q28");
    return err == HDT_TABLES_OK;
}

START_TEST(test_the_proof_assumes_no_low_pass_but_those_accepted)
{
    uint64_t r = 12;
    const int64_t one = 1 << 28, b = PROOF_B_MAX_Q28, a1 = PROOF_A1_MAX_Q28, a2 = PROOF_A2_MAX_Q28;
    ref_random_arm(&r, 1, &arm);
    /* b: a constant passes unchanged, so the largest stands over the largest of the poles' sum */
    ck_assert(takes_biquad(b, 0, 0, a1, a2) && takes_biquad(0, b, 0, a1, a2)
              && takes_biquad(0, 0, b, a1, a2));
    ck_assert(!takes_biquad(b + 1, 0, 0, a1, a2) && !takes_biquad(0, b + 1, 0, a1, a2)
              && !takes_biquad(0, 0, b + 1, a1, a2));
    ck_assert(!takes_biquad(-1, b, 0, a1, a2) && !takes_biquad(b, -1, 0, a1, a2)
              && !takes_biquad(b, 0, -1, a1, a2));
    /* a2 and a1, with what the other leaves room for most */
    for (int k = -1; k <= 1; k += 2) {
        ck_assert(takes_biquad(one + k * a2, 0, 0, 0, k * a2));
        ck_assert(takes_biquad(one + k * a1 + a2, 0, 0, k * a1, a2));
        for (int64_t other = -one; other <= one; other += one / 4) {
            ck_assert(!takes_biquad(one + k * (a2 + 1) + other, 0, 0, other, k * (a2 + 1)));
            const int64_t near = other == one ? a2 : other;
            ck_assert(!takes_biquad(one + k * (a1 + 1) + near, 0, 0, k * (a1 + 1), near));
        }
    }
}
END_TEST

START_TEST(test_the_shortest_and_longest_period_are_the_ranges)
{
    uint64_t r = 13;
    ref_random_arm(&r, 1, &arm);
    const struct { uint32_t ns; int32_t rate; const char *wrong; } at[] = {
        {31000, 2114064516, NULL}, {30999, 2114132714, "period_ns"},
        {1000000000, 65536, NULL}, {1000000001, 65536, "period_ns"}};
    for (int k = 0; k < 4; k++) {
        const char *where = NULL;
        arm.period_ns = at[k].ns;
        arm.rate_q16 = (uint32_t)at[k].rate;
        const int err = hdt_tables_check(&arm, &where, NULL);
        ck_assert_int_eq(err == HDT_TABLES_OK, at[k].wrong == NULL);
        if (at[k].wrong != NULL)
            ck_assert_str_eq(where, at[k].wrong);
    }
}
END_TEST

static void assert_wrong(const char *name, int at, int err)
{
    const char *where = "nothing";
    int joint = -2;
    ck_assert_msg(hdt_tables_check(&arm, &where, &joint) == err, "%s not noticed", name);
    ck_assert_str_eq(where, name);
    ck_assert_int_eq(joint, at);
}

START_TEST(test_check_names_what_does_not_fit_together)
{
    uint64_t r = 9;
    struct hdt_joint_tab *j = &arm.joint[2];
#define TRY(change, name, at) \
    do { ref_random_arm(&r, 4, &arm); ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), 0); \
         change; assert_wrong(name, at, HDT_TABLES_RANGE); } while (0)
    TRY(arm.rate_q16 += arm.rate_q16 / 9000, "rate_q16", -1);
    TRY(arm.rate_q16 -= arm.rate_q16 / 9000, "rate_q16", -1);
    TRY(memset(arm.name, 'x', sizeof arm.name), "name", -1);
    TRY(arm.biquad_q28[0] += 6, "biquad_q28", -1);
    TRY(arm.biquad_q28[0] -= 6, "biquad_q28", -1);
    /* gain at rest right, but a pole on the unit circle, or an input weight below zero */
    TRY((arm.biquad_q28[0] = arm.biquad_q28[1] = arm.biquad_q28[2] = 0,
         arm.biquad_q28[3] = -(1 << 28) - arm.biquad_q28[4]), "biquad_q28", -1);
    TRY((arm.biquad_q28[0] = 1 << 29, arm.biquad_q28[1] = arm.biquad_q28[2] = 0,
         arm.biquad_q28[3] = 0, arm.biquad_q28[4] = 1 << 28), "biquad_q28", -1);
    TRY((arm.biquad_q28[0] = 0, arm.biquad_q28[1] = arm.biquad_q28[2] = 0,
         arm.biquad_q28[3] = 0, arm.biquad_q28[4] = -(1 << 28)), "biquad_q28", -1);
    for (int k = 0; k < 3; k++)
        TRY((arm.biquad_q28[(k + 1) % 3] += arm.biquad_q28[k] + 1, arm.biquad_q28[k] = -1), "biquad_q28", -1);
    TRY(j->sign = 0, "sign", 2);
    TRY(j->rad_per_count_q44 = 0, "rad_per_count_q44", 2);
    TRY(j->phase_per_count_q24 += j->phase_per_count_q24 / 20000, "phase_per_count_q24", 2);
    TRY(j->phase_per_count_q24 -= j->phase_per_count_q24 / 20000, "phase_per_count_q24", 2);
    TRY(j->phase_per_count_q24 = (uint64_t)1 << 63, "phase_per_count_q24", 2);
    TRY((j->twist_cos_q30 = 0, j->twist_sin_q30 = (1 << 30) - (1 << 12)), "twist_cos_q30", 2);
    TRY((j->twist_cos_q30 = 1 << 21, j->twist_sin_q30 = 1 << 30), "twist_cos_q30", 2);
    for (int bit = 0; bit < 5; bit++)
        TRY(j->chain ^= 1u << bit, "chain", 2);
    TRY((j->stiffness[0].t1_q16 = 5, j->stiffness[0].t2_q16 = 4), "stiffness", 2);
    TRY((j->stiffness[1].t1_q16 = 5, j->stiffness[1].t2_q16 = 4), "stiffness", 2);
    TRY((j->lines = 4, j->line[3].directed = 2), "directed", 2);
    TRY((j->lines = 4, j->line[3].amplitude_q16 = INT32_MIN), "amplitude_q16", 2);
    TRY((j->lines = 4, j->line[3].phase_per_count_q24 = (uint64_t)1 << 56), "line.phase_per_count_q24", 2);
    TRY(j->q_max_q24 = j->q_min_q24, "q_min_q24", 2);
    TRY(j->moment_q20[0] = 1 << 30, "moment_q20", 2);
    /* the friction's last slope runs out of the format before the speed limit */
    TRY((j->friction_shift = 10, j->friction_q16[1][128] = j->friction_q16[1][127] + (1 << 20)),
        "friction_q16", 2);
    /* a wind-up line does at the largest load */
    TRY(j->stiffness[0].slope_q24[1] = INT32_MAX, "stiffness", 2);
    TRY(j->stiffness[1].intercept_q16[2] = INT32_MAX, "stiffness", 2);
    ref_random_arm(&r, 4, &arm);
    arm.magic ^= 1;
    assert_wrong("magic", -1, HDT_TABLES_NOT_OURS);
    ref_random_arm(&r, 4, &arm);
    arm.layout++;
    assert_wrong("layout", -1, HDT_TABLES_VERSION);
}
END_TEST

START_TEST(test_any_stable_low_pass_is_accepted)
{
    /* numerator weights may be unequal or zero as long as a constant passes unchanged */
    uint64_t r = 11;
    for (int from = 0; from < 3; from++)
        for (int to = 0; to < 3; to++) {
            ref_random_arm(&r, 1, &arm);
            const int32_t moved = arm.biquad_q28[from];
            arm.biquad_q28[from] -= moved;
            arm.biquad_q28[to] += moved;
            ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
            arm.biquad_q28[to] += 6;
            assert_wrong("biquad_q28", -1, HDT_TABLES_RANGE);
        }
}
END_TEST

/* Largest value of a member, by bisection, that is accepted; the next one names the member. */
static int64_t largest_accepted(int32_t *at, const char *name, int joint)
{
    const int32_t before = *at;
    int64_t ok = before, bad = (int64_t)INT32_MAX + 1;
    while (bad - ok > 1) {
        *at = (int32_t)((ok + bad) / 2);
        if (hdt_tables_check(&arm, NULL, NULL) == HDT_TABLES_OK)
            ok = *at;
        else
            bad = *at;
    }
    ck_assert_msg(bad <= INT32_MAX, "%s is never refused", name);
    *at = (int32_t)bad;
    const char *where = "";
    int found = -2;
    ck_assert_int_eq(hdt_tables_check(&arm, &where, &found), HDT_TABLES_RANGE);
    ck_assert_str_eq(where, name);
    ck_assert_int_eq(found, joint);
    *at = before;
    return ok;
}

START_TEST(test_an_arm_too_fast_or_too_heavy_for_the_sums_is_refused)
{
    /* one slow link, then a fast one with a step: the bounds by hand */
    uint64_t r = 10;
    ref_random_arm(&r, 2, &arm);
    struct hdt_joint_tab *a = &arm.joint[0], *b = &arm.joint[1];
    for (int i = 0; i < 3; i++)
        arm.gravity_q24[i] = i == 2 ? -(10 << 24) : 0;
    for (int j = 0; j < 2; j++) {
        struct hdt_joint_tab *k = &arm.joint[j];
        memset(k->moment_q20, 0, sizeof k->moment_q20);
        memset(k->second_q20, 0, sizeof k->second_q20);
        memset(k->stiffness, 0, sizeof k->stiffness);
        k->step_q24[0] = k->step_q24[1] = 0;
        k->v_lim_q24 = 1 << 24;
        k->a_lim_q16 = 10 << 16;
        k->friction_shift = 23;
    }
    b->step_q24[0] = 1 << 24;
    ref_chain_flags(&arm);
    ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);

    /* all links together at most 60 rad/s */
    ck_assert_double_eq_tol(D(largest_accepted(&b->v_lim_q24, "v_lim_q24", 1), 24), 59, 0.01);
    /* |U| <= 10 + a + 1 * 1 + (1 + 1)^2 rad/s^2 below 7936 */
    ck_assert_double_eq_tol(D(largest_accepted(&b->a_lim_q16, "a_lim_q16", 1), 16), 7936 - 10 - 5, 0.1);
    /* |a| <= (1000 + 1) rad/s^2 * step below 7936 m/s^2 */
    a->a_lim_q16 = 1000 << 16;
    ck_assert_double_eq_tol(D(largest_accepted(&b->step_q24[0], "step_q24", 1), 24), 7936 / 1001.0, 0.01);
    /* a step aslant counts as the longer part and 27/64 of the shorter */
    b->step_q24[1] = 2 << 24;
    ck_assert_double_eq_tol(D(largest_accepted(&b->step_q24[0], "step_q24", 1), 24),
                            7936 / 1001.0 - 27 / 32.0, 0.01);
    b->step_q24[1] = 0;
    /* whose product 64 bits do not hold */
    const char *where = "";
    a->a_lim_q16 = 7000 << 16;
    b->step_q24[0] = b->step_q24[1] = INT32_MAX;
    ck_assert_int_eq(hdt_tables_check(&arm, &where, NULL), HDT_TABLES_RANGE);
    ck_assert_str_eq(where, "step_q24");
    b->step_q24[0] = 1 << 24;
    b->step_q24[1] = 0;
    a->a_lim_q16 = 10 << 16;
    /* one link's h 500 kg.m, g h below 16384 N.m, all h together below 1024 kg.m */
    ck_assert_int_eq(largest_accepted(&b->moment_q20[0], "moment_q20", 1), 500 << 20);
    arm.gravity_q24[2] = -(40 << 24);
    ck_assert_double_eq_tol(D(largest_accepted(&b->moment_q20[0], "moment_q20", 1), 20), 16384 / 40.0, 1e-3);
    arm.gravity_q24[2] = -(10 << 24);
    a->moment_q20[0] = 400 << 20;
    b->moment_q20[1] = 500 << 20;
    b->step_q24[0] = 0;
    ref_chain_flags(&arm);
    ck_assert_double_eq_tol(D(largest_accepted(&b->moment_q20[0], "moment_q20", 1), 20),
                            124 / (27 / 64.0), 1e-3);
    /* forces below 31744 N: (10 + 1) rad/s^2 * 400 kg.m, and (a + 15) rad/s^2 * 500 kg.m */
    ck_assert_double_eq_tol(D(largest_accepted(&b->a_lim_q16, "second_q20", 1), 16),
                            (31744 - 4400) / 500.0 - 15, 1e-2);
    a->moment_q20[0] = b->moment_q20[1] = 0;
    b->a_lim_q16 = 100 << 16;
    b->step_q24[0] = 1 << 24;
    ref_chain_flags(&arm);
    /* moments of force below 31744 N.m: (10 + 100 + 1 + 4) rad/s^2 * second */
    b->chain |= HDT_CHAIN_SKEW;
    b->second_q20[1] = 1;
    ck_assert_double_eq_tol(D(largest_accepted(&b->second_q20[1], "second_q20", 1), 20), 31744 / 115.0, 1e-2);
    /* the same with 10 m/s^2 * 100 kg.m of the origin, and 115 rad/s^2 * 100 kg.m at 1 m from the base */
    b->moment_q20[1] = 100 << 20;
    ck_assert_double_eq_tol(D(largest_accepted(&b->second_q20[1], "second_q20", 1), 20),
                            (31744 - 11 * 100 - 115 * 100) / 115.0, 1e-2);
    /* and no link alone above 500 kg.m^2 */
    b->moment_q20[1] = 0;
    b->a_lim_q16 = 10 << 16;
    ck_assert_int_eq(largest_accepted(&b->second_q20[1], "second_q20", 1), 500 << 20);
}
END_TEST

START_TEST(test_a_moment_beyond_64_bits_is_refused)
{
    /* slow links 180 m apart and a last one that jerks: force times way is 2^64 to 2^66, of which 64 bits may
     * keep little */
    uint64_t r = 17;
    ref_random_arm(&r, 16, &arm);
    for (int j = 0; j < 16; j++) {
        struct hdt_joint_tab *k = &arm.joint[j];
        memset(k->moment_q20, 0, sizeof k->moment_q20);
        memset(k->second_q20, 0, sizeof k->second_q20);
        memset(k->stiffness, 0, sizeof k->stiffness);
        k->step_q24[0] = k->step_q24[1] = INT32_MAX;
        k->v_lim_q24 = k->a_lim_q16 = 1;
    }
    memset(arm.gravity_q24, 0, sizeof arm.gravity_q24);
    ref_chain_flags(&arm);
    ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
    arm.joint[15].a_lim_q16 = 60 << 16;
    int wrapped = 0;
    for (int sixteenth = 1600; sixteenth <= 8000; sixteenth++) {
        const char *where = "";
        const double product = ldexp(60.0 / 16 * sixteenth, 16) * ldexp(16 * 128 * (1 + 27 / 64.0), 24);
        arm.joint[15].moment_q20[0] = sixteenth << 16;
        ck_assert_int_eq(hdt_tables_check(&arm, &where, NULL), HDT_TABLES_RANGE);
        ck_assert_str_eq(where, "second_q20");
        wrapped += fmod(product, 0x1p64) < 0x1p54;
    }
    ck_assert_int_gt(wrapped, 3);
}
END_TEST

/* The clamps of friction, wind-up and curves never work on tables that are accepted: the last value accepted,
 * computed here in 64 bits, stays inside. */
START_TEST(test_friction_at_the_last_slope_accepted_stays_a_number)
{
    uint64_t r = 14;
    for (int n = 0; n < 60; n++) {
        ref_random_arm(&r, 1, &arm);
        struct hdt_joint_tab *j = &arm.joint[0];
        int32_t *knot = j->friction_q16[n & 1];
        j->friction_shift = 1 + (uint32_t)(test_random(&r) % 12);
        j->friction_q16[1 - (n & 1)][127] = j->friction_q16[1 - (n & 1)][128] = 0;
        knot[127] = 0;
        knot[128] = 0;
        const int64_t most = largest_accepted(&knot[128], "friction_q16", 0);
        for (int side = 0; side < 2; side++) {
            knot[128] = (int32_t)(side ? -most : most);
            ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
            const int64_t past = j->v_lim_q24 - ((int64_t)127 << j->friction_shift);
            const int64_t end = hdt_shr((int64_t)knot[128] * past, j->friction_shift);
            ck_assert(end <= INT32_MAX && end >= -INT32_MAX);
            /* no more cautious than a slope in the last place */
            if (most < 1 << 30)
                ck_assert_int_gt(llabs(end) + (past >> j->friction_shift) + 3, INT32_MAX);
            /* and the core's own term, at full speed either way */
            struct hdt_motion m = {0};
            m.dir_q30 = n & 1 ? -(1 << 30) : 1 << 30;
            m.v_fric_q24 = n & 1 ? -j->v_lim_q24 : j->v_lim_q24;
            ck_assert(hdt_comp_friction(j, &m) == (n & 1 ? -end : end));
        }
    }
}
END_TEST

START_TEST(test_windup_at_the_last_slope_accepted_stays_a_number)
{
    uint64_t r = 15;
    for (int n = 0; n < 60; n++) {
        ref_random_arm(&r, 1, &arm);
        struct hdt_joint_tab *j = &arm.joint[0];
        struct hdt_stiffness_tab *way = &j->stiffness[n & 1];
        memset(j->stiffness, 0, sizeof j->stiffness);
        j->terms = 1u << HDT_TERM_STIFFNESS | (n & 2 ? 1u << HDT_TERM_SPRING : 0u);
        j->moment_q20[0] = 200 << 20;
        j->moment_q20[1] = 0;
        for (int i = 0; i < 3; i++)
            arm.gravity_q24[i] = i == n % 3 ? 10 << 24 : 0;
        way->intercept_q16[1] = (int32_t)test_uniform(&r, 0, 0x1p30);
        way->slope_q24[1] = 1;
        const int64_t most = largest_accepted(&way->slope_q24[1], "stiffness", 0);
        /* the load there can be: |g| |h|, and the spring's */
        int64_t load = (int64_t)(10 * 200 * 65536) + (n & 2 ? HDT_SPRING_MAX_Q16 : 0);
        for (int side = 0; side < 2; side++) {
            way->slope_q24[1] = (int32_t)most;
            way->intercept_q16[1] = side ? -way->intercept_q16[1] : way->intercept_q16[1];
            way->t1_q16 = -INT32_MAX;
            way->t2_q16 = INT32_MAX;
            ck_assert_int_eq(hdt_tables_check(&arm, NULL, NULL), HDT_TABLES_OK);
            const int64_t at = side ? -load : load, end = way->intercept_q16[1] + hdt_shr(most * at, 24);
            ck_assert_int_eq(hdt_comp_windup(way, (int32_t)at), end);
            ck_assert_int_gt(llabs(end), INT32_MAX - (1 << 18));
        }
    }
}
END_TEST

START_TEST(test_a_curve_lies_between_its_knots)
{
    uint64_t r = 16;
    static struct hdt_joint_tab j;
    for (int n = 0; n < 3000; n++) {
        j.table.start = (int32_t)test_random(&r);
        j.table.shift = 1 + (uint32_t)(test_random(&r) % 23);
        for (int k = 0; k < HDT_CURVE_KNOTS; k++)
            j.table.value_q8[k] = test_random(&r) & 1 ? INT16_MAX : INT16_MIN;
        struct hdt_motion m = {0};
        for (int i = 0; i < 30; i++) {
            const int64_t way = (int64_t)(test_random(&r) % ((uint64_t)260 << j.table.shift));
            m.q_q24 = hdt_sat(j.table.start + way - ((int64_t)2 << j.table.shift));
            const int32_t got = hdt_comp_table(&j, &m, 0);
            ck_assert(got >= INT16_MIN * 256 && got <= INT16_MAX * 256);
        }
    }
}
END_TEST

START_TEST(test_every_error_has_its_words)
{
    const char *seen[7];
    for (int e = 0; e >= -6; e--) {
        seen[-e] = hdt_tables_strerror(e);
        ck_assert_ptr_nonnull(seen[-e]);
        for (int k = 0; k < -e; k++)
            ck_assert_str_ne(seen[-e], seen[k]);
    }
}
END_TEST

static Suite *tables_suite(void)
{
    Suite *s = suite_create("tables");
    TCase *i = tcase_create("image"), *c = tcase_create("check");
    tcase_set_timeout(i, 60);
    tcase_add_test(i, test_image_round_trip_is_exact);
    tcase_add_test(i, test_bytes_are_where_the_format_says);
    tcase_add_test(i, test_writer_refuses_a_small_buffer);
    tcase_add_test(i, test_every_wrong_length_is_short);
    tcase_add_test(i, test_every_flipped_bit_is_noticed);
    tcase_add_test(i, test_other_layout_is_recognised_and_told);
    tcase_add_loop_test(i, test_any_bytes_are_read_or_refused, 0, 4);
    tcase_add_test(c, test_check_draws_every_line_where_it_says);
    tcase_add_test(c, test_check_names_what_does_not_fit_together);
    tcase_add_test(c, test_any_stable_low_pass_is_accepted);
    tcase_add_test(c, test_an_arm_too_fast_or_too_heavy_for_the_sums_is_refused);
    tcase_add_test(c, test_a_moment_beyond_64_bits_is_refused);
    tcase_add_test(c, test_the_proof_assumes_no_low_pass_but_those_accepted);
    tcase_add_test(c, test_the_shortest_and_longest_period_are_the_ranges);
    tcase_add_test(c, test_friction_at_the_last_slope_accepted_stays_a_number);
    tcase_add_test(c, test_windup_at_the_last_slope_accepted_stays_a_number);
    tcase_add_test(c, test_a_curve_lies_between_its_knots);
    tcase_add_test(c, test_every_error_has_its_words);
    suite_add_tcase(s, i);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(tables_suite())
