"""Periodic motions and accelerations across steps where rotations are quaternions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from leastaction import (
    Bound,
    Damping,
    FinalTime,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    Parameter,
    Periodic,
    QuadraticCost,
    ball,
    free,
    optimize,
    rz,
    tx,
)
from leastaction.errors import ArgumentError
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal import FunctionSystem, OptimizationResult, ProductSpace, Rotations, Vectors, check_derivatives
from leastaction.optimal.looking_back import TURN
from leastaction.optimal.quantity import Samples
from leastaction.optimal.remembered.system import RememberingSystem
from leastaction.optimal.unknowns.returning import TurnedBack
from leastaction.optimal.unknowns.system import ExtendedSystem

N, LASTS = 24, 1.6
HULL = Mechanism(
    [tx("rail", mass=0.3), [ball("hull", mass=1.0, com=(0.0, 0.0, 0.1), inertia=(0.03, 0.04, 0.05))]],
    [
        Damping(0.2),
        Gravity(),
        *[JointForce(f"hull.w{letter}", f"u{letter}") for letter in "xyz"],
        JointForce("rail", "f"),
    ],
)


def wanted(t: Array) -> Array:
    """Return states of a hull that nods on a round, twice a second, with kinks that no torque follows."""
    angle = 0.7 * np.sign(np.sin(2.0 * np.pi * t / LASTS + 0.3))
    x = np.zeros((len(t), HULL.nx))
    x[:, 1:5] = np.stack([np.cos(angle), np.sin(angle) * 0.8, np.sin(angle) * 0.6, 0.0 * t], axis=1)
    return x


def solved(limits: list[Any], shift: int = 0, **more: Any) -> OptimizationResult:
    """Return the motion that begins `shift` steps later in the round."""
    t = np.linspace(0.0, LASTS, N + 1)
    system = MidpointSystem(MidpointVI(HULL, threads=1), t)
    Q = np.r_[1.0, np.full(3, 4.0), np.zeros(4)]
    states = wanted(t + shift * LASTS / N)
    cost = QuadraticCost(states, np.zeros(4), Q=Q, R=[2e-2] * 4, Q_final=0.0 * Q, space=system)
    start = MidpointVI(HULL).start([0.0, 1.0, 0.0, 0.0, 0.0]).x, np.zeros((N, 4))
    return optimize(system, cost, initial=start, limits=[Periodic("*"), *limits], free_start=True, **more)


def turns(result: OptimizationResult) -> Array:
    """Return the mean angular velocities over steps, (N, 3)."""
    q = result.x[:, 1:5]
    dt = np.diff(result.t)[:, None]
    return np.asarray(rotations.logarithm(rotations.product(rotations.inverse(q[:-1]), q[1:])) / dt)


def test_the_end_is_the_start_wherever_the_round_begins() -> None:
    first, other = solved([]), solved([], 7)
    for result in (first, other):
        assert result.success, result.message
        assert np.abs(turns(result)).max() > 1.0
        off = Rotations().difference(result.x[-1, 1:5], result.x[0, 1:5])
        assert np.abs(off).max() < 1e-9
        assert np.abs(result.x[-1, [0, *range(5, 9)]] - result.x[0, [0, *range(5, 9)]]).max() < 1e-8
    assert first.cost == pytest.approx(other.cost, rel=1e-8)
    np.testing.assert_allclose(np.roll(other.u, 7, axis=0), first.u, atol=1e-4)


def test_accelerations_are_limited_across_the_seam_too() -> None:
    free_of = turns(solved([]))
    most = 0.7 * np.abs(free_of - np.roll(free_of, 1, axis=0)).max() * N / LASTS
    limit = Bound("hull.w*", -most, most, of="acceleration")
    found = [solved([limit], shift) for shift in (0, 5)]
    for result in found:
        assert result.success, result.message
        w = turns(result)
        assert np.abs(w - np.roll(w, 1, axis=0)).max() * N / LASTS == pytest.approx(most, rel=1e-5)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-6)


def test_accelerations_of_a_motion_that_does_not_return() -> None:
    """Of turns and of a slide before them, of a body that stops as fast as it may."""
    m = Mechanism([free("b", mass=1.0, inertia=(0.1, 0.1, 0.1))], [JointForce(f"b.{a}", a) for a in ("x", "wx", "wy")])
    system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 1.0, 21))
    goal = np.zeros(m.nx)
    goal[[0, 3, 4]] = 0.5, np.cos(0.6), np.sin(0.6)
    cost = QuadraticCost(
        goal, np.zeros(3), Q=np.r_[20.0, 0, 0, 20.0, 20.0, 0.0, np.zeros(6)], R=[1e-3] * 3, space=system
    )
    start = MidpointVI(m).start(m.configuration()).x, np.zeros((20, 3))
    limits = [Bound("b.w*", -9.0, 9.0, of="acceleration"), Bound("b.x", -7.0, 7.0, of="acceleration")]
    result = optimize(system, cost, initial=start, limits=limits)
    assert result.success, result.message
    q = result.x[:, 3:7]
    w = rotations.logarithm(rotations.product(rotations.inverse(q[:-1]), q[1:])) * 20.0
    assert np.abs(np.diff(w, axis=0)).max() * 20.0 == pytest.approx(9.0, rel=1e-5)
    assert np.abs(np.diff(result.x[:, 0], 2)).max() * 400.0 == pytest.approx(7.0, rel=1e-5)


def test_unknowns_beside_what_returns() -> None:
    unknowns = [FinalTime(1.0, 1.7, price=0.3), Parameter("hull.mass", 0.5, 2.0, weight=5.0)]
    found = [solved([], shift, unknowns=unknowns) for shift in (0, 6)]
    for result in found:
        assert result.success, result.message
        assert np.abs(Rotations().difference(result.x[-1, 1:5], result.x[0, 1:5])).max() < 1e-8
    for name in ("final time", "hull.mass"):
        assert found[0].unknowns[name] == pytest.approx(found[1].unknowns[name], rel=1e-4)


def test_derivatives_of_systems_that_keep_and_remember_rotations() -> None:
    rng = np.random.default_rng(2)
    carried = Mechanism(
        [ball("hand", kinematic=True), [rz("swing", mass=0.5, com=(0.1, 0.2, 0.0), inertia=(1e-2,) * 3)]]
    )
    for m in (HULL, carried):
        system = MidpointSystem(MidpointVI(m, threads=1, tolerance=1e-15), np.linspace(0.0, 0.3, 4))
        names = ["hull.mass"] if m is HULL else ["swing.mass"]
        place = m.coordinates.index("hull.qw" if m is HULL else "hand.qw")
        remembers = RememberingSystem(system, [("input", 0), ("state", 0), (TURN, place)], [(TURN, place)])
        x0 = system.integrator.start(m.configuration(), rng.standard_normal(m.nv)).x
        u = 0.3 * rng.standard_normal((3, system.nu))
        for keeping in (system, remembers):
            base = keeping.extended(np.tile(x0, (4, 1)), u) if keeping is remembers else np.tile(x0, (4, 1))
            copied = keeping.returning_entries(["*"], "test")
            whole = ExtendedSystem(keeping, names, copied, True)
            start = whole.extended(base, np.array([1.1]))
            x = whole.rollout(start[0], start, u, np.zeros((3, whole.nu, whole.ndx)), 0, 3).x
            cost = QuadraticCost(x, u, Q=np.ones(whole.ndx), R=np.ones(whole.nu), space=whole)
            report = check_derivatives(whole, x, u, cost=cost)
            assert report.ok, report
            K = rng.standard_normal((3, whole.nu, whole.ndx)) * 0.1
            other = whole.space.plus(x, 0.05 * rng.standard_normal((4, whole.ndx)))
            made = whole.rollout(x[0], other, u, K, 0, 3)
            for k in range(3):
                wanted_u = u[k] - K[k] @ whole.difference(made.x[k], other[k])
                assert np.abs(made.u[k] - wanted_u).max() < 1e-12


def test_what_is_missing_has_its_derivatives() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((5, 9))
    for first in (0, 5):
        x[:, first : first + 4] /= np.linalg.norm(x[:, first : first + 4], axis=1, keepdims=True)
    space = ProductSpace(Rotations(), Vectors(1), Rotations())
    missing = TurnedBack(["a", "b", "c"], np.array([[0, 5]]), np.array([[0, 4]]))
    y, columns = rng.standard_normal((5, 3)), missing.columns(7, 0)

    def at(x: Array) -> Samples:
        return Samples(np.arange(5), x, np.zeros((5, 0)), np.zeros((5, 0)))

    def value(dx: Array) -> Array:
        return missing.values(at(space.plus(x, np.broadcast_to(dx, (5, 7)))))

    h, eye = 1e-3, np.eye(7)
    J, H = missing.jacobian(at(x)), missing.curvature(at(x), y)
    for i, column in enumerate(columns):
        e = h * eye[column]
        slope = (8.0 * (value(e) - value(-e)) - (value(2 * e) - value(-2 * e))) / (12.0 * h)
        assert np.abs(J[:, :, i] - slope).max() < 1e-9
        for j, other in enumerate(columns):
            f = h * eye[other]
            bent = (value(e + f) - value(e - f) - value(f - e) + value(-e - f)) / (4.0 * h * h)
            assert np.abs(H[:, i, j] - np.sum(y * bent, axis=1)).max() < 1e-4


def test_a_users_rotations_return() -> None:
    """A body whose angular velocity is the input returns on a round with a price on standing still."""
    space = Rotations()
    dt = 0.1
    system = FunctionSystem(
        lambda x, u, k: rotations.product(x, rotations.exponential(dt * u)),
        nx=4,
        nu=3,
        N=12,
        space=space,
        derivatives="finite-differences",
        curvature="differences",
    )
    goal = np.stack([np.cos(a := 0.5 * np.sin(2 * np.pi * np.arange(13) / 12)), np.sin(a), 0 * a, 0 * a], axis=1)
    cost = QuadraticCost(goal, np.zeros(3), Q=[1.0] * 3, R=[0.01] * 3, Q_final=[0.0] * 3, space=system)
    result = optimize(
        system, cost, initial=([1.0, 0, 0, 0], np.zeros((12, 3))), limits=[Periodic("*")], free_start=True
    )
    assert result.success, result.message
    assert np.abs(space.difference(result.x[-1], result.x[0])).max() < 1e-9
    assert np.abs(space.difference(result.x[3], result.x[0])).max() > 0.5


def test_mistakes_are_named() -> None:
    t = np.linspace(0.0, 1.0, 5)
    system = MidpointSystem(MidpointVI(HULL, threads=1), t)
    cost = QuadraticCost(wanted(t), np.zeros(4), Q=np.ones(8), R=np.ones(4), space=system)
    start = MidpointVI(HULL).start([0.0, 1.0, 0.0, 0.0, 0.0]).x, np.zeros((4, 4))

    def asked(limit: Periodic) -> OptimizationResult:
        return optimize(system, cost, initial=start, limits=[limit], free_start=True)

    with pytest.raises(ArgumentError, match=r"hull\.qx.*returns as a whole.*hull\.qw"):
        asked(Periodic(["hull.qx"]))
    with pytest.raises(ArgumentError, match=r"offset: got 'hull\.qw'"):
        asked(Periodic("*", offset={"hull.qw": 0.1}))
