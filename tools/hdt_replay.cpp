// SPDX-License-Identifier: Apache-2.0
//
// `hdt replay`: feed an event log to the core again and compare every output
// that is in the log, bit for bit: all but the observed velocity.
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>

#include "driver/drv_log.h"
#include "model/text.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct Closer { void operator()(drv_reader *r) const { drv_reader_close(r); } };
using Reader = std::unique_ptr<drv_reader, Closer>;

Reader open(const std::string &log)
{
    char error[512];
    Reader reader(drv_reader_open(log.c_str(), error, sizeof error));
    if (!reader)
        throw InputError(error);
    const drv_run *head = drv_reader_run(reader.get());
    if (head->table_layout != HDT_TABLES_LAYOUT)
        throw InputError(log + ": logged with table layout " + std::to_string(head->table_layout) +
                         ", this core has " + std::to_string(HDT_TABLES_LAYOUT) +
                         ": replay it with the program that logged it");
    return reader;
}

// The image, for comparison: it has no padding.
std::string image_of(const hdt_tables &t)
{
    std::string image(hdt_tables_size(t.joints), '\0');
    hdt_tables_write(&t, reinterpret_cast<uint8_t *>(image.data()), image.size());
    return image;
}

// The tables the log carries; those of the model file, if one is named, have to be the same.
hdt_tables tables_for(const std::string &log, const drv_reader *reader, const std::string &model)
{
    const drv_run *head = drv_reader_run(reader);
    hdt_tables tables = {};
    const int e = drv_reader_tables(reader, &tables);
    if (e != HDT_TABLES_OK && e != DRV_LOG_NONE)
        throw InputError(log + ": the tables in it: " + hdt_tables_strerror(e));
    if (e == DRV_LOG_NONE && model.empty())
        throw InputError(log + ": has no tables in it (logged before logs had them): name the model file "
                               "the host had with --model");
    if (e == HDT_TABLES_OK && std::memcmp(head->digest, tables.digest, sizeof tables.digest) != 0)
        throw InputError(log + ": its head and the tables in it are of two model files (digests differ): the "
                               "log was put together or is damaged");
    if (model.empty())
        return tables;

    const hdt_tables ours = rig::tables_of(rig::load_arm(model));
    if (std::memcmp(head->digest, ours.digest, sizeof ours.digest) != 0)
        throw InputError(log + ": was logged with another model file than " + model + " (digests differ: " +
                         hex(head->digest, 8) + "... in the log, " + hex(ours.digest, 8) +
                         "... of the file); replay with the file the host had, or without --model");
    if (e == HDT_TABLES_OK && image_of(tables) != image_of(ours))
        throw InputError(log + ": the model file is the one the host had, but its tables are not those in "
                               "the log (made by another version, or with a payload declared for the run); "
                               "replay without --model");
    return ours;
}

// The first member that differs, in words; nothing when all are the same.
struct Difference { std::string field; long long logged, replayed; };

std::optional<Difference> compare(const hdt_out &log, const hdt_out &now, uint32_t joints)
{
    for (uint32_t j = 0; j < joints; j++) {
        const std::string of_joint = " of joint " + std::to_string(j + 1);
        if (log.q[j].raw != now.q[j].raw)
            return Difference{"q_q24" + of_joint, log.q[j].raw, now.q[j].raw};
        if (log.v[j].raw != now.v[j].raw)
            return Difference{"v_q24" + of_joint, log.v[j].raw, now.v[j].raw};
        for (int k = 0; k < HDT_TERMS; k++)
            if (log.term[k][j].raw != now.term[k][j].raw)
                return Difference{hdt_term_str(k) + ("_q16" + of_joint), log.term[k][j].raw,
                                  now.term[k][j].raw};
        if (log.total[j].raw != now.total[j].raw)
            return Difference{"total_q16" + of_joint, log.total[j].raw, now.total[j].raw};
        if (log.limit[j] != now.limit[j])
            return Difference{"limit" + of_joint, log.limit[j], now.limit[j]};
        if (log.digit[j].raw != now.digit[j].raw)
            return Difference{"digit" + of_joint, log.digit[j].raw, now.digit[j].raw};
        if (log.speed[j].raw != now.speed[j].raw)
            return Difference{"speed" + of_joint, log.speed[j].raw, now.speed[j].raw};
    }
    if (log.fault != now.fault)
        return Difference{"fault", log.fault, now.fault};
    if (log.fault_joints != now.fault_joints)
        return Difference{"fault_joints", log.fault_joints, now.fault_joints};
    return std::nullopt;
}

