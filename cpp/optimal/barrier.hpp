// The elastic barrier of limits c >= 0, over all of their values at once; leastaction/optimal/limits/barrier.py has the
// mathematics. With t = rho c / (2 mu), w = sqrt(1 + t^2) and g = mu / rho:
//
//   slack, excess = g (1 + w + |t|), g (1 + 1/(w + |t|)) for c > 0, the other way round for c <= 0
//   psi           = sum of rho excess - mu log(rho^2 excess slack / mu^2)
//   -psi'         = rho/(1 + w + |t|) for c > 0, and rho less that for c <= 0.
//
// t is of no unit, so nothing is out of range however far mu and what a limit is off by are apart.
#pragma once

#include <cstddef>

namespace leastaction {

// The parameter of the barriers, and the price of an excess, of each value.
struct Barrier {
    std::ptrdiff_t size;
    double mu;
    const double* rho;

    // Returns the value too.
    double split(const double* c, double* slack, double* excess) const;
    // -dy/dc of the primal-dual model at the duals y.
    void stiffness(const double* slack, const double* excess, const double* y, double* out) const;
    // The largest product of a dual with its slack, or of what its price has left with its excess.
    double off_center(const double* slack, const double* excess, const double* y) const;
    // Duals after a step along dc, which stay inside of (0, rho) and near those of the barriers where it leads to; `slack_after`
    // is that there.
    void move_duals(const double* slack, const double* excess, const double* y, const double* dc,
                    const double* slack_after, double* out) const;
    // Where along a direction the model is least that has the barriers themselves in place of their models. `fall`, `least`:
    // slope of cost and barriers, and their model's change at its end; `length`: where to look no further.
    double step(const double* c, const double* slack, const double* excess, const double* y, const double* dc,
                double fall, double least, double length) const;

    // Along a direction: the sum of -psi' dc, and of dc^2 times the stiffness.
    struct Along {
        double fall, stiff;
    };
    Along along(const double* slack, const double* excess, const double* y, const double* dc) const;

    // Goes to where the model is least along a direction, at most to its end, whose other part has there the derivatives
    // `fall` and `bend`; writes values, slack, excess and duals of where it leads to.
    struct From {
        const double *c, *slack, *excess, *y;
    };
    struct To {
        double *c, *slack, *excess, *y;
    };
    struct Step {
        double length, value;  // how far it is, and of the barriers there
    };
    Step advance(const From& from, const double* dc, double fall, double bend, const To& to) const;

private:
    double value(const double* slack, const double* excess) const;
    double slope_along(const double* c, const double* dc, double length) const;
};

// A dual to begin with, given that of the barrier and the price: a limit that is not met has a barrier that is all but
// linear, and with a small dual its model has its minimum where the limit is just met.
double first_multiplier(double barrier, double price);

}  // namespace leastaction
