#include "optimal/linear_quadratic.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "numerics/small_products.hpp"
#include "optimal/outer_rows.hpp"
#include "optimal/prefetch.hpp"
#include "optimal/small_dynamics.hpp"
#include "optimal/small_recursion.hpp"
#include "optimal/stage_structure.hpp"

namespace leastaction {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstVector = Eigen::Map<const VectorXd>;
using ConstRows = Eigen::Map<const RowMajor>;

constexpr Index panel = 8;                 // columns between which memory is asked for
constexpr double pivot_tolerance = 1e-14;  // of the square of a pivot, relative to its diagonal entry of H_uu

// Regularisation: below this fraction of R an input's curvature counts as none, and after this many stages
// all earlier ones go without H (each costs an eigenvalue problem).
constexpr double curvature_floor = 1e-3;
constexpr Index max_regularized_stages = 16;

Columns columns_of(const MatrixXd& M, Index first = 0) { return {M.data() + first * M.outerStride(), M.outerStride()}; }
Target whole(MatrixXd& M) { return {M.data(), M.outerStride()}; }

// The recursion and its work space; nothing is allocated inside the loop over the stages.
class Recursion {
public:
    Recursion(const LinearQuadraticProblem& problem, const LinearQuadraticOptions& options,
              const LinearQuadraticOutput& output)
        : problem_(problem),
          options_(options),
          output_(output),
          nx_(problem.nx),
          nu_(problem.nu),
          soon_{Prefetch(nx_ * nx_), Prefetch(nx_ * nu_), Prefetch((nx_ + nu_) * (nx_ + nu_)), Prefetch(nx_ * nu_)},
          structure_(nx_, nu_),
          outer_(nx_, nu_),
          G_(MatrixXd::Zero(padded(nx_ + nu_), nx_)),
          PG_(MatrixXd::Zero(padded(nx_), nx_ + nu_)),
          GPG_(MatrixXd::Zero(padded(nx_ + nu_), nx_ + nu_)),
          P_padded_(MatrixXd::Zero(padded(nx_), nx_)),
          P_(P_padded_.topRows(nx_)),
          H_(MatrixXd::Zero(nx_ + nu_, nx_ + nu_)),
          H_uu_(nu_, nu_),
          V_(padded(nx_), nu_),
          gains_(padded(nx_), nu_),
          factor_(nu_),
          eigenvalues_(nu_),
          spectrum_(nx_),
          b_padded_(VectorXd::Zero(padded(nx_))),
          b_(b_padded_.head(nx_)),
          b_shifted_(nx_),
          h_(nx_ + nu_),
          h_used_(padded(nx_ + nu_)),
          Vw_(padded(nx_)),
          w_(nu_) {}

    LinearQuadraticReport run() {
        start();
        for (Index k = problem_.horizon - 1; k >= 0; --k) {
            const double constant = constant_;
            propagate(k);
            if (!factorize(k)) {
                if (!note_indefinite(k)) return report_;
                convexify();
                constant_ = constant;
                propagate(k);
                if (!factorize(k)) return ended(LinearQuadraticReport::Status::indefinite, k);
                use_H_ = report_.regularized_stages < max_regularized_stages;
            }
            eliminate_input();
            if (!std::isfinite(sum_of_P() + gains_.sum() + w_.sum() + b_.sum())) {
                return ended(LinearQuadraticReport::Status::not_finite, k);
            }
            if (!structure_.trivial()) ++report_.structured_stages;
            store(k);
        }
        Eigen::Map<RowMajor>(output_.P0, nx_, nx_) = P_;
        report_.constant = constant_;
        return report_;
    }

private:
    void start() {
        P_.setZero();
        if (problem_.Q_final.data != nullptr) {
            if (problem_.Q_final.diagonal) {
                P_.diagonal() = ConstVector(problem_.Q_final.data, nx_);
            } else {
                P_ = ConstRows(problem_.Q_final.data, nx_, nx_);
                mirror_upper(P_padded_, nx_);
            }
        }
        b_.setZero();
        if (problem_.q_final != nullptr) b_ = ConstVector(problem_.q_final, nx_);
        store_value(problem_.horizon);
        if (follows_pattern()) {
            structure_.follow(problem_.pattern);
        } else {
            structure_.everything();
        }
        list_needed();
        compact_ = follows_pattern() && !couples_all();
        n_states_ = compact_ ? structure_.columns() - nu_ : nx_;
        terms_.reserve(2 * nx_);
    }

