"""Continuous time on random trees with strings, against automatic differentiation; batches, stabilisation, errors."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from derivatives.random_tree import Tree, random_tree
from leastaction.errors import ArgumentError, DynamicsError
from leastaction.mechanics import (
    Body,
    ContinuousDynamics,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    PointToPoint,
    PythonConstraint,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
    world,
)
from oracles import lagrangian as oracle

SEEDS = range(10)
VALUES, FIRST, SECOND = 1e-11, 1e-10, 1e-8


def residuals(d: oracle.Data, nd: int, law: jnp.ndarray, y: jnp.ndarray, th: jnp.ndarray) -> jnp.ndarray:
    """Return ``[r - Dh' lam; h'' + law . (h', h)]`` at y = [a dynamic; lam], th = [q; v; u; rho_a]."""
    nu = d["inputs"].shape[1]
    nc = len(y) - nd
    nq = (len(th) - nu + nd) // 3
    q, v, u, rho_a = jnp.split(th, [nq, 2 * nq, 2 * nq + nu])
    a, lam = jnp.concatenate([y[:nd], rho_a]), y[nd:]

    def path(s: jnp.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
        return q + s * v + s**2 / 2 * a, v + s * a

    def momentum(s: jnp.ndarray) -> jnp.ndarray:
        return jax.grad(partial(oracle.lagrangian, d), argnums=1)(*path(s))

    def h(s: jnp.ndarray) -> jnp.ndarray:
        return oracle.constraints(d, path(s)[0])

    r = jax.jacfwd(momentum)(0.0)[:nd] - jax.grad(partial(oracle.lagrangian, d))(q, v)[:nd]
    f = d["inputs"] @ u - d["damping"] * v[:nd]
    pull = jax.vjp(partial(oracle.constraints, d), q)[1](lam)[0][:nd]
    h_rate = jax.jacfwd(h)
    kept = jax.jacfwd(h_rate)(0.0) + law[0] * h_rate(0.0) + law[1] * h(0.0)
    return jnp.concatenate([r - f - pull, kept.reshape(nc)])


@partial(jax.jit, static_argnums=1)
def first_order(
    d: oracle.Data, nd: int, law: jnp.ndarray, y: jnp.ndarray, th: jnp.ndarray
) -> tuple[jnp.ndarray, jnp.ndarray, jnp.ndarray]:
    """Return the residuals and their Jacobians by y and th."""
    function = partial(residuals, d, nd, law)
    return function(y, th), *jax.jacfwd(function, argnums=(0, 1))(y, th)


@partial(jax.jit, static_argnums=1)
def bent(d: oracle.Data, nd: int, law: jnp.ndarray, z: jnp.ndarray, w: jnp.ndarray, ny: jnp.ndarray) -> jnp.ndarray:
    """Return the second derivative of the residuals at z = [y; th] along w."""
    y, th = z[: len(ny)], z[len(ny) :]

    def along(s: jnp.ndarray) -> jnp.ndarray:
        return residuals(d, nd, law, y + s * w[: len(ny)], th + s * w[len(ny) :])

    return jax.jacfwd(jax.jacfwd(along))(0.0)


@cache
def tree_of(seed: int) -> Tree:
    tree = random_tree(seed)
    return tree.without_constraints() if seed % 3 == 2 else tree


class Solved:
    """Our solution at a random point, off the constraints, and the oracle's residuals there."""

    def __init__(self, seed: int, law: tuple[float, float]) -> None:
        tree = tree_of(seed)
        m = tree.mechanism()
        rng = np.random.default_rng([seed, 4])
        self.nd, self.nq = m.nd, m.nq
        q = rng.uniform(-1.0, 1.0, m.nq)
        q[m.nd :] += 2.0  # lengths among them
        self.point = (
            q,
            rng.uniform(-1.0, 1.0, m.nq),
            rng.uniform(-1.0, 1.0, m.nu),
            rng.uniform(-1.0, 1.0, m.nrho),
        )
        self.dynamics = ContinuousDynamics(m, constraint_damping=law[0], constraint_stiffness=law[1], threads=1)
        self.out = self.dynamics.accelerations(*self.point)
        self.d, self.law = oracle.data_of(tree), jnp.array(law)
        self.y = np.concatenate([self.out.a, self.out.lam])
        self.th = np.concatenate(self.point)
        found = first_order(self.d, m.nd, self.law, self.y, self.th)
        self.value, self.by_y, self.by_th = (np.asarray(part) for part in found)

    def bent(self, w: np.ndarray) -> np.ndarray:
        """Return the second derivative of ``[a; lam]`` along a change w of th."""
        change = np.concatenate([-np.linalg.solve(self.by_y, self.by_th @ w), w])
        z = np.concatenate([self.y, self.th])
        second = bent(self.d, self.nd, self.law, z, change, self.y)
        return -np.linalg.solve(self.by_y, np.asarray(second))


