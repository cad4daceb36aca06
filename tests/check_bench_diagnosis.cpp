// SPDX-License-Identifier: Apache-2.0
//
// The bench that puts the diagnosis to the test, itself tested: its bounds against the binomial sum,
// its judgement against answers made by hand, and a whole round of it, scaled down: logs of the rig,
// `hdt diagnose` as a process, answers counted.
#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include <nlohmann/json.hpp>

#include "model/arm_file.hpp"
#include "tests/shell.hpp"
#include "tools/bench_diagnosis.hpp"
#include "tools/hdt_effects.hpp"
#include "tests/check_main.h"

using namespace hdt;
using namespace hdt::bench;

namespace {

using Text = std::vector<std::string>;

Answer answer(const char *verdict, const Text &names, const Text &ambiguous = {}, const Text &axes = {})
{
    Answer a;
    a.verdict = verdict;
    a.names = names;
    a.ambiguous = ambiguous;
    a.axes = axes;
    a.floor_nm = a.refit_nm = 1;
    a.before_nm = 2;
    a.after_nm = names.empty() && axes.empty() ? 2 : 1;
    return a;
}

Outcome outcome(Group group, const std::vector<std::string> &ids, const Answer &a)
{
    Outcome o;
    o.c.name = ids[0] + "@2/1/00";
    o.c.group = group;
    o.c.ids = ids;
    o.c.joint = group == Group::Null ? 0 : 2;
    o.c.rho = 1;
    o.answer = {answer("nothing", {}), a};
    o.rho = {0, 1};
    o.oracle_nm = 1;
    return o;
}

double choose(int n, int k)
{
    double c = 1;
    for (int i = 1; i <= k; i++)
        c = c * (n - k + i) / i;
    return c;
}

// P(lo <= X <= hi) of n with p, term by term.
double binomial(int n, double p, int lo, int hi)
{
    double sum = 0;
    for (int k = lo; k <= hi; k++)
        sum += choose(n, k) * std::pow(p, k) * std::pow(1 - p, n - k);
    return sum;
}

} // namespace

// What the bounds mean: as few, or as many, would come once in forty.
START_TEST(test_bounds_are_exact)
{
    for (int n : {1, 7, 40}) {
        for (int k = 0; k <= n; k++) {
            const Bounds b = exact_bounds(k, n);
            ck_assert_double_le(b.lo, static_cast<double>(k) / n);
            ck_assert_double_ge(b.hi, static_cast<double>(k) / n);
            if (k < n)
                ck_assert_double_eq_tol(binomial(n, b.hi, 0, k), 0.025, 1e-9);
            if (k > 0)
                ck_assert_double_eq_tol(binomial(n, b.lo, k, n), 0.025, 1e-9);
        }
    }
    ck_assert_double_eq_tol(exact_bounds(5, 10).lo, 0.18709, 1e-5); // Clopper and Pearson's table
    ck_assert_double_eq(exact_bounds(0, 0).hi, 1);
    // four hundred without one: the bound the bench is after
    ck_assert_double_lt(exact_bounds(0, 400).hi, 0.01);
}
END_TEST

START_TEST(test_quantiles)
{
    ck_assert_double_eq(quantile({3, 1, 2}, 0.5), 2);
    ck_assert_double_eq(quantile({3, 1, 2}, 0.25), 1.5);
    ck_assert_double_eq(quantile({3, 1, 2}, 1), 3);
    ck_assert(std::isnan(quantile({}, 0.5)));
}
END_TEST

