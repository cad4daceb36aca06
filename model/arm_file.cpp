// SPDX-License-Identifier: Apache-2.0
//
// The document behind ArmFile: changing it key by key, writing it, reading it from disk.
//
// Owns: edits, the written form, files.
// Never: parses TOML (arm_parse.cpp) or computes numbers (arm_derive.cpp).
#include "model/arm_file.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>

#include <openssl/evp.h>

#include "model/arm_document.hpp"
#include "model/files.hpp"

namespace hdt {
namespace arm {

void Document::fail_at(int line, const std::string &key, const std::string &what) const
{
    std::string message =
        path + (line > 0 ? ":" + std::to_string(line) : "") + ": " + key + ": " + what;
    // bytes of a foreign file must not move a terminal's cursor
    for (char &c : message)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
            c = '?';
    throw InputError(message);
}

int Document::line_of(const std::string &key) const
{
    for (std::string at = key;; at.erase(at.rfind('.'))) {
        const auto found = lines.find(at);
        if (found != lines.end())
            return found->second;
        if (at.find('.') == std::string::npos)
            return 0;
    }
}

void Document::fail(const std::string &key, const std::string &what) const
{
    fail_at(line_of(key), key, what);
}

bool Document::has_below(const std::string &key) const
{
    const auto next = entries.lower_bound(key + ".");
    return next != entries.end() && next->first.compare(0, key.size() + 1, key + ".") == 0;
}

int Document::count(const std::string &array) const
{
    const auto found = arrays.find(array);
    return found == arrays.end() ? 0 : found->second;
}

std::string number_text(double x)
{
    std::array<char, 40> buffer;
    const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), x);
    std::string text(buffer.data(), end.ptr);
    // without a point it would be read as an integer, which has no -0 and ends at 2^63
    if (text.find_first_of(".en") == std::string::npos && (text.size() > 15 || text == "-0"))
        text += ".0";
    return text;
}

std::string quote(const std::string &text)
{
    std::string out = "\"";
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        if (c == '"' || c == '\\') {
            out += '\\';
            out += c;
        } else if (byte < 0x20 || byte == 0x7f) {
            std::array<char, 8> escape;
            std::snprintf(escape.data(), escape.size(), "\\u%04X", static_cast<unsigned>(byte));
            out += escape.data();
        } else {
            out += c;
        }
    }
    return out + '"';
}

namespace {

std::string numbers_text(const std::vector<double> &x, int count)
{
    if (count == 1)
        return number_text(x.at(0));
    std::string out = "[";
    for (const double value : x)
        out += (out.size() > 1 ? ", " : "") + number_text(value);
    return out + "]";
}

std::string entry_text(const Entry &entry, const KeySpec &spec)
{
    if (spec.kind == Kind::Text)
        return quote(entry.text);
    if (spec.kind == Kind::Flag)
        return entry.flag ? "true" : "false";
    const Quantity &q = entry.quantity;
    std::string out =
        "{ value = " + numbers_text(q.value, spec.count) + ", unit = " + quote(q.unit);
    if (!q.side.empty())
        out += ", side = " + quote(q.side);
    if (!q.sigma.empty())
        out += ", sigma = " + numbers_text(q.sigma, spec.count);
    if (!q.confidence.empty())
        out += ", confidence = " + quote(q.confidence);
    return out + ", source = " + quote(q.source) + " }";
}

// Lines "rest = ..." for every key of the table that starts with pattern, in the table's order.
void write_keys(const Document &d, const std::string &pattern, const std::string &prefix,
                std::string *out)
{
    for (const KeySpec &spec : key_table()) {
        const std::string key(spec.key);
        if (key.compare(0, pattern.size(), pattern) != 0)
            continue;
        const std::string rest = key.substr(pattern.size());
        const auto found = d.entries.find(prefix + rest);
        if (rest.find('#') == std::string::npos && found != d.entries.end())
            *out += rest + " = " + entry_text(found->second, spec) + "\n";
    }
}

void write_array(const Document &d, const std::string &joint, const std::string &name,
                 std::string *out)
{
    for (int i = 1; i <= d.count(joint + "." + name); i++) {
        *out += "\n[[joint." + name + "]]\n";
        write_keys(d, "joint.#." + name + ".#.", joint + "." + name + "." + std::to_string(i) + ".",
                   out);
    }
}

} // namespace

