// SPDX-License-Identifier: Apache-2.0
//
// The plugin as a host meets it: the shared object by dlopen, its one symbol, and every call in
// every order, legal or not.
// Goal: a legal call does what its header says, an illegal one returns the error its header says,
// changes nothing and never crashes.
// Method: a table of states written down a second time, held against the plugin on every sequence
// of six calls and on long seeded walks with a bus; all public headers included as C++.
#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "ctrl/hdt.h"
#include "ctrl/hdt_q.h"
#include "ctrl/hdt_tables.h"
#include "driver/drv_cycle.h"
#include "driver/drv_host.h"
#include "driver/drv_log.h"
#include "driver/drv_telegram.h"
#include "driver/hdt_bus.h"
#include "driver/hdt_plugin.h"
#include "tests/check_main.h"
#include "tests/driver_rig.h"
#include "tests/shell.hpp"

namespace {

const struct hdt_plugin *p;
const struct hdt_plugin_bus *bus;
const struct hdt_plugin_host me = HDT_PLUGIN_HOST;
std::vector<uint8_t> image;

void load_plugin()
{
    std::string path = build_dir() + "/libhdt.so." + std::to_string(HDT_VERSION_MAJOR) + "." +
                       std::to_string(HDT_VERSION_MINOR) + "." + std::to_string(HDT_VERSION_PATCH);
    void *so = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    ck_assert_msg(so != nullptr, "%s", dlerror());
    p = static_cast<const hdt_plugin *>(dlsym(so, HDT_PLUGIN_SYMBOL));
    ck_assert_ptr_nonnull(p);
    ck_assert_ptr_ne(p, &hdt_plugin_entry); // the shared object's, not the one linked in
    bus = static_cast<const hdt_plugin_bus *>(p->extension(HDT_PLUGIN_EXT_BUS));
    ck_assert_ptr_nonnull(bus);
    image.resize(hdt_tables_size(DRV_AXES));
    ck_assert_uint_eq(hdt_tables_write(rig_tables(), image.data(), image.size()), image.size());
}

// A servo that answers on a unix socket, in a thread of its own.
struct Servo {
    std::string path;
    struct rig_servo rig = {};
    int quit = 0, mute = 0;
    pthread_t thread;

