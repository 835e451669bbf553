#include "optimal/linear_quadratic.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "numerics/small_products.hpp"

namespace leastaction {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstVector = Eigen::Map<const VectorXd>;
using ConstRows = Eigen::Map<const RowMajor>;

constexpr Index panel = 16;                // columns between which memory is asked for
constexpr double pivot_tolerance = 1e-14;  // of the square of a pivot, relative to its diagonal entry of H_uu

// Regularisation: below this fraction of R an input's curvature counts as none, and after this many stages
// all earlier ones go without H (each costs an eigenvalue problem).
constexpr double curvature_floor = 1e-3;
constexpr Index max_regularized_stages = 16;

Columns columns_of(const MatrixXd& M, Index first = 0) { return {M.col(first).data(), M.outerStride()}; }
Target whole(MatrixXd& M) { return {M.data(), M.outerStride()}; }

// Asks for numbers that are needed soon, a line of the cache at a time.
class Prefetch {
public:
    void aim(const double* data, Index size) {
        next_ = data;
        lines_ = (size + line - 1) / line;
    }

    void ask(Index lines) {
        for (lines = std::min(lines, lines_); lines > 0; --lines, --lines_, next_ += line) {
            Eigen::internal::prefetch(next_);
        }
    }

private:
    static constexpr Index line = 8;  // numbers
    const double* next_ = nullptr;
    Index lines_ = 0;
};

// Of a square matrix, with padding below.
void mirror_upper(MatrixXd& M) {
    constexpr Index tile = 4;
    const Index n = M.cols(), whole = n - n % tile;
    for (Index j = 0; j < whole; j += tile) {
        for (Index i = 0; i < j; i += tile) {
            const Eigen::Matrix4d block = M.block<tile, tile>(i, j);
            M.block<tile, tile>(j, i) = block.transpose();
        }
    }
    for (Index j = 0; j < n; ++j) {
        for (Index i = j < whole ? j - j % tile : 0; i < j; ++i) M(j, i) = M(i, j);
    }
}

// Which rows of G = [A B] are dense, which have at most two entries, and which columns are used.
class StageStructure {
public:
    // Neighbours: indices first, first + 1, ... stand at positions offset, offset + 1, ...
    struct Run {
        Index first;
        Index length;
        Index offset;
    };
    // Entries of sparse rows that are neighbours along a diagonal: values offset, offset + 1, ... stand at (row, column),
    // (row + 1, column + 1), ...; columns are counted among the used ones.
    struct Diagonal {
        Index row;
        Index column;
        Index length;
        Index offset;
    };

    StageStructure(Index nx, Index nu) : nx_(nx), nu_(nu), used_(nx + nu), position_(nx + nu), last_columns_(3 * nx) {
        values_.resize(2 * nx);
        sizes_.resize(nx);
        for (Index i = 0; i < 3 * nx; ++i) last_columns_[i] = i % 3 < nx + nu ? i % 3 : -1;
        for (auto* list : {&dense_, &sparse_}) list->reserve(nx);
        dense_runs_.reserve(nx);
        diagonals_.reserve(2 * nx);
        runs_.reserve(nx + nu);
    }

    const std::vector<Index>& dense() const { return dense_; }
    const std::vector<Run>& dense_runs() const { return dense_runs_; }
    const std::vector<Diagonal>& diagonals() const { return diagonals_; }
    Eigen::VectorBlock<const VectorXd> values(const Diagonal& of) const {
        return values_.segment(of.offset, of.length);
    }
    const std::vector<Run>& runs() const { return runs_; }
    Index columns() const { return columns_; }
    bool trivial() const { return sparse_.empty() && columns_ == nx_ + nu_; }

    void everything() {
        clear();
        for (Index i = 0; i < nx_; ++i) add_dense_row(i);
        used_.assign(nx_ + nu_, true);
        number_columns();
    }

