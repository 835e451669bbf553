// The equations of motion in continuous time, at many points at once.

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>

#include <atomic>
#include <memory>
#include <mutex>

#include "bindings/arrays.hpp"
#include "continuous/dynamics.hpp"
#include "continuous/pieces.hpp"
#include "numerics/parallel.hpp"
#include "numerics/pool.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

// Times of points (N), or none: zero.
using Times = std::optional<In<1>>;

// Points of motions, in the user's order: q, v (N, nq), u (N, n_inputs), rho_a (N, n_kinematic).
struct Points {
    In<2> q, v, u, rho_a;
    Times t;
};

// Accelerations and multipliers of points (N rows), and what else was asked for, filled as far as no point failed.
struct AccelerationResult {
    Out a, lam;
    std::optional<Out> derivatives;
    std::size_t solved = 0;  // points before the first that failed
    MotionStatus status = MotionStatus::solved;
    std::optional<int> variable;  // of a singular mass matrix: the one whose inertia is lost, in the user's order
    bool rank_deficient = false;
};

using Result = AccelerationResult;

class ContinuousMotion {
public:
    ContinuousMotion(std::shared_ptr<Mechanism> mechanism, double damping, double stiffness)
        : mechanism_(std::move(mechanism)), damping_(damping), stiffness_(stiffness) {}

    Result accelerations(const In<2>& q, const In<2>& v, const In<2>& u, const In<2>& rho_a, int threads,
                         const Times& t) {
        const Points points{q, v, u, rho_a, t};
        const std::size_t N = check(points), nd = mechanism_->n_dynamic, nc = mechanism_->n_constraints();
        Out a = new_array({N, nd}), lam = new_array({N, nc});
        return each_point(points, threads_for(N, 1, threads), a, lam,
                          [](Continuous& at, std::size_t) { return at.accelerate(); });
    }

    Out inverse_dynamics(const In<2>& q, const In<2>& v, const In<2>& a, const In<2>& u, const In<2>& lam, int threads,
                         const Times& t) {
        const Mechanism& m = *mechanism_;
        const std::size_t N = q.shape(0), nq = m.n_variables(), nc = m.n_constraints();
        const Points points{q, v, u, a, t};
        if (t) expect(t->size(), N, "t");
        expect(q.size(), N * m.n_configuration(), "q");
        for (const auto* x : {&v, &a}) expect(x->size(), N * nq, "v or a");
        expect(u.size(), N * m.n_inputs, "u");
        expect(lam.size(), N * nc, "lam");
        Out out = new_array({N, nq});
        double* to = out.data();
        nb::gil_scoped_release release;
        parallel_ranges(static_cast<int>(N), threads, [&](int begin, int end) {
            const auto loan = lend();
            std::vector<double> needed(nq);
            for (std::size_t k = begin; k < static_cast<std::size_t>(end); ++k) {
                load(*loan, points, k);
                for (std::size_t i = 0; i < nq; ++i) loan->a[i] = a.data()[k * nq + m.external[i]];
                std::copy_n(lam.data() + k * nc, nc, loan->lam.begin());
                loan->inverse_dynamics(needed);
                for (std::size_t i = 0; i < nq; ++i) to[k * nq + m.external[i]] = needed[i];
            }
        });
        return out;
    }

    Result linearize(const In<2>& q, const In<2>& v, const In<2>& u, const In<2>& rho_a, int threads,
                     const std::optional<Out>& reuse, const Times& t) {
        const Points points{q, v, u, rho_a, t};
        const std::size_t N = check(points), nd = mechanism_->n_dynamic, nc = mechanism_->n_constraints();
        const std::size_t n = n_theta();
        Out a = new_array({N, nd}), lam = new_array({N, nc});
        Out slopes = reused(reuse, {N, nd + nc, n});
        double* to = slopes.data();
        const std::vector<int> column = columns();
        Result out = each_point(points, threads_for(N, 2, threads), a, lam, [&](Continuous& at, std::size_t k) {
            const MotionReport report = at.differentiate();
            if (report.status == MotionStatus::solved) write_slopes(at, column, to + k * (nd + nc) * n);
            return report;
        });
        out.derivatives = slopes;
        return out;
    }

