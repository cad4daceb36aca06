// SPDX-License-Identifier: Apache-2.0
//
// `hdt replay`: feed an event log to the core again and compare every digit, bit for bit.
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>

#include "driver/drv_log.h"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct Closer { void operator()(drv_reader *r) const { drv_reader_close(r); } };

int run(const std::string &log, const std::string &model)
{
    hdt_arm arm = rig::load_arm(model);
    hdt_tables tables = rig::tables_of(arm);
    char error[512];
    std::unique_ptr<drv_reader, Closer> reader(drv_reader_open(log.c_str(), error, sizeof error));
    if (!reader)
        throw InputError(error);
    const drv_run *head = drv_reader_run(reader.get());
    if (std::memcmp(head->digest, tables.digest, sizeof tables.digest) != 0)
        throw InputError(log + ": was logged with another model file than " + model +
                         " (digests differ); replay with the file the host had");
    auto core = std::make_unique<hdt_t>();
    if (hdt_init(core.get(), &tables) != HDT_OK)
        throw InputError(model + ": the core does not accept its tables");

    auto record = std::make_unique<drv_record>();
    auto out = std::make_unique<hdt_out>();
    uint64_t periods = 0, different = 0;
    int got;
    while ((got = drv_reader_next(reader.get(), record.get())) > 0) {
        hdt_step(core.get(), &record->in, out.get());
        periods++;
        if (std::memcmp(out->digit, record->out.digit, sizeof out->digit) == 0 &&
            std::memcmp(out->speed, record->out.speed, sizeof out->speed) == 0 &&
            std::memcmp(out->term, record->out.term, sizeof out->term) == 0 && out->fault == record->out.fault)
            continue;
        if (different++ == 0)
            std::printf("first difference at period %llu, t = %llu us\n", static_cast<unsigned long long>(periods),
                        static_cast<unsigned long long>(record->in.t_us));
    }
    if (got < 0)
        throw InputError(drv_reader_error(reader.get()));
    std::printf("%llu periods replayed, %llu differ\n", static_cast<unsigned long long>(periods),
                static_cast<unsigned long long>(different));
    return different == 0 ? Ok : No;
}

} // namespace

void add_replay(CLI::App &app, int &code)
{
    auto log = std::make_shared<std::string>(), model = std::make_shared<std::string>();
    CLI::App *sub = app.add_subcommand("replay", "feed an event log to the core again, compare bit for bit");
    sub->add_option("log", *log, "event log, .lcm")->required();
    sub->add_option("--model", *model, "the model file the host had")->required();
    sub->callback([log, model, &code] { code = run(*log, *model); });
}

} // namespace hdt::cli
