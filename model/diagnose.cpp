// SPDX-License-Identifier: Apache-2.0
//
// The order of a diagnosis: condition, weigh, take in, weigh again, judge on held-out runs, adopt.
//
// Owns: which runs count as independent, rounds of selection, the order of the parts.
// Never: looks at held-out runs before the choice is made.
#include "model/diagnose.hpp"

#include <algorithm>
#include <functional>
#include <thread>

#include "model/diagnose_parts.hpp"
#include "model/text.hpp"

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using namespace diag;

namespace {

constexpr int kEffectsMax = 4;
constexpr Index kRowsMin = 400;            // per joint over all fit runs
// of the evidence: within it the chain effect first in the list is taken
constexpr double kChainTie = 0.98;
constexpr int kEventPasses = 3;            // the last only fits
constexpr double kPiece_s = 20;
constexpr double kReversalGuard_s = 0.03;  // velocity estimate and gear wind-up settle within this
// lost motion and wind-up of a reversal: no term describes it to the end
constexpr double kReversalTravel_rad = 0.002;
constexpr const char *kChainIds[] = {"payload", "base_tilt", "link_mass"}; // in order of preference

using RunBlocks = std::vector<std::vector<BlockRows>>; // [run][joint]

// Files cut from one recording follow each other in time: they are one run.
std::size_t independent_runs(const std::vector<Run> &runs)
{
    std::vector<std::pair<double, double>> span;
    for (const Run &r : runs)
        if (r.rows() > 1)
            span.emplace_back(r.t_s.front(), r.t_s.back());
    std::sort(span.begin(), span.end());
    std::size_t n = span.empty() ? 0 : 1;
    for (std::size_t i = 1; i < span.size(); ++i) {
        const double gap = span[i].first - span[i - 1].second;
        n += !(gap >= 0 && gap < 0.1);
    }
    return n;
}

// Each run is given back as soon as it is read: ten minutes of seven joints are a tenth of a gigabyte.
RunBlocks read_blocks(const hdt_arm &arm, std::vector<Run> runs, bool to_fit, const DiagnoseOptions &options)
{
    ConditionOptions co;
    co.block_s = options.block_s;
    co.reversal_guard_s = kReversalGuard_s;
    co.reversal_travel_rad = kReversalTravel_rad;
    co.soft_margin_nm = fall_margin_nm;
    RunBlocks out;
    for (Run &r : runs) {
        out.push_back(block_rows(arm, condition(r, arm, co), r, to_fit));
        r = {};
    }
    return out;
}

// Too few runs to compare: each is cut into pieces of equal time, at least four in all.
RunBlocks cut_pieces(const RunBlocks &runs)
{
    RunBlocks out;
    for (const auto &joints : runs) {
        double end = 0;
        for (const BlockRows &b : joints)
            end = b.size() > 0 ? std::max(end, b.t_s[b.size() - 1]) : end;
        const auto want = static_cast<int>((kRunsMin + runs.size() - 1)
                                           / std::max<std::size_t>(runs.size(), 1));
        const int pieces = std::clamp(static_cast<int>(end / kPiece_s), want, 12);
        for (int p = 0; p < pieces; ++p) {
            std::vector<BlockRows> piece;
            for (const BlockRows &b : joints) {
                const auto at = [&](int k) {
                    const double t = end * k / pieces;
                    return k == pieces
                               ? b.size()
                               : std::lower_bound(b.t_s.data(), b.t_s.data() + b.size(), t) - b.t_s.data();
                };
                piece.push_back(b.slice(at(p), at(p + 1)));
            }
            out.push_back(std::move(piece));
        }
    }
    return out;
}

void parallel(std::size_t n, const std::function<void(std::size_t)> &work)
{
    const std::size_t workers = std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1, 8);
    std::vector<std::exception_ptr> failed(n);
    std::vector<std::thread> pool;
    for (std::size_t w = 0; w < std::min(workers, n); ++w)
        pool.emplace_back([&, w] {
            for (std::size_t i = w; i < n; i += workers) {
                try {
                    work(i);
                } catch (...) {
                    failed[i] = std::current_exception();
                }
            }
        });
    for (std::thread &t : pool)
        t.join();
    for (const auto &f : failed)
        if (f)
            std::rethrow_exception(f);
}

Found found_from(const JointWork &w, std::size_t family)
{
    Found f;
    f.family = w.families[family];
    f.at = w.scores[family].at;
    f.p_adjusted = w.scores[family].p_adjusted;
    return f;
}