std::string write_document(const Document &d)
{
    std::string out =
        "# Arm model, format hdt-arm version 1.  SI units; every number with unit, source and\n"
        "# sigma or confidence.  Keys: docs/formats.md.\n";
    out += "format = \"hdt-arm\"\nversion = 1\n";
    const auto name = d.entries.find("name");
    if (name != d.entries.end())
        out += "name = " + quote(name->second.text) + "\n";
    out += "\n[sources]\n";
    for (auto entry = d.entries.lower_bound("sources.");
         entry != d.entries.end() && entry->first.compare(0, 8, "sources.") == 0; ++entry)
        out += entry->first.substr(8) + " = " + quote(entry->second.text) + "\n";
    for (const char *table : {"base", "control", "flange", "payload"}) {
        if (!d.has_below(table))
            continue;
        out += "\n[" + std::string(table) + "]\n";
        write_keys(d, std::string(table) + ".", std::string(table) + ".", &out);
    }
    for (int j = 1; j <= d.count("joint"); j++) {
        const std::string joint = "joint." + std::to_string(j);
        out += "\n[[joint]]\n";
        write_keys(d, "joint.#.", joint + ".", &out);
        write_array(d, joint, "kinematic_error", &out);
        write_array(d, joint, "ripple", &out);
        write_array(d, joint, "effect", &out);
    }
    return out;
}

void check_quantity(const Document &d, const std::string &key, const KeySpec &spec, int line,
                    Quantity *q)
{
    const auto wrong = [&](const std::string &expected, const std::string &found) {
        d.fail_at(line, key, "expected " + expected + ", found " + found);
    };
    const std::size_t count = static_cast<std::size_t>(spec.count);
    if (q->value.size() != count)
        wrong("value with " + std::to_string(count) + (count == 1 ? " number" : " numbers"),
              q->value.empty() ? "none" : std::to_string(q->value.size()));
    if (q->unit != spec.unit)
        wrong("unit " + quote(spec.unit), q->unit.empty() ? "no unit" : quote(q->unit));
    if (q->side.empty() && spec.side_required)
        q->side = spec.side;
    if (!q->side.empty() && q->side != spec.side)
        wrong(*spec.side ? "side = " + quote(spec.side) : "no side", "side = " + quote(q->side));
    if (q->source.empty())
        wrong("a source out of [sources]", "none");
    if (q->sigma.empty() && q->confidence.empty())
        wrong("sigma, or confidence = \"high\", \"medium\" or \"low\"", "neither");
    if (!q->sigma.empty() && q->sigma.size() != count)
        wrong("sigma with as many numbers as value (" + std::to_string(count) + ")",
              std::to_string(q->sigma.size()));
    if (!q->confidence.empty() && q->confidence != "high" && q->confidence != "medium"
        && q->confidence != "low")
        wrong("confidence \"high\", \"medium\" or \"low\"", quote(q->confidence));
    for (const double s : q->sigma)
        if (!std::isfinite(s) || s < 0)
            wrong("a finite sigma of at least 0", number_text(s));
    for (const double x : q->value) {
        if (!std::isfinite(x))
            wrong("a finite number", number_text(x));
        if (spec.range == Range::Positive && !(x > 0))
            wrong("a number above 0", number_text(x));
        if (spec.range == Range::NonNegative && !(x >= 0))
            wrong("a number of at least 0", number_text(x));
        if (spec.range == Range::Whole && !(x >= 1 && x <= 4096 && x == std::floor(x)))
            wrong("a whole number from 1 to 4096", number_text(x));
    }
}

} // namespace arm

struct ArmFile::Impl {
    arm::Document document;
    hdt_arm numbers;
};

