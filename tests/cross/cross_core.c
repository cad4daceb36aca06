/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The core on one machine, as text that must be the same on every machine.
 *
 * For each table image: it is read, written back byte for byte, refused with one bit turned; then two
 * long runs go through hdt_init and hdt_step, one near a smooth path and one of any bits at all, and a
 * digest of every output field of every period is printed now and then.
 *
 * Owns: the inputs (integers from one seed), the order in which fields go into the digest.
 * Never: depends on byte order, word size, padding or a library: it runs on a bare Cortex-M.
 */
#include <string.h>

#include "ctrl/hdt.h"
#include "tests/cross/cross.h"

#define PERIODS 20000u /* each kind of run, each arm */
#define PRINT_EVERY 5000u

static struct hdt_tables tables;
static hdt_t core;
static struct hdt_in in;
static struct hdt_out out;
static uint8_t written[131072];

/* ---- digest: FNV-1a, 64 bits, least significant byte first ------------------------------------ */

static uint64_t digest;
static uint64_t hashed; /* bytes, to see that no field is left out */

static void hash(uint64_t value, unsigned bytes)
{
    for (unsigned i = 0; i < bytes; i++)
        digest = (digest ^ (value >> (8 * i) & 0xffu)) * 0x100000001b3u;
    hashed += bytes;
}

/* Every member by name; the test below fails to compile when one is added and not named here. */
static void hash_out(const struct hdt_out *o)
{
    for (unsigned j = 0; j < HDT_JOINTS_MAX; j++) {
        hash((uint16_t)o->digit[j].raw, 2);
        hash((uint16_t)o->speed[j].raw, 2);
        hash(o->limit[j], 4);
        hash((uint32_t)o->q[j].raw, 4);
        hash((uint32_t)o->v[j].raw, 4);
        hash((uint32_t)o->v_obs[j].raw, 4);
        hash((uint32_t)o->total[j].raw, 4);
        for (unsigned k = 0; k < HDT_TERMS; k++)
            hash((uint32_t)o->term[k][j].raw, 4);
    }
    hash(o->fault, 4);
    hash(o->fault_joints, 4);
}
typedef char every_output_is_hashed[sizeof(struct hdt_out) ==
                                    HDT_JOINTS_MAX * (24 + 4 * HDT_TERMS) + 8 ? 1 : -1];

/* ---- inputs -------------------------------------------------------------------------------------- */

static uint64_t seed;

