"""The object that `linearize` returns: it owns its memory, whoever else works on the same integrator."""

from __future__ import annotations

import copy
import dataclasses
import gc
import pickle
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from leastaction import (
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError, StepError

N, DT = 30, 0.01


def swinging_weight() -> Mechanism:
    """A double pendulum whose end hangs on a string of prescribed length as well, and a motor."""
    return Mechanism(
        [
            rx("a", name="upper"),
            [tz(-1.0, mass=1.0), [rx("b"), [tz(-1.0, name="end", mass=0.5)]]],
            ty("post", name="post", kinematic=True),
        ],
        [
            Gravity((0, 0, -9.81)),
            JointForce("a", input="motor"),
            Distance("end", "post", "string"),
        ],
    )


@pytest.fixture(scope="module")
def system() -> MidpointSystem:
    return system_of(0)


def system_of(threads: int) -> MidpointSystem:
    return MidpointSystem(MidpointVI(swinging_weight(), threads=threads), DT * np.arange(N + 1), multipliers=True)


@pytest.fixture(scope="module")
def motions(system: MidpointSystem) -> list[tuple[np.ndarray, np.ndarray]]:
    """Trajectories that differ in their inputs."""
    m, rng = system.integrator.mechanism, np.random.default_rng(0)
    q = m.configuration({"a": 0.3, "b": -0.5, "post": 0.4})
    end = (m.frame_pose(q, "end") - m.frame_pose(q, "post"))[:3, 3]
    q = m.configuration({"a": 0.3, "b": -0.5, "post": 0.4, "string": float(np.linalg.norm(end))})
    x0 = np.concatenate([system.integrator.start(q).x, np.zeros(m.nc)])
    K = np.zeros((N, system.nu, system.nx))
    xbar = np.tile(x0, (N + 1, 1))
    found = []
    for _ in range(300):
        u = np.tile([0.0, q[m.variables.index("post")], q[m.variables.index("string")]], (N, 1))
        u[:, 0] = rng.normal(size=N)
        u[:, 1:] += 1e-3 * rng.normal(size=2) * np.linspace(0.0, 1.0, N)[:, None]
        run = system.rollout(x0, xbar, u, K, 0, N)
        assert run.complete, run.failure
        found.append((run.x, run.u))
    return found


@pytest.fixture
def busy() -> Iterator[None]:
    """Threads take turns as often as they can."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


def hessian(system: MidpointSystem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    z = np.random.default_rng(1).normal(size=(N + 1, system.nx))
    return system.linearize(x, u).curvature(z)


@pytest.mark.usefixtures("busy")
def test_eight_threads_on_one_system_get_the_hessians_of_one(
    motions: list[tuple[np.ndarray, np.ndarray]],
) -> None:
    system = system_of(1)
    alone = [hessian(system, x, u) for x, u in motions]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda motion: hessian(system, *motion), motions))
    wrong = [k for k, (a, b) in enumerate(zip(alone, together, strict=True)) if not (a == b).all()]
    assert not wrong


@pytest.mark.usefixtures("busy")
def test_eight_threads_on_one_system_find_the_optima_of_one(
    motions: list[tuple[np.ndarray, np.ndarray]],
) -> None:
    system = system_of(1)
    weights = np.full(system.nx, 0.1)

    def optimum(k: int) -> np.ndarray:
        x, u = motions[k]
        wanted = np.tile(x[0], (N + 1, 1)) + 0.05 * k / 24
        cost = QuadraticCost(wanted, u, Q=weights, R=np.ones(system.nu))
        return optimize(system, cost, initial=(x, u), max_iterations=8).x

    alone = [optimum(k) for k in range(24)]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(optimum, range(24)))
    assert all((a == b).all() for a, b in zip(alone, together, strict=True))


def test_what_was_asked_before_leaves_no_trace(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    """Workspaces are used again, by other calls and along other motions; nor does the number of threads matter."""
    x, u = motions[0]
    fresh = system_of(1)
    first = hessian(fresh, x, u)
    for other in motions[1:5]:
        hessian(fresh, *other)
        fresh.f(*(a[3] for a in other), 3)
    np.testing.assert_array_equal(hessian(fresh, x, u), first)
    np.testing.assert_array_equal(hessian(system_of(3), x, u), first)
    np.testing.assert_array_equal(
        system.curvatures(x, u, np.ones((N + 1, system.nx))),
        fresh.curvatures(x, u, np.ones((N + 1, system.nx))),
    )


def test_a_trajectory_changed_in_place_gives_fresh_derivatives(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    (x, u), (x1, u1) = (tuple(a.copy() for a in motion) for motion in motions[:2])
    z = np.random.default_rng(1).normal(size=(N + 1, system.nx))
    before, there = system.linearize(x, u), system.linearize(x1, u1)
    A, H = before.A.copy(), before.curvature(z)
    x[:], u[:] = x1, u1
    np.testing.assert_array_equal(before.A, A)
    np.testing.assert_array_equal(before.curvature(z), H)
    after = system.linearize(x, u)
    np.testing.assert_array_equal(after.A, there.A)
    np.testing.assert_array_equal(after.curvature(z), there.curvature(z))
    assert not np.array_equal(after.curvature(z), H)


def test_a_linearization_given_back_is_written_over(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    z = np.random.default_rng(1).normal(size=(N + 1, system.nx))
    reused = system.linearize(*motions[0])
    address = reused.A.ctypes.data
    for x, u in motions[1:4]:
        reused = system.linearize(x, u, out=reused)
        fresh = system.linearize(x, u)
        np.testing.assert_array_equal(reused.A, fresh.A)
        np.testing.assert_array_equal(reused.B, fresh.B)
        np.testing.assert_array_equal(reused.curvature(z), fresh.curvature(z))
    assert reused.A.ctypes.data == address


def test_hessians_are_written_over_once_nobody_holds_them(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    given = system.linearize(*motions[0])
    weights = np.random.default_rng(1).normal(size=(5, N, system.nx))
    held = [given.curvature(w) for w in weights]
    copies = [H.copy() for H in held]
    assert len({H.ctypes.data for H in held}) == len(held)
    for H, again in zip(held, copies, strict=True):
        np.testing.assert_array_equal(H, again)
        assert not H.flags.writeable
    addresses = {H.ctypes.data for H in held}
    H = None
    del held
    for w in weights:
        H = given.curvature(w)
        assert H.ctypes.data in addresses
    np.testing.assert_array_equal(H, copies[-1])


def test_the_integrator_takes_memory_back_too(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    vi = system.integrator
    runs = [system.trajectory(*motion) for motion in motions[:2]]
    d = vi.linearize(runs[0])
    assert vi.linearize(runs[1], out=d) is d
    np.testing.assert_array_equal(d.A, vi.linearize(runs[1]).A)
    z = np.ones((N, vi.mechanism.nx))
    np.testing.assert_array_equal(vi.curvature(runs[1], d, z), d.curvature(z))
    shorter = vi.linearize(vi.simulate(runs[0].state(0), DT * np.arange(4)))
    for stranger in (shorter, MidpointVI(vi.mechanism).linearize(runs[0])):
        with pytest.raises(ArgumentError, match=r"out: got derivatives of .* by this integrator"):
            vi.linearize(runs[0], out=stranger)


def test_a_foreign_linearization_is_refused(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    given = system.linearize(*motions[0])
    with pytest.raises(ArgumentError, match="out: got a linearization with the memory str"):
        system.linearize(*motions[0], out=dataclasses.replace(given, memory="none"))
    with pytest.raises(ArgumentError, match="z: got shape"):
        given.curvature(np.zeros((N - 1, system.nx)))


def test_arrays_are_views_that_keep_their_memory_and_cannot_be_written(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    d = system.integrator.linearize(system.trajectory(*motions[0]), multipliers=True)
    expected = d.A.copy()
    A = d.A
    del d
    gc.collect()
    np.testing.assert_array_equal(A, expected)
    assert not A.flags.writeable
    assert not A.base.flags.writeable


def test_derivatives_travel(system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]) -> None:
    d = system.integrator.linearize(system.trajectory(*motions[0]), multipliers=True)
    z = np.ones((N, d.mechanism.nx))
    linearization = system.linearize(*motions[0])
    for there in (lambda what: pickle.loads(pickle.dumps(what)), copy.deepcopy):
        for name in ("A_all", "B_all", "lam", "defect"):
            np.testing.assert_array_equal(getattr(there(d), name), getattr(d, name))
            assert not getattr(there(d), name).flags.writeable
        np.testing.assert_array_equal(there(d).curvature(z), d.curvature(z))
        weights = np.ones((N, system.nx))
        np.testing.assert_array_equal(there(linearization).curvature(weights), linearization.curvature(weights))


def test_after_a_step_that_does_not_exist_the_next_call_is_as_good_as_new(
    system: MidpointSystem, motions: list[tuple[np.ndarray, np.ndarray]]
) -> None:
    x, u = motions[0]
    first = hessian(system, x, u)
    broken = x.copy()
    broken[7] = 1e9
    d = system.linearize(x, u)
    with pytest.raises(StepError, match="has no solution near the given next state"):
        system.linearize(broken, u, out=d)
    np.testing.assert_array_equal(hessian(system, x, u), first)
    np.testing.assert_array_equal(system.linearize(x, u, out=d).A, system.linearize(x, u).A)
