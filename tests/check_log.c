/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Logs: the CSV read back by a parser of the test's own, the event log read by liblcm and by code
 * from lcm-gen, files that are cut or damaged at every byte, disks that are full.
 */
#define _GNU_SOURCE /* memmem */
#include <errno.h>
#include <lcm/lcm.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "driver/drv_dump.h"
#include "driver/drv_lcm.h"
#include "tests/check_main.h"
#include "tests/driver_rig.h"

static char dir[64], csv[80], lcm[80], part[90];

static void in_own_directory(void)
{
    strcpy(dir, P_tmpdir "/hdt_log_XXXXXX");
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(csv, sizeof csv, "%s/run.csv", dir);
    snprintf(lcm, sizeof lcm, "%s/run.lcm", dir);
}

static void leave_directory(void)
{
    unlink(csv);
    unlink(lcm);
    ck_assert_int_eq(rmdir(dir), 0); /* no .part, nothing else is left behind */
}

static const char *part_of(const char *path)
{
    snprintf(part, sizeof part, "%s.part", path);
    return part;
}

static int exists(const char *path)
{
    struct stat st;
    return lstat(path, &st) == 0;
}

static int32_t random_s32(uint64_t *rng)
{
    uint64_t r = test_random(rng);
    return r % 5 == 0 ? (r & 8 ? INT32_MAX : INT32_MIN) : (int32_t)(r >> 32);
}

static uint32_t random_u32(uint64_t *rng)
{
    return (uint32_t)random_s32(rng);
}

static int16_t random_s16(uint64_t *rng)
{
    return (int16_t)(test_random(rng) >> 48);
}

/* Every used member random, every unused joint zero. */
static struct drv_record random_record(uint64_t *rng, unsigned joints, uint64_t t_us)
{
    static struct drv_record r;
    memset(&r, 0, sizeof r);
    r.in.t_us = t_us;
    r.in.mode = random_u32(rng);
    r.in.active = random_u32(rng);
    r.in.fresh = random_u32(rng) | 1u;
    r.in.servo_alarm = random_u32(rng);
    r.out.fault = random_u32(rng);
    r.out.fault_joints = random_u32(rng);
    r.driver_status = (uint16_t)random_s16(rng);
    r.link = (uint16_t)random_s16(rng);
    for (unsigned j = 0; j < joints; j++) {
        r.in.count[j].raw = random_s32(rng);
        r.in.q_ref[j].raw = random_s32(rng);
        r.in.v_ref[j].raw = random_s32(rng);
        r.in.a_ref[j].raw = random_s32(rng);
        r.out.digit[j].raw = random_s16(rng);
        r.out.speed[j].raw = random_s16(rng);
        r.out.limit[j] = random_u32(rng);
        r.out.q[j].raw = random_s32(rng);
        r.out.v[j].raw = random_s32(rng);
        for (unsigned k = 0; k < HDT_TERMS; k++)
            r.out.term[k][j].raw = random_s32(rng);
        r.out.total[j].raw = random_s32(rng);
        r.torque_dig[j] = random_s16(rng);
        r.status[j] = (uint16_t)random_s16(rng);
    }
    return r;
}

static const char *const constants[] = {"payload_kg = 2.0", "payload_com_m = 0 0 0.07", NULL};

static struct drv_writer_cfg config(unsigned joints)
{
    struct hdt_tables *t = rig_tables();
    struct drv_writer_cfg cfg = {.tables = t, .constants = constants};
    t->joints = joints;
    for (unsigned j = 0; j < joints && j < HDT_JOINTS_MAX; j++)
        cfg.ratio[j] = 50.0 + 0.1 * j;
    return cfg;
}

static struct drv_writer *open_ok(const char *path, const struct drv_writer_cfg *cfg)
{
    char err[300] = "";
    struct drv_writer *w = drv_writer_open(path, cfg, err, sizeof err);
    ck_assert_msg(w != NULL, "%s", err);
    return w;
}

/* Write n random records, the same for the same seed. */
static void write_log(const char *path, const struct drv_writer_cfg *cfg, unsigned n, uint64_t seed)
{
    struct drv_writer *w = open_ok(path, cfg);
    for (unsigned i = 0; i < n; i++) {
        struct drv_record r = random_record(&seed, cfg->tables->joints,
                                            5000000 + 1429 * (uint64_t)i);
        ck_assert_int_eq(drv_writer_put(w, &r), 0);
    }
    ck_assert_int_eq(drv_writer_close(w, 1), 0);
}

static void put_file(const char *path, const void *bytes, size_t size)
{
    unlink(path); /* truncating makes some file systems write the old file out first */
    FILE *f = fopen(path, "wb");
    ck_assert_uint_eq(fwrite(bytes, 1, size, f), size);
    fclose(f);
}

static char *slurp(const char *path, size_t *size)
{
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    char *text = calloc(1, 1 << 22);
    *size = fread(text, 1, (1 << 22) - 1, f);
    ck_assert_uint_lt(*size, (1 << 22) - 1);
    fclose(f);
    return text;
}

/* ---- CSV ------------------------------------------------------------------------------------ */

/* The next field of a row as a number; *p moves behind its separator. */
static double next_field(char **p)
{
    char *end;
    double v = strtod(*p, &end);
    ck_assert_ptr_ne(end, *p);
    ck_assert(*end == ',' || *end == '\n');
    *p = end + 1;
    return v;
}

static void assert_near(double value, double raw, double lsb)
{
    ck_assert_double_le(fabs(value - raw * lsb), 0.04 * lsb); /* so that rounding gives raw back */
}

START_TEST(test_csv_gives_back_every_count)
{
    struct drv_writer_cfg cfg = config(7);
    size_t size;
    write_log(csv, &cfg, 50, 7);
    char *text = slurp(csv, &size), *p = strstr(text, "\nt_s,"), *line;
    ck_assert_ptr_nonnull(p);
    *p++ = '\0';
    ck_assert_str_eq(text, "# format = hdt-log\n# version = 1\n# arm = rig\n# table_digest = "
                           "00112233445566778899aabbccddeeff102132435465768798a9bacbdcedfe0f\n"
                           "# period_ns = 1428571\n# ratio1 = 50\n# ratio2 = 50.100000000000001\n"
                           "# ratio3 = 50.200000000000003\n# ratio4 = 50.299999999999997\n"
                           "# ratio5 = 50.399999999999999\n# ratio6 = 50.5\n# ratio7 = 50.600000000000001\n"
                           "# payload_kg = 2.0\n# payload_com_m = 0 0 0.07");
    line = strchr(p, '\n');
    *line++ = '\0';
    char want[1000] = "t_s";
    for (int j = 1; j <= 7; j++)
        sprintf(want + strlen(want),
                ",q%d_rad,tau%d_nm,v%d_radps,qref%d_rad,vref%d_radps,aref%d_radps2", j, j, j, j, j,
                    j);
    ck_assert_str_eq(p, want);
    uint64_t seed = 7;
    for (unsigned i = 0; i < 50; i++) {
        struct drv_record r = random_record(&seed, 7, 0);
        assert_near(next_field(&line), 1429.0 * i, 1e-6);
        for (unsigned j = 0; j < 7; j++) {
            assert_near(next_field(&line), r.out.q[j].raw, 0x1p-24);
            assert_near(next_field(&line), r.torque_dig[j], 0.001 * cfg.ratio[j]);
            assert_near(next_field(&line), r.out.v[j].raw, 0x1p-24);
            assert_near(next_field(&line), r.in.q_ref[j].raw, 0x1p-24);
            assert_near(next_field(&line), r.in.v_ref[j].raw, 0x1p-24);
            assert_near(next_field(&line), r.in.a_ref[j].raw, 0x1p-16);
        }
        ck_assert_int_eq(line[-1], '\n');
    }
    ck_assert_str_eq(line, "");
    free(text);
}
END_TEST

