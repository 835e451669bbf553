#include "elements/rate_force.hpp"

#include <algorithm>

namespace leastaction {

namespace {

// The row c'J of a ball and its derivatives; a does not come in.
template <class T>
struct Row {
    Row(const T* factors, const T* theta) : c0(factors[0]), c1(factors[1]), c2(factors[2]) {
        sincos_of(theta[1], sb, cb);
        sincos_of(theta[2], sc, cc);
    }
    T c0, c1, c2, sb, cb, sc, cc;

    void value(T* g) const {
        g[0] = cb * (c0 * cc - c1 * sc) + c2 * sb;
        g[1] = c0 * sc + c1 * cc;
        g[2] = c2;
    }
    T first_by_b() const { return -1.0 * (sb * (c0 * cc - c1 * sc)) + c2 * cb; }
    T first_by_c() const { return -1.0 * (cb * (c0 * sc + c1 * cc)); }
    T second_by_c() const { return c0 * cc - c1 * sc; }
    // Second derivatives of the row times x: by b twice, by b and c, by c twice.
    std::array<T, 3> bent(const T* x) const {
        const T along = c0 * cc - c1 * sc, across = c0 * sc + c1 * cc;
        return {-1.0 * (x[0] * (cb * along + c2 * sb)), x[0] * sb * across, -1.0 * (x[0] * cb * along + x[1] * across)};
    }
};

}  // namespace

RateForce::RateForce(const std::vector<int>& variables, const std::vector<int>& factor_slots,
                     const std::vector<int>& firsts, int gain_slot, int input, std::shared_ptr<const Law> by_rate)
    : gain_slot_(gain_slot), by_rate_(std::move(by_rate)) {
    for (std::size_t k = 0; k < variables.size(); ++k) {
        const int variable = variables[k];
        const auto ball =
            std::ranges::find_if(firsts, [&](int first) { return first <= variable && variable < first + 3; });
        if (ball == firsts.end()) {
            plain_.emplace_back(static_cast<int>(support_.size()), factor_slots[k]);
            support_.push_back(variable);
            continue;
        }
        auto known = std::ranges::find_if(turns_, [&](const Turns& turns) { return support_[turns.place] == *ball; });
        if (known == turns_.end()) {
            turns_.push_back({static_cast<int>(support_.size()), {-1, -1, -1}});
            known = turns_.end() - 1;
            for (int i = 0; i < 3; ++i) support_.push_back(*ball + i);
        }
        known->slots[variable - *ball] = factor_slots[k];
    }
    if (input >= 0) inputs_.push_back(input);
}

template <class T>
void RateForce::rates(const ForcePoint<T>& point, T* g, T* bend) const {
    const std::size_t m = support_.size();
    std::fill_n(bend, m * m, T{});
    for (const auto& [place, slot] : plain_) g[place] = point.at.number(slot);
    for (const Turns& turns : turns_) {
        T factors[3] = {};
        for (int i = 0; i < 3; ++i)
            if (turns.slots[i] >= 0) factors[i] = point.at.number(turns.slots[i]);
        const Row<T> row(factors, point.q + support_[turns.place]);
        row.value(g + turns.place);
        T* block = bend + turns.place * m + turns.place;
        block[1] = row.first_by_b();
        block[2] = row.first_by_c();
        block[m + 2] = row.second_by_c();
    }
}

template <class T>
RateForce::Magnitude<T> RateForce::magnitude(const ForcePoint<T>& point, const T& rate) const {
    const T gain = point.at.number(gain_slot_), input = inputs_.empty() ? T(1.0) : point.u[inputs_[0]];
    T law[3] = {T(1.0), T{}, T{}};
    if (by_rate_) by_rate_->evaluate(point.at, rate, law);
    const T scaled = gain * input;
    return {scaled * law[0], scaled * law[1], gain * law[0], value_of(scaled * law[2]), value_of(gain * law[1])};
}

template <class T>
void RateForce::evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const {
    const std::size_t m = support_.size(), r = inputs_.size();
    out.work.resize(2 * m + m * m);
    T *g = out.work.data(), *rate_by_q = g + m, *bend = rate_by_q + m;
    rates(point, g, bend);
    T rate{};
    for (std::size_t i = 0; i < m; ++i) rate += g[i] * point.v[support_[i]];
    const Magnitude<T> by = magnitude(point, rate);
    out.f.resize(m);
    for (std::size_t i = 0; i < m; ++i) out.f[i] = by.F * g[i];
    if (order == Order::value) return;

    out.f_q.resize(m * m);
    out.f_v.resize(m * m);
    out.f_u.resize(m * r);
    std::fill_n(rate_by_q, m, T{});
    for (std::size_t i = 0; i < m; ++i)
        for (std::size_t j = 0; j < m; ++j) rate_by_q[j] += bend[i * m + j] * point.v[support_[i]];
    for (std::size_t i = 0; i < m; ++i) {
        for (std::size_t j = 0; j < m; ++j) {
            out.f_q[i * m + j] = by.F * bend[i * m + j] + by.by_rate * g[i] * rate_by_q[j];
            out.f_v[i * m + j] = by.by_rate * g[i] * g[j];
        }
        if (r > 0) out.f_u[i] = by.by_input * g[i];
    }
}

// With A = g.mu the virtual power is F A, and by z = [q; v; u]
//   P_zz = A F_zz + A_z F_z' + F_z A_z' + F A_zz,   F_zz = F'' s_z s_z' + F' s_zz + F'_u (s_z u_z' + u_z s_z'),
// where s is the rate s' = g.v; A depends on q alone.
void RateForce::curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                          LocalForce<double>& out) const {
    const std::size_t m = support_.size(), r = inputs_.size(), size = 2 * m + r;
    out.work.assign(m + m * m + 3 * size, 0.0);
    double *g = out.work.data(), *bend = g + m, *s_z = bend + m * m, *F_z = s_z + size, *A_z = F_z + size;
    rates(point, g, bend);
    double rate = 0, A = 0;
    for (std::size_t i = 0; i < m; ++i) {
        const double v = point.v[support_[i]], mu = directions.mu[support_[i]];
        rate += g[i] * v;
        A += g[i] * mu;
        s_z[m + i] = g[i];
        for (std::size_t j = 0; j < m; ++j) {
            s_z[j] += bend[i * m + j] * v;
            A_z[j] += bend[i * m + j] * mu;
        }
    }
    const Magnitude<double> by = magnitude(point, rate);
    for (std::size_t z = 0; z < size; ++z) F_z[z] = by.by_rate * s_z[z];
    if (r > 0) F_z[2 * m] += by.by_input;

    out.second.assign(size * size, 0.0);
    double* P = out.second.data();
    for (std::size_t z = 0; z < size; ++z) {
        for (std::size_t w = 0; w < size; ++w)
            P[z * size + w] = A * by.second * s_z[z] * s_z[w] + A_z[z] * F_z[w] + F_z[z] * A_z[w];
        if (r > 0) {
            P[z * size + 2 * m] += A * by.mixed * s_z[z];
            P[2 * m * size + z] += A * by.mixed * s_z[z];
        }
    }
    for (std::size_t i = 0; i < m; ++i)
        for (std::size_t j = 0; j < m; ++j) {
            P[j * size + m + i] += A * by.by_rate * bend[i * m + j];
            P[(m + i) * size + j] += A * by.by_rate * bend[i * m + j];
        }
    for (const Turns& turns : turns_) {
        double factors[3] = {}, v[3], mu[3];
        for (int i = 0; i < 3; ++i) {
            if (turns.slots[i] >= 0) factors[i] = point.at.number(turns.slots[i]);
            v[i] = point.v[support_[turns.place + i]];
            mu[i] = directions.mu[support_[turns.place + i]];
        }
        const Row<double> row(factors, point.q + support_[turns.place]);
        const std::array<double, 3> by_v = row.bent(v), by_mu = row.bent(mu);
        double* block = P + turns.place * size + turns.place;
        const auto second = [&](int k) { return A * by.by_rate * by_v[k] + by.F * by_mu[k]; };
        block[size + 1] += second(0);
        block[size + 2] += second(1);
        block[2 * size + 1] += second(1);
        block[2 * size + 2] += second(2);
    }
}

LEASTACTION_FORCE_ON_ANY_SCALAR(RateForce);

}  // namespace leastaction
