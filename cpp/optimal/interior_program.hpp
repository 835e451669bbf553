// The quadratic problem of one instant of a predictive controller, with its limits, by an interior point method in memory of
// its own: leastaction/control/interior.py has the mathematics.
//
// Limits are rows c + C z >= 0 of z = (dx, du). Each belongs to a stage, and has coefficients by some entries of
// [dx; du; dx of the next stage]; what looks ahead is by [A B] one of its own stage. An excess e of a row has the price rho.
#pragma once

#include <cstddef>
#include <vector>

#include "optimal/linear_quadratic.hpp"

namespace leastaction {

class InteriorProgram {
public:
    using Index = std::ptrdiff_t;

    // Of row i: its stage, and its entries begin[i] .. begin[i + 1] in `column` and in `coefficients`. A row of the last
    // state, at the stage N, has entries by dx alone.
    InteriorProgram(Index horizon, Index nx, Index nu, std::vector<Index> stage, std::vector<Index> begin,
                    std::vector<Index> column);

    std::vector<double> coefficients;    // to be filled before solve()
    std::vector<double> values, scales;  // of the rows
    std::vector<double> s, e, y, rho;    // slacks, excesses, multipliers, prices: kept from instant to instant
    bool kept = false;                   // those are of an instant before
    std::vector<double> dx, du, K, C;    // the solution: (N + 1, nx), (N, nu), gains and feedforward

    struct Report {
        bool solved = false;  // else there is no minimum
        int iterations = 0;
        bool converged = false;
        double excess = 0;  // the largest, in the scale of its row
    };
    // To within a tolerance relative to the cost's fall, which is measured by no less than `magnitude`.
    Report solve(const LinearQuadraticProblem& problem, double tolerance, double magnitude, int most);

    Index horizon() const { return N_; }
    Index rows() const { return static_cast<Index>(stage_.size()); }

private:
    void make_rows();
    void number_part();
    void take_part();
    void begin_anew();
    void weigh();
    // Newton's step on the equations of optimality, where the products of slacks and excesses are to change by r_s and
    // r_e, into dx_, du_, moved_; with the factors of the last one where they are `fresh` no more.
    bool go_towards(bool fresh);
    void changes();
    double longest(double inside) const;
    double gap(double length) const;
    double fall() const;

    Index N_, nx_, nu_, nz_;
    std::vector<Index> stage_, begin_, column_;
    std::vector<char> looks_ahead_;
    // The rows by [dx; du] of their stages.
    std::vector<Index> own_begin_, own_column_;
    std::vector<double> own_;
    std::vector<Index> part_columns_, part_place_;  // those of rows with several entries; places among them, or -1
    const LinearQuadraticProblem* given_ = nullptr;
    LinearQuadraticProblem problem_;  // with the weights of the limits
    std::vector<double> Q_, R_, Q_final_, part_, q_, r_, q_final_;
    std::vector<double> b_, b_all_, P0_, L_, sigma_, left_, r_s_, r_e_, ds_, de_, dy_, dx_, du_, moved_, kept_moved_;
};

}  // namespace leastaction