START_TEST(test_csv_has_a_column_for_each_term_in_use_when_asked)
{
    struct drv_writer_cfg cfg = config(2);
    size_t size;
    cfg.terms = 1;
    cfg.constants = NULL;
    struct hdt_tables *t = rig_tables();
    t->joints = 2;
    t->joint[1].terms = 1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_D;
    write_log(csv, &cfg, 5, 8);
    char *text = slurp(csv, &size), *line = strstr(text, "\nt_s,") + 1;
    char *end = strchr(line, '\n');
    *end = '\0';
    ck_assert_str_eq(line, "t_s,q1_rad,tau1_nm,v1_radps,qref1_rad,vref1_radps,aref1_radps2,"
                           "q2_rad,tau2_nm,v2_radps,qref2_rad,vref2_radps,aref2_radps2,"
                           "offset1_nm,p1_nm,digit1,gravity2_nm,d2_nm,digit2,fault,link");
    line = end + 1;
    uint64_t seed = 8;
    for (unsigned i = 0; i < 5; i++) {
        struct drv_record r = random_record(&seed, 2, 0);
        for (int k = 0; k < 13; k++)
            (void)next_field(&line);
        assert_near(next_field(&line), r.out.term[HDT_TERM_OFFSET][0].raw, 0x1p-16);
        assert_near(next_field(&line), r.out.term[HDT_TERM_P][0].raw, 0x1p-16);
        ck_assert_double_eq(next_field(&line), r.out.digit[0].raw);
        assert_near(next_field(&line), r.out.term[HDT_TERM_GRAVITY][1].raw, 0x1p-16);
        assert_near(next_field(&line), r.out.term[HDT_TERM_D][1].raw, 0x1p-16);
        ck_assert_double_eq(next_field(&line), r.out.digit[1].raw);
        ck_assert_double_eq(next_field(&line), r.out.fault);
        ck_assert_double_eq(next_field(&line), r.link);
        ck_assert_int_eq(line[-1], '\n');
    }
    free(text);
}
END_TEST

START_TEST(test_csv_leaves_out_periods_without_a_state_and_starts_at_zero)
{
    struct drv_writer_cfg cfg = config(1);
    struct drv_writer *w = open_ok(csv, &cfg);
    uint64_t seed = 9;
    for (unsigned i = 0; i < 10; i++) {
        struct drv_record r = random_record(&seed, 1, 1000000000000u + i * 1000000u);
        if (i < 3 || i == 6)
            r.in.fresh = 0;
        ck_assert_int_eq(drv_writer_put(w, &r), 0);
    }
    ck_assert_int_eq(drv_writer_close(w, 1), 0);
    size_t size;
    char *text = slurp(csv, &size), *line = strchr(strstr(text, "\nt_s,") + 1, '\n') + 1;
    static const double want[] = {0, 1, 2, 4, 5, 6};
    for (unsigned i = 0; i < 6; i++) {
        ck_assert_double_eq(strtod(line, NULL), want[i]);
        line = strchr(line, '\n') + 1;
    }
    ck_assert_str_eq(line, "");
    free(text);
}
END_TEST

/* ---- event log ------------------------------------------------------------------------------ */

static struct drv_reader *reader_ok(const char *path)
{
    char err[600] = "";
    struct drv_reader *r = drv_reader_open(path, err, sizeof err);
    ck_assert_msg(r != NULL, "%s", err);
    return r;
}

START_TEST(test_event_log_gives_back_every_record_bit_for_bit)
{
    static const unsigned joints[] = {1, 7, HDT_JOINTS_MAX};
    for (unsigned k = 0; k < 3; k++) {
        struct drv_writer_cfg cfg = config(joints[k]);
        write_log(lcm, &cfg, 300, 10 + k);
        struct drv_reader *r = reader_ok(lcm);
        const struct drv_run *run = drv_reader_run(r);
        ck_assert_uint_eq(run->version, DRV_LOG_VERSION);
        ck_assert_uint_eq(run->table_layout, HDT_TABLES_LAYOUT);
        ck_assert_uint_eq(run->period_ns, 1428571);
        ck_assert_uint_eq(run->joints, joints[k]);
        ck_assert_str_eq(run->arm, "rig");
        ck_assert_mem_eq(run->digest, rig_tables()->digest, 32);
        ck_assert_mem_eq(run->ratio, cfg.ratio, sizeof run->ratio);
        ck_assert_str_eq(run->constants, "payload_kg = 2.0\npayload_com_m = 0 0 0.07\n");
        uint64_t seed = 10 + k;
        static struct drv_record got, want;
        for (unsigned i = 0; i < 300; i++) {
            want = random_record(&seed, joints[k], 5000000 + 1429 * (uint64_t)i);
            ck_assert_int_eq(drv_reader_next(r, &got), 1);
            ck_assert_mem_eq(&got, &want, sizeof got);
        }
        ck_assert_int_eq(drv_reader_next(r, &got), 0);
        ck_assert_int_eq(drv_reader_next(r, &got), 0);
        ck_assert_str_eq(drv_reader_error(r), "");
        drv_reader_close(r);
    }
}
END_TEST

START_TEST(test_event_log_replays_through_the_core)
{
    struct drv_writer_cfg cfg = config(7);
    struct drv_writer *w = open_ok(lcm, &cfg);
    static struct drv_record rec;
    hdt_t core;
    uint64_t rng = 12;
    ck_assert_int_eq(hdt_init(&core, cfg.tables), HDT_OK);
    for (unsigned i = 0; i < 500; i++) {
        memset(&rec, 0, sizeof rec);
        rec.in.t_us = 1429 * (uint64_t)(i + 1);
        rec.in.mode = HDT_MODE_TORQUE;
        rec.in.active = 0x7f;
        rec.in.fresh = test_random(&rng) % 4 ? 0x7f : 0;
        for (unsigned j = 0; j < 7; j++) {
            rec.in.count[j].raw = (int32_t)(i * (j + 1));
            rec.in.q_ref[j].raw = (int32_t)(test_random(&rng) >> 42);
        }
        ck_assert_int_eq(hdt_step(&core, &rec.in, &rec.out), HDT_OK);
        ck_assert_int_eq(drv_writer_put(w, &rec), 0);
    }
    ck_assert_int_eq(drv_writer_close(w, 1), 0);
    struct drv_reader *r = reader_ok(lcm);
    struct hdt_out out;
    unsigned n = 0;
    ck_assert_int_eq(hdt_init(&core, cfg.tables), HDT_OK);
    while (drv_reader_next(r, &rec) == 1) {
        ck_assert_int_eq(hdt_step(&core, &rec.in, &out), HDT_OK);
        ck_assert_mem_eq(&out, &rec.out, sizeof out);
        n++;
    }
    ck_assert_uint_eq(n, 500);
    drv_reader_close(r);
}
END_TEST

