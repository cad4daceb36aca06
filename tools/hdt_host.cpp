// SPDX-License-Identifier: Apache-2.0
//
// `hdt host`: the control loop in real time around the core, over a bus, with a log.
//
// The control thread only runs drv_rt_run; everything that may block (files, terminal, telemetry) is
// in the main thread, which gets records through the ring and snapshots through the mailbox.
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>
#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include "driver/drv_rt.h"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_format.hpp"
#include "tools/hdt_rig.hpp"
#include "tools/hdt_telemetry.hpp"

namespace hdt::cli {

namespace {

struct HostOptions {
    std::string model, bus, task = "lemniscate", mode = "torque", out, format = "A", overrun = "count", dump;
    std::string telemetry;
    bool terms = false, operated = false, publishes = false;
    double telemetry_hz = 50;
    int priority = 80, cpu = -1;
    unsigned overrun_limit = 10;
    double follow_us = 0;
};

drv_rt_cfg rt_options(const HostOptions &o, uint32_t period_ns)
{
    drv_rt_cfg cfg = {};
    if (o.overrun == "hold")
        cfg.overrun = DRV_OVERRUN_HOLD;
    else if (o.overrun == "stop")
        cfg.overrun = DRV_OVERRUN_STOP;
    else if (o.overrun != "count")
        throw UsageError("--overrun: expected count, hold or stop, found " + o.overrun);
    cfg.overrun_limit = o.overrun_limit;
    if (o.follow_us * 1000 >= period_ns)
        throw UsageError("--follow-bus: expected less than the period of " +
                         std::to_string(period_ns / 1000) + " us, found " + std::to_string(o.follow_us));
    cfg.follow_lead_ns = static_cast<uint32_t>(o.follow_us * 1000);
    return cfg;
}

void say_quantiles(const char *name, const drv_hist &h)
{
    std::printf("%-8s p50 %8.1f us   p99 %8.1f us   p99.9 %8.1f us   worst %8.1f us\n", name,
                static_cast<double>(drv_hist_quantile(&h, 0.5)) * 1e-3,
                static_cast<double>(drv_hist_quantile(&h, 0.99)) * 1e-3,
                static_cast<double>(drv_hist_quantile(&h, 0.999)) * 1e-3,
                static_cast<double>(h.max_ns) * 1e-3);
}

// Both histograms by octave, side by side, from the first octave with something in it to the last.
void say_histogram(const drv_timing &t)
{
    constexpr unsigned octaves = (DRV_HIST_CLASSES - 2) / 8 + 2;
    uint64_t wake[octaves] = {}, work[octaves] = {};
    unsigned first = octaves, last = 0;
    for (unsigned k = 0; k < DRV_HIST_CLASSES; k++) {
        unsigned octave = (k + 7) / 8;
        wake[octave] += t.wake.in_class[k];
        work[octave] += t.work.in_class[k];
        if (wake[octave] + work[octave] == 0)
            continue;
        first = std::min(first, octave);
        last = octave;
    }
    std::printf("%14s %10s %10s\n", "below, us", "wake-up", "work");
    for (unsigned octave = first; octave <= last && first < octaves; octave++)
        std::printf("%14.1f %10llu %10llu\n", static_cast<double>(uint64_t{1024} << octave) * 1e-3,
                    static_cast<unsigned long long>(wake[octave]),
                    static_cast<unsigned long long>(work[octave]));
}

void say_end(const drv_host &host, const drv_timing &t, uint32_t period_ns)
{
    const drv_counters &c = host.cycle.count;
    auto n = [](uint64_t value) { return static_cast<unsigned long long>(value); };
    std::printf("%llu periods of %.4f ms, %llu missed; replies %llu, lost %llu, bad %llu, not awaited %llu; "
                "sends refused %llu, bus down %llu; log dropped %llu\n",
                n(c.periods), period_ns * 1e-6, n(t.missed), n(c.received), n(c.lost), n(c.bad_frames),
                n(c.wrong_seq), n(c.send_dropped), n(c.bus_down), n(c.log_dropped));
    if (host.errors != 0)
        std::printf("%llu periods refused and not driven: %s\n", n(host.errors),
                    hdt_strerror(host.last_error));
    if (t.unheard != 0)
        std::printf("%llu periods by the own clock: no reply to follow\n", n(t.unheard));
    const double mean_ns = static_cast<double>(host.t_us - host.t0_us) * 1e3 /
                           static_cast<double>(c.periods + t.missed);
    if (c.periods > 100 && std::fabs(mean_ns / period_ns - 1) > 0.01)
        std::printf("periods were %.4f ms on average: the tables are made for %.4f ms (control.rate in the "
                    "model file)\n",
                    mean_ns * 1e-6, period_ns * 1e-6);
    say_quantiles("wake-up", t.wake);
    say_quantiles("work", t.work);
    say_histogram(t);
}

// One line of the operator's.
void obey(drv_host &host, const std::string &line)
{
    static const struct { const char *word; drv_host_request ask; } words[] = {
        {"go", DRV_HOST_ASK_GO}, {"hold", DRV_HOST_ASK_HOLD},
        {"clear", DRV_HOST_ASK_CLEAR}, {"stop", DRV_HOST_ASK_STOP}};
    for (const auto &w : words)
        if (line == w.word)
            return drv_host_ask(&host, w.ask);
    if (!line.empty())
        std::fprintf(stderr, "hdt host: \"%s\": expected go, hold, clear or stop\n", line.c_str());
}

// What the main thread does while the control thread runs.
class Desk {
public:
    // telemetry may be null
    Desk(drv_host &host, drv_ring &ring, drv_rt_mailbox &box, drv_writer *writer, Telemetry *telemetry,
         bool operated)
        : host_(host), ring_(ring), box_(box), writer_(writer), telemetry_(telemetry), operated_(operated),
          hears_(operated)
    {
    }