// The chain effect that explains most, if one stands against every joint's own best explanation.
bool take_chain(Works &works, const Gates &gates)
{
    std::vector<ChainScore> scores(std::size(kChainIds));
    parallel(scores.size(), [&](std::size_t k) {
        const auto has = [&](const Found &f) { return f.family.id == kChainIds[k]; };
        if (!works.empty() && std::none_of(works[0]->found.begin(), works[0]->found.end(), has))
            scores[k] = weigh_chain(works, kChainIds[k], gates);
    });
    const ChainScore *best = nullptr;
    for (const ChainScore &c : scores)
        if (c.passes && (!best || c.total > best->total / kChainTie))
            best = &c;
    if (!best)
        return false;
    for (std::size_t j = 0; j < works.size(); ++j) {
        JointWork &w = *works[j];
        Found f;
        f.family = *std::find_if(w.families.begin(), w.families.end(),
                                 [&](const Family &k) { return k.id == best->id && k.chain; });
        f.at = best->at;
        f.chain_theta = best->theta;
        f.chain_covariance = best->covariance;
        f.ambiguous = best->ambiguous[j];
        f.p_adjusted = best->p_adjusted;
        w.found.push_back(std::move(f));
        w.stale = true;
    }
    return true;
}

// A joint's own effect; returns true when one was taken in.
bool take_own(JointWork &w, const Choice &c, Found *axis)
{
    if (c.unnamed) {
        *axis = found_from(w, c.families[0]);
        return false;
    }
    for (const std::size_t k : c.families) {
        if (static_cast<int>(w.found.size()) >= kEffectsMax)
            return !c.families.empty();
        Found f = found_from(w, k);
        f.ambiguous = c.ambiguous;
        w.refine(&f);
        if (f.family.id == "order_line" && w.beside_ripple(f.at.x))
            for (const char *id : {"eccentricity", "joint_offset"})
                f.ambiguous.push_back(id);
        w.found.push_back(std::move(f));
        w.stale = true;
    }
    return !c.families.empty();
}

// Rounds until nothing more is found.  axes[j]: a free axis that beat every name, or empty.
void select(Works &works, const Gates &gates, std::vector<Found> *axes)
{
    axes->assign(works.size(), {});
    for (int round = 0; round <= kEffectsMax; ++round) {
        parallel(works.size(), [&](std::size_t j) {
            if (works[j]->stale)
                works[j]->assess(gates);
        });
        if (round == kEffectsMax)
            break;
        if (take_chain(works, gates))
            continue;
        bool any = false;
        for (std::size_t j = 0; j < works.size(); ++j) {
            if (!(*axes)[j].family.id.empty())
                continue;
            const Choice c = choose(*works[j]);
            any = take_own(*works[j], c, &(*axes)[j]) || any;
        }
        if (!any)
            break;
    }
}

// The joints to look at, and why the others are left out.
Works make_works(const hdt_arm &arm, RunBlocks fit, const RunBlocks &test, const DiagnoseOptions &options,
                 std::vector<std::pair<int, std::string>> *skipped)
{
    Works out;
    for (int j = 0; j < arm.joints; ++j) {
        if (!options.joints.empty()
            && std::find(options.joints.begin(), options.joints.end(), j + 1) == options.joints.end())
            continue;
        std::vector<BlockRows> f, t;
        Index rows = 0, held = 0;
        for (auto &run : fit) {
            f.push_back(std::move(run[static_cast<std::size_t>(j)]));
            rows += f.back().size();
        }
        for (const auto &run : test) {
            t.push_back(run[static_cast<std::size_t>(j)]);
            held += t.back().size();
        }
        if (rows < kRowsMin || held == 0) {
            skipped->emplace_back(j + 1, filled("it hardly moves: %.0f blocks to fit, %.0f held out",
                                                static_cast<double>(rows), static_cast<double>(held)));
            continue;
        }
        out.push_back(std::make_unique<JointWork>(arm, j, std::move(f), std::move(t)));
    }
    return out;
}

void check_options(const hdt_arm &arm, const std::vector<Run> &fit, const std::vector<Run> &test,
                   const DiagnoseOptions &o)
{
    if (fit.empty() || test.empty())
        throw InputError("diagnose: expected at least one run to fit and one held out, found "
                         + std::to_string(fit.size()) + " and " + std::to_string(test.size())
                         + ": hdt log cut divides one long log");
    for (int j : o.joints)
        if (j < 1 || j > arm.joints)
            throw InputError("diagnose: joint " + std::to_string(j) + ": expected 1.."
                             + std::to_string(arm.joints));
    for (const Run &f : fit)
        for (const Run &t : test)
            if (!f.path.empty() && f.path == t.path)
                throw InputError(f.path
                                 + ": given both to fit and to test: a held-out run must not be fitted");
}

