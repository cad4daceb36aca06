/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hdt_init, hdt_step and hdt_clear for Frama-C's Eva: any inputs, any tables hdt_tables_check accepts, any
 * number of periods.  tools/check-proof runs it, docs/proof.md says what it shows.
 *
 * What the check asks of the low-pass is in tests/proof_bounds.h; tests/check_tables.c holds the check to it.
 *
 * Never: compiled into anything that runs.
 */
#include "tests/proof_any.h"
#include "ctrl/hdt_chain.h"
#include "tests/proof_bounds.h"

static hdt_t core;
static struct hdt_in in;
static struct hdt_out out;

static void any_low_pass(void)
{
    /*@ loop unroll 3; */
    for (int i = 0; i < 3; i++)
        tables.biquad_q28[i] = between(0, PROOF_B_MAX_Q28);
    tables.biquad_q28[3] = between(-PROOF_A1_MAX_Q28, PROOF_A1_MAX_Q28);
    tables.biquad_q28[4] = between(-PROOF_A2_MAX_Q28, PROOF_A2_MAX_Q28);
}

/* The chain has a proof of its own (proof_chain.c), which ends with these bounds. */
void hdt_chain_gravity(const struct hdt_tables *t, const struct hdt_motion m[], int32_t tau_q16[])
{
    (void)m;
    for (uint32_t j = 0; j < t->joints; j++)
        tau_q16[j] = between(-HDT_GRAVITY_MAX_Q16, HDT_GRAVITY_MAX_Q16);
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
    any_low_pass();
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
