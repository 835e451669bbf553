#include "dynamics/lagrangian.hpp"

#include <Eigen/Core>
#include <algorithm>

#include "dynamics/world_inertia.hpp"

namespace leastaction {

namespace {

constexpr int lanes = 8;
using Wide = Eigen::Array<double, lanes, 1>;

// The doubles of a scalar: its value, and for a dual its derivative; for a hyper-dual those of both its duals.
inline double part_of(double x, int) { return x; }
inline const Lanes& part_of(const Lanes& x, int) { return x; }
inline double part_of(const Dual<double>& x, int part) { return part == 0 ? x.v : x.d; }
inline double part_of(const HyperDual& x, int part) { return part_of(part < 2 ? x.v : x.d, part % 2); }

// From a frame with the given pose to the world: with b = R h, the rotational part is
// R I R' + 2 (p.b) E - p b' - b p' + m (p.p E - p p').
Inertia<double> moved(const Inertia<double>& a, const Pose<double>& pose) {
    const Vec3<double>& p = pose.p;
    const Vec3<double> b = pose.R * a.h;
    const Mat3<double> turned{pose.R * (a.I * transposed_times(pose.R, Vec3<double>{1, 0, 0})),
                              pose.R * (a.I * transposed_times(pose.R, Vec3<double>{0, 1, 0})),
                              pose.R * (a.I * transposed_times(pose.R, Vec3<double>{0, 0, 1}))};
    const double diagonal = 2.0 * dot(p, b) + a.m * dot(p, p);
    Inertia<double> out{a.m, b + a.m * p, {}};
    out.I.xx = turned.c0.x + diagonal - 2.0 * p.x * b.x - a.m * p.x * p.x;
    out.I.yy = turned.c1.y + diagonal - 2.0 * p.y * b.y - a.m * p.y * p.y;
    out.I.zz = turned.c2.z + diagonal - 2.0 * p.z * b.z - a.m * p.z * p.z;
    out.I.xy = turned.c1.x - p.x * b.y - p.y * b.x - a.m * p.x * p.y;
    out.I.xz = turned.c2.x - p.x * b.z - p.z * b.x - a.m * p.x * p.z;
    out.I.yz = turned.c2.y - p.y * b.z - p.z * b.y - a.m * p.y * p.z;
    return out;
}

// of.by'm and m of.by.
SmallMatrix<6> turned_rows(const TurnedJoints& of, const SmallMatrix<6>& m) {
    const SmallMatrix<6>& by = *of.by;
    if (!of.keeps_q) return transposed_product(by, m);
    SmallMatrix<6> out{m.aa, m.ab, transposed_product(by.ab, m.aa), transposed_product(by.ab, m.ab)};
    add_transposed_product(out.aa, by.ba, m.ba);
    add_transposed_product(out.ab, by.ba, m.bb);
    add_transposed_product(out.ba, by.bb, m.ba);
    add_transposed_product(out.bb, by.bb, m.bb);
    return out;
}
SmallMatrix<6> turned_columns(const SmallMatrix<6>& m, const TurnedJoints& of) {
    const SmallMatrix<6>& by = *of.by;
    if (!of.keeps_q) return m * by;
    SmallMatrix<6> out{m.aa, m.aa * by.ab, m.ba, m.ba * by.ab};
    add_product(out.aa, m.ab, by.ba);
    add_product(out.ab, m.ab, by.bb);
    add_product(out.ba, m.bb, by.ba);
    add_product(out.bb, m.bb, by.bb);
    return out;
}

// Whether a joint is one of the three of a ball.
bool is_of_ball(const Mechanism& m, int joint) {
    for (int first = joint; first >= 0 && first > joint - 3; --first)
        if (m.joints[first].quaternion >= 0) return true;
    return false;
}

}  // namespace

void PairDerivatives::resize(const Mechanism& mechanism) {
    stride = (mechanism.n_massive + lanes - 1) / lanes * lanes + lanes;
    for (auto* plane : {&vv, &v_q, &q_v, &qq}) plane->assign(pair_entries(mechanism, stride), 0.0);
}

template <class T>
Lagrangian<T>::Lagrangian(const Mechanism& mechanism) : at(mechanism), mechanism_(mechanism) {
    const std::size_t n = mechanism.n_massive;
    L_q.assign(mechanism.n_variables(), T{});
    L_v.assign(mechanism.n_variables(), T{});
    V_.resize(n);
    W_.resize(n);
    h_own_.resize(n);
    h_.resize(n);
    m_.resize(n);
    H_own_.resize(n);
    H_.resize(n);
    IC_.resize(n);
    stride_ = (n + lanes - 1) / lanes * lanes + lanes;
    for (int part = 0; part < parts; ++part) {
        S_wide_[part].assign(6 * stride_, 0.0);
        W_wide_[part].assign(6 * stride_, 0.0);
        G_wide_[part].assign(3 * stride_, 0.0);
        AB_[part].assign(12 * n, 0.0);
    }
}

template <class T>
void Lagrangian<T>::gradient(const T* q, const T* v) {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    place(m.massive_joints, q, at);
    for (int i = 0; i < n; ++i) {
        const Joint& joint = m.joints[i];
        const Motion<T>& S = at.twist[i];
        const T rate = joint.rate(v);
        V_[i] = joint.parent < 0 ? rate * S : V_[joint.parent] + rate * S;
        W_[i] = cross(S, V_[i]);

        const Body& body = m.bodies[i];
        m_[i] = T(body.mass);
        if (body.is_empty()) {  // one of several joints in a row: no body of its own
            h_[i] = h_own_[i] = Vec3<T>{};
            H_[i] = H_own_[i] = Force<T>{};
            continue;
        }
        const Pose<T>& pose = at.pose[i];
        const Vec3<T> c = pose.R * body.com + pose.p;
        const Vec3<T> momentum = body.mass * (V_[i].v + cross(V_[i].w, c));
        h_[i] = h_own_[i] = body.mass * c;
        const Vec3<T> spin = pose.R * (body.inertia * transposed_times(pose.R, V_[i].w));
        H_[i] = H_own_[i] = {momentum, spin + cross(c, momentum)};
    }
    const Vec3<double>& g = m.gravity;
    std::fill(L_q.begin(), L_q.end(), T{});
    std::fill(L_v.begin(), L_v.end(), T{});
    for (int i = n - 1; i >= 0; --i) {
        const Joint& joint = m.joints[i];
        const Motion<T>& S = at.twist[i];
        const T momentum = dot(H_[i], S);
        const T weight = m_[i] * dot(g, S.v) + dot(cross(h_[i], g), S.w), slope = weight - dot(H_[i], W_[i]);
        if (m.plain)
            L_v[joint.variable] = momentum, L_q[joint.variable] = slope;
        else
            joint.each_term([&](int variable, double factor) {
                L_v[variable] += factor * momentum;
                L_q[variable] += factor * slope;
            });
        if (joint.parent >= 0) {
            H_[joint.parent] += H_[i];
            h_[joint.parent] += h_[i];
            m_[joint.parent] += m_[i];
        }
    }
    twice_of_rotors_ = T{};
    for (const Rotor& rotor : m.rotors)
        rotor.each_momentum(m, v, [&](int variable, const T& momentum) {
            L_v[variable] += momentum;
            twice_of_rotors_ += momentum * v[variable];
        });
}

template <class T>
void Lagrangian<T>::composites() {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    for (int i = 0; i < n; ++i)
        IC_[i] = m.bodies[i].is_empty() ? Inertia<T>{} : world_inertia(m.bodies[i], at.pose[i], h_own_[i]);
    for (int i = n - 1; i >= 0; --i) {
        const Joint& joint = m.joints[i];
        if (joint.parent >= 0) IC_[joint.parent] += IC_[i];
        const Motion<T>& S = at.twist[i];
        const Force<T> A = IC_[i] * S;
        const Force<T> B = cross_dual(S, H_[i]) - IC_[i] * W_[i];
        const T ab[12] = {A.f.x, A.f.y, A.f.z, A.n.x, A.n.y, A.n.z, B.f.x, B.f.y, B.f.z, B.n.x, B.n.y, B.n.z};
        for (int part = 0; part < parts; ++part)
            for (int c = 0; c < 12; ++c) AB_[part][i * 12 + c] = part_of(ab[c], part);
    }
}

template <class T>
void Lagrangian<T>::inertias(double* by_variable) const
    requires std::is_same_v<T, double>
{
    const Mechanism& m = mechanism_;
    std::fill_n(by_variable, m.n_variables(), 0.0);
    for (int i = 0; i < m.n_massive; ++i)
        m.joints[i].each_term([&](int variable, double factor) {
            const double* A = &AB_[0][i * 12];
            // Joints of one variable that stand above each other move the same masses.
            const auto above = m.plain ? m.path[i].last(1) : m.path[i];
            for (const int j : above)
                m.joints[j].each_term([&](int other, double other_factor) {
                    if (other != variable) return;
                    const Motion<T>& S = at.twist[j];
                    const double pair = dot(Force<T>{{A[0], A[1], A[2]}, {A[3], A[4], A[5]}}, S);
                    by_variable[variable] += (i == j ? 1.0 : 2.0) * factor * other_factor * pair;
                });
        });
    each_rotor_inertia(m, [&](int variable, double inertia) { by_variable[variable] += inertia; });
}

template <class T>
void Lagrangian<T>::hessian(std::span<const TurnedJoints> turned)
    requires(!std::is_same_v<T, Lanes>)
{
    const int n = mechanism_.n_massive;
    if (pairs.stride == 0) {
        pairs.resize(mechanism_);
        if constexpr (std::is_same_v<T, double>) put_rotors(mechanism_, pairs.vv);
    }
    composites();
    for (int i = 0; i < n; ++i) {
        const Motion<T>& S = at.twist[i];
        const Vec3<T> G = cross(S.w, mechanism_.gravity);
        const T s[6] = {S.v.x, S.v.y, S.v.z, S.w.x, S.w.y, S.w.z};
        const T w[6] = {W_[i].v.x, W_[i].v.y, W_[i].v.z, W_[i].w.x, W_[i].w.y, W_[i].w.z};
        const T gv[3] = {G.x, G.y, G.z};
        for (int part = 0; part < parts; ++part) {
            for (int c = 0; c < 6; ++c) {
                S_wide_[part][c * stride_ + i] = part_of(s[c], part);
                W_wide_[part][c * stride_ + i] = part_of(w[c], part);
            }
            for (int c = 0; c < 3; ++c) G_wide_[part][c * stride_ + i] = part_of(gv[c], part);
        }
    }
    if (!turned.empty()) return turned_products(turned);
    for (int i = 0; i < n; ++i) pair_products<false>(i);
}

// For a dual scalar the derivative of each product: by the product rule the sum of two products of plain numbers, for a
// hyper-dual of four.
template <class T>
struct Lagrangian<T>::Products {
    Wide vv = Wide::Zero(), v_q = Wide::Zero(), q_v = Wide::Zero(), qq = Wide::Zero();

