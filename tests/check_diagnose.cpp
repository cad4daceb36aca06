// SPDX-License-Identifier: Apache-2.0
//
// Diagnosis: nothing hidden gives nothing; each effect hidden in a two-joint arm of textbook formulas
// (planar_arm.hpp, no code shared) is named, sized and helps on runs it was not fitted on.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include <nlohmann/json.hpp>

#include "model/diagnose.hpp"
#include "tests/planar_arm.hpp"
#include "tests/scratch.hpp"

#include "tests/check_main.h"

using namespace hdt;
using planar::Hidden;
using planar::Noise;

namespace {

const ArmFile &arm()
{
    static const ArmFile file = ArmFile::parse(planar::arm_text(), "planar.toml");
    return file;
}

const ArmFile &upright_arm()
{
    static const ArmFile file = ArmFile::parse(planar::arm_text(true), "upright.toml");
    return file;
}

Diagnosis run_diagnosis(const Hidden &hidden, const Noise &noise, unsigned long seed, int fit_runs = 6,
                        double seconds = 30)
{
    std::vector<Run> fit, test;
    for (int i = 0; i < fit_runs + 2; ++i)
        (i < fit_runs ? fit : test).push_back(
            planar::make_run(hidden, noise, 1000 * seed + static_cast<unsigned long>(i), seconds));
    return diagnose(arm(), fit, test, {});
}

bool has(const std::vector<std::string> &list, const std::string &what)
{
    return std::find(list.begin(), list.end(), what) != list.end();
}

const EffectParameter *parameter(const JointDiagnosis &j, const std::string &id, const std::string &name)
{
    for (const Effect &e : j.effects)
        for (const EffectParameter &p : e.parameters)
            if (e.id == id && p.name == name)
                return &p;
    return nullptr;
}

struct Truth {
    const char *id;
    Hidden hidden;
    const char *parameter;
    double value;
    int size_tolerance_sigma;
};

std::vector<Truth> truths()
{
    std::vector<Truth> t;
    Hidden h;
    h.payload_kg = 0.5;
    t.push_back({"payload", h, "mass_kg", 0.5, 3});
    h = {};
    h.load_mu = 0.06;
    t.push_back({"load_friction", h, "mu", 0.06, 3});
    h = {};
    h.cold = 0.08;
    t.push_back({"temperature", h, "time_constant_s", 25, 3});
    h = {};
    h.line_nm = 0.9;
    h.line_directed = true;
    t.push_back({"order_line", h, "amplitude_nm", 0.9, 3});
    h = {};
    h.inertia_kgm2 = 4;
    t.push_back({"inertia", h, "inertia_kgm2", 4, 4});
    h = {};
    h.presliding_nm = 8;
    t.push_back({"presliding", h, "torque_nm", 8, 4});
    h = {};
    h.gain = 0.05;
    t.push_back({"torque_gain", h, "gain", 1.05, 3});
    h = {};
    h.spring = 1.1;
    t.push_back({"cable_spring", h, "stiffness_nmprad", 1.1, 3});
    return t;
}

// The effects of the contract the eight above leave, each in a case made for it.
struct Case { const char *id; Hidden hidden; double delay_s; const char *parameter; double value; };

std::vector<Case> cases()
{
    std::vector<Case> c;
    const auto add = [&](const char *id, double Hidden::*size, double value, const char *parameter = "",
                         double expected = 0) {
        Hidden h;
        h.*size = value;
        c.push_back({id, h, 0, parameter, expected});
    };
    add("link_mass", &Hidden::moment_kgm, 0.25, "share", 0.25 / (planar::kM[0] * planar::kC[0]));
    add("base_tilt", &Hidden::tilt_rad, 0.03, "about_y_rad", 0.03);
    add("joint_offset", &Hidden::angle_rad, 0.03, "angle_rad", 0.03);
    add("torque_offset", &Hidden::constant_nm, 1.5, "torque_nm", 1.5);
    add("drive_efficiency", &Hidden::drive_mu, 0.08, "c1", 0.08);
    add("viscous_nonlinear", &Hidden::square, 80);
    add("stribeck_shape", &Hidden::slow_nm, 6, "scale", 0.03);
    add("local_friction", &Hidden::dry_spot_nm, 4, "at_rad", 0.3);
    add("ripple_load", &Hidden::ripple_per_nm, 0.03);
    add("ripple_speed", &Hidden::ripple_per_radps, 15);
    add("coupling", &Hidden::other_kgm2, 5, "inertia_kgm2", 5);
    add("eccentricity", &Hidden::ahead_rad, 0.05);
    add("external_vibration", &Hidden::hum_nm, 0.8, "amplitude_nm", 0.8);
    add("soft_windup", &Hidden::step_nm, 5, "load_nm", -20);
    add("torque_saturation", &Hidden::missing, 0.15, "missing", 0.15);
    c.back().hidden.knee_nm = 70;
    c.push_back({"torque_delay", {}, 0.03, "delay_s", 0.03});
    return c;
}

// Of y = slope * x + any constant.
double slope(const std::vector<double> &x, const std::vector<double> &y)
{
    const double n = static_cast<double>(x.size());
    double sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
        sx += x[k];
        sy += y[k];
        sxx += x[k] * x[k];
        sxy += x[k] * y[k];
    }
    return (sxy - sx * sy / n) / (sxx - sx * sx / n);
}

} // namespace

