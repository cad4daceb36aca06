// SPDX-License-Identifier: Apache-2.0
//
// Owns: a joint's residual before and after over an axis that tells, and its lines by order.
// Never: decides anything.
#include "model/diagnose_parts.hpp"

#include <algorithm>

namespace hdt::diag {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

VectorXd axis_signal(const std::string &id, const std::string &axis, const BlockRows &b, std::string *label)
{
    const auto is = [&](std::initializer_list<const char *> ids) {
        return std::any_of(ids.begin(), ids.end(),
                           [&](const char *k) { return id == k || axis.rfind(k, 0) == 0; });
    };
    if (is({"load_friction", "drive_efficiency", "soft_windup", "load"}))
        return *label = "load (gravity torque), N.m", b.gravity;
    if (is({"temperature", "time", "external_vibration"}))
        return *label = "time, s", b.t_s;
    if (is({"presliding", "travel"}))
        return *label = "travel since reversal, rad", b.travel;
    if (is({"inertia", "coupling"}))
        return *label = "acceleration, rad/s^2", b.a;
    if (is({"torque_gain", "torque_saturation", "torque_delay", "torque"}))
        return *label = "declared torque, N.m", b.total;
    if (is({"viscous_nonlinear", "stribeck_shape", "v"}))
        return *label = "speed, rad/s", b.v;
    if (axis.size() > 1 && axis[0] == 'q') {
        const int k = std::atoi(axis.c_str() + 1);
        if (k >= 1 && k <= b.q_all.cols())
            return *label = "angle of joint " + std::to_string(k) + ", rad", b.q_all.col(k - 1);
    }
    return *label = "joint angle, rad", b.q;
}

} // namespace

void pictures(const JointWork &w, const HeldOut &h, const Found &axis, JointDiagnosis *d)
{
    const std::string id = !w.found.empty() ? w.found[0].family.id : "";
    std::vector<ScanRows> rows;
    std::vector<VectorXd> before;
    Index at = 0;
    const Index stride = std::max<Index>(1, h.before.size() / 6000);
    double t0 = 0;
    for (const BlockRows &b : w.test) {
        const VectorXd x = axis_signal(id, axis.family.axis, b, &d->axis_label);
        for (Index t = 0; t < b.size(); ++t, ++at) {
            if (at % stride != 0)
                continue;
            d->t_s.push_back(t0 + b.t_s[t]);
            d->axis_x.push_back(x[t]);
            d->residual_before_nm.push_back(h.before[at]);
            d->residual_after_nm.push_back(h.after[at]);
        }
        t0 += b.size() > 0 ? b.t_s[b.size() - 1] : 0;
        rows.push_back(b.scan());
        before.push_back(b.y_nm);
    }
    const OrderGrid grid = order_grid(rows, w.highest_order());
    for (std::size_t k = 0; k < grid.count(); ++k)
        d->order.push_back(grid.first + grid.step * static_cast<double>(k));
    const auto larger = [&](const std::vector<VectorXd> &y) {
        std::vector<double> a = order_spectrum(rows, y, grid, false);
        const std::vector<double> b = order_spectrum(rows, y, grid, true);
        for (std::size_t k = 0; k < a.size(); ++k)
            a[k] = std::max(a[k], b[k]);
        return a;
    };
    d->spectrum_before_nm = larger(before);
    d->spectrum_after_nm = larger(h.after_by_run);
}

} // namespace hdt::diag
