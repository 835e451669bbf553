"""A radial engine of five cylinders starts up: closed loops, and combustion as a curve of force over the crank's angle.

Rods without mass join the pistons to one crank pin. Each cylinder fires once in two turns, every second one in
turn, with a force on its piston that is an expression in the crank's angle; a propeller takes the power.

    python examples/12_radial_engine.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import sympy

import leastaction as la
from leastaction.viz import plot_energy, plot_poses, plot_reactions, save_png

CRANK, ROD, PISTONS = 0.05, 0.2, [f"piston{k}" for k in range(5)]  # m


def engine() -> la.Mechanism:
    """Return the engine in the x-y plane: one degree of freedom, five loops."""
    tree: list[object] = [la.rz("crank", mass=4.0, inertia=(0.2, 0.2, 0.4)), [la.tx(CRANK, name="pin", mass=0.8)]]
    elements: list[object] = [
        la.elements.NonlinearDamping("crank", (0.0, 2.5e-4)),
        la.Damping(dict.fromkeys(PISTONS, 8.0)),
    ]
    for k, piston in enumerate(PISTONS):
        tree += [la.rz(2.0 * np.pi * k / 5), [la.tx(piston, name=piston, mass=0.4)]]
        fires = 4 * sympy.pi * (3 * k % 5) / 5 + 0.25  # angle of the crank: in the order 0, 2, 4, 1, 3
        pulse = sympy.exp(60 * (sympy.cos((la.expressions.variable("crank") - fires) / 2) - 1))
        elements += [
            la.elements.Distance("pin", piston, ROD, name=f"rod{k}"),
            la.elements.ExpressionForce(-4000 * pulse, piston),
        ]
    return la.Mechanism(tree, elements)


def main(output: Path) -> None:
    """Start the engine at two turns a second, print and draw."""
    m = engine()
    vi, crank = la.MidpointVI(m), m.variables.index("crank")
    q = la.project_configuration(m, m.configuration(dict.fromkeys(PISTONS, ROD)), hold=["crank"]).q
    v = la.project_velocity(m, q, 4.0 * np.pi * (np.arange(m.nq) == crank), hold=["crank"]).v
    run = vi.simulate(vi.start(q, v), np.linspace(0.0, 4.0, 8001))
    turns = run.velocity("crank") / (2.0 * np.pi)
    print(f"{m.nq} variables and {m.nc} constraints: one degree of freedom")
    print(f"the rods keep their length within {max(np.abs(m.constraint_values(q)).max() for q in run.q):.0e}")
    for second in range(4):
        print(f"{second + 1} s: {turns[2000 * second + 1600 : 2000 * second + 2000].mean():.2f} turns a second")
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_poses(run), plot_energy(run), plot_reactions(run, "rod0", title="Force in a rod")]
    save_png(figures, output / "12_radial_engine.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