// Twelve seeds for each kind of noise, two joints each: at most alpha of them may be named.
START_TEST(test_nothing_hidden_is_nothing_named)
{
    Noise kinds[5];
    kinds[1].coloured = 0.6;
    kinds[1].phi = 0.98;
    kinds[2].run_coulomb = 0.8;
    kinds[2].run_viscous = 0.03;
    kinds[3].wander = 0.4;
    kinds[4].fat = 0.05;
    kinds[4].windup_nmprad = 30000;
    int named = 0, events = 0, refitted = 0;
    for (unsigned long seed = 1; seed <= 12; ++seed) {
        const Diagnosis d = run_diagnosis({}, kinds[_i], 50 * static_cast<unsigned long>(_i) + seed, 5, 20);
        ck_assert_uint_eq(d.joints.size(), 2);
        for (const JointDiagnosis &j : d.joints) {
            if (j.verdict != "nothing")
                printf("noise %d seed %lu joint %d: %s\n", _i, seed, j.joint, j.words.c_str());
            named += j.verdict == "named" || j.verdict == "unnamed";
            if (j.verdict == "nothing") {
                ck_assert_uint_gt(j.detection_limit_nm.size(), 8);
                ck_assert_double_le(j.rms_after_nm, j.rms_before_nm);
                ck_assert_int_eq(j.friction_refitted, j.rms_after_nm < j.rms_before_nm);
                ck_assert(j.effects.empty());
                refitted += j.friction_refitted;
            }
            for (const RunEvent &e : j.events)
                printf("noise %d seed %lu joint %d: event %s %g..%g s %s %g N.m, %g nats\n", _i, seed,
                       j.joint, e.run.c_str(), e.from_s, e.to_s, e.kind.c_str(), e.torque_nm,
                       e.log_likelihood);
            events += static_cast<int>(j.events.size());
        }
    }
    // expected 0.05 * 24 = 1.2
    ck_assert_int_le(named, 2);
    ck_assert_int_le(events, 1);
    // over 72 seeds of each noise one joint of 720 had its friction refitted, so 0.7 % at most (95 %): two of
    // these 24 would come once in ninety
    printf("noise %d: friction refitted in %d of 24 joints\n", _i, refitted);
    ck_assert_int_le(refitted, 1);
}
END_TEST

// Friction that is larger all over has no name, but goes into the
// model, and fresh runs are the better for it.
START_TEST(test_changed_friction_is_taken_over)
{
    Hidden grown;
    grown.cold = 0.06; // of 40 N.m, and as cold at the end as at the beginning
    grown.warm_s = 1e9;
    const Diagnosis d = run_diagnosis(grown, {}, 640);
    const JointDiagnosis &j = d.joints[0];
    ck_assert_msg(j.verdict == "nothing", "%s", j.words.c_str());
    ck_assert_msg(j.friction_refitted && j.rms_after_nm < 0.6 * j.rms_before_nm, "%s", j.words.c_str());
    ck_assert(j.words.find("friction has changed") != std::string::npos);
    std::vector<Run> fit, test;
    for (unsigned long i = 0; i < 6; ++i)
        (i < 4 ? fit : test).push_back(planar::make_run(grown, {}, 64100 + i, 20));
    const JointDiagnosis again = diagnose(d.model, fit, test, {}).joints[0];
    ck_assert_msg(again.rms_before_nm < 0.7 * j.rms_before_nm && !again.friction_refitted, "%s",
                  again.words.c_str());
    for (int way = 0; way < 2; ++way)
        ck_assert_double_lt(std::abs(d.model.arm().joint[0].friction[way].f0_nm - 1.06 * planar::kF0[0][way]),
                            1);
}
END_TEST

