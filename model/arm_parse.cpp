// SPDX-License-Identifier: Apache-2.0
//
// TOML text to document: every key known, every quantity complete, every error with its line.
//
// Owns: the messages about syntax, types, units, fields.
// Never: relates one key to another (arm_derive.cpp does).
#include "model/arm_document.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "model/toml_parser.hpp"

namespace hdt::arm {

namespace {

int line_of(const toml::node &node)
{
    return static_cast<int>(node.source().begin.line);
}

// What stands there, in words short enough for one line.
std::string describe(const toml::node &node)
{
    if (const auto *text = node.as_string()) {
        std::string shown = text->get().substr(0, 40);
        return "the text " + quote(shown) + (shown.size() < text->get().size() ? "..." : "");
    }
    if (const auto *whole = node.as_integer())
        return std::to_string(whole->get());
    if (const auto *real = node.as_floating_point())
        return number_text(real->get());
    if (const auto *flag = node.as_boolean())
        return flag->get() ? "true" : "false";
    if (const auto *array = node.as_array())
        return "an array of " + std::to_string(array->size());
    return node.is_table() ? "a table" : "a date or time";
}

bool number_of(const toml::node &node, double *out)
{
    if (const auto *whole = node.as_integer())
        *out = static_cast<double>(whole->get());
    else if (const auto *real = node.as_floating_point())
        *out = real->get();
    else
        return false;
    return true;
}

struct Parser {
    Document d;

    void numbers(const toml::node &node, const std::string &key, const std::string &field,
                 int count, std::vector<double> *out)
    {
        const std::string wanted =
            field + " "
            + (count == 1 ? std::string("a number")
                          : "an array of " + std::to_string(count) + " numbers");
        double x = 0;
        if (count == 1) {
            if (!number_of(node, &x))
                d.fail_at(line_of(node), key, "expected " + wanted + ", found " + describe(node));
            out->push_back(x);
            return;
        }
        const toml::array *array = node.as_array();
        if (!array || array->size() != static_cast<std::size_t>(count))
            d.fail_at(line_of(node), key, "expected " + wanted + ", found " + describe(node));
        for (const toml::node &element : *array) {
            if (!number_of(element, &x))
                d.fail_at(line_of(element), key,
                          "expected " + wanted + ", found " + describe(element) + " in it");
            out->push_back(x);
        }
    }

    std::string text(const toml::node &node, const std::string &key, const std::string &field)
    {
        const auto *value = node.as_string();
        if (!value)
            d.fail_at(line_of(node), key, "expected " + field + "a text, found " + describe(node));
        return value->get();
    }

    void quantity(const toml::node &node, const std::string &key, const KeySpec &spec)
    {
        const toml::table *fields = node.as_table();
        if (!fields)
            d.fail_at(line_of(node), key,
                      std::string("expected { value, unit = \"") + spec.unit
                          + "\", sigma or confidence, source }, found " + describe(node));
        Quantity q;
        static const std::vector<std::string> known = {"value",      "unit",   "sigma",
                                                       "confidence", "source", "side"};
        for (const auto &[name, field] : *fields) {
            const std::string field_name(name.str());
            if (field_name == "value")
                numbers(field, key, "value", spec.count, &q.value);
            else if (field_name == "sigma")
                numbers(field, key, "sigma", spec.count, &q.sigma);
            else if (field_name == "unit")
                q.unit = text(field, key, "unit ");
            else if (field_name == "source")
                q.source = text(field, key, "source ");
            else if (field_name == "side")
                q.side = text(field, key, "side ");
            else if (field_name == "confidence")
                q.confidence = text(field, key, "confidence ");
            else
                unknown_field(field, key, field_name, known);
        }
        // a side left out must not pass as if it had been said
        if (spec.side_required && q.side.empty())
            d.fail_at(line_of(node), key,
                      std::string("expected side = \"") + spec.side + "\", found no side");
        check_quantity(d, key, spec, line_of(node), &q);
        Entry entry;
        entry.quantity = q;
        d.entries[key] = entry;
    }

    [[noreturn]] void unknown_field(const toml::node &node, const std::string &key,
                                    const std::string &name, const std::vector<std::string> &known)
    {
        const std::string near = nearest_of(name.substr(0, 64), known);
        d.fail_at(line_of(node), key,
                  "expected the fields value, unit, sigma, confidence, source, side, found "
                      + quote(name.substr(0, 40))
                      + (near.empty() ? "" : " (did you mean " + near + "?)"));
    }

    void leaf(const toml::node &node, const std::string &key, const KeySpec &spec)
    {
        d.lines[key] = line_of(node);
        Entry entry;
        entry.kind = spec.kind;
        if (spec.kind == Kind::Number) {
            quantity(node, key, spec);
        } else if (spec.kind == Kind::Text) {
            entry.text = text(node, key, "");
            d.entries[key] = entry;
        } else {
            const auto *flag = node.as_boolean();
            if (!flag)
                d.fail_at(line_of(node), key, "expected true or false, found " + describe(node));
            entry.flag = flag->get();
            d.entries[key] = entry;
        }
    }

