// SPDX-License-Identifier: Apache-2.0
//
// Owns: the error of a wrong command line (exit code 2), beside InputError, a file's (exit code 3).
// Never: knows a command.
#pragma once

#include "model/arm_file.hpp"

namespace hdt {

struct UsageError : InputError {
    using InputError::InputError;
};

} // namespace hdt
