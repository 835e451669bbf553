"""Mechanisms with quaternions steered in continuous time, as the numbers that they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

from derivatives.test_quaternions import FORCES, PIN, WRENCH, tumbling
from leastaction import Feedback, check_derivatives, simulate
from leastaction.elements import ExpressionPotential
from leastaction.errors import ArgumentError
from leastaction.expressions import time, variable
from leastaction.limits import Ball, Bound, Equal, Keep, Oriented, Pointing
from leastaction.mechanics import BodyWrench, Gravity, Mechanism, MidpointVI, ball, free, rx, ry, tx
from leastaction.optimal import (
    ContinuousQuadraticCost,
    DenseTrajectory,
    FinalTime,
    Options,
    Periodic,
    PiecewisePolynomial,
    QuadraticCost,
    Status,
    optimize,
)
from leastaction.optimal.collocation.limits import Points
from leastaction.optimal.collocation.mesh import MATRIX, RadauMesh
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.limits.charts import numbered
from leastaction.optimal.quantity import Samples
from leastaction.optimal.unknowns.returning import TurnedByNumbers
from leastaction.systems import MechanismSystem, MidpointSystem

MOMENTS = np.array([0.2, 0.3, 0.4])
SECONDS = 2.0


def satellite() -> MechanismSystem:
    hull = ball("hull", axes="quaternion", mass=1.0, inertia=MOMENTS)
    tip = tx(0.5, name="antenna")
    return MechanismSystem(Mechanism([hull, [tip]], [BodyWrench("hull", torque=("a", "b", "c"))]))


GOAL = np.r_[0.0, 1.0, 0.0, 0.0, np.zeros(3)]
START = np.r_[np.array([1.0, 0.1, 0.05, -0.02]) / np.sqrt(1.0129), 0.3, -0.2, 0.4]


def turned_over(system: MechanismSystem) -> ContinuousQuadraticCost:
    return ContinuousQuadraticCost(
        GOAL, np.zeros(3), Q=np.full(6, 0.1), R=np.full(3, 0.05), Q_final=np.full(6, 50.0), space=system
    )


@pytest.mark.parametrize("elements", [(), (PIN, *FORCES, WRENCH)], ids=["free", "all"])
def test_derivatives_are_those_of_differences(elements: tuple[Any, ...]) -> None:
    """By all numbers, also such that make quaternions longer."""
    m = tumbling(*elements)
    system, rng = MechanismSystem(m), np.random.default_rng(1)
    x, dx = np.r_[m.configuration(), rng.standard_normal(m.nv)], rng.standard_normal(m.nx)
    u, du = rng.standard_normal((2, system.nu))
    cost = ContinuousQuadraticCost(
        np.r_[m.configuration(), np.zeros(m.nv)],
        np.zeros(system.nu),
        Q=np.linspace(0.5, 2.0, m.ndx),
        R=np.ones(system.nu),
        Q_final=np.linspace(1.0, 2.0, m.ndx),
        space=system,
    )
    curve = DenseTrajectory.from_functions(
        lambda t: x + 0.3 * np.sin(t) * dx,
        lambda t: u + np.cos(t) * du,
        horizon=(0.0, 1.0),
        nx=system.nx,
        nu=system.nu,
    )
    errors = check_derivatives(system, curve, cost=cost)
    assert max(errors.errors.values()) < 1e-7, errors


LIMITS = {
    "entries": Bound("hull.qx", max=0.9),
    "rate": Bound("hull.wy", max=1.0, of="rate"),
    "input": Bound("b", -0.02, 0.02),
    "acceleration": Bound("hull.wx", max=2.0, of="acceleration"),
    "turn": Oriented("hull", np.eye(3), within=2.0),
    "axis": Pointing("antenna", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), within=2.0),
    "place": Keep("antenna", inside=Ball((0.5, 0.0, 0.0), 0.1)),
}
STATED = ("acceleration", "turn", "axis", "place")


@pytest.mark.parametrize("kind", STATED)
def test_limits_derive_by_numbers(kind: str) -> None:
    system, rng = satellite(), np.random.default_rng(5)
    points = Points(system, RadauMesh(np.array([0.0, 1.0])))
    (side, *_) = LIMITS[kind].rows(points, 0)
    quantity = numbered(side.quantity, system.space)
    x = np.r_[rng.standard_normal(4), rng.standard_normal(3)][None]
    x[:, :4] *= 1.01 / np.linalg.norm(x[:, :4])
    u, nothing = rng.standard_normal((1, 3)), np.empty((1, 0))
    y, k = rng.standard_normal((1, len(quantity.names))), np.array([1])

    def at(z: np.ndarray) -> Samples:
        return Samples(k, z[None, :7].copy(), nothing if quantity.of_state else z[None, 7:].copy(), nothing)

    z = x[0] if quantity.of_state else np.r_[x[0], u[0]]
    places = quantity.columns(7, 3)
    places = np.arange(len(z)) if places is None else places
    J, H = np.zeros((len(quantity.names), len(z))), np.zeros((len(z), len(z)))
    J[:, places] = quantity.jacobian(at(z))[0]
    H[places[:, None], places] = quantity.curvature(at(z), y)[0]

    def slope(z: np.ndarray) -> np.ndarray:
        out = np.zeros(len(z))
        out[places] = y[0] @ quantity.jacobian(at(z))[0]
        return out

    for i in range(len(z)):
        h = 1e-3 * np.eye(len(z))[i]
        by = [quantity.values(at(z + s * h))[0] for s in (1, -1, 2, -2)]
        assert np.abs((8 * (by[0] - by[1]) - (by[2] - by[3])) / 0.012 - J[:, i]).max() < 1e-8
        bent = [slope(z + s * h) for s in (1, -1, 2, -2)]
        assert np.abs((8 * (bent[0] - bent[1]) - (bent[2] - bent[3])) / 0.012 - H[i]).max() < 1e-7


def test_a_satellite_turns_over_as_in_discrete_time() -> None:
    """By 169 degrees; a discrete system comes to the same with its steps."""
    system = satellite()
    found = optimize(system, turned_over(system), initial=(START, np.zeros(3)), horizon=(0.0, SECONDS))
    assert found.status is Status.CONVERGED
    assert np.abs(system.difference(found.x[-1], GOAL)).max() < 0.01
    assert np.abs(np.linalg.norm(found.x[:, :4], axis=1) - 1.0).max() < 1e-8
    assert found.K.shape[1:] == (3, 7)
    costs = []
    for N in (40, 80):
        steps = MidpointSystem(MidpointVI(system.mechanism), np.linspace(0.0, SECONDS, N + 1))
        momenta = np.r_[np.ones(3), MOMENTS]
        weight = np.full(6, 0.1) / momenta**2 * SECONDS / N
        wanted = np.tile(GOAL, (N + 1, 1))
        cost = QuadraticCost(
            wanted,
            np.zeros((N, 3)),
            Q=np.vstack([[0.5 * weight], np.tile(weight, (N - 1, 1))]),
            R=np.full(3, 0.05) * SECONDS / N,
            Q_final=np.full(6, 50.0) / momenta**2 + 0.5 * weight,
            space=steps,
        )
        costs.append(optimize(steps, cost, initial=(START * np.r_[np.ones(4), MOMENTS], np.zeros((N, 3)))).cost)
    assert abs((4.0 * costs[1] - costs[0]) / 3.0 - found.cost) < 1e-4 * found.cost
    # The inputs that were found do it, and with the gains a start that is off comes back.
    motion = found.trajectory
    run = simulate(motion.mechanism, START[:4], START[4:], [0.0, SECONDS], inputs=found.dense.u, rtol=1e-10)
    assert np.abs(system.difference(run.x[-1], found.x[-1])).max() < 1e-5
    law = Feedback(found.feedback, found.dense.x, found.dense.u)
    off = system.plus(START, np.r_[0.2, -0.1, 0.1, 0.0, 0.1, 0.0])
    run = simulate(motion.mechanism, off[:4], off[4:], [0.0, 1.5], u=law)
    assert np.abs(system.difference(run.x[-1], found.dense.x(1.5))[:3]).max() < 0.05


@pytest.mark.parametrize("kind", ["acceleration", "place", "input"])
def test_limits_hold(kind: str) -> None:
    system = satellite()
    found = optimize(
        system, turned_over(system), initial=(START, np.zeros(3)), horizon=(0.0, SECONDS), limits=[LIMITS[kind]]
    )
    assert found.success, found.message
    assert found.limits is not None
    assert found.limits.excess < 1e-7


@pytest.mark.slow
def test_starts_and_ends_may_be_free() -> None:
    """A body that is thrown so that it lands as wanted: the rates of its start are found."""
    body = free("body", axes="quaternion", mass=1.0, inertia=MOMENTS)
    m = Mechanism([body], [Gravity(), BodyWrench("body", torque=("a", "b", "c"))])
    system = MechanismSystem(m)
    x0 = np.r_[m.configuration(), 0.0, 0.0, 5.0, 0.1, 3.0, 0.2]
    wanted = np.r_[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, np.zeros(6)]
    Q_final = np.r_[np.zeros(3), np.full(3, 100.0), np.zeros(6)]
    cost = ContinuousQuadraticCost(
        wanted, np.zeros(3), Q=np.r_[np.zeros(9), np.full(3, 0.01)], R=np.ones(3), Q_final=Q_final, space=system
    )
    stated = {"initial": (x0, np.zeros(3)), "horizon": (0.0, 1.0)}
    limits = [Equal("body.x", 0.0, at="end")]
    found = optimize(system, cost, **stated, free_start=["v_body.w*"], limits=limits)
    assert found.success, found.message
    assert np.abs(found.x[0, :10] - x0[:10]).max() < 1e-12
    assert np.abs(system.difference(found.x[-1], wanted)[3:6]).max() < 0.02
    free_turn = optimize(system, cost, **stated, free_start=["body.q*", "v_body.w*"])
    assert np.linalg.norm(free_turn.x[0, 3:7]) == pytest.approx(1.0, abs=1e-14)
    assert free_turn.cost < 1e-6


@pytest.mark.parametrize("collocate", [True, False])
@pytest.mark.parametrize("angle", [0.5, 3.0])
def test_large_turns_take_few_iterations(angle: float, collocate: bool) -> None:
    """A small body at rest, turned about its middle axis: steps of rotations, not of numbers."""
    hull = ball("hull", axes="quaternion", mass=1.0, inertia=(0.01, 0.02, 0.03))
    system = MechanismSystem(Mechanism([hull], [BodyWrench("hull", torque=("a", "b", "c"))]))
    goal = np.r_[np.cos(0.5 * angle), 0.0, np.sin(0.5 * angle), np.zeros(4)]
    weight = np.r_[np.full(3, 0.01), np.zeros(3)]
    price = {"Q": weight, "R": np.full(3, 0.01), "Q_final": np.full(6, 100.0)}
    cost = ContinuousQuadraticCost(goal, np.zeros(3), **price, space=system)
    stated = {"initial": (np.eye(7)[0], np.zeros(3)), "horizon": (0.0, 2.0)}
    found = optimize(system, cost, **stated, options=Options(collocate=collocate))
    assert found.success
    assert found.iterations <= 8
    assert found.cost == pytest.approx(0.001 * angle**2, rel=1e-6)


class InPython(MechanismSystem):
    """The same system, whose pieces are not rolled out in the core."""

    def roll_out_pieces(self, *_: Any) -> int:
        return 0


def test_pieces_roll_out_in_the_core_as_in_python() -> None:
    """With balls that are moved and such that move, a slide, a force that changes with the time, under a feedback."""
    hand = ball("hand", kinematic=True, mass=0.2, inertia=(1e-3, 1e-3, 2e-3))
    body = ball("hip", name="body", mass=0.5, com=(0.05, 0.0, -0.2), inertia=(2e-3, 3e-3, 1e-3))
    blown = ExpressionPotential(0.3 * variable("slide") * sp.sin(5.0 * time()))
    m = Mechanism(
        [hand, [tx("slide", mass=0.1), [body]]], [Gravity(), BodyWrench("body", torque=("a", 0.0, "c")), blown]
    )
    rng, mesh = np.random.default_rng(4), RadauMesh(np.array([0.0, 0.05, 0.08, 0.12]))
    core, python = (CollocationSystem(kind(m), mesh) for kind in (MechanismSystem, InPython))
    x0 = np.r_[m.configuration(), rng.standard_normal(m.nv)]
    u = 0.3 * rng.standard_normal((3, core.nu))
    start = python.layout.joined(np.tile(x0, (1, 3, 1)), np.zeros((1, 3, core.nu // 3)))[0]
    still = np.zeros((3, core.nu, core.ndx))
    reference = python.rollout(start, np.tile(start, (4, 1)), u, still, 0, 3)
    assert reference.failure is None
    moved = core.plus(start, np.r_[0.3 * rng.standard_normal(m.ndx), np.zeros(core.ndx - m.ndx)])
    K = 0.02 * rng.standard_normal(still.shape)
    runs = [each.rollout(moved, reference.x, u, K, 0, 3) for each in (core, python)]
    assert runs[0].failure is None
    assert np.abs(runs[0].u - runs[1].u).max() < 1e-10
    assert np.abs(runs[0].x - runs[1].x).max() < 1e-10
    out = core.system.roll_out_pieces(
        mesh.h, mesh.t, MATRIX, (reference.x, u), K, np.vstack([moved, np.zeros((3, core.nx))]), np.zeros_like(u)
    )
    assert out == 3


@pytest.mark.parametrize("bounded", [False, True])
def test_the_hand_is_an_input(bounded: bool) -> None:
    """Of a bar whose turns are prescribed the accelerations are found that bring a body on it where it is wanted."""
    hand = ball("hand", kinematic=True, mass=0.2, inertia=(1e-3, 1e-3, 2e-3))
    swing = ry("swing", name="body", mass=0.5, com=(0.0, 0.0, -0.2), inertia=(2e-3, 2e-3, 1e-3))
    m = Mechanism([hand, [rx("lean"), [swing]]], [Gravity()])
    system = MechanismSystem(m)
    x0 = np.r_[m.configuration(), np.zeros(5)]
    wanted = np.r_[0.0, 0.0, np.cos(0.5), 0.0, np.sin(0.5), 0.0, np.zeros(5)]
    price = {"Q": np.full(10, 1e-3), "R": np.full(3, 1e-3), "Q_final": np.r_[0.1, 0.1, np.full(8, 10.0)]}
    cost = ContinuousQuadraticCost(wanted, np.zeros(3), **price, space=system)
    limits = [Bound(["hand.wx", "hand.wy", "hand.wz"], -8.0, 8.0, of="acceleration")] if bounded else []
    found = optimize(system, cost, initial=(x0, np.zeros(3)), horizon=(0.0, 0.8), limits=limits)
    assert found.success, found.message
    assert np.abs(system.difference(found.x[-1], wanted)[2:5]).max() < 0.05
    assert bool(np.abs(found.u).max() < 8.0 + 1e-6) is bounded
    run = simulate(m, x0[:6], x0[6:], [0.0, 0.8], rho_a=found.dense.u, rtol=1e-10)
    assert np.abs(system.difference(run.x[-1], found.x[-1])).max() < 1e-4


def test_a_final_time_takes_few_iterations() -> None:
    """As long as it likes, at a price: what is beside a rotation leaves its steps what they are."""
    system, angle = satellite(), 3.0
    goal = np.r_[np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle), np.zeros(3)]
    price = {"Q": np.zeros(6), "R": np.full(3, 0.05), "Q_final": np.full(6, 50.0)}
    cost = ContinuousQuadraticCost(goal, np.zeros(3), **price, space=system)
    last = FinalTime(0.5, 10.0, price=0.1)
    found = optimize(system, cost, initial=(np.eye(7)[0], np.zeros(3)), horizon=(0.0, 2.0), unknowns=[last])
    assert found.success
    assert found.iterations <= 10
    # About its third axis, of inertia I: the effort R/2 12 I^2 angle^2 / T^3 and the price have their least sum.
    T = (3.0 * 0.05 * 6.0 * (MOMENTS[2] * angle) ** 2 / 0.1) ** 0.25
    assert found.unknowns["final time"] == pytest.approx(T, rel=0.02)


@pytest.mark.parametrize("given", ["weights", "gains"])
def test_a_projection_of_ones_own_is_by_numbers(given: str) -> None:
    """On a mesh as by roll-outs: the same minimum, from weights of states or from gains."""
    system = satellite()
    K = np.hstack([np.zeros((3, 1)), 2.0 * np.eye(3), np.eye(3)])
    projection: Any = {"Q": np.ones(7), "R": np.ones(3)}
    if given == "gains":
        projection = PiecewisePolynomial.constant(K, 0.0, SECONDS)
    stated = {"initial": (START, np.zeros(3)), "horizon": (0.0, SECONDS)}
    cost = turned_over(system)
    runs = [
        optimize(system, cost, **stated, options=Options(projection=projection, collocate=collocate))
        for collocate in (True, False)
    ]
    assert all(run.success for run in runs), [run.message for run in runs]
    assert runs[0].cost == pytest.approx(runs[1].cost, rel=1e-6)


def test_a_periodic_motion_may_turn_all_the_way_round() -> None:
    """A spin that is to be near 2.5 rad/s and return after 2 s: by a full turn, to the other quaternion."""
    system = satellite()
    wanted = np.r_[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.5]
    Q, Q_final = np.r_[np.zeros(3), np.ones(3)], np.r_[np.full(3, 0.01), np.zeros(3)]
    cost = ContinuousQuadraticCost(wanted, np.zeros(3), Q=Q, R=np.ones(3), Q_final=Q_final, space=system)
    stated = {"initial": (np.r_[np.eye(7)[0, :6], 3.0], np.zeros(3)), "horizon": (0.0, SECONDS), "free_start": True}
    found = optimize(system, cost, **stated, limits=[Periodic()])
    assert found.success, found.message
    assert np.abs(found.x[:, 4:] - [0.0, 0.0, np.pi]).max() < 1e-6
    assert np.abs(found.x[-1, :4] + found.x[0, :4]).max() < 1e-8
    with pytest.raises(ArgumentError, match=r"Periodic.*'hull\.qw' is one of the four numbers of a rotation"):
        optimize(system, cost, **stated, limits=[Periodic("hull.qw")])
    with pytest.raises(ArgumentError, match=r"modulo: got 'hull\.qx', a number of a rotation"):
        optimize(system, cost, **stated, limits=[Periodic(modulo={"hull.qx": 1.0})])


def test_a_rotation_that_returns_derives_by_numbers() -> None:
    rng = np.random.default_rng(2)
    turned = TurnedByNumbers("xyz", np.array([1, 2, 3, 4, 6, 7, 8, 9]))
    x, y, nothing = rng.standard_normal((1, 11)), rng.standard_normal((1, 3)), np.empty((1, 0))

    def at(x: np.ndarray) -> Samples:
        return Samples(np.array([0]), x, nothing, nothing)

    J, H = turned.jacobian(at(x))[0], turned.curvature(at(x), y)[0]
    for i, place in enumerate(turned.places):
        h = 1e-3 * np.eye(11)[[place]]
        by = [turned.values(at(x + s * h))[0] for s in (1, -1, 2, -2)]
        # Numbers count as the rotation that they are nearest to: along their length nothing changes.
        assert np.abs((8 * (by[0] - by[1]) - (by[2] - by[3])) / 0.012 - J[:, i]).max() < 1e-7
        bent = [y[0] @ turned.jacobian(at(x + s * h))[0] for s in (1, -1, 2, -2)]
        assert np.abs((8 * (bent[0] - bent[1]) - (bent[2] - bent[3])) / 0.012 - H[i]).max() < 1e-6
