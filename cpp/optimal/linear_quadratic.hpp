// The finite-horizon linear-quadratic problem with affine terms (dissertation B.2.2, B.2.3).
//
//   minimise   sum_{k=0}^{N-1} { 1/2 [dx; du]' [Q S; S' R]_k [dx; du] + q_k'dx + r_k'du }
//              + 1/2 dx_N' Q_N dx_N + q_N' dx_N
//   subject to dx_{k+1} = A_k dx_k + B_k du_k + c_k,   dx_0 given.
//
// The value function 1/2 dx'P dx + b'dx + g and the optimal input follow backwards in time. With
// G = [A B], the model of stage k is
//
//   H = [Q S; S' R] + G' P+ G          h = [q; r] + G' (b+ + P+ c)
//   H_uu = L L'                        V = H_xu L^-T          w = L^-1 h_u
//   K' = V L^-1                        C = L^-T w             du = -K dx - C
//   P = H_xx - V V'                    b = h_x - V w          g = g+ + b+'c + 1/2 c'P+c - 1/2 w'w
//
// which is (B.4) with the 1/2 in the cost. Only the upper triangle of P is computed, and mirrored,
// so P is symmetric to the last bit. The problem has a unique minimiser if and only if every H_uu
// is positive definite. The first stage (from the end) where it is not is reported with its smallest
// eigenvalue. On request the recursion goes on with a nearby convex problem: P+ is replaced by its positive
// semidefinite part and the stage's H is left out, so that H_uu >= R. Shifting R instead leaves a P that is
// hugely negative, and the stages before fail one after the other.
//
// b has a second reading: b_k = q - K'r + (A - BK)'b_{k+1} (for c = 0), so it is also the adjoint of
// the trajectory closed with this very gain (dissertation Prop. 7).
//
// Structure. A mechanism's state holds rows that are copied or differenced (rho' = u,
// v_rho' = (u - rho)/dt) and columns that nothing depends on (v_rho). Each stage is scanned: rows of G
// with at most two non-zeros (set S) are multiplied entry by entry, the others (set D) by matrix
// products, and zero columns are left out:
//
//   P G = P_:D G_D + P_:S G_S          G' P G = G_D' (PG)_D + G_S' (PG)_S
//
// With nx = 80, nu = 18 and 36 such rows this is 0.9 instead of 2.5 million operations a stage. Where it is known beforehand
// which entries may differ from zero, the others are never fetched from memory, which is what most stages wait for. Problems of up
// to 16 states and inputs are solved without looking for any of that (small_recursion.hpp), in a third of the time.

#pragma once

#include <cstddef>
#include <limits>

namespace leastaction {

// A block of the cost's Hessian: absent, a diagonal or a full row-major matrix, one for all stages
// (stride 0) or one per stage (stride = number of doubles from stage to stage).
struct HessianBlock {
    const double* data = nullptr;
    std::ptrdiff_t stride = 0;
    bool diagonal = false;

    const double* at(std::ptrdiff_t k) const { return data == nullptr ? nullptr : data + k * stride; }
};

// A symmetric matrix for every stage by some entries of [dx; du] only, such as what a few rows of limits weigh.
struct HessianPart {
    const double* data = nullptr;             // (N, size, size), of which the lower triangle is read
    const std::ptrdiff_t* columns = nullptr;  // (size), ascending
    std::ptrdiff_t size = 0;
};

// All arrays row-major, time first. Pointers that are null stand for zeros.
struct LinearQuadraticProblem {
    std::ptrdiff_t horizon = 0;       // N
    std::ptrdiff_t nx = 0;            //
    std::ptrdiff_t nu = 0;            //
    const double* A = nullptr;        // (N, nx, nx)
    const double* B = nullptr;        // (N, nx, nu)
    const double* c = nullptr;        // (N, nx)
    HessianBlock Q;                   // (nx) or (nx, nx), symmetric
    HessianBlock R;                   // (nu) or (nu, nu), symmetric
    HessianBlock S;                   // (nx, nu)
    const double* H = nullptr;        // (N, nx + nu, nx + nu), added to Q, S, R; lower triangle is read ...
    bool packed = false;              // ... or it is all there is, by rows, of those that the pattern has entries of
    double H_scale = 1.0;             // H is multiplied by it
    HessianPart part;                 // added to Q, S, R
    const double* q = nullptr;        // (N, nx)
    const double* r = nullptr;        // (N, nu)
    HessianBlock Q_final;             // (nx) or (nx, nx)
    const double* q_final = nullptr;  // (nx)
    // (nx, nx + nu): which entries of [A B] may differ from zero, at any stage; null: looked for at each of them. Of the
    // others only those are read that stand in a row and in a column with more: not columns without entries, nor what H has
    // of such states.
    const bool* pattern = nullptr;
};

struct LinearQuadraticOptions {
    bool regularize = false;    // make an indefinite stage convex and go on
    bool use_structure = true;  // scan G for sparse rows and zero columns
};

// Where the results go; P_all and L_all may be null.
struct LinearQuadraticOutput {
    double* K = nullptr;      // (N, nu, nx)
    double* C = nullptr;      // (N, nu)
    double* b = nullptr;      // (N + 1, nx)
    double* P0 = nullptr;     // (nx, nx)
    double* P_all = nullptr;  // (N + 1, nx, nx)
    double* L_all = nullptr;  // (N, nu, nu): the factors L of H_uu, lower triangles
};

struct LinearQuadraticReport {
    enum class Status { solved, indefinite, not_finite };

    Status status = Status::solved;
    std::ptrdiff_t stage = -1;  // where the recursion ended, or the first that was regularised; -1: none
    double smallest_eigenvalue = std::numeric_limits<double>::quiet_NaN();  // of H_uu at that stage
    std::ptrdiff_t regularized_stages = 0;
    double largest_change = 0.0;           // largest negative eigenvalue of a P that was removed
    double constant = 0.0;                 // g_0: the value for dx_0 = 0
    std::ptrdiff_t structured_stages = 0;  // stages with sparse rows or zero columns
};

LinearQuadraticReport solve_linear_quadratic(const LinearQuadraticProblem& problem,
                                             const LinearQuadraticOptions& options,
                                             const LinearQuadraticOutput& output);

// dx_{k+1} = A dx + B du + c with du = -K dx - C from dx[0]; dx (N + 1, nx), du (N, nu). With a pattern it reads no more of A
// and B than that.
void sweep_forward(const LinearQuadraticProblem& problem, const double* K, const double* C, double* dx, double* du);

// What a drift c adds to C of a problem that was solved, to be followed with its K: the recursion above for vectors alone, with
// P and L of all stages, as they were written, and no gradient. C (N, nu). Reads no more of A and B than a pattern says.
void sweep_drift(const LinearQuadraticProblem& problem, const double* K, const double* P, const double* L, double* C);

// z_N = q_N, z_k = q - K'r + (A - BK)'z_{k+1} (dissertation Prop. 7); z (N + 1, nx). Where h (N, nu) is
// given, it is the derivative by the inputs, r + B'z. With a pattern it reads no more than that.
void sweep_adjoint(const LinearQuadraticProblem& problem, const double* K, double* z, double* h = nullptr);

}  // namespace leastaction
