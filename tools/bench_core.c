/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What one control period of the shipped PA-10 costs.
 *
 *   bench_core                  time of a period, median and 99th percentile, and sizes
 *   bench_core --states SET N   just N periods at random states with a set of terms, for an
 *                               instruction counter (tools/bench-core)
 *
 * Three sets of terms: the law of the paper (gravity, friction, ripple, wind-up, P, D), the same with
 * inertia, and every term there is.
 *
 * Owns: the printed figures.  Never: is a test; time on a shared machine varies, instructions do not.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctrl/hdt.h"
#include "model/hdt_arm.h"

#define INPUTS 4096
#define BATCH 8
#define BATCHES 20000

static struct hdt_arm arm;
static struct hdt_tables tables;
static struct hdt_in input[INPUTS];
static struct hdt_out output;
static hdt_t core;

#define BIT(t) (1u << (t))
#define PAPER (BIT(HDT_TERM_GRAVITY) | BIT(HDT_TERM_FRICTION) | BIT(HDT_TERM_RIPPLE) | \
               BIT(HDT_TERM_STIFFNESS) | BIT(HDT_TERM_P) | BIT(HDT_TERM_D))

static const struct { const char *name; uint32_t terms; } sets[] = {
    {"law of the paper", PAPER},
    {"with inertia", PAPER | BIT(HDT_TERM_INERTIA)},
    {"every term", BIT(HDT_TERMS) - 1u},
};

static double uniform(uint64_t *seed, double low, double high)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return low + (high - low) * ldexp((double)(*seed >> 11), -53);
}

/* Every effect at some size, so that no term is absent from a joint or spared by a zero. */
static void add_effects(struct hdt_arm *a)
{
    a->payload_kg = 2;
    a->payload_com_m[0] = 0.03;
    a->payload_com_m[2] = 0.07;
    for (int j = 0; j < a->joints; j++) {
        struct hdt_arm_joint *k = &a->joint[j];
        k->load_mu = 0.05;
        k->cold_coulomb_nm = 3;
        k->cold_viscous_nmspr = 4;
        k->warm_s = 900;
        k->presliding_nm = 1;
        k->presliding_rad = 1e-3;
        k->spring_nmprad = 2;
        k->spring_q0_rad = 0.3;
        k->torque_offset_nm = -0.7;
        k->lines = 2;
        k->line[0] = (struct hdt_arm_line){100.5, 0.6, 0.2, 1};
        k->line[1] = (struct hdt_arm_line){1.5, 0.5, -0.4, 0};
        if (!k->has_stiffness) { /* the wrist has no soft wind-up of its own: the elbow's */
            k->has_stiffness = 1;
            memcpy(k->stiffness, a->joint[3].stiffness, sizeof k->stiffness);
        }
        k->has_local = k->has_table = k->table_directed = 1;
        k->table_axis = HDT_AXIS_LOAD;
        k->local[0].from = k->local[1].from = -1;
        k->local[0].to = k->local[1].to = 1.5;
        k->table.from = -60;
        k->table.to = 60;
        for (int i = 0; i < HDT_ARM_CURVE_POINTS; i++) {
            k->local[0].nm[i] = 1 + sin(0.3 * i);
            k->local[1].nm[i] = 2 + sin(0.2 * i);
            k->table.nm[i] = sin(0.1 * i);
        }
    }
}