    // Of the vectors [A; B] of the row by a part, and those of the joints from j on by another.
    [[gnu::always_inline]] void add(const Lagrangian& of, const double* A, int part, int j) {
        const double* B = A + 6;
        const double *S = &of.S_wide_[part][j], *W = &of.W_wide_[part][j];
        for (int c = 0; c < 6; ++c) {
            const Wide s = Eigen::Map<const Wide>(S + c * of.stride_), w = Eigen::Map<const Wide>(W + c * of.stride_);
            vv += A[c] * s;
            v_q -= A[c] * w;
            q_v += B[c] * s;
            qq -= B[c] * w;
        }
    }
    [[gnu::always_inline]] void add_weight(const Lagrangian& of, const double* A, int part, int j) {
        const double* G = &of.G_wide_[part][j];
        for (int c = 0; c < 3; ++c) qq -= A[c] * Eigen::Map<const Wide>(G + c * of.stride_);
    }
    // Where joints are turned: of a row that is not, [A q_q; A q_v] = [A; 0], and of one that is.
    [[gnu::always_inline]] void add_weights(const Lagrangian& of, const double* A, int part, int j) {
        add_weight(of, A, part, j);
        const double* turned_G = &of.turned_G_wide_[part][j];
        for (int c = 0; c < 3; ++c) q_v -= A[c] * Eigen::Map<const Wide>(turned_G + c * of.stride_);
    }
    [[gnu::always_inline]] void add_turned_weights(const Lagrangian& of, const double* A, int part, int j) {
        const double *G = &of.G_wide_[part][j], *turned_G = &of.turned_G_wide_[part][j];
        for (int c = 0; c < 3; ++c) {
            const Wide by_q = Eigen::Map<const Wide>(G + c * of.stride_),
                       by_v = Eigen::Map<const Wide>(turned_G + c * of.stride_);
            qq -= A[c] * by_q;
            q_v -= A[c] * by_v;
            v_q -= A[3 + c] * by_q;
            vv -= A[3 + c] * by_v;
        }
    }
};

// The products of row i with all joints of its runs, `lanes` joints at a time.
template <class T>
template <bool turned>
void Lagrangian<T>::pair_products(int i)
    requires(!std::is_same_v<T, Lanes>)
{
    const std::size_t row = i * pairs.stride;
    const bool turned_row = turned && is_of_ball(mechanism_, i);
    for (const auto& [first, last] : mechanism_.runs[i]) {
        for (int j = first; j < last; j += lanes) {
            Products sum;
            for (int part = 0; part < parts; ++part) {
                const double* A = &AB_[parts - 1 - part][i * 12];
                sum.add(*this, A, part, j);
                if constexpr (!turned)
                    sum.add_weight(*this, A, part, j);
                else if (turned_row)
                    sum.add_turned_weights(*this, &turned_A_[parts - 1 - part][i * 6], part, j);
                else
                    sum.add_weights(*this, A, part, j);
            }
            Eigen::Map<Wide>(&pairs.vv[row + j]) = sum.vv;
            Eigen::Map<Wide>(&pairs.v_q[row + j]) = sum.v_q;
            Eigen::Map<Wide>(&pairs.q_v[row + j]) = sum.q_v;
            Eigen::Map<Wide>(&pairs.qq[row + j]) = sum.qq;
        }
    }
}

template <class T>
void Lagrangian<T>::turned_products(std::span<const TurnedJoints> turned)
    requires(!std::is_same_v<T, Lanes>)
{
    const int n = mechanism_.n_massive;
    for (int part = 0; part < parts; ++part) {
        turned_G_wide_[part].resize(3 * stride_);
        turned_A_[part].resize(6 * n);
    }
    own_.clear();
    for (const TurnedJoints& of : turned) {
        // W'HW with H symmetric, and of duals W'DW + F'HW + W'HF.
        SmallMatrix<6> halves = turned_rows(of, 0.5 * own_products(of.joint, false));
        if (parts > 1) halves = halves + transposed_product(*of.along, own_products(of.joint, true));
        const SmallMatrix<6> half = turned_columns(halves, of);
        own_.push_back(of.own + half + transposed(half));
        turn(of);
    }
    for (int i = 0; i < n; ++i) {
        const auto path = mechanism_.path[i];
        const bool by_itself = path.size() <= 3 && mechanism_.joints[path.front()].quaternion >= 0;
        if (by_itself) continue;
        if (i < turned.front().joint)
            pair_products<false>(i);
        else
            pair_products<true>(i);
    }
    for (std::size_t b = 0; b < turned.size(); ++b)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j) {
                const std::size_t ij = (turned[b].joint + i) * pairs.stride + turned[b].joint + j;
                pairs.qq[ij] = own_[b].aa(i, j);
                pairs.vv[ij] = own_[b].bb(i, j);
                pairs.v_q[ij] = own_[b].ba(i, j);
                pairs.q_v[ij] = own_[b].ba(j, i);
            }
}

