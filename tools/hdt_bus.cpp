// SPDX-License-Identifier: Apache-2.0
//
// `hdt bus`: does a period fit this bus, and what is at the other end?  Before the arm is enabled: the
// telegrams sent have all brakes on, and the servo driver is never asked for control mode.
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <poll.h>
#include <vector>

#include "driver/drv_telegram.h"
#include "driver/hdt_bus.h"
#include "sim/arcnet.h"
#include "sim/canwire.h"
#include "tools/hdt_bus_rate.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_format.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct BusOptions {
    std::string bus, format = "A";
    double rate_hz = 700, seconds = 2, mbps = 0, data_mbps = 0, answer_us = 1e6 / 1504;
};

struct Lengths { unsigned down, up; };

struct Wire {                // one way to send a command and its answer
    std::string name;
    double down_us, up_us;   // on the wire, at most
    double wait_us;          // for the token
};

unsigned bps(double mbps)
{
    return static_cast<unsigned>(mbps * 1e6 + 0.5);
}

std::string rate_name(double mbps)
{
    char text[32];
    std::snprintf(text, sizeof text, "%g", mbps);
    return text;
}

std::vector<Wire> arcnet_ways(const BusOptions &o, Lengths len)
{
    std::vector<Wire> ways;
    for (double mbps : o.mbps > 0 ? std::vector<double>{o.mbps} : std::vector<double>{2.5, 5, 10}) {
        arcnet_line line = {arcnet_bit_ns(mbps), 0};
        if (line.bit_ns == 0)
            throw UsageError("--bitrate: expected a rate of ARCNET, 10, 5, 2.5, 1.25, ... 0.15625 Mbit/s; "
                             "found " +
                             rate_name(mbps));
        auto us = [](uint64_t ns) { return static_cast<double>(ns) * 1e-3; };
        // each of the two messages may have just missed the token
        ways.push_back({"ARCNET " + rate_name(mbps) + " Mbit/s", us(arcnet_message_ns(&line, len.down)),
                        us(arcnet_message_ns(&line, len.up)), 2 * us(arcnet_rotation_ns(&line, 0, 0))});
    }
    return ways;
}

std::vector<Wire> can_ways(const BusOptions &o, Lengths len, bool raw, bool isotp)
{
    std::vector<canwire_line> lines;
    if (o.mbps > 0)
        lines.push_back({bps(o.mbps), bps(o.data_mbps)});
    else
        lines = {{500000, 0}, {1000000, 0}, {500000, 2000000}, {1000000, 5000000}, {1000000, 8000000}};
    std::vector<Wire> ways;
    for (const canwire_line &line : lines) {
        std::string name = line.data_bitrate_bps == 0 ? "CAN " : "CAN FD ";
        name += rate_name(line.bitrate_bps * 1e-6);
        if (line.data_bitrate_bps != 0)
            name += "/" + rate_name(line.data_bitrate_bps * 1e-6);
        auto us = [](uint64_t ns) { return static_cast<double>(ns) * 1e-3; };
        uint64_t down = canwire_raw_ns(&line, len.down), up = canwire_raw_ns(&line, len.up);
        if (raw && down != 0 && up != 0)
            ways.push_back({name + " Mbit/s", us(down), us(up), 0});
        if (isotp || line.data_bitrate_bps == 0)
            ways.push_back({name + " Mbit/s, ISO-TP", us(canwire_isotp_ns(&line, len.down, nullptr)),
                            us(canwire_isotp_ns(&line, len.up, nullptr)), 0});
    }
    return ways;
}

