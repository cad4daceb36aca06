// SPDX-License-Identifier: Apache-2.0
//
// Order scan: finds lines where they are, signed or not, and knows what averaging over blocks leaves
// of them.  Method: rows made at 1 kHz from the motion and averaged by brute force.
#include <algorithm>
#include <cmath>
#include <random>

#include "model/scan.hpp"
#include "tests/check_main.h"

using namespace hdt;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr int kPerBlock = 10;
constexpr double kStep_s = 0.001;

struct Sweep { std::vector<ScanRows> rows; std::vector<VectorXd> line; };

// Ramps back and forth over +-1.2 rad at a few speeds, and a line of unit amplitude averaged over blocks.
Sweep make_sweep(double order, double phase, bool directed)
{
    Sweep s;
    for (int r = 0; r < 4; ++r) {
        std::vector<double> q, v, d, y;
        double at = -1.2, dir = 1;
        for (int b = 0; b < 3000; ++b) {
            const double speed = 0.1 + 0.08 * r;
            double sum = 0, first = at;
            for (int i = 0; i < kPerBlock; ++i) {
                sum += std::sin(order * at + phase) * (directed ? dir : 1);
                at += dir * speed * kStep_s;
            }
            q.push_back(0.5 * (first + at - dir * speed * kStep_s));
            v.push_back(dir * speed);
            d.push_back(dir);
            y.push_back(sum / kPerBlock);
            if (std::abs(at) > 1.2)
                dir = at > 0 ? -1 : 1;
        }
        const auto map = [](const std::vector<double> &x) {
            return VectorXd(Eigen::Map<const VectorXd>(x.data(), static_cast<Index>(x.size())));
        };
        s.rows.push_back({map(q), map(v), map(d), kPerBlock * kStep_s});
        s.line.push_back(map(y));
    }
    return s;
}

NoiseModel white(double sd)
{
    NoiseModel n;
    n.predictor = {VectorXd(0)};
    n.innovation_nm = {sd};
    n.coloured_nm = sd;
    return n;
}

std::vector<VectorXd> with_noise(std::vector<VectorXd> y, double sd, unsigned seed)
{
    std::mt19937_64 rng(seed);
    std::normal_distribution<double> g(0, sd);
    for (VectorXd &run : y)
        for (Index i = 0; i < run.size(); ++i)
            run[i] += g(rng);
    return y;
}

} // namespace

START_TEST(test_line_is_found_at_its_order_and_kind)
{
    for (double order : {12.0, 50.0, 137.4, 300.0})
        for (bool directed : {false, true}) {
            const Sweep s = make_sweep(order, 0.4, directed);
            const std::vector<VectorXd> y = with_noise(s.line, 1.0, 7);
            const OrderGrid grid = order_grid(s.rows, 600);
            ck_assert_double_gt(grid.last, order);
            // white, unit noise: the score is y itself
            const OrderScan scan = scan_orders(s.rows, y, white(1.0), grid);
            std::vector<LineHit> hits = scan_peaks(scan, 3);
            const LineHit best = *std::max_element(hits.begin(), hits.end(),
                                                   [](const LineHit &a, const LineHit &b) {
                                                       return a.power < b.power;
                                                   });
            ck_assert_msg(std::abs(best.order - order) <= grid.step, "order %g: found %g", order, best.order);
            ck_assert_int_eq(best.directed, directed);
        }
}
END_TEST

START_TEST(test_power_is_the_likelihood_ratio)
{
    for (bool directed : {false, true})
        for (double phase : {0.0, 0.8, 1.5707963}) {
            const Sweep s = make_sweep(50, phase, directed);
            const std::vector<VectorXd> y = with_noise(s.line, 0.5, 3);
            OrderGrid grid;
            grid.first = grid.last = 50;
            std::vector<VectorXd> score = y;
            for (VectorXd &v : score)
                v /= 0.25;
            const double power = scan_orders(s.rows, score, white(0.5), grid).power[directed][0];
            Eigen::Matrix2d a = Eigen::Matrix2d::Zero();
            Eigen::Vector2d b = Eigen::Vector2d::Zero();
            for (std::size_t r = 0; r < s.rows.size(); ++r) {
                const Eigen::MatrixXd x = line_columns(s.rows[r], 50, directed);
                a += x.transpose() * x / 0.25;
                b += x.transpose() * y[r] / 0.25;
            }
            const double exact = 0.5 * b.dot(a.inverse() * b);
            ck_assert_double_eq_tol(power / exact, 1, 0.1);
        }
}
END_TEST

START_TEST(test_columns_are_the_line_averaged_over_blocks)
{
    for (double order : {20.0, 200.0, 500.0}) {
        const Sweep s = make_sweep(order, 0.4, true);
        for (std::size_t r = 0; r < s.rows.size(); ++r) {
            const Eigen::MatrixXd x = line_columns(s.rows[r], order, true);
            const VectorXd want = s.line[r], got = std::cos(0.4) * x.col(0) + std::sin(0.4) * x.col(1);
            // continuous against ten samples a block: the difference grows with the square of the advance
            const double advance = order * 0.34 * kStep_s;
            ck_assert_double_lt((want - got).cwiseAbs().maxCoeff(), 1e-3 + advance * advance);
        }
    }
}
END_TEST

