/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Sine, cosine and exponential in integers, by short polynomials.
 *
 * Owns: the coefficients: Chebyshev interpolation on the reduced range, written out in q30.
 * Never: uses a table, a division or a data-dependent loop.
 */
#include "ctrl/hdt_q.h"

/* acc := c + acc * z, acc and c in q30, |acc| < 2^31, 0 <= z < 2^32 in q32: |product| < 2^63 */
static int64_t horner(int64_t acc, int64_t z_q32, int64_t c)
{
    return c + hdt_shr(acc * z_q32, 32);
}

void hdt_sin_cos(hdt_phase_t angle, int32_t *sin_q30, int32_t *cos_q30)
{
    /* nearest quarter turn, and the rest u = -1/2 .. 1/2 of a quarter in q30 */
    const uint32_t shifted = angle.raw + ((uint32_t)1 << 29);
    const uint32_t quarter = shifted >> 30;
    const int64_t u = (int64_t)(shifted & 0x3fffffffu) - ((int64_t)1 << 29);
    const int64_t z = (u * u) >> 28; /* q60 -> q32, <= 2^30 */

    /* sin(pi/2 u) = u S(u^2), error 2.4e-9; cos(pi/2 u) = 1 + u^2 C(u^2), error 2e-10 */
    int64_t s = horner(-4941520, z, 85555982);
    s = horner(s, z, -693598003);
    s = horner(s, z, 1686629708);
    int64_t c = horner(973605, z, -22399895);
    c = horner(c, z, 272375455);
    c = horner(c, z, -1324675878);
    s = hdt_shr(s * u, 30);
    c = horner(c, z, (int64_t)1 << 30);

    /* turn by the quarters left out */
    if (quarter & 1u) {
        const int64_t t = s;
        s = c;
        c = -t;
    }
    *sin_q30 = (int32_t)(quarter & 2u ? -s : s);
    *cos_q30 = (int32_t)(quarter & 2u ? -c : c);
}

int32_t hdt_exp_neg(uint64_t x_q28)
{
    /* exp(-x) = 2^-(x / ln 2); beyond x = 24 less than half an LSB is left */
    if (x_q28 >= (uint64_t)24 << 28)
        return 0;
    const uint64_t y_q30 = (x_q28 * 1549082005u) >> 28; /* below 2^33 * 2^31 */
    const int64_t f_q32 = (int64_t)(y_q30 & 0x3fffffffu) << 2;

    /* 2^-f on 0 .. 1, exactly 1 at 0 */
    int64_t p = horner(-1077640, f_q32, 10033292);
    p = horner(p, f_q32, -59494488);
    p = horner(p, f_q32, 257928559);
    p = horner(p, f_q32, -744260865);
    p = horner(p, f_q32, (int64_t)1 << 30);
    return (int32_t)((uint64_t)p >> (y_q30 >> 30));
}