// The table of times; false when a rate was given and the period does not fit it.
bool print_wire(const BusOptions &o, Lengths len)
{
    bool arcnet = o.bus.rfind("arcnet:", 0) == 0, can = o.bus.rfind("can:", 0) == 0;
    if (!arcnet && !can && o.bus.rfind("isotp:", 0) != 0)
        return true; // no wire
    double period_us = 1e6 / o.rate_hz;
    std::printf("on the wire, at most, us; period %.1f us (%g Hz), the servo driver answers within %.0f us\n",
                period_us, o.rate_hz, o.answer_us);
    std::printf("  %-30s %8s %8s %6s  %s\n", "", "command", "state", "load", "fits");
    bool fits = true;
    for (const Wire &w : arcnet ? arcnet_ways(o, len) : can_ways(o, len, can, !can)) {
        double wire_us = w.down_us + w.up_us, all_us = wire_us + w.wait_us + o.answer_us;
        bool ok = all_us <= period_us;
        std::printf("  %-30s %8.1f %8.1f %4.0f %%  ", w.name.c_str(), w.down_us, w.up_us,
                    100 * wire_us / period_us);
        if (ok)
            std::printf("yes, %.0f us left\n", period_us - all_us);
        else
            std::printf("no: up to %.0f Hz\n", 1e6 / all_us);
        fits = fits && (ok || o.mbps == 0);
    }
    return fits;
}

struct Link {
    uint64_t sent = 0, answered = 0, lost = 0, dropped = 0, down = 0;
    uint64_t other_format = 0, bad = 0, not_awaited = 0;
    uint16_t driver_status = 0;
    uint32_t alarms = 0; // bit per axis
    std::vector<double> round_us;
};

class Probe {
public:
    Probe(const BusOptions &o, const hdt_bus &bus)
        : options_(o), bus_(bus), format_(o.format == "B" ? DRV_FORMAT_B : DRV_FORMAT_A),
          clock_(hdt_clock_posix())
    {
    }

    // Does somebody get answers here?  Then our commands, brakes on, would come between.
    bool in_use()
    {
        constexpr uint64_t listen_ns = 200000000u;
        uint64_t end = clock_.now_ns(clock_.ctx) + listen_ns;
        hdt_frame f;
        for (uint64_t now = 0; now < end && !stopped(); now = clock_.now_ns(clock_.ctx)) {
            if (bus_.recv(bus_.ctx, &f) == HDT_BUS_OK)
                return true;
            (void)clock_.sleep_until_ns(clock_.ctx, clock_.now_ns(clock_.ctx) + 1000000u);
        }
        return false;
    }

    Link run()
    {
        uint64_t period_ns = static_cast<uint64_t>(1e9 / options_.rate_hz);
        uint64_t periods = static_cast<uint64_t>(options_.seconds * options_.rate_hz + 0.5);
        uint64_t next = clock_.now_ns(clock_.ctx);
        for (uint64_t k = 0; k < periods && !stopped(); k++, next += period_ns) {
            if (clock_.sleep_until_ns(clock_.ctx, next) == -EINTR)
                break;
            ask(static_cast<uint8_t>(k & 0x7fu));
            await(next + period_ns);
        }
        return link_;
    }

private:
    void ask(uint8_t seq)
    {
        drv_command c = {};
        c.seq = seq;
        c.type = DRV_CYCLIC;
        for (auto &axis : c.axis)
            axis.mode = DRV_AXIS_BRAKE;
        hdt_frame f;
        (void)drv_command_encode(format_, &c, &f);
        seq_ = seq;
        sent_ns_ = clock_.now_ns(clock_.ctx);
        int e = bus_.send(bus_.ctx, &f);
        awaited_ = e == HDT_BUS_OK;
        link_.sent += awaited_;
        link_.dropped += e == HDT_BUS_ERR_AGAIN || e == HDT_BUS_ERR_FRAME;
        link_.down += e == HDT_BUS_ERR_DOWN;
    }