    // Whether the cost may couple any states with others, and with inputs.
    bool couples_all() const {
        const auto& places = problem_.part.columns;
        const auto end = places + problem_.part.size;
        const auto is_unused = [this](Index j) { return !structure_.uses(j); };
        const bool with_inputs = problem_.part.size > 0 && end[-1] >= nx_ && std::any_of(places, end, is_unused);
        return problem_.S.data != nullptr || (problem_.Q.data != nullptr && !problem_.Q.diagonal) || with_inputs;
    }

    // Looks which rows of G count from now on, where P of states upon which nothing depends is what the cost of a stage says:
    // not those of such states that cost nothing.
    void look_at_cost() {
        const HessianPart& part = problem_.part;
        std::vector<Index> rows(part.columns, part.columns + part.size);
        if (std::all_of(rows.begin(), rows.end(), [this](Index j) { return structure_.uses(j); })) rows.clear();
        for (const Index i : rows) structure_.couple(i);
        for (const Index i : structure_.dense()) {
            if (structure_.uses(i) || std::binary_search(rows.begin(), rows.end(), i)) continue;
            if (costs_something(i)) {
                rows.insert(std::upper_bound(rows.begin(), rows.end(), i), i);
            } else {
                structure_.leave_out(i);
            }
        }
        structure_.follow(problem_.pattern);
        outer_.choose(structure_, rows);
        list_needed();
    }

    // Whether there is a diagonal weight or a gradient of state i, at any stage.
    bool costs_something(Index i) const {
        for (Index k = 0; k < problem_.horizon; ++k) {
            if (problem_.q != nullptr && problem_.q[k * nx_ + i] != 0.0) return true;
            const double* Q = problem_.Q.at(k);
            if (Q != nullptr && Q[i] != 0.0) return true;
        }
        return false;
    }

    bool follows_pattern() const { return options_.use_structure && problem_.pattern != nullptr; }

    // H (upper triangle) and h of stage k from P, b of stage k + 1.
    void propagate(Index k) {
        k_ = k;
        const double* A = problem_.A + k * nx_ * nx_;
        const double* B = problem_.B + k * nx_ * nu_;
        if (follows_pattern()) {
            structure_.read_entries(A, B);
        } else if (options_.use_structure) {
            structure_.scan(A, B);
        }
        const auto& dense = structure_.dense();
        for (std::size_t i = 0; i < dense.size(); ++i) structure_.gather_row(dense[i], A, B, G_.col(i).data());
        multiply_P(k);
        if (P_is_compact_) outer_.multiply(structure_, G_);
        multiply_PG();
        if (!compact_) spread(GPG_);
        add_cost(k);
        propagate_linear(k);
    }