/* A run of the core as a host sees it; the fault comes with an alarm at period `alarm`, from 0. */
static void alarmed_run(unsigned periods, unsigned alarm, struct drv_dump *dump, unsigned slots)
{
    static struct drv_record rec, slot[64];
    static hdt_t core;
    uint64_t rng = 21;
    ck_assert_int_eq(hdt_init(&core, rig_tables()), HDT_OK);
    ck_assert_int_eq(drv_dump_init(dump, slot, slots, &core), HDT_OK);
    for (unsigned i = 0; i < periods; i++) {
        memset(&rec, 0, sizeof rec);
        rec.in.t_us = 1429 * (uint64_t)(i + 1);
        rec.in.mode = HDT_MODE_TORQUE;
        rec.in.active = rec.in.fresh = 0x7f;
        rec.in.servo_alarm = i == alarm;
        for (unsigned j = 0; j < 7; j++)
            rec.in.v_ref[j].raw = (int32_t)(test_random(&rng) >> 42);
        ck_assert_int_eq(hdt_step(&core, &rec.in, &rec.out), HDT_OK);
        drv_dump_note(dump, &rec, &core);
    }
}

START_TEST(test_dump_keeps_the_last_periods_before_a_fault_and_replays)
{
    struct drv_writer_cfg cfg = config(7);
    static struct drv_record rec;
    static struct drv_dump dump;
    static struct hdt_out out;
    static hdt_t core;
    char err[300] = "";
    for (unsigned alarm = 0; alarm < 40; alarm++) {
        alarmed_run(alarm + 10, alarm, &dump, 16);
        ck_assert_int_eq(dump.full, 1);
        ck_assert_msg(drv_dump_write(&dump, lcm, &cfg, err, sizeof err) == 0, "%s", err);
        struct drv_reader *r = reader_ok(lcm);
        ck_assert_int_eq(drv_reader_start(r, rig_tables(), &core), HDT_OK);
        unsigned n = 0;
        while (drv_reader_next(r, &rec) == 1) {
            ck_assert_int_eq(hdt_step(&core, &rec.in, &out), HDT_OK);
            ck_assert_mem_eq(&out, &rec.out, sizeof out);
            n++;
        }
        drv_reader_close(r);
        /* the last is the one of the fault; half the capacity at least, where the run is that long */
        ck_assert_uint_eq(rec.in.t_us, 1429 * (uint64_t)(alarm + 1));
        ck_assert_uint_eq(rec.out.fault, HDT_FAULT_SERVO);
        ck_assert_msg(n <= 16 && n >= (alarm + 1 < 8 ? alarm + 1 : 8), "alarm %u: %u periods", alarm, n);
    }
    ck_assert_int_eq(drv_dump_init(&dump, &rec, 1, &core), HDT_ERR_ARG);
    ck_assert_int_eq(drv_dump_init(&dump, NULL, 2, &core), HDT_ERR_ARG);
    ck_assert_int_eq(drv_dump_write(&dump, csv, &cfg, err, sizeof err), -1);
    ck_assert_ptr_nonnull(strstr(err, ".lcm"));
}
END_TEST

START_TEST(test_event_log_carries_its_tables)
{
    struct drv_writer_cfg cfg = config(7);
    static struct hdt_tables tables;
    static hdt_t core;
    write_log(lcm, &cfg, 3, 13);
    struct drv_reader *r = reader_ok(lcm);
    ck_assert_int_eq(drv_reader_tables(r, &tables), HDT_TABLES_OK);
    ck_assert_mem_eq(tables.digest, cfg.tables->digest, 32);
    ck_assert_int_eq(tables.joint[6].kp_q16, cfg.tables->joint[6].kp_q16);
    ck_assert_int_eq(drv_reader_start(r, &tables, &core), HDT_OK);
    ck_assert_uint_eq(core.steps, 0);
    drv_reader_close(r);
}
END_TEST

/* Tables that use all of the core's memory. */
static struct hdt_tables *busy_tables(void)
{
    struct hdt_tables *t = rig_tables();
    t->observer = (1 << HDT_OBSERVED) - 1;
    t->observer_gain[0] = t->observer_gain[1] = t->observer_gain[2] = 1 << 30;
    for (unsigned j = 0; j < t->joints; j++) {
        t->joint[j].terms = (1u << HDT_TERMS) - 1u;
        t->joint[j].windup_inv_q8 = INT32_MAX;
        t->joint[j].cold_decay_q31 = INT32_MAX - (int32_t)j * (INT32_MAX / 7);
        t->joint[j].presliding_inv_q8 = 1 << 8;
        t->joint[j].inertia_inv_q20 = t->joint[j].nm_per_digit_q24 = 1 << 30;
        t->joint[j].dig_max = 32767;
    }
    ck_assert_int_eq(hdt_tables_check(t, NULL, NULL), HDT_TABLES_OK);
    return t;
}

/* Any input a core can be given, more often at the ends than between. */
static struct hdt_in any_input(uint64_t *rng, uint64_t t_us)
{
    struct hdt_in in = {.t_us = t_us, .mode = test_random(rng) % 3, .active = random_u32(rng),
                        .fresh = random_u32(rng)};
    in.servo_alarm = test_random(rng) % 8 == 0 ? random_u32(rng) : 0;
    for (unsigned j = 0; j < DRV_AXES; j++) {
        in.count[j].raw = random_s32(rng) >> test_random(rng) % 16;
        in.q_ref[j].raw = random_s32(rng) >> 6;
        in.v_ref[j].raw = random_s32(rng);
        in.a_ref[j].raw = random_s32(rng);
    }
    return in;
}

START_TEST(test_whatever_a_core_has_seen_its_memory_is_taken_for_one)
{
    const struct hdt_tables *t = busy_tables();
    static hdt_t core, fresh;
    static struct hdt_out out;
    char why[200] = "";
    uint64_t rng = 31;
    ck_assert_int_eq(hdt_init(&fresh, t), HDT_OK);
    core = fresh;
    ck_assert_int_eq(drv_lcm_check_core(&core, &fresh, why, sizeof why), 0);
    for (uint64_t n = 0, t_us = 0; n < 50000; n++) {
        t_us += 1 + test_random(&rng) % (n % 16 ? 3000 : 3000000);
        struct hdt_in in = any_input(&rng, t_us);
        ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
        ck_assert_msg(drv_lcm_check_core(&core, &fresh, why, sizeof why) == 0, "period %lu: %s",
                      (unsigned long)n, why);
        if (test_random(&rng) % 4 == 0)
            ck_assert_int_eq(hdt_clear(&core), HDT_OK);
    }
}
END_TEST

