// SPDX-License-Identifier: Apache-2.0
//
// Reference motions keep what they promise: smooth, at rest at both ends, inside limits, on the
// paper's path, the same every time; and bad requests get one clear line.
//
// Method: properties of the sampled arrays against formulas written out here a second time.
#include "model/task.hpp"

#include <cmath>
#include <string>

#include "model/arm_file.hpp"
#include "model/rbd.hpp"
#include "tests/check_main.h"
#include "tests/table_four_arm.hpp"

using hdt::InputError;
using hdt::Reference;
using hdt::make_task;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

static const double pi = 3.14159265358979323846;

static const char *const every_task[] = {
    "lemniscate", "lemniscate:laps=2", "excite", "excite:seed=7,seconds=20,joints=2,4", "sweep:joint=2",
    "sweep:joint=2,q4=1.57", "sweep:joint=6,speed=0.3", "friction:joint=2", "friction:joint=7,trials=2",
    "trapezoid:joint=3", "trapezoid:joint=2,distance=-0.3,q2=0.5", "hold", "hold:seconds=1,q2=0.5",
};
enum { TASKS = sizeof every_task / sizeof every_task[0] };

START_TEST(test_velocity_and_acceleration_are_the_derivatives)
{
    // Fourth-order differences.  A ramp's fourth derivative is at most 60 v / T^3 = 375 rad/s^4 and
    // jumps at its ends, so the error there is of the order of that times h^3 for v, h^2 for a.
    const double rate = 2800, h = 1 / rate;
    const Reference r = make_task(table_four_arm(), every_task[_i], rate);
    const Eigen::Index n = r.q_rad.rows() - 4;
    const auto slope = [&](const MatrixXd &x) -> MatrixXd {
        const MatrixXd near = x.middleRows(3, n) - x.middleRows(1, n);
        const MatrixXd far = x.middleRows(4, n) - x.topRows(n);
        return (8 * near - far) / (12 * h);
    };
    const double dv = (slope(r.q_rad) - r.v_radps.middleRows(2, n)).cwiseAbs().maxCoeff();
    const double da = (slope(r.v_radps) - r.a_radps2.middleRows(2, n)).cwiseAbs().maxCoeff();
    ck_assert_msg(dv < 375 * h * h * h, "%s: v off by %g", every_task[_i], dv);
    ck_assert_msg(da < 375 * h * h, "%s: a off by %g", every_task[_i], da);
}
END_TEST

START_TEST(test_every_task_starts_and_ends_at_rest)
{
    const Reference r = make_task(table_four_arm(), every_task[_i], 700);
    const Eigen::Index rest = 140; // 0.2 s
    ck_assert_double_eq(r.v_radps.topRows(rest).cwiseAbs().maxCoeff(), 0);
    ck_assert_double_eq(r.a_radps2.topRows(rest).cwiseAbs().maxCoeff(), 0);
    ck_assert_double_eq(r.v_radps.bottomRows(rest).cwiseAbs().maxCoeff(), 0);
    ck_assert_double_eq(r.a_radps2.bottomRows(rest).cwiseAbs().maxCoeff(), 0);
    ck_assert_double_le((r.q_rad.topRows(rest).rowwise() - r.q_rad.row(0)).cwiseAbs().maxCoeff(), 1e-12);
    ck_assert_double_eq(r.rate_hz, 700);
    ck_assert_str_eq(r.name.c_str(), every_task[_i]);
}
END_TEST

START_TEST(test_every_task_stays_inside_the_limits)
{
    const hdt_arm arm = table_four_arm();
    const Reference r = make_task(arm, every_task[_i], 700);
    for (int j = 0; j < arm.joints; ++j) {
        ck_assert_double_ge(r.q_rad.col(j).minCoeff(), arm.joint[j].q_min_rad);
        ck_assert_double_le(r.q_rad.col(j).maxCoeff(), arm.joint[j].q_max_rad);
        ck_assert_double_le(r.v_radps.col(j).cwiseAbs().maxCoeff(), arm.joint[j].v_max_radps);
        // what is not driven stands still
        if (!(r.active >> j & 1))
            ck_assert_double_eq(r.v_radps.col(j).cwiseAbs().maxCoeff(), 0);
    }
}
END_TEST

