// SPDX-License-Identifier: Apache-2.0
// See hdt_world.hpp.
#include "tools/hdt_world.hpp"

#include "model/arm_file.hpp"

namespace hdt::rig {

World::World(const hdt_tables &tables, const plant_model &plant, const FixedReference &reference,
             double rate_hz,
             const std::vector<double> &start_rad, const WorldSetup &setup)
    : rate_hz_(rate_hz), slots_(setup.records), driver_(std::make_unique<struct servo>()),
      host_(std::make_unique<drv_host>())
{
    drv_loop_pair(&loop_, &host_bus_, &servo_bus_);
    servo_cfg servo_options = {};
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
}

// Serve and advance the servo up to host time t.
void World::servo_until(double t_s)
{
    while (static_cast<double>(servo_ticks_ + 1) / SERVO_RATE_HZ <= t_s) {
        servo_serve(driver_.get(), &servo_bus_);
        servo_tick(driver_.get());
        servo_ticks_++;
    }
}

drv_host_phase World::play(const std::function<bool(World &)> &after)
{
    drv_host_phase phase = DRV_HOST_STARTING;
    for (uint64_t k = 1; phase < DRV_HOST_DONE; k++) {
        t_s_ = static_cast<double>(k) / rate_hz_;
        servo_until(t_s_);
        phase = drv_host_period(host_.get(), static_cast<uint64_t>(t_s_ * 1e6));
        if (!after(*this))
            break;
    }
    return phase;
}

} // namespace hdt::rig
