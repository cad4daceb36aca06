// SPDX-License-Identifier: Apache-2.0
// See hdt_paper_fit.hpp.
#include "tools/hdt_paper_fit.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace hdt::paper {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double pi = 3.14159265358979323846;

Index rows_of(const std::vector<SpeedPoint> &points) { return static_cast<Index>(points.size()); }

// One over the standard deviation of a trial; one for all where it is not known.
VectorXd weights(const std::vector<SpeedPoint> &points)
{
    bool known = true;
    for (const SpeedPoint &p : points)
        known = known && p.sd_nm > 0;
    VectorXd w = VectorXd::Ones(rows_of(points));
    for (Index i = 0; known && i < w.size(); i++)
        w[i] = 1 / points[static_cast<std::size_t>(i)].sd_nm;
    return w;
}

VectorXd means(const std::vector<SpeedPoint> &points)
{
    VectorXd y(rows_of(points));
    for (Index i = 0; i < y.size(); i++)
        y[i] = points[static_cast<std::size_t>(i)].mean_nm;
    return y;
}

VectorXd speeds(const std::vector<SpeedPoint> &points)
{
    VectorXd v(rows_of(points));
    for (Index i = 0; i < v.size(); i++)
        v[i] = points[static_cast<std::size_t>(i)].speed_radps;
    return v;
}

void need(const std::vector<SpeedPoint> &points, Index parameters)
{
    if (rows_of(points) < parameters)
        throw std::invalid_argument("friction fit: expected at least " + std::to_string(parameters) +
                                    " speeds, found " + std::to_string(points.size()));
}

// Linear weighted fit of the columns of A.
FrictionModelFit solve(const std::vector<SpeedPoint> &points, const MatrixXd &a)
{
    const VectorXd w = weights(points), y = means(points);
    FrictionModelFit fit;
    fit.parameters = (w.asDiagonal() * a).colPivHouseholderQr().solve(w.cwiseProduct(y));
    const VectorXd left = y - a * fit.parameters;
    fit.variance = w.cwiseProduct(left).squaredNorm();
    fit.rms_nm = std::sqrt(left.squaredNorm() / static_cast<double>(left.size()));
    return fit;
}

void add_sigma(const std::vector<SpeedPoint> &points, const MatrixXd &jacobian, FrictionModelFit *fit)
{
    VectorXd w = weights(points);
    for (Index i = 0; i < w.size(); i++)
        w[i] *= std::sqrt(static_cast<double>(std::max(1, points[static_cast<std::size_t>(i)].trials)));
    const MatrixXd j = w.asDiagonal() * jacobian;
    const MatrixXd covariance = (j.transpose() * j).completeOrthogonalDecomposition().pseudoInverse();
    fit->sigma = covariance.diagonal().cwiseMax(0).cwiseSqrt();
}

MatrixXd powers(const VectorXd &v, Index columns)
{
    MatrixXd a(v.size(), columns);
    for (Index c = 0; c < columns; c++)
        a.col(c) = v.array().pow(static_cast<double>(c));
    return a;
}

FrictionModelFit fit_powers(const std::vector<SpeedPoint> &points, Index columns)
{
    need(points, columns);
    const MatrixXd a = powers(speeds(points), columns);
    FrictionModelFit fit = solve(points, a);
    add_sigma(points, a, &fit);
    return fit;
}

MatrixXd stribeck_columns(const VectorXd &v, double vc)
{
    MatrixXd a(v.size(), 3);
    a.col(0).setOnes();
    a.col(1) = v;
    a.col(2) = 1 - (-v.array() / vc).exp();
    return a;
}

// What the Stribeck column of a velocity leaves, its height, Coulomb and viscous friction projected out.
class StribeckSearch {
public:
    StribeckSearch(const std::vector<SpeedPoint> &points) : v_(speeds(points)), w_(weights(points))
    {
        MatrixXd line(v_.size(), 2);
        line << w_, w_.cwiseProduct(v_);
        line_ = Eigen::HouseholderQR<MatrixXd>(line).householderQ() * MatrixXd::Identity(v_.size(), 2);
        const VectorXd y = w_.cwiseProduct(means(points));
        y_ = y - line_ * (line_.transpose() * y);
    }
    // Weighted squares left, less those left without it.
    double left(double log_vc)
    {
        e_ = w_.array() * (-v_.array() * std::exp(-log_vc)).exp();
        const Eigen::Vector2d on = line_.transpose() * e_;
        const double score = e_.dot(y_), square = e_.squaredNorm() - on.squaredNorm();
        // a column that is a straight line explains nothing more
        return square > 1e-12 * w_.squaredNorm() ? -score * score / square : 0;
    }

private:
    VectorXd v_, w_, y_, e_;
    Eigen::Matrix<double, Eigen::Dynamic, 2> line_;
};

