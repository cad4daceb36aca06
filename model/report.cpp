// SPDX-License-Identifier: Apache-2.0
//
// Reports as one HTML file: escaped text, tables, and gnuplot's SVG taken in.
//
// Owns: style sheet, palette, thinning, the one place that runs gnuplot.
// Never: refers to anything outside the file it writes.
#include "model/report.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <set>
#include <stdexcept>

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "model/files.hpp"
#include "model/text.hpp"

extern char **environ;

namespace hdt {
namespace {

// Told apart by the colour-blind and in grey (after Okabe and Ito); the first three have meanings.
const char *const palette[] = {"#d55e00", "#0072b2", "#444444", "#009e73", "#cc79a7",
                               "#56b4e9", "#b8860b", "#7b4fa3", "#000000", "#9a9a9a"};
constexpr int colors = static_cast<int>(sizeof palette / sizeof palette[0]);
constexpr int first_free_color = 3;

constexpr int page_px = 900;
constexpr std::size_t points_max = 4000;   // of all Points series of a plot: some 28 bytes each
constexpr std::size_t vertices_max = 5000; // of all other series: some 15 bytes each

const char *const style_sheet = R"(
:root { color: #1c1c1c; background: #fff; font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
body { max-width: 900px; margin: 2.5rem auto 4rem; padding: 0 1.25rem; }
h1 { font-size: 1.6rem; line-height: 1.25; font-weight: 600; margin: 0 0 1.25rem; padding-bottom: .5rem; border-bottom: 2px solid #1c1c1c; }
h2 { font-size: 1.15rem; font-weight: 600; margin: 2.25rem 0 .5rem; }
p { margin: .5rem 0; max-width: 75ch; }
.verdict { margin: 1rem 0 1.5rem; padding: .75rem 1rem; max-width: none; border: 1px solid #d5d5d5; border-left: 6px solid; font-size: 1.05rem; }
.good { border-left-color: #0072b2; background: #f1f7fb; }
.bad { border-left-color: #d55e00; background: #fdf4ee; }
table { border-collapse: collapse; margin: .75rem 0 1.25rem; font-size: .9rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; text-align: left; color: #555; padding-bottom: .35rem; }
th { font-weight: 600; text-align: left; vertical-align: bottom; border-bottom: 1.5px solid #1c1c1c; }
td { border-bottom: 1px solid #e2e2e2; vertical-align: top; }
th, td { padding: .25rem .9rem .25rem 0; }
th:last-child, td:last-child { padding-right: .25rem; }
.n { text-align: right; }
.wide { overflow-x: auto; }
figure { margin: 1rem 0 1.25rem; min-width: 0; break-inside: avoid; }
figcaption { font-size: .95rem; font-weight: 600; margin-bottom: .15rem; }
figure svg { display: block; max-width: 100%; height: auto; }
.row { display: flex; flex-wrap: wrap; gap: 0 1rem; }
.none { color: #555; font-style: italic; }
@page { margin: 16mm; }
@media print {
  :root { font-size: 10.5pt; }
  body { margin: 0; padding: 0; max-width: none; }
  h2 { break-after: avoid; }
  table, .verdict { break-inside: avoid; }
  .good, .bad { background: none; }
  .wide { overflow: visible; }
}
)";

// ---- thinning ----

struct Point { double x, y; };
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

bool is_gap(const Point &p) { return !std::isfinite(p.x) || !std::isfinite(p.y); }

struct Box { double xmin, xmax, ymin, ymax; };

// The range drawn: what the plot asks for, else what the data fill.
Box box_of(const Plot &p, const std::vector<std::vector<Point>> &data)
{
    const double inf = std::numeric_limits<double>::infinity();
    Box b = {inf, -inf, inf, -inf};
    for (const auto &series : data)
        for (const Point &q : series)
            if (!is_gap(q)) {
                b.xmin = std::min(b.xmin, q.x);
                b.xmax = std::max(b.xmax, q.x);
                b.ymin = std::min(b.ymin, q.y);
                b.ymax = std::max(b.ymax, q.y);
            }
    if (p.xmin < p.xmax) {
        b.xmin = p.xmin;
        b.xmax = p.xmax;
    }
    if (p.ymin < p.ymax) {
        b.ymin = p.ymin;
        b.ymax = p.ymax;
    }
    return b;
}

std::vector<Point> points_of(const Plot &p, const Series &s)
{
    std::vector<Point> out;
    for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i) {
        Point q = {s.x[i], s.y[i]};
        // gnuplot reads no number beyond this, and a logarithm needs a positive one
        if (std::fabs(q.x) > 1e300 || std::fabs(q.y) > 1e300 || (p.log_y && q.y <= 0))
            q = {nan, nan};
        if (!is_gap(q) || (!out.empty() && !is_gap(out.back())))
            out.push_back(q);
    }
    while (!out.empty() && is_gap(out.back()))
        out.pop_back();
    return out;
}

bool x_never_goes_back(const std::vector<Point> &data)
{
    double last = -std::numeric_limits<double>::infinity();
    for (const Point &p : data) {
        if (!is_gap(p) && p.x < last)
            return false;
        if (!is_gap(p))
            last = p.x;
    }
    return true;
}

// Least and greatest of each of `columns` of the picture, in the order they came.  A gap stays when
// it is wide enough to be seen.
std::vector<Point> thin_columns(const std::vector<Point> &data, const Box &box, std::size_t columns)
{
    const double scale = static_cast<double>(columns) / std::max(box.xmax - box.xmin, 1e-300);
    const auto column = [&](std::size_t i) { return std::floor((data[i].x - box.xmin) * scale); };
    std::vector<Point> out;
    double before = 0;
    for (std::size_t i = 0; i < data.size();) {
        const bool gap = is_gap(data[i]);
        while (i < data.size() && is_gap(data[i]))
            ++i;
        if (i == data.size())
            break;
        const double here = column(i);
        std::size_t least = i, most = i, last = i, end = i;
        for (; end < data.size() && (is_gap(data[end]) || column(end) <= here); ++end) {
            if (is_gap(data[end]))
                continue;
            least = data[end].y < data[least].y ? end : least;
            most = data[end].y > data[most].y ? end : most;
            last = end;
        }
        const bool opens = out.empty() || (gap && here > before + 1);
        if (opens && !out.empty())
            out.push_back({nan, nan});
        std::set<std::size_t> keep = {least, most};
        if (opens)
            keep.insert(i);
        if (last + 1 == data.size() || is_gap(data[last + 1]))
            keep.insert(last);
        for (const std::size_t k : keep)
            out.push_back(data[k]);
        before = here;
        i = last + 1;
    }
    return out;
}

// A path that may go anywhere: leave out what moves less than a step, doubling the step until it fits.
std::vector<Point> thin_path(const std::vector<Point> &data, const Box &box, const Plot &p, std::size_t most)
{
    const double xs = p.width_px / std::max(box.xmax - box.xmin, 1e-300),
                 ys = p.height_px / std::max(box.ymax - box.ymin, 1e-300);
    for (double step_px = 0.3;; step_px *= 2) {
        std::vector<Point> out;
        for (std::size_t i = 0; i < data.size(); ++i) {
            const bool end = i == 0 || i + 1 == data.size() || is_gap(data[i]) || is_gap(out.back()) ||
                             is_gap(data[i + 1]);
            if (end ||
                std::hypot((data[i].x - out.back().x) * xs, (data[i].y - out.back().y) * ys) >= step_px)
                out.push_back(data[i]);
        }
        if (out.size() <= most)
            return out;
        if (step_px > 20) { // a scribble all over the picture: some of it shows as much as all
            const std::size_t stride = 1 + data.size() / most;
            out.clear();
            for (std::size_t i = 0; i < data.size(); i += stride)
                out.push_back(data[i]);
            return out;
        }
    }
}

// A deterministic order without pattern, so that what is left out leaves no lattice behind.
std::vector<std::size_t> shuffled(std::size_t count)
{
    std::vector<std::size_t> order(count);
    uint64_t state = 1;
    for (std::size_t i = 0; i < count; ++i) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        const std::size_t k = static_cast<std::size_t>((state >> 33) % (i + 1));
        order[i] = order[k];
        order[k] = i;
    }
    return order;
}

// A cloud keeps its outline and outliers, one point of each cell, and its density, a sample of the rest.
std::vector<Point> thin_cloud(const std::vector<Point> &data, const Box &box, const Plot &p, std::size_t most)
{
    const double xs = p.width_px / std::max(box.xmax - box.xmin, 1e-300),
                 ys = p.height_px / std::max(box.ymax - box.ymin, 1e-300);
    const auto one_a_cell = [&](const std::vector<std::size_t> &order, double cell_px) {
        std::set<std::pair<double, double>> taken;
        std::vector<std::size_t> kept;
        for (const std::size_t i : order)
            if (!is_gap(data[i]) && taken.emplace(std::floor((data[i].x - box.xmin) * xs / cell_px),
                                                  std::floor((data[i].y - box.ymin) * ys / cell_px)).second)
                kept.push_back(i);
        return kept;
    };
    std::vector<std::size_t> visible = one_a_cell(shuffled(data.size()), 0.5), kept = visible;
    for (double cell_px = 2; kept.size() > most / 2 && visible.size() > most; cell_px *= 1.4)
        kept = one_a_cell(visible, cell_px);
    std::set<std::size_t> chosen(kept.begin(), kept.end());
    for (std::size_t k = 0; k < visible.size() && chosen.size() < most; ++k)
        chosen.insert(visible[k]);
    std::vector<Point> out;
    for (const std::size_t i : chosen)
        out.push_back(data[i]);
    return out;
}

// ---- gnuplot ----

// All but letters and what is not ASCII as octal escapes: nothing in a text can end the string or be
// taken for a command.  Digits too, for gnuplot would read them on as part of an escape before them.
std::string quoted(const std::string &text)
{
    std::string out = "\"";
    for (const char c : text) {
        const unsigned char u = static_cast<unsigned char>(c);
        const bool plain = u >= 0x80 || (u >= 'A' && u <= 'Z') || (u >= 'a' && u <= 'z');
        char octal[8];
        std::snprintf(octal, sizeof octal, "\\%03o", u < 0x20 ? ' ' : u);
        out += plain ? std::string(1, c) : std::string(octal);
    }
    return out + "\"";
}

std::string number(double x)
{
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.12g", x);
    return buffer;
}

// A point of a cloud is drawn as a line too short to see, with round ends: a quarter of the bytes of
// gnuplot's own points.
std::string data_block(std::size_t index, const std::vector<Point> &data, double dot)
{
    std::string out = "$d" + std::to_string(index) + " << EOD\n";
    for (const Point &p : data) {
        out += is_gap(p) ? "\n" : number(p.x) + " " + number(p.y) + "\n";
        if (dot > 0)
            out += number(p.x + dot) + " " + number(p.y) + "\n\n";
    }
    return out + "EOD\n";
}

std::string style_of(Series::Style style, int color)
{
    const std::string ink = std::string(" lc rgb '") + palette[color % colors] + "'";
    // the second time round the palette, lines are dashed
    const std::string dash = color >= colors ? " dt 2" : "";
    switch (style) {
    case Series::Points: return "lines lw 2.2" + ink;
    case Series::Steps: return "steps lw 1.4" + ink + dash;
    case Series::Impulses: return "impulses lw 1.6" + ink;
    default: return "lines lw 1.4" + ink + dash;
    }
}

// A step between tics that people count in, for `count` tics or fewer.
double tic_step(double range, int count)
{
    const double least = range / count, power = std::pow(10, std::floor(std::log10(least)));
    for (const double step : {1.0, 2.0, 5.0})
        if (step * power >= least)
            return step * power;
    return 10 * power;
}

bool has_impulses(const Plot &p)
{
    return std::any_of(p.series.begin(), p.series.end(),
                       [](const Series &x) { return x.style == Series::Impulses; });
}

std::string axes(const Plot &p, const Box &box, bool key)
{
    std::string s =
        "set terminal svg size " + std::to_string(p.width_px) + "," + std::to_string(p.height_px) +
        " dynamic rounded noenhanced font 'sans-serif,12'\nset encoding utf8\n"
        "set border 3 lw 0.8 lc rgb '#555555'\nset tics nomirror out scale 0.6 textcolor rgb '#333333'\n"
        "set grid lw 0.5 lc rgb '#dddddd' dt 1\nset autoscale xfix\n";
    s += key ? "set key tmargin left horizontal Left reverse samplen 1.6 width 1\n" : "unset key\n";
    s += "set xlabel " + quoted(p.xlabel) + " noenhanced\nset ylabel " + quoted(p.ylabel) + " noenhanced\n";
    if (p.xmin < p.xmax)
        s += "set xrange [" + number(p.xmin) + ":" + number(p.xmax) + "]\n";
    if (p.ymin < p.ymax)
        s += "set yrange [" + number(p.ymin) + ":" + number(p.ymax) + "]\n";
    else if (!p.log_y && box.ymin >= 0 && has_impulses(p))
        s += "set yrange [0:*]\n";
    else if (!p.log_y)
        s += "set offsets graph 0, graph 0, graph 0.04, graph 0.04\n";
    const double widest = std::max(box.xmax - box.xmin, box.ymax - box.ymin);
    if (p.equal_axes && widest > 0) {
        const std::string step = number(tic_step(widest, 6));
        s += "set size ratio -1\nset xtics " + step + "\nset ytics " + step + "\n";
    }
    s += p.log_y ? "set logscale y\n" : "set xzeroaxis lt 1 lw 0.8 lc rgb '#999999'\n";
    return s;
}

// A directory of our own, gone with all we put in it.
class PrivateDirectory {
public:
    PrivateDirectory()
    {
        const char *parent = std::getenv("TMPDIR");
        path_ = std::string(parent != nullptr && *parent != '\0' ? parent : "/tmp") + "/hdt-report-XXXXXX";
        if (mkdtemp(path_.data()) == nullptr)
            throw std::runtime_error("report: cannot make the temporary directory " + path_ + ": " +
                                     std::strerror(errno));
    }
    ~PrivateDirectory()
    {
        for (const std::string &f : files_)
            unlink(f.c_str());
        rmdir(path_.c_str());
    }
    PrivateDirectory(const PrivateDirectory &) = delete;
    PrivateDirectory &operator=(const PrivateDirectory &) = delete;
    std::string file(const std::string &name)
    {
        files_.push_back(path_ + "/" + name);
        return files_.back();
    }

private:
    std::string path_;
    std::vector<std::string> files_;
};

std::string read_whole(const std::string &path)
{
    std::string out;
    if (std::FILE *f = std::fopen(path.c_str(), "rb")) {
        char buffer[1 << 16];
        for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, f)) > 0;)
            out.append(buffer, n);
        std::fclose(f);
    }
    return out;
}

// First line of gnuplot's complaint that says something.
std::string complaint(const std::string &text)
{
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = std::min(text.find('\n', at), text.size());
        const std::string line = text.substr(at, end - at);
        // it echoes the command and points a caret at the trouble first
        if (line.find("line ") != std::string::npos || line.find("rror") != std::string::npos)
            return line;
        at = end + 1;
    }
    return "no reason given";
}

std::string run_gnuplot(const std::string &script_text)
{
    PrivateDirectory dir;
    const std::string svg = dir.file("plot.svg"), errors = dir.file("errors"), script = dir.file("script");
    write_file(script, "set output " + quoted(svg) + "\n" + script_text);
    std::string name = "gnuplot", no_init = "-d", script_arg = script;
    char *argv[] = {name.data(), no_init.data(), script_arg.data(), nullptr};
    posix_spawn_file_actions_t io;
    posix_spawn_file_actions_init(&io);
    posix_spawn_file_actions_addopen(&io, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&io, 1, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&io, 2, errors.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    pid_t pid = 0;
    const int error = posix_spawnp(&pid, "gnuplot", &io, nullptr, argv, environ);
    posix_spawn_file_actions_destroy(&io);
    if (error != 0)
        throw std::runtime_error(std::string("report: gnuplot cannot be run: ") + std::strerror(error) +
                                 "; install the package gnuplot-nox or put gnuplot into PATH");
    int status = 0;
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR)
            throw std::runtime_error(std::string("report: waiting for gnuplot: ") + std::strerror(errno));
    const std::string out = read_whole(svg);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || out.find("</svg>") == std::string::npos)
        throw std::runtime_error("report: gnuplot failed: " + complaint(read_whole(errors)));
    return out;
}

void replace_all(std::string &text, const std::string &from, const std::string &to)
{
    for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
        text.replace(at, from.size(), to);
}

void cut_element(std::string &svg, const std::string &tag)
{
    for (std::size_t at; (at = svg.find("<" + tag + ">")) != std::string::npos;)
        svg.erase(at, svg.find("</" + tag + ">", at) + tag.size() + 3 - at);
}

// Ids that differ between the figures of a page: in tags only, never in text.
std::string own_ids(const std::string &svg, const std::string &prefix)
{
    std::string out;
    for (std::size_t at = 0; at < svg.size();) {
        const std::size_t open = std::min(svg.find('<', at), svg.size());
        const std::size_t close = std::min(svg.find('>', open), svg.size());
        std::string tag = svg.substr(open, close - open);
        replace_all(tag, "xlink:href", "href");
        // gnuplot writes colours as rgb(), so a # starts an id
        for (const char *opening : {" id='", " id=\"", "'#", "url(#"})
            replace_all(tag, opening, opening + prefix);
        out += svg.substr(at, open - at) + tag;
        at = close;
    }
    return out;
}

// gnuplot's file made fit to stand inside a page: no prologue, no name spaces, no titles (browsers
// show them as tool tips).
std::string inline_svg(std::string svg, int figure, const Plot &p)
{
    svg.erase(0, svg.find("<svg"));
    svg.erase(0, svg.find('>') + 1);
    cut_element(svg, "title");
    cut_element(svg, "desc");
    // blanks and empty lines are a tenth of the file
    replace_all(svg, "\t", "");
    replace_all(svg, " \n", "\n");
    replace_all(svg, "\n\n", "\n");
    const std::string w = std::to_string(p.width_px), h = std::to_string(p.height_px);
    return "<svg role=\"img\" aria-label=\"" + markup_escaped(p.title) + "\" width=\"" + w +
           "\" height=\"" + h + "\" viewBox=\"0 0 " + w + " " + h + "\">" +
           own_ids(svg, "f" + std::to_string(figure) + "-");
}

// ---- tables ----

// A number, perhaps with "± number" or "%" behind it; or a word that stands for one.
bool is_number(const std::string &cell)
{
    if (cell == "n/a" || cell == "-" || cell == "\u2013")
        return true;
    const char *at = cell.c_str();
    for (int part = 0; part < 2; ++part) {
        char *end = nullptr;
        std::strtod(at, &end);
        if (end == at)
            return false;
        at = end + std::strspn(end, " ");
        if (std::strcmp(at, "%") == 0 || *at == '\0')
            return true;
        const std::size_t sign = std::strncmp(at, "\u00b1", 2) == 0 ? 2
                                 : std::strncmp(at, "+-", 2) == 0   ? 2
                                                                    : 0;
        if (sign == 0)
            return false;
        at += sign;
    }
    return false;
}

} // namespace

Report::Report(const std::string &title) : title_(title) {}

void Report::heading(const std::string &text) { body_ += "<h2>" + markup_escaped(text) + "</h2>\n"; }

void Report::paragraph(const std::string &text) { body_ += "<p>" + markup_escaped(text) + "</p>\n"; }

void Report::verdict(const std::string &text, bool good)
{
    std::string lines;
    for (const char c : markup_escaped(text))
        lines += c == '\n' ? std::string("<br>\n") : std::string(1, c);
    body_ += std::string("<p class=\"verdict ") + (good ? "good" : "bad") + "\">" + lines + "</p>\n";
}

void Report::table(const std::vector<std::vector<std::string>> &rows, const std::string &caption)
{
    std::size_t width = 0;
    for (const auto &row : rows)
        width = std::max(width, row.size());
    const auto cell = [&](std::size_t r, std::size_t c) {
        return c < rows[r].size() ? rows[r][c] : std::string();
    };
    body_ += "<div class=\"wide\"><table>\n<caption>" + markup_escaped(caption) + "</caption>\n";
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const char *tag = r == 0 ? "th" : "td";
        body_ += r == 0 ? "<thead><tr>" : "<tr>";
        for (std::size_t c = 0; c < width; ++c) {
            // a head stands over its numbers
            bool right = r > 0 && is_number(cell(r, c));
            for (std::size_t k = 1; r == 0 && k < rows.size(); ++k)
                right = right || is_number(cell(k, c));
            body_ += std::string("<") + tag + (right ? " class=\"n\">" : ">") + markup_escaped(cell(r, c)) +
                     "</" + tag + ">";
        }
        body_ += r == 0 ? "</tr></thead>\n<tbody>\n" : "</tr>\n";
    }
    body_ += rows.empty() ? "</table></div>\n" : "</tbody>\n</table></div>\n";
}

std::vector<int> Report::colors_of(const Plot &p)
{
    static const struct { const char *word; int color; } meanings[] = {
        {"before", PALETTE_BEFORE}, {"after", PALETTE_AFTER},
        {"measured", PALETTE_MEASURED}, {"reference", PALETTE_MEASURED}};
    std::vector<int> out;
    for (const Series &s : p.series) {
        int color = s.color;
        for (const auto &m : meanings)
            if (color < 0 && s.title.find(m.word) != std::string::npos)
                color = m.color;
        const auto known = color_by_title_.find(s.title);
        if (color < 0 && known != color_by_title_.end())
            color = known->second;
        out.push_back(color);
    }
    // a new title gets the first colour nobody in this plot has
    for (std::size_t i = 0; i < out.size(); ++i) {
        if (out[i] >= 0)
            continue;
        out[i] = first_free_color;
        while (std::count(out.begin(), out.end(), out[i]) > 1)
            ++out[i];
        color_by_title_.emplace(p.series[i].title, out[i]);
    }
    return out;
}

std::string Report::figure(const Plot &p)
{
    const std::string open = "<figure><figcaption>" + markup_escaped(p.title) + "</figcaption>";
    std::vector<std::vector<Point>> data;
    for (const Series &s : p.series)
        data.push_back(points_of(p, s));
    const Box box = box_of(p, data);
    std::size_t clouds = 0, lines = 0;
    bool key = false;
    for (std::size_t i = 0; i < data.size(); ++i) {
        (p.series[i].style == Series::Points ? clouds : lines) += !data[i].empty();
        key = key || (!data[i].empty() && !p.series[i].title.empty());
    }
    if (clouds + lines == 0)
        return open + "<p class=\"none\">no data</p></figure>\n";

    const std::vector<int> color = colors_of(p);
    const double dot = 0.05 * (box.xmax > box.xmin ? box.xmax - box.xmin : 1) / p.width_px;
    const std::size_t columns = std::min(static_cast<std::size_t>(p.width_px),
                                         vertices_max / 2 / std::max<std::size_t>(lines, 1));
    std::string blocks, draw;
    for (std::size_t i = 0; i < data.size(); ++i) {
        const Series &s = p.series[i];
        if (data[i].empty())
            continue;
        const bool cloud = s.style == Series::Points;
        if (cloud)
            data[i] = thin_cloud(data[i], box, p, points_max / clouds);
        else if (x_never_goes_back(data[i]))
            data[i] = thin_columns(data[i], box, columns);
        else
            data[i] = thin_path(data[i], box, p, 2 * columns);
        blocks += data_block(i, data[i], cloud ? dot : 0);
        const std::string title = s.title.empty() ? " notitle" : " title " + quoted(s.title) + " noenhanced";
        draw += (draw.empty() ? "plot $d" : ", $d") + std::to_string(i) + " using 1:2 with " +
                style_of(s.style, color[i]) + (cloud ? " notitle" : title);
        if (cloud && !s.title.empty())
            draw += ", keyentry with points pt 7 ps 0.5 lc rgb '" + std::string(palette[color[i] % colors]) +
                    "'" + title;
    }
    return open + inline_svg(run_gnuplot(axes(p, box, key) + blocks + draw + "\n"), ++figures_, p) +
           "</figure>\n";
}

void Report::plot(const Plot &p) { body_ += figure(p); }

void Report::plots(const std::vector<Plot> &side_by_side)
{
    const int count = std::max(1, static_cast<int>(side_by_side.size())), gap_px = 16;
    std::string row;
    for (Plot p : side_by_side) {
        p.width_px = std::min(p.width_px, (page_px - gap_px * (count - 1)) / count);
        row += figure(p);
    }
    body_ += "<div class=\"row\">\n" + row + "</div>\n";
}

void Report::write(const std::string &path) const
{
    write_file(path, "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
                     "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
                     markup_escaped(title_) + "</title>\n<style>" + style_sheet +
                     "</style>\n</head>\n<body>\n<h1>" +
                     markup_escaped(title_) + "</h1>\n" + body_ + "</body>\n</html>\n");
}

std::string num(double x, int significant)
{
    if (!std::isfinite(x))
        return "n/a";
    if (x == 0)
        return "0";
    const int digits = std::clamp(significant, 1, 17);
    char buffer[64];
    // the exponent after rounding: 9.996 is 10.0
    std::snprintf(buffer, sizeof buffer, "%.*e", digits - 1, x);
    const int power = std::atoi(std::strchr(buffer, 'e') + 1);
    if (power < -4 || power > 8)
        std::snprintf(buffer, sizeof buffer, "%.*g", digits, x);
    else
        std::snprintf(buffer, sizeof buffer, "%.*f", std::max(0, digits - 1 - power), x);
    return buffer;
}

} // namespace hdt