namespace {

void sha256(const std::string &bytes, uint8_t digest[32])
{
    unsigned size = 0;
    if (EVP_Digest(bytes.data(), bytes.size(), digest, &size, EVP_sha256(), nullptr) != 1
        || size != 32)
        throw std::runtime_error("SHA-256 is not available in the installed libcrypto");
}

std::string read_all(const std::string &path)
{
    constexpr std::size_t limit = std::size_t(4) << 20;
    std::FILE *file = std::fopen(path.c_str(), "rb");
    if (!file)
        throw InputError(path + ": expected a readable model file, found: " + std::strerror(errno));
    std::string text;
    std::array<char, 65536> buffer;
    std::size_t got = 0;
    while (text.size() <= limit && (got = std::fread(buffer.data(), 1, buffer.size(), file)) > 0)
        text.append(buffer.data(), got);
    const int error = std::ferror(file) ? errno : 0;
    std::fclose(file);
    if (error)
        throw InputError(path + ": expected a readable model file, found: " + std::strerror(error));
    if (text.size() > limit)
        throw InputError(path + ": expected a model file of at most 4 MiB, found more");
    return text;
}

hdt_arm derive(const arm::Document &document, const std::string &text)
{
    hdt_arm numbers = arm::derive_arm(document);
    std::snprintf(numbers.path, sizeof numbers.path, "%s", document.path.c_str());
    sha256(text, numbers.digest);
    return numbers;
}

// The arrays on the way to key must have the table the key speaks of, or be one short of it.
void make_room(arm::Document *d, const std::string &key)
{
    for (std::size_t dot = key.find('.'); dot != std::string::npos; dot = key.find('.', dot + 1)) {
        const std::string array = key.substr(0, dot);
        if (!arm::is_array(array))
            continue;
        const std::size_t end = key.find('.', dot + 1);
        const int index = std::stoi(key.substr(dot + 1, end - dot - 1));
        const int have = d->count(array);
        if (index > have + 1)
            d->fail(key, "expected a table up to " + array + "." + std::to_string(have + 1)
                             + ", found " + std::to_string(index));
        d->arrays[array] = index > have ? index : have;
    }
}

const arm::KeySpec &need_spec(const arm::Document &d, const std::string &key, arm::Kind kind)
{
    const arm::KeySpec *spec = arm::find_spec(key);
    if (!spec) {
        const std::string near = arm::nearest(key);
        d.fail(key, "expected a key of format hdt-arm"
                        + (near.empty() ? "" : " (did you mean " + near + "?)") + ", found "
                        + arm::quote(key));
    }
    if ((spec->kind == arm::Kind::Number) != (kind == arm::Kind::Number))
        d.fail(key, spec->kind == arm::Kind::Number ? "expected a quantity, found a text"
                                                    : "expected a text, found a quantity");
    return *spec;
}

// Move everything below `from` to `to`.
void rename_below(arm::Document *d, const std::string &from, const std::string &to)
{
    const auto move_keys = [&](auto *map) {
        std::remove_reference_t<decltype(*map)> moved;
        for (auto it = map->lower_bound(from + ".");
             it != map->end() && it->first.compare(0, from.size() + 1, from + ".") == 0;
             it = map->erase(it))
            moved[to + it->first.substr(from.size())] = it->second;
        map->merge(moved);
    };
    move_keys(&d->entries);
    move_keys(&d->arrays);
    move_keys(&d->lines);
}

void erase_below(arm::Document *d, const std::string &key)
{
    const auto erase_keys = [&](auto *map) {
        map->erase(key);
        for (auto it = map->lower_bound(key + ".");
             it != map->end() && it->first.compare(0, key.size() + 1, key + ".") == 0;)
            it = map->erase(it);
    };
    erase_keys(&d->entries);
    erase_keys(&d->arrays);
    erase_keys(&d->lines);
}

} // namespace

ArmFile::ArmFile() : impl_(std::make_unique<Impl>()) {}
ArmFile::ArmFile(const ArmFile &other) : impl_(std::make_unique<Impl>(*other.impl_)) {}
ArmFile::~ArmFile() = default;

ArmFile &ArmFile::operator=(const ArmFile &other)
{
    *impl_ = *other.impl_;
    return *this;
}

ArmFile ArmFile::load(const std::string &path)
{
    return parse(read_all(path), path);
}