// Where f is least between a and b, after so many evaluations.
template <class F> double golden(F f, double a, double b, int evaluations)
{
    const double share = 0.6180339887498949;
    double x1 = b - share * (b - a), x2 = a + share * (b - a), f1 = f(x1), f2 = f(x2);
    for (int k = 0; k < evaluations; k++) {
        if (f1 < f2) {
            b = x2;
            x2 = x1;
            f2 = f1;
            x1 = b - share * (b - a);
            f1 = f(x1);
        } else {
            a = x1;
            x1 = x2;
            f1 = f2;
            x2 = a + share * (b - a);
            f2 = f(x2);
        }
    }
    return (a + b) / 2;
}

} // namespace

FrictionModelFit fit_viscous(const std::vector<SpeedPoint> &points) { return fit_powers(points, 2); }
FrictionModelFit fit_cubic(const std::vector<SpeedPoint> &points) { return fit_powers(points, 4); }

FrictionModelFit fit_stribeck(const std::vector<SpeedPoint> &points)
{
    need(points, 4);
    const VectorXd v = speeds(points);
    StribeckSearch search(points);
    const auto left = [&search](double log_vc) { return search.left(log_vc); };
    constexpr int grid = 24;
    // what bends well below the slowest or above the fastest speed cannot be told from a straight line
    const double low = std::log(v.minCoeff() / 2), high = std::log(2 * v.maxCoeff());
    const double step = (high - low) / grid;
    double best = low, least = left(low);
    for (int k = 1; k <= grid; k++)
        if (const double here = left(low + step * k); here < least) {
            least = here;
            best = low + step * k;
        }
    const double vc = std::exp(golden(left, std::max(low, best - step), std::min(high, best + step), 18));
    FrictionModelFit fit = solve(points, stribeck_columns(v, vc));
    MatrixXd jacobian(v.size(), 4);
    jacobian.leftCols(3) = stribeck_columns(v, vc);
    jacobian.col(3) = -fit.parameters[2] * (-v.array() / vc).exp() * v.array() / (vc * vc);
    fit.parameters.conservativeResize(4);
    fit.parameters[3] = vc;
    add_sigma(points, jacobian, &fit);
    return fit;
}

hdt_arm_friction stribeck_of(const FrictionModelFit &fit)
{
    return {fit.parameters[0], fit.parameters[1], fit.parameters[2], fit.parameters[3]};
}

double printed_mse(double variance, int parameters) { return 1 + variance / (6 - parameters); }

// ---- lines over position ----

double AngleTable::at(double q_rad) const
{
    const double place = (q_rad - from_rad) / step_rad - 0.5, last = static_cast<double>(nm.size() - 1);
    if (place <= 0)
        return nm.front();
    if (place >= last)
        return nm.back();
    const std::size_t k = static_cast<std::size_t>(place);
    const double part = place - static_cast<double>(k);
    return nm[k] + part * (nm[k + 1] - nm[k]);
}

double AngleTable::mean() const
{
    double sum = 0;
    for (double x : nm)
        sum += x;
    return sum / static_cast<double>(nm.size());
}

AngleTable tabulate(const std::vector<double> &q_rad, const std::vector<double> &nm, double from_rad,
                    double to_rad,
                    std::size_t bins)
{
    AngleTable table{from_rad, (to_rad - from_rad) / static_cast<double>(bins), std::vector<double>(bins,
            0.0)};
    std::vector<int> count(bins, 0);
    for (std::size_t i = 0; i < q_rad.size(); i++) {
        const double place = std::floor((q_rad[i] - from_rad) / table.step_rad);
        if (!(place >= 0 && place < static_cast<double>(bins)))
            continue;
        const std::size_t k = static_cast<std::size_t>(place);
        table.nm[k] += nm[i];
        count[k]++;
    }
    std::size_t last = bins; // last filled bin
    for (std::size_t k = 0; k < bins; k++) {
        if (count[k] == 0)
            continue;
        table.nm[k] /= count[k];
        // a gap is bridged, the beginning filled with the first value
        const std::size_t from = last == bins ? 0 : last + 1;
        for (std::size_t i = from; i < k; i++)
            table.nm[i] = last == bins ? table.nm[k]
                                       : table.nm[last] + (table.nm[k] - table.nm[last]) *
                                             static_cast<double>(i - last) / static_cast<double>(k - last);
        last = k;
    }
    if (last == bins)
        throw std::invalid_argument("angle table: no sample between its ends");
    std::fill(table.nm.begin() + static_cast<std::ptrdiff_t>(last) + 1, table.nm.end(), table.nm[last]);
    return table;
}

