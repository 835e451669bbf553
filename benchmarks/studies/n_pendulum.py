"""A chain of pendulums of any length: its energy over a long fall, and the time of a step by the number of links.

python -m benchmarks.studies.n_pendulum --out pictures
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import leastaction as la
from leastaction.models.chain import pendulum_chain
from leastaction.viz import plot_energy, save_png
from leastaction.viz.figures import styled

LINKS, DT = 20, 1e-3
COUNTS = (5, 10, 20, 40, 80, 160, 320)
DISSERTATION = {40: 19.5, 80: 413.0}  # ms a step of its program, run on a machine of today


def chain(links: int) -> la.MidpointVI:
    """Return a chain of links of 0.1 m and 0.1 kg."""
    return la.MidpointVI(pendulum_chain(links, length=0.1, mass=0.1, inertia=(1e-4, 1e-4, 1e-4)))


def fall() -> tuple[la.Trajectory, float]:
    """Let a chain go from level; return its motion, and the energy between hanging and level (J)."""
    vi = chain(LINKS)
    level = np.r_[np.pi / 2.0, np.zeros(LINKS - 1)]
    energies = [vi.mechanism.energy(q, np.zeros(LINKS)).total for q in (level, np.zeros(LINKS))]
    return vi.simulate(vi.start(level), DT * np.arange(10001)), energies[0] - energies[1]


def seconds(links: int) -> float:
    """Return the time of a step (s) of a chain that hangs in a bow, the shortest of three."""
    vi, took = chain(links), []
    for _ in range(3):
        begun = time.process_time()
        vi.simulate(vi.start(np.full(links, 0.5 / links)), DT * np.arange(101))
        took.append(time.process_time() - begun)
    return min(took) / 100


@styled
def main(output: Path) -> None:
    """Simulate, print and draw."""
    run, scale = fall()
    energy = 100.0 * (run.energy().total - run.energy().total[0]) / scale
    print(f"{LINKS} links, 10 s in 1 ms steps: energy within {np.ptp(energy):.2g} % of that of the fall")
    halves = [np.mean(half) for half in np.split(energy, 2)]
    print(f"its mean is {halves[0]:+.2g} % off in the first half, {halves[1]:+.2g} % in the second")
    today = {links: 1e3 * seconds(links) for links in COUNTS}
    for links, each in today.items():
        then = f" (dissertation's program: {DISSERTATION[links]:g} ms)" if links in DISSERTATION else ""
        print(f"{links:4} links: {each:.4f} ms a step{then}")
    both = Figure(figsize=(8.0, 3.4), layout="constrained")
    shape, times = both.subplots(1, 2)
    for k, shade in ((0, "0.8"), (300, "0.6"), (600, "0.4"), (900, "0.2"), (1200, "0.0")):
        points = run.mechanism.positions(run.q[k], ["world", *(f"end{i}" for i in range(LINKS))])
        shape.plot(points[:, 1], points[:, 2], ".-", color=shade, label=f"{run.t[k]:g} s")
    shape.set(aspect="equal", xlabel="y (m)", ylabel="z (m)", title=f"{LINKS} links, let go")
    shape.legend(fontsize=8)
    times.loglog(*zip(*today.items(), strict=True), "o-", *zip(*DISSERTATION.items(), strict=True), "s--")
    times.set(xlabel="links", ylabel="time of a step (ms)", title="today; dashed: the dissertation's program")
    output.mkdir(parents=True, exist_ok=True)
    save_png([both, plot_energy(run)], output / "n_pendulum.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("output"))
    main(parser.parse_args().out)