    void scan(const double* A, const double* B) {
        clear();
        std::fill(used_.begin(), used_.begin() + nx_, false);
        std::fill(used_.begin() + nx_, used_.end(), true);
        for (Index i = 0; i < nx_; ++i) scan_row(i, A + i * nx_, B + i * nu_);
        sizes_.setZero();
        for (const Index i : dense_) sizes_ += Eigen::Map<const VectorXd>(A + i * nx_, nx_).cwiseAbs();
        for (Index j = 0; j < nx_; ++j) used_[j] = used_[j] || sizes_[j] != 0.0;
        number_columns();
        for (Index e = 0; e < 2; ++e) {
            for (const Index i : sparse_) add_entry(i, last_columns_[3 * i + e], A, B);
        }
    }

    // Copies the used columns of row i of [A B].
    void gather_row(Index i, const double* A, const double* B, double* out) const {
        for (const Run& run : runs_) {
            const Index in_A = std::clamp(nx_ - run.first, Index{0}, run.length);
            std::copy_n(A + i * nx_ + run.first, in_A, out + run.offset);
            if (in_A == run.length) continue;
            const Index first_in_B = run.first + in_A - nx_;
            std::copy_n(B + i * nu_ + first_in_B, run.length - in_A, out + run.offset + in_A);
        }
    }

private:
    void clear() {
        dense_.clear();
        dense_runs_.clear();
        sparse_.clear();
        diagonals_.clear();
        entries_ = 0;
    }

    void scan_row(Index i, const double* a, const double* b) {
        // The pattern rarely changes from stage to stage: look first where three entries were last time.
        Index* at = &last_columns_[3 * i];
        const auto entry = [this, a, b](Index j) { return j < 0 ? 0.0 : j < nx_ ? a[j] : b[j - nx_]; };
        if (entry(at[0]) != 0.0 && entry(at[1]) != 0.0 && entry(at[2]) != 0.0) return add_dense_row(i);
        const Index count = count_entries(a, nx_) + count_entries(b, nu_);
        Index known = 0;
        while (known < 3 && entry(at[known]) != 0.0) ++known;
        if (known != count) {
            Index e = 0;
            for (Index j = 0; e < std::min(count, Index{3}); ++j) {
                if (entry(j) != 0.0) at[e++] = j;
            }
            while (e < 3) at[e++] = -1;
        }
        if (count > 2) return add_dense_row(i);
        sparse_.push_back(i);
        for (Index e = 0; e < count; ++e) used_[at[e]] = true;
    }

    static Index count_entries(const double* row, Index size) {
        Index count = 0;
        for (Index j = 0; j < size; ++j) count += row[j] != 0.0 ? 1 : 0;
        return count;
    }

    void add_dense_row(Index i) {
        if (dense_.empty() || dense_.back() + 1 != i) {
            dense_runs_.push_back({i, 0, static_cast<Index>(dense_.size())});
        }
        ++dense_runs_.back().length;
        dense_.push_back(i);
    }

    void add_entry(Index i, Index j, const double* A, const double* B) {
        if (j < 0) return;
        const Index column = position_[j];
        const auto follows = [&](const Diagonal& d) { return d.row + d.length == i && d.column + d.length == column; };
        if (diagonals_.empty() || !follows(diagonals_.back())) diagonals_.push_back({i, column, 0, entries_});
        ++diagonals_.back().length;
        values_[entries_++] = j < nx_ ? A[i * nx_ + j] : B[i * nu_ + j - nx_];
    }

    void number_columns() {
        runs_.clear();
        columns_ = 0;
        for (Index j = 0; j < nx_ + nu_; ++j) {
            if (!used_[j]) continue;
            if (runs_.empty() || runs_.back().first + runs_.back().length != j) {
                runs_.push_back({j, 0, columns_});
            }
            ++runs_.back().length;
            position_[j] = columns_++;
        }
    }

