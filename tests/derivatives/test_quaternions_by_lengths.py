"""Derivatives by lengths, poses and all other numbers where rotations are quaternions: of steps, starts and whole runs.

Held to central differences of four widths, extrapolated to width zero, of differences of states.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from derivatives.differences import extrapolated
from leastaction import _core
from leastaction.mechanics import (
    BodyWrench,
    Damping,
    Distance,
    Gravity,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    State,
    ball,
    configuration_by,
    free,
    legendre_jacobian,
    pose,
    project_configuration,
    project_velocity,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.mechanics.discrete.step_sensitivity import momentum_by
from leastaction.numerics.arrays import Array

DT = 0.04


def arms(*elements: Any, held: bool = False) -> Mechanism:
    """A floating base with an arm on a ball joint whose hand is closed by a pin, beside a prescribed slide."""
    base = free("base", mass=2.0, com=(0.05, 0.02, -0.03), inertia=(0.1, 0.2, 0.15, 0.01, 0.02, -0.01))
    arm = ball("hip", name="arm", mass=0.5, com=(0.1, 0.03, 0.05), inertia=(0.02, 0.01, 0.015), kinematic=held)
    knee = rz({"knee": 1.3}, offset=0.2, name="shin", mass=0.4, com=(0.1, 0.0, 0.0), inertia=(0.01, 0.02, 0.02))
    hook = pose(translation=(0.05, 0.1, -0.2), name="hook")
    tree: list[Any] = [
        base,
        [tx(0.3, name="side"), [arm, [ty(-0.2, name="bone"), [knee, [tx(0.3, name="toe")]]]], hook],
    ]
    return Mechanism([*tree, tz("lift", kinematic=True, name="hand")], [Gravity(), *elements])


FORCES = (
    LinearSpring("toe", "hook", 40.0, 0.3, name="spring"),
    BodyWrench("arm", torque=("a", 0.3, "b"), name="wrench"),
    Damping({"base.wy": 0.3, "knee": 0.1}),
    JointSpring("knee", 1.5, 0.3, name="joint"),
)
LOOP = (PointToPoint("toe", "hand", name="pin"), Distance("hook", "hand", 0.4, name="rod"))
NAMES = [
    *("side.value", "bone.value", "toe.value", "hook.translation.x", "hook.translation.z"),
    *("shin.factor.knee", "shin.offset", "base.mass", "arm.com.y", "shin.inertia.xy", "spring.stiffness"),
]


def case(elements: tuple[Any, ...], *, held: bool = False) -> tuple[Mechanism, Array, Array]:
    """Return a mechanism with a configuration and a velocity that keep to its constraints."""
    m = arms(*elements, held=held and "rod" not in [e.name for e in elements])
    rng = np.random.default_rng(8)
    q = m.configuration({"knee": 0.4, "lift": 0.2})
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        turn = rng.standard_normal(4) + 2.0 * np.eye(4)[0]
        q[first : first + 4] = turn / np.linalg.norm(turn)
    q = project_configuration(m, q).q
    return m, q, project_velocity(m, q, rng.uniform(-1.5, 1.5, m.nv)).v


def unlike(m: Mechanism, end: State, to: State) -> Array:
    return np.asarray(_core.difference(m.core, end.x[None], to.x[None])[0])


def value_near(m: Mechanism, name: str, value: float) -> Mechanism:
    return m.with_parameters({name: value}, allow_nonphysical=True)


@pytest.mark.parametrize(
    ("elements", "held"), [(FORCES, False), (FORCES, True), (LOOP, False), ((*FORCES, *LOOP), False)],
    ids=["forces", "prescribed", "loop", "both"],
)  # fmt: skip
def test_steps(elements: tuple[Any, ...], held: bool) -> None:
    m, q, v = case(elements, held=held)
    start, names = MidpointVI(m).start(q, v), [name for name in NAMES if name in m.parameters]
    inputs = np.linspace(0.3, 0.5, m.n_inputs)
    rho = q[m.first_rho :].copy()
    rho[-1] += 0.02

    def made(other: Mechanism) -> Any:
        return MidpointVI(other, tolerance=1e-15).simulate(start, [0.0, DT], inputs=inputs, rho=rho[None])

    run = made(m)
    found = MidpointVI(m).differentiate_by(run, names)
    for column, name in enumerate(names):

        def moved(value: float, name: str = name) -> Array:
            other = made(value_near(m, name, value))
            return np.concatenate([unlike(m, other.last, run.last), other.lam[0]])

        at = m.parameters[name]
        wanted = extrapolated(moved, at, 2e-3)
        got = np.concatenate([found.x[0, :, column], found.lam[0, :, column]])
        assert np.abs(got - wanted).max() < 3e-9 * max(1.0, np.abs(wanted).max()), name


def test_momenta_and_starts_by_numbers() -> None:
    m, q, v = case(FORCES)
    by = momentum_by(m, q, v, NAMES)
    for column, name in enumerate(NAMES):

        def momentum(value: float, name: str = name) -> Array:
            return value_near(m, name, value).momentum(q, v)[: m.nd]

        wanted = extrapolated(momentum, m.parameters[name], 2e-3)
        assert np.abs(by[:, column] - wanted).max() < 1e-9, name


def test_assembled_configurations() -> None:
    m, q, _ = case(LOOP)
    names = ["bone.value", "hook.translation.x", "rod.length", "shin.offset"]
    found = configuration_by(m, q, names, hold=["base.x", "knee"])
    assert np.abs(found).max() > 0.1
    for column, name in enumerate(names):

        def closed(value: float, name: str = name) -> Array:
            other = value_near(m, name, value)
            new = project_configuration(other, q, hold=["base.x", "knee", "lift"], tolerance=1e-14).q
            rest = np.zeros(m.nv)
            return np.asarray(_core.difference(m.core, np.r_[new, rest][None], np.r_[q, rest][None])[0, : m.nv])

        wanted = extrapolated(closed, m.parameters[name], 1e-3)
        assert np.abs(found[:, column] - wanted).max() < 1e-6, name


def test_whole_runs_from_a_velocity() -> None:
    """Of a loop whose start follows the lengths, by the least change that is needed."""
    m, q, v = case((*FORCES, *LOOP))
    t, names = np.linspace(0.0, 0.2, 6), ["bone.value", "toe.value", "arm.mass", "rod.length"]
    hold = ["base.x", "base.z"]

    def made(other: Mechanism) -> Any:
        at = project_configuration(other, q, hold=[*hold, "lift"], tolerance=1e-14).q
        speed = project_velocity(other, at, v, hold=[*hold, "lift"]).v
        vi = MidpointVI(other, tolerance=1e-15)
        return vi.simulate(vi.start(at, speed), t, inputs=[0.3, 0.2])

    run = made(m)
    found = MidpointVI(m).sensitivity(run, names, v=v, hold=hold)
    assert found.x.shape == (6, m.ndx, 4)
    for column, name in enumerate(names):

        def moved(value: float, name: str = name) -> Array:
            other = made(value_near(m, name, value))
            return np.asarray(_core.difference(m.core, other.x, run.x))

        wanted = extrapolated(moved, m.parameters[name], 1e-3)
        assert np.abs(found.x[:, :, column] - wanted).max() < 2e-6 * max(1.0, np.abs(wanted).max()), name


def test_momenta_by_states() -> None:
    m, q, v = case((), held=True)
    T = legendre_jacobian(m, q, v)
    for j in range(m.ndx):
        dx = np.eye(m.ndx)[j]

        def momentum(by: float, dx: Array = dx) -> Array:
            x = _core.plus(m.core, np.r_[q, np.zeros(m.nv)][None], by * dx[None])[0]
            return m.momentum(x[: m.nq], v + by * dx[m.nv :])[: m.nd]

        assert np.abs(T[m.nv : m.nv + m.nd, j] - extrapolated(momentum, 0.0, 1e-2)).max() < 1e-9
