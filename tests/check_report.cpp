// SPDX-License-Identifier: Apache-2.0
//
// A report is one file that stands alone, says what it was given and nothing else, and draws what
// it was given.
//
// Method: the written file is read back by a small tag reader of our own; curves are read back from
// the path data of the picture.
#include "model/report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <dirent.h>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

#include "model/arm_file.hpp"
#include "tests/check_main.h"
#include "tests/scratch.hpp"

using hdt::InputError;
using hdt::Plot;
using hdt::Report;
using hdt::Series;
using hdt::num;

static std::string work_dir;

static void make_work_dir(void)
{
    work_dir = scratch_dir();
    setenv("TMPDIR", work_dir.c_str(), 1);
}

static std::vector<std::string> entries(const std::string &dir)
{
    std::vector<std::string> names;
    DIR *d = opendir(dir.c_str());
    ck_assert_ptr_nonnull(d);
    while (const dirent *e = readdir(d))
        if (e->d_name[0] != '.')
            names.push_back(e->d_name);
    closedir(d);
    return names;
}

static void remove_work_dir(void) { std::filesystem::remove_all(work_dir); }

static bool have_gnuplot(void) { return std::system("gnuplot --version >/dev/null 2>&1") == 0; }

static std::string text_of(const Report &r)
{
    const std::string path = work_dir + "/report.html";
    r.write(path);
    std::ifstream in(path, std::ios::binary);
    std::stringstream s;
    s << in.rdbuf();
    unlink(path.c_str());
    return s.str();
}

struct Page {
    std::vector<std::string> tags;              // names in order of opening
    std::map<std::string, int> ids;
    std::vector<std::string> targets;           // of href and url(#...)
    std::string text;                           // between tags, character references resolved
    std::string trouble;                        // first thing wrong
};

static std::string resolve(std::string s)
{
    static const char *const refs[][2] = {{"&lt;", "<"},
                                          {"&gt;", ">"},
                                          {"&quot;", "\""},
                                          {"&apos;", "'"},
                                          {"&amp;", "&"}};
    for (const auto &r : refs)
        for (std::size_t at = 0; (at = s.find(r[0], at)) != std::string::npos; ++at)
            s.replace(at, std::strlen(r[0]), r[1]);
    return s;
}

// Attributes of a tag: name='value' or name="value" and nothing else.
static void read_attributes(Page *page, const std::string &tag, std::size_t at)
{
    while (at < tag.size()) {
        at = tag.find_first_not_of(" \n/", at);
        if (at == std::string::npos)
            return;
        const std::size_t equals = tag.find('=', at);
        if (equals == std::string::npos || (tag[equals + 1] != '"' && tag[equals + 1] != '\'')) {
            page->trouble = "attribute without quotes in <" + tag + ">";
            return;
        }
        const std::size_t end = tag.find(tag[equals + 1], equals + 2);
        const std::string name = tag.substr(at, equals - at);
        const std::string value = tag.substr(equals + 2, end - equals - 2);
        if (name == "id" && ++page->ids[value] > 1)
            page->trouble = "id '" + value + "' twice";
        if (name == "href")
            page->targets.push_back(value);
        if (value.find("url(") != std::string::npos)
            page->targets.push_back(value.substr(value.find("url(") + 4,
                                                 value.find(')') - value.find("url(") - 4));
        at = end + 1;
    }
}

static Page read_page(const std::string &html)
{
    Page page;
    std::vector<std::string> open;
    std::size_t at = std::string("<!DOCTYPE html>").size();
    if (html.compare(0, at, "<!DOCTYPE html>") != 0)
        page.trouble = "no doctype";
    while (at < html.size()) {
        const std::size_t less = std::min(html.find('<', at), html.size());
        const std::string text = html.substr(at, less - at);
        const bool fetches = text.find("url(") != std::string::npos ||
                             text.find("@import") != std::string::npos;
        if (!open.empty() && open.back() == "style")
            page.targets.push_back(fetches ? "css" : "");
        else
            page.text += resolve(text);
        if (less == html.size())
            break;
        const std::size_t more = html.find('>', less);
        const std::string tag = html.substr(less + 1, more - less - 1);
        at = more + 1;
        if (tag[0] == '/') {
            if (open.empty() || open.back() != tag.substr(1))
                page.trouble = "</" + tag.substr(1) + "> closes <" + (open.empty() ? "" : open.back()) + ">";
            if (!open.empty())
                open.pop_back();
            continue;
        }
        const std::size_t name_end = std::min(tag.find_first_of(" \n/"), tag.size());
        const std::string name = tag.substr(0, name_end);
        page.tags.push_back(name);
        read_attributes(&page, tag, name_end);
        if (tag.back() != '/' && name != "meta")
            open.push_back(name);
    }
    if (!open.empty())
        page.trouble = "<" + open.back() + "> is never closed";
    return page;
}

