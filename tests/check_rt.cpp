// SPDX-License-Identifier: Apache-2.0
//
// `hdt host` as a process beside the emulated servo, over a unix socket, in real time.
// Goal: after its start the control thread allocates nothing and makes no system call but those of
// sleep, clock and bus; signals, a silent operator and a dead servo end a run in order and in words.
// Method: tests/rt_shim.c loaded before the program; a probe shows that the shim catches.
// A machine that stalls for 30 periods faults a run, rightly: it is done again, twice at most.
#include <cstdio>
#include <string>

#include <unistd.h>

#include "tests/check_main.h"
#include "tests/shell.hpp"

namespace {

// With a servo standing where the task starts; the last command's exit code.  A loaded machine takes its
// time to start a program, so a line waits for what it needs: `said TEXT` until the host has written that
// into the file host, `runs` until its log has rows.
Result with_servo(const std::string &line)
{
    return sh_together("rm -f bus host x.*; "
                       "waits() { for i in $(seq 300); do \"$@\" 2>/dev/null && return; sleep 0.1; done; "
                       "echo \"never: $*\"; }; "
                       "said() { waits grep -q \"$1\" host; }; "
                       "runs() { waits test -s x.csv.part; sleep 0.5; }; "
                       "$H servo --arm $A --task lemniscate --bus unix:$PWD/bus --seconds 100 2>servo & "
                       "s=$!; waits test -S bus; " + line +
                       "; c=$?; kill $s 2>/dev/null; wait $s; cat host servo; exit $c");
}

Result three_times(const std::string &line)
{
    Result r{};
    for (int n = 0; n < 3; n++) {
        r = with_servo(line);
        if (r.out.find("fault") == std::string::npos)
            break;
    }
    return r;
}

void assert_holds(const Result &r, const char *text)
{
    ck_assert_msg(r.out.find(text) != std::string::npos, "expected \"%s\" in:\n%s", text, r.out.c_str());
}

const char *const host = "$SHIM $H host --operator --model $A --bus unix:$PWD/bus --out x.lcm >host 2>&1";

unsigned long sleeps_of(const Result &r)
{
    unsigned long n = 0;
    size_t at = r.out.find("rt_shim: ");
    if (at != std::string::npos)
        std::sscanf(r.out.c_str() + at, "rt_shim: %lu", &n);
    return n;
}

} // namespace

START_TEST(test_the_shim_catches_an_allocation_and_a_system_call)
{
    Result r = sh_together("$SHIM $P nothing");
    if (r.code == 98)
        HDT_SKIP("this kernel has no seccomp filters: the control thread's calls cannot be watched");
    ck_assert_int_eq(r.code, 0);
    assert_holds(r, "rt_shim: 10 sleeps, 0 allocations");
    r = sh_together("$SHIM $P malloc");
    assert_holds(r, "rt_shim: 10 sleeps, 2 allocations");
    r = sh_together("$SHIM $P open");
    ck_assert_int_eq(r.code, 97);
    assert_holds(r, "the control thread made system call ");
}
END_TEST

START_TEST(test_the_control_thread_allocates_nothing_and_calls_only_sleep_clock_and_bus)
{
    Result r = three_times(std::string("(said ready:; echo go; said run:; sleep 1; echo hold; said hold:; "
                                       "sleep 1; echo go; sleep 0.3; echo stop; said done:) | ") +
                           host);
    if (r.code == 98)
        HDT_SKIP("this kernel has no seccomp filters: the control thread's calls cannot be watched");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    assert_holds(r, " 0 allocations");
    ck_assert_msg(sleeps_of(r) > 1000, "%s", r.out.c_str());
    assert_holds(r, "hold: standing at sample");
    assert_holds(r, "done: brakes on; asked for");
    assert_holds(r, "wake-up  p50");
    assert_holds(r, "log dropped 0");
    ck_assert_int_eq(sh("$H replay x.lcm --model $A").code, 0);
}
END_TEST

