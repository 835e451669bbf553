// First derivatives of a midpoint step by the mechanism's numbers, exact: by a number th
//
//   F1_th = dt/2 L_qth - L_vth + kappa- f_th - (Dh(q1)'lam)_th,   F2_th = h_th(q2),   G_th = dt/2 L_qth + L_vth + kappa+ f_th,
//
// solved for the unknowns like the columns of the other first derivatives. Numbers of elements are differentiated by
// dual evaluations, inertias by the linearity of L in them. By the time step, with v = (q2 - q1)/dt and so v_dt = -v/dt,
//
//   (dt/2 L_q)_dt = 1/2 (L_q - L_qv v),   (L_v)_dt = -L_vv v / dt,   (kappa f)_dt = kappa/dt (f - f_v v).
//
// Forces at the instants stand in F1 alone: by a number share f_th(q1, 0, u), by the time step share/dt f.
#pragma once

#include <utility>
#include <vector>

#include "discrete/differentiate.hpp"

namespace leastaction {

// A direction in the space of the mechanism's numbers: of the numbers of elements by slot (or none at all), and of spatial
// inertias by joint, in the joint's frame; and whether the time step grows with it.
struct Parameter {
    std::vector<double> numbers;
    std::vector<std::pair<int, Inertia<double>>> inertias;
    bool time_step = false;
};

struct ParameterSlopes {
    int ld;               // of the rows: the parameters, padded
    AlignedVector Y, P2;  // of (q2; lam) and p2, rows of ld
};

// Of a step that was differentiated; allocates.
ParameterSlopes differentiate_by(MidpointStep& step, const FirstOrder& first, double dt,
                                 const std::vector<Parameter>& parameters);

}  // namespace leastaction
