// SPDX-License-Identifier: Apache-2.0
//
// Host, bus, servo and plant in one process and in virtual time: the world `hdt sim` and `hdt paper`
// run their arms in.
//
// Owns: the order of host periods and servo ticks.
// Never: reads a clock, writes a file, knows what is hidden in the plant.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "driver/drv_host.h"
#include "sim/arcnet.h"
#include "sim/servo.h"
#include "tools/hdt_rig.hpp"

namespace hdt::rig {

struct WorldSetup {
    uint32_t mode = HDT_MODE_TORQUE;   // HDT_MODE_TORQUE or HDT_MODE_VELOCITY
    double settle_s = 0.2;             // held at the end of the reference
    uint64_t seed = 1;                 // this run's noise and scatter
    unsigned records = 0;              // room of the log ring, a power of two; 0: no log
    double arcnet_mbps = 0;            // telegrams take an ARCNET's time at this rate; 0: none at all
    drv_format format = DRV_FORMAT_A;
    const uint16_t *rated_mnm = nullptr; // Format B: rated motor torque per joint, 0.001 N.m motor side
};

// One run.  Tables, plant and reference must outlive it and not change; worlds share nothing, so
// several may run at once, each in a thread of its own.
class World {
public:
    // The arm stands braked at the first sample.  Throws InputError when the core refuses the tables,
    // or the ARCNET rate is none of the chip's.
    World(const hdt_tables &tables, const plant_model &plant, const FixedReference &reference, double rate_hz,
          const std::vector<double> &start_rad, const WorldSetup &setup);
    World(const World &) = delete;
    World &operator=(const World &) = delete;

    // Host periods and servo ticks in the order of time until the run ends or `after` (called after
    // every host period) returns false.  Returns the host's phase.
    drv_host_phase play(const std::function<bool(World &)> &after);

    drv_host &host() { return *host_; }
    const struct servo &driver() const { return *driver_; }
    drv_ring &ring() { return ring_; }
    double t_s() const { return t_s_; }    // host time of the last period

private:
    double rate_hz_;
    double t_s_ = 0;
    uint64_t servo_ticks_ = 0;
    drv_loop loop_{};
    arcnet_ring ring_line_{};
    bool over_arcnet_ = false;
    hdt_bus host_bus_{}, servo_bus_{};
    drv_ring ring_{};
    std::vector<drv_record> slots_;
    std::unique_ptr<struct servo> driver_;
    std::unique_ptr<drv_host> host_;

    void connect(const WorldSetup &setup);
    void time_is(double t_s);
    void servo_until(double t_s);
};

} // namespace hdt::rig