    Index nx_, nu_;
    Index columns_ = 0, entries_ = 0;
    std::vector<char> used_;
    std::vector<Index> position_;
    std::vector<Index> last_columns_;  // of up to three entries of each row; the others are -1
    std::vector<Index> dense_, sparse_;
    std::vector<Run> dense_runs_, runs_;
    std::vector<Diagonal> diagonals_;
    VectorXd values_;
    VectorXd sizes_;  // of the columns of A: the sums of their absolute values in dense rows
};

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
          lines_a_panel_(panel * (nx_ + nu_) / 8),
          structure_(nx_, nu_),
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
            if (!std::isfinite(P_.sum() + gains_.sum() + w_.sum() + b_.sum())) {
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
                mirror_upper(P_padded_);
            }
        }
        b_.setZero();
        if (problem_.q_final != nullptr) b_ = ConstVector(problem_.q_final, nx_);
        store_value(problem_.horizon);
        if (!options_.use_structure) structure_.everything();
    }

    // H (upper triangle) and h of stage k from P, b of stage k + 1.
    void propagate(Index k) {
        const double* A = problem_.A + k * nx_ * nx_;
        const double* B = problem_.B + k * nx_ * nu_;
        if (options_.use_structure) structure_.scan(A, B);
        const auto& dense = structure_.dense();
        for (std::size_t i = 0; i < dense.size(); ++i) structure_.gather_row(dense[i], A, B, G_.col(i).data());
        multiply_P(k);
        multiply_PG();
        spread(GPG_);
        add_cost(k);
        propagate_linear(k);
    }

    // P G, the used columns. By the way it asks for what the next stage reads.
    void multiply_P(Index k) {
        const Index m = structure_.columns();
        aim_at_stage(k - 1);
        // Rows of P beyond `coupled` hold nothing but their own block, and no dense row lies there.
        const Index coupled = coupled_rows();
        for (Index j = 0; j < m; j += panel) {
            for (const auto& run : structure_.dense_runs()) {
                product(first_set(run), coupled, std::min(panel, m - j), run.length, columns_of(P_padded_, run.first),
                        {G_.col(run.offset).data() + j, G_.outerStride(), 1}, {PG_.col(j).data(), PG_.outerStride()});
            }
            for (Prefetch& part : soon_) part.ask(lines_a_panel_);
        }
        PG_.block(coupled, 0, nx_ - coupled, m).setZero();
        for (const auto& of : structure_.diagonals()) {
            const auto values = structure_.values(of);
            for (Index e = 0; e < of.length; ++e) PG_.col(of.column + e).head(nx_) += values[e] * P_.col(of.row + e);
        }
    }

    // The upper triangle of G'P G: that of neither part alone is that of a symmetric matrix.
    void multiply_PG() {
        const Index m = structure_.columns();
        if (structure_.dense().empty()) GPG_.setZero();
        for (const auto& run : structure_.dense_runs()) {
            upper_product(first_set(run), m, run.length, columns_of(G_, run.offset),
                          {PG_.data() + run.first, 1, PG_.outerStride()}, whole(GPG_));
        }
        for (const auto& of : structure_.diagonals()) {
            const auto values = structure_.values(of);
            for (Index j = of.column; j < m; ++j) {
                const Index length = std::min(of.length, j - of.column + 1);
                GPG_.col(j).segment(of.column, length) +=
                    values.head(length).cwiseProduct(PG_.col(j).segment(of.row, length));
            }
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
        for (const auto& of : structure_.diagonals()) {
            h_used_.segment(of.column, of.length) +=
                structure_.values(of).cwiseProduct(b_shifted_.segment(of.row, of.length));
        }
        for (const auto& run : structure_.runs()) {
            h_.segment(run.first, run.length) += h_used_.segment(run.offset, run.length);
        }
    }

    // The first run of dense rows sets a product, the others add to it.
    static Into first_set(const StageStructure::Run& run) { return run.offset == 0 ? Into::set : Into::add; }

    // The arrays of a stage come from main memory, so they are asked for while the one after it is computed.
    void aim_at_stage(Index k) {
        if (k < 0) return;
        soon_[0].aim(problem_.A + k * nx_ * nx_, nx_ * nx_);
        soon_[1].aim(problem_.B + k * nx_ * nu_, nx_ * nu_);
        const Index n = nx_ + nu_;
        if (problem_.H != nullptr && use_H_) soon_[2].aim(problem_.H + k * n * n, n * n);
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

    // The stage's own cost: onto the upper triangle of H_, and h_.
    void add_cost(Index k) {
        const Index n = nx_ + nu_;
        if (problem_.H != nullptr && use_H_) {
            const double* H = problem_.H + k * n * n;
            for (Index j = 0; j < n; ++j) {
                H_.col(j).head(j + 1) += problem_.H_scale * ConstVector(H + j * n, j + 1);
            }
        }
        add_block(problem_.Q, k, 0, nx_);
        add_block(problem_.R, k, nx_, nu_);
        if (const double* S = problem_.S.at(k)) {
            H_.topRightCorner(nx_, nu_) += ConstRows(S, nx_, nu_);
        }
        add_part(k);
        h_.setZero();
        if (problem_.q != nullptr) h_.head(nx_) = ConstVector(problem_.q + k * nx_, nx_);
        if (problem_.r != nullptr) h_.tail(nu_) = ConstVector(problem_.r + k * nu_, nu_);
    }

    void add_part(Index k) {
        const HessianPart& part = problem_.part;
        const double* row = part.data + k * part.size * part.size;
        for (Index j = 0; j < part.size; ++j, row += part.size) {
            double* column = H_.col(part.columns[j]).data();
            for (Index i = 0; i <= j; ++i) column[part.columns[i]] += row[i];
        }
    }

    void add_block(const HessianBlock& block, Index k, Index first, Index size) {
        const double* data = block.at(k);
        if (data == nullptr) return;
        if (block.diagonal) {
            H_.diagonal().segment(first, size) += ConstVector(data, size);
        } else {
            H_.block(first, first, size, size).triangularView<Eigen::Upper>() += ConstRows(data, size, size);
        }
    }

    // The Cholesky factor of H_uu; false if it is not positive definite, or not by much.
    bool factorize(Index k) {
        H_uu_ = H_.bottomRightCorner(nu_, nu_).transpose();  // lower triangle
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
        spectrum_.compute(P_);
        const VectorXd& values = spectrum_.eigenvalues();
        if (values[0] >= 0.0) return;
        report_.largest_change = std::max(report_.largest_change, -values[0]);
        const MatrixXd& vectors = spectrum_.eigenvectors();
        P_.noalias() = vectors * values.cwiseMax(0.0).asDiagonal() * vectors.transpose();
        mirror_upper(P_padded_);
    }

    // K, C, P, b of the stage.
    void eliminate_input() {
        // Trailing states with a zero row in H_xu (no influence on anything) are left out.
        Index active = nx_;
        while (active > 0 && (H_.row(active - 1).tail(nu_).array() == 0.0).all()) --active;

        // V = H_xu L^-T and K' = V L^-1; the rows of V that are left out must be numbers too.
        const Columns L = columns_of(factor_.matrixLLT());
        V_.topRows(active) = H_.topRightCorner(active, nu_);
        V_.bottomRows(V_.rows() - active).setZero();
        solve_lower_transposed(active, nu_, L, whole(V_));
        gains_ = V_;
        solve_lower(active, nu_, L, whole(gains_));
        w_ = h_.tail(nu_);
        factor_.matrixL().solveInPlace(w_);

        P_ = H_.topLeftCorner(nx_, nx_);
        const Columns V = columns_of(V_);
        upper_product(Into::subtract, active, nu_, V, {V.data, V.stride, 1}, whole(P_padded_));
        mirror_upper(P_padded_);
        b_ = h_.head(nx_);
        product(Into::subtract, active, 1, nu_, V, {w_.data(), 1, 0}, {b_padded_.data(), 0});
        constant_ -= 0.5 * w_.squaredNorm();
        factor_.matrixU().solveInPlace(w_);
    }

    LinearQuadraticReport ended(LinearQuadraticReport::Status status, Index k) {
        report_.status = status;
        report_.stage = k;
        return report_;
    }

    void store(Index k) {
        Eigen::Map<MatrixXd>(output_.K + k * nu_ * nx_, nx_, nu_) = gains_.topRows(nx_);  // K' by columns: K by rows
        Eigen::Map<VectorXd>(output_.C + k * nu_, nu_) = w_;
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
    bool use_H_ = true;
    std::array<Prefetch, 3> soon_;  // of A, B, H
    Index lines_a_panel_;
    StageStructure structure_;
    // Column i of G_ holds the used columns of row dense[i] of G; PG_ and GPG_ have the used columns only.
    MatrixXd G_, PG_, GPG_, P_padded_;
    Eigen::Ref<MatrixXd> P_;
    MatrixXd H_, H_uu_, V_, gains_;
    Eigen::LLT<MatrixXd> factor_;
    Eigen::SelfAdjointEigenSolver<MatrixXd> eigenvalues_, spectrum_;
    VectorXd b_padded_;
    Eigen::Ref<VectorXd> b_;
    VectorXd b_shifted_, h_, h_used_, w_;
};

}  // namespace

LinearQuadraticReport solve_linear_quadratic(const LinearQuadraticProblem& problem,
                                             const LinearQuadraticOptions& options,
                                             const LinearQuadraticOutput& output) {
    return Recursion(problem, options, output).run();
}

void sweep_forward(const LinearQuadraticProblem& problem, const double* K, const double* C, double* dx, double* du) {
    const Index nx = problem.nx;
    const Index nu = problem.nu;
    for (Index k = 0; k < problem.horizon; ++k) {
        const ConstVector x(dx + k * nx, nx);
        Eigen::Map<VectorXd> u(du + k * nu, nu);
        Eigen::Map<VectorXd> next(dx + (k + 1) * nx, nx);
        u = -ConstVector(C + k * nu, nu);
        u.noalias() -= ConstRows(K + k * nu * nx, nu, nx) * x;
        next.setZero();
        if (problem.c != nullptr) next = ConstVector(problem.c + k * nx, nx);
        next.noalias() += ConstRows(problem.A + k * nx * nx, nx, nx) * x;
        next.noalias() += ConstRows(problem.B + k * nx * nu, nx, nu) * u;
    }
}

void sweep_adjoint(const LinearQuadraticProblem& problem, const double* K, double* z) {
    const Index nx = problem.nx;
    const Index nu = problem.nu;
    VectorXd input(nu);
    Eigen::Map<VectorXd> last(z + problem.horizon * nx, nx);
    last.setZero();
    if (problem.q_final != nullptr) last = ConstVector(problem.q_final, nx);
    for (Index k = problem.horizon - 1; k >= 0; --k) {
        const ConstVector next(z + (k + 1) * nx, nx);
        Eigen::Map<VectorXd> now(z + k * nx, nx);
        now.setZero();
        if (problem.q != nullptr) now = ConstVector(problem.q + k * nx, nx);
        input.setZero();
        if (problem.r != nullptr) input = ConstVector(problem.r + k * nu, nu);
        input.noalias() += ConstRows(problem.B + k * nx * nu, nx, nu).transpose() * next;
        now.noalias() += ConstRows(problem.A + k * nx * nx, nx, nx).transpose() * next;
        now.noalias() -= ConstRows(K + k * nu * nx, nu, nx).transpose() * input;
    }
}

}  // namespace leastaction
