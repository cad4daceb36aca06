// SPDX-License-Identifier: Apache-2.0
//
// Two models on the same rows.
//
// Owns: how much worse is worse.
// Never: changes a model.
#include "model/ident_guard.hpp"

#include <cmath>
#include <limits>

namespace hdt::fit {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr double clear_sigmas = 3;
constexpr double worse_share = 1.005;   // what is less than this is no reason to write nothing

} // namespace

double error_nm(const JointRows &r)
{
    if (r.rows() == 0)
        return std::numeric_limits<double>::quiet_NaN();
    return std::sqrt((r.measured - r.declared).squaredNorm() / static_cast<double>(r.rows()));
}

bool clearly_worse(const JointRows &before, const JointRows &after)
{
    if (before.rows() == 0 || !(error_nm(after) > worse_share * error_nm(before)))
        return false;
    const VectorXd more = (after.measured - after.declared).cwiseAbs2()
                          - (before.measured - before.declared).cwiseAbs2();
    const Index pieces = static_cast<Index>(before.piece_begin.size()) - 1;
    VectorXd sum = VectorXd::Zero(pieces);
    for (Index p = 0; p < pieces; p++) {
        const Index from = before.piece_begin[static_cast<std::size_t>(p)];
        sum[p] = more.segment(from, before.piece_begin[static_cast<std::size_t>(p + 1)] - from).sum();
    }
    const double n = static_cast<double>(pieces);
    const double scatter = std::sqrt((sum.array() - sum.mean()).square().sum() * n / (n - 1));
    return sum.sum() > clear_sigmas * scatter;
}

} // namespace hdt::fit
