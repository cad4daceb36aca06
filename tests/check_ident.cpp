// SPDX-License-Identifier: Apache-2.0
//
// Identification against known truth.  The generator here is a vertical two-link arm in closed form
// (its own equations, no code of model/ but the Run struct), with friction, ripple, resolver
// steps, white and coloured noise and scatter of Coulomb friction from run to run.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "model/diagnose.hpp"
#include "model/ident.hpp"
#include "model/ident_solve.hpp"

#include "tests/scratch.hpp"
#include "tests/check_main.h"

using hdt::ArmFile;
using hdt::IdentResult;
using hdt::Run;

namespace {

constexpr double gear = 50;
constexpr double count_rad = 2 * M_PI / (gear * 16384);

struct Stribeck { double f0, fv, fs, vc; };
struct Line { double order, amplitude, phase; };

struct Truth {
    double m[2] = {6, 4}, c[2] = {0.2, 0.25}, i[2] = {0.05, 0.04}, l1 = 0.4; // about the centres
    double rotor[2] = {3e-4, 1e-4};                                          // motor side
    Stribeck friction[2][2] = {{{10, 6, -3, 0.05}, {12, 7, -2.5, 0.06}}, {{5, 3, 2, 0.08}, {4, 4, 1.5, 0.1}}};
    Line line[2] = {{2, 1.2, 0.7}, {1, 0.8, -1.1}};                          // per wave-generator turn
    double white_nm = 0.25, coloured_nm = 0.15, scatter_nm = 0.2;
    double payload_kg = 0, payload_at_m = 0.5;                               // along link 2 from its joint
    double offset_nm[2] = {0, 0};                                            // constant torque
};

double gauss(uint64_t *s)
{
    double u = test_uniform(s, 1e-12, 1), v = test_uniform(s, 0, 2 * M_PI);
    return std::sqrt(-2 * std::log(u)) * std::cos(v);
}

double friction(const Truth &t, int j, double v)
{
    const Stribeck &f = t.friction[j][v < 0];
    double s = std::fabs(v);
    return (v < 0 ? -1 : 1) * (f.f0 + f.fv * s + f.fs * (1 - std::exp(-s / f.vc)));
}

// Two links in a vertical plane, angles from the horizontal: Lagrange's equations written out.
void rigid(const Truth &t, const double q[2], const double v[2], const double a[2], double tau[2])
{
    double p = t.payload_kg, g = 9.81;
    double m2c2 = t.m[1] * t.c[1] + p * t.payload_at_m;
    double i2 = t.i[1] + t.m[1] * t.c[1] * t.c[1] + p * t.payload_at_m * t.payload_at_m;
    double i1 = t.i[0] + t.m[0] * t.c[0] * t.c[0] + (t.m[1] + p) * t.l1 * t.l1;
    double h = t.l1 * m2c2, c2 = std::cos(q[1]), s2 = std::sin(q[1]);
    tau[0] = (i1 + i2 + 2 * h * c2) * a[0] + (i2 + h * c2) * a[1] - h * s2 * (2 * v[0] * v[1] + v[1] * v[1])
             + g * ((t.m[0] * t.c[0] + (t.m[1] + p) * t.l1) * std::cos(q[0]) + m2c2 * std::cos(q[0] + q[1]));
    tau[1] = (i2 + h * c2) * a[0] + i2 * a[1] + h * s2 * v[0] * v[0] + g * m2c2 * std::cos(q[0] + q[1]);
    for (int j = 0; j < 2; j++)
        tau[j] += gear * gear * t.rotor[j] * a[j];
}

struct Motion {
    double amplitude[3], rate[3], phase[3], centre, drift;

