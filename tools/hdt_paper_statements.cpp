// SPDX-License-Identifier: Apache-2.0
//
// What the paper states, and by which criterion it holds in the rig.
#include <algorithm>
#include <cmath>

#include "model/report.hpp"
#include "model/terms.hpp"
#include "tools/hdt_paper_page.hpp"

namespace hdt::paper {

namespace {

void friction_statements(const Results &r, std::vector<Statement> &all)
{
    int better = 0, cubic_better = 0, near = 0;
    double worst = 0;
    for (std::size_t j = 0; j < printed_joints; j++) {
        better += mean_variance(r.friction[j].stribeck) < mean_variance(r.friction[j].viscous);
        cubic_better += mean_variance(r.friction[j].cubic) < mean_variance(r.friction[j].stribeck);
        for (std::size_t d = 0; d < 2; d++) {
            const hdt_arm_friction p = magnitudes(d == 0 ? table_2[j].positive : table_2[j].negative);
            const double share = curve_gap_nm(p, stribeck_of(r.friction[j].stribeck[d])) / stribeck_nm(p,
                    0.02);
            worst = std::max(worst, share);
            near += share < 0.03;
        }
    }
    all.push_back({"The Stribeck curve fits better than the viscous line", "7 of 7 joints",
                   std::to_string(better) + " of 7 joints",
                   better == printed_joints});
    all.push_back({"The cubic fits some joints better than the Stribeck curve (3 to 5 of 7)", "4 of 7 joints",
                   std::to_string(cubic_better) + " of 7 joints", cubic_better >= 3 && cubic_better <= 5});
    all.push_back({"The friction curves of Table II come out again (within 3 % of the friction at 0.02 "
                   "rad/s)", "",
                   std::to_string(near) + " of 14 curves, worst " + num(100 * worst, 2) + " %", near == 14});
}

// Is there a found line within 1 % of the printed frequency?
const AngleLine *line_near(const std::vector<AngleLine> &lines, double f)
{
    for (const AngleLine &l : lines)
        if (std::fabs(l.cycles_per_rad / f - 1) < 0.01)
            return &l;
    return nullptr;
}

void position_statements(const Results &r, std::vector<Statement> &all)
{
    int found = 0, near = 0;
    for (std::size_t j = 0; j < printed_joints; j++)
        for (const PrintedLine &p : table_3[j])
            if (const AngleLine *l = line_near(r.position[j].lines[0], p.f)) {
                found++;
                near += std::fabs(l->amplitude_nm / p.amplitude - 1) < 0.2;
            }
    all.push_back({"The two strongest lines of friction over position are those of Table III (frequencies "
                   "within 1 %)", "14 lines",
                   std::to_string(found) + " of 14", found == 2 * printed_joints});
    all.push_back({"... and their amplitudes (within 20 %)", "14 lines", std::to_string(near) + " of 14",
                   near == 2 * printed_joints});
}

void stiffness_statements(const Results &r, std::vector<Statement> &all)
{
    std::string steps, inside;
    int drops = 0, smaller = 0;
    for (std::size_t j = 0; j < sweep_joints; j++) {
        const JointStiffness &s = r.stiffness[j];
        const double step = s.fit[0].step_nm(), printed =
            table_5[j][0].slope_2 * (table_5[j][0].t_2 - table_5[j][0].t_1),
                     share = s.ripple[0].inside_nm / s.ripple[0].outside_nm;
        steps += (j == 0 ? "" : ", ") + num(step);
        inside += (j == 0 ? "" : ", ") + num(share, 2);
        drops += step > 0.65 * printed && step < 1.35 * printed;
        smaller += share < 0.8;
    }
    all.push_back({"Joint torque drops sharply where gravity begins to drive the joint; joints 1 to 4, N m, "
                   "positive direction",
                   "29.5, 30.8, 9.8, 16.8", steps, drops == sweep_joints});
    all.push_back({"The periodic torque is smaller in that region (inside / outside; joints 1 to 4)",
                   "\"significantly lower\"", inside,
                   smaller == sweep_joints});
}

void loop_statements(const Results &r, std::vector<Statement> &all)
{
    const Loop &own = loop_named(r, "measured"), &none = loop_named(r, "feedback alone"),
               &ten = loop_named(r, "10 x gains");
    const double mean = own.mean(&LoopFigures::error_mean_mm), most = own.most(&LoopFigures::error_max_mm),
                 first = own.mean(&LoopFigures::first_second_max_mm), fall = none.most(&LoopFigures::fall_mm);
    const auto within_two = [](double ours, double paper) { return ours < 2 * paper && ours > paper / 2; };
    const auto mm = [](double ours, double paper) {
        return num(ours) + " mm" + (ours < paper / 2 ? ": the rig is better" : "");
    };
    all.push_back({"Lemniscate with the model fed forward: mean flange error (within a factor of two)",
                   "7 mm", mm(mean, 7), within_two(mean, 7)});
    all.push_back({"... largest error after the first second (within a factor of two)", "19 mm", mm(most, 19),
                   within_two(most, 19)});
    all.push_back({"... largest error at the beginning (within a factor of two)", "42 mm", mm(first, 42),
                   within_two(first, 42)});
    all.push_back({"With the same gains and no feed-forward the arm collapses (falls more than 100 mm)",
                   "\"collapse\"", num(fall) + " mm below the path", fall > 100});
    const double ten_mean = ten.mean(&LoopFigures::error_mean_mm);
    all.push_back({"Without the model the same accuracy needs gains at least ten times higher",
                   "\"at least a factor of 10\"",
                   ten.fault.empty() ? num(ten_mean) + " mm mean with ten times the gains"
                                     : "ten times the gains: fault " + ten.fault,
                   !ten.fault.empty() || ten_mean > 0.8 * mean});
}

} // namespace

std::vector<Statement> statements(const Plan &plan, const Results &r)
{
    std::vector<Statement> all;
    if (plan.want(PART_FRICTION))
        friction_statements(r, all);
    if (plan.want(PART_POSITION))
        position_statements(r, all);
    if (plan.want(PART_STIFFNESS))
        stiffness_statements(r, all);
    if (plan.want(PART_LEMNISCATE))
        loop_statements(r, all);
    if (plan.want(PART_JOINT_3)) {
        double mean = 0;
        for (const LoopFigures &f : r.joint_3.figures)
            mean += f.joint_mean_rad[2] / static_cast<double>(r.joint_3.figures.size());
        all.push_back({"Joint 3, 1.0 rad at 0.1 rad/s: mean error (within a factor of two)", "0.01 rad",
                       num(mean, 2) + " rad" + (mean < 0.005 ? ": the rig is better" : ""),
                       mean < 0.02 && mean > 0.005 && r.joint_3.fault.empty()});
    }
    if (plan.want(PART_LOW)) {
        const LowRegion &without = r.low[0], &with = r.low[1];
        all.push_back({"Through the low region the model needs the lines: feedback share without and with "
                       "them (less than half)",
                       "described, no numbers",
                       num(100 * without.feedback_share, 2) + " and " + num(100 * with.feedback_share, 2) +
                           " %",
                       with.feedback_share < 0.5 * without.feedback_share && with.fault.empty()});
    }
    if (plan.want(PART_EQUATIONS)) {
        int right = 0;
        for (const EquationCheck &c : r.equations)
            right += std::min(c.printed_nm, c.printed_negated_nm) < 1e-6;
        all.push_back({"Gravity equations (9) to (13) are right as printed", "5 of 5",
                       std::to_string(right) + " of 5", right == 5});
    }
    return all;
}

} // namespace hdt::paper