    Servo() : path(scratch("bus"))
    {
        char err[256];
        ck_assert_msg(hdt_bus_open(&rig.bus, ("unix:" + path).c_str(), HDT_BUS_SERVO, err, sizeof err) == 0,
                      "%s", err);
        ck_assert_int_eq(pthread_create(&thread, nullptr, serve, this), 0);
    }
    ~Servo()
    {
        __atomic_store_n(&quit, 1, __ATOMIC_RELEASE);
        pthread_join(thread, nullptr);
        hdt_bus_close(&rig.bus);
    }
    static void *serve(void *self)
    {
        Servo *s = static_cast<Servo *>(self);
        while (!__atomic_load_n(&s->quit, __ATOMIC_ACQUIRE)) {
            s->rig.mute = __atomic_load_n(&s->mute, __ATOMIC_ACQUIRE);
            rig_serve(&s->rig);
            usleep(50);
        }
        return nullptr;
    }
};

// What the header's table says, written down again.
struct Model {
    int state = HDT_PLUGIN_NONE;
    bool open = false;
};

enum Op {
    Create, Load, LoadBad, Info, Start, Step, Clear, Stop, Destroy,       // every sequence of these
    LoadNull, StepNull, OpenBad, Open, Period, PeriodNull, Counters, Restart, Close, Ops
};

// The code an operation has to return, and the model's next state.
int expected(Op op, Model &m)
{
    const bool none = m.state == HDT_PLUGIN_NONE, loaded = m.state == HDT_PLUGIN_LOADED,
               running = m.state == HDT_PLUGIN_RUNNING, idle = m.state == HDT_PLUGIN_CREATED || loaded;
    auto go = [&](bool legal, int next) {
        if (!legal)
            return static_cast<int>(HDT_PLUGIN_ERR_STATE);
        m.state = next;
        return static_cast<int>(HDT_OK);
    };
    switch (op) {
    case Create: return go(none, HDT_PLUGIN_CREATED);
    case Load: return go(idle && !m.open, HDT_PLUGIN_LOADED);
    case LoadBad:
        return go(idle && !m.open, HDT_PLUGIN_CREATED) == HDT_OK ? HDT_PLUGIN_ERR_IMAGE
                                                                 : HDT_PLUGIN_ERR_STATE;
    case LoadNull: return idle ? int{HDT_ERR_ARG} : int{HDT_PLUGIN_ERR_STATE};
    case Info: return go(loaded || running, m.state);
    case Start: return go(loaded, HDT_PLUGIN_RUNNING);
    case Step: return go(running && !m.open, m.state);
    case StepNull: return running && !m.open ? int{HDT_ERR_ARG} : int{HDT_PLUGIN_ERR_STATE};
    case Clear: return go(running, m.state);
    case Stop: return go(running, HDT_PLUGIN_LOADED);
    case Destroy: {
        int e = go(idle, HDT_PLUGIN_NONE);
        m.open = m.open && e != HDT_OK;
        return e;
    }
    case OpenBad: return loaded && !m.open ? HDT_PLUGIN_ERR_BUS : HDT_PLUGIN_ERR_STATE;
    case Open: {
        int e = go(loaded && !m.open, m.state);
        m.open = m.open || e == HDT_OK;
        return e;
    }
    case Period: return go(running && m.open, m.state);
    case PeriodNull: return running && m.open ? int{HDT_ERR_ARG} : int{HDT_PLUGIN_ERR_STATE};
    case Counters:
    case Restart: return go(running && m.open, m.state);
    case Close: {
        int e = go(loaded && m.open, m.state);
        m.open = m.open && e != HDT_OK;
        return e;
    }
    case Ops: break;
    }
    return 1;
}

// One arm, its memory, and what is handed in.
struct Arm {
    std::vector<uint64_t> memory;
    struct hdt_plugin_arm *arm;
    uint64_t t_us = 0;
    std::string bus_name = "unix:/nowhere/at/all";
    struct hdt_out out = {};
    struct hdt_plugin_info info = {};
    struct drv_counters count = {};
    char err[256]; // what load and open say; 0x5a where they say nothing

    // a host keeps the pointer that create gave; calls before it go to the same memory
    Arm() : memory((p->memory_bytes + 7) / 8), arm(reinterpret_cast<struct hdt_plugin_arm *>(memory.data()))
    {
    }

