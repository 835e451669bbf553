#include "discrete/turned_middle.hpp"

#include <algorithm>
#include <cstring>

namespace leastaction {

namespace {

using Matrix3 = Turning::Matrix3;
using Matrix6 = Turning::Matrix6;
using Row = Matrix3::Row;
using Wide = Eigen::Array<double, 8, 1>;

const Matrix3 identity{{Row{1, 0, 0, 0}, Row{0, 1, 0, 0}, Row{0, 0, 1, 0}}};

// The planes as blocks: rows by coordinates and by rates, columns by either.
struct Planes {
    explicit Planes(PairDerivatives& d) : qq(d.qq.data()), qv(d.q_v.data()), vq(d.v_q.data()), vv(d.vv.data()) {}
    double *qq, *qv, *vq, *vv;
};

// Second derivatives by three joints in a row, (q, v) twice.
Matrix6 own_block(const Planes& of, std::size_t at, std::size_t stride) {
    const double *qq = of.qq + at, *vv = of.vv + at, *vq = of.vq + at, *qv = of.qv + at;
    const std::size_t y = stride, z = 2 * stride;
    const auto symmetric = [&](const double* d) {
        return Matrix3{
            {Row{d[0], d[y], d[z], 0.0}, Row{d[y], d[y + 1], d[z + 1], 0.0}, Row{d[z], d[z + 1], d[z + 2], 0.0}}};
    };
    const Matrix3 v_by_q{
        {Row{vq[0], qv[y], qv[z], 0.0}, Row{vq[y], vq[y + 1], qv[z + 1], 0.0}, Row{vq[z], vq[z + 1], vq[z + 2], 0.0}}};
    return {symmetric(qq), transposed(v_by_q), v_by_q, symmetric(vv)};
}
// a + a', of which the upper right block is left out.
Matrix6 twice_symmetric(const Matrix6& a) {
    return {a.aa + transposed(a.aa), {}, a.ba + transposed(a.ab), a.bb + transposed(a.bb)};
}
void put_own_block(const Matrix6& block, const Planes& to, std::size_t at, std::size_t stride) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j) {
            const std::size_t ij = at + i * stride + j;
            to.qq[ij] = block.aa(i, j);
            to.vv[ij] = block.bb(i, j);
            to.vq[ij] = block.ba(i, j);
            to.qv[ij] = block.ba(j, i);
        }
}

// Adds to three columns by coordinates, and three by rates, what a change makes of those of `from`. The fourth lane is another
// joint's, and stays.
template <class Change>
void add_columns(const Change& change, const double* from_q, const double* from_v, Row& q, Row& v) {
    for (int l = 0; l < 3; ++l) {
        q += from_q[l] * change.q_by_q.rows[l] + from_v[l] * change.v_by_q.rows[l];
        v += from_q[l] * change.q_by_v.rows[l] + from_v[l] * change.v_by_v.rows[l];
    }
}
template <class Change>
void add_rows(const Change& change, const Wide* from_q, const Wide* from_v, Wide* q, Wide* v) {
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) {
            q[k] += change.q_by_q(l, k) * from_q[l] + change.v_by_q(l, k) * from_v[l];
            v[k] += change.q_by_v(l, k) * from_q[l] + change.v_by_v(l, k) * from_v[l];
        }
}

void get_four(const double* at, Row& out) { std::memcpy(&out, at, sizeof out); }
void put_four(const Row& of, double* at) { std::memcpy(at, &of, sizeof of); }

template <class Change>
void turn_columns(const Change& change, double* q, double* v) {
    Row new_q, new_v;
    get_four(q, new_q);
    get_four(v, new_v);
    add_columns(change, q, v, new_q, new_v);
    put_four(new_q, q);
    put_four(new_v, v);
}
// Of duals: derivatives, and values, which the field changes.
template <class Change>
void turn_columns(const Change& change, const Change& field, double* q, double* v, double* value_q, double* value_v) {
    Row new_q, new_v;
    get_four(q, new_q);
    get_four(v, new_v);
    add_columns(change, q, v, new_q, new_v);
    add_columns(field, value_q, value_v, new_q, new_v);
    put_four(new_q, q);
    put_four(new_v, v);
    turn_columns(change, value_q, value_v);
}

// Three rows, `stride` apart, of which eight columns are in registers.
struct ThreeRows {
    ThreeRows(double* q, double* v, std::size_t stride) : to_q(q), to_v(v), stride(stride) {
        for (int k = 0; k < 3; ++k) {
            old_q[k] = new_q[k] = Eigen::Map<const Wide>(q + k * stride);
            old_v[k] = new_v[k] = Eigen::Map<const Wide>(v + k * stride);
        }
    }
    template <class Change>
    void add(const Change& change, const ThreeRows& of) {
        add_rows(change, of.old_q, of.old_v, new_q, new_v);
    }
    void put() const {
        for (int k = 0; k < 3; ++k) {
            Eigen::Map<Wide>(to_q + k * stride) = new_q[k];
            Eigen::Map<Wide>(to_v + k * stride) = new_v[k];
        }
    }
    double *to_q, *to_v;
    std::size_t stride;
    Wide old_q[3], old_v[3], new_q[3], new_v[3];
};

// Calls f(column) for groups of eight columns that hold those of the joints before a ball, each of them once.
template <class F>
void each_group_before(const Mechanism& m, int joint, const F& f) {
    int next = 0;
    for (const auto& [first, last] : m.runs[joint])
        for (next = std::max(next, first); next < std::min(last, joint); next += 8) f(next);
}

}  // namespace

