"""The back of a finger: one muscle pulls on a network of tendons that stretches two joints.

The tendon ends in a knot that floats over the first bone. From there a central slip goes to the second bone and a
lateral band over two joints to the third, both elastic, both slack where nothing stretches them. How the pull is
shared between them depends on how far the finger is bent: the band stretches the last joint first, then the slip
the one before.

    python -m benchmarks.studies.extensor_network --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import leastaction as la
from leastaction.viz import plot_poses, plot_run, save_png
from leastaction.viz.figures import styled

BONES, BACK = (0.045, 0.028, 0.020), 0.006  # lengths, and how far the tendons are from the middle of the bones (m)
MASSES = (0.020, 0.012, 0.007)
KNOT = (0.020, BACK)  # where it lies over the straight finger (m)
PATHS = {
    "central slip": ["knot", "over 0", "under 1"],
    "lateral band": ["knot", "over 0", "middle of 1", "over 1", "under 2"],
}
STIFFNESS = {"central slip": 8e3, "lateral band": 4e3}  # N/m
WEIGHT = np.array([0.0, 0.002 * 9.81, 0.0])  # of the knot, against (N)
PULLS = np.linspace(0.2, 8.6, 25)  # N
STRAIGHT = {"knot.x": KNOT[0], "knot.y": KNOT[1]}


def finger(lengths: dict[str, float]) -> la.Mechanism:
    """Return the finger in the x-y plane with tendons of these lengths; its second and third joint bend downwards."""
    points = {
        0: [("over 0", BONES[0] - 0.006)],
        1: [("under 1", 0.006), ("middle of 1", 0.014)],
        2: [("under 2", 0.005)],
    }
    points[1].append(("over 1", BONES[1] - 0.004))
    tree: list[object] = []
    for k in (2, 1, 0):
        across = MASSES[k] * BONES[k] ** 2 / 12.0
        body = {"mass": MASSES[k], "com": (BONES[k] / 2.0, 0.0, 0.0), "inertia": (0.0, across, across)}
        bone = la.rz({f"joint{k}": -1.0}, name=f"bone{k}", **body) if k else la.pose(name="bone0")
        places = [la.pose(translation=(x, BACK, 0.0), name=name) for name, x in points[k]]
        tree = [bone, [*places, la.tx(BONES[k], name=f"end{k}"), tree]]
    knot = [la.tx("knot.x"), [la.ty("knot.y", name="knot", mass=0.002)]]
    strings = [
        la.ElasticString(PATHS[name], STIFFNESS[name], lengths[name], smoothing=3e-4, name=name) for name in PATHS
    ]
    return la.Mechanism(
        [la.pose(translation=(-0.06, BACK, 0.0), name="muscle"), *tree, *knot],
        [
            la.Gravity((0.0, -9.81, 0.0)),
            la.Damping({"joint1": 2e-3, "joint2": 1e-3, "knot.x": 0.5, "knot.y": 0.5}),
            la.JointSpring("joint1", 0.04, rest=1.2),
            la.JointSpring("joint2", 0.02, rest=1.0),
            la.TendonForce(["muscle", "knot"], "pull"),
            *strings,
        ],
    )


def slack() -> la.Mechanism:
    """Return the finger whose tendons are as long as they are when it is straight."""
    m = finger(dict.fromkeys(PATHS, 1.0))
    return finger({name: float(length(m, m.configuration(STRAIGHT), path)) for name, path in PATHS.items()})


def length(m: la.Mechanism, q: np.ndarray, path: list[str]) -> np.ndarray:
    """Return the length of a path through frames (m), for one configuration or many."""
    return np.linalg.norm(np.diff(m.positions(q, path), axis=-2), axis=-1).sum(axis=-1)


def tensions(m: la.Mechanism, q: np.ndarray) -> list[float]:
    """Return the tensions of slip and band (N): what each does on the knot."""
    at = [m.variables.index(name) for name in STRAIGHT]
    return [float(np.linalg.norm(m.potential(q, name).gradient[at])) for name in PATHS]


def solve(seconds: float = 4.0, dt: float = 1e-3) -> tuple[np.ndarray, np.ndarray, la.Trajectory, float]:
    """Find the places of rest one after the other, then let the pull grow in time.

    Return the places (pulls, 4), the tensions there (pulls, 2), the motion, and the largest net force on the knot at
    rest (N), from the directions of the three tendons alone.
    """
    m = slack()
    q = m.configuration({**STRAIGHT, "joint1": 1.1, "joint2": 0.9})
    rests, shares, unbalanced = [], [], 0.0
    for pull in PULLS:
        q = la.equilibrium(m, q, inputs=[pull]).q
        rests.append(q)
        shares.append(tensions(m, q))
        ends = m.positions(q, ["knot", "muscle", "over 0"])
        to_muscle, ahead = ((end - ends[0]) / np.linalg.norm(end - ends[0]) for end in ends[1:])
        # Slip and band leave the knot side by side.
        unbalanced = max(unbalanced, float(np.linalg.norm(pull * to_muscle + sum(shares[-1]) * ahead - WEIGHT)))
    vi, t = la.MidpointVI(m), dt * np.arange(round(seconds / dt) + 1)
    grown = PULLS[0] + (PULLS[-1] - PULLS[0]) * np.clip((0.5 * (t[1:] + t[:-1]) - 0.1) / 3.4, 0.0, 1.0)
    return np.array(rests), np.array(shares), vi.simulate(vi.start(rests[0]), t, inputs=grown), unbalanced


@styled
def main(output: Path) -> None:
    """Solve, print and draw."""
    rests, shares, run, unbalanced = solve()
    for k in (0, 8, 16, 24):
        bent = np.degrees(rests[k, [run.mechanism.variables.index(j) for j in ("joint1", "joint2")]])
        print(f"{PULLS[k]:4.1f} N: bent by {bent[0]:5.1f} and {bent[1]:5.1f} degrees; "
              f"slip {shares[k, 0]:.2f} N, band {shares[k, 1]:.2f} N")  # fmt: skip
    print(f"forces on the knot balance within {unbalanced:.0e} N")
    share = Figure(figsize=(8.0, 2.6), layout="constrained")
    axes = share.subplots()
    for name, values, look in zip(PATHS, shares.T, ("o-", "s--"), strict=True):
        axes.plot(PULLS, values, look, ms=4, label=name)
    axes.set(xlabel="pull of the muscle (N)", ylabel="tension (N)", title="how the pull is shared at rest")
    axes.legend(frameon=False)
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_poses(run, [0.0, 1.2, 4.0]), plot_run(run, ["joint1", "joint2", "pull"]), share]
    save_png(figures, output / "extensor_network.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("output"))
    main(parser.parse_args().out)
