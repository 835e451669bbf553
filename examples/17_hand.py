"""A hand closes to a fist and opens again, under twenty-five tendons that can only pull.

Sixteen joints, every bone a rigid body, and five tendons a finger whose force depends on their length (dissertation
6.7.4). Without limits more than half of all tensions come out negative: the optimiser pushes with strings. With
`Bound("*", min=0.0, of="input")` none is.

    python examples/17_hand.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from leastaction import Bound, Mechanism, MidpointSystem, MidpointVI, OptimizationResult, QuadraticCost, optimize
from leastaction.models.hand import BONES, FINGERS, TENDONS, hand, posture, tendon_frames

T = np.linspace(0.0, 2.0, 201)
EFFORT = 1e-5  # price of half the square of a tension (N), where a joint that is off by a radian costs a half
MOMENTS = (0.0, 0.45, 1.0, 1.5, 2.0)  # that are drawn (s)
SHOWN = "middle"  # the third finger
VIEW = np.radians(20.0), np.radians(30.0)  # from where it is drawn: about the vertical, and above the level
PULLS = LinearSegmentedColormap.from_list("pulls", ["#3b6ea5", "#e69f00", "#c1121f"])


def wanted(mechanism: Mechanism) -> np.ndarray:
    """Return the wanted angles (201, 16) (rad): open, a fist in 0.6 s, held, and open again."""

    def eased(start: float) -> np.ndarray:
        s = np.clip((T - start) / 0.6, 0.0, 1.0)
        return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

    return posture(mechanism, eased(0.2) - eased(1.2))


@dataclass(frozen=True)
class Result:
    """The hand, the wanted angles, and the motions without limits and under tendons that only pull."""

    mechanism: Mechanism
    wanted: np.ndarray
    free: OptimizationResult
    pulled: OptimizationResult

    def off(self, run: OptimizationResult) -> np.ndarray:
        """Return how far the angles of a motion are from the wanted ones (201, 16) (degrees)."""
        return np.degrees(run.x[:, : self.mechanism.nq] - self.wanted)


def solve() -> Result:
    """Follow the wanted motion without limits, and from there with them."""
    m = hand()
    system = MidpointSystem(MidpointVI(m), T)
    angles = wanted(m)
    curve, slack = np.hstack([angles, np.zeros_like(angles)]), np.zeros((len(T) - 1, m.n_inputs))
    cost = QuadraticCost(curve, slack, Q=[1.0] * m.nq + [0.0] * m.nq, R=[EFFORT] * m.n_inputs)
    free = optimize(system, cost, initial=(curve, slack))
    pulled = optimize(system, cost, initial=free, limits=[Bound("*", min=0.0, of="input")])
    return Result(m, angles, free, pulled)


def draw(result: Result) -> Figure:
    """Return the figure: the hand at some instants, joints and tensions of a finger, and how far joints are off."""
    figure = Figure(figsize=(12.0, 7.8), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[0.66, 1.0])
    for axis, moment in zip(above.subplots(1, len(MOMENTS)), MOMENTS, strict=True):
        draw_hand(axis, result, int(np.argmin(np.abs(T - moment))))
        axis.set(aspect="equal", xlim=(-0.093, 0.066), ylim=(-0.13, 0.014), title=f"{moment:g} s")
        axis.set_axis_off()
    left, middle, right = below.subplots(1, 3)
    m, x, u = result.mechanism, result.pulled.x, result.pulled.u
    for name, color in (("mcp", "tab:gray"), ("pip", "tab:blue"), ("dip", "tab:red")):
        i = m.variables.index(f"{SHOWN}.{name}")
        left.plot(T, np.degrees(x[:, i]), color=color, label=f"{SHOWN}.{name}")
        left.plot(T, np.degrees(result.wanted[:, i]), "k:", lw=1.4)
    left.plot([], [], "k:", lw=1.4, label="wanted")
    left.set(xlabel="time (s)", ylabel="angle (degrees)", xlim=(0.0, T[-1]))
    left.legend(frameon=False, ncols=2, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for tendon, color in zip(TENDONS, ("tab:red", "tab:orange", "tab:blue", "tab:green", "tab:purple"), strict=True):
        i = m.inputs.index(f"{SHOWN}.{tendon}")
        middle.plot(T[:-1], u[:, i], color=color, label=tendon)
        middle.plot(T[:-1], result.free.u[:, i], color=color, lw=0.9, ls="--")
    middle.plot([], [], "k--", lw=0.9, label="without limits")
    middle.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    middle.set(xlabel="time (s)", ylabel=f"tensions of the {SHOWN} finger (N)", xlim=(0.0, T[-1]))
    middle.legend(frameon=False, ncols=3, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    off = [np.sqrt(np.mean(result.off(run) ** 2, axis=0)) for run in (result.free, result.pulled)]
    places = np.arange(m.nq)[::-1]
    right.barh(places + 0.2, off[0], 0.4, color="0.7", label="without limits")
    right.barh(places - 0.2, off[1], 0.4, color="tab:green", label="pulling only")
    right.set_yticks(places, m.variables, fontsize=8)
    right.set(xlabel="off by (degrees, rms)")
    right.legend(frameon=False, ncols=2, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def draw_hand(axis: Axes, result: Result, k: int) -> None:
    """Draw bones and tendons at an instant, those by their tension, on the wanted pose in green."""
    m, pull = result.mechanism, result.pulled.u[min(k, len(T) - 2)]
    around, above = VIEW
    s, c = np.sin(above), np.cos(above)
    right = np.array([-np.sin(around), np.cos(around), 0.0])
    near = np.array([c * np.cos(around), c * np.sin(around), s])
    frame = np.array([right, np.cross(near, right), near])
    seen = [
        dict(zip(m.frames, m.positions(q) @ frame.T, strict=True))
        for q in (result.wanted[k], result.pulled.x[k, : m.nq])
    ]
    bars = [(f"{f}.{bone}", f"{f}.{bone}.end", 0.0085) for f in FINGERS for bone in BONES[f]]
    bars += [(f"{f}.wrist.deep", f"{f}.knuckle", 0.010) for f in FINGERS[1:]]
    for start, end, radius in bars:
        axis.add_patch(Polygon(capsule(seen[0][start], seen[0][end], 1.25 * radius), color="#a6dccb", zorder=0.0))
    at = seen[1]
    for start, end, radius in bars:
        depth = 10.0 + 50.0 * (at[start] + at[end])[2]
        axis.add_patch(Polygon(capsule(at[start], at[end], radius), fc="#e2c29c", ec="#7a5532", lw=0.7, zorder=depth))
    for name in m.inputs:
        path = np.array([at[frame] for frame in tendon_frames(m, name)])
        strength = pull[m.inputs.index(name)] / result.pulled.u.max() * 2.0
        # Each piece in front of the bone that it runs along, where it is on this side of it.
        for a, b in pairwise(path):
            axis.plot(*np.array([a, b]).T[:2], color=PULLS(strength), lw=0.6 + 1.6 * min(strength, 1.0),
                      solid_capstyle="round", zorder=10.05 + 50.0 * (a + b)[2])  # fmt: skip


def capsule(a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    """Return the outline of a rounded bar between two points on the paper."""
    turn = np.arctan2(b[1] - a[1], b[0] - a[0]) + np.linspace(0.5, 1.5, 20) * np.pi
    cap = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.vstack([a[:2] + cap, b[:2] - cap])


def main(output: Path) -> Result:
    """Optimise, print and draw."""
    result = solve()
    for name, run in (("without limits", result.free), ("pulling only", result.pulled)):
        share, off = 100.0 * np.mean(run.u < 0.0), result.off(run)
        print(f"{name:15} {run.status.name} in {run.iterations} iterations, cost {run.cost:.4f}")
        print(f"{'':15} {share:.0f} % of the tensions negative, {run.u.min():.2f} to {run.u.max():.1f} N")
        third = off[:, result.mechanism.variables.index(f"{SHOWN}.dip")]
        print(f"{'':15} off by {np.sqrt(np.mean(off**2)):.3f} degrees rms, {np.abs(off).max():.2f} at most; "
              f"third distal phalanx {np.sqrt(np.mean(third**2)):.3f}")  # fmt: skip
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "17_hand.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
