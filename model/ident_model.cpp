// SPDX-License-Identifier: Apache-2.0
//
// Writing a fit into the model file.
//
// Base parameters: a joint turns about its z, so of a link's ten parameters the mass, the moment
// along z and equal shares of Ixx and Iyy act as if they belonged to the link before it.  They are
// set to zero and their effect is in the numbers of the earlier links.  The rotor of joint 1 is part
// of Izz of link 1.
//
// Owns: keys, units and sides of fitted numbers.
// Never: fits.
#include "model/ident_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/terms.hpp"
#include "model/text.hpp"

namespace hdt::fit {

using Eigen::Index;

namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
const char *const source_id = "IDENT";
const char *const way_name[2] = {"positive", "negative"};
const char *const inertial_unit[10] = {"kg",     "kg m",   "kg m",   "kg m",   "kg m^2",
                                       "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2"};

std::string joint_key(int joint, const std::string &rest)
{
    return "joint." + std::to_string(joint + 1) + "." + rest;
}

double file_sigma(const ArmFile &file, const std::string &key)
{
    if (!file.has(key))
        return unknown;
    Quantity q = file.get(key);
    return q.sigma.empty() ? unknown : q.sigma[0];
}

// One number: written when fitted or when the file has none yet, else left as it stands.
void write_number(const std::string &key, const char *unit, double value, double sigma, bool fitted,
                  ArmFile *file, std::vector<FitParameter> *list)
{
    if (fitted || !file->has(key))
        file->set(key, quantity({value}, unit, {fitted ? sigma : unknown}, "output"));
    list->push_back({key, unit, value, fitted ? sigma : file_sigma(*file, key), fitted});
}

// Adds to the file's constant torque of this joint.
void add_offset(int joint, double offset, double sigma, ArmFile *file, std::vector<FitParameter> *list)
{
    std::string array = joint_key(joint, "effect"), key;
    if (int k = file->find(array, "torque_offset")) {
        key = array + "." + std::to_string(k) + ".torque";
        offset += file->get(key).value[0];
        file->set(key, quantity({offset}, "N m", {sigma}, "output"));
    } else {
        file->append(array, {{"id", "torque_offset"}},
                     {{"torque", quantity({offset}, "N m", {sigma}, "output")}});
        key = array + "." + std::to_string(file->count(array)) + ".torque";
    }
    list->push_back({key, "N m", offset, sigma, true});
}

// Coulomb friction below zero one way is a constant torque beside it: the same curve, told apart.
void split_offset(const JointFitState &j, hdt_arm_friction f[2], ArmFile *file,
                  std::vector<FitParameter> *list, std::vector<std::string> *notes)
{
    if (f[0].f0_nm >= 0 && f[1].f0_nm >= 0)
        return;
    double offset = (f[0].f0_nm - f[1].f0_nm) / 2;
    f[0].f0_nm = f[1].f0_nm = std::max(0.0, (f[0].f0_nm + f[1].f0_nm) / 2);
    double sigma = std::hypot(sigma_of(j, F0, 0, 0), sigma_of(j, F0, 1, 0)) / 2;
    add_offset(j.rows.joint, offset, sigma, file, list);
    notes->push_back("joint " + std::to_string(j.rows.joint + 1)
                     + ": Coulomb friction came out negative one way; the two directions were made equal and "
                       "the difference written as a torque offset, which sliding data cannot tell from it");
}

// The least Coulomb friction that leaves this curve nowhere below zero.
double least_coulomb(const JointFitState &j, int way, const hdt_arm_friction &f)
{
    hdt_arm_friction rest = f;
    rest.f0_nm = 0;
    double top = std::max(j.rows.speed[way].maxCoeff(), 1.0), least = 0;
    for (int k = 0; k <= 50; k++)
        least = std::max(least, -stribeck_nm(rest, top * k / 50));
    return least;
}

// A joint that moved one way only shows Coulomb friction and a constant torque as one number: what it
// showed is written, as friction where it can be that, else as an offset beside the file's friction.
// True: an offset was written and the Coulomb friction of that way is not the fit's.
bool split_one_way(const JointFitState &j, int way, hdt_arm_friction f[2], ArmFile *file,
                   std::vector<FitParameter> *list, std::vector<std::string> *notes)
{
    const int joint = j.rows.joint, other = 1 - way;
    const double sum = f[way].f0_nm, sign = way == 0 ? 1 : -1, least = least_coulomb(j, way, f[way]);
    const hdt_arm_joint &given = file->arm().joint[joint];
    const bool known = file->has(joint_key(joint, std::string("friction.") + way_name[other] + ".f0"));
    const bool split = sum < least;
    std::string note = "joint " + std::to_string(joint + 1) + ": no motion in " + way_name[other]
                       + " direction: Coulomb friction and a constant torque are one number in these runs, "
                       + number3(sum) + " N m; ";
    if (split) {
        f[way].f0_nm = std::max(least, given.has_friction ? given.friction[way].f0_nm : 0.0);
        add_offset(joint, sign * (sum - f[way].f0_nm), sigma_of(j, F0, way, 0), file, list);
        note += "written as a torque offset beside friction of " + number3(f[way].f0_nm) + " N m";
    } else {
        note += "written as friction";
    }
    if (!known) { // a file that knows nothing of that way: as the way that moved
        f[other] = f[way];
        note += "; friction in " + std::string(way_name[other]) + " direction was set to that of the other";
    } else {
        note += "; friction in " + std::string(way_name[other]) + " direction is still the file's";
    }
    notes->push_back(note + ". Log it moving both ways");
    return split;
}

void write_valid(const JointFitState &j, bool all_fitted, ArmFile *file)
{
    std::vector<double> speed;
    for (int way = 0; way < 2; way++)
        for (Index i = 0; i < j.rows.rows(); i++)
            if (j.rows.share[way][i] > 0.5)
                speed.push_back(j.rows.speed[way][i]);
    std::sort(speed.begin(), speed.end());
    std::size_t n = speed.size();
    if (n < 2)
        return;
    double lo = speed[n / 100], hi = speed[n - 1 - n / 100];
    std::string key = joint_key(j.rows.joint, "friction.valid");
    if (!all_fitted && file->has(key)) {
        std::vector<double> old = file->get(key).value;
        lo = std::min(lo, old[0]);
        hi = std::max(hi, old[1]);
    }
    if (hi <= lo)
        return;
    Quantity q = quantity({lo, hi}, "rad/s", {unknown, unknown}, "");
    q.confidence = "high";
    file->set(key, q);
}

void write_friction(const JointFitState &j, ArmFile *file, std::vector<FitParameter> *list,
                    std::vector<std::string> *notes)
{
    const JointModel &m = j.model;
    hdt_arm_friction f[2] = {m.friction[0], m.friction[1]};
    bool any = m.free_f0[0] || m.free_f0[1], all = m.free_f0[0] && m.free_f0[1];
    if (!any && !file->has(joint_key(j.rows.joint, "friction.positive.f0")))
        return;
    bool split = false;
    if (all)
        split_offset(j, f, file, list, notes);
    else if (any)
        split = split_one_way(j, m.free_f0[0] ? 0 : 1, f, file, list, notes);
    for (int way = 0; way < 2; way++) {
        std::string at = joint_key(j.rows.joint, std::string("friction.") + way_name[way] + ".");
        all = all && m.free_fv[way] && m.free_fs[way];
        const bool told = m.free_f0[way] && !split;
        // what an offset stands beside: the file's, or as little as it can be
        if (m.free_f0[way] && split && f[way].f0_nm != file->arm().joint[j.rows.joint].friction[way].f0_nm)
            file->set(at + "f0", quantity({f[way].f0_nm}, "N m", {unknown}, "output"));
        write_number(at + "f0", "N m", f[way].f0_nm, sigma_of(j, F0, way, 0), told, file, list);
        write_number(at + "fv", "N m s/rad", f[way].fv_nmspr, sigma_of(j, FV, way, 0), m.free_fv[way], file,
                     list);
        write_number(at + "fs", "N m", f[way].fs_nm, sigma_of(j, FS, way, 0), m.free_fs[way], file, list);
        write_number(at + "vc", "rad/s", f[way].vc_radps, sigma_of(j, VC, way, 0), m.free_fs[way], file,
                     list);
    }
    if (any)
        write_valid(j, all, file);
}

void write_ripple(const JointFitState &j, ArmFile *file, std::vector<FitParameter> *list)
{
    for (std::size_t k = 0; k < j.model.free_ripple.size(); k++) {
        std::string at = joint_key(j.rows.joint, "ripple." + std::to_string(k + 1) + ".");
        bool fitted = j.model.free_ripple[k];
        int line = static_cast<int>(k);
        double s = j.model.ripple[2 * k], c = j.model.ripple[2 * k + 1], a = std::hypot(s, c);
        double sigma_s = sigma_of(j, RIPPLE_SIN, 0, line), sigma_c = sigma_of(j, RIPPLE_COS, 0, line);
        double sigma_a = a > 0 ? std::hypot(s * sigma_s, c * sigma_c) / a : std::hypot(sigma_s, sigma_c);
        double sigma_p = a > 0 ? std::hypot(c * sigma_s, s * sigma_c) / (a * a) : M_PI;
        // a kept line keeps its own phase, turns and all
        double phase =
            fitted || !file->has(at + "phase") ? std::atan2(c, s) : file->get(at + "phase").value[0];
        write_number(at + "amplitude", "N m", a, sigma_a, fitted, file, list);
        if (fitted)
            file->set(at + "phase", quantity({phase}, "rad", {std::min(sigma_p, M_PI)}, ""));
        list->push_back({at + "phase", "rad", phase,
                         fitted ? std::min(sigma_p, M_PI) : file_sigma(*file, at + "phase"), fitted});
    }
}

void write_stiffness(const JointFitState &j, ArmFile *file, std::vector<FitParameter> *list)
{
    std::string table = joint_key(j.rows.joint, "stiffness");
    if (!j.model.has_stiffness) { // refuted, or never there
        file->erase(table);
        return;
    }
    for (int way = 0; way < 2; way++) {
        hdt_arm_stiffness k = j.model.stiffness[way];
        bool fitted = j.model.free_stiffness[way];
        std::string at = table + "." + way_name[way] + ".";
        double s1 = sigma_of(j, KINK_1, way, 0), s2 = sigma_of(j, KINK_2, way, 0);
        double both = j.model.cut_off[way] ? unknown : std::hypot(s1, s2);
        slopes_from(j.model.kink[way], &k);
        // the line that holds load 0 is kept: its slope is that of the gravity scale; sigma of the
        // others grows with every kink from there
        int home = home_line(k);
        const double sigma[3][3] = {{0, s1, both}, {s1, 0, s2}, {both, s1, 0}};
        const double *mine = sigma[home];
        double near = sigma_of(j, KNOT_1, way, 0);
        double far = j.model.cut_off[way] ? unknown : sigma_of(j, KNOT_2, way, 0);
        if (home == 2)
            std::swap(near, far);
        if (fitted || j.model.free_stiffness[1 - way]) { // else the mirror image of the other
            auto told = [&](double s) { return fitted ? s : unknown; };
            file->set(at + "slope", quantity({k.slope[0], k.slope[1], k.slope[2]}, "N m/N m",
                                             {told(mine[0]), told(mine[1]), told(mine[2])}, "output"));
            file->set(at + "zero", quantity({k.zero_nm}, "N m", {unknown}, "output"));
            file->set(at + "t1", quantity({k.t1_nm}, "N m", {told(near)}, "output"));
            file->set(at + "t2", quantity({k.t2_nm}, "N m", {told(far)}, "output"));
        }
        list->push_back({at + "t1", "N m", k.t1_nm, fitted ? near : file_sigma(*file, at + "t1"), fitted});
        list->push_back({at + "t2", "N m", k.t2_nm, fitted ? far : file_sigma(*file, at + "t2"), fitted});
        for (int line = 0; line < 3; line++)
            list->push_back({at + "slope." + std::to_string(line + 1), "N m/N m", k.slope[line],
                             fitted && line != home ? mine[line] : unknown, fitted && line != home});
    }
}

} // namespace

