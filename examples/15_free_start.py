"""Where should a motion begin? The initial state is found together with the inputs (dissertation 6.3.2.1).

A double pendulum with next to no motor is to draw a wanted wave with its two angles. From the start that the wave has
it drifts away at once; from the start that the optimisation finds it keeps to the wave as well as a free pendulum can.
The same with a weak motor: how much of its effort does the right start save?

    python examples/15_free_start.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.viz import plot_run, save_png

T = np.linspace(0.0, 4.0, 201)
PRICES = {"hardly a motor": 1e3, "a weak motor": 1e-1}  # of half its square torque
PENDULUM = la.Mechanism(
    [la.rz("upper"), [la.ty(-0.5, name="elbow", mass=1.0), [la.rz("lower"), [la.ty(-0.5, name="tip", mass=0.5)]]]],
    [la.Gravity((0.0, -9.81, 0.0)), la.Damping(0.01), la.JointForce("upper", input="motor")],
)
# Both angles in step at 0.6 Hz, nearly as the pendulum swings of itself.
WAVE = 0.4 * np.cos(2.0 * np.pi * 0.6 * T + 0.8)
WANTED = np.stack([WAVE, 0.5 * WAVE, 0.0 * T, 0.0 * T], axis=1)


def solve(price: float) -> tuple[la.OptimizationResult, la.OptimizationResult]:
    """Return the motions from the start of the wave, at rest, and from the start that was found."""
    system = la.MidpointSystem(la.MidpointVI(PENDULUM), T)
    cost = la.QuadraticCost(WANTED, np.zeros((200, 1)), Q=[10.0, 10.0, 0.0, 0.0], R=[price])
    held = la.optimize(system, cost, initial=(WANTED[0], np.zeros((200, 1))))
    return held, la.optimize(system, cost, initial=held, free_start=True)


def off(run: la.OptimizationResult) -> float:
    """Return what the angles are off by (degrees, rms)."""
    return float(np.degrees(np.sqrt(np.mean((run.x - WANTED)[:, :2] ** 2))))


def main(output: Path) -> None:
    """Optimise, print and draw."""
    runs = {f"{name}, {motor}": run for motor, price in PRICES.items()
            for name, run in zip(("start held", "start found"), solve(price), strict=True)}  # fmt: skip
    for name, run in runs.items():
        effort = np.sqrt(np.mean(run["motor"] ** 2))
        print(f"{name:28} off by {off(run):6.3f} degrees, motor {effort:.4f} N m (rms), cost {run.cost:.5g}; "
              f"{run.status.name}")  # fmt: skip
    output.mkdir(parents=True, exist_ok=True)
    weak = {name.split(",")[0]: run for name, run in runs.items() if "weak" in name}
    figures = [plot_run(weak, reference=WANTED, title="A weak motor")]
    hardly = {name.split(",")[0]: run for name, run in runs.items() if "hardly" in name}
    figures += [plot_run(hardly, ["upper", "lower"], reference=WANTED, title="Hardly a motor")]
    save_png(figures, output / "15_free_start.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