    void at(double t, double *q, double *v, double *a) const
    {
        *q = centre + drift * t;
        *v = drift;
        *a = 0;
        for (int k = 0; k < 3; k++) {
            double x = rate[k] * t + phase[k];
            *q += amplitude[k] * std::sin(x);
            *v += amplitude[k] * rate[k] * std::cos(x);
            *a -= amplitude[k] * rate[k] * rate[k] * std::sin(x);
        }
    }
};

struct RunSpec {
    double seconds = 15, rate_hz = 200, jitter = 0.2;
    double drift = 0;               // rad/s, one direction only when large against the sines
    double swing = 1;
};

Motion random_motion(uint64_t *s, const RunSpec &spec, double centre)
{
    Motion m = {{0.5, 0.12, 0.04}, {2 * M_PI * 0.08, 2 * M_PI * 0.3, 2 * M_PI * 0.9}, {}, centre, spec.drift};
    for (int k = 0; k < 3; k++) {
        m.amplitude[k] *= spec.swing * test_uniform(s, 0.8, 1.2);
        m.rate[k] *= test_uniform(s, 0.8, 1.2);
        m.phase[k] = test_uniform(s, 0, 2 * M_PI);
    }
    return m;
}

Run make_run(const Truth &t, uint64_t seed, const RunSpec &spec = {})
{
    Run run;
    run.path = "made-" + std::to_string(seed) + ".csv";
    run.joint.resize(2);
    Motion m[2] = {random_motion(&seed, spec, 0.3), random_motion(&seed, spec, 0.8)};
    double scatter[2] = {t.scatter_nm * gauss(&seed), t.scatter_nm * gauss(&seed)}, slow[2] = {0, 0};
    double dt = 1 / spec.rate_hz, keep = std::exp(-dt / 0.4);
    for (double time = 0; time < spec.seconds;
         time += dt * (1 + test_uniform(&seed, -spec.jitter, spec.jitter))) {
        double q[2], v[2], a[2], tau[2];
        for (int j = 0; j < 2; j++)
            m[j].at(time, &q[j], &v[j], &a[j]);
        rigid(t, q, v, a, tau);
        run.t_s.push_back(time);
        for (int j = 0; j < 2; j++) {
            double sign = v[j] < 0 ? -1 : 1;
            slow[j] = keep * slow[j] + std::sqrt(1 - keep * keep) * t.coloured_nm * gauss(&seed);
            tau[j] += friction(t, j, v[j]) + t.offset_nm[j] + sign * scatter[j] + slow[j]
                      + t.white_nm * gauss(&seed) + sign * t.line[j].amplitude
                            * std::sin(t.line[j].order * gear * q[j] + t.line[j].phase);
            run.joint[static_cast<std::size_t>(j)].q_rad.push_back(count_rad * std::round(q[j] / count_rad));
            run.joint[static_cast<std::size_t>(j)].tau_nm.push_back(tau[j]);
        }
    }
    for (auto &j : run.joint)
        j.present = true;
    return run;
}

std::vector<Run> make_runs(const Truth &t, uint64_t seed, int count, const RunSpec &spec = {})
{
    std::vector<Run> out;
    for (int k = 0; k < count; k++)
        out.push_back(make_run(t, 1000 * seed + static_cast<uint64_t>(k), spec));
    return out;
}

std::string number(double x)
{
    std::ostringstream s;
    s.precision(17);
    s << x;
    return s.str();
}

std::string quantity(const std::string &key, const std::string &value, const char *unit,
                     const char *side = "")
{
    std::string sigma = "0";
    if (value[0] == '[') {
        for (char c : value)
            sigma += c == ',' ? ", 0" : "";
        sigma = "[" + sigma + "]";
    }
    return key + " = { value = " + value + ", unit = \"" + unit + "\", sigma = " + sigma
           + ", source = \"TEST\"" + (*side ? std::string(", side = \"") + side + "\"" : "") + " }\n";
}

struct FileSpec {
    bool masses = true, friction = true, ripple = true;
    double mass_share = 1;          // file over truth
    double friction_share = 0.7;
    const char *more[2] = {"", ""}; // joint tables' extra lines
};

std::string joint_text(const Truth &t, int j, const FileSpec &spec)
{
    std::string s = "[[joint]]\nname = \"J" + std::to_string(j + 1) + "\"\n";
    s += quantity("origin", j == 0 ? "[0, 0, 0]" : "[" + number(t.l1) + ", 0, 0]", "m");
    s += quantity("rpy", j == 0 ? "[1.5707963267948966, 0, 0]" : "[0, 0, 0]", "rad"); // z horizontal, y up
    s += quantity("limits.position", "[-9, 9]", "rad") + quantity("limits.speed", "3", "rad/s");
    s += quantity("gear.ratio", number(gear), "1");
    if (spec.masses) {
        s += quantity("link.mass", number(t.m[j] * spec.mass_share), "kg");
        s += quantity("link.com", "[" + number(t.c[j]) + ", 0, 0]", "m");
        s += quantity("link.inertia",
                      "[" + number(t.i[j]) + ", 0, 0, " + number(t.i[j]) + ", 0, " + number(t.i[j]) + "]",
                      "kg m^2");
        s += quantity("motor.rotor_inertia", number(t.rotor[j]), "kg m^2", "motor");
    }
    for (int way = 0; way < 2 && spec.friction; way++) {
        const Stribeck &f = t.friction[j][way];
        std::string at = way == 0 ? "friction.positive." : "friction.negative.";
        s += quantity(at + "f0", number(f.f0 * spec.friction_share), "N m", "output");
        s += quantity(at + "fv", number(f.fv * spec.friction_share), "N m s/rad", "output");
        s += quantity(at + "fs", number(f.fs * spec.friction_share), "N m", "output");
        s += quantity(at + "vc", number(f.vc * 1.5), "rad/s", "output");
    }
    s += spec.more[j];
    if (spec.ripple) {
        s += "[[joint.ripple]]\n" + quantity("wave_generator_order", number(t.line[j].order), "1");
        s += quantity("amplitude", "0.5", "N m", "output") + quantity("phase", "0", "rad");
    }
    return s;
}

ArmFile make_arm(const Truth &t, const FileSpec &spec = {})
{
    std::string s =
        "format = \"hdt-arm\"\nversion = 1\nname = \"two-link\"\n[sources]\nTEST = \"made\"\n[base]\n";
    s += quantity("gravity", "[0, 0, -9.81]", "m/s^2") + "[control]\n" + quantity("rate", "700", "Hz");
    s += quantity("velocity_cutoff", "50", "Hz") + "[flange]\n" + quantity("origin", "[0.5, 0, 0]", "m");
    s += quantity("rpy", "[0, 0, 0]", "rad");
    for (int j = 0; j < 2; j++)
        s += joint_text(t, j, spec);
    return ArmFile::parse(s, "two-link.toml");
}

const hdt::FitParameter *find(const IdentResult &r, const std::string &key)
{
    for (const hdt::JointFit &j : r.joints)
        for (const hdt::FitParameter &p : j.parameters)
            if (p.key == key)
                return &p;
    for (const hdt::FitParameter &p : r.chain)
        if (p.key == key)
            return &p;
    return nullptr;
}

// Every true number by its key in the file.
std::map<std::string, double> truth_by_key(const Truth &t)
{
    std::map<std::string, double> out;
    for (int j = 0; j < 2; j++) {
        std::string at = "joint." + std::to_string(j + 1) + ".";
        for (int way = 0; way < 2; way++) {
            std::string f = at + (way == 0 ? "friction.positive." : "friction.negative.");
            out[f + "f0"] = t.friction[j][way].f0;
            out[f + "fv"] = t.friction[j][way].fv;
            out[f + "fs"] = t.friction[j][way].fs;
            out[f + "vc"] = t.friction[j][way].vc;
        }
        out[at + "ripple.1.amplitude"] = t.line[j].amplitude;
        out[at + "ripple.1.phase"] = t.line[j].phase;
    }
    return out;
}

// What noise leaves in a block mean, before scatter: white noise averages over a block's rows.
double floor_nm(const Truth &t, double rate_hz)
{
    double n = std::max(1.0, rate_hz * 0.01);
    return std::sqrt(t.white_nm * t.white_nm / n + t.coloured_nm * t.coloured_nm
                     + t.scatter_nm * t.scatter_nm);
}

bool noted(const IdentResult &r, const char *part)
{
    return std::any_of(r.notes.begin(), r.notes.end(),
                       [&](const std::string &n) { return n.find(part) != std::string::npos; });
}

std::string refusal(const ArmFile &arm, const std::vector<Run> &runs, const hdt::IdentOptions &o)
{
    try {
        hdt::identify(arm, runs, {}, o);
    } catch (const hdt::InputError &e) {
        return e.what();
    }
    return "";
}

bool says(const std::string &text, const char *part) { return text.find(part) != std::string::npos; }

} // namespace

