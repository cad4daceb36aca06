// SPDX-License-Identifier: Apache-2.0
//
// Reports: one self-contained HTML file with tables and gnuplot SVG inside, readable on paper.
//
// Owns: the look of every report.
// Never: computes a result.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace hdt {

struct Series {
    std::string title;
    std::vector<double> x, y;
    enum Style { Line, Points, Steps, Impulses } style = Line;
    int color = -1;                 // -1: next of the palette; a series keeps its colour across plots
};

struct Plot {
    std::string title, xlabel, ylabel;
    std::vector<Series> series;
    int width_px = 860, height_px = 320;
    double xmin = 0, xmax = 0, ymin = 0, ymax = 0; // equal: automatic
    bool equal_axes = false;
    bool log_y = false;
};

class Report {
public:
    explicit Report(const std::string &title);
    void heading(const std::string &text);
    void paragraph(const std::string &text);            // plain text; escaped
    void verdict(const std::string &text, bool good);   // the first thing read
    // First row is the head; a cell that parses as a number is right-aligned.
    void table(const std::vector<std::vector<std::string>> &rows, const std::string &caption);
    // Draws with gnuplot; throws std::runtime_error when gnuplot is missing or fails.
    void plot(const Plot &p);
    void plots(const std::vector<Plot> &side_by_side);
    // Temporary name, then rename.
    void write(const std::string &path) const;

private:
    std::string title_, body_;
};

// Four significant digits, for people.
std::string num(double x, int significant = 3);

} // namespace hdt
