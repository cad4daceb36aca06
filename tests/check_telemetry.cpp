// SPDX-License-Identifier: Apache-2.0
//
// Telemetry of a running loop as others read it: LCM's own library and player, `hdt top` in a pipe
// and on a terminal.
// Goal: what is published is what the loop did; logs play in lcm-logplayer; the terminal is given
// back as it was; no multicast is said with its remedy.
// Method: `hdt host` beside the emulated servo, LCM's file:// provider; liblcm and lcm-gen's code as
// the second reader.
#include <cstdio>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include <lcm/lcm.h>
#include <unistd.h>

#include "hdt_cycle_t.h"
#include "hdt_status_t.h"
#include "tests/check_main.h"
#include "tests/shell.hpp"

namespace {

void assert_holds(const Result &r, const std::string &text)
{
    ck_assert_msg(r.out.find(text) != std::string::npos, "expected \"%s\" in:\n%s", text.c_str(),
                  r.out.c_str());
}

// The loop for two seconds beside a servo, with further options.
Result loop(const std::string &options)
{
    return sh_together("rm -f bus run.lcm; "
                       "$H servo --arm $A --task lemniscate --bus unix:$PWD/bus --seconds 30 "
                       "2>/dev/null & s=$!; "
                       "for i in $(seq 300); do [ -S bus ] && break; sleep 0.1; done; "
                       "$H host --model $A --bus unix:$PWD/bus --out run.lcm " + options +
                       " >host 2>&1 & h=$!; "
                       "for i in $(seq 100); do "
                       "[ -s run.lcm.part ] && break; kill -0 $h 2>/dev/null || break; sleep 0.1; done; "
                       "sleep 2; kill -INT $h; wait $h; e=$?; kill $s; wait $s; cat host; exit $e");
}

// Every event of a log, decoded by LCM's own code.
struct Log {
    std::vector<hdt_status_t> status;              // their strings leak, in a test
    std::map<int64_t, std::vector<int32_t>> total; // by time, of a cycle
    unsigned runs = 0, tables = 0;
};

Log read_log(const std::string &name)
{
    Log all;
    lcm_eventlog_t *log = lcm_eventlog_create(scratch(name).c_str(), "r");
    ck_assert_ptr_nonnull(log);
    while (lcm_eventlog_event_t *e = lcm_eventlog_read_next_event(log)) {
        std::string channel = e->channel;
        hdt_status_t s;
        hdt_cycle_t c;
        if (channel == "HDT_STATUS" && hdt_status_t_decode(e->data, 0, e->datalen, &s) == e->datalen) {
            all.status.push_back(s);
        } else if (channel == "HDT_CYCLE" && hdt_cycle_t_decode(e->data, 0, e->datalen, &c) == e->datalen) {
            all.total[c.t_us] = std::vector<int32_t>(c.total_q16, c.total_q16 + c.joints);
            hdt_cycle_t_decode_cleanup(&c);
        } else if (channel == "HDT_RUN") {
            all.runs++;
        } else if (channel == "HDT_TABLES") {
            all.tables++;
        } else {
            ck_abort_msg("%s: another event, or not of its type", channel.c_str());
        }
        lcm_eventlog_free_event(e);
    }
    lcm_eventlog_destroy(log);
    return all;
}

} // namespace

START_TEST(test_what_is_published_is_what_the_loop_did)
{
    Result r = loop("--telemetry 'file://t.lcm?mode=w' --telemetry-rate 50");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    Log told = read_log("t.lcm"), logged = read_log("run.lcm");
    // cycles: a part of those logged, the same to the bit, some fifty a second
    ck_assert_uint_gt(told.total.size(), 60);
    ck_assert_uint_lt(told.total.size(), 150);
    ck_assert_uint_gt(logged.total.size(), 1000);
    for (const auto &[t_us, total] : told.total)
        if (logged.total.count(t_us) == 0 || logged.total[t_us] != total)
            ck_abort_msg("period at %lld us is not the log's", static_cast<long long>(t_us));
    ck_assert_uint_ge(told.runs, 2); // once a second, for those who come later
    // status: time and counts only grow, the end is told, and the counts are the log's
    ck_assert_uint_gt(told.status.size(), 20);
    bool moved = false;
    for (size_t k = 1; k < told.status.size(); k++) {
        const hdt_status_t &s = told.status[k], &before = told.status[k - 1];
        ck_assert(s.t_us >= before.t_us && s.periods >= before.periods);
        ck_assert(s.wake_p50_us <= s.wake_p99_us && s.wake_p99_us <= s.wake_worst_us);
        moved = moved || !std::strcmp(s.phase, "run") || !std::strcmp(s.phase, "approach");
    }
    ck_assert(moved);
    const hdt_status_t &last = told.status.back();
    ck_assert_str_eq(last.arm, "pa10");
    ck_assert_str_eq(last.phase, "done");
    ck_assert_msg(std::strstr(last.why, "brakes on") != nullptr, "%s", last.why);
    ck_assert_int_eq(last.periods, static_cast<int64_t>(logged.total.size()));
    ck_assert(last.work_p50_us > 0.1);
    ck_assert(last.period_us > 1428.57 && last.period_us < 1428.58);
}
END_TEST