START_TEST(test_parameters_come_back_and_held_out_error_falls_to_the_floor)
{
    Truth t;
    FileSpec spec;
    spec.mass_share = 0.9;
    std::vector<Run> fit = make_runs(t, 1, 8), test = make_runs(t, 2, 3);
    IdentResult r = hdt::identify(make_arm(t, spec), fit, test, {});
    ck_assert_uint_eq(r.joints.size(), 2);
    for (const auto &[key, value] : truth_by_key(t)) {
        const hdt::FitParameter *p = find(r, key);
        ck_assert_msg(p != nullptr, "%s is missing", key.c_str());
        ck_assert_msg(p->excited && std::fabs(p->value - value) < 3.5 * p->sigma, "%s: %g, found %g +- %g",
                      key.c_str(), value, p->value, p->sigma);
        ck_assert_msg(p->sigma < 0.3 * std::fabs(value) + 0.05, "%s: sigma %g", key.c_str(), p->sigma);
    }
    const hdt::FitParameter *scale = find(r, "gravity_scale");
    ck_assert(scale && scale->excited);
    ck_assert_double_lt(std::fabs(scale->value - 1 / 0.9), 3.5 * scale->sigma);
    ck_assert_double_lt(scale->sigma, 0.01);
    for (const hdt::JointFit &j : r.joints) {
        ck_assert_double_lt(j.held_out_after_nm, 1.25 * floor_nm(t, 200));
        ck_assert_double_gt(j.held_out_before_nm, 4 * j.held_out_after_nm);
        ck_assert_double_lt(j.rms_after_nm, 1.2 * floor_nm(t, 200));
        ck_assert_double_lt(std::fabs(j.gravity_scale - 1 / 0.9), 4 * j.gravity_scale_sigma);
        ck_assert_uint_eq(j.t_s.size(), j.residual_after_nm.size());
        ck_assert_uint_eq(j.t_s.size(), j.friction_nm.size());
    }
    // the written model is the fitted model
    const hdt_arm &arm = r.model.arm();
    ck_assert_double_eq_tol(arm.joint[0].mass_kg, 6, 6 * 0.03);
    ck_assert_double_eq_tol(arm.joint[1].friction[1].f0_nm, find(r, "joint.2.friction.negative.f0")->value,
                            1e-12);
    ck_assert(r.model.get("joint.1.friction.positive.f0").source == "IDENT");
}
END_TEST

// sigma is worth what it says: z-scores over many worlds, pooled per kind of number
START_TEST(test_sigma_is_calibrated)
{
    std::map<std::string, std::vector<double>> z;
    RunSpec spec;
    spec.seconds = 12;
    spec.rate_hz = 150;
    for (uint64_t seed = 1; seed <= 40; seed++) {
        Truth t;
        IdentResult r = hdt::identify(make_arm(t), make_runs(t, 100 + seed, 8, spec), {}, {});
        for (const auto &[key, value] : truth_by_key(t)) {
            const hdt::FitParameter *p = find(r, key);
            if (p->excited)
                z[key.substr(key.rfind('.') + 1)].push_back((p->value - value) / p->sigma);
        }
        const hdt::FitParameter *scale = find(r, "gravity_scale");
        z["scale"].push_back((scale->value - 1) / scale->sigma);
    }
    for (const auto &[kind, scores] : z) {
        double sum = 0;
        for (double s : scores)
            sum += s * s;
        double rms = std::sqrt(sum / static_cast<double>(scores.size()));
        printf("z of %s: rms %.2f over %zu\n", kind.c_str(), rms, scores.size());
        ck_assert_msg(rms > 0.7 && rms < 1.4, "%s: rms of z %.2f over %zu", kind.c_str(), rms, scores.size());
        ck_assert_uint_ge(scores.size(), 40);
    }
}
END_TEST

START_TEST(test_geometry_alone_predicts_held_out_torque)
{
    Truth t;
    FileSpec spec;
    spec.masses = spec.friction = false;
    std::vector<Run> fit = make_runs(t, 3, 6), test = make_runs(t, 4, 3);
    IdentResult r = hdt::identify(make_arm(t, spec), fit, test, {});
    IdentResult known = hdt::identify(make_arm(t), fit, test, {});
    for (std::size_t j = 0; j < 2; j++) { // as well as with the masses given
        ck_assert_double_lt(r.joints[j].held_out_after_nm, 1.03 * known.joints[j].held_out_after_nm);
        ck_assert_double_gt(r.joints[j].held_out_before_nm, 5);
        ck_assert_double_lt(r.joints[j].rms_after_nm, 1.2 * floor_nm(t, 200));
    }
    // gravity of the chain: first moments as seen from joints 1 and 2 [kg m]
    const hdt_arm &arm = r.model.arm();
    ck_assert_double_eq(arm.joint[0].mass_kg, 0);
    ck_assert_double_eq_tol(arm.joint[1].moment_kgm[0], t.m[1] * t.c[1], 0.02);
    ck_assert_double_eq_tol(arm.joint[0].moment_kgm[0], t.m[0] * t.c[0] + t.m[1] * t.l1, 0.03);
    ck_assert(r.chain.size() >= 4);
    // the written file loads and says the same torque
    IdentResult again = hdt::identify(ArmFile::parse(r.model.text(), "again.toml"), fit, test, {});
    ck_assert_double_eq_tol(again.joints[0].held_out_before_nm, r.joints[0].held_out_after_nm, 1e-9);
}
END_TEST

START_TEST(test_declared_payload_is_not_taken_for_link_mass)
{
    Truth bare, loaded;
    loaded.payload_kg = 2;
    std::vector<Run> fit = make_runs(bare, 5, 3), more = make_runs(loaded, 6, 3);
    for (Run &run : more) {
        run.constants["payload_kg"] = "2";
        run.constants["payload_com_m"] = "0 0 0"; // the flange is where it hangs
        fit.push_back(run);
    }
    IdentResult r = hdt::identify(make_arm(bare), fit, {}, {});
    const hdt::FitParameter *scale = find(r, "gravity_scale");
    ck_assert_double_lt(std::fabs(scale->value - 1), 3.5 * scale->sigma);
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.2 * floor_nm(bare, 200));
}
END_TEST