TurnedMiddle::TurnedMiddle(const Mechanism& m) : mechanism_(m), ball_of_(m.n_variables(), -1), balls_(m.balls.size()) {
    for (std::size_t b = 0; b < m.balls.size(); ++b)
        std::fill_n(&ball_of_[m.balls[b].variable], 3, static_cast<int>(b));
}

void TurnedMiddle::Ends::set(int variable, const Matrix6& of, double rate) {
    first = variable;
    by = {0.5 * of.aa - rate * of.ab, 0.5 * of.aa + rate * of.ab, 0.5 * of.ba - rate * of.bb,
          0.5 * of.ba + rate * of.bb};
}

// From (theta, nu) by (s, d) to (theta, nu/dt) by (s, d/dt).
Matrix6 TurnedMiddle::scaled(const Matrix6& by_middle) const {
    return {by_middle.aa, dt_ * by_middle.ab, rate_ * by_middle.ba, by_middle.bb};
}

void TurnedMiddle::set_balls(const std::vector<Turning>& turnings) {
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        TurnedBall& at = balls_[b];
        at.whole = scaled(ball.prescribed ? GivenTurning(turnings[b].phi()).slope() : turnings[b].slope());
        at.change = {at.whole.aa - identity, at.whole.ab, at.whole.ba, at.whole.bb - identity};
        at.ends.set(ball.variable, at.whole, rate_);
    }
}

void TurnedMiddle::set_field(std::size_t ball, const Matrix6& slope) {
    TurnedBall& at = balls_[ball];
    at.field = scaled(slope);
    at.field_change = {at.field.aa, at.field.ab, at.field.ba, at.field.bb};
    at.field_ends.set(mechanism_.balls[ball].variable, at.field, rate_);
}

// Calls row(first entry of the ball's columns) for every row of a joint behind it.
template <class Row>
void TurnedMiddle::each_row_behind(const Ball& ball, const Row& row) const {
    const Mechanism& m = mechanism_;
    for (int i = ball.joint + 3; i < m.n_massive && m.joints[i].parent > ball.joint; ++i) row(i);
}

void TurnedMiddle::turn(PairDerivatives& pairs) const {
    const Planes d(pairs);
    const std::size_t stride = pairs.stride;
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        if (ball.joint >= mechanism_.n_massive) continue;
        const TurnedBall& by = balls_[b];
        const std::size_t at = ball.joint * stride;
        // W'HW, with H symmetric.
        const Matrix6 halves = transposed_product(by.whole, 0.5 * own_block(d, at + ball.joint, stride));
        const Matrix6 own = twice_symmetric(transposed_product(by.whole, transposed(halves)));
        each_group_before(mechanism_, ball.joint, [&](int j) {
            for (const auto& [q, v] : {std::pair{d.qq, d.vq}, std::pair{d.qv, d.vv}}) {
                ThreeRows rows(q + at + j, v + at + j, stride);
                rows.add(by.change, rows);
                rows.put();
            }
        });
        each_row_behind(ball, [&](int i) {
            const std::size_t row = i * stride + ball.joint;
            turn_columns(by.change, d.qq + row, d.qv + row);
            turn_columns(by.change, d.vq + row, d.vv + row);
        });
        put_own_block(own, d, at + ball.joint, stride);
    }
}

void TurnedMiddle::turn(PairDerivatives& pairs, PairDerivatives& values) const {
    const Planes d(pairs), x(values);
    const std::size_t stride = pairs.stride;
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        if (ball.joint >= mechanism_.n_massive) continue;
        const TurnedBall& by = balls_[b];
        const std::size_t at = ball.joint * stride;
        // W'DW + F'XW + W'XF
        const Matrix6 halves = transposed_product(by.whole, 0.5 * own_block(d, at + ball.joint, stride)) +
                               transposed_product(by.field, own_block(x, at + ball.joint, stride));
        const Matrix6 own = twice_symmetric(transposed_product(by.whole, transposed(halves)));
        each_group_before(mechanism_, ball.joint, [&](int j) {
            const std::size_t row = at + j;
            const auto turn_group = [&](double* q, double* v, double* value_q, double* value_v) {
                ThreeRows rows(q + row, v + row, stride), value_rows(value_q + row, value_v + row, stride);
                rows.add(by.change, rows);
                rows.add(by.field_change, value_rows);
                value_rows.add(by.change, value_rows);
                rows.put();
                value_rows.put();
            };
            turn_group(d.qq, d.vq, x.qq, x.vq);
            turn_group(d.qv, d.vv, x.qv, x.vv);
        });
        each_row_behind(ball, [&](int i) {
            const std::size_t row = i * stride + ball.joint;
            turn_columns(by.change, by.field_change, d.qq + row, d.qv + row, x.qq + row, x.qv + row);
            turn_columns(by.change, by.field_change, d.vq + row, d.vv + row, x.vq + row, x.vv + row);
        });
        put_own_block(own, d, at + ball.joint, stride);
    }
}

void TurnedMiddle::copy_values(const Lagrangian<Dual<double>>& of, PairDerivatives& values) const {
    for (const Ball& ball : mechanism_.balls) {
        if (ball.joint >= mechanism_.n_massive) continue;
        for (int i = ball.joint; i < ball.joint + 3; ++i)
            for (const auto& [first, last] : mechanism_.runs[i]) of.pair_values(i, first, last, values);
        each_row_behind(ball, [&](int i) {  // those of other balls are there in full
            if (ball_of_[mechanism_.joints[i].variable] < 0) of.pair_values(i, ball.joint, ball.joint + 3, values);
        });
    }
}

}  // namespace leastaction
