// SPDX-License-Identifier: Apache-2.0
//
// A measured run: the CSV contract of docs/formats.md (one run a file), and the LCM event log.
//
// Owns: reading, checking, cutting and writing runs; bringing foreign tables in by a map.
// Never: interprets torque; no filtering, no decimation.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "model/arm_file.hpp" // InputError

namespace hdt {

struct Run {
    std::string path;                          // for messages
    std::map<std::string, std::string> constants; // "# key = value" lines
    std::vector<double> t_s;
    struct Joint {
        bool present = false;                  // q and tau are there
        std::vector<double> q_rad, tau_nm;     // tau: measured motor torque times ratio, output side
        std::vector<double> v_radps, qref_rad, vref_radps, aref_radps2, temp_degc; // empty when absent
    };
    std::vector<Joint> joint;                  // 0-based; size = highest joint number in the header
    std::map<std::string, std::vector<double>> extra; // other columns, by name (term columns, ...)

    std::size_t rows() const { return t_s.size(); }
    // A number among the constants, or fallback when absent; throws InputError when it is no number.
    double constant(const std::string &key, double fallback) const;
    std::vector<double> constant_vector(const std::string &key) const; // empty when absent
};

// Throws InputError "file:line: ...": NaN, time not advancing, short row, unknown unit of a known
// column, no t_s, no complete joint.  Unknown columns are kept in extra.
Run read_run(const std::string &path);

// Written under a temporary name, then renamed.
void write_run(const std::string &path, const Run &run);

// The series a column of this name belongs to, made if absent (unknown names in extra); throws
// InputError for a known column in a wrong unit.  For readers of other formats; the reference
// holds until the next call.
std::vector<double> &run_column(Run &run, const std::string &name);
// After the last column: sets present, throws InputError where the run breaks the contract.
void finish_run(Run &run);

// Both hold the same measurement: equal positions and torques, row by row, of every joint that both
// have, whatever the files are called.
bool same_measurement(const Run &a, const Run &b);

// Rows with t0 <= t < t1, as a run of its own.
Run cut_run(const Run &run, double t0_s, double t1_s);

// A foreign table to our columns by a map (docs/formats.md, "Import map"):
//   q1_rad = { column = "Position1" | number, scale = 1.0, offset = 0.0, sign = 1 }
// foreign_path is the table, or for a layout of several files their directory or one of them.
// Throws InputError naming map and key, or foreign file, line and column.
Run convert_run(const std::string &map_path, const std::string &foreign_path);

} // namespace hdt