START_TEST(test_one_direction_leaves_the_other_as_the_file_has_it)
{
    Truth t;
    RunSpec spec;
    spec.drift = 0.45;
    spec.swing = 0.35;
    spec.seconds = 10;
    IdentResult r = hdt::identify(make_arm(t), make_runs(t, 7, 6, spec), {}, {});
    for (int j = 1; j <= 2; j++) {
        std::string at = "joint." + std::to_string(j) + ".friction.";
        ck_assert(find(r, at + "positive.f0")->excited);
        for (const char *name : {"f0", "fv", "fs", "vc"})
            ck_assert_msg(!find(r, at + "negative." + name)->excited, "%s", name);
        const Stribeck &f = t.friction[j - 1][1];
        ck_assert_double_eq_tol(find(r, at + "negative.f0")->value, 0.7 * f.f0, 1e-12);
        ck_assert_double_eq_tol(r.model.arm().joint[j - 1].friction[1].fv_nmspr, 0.7 * f.fv, 1e-12);
    }
    // a file without friction gets the moved direction for both, and says so
    FileSpec none;
    none.friction = false;
    r = hdt::identify(make_arm(t, none), make_runs(t, 7, 6, spec), {}, {});
    ck_assert_double_eq(r.model.arm().joint[0].friction[1].f0_nm, r.model.arm().joint[0].friction[0].f0_nm);
    ck_assert(!find(r, "joint.1.friction.negative.f0")->excited);
    ck_assert(noted(r, "no motion in negative direction"));
    ck_assert(r.model.get("joint.1.friction.negative.f0").confidence == "low");
}
END_TEST

// Where a joint moves one way only, Coulomb friction and a constant torque are one number.  Whatever its
// sign, the written model says the torque that was fitted, and leaves the other way's friction alone.
START_TEST(test_friction_and_offset_of_one_direction_are_written_as_their_sum)
{
    for (double drift : {0.45, -0.45})
        for (double offset : {-18.0, -4.0, 4.0, 18.0})
            for (bool known : {true, false}) {
                Truth t;
                t.offset_nm[0] = offset;
                t.offset_nm[1] = -offset;
                RunSpec spec;
                spec.drift = drift;
                spec.swing = 0.35;
                spec.seconds = 10;
                FileSpec file;
                file.friction = known;
                const int way = drift < 0, other = 1 - way;
                const double sign = drift < 0 ? -1 : 1;
                IdentResult r = hdt::identify(make_arm(t, file), make_runs(t, 7, 6, spec),
                                              make_runs(t, 8, 2, spec), {});
                for (int j = 0; j < 2; j++) {
                    const hdt_arm_joint &joint = r.model.arm().joint[j];
                    ck_assert_double_lt(r.joints[static_cast<std::size_t>(j)].rms_after_nm,
                                        1.2 * floor_nm(t, 200));
                    ck_assert_double_lt(r.joints[static_cast<std::size_t>(j)].held_out_after_nm,
                                        1.6 * floor_nm(t, 200));
                    for (double v : {0.3, 0.45, 0.6}) { // the torque of the way that moved
                        double truth = friction(t, j, sign * v) + t.offset_nm[j];
                        double model = sign * hdt::stribeck_nm(joint.friction[way], v)
                                       + joint.torque_offset_nm;
                        ck_assert_double_eq_tol(model, truth, 0.5);
                    }
                    for (double v = 0; v < 3; v += 0.1)
                        ck_assert_double_ge(hdt::stribeck_nm(joint.friction[way], v), 0);
                    const Stribeck &f = t.friction[j][other];
                    if (known)
                        ck_assert_double_eq_tol(joint.friction[other].f0_nm, 0.7 * f.f0, 1e-12);
                }
                ck_assert(noted(r, way == 0 ? "no motion in negative direction"
                                            : "no motion in positive direction"));
                ck_assert(noted(r, "one number"));
            }
}
END_TEST

// One run that goes back is enough to tell the two apart.
START_TEST(test_one_run_both_ways_tells_friction_from_offset)
{
    Truth t;
    t.offset_nm[0] = -18;
    RunSpec one_way, both;
    one_way.drift = 0.45;
    one_way.swing = 0.35;
    one_way.seconds = both.seconds = 10;
    std::vector<Run> runs = make_runs(t, 7, 5, one_way);
    runs.push_back(make_run(t, 7700, both));
    IdentResult r = hdt::identify(make_arm(t), runs, {}, {});
    const hdt_arm_joint &joint = r.model.arm().joint[0];
    for (double v : {-0.3, -0.15, 0.15, 0.3}) {
        const double sign = v < 0 ? -1 : 1;
        ck_assert_double_eq_tol(sign * hdt::stribeck_nm(joint.friction[v < 0], std::fabs(v))
                                    + joint.torque_offset_nm,
                                friction(t, 0, v) + t.offset_nm[0], 0.6);
    }
    ck_assert(!noted(r, "one number"));
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.25 * floor_nm(t, 200));
}
END_TEST

// Arms of all kinds, files wrong in all kinds of ways, effects no fitted number stands for: what is written
// does not do worse than what was given, on the runs it was fitted to.
START_TEST(test_no_joint_gets_worse_on_its_own_fit_runs)
{
    int kept = 0;
    for (uint64_t seed = 1; seed <= 60; seed++) {
        uint64_t s = 7919 * seed;
        Truth t;
        FileSpec spec;
        spec.masses = test_uniform(&s, 0, 1) < 0.5;
        spec.friction = test_uniform(&s, 0, 1) < 0.7;
        spec.mass_share = test_uniform(&s, 0.7, 1.3);
        spec.friction_share = test_uniform(&s, 0.2, 1.5);
        ArmFile arm = make_arm(t, spec);
        for (int j = 0; j < 2; j++) { // the arm is not what the file says
            t.m[j] *= test_uniform(&s, 0.7, 1.4);
            t.offset_nm[j] = test_uniform(&s, 0, 1) < 0.4 ? test_uniform(&s, -20, 20) : 0;
            for (Stribeck &f : t.friction[j])
                f = {test_uniform(&s, 0, 12), test_uniform(&s, 0, 7), test_uniform(&s, -3, 4),
                     test_uniform(&s, 0.01, 0.2)};
            for (Stribeck &f : t.friction[j])
                f.f0 = std::max(f.f0, -f.fs);
        }
        t.payload_kg = test_uniform(&s, 0, 1) < 0.3 ? 2 : 0; // not declared
        RunSpec how;
        how.seconds = 8;
        how.drift = test_uniform(&s, 0, 1) < 0.6 ? test_uniform(&s, -0.6, 0.6) : 0;
        how.swing = test_uniform(&s, 0, 1) < 0.5 ? test_uniform(&s, 0.02, 0.3) : 1;
        std::vector<Run> runs = make_runs(t, 300 + seed, 1 + static_cast<int>(seed % 5), how);
        IdentResult r = hdt::identify(arm, runs, {}, {});
        kept += noted(r, "kept as they were");
        for (const hdt::JointFit &j : r.joints)
            ck_assert_msg(j.rms_after_nm < 1.01 * j.rms_before_nm, "world %d joint %d: %g -> %g",
                          static_cast<int>(seed), j.joint, j.rms_before_nm, j.rms_after_nm);
        // the figures are those of the bytes written
        IdentResult again = hdt::identify(ArmFile::parse(r.model.text(), "again.toml"), runs, {}, {});
        for (std::size_t k = 0; k < r.joints.size(); k++)
            ck_assert_double_eq_tol(again.joints[k].rms_before_nm, r.joints[k].rms_after_nm, 1e-9);
    }
    printf("worlds in which a joint kept its numbers: %d of 60\n", kept);
}
END_TEST