void fft(std::vector<std::complex<double>> &x)
{
    const std::size_t n = x.size();
    if (n == 0 || (n & (n - 1)) != 0)
        throw std::invalid_argument("fft: expected a power of two, found " + std::to_string(n) + " values");
    for (std::size_t i = 1, j = 0; i < n; i++) {
        std::size_t bit = n >> 1;
        for (; j & bit; bit >>= 1)
            j ^= bit;
        j ^= bit;
        if (i < j)
            std::swap(x[i], x[j]);
    }
    for (std::size_t size = 2; size <= n; size *= 2) {
        const std::size_t half = size / 2;
        for (std::size_t k = 0; k < half; k++) {
            const double angle = -2 * pi * static_cast<double>(k) / static_cast<double>(size);
            const std::complex<double> turn = std::polar(1.0, angle);
            for (std::size_t i = k; i < n; i += size) {
                const std::complex<double> odd = turn * x[i + half];
                x[i + half] = x[i] - odd;
                x[i] += odd;
            }
        }
    }
}

namespace {

double hann(std::size_t i, std::size_t n)
{
    return 0.5 - 0.5 * std::cos(2 * pi * (static_cast<double>(i) + 0.5) / static_cast<double>(n));
}

double centre(const AngleTable &table, std::size_t i)
{
    return table.from_rad + table.step_rad * (static_cast<double>(i) + 0.5);
}

// Amplitude a sine of this frequency has in the table, Hann window.
double windowed_amplitude(const AngleTable &table, double cycles_per_rad)
{
    std::complex<double> sum = 0;
    double weight = 0;
    const double mean = table.mean();
    for (std::size_t i = 0; i < table.nm.size(); i++) {
        const double w = hann(i, table.nm.size());
        sum += w * (table.nm[i] - mean) * std::polar(1.0, -2 * pi * cycles_per_rad * centre(table, i));
        weight += w;
    }
    return 2 * std::abs(sum) / weight;
}

// Amplitudes and phases of lines of given frequency beside a mean and a slope.
std::vector<AngleLine> fit_lines(const AngleTable &table, const std::vector<double> &cycles_per_rad)
{
    const Index rows = static_cast<Index>(table.nm.size()), lines = static_cast<Index>(cycles_per_rad.size());
    MatrixXd a(rows, 2 + 2 * lines);
    VectorXd y(rows);
    for (Index i = 0; i < rows; i++) {
        const double q = centre(table, static_cast<std::size_t>(i));
        y[i] = table.nm[static_cast<std::size_t>(i)];
        a(i, 0) = 1;
        a(i, 1) = q;
        for (Index k = 0; k < lines; k++) {
            const double angle = 2 * pi * cycles_per_rad[static_cast<std::size_t>(k)] * q;
            a(i, 2 + 2 * k) = std::sin(angle);
            a(i, 3 + 2 * k) = std::cos(angle);
        }
    }
    const VectorXd x = (a.transpose() * a).ldlt().solve(a.transpose() * y);
    std::vector<AngleLine> out;
    for (Index k = 0; k < lines; k++)
        out.push_back({cycles_per_rad[static_cast<std::size_t>(k)], std::hypot(x[2 + 2 * k], x[3 + 2 * k]),
                       std::atan2(x[3 + 2 * k], x[2 + 2 * k])});
    return out;
}

} // namespace

Spectrum spectrum(const AngleTable &table)
{
    std::size_t size = 1;
    while (size < table.nm.size())
        size *= 2;
    std::vector<std::complex<double>> x(size);
    const double mean = table.mean();
    double weight = 0;
    for (std::size_t i = 0; i < table.nm.size(); i++) {
        const double w = hann(i, table.nm.size());
        x[i] = w * (table.nm[i] - mean);
        weight += w;
    }
    fft(x);
    Spectrum s;
    for (std::size_t k = 0; k < size / 2; k++) {
        s.cycles_per_rad.push_back(static_cast<double>(k) / (table.step_rad * static_cast<double>(size)));
        s.amplitude_nm.push_back(2 * std::abs(x[k]) / weight);
    }
    return s;
}