// What concerns the whole arm goes into the file once, by its numbers, and leaves nothing on fresh runs.
START_TEST(test_chain_effects_are_adopted_for_the_whole_arm)
{
    Hidden tilted, heavy;
    tilted.tilt_rad = 0.03;
    heavy.moment_kgm = 0.25;
    for (const Hidden &h : {tilted, heavy}) {
        const bool tilt = h.tilt_rad != 0;
        std::vector<Run> fit, test;
        for (unsigned long i = 0; i < 8; ++i)
            (i < 6 ? fit : test).push_back(planar::make_run(h, {}, 53000 + i, 30));
        const Diagnosis d = diagnose(tilt ? upright_arm() : arm(), fit, test, {});
        for (const JointDiagnosis &j : d.joints)
            ck_assert_msg((!tilt && j.joint == 2) ||
                              (j.effects.at(0).id == (tilt ? "base_tilt" : "link_mass") &&
                               j.effects[0].adopted),
                          "joint %d: %s", j.joint, j.words.c_str());
        const hdt_arm found = d.model.arm();
        if (tilt) {
            ck_assert_double_eq_tol(std::hypot(found.gravity_mps2[0], found.gravity_mps2[2]), planar::kG,
                                    1e-3);
            ck_assert_double_eq_tol(std::atan2(found.gravity_mps2[0], -found.gravity_mps2[2]), -0.03, 0.004);
        } else {
            const double more = 0.25 / planar::kC[0];
            ck_assert_double_eq_tol(found.joint[0].mass_kg, planar::kM[0] + more, 0.15 * more);
            ck_assert_double_eq(found.joint[1].mass_kg, planar::kM[1]);
        }
        for (auto *runs : {&fit, &test})
            for (std::size_t i = 0; i < runs->size(); ++i)
                (*runs)[i] = planar::make_run(h, {}, (runs == &fit ? 54000 : 54100) + i, 20);
        for (const JointDiagnosis &j : diagnose(d.model, fit, test, {}).joints)
            ck_assert_msg(j.verdict == "nothing" || j.effects[0].rms_nm < 0.25, "joint %d: %s", j.joint,
                          j.words.c_str());
    }
}
END_TEST

// Each effect at about the size of the noise: right name first or in the printed set, no wrong name,
// size within sigma, held-out error near the floor.
START_TEST(test_effect_hidden_is_effect_named)
{
    const Truth t = truths()[static_cast<std::size_t>(_i)];
    const int seeds = 5;
    int in_set = 0, first = 0, wrong = 0;
    double before = 0, after = 0;
    std::vector<double> off;
    for (unsigned long seed = 1; seed <= seeds; ++seed) {
        Hidden h = t.hidden;
        h.line_phase = 1.3 * static_cast<double>(seed);
        const Diagnosis d = run_diagnosis(h, {}, 500 + 10 * static_cast<unsigned long>(_i) + seed);
        const JointDiagnosis &j = d.joints[0];
        const bool is_first = !j.effects.empty() && j.effects[0].id == t.id && j.verdict == "named";
        first += is_first;
        in_set += is_first || has(j.ambiguous_with, t.id);
        wrong += j.verdict == "named" && !is_first && !has(j.ambiguous_with, t.id);
        if (!is_first)
            printf("%s seed %lu: %s %s\n", t.id, seed, j.verdict.c_str(), j.words.c_str());
        if (!is_first)
            continue;
        // friction fitted again beside the effect: a held-out run's own scatter of 0.4 N.m may hide a little
        ck_assert_double_lt(j.rms_after_nm, 1.15 * j.rms_before_nm);
        before += j.rms_before_nm * j.rms_before_nm;
        after += j.rms_after_nm * j.rms_after_nm;
        ck_assert(j.effects[0].adopted);
        if (const EffectParameter *p = parameter(j, t.id, t.parameter))
            off.push_back(std::abs(p->value - t.value) / p->sigma);
        if (std::string(t.id) != "payload")
            ck_assert_str_eq(d.joints[1].verdict.c_str(), "nothing");
    }
    ck_assert_int_eq(wrong, 0);
    ck_assert_int_ge(in_set, seeds);
    ck_assert_int_ge(first, seeds - 1);
    ck_assert_double_lt(std::sqrt(after / before), 0.9);
    std::sort(off.begin(), off.end());
    ck_assert_msg(off[off.size() / 2] < t.size_tolerance_sigma, "%s: %g sigma off", t.id,
                  off[off.size() / 2]);
}
END_TEST