// Fit runs of one arm, held-out runs of another: what was given stays, and both figures are said.
START_TEST(test_what_the_held_out_runs_refute_is_not_written)
{
    Truth t, other;
    other.friction[0][0].f0 = 22;
    other.friction[0][1].f0 = 20;
    FileSpec spec;
    spec.friction_share = 1;
    IdentResult r = hdt::identify(make_arm(t, spec), make_runs(other, 5, 4), make_runs(t, 6, 3), {});
    const hdt_arm &arm = r.model.arm();
    ck_assert_double_eq(arm.joint[0].friction[0].f0_nm, t.friction[0][0].f0);
    ck_assert(!find(r, "joint.1.friction.positive.f0")->excited);
    ck_assert(find(r, "joint.2.friction.positive.f0")->excited);
    ck_assert(noted(r, "joint 1: its numbers were kept as they were"));
    ck_assert(noted(r, "on the test runs"));
    ck_assert_double_le(r.joints[0].held_out_after_nm, 1.01 * r.joints[0].held_out_before_nm);
}
END_TEST

// A payload nobody declared, in the fit runs only: no gravity scale describes the arm of the test runs.
START_TEST(test_a_gravity_scale_the_held_out_runs_refute_is_not_written)
{
    Truth t, loaded;
    loaded.payload_kg = 3;
    FileSpec spec;
    spec.friction_share = 1;
    const ArmFile arm = make_arm(t, spec);
    IdentResult r = hdt::identify(arm, make_runs(loaded, 15, 6), make_runs(t, 16, 3), {});
    for (int j = 0; j < 2; j++)
        ck_assert_double_eq(r.model.arm().joint[j].mass_kg, arm.arm().joint[j].mass_kg);
    ck_assert(!find(r, "gravity_scale")->excited);
    ck_assert(noted(r, "the masses were kept for its sake"));
    for (const hdt::JointFit &j : r.joints)
        ck_assert_double_lt(j.held_out_after_nm, 1.01 * j.held_out_before_nm);
}
END_TEST

START_TEST(test_what_the_motion_does_not_excite_is_kept)
{
    Truth t;
    RunSpec spec; // fast only, so no Stribeck; too short a travel for a turn of the wave generator
    spec.seconds = 10;
    std::vector<Run> runs;
    for (uint64_t seed = 1; seed <= 6; seed++) {
        Run run = make_run(t, 900 + seed, spec);
        run.joint[1].present = false;
        runs.push_back(run);
    }
    IdentResult r = hdt::identify(make_arm(t), runs, {}, {});
    ck_assert_uint_eq(r.joints.size(), 1);
    ck_assert(noted(r, "joint 2"));
    ck_assert_double_eq_tol(r.model.arm().joint[1].friction[0].f0_nm, 0.7 * t.friction[1][0].f0, 1e-12);

    RunSpec still = spec;
    still.swing = 0.05; // 0.03 rad: a quarter of a ripple turn of joint 2, speeds under 0.03 rad/s
    r = hdt::identify(make_arm(t), make_runs(t, 10, 6, still), {}, {});
    const hdt::FitParameter *p = find(r, "joint.2.ripple.1.amplitude");
    ck_assert(!p->excited);
    ck_assert_double_eq_tol(p->value, 0.5, 1e-12);
    p = find(r, "joint.1.friction.positive.fv");
    ck_assert(!p->excited);
    ck_assert_double_eq_tol(p->value, 0.7 * t.friction[0][0].fv, 1e-12);
}
END_TEST

// Joint 1 of runs without the second link's angle: its load is not known, and no mass follows from it.
START_TEST(test_a_load_on_unknown_angles_scales_no_mass_and_is_said)
{
    Truth t;
    FileSpec spec;
    spec.mass_share = 0.9;
    std::vector<Run> fit = make_runs(t, 17, 5), part = fit;
    for (std::size_t k = 0; k < 3; k++)
        part[k].joint[1].present = false;
    IdentResult r = hdt::identify(make_arm(t, spec), part, {}, {});
    ck_assert(noted(r, "joint 1: 3 of 5 runs do not have the angle of joint 2"));
    ck_assert(noted(r, "the masses were kept"));
    ck_assert(!find(r, "gravity_scale")->excited);
    ck_assert_double_eq(r.model.arm().joint[0].mass_kg, 0.9 * t.m[0]);
    r = hdt::identify(make_arm(t, spec), fit, {}, {});
    ck_assert(!noted(r, "do not have the angle"));
    ck_assert(find(r, "gravity_scale")->excited);
}
END_TEST

// What an elbow nobody logged does to the shoulder looks like something with a name.
START_TEST(test_a_diagnosis_on_unknown_angles_is_at_most_suspect)
{
    Truth t;
    FileSpec spec;
    spec.friction_share = 1;
    ArmFile arm = make_arm(t, spec);
    std::vector<Run> part = make_runs(t, 18, 8), test = make_runs(t, 19, 3);
    for (auto *set : {&part, &test})
        for (Run &run : *set)
            run.joint[1].present = false;
    const hdt::Diagnosis d = hdt::diagnose(arm, part, test, {});
    ck_assert_uint_eq(d.joints.size(), 1);
    ck_assert_str_eq(d.joints[0].verdict.c_str(), "suspect");
    ck_assert(says(d.joints[0].words, "8 of 8") || says(d.joints[0].words, "11 of 11"));
    ck_assert(says(d.joints[0].words, "do not have the angle of joint 2"));
    ck_assert_double_eq(d.joints[0].rms_after_nm, d.joints[0].rms_before_nm);
    ck_assert(d.model.arm().joint[0].mass_kg == arm.arm().joint[0].mass_kg);
}
END_TEST

