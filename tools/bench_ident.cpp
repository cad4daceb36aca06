// SPDX-License-Identifier: Apache-2.0
//
// What identification and diagnosis cost: `hdt ident` and `hdt diagnose` as processes on ten minutes of
// the PA-10 at 700 Hz and on half of it, on all processors and on one; a regression of 50 columns over
// 100 000 rows by the diagnosis' own Gram matrices; a Stribeck fit of 80 points.
//
// bench_ident --hdt PROGRAM --arm MODEL --out DIR     DIR holds 0.2 GB of logs and stays
//
// Owns: the printed figures.
// Never: is a test; timing on a shared machine varies.
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include <CLI/CLI.hpp>
#include <fcntl.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "model/arm_file.hpp"
#include "model/evidence.hpp"
#include "tools/hdt_paper_fit.hpp"

namespace {

using Text = std::vector<std::string>;
using Clock = std::chrono::steady_clock;

constexpr int runs = 10, fit_runs = 8, run_s = 60;

double seconds_since(Clock::time_point begin)
{
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

struct Cost { double wall_s = 0, processor_s = 0, peak_mb = 0; };

// A program to its end, silent; on the first processor only if asked.
Cost run(const Text &words, bool one_processor)
{
    std::vector<char *> argv;
    for (const std::string &w : words)
        argv.push_back(const_cast<char *>(w.c_str()));
    argv.push_back(nullptr);
    const Clock::time_point begin = Clock::now();
    const pid_t pid = fork();
    if (pid == 0) {
        cpu_set_t first;
        CPU_ZERO(&first);
        CPU_SET(0, &first);
        if (one_processor)
            (void)sched_setaffinity(0, sizeof first, &first);
        const int nowhere = open("/dev/null", O_WRONLY);
        dup2(nowhere, 1);
        execv(argv[0], argv.data());
        _exit(127);
    }
    int status = 0;
    struct rusage used = {};
    if (pid < 0 || wait4(pid, &status, 0, &used) != pid || status != 0)
        throw hdt::InputError(words[0] + " " + words[1] + " failed; run make first");
    const auto s = [](timeval t) {
        return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    return {seconds_since(begin), s(used.ru_utime) + s(used.ru_stime),
            static_cast<double>(used.ru_maxrss) / 1024};
}

std::string log_of(const std::string &out, int k) { return out + "/run" + std::to_string(k) + ".csv"; }

// Logs first to last, the last fifth held out.
Text with_logs(Text words, const std::string &out, int count)
{
    words.emplace_back("--fit");
    for (int k = 0; k < count; k++) {
        if (k == count * fit_runs / runs)
            words.emplace_back("--test");
        words.push_back(log_of(out, k));
    }
    return words;
}

void print(const char *what, int count, const Cost &c)
{
    const double rows = 700.0 * run_s * count * 7;
    std::printf("%-38s %5.2f million rows  %6.2f s  (processor %6.2f s, %.2f us a row)  peak %4.0f MB\n",
                what, rows / 1e6, c.wall_s, c.processor_s, 1e6 * c.processor_s / rows, c.peak_mb);
}

bool same_bytes(const std::string &a, const std::string &b)
{
    const auto bytes = [](const std::string &path) {
        std::ifstream in(path, std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    return bytes(a) == bytes(b);
}

void whole_programs(const std::string &hdt, const std::string &arm, const std::string &out)
{
    std::filesystem::create_directories(out);
    for (int k = 0; k < runs; k++) {
        const std::string seed = std::to_string(700 + k);
        if (!std::filesystem::exists(log_of(out, k)))
            run({hdt, "sim", "--arm", arm, "--mode", "velocity", "--seed", seed, "--effect",
                 "cable_spring=10@2", "--task", "excite:seed=" + seed + ",seconds=" + std::to_string(run_s),
                 "--out", log_of(out, k)},
                false);
    }
    const auto ident = [&](int count, const std::string &name) {
        return with_logs({hdt, "ident", "--arm", arm, "--out", out + "/" + name}, out, count);
    };
    const auto diagnose = [&](int count, const std::string &name) {
        return with_logs({hdt, "diagnose", "--model", out + "/ident/model.toml", "--out", out + "/" + name},
                         out, count);
    };
    print("ident, five minutes", runs / 2, run(ident(runs / 2, "half"), false));
    print("ident, ten minutes", runs, run(ident(runs, "ident"), false));
    print("diagnose, five minutes", runs / 2, run(diagnose(runs / 2, "half"), false));
    print("diagnose, ten minutes", runs, run(diagnose(runs, "all"), false));
    print("diagnose, ten minutes, one processor", runs, run(diagnose(runs, "one"), true));
    std::printf("diagnosis.json of one processor and of all: %s\n",
                same_bytes(out + "/one/diagnosis.json", out + "/all/diagnosis.json") ? "the same bytes"
                                                                                     : "DIFFERENT");
}

// Ten runs of 10 000 rows, 50 columns of which 6 are in y: Gram matrices, then least squares again and
// again without what came out small.
void regression()
{
    constexpr Eigen::Index rows = 10000, columns = 50, in = 6;
    std::mt19937_64 rng(1);
    std::normal_distribution<double> gauss;
    std::vector<Eigen::MatrixXd> x;
    std::vector<hdt::RunRows> y;
    for (int r = 0; r < 10; r++) {
        x.push_back(Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return gauss(rng); }));
        y.push_back({x.back().leftCols(in).rowwise().sum() +
                         Eigen::VectorXd::NullaryExpr(rows, [&] { return gauss(rng); }),
                     Eigen::MatrixXd::Ones(rows, 1),
                     {},
                     Eigen::MatrixXd::Zero(rows, 1),
                     {hdt::RG_COULOMB},
                     std::vector<int>(rows, 0)});
    }
    hdt::NoiseModel white;
    white.predictor = {Eigen::VectorXd(0)};
    white.innovation_nm = {1};
    const hdt::Evidence e(std::move(y), white);
    double best = 1e9;
    Eigen::Index kept = 0;
    for (int round = 0; round < 7; round++) {
        const Clock::time_point begin = Clock::now();
        const hdt::Gram g = e.gram(x);
        const hdt::Projected p = hdt::project(g, hdt::RunSet(x.size(), 1));
        std::vector<Eigen::Index> which(columns);
        for (Eigen::Index k = 0; k < columns; k++)
            which[static_cast<std::size_t>(k)] = k;
        for (bool fell = true; fell;) {
            fell = false;
            const Eigen::VectorXd theta = p.a(which, which).llt().solve(p.b(which));
            std::vector<Eigen::Index> stay;
            for (Eigen::Index k = 0; k < theta.size(); k++)
                if (std::abs(theta[k]) > 0.1)
                    stay.push_back(which[static_cast<std::size_t>(k)]);
            fell = stay.size() < which.size();
            which = stay;
        }
        kept = static_cast<Eigen::Index>(which.size());
        best = std::min(best, seconds_since(begin));
    }
    std::printf("sparse regression, 100 000 x 50           %6.1f ms  (%ld columns kept, %ld true)\n",
                1e3 * best, static_cast<long>(kept), static_cast<long>(in));
}

void stribeck()
{
    std::vector<hdt::paper::SpeedPoint> points;
    std::mt19937_64 rng(2);
    std::normal_distribution<double> gauss(0, 0.3);
    for (int k = 0; k < 80; k++) {
        hdt::paper::SpeedPoint p = {};
        p.speed_radps = 0.02 + 0.38 * k / 79;
        p.mean_nm = 40 + 25 * p.speed_radps + 6 * (1 - std::exp(-p.speed_radps / 0.1)) + gauss(rng);
        p.sd_nm = 0.3;
        p.trials = 5;
        points.push_back(p);
    }
    double best = 1e9, vc = 0;
    for (int round = 0; round < 200; round++) {
        const Clock::time_point begin = Clock::now();
        vc = hdt::paper::fit_stribeck(points).parameters[3];
        best = std::min(best, seconds_since(begin));
    }
    std::printf("Stribeck fit with sigma, 80 points        %6.1f us  (speed %.3f rad/s for 0.1)\n",
                1e6 * best, vc);
}

} // namespace

int main(int argc, char **argv)
{
    std::string hdt = "build/hdt", arm = "model/arms/pa10.toml", out = "build/bench-ident";
    CLI::App app{"bench_ident: what identification and diagnosis cost"};
    app.option_defaults()->always_capture_default();
    app.add_option("--hdt", hdt, "the program");
    app.add_option("--arm", arm, "model file of the arm");
    app.add_option("--out", out, "directory for logs; kept ones serve again");
    CLI11_PARSE(app, argc, argv);
    setvbuf(stdout, nullptr, _IOLBF, 0);
    try {
        whole_programs(hdt, arm, out);
        regression();
        stribeck();
    } catch (const std::exception &e) {
        std::fprintf(stderr, "bench_ident: %s\n", e.what());
        return 3;
    }
    return 0;
}
