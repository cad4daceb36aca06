// SPDX-License-Identifier: Apache-2.0
//
// Foreign tables brought to our columns by a map (docs/formats.md, "Import map").
//
// Owns: the map's schema and errors; reading tables laid out by others.
// Never: knows a robot: everything about one is in its map.
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "model/log.hpp"
#include "model/text.hpp"
#include "model/toml_parser.hpp"

namespace hdt {
namespace {

constexpr int map_version = 1;

// One of the foreign files and how it is laid out.
struct Source {
    std::string id, path;
    char separator = ',';
    bool header = true;
    std::size_t per_row = 0;       // not 0: values in order, so many make a row; no header
    std::vector<std::size_t> line; // of each row read, for messages
    std::string complaint;         // about the first row with a bad number, and which that is:
    std::size_t bad_row = 0;       // the map may leave it out
};

// One of our columns and where its numbers come from.
struct Target {
    std::string name, place;       // place: "map:line: columns.q1_rad" for messages
    std::size_t source = 0;
    std::string column;            // by name, or
    std::size_t index = 0;         // by number from 1; after the header is read, always set
    double scale = 1, offset = 0;
    std::vector<double> values;
};

struct Map {
    std::string path;
    std::vector<Source> sources;
    std::vector<Target> targets;
    std::vector<std::pair<std::string, std::string>> constants;
    std::size_t joints = 0, drop_last = 0;
    bool shortest = false;
};

// A node of the map with the words to complain about it.
struct Key {
    const Map &map;
    const toml::node *node;
    std::string name;

    std::string place() const
    {
        const auto line = node ? node->source().begin.line : 0;
        return (line ? at(map.path, line) : map.path) + ": " + name;
    }
    [[noreturn]] void expected(const std::string &what) const
    {
        throw InputError(place() + ": expected " + what);
    }
    std::string text() const
    {
        const auto *value = node ? node->as_string() : nullptr;
        if (!value)
            expected("a text in quotes");
        return value->get();
    }
    double number() const
    {
        const auto value = node ? node->value<double>() : std::nullopt;
        if (!value || node->is_boolean() || !std::isfinite(*value))
            expected("a finite number");
        return *value;
    }
    std::size_t count(std::int64_t least, std::int64_t most) const
    {
        const auto *value = node ? node->as_integer() : nullptr;
        if (!value || value->get() < least || value->get() > most)
            expected("a whole number from " + std::to_string(least) + " to " +
                     std::to_string(most));
        return static_cast<std::size_t>(value->get());
    }
    bool truth() const
    {
        const auto *value = node ? node->as_boolean() : nullptr;
        if (!value)
            expected("true or false");
        return value->get();
    }
    const toml::table &table() const
    {
        if (!node || !node->is_table())
            expected("a table");
        return *node->as_table();
    }
    Key operator[](std::string_view key) const
    {
        return {map, table().get(key), name.empty() ? std::string(key)
                                                    : name + "." + std::string(key)};
    }
    explicit operator bool() const { return node != nullptr; }

    void only(std::initializer_list<std::string_view> known) const
    {
        for (const auto &[key, value] : table()) {
            if (std::find(known.begin(), known.end(), key.str()) != known.end())
                continue;
            std::string list;
            for (const std::string_view k : known)
                list += (list.empty() ? "" : ", ") + std::string(k);
            (*this)[key.str()].expected("one of " + list + "; this key is not known");
        }
    }
};

// Steps from one word to another, capitals alike: to say which name was probably meant.
std::size_t edit_distance(const std::string &a, const std::string &b)
{
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j)
        row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const bool same = std::tolower(static_cast<unsigned char>(a[i - 1])) ==
                              std::tolower(static_cast<unsigned char>(b[j - 1]));
            const std::size_t changed = diagonal + (same ? 0 : 1);
            diagonal = row[j];
            row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
        }
    }
    return row[b.size()];
}

std::string near_names(const std::string &wanted, const std::vector<std::string> &names)
{
    std::vector<std::pair<std::size_t, std::string>> order;
    for (const std::string &name : names)
        order.emplace_back(edit_distance(wanted, name), name);
    std::stable_sort(order.begin(), order.end(),
                     [](const auto &a, const auto &b) { return a.first < b.first; });
    std::string out;
    for (std::size_t i = 0; i < std::min<std::size_t>(3, order.size()); ++i)
        out += (i ? ", " : "") + shown(order[i].second);
    return out;
}

