// SPDX-License-Identifier: Apache-2.0
//
// A measured run as CSV: read and checked, cut, written.
//
// Owns: the CSV log contract of docs/formats.md, both ways.
// Never: interprets torque; no filtering, no decimation.
#include "model/log.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <set>

#include "model/files.hpp"
#include "model/text.hpp"

namespace hdt {
namespace {

using Series = std::vector<double>;
using Joint = Run::Joint;

// The columns whose meaning we know, <stem><joint>_<unit>, in the order they are written.
struct Known { const char *stem, *unit; Series Joint::*series; };
constexpr Known known_columns[] = {
    {"q", "rad", &Joint::q_rad},
    {"tau", "nm", &Joint::tau_nm},
    {"v", "radps", &Joint::v_radps},
    {"qref", "rad", &Joint::qref_rad},
    {"vref", "radps", &Joint::vref_radps},
    {"aref", "radps2", &Joint::aref_radps2},
    {"temp", "degc", &Joint::temp_degc},
};

std::string column_name(const Known &known, std::size_t joint)
{
    return known.stem + std::to_string(joint + 1) + "_" + known.unit;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// One name in the header, read.  known is null for t_s and for columns of no known meaning.
struct Column { const Known *known = nullptr; std::size_t joint = 0; };

// Throws InputError without the place; the caller puts it in front.
Column parse_column(std::string_view name)
{
    std::size_t stem_end = 0, number_end;
    while (stem_end < name.size() && !is_digit(name[stem_end]))
        ++stem_end;
    for (number_end = stem_end; number_end < name.size() && is_digit(name[number_end]);)
        ++number_end;
    const std::string_view stem = name.substr(0, stem_end);
    const std::string_view unit = name.substr(number_end);
    for (const Known &known : known_columns) {
        if (stem != known.stem || stem_end == number_end)
            continue;
        const std::string digits(name.substr(stem_end, number_end - stem_end));
        const int joint = digits.size() > 3 ? 0 : std::atoi(digits.c_str());
        if (joint < 1 || joint > HDT_ARM_JOINTS_MAX || digits[0] == '0')
            throw InputError("column " + shown(name) + ": expected a joint number from 1 to " +
                             std::to_string(HDT_ARM_JOINTS_MAX) + ", found " + shown(digits));
        const std::string expected = column_name(known, static_cast<std::size_t>(joint - 1));
        if (name != expected)
            throw InputError("column " + shown(name) + ": expected " + shown(expected) +
                             ", found unit " + shown(unit) +
                             "; convert the values and rename the column, or import with a map");
        return {&known, static_cast<std::size_t>(joint - 1)};
    }
    if (name == "t_ms" || name == "t_us" || name == "t_ns")
        throw InputError("column " + shown(name) + ": expected 't_s', found unit " +
                         shown(name.substr(2)) + "; convert the time to seconds");
    return {};
}

Series &slot(Run &run, const Column &column, const std::string &name)
{
    if (column.known)
        return run.joint[column.joint].*column.known->series;
    return name == "t_s" ? run.t_s : run.extra[name];
}

bool is_key(std::string_view key)
{
    return !key.empty() && std::all_of(key.begin(), key.end(), [](char c) {
        return is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' ||
               c == '.' || c == '-';
    });
}

constexpr const char *log_format = "hdt-log", *log_version = "1";

// These two are about the file, not the run: checked here, written again by write_run.
bool is_file_constant(const std::string &place, const std::string &key, std::string_view value)
{
    if (key != "format" && key != "version")
        return false;
    const std::string expected = key == "format" ? log_format : log_version;
    if (value != expected)
        throw InputError(place + ": log " + key + ": this program reads " + shown(expected) +
                         ", found " + shown(value) + "; use the program that wrote it");
    return true;
}

// The constants that every reader uses: a bad one is found at its own line.  ratio stands for ratio1, ...
struct KnownConstant {
    const char *quantity, *unit;
    std::size_t count;
    double least, most;
    const char *range;
};
constexpr KnownConstant known_constants[] = {
    {"payload", "_kg", 1, 0, 1000, "0 to 1000"},
    {"payload_com", "_m", 3, -10, 10, "-10 to 10"},
    {"ratio", "", 1, 1e-6, 1e6, "above 0 to 1000000"},
};

bool is_known(const KnownConstant &known, const std::string &key)
{
    const std::string_view ratio = "ratio";
    if (known.quantity != ratio)
        return key == std::string(known.quantity) + known.unit;
    return key.size() > ratio.size() && key.compare(0, ratio.size(), ratio) == 0 &&
           std::all_of(key.begin() + static_cast<std::ptrdiff_t>(ratio.size()), key.end(), is_digit);
}

// A known quantity under a name that leaves its unit out or has another: nobody would read it.
void check_unit(const std::string &place, const std::string &key)
{
    static const std::set<std::string> units = {"",   "_g", "_kg", "_mg", "_lb", "_lbs", "_oz", "_t",
                                                "_n", "_m", "_mm", "_cm", "_dm", "_um",  "_in", "_ft"};
    for (const KnownConstant &known : known_constants) {
        const std::string quantity = known.quantity, unit = known.unit;
        if (unit.empty() || key.compare(0, quantity.size(), quantity) != 0)
            continue;
        const std::string found = key.substr(quantity.size());
        if (found != unit && units.count(found))
            throw InputError(place + ": constant " + shown(key) + ": expected " + shown(quantity + unit) +
                             ", found " + (found.empty() ? "no unit" : "unit " + shown(found.substr(1))) +
                             "; convert the value and rename the constant");
    }
}

void check_known_constant(const std::string &place, const Run &run, const std::string &key)
{
    check_unit(place, key);
    for (const KnownConstant &known : known_constants) {
        if (!is_known(known, key))
            continue;
        std::vector<double> found;
        try {
            found = run.constant_vector(key);
        } catch (const InputError &) {
            // said below, with its line
        }
        const bool inside = std::all_of(found.begin(), found.end(),
                                        [&](double x) { return x >= known.least && x <= known.most; });
        if (found.size() != known.count || !inside)
            throw InputError(place + ": constant '" + key + "': expected " + std::to_string(known.count) +
                             (known.count == 1 ? " number" : " numbers") +
                             (inside ? "" : std::string(", ") + known.range) + ", found " +
                             shown(run.constants.at(key)));
    }
}

// "# key = value"; anything else after # is a remark.
void read_constant(const std::string &place, std::string_view line, Run &run)
{
    line.remove_prefix(1);
    const std::size_t equal = line.find('=');
    if (equal == std::string_view::npos || !is_key(trim(line.substr(0, equal))))
        return;
    const std::string key(trim(line.substr(0, equal)));
    if (is_file_constant(place, key, trim(line.substr(equal + 1))))
        return;
    if (!run.constants.emplace(key, trim(line.substr(equal + 1))).second)
        throw InputError(place + ": constant " + shown(key) + " is given twice");
    check_known_constant(place, run, key);
}

// Where each column's numbers go, and the name it had.
struct Layout {
    std::vector<std::string> name;
    std::vector<Series *> series;
    std::size_t time = 0;
};

void check_complete(const std::string &place, Run &run, const std::set<std::string> &names)
{
    bool any = false;
    for (std::size_t j = 0; j < run.joint.size(); ++j) {
        run.joint[j].present = names.count(column_name(known_columns[0], j)) &&
                               names.count(column_name(known_columns[1], j));
        any = any || run.joint[j].present;
    }
    if (!any)
        throw InputError(place + ": expected at least one joint with both position and torque "
                                 "(q1_rad and tau1_nm), found none");
}

Layout read_header(const std::string &place, std::string_view line, Run &run)
{
    std::vector<std::string_view> fields;
    split(line, ',', fields);
    Layout layout;
    std::set<std::string> seen;
    std::vector<Column> columns;
    for (const std::string_view field : fields) {
        const std::string name(field);
        if (name.empty())
            throw InputError(place + ": expected a column name in field " +
                             std::to_string(layout.name.size() + 1) + ", found nothing");
        if (!seen.insert(name).second)
            throw InputError(place + ": column " + shown(name) + " is given twice");
        try {
            columns.push_back(parse_column(name));
        } catch (const InputError &error) {
            throw InputError(place + ": " + error.what());
        }
        if (columns.back().known)
            run.joint.resize(std::max(run.joint.size(), columns.back().joint + 1));
        layout.name.push_back(name);
    }
    if (!seen.count("t_s"))
        throw InputError(place + ": expected a column 't_s' (time in seconds), found " +
                         shown(line) + "; is this one of our logs? foreign tables need a map");
    check_complete(place, run, seen);
    for (std::size_t c = 0; c < columns.size(); ++c) {
        layout.series.push_back(&slot(run, columns[c], layout.name[c]));
        if (layout.name[c] == "t_s")
            layout.time = c;
    }
    return layout;
}

// One data row, read in place: this loop is most of the time a log takes.
void read_row(const std::string &path, std::size_t number, std::string_view line,
              const Layout &layout)
{
    const std::size_t columns = layout.series.size();
    std::size_t c = 0;
    for (std::string_view rest = line;; ++c) {
        const std::size_t end = rest.find(',');
        const std::string_view field = trim(rest.substr(0, end));
        if (c == columns)
            throw InputError(at(path, number) + ": expected " + std::to_string(columns) +
                             " fields as in the header, found more");
        double value;
        if (!parse_number(field, value))
            throw InputError(at(path, number) + ": column " + shown(layout.name[c]) +
                             ": expected a finite number, found " + shown(field));
        layout.series[c]->push_back(value);
        if (end == std::string_view::npos)
            break;
        rest.remove_prefix(end + 1);
    }
    if (c + 1 < columns)
        throw InputError(at(path, number) + ": expected " + std::to_string(columns) +
                         " fields as in the header, found " + std::to_string(c + 1));
    const Series &t = *layout.series[layout.time];
    if (t.size() > 1 && !(t.back() > t[t.size() - 2])) {
        std::string before, now;
        append_number(before, t[t.size() - 2]);
        append_number(now, t.back());
        throw InputError(at(path, number) + ": column 't_s': expected more than " + before +
                         " s of the row before, found " + now + " s; time must advance");
    }
}

void read_rows(const std::string &path, LineReader &lines, const Layout &layout)
{
    std::string_view line;
    while (lines.next(line)) {
        if (!lines.ended())
            throw InputError(at(path, lines.number()) +
                             ": the file ends inside a line; was it cut short? "
                             "remove the line, or end it with a newline if it is whole");
        if (trim(line).empty() || line.front() == '#')
            throw InputError(at(path, lines.number()) + ": expected a row of numbers, found " +
                             (trim(line).empty() ? "an empty line"
                                                 : "a '#' line; constants go before the header"));
        if (layout.series[0]->empty()) {
            // one reservation from the first row's length; growth stays possible
            const std::size_t guess = lines.rest().size() / (line.size() + 1) + 2;
            for (Series *series : layout.series)
                series->reserve(guess);
        }
        read_row(path, lines.number(), line, layout);
    }
    if (layout.series[0]->empty())
        throw InputError(path + ": expected rows of numbers after the header, found none");
}

// Every series of the run with its column name, time first.
std::vector<std::pair<std::string, const Series *>> named_series(const Run &run)
{
    std::vector<std::pair<std::string, const Series *>> out{{"t_s", &run.t_s}};
    for (std::size_t j = 0; j < run.joint.size(); ++j)
        for (const Known &known : known_columns)
            if (!(run.joint[j].*known.series).empty())
                out.emplace_back(column_name(known, j), &(run.joint[j].*known.series));
    for (const auto &[name, series] : run.extra)
        out.emplace_back(name, &series);
    return out;
}

std::string header_text(const std::vector<std::pair<std::string, const Series *>> &columns)
{
    std::string out;
    for (const auto &[name, series] : columns)
        out += (out.empty() ? "" : ",") + name;
    return out;
}

// The contract on a run in memory: what passes can be written and read back.
void check_run(const std::string &path,
                    const std::vector<std::pair<std::string, const Series *>> &columns,
                    const Run &run)
{
    for (const auto &[key, value] : run.constants) {
        if (!is_key(key) || value.find_first_of("\r\n") != std::string::npos)
            throw InputError(path + ": constant " + shown(key) +
                             ": expected a one-word key and a value on one line");
        if (is_file_constant(path, key, value))
            throw InputError(path + ": constant " + shown(key) + " is the file's own, not a run's");
        check_known_constant(path, run, key);
    }
    for (const auto &[name, series] : columns) {
        if (series->size() != run.rows())
            throw InputError(path + ": column " + shown(name) + ": expected " +
                             std::to_string(run.rows()) + " rows as in t_s, found " +
                             std::to_string(series->size()));
        if (!std::all_of(series->begin(), series->end(), [](double x) { return std::isfinite(x); }))
            throw InputError(path + ": column " + shown(name) + ": a value is not finite");
    }
    if (std::adjacent_find(run.t_s.begin(), run.t_s.end(), std::greater_equal<>()) !=
        run.t_s.end())
        throw InputError(path + ": column 't_s': time does not advance");
    Run scratch;
    const Layout layout = read_header(path, header_text(columns), scratch);
    if (layout.series.size() != columns.size())
        throw InputError(path + ": a column name holds a comma");
}

std::string as_text(const std::vector<std::pair<std::string, const Series *>> &columns,
                    const Run &run)
{
    std::string out;
    out.reserve(run.rows() * columns.size() * 12 + 4096);
    out += std::string("# format = ") + log_format + "\n# version = " + log_version + "\n";
    for (const auto &[key, value] : run.constants)
        out += "# " + key + " = " + value + "\n";
    out += header_text(columns) + '\n';
    for (std::size_t row = 0; row < run.rows(); ++row) {
        for (std::size_t c = 0; c < columns.size(); ++c) {
            if (c)
                out += ',';
            append_number(out, (*columns[c].second)[row]);
        }
        out += '\n';
    }
    return out;
}

} // namespace

double Run::constant(const std::string &key, double fallback) const
{
    const auto found = constants.find(key);
    double value;
    if (found == constants.end())
        return fallback;
    if (!parse_number(trim(found->second), value))
        throw InputError(path + ": constant '" + key + "': expected a number, found " +
                         shown(found->second));
    return value;
}

std::vector<double> Run::constant_vector(const std::string &key) const
{
    std::vector<double> out;
    const auto found = constants.find(key);
    if (found == constants.end())
        return out;
    std::vector<std::string_view> fields;
    split(found->second, ' ', fields);
    for (const std::string_view field : fields) {
        double value;
        if (!parse_number(field, value))
            throw InputError(path + ": constant '" + key +
                             "': expected numbers with blanks between, found " +
                             shown(found->second));
        out.push_back(value);
    }
    return out;
}

Series &run_column(Run &run, const std::string &name)
{
    const Column column = parse_column(name);
    if (column.known)
        run.joint.resize(std::max(run.joint.size(), column.joint + 1));
    return slot(run, column, name);
}

void finish_run(Run &run)
{
    for (Joint &joint : run.joint)
        joint.present = !joint.q_rad.empty() && !joint.tau_nm.empty();
    check_run(run.path, named_series(run), run);
}

Run read_run(const std::string &path)
{
    const std::string text = read_text(path);
    Run run;
    run.path = path;
    LineReader lines(text);
    std::string_view line;
    while (lines.next(line)) {
        const std::string place = at(path, lines.number());
        if (trim(line).empty())
            continue;
        if (line.front() == '#') {
            read_constant(place, line, run);
            continue;
        }
        if (!lines.ended())
            throw InputError(place + ": expected rows of numbers after the header, found " +
                             shown(line) + " and the end of the file");
        const Layout layout = read_header(place, line, run);
        read_rows(path, lines, layout);
        return run;
    }
    throw InputError(path + ": expected a header row with 't_s', found " +
                     (text.empty() ? "an empty file" : "no header"));
}

void write_run(const std::string &path, const Run &run)
{
    const auto columns = named_series(run);
    check_run(path, columns, run);
    write_file(path, as_text(columns, run));
}

bool same_measurement(const Run &a, const Run &b)
{
    bool any = false;
    for (std::size_t j = 0; j < std::min(a.joint.size(), b.joint.size()); ++j) {
        const Joint &x = a.joint[j], &y = b.joint[j];
        if (!x.present || !y.present)
            continue;
        if (x.q_rad != y.q_rad || x.tau_nm != y.tau_nm)
            return false;
        any = true;
    }
    return any;
}

Run cut_run(const Run &run, double t0_s, double t1_s)
{
    const auto first = std::lower_bound(run.t_s.begin(), run.t_s.end(), t0_s) - run.t_s.begin();
    const auto last = std::lower_bound(run.t_s.begin(), run.t_s.end(), t1_s) - run.t_s.begin();
    if (!(t0_s < t1_s) || first >= last) {
        std::string from, to;
        append_number(from, run.rows() ? run.t_s.front() : 0);
        append_number(to, run.rows() ? run.t_s.back() : 0);
        throw InputError(run.path + ": no row between " + std::to_string(t0_s) + " s and " +
                         std::to_string(t1_s) + " s; the run goes from " + from + " s to " + to +
                         " s");
    }
    const auto cut = [&](Series &series) {
        if (!series.empty())
            series = Series(series.begin() + first, series.begin() + last);
    };
    Run out = run;
    cut(out.t_s);
    for (Joint &joint : out.joint)
        for (const Known &known : known_columns)
            cut(joint.*known.series);
    for (auto &[name, series] : out.extra)
        cut(series);
    return out;
}

} // namespace hdt