/* Bytes over the core's memory in the state event of a log; what opening and starting from it says. */
static int start_from(const char *bytes, size_t size, size_t state_at, const hdt_t *core, const char *words)
{
    static hdt_t started;
    static struct drv_record rec;
    static struct hdt_out out;
    char *log = malloc(size);
    memcpy(log, bytes, size);
    memcpy(log + state_at + offsetof(struct drv_lcm_state, core), core, sizeof *core);
    put_file(lcm, log, size);
    free(log);
    struct drv_reader *r = reader_ok(lcm);
    const int e = drv_reader_start(r, busy_tables(), &started);
    if (e == HDT_OK) {
        for (int n = 0; n < 3 && drv_reader_next(r, &rec) == 1; n++)
            (void)hdt_step(&started, &rec.in, &out);
    } else {
        ck_assert_int_eq(e, DRV_LOG_DAMAGED);
        ck_assert_msg(strstr(drv_reader_error(r), words) != NULL, "expected \"%s\" in \"%s\"", words,
                      drv_reader_error(r));
        ck_assert_ptr_nonnull(strstr(drv_reader_error(r), lcm));
        ck_assert_int_lt(drv_reader_next(r, &rec), 0);
    }
    drv_reader_close(r);
    return e;
}

/* A log of a few periods that begins within a run; where its state's data is. */
static char *log_within_a_run(size_t *size, size_t *state_at, hdt_t *core)
{
    struct drv_writer_cfg cfg = config(DRV_AXES);
    static struct drv_record rec;
    uint64_t rng = 41, t_us = 0;
    cfg.tables = busy_tables();
    ck_assert_int_eq(hdt_init(core, cfg.tables), HDT_OK);
    for (int n = 0; n < 20; n++) {
        rec.in = any_input(&rng, t_us += 1429);
        rec.in.active = rec.in.fresh = 0x7f;
        ck_assert_int_eq(hdt_step(core, &rec.in, &rec.out), HDT_OK);
    }
    ck_assert_int_eq(hdt_clear(core), HDT_OK);
    cfg.state = core;
    struct drv_writer *w = open_ok(lcm, &cfg);
    for (int n = 0; n < 3; n++) {
        rec.in = any_input(&rng, t_us += 1429);
        rec.in.active = rec.in.fresh = 0x7f;
        ck_assert_int_eq(drv_writer_put(w, &rec), 0);
    }
    ck_assert_int_eq(drv_writer_close(w, 1), 0);
    char *bytes = slurp(lcm, size);
    const char *state = memmem(bytes, *size, "HDT_STATE", 9);
    ck_assert_ptr_nonnull(state);
    *state_at = (size_t)(state + 9 - bytes);
    return bytes;
}

