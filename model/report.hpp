// SPDX-License-Identifier: Apache-2.0
//
// Reports: one self-contained HTML file with tables and gnuplot SVG inside, readable on paper.
//
// Owns: the look of every report.
// Never: computes a result.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace hdt {

// Colours with a meaning; after these the palette goes on by number.
enum PaletteColor { PALETTE_BEFORE = 0, PALETTE_AFTER = 1, PALETTE_MEASURED = 2 };

struct Series {
    std::string title;
    std::vector<double> x, y;       // a point that is not finite is a gap
    enum Style { Line, Points, Steps, Impulses } style = Line;
    // -1: by title: one that says before, after, measured or reference has that colour, another
    // title keeps through the whole report the colour it first got
    int color = -1;
};

struct Plot {
    std::string title, xlabel, ylabel;
    std::vector<Series> series;
    int width_px = 860, height_px = 320;
    double xmin = 0, xmax = 0, ymin = 0, ymax = 0; // equal: automatic
    bool equal_axes = false;
    bool log_y = false;             // what is not positive is a gap
};

// All text is plain text, escaped here.  Long series are thinned: lines keep the
// least and greatest of each pixel column, a cloud of points keeps its outline and a sample.
class Report {
public:
    explicit Report(const std::string &title);
    void heading(const std::string &text);
    void paragraph(const std::string &text);
    void verdict(const std::string &text, bool good);   // the first thing read
    // First row is the head; a cell that parses as a number is right-aligned.
    void table(const std::vector<std::vector<std::string>> &rows, const std::string &caption);
    // Draws with gnuplot; throws std::runtime_error when gnuplot is missing or fails.
    void plot(const Plot &p);
    // Side by side, each as wide as fits.
    void plots(const std::vector<Plot> &side_by_side);
    // Temporary name, then rename; throws InputError when it cannot be written.
    void write(const std::string &path) const;

private:
    std::string title_, body_;
    std::map<std::string, int> color_by_title_;
    int figures_ = 0;

    std::string figure(const Plot &p);
    std::vector<int> colors_of(const Plot &p);
};

// So many significant digits, for people: no exponent between 1e-4 and 1e9, no trailing noise;
// "n/a" when there is no number.
std::string num(double x, int significant = 3);

} // namespace hdt
