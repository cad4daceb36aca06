// SPDX-License-Identifier: Apache-2.0
//
// `hdt ident`, `hdt diagnose`, `hdt gen`: from logs to a model, from a model to tables.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "model/diagnose.hpp"
#include "model/files.hpp"
#include "model/ident.hpp"
#include "model/log_check.hpp"
#include "model/tablegen.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct FitOptions {
    bool few_runs = false;
    std::string model, joints, out;
    std::vector<std::string> fit, test;
    bool accept_log = false;
};

std::vector<Run> read_runs(const std::vector<std::string> &paths)
{
    Progress progress("reading logs");
    std::vector<Run> runs;
    for (const std::string &path : paths) {
        progress.at(static_cast<double>(runs.size()) / static_cast<double>(paths.size()));
        runs.push_back(read_run(path));
    }
    return runs;
}

// The model that is read is not the one that is written.
void check_out(const FitOptions &o)
{
    if (same_file(o.model, o.out + "/model.toml"))
        throw UsageError("--out: " + o.out + "/model.toml is the model that is read: expected another "
                         "directory");
}

// In one line, which of the arm's joints are not in the result, and why.
void say_left_out(const hdt_arm &arm, const std::vector<int> &in, const std::vector<int> &asked,
                  const std::vector<Run> &fit)
{
    std::string unasked, unlogged, other;
    const auto holds = [](const std::vector<int> &list, int j) {
        return std::find(list.begin(), list.end(), j) != list.end();
    };
    for (int j = 1; j <= arm.joints; j++) {
        const auto at = static_cast<std::size_t>(j - 1);
        const bool logged = std::any_of(fit.begin(), fit.end(), [&](const Run &run) {
            return at < run.joint.size() && run.joint[at].present;
        });
        if (holds(in, j))
            continue;
        std::string &why = !asked.empty() && !holds(asked, j) ? unasked : logged ? other : unlogged;
        why += " " + std::to_string(j);
    }
    if ((unasked + unlogged + other).empty())
        return;
    std::printf("joints left out:%s\n",
                ((unasked.empty() ? "" : unasked + " (not in --joints)") +
                 (unlogged.empty() ? "" : unlogged + " (no log has their position and torque)") +
                 (other.empty() ? "" : other + " (their rows do not tell: see the report)")).c_str());
}

// A number of the held-out runs; "-" without such.
std::string held_out(double nm)
{
    char text[32];
    std::snprintf(text, sizeof text, "%.3f", nm);
    return std::isfinite(nm) ? text : "-";
}

// A run given twice would weigh double, count as a run more, or be held out from itself.
void check_different(const std::vector<Run> &fit, const std::vector<Run> &test)
{
    std::vector<const Run *> all;
    for (const std::vector<Run> *runs : {&fit, &test})
        for (const Run &run : *runs) {
            for (const Run *other : all)
                if (same_measurement(*other, run))
                    throw InputError(run.path + ": the same measurement as " + other->path +
                                     ": expected every run once, among --fit and --test together");
            all.push_back(&run);
        }
}

constexpr const char *accept_log_help = "fit even logs whose units, signs, sides or columns look wrong";

// Before anything is fitted: a log that cannot mean what it says is refused with all that was found.
void check_columns(const ArmFile &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                   const FitOptions &o)
{
    std::vector<LogFinding> found = check_logs(arm.arm(), fit), more = check_logs(arm.arm(), test);
    found.insert(found.end(), more.begin(), more.end());
    if (const std::string warnings = log_warnings(found); !warnings.empty())
        std::fprintf(stderr, "%s\n", warnings.c_str());
    const std::string refusals = log_refusals(found);
    if (refusals.empty())
        return;
    if (!o.accept_log)
        throw InputError(refusals + "\nlog refused, nothing fitted or written: put it right, or --accept-log "
                                    "to take it as it stands");
    std::fprintf(stderr, "%s\naccepted as it stands: --accept-log\n", refusals.c_str());
}

int run_ident(const FitOptions &o)
{
    check_out(o);
    ArmFile arm = ArmFile::load(o.model);
    std::vector<Run> fit = read_runs(o.fit), test = read_runs(o.test);
    check_different(fit, test);
    check_columns(arm, fit, test, o);
    IdentOptions options;
    options.joints = parse_joints(o.joints);
    IdentResult result = identify(arm, fit, test, options);
    {
        const Uninterrupted together;
        make_directory(o.out);
        write_ident(result, o.out);
    }
    std::printf("joint   fit rms before  after    held out before  after   N.m\n");
    for (const JointFit &j : result.joints)
        std::printf("%5d %15.3f %6.3f %18s %6s\n", j.joint, j.rms_before_nm, j.rms_after_nm,
                    held_out(j.held_out_before_nm).c_str(), held_out(j.held_out_after_nm).c_str());
    std::vector<int> in;
    for (const JointFit &j : result.joints)
        in.push_back(j.joint);
    say_left_out(arm.arm(), in, options.joints, fit);
    for (const std::string &note : result.notes)
        std::printf("note: %s\n", note.c_str());
    std::printf("model: %s/model.toml   report: %s/report.html\n", o.out.c_str(), o.out.c_str());
    return Ok;
}