START_TEST(test_logs_play_in_lcm_logplayer_and_replay_from_what_it_wrote)
{
    Result r = loop("");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    // ten times as fast as they were logged, at once and not after the host's uptime
    r = sh_together("timeout 10 lcm-logplayer --speed=10 --lcm-url='file://played.lcm?mode=w' run.lcm && "
                    "$H replay played.lcm --model $A");
    ck_assert_msg(r.code == 0, "%d: %s", r.code, r.out.c_str());
    assert_holds(r, " 0 differ");
    ck_assert_uint_eq(read_log("played.lcm").total.size(), read_log("run.lcm").total.size());
}
END_TEST

START_TEST(test_top_prints_lines_in_a_pipe_and_a_page_on_a_terminal)
{
    Result r = loop("--telemetry 'file://t.lcm?mode=w'");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    r = sh_together("timeout 20 $H top --lcm 'file://t.lcm?speed=1' | cat");
    assert_holds(r, " Hz  wake p99 ");
    assert_holds(r, "torque N m");
    assert_holds(r, "done: brakes on; asked for");
    ck_assert_msg(r.out.find('\033') == std::string::npos, "%s", r.out.c_str());
    // a log without status says nothing, and that is the answer no
    ck_assert_int_eq(sh("timeout 20 $H top --lcm 'file://run.lcm?speed=0'").code, 1);
    if (sh("command -v script").code != 0)
        HDT_SKIP("no script(1), which makes a terminal: install bsdutils");
    r = sh_together("timeout 20 script -qec \"timeout -s INT 1 $H top --lcm 'file://t.lcm?speed=0.5'\" tty "
                    ">/dev/null; cat tty");
    const size_t open = r.out.find("\033[?1049h"), close = r.out.rfind("\033[?1049l");
    ck_assert_msg(open != std::string::npos && close != std::string::npos && open < close, "%s",
                  r.out.c_str());
    for (const char *text : {"hdt top   pa10", "rate ", "wake-up p50", "friction", "measured", "fault -"}) {
        size_t at = r.out.find(text);
        ck_assert_msg(at != std::string::npos && at > open && at < close, "no \"%s\" on the page: %s", text,
                      r.out.c_str());
    }
    // after Ctrl-C: cursor, wrapping and the other page
    ck_assert(r.out.find("\033[?25h") > open && r.out.find("\033[?7h") > open);
}
END_TEST

START_TEST(test_top_reads_a_loop_over_multicast)
{
    // a network of its own, with multicast on lo as the message says
    const std::string net =
        "timeout 30 unshare -n sh -c \"ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo; ";
    if (geteuid() != 0 || sh(net + "ip route | grep -q 224\"").code != 0)
        HDT_SKIP("a network namespace needs root and iproute2: multicast is not tried");
    Result r = sh_together(net + "$H servo --arm $A --task lemniscate --bus unix:$PWD/bus --seconds 20 "
                           "2>/dev/null & sleep 2; "
                           "$H host --model $A --bus unix:$PWD/bus --out run.lcm --telemetry "
                           ">/dev/null 2>&1 & $H top --seconds 8\"");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    assert_holds(r, "torque N m");
}
END_TEST

START_TEST(test_no_multicast_is_said_with_its_remedy)
{
    Result r = sh_together("timeout 10 $H top --lcm nonsense://");
    ck_assert_int_eq(r.code, 3);
    assert_holds(r, "LCM cannot be opened at nonsense://");
    r = loop("--telemetry nonsense://");
    ck_assert_int_eq(r.code, 3);
    assert_holds(r, "ip link set lo multicast on");
    ck_assert_int_eq(sh("test -e run.lcm || test -e run.lcm.part").code, 1);
    if (geteuid() != 0 || sh("unshare -n true").code != 0)
        HDT_SKIP("a network namespace needs root: a machine without multicast is not tried");
    r = sh_together("timeout 20 unshare -n $H top");
    ck_assert_int_eq(r.code, 3);
    assert_holds(r, "ip route add 224.0.0.0/4 dev lo");
}
END_TEST

static Suite *telemetry_suite(void)
{
    Suite *s = suite_create("telemetry");
    TCase *t = tcase_create("telemetry");
    tcase_set_timeout(t, 240);
    tcase_add_test(t, test_what_is_published_is_what_the_loop_did);
    tcase_add_test(t, test_logs_play_in_lcm_logplayer_and_replay_from_what_it_wrote);
    tcase_add_test(t, test_top_prints_lines_in_a_pipe_and_a_page_on_a_terminal);
    tcase_add_test(t, test_top_reads_a_loop_over_multicast);
    tcase_add_test(t, test_no_multicast_is_said_with_its_remedy);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(telemetry_suite())
