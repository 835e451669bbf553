#include "discrete/linearization.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "discrete/layout.hpp"
#include "numerics/parallel.hpp"

namespace leastaction {

namespace {

// Calls of_step(workspace, k) for every k, over several threads, each with a workspace of its own. Returns the first
// k at which it returned false, or `steps`; a thread goes no further than its own first.
template <class OfStep>
int for_each_step(const Midpoint& integrator, int steps, int threads, const OfStep& of_step) {
    std::atomic<int> first_failure{steps};
    parallel_ranges(steps, threads, [&](int begin, int end) {
        auto workspace = integrator.workspace();
        for (int k = begin; k < end; ++k) {
            if (of_step(*workspace, static_cast<std::size_t>(k))) continue;
            workspace.discard();
            int seen = first_failure.load();
            while (k < seen && !first_failure.compare_exchange_weak(seen, k)) {
            }
            return;
        }
    });
    return first_failure.load();
}

// Weights of the next state, or of multipliers too.
void load_weights(const Layout& at, const double* W_k, int weights, SecondOrder& second) {
    for (int i = 0; i < at.nd; ++i) {
        second.w_q[i] = W_k[at.m.external[i]];
        second.w_p[i] = W_k[at.nq + at.m.external[i]];
    }
    for (int c = 0; c < at.nc; ++c) second.w_lam[c] = weights > at.ndx ? W_k[at.ndx + c] : 0.0;
    for (const Ball& ball : at.m.balls)
        if (ball.prescribed) std::copy_n(W_k + ball.variable, 3, second.w_rho.begin() + ball.variable - at.nd);
}

std::size_t record_size(const Layout& at) {
    return 2 * at.m.n_coordinates() + at.ni + at.nc + 2 +
           static_cast<std::size_t>(at.nc) * (at.theta + at.nc + 2 * at.nd);
}

// The length of a step as its one parameter.
std::vector<Parameter> length_of_step() {
    std::vector<Parameter> lengths(1);
    lengths[0].time_step = true;
    return lengths;
}

// Derivatives of a step by parameters as rows of the next state, and of its multipliers if these are asked for.
void write_slopes(const Layout& at, const MidpointStep& step, double dt, const std::vector<Parameter>& parameters,
                  const ParameterSlopes& slopes, double* by_x, double* by_lam, bool multipliers) {
    const std::size_t count = parameters.size();
    const int ld = slopes.ld;
    std::fill_n(by_x, at.ndx * count, 0.0);
    for (int i = 0; i < at.nd; ++i) {
        const int row = at.m.external[i];
        std::copy_n(&slopes.Y[i * ld], count, by_x + row * count);
        std::copy_n(&slopes.P2[i * ld], count, by_x + (at.nq + row) * count);
    }
    for (int c = 0; multipliers && c < at.nc; ++c) std::copy_n(&slopes.Y[(at.nd + c) * ld], count, by_lam + c * count);
    for (std::size_t p = 0; p < count; ++p)
        for (int i = at.nd; parameters[p].time_step && i < at.nq; ++i)
            by_x[(at.nq + i) * count + p] = -(step.q2[i] - step.q1[i]) / (dt * dt);
}

}  // namespace

Linearization::Linearization(std::shared_ptr<const Midpoint> integrator, int steps, bool multipliers)
    : steps(steps),
      nx(integrator->mechanism().n_states()),
      ndx(integrator->mechanism().n_tangent()),
      nc(integrator->mechanism().n_constraints()),
      ny(ndx + (multipliers ? nc : 0)),
      nu(integrator->mechanism().n_controls()),
      A(static_cast<std::size_t>(steps) * ny * ny),
      B(static_cast<std::size_t>(steps) * ny * nu),
      lam(static_cast<std::size_t>(steps) * nc),
      defect(steps),
      integrator_(std::move(integrator)),
      record_size_(record_size(Layout(integrator_->mechanism()))),
      dt_(steps),
      records_(steps * record_size_),
      runs_{Layout(integrator_->mechanism()).runs(), Layout(integrator_->mechanism(), true).runs()},
      order_(Layout(integrator_->mechanism()).order()) {}

template <class Point, class First, class Carry>
void Linearization::carry(Point& point, First& first, const Carry& carry) const {
    const Layout at(integrator_->mechanism());
    carry(point.q1.data(), at.m.n_coordinates());
    carry(point.u.data(), at.ni);
    carry(point.q2.data(), at.m.n_coordinates());
    carry(point.lam.data(), at.nc);
    carry(&point.share, 1);
    carry(&point.t, 1);
    for (int c = 0; c < at.nc; ++c) carry(&first.Y[(at.nd + c) * first.ld], at.theta);
    for (int i = 0; i < at.nd + at.nc; ++i) carry(first.Y.data() + i * first.ld + at.theta, at.nc);
    for (int i = 0; i < at.nd; ++i) carry(first.P2.data() + i * first.ld + at.theta, at.nc);
}

int Linearization::along(const double* t, const double* X, const double* U, double first_share, int threads,
                         const double* ends, double* by_time_step) {
    const Layout at(integrator_->mechanism(), ny > ndx);
    const std::vector<Parameter> lengths = length_of_step();
    const int done = for_each_step(*integrator_, steps, threads, [&](Workspace& workspace, std::size_t k) {
        const double dt = t[k + 1] - t[k];
        const double *x = X + k * nx, *u = U + k * nu, *next = ends ? ends + k * nx : x + nx;
        MidpointStep& step = workspace.step;
        FirstOrder& first = workspace.first();
        if (!at.differentiate(step, first, x, u, next, t[k], dt, at.share(k, dt, first_share))) return false;
        dt_.data()[k] = dt;
        defect.data()[k] = at.distance(step, next);
        const int ld = first.ld;
        StepRows rows(at, A.data() + k * ny * ny, B.data() + k * ny * nu);
        if (!zeroed_) rows.clear();
        for (int i = 0; i < at.nd; ++i) rows.put(&first.Y[i * ld], &first.P2[i * ld], i);
        rows.put_prescribed(dt);
        rows.put_prescribed_turns(step);
        for (int c = 0; c < ny - ndx; ++c) rows.put(&first.Y[(at.nd + c) * ld], ndx + c);
        std::copy(step.lam.begin(), step.lam.end(), lam.data() + k * nc);
        double* record = records_.data() + k * record_size_;
        carry(step, first, [&](const double* from, int n) { record = std::copy_n(from, n, record); });
        if (by_time_step) {
            ParameterSlopes& slopes = workspace.slopes();
            slopes.differentiate(step, first, dt, lengths);
            write_slopes(at, step, dt, lengths, slopes, by_time_step + k * ny, by_time_step + k * ny + ndx, ny > ndx);
        }
        return true;
    });
    zeroed_ = zeroed_ || done == steps;
    return done;
}

std::shared_ptr<Linearization::Hessians> Linearization::hessians(int kind, std::size_t size) const {
    const std::lock_guard lock(given_lock_);
    auto& [newest, other] = given_[kind];
    if (newest.use_count() == 1) {
        std::atomic_thread_fence(std::memory_order_acquire);
    } else {
        newest.swap(other);
        if (newest.use_count() == 1)
            std::atomic_thread_fence(std::memory_order_acquire);
        else
            newest = std::make_shared<Hessians>(LargeArray(steps * size));
    }
    return newest;
}

template <class Write>
void Linearization::each_hessian(const double* W, int weights, int threads, const Write& write) const {
    const Layout at(integrator_->mechanism());
    for_each_step(*integrator_, steps, threads, [&](Workspace& workspace, std::size_t k) {
        FirstOrder& first = workspace.first();
        SecondOrder& second = workspace.second();
        const int ld = first.ld;
        const double *A_k = A.data() + k * ny * ny, *B_k = B.data() + k * ny * nu, *W_k = W + k * weights;
        for (int i = 0; i < at.nd; ++i) {
            const int row = at.m.external[i];
            at.gather(A_k + row * ny, B_k + row * nu, &first.Y[i * ld]);
            for (int j = 0; j < at.nd; ++j)  // of P2 only the columns of p1 are asked for
                first.P2[i * ld + at.nq + j] = A_k[(at.nq + row) * ny + at.nq + at.m.external[j]];
        }
        const double* record = records_.data() + k * record_size_;
        carry(second, first, [&](double* to, int size) {
            std::copy_n(record, size, to);
            record += size;
        });
        load_weights(at, W_k, weights, second);
        second.hessian(dt_.data()[k], first);
        write(second, k);
        return true;
    });
}

std::shared_ptr<const LargeArray> Linearization::curvature(const double* W, int weights, bool multipliers,
                                                           int threads) const {
    const std::size_t n = ndx + nu + (multipliers ? nc : 0);
    const std::vector<SecondOrder::Run>& runs = runs_[multipliers];
    const std::shared_ptr<Hessians> H = hessians(multipliers, n * n);
    each_hessian(W, weights, threads, [&](SecondOrder& second, std::size_t k) {
        double* H_k = H->values.data() + k * n * n;
        if (!H->zeroed) std::fill_n(H_k, n * n, 0.0);
        second.write(runs, H_k, static_cast<int>(n));
    });
    H->zeroed = true;
    return {H, &H->values};
}

std::shared_ptr<const LargeArray> Linearization::packed_curvature(const double* W, int weights, int threads) const {
    const std::size_t size = packed_size();
    const std::shared_ptr<Hessians> H = hessians(2, size);
    each_hessian(W, weights, threads,
                 [&](SecondOrder& second, std::size_t k) { second.write_packed(order_, H->values.data() + k * size); });
    return {H, &H->values};
}

int differentiate_by_parameters(const Midpoint& integrator, int steps, const double* t, const double* X,
                                const double* U, const std::vector<Parameter>& parameters, double first_share,
                                int threads, double* by_x, double* by_lam) {
    const Layout at(integrator.mechanism());
    const std::size_t count = parameters.size();
    return for_each_step(integrator, steps, threads, [&](Workspace& workspace, std::size_t k) {
        const double dt = t[k + 1] - t[k];
        const double* now = X + k * at.nx;
        MidpointStep& step = workspace.step;
        FirstOrder& first = workspace.first();
        const double share = at.share(k, dt, first_share);
        if (!at.differentiate(step, first, now, U + k * at.nu, now + at.nx, t[k], dt, share)) return false;
        ParameterSlopes& slopes = workspace.slopes();
        slopes.differentiate(step, first, dt, parameters);
        write_slopes(at, step, dt, parameters, slopes, by_x + k * at.ndx * count, by_lam + k * at.nc * count, true);
        return true;
    });
}

namespace {

// Prepares second derivatives of a step that was differentiated.
void load_second(const Layout& at, const MidpointStep& step, const double* W_k, int weights, double share,
                 SecondOrder& second) {
    std::copy(step.q1.begin(), step.q1.end(), second.q1.begin());
    std::copy(step.q2.begin(), step.q2.end(), second.q2.begin());
    std::copy(step.u.begin(), step.u.end(), second.u.begin());
    std::copy(step.lam.begin(), step.lam.end(), second.lam.begin());
    second.share = share;
    second.t = step.t;
    load_weights(at, W_k, weights, second);
}

}  // namespace

int curvature_by_time_step(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                           const double* W, int weights, bool multipliers, double first_share, int threads,
                           double* out) {
    const Layout at(integrator.mechanism(), multipliers);
    const int n = at.ny + at.nu, size = n + 1;
    const std::vector<Parameter> lengths = length_of_step();
    const std::vector<SecondOrder::Run> runs = at.runs();
    return for_each_step(integrator, steps, threads, [&](Workspace& workspace, std::size_t k) {
        const double dt = t[k + 1] - t[k];
        const double *now = X + k * at.nx, *W_k = W + k * weights;
        MidpointStep& step = workspace.step;
        FirstOrder& first = workspace.first();
        SecondOrder& second = workspace.second();
        const double share = at.share(k, dt, first_share);
        if (!at.differentiate(step, first, now, U + k * at.nu, now + at.nx, t[k], dt, share)) return false;
        ParameterSlopes& slopes = workspace.slopes();
        slopes.differentiate(step, first, dt, lengths);
        load_second(at, step, W_k, weights, share, second);
        std::vector<double> row(at.theta);
        second.hessian(dt, first);
        double* H = out + k * size * size;
        std::fill_n(H, size * size, 0.0);
        double *by = H + n * size, twice = second.by_time_step(dt, first, step, slopes, row.data());
        at.scatter(row.data(), by, by + at.ny);
        for (int i = at.nd; i < at.nq; ++i) {  // (rho2 - rho1)/dt
            const double w = W_k[at.nq + i], change = w / (dt * dt);
            if (step.turned_middle().ball_of(i) < 0) by[i] += change;  // of turns the rate is that of the step alone
            by[at.ny + at.ni + i - at.nd] -= change;
            twice += 2.0 * change * (step.q2[i] - step.q1[i]) / dt;
        }
        by[n] = twice;
        second.write(runs, H, size);
        for (int i = 0; i < n; ++i) H[i * size + n] = by[i];
        return true;
    });
}

int curvature_by_numbers(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                         const double* W, int weights, const std::vector<Parameter>& directions, double first_share,
                         int threads, double* out) {
    const Layout at(integrator.mechanism());
    const int n = at.ndx + at.nu, count = static_cast<int>(directions.size()), row = n + count;
    return for_each_step(integrator, steps, threads, [&](Workspace& workspace, std::size_t k) {
        const double dt = t[k + 1] - t[k];
        const double* now = X + k * at.nx;
        MidpointStep& step = workspace.step;
        FirstOrder& first = workspace.first();
        SecondOrder& second = workspace.second();
        const double share = at.share(k, dt, first_share);
        if (!at.differentiate(step, first, now, U + k * at.nu, now + at.nx, t[k], dt, share)) return false;
        ParameterSlopes& slopes = workspace.slopes();
        slopes.differentiate(step, first, dt, directions);
        load_second(at, step, W + k * weights, weights, share, second);
        second.hessian(dt, first);
        std::vector<double> by_theta(static_cast<std::size_t>(count) * at.theta), twice(count * count);
        second.by_numbers(dt, first, step, directions, slopes, by_theta.data(), twice.data());
        double* by = out + k * count * row;
        std::fill_n(by, count * row, 0.0);
        for (int a = 0; a < count; ++a, by += row) {
            at.scatter(&by_theta[static_cast<std::size_t>(a) * at.theta], by, by + at.ndx);
            std::copy_n(&twice[a * count], count, by + n);
        }
        return true;
    });
}

}  // namespace leastaction