// What friction could take over is no contribution; what it could not is, whole.
START_TEST(test_friction_is_no_contribution)
{
    std::vector<double> v, friction, wave, both;
    for (int t = 0; t < 4000; t++) {
        v.push_back(t % 1000 < 100 ? 0 : 0.3 * std::sin(0.01 * t));
        friction.push_back(v.back() > 0 ? 5 + 7 * v.back() : v.back() < 0 ? -3 + 9 * v.back() : 1);
        wave.push_back(2 * std::sin(0.37 * t));
        both.push_back(friction.back() + wave.back());
    }
    ck_assert_double_lt(reducible_rms(friction, v), 1e-3);
    ck_assert_double_eq_tol(reducible_rms(wave, v), std::sqrt(2.0), 0.02);
    ck_assert_double_eq_tol(reducible_rms(both, v), reducible_rms(wave, v), 1e-3);
    ck_assert_double_eq(reducible_rms(wave, std::vector<double>(wave.size())), 0);
}
END_TEST

START_TEST(test_list_of_cases)
{
    const Size size;
    const std::vector<Case> cases = all_cases(size), again = all_cases(size);
    std::set<std::string> names, families;
    std::map<std::string, std::set<int>> joints, specimens;
    std::map<std::string, std::set<double>> rhos;
    int nulls = 0;
    for (std::size_t i = 0; i < cases.size(); i++) {
        const Case &c = cases[i];
        ck_assert_msg(names.insert(c.name).second, "%s twice", c.name.c_str());
        ck_assert_str_eq(c.name.c_str(), again[i].name.c_str());
        ck_assert(c.specimen >= 1 && c.specimen <= size.specimens);
        nulls += c.group == Group::Null;
        if (c.group == Group::Null) {
            families.insert(c.ids[0]);
            continue;
        }
        // the oracle is the healthy set of the same seeds
        ck_assert(c.set >= 0 && c.set < size.sets);
        ck_assert_int_eq(c.only_run >= 0, c.group == Group::Part);
        joints[c.ids[0]].insert(c.joint);
        specimens[c.ids[0]].insert(c.specimen);
        rhos[c.ids[0]].insert(c.rho);
    }
    ck_assert_uint_eq(families.size(), 4);
    ck_assert_int_ge(7 * nulls, 400);
    const std::vector<std::string> plant = rig::effect_names();
    for (const Kind &k : kinds()) {
        ck_assert_msg(std::count(plant.begin(), plant.end(), k.id) == 1, "%s: not in the plant", k.id);
        ck_assert_uint_eq(joints[k.id].size(), 3);
        ck_assert_uint_ge(specimens[k.id].size(), 2);
        ck_assert_uint_eq(rhos[k.id].size(), k.group == Group::Named ? 3 : 1);
    }
}
END_TEST

START_TEST(test_judgement)
{
    const auto named = [](const Answer &a) { return score(outcome(Group::Named, {"cable_spring"}, a)); };
    Score s = named(answer("named", {"cable_spring"}));
    ck_assert(s.detected && s.first && s.in_set && !s.wrong && !s.extra);
    s = named(answer("named", {"link_mass"}, {"cable_spring"}));
    ck_assert(s.detected && !s.first && s.in_set && !s.wrong);
    s = named(answer("named", {"link_mass"}, {"payload"}));
    ck_assert(s.detected && !s.first && !s.in_set && s.wrong);
    s = named(answer("named", {"cable_spring", "inertia"}));
    ck_assert(s.first && !s.wrong && s.extra);
    s = named(answer("named", {"inertia", "cable_spring"}));
    ck_assert(!s.first && s.in_set && !s.wrong && s.extra);
    s = named(answer("unnamed", {}, {}, {"q2"}));
    ck_assert(s.detected && !s.first && !s.in_set && !s.wrong);
    // what was only suspected was not said
    s = named(answer("suspect", {"link_mass"}));
    ck_assert(!s.detected && !s.in_set && !s.wrong);

    const auto dry_spot = [](const Answer &a) {
        return score(outcome(Group::Outside, {"local_friction"}, a));
    };
    ck_assert(dry_spot(answer("unnamed", {}, {}, {"q2,direction"})).axis);
    ck_assert(!dry_spot(answer("unnamed", {}, {}, {"q3"})).axis);
    ck_assert(dry_spot(answer("named", {"local_friction"})).axis);
    ck_assert(!dry_spot(answer("named", {"local_friction"})).wrong);
    ck_assert(dry_spot(answer("named", {"payload"})).wrong);
    // in one run of eight even the right word is wrong: it is no property of the joint
    ck_assert(score(outcome(Group::Part, {"brake_drag"}, answer("named", {"temperature"}))).wrong);
    Answer pushed = answer("nothing", {});
    pushed.event_runs = {"somewhere/run2.csv"};
    Outcome part = outcome(Group::Part, {"contact"}, pushed);
    part.c.only_run = 2;
    ck_assert(score(part).located);
    part.answer[1].event_runs.push_back("somewhere/run4.csv");
    ck_assert(!score(part).located);
    part.answer[1].event_runs.clear();
    ck_assert(!score(part).located);

    const auto two = [](const Answer &a) { return score(outcome(Group::Two, {"inertia", "presliding"}, a)); };
    ck_assert(two(answer("named", {"presliding", "inertia"})).first);
    s = two(answer("named", {"presliding"}));
    ck_assert(!s.first && !s.in_set && !s.wrong);
}
END_TEST