    // P G, the used columns, where multiply_PG reads it. By the way it asks for what the next stage reads.
    void multiply_P(Index k) {
        const Index m = structure_.columns(), panels = (m + panel - 1) / panel;
        aim_at_stage(k - 1);
        // Whole rows of P beyond `coupled` hold nothing but their own block, and no dense row lies there.
        const auto& sparse = structure_.sparse(P_is_compact_);
        const Index end = P_is_compact_ ? sparse.rows : nx_, coupled = P_is_compact_ ? end : coupled_rows();
        for (Index j = 0; j < m; j += panel) {
            for (const auto& block : sparse.blocks) {
                const Index first = std::max(j, block.column), rows = std::min(block.rows, coupled - block.row);
                if (rows > 0) multiply_P(block.row, rows, first, std::min(j + panel, m) - first);
            }
            for (Prefetch& part : soon_) part.ask(panels);
        }
        const Index set = structure_.dense_runs(P_is_compact_).empty() ? 0 : coupled;
        PG_.block(set, 0, end - set, m).setZero();
        const Index uncoupled = structure_.dense().empty() ? 0 : structure_.dense().back() + 1;
        for (const auto& of : sparse.diagonals) {
            const auto values = structure_.values(of);
            for (Index e = 0; e < of.length; ++e) {
                const Index row = of.row + e, first = row < coupled ? 0 : uncoupled, length = end - first;
                PG_.col(of.column + e).segment(first, length) += values[e] * P_.col(row).segment(first, length);
            }
        }
    }

    // Some rows and columns of P_:D G_D.
    void multiply_P(Index row, Index rows, Index column, Index columns) {
        terms_.clear();
        for (const auto& run : structure_.dense_runs(P_is_compact_)) {
            terms_.push_back({run.length,
                              {P_padded_.col(run.first).data() + row, P_padded_.outerStride()},
                              {G_.col(run.offset).data() + column, G_.outerStride(), 1}});
        }
        each_pair([&](Into into, const Sum& of) {
            product(into, rows, columns, of, {PG_.col(column).data() + row, PG_.outerStride()});
        });
    }

    // The upper triangle of G'P G: that of neither part alone is that of a symmetric matrix.
    void multiply_PG() {
        const Index m = structure_.columns();
        terms_.clear();
        for (const auto& run : structure_.dense_runs(P_is_compact_)) {
            terms_.push_back({run.length, columns_of(G_, run.offset), {PG_.data() + run.first, 1, PG_.outerStride()}});
        }
        if (P_is_compact_) outer_.each_product(G_, [this](const Factors& of) { terms_.push_back(of); });
        if (terms_.empty()) GPG_.setZero();
        each_pair([&](Into into, const Sum& of) { upper_product(into, m, of, whole(GPG_)); });
        for (const auto& of : structure_.sparse(P_is_compact_).diagonals) {
            const auto values = structure_.values(of);
            for (Index j = of.column; j < m; ++j) {
                const Index length = std::min(of.length, j - of.column + 1);
                GPG_.col(j).segment(of.column, length) +=
                    values.head(length).cwiseProduct(PG_.col(j).segment(of.row, length));
            }
        }
        if (!P_is_compact_) return;
        add_loners();
        if (!outer_.empty()) outer_.add_entries(GPG_.topLeftCorner(m, m));
    }

    // What P holds of a state that nothing depends on is a number on the diagonal.
    void add_loners() {
        for (const auto& of : structure_.loners()) {
            const auto [i, j] = of.columns;
            const double value = structure_.value(of.values[0]), weighted = P_(of.row, of.row) * value;
            GPG_(i, i) += weighted * value;
            if (j < 0) continue;
            const double other = structure_.value(of.values[1]);
            GPG_(i, j) += weighted * other;
            GPG_(j, j) += P_(of.row, of.row) * other * other;
        }
    }

    // h: G'(b + P c) and the stage's own, which add_cost has set.
    void propagate_linear(Index k) {
        const Index m = structure_.columns();
        b_shifted_ = b_;
        if (problem_.c != nullptr) {
            const ConstVector c(problem_.c + k * nx_, nx_);
            b_shifted_.noalias() += P_ * c;
            constant_ += 0.5 * c.dot(b_ + b_shifted_);
        }
        if (structure_.dense().empty()) h_used_.setZero();
        for (const auto& run : structure_.dense_runs()) {
            product(first_set(run), m, 1, run.length, columns_of(G_, run.offset), {b_shifted_.data() + run.first, 1, 0},
                    {h_used_.data(), 0});
        }
        for (const auto& of : structure_.sparse().diagonals) {
            h_used_.segment(of.column, of.length) +=
                structure_.values(of).cwiseProduct(b_shifted_.segment(of.row, of.length));
        }
        for (const auto& run : structure_.runs()) {
            h_.segment(run.first, run.length) += h_used_.segment(run.offset, run.length);
        }
    }

