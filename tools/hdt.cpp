// SPDX-License-Identifier: Apache-2.0
//
// `hdt`: one command, a subcommand per job.
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <unistd.h>

#include "ctrl/hdt.h"
#include "model/arm_document.hpp"
#include "model/text.hpp"
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
            throw UsageError("--joints: expected numbers 1 to 16 with commas, as in 2,4; found \"" + text +
                             "\"");
        joints.push_back(joint);
        if (end == std::string::npos)
            break;
        at = end + 1;
    }
    return joints;
}

CLI::Validator between(double least, double most)
{
    std::string range;
    append_number(range, least);
    range += " to ";
    append_number(range, most);
    return CLI::Validator(
        [=](std::string &text) {
            double value = 0;
            const bool good = parse_number(text, value) && value >= least && value <= most;
            return good ? std::string() : "expected a number from " + range + ", found " + shown(text);
        },
        range);
}

CLI::Validator whole_number()
{
    return CLI::Validator(
        [](std::string &text) {
            errno = 0;
            const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
            (void)std::strtoull(text.c_str(), nullptr, 10);
            return digits && errno == 0 ? std::string()
                                        : "expected a whole number from 0 to 18446744073709551615, found " +
                                              shown(text);
        },
        "");
}

CLI::Validator joint_list()
{
    return CLI::Validator(
        [](std::string &text) {
            try {
                if (!parse_joints(text).empty())
                    return std::string();
            } catch (const UsageError &) {
                // said below
            }
            return "expected numbers 1 to 16 with commas, as in 2,4; found " + shown(text);
        },
        "");
}

bool same_file(const std::string &a, const std::string &b)
{
    namespace fs = std::filesystem;
    std::error_code no;
    if (a.empty() || b.empty())
        return false;
    return fs::equivalent(a, b, no) ||
           fs::weakly_canonical(fs::absolute(a), no) == fs::weakly_canonical(fs::absolute(b), no);
}

void make_directory(const std::string &path)
{
    std::error_code error;
    std::filesystem::create_directories(path, error);
    if (error || !std::filesystem::is_directory(path))
        throw InputError(path + ": cannot make this directory: " +
                         (error ? error.message() : std::string("a file is in the way")));
}

namespace {

// The command the line has come to: hdt itself, or the innermost subcommand.
const CLI::App *command_of(const CLI::App *app)
{
    for (auto inner = app->get_subcommands(); !inner.empty(); inner = app->get_subcommands())
        app = inner.front();
    return app;
}

// What is no word of this command: misspelt options before what may be their values.  "" for none.
std::string unknown_word(const CLI::App *app)
{
    const std::vector<std::string> words = app->remaining(true);
    for (const std::string &word : words)
        if (word.size() > 1 && word[0] == '-')
            return word.substr(0, word.find('='));
    return words.empty() ? "" : words.front();
}

std::vector<std::string> words_of(const CLI::App *command, bool options)
{
    std::vector<std::string> names;
    if (options)
        for (const CLI::Option *option : command->get_options())
            for (const std::string &name : option->get_lnames())
                names.push_back("--" + name);
    else
        for (const CLI::App *sub : command->get_subcommands([](const CLI::App *) { return true; }))
            names.push_back(sub->get_name());
    return names;
}

// A misspelt word is at fault also where CLI11 first misses what the word should have given.
std::string failure_message(const CLI::App *app, const CLI::Error &error)
{
    const CLI::App *command = command_of(app);
    const std::string word = unknown_word(app);
    const std::string name = command == app ? "hdt" : "hdt " + command->get_name();
    const std::string help = "\nRun " + name + " --help for more information.\n";
    const bool spelling = dynamic_cast<const CLI::RequiredError *>(&error) != nullptr ||
                          dynamic_cast<const CLI::ExtrasError *>(&error) != nullptr;
    if (!spelling || word.empty())
        return name + ": " + error.what() + help;
    const bool option = word[0] == '-';
    const std::vector<std::string> known = words_of(command, option);
    const std::string near = arm::nearest_of(word.substr(0, 64), known);
    const char *what = option          ? "no such option of "
                       : known.empty() ? "not expected by "
                                       : "no such command of ";
    return "\"" + printable(word) + "\": " + what + name +
           (near.empty() ? "" : "; did you mean " + near + "?") + help;
}

} // namespace

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
    app.failure_message(failure_message);
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
    } catch (const hdt::UsageError &e) {
        std::fprintf(stderr, "hdt: %s\n", e.what());
        return Usage;
    } catch (const std::exception &e) {
        std::fprintf(stderr, "hdt: %s\n", e.what());
        return BadInput;
    }
    // a full disk or a closed pipe behind our words is no success
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
        std::fprintf(stderr, "hdt: standard output cannot be written: %s\n", std::strerror(errno));
        return BadInput;
    }
    return code;
}