    int call(Op op)
    {
        static struct hdt_in in;
        struct hdt_plugin_arm *made = nullptr;
        in = {};
        in.t_us = t_us += 1429;
        std::memset(err, 0x5a, sizeof err);
        std::memset(&out, 0x5a, sizeof out);
        switch (op) {
        case Create: {
            int e = p->create(&me, memory.data(), memory.size() * 8, &made);
            if ((made != nullptr) != (e == HDT_OK))
                ck_abort_msg("create: %d and arm %p", e, static_cast<void *>(made));
            return e;
        }
        case Load: return p->load(arm, image.data(), image.size(), err, sizeof err);
        case LoadBad: return p->load(arm, image.data(), image.size() - 1, err, sizeof err);
        case LoadNull: return p->load(arm, nullptr, 0, err, sizeof err);
        case Info: return p->info(arm, &info);
        case Start: return p->start(arm);
        case Step: return p->step(arm, &in, &out);
        case StepNull: return p->step(arm, nullptr, &out);
        case Clear: return p->clear(arm);
        case Stop: return p->stop(arm);
        case Destroy: return p->destroy(arm);
        case OpenBad: return bus->open(arm, "unix:/nowhere/at/all", DRV_FORMAT_A, nullptr, err, sizeof err);
        case Open: return bus->open(arm, bus_name.c_str(), DRV_FORMAT_A, nullptr, err, sizeof err);
        case Period: return bus->period(arm, &in, &out);
        case PeriodNull: return bus->period(arm, nullptr, &out);
        case Counters: return bus->counters(arm, &count);
        case Restart: return bus->restart(arm);
        case Close: return bus->close(arm);
        case Ops: break;
        }
        return 1;
    }
};

// Call, hold code, state, output and memory against the model.  Check writes a file at every assertion
// it makes: so plain comparisons, and an assertion only for what fails.
void call_checked(Arm &a, Model &m, Op op, const std::string &path)
{
    static const hdt_out zero = {};
    static std::vector<uint64_t> before;
    before = a.memory;
    Model was = m;
    int want = expected(op, m), got = a.call(op);
    if (got != want)
        ck_abort_msg("calls%s: %d (%s), expected %d in state %d", path.c_str(), got, p->strerror(got), want,
                  was.state);
    if (p->state(a.arm) != m.state)
        ck_abort_msg("calls%s: state %d, expected %d", path.c_str(), p->state(a.arm), m.state);
    if (want == HDT_PLUGIN_ERR_STATE && before != a.memory)
        ck_abort_msg("calls%s: an illegal call changed the arm", path.c_str());
    const bool says = op == Load || op == LoadBad || op == LoadNull || op == Open || op == OpenBad;
    if (want != HDT_OK && says && (!std::memchr(a.err, 0, sizeof a.err) || std::strlen(a.err) < 10))
        ck_abort_msg("calls%s: %d without a line about it", path.c_str(), want);
    const bool drives = op == Step || op == StepNull || op == Period || op == PeriodNull;
    if (want != HDT_OK && drives && std::memcmp(&a.out, &zero, sizeof zero) != 0)
        ck_abort_msg("calls%s: output not zero", path.c_str());
    if (want == HDT_OK && op == Destroy)
        for (uint64_t word : a.memory)
            if (word != 0)
                ck_abort_msg("calls%s: memory given back is not zeroed", path.c_str());
}

// Every sequence of `left` more calls from here.
unsigned long walk_all(Arm &a, const Model &m, int left, const std::string &path)
{
    if (left == 0)
        return 1;
    static std::vector<uint64_t> snapshot[8];
    std::vector<uint64_t> &here = snapshot[left];
    unsigned long walked = 0;
    here = a.memory;
    for (int op = Create; op <= Destroy; op++) {
        Model next = m;
        std::string way = path + " " + std::to_string(op);
        call_checked(a, next, static_cast<Op>(op), way);
        walked += walk_all(a, next, left - 1, way);
        a.memory = here; // same address: a vector assigned its own size keeps its place
    }
    return walked;
}

} // namespace

START_TEST(test_every_order_of_six_calls_is_as_the_table_says)
{
    hdt_tables small = *rig_tables();
    small.joints = 1; // checking tables is what takes the time
    image.resize(hdt_tables_size(1));
    ck_assert_uint_gt(hdt_tables_write(&small, image.data(), image.size()), 0);
    Arm a;
    const uint64_t *place = a.memory.data();
#if defined(__SANITIZE_ADDRESS__)
    const int calls = 4; // each copy of an arm's memory is slow there, and the long walks go on from here
#else
    const int calls = 6;
#endif
    unsigned long all = 1;
    for (int n = 0; n < calls; n++)
        all *= 9;
    ck_assert_uint_eq(walk_all(a, Model(), calls, ""), all);
    ck_assert_ptr_eq(a.memory.data(), place);
}
END_TEST

START_TEST(test_long_walks_with_a_bus_are_as_the_table_says)
{
    Servo servo;
    Arm a;
    Model m;
    uint64_t seed = 20 + static_cast<uint64_t>(_i);
    unsigned did[Ops] = {}, periods = 0;
    a.bus_name = "unix:" + servo.path;
    for (int n = 0; n < 4000; n++) {
        // legal ways on are taken more often than chance would
        static const Op on[4] = {Create, Load, Start, Period};
        Op op = test_random(&seed) % 3 ? static_cast<Op>(test_random(&seed) % Ops) : on[m.state];
        if (m.state == HDT_PLUGIN_LOADED && !m.open && test_random(&seed) % 2)
            op = Open;
        if (op == Stop && test_random(&seed) % 8) // it takes its time
            continue;
        Model before = m;
        call_checked(a, m, op, " step " + std::to_string(n));
        did[op] += m.state != before.state || before.state == HDT_PLUGIN_RUNNING;
        periods += op == Period && before.state == HDT_PLUGIN_RUNNING && before.open;
    }
    for (Op op : {Create, Load, LoadBad, Start, Step, Stop, Destroy, Period, Counters})
        ck_assert_msg(did[op] > 0, "the walk never did %d", op);
    ck_assert_uint_gt(periods, 100);
    if (m.state == HDT_PLUGIN_RUNNING)
        ck_assert_int_eq(a.call(Stop), HDT_OK);
    if (m.state != HDT_PLUGIN_NONE)
        ck_assert_int_eq(a.call(Destroy), HDT_OK);
}
END_TEST