START_TEST(test_a_state_no_core_can_have_is_refused_by_its_member)
{
    size_t size, at;
    static hdt_t good, bad;
    char *bytes = log_within_a_run(&size, &at, &good);
    ck_assert_int_eq(start_from(bytes, size, at, &good, ""), HDT_OK);
#define REFUSED(member, value)                                                                       \
    do {                                                                                             \
        bad = good;                                                                                  \
        bad.member = value;                                                                          \
        ck_assert_msg(start_from(bytes, size, at, &bad, "damaged: ") != HDT_OK, #member " = " #value);\
    } while (0)
#define BOUNDS(member, least, most)                                                                  \
    do {                                                                                             \
        REFUSED(member, (least) - 1);                                                                \
        REFUSED(member, (most) + 1);                                                                 \
        bad = good;                                                                                  \
        bad.member = least;                                                                          \
        ck_assert_msg(start_from(bytes, size, at, &bad, "") == HDT_OK, #member " = " #least);        \
        bad.member = most;                                                                           \
        ck_assert_msg(start_from(bytes, size, at, &bad, "") == HDT_OK, #member " = " #most);         \
    } while (0)
    const int64_t one = 1;
    BOUNDS(gate.digit[0], -32767, 32767);
    BOUNDS(gate.digit[6], -32767, 32767);
    BOUNDS(vel[3].rest, -(1 << 27), (1 << 27) - 1);
    BOUNDS(obs[0].q_q40, -(one << 48), one << 48);
    BOUNDS(obs[6].q_q40, -(one << 48), one << 48);
    BOUNDS(obs[1].v_q40, 1 - (one << 47), (one << 47) - 1);
    BOUNDS(obs[2].d_q32, -(one << 44), one << 44);
    BOUNDS(obs[3].a_q16, -(1 << 28), 1 << 28);
    BOUNDS(dir[4], -1, 1);
    BOUNDS(travel_q40[5], 0, one << 46);
    BOUNDS(wound_q30[6], -(1 << 30), 1 << 30);
    BOUNDS(cold_q30[0], 0, 1 << 30);
    REFUSED(vel[0].x_q24[0], INT32_MIN);
    REFUSED(vel[1].x_q24[1], INT32_MIN);
    REFUSED(vel[2].y_q24[0], INT32_MIN);
    REFUSED(vel[6].y_q24[1], INT32_MIN);
    REFUSED(seen, 0xff);
    REFUSED(observed, 0x80);
    REFUSED(terms, good.terms ^ 1u);
    REFUSED(gate.fault, 1u << 5);
    REFUSED(gate.fault_joints, 1); /* of no fault */
    bad = good;
    bad.seen = 0x3f; /* observed has 0x7f */
    ck_assert_int_eq(start_from(bytes, size, at, &bad, "observed is 0x7f, expected no bits but 0x3f"),
                     DRV_LOG_DAMAGED);
    bad = good;
    bad.obs[2].q_q40 = INT64_MIN;
    ck_assert_int_eq(start_from(bytes, size, at, &bad,
                                "obs.q_q40 of joint 3 is -9223372036854775808, expected -281474976710656 to "
                                "281474976710656"), DRV_LOG_DAMAGED);
    free(bytes);
}
END_TEST

START_TEST(test_any_bytes_as_a_state_are_refused_or_replay)
{
    size_t size, at;
    static hdt_t good, bad;
    char *bytes = log_within_a_run(&size, &at, &good);
    uint64_t rng = 51;
    unsigned taken = 0;
    for (unsigned n = 0; n < 3000; n++) {
        bad = good;
        for (uint64_t k = 1 + test_random(&rng) % (n % 2 ? 2 : 200); k > 0; k--)
            ((uint8_t *)&bad)[test_random(&rng) % sizeof bad] = (uint8_t)test_random(&rng);
        taken += start_from(bytes, size, at, &bad, "damaged: ") == HDT_OK;
    }
    ck_assert_uint_gt(taken, 300);
    ck_assert_uint_lt(taken, 2000);
    free(bytes);
}
END_TEST

/* The log at path as it was written before the terms local and table, which stood before p. */
static void to_13_terms(const char *path, unsigned joints)
{
    const size_t rows = 60 + 32 * joints, gone = 11 * 4 * joints, width = 2 * 4 * joints;
    size_t size, used = 0;
    char *whole = slurp(path, &size);
    uint8_t *old = malloc(size);
    for (size_t at = 0; at < size;) {
        const uint8_t *e = (const uint8_t *)whole + at;
        const size_t name = e[23];
        const size_t len = (size_t)e[24] << 24 | (size_t)e[25] << 16 | (size_t)e[26] << 8 | e[27];
        uint8_t *to = old + used;
        memcpy(to, e, 28 + name + len);
        used += 28 + name + len;
        if (name == 7 && memcmp(e + 28, "HDT_RUN", name) == 0) {
            to[28 + name + 15] = 1; /* table layout */
            to[28 + name + 23] = 13;
        } else if (name == 9 && memcmp(e + 28, "HDT_CYCLE", name) == 0) {
            uint8_t *data = to + 28 + name;
            data[27] = 13;
            memmove(data + rows + gone, data + rows + gone + width, len - rows - gone - width);
            used -= width;
            to[26] = (uint8_t)((len - width) >> 8);
            to[27] = (uint8_t)(len - width);
        }
        at += 28 + name + len;
    }
    put_file(path, old, used);
    free(old);
    free(whole);
}

START_TEST(test_a_log_of_thirteen_terms_reads_with_the_other_two_zero)
{
    struct drv_writer_cfg cfg = config(3);
    static struct drv_record got, want;
    uint64_t seed = 31;
    write_log(lcm, &cfg, 5, seed);
    to_13_terms(lcm, 3);
    struct drv_reader *r = reader_ok(lcm);
    ck_assert_uint_eq(drv_reader_run(r)->terms, 13);
    for (unsigned i = 0; i < 5; i++) {
        want = random_record(&seed, 3, 5000000 + 1429 * (uint64_t)i);
        for (unsigned j = 0; j < 3; j++)
            want.out.term[HDT_TERM_LOCAL][j].raw = want.out.term[HDT_TERM_TABLE][j].raw = 0;
        ck_assert_int_eq(drv_reader_next(r, &got), 1);
        ck_assert_mem_eq(&got, &want, sizeof got);
    }
    ck_assert_int_eq(drv_reader_next(r, &got), 0);
    drv_reader_close(r);
}
END_TEST

START_TEST(test_liblcm_reads_the_event_log)
{
    struct drv_writer_cfg cfg = config(7);
    write_log(lcm, &cfg, 100, 13);
    lcm_eventlog_t *log = lcm_eventlog_create(lcm, "r");
    lcm_eventlog_event_t *e;
    int64_t n = 0;
    while ((e = lcm_eventlog_read_next_event(log)) != NULL) {
        ck_assert_int_eq(e->eventnum, n);
        ck_assert_str_eq(e->channel, n == 0 ? "HDT_RUN" : n == 1 ? "HDT_TABLES" : "HDT_CYCLE");
        /* what stands before the first period has its time, or a
         * player waits for as long as the host was up */
        ck_assert_int_eq(e->timestamp, 5000000 + 1429 * (n < 2 ? 0 : n - 2));
        n++;
        lcm_eventlog_free_event(e);
    }
    ck_assert_int_eq(n, 102);
    lcm_eventlog_destroy(log);
}
END_TEST

/* What tests/lcm_dump.c prints, from the records themselves. */
static void dump(FILE *f, const struct drv_record *r, unsigned joints)
{
#define LIST(value)                             \
    do {                                        \
        for (unsigned j = 0; j < joints; j++)   \
            fprintf(f, " %d", (int)(value));    \
        fprintf(f, "\n");                       \
    } while (0)
    fprintf(f, "cycle 1 %lld %u %d %d %d %d %d\n", (long long)r->in.t_us, joints, HDT_TERMS,
            (int)r->in.mode, (int)r->in.active, (int)r->in.fresh, (int)r->in.servo_alarm);
    LIST(r->in.count[j].raw);
    LIST(r->in.q_ref[j].raw);
    LIST(r->in.v_ref[j].raw);
    LIST(r->in.a_ref[j].raw);
    LIST(r->out.digit[j].raw);
    LIST(r->out.speed[j].raw);
    fprintf(f, "%d %d\n", (int)r->out.fault, (int)r->out.fault_joints);
    LIST(r->out.limit[j]);
    LIST(r->out.q[j].raw);
    LIST(r->out.v[j].raw);
    for (unsigned k = 0; k < HDT_TERMS; k++)
        LIST(r->out.term[k][j].raw);
    LIST(r->out.total[j].raw);
    LIST(r->torque_dig[j]);
    LIST((int16_t)r->status[j]);
    fprintf(f, "%d %d\n", (int16_t)r->driver_status, (int16_t)r->link);
#undef LIST
}

START_TEST(test_code_from_lcm_gen_reads_the_same_numbers)
{
    char cmd[1000], want[100], got[100];
    struct drv_writer_cfg cfg = config(7);
    size_t wsize, gsize;
    if (system("command -v lcm-gen >/dev/null && command -v cc >/dev/null") != 0)
        HDT_SKIP("needs lcm-gen (liblcm-bin) and cc");
    write_log(lcm, &cfg, 20, 14);
    snprintf(want, sizeof want, "%s/want", dir);
    snprintf(got, sizeof got, "%s/got", dir);
    snprintf(cmd, sizeof cmd,
             "cd %s && root='%s' && mkdir gen && lcm-gen -c --c-no-pubsub --c-cpath gen --c-hpath gen "
             "\"$root/driver/hdt_cycle.lcm\" && "
             "cc -Igen -o gen/dump \"$root/tests/lcm_dump.c\" gen/*.c -llcm && gen/dump run.lcm > got; e=$?; "
             "rm -r gen; exit $e",
             dir, getcwd((char[500]){0}, 500));
    ck_assert_int_eq(system(cmd), 0);
    FILE *f = fopen(want, "w");
    fprintf(f, "event 0 5000000 HDT_RUN\nrun 1 %u 1428571 %d rig 7\n", HDT_TABLES_LAYOUT, HDT_TERMS);
    for (unsigned i = 0; i < 32; i++)
        fprintf(f, " %02x", rig_tables()->digest[i]);
    fprintf(f, "\n");
    for (unsigned j = 0; j < 7; j++)
        fprintf(f, " %.17g", cfg.ratio[j]);
    fprintf(f, "\n%s\n%s\n.\nevent 1 5000000 HDT_TABLES\n", constants[0], constants[1]);
    uint64_t seed = 14;
    for (unsigned i = 0; i < 20; i++) {
        struct drv_record r = random_record(&seed, 7, 5000000 + 1429 * (uint64_t)i);
        fprintf(f, "event %u %lld HDT_CYCLE\n", i + 2, (long long)r.in.t_us);
        dump(f, &r, 7);
    }
    fclose(f);
    char *a = slurp(want, &wsize), *b = slurp(got, &gsize);
    ck_assert_str_eq(b, a);
    ck_assert_uint_gt(wsize, 10000);
    free(a);
    free(b);
    unlink(want);
    unlink(got);
}
END_TEST

START_TEST(test_a_message_fits_its_room_or_nothing_is_said_to_be_written)
{
    static uint8_t buf[DRV_LCM_DATA_MAX];
    static struct drv_run run;
    static struct drv_record back;
    uint64_t seed = 24;
    struct drv_record rec = random_record(&seed, 3, 1);
    run.version = DRV_LOG_VERSION;
    run.joints = 3;
    strcpy(run.arm, "rig");
    strcpy(run.constants, "a = 1\n");
    for (int k = 0; k < 2; k++) {
        size_t whole = k ? drv_lcm_put_run(&run, buf, sizeof buf)
                         : drv_lcm_put_record(&rec, 3, buf, sizeof buf);
        ck_assert_uint_gt(whole, 60);
        for (size_t room = 0; room <= whole + 1; room++) {
            /* memory of exactly this size, so that a sanitizer sees the byte after it too */
            uint8_t *exact = malloc(room + 1);
            exact[room] = 0xc7;
            size_t n = k ? drv_lcm_put_run(&run, exact, room) : drv_lcm_put_record(&rec, 3, exact,
                                                                                   room);
            ck_assert_uint_eq(n, room < whole ? 0 : whole);
            ck_assert_uint_eq(exact[room], 0xc7);
            free(exact);
            exact = malloc(room ? room : 1);
            memcpy(exact, buf, room);
            static struct drv_run run_back;
            int e = k ? drv_lcm_get_run(exact, room, &run_back) : drv_lcm_get_record(exact, room, 3,
                                                                                     HDT_TERMS, &back);
            ck_assert_int_eq(e == DRV_LCM_OK, room == whole);
            free(exact);
        }
    }
    /* joints of the message and of the run must agree */
    size_t n = drv_lcm_put_record(&rec, 3, buf, sizeof buf);
    ck_assert_int_eq(drv_lcm_get_record(buf, n, 2, HDT_TERMS, &back), DRV_LCM_DAMAGED);
    ck_assert_int_eq(drv_lcm_get_record(buf, n, 4, HDT_TERMS, &back), DRV_LCM_DAMAGED);
    /* and terms */
    ck_assert_int_eq(drv_lcm_get_record(buf, n, 3, 13, &back), DRV_LCM_DAMAGED);
    ck_assert_int_eq(drv_lcm_get_record(buf, n, 3, HDT_TERMS + 1, &back), DRV_LCM_DAMAGED);
}
END_TEST

/* ---- damage --------------------------------------------------------------------------------- */

/* Read all; returns records, and whether the end was clean in *clean. */
static int read_all(const char *path, int *clean, char *err, size_t errlen)
{
    static struct drv_record rec;
    struct drv_reader *r = drv_reader_open(path, err, errlen);
    int n = 0, e;
    *clean = 0;
    if (r == NULL)
        return -1;
    while ((e = drv_reader_next(r, &rec)) == 1)
        n++;
    *clean = e == 0;
    snprintf(err, errlen, "%s", drv_reader_error(r));
    ck_assert_int_eq(e == 0, err[0] == '\0');
    drv_reader_close(r);
    return n;
}

START_TEST(test_a_log_cut_at_any_byte_is_said_to_be_cut)
{
    struct drv_writer_cfg cfg = config(2);
    size_t size;
    write_log(lcm, &cfg, 4, 15);
    char *whole = slurp(lcm, &size), err[600];
    uint8_t head[DRV_LCM_HEAD];
    struct drv_lcm_head h;
    unsigned ends = 0;
    size_t boundary = 0;
    for (size_t cut = 0; cut <= size; cut++) {
        int clean, n;
        put_file(lcm, whole, cut);
        n = read_all(lcm, &clean, err, sizeof err);
        if (cut == boundary && cut > 0) {
            /* after whole events: as many cycles as there are, no
             * complaint; head and tables stand before them */
            ck_assert_int_eq(n, ends < 2 ? 0 : (int)ends - 2);
            ck_assert_int_eq(clean, 1);
        } else {
            ck_assert_int_eq(clean, 0);
            ck_assert_int_eq(n, ends == 0 ? -1 : ends < 2 ? 0 : (int)ends - 2);
            ck_assert_ptr_nonnull(strstr(err, cut == 0 ? "no hdt log" : "cut off"));
            ck_assert_ptr_nonnull(strstr(err, "run.lcm: at byte"));
        }
        if (cut == boundary && cut < size) {
            memcpy(head, whole + boundary, sizeof head);
            drv_lcm_get_head(head, &h);
            boundary += DRV_LCM_HEAD + h.channel_len + h.data_len;
        }
        if (cut + 1 == boundary)
            ends++;
    }
    ck_assert_uint_eq(ends, 6);
    free(whole);
}
END_TEST

START_TEST(test_any_byte_changed_is_safe_and_structure_is_noticed)
{
    struct drv_writer_cfg cfg = config(2);
    size_t size;
    write_log(lcm, &cfg, 3, 16);
    char *whole = slurp(lcm, &size), err[600];
    unsigned noticed = 0;
    for (size_t at = 0; at < size; at++) {
        int clean, n;
        char keep = whole[at];
        whole[at] = (char)(keep ^ (1 << at % 8));
        put_file(lcm, whole, size);
        n = read_all(lcm, &clean, err, sizeof err);
        ck_assert_int_le(n, 3);
        noticed += !clean;
        /* the mark of every event, and the whole head of the run up to its ratio, must be noticed */
        if (at < 4 || (at >= DRV_LCM_HEAD && at < DRV_LCM_HEAD + 7 + 8 + 4))
            ck_assert_int_eq(n, -1);
        whole[at] = keep;
    }
    ck_assert_uint_gt(noticed, 60);
    free(whole);
}
END_TEST

START_TEST(test_random_bytes_are_never_a_log)
{
    uint64_t rng = 17;
    char err[600];
    for (int n = 0; n < 300; n++) {
        uint8_t b[400];
        unsigned size = test_random(&rng) % sizeof b;
        int clean;
        for (unsigned i = 0; i < size; i++)
            b[i] = (uint8_t)test_random(&rng);
        /* a good mark and plausible lengths let it get further */
        static const uint8_t mark[4] = {0xed, 0xa1, 0xda, 0x01};
        if (n % 2 && size >= 40) {
            memcpy(b, mark, 4);
            memset(b + 20, 0, 8);
            b[23] = 7;
            b[27] = (uint8_t)(size - 35);
            memcpy(b + 28, "HDT_RUN", 7);
        }
        put_file(lcm, b, size);
        ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), -1);
    }
}
END_TEST

START_TEST(test_wrong_files_and_versions_say_what_was_found)
{
    struct drv_writer_cfg cfg = config(2);
    char err[600];
    int clean;
    size_t size;
    ck_assert_int_eq(read_all("/nonexistent/x.lcm", &clean, err, sizeof err), -1);
    ck_assert_ptr_nonnull(strstr(err, "/nonexistent/x.lcm: cannot be read: No such file"));
    ck_assert_int_eq(read_all(dir, &clean, err, sizeof err), -1);
    write_log(csv, &cfg, 3, 18);
    ck_assert_int_eq(read_all(csv, &clean, err, sizeof err), -1);
    ck_assert_ptr_nonnull(strstr(err, "no LCM event here"));

    write_log(lcm, &cfg, 3, 18);
    char *whole = slurp(lcm, &size);
    /* a later version: another fingerprint, its number in the same place */
    whole[DRV_LCM_HEAD + 7] ^= 0x11;
    whole[DRV_LCM_HEAD + 7 + 8 + 3] = 2;
    put_file(lcm, whole, size);
    ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), -1);
    ck_assert_ptr_nonnull(strstr(err, "log version 2, this program reads version 1"));
    free(whole);

    /* numbers of terms whose names are not known */
    for (int terms = 0; terms < 18; terms++) {
        char found[40];
        write_log(lcm, &cfg, 3, 18);
        whole = slurp(lcm, &size);
        whole[DRV_LCM_HEAD + 7 + 23] = (char)terms;
        put_file(lcm, whole, size);
        ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), terms == HDT_TERMS ? 3
                                                                 : terms == 13      ? 0
                                                                                    : -1);
        snprintf(found, sizeof found, "the log has %d torque terms", terms);
        if (terms != HDT_TERMS)
            ck_assert_ptr_nonnull(strstr(err, terms == 13 ? "a cycle that is damaged" : found));
        free(whole);
    }

    /* a cycle of another type, and one of another version, behind a good head */
    for (int k = 0; k < 2; k++) {
        write_log(lcm, &cfg, 3, 18);
        whole = slurp(lcm, &size);
        char *cycle = memmem(whole, size, "HDT_CYCLE", 9) + 9;
        cycle[k ? 8 + 3 : 7] ^= 3;
        put_file(lcm, whole, size);
        ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), 0);
        ck_assert_ptr_nonnull(strstr(err, "a cycle of another version"));
        free(whole);
    }
}
END_TEST

