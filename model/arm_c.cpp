// SPDX-License-Identifier: Apache-2.0
//
// The model file for C callers: numbers out, errors as one line of text.
//
// Owns: the border between exceptions and return codes.
// Never: lets an exception out.
#include "model/hdt_arm.h"

#include <cstdio>
#include <cstring>
#include <exception>

#include "model/arm_file.hpp"

int hdt_arm_load(const char *path, struct hdt_arm *arm, char *err, size_t errlen)
{
    try {
        *arm = hdt::ArmFile::load(path).arm();
        return 0;
    } catch (const std::exception &error) {
        std::memset(arm, 0, sizeof *arm);
        if (err && errlen > 0)
            std::snprintf(err, errlen, "%s", error.what());
        return -1;
    }
}