// Second derivatives by three joints in a row, (q, v) twice: as `pairs` holds them, or of duals the values.
template <class T>
SmallMatrix<6> Lagrangian<T>::own_products(int joint, bool values) const
    requires(!std::is_same_v<T, Lanes>)
{
    using Row = SmallMatrix<3>::Row;
    struct Sums {
        Row vv{}, v_q{}, q_v{}, qq{};
    } rows[3];
    const auto load = [](const double* from, Row& to) { __builtin_memcpy(&to, from, sizeof(Row)); };
    for (int part = 0; part < (values ? 1 : parts); ++part) {
        const double* A = &AB_[values ? 0 : parts - 1 - part][joint * 12];
        for (int c = 0; c < 6; ++c) {
            Row S, W, G;
            load(&S_wide_[part][c * stride_ + joint], S);
            load(&W_wide_[part][c * stride_ + joint], W);
            for (int i = 0; i < 3; ++i) {
                const double a = A[i * 12 + c], b = A[i * 12 + 6 + c];
                rows[i].vv += a * S;
                rows[i].v_q -= a * W;
                rows[i].q_v += b * S;
                rows[i].qq -= b * W;
            }
            if (c >= 3) continue;
            load(&G_wide_[part][c * stride_ + joint], G);
            for (int i = 0; i < 3; ++i) rows[i].qq -= A[i * 12 + c] * G;
        }
    }
    const auto lower = [](const Row& x, const Row& y, const Row& z, const Row& above_y, const Row& above_z) {
        return SmallMatrix<3>{
            {Row{x[0], above_y[0], above_z[0], 0.0}, Row{y[0], y[1], above_z[1], 0.0}, Row{z[0], z[1], z[2], 0.0}}};
    };
    const auto &x = rows[0], &y = rows[1], &z = rows[2];
    const SmallMatrix<3> v_by_q = lower(x.v_q, y.v_q, z.v_q, y.q_v, z.q_v);
    return {lower(x.qq, y.qq, z.qq, y.qq, z.qq), transposed(v_by_q), v_by_q, lower(x.vv, y.vv, z.vv, y.vv, z.vv)};
}

