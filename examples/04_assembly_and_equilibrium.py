"""Put a closed linkage together from a rough guess, and find where it comes to rest under its springs.

Two cranks and two couplers carry a lamp: a loop of five bars with two degrees of freedom. `project_configuration`
closes the loop from joint angles that are only roughly right, `equilibrium` finds where springs and weight balance,
whether the linkage stays there, and how it swings about that place. With friction it comes to rest there.

    python examples/04_assembly_and_equilibrium.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.mechanics import JointSpring, LinearSpring
from leastaction.viz import plot_poses, plot_run, save_png

GUESS = [2.2, -1.6, 0.7, 1.1]  # of the joints (rad): the ends of the couplers do not meet


def linkage() -> la.Mechanism:
    """Return the linkage in the x-y plane, upwards from its pivots; the lamp hangs on the left coupler."""
    tree = la.world()
    for side, x, post in (("left", 0.0, -0.25), ("right", 0.3, 0.55)):
        tree.tx(post).ty(0.10, name=f"{side} post")
        pivot = tree.tx(x, name=f"{side} pivot")
        crank = pivot.rz(f"{side} crank", mass=0.3, com=(0.15, 0.0, 0.0), inertia=(0.0, 0.00225, 0.00225))
        elbow = crank.tx(0.3, name=f"{side} elbow")
        coupler = elbow.rz(f"{side} coupler", mass=0.4, com=(0.2, 0.0, 0.0), inertia=(0.0, 0.0053, 0.0053))
        end = coupler.tx(0.4, name=f"{side} end")
        if side == "left":
            end.tx(0.15, name="lamp", mass=0.8)
    springs = [LinearSpring(f"{s} elbow", f"{s} post", 200.0, length=0.15) for s in ("left", "right")]
    bent = JointSpring("left coupler", 6.0, rest=-1.2, name="elbow spring")
    closed = la.PointToPoint("left end", "right end", "xy", name="apex")
    return la.Mechanism(tree, [la.Gravity((0.0, -9.81, 0.0)), la.Damping(0.3), closed, *springs, bent])


def main(output: Path) -> None:
    """Assemble, balance, simulate, print and draw."""
    m = linkage()
    q = la.project_configuration(m, GUESS).q
    rest = la.equilibrium(m, q)
    other = la.equilibrium(m, la.project_configuration(m, [2.8, -2.3, 1.0, 2.0]).q, kind="any")
    vi = la.MidpointVI(m)
    pushed = la.project_configuration(m, other.q - 0.02 * np.eye(4)[0]).q
    starts = {"from the guess, closed": q, "from beside the unstable one": pushed}
    runs = {name: vi.simulate(vi.start(start), np.linspace(0.0, 4.0, 2001)) for name, start in starts.items()}
    print(f"closed to {np.abs(m.constraint_values(q)).max():.0e} m")
    for name, value in zip(m.variables, np.degrees(rest.q), strict=True):
        print(f"at rest: {name} {value:.2f} degrees")
    swings = " and ".join(f"{f:.2f} Hz" for f in rest.frequencies / (2.0 * np.pi))
    print(f"{rest.stability.name.lower()}, it swings with {swings}; another one is {other.stability.name.lower()}")
    for name, run in runs.items():
        print(f"{name} it comes to rest {np.abs(run.q[-1] - rest.q).max():.0e} rad from there")
    output.mkdir(parents=True, exist_ok=True)
    wanted = np.tile(rest.q, (len(run.t), 1))
    figures = [
        *(plot_poses(run, [0.0, 0.2, 0.4, 4.0], title=name.capitalize()) for name, run in runs.items()),
        plot_run(runs, reference=wanted, title="Both come to rest where the equilibrium is"),
    ]
    save_png(figures, output / "04_assembly_and_equilibrium.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
