// SPDX-License-Identifier: Apache-2.0
//
// Rigid-body dynamics against physics and against a second, independent implementation.
//
// Method: random arms of 1 to 8 joints with arbitrary frames, inertias and payload; the second
// implementation is Lagrange's: kinetic energy from numerically differentiated 4 x 4 transforms,
// equations of motion from numeric derivatives of kinetic and potential energy.
#include "model/rbd.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "tests/random_arm.hpp"
#include "tests/table_four_arm.hpp"

using namespace hdt::rbd;

// Inertias need not be physical: the equations of motion are linear in them.
static hdt_arm random_arm(uint64_t *seed, int joints)
{
    hdt_arm arm;
    std::memset(&arm, 0, sizeof arm);
    arm.joints = joints;
    fill(seed, arm.gravity_mps2, 3, 10);
    fill(seed, arm.flange_m, 3, 0.3);
    store(random_rotation(seed), arm.flange_rot);
    arm.payload_kg = test_uniform(seed, 0, 5);
    fill(seed, arm.payload_com_m, 3, 0.2);
    for (int j = 0; j < joints; ++j) {
        hdt_arm_joint &k = arm.joint[j];
        fill(seed, k.origin_m, 3, 0.5);
        store(random_rotation(seed), k.rot);
        k.has_inertial = 1;
        k.mass_kg = test_uniform(seed, 0, 10);
        fill(seed, k.moment_kgm, 3, 2);
        fill(seed, k.inertia_kgm2, 6, 1);
    }
    return arm;
}

static Matrix3d from_rows(const double *p)
{
    Matrix3d m;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
            m(r, c) = p[3 * r + c];
    return m;
}

// Independent forward kinematics: 4 x 4 transform of body `body` (joints: the flange).
static Eigen::Isometry3d transform(const hdt_arm &arm, const VectorXd &q, int body)
{
    Eigen::Isometry3d t = Eigen::Isometry3d::Identity();
    for (int j = 0; j <= body && j < arm.joints; ++j) {
        Eigen::Isometry3d fixed = Eigen::Isometry3d::Identity();
        fixed.linear() = from_rows(arm.joint[j].rot);
        fixed.translation() = Eigen::Map<const Vector3d>(arm.joint[j].origin_m);
        t = t * fixed * Eigen::AngleAxisd(q[j], Vector3d::UnitZ());
    }
    if (body == arm.joints) {
        Eigen::Isometry3d fixed = Eigen::Isometry3d::Identity();
        fixed.linear() = from_rows(arm.flange_rot);
        fixed.translation() = Eigen::Map<const Vector3d>(arm.flange_m);
        t = t * fixed;
    }
    return t;
}

struct Body { double mass; Vector3d moment; Matrix3d inertia; };

static Body body_of(const hdt_arm &arm, int body)
{
    Body b;
    if (body == arm.joints) {
        const Vector3d c = Eigen::Map<const Vector3d>(arm.payload_com_m);
        b.mass = arm.payload_kg;
        b.moment = b.mass * c;
        for (int r = 0; r < 3; ++r)
            for (int s = 0; s < 3; ++s)
                b.inertia(r, s) = b.mass * ((r == s ? c.dot(c) : 0) - c[r] * c[s]);
        return b;
    }
    const hdt_arm_joint &j = arm.joint[body];
    b.mass = j.mass_kg;
    b.moment = Eigen::Map<const Vector3d>(j.moment_kgm);
    const double *i = j.inertia_kgm2;
    b.inertia << i[0], i[1], i[2], i[1], i[3], i[4], i[2], i[4], i[5];
    return b;
}

// Mass matrix from numerically differentiated transforms (five-point stencil).
static MatrixXd mass_matrix(const hdt_arm &arm, const VectorXd &q)
{
    const double h = 1e-3;
    const int n = arm.joints;
    MatrixXd m = MatrixXd::Zero(n, n);
    for (int body = 0; body <= n; ++body) {
        const Body b = body_of(arm, body);
        const Matrix3d rot = transform(arm, q, body).linear();
        MatrixXd jv(3, n), jw(3, n);
        for (int j = 0; j < n; ++j) {
            Eigen::Matrix4d d = Eigen::Matrix4d::Zero();
            for (int k = -2; k <= 2; ++k) {
                static const double weight[5] = {1, -8, 0, 8, -1};
                VectorXd p = q;
                p[j] += k * h;
                d += weight[k + 2] / (12 * h) * transform(arm, p, body).matrix();
            }
            const Matrix3d s = d.topLeftCorner<3, 3>() * rot.transpose();
            // everything in the body's own frame
            jv.col(j) = rot.transpose() * d.topRightCorner<3, 1>();
            jw.col(j) = rot.transpose() * Vector3d(s(2, 1), s(0, 2), s(1, 0));
        }
        MatrixXd hx_jw(3, n);
        for (int j = 0; j < n; ++j)
            hx_jw.col(j) = b.moment.cross(Vector3d(jw.col(j)));
        const MatrixXd mixed = jv.transpose() * hx_jw;
        m += b.mass * jv.transpose() * jv - mixed - mixed.transpose() + jw.transpose() * b.inertia * jw;
    }
    return m;
}

