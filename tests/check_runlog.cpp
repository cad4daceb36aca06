// SPDX-License-Identifier: Apache-2.0
//
// The CSV log: every rule of the contract refused with its place, and what is written reads back
// as the same bits.
//
// Method: each bad file is a good one with a single thing spoilt; the message is compared in full
// where its words are the interface (file, line, column), else by its parts.
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>

#include <sys/stat.h>
#include <unistd.h>

#include "model/log.hpp"
#include "tests/check_main.h"
#include "tests/scratch.hpp"

namespace {

using hdt::InputError;
using hdt::Run;

std::string put(const std::string &bytes, const char *name = "run.csv")
{
    const std::string path = scratch(name);
    FILE *file = std::fopen(path.c_str(), "wb");
    ck_assert_ptr_nonnull(file);
    ck_assert_uint_eq(std::fwrite(bytes.data(), 1, bytes.size(), file), bytes.size());
    std::fclose(file);
    return path;
}

std::string error_of(const std::string &path)
{
    try {
        hdt::read_run(path);
    } catch (const InputError &error) {
        return error.what();
    }
    return "(accepted)";
}

// The message for these bytes, less the path in front; one line, always naming the file.
std::string refusal(const std::string &bytes)
{
    const std::string path = put(bytes);
    const std::string text = error_of(path);
    ck_assert_msg(text.compare(0, path.size(), path) == 0, "no file in: %s", text.c_str());
    ck_assert_msg(text.find('\n') == std::string::npos, "two lines: %s", text.c_str());
    return text.substr(path.size());
}

void assert_has(const std::string &text, const char *part)
{
    ck_assert_msg(text.find(part) != std::string::npos, "no \"%s\" in: %s", part, text.c_str());
}

void assert_begins(const std::string &text, const char *part)
{
    ck_assert_msg(text.compare(0, std::strlen(part), part) == 0, "not \"%s\" first in: %s", part,
                  text.c_str());
}

const char good[] = "# format = hdt-log\n"
                    "# version = 1\n"
                    "# payload_kg = 2.5\n"
                    "# payload_com_m = 0 0.01 0.07\n"
                    "# a remark\n"
                    "t_s,q1_rad,tau1_nm\n"
                    "0,1,2\n"
                    "0.5,1.25,-3e-2\n"
                    "2,+1.5,4\n";

START_TEST(test_good_run_reads_as_written)
{
    const Run run = hdt::read_run(put(good));
    ck_assert_uint_eq(run.rows(), 3);
    ck_assert_uint_eq(run.joint.size(), 1);
    ck_assert(run.joint[0].present);
    ck_assert_double_eq(run.t_s[1], 0.5);
    ck_assert_double_eq(run.joint[0].q_rad[2], 1.5);
    ck_assert_double_eq(run.joint[0].tau_nm[1], -0.03);
    ck_assert(run.joint[0].v_radps.empty());
    ck_assert_double_eq(run.constant("payload_kg", 0), 2.5);
    ck_assert_double_eq(run.constant("absent", 7), 7);
    const auto com = run.constant_vector("payload_com_m");
    ck_assert_uint_eq(com.size(), 3);
    ck_assert_double_eq(com[1], 0.01);
    ck_assert(run.constant_vector("absent").empty());
    ck_assert_uint_eq(run.constants.size(), 2);
}
END_TEST

START_TEST(test_irregular_time_and_missing_joints_are_normal)
{
    const Run run = hdt::read_run(put("v3_radps,temp3_degc,tau3_nm,t_s,q3_rad,q1_rad,gravity3_nm\n"
                                      "1,20,3,-1,5,6,7\n"
                                      "2,21,4,1e-9,6,7,8\n"
                                      "3,22,5,400,7,8,9\n"));
    ck_assert_uint_eq(run.joint.size(), 3);
    ck_assert(!run.joint[0].present && !run.joint[1].present && run.joint[2].present);
    ck_assert_double_eq(run.joint[0].q_rad[1], 7); /* a position without torque still poses the arm */
    ck_assert(run.joint[1].q_rad.empty());
    ck_assert_double_eq(run.joint[2].v_radps[0], 1);
    ck_assert_double_eq(run.joint[2].temp_degc[2], 22);
    ck_assert_double_eq(run.extra.at("gravity3_nm")[2], 9);
    ck_assert_double_eq(run.t_s[2], 400);
}
END_TEST

START_TEST(test_every_known_column_lands_in_its_own_place)
{
    const Run run = hdt::read_run(put("t_s,q1_rad,tau1_nm,v1_radps,qref1_rad,vref1_radps,"
                                      "aref1_radps2,temp1_degc,q16_rad\n0,1,2,3,4,5,6,7,8\n"));
    const Run::Joint &j = run.joint[0];
    ck_assert_double_eq(j.q_rad[0], 1);
    ck_assert_double_eq(j.tau_nm[0], 2);
    ck_assert_double_eq(j.v_radps[0], 3);
    ck_assert_double_eq(j.qref_rad[0], 4);
    ck_assert_double_eq(j.vref_radps[0], 5);
    ck_assert_double_eq(j.aref_radps2[0], 6);
    ck_assert_double_eq(j.temp_degc[0], 7);
    ck_assert_double_eq(run.joint[15].q_rad[0], 8);
    ck_assert(run.extra.empty());
}
END_TEST

START_TEST(test_line_ends_and_byte_order_mark_change_nothing)
{
    std::string crlf = "\xef\xbb\xbf";
    for (const char c : std::string(good))
        crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
    const Run run = hdt::read_run(put(crlf));
    ck_assert_uint_eq(run.rows(), 3);
    ck_assert_double_eq(run.joint[0].tau_nm[2], 4);
    ck_assert_double_eq(run.constant("payload_kg", 0), 2.5);
    // the line number still counts
    crlf.replace(crlf.rfind("4\r"), 1, "x");
    assert_begins(refusal(crlf), ":9: column 'tau1_nm'");
}
END_TEST

struct Bad { const char *bytes, *begins, *has; };

const Bad bad_rows[] = {
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,nan,2\n", ":3: column 'q1_rad': expected a finite number, found 'nan'",
     ""},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1,-inf\n", ":3: column 'tau1_nm'", "'-inf'"},
    {"t_s,q1_rad,tau1_nm\n0,1,1e999\n", ":2: column 'tau1_nm'", "1e999"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1,\n", ":3: column 'tau1_nm'", "found ''"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,0x1p3,2\n", ":3: column 'q1_rad'", "0x1p3"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1.5.2,2\n", ":3: column 'q1_rad'", "1.5.2"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,+-1,2\n", ":3: column 'q1_rad'", "+-1"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1 2,2\n", ":3: column 'q1_rad'", "'1 2'"},
    {"t_s,q1_rad,tau1_nm\n5,1,2\n4.5,1,2\n", ":3: column 't_s'",
     "more than 5 s of the row before, found 4.5 s"},
    {"q1_rad,tau1_nm,t_s\n1,2,5\n1,2,5\n", ":3: column 't_s'", "time must advance"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1\n", ":3: expected 3 fields as in the header, found 2", ""},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1\n", ":3: expected 3 fields as in the header, found 1", ""},
    {"t_s,q1_rad,tau1_nm\n0,1,2,9\n", ":2: expected 3 fields as in the header, found more", ""},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n\n1,1,2\n", ":3: expected a row of numbers, found an empty line", ""},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n# payload_kg = 1\n1,1,2\n", ":3:", "constants go before the header"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1,2", ":3: the file ends inside a line", "end it with a newline"},
    {"t_s,q1_rad,tau1_nm\n0,1,2\n1,1", ":3: the file ends inside a line", "cut short"},
    {"t_s,q1_rad,tau1_nm\n", ": expected rows of numbers after the header, found none", ""},
    {"t_s,q1_rad,tau1_nm", ":1: expected rows of numbers", "end of the file"},
};

START_TEST(test_bad_row_is_refused_with_its_line)
{
    const std::string text = refusal(bad_rows[_i].bytes);
    assert_begins(text, bad_rows[_i].begins);
    assert_has(text, bad_rows[_i].has);
}
END_TEST

const Bad bad_heads[] = {
    {"", ": expected a header row", "empty file"},
    {"\n\n# k = 1\n", ": expected a header row", "no header"},
    {"t_s,q1_deg,tau1_nm\n0,1,2\n", ":1: column 'q1_deg': expected 'q1_rad', found unit '_deg'", "map"},
    {"t_s,q1_rad,tau1_Nm\n0,1,2\n", ":1: column 'tau1_Nm': expected 'tau1_nm'", ""},
    {"t_s,q1_rad,tau1\n0,1,2\n", ":1: column 'tau1': expected 'tau1_nm', found unit ''", ""},
    {"t_s,q1_rad,tau1_nm,v1_rpm\n0,1,2,3\n", ":1: column 'v1_rpm': expected 'v1_radps'", ""},
    {"t_s,q1_rad,tau1_nm,aref1_radps\n0,1,2,3\n", ":1: column 'aref1_radps': expected 'aref1_radps2'", ""},
    {"t_s,q1_rad,tau1_nm,temp1_k\n0,1,2,3\n", ":1: column 'temp1_k': expected 'temp1_degc'", ""},
    {"t_s,q0_rad,tau0_nm\n0,1,2\n", ":1: column 'q0_rad': expected a joint number from 1 to 16", ""},
    {"t_s,q17_rad,tau17_nm\n0,1,2\n", ":1: column 'q17_rad': expected a joint number", "'17'"},
    {"t_s,q01_rad,tau1_nm\n0,1,2\n", ":1: column 'q01_rad': expected a joint number", ""},
    {"t_s,q4294967297_rad,tau1_nm\n0,1,2\n", ":1: column 'q4294967297_rad'", ""},
    {"q1_rad,tau1_nm\n1,2\n", ":1: expected a column 't_s'", "q1_rad,tau1_nm"},
    {"t_ms,q1_rad,tau1_nm\n0,1,2\n", ":1: column 't_ms': expected 't_s'", "'ms'"},
    {"t_s,q1_rad,tau1_nm,q1_rad\n0,1,2,3\n", ":1: column 'q1_rad' is given twice", ""},
    {"t_s,q1_rad,tau1_nm,t_s\n0,1,2,3\n", ":1: column 't_s' is given twice", ""},
    {"t_s,q1_rad,,tau1_nm\n0,1,2,3\n", ":1: expected a column name in field 3, found nothing", ""},
    {"t_s,q1_rad,tau2_nm\n0,1,2\n", ":1: expected at least one joint with both", ""},
    {"t_s,foo\n0,1\n", ":1: expected at least one joint with both", "found none"},
    {"# payload_kg = 2 kg\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":1: constant 'payload_kg': expected 1 number, found '2 kg'", ""},
    {"# k = 1\n# payload_lb = 4.4\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":2: constant 'payload_lb': expected 'payload_kg', found unit 'lb'", "convert"},
    {"# payload_g = 4400\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload_g'", "found unit 'g'"},
    {"# payload = 4\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload'", "found no unit"},
    {"# payload_com_mm = 0 0 70\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload_com_mm'",
     "expected 'payload_com_m'"},
    {"# payload_kg = -1\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":1: constant 'payload_kg': expected 1 number, 0 to 1000, found '-1'", ""},
    {"# payload_kg = 1e30\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload_kg'", "found '1e30'"},
    {"# payload_com_m = 0 0 70\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload_com_m'", "-10 to 10"},
    {"# ratio2 = abc\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'ratio2': expected 1 number", "'abc'"},
    {"# ratio2 = 0\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'ratio2'", "found '0'"},
    {"# payload_kg = nan\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":1: constant 'payload_kg'", "'nan'"},
    {"# x = 1\n# payload_com_m = 0 0\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":2: constant 'payload_com_m': expected 3 numbers", ""},
    {"# payload_com_m = 0 0 0 1\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":1: constant 'payload_com_m': expected 3 numbers", ""},
    {"# format = hdt-log\n# version = 2\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":2: log version: this program reads '1', found '2'", ""},
    {"# format = hdt-arm\nt_s,q1_rad,tau1_nm\n0,1,2\n",
     ":1: log format: this program reads 'hdt-log', found 'hdt-arm'", ""},
    {"# x = 1\n# x = 2\nt_s,q1_rad,tau1_nm\n0,1,2\n", ":2: constant 'x' is given twice", ""},
};

START_TEST(test_bad_head_is_refused_with_its_line)
{
    const std::string text = refusal(bad_heads[_i].bytes);
    assert_begins(text, bad_heads[_i].begins);
    assert_has(text, bad_heads[_i].has);
}
END_TEST

START_TEST(test_zero_byte_is_no_text_file)
{
    assert_begins(refusal(std::string("t_s,q1_rad,tau1_nm\n0,1,\0\n", 26)), ": expected a text file");
}
END_TEST

START_TEST(test_event_log_is_called_by_its_name)
{
    assert_has(refusal(std::string("\xed\xa1\xda\x01\0\0\0\0\0\0\0\0", 12)), "LCM event log");
}
END_TEST

START_TEST(test_unreadable_paths_say_why)
{
    assert_has(error_of(scratch("absent.csv")), "No such file");
    ck_assert_int_eq(mkdir(scratch("dir.csv").c_str(), 0700), 0);
    assert_has(error_of(scratch("dir.csv")), "directory");
    assert_has(error_of("/dev/zero"), "zero byte");
}
END_TEST

START_TEST(test_messages_never_carry_raw_bytes)
{
    const std::string text = refusal("t_s,q1_rad,tau1_nm\n0,\x1b[31m\xff,2\n");
    assert_has(text, "\\x1b[31m\\xff");
    for (const char c : text)
        ck_assert(c >= 0x20 && c < 0x7f);
    ck_assert_uint_lt(refusal("t_s,q1_rad," + std::string(100000, 'q') + "\n0,1,2\n").size(), 200);
}
END_TEST

// No bytes crash it, and a cut file is never taken for the whole one.
START_TEST(test_truncation_anywhere_is_refused_or_ends_at_a_row)
{
    const std::string whole = good;
    for (std::size_t n = 0; n < whole.size(); ++n) {
        const std::string text = error_of(put(whole.substr(0, n)));
        if (text == "(accepted)")
            ck_assert_msg(whole[n - 1] == '\n', "cut after %zu bytes was taken", n);
        else
            assert_has(text, "run.csv");
    }
}
END_TEST

START_TEST(test_random_bytes_and_edits_end_in_a_run_or_one_line)
{
    uint64_t seed = 20260101;
    const char alphabet[] = "0123456789,.-+e\n\r\t #=tqs_radnmu\"\xef\xbb\xbf\x80\xff";
    for (int trial = 0; trial < 4000; ++trial) {
        std::string bytes = trial % 2 ? good : "";
        const int edits = 1 + static_cast<int>(test_random(&seed) % 12);
        for (int e = 0; e < edits; ++e) {
            const std::size_t at = test_random(&seed) % (bytes.size() + 1);
            const char c = alphabet[test_random(&seed) % (sizeof alphabet - 1)];
            if (test_random(&seed) % 3 == 0 && at < bytes.size())
                bytes.erase(at, 1);
            else
                bytes.insert(at, 1, c);
        }
        const std::string text = error_of(put(bytes));
        ck_assert_msg(text.find('\n') == std::string::npos, "trial %d: %s", trial, text.c_str());
    }
}
END_TEST

bool same_bits(const std::vector<double> &a, const std::vector<double> &b)
{
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0);
}

Run random_run(uint64_t *seed, std::size_t rows)
{
    const auto series = [&] {
        std::vector<double> out(rows);
        for (double &x : out)
            x = test_uniform(seed, -1, 1) * std::exp(test_uniform(seed, -300, 300));
        return out;
    };
    Run run;
    run.constants = {{"payload_kg", "0.1"}, {"task", "sweep, slow = yes"}};
    run.joint.resize(3);
    for (std::size_t r = 0; r < rows; ++r)
        run.t_s.push_back((r ? run.t_s.back() : -5) + test_uniform(seed, 1e-6, 1));
    run.joint[0].q_rad = series();
    run.joint[2] = {true, series(), series(), series(), series(), series(), series(), series()};
    run.extra["gravity3_nm"] = series();
    run.joint[2].q_rad[0] = -0.0;
    run.joint[2].q_rad[1] = 5e-324;
    run.joint[2].q_rad[2] = 1.7976931348623157e308;
    return run;
}

START_TEST(test_written_run_reads_back_bit_for_bit)
{
    uint64_t seed = 7;
    const Run run = random_run(&seed, 200);
    const std::string path = scratch("round.csv");
    hdt::write_run(path, run);
    const Run back = hdt::read_run(path);
    ck_assert(back.constants == run.constants);
    ck_assert(same_bits(back.t_s, run.t_s));
    ck_assert_uint_eq(back.joint.size(), 3);
    ck_assert(!back.joint[0].present && back.joint[2].present);
    ck_assert(same_bits(back.joint[0].q_rad, run.joint[0].q_rad));
    const Run::Joint &a = run.joint[2], &b = back.joint[2];
    ck_assert(same_bits(a.q_rad, b.q_rad) && same_bits(a.tau_nm, b.tau_nm));
    ck_assert(same_bits(a.v_radps, b.v_radps) && same_bits(a.qref_rad, b.qref_rad));
    ck_assert(same_bits(a.vref_radps, b.vref_radps) && same_bits(a.aref_radps2, b.aref_radps2));
    ck_assert(same_bits(a.temp_degc, b.temp_degc));
    ck_assert(same_bits(back.extra.at("gravity3_nm"), run.extra.at("gravity3_nm")));
    // and the text itself is settled: written again it is the same bytes
    const std::string again = scratch("again.csv");
    hdt::write_run(again, back);
    ck_assert(slurp(path) == slurp(again));
    assert_begins(slurp(path), "# format = hdt-log\n# version = 1\n# payload_kg = 0.1\n");
}
END_TEST

bool writes(const Run &run, const std::string &path)
{
    try {
        hdt::write_run(path, run);
    } catch (const InputError &) {
        return false;
    }
    return true;
}

START_TEST(test_what_could_not_be_read_is_not_written)
{
    uint64_t seed = 8;
    const Run run = random_run(&seed, 10);
    const std::string path = scratch("never.csv");
    Run bad[11];
    for (Run &b : bad)
        b = run;
    bad[0].joint[2].tau_nm[3] = std::nan("");
    bad[1].joint[2].tau_nm.pop_back();
    bad[2].t_s[5] = bad[2].t_s[4];
    bad[3].extra["a,b"] = bad[3].t_s;
    bad[4].extra["q3_deg"] = bad[4].t_s;
    bad[5].constants["note"] = "two\nlines";
    bad[6].constants["two words"] = "1";
    bad[7].joint[2].tau_nm.clear();
    bad[8] = Run();
    bad[9].constants["version"] = "1";
    bad[10] = Run();
    run_column(bad[10], "q1_rad");
    run_column(bad[10], "tau1_nm");
    for (const Run &b : bad)
        ck_assert(!writes(b, path));
    ck_assert_int_ne(access(path.c_str(), F_OK), 0);
    ck_assert(!writes(run, scratch("no/such/dir.csv")));
    // a full disk leaves nothing under the name
    if (access("/dev/full", W_OK) == 0)
        ck_assert(!writes(run, "/dev/full/run.csv"));
}
END_TEST

START_TEST(test_failed_rename_leaves_no_part_behind)
{
    uint64_t seed = 9;
    const std::string dir = scratch("taken.csv");
    ck_assert_int_eq(mkdir(dir.c_str(), 0700), 0);
    ck_assert(!writes(random_run(&seed, 10), dir));
    ck_assert_int_ne(access((dir + ".part" + std::to_string(getpid())).c_str(), F_OK), 0);
}
END_TEST

START_TEST(test_cut_takes_its_half_open_interval)
{
    Run run = hdt::read_run(put("t_s,q1_rad,tau1_nm,x\n0,1,2,3\n1,4,5,6\n2,7,8,9\n3,10,11,12\n"));
    const Run cut = hdt::cut_run(run, 1, 3);
    ck_assert_uint_eq(cut.rows(), 2);
    ck_assert_double_eq(cut.t_s[0], 1);
    ck_assert_double_eq(cut.joint[0].q_rad[1], 7);
    ck_assert_double_eq(cut.joint[0].tau_nm[0], 5);
    ck_assert_double_eq(cut.extra.at("x")[1], 9);
    ck_assert(cut.joint[0].v_radps.empty() && cut.joint[0].present);
    ck_assert_uint_eq(hdt::cut_run(run, -INFINITY, INFINITY).rows(), 4);
    const double empty[][2] = {{1.2, 1.8}, {3.5, 9}, {2, 2}, {2, 1}, {NAN, 1}, {0, NAN}, {-5, 0}};
    for (const auto &interval : empty) {
        bool refused = false;
        try {
            hdt::cut_run(run, interval[0], interval[1]);
        } catch (const InputError &error) {
            refused = true;
            assert_has(error.what(), "goes from 0 s to 3 s");
        }
        ck_assert(refused);
    }
}
END_TEST

START_TEST(test_constant_that_is_no_number_is_refused_when_asked_for)
{
    const Run run = hdt::read_run(put("# task = lemniscate\nt_s,q1_rad,tau1_nm\n0,1,2\n"));
    ck_assert_str_eq(run.constants.at("task").c_str(), "lemniscate");
    for (int vector = 0; vector < 2; ++vector) {
        bool refused = false;
        try {
            vector ? (void)run.constant_vector("task") : (void)run.constant("task", 0);
        } catch (const InputError &error) {
            refused = true;
            assert_has(error.what(), "constant 'task': expected");
        }
        ck_assert(refused);
    }
}
END_TEST

} // namespace

static Suite *runlog_suite(void)
{
    Suite *s = suite_create("runlog");
    TCase *read = tcase_create("read");
    tcase_add_test(read, test_good_run_reads_as_written);
    tcase_add_test(read, test_irregular_time_and_missing_joints_are_normal);
    tcase_add_test(read, test_every_known_column_lands_in_its_own_place);
    tcase_add_test(read, test_line_ends_and_byte_order_mark_change_nothing);
    tcase_add_test(read, test_constant_that_is_no_number_is_refused_when_asked_for);
    suite_add_tcase(s, read);
    TCase *refuse = tcase_create("refuse");
    tcase_set_timeout(refuse, 60);
    tcase_add_loop_test(refuse, test_bad_row_is_refused_with_its_line, 0,
                        sizeof bad_rows / sizeof *bad_rows);
    tcase_add_loop_test(refuse, test_bad_head_is_refused_with_its_line, 0,
                        sizeof bad_heads / sizeof *bad_heads);
    tcase_add_test(refuse, test_zero_byte_is_no_text_file);
    tcase_add_test(refuse, test_event_log_is_called_by_its_name);
    tcase_add_test(refuse, test_unreadable_paths_say_why);
    tcase_add_test(refuse, test_messages_never_carry_raw_bytes);
    tcase_add_test(refuse, test_truncation_anywhere_is_refused_or_ends_at_a_row);
    tcase_add_test(refuse, test_random_bytes_and_edits_end_in_a_run_or_one_line);
    suite_add_tcase(s, refuse);
    TCase *write = tcase_create("write");
    tcase_add_test(write, test_written_run_reads_back_bit_for_bit);
    tcase_add_test(write, test_what_could_not_be_read_is_not_written);
    tcase_add_test(write, test_failed_rename_leaves_no_part_behind);
    tcase_add_test(write, test_cut_takes_its_half_open_interval);
    suite_add_tcase(s, write);
    return s;
}

HDT_CHECK_MAIN(runlog_suite())
