"""Rotations that are unit quaternions beside three angles: ``python -m benchmarks.rotations [--quick] [--only NAME]``.

The same mechanism twice, from the same start with the same velocities, over the same steps. What is timed, a step of a
whole roll-out, A and B, and the contracted second order packed as an optimisation asks for it, is done in turns, and
the best of each counts: the ratio of the two is the same on a machine that others use.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402

import leastaction as la  # noqa: E402
from benchmarks import unit  # noqa: E402
from benchmarks.settings import MICRO  # noqa: E402
from leastaction.mechanics import Gravity, JointForce, Mechanism, MidpointVI, ball, free, world  # noqa: E402

__all__ = ["CASES", "compare"]

_DT, _STEPS = 0.002, 20
_QUATERNION, _ANGLES = "quaternion", "xyz"
_INERTIA = (0.02, 0.03, 0.025)


def _pendulum(axes: str) -> Mechanism:
    return Mechanism([ball("b", axes=axes, mass=1.0, com=(0.0, 0.1, -0.5), inertia=_INERTIA)], [Gravity()])


def _body(axes: str) -> Mechanism:
    return Mechanism([free("b", axes=axes, mass=1.0, inertia=_INERTIA)], [Gravity()])


def _chain(axes: str) -> Mechanism:
    place = world()
    for k in range(6):
        place = place.ball(f"b{k}", axes=axes, mass=1.0, com=(0.0, 0.1, -0.25), inertia=_INERTIA).tz(-0.5)
    return Mechanism(place, [Gravity()])


def _quadruped(axes: str) -> Mechanism:
    base = world().free("base", axes=axes, mass=2.0, inertia=_INERTIA)
    hinges = []
    for k, (x, y) in enumerate(((0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1))):
        names = [f"leg{k}.{part}" for part in ("roll", "hip", "knee")]
        hip = base.tx(x).ty(y).rx(names[0], mass=0.2, inertia=(1e-4, 1e-4, 1e-4))
        thigh = hip.ry(names[1], mass=0.3, com=(0.0, 0.0, -0.1), inertia=(2e-3, 2e-3, 2e-4))
        thigh.tz(-0.2).ry(names[2], mass=0.2, com=(0.0, 0.0, -0.1), inertia=(1e-3, 1e-3, 1e-4))
        hinges += names
    return Mechanism(base, [Gravity(), *(JointForce(name, input=f"{name}.torque") for name in hinges)])


def _robot(name: str, urdf: str) -> Callable[[str], Mechanism]:
    def load(axes: str) -> Mechanism:
        import example_robot_data

        folder = Path(example_robot_data.getModelPath(urdf))
        return la.load(folder / urdf, floating=True, axes=axes, inertia="repair").mechanism

    load.__name__ = name
    return load


CASES: dict[str, Callable[[str], Mechanism]] = {
    "ball": _pendulum,
    "free body": _body,
    "chain of six balls": _chain,
    "quadruped": _quadruped,
    "solo12": _robot("solo12", "solo_description/robots/solo12.urdf"),
    "talos": _robot("talos", "talos_data/robots/talos_reduced.urdf"),
}
"""Mechanisms by name, each made with the axes that it is given."""


def _jobs(m: Mechanism, x0: np.ndarray) -> tuple[list[Callable[[], object]], float, float]:
    """Return what is timed, and Newton iterations and factorisations of a step."""
    vi = MidpointVI(m, threads=1)
    t, u = _DT * np.arange(_STEPS + 1), np.zeros((_STEPS, m.nu))
    out = vi.core.roll_out(t, x0, None, u, None)
    if out.steps < _STEPS:
        raise RuntimeError(f"the roll-out failed after {out.steps} of {_STEPS} steps")
    first = vi.linearize_arrays(t, out.x, u)
    weights = np.random.default_rng(0).normal(size=(_STEPS, 2 * m.nv))
    return (
        [
            lambda: vi.core.roll_out(t, x0, None, u, None),
            lambda: vi.linearize_arrays(t, out.x, u, out=first),
            lambda: first.packed_curvature_all(weights),
        ],
        out.iterations / _STEPS,
        out.factorizations / _STEPS,
    )


def compare(jobs: list[Callable[[], object]], rounds: int) -> list[float]:
    """Return the least time (s) of each of some calls that are done in turns."""
    best = [float("inf")] * len(jobs)
    for _ in range(rounds):
        for k, job in enumerate(jobs):
            began = time.perf_counter()
            job()
            best[k] = min(best[k], time.perf_counter() - began)
    return best


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rotations", description="Quaternions beside angles.")
    parser.add_argument("--quick", action="store_true", help="a few rounds, to see that it runs")
    parser.add_argument("--only", action="append", choices=sorted(CASES), help="only this case, may be given again")
    arguments = parser.parse_args()
    rounds = 100 if arguments.quick else 2000
    measured = unit.measure(0.05 if arguments.quick else 0.5)
    note = measured if isinstance(measured, str) else f"{measured.best / MICRO:.1f} us"
    print(f"unit: {note}; times of one step in us, with quaternions and with angles, and their ratio")
    print(f"{'':20s} {'it. fact.':>20s} {'step':>20s} {'A, B':>20s} {'second order':>20s}")
    for name in arguments.only or CASES:
        jobs: list[list[Callable[[], object]]] = []
        counts = []
        for axes in (_QUATERNION, _ANGLES):
            m = CASES[name](axes)
            rates = 0.3 * np.random.default_rng(1).normal(size=m.nv)
            x0 = MidpointVI(m).start(m.configuration(), rates).x
            work, iterations, factorizations = _jobs(m, x0)
            jobs.append(work)
            counts.append(f"{iterations:.1f} {factorizations:.1f}")
        line = f"{name:20s} {' / '.join(counts):>20s}"
        for pair in zip(*jobs, strict=True):
            mine, theirs = (best / _STEPS / MICRO for best in compare(list(pair), rounds))
            line += f"{mine:7.2f} {theirs:6.2f} {mine / theirs:6.2f}"
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
