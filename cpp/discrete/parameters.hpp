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
// inertias by joint, in the joint's frame; and whether the time step grows with it, from its start on.
struct Parameter {
    std::vector<double> numbers;
    std::vector<std::pair<int, Inertia<double>>> inertias;
    bool time_step = false;
    double time = 0;  // how the time at its start grows with it

    // Of what stands at the middle of the step, and at its end.
    double middle_time() const { return time + (time_step ? 0.5 : 0.0); }
    double end_time() const { return time + (time_step ? 1.0 : 0.0); }
};

// The elements of a step on duals in the space of the mechanism's numbers: at the start for its constraints and forces at
// the instants, at its end for constraints, and at its middle.
class NumberDuals {
public:
    explicit NumberDuals(const Mechanism& m);
    void place_at(const MidpointStep& step, double dt);
    // Takes other numbers than the mechanism's, and the direction along which they are differentiated, at a time that stays.
    void look(const double* numbers, const double* direction);
    ForcePoint<Dual<double>> at_start() const { return {start, Q1.data(), still_.data(), U_.data()}; }
    ForcePoint<Dual<double>> at_middle() const { return {middle, Q.data(), V.data(), U_.data()}; }

    Placement<Dual<double>> start, end, middle;
    std::vector<Dual<double>> Q1, Q2, Q, V;
    LocalTaylor<Dual<double>> local;
    LocalForce<Dual<double>> force;

private:
    const Mechanism& m_;
    std::vector<Dual<double>> U_, still_;
};

class ParameterSlopes {
public:
    explicit ParameterSlopes(const Mechanism& mechanism);
    // Of a step that was differentiated.
    void differentiate(MidpointStep& step, const FirstOrder& first, double dt,
                       const std::vector<Parameter>& parameters);

    int ld = 0;                       // of the rows: the parameters, padded
    AlignedVector Y, P2;              // of (q2; lam) and p2, rows of ld
    NumberDuals duals;                // at the last step, if some parameter was a direction of numbers
    std::vector<double> L_q, L_v, f;  // what they change by with the last parameter, by variable; f: the forces

private:
    void add_numbers(const Parameter& parameter, const MidpointStep& step, int column);
    void add_time_step(MidpointStep& step, double dt);
    void set_along_velocity(MidpointStep& step);

    const Mechanism& m_;
    const std::vector<double> still_;  // the direction in which no number changes
    std::vector<double> kick_, start_, end_;
    // Products of second derivatives at the midpoint with its velocity, by variable: L_qv v, L_vv v, f_v v, and the force f.
    std::vector<double> L_qv_v_, L_vv_v_, f_v_v_, force_;
    LocalForce<double> local_;
};

}  // namespace leastaction