START_TEST(test_foreign_channels_are_passed_over_and_a_second_run_is_not)
{
    struct drv_writer_cfg cfg = config(2);
    char err[600];
    int clean;
    size_t size;
    write_log(lcm, &cfg, 3, 19);
    char *whole = slurp(lcm, &size);
    /* foreign event longer than any of ours, in front and behind */
    static uint8_t foreign[DRV_LCM_HEAD + 6 + 2 * DRV_LCM_DATA_MAX + 1];
    struct drv_lcm_head h = {.magic = DRV_LCM_MAGIC, .channel_len = 6,
        .data_len = 2 * DRV_LCM_DATA_MAX + 1};
    drv_lcm_put_head(&h, foreign);
    memcpy(foreign + DRV_LCM_HEAD, "CAMERA", 6);
    FILE *f = fopen(lcm, "wb");
    fwrite(foreign, 1, sizeof foreign, f);
    fwrite(whole, 1, size, f);
    fwrite(foreign, 1, sizeof foreign, f);
    fclose(f);
    ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), 3);
    ck_assert_int_eq(clean, 1);
    f = fopen(lcm, "ab");
    fwrite(whole, 1, size, f);
    fclose(f);
    ck_assert_int_eq(read_all(lcm, &clean, err, sizeof err), 3);
    ck_assert_int_eq(clean, 0);
    snprintf(part, sizeof part, "at byte %zu: a second run", size + 2 * sizeof foreign);
    ck_assert_ptr_nonnull(strstr(err, part));
    free(whole);
}
END_TEST

