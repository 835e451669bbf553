"""The gains of a motor that holds an arm are fitted to margins by python-control, which says what delay they bear.

The arm is to be held aloft, where it would fall, by place and rate. Gains are sought by which the loop of its linear
model comes as near to a phase margin of 45 degrees and a bandwidth as it can; then the arm itself is let loose with
delays on either side of what the margin says.

    python examples/31_margins_of_a_loop.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import control
import numpy as np
from scipy.optimize import minimize

import leastaction as la
from leastaction.control.bridge.python_control import state_space
from leastaction.viz import BLUE, ORANGE, new_figure, save_png, styled

ALOFT, DT = 2.5, 0.005
ARM = la.Mechanism(
    [la.ry("elbow"), [la.tz(-0.8, name="hand", mass=2.0, inertia=(0.02, 0.02, 0.01))]],
    [la.Gravity(), la.Damping(0.2), la.JointForce("elbow", input="motor")],
)
SYSTEM = la.MechanismSystem(ARM)
INERTIA = float(ARM.mass_matrix(np.zeros(1))[0, 0])
HELD = -INERTIA * SYSTEM.f(np.array([ALOFT, 0.0]), np.zeros(1), 0.0)[1]  # what bears its weight
MODEL = state_space(SYSTEM, [ALOFT, 0.0], [HELD], measure=np.eye(2))


def margins(gains: np.ndarray) -> tuple[float, float]:
    """Return the phase margin (degrees) of the loop that is opened at the motor, and where that is (rad/s)."""
    _, phase, _, crossing = control.margin(control.ss(MODEL.A, MODEL.B, np.abs(gains)[None], 0.0))
    return float(phase), float(crossing)


def off(gains: np.ndarray) -> float:
    """Return by how much gains miss a margin of 45 degrees and a bandwidth of 12 rad/s, in squares."""
    phase, crossing = margins(gains)
    return ((phase - 45.0) / 45.0) ** 2 + ((crossing - 12.0) / 12.0) ** 2 if np.isfinite(phase + crossing) else 1e3


@styled
def main(output: Path) -> tuple[float, dict[float, bool]]:
    """Fit, try, print and draw; return the delay that the loop bears, and by delay (s) whether the arm was held."""
    found = minimize(off, [60.0, 5.0], method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-8})
    phase, crossing = margins(gains := np.abs(found.x))
    bears = np.radians(phase) / crossing - 0.5 * DT  # the motor's torque is held over a step: half of that late
    print(f"gains {gains.round(1)}: a phase margin of {phase:.0f} degrees at {crossing:.1f} rad/s")
    print(f"the loop bears a delay of {1e3 * bears:.0f} ms")
    t, held, runs = DT * np.arange(601), {}, {}
    for delay in DT * np.round(np.array([0.5, 0.85, 1.2]) * bears / DT):
        law = lambda _, x: HELD - gains @ [[x[0] - ALOFT], [x[1] / INERTIA]]  # noqa: E731 - x[1] is its momentum
        runs[delay] = run = la.simulate(la.MidpointVI(ARM), [ALOFT + 0.02], None, t, inputs=law, delay=delay)
        away = np.abs(run["elbow"] - ALOFT)
        held[float(delay)] = run.failure is None and bool(away[-100:].max() < 0.5 * away[:200].max())
        print(f"{1e3 * delay:.0f} ms late it is {'held' if held[float(delay)] else 'lost'}")
    output.mkdir(parents=True, exist_ok=True)
    top, bottom = (figure := new_figure(9.0, 6.0)).subplots(2, 1)
    w = np.geomspace(1.0, 200.0, 400)
    size, angle, _ = control.frequency_response(control.ss(MODEL.A, MODEL.B, gains[None], 0.0), w)
    top.loglog(w, size, color=BLUE)
    top.axhline(1.0, color="0.7", linewidth=0.8)
    top.set(xlabel="rad/s", ylabel="size", title=f"The loop: {phase:.0f} degrees to spare where it is one")
    (beside := top.twinx()).plot(w, np.degrees(np.unwrap(angle)), color=ORANGE)
    beside.set_ylabel("phase (degrees)", color=ORANGE)
    for delay, run in runs.items():
        bottom.plot(run.t, np.degrees(run["elbow"]), label=f"{1e3 * delay:.0f} ms late")
    bottom.set(xlabel="time (s)", ylabel="elbow (degrees)", title="The arm, let loose", ylim=(137.0, 149.0))
    bottom.legend()
    save_png(figure, output / "31_margins_of_a_loop.png", dpi=110)
    return bears, held


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
