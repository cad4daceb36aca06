/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hdt_init, hdt_step and hdt_clear for Frama-C's Eva: any inputs, any tables hdt_tables_check accepts, any
 * number of periods.  tools/check-proof runs it, docs/proof.md says what it shows.
 *
 * The ranges of the tables' members are read from the check's own lists, so they cannot drift apart.
 * What the check asks beyond ranges is used only where it is written below, and tests/check_tables.c holds
 * the check to it.
 *
 * Never: compiled into anything that runs.
 */
#include "ctrl/hdt_tables.c"
#include "ctrl/hdt_chain.h"
#include "tests/proof_bounds.h"
#include <__fc_builtin.h>

#ifndef JOINTS
#define JOINTS 2
#endif

static struct hdt_tables tables;
static hdt_t core;
static struct hdt_in in;
static struct hdt_out out;

static void any(void *at, unsigned long size)
{
    Frama_C_make_unknown((char *)at, size);
}

static void in_range(void *owner, const struct range *list, size_t count)
{
    /*@ loop unroll 64; */
    for (size_t i = 0; i < count; i++) {
        int32_t *value = (int32_t *)(void *)((char *)owner + list[i].at);
        /*@ loop unroll 512; */
        for (size_t k = 0; k < list[i].count; k++)
            value[k] = Frama_C_interval(list[i].lo, list[i].hi);
    }
}

static int32_t between(int32_t lo, int32_t hi) { return Frama_C_interval(lo, hi); }

static void any_tables(void)
{
    any(&tables, sizeof tables);
    in_range(&tables, head_ranges, COUNT(head_ranges));
    tables.joints = JOINTS;
    /*@ loop unroll 3; */
    for (int i = 0; i < 3; i++)
        tables.biquad_q28[i] = between(0, PROOF_B_MAX_Q28);
    tables.biquad_q28[3] = between(-PROOF_A1_MAX_Q28, PROOF_A1_MAX_Q28);
    tables.biquad_q28[4] = between(-PROOF_A2_MAX_Q28, PROOF_A2_MAX_Q28);
    /*@ loop unroll 16; */
    for (int j = 0; j < JOINTS; j++) {
        struct hdt_joint_tab *t = &tables.joint[j];
        in_range(t, joint_ranges, COUNT(joint_ranges));
        t->sign = between(0, 1) ? 1 : -1;
        /*@ loop unroll 16; */
        for (int k = 0; k < HDT_LINES_MAX; k++)
            in_range(&t->line[k], line_ranges, COUNT(line_ranges));
        in_range(&t->local[0], curve_ranges, COUNT(curve_ranges));
        in_range(&t->local[1], curve_ranges, COUNT(curve_ranges));
        in_range(&t->table, curve_ranges, COUNT(curve_ranges));
    }
}

/* The chain has a proof of its own (proof_chain.c); here it gives back what hdt_chain.h says: gravity below
 * 2^30, inertia clamped. */
void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    (void)m;
    for (uint32_t j = 0; j < t->joints; j++)
        tau_q16[j] = between(1 - (1 << 30), (1 << 30) - 1);
}

void hdt_chain_inertia(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    (void)m;
    for (uint32_t j = 0; j < t->joints; j++)
        tau_q16[j] = between(-INT32_MAX, INT32_MAX);
}

/* What hdt_init leaves behind after the check, which is proved by proof_tables.c. */
static void any_start(void)
{
    core.tables = &tables;
    /*@ loop unroll 16; */
    for (int j = 0; j < JOINTS; j++) {
        core.terms |= tables.joint[j].terms;
        core.count[j] = tables.joint[j].zero_cnt;
        core.cold_q30[j] = 1 << 30;
    }
}

int main(void)
{
    any_tables();
    any_start();
    for (;;) {
        any(&in, sizeof in);
        const int stepped = hdt_step(&core, &in, &out);
        Frama_C_show_each_step(stepped); /* tools/check-proof looks for it */
        if (Frama_C_interval(0, 1))
            (void)hdt_clear(&core);
    }
    return 0;
}
