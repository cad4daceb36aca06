// SPDX-License-Identifier: Apache-2.0
//
// Import maps: foreign tables land in our columns with their units, and what is wrong is named by
// map and key, or by foreign file and line.
//
// Method: synthetic maps and tables in a directory of the test's own; then, when HDT_DATA names
// the measured data, every shipped map on its own arm's files, checked by physics: differentiated
// position is velocity, torque holds the arm up.
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>

#include "model/log.hpp"
#include "tests/check_main.h"
#include "tests/scratch.hpp"

namespace {

using hdt::InputError;
using hdt::Run;

std::string put(const std::string &name, const std::string &bytes)
{
    const std::string path = scratch(name);
    FILE *file = std::fopen(path.c_str(), "wb");
    ck_assert_ptr_nonnull(file);
    ck_assert_uint_eq(std::fwrite(bytes.data(), 1, bytes.size(), file), bytes.size());
    std::fclose(file);
    return path;
}

const std::string head = "format = \"hdt-import\"\nversion = 1\n";
const std::string table = "Time;Pos A;Load A;Pos B;Load B\n"
                          "0;180;10;1;2\n"
                          "500;90;20;3;4\n"
                          "1500;-90;30;5;6\n";

std::string error_of(const std::string &map, const std::string &foreign)
{
    try {
        hdt::convert_run(map, foreign);
    } catch (const InputError &error) {
        const std::string text = error.what();
        ck_assert_msg(text.find('\n') == std::string::npos, "two lines: %s", text.c_str());
        return text;
    }
    return "(accepted)";
}

void assert_has(const std::string &text, const std::string &part)
{
    ck_assert_msg(text.find(part) != std::string::npos, "no \"%s\" in: %s", part.c_str(),
                  text.c_str());
}

START_TEST(test_scale_offset_and_sign_are_applied_in_that_meaning)
{
    const std::string map = put("map.toml", head +
        "[[file]]\nseparator = \";\"\n"
        "[constants]\npayload_kg = 2.5\npayload_com_m = [0, 0.5, 1e-3]\ntask = \"sweep\"\n"
        "[columns]\n"
        "t_s = { column = \"Time\", scale = 1e-3 }\n"
        "q1_rad = { column = \"Pos A\", scale = 0.5, sign = -1, offset = 7 }\n"
        "tau1_nm = { column = 3, scale = 2 }\n"
        "q2_rad = { column = \"Pos B\" }\n"
        "board_a = { column = \"Load B\" }\n");
    const Run run = hdt::convert_run(map, put("table.csv", table));
    ck_assert_uint_eq(run.rows(), 3);
    ck_assert_double_eq(run.t_s[2], 1.5);
    ck_assert_double_eq(run.joint[0].q_rad[0], 7 - 0.5 * 180);
    ck_assert_double_eq(run.joint[0].q_rad[2], 7 + 0.5 * 90);
    ck_assert_double_eq(run.joint[0].tau_nm[1], 40);
    ck_assert_double_eq(run.joint[1].q_rad[1], 3);
    ck_assert_double_eq(run.extra.at("board_a")[2], 6);
    ck_assert(run.joint[0].present && !run.joint[1].present);
    ck_assert_double_eq(run.constant("payload_kg", 0), 2.5);
    ck_assert_double_eq(run.constant_vector("payload_com_m")[2], 1e-3);
    ck_assert_str_eq(run.constants.at("task").c_str(), "sweep");
    // what a map makes is a run like any other
    hdt::write_run(scratch("out.csv"), run);
    ck_assert_double_eq(hdt::read_run(scratch("out.csv")).joint[0].tau_nm[2], 60);
}
END_TEST

START_TEST(test_numbered_family_takes_names_numbers_and_lists_per_joint)
{
    const std::string by_name = put("name.toml", head +
        "joints = 2\n[columns]\nt_s = { column = \"t\" }\n"
        "\"q{j}_rad\" = { column = \"p{j}\", scale = [1, 10], offset = [0, 1], sign = [1, -1] }\n"
        "\"tau{j}_nm\" = { column = 4 }\n");
    const Run run = hdt::convert_run(by_name, put("n.csv", "t,p1,p2,x,y\r\n0,1,2,3,4\r\n1,5,6,7,8\r\n"));
    ck_assert_double_eq(run.joint[0].q_rad[1], 5);
    ck_assert_double_eq(run.joint[1].q_rad[1], -60 + 1);
    ck_assert_double_eq(run.joint[0].tau_nm[0], 3);
    ck_assert_double_eq(run.joint[1].tau_nm[0], 4);
}
END_TEST

START_TEST(test_byte_order_mark_quotes_and_blank_lines_are_no_obstacle)
{
    const std::string map = put("map.toml", head +
        "[columns]\nt_s = { column = \"Time\" }\nq1_rad = { column = \"Pos\" }\n"
        "tau1_nm = { column = \"Cur\" }\n");
    const Run run = hdt::convert_run(
        map, put("b.csv", "\xef\xbb\xbf\"Time\",\"Pos\", Cur \n0,1,2\n\n1,3,4\n\n"));
    ck_assert_uint_eq(run.rows(), 2);
    ck_assert_double_eq(run.joint[0].tau_nm[1], 4);
}
END_TEST

START_TEST(test_files_of_one_value_a_line_are_put_in_rows)
{
    const std::string map = put("map.toml", head +
        "joints = 2\n"
        "[[file]]\nid = \"t\"\nname = \"t.txt\"\nheader = false\n"
        "[[file]]\nid = \"q\"\nname = \"q.txt\"\nper_row = 2\n"
        "[[file]]\nid = \"tau\"\nname = \"tau.txt\"\nper_row = 2\nseparator = \" \"\n"
        "[columns]\nt_s = { file = \"t\", column = 1 }\n"
        "\"q{j}_rad\" = { file = \"q\", column = 1 }\n"
        "\"tau{j}_nm\" = { file = \"tau\", column = 1 }\n");
    put("t.txt", "0\n1\n2\n");
    const std::string q = put("q.txt", "1\n2\n3\n4\n5\n6\n");
    put("tau.txt", "10 20\n30   40 \n 50 60\n");
    for (const std::string &foreign : {scratch_dir(), q}) {
        const Run run = hdt::convert_run(map, foreign);
        ck_assert_uint_eq(run.rows(), 3);
        ck_assert_double_eq(run.joint[0].q_rad[2], 5);
        ck_assert_double_eq(run.joint[1].q_rad[0], 2);
        ck_assert_double_eq(run.joint[0].tau_nm[1], 30);
        ck_assert_double_eq(run.joint[1].tau_nm[2], 60);
    }
    put("q.txt", "1\n2\n3\n4\n5\n");
    assert_has(error_of(map, scratch_dir()), "q.txt:5: expected 2 values for each row, found 1");
    put("q.txt", "1\n2\n3\n4\n");
    assert_has(error_of(map, scratch_dir()), "q.txt: expected 3 rows as in");
    put("q.txt", "1\n2\nx\n4\n5\n6\n");
    assert_has(error_of(map, scratch_dir()), "q.txt:4: column 1: expected a finite number, found 'x'");
    std::remove(q.c_str());
    assert_has(error_of(map, scratch_dir()), "q.txt: cannot be read: No such file");
}
END_TEST

START_TEST(test_rows_a_map_leaves_out_may_be_bad_and_no_others)
{
    const std::string columns = "[columns]\nt_s = { column = \"t\" }\nq1_rad = { column = \"q\" }\n"
                                "tau1_nm = { column = \"i\" }\n";
    const std::string drop = put("drop.toml", head + "drop_last = 2\n" + columns);
    const std::string keep = put("keep.toml", head + columns);
    const std::string late = put("late.csv", "t,q,i\n0,1,2\n1,1,2\n2,nan,2\n3,1,inf\n");
    ck_assert_uint_eq(hdt::convert_run(drop, late).rows(), 2);
    assert_has(error_of(keep, late), "late.csv:4: column 'q': expected a finite number, found 'nan'");
    const std::string early = put("early.csv", "t,q,i\n0,1,2\n1,,2\n2,1,2\n3,1,2\n");
    assert_has(error_of(drop, early), "early.csv:3: column 'q': expected a finite number, found ''");
    assert_has(error_of(drop, put("short.csv", "t,q,i\n0,1,2\n1,1,2\n")), "more than 2 rows, found 2");

    const std::string files = "[[file]]\nid = \"a\"\nname = \"a.csv\"\n"
                              "[[file]]\nid = \"b\"\nname = \"b.csv\"\n"
                              "[columns]\nt_s = { file = \"a\", column = \"t\" }\n"
                              "q1_rad = { file = \"a\", column = \"q\" }\n"
                              "tau1_nm = { file = \"b\", column = \"i\" }\n";
    put("a.csv", "t,q\n0,1\n1,2\n2,3\n");
    put("b.csv", "i\n5\n6\n");
    const std::string shortest = put("s.toml", head + "shortest = true\n" + files);
    ck_assert_uint_eq(hdt::convert_run(shortest, scratch_dir()).rows(), 2);
    assert_has(error_of(put("e.toml", head + files), scratch_dir()), "b.csv: expected 3 rows as in");
}
END_TEST

const std::string t_q_tau = "[columns]\nt_s = { column = \"t\" }\nq1_rad = { column = \"q\" }\n"
                            "tau1_nm = { column = \"tau\" }\n";

// A map wrong in one thing; the message names the line and the key.
const struct { const char *map, *says; } bad_maps[] = {
    {"[,", "map.toml: expected valid TOML"},
    {"format = \n", "map.toml:1: expected valid TOML"},
    {"version = 1\n", "map.toml: format: expected \"hdt-import\""},
    {"format = \"hdt-arm\"\nversion = 1\n", "map.toml:1: format: expected \"hdt-import\""},
    {"format = \"hdt-import\"\nversion = 2\n", "map.toml:2: version: expected 1"},
    {"format = \"hdt-import\"\n", "version: expected"},
    {"HEADcolumn = {}\n", "map.toml:3: column: expected one of format, version"},
    {"HEAD", "map.toml: columns: expected a table"},
    {"HEAD[columns]\nq1_rad = { column = \"q\" }\n", "columns: expected a column t_s"},
    {"HEAD[columns]\nt_s = { column = \"t\", scael = 2 }\n",
     "map.toml:4: columns.t_s.scael: expected one of file, column"},
    {"HEAD[columns]\nt_s = { column = \"t\", scale = \"2\" }\n",
     "map.toml:4: columns.t_s.scale: expected a finite number"},
    {"HEAD[columns]\nt_s = { column = \"t\", scale = inf }\n", "columns.t_s.scale: expected a finite number"},
    {"HEAD[columns]\nt_s = { column = \"t\", scale = true }\n",
     "columns.t_s.scale: expected a finite number"},
    {"HEAD[columns]\nt_s = { column = \"t\", scale = [1, 2] }\n", "columns.t_s.scale: expected one number"},
    {"HEAD[columns]\nt_s = { column = \"t\", sign = 2 }\n", "columns.t_s.sign: expected 1 or -1"},
    {"HEAD[columns]\nt_s = { column = 0 }\n", "columns.t_s.column: expected a whole number from 1"},
    {"HEAD[columns]\nt_s = { column = true }\n", "columns.t_s.column: expected a text"},
    {"HEAD[columns]\nt_s = {}\n", "columns.t_s.column: expected a text"},
    {"HEAD[columns]\nt_s = 5\n", "map.toml:4: columns.t_s: expected a table"},
    {"HEAD[columns]\nt_s = { column = \"t\" }\nq1_deg = { column = \"q\" }\n",
     "map.toml:5: columns.q1_deg: column 'q1_deg': expected 'q1_rad'"},
    {"HEAD[columns]\nt_s = { column = \"t\" }\n\"q{j}_rad\" = { column = \"q{j}\" }\n",
     "columns.q{j}_rad: expected joints = N"},
    {"HEADjoints = 17\n", "map.toml:3: joints: expected a whole number from 1 to 16"},
    {"HEADjoints = 2\n[columns]\nt_s = { column = \"t\" }\n\"q{j}_rad\" = { column = \"q\" }\n",
     "columns.q{j}_rad.column: expected {j} in the column name"},
    {"HEADjoints = 2\n[columns]\nt_s = { column = \"t\" }\n\"q{j}_rad\" = { column = \"q{j}\", "
     "scale = [1] }\n",
     "scale: expected 2 numbers, one per joint"},
    {"HEADjoints = 1\n[columns]\nt_s = { column = \"t\" }\n\"q{j}_rad\" = { column = 1 }\n"
     "q1_rad = { column = 2 }\n",
     "'q1_rad' is given twice"},
    {"HEADdrop_last = -1\n", "drop_last: expected a whole number from 0"},
    {"HEADshortest = 1\n", "shortest: expected true or false"},
    {"HEADfile = 1\n", "file: expected tables"},
    {"HEAD[[file]]\nseparator = \"ab\"\n", "file.separator: expected one of"},
    {"HEAD[[file]]\nper_row = 0\n", "file.per_row: expected a whole number"},
    {"HEAD[[file]]\nper_row = 2\nheader = true\n", "file.per_row: expected no header"},
    {"HEAD[[file]]\nnam = \"x\"\n", "file.nam: expected one of id, name"},
    {"HEAD[[file]]\nid = \"a\"\nname = \"a\"\n[[file]]\nid = \"a\"\nname = \"b\"\n",
     "file.id: expected a name of its own"},
    {"HEAD[[file]]\nid = \"a\"\n[[file]]\nid = \"b\"\n", "file: expected an id and a name for each"},
    {"HEAD[[file]]\nid = \"a\"\nname = \"a\"\n[[file]]\nid = \"b\"\nname = \"b\"\n"
     "[columns]\nt_s = { column = \"t\" }\n",
     "columns.t_s: expected file ="},
    {"HEAD[[file]]\nid = \"a\"\n[columns]\nt_s = { file = \"z\", column = \"t\" }\n",
     "columns.t_s.file: expected the id of a [[file]], found 'z'"},
    {"HEAD[[file]]\nheader = false\n[columns]\nt_s = { column = \"t\" }\n",
     "columns.t_s.column: expected a column number"},
    {"HEAD[constants]\npayload_kg = true\n", "constants.payload_kg: expected a finite number"},
    {"HEAD[constants]\nx = [1, \"a\"]\n", "map.toml:4: constants.x: expected a finite number"},
};

START_TEST(test_bad_map_is_refused_with_line_and_key)
{
    std::string text = bad_maps[_i].map;
    if (text.compare(0, 4, "HEAD") == 0)
        text.replace(0, 4, head);
    assert_has(error_of(put("map.toml", text), put("t.csv", "t,q,tau\n0,1,2\n")), bad_maps[_i].says);
}
END_TEST

START_TEST(test_missing_column_names_the_nearest_ones)
{
    const std::string map = put("map.toml", head + t_q_tau);
    const std::string text = error_of(map, put("t.csv", "t,Tau_1,TAO,tauu,zzzzzz\n0,1,2,3,4\n"));
    assert_has(text, "map.toml:5: columns.q1_rad: column 'q' is not in ");
    const std::string near = error_of(map, put("t.csv", "t,q,Tau_1,TAO,tauu,zzzzzz\n0,1,2,3,4,5\n"));
    assert_has(near, "columns.tau1_nm: column 'tau' is not in ");
    assert_has(near, "t.csv:1; nearest there: 'TAO', 'tauu', 't'");
    assert_has(error_of(map, put("t.csv", "t,q,tau,tau\n0,1,2,3\n")), "is twice in");
}
END_TEST

START_TEST(test_bad_foreign_table_is_refused_with_its_line)
{
    const std::string map = put("map.toml", head + t_q_tau);
    const struct { const char *table, *says; } bad[] = {
        {"", "t.csv: expected a header line, found an empty file"},
        {"t,q,tau\n0,1,2\n1,1\n", "t.csv:3: expected 3 fields as in the header, found 2"},
        {"t,q,tau\n0,1,2,3\n", "t.csv:2: expected 3 fields as in the header, found 4"},
        {"t,q,tau\n0,1,2\n1,1,2", "t.csv:3: the file ends inside a line"},
        {"t,q,tau\n0,1,2\n0,1,2\n", "t.csv:3: time must advance"},
        {"t,q,tau\n0,1,2\n\n-1,1,2\n", "t.csv:4: time must advance"},
        {"t,q,tau\n", "t.csv: expected more than 0 rows, found 0"},
        {"t,q,tau\n0,1,2 N m\n", "t.csv:2: column 'tau': expected a finite number, found '2 N m'"},
    };
    for (const auto &b : bad)
        assert_has(error_of(map, put("t.csv", b.table)), b.says);
    const std::string beyond = put("map.toml", head + "[[file]]\nheader = false\n[columns]\n"
                                   "t_s = { column = 1 }\nq1_rad = { column = 2 }\n"
                                   "tau1_nm = { column = 9 }\n");
    assert_has(error_of(beyond, put("t.csv", "0,1,2\n")), "columns.tau1_nm: expected at least 9 columns in ");
    assert_has(error_of(beyond, put("t.csv", "0,1,2,3,4,5,6,7,8\n1,2\n")),
               "t.csv:2: expected 9 fields a row");
    assert_has(error_of(scratch("none.toml"), "x"), "none.toml: cannot be read");
    // a run without a complete joint is no run
    const std::string columns = "[columns]\nt_s = { column = \"t\" }\nq1_rad = { column = \"q\" }\n";
    const std::string no_tau = put("map.toml", head + columns);
    assert_has(error_of(no_tau, put("t.csv", "t,q,tau\n0,1,2\n")), "at least one joint with both");
}
END_TEST

START_TEST(test_random_edits_of_map_and_table_end_in_a_run_or_one_line)
{
    uint64_t seed = 5;
    const std::string map = head + "joints = 1\n[[file]]\nseparator = \",\"\n" + t_q_tau;
    const char alphabet[] = "0123456789,.-+e\n\r\t #={}[]\"tqs_\xff";
    for (int trial = 0; trial < 2000; ++trial) {
        std::string m = map, t = "t,q,tau\n0,1,2\n1,2,3\n";
        for (int e = 0; e < 3; ++e) {
            std::string &text = test_random(&seed) % 2 ? m : t;
            const std::size_t at = test_random(&seed) % text.size();
            text[at] = alphabet[test_random(&seed) % (sizeof alphabet - 1)];
        }
        error_of(put("m.toml", m), put("t.csv", t));
    }
}
END_TEST

// ---- measured data ----

std::string data_path(const char *name)
{
    const char *root = std::getenv("HDT_DATA");
    const std::string path = std::string(root ? root : "../shared/data") + "/" + name;
    return std::filesystem::exists(path) ? path : "";
}

// Share of the differentiated position's square that the velocity column does not explain, and
// the factor between them, over the whole run.
void velocity_agrees(const Run::Joint &joint, const std::vector<double> &t_s, double *factor,
                     double *unexplained)
{
    double dd = 0, dv = 0, vv = 0;
    for (std::size_t i = 10; i < t_s.size(); i += 10) {
        const double d = joint.q_rad[i] - joint.q_rad[i - 10];
        double v = 0; // trapezoids: the integral of velocity over the same stretch
        for (std::size_t k = i - 9; k <= i; ++k)
            v += 0.5 * (joint.v_radps[k] + joint.v_radps[k - 1]) * (t_s[k] - t_s[k - 1]);
        dd += d * d, dv += d * v, vv += v * v;
    }
    *factor = dv / vv;
    *unexplained = 1 - dv * dv / (dd * vv);
}

void assert_velocities(const Run &run, double slack)
{
    for (std::size_t j = 0; j < run.joint.size(); ++j) {
        double factor, unexplained;
        velocity_agrees(run.joint[j], run.t_s, &factor, &unexplained);
        ck_assert_msg(std::fabs(factor - 1) < slack, "joint %zu: dq/dt is %.4f of v", j + 1, factor);
        ck_assert_msg(unexplained < slack, "joint %zu: %.4f of dq/dt is not v", j + 1, unexplained);
    }
}

// Correlation of torque with a reference: the sign of the torque column.
double correlation(const std::vector<double> &a, const std::vector<double> &b)
{
    double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        ma += a[i] / static_cast<double>(a.size()), mb += b[i] / static_cast<double>(a.size());
    for (std::size_t i = 0; i < a.size(); ++i)
        aa += (a[i] - ma) * (a[i] - ma), bb += (b[i] - mb) * (b[i] - mb), ab += (a[i] - ma) * (b[i] - mb);
    return ab / std::sqrt(aa * bb);
}

START_TEST(test_ur5_runs_in_radians_with_torque_that_holds_the_arm_up)
{
    const std::string path = data_path("ur5_nist_one_run/ur5_halfspeed_payload1.6lb_1.csv");
    if (path.empty())
        HDT_SKIP("no UR5 data under HDT_DATA");
    Run run = hdt::convert_run("model/imports/ur5_nist.toml", path);
    ck_assert_uint_eq(run.rows(), 7906);
    ck_assert_uint_eq(run.joint.size(), 6);
    ck_assert_double_eq_tol(run.t_s[1000] - run.t_s[0], 8.0, 1e-6); /* 125 Hz */
    // x of the wrist in the shoulder's plane by the DH table (a2, a3 negative); joint 2 turns about
    // -y there, so holding a load at +x takes positive torque
    std::vector<double> reach;
    for (std::size_t i = 0; i < run.rows(); ++i)
        reach.push_back(-0.425 * std::cos(run.joint[1].q_rad[i]) -
                        0.392 * std::cos(run.joint[1].q_rad[i] + run.joint[2].q_rad[i]));
    ck_assert_double_gt(correlation(reach, run.joint[1].tau_nm), 0.8);
    run.joint.resize(5); /* the last joint stands still, its velocity is noise */
    assert_velocities(run, 0.02);
}
END_TEST

START_TEST(test_panda_comes_in_from_files_of_one_value_a_line)
{
    const std::string path = data_path("panda_gaz2019");
    if (path.empty())
        HDT_SKIP("no Panda data under HDT_DATA");
    const Run run = hdt::convert_run("model/imports/panda_gaz.toml", path);
    ck_assert_uint_eq(run.rows(), 20544);
    ck_assert_uint_eq(run.joint.size(), 7);
    ck_assert_str_eq(run.constants.at("torque_side").c_str(), "link sensor");
    ck_assert_double_eq(run.joint[0].q_rad[0], -0.9584);
    ck_assert_double_eq(run.joint[1].q_rad[0], 0.5622);
    ck_assert_double_eq(run.joint[2].tau_nm[0], -12.3612);
    assert_velocities(run, 0.02);
    // reach of the wrist in front of the shoulder; joint 2 turns about +y there, so holding a load
    // at +x takes negative torque
    std::vector<double> reach;
    for (std::size_t i = 0; i < run.rows(); ++i) {
        const double q2 = run.joint[1].q_rad[i], q3 = run.joint[2].q_rad[i], q4 = run.joint[3].q_rad[i];
        reach.push_back(0.316 * std::sin(q2) + 0.384 * (std::sin(q2) * std::cos(q4) -
                                                        std::cos(q2) * std::cos(q3) * std::sin(q4)));
    }
    ck_assert_double_lt(correlation(reach, run.joint[1].tau_nm), -0.8);
}
END_TEST

const char *const kinova_files[] = {
    "identification_data/RecordTrajectory_quadratic.csv", "identification_data/RunTrajectory1.csv",
    "identification_data/Trajectory1.csv", "jointwise_motion/joint_2_trapez.csv",
    "jointwise_motion/joint_5_trapez.csv", "validation_data/opti_traj_testing1.csv",
    "validation_data/opti_traj_testing2.csv"};

START_TEST(test_kinova_runs_come_in_without_their_spoilt_end)
{
    const std::string path = data_path("kinova_gen3_dynamapp");
    if (path.empty())
        HDT_SKIP("no Kinova data under HDT_DATA");
    Run run = hdt::convert_run("model/imports/kinova_gen3.toml", path + "/" + kinova_files[_i]);
    ck_assert_uint_gt(run.rows(), 1900);
    ck_assert_uint_eq(run.joint.size(), 7);
    for (const Run::Joint &joint : run.joint) {
        ck_assert_uint_eq(joint.aref_radps2.size(), run.rows());
        for (std::size_t i = 0; i < run.rows(); ++i) {
            ck_assert_double_lt(std::fabs(joint.aref_radps2[i]), 50);
            ck_assert_double_lt(std::fabs(joint.qref_rad[i] - joint.q_rad[i]), 0.1);
        }
    }
    ck_assert_uint_eq(run.extra.count("tau_sensor7_nm"), 1);
    if (_i == 3)
        run.joint = {run.joint[1]}; /* one joint moves, the others hold */
    if (_i == 4)
        run.joint = {run.joint[4]};
    assert_velocities(run, 0.02);
}
END_TEST

START_TEST(test_schunk_run_ends_with_its_shortest_file)
{
    const std::string path = data_path("schunk_lwa4p_tum/measurement_1");
    if (path.empty())
        HDT_SKIP("no Schunk data under HDT_DATA");
    const Run run = hdt::convert_run("model/imports/schunk_lwa4p.toml", path);
    ck_assert_uint_eq(run.rows(), 936);
    ck_assert_uint_eq(run.joint.size(), 6);
    ck_assert_double_eq(run.joint[5].q_rad[0], -0.76845);
    ck_assert_double_eq(run.joint[0].v_radps[0], 0.030425);
    ck_assert_double_eq(run.joint[0].tau_nm[1], 3.4825);
    assert_velocities(run, 0.1);
}
END_TEST

} // namespace