START_TEST(test_adopted_model_leaves_nothing_on_fresh_runs)
{
    for (const Truth &t : truths()) {
        const Diagnosis d = run_diagnosis(t.hidden, {}, 900);
        std::vector<Run> fit, test;
        for (unsigned long i = 0; i < 7; ++i)
            (i < 5 ? fit : test).push_back(planar::make_run(t.hidden, {}, 77000 + i, 20));
        const Diagnosis again = diagnose(d.model, fit, test, {});
        for (const JointDiagnosis &j : again.joints)
            ck_assert_msg(j.verdict == "nothing" || j.effects[0].rms_nm < 0.25, "%s: joint %d: %s", t.id,
                          j.joint, j.words.c_str());
        // a spring's rest must not stay behind as unequal friction
        const hdt_arm_friction *f = d.model.arm().joint[0].friction;
        if (std::string(t.id) == "cable_spring")
            ck_assert_double_lt(std::abs(f[0].f0_nm - f[1].f0_nm - (planar::kF0[0][0] - planar::kF0[0][1])),
                                0.5);
        // friction went into the file with the effect: fitting it again gains no more than runs scatter
        const JointDiagnosis &j = again.joints[0];
        ck_assert_msg(j.rms_before_nm * j.rms_before_nm < j.rms_refit_nm * j.rms_refit_nm + 0.45,
                      "%s: %g, with friction fitted again %g", t.id, j.rms_before_nm, j.rms_refit_nm);
    }
}
END_TEST

START_TEST(test_what_held_out_runs_deny_is_not_adopted)
{
    Hidden h;
    h.inertia_kgm2 = 5;
    std::vector<Run> fit = planar::make_runs(h, {}, 41, 6), test = planar::make_runs({}, {}, 42, 2);
    const Diagnosis d = diagnose(arm(), fit, test, {});
    ck_assert_str_eq(d.joints[0].verdict.c_str(), "suspect");
    ck_assert(!d.joints[0].effects.empty() && !d.joints[0].effects[0].adopted);
    ck_assert(!d.model.has("joint.1.effect"));
    ck_assert_double_eq(d.joints[0].rms_after_nm, d.joints[0].rms_before_nm);
}
END_TEST

// What came up after the fit runs has no name, but is not passed over either.
START_TEST(test_what_only_held_out_runs_show_is_said)
{
    Hidden h;
    h.spring = 6;
    std::vector<Run> fit = planar::make_runs({}, {}, 61, 6), test = planar::make_runs(h, {}, 62, 2);
    const Diagnosis d = diagnose(arm(), fit, test, {});
    const JointDiagnosis &j = d.joints[0];
    ck_assert_str_eq(j.verdict.c_str(), "nothing");
    ck_assert_msg(j.unexplained() && j.words.find("Something is missing") == 0, "%s", j.words.c_str());
    const Diagnosis sound = diagnose(arm(), fit, planar::make_runs({}, {}, 63, 2), {});
    ck_assert_msg(!sound.joints[0].unexplained(), "%s", sound.joints[0].words.c_str());
}
END_TEST

// A snag in two runs of seven is not a property of the joint.
START_TEST(test_what_few_runs_show_is_not_named)
{
    Hidden h;
    h.spring = 2;
    std::vector<Run> fit = planar::make_runs({}, {}, 51, 5), test = planar::make_runs({}, {}, 52, 2);
    for (unsigned long k = 0; k < 2; ++k)
        fit.push_back(planar::make_run(h, {}, 53000 + k));
    const Diagnosis d = diagnose(arm(), fit, test, {});
    ck_assert_msg(d.joints[0].verdict != "named" && d.joints[0].verdict != "unnamed", "%s",
                  d.joints[0].words.c_str());
    ck_assert(!d.model.has("joint.1.effect"));
}
END_TEST

