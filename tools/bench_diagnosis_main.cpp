// SPDX-License-Identifier: Apache-2.0
//
// `make bench-diagnosis`: the proof of the method, at the size that is asked for.
//
// Owns: options and exit codes (0 done, whatever the figures; 2 usage; 3 bad input).
// Never: judges.
#include <cstdio>

#include <CLI/CLI.hpp>

#include "ctrl/hdt.h"
#include "model/arm_file.hpp"
#include "tools/bench_diagnosis.hpp"

namespace {

using namespace hdt::bench;

std::vector<Case> chosen(const Size &size, const std::string &only)
{
    std::vector<Case> cases = all_cases(size);
    if (only.empty())
        return cases;
    std::vector<Case> out;
    for (const Case &c : cases)
        if (c.name.compare(0, only.size(), only) == 0)
            out.push_back(c);
    if (out.empty())
        throw hdt::InputError("--only: expected the beginning of a case's name, as in null/plain/03 or "
                              "cable_spring@2/0.5/00, found \"" + only + "\"; a larger N has more cases");
    return out;
}

} // namespace

int main(int argc, char **argv)
{
    Place place;
    Size size;
    PageHead head;
    std::string only;
    CLI::App app{"bench_diagnosis: hide effects in arms, diagnose from logs, count the answers"};
    app.option_defaults()->always_capture_default();
    app.add_option("--hdt", place.hdt, "the program");
    app.add_option("--arm", place.arm, "model file of the arm");
    app.add_option("--out", place.out, "directory for what it makes; page.md is the result");
    app.add_option("--repeats,-n", size.repeats, "cases of each effect and rho")->check(CLI::Range(1, 1000));
    app.add_option("--specimens", size.specimens, "arms commissioned")->check(CLI::Range(1, 50));
    app.add_option("--sets", size.sets, "healthy sets of logs a specimen")->check(CLI::Range(1, 500));
    app.add_option("--nulls", size.nulls, "sets of each other noise")->check(CLI::Range(0, 1000));
    app.add_option("--seconds", size.seconds, "length of a run")->check(CLI::Range(10, 600));
    app.add_option("--workers,-j", place.workers, "processes at a time")->check(CLI::Range(1, 64));
    app.add_option("--only", only, "cases whose name begins so");
    app.add_flag("--keep", place.keep,
                 "keep the logs, 80 MB a case; kept ones are diagnosed again, not made again");
    CLI11_PARSE(app, argc, argv);
    head.size = size;
    for (int v : {HDT_VERSION_MAJOR, HDT_VERSION_MINOR, HDT_VERSION_PATCH})
        head.version += (head.version.empty() ? "version " : ".") + std::to_string(v);
    head.command = "make bench-diagnosis N=" + std::to_string(size.repeats);
    setvbuf(stdout, nullptr, _IOLBF, 0); // progress in a pipe too
    try {
        run_cases(place, size, chosen(size, only), head);
        std::printf("%s/page.md\n", place.out.c_str());
    } catch (const std::exception &e) {
        std::fprintf(stderr, "bench_diagnosis: %s\n", e.what());
        return 3;
    }
    return 0;
}