int run_diagnose(const FitOptions &o)
{
    check_out(o);
    ArmFile arm = ArmFile::load(o.model);
    std::vector<Run> fit = read_runs(o.fit), test = read_runs(o.test);
    check_different(fit, test);
    check_columns(arm, fit, test, o);
    DiagnoseOptions options;
    options.joints = parse_joints(o.joints);
    options.few_runs = o.few_runs;
    Diagnosis d = diagnose(arm, std::move(fit), std::move(test), options);
    {
        const Uninterrupted together;
        make_directory(o.out);
        write_diagnosis(d, o.out);
    }
    std::printf("joint  verdict   floor  before   after N.m   in words\n");
    for (const JointDiagnosis &j : d.joints)
        std::printf("%5d  %-8s %6.3f %7.3f %7.3f       %s\n", j.joint, j.verdict.c_str(), j.noise_floor_nm,
                    j.rms_before_nm, j.rms_after_nm, j.words.c_str());
    std::printf("diagnosis: %s/diagnosis.json   model: %s/model.toml   report: %s/report.html\n",
                o.out.c_str(), o.out.c_str(), o.out.c_str());
    return Ok;
}

// Does any joint have this term?
bool uses(const hdt_tables &tables, int term)
{
    return std::any_of(tables.joint, tables.joint + tables.joints,
                       [term](const hdt_joint_tab &joint) { return (joint.terms >> term & 1u) != 0; });
}

int run_gen(const std::string &path, const std::string &out)
{
    hdt_gen_report report;
    const hdt_tables tables = rig::tables_of(rig::load_arm(path), &report);
    // PATH/pa10.toml -> pa10
    std::string stem = path.substr(path.find_last_of('/') + 1);
    stem = stem.substr(0, stem.find_last_of('.'));
    std::string image(sizeof tables + 64, '\0');
    image.resize(hdt_tables_write(&tables, reinterpret_cast<uint8_t *>(image.data()), image.size()));
    make_directory(out);
    write_file(out + "/" + stem + ".hdtm", image);
    write_file(out + "/hdt_tables_" + stem + ".c", tables_c_source(tables, stem));
    std::printf("%s/%s.hdtm and %s/hdt_tables_%s.c, layout %u\n", out.c_str(), stem.c_str(), out.c_str(),
                stem.c_str(), HDT_TABLES_LAYOUT);
    std::printf("worst quantisation error, N.m output side:\n");
    for (int t = 0; t < HDT_TERMS; t++)
        if (uses(tables, t))
            std::printf("  %-12s %.2g%s\n", hdt_term_str(t), report.term_nm[t],
                        t == HDT_TERM_FRICTION ? "   (knots against eq. 7)" : "");
    return Ok;
}

} // namespace

void add_ident(CLI::App &app, int &code)
{
    auto o = std::make_shared<FitOptions>();
    CLI::App *sub = app.add_subcommand("ident", "fit the model's numbers to logs");
    sub->add_option("--arm", o->model, "model file to start from")->required();
    sub->add_option("--fit", o->fit, "logs to fit")->required();
    sub->add_option("--test", o->test, "logs held out");
    sub->add_option("--joints", o->joints, "only these, as in 2,4")->check(joint_list());
    sub->add_option("--out", o->out, "directory for model.toml, ident.json, report.html")->required();
    sub->add_flag("--accept-log", o->accept_log, accept_log_help);
    sub->callback([o, &code] { code = run_ident(*o); });
}

void add_diagnose(CLI::App &app, int &code)
{
    auto o = std::make_shared<FitOptions>();
    CLI::App *sub = app.add_subcommand("diagnose",
                                       "find the effect the model lacks, add it, report before and after");
    sub->add_option("--model", o->model, "model file, identified")->required();
    sub->add_option("--fit", o->fit, "logs to look at")->required();
    sub->add_option("--test", o->test, "logs held out for the before and after")->required();
    sub->add_option("--joints", o->joints, "only these, as in 2,4")->check(joint_list());
    sub->add_flag("--few-runs", o->few_runs,
                  "let fewer than four runs name what takes 15 % off the held-out error, and adopt it");
    sub->add_option("--out", o->out, "directory for diagnosis.json, model.toml, report.html")->required();
    sub->add_flag("--accept-log", o->accept_log, accept_log_help);
    sub->callback([o, &code] { code = run_diagnose(*o); });
}

void add_gen(CLI::App &app, int &code)
{
    auto path = std::make_shared<std::string>();
    auto out = std::make_shared<std::string>(".");
    CLI::App *sub = app.add_subcommand("gen", "fixed-point tables from a model file");
    sub->add_option("arm", *path, "model file")->required();
    sub->add_option("--out", *out, "directory for ARM.hdtm and hdt_tables_ARM.c")->capture_default_str();
    sub->callback([path, out, &code] { code = run_gen(*path, *out); });
}

} // namespace hdt::cli
