// SPDX-License-Identifier: Apache-2.0
//
// What is fitted, what the data cannot tell, and the error before and after.
//
// A number counts as excited when it stands two sigma from zero, or when its sigma is below half
// of what the file says.  Otherwise the file's number is kept, or none is introduced, and the rest
// is fitted again.
//
// Owns: the order of decisions.
// Never: names a missing effect.
#include "model/ident.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "model/ident_guard.hpp"
#include "model/ident_model.hpp"
#include "model/ident_presliding.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::VectorXd;
using namespace fit;

namespace {

constexpr Index min_blocks = 50;        // of a joint
constexpr Index min_way_blocks = 30;    // in one direction
constexpr double clear_sigmas = 2;
constexpr double worth_rms = 1.06;      // eight searched numbers take 3 to 4 % off mere run scatter
constexpr double useful_sigma = 0.5;    // of the file's number
constexpr double fast_enough = 0.3;     // of the other direction's top speed
constexpr double scale_sigma_max = 0.1;
constexpr double loaded_nm = 0.5;       // rms gravity torque that can show a scale
constexpr double outer_slope_max = 0.5; // N.m/N.m, of the soft wind-up lines beyond the fall
constexpr int rounds_max = 12, searches_max = 5;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

std::string joint_name(int joint) { return "joint " + std::to_string(joint + 1); }

double rms(const VectorXd &x)
{
    return x.size() > 0 ? std::sqrt(x.squaredNorm() / static_cast<double>(x.size())) : unknown;
}

bool excited(double value, double sigma, double prior)
{
    return std::fabs(value) > clear_sigmas * sigma || (prior != 0 && sigma < useful_sigma * std::fabs(prior));
}

// A joint's state with the file's numbers beside it.
struct Fit {
    Problem problem;
    std::vector<JointModel> prior;
    std::vector<std::string> notes;
    std::vector<int> candidates;    // base parameters still allowed; empty with known masses
    bool base = false, held = false; // held: what the joints share is not fitted
    bool unknown_angles = false;    // of joints that move what a fitted one carries
};

bool spans_regions(const JointRows &r, int way, const hdt_arm_stiffness &k)
{
    Index n[3] = {0, 0, 0};
    for (Index i = 0; i < r.rows(); i++)
        if (r.share[way][i] > 0.5)
            n[r.load[i] < k.t1_nm ? 0 : r.load[i] <= k.t2_nm ? 1 : 2]++;
    return std::min({n[0], n[1], n[2]}) >= min_region_blocks;
}

// The line that holds load 0 is told apart from neither the masses nor Coulomb friction: those take
// its slope and its value.
void flatten_home(hdt_arm_stiffness *k)
{
    k->slope[home_line(*k)] = 0;
    k->zero_nm = 0;
}

void set_free(const hdt_arm_joint &joint, JointFitState *j)
{
    JointModel &m = j->model;
    for (int way = 0; way < 2; way++) {
        bool moved = (j->rows.share[way].array() > 0.5).count() >= min_way_blocks;
        m.free_f0[way] = m.free_fv[way] = m.free_fs[way] = moved;
    }
    if (m.has_stiffness) {
        bool both = spans_regions(j->rows, 0, m.stiffness[0]) && spans_regions(j->rows, 1, m.stiffness[1]);
        m.free_stiffness[0] = m.free_stiffness[1] = both;
        for (int way = 0; way < 2 && both; way++)
            flatten_home(&m.stiffness[way]);
    }
    double range = j->rows.q.maxCoeff() - j->rows.q.minCoeff();
    for (int k = 0; k < joint.ripples; k++)
        m.free_ripple[static_cast<std::size_t>(k)] = joint.ripple[k].order_rev * range > 2 * M_PI;
}

// The joints asked for, or all that have data.
std::vector<char> wanted(const hdt_arm &arm, const std::vector<int> &joints)
{
    std::vector<char> out(static_cast<std::size_t>(arm.joints), joints.empty());
    for (int j : joints) {
        if (j < 1 || j > arm.joints)
            throw InputError("joints: expected 1 to " + std::to_string(arm.joints) + ", found "
                             + std::to_string(j));
        out[static_cast<std::size_t>(j - 1)] = 1;
    }
    return out;
}

Fit start(const hdt_arm &arm, std::vector<JointRows> rows, const std::vector<int> &joints)
{
    Fit f;
    std::vector<char> want = wanted(arm, joints);
    for (std::size_t j = 0; j < rows.size(); j++) {
        if (!want[j])
            continue;
        if (rows[j].rows() < min_blocks) {
            std::string what = joint_name(static_cast<int>(j)) + ": expected at least "
                               + std::to_string(min_blocks) + " blocks in motion, found "
                               + std::to_string(rows[j].rows());
            if (!joints.empty())
                throw InputError(what + ": log it moving, or leave it out of --joints");
            f.notes.push_back(what + "; not fitted");
            continue;
        }
        JointFitState s;
        s.rows = std::move(rows[j]);
        s.model = model_of(arm.joint[j]);
        f.prior.push_back(s.model);
        set_free(arm.joint[j], &s);
        s.weight = 1 / std::max(1e-9, std::sqrt((s.rows.y.array() - s.rows.y.mean()).square().mean()));
        f.problem.joint.push_back(std::move(s));
    }
    if (f.problem.joint.empty())
        throw InputError("expected at least one joint with " + std::to_string(min_blocks)
                         + " blocks in motion, found none: log longer, or move faster than standstill");
    f.problem.beta = VectorXd::Zero(shared_columns(arm));
    f.base = !masses_known(arm);
    if (f.base) {
        f.candidates = base_candidates(arm);
        f.problem.shared_size = base_sizes(arm, f.problem);
        return f;
    }
    f.problem.beta[0] = 1;
    for (const JointFitState &j : f.problem.joint)
        if (rms(j.rows.shared.col(0)) > loaded_nm)
            f.problem.shared_free = {0};
    if (f.problem.shared_free.empty())
        f.notes.push_back("gravity scale: no joint carries load; not excited");
    return f;
}

// What the joints share stays as the file has it.
void hold_shared(Fit *f)
{
    f->held = true;
    f->problem.shared_free.clear();
    f->problem.ridge = 0;
}

// Solve; a number whose column depends on others goes back to the file's.
void solve_all(Fit *f)
{
    for (;;) {
        std::vector<std::pair<std::size_t, Column>> released = solve(&f->problem);
        if (released.empty())
            return;
        for (const auto &[k, c] : released)
            restore(f->prior[k], c, &f->problem.joint[k].model);
    }
}

void reweight(Problem *p)
{
    for (JointFitState &j : p->joint)
        j.weight = 1 / std::max(1e-9, j.rms);
}

// Base parameters for the present friction, without those that came out impossible.  All that the
// motion can show are fitted; expectations of their size keep those it hardly shows from going wild.
void choose_base(const hdt_arm &arm, Fit *f)
{
    Problem &p = f->problem;
    for (;;) {
        p.beta.setZero();
        for (const auto &[k, c] : release_dependent(&p))
            restore(f->prior[k], c, &p.joint[k].model);
        p.shared_free = independent_shared(p, f->candidates);
        p.ridge = best_ridge(p);
        solve_all(f);
        // a rotor turns with positive inertia
        std::vector<int> keep;
        for (int c : f->candidates)
            if (rotor_column(arm, c) < 0 || p.beta[c] >= 0)
                keep.push_back(c);
        if (keep.size() == f->candidates.size())
            return;
        f->candidates = keep;
    }
}

void iterate(const hdt_arm &arm, Fit *f)
{
    for (int k = 0; k < searches_max; k++) {
        if (f->base && !f->held)
            choose_base(arm, f);
        solve_all(f);
        reweight(&f->problem);
        bool moved = search_knots(&f->problem);
        moved = search_stribeck(&f->problem) || moved;
        if (!moved)
            break;
    }
    solve_all(f);
}

void release_stribeck(const JointModel &prior, int way, JointModel *m)
{
    m->free_fs[way] = false;
    m->friction[way].fs_nm = prior.friction[way].fs_nm;
    m->friction[way].vc_radps = prior.friction[way].vc_radps;
}

// Friction opposes motion at every speed the joint may have.
bool out_of_bounds(const hdt_arm_friction &f, double v_max)
{
    for (int k = 0; k <= 20; k++)
        if (stribeck_nm(f, v_max * k / 20) < 0)
            return true;
    return f.f0_nm < 0;
}

bool enforce_bounds(const hdt_arm &arm, const JointModel &prior, JointFitState *j)
{
    JointModel &m = j->model;
    bool changed = false;
    double v_max = std::max({j->rows.speed[0].maxCoeff(), j->rows.speed[1].maxCoeff(),
                             arm.joint[j->rows.joint].v_max_radps});
    for (int way = 0; way < 2; way++) {
        if (!m.free_f0[way] || !out_of_bounds(m.friction[way], v_max))
            continue;
        // Stribeck and slope first: they are what extrapolates
        if (m.free_fs[way]) {
            release_stribeck(prior, way, &m);
            changed = true;
        } else if (m.free_fv[way] && m.friction[way].fv_nmspr < 0) {
            for (int w = m.one_fv ? 0 : way; w < (m.one_fv ? 2 : way + 1); w++) {
                m.free_fv[w] = false;
                m.friction[w].fv_nmspr = std::max(0.0, prior.friction[w].fv_nmspr);
            }
            m.one_fv = false;
            changed = true;
        }
    }
    return changed;
}

// Can this direction show its viscous slope?  Not when it never gets fast beside the other, nor when
// it stays where a kept Stribeck curve still bends.
bool shows_slope(const JointFitState &j, int way)
{
    const JointModel &m = j.model;
    double top = j.rows.speed[way].maxCoeff(), other = j.rows.speed[1 - way].maxCoeff();
    bool bends = !m.free_fs[way] && m.friction[way].fs_nm != 0 && top < 2 * m.friction[way].vc_radps;
    return top > fast_enough * other && !bends;
}

// A slope that is not told apart from the file's stays the file's.  Where the file has none, the two
// directions share one before either is given up.
bool judge_viscous(const JointModel &prior, JointFitState *j)
{
    JointModel &m = j->model;
    bool told[2], changed = false;
    for (int way = 0; way < 2; way++) {
        double was = prior.friction[way].fv_nmspr;
        told[way] = excited(m.friction[way].fv_nmspr, sigma_of(*j, FV, way, 0), was)
                    && (m.one_fv || shows_slope(*j, way));
    }
    bool none = prior.friction[0].fv_nmspr == 0 && prior.friction[1].fv_nmspr == 0;
    if (none && !m.one_fv && m.free_fv[0] && m.free_fv[1] && !(told[0] && told[1])) {
        m.one_fv = true;
        return true;
    }
    for (int way = 0; way < 2; way++)
        if (m.free_fv[way] && !told[way]) {
            m.free_fv[way] = false;
            m.friction[way].fv_nmspr = prior.friction[way].fv_nmspr;
            changed = true;
        }
    m.one_fv = m.one_fv && m.free_fv[0];
    return changed;
}

// One decision a joint and round, the least identifiable first.
bool judge_friction(const JointModel &prior, JointFitState *j)
{
    JointModel &m = j->model;
    bool changed = false;
    for (int way = 0; way < 2; way++)
        if (m.free_fs[way]
            && !excited(m.friction[way].fs_nm, sigma_of(*j, FS, way, 0), prior.friction[way].fs_nm)) {
            release_stribeck(prior, way, &m);
            changed = true;
        }
    if (changed)
        return true;
    return judge_viscous(prior, j);
}

bool judge_ripple(const JointModel &prior, JointFitState *j)
{
    JointModel &m = j->model;
    bool changed = false;
    for (std::size_t k = 0; k < m.free_ripple.size(); k++) {
        if (!m.free_ripple[k])
            continue;
        int line = static_cast<int>(k);
        double sigma = std::max(sigma_of(*j, RIPPLE_SIN, 0, line), sigma_of(*j, RIPPLE_COS, 0, line));
        double now = std::hypot(m.ripple[2 * k], m.ripple[2 * k + 1]);
        double was = std::hypot(prior.ripple[2 * k], prior.ripple[2 * k + 1]);
        if (excited(now, sigma, was))
            continue;
        m.free_ripple[k] = 0;
        m.ripple[2 * k] = prior.ripple[2 * k];
        m.ripple[2 * k + 1] = prior.ripple[2 * k + 1];
        changed = true;
    }
    return changed;
}

// Are both ends of the fall in the data?  An outer line as steep as the fall is the fall itself, cut
// off where the loads end.
bool shows_fall(const JointFitState &j, int way)
{
    hdt_arm_stiffness k = j.model.stiffness[way];
    slopes_from(j.model.kink[way], &k);
    return std::fabs(k.slope[home_line(k) == 0 ? 2 : 0]) <= outer_slope_max;
}

bool tells_stiffness(const JointModel &prior, const JointFitState &j, int way)
{
    const JointModel &m = j.model;
    bool told = false;
    for (int k = 0; k < 2; k++) {
        double sigma = sigma_of(j, k == 0 ? KINK_1 : KINK_2, way, 0);
        told = told || (!(k == 1 && m.cut_off[way]) && excited(m.kink[way][k], sigma, prior.kink[way][k]));
    }
    return told && shows_fall(j, way);
}

void mirror_stiffness(int from, JointModel *m)
{
    int to = 1 - from;
    m->stiffness[to] = m->stiffness[from];
    m->stiffness[to].t1_nm = -m->stiffness[from].t2_nm;
    m->stiffness[to].t2_nm = -m->stiffness[from].t1_nm;
    std::reverse(m->stiffness[to].slope, m->stiffness[to].slope + 3);
    std::copy(m->kink[from], m->kink[from] + 2, m->kink[to]);
    m->cut_off[to] = m->cut_off[from];
}

// Lines the data cannot tell are those of the other direction, mirrored as a gear without direction
// has them; if those are not told either, they stay as the file has them.
bool judge_stiffness(const JointModel &prior, JointFitState *j)
{
    JointModel &m = j->model;
    bool told[2], changed = false;
    for (int way = 0; way < 2; way++)
        told[way] = m.free_stiffness[way] && tells_stiffness(prior, *j, way);
    for (int way = 0; way < 2; way++) {
        if (!m.free_stiffness[way] || told[way])
            continue;
        m.free_stiffness[way] = false;
        m.stiffness[way] = prior.stiffness[way];
        std::copy(prior.kink[way], prior.kink[way] + 2, m.kink[way]);
        m.cut_off[way] = prior.cut_off[way];
        changed = true;
    }
    for (int way = 0; way < 2; way++)
        if (told[way] && !m.free_stiffness[1 - way])
            mirror_stiffness(way, &m);
    return changed;
}

bool judge_scale(Fit *f)
{
    Problem &p = f->problem;
    if (f->base || p.shared_free.empty())
        return false;
    std::string why;
    if (!(p.beta_sigma[0] < scale_sigma_max))
        why = "not excited";
    else if (!(p.beta[0] > 0))
        why = "measured torque opposes gravity: check sign and zero of the joints";
    if (why.empty())
        return false;
    p.shared_free.clear();
    p.beta[0] = 1;
    f->notes.push_back("gravity scale: " + why + "; the masses were kept");
    return true;
}

bool judge(Fit *f)
{
    bool changed = judge_scale(f);
    for (std::size_t k = 0; k < f->problem.joint.size(); k++) {
        JointFitState *j = &f->problem.joint[k];
        changed = judge_friction(f->prior[k], j) || changed;
        changed = judge_ripple(f->prior[k], j) || changed;
        changed = judge_stiffness(f->prior[k], j) || changed;
    }
    return changed;
}

void settle(const hdt_arm &arm, Fit *f)
{
    for (int round = 0; round < rounds_max; round++) {
        iterate(arm, f);
        bool changed = false;
        for (std::size_t k = 0; k < f->problem.joint.size(); k++)
            changed = enforce_bounds(arm, f->prior[k], &f->problem.joint[k]) || changed;
        if (changed)
            continue;
        estimate_sigma(&f->problem);
        if (!judge(f))
            return;
    }
    solve_all(f);
    estimate_sigma(&f->problem);
}

// All joints' errors as one number: a term of one joint can push its error into the others through
// the gravity scale.
double log_rms(const Problem &p)
{
    double sum = 0;
    for (const JointFitState &j : p.joint)
        sum += std::log(std::max(1e-9, j.rms));
    return sum;
}

// Declared soft wind-up the data refute is taken out.  Judged by the error with and without, since
// its slope and the gravity scale are told apart by other joints only.  Where loads span the lines
// the term must earn its place; where they do not, it goes only if it does harm.
bool drop_stiffness(const hdt_arm &arm, Fit *f)
{
    bool dropped = false;
    for (std::size_t k = 0; k < f->problem.joint.size(); k++) {
        const JointModel &now = f->problem.joint[k].model;
        if (!now.has_stiffness)
            continue;
        bool fitted = now.free_stiffness[0] || now.free_stiffness[1];
        // both with all else free again
        Fit with = *f, without = *f;
        without.prior[k].has_stiffness = false;
        for (Fit *one : {&with, &without}) {
            JointFitState &j = one->problem.joint[k];
            j.model = one->prior[k];
            set_free(arm.joint[j.rows.joint], &j);
            iterate(arm, one);
        }
        double gain = log_rms(with.problem) - log_rms(without.problem);
        if (gain < (fitted ? -std::log(worth_rms) : std::log(worth_rms)))
            continue;
        *f = without;
        f->notes.push_back(joint_name(f->problem.joint[k].rows.joint)
                           + ": the soft wind-up the file declares is not in the data; taken out");
        dropped = true;
    }
    return dropped;
}

// Lines within the loads on the file's side of load 0: a third of the way apart, or, cut off, from half
// way to the last load.  False where the loads do not go that far.
bool place_lines(bool cut_off, JointFitState *j)
{
    JointModel &m = j->model;
    bool spanned = true;
    for (int way = 0; way < 2; way++) {
        hdt_arm_stiffness &k = m.stiffness[way];
        double side = k.t1_nm > 0 ? 1 : -1, furthest = 0;
        for (Index i = 0; i < j->rows.rows(); i++)
            if (j->rows.share[way][i] > 0.5)
                furthest = std::max(furthest, side * j->rows.load[i]);
        double inner = side * furthest / (cut_off ? 2 : 3);
        double outer = side * furthest * (cut_off ? 1.0 : 2.0 / 3);
        k.t1_nm = std::min(inner, outer);
        k.t2_nm = std::max(inner, outer);
        m.free_stiffness[way] = true;
        m.cut_off[way] = cut_off;
        flatten_home(&k);
        spanned = spanned && furthest > 0 && (cut_off || spans_regions(j->rows, way, k));
    }
    return spanned;
}

// A gear whose fall lies elsewhere than the file says: where the loads do not span the file's lines,
// lines within the loads take their place if they do markedly better.
bool find_stiffness(const hdt_arm &arm, Fit *f)
{
    bool any = false;
    for (std::size_t k = 0; k < f->problem.joint.size(); k++) {
        const JointModel &now = f->problem.joint[k].model;
        bool one_side = now.stiffness[0].t1_nm * now.stiffness[0].t2_nm > 0
                        && now.stiffness[1].t1_nm * now.stiffness[1].t2_nm > 0;
        if (!now.has_stiffness || now.free_stiffness[0] || now.free_stiffness[1] || !one_side)
            continue;
        double least = log_rms(f->problem) - std::log(worth_rms);
        Fit best = *f;
        bool found = false;
        for (bool cut_off : {false, true}) {
            Fit one = *f;
            JointFitState &j = one.problem.joint[k];
            if (!place_lines(cut_off, &j))
                continue;
            iterate(arm, &one);
            if (!(log_rms(one.problem) < least) || !shows_fall(j, 0) || !shows_fall(j, 1))
                continue;
            least = log_rms(one.problem);
            best = one;
            best.prior[k].stiffness[0] = j.model.stiffness[0];
            best.prior[k].stiffness[1] = j.model.stiffness[1];
            std::copy(&j.model.kink[0][0], &j.model.kink[0][0] + 4, &best.prior[k].kink[0][0]);
            std::copy(j.model.cut_off, j.model.cut_off + 2, best.prior[k].cut_off);
            found = true;
        }
        if (found)
            *f = best;
        any = any || found;
    }
    return any;
}

void run_fit(const hdt_arm &arm, Fit *f)
{
    settle(arm, f);
    bool found = find_stiffness(arm, f), dropped = drop_stiffness(arm, f);
    if (found || dropped)
        settle(arm, f);
}

// This joint's own gravity scale, all its other numbers free beside it.
void own_scale(const Problem &p, std::size_t k, JointFit *out)
{
    if (p.beta.size() != 1 || rms(p.joint[k].rows.shared.col(0)) <= loaded_nm)
        return;
    Problem one;
    one.joint = {p.joint[k]};
    one.shared_free = {0};
    one.beta = one.beta_sigma = VectorXd::Ones(1);
    solve(&one);
    estimate_sigma(&one);
    out->gravity_scale = one.beta[0];
    out->gravity_scale_sigma = one.beta_sigma[0];
}

void take(const VectorXd &x, std::vector<double> *to) { to->assign(x.data(), x.data() + x.size()); }

// Errors and pictures: the arm as it was and as it is now on the same rows.
void compare(const std::vector<JointRows> &before, const std::vector<JointRows> &after, bool held_out,
             JointFit *out)
{
    const JointRows &b = before[static_cast<std::size_t>(out->joint - 1)];
    const JointRows &a = after[static_cast<std::size_t>(out->joint - 1)];
    VectorXd rb = b.measured - b.declared, ra = a.measured - a.declared;
    (held_out ? out->held_out_before_nm : out->rms_before_nm) = rms(rb);
    (held_out ? out->held_out_after_nm : out->rms_after_nm) = rms(ra);
    if (b.rows() == 0)
        return;
    // runs one after the other on one axis
    VectorXd t = b.t_s;
    double shift = 0;
    for (Index i = 1; i < t.size(); i++) {
        if (b.t_s[i] < b.t_s[i - 1])
            shift += b.t_s[i - 1];
        t[i] += shift;
    }
    take(t, &out->t_s);
    take(b.q, &out->q_rad);
    take(b.v, &out->v_radps);
    take(b.measured, &out->measured_nm);
    take(rb, &out->residual_before_nm);
    take(ra, &out->residual_after_nm);
    take(a.friction, &out->friction_nm);
}

std::string file_names(const std::vector<Run> &runs)
{
    std::string out;
    for (const Run &r : runs)
        out += (out.empty() ? "" : ", ") + r.path.substr(r.path.find_last_of('/') + 1);
    return out.size() > 300 ? out.substr(0, 300) + " ..." : out;
}

void scale_notes(const Problem &p, const std::vector<JointFit> &joints, std::vector<std::string> *notes)
{
    for (const JointFit &j : joints)
        if (std::isfinite(j.gravity_scale)
            && std::fabs(j.gravity_scale - p.beta[0]) > clear_sigmas * j.gravity_scale_sigma + 0.02)
            notes->push_back(joint_name(j.joint - 1) + ": its own gravity scale is "
                             + std::to_string(j.gravity_scale) + ", the chain's " + std::to_string(p.beta[0])
                             + ": one scale for all masses does not describe this arm");
}

void cut_off_notes(const Problem &p, std::vector<std::string> *notes)
{
    for (const JointFitState &j : p.joint)
        for (int way = 0; way < 2; way++) {
            const hdt_arm_stiffness &k = j.model.stiffness[way];
            if (j.model.cut_off[way])
                notes->push_back(joint_name(j.rows.joint)
                                 + ": the loads end inside the soft wind-up's fall, at "
                                 + std::to_string(k.t1_nm > 0 ? k.t2_nm : k.t1_nm) + " N m moving "
                                 + (way == 0 ? "up" : "down") + "; beyond that the torque is held");
        }
}

void add_presliding(const std::vector<Run> &runs, const std::vector<int> &joints, double block_s,
                    IdentResult *out)
{
    if (joints.empty())
        return;
    std::vector<std::vector<FitParameter>> built_up = fit_presliding(runs, joints, block_s, &out->model);
    for (std::size_t k = 0; k < joints.size(); k++) {
        auto of = std::find_if(out->joints.begin(), out->joints.end(),
                               [&](const JointFit &j) { return j.joint == joints[k]; });
        std::vector<FitParameter> &list = of->parameters;
        list.insert(list.end(), built_up[k].begin(), built_up[k].end());
    }
}

void check_arm(const hdt_arm &arm)
{
    if (masses_known(arm))
        return;
    for (int j = 0; j < arm.joints; j++)
        if (arm.joint[j].has_stiffness || arm.joint[j].load_mu != 0)
            throw InputError(std::string(arm.path) + ": joint." + std::to_string(j + 1)
                             + ": expected link masses, which stiffness lines and load_friction need, found "
                               "none: give them or remove the term");
}

// What identification works on, and what the model given says of it.
struct Data {
    const ArmFile &file;
    const std::vector<Run> &fit_runs;
    std::vector<Conditioned> fit, test;
    std::vector<JointRows> rows, before, test_before; // rows: with columns
    double block_s;
};

Data gather(const ArmFile &file, const std::vector<Run> &fit_runs, const std::vector<Run> &test_runs,
            const IdentOptions &options)
{
    ConditionOptions how;
    how.block_s = options.block_s;
    how.reversal_guard_s = options.reversal_guard_s;
    how.reversal_travel_rad = options.reversal_travel_rad;
    Data d{file, fit_runs, condition_all(fit_runs, file.arm(), how),
           condition_all(test_runs, file.arm(), how), {}, {}, {}, options.block_s};
    d.rows = make_rows(file.arm(), d.fit, true);
    d.before = make_rows(file.arm(), d.fit, false);
    d.test_before = make_rows(file.arm(), d.test, false);
    return d;
}

// What rests on angles the runs do not have is said, and the masses are not judged by it.
void heed_unknown_angles(const Data &data, Fit *f)
{
    for (const JointFitState &j : f->problem.joint) {
        const std::size_t k = static_cast<std::size_t>(j.rows.joint);
        std::vector<std::vector<int>> per_run;
        for (const std::vector<Conditioned> *set : {&data.fit, &data.test})
            for (const Conditioned &c : *set)
                per_run.push_back(c.unknown_angles[k]);
        const std::string words = unknown_angle_words(j.rows.joint + 1, per_run);
        if (words.empty())
            continue;
        f->notes.insert(f->notes.begin(), words);
        f->unknown_angles = true;
    }
    if (!f->unknown_angles || f->base || f->problem.shared_free.empty())
        return;
    hold_shared(f);
    f->notes.push_back("gravity scale: not fitted, loads rest on unknown angles; the masses were kept");
}

// The file with the fit in it; joints in `kept` have their numbers as the file has them.
IdentResult write_fit(const Data &data, const Fit &f, const std::vector<int> &kept)
{
    IdentResult out{data.file, {}, {}, f.notes};
    out.model.set_text("sources.IDENT", "hdt ident on " + file_names(data.fit_runs));
    if (f.base && !f.problem.shared_free.empty())
        out.chain = write_base(f.problem, &out.model);
    else if (!f.base) {
        bool scaled = !f.problem.shared_free.empty();
        double sigma = scaled ? f.problem.beta_sigma[0] : unknown;
        out.chain.push_back({"gravity_scale", "1", f.problem.beta[0], sigma, scaled});
        if (scaled)
            write_scale(f.problem, &out.model);
    }
    cut_off_notes(f.problem, &out.notes);
    std::vector<int> fitted;
    for (std::size_t k = 0; k < f.problem.joint.size(); k++) {
        JointFit j = {};
        const JointRows &r = f.problem.joint[k].rows;
        j.joint = r.joint + 1;
        j.rows = static_cast<std::size_t>(r.rows());
        j.masked = r.masked;
        j.parameters = write_joint(f.problem.joint[k], &out.model, &out.notes);
        j.held_out_before_nm = j.held_out_after_nm = unknown;
        j.gravity_scale = j.gravity_scale_sigma = unknown;
        if (!f.unknown_angles)
            own_scale(f.problem, k, &j);
        j.friction = compare_friction(f.problem, f.problem.joint[k]);
        out.joints.push_back(j);
        if (std::find(kept.begin(), kept.end(), j.joint) == kept.end())
            fitted.push_back(j.joint);
    }
    if (!f.base)
        scale_notes(f.problem, out.joints, &out.notes);
    if (data.fit_runs.size() < 4)
        out.notes.push_back("fewer than four runs: sigma does not hold scatter from run to run");
    out.model.refresh();
    add_presliding(data.fit_runs, fitted, data.block_s, &out);
    out.model.refresh();
    return out;
}

struct Judged {
    IdentResult result;
    std::vector<int> worse;         // joints, 1-based
    double log_error;               // of all joints together, on the runs that judge
};

std::string figures(double before, double after, bool held_out)
{
    char text[120];
    std::snprintf(text, sizeof text, "%.4g N m with the model given, %.4g with the fit, on the %s runs",
                  before, after, held_out ? "test" : "fit");
    return text;
}

// The model as written, read back, beside the model given.
Judged judge_written(const Data &data, IdentResult result)
{
    const ArmFile back = ArmFile::parse(result.model.text(), "model.toml");
    std::vector<JointRows> after = make_rows(back.arm(), data.fit, false);
    std::vector<JointRows> test_after = make_rows(back.arm(), data.test, false);
    Judged out{std::move(result), {}, 0};
    for (JointFit &j : out.result.joints) {
        const std::size_t k = static_cast<std::size_t>(j.joint - 1);
        compare(data.before, after, false, &j);
        if (!data.test.empty())
            compare(data.test_before, test_after, true, &j);
        const bool held_out = data.test_before[k].rows() > 0;
        const JointRows &now = held_out ? test_after[k] : after[k];
        if (clearly_worse(held_out ? data.test_before[k] : data.before[k], now))
            out.worse.push_back(j.joint);
        out.log_error += std::log(std::max(1e-9, error_nm(now)));
    }
    return out;
}

std::string figures(const JointFit &j)
{
    bool held_out = std::isfinite(j.held_out_after_nm);
    return held_out ? figures(j.held_out_before_nm, j.held_out_after_nm, true)
                    : figures(j.rms_before_nm, j.rms_after_nm, false);
}

const JointFit &of_joint(const IdentResult &r, int joint)
{
    return *std::find_if(r.joints.begin(), r.joints.end(),
                         [&](const JointFit &j) { return j.joint == joint; });
}

// Joints the fit makes worse than the model given keep what the file has of them, and it is said.
Judged keep_worse(const Data &data, Fit f)
{
    Judged out = judge_written(data, write_fit(data, f, {}));
    if (out.worse.empty())
        return out;
    std::vector<std::string> notes;
    for (JointFitState &j : f.problem.joint) {
        const int joint = j.rows.joint + 1;
        if (std::find(out.worse.begin(), out.worse.end(), joint) == out.worse.end())
            continue;
        j.model = model_of(data.file.arm().joint[j.rows.joint]);
        j.columns.clear();
        notes.push_back("joint " + std::to_string(joint) + ": its numbers were kept as they were: "
                        + figures(of_joint(out.result, joint)) + ": what these runs showed does not hold");
    }
    Judged kept = judge_written(data, write_fit(data, f, out.worse));
    if (!kept.worse.empty() && kept.log_error > out.log_error) // they went with the masses as they were
        return out;
    kept.result.notes.insert(kept.result.notes.begin(), notes.begin(), notes.end());
    return kept;
}

} // namespace

