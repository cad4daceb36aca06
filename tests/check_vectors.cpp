// SPDX-License-Identifier: Apache-2.0
//
// Vectors of tools/vectors: the control law in double precision from the model file alone.
// Goal: every term the core puts out, and every digit, is the law's within what the tables' quantisation
// allows.  Method: model file -> hdt gen's tables -> core, each instant held as the vectors say; the allowance
// is the generator's own report, so a worse table fails here.
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

struct Row { int32_t count, q_ref, v_ref, a_ref; double term[HDT_TERMS], digit; };
struct Vectors { int held = 0, joints = 0; std::vector<std::vector<Row>> instants; };

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
            in >> word >> v.held >> word >> v.joints >> word;
            while (in >> word)
                for (int k = 0; k < HDT_TERMS; k++)
                    if (word == hdt_term_str(k))
                        terms.push_back(k);
        } else {
            Row r = {};
            in >> r.count >> r.q_ref >> r.v_ref >> r.a_ref;
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
    const double rounding = 1e-4;
    switch (term) {
    case HDT_TERM_FRICTION: return report.friction_nm + rounding;
    case HDT_TERM_RIPPLE: return report.ripple_nm + rounding;
    case HDT_TERM_GRAVITY: return report.gravity_nm + rounding;
    case HDT_TERM_LOCAL:
    case HDT_TERM_TABLE: return report.curves_nm + rounding;
    case HDT_TERM_LINES: return report.lines_nm + rounding;
    default: return rounding;
    }
}

void hold(hdt_t *core, const hdt_tables &tables, const Vectors &v, const std::vector<Row> &instant, hdt_out *out)
{
    hdt_in in = {};
    in.mode = HDT_MODE_TORQUE;
    in.active = in.fresh = (1u << tables.joints) - 1;
    for (int j = 0; j < v.joints; j++) {
        in.count[j].raw = instant[j].count;
        in.q_ref[j].raw = instant[j].q_ref;
        in.v_ref[j].raw = instant[j].v_ref;
        in.a_ref[j].raw = instant[j].a_ref;
    }
    ck_assert_int_eq(hdt_init(core, &tables), HDT_OK);
    for (int k = 0; k < v.held; k++) {
        in.t_us = 1000000 + static_cast<uint64_t>(k) * tables.period_ns / 1000;
        ck_assert_int_eq(hdt_step(core, &in, out), HDT_OK);
    }
}

struct Case { const char *arm, *vectors; };
const Case cases[] = {{"model/arms/pa10.toml", "tests/vectors/pa10.vec"},
                      {"tests/vectors/effects.toml", "tests/vectors/effects.vec"}};

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
                const double got = out.term[k][j].raw / 65536.0, may = allowance(k, report);
                ck_assert_msg(std::fabs(got - r.term[k]) <= may, "instant %zu, joint %d, %s: %.6f, the law says %.6f", n,
                              j + 1, hdt_term_str(k), got, r.term[k]);
                all += tables.joint[j].terms >> k & 1 ? may : 0;
                seen[k] += r.term[k] != 0;
            }
            const double per_nm = tables.joint[j].digit_per_nm_q24 / 16777216.0;
            const double want = std::fmax(-tables.joint[j].dig_max, std::fmin(tables.joint[j].dig_max, r.digit));
            ck_assert_msg(out.fault == 0, "instant %zu: fault %s", n, hdt_fault_str(out.fault));
            ck_assert_msg(std::fabs(out.digit[j].raw - want) <= 0.5 + all * per_nm,
                          "instant %zu, joint %d: %d digits, the law says %.3f", n, j + 1, out.digit[j].raw, r.digit);
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

int main()
{
    Suite *s = suite_create("vectors");
    TCase *t = tcase_create("law");
    tcase_add_loop_test(t, test_terms_and_digits_are_the_laws, 0, 2);
    suite_add_tcase(s, t);
    SRunner *runner = srunner_create(s);
    srunner_run_all(runner, CK_ENV);
    const int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? 0 : 1;
}
