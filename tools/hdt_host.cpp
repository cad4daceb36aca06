// SPDX-License-Identifier: Apache-2.0
//
// `hdt host`: the control loop in real time around the core, over a bus, with a log.
//
// The control thread only sleeps, runs drv_host_period and pushes records; everything that may
// block (files, terminal) is in the thread that drains the ring.
#include <atomic>
#include <cstdio>
#include <memory>
#include <thread>

#include "tools/hdt_cli.hpp"
#include "tools/hdt_format.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct HostOptions {
    std::string model, bus, task = "lemniscate", mode = "torque", out, format = "A";
    bool terms = false;
};

struct Timing { uint64_t late_periods = 0, worst_wake_ns = 0; };

// Absolute-time periods until the run ends.  A period missed is skipped, not run twice in a row.
Timing control(drv_host &host, uint32_t period_ns)
{
    Timing timing;
    hdt_clock clock = hdt_clock_posix();
    uint64_t next = clock.now_ns(clock.ctx) + period_ns;
    drv_host_phase phase = DRV_HOST_STARTING;
    while (phase < DRV_HOST_DONE) {
        clock.sleep_until_ns(clock.ctx, next);
        uint64_t now = clock.now_ns(clock.ctx);
        if (now > next && now - next > timing.worst_wake_ns)
            timing.worst_wake_ns = now - next;
        if (stopped())
            drv_host_stop(&host);
        phase = drv_host_period(&host, now / 1000);
        next += period_ns;
        while (next + period_ns < now) {
            next += period_ns;
            timing.late_periods++;
        }
    }
    return timing;
}

void say_counters(const drv_host &host, const Timing &timing)
{
    const drv_counters &c = host.cycle.count;
    std::fprintf(stderr,
                 "hdt host: %s after %llu periods; replies %llu, lost %llu, bad %llu, log dropped %llu; "
                 "periods skipped %llu, worst wake-up %.2f ms\n",
                 drv_host_phase_str(host.phase), static_cast<unsigned long long>(c.periods),
                 static_cast<unsigned long long>(c.received), static_cast<unsigned long long>(c.lost),
                 static_cast<unsigned long long>(c.bad_frames), static_cast<unsigned long long>(c.log_dropped),
                 static_cast<unsigned long long>(timing.late_periods),
                 static_cast<double>(timing.worst_wake_ns) * 1e-6);
}

int run(const HostOptions &o)
{
    hdt_arm model = rig::load_arm(o.model);
    Reference reference = make_task(model, o.task, model.control_rate_hz);
    rig::FixedReference fixed(reference);
    hdt_tables tables = rig::tables_of(model);
    uint32_t mode = rig::mode_of(o.mode);
    drv_format format = format_of(o.format, o.bus);
    auto rated = format == DRV_FORMAT_B ? rated_mnm(model, o.model) : std::array<uint16_t, DRV_AXES>{};
    hdt_bus bus;
    char error[512];
    if (hdt_bus_open(&bus, o.bus.c_str(), HDT_BUS_HOST, error, sizeof error) != 0)
        throw InputError(error);

    std::vector<drv_record> slots(4096); // almost six seconds of periods
    drv_ring ring;
    drv_ring_init(&ring, slots.data(), static_cast<unsigned>(slots.size()));
    drv_reference view = fixed.view();
    drv_host_cfg cfg = {};
    cfg.mode = mode;
    cfg.settle_s = 0.2;
    auto host = std::make_unique<drv_host>();
    if (drv_host_init(host.get(), &tables, &bus, &ring, &view, &cfg) != HDT_OK)
        throw InputError(o.model + ": the core does not accept its tables");
    if (format == DRV_FORMAT_B)
        (void)drv_cycle_set_format(&host->cycle, format, rated.data()); // rated_mnm has seen to every joint
    drv_writer *writer = rig::open_log(o.out, tables, model, {"task = " + o.task, "mode = " + o.mode}, o.terms);

    std::atomic<bool> running{true}, written{true};
    std::thread log_thread([&] {
        auto record = std::make_unique<drv_record>();
        for (bool last = false; !last;) {
            last = !running;
            while (drv_ring_pop(&ring, record.get()))
                if (drv_writer_put(writer, record.get()) != 0)
                    written = false;
            if (!last)
                std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
    });
    rig::go_real_time("hdt host", 80);
    Timing timing = control(*host, tables.period_ns);
    running = false;
    log_thread.join();
    hdt_bus_close(&bus);
    say_counters(*host, timing);
    bool keep = written && host->phase != DRV_HOST_SILENT;
    if (drv_writer_close(writer, keep) != 0 || !written)
        throw InputError(o.out + ": the log could not be written (disk full?)");
    return rig::explain_end("hdt host", *host);
}

} // namespace

void add_host(CLI::App &app, int &code)
{
    auto o = std::make_shared<HostOptions>();
    CLI::App *sub = app.add_subcommand("host", "the control loop in real time, over a bus");
    sub->add_option("--model", o->model, "model file")->required();
    sub->add_option("--bus", o->bus, "unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE")->required();
    sub->add_option("--task", o->task, "reference motion")->capture_default_str();
    sub->add_option("--mode", o->mode, "torque or velocity")->capture_default_str();
    sub->add_option("--format", o->format, "telegrams of the first (A) or second (B) generation")->capture_default_str();
    sub->add_option("--out", o->out, "log to write: .csv or .lcm")->required();
    sub->add_flag("--terms", o->terms, "also log every term's torque");
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
