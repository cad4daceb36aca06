// SPDX-License-Identifier: Apache-2.0
// See hdt_telemetry.hpp.
#include "tools/hdt_telemetry.hpp"

#include <cstdio>
#include <cstdlib>
#include <vector>

#include "driver/drv_lcm.h"
#include "hdt_status_t.h"
#include "tools/hdt_cli.hpp"

namespace hdt::cli {

lcm_t *open_lcm(const std::string &url)
{
    lcm_t *lcm = lcm_create(url.empty() ? nullptr : url.c_str());
    if (lcm != nullptr)
        return lcm;
    const char *env = std::getenv("LCM_DEFAULT_URL");
    std::string which = !url.empty() ? url : env != nullptr ? env : "udpm://239.255.76.67:7667";
    throw InputError("LCM cannot be opened at " + which +
                     ": expected udpm://ADDRESS:PORT?ttl=N, file://PATH?mode=w or memq://; without a "
                     "network, multicast on one machine needs (as root) `ip link set lo multicast on; "
                     "ip route add 224.0.0.0/4 dev lo`");
}

Telemetry::Telemetry(const std::string &url, const hdt_tables &tables, const drv_run &run, double cycles_hz)
    : lcm_(open_lcm(url)), tables_(tables), run_(run), every_us_(static_cast<uint64_t>(1e6 / cycles_hz))
{
}

Telemetry::~Telemetry() { lcm_destroy(lcm_); }

// A message that cannot be sent is said once; the loop and its log go on.
void Telemetry::publish(const char *channel, const void *data, size_t size)
{
    if (size != 0 && lcm_publish(lcm_, channel, data, static_cast<unsigned>(size)) == 0)
        return;
    if (!said_)
        std::fprintf(stderr, "hdt host: telemetry: a message on %s could not be sent\n", channel);
    said_ = true;
}

void Telemetry::cycle(const drv_record &record)
{
    std::vector<uint8_t> bytes(DRV_LCM_DATA_MAX);
    uint64_t t_us = record.in.t_us;
    if (t_us >= next_run_us_) { // once a second, for those who come later
        next_run_us_ = t_us + 1000000;
        publish(DRV_LCM_CHANNEL_RUN, bytes.data(), drv_lcm_put_run(&run_, bytes.data(), bytes.size()));
    }
    if (t_us < next_us_)
        return;
    // on the grid of the rate, so that it is held on average
    next_us_ = next_us_ + every_us_ > t_us ? next_us_ + every_us_ : t_us + every_us_;
    publish(DRV_LCM_CHANNEL_CYCLE, bytes.data(),
            drv_lcm_put_record(&record, tables_.joints, bytes.data(), bytes.size()));
}

void Telemetry::status(const drv_rt_mail &mail)
{
    char why[1024];
    std::string arm = tables_.name, phase = drv_host_phase_str(mail.host.phase);
    drv_host_say(&mail.host, &tables_, why, sizeof why);
    auto us = [](uint64_t ns) { return static_cast<double>(ns) * 1e-3; };
    auto n = [](uint64_t value) { return static_cast<int64_t>(value); };
    const drv_counters &c = mail.host.count;
    const drv_timing &t = mail.timing;
    hdt_status_t s = {};
    s.version = HDT_STATUS_T_VERSION;
    s.t_us = n(mail.host.t_us);
    s.arm = arm.data();
    s.phase = phase.data();
    s.why = why;
    s.period_us = us(tables_.period_ns);
    s.periods = n(c.periods);
    s.missed = n(t.missed);
    s.unheard = n(t.unheard);
    s.received = n(c.received);
    s.lost = n(c.lost);
    s.bad_frames = n(c.bad_frames);
    s.not_awaited = n(c.wrong_seq);
    s.send_refused = n(c.send_dropped);
    s.bus_down = n(c.bus_down);
    s.log_dropped = n(c.log_dropped);
    s.wake_p50_us = us(drv_hist_quantile(&t.wake, 0.5));
    s.wake_p99_us = us(drv_hist_quantile(&t.wake, 0.99));
    s.wake_worst_us = us(t.wake.max_ns);
    s.work_p50_us = us(drv_hist_quantile(&t.work, 0.5));
    s.work_p99_us = us(drv_hist_quantile(&t.work, 0.99));
    s.work_worst_us = us(t.work.max_ns);
    std::vector<uint8_t> bytes(static_cast<size_t>(hdt_status_t_encoded_size(&s)));
    int size = hdt_status_t_encode(bytes.data(), 0, static_cast<int>(bytes.size()), &s);
    publish("HDT_STATUS", bytes.data(), size > 0 ? static_cast<size_t>(size) : 0);
}

} // namespace hdt::cli
