// SPDX-License-Identifier: Apache-2.0
//
// Vectors of tools/vectors: the control law in double precision from the model file alone.
// Goal: every term the core puts out, and every digit, is the law's within what the tables' quantisation
// allows.  Method: model file -> hdt gen's tables -> core, each instant held as the vectors say; the
// allowance is the generator's own report, so a worse table fails here.
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "ctrl/hdt.h"
#include "model/hdt_arm.h"
#include "tests/check_main.h"

namespace {

struct Row { int32_t count, q_ref, v_before, v_ref, a_ref; double term[HDT_TERMS], digit; };
struct Vectors { int held = 0, before = 0, joints = 0; std::vector<std::vector<Row>> instants; };

Vectors read(const std::string &path)
{
    std::ifstream file(path);
    std::string line, word;
    std::vector<int> terms; // in the order of the file
    Vectors v;
    ck_assert_msg(bool(file), "%s cannot be read", path.c_str());
    while (std::getline(file, line)) {
        std::istringstream in(line);
        if (line[0] == '#')
            continue;
        if (line == "instant") {
            v.instants.emplace_back();
        } else if (line[0] == 'h') {
            in >> word >> v.held >> word;
            if (word == "before")
                in >> v.before >> word;
            in >> v.joints >> word;
            while (in >> word)
                for (int k = 0; k < HDT_TERMS; k++)
                    if (word == hdt_term_str(k))
                        terms.push_back(k);
        } else {
            Row r = {};
            in >> r.count >> r.q_ref;
            if (v.before > 0)
                in >> r.v_before;
            in >> r.v_ref >> r.a_ref;
            for (int k : terms)
                in >> r.term[k];
            in >> r.digit;
            ck_assert_msg(bool(in), "%s: %s", path.c_str(), line.c_str());
            v.instants.back().push_back(r);
        }
    }
    ck_assert_int_eq(static_cast<int>(terms.size()), HDT_TERMS);
    ck_assert_int_gt(static_cast<int>(v.instants.size()), 30);
    return v;
}

// What a term may be off by, N m: the tables' worst quantisation, and the rounding of what goes in.
double allowance(int term, const hdt_gen_report &report)
{
    // inertia is reported at the largest acceleration, which no vector has
    return term == HDT_TERM_INERTIA ? 1e-4 : report.term_nm[term] + 5e-5;
}

// A wind-up line at a load, N m.
double line_nm(const hdt_stiffness_tab &s, double load_nm)
{
    const double load_q16 = load_nm * 65536;
    const int i = load_q16 < s.t1_q16 ? 0 : load_q16 <= s.t2_q16 ? 1 : 2;
    return s.intercept_q16[i] / 65536.0 + s.slope_q24[i] / 16777216.0 * load_nm;
}

// What the state of a wind-up with a travel may be off by, N m: half an LSB (q30) of travel each period, all
// the same way at a held speed, and 1e-6 of the travel for the period's length in whole nanoseconds.
double windup_allowance(const hdt_joint_tab &joint, int periods, double load_nm)
{
    const double wound = std::ldexp(periods * (joint.windup_inv_q8 / 256.0), -31) +
                         (joint.windup_inv_q8 != 0 ? 1e-6 : 0);
    return wound * std::fabs(line_nm(joint.stiffness[0], load_nm) - line_nm(joint.stiffness[1], load_nm)) / 2;
}

void hold(hdt_t *core, const hdt_tables &tables, const Vectors &v, const std::vector<Row> &instant,
          hdt_out *out)
{
    hdt_in in = {};
    in.mode = HDT_MODE_TORQUE;
    in.active = in.fresh = (1u << tables.joints) - 1;
    for (int j = 0; j < v.joints; j++) {
        in.count[j].raw = instant[j].count;
        in.q_ref[j].raw = instant[j].q_ref;
        in.a_ref[j].raw = instant[j].a_ref;
    }
    ck_assert_int_eq(hdt_init(core, &tables), HDT_OK);
    for (int k = 0; k < v.before + v.held; k++) {
        for (int j = 0; j < v.joints; j++)
            in.v_ref[j].raw = k < v.before ? instant[j].v_before : instant[j].v_ref;
        in.t_us = 1000000 + static_cast<uint64_t>(k) * tables.period_ns / 1000;
        ck_assert_int_eq(hdt_step(core, &in, out), HDT_OK);
    }
}

struct Case { const char *arm, *vectors; };
const Case cases[] = {{"model/arms/pa10.toml", "tests/vectors/pa10.vec"},
                      {"tests/vectors/effects.toml", "tests/vectors/effects.vec"},
                      {"tests/vectors/axes.toml", "tests/vectors/axes.vec"}};

} // namespace