LAWS = ((0.0, 0.0), (4.0, 3.0))


@cache
def solved(seed: int, law: tuple[float, float]) -> Solved:
    return Solved(seed, law)


every_tree = pytest.mark.parametrize("seed", SEEDS)
every_law = pytest.mark.parametrize("law", LAWS)


def error(ours: np.ndarray, theirs: np.ndarray) -> float:
    assert np.shape(ours) == np.shape(theirs)
    if not np.size(theirs):
        return 0.0
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


@every_law
@every_tree
def test_accelerations(seed: int, law: tuple[float, float]) -> None:
    s = solved(seed, law)
    scale = np.abs(s.by_y) @ np.abs(s.y) + np.abs(s.by_th) @ np.abs(s.th)
    assert np.all(np.abs(s.value) < VALUES * scale.max())
    assert np.abs(s.y).max() > 1e-2


@every_law
@every_tree
def test_first_derivatives(seed: int, law: tuple[float, float]) -> None:
    s = solved(seed, law)
    ours = s.dynamics.linearize(*s.point)
    theirs = -np.linalg.solve(s.by_y, s.by_th)
    assert error(ours.all[: s.nd], theirs[: s.nd]) < FIRST
    assert error(ours.all[s.nd :], theirs[s.nd :]) < FIRST


@every_law
@every_tree
def test_second_derivatives(seed: int, law: tuple[float, float]) -> None:
    s = solved(seed, law)
    full = s.dynamics.tensors(*s.point)
    ours = np.concatenate([full.a, full.lam])
    rng = np.random.default_rng([seed, 5])
    z = rng.standard_normal(len(s.y))
    H = s.dynamics.curvature(*s.point, z_a=z[: s.nd], z_lam=z[s.nd :])
    assert error(H, np.tensordot(z, ours, 1)) < 1e-12
    assert error(H, H.T) < 1e-12
    for w in rng.standard_normal((4, len(s.th))):
        theirs = s.bent(w)
        assert error(ours @ w @ w, theirs) < SECOND
        assert abs(w @ H @ w - z @ theirs) < SECOND * (np.abs(z) @ np.abs(theirs))


# Batches


def test_many_points_are_the_points_one_by_one() -> None:
    s = solved(0, LAWS[1])
    rng = np.random.default_rng(1)
    q, v, u, rho_a = (part + 0.1 * rng.standard_normal((7, len(part))) for part in s.point)
    z_a, z_lam = rng.standard_normal((7, s.nd)), rng.standard_normal((7, len(s.y) - s.nd))
    m = s.dynamics.mechanism
    all_threads = ContinuousDynamics(m, constraint_damping=4.0, constraint_stiffness=3.0)
    a = all_threads.accelerations(q, v, u, rho_a)
    d = all_threads.linearize(q, v, u, rho_a)
    H = all_threads.curvature(q, v, u, rho_a, z_a=z_a, z_lam=z_lam)
    motion = np.concatenate([a.a, rho_a], axis=1)
    needed = all_threads.inverse_dynamics(q, v, motion, a.lam, u=u)
    for k in range(7):
        point = (q[k], v[k], u[k], rho_a[k])
        one = s.dynamics.accelerations(*point)
        assert np.array_equal(a.a[k], one.a)
        assert np.array_equal(a.lam[k], one.lam)
        assert np.array_equal(d.all[k], s.dynamics.linearize(*point).all)
        again = s.dynamics.curvature(*point, z_a=z_a[k], z_lam=z_lam[k])
        assert np.array_equal(H[k], again)
        forces = s.dynamics.inverse_dynamics(q[k], v[k], motion[k], a.lam[k], u=u[k])
        assert np.array_equal(needed[k], forces)
    # What is given once is the same for all.
    spread = all_threads.accelerations(q, v[0], u[0])
    assert np.array_equal(spread.a[3], s.dynamics.accelerations(q[3], v[0], u[0]).a)
    # No points have no accelerations.
    assert all_threads.accelerations(q[:0], v[:0]).a.shape == (0, s.nd)