    // Calls add_product(into, sum) for two of the terms at a time: the first set a product, the others add to it.
    template <class AddProduct>
    void each_pair(const AddProduct& add_product) const {
        for (std::size_t i = 0; i < terms_.size(); i += 2) {
            add_product(i == 0 ? Into::set : Into::add,
                        Sum{terms_[i], i + 1 < terms_.size() ? terms_[i + 1] : Factors{}});
        }
    }

    // The first run of dense rows sets a product, the others add to it.
    static Into first_set(const StageStructure::Run& run) { return run.offset == 0 ? Into::set : Into::add; }

    // The arrays of a stage come from main memory, so they are asked for while the one after it is computed.
    void aim_at_stage(Index k) {
        soon_[0].aim(k < 0 ? nullptr : problem_.A + k * nx_ * nx_);
        soon_[1].aim(k < 0 ? nullptr : problem_.B + k * nx_ * nu_);
        soon_[3].aim(k < 0 ? nullptr : output_.K + k * nu_ * nx_);
        soon_[2].aim(k < 0 || problem_.H == nullptr || !use_H_ ? nullptr : hessian(k));
    }

    const double* hessian(Index k) const {
        const Index n = nx_ + nu_, m = structure_.columns();
        return problem_.H + k * (problem_.packed ? m * (m + 1) / 2 : n * n);
    }

    // Of these arrays, what is read.
    void list_needed() {
        const Index n = nx_ + nu_;
        auto& [A, B, H, K] = soon_;
        H.nothing();
        if (problem_.packed) {
            H.need(0, structure_.columns() * (structure_.columns() + 1) / 2);
        } else {
            for (Index j = 0; j < n; ++j) {
                for (const auto& run : structure_.runs()) {
                    H.need(j * n + run.first, std::min(run.length, j + 1 - run.first));
                }
            }
        }
        H.list();
        if (!follows_pattern()) return;
        need_dynamics(structure_, nx_, nu_, A, B);
    }

    Index coupled_rows() const {
        Index coupled = nx_;
        if (structure_.dense().empty()) return 0;
        const Index last_dense = structure_.dense().back();
        while (coupled - 1 > last_dense && P_.col(coupled - 1).head(last_dense + 1).cwiseAbs().sum() == 0.0) --coupled;
        return coupled;
    }

    // Upper triangle of H_ from that of the used columns.
    void spread(const MatrixXd& used) {
        Index next = 0;
        const auto skip = [&](Index to) {
            for (; next < to; ++next) H_.col(next).head(next + 1).setZero();
        };
        for (const auto& from : structure_.runs()) {
            skip(from.first);
            for (Index j = 0; j < from.length; ++j, ++next) {
                Index row = 0;
                for (const auto& to : structure_.runs()) {
                    if (to.first > from.first) break;
                    const Index length = to.first == from.first ? j + 1 : to.length;
                    H_.col(next).segment(row, to.first - row).setZero();
                    H_.col(next).segment(to.first, length) = used.col(from.offset + j).segment(to.offset, length);
                    row = to.first + length;
                }
            }
        }
        skip(nx_ + nu_);
    }

    // The second derivatives of the stage, upper triangle: of all states and inputs, or of those alone that the next state
    // depends on, the inputs last. The cost couples nothing to other states then.
    MatrixXd& model() { return compact_ ? GPG_ : H_; }

    // Calls with(first, length, offset) for the states whose entries stand at offset, offset + 1, ... of the model.
    template <class With>
    void each_states(const With& with) const {
        if (!compact_) return with(Index{0}, nx_, Index{0});
        for (const auto& run : structure_.runs()) {
            const Index length = std::min(run.length, nx_ - run.first);
            if (length > 0) with(run.first, length, run.offset);
        }
    }