template <class T>
void Lagrangian<T>::turn(const TurnedJoints& of)
    requires(!std::is_same_v<T, Lanes>)
{
    using Row = SmallMatrix<3>::Row;
    const int at = of.joint;
    // x and y of three joints, `apart` from each other: x v_v + y q_v, y q_q + x v_q, x q_q and x q_v.
    struct Changed {
        Row x{}, y{};
        void add(const SmallMatrix<6>& by, const double* of_x, const double* of_y, double sign, std::size_t apart) {
            for (int l = 0; l < 3; ++l) {
                const double from_x = of_x[l * apart], from_y = sign * of_y[l * apart];
                x += from_x * by.bb.rows[l];
                x += from_y * by.ab.rows[l];
                y += from_y * by.aa.rows[l];
                y += from_x * by.ba.rows[l];
            }
        }
    };
    struct Weights {
        Row q{}, v{};
        void add(const SmallMatrix<6>& by, const double* from, std::size_t apart) {
            for (int l = 0; l < 3; ++l) {
                q += from[l * apart] * by.aa.rows[l];
                v += from[l * apart] * by.ab.rows[l];
            }
        }
    };
    // Calls change(part, c, sum), sum(add) with every matrix and the part that it is times; derivatives first, of old values.
    const auto each_part = [&](const auto& change) {
        for (int part = parts - 1; part >= 0; --part)
            for (int c = 0; c < 6; ++c)
                change(part, c, [&](const auto& add) {
                    add(*of.by, part);
                    if (part > 0) add(*of.along, 0);
                });
    };
    const auto put = [](const Row& of, double* to, std::size_t apart) {
        for (int k = 0; k < 3; ++k) to[k * apart] = of[k];
    };
    const Mechanism& m = mechanism_;
    const bool has_rows_behind = at + 3 < m.n_massive && m.joints[at + 3].parent >= at;
    if (has_rows_behind)
        each_part([&](int part, int c, const auto& sum) {
            const std::size_t column = c * stride_ + at;
            Changed columns;
            Weights of_G;
            sum([&](const SmallMatrix<6>& by, int from) {
                columns.add(by, &S_wide_[from][column], &W_wide_[from][column], -1.0, 1);
                if (c < 3) of_G.add(by, &G_wide_[from][column], 1);
            });
            put(columns.x, &S_wide_[part][column], 1);
            put(-columns.y, &W_wide_[part][column], 1);
            if (c >= 3) return;
            put(of_G.q, &G_wide_[part][column], 1);
            put(of_G.v, &turned_G_wide_[part][column], 1);
        });
    const bool has_columns_before = m.path[at].size() > 1;
    if (has_columns_before)
        each_part([&](int part, int c, const auto& sum) {
            const std::size_t row = at * 12 + c, weight = at * 6 + c;
            Changed rows;
            Weights of_A;
            sum([&](const SmallMatrix<6>& by, int from) {
                rows.add(by, &AB_[from][row], &AB_[from][row + 6], 1.0, 12);
                if (c < 3) of_A.add(by, &AB_[from][row], 12);
            });
            put(rows.x, &AB_[part][row], 12);
            put(rows.y, &AB_[part][row + 6], 12);
            if (c >= 3) return;
            put(of_A.q, &turned_A_[part][weight], 6);
            put(of_A.v, &turned_A_[part][weight + 3], 6);
        });
}

