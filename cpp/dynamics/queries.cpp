#include "dynamics/queries.hpp"

#include <numeric>
#include <stdexcept>
#include <string>

#include "dynamics/lagrangian.hpp"

namespace leastaction {

namespace {

using Vectors = std::vector<std::vector<double>>;

// A point that moves along its directions; what stands behind the variables, quaternions, stays.
template <class T>
std::vector<T> moving(const std::vector<double>& x, const Vectors& along) {
    std::vector<T> out(x.begin(), x.end());
    if constexpr (std::is_same_v<T, Dual<double>>)
        for (std::size_t i = 0; i < along[0].size(); ++i) out[i].d = along[0][i];
    if constexpr (std::is_same_v<T, HyperDual>)
        for (std::size_t i = 0; i < along[0].size(); ++i) out[i] = {{x[i], along[0][i]}, {along[1][i], 0.0}};
    return out;
}

// The derivative along all directions.
double along_all(double x) { return x; }
template <class T>
double along_all(const Dual<T>& x) {
    return along_all(x.d);
}

std::vector<int> all_joints(const Mechanism& m) {
    std::vector<int> out(m.joints.size());
    std::iota(out.begin(), out.end(), 0);
    return out;
}

template <class T>
FunctionDerivatives bodies_on(const Mechanism& m, const std::vector<double>& q, const std::vector<double>& v,
                              const Directions& along) {
    const std::size_t n = m.n_variables(), size = 2 * n;
    Lagrangian<T> L(m);
    L.gradient(moving<T>(q, along.dq).data(), moving<T>(v, along.dv).data());
    FunctionDerivatives out{{along_all(L.kinetic_energy() - L.potential_energy())},
                            std::vector<double>(size),
                            std::vector<double>(size * size)};
    for (std::size_t i = 0; i < n; ++i) {
        out.gradient[m.external[i]] = along_all(L.L_q[i]);
        out.gradient[n + m.external[i]] = along_all(L.L_v[i]);
    }
    L.hessian();
    const auto add = [&](int i, int j, double qq, double v_q, double vv) {
        const std::size_t a = m.external[i], b = m.external[j];
        out.hessian[a * size + b] += qq;
        out.hessian[(n + a) * size + b] += v_q;
        out.hessian[b * size + n + a] += v_q;
        out.hessian[(n + a) * size + n + b] += vv;
    };
    const PairDerivatives& d = L.pairs;
    each_pair(m, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        add(i, j, weight * d.qq[at], weight * d.v_q[at], weight * d.vv[at]);
        if (mirrored) add(j, i, weight * d.qq[at], weight * d.q_v[at], weight * d.vv[at]);
    });
    return out;
}

template <class T>
FunctionDerivatives functions_on(const Mechanism& m, const Functions& functions, int first, int last,
                                 const double* weights, const std::vector<double>& q, const Directions& along) {
    const std::size_t n = m.n_variables(), count = last - first;
    const std::vector<T> point = moving<T>(q, along.dq);
    Placement<T> at(m);
    place(all_joints(m), point.data(), at);
    FunctionDerivatives out{std::vector<double>(count), std::vector<double>(count * n), std::vector<double>(n * n)};
    LocalTaylor<T> local;
    for (std::size_t k = 0; k < count; ++k) {
        const ConfigurationFunction& function = *functions[first + k];
        for_each_entry(function, at, point.data(), local, [&](int i, int j, const T& bend) {
            out.hessian[m.external[i] * n + m.external[j]] += weights[k] * along_all(bend);
        });
        out.value[k] = along_all(local.value);
        for (std::size_t i = 0; i < function.support().size(); ++i)
            out.gradient[k * n + m.external[function.support()[i]]] += along_all(local.gradient[i]);
    }
    return out;
}

// The Jacobians of forces' sums along directions: n x n, n x n and n x inputs, side by side.
template <class T>
std::vector<double> force_jacobian(const Mechanism& m, const Forces& forces, const std::vector<T>& q,
                                   const std::vector<T>& v, const std::vector<T>& u) {
    const std::size_t n = m.n_variables(), size = 2 * n + m.n_inputs;
    Placement<T> at(m);
    place(m.force_joints, q.data(), at);
    LocalForce<T> local;
    const ForcePoint<T> point{at, q.data(), v.data(), u.data()};
    std::vector<double> jacobian(n * size);
    for_each_entry(
        forces, point, local,
        [&](int i, int j, const T& f_q, const T& f_v) {
            double* row = jacobian.data() + m.external[i] * size;
            row[m.external[j]] += along_all(f_q);
            row[n + m.external[j]] += along_all(f_v);
        },
        [&](int i, int a, const T& f_u) { jacobian[m.external[i] * size + 2 * n + a] += along_all(f_u); });
    return jacobian;
}

// Calls f with a scalar of as many directions.
template <class F>
FunctionDerivatives on_scalar(std::size_t directions, const F& f) {
    switch (directions) {
        case 0:
            return f(double{});
        case 1:
            return f(Dual<double>{});
        case 2:
            return f(HyperDual{});
        default:
            throw std::invalid_argument("directions: got " + std::to_string(directions) + ", expected 2 at most");
    }
}

}  // namespace

FunctionDerivatives lagrangian_of_bodies(const Mechanism& m, const std::vector<double>& q, const std::vector<double>& v,
                                         const Directions& along) {
    return on_scalar(along.dq.size(), [&](auto scalar) { return bodies_on<decltype(scalar)>(m, q, v, along); });
}

ForceDerivatives forces_along(const Mechanism& m, const Forces& forces, const std::vector<double>& weights,
                              const StateAndInputs& point, const StateAndInputs& along) {
    const std::size_t n = m.n_variables(), r = m.n_inputs, size = 2 * n + r;
    const auto once = [](const std::vector<double>& x, const std::vector<double>& dx) {
        return moving<Dual<double>>(x, {dx});
    };
    ForceDerivatives out{
        force_jacobian(m, forces, once(point.q, along.q), once(point.v, along.v), once(point.u, along.u)),
        std::vector<double>(size * size)};
    std::vector<double> unit(size);
    for (std::size_t j = 0; j < size; ++j) {
        // [q; v; u] with q and v in internal order, which the unit vector is in too
        unit.assign(size, 0.0);
        unit[j] = 1.0;
        const auto twice = [&](const std::vector<double>& x, const std::vector<double>& dx, std::size_t start) {
            const auto from = unit.begin() + static_cast<std::ptrdiff_t>(start);
            return moving<HyperDual>(x, {dx, {from, from + static_cast<std::ptrdiff_t>(dx.size())}});
        };
        const std::vector<double> jacobian = force_jacobian(m, forces, twice(point.q, along.q, 0),
                                                            twice(point.v, along.v, n), twice(point.u, along.u, 2 * n));
        const std::size_t column = j < n ? m.external[j] : j < 2 * n ? n + m.external[j - n] : j;
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t a = 0; a < size; ++a)
                out.hessian[a * size + column] += weights[i] * jacobian[i * size + a];
    }
    return out;
}

FunctionDerivatives functions_of_configuration(const Mechanism& m, const Functions& functions, int first, int last,
                                               const double* weights, const std::vector<double>& q,
                                               const Directions& along) {
    return on_scalar(along.dq.size(), [&](auto scalar) {
        return functions_on<decltype(scalar)>(m, functions, first, last, weights, q, along);
    });
}

}  // namespace leastaction
