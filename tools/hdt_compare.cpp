// SPDX-License-Identifier: Apache-2.0
//
// `hdt compare`: two closed-loop runs of one task, before and after, as figures and pictures; and
// what was named against what was hidden, for those who know.
#include <cmath>
#include <cstdio>
#include <memory>

#include <nlohmann/json.hpp>

#include "ctrl/hdt.h"
#include "model/log.hpp"
#include "model/rbd.hpp"
#include "model/report.hpp"
#include "model/text.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_effects.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

using Eigen::VectorXd;

struct CompareOptions { std::string model, before, after, diagnosis, hidden, out; };

// Closed-loop figures of one run.
struct Figures {
    double feedback_share = 0;               // rms of feedback over rms of total torque, all joints
    double error_mean_mm = 0, error_max_mm = 0;
    std::vector<double> feedback_nm, total_nm; // rms per joint
    std::vector<double> t_s, error_mm;
    Eigen::MatrixXd path_m, reference_m;     // rows x 3
};

const std::vector<double> *column(const Run &run, const std::string &name)
{
    auto found = run.extra.find(name);
    return found == run.extra.end() ? nullptr : &found->second;
}

// Sum of the named terms of one joint at one row; a term not logged is not used by the model.
double sum_terms(const Run &run, std::size_t joint, std::size_t row, bool feedback)
{
    double sum = 0;
    for (int term = 0; term < HDT_TERMS; term++) {
        if (feedback && term != HDT_TERM_P && term != HDT_TERM_D)
            continue;
        if (const auto *c = column(run, std::string(hdt_term_str(term)) + std::to_string(joint + 1) + "_nm"))
            sum += (*c)[row];
    }
    return sum;
}

void joint_angles(const Run &run, std::size_t row, VectorXd &q, VectorXd &q_ref)
{
    for (std::size_t j = 0; j < run.joint.size() && j < static_cast<std::size_t>(q.size()); j++) {
        const Run::Joint &joint = run.joint[j];
        Eigen::Index at = static_cast<Eigen::Index>(j);
        q[at] = joint.present ? joint.q_rad[row] : 0;
        q_ref[at] = joint.qref_rad.empty() ? q[at] : joint.qref_rad[row];
    }
}

// A constant as it stands in the log's head, or that there is none.
std::string stated(const Run &run, const std::string &key)
{
    auto found = run.constants.find(key);
    return found == run.constants.end() ? "nothing" : "\"" + found->second + "\"";
}

bool has_feedback_terms(const Run &run)
{
    for (std::size_t j = 1; j <= run.joint.size(); j++)
        for (int term : {HDT_TERM_P, HDT_TERM_D})
            if (column(run, std::string(hdt_term_str(term)) + std::to_string(j) + "_nm") != nullptr)
                return true;
    return false;
}

// What differs between unlike runs is no improvement.
void check_comparable(const Run &before, const Run &after)
{
    if (same_measurement(before, after))
        throw InputError(after.path + ": the same measurement as " + before.path +
                         ": expected one run before and another after");
    for (const char *key : {"arm", "task", "mode", "payload_kg", "payload_com_m"})
        if (stated(before, key) != stated(after, key))
            throw InputError(after.path + ": " + key + ": expected " + stated(before, key) + " as in " +
                             before.path + ", found " + stated(after, key) +
                             "; only runs of one task with one arm compare");
    for (const Run *run : {&before, &after})
        if (!has_feedback_terms(*run))
            throw InputError(run->path + ": expected the feedback's torques (p1_nm, d1_nm, ...), found none: "
                                         "log the run with --terms");
}

// The rows from the first to the last with a moving reference: standing by before and after is no task.
Run moving_part(const Run &run)
{
    std::size_t first = run.rows(), last = 0;
    for (const Run::Joint &joint : run.joint)
        for (std::size_t k = 0; k < joint.vref_radps.size(); k++)
            if (joint.vref_radps[k] != 0) {
                first = std::min(first, k);
                last = std::max(last, k);
            }
    if (first >= last)
        throw InputError(run.path +
                         ": no reference moves in this run (expected vref columns that are not all zero)");
    return cut_run(run, run.t_s[first], run.t_s[last]);
}