// Where the group around `at` ends.
static std::size_t group_end(const std::string &html, std::size_t at)
{
    for (int depth = 1; depth > 0; ++at) {
        at = html.find('<', at);
        ck_assert(at != std::string::npos);
        depth += html.compare(at, 3, "<g ") == 0 ? 1 : html.compare(at, 4, "</g>") == 0 ? -1 : 0;
    }
    return at;
}

// The vertices drawn for the series of the one plot in a page, as pen strokes.
typedef std::vector<std::vector<std::pair<double, double>>> Strokes;

static Strokes strokes_of(const std::string &html, int series)
{
    const std::string mark = "gnuplot_plot_" + std::to_string(series) + "\"";
    std::size_t at = html.find(mark);
    ck_assert_msg(at != std::string::npos, "series %d is not drawn", series);
    const std::size_t end = group_end(html, at);
    Strokes out;
    while ((at = html.find(" d='", at)) < end) {
        const std::size_t close = html.find('\'', at + 4);
        std::istringstream in(html.substr(at + 4, close - at - 4));
        char pen, comma;
        double x, y;
        while (in >> pen >> x >> comma >> y) {
            if (pen == 'M')
                out.emplace_back();
            out.back().emplace_back(x, y);
        }
        at = close;
    }
    return out;
}

static Series make_series(const std::string &title, std::size_t n, double (*y)(double),
                          Series::Style style = Series::Line)
{
    Series s;
    s.title = title;
    s.style = style;
    for (std::size_t i = 0; i < n; ++i) {
        s.x.push_back((double)i / (double)n);
        s.y.push_back(y(s.x.back()));
    }
    return s;
}

static Plot make_plot(const std::string &title, const std::vector<Series> &series)
{
    Plot p;
    p.title = title;
    p.xlabel = "t, s";
    p.ylabel = "N m";
    p.series = series;
    return p;
}

static double wave(double x) { return std::sin(20 * x); }
static double bend(double x) { return x * x; }

static const char nasty[] = "<script>alert('x')</script> & \"q\" </title></style> `touch pwned` $(id) %s \\n "
                            "{/Bold x} &lt;b&gt; \xc2\xb1";

START_TEST(test_text_is_never_markup)
{
    Report r(nasty);
    r.heading(nasty);
    r.paragraph(nasty);
    r.verdict(nasty, true);
    r.table({{nasty, "b"}, {nasty, "1"}}, nasty);
    Plot p = make_plot(nasty, {make_series(nasty, 50, wave), make_series(nasty, 50, bend, Series::Points)});
    p.xlabel = p.ylabel = nasty;
    if (have_gnuplot())
        r.plot(p);
    const std::string html = text_of(r);
    ck_assert(html.find("<script") == std::string::npos);
    const Page page = read_page(html);
    ck_assert_msg(page.trouble.empty(), "%s", page.trouble.c_str());
    std::size_t told = 0;
    for (std::size_t at = 0; (at = page.text.find(nasty, at)) != std::string::npos; ++at)
        ++told;
    // title twice, heading, paragraph, verdict, caption, two cells; figure caption, two axes, two keys
    ck_assert_uint_eq(told, have_gnuplot() ? 13 : 8);
    ck_assert_int_ne(access("pwned", F_OK), 0);
}
END_TEST

START_TEST(test_labels_cannot_leave_their_quotes)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const std::string pwned = work_dir + "/pwned";
    for (const std::string &attack :
         {"'; system('touch " + pwned + "') #", "x\nsystem('touch " + pwned + "')\n",
          "x'\nset output '" + pwned + "'\n", "EOD\nsystem('touch " + pwned + "')"}) {
        Report r("t");
        Plot p = make_plot(attack, {make_series(attack, 9, wave)});
        p.xlabel = p.ylabel = attack;
        r.plot(p);
        ck_assert_int_ne(access(pwned.c_str(), F_OK), 0);
    }
}
END_TEST