START_TEST(test_a_task_is_a_function_of_time_not_of_the_rate)
{
    const hdt_arm arm = table_four_arm();
    const Reference a = make_task(arm, every_task[_i], 500), b = make_task(arm, every_task[_i], 1000);
    const Eigen::Index n = std::min(a.q_rad.rows(), (b.q_rad.rows() + 1) / 2);
    ck_assert_int_ge((int)n, (int)a.q_rad.rows() - 1);
    double worst = 0;
    for (Eigen::Index i = 0; i < n; ++i)
        worst = std::max(worst, (a.q_rad.row(i) - b.q_rad.row(2 * i)).cwiseAbs().maxCoeff());
    // inverse kinematics ends at 1e-11 m; a few times that in joint angles
    ck_assert_double_le(worst, 1e-10);
}
END_TEST

START_TEST(test_lemniscate_is_the_paper_path_with_constant_orientation)
{
    const hdt_arm arm = table_four_arm();
    const Reference r = make_task(arm, "lemniscate", 700);
    ck_assert_uint_eq(r.active, 0x7bu);
    ck_assert_double_eq(r.q_rad.col(2).cwiseAbs().maxCoeff(), 0);
    double far = 0, turned = 0, implicit = 0;
    for (Eigen::Index i = 0; i < r.q_rad.rows(); ++i) {
        const auto f = hdt::rbd::flange(arm, r.q_rad.row(i).transpose());
        turned = std::max(turned, (f.rot.col(2) - Vector3d(1, 0, 0)).norm()
                          + (f.rot.col(1) - Vector3d(0, 1, 0)).norm());
        // on the curve at any time: Bernoulli's (X^2 + Y^2)^2 = X^2 - Y^2
        const double x2 = std::pow(f.pos.y() / 0.2, 2), y2 = std::pow((f.pos.z() - 0.1) / 0.4, 2);
        implicit = std::max({implicit, std::fabs((x2 + y2) * (x2 + y2) - x2 + y2),
                             std::fabs(f.pos.x() - 0.6)});
        // past the ramp, paper time runs with the clock: 0.25 s rest and half of the 1.5 s ramp behind
        const double clock_s = (double)i / 700, t = clock_s - 1.0;
        if (clock_s < 1.75 || t > 4 * pi - 0.75)
            continue;
        const double s = std::sin(t / 2), c = std::cos(t / 2);
        const Vector3d want(0.6, 0.2 * c / (1 + s * s), 0.1 + 0.4 * s * c / (1 + s * s));
        far = std::max(far, (f.pos - want).norm());
    }
    ck_assert_double_le(far, 1e-9);
    ck_assert_double_le(turned, 1e-9);
    ck_assert_double_le(implicit, 1e-9);
    // closed, and well away from where the wrist is singular
    ck_assert_double_le((r.q_rad.row(0) - r.q_rad.bottomRows(1)).norm(), 1e-9);
    ck_assert_double_ge(r.q_rad.col(5).cwiseAbs().minCoeff(), 1.0);
    ck_assert_double_ge(r.q_rad.col(3).cwiseAbs().minCoeff(), 1.0);
    ck_assert_int_eq((int)make_task(arm, "lemniscate:laps=3", 700).q_rad.rows(),
                     1 + (int)std::ceil(700 * (12 * pi + 2)));
}
END_TEST

START_TEST(test_lemniscate_point_is_equation_fourteen)
{
    for (double t = -20; t < 20; t += 0.37) {
        const double s = std::sin(t / 2), c = std::cos(t / 2);
        const Vector3d want(0.6, 0.2 * c / (1 + s * s), 0.1 + 0.4 * s * c / (1 + s * s));
        ck_assert_double_le((hdt::lemniscate_m(t) - want).norm(), 1e-14);
    }
    ck_assert_double_eq(hdt::lemniscate_rot().determinant(), 1);
}
END_TEST

START_TEST(test_excitation_is_decided_by_its_seed)
{
    const hdt_arm arm = table_four_arm();
    const Reference a = make_task(arm, "excite:seed=3", 100), b = make_task(arm, "excite:seed=3", 100),
                    c = make_task(arm, "excite:seed=4", 100);
    ck_assert(a.q_rad == b.q_rad && a.v_radps == b.v_radps && a.a_radps2 == b.a_radps2);
    ck_assert_double_gt((a.q_rad - c.q_rad).cwiseAbs().maxCoeff(), 0.1);
    ck_assert_int_eq((int)a.q_rad.rows(), 4001);
}
END_TEST