static double potential_by_transforms(const hdt_arm &arm, const VectorXd &q)
{
    const Vector3d g = Eigen::Map<const Vector3d>(arm.gravity_mps2);
    double u = 0;
    for (int body = 0; body <= arm.joints; ++body) {
        const Body b = body_of(arm, body);
        const Eigen::Isometry3d t = transform(arm, q, body);
        u -= g.dot(b.mass * t.translation() + t.linear() * b.moment);
    }
    return u;
}

// Fourth-order derivative of f along `direction` at q.
template <typename F> static auto derivative(const VectorXd &q, const VectorXd &direction, F f)
{
    using Value = decltype(f(q)); // not an expression of temporaries
    const double h = 1e-3;
    const Value inner = f(q + h * direction) - f(q - h * direction);
    const Value outer = f(q + 2 * h * direction) - f(q - 2 * h * direction);
    return Value((8 * inner - outer) / (12 * h));
}

static VectorXd lagrange(const hdt_arm &arm, const VectorXd &q, const VectorXd &qd, const VectorXd &qdd)
{
    const MatrixXd m_dot = derivative(q, qd, [&](const VectorXd &p) { return mass_matrix(arm, p); });
    VectorXd tau = mass_matrix(arm, q) * qdd + m_dot * qd;
    for (int j = 0; j < arm.joints; ++j) {
        const VectorXd e = VectorXd::Unit(arm.joints, j);
        tau[j] -= derivative(q, e, [&](const VectorXd &p) { return 0.5 * qd.dot(mass_matrix(arm, p) * qd); });
        tau[j] += derivative(q, e, [&](const VectorXd &p) { return potential_by_transforms(arm, p); });
    }
    return tau;
}

static void expect_near(const VectorXd &a, const VectorXd &b, double tolerance, const char *what,
                        uint64_t seed)
{
    ck_assert_int_eq((int)a.size(), (int)b.size());
    const double worst = (a - b).cwiseAbs().maxCoeff();
    ck_assert_msg(worst <= tolerance, "%s: seed %llu: off by %g, allowed %g", what, (unsigned long long)seed,
                  worst, tolerance);
}

START_TEST(test_frames_agree_with_homogeneous_transforms)
{
    for (uint64_t s = 1; s <= 40; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3);
        const std::vector<Pose> f = frames(arm, q);
        ck_assert_uint_eq(f.size(), (size_t)arm.joints + 1);
        for (int b = 0; b <= arm.joints; ++b) {
            const Eigen::Isometry3d t = transform(arm, q, b);
            ck_assert_double_le((t.linear() - f[(size_t)b].rot).norm(), 1e-13);
            ck_assert_double_le((t.translation() - f[(size_t)b].pos).norm(), 1e-13);
        }
        ck_assert_double_eq((flange(arm, q).pos - f.back().pos).norm(), 0);
    }
}
END_TEST

START_TEST(test_jacobian_is_the_derivative_of_the_flange_pose)
{
    for (uint64_t s = 1; s <= 40; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3);
        const MatrixXd jac = jacobian(arm, q);
        const Matrix3d rot = flange(arm, q).rot;
        for (int j = 0; j < arm.joints; ++j) {
            const VectorXd e = VectorXd::Unit(arm.joints, j);
            const Eigen::Matrix4d d = derivative(q, e, [&](const VectorXd &p) -> Eigen::Matrix4d {
                return transform(arm, p, arm.joints).matrix(); });
            const Matrix3d w = d.topLeftCorner<3, 3>() * rot.transpose();
            VectorXd column(6);
            column << d.topRightCorner<3, 1>(), w(2, 1), w(0, 2), w(1, 0);
            expect_near(jac.col(j), column, 1e-10, "jacobian", s);
        }
    }
}
END_TEST