static Report rich_report()
{
    Report r("rich");
    const double nan = std::nan("");
    r.verdict("good", true);
    r.verdict("bad", false);
    r.table({{"joint", "rms, N m", "verdict"},
             {"1", "0.62", "nothing"},
             {"2", "0.86 \xc2\xb1 0.01", "named"},
             {"3"}},
            "caption");
    r.table({}, "empty");
    Plot p = make_plot("lines", {make_series("before", 400, wave), make_series("after", 400, bend)});
    p.series[0].y[200] = nan;
    r.plot(p);
    p = make_plot("cloud", {make_series("cloud", 400, wave, Series::Points)});
    Plot q = make_plot("bars", {make_series("bars", 40, bend, Series::Impulses),
                                make_series("steps", 40, bend, Series::Steps)});
    q.log_y = true;
    p.equal_axes = true;
    r.plots({p, q});
    r.plot(make_plot("none", {}));
    return r;
}

START_TEST(test_report_stands_alone_and_is_well_formed)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const std::string html = text_of(rich_report());
    const Page page = read_page(html);
    ck_assert_msg(page.trouble.empty(), "%s", page.trouble.c_str());
    // nothing fetched: no address, no source, only references to what is in the page, once each
    for (const char *outside : {"http", "src=", "//www", "file:", "@import", "<link", "<script", "<iframe"})
        ck_assert_msg(html.find(outside) == std::string::npos, "found %s", outside);
    ck_assert_uint_gt(page.targets.size(), 1);
    for (const std::string &t : page.targets)
        ck_assert_msg(t.empty() || (t[0] == '#' && page.ids.count(t.substr(1)) == 1), "reference to '%s'",
                      t.c_str());
    ck_assert_int_eq((int)std::count(page.tags.begin(), page.tags.end(), "svg"), 3);
    ck_assert_int_eq((int)std::count(page.tags.begin(), page.tags.end(), "figure"), 4);
    ck_assert_str_eq(page.tags[0].c_str(), "html");
}
END_TEST

START_TEST(test_same_report_same_bytes_and_nothing_left_behind)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const std::string a = text_of(rich_report()), b = text_of(rich_report());
    ck_assert(a == b);
    ck_assert_uint_eq(entries(work_dir).size(), 0);
}
END_TEST

START_TEST(test_numbers_are_right_aligned_under_their_head)
{
    Report r("t");
    r.table({{"name", "value", "mixed"},
             {"a", "-1.5e3", "x"},
             {"2b", "12 %", "3"},
             {"c", "0.41 \xc2\xb1 0.01", "n/a"},
             {"d", "1 2", "1 \xc2\xb1"}},
            "c");
    const std::string html = text_of(r);
    for (const char *right : {"<th class=\"n\">value<", "<th class=\"n\">mixed<", "<td class=\"n\">-1.5e3<",
                              "<td class=\"n\">12 %<", "<td class=\"n\">3<", "<td class=\"n\">n/a<"})
        ck_assert_msg(html.find(right) != std::string::npos, "missing %s", right);
    for (const char *left : {"<th>name<", "<td>a<", "<td>2b<", "<td>x<", "<td>1 2<", "<td>1 \xc2\xb1<"})
        ck_assert_msg(html.find(left) != std::string::npos, "missing %s", left);
    ck_assert(html.find("<td class=\"n\">0.41 \xc2\xb1 0.01<") != std::string::npos);
}
END_TEST

static double flat(double) { return 0; }

START_TEST(test_thinning_keeps_every_spike)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    uint64_t seed = 4;
    for (int k = 0; k < 6; ++k) {
        Series s = make_series("", 300000, flat); // no title, so no key
        const std::size_t up = test_random(&seed) % s.y.size(), down = test_random(&seed) % s.y.size();
        s.y[up] = 1;
        s.y[down] = -1;
        Report r("t");
        r.plot(make_plot("p", {s}));
        const std::string html = text_of(r);
        ck_assert_uint_lt(html.size(), 60000);
        double top = 1e9, bottom = -1e9, top_x = 0, left = 1e9, right = -1e9, rest = 0;
        for (const auto &stroke : strokes_of(html, 1))
            for (const auto &v : stroke) {
                if (v.second < top)
                    top_x = v.first;
                top = std::min(top, v.second);
                bottom = std::max(bottom, v.second);
                left = std::min(left, v.first);
                right = std::max(right, v.first);
                rest = v.second; // in the end the line lies flat
            }
        // both spikes are there and as high as each other
        ck_assert_double_gt(bottom - top, 150); // of 320 px, less axes
        ck_assert_double_le(std::fabs(rest - (top + bottom) / 2), 1);
        ck_assert_double_le(std::fabs((top_x - left) / (right - left) - (double)up / (double)s.y.size()),
                            2.0 / 800);
    }
}
END_TEST