    // Until the control thread has ended; false: the log failed.
    bool serve(const std::atomic<bool> &running)
    {
        for (bool last = false; !last;) {
            last = !running;
            while (drv_ring_pop(&ring_, &record_)) {
                written_ = drv_writer_put(writer_, &record_) == 0 && written_;
                if (telemetry_ != nullptr)
                    telemetry_->cycle(record_);
            }
            while (drv_rt_mail_take(&box_, &mail_)) {
                tell();
                if (telemetry_ != nullptr)
                    telemetry_->status(mail_);
            }
            if (stopped())
                drv_host_stop(&host_);
            if (!last)
                listen();
        }
        return written_;
    }

private:
    // The operator's view: a line when the phase changes.  Without one: only of a stop nobody asked for.
    void tell()
    {
        bool says = operated_ || mail_.host.asked == DRV_HOST_ASK_STOP_LATE;
        if (!says || (told_ && mail_.host.phase == phase_))
            return;
        char line[1024];
        drv_host_say(&mail_.host, host_.cycle.core.tables, line, sizeof line);
        std::fprintf(stderr, "hdt host: %s\n", line);
        phase_ = mail_.host.phase;
        told_ = true;
    }

    // 20 ms, or less if the operator types.  An operator who is gone is a stop.
    void listen()
    {
        pollfd in = {STDIN_FILENO, POLLIN, 0};
        if (poll(&in, hears_ ? 1 : 0, 20) <= 0 || in.revents == 0)
            return;
        char typed[256];
        ssize_t n = read(STDIN_FILENO, typed, sizeof typed);
        if (n <= 0) {
            std::fprintf(stderr, "hdt host: the operator's input ended: stopping\n");
            drv_host_stop(&host_);
            hears_ = false;
            return;
        }
        line_.append(typed, static_cast<size_t>(n));
        for (size_t end; (end = line_.find('\n')) != std::string::npos; line_.erase(0, end + 1))
            obey(host_, line_.substr(0, end));
    }

    drv_host &host_;
    drv_ring &ring_;
    drv_rt_mailbox &box_;
    drv_writer *writer_;
    Telemetry *telemetry_;
    bool operated_, hears_, written_ = true, told_ = false;
    drv_host_phase phase_ = DRV_HOST_IDLE;
    drv_record record_ = {};
    drv_rt_mail mail_ = {};
    std::string line_;
};

// The control thread's whole life.  A plain POSIX thread: std::thread frees memory at its end.
struct Control {
    drv_rt &rt;
    drv_host &host;
    drv_rt_wish wish;
    std::atomic<bool> running{true};

