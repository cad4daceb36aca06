// SPDX-License-Identifier: Apache-2.0
//
// The results of `hdt paper` beside the paper's numbers: a page, Markdown tables and JSON.
//
// Owns: wording, comparison rows, pictures.
// Never: measures.
#pragma once

#include <string>

#include "tools/hdt_paper_results.hpp"

namespace hdt::paper {

// One statement of the paper and what the rig says to it.
struct Statement {
    std::string text, paper, ours;
    bool holds = false;
};
std::vector<Statement> statements(const Plan &plan, const Results &r);

// Every number, no trace of a run.
std::string json_of(const Plan &plan, const Results &r);

// DIR/report.html, DIR/paper.json, DIR/tables.md.  Throws InputError when one cannot be written.
void write_page(const std::string &dir, const Plan &plan, const Results &r);

} // namespace hdt::paper
