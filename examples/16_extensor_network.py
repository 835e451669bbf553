"""The back of a finger: one muscle pulls on a network of tendons that stretches two joints.

The tendon ends in a knot that floats over the first bone. From there a central slip goes to the second bone and a
lateral band over two joints to the third, both elastic: the band stretches the last joint first, then the slip the
one before.

    python examples/16_extensor_network.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import leastaction as la
from leastaction.viz import BLUE, VERMILION, new_figure, plot_poses, plot_run, save_png, styled

BACK = 0.006  # how far the tendons are from the middle of the bones (m)
FRAMES = [
    la.pose(translation=(-0.06, BACK, 0.0), name="muscle"), la.pose(translation=(0.039, BACK, 0.0), name="over 0"),
    la.tx("knot.x"), [la.ty("knot.y", name="knot", mass=0.002)],
    la.tx(0.045), [la.rz({"joint1": -1.0}, mass=0.012, com=(0.014, 0.0, 0.0), inertia=(0.0, 8e-7, 8e-7)), [
        la.pose(translation=(0.006, BACK, 0.0), name="under 1"),
        la.pose(translation=(0.014, BACK, 0.0), name="middle of 1"),
        la.pose(translation=(0.024, BACK, 0.0), name="over 1"),
        la.tx(0.028), [la.rz({"joint2": -1.0}, mass=0.007, com=(0.01, 0.0, 0.0), inertia=(0.0, 2e-7, 2e-7)), [
            la.pose(translation=(0.005, BACK, 0.0), name="under 2"), la.tx(0.02, name="tip"),
        ]],
    ]],
]  # fmt: skip
SLIP, BAND = ["knot", "over 0", "under 1"], ["knot", "over 0", "middle of 1", "over 1", "under 2"]
ELEMENTS = [
    la.Gravity((0.0, -9.81, 0.0)),
    la.Damping({"joint1": 2e-3, "joint2": 1e-3, "knot.x": 0.5, "knot.y": 0.5}),
    la.JointSpring("joint1", 0.04, rest=1.2),
    la.JointSpring("joint2", 0.02, rest=1.0),
    la.elements.TendonForce(["muscle", "knot"], "pull"),
    la.elements.ElasticString(SLIP, 8e3, 0.031, smoothing=3e-4, name="slip"),  # as long as on the straight finger (m)
    la.elements.ElasticString(BAND, 4e3, 0.058, smoothing=3e-4, name="band"),
]


@styled
def plot_shares(run: la.Trajectory) -> Figure:
    """Draw what slip and band pull with."""
    figure = new_figure(8.0, 2.2, layout=None)
    axes = figure.add_axes((0.0975, 0.23, 0.884, 0.6))
    for (name, tension), colour in zip(run.tensions().items(), (BLUE, VERMILION), strict=True):
        axes.plot(0.5 * (run.t[1:] + run.t[:-1]), tension, color=colour, label=name)
    axes.legend(loc="upper left")
    axes.set(xlabel="time (s)", ylabel="tension (N)", xlim=(0.0, run.t[-1]))
    return figure


def main(output: Path) -> None:
    """Find places of rest under more and more pull, let the pull grow in time, print and draw."""
    m = la.Mechanism(FRAMES, ELEMENTS)
    start = q = m.configuration({"knot.x": 0.02, "knot.y": BACK, "joint1": 1.1, "joint2": 0.9})
    knot = [m.variables.index("knot.x"), m.variables.index("knot.y")]
    for pull in np.linspace(0.2, 8.6, 8):
        q = la.equilibrium(m, q, inputs=[pull]).q
        start = q if pull == 0.2 else start
        bent = np.degrees([m.named(q)[joint] for joint in ("joint1", "joint2")])
        slip, band = (np.linalg.norm(m.potential(q, name).gradient[knot]) for name in ("slip", "band"))
        print(f"{pull:.1f} N: bent by {bent[0]:.1f} and {bent[1]:.1f} degrees; slip {slip:.2f} N, band {band:.2f} N")
    vi, t = la.MidpointVI(m), np.linspace(0.0, 4.0, 4001)
    run = vi.simulate(vi.start(start), t, inputs=np.interp(t[1:], [0.1, 3.5], [0.2, 8.6]))
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_poses(run, [0.0, 1.2, 4.0]), plot_run(run, ["joint1", "joint2", "pull"]), plot_shares(run)]
    save_png(figures, output / "16_extensor_network.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
