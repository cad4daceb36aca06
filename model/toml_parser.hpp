// SPDX-License-Identifier: Apache-2.0
//
// toml++ as this program uses it.  Include this, never toml++ itself: toml++ 3.3 answers some bad
// files (a table header "[,") with a failed assert; here that is an exception, and all users must
// agree on it because the parser is inline code.
//
// Owns: the setting of toml++.
// Never: reads a file.
#pragma once

#include <stdexcept>

namespace hdt {

struct TomlAssert : std::logic_error {
    using std::logic_error::logic_error;
};

[[noreturn]] inline void toml_assert_failed()
{
    throw TomlAssert("unexpected character");
}

} // namespace hdt

#define TOML_ASSERT(expr) \
    (static_cast<bool>(expr) ? static_cast<void>(0) : ::hdt::toml_assert_failed())

#include <toml++/toml.h>
