"""Elements of your own, written as SymPy expressions: a cam, a magnet with a current, a screw of variable pitch.

Each is one expression in places and variables of the mechanism. The package compiles it for the core, which evaluates
and differentiates it by itself; there is nothing to differentiate by hand.

    python -m benchmarks.studies.user_elements --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy
from matplotlib.figure import Figure

from leastaction import (
    Gravity,
    Mechanism,
    MidpointVI,
    Trajectory,
    project_configuration,
    project_velocity,
    rz,
    ty,
    tz,
)
from leastaction.mechanics import ExpressionConstraint, ExpressionForce
from leastaction.mechanics.expressions.terms import input_, parameter, point, variable
from leastaction.viz.figures import BLUE, ORANGE, VERMILION, styled

GRAVITY = 9.81


# A cam lifts a follower: a constraint between the height of a point and the angle of a wheel.


def profile(angle: sympy.Expr) -> sympy.Expr:
    """Return the lift of the cam (m): one lobe a turn, smooth, with a dwell at the bottom."""
    return 0.03 * ((1 - sympy.cos(angle)) / 2) ** 2


def cam_and_follower() -> Mechanism:
    """Return a heavy wheel that carries the cam, and the follower above it."""
    lift = point("follower")[1] - profile(variable("angle"))
    return Mechanism(
        [
            rz("angle", name="wheel", mass=3.0, inertia=(0.01, 0.01, 0.02)),
            ty("lift", name="follower", mass=0.5),
        ],
        [Gravity((0.0, -GRAVITY, 0.0)), ExpressionConstraint(lift, name="cam")],
    )


def turn_cam(turns_per_second: float = 3.2) -> Trajectory:
    """Return two turns of the wheel, which slows down as it lifts the follower; it starts a little up the lobe."""
    m = cam_and_follower()
    vi = MidpointVI(m)
    q = project_configuration(m, [0.1, 0.0], hold=["angle"]).q
    v = project_velocity(m, q, [2.0 * np.pi * turns_per_second, 0.0], hold=["angle"]).v
    return vi.simulate(vi.start(q, v), np.linspace(0.0, 0.65, 1301))


# A coil holds an iron ball in the air: a force that depends on a current and a gap.


def levitation() -> Mechanism:
    """Return a ball under a coil; the force is C i^2 / gap^2, upwards."""
    gap = -point("ball")[2]  # the coil is at the origin
    pull = parameter("C", 2e-4) * input_("current") ** 2 / gap**2
    return Mechanism(
        [tz("z", name="ball", mass=0.05)],
        [Gravity((0.0, 0.0, -GRAVITY)), ExpressionForce(pull, "z", name="coil")],
    )


def levitate(seconds: float = 1.2, dt: float = 1e-3) -> Trajectory:
    """Return the ball as a controller sets the current from the gap and its rate, each step anew.

    The wanted gap goes from 20 to 16 mm at a third of the time.
    """
    m = levitation()
    C, mass = m.parameters["coil.C"], m.parameters["ball.mass"]
    vi = MidpointVI(m)
    state = vi.start([-0.023])
    states, currents = [state.x], []
    for k in range(round(seconds / dt)):
        wanted = 0.020 if k * dt < seconds / 3.0 else 0.016
        gap, rate = -state.q[0], -state.p[0] / mass
        force = mass * (GRAVITY + 900.0 * (gap - wanted) + 60.0 * rate)
        currents.append([np.sqrt(max(force, 0.0) / C) * gap])
        state = vi.step(state, dt, inputs=currents[-1]).state
        states.append(state.x)
    t = dt * np.arange(len(states))
    return vi.trajectory(t, np.array(states), np.array(currents), np.zeros((len(currents), 0)))


# A nut runs down a screw whose pitch grows: a constraint between a travel and an angle.


def travel(angle: sympy.Expr) -> sympy.Expr:
    """Return how far the nut is down the screw (m): the pitch grows from 10 mm a turn."""
    return 0.010 * angle / (2 * sympy.pi) + 2e-5 * angle**2


def screw_and_nut() -> Mechanism:
    """Return a screw about z with its inertia, and a nut that slides along it and cannot turn."""
    on_thread = variable("z") + travel(variable("angle"))
    return Mechanism(
        [
            rz("angle", name="screw", mass=1.0, inertia=(1e-4, 1e-4, 2e-6)),
            tz("z", name="nut", mass=0.4),
        ],
        [Gravity((0.0, 0.0, -GRAVITY)), ExpressionConstraint(on_thread, name="thread")],
    )


def run_down() -> Trajectory:
    """Return the nut running down from rest near the top, which spins the screw."""
    m = screw_and_nut()
    vi = MidpointVI(m)
    q = project_configuration(m, [0.1, 0.0], hold=["angle"]).q
    return vi.simulate(vi.start(q), np.linspace(0.0, 0.4, 2001))


@dataclass(frozen=True)
class Result:
    """The three motions, and how well each keeps what is known of it."""

    cam: Trajectory
    ball: Trajectory
    nut: Trajectory
    cam_error: float  # of the follower's height (m)
    cam_energy: float  # largest change of the energy, of the kinetic energy at the start
    current_error: float  # of the current at the end, relative to the one that carries the weight
    nut_error: float  # of the screw's speed against energy conservation, relative


def check(cam: Trajectory, ball: Trajectory, nut: Trajectory) -> Result:
    """Compare with what is known in closed form."""
    angle = sympy.Symbol("angle")
    lift = sympy.lambdify(angle, profile(angle))(cam["angle"])
    energy = cam.energy()
    total = energy.kinetic + energy.potential
    p = ball.mechanism.parameters
    carries = np.sqrt(p["ball.mass"] * GRAVITY / p["coil.C"]) * 0.016
    # The nut: (I + m s'^2) w^2 / 2 = m g s at the midpoints of the steps.
    middle = 0.5 * (nut["angle"][1:] + nut["angle"][:-1])
    s, slope = (sympy.lambdify(angle, e)(middle) for e in (travel(angle), travel(angle).diff()))
    s += nut["z"][0]  # from where it started
    n = nut.mechanism.parameters
    speed = np.sqrt(2.0 * n["nut.mass"] * GRAVITY * s / (n["screw.inertia.zz"] + n["nut.mass"] * slope**2))
    w = np.diff(nut["angle"]) / np.diff(nut.t)
    return Result(
        cam,
        ball,
        nut,
        float(np.abs(cam["lift"] - lift).max()),
        float(np.ptp(total) / energy.kinetic[0]),
        float(ball.inputs[-1, 0] / carries - 1.0),
        float(np.abs(w / speed - 1.0)[100:].max()),
    )


@styled
def draw(result: Result) -> Figure:
    """Return the figure, with a column for each element."""
    figure = Figure(figsize=(12.0, 5.6), layout="constrained")
    (lift, gap, travelled), (contact, current, speed) = figure.subplots(2, 3, sharex="col")
    cam, ball, nut = result.cam, result.ball, result.nut
    turned = cam["angle"] / (2.0 * np.pi)
    lift.plot(turned, 1e3 * cam["lift"], color=BLUE)
    lift.set(title="cam", ylabel="lift of the follower (mm)", xlim=(0.0, 2.0))
    # The constraint is h = height - profile, so its force on the follower is -lam/dt. An impulse acts at the
    # start of a step, the first for half a step only.
    force = -cam["cam"] / np.diff(cam.t)
    contact.plot(turned[1:-1], force[1:], color=VERMILION)
    contact.axhline(0.0, color="0.5", lw=0.8)
    contact.fill_between(turned[1:-1], np.minimum(force[1:], 0.0), color=VERMILION, alpha=0.25, lw=0)
    contact.set(xlabel="turns of the cam", ylabel="force on the follower (N)", xlim=(0.0, 2.0))
    contact.text(1.0, 1.2, "shaded: the cam\nwould have to pull", ha="center", fontsize=9)
    wanted = np.where(ball.t < ball.t[-1] / 3.0, 20.0, 16.0)
    gap.plot(ball.t, wanted, "--", color="0.5", lw=1, label="wanted")
    gap.plot(ball.t, -1e3 * ball["z"], color=BLUE, label="gap")
    gap.set(title="magnet with a current", ylabel="gap under the coil (mm)", ylim=(23.5, 15.0))
    gap.legend(frameon=False, loc="lower right")
    current.plot(ball.t[:-1], ball.inputs[:, 0], color=ORANGE)
    current.set(xlabel="time (s)", ylabel="current (A)")
    travelled.plot(nut.t, -1e3 * nut["z"], color=BLUE)
    travelled.set(title="screw of growing pitch", ylabel="travel of the nut (mm)")
    rate = np.diff(nut["angle"]) / np.diff(nut.t) / (2.0 * np.pi)
    speed.plot(0.5 * (nut.t[1:] + nut.t[:-1]), rate, color=VERMILION)
    speed.set(xlabel="time (s)", ylabel="speed of the screw (turns/s)")
    for axis in figure.axes:
        axis.margins(x=0.0)
    return figure


def main(output: Path) -> Result:
    """Simulate, check, print and draw."""
    result = check(turn_cam(), levitate(), run_down())
    print(result.cam.mechanism)
    print(f"cam:    height of the follower within {result.cam_error:.0e} m of the profile,")
    print(f"        energy within {result.cam_energy:.0e} of that of the wheel")
    print(f"magnet: the current at the end carries the weight within {result.current_error:.1e}")
    print(f"screw:  speed within {result.nut_error:.0e} of what energy conservation says")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "user_elements.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
