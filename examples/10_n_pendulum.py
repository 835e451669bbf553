"""A chain of pendulums of any length: its energy over a long fall, and the time of a step by the number of links.

python examples/10_n_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import MidpointVI, Trajectory
from leastaction.models.chain import pendulum_chain

LINKS, LENGTH, DT = 20, 0.1, 1e-3
COUNTS = (5, 10, 20, 40, 80, 160, 320)
DISSERTATION = {40: 19.5, 80: 413.0}  # ms a step of its program, run on a machine of today


@dataclass(frozen=True)
class Result:
    """The fall of the chain, and the time of a step (s) by the number of links."""

    run: Trajectory
    energy: np.ndarray  # total (J), over the steps
    scale: float  # of the energy: between hanging and level (J)
    seconds: dict[int, float]


def chain(links: int) -> MidpointVI:
    """Return a chain of links of 0.1 m and 0.1 kg."""
    return MidpointVI(pendulum_chain(links, length=LENGTH, mass=0.1, inertia=(1e-4, 1e-4, 1e-4)))


def solve() -> Result:
    """Let the chain go from level, and time steps of chains that hang in a bow."""
    vi = chain(LINKS)
    level = np.zeros(LINKS)
    level[0] = np.pi / 2.0
    run = vi.simulate(vi.start(level), DT * np.arange(10001))
    energy = run.energy()
    m = vi.mechanism
    scale = m.energy(level, 0.0 * level).total - m.energy(0.0 * level, 0.0 * level).total
    seconds = {}
    for links in COUNTS:
        one = chain(links)
        start, t = one.start(np.full(links, 0.5 / links)), DT * np.arange(101)
        took = []
        for _ in range(3):
            begun = time.process_time()
            one.simulate(start, t)
            took.append(time.process_time() - begun)
        seconds[links] = min(took) / 100
    return Result(run, energy.kinetic + energy.potential, float(scale), seconds)


def draw(result: Result) -> Figure:
    """Return the figure: the chain at some instants, its energy, and times."""
    figure = Figure(figsize=(11.5, 5.0), layout="constrained")
    shape, energy, times = figure.subplots(1, 3)
    m = result.run.mechanism
    ends = ["world", *(f"end{k}" for k in range(LINKS))]
    for moment, shade in ((0.0, 0.8), (0.3, 0.65), (0.6, 0.5), (0.9, 0.25), (1.2, 0.0)):
        points = m.positions(result.run.q[round(moment / DT)], ends)
        shape.plot(points[:, 1], points[:, 2], color=str(shade), marker=".", lw=1.5, label=f"{moment:g} s")
    shape.set(
        aspect="equal",
        xlabel="y (m)",
        ylabel="z (m)",
        title=f"{LINKS} links, let go",
        xlim=(-2.1, 2.2),
        ylim=(-2.1, 0.9),
    )
    shape.legend(fontsize=8, ncols=3, loc="upper center")
    middle = 0.5 * (result.run.t[1:] + result.run.t[:-1])
    energy.plot(middle, 100.0 * (result.energy - result.energy[0]) / result.scale, lw=0.6)
    energy.set(xlabel="time (s)", ylabel="energy gained (% of what the fall gives)", title="energy", xlim=(0.0, 10.0))
    n = list(result.seconds)
    times.loglog(n, [1e3 * s for s in result.seconds.values()], "o-", color="tab:green", label="today")
    times.loglog(
        list(DISSERTATION), list(DISSERTATION.values()), "s--", color="0.5", label="the dissertation's program"
    )
    times.set(xlabel="links", ylabel="time of a step (ms)", title="time", xticks=n, xticklabels=n)
    times.minorticks_off()
    times.legend(frameon=False)
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    band = 100.0 * np.ptp(result.energy) / result.scale
    halves = [100.0 * np.mean(half - result.energy[0]) / result.scale for half in np.split(result.energy, 2)]
    print(f"{LINKS} links, 10 s in 1 ms steps: energy within {band:.2g} % of that of the fall")
    print(f"its mean is {halves[0]:+.2g} % off in the first half, {halves[1]:+.2g} % in the second")
    for links, seconds in result.seconds.items():
        then = f" (dissertation's program: {DISSERTATION[links]:g} ms)" if links in DISSERTATION else ""
        print(f"{links:4} links: {1e3 * seconds:.4f} ms a step{then}")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "10_n_pendulum.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
