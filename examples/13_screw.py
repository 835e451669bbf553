"""A nut on a screw, described in three ways: as a joint, as one variable in two frames, and by a constraint.

The dissertation builds a screw from two joints and a constraint (3.1.4.3). Here a screw is a joint like any other;
two frames may move by one variable; and the constraint is there too, with its multiplier, where the thrust on the
thread is wanted. All three spin up as the nut sinks, and agree.

    python examples/13_screw.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import Coupling, Damping, Gravity, Mechanism, MidpointVI, Trajectory, rz, screw, tz, var

PITCH = 0.02 / (2.0 * np.pi)  # m/rad: 20 mm a turn
MASS, INERTIA, G, FRICTION = 0.5, 4e-5, 9.81, 2e-5
BODY = {"mass": MASS, "inertia": (INERTIA, INERTIA, INERTIA)}
DT = 1e-3


def nuts() -> dict[str, Mechanism]:
    """Return a nut that sinks by 20 mm a turn as it turns with its screw's friction, in three descriptions."""
    elements = [Gravity((0.0, 0.0, -G)), Damping({"angle": FRICTION})]
    thread = Coupling({"z": 1.0, "angle": -PITCH}, name="thread")
    return {
        "a screw joint": Mechanism([screw("angle", axis=(0, 0, 1), pitch=PITCH, name="nut", **BODY)], elements),
        "one variable, two frames": Mechanism(
            [tz(PITCH * var("angle")), [rz(var("angle"), name="nut", **BODY)]], elements
        ),
        "two variables and a constraint": Mechanism([tz("z"), [rz("angle", name="nut", **BODY)]], [*elements, thread]),
    }


@dataclass(frozen=True)
class Result:
    """The three motions, how far they are apart and off the closed form (rad), and the thrust on the thread (N)."""

    runs: dict[str, Trajectory]
    apart: float
    off: float
    thrust: np.ndarray
    expected: np.ndarray


def solve() -> Result:
    """Let the nut go, in all three."""
    t = DT * np.arange(2001)
    runs = {}
    for name, m in nuts().items():
        vi = MidpointVI(m)
        runs[name] = vi.simulate(vi.start(np.zeros(m.nq)), t)
    angles = [run["angle"] for run in runs.values()]
    # (I + m h^2) w' = -m g h - c w.
    whole, rate = INERTIA + MASS * PITCH**2, -MASS * G * PITCH / FRICTION
    decay = np.exp(-FRICTION * t / whole)
    exact = rate * (t - (1.0 - decay) * whole / FRICTION)
    last = runs["two variables and a constraint"]
    # m z'' = -m g + thrust
    expected = MASS * (G - PITCH * MASS * G * PITCH / whole * decay[:-1])
    return Result(
        runs,
        float(max(np.abs(a - angles[0]).max() for a in angles)),
        float(np.abs(angles[0] - exact).max()),
        np.abs(last.lam[:, 0]) / DT,
        expected,
    )


def draw(result: Result) -> Figure:
    """Return the figure: the angle in all descriptions, and the thrust."""
    figure = Figure(figsize=(9.5, 5.4), layout="constrained")
    angle, thrust = figure.subplots(2, 1, sharex=True)
    styles = zip(("-", "--", ":"), (6, 3, 1.5), ("0.8", "tab:blue", "k"), strict=True)
    for (name, run), (line, width, color) in zip(result.runs.items(), styles, strict=True):
        angle.plot(run.t, run["angle"] / (2.0 * np.pi), line, lw=width, color=color, label=name)
    angle.set(ylabel="turns")
    angle.legend(frameon=False)
    t = next(iter(result.runs.values())).t
    thrust.plot(t[1:-1], result.expected[1:], color="0.8", lw=6, label="closed form")
    thrust.plot(t[1:-1], result.thrust[1:], "k:", label="multiplier of the constraint")
    thrust.axhline(MASS * G, color="tab:red", lw=1, label="weight")
    thrust.set(xlabel="time (s)", ylabel="thrust on the thread (N)", xlim=(0.0, t[-1]))
    thrust.legend(frameon=False)
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    for name, run in result.runs.items():
        m = run.mechanism
        print(
            f"{name}: {m.nd} variable{'s'[: m.nd != 1]}, {m.nc} constraint{'s'[: m.nc != 1]}, "
            f"{run['angle'][-1]:.9f} rad"
        )
    print(
        f"apart by {result.apart:.0e} rad, off the closed form by {result.off:.0e} rad of {abs(run['angle'][-1]):.0f}"
    )
    print(f"thrust on the thread: off by {np.abs(result.thrust / result.expected - 1.0)[1:].max():.0e} of it")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "13_screw.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