Figures figures_of(const hdt_arm &arm, const Run &run)
{
    if (run.joint.size() != static_cast<std::size_t>(arm.joints))
        throw InputError(run.path + ": " + std::to_string(run.joint.size()) + " joints, but the model has " +
                         std::to_string(arm.joints));
    Figures f;
    Eigen::Index rows = static_cast<Eigen::Index>(run.rows());
    f.path_m.resize(rows, 3);
    f.reference_m.resize(rows, 3);
    VectorXd q = VectorXd::Zero(arm.joints), q_ref = q;
    double feedback_all = 0, total_all = 0;
    std::vector<double> feedback(run.joint.size()), total(run.joint.size());
    for (std::size_t k = 0; k < run.rows(); k++) {
        joint_angles(run, k, q, q_ref);
        Eigen::Index row = static_cast<Eigen::Index>(k);
        f.path_m.row(row) = rbd::flange(arm, q).pos;
        f.reference_m.row(row) = rbd::flange(arm, q_ref).pos;
        f.t_s.push_back(run.t_s[k]);
        f.error_mm.push_back(1e3 * (f.path_m.row(row) - f.reference_m.row(row)).norm());
        f.error_mean_mm += f.error_mm.back() / static_cast<double>(run.rows());
        f.error_max_mm = std::max(f.error_max_mm, f.error_mm.back());
        for (std::size_t j = 0; j < run.joint.size(); j++) {
            double fb = sum_terms(run, j, k, true), all = sum_terms(run, j, k, false);
            feedback[j] += fb * fb;
            total[j] += all * all;
            feedback_all += fb * fb;
            total_all += all * all;
        }
    }
    for (std::size_t j = 0; j < run.joint.size(); j++) {
        f.feedback_nm.push_back(std::sqrt(feedback[j] / static_cast<double>(run.rows())));
        f.total_nm.push_back(std::sqrt(total[j] / static_cast<double>(run.rows())));
    }
    f.feedback_share = total_all > 0 ? std::sqrt(feedback_all / total_all) : 0;
    return f;
}

struct Named {
    int joint;
    std::string verdict, effect, ambiguous;
    double floor_nm, before_nm, after_nm;
};

struct Diagnosed { nlohmann::json json; std::vector<Named> joints; };

// What a reader of diagnosis.json may count on; throws what nlohmann::json throws where it is not there.
std::vector<Named> named_effects(const nlohmann::json &diagnosis)
{
    std::vector<Named> rows;
    for (const auto &joint : diagnosis.at("joints")) {
        Named n{joint.at("joint"), joint.at("verdict"), "", "", joint.at("noise_floor_nm"),
                joint.at("rms_before_nm"), joint.at("rms_after_nm")};
        for (const auto &effect : joint.at("effects")) {
            n.effect += (n.effect.empty() ? "" : ", ") + effect.at("id").get<std::string>();
            for (const auto &[name, value] : effect.at("params").items())
                n.effect += " " + name + " " + num(value.at("value"));
        }
        for (const auto &other : joint.at("ambiguous_with"))
            n.ambiguous += (n.ambiguous.empty() ? "" : ", ") + other.get<std::string>();
        rows.push_back(n);
    }
    return rows;
}

// format, version and shape of diagnosis.json, before anything is made of it.
Diagnosed read_diagnosis(const std::string &path)
{
    Diagnosed d;
    try {
        d.json = nlohmann::json::parse(read_text(path));
    } catch (const nlohmann::json::exception &) {
        throw InputError(path + ": expected JSON, as hdt diagnose writes it");
    }
    const auto member = [&](const char *key) {
        return d.json.is_object() && d.json.contains(key) ? d.json[key].dump() : std::string("nothing");
    };
    if (member("format") != "\"hdt-diagnosis\"")
        throw InputError(path + ": format: expected \"hdt-diagnosis\", found " + member("format"));
    if (member("version") != "1")
        throw InputError(path + ": version: this program reads 1, found " + member("version") +
                         "; use the program that wrote it");
    try {
        d.joints = named_effects(d.json);
    } catch (const nlohmann::json::exception &e) {
        const std::string what = e.what(); // "[json.exception.type_error.302] type must be ..."
        throw InputError(path + ": not of the shape docs/formats.md has: " +
                         what.substr(std::min(what.size(), what.find(']') + 2)));
    }
    for (const Named &n : d.joints)
        if (n.verdict != "named" && n.verdict != "unnamed" && n.verdict != "suspect" &&
            n.verdict != "nothing")
            throw InputError(path + ": joint " + std::to_string(n.joint) +
                             ": verdict: expected named, unnamed, suspect or nothing, found " +
                             shown(n.verdict));
    return d;
}

