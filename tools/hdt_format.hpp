// SPDX-License-Identifier: Apache-2.0
//
// What both ends of a wire have to agree on: telegram format and the torque unit of Format B.
//
// Owns: --format, and rated torques from the model file.
// Never: touches a telegram.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string>

#include "driver/drv_telegram.h"
#include "model/hdt_arm.h"
#include "tools/hdt_cli.hpp"

namespace hdt::cli {

// Throws UsageError for what is no address of a bus.
inline void check_bus_name(const std::string &bus)
{
    for (const char *kind : {"unix:", "can:", "isotp:", "arcnet:"})
        if (bus.rfind(kind, 0) == 0)
            return;
    throw UsageError(bus + ": not a bus: expected unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE");
}

// "A" or "B".  Throws UsageError; also where the bus cannot carry the format.
inline drv_format format_of(const std::string &text, const std::string &bus)
{
    if (text != "A" && text != "B")
        throw UsageError("--format: expected A or B, found " + text);
    const drv_format format = text == "B" ? DRV_FORMAT_B : DRV_FORMAT_A;
    char error[300];
    if (drv_telegram_fits(format, bus.c_str(), error, sizeof error) != DRV_TELEGRAM_OK)
        throw UsageError(error);
    return format;
}

// Rated motor torque of each joint, 0.001 N.m motor side.  Throws InputError where the file has none.
inline std::array<uint16_t, DRV_AXES> rated_mnm(const hdt_arm &arm, const std::string &file)
{
    std::array<uint16_t, DRV_AXES> rated{};
    for (int j = 0; j < arm.joints && j < DRV_AXES; j++) {
        double mnm = std::round(arm.joint[j].tau_rated_m_nm * 1000);
        if (!(mnm >= 1 && mnm <= 65535))
            throw InputError(file + ": joint." + std::to_string(j + 1) +
                             ".motor.torque_rated: Format B counts torque " +
                             "in it: expected 0.001 to 65.535 N m");
        rated[static_cast<size_t>(j)] = static_cast<uint16_t>(mnm);
    }
    return rated;
}

} // namespace hdt::cli
