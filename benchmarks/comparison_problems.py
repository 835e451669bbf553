"""The motions that methods are compared on: each with a reference, and as MJCF for MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.cases import Array
from benchmarks.mujoco_puppet import mjcf
from leastaction.mechanics import Body, Gravity, Mechanism, PointToPoint, world
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.models import chain, marionette

G = 9.81


@dataclass(frozen=True)
class Problem:
    """One motion from a start.

    ``steps`` is the coarsest number of steps, ``energy_scale`` (J) what energies are compared with, ``mjcf`` takes the
    name of MuJoCo's integrator and the time step (s). ``free`` is the same without gravity where that keeps the
    momentum of the first variable.
    """

    name: str
    title: str
    mechanism: Mechanism
    q0: Array
    v0: Array
    end: float
    steps: int
    energy_scale: float
    unit: str
    drift_unit: str
    reference: Callable[[Array], Array]
    mjcf: Callable[[str, float], str]
    free: Problem | None = None

    def samples(self, count: int) -> Array:
        """Return the instants of the comparison."""
        return np.linspace(0.0, self.end, count + 1)


def _fine(m: Mechanism, q0: Array, v0: Array) -> Callable[[Array], Array]:
    def reference(t: Array) -> Array:
        run = simulate(m, q0, v0, t, rtol=1e-12, atol=1e-13, dense_output=False)
        if len(run.t) < len(t):
            raise RuntimeError(run.message)
        return run.q

    return reference


def _with(xml: str, integrator: str) -> str:
    return xml.replace('integrator="Euler"', f'integrator="{integrator}"')


def double_pendulum(*, free: bool = False) -> Problem:
    """Return two links that swing high, or turn about their pivot free of gravity."""
    m = chain.pendulum_chain(2, gravity=(0.0, 0.0, 0.0 if free else -9.8))
    q0, v0 = np.array([1.5, -0.5]), np.array([0.0, 1.0])
    x0 = np.zeros(m.nx)
    return Problem(
        "double_pendulum", "Double pendulum", m, q0, v0, 10.0, 200,
        m.energy([np.pi, 0.0], 0.0 * v0).total - m.energy(0.0 * q0, 0.0 * v0).total,
        "rad", "", _fine(m, q0, v0), lambda integrator, dt: _with(mjcf(m, x0, dt), integrator),
        None if free else double_pendulum(free=True),
    )  # fmt: skip


def lift(segments: int = 3) -> Problem:
    """Return a scissor lift that falls through its singular configuration, links upright, and swings back.

    Links of 1 m and 1 kg hang from a pivot and a slider of 0.5 kg; it has one degree of freedom, whose equation of
    motion is the reference.
    """
    rod = Body(1.0, com=(0.5, 0.0, 0.0), inertia=(0.0, 1.0 / 12.0, 1.0 / 12.0))
    tree = world()
    ends = {"L": tree, "R": tree.tx("slider", bodies=[Body(0.5)])}
    for n in range(segments):
        turned = {side: end.ry(f"{side}{n}", bodies=[rod]) for side, end in ends.items()}
        for side, branch in turned.items():
            branch.tx(0.5, name=f"middle_{side}{n}")
        ends = {"R": turned["L"].tx(1.0), "L": turned["R"].tx(1.0)}
    pins = [PointToPoint(f"middle_L{n}", f"middle_R{n}", "xz", name=f"pin{n}") for n in range(segments)]
    m = Mechanism(tree, [Gravity((0.0, 0.0, -G)), *pins])
    angle = 0.6

    def at(a: Array) -> Array:
        """Return configurations with the links at angles below the horizontal."""
        columns = {"slider": np.cos(a), "L0": a, "R0": np.pi - a}
        for name in m.variables:
            if name not in columns:
                columns[name] = (1.0 if name[0] == "R" else -1.0) * (np.pi - 2.0 * a)
        return np.stack([columns[name] for name in m.variables], axis=-1)

    arms = np.arange(segments) + 0.5

    def rate(_: float, y: Array) -> list[float]:
        s, c = np.sin(y[0]), np.cos(y[0])
        inertia = np.sum(2.0 * (s**2 / 4.0 + arms**2 * c**2 + 1.0 / 12.0)) + 0.5 * s**2
        slope = 2.0 * s * c * (np.sum(2.0 * (0.25 - arms**2)) + 0.5)
        return [y[1], (2.0 * G * c * arms.sum() - 0.5 * slope * y[1] ** 2) / inertia]

    def reference(t: Array) -> Array:
        out = solve_ivp(rate, (t[0], t[-1]), [angle, 0.0], t_eval=t, method="DOP853", rtol=1e-12, atol=1e-12)
        return at(out.y[0])

    def xml(integrator: str, dt: float) -> str:
        def link(side: str, n: int, pos: str) -> str:
            below = ""
            if n + 1 < segments:
                below = link("R" if side == "L" else "L", n + 1, "1 0 0")
            return (
                f'<body pos="{pos}"><joint name="{side}{n}" type="hinge" axis="0 1 0"/>'
                f'<inertial mass="1" pos="0.5 0 0" diaginertia="1e-9 {1 / 12} {1 / 12}"/>'
                f'<site name="{side}{n}" pos="0.5 0 0"/>{below}</body>'
            )

        pinned = "".join(f'<connect site1="L{n}" site2="R{n}"/>' for n in range(segments))
        return (
            f'<mujoco><compiler angle="radian" balanceinertia="true"/>'
            f'<option timestep="{dt!r}" integrator="{integrator}" gravity="0 0 {-G}"/>'
            f'<worldbody>{link("L", 0, "0 0 0")}<body><joint name="slider" type="slide" axis="1 0 0"/>'
            f'<inertial mass="0.5" pos="0 0 0" diaginertia="1e-6 1e-6 1e-6"/>{link("R", 0, "0 0 0")}</body>'
            f"</worldbody><equality>{pinned}</equality></mujoco>"
        )

    q0 = at(np.array(angle))
    return Problem(
        "scissor_lift", f"Scissor lift of {segments} segments", m, q0, np.zeros(m.nq), 3.0, 120,
        2.0 * G * arms.sum(), "rad, m", "m", reference, xml,
    )  # fmt: skip


def puppet() -> Problem:
    """Return the marionette without damping, let go with its limbs away from their rest."""
    m = marionette.marionette(damping=0.0)
    q = marionette.rest_pose(m)
    q[6 : m.nd] += np.random.default_rng(0).uniform(-0.2, 0.2, m.nd - 6)
    q0 = marionette.hang_strings(m, q)
    v0 = np.zeros(m.nq)
    x0 = np.concatenate([q0, np.zeros(m.nd + m.nrho)])
    return Problem(
        "marionette", "Marionette on six strings", m, q0, v0, 2.0, 100,
        m.mass * 9.8 * 0.1, "rad, m", "m²", _fine(m, q0, v0),
        lambda integrator, dt: _with(mjcf(m, x0, dt), integrator),
    )  # fmt: skip


PROBLEMS: dict[str, Callable[[], Problem]] = {
    "double_pendulum": double_pendulum,
    "scissor_lift": lift,
    "marionette": puppet,
}
"""The problems by name."""
