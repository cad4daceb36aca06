// SPDX-License-Identifier: Apache-2.0
//
// Where a test writes: a directory of its own, under the system's for temporary files.
//
// Owns: that directory, which goes when the test program ends, also after a test that failed or was
// killed; how a test reads a file back.
// Never: what a test must leave behind or not; tests look themselves.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include <unistd.h>

class Scratch {
public:
    Scratch() : path_(std::filesystem::temp_directory_path() / "hdt-test-XXXXXX"), owner_(getpid())
    {
        if (!mkdtemp(path_.data())) {
            std::perror(path_.c_str());
            std::abort();
        }
    }
    ~Scratch()
    {
        std::error_code ignored;
        if (getpid() == owner_) // tests are forks of it
            std::filesystem::remove_all(path_, ignored);
    }
    Scratch(const Scratch &) = delete;
    Scratch &operator=(const Scratch &) = delete;

    std::string of_this_process() const
    {
        const std::string dir = path_ + "/" + std::to_string(getpid());
        std::filesystem::create_directory(dir);
        return dir;
    }

private:
    std::string path_;
    pid_t owner_;
};

inline const Scratch the_scratch;

// The running test's directory, empty when first asked for.
inline std::string scratch_dir() { return the_scratch.of_this_process(); }

// A path in it.
inline std::string scratch(const std::string &name) { return scratch_dir() + "/" + name; }

// A file's bytes; a test that asks for a file that is not there ends.
inline std::string slurp(const std::string &path)
{
    std::ifstream in(path, std::ios::binary);
    if (!in) {
        std::perror(path.c_str());
        std::abort();
    }
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}
