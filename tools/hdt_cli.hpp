// SPDX-License-Identifier: Apache-2.0
//
// What every subcommand of `hdt` shares: how it registers, how it fails, how it shows progress.
//
// Owns: exit codes (0 ok, 1 the answer is no, 2 usage, 3 bad input), the stop flag of Ctrl-C.
// Never: computes anything.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "model/arm_file.hpp"
#include "tools/usage_error.hpp"

namespace hdt::cli {

enum Exit { Ok = 0, No = 1, Usage = 2, BadInput = 3 };

// Each adds its subcommand; the chosen one leaves its exit code in `code`.
void add_sim(CLI::App &app, int &code);
void add_servo(CLI::App &app, int &code);
void add_host(CLI::App &app, int &code);
void add_bus(CLI::App &app, int &code);
void add_ident(CLI::App &app, int &code);
void add_diagnose(CLI::App &app, int &code);
void add_gen(CLI::App &app, int &code);
void add_replay(CLI::App &app, int &code);
void add_log(CLI::App &app, int &code);
void add_compare(CLI::App &app, int &code);
void add_paper(CLI::App &app, int &code);
void add_velocity(CLI::App &app, int &code);
void add_export(CLI::App &app, int &code);
void add_top(CLI::App &app, int &code);

// SIGINT and SIGTERM end the program at once, exit code 128 and the signal's number, unless the subcommand
// has said that it asks for them: then its loops end in good order once stopped() is true.
void end_in_good_order();
bool stopped();

// One line that rewrites itself on a terminal; silent in a pipe.
class Progress {
public:
    explicit Progress(std::string what);
    ~Progress();
    void at(double share);

private:
    std::string what_;
    int last_ = -1;
    bool tty_;
};

// For CLI::Option::check: a finite number from least to most; a whole one from 0 to 2^64 - 1; joints.
CLI::Validator between(double least, double most);
CLI::Validator whole_number();
CLI::Validator joint_list();

// Expands "2,4" to joint numbers, "" to none; throws UsageError.
std::vector<int> parse_joints(const std::string &text);

// True when the two names are of one file, there or not yet; "" is none.
bool same_file(const std::string &a, const std::string &b);

// Makes the directory and its parents; throws InputError when it cannot.
void make_directory(const std::string &path);

} // namespace hdt::cli