START_TEST(test_every_effect_of_the_contract_can_be_named)
{
    const Case c = cases()[static_cast<std::size_t>(_i)];
    Noise noise;
    noise.delay_s = c.delay_s;
    std::vector<Run> fit, test;
    // the fastest moves show the square of speed, and few of six runs have them
    const unsigned long runs = c.hidden.square != 0 ? 12 : 6;
    for (unsigned long i = 0; i < runs + 2; ++i)
        (i < runs ? fit : test).push_back(
            planar::make_run(c.hidden, noise, 31000 + 100 * static_cast<unsigned long>(_i) + i, 30));
    const Diagnosis d = diagnose(c.hidden.tilt_rad != 0 ? upright_arm() : arm(), fit, test, {});
    const JointDiagnosis &j = d.joints[0];
    ck_assert_msg(j.verdict == "named", "%s: %s %s", c.id, j.verdict.c_str(), j.words.c_str());
    ck_assert_msg(j.effects[0].id == c.id, "%s: %s", c.id, j.words.c_str());
    ck_assert(!has(j.ambiguous_with, c.id));
    if (*c.parameter) {
        const EffectParameter *p = parameter(j, c.id, c.parameter);
        ck_assert_ptr_nonnull(p);
        ck_assert_double_gt(p->sigma, 0);
        ck_assert_msg(std::abs(p->value - c.value) < 4 * p->sigma + 0.1 * std::abs(c.value), "%s: %s", c.id,
                      j.words.c_str());
    }
    // only what a model can hold is in the model
    const std::vector<std::string> holds = {"torque_offset",  "base_tilt",         "link_mass",
                                            "local_friction", "viscous_nonlinear", "stribeck_shape"};
    ck_assert_int_eq(j.effects[0].adopted, has(holds, c.id));
    if (!j.effects[0].adopted)
        return;
    // the file's own words for it do what was fitted
    for (auto *list : {&fit, &test})
        for (std::size_t i = 0; i < list->size(); ++i)
            (*list)[i] = planar::make_run(c.hidden, noise, (list == &fit ? 32000u : 32100u) + i, 20);
    const JointDiagnosis again = diagnose(d.model, fit, test, {}).joints[0];
    ck_assert_msg(again.rms_before_nm < std::max(0.8 * j.rms_before_nm, 1.1 * again.rms_refit_nm),
                  "%s: %g as adopted, %g before, %g with friction fitted again", c.id, again.rms_before_nm,
                  j.rms_before_nm, again.rms_refit_nm);
}
END_TEST

// One run of six is different for a while: found there, sized, and no part of the model.
START_TEST(test_event_is_found_where_it_was)
{
    struct Kind { double Hidden::*size; double value, from_s, to_s; const char *kind; };
    const Kind kinds[] = {{&Hidden::push_nm, 6, 10, 13, "torque"},
                          {&Hidden::drag_nm, 5, 8, 18, "friction"},
                          {&Hidden::slip_rad, 0.1, 15, 1e9, "angle"},
                          {&Hidden::drag_nm, 8, 0, 1e9, "friction"}};
    const Kind &k = kinds[_i];
    Hidden h;
    h.*k.size = k.value;
    h.from_s = k.from_s;
    h.to_s = k.to_s;
    std::vector<Run> fit, test;
    for (unsigned long i = 0; i < 8; ++i)
        (i < 6 ? fit : test).push_back(
            planar::make_run(i == 2 ? h : Hidden{}, {}, 41000 + 10 * static_cast<unsigned long>(_i) + i, 30));
    const Diagnosis d = diagnose(arm(), fit, test, {});
    const JointDiagnosis &j = d.joints[0];
    ck_assert_msg(j.events.size() == 1, "%d events: %s", static_cast<int>(j.events.size()), j.words.c_str());
    const RunEvent &e = j.events[0];
    ck_assert_str_eq(e.run.c_str(), fit[2].path.c_str());
    ck_assert_str_eq(e.kind.c_str(), k.kind);
    // a slip does not show where gravity hardly changes with the angle
    const double near_s = std::string(k.kind) == "angle" ? 2 : 1.2;
    ck_assert_msg(std::abs(e.from_s - k.from_s) < near_s &&
                      std::abs(e.to_s - std::min(k.to_s, 30.0)) < near_s,
                  "%s", j.words.c_str());
    // a joint that is ahead of its resolver: the resolver is behind
    ck_assert_msg(std::abs((std::string(k.kind) == "angle" ? -e.angle_rad : e.torque_nm) / k.value - 1) < 0.3,
                  "%s", j.words.c_str());
    ck_assert_str_eq(j.verdict.c_str(), "nothing");
    ck_assert(!d.model.has("joint.1.effect"));
    ck_assert(j.words.find(e.run) != std::string::npos);
}
END_TEST