def pendulum(**options: object) -> Mechanism:
    tree = [rx("shoulder"), [tz(-1.0, name="elbow", mass=1.0), [rx("bend"), [tz(-1.0, mass=0.5)]]]]
    return Mechanism(
        tree,
        [Gravity((0, 0, -9.81)), Damping(0.1), JointForce("bend", input="torque")],
        **options,
    )


# Deep trees, which are solved another way


def chain(links: int, *, kinematic: int = -1) -> Mechanism:
    at = world()
    for k in range(links):
        at = at.rx(f"q{k}", kinematic=k == kinematic).tz(-0.2, mass=0.3, name=f"link {k}")
        at = at.ry(f"side {k}", name=f"side {k}", bodies=[Body(0.1, inertia=(1e-3, 2e-3, 2e-3))])
    held = Distance("world", f"link {links - 1}", length=0.15 * links)
    return Mechanism(at.root, [Gravity((0, 1.0, -9.81)), Damping(0.1), held])


@pytest.mark.parametrize("links", [8, 14, 40])
def test_deep_chain_solves_its_equations(links: int) -> None:
    m = chain(links, kinematic=links // 2)
    dynamics = ContinuousDynamics(m, threads=1)
    rng = np.random.default_rng(links)
    q, v = 0.5 * rng.standard_normal((2, m.nq))
    rho_a = [0.7]
    out = dynamics.accelerations(q, v, rho_a=rho_a)
    M, Dh = m.mass_matrix(q), m.constraint_jacobian(q)
    a = np.concatenate([np.zeros(m.nd), rho_a])
    bend = v @ m.core.constraint_hessian(q, np.ones(1)) @ v
    nd = m.nd
    K = np.block([[M[:nd, :nd], -Dh[:, :nd].T], [Dh[:, :nd], np.zeros((1, 1))]])
    rest = np.concatenate([-dynamics.inverse_dynamics(q, v, a)[:nd], -(bend + Dh @ a)])
    expected = np.linalg.solve(K, rest)
    assert error(out.a, expected[:nd]) < 1e-9
    assert error(out.lam, expected[nd:]) < 1e-9
    d = dynamics.linearize(q, v, rho_a=rho_a)
    assert error(d.a, out.a) < 1e-9
    by_rho_a = -np.linalg.solve(K, np.vstack([M[:nd, nd:], Dh[:, nd:]]))
    assert error(np.concatenate([d.a_drho_a, d.lam_drho_a]), by_rho_a) < 1e-9
    # By differences of the fourth order along one direction.
    dq, dv = rng.standard_normal((2, m.nq))
    h = 1e-4

    def at(s: float) -> np.ndarray:
        found = dynamics.accelerations(q + s * dq, v + s * dv, rho_a=rho_a)
        return np.concatenate([found.a[:nd], found.lam])

    slope = (8.0 * (at(h) - at(-h)) - at(2 * h) + at(-2 * h)) / (12.0 * h)
    along = np.concatenate([d.a_dq @ dq + d.a_dv @ dv, d.lam_dq @ dq + d.lam_dv @ dv])
    assert error(along, slope) < 1e-6


# Closed forms and physics


def test_pendulum_by_hand() -> None:
    m = Mechanism([rx("theta"), [tz(-2.0, mass=3.0)]], [Gravity((0, 0, -10.0)), Damping(0.6)])
    theta, speed = 0.3, 1.5
    out = ContinuousDynamics(m).accelerations([theta], [speed])
    inertia = 3.0 * 2.0**2
    assert out.a[0] == pytest.approx(-10.0 / 2.0 * np.sin(theta) - 0.6 * speed / inertia, 1e-14)
    d = ContinuousDynamics(m).linearize([theta], [speed])
    assert d.a_dq[0, 0] == pytest.approx(-5.0 * np.cos(theta), 1e-14)
    assert d.a_dv[0, 0] == pytest.approx(-0.6 / inertia, 1e-14)
    H = ContinuousDynamics(m).curvature([theta], [speed], z_a=[2.0])
    assert pytest.approx(np.array([[10.0 * np.sin(theta), 0.0], [0.0, 0.0]]), abs=1e-13) == H


def test_tension_of_a_hanging_mass() -> None:
    tree = [ty("y", name="y"), [tz("z", name="bob", mass=2.0)]]
    m = Mechanism(tree, [Gravity((0, 0, -9.81)), Distance("world", "bob", length=1.5)])
    out = ContinuousDynamics(m).accelerations([0.0, -1.5], [0.0, 0.0])
    # h = |p|^2 - L^2, so that the string's force is 2 L lam along it, upwards where lam < 0 at z < 0.
    assert out.lam[0] * 2.0 * -1.5 == pytest.approx(2.0 * 9.81, 1e-14)
    assert out.a == pytest.approx(np.zeros(2), abs=1e-13)


def test_redundant_constraints_move_alike_and_say_so() -> None:
    tree = [ty("y", name="y"), [tz("z", name="bob", mass=2.0)]]
    rod = Distance("world", "bob", length=1.0, name="rod")
    again = Distance("world", "bob", length=1.0, name="again")
    gravity = Gravity((0, 0, -9.81))
    q, v = [0.6, -0.8], [0.8, 0.6]
    one = ContinuousDynamics(Mechanism(tree, [gravity, rod]))
    two = ContinuousDynamics(Mechanism(tree, [gravity, rod, again]))
    single, doubled = one.accelerations(q, v), two.accelerations(q, v)
    assert not single.rank_deficient
    assert doubled.rank_deficient
    assert doubled.a == pytest.approx(single.a, 1e-12)
    assert doubled.lam == pytest.approx(np.full(2, single.lam[0] / 2), 1e-10)
    assert two.linearize(q, v).a_dq == pytest.approx(one.linearize(q, v).a_dq, abs=1e-10)
    H1, H2 = (dynamics.curvature(q, v, z_a=[1.0, 2.0]) for dynamics in (one, two))
    assert pytest.approx(H1, abs=1e-9 * np.abs(H1).max()) == H2


def test_kinematic_variables_are_driven() -> None:
    """A cart on a prescribed slide: inverse dynamics gives the force of the drive."""
    tree = [tx("slide", kinematic=True, name="cart", mass=4.0), [ry("swing"), [tz(-1.0, mass=1.0)]]]
    m = Mechanism(tree, [Gravity((0, 0, -10.0))])
    dynamics = ContinuousDynamics(m)
    out = dynamics.accelerations([0.0, 0.0], [0.0, 0.0], rho_a=[2.0])
    # rotation about y by theta takes -z to -x
    assert out.a[0] == pytest.approx(2.0, 1e-14)
    needed = dynamics.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [out.a[0], 2.0])
    assert needed == pytest.approx([0.0, 4.0 * 2.0], abs=1e-13)
    assert dynamics.linearize([0.0, 0.0], [0.0, 0.0]).a_drho_a == pytest.approx(np.eye(1))