template <class T>
void Lagrangian<T>::add_inertia_slope(int joint, const Inertia<double>& inertia, std::vector<double>& L_q,
                                      std::vector<double>& L_v) const
    requires std::is_same_v<T, double>
{
    const Inertia<double> I = moved(inertia, at.pose[joint]);
    const Force<double> H = I * V_[joint], weight = I * Motion<double>{mechanism_.gravity, {}};
    for (int i = joint; i >= 0; i = mechanism_.joints[i].parent) {
        const double momentum = dot(H, at.twist[i]), slope = dot(weight, at.twist[i]) - dot(H, W_[i]);
        mechanism_.joints[i].each_term([&](int variable, double factor) {
            L_v[variable] += factor * momentum;
            L_q[variable] += factor * slope;
        });
    }
}

template <class T>
void Lagrangian<T>::add_gravity_slope(const Vec3<double>& change, std::vector<double>& L_q) const
    requires std::is_same_v<T, double>
{
    for (int i = 0; i < mechanism_.n_massive; ++i) {
        const Motion<double>& S = at.twist[i];
        const double slope = m_[i] * dot(change, S.v) + dot(cross(h_[i], change), S.w);
        mechanism_.joints[i].each_term([&](int variable, double factor) { L_q[variable] += factor * slope; });
    }
}

template <class T>
T Lagrangian<T>::kinetic_energy() const {
    T twice = twice_of_rotors_;
    for (int i = 0; i < mechanism_.n_massive; ++i) twice += dot(H_own_[i], V_[i]);
    return 0.5 * twice;
}

template <class T>
T Lagrangian<T>::potential_energy() const {
    T energy(mechanism_.fixed_potential);
    for (int i = 0; i < mechanism_.n_massive; ++i) energy += T(-1.0) * dot(mechanism_.gravity, h_own_[i]);
    return energy;
}

template <class T>
double Lagrangian<T>::potential_size() const
    requires std::is_same_v<T, double>
{
    double size = std::abs(mechanism_.fixed_potential);
    for (int i = 0; i < mechanism_.n_massive; ++i) size += std::abs(dot(mechanism_.gravity, h_own_[i]));
    return size;
}

template class Lagrangian<double>;
template class Lagrangian<Dual<double>>;
template class Lagrangian<HyperDual>;
template class Lagrangian<Lanes>;

}  // namespace leastaction