START_TEST(test_errors_are_held_to_the_oracle)
{
    Outcome o = outcome(Group::Named, {"inertia"}, answer("named", {"inertia"}));
    ck_assert_double_eq(recovered(o), 1);
    ck_assert(!made_worse(o));
    o.adopted_nm = std::sqrt(2.5); // the file read back counts, not what was printed: half of 4 - 1 is left
    ck_assert_double_eq_tol(recovered(o), 0.5, 1e-12);
    ck_assert_double_eq(after_nm(o), o.adopted_nm);
    o.adopted_nm = 2.1;
    ck_assert(made_worse(o));
    ck_assert_double_lt(recovered(o), 0);
    // of a null log: any joint
    o = outcome(Group::Null, {"plain"}, answer("named", {"inertia"}));
    ck_assert(!made_worse(o));
    o.answer[0].after_nm = 2.05;
    ck_assert(made_worse(o));
}
END_TEST

START_TEST(test_page_counts)
{
    std::vector<Outcome> all;
    for (int k = 0; k < 4; k++)
        all.push_back(outcome(Group::Named, {"inertia"}, answer("named", {k == 3 ? "payload" : "inertia"})));
    for (int k = 0; k < 200; k++)
        all.push_back(outcome(Group::Null, {"plain"}, answer("nothing", {})));
    Outcome lost = outcome(Group::Named, {"inertia"}, answer("named", {"payload"}));
    lost.failure = "the rig refused";
    all.push_back(lost);
    // a case that missed its rho is no case of that rho
    Outcome off = all[0];
    off.rho[1] = 0.6;
    all.push_back(off);
    const std::string text = page({"make bench-diagnosis", "version 0", {}, 1}, all);
    const auto holds = [&](const char *what) {
        ck_assert_msg(text.find(what) != std::string::npos, "not on the page: %s", what);
    };
    holds("| rho 1.00: right name in the printed set | 3 of 4: 75.0 % (19.4 to 99.4) | at least 97.0 % | no "
          "|");
    holds("| rho 1.00: a wrong name | 1 of 4: 25.0 % (0.6 to 80.6) | at most 2.0 % | no |");
    holds("| nothing hidden: a joint named | 0 of 400: 0.0 % (0.0 to 0.9) | at most 1.0 %, bound 3.0 % | yes "
          "|");
    holds("| rho 0.50: right name first | no case | at least 88.0 % | no |");
    holds("* inertia@2/1/00: the rig refused");
    holds("| specimen | joint 1 | joint 2 |\n| --- | --- | --- |\n| 1 | 2.00 | 2.00 |");
    // one named of sixty is a rate small enough, with a bound that is not
    all.resize(34);
    all.back().answer[0] = answer("named", {"inertia"});
    const std::string few = page({"", "", {}, 1}, all);
    ck_assert(few.find("joint named | 1 of 60: 1.7 % (0.0 to 8.9) | at most 1.0 %, bound 3.0 % | no |")
              != std::string::npos);
}
END_TEST