START_TEST(test_a_term_that_is_not_there_is_not_invented)
{
    Truth t;
    for (auto &joint : t.friction)
        for (Stribeck &f : joint)
            f.fs = 0;
    t.line[0].amplitude = t.line[1].amplitude = 0;
    FileSpec spec;
    spec.friction = spec.ripple = false;
    int invented = 0;
    for (uint64_t seed = 0; seed < 6; seed++) {
        IdentResult r = hdt::identify(make_arm(t, spec), make_runs(t, 40 + seed, 8), {}, {});
        for (int j = 0; j < 2; j++)
            for (int way = 0; way < 2; way++) {
                const hdt_arm_friction &f = r.model.arm().joint[j].friction[way];
                // a small fitted curve is noise fitted; what must not be is a torque that matters
                invented += std::fabs(f.fs_nm) > 0.5;
                ck_assert_double_eq_tol(f.f0_nm + f.fs_nm, t.friction[j][way].f0, 0.5);
                ck_assert_double_eq_tol(f.fv_nmspr, t.friction[j][way].fv, 0.8);
            }
    }
    ck_assert_int_le(invented, 2); // of 24
    // a ripple the file declares and the data refute
    IdentResult r = hdt::identify(make_arm(t), make_runs(t, 50, 8), {}, {});
    const hdt::FitParameter *p = find(r, "joint.1.ripple.1.amplitude");
    ck_assert(p->excited);
    ck_assert_double_lt(p->value, 0.1);
}
END_TEST

// Where friction bends Stribeck's curve predicts runs left out best; where it does not the straight line
// is enough and the criterion says so.
START_TEST(test_friction_curves_are_told_apart)
{
    for (bool bends : {true, false}) {
        Truth t;
        for (auto &joint : t.friction)
            for (Stribeck &f : joint)
                f.fs = bends ? f.fs : 0;
        IdentResult r = hdt::identify(make_arm(t), make_runs(t, 44, 8), {}, {});
        for (const hdt::JointFit &j : r.joints) {
            ck_assert_uint_eq(j.friction.size(), 3);
            const hdt::FrictionScore &line = j.friction[0], &cubic = j.friction[1], &stribeck = j.friction[2];
            ck_assert(line.curve == "viscous" && cubic.curve == "cubic" && stribeck.curve == "stribeck");
            ck_assert_double_le(stribeck.rms_nm, line.rms_nm);
            if (bends) {
                ck_assert_double_lt(stribeck.left_out_nm, cubic.left_out_nm);
                ck_assert_double_lt(stribeck.left_out_nm, 0.95 * line.left_out_nm);
                ck_assert_double_lt(stribeck.left_out_nm, 1.1 * floor_nm(t, 200));
            } else {
                ck_assert_double_lt(line.bic, cubic.bic);
                ck_assert_double_lt(line.bic, stribeck.bic);
            }
        }
    }
}
END_TEST