    static void *live(void *self)
    {
        Control &c = *static_cast<Control *>(self);
        char refused[512];
        if (drv_rt_enter(&c.wish, refused, sizeof refused) != 0)
            std::fprintf(stderr, "hdt host: %s\n", refused);
        (void)drv_rt_run(&c.rt, &c.host);
        c.running = false;
        return nullptr;
    }
};

// What telemetry says about the run: a log's head without its constants.
drv_run run_of(const hdt_tables &tables, const hdt_arm &model)
{
    drv_run run = {};
    run.version = DRV_LOG_VERSION;
    run.table_layout = tables.layout;
    run.period_ns = tables.period_ns;
    run.terms = HDT_TERMS;
    run.joints = tables.joints;
    std::snprintf(run.arm, sizeof run.arm, "%s", tables.name);
    std::copy(std::begin(tables.digest), std::end(tables.digest), run.digest);
    for (uint32_t j = 0; j < tables.joints; j++)
        run.ratio[j] = model.joint[j].ratio;
    return run;
}

int run(const HostOptions &o)
{
    end_in_good_order();
    if (same_file(o.out, o.dump))
        throw UsageError("--dump: " + o.dump + " is --out: expected two files");
    check_bus_name(o.bus);
    hdt_arm model = rig::load_arm(o.model);
    Reference reference = rig::task_of(model, o.task);
    rig::FixedReference fixed(reference);
    hdt_tables tables = rig::tables_of(model);
    drv_host_cfg cfg = {};
    cfg.mode = rig::mode_of(o.mode);
    cfg.settle_s = 0.2;
    cfg.operated = o.operated;
    drv_rt_cfg rt_cfg = rt_options(o, tables.period_ns);
    drv_format format = format_of(o.format, o.bus);
    auto rated = format == DRV_FORMAT_B ? rated_mnm(model, o.model) : std::array<uint16_t, DRV_AXES>{};
    hdt_bus bus;
    char error[512];
    if (hdt_bus_open(&bus, o.bus.c_str(), HDT_BUS_HOST, error, sizeof error) != 0)
        throw InputError(error);
    if (rt_cfg.follow_lead_ns != 0 && bus.health == nullptr) {
        hdt_bus_close(&bus);
        throw UsageError("--follow-bus: " + o.bus + " does not say when a telegram came: expected can:, "
                         "isotp: or arcnet:");
    }

    std::vector<drv_record> slots(4096); // almost six seconds of periods
    drv_ring ring;
    drv_ring_init(&ring, slots.data(), static_cast<unsigned>(slots.size()));
    drv_reference view = fixed.view();
    auto host = std::make_unique<drv_host>();
    if (drv_host_init(host.get(), &tables, &bus, &ring, &view, &cfg) != HDT_OK)
        throw InputError(o.model + ": the core does not accept its tables");
    if (format == DRV_FORMAT_B)
        (void)drv_cycle_set_format(&host->cycle, format, rated.data()); // rated_mnm has seen to every joint
    auto box = std::make_unique<drv_rt_mailbox>();
    auto rt = std::make_unique<drv_rt>();
    hdt_clock clock = hdt_clock_posix();
    const unsigned mail_every = 50000000u / tables.period_ns + 1; // some 20 a second
    // rt_options has checked
    (void)drv_rt_init(rt.get(), &rt_cfg, &clock, tables.period_ns, box.get(), mail_every);
    std::unique_ptr<Telemetry> telemetry;
    if (o.publishes)
        telemetry = std::make_unique<Telemetry>(o.telemetry, tables, run_of(tables, model), o.telemetry_hz);
    rig::FaultDump dump(o.dump, &host->cycle);
    const std::vector<std::string> head = {"task = " + o.task, "mode = " + o.mode};
    drv_writer *writer = rig::open_log(o.out, tables, model, head, o.terms);

    auto desk = std::make_unique<Desk>(*host, ring, *box, writer, telemetry.get(), o.operated);
    Control control{*rt, *host, {o.priority, o.cpu, 1}};
    pthread_t thread;
    if (pthread_create(&thread, nullptr, Control::live, &control) != 0)
        throw InputError("hdt host: no thread can be made: out of memory or of processes");
    bool written = desk->serve(control.running);
    pthread_join(thread, nullptr);
    hdt_bus_close(&bus);
    say_end(*host, rt->timing, tables.period_ns);
    bool keep = written && host->phase != DRV_HOST_SILENT;
    if (drv_writer_close(writer, keep) != 0 || !written)
        throw InputError(o.out + ": the log could not be written (disk full?)");
    dump.write(tables, model, head);
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
    sub->add_option("--format", o->format, "telegrams of the first (A) or second (B) generation")
        ->capture_default_str();
    sub->add_option("--out", o->out, "log to write: .csv or .lcm")->required();
    sub->add_option("--dump", o->dump, "when a fault latches, the last periods before it, .lcm, to replay");
    sub->add_flag("--terms", o->terms, "also log every term's torque");
    sub->add_flag("--operator", o->operated,
                  "wait for go, hold, clear, stop on standard input; its end is a stop");
    sub->add_option("--priority", o->priority, "SCHED_FIFO priority of the control thread; 0: none")
        ->capture_default_str()->check(CLI::Range(0, 99));
    sub->add_option("--cpu", o->cpu, "processor the control thread stays on, from 0 (default: any)")
        ->check(CLI::Range(0, 1023));
    sub->add_option("--overrun", o->overrun, "too many periods missed within a second: count, hold or stop")
        ->capture_default_str();
    sub->add_option("--overrun-limit", o->overrun_limit, "periods missed within a second that are let pass")
        ->capture_default_str();
    sub->add_option("--follow-bus", o->follow_us,
                    "follow the clock of a servo that answers at ticks of its own: periods start so many us\n"
                    "before them; the rate changes by 0.2 % at most. Not for one that answers at once")
        ->check(between(1.0, 1e6));
    CLI::Option *telemetry =
        sub->add_option("--telemetry", o->telemetry,
                        "publish over LCM, for hdt top, lcm-spy, lcm-logger; address: udpm:, file:, memq:\n"
                        "(default: LCM_DEFAULT_URL, or LCM's own)")
            ->expected(0, 1);
    sub->add_option("--telemetry-rate", o->telemetry_hz, "periods published a second, at most")
        ->capture_default_str()->check(between(0.1, 10000.0));
    sub->callback([o, telemetry, &code] {
        if (o->overrun == "hold" && !o->operated)
            throw CLI::ValidationError("--overrun", "hold waits for somebody to say go: expected --operator "
                                                    "with it, or count or stop");
        o->publishes = telemetry->count() > 0;
        code = run(*o);
    });
}

} // namespace hdt::cli
