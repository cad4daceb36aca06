// SPDX-License-Identifier: Apache-2.0
//
// `hdt servo`: the emulated servo driver with its arm, in real time, on a bus.
#include <cerrno>
#include <cstdio>
#include <memory>

#include "model/task.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_format.hpp"
#include "tools/hdt_effects.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct ServoOptions {
    std::string arm, bus, task, effect_file, format = "A";
    std::vector<std::string> effects;
    uint64_t seed = 1, individual = 0;
    double seconds = 0, watchdog_s = 0, emergency_s = 0;
};

// Tick by the clock.  A late wake-up is made up for before any telegram is answered, so that the
// arm a host sees never lags the clock; up to a tenth of a second at once.
int serve(servo &driver, hdt_bus &bus, const ServoOptions &o)
{
    constexpr uint64_t tick_ns = 1000000000u / SERVO_RATE_HZ;
    hdt_clock clock = hdt_clock_posix();
    uint64_t start = clock.now_ns(clock.ctx), next = start + tick_ns, skipped = 0;
    while (!stopped()) {
        double since_s = static_cast<double>(next - start) * 1e-9;
        if (o.seconds > 0 && since_s > o.seconds)
            break;
        if (o.emergency_s > 0 && since_s > o.emergency_s && !driver.s.emergency) {
            std::fprintf(stderr, "hdt servo: emergency stop pressed\n");
            servo_emergency_stop(&driver, 1);
        }
        int slept = clock.sleep_until_ns(clock.ctx, next);
        if (slept != 0 && slept != -EINTR)
            throw InputError("hdt servo: the monotonic clock cannot be slept on");
        uint64_t now = clock.now_ns(clock.ctx);
        if (now > next + 100000000u) {
            skipped += (now - next) / tick_ns;
            next = now;
        }
        for (; next <= now; next += tick_ns)
            servo_tick(&driver);
        uint64_t other_before = driver.s.other_format;
        servo_serve(&driver, &bus);
        if (other_before == 0 && driver.s.other_format != 0)
            std::fprintf(stderr,
                         "hdt servo: a telegram of Format %s was refused: this servo speaks Format %s; give "
                         "host and servo the same --format\n",
                         o.format == "A" ? "B" : "A", o.format.c_str());
    }
    std::fprintf(stderr, "hdt servo: %llu telegrams answered, %llu refused, %llu ticks skipped\n",
                 static_cast<unsigned long long>(driver.s.answered),
                 static_cast<unsigned long long>(driver.s.refused), static_cast<unsigned long long>(skipped));
    return Ok;
}

servo_cfg options_of(const ServoOptions &o, const hdt_arm &arm)
{
    servo_cfg options = {};
    options.format = format_of(o.format, o.bus);
    options.watchdog_s = o.watchdog_s;
    if (options.format == DRV_FORMAT_B) {
        auto rated = rated_mnm(arm, o.arm);
        for (size_t j = 0; j < rated.size(); j++)
            options.rated_m_nm[j] = rated[j] / 1000.0;
    }
    return options;
}

int run(const ServoOptions &o)
{
    end_in_good_order();
    check_bus_name(o.bus);
    hdt_arm arm = rig::load_arm(o.arm);
    plant_model plant = rig::plant_from_arm(arm, o.individual);
    rig::hide_all(plant, arm, o.effects, o.effect_file);
    Eigen::VectorXd start = Eigen::VectorXd::Zero(arm.joints);
    if (!o.task.empty())
        start = rig::task_of(arm, o.task).q_rad.row(0);
    auto driver = std::make_unique<servo>();
    servo_cfg options = options_of(o, arm);
    servo_init(driver.get(), &plant, &options, start.data(), o.seed);
    hdt_bus bus;
    char error[512];
    if (hdt_bus_open(&bus, o.bus.c_str(), HDT_BUS_SERVO, error, sizeof error) != 0)
        throw InputError(error);
    rig::go_real_time("hdt servo", 81);
    int code = serve(*driver, bus, o);
    hdt_bus_close(&bus);
    return code;
}

} // namespace

void add_servo(CLI::App &app, int &code)
{
    auto o = std::make_shared<ServoOptions>();
    CLI::App *sub = app.add_subcommand("servo", "the emulated servo driver and arm, in real time, on a bus");
    sub->add_option("--arm", o->arm, "model file of the arm that is simulated")->required();
    sub->add_option("--bus", o->bus, "unix:PATH, can:IFACE, isotp:IFACE or arcnet:IFACE")->required();
    sub->add_option("--task", o->task, "stand where this task starts (default: all joints at zero)");
    sub->add_option("--effect", o->effects,
                    "hide an effect in the plant: NAME=SIZE[@JOINT][:key=value,...]\n" + rig::effect_menu());
    sub->add_option("--effect-file", o->effect_file, "hide the effects in this file, one a line");
    sub->add_option("--seed", o->seed, "noise and scatter")->capture_default_str()->check(whole_number());
    sub->add_option("--individual", o->individual,
                    "which specimen of the arm; 0 has the file's friction exactly")
        ->capture_default_str()->check(whole_number());
    sub->add_option("--format", o->format, "telegrams of the first (A) or second (B) generation")
        ->capture_default_str();
    sub->add_option("--watchdog", o->watchdog_s,
                    "s without a command until all brakes are on (default: 0.4 in A, 0.01 in B)")
        ->check(between(0.001, 3600.0));
    sub->add_option("--emergency-stop", o->emergency_s, "press the emergency stop after so many s")
        ->check(between(0.001, 1e6));
    sub->add_option("--seconds", o->seconds, "stop after this long (default: at Ctrl-C)")
        ->check(between(0.0, 1e9));
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
