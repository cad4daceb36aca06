// SPDX-License-Identifier: Apache-2.0
//
// Proof of the diagnosis: many arms with something hidden in them, each diagnosed from logs by a
// process of its own, and the answers counted against the truth.
//
// Owns: the list of cases, what counts as right, the figures and their bounds, the page.
// Never: estimates an effect; hands the truth to the diagnosis, which is given logs and a model only.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace hdt::bench {

// Null: nothing but noise.  Named: one effect of the list.  Outside: one without a name, or that
// sliding cannot show.  Part: something in one run of eight only.  Two: two effects on one joint.
enum class Group { Null, Named, Outside, Part, Two };

// An effect as the plant takes it, but for its size.
struct Kind {
    const char *id;
    Group group;
    double guess, most;        // size at a floor of 1 N.m to calibrate from; beyond `most`: not made
    const char *options;       // ":key=value,..." or empty
    const char *axes;          // without a name: words the diagnosis may list its axis by; "": none is right
};
const std::vector<Kind> &kinds();
const Kind &kind_of(const std::string &id); // throws InputError

struct Case {
    std::string name;                // tells all: the case again by --only
    Group group = Group::Null;
    std::vector<std::string> ids;    // Null: the noise family
    int joint = 0;                   // 1-based, where it is judged; 0: on all
    double rho = 0;                  // wanted contribution over floor
    int specimen = 1, set = 0;       // which arm; which eight seeds
    int only_run = -1;               // Part: the run it is in
};

struct Size {
    int specimens = 3, sets = 8;     // healthy sets per specimen; each is a null log of family "plain"
    int nulls = 12;                  // of each other noise family
    int repeats = 3;                 // of each effect and rho
    int seconds = 30;                // of a run
};
// The whole list; the same size gives the same list.
std::vector<Case> all_cases(const Size &size);
const std::vector<std::string> &noise_families(); // "plain" first: the healthy sets themselves

// What the diagnosis said of one joint.
struct Answer {
    std::string verdict;                       // named, unnamed, suspect, nothing; empty: left out
    std::vector<std::string> names, axes, ambiguous;
    std::vector<std::string> event_runs;       // files of which a part is called an event
    bool adopted = false;                      // all that is said of it is in the model file written
    // after: with all that is named, in the model file or not
    double floor_nm = 0, before_nm = 0, refit_nm = 0, after_nm = 0;
};
// Of a diagnosis.json; throws InputError naming the key that is missing.  One entry per joint, 1..joints.
std::vector<Answer> read_answers(const nlohmann::json &diagnosis, int joints);

struct Outcome {
    Case c;
    std::vector<std::string> hidden;           // as given to hdt sim
    std::string failure;                       // why there is no answer; empty: there is
    std::vector<Answer> answer;                // per joint
    std::vector<double> rho;                   // per joint: contribution over floor, reached
    double oracle_nm = 0;                      // joint's held-out error with the effect taken off exactly
    double adopted_nm = 0;                     // held-out error of the model file written; 0: not read back
};

// Judgement of one case on the joint it is about.
struct Score {
    bool detected = false;           // something is said: named, or put to an axis
    bool first = false;              // the right name and no other before it
    bool in_set = false;             // the right name, or printed as one that cannot be told from it
    bool wrong = false;              // a name, and the right one not even in the set
    bool extra = false;              // a further name beside the right one
    bool axis = false;               // the right axis, or the right name
    bool located = false;            // Part: an event in the run it is in, and in no other
};
Score score(const Outcome &o);
// The rho that was wanted, within a factor of 1.5: what is further off counts for nothing at that rho.
bool aimed(const Outcome &o);
// Held-out error after, as far as it can be checked: of the model file read back, else as printed.
double after_nm(const Outcome &o);
// Share of the reducible mean square that was taken off: 1 is the oracle.
double recovered(const Outcome &o);
bool made_worse(const Outcome &o);             // by more than 2 %

struct Bounds { double lo, hi; };
// Clopper and Pearson, two-sided 95 %; n = 0 gives 0 and 1.
Bounds exact_bounds(int k, int n);
// Linear between order statistics; NaN of nothing.
double quantile(std::vector<double> x, double share);

// Root mean square of what friction, free in Coulomb and viscous part and by direction, cannot take
// over of a torque; rows at rest (below 0.005 rad/s) count for nothing.
double reducible_rms(const std::vector<double> &torque_nm, const std::vector<double> &v_radps);

// One page of Markdown.
struct PageHead { std::string command, version; Size size; double minutes = 0; };
std::string page(const PageHead &head, const std::vector<Outcome> &outcomes);

// The rig ------------------------------------------------------------------------------------------

struct Place {
    std::string hdt = "build/hdt", arm = "model/arms/pa10.toml", out = "build/bench-diagnosis";
    int workers = 4;
    bool keep = false;               // logs of the cases too
    std::string joints;              // diagnosed, as in 2,4; empty: all
};
// Commissions, simulates, diagnoses, scores; only cases whose name is `only` when not empty, and what
// they need.  Throws InputError when the arm cannot be commissioned; a case that fails says so itself.
std::vector<Outcome> run_cases(const Place &place, const Size &size, const std::vector<Case> &cases,
                               const PageHead &head);

} // namespace hdt::bench
