"""A radial engine of five cylinders starts up: closed loops, and combustion as a curve of force over the crank's angle.

Rods without mass join the pistons to one crank pin. Each cylinder fires once in two turns, every second one in
turn, with a force on its piston that is an expression in the crank's angle; a propeller takes the power.

    python -m benchmarks.studies.radial_engine --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy
from matplotlib.figure import Figure

from leastaction import (
    Damping,
    Distance,
    ExpressionForce,
    Mechanism,
    MidpointVI,
    NonlinearDamping,
    Trajectory,
    project_configuration,
    project_velocity,
    rz,
    tx,
    variable,
)
from leastaction.viz.figures import BLUE, VERMILION, styled

CYLINDERS, CRANK, ROD = 5, 0.05, 0.2  # m
FORCE, SHARP, AFTER = 4000.0, 60.0, 0.25  # of the combustion: peak (N), width, and angle after the top (rad)
PROPELLER = 2.5e-4  # N m s^3/rad^3


def combustion(k: int, angle: sympy.Expr) -> sympy.Expr:
    """Return the force (N) outwards on piston k: a pulse every two turns of the crank, against the piston."""
    # Cylinder k is at 2 pi k/5; they fire in the order 0, 2, 4, 1, 3, each 4 pi/5 after the one before.
    fires = next(4 * sympy.pi * j / CYLINDERS for j in range(CYLINDERS) if (2 * j - k) % CYLINDERS == 0)
    return -FORCE * sympy.exp(SHARP * (sympy.cos((angle - fires - AFTER) / 2) - 1))


def engine() -> Mechanism:
    """Return the engine in the x-y plane: one degree of freedom, five loops."""
    tree: list[object] = [
        rz("crank", name="shaft", mass=4.0, inertia=(0.2, 0.2, 0.4)),
        [tx(CRANK, name="pin", mass=0.8)],
    ]
    elements: list[object] = [
        NonlinearDamping("crank", (0.0, PROPELLER)),
        Damping({f"piston{k}": 8.0 for k in range(5)}),
    ]
    for k in range(CYLINDERS):
        tree += [
            rz(2.0 * np.pi * k / CYLINDERS), [
                tx(f"piston{k}", name=f"piston{k}", mass=0.4),
            ],
        ]  # fmt: skip
        elements += [
            Distance("pin", f"piston{k}", ROD, name=f"rod{k}"),
            ExpressionForce(combustion(k, variable("crank")), f"piston{k}", name=f"gas{k}"),
        ]
    return Mechanism(tree, elements)


@dataclass(frozen=True)
class Result:
    """The start, and what one cycle of two turns at its end does."""

    run: Trajectory
    residual: float  # of the rods' lengths (m)
    work: dict[str, float]  # of the gas, the propeller and the pistons' friction over the last cycle (J)
    gained: float  # of kinetic energy over the cycle (J)

    @property
    def speed(self) -> np.ndarray:
        """Turns a second, over each step."""
        return self.run.velocity("crank") / (2.0 * np.pi)


def solve(seconds: float = 6.0, dt: float = 5e-4) -> Result:
    """Start the engine at two turns a second, and balance the work of its last cycle."""
    m = engine()
    vi = MidpointVI(m)
    guess = m.configuration({f"piston{k}": ROD for k in range(CYLINDERS)})
    q = project_configuration(m, guess, hold=["crank"]).q
    v0 = np.zeros(m.nq)
    v0[m.variables.index("crank")] = 2.0 * np.pi * 2.0
    v = project_velocity(m, q, v0, hold=["crank"]).v
    run = vi.simulate(vi.start(q, v), dt * np.arange(round(seconds / dt) + 1))
    # The last cycle, from step to step; forces act at the midpoints.
    first = int(np.searchsorted(run["crank"], run["crank"][-1] - 4.0 * np.pi))
    rows = slice(first, run.steps)
    middle, moved = 0.5 * (run.q[1:] + run.q[:-1])[rows], np.diff(run.q, axis=0)[rows]
    speed = moved / dt
    moved[[0, -1]] *= 0.5  # the kinetic energy too is that of the middles of the steps
    angle = sympy.Symbol("angle")
    at, column = middle[:, m.variables.index("crank")], m.variables.index
    gas = sum(
        sympy.lambdify(angle, combustion(k, angle))(at) @ moved[:, column(f"piston{k}")] for k in range(CYLINDERS)
    )
    load = -PROPELLER * speed[:, column("crank")] ** 3 @ moved[:, column("crank")]
    friction = -sum(8.0 * speed[:, column(f"piston{k}")] @ moved[:, column(f"piston{k}")] for k in range(CYLINDERS))
    kinetic = run.energy().kinetic
    residual = np.abs([list(m.constraint_residuals(q).values()) for q in run.q[::20]]).max() / (2.0 * ROD)
    work = {"gas": float(gas), "propeller": float(load), "friction": float(friction)}
    return Result(run, float(residual), work, float(kinetic[-1] - kinetic[first]))


@styled
def draw(result: Result) -> Figure:
    """Return the figure: the engine, its speed, and what the gas pushes."""
    figure = Figure(figsize=(11.5, 5.4), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.3])
    axis = left.subplots()
    m, run = result.run.mechanism, result.run
    q = run.q[-1]
    pin = m.positions(q, ["pin"])[0]
    axis.plot([0.0, pin[0]], [0.0, pin[1]], color="k", lw=5, marker="o", ms=9)
    for k in range(CYLINDERS):
        x, y = m.positions(q, [f"piston{k}"])[0, :2]
        out = np.array([np.cos(2.0 * np.pi * k / CYLINDERS), np.sin(2.0 * np.pi * k / CYLINDERS)])
        across = 0.035 * np.array([-out[1], out[0]])
        for side in (across, -across):
            axis.plot(*np.stack([0.13 * out + side, 0.28 * out + side]).T, color="0.7", lw=2)
        axis.plot([pin[0], x], [pin[1], y], color=BLUE, lw=2)
        axis.plot(
            *np.stack([[x, y] - 0.9 * across, [x, y] + 0.9 * across]).T, color=VERMILION, lw=7, solid_capstyle="butt"
        )
        axis.annotate(str(k + 1), 0.31 * out, ha="center", va="center")
    axis.set(aspect="equal", xlim=(-0.33, 0.33), ylim=(-0.33, 0.33), xlabel="x (m)", ylabel="y (m)")
    speed, push = right.subplots(2, 1)
    middle = 0.5 * (run.t[1:] + run.t[:-1])
    speed.plot(middle, result.speed, lw=0.8)
    speed.set(xlabel="time (s)", ylabel="turns a second", xlim=(0.0, run.t[-1]), ylim=(0.0, None))
    angle, turn = sympy.Symbol("angle"), np.linspace(0.0, 4.0 * np.pi, 1000)
    for k in range(CYLINDERS):
        force = -sympy.lambdify(angle, combustion(k, angle))(turn)
        push.plot(np.degrees(turn), force / 1e3, label=f"cylinder {k + 1}")
    push.set(xlabel="angle of the crank (degrees)", ylabel="gas on the piston (kN)", xlim=(0.0, 720.0))
    push.set_xticks(range(0, 721, 120))
    push.legend(frameon=False, fontsize=8, ncols=5, loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0)
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    print(f"{result.run.steps} steps; the rods keep their length within {result.residual:.0e} m")
    last = result.speed[-400:]
    print(f"runs up from 2 to {np.mean(last):.2f} turns a second, which sway by {np.ptp(last):.2f}")
    print("over the last cycle: " + ", ".join(f"{name} {value:+.2f} J" for name, value in result.work.items()))
    print(f"their sum is {sum(result.work.values()):+.3f} J, the kinetic energy's change {result.gained:+.3f} J")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "radial_engine.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("output"))
    main(parser.parse_args().out)
