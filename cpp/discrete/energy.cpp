// The energy of steps, and the work that is done from the middle of one to the middle of the next.
#include "discrete/energy.hpp"

#include <algorithm>
#include <cmath>

#include "discrete/layout.hpp"

namespace leastaction {

void MidpointStep::energy(double dt, const double* p, StepEnergy& out) {
    const Mechanism& m = *mechanism_;
    for (auto* a : {&out.v, &out.at_start, &out.at_end}) a->resize(nq_);
    const double kinetic = lagrangian_.kinetic_energy();
    out.kinetic = kinetic;
    out.potential = lagrangian_.potential_energy() + stored_;
    out.size = kinetic + lagrangian_.potential_size() + stored_size_;
    out.grown = out.pushed = 0;
    if (by_time_) {
        out.grown = dt * by_time_->potentials(lagrangian_.at.time, q_mid_.data());
        by_time_->constraints(t, q1.data(), [&](int c, double rate) { out.pushed += lam[c] * rate; });
    }
    const double km = kappa_minus(settings_.split, dt), kp = kappa_plus(settings_.split, dt);
    for (int i = 0; i < nq_; ++i) out.v[i] = v_[i];
    for (int i = 0; i < nd_; ++i) {
        out.at_start[i] = p1[i] - p[m.external[i]] + km * f_[i];  // p1 has been kicked
        out.at_end[i] = kp * f_[i];
    }
    if (nd_ == nq_) return;
    make_start_gradients();
    for (int i = nd_; i < nq_; ++i) {
        const double half_slope = 0.5 * dt * lagrangian_.L_q[i], momentum = lagrangian_.L_v[i];
        out.at_start[i] = momentum - half_slope;
        out.at_end[i] = -momentum - half_slope;
    }
    for (std::size_t b = 0; b < turnings_.size(); ++b)
        if (m.balls[b].prescribed)
            turnings_[b].turn_rows(&out.at_start[m.balls[b].variable], &out.at_end[m.balls[b].variable]);
    for (int i = nd_; i < nq_; ++i) {
        for (int c = 0; c < nc_; ++c) out.at_start[i] += C1_[c * nq_ + i] * lam[c];
    }
}

void EnergyRows::note(MidpointStep& step, double dt, const double* p, double* row) {
    std::swap(now_, before_);
    step.energy(dt, p, now_);
    row[0] = now_.kinetic;
    row[1] = now_.potential;
    row[2] = row[3] = 0;
    row[4] = now_.size;
    if (!before_.v.empty()) {
        const double grown = 0.5 * (before_.grown + now_.grown);
        row[2] = grown + now_.pushed;
        row[3] = std::abs(grown) + std::abs(now_.pushed);
        for (std::size_t i = 0; i < now_.v.size(); ++i) {
            const double part = 0.5 * (before_.at_end[i] + now_.at_start[i]) * (before_.v[i] + now_.v[i]);
            row[2] += part;
            row[3] += std::abs(part);
        }
    }
}

EnergyBalance balance_of(const double* rows, std::size_t steps) {
    EnergyBalance out;
    out.residual.resize(steps);
    double work = 0, least_work = 0, most_work = 0, least = 0, most = 0, work_size = 0;
    for (std::size_t k = 0; k < steps; ++k) {
        const double* row = rows + k * EnergyRows::width;
        if (k > 0) work += row[2];
        work_size += row[3];
        const double R = row[0] + row[1] - rows[0] - rows[1] - work;
        out.residual[k] = R;
        least = std::min(least, R), most = std::max(most, R);
        least_work = std::min(least_work, work), most_work = std::max(most_work, work);
        out.kinetic = std::max(out.kinetic, row[0]);
        out.size = std::max(out.size, row[4]);
    }
    out.swing = most - least;
    out.work = most_work - least_work;
    out.size += work_size;
    return out;
}

void energies_along(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                    const double* lam, double first_share, double* rows) {
    const Layout at(integrator.mechanism());
    auto workspace = integrator.workspace();
    MidpointStep& step = workspace->step;
    EnergyRows noted;
    for (int k = 0; k < steps; ++k) {
        const double *x = X + static_cast<std::size_t>(k) * at.nx, *next = x + at.nx;
        const double dt = t[k + 1] - t[k];
        at.start(x, U + static_cast<std::size_t>(k) * at.nu, t[k], at.share(k, dt, first_share), step);
        std::copy_n(lam + static_cast<std::size_t>(k) * at.nc, at.nc, step.lam.begin());
        if (at.nk > 0) step.place_start();
        at.finish_nearer(step, next, dt);
        step.evaluate_middle(dt);
        noted.note(step, dt, x + at.nqx, rows + static_cast<std::size_t>(k) * EnergyRows::width);
    }
}

}  // namespace leastaction
