// SPDX-License-Identifier: Apache-2.0
//
// Commands as a user types them, in the running test's own directory.
//
// Owns: where the build is, what a shell line is given ($H is hdt, $A the PA-10's file, $P the probe of
// tests/rt_probe.c, $SHIM before a command loads tests/rt_shim.c), what comes back of it.
// Never: judges what came back.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

#include <sys/wait.h>

#include "tests/scratch.hpp"

// As make was told, from the repository's root, where tests run.
inline std::string build_dir()
{
    const char *build = std::getenv("BUILD");
    return build ? build : "build";
}

struct Result { int code; std::string out, err; };

// The line's exit code, 128 when a signal ended it, and what it wrote.
inline Result sh(const std::string &line)
{
    const std::string root = std::filesystem::current_path(), bin = root + "/" + build_dir();
    const std::string dir = scratch_dir();
    const std::string given = "H=" + bin + "/hdt; A=" + root + "/model/arms/pa10.toml; " +
                              "P=" + bin + "/tests/rt_probe; " +
                              "SHIM='env LD_PRELOAD=" + bin + "/tests/rt_shim.so'; ";
    const int status = std::system(("cd " + dir + "; " + given + "(" + line + ") >out 2>err").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128, slurp(dir + "/out"), slurp(dir + "/err")};
}

// The same with both streams in `out`, in the order they were written.
inline Result sh_together(const std::string &line)
{
    return sh("exec 2>&1; " + line);
}
