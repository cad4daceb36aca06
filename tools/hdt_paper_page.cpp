// SPDX-License-Identifier: Apache-2.0
// See hdt_paper_page.hpp.
#include "tools/hdt_paper_page.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/arm_file.hpp"
#include "model/files.hpp"
#include "model/rbd.hpp"
#include "model/report.hpp"
#include "model/terms.hpp"

namespace hdt::paper {

namespace {

using Eigen::Index;
using Row = std::vector<std::string>;
using Rows = std::vector<Row>;

constexpr double pi = 3.14159265358979323846;
const char *const ways[2] = {"+", "-"};

// Page and Markdown grow together.
class Page {
public:
    explicit Page(const std::string &title) : html(title) {}
    Report html;
    std::string markdown;

    void heading(const std::string &text)
    {
        html.heading(text);
        markdown += "\n### " + text + "\n\n";
    }
    void table(const Rows &rows, const std::string &caption)
    {
        html.table(rows, caption);
        for (std::size_t r = 0; r < rows.size(); r++) {
            markdown += "|";
            for (const std::string &cell : rows[r])
                markdown += " " + cell + " |";
            markdown += "\n";
            if (r == 0) {
                markdown += "|";
                for (std::size_t c = 0; c < rows[0].size(); c++)
                    markdown += "---|";
                markdown += "\n";
            }
        }
        markdown += "\n" + caption + "\n\n";
    }
};

Series series(const std::string &title, std::vector<double> x, std::vector<double> y, Series::Style style =
              Series::Line)
{
    Series s;
    s.title = title;
    s.x = std::move(x);
    s.y = std::move(y);
    s.style = style;
    return s;
}

Plot plot_of(const std::string &title, const std::string &xlabel, const std::string &ylabel,
             std::vector<Series> all)
{
    Plot p;
    p.title = title;
    p.xlabel = xlabel;
    p.ylabel = ylabel;
    p.series = std::move(all);
    return p;
}

std::vector<double> column(const Eigen::MatrixXd &m, Index c)
{
    return std::vector<double>(m.col(c).begin(), m.col(c).end());
}

std::vector<double> span(double from, double to, int count)
{
    std::vector<double> x;
    for (int i = 0; i <= count; i++)
        x.push_back(from + (to - from) * i / count);
    return x;
}

template <class F> std::vector<double> map(const std::vector<double> &x, F f)
{
    std::vector<double> y;
    for (double v : x)
        y.push_back(f(v));
    return y;
}

std::string plus_minus(double x, double sigma, int digits = 4)
{
    return num(x, digits) + (std::isfinite(sigma) && sigma > 0 ? " ± " + num(sigma, 2) : "");
}

double ratio_of(const Plan &plan, std::size_t j) { return plan.rig.arm.joint[j].ratio; }

double wrapped(double angle)
{
    return angle - 2 * pi * std::round(angle / (2 * pi));
}

// ---- Tables I and II, Fig. 4 ----

void table_1_page(const Results &r, Page &page)
{
    Rows rows = {{"joint", "viscous: paper", "rig", "cubic: paper", "rig", "Stribeck: paper", "rig"}};
    Rows mse = rows;
    for (std::size_t j = 0; j < printed_joints; j++) {
        const JointFriction &f = r.friction[j];
        const double v = mean_variance(f.viscous), c = mean_variance(f.cubic), s = mean_variance(f.stribeck);
        const PrintedModels &p = table_1[j];
        rows.push_back({std::to_string(j + 1), num(p.viscous.variance), num(v), num(p.cubic.variance), num(c),
                        num(p.stribeck.variance), num(s)});
        mse.push_back({std::to_string(j + 1), num(p.viscous.mse), num(printed_mse(v, 2)), num(p.cubic.mse),
                       num(printed_mse(c, 4)), num(p.stribeck.mse), num(printed_mse(s, 4))});
    }
    page.table(rows, "Table I, weighted residual variance, eq. (6): squared misses of the mean torque in "
                     "standard deviations of one trial, summed over eight speeds; the rig's number is the "
                     "mean of both directions.");
    page.table(mse, "Table I, \"MSE per DOF\" in the printed convention: all 21 printed entries are 1 + "
                    "variance / (6 - parameters), one but for a digit (joint 5 viscous, 37.9256 for "
                    "37.9356), though the text lists eight speeds.");
}

void table_2_page(const Results &r, Page &page)
{
    Rows rows = {{"joint", "F0: paper", "rig", "Fv: paper", "rig", "Fs: paper", "rig", "Vc: paper", "rig",
                  "largest difference of the curves, N m"}};
    for (std::size_t j = 0; j < printed_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            const hdt_arm_friction p = magnitudes(d == 0 ? table_2[j].positive : table_2[j].negative);
            const FrictionModelFit &fit = r.friction[j].stribeck[d];
            const auto cell = [&](Index k) { return plus_minus(fit.parameters[k], fit.sigma[k], 3); };
            rows.push_back({std::to_string(j + 1) + ways[d], num(p.f0_nm), cell(0), num(p.fv_nmspr), cell(1),
                            num(p.fs_nm), cell(2), num(p.vc_radps), cell(3),
                            num(curve_gap_nm(p, stribeck_of(fit)), 2)});
        }
    page.table(rows, "Table II, both directions as magnitudes along the motion (the paper prints Fs and Vc "
                     "of the negative direction negative, which is the same curve); ± one standard "
                     "deviation from the scatter of the trials. The last column compares the curves between "
                     "0.02 and 0.4 rad/s, where they are measured.");
}

// A vertical stroke of one standard deviation up and down at every point.
Series error_bars(const std::vector<SpeedPoint> &points, double way)
{
    const double gap = std::numeric_limits<double>::quiet_NaN();
    Series s;
    for (const SpeedPoint &p : points)
        for (const double end : {-1.0, 1.0, gap}) {
            s.x.push_back(std::isfinite(end) ? way * p.speed_radps : gap);
            s.y.push_back(std::isfinite(end) ? way * p.mean_nm + end * p.sd_nm : gap);
        }
    s.title = "measured, one standard deviation";
    return s;
}

void figure_4(const Results &r, Page &page)
{
    const JointFriction &f = r.friction[1];
    std::vector<Plot> both;
    for (std::size_t d = 0; d < 2; d++) {
        const double way = d == 0 ? 1 : -1;
        const std::vector<double> v = span(0.01, 0.42, 80);
        const hdt_arm_friction ours = stribeck_of(f.stribeck[d]),
                               printed = magnitudes(d == 0 ? table_2[1].positive : table_2[1].negative);
        const auto curve = [&](const hdt_arm_friction &k) {
            return map(v, [&](double x) { return way * stribeck_nm(k, x); });
        };
        const std::vector<double> x = map(v, [&](double s) { return way * s; });
        Plot p = plot_of(d == 0 ? "Fig. 4, joint 2, positive" : "Fig. 4, joint 2, negative", "rad/s", "N m",
                         {error_bars(f.points[d], way), series("fitted Stribeck curve", x, curve(ours)),
                          series("Table II, row of joint 2", x, curve(printed))});
        both.push_back(p);
    }
    page.html.plots(both);
}

void friction_page(const Plan &plan, const Results &r, Page &page)
{
    page.heading("Friction against speed: Tables I and II, Fig. 4");
    page.html.paragraph("Velocity mode; eight speeds from 0.02 to 0.4 rad/s both ways, " +
                        std::to_string(plan.trials) +
                        " trials a joint, mounted so that gravity does not load the joint; torque from the "
                        "servo's telegrams, averaged over whole turns of the wave generator.");
    table_1_page(r, page);
    table_2_page(r, page);
    figure_4(r, page);
}

// ---- Table III, Fig. 5 ----

void table_3_page(const Plan &plan, const Results &r, Page &page)
{
    Rows rows = {{"joint", "f1: paper", "rig", "A1: paper", "rig", "phase: paper", "rig", "f2: paper", "rig",
                  "A2: paper",
                  "rig", "phase: paper", "rig", "per turn", "left, N m rms"}};
    for (std::size_t j = 0; j < printed_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            Row row = {std::to_string(j + 1) + ways[d]};
            std::string orders;
            for (std::size_t k = 0; k < 2; k++) {
                const PrintedLine &p = table_3[j][k];
                const auto &lines = r.position[j].lines[d];
                if (k >= lines.size()) {
                    row.insert(row.end(),
                               {num(p.f, 4), "n/a", num(p.amplitude), "n/a", num(wrapped(p.phase)), "n/a"});
                    continue;
                }
                row.insert(row.end(), {num(p.f, 4), num(lines[k].cycles_per_rad, 4), num(p.amplitude),
                                       num(lines[k].amplitude_nm), num(wrapped(p.phase)),
                                       num(wrapped(lines[k].phase_rad))});
                orders += (k == 0 ? "" : ", ") + num(lines[k].cycles_per_rad * 2 * pi / ratio_of(plan, j), 4);
            }
            row.push_back(orders);
            row.push_back(num(r.position[j].rest_rms_nm[d], 2));
            rows.push_back(row);
        }
    page.table(rows, "Table III: the two strongest lines of the torque at 0.01 rad/s, as torque along the "
                     "motion; f in cycles per radian of output, amplitude in N m, phase modulo a turn; "
                     "\"per turn\" is f in cycles per turn of the wave generator. The last column is what "
                     "the two lines leave of the zero-mean torque.");
}

void figure_5(const Results &r, Page &page)
{
    const AngleTable &t = r.position[1].turns[0];
    const double mean = t.mean();
    std::vector<double> q, measured, fit;
    for (std::size_t i = 0; i < t.nm.size(); i++) {
        const double at = t.from_rad + t.step_rad * (static_cast<double>(i) + 0.5);
        if (at < 0 || at > 0.3)
            continue;
        q.push_back(at);
        measured.push_back(t.nm[i] - mean);
        fit.push_back(lines_nm(r.position[1].lines[0], at));
    }
    page.html.plot(plot_of("Fig. 5, joint 2: zero-mean torque at 0.01 rad/s and its two lines (part of the "
                           "range)", "rad",
                           "N m", {series("measured", q, measured, Series::Points),
                                   series("two lines", q, fit)}));
    const Spectrum s = spectrum(t);
    Series amplitude = series("", {}, {}, Series::Impulses);
    for (std::size_t k = 1; k < s.cycles_per_rad.size() && s.cycles_per_rad[k] <= 400; k++) {
        amplitude.x.push_back(s.cycles_per_rad[k]);
        amplitude.y.push_back(s.amplitude_nm[k]);
    }
    Plot p = plot_of("Amplitude spectrum of the same torque", "cycles per rad of output", "N m", {amplitude});
    p.height_px = 220;
    page.html.plot(p);
}

void position_page(const Plan &plan, const Results &r, Page &page)
{
    page.heading("Friction over position: Table III, Fig. 5");
    page.html.paragraph("Velocity mode at 0.01 rad/s over -90 to +90 deg and back, no load on the joint.");
    table_3_page(plan, r, page);
    figure_5(r, page);
}

// ---- Table V, Fig. 7 ----

void table_5_page(const Results &r, Page &page)
{
    Rows rows = {{"joint", "slope 1: paper", "rig", "T1: paper", "rig", "slope 2: paper", "rig", "T2: paper",
                  "rig",
                  "slope 3: paper", "rig", "zero: paper", "rig"}};
    Rows steps = {{"joint", "step: paper", "rig", "left by the three lines, N m rms", "by one line",
                   "periodic torque inside", "outside", "inside / outside"}};
    for (std::size_t j = 0; j < sweep_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            const JointStiffness &s = r.stiffness[j];
            const PrintedLines p = table_5[j][d], o = as_printed(s.fit[d].lines, d == 1);
            const std::string name = std::to_string(j + 1) + ways[d];
            rows.push_back({name, num(p.slope_1), num(o.slope_1), num(p.t_1), num(o.t_1), num(p.slope_2),
                            num(o.slope_2), num(p.t_2), num(o.t_2), num(p.slope_3), num(o.slope_3),
                            num(p.zero), num(o.zero)});
            const double printed_step = std::fabs(p.slope_2 * (p.t_2 - p.t_1));
            steps.push_back({name, num(printed_step), num(s.fit[d].step_nm()), num(s.fit[d].rms_nm, 2),
                             num(s.fit[d].flat_rms_nm, 2), num(s.ripple[d].inside_nm),
                             num(s.ripple[d].outside_nm),
                             num(s.ripple[d].inside_nm / s.ripple[d].outside_nm, 2)});
        }
    page.table(rows, "Table V in the paper's convention (negative rows: torque along the motion); loads and "
                     "zero in N m, slopes in N m/N m. Three lines through the rest after friction and "
                     "gravity, payloads 0 to 4.5 kg together. The paper prints T1 and T2 of row 3- in the "
                     "order 5.30, 2.64.");
    page.table(steps, "Height of the step, slope 2 times its width; and the amplitude of the two lines of "
                      "Table III inside and outside the middle region, N m.");
}

Plot figure_7a(const Results &r)
{
    const Subtracted &s = r.stiffness[1].sweeps[0][0];
    const std::vector<double> degrees = map(s.q_rad, [](double q) { return q * 180 / pi; });
    Plot p = plot_of("Fig. 7 (a), joint 2, no payload, positive direction", "joint angle, deg", "N m",
                     {series("total torque", degrees, s.total_nm),
                      series("less friction", degrees, s.less_friction_nm),
                      series("less gravity: the rest", degrees, s.rest_nm)});
    p.height_px = 380;
    return p;
}

Plot figure_7b(const Results &r, std::size_t j, std::size_t d)
{
    const JointStiffness &s = r.stiffness[j];
    // beyond this nothing happens
    constexpr double shown_nm = 60;
    std::vector<double> load, rest;
    for (const Subtracted &one : s.sweeps[d])
        for (std::size_t i = 0; i < one.load_nm.size(); i++)
            if (std::fabs(one.load_nm[i]) <= shown_nm) {
                load.push_back(one.load_nm[i]);
                rest.push_back(one.rest_nm[i]);
            }
    const auto [low, high] = std::minmax_element(load.begin(), load.end());
    const std::vector<double> x = span(*low, *high, 400);
    const hdt_arm_stiffness printed = joint_signed(table_5[j][d], d == 1);
    const auto curve = [&](const hdt_arm_stiffness &k) {
        return map(x, [&](double v) { return stiffness_nm(k, v); });
    };
    Plot p = plot_of("Fig. 7 (b), joint " + std::to_string(j + 1) + (d == 0 ? ", positive" : ", negative"),
                     "gravity torque, N m", "rest, N m",
                     {series("measured", load, rest, Series::Points),
                      series("three lines", x, curve(s.fit[d].lines)), series("Table V", x, curve(printed))});
    p.height_px = 300;
    return p;
}

void stiffness_page(const Results &r, Page &page)
{
    page.heading("Soft wind-up: Table V, Fig. 7");
    page.html.paragraph("Velocity mode at " + num(sweep_radps) +
                        " rad/s from -90 to +90 deg and back with 0, 1.5, 3 and 4.5 kg at the flange, joints "
                        "1 and 3 on the wall, 2 and 4 on the pedestal. From the torque: less friction (the "
                        "table measured at 0.01 rad/s, and what eq. (7) grows from there to this speed), "
                        "less gravity. In the plant nobody adds such a torque: what is left comes out of "
                        "mesh friction that depends on load and direction, and of the gear's spring.");
    page.html.plot(figure_7a(r));
    for (std::size_t j = 0; j < sweep_joints; j++)
        page.html.plots({figure_7b(r, j, 0), figure_7b(r, j, 1)});
    table_5_page(r, page);
}

// ---- Figs. 8, 9, 10 ----

Row loop_row(const Loop &l, const std::string &name)
{
    return {name, num(l.mean(&LoopFigures::first_second_max_mm)), num(l.mean(&LoopFigures::error_mean_mm)),
            num(l.most(&LoopFigures::error_max_mm)), num(l.mean(&LoopFigures::seen_mean_mm)),
            num(l.most(&LoopFigures::fall_mm)), num(100 * l.mean(&LoopFigures::feedback_share), 2),
            l.fault.empty() ? "to the end" : l.fault};
}

void table_8(const Results &r, Page &page)
{
    Rows rows = {{"host's model", "first second, largest error, mm", "mean after, mm", "largest after, mm",
                  "mean as the resolvers say it, mm", "furthest below the path, mm", "feedback share, %",
                      "ran"},
                 {"paper", "42", "7", "19", "", "collapse without feed-forward", "", "to the end"}};
    for (const Loop &l : r.lemniscate)
        rows.push_back(loop_row(l, l.what));
    page.table(rows, "The lemniscate of eq. (14) entered at full speed from standstill, joint 3 braked, "
                     "gains of Table VI; flange errors at the true link side, mean over repetitions "
                     "(largest: over all of them).");
}

void figure_8(const Plan &plan, const Results &r, Page &page)
{
    const LoopRun &model = loop_named(r, "measured").first, &alone = loop_named(r, "feedback alone").first,
                  &strong = loop_named(r, "10 x gains").first;
    const LoopFigures with = figures_of(plan.rig.arm, model), without = figures_of(plan.rig.arm, alone),
                      tenfold = figures_of(plan.rig.arm, strong);
    const auto path = [&](const LoopFigures &f, const std::string &title) {
        Plot p = plot_of(title, "y, m", "z, m",
                         {series("reference", column(f.reference_m, 1), column(f.reference_m, 2)),
                          series("flange", column(f.path_m, 1), column(f.path_m, 2))});
        p.equal_axes = true;
        p.height_px = 400;
        p.width_px = 430;
        return p;
    };
    page.html.plots({path(with, "Fig. 8: with the model as measured"),
                     path(without, "feedback alone, the same gains")});
    Plot error = plot_of("Flange error", "t, s", "mm",
                         {series("model as measured", model.t_s, with.error_mm),
                          series("feedback alone", alone.t_s, without.error_mm),
                          series("feedback alone, ten times the gains", strong.t_s, tenfold.error_mm)});
    error.height_px = 240;
    page.html.plot(error);
}

Plot torques(const LoopRun &run, Index j, const std::string &title)
{
    Plot p = plot_of(title, "t, s", "N m", {series("total", run.t_s, column(run.total_nm, j)),
                                            series("friction", run.t_s, column(run.friction_nm, j)),
                                            series("gravity", run.t_s, column(run.gravity_nm, j)),
                                            series("wind-up", run.t_s, column(run.stiffness_nm, j)),
                                            series("feedback", run.t_s, column(run.feedback_nm, j))});
    p.height_px = 250;
    return p;
}

void figure_9(const Results &r, Page &page)
{
    const Loop &l = loop_named(r, "measured");
    const int order[6] = {0, 1, 3, 4, 5, 6};
    for (int k = 0; k < 6; k += 2) {
        std::vector<Plot> pair;
        for (int i = k; i < k + 2; i++)
            pair.push_back(torques(l.first, order[i], "Fig. 9, joint " + std::to_string(order[i] + 1)));
        page.html.plots(pair);
    }
    Rows rows = {{"joint", "mean error, rad", "largest, rad", "feedback rms / total rms, %"}};
    for (const int j : order) {
        double mean = 0, most = 0, share = 0;
        for (const LoopFigures &f : l.figures) {
            const std::size_t k = static_cast<std::size_t>(j);
            mean += f.joint_mean_rad[k] / static_cast<double>(l.figures.size());
            share += f.joint_feedback_share[k] / static_cast<double>(l.figures.size());
            most = std::max(most, f.joint_max_rad[k]);
        }
        rows.push_back({std::to_string(j + 1), num(mean, 2), num(most, 2), num(100 * share, 2)});
    }
    page.table(rows, "Fig. 9 in numbers, model as measured.");
}

void lemniscate_page(const Plan &plan, const Results &r, Page &page)
{
    page.heading("The lemniscate: Figs. 8 and 9");
    page.html.paragraph("Torque mode. \"As measured\": friction of Table II, lines of Table III and Table V "
                        "as this run measured them, and the paper's terms: friction for all joints, gravity "
                        "and wind-up for joints 2 and 4 only, no inertia.");
    table_8(r, page);
    figure_8(plan, r, page);
    figure_9(r, page);
}

void joint_3_page(const Results &r, Page &page)
{
    page.heading("Joint 3: Fig. 10");
    const Loop &l = r.joint_3;
    double mean = 0, most = 0;
    for (const LoopFigures &f : l.figures) {
        mean += f.joint_mean_rad[2] / static_cast<double>(l.figures.size());
        most = std::max(most, f.joint_max_rad[2]);
    }
    page.table({{"", "paper", "rig"},
                {"mean error, rad", "0.01", num(mean, 2)},
                {"largest error, rad", "", num(most, 2)},
                {"feedback share, %", "", num(100 * l.mean(&LoopFigures::feedback_share), 2)},
                {"ran", "to the end", l.fault.empty() ? "to the end" : l.fault}},
               "Joint 3, 1.0 rad at 0.1 rad/s from the pose in which gravity loads it most, pedestal, P 4.0 "
               "and D 0.5 N m motor side per rad and rad/s; error at the link side.");
    page.html.plot(torques(l.first, 2, "Fig. 10, joint 3"));
}

void low_page(const Results &r, Page &page)
{
    page.heading("Through the region of low stiffness");
    page.html.paragraph("Joint 2 in torque mode from -90 to +90 deg and back at 0.1 rad/s with the gains of "
                        "Table VI: a task the authors avoided. Friction and gravity are fed forward; the "
                        "lines of Table V are left out, as measured here, and as printed.");
    Rows rows = {{"fed forward", "error, load against, rad", "in the step, rad", "load driving, rad",
                  "largest, rad",
                  "feedback, load against, N m", "in the step, N m", "load driving, N m", "feedback share, %",
                      "ran"}};
    std::vector<Series> feedback;
    for (const LowRegion &l : r.low) {
        Row row = {l.name};
        for (const double x : l.error_rad)
            row.push_back(num(x, 2));
        row.push_back(num(l.error_max_rad, 2));
        for (const double x : l.feedback_nm)
            row.push_back(num(x));
        row.insert(row.end(), {num(100 * l.feedback_share, 2), l.fault.empty() ? "to the end" : l.fault});
        rows.push_back(row);
        feedback.push_back(series(l.name, l.run.t_s, column(l.run.feedback_nm, 1)));
    }
    page.table(rows, "Mean errors at the link side and rms of the feedback torque while the load is held "
                     "back by the motor, between T1 and T2 as measured in that direction (\"the step\"), "
                     "and beyond, where the load drives the joint.");
    page.html.plot(plot_of("Feedback torque of joint 2", "t, s", "N m", feedback));
}

// ---- printed equations and tables ----

void equations_table(const Results &r, Page &page)
{
    static const char *const number[5] = {"(9)", "(10)", "(11)", "(12)", "(13)"};
    Rows rows = {{"equation", "joint", "largest true torque, N m", "as printed: worst error, N m",
                  "negated: worst error, N m", "closed form used here: worst error, N m", "verdict"}};
    for (std::size_t i = 0; i < r.equations.size(); i++) {
        const EquationCheck &c = r.equations[i];
        const bool right = std::min(c.printed_nm, c.printed_negated_nm) < 1e-6;
        rows.push_back({number[i], std::to_string(i + 2), num(c.largest_nm), num(c.printed_nm),
                        num(c.printed_negated_nm), num(c.right_nm, 2),
                        right ? "right" : "not a gradient of the potential energy"});
    }
    page.table(rows, "Gravity torques with the masses of Table IV against the central difference of the "
                     "potential energy, 2000 random poses within half a turn.");
}

double holding_nm(const hdt_arm &arm, int joint)
{
    // this joint and all after it horizontal
    Eigen::VectorXd q = Eigen::VectorXd::Zero(arm.joints);
    q[joint - 1] = -pi / 2;
    return rbd::gravity(arm, q)[joint - 1];
}

void table_4_page(const Plan &plan, const Results &r, Page &page)
{
    Rows rows = {{"joint, horizontal", "Table IV, N m", "the paper's text", "model file, N m",
                  "rig: half the sum of both ways, N m",
                  "model over the same stretch, N m"}};
    for (const int joint : {2, 4, 6}) {
        SixAngles q{};
        q[static_cast<std::size_t>(joint - 1)] = -pi / 2;
        const std::size_t j = static_cast<std::size_t>(joint - 1);
        const bool swept = joint <= sweep_joints && plan.needs_stiffness();
        rows.push_back({std::to_string(joint), num(right_gravity(table_4, q)[j - 1]), joint == 6
                        ? "about 0.3 N m" : "", num(holding_nm(plan.rig.arm, joint)), swept
                            ? num(r.stiffness[j].gravity_at_minus_90_nm[0]) : "n/a",
                        swept ? num(r.stiffness[j].gravity_at_minus_90_nm[1]) : "n/a"});
    }
    page.table(rows, "Table IV as holding torque. Its 4.34 kg hand at 0.09 m gives joint 6 ten times what "
                     "the text says; per-link masses of the manufacturer agree with both the shoulder and "
                     "the text and are in the model file. Half the sum of the torque up and down is no "
                     "measurement of gravity in such a gear: friction differs between driving and being "
                     "driven, and half the step is added to it.");
}

void table_5_consistency(Page &page)
{
    Rows rows = {{"joint", "step +, N m", "step -, N m", "- / +", "T1, T2 of the - row"}};
    for (std::size_t j = 0; j < sweep_joints; j++) {
        const PrintedLines &p = table_5[j][0], &n = table_5[j][1];
        const double plus = p.slope_2 * (p.t_2 - p.t_1), minus = n.slope_2 * (n.t_2 - n.t_1);
        rows.push_back({std::to_string(j + 1), num(plus), num(minus), num(minus / plus, 2),
                        n.t_1 < n.t_2 ? "in order" : "out of order; swapped the step is " + num(-minus)});
    }
    page.table(rows, "Steps of Table V as printed. Read joint-signed, the - rows would let the motor torque "
                     "rise where gravity helps, against the text; they are torque along the motion. Then "
                     "joints 2, 3 (swapped) and 4 agree between directions within 4 %; row 1- has half the "
                     "step of 1+.");
}

void equations_page(const Plan &plan, const Results &r, Page &page)
{
    page.heading("Printed equations and tables");
    equations_table(r, page);
    table_4_page(plan, r, page);
    table_5_consistency(page);
}

} // namespace

void write_page(const std::string &dir, const Plan &plan, const Results &r)
{
    Page page("Kennedy and Desai 2005, again: the paper's experiments in the rig");
    const std::vector<Statement> said = statements(plan, r);
    const auto hold = std::count_if(said.begin(), said.end(), [](const Statement &s) { return s.holds; });
    page.html.verdict(std::to_string(hold) + " of " + std::to_string(said.size()) +
                          " statements of the paper hold in the rig. The arm is simulated from " +
                          plan.rig.arm.name + " (individual " + std::to_string(plan.rig.individual) +
                          ", seed " + std::to_string(plan.rig.seed) + "); every torque is what the servo "
                                                                      "reports in its telegrams.",
                      2 * hold > static_cast<long>(said.size()));
    Rows rows = {{"statement", "paper", "rig", "holds"}};
    for (const Statement &s : said)
        rows.push_back({s.text, s.paper, s.ours, s.holds ? "yes" : "no"});
    page.markdown += "### Statements\n\n";
    page.table(rows, "What the paper says and what the rig says to it. The criterion stands in brackets "
                     "where there is one.");
    if (plan.want(PART_FRICTION))
        friction_page(plan, r, page);
    if (plan.want(PART_POSITION))
        position_page(plan, r, page);
    if (plan.want(PART_STIFFNESS))
        stiffness_page(r, page);
    if (plan.want(PART_LEMNISCATE))
        lemniscate_page(plan, r, page);
    if (plan.want(PART_JOINT_3))
        joint_3_page(r, page);
    if (plan.want(PART_LOW))
        low_page(r, page);
    if (plan.want(PART_EQUATIONS))
        equations_page(plan, r, page);
    page.html.write(dir + "/report.html");
    write_file(dir + "/tables.md", page.markdown);
    write_file(dir + "/paper.json", json_of(plan, r));
}

} // namespace hdt::paper
