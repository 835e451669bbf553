"""A spring whose force is a smooth curve through measured points: a mass that snaps between two places of rest.

python examples/14_spline_spring.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import quad
from scipy.optimize import brentq

from leastaction import Curve, Mechanism, MidpointVI, NonlinearSpring, Trajectory, equilibrium, tx
from leastaction.mechanics import Equilibrium, Stability

MASS = 0.3
# Measured on a buckled leaf: it pushes back at both ends and to the sides from the middle.
PLACES = np.array([-0.06, -0.05, -0.04, -0.03, -0.02, -0.01, 0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
FORCES = np.array([-10.5, -5.2, -1.6, 0.4, 1.3, 1.0, 0.0, -1.0, -1.3, -0.2, 2.2, 6.4, 12.6])
STARTS = (0.035, 0.045, 0.055)


def spring() -> Curve:
    """Return the force at every place: four derivatives are continuous."""
    return Curve(PLACES, FORCES)


def leaf() -> Mechanism:
    """Return the mass on its spring."""
    return Mechanism([tx("x", mass=MASS)], [NonlinearSpring("x", spring(), name="leaf")])


def period(start: float, energy: Curve) -> float:
    """Return the period (s) of the motion that turns at `start`, by the quadrature of its energy."""
    top = energy(start)
    fine = np.linspace(PLACES[0], start - 1e-5, 2001)
    beyond = int(np.flatnonzero(energy(fine) > top)[-1])  # the other place where it turns is next to it
    other = brentq(lambda x: energy(x) - top, fine[beyond], fine[beyond + 1], xtol=1e-15)
    half, centre = 0.5 * (start - other), 0.5 * (start + other)

    # x = centre + half sin(s) takes the roots at both ends out of the integral.
    def slowness(s: float) -> float:
        return half * np.cos(s) / np.sqrt(2.0 / MASS * (top - energy(centre + half * np.sin(s))))

    return 2.0 * quad(slowness, -0.5 * np.pi, 0.5 * np.pi, limit=400, epsabs=1e-10)[0]


def counted(t: np.ndarray, x: np.ndarray) -> float:
    """Return the period (s) of a motion from its first to its last upward passage of its middle."""
    x = x - 0.5 * (x.max() + x.min())
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    at = t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])
    return float((at[-1] - at[0]) / (len(at) - 1))


@dataclass(frozen=True)
class Result:
    """Where the mass may rest, its motions by their starts, and their periods (s), counted and by quadrature."""

    rests: list[Equilibrium]
    runs: list[Trajectory]
    periods: np.ndarray  # (motions, 2)


def solve() -> Result:
    """Look for the places of rest, and let the mass go from some others."""
    m = leaf()
    vi, energy = MidpointVI(m), spring().integral()
    rests = [equilibrium(m, [-0.03]), equilibrium(m, [0.001], kind="any"), equilibrium(m, [0.03])]
    runs = [vi.simulate(vi.start([start]), 1e-3 * np.arange(5001)) for start in STARTS]
    periods = [(counted(run.t, run["x"]), period(start, energy)) for start, run in zip(STARTS, runs, strict=True)]
    return Result(rests, runs, np.array(periods))


def draw(result: Result) -> Figure:
    """Return the figure: force and energy of the spring with the places of rest, and the motions."""
    figure = Figure(figsize=(10.5, 5.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.3])
    force, energy = left.subplots(2, 1, sharex=True)
    x = np.linspace(PLACES[0], PLACES[-1], 400)
    force.plot(1e3 * x, spring()(x), label="curve")
    force.plot(1e3 * PLACES, FORCES, "k.", label="measured")
    force.set(ylabel="force (N)")
    force.legend(frameon=False)
    energy.plot(1e3 * x, 1e3 * spring().integral()(x))
    for rest in result.rests:
        stable = rest.stability is Stability.STABLE
        energy.plot(1e3 * rest.q[0], 1e3 * rest.potential, "o", color="tab:green" if stable else "tab:red")
    lowest = 1e3 * min(rest.potential for rest in result.rests)
    energy.set(xlabel="place (mm)", ylabel="energy (mJ)", ylim=(lowest - 10.0, lowest + 120.0))
    motion = right.subplots()
    for start, run in zip(STARTS, result.runs, strict=True):
        motion.plot(run.t, 1e3 * run["x"], label=f"let go at {1e3 * start:g} mm")
    motion.set(xlabel="time (s)", ylabel="place (mm)", xlim=(0.0, 1.5))
    motion.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0)
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    for rest in result.rests:
        print(f"rest at {1e3 * rest.q[0]:+6.2f} mm: {rest.stability.name.lower()}")
    for start, (seen, known) in zip(STARTS, result.periods, strict=True):
        print(f"let go at {1e3 * start:g} mm: a period takes {seen:.5f} s, by quadrature {known:.5f} s")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "14_spline_spring.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
