// SPDX-License-Identifier: Apache-2.0
//
// `hdt paper`: the experiments of Kennedy and Desai 2005 in the rig, and their numbers beside the
// paper's.
#include <atomic>
#include <cstdio>
#include <memory>

#include "tools/hdt_cli.hpp"
#include "tools/hdt_paper_page.hpp"

namespace hdt::cli {

namespace {

struct PaperOptions {
    std::string arm, out, only;
    int trials = 5;
    uint64_t individual = 0, seed = 1;
    unsigned workers = 3;
};

int run(const PaperOptions &o)
{
    end_in_good_order();
    std::atomic<bool> stop{false};
    paper::Plan plan;
    plan.parts = paper::parse_parts(o.only);
    plan.trials = o.trials;
    plan.workers = o.workers;
    plan.rig.arm = rig::load_arm(o.arm);
    plan.rig.individual = o.individual;
    plan.rig.seed = o.seed;
    plan.rig.stop = &stop;
    paper::require_pa10(plan.rig.arm);
    make_directory(o.out);
    Progress progress("hdt paper");
    paper::Results results;
    try {
        results = paper::carry_out(plan, [&](double share) {
            stop = stopped();
            progress.at(share);
        });
    } catch (const paper::Stopped &) {
        std::fprintf(stderr, "hdt paper: stopped; nothing written\n");
        return No;
    }
    paper::write_page(o.out, plan, results);
    int hold = 0, count = 0;
    for (const paper::Statement &s : paper::statements(plan, results)) {
        std::printf("%-4s %s\n       paper %s, rig %s\n", s.holds ? "yes" : "no", s.text.c_str(),
                    s.paper.empty() ? "-" : s.paper.c_str(), s.ours.c_str());
        hold += s.holds;
        count++;
    }
    std::printf("\n%d of %d statements hold; report: %s/report.html\n", hold, count, o.out.c_str());
    return Ok;
}

} // namespace

void add_paper(CLI::App &app, int &code)
{
    auto o = std::make_shared<PaperOptions>();
    CLI::App *sub = app.add_subcommand("paper", "the experiments of Kennedy and Desai 2005 in the rig, "
                                                "beside the paper's numbers");
    sub->add_option("--arm", o->arm, "model file of the arm, of the PA-10's kind")->required();
    sub->add_option("--out", o->out, "directory for report.html, paper.json and tables.md")->required();
    sub->add_option("--only", o->only, "parts, e.g. table1,fig8; what they build on is measured too");
    sub->add_option("--trials", o->trials,
                    "trials of friction and repetitions of closed loops")->capture_default_str()
        ->check(CLI::Range(2, 100));
    sub->add_option("--individual", o->individual, "which specimen of the arm; 0 has the file's friction "
                                                   "exactly")->capture_default_str()->check(whole_number());
    sub->add_option("--seed", o->seed, "noise and scatter of all runs")
        ->capture_default_str()->check(whole_number());
    sub->add_option("--workers", o->workers, "runs at once")->capture_default_str()->check(CLI::Range(1, 64));
    sub->callback([o, &code] { code = run(*o); });
}

} // namespace hdt::cli