static uint64_t random64(void)
{
    uint64_t z = (seed += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* -size .. size */
static int32_t random_within(int32_t size)
{
    return (int32_t)(random64() % (2u * (uint32_t)size + 1u)) - size;
}

/* Any bits, the ends of the range more often than chance has it. */
static int32_t random_word(void)
{
    static const int32_t end[] = {0, 1, -1, INT32_MAX, -INT32_MAX, INT32_MIN, 1 << 24, -(1 << 24)};
    const uint64_t r = random64();
    const int32_t word = (int32_t)((r >> 8 & 0x7fffffffu) % 0x7fffffffu);
    if ((r & 7u) == 0)
        return end[r >> 61];
    return r & 8u ? -word : word;
}

/* Speed and angle of the reference go for a walk; the counts follow with a little lag and noise. */
static void smooth_input(uint64_t period)
{
    in.t_us += tables.period_ns / 1000u + (random64() & 63u);
    in.count_us = random64() & 1u ? in.t_us - (random64() & 127u) : 0;
    const uint32_t of_4096 = period % 4096u;
    in.mode = of_4096 < 3500u ? HDT_MODE_TORQUE : of_4096 < 3900u ? HDT_MODE_VELOCITY : HDT_MODE_IDLE;
    in.active = ((uint32_t)1 << tables.joints) - 1u;
    in.fresh = period == 0 ? in.active : (uint32_t)(random64() | random64() | random64());
    in.servo_alarm = random64() % 3000u == 0 ? 1u : 0u;
    for (uint32_t j = 0; j < tables.joints; j++) {
        const struct hdt_joint_tab *t = &tables.joint[j];
        /* towards a speed that holds the angle near zero; +-1 rad/s and a pull of a twelfth */
        in.a_ref[j].raw = random_within(1 << 18) - in.q_ref[j].raw / 256 - in.v_ref[j].raw / 256;
        in.v_ref[j].raw += in.a_ref[j].raw / 2;
        in.q_ref[j].raw += in.v_ref[j].raw / 512;
        const int64_t turned = ((int64_t)in.q_ref[j].raw << 20) / (int64_t)t->rad_per_count_q44;
        const int32_t count = (int32_t)(turned - turned / 64) + random_within(8);
        in.count[j].raw = t->zero_cnt + (t->sign < 0 ? -count : count);
    }
}

static void wild_input(void)
{
    in.t_us += 1u + (random64() & 0xfffffu);
    in.count_us = random64() & 1u ? random64() : 0;
    in.mode = (uint32_t)(random64() % 3u);
    in.active = (uint32_t)random64();
    in.fresh = (uint32_t)random64();
    in.servo_alarm = random64() % 64u == 0 ? (uint32_t)random64() : 0u;
    for (uint32_t j = 0; j < HDT_JOINTS_MAX; j++) {
        in.count[j].raw = random_word();
        in.q_ref[j].raw = random_word();
        in.v_ref[j].raw = random_word();
        in.a_ref[j].raw = random_word();
    }
}

/* ---- what is printed ------------------------------------------------------------------------------ */

static void put_number(uint64_t value)
{
    char text[24], *at = text + sizeof text;
    *--at = 0;
    do {
        *--at = (char)('0' + value % 10u);
        value /= 10u;
    } while (value != 0);
    cross_put(at);
}

static void put_hex(uint64_t value)
{
    char text[17];
    for (unsigned i = 0; i < 16; i++)
        text[i] = "0123456789abcdef"[value >> (60 - 4 * i) & 15u];
    text[16] = 0;
    cross_put(text);
}

static void put_line(const char *name, const char *what, uint64_t number)
{
    cross_put(name);
    cross_put(what);
    put_number(number);
    cross_put(" ");
    put_hex(digest);
    cross_put("\n");
}

/* 0 when the image is what the core says it is, on this machine too. */
static int check_image(const struct cross_image *i)
{
    int e = hdt_tables_read(i->bytes, i->size, &tables);
    if (e != HDT_TABLES_OK) {
        cross_put(hdt_tables_strerror(e));
        return e;
    }
    const size_t size = hdt_tables_write(&tables, written, sizeof written);
    if (size != i->size || memcmp(written, i->bytes, size) != 0)
        return 1;
    written[size / 2] ^= 1u;
    if (hdt_tables_read(written, size, &tables) != HDT_TABLES_CRC)
        return 1;
    return hdt_tables_read(i->bytes, i->size, &tables);
}

static void run(const struct cross_image *i, int wild)
{
    uint64_t faults = 0, driven = 0;
    memset(&in, 0, sizeof in);
    digest = 0xcbf29ce484222325u;
    seed = i->size;
    hash((uint64_t)(int64_t)hdt_init(&core, &tables), 8);
    for (uint64_t k = 0; k < PERIODS; k++) {
        if (wild)
            wild_input();
        else
            smooth_input(k);
        hash((uint64_t)(int64_t)hdt_step(&core, &in, &out), 8);
        hash_out(&out);
        faults += out.fault != 0;
        driven += out.digit[0].raw != 0;
        /* a fault is kept for a while, then cleared */
        if (out.fault != 0 && random64() % 32u == 0)
            hash((uint64_t)(int64_t)hdt_clear(&core), 8);
        if ((k + 1) % PRINT_EVERY == 0)
            put_line(i->name, wild ? " wild " : " smooth ", k + 1);
    }
    digest = faults;
    put_line(i->name, " driven, faults (hexadecimal) ", driven);
}

int cross_main(void)
{
    for (unsigned k = 0; k < cross_images; k++) {
        const int e = check_image(&cross_image[k]);
        if (e != 0) {
            cross_put(cross_image[k].name);
            cross_put(": the table image is not read and written back as it is\n");
            return 1;
        }
        run(&cross_image[k], 0);
        run(&cross_image[k], 1);
    }
    cross_put("end\n");
    return 0;
}
