// SPDX-License-Identifier: Apache-2.0
//
// What an identification leaves behind: model.toml, ident.json (format hdt-ident, version 1) and
// report.html.
//
// Owns: the look of the identification report, the shape of ident.json.
// Never: computes a fit.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include <nlohmann/json.hpp>

#include "model/files.hpp"
#include "model/ident.hpp"
#include "model/report.hpp"
#include "model/terms.hpp"

namespace hdt {

using nlohmann::ordered_json;

namespace {

constexpr std::size_t plot_points = 4000;
constexpr int friction_bins = 40;

ordered_json number(double x) { return std::isfinite(x) ? ordered_json(x) : ordered_json(nullptr); }

ordered_json parameter_json(const FitParameter &p)
{
    return {{"key", p.key},
            {"unit", p.unit},
            {"value", number(p.value)},
            {"sigma", number(p.sigma)},
            {"excited", p.excited}};
}

ordered_json to_json(const IdentResult &r)
{
    ordered_json out = {{"format", "hdt-ident"}, {"version", 1}, {"arm", r.model.arm().name}};
    out["joints"] = ordered_json::array();
    for (const JointFit &j : r.joints) {
        ordered_json o = {{"joint", j.joint}, {"blocks", j.rows}, {"rows_masked", j.masked},
                          {"rms_before_nm", number(j.rms_before_nm)},
                          {"rms_after_nm", number(j.rms_after_nm)},
                          {"held_out_before_nm", number(j.held_out_before_nm)},
                          {"held_out_after_nm", number(j.held_out_after_nm)},
                          {"gravity_scale",
                           {{"value", number(j.gravity_scale)}, {"sigma", number(j.gravity_scale_sigma)}}}};
        o["friction_curves"] = ordered_json::array();
        for (const FrictionScore &s : j.friction)
            o["friction_curves"].push_back({{"curve", s.curve},
                                            {"numbers", s.numbers},
                                            {"rms_nm", number(s.rms_nm)},
                                            {"left_out_nm", number(s.left_out_nm)},
                                            {"bic", number(s.bic)}});
        o["parameters"] = ordered_json::array();
        for (const FitParameter &p : j.parameters)
            o["parameters"].push_back(parameter_json(p));
        out["joints"].push_back(o);
    }
    out["chain"] = ordered_json::array();
    for (const FitParameter &p : r.chain)
        out["chain"].push_back(parameter_json(p));
    out["notes"] = r.notes;
    return out;
}

std::string cell(double x) { return std::isfinite(x) ? num(x) : "-"; }

bool has_test(const IdentResult &r)
{
    return std::any_of(r.joints.begin(), r.joints.end(),
                       [](const JointFit &j) { return std::isfinite(j.held_out_after_nm); });
}

void verdict(const IdentResult &r, Report *report)
{
    bool test = has_test(r);
    int better = 0, judged = 0;
    for (const JointFit &j : r.joints) {
        double before = test ? j.held_out_before_nm : j.rms_before_nm;
        double after = test ? j.held_out_after_nm : j.rms_after_nm;
        if (!std::isfinite(after))
            continue;
        judged++;
        better += after < before;
    }
    std::string where = test ? "on the test runs" : "on the fit runs; no test runs were given";
    bool good = judged > 0 && better == judged;
    report->verdict(std::to_string(better) + " of " + std::to_string(judged)
                        + " joints predict torque better than before, " + where + ".",
                    good);
}

void before_after(const IdentResult &r, Report *report)
{
    report->heading("Torque error before and after");
    std::vector<std::vector<std::string>> rows = {
        {"joint", "blocks", "rows masked", "fit before", "fit after", "held out before", "held out after",
         "own gravity scale", "sigma"}};
    for (const JointFit &j : r.joints)
        rows.push_back({std::to_string(j.joint), std::to_string(j.rows), std::to_string(j.masked),
                        cell(j.rms_before_nm), cell(j.rms_after_nm), cell(j.held_out_before_nm),
                        cell(j.held_out_after_nm), cell(j.gravity_scale), cell(j.gravity_scale_sigma)});
    report->table(rows, "Root mean square of block means, N m at the output. Rows are masked at standstill, "
                        "near reversals, at spikes, in saturation and beside gaps.");
    for (const std::string &note : r.notes)
        report->paragraph(note + ".");
}

void friction_curves(const IdentResult &r, Report *report)
{
    std::vector<std::vector<std::string>> rows = {
        {"joint", "viscous", "cubic", "Stribeck", "left out: viscous", "cubic", "Stribeck", "least BIC"}};
    for (const JointFit &j : r.joints) {
        if (j.friction.size() != 3)
            continue;
        std::vector<std::string> row = {std::to_string(j.joint)};
        for (const FrictionScore &s : j.friction)
            row.push_back(cell(s.rms_nm));
        for (const FrictionScore &s : j.friction)
            row.push_back(cell(s.left_out_nm));
        const auto less = [](const FrictionScore &a, const FrictionScore &b) { return a.bic < b.bic; };
        row.push_back(std::min_element(j.friction.begin(), j.friction.end(), less)->curve);
        rows.push_back(row);
    }
    report->table(rows, "The paper's three friction curves on the same rows, N m rms, all else as fitted; "
                        "left out: each run predicted from the others. BIC counts stretches of time, not "
                        "rows.");
}

// Means over equal steps of speed; empty steps are left out.
Series binned(const JointFit &j)
{
    Series s;
    s.title = "measured, binned";
    s.style = Series::Points;
    double top = 0;
    for (double v : j.v_radps)
        top = std::max(top, std::fabs(v));
    std::vector<double> sum(friction_bins, 0), speed(friction_bins, 0), count(friction_bins, 0);
    for (std::size_t i = 0; i < j.v_radps.size() && top > 0; i++) {
        double at = (j.v_radps[i] / top + 1) / 2 * friction_bins;
        std::size_t b = static_cast<std::size_t>(std::clamp(at, 0.0, friction_bins - 1.0));
        sum[b] += j.friction_nm[i];
        speed[b] += j.v_radps[i];
        count[b]++;
    }
    for (std::size_t b = 0; b < sum.size(); b++)
        if (count[b] > 0) {
            s.x.push_back(speed[b] / count[b]);
            s.y.push_back(sum[b] / count[b]);
        }
    return s;
}

Series curve(const hdt_arm_joint &joint, const JointFit &j)
{
    Series s;
    s.title = "model";
    double lo = 0, hi = 0;
    for (double v : j.v_radps) {
        lo = std::min(lo, v);
        hi = std::max(hi, v);
    }
    for (int k = 0; k <= 200; k++) {
        double v = lo + (hi - lo) * k / 200;
        // a break at zero, not a steep line through it
        bool crossing = !s.x.empty() && s.x.back() < 0 && v >= 0;
        if (crossing) {
            s.x.push_back(0);
            s.y.push_back(std::numeric_limits<double>::quiet_NaN());
        }
        s.x.push_back(v);
        s.y.push_back(v < 0 ? -stribeck_nm(joint.friction[1], -v) : stribeck_nm(joint.friction[0], v));
    }
    return s;
}

Series thinned(const std::string &title, const std::vector<double> &x, const std::vector<double> &y,
               Series::Style style)
{
    Series s;
    s.title = title;
    s.style = style;
    std::size_t step = std::max<std::size_t>(1, x.size() / plot_points);
    for (std::size_t i = 0; i < x.size(); i += step) {
        s.x.push_back(x[i]);
        s.y.push_back(y[i]);
    }
    return s;
}

void pictures(const IdentResult &r, const JointFit &j, Report *report)
{
    if (j.t_s.empty())
        return;
    const hdt_arm_joint &joint = r.model.arm().joint[j.joint - 1];
    Plot time;
    time.title = "Residual over time";
    time.xlabel = "time, runs one after the other (s)";
    time.ylabel = "N m";
    time.series = {thinned("before", j.t_s, j.residual_before_nm, Series::Line),
                   thinned("after", j.t_s, j.residual_after_nm, Series::Line)};
    report->plot(time);
    Plot friction;
    friction.title = "Friction";
    friction.xlabel = "speed (rad/s)";
    friction.ylabel = "N m";
    friction.width_px = 430;
    friction.series = {binned(j)};
    if (joint.has_friction)
        friction.series.push_back(curve(joint, j));
    Plot speed;
    speed.title = "Residual over speed";
    speed.xlabel = "speed (rad/s)";
    speed.ylabel = "N m";
    speed.width_px = 430;
    speed.series = {thinned("before", j.v_radps, j.residual_before_nm, Series::Points),
                    thinned("after", j.v_radps, j.residual_after_nm, Series::Points)};
    report->plots({friction, speed});
}

void parameters(const std::vector<FitParameter> &list, const std::string &caption, Report *report)
{
    if (list.empty())
        return;
    std::vector<std::vector<std::string>> rows = {{"key", "value", "sigma", "unit", "from"}};
    for (const FitParameter &p : list)
        rows.push_back(
            {p.key, cell(p.value), cell(p.sigma), p.unit, p.excited ? "fit" : "kept: not excited"});
    report->table(rows, caption);
}

} // namespace

void write_ident(const IdentResult &r, const std::string &dir)
{
    std::error_code error;
    std::filesystem::create_directories(dir, error);
    if (error)
        throw InputError(dir + ": expected a directory to write to, found: " + error.message());
    Report report("Identification of " + std::string(r.model.arm().name));
    verdict(r, &report);
    before_after(r, &report);
    friction_curves(r, &report);
    parameters(r.chain, "Numbers of the whole chain", &report);
    for (const JointFit &j : r.joints) {
        report.heading("Joint " + std::to_string(j.joint) + " " + r.model.arm().joint[j.joint - 1].name);
        pictures(r, j, &report);
        parameters(j.parameters,
                   "Joint " + std::to_string(j.joint) + ", output side unless the key says motor; sigma by "
                   "leaving out runs or stretches of time",
                   &report);
    }
    r.model.save(dir + "/model.toml");
    write_file(dir + "/ident.json", to_json(r).dump(2) + "\n");
    report.write(dir + "/report.html");
}

} // namespace hdt
