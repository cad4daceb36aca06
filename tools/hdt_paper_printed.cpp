// SPDX-License-Identifier: Apache-2.0
// See hdt_paper_printed.hpp.
#include "tools/hdt_paper_printed.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include <Eigen/Geometry>

namespace hdt::paper {

const std::array<PrintedModels, printed_joints> table_1 = {{
    {{12.1404, 4.0351}, {1.8519, 1.9260}, {2.2302, 2.1151}},
    {{22.2687, 6.5672}, {2.8653, 2.4327}, {5.2306, 3.6153}},
    {{114.6001, 29.6500}, {16.9548, 9.4774}, {2.7248, 2.3624}},
    {{415.8925, 104.9730}, {0.1180, 1.0590}, {1.4081, 1.7041}},
    {{147.7424, 37.9256}, {33.4068, 17.7034}, {0.6805, 1.3403}},
    {{1.7577, 1.4394}, {0.4013, 1.2006}, {0.5518, 1.2759}},
    {{741.2334, 186.3080}, {1.9773, 1.9887}, {0.7370, 1.3685}},
}};

const std::array<PrintedFriction, printed_joints> table_2 = {{
    {{34.9647, 29.7153, 2.8103, 0.3376}, {36.7050, 26.4796, -2.2885, -0.6172}},
    {{39.9709, 35.3200, 6.2713, 0.0685}, {41.3113, 35.8947, -5.9018, -0.0709}},
    {{18.3053, 17.6413, 2.2282, 0.0430}, {18.7327, 17.8371, -2.7240, -0.0405}},
    {{30.4416, 28.5552, 19.7181, 0.3278}, {30.6897, 29.4670, -21.7854, -0.3676}},
    {{3.7145, 0.7493, 1.0792, 0.0386}, {4.1271, 0.7919, -1.3756, -0.0393}},
    {{5.5090, 0.5859, 0.9983, 0.0126}, {5.7954, 0.5711, -0.9967, -0.0135}},
    {{2.2980, 0.6062, -1.1803, 0.0759}, {2.3027, 0.6836, 1.1470, -0.0690}},
}};

const std::array<std::array<PrintedLine, 2>, printed_joints> table_3 = {{
    {{{15.87, 7.50, 2.30}, {47.60, 5.05, 12.80}}},
    {{{47.60, 6.00, -1.50}, {310.50, 2.50, -6.90}}},
    {{{39.65, 0.70, 0.10}, {239.20, 0.55, 5.50}}},
    {{{39.65, 5.00, -3.15}, {262.50, 0.10, 3.98}}},
    {{{23.80, 0.50, 4.95}, {95.80, 0.40, 7.50}}},
    {{{23.80, 0.10, -1.50}, {95.80, 0.50, 5.50}}},
    {{{23.80, 0.10, -1.00}, {95.80, 0.50, 2.50}}},
}};

const PrintedMasses table_4 = {0.45, 0.50, 0.32, 0.17, -0.09, 9.86, 2.18, 4.34};

const std::array<std::array<PrintedLines, 2>, 4> table_5 = {{
    {{{-0.0044, -25.36, 2.33, -12.70, 0.26, 2.32}, {0.04, 12.16, -1.93, 19.53, -0.34, 0.19}}},
    {{{0.31, -23.48, 2.63, -11.75, 0.20, -1.44}, {-0.06, 11.16, -2.80, 21.75, -0.27, 0.45}}},
    {{{0.21, -5.78, 4.26, -3.49, 0.09, 0.81}, {0.02, 5.30, -3.60, 2.64, -0.07, -0.30}}},
    {{{0.22, -19.58, 5.08, -16.27, 0.92, 2.57}, {-0.68, 15.14, -4.11, 19.23, -0.18, -1.45}}},
}};

hdt_arm_friction magnitudes(const PrintedStribeck &row)
{
    // eq. (7) with negative v and Vc: the bracket is the same; Fs then changes sign with the direction
    const double way = row.vc < 0 ? -1 : 1;
    return {row.f0, row.fv, way * row.fs, way * row.vc};
}

hdt_arm_stiffness joint_signed(const PrintedLines &row, bool negative)
{
    const double way = negative ? -1 : 1;
    hdt_arm_stiffness k{{way * row.slope_1, way * row.slope_2, way * row.slope_3}, row.t_1, row.t_2,
                        way * row.zero};
    if (k.t1_nm > k.t2_nm)
        std::swap(k.t1_nm, k.t2_nm);
    return k;
}

PrintedLines as_printed(const hdt_arm_stiffness &k, bool negative)
{
    const double way = negative ? -1 : 1;
    return {way * k.slope[0], k.t1_nm, way * k.slope[1], k.t2_nm, way * k.slope[2], way * k.zero_nm};
}

namespace {

constexpr double g = 9.81;
constexpr double pi = 3.14159265358979323846;

struct Trig { double s2, c2, s3, c3, s4, c4, s5, c5, s6, c6; };

Trig trig(const SixAngles &q)
{
    return {std::sin(q[1]), std::cos(q[1]), std::sin(q[2]), std::cos(q[2]), std::sin(q[3]),
            std::cos(q[3]), std::sin(q[4]), std::cos(q[4]), std::sin(q[5]), std::cos(q[5])};
}

} // namespace

GravityTorques printed_gravity(const PrintedMasses &m, const SixAngles &q)
{
    const auto [s2, c2, s3, c3, s4, c4, s5, c5, s6, c6] = trig(q);
    const double eq9 =
        m.m2 * g * m.lc2 * c2 + m.m4 * g * (m.l2 * (c2 * s2) + m.lc4 * (s2 * s3 * s4 + c2 * c2 * c3 * s4 +
                c2 * s2 * c4)) +
        m.m6 * g *
            (m.l2 * (c2 * s2) + m.l4 * (s2 * s3 * s4 + c2 * c2 * c3 * s4) +
             m.lc6 * (s2 * s3 * c4 * c5 * s6 + s2 * c3 * s5 * s6 + s2 * s3 * s4 * c6 +
                      c2 * c2 * c3 * c4 * c5 * s6 -
                      c2 * c2 * s3 * s5 * s6 + c2 * c2 * c3 * s4 * c6 + c2 * s2 * c4 * c6));
    const double eq10 =
        m.m4 * g * m.lc4 * s2 * c3 * (c4 + s3 * s4) +
        m.m6 * g *
            (m.l4 * s2 * (c3 * c4 + s3 * c3 * s4) +
             m.lc6 * s2 * (c3 * c4 * c6 - c3 * s4 * c5 * s6 + s3 * c3 * c4 * c5 * s6 - s5 * s6 +
                           c3 * c3 * s5 * s6 +
                           s3 * c3 * s4 * c6));
    const double eq11 =
        m.m4 * g * m.lc4 * s4 * (s2 * c3 * s4 - c2 * c4) +
        m.m6 * g *
            (m.l4 * (s2 * c3 * c4 * c4 + c2 * c4 * s4) +
             m.lc6 * (s2 * c3 * c4 * s5 * s6 + c2 * s4 * s5 * s6 - s2 * c3 * s4 * c4 * c5 * s6 +
                      c2 * c4 * c4 * c5 * s6 -
                      s2 * c3 * c6 + s2 * c3 * c4 * c4 * c6 + c2 * c4 * s4 * c6));
    const double eq12 = m.m6 * g * m.lc6 * s6 * (s2 * c3 * c4 * s5 + c2 * s4 * s5 + s2 * s3 * c5);
    const double eq13 = m.m6 * g * m.lc6 * s6 *
                        (s2 * c3 * c4 * c5 * s6 + c2 * s4 * c5 * s6 - s2 * s3 * s5 * s6 +
                         s2 * c3 * s4 * c6 - c2 * c4 * c6);
    return {eq9, eq10, eq11, eq12, eq13};
}

GravityTorques right_gravity(const PrintedMasses &m, const SixAngles &q)
{
    const auto [s2, c2, s3, c3, s4, c4, s5, c5, s6, c6] = trig(q);
    const double a = c2 * c4 - s2 * c3 * s4, b = s2 * c4 + c2 * c3 * s4, d = c2 * s4 + s2 * c3 * c4;
    const double t2 = -g * (m.m2 * m.lc2 * s2 + m.m4 * (m.l2 * s2 + m.lc4 * b) +
                            m.m6 * (m.l2 * s2 + m.l4 * b +
                                    m.lc6 * (c6 * b +
                                             c5 * s6 * (c2 * c3 * c4 - s2 * s4) - c2 * s3 * s5 * s6)));
    const double t3 = g * s2 * (m.m4 * m.lc4 * s3 * s4 +
                                m.m6 * (m.l4 * s3 * s4 + m.lc6 * (s3 * s4 * c6 + s3 * c4 * c5 * s6 +
                                                                  c3 * s5 * s6)));
    const double t4 = -g * (m.m4 * m.lc4 * d + m.m6 * (m.l4 * d + m.lc6 * (c6 * d + c5 * s6 * a)));
    const double t5 = g * m.m6 * m.lc6 * s6 * (s5 * d + s2 * s3 * c5);
    const double t6 = g * m.m6 * m.lc6 * (s2 * s3 * s5 * c6 - s6 * a - c5 * c6 * d);
    return {t2, t3, t4, t5, t6};
}

double potential_j(const PrintedMasses &m, const SixAngles &q)
{
    using Eigen::Vector3d;
    const Vector3d y = Vector3d::UnitY(), z = Vector3d::UnitZ();
    const Vector3d axis[6] = {z, y, z, y, z, y};
    Eigen::Matrix3d turn[6], rot = Eigen::Matrix3d::Identity();
    for (std::size_t i = 0; i < 6; i++) {
        rot = rot * Eigen::AngleAxisd(q[i], axis[i]).toRotationMatrix();
        turn[i] = rot;
    }
    // along links 2 (upper arm), 4 (forearm), 6 (hand); height above the shoulder
    const double elbow = m.l2 * (turn[1] * z).z(), wrist = elbow + m.l4 * (turn[3] * z).z();
    return g * (m.m2 * m.lc2 * (turn[1] * z).z() + m.m4 * (elbow + m.lc4 * (turn[3] * z).z()) +
                m.m6 * (wrist + m.lc6 * (turn[5] * z).z()));
}

std::array<EquationCheck, 5> check_equations(const PrintedMasses &m, int poses, unsigned seed)
{
    std::mt19937_64 random(seed);
    std::array<EquationCheck, 5> out{};
    constexpr double step = 1e-5;
    for (int pose = 0; pose < poses; pose++) {
        SixAngles q{};
        for (double &angle : q)
            angle = pi * (static_cast<double>(random() >> 11) * 0x1p-52 - 1);
        const GravityTorques printed = printed_gravity(m, q), right = right_gravity(m, q);
        for (std::size_t i = 0; i < out.size(); i++) {
            SixAngles up = q, down = q;
            up[i + 1] += step;
            down[i + 1] -= step;
            const double slope = (potential_j(m, up) - potential_j(m, down)) / (2 * step);
            EquationCheck &c = out[i];
            c.printed_nm = std::max(c.printed_nm, std::fabs(printed[i] - slope));
            c.printed_negated_nm = std::max(c.printed_negated_nm, std::fabs(-printed[i] - slope));
            c.right_nm = std::max(c.right_nm, std::fabs(right[i] - slope));
            c.largest_nm = std::max(c.largest_nm, std::fabs(slope));
        }
    }
    return out;
}

} // namespace hdt::paper
