"""A puppet turns a cartwheel with its arms swung overhead: pelvis, hips and shoulders are ball joints.

Wanted are the turns of its joints over time, made up here as if they were captured. Motors in all joints and a hand at
the pelvis, which costs more, make the motion that is nearest; that arms point up and the torso down is nothing special.

    python examples/29_tumbling_puppet.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import leastaction as la
from leastaction.elements import BodyWrench
from leastaction.mechanics.description.shapes import Shape
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 2.0, 101)
WOOD = (0.8, 0.58, 0.35, 1.0)
LIMBS = {  # where it is joined to the pelvis, how long its halves are (m), and their mass (kg)
    "left arm": ((-0.2, 0.0, 0.5), 0.27, 1.2), "right arm": ((0.2, 0.0, 0.5), 0.27, 1.2),
    "left leg": ((-0.1, 0.0, 0.0), 0.4, 3.5), "right leg": ((0.1, 0.0, 0.0), 0.4, 3.5),
}  # fmt: skip


def puppet(axes: str = "quaternion") -> la.Mechanism:
    """Return the puppet, its balls by quaternions or by three angles: x to its right, y ahead, z up."""
    tree, motors = [], []
    for name, (place, length, mass) in LIMBS.items():
        half = {"mass": mass, "com": (0.0, 0.0, -length / 2.0), "inertia": (mass * length**2 / 10.0,) * 3}
        lower = la.rx(f"{name} bend", name=f"lower {name}", **half)
        tree += [la.pose(translation=place), [la.ball(name, axes=axes, **half), [la.tz(-length), [lower]]]]
        turns = [f"{name}.{'w' if axes == 'quaternion' else 'r'}{axis}" for axis in "xyz"]
        motors += [la.JointForce(turn, input=f"motor of {turn}") for turn in (*turns, f"{name} bend")]
    pelvis = la.free("pelvis", axes=axes, mass=18.0, com=(0.0, 0.0, 0.3), inertia=(1.0, 0.9, 0.3))
    hand = BodyWrench("pelvis", ("hand x", "hand y", "hand z"), ("hand rx", "hand ry", "hand rz"))
    return la.Mechanism([pelvis, tree], [la.Gravity(), la.Damping(0.2), hand, *motors])


def cartwheel() -> dict[str, np.ndarray]:
    """Return what is wanted: a turn to the right, with arms that go up before it and legs that spread."""
    s = T / T[-1]
    rise = np.clip(np.minimum(s, 1.0 - s) / 0.3, 0.0, 1.0)
    up, wheel = (x * x * (3.0 - 2.0 * x) for x in (rise, np.clip((s - 0.15) / 0.7, 0.0, 1.0)))
    turns = dict(zip(("pelvis", *LIMBS), (2.0 * np.pi * wheel, 2.9 * up, -2.9 * up, 0.6 * up, -0.6 * up), strict=True))
    about_y = {name: Rotation.from_euler("y", angle[:, None]) for name, angle in turns.items()}
    wanted = {name: turn.as_quat(scalar_first=True) for name, turn in about_y.items()}
    wanted |= {f"{name} bend": (0.3 if "arm" in name else -0.3) * (1.0 - up) for name in LIMBS}
    return wanted | {"pelvis.x": 2.2 * wheel - 1.1, "pelvis.y": 0.0 * s, "pelvis.z": 0.8 + 0.15 * up}


def solve() -> la.starts.Followed:
    """Return the motion that is nearest to the cartwheel."""
    m, wanted = puppet(), cartwheel()
    prices = dict.fromkeys(wanted, 100.0) | {"motor *": 1e-4, "hand *": 1e-4}
    return la.follow(m, wanted, prices, [la.Bound("motor *", -30.0, 30.0)], t=T)


def main(output: Path) -> la.starts.Followed:
    """Solve, print and draw."""
    found = solve()
    print(f"{found.result.status.name} in {found.result.iterations} iterations, {found.way}")
    print(f"its joints are off by {np.degrees(max(found.errors[name] for name in LIMBS)):.1f} degrees at most (rms)")
    print(f"motors turn with up to {np.abs(found.result.u[:, 6:]).max():.0f} N m")
    output.mkdir(parents=True, exist_ok=True)
    rods = [("pelvis", 0.05, 0.45, 0.1, (0.25, 0.4, 0.6, 1.0)), ("pelvis", 0.68, 0.72, 0.09, WOOD)]
    rods += [(f"{half}{name}", 0.0, -LIMBS[name][1], 0.045, WOOD) for name in LIMBS for half in ("", "lower ")]
    shapes = [Shape.rod(frame, (0, 0, a), (0, 0, b), *look) for frame, a, b, *look in rods]
    figures = [plot_poses(found.trajectory, times, shapes=shapes) for times in ([0.0, 0.6, 0.8], [1.0, 1.2, 2.0])]
    figures += [plot_run(found.result, ["motor of * arm.wy", "motor of * leg.wy"])]
    save_png(figures, output / "29_tumbling_puppet.png", dpi=110)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
