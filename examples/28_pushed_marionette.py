"""A marionette on six strings is knocked about and catches itself: predictive control of the hands that hold it.

The strings can only pull, and hands and reels move at most 1.5 m/s. The controller looks two fifths of a second ahead,
and its plan is made anew a hundred times a second.

    python examples/28_pushed_marionette.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import leastaction as la
from leastaction.control import MPC, ClosedLoop
from leastaction.models.marionette import marionette, rest_pose
from leastaction.viz import BLUE, VERMILION, new_figure, save_png, styled

M = marionette()
VI, DT, AHEAD = la.MidpointVI(M), 0.01, 40
KNOCKS = {20: ("torso_ty", 3.0), 140: ("torso_tx", -3.0), 260: ("torso_ty", -3.0)}  # step: where, how much (kg m/s)


def controller(start: np.ndarray) -> MPC:
    """Return a controller that holds a pose."""
    system = la.MidpointSystem(VI, DT * np.arange(AHEAD + 1), multipliers=True)
    weights = np.repeat([100.0, 0.02, 0.01, 0.02, 0.0], [M.nd, M.nrho, M.nd, M.nrho, M.nc])
    wanted = np.concatenate([start, np.zeros(M.nc)])
    cost = la.QuadraticCost(wanted, start[M.nd : M.nq], Q=weights, R=np.full(M.nrho, 0.02))
    return MPC(system, cost, [la.Bound("*", min=0.0, of="tension"), la.Bound("v_*", -1.5, 1.5)])


def run(start: la.mechanics.State, law: object, steps: int) -> ClosedLoop:
    """Return the loop that is knocked."""

    def knock(t: float, _: np.ndarray) -> np.ndarray:
        name, size = KNOCKS.get(round(t / DT), (M.dynamic[0], 0.0))
        return np.where(np.arange(M.nx) == M.nq + M.dynamic.index(name), size, 0.0)

    return la.simulate(VI, start, None, DT * np.arange(steps + 1), inputs=law, disturbance=knock)


@styled
def compared(loops: dict[str, ClosedLoop]) -> Figure:
    """Draw where the torso hangs, with and without hands that act."""
    figure = new_figure(7.5, 4.6)
    panels = figure.subplots(2, 1, sharex=True)
    for panel, axis in zip(panels, "xy", strict=True):
        for (label, loop), color in zip(loops.items(), (BLUE, VERMILION), strict=True):
            panel.plot(loop.t, 100.0 * loop[f"torso_t{axis}"], label=label, color=color)
        panel.set(ylabel=f"torso, {axis} (cm)")
        for step in KNOCKS:
            panel.axvline(DT * step, color="0.6", linestyle=":")
    panels[1].set(xlabel="time (s)")
    panels[0].set_title("Where the torso hangs; it is knocked at dotted lines", loc="left")
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.1, 0.0))
    return figure


def main(output: Path, steps: int = 380) -> ClosedLoop:
    """Run it with hands that act and with hands that stand still, print and draw."""
    start = VI.start(rest_pose(M))
    loops = {"hands that act": run(start, controller(start.x), steps)}
    loops["hands that stand still"] = run(start, lambda _t, _x: start.q[M.nd :], steps)
    figure = compared(loops)
    for label, loop in loops.items():
        off = 100.0 * np.hypot(loop["torso_tx"], loop["torso_ty"])
        print(f"{label}: {off[120]:.1f} cm off a second after the first knock, at most {off.max():.1f} cm")
    print(f"new plans: {sum(info.planned for info in loops['hands that act'].infos)} of {steps}")
    output.mkdir(parents=True, exist_ok=True)
    save_png(figure, output / "28_pushed_marionette.png")
    found = loops["hands that act"]
    motion = la.MidpointSystem(VI, found.t).trajectory(found.x, found.u)
    la.show(motion, traces=["rhand"], title="Knocked about").save(output / "28_pushed_marionette.html")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