START_TEST(test_excitation_is_rich)
{
    const hdt_arm arm = table_four_arm();
    for (int seed = 1; seed <= 5; ++seed) {
        const Reference r = make_task(arm, "excite:seconds=60,seed=" + std::to_string(seed), 100);
        const Eigen::ArrayXXd speed = r.v_radps.cwiseAbs().array();
        // several joints move most of the time
        const double busy = (speed > 1e-6).cast<double>().sum() / (double)speed.rows();
        ck_assert_double_ge(busy, 4.5);
        for (int j = 0; j < 7; ++j) {
            ck_assert_double_gt(r.v_radps.col(j).maxCoeff(), 0.05);
            ck_assert_double_lt(r.v_radps.col(j).minCoeff(), -0.05);
            ck_assert_double_le(speed.col(j).maxCoeff(), 0.4 + 1e-12);
            const double slow = ((speed.col(j) > 0.005) && (speed.col(j) < 0.05)).cast<double>().sum();
            ck_assert_double_ge(slow, 100);
            ck_assert_double_le(r.q_rad.col(j).cwiseAbs().maxCoeff(),
                                std::min(1.5, 0.6 * arm.joint[j].q_max_rad) + 1e-12);
        }
    }
}
END_TEST

// Shoulder 0.25 m above the plane, elbow bending past 180 deg: much to hit.
static hdt_arm low_arm()
{
    hdt_arm arm = table_four_arm();
    arm.joint[0].origin_m[2] = 0;
    arm.joint[1].origin_m[2] = 0.25;
    arm.joint[3].q_max_rad = 5.2;
    arm.joint[3].q_min_rad = -5.2;
    return arm;
}

START_TEST(test_excitation_never_hits_floor_or_base)
{
    // of these seeds one in four would hit something if moves were not looked at before they are taken
    const hdt_arm arm = low_arm();
    for (int seed = 1; seed <= 20; ++seed) {
        const Reference r = make_task(arm, "excite:q2=-0.3,q4=2.2,seed=" + std::to_string(seed), 100);
        for (Eigen::Index i = 0; i < r.q_rad.rows(); ++i) {
            const auto f = hdt::rbd::frames(arm, r.q_rad.row(i).transpose());
            for (std::size_t k = 3; k < f.size(); ++k) { // elbow to flange
                ck_assert_msg(f[k].pos.z() > 0.04, "seed %d row %d frame %d: z = %g", seed, (int)i, (int)k,
                              f[k].pos.z());
                ck_assert(f[k].pos.z() > 0.24 || std::hypot(f[k].pos.x(), f[k].pos.y()) > 0.19);
            }
        }
    }
}
END_TEST

START_TEST(test_excitation_moves_only_the_named_joints)
{
    const Reference r = make_task(table_four_arm(), "excite:joints=2,5,seconds=20,q1=0.4", 100);
    ck_assert_uint_eq(r.active, 0x12u);
    for (int j = 0; j < 7; ++j) {
        const double way = r.q_rad.col(j).maxCoeff() - r.q_rad.col(j).minCoeff();
        ck_assert((way > 0.05) == (j == 1 || j == 4));
    }
    ck_assert_double_eq(r.q_rad(500, 0), 0.4);
}
END_TEST

START_TEST(test_sweep_goes_ninety_degrees_both_ways_at_constant_speed)
{
    const Reference r = make_task(table_four_arm(), "sweep:joint=2,speed=0.2", 700);
    ck_assert_uint_eq(r.active, 2u);
    ck_assert_double_eq_tol(r.q_rad.col(1).minCoeff(), -pi / 2, 1e-12);
    ck_assert_double_eq_tol(r.q_rad.col(1).maxCoeff(), pi / 2, 1e-12);
    const Eigen::ArrayXd v = r.v_radps.col(1).array();
    const double up = ((v - 0.2).abs() < 1e-12).cast<double>().sum() / 700,
                 down = ((v + 0.2).abs() < 1e-12).cast<double>().sum() / 700;
    // 180 deg less two half ramps at each end
    ck_assert_double_ge(up, pi / 0.2 - 0.41);
    ck_assert_double_ge(down, pi / 0.2 - 0.41);
    // with the elbow bent the flange would dip below the mounting plane: the sweep ends before that
    const Reference bent = make_task(table_four_arm(), "sweep:joint=2,q4=1.57", 700);
    double lowest = 1;
    for (Eigen::Index i = 0; i < bent.q_rad.rows(); i += 10)
        lowest = std::min(lowest, hdt::rbd::flange(table_four_arm(), bent.q_rad.row(i).transpose()).pos.z());
    ck_assert_double_ge(lowest, 0.05);
    ck_assert_double_le(lowest, 0.07);
}
END_TEST