Quantity quantity(std::vector<double> value, const char *unit, std::vector<double> sigma, const char *side)
{
    Quantity q;
    q.value = std::move(value);
    q.unit = unit;
    q.source = source_id;
    q.side = side;
    if (std::all_of(sigma.begin(), sigma.end(), [](double s) { return std::isfinite(s); }))
        q.sigma = std::move(sigma);
    else
        q.confidence = "low";
    return q;
}

JointModel model_of(const hdt_arm_joint &joint)
{
    JointModel m;
    for (int way = 0; way < 2; way++) {
        if (joint.has_friction)
            m.friction[way] = joint.friction[way];
        if (!(m.friction[way].vc_radps > 0))
            m.friction[way].vc_radps = 0.1;
        if (joint.has_stiffness) {
            m.stiffness[way] = joint.stiffness[way];
            kinks_of(joint.stiffness[way], m.kink[way]);
        }
    }
    m.has_stiffness = joint.has_stiffness;
    m.free_ripple.assign(static_cast<std::size_t>(joint.ripples), 0);
    for (int k = 0; k < joint.ripples; k++) {
        m.ripple.push_back(joint.ripple[k].amplitude_nm * std::cos(joint.ripple[k].phase_rad));
        m.ripple.push_back(joint.ripple[k].amplitude_nm * std::sin(joint.ripple[k].phase_rad));
    }
    return m;
}

