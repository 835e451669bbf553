"""``python -m benchmarks.cassie path/to/cassie.xml --out DIR``: Cassie, hung up by its pelvis, steps in the air.

Its MJCF closes four loops by a `connect` each, over rods and leaf springs. Here they are assembled from a rough guess,
let fall, and moved within what motors and joints of the file can do.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import leastaction as la

PELVIS = [f"cassie-pelvis{'.joint' * k}" for k in range(4)]
BENT = {"hip-pitch": 0.5, "knee": -1.2, "tarsus": 1.4, "foot-crank": -1.5, "plantar-rod": 1.5, "foot": -1.6}
FEET = ("left-foot", "right-foot")
T = np.linspace(0.0, 0.4, 101)


def assembled(model: la.Model, off: float = 0.2, seed: int = 0) -> la.ConfigurationProjection:
    """Return the loops closed from a guess that is off by so much in every joint (rad)."""
    m, bent = model.mechanism, {f"{side}-{name}": q for side in ("left", "right") for name, q in BENT.items()}
    guess = m.configuration({**model.reference, **bent})
    return la.project_configuration(m, guess + np.random.default_rng(seed).uniform(-off, off, m.nq))


def step(model: la.Model) -> la.Followed:
    """Return how the feet swing to and fro and up, from rest on the springs."""
    m = model.mechanism
    start = la.equilibrium(m, assembled(model, 0.0).q, hold=[name.removesuffix(".input") for name in m.inputs]).q
    s = np.sin(np.pi * T / T[-1]) ** 2
    swing = np.stack([0.3 * s * np.sin(2.0 * np.pi * T / T[-1]), 0.0 * s, 0.12 * s], axis=1)
    left, right = m.positions(start, FEET)
    paths = dict(zip(FEET, (left + swing, right + swing * [-1.0, 1.0, 1.0]), strict=True))
    return la.follow(m, paths, limits=model.limits, t=T, start=la.MidpointVI(m).start(start))


def main(file: Path, output: Path) -> None:
    """Assemble, let fall, move, print and draw."""
    model = la.load(file, fixed=PELVIS, axes="xyz")
    m, vi, closed = model.mechanism, la.MidpointVI(model.mechanism), assembled(model)
    print(f"{m.nq} variables, {m.nc} constraints of rank {m.constraint_rank(closed.q)}, {closed.iterations} steps")
    fall = vi.simulate(vi.start(closed.q), np.linspace(0.0, 1.0, 2001))
    began = time.perf_counter()
    found = step(model)
    print(f"{found}\nin {time.perf_counter() - began:.1f} s; active limits:")
    print(*(line for line in str(found.result.limits).splitlines()[1:] if " 0 of " not in line), sep="\n")
    for name, run in (("falls", fall), ("steps", found.trajectory)):
        open_, energy = np.abs(m.constraint_values(run.q)).max(), vi.balance(run)
        print(f"{name}: closed to {open_:.0e} m, energy off by {energy.swing:.1e} J, kinetic {energy.scale:.1f} J")
    view = la.show(found.trajectory, shapes=model.shapes, traces=FEET, title="Cassie")
    output.mkdir(parents=True, exist_ok=True)
    view.save(output / "cassie.png", at=0.13, size=(640, 560))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[sys.argv.index("--out") + 1] if "--out" in sys.argv else "output"))