# Bad input


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda c: c.accelerations([0.1], [0.0, 0.0]),
            r"q: got shape .*, expected \(2,\).*shoulder, bend",
        ),
        (lambda c: c.accelerations([0.1, 0.2], [0.0]), "v: got shape"),
        (lambda c: c.accelerations([0.1, np.nan], [0.0, 0.0]), "q: got nan .*'bend'"),
        (lambda c: c.accelerations([0.1, 0.2], [0.0, 0.0], [1.0, 2.0]), "u: got shape"),
        (lambda c: c.accelerations([0.1, 0.2], [0.0, 0.0], None, [1.0]), "rho_a: got shape"),
        (
            lambda c: c.accelerations(np.zeros((3, 2)), np.zeros((4, 2))),
            r"v: got shape .*, expected \(3, 2\)",
        ),
        (lambda c: c.accelerations([0.1, 0.2], [0.0, 0.0], t=np.zeros(3)), "t: got shape"),
        (lambda c: c.inverse_dynamics([0.1, 0.2], [0.0, 0.0], [1.0]), "a: got shape"),
        (
            lambda c: c.inverse_dynamics([0.1, 0.2], [0.0, 0.0], [1.0, 1.0], [1.0]),
            r"lam: got shape \(1,\), expected \(0,\)",
        ),
        (lambda c: c.curvature([0.1, 0.2], [0.0, 0.0], z_a=[1.0]), "z_a: got shape"),
        (lambda c: c.curvature([0.1, 0.2], [0.0, 0.0], z_lam=[1.0]), "z_lam: got shape"),
        (lambda c: c.tensors(np.zeros((2, 2)), np.zeros((2, 2))), "got 2 points, expected one"),
        (
            lambda c: ContinuousDynamics(c.mechanism, constraint_damping=-1.0),
            "constraint_damping: got -1.0, expected a number >= 0",
        ),
        (lambda c: ContinuousDynamics(c.mechanism, threads=-1), "threads"),
    ],
)
def test_bad_arguments(call: object, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        call(ContinuousDynamics(pendulum()))


def test_values_that_overflow() -> None:
    with pytest.raises(DynamicsError, match=r"at t = 2.5 s.*not finite") as caught:
        ContinuousDynamics(pendulum()).accelerations([0.1, 0.2], [1e200, 0.0], t=2.5)
    assert (caught.value.t, caught.value.point, caught.value.variable) == (2.5, 0, None)


def test_singular_mass_matrix_names_the_variable() -> None:
    """Two joints about the same axis in a row, as a ball joint's are at its singularity."""
    tree = [rz("yaw"), [ry("pitch"), [rx("roll", bodies=[Body(1.0, inertia=(1.0, 2.0, 3.0))])]]]
    dynamics = ContinuousDynamics(Mechanism(tree))
    good, bad = [0.3, 0.4, 0.5], [0.3, np.pi / 2, 0.5]
    q = np.array([good, bad, good])
    with pytest.raises(DynamicsError, match=r"point 1: the mass matrix.*'yaw'") as caught:
        dynamics.linearize(q, np.zeros((3, 3)), t=[0.0, 0.5, 1.0])
    assert (caught.value.t, caught.value.point, caught.value.variable) == (0.5, 1, "yaw")
    # The work space is as good as new after it.
    assert np.all(np.isfinite(dynamics.accelerations(good, [0.0, 0.0, 0.0]).a))


class Square:
    """z_0^2 + z_1^2 - 1 and its derivatives."""

    def value(self, z: np.ndarray) -> np.generic:
        return z @ z - 1.0

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return 2.0 * z

    def hessian(self, z: np.ndarray) -> np.ndarray:
        return 2.0 * np.eye(len(z))


def test_function_in_python_has_first_derivatives_only() -> None:
    tree = [ty("y", name="y"), [tz("z", name="bob", mass=2.0)]]
    gravity = Gravity((0, 0, -9.81))
    written = PythonConstraint(Square(), variables=["y", "z"], name="circle")
    ours = ContinuousDynamics(Mechanism(tree, [gravity, written]))
    rod = ContinuousDynamics(Mechanism(tree, [gravity, Distance("world", "bob", length=1.0)]))
    q, v = [0.6, -0.8], [0.8, 0.6]
    assert ours.linearize(q, v).all == pytest.approx(rod.linearize(q, v).all, abs=1e-12)
    with pytest.raises(ArgumentError, match=r"circle: .*fourth order.*ExpressionConstraint"):
        ours.curvature(q, v, z_a=[1.0, 1.0])
    with pytest.raises(ArgumentError, match="circle"):
        ours.tensors(q, v)
    with pytest.raises(ValueError, match="fourth order"):  # the core says it too
        ours.core.tensors(*(np.array([x]) for x in (q, v)), np.zeros((1, 0)), np.zeros((1, 0)))


def test_one_point_may_hold_constraints_between_two_bodies() -> None:
    """A closed loop: two arms joined at their ends move as the loop lets them."""
    left = world()
    left.rx("left").tz(-1.0, name="left end", mass=1.0)
    left.ty(1.0).rx("right").tz(-1.0, name="right end", mass=1.0)
    joined = PointToPoint("left end", "right end", axes="z")
    dynamics = ContinuousDynamics(Mechanism(left, [Gravity((0, 0, -9.81)), joined]))
    q, v = [0.3, -0.3], [1.0, -1.0]
    out = dynamics.accelerations(q, v)
    core = dynamics.mechanism.core
    eps = 1e-4
    heights = [core.constraints(np.array(q) + s * np.array(v) + s**2 / 2 * out.a)[0] for s in (-eps, 0, eps)]
    assert abs(heights[0] - 2 * heights[1] + heights[2]) / eps**2 < 1e-6
    assert out.a[0] == pytest.approx(-out.a[1], 1e-12)