// A fault leaves only by hdt_clear, so one that is gone from the log was cleared before this period.
bool cleared(const hdt_out &before, const hdt_out &now)
{
    return (before.fault & ~now.fault) != 0 || (before.fault_joints & ~now.fault_joints) != 0;
}

void say_first(const Difference &d, unsigned long long period, uint64_t t_us, uint64_t step_us,
               uint32_t period_ns)
{
    std::printf("first difference at period %llu, t = %llu us: %s is %lld in the log, %lld in the replay\n",
                period, static_cast<unsigned long long>(t_us), d.field.c_str(), d.logged, d.replayed);
    if (step_us * 2000 > 3 * static_cast<uint64_t>(period_ns))
        std::printf("the log goes on by %llu us here: periods were skipped, or their records dropped\n",
                    static_cast<unsigned long long>(step_us));
}

int run(const std::string &log, const std::string &model)
{
    Reader reader = open(log);
    const hdt_tables tables = tables_for(log, reader.get(), model);
    auto core = std::make_unique<hdt_t>();
    const int e = drv_reader_start(reader.get(), &tables, core.get());
    if (e == DRV_LOG_OTHER_BUILD)
        throw InputError(log +
                         ": begins within a run, from the memory of a core of another version or processor; "
                         "replay it with the program of the host that wrote it");
    if (e == DRV_LOG_DAMAGED)
        throw InputError(drv_reader_error(reader.get()));
    if (e != HDT_OK)
        throw InputError(log + ": the core does not accept its tables: " + hdt_strerror(e));

    auto record = std::make_unique<drv_record>();
    auto out = std::make_unique<hdt_out>(), before = std::make_unique<hdt_out>();
    before->fault = core->gate.fault;
    before->fault_joints = core->gate.fault_joints;
    unsigned long long periods = 0, different = 0, clears = 0;
    uint64_t t_us = 0;
    int got;
    while ((got = drv_reader_next(reader.get(), record.get())) > 0) {
        periods++;
        if (cleared(*before, record->out)) {
            clears++;
            hdt_clear(core.get());
        }
        const int error = hdt_step(core.get(), &record->in, out.get());
        if (error != HDT_OK)
            throw InputError(log + ": period " + std::to_string(periods) +
                             ", t = " + std::to_string(record->in.t_us) +
                             " us: the core refuses its input: " + hdt_strerror(error));
        const auto difference = compare(record->out, *out, tables.joints);
        if (difference && different++ == 0)
            say_first(*difference, periods, record->in.t_us, periods == 1 ? 0 : record->in.t_us - t_us,
                      tables.period_ns);
        *before = record->out;
        t_us = record->in.t_us;
    }
    if (got < 0)
        throw InputError(drv_reader_error(reader.get()) +
                         (" (" + std::to_string(periods) + " periods replayed, " + std::to_string(different) +
                          " differ)"));
    if (periods == 0)
        throw InputError(log + ": has no period in it: nothing to replay");
    std::printf("%llu periods replayed, %llu differ", periods, different);
    if (clears != 0)
        std::printf("; faults were cleared %llu times", clears);
    std::printf("\n");
    return different == 0 ? Ok : No;
}

} // namespace

void add_replay(CLI::App &app, int &code)
{
    auto log = std::make_shared<std::string>(), model = std::make_shared<std::string>();
    CLI::App *sub = app.add_subcommand("replay", "feed an event log or a fault's dump to the core again, "
                                                 "compare bit for bit");
    sub->add_option("log", *log, "event log, .lcm")->required();
    sub->add_option("--model", *model,
                    "insist that this is the model file the host had; needed only for logs without tables");
    sub->callback([log, model, &code] { code = run(*log, *model); });
}

} // namespace hdt::cli