// name with {j} put in; false when it has none
bool put_joint(std::string &name, std::size_t joint)
{
    const std::size_t mark = name.find("{j}");
    if (mark == std::string::npos)
        return false;
    name.replace(mark, 3, std::to_string(joint));
    return true;
}

void read_source(const Key &key, Map &map)
{
    key.only({"id", "name", "separator", "header", "per_row"});
    Source source;
    source.id = key["id"] ? key["id"].text() : "";
    source.path = key["name"] ? key["name"].text() : "";
    if (const Key separator = key["separator"]) {
        const std::string text = separator.text();
        if (text.size() != 1 || !std::strchr(",;\t |:", text[0]))
            separator.expected("one of \",\" \";\" \"\\t\" \" \" \"|\" \":\"");
        source.separator = text[0];
    }
    source.header = !key["header"] || key["header"].truth();
    if (const Key per_row = key["per_row"]) {
        source.per_row = per_row.count(1, 10000);
        if (key["header"] && source.header)
            per_row.expected("no header where per_row is given");
        source.header = false;
    }
    for (const Source &other : map.sources)
        if (other.id == source.id)
            key["id"].expected("a name of its own for each file");
    map.sources.push_back(source);
}

void read_sources(const Key &root, Map &map)
{
    const Key files = root["file"];
    if (!files) {
        map.sources.emplace_back();
        return;
    }
    const auto *list = files.node->as_array();
    if (!list || list->empty() || !list->is_array_of_tables())
        files.expected("tables, one [[file]] for each foreign file");
    for (const toml::node &node : *list)
        read_source({map, &node, "file"}, map);
    for (const Source &source : map.sources)
        if (map.sources.size() > 1 && (source.path.empty() || source.id.empty()))
            files.expected("an id and a name for each of several files");
}

void read_constants(const Key &root, Map &map)
{
    const Key constants = root["constants"];
    if (!constants)
        return;
    for (const auto &[name, node] : constants.table()) {
        const Key key = constants[name.str()];
        std::string text;
        if (node.is_string())
            text = key.text();
        else if (const auto *list = node.as_array())
            for (const toml::node &item : *list) {
                text += text.empty() ? "" : " ";
                append_number(text, Key{map, &item, key.name}.number());
            }
        else
            append_number(text, key.number());
        map.constants.emplace_back(name.str(), text);
    }
}

// scale, offset, sign: one number, or one per joint where the key has {j}.
double per_joint(const Key &key, std::size_t joint, std::size_t joints, double fallback)
{
    if (!key)
        return fallback;
    const auto *list = key.node->as_array();
    if (!list)
        return key.number();
    if (joint == 0 || list->size() != joints)
        key.expected(joint == 0 ? "one number where the column has no {j}"
                                : std::to_string(joints) + " numbers, one per joint");
    return Key{key.map, list->get(joint - 1), key.name}.number();
}

// joint 0: the column is not one of a numbered family
Target read_target(const Key &key, const std::string &name, std::size_t joint, const Map &map)
{
    Target target;
    target.name = name;
    target.place = key.place();
    if (const Key file = key["file"]) {
        const std::string id = file.text();
        while (target.source < map.sources.size() && map.sources[target.source].id != id)
            ++target.source;
        if (target.source == map.sources.size())
            file.expected("the id of a [[file]], found " + shown(id));
    } else if (map.sources.size() > 1) {
        key.expected("file = \"...\", since the map has several files");
    }
    const Source &source = map.sources[target.source];
    const Key column = key["column"];
    if (column && column.node->is_integer()) {
        target.index = column.count(1, 10000) + (joint ? joint - 1 : 0);
    } else {
        target.column = column.text();
        if (!source.header)
            column.expected("a column number, since the file has no header");
        if (joint && !put_joint(target.column, joint))
            column.expected("{j} in the column name, as in the key");
    }
    const double sign = per_joint(key["sign"], joint, map.joints, 1);
    if (sign != 1 && sign != -1)
        key["sign"].expected("1 or -1");
    target.scale = sign * per_joint(key["scale"], joint, map.joints, 1);
    target.offset = per_joint(key["offset"], joint, map.joints, 0);
    return target;
}

