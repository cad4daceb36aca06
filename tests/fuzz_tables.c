/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Any bytes as a table image, and what the core does with those it accepts (libFuzzer).
 *
 * Goal: no bytes make the loader read past them, and no table it accepts makes the step run into undefined
 * behaviour or a digit beyond its limit.  Method: half the inputs are mended (length, CRC) so that they
 * come past the first checks; accepted ones are written back, and run on inputs made of the same bytes.
 */
#include <stdlib.h>
#include <string.h>

#include "ctrl/hdt.h"

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max, unsigned seed);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint32_t crc32(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

static void put32(uint8_t *to, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        to[i] = (uint8_t)(value >> (8 * i));
}

/* Bytes changed as libFuzzer likes; then, mostly, what stands before the values is put right again. */
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max, unsigned seed)
{
    size = LLVMFuzzerMutate(data, size, max);
    if (seed % 4 == 0)
        return size;
    const uint32_t joints = 1 + seed / 4 % 3;
    const size_t want = hdt_tables_size(joints);
    if (want > max)
        return size;
    if (size < want)
        memset(data + size, 0, want - size);
    put32(data, HDT_TABLES_MAGIC);
    put32(data + 4, HDT_TABLES_LAYOUT);
    put32(data + 72, joints);
    put32(data + want - 4, crc32(data, want - 4));
    return want;
}

/* Inputs from the bytes, again and again. */
static void drive(const struct hdt_tables *t, const uint8_t *data, size_t size)
{
    static hdt_t core;
    static struct hdt_in in;
    static struct hdt_out out;
    size_t at = 0;
    if (hdt_init(&core, t) != HDT_OK)
        abort(); /* accepted by the reader, refused by the core */
    for (int k = 0; k < 16; k++) {
        for (size_t i = 0; i < sizeof in; i++)
            ((uint8_t *)&in)[i] = data[at++ % size];
        if (k % 3 != 0) {
            in.mode %= 3;
            in.t_us = core.t_us + 1 + in.t_us % 2000000;
            in.servo_alarm = 0;
        }
        const int e = hdt_step(&core, &in, &out);
        for (uint32_t j = 0; j < HDT_JOINTS_MAX; j++) {
            const int32_t limit = j < t->joints ? t->joint[j].dig_max : 0;
            if (out.digit[j].raw > limit || out.digit[j].raw < -limit
                || (e != HDT_OK && out.digit[j].raw != 0))
                abort();
        }
        if (k % 5 == 4)
            (void)hdt_clear(&core);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct hdt_tables t;
    /* exact size on the heap: a byte read past the end is seen */
    uint8_t *image = malloc(size ? size : 1);
    memcpy(image, data, size);
    if (hdt_tables_read(image, size, &t) == HDT_TABLES_OK) {
        uint8_t *again = malloc(size);
        if (hdt_tables_write(&t, again, size) != size || memcmp(again, image, size) != 0)
            abort();
        free(again);
        drive(&t, data, size);
    }
    free(image);
    return 0;
}