void declared_sigma(const ArmFile &arm, JointWork *w)
{
    const char *const way[] = {"positive", "negative"};
    for (int d = 0; d < 2; ++d) {
        const std::string key = "joint." + std::to_string(w->joint + 1) + ".friction." + way[d] + ".f0";
        if (!arm.has(key))
            continue;
        const Quantity f0 = arm.get(key);
        w->f0_sigma_nm[d] = f0.sigma.empty() ? 0 : f0.sigma[0];
    }
}

// The runs to fit, each joint without its own events.
RunBlocks mask_events(const RunBlocks &runs, const std::vector<Event> &events)
{
    RunBlocks out = runs;
    for (auto &joints : out)
        for (std::size_t j = 0; j < joints.size(); ++j) {
            std::vector<Event> mine;
            for (const Event &e : events)
                if (e.joint == static_cast<int>(j) + 1)
                    mine.push_back(e);
            joints[j] = without_events(joints[j], mine);
        }
    return out;
}

// All that repeats, with its evidence.
void find_effects(Works &works, const Gates &gates, std::vector<Start> *start, std::vector<Found> *axes)
{
    parallel(works.size(), [&](std::size_t j) {
        works[j]->assess(gates);
        const Gram g = works[j]->evidence().gram({});
        MatrixXd cov;
        Start &s = (*start)[j];
        s.refit = fit_from(g, 0, &cov).nuisance.head(kFriction);
        s.refit_sigma = cov.diagonal().head(kFriction).cwiseMax(0.0).cwiseSqrt();
        const MatrixXd of_friction = cov.topLeftCorner(kFriction, kFriction);
        s.refit_stands = s.refit.dot(of_friction.ldlt().solve(s.refit)) >= kSure * kFriction
                         && left_out_rms(g) < left_out_rms(g, kFriction);
        (*start)[j].tried = list_candidates(*works[j], gates);
    });
    select(works, gates, axes);
    parallel(works.size(), [&](std::size_t j) {
        JointWork &w = *works[j];
        // what is left is estimated anew without what was taken out
        while (prune(w))
            w.assess(gates);
        const auto offset = w.weigh_offset(gates);
        if ((*axes)[j].family.id.empty() && offset && offset->passes)
            w.offset = offset;
    });
}

} // namespace

bool JointDiagnosis::refuses() const
{
    return std::any_of(effects.begin(), effects.end(), [](const Effect &e) { return !e.refused.empty(); });
}

Diagnosis diagnose(const ArmFile &arm, std::vector<Run> fit, std::vector<Run> test,
                   const DiagnoseOptions &options)
{
    check_options(arm.arm(), fit, test, options);
    const Gates gates;
    const Independent runs = {independent_runs(fit), options.few_runs};
    RunBlocks fit_blocks = read_blocks(arm.arm(), std::move(fit), true, options);
    const RunBlocks test_blocks = read_blocks(arm.arm(), std::move(test), false, options);
    if (fit_blocks.size() < kRunsMin)
        fit_blocks = cut_pieces(fit_blocks);

    Diagnosis out{arm, {}, {}};
    Works works;
    std::vector<Start> start;
    std::vector<Found> axes;
    std::vector<Event> events;
    for (int pass = 0; pass < kEventPasses; ++pass) {
        out.skipped.clear();
        works = make_works(arm.arm(), mask_events(fit_blocks, events), test_blocks, options, &out.skipped);
        for (auto &w : works)
            declared_sigma(arm, w.get());
        start.assign(works.size(), {});
        find_effects(works, gates, &start, &axes);
        std::vector<std::vector<Event>> more(works.size());
        parallel(works.size(), [&](std::size_t j) { more[j] = find_events(*works[j], axes[j]); });
        const std::size_t before = events.size();
        if (pass + 1 < kEventPasses)
            for (const auto &m : more)
                events.insert(events.end(), m.begin(), m.end());
        if (events.size() == before)
            break;
    }
    std::vector<Judged> judged(works.size());
    parallel(works.size(), [&](std::size_t j) {
        judged[j] = judge_whole_or_part(arm.arm(), *works[j], axes[j], start[j], runs, gates);
    });
    adopt(&out.model, works, start, &judged);
    parallel(works.size(), [&](std::size_t j) {
        Judged &g = judged[j];
        pictures(*works[j], g.shown, g.axis, &g.d);
        put_all_words(runs, start[j], events, &g);
    });
    for (Judged &g : judged)
        out.joints.push_back(std::move(g.d));
    return out;
}

} // namespace hdt
