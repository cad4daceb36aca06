/* SPDX-License-Identifier: Apache-2.0 */
/* cross_core.c under a system with files. */
#include <stdio.h>

#include "tests/cross/cross.h"

void cross_put(const char *text)
{
    fputs(text, stdout);
}

int main(void)
{
    return cross_main();
}