START_TEST(test_friction_staircase_has_whole_turns_at_every_paper_speed)
{
    const Reference r = make_task(table_four_arm(), "friction:joint=4", 700);
    for (double speed : {0.02, 0.04, 0.06, 0.08, 0.1, 0.2, 0.3, 0.4})
        for (double way : {1.0, -1.0}) {
            double seconds = 0;
            for (Eigen::Index i = 0; i < r.q_rad.rows(); ++i)
                if (std::fabs(r.v_radps(i, 3) - way * speed) < 1e-12 && r.a_radps2(i, 3) == 0)
                    seconds += 1 / 700.0;
            // four turns of a wave generator of ratio 50, one sample of counting error at each end
            ck_assert_double_ge(seconds * speed, 4 * 2 * pi / 50 - 2 * speed / 700);
        }
    const Reference trials = make_task(table_four_arm(), "friction:joint=4,trials=5", 100);
    ck_assert_int_eq((int)trials.q_rad.rows() / 100 / 5,
                     (int)r.q_rad.rows() / 700);
}
END_TEST

START_TEST(test_trapezoid_starts_where_gravity_is_heaviest)
{
    const hdt_arm arm = table_four_arm();
    for (int joint = 2; joint <= 4; ++joint) {
        const Reference r = make_task(arm, "trapezoid:joint=" + std::to_string(joint), 700);
        const Eigen::Index j = joint - 1;
        ck_assert_double_eq_tol(std::fabs(r.q_rad(0, j) - r.q_rad(r.q_rad.rows() - 1, j)), 1.0, 1e-12);
        ck_assert_double_eq_tol(r.v_radps.col(j).cwiseAbs().maxCoeff(), 0.1, 1e-12);
        const double start = std::fabs(hdt::rbd::gravity(arm, r.q_rad.row(0).transpose())[j]);
        uint64_t seed = 9;
        double most = 0;
        for (int k = 0; k < 5000; ++k) {
            VectorXd q(7);
            for (int i = 0; i < 7; ++i)
                q[i] = test_uniform(&seed, arm.joint[i].q_min_rad, arm.joint[i].q_max_rad);
            most = std::max(most, std::fabs(hdt::rbd::gravity(arm, q)[j]));
        }
        ck_assert_msg(start >= 0.97 * most, "joint %d: starts at %g N.m, %g is possible", joint, start, most);
    }
}
END_TEST

START_TEST(test_inverse_kinematics_returns_to_the_pose)
{
    const hdt_arm arm = table_four_arm();
    uint64_t seed = 21;
    for (int k = 0; k < 200; ++k) {
        VectorXd q(7), near_q(7);
        const double third = test_uniform(&seed, -1, 1);
        for (int i = 0; i < 7; ++i) {
            q[i] = i == 2             ? third
                   : i == 3 || i == 5 ? test_uniform(&seed, 0.5, 1.5)
                                      : test_uniform(&seed, -1.5, 1.5);
            near_q[i] = q[i] + (i == 2 ? 0 : test_uniform(&seed, -0.05, 0.05));
        }
        const auto want = hdt::rbd::flange(arm, q);
        const VectorXd found = hdt::inverse_kinematics(arm, want.rot, want.pos, near_q, 0x7bu);
        const auto got = hdt::rbd::flange(arm, found);
        ck_assert_double_le((got.pos - want.pos).norm(), 1e-11);
        ck_assert_double_le((got.rot - want.rot).norm(), 3e-11);
        ck_assert_double_eq(found[2], third);
        // with all seven free there is a solution at least as near
        const VectorXd free = hdt::inverse_kinematics(arm, want.rot, want.pos, near_q, 0x7fu);
        ck_assert_double_le((hdt::rbd::flange(arm, free).pos - want.pos).norm(), 1e-11);
    }
}
END_TEST

static std::string refusal(const hdt_arm &arm, const std::string &spec, double rate_hz)
{
    try {
        make_task(arm, spec, rate_hz);
    } catch (const InputError &e) {
        return e.what();
    }
    return "";
}

