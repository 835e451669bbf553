"""A chain that hangs from two hooks: a loop in a plane, from a rough guess to its rest.

The loop is closed by a constraint. `project_configuration` assembles it from a guess, the damped motion comes to
rest in the shape that `equilibrium` finds at once, and the pull of its ends is the one of a cable of the same
weight.

    python examples/11_closed_chain.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

from leastaction import (
    Damping,
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    equilibrium,
    project_configuration,
    rz,
    tx,
)

LINKS, LENGTH, MASS, SPAN, GRAVITY = 24, 0.1, 0.05, 1.6, 9.81
DT = 0.01


def hung_chain() -> Mechanism:
    """Return slender links in the x-y plane between hooks at the same height."""
    across = MASS * LENGTH**2 / 12.0
    tree: list[object] = [tx(0.0, name="end")]
    for k in reversed(range(LINKS)):
        link = rz(f"joint{k}", name=f"link{k}", mass=MASS, com=(LENGTH / 2.0, 0.0, 0.0), inertia=(0.0, across, across))
        tree = [link, [tx(LENGTH), tree]]
    return Mechanism(
        [*tree, tx(SPAN, name="hook")],
        [Gravity((0.0, -GRAVITY, 0.0)), Damping(1e-2), PointToPoint("end", "hook", "xy", name="closure")],
    )


def cable() -> tuple[float, np.ndarray]:
    """Return the pull along x (N) of a cable of this length and weight between the hooks, and points (n, 2) of it."""
    whole, weight = LINKS * LENGTH, MASS * GRAVITY / LENGTH
    a = brentq(lambda a: 2.0 * a * np.sinh(SPAN / (2.0 * a)) - whole, 0.05, 10.0)
    x = np.linspace(0.0, SPAN, 200)
    return weight * a, np.stack([x, a * (np.cosh((x - SPAN / 2.0) / a) - np.cosh(SPAN / (2.0 * a)))], axis=1)


@dataclass(frozen=True)
class Result:
    """The guess, the assembled loop, the motion to its rest, and what is known of the rest."""

    mechanism: Mechanism
    guess: np.ndarray
    run: Trajectory
    rest: np.ndarray
    apart: float  # of the motion's end and the equilibrium (rad)
    pull: float  # along x at the hooks (N)
    residual: float  # of the constraints over the motion (m)


def solve() -> Result:
    """Assemble, let go, and compare."""
    m = hung_chain()
    guess = np.zeros(LINKS)
    guess[0], guess[1:] = -0.2, 0.02
    start = project_configuration(m, guess).q
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(start), DT * np.arange(6001))
    rest = equilibrium(m, run.q[-1]).q
    # The multipliers are impulses: over a step, the force times its length.
    pull = abs(float(run.lam[-1, 0])) / DT
    residual = float(np.abs([list(m.constraint_residuals(q).values()) for q in run.q[::100]]).max())
    return Result(m, guess, run, rest, float(np.abs(run.q[-1] - rest).max()), pull, residual)


def draw(result: Result) -> Figure:
    """Return the figure: the chain as guessed, closed, on its way and at rest, and the height of its middle."""
    figure = Figure(figsize=(11.5, 5.2), layout="constrained")
    shape, height = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    m = result.mechanism
    links = [*(f"link{k}" for k in range(LINKS)), "end"]
    shape.plot(*m.positions(result.guess, links)[:, :2].T, ":", color="0.4", label="rough guess")
    for moment, color in ((0.0, "0.75"), (0.2, "tab:cyan"), (0.5, "tab:blue")):
        points = m.positions(result.run.q[round(moment / DT)], links)
        shape.plot(
            *points[:, :2].T, color=color, marker=".", lw=1.2, label="closed" if moment == 0.0 else f"{moment:g} s"
        )
    shape.plot(*cable()[1].T, color="tab:orange", lw=5, alpha=0.5, label="cable")
    shape.plot(*m.positions(result.rest, links)[:, :2].T, color="k", marker=".", lw=1.2, label="at rest")
    shape.plot([0.0, SPAN], [0.0, 0.0], "s", color="tab:red", ms=8)
    shape.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    shape.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    middle = np.array([m.positions(q, [f"link{LINKS // 2}"])[0, 1] for q in result.run.q])
    height.plot(result.run.t, middle, color="tab:blue")
    height.axhline(m.positions(result.rest, [f"link{LINKS // 2}"])[0, 1], ls="--", color="k", lw=1)
    height.set(xlabel="time (s)", ylabel="height of the middle (m)", xlim=(0.0, 60.0), title="dashed: at rest")
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    print(f"closed from the guess; the constraints stay within {result.residual:.0e} m over {result.run.steps} steps")
    print(f"after {result.run.t[-1]:g} s it is within {result.apart:.0e} rad of the equilibrium")
    print(f"the ends pull with {result.pull:.3f} N along x; those of a cable of this weight with {cable()[0]:.3f} N")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "11_closed_chain.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