double sigma_of(const JointFitState &j, Kind kind, int way, int index)
{
    if (kind == FV && j.model.one_fv)
        way = 0;
    for (std::size_t k = 0; k < j.columns.size(); k++)
        if (j.columns[k].kind == kind && j.columns[k].way == way && j.columns[k].index == index)
            return j.sigma[static_cast<Index>(k)];
    return 0;
}

std::vector<FitParameter> write_joint(const JointFitState &j, ArmFile *file, std::vector<std::string> *notes)
{
    std::vector<FitParameter> list;
    write_friction(j, file, &list, notes);
    write_ripple(j, file, &list);
    write_stiffness(j, file, &list);
    return list;
}

void write_scale(const Problem &p, ArmFile *file)
{
    double scale = p.beta[0], sigma = p.beta_sigma[0];
    hdt_arm arm = file->arm();
    for (int j = 0; j < arm.joints; j++) {
        std::string link = joint_key(j, "link.");
        for (const char *name : {"mass", "first_moment"}) {
            if (!file->has(link + name))
                continue;
            Quantity q = file->get(link + name);
            std::vector<double> s;
            for (double &x : q.value) {
                s.push_back(std::fabs(x) * sigma);
                x *= scale;
            }
            file->set(link + name, quantity(q.value, q.unit.c_str(), s, q.side.c_str()));
        }
    }
}