// "named" when the diagnosis lists it first for its joint (payload: for any), "in the set" when
// among the ambiguous, "missed" otherwise.
std::string judge(const nlohmann::json &diagnosis, const rig::HiddenEffect &hidden)
{
    std::string verdict = "missed";
    for (const auto &joint : diagnosis.at("joints")) {
        bool anywhere = hidden.name == "payload";
        if (!anywhere && joint.at("joint") != hidden.joint)
            continue;
        for (const auto &effect : joint.at("effects"))
            if (effect.at("id") == hidden.name)
                return "named";
        for (const auto &other : joint.at("ambiguous_with"))
            if (other == hidden.name)
                verdict = "in the set";
    }
    return verdict;
}

std::vector<double> matrix_column(const Eigen::MatrixXd &m, Eigen::Index c)
{
    std::vector<double> v;
    for (Eigen::Index r = 0; r < m.rows(); r++)
        v.push_back(m(r, c));
    return v;
}

Series series(const std::string &title, std::vector<double> x, std::vector<double> y)
{
    Series s;
    s.title = title;
    s.x = std::move(x);
    s.y = std::move(y);
    return s;
}

Plot path_plot(const Figures &f, const std::string &title)
{
    Plot p;
    p.title = title;
    p.xlabel = "y, m";
    p.ylabel = "z, m";
    p.width_px = 420;
    p.height_px = 380;
    p.equal_axes = true;
    p.series = {series("reference", matrix_column(f.reference_m, 1), matrix_column(f.reference_m, 2)),
                series("flange", matrix_column(f.path_m, 1), matrix_column(f.path_m, 2))};
    return p;
}

Plot term_plot(const Run &run, std::size_t joint, const std::string &title)
{
    Plot p;
    p.title = title;
    p.xlabel = "t, s";
    p.ylabel = "N m, output side";
    for (int term = 0; term < HDT_TERMS; term++)
        if (const auto *c = column(run, std::string(hdt_term_str(term)) + std::to_string(joint + 1) + "_nm"))
            p.series.push_back(series(hdt_term_str(term), run.t_s, *c));
    return p;
}

// True torque, as far as the model knows the gain, less feed-forward: what the model lacks.
std::vector<double> residual_of(const Run &run, std::size_t joint, double torque_gain)
{
    std::vector<double> residual;
    for (std::size_t k = 0; k < run.rows(); k++)
        residual.push_back(torque_gain * run.joint[joint].tau_nm[k] - sum_terms(run, joint, k, false) +
                           sum_terms(run, joint, k, true));
    return residual;
}

// The joint whose feedback torque differs most between the runs: the one worth a picture.
std::size_t most_changed(const Figures &a, const Figures &b)
{
    std::size_t best = 0;
    for (std::size_t j = 0; j < a.feedback_nm.size(); j++)
        if (std::fabs(a.feedback_nm[j] - b.feedback_nm[j]) >
            std::fabs(a.feedback_nm[best] - b.feedback_nm[best]))
            best = j;
    return best;
}

std::vector<std::vector<std::string>> figure_rows(const Figures &a, const Figures &b)
{
    std::vector<std::vector<std::string>> rows = {
        {"closed loop", "before", "after"},
        {"feedback torque share, %", num(100 * a.feedback_share), num(100 * b.feedback_share)},
        {"mean flange error, mm", num(a.error_mean_mm), num(b.error_mean_mm)},
        {"maximum flange error, mm", num(a.error_max_mm), num(b.error_max_mm)}};
    for (std::size_t j = 0; j < a.feedback_nm.size(); j++)
        rows.push_back({"joint " + std::to_string(j + 1) + " feedback rms, N m", num(a.feedback_nm[j]),
                        num(b.feedback_nm[j])});
    return rows;
}

