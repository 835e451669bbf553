// Which entries of G = [A B] of a stage count, and where they stand among those that do.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <vector>

#include "numerics/small_products.hpp"

namespace leastaction {

// Which rows of G = [A B] are dense, which have at most two entries, and which columns are used.
class StageStructure {
public:
    using Index = Eigen::Index;

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

    // Rows row, row + 1, ... of P G, in whole packets, of which no column before this one is read for the upper triangle of
    // G'P G: those of sparse rows of G are only read from the columns of their own entries on.
    struct Block {
        Index row;
        Index rows;
        Index column;
    };
    // What sparse rows add to products with P.
    struct Sparse {
        std::vector<Diagonal> diagonals;
        std::vector<Block> blocks;
        Index rows = 0;  // of P G, of which any are read
    };
    // A sparse row of a state whose own column is unused, if the cost does not couple it: values first, second at
    // columns (of the used ones); -1: none.
    struct Loner {
        Index row;
        std::array<Index, 2> values;
        std::array<Index, 2> columns;
    };

    StageStructure(Index nx, Index nu)
        : nx_(nx),
          nu_(nu),
          used_(nx + nu),
          left_out_(nx),
          coupled_(nx),
          position_(nx + nu),
          last_columns_(3 * nx),
          sources_(2 * nx) {
        values_.resize(2 * nx);
        sizes_.resize(nx);
        for (Index i = 0; i < 3 * nx; ++i) last_columns_[i] = i % 3 < nx + nu ? i % 3 : -1;
        for (auto* list : {&dense_, &sparse_}) list->reserve(nx);
        for (auto* list : {&dense_runs_, &inner_runs_}) list->reserve(nx);
        for (Sparse* of : {&all_, &of_used_}) {
            of->diagonals.reserve(2 * nx);
            of->blocks.reserve(nx);
        }
        loners_.reserve(nx);
        runs_.reserve(nx + nu);
    }

    const std::vector<Index>& dense() const { return dense_; }
    // Of all states, or of those alone upon which something depends.
    const std::vector<Run>& dense_runs(bool of_used = false) const { return of_used ? inner_runs_ : dense_runs_; }
    const Sparse& sparse(bool of_used = false) const { return of_used ? of_used_ : all_; }
    const std::vector<Loner>& loners() const { return loners_; }
    Eigen::VectorBlock<const Eigen::VectorXd> values(const Diagonal& of) const {
        return values_.segment(of.offset, of.length);
    }
    const std::vector<Run>& runs() const { return runs_; }
    Index columns() const { return columns_; }
    // Of state or input j: whether its column is used, and where it then stands among these.
    bool uses(Index j) const { return used_[j] != 0; }
    Index position(Index j) const { return position_[j]; }
    double value(Index e) const { return values_[e]; }
    bool trivial() const { return sparse_.empty() && columns_ == nx_ + nu_; }

    // What the cost couples to others is no loner.
    void couple(Index i) { coupled_[i] = true; }
    // A dense row of a state that neither anything depends on nor the cost: it is not read any more.
    void leave_out(Index i) { left_out_[i] = true; }

    void everything() {
        clear();
        for (Index i = 0; i < nx_; ++i) add_dense_row(i);
        used_.assign(nx_ + nu_, true);
        number_columns();
        list_blocks(all_, true);
    }

    // The structure of all stages, from which entries of [A B] may differ from zero: (nx, nx + nu), by rows.
    void follow(const bool* pattern) {
        clear();
        std::fill(used_.begin(), used_.begin() + nx_, false);
        std::fill(used_.begin() + nx_, used_.end(), true);
        const Index n = nx_ + nu_;
        for (Index i = 0; i < nx_; ++i) {
            const bool* row = pattern + i * n;
            Index* at = &last_columns_[3 * i];
            std::fill_n(at, 3, -1);
            Index count = 0;
            for (Index j = 0; j < n; ++j) {
                if (!row[j]) continue;
                used_[j] = true;
                if (count < 3) at[count] = j;
                ++count;
            }
            if (count > 2) {
                if (!left_out_[i]) add_dense_row(i);
            } else {
                sparse_.push_back(i);
            }
        }
        number_columns();
        list_entries();
    }

    void scan(const double* A, const double* B) {
        clear();
        std::fill(used_.begin(), used_.begin() + nx_, false);
        std::fill(used_.begin() + nx_, used_.end(), true);
        for (Index i = 0; i < nx_; ++i) scan_row(i, A + i * nx_, B + i * nu_);
        sizes_.setZero();
        for (const Index i : dense_) sizes_ += Eigen::Map<const Eigen::VectorXd>(A + i * nx_, nx_).cwiseAbs();
        for (Index j = 0; j < nx_; ++j) used_[j] = used_[j] || sizes_[j] != 0.0;
        number_columns();
        list_entries();
        read_entries(A, B);
    }

