/* SPDX-License-Identifier: Apache-2.0 */
/*
 * As much of LinuxCNC's HAL as driver/linuxcnc/hdt.c asks for, so that its periods run in a test one by
 * one, in time the test makes.  LinuxCNC's own runtime: tools/check-linuxcnc.
 *
 * Owns: pins, found again by their names; the function that was exported.
 * Never: runs a thread.
 */
#ifndef HAL_H
#define HAL_H

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef volatile double hal_float_t;
typedef volatile bool hal_bit_t;
typedef volatile uint32_t hal_u32_t;
typedef enum { HAL_IN, HAL_OUT } hal_pin_dir_t;

#define HAL_PINS 400
static struct hal {
    unsigned pins;
    struct { char name[48]; volatile void *at; } pin[HAL_PINS];
    double value[HAL_PINS];
    void (*function)(void *arg, long period_ns);
    void *arg;
} hal;

static inline int hal_pin(volatile void **at, const char *form, va_list list)
{
    if (hal.pins == HAL_PINS)
        return -1;
    vsnprintf(hal.pin[hal.pins].name, sizeof hal.pin[0].name, form, list);
    *at = hal.pin[hal.pins].at = &hal.value[hal.pins];
    hal.pins++;
    return 0;
}

#define HAL_PIN_NEWF(kind)                                                                          \
    static inline int hal_pin_##kind##_newf(hal_pin_dir_t dir, hal_##kind##_t **pin, int id,        \
                                            const char *form, ...)                                  \
    {                                                                                               \
        volatile void *at = NULL;                                                                   \
        va_list list;                                                                               \
        va_start(list, form);                                                                       \
        int e = hal_pin(&at, form, list);                                                           \
        va_end(list);                                                                               \
        *pin = at;                                                                                  \
        return (void)dir, (void)id, e;                                                              \
    }
HAL_PIN_NEWF(float)
HAL_PIN_NEWF(bit)
HAL_PIN_NEWF(u32)

/* The pin of this name; a test that asks for one there is none of ends. */
static inline volatile void *hal_find(const char *name)
{
    for (unsigned n = 0; n < hal.pins; n++)
        if (strcmp(hal.pin[n].name, name) == 0)
            return hal.pin[n].at;
    fprintf(stderr, "no pin %s\n", name);
    abort();
}

static inline int hal_export_funct(const char *name, void (*function)(void *, long), void *arg, int uses_fp,
                                   int reentrant, int id)
{
    hal.function = function;
    hal.arg = arg;
    return (void)name, (void)uses_fp, (void)reentrant, (void)id, 0;
}

static inline int hal_init(const char *name) { return (void)name, 1; }
static inline int hal_ready(int id) { return (void)id, 0; }
static inline int hal_exit(int id) { return (void)id, 0; }
static inline void *hal_malloc(long bytes) { return malloc((size_t)bytes); }

#endif