ArmFile ArmFile::parse(const std::string &text, const std::string &path)
{
    ArmFile file;
    file.impl_->document = arm::parse_document(text, path);
    file.impl_->numbers = derive(file.impl_->document, text);
    return file;
}

const hdt_arm &ArmFile::arm() const
{
    return impl_->numbers;
}

void ArmFile::set(const std::string &key, const Quantity &q)
{
    arm::Document &d = impl_->document;
    const arm::KeySpec &spec = need_spec(d, key, arm::Kind::Number);
    arm::Entry entry;
    entry.quantity = q;
    arm::check_quantity(d, key, spec, 0, &entry.quantity);
    make_room(&d, key);
    d.entries[key] = entry;
}

void ArmFile::set_text(const std::string &key, const std::string &text)
{
    arm::Document &d = impl_->document;
    const arm::KeySpec &spec = need_spec(d, key, arm::Kind::Text);
    arm::Entry entry;
    entry.kind = spec.kind;
    entry.text = text;
    if (spec.kind == arm::Kind::Flag) {
        if (text != "true" && text != "false")
            d.fail(key, "expected true or false, found " + arm::quote(text));
        entry.flag = text == "true";
    }
    make_room(&d, key);
    d.entries[key] = entry;
}

void ArmFile::append(const std::string &array_key,
                     const std::vector<std::pair<std::string, std::string>> &texts,
                     const std::vector<std::pair<std::string, Quantity>> &quantities)
{
    if (!arm::is_array(array_key))
        impl_->document.fail(array_key, "expected an array of tables, found another key");
    // all or nothing: a refused quantity must not leave half a table behind
    ArmFile changed(*this);
    const std::string table = array_key + "." + std::to_string(count(array_key) + 1);
    for (const auto &[name, text] : texts)
        changed.set_text(table + "." + name, text);
    for (const auto &[name, quantity] : quantities)
        changed.set(table + "." + name, quantity);
    *this = changed;
}

bool ArmFile::has(const std::string &key) const
{
    return impl_->document.has(key) || impl_->document.has_below(key);
}

int ArmFile::count(const std::string &array_key) const
{
    return impl_->document.count(array_key);
}

int ArmFile::line_of(const std::string &key) const
{
    return impl_->document.line_of(key);
}

int ArmFile::find(const std::string &array_key, const std::string &id) const
{
    for (int i = 1; i <= count(array_key); i++)
        if (get_text(array_key + "." + std::to_string(i) + ".id") == id)
            return i;
    return 0;
}

Quantity ArmFile::get(const std::string &key) const
{
    const auto found = impl_->document.entries.find(key);
    if (found == impl_->document.entries.end() || found->second.kind != arm::Kind::Number)
        impl_->document.fail(key, "expected a quantity, found nothing");
    return found->second.quantity;
}

std::string ArmFile::get_text(const std::string &key) const
{
    const auto found = impl_->document.entries.find(key);
    if (found == impl_->document.entries.end() || found->second.kind == arm::Kind::Number)
        impl_->document.fail(key, "expected a text, found nothing");
    const arm::Entry &entry = found->second;
    if (entry.kind == arm::Kind::Flag)
        return entry.flag ? "true" : "false";
    return entry.text;
}

void ArmFile::erase(const std::string &key)
{
    arm::Document &d = impl_->document;
    erase_below(&d, key);
    const std::size_t dot = key.rfind('.');
    if (dot == std::string::npos || !arm::is_array(key.substr(0, dot)))
        return;
    // later tables of the array move up by one
    const std::string array = key.substr(0, dot);
    const int index = std::atoi(key.c_str() + dot + 1), last = d.count(array);
    if (index < 1 || index > last)
        return;
    for (int i = index; i < last; i++)
        rename_below(&d, array + "." + std::to_string(i + 1), array + "." + std::to_string(i));
    d.arrays[array] = last - 1;
}

void ArmFile::refresh()
{
    impl_->numbers = derive(impl_->document, text());
}

std::string ArmFile::text() const
{
    return arm::write_document(impl_->document);
}

void ArmFile::save(const std::string &path) const
{
    write_file(path, text());
}

} // namespace hdt
