#include "elements/forces.hpp"

#include <algorithm>

namespace leastaction {

namespace {

struct ProductMagnitude {
    int gain_slot;
    bool has_input;
    std::shared_ptr<const Law> by_place, by_rate;

    template <class T>
    void on(const LocalCall<T>& call) const {
        const auto& [at, y, size, order, value, gradient, hessian, scale] = call;
        const T one(1.0), gain = at.number(gain_slot), input = has_input ? y[2] : one;
        T place[3] = {one, T{}, T{}}, rate[3] = {one, T{}, T{}};
        if (by_place) by_place->evaluate(at, y[0], place);
        if (by_rate) by_rate->evaluate(at, y[1], rate);
        const T scaled = gain * input;
        value = scaled * place[0] * rate[0];
        if (order == Order::value) return;
        gradient[0] = scaled * place[1] * rate[0];
        gradient[1] = scaled * place[0] * rate[1];
        if (has_input) gradient[2] = gain * place[0] * rate[0];
        if (order == Order::gradient) return;
        const int n = has_input ? 3 : 2;
        hessian[0] = scaled * place[2] * rate[0];
        hessian[1] = hessian[n] = scaled * place[1] * rate[1];
        hessian[n + 1] = scaled * place[0] * rate[2];
        if (has_input) {
            hessian[2] = hessian[6] = gain * place[1] * rate[0];
            hessian[5] = hessian[7] = gain * place[0] * rate[1];
            hessian[8] = T{};
        }
    }
};

}  // namespace

std::shared_ptr<const LocalFunction> product_magnitude(int gain_slot, bool has_input,
                                                       std::shared_ptr<const Law> by_place,
                                                       std::shared_ptr<const Law> by_rate) {
    return std::make_shared<OnAnyCall<ProductMagnitude>>(
        ProductMagnitude{gain_slot, has_input, std::move(by_place), std::move(by_rate)});
}

// n coordinates, m variables, r inputs: y | gradient of F | Hessian of F | rows.
template <class T>
struct CoordinateForce::Workspace {
    Workspace(std::vector<T>& work, int n, int m, int r, bool second) : size(2 * n + r) {
        const int z = 2 * m + r;
        work.resize(2 * size + size * size + 2 * m + (second ? 2 * size * z + z : 0));
        y = work.data();
        gradient = y + size;
        hessian = gradient + size;
        by_q = hessian + size * size;
        by_v = by_q + m;
        dy = by_v + m;
        Fdy = dy + size * z;
        dF = Fdy + size * z;
    }
    int size;
    T *y, *gradient, *hessian;
    T *by_q, *by_v;    // of F (m each)
    T *dy, *Fdy, *dF;  // dy/dz (size x z), Hessian of F times it, dF/dz; z = [q; v; u]
};

CoordinateForce::CoordinateForce(std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates,
                                 std::vector<int> inputs, std::shared_ptr<const LocalFunction> magnitude)
    : coordinates_(std::move(coordinates)), magnitude_(std::move(magnitude)) {
    inputs_ = std::move(inputs);
    for (const auto& coordinate : coordinates_) {
        index_.emplace_back();
        for (const int variable : coordinate->support()) {
            const auto found = std::find(support_.begin(), support_.end(), variable);
            index_.back().push_back(static_cast<int>(found - support_.begin()));
            if (found == support_.end()) support_.push_back(variable);
        }
        for (const int joint : coordinate->joints())
            if (std::find(joints_.begin(), joints_.end(), joint) == joints_.end()) joints_.push_back(joint);
    }
    std::sort(joints_.begin(), joints_.end());
}

template <class T>
void CoordinateForce::measure(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const {
    const std::size_t n = coordinates_.size();
    if (out.coordinates.size() < n) out.coordinates.resize(n);
    T* y = out.work.data();
    for (std::size_t k = 0; k < n; ++k) {
        LocalTaylor<T>& c = out.coordinates[k];
        coordinates_[k]->evaluate(point.at, point.q, order == Order::value ? Order::gradient : Order::hessian, c);
        const auto& support = coordinates_[k]->support();
        y[k] = c.value;
        y[n + k] = T{};
        for (std::size_t i = 0; i < support.size(); ++i) y[n + k] += c.gradient[i] * point.v[support[i]];
    }
    for (std::size_t a = 0; a < inputs_.size(); ++a) y[2 * n + a] = point.u[inputs_[a]];
}

template <class T>
void CoordinateForce::evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const {
    const int n = static_cast<int>(coordinates_.size()), m = static_cast<int>(support_.size());
    const int r = static_cast<int>(inputs_.size());
    const Workspace<T> room(out.work, n, m, r, false);
    measure(point, order, out);
    T F;
    SizeOf<T> scale{};
    magnitude_->evaluate({point.at, room.y, room.size, order, F, room.gradient, room.hessian, scale});
    const auto& along = index_[0];
    const LocalTaylor<T>& s = out.coordinates[0];
    out.f.assign(m, T{});
    for (std::size_t i = 0; i < along.size(); ++i) out.f[along[i]] = F * s.gradient[i];
    if (order == Order::value) return;

    std::fill_n(room.by_q, 2 * m, T{});
    for (int k = 0; k < n; ++k) {
        const LocalTaylor<T>& c = out.coordinates[k];
        const auto& support = coordinates_[k]->support();
        const std::size_t size = support.size();
        const T by_place = room.gradient[k], by_rate = room.gradient[n + k];
        for (std::size_t j = 0; j < size; ++j) {
            const int to = index_[k][j];
            room.by_q[to] += by_place * c.gradient[j];
            room.by_v[to] += by_rate * c.gradient[j];
            if constexpr (std::is_same_v<T, double>)
                if (by_rate == 0.0) continue;
            T rate_by_q{};
            for (std::size_t i = 0; i < size; ++i) rate_by_q += c.hessian[j * size + i] * point.v[support[i]];
            room.by_q[to] += by_rate * rate_by_q;
        }
    }
    out.f_q.assign(m * m, T{});
    out.f_v.assign(m * m, T{});
    out.f_u.assign(m * r, T{});
    for (std::size_t i = 0; i < along.size(); ++i) {
        const int row = along[i];
        for (int j = 0; j < m; ++j) {
            out.f_q[row * m + j] = s.gradient[i] * room.by_q[j];
            out.f_v[row * m + j] = s.gradient[i] * room.by_v[j];
        }
        for (std::size_t j = 0; j < along.size(); ++j)
            out.f_q[row * m + along[j]] += F * s.hessian[i * along.size() + j];
        for (int a = 0; a < r; ++a) out.f_u[row * r + a] = s.gradient[i] * room.gradient[2 * n + a];
    }
}

// With ds = grad s . mu the virtual power is P = F(y) ds, and by z = [q; v; u]
//   P_zz = ds (y_z' F_yy y_z + F_y . y_zz) + F_z ds_z' + ds_z F_z' + F ds_zz,
// where y_zz holds the third derivatives of the coordinates along v, and ds_zz those along mu.
void CoordinateForce::curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                                LocalForce<double>& out) const {
    const int n = static_cast<int>(coordinates_.size()), m = static_cast<int>(support_.size());
    const int r = static_cast<int>(inputs_.size()), size_z = 2 * m + r;
    const Workspace<double> room(out.work, n, m, r, true);
    measure(point, Order::gradient, out);
    double F, scale = 0;
    magnitude_->evaluate({point.at, room.y, room.size, Order::hessian, F, room.gradient, room.hessian, scale});
    if (out.along_v.size() < coordinates_.size()) {
        out.along_v.resize(n);
        out.along_mu.resize(1);
    }

    std::fill_n(room.dy, room.size * size_z, 0.0);
    for (int k = 0; k < n; ++k) {
        const LocalTaylor<double>& c = out.coordinates[k];
        LocalTaylor<Dual<double>>& along_v = out.along_v[k];
        coordinates_[k]->evaluate(directions.along_v, directions.q_along_v, Order::hessian, along_v);
        double *place = room.dy + k * size_z, *rate = room.dy + (n + k) * size_z;
        for (std::size_t i = 0; i < index_[k].size(); ++i) {
            place[index_[k][i]] = rate[m + index_[k][i]] = c.gradient[i];
            rate[index_[k][i]] = along_v.gradient[i].d;
        }
    }
    for (int a = 0; a < r; ++a) room.dy[(2 * n + a) * size_z + 2 * m + a] = 1.0;
    std::fill_n(room.Fdy, room.size * size_z, 0.0);
    std::fill_n(room.dF, size_z, 0.0);
    for (int k = 0; k < room.size; ++k)
        for (int z = 0; z < size_z; ++z) {
            room.dF[z] += room.gradient[k] * room.dy[k * size_z + z];
            for (int l = 0; l < room.size; ++l)
                room.Fdy[k * size_z + z] += room.hessian[k * room.size + l] * room.dy[l * size_z + z];
        }

    const auto& along = index_[0];
    const auto& variables = coordinates_[0]->support();
    double ds = 0;
    for (std::size_t i = 0; i < along.size(); ++i) ds += out.coordinates[0].gradient[i] * directions.mu[variables[i]];
    LocalTaylor<Dual<double>>& along_mu = out.along_mu[0];
    coordinates_[0]->evaluate(directions.along_mu, directions.q_along_mu, Order::hessian, along_mu);

    out.second.assign(size_z * size_z, 0.0);
    double* P = out.second.data();
    for (int k = 0; k < room.size; ++k)
        for (int z = 0; z < size_z; ++z) {
            const double factor = ds * room.dy[k * size_z + z];
            if (factor == 0.0) continue;
            for (int w = 0; w < size_z; ++w) P[z * size_z + w] += factor * room.Fdy[k * size_z + w];
        }
    for (int k = 0; k < n; ++k) {
        const double by_place = ds * room.gradient[k], by_rate = ds * room.gradient[n + k];
        const std::size_t size = index_[k].size();
        for (std::size_t i = 0; i < size; ++i)
            for (std::size_t j = 0; j < size; ++j) {
                const int a = index_[k][i], b = index_[k][j];
                const double second = out.coordinates[k].hessian[i * size + j];
                P[a * size_z + b] += by_place * second + by_rate * out.along_v[k].hessian[i * size + j].d;
                P[a * size_z + m + b] += by_rate * second;
                P[(m + a) * size_z + b] += by_rate * second;
            }
    }
    for (std::size_t i = 0; i < along.size(); ++i) {
        const double ds_i = along_mu.gradient[i].d;
        for (int z = 0; z < size_z; ++z) {
            P[along[i] * size_z + z] += ds_i * room.dF[z];
            P[z * size_z + along[i]] += ds_i * room.dF[z];
        }
        for (std::size_t j = 0; j < along.size(); ++j)
            P[along[i] * size_z + along[j]] += F * along_mu.hessian[i * along.size() + j].d;
    }
}

LEASTACTION_FORCE_ON_ANY_SCALAR(CoordinateForce);

}  // namespace leastaction