    Result curvatures(const In<2>& q, const In<2>& v, const In<2>& u, const In<2>& rho_a, const In<2>& z_a,
                      const In<2>& z_lam, int threads, const std::optional<Out>& reuse, const Times& t) {
        const Points points{q, v, u, rho_a, t};
        const std::size_t N = check(points), nd = mechanism_->n_dynamic, nc = mechanism_->n_constraints();
        const std::size_t n = n_theta();
        expect(z_a.size(), N * nd, "z_a");
        expect(z_lam.size(), N * nc, "z_lam");
        Out a = new_array({N, nd}), lam = new_array({N, nc}), H = reused(reuse, {N, n, n});
        double* to = H.data();
        const std::vector<int> column = columns();
        Result out = each_point(points, threads_for(N, 4, threads), a, lam, [&](Continuous& at, std::size_t k) {
            const MotionReport report = at.differentiate();
            if (report.status != MotionStatus::solved) return report;
            std::vector<double> weights(nd);
            for (std::size_t i = 0; i < nd; ++i) weights[i] = z_a.data()[k * nd + mechanism_->external[i]];
            at.curvature(weights.data(), z_lam.data() + k * nc);
            write_hessian(at, column, to + k * n * n);
            return report;
        });
        out.derivatives = H;
        return out;
    }

    // Of one point: the Hessians of every acceleration, then of every multiplier.
    Result tensors(const In<2>& q, const In<2>& v, const In<2>& u, const In<2>& rho_a, const Times& t) {
        const Points points{q, v, u, rho_a, t};
        expect(check(points), 1, "points");
        const std::size_t nd = mechanism_->n_dynamic, nc = mechanism_->n_constraints(), n = n_theta();
        Out a = new_array({1, nd}), lam = new_array({1, nc}), all = new_array({nd + nc, n, n});
        double* to = all.data();
        const std::vector<int> column = columns();
        Result out = each_point(points, 1, a, lam, [&](Continuous& at, std::size_t) {
            const MotionReport report = at.differentiate();
            if (report.status != MotionStatus::solved) return report;
            std::vector<double> unit(nd + nc, 0.0);
            for (std::size_t i = 0; i < nd + nc; ++i) {
                unit[i] = 1.0;
                at.curvature(unit.data(), unit.data() + nd);
                unit[i] = 0.0;
                const std::size_t row = i < nd ? mechanism_->external[i] : i;
                write_hessian(at, column, to + row * n * n);
            }
            return report;
        });
        out.derivatives = all;
        return out;
    }

    // Writes z[1:] and u.
    int roll_out_pieces(const In<1>& h, const In<2>& t, const In<2>& matrix, const In<2>& xbar, const In<2>& ubar,
                        const In<3>& K, const Out& z, const Out& u) {
        const Mechanism& m = *mechanism_;
        const std::size_t N = h.size(), points = matrix.shape(0), nx = m.n_states();
        const std::size_t nu = points * m.n_controls(), nz = points * nx + nu, ndz = points * m.n_tangent() + nu;
        expect(matrix.shape(1), points, "matrix");
        expect(t.size(), N * points, "t");
        expect(xbar.size(), (N + 1) * nz, "xbar");
        expect(ubar.size(), N * nu, "ubar");
        expect(K.size(), N * nu * ndz, "K");
        expect(z.size(), (N + 1) * nz, "z");
        expect(u.size(), N * nu, "u");
        nb::gil_scoped_release release;
        const auto loan = lend();
        return leastaction::roll_out_pieces(*loan, static_cast<int>(points), matrix.data(), static_cast<int>(N),
                                            h.data(), t.data(), {xbar.data(), ubar.data(), K.data()}, z.data(),
                                            u.data());
    }

private:
    // Work space for one thread.
    Pool<Continuous>::Loan lend() {
        return pool_.lend([this] { return std::make_unique<Continuous>(mechanism_, damping_, stiffness_); });
    }

