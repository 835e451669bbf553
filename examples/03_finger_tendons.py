"""A finger of three bones, bent and stretched by two tendons over via-points, each with its muscle.

A `TendonForce` pulls along the straight pieces through its frames. Its input is an activation between 0 and 1; the gain
is the strength of the muscle, and a `Curve` says how its force depends on the length of the tendon.

    python examples/03_finger_tendons.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.mechanics import Curve, JointSpring, TendonForce
from leastaction.viz import plot_poses, plot_run, save_png

BONES = {"knuckle": (0.045, 0.020), "middle": (0.028, 0.012), "tip": (0.020, 0.007)}  # length (m), mass (kg)
SIDES = {"palm": -0.009, "back": 0.006}  # how far the sheaths are from the bones (m)
PATHS = {side: [f"{side} muscle", side, *(f"{side} {j} {end}" for j in BONES for end in "ab")] for side in SIDES}


def finger() -> la.Mechanism:
    """Return the finger in the x-y plane, straight along x at zero; positive angles bend it to the palm, -y."""
    place = tree = la.world()
    for side, aside in SIDES.items():
        tree.tx(-0.06).ty(aside, name=f"{side} muscle")
        tree.tx(-0.006).ty(aside, name=side)
    for joint, (length, mass) in BONES.items():
        rod = (0.0, mass * length**2 / 12.0, mass * length**2 / 12.0)
        bone = place.rz({joint: -1.0}, name=joint, mass=mass, com=(length / 2.0, 0.0, 0.0), inertia=rod)
        for end, at in (("a", 0.006), ("b", length - 0.006)):  # the sheaths: two via-points on each bone
            for side, aside in SIDES.items():
                bone.tx(at).ty(aside, name=f"{side} {joint} {end}")
        place = bone.tx(length, name=f"{joint} end")
    strong = Curve.from_function(lambda length: float(np.exp(-(((length - 0.148) / 0.03) ** 2))), 0.05, 0.25)
    flexor = TendonForce(PATHS["palm"], "flexor", 60.0, force_length=strong, name="flexor")
    extensor = TendonForce(PATHS["back"], "extensor", 25.0, force_length=strong, name="extensor")
    springs = [JointSpring(j, 0.08, rest=0.3, name=f"{j} spring") for j in BONES]
    return la.Mechanism(tree, [la.Gravity((0.0, -9.81, 0.0)), la.Damping(3e-3), *springs, flexor, extensor])


def activation(t: float) -> list[float]:
    """Return the activations of the flexor and the extensor: one from 0.1 to 0.5 s, then the other."""
    on, off = (1.0 / (1.0 + np.exp(-(t - at) / 0.015)) for at in (0.1, 0.5))
    return [0.22 * on * (1.0 - off), 0.20 * off]


def main(output: Path) -> None:
    """Simulate from rest, print and draw."""
    m = finger()
    vi = la.MidpointVI(m)
    run = vi.simulate(vi.start(la.equilibrium(m, np.zeros(3)).q), np.linspace(0.0, 1.0, 2001), inputs=activation)
    for name, k in (("at rest", 0), ("bent", 900), ("stretched", -1)):
        print(f"{name:9} " + ", ".join(f"{j} {a:.0f}" for j, a in zip(BONES, np.degrees(run.q[k]), strict=True)))
    for side, path in PATHS.items():
        length = np.linalg.norm(np.diff(m.positions(run.q, path), axis=1), axis=2).sum(axis=1)
        print(f"tendon on the {side}: from {1e3 * length.min():.1f} to {1e3 * length.max():.1f} mm long")
    output.mkdir(parents=True, exist_ok=True)
    save_png([plot_poses(run, [0.0, 0.12, 0.45, 0.55, 1.0]), plot_run(run)], output / "03_finger_tendons.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