START_TEST(test_null_and_foreign_memory_are_errors_not_crashes)
{
    Arm a;
    struct hdt_plugin_arm *arm = a.arm;
    hdt_in in = {};
    hdt_out out;
    hdt_plugin_info info;
    ck_assert_int_eq(p->load(nullptr, image.data(), image.size(), nullptr, 0), HDT_ERR_ARG);
    ck_assert_int_eq(p->info(nullptr, &info), HDT_ERR_ARG);
    ck_assert_int_eq(p->start(nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->step(nullptr, &in, &out), HDT_ERR_ARG);
    ck_assert_int_eq(p->step(nullptr, nullptr, nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->clear(nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->stop(nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->destroy(nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->state(nullptr), HDT_PLUGIN_NONE);
    ck_assert_int_eq(bus->open(nullptr, "unix:/x", DRV_FORMAT_A, nullptr, nullptr, 0), HDT_ERR_ARG);
    ck_assert_int_eq(bus->period(nullptr, &in, &out), HDT_ERR_ARG);
    ck_assert_int_eq(bus->counters(nullptr, nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(bus->restart(nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(bus->close(nullptr), HDT_ERR_ARG);
    ck_assert_ptr_null(p->extension(nullptr));
    ck_assert_ptr_null(p->extension("hdt.bus/2"));
    ck_assert_ptr_null(p->extension("hdt.bus"));

    uint8_t *bytes = reinterpret_cast<uint8_t *>(a.memory.data());
    size_t size = a.memory.size() * 8;
    ck_assert_int_eq(p->create(&me, bytes, size, nullptr), HDT_ERR_ARG);
    ck_assert_int_eq(p->create(nullptr, bytes, size, &arm), HDT_ERR_ARG);
    ck_assert_int_eq(p->create(&me, nullptr, size, &arm), HDT_ERR_ARG);
    ck_assert_int_eq(p->create(&me, bytes, p->memory_bytes - 1, &arm), HDT_PLUGIN_ERR_MEMORY);
    ck_assert_ptr_null(arm);
    std::vector<uint64_t> larger(size / 8 + 1);
    ck_assert_int_eq(p->create(&me, reinterpret_cast<uint8_t *>(larger.data()) + 1, size, &arm),
                     HDT_PLUGIN_ERR_MEMORY);
    std::memset(bytes, 0xa5, size);
    ck_assert_int_eq(p->create(&me, bytes, size, &arm), HDT_PLUGIN_ERR_MEMORY);
    ck_assert_int_eq(p->start(a.arm), HDT_PLUGIN_ERR_STATE);
    ck_assert_int_eq(p->state(a.arm), HDT_PLUGIN_NONE);
}
END_TEST

START_TEST(test_another_abi_is_refused_and_both_numbers_can_be_read)
{
    Arm a;
    struct hdt_plugin_arm *arm;
    ck_assert_uint_eq(p->abi.major, HDT_PLUGIN_ABI_MAJOR);
    ck_assert_uint_eq(p->plugin_bytes, sizeof *p);
    ck_assert_uint_eq(p->library.minor, HDT_VERSION_MINOR);
    ck_assert_uint_eq(p->tables_layout, HDT_TABLES_LAYOUT);
    ck_assert_uint_eq(offsetof(struct hdt_plugin, abi), 0);
    for (int way = 0; way < 4; way++) {
        hdt_plugin_host other = me;
        other.abi.major += way == 0;
        other.abi.minor += way == 1;
        other.in_bytes += way == 2 ? 4 : 0;
        other.out_bytes -= way == 3 ? 4 : 0;
        ck_assert_int_eq(p->create(&other, a.memory.data(), a.memory.size() * 8, &arm),
                         HDT_PLUGIN_ERR_VERSION);
        ck_assert_uint_eq(a.memory[0], 0);
    }
    hdt_plugin_host older = me;
    older.abi.patch += 7; // a patch changes no contract
    ck_assert_int_eq(p->create(&older, a.memory.data(), a.memory.size() * 8, &arm), HDT_OK);
}
END_TEST

START_TEST(test_images_are_refused_with_a_reason)
{
    Arm a;
    char err[256];
    ck_assert_int_eq(a.call(Create), HDT_OK);
    // cut anywhere, one bit wrong anywhere
    for (size_t n = 0; n < image.size(); n += n < 200 ? 1 : 997)
        ck_assert_int_eq(p->load(a.arm, image.data(), n, err, sizeof err), HDT_PLUGIN_ERR_IMAGE);
    for (size_t n = 0; n < image.size(); n += n < 200 ? 1 : 997) {
        std::vector<uint8_t> wrong = image;
        wrong[n] ^= static_cast<uint8_t>(1u << n % 8);
        err[0] = 0;
        ck_assert_int_eq(p->load(a.arm, wrong.data(), wrong.size(), err, sizeof err), HDT_PLUGIN_ERR_IMAGE);
        ck_assert_uint_gt(std::strlen(err), 20);
        ck_assert_int_eq(p->load(a.arm, wrong.data(), wrong.size(), nullptr, 0), HDT_PLUGIN_ERR_IMAGE);
    }
    // another layout: both numbers; a value out of range: the field and the joint
    std::vector<uint8_t> later = image;
    later[4] = 77;
    ck_assert_int_eq(p->load(a.arm, later.data(), later.size(), err, sizeof err), HDT_PLUGIN_ERR_IMAGE);
    ck_assert_msg(std::strstr(err, "layout 77") && std::strstr(err, "hdt gen"), "%s", err);
    hdt_tables t = *rig_tables();
    t.joint[3].sign = 0;
    std::vector<uint8_t> range(hdt_tables_size(DRV_AXES));
    ck_assert_uint_eq(hdt_tables_write(&t, range.data(), range.size()), range.size());
    ck_assert_int_eq(p->load(a.arm, range.data(), range.size(), err, sizeof err), HDT_PLUGIN_ERR_IMAGE);
    ck_assert_msg(std::strstr(err, "sign") && std::strstr(err, "joint 4"), "%s", err);
    ck_assert_int_eq(p->state(a.arm), HDT_PLUGIN_CREATED);
    ck_assert_int_eq(a.call(Load), HDT_OK);
}
END_TEST

START_TEST(test_step_is_the_core_bit_for_bit)
{
    Arm a;
    hdt_t core;
    uint64_t seed = 5;
    ck_assert_int_eq(hdt_init(&core, rig_tables()), HDT_OK);
    for (Op op : {Create, Load, Start})
        ck_assert_int_eq(a.call(op), HDT_OK);
    for (int n = 1; n < 500; n++) {
        hdt_in in = {};
        hdt_out one, two;
        in.t_us = static_cast<uint64_t>(n) * 1429;
        in.mode = HDT_MODE_TORQUE;
        in.active = in.fresh = 0x7f;
        for (int j = 0; j < DRV_AXES; j++)
            in.count[j].raw = static_cast<int32_t>(test_random(&seed) % 2000) - 1000;
        if (n == 300)
            in.servo_alarm = 4;
        ck_assert_int_eq(hdt_step(&core, &in, &one), p->step(a.arm, &in, &two));
        ck_assert_mem_eq(&one, &two, sizeof one);
        if (n == 350) {
            ck_assert_uint_eq(two.fault, HDT_FAULT_SERVO);
            ck_assert_int_eq(p->clear(a.arm), hdt_clear(&core));
        }
    }
}
END_TEST

namespace {

struct Stopping { Arm *arm; int result; };

void *stop_arm(void *data)
{
    Stopping *s = static_cast<Stopping *>(data);
    s->result = p->stop(s->arm->arm);
    return nullptr;
}

} // namespace

START_TEST(test_calls_that_overlap_are_refused_and_a_silent_servo_is_said)
{
    Servo servo;
    Arm a;
    a.bus_name = "unix:" + servo.path;
    for (Op op : {Create, Load, Open, Start})
        ck_assert_int_eq(a.call(op), HDT_OK);
    for (int n = 0; n < 50; n++) {
        ck_assert_int_eq(a.call(Period), HDT_OK);
        usleep(500);
    }
    ck_assert_int_eq(a.call(Counters), HDT_OK);
    ck_assert_uint_gt(a.count.received, 10);
    ck_assert_int_eq(a.call(Stop), HDT_OK); // 'E' was answered
    ck_assert_int_eq(a.call(Start), HDT_OK);
    ck_assert_int_eq(a.call(Period), HDT_OK);
    __atomic_store_n(&servo.mute, 1, __ATOMIC_RELEASE);
    usleep(2000);
    Stopping stopping = {&a, 0};
    pthread_t thread;
    ck_assert_int_eq(pthread_create(&thread, nullptr, stop_arm, &stopping), 0);
    unsigned busy = 0;
    for (int n = 0; n < 100 && busy == 0; n++) {
        usleep(1000); // let stop in; it waits for its answer then
        busy += a.call(Period) == HDT_PLUGIN_ERR_BUSY;
    }
    ck_assert_uint_gt(busy, 0);
    ck_assert_int_eq(a.out.digit[0].raw, 0);
    ck_assert_int_eq(a.call(Destroy), HDT_PLUGIN_ERR_BUSY);
    ck_assert_int_eq(a.call(Info), HDT_OK); // the one call of [main] that may overlap
    pthread_join(thread, nullptr);
    ck_assert_int_eq(stopping.result, HDT_PLUGIN_ERR_BUS);
    ck_assert_int_eq(p->state(a.arm), HDT_PLUGIN_LOADED);
    ck_assert_int_eq(a.call(Destroy), HDT_OK);
}
END_TEST

START_TEST(test_stop_waits_for_a_silent_servo_no_longer_than_it_says)
{
    Servo servo;
    Arm a;
    a.bus_name = "unix:" + servo.path;
    for (Op op : {Create, Load, Open})
        ck_assert_int_eq(a.call(op), HDT_OK);
    __atomic_store_n(&servo.mute, 1, __ATOMIC_RELEASE);
    usleep(2000);
    hdt_clock clock = hdt_clock_posix();
    double best_s = 1;
    for (int n = 0; n < 4; n++) { // a late wake-up is the machine's
        ck_assert_int_eq(a.call(Start), HDT_OK);
        const uint64_t start_ns = clock.now_ns(clock.ctx);
        ck_assert_int_eq(a.call(Stop), HDT_PLUGIN_ERR_BUS);
        best_s = std::min(best_s, 1e-9 * static_cast<double>(clock.now_ns(clock.ctx) - start_ns));
    }
    ck_assert_double_ge(best_s, 0.2);
    ck_assert_double_le(best_s, 0.205);
    ck_assert_int_eq(a.call(Destroy), HDT_OK);
}
END_TEST

START_TEST(test_arms_do_not_know_of_each_other)
{
    Arm a, b;
    for (Op op : {Create, Load, Start, Step})
        ck_assert_int_eq(a.call(op), HDT_OK);
    ck_assert_int_eq(b.call(Step), HDT_PLUGIN_ERR_STATE);
    ck_assert_int_eq(b.call(Create), HDT_OK);
    std::vector<uint64_t> before = a.memory;
    for (Op op : {Load, Start, Step, Stop, Destroy})
        ck_assert_int_eq(b.call(op), HDT_OK);
    ck_assert(before == a.memory);
}
END_TEST

START_TEST(test_every_function_of_the_abi_has_a_thread_tag)
{
    std::ifstream file("driver/hdt_plugin.h");
    std::string line, comment;
    unsigned functions = 0, tagged = 0;
    ck_assert(file.is_open());
    while (std::getline(file, line)) {
        if (line.find("/*") != std::string::npos)
            comment.clear();
        comment += line;
        // members that are pointers to functions: "    int (*create)("
        if (line.rfind("    ", 0) != 0 || line.find("(*") == std::string::npos || line.find('*') == 1)
            continue;
        if (!std::isalpha(static_cast<unsigned char>(line[4])))
            continue;
        functions++;
        for (const char *tag : {"[main]", "[rt]", "[any]"})
            if (comment.find(tag) != std::string::npos || line.find(tag) != std::string::npos) {
                tagged++;
                break;
            }
    }
    ck_assert_uint_eq(functions, 11 + 3 + 5);
    ck_assert_uint_eq(tagged, functions);
}
END_TEST

// A host in C may pass any number as a format, which is no value of the enumeration here.
__attribute__((no_sanitize("undefined"))) static int
open_as(hdt_plugin_arm *arm, const char *name, int format, const uint16_t *rated, char *err, size_t len)
{
    return bus->open(arm, name, static_cast<drv_format>(format), rated, err, len);
}

START_TEST(test_open_says_what_it_cannot_open)
{
    const uint16_t rated[DRV_AXES] = {100, 100, 100, 100, 100, 100, 100};
    Arm a;
    char err[300];
    for (Op op : {Create, Load})
        ck_assert_int_eq(a.call(op), HDT_OK);
    // one byte of room and none are room enough
    ck_assert_int_eq(bus->open(a.arm, nullptr, DRV_FORMAT_A, nullptr, err, 1), HDT_ERR_ARG);
    ck_assert_int_eq(err[0], 0);
    ck_assert_int_eq(bus->open(a.arm, nullptr, DRV_FORMAT_A, nullptr, nullptr, 0), HDT_ERR_ARG);
    const struct {
        const char *name;
        int format;
        const uint16_t *rated;
        int error;
        const char *words;
    } bad[] = {
        {nullptr, DRV_FORMAT_A, nullptr, HDT_ERR_ARG, "no name"},
        {"unix:/x", 2, rated, HDT_ERR_ARG, "expected Format A"},
        {"unix:/x", DRV_FORMAT_B, nullptr, HDT_ERR_ARG, "rated torques"},
        // its state does not fit a frame
        {"can:vcan0", DRV_FORMAT_B, rated, HDT_PLUGIN_ERR_BUS,
         "74 bytes does not fit into a CAN FD frame of 64: use isotp:IFACE"},
    };
    for (const auto &b : bad) {
        std::memset(err, 0x5a, sizeof err);
        ck_assert_int_eq(open_as(a.arm, b.name, b.format, b.rated, err, sizeof err), b.error);
        ck_assert_msg(std::memchr(err, 0, sizeof err) && std::strstr(err, b.words), "expected \"%s\"",
                      b.words);
    }
}
END_TEST

static Suite *plugin_suite(void)
{
    Suite *s = suite_create("plugin");
    TCase *t = tcase_create("abi");
    tcase_add_checked_fixture(t, load_plugin, nullptr);
    tcase_add_test(t, test_another_abi_is_refused_and_both_numbers_can_be_read);
    tcase_add_test(t, test_null_and_foreign_memory_are_errors_not_crashes);
    tcase_add_test(t, test_images_are_refused_with_a_reason);
    tcase_add_test(t, test_open_says_what_it_cannot_open);
    tcase_add_test(t, test_step_is_the_core_bit_for_bit);
    tcase_add_test(t, test_arms_do_not_know_of_each_other);
    tcase_add_test(t, test_every_function_of_the_abi_has_a_thread_tag);
    suite_add_tcase(s, t);
    t = tcase_create("orders");
    tcase_set_timeout(t, 60);
    tcase_add_checked_fixture(t, load_plugin, nullptr);
    tcase_add_test(t, test_every_order_of_six_calls_is_as_the_table_says);
    tcase_add_loop_test(t, test_long_walks_with_a_bus_are_as_the_table_says, 0, 3);
    tcase_add_test(t, test_stop_waits_for_a_silent_servo_no_longer_than_it_says);
    tcase_add_test(t, test_calls_that_overlap_are_refused_and_a_silent_servo_is_said);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(plugin_suite())
