// SPDX-License-Identifier: Apache-2.0
//
// `hdt sim`: host, servo and plant in one process and in virtual time, as fast as it goes.
#include <memory>

#include "tools/hdt_cli.hpp"
#include "tools/hdt_effects.hpp"
#include "tools/hdt_format.hpp"
#include "tools/hdt_rig.hpp"
#include "tools/hdt_world.hpp"

namespace hdt::cli {

namespace {

struct SimOptions {
    std::string arm, model, task = "lemniscate", mode = "torque", out, effect_file, dump;
    std::string format = "A", integrator = "verlet";
    std::vector<std::string> effects;
    uint64_t seed = 1, individual = 0;
    double payload_kg = 0, arcnet_mbps = 0;
    bool terms = false;
};

// What the run is about, for the head of its log.
std::vector<std::string> log_head(const SimOptions &o)
{
    std::vector<std::string> head = {"task = " + o.task, "mode = " + o.mode,
                                     "seed = " + std::to_string(o.seed)};
    if (o.payload_kg != 0) {
        head.push_back("payload_kg = " + std::to_string(o.payload_kg));
        head.push_back("payload_com_m = 0 0 0.05");
    }
    return head;
}

// The run, its records to the log; false: the log failed.
bool play(rig::World &world, drv_writer *writer, unsigned samples)
{
    Progress progress("hdt sim");
    auto record = std::make_unique<drv_record>();
    bool written = true;
    world.play([&](rig::World &w) {
        while (written && drv_ring_pop(&w.ring(), record.get()))
            written = drv_writer_put(writer, record.get()) == 0;
        progress.at(static_cast<double>(w.host().sample) / samples);
        if (stopped())
            drv_host_stop(&w.host());
        return written;
    });
    return written;
}

void integrate_by(const std::string &name, plant_model *plant)
{
    if (name != "verlet" && name != "rk4")
        throw UsageError("--integrator: expected verlet or rk4, found " + name);
    plant->integrator = name == "rk4" ? PLANT_RK4 : PLANT_VERLET;
    plant->step_s = 0;
    const char *why = nullptr;
    if (plant_model_check(plant, &why) != 0)
        throw InputError("--integrator " + name + ": " + why);
}

int run(const SimOptions &o)
{
    end_in_good_order();
    if (same_file(o.out, o.dump))
        throw UsageError("--dump: " + o.dump + " is --out: expected two files");
    hdt_arm arm = rig::load_arm(o.arm);
    hdt_arm model = o.model.empty() ? arm : rig::load_arm(o.model);
    if (model.joints != arm.joints)
        throw InputError(o.model + ": " + std::to_string(model.joints) + " joints, but " + o.arm + " has " +
                         std::to_string(arm.joints));
    if (o.payload_kg != 0) {
        arm.payload_kg = model.payload_kg = o.payload_kg;
        for (hdt_arm *a : {&arm, &model}) {
            a->payload_com_m[0] = a->payload_com_m[1] = 0;
            a->payload_com_m[2] = 0.05;
        }
    }
    Reference reference = rig::task_of(model, o.task);
    rig::FixedReference fixed(reference);
    hdt_tables tables = rig::tables_of(model);
    plant_model plant = rig::plant_from_arm(arm, o.individual);
    rig::hide_all(plant, arm, o.effects, o.effect_file);
    integrate_by(o.integrator, &plant);

    rig::WorldSetup setup;
    setup.mode = rig::mode_of(o.mode);
    setup.seed = o.seed;
    setup.records = 16;
    setup.arcnet_mbps = o.arcnet_mbps;
    setup.format = format_of(o.format, "loop:");
    std::array<uint16_t, DRV_AXES> rated{};
    if (setup.format == DRV_FORMAT_B)
        rated = rated_mnm(arm, o.arm);
    setup.rated_mnm = rated.data();
    Eigen::VectorXd start = reference.q_rad.row(0);
    rig::World world(tables, plant, fixed, model.control_rate_hz, {start.begin(), start.end()}, setup);

    rig::FaultDump dump(o.dump, &world.host().cycle);
    drv_writer *writer = rig::open_log(o.out, tables, model, log_head(o), o.terms);
    bool written = play(world, writer, fixed.view().samples);
    if (drv_writer_close(writer, written) != 0 || !written)
        throw InputError(o.out + ": the log could not be written (disk full?)");
    dump.write(tables, model, log_head(o));
    const int code = rig::explain_end("hdt sim", world.host());
    const bool cut = world.host().sample < fixed.view().samples; // not what was asked for
    return code == Ok && cut ? No : code;
}

} // namespace

void add_sim(CLI::App &app, int &code)
{
    auto o = std::make_shared<SimOptions>();
    CLI::App *sub = app.add_subcommand("sim", "run the rig in virtual time and write a log");
    sub->add_option("--arm", o->arm, "model file of the arm that is simulated")->required();
    sub->add_option("--model", o->model, "model file the host uses (default: the arm's)");
    sub->add_option("--task", o->task, "reference motion, e.g. lemniscate, excite:seed=3,seconds=40")
        ->capture_default_str();
    sub->add_option("--mode", o->mode, "torque or velocity")->capture_default_str();
    sub->add_option("--out", o->out, "log to write: .csv or .lcm")->required();
    sub->add_option("--dump", o->dump, "when a fault latches, the last periods before it, .lcm, to replay");
    sub->add_option("--effect", o->effects,
                    "hide an effect in the plant: NAME=SIZE[@JOINT][:key=value,...]\n" + rig::effect_menu());
    sub->add_option("--effect-file", o->effect_file, "hide the effects in this file, one a line");
    sub->add_option("--seed", o->seed, "this run's noise and scatter")
        ->capture_default_str()->check(whole_number());
    sub->add_option("--individual", o->individual,
                    "which specimen of the arm; 0 has the file's friction exactly")
        ->capture_default_str()->check(whole_number());
    sub->add_option("--payload", o->payload_kg, "known payload, kg, at the flange; declared in the log")
        ->check(between(0.0, 1000.0));
    sub->add_option("--arcnet", o->arcnet_mbps,
                    "telegrams take the time of an ARCNET at this rate, Mbit/s (10, 5, 2.5, ...); 0: none")
        ->check(between(0.0, 10.0));
    sub->add_option("--format", o->format, "telegrams of the first (A) or second (B) generation")
        ->capture_default_str();
    sub->add_option("--integrator", o->integrator, "verlet (fast) or rk4 (the reference, 7 times slower)")
        ->capture_default_str();
    sub->add_flag("--terms", o->terms, "also log every term's torque");
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
