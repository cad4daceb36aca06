// SPDX-License-Identifier: Apache-2.0
//
// Owns: a joint's diagnosis as sentences.
// Never: decides anything.
#include "model/diagnose_parts.hpp"

#include <algorithm>

#include "model/text.hpp"

namespace hdt::diag {

namespace {

std::string list(const std::vector<std::string> &items)
{
    std::string out;
    for (const std::string &s : items)
        out += (out.empty() ? "" : ", ") + s;
    return out;
}

std::string numbers(const Effect &e)
{
    std::string out;
    for (const EffectParameter &p : e.parameters)
        out += (out.empty() ? "" : ", ") + p.name + " " + filled("%.4g", p.value)
               + (p.sigma > 0 ? filled(" +- %.2g", p.sigma) : "");
    return out;
}

// Of a joint that takes nothing in: whether it has part in what the whole arm takes in.
std::string nothing_adopted(const JointDiagnosis &d)
{
    std::vector<std::string> ids;
    for (const Effect &e : d.effects)
        if (e.adopted)
            ids.push_back(e.id);
    if (ids.empty())
        return "nothing is adopted; held-out error" + filled(" %.3g N.m", d.rms_before_nm);
    return "only what other joints show of the whole arm is adopted (" + list(ids) + "); held-out error"
           + filled(" %.3g -> %.3g N.m", d.rms_before_nm, d.rms_after_nm);
}

std::string nothing_found(const JointDiagnosis &d)
{
    if (!d.unexplained())
        return "Nothing is missing that these runs could show";
    return "Something is missing that no effect explains on runs left out: "
           + filled("%.2g times the noise floor is left", d.rms_after_nm / d.noise_floor_nm);
}

void put_words(std::size_t runs, JointDiagnosis *d, const std::string &doubt)
{
    const std::string errors = filled("held-out error %.3g -> %.3g N.m (noise floor %.3g)", d->rms_before_nm,
                                      d->rms_explained_nm, d->noise_floor_nm);
    const std::string few =
        runs >= kRunsMin
            ? ""
            : filled(" Only %.0f independent run(s): pieces of a run are not independent evidence.",
                     static_cast<double>(runs));
    std::string names;
    for (const Effect &e : d->effects)
        names += (names.empty() ? "" : " and ")
                 + (e.id == "unnamed" ? "something that depends on " + e.axis : e.id)
                 + (e.parameters.empty() ? "" : " (" + numbers(e) + ")");
    if (d->verdict == "named")
        d->words = "The model lacks " + names + "; " + errors + ".";
    else if (d->verdict == "unnamed")
        d->words = "The model lacks " + names + ", none of the known effects explains it; " + errors
                   + " with a table over that axis.";
    else if (d->verdict == "suspect")
        d->words = "Perhaps " + names + ", but " + doubt + "; " + nothing_adopted(*d)
                   + filled(" (noise floor %.3g).", d->noise_floor_nm);
    else
        d->words = nothing_found(*d) + "; held-out error"
                   + filled(" %.3g N.m (noise floor %.3g).", d->rms_before_nm, d->noise_floor_nm);
    const auto is = [&](const char *id) {
        return std::any_of(d->effects.begin(), d->effects.end(), [&](const Effect &e) { return e.id == id; });
    };
    if (d->verdict == "named" && is("torque_offset"))
        d->words += " Sliding cannot tell an offset from Coulomb friction that differs by direction.";
    if (d->verdict == "named" && is("external_vibration"))
        d->words +=
            " A vibration has its own phase in every run: it is no part of a model, look for its source.";
    if (!d->ambiguous_with.empty() && d->verdict != "nothing")
        d->words += " These runs cannot tell it from " + list(d->ambiguous_with) + ".";
    d->words += few;
}

void put_friction(const Start &start, JointDiagnosis *d)
{
    d->words += filled(" Its friction has changed: Coulomb %+.3g and %+.3g N.m", start.refit[0],
                       start.refit[1])
                + filled(" (positive, negative), viscous %+.3g and %+.3g N.m.s/rad;", start.refit[2],
                         start.refit[3])
                + filled(" with that in the model the held-out error is %.3g N.m.", d->rms_after_nm);
}

// The model written, and why a part of what was found is not in it.
void put_refused(JointDiagnosis *d)
{
    if (!d->refuses())
        return;
    d->words += filled(" Of the model written it is %.3g N.m.", d->rms_after_nm);
    for (const Effect &e : d->effects)
        if (!e.refused.empty())
            d->words += " " + (e.axis.empty() ? e.id : "The curve over " + e.axis) + " is not adopted: "
                        + e.refused + ".";
}

void put_events(const std::vector<Event> &events, JointDiagnosis *d)
{
    std::string words;
    for (const Event &e : events) {
        if (e.joint != d->joint)
            continue;
        d->events.push_back({e.run, e.from_s, e.to_s, e.kind, e.torque_nm, e.angle_rad, e.log_likelihood});
        words += (words.empty() ? "" : ", ") + e.run + filled(" from %.1f to %.1f s: ", e.from_s, e.to_s)
                 + (e.kind == "angle" ? filled("the angle off by %.2g rad", e.angle_rad)
                                      : e.kind + filled(" off by %.2g N.m", e.torque_nm));
    }
    if (!words.empty())
        d->words += " In part of a run only, left out of the fit and of the model: " + words + ".";
}

} // namespace

void put_all_words(const Independent &runs, const Start &start, const std::vector<Event> &events, Judged *g)
{
    put_words(runs.count, &g->d, g->doubt);
    if (g->d.friction_refitted)
        put_friction(start, &g->d);
    if (!g->dropped.empty())
        g->d.words += " More was looked at (" + g->dropped + "), but does not help on the held-out runs.";
    put_refused(&g->d);
    put_events(events, &g->d);
}

} // namespace hdt::diag