    // The stage's own cost: onto the model, and h_.
    void add_cost(Index k) {
        if (problem_.H != nullptr && use_H_) add_hessian(hessian(k));
        if (const double* Q = problem_.Q.at(k)) {
            each_states([&](Index first, Index length, Index offset) {
                add_block(Q, problem_.Q.diagonal, first, length, offset);
            });
        }
        if (const double* R = problem_.R.at(k)) add_block(R, problem_.R.diagonal, 0, nu_, n_states_);
        if (const double* S = problem_.S.at(k)) H_.topRightCorner(nx_, nu_) += ConstRows(S, nx_, nu_);
        add_part(k);
        h_.setZero();
        if (problem_.q != nullptr) h_.head(nx_) = ConstVector(problem_.q + k * nx_, nx_);
        if (problem_.r != nullptr) h_.tail(nu_) = ConstVector(problem_.r + k * nu_, nu_);
    }

    void add_part(Index k) {
        each_of_part(k, [this](Index i, Index j, double value) {
            if (!compact_) {
                H_(i, j) += value;
            } else if (structure_.uses(i) && structure_.uses(j)) {
                GPG_(structure_.position(i), structure_.position(j)) += value;
            }
        });
    }

    // Calls with(i, j, value) for the entries (i, j), i <= j, of the part of a stage.
    template <class With>
    void each_of_part(Index k, const With& with) const {
        const HessianPart& part = problem_.part;
        const double* row = part.data + k * part.size * part.size;
        for (Index j = 0; j < part.size; ++j, row += part.size) {
            for (Index i = 0; i <= j; ++i) with(part.columns[i], part.columns[j], row[i]);
        }
    }

    void add_hessian(const double* H) {
        const Index n = nx_ + nu_;
        if (!follows_pattern()) {
            for (Index j = 0; j < n; ++j) H_.col(j).head(j + 1) += problem_.H_scale * ConstVector(H + j * n, j + 1);
            return;
        }
        const auto place = [this](const StageStructure::Run& run) { return compact_ ? run.offset : run.first; };
        for (const auto& of : structure_.runs()) {
            for (Index j = 0; j < of.length; ++j) {
                const Index row = of.offset + j;  // of a packed one
                const double* H_j = H + (problem_.packed ? row * (row + 1) / 2 : (of.first + j) * n);
                for (const auto& run : structure_.runs()) {
                    const Index length = std::min(run.length, of.first + j + 1 - run.first);
                    if (length <= 0) break;
                    model().col(place(of) + j).segment(place(run), length) +=
                        problem_.H_scale * ConstVector(H_j + (problem_.packed ? run.offset : run.first), length);
                }
            }
        }
    }

    // Entries from `first` on of a block of the cost, to where they stand in the model; a matrix is added as a whole.
    void add_block(const double* data, bool diagonal, Index first, Index size, Index offset) {
        if (diagonal) {
            model().diagonal().segment(offset, size) += ConstVector(data + first, size);
        } else {
            model().block(offset, offset, size, size).triangularView<Eigen::Upper>() += ConstRows(data, size, size);
        }
    }

    // The Cholesky factor of H_uu; false if it is not positive definite, or not by much.
    bool factorize(Index k) {
        H_uu_ = model().block(n_states_, n_states_, nu_, nu_).transpose();  // lower triangle
        factor_.compute(H_uu_);
        if (factor_.info() != Eigen::Success) return false;
        const auto pivots = factor_.matrixLLT().diagonal().array();
        // Each against its own entry: inputs may be of any units. Written so that a NaN fails too.
        if (!(pivots.square() > pivot_tolerance * H_uu_.diagonal().array()).all()) return false;
        const double* R = problem_.R.at(k);
        if (!options_.regularize || R == nullptr) return true;
        const Index next = problem_.R.diagonal ? 1 : nu_ + 1;
        for (Index i = 0; i < nu_; ++i) {
            if (pivots[i] * pivots[i] < curvature_floor * R[i * next]) return false;
        }
        return true;
    }