START_TEST(test_pose_out_of_reach_is_refused)
{
    const hdt_arm arm = table_four_arm();
    for (double x : {1.5, 20.0, 1e9}) {
        bool refused = false;
        try {
            hdt::inverse_kinematics(arm, hdt::lemniscate_rot(), Vector3d(x, 0, 0.3),
                                    VectorXd::Constant(7, 0.5), 0x7f);
        } catch (const InputError &e) {
            refused = std::string(e.what()).find("out of reach") != std::string::npos;
        }
        ck_assert(refused);
    }
}
END_TEST

START_TEST(test_bad_requests_get_one_line_with_the_menu)
{
    static const struct { const char *spec, *must_say; } bad[] = {
        {"", "unknown task"}, {"nix", "unknown task 'nix'"}, {"Lemniscate", "unknown task"},
        {"lemniscate:laps=0", "laps"}, {"lemniscate:laps=1.5", "laps"},
        {"lemniscate:seed=1", "unknown argument 'seed'"},
        {"lemniscate:laps=2,laps=3", "twice"}, {"excite:seed=x", "seed"}, {"excite:seed=", "seed"},
        {"excite:seed=nan", "seed"}, {"excite:seconds=1", "seconds"}, {"excite:seconds=1e9", "seconds"},
        {"excite:joints=0", "joints"}, {"excite:joints=8", "joints"}, {"excite:joints=1.5", "joints"},
        {"excite:joints=1,,2", "joints"}, {"excite:40", "key=value"}, {"excite:q2=1.6", "q2"},
        {"sweep", "joint= is missing"}, {"sweep:joint=9", "joint"},
        {"sweep:joint=2.5", "joint"}, {"sweep:joint=2,speed=0", "speed"},
        {"sweep:joint=2,speed=1.5", "1.000 rad/s"},
        {"sweep:joint=2,q9=1", "unknown argument 'q9'"}, {"friction:joint=2,q2=1.5", "limits"},
        {"friction:joint=2,q2=1.2,q4=1.5", "mounting plane"}, {"trapezoid:joint=3,distance=9", "limits"},
        {"hold:seconds=-1", "seconds"}, {"hold:q2=2", "limits"}, {"hold:seconds=30000", "too long"},
    };
    const hdt_arm arm = table_four_arm();
    for (const auto &b : bad) {
        const std::string line = refusal(arm, b.spec, 700);
        ck_assert_msg(line.find(b.must_say) != std::string::npos, "'%s': expected '%s' in '%s'", b.spec,
                      b.must_say, line.c_str());
        ck_assert(line.find('\n') == std::string::npos);
        ck_assert(line.find(std::string("task '") + b.spec + "'") == 0);
        for (const auto &t : hdt::task_menu())
            ck_assert(line.find(t.name, line.find("tasks are")) != std::string::npos);
    }
    for (double rate : {0.0, -700.0, 1e6, std::nan("")})
        ck_assert(refusal(arm, "hold", rate).find("rate") != std::string::npos);
}
END_TEST

START_TEST(test_arm_that_cannot_is_told_so)
{
    hdt_arm slow = table_four_arm();
    slow.joint[1].v_max_radps = 0.3;
    std::string line = refusal(slow, "lemniscate", 700);
    ck_assert_msg(line.find("joint 2") != std::string::npos && line.find("0.300 rad/s") != std::string::npos,
                  "%s", line.c_str());
    hdt_arm tiny = table_four_arm();
    tiny.joint[3].origin_m[2] = 0;
    line = refusal(tiny, "lemniscate", 700);
    ck_assert_msg(line.find("does not reach") != std::string::npos, "%s", line.c_str());
    hdt_arm few = table_four_arm();
    few.joints = 5;
    ck_assert(refusal(few, "lemniscate", 700).find("six joints") != std::string::npos);
    // below the plane; folded down beside the base but above the plane; and one that is neither
    const std::string low = refusal(low_arm(), "excite:q2=0.9,q4=1.8", 100);
    ck_assert(low.find("start pose touches") != std::string::npos);
    ck_assert(refusal(low_arm(), "excite:q4=3.05", 100).find("start pose touches") != std::string::npos);
    ck_assert(refusal(low_arm(), "excite:q4=1.5", 100).empty());
    // without masses nobody knows where gravity is heaviest
    hdt_arm massless = table_four_arm();
    for (int j = 0; j < 7; ++j)
        massless.joint[j].has_inertial = 0;
    ck_assert(refusal(massless, "trapezoid", 100).find("no masses") != std::string::npos);
    ck_assert(refusal(massless, "trapezoid:q2=1", 100).empty());
    // an elbow that cannot bend far enough on part of the path
    hdt_arm stiff = table_four_arm();
    stiff.joint[3].q_max_rad = 1.8;
    stiff.joint[3].q_min_rad = -1.8;
    line = refusal(stiff, "lemniscate", 700);
    ck_assert_msg(line.find("joint 4") != std::string::npos && line.find("limits") != std::string::npos,
                  "%s", line.c_str());
}
END_TEST

