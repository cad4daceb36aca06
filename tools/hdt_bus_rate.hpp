// SPDX-License-Identifier: Apache-2.0
//
// The bit rates a CAN interface is set up for, asked of the kernel.
//
// Owns: one question by netlink.
// Never: changes an interface.
#pragma once

#include <string>

namespace hdt::cli {

struct CanRates { unsigned nominal_bps = 0, data_bps = 0; }; // 0: none, or not known

// data_bps is 0 where CAN FD is off.  All 0 for an interface without bit rates (vcan), or none at all.
CanRates can_rates(const std::string &iface);

} // namespace hdt::cli
