/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The chain's terms for Frama-C's Eva: any motion, any tables hdt_tables_check accepts.
 * tools/check-proof runs it, docs/proof.md says what it shows.
 *
 * The ranges of the tables' members are read from the check's own lists, so they cannot drift apart.
 * What the check asks beyond ranges is used only where it is written below, and tests/check_tables.c holds
 * the check to it.
 *
 * Never: compiled into anything that runs.
 */
#include "ctrl/hdt_tables.c"
#include "ctrl/hdt_chain.h"
#include <__fc_builtin.h>

#ifndef JOINTS
#define JOINTS 2
#endif

static struct hdt_tables tables;
static struct hdt_motion motion[HDT_JOINTS_MAX];
static int32_t tau[HDT_JOINTS_MAX];

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

int main(void)
{
    any_tables();
    for (int j = 0; j < JOINTS; j++) {
        const struct hdt_joint_tab *t = &tables.joint[j];
        motion[j].sin_q30 = between(-(1 << 30), 1 << 30);
        motion[j].cos_q30 = between(-(1 << 30), 1 << 30);
        motion[j].v_ref_q24 = between(-t->v_lim_q24, t->v_lim_q24);
        motion[j].a_ref_q16 = between(-t->a_lim_q16, t->a_lim_q16);
    }
    hdt_chain_gravity(&tables, motion, tau);
    hdt_chain_inertia(&tables, motion, tau);
    Frama_C_show_each_end(0); /* tools/check-proof looks for it */
    return 0;
}