START_TEST(test_gravity_is_the_gradient_of_potential_energy)
{
    for (uint64_t s = 1; s <= 80; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3);
        VectorXd slope(arm.joints), slope_own(arm.joints);
        for (int j = 0; j < arm.joints; ++j) {
            const VectorXd e = VectorXd::Unit(arm.joints, j);
            slope[j] = derivative(q, e, [&](const VectorXd &p) { return potential_by_transforms(arm, p); });
            slope_own[j] = derivative(q, e, [&](const VectorXd &p) { return potential_j(arm, p); });
        }
        // five-point stencil at 1e-3: truncation 1e-10, rounding 1e-10 of some 100 J
        expect_near(gravity(arm, q), slope, 2e-9, "gravity", s);
        expect_near(gravity(arm, q), slope_own, 2e-9, "potential", s);
    }
}
END_TEST

START_TEST(test_newton_euler_agrees_with_lagrange)
{
    for (uint64_t s = 1; s <= 24; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3), qd = random_vector(&seed, arm.joints, 2),
                       qdd = random_vector(&seed, arm.joints, 5);
        const VectorXd want = lagrange(arm, q, qd, qdd);
        // numeric differentiation twice over at 1e-3: some 1e-9 of the torque
        const double tolerance = 1e-8 * (1 + want.cwiseAbs().maxCoeff());
        expect_near(inverse_dynamics(arm, q, qd, qdd), want, tolerance, "inverse dynamics", s);
    }
}
END_TEST

static VectorXd parameters(const hdt_arm &arm)
{
    VectorXd p(10 * (arm.joints + 1));
    for (int b = 0; b <= arm.joints; ++b) {
        const Body k = body_of(arm, b);
        p.segment<10>(10 * b) << k.mass, k.moment, k.inertia(0, 0), k.inertia(0, 1), k.inertia(0, 2),
            k.inertia(1, 1), k.inertia(1, 2), k.inertia(2, 2);
    }
    return p;
}

START_TEST(test_regressor_times_parameters_is_inverse_dynamics)
{
    for (uint64_t s = 1; s <= 80; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3), qd = random_vector(&seed, arm.joints, 2),
                       qdd = random_vector(&seed, arm.joints, 5);
        const MatrixXd y = regressor(arm, q, qd, qdd);
        ck_assert_int_eq((int)y.rows(), arm.joints);
        const VectorXd want = inverse_dynamics(arm, q, qd, qdd);
        expect_near(y * parameters(arm), want, 1e-12 * (1 + want.cwiseAbs().maxCoeff()), "regressor", s);
        // a body loads no joint beyond itself
        for (int b = 0; b < arm.joints; ++b)
            if (b + 1 < arm.joints)
                ck_assert_double_eq(y.block(b + 1, 10 * b, arm.joints - b - 1, 10).norm(), 0);
    }
}
END_TEST

START_TEST(test_power_is_the_change_of_energy)
{
    for (uint64_t s = 1; s <= 24; ++s) {
        uint64_t seed = s;
        const hdt_arm arm = random_arm(&seed, 1 + (int)(s % 8));
        const VectorXd q = random_vector(&seed, arm.joints, 3), qd = random_vector(&seed, arm.joints, 2),
                       qdd = random_vector(&seed, arm.joints, 5);
        const auto energy = [&](const VectorXd &t) {
            const VectorXd p = q + t[0] * qd + 0.5 * t[0] * t[0] * qdd, v = qd + t[0] * qdd;
            return 0.5 * v.dot(mass_matrix(arm, p) * v) + potential_by_transforms(arm, p);
        };
        const double want = derivative(VectorXd::Zero(1), VectorXd::Ones(1), energy);
        const double power = inverse_dynamics(arm, q, qd, qdd).dot(qd);
        ck_assert_double_le(std::fabs(power - want), 1e-8 * (1 + std::fabs(want)));
    }
}
END_TEST

START_TEST(test_link_without_inertial_numbers_has_no_mass)
{
    uint64_t seed = 5;
    hdt_arm arm = random_arm(&seed, 4), bare = arm;
    for (int j = 0; j < 4; ++j) {
        bare.joint[j].has_inertial = 0;
        arm.joint[j].mass_kg = 0;
        std::memset(arm.joint[j].moment_kgm, 0, sizeof arm.joint[j].moment_kgm);
        std::memset(arm.joint[j].inertia_kgm2, 0, sizeof arm.joint[j].inertia_kgm2);
    }
    const VectorXd q = random_vector(&seed, 4, 3), qd = random_vector(&seed, 4, 2);
    const VectorXd qdd = random_vector(&seed, 4, 5);
    expect_near(inverse_dynamics(bare, q, qd, qdd), inverse_dynamics(arm, q, qd, qdd), 0, "no mass", 5);
    ck_assert_double_eq(potential_j(bare, q), potential_j(arm, q));
    ck_assert_double_gt(gravity(bare, q).norm(), 0); // the payload is still there
}
END_TEST

