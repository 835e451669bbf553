"""Forces of constraints over time, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.numerics.public import public
from leastaction.viz.figures import GREY, styled
from leastaction.viz.panels import by_unit, draw_signals, limit_time, signal_panels
from leastaction.viz.signals import Signal, Source, chosen, motion_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Of a force along what a constraint holds, by the unit of its multiplier as an impulse.
_FORCE: Final = {"N s": "N", "N m s": "N m", "N s/m": "N/m"}


@public
@styled
def plot_reactions(run: Source, names: str | Sequence[str] = "*", *, title: str = "") -> Figure:
    """Draw the forces by which constraints hold, by name: of strings their tension, positive where they pull.

    Parameters
    ----------
    run : Trajectory, ContinuousTrajectory or OptimizationResult
        A run, or a result of a mechanism's system.
    names : str or sequence of str
        Of constraint equations (see ``mechanism.constraints``), with wildcards.
    title : str, optional
        Heading.

    Returns
    -------
    Figure
        A group of panels for each unit: N along a length that is held, N m along an angle; positive where it pushes
        towards larger values of what the constraint holds, but tensions where they pull. In discrete time the impulse
        at an instant over the time that it stands for, half of both steps; the first instant is left out, whose impulse
        depends on how the run was started.

    Raises
    ------
    ArgumentError
        For what is no run, a result of no mechanism, a mechanism without constraints, or unknown names.
    """
    motion = motion_of(run, "plot_reactions")
    if not motion.mechanism.nc:
        raise ArgumentError("plot_reactions: got a run of a mechanism without constraints, expected some that hold it")
    selected = chosen(reactions_of(motion), names, "plot_reactions: names")
    figure, panels = signal_panels(by_unit(selected), title)
    for panel in panels:
        panel.axes.axhline(0.0, color=GREY, linewidth=0.7, zorder=1)
        draw_signals(panel)
        limit_time(panel.axes, motion.t)
    return figure


def reactions_of(motion: Trajectory | ContinuousTrajectory) -> list[Signal]:
    """Return the force of every constraint equation over time, of strings their tension."""
    m = motion.mechanism
    # A multiplier pulls in discrete time, ``-Dh^T lam`` is its impulse; in continuous time ``Dh^T lam`` is its force.
    if isinstance(motion, ContinuousTrajectory):
        t, q, pulls = motion.t, motion.q, -motion.lam
        over = np.ones(len(t))
    else:
        t, q, pulls = motion.t[1:-1], motion.q[1:-1], motion.lam[1:]
        over = 0.5 * (motion.t[2:] - motion.t[:-2])
    at = dict(zip(m.coordinates, q.T, strict=True))
    forces: list[Signal] = []
    for name, unit, column in zip(m.constraints, motion.multiplier_units, pulls.T, strict=True):
        element = m.elements.get(name)
        tension = None if element is None else element.tension(column, over, at)
        values, unit = (-column / over, _FORCE.get(unit, unit)) if tension is None else (tension, "N")
        forces.append(Signal(name=name, unit=unit, t=t, values=values, kind="multiplier"))
    return forces
