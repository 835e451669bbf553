// Second derivatives of a step by numbers of elements; see curvature.hpp.
#include <algorithm>
#include <array>
#include <cmath>

#include "discrete/curvature.hpp"

namespace leastaction {

namespace {

// Part of a number by which it is moved. Differences of the fourth order are exact for polynomials up to that.
constexpr double part = 1e-3;

// Where the elements of a step are evaluated on duals in the space of the numbers, and the weights of its equations.
class NumberPoint {
public:
    NumberPoint(const Mechanism& m, const MidpointStep& step, double dt, const std::vector<double>& mu,
                const std::vector<double>& w_p)
        : m_(m), step_(step), dt_(dt), mu_(mu), start_(m), end_(m), middle_(m), none_(m.n_variables()) {
        const int nd = m.n_dynamic, nq = m.n_variables();
        const ForcePoint<double> at = step.middle();
        const double km = kappa_minus(step.split(), dt), kp = kappa_plus(step.split(), dt);
        e_.assign(nq, 0.0);
        c_.assign(nq, 0.0);
        for (int i = 0; i < nd; ++i) {
            e_[i] = 0.5 * (mu[i] + w_p[i]);
            c_[i] = km * mu[i] + kp * w_p[i];
        }
        Q1_.assign(step.q1.begin(), step.q1.end());
        Q2_.assign(step.q2.begin(), step.q2.end());
        Q_.assign(at.q, at.q + nq);
        V_.assign(at.v, at.v + nq);
        U_.assign(at.u, at.u + m.n_inputs);
        place(m.constraint_joints, Q1_.data(), start_);
        place(m.instant_joints, Q1_.data(), start_);
        place(m.constraint_joints, Q2_.data(), end_);
        place(m.element_joints, Q_.data(), middle_);
    }

    // S along a direction, at other numbers.
    double value(const double* numbers, const double* direction) {
        const int nd = m_.n_dynamic;
        look(numbers, direction);
        double sum = 0;
        for (const auto& [i, slot] : m_.damping) sum -= c_[i] * direction[slot] * V_[i].v;
        for_each_entry(m_.potentials, middle_, Q_.data(), local_,
                       [&](int i, const Dual<double>& slope) { sum -= dt_ * e_[i] * slope.d; });
        for_each_entry(m_.forces, ForcePoint<Dual<double>>{middle_, Q_.data(), V_.data(), U_.data()}, force_,
                       [&](int i, const Dual<double>& f) { sum += c_[i] * f.d; });
        for_each_entry(m_.instant_forces, ForcePoint<Dual<double>>{start_, Q1_.data(), none_.data(), U_.data()}, force_,
                       [&](int i, const Dual<double>& f) { sum += i < nd ? step_.share * mu_[i] * f.d : 0.0; });
        for (int c = 0; c < m_.n_constraints(); ++c) {
            for_each_entry(*m_.constraints[c], start_, Q1_.data(), local_, [&](int i, const Dual<double>& slope) {
                if (i < nd) sum -= step_.lam[c] * mu_[i] * slope.d;
            });
            m_.constraints[c]->evaluate(end_, Q2_.data(), Order::value, local_);
            sum += mu_[nd + c] * local_.value.d;
        }
        return sum;
    }

