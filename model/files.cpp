// SPDX-License-Identifier: Apache-2.0
// See files.hpp.
#include "model/files.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <unistd.h>

#include "model/arm_file.hpp"

namespace hdt {

Uninterrupted::Uninterrupted()
{
    sigset_t stop;
    sigemptyset(&stop);
    sigaddset(&stop, SIGINT);
    sigaddset(&stop, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &stop, &before_);
}

Uninterrupted::~Uninterrupted()
{
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

void write_file(const std::string &path, const std::string &bytes)
{
    const Uninterrupted whole;
    std::string part = path + ".part." + std::to_string(getpid());
    std::FILE *file = std::fopen(part.c_str(), "wb");
    bool good = file != nullptr;
    if (good) {
        good = std::fwrite(bytes.data(), 1, bytes.size(), file) == bytes.size();
        good = std::fclose(file) == 0 && good;
        good = good && std::rename(part.c_str(), path.c_str()) == 0;
    }
    if (!good) {
        std::string why = std::strerror(errno);
        std::remove(part.c_str());
        throw InputError(path + ": cannot be written: " + why);
    }
}

} // namespace hdt
