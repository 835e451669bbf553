// Second derivatives of a step by numbers of elements; see curvature.hpp.
#include <algorithm>
#include <array>
#include <cmath>

#include "discrete/curvature.hpp"

namespace leastaction {

namespace {

// Part of a number by which it is moved. Differences of the fourth order are exact for polynomials up to that.
constexpr double part = 1e-3;

// The elements of a step on duals in the space of the numbers, and the weights of its equations.
class NumberPoint {
public:
    // e, c, g: weights of dt L_q, of forces and of L_v by variable.
    NumberPoint(const Mechanism& m, const MidpointStep& step, double dt, const std::vector<double>& mu,
                const Eigen::VectorXd& e, const Eigen::VectorXd& c, const Eigen::VectorXd& g, NumberDuals& duals)
        : m_(m), step_(step), dt_(dt), mu_(mu), e_(e), c_(c), g_(g), at_(duals) {}

    // What the weights stand before in S along a direction: of dt L_q, of forces, and at the start.
    void rows(const double* direction, double* of_e, double* of_c, double* of_mu) {
        at_.look(m_.numbers.data(), direction);
        for_each_entry(m_.potentials, at_.middle, at_.Q.data(), at_.local,
                       [&](int i, const Dual<double>& slope) { of_e[i] -= dt_ * slope.d; });
        for_each_entry(m_.forces, at_.at_middle(), at_.force, [&](int i, const Dual<double>& f) { of_c[i] += f.d; });
        for_each_entry(m_.instant_forces, at_.at_start(), at_.force,
                       [&](int i, const Dual<double>& f) { of_mu[i] += step_.share * f.d; });
        for (int c = 0; c < m_.n_constraints(); ++c)
            for_each_entry(*m_.constraints[c], at_.start, at_.Q1.data(), at_.local,
                           [&](int i, const Dual<double>& slope) { of_mu[i] -= step_.lam[c] * slope.d; });
    }

    // S along a direction, at other numbers.
    double value(const double* numbers, const double* direction) {
        const int nd = m_.n_dynamic;
        at_.look(numbers, direction);
        double sum = 0;
        for (const auto& [i, slot] : m_.damping) sum -= c_[i] * direction[slot] * at_.V[i].v;
        for (const Rotor& rotor : m_.rotors)
            rotor.each_momentum(at_.middle, at_.V.data(),
                                [&](int i, const Dual<double>& momentum) { sum += g_[i] * momentum.d; });
        for_each_entry(m_.potentials, at_.middle, at_.Q.data(), at_.local,
                       [&](int i, const Dual<double>& slope) { sum -= dt_ * e_[i] * slope.d; });
        for_each_entry(m_.forces, at_.at_middle(), at_.force,
                       [&](int i, const Dual<double>& f) { sum += c_[i] * f.d; });
        for_each_entry(m_.instant_forces, at_.at_start(), at_.force,
                       [&](int i, const Dual<double>& f) { sum += i < nd ? step_.share * mu_[i] * f.d : 0.0; });
        for (int c = 0; c < m_.n_constraints(); ++c) {
            for_each_entry(*m_.constraints[c], at_.start, at_.Q1.data(), at_.local,
                           [&](int i, const Dual<double>& slope) {
                               if (i < nd) sum -= step_.lam[c] * mu_[i] * slope.d;
                           });
            m_.constraints[c]->evaluate(at_.end, at_.Q2.data(), Order::value, at_.local);
            sum += mu_[nd + c] * at_.local.value.d;
        }
        return sum;
    }

