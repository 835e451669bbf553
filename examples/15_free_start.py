"""Where should a motion begin? The initial state is found together with the inputs (dissertation 6.3.2.1).

A double pendulum without a motor is to draw a wanted wave with its two angles. From the start that the wave has it
drifts away at once; from the start that the optimisation finds it keeps to the wave as well as a free pendulum can.
The same with a weak motor: how much of its effort does the right start save?

    python examples/15_free_start.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import (
    Damping,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    QuadraticCost,
    optimize,
    rz,
    ty,
)

T = np.linspace(0.0, 4.0, 201)
ARMS = ("upper", "lower")
EFFORT = (1e3, 1e-1)  # price of the motor: as good as none, and worth its while


def double_pendulum() -> Mechanism:
    """Return two rods of 0.5 m with a weight at the end of each, a motor at the upper joint."""
    return Mechanism(
        [rz("upper"), [ty(-0.5, name="elbow", mass=1.0), [rz("lower"), [ty(-0.5, name="tip", mass=0.5)]]]],
        [Gravity((0.0, -9.81, 0.0)), Damping(0.01), JointForce("upper", input="motor")],
    )


def wanted() -> np.ndarray:
    """Return the wave (201, 4): both angles in step at 0.6 Hz, nearly as the pendulum swings of itself."""
    x = np.zeros((len(T), 4))
    x[:, 0] = 0.4 * np.cos(2.0 * np.pi * 0.6 * T + 0.8)
    x[:, 1] = 0.5 * x[:, 0]
    return x


@dataclass(frozen=True)
class Result:
    """The motions by price of the motor, from the start of the wave at rest and from the start that was found."""

    held: list[OptimizationResult]
    free: list[OptimizationResult]

    def off(self, run: OptimizationResult) -> float:
        """Return the root mean square of what the angles are off by (degrees)."""
        return float(np.degrees(np.sqrt(np.mean((run.x - wanted())[:, :2] ** 2))))


def solve() -> Result:
    """Optimise with the start held and free."""
    system = MidpointSystem(MidpointVI(double_pendulum()), T)
    x = wanted()
    start = x[0].copy(), np.zeros((len(T) - 1, 1))
    held, free = [], []
    for price in EFFORT:
        cost = QuadraticCost(x, np.zeros((len(T) - 1, 1)), Q=[10.0, 10.0, 0.0, 0.0], R=[price])
        held.append(optimize(system, cost, initial=start))
        free.append(optimize(system, cost, initial=held[-1], free_start=True))
    return Result(held, free)


def draw(result: Result) -> Figure:
    """Return the figure: the two angles with either start, without the motor and with it, and what the motor does."""
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, (held, free) in enumerate(zip(result.held, result.free, strict=True)):
        for row, arm in enumerate(ARMS):
            axis = axes[row, column]
            axis.plot(T, np.degrees(wanted()[:, row]), "--", color="0.5", label="wanted")
            axis.plot(T, np.degrees(held.x[:, row]), color="tab:orange", label="from the wave's start, at rest")
            axis.plot(T, np.degrees(free.x[:, row]), color="tab:blue", label="from the start that was found")
            axis.set_ylabel(f"{arm} angle (degrees)" if column == 0 else "")
        axes[2, column].plot(T[:-1], held.u[:, 0], color="tab:orange")
        axes[2, column].plot(T[:-1], free.u[:, 0], color="tab:blue")
        axes[2, column].set(xlabel="time (s)", xlim=(0.0, T[-1]))
        axes[0, column].set_title(("hardly a motor", "a weak motor")[column])
    axes[2, 0].set_ylabel("motor (N m)")
    axes[0, 1].legend(fontsize=8, loc="upper right")
    axes[0, 0].set_ylim(-26.0, 44.0)
    return figure


def main(output: Path) -> Result:
    """Optimise, print and draw."""
    result = solve()
    for price, held, free in zip(EFFORT, result.held, result.free, strict=True):
        print(f"price of the motor {price:g}:")
        for name, run in (("start held ", held), ("start found", free)):
            effort = np.sqrt(np.mean(run.u**2))
            print(
                f"  {name}: off by {result.off(run):6.3f} degrees (rms), motor {effort:.4f} N m (rms), "
                f"cost {run.cost:.5g}; {run.status.name}"
            )
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "15_free_start.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