// An effect beside an event is still named, and its numbers are those of the other runs.
START_TEST(test_event_does_not_hide_an_effect)
{
    Hidden h, both;
    h.spring = both.spring = 2;
    both.push_nm = 10;
    both.from_s = 12;
    both.to_s = 20;
    std::vector<Run> fit, test;
    for (unsigned long i = 0; i < 8; ++i)
        (i < 6 ? fit : test).push_back(planar::make_run(i == 4 ? both : h, {}, 42000 + i, 30));
    const JointDiagnosis j = diagnose(arm(), fit, test, {}).joints[0];
    ck_assert_str_eq(j.effects.at(0).id.c_str(), "cable_spring");
    ck_assert_uint_eq(j.events.size(), 1);
    const EffectParameter *k = parameter(j, "cable_spring", "stiffness_nmprad"),
                          *rest = parameter(j, "cable_spring", "rest_rad");
    ck_assert_double_lt(std::abs(k->value - 2), 3.5 * k->sigma);
    // a rest is known no better than Coulomb friction of both directions
    ck_assert_double_gt(rest->sigma, 0.01);
    ck_assert_double_lt(std::abs(rest->value - 0.4), 4 * rest->sigma);
}
END_TEST

// Two names for one torque in this arm's plane: the task proposed, run, shows them apart.
START_TEST(test_next_run_is_a_task_with_a_prediction)
{
    Hidden h;
    h.spring = 2;
    h.gain = 0.05;
    const Diagnosis d = run_diagnosis(h, {}, 61);
    const JointDiagnosis &j = d.joints[0];
    for (const std::string &a : j.ambiguous_with)
        for (const Effect &e : j.effects)
            ck_assert_msg(a != e.id, "%s is named and doubted: %s", a.c_str(), j.words.c_str());
    ck_assert_msg(j.next_experiment.find("hdt host --model ") != std::string::npos ||
                      j.next_experiment.rfind("no task", 0) == 0,
                  "%s", j.next_experiment.c_str());
    if (!j.ambiguous_with.empty())
        ck_assert_msg(j.next_experiment.find("of the noise floor apart") != std::string::npos, "%s",
                      j.next_experiment.c_str());
}
END_TEST

START_TEST(test_what_no_name_explains_is_localised)
{
    Hidden h;
    h.pose_friction_nm = 4;
    for (unsigned long seed = 1; seed <= 3; ++seed) {
        const Diagnosis d = run_diagnosis(h, {}, 700 + seed);
        const JointDiagnosis &j = d.joints[0];
        ck_assert_str_eq(j.verdict.c_str(), "unnamed");
        const Effect &e = j.effects.back();
        ck_assert_str_eq(e.axis.c_str(), "q2,direction");
        ck_assert_uint_eq(e.table_x.size(), e.table_nm.size());
        // the bump is where it was hidden
        const auto top = std::max_element(e.table_nm.begin(), e.table_nm.end()) - e.table_nm.begin();
        ck_assert_double_lt(std::abs(e.table_x[static_cast<std::size_t>(top)] - 0.3), 0.45);
        ck_assert_double_lt(j.rms_explained_nm, 0.85 * j.rms_before_nm);
        ck_assert(!e.adopted && !e.refused.empty());
    }
}
END_TEST

// A curve found beside a torque gain of 1.25 is told, and goes into the file, as the torque it is: 1.25
// times what the reported torque shows of it.
START_TEST(test_curve_beside_a_gain_has_its_own_size)
{
    Hidden h;
    h.gain = 0.25;
    h.own_friction_nm = 4;
    for (unsigned long seed = 85; seed <= 87; ++seed) {
        const Diagnosis d = run_diagnosis(h, {}, seed, 8);
        const JointDiagnosis &j = d.joints[0];
        ck_assert_msg(j.verdict == "unnamed" && j.effects[0].id == "torque_gain", "%s", j.words.c_str());
        const Effect &curve = j.effects.back();
        ck_assert_msg(curve.axis == "q1,direction" && curve.adopted, "%s", j.words.c_str());
        const auto hidden_nm = [&](double q_rad) { return h.own_friction_nm * q_rad * q_rad * q_rad; };
        std::vector<double> at_knots, at_points;
        for (double q_rad : curve.table_x)
            at_knots.push_back(hidden_nm(q_rad));
        const std::vector<double> span = d.model.get("joint.1.table.over_position").value;
        const std::vector<double> written_nm = d.model.get("joint.1.table.torque").value;
        const double step = (span[1] - span[0]) / static_cast<double>(written_nm.size() - 1);
        for (std::size_t k = 0; k < written_nm.size(); ++k)
            at_points.push_back(hidden_nm(span[0] + step * static_cast<double>(k)));
        // eight straight pieces on a cube: 0.99 to 1.07 over twelve seeds; a constant is Coulomb friction's
        ck_assert_double_eq_tol(slope(at_knots, curve.table_nm), 1, 0.1);
        ck_assert_double_eq_tol(slope(at_points, written_nm), 1, 0.1);
    }
}
END_TEST

