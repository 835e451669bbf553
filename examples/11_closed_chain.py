"""A chain that hangs from two hooks: a loop in a plane, from a rough guess to its rest.

The loop is closed by a constraint. `project_configuration` assembles it from a guess, the damped motion comes to
rest in the shape that `equilibrium` finds at once, and the pull of its ends is the one of a cable of the same
weight.

    python examples/11_closed_chain.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

import leastaction as la
from leastaction.viz import plot_poses, plot_reactions, save_png

LINKS, LENGTH, MASS, SPAN, GRAVITY = 24, 0.1, 0.05, 1.6, 9.81
T = np.linspace(0.0, 60.0, 6001)


def hung_chain() -> la.Mechanism:
    """Return slender links in the x-y plane between hooks at the same height."""
    across = MASS * LENGTH**2 / 12.0
    tree: list[object] = [la.tx(0.0, name="end")]
    for k in reversed(range(LINKS)):
        body = {"mass": MASS, "com": (LENGTH / 2.0, 0.0, 0.0), "inertia": (0.0, across, across)}
        tree = [la.rz(f"joint{k}", name=f"link{k}", **body), [la.tx(LENGTH), tree]]
    closure = la.PointToPoint("end", "hook", "xy", name="closure")
    return la.Mechanism(
        [*tree, la.tx(SPAN, name="hook")], [la.Gravity((0.0, -GRAVITY, 0.0)), la.Damping(1e-2), closure]
    )


def cable() -> float:
    """Return the pull along x (N) of a cable of this length and weight between the hooks."""
    a = brentq(lambda a: 2.0 * a * np.sinh(SPAN / (2.0 * a)) - LINKS * LENGTH, 0.05, 10.0)
    return MASS * GRAVITY / LENGTH * a


def solve() -> la.Trajectory:
    """Assemble a loop from a rough guess and let it go."""
    m = hung_chain()
    start = la.project_configuration(m, np.r_[-0.2, np.full(LINKS - 1, 0.02)]).q
    vi = la.MidpointVI(m)
    return vi.simulate(vi.start(start), T)


def main(output: Path) -> None:
    """Simulate, print and draw."""
    run = solve()
    m, pull = run.mechanism, abs(run["closure.x"][-1]) / T[1]  # the multipliers are impulses
    residual = max(abs(value) for q in run.q[::100] for value in m.constraint_residuals(q).values())
    print(f"closed from the guess; the constraints stay within {residual:.0e} m over {run.steps} steps")
    apart = np.abs(run.q[-1] - la.equilibrium(m, run.q[-1]).q).max()
    print(f"after {T[-1]:g} s it is within {apart:.0e} rad of the equilibrium")
    print(f"the ends pull with {pull:.3f} N along x; those of a cable of this weight with {cable():.3f} N")
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_poses(run, [0.0, T[-1]]), plot_reactions(run, title="Forces that close the loop")]
    save_png(figures, output / "11_closed_chain.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