    // Its gradient by q1, q2, u and lam, each added to.
    void gradient(const double* direction, double* by_q1, double* by_q2, double* by_u, double* by_lam) {
        const int nd = m_.n_dynamic;
        look(m_.numbers.data(), direction);
        const auto by_middle = [&](int j, double by_q, double by_v) {
            by_q1[j] += 0.5 * by_q - by_v / dt_;
            by_q2[j] += 0.5 * by_q + by_v / dt_;
        };
        for (const auto& [i, slot] : m_.damping) by_middle(i, 0.0, -c_[i] * direction[slot]);
        for_each_entry(m_.potentials, middle_, Q_.data(), local_,
                       [&](int i, int j, const Dual<double>& bend) { by_middle(j, -dt_ * e_[i] * bend.d, 0.0); });
        for_each_entry(
            m_.forces, ForcePoint<Dual<double>>{middle_, Q_.data(), V_.data(), U_.data()}, force_,
            [&](int i, int j, const Dual<double>& f_q, const Dual<double>& f_v) {
                by_middle(j, c_[i] * f_q.d, c_[i] * f_v.d);
            },
            [&](int i, int input, const Dual<double>& f_u) { by_u[input] += c_[i] * f_u.d; });
        for_each_entry(
            m_.instant_forces, ForcePoint<Dual<double>>{start_, Q1_.data(), none_.data(), U_.data()}, force_,
            [&](int i, int j, const Dual<double>& f_q, const Dual<double>&) {
                if (i < nd) by_q1[j] += step_.share * mu_[i] * f_q.d;
            },
            [&](int i, int input, const Dual<double>& f_u) {
                if (i < nd) by_u[input] += step_.share * mu_[i] * f_u.d;
            });
        for (int c = 0; c < m_.n_constraints(); ++c) {
            const auto& support = m_.constraints[c]->support();
            for_each_entry(*m_.constraints[c], start_, Q1_.data(), local_, [&](int i, int j, const Dual<double>& bend) {
                if (i < nd) by_q1[j] -= step_.lam[c] * mu_[i] * bend.d;
            });
            for (std::size_t k = 0; k < support.size(); ++k)
                if (support[k] < nd) by_lam[c] -= mu_[support[k]] * local_.gradient[k].d;
            for_each_entry(*m_.constraints[c], end_, Q2_.data(), local_,
                           [&](int j, const Dual<double>& slope) { by_q2[j] += mu_[nd + c] * slope.d; });
        }
    }

private:
    void look(const double* numbers, const double* direction) {
        for (auto* at : {&start_, &end_, &middle_}) {
            at->numbers = numbers;
            at->number_slopes = direction;
        }
    }

    const Mechanism& m_;
    const MidpointStep& step_;
    double dt_;
    const std::vector<double>& mu_;
    Placement<Dual<double>> start_, end_, middle_;
    std::vector<Dual<double>> Q1_, Q2_, Q_, V_, U_, none_;
    std::vector<double> e_, c_;
    LocalTaylor<Dual<double>> local_;
    LocalForce<Dual<double>> force_;
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
                             const std::vector<Parameter>& directions, const ParameterSlopes& slopes, double* out,
                             double* twice) {
    using Vector = Eigen::VectorXd;
    const int ny = nd_ + nc_, count = static_cast<int>(directions.size());
    NumberPoint point(mechanism_, step, dt, mu_, w_p);
    const Eigen::Map<const NewtonMatrix::Matrix> Y(first.Y.data(), ny, first.ld);
    const Eigen::Map<const NewtonMatrix::Matrix> Y_all(slopes.Y.data(), ny, slopes.ld);
    std::vector<Vector> by_y(count, Vector::Zero(ny));
    for (int a = 0; a < count; ++a) {
        Vector by_q1 = Vector::Zero(nq_), by_q2 = Vector::Zero(nq_), by_u = Vector::Zero(nu_);
        point.gradient(directions[a].numbers.data(), by_q1.data(), by_q2.data(), by_u.data(), by_y[a].data() + nd_);
        by_y[a].head(nd_) = by_q2.head(nd_);
        Eigen::Map<Vector> by_theta(out + static_cast<std::ptrdiff_t>(a) * n_theta_, n_theta_);
        by_theta.setZero();
        by_theta.head(nq_) = by_q1;
        by_theta.segment(nq_ + nd_, nu_) = by_u;
        by_theta.tail(nq_ - nd_) = by_q2.tail(nq_ - nd_);
        const Vector Y_a = Y_all.col(a);
        by_theta += Y.leftCols(n_theta_).transpose() * (by_y[a] + W_yy_ * Y_a) + W_yth_.transpose() * Y_a;
    }
    std::vector<double> moved;
    for (int b = 0; b < count; ++b) {
        const std::vector<double>& along = directions[b].numbers;
        const double h = width(mechanism_.numbers, along);
        const auto at = [&](int steps, int a) {
            moved = mechanism_.numbers;
            for (std::size_t slot = 0; slot < moved.size(); ++slot) moved[slot] += steps * h * along[slot];
            return point.value(moved.data(), directions[a].numbers.data());
        };
        const Vector Y_b = Y_all.col(b), bent = W_yy_ * Y_b;
        for (int a = 0; a <= b; ++a) {
            const double own = (8.0 * (at(1, a) - at(-1, a)) - (at(2, a) - at(-2, a))) / (12.0 * h);
            const Vector Y_a = Y_all.col(a);
            twice[a * count + b] = twice[b * count + a] = own + by_y[a].dot(Y_b) + by_y[b].dot(Y_a) + Y_a.dot(bent);
        }
    }
}

}  // namespace leastaction