double lines_nm(const std::vector<AngleLine> &lines, double q_rad)
{
    double sum = 0;
    for (const AngleLine &line : lines)
        sum += line.amplitude_nm * std::sin(2 * pi * line.cycles_per_rad * q_rad + line.phase_rad);
    return sum;
}

std::vector<AngleLine> find_lines(const AngleTable &table, std::size_t count, double lowest_cycles_per_rad)
{
    std::vector<double> found;
    std::vector<AngleLine> lines;
    AngleTable rest = table;
    while (found.size() < count) {
        const Spectrum s = spectrum(rest);
        std::size_t best = 0;
        for (std::size_t k = 1; k < s.amplitude_nm.size(); k++)
            if (s.cycles_per_rad[k] >= lowest_cycles_per_rad &&
                (best == 0 || s.amplitude_nm[k] > s.amplitude_nm[best]))
                best = k;
        if (best == 0)
            break;
        const double bin = s.cycles_per_rad[1];
        found.push_back(golden([&](double f) { return -windowed_amplitude(rest, f); },
                               s.cycles_per_rad[best] - bin, s.cycles_per_rad[best] + bin, 40));
        lines = fit_lines(table, found);
        for (std::size_t i = 0; i < table.nm.size(); i++)
            rest.nm[i] = table.nm[i] - lines_nm(lines, centre(table, i));
    }
    std::sort(lines.begin(), lines.end(),
              [](const AngleLine &a, const AngleLine &b) { return a.cycles_per_rad < b.cycles_per_rad; });
    return lines;
}

// ---- three lines of load ----

namespace {

struct Hinges { double t1, t2; };

// Columns 1, x, past t1, past t2: a continuous curve of three lines.
Eigen::Vector4d hinge_row(double x, const Hinges &h)
{
    return {1, x, std::max(0.0, x - h.t1), std::max(0.0, x - h.t2)};
}

struct HingeSolution { Eigen::Vector4d c; double square; };

HingeSolution solve_hinges(const std::vector<double> &x, const std::vector<double> &y, const Hinges &h)
{
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d rhs = Eigen::Vector4d::Zero();
    double squares = 0;
    for (std::size_t i = 0; i < x.size(); i++) {
        const Eigen::Vector4d row = hinge_row(x[i], h);
        normal += row * row.transpose();
        rhs += row * y[i];
        squares += y[i] * y[i];
    }
    const Eigen::Vector4d c = normal.ldlt().solve(rhs);
    return {c, std::max(0.0, squares - rhs.dot(c))};
}

// Quantile p of sorted values.
double quantile(const std::vector<double> &sorted, double p)
{
    return sorted[static_cast<std::size_t>(p * static_cast<double>(sorted.size() - 1))];
}

hdt_arm_stiffness lines_of(const Eigen::Vector4d &c, const Hinges &h)
{
    hdt_arm_stiffness k{};
    k.slope[0] = c[1];
    k.slope[1] = c[1] + c[2];
    k.slope[2] = c[1] + c[2] + c[3];
    k.t1_nm = h.t1;
    k.t2_nm = h.t2;
    k.zero_nm = hinge_row(0, h).dot(c);
    return k;
}

// Means of runs of neighbours in load, so that a search over hinges costs little; at most `most`.
void thin(std::vector<double> &x, std::vector<double> &y, std::size_t most)
{
    const std::size_t block = (x.size() + most - 1) / most;
    if (block < 2)
        return;
    std::vector<std::size_t> order(x.size());
    for (std::size_t i = 0; i < order.size(); i++)
        order[i] = i;
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return x[a] < x[b]; });
    std::vector<double> xs, ys;
    for (std::size_t i = 0; i < order.size(); i += block) {
        const std::size_t end = std::min(order.size(), i + block);
        double sx = 0, sy = 0;
        for (std::size_t k = i; k < end; k++) {
            sx += x[order[k]];
            sy += y[order[k]];
        }
        xs.push_back(sx / static_cast<double>(end - i));
        ys.push_back(sy / static_cast<double>(end - i));
    }
    x = xs;
    y = ys;
}

