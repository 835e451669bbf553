"""A drone among pillars and an arm of ball joints, by quaternions and by three angles: iterations and seconds.

After the problems of S. Teng and others, "Riemannian Direct Trajectory Optimization of Rigid Bodies on Matrix Lie
Groups" (2025): a drone that crosses a field of vertical cylinders and ends with another attitude, and a manipulator
whose bodies end with wanted orientations, within bounds of what drives them. Their numbers are not known here; sizes,
fields and goals are drawn, always the same ones. What converges from a line in the space of states, without any help,
is compared with what three angles make of the same problem.

    python -m benchmarks.attitudes
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import leastaction as la
from leastaction.elements import BodyWrench, JointForce
from leastaction.limits import FunctionQuantity, Within
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal import Status

ROTORS = {"front": (0.17, 0.0, 1), "left": (0.0, 0.17, -1), "back": (-0.17, 0.0, 1), "right": (0.0, -0.17, -1)}
STEPS, FLIGHT, REACH = 80, 4.0, 1.6  # steps of each problem, and how long it takes (s)
FIELDS, PILLARS, ARMS = 4, 7, 3


@dataclass
class Problem:
    """A search to be made, and its name."""

    name: str
    solve: Callable[[], la.OptimizationResult]


def line(system: la.MidpointSystem, begin: Array, end: Array) -> Array:
    """Return states (N+1, nx) on the shortest way from one to another, by smooth steps."""
    s = np.linspace(0.0, 1.0, system.N + 1)[:, None]
    s = (3.0 - 2.0 * s) * s**2
    way = system.difference(end[None], begin[None])
    return np.asarray(system.plus(np.tile(begin, (system.N + 1, 1)), s * way))


def posed(m: la.Mechanism, joint: str, phi: Array, known: dict[str, float]) -> dict[str, float]:
    """Return the numbers of a configuration in which a joint is turned by a vector (rad), whatever its coordinates."""
    q = rotations.exponential(phi)
    if f"{joint}.qw" in m.coordinates:
        return known | dict(zip((f"{joint}.q{a}" for a in "wxyz"), q.tolist(), strict=True))
    w, x, y, z = q
    # R = Rx(a) Ry(b) Rz(c)
    b = np.arcsin(np.clip(2.0 * (x * z + w * y), -1.0, 1.0))
    a = np.arctan2(2.0 * (w * x - y * z), 1.0 - 2.0 * (x * x + y * y))
    c = np.arctan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (y * y + z * z))
    return known | dict(zip((f"{joint}.r{e}" for e in "xyz"), (float(a), float(b), float(c)), strict=True))


def flight(axes: str, seed: int) -> Problem:
    """A drone crosses a field of pillars by 6 m and ends with its nose turned, by anything up to half a turn."""
    rng = np.random.default_rng([1, seed])
    arms = [la.pose(translation=(x, y, 0.02), name=name) for name, (x, y, _) in ROTORS.items()]
    thrusts = [BodyWrench(name, (0, 0, name), (0, 0, {name: 0.016 * way})) for name, (*_, way) in ROTORS.items()]
    m = la.Mechanism(
        [la.free("drone", axes=axes, mass=0.5, inertia=(2.3e-3, 2.3e-3, 4e-3)), arms], [la.Gravity(), *thrusts]
    )
    system = la.MidpointSystem(la.MidpointVI(m, threads=1), np.linspace(0.0, FLIGHT, STEPS + 1))
    phi = np.array([0.0, 0.0, rng.uniform(1.5, 3.1)])
    begin, end = (
        system.integrator.start(m.configuration(posed(m, "drone", turn, {"drone.x": x, "drone.z": 1.0}))).x
        for turn, x in ((np.zeros(3), -3.0), (phi, 3.0))
    )
    hover = np.full(4, 0.5 * 9.81 / 4.0)
    Q_final = np.r_[np.full(3, 200.0), np.full(3, 50.0), np.full(6, 20.0)]
    cost = la.QuadraticCost(
        end, hover, Q=np.r_[np.zeros(6), np.full(6, 1e-2)], R=[0.1] * 4, Q_final=Q_final, space=system
    )
    centers = np.column_stack([rng.uniform(-2.3, 2.3, PILLARS), rng.uniform(-0.8, 0.8, PILLARS)])
    limits: list[Any] = [la.Bound(list(ROTORS), 0.0, 4.0)]
    for i, (x, y) in enumerate(centers):
        apart = FunctionQuantity(f"pillar {i}", lambda s, x=x, y=y: (s[:, 0] - x) ** 2 + (s[:, 1] - y) ** 2)
        limits.append(Within(apart, min=0.35**2))
    guess = line(system, begin, end)
    return Problem(f"drone {seed}", lambda: la.optimize(
        system, cost, initial=(guess, np.tile(hover, (STEPS, 1))), limits=limits, max_iterations=300
    ))  # fmt: skip


def reach(axes: str, seed: int) -> Problem:
    """Three bodies on ball joints swing from where they hang to drawn orientations, by bounded torques."""
    rng = np.random.default_rng([2, seed])
    tree: list[Any] = []
    names = ("shoulder", "elbow", "wrist")
    for name in reversed(names):
        body = la.ball(name, axes=axes, mass=1.0, com=(0.0, 0.0, -0.15), inertia=(8e-3, 8e-3, 1e-3))
        tree = [body, [la.tz(-0.3), tree]] if tree else [body]
    letter = "w" if axes == "quaternion" else "r"
    motors = [JointForce(f"{name}.{letter}{a}", f"{name} {a}") for name in names for a in "xyz"]
    m = la.Mechanism(tree, [la.Gravity(), la.Damping(0.05), *motors])
    system = la.MidpointSystem(la.MidpointVI(m, threads=1), np.linspace(0.0, REACH, STEPS + 1))
    begin = system.integrator.start(m.configuration()).x
    known: dict[str, float] = {}
    for name in names:
        axis = rng.standard_normal(3)
        known = posed(m, name, axis / np.linalg.norm(axis) * rng.uniform(1.0, 2.6), known)
    end = system.integrator.start(m.configuration(known)).x
    n = m.nv
    cost = la.QuadraticCost(
        end, np.zeros(9), Q=np.r_[np.zeros(n), np.full(n, 1e-2)], R=[1e-2] * 9,
        Q_final=np.r_[np.full(n, 200.0), np.full(n, 20.0)], space=system,
    )  # fmt: skip
    limits = [la.Bound("*", -12.0, 12.0, of="input")]
    return Problem(f"arm {seed}", lambda: la.optimize(
        system, cost, initial=(begin, np.zeros((STEPS, 9))), limits=limits, max_iterations=300
    ))  # fmt: skip


def problems(axes: str) -> Iterator[Problem]:
    """Yield all of them, by quaternions or by angles."""
    yield from (flight(axes, seed) for seed in range(FIELDS))
    yield from (reach(axes, seed) for seed in range(ARMS))


def told(problem: Problem) -> tuple[str, int]:
    """Return what is said of a search, and how many iterations it took; none where it came to no minimum."""
    begun = time.thread_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = problem.solve()
        except la.LeastActionError as error:
            return f"{type(error).__name__}", 0
    seconds, good = time.thread_time() - begun, found.status is Status.CONVERGED
    return f"{found.iterations:4d} iterations, {seconds:6.2f} s, cost {found.cost:9.3f}, {found.status.name}", (
        found.iterations if good else 0
    )


def main() -> None:
    """Print each search, by quaternions and by angles, and the medians of what converged."""
    print(f"{STEPS} steps each; seconds of this thread")
    iterations: dict[str, list[int]] = {"quaternion": [], "xyz": []}
    for pair in zip(problems("quaternion"), problems("xyz"), strict=True):
        for axes, problem in zip(iterations, pair, strict=True):
            said, count = told(problem)
            iterations[axes].append(count)
            print(f"{problem.name:9s} {axes:10s} {said}", flush=True)
    for axes, counts in iterations.items():
        good = [count for count in counts if count]
        print(f"{axes}: {len(good)} of {len(counts)} end in a minimum, after {np.median(good):.0f} iterations (median)")


if __name__ == "__main__":
    main()
