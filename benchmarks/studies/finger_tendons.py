"""A finger of three bones, bent and stretched by two tendons over via-points, each with its muscle.

A `TendonForce` pulls along the straight pieces through its frames. Its input is an activation between 0 and 1; the gain
is the strength of the muscle, and a `Curve` says how its force depends on the length of the tendon.

    python -m benchmarks.studies.finger_tendons --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leastaction import Damping, Gravity, Mechanism, MidpointVI, Trajectory, world
from leastaction.mechanics import Curve, Element, JointSpring, TendonForce, equilibrium
from leastaction.viz.figures import BLUE, VERMILION, styled

COLORS = {"flexor": VERMILION, "extensor": BLUE}
JOINTS = ("knuckle", "middle", "tip")
BONES = (0.045, 0.028, 0.020)  # lengths (m)
MASSES = (0.020, 0.012, 0.007)
PALM, BACK, NEAR = (
    -0.009,
    0.006,
    0.006,
)  # how far the sheaths are from the bones, and from the joints (m)
FLEXOR = ["flexor muscle", "palm", *(f"palm{i}{end}" for i in range(3) for end in "ab")]
EXTENSOR = ["extensor muscle", "back", *(f"back{i}{end}" for i in range(3) for end in "ab")]
STRENGTH = {"flexor": 60.0, "extensor": 25.0}  # of the muscles (N)
FLEX, STRETCH = 0.22, 0.20  # activations
PULSE, END = (0.1, 0.5), 1.0  # when the flexor pulls (s), and when the motion ends


def finger(*elements: Element) -> Mechanism:
    """Return the finger in the x-y plane, straight along x at zero; positive angles bend it to the palm, -y."""
    tree = world()
    for x, names in ((-0.06, ("flexor muscle", "extensor muscle")), (-NEAR, ("palm", "back"))):
        hand = tree.tx(x)
        hand.ty(PALM, name=names[0])
        hand.ty(BACK, name=names[1])
    place = tree
    for i, (joint, length, mass) in enumerate(zip(JOINTS, BONES, MASSES, strict=True)):
        across = mass * length**2 / 12.0
        bone = place.rz({joint: -1.0}, name=f"bone{i}", mass=mass, com=(length / 2.0, 0.0, 0.0),
                        inertia=(0.0, across, across))  # fmt: skip
        # The sheaths of both tendons: two via-points on each bone.
        for end, at in (("a", NEAR), ("b", length - NEAR)):
            along = bone.tx(at)
            along.ty(PALM, name=f"palm{i}{end}")
            along.ty(BACK, name=f"back{i}{end}")
        place = bone.tx(length, name=f"end{i}")
    springs = [JointSpring(j, 0.08, rest=0.3, name=f"{j} spring") for j in JOINTS]
    return Mechanism(tree, [Gravity((0.0, -9.81, 0.0)), Damping(3e-3), *springs, *elements])


def muscle(name: str, frames: list[str]) -> TendonForce:
    """Return a muscle that is strongest at the length that its tendon has in the straight finger."""
    slack = path_length(finger(), np.zeros(3), frames)
    curve = Curve.from_function(lambda length: float(np.exp(-(((length - slack) / 0.03) ** 2))), 0.05, 0.25)
    return TendonForce(frames, name, STRENGTH[name], force_length=curve, name=name)


def path_length(mechanism: Mechanism, q: np.ndarray, frames: list[str]) -> np.ndarray:
    """Return the length of a path through frames (m), for one configuration or many."""
    points = mechanism.positions(q, frames)
    return np.linalg.norm(np.diff(points, axis=-2), axis=-1).sum(axis=-1)


def activation(t: float) -> list[float]:
    """Return the activations of the flexor and the extensor: a smooth pulse, then the other."""
    start, stop = PULSE
    on, off = (1.0 / (1.0 + np.exp(-(t - at) / 0.015)) for at in (start, stop))
    return [FLEX * on * (1.0 - off), STRETCH * off]


@dataclass(frozen=True)
class Result:
    """The motion, lengths (m) and tensions (N) of the tendons over it, and a check of its physics.

    ``virtual_work``: the largest difference (N m) between the torques of spring and weight at the equilibrium under the
    flexor and those of its tension, the latter from differences of its length alone. ``rest``: how far the finger is
    from that equilibrium (rad) when it is held for long.
    """

    motion: Trajectory
    lengths: dict[str, np.ndarray]
    tensions: dict[str, np.ndarray]
    virtual_work: float
    rest: float


def tension(mechanism: Mechanism, name: str, length: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the tension of a tendon (N) by its length and activation."""
    element = mechanism.elements[name]
    assert isinstance(element, TendonForce)
    assert element.force_length is not None
    return element.gain * u * element.force_length(length)