double line_rms(const std::vector<double> &x, const std::vector<double> &y)
{
    MatrixXd a(static_cast<Index>(x.size()), 2);
    a.col(0).setOnes();
    a.col(1) = Eigen::Map<const VectorXd>(x.data(), a.rows());
    const VectorXd v = Eigen::Map<const VectorXd>(y.data(), a.rows());
    const VectorXd left = v - a * a.colPivHouseholderQr().solve(v);
    return std::sqrt(left.squaredNorm() / static_cast<double>(left.size()));
}

} // namespace

HingeFit fit_hinges(const std::vector<double> &load_nm, const std::vector<double> &nm, double narrowest)
{
    if (load_nm.size() != nm.size() || load_nm.size() < 20)
        throw std::invalid_argument("hinge fit: expected at least 20 points, found " +
                                    std::to_string(load_nm.size()));
    std::vector<double> x = load_nm, y = nm, sorted;
    thin(x, y, 1500);
    sorted = x;
    std::sort(sorted.begin(), sorted.end());
    const double range = sorted.back() - sorted.front(), low = quantile(sorted, 0.02), high = quantile(sorted,
            0.98);
    if (!(range > 0) || !(high > low))
        throw std::invalid_argument("hinge fit: the load does not vary");
    const double least = narrowest * range;
    const auto crowded = [&](const Hinges &h) {
        const auto from = std::lower_bound(sorted.begin(), sorted.end(), h.t1);
        const auto to = std::upper_bound(sorted.begin(), sorted.end(), h.t2);
        return static_cast<double>(to - from) >= 0.02 * static_cast<double>(sorted.size());
    };

    // a coarse grid over both hinges, then finer ones about the best pair
    constexpr int grid = 40;
    double span = (high - low) / 2, m1 = (low + high) / 2, m2 = m1;
    Hinges best{low, high};
    double square = solve_hinges(x, y, best).square;
    for (int round = 0; round < 5; round++, span *= 0.15, m1 = best.t1, m2 = best.t2)
        for (int i = 0; i <= grid; i++)
            for (int k = 0; k <= grid; k++) {
                const Hinges h{m1 + span * (2.0 * i / grid - 1), m2 + span * (2.0 * k / grid - 1)};
                if (h.t1 < low || h.t2 > high || h.t2 - h.t1 < least || !crowded(h))
                    continue;
                if (const double here = solve_hinges(x, y, h).square; here < square) {
                    square = here;
                    best = h;
                }
            }

    // the numbers from all points
    HingeFit fit;
    const HingeSolution s = solve_hinges(load_nm, nm, best);
    fit.lines = lines_of(s.c, best);
    fit.rms_nm = std::sqrt(s.square / static_cast<double>(nm.size()));
    fit.flat_rms_nm = line_rms(load_nm, nm);
    return fit;
}

RegionRipple ripple_by_region(const std::vector<double> &q_rad, const std::vector<double> &load_nm,
                              const std::vector<double> &nm, const hdt_arm_stiffness &lines,
                              const std::vector<double> &cycles_per_rad)
{
    const Index count = static_cast<Index>(cycles_per_rad.size()), columns = 4 + 4 * count;
    MatrixXd normal = MatrixXd::Zero(columns, columns);
    VectorXd rhs = VectorXd::Zero(columns), row(columns);
    const Hinges h{lines.t1_nm, lines.t2_nm};
    for (std::size_t i = 0; i < q_rad.size(); i++) {
        const bool inside = load_nm[i] >= h.t1 && load_nm[i] <= h.t2;
        row.setZero();
        row.head<4>() = hinge_row(load_nm[i], h);
        for (Index k = 0; k < count; k++) {
            const double angle = 2 * pi * cycles_per_rad[static_cast<std::size_t>(k)] * q_rad[i];
            const Index at = 4 + 4 * k + (inside ? 0 : 2);
            row[at] = std::sin(angle);
            row[at + 1] = std::cos(angle);
        }
        normal.noalias() += row * row.transpose();
        rhs += row * nm[i];
    }
    const VectorXd c = normal.completeOrthogonalDecomposition().solve(rhs);
    double inside = 0, outside = 0;
    for (Index k = 0; k < count; k++) {
        inside += c.segment<2>(4 + 4 * k).squaredNorm();
        outside += c.segment<2>(6 + 4 * k).squaredNorm();
    }
    return {std::sqrt(inside), std::sqrt(outside)};
}

} // namespace hdt::paper