START_TEST(test_a_servo_that_comes_back_is_taken_up_without_an_allocation)
{
    // gone and back: a stale fault, cleared by the operator
    Result r = with_servo("(said ready:; kill $s; said fault:; rm -f bus; "
                          "$H servo --arm $A --task lemniscate --bus unix:$PWD/bus --seconds 30 "
                          "2>/dev/null & "
                          "n=$!; said fault:; sleep 0.5; waits test -S bus; sleep 0.5; echo clear; "
                          "waits sh -c '[ $(grep -c ready: host) = 2 ]'; echo stop; said done:; kill $n) | " +
                          std::string(host));
    if (r.code == 98)
        HDT_SKIP("this kernel has no seccomp filters: the control thread's calls cannot be watched");
    ck_assert_msg(r.code == 0, "%s", r.out.c_str());
    assert_holds(r, "fault: stale: no state from the servo for more than");
    assert_holds(r, " 0 allocations");
    size_t fault = r.out.find("fault: stale"), ready = r.out.rfind("ready:");
    ck_assert_msg(ready != std::string::npos && ready > fault, "%s", r.out.c_str());
}
END_TEST

START_TEST(test_signals_and_a_gone_operator_end_with_brakes_on)
{
    for (const char *how :
         {"$H host --model $A --bus unix:$PWD/bus --out x.csv >host 2>&1 & h=$!; runs; kill -INT $h; wait $h",
          "$H host --model $A --bus unix:$PWD/bus --out x.csv >host 2>&1 & h=$!; runs; "
          "kill -TERM $h; wait $h",
          "said ready: | $H host --operator --model $A --bus unix:$PWD/bus --out x.csv >host 2>&1"}) {
        Result r = three_times(how);
        ck_assert_msg(r.code == 0, "%s: %d: %s", how, r.code, r.out.c_str());
        // an end that the servo did not confirm would be said
        assert_holds(r, "periods of 1.4286 ms");
        ck_assert_msg(r.out.find("confirm") == std::string::npos, "%s", r.out.c_str());
        ck_assert_int_eq(sh("test -s x.csv && ! test -e x.csv.part").code, 0);
    }
}
END_TEST

START_TEST(test_a_servo_that_dies_is_a_stale_fault_in_words)
{
    Result r = with_servo("$H host --model $A --bus unix:$PWD/bus --out x.csv >host 2>&1 & h=$!; "
                          "runs; kill -KILL $s; wait $h");
    ck_assert_int_eq(r.code, 1);
    assert_holds(r, "faulted: stale: no state from the servo for more than");
    assert_holds(r, "did not confirm the end");
}
END_TEST

START_TEST(test_options_that_cannot_be_are_refused)
{
    static const char *const bad[][2] = {{"--overrun never", "expected count, hold or stop"},
                                         {"--follow-bus 1500", "less than the period of 1428 us"},
                                         {"--follow-bus 300", "does not say when a telegram came"}};
    for (const auto &[option, words] : bad) {
        Result r = with_servo(std::string("$H host --model $A --bus unix:$PWD/bus --out x.csv >host 2>&1 ") +
                              option);
        ck_assert_int_eq(r.code, 2);
        assert_holds(r, words);
    }
    ck_assert_int_eq(sh("$H host --model $A --bus unix:$PWD/bus --out x.csv --priority 100").code, 2);
    Result held = sh("$H host --model $A --bus unix:$PWD/bus --out x.csv --overrun hold");
    ck_assert_int_eq(held.code, 2);
    ck_assert_msg(held.err.find("expected --operator with it, or count or stop") != std::string::npos, "%s",
                  held.err.c_str());
    // a processor that is not there is said, and the run goes on
    Result r = three_times("$H host --model $A --bus unix:$PWD/bus --out x.csv --cpu 1000 >host 2>&1 & h=$!; "
                           "runs; kill -INT $h; wait $h");
    ck_assert_int_eq(r.code, 0);
    assert_holds(r, "not bound to the processor");
}
END_TEST

static Suite *rt_suite(void)
{
    Suite *s = suite_create("rt");
    TCase *t = tcase_create("host process");
    tcase_set_timeout(t, 240);
    tcase_add_test(t, test_the_shim_catches_an_allocation_and_a_system_call);
    tcase_add_test(t, test_the_control_thread_allocates_nothing_and_calls_only_sleep_clock_and_bus);
    tcase_add_test(t, test_a_servo_that_comes_back_is_taken_up_without_an_allocation);
    tcase_add_test(t, test_signals_and_a_gone_operator_end_with_brakes_on);
    tcase_add_test(t, test_a_servo_that_dies_is_a_stale_fault_in_words);
    tcase_add_test(t, test_options_that_cannot_be_are_refused);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(rt_suite())