START_TEST(test_terms_and_digits_are_the_laws)
{
    static hdt_arm arm;
    static hdt_tables tables;
    static hdt_t core;
    static hdt_out out;
    hdt_gen_report report;
    char error[512];
    const Case &c = cases[_i];
    const Vectors v = read(c.vectors);
    ck_assert_msg(hdt_arm_load(c.arm, &arm, error, sizeof error) == 0, "%s", error);
    ck_assert_msg(hdt_arm_tables(&arm, &tables, &report, error, sizeof error) == 0, "%s", error);
    ck_assert_int_eq(v.joints, static_cast<int>(tables.joints));
    int digits = 0, other = 0, seen[HDT_TERMS] = {};
    for (size_t n = 0; n < v.instants.size(); n++) {
        hold(&core, tables, v, v.instants[n], &out);
        for (int j = 0; j < v.joints; j++) {
            const Row &r = v.instants[n][j];
            double all = 0;
            for (int k = 0; k < HDT_TERMS; k++) {
                const double got = out.term[k][j].raw / 65536.0,
                             may = allowance(k, report) +
                                   (k == HDT_TERM_STIFFNESS
                                        ? windup_allowance(tables.joint[j], v.before + v.held,
                                                           r.term[HDT_TERM_GRAVITY] + r.term[HDT_TERM_SPRING])
                                        : 0);
                ck_assert_msg(std::fabs(got - r.term[k]) <= may,
                              "instant %zu, joint %d, %s: %.6f, the law says %.6f", n, j + 1, hdt_term_str(k),
                              got, r.term[k]);
                all += tables.joint[j].terms >> k & 1 ? may : 0;
                seen[k] += r.term[k] != 0;
            }
            const double per_nm = tables.joint[j].digit_per_nm_q24 / 16777216.0;
            const double want = std::fmax(-tables.joint[j].dig_max,
                                          std::fmin(tables.joint[j].dig_max, r.digit));
            ck_assert_msg(out.fault == 0, "instant %zu: fault %s", n, hdt_fault_str(out.fault));
            ck_assert_msg(std::fabs(out.digit[j].raw - want) <= 0.5 + all * per_nm,
                          "instant %zu, joint %d: %d digits, the law says %.3f", n, j + 1, out.digit[j].raw,
                          r.digit);
            digits++;
            other += out.digit[j].raw != static_cast<int>(std::lround(want));
        }
    }
    // the same digit but for those that the tables' error, up to 0.6 of a digit, carries over a half
    ck_assert_msg(other * 10 < digits, "%d of %d digits are the neighbour's", other, digits);
    for (int k = 0; k < HDT_TERMS; k++)
        if (_i == 1)
            ck_assert_msg(seen[k] > 0, "no vector has the term %s", hdt_term_str(k));
    printf("%s: %d digits, %d of them beside the law's\n", c.vectors, digits, other);
}
END_TEST

START_TEST(test_observed_velocity_is_the_equations)
{
    static hdt_arm arm;
    static hdt_tables tables;
    static hdt_t core;
    static hdt_out out;
    hdt_gen_report report;
    char error[512];
    const std::string path = "tests/vectors/observer.vec";
    std::ifstream file(path);
    std::string line, word;
    int periods = 0, joints = 0, moving = 0;
    ck_assert_msg(bool(file), "%s cannot be read", path.c_str());
    std::getline(file, line);
    file >> word >> periods >> word >> joints;
    ck_assert_int_ge(periods, 200);
    ck_assert_msg(hdt_arm_load("tests/vectors/axes.toml", &arm, error, sizeof error) == 0, "%s", error);
    arm.observe_feedback = 1;
    ck_assert_msg(hdt_arm_tables(&arm, &tables, &report, error, sizeof error) == 0, "%s", error);
    ck_assert_int_eq(joints, static_cast<int>(tables.joints));
    ck_assert_int_eq(hdt_init(&core, &tables), HDT_OK);
    // roundings: of an angle's 2^-33 rad by 220/s, of the output by 2^-25; the period cut to 2^-32 s shows in
    // speeds below 1 rad/s, twice over where a triple pole overshoots
    const double may = 1e-7 + 2 / std::ldexp(tables.period_ns * 1e-9, 32);
    hdt_in in = {};
    in.fresh = (1u << tables.joints) - 1;
    for (int k = 0; k < periods; k++) {
        double want[HDT_JOINTS_MAX];
        for (int j = 0; j < joints; j++)
            file >> in.count[j].raw >> want[j];
        ck_assert_msg(bool(file), "%s ends before period %d", path.c_str(), k);
        in.t_us = 1000000 + static_cast<uint64_t>(k) * tables.period_ns / 1000;
        ck_assert_int_eq(hdt_step(&core, &in, &out), HDT_OK);
        for (int j = 0; j < joints; j++) {
            const double got = out.v_obs[j].raw / 16777216.0;
            ck_assert_msg(std::fabs(got - want[j]) <= may,
                          "period %d, joint %d: %.9f, the equations say %.9f", k, j + 1, got, want[j]);
            moving += std::fabs(want[j]) > 0.05;
        }
    }
    ck_assert_int_gt(moving, periods);
}
END_TEST

int main()
{
    Suite *s = suite_create("vectors");
    TCase *t = tcase_create("law");
    tcase_add_loop_test(t, test_terms_and_digits_are_the_laws, 0, 3);
    tcase_add_test(t, test_observed_velocity_is_the_equations);
    suite_add_tcase(s, t);
    SRunner *runner = srunner_create(s);
    srunner_run_all(runner, CK_ENV);
    const int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? 0 : 1;
}
