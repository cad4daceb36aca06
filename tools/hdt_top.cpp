// SPDX-License-Identifier: Apache-2.0
//
// `hdt top`: a running loop in the terminal: rates, latencies, torques by term, faults, from LCM.
//
// On a terminal a page that redraws itself; else a line a second.  Only reads: nothing it does or
// does not do reaches the loop.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <unistd.h>

#include "driver/drv_lcm.h"
#include "hdt_status_t.h"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_telemetry.hpp"

namespace hdt::cli {

namespace {

using Clock = std::chrono::steady_clock;

struct TopOptions { std::string url; double seconds = 0; };

// The last of each message.
struct View {
    bool has_status = false, has_run = false, has_cycle = false;
    hdt_status_t status = {};
    std::string arm, phase, why;
    double rate_hz = 0;
    drv_run run = {};
    drv_record cycle = {};
    uint64_t messages = 0, damaged = 0, other_version = 0;
    Clock::time_point heard = Clock::now();
};

void on_status(const lcm_recv_buf_t *buffer, const char *, void *user)
{
    View &v = *static_cast<View *>(user);
    hdt_status_t s;
    if (hdt_status_t_decode(buffer->data, 0, static_cast<int>(buffer->data_size), &s) < 0) {
        v.damaged++;
        return;
    }
    if (v.has_status && s.t_us > v.status.t_us)
        v.rate_hz = 1e6 * static_cast<double>(s.periods - v.status.periods) /
                    static_cast<double>(s.t_us - v.status.t_us);
    v.arm = s.arm;
    v.phase = s.phase;
    v.why = s.why;
    v.status = s;
    v.status.arm = v.status.phase = v.status.why = nullptr;
    hdt_status_t_decode_cleanup(&s);
    v.has_status = true;
    v.messages++;
    v.heard = Clock::now();
}

void on_run(const lcm_recv_buf_t *buffer, const char *, void *user)
{
    View &v = *static_cast<View *>(user);
    int e = drv_lcm_get_run(static_cast<const uint8_t *>(buffer->data), buffer->data_size, &v.run);
    v.has_run = e == DRV_LCM_OK;
    v.damaged += e == DRV_LCM_DAMAGED || e == DRV_LCM_TYPE;
    v.other_version += e == DRV_LCM_VERSION;
}

void on_cycle(const lcm_recv_buf_t *buffer, const char *, void *user)
{
    View &v = *static_cast<View *>(user);
    if (!v.has_run) // how many joints a cycle has is in the run's message
        return;
    int e = drv_lcm_get_record(static_cast<const uint8_t *>(buffer->data), buffer->data_size, v.run.joints,
                               v.run.terms, &v.cycle);
    v.has_cycle = v.has_cycle || e == DRV_LCM_OK;
    v.damaged += e == DRV_LCM_DAMAGED || e == DRV_LCM_TYPE;
    v.other_version += e == DRV_LCM_VERSION;
    v.messages++;
}

double rad(hdt_rad_t q) { return q.raw / 16777216.0; }
double nm(hdt_nm_t t) { return t.raw / 65536.0; }

std::string bits(uint32_t word, const char *(*name)(uint32_t))
{
    std::string text;
    for (uint32_t bit = 1; bit != 0; bit <<= 1)
        if (word & bit)
            text += (text.empty() ? "" : "+") + std::string(name(bit));
    return text.empty() ? "-" : text;
}

double measured_nm(const View &v, uint32_t j) { return 0.001 * v.cycle.torque_dig[j] * v.run.ratio[j]; }

// For a pipe or a file: one line of what matters.
void line(const View &v)
{
    const hdt_status_t &s = v.status;
    std::printf("%9.2f s  %s  %.1f Hz  wake p99 %.0f us worst %.0f  work p99 %.0f us  missed %lld  lost %lld",
                static_cast<double>(s.t_us) * 1e-6, v.phase.c_str(), v.rate_hz, s.wake_p99_us,
                s.wake_worst_us, s.work_p99_us, static_cast<long long>(s.missed),
                static_cast<long long>(s.lost));
    if (v.has_cycle) {
        std::printf("  torque N m");
        for (uint32_t j = 0; j < v.run.joints; j++)
            std::printf(" %.2f", nm(v.cycle.out.total[j]));
        if (v.cycle.out.fault != 0)
            std::printf("  fault %s", bits(v.cycle.out.fault, hdt_fault_str).c_str());
    }
    std::printf("\n");
    std::fflush(stdout);
}

void page_torques(const View &v, std::string &out)
{
    char text[128];
    const hdt_out &o = v.cycle.out;
    bool used[HDT_TERMS] = {};
    for (int k = 0; k < HDT_TERMS; k++)
        for (uint32_t j = 0; j < v.run.joints; j++)
            used[k] = used[k] || o.term[k][j].raw != 0;
    out += "\nangles rad, torques N m output side\n      q_ref        q   err mrad     total  measured";
    for (int k = 0; k < HDT_TERMS; k++)
        if (used[k]) {
            std::snprintf(text, sizeof text, " %9.9s", hdt_term_str(k));
            out += text;
        }
    out += "  cut\n";
    for (uint32_t j = 0; j < v.run.joints; j++) {
        double q = rad(o.q[j]), q_ref = rad(v.cycle.in.q_ref[j]);
        std::snprintf(text, sizeof text, "%2u %8.4f %8.4f %10.3f %9.2f %9.2f", j + 1, q_ref, q,
                      1e3 * (q_ref - q), nm(o.total[j]), measured_nm(v, j));
        out += text;
        for (int k = 0; k < HDT_TERMS; k++)
            if (used[k]) {
                std::snprintf(text, sizeof text, " %9.2f", nm(o.term[k][j]));
                out += text;
            }
        out += "  " + bits(o.limit[j], hdt_limit_str) + "\n";
    }
    out += "fault " + bits(o.fault, hdt_fault_str) + "\n";
}

// For a terminal: everything, drawn over what was there.
void page(const View &v)
{
    char text[512];
    std::string out;
    const hdt_status_t &s = v.status;
    auto n = [](int64_t value) { return static_cast<long long>(value); };
    double age_s = std::chrono::duration<double>(Clock::now() - v.heard).count();
    std::snprintf(text, sizeof text, "hdt top   %s   %.1f s", v.arm.c_str(),
                  static_cast<double>(s.t_us) * 1e-6);
    out += text;
    if (age_s > 1) {
        std::snprintf(text, sizeof text, "   nothing heard for %.0f s", age_s);
        out += text;
    }
    out += "   (Ctrl-C ends)\n" + v.why + "\n\n";
    std::snprintf(text, sizeof text, "rate %.1f Hz of %.1f   periods %lld   missed %lld   log dropped %lld\n",
                  v.rate_hz, 1e6 / s.period_us, n(s.periods), n(s.missed), n(s.log_dropped));
    out += text;
    std::snprintf(text, sizeof text,
                  "replies %lld   lost %lld   bad %lld   not awaited %lld   sends refused %lld   bus down "
                  "%lld\n",
                  n(s.received), n(s.lost), n(s.bad_frames), n(s.not_awaited), n(s.send_refused),
                  n(s.bus_down));
    out += text;
    std::snprintf(text, sizeof text,
                  "wake-up p50 %.1f us  p99 %.1f  worst %.1f      work p50 %.1f us  p99 %.1f  worst %.1f\n",
                  s.wake_p50_us, s.wake_p99_us, s.wake_worst_us, s.work_p50_us, s.work_p99_us,
                  s.work_worst_us);
    out += text;
    if (v.has_cycle)
        page_torques(v, out);
    std::string drawn = "\033[H";
    for (char c : out)
        drawn += c == '\n' ? std::string("\033[K\n") : std::string(1, c);
    drawn += "\033[J";
    std::fputs(drawn.c_str(), stdout);
    std::fflush(stdout);
}

// The terminal as it was, whatever ends the program in order.
class Screen {
public:
    explicit Screen(bool on) : on_(on)
    {
        if (on_)
            std::fputs("\033[?1049h\033[?25l\033[?7l", stdout); // other page, no cursor, no wrapping
    }
    ~Screen()
    {
        if (!on_)
            return;
        std::fputs("\033[?7h\033[?25h\033[?1049l", stdout);
        std::fflush(stdout);
    }
    Screen(const Screen &) = delete;
    Screen &operator=(const Screen &) = delete;

private:
    bool on_;
};

// Until Ctrl-C, the end of a file:// log, or the time asked for.
void watch(lcm_t *lcm, View &v, bool terminal, double seconds)
{
    const auto start = Clock::now();
    auto next = start, complain = start + std::chrono::seconds(3);
    const auto step = terminal ? std::chrono::milliseconds(200) : std::chrono::milliseconds(1000);
    while (!stopped()) {
        int e = lcm_handle_timeout(lcm, 100);
        auto now = Clock::now();
        if (e < 0 || (seconds > 0 && std::chrono::duration<double>(now - start).count() > seconds))
            break;
        if (!v.has_status && now > complain) {
            std::fprintf(stderr, "hdt top: nothing heard for 3 s: is `hdt host --telemetry` running, and on "
                                 "this LCM address?\n");
            complain = now + std::chrono::seconds(60);
        }
        if (!v.has_status || now < next)
            continue;
        next = now + step;
        terminal ? page(v) : line(v);
    }
}

int run(const TopOptions &o)
{
    end_in_good_order();
    std::unique_ptr<lcm_t, void (*)(lcm_t *)> lcm(open_lcm(o.url), lcm_destroy);
    auto v = std::make_unique<View>();
    lcm_subscribe(lcm.get(), "HDT_STATUS", on_status, v.get());
    lcm_subscribe(lcm.get(), DRV_LCM_CHANNEL_RUN, on_run, v.get());
    lcm_subscribe(lcm.get(), DRV_LCM_CHANNEL_CYCLE, on_cycle, v.get());
    {
        bool terminal = isatty(STDOUT_FILENO) != 0;
        Screen screen(terminal);
        watch(lcm.get(), *v, terminal, o.seconds);
    }
    if (v->has_status) {
        line(*v); // the last, which stays on the screen
        std::printf("%s\n", v->why.c_str());
    }
    else if (v->other_version == 0 && v->damaged == 0)
        std::fprintf(stderr, "hdt top: no status was heard: hdt host --telemetry publishes it, a log of the "
                             "run (--out) has none\n");
    if (v->other_version != 0)
        std::fprintf(stderr,
                     "hdt top: %llu messages of another version than this program's %d: use the host's own "
                     "hdt\n",
                     static_cast<unsigned long long>(v->other_version), DRV_LOG_VERSION);
    if (v->damaged != 0)
        std::fprintf(stderr,
                     "hdt top: %llu messages were none of this version's: is something else on these "
                     "channels?\n",
                     static_cast<unsigned long long>(v->damaged));
    return v->has_status ? Ok : No;
}

} // namespace

void add_top(CLI::App &app, int &code)
{
    auto o = std::make_shared<TopOptions>();
    CLI::App *sub = app.add_subcommand("top", "a running loop in the terminal, from its telemetry");
    sub->add_option("--lcm", o->url,
                    "LCM address (default: LCM_DEFAULT_URL, or LCM's own); file://LOG reads a log");
    sub->add_option("--seconds", o->seconds, "end after this long (default: at Ctrl-C)")
        ->check(between(0.1, 1e6));
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
