// SPDX-License-Identifier: Apache-2.0
//
// Cases, judgement, bounds (see bench_diagnosis.hpp).  Pure: no file, no process, no clock.
#include "tools/bench_diagnosis.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>
#include <nlohmann/json.hpp>

#include "model/arm_file.hpp"

namespace hdt::bench {

namespace {

constexpr double kAtRest_radps = 0.005, kConfidence = 0.95, kWorse = 1.02, kAim = 1.5;
constexpr int kJoints[] = {2, 4, 6}; // large, middle and small gear, all carrying a load

template <class T> bool has(const std::vector<T> &list, const T &what)
{
    return std::find(list.begin(), list.end(), what) != list.end();
}

std::string number(double x)
{
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%g", x);
    return buffer;
}

std::string two_digits(int k)
{
    return (k < 10 ? "0" : "") + std::to_string(k);
}

// Spread over joints, specimens and sets so that no effect meets one of them only.
void place(Case *c, const Size &size, int kind, int repeat)
{
    c->joint = kJoints[(repeat + kind) % 3];
    c->specimen = 1 + (repeat + repeat / 3 + 2 * kind) % size.specimens;
    c->set = (3 * kind + 5 * repeat + repeat / size.sets) % size.sets;
}

void add_nulls(std::vector<Case> *out, const Size &size)
{
    for (std::size_t f = 0; f < noise_families().size(); f++) {
        const int count = f == 0 ? size.specimens * size.sets : size.nulls;
        for (int k = 0; k < count; k++) {
            Case c;
            c.name = "null/" + noise_families()[f] + "/" + two_digits(k);
            c.ids = {noise_families()[f]};
            c.specimen = 1 + k % size.specimens;
            c.set = (k / size.specimens) % size.sets;
            // beyond the healthy sets the motions are new ones
            if (f > 0)
                c.set += size.sets * (1 + static_cast<int>(f));
            out->push_back(std::move(c));
        }
    }
}

Case effect_case(const std::vector<std::string> &ids, Group group, double rho, int kind, int repeat,
                 const Size &size)
{
    Case c;
    c.group = group;
    c.ids = ids;
    place(&c, size, kind, repeat);
    c.rho = rho;
    for (const std::string &id : ids)
        c.name += (c.name.empty() ? "" : "+") + id;
    c.name += "@" + std::to_string(c.joint) + "/" + number(rho) + "/" + two_digits(repeat);
    if (group == Group::Part)
        c.only_run = 2;
    return c;
}

// Binomial probability of at most k of n.
double at_most(int k, int n, double p)
{
    double sum = 0;
    for (int i = 0; i <= k; i++)
        sum += std::exp(std::lgamma(n + 1.0) - std::lgamma(i + 1.0) - std::lgamma(n - i + 1.0)
                        + i * std::log(p) + (n - i) * std::log1p(-p));
    return sum;
}

// Where a falling function of p crosses a level.
template <class F> double crossing(F falls, double level)
{
    double lo = 0, hi = 1;
    for (int i = 0; i < 60; i++) {
        const double mid = (lo + hi) / 2;
        (falls(mid) > level ? lo : hi) = mid;
    }
    return (lo + hi) / 2;
}

Answer read_answer(const nlohmann::json &j)
{
    Answer a;
    a.verdict = j.at("verdict").get<std::string>();
    a.floor_nm = j.at("noise_floor_nm").get<double>();
    a.before_nm = j.at("rms_before_nm").get<double>();
    a.refit_nm = j.at("rms_refit_nm").get<double>();
    a.after_nm = j.value("rms_explained_nm", j.at("rms_after_nm").get<double>());
    a.ambiguous = j.at("ambiguous_with").get<std::vector<std::string>>();
    for (const auto &e : j.value("events", nlohmann::json::array()))
        a.event_runs.push_back(e.at("run").get<std::string>());
    const bool takes = a.verdict == "named" || a.verdict == "unnamed";
    a.adopted = takes ? !j.at("effects").empty() : j.at("friction_refitted").get<bool>();
    for (const auto &e : j.at("effects")) {
        a.adopted = a.adopted && (!takes || e.at("adopted").get<bool>());
        const std::string id = e.at("id").get<std::string>();
        if (id == "unnamed")
            a.axes.push_back(e.at("axis").get<std::string>());
        else
            a.names.push_back(id);
    }
    return a;
}

bool names_something(const Answer &a)
{
    return (a.verdict == "named" || a.verdict == "unnamed") && !a.names.empty();
}

// One of the words, at the start of an axis' name: "q" stands for the joint's own angle.
bool axis_is(const std::string &axis, const std::string &words, int joint)
{
    for (std::size_t from = 0; from < words.size();) {
        const std::size_t end = std::min(words.find(' ', from), words.size());
        std::string word = words.substr(from, end - from);
        if (word == "q")
            word += std::to_string(joint);
        if (axis.compare(0, word.size(), word) == 0)
            return true;
        from = end + 1;
    }
    return false;
}

} // namespace

const std::vector<Kind> &kinds()
{
    using G = Group;
    static const std::vector<Kind> all = {
        {"payload", G::Named, 0.3, 12, ":com=0.08", ""},
        {"cable_spring", G::Named, 2, 300, ":rest=0.2", ""},
        {"torque_gain", G::Named, 0.05, 0.6, "", ""},
        {"load_friction", G::Named, 0.1, 0.8, "", ""},
        {"temperature", G::Named, 0.1, 2, ":time=20", ""},
        {"presliding", G::Named, 4, 60, ":travel=0.02", ""},
        {"order_line", G::Named, 1.5, 60, ":order=37,phase=0.4", ""},
        {"inertia", G::Named, 3, 100, "", ""},
        {"joint_offset", G::Named, 0.02, 0.06, "", ""},
        {"link_mass", G::Named, 0.1, 3, "", ""},
        {"base_tilt", G::Named, 1, 20, ":about=60", ""},
        {"stribeck_shape", G::Named, 4, 60, ":speed=0.03", ""},
        {"viscous_nonlinear", G::Named, 60, 6000, "", ""},
        {"drive_efficiency", G::Named, 0.1, 0.8, "", ""},
        {"eccentricity", G::Named, 0.02, 0.06, ":order=1,phase=0.5", ""},
        {"ripple_load", G::Named, 0.1, 2, ":order=100,phase=0.3", ""},
        {"local_friction", G::Outside, 8, 200, ":at=0.1,width=0.15", "q"},
        {"dwell_stiction", G::Outside, 4, 60, ":travel=0.01", "travel time"},
        {"dead_time", G::Outside, 4, 60, ":width=10", "torque load"},
        {"torque_offset", G::Outside, 1, 20, "", ""},
        {"contact", G::Part, 6, 100, ":from=8,to=11", ""},
        {"lost_counts", G::Part, 400, 200000, ":from=12", ""},
        {"brake_drag", G::Part, 3, 60, "", ""},
    };
    return all;
}

const Kind &kind_of(const std::string &id)
{
    for (const Kind &k : kinds())
        if (id == k.id)
            return k;
    throw InputError("bench-diagnosis: no effect of the name \"" + id + "\" is in its list");
}

const std::vector<std::string> &noise_families()
{
    static const std::vector<std::string> all = {"plain", "scatter", "wander", "stale"};
    return all;
}

std::vector<Case> all_cases(const Size &size)
{
    std::vector<Case> out;
    add_nulls(&out, size);
    int kind = 0;
    for (const Kind &k : kinds()) {
        kind++;
        for (int repeat = 0; repeat < size.repeats; repeat++) {
            const std::vector<double> rhos = k.group == Group::Named ? std::vector<double>{0.25, 0.5, 1}
                                                                      : std::vector<double>{1};
            for (double rho : rhos)
                out.push_back(effect_case({k.id}, k.group, rho, kind, repeat, size));
        }
    }
    const std::vector<std::vector<std::string>> pairs = {{"cable_spring", "order_line"},
                                                         {"presliding", "inertia"}};
    for (const auto &pair : pairs)
        for (int repeat = 0; repeat < size.repeats; repeat++)
            out.push_back(effect_case(pair, Group::Two, 1, ++kind, repeat, size));
    return out;
}

std::vector<Answer> read_answers(const nlohmann::json &diagnosis, int joints)
{
    std::vector<Answer> out(static_cast<std::size_t>(joints));
    try {
        for (const auto &j : diagnosis.at("joints"))
            out.at(j.at("joint").get<std::size_t>() - 1) = read_answer(j);
    } catch (const std::exception &e) {
        throw InputError(std::string("diagnosis.json: expected the keys of docs/formats.md: ") + e.what());
    }
    return out;
}

Score score(const Outcome &o)
{
    Score s;
    const Answer &a = o.answer.at(static_cast<std::size_t>(o.c.joint - 1));
    const std::string run = "run" + std::to_string(o.c.only_run) + ".csv";
    const auto there = [&run](const std::string &path) {
        return path.substr(path.find_last_of('/') + 1) == run;
    };
    s.located = !a.event_runs.empty() && std::all_of(a.event_runs.begin(), a.event_runs.end(), there);
    s.detected = a.verdict == "named" || a.verdict == "unnamed";
    if (!s.detected)
        return s;
    int named = 0, listed = 0;
    for (const std::string &id : o.c.ids) {
        named += has(a.names, id);
        listed += has(a.names, id) || has(a.ambiguous, id);
    }
    const int wanted = static_cast<int>(o.c.ids.size());
    s.first = a.verdict == "named" && named == wanted && (wanted > 1 || a.names.front() == o.c.ids.front());
    s.in_set = listed == wanted;
    s.wrong = names_something(a) && (o.c.group == Group::Part || listed == 0);
    s.extra = names_something(a) && !s.wrong && static_cast<int>(a.names.size()) > wanted;
    s.axis = named > 0;
    for (const std::string &axis : a.axes)
        s.axis = s.axis || axis_is(axis, kind_of(o.c.ids.front()).axes, o.c.joint);
    return s;
}

bool aimed(const Outcome &o)
{
    const double reached = o.rho.at(static_cast<std::size_t>(o.c.joint - 1));
    return reached < kAim * o.c.rho && kAim * reached > o.c.rho;
}

double after_nm(const Outcome &o)
{
    return o.adopted_nm > 0 ? o.adopted_nm : o.answer.at(static_cast<std::size_t>(o.c.joint - 1)).after_nm;
}

double recovered(const Outcome &o)
{
    const double before = o.answer.at(static_cast<std::size_t>(o.c.joint - 1)).before_nm, after = after_nm(o);
    return (before * before - after * after) / (before * before - o.oracle_nm * o.oracle_nm);
}

bool made_worse(const Outcome &o)
{
    if (o.c.joint > 0)
        return after_nm(o) > kWorse * o.answer.at(static_cast<std::size_t>(o.c.joint - 1)).before_nm;
    return std::any_of(o.answer.begin(), o.answer.end(),
                       [](const Answer &a) { return a.after_nm > kWorse * a.before_nm; });
}

Bounds exact_bounds(int k, int n)
{
    if (n == 0)
        return {0, 1};
    const double tail = (1 - kConfidence) / 2;
    return {k == 0 ? 0 : crossing([=](double p) { return at_most(k - 1, n, p); }, 1 - tail),
            k == n ? 1 : crossing([=](double p) { return at_most(k, n, p); }, tail)};
}

double quantile(std::vector<double> x, double share)
{
    if (x.empty())
        return std::numeric_limits<double>::quiet_NaN();
    std::sort(x.begin(), x.end());
    const double at = share * static_cast<double>(x.size() - 1);
    const auto i = static_cast<std::size_t>(at);
    const std::size_t next = std::min(i + 1, x.size() - 1);
    return x[i] + (at - static_cast<double>(i)) * (x[next] - x[i]);
}

double reducible_rms(const std::vector<double> &torque_nm, const std::vector<double> &v_radps)
{
    Eigen::Matrix4d a = 1e-9 * Eigen::Matrix4d::Identity();
    Eigen::Vector4d b = Eigen::Vector4d::Zero();
    double square = 0;
    int rows = 0;
    for (std::size_t t = 0; t < torque_nm.size(); t++) {
        const double v = v_radps[t];
        if (std::abs(v) < kAtRest_radps)
            continue;
        const Eigen::Vector4d x = v > 0 ? Eigen::Vector4d(1, 0, v, 0) : Eigen::Vector4d(0, -1, 0, v);
        a += x * x.transpose();
        b += torque_nm[t] * x;
        square += torque_nm[t] * torque_nm[t];
        rows++;
    }
    if (rows == 0)
        return 0;
    return std::sqrt(std::max(0.0, square - b.dot(a.ldlt().solve(b))) / rows);
}

} // namespace hdt::bench