START_TEST(test_tasks_serve_other_arms)
{
    // one joint to eight, ranges that leave zero out
    for (int joints = 1; joints <= 8; ++joints) {
        hdt_arm arm = table_four_arm();
        arm.joint[7] = arm.joint[6];
        arm.joints = joints;
        arm.joint[joints - 1].q_min_rad = 0.5;
        arm.joint[joints - 1].q_max_rad = 2.5;
        for (const char *spec : {"excite:seconds=10", "hold", "friction:joint=1"}) {
            const Reference r = make_task(arm, spec, 100);
            ck_assert_int_eq((int)r.q_rad.cols(), joints);
            ck_assert_double_ge(r.q_rad.col(joints - 1).minCoeff(), 0.5);
        }
    }
}
END_TEST

START_TEST(test_no_text_crashes_or_hangs)
{
    static const char alphabet[] = "excitholdsweepfrc:,=joint12345q.-e+ \xff\n";
    static const char *const stems[] = {"", "excite:", "hold:", "sweep:joint=", "friction:joint=2,",
                                        "trapezoid:"};
    const hdt_arm arm = table_four_arm();
    uint64_t seed = 77;
    for (int k = 0; k < 600; ++k) {
        std::string spec = stems[test_random(&seed) % 6];
        for (uint64_t n = test_random(&seed) % 16; n > 0; --n)
            spec += alphabet[test_random(&seed) % (sizeof alphabet - 1)];
        try {
            const Reference r = make_task(arm, spec, 20);
            ck_assert(r.q_rad.allFinite() && r.v_radps.allFinite() && r.a_radps2.allFinite());
        } catch (const InputError &) {
        }
    }
}
END_TEST

static Suite *task_suite(void)
{
    Suite *s = suite_create("task");
    TCase *c = tcase_create("every task");
    tcase_set_timeout(c, 60);
    tcase_add_loop_test(c, test_velocity_and_acceleration_are_the_derivatives, 0, TASKS);
    tcase_add_loop_test(c, test_every_task_starts_and_ends_at_rest, 0, TASKS);
    tcase_add_loop_test(c, test_every_task_stays_inside_the_limits, 0, TASKS);
    tcase_add_loop_test(c, test_a_task_is_a_function_of_time_not_of_the_rate, 0, TASKS);
    suite_add_tcase(s, c);
    c = tcase_create("each task");
    tcase_set_timeout(c, 120);
    tcase_add_test(c, test_lemniscate_is_the_paper_path_with_constant_orientation);
    tcase_add_test(c, test_lemniscate_point_is_equation_fourteen);
    tcase_add_test(c, test_excitation_is_decided_by_its_seed);
    tcase_add_test(c, test_excitation_is_rich);
    tcase_add_test(c, test_excitation_never_hits_floor_or_base);
    tcase_add_test(c, test_excitation_moves_only_the_named_joints);
    tcase_add_test(c, test_sweep_goes_ninety_degrees_both_ways_at_constant_speed);
    tcase_add_test(c, test_friction_staircase_has_whole_turns_at_every_paper_speed);
    tcase_add_test(c, test_trapezoid_starts_where_gravity_is_heaviest);
    tcase_add_test(c, test_inverse_kinematics_returns_to_the_pose);
    suite_add_tcase(s, c);
    c = tcase_create("bad requests");
    tcase_set_timeout(c, 120);
    tcase_add_test(c, test_pose_out_of_reach_is_refused);
    tcase_add_test(c, test_bad_requests_get_one_line_with_the_menu);
    tcase_add_test(c, test_arm_that_cannot_is_told_so);
    tcase_add_test(c, test_tasks_serve_other_arms);
    tcase_add_test(c, test_no_text_crashes_or_hangs);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(task_suite())