    // Its gradient by q and v in the middle, by q1, q2 besides, u and lam, each added to.
    void gradient(const double* direction, double* by_q, double* by_v, double* by_q1, double* by_q2, double* by_u,
                  double* by_lam) {
        const int nd = m_.n_dynamic;
        at_.look(m_.numbers.data(), direction);
        const auto by_middle = [&](int j, double of_q, double of_v) {
            by_q[j] += of_q;
            by_v[j] += of_v;
        };
        for (const auto& [i, slot] : m_.damping) by_middle(i, 0.0, -c_[i] * direction[slot]);
        for (const Rotor& rotor :
             m_.rotors)  // L_vv is symmetric: of g . L_v by v_j it is the momentum of j for the velocity g
            rotor.each_momentum(at_.middle, g_.data(),
                                [&](int j, const Dual<double>& momentum) { by_middle(j, 0.0, momentum.d); });
        for_each_entry(m_.potentials, at_.middle, at_.Q.data(), at_.local,
                       [&](int i, int j, const Dual<double>& bend) { by_middle(j, -dt_ * e_[i] * bend.d, 0.0); });
        for_each_entry(
            m_.forces, at_.at_middle(), at_.force,
            [&](int i, int j, const Dual<double>& f_q, const Dual<double>& f_v) {
                by_middle(j, c_[i] * f_q.d, c_[i] * f_v.d);
            },
            [&](int i, int input, const Dual<double>& f_u) { by_u[input] += c_[i] * f_u.d; });
        for_each_entry(
            m_.instant_forces, at_.at_start(), at_.force,
            [&](int i, int j, const Dual<double>& f_q, const Dual<double>&) {
                if (i < nd) by_q1[j] += step_.share * mu_[i] * f_q.d;
            },
            [&](int i, int input, const Dual<double>& f_u) {
                if (i < nd) by_u[input] += step_.share * mu_[i] * f_u.d;
            });
        for (int c = 0; c < m_.n_constraints(); ++c) {
            const auto& support = m_.constraints[c]->support();
            for_each_entry(*m_.constraints[c], at_.start, at_.Q1.data(), at_.local,
                           [&](int i, int j, const Dual<double>& bend) {
                               if (i < nd) by_q1[j] -= step_.lam[c] * mu_[i] * bend.d;
                           });
            for (std::size_t k = 0; k < support.size(); ++k)
                if (support[k] < nd) by_lam[c] -= mu_[support[k]] * at_.local.gradient[k].d;
            for_each_entry(*m_.constraints[c], at_.end, at_.Q2.data(), at_.local,
                           [&](int j, const Dual<double>& slope) { by_q2[j] += mu_[nd + c] * slope.d; });
        }
    }

private:
    const Mechanism& m_;
    const MidpointStep& step_;
    double dt_;
    const std::vector<double>& mu_;
    const Eigen::VectorXd &e_, &c_, &g_;
    NumberDuals& at_;
};

// How far numbers are moved along a direction.
double width(const std::vector<double>& numbers, const std::vector<double>& direction) {
    double size = 0;
    for (std::size_t slot = 0; slot < numbers.size(); ++slot)
        if (direction[slot] != 0.0) size = std::max(size, std::abs(numbers[slot] / direction[slot]));
    return part * (size > 0.0 ? size : 1.0);
}

}  // namespace

void SecondOrder::by_numbers(double dt, const FirstOrder& first, const MidpointStep& step,
                             const std::vector<Parameter>& directions, ParameterSlopes& slopes, double* out,
                             double* twice) {
    const int ny = nd_ + nc_, count = static_cast<int>(directions.size());
    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt);
    AtInstants& by = by_instants_;
    by.begin(nq_, nu_);
    by_y_.setZero(ny, count);
    g_.setZero(nq_);
    const auto [mu_z, w_z, n_z] = this->directions();
    for (int i = 0; i < n_z; ++i) {
        by.e[i] = 0.5 * (mu_z[i] + w_z[i]);
        by.c[i] = km * mu_z[i] + kp * w_z[i];
        g_[i] = w_z[i] - mu_z[i];
    }
    NumberPoint point(mechanism_, step, dt, mu_, by.e, by.c, g_, slopes.duals);
    const Eigen::Map<const NewtonMatrix::Matrix> Y_all(slopes.Y.data(), ny, slopes.ld);
    bent_.noalias() = W_yy_ * Y_all.leftCols(count);
    for (int a = 0; a < count; ++a) {
        by.q1.setZero();
        by.q2.setZero();
        by.u.setZero();
        const double* along = directions[a].numbers.data();
        by_q_.setZero(nq_);
        by_v_.setZero(nq_);
        point.gradient(along, by_q_.data(), by_v_.data(), by.q1.data(), by.q2.data(), by.u.data(),
                       by_y_.col(a).data() + nd_);
        if (turned_) {
            changes_.setZero(nq_, 5);
            point.rows(along, changes_.col(0).data(), changes_.col(1).data(), changes_.col(2).data());
            changes_.col(0) += (km + kp) * changes_.col(1);
            changes_.col(1) *= 0.5 * (kp - km);
            changes_.col(3) = changes_.col(0);
            changes_.col(4) = by_v_;
        }
        by_theta(dt, first, a, Y_all.col(a), out + static_cast<std::ptrdiff_t>(a) * n_theta_);
    }
    for (int b = 0; b < count; ++b) {
        const std::vector<double>& along = directions[b].numbers;
        const double h = width(mechanism_.numbers, along);
        for (int a = 0; a <= b; ++a) twice[a * count + b] = 0.0;
        for (const auto& [steps, weight] : {std::pair{1, 8.0}, {-1, -8.0}, {2, -1.0}, {-2, 1.0}}) {
            moved_ = mechanism_.numbers;
            for (std::size_t slot = 0; slot < moved_.size(); ++slot) moved_[slot] += steps * h * along[slot];
            for (int a = 0; a <= b; ++a)
                twice[a * count + b] += weight / (12.0 * h) * point.value(moved_.data(), directions[a].numbers.data());
        }
        for (int a = 0; a <= b; ++a) {
            double& value = twice[a * count + b];
            for (int i = 0; i < ny; ++i)
                value += by_y_(i, a) * Y_all(i, b) + by_y_(i, b) * Y_all(i, a) + Y_all(i, a) * bent_(i, b);
            twice[b * count + a] = value;
        }
    }
}

}  // namespace leastaction
