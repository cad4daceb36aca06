/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What every check_*.c shares: a main, a seeded generator, a loud skip.
 *
 * A test program prints Check's summary line, and one line "SKIP: <test>: <reason>" for each test
 * it could not run; tools/run-tests adds both up.
 */
#ifndef CHECK_MAIN_H
#define CHECK_MAIN_H

#include <check.h>
#undef fail /* an old word of Check's, and one of the C++ streams */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define HDT_SKIP(reason) do { printf("SKIP: %s: %s\n", __func__, reason); fflush(stdout); return; } while (0)

/* SplitMix64: small, seedable, the same everywhere. */
static inline uint64_t test_random(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}
/* Uniform in [lo, hi). */
static inline double test_uniform(uint64_t *state, double lo, double hi)
{
    return lo + (hi - lo) * (double)(test_random(state) >> 11) * 0x1p-53;
}

/* Define main running one suite. */
#define HDT_CHECK_MAIN(suite)                                          \
    int main(void)                                                     \
    {                                                                  \
        SRunner *runner = srunner_create(suite);                       \
        srunner_run_all(runner, CK_ENV);                               \
        int failed = srunner_ntests_failed(runner);                    \
        srunner_free(runner);                                          \
        return failed == 0 ? EXIT_SUCCESS : EXIT_FAILURE;              \
    }

#endif
