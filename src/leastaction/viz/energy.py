"""Energy of a run, and what of it no work explains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.queries.masses import Energy
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public
from leastaction.viz.figures import GREY, VERMILION, at_least, styled
from leastaction.viz.panels import LINES, PanelRow, legend_above, limit_time, stack
from leastaction.viz.signals import Source, motion_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NODES: Final = (0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0)  # Gauss: none where inputs jump
_PIECES: Final = 600  # that a run in continuous time is divided into at the least, to integrate power
_LATER: Final = 1e-5  # s: over which potentials that change with the time are differenced
_LEAST: Final = 1e-6  # of the energy that moves about: the least range of the balance


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkAndEnergy:
    """Energy and work along a run. ``t`` (n,), ``work`` (n,): done by inputs, damping and prescribed motion so far."""

    t: Array
    energy: Energy
    work: Array

    @property
    def balance(self) -> Array:
        """Energy less what it was and less the work since then (n,) (J): 0 of a motion without errors."""
        return np.asarray(self.energy.total - self.energy.total[0] - self.work)

    @property
    def scale(self) -> float:
        """What the balance is to be compared with: the largest kinetic energy, and change of energy (J)."""
        return float(np.max(self.energy.kinetic) + np.ptp(self.energy.total))


@public
@styled
def plot_energy(run: Source, *, title: str = "") -> Figure:
    """Draw kinetic, potential and total energy, the work that was done, and what is left of their balance.

    Parameters
    ----------
    run : Trajectory, ContinuousTrajectory or OptimizationResult
        A run, or a result of a mechanism's system.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        Above energies (J), and the work of inputs, damping and prescribed motion since the start; below the balance:
        the change of energy less that work, which an exact motion keeps at 0. In discrete time at the middles of steps,
        where it goes to and fro with the square of the time step but does not drift.

    Raises
    ------
    ArgumentError
        For what is no run, and a result that is of no mechanism.
    """
    motion = motion_of(run, "plot_energy")
    found = work_and_energy(motion)
    rows = [
        PanelRow(count=1, height=2.2, label="energy (J)"),
        PanelRow(count=1, height=1.1, label="balance (J)", starts=True),
    ]
    figure, ((above,), (below,)) = stack(rows, title)
    energy = found.energy
    lines = {"kinetic": energy.kinetic, "potential": energy.potential, "total": energy.total, "work done": found.work}
    for (name, values), look in zip(lines.items(), LINES, strict=False):
        above.plot(found.t, values, label=name, linewidth=1.4, **look)
    legend_above(above)
    below.axhline(0.0, color=GREY, linewidth=0.8)
    below.plot(found.t, found.balance, color=VERMILION, linewidth=1.2)
    at_least(below, _LEAST * found.scale)
    most = float(np.abs(found.balance).max())
    share = f", {100.0 * most / found.scale:.2g} % of what moves about" if found.scale > 0.0 else ""
    below.set_title(f"change of energy less work: {most:.2g} J at most{share}")
    limit_time(below, motion.t)
    return figure


def work_and_energy(run: Trajectory | ContinuousTrajectory) -> WorkAndEnergy:
    """Return energy and work at the middles of steps, or at the instants of a run in continuous time."""
    return _in_steps(run) if isinstance(run, Trajectory) else _in_time(run)


def _in_steps(run: Trajectory) -> WorkAndEnergy:
    energy = run.energy()
    work = energy.total - energy.total[0] - MidpointVI(run.mechanism).balance(run).residual
    return WorkAndEnergy(t=0.5 * (run.t[1:] + run.t[:-1]), energy=energy, work=work)


def _in_time(run: ContinuousTrajectory) -> WorkAndEnergy:
    if run.dense is None:
        power = _power(run, run.t, run.x, run.u)
        steps = 0.5 * np.diff(run.t) * (power[1:] + power[:-1])
    else:
        parts = -(-_PIECES // max(len(run.t) - 1, 1))
        ends = np.interp(np.arange((len(run.t) - 1) * parts + 1) / parts, np.arange(len(run.t)), run.t)
        starts, size = ends[:-1], np.diff(ends)
        nodes = [starts + node * size for node in _NODES]
        pieces = sum(0.5 * size * _power(run, t, run(t), run.input(t)) for t in nodes)
        steps = np.asarray(pieces).reshape(-1, parts).sum(axis=1)
    return WorkAndEnergy(t=run.t, energy=run.energy(), work=np.concatenate([[0.0], np.cumsum(steps)]))


def _power(run: ContinuousTrajectory, t: Array, x: Array, u: Array) -> Array:
    """Return the power (W) of inputs, damping, prescribed motion and potentials that change with the time.

    At times t (n,) in states (n, nx) with inputs (n, nu).
    """
    m = run.mechanism
    q, v, inputs = x[:, : m.nq], x[:, m.nq :], u[:, : m.n_inputs]
    states = [tuple(map(np.ascontiguousarray, state)) for state in zip(q, v, inputs, strict=True)]
    power = np.array(
        [m.core.force(at, speed, given, t=now) @ speed for now, (at, speed, given) in zip(t, states, strict=True)]
    )
    if m.core.timed:
        later, earlier = (m.energy(q, v, t + way).potential for way in (_LATER, -_LATER))
        power += (later - earlier) / (2.0 * _LATER)
    if m.nrho:
        dynamics = ContinuousDynamics(m)
        rho_a = u[:, m.n_inputs :]
        found = dynamics.accelerations(q, v, inputs, rho_a, t)
        a = np.hstack([found.a[:, : m.nd], rho_a])
        drive = dynamics.inverse_dynamics(q, v, a, found.lam, u=inputs, t=t)
        power += np.sum(drive[:, m.nd :] * v[:, m.nd :], axis=1)
    return power
