"""A chain of pendulums of any length: its energy over a long fall, and the time of a step by the number of links.

python examples/10_n_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.chain import pendulum_chain
from leastaction.viz import plot_energy, plot_poses, save_png


def chain(links: int) -> tuple[la.MidpointVI, la.mechanics.State]:
    """Return a chain of 2 m and 2 kg, and its start: level and at rest."""
    vi = la.MidpointVI(pendulum_chain(links, length=2.0 / links, mass=2.0 / links, inertia=(1e-4, 1e-4, 1e-4)))
    return vi, vi.start(np.r_[np.pi / 2.0, np.zeros(links - 1)])


def main(output: Path) -> None:
    """Simulate, print and draw."""
    vi, level = chain(5)
    run = vi.simulate(level, 1e-3 * np.arange(10001))
    energy = run.energy()
    off = np.abs(energy.total - energy.total[0]).max() / np.ptp(energy.potential)
    print(f"5 links, 10 s in 1 ms steps: energy within {100.0 * off:.2g} % of that of the fall")
    for links in (5, 20, 80, 320):
        vi, level = chain(links)
        begun = time.process_time()
        vi.simulate(level, 1e-3 * np.arange(201))
        print(f"{links:4} links: {5.0 * (time.process_time() - begun):.4f} ms a step")
    output.mkdir(parents=True, exist_ok=True)
    save_png([plot_poses(run, [0.3, 0.6, 0.9]), plot_energy(run)], output / "10_n_pendulum.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
