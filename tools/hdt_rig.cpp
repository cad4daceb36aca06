// SPDX-License-Identifier: Apache-2.0
// See hdt_rig.hpp.
#include "tools/hdt_rig.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>
#include <sstream>

#include "driver/drv_rt.h"
#include "model/arm_file.hpp"
#include "tools/hdt_effects.hpp"
#include "tools/usage_error.hpp"

namespace hdt::rig {

namespace {

int32_t fixed(double value, double scale)
{
    double x = std::nearbyint(value * scale);
    return static_cast<int32_t>(std::clamp(x, -2147483647.0, 2147483647.0));
}

void scatter(plant_joint &joint, std::mt19937_64 &random)
{
    std::normal_distribution<double> normal;
    double friction = 1 + 0.1 * normal(random);
    for (plant_friction &f : joint.friction) {
        f.f0_nm *= friction;
        f.fv_nmspr *= friction;
        f.fs_nm *= friction;
    }
    joint.mesh.drive_nm *= friction;
    joint.mesh.back_nm *= friction;
    joint.soft_nm *= friction; // teeth pressed together harder take more torque to part
    for (int i = 0; i < joint.lines; i++)
        joint.line[i].amplitude_nm *= 1 + 0.1 * normal(random);
}

// Torque the wave generator carries while the joint slides without load: what the mesh loses then.
double unloaded_wave_nm(const hdt_arm_mesh &m)
{
    double rate = (m.drive_nm - m.back_nm) / (2 * m.soft_nm);
    double within = (m.back_nm + rate * m.soft_nm) / (1 - rate);
    return within <= m.soft_nm ? within : (m.drive_nm - m.drive_load * m.soft_nm) / (1 - m.drive_load);
}

// The file's Coulomb friction is that of a joint without load: the mesh's part is taken off the rotor's.
void fill_mesh(plant_joint &p, const hdt_arm_joint &a, const char *path, int number)
{
    for (int i = 0; i < a.errors; i++)
        p.error[p.errors++] = {a.error[i].order_rev, a.error[i].amplitude_rad, a.error[i].phase_rad};
    if (!a.has_mesh)
        return;
    p.soft_nm = a.mesh.soft_nm;
    p.soft_nmprad = a.mesh.soft_nmprad;
    p.hard_nmprad = a.mesh.hard_nmprad;
    p.mesh = {a.mesh.drive_nm, a.mesh.back_nm, a.mesh.drive_load, a.mesh.back_load};
    for (plant_friction &f : p.friction) {
        f.f0_nm -= unloaded_wave_nm(a.mesh);
        if (f.f0_nm < 0)
            throw InputError(std::string(path) + ": joint." + std::to_string(number) +
                             ".mesh.drive_loss: the mesh alone loses more than friction.*.f0 without load");
    }
}

void fill_joint(plant_joint &p, const hdt_arm_joint &a)
{
    std::copy(std::begin(a.rot), std::end(a.rot), p.rot);
    std::copy(std::begin(a.origin_m), std::end(a.origin_m), p.trans_m);
    p.mass_kg = a.mass_kg;
    std::copy(std::begin(a.moment_kgm), std::end(a.moment_kgm), p.moment_kgm);
    std::copy(std::begin(a.inertia_kgm2), std::end(a.inertia_kgm2), p.inertia_kgm2);
    p.q_min_rad = a.q_min_rad;
    p.q_max_rad = a.q_max_rad;
    p.ratio = a.ratio;
    std::copy(std::begin(a.k_nmprad), std::end(a.k_nmprad), p.k_nmprad);
    std::copy(std::begin(a.t_nm), std::end(a.t_nm), p.t_nm);
    p.rotor_kgm2_m = a.rotor_kgm2_m + a.wave_generator_kgm2_m;
    p.tau_max_m_nm = a.tau_max_m_nm > 0 ? a.tau_max_m_nm : a.tau_rated_m_nm;
    // 15 % of critical against the rotor alone, which leaves the link's own mode 5 to 10 %
    p.damping_nmspr = 0.3 * std::sqrt(p.k_nmprad[0] * p.rotor_kgm2_m * p.ratio * p.ratio);
    for (int d = 0; d < 2; d++)
        p.friction[d] = {a.friction[d].f0_nm, a.friction[d].fv_nmspr, a.friction[d].fs_nm,
                         a.friction[d].vc_radps};
    for (int i = 0; i < a.ripples && p.lines < PLANT_LINES_MAX; i++)
        p.line[p.lines++] =
            {a.ripple[i].order_rev, a.ripple[i].amplitude_nm, a.ripple[i].phase_rad, 1, 0, 0, 0};
    // 1 % of Coulomb friction from run to run and as slow wander; a thousandth of rated torque as noise
    p.run_coulomb_sigma_nm = 0.01 * a.friction[0].f0_nm;
    p.wander_sigma_nm = 0.0075 * a.friction[0].f0_nm;
    p.wander_s = 10;
    p.torque_noise_m_nm = 0.001 * p.tau_max_m_nm;
}

} // namespace

plant_model plant_from_arm(const hdt_arm &arm, uint64_t individual)
{
    plant_model plant = {};
    plant.joints = arm.joints;
    std::copy(std::begin(arm.gravity_mps2), std::end(arm.gravity_mps2), plant.gravity_mps2);
    std::mt19937_64 random(individual);
    for (int j = 0; j < arm.joints; j++) {
        const hdt_arm_joint &a = arm.joint[j];
        if (!a.has_inertial || !a.has_gear || !a.has_friction || a.rotor_kgm2_m <= 0)
            throw InputError(std::string(arm.path) + ": joint." + std::to_string(j + 1) +
                             ": a plant needs link masses, gear stiffness, friction and rotor inertia; this "
                             "file lacks some (a measured arm can be diagnosed but not simulated)");
        fill_joint(plant.joint[j], a);
        fill_mesh(plant.joint[j], a, arm.path, j + 1);
        if (individual != 0)
            scatter(plant.joint[j], random);
    }
    if (arm.payload_kg > 0)
        add_payload(plant, arm, arm.payload_kg, arm.payload_com_m);
    const char *why = nullptr;
    if (plant_model_check(&plant, &why) != 0)
        throw InputError(std::string(arm.path) + ": no plant can be made from this arm: " + why);
    return plant;
}

hdt_arm load_arm(const std::string &path)
{
    hdt_arm arm;
    char error[512];
    if (hdt_arm_load(path.c_str(), &arm, error, sizeof error) != 0)
        throw InputError(error);
    return arm;
}

namespace {

// What the file calls a number a refusal names: "joint.2.effect (order_line 1).order" is one of
// joint.2.effect.3, "joint.2.gear.ratio (times torque gain)" is joint.2.gear.ratio.
std::string file_key(const ArmFile &file, const std::string &named)
{
    const std::size_t open = named.find(" ("), close = named.find(')');
    const std::string head = named.substr(0, open);
    if (close == std::string::npos || file.count(head) == 0)
        return head;
    std::istringstream bracket(named.substr(open + 2, close - open - 2));
    std::string id;
    int which;
    if (!(bracket >> id >> which))
        which = 1;
    for (int i = 1; i <= file.count(head); i++) {
        const std::string key = head + "." + std::to_string(i);
        if (file.get_text(key + ".id") == id && --which == 0)
            return key + named.substr(close + 1);
    }
    return head;
}

// "FILE: key: ..." to "FILE:line: key: ..."; as it is where the file no longer says the same.
std::string with_line(const hdt_arm &arm, const std::string &refusal)
{
    const std::string path = arm.path, rest = refusal.substr(std::min(refusal.size(), path.size() + 2));
    try {
        const ArmFile file = ArmFile::load(path);
        const int line = file.line_of(file_key(file, rest.substr(0, rest.find(": "))));
        if (line > 0 && std::equal(arm.digest, arm.digest + sizeof arm.digest, file.arm().digest))
            return path + ":" + std::to_string(line) + ": " + rest;
    } catch (const InputError &) {
        // said without the line
    }
    return refusal;
}

} // namespace

hdt_tables tables_of(const hdt_arm &arm, hdt_gen_report *report)
{
    hdt_tables tables;
    char error[512];
    if (hdt_arm_tables(&arm, &tables, report, error, sizeof error) != 0)
        throw InputError(with_line(arm, error));
    return tables;
}

FixedReference::FixedReference(const Reference &r)
    : samples_(static_cast<unsigned>(r.q_rad.rows())), joints_(static_cast<unsigned>(r.q_rad.cols())),
      active_(r.active)
{
    constexpr double q24 = 16777216.0, q16 = 65536.0;
    for (Eigen::Index k = 0; k < r.q_rad.rows(); k++)
        for (Eigen::Index j = 0; j < r.q_rad.cols(); j++) {
            q_.push_back({fixed(r.q_rad(k, j), q24)});
            v_.push_back({fixed(r.v_radps(k, j), q24)});
            a_.push_back({fixed(r.a_radps2(k, j), q16)});
        }
}

drv_reference FixedReference::view() const
{
    return {samples_, joints_, active_, q_.data(), v_.data(), a_.data()};
}

uint32_t mode_of(const std::string &text)
{
    if (text == "torque")
        return HDT_MODE_TORQUE;
    if (text == "velocity")
        return HDT_MODE_VELOCITY;
    throw UsageError("--mode: expected torque or velocity, found \"" + text + "\"");
}

Reference task_of(const hdt_arm &arm, const std::string &text)
{
    try {
        return make_task(arm, text, arm.control_rate_hz);
    } catch (const InputError &e) {
        throw UsageError(e.what());
    }
}

namespace {

bool ends_in(const std::string &path, const std::string &end)
{
    return path.size() > end.size() && path.compare(path.size() - end.size(), end.size(), end) == 0;
}

drv_writer_cfg writer_cfg(const hdt_tables &tables, const hdt_arm &arm, const std::vector<std::string> &head,
                          std::vector<const char *> *constants)
{
    for (const std::string &line : head)
        constants->push_back(line.c_str());
    constants->push_back(nullptr);
    drv_writer_cfg cfg = {};
    cfg.tables = &tables;
    for (int j = 0; j < arm.joints; j++)
        cfg.ratio[j] = arm.joint[j].ratio;
    cfg.constants = constants->data();
    return cfg;
}

} // namespace

drv_writer *open_log(const std::string &path, const hdt_tables &tables, const hdt_arm &arm,
                     const std::vector<std::string> &head, bool terms)
{
    if (!ends_in(path, ".csv") && !ends_in(path, ".lcm"))
        throw UsageError(path + ": not a log name: expected one ending in .csv or .lcm");
    std::vector<const char *> constants;
    drv_writer_cfg cfg = writer_cfg(tables, arm, head, &constants);
    cfg.terms = terms;
    char error[512];
    drv_writer *writer = drv_writer_open(path.c_str(), &cfg, error, sizeof error);
    if (writer == nullptr)
        throw InputError(error);
    return writer;
}

FaultDump::FaultDump(std::string path, drv_cycle *cycle) : path_(std::move(path))
{
    if (path_.empty())
        return;
    if (!ends_in(path_, ".lcm"))
        throw UsageError("--dump: expected a name ending in .lcm, found " + path_);
    slots_.resize(2048); // between 1.5 and 3 seconds of periods
    dump_ = std::make_unique<drv_dump>();
    drv_dump_init(dump_.get(), slots_.data(), static_cast<unsigned>(slots_.size()), &cycle->core);
    cycle->dump = dump_.get();
}

void FaultDump::write(const hdt_tables &tables, const hdt_arm &arm,
                      const std::vector<std::string> &head) const
{
    if (!dump_ || !dump_->full)
        return;
    std::vector<const char *> constants;
    drv_writer_cfg cfg = writer_cfg(tables, arm, head, &constants);
    char error[512];
    if (drv_dump_write(dump_.get(), path_.c_str(), &cfg, error, sizeof error) != 0)
        throw InputError(error);
    std::fprintf(stderr, "the periods before the fault are in %s; hdt replay %s\n", path_.c_str(),
                 path_.c_str());
}

void go_real_time(const char *who, int priority)
{
    drv_rt_wish wish = {priority, -1, 1};
    char refused[512];
    if (drv_rt_enter(&wish, refused, sizeof refused) != 0)
        std::fprintf(stderr, "%s: %s\n", who, refused);
}

int explain_end(const char *who, const drv_host &host)
{
    drv_host_status status;
    char line[1024];
    drv_host_report(&host, &status);
    const bool ended = host.phase == DRV_HOST_DONE && status.end_confirmed;
    if (ended && status.sample >= status.samples)
        return 0;
    drv_host_say(&status, host.cycle.core.tables, line, sizeof line);
    std::fprintf(stderr, "%s: %s", who, line);
    if (ended)
        std::fprintf(stderr, ": the run ends at sample %u of %u", status.sample, status.samples);
    std::fprintf(stderr, "\n");
    if (ended && status.asked == DRV_HOST_ASK_STOP)
        return 0;
    return host.phase == DRV_HOST_SILENT ? 3 : 1;
}

} // namespace hdt::rig