    void take(const hdt_frame &f)
    {
        drv_state s;
        drv_format other = format_ == DRV_FORMAT_A ? DRV_FORMAT_B : DRV_FORMAT_A;
        if (drv_state_decode(format_, &f, &s) != DRV_TELEGRAM_OK) {
            bool is_other = drv_state_decode(other, &f, &s) == DRV_TELEGRAM_OK;
            link_.other_format += is_other;
            link_.bad += !is_other;
            return;
        }
        if (!awaited_ || s.seq != seq_ || s.type != DRV_CYCLIC) {
            link_.not_awaited++;
            return;
        }
        hdt_bus_health h;
        hdt_bus_get_health(&bus_, &h);
        uint64_t now = clock_.now_ns(clock_.ctx);
        uint64_t at = h.received_ns >= sent_ns_ && h.received_ns <= now ? h.received_ns : now;
        awaited_ = false;
        link_.answered++;
        link_.round_us.push_back(static_cast<double>(at - sent_ns_) * 1e-3);
        link_.driver_status = s.driver_status;
        link_.alarms = 0;
        for (unsigned j = 0; j < DRV_AXES; j++)
            if ((s.axis[j].status & DRV_AXIS_ALARM_MASK) != 0)
                link_.alarms |= 1u << j;
    }

    // Everything that comes until the period is over or the answer is there.
    void await(uint64_t end_ns)
    {
        bool asked = awaited_;
        for (;;) {
            hdt_frame f;
            int e = bus_.recv(bus_.ctx, &f);
            uint64_t now = clock_.now_ns(clock_.ctx);
            if (e == HDT_BUS_OK)
                take(f);
            link_.bad += e == HDT_BUS_ERR_FRAME;
            if (e == HDT_BUS_ERR_DOWN) {
                link_.down++;
                break;
            }
            if ((asked && !awaited_) || now >= end_ns)
                break;
            if (e == HDT_BUS_ERR_AGAIN) {
                pollfd p = {bus_.fd != nullptr ? bus_.fd(bus_.ctx) : -1, POLLIN, 0};
                (void)poll(&p, 1, static_cast<int>((end_ns - now) / 1000000u));
            }
        }
        link_.lost += asked && awaited_;
    }

    const BusOptions &options_;
    const hdt_bus &bus_;
    drv_format format_;
    hdt_clock clock_;
    uint8_t seq_ = 0;
    bool awaited_ = false;
    uint64_t sent_ns_ = 0;
    Link link_;
};

double quantile(const std::vector<double> &sorted, double q)
{
    return sorted.empty() ? 0 : sorted[static_cast<size_t>(q * static_cast<double>(sorted.size() - 1))];
}

// What was found, and whether it will do.
bool print_link(const BusOptions &o, Link link, const hdt_bus_health &h)
{
    auto n = [](uint64_t x) { return static_cast<unsigned long long>(x); };
    std::sort(link.round_us.begin(), link.round_us.end());
    std::printf("link: %g Hz for %g s, all brakes on: %llu sent, %llu answered, %llu lost\n", o.rate_hz,
                o.seconds, n(link.sent), n(link.answered), n(link.lost));
    if (link.dropped + link.down + link.bad + link.other_format + link.not_awaited > 0)
        std::printf("  queue full %llu, line down %llu, no telegrams %llu, of the other format %llu, "
                    "not awaited %llu\n",
                    n(link.dropped), n(link.down), n(link.bad), n(link.other_format), n(link.not_awaited));
    if (link.answered > 0) {
        std::printf("  round trip: p50 %.0f us, p99 %.0f us, worst %.0f us%s\n", quantile(link.round_us, 0.5),
                    quantile(link.round_us, 0.99), link.round_us.back(),
                    h.received_ns != 0 ? " (stamped by the kernel)" : "");
        unsigned alarm = (link.driver_status & DRV_AXIS_ALARM_MASK) >> DRV_ALARM_SHIFT;
        std::printf("  servo driver: %s, axes with alarms: mask 0x%02x\n", drv_driver_alarm_str(alarm),
                    link.alarms);
    }
    if (h.line != HDT_LINE_UNKNOWN)
        std::printf("  line: %s; off %llu times, back %llu; overruns %llu, foreign %llu\n",
                    hdt_line_str(h.line), n(h.offs), n(h.restarts), n(h.overruns), n(h.foreign));
    if (link.answered > 0)
        return link.lost == 0 && link.dropped == 0 && link.down == 0;
    if (link.other_format > 0)
        std::printf("  the servo speaks the other format: try --format %s\n", o.format == "A" ? "B" : "A");
    else
        std::printf("  nobody answers: expected a state telegram of Format %s; is the servo driver on, and "
                    "of this format? (it drops commands of another)\n",
                    o.format.c_str());
    return false;
}