std::vector<FitParameter> write_base(const Problem &p, ArmFile *file)
{
    std::vector<FitParameter> list;
    hdt_arm arm = file->arm();
    auto fitted = [&](int column) {
        return std::find(p.shared_free.begin(), p.shared_free.end(), column) != p.shared_free.end();
    };
    static const char *const part[10] = {"mass", "first_moment.x", "first_moment.y", "first_moment.z",
                                         "inertia_origin.xx", "inertia_origin.xy", "inertia_origin.xz",
                                         "inertia_origin.yy", "inertia_origin.yz", "inertia_origin.zz"};
    for (int j = 0; j < arm.joints; j++) {
        std::string link = joint_key(j, "link.");
        std::vector<double> value, sigma;
        for (int k = 0; k < 10; k++) {
            value.push_back(p.beta[10 * j + k]);
            sigma.push_back(p.beta_sigma[10 * j + k]);
            if (fitted(10 * j + k))
                list.push_back({link + part[k], inertial_unit[k], value.back(), sigma.back(), true});
        }
        file->set(link + "mass", quantity({0}, "kg", {0}, ""));
        file->set(link + "first_moment", quantity({value.begin() + 1, value.begin() + 4}, "kg m",
                                                  {sigma.begin() + 1, sigma.begin() + 4}, ""));
        file->set(link + "inertia_origin", quantity({value.begin() + 4, value.end()}, "kg m^2",
                                                    {sigma.begin() + 4, sigma.end()}, ""));
        int rotor = 10 * arm.joints + j;
        if (!fitted(rotor))
            continue;
        double ratio2 = arm.joint[j].ratio * arm.joint[j].ratio;
        std::string key = joint_key(j, "motor.rotor_inertia");
        file->set(key, quantity({p.beta[rotor] / ratio2}, "kg m^2", {p.beta_sigma[rotor] / ratio2}, "motor"));
        list.push_back({key, "kg m^2", p.beta[rotor] / ratio2, p.beta_sigma[rotor] / ratio2, true});
    }
    return list;
}

std::vector<int> base_candidates(const hdt_arm &arm)
{
    std::vector<int> out;
    for (int j = 0; j < arm.joints; j++) {
        for (int k : {1, 2, 4, 5, 6, 8, 9})
            out.push_back(10 * j + k);
        if (j > 0 && reflected_inertia_kgm2(arm.joint[j]) == 0)
            out.push_back(10 * arm.joints + j);
    }
    return out;
}

Eigen::VectorXd base_sizes(const hdt_arm &arm, const Problem &p)
{
    double torque = 0, reach = 0;
    double g = std::hypot(arm.gravity_mps2[0], arm.gravity_mps2[1], arm.gravity_mps2[2]);
    for (const JointFitState &j : p.joint)
        torque = std::max(torque, j.rows.y.cwiseAbs().maxCoeff());
    for (int j = 0; j < arm.joints; j++)
        reach += Eigen::Map<const Eigen::Vector3d>(arm.joint[j].origin_m).norm();
    reach = std::max(reach + Eigen::Map<const Eigen::Vector3d>(arm.flange_m).norm(), 0.1);
    double moment = torque / std::max(g, 1.0);
    Eigen::VectorXd size = Eigen::VectorXd::Constant(11 * arm.joints, moment * reach);
    for (int j = 0; j < arm.joints; j++)
        size.segment(10 * j + 1, 3).setConstant(moment);
    return size;
}

int rotor_column(const hdt_arm &arm, int column)
{
    return column < 10 * arm.joints ? -1 : column - 10 * arm.joints;
}

} // namespace hdt::fit
