// SPDX-License-Identifier: Apache-2.0
//
// `hdt sim`: host, servo and plant in one process and in virtual time, as fast as it goes.
#include <cstdio>
#include <fstream>
#include <memory>

#include "tools/hdt_cli.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct SimOptions {
    std::string arm, model, task = "lemniscate", mode = "torque", out, effect_file;
    std::vector<std::string> effects;
    uint64_t seed = 1, individual = 0;
    double payload_kg = 0;
    bool terms = false;
};

// The control rate against the servo's own tick, both in virtual time.
struct World {
    drv_loop loop{};
    hdt_bus host_bus{}, servo_bus{};
    std::unique_ptr<servo> driver = std::make_unique<servo>();
    std::unique_ptr<drv_host> host = std::make_unique<drv_host>();
    uint64_t servo_ticks = 0;

    // Serve and advance the servo up to host time t.
    void servo_until(double t_s)
    {
        while (static_cast<double>(servo_ticks + 1) / SERVO_RATE_HZ <= t_s) {
            servo_serve(driver.get(), &servo_bus);
            servo_tick(driver.get());
            servo_ticks++;
        }
    }
};

// Hidden effects from the options and from a file of one effect a line.
void hide_all(plant_model &plant, const hdt_arm &arm, const std::vector<std::string> &effects,
              const std::string &effect_file)
{
    for (const std::string &text : effects)
        rig::hide(plant, arm, rig::parse_effect(text));
    if (effect_file.empty())
        return;
    std::ifstream file(effect_file);
    if (!file)
        throw InputError(effect_file + ": cannot be read (expected one NAME=SIZE[@JOINT] a line)");
    for (std::string line; std::getline(file, line);)
        if (!line.empty() && line[0] != '#')
            rig::hide(plant, arm, rig::parse_effect(line));
}

int run(const SimOptions &o)
{
    hdt_arm arm = rig::load_arm(o.arm);
    hdt_arm model = o.model.empty() ? arm : rig::load_arm(o.model);
    if (o.payload_kg != 0) {
        arm.payload_kg = model.payload_kg = o.payload_kg;
        arm.payload_com_m[2] = model.payload_com_m[2] = 0.05;
    }
    if (model.joints != arm.joints)
        throw InputError(o.model + ": " + std::to_string(model.joints) + " joints, but " + o.arm + " has " +
                         std::to_string(arm.joints));
    uint32_t mode = rig::mode_of(o.mode);
    Reference reference = make_task(model, o.task, model.control_rate_hz);
    rig::FixedReference fixed(reference);
    hdt_tables tables = rig::tables_of(model);
    plant_model plant = rig::plant_from_arm(arm, o.individual);
    hide_all(plant, arm, o.effects, o.effect_file);

    World world;
    drv_loop_pair(&world.loop, &world.host_bus, &world.servo_bus);
    std::vector<double> start(static_cast<std::size_t>(arm.joints));
    for (int j = 0; j < arm.joints; j++)
        start[static_cast<std::size_t>(j)] = reference.q_rad(0, j);
    servo_cfg servo_options = {};
    servo_init(world.driver.get(), &plant, &servo_options, start.data(), o.seed);
    std::vector<drv_record> slots(16);
    drv_ring ring;
    drv_ring_init(&ring, slots.data(), static_cast<unsigned>(slots.size()));
    drv_reference view = fixed.view();
    drv_host_cfg cfg = {};
    cfg.mode = mode;
    cfg.settle_s = 0.2;
    if (drv_host_init(world.host.get(), &tables, &world.host_bus, &ring, &view, &cfg) != HDT_OK)
        throw InputError(o.arm + ": the core does not accept its tables");

    rig::LogHead head;
    head.lines = {"task = " + o.task, "mode = " + o.mode, "seed = " + std::to_string(o.seed)};
    if (o.payload_kg != 0) {
        head.lines.push_back("payload_kg = " + std::to_string(o.payload_kg));
        head.lines.push_back("payload_com_m = 0 0 0.05");
    }
    std::vector<const char *> constants = head.pointers();
    drv_writer_cfg writer_cfg = {};
    writer_cfg.tables = &tables;
    for (int j = 0; j < arm.joints; j++)
        writer_cfg.ratio[j] = model.joint[j].ratio;
    writer_cfg.constants = constants.data();
    writer_cfg.terms = o.terms;
    char error[512];
    drv_writer *writer = drv_writer_open(o.out.c_str(), &writer_cfg, error, sizeof error);
    if (writer == nullptr)
        throw InputError(error);

    Progress progress("hdt sim");
    drv_host_phase phase = DRV_HOST_STARTING;
    auto record = std::make_unique<drv_record>();
    bool written = true;
    for (uint64_t k = 1; phase < DRV_HOST_DONE && written; k++) {
        double t_s = static_cast<double>(k) / model.control_rate_hz;
        world.servo_until(t_s);
        if (stopped())
            drv_host_stop(world.host.get());
        phase = drv_host_period(world.host.get(), static_cast<uint64_t>(t_s * 1e6));
        while (drv_ring_pop(&ring, record.get()))
            written = drv_writer_put(writer, record.get()) == 0 && written;
        progress.at(static_cast<double>(world.host->sample) / static_cast<double>(reference.q_rad.rows()));
    }
    if (drv_writer_close(writer, written) != 0 || !written)
        throw InputError(o.out + ": the log could not be written (disk full?)");
    if (phase == DRV_HOST_FAULT) {
        for (uint32_t bit = 1; bit != 0; bit <<= 1)
            if (world.host->out.fault & bit)
                std::fprintf(stderr, "hdt sim: fault: %s (joints mask 0x%x) at %.3f s; the log up to there is in %s\n",
                             hdt_fault_str(bit), world.host->out.fault_joints,
                             static_cast<double>(world.host->in.t_us) * 1e-6, o.out.c_str());
        return No;
    }
    return Ok;
}

} // namespace

void add_sim(CLI::App &app, int &code)
{
    auto o = std::make_shared<SimOptions>();
    CLI::App *sub = app.add_subcommand("sim", "run the rig in virtual time and write a log");
    sub->add_option("--arm", o->arm, "model file of the arm that is simulated")->required();
    sub->add_option("--model", o->model, "model file the host uses (default: the arm's)");
    sub->add_option("--task", o->task, "reference motion, e.g. lemniscate, excite:seed=3,seconds=40")->capture_default_str();
    sub->add_option("--mode", o->mode, "torque or velocity")->capture_default_str();
    sub->add_option("--out", o->out, "log to write: .csv or .lcm")->required();
    sub->add_option("--effect", o->effects, "hide an effect in the plant: NAME=SIZE[@JOINT][:key=value,...]\n" + rig::effect_menu());
    sub->add_option("--effect-file", o->effect_file, "hide the effects in this file, one a line");
    sub->add_option("--seed", o->seed, "this run's noise and scatter")->capture_default_str();
    sub->add_option("--individual", o->individual, "which specimen of the arm; 0 has the file's friction exactly")->capture_default_str();
    sub->add_option("--payload", o->payload_kg, "known payload, kg, at the flange; declared in the log");
    sub->add_flag("--terms", o->terms, "also log every term's torque");
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
