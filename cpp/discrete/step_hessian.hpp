// Second derivatives of Ld, and first ones of forces, by both ends of a step, where rotations take part in it: as one table
// instead of in the places where Newton matrix and derivatives want them. See turning.hpp.
#pragma once

#include <vector>

#include "discrete/newton_step.hpp"
#include "discrete/turning.hpp"

namespace leastaction {

// Rows: D1Ld + fd- and D2Ld + fd+ of dynamic variables, (2 n_dynamic). Columns of `by_ends`: q1, then q2 (2 n_variables), in
// the coordinates of the kernel until turned; of `by_u`: inputs.
struct StepHessian {
    NewtonMatrix::Matrix by_ends, by_u;
    std::vector<char> only;  // which variables, one of each pair, are asked for; empty: all

    // At a middle at which the Lagrangian has these second derivatives.
    void evaluate(const Mechanism& m, const PairDerivatives& pairs, const ForcePoint<double>& middle, Split split,
                  double dt, LocalTaylor<double>& local, LocalForce<double>& force);
    // Columns of balls become derivatives by turns of the ends; of those that are prescribed, by turns of the start and
    // the rotation vector of the step.
    void turn_columns(const Mechanism& m, const std::vector<Turning>& turnings);
    // And then rows, given the values of the rows (of the kernel's coordinates) that they are derivatives of.
    void turn_rows(const Mechanism& m, const std::vector<Turning>& turnings, const double* start, const double* end);
};

// Three columns and three more become derivatives by turns, and rows likewise, in place.
void turn_columns(NewtonMatrix::Matrix& of, int first, int second, const Turning::Matrix6& slope);
void turn_rows(NewtonMatrix::Matrix& of, int first, int second, const Turning::Matrix6& slope);
// Values of rows of one ball from the kernel's coordinates to turns of the ends, in place.
void turn_rows(const Turning& turning, double* start, double* end);
// The same of all balls among the first n variables.
void turn_rows_of(const Mechanism& m, const std::vector<Turning>& turnings, double* start, double* end, int n);

}  // namespace leastaction