START_TEST(test_noise_has_no_peak_that_counts)
{
    const Sweep s = make_sweep(10, 0, false);
    std::vector<VectorXd> zero = s.line;
    for (VectorXd &v : zero)
        v.setZero();
    const OrderGrid grid = order_grid(s.rows, 600);
    for (unsigned seed = 1; seed <= 20; ++seed) {
        const OrderScan scan = scan_orders(s.rows, with_noise(zero, 1, seed), white(1), grid);
        const double top = std::max(*std::max_element(scan.power[0].begin(), scan.power[0].end()),
                                    *std::max_element(scan.power[1].begin(), scan.power[1].end()));
        // power is exponential with mean one: the largest of m stays
        // under log(m) + 7 but for one in a thousand
        ck_assert_double_lt(top, std::log(2.0 * static_cast<double>(grid.count())) + 7);
    }
}
END_TEST

START_TEST(test_grid_keeps_to_what_travel_and_speed_can_show)
{
    const Sweep s = make_sweep(10, 0, false);
    const OrderGrid grid = order_grid(s.rows, 600);
    ck_assert_double_ge(grid.first, 1.5 * 6.283 / 2.41);
    ck_assert_double_le(grid.step, 0.5 * 6.284 / 2.4);
    std::vector<ScanRows> fast = s.rows;
    for (ScanRows &r : fast)
        r.v_radps *= 10;
    ck_assert_double_lt(order_grid(fast, 600).last, 300);
    ck_assert_uint_eq(order_grid({}, 600).count(), 0);
}
END_TEST

START_TEST(test_spectrum_reads_the_amplitude)
{
    const Sweep s = make_sweep(37, 1.1, true);
    OrderGrid grid;
    grid.first = grid.last = 37;
    ck_assert_double_eq_tol(order_spectrum(s.rows, s.line, grid, true)[0], 1, 0.05);
    // the other kind sees only what one direction has more rows than the other
    double up = 0, all = 0;
    for (const ScanRows &r : s.rows) {
        up += r.dir.sum();
        all += static_cast<double>(r.dir.size());
    }
    ck_assert_double_lt(order_spectrum(s.rows, s.line, grid, false)[0], 0.1 + std::abs(up) / all);
}
END_TEST

// A line of fixed frequency, another phase in every run, is found there; one locked to an angle is none.
START_TEST(test_line_in_time_is_told_from_line_in_angle)
{
    const double hz = 7.3;
    std::mt19937_64 rng(5);
    std::normal_distribution<double> g(0, 1);
    BlockNumbers blocks(6);
    std::vector<VectorXd> hum, locked, nothing;
    for (std::size_t r = 0; r < blocks.size(); ++r) {
        const double phase = 6.28 * g(rng);
        VectorXd noise(2500), q(2500), t(2500);
        double at = 0;
        for (Index i = 0; i < noise.size(); ++i) {
            blocks[r].push_back(i + (i > 1200 ? 40 : 0)); // a gap
            t[i] = 0.01 * static_cast<double>(blocks[r].back());
            at += 0.01 * (0.1 + 0.05 * static_cast<double>(r)) * (1 + 0.5 * std::sin(0.4 * t[i]));
            q[i] = at;
            noise[i] = g(rng);
        }
        nothing.push_back(noise);
        hum.push_back(noise + 0.3 * (6.283185307 * hz * t.array() + phase).sin().matrix());
        locked.push_back(noise + 0.3 * (150 * q.array()).sin().matrix());
    }
    const TimeGrid grid = time_grid(blocks, 0.01);
    const std::vector<RunSet> splits = balanced_splits(6, 16);
    const auto best = [&](const std::vector<VectorXd> &y, double *log_e) {
        const TimeScan scan = scan_times(blocks, y, white(1), grid);
        const std::size_t k = time_peaks(scan, 1)[0];
        *log_e = time_log_e(scan, k, splits);
        return grid.hz(k);
    };
    double log_e = 0;
    ck_assert_double_eq_tol(best(hum, &log_e), hz, 2 * grid.step_hz());
    ck_assert_double_gt(log_e, std::log(20.0 * static_cast<double>(grid.count())));
    const TimeScan scan = scan_times(blocks, hum, white(1), grid);
    const double variance = time_variance(scan, RunSet(6, 1), time_peaks(scan, 1)[0]);
    ck_assert_double_eq_tol(std::sqrt(2 * variance), 0.3, 0.06);
    best(locked, &log_e);
    ck_assert_double_lt(log_e, std::log(20.0 * static_cast<double>(grid.count())));
    best(nothing, &log_e);
    ck_assert_double_lt(log_e, std::log(20.0 * static_cast<double>(grid.count())));
}
END_TEST

static Suite *scan_suite(void)
{
    Suite *s = suite_create("scan");
    TCase *t = tcase_create("lines");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, test_line_is_found_at_its_order_and_kind);
    tcase_add_test(t, test_power_is_the_likelihood_ratio);
    tcase_add_test(t, test_columns_are_the_line_averaged_over_blocks);
    tcase_add_test(t, test_noise_has_no_peak_that_counts);
    tcase_add_test(t, test_grid_keeps_to_what_travel_and_speed_can_show);
    tcase_add_test(t, test_spectrum_reads_the_amplitude);
    tcase_add_test(t, test_line_in_time_is_told_from_line_in_angle);
    suite_add_tcase(s, t);
    return s;
}

HDT_CHECK_MAIN(scan_suite())
