// SPDX-License-Identifier: Apache-2.0
//
// Every stretch of bins of every run, for three shapes: generalised least squares under the joint's own
// noise, run effects and wander included, so that slow drift is no event.
//
// Owns: the search for events (see events.hpp).
// Never: reads held-out runs.
#include "model/events.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

namespace hdt {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index kBins = 60, kRowsLeast = 100;
constexpr double kBinMin_s = 0.25, kMargin_s = 0.5;
constexpr double kPlain_nats = 5;
constexpr double kAbove = 4;         // times what the middle run's best stretch shows
constexpr double kSure_nats = 8;     // beyond the logarithm of how many stretches were looked at
constexpr double kShare = 2;         // of what a run leaves, the middle one of all: smaller is no event
constexpr double kMeanRows = 10;     // a stretch of fewer blocks is a spike

constexpr int kShapes = 3;
const char *const kKinds[kShapes] = {"torque", "friction", "angle"};

VectorXd shape(const BlockRows &b, int kind)
{
    return kind == 0 ? VectorXd::Ones(b.size()).eval() : kind == 1 ? b.dir : VectorXd(-b.dgdq);
}

// Bin of every row.
struct Bins { std::vector<Index> of; Index count = 0; double width_s = 0, first_s = 0; };

Bins bins_of(const BlockRows &b)
{
    Bins out;
    out.first_s = b.t_s[0];
    const double span = std::max(b.t_s[b.size() - 1] - out.first_s, kBinMin_s);
    out.width_s = std::max(kBinMin_s, span / static_cast<double>(kBins));
    out.count = std::max<Index>(1, static_cast<Index>(std::ceil(span / out.width_s)));
    for (Index t = 0; t < b.size(); ++t)
        out.of.push_back(std::min(out.count - 1, static_cast<Index>((b.t_s[t] - out.first_s) / out.width_s)));
    return out;
}

// Products of one shape over any stretch of bins of one run, from corners of cumulative sums.
struct Sums {
    MatrixXd info;
    VectorXd score, rows, square;
    Index bins() const { return score.size() - 1; }
    double info_of(Index i, Index k) const { return info(k, k) - info(i, k) - info(k, i) + info(i, i); }
    double score_of(Index i, Index k) const { return score[k] - score[i]; }
    bool usable(Index i, Index k) const { return rows[k] - rows[i] >= kMeanRows && info_of(i, k) > 1e-9; }
};

Sums sums_of(const Evidence &e, std::size_t run, const VectorXd &residual, const BlockRows &b,
             const Bins &bins, int kind)
{
    const VectorXd x = shape(b, kind);
    MatrixXd m = MatrixXd::Zero(b.size(), bins.count);
    const Index n = bins.count;
    Sums out{MatrixXd::Zero(n + 1, n + 1), VectorXd::Zero(n + 1), VectorXd::Zero(n + 1),
             VectorXd::Zero(n + 1)};
    for (Index t = 0; t < b.size(); ++t) {
        const Index k = bins.of[static_cast<std::size_t>(t)];
        m(t, k) = x[t];
        out.rows[k + 1] += 1;
        out.square[k + 1] += x[t] * x[t];
    }
    MatrixXd a;
    VectorXd s;
    e.products(run, m, residual, &a, &s);
    for (Index i = 0; i < n; ++i) {
        out.score[i + 1] = out.score[i] + s[i];
        out.rows[i + 1] += out.rows[i];
        out.square[i + 1] += out.square[i];
        for (Index k = 0; k < n; ++k)
            out.info(i + 1, k + 1) = out.info(i, k + 1) + out.info(i + 1, k) - out.info(i, k) + a(i, k);
    }
    return out;
}

Sums no_sums()
{
    return {MatrixXd::Zero(1, 1), VectorXd::Zero(1), VectorXd::Zero(1), VectorXd::Zero(1)};
}

// By how much stretches of each length scatter more than the noise model says, by the median over all
// places and runs, which one run's event cannot move.
std::vector<double> excess(const std::vector<Sums> &runs)
{
    constexpr double median_of_one = 0.4549; // of a chi square with one degree of freedom
    constexpr std::size_t enough = 24;
    Index longest = 0;
    for (const Sums &s : runs)
        longest = std::max(longest, s.bins());
    std::vector<double> out(static_cast<std::size_t>(longest) + 1, 1);
    for (Index length = 1; length <= longest; ++length) {
        std::vector<double> x;
        for (const Sums &s : runs)
            for (Index i = 0; i + length <= s.bins(); ++i)
                if (s.usable(i, i + length))
                    x.push_back(s.score_of(i, i + length) * s.score_of(i, i + length)
                                / s.info_of(i, i + length));
        double here = 1;
        if (x.size() >= enough) {
            const auto mid = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
            std::nth_element(x.begin(), mid, x.end());
            here = *mid / median_of_one;
        }
        // what scatters at one length does so at the next
        const auto k = static_cast<std::size_t>(length);
        out[k] = std::max({1.0, here, out[k - 1]});
    }
    return out;
}

struct Best {
    double llr = 0;
    int kind = 0;
    Index begin = 0, end = 0;           // bins
    double mean_square = 0;
    double from_s = 0, to_s = 0;
};

// The stretch of one shape that explains most of one run's residual.
Best best_stretch(const Sums &s, const std::vector<double> &calm, int kind)
{
    Best best;
    best.kind = kind;
    for (Index i = 0; i < s.bins(); ++i)
        for (Index k = i + 1; k <= s.bins(); ++k) {
            if (!s.usable(i, k))
                continue;
            const double info = s.info_of(i, k), got = s.score_of(i, k);
            const double llr = 0.5 * got * got / info / calm[static_cast<std::size_t>(k - i)];
            if (llr <= best.llr)
                continue;
            best.llr = llr;
            best.begin = i;
            best.end = k;
            best.mean_square = (s.square[k] - s.square[i]) / (s.rows[k] - s.rows[i]);
        }
    return best;
}

// Two-sided 1e-4 quantile of Student's t: few runs know their own scatter badly.
double student_limit(std::size_t freedom)
{
    const double table[] = {1e9, 1e9, 100, 28, 15.5, 11.2, 9.1, 7.9, 7.1, 6.6, 6.2};
    return freedom < 11 ? table[freedom] : 5.5;
}

// A run whose Coulomb friction or offset is far outside what the others scatter.
void odd_runs(const JointWork &w, const std::vector<VectorXd> &residual, double least_nm,
              std::vector<Event> *out)
{
    const std::size_t n = residual.size();
    if (n < 5)
        return;
    MatrixXd level(2, static_cast<Index>(n)); // torque, friction
    for (std::size_t r = 0; r < n; ++r) {
        const BlockRows &b = w.fit[r];
        if (b.size() < kRowsLeast)
            return;
        MatrixXd x(b.size(), 3);
        x << VectorXd::Ones(b.size()), b.dir, b.v;
        const MatrixXd a = x.transpose() * x + 1e-6 * MatrixXd::Identity(3, 3);
        level.col(static_cast<Index>(r)) = a.llt().solve(x.transpose() * residual[r]).head(2);
    }
    for (std::size_t r = 0; r < n; ++r)
        for (Index kind = 0; kind < 2; ++kind) {
            const double here = level(kind, static_cast<Index>(r)), others = static_cast<double>(n - 1);
            const double mean = (level.row(kind).sum() - here) / others;
            double square = 0;
            for (std::size_t k = 0; k < n; ++k)
                square += k == r ? 0 : std::pow(level(kind, static_cast<Index>(k)) - mean, 2);
            const double sd = std::sqrt(square / (others - 1) * (1 + 1 / others)), off = here - mean;
            if (std::abs(off) < least_nm || std::abs(off) < student_limit(n - 2) * sd)
                continue;
            Event e;
            e.joint = w.joint + 1;
            e.run = w.fit[r].run;
            e.run_index = r;
            e.from_s = w.fit[r].t_s[0];
            e.to_s = w.fit[r].t_s[w.fit[r].size() - 1];
            e.kind = kKinds[kind];
            e.torque_nm = off;
            e.log_likelihood = 0.5 * off * off / std::max(sd * sd, 1e-12);
            out->push_back(e);
        }
}

// What one run leaves, and under which noise.
struct Left { const Evidence *evidence; std::size_t run; const VectorXd *residual; const BlockRows *rows; };

// The best of several stretches of one shape.
void take_best(const Left &left, const std::vector<std::pair<double, double>> &stretches, double calm,
               Best *best)
{
    const BlockRows &b = *left.rows;
    const VectorXd x = shape(b, best->kind);
    MatrixXd m = MatrixXd::Zero(b.size(), static_cast<Index>(stretches.size()));
    for (Index k = 0; k < m.cols(); ++k)
        for (Index t = 0; t < b.size(); ++t)
            if (b.t_s[t] >= stretches[static_cast<std::size_t>(k)].first
                && b.t_s[t] < stretches[static_cast<std::size_t>(k)].second)
                m(t, k) = x[t];
    MatrixXd a;
    VectorXd s;
    left.evidence->products(left.run, m, *left.residual, &a, &s);
    for (Index k = 0; k < m.cols(); ++k) {
        const double rows = static_cast<double>((m.col(k).array() != 0).count());
        const double llr = a(k, k) > 1e-9 ? 0.5 * s[k] * s[k] / a(k, k) / calm : 0;
        if (rows < kMeanRows || llr <= best->llr)
            continue;
        best->llr = llr;
        best->mean_square = m.col(k).squaredNorm() / rows;
        best->from_s = stretches[static_cast<std::size_t>(k)].first;
        best->to_s = stretches[static_cast<std::size_t>(k)].second;
    }
}

// Begin and end to a part of a bin.  Coloured noise has next to no jumps, so that an edge in the wrong
// place weighs more against a stretch than all its middle speaks for it.
void refine(const Left &left, double width_s, double calm, Best *best)
{
    constexpr int parts = 10;
    for (int round = 0; round < 2; ++round)
        for (bool begin : {true, false}) {
            std::vector<std::pair<double, double>> tried;
            for (int k = -parts; k <= parts; ++k) {
                const double shift = width_s * k / parts;
                tried.emplace_back(best->from_s + (begin ? shift : 0), best->to_s + (begin ? 0 : shift));
            }
            take_best(left, tried, calm, best);
        }
}

// The best stretch of a run, of any shape.
Best best_of(const std::vector<Sums> *sums, const Left &left, const std::vector<double> &calm)
{
    Best best;
    const Bins bins = bins_of(*left.rows);
    for (int kind = 0; kind < kShapes; ++kind) {
        Best k = best_stretch(sums[kind][left.run], calm, kind);
        if (!(k.llr > 0))
            continue;
        k.from_s = bins.first_s + bins.width_s * static_cast<double>(k.begin);
        k.to_s = bins.first_s + bins.width_s * static_cast<double>(k.end);
        refine(left, bins.width_s, calm[static_cast<std::size_t>(k.end - k.begin)], &k);
        // a short stretch may look alike in all three: the plainest first
        if (k.llr > best.llr + (kind > 0 ? kPlain_nats : 0))
            best = k;
    }
    return best;
}

double middle(std::vector<double> x)
{
    const auto mid = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
    std::nth_element(x.begin(), mid, x.end());
    return *mid;
}

// Its size by plain least squares beside what the run's own friction and offset are off by: the noise was
// estimated with the event in it and would take a part of it over.
double plain_size(const BlockRows &b, const VectorXd &residual, const Best &best)
{
    VectorXd in = shape(b, best.kind);
    for (Index t = 0; t < b.size(); ++t)
        in[t] *= b.t_s[t] >= best.from_s && b.t_s[t] < best.to_s;
    MatrixXd x(b.size(), 4);
    x << in, VectorXd::Ones(b.size()), b.dir, b.v;
    MatrixXd a = x.transpose() * x;
    // where the event fills the run, nothing is left beside it
    a.diagonal().tail(3) *= 1.1;
    a.diagonal().array() += 1e-9;
    return a.llt().solve(x.transpose() * residual)[0];
}

std::optional<Event> event_from(const JointWork &w, std::size_t run, const VectorXd &residual,
                                const Best &best, double least_nats, double least_nm)
{
    const BlockRows &b = w.fit[run];
    const double size = best.llr > 0 ? plain_size(b, residual, best) : 0;
    Event e;
    e.torque_nm = size * std::sqrt(best.mean_square);
    e.log_likelihood = best.llr - least_nats;
    if (e.log_likelihood < kSure_nats || std::abs(e.torque_nm) < least_nm)
        return {};
    e.joint = w.joint + 1;
    e.run = b.run;
    e.run_index = run;
    e.kind = kKinds[best.kind];
    e.angle_rad = best.kind == 2 ? size : 0;
    e.from_s = std::max(b.t_s[0], best.from_s);
    e.to_s = std::min(b.t_s[b.size() - 1], best.to_s);
    return e;
}

} // namespace

