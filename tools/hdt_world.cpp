// SPDX-License-Identifier: Apache-2.0
// See hdt_world.hpp.
#include "tools/hdt_world.hpp"

#include "tools/usage_error.hpp"

namespace hdt::rig {

World::World(const hdt_tables &tables, const plant_model &plant, const FixedReference &reference,
             double rate_hz,
             const std::vector<double> &start_rad, const WorldSetup &setup)
    : rate_hz_(rate_hz), slots_(setup.records), driver_(std::make_unique<struct servo>()),
      host_(std::make_unique<drv_host>())
{
    connect(setup);
    servo_cfg servo_options = {};
    servo_options.format = setup.format;
    for (uint32_t j = 0; setup.rated_mnm != nullptr && j < tables.joints && j < DRV_AXES; j++)
        servo_options.rated_m_nm[j] = 0.001 * setup.rated_mnm[j];
    servo_init(driver_.get(), &plant, &servo_options, start_rad.data(), setup.seed);
    if (setup.records > 0)
        drv_ring_init(&ring_, slots_.data(), setup.records);
    drv_reference view = reference.view();
    drv_host_cfg cfg = {};
    cfg.mode = setup.mode;
    cfg.settle_s = setup.settle_s;
    if (drv_host_init(host_.get(), &tables, &host_bus_, setup.records > 0 ? &ring_ : nullptr, &view,
                      &cfg) != HDT_OK)
        throw InputError(std::string(tables.name) + ": the core does not accept its tables");
    if (setup.format == DRV_FORMAT_B &&
        drv_cycle_set_format(&host_->cycle, setup.format, setup.rated_mnm) != 0)
        throw InputError(std::string(tables.name) + ": Format B needs the rated torque of every joint");
}

void World::connect(const WorldSetup &setup)
{
    over_arcnet_ = setup.arcnet_mbps != 0;
    if (!over_arcnet_) {
        drv_loop_pair(&loop_, &host_bus_, &servo_bus_);
        return;
    }
    const arcnet_line line = {arcnet_bit_ns(setup.arcnet_mbps), 0};
    if (arcnet_ring_open(&ring_line_, &line, &host_bus_, &servo_bus_) != 0)
        throw UsageError("--arcnet: expected 10, 5, 2.5, 1.25, 0.625, 0.3125 or 0.15625 Mbit/s, found " +
                         std::to_string(setup.arcnet_mbps));
}

void World::time_is(double t_s)
{
    if (over_arcnet_)
        arcnet_advance(&ring_line_, static_cast<uint64_t>(t_s * 1e9));
}

// Serve and advance the servo up to host time t.
void World::servo_until(double t_s)
{
    while (static_cast<double>(servo_ticks_ + 1) / SERVO_RATE_HZ <= t_s) {
        time_is(static_cast<double>(servo_ticks_ + 1) / SERVO_RATE_HZ);
        servo_serve(driver_.get(), &servo_bus_);
        servo_tick(driver_.get());
        servo_ticks_++;
    }
}

drv_host_phase World::play(const std::function<bool(World &)> &after)
{
    drv_host_phase phase = DRV_HOST_IDLE;
    for (uint64_t k = 1; phase < DRV_HOST_DONE; k++) {
        t_s_ = static_cast<double>(k) / rate_hz_;
        servo_until(t_s_);
        time_is(t_s_);
        phase = drv_host_period(host_.get(), static_cast<uint64_t>(t_s_ * 1e6));
        if (!after(*this))
            break;
    }
    return phase;
}

} // namespace hdt::rig
