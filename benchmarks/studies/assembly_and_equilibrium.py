"""Put a closed linkage together from a rough guess, and find where it comes to rest under its springs.

Two cranks and two couplers carry a lamp: a loop of five bars with two degrees of freedom. `project_configuration`
closes the loop from joint angles that are only roughly right, `equilibrium` finds where springs and weight balance,
whether the linkage stays there, and how it swings about that place; a simulation swings as it says.

    python -m benchmarks.studies.assembly_and_equilibrium --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leastaction import (
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    project_configuration,
    world,
)
from leastaction.mechanics import Equilibrium, JointSpring, LinearSpring, equilibrium
from leastaction.viz.figures import BLUE, GREEN, ORANGE, PURPLE, styled

BASE, CRANK, COUPLER = 0.30, 0.30, 0.40  # between the pivots, and of the bars (m)
LEFT = ["left pivot", "left elbow", "left end"]
RIGHT = ["right pivot", "right elbow", "right end"]
GUESS = [2.2, -1.6, 0.7, 1.1]  # of the joints (rad): the ends of the couplers do not meet


def linkage() -> Mechanism:
    """Return the linkage in the x-y plane, upwards from its pivots; the lamp hangs on the left coupler."""
    tree = world()
    for frames, x, crank, coupler in (
        (LEFT, 0.0, "left crank", "left coupler"),
        (RIGHT, BASE, "right crank", "right coupler"),
    ):
        pivot = tree.tx(x, name=frames[0])
        elbow = pivot.rz(crank, mass=0.3, com=(CRANK / 2, 0.0, 0.0), inertia=rod(0.3, CRANK))
        bar = elbow.tx(CRANK, name=frames[1]).rz(
            coupler, mass=0.4, com=(COUPLER / 2, 0.0, 0.0), inertia=rod(0.4, COUPLER)
        )
        end = bar.tx(COUPLER, name=frames[2])
        if frames is LEFT:
            end.tx(0.15, name="lamp", mass=0.8)
    tree.tx(-0.25).ty(0.10, name="left post")
    tree.tx(BASE + 0.25).ty(0.10, name="right post")
    return Mechanism(
        tree,
        [
            Gravity((0.0, -9.81, 0.0)),
            PointToPoint("left end", "right end", "xy", name="apex"),
            LinearSpring("left elbow", "left post", 200.0, length=0.15, name="left spring"),
            LinearSpring("right elbow", "right post", 200.0, length=0.15, name="right spring"),
            JointSpring("left coupler", 6.0, rest=-1.2, name="elbow spring"),
        ],
    )


def rod(mass: float, length: float) -> tuple[float, float, float]:
    """Return the principal inertias of a thin rod along x (kg m^2)."""
    across = mass * length**2 / 12.0
    return 0.0, across, across


@dataclass(frozen=True)
class Result:
    """The guess, the closed linkage, its equilibrium, and a small swing about it.

    ``other``: an equilibrium that a push upsets. ``frequencies``: those of the swing (Hz), the slow and the fast one,
    as counted in the simulation.
    """

    mechanism: Mechanism
    closed: np.ndarray
    rest: Equilibrium
    other: Equilibrium
    swing: Trajectory
    along: np.ndarray  # the swing along the two modes: of the joint that moves most in each (rad)
    frequencies: np.ndarray
    gap: float  # between the couplers' ends in the closed linkage (m)


def solve() -> Result:
    """Assemble, balance and swing the linkage."""
    m = linkage()
    closed = project_configuration(m, GUESS).q
    rest = equilibrium(m, closed)
    # Any equilibrium near another guess: one that a push upsets.
    other = equilibrium(m, project_configuration(m, [2.8, -2.3, 1.0, 2.0]).q, kind="any")
    # A small swing in both modes at once, and its parts.
    vi = MidpointVI(m)
    modes = np.real(rest.modes) / np.abs(rest.modes).max(axis=0)
    start = vi.start(project_configuration(m, rest.q + modes @ [4e-3, 2e-3]).q)
    swing = vi.simulate(start, np.linspace(0.0, 6.0, 12001))
    inertia = m.mass_matrix(rest.q)
    weights = modes.T @ inertia
    along = np.linalg.solve(weights @ modes, weights @ (swing.q - rest.q).T).T
    frequencies = np.array([counted(swing.t, part) for part in along.T])
    ends = m.positions(closed, ["left end", "right end"])
    gap = float(np.linalg.norm(ends[0] - ends[1]))
    return Result(m, closed, rest, other, swing, along, frequencies, gap)


def counted(t: np.ndarray, values: np.ndarray) -> float:
    """Return the frequency of an oscillation about zero (Hz) from its first and its last upward crossing."""
    up = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    at = t[up] - values[up] * (t[up + 1] - t[up]) / (values[up + 1] - values[up])
    return float((len(at) - 1) / (at[-1] - at[0]))


def draw_linkage(axis: Axes, m: Mechanism, q: np.ndarray, title: str) -> None:
    """Draw the bars, the springs and the lamp."""
    for bars, color in ((LEFT, BLUE), (RIGHT, ORANGE)):
        x, y = m.positions(q, bars)[:, :2].T
        axis.plot(x, y, color=color, lw=4, marker="o", ms=7, solid_capstyle="round")
    for spring in (["left elbow", "left post"], ["right elbow", "right post"]):
        ends = m.positions(q, spring)[:, :2]
        axis.plot(*coil(*ends).T, color="0.45", lw=1)
        axis.plot(*ends[1], "s", color="0.3", ms=7)
    x, y = m.positions(q, ["left end", "lamp"])[:, :2].T
    axis.plot(x, y, color=BLUE, lw=4)
    axis.plot(x[1], y[1], "o", color="gold", ms=16, mec="0.3")
    axis.set(title=title, aspect="equal", xlim=(-0.35, 0.65), ylim=(-0.15, 0.85), xlabel="x (m)")


def coil(start: np.ndarray, end: np.ndarray, turns: int = 9) -> np.ndarray:
    """Return the points (n, 2) of a zigzag between two points."""
    s = np.linspace(0.0, 1.0, 2 * turns + 1)
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    aside = 0.015 * np.where(np.arange(len(s)) % 2, 1.0, -1.0) * ((s > 0.05) & (s < 0.95))
    return start + s[:, None] * along + aside[:, None] * across


@styled
def draw(result: Result) -> Figure:
    """Return the figure: guess, closed linkage and equilibrium above, the swing below."""
    figure = Figure(figsize=(11.5, 6.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.2, 1.0])
    m = result.mechanism
    axes = above.subplots(1, 4, sharey=True)
    draw_linkage(axes[0], m, np.array(GUESS), "rough guess")
    draw_linkage(axes[1], m, result.closed, "closed")
    draw_linkage(axes[2], m, result.rest.q, f"at rest: {result.rest.stability.name.lower()}")
    draw_linkage(axes[3], m, result.other.q, f"at rest: {result.other.stability.name.lower()}")
    axes[0].set_ylabel("y (m)")
    shown = result.swing.t <= 2.0
    axis = below.subplots()
    for k, (color, name) in enumerate(((GREEN, "slow mode"), (PURPLE, "fast mode"))):
        said = result.rest.frequencies[k] / (2.0 * np.pi)
        label = f"{name}: {result.frequencies[k]:.4f} Hz simulated, {said:.4f} Hz by the equilibrium"
        axis.plot(result.swing.t[shown], 1e3 * result.along[shown, k], color=color, label=label)
    axis.set(xlabel="time (s)", ylabel="swing of the joint that\nmoves most (mrad)", xlim=(0.0, 2.0))
    axis.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


def main(output: Path) -> Result:
    """Solve, print and draw."""
    result = solve()
    m, rest = result.mechanism, result.rest
    print(f"closed: the couplers' ends are {result.gap:.0e} m apart")
    for name, value in zip(m.variables, np.degrees(rest.q), strict=True):
        print(f"at rest: {name} {value:.2f} degrees")
    print(rest.stability.value)
    print("another one is " + result.other.stability.value)
    for said, seen in zip(rest.frequencies / (2.0 * np.pi), result.frequencies, strict=True):
        print(f"natural frequency {said:.5f} Hz, in a simulation {seen:.5f} Hz")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "assembly_and_equilibrium.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
