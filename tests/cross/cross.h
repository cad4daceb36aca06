/* SPDX-License-Identifier: Apache-2.0 */
/* What the run of cross_core.c and the machines it runs on agree on. */
#ifndef CROSS_H
#define CROSS_H

#include <stddef.h>
#include <stdint.h>

struct cross_image {
    const char *name;
    size_t size;
    const uint8_t *bytes;
};
/* Written by cross_gen. */
extern const struct cross_image cross_image[];
extern const unsigned cross_images;

/* Text out; the machine's. */
void cross_put(const char *text);
/* Returns 0 when the run came to its end. */
int cross_main(void);

#endif
