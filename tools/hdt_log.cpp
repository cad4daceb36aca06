// SPDX-License-Identifier: Apache-2.0
//
// `hdt log`: check, cut and convert logs.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>

#include "driver/drv_log.h"
#include "model/dataset.hpp"
#include "model/log.hpp"
#include "model/log_check.hpp"
#include "tools/hdt_cli.hpp"

namespace hdt::cli {

namespace {

struct LogOptions {
    std::string in, out, map, arm;
    std::vector<std::string> logs;
    double from_s = 0, to_s = 1e9;
    bool terms = false;
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

// What ident would say of this run before it fits; empty: nothing.
std::string unfit(const hdt_arm &arm, const Run &run)
{
    try {
        condition(run, arm, {});
    } catch (const InputError &e) {
        return e.what();
    }
    return "";
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
    for (const Run &run : runs)
        if (const std::string words = unfit(arm.arm(), run); !words.empty()) {
            std::printf("%s\n", words.c_str());
            code = No;
        }
    return code;
}

// What cut and convert write: never over what they read.
void check_out(const LogOptions &o)
{
    if (o.out.size() < 5 || o.out.substr(o.out.size() - 4) != ".csv")
        throw UsageError(o.out + ": what is written is CSV: expected a name ending in .csv");
    if (same_file(o.in, o.out))
        throw UsageError(o.out + ": is what is read: expected another name to write to");
}

bool is_event_log(const std::string &path)
{
    char mark[4] = {};
    return std::ifstream(path, std::ios::binary).read(mark, sizeof mark) &&
           std::memcmp(mark, "\xed\xa1\xda\x01", sizeof mark) == 0;
}

// As much of the tables as a CSV log takes from them.  Where this program cannot read the log's, every
// term counts as in use.
hdt_tables tables_of_log(const drv_reader *reader)
{
    const drv_run *head = drv_reader_run(reader);
    hdt_tables tables = {};
    if (drv_reader_tables(reader, &tables) != HDT_TABLES_OK || tables.joints != head->joints)
        for (hdt_joint_tab &joint : tables.joint)
            joint.terms = (1u << HDT_TERMS) - 1;
    tables.joints = head->joints;
    tables.period_ns = head->period_ns;
    std::copy(std::begin(head->arm), std::end(head->arm), tables.name);
    std::copy(std::begin(head->digest), std::end(head->digest), tables.digest);
    return tables;
}

// An event log, or the dump of a fault, as the CSV the host would have written.
void convert_events(const LogOptions &o)
{
    char error[512];
    std::unique_ptr<drv_reader, void (*)(drv_reader *)> reader(
        drv_reader_open(o.in.c_str(), error, sizeof error), drv_reader_close);
    if (!reader)
        throw InputError(error);
    const auto tables = std::make_unique<hdt_tables>(tables_of_log(reader.get()));
    const drv_run *head = drv_reader_run(reader.get());
    std::string constants = head->constants;
    std::vector<const char *> lines;
    for (char *line = std::strtok(constants.data(), "\n"); line != nullptr; line = std::strtok(nullptr, "\n"))
        lines.push_back(line);
    lines.push_back(nullptr);
    drv_writer_cfg cfg = {};
    cfg.tables = tables.get();
    std::copy(std::begin(head->ratio), std::end(head->ratio), cfg.ratio);
    cfg.constants = lines.data();
    cfg.terms = o.terms;
    drv_writer *writer = drv_writer_open(o.out.c_str(), &cfg, error, sizeof error);
    if (writer == nullptr)
        throw InputError(error);
    const auto record = std::make_unique<drv_record>();
    int more = 0, written = 0;
    bool rows = false;
    while (written == 0 && (more = drv_reader_next(reader.get(), record.get())) == 1) {
        written = drv_writer_put(writer, record.get());
        rows = rows || record->in.fresh != 0;
    }
    const bool good = more == 0 && rows;
    if (drv_writer_close(writer, good) != 0)
        throw InputError(o.out + ": the log could not be written (disk full?)");
    if (more < 0)
        throw InputError(drv_reader_error(reader.get()));
    if (!rows)
        throw InputError(o.in + ": expected periods with a state of the servo, found none");
}

void convert(const LogOptions &o)
{
    check_out(o);
    if (o.map.empty() && is_event_log(o.in)) {
        convert_events(o);
        say(read_run(o.out));
        return;
    }
    if (o.map.empty())
        throw UsageError(o.in + ": is no LCM event log of hdt: a foreign table needs a map, --map MAP.toml "
                                "(docs/formats.md, \"Import map\")");
    if (o.terms)
        throw UsageError("--terms: only an event log has torques by term, a foreign table what --map says");
    const Run run = convert_run(o.map, o.in);
    write_run(o.out, run);
    say(run);
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
    cut->add_option("--from", o->from_s, "first second kept, from the log's beginning")
        ->check(between(-1e9, 1e9));
    cut->add_option("--to", o->to_s, "first second not kept")->check(between(-1e9, 1e9));
    cut->callback([o, &code] {
        check_out(*o);
        Run run = read_run(o->in);
        Run part = cut_run(run, run.t_s.front() + o->from_s, run.t_s.front() + o->to_s);
        write_run(o->out, part);
        code = Ok;
    });

    CLI::App *to_csv = sub->add_subcommand(
        "convert", "a CSV log from an event log or a fault's dump (.lcm), or from a foreign table by a map");
    to_csv->add_option("log", o->in, "event log, or foreign table")->required();
    to_csv->add_option("out", o->out, "log to write, .csv")->required();
    to_csv->add_option("--map", o->map, "foreign table: what is where: docs/formats.md, \"Import map\"");
    to_csv->add_flag("--terms", o->terms, "event log: also every term's torque, as hdt host --terms");
    to_csv->callback([o, &code] {
        convert(*o);
        code = Ok;
    });
}

} // namespace hdt::cli