    void version(const toml::node &node)
    {
        const auto *number = node.as_integer();
        if (!number || number->get() != 1)
            d.fail_at(line_of(node), "version",
                      "expected 1, the version this program reads, found " + describe(node));
    }

    void array(const toml::node &node, const std::string &key)
    {
        const toml::array *tables = node.as_array();
        if (!tables)
            d.fail_at(line_of(node), key,
                      "expected an array of tables [[" + key.substr(key.rfind('.') + 1)
                          + "]], found " + describe(node));
        int index = 0;
        for (const toml::node &element : *tables) {
            const std::string element_key = key + "." + std::to_string(++index);
            if (!element.is_table())
                d.fail_at(line_of(element), element_key,
                          "expected a table, found " + describe(element));
            if (key == "joint" && index > HDT_ARM_JOINTS_MAX)
                d.fail_at(line_of(element), key,
                          "expected at most " + std::to_string(HDT_ARM_JOINTS_MAX)
                              + " joints, found " + std::to_string(tables->size()));
            if (key != "joint" && index > 64)
                d.fail_at(line_of(element), key,
                          "expected at most 64 tables, found " + std::to_string(tables->size()));
            d.lines[element_key] = line_of(element);
            walk(*element.as_table(), element_key);
        }
        d.arrays[key] = index;
    }

    void walk(const toml::table &table, const std::string &prefix)
    {
        for (const auto &[name, node] : table) {
            const std::string key = (prefix.empty() ? "" : prefix + ".") + std::string(name.str());
            const KeySpec *spec = find_spec(key);
            if (key == "version") {
                version(node);
            } else if (spec) {
                leaf(node, key, *spec);
            } else if (is_array(key)) {
                d.lines[key] = line_of(node);
                array(node, key);
            } else if (is_table(key)) {
                d.lines[key] = line_of(node);
                if (!node.is_table())
                    d.fail_at(line_of(node), key, "expected a table, found " + describe(node));
                walk(*node.as_table(), key);
            } else {
                unknown_key(node, prefix, std::string(name.str()));
            }
        }
    }

    [[noreturn]] void unknown_key(const toml::node &node, const std::string &prefix,
                                  const std::string &name)
    {
        const std::string shown = name.substr(0, 40);
        if (prefix == "sources")
            d.fail_at(line_of(node), prefix,
                      "expected source names of letters, digits, '_' and '-', found "
                          + quote(shown));
        const std::string near = nearest((prefix.empty() ? "" : prefix + ".") + name);
        d.fail_at(line_of(node), prefix.empty() ? shown : prefix + "." + shown,
                  "expected a key of format hdt-arm"
                      + (near.empty() ? "" : " (did you mean " + near + "?)") + ", found "
                      + quote(shown));
    }
};

// Lines up to and with the given one.
std::string_view first_lines(const std::string &text, std::size_t lines)
{
    std::size_t end = 0;
    for (; lines > 0 && end < text.size(); lines--)
        end = std::min(text.find('\n', end), text.size() - 1) + 1;
    return std::string_view(text).substr(0, end);
}

bool parser_gives_up(std::string_view text)
{
    try {
        static_cast<void>(toml::parse(text));
    } catch (const TomlAssert &) {
        return true;
    } catch (const toml::parse_error &) {
    }
    return false;
}

// The parser reads on and on, so every beginning with the bad line in it fails, and none without.
int line_of_giving_up(const std::string &text)
{
    std::size_t good = 0,
                bad = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n')) + 1;
    while (bad - good > 1) {
        const std::size_t middle = good + (bad - good) / 2;
        (parser_gives_up(first_lines(text, middle)) ? bad : good) = middle;
    }
    return static_cast<int>(bad);
}

} // namespace

Document parse_document(const std::string &text, const std::string &path)
{
    Parser parser;
    parser.d.path = path;
    toml::table root;
    try {
        root = toml::parse(std::string_view(text), std::string_view(path));
    } catch (const toml::parse_error &error) {
        parser.d.fail_at(static_cast<int>(error.source().begin.line), "TOML",
                         "expected valid TOML, found: " + std::string(error.description()));
    } catch (const TomlAssert &error) {
        parser.d.fail_at(line_of_giving_up(text), "TOML",
                         std::string("expected valid TOML, found: ") + error.what());
    }
    // the format before anything else: a foreign file should say that it is one
    const auto *format = root["format"].as_string();
    if (!format || format->get() != "hdt-arm") {
        const toml::node *node = root.get("format");
        parser.d.fail_at(node ? line_of(*node) : 0, "format",
                         "expected \"hdt-arm\", found "
                             + (node ? describe(*node) : std::string("nothing")));
    }
    if (!root.get("version"))
        parser.d.fail_at(0, "version", "expected 1, found nothing");
    parser.version(*root.get("version"));
    parser.walk(root, "");
    return parser.d;
}

} // namespace hdt::arm