void read_targets(const Key &root, Map &map)
{
    const Key columns = root["columns"];
    Run scratch; // knows which units our columns have
    for (const auto &[name, node] : columns.table()) {
        const Key key = columns[name.str()];
        key.only({"file", "column", "scale", "offset", "sign"});
        const bool family = name.str().find("{j}") != std::string::npos;
        if (family && map.joints == 0)
            key.expected("joints = N at the top of the map, since the key has {j}");
        for (std::size_t j = family ? 1 : 0; j <= (family ? map.joints : 0); ++j) {
            std::string full(name.str());
            put_joint(full, j);
            try {
                run_column(scratch, full);
            } catch (const InputError &error) {
                throw InputError(key.place() + ": " + error.what());
            }
            for (const Target &other : map.targets)
                if (other.name == full)
                    key.expected("each column once; " + shown(full) + " is given twice");
            map.targets.push_back(read_target(key, full, j, map));
        }
    }
    if (std::none_of(map.targets.begin(), map.targets.end(),
                     [](const Target &t) { return t.name == "t_s"; }))
        columns.expected("a column t_s (time in seconds)");
}

Map read_map(const std::string &path)
{
    Map map;
    map.path = path;
    toml::table root_table;
    try {
        root_table = toml::parse(read_text(path), path);
    } catch (const toml::parse_error &error) {
        throw InputError(at(path, error.source().begin.line) +
                         ": expected valid TOML, found: " + printable(error.description()));
    } catch (const TomlAssert &error) {
        throw InputError(path + ": expected valid TOML, found: " + error.what());
    }
    const Key root{map, &root_table, ""};
    root.only({"format", "version", "name", "joints", "drop_last", "shortest", "file",
               "constants", "columns"});
    if (!root["format"] || root["format"].text() != "hdt-import")
        root["format"].expected("\"hdt-import\"; is this an import map?");
    if (!root["version"] || root["version"].number() != map_version)
        root["version"].expected(std::to_string(map_version) +
                                 ", the version this program reads");
    if (root["joints"])
        map.joints = root["joints"].count(1, HDT_ARM_JOINTS_MAX);
    if (root["drop_last"])
        map.drop_last = root["drop_last"].count(0, 1000000000);
    map.shortest = root["shortest"] && root["shortest"].truth();
    read_sources(root, map);
    read_constants(root, map);
    read_targets(root, map);
    return map;
}

// Names of the columns into numbers, for the targets that want this source.
void resolve(const Source &source, std::string_view header, std::vector<Target *> &wanted)
{
    std::vector<std::string_view> fields;
    split(header, source.separator, fields);
    std::vector<std::string> names;
    for (std::string_view field : fields) {
        if (field.size() > 1 && field.front() == '"' && field.back() == '"')
            field = field.substr(1, field.size() - 2);
        names.emplace_back(field);
    }
    for (Target *target : wanted) {
        if (target->index)
            continue;
        const auto found = std::find(names.begin(), names.end(), target->column);
        if (found == names.end())
            throw InputError(target->place + ": column " + shown(target->column) +
                             " is not in " + at(source.path, 1) + "; nearest there: " +
                             near_names(target->column, names));
        if (std::find(found + 1, names.end(), target->column) != names.end())
            throw InputError(target->place + ": column " + shown(target->column) +
                             " is twice in " + at(source.path, 1) + "; give its number");
        target->index = static_cast<std::size_t>(found - names.begin()) + 1;
    }
}

// One row's fields into the targets; line is where the row ends.
void take_row(Source &source, std::size_t line, const std::vector<std::string_view> &fields,
              const std::vector<Target *> &wanted)
{
    for (Target *target : wanted) {
        double value;
        if (target->index > fields.size())
            throw InputError(target->place + ": expected at least " +
                             std::to_string(target->index) + " columns in " +
                             at(source.path, line) + ", found " + std::to_string(fields.size()));
        if (!parse_number(fields[target->index - 1], value)) {
            value = 0;
            if (source.complaint.empty()) {
                source.bad_row = source.line.size();
                source.complaint = at(source.path, line) + ": column " +
                                   (target->column.empty() ? std::to_string(target->index)
                                                           : shown(target->column)) +
                                   ": expected a finite number, found " +
                                   shown(fields[target->index - 1]);
            }
        }
        target->values.push_back(target->scale * value + target->offset);
    }
    source.line.push_back(line);
}

