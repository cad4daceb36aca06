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

// Rows with t0 <= t < t1, as a run of its own.
Run cut_run(const Run &run, double t0_s, double t1_s);

// A foreign table to our columns: MAP.toml says separator, header, time, and per target column
//   q1_rad = { column = "Position1" | index, scale = 1.0, offset = 0.0, sign = 1 }
// or files of one value per line to be reshaped.  Throws InputError naming what is missing.
Run convert_run(const std::string &map_path, const std::string &foreign_path);

} // namespace hdt
