"""A spring whose force is a smooth curve through measured points: a mass that snaps between two places of rest.

python examples/14_spline_spring.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

import leastaction as la
from leastaction.viz import plot_energy, plot_run, save_png

MASS = 0.3
# Measured on a buckled leaf: it pushes back at both ends and to the sides from the middle.
PLACES = np.linspace(-0.06, 0.06, 13)
FORCES = np.array([-10.5, -5.2, -1.6, 0.4, 1.3, 1.0, 0.0, -1.0, -1.3, -0.2, 2.2, 6.4, 12.6])
SPRING = la.elements.Curve(PLACES, FORCES)  # four derivatives are continuous
LEAF = la.Mechanism([la.tx("x", mass=MASS)], [la.elements.NonlinearSpring("x", SPRING, name="leaf")])
STARTS = (0.035, 0.045, 0.055)
T = 1e-3 * np.arange(5001)


def period(start: float) -> float:
    """Return the period (s) of the motion that turns at `start`, by the quadrature of its energy."""
    energy = SPRING.integral()
    fine = np.linspace(PLACES[0], start - 1e-5, 2001)
    beyond = int(np.flatnonzero(energy(fine) > energy(start))[-1])  # the other place where it turns is next to it
    other = brentq(lambda x: energy(x) - energy(start), fine[beyond], fine[beyond + 1], xtol=1e-15)
    half, centre = 0.5 * (start - other), 0.5 * (start + other)

    # x = centre + half sin(s) takes the roots at both ends out of the integral.
    def slowness(s: float) -> float:
        return half * np.cos(s) / np.sqrt(2.0 / MASS * (energy(start) - energy(centre + half * np.sin(s))))

    return 2.0 * quad(slowness, -0.5 * np.pi, 0.5 * np.pi, limit=400, epsabs=1e-10)[0]


def counted(x: np.ndarray) -> float:
    """Return the period (s) of a motion from its first to its last upward passage of its middle."""
    x = x - 0.5 * (x.max() + x.min())
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    at = T[up] - x[up] * T[1] / (x[up + 1] - x[up])
    return float((at[-1] - at[0]) / (len(at) - 1))


def main(output: Path) -> None:
    """Simulate, print and draw."""
    vi = la.MidpointVI(LEAF)
    runs = {f"{1e3 * start:g} mm": vi.simulate(vi.start([start]), T) for start in STARTS}
    for guess in (-0.03, 0.001, 0.03):
        rest = la.equilibrium(LEAF, [guess], kind="any")
        print(f"rest at {1e3 * rest.q[0]:+6.2f} mm: {rest.stability.name.lower()}")
    for start, (name, run) in zip(STARTS, runs.items(), strict=True):
        print(f"let go at {name}: a period takes {counted(run['x']):.5f} s, by quadrature {period(start):.5f} s")
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_run(runs, title="Let go at"), plot_energy(run, title="Over the top and back")]
    save_png(figures, output / "14_spline_spring.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
