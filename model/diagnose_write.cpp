// SPDX-License-Identifier: Apache-2.0
//
// Owns: diagnosis.json, report.html and model.toml of a diagnosis.
// Never: computes a result; leaves a partial file under its final name.
#include "model/diagnose.hpp"

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "model/files.hpp"
#include "model/report.hpp"

namespace hdt {

namespace {

using Json = nlohmann::ordered_json;
using Rows = std::vector<std::vector<std::string>>;

Json effect_json(const Effect &e)
{
    Json j;
    j["id"] = e.id;
    if (!e.axis.empty())
        j["axis"] = e.axis;
    j["depends_on"] = e.depends_on;
    j["rms_nm"] = e.rms_nm;
    j["p_adjusted"] = e.p_adjusted;
    Json params = Json::object();
    for (const EffectParameter &p : e.parameters)
        params[p.name] = {{"value", p.value}, {"sigma", p.sigma}, {"unit", p.unit}};
    j["params"] = std::move(params);
    if (!e.table_x.empty())
        j["table"] = {{"x", e.table_x}, {"tau_nm", e.table_nm}};
    j["adopted"] = e.adopted;
    if (!e.refused.empty())
        j["refused"] = e.refused;
    return j;
}

Json joint_json(const JointDiagnosis &d)
{
    Json j;
    j["joint"] = d.joint;
    j["verdict"] = d.verdict;
    j["noise_floor_nm"] = d.noise_floor_nm;
    j["rms_before_nm"] = d.rms_before_nm;
    j["rms_after_nm"] = d.rms_after_nm;
    j["rms_refit_nm"] = d.rms_refit_nm;
    if (d.refuses())
        j["rms_explained_nm"] = d.rms_explained_nm;
    j["friction_refitted"] = d.friction_refitted;
    j["effects"] = Json::array();
    for (const Effect &e : d.effects)
        j["effects"].push_back(effect_json(e));
    j["ambiguous_with"] = d.ambiguous_with;
    j["next_experiment"] = d.next_experiment;
    j["words"] = d.words;
    j["events"] = Json::array();
    for (const RunEvent &e : d.events) {
        Json one = {{"run", e.run},
                    {"from_s", e.from_s},
                    {"to_s", e.to_s},
                    {"kind", e.kind},
                    {"torque_nm", e.torque_nm}};
        if (e.kind == "angle")
            one["angle_rad"] = e.angle_rad;
        one["log_likelihood"] = e.log_likelihood;
        j["events"].push_back(std::move(one));
    }
    j["tried"] = Json::array();
    for (const Candidate &c : d.tried)
        j["tried"].push_back({{"id", c.id},
                              {"log_e", c.log_e},
                              {"p_adjusted", c.p_adjusted},
                              {"rms_nm", c.rms_nm},
                              {"gain_nm", c.gain_nm},
                              {"note", c.note}});
    Json limits = Json::object();
    for (const auto &[id, nm] : d.detection_limit_nm)
        limits[id] = nm;
    j["detection_limit_nm"] = std::move(limits);
    return j;
}

std::string diagnosis_json(const Diagnosis &d)
{
    Json j;
    j["format"] = "hdt-diagnosis";
    j["version"] = 1;
    j["joints"] = Json::array();
    for (const JointDiagnosis &one : d.joints)
        j["joints"].push_back(joint_json(one));
    j["skipped"] = Json::array();
    for (const auto &[joint, why] : d.skipped)
        j["skipped"].push_back({{"joint", joint}, {"why", why}});
    return j.dump(2) + "\n";
}

std::string joined(const std::vector<std::string> &items)
{
    std::string out;
    for (const std::string &s : items)
        out += (out.empty() ? "" : ", ") + s;
    return out;
}

// Both curves on the same scale: before and after are compared by eye.
void add_pictures(Report *report, const JointDiagnosis &d)
{
    double top = 1e-9;
    for (double r : d.residual_before_nm)
        top = std::max(top, std::abs(r));
    const auto residual = [&](const std::string &title, const std::vector<double> &y, int color) {
        Plot p;
        p.title = title;
        p.xlabel = d.axis_label;
        p.ylabel = "residual, N.m";
        p.ymin = -1.05 * top;
        p.ymax = 1.05 * top;
        p.width_px = 430;
        p.series.push_back({"", d.axis_x, y, Series::Points, color});
        return p;
    };
    const std::string after = d.refuses() ? "with what the model file cannot hold" : "after";
    report->plots({residual("before, held-out runs", d.residual_before_nm, PALETTE_BEFORE),
                   residual(after + ", held-out runs", d.residual_after_nm, PALETTE_AFTER)});
    if (d.order.empty())
        return;
    Plot p;
    p.title = "lines of the residual by order per output turn, held-out runs";
    p.xlabel = "order per output turn";
    p.ylabel = "amplitude, N.m";
    p.series.push_back({"before", d.order, d.spectrum_before_nm, Series::Line, PALETTE_BEFORE});
    p.series.push_back({after, d.order, d.spectrum_after_nm, Series::Line, PALETTE_AFTER});
    report->plot(p);
}

void add_joint(Report *report, const JointDiagnosis &d)
{
    report->heading("Joint " + std::to_string(d.joint));
    report->verdict(d.words, (d.verdict == "nothing" || d.verdict == "named") && !d.unexplained());
    if (!d.next_experiment.empty())
        report->paragraph("Next run: " + d.next_experiment);
    if (!d.effects.empty()) {
        Rows rows = {{"effect", "number", "value", "sigma", "unit", "rms N.m", "p adjusted", "in the model"}};
        for (const Effect &e : d.effects) {
            const std::string name = e.axis.empty() ? e.id : e.id + ": " + e.axis;
            if (e.parameters.empty())
                rows.push_back({name, "", "", "", "", num(e.rms_nm), num(e.p_adjusted, 2),
                                e.adopted ? "yes" : "no"});
            for (const EffectParameter &p : e.parameters)
                rows.push_back({name, p.name, num(p.value, 4), num(p.sigma, 2), p.unit, num(e.rms_nm),
                                num(e.p_adjusted, 2), e.adopted ? "yes" : "no"});
        }
        report->table(rows, "What is missing, with its numbers");
    }
    if (!d.events.empty()) {
        Rows rows = {{"run", "from s", "to s", "kind", "torque N.m", "angle rad"}};
        for (const RunEvent &e : d.events)
            rows.push_back({e.run, num(e.from_s), num(e.to_s), e.kind, num(e.torque_nm),
                            e.kind == "angle" ? num(e.angle_rad) : ""});
        report->table(rows, "In part of one run only: a push, a drag, a slip. Left out of the fit, no part "
                            "of the model");
    }
    if (!d.residual_before_nm.empty())
        add_pictures(report, d);
    Rows tried = {{"candidate", "log e", "p adjusted", "rms N.m", "held-out gain N.m", ""}};
    for (const Candidate &c : d.tried)
        tried.push_back({c.id, c.log_e < -1e8 ? "" : num(c.log_e), num(c.p_adjusted, 2), num(c.rms_nm),
                         num(c.gain_nm), c.note});
    report->table(tried, "Everything tried, strongest evidence first, before anything was added. log e above "
                         "log(number tried / 0.05) counts as evidence; gain is leave-one-run-out within the "
                         "fit runs");
    if (d.detection_limit_nm.empty())
        return;
    Rows limits = {{"effect", "would have been seen from, N.m rms"}};
    for (const auto &[id, nm] : d.detection_limit_nm)
        limits.push_back({id, num(nm, 2)});
    report->table(limits, "Detection limits of these runs");
}

} // namespace

void write_diagnosis(const Diagnosis &d, const std::string &dir)
{
    Report report("Diagnosis of " + std::string(d.model.arm().name));
    bool good = true;
    Rows rows = {{"joint", "verdict", "effect", "floor", "before", "refit", "after", "cannot be told from"}};
    std::string first;
    for (const JointDiagnosis &j : d.joints) {
        std::vector<std::string> names;
        for (const Effect &e : j.effects)
            names.push_back(e.axis.empty() ? e.id : e.axis);
        rows.push_back({std::to_string(j.joint), j.verdict, joined(names), num(j.noise_floor_nm),
                        num(j.rms_before_nm), num(j.rms_refit_nm), num(j.rms_after_nm),
                        joined(j.ambiguous_with)});
        good = good && (j.verdict == "nothing" || j.verdict == "named") && !j.unexplained();
        if (j.verdict != "nothing" || j.friction_refitted || j.unexplained())
            first += (first.empty() ? "" : "\n") + ("Joint " + std::to_string(j.joint) + ": " + j.words);
    }
    report.verdict(first.empty() ? "Nothing is missing that these runs could show." : first, good);
    report.table(rows, "Root mean square of the torque residual on held-out runs, N.m output side. before: "
                       "the model as given; refit: Coulomb and viscous friction fitted again, nothing added; "
                       "after: the model written. floor: what the best candidate of all, named or not, "
                       "leaves on a fit run left out");
    for (const auto &[joint, why] : d.skipped)
        report.paragraph("Joint " + std::to_string(joint) + " is left out: " + why + ".");
    for (const JointDiagnosis &j : d.joints)
        add_joint(&report, j);
    d.model.save(dir + "/model.toml");
    write_file(dir + "/diagnosis.json", diagnosis_json(d));
    report.write(dir + "/report.html");
}

} // namespace hdt
