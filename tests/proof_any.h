/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Any tables the loader accepts, for the harnesses of Frama-C's Eva (proof_core.c, proof_chain.c).
 *
 * The ranges of the tables' members are read from the check's own lists, so they cannot drift apart.  The
 * low-pass and the sums of chain_moves are left out: what is shown without them holds with them.
 *
 * Never: compiled into anything that runs.
 */
#ifndef PROOF_ANY_H
#define PROOF_ANY_H

#include "ctrl/hdt_tables.c"
#include <__fc_builtin.h>

#ifndef JOINTS
#define JOINTS 2
#endif

static struct hdt_tables tables;

static void any(void *at, unsigned long size)
{
    Frama_C_make_unknown((char *)at, size);
}

static int32_t between(int32_t lo, int32_t hi) { return Frama_C_interval(lo, hi); }

static void in_range(void *owner, const struct range *list, size_t count)
{
    /*@ loop unroll 64; */
    for (size_t i = 0; i < count; i++) {
        int32_t *value = (int32_t *)(void *)((char *)owner + list[i].at);
        /*@ loop unroll 512; */
        for (size_t k = 0; k < list[i].count; k++)
            value[k] = between(list[i].lo, list[i].hi);
    }
}

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

#endif