// A last line without its newline may be a number cut short: taken only where it is dropped anyway.
void read_table(Source &source, std::vector<Target *> &wanted, std::size_t drop_last)
{
    const std::string text = read_text(source.path);
    LineReader lines(text);
    std::string_view line;
    std::vector<std::string_view> fields, row;
    std::size_t width = source.per_row;
    if (source.header) {
        if (!lines.next(line))
            throw InputError(source.path + ": expected a header line, found an empty file");
        resolve(source, line, wanted);
        split(line, source.separator, fields);
        width = fields.size();
    }
    while (lines.next(line)) {
        if (trim(line).empty())
            continue;
        if (!lines.ended() && drop_last == 0)
            throw InputError(at(source.path, lines.number()) +
                             ": the file ends inside a line; was it cut short? end it with a newline if it "
                             "is whole, or leave it out by drop_last = 1 in the map");
        split(line, source.separator, fields);
        row.insert(row.end(), fields.begin(), fields.end());
        width = width ? width : row.size();
        if (source.per_row && row.size() < width)
            continue;
        if (row.size() != width)
            throw InputError(at(source.path, lines.number()) + ": expected " +
                             std::to_string(width) + " fields" +
                             (source.header ? " as in the header" : " a row") + ", found " +
                             std::to_string(row.size()));
        take_row(source, lines.number(), row, wanted);
        row.clear();
    }
    if (!row.empty())
        throw InputError(at(source.path, lines.number()) + ": expected " +
                         std::to_string(width) + " values for each row, found " +
                         std::to_string(row.size()) + " for the last; is the file whole?");
}

// The same number of rows everywhere, or by the map's leave as many as the shortest has; none of
// them bad.
std::size_t common_rows(const Map &map)
{
    std::size_t rows = map.sources[0].line.size();
    for (const Source &source : map.sources) {
        if (source.line.size() != rows && !map.shortest)
            throw InputError(source.path + ": expected " + std::to_string(rows) +
                             " rows as in " + map.sources[0].path + ", found " +
                             std::to_string(source.line.size()));
        rows = std::min(rows, source.line.size());
    }
    if (rows <= map.drop_last)
        throw InputError(map.sources[0].path + ": expected more than " +
                         std::to_string(map.drop_last) + " rows, found " + std::to_string(rows));
    rows -= map.drop_last;
    for (const Source &source : map.sources)
        if (!source.complaint.empty() && source.bad_row < rows)
            throw InputError(source.complaint);
    return rows;
}

void check_time(const Map &map, const Run &run)
{
    for (const Target &target : map.targets) {
        if (target.name != "t_s")
            continue;
        const Source &source = map.sources[target.source];
        for (std::size_t r = 1; r < run.t_s.size(); ++r)
            if (!(run.t_s[r] > run.t_s[r - 1]))
                throw InputError(at(source.path, source.line[r]) + ": time must advance: " +
                                 std::to_string(run.t_s[r]) + " s after " +
                                 std::to_string(run.t_s[r - 1]) + " s");
    }
}

} // namespace

Run convert_run(const std::string &map_path, const std::string &foreign_path)
{
    namespace fs = std::filesystem;
    Map map = read_map(map_path);
    std::error_code ignored;
    const fs::path foreign(foreign_path);
    const fs::path dir = fs::is_directory(foreign, ignored) ? foreign : foreign.parent_path();
    for (std::size_t s = 0; s < map.sources.size(); ++s) {
        Source &source = map.sources[s];
        source.path = source.path.empty() ? foreign_path : (dir / source.path).string();
        std::vector<Target *> wanted;
        for (Target &target : map.targets)
            if (target.source == s)
                wanted.push_back(&target);
        read_table(source, wanted, map.drop_last);
    }
    const std::size_t rows = common_rows(map);
    Run run;
    run.path = foreign_path;
    run.constants.insert(map.constants.begin(), map.constants.end());
    for (Target &target : map.targets) {
        target.values.resize(rows);
        run_column(run, target.name) = std::move(target.values);
    }
    check_time(map, run);
    finish_run(run);
    return run;
}

} // namespace hdt