std::vector<Event> find_events(const JointWork &w, const Found &axis)
{
    const std::vector<VectorXd> residual = w.residual(axis);
    // the middle run: one with an event does not move it
    std::vector<double> left;
    for (const VectorXd &e : residual)
        if (e.size() > 0)
            left.push_back(std::sqrt(e.squaredNorm() / static_cast<double>(e.size())));
    if (left.empty())
        return {};
    const double least_nm = kShare * middle(left);
    std::vector<Event> out;
    odd_runs(w, residual, least_nm, &out);
    std::vector<Sums> sums[kShapes];
    std::vector<double> calm;
    for (int kind = 0; kind < kShapes; ++kind) {
        for (std::size_t r = 0; r < residual.size(); ++r)
            sums[kind].push_back(w.fit[r].size() < kRowsLeast ? no_sums()
                                                              : sums_of(w.evidence(), r, residual[r],
                                                                        w.fit[r], bins_of(w.fit[r]), kind));
        const std::vector<double> mine = excess(sums[kind]);
        calm.resize(mine.size(), 1);
        // one measure for all shapes, or the calmer one would win
        for (std::size_t k = 0; k < mine.size(); ++k)
            calm[k] = std::max(calm[k], mine[k]);
    }
    std::vector<Best> best;
    std::vector<double> nats;
    for (std::size_t r = 0; r < residual.size(); ++r) {
        best.push_back(w.fit[r].size() < kRowsLeast
                           ? Best{}
                           : best_of(sums, {&w.evidence(), r, &residual[r], &w.fit[r]}, calm));
        nats.push_back(best.back().llr);
    }
    // a model that fits nowhere quite has something like an event in every run
    const double bins = static_cast<double>(kBins);
    const double looked_at = 1.5 * bins * bins * static_cast<double>(w.fit.size());
    const double least_nats = std::max(std::log(looked_at), kAbove * middle(nats));
    for (std::size_t r = 0; r < residual.size(); ++r)
        if (std::none_of(out.begin(), out.end(), [r](const Event &e) { return e.run_index == r; }))
            if (const auto e = event_from(w, r, residual[r], best[r], least_nats, least_nm))
                out.push_back(*e);
    std::set<std::size_t> runs;
    for (const Event &e : out)
        runs.insert(e.run_index);
    return runs.size() > std::max<std::size_t>(1, w.fit.size() / 3) ? std::vector<Event>{} : out;
}

BlockRows without_events(const BlockRows &b, const std::vector<Event> &events)
{
    std::vector<Index> keep;
    for (Index t = 0; t < b.size(); ++t) {
        const auto inside = [&](const Event &e) {
            return e.run == b.run && b.t_s[t] > e.from_s - kMargin_s && b.t_s[t] < e.to_s + kMargin_s;
        };
        if (std::none_of(events.begin(), events.end(), inside))
            keep.push_back(t);
    }
    return keep.size() == static_cast<std::size_t>(b.size()) ? b : b.pick(keep);
}

} // namespace hdt