static uint64_t noise_state = 9;
static double noise(double) { return test_uniform(&noise_state, -1, 1); }

START_TEST(test_long_series_stay_small)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const std::size_t n = 200000;
    const auto size = [](const Plot &p) {
        Report r("t");
        r.plot(p);
        return text_of(r).size();
    };
    std::vector<Series> lines, clouds, steps;
    for (int k = 0; k < 13; ++k)
        lines.push_back(make_series("l" + std::to_string(k), n / 10, noise));
    for (int k = 0; k < 3; ++k) {
        clouds.push_back(make_series("c" + std::to_string(k), n, noise, Series::Points));
        steps.push_back(make_series("s" + std::to_string(k), n, noise, Series::Steps));
    }
    ck_assert_uint_lt(size(make_plot("p", lines)), 150000);
    ck_assert_uint_lt(size(make_plot("p", clouds)), 150000);
    ck_assert_uint_lt(size(make_plot("p", steps)), 200000);
    // a path that turns back: noise against noise
    Series path = make_series("path", n, noise);
    for (double &x : path.x)
        x = noise(0);
    ck_assert_uint_lt(size(make_plot("p", {path})), 150000);
    ck_assert_uint_gt(size(make_plot("p", {path})), 40000); // and is still a scribble
    // gaps everywhere
    Series holes = make_series("holes", n, noise);
    for (std::size_t i = 0; i < n; i += 2)
        holes.y[i] = std::nan("");
    ck_assert_uint_lt(size(make_plot("p", {holes})), 150000);
}
END_TEST

START_TEST(test_cloud_keeps_its_outliers)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    Series s = make_series("", 100000, noise, Series::Points);
    s.y[70001] = 9;
    s.y[12345] = -9;
    Report r("t");
    Plot p = make_plot("p", {s});
    r.plot(p);
    std::size_t points = 0, upper = 0, lower = 0, outside = 0;
    double top = 1e9, bottom = -1e9;
    const Strokes strokes = strokes_of(text_of(r), 1);
    for (const auto &stroke : strokes) {
        top = std::min(top, stroke[0].second);
        bottom = std::max(bottom, stroke[0].second);
    }
    for (const auto &stroke : strokes) {
        ++points;
        upper += stroke[0].second < (top + bottom) / 2;
        lower += stroke[0].second > (top + bottom) / 2;
        outside += std::fabs(stroke[0].second - (top + bottom) / 2) > 0.12 / 2 * (bottom - top);
    }
    // the cloud is a ninth as high as the two outliers are apart
    ck_assert_uint_eq(outside, 2);
    ck_assert_uint_ge(points, 2000);
    ck_assert_double_le(std::fabs((double)upper - (double)lower), 0.1 * (double)points);
}
END_TEST

START_TEST(test_what_is_not_finite_is_a_gap)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const double bad[] = {std::nan(""), std::numeric_limits<double>::infinity(),
                          -std::numeric_limits<double>::infinity(), 1e305};
    for (const double b : bad)
        for (const int in_x : {0, 1}) {
            Series s = make_series("", 5000, flat);
            for (std::size_t i = 2000; i < 3000; ++i)
                (in_x ? s.x : s.y)[i] = b;
            Report r("t");
            r.plot(make_plot("p", {s}));
            const Strokes strokes = strokes_of(text_of(r), 1);
            double left = 1e9, right = -1e9, longest = 0;
            std::vector<std::pair<double, double>> spans;
            for (const auto &stroke : strokes) {
                left = std::min(left, stroke.front().first);
                right = std::max(right, stroke.back().first);
                spans.emplace_back(stroke.front().first, stroke.back().first);
                longest = std::max(longest, stroke.back().first - stroke.front().first);
            }
            // two fifths, a hole of one fifth, two fifths: to the pixel
            ck_assert_double_le(std::fabs(longest / (right - left) - 0.4), 0.005);
            double drawn = 0;
            for (const auto &span : spans)
                drawn += span.second - span.first;
            ck_assert_double_le(std::fabs(drawn / (right - left) - 0.8), 0.01);
        }
    // a logarithm of nothing is a gap too
    Series s = make_series("", 100, bend);
    s.y[50] = -1;
    Plot p = make_plot("p", {s});
    p.log_y = true;
    Report r("t");
    r.plot(p);
    ck_assert_uint_eq(strokes_of(text_of(r), 1).size(), 2);
}
END_TEST