START_TEST(test_wrong_size_is_refused)
{
    uint64_t seed = 6;
    const hdt_arm arm = random_arm(&seed, 3);
    const VectorXd good = VectorXd::Zero(3);
    for (int n = 0; n <= 4; ++n) {
        if (n == 3)
            continue;
        const VectorXd bad = VectorXd::Zero(n);
        for (int k = 0; k < 4; ++k) {
            bool refused = false;
            try {
                if (k == 0)
                    frames(arm, bad);
                else
                    inverse_dynamics(arm, k == 1 ? bad : good, k == 2 ? bad : good, k == 3 ? bad : good);
            } catch (const std::invalid_argument &) {
                refused = true;
            }
            ck_assert(refused);
        }
    }
}
END_TEST

START_TEST(test_paper_table_four_gives_the_worked_holding_torques)
{
    // joints 2..6, from the potential energy of the three masses differentiated by hand:
    //   U = g (m2 z2 + m4 z4 + m6 z6), e.g. tau5 = g m6 lc6 s6 (s5 (c2 s4 + s2 c3 c4) + s2 s3 c5)
    static const struct { double q_deg[7], tau_nm[5]; } cases[] = {
        {{0, 0, 0, 0, 0, 0, 0}, {0, 0, 0, 0, 0}},
        {{0, -90, 0, 0, 0, 0, 0}, {80.827, 0, 21.092, 0, -3.832}},
        {{0, 90, 0, 0, 0, 0, 0}, {-80.827, 0, -21.092, 0, 3.832}},
        {{0, 0, 0, 90, 0, 0, 0}, {-21.092, 0, -21.092, 0, 3.832}},
        {{0, 30, 40, 50, 60, 70, 0}, {-51.114, 4.247, -21.005, -3.415, 1.179}},
        {{25, 30, 40, 50, 60, 70, 80}, {-51.114, 4.247, -21.005, -3.415, 1.179}},
    };
    const hdt_arm arm = table_four_arm();
    ck_assert_double_le((flange(arm, VectorXd::Zero(7)).pos - Vector3d(0, 0, 1.345)).norm(), 1e-12);
    for (const auto &c : cases) {
        const VectorXd q = Eigen::Map<const VectorXd>(c.q_deg, 7) * (std::acos(-1.0) / 180);
        const VectorXd tau = gravity(arm, q);
        // given to 0.001
        expect_near(tau.segment(1, 5), Eigen::Map<const VectorXd>(c.tau_nm, 5), 0.00051, "Table IV", 0);
        ck_assert_double_le(std::fabs(tau[0]) + std::fabs(tau[6]), 1e-12);
    }
}
END_TEST

START_TEST(test_holding_a_horizontal_arm_pushes_up)
{
    // joint 2 at +90 deg lays the arm along +x; gravity pulls the angle further, so holding is negative
    const hdt_arm arm = table_four_arm();
    VectorXd q = VectorXd::Zero(7);
    q[1] = std::acos(0.0);
    ck_assert_double_gt(flange(arm, q).pos.x(), 1.0);
    ck_assert_double_lt(gravity(arm, q)[1], -50);
    ck_assert_double_gt(inverse_dynamics(arm, q, VectorXd::Zero(7), VectorXd::Unit(7, 1))[1],
                        gravity(arm, q)[1]);
}
END_TEST

static Suite *rbd_suite(void)
{
    Suite *s = suite_create("rbd");
    TCase *c = tcase_create("kinematics");
    tcase_add_test(c, test_frames_agree_with_homogeneous_transforms);
    tcase_add_test(c, test_jacobian_is_the_derivative_of_the_flange_pose);
    suite_add_tcase(s, c);
    c = tcase_create("dynamics");
    tcase_set_timeout(c, 60);
    tcase_add_test(c, test_gravity_is_the_gradient_of_potential_energy);
    tcase_add_test(c, test_newton_euler_agrees_with_lagrange);
    tcase_add_test(c, test_regressor_times_parameters_is_inverse_dynamics);
    tcase_add_test(c, test_power_is_the_change_of_energy);
    tcase_add_test(c, test_link_without_inertial_numbers_has_no_mass);
    tcase_add_test(c, test_wrong_size_is_refused);
    suite_add_tcase(s, c);
    c = tcase_create("paper");
    tcase_add_test(c, test_paper_table_four_gives_the_worked_holding_torques);
    tcase_add_test(c, test_holding_a_horizontal_arm_pushes_up);
    suite_add_tcase(s, c);
    return s;
}

HDT_CHECK_MAIN(rbd_suite())
