// SPDX-License-Identifier: Apache-2.0
//
// The numbers of `hdt paper` as JSON.
#include <nlohmann/json.hpp>

#include "tools/hdt_paper_page.hpp"

namespace hdt::paper {

namespace {

using nlohmann::json;

const char *const directions[2] = {"positive", "negative"};

json fit_json(const FrictionModelFit &fit, int parameters)
{
    return {{"parameters", std::vector<double>(fit.parameters.begin(), fit.parameters.end())},
            {"sigma", std::vector<double>(fit.sigma.begin(), fit.sigma.end())},
            {"weighted_residual_variance", fit.variance},
            {"mse_per_dof_printed", printed_mse(fit.variance, parameters)},
            {"rms_nm", fit.rms_nm}};
}

json friction_json(const Results &r)
{
    json all = json::array();
    for (std::size_t j = 0; j < printed_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            const JointFriction &f = r.friction[j];
            json points = json::array();
            for (const SpeedPoint &p : f.points[d])
                points.push_back({{"speed_radps", p.speed_radps}, {"mean_nm", p.mean_nm}, {"sd_nm", p.sd_nm},
                                  {"trials", p.trials}});
            const hdt_arm_friction printed = magnitudes(d == 0 ? table_2[j].positive : table_2[j].negative);
            all.push_back({{"joint", j + 1},
                           {"direction", directions[d]},
                           {"points", points},
                           {"viscous", fit_json(f.viscous[d], 2)},
                           {"cubic", fit_json(f.cubic[d], 4)},
                           {"stribeck", fit_json(f.stribeck[d], 4)},
                           {"curve_gap_to_table_2_nm", curve_gap_nm(printed, stribeck_of(f.stribeck[d]))}});
        }
    return all;
}

json position_json(const Results &r)
{
    json all = json::array();
    for (std::size_t j = 0; j < printed_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            json lines = json::array();
            for (const AngleLine &l : r.position[j].lines[d])
                lines.push_back({{"cycles_per_rad", l.cycles_per_rad}, {"amplitude_nm", l.amplitude_nm},
                                 {"phase_rad", l.phase_rad}});
            all.push_back({{"joint", j + 1},
                           {"direction", directions[d]},
                           {"mean_nm", r.position[j].turns[d].mean()},
                           {"lines", lines},
                           {"rms_nm", r.position[j].rms_nm[d]},
                           {"rest_rms_nm", r.position[j].rest_rms_nm[d]}});
        }
    return all;
}

json stiffness_json(const Results &r)
{
    json all = json::array();
    for (std::size_t j = 0; j < sweep_joints; j++)
        for (std::size_t d = 0; d < 2; d++) {
            const JointStiffness &s = r.stiffness[j];
            const hdt_arm_stiffness &k = s.fit[d].lines;
            all.push_back({{"joint", j + 1},
                           {"direction", directions[d]},
                           {"sign", "joint"},
                           {"slope", {k.slope[0], k.slope[1], k.slope[2]}},
                           {"t1_nm", k.t1_nm},
                           {"t2_nm", k.t2_nm},
                           {"zero_nm", k.zero_nm},
                           {"step_nm", s.fit[d].step_nm()},
                           {"rms_nm", s.fit[d].rms_nm},
                           {"one_line_rms_nm", s.fit[d].flat_rms_nm},
                           {"ripple_inside_nm", s.ripple[d].inside_nm},
                           {"ripple_outside_nm", s.ripple[d].outside_nm}});
        }
    return all;
}

json loop_json(const Loop &l)
{
    json runs = json::array();
    for (const LoopFigures &f : l.figures)
        runs.push_back({{"first_second_max_mm", f.first_second_max_mm},
                        {"error_mean_mm", f.error_mean_mm},
                        {"error_max_mm", f.error_max_mm},
                        {"seen_mean_mm", f.seen_mean_mm},
                        {"seen_max_mm", f.seen_max_mm},
                        {"fall_mm", f.fall_mm},
                        {"feedback_share", f.feedback_share},
                        {"joint_mean_rad", f.joint_mean_rad},
                        {"joint_max_rad", f.joint_max_rad},
                        {"joint_feedback_share", f.joint_feedback_share}});
    return {{"name", l.setup.name}, {"what", l.what}, {"fault", l.fault}, {"runs", runs}};
}

json low_json(const Results &r)
{
    json all = json::array();
    for (const LowRegion &l : r.low)
        all.push_back({{"name", l.name},
                       {"fault", l.fault},
                       {"zones", {"load against", "step", "load driving"}},
                       {"error_rad", l.error_rad},
                       {"error_max_rad", l.error_max_rad},
                       {"feedback_rms_nm", l.feedback_nm},
                       {"feedback_share", l.feedback_share}});
    return all;
}

json equations_json(const Results &r)
{
    json all = json::array();
    for (std::size_t i = 0; i < r.equations.size(); i++)
        all.push_back({{"equation", i + 9},
                       {"printed_worst_nm", r.equations[i].printed_nm},
                       {"negated_worst_nm", r.equations[i].printed_negated_nm},
                       {"right_worst_nm", r.equations[i].right_nm},
                       {"largest_nm", r.equations[i].largest_nm}});
    return all;
}

} // namespace

std::string json_of(const Plan &plan, const Results &r)
{
    json out = {{"format", "hdt-paper"}, {"version", 1}, {"arm", plan.rig.arm.name}, {"individual",
            plan.rig.individual},
                {"seed", plan.rig.seed}, {"trials", plan.trials}};
    json said = json::array();
    for (const Statement &s : statements(plan, r))
        said.push_back({{"statement", s.text}, {"paper", s.paper}, {"rig", s.ours}, {"holds", s.holds}});
    out["statements"] = said;
    if (plan.want(PART_FRICTION))
        out["friction"] = friction_json(r);
    if (plan.want(PART_POSITION))
        out["position"] = position_json(r);
    if (plan.want(PART_STIFFNESS))
        out["stiffness"] = stiffness_json(r);
    for (const Loop &l : r.lemniscate)
        out["lemniscate"].push_back(loop_json(l));
    if (plan.want(PART_JOINT_3))
        out["joint_3"] = loop_json(r.joint_3);
    if (plan.want(PART_LOW))
        out["low_region"] = low_json(r);
    if (plan.want(PART_EQUATIONS))
        out["equations"] = equations_json(r);
    return out.dump(1) + "\n";
}

} // namespace hdt::paper
