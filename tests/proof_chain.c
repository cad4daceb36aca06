/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The chain's terms for Frama-C's Eva: any motion, any tables whose members are in their ranges.
 * tools/check-proof runs it, docs/proof.md says what it shows.
 *
 * Never: compiled into anything that runs.
 */
#include "tests/proof_any.h"
#include "ctrl/hdt_chain.h"

static struct hdt_motion motion[HDT_JOINTS_MAX];
static int32_t tau[HDT_JOINTS_MAX];

int main(void)
{
    any_tables();
    for (int j = 0; j < JOINTS; j++) {
        const struct hdt_joint_tab *t = &tables.joint[j];
        motion[j].sin_q30 = between(-INT32_MAX, INT32_MAX);
        motion[j].cos_q30 = between(-INT32_MAX, INT32_MAX);
        motion[j].v_ref_q24 = between(-t->v_lim_q24, t->v_lim_q24);
        motion[j].a_ref_q16 = between(-t->a_lim_q16, t->a_lim_q16);
    }
    hdt_chain_gravity(&tables, motion, tau);
    /* what proof_core.c takes from here */
    for (int j = 0; j < JOINTS; j++) {
        /*@ assert gravity: -HDT_GRAVITY_MAX_Q16 <= tau[j] <= HDT_GRAVITY_MAX_Q16; */
    }
    hdt_chain_inertia(&tables, motion, tau);
    for (int j = 0; j < JOINTS; j++) {
        /*@ assert inertia: -INT32_MAX <= tau[j] <= INT32_MAX; */
    }
    Frama_C_show_each_end(0); /* tools/check-proof looks for it */
    return 0;
}
