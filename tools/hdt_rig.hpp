// SPDX-License-Identifier: Apache-2.0
//
// Where model file, plant, host and logs meet: the rig.
//
// Owns: plant from arm file, references in fixed point, what runs share.
// Never: hides an effect (hdt_effects.cpp).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "driver/drv_host.h"
#include "model/hdt_arm.h"
#include "model/task.hpp"
#include "sim/servo.h"

namespace hdt::rig {

// A healthy arm of this kind with the imperfections of a real one.  individual: 0 the file's numbers,
// else a seed that scatters friction (10 %) and ripple (10 %) as from one specimen to the next.
// Soft wind-up lines of the file are a description, not physics: the plant has the gear's spring.
// Throws InputError when the file lacks what a plant needs.
plant_model plant_from_arm(const hdt_arm &arm, uint64_t individual);

// Load an arm or throw InputError; make its tables or throw InputError, with the line of the file where the
// number stands that does not fit.  report may be null.
hdt_arm load_arm(const std::string &path);
hdt_tables tables_of(const hdt_arm &arm, hdt_gen_report *report = nullptr);

// A task's samples as the host takes them; keeps the memory.
class FixedReference {
public:
    explicit FixedReference(const Reference &r);
    drv_reference view() const;

private:
    unsigned samples_, joints_;
    uint32_t active_;
    std::vector<hdt_rad_t> q_;
    std::vector<hdt_radps_t> v_;
    std::vector<hdt_radps2_t> a_;
};

uint32_t mode_of(const std::string &text);     // "torque", "velocity"; throws UsageError

// What --task names, at the arm's control rate; throws UsageError.
Reference task_of(const hdt_arm &arm, const std::string &text);

// A log writer for this arm; head: "key = value" lines.  Throws InputError, UsageError for the name.
drv_writer *open_log(const std::string &path, const hdt_tables &tables, const hdt_arm &arm,
                     const std::vector<std::string> &head, bool terms);

// The last periods before a fault, written when one has latched.  Path "": none is kept.
class FaultDump {
public:
    FaultDump(std::string path, drv_cycle *cycle); // from the next period on; throws InputError
    void write(const hdt_tables &tables, const hdt_arm &arm, const std::vector<std::string> &head) const;

private:
    std::string path_;
    std::vector<drv_record> slots_;
    std::unique_ptr<drv_dump> dump_;
};

// Real-time priority for the calling thread and locked memory where the system lets us; says on
// stderr what it does not get.
void go_real_time(const char *who, int priority);

// Say on stderr why a run ended early, if it did; returns the exit code: 0 also where the end was asked
// for (Ctrl-C, an operator's stop).
int explain_end(const char *who, const drv_host &host);

} // namespace hdt::rig