/* ---- files ---------------------------------------------------------------------------------- */

START_TEST(test_a_log_has_no_name_until_it_is_whole)
{
    struct drv_writer_cfg cfg = config(3);
    const char *const paths[] = {csv, lcm};
    for (unsigned k = 0; k < 2; k++) {
        uint64_t seed = 20;
        struct drv_writer *w = open_ok(paths[k], &cfg);
        struct drv_record r = random_record(&seed, 3, 1);
        ck_assert_int_eq(drv_writer_put(w, &r), 0);
        ck_assert_int_eq(exists(paths[k]), 0);
        ck_assert_int_eq(exists(part_of(paths[k])), 1);
        /* discarded: nothing */
        ck_assert_int_eq(drv_writer_close(w, 0), 0);
        ck_assert_int_eq(exists(paths[k]), 0);
        ck_assert_int_eq(exists(part_of(paths[k])), 0);
        /* what was there before stays until the new one is whole */
        put_file(paths[k], "old", 3);
        w = open_ok(paths[k], &cfg);
        ck_assert_int_eq(drv_writer_close(w, 0), 0);
        size_t size;
        char *text = slurp(paths[k], &size);
        ck_assert_str_eq(text, "old");
        free(text);
        write_log(paths[k], &cfg, 1, 21);
        text = slurp(paths[k], &size);
        ck_assert_uint_gt(size, 100);
        free(text);
        ck_assert_int_eq(exists(part_of(paths[k])), 0);
    }
    ck_assert_int_eq(drv_writer_close(NULL, 1), 0);
}
END_TEST

START_TEST(test_a_full_disk_at_any_size_is_an_error_and_leaves_the_old_log)
{
    struct drv_writer_cfg cfg = config(7);
    const char *const paths[] = {csv, lcm};
    signal(SIGXFSZ, SIG_IGN);
    for (unsigned k = 0; k < 2; k++) {
        struct rlimit was, limit;
        unsigned failures = 0, put_failures = 0;
        put_file(paths[k], "old", 3);
        for (rlim_t room = 0; room < 400000; room += 9973) {
            char err[300] = "";
            getrlimit(RLIMIT_FSIZE, &was);
            limit = was;
            limit.rlim_cur = room;
            setrlimit(RLIMIT_FSIZE, &limit);
            struct drv_writer *w = drv_writer_open(paths[k], &cfg, err, sizeof err);
            uint64_t seed = 22;
            int first = 0, recovered = 0;
            for (unsigned i = 0; w != NULL && i < 800; i++) {
                struct drv_record r = random_record(&seed, 7, 1 + i);
                int e = drv_writer_put(w, &r);
                recovered |= first != 0 && e != first;
                first = e;
            }
            int c = w != NULL ? drv_writer_close(w, 1) : -EFBIG;
            /* no assertion above: Check's own file is under the limit too */
            setrlimit(RLIMIT_FSIZE, &was);
            ck_assert_int_eq(recovered, 0);
            ck_assert(first == 0 || first == -EFBIG);
            put_failures += first != 0;
            ck_assert_int_eq(c, -EFBIG);
            failures++;
            ck_assert_int_eq(exists(part_of(paths[k])), 0);
            size_t size;
            char *text = slurp(paths[k], &size);
            ck_assert_str_eq(text, "old");
            free(text);
        }
        ck_assert_uint_eq(failures, 41);
        ck_assert_uint_gt(put_failures, 20); /* known long before the end of the run */
    }
}
END_TEST

