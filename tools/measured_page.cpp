// SPDX-License-Identifier: Apache-2.0
//
// One arm's page of docs/measured: numbers of ident.json and diagnosis.json, and what the logs say beside
// them, put into the page's text at lines that read @NAME@; the points of its pictures as tables.
//
//   measured_page --dir DIR --fit LOGS --test LOGS --text TEXT.md --out PAGE.md
//
// DIR holds ident/ and diagnosis/ as `hdt ident` and `hdt diagnose` left them; DIR/*.dat is written.
//
// Owns: the tables of the pages.
// Never: fits a model file; words a conclusion, which is the text's.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "model/files.hpp"
#include "model/report.hpp"
#include "tools/measured_signals.hpp"

using namespace hdt;
using namespace hdt::measured;
using nlohmann::json;

namespace {

constexpr double kStandsOut = 4;        // over the floor, of a line looked for among all orders
constexpr double kSeen = 3;             // the same at an order given beforehand
constexpr std::size_t kLines = 4;
constexpr double kSigmas = 3;

struct Options {
    std::string dir, text, out;
    std::vector<std::string> fit, test, published, other, steady;
    std::vector<double> orders;
    double highest = 600;
};

using ByJoint = std::map<int, std::vector<Signal>>;

struct Data {
    ByJoint fit_blocks, test_blocks, fit_rows, test_rows, test_every;
    ByJoint all_rows;               // fit and test, in the order they were given
    ByJoint steady;                 // of runs at steady speed, if they were named
    std::map<int, std::vector<std::string>> names; // of all_rows
};

std::string whole_file(const std::string &path)
{
    std::ifstream in(path, std::ios::binary);
    if (!in)
        throw InputError(path + ": cannot be opened: make measured leaves it there");
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

json document(const std::string &path, const std::string &format)
{
    json d;
    try {
        d = json::parse(whole_file(path));
    } catch (const json::exception &e) {
        throw InputError(path + ": " + e.what());
    }
    if (!d.is_object() || d.value("format", "") != format || d.value("version", 0) != 1)
        throw InputError(path + ": expected format " + format + ", version 1");
    return d;
}

void add(const std::vector<Signal> &from, ByJoint *to)
{
    for (const Signal &s : from)
        (*to)[s.joint].push_back(s);
}

Data read_data(const ArmFile &model, const Options &o)
{
    Data d;
    for (const bool test : {false, true})
        for (const std::string &path : test ? o.test : o.fit) {
            const Run run = read_run(path);
            const std::vector<Signal> rows = signals(model, run, Rows::Fitted);
            add(rows, test ? &d.test_rows : &d.fit_rows);
            add(rows, &d.all_rows);
            for (const Signal &s : rows)
                d.names[s.joint].push_back(path.substr(path.find_last_of('/') + 1));
            add(signals(model, run, Rows::Blocks), test ? &d.test_blocks : &d.fit_blocks);
            if (test)
                add(signals(model, run, Rows::Every), &d.test_every);
        }
    for (const std::string &path : o.steady)
        add(signals(model, read_run(path), Rows::Fitted), &d.steady);
    return d;
}

std::string plain(double x)
{
    char text[32];
    std::snprintf(text, sizeof text, "%g", x);
    return text;
}

std::string cell(double x) { return std::isfinite(x) ? num(x) : "-"; }

std::string cell(double x, double sigma) { return std::isfinite(x) ? num(x) + " ± " + num(sigma, 1) : "-"; }

std::string row(const std::vector<std::string> &cells)
{
    std::string out = "|";
    for (const std::string &c : cells)
        out += " " + c + " |";
    return out + "\n";
}

std::string head(const std::vector<std::string> &cells)
{
    std::string out = row(cells) + "|";
    for (std::size_t k = 0; k < cells.size(); ++k)
        out += "---|";
    return out + "\n";
}

const json *entry(const json &document, int joint)
{
    for (const json &j : document.at("joints"))
        if (j.at("joint") == joint)
            return &j;
    return nullptr;
}

double value(const json &j, const char *key)
{
    return j.contains(key) && j.at(key).is_number() ? j.at(key).get<double>() : NAN;
}

double published(const Options &o, int joint)
{
    const auto k = static_cast<std::size_t>(joint - 1);
    return k < o.published.size() ? std::atof(o.published[k].c_str()) : NAN;
}

// Before and after, N.m rms held out.
std::string table(const Options &o, const json &ident, const json &diagnosis, const Data &d)
{
    const bool beside = !o.published.empty();
    std::vector<std::string> names = {"joint", "torque", "friction alone", "after ident", "after diagnosis",
        "noise floor",
                                      "verdict", "every row"};
    if (beside)
        names.insert(names.end(), {"published", "better"});
    std::string out = head(names);
    for (const json &j : ident.at("joints")) {
        const int joint = j.at("joint");
        const json *g = entry(diagnosis, joint);
        const auto blocks = d.test_blocks.find(joint), every = d.test_every.find(joint),
            fit = d.fit_blocks.find(joint);
        const bool here = blocks != d.test_blocks.end() && fit != d.fit_blocks.end();
        const double after = value(j, "held_out_after_nm");
        std::vector<std::string> cells = {
            std::to_string(joint), cell(value(j, "held_out_before_nm")),
            cell(here ? friction_alone_nm(fit->second, blocks->second) : NAN), cell(after),
            cell(g ? value(*g, "rms_after_nm") : NAN), cell(g ? value(*g, "noise_floor_nm") : NAN),
            g ? g->at("verdict").get<std::string>() : "not looked at",
            cell(every != d.test_every.end() ? rms_nm(every->second) : NAN)};
        if (beside)
            cells.insert(cells.end(), {cell(published(o, joint)), after < published(o, joint) ? "yes"
                : "no"});
        out += row(cells);
    }
    return out;
}

// Other divisions into fit and held out: DIR/NAME/ident.json of each, one column a division.
std::string divisions(const Options &o, const json &ident)
{
    std::vector<json> other;
    std::vector<std::string> names = {"joint", "above"};
    for (const std::string &name : o.other) {
        other.push_back(document(o.dir + "/" + name + "/ident.json", "hdt-ident"));
        names.push_back(name);
    }
    std::string out = head(names);
    for (const json &j : ident.at("joints")) {
        std::vector<std::string> cells = {std::to_string(j.at("joint").get<int>()),
            cell(value(j, "held_out_after_nm"))};
        for (const json &d : other) {
            const json *e = entry(d, j.at("joint"));
            cells.push_back(cell(e ? value(*e, "held_out_after_nm") : NAN));
        }
        out += row(cells);
    }
    return out;
}

std::string words(const json &diagnosis)
{
    std::string out;
    for (const json &j : diagnosis.at("joints"))
        out += "* Joint " + std::to_string(j.at("joint").get<int>()) + ": " +
            j.at("words").get<std::string>() + "\n";
    for (const json &s : diagnosis.value("skipped", json::array()))
        out += "* Joint " + std::to_string(s.at("joint").get<int>()) + ": " +
            s.at("why").get<std::string>() + "\n";
    return out;
}

// What was tried and came nearest, whether named or not.
std::string tried(const json &diagnosis)
{
    std::string out = head({"joint", "candidate", "log e", "effect, N.m rms", "why not named"});
    for (const json &j : diagnosis.at("joints"))
        for (std::size_t k = 0; k < std::min<std::size_t>(2, j.at("tried").size()); ++k) {
            const json &t = j.at("tried")[k];
            const std::string note = t.at("note").get<std::string>();
            out += row({std::to_string(j.at("joint").get<int>()), t.at("id"), num(value(t, "log_e")),
                num(value(t, "rms_nm")),
                        note.empty() ? "-" : note});
        }
    return out;
}

// How slow the rest is: held out, every row.
std::string stretches(const Data &d)
{
    const std::vector<double> widths = {0.01, 0.025, 0.05, 0.1, 0.2, 0.5};
    std::vector<std::string> names = {"joint", "every row"};
    for (const double w : widths)
        names.push_back("means of " + plain(w * 1000) + " ms");
    std::string out = head(names);
    for (const auto &[joint, runs] : d.test_every) {
        std::vector<std::string> cells = {std::to_string(joint), num(rms_nm(runs))};
        for (const double w : widths)
            cells.push_back(num(rms_of_means_nm(runs, w)));
        out += row(cells);
    }
    return out;
}

// Lines found in the fit runs; what they are, and what taking them off does, on the held-out ones.
std::string lines(const Options &o, const Data &d)
{
    std::string out = head({"joint", "order per joint turn", "amplitude, N.m", "over its neighbours",
        "held out, N.m",
                            "held-out rms without it"});
    for (const auto &[joint, fit] : d.fit_rows) {
        const auto test = d.test_rows.find(joint);
        if (test == d.test_rows.end())
            continue;
        const std::vector<Line> found = strongest_lines(fit, o.highest, kLines, kStandsOut);
        if (found.empty())
            out += row({std::to_string(joint), "none", "", "", "", num(rms_nm(test->second))});
        std::vector<Signal> left = test->second;
        for (const Line &line : found) {
            const double before = rms_nm(left), there = line_at(left, line.order).amplitude_nm;
            left = without_lines(std::move(left), {line});
            out += row({std::to_string(joint), num(line.order, 4), num(line.amplitude_nm),
                num(line.over_floor, 2), num(there),
                        num(before) + " -> " + num(rms_nm(left))});
        }
    }
    return out;
}

// Orders given beforehand, in the runs of steady speed when they are named, else in all.
std::string orders(const Options &o, const Data &d)
{

    std::vector<std::string> names = {"joint"};
    for (const double order : o.orders)
        names.push_back(plain(order));
    std::string out = head(names);
    for (const auto &[joint, runs] : d.steady.empty() ? d.all_rows : d.steady) {
        std::vector<std::string> cells = {std::to_string(joint)};
        for (const double order : o.orders) {
            const Line line = line_at(runs, order);
            const bool seen = line.over_floor >= kSeen;
            cells.push_back(num(line.amplitude_nm) + (seen ? " **x " : " x ") + num(line.over_floor, 2) +
                (seen ? "**" : ""));
        }
        out += row(cells);
    }
    return out;
}

std::string starred(const Loss &l, int k)
{
    const bool clear = std::abs(l.value[k]) > kSigmas * l.sigma[k];
    return (clear ? "**" : "") + cell(l.value[k], l.sigma[k]) + (clear ? "**" : "");
}

std::string loss(const Data &d)
{
    std::string out = head({"joint", "Coulomb, N.m", "viscous, N.m s/rad", "driving, N.m/N.m",
        "driven, N.m/N.m",
                            "reflected inertia, kg m^2", "offset, N.m", "load, N.m rms", "loss, N.m rms",
                                    "left without load", "left"});
    for (const auto &[joint, runs] : d.all_rows) {
        const Loss l = gear_loss(runs);
        std::vector<std::string> cells = {std::to_string(joint)};
        for (int k = 0; k < Loss::Count; ++k)
            cells.push_back(starred(l, k));
        cells.insert(cells.end(), {num(l.load_rms_nm), num(l.loss_rms_nm), num(l.left_constant_nm),
            num(l.left_nm)});
        out += row(cells);
    }
    return out;
}

// By the number in the run's name, runN.csv.
int run_number(const std::string &name) { return std::atoi(name.c_str() +
        std::min<std::size_t>(name.size(), 3)); }

struct Shares { std::vector<std::pair<int, FrictionShare>> of_run; };

std::map<int, Shares> shares(const Data &d)
{
    std::map<int, Shares> out;
    for (const auto &[joint, runs] : d.all_rows) {
        Shares &s = out[joint];
        for (std::size_t k = 0; k < runs.size(); ++k)
            s.of_run.emplace_back(run_number(d.names.at(joint)[k]), friction_share(runs[k]));
        std::sort(s.of_run.begin(), s.of_run.end(),
            [](const auto &a, const auto &b) { return a.first < b.first; });
    }
    return out;
}

double mean_share(const Shares &s, int from, int to)
{
    double sum = 0, n = 0;
    for (const auto &[run, share] : s.of_run)
        if (run >= from && run <= to && std::isfinite(share.share)) {
            sum += share.share;
            n += 1;
        }
    return n > 0 ? sum / n : NAN;
}

// First and last three runs of every group of runs of one input; groups as "1-20".
std::string share_table(const std::map<int, Shares> &all, const std::vector<std::string> &groups)
{
    std::vector<std::string> names = {"joint"};
    for (const std::string &g : groups)
        names.push_back("runs " + g);
    std::string out = head(names);
    for (const auto &[joint, s] : all) {
        std::vector<std::string> cells = {std::to_string(joint)};
        for (const std::string &g : groups) {
            const int from = std::atoi(g.c_str()), to = std::atoi(g.c_str() + g.find('-') + 1);
            cells.push_back(num(mean_share(s, from, from + 2)) + " -> " + num(mean_share(s, to - 2, to)));
        }
        out += row(cells);
    }
    return out;
}

// ---- points of the pictures -------------------------------------------------------------------

void write_spectra(const Options &o, const ByJoint &of, const std::string &name)
{
    std::string out = "# joint, order per joint turn, amplitude of the residual, N.m\n";
    for (const auto &[joint, runs] : of) {
        const Spectrum s = order_spectrum(runs, o.highest);
        for (std::size_t k = 0; k < s.amplitude_nm.size(); ++k)
            out += std::to_string(joint) + " " + num(s.order(k), 6) + " " + num(s.amplitude_nm[k], 4) + "\n";
        out += "\n\n";
    }
    write_file(o.dir + "/" + name + ".dat", out);
}

// Held-out residual over the phase of the strongest line of the fit runs.
void write_folded(const Options &o, const Data &d)
{
    constexpr int bins = 24;
    std::string out = "# joint, order, direction, phase in periods, residual N.m, rows: held-out runs\n";
    for (const auto &[joint, fit] : d.fit_rows) {
        const auto test = d.test_rows.find(joint);
        const std::vector<Line> line = strongest_lines(fit, o.highest, 1, kStandsOut);
        if (test == d.test_rows.end() || line.empty())
            continue;
        std::vector<double> sum(2 * bins, 0), rows(2 * bins, 0);
        for (const Signal &s : test->second)
            for (Eigen::Index i = 0; i < s.q_rad.size(); ++i) {
                const double periods = line[0].order * s.q_rad[i] / (2 * M_PI);
                const int bin = std::min(bins - 1, static_cast<int>((periods - std::floor(periods)) * bins));
                const auto k = static_cast<std::size_t>(bin + (s.dir[i] < 0 ? bins : 0));
                sum[k] += s.residual_nm[i];
                rows[k] += 1;
            }
        for (std::size_t k = 0; k < sum.size(); ++k)
            if (rows[k] > 0)
                out += std::to_string(joint) + " " + num(line[0].order, 5) + (k < bins ? " 1 " : " -1 ") +
                       num((static_cast<double>(k % bins) + 0.5) / bins, 4) + " " +
                               num(sum[k] / rows[k], 4) + " " +
                       num(rows[k], 6) + "\n";
        out += "\n\n";
    }
    write_file(o.dir + "/folded.dat", out);
}

void write_residuals(const Options &o, const Data &d)
{
    std::string out =
        "# joint, t s, q rad, v rad/s, residual N.m, loss N.m, sensor N.m, direction: held-out blocks\n";
    for (const auto &[joint, runs] : d.test_blocks) {
        for (const Signal &s : runs)
            for (Eigen::Index i = 0; i < s.t_s.size(); ++i) {
                const bool has = s.sensor_nm.size() > 0;
                for (const double x : {static_cast<double>(joint), s.t_s[i], s.q_rad[i], s.v_radps[i],
                    s.residual_nm[i],
                                       has ? s.tau_nm[i] - s.sensor_nm[i] : NAN, has ? s.sensor_nm[i] : NAN,
                                               s.dir[i]})
                    out += (std::isfinite(x) ? num(x, 7) : "NaN") + " ";
                out += "\n";
            }
        out += "\n\n";
    }
    write_file(o.dir + "/residual.dat", out);
}

void write_shares(const Options &o, const std::map<int, Shares> &all)
{
    std::string out = "# joint, run, friction as a share of the model's, sigma\n";
    for (const auto &[joint, s] : all) {
        for (const auto &[run, share] : s.of_run)
            if (std::isfinite(share.share))
                out += std::to_string(joint) + " " + std::to_string(run) + " " + num(share.share, 5) + " " +
                    num(share.sigma, 3) + "\n";
        out += "\n\n";
    }
    write_file(o.dir + "/share.dat", out);
}

// Replaces every line of the text that reads @NAME@.
std::string filled(const std::string &text, const std::string &path, const std::map<std::string,
    std::string> &parts)
{
    std::istringstream in(text);
    std::string out, line;
    for (int number = 1; std::getline(in, line); ++number) {
        if (line.size() < 3 || line.front() != '@' || line.back() != '@') {
            out += line + "\n";
            continue;
        }
        const auto part = parts.find(line.substr(1, line.size() - 2));
        if (part == parts.end())
            throw InputError(path + ":" + std::to_string(number) + ": " + line + ": no such part");
        out += part->second;
    }
    return out;
}

void write_page(const Options &o, const std::vector<std::string> &groups)
{
    const json ident = document(o.dir + "/ident/ident.json", "hdt-ident");
    const json diagnosis = document(o.dir + "/diagnosis/diagnosis.json", "hdt-diagnosis");
    const ArmFile model = ArmFile::load(o.dir + "/diagnosis/model.toml");
    const Data d = read_data(model, o);
    std::map<std::string, std::string> parts = {{"TABLE", table(o, ident, diagnosis, d)},
        {"WORDS", words(diagnosis)},
                                                {"TRIED", tried(diagnosis)}, {"LINES", lines(o, d)},
                                                {"STRETCHES", stretches(d)}};
    if (!o.orders.empty())
        parts["ORDERS"] = orders(o, d);
    if (!o.other.empty())
        parts["DIVISIONS"] = divisions(o, ident);
    const std::string text = whole_file(o.text);
    if (text.find("@LOSS@") != std::string::npos)
        parts["LOSS"] = loss(d);
    if (!groups.empty()) {
        const std::map<int, Shares> all = shares(read_data(ArmFile::load(o.dir + "/ident/model.toml"), o));
        parts["SHARE"] = share_table(all, groups);
        write_shares(o, all);
    }
    write_spectra(o, d.test_rows, "spectrum");
    write_spectra(o, d.steady, "steady");
    write_residuals(o, d);
    write_folded(o, d);
    write_file(o.out, filled(text, o.text, parts));
}

} // namespace

int main(int argc, char **argv)
{
    Options o;
    std::vector<std::string> groups;
    CLI::App app{"one page of docs/measured"};
    app.add_option("--dir", o.dir, "directory with ident/ and diagnosis/; points of pictures go there")
        ->required();
    app.add_option("--fit", o.fit, "logs that were fitted")->required();
    app.add_option("--test", o.test, "logs held out")->required();
    app.add_option("--text", o.text, "the page's text")->required();
    app.add_option("--out", o.out, "page")->required();
    app.add_option("--published", o.published, "N.m rms per joint, of a published model");
    app.add_option("--orders", o.orders, "orders per joint turn to look at");
    app.add_option("--steady", o.steady, "logs of steady speed, for --orders");
    app.add_option("--other", o.other,
                   "further divisions into fit and held out: directories in DIR with ident.json");
    app.add_option("--groups", groups, "runs of one input, as 1-20");
    app.add_option("--highest", o.highest, "highest order looked at")->capture_default_str();
    CLI11_PARSE(app, argc, argv);
    try {
        write_page(o, groups);
    } catch (const std::exception &e) {
        std::fprintf(stderr, "measured_page: %s\n", e.what());
        return 3;
    }
    return 0;
}
