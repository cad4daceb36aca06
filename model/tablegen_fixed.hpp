// SPDX-License-Identifier: Apache-2.0
//
// Numbers to fixed point for the table generator, refused by name where they do not fit.
//
// Owns: the rounding and the words of a refusal.
// Never: clips.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <string>

namespace hdt {

struct Refusal : std::runtime_error {
    using std::runtime_error::runtime_error;
};

inline std::string number_text(double x)
{
    char buffer[40];
    std::snprintf(buffer, sizeof buffer, "%.8g", x);
    return buffer;
}

[[noreturn]] inline void refuse(const std::string &key, const std::string &expected, double found)
{
    throw Refusal(key + ": expected " + expected + " for the tables, found " + number_text(found));
}

// Nearest fixed-point value; the key's limits are part of the format or narrower.
inline int32_t fixed(const std::string &key, double x, int bits, double low = -HUGE_VAL,
                     double high = HUGE_VAL)
{
    const double largest = std::ldexp(2147483647.0, -bits);
    const double from = std::max(low, -largest), to = std::min(high, largest);
    if (!(x >= from && x <= to))
        refuse(key, "a number from " + number_text(from) + " to " + number_text(to), x);
    return static_cast<int32_t>(std::llround(std::ldexp(x, bits)));
}

// Fraction of a turn as an integer of that many bits, modulo one turn.
inline uint64_t turn_part(double turns, int bits)
{
    const double part = turns - std::floor(turns);
    return static_cast<uint64_t>(std::llround(std::ldexp(part, bits)))
           & ((uint64_t(1) << bits) - 1);
}

} // namespace hdt
