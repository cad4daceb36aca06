// SPDX-License-Identifier: Apache-2.0
//
// The model file as a document: read with toml++, changed number by number with sigma and source,
// written back.
//
// Owns: the TOML schema (docs/formats.md), its errors, what a changed number records.
// Never: computes a model; struct hdt_arm is what computes.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "model/hdt_arm.h"

namespace hdt {

// Bad input: one line, what, where, expected, found, remedy.  tools/ turns it into exit code 3.
struct InputError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// One number and what is known about it.
struct Quantity {
    std::vector<double> value;     // one or several
    std::string unit;
    std::vector<double> sigma;     // empty: not known; else as many as value
    std::string source;
    std::string side;              // "output", "motor" or empty
};

class ArmFile {
public:
    // Throws InputError "file:line: key: expected ..., found ...".
    static ArmFile load(const std::string &path);
    ArmFile(const ArmFile &);
    ArmFile &operator=(const ArmFile &);
    ~ArmFile();

    const hdt_arm &arm() const;            // numbers in SI, checked

    // Set one quantity by key path, e.g. set("joint.2.friction.positive.f0", {...}); joint is 1-based.
    // Keys are those of docs/formats.md; creates tables on the way.
    void set(const std::string &key, const Quantity &q);
    void set_text(const std::string &key, const std::string &text);
    // Append a table to an array of tables, e.g. append("joint.2.effect", {{"id","spring"}}, quantities).
    void append(const std::string &array_key, const std::vector<std::pair<std::string, std::string>> &texts,
                const std::vector<std::pair<std::string, Quantity>> &quantities);
    bool has(const std::string &key) const;
    Quantity get(const std::string &key) const; // throws InputError when absent
    void erase(const std::string &key);

    // Re-derive arm() from the changed document; throws InputError as load does.
    void refresh();
    // Write under a temporary name in the same directory, then rename.
    void save(const std::string &path) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
    ArmFile();
};

} // namespace hdt