static Suite *import_suite(void)
{
    Suite *s = suite_create("import");
    TCase *map = tcase_create("map");
    tcase_add_test(map, test_scale_offset_and_sign_are_applied_in_that_meaning);
    tcase_add_test(map, test_numbered_family_takes_names_numbers_and_lists_per_joint);
    tcase_add_test(map, test_byte_order_mark_quotes_and_blank_lines_are_no_obstacle);
    tcase_add_test(map, test_files_of_one_value_a_line_are_put_in_rows);
    tcase_add_test(map, test_rows_a_map_leaves_out_may_be_bad_and_no_others);
    suite_add_tcase(s, map);
    TCase *refuse = tcase_create("refuse");
    tcase_set_timeout(refuse, 60);
    tcase_add_loop_test(refuse, test_bad_map_is_refused_with_line_and_key, 0,
                        sizeof bad_maps / sizeof *bad_maps);
    tcase_add_test(refuse, test_missing_column_names_the_nearest_ones);
    tcase_add_test(refuse, test_bad_foreign_table_is_refused_with_its_line);
    tcase_add_test(refuse, test_random_edits_of_map_and_table_end_in_a_run_or_one_line);
    suite_add_tcase(s, refuse);
    TCase *measured = tcase_create("measured");
    tcase_set_timeout(measured, 60);
    tcase_add_test(measured, test_ur5_runs_in_radians_with_torque_that_holds_the_arm_up);
    tcase_add_test(measured, test_panda_comes_in_from_files_of_one_value_a_line);
    tcase_add_loop_test(measured, test_kinova_runs_come_in_without_their_spoilt_end, 0,
                        sizeof kinova_files / sizeof *kinova_files);
    tcase_add_test(measured, test_schunk_run_ends_with_its_shortest_file);
    suite_add_tcase(s, measured);
    return s;
}

HDT_CHECK_MAIN(import_suite())