START_TEST(test_nothing_to_draw_is_said)
{
    Report r("t");
    Series empty, gaps;
    gaps.x = {1, 2};
    gaps.y = {std::nan(""), std::nan("")};
    r.plot(make_plot("p", {empty, gaps}));
    ck_assert(text_of(r).find("no data") != std::string::npos);
}
END_TEST

START_TEST(test_odd_data_is_drawn)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    for (const double x : {0.0, 1.0, -5e12, 1e-200, 1e250})
        for (const int points : {1, 2}) {
            Series s;
            s.x.assign((std::size_t)points, x);
            s.y.assign((std::size_t)points, x);
            s.y.push_back(3); // longer than x: the rest has no place
            for (const Series::Style style :
                 {Series::Line, Series::Points, Series::Steps, Series::Impulses}) {
                s.style = style;
                Plot p = make_plot("p", {s});
                p.equal_axes = style == Series::Line;
                Report r("t");
                r.plot(p);
                ck_assert(read_page(text_of(r)).trouble.empty());
            }
        }
}
END_TEST

// The colour a series is drawn with.
static std::string ink(const std::string &html, std::size_t figure, int series)
{
    std::size_t at = 0;
    for (std::size_t k = 0; k <= figure; ++k)
        at = html.find("<svg", at + 1);
    at = html.find("gnuplot_plot_" + std::to_string(series) + "\"", at);
    const std::size_t d =
        html.find(" d='M", html.find("<path", html.find("<text>", at) < html.find("<path", at) ? at : at));
    const std::size_t stroke = html.rfind("stroke='rgb", d);
    ck_assert(stroke != std::string::npos && stroke > at);
    return html.substr(stroke + 8, html.find('\'', stroke + 8) - stroke - 8);
}

START_TEST(test_a_title_keeps_its_colour)
{
    if (!have_gnuplot())
        HDT_SKIP("gnuplot is not installed");
    const auto s = [](const char *title) { return make_series(title, 20, wave); };
    Report r("t");
    r.plot(make_plot("a", {s("residual before"), s("residual after"), s("gravity"), s("friction")}));
    r.plot(make_plot("b", {s("friction"), s("ripple"), s("after"), s("before")}));
    const std::string html = text_of(r);
    ck_assert(ink(html, 0, 1) == ink(html, 1, 4)); // before
    ck_assert(ink(html, 0, 2) == ink(html, 1, 3)); // after
    ck_assert(ink(html, 0, 4) == ink(html, 1, 1)); // friction
    std::set<std::string> first, second;
    for (int k = 1; k <= 4; ++k) {
        first.insert(ink(html, 0, k));
        second.insert(ink(html, 1, k));
    }
    ck_assert_uint_eq(first.size(), 4);
    ck_assert_uint_eq(second.size(), 4);
}
END_TEST

static std::string failure_of_a_plot()
{
    Report r("t");
    try {
        r.plot(make_plot("p", {make_series("s", 10, wave)}));
    } catch (const std::runtime_error &e) {
        return e.what();
    }
    return "";
}

START_TEST(test_missing_gnuplot_is_named_with_its_remedy)
{
    setenv("PATH", "/nonexistent", 1);
    const std::string line = failure_of_a_plot();
    ck_assert_msg(line.find("gnuplot cannot be run") != std::string::npos &&
                      line.find("gnuplot-nox") != std::string::npos,
                  "%s", line.c_str());
    ck_assert_uint_eq(entries(work_dir).size(), 0);
}
END_TEST

