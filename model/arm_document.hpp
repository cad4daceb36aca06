// SPDX-License-Identifier: Apache-2.0
//
// Inside of ArmFile: the key table of a model file, and the document as a flat map from key path
// ("joint.2.friction.positive.f0") to what stands there and on which line.
//
// Owns: which keys exist, their unit, side, shape and range; where an error is.
// Never: included outside model/arm_*.cpp.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "model/arm_file.hpp"

namespace hdt::arm {

enum class Kind { Number, Text, Flag };
enum class Range { Any, Positive, NonNegative, Whole };

// One key; '#' stands for an index into an array of tables, '*' for any one name.
struct KeySpec {
    const char *key;
    Kind kind;
    const char *unit;
    int count;
    const char *side; // "" none, else the only one allowed
    bool side_required;
    Range range;
};

const std::vector<KeySpec> &key_table();
// The spec a concrete key obeys, or null.
const KeySpec *find_spec(const std::string &key);
// Is there any key below this one?
bool is_table(const std::string &key);
// Is this an array of tables?
bool is_array(const std::string &key);
// The known name most like the last part of key, among its sisters; empty when none is near.
std::string nearest(const std::string &key);
std::string nearest_of(const std::string &name, const std::vector<std::string> &names);

struct Entry {
    Kind kind = Kind::Number;
    Quantity quantity;
    std::string text;
    bool flag = false;
};

struct Document {
    std::string path;
    std::map<std::string, Entry> entries;
    std::map<std::string, int> arrays; // array key -> tables in it
    std::map<std::string, int> lines;  // of entries and tables; absent when set by the program

    // Of the key, or of the nearest table around it that has one; 0 when none.
    int line_of(const std::string &key) const;
    // Throws InputError "path:line: key: what" with the line_of(key).
    [[noreturn]] void fail(const std::string &key, const std::string &what) const;
    [[noreturn]] void fail_at(int line, const std::string &key, const std::string &what) const;
    bool has(const std::string &key) const { return entries.count(key) != 0; }
    bool has_below(const std::string &key) const;
    int count(const std::string &array) const;
};

// Throws InputError on bad TOML, unknown keys, and any quantity that is wrong by itself.
Document parse_document(const std::string &text, const std::string &path);
// Checks one quantity against its key; fills in the side.  line 0: not from a file.
void check_quantity(const Document &d, const std::string &key, const KeySpec &spec, int line,
                    Quantity *q);
std::string write_document(const Document &d);
// Checks what keys say together and computes the numbers; digest and path are left alone.
hdt_arm derive_arm(const Document &d);

std::string quote(const std::string &text);
std::string number_text(double x);

} // namespace hdt::arm