    // Where the number of threads is left open, one for N points whose work is done before others have begun: `work` in
    // accelerations of a variable, of which fifteen hundred take a few hundred microseconds.
    int threads_for(std::size_t N, std::size_t work, int requested) const {
        return requested <= 0 && N * mechanism_->n_variables() * work < 1500 ? 1 : requested;
    }
    std::size_t n_theta() const {
        return 2 * mechanism_->n_variables() + mechanism_->n_inputs + mechanism_->n_kinematic;
    }
    std::size_t check(const Points& points) const {
        const Mechanism& m = *mechanism_;
        const std::size_t N = points.q.shape(0);
        expect(points.q.size(), N * m.n_configuration(), "q");
        expect(points.v.size(), N * m.n_variables(), "v");
        expect(points.u.size(), N * m.n_inputs, "u");
        expect(points.rho_a.size(), N * m.n_kinematic, "rho_a");
        if (points.t) expect(points.t->size(), N, "t");
        return N;
    }
    // Where the entries of th, internal order, stand in the user's.
    std::vector<int> columns() const {
        const Mechanism& m = *mechanism_;
        std::vector<int> out(m.external);
        for (const int i : m.external) out.push_back(m.n_variables() + i);
        for (int i = static_cast<int>(out.size()); i < static_cast<int>(n_theta()); ++i) out.push_back(i);
        return out;
    }
    void load(Continuous& at, const Points& points, std::size_t k) const {
        const Mechanism& m = *mechanism_;
        const std::size_t nq = m.n_variables();
        write_configuration(m, points.q.data() + k * m.n_configuration(), at.q);
        for (std::size_t i = 0; i < nq; ++i) at.v[i] = points.v.data()[k * nq + m.external[i]];
        std::copy_n(points.u.data() + k * m.n_inputs, m.n_inputs, at.u.begin());
        at.t = points.t ? points.t->data()[k] : 0.0;
    }

    // Runs a function at every point; a and lam are filled as far as no point failed.
    template <class Function>
    Result each_point(const Points& points, int threads, const Out& a, const Out& lam, const Function& function) {
        const Mechanism& m = *mechanism_;
        const std::size_t N = points.q.shape(0), nd = m.n_dynamic, nk = m.n_kinematic, nc = m.n_constraints();
        double *to_a = a.data(), *to_lam = lam.data();
        std::mutex failure_lock;
        std::size_t failed = N;
        MotionReport failure;
        std::atomic<bool> redundant{false};
        {
            nb::gil_scoped_release release;
            parallel_ranges(static_cast<int>(N), threads, [&](int begin, int end) {
                const auto loan = lend();
                for (std::size_t k = begin; k < static_cast<std::size_t>(end); ++k) {
                    load(*loan, points, k);
                    std::copy_n(points.rho_a.data() + k * nk, nk, loan->a.begin() + nd);
                    const MotionReport report = function(*loan, k);
                    if (report.rank_deficient) redundant = true;
                    if (report.status != MotionStatus::solved) {
                        const std::lock_guard lock(failure_lock);
                        if (k < failed) {
                            failed = k;
                            failure = report;
                        }
                        return;
                    }
                    for (std::size_t i = 0; i < nd; ++i) to_a[k * nd + m.external[i]] = loan->a[i];
                    std::copy(loan->lam.begin(), loan->lam.end(), to_lam + k * nc);
                }
            });
        }
        Result out{a, lam, {}, failed, failure.status, {}, redundant.load()};
        if (failure.variable >= 0) out.variable = m.external[failure.variable];
        return out;
    }

    void write_slopes(const Continuous& at, const std::vector<int>& column, double* to) const {
        const std::size_t nd = mechanism_->n_dynamic, rows = nd + mechanism_->n_constraints(), n = column.size();
        for (std::size_t i = 0; i < rows; ++i) {
            const double* from = &at.Y[i * at.ld()];
            double* row = to + (i < nd ? mechanism_->external[i] : i) * n;
            if (mechanism_->same_order)
                std::copy_n(from, n, row);
            else
                for (std::size_t j = 0; j < n; ++j) row[column[j]] = from[j];
        }
    }
    // From the blocks on and below the diagonal.
    void write_hessian(const Continuous& at, const std::vector<int>& column, double* to) const {
        const std::size_t n = column.size(), nq = mechanism_->n_variables(), nu = mechanism_->n_inputs;
        const std::size_t ends[4] = {nq, 2 * nq, 2 * nq + nu, n};
        std::size_t begin = 0;
        for (const std::size_t end : ends) {
            for (std::size_t i = begin; i < end; ++i) {
                const double* from = &at.H[i * n];
                double* row = to + column[i] * n;
                for (std::size_t j = 0; j < end; ++j) row[column[j]] = from[j];
                for (std::size_t j = 0; j < begin; ++j) to[column[j] * n + column[i]] = from[j];
            }
            begin = end;
        }
    }