    // Takes the entries of sparse rows from a stage.
    void read_entries(const double* A, const double* B) {
        for (Index e = 0; e < entries_; ++e) {
            const auto [i, j] = sources_[e];
            values_[e] = j < nx_ ? A[i * nx_ + j] : B[i * nu_ + j - nx_];
        }
    }

    // Calls need(i, j, length) for the parts of rows of [A B] that are read.
    template <class Need>
    void each_part(const Need& need) const {
        for (const Index i : dense_) {
            for (const Run& run : runs_) need(i, run.first, run.length);
        }
        for (Index e = 0; e < entries_; ++e) need(sources_[e].row, sources_[e].column, Index{1});
    }

    // Calls with(i, j, value) for the entries of sparse rows.
    template <class With>
    void each_entry(const With& with) const {
        for (Index e = 0; e < entries_; ++e) with(sources_[e].row, sources_[e].column, values_[e]);
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
        for (auto* list : {&dense_runs_, &inner_runs_}) list->clear();
        sparse_.clear();
        for (Sparse* of : {&all_, &of_used_}) of->diagonals.clear();
        loners_.clear();
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
        add_to(dense_runs_, i, static_cast<Index>(dense_.size()));
        dense_.push_back(i);
    }

    static void add_to(std::vector<Run>& runs, Index i, Index offset) {
        if (runs.empty() || runs.back().first + runs.back().length != i) runs.push_back({i, 0, offset});
        ++runs.back().length;
    }

    void list_entries() {
        for (std::size_t d = 0; d < dense_.size(); ++d) {
            if (used_[dense_[d]]) add_to(inner_runs_, dense_[d], static_cast<Index>(d));
        }
        for (Index e = 0; e < 2; ++e) {
            for (const Index i : sparse_) add_entry(i, last_columns_[3 * i + e]);
        }
        list_blocks(all_, true);
        list_blocks(of_used_, false);
    }

    void add_entry(Index i, Index j) {
        if (j < 0) return;
        add_to(all_, i, position_[j]);
        if (used_[i]) {
            add_to(of_used_, i, position_[j]);
        } else if (!coupled_[i]) {
            add_to_loner(i, position_[j]);
        }
        sources_[entries_++] = {i, j};
    }

    void add_to(Sparse& of, Index i, Index column) const {
        const auto follows = [&](const Diagonal& d) {
            return d.row + d.length == i && d.column + d.length == column && d.offset + d.length == entries_;
        };
        if (of.diagonals.empty() || !follows(of.diagonals.back())) of.diagonals.push_back({i, column, 0, entries_});
        ++of.diagonals.back().length;
    }

    void add_to_loner(Index i, Index column) {
        const auto is_it = [i](const Loner& loner) { return loner.row == i; };
        const auto known = std::find_if(loners_.begin(), loners_.end(), is_it);
        if (known == loners_.end()) {
            loners_.push_back({i, {entries_, -1}, {column, -1}});
        } else {
            known->values[1] = entries_;
            known->columns[1] = column;
        }
    }

    // `whole`: of all states.
    void list_blocks(Sparse& of, bool whole) const {
        auto& blocks = of.blocks;
        blocks.clear();
        of.rows = 0;
        auto dense = dense_.begin();
        for (Index row = 0; row < nx_; row += packet_size) {
            const Index end = std::min(row + packet_size, nx_);
            bool all = false;
            for (; dense != dense_.end() && *dense < end; ++dense) all = all || whole || used_[*dense];
            const Index column = all ? 0 : first_column(row, end, whole);
            if (column < columns_) of.rows = end;
            if (!blocks.empty() && (blocks.back().column == 0) == (column == 0)) {
                blocks.back().rows = end - blocks.back().row;
                blocks.back().column = std::min(blocks.back().column, column);
            } else {
                blocks.push_back({row, end - row, column});
            }
        }
    }

    // Of the entries of these rows, all of them sparse.
    Index first_column(Index row, Index end, bool whole) const {
        Index column = columns_;
        for (Index e = 0; e < entries_; ++e) {
            const auto [i, j] = sources_[e];
            if (row <= i && i < end && (whole || used_[i])) column = std::min(column, position_[j]);
        }
        return column;
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
    std::vector<char> used_, left_out_, coupled_;
    std::vector<Index> position_;
    std::vector<Index> last_columns_;  // of up to three entries of each row; the others are -1
    std::vector<Index> dense_, sparse_;
    std::vector<Run> dense_runs_, inner_runs_, runs_;
    Sparse all_, of_used_;
    std::vector<Loner> loners_;
    struct Source {
        Index row, column;
    };
    std::vector<Source> sources_;  // of the values, in [A B]
    Eigen::VectorXd values_;
    Eigen::VectorXd sizes_;  // of the columns of A: the sums of their absolute values in dense rows
};

}  // namespace leastaction
