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
#include <utility>
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
    std::string source;            // a key of [sources]
    std::string side;              // "output", "motor" or empty; set() fills in the one a key has
    std::string confidence = {};   // "high", "medium", "low"; needed where sigma is not known
};

class ArmFile {
public:
    // Throws InputError "file:line: key: expected ..., found ...".
    static ArmFile load(const std::string &path);
    // The same from text already in memory; path is for messages only.
    static ArmFile parse(const std::string &text, const std::string &path);
    ArmFile(const ArmFile &);
    ArmFile &operator=(const ArmFile &);
    ~ArmFile();

    const hdt_arm &arm() const;            // numbers in SI, checked

    // Set one quantity by key path, e.g. set("joint.2.friction.positive.f0", {...}), joint 1-based.
    // Keys are those of docs/formats.md; creates tables on the way.  Throws InputError for an
    // unknown key and for a quantity load would refuse; what depends on other keys waits for
    // refresh().
    void set(const std::string &key, const Quantity &q);
    // Texts: "name", "sources.FIT", "joint.2.effect.1.directed" ("true" or "false"), ...
    void set_text(const std::string &key, const std::string &text);
    // Append a table to an array of tables, e.g.
    // append("joint.2.effect", {{"id", "torque_offset"}}, {{"torque", {...}}}).
    void append(const std::string &array_key,
                const std::vector<std::pair<std::string, std::string>> &texts,
                const std::vector<std::pair<std::string, Quantity>> &quantities);
    bool has(const std::string &key) const;     // a number, a text, or a table that holds some
    int count(const std::string &array_key) const; // tables in an array of tables, 0 when absent
    // Which of an array's tables has this id, e.g. find("joint.2.effect", "inertia"), from 1; 0 when none.
    int find(const std::string &array_key, const std::string &id) const;
    // Line of the key as it was read, or of the nearest table around it that has one; 0 when none.
    int line_of(const std::string &key) const;
    Quantity get(const std::string &key) const; // throws InputError when absent
    std::string get_text(const std::string &key) const; // likewise
    void erase(const std::string &key); // with all below it; later tables of an array move up

    // Re-derive arm() from the changed document; throws InputError as load does, *this then keeps
    // the old arm().  The digest becomes that of the bytes save() would write.
    void refresh();
    // The bytes save() writes: every value and source, one quantity a line; comments are not kept.
    std::string text() const;
    // Write under a temporary name in the same directory, then rename.
    void save(const std::string &path) const;

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
    ArmFile();
};

} // namespace hdt