    std::shared_ptr<Mechanism> mechanism_;
    double damping_, stiffness_;
    Pool<Continuous> pool_;
};

}  // namespace

void bind_continuous(nb::module_& module) {
    nb::enum_<MotionStatus>(module, "MotionStatus", "How the equations of motion at a point were solved.")
        .value("solved", MotionStatus::solved)
        .value("not_finite", MotionStatus::not_finite)
        .value("singular", MotionStatus::singular);
    nb::class_<Result> result(module, "Accelerations", "The equations of motion solved at many points.");
    array_field(result, "a", &Result::a, "Dynamic accelerations (N, nd).");
    array_field(result, "lam", &Result::lam, "Multipliers (N, nc).");
    result.def_prop_ro(
        "derivatives", [](const Result& r) { return r.derivatives ? *r.derivatives : new_array({0, 0, 0}); },
        nb::rv_policy::automatic, "First derivatives or Hessians; empty if none were asked for.");
    result.def_ro("solved", &Result::solved, "How many points there are before the first that failed.");
    result.def_ro("status", &Result::status, "Of the point that failed.");
    result.def_ro("variable", &Result::variable, "The one whose inertia is lost, where the mass matrix is singular.");
    result.def_ro("rank_deficient", &Result::rank_deficient, "Whether constraints were redundant somewhere.");
    nb::class_<ContinuousMotion>(module, "Continuous", "Equations of motion of one mechanism in continuous time.")
        .def(nb::init<std::shared_ptr<Mechanism>, double, double>(), "mechanism"_a, "damping"_a = 0.0,
             "stiffness"_a = 0.0)
        .def("accelerations", &ContinuousMotion::accelerations, "q"_a, "v"_a, "u"_a, "rho_a"_a, "threads"_a = 0,
             "t"_a.none() = nb::none(), "Dynamic accelerations and multipliers at many points.")
        .def("inverse_dynamics", &ContinuousMotion::inverse_dynamics, "q"_a, "v"_a, "a"_a, "u"_a, "lam"_a,
             "threads"_a = 0, "t"_a.none() = nb::none(),
             "Generalized forces (N, nq) that motions need besides those of the elements under u.")
        .def("linearize", &ContinuousMotion::linearize, "q"_a, "v"_a, "u"_a, "rho_a"_a, "threads"_a = 0,
             "out"_a.none() = nb::none(), "t"_a.none() = nb::none(),
             "accelerations(), and the derivatives of accelerations and multipliers by [q; v; u; rho_a].")
        .def("curvatures", &ContinuousMotion::curvatures, "q"_a, "v"_a, "u"_a, "rho_a"_a, "z_a"_a, "z_lam"_a,
             "threads"_a = 0, "out"_a.none() = nb::none(), "t"_a.none() = nb::none(),
             "accelerations(), and the Hessians of z_a.a + z_lam.lam by [q; v; u; rho_a].")
        .def("tensors", &ContinuousMotion::tensors, "q"_a, "v"_a, "u"_a, "rho_a"_a, "t"_a.none() = nb::none(),
             "accelerations(), and the Hessians of every acceleration and multiplier of one point.")
        .def("roll_out_pieces", &ContinuousMotion::roll_out_pieces, "h"_a, "t"_a, "matrix"_a, "xbar"_a, "ubar"_a, "K"_a,
             "z"_a, "u"_a,
             "Simulates pieces of lengths h, with points at t, by a Runge-Kutta method under a feedback; writes z[1:] "
             "and u, and returns "
             "how many pieces were found before one was not.");
}

}  // namespace leastaction
