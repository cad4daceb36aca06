// SPDX-License-Identifier: Apache-2.0
//
// Files that are either whole or not there.
//
// Owns: writing under a temporary name in the same directory, then renaming.
// Never: knows what it writes.
#pragma once

#include <csignal>
#include <string>

namespace hdt {

// While one lives, SIGINT and SIGTERM wait: what belongs together is written together or not at all.
// Of the calling thread; others must not be running.
class Uninterrupted {
public:
    Uninterrupted();
    ~Uninterrupted();
    Uninterrupted(const Uninterrupted &) = delete;
    Uninterrupted &operator=(const Uninterrupted &) = delete;

private:
    sigset_t before_;
};

// SIGINT and SIGTERM wait until it is done.  Throws InputError naming the path and the system's reason;
// the temporary file is removed then.
void write_file(const std::string &path, const std::string &bytes);

} // namespace hdt