START_TEST(test_too_few_runs_refuse_to_name)
{
    Hidden h;
    h.line_nm = 0.25;
    const Diagnosis d = run_diagnosis(h, {}, 31, 3, 40);
    ck_assert_str_ne(d.joints[0].verdict.c_str(), "named");
    ck_assert(d.joints[0].words.find("independent run") != std::string::npos);
    ck_assert(!d.model.has("joint.1.effect"));
}
END_TEST

// However large: three runs do not show what runs scatter.  Asked for, it is taken from them all the same.
START_TEST(test_few_runs_name_only_when_asked_to)
{
    Hidden h;
    h.load_mu = 0.2;
    std::vector<Run> fit, test;
    for (unsigned long i = 0; i < 5; ++i)
        (i < 3 ? fit : test).push_back(planar::make_run(h, {}, 32000 + i, 40));
    DiagnoseOptions options;
    for (const bool asked : {false, true}) {
        options.few_runs = asked;
        const Diagnosis d = diagnose(arm(), fit, test, options);
        ck_assert_str_eq(d.joints[0].verdict.c_str(), asked ? "named" : "suspect");
        ck_assert(d.joints[0].effects[0].id == "load_friction");
        ck_assert_int_eq(d.model.has("joint.1.effect"), asked);
        ck_assert(d.joints[0].words.find("3 independent run") != std::string::npos);
    }
}
END_TEST

START_TEST(test_pieces_of_one_recording_are_one_run)
{
    Hidden h;
    h.line_nm = 0.25;
    const Run whole = planar::make_run(h, {}, 5, 120);
    std::vector<Run> fit, test = {cut_run(whole, 100, 120)};
    for (int k = 0; k < 5; ++k)
        fit.push_back(cut_run(whole, 20.0 * k, 20.0 * (k + 1)));
    test[0].path = "last.csv";
    const Diagnosis d = diagnose(arm(), fit, test, {});
    ck_assert(d.joints[0].words.find("Only 1 independent run") != std::string::npos);
    ck_assert_str_ne(d.joints[0].verdict.c_str(), "named");
}
END_TEST

START_TEST(test_same_logs_same_answer)
{
    Hidden h;
    h.payload_kg = 0.4;
    const Diagnosis a = run_diagnosis(h, {}, 3), b = run_diagnosis(h, {}, 3);
    ck_assert(a.model.text() == b.model.text());
    for (std::size_t j = 0; j < a.joints.size(); ++j) {
        ck_assert(a.joints[j].words == b.joints[j].words);
        ck_assert(a.joints[j].rms_after_nm == b.joints[j].rms_after_nm);
    }
}
END_TEST

START_TEST(test_files_keep_the_contract)
{
    const std::string dir = scratch_dir();
    Hidden h;
    h.payload_kg = 0.6;
    const Diagnosis d = run_diagnosis(h, {}, 8);
    write_diagnosis(d, dir);
    const auto j = nlohmann::json::parse(slurp(dir + "/diagnosis.json"));
    ck_assert(j.at("format") == "hdt-diagnosis");
    ck_assert(j.at("version") == 1);
    for (const auto &one : j.at("joints")) {
        ck_assert(one.at("joint").is_number_integer());
        const std::string verdict = one.at("verdict");
        ck_assert(verdict == "named" || verdict == "unnamed" || verdict == "suspect" || verdict == "nothing");
        for (const char *key : {"noise_floor_nm", "rms_before_nm", "rms_after_nm"})
            ck_assert(one.at(key).is_number() && one.at(key) > 0);
        ck_assert(one.at("ambiguous_with").is_array());
        ck_assert(one.at("next_experiment").is_string());
        for (const auto &e : one.at("effects")) {
            ck_assert(e.at("id") == "payload");
            ck_assert(e.at("depends_on").is_array() && !e.at("depends_on").empty());
            ck_assert(e.at("rms_nm") > 0);
            ck_assert(e.at("p_adjusted") <= 0.05);
            ck_assert(e.at("params").at("mass_kg").at("value").is_number());
            ck_assert(e.at("params").at("mass_kg").at("sigma") > 0);
        }
    }
    ck_assert(!j.at("joints")[0].at("effects").empty());
    const ArmFile back = ArmFile::load(dir + "/model.toml");
    ck_assert_double_eq_tol(back.arm().payload_kg, 0.6, 0.1);
    const std::string html = slurp(dir + "/report.html");
    ck_assert(html.find("<svg") != std::string::npos);
    ck_assert(html.find("payload") != std::string::npos);
}
END_TEST

