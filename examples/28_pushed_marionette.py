"""A marionette on six strings is knocked about and catches itself: predictive control of the hands that hold it.

The strings can only pull. The controller looks a fifth of a second ahead, and its plan is made anew a hundred times a
second: the hands move, and let out and draw in the strings.

    python examples/28_pushed_marionette.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.control import MPC, ClosedLoop, close_loop
from leastaction.models.marionette import marionette, rest_pose

DT, AHEAD = 0.01, 20
KNOCKS = {  # when (s), which variable, and the momentum that a knock adds (kg m/s, kg m^2/s)
    0.3: ("torso_ty", 2.0),
    1.3: ("torso_tx", -3.0),
    2.3: ("rshoulder_rx", 0.15),
}


def controller(m: la.Mechanism, start: np.ndarray) -> MPC:
    """Return a controller that holds a pose, with strings that pull."""
    system = la.MidpointSystem(la.MidpointVI(m), DT * np.arange(AHEAD + 1), multipliers=True)
    held = np.concatenate([start, np.zeros(m.nc)])
    weights = np.repeat([100.0, 1.0, 0.1, 0.01, 0.0], [m.nd, m.nrho, m.nd, m.nrho, m.nc])
    cost = la.QuadraticCost(held, start[m.nd : m.nq], Q=weights, R=np.full(m.nrho, 1.0))
    return MPC(system, cost, [la.Bound("*", min=0.0, of="tension")])


def run(seconds: float, *, controlled: bool = True) -> tuple[ClosedLoop, la.MidpointVI]:
    """Return the loop, or how the marionette swings where the hands stand still."""
    m = marionette()
    vi = la.MidpointVI(m)
    start = vi.start(rest_pose(m)).x
    t = DT * np.arange(round(seconds / DT) + 1)

    def knock(at: float, _: np.ndarray) -> np.ndarray:
        out = np.zeros(m.nx)
        for when, (name, momentum) in KNOCKS.items():
            if abs(at - when) < 1e-6:
                out[m.nq + m.dynamic.index(name)] = momentum
        return out

    law = controller(m, start) if controlled else (lambda _t, _x: start[m.nd : m.nq])
    return close_loop(vi, law, start, t, disturbance=knock), vi


def main(output: Path, seconds: float = 3.5) -> ClosedLoop:
    """Run it with hands that act and with hands that stand still, print and draw."""
    loop, vi = run(seconds)
    still, _ = run(seconds, controlled=False)
    m = vi.mechanism
    rest = rest_pose(m)

    def off(each: ClosedLoop) -> np.ndarray:
        return np.abs(each.x[:, : m.nd] - rest[: m.nd]).max(axis=1)

    print(f"half a second after a knock it is off by {off(loop)[80]:.3f}, with still hands by {off(still)[80]:.3f}")
    print(f"plans that were made: {sum(info.planned for info in loop.infos)} of {len(loop.infos)}")
    output.mkdir(parents=True, exist_ok=True)
    motion = la.MidpointSystem(vi, loop.t).trajectory(loop.x, loop.u)
    view = la.show(motion, traces=["rhand", "head_center"], title="Knocked about")
    view.save(output / "28_pushed_marionette.html")
    return loop


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