    // Reports the stage; false if the recursion must end there.
    bool note_indefinite(Index k) {
        if (!H_uu_.allFinite()) {
            ended(LinearQuadraticReport::Status::not_finite, k);
            return false;
        }
        if (report_.stage < 0) {
            eigenvalues_.compute(H_uu_, Eigen::EigenvaluesOnly);
            report_.smallest_eigenvalue = eigenvalues_.eigenvalues()[0];
            report_.stage = k;
        }
        if (!options_.regularize) {
            ended(LinearQuadraticReport::Status::indefinite, k);
            return false;
        }
        ++report_.regularized_stages;
        return true;
    }

    // P becomes its positive semidefinite part, and the stage's H is left out.
    void convexify() {
        use_H_ = false;
        P_is_compact_ = false;
        spectrum_.compute(P_);
        const VectorXd& values = spectrum_.eigenvalues();
        if (values[0] >= 0.0) return;
        report_.largest_change = std::max(report_.largest_change, -values[0]);
        const MatrixXd& vectors = spectrum_.eigenvectors();
        P_.noalias() = vectors * values.cwiseMax(0.0).asDiagonal() * vectors.transpose();
        mirror_upper(P_padded_, nx_);
    }

    // K, C, P, b of the stage.
    void eliminate_input() {
        // Trailing states with a zero row in H_xu (no influence on anything) are left out.
        MatrixXd& H = model();
        Index active = n_states_;
        while (active > 0 && (H.row(active - 1).segment(n_states_, nu_).array() == 0.0).all()) --active;

        // V = H_xu L^-T and K' = V L^-1; the rows of V that are left out must be numbers too.
        const Columns L = columns_of(factor_.matrixLLT());
        V_.topRows(active) = H.block(0, n_states_, active, nu_);
        V_.bottomRows(V_.rows() - active).setZero();
        solve_lower_transposed(active, nu_, L, whole(V_));
        gains_ = V_;
        solve_lower(active, nu_, L, whole(gains_));
        w_ = h_.tail(nu_);
        factor_.matrixL().solveInPlace(w_);

        const Columns V = columns_of(V_);
        if (compact_) {
            upper_product(Into::subtract, active, nu_, V, {V.data, V.stride, 1}, whole(H));
            mirror_upper(H, n_states_);
            spread_P();
        } else {
            P_ = H.topLeftCorner(nx_, nx_);
            upper_product(Into::subtract, active, nu_, V, {V.data, V.stride, 1}, whole(P_padded_));
            mirror_upper(P_padded_, nx_);
        }
        product(Into::set, active, 1, nu_, V, {w_.data(), 1, 0}, {Vw_.data(), 0});
        Vw_.tail(Vw_.size() - active).setZero();
        b_ = h_.head(nx_);
        each_states(
            [&](Index first, Index length, Index offset) { b_.segment(first, length) -= Vw_.segment(offset, length); });
        constant_ -= 0.5 * w_.squaredNorm();
        factor_.matrixU().solveInPlace(w_);
    }

    // Of all that was computed: the upper triangle.
    double sum_of_P() {
        const MatrixXd& P = compact_ ? GPG_ : P_padded_;
        auto sums = h_used_.head(n_states_);
        sums.setZero();
        for (Index j = 0; j < n_states_; ++j) sums.head(j + 1) += P.col(j).head(j + 1);
        return sums.sum() + (compact_ ? outer_.sum() : 0.0);
    }

    // P from that of the states that the model is of; of the others, upon which nothing depends, there is the cost alone.
    void spread_P() {
        if (!looked_) look_at_cost();
        looked_ = true;
        if (!P_is_compact_) P_.setZero();
        P_is_compact_ = true;
        const double* Q = problem_.Q.at(k_);
        if (Q != nullptr) P_.diagonal() = ConstVector(Q, nx_);
        each_states([&](Index from, Index width, Index at) {
            each_states([&](Index to, Index height, Index below) {
                P_.block(to, from, height, width) = GPG_.block(below, at, height, width);
            });
        });
        if (outer_.empty()) return;
        each_of_part(k_, [&](Index i, Index j, double value) {
            if (structure_.uses(i) && structure_.uses(j)) return;
            P_(i, j) = P_(j, i) = i == j && Q != nullptr ? Q[i] + value : value;
        });
        outer_.take(P_);
    }