std::vector<std::vector<std::string>> residual_rows(const std::vector<Named> &joints)
{
    std::vector<std::vector<std::string>> rows = {
        {"joint", "verdict", "effect", "or", "noise floor, N m", "residual before", "after (held out)"}};
    for (const Named &n : joints)
        rows.push_back({std::to_string(n.joint), n.verdict, n.effect, n.ambiguous, num(n.floor_nm),
                        num(n.before_nm), num(n.after_nm)});
    return rows;
}

void print_rows(const std::vector<std::vector<std::string>> &rows)
{
    std::vector<std::size_t> width;
    for (const auto &row : rows)
        for (std::size_t c = 0; c < row.size(); c++) {
            width.resize(std::max(width.size(), c + 1));
            width[c] = std::max(width[c], row[c].size());
        }
    for (const auto &row : rows) {
        for (std::size_t c = 0; c < row.size(); c++)
            std::printf("%s%-*s", c == 0 ? "" : "  ", static_cast<int>(width[c]), row[c].c_str());
        std::printf("\n");
    }
}

int run(const CompareOptions &o)
{
    hdt_arm arm = rig::load_arm(o.model);
    Run before = read_run(o.before), after = read_run(o.after);
    check_comparable(before, after);
    before = moving_part(before);
    after = moving_part(after);
    Figures a = figures_of(arm, before), b = figures_of(arm, after);
    Report report("Closed loop before and after");
    auto rows = figure_rows(a, b);
    std::string verdict = "Feedback torque share " + num(100 * a.feedback_share) + " % before, " +
                          num(100 * b.feedback_share) + " % after; mean flange error " +
                          num(a.error_mean_mm) + " mm before, " + num(b.error_mean_mm) + " mm after.";
    Diagnosed diagnosis;
    if (!o.diagnosis.empty())
        diagnosis = read_diagnosis(o.diagnosis);
    if (!o.hidden.empty()) {
        std::string hidden = rig::effect_lines(o.hidden).front().second;
        std::string found = judge(diagnosis.json, rig::parse_effect(hidden));
        verdict = "Hidden in the arm: " + hidden + ". The diagnosis: " + found + ". " + verdict;
    }
    bool better = b.feedback_share <= a.feedback_share;
    std::printf("%s\n\n", verdict.c_str());
    print_rows(rows);
    report.verdict(verdict, better);
    report.table(rows, "The same task with the model before and after.");
    if (!o.diagnosis.empty()) {
        auto residuals = residual_rows(diagnosis.joints);
        std::printf("\n");
        print_rows(residuals);
        report.table(residuals, "Torque residual on held-out runs, N m output side.");
    }
    report.heading("The path");
    report.plots({path_plot(a, "before"), path_plot(b, "after")});
    Plot error;
    error.title = "flange error";
    error.xlabel = "t, s";
    error.ylabel = "mm";
    error.series = {series("before", a.t_s, a.error_mm), series("after", b.t_s, b.error_mm)};
    report.plot(error);
    std::size_t joint = most_changed(a, b);
    report.heading("Torques by term, joint " + std::to_string(joint + 1));
    report.plot(term_plot(before, joint, "before"));
    report.plot(term_plot(after, joint, "after"));
    Plot residual;
    residual.title = "torque residual, joint " + std::to_string(joint + 1) + ": measured less feed-forward";
    residual.xlabel = "t, s";
    residual.ylabel = "N m, output side";
    residual.series = {series("before", before.t_s, residual_of(before, joint, 1)),
                       series("after", after.t_s, residual_of(after, joint, arm.joint[joint].torque_gain))};
    report.plot(residual);
    report.write(o.out);
    std::printf("\nreport: %s\n", o.out.c_str());
    return better ? Ok : No;
}

} // namespace

void add_compare(CLI::App &app, int &code)
{
    auto o = std::make_shared<CompareOptions>();
    CLI::App *sub = app.add_subcommand("compare", "two closed-loop runs of one task: figures and pictures");
    sub->add_option("--model", o->model, "model file of the run after")->required();
    sub->add_option("--before", o->before, "log with --terms")->required();
    sub->add_option("--after", o->after, "log with --terms")->required();
    CLI::Option *diagnosis = sub->add_option("--diagnosis", o->diagnosis, "diagnosis.json");
    sub->add_option("--hidden", o->hidden, "file with the effect hidden in the plant")->needs(diagnosis);
    sub->add_option("--out", o->out, "report to write, .html")->required();
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
