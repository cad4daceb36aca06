/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cross_core.c on a bare Cortex-M: the two vectors it needs, and text and exit by semihosting calls
 * (Arm's numbers 0x04, write a string, and 0x18, exit).
 */
#include "tests/cross/cross.h"

extern uint32_t cross_stack_top[];
void cross_reset(void);

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    cross_stack_top, (const void *)cross_reset, (const void *)cross_reset, (const void *)cross_reset,
};

static int semihost(int call, const void *argument)
{
    register int r0 __asm__("r0") = call;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void cross_put(const char *text)
{
    (void)semihost(0x04, text);
}

/* The image is loaded where it runs, and memory starts as zero: nothing to copy or clear. */
void cross_reset(void)
{
    /* 0x20026: ended as it should; 0x20023: died */
    (void)semihost(0x18, (const void *)(cross_main() == 0 ? 0x20026 : 0x20023));
    for (;;)
        ;
}