// Soft wind-up in the log: extra torque of the load, by direction, with kinks where the file has them.
static const char *const stiffness_text =
    "stiffness.positive.slope = { value = [0.1, 1.0, 0.1], unit = \"N m/N m\", sigma = [0, 0, 0], "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.positive.t1 = { value = 12, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.positive.t2 = { value = 20, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.positive.zero = { value = 0, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.negative.slope = { value = [0.1, 1.0, 0.1], unit = \"N m/N m\", sigma = [0, 0, 0], "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.negative.t1 = { value = 12, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.negative.t2 = { value = 20, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n"
    "stiffness.negative.zero = { value = 0, unit = \"N m\", sigma = 0, "
    "source = \"TEST\", side = \"output\" }\n";

// Outer lines 0.1 as in the file; the middle one ends at `to`.
static void add_windup(const Truth &t, double slope, std::vector<Run> *runs, double to = 20)
{
    for (Run &run : *runs)
        for (std::size_t i = 0; i < run.rows(); i++) {
            double q[2] = {run.joint[0].q_rad[i], run.joint[1].q_rad[i]}, zero[2] = {0, 0}, load[2];
            rigid(t, q, zero, zero, load);
            double x = load[0];
            run.joint[0].tau_nm[i] += x < 12   ? 0.1 * x
                                      : x < to ? 1.2 + slope * (x - 12)
                                               : 1.2 + slope * (to - 12) + 0.1 * (x - to);
        }
}

START_TEST(test_stiffness_lines_are_fitted_where_loads_span_them_and_dropped_where_refuted)
{
    Truth t;
    FileSpec spec;
    spec.friction_share = 1;
    spec.more[0] = stiffness_text;
    std::vector<Run> runs = make_runs(t, 60, 8), with = runs;
    double slope = 1.6; // of the middle line, against 1.0 in the file
    add_windup(t, slope, &with);
    IdentResult r = hdt::identify(make_arm(t, spec), with, {}, {});
    for (const char *way : {"positive", "negative"}) {
        const hdt::FitParameter *p = find(r, std::string("joint.1.stiffness.") + way + ".slope.2");
        ck_assert(p && p->excited);
        ck_assert_double_lt(std::fabs(p->value - slope), 4 * p->sigma);
        ck_assert_double_lt(p->sigma, 0.15);
    }
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.3 * floor_nm(t, 200));
    // the same file on logs without it
    r = hdt::identify(make_arm(t, spec), runs, {}, {});
    ck_assert(!r.model.arm().joint[0].has_stiffness);
    ck_assert(noted(r, "soft wind-up"));
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.2 * floor_nm(t, 200));
    // loads that stay on one line cannot tell
    RunSpec little;
    little.swing = 0.1;
    std::vector<Run> narrow = make_runs(t, 61, 8, little);
    add_windup(t, 1.0, &narrow);
    r = hdt::identify(make_arm(t, spec), narrow, {}, {});
    ck_assert(r.model.arm().joint[0].has_stiffness);
    ck_assert(!find(r, "joint.1.stiffness.positive.slope.2")->excited);
}
END_TEST

// The file's lines are beyond all loads, and the loads end before the real fall does.
START_TEST(test_a_fall_the_loads_enter_but_do_not_leave_is_fitted_and_held_beyond_them)
{
    Truth t;
    FileSpec spec;
    spec.friction_share = 1;
    std::string far = stiffness_text;
    for (const auto &[from, to] :
         {std::pair<std::string, std::string>{"t1 = { value = 12", "t1 = { value = 120"},
          {"t2 = { value = 20", "t2 = { value = 150"}})
        for (std::size_t at = far.find(from); at != std::string::npos; at = far.find(from, at + to.size()))
            far.replace(at, from.size(), to);
    spec.more[0] = far.c_str();
    std::vector<Run> runs = make_runs(t, 63, 8);
    const double slope = 1.6;
    add_windup(t, slope, &runs, 1e9);
    IdentResult r = hdt::identify(make_arm(t, spec), runs, {}, {});
    for (const char *way : {"positive", "negative"}) {
        const std::string at = std::string("joint.1.stiffness.") + way;
        const hdt::FitParameter *t1 = find(r, at + ".t1"), *fall = find(r, at + ".slope.2");
        const hdt::FitParameter *home = find(r, at + ".slope.1");
        ck_assert(t1 && fall && home && fall->excited);
        ck_assert_double_lt(std::fabs(t1->value - 12), 4 * t1->sigma);
        // the line of load 0 is the masses'
        ck_assert_double_lt(std::fabs(fall->value - slope), 4 * fall->sigma);
        ck_assert_double_eq(find(r, at + ".slope.3")->value, home->value);
    }
    ck_assert(noted(r, "the loads end inside the soft wind-up's fall"));
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.2 * floor_nm(t, 200));
}
END_TEST

// Too few blocks for three lines anywhere, and the knots at hand beyond them all: no step is better than
// another, and the search ends where it began.
START_TEST(test_a_search_for_knots_that_no_load_spans_ends)
{
    using namespace hdt::fit;
    const Eigen::Index n = 3 * min_region_blocks - 1;
    JointFitState j;
    for (int way = 0; way < 2; way++) {
        j.rows.share[way] = Eigen::VectorXd::Constant(n, way == 0 ? 1 : 0);
        j.rows.speed[way] = Eigen::VectorXd::Constant(n, 0.1);
    }
    j.rows.load = Eigen::VectorXd::LinSpaced(n, 0.1, 11);
    j.rows.y = j.rows.load.array().square();
    j.rows.ripple = j.rows.shared = Eigen::MatrixXd(n, 0);
    j.model.has_stiffness = j.model.free_stiffness[0] = j.model.free_f0[0] = true;
    j.model.stiffness[0] = j.model.stiffness[1] = {{0, 1, 0}, 12, 20, 0};
    Problem p;
    p.joint = {j};
    ck_assert(!search_knots(&p));
    ck_assert_double_eq(p.joint[0].model.stiffness[0].t1_nm, 12);
    ck_assert_double_eq(p.joint[0].model.stiffness[0].t2_nm, 20);
}
END_TEST

START_TEST(test_stiffness_that_does_harm_is_taken_out_though_loads_stay_on_one_line)
{
    Truth t;
    FileSpec spec;
    std::string far = stiffness_text; // every load lies on the steep middle line
    for (const auto &[from, to] :
         {std::pair<std::string, std::string>{"t1 = { value = 12", "t1 = { value = -90"},
          {"t2 = { value = 20", "t2 = { value = 90"}})
        for (std::size_t at = far.find(from); at != std::string::npos; at = far.find(from))
            far.replace(at, from.size(), to);
    spec.more[0] = far.c_str();
    IdentResult r = hdt::identify(make_arm(t, spec), make_runs(t, 62, 6), {}, {});
    ck_assert(!r.model.arm().joint[0].has_stiffness);
    ck_assert_double_lt(r.joints[0].rms_after_nm, 1.2 * floor_nm(t, 200));
    const hdt::FitParameter *scale = find(r, "gravity_scale");
    ck_assert_double_lt(std::fabs(scale->value - 1), 4 * scale->sigma);
}
END_TEST

START_TEST(test_spikes_do_not_move_the_fit)
{
    Truth t;
    RunSpec spec;
    spec.rate_hz = 500;
    spec.jitter = 0;
    std::vector<Run> clean = make_runs(t, 70, 4, spec), spiky = clean;
    for (Run &run : spiky)
        for (std::size_t i = 50; i + 2 < run.rows(); i += 100)
            for (std::size_t j = 0; j < 2; j++)
                run.joint[j].tau_nm[i] += 20, run.joint[j].tau_nm[i + 1] += 15;
    IdentResult a = hdt::identify(make_arm(t), clean, {}, {}), b = hdt::identify(make_arm(t), spiky, {}, {});
    ck_assert_uint_gt(b.joints[0].masked, a.joints[0].masked + 200);
    for (const auto &[key, value] : truth_by_key(t)) {
        (void)value;
        const hdt::FitParameter *p = find(a, key), *q = find(b, key);
        if (p->excited && q->excited)
            ck_assert_msg(std::fabs(p->value - q->value) < p->sigma, "%s: %g and %g", key.c_str(), p->value,
                          q->value);
    }
    ck_assert_double_lt(b.joints[0].rms_after_nm, 1.05 * a.joints[0].rms_after_nm);
}
END_TEST

START_TEST(test_friction_is_never_negative)
{
    Truth t; // friction so small that noise and a constant torque make it negative one way
    for (auto &joint : t.friction)
        for (Stribeck &f : joint)
            f = {0.3, 0.2, 0, 0.1};
    FileSpec spec;
    spec.friction = false;
    std::vector<Run> runs = make_runs(t, 80, 6);
    for (Run &run : runs)
        for (double &tau : run.joint[1].tau_nm)
            tau += 1.5; // a sensor's zero
    IdentResult r = hdt::identify(make_arm(t, spec), runs, {}, {});
    for (int j = 0; j < 2; j++)
        for (int way = 0; way < 2; way++)
            for (double v = 0; v < 1; v += 0.01) {
                const hdt_arm_friction &f = r.model.arm().joint[j].friction[way];
                ck_assert_double_ge(f.f0_nm + f.fv_nmspr * v + f.fs_nm * (1 - std::exp(-v / f.vc_radps)), 0);
            }
    ck_assert_double_eq_tol(r.model.arm().joint[1].torque_offset_nm, 1.5, 0.3);
    ck_assert_double_lt(r.joints[1].rms_after_nm, 1.2 * floor_nm(t, 200));
}
END_TEST

START_TEST(test_same_input_same_result)
{
    Truth t;
    std::vector<Run> runs = make_runs(t, 90, 5);
    IdentResult a = hdt::identify(make_arm(t), runs, runs, {});
    IdentResult b = hdt::identify(make_arm(t), runs, runs, {});
    ck_assert(a.model.text() == b.model.text());
    for (std::size_t j = 0; j < a.joints.size(); j++)
        ck_assert(a.joints[j].residual_after_nm == b.joints[j].residual_after_nm);
}
END_TEST

START_TEST(test_bad_requests_are_refused_in_one_line)
{
    Truth t;
    RunSpec spec;
    spec.seconds = 4;
    std::vector<Run> runs = make_runs(t, 95, 1, spec);
    hdt::IdentOptions o;
    ck_assert(says(refusal(make_arm(t), {}, o), "at least one run"));
    o.joints = {3};
    ck_assert(says(refusal(make_arm(t), runs, o), "expected 1 to 2, found 3"));
    o.joints = {2};
    runs[0].joint[1].q_rad.assign(runs[0].rows(), 0.5); // standing still
    ck_assert(says(refusal(make_arm(t), runs, o), "joint 2: expected at least 50 blocks in motion, found 0"));
    o.joints = {};
    runs[0].joint[0].q_rad.assign(runs[0].rows(), 0.5);
    ck_assert(says(refusal(make_arm(t), runs, o), "found none"));
    RunSpec brief;
    brief.seconds = 0.1;
    ck_assert(says(refusal(make_arm(t), make_runs(t, 96, 1, brief), o), "at least 50 rows"));
    FileSpec bare;
    bare.masses = false;
    bare.more[0] = stiffness_text;
    ck_assert(says(refusal(make_arm(t, bare), make_runs(t, 95, 1, spec), {}), "expected link masses"));
}
END_TEST

START_TEST(test_written_files_are_complete_and_load)
{
    Truth t;
    IdentResult r = hdt::identify(make_arm(t), make_runs(t, 97, 4), make_runs(t, 98, 1), {});
    std::string out = scratch("new/deeper");
    hdt::write_ident(r, out);
    ArmFile back = ArmFile::load(out + "/model.toml");
    ck_assert_double_eq(back.arm().joint[0].friction[0].f0_nm, r.model.arm().joint[0].friction[0].f0_nm);
    std::ifstream in(out + "/ident.json");
    nlohmann::json j = nlohmann::json::parse(in);
    ck_assert(j["format"] == "hdt-ident" && j["version"] == 1 && j["joints"].size() == 2);
    ck_assert(j["joints"][0]["parameters"].size() == r.joints[0].parameters.size());
    ck_assert(j["joints"][1]["held_out_after_nm"] == r.joints[1].held_out_after_nm);
    std::ifstream html(out + "/report.html");
    std::stringstream text;
    text << html.rdbuf();
    ck_assert(says(text.str(), "</html>"));
    ck_assert(says(text.str(), "not excited")
              == std::any_of(r.joints.begin(), r.joints.end(), [](const hdt::JointFit &f) {
                     return std::any_of(f.parameters.begin(), f.parameters.end(),
                                        [](const hdt::FitParameter &p) { return !p.excited; });
                 }));
    std::size_t files = 0;
    for (const auto &entry : std::filesystem::directory_iterator(out))
        files += entry.is_regular_file();
    ck_assert_uint_eq(files, 3); // nothing temporary left
    std::string err;
    try {
        hdt::write_ident(r, "/dev/null/x");
    } catch (const hdt::InputError &e) {
        err = e.what();
    }
    ck_assert(says(err, "/dev/null/x: expected a directory"));
}
END_TEST

static Suite *ident_suite(void)
{
    Suite *s = suite_create("ident");
    TCase *truth = tcase_create("truth");
    tcase_set_timeout(truth, 120);
    tcase_add_test(truth, test_parameters_come_back_and_held_out_error_falls_to_the_floor);
    tcase_add_test(truth, test_sigma_is_calibrated);
    tcase_add_test(truth, test_geometry_alone_predicts_held_out_torque);
    tcase_add_test(truth, test_declared_payload_is_not_taken_for_link_mass);
    suite_add_tcase(s, truth);
    TCase *honest = tcase_create("honesty");
    tcase_set_timeout(honest, 120);
    tcase_add_test(honest, test_one_direction_leaves_the_other_as_the_file_has_it);
    tcase_add_test(honest, test_friction_and_offset_of_one_direction_are_written_as_their_sum);
    tcase_add_test(honest, test_one_run_both_ways_tells_friction_from_offset);
    tcase_add_test(honest, test_what_the_held_out_runs_refute_is_not_written);
    tcase_add_test(honest, test_a_gravity_scale_the_held_out_runs_refute_is_not_written);
    tcase_add_test(honest, test_no_joint_gets_worse_on_its_own_fit_runs);
    tcase_add_test(honest, test_what_the_motion_does_not_excite_is_kept);
    tcase_add_test(honest, test_a_load_on_unknown_angles_scales_no_mass_and_is_said);
    tcase_add_test(honest, test_a_diagnosis_on_unknown_angles_is_at_most_suspect);
    tcase_add_test(honest, test_a_term_that_is_not_there_is_not_invented);
    tcase_add_test(honest, test_friction_curves_are_told_apart);
    tcase_add_test(honest, test_stiffness_lines_are_fitted_where_loads_span_them_and_dropped_where_refuted);
    tcase_add_test(honest, test_a_fall_the_loads_enter_but_do_not_leave_is_fitted_and_held_beyond_them);
    tcase_add_test(honest, test_stiffness_that_does_harm_is_taken_out_though_loads_stay_on_one_line);
    tcase_add_test(honest, test_friction_is_never_negative);
    suite_add_tcase(s, honest);
    TCase *search = tcase_create("search");
    tcase_set_timeout(search, 10);
    tcase_add_test(search, test_a_search_for_knots_that_no_load_spans_ends);
    suite_add_tcase(s, search);
    TCase *use = tcase_create("use");
    tcase_set_timeout(use, 120);
    tcase_add_test(use, test_spikes_do_not_move_the_fit);
    tcase_add_test(use, test_same_input_same_result);
    tcase_add_test(use, test_bad_requests_are_refused_in_one_line);
    tcase_add_test(use, test_written_files_are_complete_and_load);
    suite_add_tcase(s, use);
    return s;
}
HDT_CHECK_MAIN(ident_suite())
