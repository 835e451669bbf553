"""Functions of any order where rotations are quaternions: against JAX on SO(3), and polynomials through values."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
import pytest

from derivatives.test_prescribed_rotations import CASES, carried
from derivatives.test_quaternions import AT_JOINTS, FORCES, PIN, ROD, WRENCH, tumbling, turned
from leastaction.mechanics import FunctionDerivatives, Mechanism, MidpointVI
from leastaction.mechanics.mechanism.turns import moved_by
from leastaction.numerics.arrays import Array

RELATIVE = 1e-11
DT = 0.3


def along(of: FunctionDerivatives, directions: list[dict[str, Array]]) -> Any:
    """Return a derivative along one direction, two or more of them."""
    flat = [np.concatenate([np.ravel(d[name]) for name in of.arguments]) for d in directions]
    for each in directions[2:]:
        of = of.along(**each)
    return of.gradient @ flat[0] if len(flat) == 1 else of.hessian @ flat[0] @ flat[1]


# The same mechanism written anew


class Tops:
    """`tumbling` in JAX: its functions of turns, which move it from where it is, and of angular velocities."""

    def __init__(self, q: Array) -> None:
        self.jnp = pytest.importorskip("jax").numpy
        self.q = q
        self.base, self.hip = self.rotation(q[3:7]), self.rotation(q[8:12])

    def hat(self, a: Any) -> Any:
        return self.jnp.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])

    def rotation(self, p: Any) -> Any:
        v = self.jnp.array(p[1:])
        return (p[0] ** 2 - v @ v) * self.jnp.eye(3) + 2.0 * self.jnp.outer(v, v) + 2.0 * p[0] * self.hat(v)

    def near_zero(self, a: Any) -> Any:
        """exp, with derivatives at zero to the fourth order."""
        A = self.hat(a)
        return self.jnp.eye(3) + A + A @ A / 2.0 + A @ A @ A / 6.0 + A @ A @ A @ A / 24.0

    def exponential(self, a: Any) -> Any:
        """Not at zero."""
        jnp, A, square = self.jnp, self.hat(a), a @ a
        angle = jnp.sqrt(square)
        return jnp.eye(3) + jnp.sin(angle) / angle * A + (1.0 - jnp.cos(angle)) / square * A @ A

    def logarithm(self, R: Any) -> Any:
        """Not of the identity."""
        jnp = self.jnp
        w = jnp.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
        sine = jnp.sqrt(w @ w)
        return jnp.arctan2(sine, (jnp.trace(R) - 1.0) / 2.0) / sine * w

    def place(self, dq: Any, more: Any) -> dict[str, tuple[Any, Any]]:
        """Return rotations and origins of frames at q moved by dq, then by a little more."""
        jnp, q, d = self.jnp, self.q, dq + more
        R = self.base @ self.near_zero(dq[3:6]) @ self.near_zero(more[3:6])
        p = jnp.array(q[:3]) + d[:3]
        c, s = jnp.cos(q[7] + d[6]), jnp.sin(q[7] + d[6])
        leg = R @ jnp.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        at_leg = p + R @ jnp.array([0.3, 0.0, 0.0])
        foot = leg @ self.hip @ self.near_zero(dq[7:10]) @ self.near_zero(more[7:10])
        at_foot = at_leg + leg @ jnp.array([0.3, 0.0, 0.0])
        return {
            "base": (R, p),
            "leg": (leg, at_leg),
            "foot": (foot, at_foot),
            "toe": (foot, at_foot + foot @ jnp.array([0.2, 0.0, 0.0])),
            "left": (R, p + R @ jnp.array([0.0, -0.4, 0.0])),
            "hand": (jnp.eye(3), jnp.array([0.0, 0.0, q[12]]) + jnp.array([0.0, 0.0, 1.0]) * d[10]),
        }

    def moving(self, dq: Any, v: Any) -> tuple[Any, Any]:
        """Return `place` and what it changes by along a velocity."""
        import jax

        return jax.jvp(lambda more: self.place(dq, more), (self.jnp.zeros(11),), (v,))

    def length(self, at: Any, one: str, other: str) -> Any:
        apart = at[one][1] - at[other][1]
        return self.jnp.sqrt(apart @ apart)

    def potential(self, dq: Any) -> Any:
        at = self.place(dq, self.jnp.zeros(11))
        weight = sum(mass * (at[name][1] + at[name][0] @ com)[2] for name, mass, com, _ in BODIES)
        return 9.81 * weight + 20.0 * (self.length(at, "toe", "left") - 0.3) ** 2

    def lagrangian(self, dq: Any, v: Any) -> Any:
        at, rates = self.moving(dq, v)
        twice = 0.0
        for name, mass, com, inertia in BODIES:
            (R, _), (R_dot, p_dot) = at[name], rates[name]
            velocity, W = p_dot + R_dot @ com, R.T @ R_dot
            w = self.jnp.array([W[2, 1], W[0, 2], W[1, 0]])
            twice = twice + mass * velocity @ velocity + w @ inertia @ w
        return 0.5 * twice - self.potential(dq)

    def constraint(self, dq: Any) -> Any:
        return self.length(self.place(dq, self.jnp.zeros(11)), "toe", "hand") ** 2 - 0.9**2

    def power(self, dq: Any, v: Any, u: Any, mu: Any) -> Any:
        """Return the forces times a virtual velocity."""
        jnp, (at, rates), (_, along) = self.jnp, self.moving(dq, v), self.moving(dq, mu)
        apart = at["toe"][1] - at["hand"][1]
        n = apart / jnp.sqrt(apart @ apart)
        stretch, virtual = (n @ (each["toe"][1] - each["hand"][1]) for each in (rates, along))
        (R, _), (R_dot, p_dot) = at["foot"], along["foot"]
        W = R.T @ R_dot
        w = jnp.array([W[2, 1], W[0, 2], W[1, 0]])
        force, torque = jnp.array([0.1, u[0], 0.0]), jnp.array([u[1], 0.3, u[2]])
        return -0.7 * stretch * virtual + force @ R.T @ p_dot + torque @ w


BODIES = (
    (
        "base",
        2.0,
        np.array([0.05, 0.02, -0.03]),
        np.array([[0.1, 0.01, 0.02], [0.01, 0.2, -0.01], [0.02, -0.01, 0.15]]),
    ),
    ("leg", 0.5, np.array([0.1, 0.0, 0.02]), np.diag([0.02, 0.01, 0.03])),
    ("foot", 0.4, np.array([0.1, 0.03, 0.05]), np.diag([0.02, 0.01, 0.015])),
)


def derivative(function: Callable[..., Any], at: list[Array], directions: list[list[Array]]) -> Any:
    """Return the derivative of a function in JAX along directions, by forward mode within forward mode."""
    import jax

    def once(f: Callable[..., Any], d: list[Array]) -> Callable[..., Any]:
        return lambda *x: jax.jvp(f, x, tuple(map(jax.numpy.asarray, d)))[1]

    return np.asarray(reduce(once, directions, function)(*map(jax.numpy.asarray, at)))


@pytest.mark.slow
def test_they_are_those_of_jax() -> None:
    jax = pytest.importorskip("jax")
    m, rng = tumbling(*FORCES, WRENCH, ROD), np.random.default_rng(1)
    q = turned(m, rng)
    q[:3], q[7], q[12] = rng.standard_normal(3), 0.4, 0.2
    v, u, mu = rng.standard_normal(m.nv), rng.standard_normal(m.n_inputs), rng.standard_normal(m.nv)
    still = np.zeros(m.nv)
    directions = [dict(zip("qvu", (rng.standard_normal(n) for n in (11, 11, 3)), strict=True)) for _ in range(4)]
    functions = {"q": m.potential(q), "qv": m.lagrangian(q, v), "h": m.constraint(q, "rod"), "qvu": m.force(q, v, u)}
    with jax.enable_x64(True):
        tops = Tops(q)
        places = {
            "q": (tops.potential, [still]),
            "qv": (tops.lagrangian, [still, v]),
            "h": (tops.constraint, [still]),
            "qvu": (lambda dq, v, u: tops.power(dq, v, u, jax.numpy.asarray(mu)), [still, v, u]),
        }
        for key, of in functions.items():
            names = "q" if key == "h" else key
            function, at = places[key]
            one = of.weighed(mu) if key == "qvu" else of
            assert abs(np.ravel(one.value)[0] - function(*at)) < RELATIVE * abs(function(*at)), key
            for order in range(1, 4 if len(key) > 1 else 5):  # of more arguments the fourth takes minutes
                some = [{name: d[name] for name in names} for d in directions[:order]]
                wanted = derivative(function, at, [[d[name] for name in names] for d in some])
                assert abs(np.ravel(along(one, some))[0] - wanted) < RELATIVE * max(1.0, abs(wanted)), (key, order)


@pytest.mark.slow
def test_those_of_a_step_are_those_of_jax() -> None:
    jax = pytest.importorskip("jax")
    m, rng = tumbling(*FORCES, WRENCH), np.random.default_rng(2)
    vi, q1 = MidpointVI(m), turned(m, rng)
    apart = 0.4 * rng.standard_normal(m.nv)
    q2 = moved_by(m, q1, apart)
    directions = [{"q1": rng.standard_normal(m.nv), "q2": rng.standard_normal(m.nv)} for _ in range(4)]
    with jax.enable_x64(True):
        jnp, tops = jax.numpy, Tops(moved_by(m, q1, apart / 2.0))

        def Ld(start: Any, end: Any) -> Any:
            d, v = (start + end) / 2.0, (jnp.asarray(apart) + end - start) / DT
            for here in (slice(3, 6), slice(7, 10)):
                half = tops.exponential(jnp.asarray(apart[here]) / 2.0)  # from the start to the middle
                alpha, beta = tops.near_zero(start[here]), tops.near_zero(end[here])
                phi = tops.logarithm(alpha.T @ half @ half @ beta)
                xi = half.T @ alpha @ tops.exponential(phi / 2.0)
                d = d.at[here].set(near_logarithm(xi))
                v = v.at[here].set(phi / DT)
            return DT * tops.lagrangian(d, v)

        def near_logarithm(R: Any) -> Any:
            """To the fourth order where R is near to the identity."""
            E = R - jnp.eye(3)
            L = E - E @ E / 2.0 + E @ E @ E / 3.0 - E @ E @ E @ E / 4.0
            return jnp.array([L[2, 1] - L[1, 2], L[0, 2] - L[2, 0], L[1, 0] - L[0, 1]]) / 2.0

        found = vi.discrete_lagrangian(q1, q2, DT)
        still = np.zeros(m.nv)
        assert found.value == pytest.approx(float(Ld(jnp.asarray(still), jnp.asarray(still))), rel=1e-12)
        for order in range(1, 4):
            some = directions[:order]
            wanted = derivative(Ld, [still, still], [[d["q1"], d["q2"]] for d in some])
            assert abs(along(found, some) - wanted) < RELATIVE * max(1.0, abs(wanted)), order


# All elements, by values alone


def orders(function: Callable[[float], Any], highest: int) -> list[Array]:
    """Return derivatives at zero of a function of one number, by a polynomial through its values around."""
    n, radius = 16, 0.25
    s = np.cos((2.0 * np.arange(n) + 1.0) * np.pi / (2.0 * n))
    values = np.array([np.ravel(function(radius * x)) for x in s])
    fit = np.polynomial.chebyshev.chebfit(s, values, n - 1)
    found = []
    for order in range(1, highest + 1):
        fit = np.polynomial.chebyshev.chebder(fit)
        found.append(np.polynomial.chebyshev.chebval(0.0, fit) / radius**order)
    return found


def check(of: FunctionDerivatives, function: Callable[[float], Any], direction: dict[str, Array]) -> None:
    for order, wanted in enumerate(orders(function, of.highest_order), 1):
        scale = max(1.0, float(np.abs(wanted).max()))
        # Rounding of the values, over the radius to the power of the order.
        assert np.abs(along(of, [direction] * order) - wanted).max() < 1e-13 * 40.0**order * scale, (of.name, order)


def one_of_two(which: int, rng: np.random.Generator) -> tuple[Mechanism, Array]:
    """Return a mechanism and a configuration, in which no string is short."""
    m = carried(*CASES["all"]) if which else tumbling(ROD, PIN, *FORCES, WRENCH, *AT_JOINTS)
    q = turned(m, rng)
    q[m.coordinates.index("beside.x" if which else "base.x")] = 1.0
    return m, q


@pytest.mark.parametrize("which", [0, 1], ids=["floating", "carried"])
def test_all_elements(which: int) -> None:
    rng = np.random.default_rng(5)
    m, q = one_of_two(which, rng)
    v, e, d = rng.standard_normal((3, m.nv))
    u, du = rng.standard_normal((2, m.n_inputs))
    e /= np.linalg.norm(e)
    d /= np.linalg.norm(d)
    check(m.potential(q), lambda s: m.potential(moved_by(m, q, s * e)).value, {"q": e})
    check(m.constraint(q), lambda s: m.constraint(moved_by(m, q, s * e)).value, {"q": e})
    check(m.lagrangian(q, v), lambda s: m.lagrangian(moved_by(m, q, s * e), v + s * d).value, {"q": e, "v": d})
    check(
        m.force(q, v, u),
        lambda s: m.force(moved_by(m, q, s * e), v + s * d, u + s * du).value,
        {"q": e, "v": d, "u": du},
    )


@pytest.mark.parametrize("which", [0, 1], ids=["floating", "carried"])
def test_functions_of_a_step(which: int) -> None:
    rng = np.random.default_rng(7)
    m, q1 = one_of_two(which, rng)
    vi = MidpointVI(m)
    q2, (e, d) = moved_by(m, q1, 0.2 * rng.standard_normal(m.nv)), rng.standard_normal((2, m.nv)) / np.sqrt(m.nv)
    u, du = rng.standard_normal((2, m.n_inputs))
    along_ends = {"q1": e, "q2": d}

    def ends(s: float) -> tuple[Array, Array]:
        return moved_by(m, q1, s * e), moved_by(m, q2, s * d)

    check(vi.discrete_potential(q1, q2, DT), lambda s: vi.discrete_potential(*ends(s), DT).value, along_ends)
    Ld, fd = vi.discrete_lagrangian(q1, q2, DT), vi.discrete_force(q1, q2, u, DT)
    check(Ld, lambda s: vi.discrete_lagrangian(*ends(s), DT).value, along_ends)
    for side in (0, 1):
        check(
            fd[side],
            lambda s, side=side: vi.discrete_force(*ends(s), u + s * du, DT)[side].value,
            {**along_ends, "u": du},
        )
    # They are what a step solves.
    start, end = vi.core.momenta(q1, q2, u, DT, DT, 0.0)
    np.testing.assert_allclose(Ld.by("q1") + fd[0].value, -start, atol=1e-13 * np.abs(start).max())
    np.testing.assert_allclose(Ld.by("q2") + fd[1].value, end, atol=1e-13 * np.abs(end).max())


def test_frames() -> None:
    m, rng = tumbling(), np.random.default_rng(3)
    q, (v, e) = turned(m, rng), rng.standard_normal((2, m.nv))
    e /= np.linalg.norm(e)
    options: dict[str, Any] = {"point": [0.1, 0.2, -0.3]}

    def near(found: Array, wanted: Array, order: int) -> None:
        assert np.abs(found.ravel() - wanted).max() < 1e-13 * 40.0**order * max(1.0, np.abs(wanted).max())

    for inverse in (False, True):
        poses = orders(lambda s, inverse=inverse: m.frame_pose(moved_by(m, q, s * e), "toe", inverse=inverse), 5)
        for order, wanted in enumerate(poses, 1):
            near(m.frame_pose_derivative(q, "toe", order=order, along=[e] * order, inverse=inverse), wanted, order)
        whole = m.frame_pose_derivative(q, "toe", order=2, inverse=inverse)
        np.testing.assert_array_equal(whole, whole.swapaxes(-1, -2))
        near(whole @ e @ e, poses[1], 2)
    for axes in ("world", "frame"):
        options["axes"] = axes
        for order, wanted in enumerate(
            orders(lambda s: m.frame_jacobian(moved_by(m, q, s * e), "toe", **options), 4), 1
        ):
            given = {**options, "order": order, "along": [e] * order}
            near(m.frame_jacobian_derivative(q, "toe", **given), wanted, order)
            near(m.frame_velocity_derivative(q, v, "toe", **given), wanted.reshape(6, -1) @ v, order)
        first = m.frame_jacobian_derivative(q, "toe", **options)
        by_rule = m.frame_jacobian_derivative(q, "toe", along=[e], **options)
        np.testing.assert_allclose(first @ e, by_rule, atol=1e-14)


def test_tensors_and_copies() -> None:
    m, rng = tumbling(*FORCES), np.random.default_rng(4)
    q, v = turned(m, rng), rng.standard_normal(m.nv)
    dq, dv = rng.standard_normal((2, m.nv))
    for of in (m.lagrangian(q, v), MidpointVI(m).discrete_lagrangian(q, moved_by(m, q, 0.1 * dq), DT)):
        first, second = of.arguments
        third = of.tensor(3)
        np.testing.assert_allclose(third @ np.r_[dq, dv], of.along(**{first: dq, second: dv}).hessian, atol=1e-11)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(of)).hessian, of.hessian)