START_TEST(test_broken_answers_are_refused)
{
    for (const char *text : {"{}", "{\"joints\": [{\"joint\": 1}]}", "{\"joints\": [{\"joint\": 99}]}"}) {
        bool refused = false;
        try {
            (void)read_answers(nlohmann::json::parse(text), 2);
        } catch (const InputError &e) {
            refused = std::string(e.what()).find("diagnosis.json") != std::string::npos;
        }
        ck_assert_msg(refused, "%s was taken", text);
    }
}
END_TEST

// One arm, runs of 20 s: a spring on joint 4 is found at twice the floor, nothing is said of a wrist that
// has nothing, and the logs the diagnosis is given do not say what is in them.
START_TEST(test_round_of_the_bench)
{
    const std::string dir = scratch_dir();
    Place place;
    place.hdt = build_dir() + "/hdt";
    place.out = dir;
    place.joints = "4,6";
    place.keep = true;
    Size size;
    size.specimens = size.sets = size.repeats = 1;
    size.nulls = 0;
    size.seconds = 20;
    Case healthy, spring;
    healthy.name = "healthy";
    healthy.ids = {"plain"};
    spring.name = "spring";
    spring.group = Group::Named;
    spring.ids = {"cable_spring"};
    spring.joint = 4;
    spring.rho = 2;
    const std::vector<Outcome> all = run_cases(place, size, {healthy, spring}, {"", "", size, 0});
    ck_assert_uint_eq(all.size(), 2);
    for (const Outcome &o : all)
        ck_assert_msg(o.failure.empty(), "%s: %s", o.c.name.c_str(), o.failure.c_str());
    const Outcome &none = all[0], &some = all[1];
    ck_assert_str_ne(none.answer[5].verdict.c_str(), "named");
    ck_assert_str_ne(none.answer[5].verdict.c_str(), "unnamed");
    ck_assert(none.answer[1].verdict.empty()); // not asked for
    ck_assert(aimed(some));
    ck_assert_double_lt(some.rho[5], 0.5);     // the wrist does not feel it
    const Score s = score(some);
    ck_assert_msg(s.in_set && !s.wrong, "joint 4: %s", some.answer[3].verdict.c_str());
    // the oracle is the healthy set's error, and most of the way to it is gone
    ck_assert_double_eq(some.oracle_nm, none.answer[3].refit_nm);
    ck_assert_double_gt(some.answer[3].before_nm, 1.5 * some.oracle_nm);
    ck_assert_double_gt(recovered(some), 0.8);
    const std::string log = slurp(dir + "/case-spring/run0.csv");
    ck_assert_uint_gt(log.size(), 1000000);
    ck_assert(log.find("spring") == std::string::npos && log.find("effect") == std::string::npos);
    ck_assert_uint_gt(slurp(dir + "/page.md").size(), 1000);
}
END_TEST

static Suite *bench_suite(void)
{
    Suite *s = suite_create("bench_diagnosis");
    TCase *pure = tcase_create("judgement");
    tcase_add_test(pure, test_bounds_are_exact);
    tcase_add_test(pure, test_quantiles);
    tcase_add_test(pure, test_friction_is_no_contribution);
    tcase_add_test(pure, test_list_of_cases);
    tcase_add_test(pure, test_judgement);
    tcase_add_test(pure, test_errors_are_held_to_the_oracle);
    tcase_add_test(pure, test_page_counts);
    tcase_add_test(pure, test_broken_answers_are_refused);
    suite_add_tcase(s, pure);
    TCase *round = tcase_create("round");
    tcase_set_timeout(round, 300);
    tcase_add_test(round, test_round_of_the_bench);
    suite_add_tcase(s, round);
    return s;
}

HDT_CHECK_MAIN(bench_suite())
