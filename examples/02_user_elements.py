"""Elements of your own, written as SymPy expressions: a cam, a magnet with a current, a screw of variable pitch.

Each is one expression in places and variables of the mechanism. The package compiles it for the core, which evaluates
and differentiates it by itself; there is nothing to differentiate by hand.

    python examples/02_user_elements.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import sympy

import leastaction as la
from leastaction.mechanics import ExpressionConstraint, ExpressionForce
from leastaction.mechanics.expressions.terms import input_, parameter, point, variable
from leastaction.viz import plot_reactions, plot_run, save_png

ANGLE = variable("angle")
LIFT = 0.03 * ((1 - sympy.cos(ANGLE)) / 2) ** 2  # of the cam (m): one lobe a turn, with a dwell at the bottom
TRAVEL = 0.010 * ANGLE / (2 * sympy.pi) + 2e-5 * ANGLE**2  # of the nut (m): the pitch grows from 10 mm a turn
PULL = parameter("C", 2e-4) * input_("current") ** 2 / point("ball")[2] ** 2  # of a coil at the origin (N)

# A heavy wheel whose cam lifts a follower; a ball under a coil; a nut that runs down a screw and spins it.
CAM = la.Mechanism(
    [la.rz("angle", name="wheel", mass=3.0, inertia=(0.01, 0.01, 0.02)), la.ty("lift", name="follower", mass=0.5)],
    [la.Gravity((0.0, -9.81, 0.0)), ExpressionConstraint(point("follower")[1] - LIFT, name="cam")],
)
BALL = la.Mechanism(
    [la.tz("z", name="ball", mass=0.05)], [la.Gravity((0.0, 0.0, -9.81)), ExpressionForce(PULL, "z", name="coil")]
)
NUT = la.Mechanism(
    [la.rz("angle", name="screw", mass=1.0, inertia=(1e-4, 1e-4, 2e-6)), la.tz("z", name="nut", mass=0.4)],
    [la.Gravity((0.0, 0.0, -9.81)), ExpressionConstraint(variable("z") + TRAVEL, name="thread")],
)


def run_down(m: la.Mechanism, speed: float, seconds: float) -> la.Trajectory:
    """Return the motion of the cam or the nut from an angle of 0.1 rad and a speed (rad/s)."""
    vi = la.MidpointVI(m)
    q = la.project_configuration(m, [0.1, 0.0], hold=["angle"]).q
    v = la.project_velocity(m, q, [speed, 0.0], hold=["angle"]).v
    return vi.simulate(vi.start(q, v), np.linspace(0.0, seconds, 2001))


def current(t: float, x: np.ndarray) -> np.ndarray:
    """Return the current (A) by the place and momentum of the ball, which is to go from 20 to 16 mm below at 0.4 s."""
    force = 0.05 * (9.81 + 900.0 * (-x[0] - (0.020 if t < 0.4 else 0.016)) - 60.0 * x[1] / 0.05)
    return np.array([np.sqrt(max(force, 0.0) / 2e-4) * -x[0]])


def main(output: Path) -> None:
    """Simulate, print and draw."""
    vi = la.MidpointVI(BALL)
    cam, nut = run_down(CAM, 20.0, 0.65), run_down(NUT, 0.0, 0.4)
    ball = vi.simulate(vi.start([-0.023]), np.linspace(0.0, 1.2, 1201), inputs=current, law_at="start")
    print(f"cam:    lifts the follower by {1e3 * cam['lift'].max():.1f} mm; {cam['angle'][-1] / 2 / np.pi:.1f} turns")
    print(f"magnet: the ball hangs {-1e3 * ball['z'][-1]:.2f} mm below, with {ball.inputs[-1, 0]:.3f} A")
    print(f"screw:  the nut is {-1e3 * nut['z'][-1]:.0f} mm down; {nut['angle'][-1] / 2 / np.pi:.1f} turns")
    output.mkdir(parents=True, exist_ok=True)
    figures = [
        plot_run(cam, "lift", title="A cam and its follower"),
        plot_reactions(cam, title="Force of the cam: negative where it would have to pull"),
        plot_run(ball, title="A ball under a magnet"),
        plot_run(nut, "z", title="A nut on a screw of growing pitch"),
    ]
    save_png(figures, output / "02_user_elements.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