// Without --bitrate, what a CAN interface is set up for.
BusOptions with_rates(BusOptions o)
{
    bool can = o.bus.rfind("can:", 0) == 0 || o.bus.rfind("isotp:", 0) == 0;
    if (!can || o.mbps > 0)
        return o;
    CanRates rates = can_rates(o.bus.substr(o.bus.find(':') + 1));
    o.mbps = rates.nominal_bps * 1e-6;
    o.data_mbps = rates.data_bps * 1e-6;
    return o;
}

int run(const BusOptions &given)
{
    end_in_good_order();
    BusOptions o = with_rates(given);
    if (o.format != "A" && o.format != "B")
        throw UsageError("--format: expected A or B, found " + o.format);
    bool b = o.format == "B";
    check_bus_name(o.bus);
    Lengths len = b ? Lengths{DRV_COMMAND_LEN_B, DRV_STATE_LEN_B} : Lengths{DRV_COMMAND_LEN, DRV_STATE_LEN};
    std::printf("%s: telegrams of Format %s, %u bytes down, %u up\n", o.bus.c_str(), o.format.c_str(),
                len.down, len.up);
    bool fits = print_wire(o, len);
    if (o.seconds <= 0)
        return fits ? Ok : No;
    hdt_bus bus;
    char error[512];
    if (hdt_bus_open(&bus, o.bus.c_str(), HDT_BUS_HOST, error, sizeof error) != 0)
        throw InputError(error);
    std::fflush(stdout);
    Probe probe(o, bus);
    if (probe.in_use()) {
        hdt_bus_close(&bus);
        throw InputError(o.bus + ": another host is talking to the servo driver: stop it first; what is sent "
                                 "to try the link would put its brakes on");
    }
    rig::go_real_time("hdt bus", 80);
    Link link = probe.run();
    hdt_bus_health health;
    hdt_bus_get_health(&bus, &health);
    hdt_bus_close(&bus);
    return print_link(o, std::move(link), health) && fits ? Ok : No;
}

} // namespace

void add_bus(CLI::App &app, int &code)
{
    auto o = std::make_shared<BusOptions>();
    CLI::App *sub = app.add_subcommand("bus", "does a period fit this bus, and who answers: rate, load, "
                                              "round trip, losses");
    sub->add_option("bus", o->bus, "unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE")->required();
    sub->add_option("--rate", o->rate_hz, "of the control loop, Hz")
        ->capture_default_str()
        ->check(between(1.0, 20000.0));
    sub->add_option("--seconds", o->seconds, "to try the link; 0: only say what fits")
        ->capture_default_str()
        ->check(between(0.0, 3600.0));
    sub->add_option("--format", o->format, "telegrams of the first (A) or second (B) generation")
        ->capture_default_str();
    sub->add_option("--bitrate", o->mbps,
                    "the line's, Mbit/s, to be judged; default: what a CAN interface is set to, else the "
                    "usual ones")
        ->check(between(0.01, 100.0));
    sub->add_option("--data-bitrate", o->data_mbps, "of CAN FD's data phase, Mbit/s; default: classical CAN")
        ->check(between(0.01, 100.0));
    sub->add_option("--answer", o->answer_us, "us the servo driver takes at most; default: one of its ticks")
        ->capture_default_str()
        ->check(between(0.0, 1e6));
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