    LinearQuadraticReport ended(LinearQuadraticReport::Status status, Index k) {
        report_.status = status;
        report_.stage = k;
        return report_;
    }

    void store(Index k) {
        Eigen::Map<MatrixXd> K(output_.K + k * nu_ * nx_, nx_, nu_);  // K' by columns: K by rows
        Index next = 0;
        each_states([&](Index first, Index length, Index offset) {
            K.middleRows(next, first - next).setZero();
            K.middleRows(first, length) = gains_.middleRows(offset, length);
            next = first + length;
        });
        K.bottomRows(nx_ - next).setZero();
        Eigen::Map<VectorXd>(output_.C + k * nu_, nu_) = w_;
        if (output_.L_all != nullptr) {
            Eigen::Map<RowMajor>(output_.L_all + k * nu_ * nu_, nu_, nu_) = factor_.matrixL();
        }
        store_value(k);
    }

    void store_value(Index k) {
        Eigen::Map<VectorXd>(output_.b + k * nx_, nx_) = b_;
        if (output_.P_all != nullptr) {
            Eigen::Map<RowMajor>(output_.P_all + k * nx_ * nx_, nx_, nx_) = P_;
        }
    }

    const LinearQuadraticProblem& problem_;
    const LinearQuadraticOptions& options_;
    const LinearQuadraticOutput& output_;
    LinearQuadraticReport report_;
    Index nx_, nu_;
    double constant_ = 0.0;
    Index k_ = 0;  // the stage
    bool use_H_ = true;
    bool compact_ = false;          // whether the model is of those states alone that the next ones depend on
    bool P_is_compact_ = false;     // whether of the others P is what the cost says
    bool looked_ = false;           // whether look_at_cost was called
    Index n_states_ = 0;            // of the model
    std::array<Prefetch, 4> soon_;  // of A, B, H, K
    StageStructure structure_;
    OuterRows outer_;
    std::vector<Factors> terms_;  // of a product
    // Column i of G_ holds the used columns of row dense[i] of G; PG_ and GPG_ have the used columns only.
    MatrixXd G_, PG_, GPG_, P_padded_;
    Eigen::Ref<MatrixXd> P_;
    MatrixXd H_, H_uu_, V_, gains_;
    Eigen::LLT<MatrixXd> factor_;
    Eigen::SelfAdjointEigenSolver<MatrixXd> eigenvalues_, spectrum_;
    VectorXd b_padded_;
    Eigen::Ref<VectorXd> b_;
    VectorXd b_shifted_, h_, h_used_, Vw_, w_;
};

template <int width>
LinearQuadraticReport solve_small(const LinearQuadraticProblem& problem, const LinearQuadraticOutput& output) {
    MatrixXd H_uu;
    LinearQuadraticReport report = SmallRecursion<width>(problem, output, pivot_tolerance).run(H_uu);
    if (report.status == LinearQuadraticReport::Status::indefinite) {
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigenvalues(H_uu, Eigen::EigenvaluesOnly);
        report.smallest_eigenvalue = eigenvalues.eigenvalues()[0];
    }
    return report;
}

}  // namespace

LinearQuadraticReport solve_linear_quadratic(const LinearQuadraticProblem& problem,
                                             const LinearQuadraticOptions& options,
                                             const LinearQuadraticOutput& output) {
    if (!options.regularize && is_small(problem)) {
        return with_width(problem, [&](auto width) { return solve_small<width>(problem, output); });
    }
    return Recursion(problem, options, output).run();
}

}  // namespace leastaction