START_TEST(test_failing_gnuplot_is_quoted)
{
    const std::string fake = work_dir + "/gnuplot";
    const struct { const char *body, *say; } cases[] = {
        {"#!/bin/sh\necho 'line 3: undefined variable: x' >&2\nexit 1\n", "line 3: undefined variable: x"},
        {"#!/bin/sh\nexit 0\n", "no reason given"},
        {"#!/bin/sh\nkill -9 $$\n", "no reason given"},
        {"#!/bin/sh\necho '<svg></svg>' > \"${2%script}plot.svg\"; exit 2\n", "no reason given"},
        {"#!/bin/sh\necho '<svg>' > \"${2%script}plot.svg\"\n", "no reason given"}, // cut short
    };
    setenv("PATH", (work_dir + ":/usr/bin:/bin").c_str(), 1);
    for (const auto &c : cases) {
        std::ofstream(fake) << c.body;
        chmod(fake.c_str(), 0700);
        const std::string line = failure_of_a_plot();
        ck_assert_msg(line.find("gnuplot failed") != std::string::npos &&
                          line.find(c.say) != std::string::npos,
                      "'%s'", line.c_str());
        ck_assert_uint_eq(entries(work_dir).size(), 1); // the fake alone
    }
    unlink(fake.c_str());
    setenv("TMPDIR", "/nonexistent", 1);
    ck_assert(failure_of_a_plot().find("temporary directory /nonexistent") != std::string::npos);
}
END_TEST

START_TEST(test_report_that_cannot_be_written_is_an_input_error)
{
    bool refused = false;
    try {
        Report("t").write(work_dir + "/no/such/report.html");
    } catch (const InputError &e) {
        refused = std::string(e.what()).find("/no/such/report.html") != std::string::npos;
    }
    ck_assert(refused);
    ck_assert_uint_eq(entries(work_dir).size(), 0);
}
END_TEST

START_TEST(test_numbers_for_people)
{
    static const struct { double x; int digits; const char *want; } cases[] = {
        {0, 3, "0"},
        {0.6234, 3, "0.623"},
        {-0.6234, 3, "-0.623"},
        {9.996, 3, "10.0"},
        {99.96, 3, "100"},
        {12345.6, 3, "12346"},
        {1.5, 3, "1.50"},
        {0.00012345, 3, "0.000123"},
        {1.2345e-7, 3, "1.23e-07"},
        {1.2345e12, 3, "1.23e+12"},
        {2, 1, "2"},
        {1.23456, 5, "1.2346"},
        {NAN, 3, "n/a"},
        {INFINITY, 3, "n/a"},
        {0.999999, 3, "1.00"},
    };
    for (const auto &c : cases) {
        const std::string text = num(c.x, c.digits); // the check keeps a pointer
        ck_assert_str_eq(text.c_str(), c.want);
    }
    // what is printed reads back to the digits asked for
    uint64_t seed = 8;
    for (int k = 0; k < 2000; ++k) {
        const double x = test_uniform(&seed, -1, 1) * std::pow(10, test_uniform(&seed, -12, 12));
        const int digits = 1 + (int)(test_random(&seed) % 12);
        const double back = std::atof(num(x, digits).c_str());
        ck_assert_double_le(std::fabs(back - x),
                            0.5001 * std::pow(10, 1 - digits) * std::fabs(x) * 1.0000001);
    }
}
END_TEST

static Suite *report_suite(void)
{
    Suite *s = suite_create("report");
    TCase *c = tcase_create("page");
    tcase_add_checked_fixture(c, make_work_dir, remove_work_dir);
    tcase_add_test(c, test_text_is_never_markup);
    tcase_add_test(c, test_labels_cannot_leave_their_quotes);
    tcase_add_test(c, test_report_stands_alone_and_is_well_formed);
    tcase_add_test(c, test_same_report_same_bytes_and_nothing_left_behind);
    tcase_add_test(c, test_numbers_are_right_aligned_under_their_head);
    tcase_add_test(c, test_numbers_for_people);
    suite_add_tcase(s, c);
    c = tcase_create("pictures");
    tcase_set_timeout(c, 60);
    tcase_add_checked_fixture(c, make_work_dir, remove_work_dir);
    tcase_add_test(c, test_thinning_keeps_every_spike);
    tcase_add_test(c, test_long_series_stay_small);
    tcase_add_test(c, test_cloud_keeps_its_outliers);
    tcase_add_test(c, test_what_is_not_finite_is_a_gap);
    tcase_add_test(c, test_nothing_to_draw_is_said);
    tcase_add_test(c, test_odd_data_is_drawn);
    tcase_add_test(c, test_a_title_keeps_its_colour);
    suite_add_tcase(s, c);
    c = tcase_create("failures");
    tcase_add_checked_fixture(c, make_work_dir, remove_work_dir);
    tcase_add_test(c, test_missing_gnuplot_is_named_with_its_remedy);
    tcase_add_test(c, test_failing_gnuplot_is_quoted);
    tcase_add_test(c, test_report_that_cannot_be_written_is_an_input_error);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(report_suite())
