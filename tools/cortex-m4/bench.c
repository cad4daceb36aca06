/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The core on a bare Cortex-M4, under an emulator whose clock counts instructions: how many a period
 * takes.  Also the smallest program around the core: two functions, no library.
 *
 * Owns: start-up, the two memory functions a compiler may ask for, the count by SysTick.
 * Never: is loaded on a real arm.
 */
#include <stdint.h>
#include <stddef.h>

#include "ctrl/hdt.h"

extern const struct hdt_tables hdt_tables_pa10;
extern uint32_t stack_top[];
void reset(void);

__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {
    stack_top, (const void *)reset};

void *memset(void *to, int value, size_t n)
{
    for (size_t i = 0; i < n; i++)
        ((volatile uint8_t *)to)[i] = (uint8_t)value;
    return to;
}

void *memcpy(void *to, const void *from, size_t n)
{
    for (size_t i = 0; i < n; i++)
        ((volatile uint8_t *)to)[i] = ((const uint8_t *)from)[i];
    return to;
}

/* ---- semihosting ---- */

static int host_call(int what, const void *with)
{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void say(const char *text)
{
    host_call(4, text); /* SYS_WRITE0 */
}

static void say_number(uint32_t x)
{
    char digits[12], *at = digits + sizeof digits - 1;
    *at = 0;
    do
        *--at = (char)('0' + x % 10u);
    while ((x /= 10u) != 0);
    say(at);
}

static void leave(int ok)
{
    /* SYS_EXIT: ADP_Stopped_ApplicationExit, or an error */
    host_call(0x18, (const void *)(ok ? 0x20026 : 0x20024));
    for (;;)
        ;
}

/* ---- the run ---- */

#define SYST_CSR (*(volatile uint32_t *)0xe000e010u)
#define SYST_RVR (*(volatile uint32_t *)0xe000e014u)
#define SYST_CVR (*(volatile uint32_t *)0xe000e018u)
#define TICK 40u /* instructions a tick: a 25 MHz timer under a clock of one instruction a ns */
#define PERIODS 500u

static hdt_t core;
static struct hdt_in in;
static struct hdt_out out;

void reset(void)
{
    uint32_t seed = 1, sum = 0;
    if (hdt_init(&core, &hdt_tables_pa10) != HDT_OK) {
        say("tables refused\n");
        leave(0);
    }
    in.mode = HDT_MODE_TORQUE;
    in.active = in.fresh = (1u << hdt_tables_pa10.joints) - 1u;
    SYST_RVR = 0xffffffu;
    SYST_CVR = 0;
    SYST_CSR = 5;
    const uint32_t start = SYST_CVR;
    for (uint32_t k = 0; k < PERIODS; k++) {
        in.t_us += 1429;
        for (uint32_t j = 0; j < hdt_tables_pa10.joints; j++) {
            seed = seed * 1664525u + 1013904223u;
            in.count[j].raw += (int32_t)(seed >> 26) - 32;
            in.q_ref[j].raw = out.q[j].raw;
            in.v_ref[j].raw = (int32_t)(seed >> 9) - (1 << 22);
            in.a_ref[j].raw = (int32_t)(seed >> 14) - (1 << 17);
        }
        if (hdt_step(&core, &in, &out) != HDT_OK || out.fault != 0) {
            say("fault in the bench's own run\n");
            leave(0);
        }
        sum += (uint32_t)out.total[1].raw;
    }
    const uint32_t ticks = (start - SYST_CVR) & 0xffffffu;
    say_number((uint32_t)((uint64_t)ticks * TICK / PERIODS));
    say(" instructions a period\n");
    leave(sum != 0);
}
