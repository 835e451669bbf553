"""The back of a finger: one muscle pulls on a network of tendons that stretches two joints.

The tendon ends in a knot that floats over the first bone. From there a central slip goes to the second bone and a
lateral band over two joints to the third, both elastic, both slack where nothing stretches them. How the pull is
shared between them depends on how far the finger is bent: the band stretches the last joint first, then the slip
the one before.

    python examples/16_extensor_network.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import (
    Damping,
    ElasticString,
    Gravity,
    JointSpring,
    Mechanism,
    MidpointVI,
    TendonForce,
    Trajectory,
    equilibrium,
    pose,
    rz,
    tx,
    ty,
)

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


def finger(lengths: dict[str, float]) -> Mechanism:
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
        bone = rz({f"joint{k}": -1.0}, name=f"bone{k}", **body) if k else pose(name="bone0")
        places = [pose(translation=(x, BACK, 0.0), name=name) for name, x in points[k]]
        tree = [bone, [*places, tx(BONES[k], name=f"end{k}"), tree]]
    knot = [tx("knot.x"), [ty("knot.y", name="knot", mass=0.002)]]
    strings = [ElasticString(PATHS[name], STIFFNESS[name], lengths[name], smoothing=3e-4, name=name) for name in PATHS]
    return Mechanism(
        [pose(translation=(-0.06, BACK, 0.0), name="muscle"), *tree, *knot],
        [
            Gravity((0.0, -9.81, 0.0)),
            Damping({"joint1": 2e-3, "joint2": 1e-3, "knot.x": 0.5, "knot.y": 0.5}),
            JointSpring("joint1", 0.04, rest=1.2),
            JointSpring("joint2", 0.02, rest=1.0),
            TendonForce(["muscle", "knot"], "pull"),
            *strings,
        ],
    )


def slack() -> Mechanism:
    """Return the finger whose tendons are as long as they are when it is straight."""
    m = finger(dict.fromkeys(PATHS, 1.0))
    return finger({name: float(length(m, m.configuration(STRAIGHT), path)) for name, path in PATHS.items()})


def length(m: Mechanism, q: np.ndarray, path: list[str]) -> np.ndarray:
    """Return the length of a path through frames (m), for one configuration or many."""
    return np.linalg.norm(np.diff(m.positions(q, path), axis=-2), axis=-1).sum(axis=-1)


def tensions(m: Mechanism, q: np.ndarray) -> list[float]:
    """Return the tensions of slip and band (N): what each does on the knot."""
    at = [m.variables.index(name) for name in STRAIGHT]
    return [float(np.linalg.norm(m.potential(q, name).gradient[at])) for name in PATHS]


@dataclass(frozen=True)
class Result:
    """Places of rest by pull, with the tensions there, and a motion under a pull that grows.

    ``unbalanced``: the largest net force on the knot at rest (N), from the directions of the three tendons alone.
    """

    mechanism: Mechanism
    rests: np.ndarray  # (pulls, 4)
    shares: np.ndarray  # (pulls, 2), N
    unbalanced: float
    run: Trajectory


def solve(seconds: float = 4.0, dt: float = 1e-3) -> Result:
    """Find the places of rest one after the other, then let the pull grow in time."""
    m = slack()
    q = m.configuration({**STRAIGHT, "joint1": 1.1, "joint2": 0.9})
    rests, shares, unbalanced = [], [], 0.0
    for pull in PULLS:
        q = equilibrium(m, q, inputs=[pull]).q
        rests.append(q)
        shares.append(tensions(m, q))
        ends = m.positions(q, ["knot", "muscle", "over 0"])
        to_muscle, ahead = ((end - ends[0]) / np.linalg.norm(end - ends[0]) for end in ends[1:])
        # Slip and band leave the knot side by side.
        unbalanced = max(unbalanced, float(np.linalg.norm(pull * to_muscle + sum(shares[-1]) * ahead - WEIGHT)))
    vi, t = MidpointVI(m), dt * np.arange(round(seconds / dt) + 1)
    grown = PULLS[0] + (PULLS[-1] - PULLS[0]) * np.clip((0.5 * (t[1:] + t[:-1]) - 0.1) / 3.4, 0.0, 1.0)
    run = vi.simulate(vi.start(rests[0]), t, inputs=grown)
    return Result(m, np.array(rests), np.array(shares), unbalanced, run)


def draw(result: Result) -> Figure:
    """Return the figure: the finger under some pulls, its joints, and how the pull is shared."""
    figure = Figure(figsize=(11.5, 5.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.1])
    m = result.mechanism
    for axis, k in zip(left.subplots(3, 1, sharex=True), (0, 8, 24), strict=True):
        q = result.rests[k]
        axis.plot(*1e3 * m.positions(q, ["bone0", "end0", "end1", "end2"])[:, :2].T, "o-", color="0.3", lw=5, ms=7)
        axis.plot(*1e3 * m.positions(q, ["muscle", "knot"])[:, :2].T, color="tab:red", lw=1.5)
        for (_, path), color in zip(PATHS.items(), ("tab:blue", "tab:green"), strict=True):
            axis.plot(*1e3 * m.positions(q, path)[:, :2].T, color=color, lw=1.5)
        axis.plot(*1e3 * m.positions(q, ["knot"])[:, :2].T, "o", color="tab:red", ms=5)
        axis.set(aspect="equal", ylabel="y (mm)", xlim=(-30, 100), ylim=(-60, 20), title=f"{PULLS[k]:.1f} N")
    axis.set_xlabel("x (mm)")
    joints, share = right.subplots(2, 1)
    pull = np.interp(result.run.t, 0.5 * (result.run.t[1:] + result.run.t[:-1]), result.run.inputs[:, 0])
    for name, color in (("joint1", "tab:purple"), ("joint2", "tab:orange")):
        i = m.variables.index(name)
        joints.plot(PULLS, np.degrees(result.rests[:, i]), "o", ms=4, color=color, label=f"{name}, at rest")
        joints.plot(pull, np.degrees(result.run[name]), color=color, lw=1, label=f"{name}, as the pull grows")
    joints.set(xlabel="pull of the muscle (N)", ylabel="bent by (degrees)")
    joints.legend(frameon=False, fontsize=8)
    for (name, _), color, values in zip(PATHS.items(), ("tab:blue", "tab:green"), result.shares.T, strict=True):
        share.plot(PULLS, values, "o-", ms=4, color=color, label=name)
    share.set(xlabel="pull of the muscle (N)", ylabel="tension (N)")
    share.legend(frameon=False)
    return figure


def main(output: Path) -> Result:
    """Solve, print and draw."""
    result = solve()
    for k in (0, 8, 16, 24):
        bent = np.degrees(result.rests[k, [result.mechanism.variables.index(j) for j in ("joint1", "joint2")]])
        slip, band = result.shares[k]
        print(
            f"{PULLS[k]:4.1f} N: bent by {bent[0]:5.1f} and {bent[1]:5.1f} degrees; "
            f"slip {slip:.2f} N, band {band:.2f} N"
        )
    print(f"forces on the knot balance within {result.unbalanced:.0e} N")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "16_extensor_network.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
