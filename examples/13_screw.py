"""A nut on a screw, described in three ways: as a joint, as one variable in two frames, and by a constraint.

The dissertation builds a screw from two joints and a constraint (3.1.4.3). Here a screw is a joint like any other;
two frames may move by one variable; and the constraint is there too, with its multiplier, where the thrust on the
thread is wanted. All three spin up as the nut sinks, and agree.

    python examples/13_screw.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.viz import plot_reactions, plot_run, save_png

PITCH = 0.02 / (2.0 * np.pi)  # m/rad: 20 mm a turn
MASS, INERTIA, G, FRICTION = 0.5, 4e-5, 9.81, 2e-5
NUT = {"name": "nut", "mass": MASS, "inertia": (INERTIA, INERTIA, INERTIA)}
ELEMENTS = [la.Gravity((0.0, 0.0, -G)), la.Damping({"angle": FRICTION})]
T = np.linspace(0.0, 2.0, 2001)
NUTS = {
    "a screw joint": la.Mechanism([la.screw("angle", axis=(0, 0, 1), pitch=PITCH, **NUT)], ELEMENTS),
    "one variable, two frames": la.Mechanism(
        [la.tz(PITCH * la.var("angle")), [la.rz(la.var("angle"), **NUT)]], ELEMENTS
    ),
    "two variables and a constraint": la.Mechanism(
        [la.tz("z"), [la.rz("angle", **NUT)]],
        [*ELEMENTS, la.elements.Coupling({"z": 1.0, "angle": -PITCH}, name="thread")],
    ),
}


def solve() -> dict[str, la.Trajectory]:
    """Let the nut go, in all three descriptions."""
    vis = {name: la.MidpointVI(m) for name, m in NUTS.items()}
    return {name: vi.simulate(vi.start(np.zeros(vi.mechanism.nq)), T) for name, vi in vis.items()}


def closed_form() -> tuple[np.ndarray, np.ndarray]:
    """Return angle (rad) and thrust (N) over time: ``(I + m h^2) a = -m g h - c w`` and ``m h a = thrust - m g``."""
    whole, rate = INERTIA + MASS * PITCH**2, -MASS * G * PITCH / FRICTION
    decay = np.exp(-FRICTION * T / whole)
    return rate * (T - (1.0 - decay) * whole / FRICTION), MASS * (G - PITCH * MASS * G * PITCH / whole * decay)


def thrust(run: la.Trajectory) -> np.ndarray:
    """Return the thrust on the thread (N) at the instants but the first and the last: impulses over their time."""
    return np.abs(run["thread"][1:]) / T[1]


def main(output: Path) -> None:
    """Simulate, print and draw."""
    runs = solve()
    angle, expected = closed_form()
    last = runs["two variables and a constraint"]
    for name, run in runs.items():
        m = run.mechanism
        print(f"{name}: {m.nd} variables, {m.nc} constraints, {run['angle'][-1]:.9f} rad")
    print(f"off the closed form by {np.abs(last['angle'] - angle).max():.0e} rad of {abs(angle[-1]):.0f}")
    print(f"thrust on the thread: off by {np.abs(thrust(last) / expected[1:-1] - 1.0).max():.0e} of it")
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_run(runs, "angle", reference=last), plot_reactions(last, title="Thrust on the thread")]
    save_png(figures, output / "13_screw.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
