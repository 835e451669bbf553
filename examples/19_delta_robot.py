"""A delta robot from its MJCF carries something over in 0.3 s: six loops closed, torques and angles within limits.

The file holds the platform by six rods with a `connect` each. Here these are constraints that hold to rounding; the
motion that is found keeps to what the motors and joints of the file can do.

    python examples/19_delta_robot.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la

FILE = Path(__file__).parent / "models" / "delta.xml"


def solve() -> tuple[la.starts.Followed, la.Trajectory]:
    """Return the motion that follows a path over an obstacle, and the same made anew from its torques alone."""
    model = la.load(FILE)
    m, vi = model.mechanism, la.MidpointVI(model.mechanism)
    drawn = la.project_configuration(m, m.configuration(model.reference)).q
    t = np.linspace(0.0, 0.3, 151)
    s = (t / t[-1]) ** 3 * (10.0 - 15.0 * (t / t[-1]) + 6.0 * (t / t[-1]) ** 2)  # from rest to rest
    path = m.positions(drawn, ["tool"])[0] + np.stack([0.3 * (s - 0.5), 0.0 * s, 0.08 * np.sin(np.pi * s)], axis=1)
    platform = ["platform.x", "platform.y", "platform.z"]
    places = m.named(drawn)
    for name, way in zip(platform, path[0] - m.positions(drawn, ["tool"])[0], strict=True):
        places[name] += way
    moved = m.configuration(places)
    start = vi.start(la.project_configuration(m, moved, hold=platform).q)
    found = la.follow(m, {"tool": path}, {"turn *": 1e-7}, model.limits, t=t, start=start)
    return found, vi.simulate(start, t, inputs=found.trajectory.inputs)


def main(output: Path) -> tuple[la.starts.Followed, la.Trajectory]:
    """Solve, print and draw."""
    found, again = solve()
    m = again.mechanism
    print(f"off the path by {1e3 * found.errors['tool']:.2f} mm (rms), {found.result.iterations} iterations")
    print(f"loops closed to {np.abs(m.constraint_values(again.q)).max():.1e} m")
    print(f"torques up to {np.abs(again.inputs).max():.1f} N m of 15")
    output.mkdir(parents=True, exist_ok=True)
    shown = la.show(found.trajectory, shapes=la.load(FILE).shapes, traces=["tool"], title="Delta robot")
    shown.save(output / "19_delta_robot.png", at=0.1)
    shown.save(output / "19_delta_robot.html")
    return found, again


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