/* The arm with these terms, and states it may be in: angles within the limits, the reference near. */
static void prepare(uint32_t terms, int random)
{
    char err[300];
    uint64_t seed = 1;
    if (hdt_arm_load("model/arms/pa10.toml", &arm, err, sizeof err) != 0) {
        fprintf(stderr, "bench_core: %s\n", err);
        exit(3);
    }
    if (terms == sets[2].terms)
        add_effects(&arm);
    if (hdt_arm_tables(&arm, &tables, NULL, err, sizeof err) != 0) {
        fprintf(stderr, "bench_core: %s\n", err);
        exit(3);
    }
    for (uint32_t j = 0; j < tables.joints; j++) {
        tables.joint[j].terms &= terms;
        if (tables.joint[j].terms != terms && terms == sets[2].terms) {
            fprintf(stderr, "bench_core: joint %u: terms 0x%x, expected 0x%x\n", j + 1, tables.joint[j].terms,
                    terms);
            exit(1);
        }
    }
    if (hdt_init(&core, &tables) != HDT_OK)
        exit(1);
    for (int k = 0; k < INPUTS; k++) {
        struct hdt_in *in = &input[k];
        in->mode = HDT_MODE_TORQUE;
        in->active = in->fresh = (1u << tables.joints) - 1;
        for (uint32_t j = 0; j < tables.joints; j++) {
            const double x = 2 * 3.14159265358979 * k / INPUTS + j;
            const double v_max = ldexp(tables.joint[j].v_max_q24, -24);
            const double q = random ? uniform(&seed, arm.joint[j].q_min_rad, arm.joint[j].q_max_rad)
                                    : 0.4 * sin(x);
            const double v = random ? uniform(&seed, -v_max, v_max) : 0.5 * cos(x);
            in->q_ref[j].raw = (int32_t)lrint(ldexp(q, 24));
            in->v_ref[j].raw = (int32_t)lrint(ldexp(v, 24));
            in->a_ref[j].raw = (int32_t)lrint(ldexp(random ? uniform(&seed, -20, 20) : -sin(x), 16));
            in->count[j].raw = (int32_t)lrint(ldexp(q, 44) / tables.joint[j].rad_per_count_q44);
        }
    }
}

static void period(unsigned long k)
{
    struct hdt_in *in = &input[k % INPUTS];
    in->t_us = 1 + k * 1429;
    hdt_step(&core, in, &output);
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void time_it(const char *what, uint32_t terms)
{
    static double ns[BATCHES];
    prepare(terms, 0);
    for (unsigned long k = 0; k < BATCHES; k++) {
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        for (unsigned long i = 0; i < BATCH; i++)
            period(k * BATCH + i);
        clock_gettime(CLOCK_MONOTONIC, &b);
        ns[k] = ((double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec)) / BATCH;
    }
    qsort(ns, BATCHES, sizeof ns[0], by_value);
    printf("core: %u joints, %s: %.0f ns a period (median), %.0f ns (99 %%)\n", tables.joints, what,
           ns[BATCHES / 2], ns[BATCHES * 99 / 100]);
    if (output.fault != 0) {
        printf("core: fault 0x%x in the bench's own run\n", output.fault);
        exit(1);
    }
}

/* Periods at random states, each from the same state of the core but for where the arm is; a jump in
 * position is then no speed. */
static void jump_about(uint32_t terms, unsigned long count)
{
    prepare(terms, 1);
    for (unsigned long k = 0; k < count; k++) {
        memset(core.vel, 0, sizeof core.vel);
        for (uint32_t j = 0; j < tables.joints; j++)
            core.count[j] = input[k % INPUTS].count[j].raw;
        period(k);
        hdt_clear(&core);
    }
}

int main(int argc, char **argv)
{
    if (argc == 4 && strcmp(argv[1], "--states") == 0) {
        char *end;
        const unsigned long count = strtoul(argv[3], &end, 10);
        const int set = *argv[2] - '0';
        if (*end == 0 && *argv[3] != 0 && argv[2][1] == 0 && set >= 0 && set < 3) {
            jump_about(sets[set].terms, count);
            return 0;
        }
    }
    if (argc != 1) {
        fprintf(stderr, "usage: bench_core [--states SET N], SET 0 to 2\n");
        return 2;
    }
    for (int k = 0; k < 3; k++)
        time_it(sets[k].name, sets[k].terms);
    printf("core: state %zu bytes, tables %zu a joint (%zu for %u), input %zu, output %zu\n", sizeof core,
           sizeof tables.joint[0], hdt_tables_size(tables.joints), tables.joints, sizeof input[0],
           sizeof output);
    return 0;
}
