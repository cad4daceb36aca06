// SPDX-License-Identifier: Apache-2.0
//
// A running loop, published over LCM: hdt.run_t, hdt.cycle_t and
// hdt.status_t on HDT_RUN, HDT_CYCLE, HDT_STATUS.
//
// Owns: the LCM connection and the rates.
// Never: runs in the control thread.
#pragma once

#include <lcm/lcm.h>
#include <string>

#include "driver/drv_log.h"
#include "driver/drv_rt.h"

namespace hdt::cli {

// An LCM connection by URL ("" : LCM_DEFAULT_URL, or LCM's own default).  Throws InputError that says
// what to do where there is no multicast.
lcm_t *open_lcm(const std::string &url);

class Telemetry {
public:
    // cycles_hz: at most so many hdt.cycle_t a second.
    Telemetry(const std::string &url, const hdt_tables &tables, const drv_run &run, double cycles_hz);
    ~Telemetry();
    Telemetry(const Telemetry &) = delete;
    Telemetry &operator=(const Telemetry &) = delete;

    void cycle(const drv_record &record);
    void status(const drv_rt_mail &mail);

private:
    void publish(const char *channel, const void *data, size_t size);

    lcm_t *lcm_;
    const hdt_tables &tables_;
    drv_run run_;
    uint64_t every_us_, next_us_ = 0, next_run_us_ = 0;
    bool said_ = false;
};

} // namespace hdt::cli