IdentResult identify(const ArmFile &file, const std::vector<Run> &fit_runs, const std::vector<Run> &test_runs,
                     const IdentOptions &options)
{
    const hdt_arm &arm = file.arm();
    check_arm(arm);
    if (fit_runs.empty())
        throw InputError("expected at least one run to fit, found none");
    const Data data = gather(file, fit_runs, test_runs, options);
    Fit f = start(arm, data.rows, options.joints);
    heed_unknown_angles(data, &f);
    run_fit(arm, &f);
    Judged out = keep_worse(data, f);
    if (out.worse.empty() || f.problem.shared_free.empty())
        return out.result;
    // a joint is still worse, for the sake of numbers all joints share: those of the file, then
    Fit held = start(arm, data.rows, options.joints);
    heed_unknown_angles(data, &held);
    hold_shared(&held);
    run_fit(arm, &held);
    Judged without = keep_worse(data, held);
    const bool base_pays = f.base && out.log_error < without.log_error;
    for (int joint : out.worse) {
        const std::string what = joint_name(joint - 1) + ": " + figures(of_joint(out.result, joint));
        if (base_pays)
            out.result.notes.insert(out.result.notes.begin(),
                                    what + ": the masses fitted for all joints do not hold for this one");
        else
            without.result.notes.insert(without.result.notes.begin(),
                                        what + ": the masses were kept for its sake; to scale them by the "
                                               "other joints alone, give those with --joints");
    }
    return base_pays ? out.result : without.result;
}

} // namespace hdt
