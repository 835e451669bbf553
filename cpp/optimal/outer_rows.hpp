// What rows of G = [A B] add to G'P G that lead to states upon which nothing depends.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "numerics/small_products.hpp"
#include "optimal/stage_structure.hpp"

namespace leastaction {

// P of states upon which nothing depends is what the cost says of them, which may couple a few states F. So with M, the
// entries of P of F that belong to one such state at least,
//
//   G'P G = (of all other states) + G_F' W      W = M G_F
//
// where a row of F that is sparse in G, as most are, adds its entries one by one.
class OuterRows {
public:
    using Index = Eigen::Index;
    using MatrixXd = Eigen::MatrixXd;

    OuterRows(Index nx, Index nu) : place_(nx, -1), W_(padded(nx), nx + nu) {
        for (auto* list : {&rows_, &outer_}) list->reserve(nx);
        runs_.reserve(nx);
        entries_.reserve(2 * nx);
        M_.resize(padded(nx), nx);
    }

    // Begins with rows F, ascending, of a structure; `outer` are those of states upon which nothing depends.
    void choose(const StageStructure& structure, const std::vector<Index>& rows) {
        rows_ = rows;
        std::fill(place_.begin(), place_.end(), -1);
        runs_.clear();
        outer_.clear();
        for (std::size_t f = 0; f < rows_.size(); ++f) {
            const Index i = rows_[f], place = static_cast<Index>(f);
            place_[i] = place;
            if (!structure.uses(i)) outer_.push_back(place);
            const auto& dense = structure.dense();
            const auto at = std::lower_bound(dense.begin(), dense.end(), i);
            if (at != dense.end() && *at == i) add_dense(place, at - dense.begin());
        }
        M_.setZero();
    }

    bool empty() const { return rows_.empty(); }

    // Takes M from P, of which it is all that counts.
    void take(const Eigen::Ref<MatrixXd>& P) {
        for (const Index g : outer_) {
            for (Index f = 0; f < size(); ++f) M_(f, g) = M_(g, f) = P(rows_[f], rows_[g]);
        }
    }
    double sum() const { return M_.leftCols(size()).sum(); }

    // W of a stage; column d of G holds the used columns of its dense row d.
    void multiply(const StageStructure& structure, const MatrixXd& G) {
        const Index m = structure.columns();
        if (runs_.empty()) W_.leftCols(m).setZero();
        Into into = Into::set;
        for (const auto& run : runs_) {
            product(into, size(), m, run.length, {M_.col(run.first).data(), M_.outerStride()},
                    {G.col(run.offset).data(), G.outerStride(), 1}, {W_.data(), W_.outerStride()});
            into = Into::add;
        }
        entries_.clear();
        structure.each_entry([&](Index i, Index j, double value) {
            if (place_[i] < 0) return;
            entries_.push_back({place_[i], structure.position(j), value});
            W_.col(structure.position(j)).head(size()) += value * M_.col(place_[i]).head(size());
        });
    }

    // Calls with(product) for those of dense rows that are to be added to G'P G.
    template <class With>
    void each_product(const MatrixXd& G, const With& with) const {
        for (const auto& run : runs_) {
            with(Factors{
                run.length, {G.col(run.offset).data(), G.outerStride()}, {W_.data() + run.first, 1, W_.outerStride()}});
        }
    }

    // Adds what sparse rows do, to the upper triangle.
    void add_entries(Eigen::Block<MatrixXd> GPG) const {
        for (Index j = 0; j < GPG.cols(); ++j) {
            double* to = GPG.col(j).data();
            const double* from = W_.col(j).data();
            for (const Entry& of : entries_) {
                if (of.column <= j) to[of.column] += of.value * from[of.place];
            }
        }
    }

private:
    struct Entry {
        Index place, column;
        double value;
    };

    Index size() const { return static_cast<Index>(rows_.size()); }

    void add_dense(Index place, Index offset) {
        const auto follows = [&](const StageStructure::Run& run) {
            return run.first + run.length == place && run.offset + run.length == offset;
        };
        if (runs_.empty() || !follows(runs_.back())) runs_.push_back({place, 0, offset});
        ++runs_.back().length;
    }

    std::vector<Index> rows_, outer_;        // F; places in it of states upon which nothing depends
    std::vector<Index> place_;               // of a state in F; -1: it is not
    std::vector<StageStructure::Run> runs_;  // of dense rows: places in F, and where they stand among these
    std::vector<Entry> entries_;             // of sparse rows
    MatrixXd M_, W_;
};

}  // namespace leastaction