START_TEST(test_no_space_left_is_reported_as_such)
{
    struct drv_writer_cfg cfg = config(7);
    const char *const paths[] = {csv, lcm};
    for (unsigned k = 0; k < 2; k++) {
        char err[300] = "";
        ck_assert_int_eq(symlink("/dev/full", part_of(paths[k])), 0);
        struct drv_writer *w = drv_writer_open(paths[k], &cfg, err, sizeof err);
        if (k == 1) { /* the tables at its head fill more than the buffer */
            ck_assert_ptr_null(w);
            ck_assert_ptr_nonnull(strstr(err, "No space left"));
            ck_assert_int_eq(exists(part_of(paths[k])), 0);
            continue;
        }
        ck_assert_ptr_nonnull(w); /* the head still fits the buffer */
        uint64_t seed = 23;
        struct drv_record r = random_record(&seed, 7, 1);
        (void)drv_writer_put(w, &r);
        ck_assert_int_eq(drv_writer_close(w, 1), -ENOSPC);
        ck_assert_int_eq(exists(paths[k]), 0);
        ck_assert_int_eq(exists(part_of(paths[k])), 0);
        ck_assert_int_eq(exists("/dev/full"), 1);
    }
}
END_TEST

static void refused(const char *path, const struct drv_writer_cfg *cfg, const char *word)
{
    char err[400] = "";
    ck_assert_ptr_null(drv_writer_open(path, cfg, err, sizeof err));
    ck_assert_msg(strstr(err, word) != NULL, "expected \"%s\" in: %s", word, err);
    ck_assert_ptr_null(strchr(err, '\n'));
    ck_assert_ptr_null(drv_writer_open(path, cfg, NULL, 0));
}

START_TEST(test_what_cannot_be_logged_is_refused_before_a_file_is_touched)
{
    struct drv_writer_cfg cfg = config(3);
    char bad[120];
    refused(NULL, &cfg, "no path");
    refused(csv, NULL, "no path or no configuration");
    snprintf(bad, sizeof bad, "%s/run.txt", dir);
    refused(bad, &cfg, "expected one ending in .csv or .lcm");
    refused(".csv", &cfg, "expected one ending in .csv or .lcm");
    snprintf(bad, sizeof bad, "%s/none/run.csv", dir);
    refused(bad, &cfg, "No such file");
    snprintf(bad, sizeof bad, "%s/is.csv", dir);
    ck_assert_int_eq(mkdir(bad, 0700), 0);
    refused(bad, &cfg, "is a directory");
    rmdir(bad);
    static const double ratios[] = {0.0, -50.0, INFINITY, NAN};
    for (unsigned i = 0; i < 4; i++) {
        cfg.ratio[2] = ratios[i];
        refused(csv, &cfg, "ratio of joint 3");
    }
    cfg = config(3);
    static const char *const lines[] = {"no equals sign", "= 3", "a = 1\nb = 2", "tab\t= 1"};
    for (unsigned i = 0; i < 4; i++) {
        const char *list[] = {"good = 1", lines[i], NULL};
        cfg.constants = list;
        refused(csv, &cfg, "constant 2: expected one line");
        refused(lcm, &cfg, "constant 2: expected one line");
    }
    static char longest[DRV_CONSTANTS_MAX];
    memset(longest, 'x', sizeof longest);
    longest[1] = '=';
    longest[DRV_CONSTANTS_MAX - 1] = '\0';
    const char *list[] = {longest, NULL};
    cfg.constants = list;
    refused(lcm, &cfg, "constant 1");
    /* the longest that fits does */
    longest[DRV_CONSTANTS_MAX - 2] = '\0';
    struct drv_writer *w = open_ok(lcm, &cfg);
    ck_assert_int_eq(drv_writer_close(w, 1), 0);
    struct drv_reader *r = reader_ok(lcm);
    ck_assert_uint_eq(strlen(drv_reader_run(r)->constants), DRV_CONSTANTS_MAX - 1);
    drv_reader_close(r);
    cfg = config(0);
    refused(csv, &cfg, "no tables with 1 to 16 joints");
    cfg = config(HDT_JOINTS_MAX + 1);
    refused(csv, &cfg, "no tables with 1 to 16 joints");
    cfg.tables = NULL;
    refused(csv, &cfg, "no tables with 1 to 16 joints");
}
END_TEST

static TCase *new_case(Suite *s, const char *name)
{
    TCase *t = tcase_create(name);
    tcase_set_timeout(t, 60);
    tcase_add_checked_fixture(t, in_own_directory, leave_directory);
    suite_add_tcase(s, t);
    return t;
}

static Suite *log_suite(void)
{
    Suite *s = suite_create("log");
    TCase *t = new_case(s, "csv");
    tcase_add_test(t, test_csv_gives_back_every_count);
    tcase_add_test(t, test_csv_has_a_column_for_each_term_in_use_when_asked);
    tcase_add_test(t, test_csv_leaves_out_periods_without_a_state_and_starts_at_zero);
    t = new_case(s, "event log");
    tcase_add_test(t, test_event_log_gives_back_every_record_bit_for_bit);
    tcase_add_test(t, test_event_log_replays_through_the_core);
    tcase_add_test(t, test_dump_keeps_the_last_periods_before_a_fault_and_replays);
    tcase_add_test(t, test_event_log_carries_its_tables);
    tcase_add_test(t, test_a_log_of_thirteen_terms_reads_with_the_other_two_zero);
    tcase_add_test(t, test_liblcm_reads_the_event_log);
    tcase_add_test(t, test_code_from_lcm_gen_reads_the_same_numbers);
    t = new_case(s, "damage");
    tcase_add_test(t, test_a_message_fits_its_room_or_nothing_is_said_to_be_written);
    tcase_add_test(t, test_a_log_cut_at_any_byte_is_said_to_be_cut);
    tcase_add_test(t, test_whatever_a_core_has_seen_its_memory_is_taken_for_one);
    tcase_add_test(t, test_a_state_no_core_can_have_is_refused_by_its_member);
    tcase_add_test(t, test_any_bytes_as_a_state_are_refused_or_replay);
    tcase_add_test(t, test_any_byte_changed_is_safe_and_structure_is_noticed);
    tcase_add_test(t, test_random_bytes_are_never_a_log);
    tcase_add_test(t, test_wrong_files_and_versions_say_what_was_found);
    tcase_add_test(t, test_foreign_channels_are_passed_over_and_a_second_run_is_not);
    t = new_case(s, "files");
    tcase_add_test(t, test_a_log_has_no_name_until_it_is_whole);
    tcase_add_test(t, test_a_full_disk_at_any_size_is_an_error_and_leaves_the_old_log);
    tcase_add_test(t, test_no_space_left_is_reported_as_such);
    tcase_add_test(t, test_what_cannot_be_logged_is_refused_before_a_file_is_touched);
    return s;
}

HDT_CHECK_MAIN(log_suite())