def simulate() -> Result:
    """Bend and stretch the finger, and compare a pull that lasts with the equilibrium."""
    m = finger(muscle("flexor", FLEXOR), muscle("extensor", EXTENSOR))
    vi = MidpointVI(m)
    start = vi.start(equilibrium(m, np.zeros(3)).q)
    motion = vi.simulate(start, np.linspace(0.0, END, 2401), inputs=activation)
    lengths, tensions = {}, {}
    for column, (name, frames) in enumerate((("flexor", FLEXOR), ("extensor", EXTENSOR))):
        lengths[name] = path_length(m, motion.q, frames)
        middle = 0.5 * (lengths[name][1:] + lengths[name][:-1])
        tensions[name] = tension(m, name, middle, motion.inputs[:, column])
    # Held by the flexor: the work of its tension over a small turn is that of springs and weight.
    pull = [FLEX, 0.0]
    held = equilibrium(m, motion.q[600], inputs=pull)
    long = vi.simulate(start, np.linspace(0.0, 6.0, 6001), inputs=pull)
    T = tension(m, "flexor", path_length(m, held.q, FLEXOR), np.array(pull[0]))
    h = 1e-5
    by_tension, by_energy = np.zeros(3), np.zeros(3)
    for j, step in enumerate(h * np.eye(3)):
        more, less = held.q + step, held.q - step
        by_tension[j] = -T * (path_length(m, more, FLEXOR) - path_length(m, less, FLEXOR)) / (2 * h)
        energies = [m.energy(q, np.zeros(3)).potential for q in (more, less)]
        by_energy[j] = (energies[0] - energies[1]) / (2.0 * h)
    return Result(
        motion,
        lengths,
        tensions,
        float(np.abs(by_tension - by_energy).max()),
        float(np.abs(long.q[-1] - held.q).max()),
    )


@styled
def draw(result: Result) -> Figure:
    """Return the figure: the finger at some instants, and its angles, tendons and tensions over time."""
    figure = Figure(figsize=(11.0, 7.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[0.9, 1.0])
    t = result.motion.t
    snapshots = {
        "the flexor pulls": (0.0, 0.1, 0.48),
        "the extensor pulls": (0.48, 0.55, 1.0),
    }
    for axis, (title, moments) in zip(left.subplots(2, 1), snapshots.items(), strict=True):
        for k, moment in enumerate(moments):
            draw_finger(axis, result, moment, shade=(0.75, 0.5, 0.0)[k])
        axis.set(aspect="equal", ylabel="y (mm)", title=title, xlim=(-65, 115), ylim=(-90, 25))
    axis.set_xlabel("x (mm)")
    angles, lengths, tensions = right.subplots(3, 1, sharex=True)
    for joint, style in zip(JOINTS, ("-", "--", ":"), strict=True):
        angles.plot(t, np.degrees(result.motion[joint]), style, color="0.2", label=joint)
    angles.set(ylabel="angle (degrees)")
    angles.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for name, color in COLORS.items():
        lengths.plot(t, 1e3 * result.lengths[name], color=color, label=name)
        tensions.plot(0.5 * (t[1:] + t[:-1]), result.tensions[name], color=color)
    lengths.set(ylabel="length of the tendon (mm)")
    lengths.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    tensions.set(ylabel="tension (N)", xlabel="time (s)", xlim=(0.0, t[-1]))
    return figure


def draw_finger(axis: Axes, result: Result, moment: float, shade: float) -> None:
    """Draw bones and tendons at an instant (s), in a shade of grey from 0, black, to 1."""
    m = result.motion.mechanism
    q = result.motion.q[np.argmin(np.abs(result.motion.t - moment))]
    faint = 1.0 if shade == 0.0 else 0.4
    for name, frames in (("flexor", FLEXOR), ("extensor", EXTENSOR)):
        axis.plot(*1e3 * m.positions(q, frames)[:, :2].T, color=COLORS[name], lw=1.2, alpha=faint)
    x, y = 1e3 * m.positions(q, ["bone0", "end0", "end1", "end2"])[:, :2].T
    axis.plot(x, y, color=str(shade), lw=4.0, marker="o", ms=7.0, solid_capstyle="round")
    outwards = np.array([x[3] - x[2], y[3] - y[2]]) / np.hypot(x[3] - x[2], y[3] - y[2])
    axis.annotate(f"{moment:g} s", (x[3], y[3]), 16.0 * outwards, textcoords="offset points",
                  ha="center", va="center", fontsize=9)  # fmt: skip


def main(output: Path) -> Result:
    """Simulate, check, print and draw."""
    result = simulate()
    bent = np.degrees(result.motion.q).max(axis=0)
    print("bends to " + ", ".join(f"{a:.0f} ({j})" for j, a in zip(JOINTS, bent, strict=True)) + " degrees")
    for name, values in result.tensions.items():
        span = 1e3 * np.ptp(result.lengths[name])
        print(f"{name}: travels {span:.1f} mm, pulls with up to {values.max():.1f} N")
    print(f"work of the tension less that of springs and weight: {result.virtual_work:.0e} N m")
    print(f"held for 6 s it comes to rest within {result.rest:.0e} rad of the equilibrium")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "finger_tendons.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
