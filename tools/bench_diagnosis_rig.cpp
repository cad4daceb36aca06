// SPDX-License-Identifier: Apache-2.0
//
// The arms of the bench: `hdt sim`, `hdt ident` and `hdt diagnose` as processes, each given what a
// user would give it.  What is hidden is said to `hdt sim` alone.
//
// Owns: directories, processes, sizes for a wanted rho, reading the answers back.
// Never: judges.
#include "tools/bench_diagnosis.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <set>
#include <sstream>
#include <thread>

#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <spawn.h>
#include <sys/wait.h>

#include "model/files.hpp"
#include "model/arm_file.hpp"
#include "model/log.hpp"
#include "model/rbd.hpp"
#include "model/text.hpp"

extern char **environ;

namespace hdt::bench {

namespace {

namespace fs = std::filesystem;
using Text = std::vector<std::string>;

constexpr int kRuns = 8, kFit = 6, kCommissionSet = -1;
constexpr std::size_t kStride = 7;
constexpr int kSizeTries = 4;
constexpr double kSizeNear = 0.1;
constexpr double kBlock_s = 0.01;

std::string number(double x)
{
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.6g", x);
    return buffer;
}

std::string joined(const Text &words)
{
    std::string out;
    for (const std::string &w : words)
        out += w + "\n";
    return out;
}

// Runs a program to its end, what it says to DIR/said; throws InputError with the last of it.
void call(const Text &words, const std::string &dir)
{
    std::vector<char *> argv;
    for (const std::string &w : words)
        argv.push_back(const_cast<char *>(w.c_str()));
    argv.push_back(nullptr);
    // several runs of one set share a directory
    static std::atomic<unsigned> calls{0};
    const std::string said = dir + "/said" + std::to_string(calls++);
    posix_spawn_file_actions_t io;
    posix_spawn_file_actions_init(&io);
    posix_spawn_file_actions_addopen(&io, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&io, 1, said.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    posix_spawn_file_actions_adddup2(&io, 1, 2);
    pid_t pid = 0;
    const int error = posix_spawn(&pid, argv[0], &io, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&io);
    if (error != 0)
        throw InputError(words[0] + ": cannot be started: " + std::strerror(error) + "; run make first");
    int status = 0;
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        std::ifstream file(said);
        std::string line, last;
        while (std::getline(file, line))
            last = line.empty() ? last : line;
        throw InputError(words[0] + " " + words[1] + " ended with " +
                         std::to_string(WIFEXITED(status) ? WEXITSTATUS(status) : 128) + ": " + last);
    }
    fs::remove(said);
}

// Jobs on some threads; the first failure is thrown when all are done.
void in_parallel(int workers, std::size_t count, const std::function<void(std::size_t)> &job)
{
    std::atomic<std::size_t> next{0};
    std::mutex lock;
    std::string failure;
    const auto work = [&] {
        for (std::size_t i = next++; i < count; i = next++) {
            try {
                job(i);
            } catch (const std::exception &e) {
                const std::lock_guard<std::mutex> hold(lock);
                failure = failure.empty() ? e.what() : failure;
            }
        }
    };
    std::vector<std::thread> pool;
    for (int w = 1; w < workers; w++)
        pool.emplace_back(work);
    work();
    for (std::thread &t : pool)
        t.join();
    if (!failure.empty())
        throw InputError(failure);
}

// Reported torque and reference speed of one run in means over 10 ms, per joint.
struct Signals { std::vector<std::vector<double>> tau_nm, v_radps; };

Signals read_signals(const std::string &path)
{
    const Run run = read_run(path);
    Signals s;
    const std::size_t blocks = static_cast<std::size_t>(run.t_s.back() / kBlock_s);
    for (const Run::Joint &j : run.joint) {
        std::vector<double> tau(blocks), v(blocks), rows(blocks);
        for (std::size_t t = 0; t < run.rows(); t++) {
            const auto b = static_cast<std::size_t>(run.t_s[t] / kBlock_s);
            if (b >= blocks)
                continue;
            tau[b] += j.tau_nm[t];
            v[b] += j.vref_radps[t];
            rows[b] += 1;
        }
        for (std::size_t b = 0; b < blocks; b++) {
            tau[b] /= std::max(rows[b], 1.0);
            v[b] /= std::max(rows[b], 1.0);
        }
        s.tau_nm.push_back(std::move(tau));
        s.v_radps.push_back(std::move(v));
    }
    return s;
}

// Eight healthy runs, what the diagnosis made of them, and by how much torque differs between two
// simulations of one seed that should be alike: a standing joint breaks away a tick sooner or later.
struct Healthy {
    std::vector<Signals> runs;
    std::vector<Answer> answer;
    std::vector<double> jitter_nm;
    double floor_nm(int joint) const { return answer[static_cast<std::size_t>(joint - 1)].refit_nm; }
};

std::vector<double> change_of(const Signals &with, const Signals &without, std::size_t j)
{
    std::vector<double> change(std::min(with.tau_nm[j].size(), without.tau_nm[j].size()));
    for (std::size_t t = 0; t < change.size(); t++)
        change[t] = with.tau_nm[j][t] - without.tau_nm[j][t];
    return change;
}

// Number after a key in an effect's words, as in "eccentricity=0.002@4:order=1,phase=0.5".
double number_in(const std::string &words, const std::string &key)
{
    const std::size_t at = words.find(key + "=");
    return at == std::string::npos ? 0 : std::stod(words.substr(at + key.size() + 1));
}

// Some effects change when the gear rings, sticks and lets go as well, and two simulations then differ by all
// of that, though the effect itself does little: what it does is computed.  Empty for all others.
std::vector<double> by_the_book(const std::string &hidden, const std::string &arm_file,
                                const std::string &log, int joint)
{
    const std::string id = hidden.substr(0, hidden.find('='));
    if (id != "joint_offset" && id != "eccentricity" && id != "inertia")
        return {};
    const ArmFile file = ArmFile::load(arm_file);
    const Run run = read_run(log);
    const double size = number_in(hidden, id), order = number_in(hidden, "order");
    const double phase = number_in(hidden, "phase");
    const auto j = static_cast<Eigen::Index>(joint - 1);
    std::vector<double> out(static_cast<std::size_t>(run.t_s.back() / kBlock_s));
    std::size_t t = 0;
    for (std::size_t b = 0; b < out.size(); b++) {
        while (t + 1 < run.rows() && run.t_s[t] < (static_cast<double>(b) + 0.5) * kBlock_s)
            t++;
        if (id == "inertia") {
            out[b] = size * run.joint[static_cast<std::size_t>(j)].aref_radps2[t];
            continue;
        }
        Eigen::VectorXd q(static_cast<Eigen::Index>(run.joint.size()));
        for (Eigen::Index k = 0; k < q.size(); k++)
            q[k] = run.joint[static_cast<std::size_t>(k)].q_rad[t];
        Eigen::VectorXd there = q;
        there[j] += id == "joint_offset" ? size : size * std::sin(order * q[j] + phase);
        out[b] = rbd::gravity(file.arm(), there)[j] - rbd::gravity(file.arm(), q)[j];
    }
    return out;
}

class Rig {
public:
    Rig(const Place &place, const Size &size, const PageHead &head)
        : place_(place), size_(size), head_(head) {}
    std::vector<Outcome> run(const std::vector<Case> &cases);

private:
    using SetKey = std::pair<int, int>;                       // specimen, set
    using SizeKey = std::pair<std::string, int>;              // effect, joint and rho; specimen
    const Place &place_;
    const Size &size_;
    const PageHead &head_;
    std::map<SetKey, Healthy> healthy_;
    std::map<SizeKey, double> size_of_;                       // per N.m of floor
    std::mutex lock_;
    std::vector<Outcome> done_;
    std::size_t total_ = 0;
    std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();

