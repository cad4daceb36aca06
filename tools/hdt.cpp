// SPDX-License-Identifier: Apache-2.0
//
// `hdt`: one command, a subcommand per job.
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <unistd.h>

#include "ctrl/hdt.h"
#include "tools/hdt_cli.hpp"

namespace hdt::cli {

namespace {
volatile std::sig_atomic_t stop_requested = 0, in_good_order = 0, on_terminal = 0;

// Who has nothing to give before the end ends at once; _exit as threads may be at work.
void on_signal(int signal)
{
    static const char words[] = "\r\033[Khdt: interrupted\n"; // over a line of progress
    const std::size_t begin = on_terminal ? 0 : 4;
    stop_requested = 1;
    if (in_good_order)
        return;
    (void)!write(STDERR_FILENO, words + begin, sizeof words - 1 - begin);
    _exit(128 + signal);
}

void catch_signals()
{
    struct sigaction action = {};
    action.sa_handler = on_signal;
    on_terminal = isatty(STDERR_FILENO);
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
}
} // namespace

bool stopped()
{
    return stop_requested != 0;
}

void end_in_good_order()
{
    in_good_order = 1;
}

Progress::Progress(std::string what) : what_(std::move(what)), tty_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress()
{
    if (tty_ && last_ >= 0)
        std::fprintf(stderr, "\r\033[K");
}

void Progress::at(double share)
{
    int percent = static_cast<int>(share * 100.0);
    if (!tty_ || percent == last_)
        return;
    last_ = percent;
    std::fprintf(stderr, "\r%s %3d %%", what_.c_str(), percent);
}

std::vector<int> parse_joints(const std::string &text)
{
    std::vector<int> joints;
    std::size_t at = 0;
    while (at < text.size()) {
        std::size_t end = text.find(',', at);
        std::string part = text.substr(at, end == std::string::npos ? end : end - at);
        std::size_t used = 0;
        int joint = 0;
        try {
            joint = std::stoi(part, &used);
        } catch (const std::exception &) {
            used = 0;
        }
        if (part.empty() || used != part.size() || joint < 1 || joint > HDT_JOINTS_MAX)
            throw InputError("--joints: expected numbers 1 to 16 with commas, as in 2,4; found \"" + text +
                             "\"");
        joints.push_back(joint);
        if (end == std::string::npos)
            break;
        at = end + 1;
    }
    return joints;
}

bool same_file(const std::string &a, const std::string &b)
{
    namespace fs = std::filesystem;
    std::error_code no;
    if (a.empty() || b.empty())
        return false;
    return fs::equivalent(a, b, no) || fs::weakly_canonical(a, no) == fs::weakly_canonical(b, no);
}

void make_directory(const std::string &path)
{
    std::error_code error;
    std::filesystem::create_directories(path, error);
    if (error || !std::filesystem::is_directory(path))
        throw InputError(path + ": cannot make this directory: " +
                         (error ? error.message() : std::string("a file is in the way")));
}

} // namespace hdt::cli

int main(int argc, char **argv)
{
    using namespace hdt::cli;
    int code = Ok;
    CLI::App app{"hdt: control, rig and diagnosis for harmonic-drive arms\n"
                 "exit codes: 0 ok, 1 the answer is no, 2 usage, 3 bad input"};
    app.name("hdt");
    app.set_version_flag("--version", std::to_string(HDT_VERSION_MAJOR) + "." +
                                          std::to_string(HDT_VERSION_MINOR) + "." +
                                          std::to_string(HDT_VERSION_PATCH));
    app.require_subcommand(1);
    add_sim(app, code);
    add_servo(app, code);
    add_host(app, code);
    add_bus(app, code);
    add_ident(app, code);
    add_diagnose(app, code);
    add_gen(app, code);
    add_replay(app, code);
    add_log(app, code);
    add_compare(app, code);
    add_paper(app, code);
    add_velocity(app, code);
    add_export(app, code);
    add_top(app, code);
    catch_signals();
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError &e) {
        return app.exit(e) == 0 ? Ok : Usage;
    } catch (const UsageError &e) {
        std::fprintf(stderr, "hdt: %s\n", e.what());
        return Usage;
    } catch (const std::exception &e) {
        std::fprintf(stderr, "hdt: %s\n", e.what());
        return BadInput;
    }
    return code;
}
