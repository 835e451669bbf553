"""A scissor lift that hangs and swings: many closed loops, one degree of freedom (dissertation 5.1).

The lift of `leastaction.models.scissor_lift` is simulated with all its links and pins, in steps of 10 ms and, to
compare, in steps a tenth as long. Its links pass upright twice in each swing, where the constraints lose rank.

    python examples/05_scissor_lift.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction.viz import plot_energy, plot_poses, plot_run, save_png

T = np.linspace(0.0, 5.0, 501)


def swing(t: np.ndarray) -> la.Trajectory:
    """Return the lift of five segments, let go with its links 0.6 rad below the level."""
    m = scissor_lift(5)
    vi = la.MidpointVI(m)
    return vi.simulate(vi.start(*at_angle(m, 0.6)), t)


def main(output: Path) -> None:
    """Simulate, print and draw."""
    run, fine = swing(T), swing(np.linspace(0.0, T[-1], 10 * (len(T) - 1) + 1))
    exact = fine.q[::10]
    m = run.mechanism
    print(f"{m.nq} variables, {m.nc} constraints, that hold to {np.abs(m.constraint_values(run.q)).max():.0e} m")
    print(f"steps of 10 ms: off by {np.degrees(np.abs(run.q - exact)[:, 1:].max()):.2f} degrees at most")
    print(f"energy varies by {np.ptp(run.energy().total):.1e} J, {np.ptp(fine.energy().total):.1e} J with 1 ms")
    output.mkdir(parents=True, exist_ok=True)
    figures = [
        plot_poses(run, [0.0, 0.3, 0.6, 0.9]),
        plot_run({"steps of 10 ms": run}, ["L0"], reference=exact),
        plot_energy(run),
    ]
    save_png(figures, output / "05_scissor_lift.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