    std::string specimen_dir(int s) const { return place_.out + "/specimen" + std::to_string(s); }
    std::string model_of(int s) const { return specimen_dir(s) + "/commissioned/model.toml"; }
    std::string case_dir(const Case &c) const;
    void empty_directory(const std::string &dir) const;
    void simulate(const std::string &dir, int specimen, int set, int run, const Text &hidden) const;
    void commission(int specimen) const;
    void diagnose_into(const std::string &dir, const std::string &model, const Text &fit, const Text &test,
                       const std::string &joints) const;
    std::vector<Answer> diagnose_set(const std::string &dir, const std::string &model) const;
    std::vector<double> jitter(const std::string &dir, const SetKey &key, const Signals &once) const;
    void make_healthy(const SetKey &key);
    Text hidden_of(const Case &c);
    std::string options_of(const Case &c, const Kind &k) const;
    Text noise_of(const Case &c);
    double contribution_nm(const Text &hidden, const Case &c, int joint, int run, const std::string &dir,
                           const Signals &with) const;
    static SizeKey size_key(const Case &c, const std::string &id);
    void calibrate(const Case &c, const std::string &id);
    void read_back(Outcome *o, const std::string &dir) const;
    void measure(Outcome *o, const std::string &dir) const;
    void one_case(const Case &c);
    void note(Outcome o);
};

std::string run_file(const std::string &dir, int run)
{
    return dir + "/run" + std::to_string(run) + ".csv";
}

// Runs that nothing else uses: a specimen, a set, a run in it.
std::string seed_of(int specimen, int set, int run)
{
    return std::to_string(100000 * specimen + 10 * set + run);
}

std::string at_joint(const std::string &id, double size, int joint)
{
    return id + "=" + number(size) + "@" + std::to_string(joint);
}

void Rig::simulate(const std::string &dir, int specimen, int set, int run, const Text &hidden) const
{
    const std::string seed = seed_of(specimen, set, run);
    Text words = {place_.hdt, "sim", "--arm", place_.arm, "--individual", std::to_string(100 + specimen),
                  "--mode", "velocity", "--seed", seed, "--task",
                  "excite:seed=" + seed + ",seconds=" + std::to_string(size_.seconds),
                  "--out", run_file(dir, run)};
    for (const std::string &h : hidden)
        words.insert(words.end(), {"--effect", h});
    if (!place_.keep)
        return call(words, dir);
    // a kept log of the very same run serves again
    const std::string made_by = run_file(dir, run) + ".made-by", line = joined(words);
    if (fs::exists(run_file(dir, run)) && fs::exists(made_by) && read_text(made_by) == line)
        return;
    fs::remove(made_by);
    call(words, dir);
    write_file(made_by, line);
}

std::string Rig::case_dir(const Case &c) const
{
    std::string plain = c.name;
    std::replace(plain.begin(), plain.end(), '/', '-');
    return place_.out + "/case-" + plain;
}

// What is kept stays: the same command again simulates nothing twice.
void Rig::empty_directory(const std::string &dir) const
{
    if (!place_.keep)
        fs::remove_all(dir);
    fs::create_directories(dir);
}

// The model of a healthy specimen, from eight runs that nothing else uses.
void Rig::commission(int specimen) const
{
    const std::string dir = specimen_dir(specimen);
    empty_directory(dir);
    for (int r = 0; r < kRuns; r++)
        simulate(dir, specimen, kCommissionSet, r, {});
    Text words = {place_.hdt, "ident", "--arm", place_.arm, "--fit"};
    for (int r = 0; r < kRuns; r++) {
        if (r == kFit)
            words.emplace_back("--test");
        words.push_back(run_file(dir, r));
    }
    words.insert(words.end(), {"--out", dir + "/commissioned"});
    call(words, dir);
    if (place_.keep)
        return;
    for (int r = 0; r < kRuns; r++)
        fs::remove(run_file(dir, r));
}

void Rig::diagnose_into(const std::string &dir, const std::string &model, const Text &fit, const Text &test,
                        const std::string &joints) const
{
    Text words = {place_.hdt, "diagnose", "--model", model, "--fit"};
    words.insert(words.end(), fit.begin(), fit.end());
    words.emplace_back("--test");
    words.insert(words.end(), test.begin(), test.end());
    if (!joints.empty())
        words.insert(words.end(), {"--joints", joints});
    words.insert(words.end(), {"--out", dir});
    call(words, fs::path(dir).parent_path().string());
}

std::vector<Answer> read_back_answers(const std::string &dir, std::size_t joints)
{
    std::ifstream file(dir + "/diagnosis.json");
    const auto json = nlohmann::json::parse(file, nullptr, false);
    if (json.is_discarded())
        throw InputError(dir + "/diagnosis.json: not there, or not JSON");
    return read_answers(json, static_cast<int>(joints));
}

std::vector<Answer> Rig::diagnose_set(const std::string &dir, const std::string &model) const
{
    Text fit, test;
    for (int r = 0; r < kRuns; r++)
        (r < kFit ? fit : test).push_back(run_file(dir, r));
    diagnose_into(dir + "/diagnosis", model, fit, test, place_.joints);
    return read_back_answers(dir + "/diagnosis", HDT_ARM_JOINTS_MAX);
}

// One healthy run again, with springs far too weak to feel.
std::vector<double> Rig::jitter(const std::string &dir, const SetKey &key, const Signals &once) const
{
    const std::string again = dir + "/again";
    fs::create_directories(again);
    Text nothing;
    for (std::size_t j = 0; j < once.tau_nm.size(); j++)
        nothing.push_back(at_joint("cable_spring", 1e-9, static_cast<int>(j) + 1));
    simulate(again, key.first, key.second, kFit, nothing);
    const Signals twin = read_signals(run_file(again, kFit));
    std::vector<double> nm;
    for (std::size_t j = 0; j < once.tau_nm.size(); j++)
        nm.push_back(reducible_rms(change_of(twin, once, j), once.v_radps[j]));
    if (!place_.keep)
        fs::remove_all(again);
    return nm;
}

void Rig::make_healthy(const SetKey &key)
{
    const std::string dir =
        place_.out + "/healthy" + std::to_string(key.first) + "-" + std::to_string(key.second);
    empty_directory(dir);
    Healthy h;
    for (int r = 0; r < kRuns; r++) {
        simulate(dir, key.first, key.second, r, {});
        h.runs.push_back(read_signals(run_file(dir, r)));
    }
    h.answer = diagnose_set(dir, model_of(key.first));
    h.jitter_nm = jitter(dir, key, h.runs[kFit]);
    if (!place_.keep)
        fs::remove_all(dir);
    const std::lock_guard<std::mutex> hold(lock_);
    healthy_[key] = std::move(h);
}

// Noise of a family in proportion to each joint's own.
Text Rig::noise_of(const Case &c)
{
    Text out;
    const Healthy &h = healthy_.at({c.specimen, c.set % size_.sets});
    for (std::size_t j = 0; j < h.runs[0].tau_nm.size(); j++) {
        const int joint = static_cast<int>(j) + 1;
        const double floor = h.answer[j].refit_nm > 0 ? h.answer[j].refit_nm : 0.5;
        if (c.ids[0] == "scatter")
            out.push_back(at_joint("run_scatter", 0.5 * floor, joint));
        else if (c.ids[0] == "wander")
            out.push_back(at_joint("wander", 0.5 * floor, joint));
        else if (c.ids[0] == "stale")
            out.push_back(at_joint("stale_samples", 0.02, joint));
    }
    return out;
}

bool seen_as_it_is(const std::string &id)
{
    const Kind &k = kind_of(id);
    return k.group == Group::Outside && *k.axes == 0;
}

// What the hidden things do to the reported torque of a joint in one run: the same seed with and without,
// less what two runs of one seed differ by anyway.
double Rig::contribution_nm(const Text &hidden, const Case &c, int joint, int run, const std::string &dir,
                            const Signals &with) const
{
    const Healthy &h = healthy_.at({c.specimen, c.set});
    const auto j = static_cast<std::size_t>(joint - 1);
    const std::string id = hidden[0].substr(0, hidden[0].find('='));
    const std::string log = run_file(dir, run);
    if (const std::vector<double> book = by_the_book(hidden[0], place_.arm, log, joint); !book.empty())
        return reducible_rms(book, with.v_radps[j]);
    const std::vector<double> change = change_of(with, h.runs[static_cast<std::size_t>(run)], j);
    double square = 0;
    for (double x : change)
        square += x * x / static_cast<double>(change.size());
    if (!seen_as_it_is(id))
        square = std::pow(reducible_rms(change, with.v_radps[j]), 2);
    return std::sqrt(std::max(0.0, square - h.jitter_nm[j] * h.jitter_nm[j]));
}

Rig::SizeKey Rig::size_key(const Case &c, const std::string &id)
{
    return {id + "@" + std::to_string(c.joint) + "/" + number(c.rho), c.specimen};
}

// What begins and ends within a run does so where the joint moves: resting, it would show to nobody.
std::string Rig::options_of(const Case &c, const Kind &k) const
{
    constexpr double moving_radps = 0.05, length_s = 3, margin_s = 3;
    if (c.group != Group::Part || std::string(k.options).find("to=") == std::string::npos)
        return k.options;
    const auto &run = healthy_.at({c.specimen, c.set}).runs[static_cast<std::size_t>(c.only_run)];
    const std::vector<double> &v = run.v_radps[static_cast<std::size_t>(c.joint - 1)];
    const double rows_a_second = static_cast<double>(v.size()) / size_.seconds;
    double best_s = margin_s, most = -1;
    for (double from = margin_s; from + length_s + margin_s <= size_.seconds; from += 1) {
        const auto begin = v.begin() + static_cast<std::ptrdiff_t>(from * rows_a_second);
        const auto moving =
            static_cast<double>(std::count_if(begin,
                                              begin + static_cast<std::ptrdiff_t>(length_s * rows_a_second),
                                              [](double x) { return std::abs(x) > moving_radps; }));
        if (moving > most) {
            most = moving;
            best_s = from;
        }
    }
    return ":from=" + number(best_s) + ",to=" + number(best_s + length_s);
}

// Size for the wanted rho, on the first held-out run: from the guess, by proportion until it is near.
void Rig::calibrate(const Case &c, const std::string &id)
{
    const Kind &k = kind_of(id);
    const int run = c.only_run >= 0 ? c.only_run : kFit;
    const double floor = healthy_.at({c.specimen, c.set}).floor_nm(c.joint);
    const SizeKey key = size_key(c, id);
    const std::string dir = place_.out + "/size-" + id + std::to_string(c.joint) + "-"
                            + std::to_string(c.specimen) + "-" + number(c.rho);
    fs::create_directories(dir);
    double size = k.guess * floor;
    for (int tries = 0; tries < kSizeTries; tries++) {
        const Text hidden = {at_joint(id, std::min(size, k.most), c.joint) + options_of(c, k)};
        simulate(dir, c.specimen, c.set, run, hidden);
        const double nm = contribution_nm(hidden, c, c.joint, run, dir, read_signals(run_file(dir, run)));
        const double factor = std::clamp(c.rho * floor / std::max(nm, 1e-9), 0.1, 10.0);
        size = std::min(size, k.most) * factor;
        if (std::abs(factor - 1) < kSizeNear)
            break;
    }
    fs::remove_all(dir);
    const std::lock_guard<std::mutex> hold(lock_);
    size_of_[key] = size / floor;
}

Text Rig::hidden_of(const Case &c)
{
    const std::string kept = case_dir(c) + "/hidden";
    Text out;
    if (place_.keep && fs::exists(kept)) {
        std::istringstream lines(read_text(kept));
        for (std::string line; std::getline(lines, line);)
            out.push_back(line);
        return out;
    }
    if (c.group == Group::Null)
        return noise_of(c);
    const double floor = healthy_.at({c.specimen, c.set}).floor_nm(c.joint);
    for (const std::string &id : c.ids) {
        const Kind &k = kind_of(id);
        const auto known = size_of_.find(size_key(c, id));
        if (known == size_of_.end())
            throw InputError(id + ": the rig refused the sizes tried");
        const double size = known->second * floor;
        if (!(size <= k.most))
            throw InputError(id + ": a size of " + number(size) + " would be needed, " + number(k.most)
                             + " is the most");
        out.push_back(at_joint(id, size, c.joint) + options_of(c, k));
    }
    return out;
}

// The model file that was written, on the held-out runs again: what its user gets.
void Rig::read_back(Outcome *o, const std::string &dir) const
{
    diagnose_into(dir + "/back", dir + "/diagnosis/model.toml", {run_file(dir, 0)},
                  {run_file(dir, kFit), run_file(dir, kFit + 1)}, std::to_string(o->c.joint));
    const std::vector<Answer> back = read_back_answers(dir + "/back", HDT_ARM_JOINTS_MAX);
    o->adopted_nm = back[static_cast<std::size_t>(o->c.joint - 1)].before_nm;
}

// Rho reached on every joint, over the held-out runs, or in the one run the effect is in.
void Rig::measure(Outcome *o, const std::string &dir) const
{
    const Healthy &h = healthy_.at({o->c.specimen, o->c.set});
    std::vector<int> runs = {kFit, kFit + 1};
    if (o->c.only_run >= 0)
        runs = {o->c.only_run};
    o->rho.assign(h.runs[0].tau_nm.size(), 0);
    for (int r : runs) {
        const Signals with = read_signals(run_file(dir, r));
        for (std::size_t j = 0; j < o->rho.size(); j++) {
            const double floor = h.answer[j].refit_nm;
            const double share = contribution_nm(o->hidden, o->c, static_cast<int>(j) + 1, r, dir, with)
                                 / floor;
            if (floor > 0)
                o->rho[j] += share * share / static_cast<double>(runs.size());
        }
    }
    for (double &r : o->rho)
        r = std::sqrt(r);
    o->oracle_nm = h.floor_nm(o->c.joint);
}

void Rig::one_case(const Case &c)
{
    Outcome o;
    o.c = c;
    const std::string dir = case_dir(c);
    try {
        if (c.group == Group::Null && c.ids[0] == noise_families()[0]) {
            o.answer = healthy_.at({c.specimen, c.set}).answer;
            return note(std::move(o));
        }
        empty_directory(dir);
        o.hidden = hidden_of(c);
        write_file(dir + "/hidden", joined(o.hidden));
        for (int r = 0; r < kRuns; r++)
            simulate(dir, c.specimen, c.set, r, c.only_run < 0 || c.only_run == r ? o.hidden : Text{});
        o.answer = diagnose_set(dir, model_of(c.specimen));
        if (c.group != Group::Null) {
            measure(&o, dir);
            if (o.answer[static_cast<std::size_t>(o.c.joint - 1)].adopted)
                read_back(&o, dir);
        }
    } catch (const std::exception &e) {
        o.failure = e.what();
    }
    if (!place_.keep)
        fs::remove_all(dir);
    note(std::move(o));
}

std::string in_words(const Outcome &o)
{
    if (!o.failure.empty())
        return "no answer: " + o.failure;
    std::string out;
    for (std::size_t j = 0; j < o.answer.size(); j++) {
        const Answer &a = o.answer[j];
        if (a.verdict.empty() || (a.verdict == "nothing" && static_cast<int>(j) != o.c.joint - 1))
            continue;
        out += " " + std::to_string(j + 1) + ":" + a.verdict;
        for (const std::string &n : a.names)
            out += " " + n;
        for (const std::string &n : a.axes)
            out += " (" + n + ")";
    }
    return out.empty() ? "nothing" : out;
}

// One line a case, and the page so far: an hour's work is not lost with its last minute.
void Rig::note(Outcome o)
{
    const std::lock_guard<std::mutex> hold(lock_);
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin_;
    const double minutes = passed.count() / 60;
    std::string rho;
    if (o.c.joint > 0 && !o.rho.empty())
        rho = " rho " + number(std::round(100 * o.rho[static_cast<std::size_t>(o.c.joint - 1)]) / 100);
    std::printf("%4zu/%zu %5.1f min  %-34s%s %s\n", done_.size() + 1, total_, minutes, o.c.name.c_str(),
                rho.c_str(), in_words(o).c_str());
    done_.push_back(std::move(o));
    PageHead head = head_;
    head.minutes = minutes;
    if (done_.size() % 10 == 0 || done_.size() == total_)
        write_file(place_.out + "/page.md", page(head, done_));
}

std::vector<Outcome> Rig::run(const std::vector<Case> &cases)
{
    std::set<int> specimens;
    std::set<SetKey> sets;
    std::map<SizeKey, std::pair<Case, std::string>> units;
    for (const Case &c : cases) {
        specimens.insert(c.specimen);
        sets.insert({c.specimen, c.set % size_.sets});
        if (c.group != Group::Null && !(place_.keep && fs::exists(case_dir(c) + "/hidden")))
            for (const std::string &id : c.ids)
                units.emplace(size_key(c, id), std::make_pair(c, id));
    }
    total_ = cases.size();
    const std::vector<int> arms(specimens.begin(), specimens.end());
    in_parallel(place_.workers, arms.size(), [&](std::size_t i) { commission(arms[i]); });
    std::printf("%zu specimens commissioned; %zu healthy sets, %zu sizes, %zu cases\n", arms.size(),
                sets.size(), units.size(), cases.size());
    const std::vector<SetKey> all(sets.begin(), sets.end());
    in_parallel(place_.workers, all.size(), [&](std::size_t i) { make_healthy(all[i]); });
    std::vector<std::pair<Case, std::string>> sizes;
    for (const auto &[key, value] : units)
        sizes.push_back(value);
    in_parallel(place_.workers, sizes.size(), [&](std::size_t i) {
        try {
            calibrate(sizes[i].first, sizes[i].second);
        } catch (const std::exception &e) {
            std::printf("%s: no size found: %s\n", sizes[i].first.name.c_str(), e.what());
        }
    });
    std::printf("healthy sets and sizes done; cases as they end:\n");
    // in strides, so that the page is of every kind while it grows
    std::vector<std::size_t> order;
    for (std::size_t from = 0; from < kStride; from++)
        for (std::size_t i = from; i < cases.size(); i += kStride)
            order.push_back(i);
    in_parallel(place_.workers, order.size(), [&](std::size_t i) { one_case(cases[order[i]]); });
    std::sort(done_.begin(), done_.end(),
              [](const Outcome &a, const Outcome &b) { return a.c.name < b.c.name; });
    return std::move(done_);
}

} // namespace

std::vector<Outcome> run_cases(const Place &place, const Size &size, const std::vector<Case> &cases,
                               const PageHead &head)
{
    fs::create_directories(place.out);
    return Rig(place, size, head).run(cases);
}

} // namespace hdt::bench
