/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What one control period costs: 7 joints, the terms of the paper (gravity, two-sided friction,
 * ripple, soft wind-up, P, D), then every term; and how big the core's data are.
 *
 *   bench_core             time of a period, median and 99th percentile, and sizes
 *   bench_core --count N   just N periods, for an instruction counter:
 *                          (count of 2000 - count of 1000) / 1000 is instructions a period
 *
 * Owns: the printed figures.  Never: is a test; time on a shared machine varies.
 */
#include <stdio.h>
#include <time.h>

#include "ctrl/hdt.h"
#include "tests/core_reference.h"

#define JOINTS 7
#define INPUTS 4096
#define BATCH 8
#define BATCHES 20000

static struct hdt_tables arm;
static struct hdt_in input[INPUTS];
static struct hdt_out output;
static hdt_t core;

static const uint32_t paper_terms = 1u << HDT_TERM_GRAVITY | 1u << HDT_TERM_INERTIA | 1u << HDT_TERM_FRICTION | 1u << HDT_TERM_RIPPLE |
                                    1u << HDT_TERM_STIFFNESS | 1u << HDT_TERM_P | 1u << HDT_TERM_D;

/* An arm of 7 joints with these terms, and slow sines for it to follow. */
static void prepare(uint32_t terms)
{
    uint64_t r = 1;
    ref_random_arm(&r, JOINTS, &arm);
    for (int j = 0; j < JOINTS; j++)
        arm.joint[j].terms = terms;
    if (hdt_init(&core, &arm) != HDT_OK)
        exit(1);
    for (int k = 0; k < INPUTS; k++) {
        struct hdt_in *in = &input[k];
        in->mode = HDT_MODE_TORQUE;
        in->active = in->fresh = (1u << JOINTS) - 1;
        for (int j = 0; j < JOINTS; j++) {
            const double x = 2 * REF_PI * k / INPUTS + j;
            in->q_ref[j].raw = Q(sin(x), 24);
            in->v_ref[j].raw = Q(cos(x), 24);
            in->a_ref[j].raw = Q(-sin(x), 16);
            in->count[j].raw = arm.joint[j].zero_cnt +
                               (int32_t)lrint(arm.joint[j].sign * sin(x) / D(arm.joint[j].rad_per_count_q44, 44));
        }
    }
}

static void periods(unsigned long from, unsigned long count)
{
    for (unsigned long k = from; k < from + count; k++) {
        struct hdt_in *in = &input[k % INPUTS];
        in->t_us = 1 + k * 1429;
        hdt_step(&core, in, &output);
    }
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void time_it(const char *what, uint32_t terms)
{
    static double ns[BATCHES];
    prepare(terms);
    for (unsigned long k = 0; k < BATCHES; k++) {
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        periods(k * BATCH, BATCH);
        clock_gettime(CLOCK_MONOTONIC, &b);
        ns[k] = ((double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec)) / BATCH;
    }
    qsort(ns, BATCHES, sizeof ns[0], by_value);
    printf("core: %d joints, %s: %.0f ns a period (median), %.0f ns (99 %%)\n", JOINTS, what,
           ns[BATCHES / 2], ns[BATCHES * 99 / 100]);
    if (output.fault != 0) {
        printf("core: fault 0x%x in the bench's own run\n", output.fault);
        exit(1);
    }
}

int main(int argc, char **argv)
{
    if (argc == 3 && strcmp(argv[1], "--count") == 0) {
        char *end;
        const unsigned long count = strtoul(argv[2], &end, 10);
        if (*end == 0 && *argv[2] != 0) {
            prepare(paper_terms);
            periods(0, count);
            return 0;
        }
    }
    if (argc != 1) {
        fprintf(stderr, "usage: bench_core [--count N]\n");
        return 2;
    }
    time_it("terms of the paper", paper_terms);
    time_it("every term", (1u << HDT_TERMS) - 1);
    printf("core: state %zu bytes, tables %zu a joint (%zu for %d), input %zu, output %zu\n", sizeof core,
           sizeof arm.joint[0], hdt_tables_size(JOINTS), JOINTS, sizeof input[0], sizeof output);
    return 0;
}
