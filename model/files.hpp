// SPDX-License-Identifier: Apache-2.0
//
// Files that are either whole or not there.
//
// Owns: writing under a temporary name in the same directory, then renaming.
// Never: knows what it writes.
#pragma once

#include <string>

namespace hdt {

// Throws InputError naming the path and the system's reason; the temporary file is removed then.
void write_file(const std::string &path, const std::string &bytes);

} // namespace hdt
