// SPDX-License-Identifier: Apache-2.0
//
// `hdt log`: check, cut and convert logs.
#include <cstdio>
#include <memory>

#include "model/log.hpp"
#include "model/log_check.hpp"
#include "tools/hdt_cli.hpp"

namespace hdt::cli {

namespace {

struct LogOptions {
    std::string in, out, map, arm;
    std::vector<std::string> logs;
    double from_s = 0, to_s = 1e9;
};

void say(const Run &run)
{
    double span_s = run.rows() > 1 ? run.t_s.back() - run.t_s.front() : 0;
    std::printf("%s: %zu rows, %.3f s, mean rate %.1f Hz, joints", run.path.c_str(), run.rows(), span_s,
                span_s > 0 ? static_cast<double>(run.rows() - 1) / span_s : 0.0);
    for (std::size_t j = 0; j < run.joint.size(); j++)
        if (run.joint[j].present)
            std::printf(" %zu", j + 1);
    std::printf("\n");
}

// What is in each log and, against an arm, whether its columns can be what they are called.
int check_files(const LogOptions &o)
{
    std::vector<Run> runs;
    for (const std::string &path : o.logs) {
        runs.push_back(read_run(path));
        say(runs.back());
    }
    if (o.arm.empty())
        return Ok;
    const ArmFile arm = ArmFile::load(o.arm);
    int code = Ok;
    for (const LogFinding &f : check_logs(arm.arm(), runs)) {
        std::printf("%s\n", f.words.c_str());
        code = f.refuse ? No : code;
    }
    return code;
}

} // namespace

void add_log(CLI::App &app, int &code)
{
    auto o = std::make_shared<LogOptions>();
    CLI::App *sub = app.add_subcommand("log", "check, cut or convert logs");
    sub->require_subcommand(1);

    CLI::App *check =
        sub->add_subcommand("check", "read logs and say what is in them; exit code 1: it cannot be");
    check->add_option("logs", o->logs)->required();
    check->add_option("--arm", o->arm, "model file: look for wrong units, signs, sides, exchanged columns");
    check->callback([o, &code] { code = check_files(*o); });

    CLI::App *cut = sub->add_subcommand("cut", "a part of a log, as a log");
    cut->add_option("log", o->in)->required();
    cut->add_option("out", o->out)->required();
    cut->add_option("--from", o->from_s, "first second kept, from the log's beginning");
    cut->add_option("--to", o->to_s, "first second not kept");
    cut->callback([o, &code] {
        Run run = read_run(o->in);
        Run part = cut_run(run, run.t_s.front() + o->from_s, run.t_s.front() + o->to_s);
        write_run(o->out, part);
        code = Ok;
    });

    CLI::App *convert = sub->add_subcommand("convert", "bring a foreign table in by a map");
    convert->add_option("foreign", o->in)->required();
    convert->add_option("out", o->out)->required();
    convert->add_option("--map", o->map, "what is where: docs/formats.md, \"Import map\"")->required();
    convert->callback([o, &code] {
        Run run = convert_run(o->map, o->in);
        write_run(o->out, run);
        say(run);
        code = Ok;
    });
}

} // namespace hdt::cli