START_TEST(test_bad_requests_name_what_is_wrong)
{
    const std::vector<Run> run = {planar::make_run({}, {}, 1, 10)};
    DiagnoseOptions options;
    const auto refuses = [&](const std::vector<Run> &fit, const std::vector<Run> &test, const char *word) {
        try {
            (void)diagnose(arm(), fit, test, options);
        } catch (const InputError &e) {
            return std::string(e.what()).find(word) != std::string::npos;
        }
        return false;
    };
    ck_assert(refuses({}, run, "at least one run"));
    ck_assert(refuses(run, {}, "at least one run"));
    ck_assert(refuses(run, run, "must not be fitted"));
    options.joints = {3};
    std::vector<Run> other = {planar::make_run({}, {}, 2, 10)};
    ck_assert(refuses(run, other, "joint 3"));
}
END_TEST

START_TEST(test_joint_that_stands_still_is_left_out)
{
    std::vector<Run> runs = planar::make_runs({}, {}, 4, 6);
    for (Run &r : runs)
        std::fill(r.joint[1].q_rad.begin(), r.joint[1].q_rad.end(), 0.2);
    const Diagnosis d = diagnose(arm(), {runs.begin(), runs.begin() + 4}, {runs.begin() + 4, runs.end()}, {});
    ck_assert_uint_eq(d.joints.size(), 1);
    ck_assert_int_eq(d.joints[0].joint, 1);
    ck_assert_uint_eq(d.skipped.size(), 1);
    ck_assert_int_eq(d.skipped[0].first, 2);
}
END_TEST

static Suite *diagnose_suite(void)
{
    Suite *s = suite_create("diagnose");
    TCase *null = tcase_create("null");
    tcase_set_timeout(null, 300);
    tcase_add_loop_test(null, test_nothing_hidden_is_nothing_named, 0, 5);
    suite_add_tcase(s, null);
    TCase *effects = tcase_create("effects");
    tcase_set_timeout(effects, 300);
    tcase_add_loop_test(effects, test_effect_hidden_is_effect_named, 0, 8);
    tcase_add_test(effects, test_changed_friction_is_taken_over);
    tcase_add_test(effects, test_chain_effects_are_adopted_for_the_whole_arm);
    tcase_add_test(effects, test_adopted_model_leaves_nothing_on_fresh_runs);
    tcase_add_test(effects, test_what_no_name_explains_is_localised);
    tcase_add_test(effects, test_curve_beside_a_gain_has_its_own_size);
    suite_add_tcase(s, effects);
    TCase *menu = tcase_create("menu");
    tcase_set_timeout(menu, 120);
    tcase_add_loop_test(menu, test_every_effect_of_the_contract_can_be_named, 0,
                        static_cast<int>(cases().size()));
    suite_add_tcase(s, menu);
    TCase *events = tcase_create("events");
    tcase_set_timeout(events, 120);
    tcase_add_loop_test(events, test_event_is_found_where_it_was, 0, 4);
    tcase_add_test(events, test_event_does_not_hide_an_effect);
    suite_add_tcase(s, events);
    TCase *rules = tcase_create("rules");
    tcase_set_timeout(rules, 120);
    tcase_add_test(rules, test_too_few_runs_refuse_to_name);
    tcase_add_test(rules, test_few_runs_name_only_when_asked_to);
    tcase_add_test(rules, test_what_held_out_runs_deny_is_not_adopted);
    tcase_add_test(rules, test_what_only_held_out_runs_show_is_said);
    tcase_add_test(rules, test_what_few_runs_show_is_not_named);
    tcase_add_test(rules, test_pieces_of_one_recording_are_one_run);
    tcase_add_test(rules, test_next_run_is_a_task_with_a_prediction);
    tcase_add_test(rules, test_same_logs_same_answer);
    tcase_add_test(rules, test_files_keep_the_contract);
    tcase_add_test(rules, test_bad_requests_name_what_is_wrong);
    tcase_add_test(rules, test_joint_that_stands_still_is_left_out);
    suite_add_tcase(s, rules);
    return s;
}

HDT_CHECK_MAIN(diagnose_suite())
