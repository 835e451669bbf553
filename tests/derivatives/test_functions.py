"""The functions of a mechanism, whole and element by element, to the fourth order: against automatic differentiation,
against mechanisms that hold one element alone, and against differences of the order below."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from derivatives.elements.cases import Case, problem
from derivatives.elements.checks import FIRST, SECOND, THIRD, assert_near, every, oracle_of, points
from derivatives.random_tree import random_tree
from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Constraint,
    Damping,
    Distance,
    Force,
    FunctionDerivatives,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    Potential,
    PythonPotential,
    rz,
    tx,
    ty,
)
from oracles import lagrangian as oracle_lagrangian

STEP = 1e-4
DIFFERENCE = 1e-6  # relative to the largest entry, of a central difference


def sum_of(functions: list[FunctionDerivatives], of: str) -> np.ndarray:
    return sum((np.asarray(getattr(f, of)) for f in functions), start=np.zeros(()))


def check_against_the_order_below(at, q: np.ndarray, dq: np.ndarray, lower, flat: bool = False) -> None:
    """The derivative of a Hessian along dq, held to differences of that Hessian."""
    # Of second order and extrapolated: the fifth derivatives of a stiff law may be a million times the third ones.
    wide, narrow = ((lower(q + h * dq) - lower(q - h * dq)) / (2.0 * h) for h in (STEP, 0.5 * STEP))
    wanted = (4.0 * narrow - wide) / 3.0
    scale = np.abs(lower(q)).max(initial=0.0)
    assert np.abs(at - wanted).max(initial=0.0) <= DIFFERENCE * max(np.abs(wanted).max(initial=0.0), scale, 1.0)


@every("potential")
def test_potentials(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    for q, _, _, _, dq in points(case, seed):
        V, V_q, V_qq, V_qqq = oracle.potential_orders(q)
        whole = m.potential(q)
        each = [m.potential(q, name) for name, e in m.elements.items() if isinstance(e, Potential)]
        for value, gradient, hessian, of in (
            (whole.value, whole.gradient, whole.hessian, whole.along(q=dq).hessian),
            (*(sum_of(each, of) for of in ("value", "gradient", "hessian")), sum(e.along(q=dq).hessian for e in each)),
        ):
            assert_near(np.asarray(value), V, FIRST, flat=0 in case.flat)
            assert_near(gradient, V_q, FIRST)
            assert_near(hessian, V_qq, SECOND, flat=2 in case.flat)
            assert_near(of, V_qqq @ dq, THIRD, flat=3 in case.flat)
        # L is T - V, whatever the velocity.
        assert m.lagrangian(q, np.zeros(m.nq)).value == pytest.approx(-float(V), rel=1e-12)


@every("potential")
def test_the_fourth_order_of_potentials(case: Case, seed: int) -> None:
    m = problem(case.name, seed).mechanism
    q, v, _, _, dq = points(case, seed)[0]
    for name, element in m.elements.items():
        third = m.potential(q, name).along(q=v)
        if isinstance(element, PythonPotential):
            with pytest.raises(ArgumentError, match=re.escape(f"V of {name!r}") + ".*order 4.*up to order 3"):
                third.along(q=dq)
            continue
        fourth = third.along(q=dq)
        check_against_the_order_below(
            fourth.hessian, q, dq, lambda at, name=name: m.potential(at, name).along(q=v).hessian
        )
        assert fourth.value == pytest.approx(v @ m.potential(q, name).hessian @ dq, rel=1e-9, abs=1e-12)


@every("constraint")
def test_constraints(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    for q, _, _, lam, dq in points(case, seed):
        h, h_q, h_qq, h_qqq = oracle.constraint_orders(q)
        each = [m.constraint(q, name) for name, e in m.elements.items() if isinstance(e, Constraint)]
        whole = m.constraint(q)
        assert whole.rows == m.constraints == tuple(row for e in each for row in e.rows)
        np.testing.assert_allclose(whole.value, h, atol=1e-12)
        np.testing.assert_array_equal(np.concatenate([e.value for e in each]), whole.value)
        for found in (whole.gradient, np.concatenate([e.gradient for e in each])):
            assert_near(found, h_q, FIRST)
        for found in (whole.hessian, np.concatenate([e.hessian for e in each])):
            assert_near(found, h_qq, SECOND, flat=2 in case.flat)
        assert_near(whole.along(q=dq).hessian, h_qqq @ dq, THIRD, flat=3 in case.flat)
        weighed = whole.weighed(lam)
        assert_near(weighed.gradient, lam @ h_q, FIRST)
        assert_near(weighed.along(q=dq).hessian, np.tensordot(lam, h_qqq, 1) @ dq, THIRD, flat=3 in case.flat)


@every("constraint")
def test_the_fourth_order_of_constraints(case: Case, seed: int) -> None:
    m = problem(case.name, seed).mechanism
    q, v, _, _, dq = points(case, seed)[0]
    third = m.constraint(q).along(q=v)
    if third.highest_order < 4:
        with pytest.raises(ArgumentError, match=r"h: .*order 4.*up to order 3"):
            third.along(q=dq)
        return
    check_against_the_order_below(third.along(q=dq).hessian, q, dq, lambda at: m.constraint(at).along(q=v).hessian)


@every("force")
def test_forces(case: Case, seed: int) -> None:
    m, oracle = problem(case.name, seed).mechanism, oracle_of(case.name, seed)
    for q, v, u, *_ in points(case, seed):
        f, f_z, f_zz = oracle.force_orders(np.concatenate([q, v, u]))
        each = [m.force(q, v, u, name) for name, e in m.elements.items() if isinstance(e, Force)]
        whole = m.force(q, v, u)
        for of, wanted, tolerance in (("value", f, FIRST), ("gradient", f_z, FIRST), ("hessian", f_zz, SECOND)):
            assert_near(getattr(whole, of), wanted, tolerance, flat=of == "hessian" and 2 in case.flat)
            assert_near(sum_of(each, of), wanted, tolerance, flat=of == "hessian" and 2 in case.flat)
        mu = np.random.default_rng([seed, 5]).uniform(-1.0, 1.0, m.nq)
        assert_near(whole.weighed(mu).hessian, np.tensordot(mu, f_zz, 1), SECOND, flat=2 in case.flat)
        if whole.highest_order < 3:
            with pytest.raises(ArgumentError, match=r"f: .*order 3.*up to order 2"):
                whole.along(q=q)


@every("force")
def test_the_third_order_of_forces(case: Case, seed: int) -> None:
    m = problem(case.name, seed).mechanism
    q, v, u, *_ = points(case, seed)[0]
    z, rng = np.concatenate([q, v, u]), np.random.default_rng([seed, 6])
    d, mu = rng.uniform(-1.0, 1.0, len(z)), rng.uniform(-1.0, 1.0, m.nq)

    def at(y: np.ndarray, element: str | None = None) -> FunctionDerivatives:
        return m.force(*np.split(y, [m.nq, 2 * m.nq]), element)

    def along(direction: np.ndarray, element: str | None = None) -> FunctionDerivatives:
        return at(z, element).along(**dict(zip("qvu", np.split(direction, [m.nq, 2 * m.nq]), strict=True)))

    if at(z).highest_order < 3:
        with pytest.raises(ArgumentError, match=r"f: .*order 3.*up to order 2"):
            along(d)
        return
    third = along(d)
    assert_near(third.value, at(z).gradient @ d, FIRST)
    assert_near(third.gradient, at(z).hessian @ d, SECOND, flat=2 in case.flat)
    hessian = third.weighed(mu).hessian
    np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-12 * np.abs(hessian).max(initial=1.0))
    np.testing.assert_allclose(np.tensordot(mu, third.hessian, 1), hessian, rtol=0, atol=1e-12 * np.abs(hessian).max())
    each = [along(d, name).weighed(mu) for name, e in m.elements.items() if isinstance(e, Force)]
    assert_near(sum_of(each, "hessian"), hessian, SECOND, flat=not hessian.any())
    check_against_the_order_below(hessian, z, d, lambda y: at(y).weighed(mu).hessian)


@pytest.mark.parametrize("kind", range(3))
def test_the_lagrangian_of_bodies_to_the_fourth_order(kind: int) -> None:
    """On trees of every kind of joint, against automatic differentiation of another formulation."""
    tree = random_tree(kind, kind=kind)
    d, core, n = oracle_lagrangian.data_of(tree), tree.core(), tree.nq
    rng = np.random.default_rng([kind, 11])
    z, first, second = rng.uniform(-1.0, 1.0, (3, 2 * n))

    def L(at):
        return oracle_lagrangian.lagrangian(d, at[:n], at[n:])

    def along(function, direction):
        return lambda at: jax.jvp(function, (at,), (jnp.asarray(direction),))[1]

    function = L
    for directions in (np.zeros((0, 2 * n)), first[None], np.stack([first, second])):
        if len(directions):
            function = along(function, directions[-1])
        dq, dv = np.ascontiguousarray(directions[:, :n]), np.ascontiguousarray(directions[:, n:])
        value, gradient, hessian = core.lagrangian_of_bodies(z[:n], z[n:], dq, dv)
        fixed = (
            float(L(jnp.zeros(2 * n)))
            - core.lagrangian_of_bodies(np.zeros(n), np.zeros(n), np.zeros((0, n)), np.zeros((0, n)))[0][0]
        )
        wanted = float(function(jnp.asarray(z))) - (0.0 if len(directions) else fixed)
        assert value[0] == pytest.approx(wanted, rel=1e-11)
        assert_near(gradient[0], jax.jacfwd(function)(jnp.asarray(z)), 1e-11)
        assert_near(hessian.reshape(2 * n, 2 * n), jax.jacfwd(jax.jacfwd(function))(jnp.asarray(z)), 1e-11)


# What can be asked, on a small mechanism


def small() -> Mechanism:
    tree = [
        rz("a", name="upper", mass=1.0, com=(0.0, -0.5, 0.0), inertia=(0.1, 0.1, 0.1)),
        [
            ty(-1.0),
            [rz("b", name="lower", mass=0.7, com=(0.1, -0.4, 0.0), inertia=(0.1, 0.1, 0.1)), [ty(-1.0, name="tip")]],
        ],
    ]
    return Mechanism(
        tree,
        [
            Gravity((0.0, -9.81, 0.0), name="weight"),
            JointSpring("a", 1.5, name="other"),
            JointSpring("b", 2.0, name="spring"),
            Damping({"a": 0.3}, name="oil"),
            JointForce("a", "torque", name="motor"),
            Distance("tip", "world", "rope", name="rope"),
        ],
    )


Q, V = np.array([0.3, -0.8, 1.5]), np.array([0.5, 1.2, 0.1])


def test_the_parts_of_the_lagrangian_have_names() -> None:
    m = small()
    L = m.lagrangian(Q, V)
    energy = m.energy(Q, V)
    assert L.value == pytest.approx(energy.kinetic - energy.potential)
    np.testing.assert_allclose(L.by("v"), m.momentum(Q, V))
    np.testing.assert_allclose(L.by("v", "v"), m.mass_matrix(Q))
    np.testing.assert_array_equal(L.by("v", "q"), L.by("q", "v").T)
    weight = m.potential(Q, "weight")
    others = [m.potential(Q, name) for name in ("other", "spring")]
    assert weight.value + sum(each.value for each in others) == pytest.approx(energy.potential)
    still = m.lagrangian(Q, np.zeros(3)).by("q", "q")
    np.testing.assert_allclose(weight.hessian, -still - np.diag([1.5, 2.0, 0.0]), atol=1e-13)
    assert m.potential(Q, "spring").value == pytest.approx(0.5 * 2.0 * Q[1] ** 2)
    np.testing.assert_allclose(m.force(Q, V, [2.0], "oil").value, [-0.3 * V[0], 0.0, 0.0])
    np.testing.assert_allclose(m.force(Q, V, [2.0], "motor").by("u"), [[1.0], [0.0], [0.0]])


def test_a_tensor_holds_what_contractions_give() -> None:
    m = small()
    L, h = m.lagrangian(Q, V), m.constraint(Q, "rope")
    rng = np.random.default_rng(3)
    (dq, dv), (eq, ev) = rng.normal(size=(2, 2, 3))
    third, fourth = L.tensor(3), L.tensor(4)
    assert third.shape == (6,) * 3
    assert fourth.shape == (6,) * 4
    assert_near(third @ np.r_[dq, dv], L.along(q=dq, v=dv).hessian, 1e-13)
    assert_near(fourth @ np.r_[dq, dv] @ np.r_[eq, ev], L.along(q=dq, v=dv).along(q=eq, v=ev).hessian, 1e-13)
    np.testing.assert_allclose(fourth, fourth.transpose(2, 0, 3, 1), atol=1e-12)
    assert_near(h.tensor(4)[0] @ dq @ eq, h.along(q=dq).along(q=eq).hessian[0], 1e-13)
    for order, found in enumerate((L.value, L.gradient, L.hessian)):
        np.testing.assert_array_equal(L.tensor(order), found)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda m: m.potential(Q, "sprng"), r"element: unknown element 'sprng'; did you mean 'spring'\?"),
        (
            lambda m: m.potential(Q, "rope"),
            "element: 'rope' is a Distance; the potentials are 'weight', 'other', 'spring'",
        ),
        (lambda m: m.force(Q, V, [1.0], "spring"), "'spring' is a JointSpring; the forces are"),
        (lambda m: m.constraint(Q, "oil"), "'oil' is a Damping; the constraints are 'rope'"),
        (lambda m: m.force(Q, V, [1.0, 2.0]), r"u: got shape \(2,\).*torque"),
        (lambda m: m.lagrangian(Q, V[:2]), r"v: got shape \(2,\)"),
        (lambda m: m.lagrangian(Q, V).along(u=[1.0]), "L: unknown argument 'u'; the arguments are 'q', 'v'"),
        (lambda m: m.lagrangian(Q, V).along(q=[1.0]), r"L: along: q: got shape \(1,\)"),
        (lambda m: m.lagrangian(Q, V).by("q", "q", "q"), "by: got 3 arguments, expected one or two"),
        (lambda m: m.lagrangian(Q, V).tensor(5), "L: .*order 5.*up to order 4"),
        (lambda m: m.lagrangian(Q, V).tensor(-1), "order: got -1"),
        (lambda m: m.lagrangian(Q, V).tensor(4, max_bytes=8 * 6**4 - 1), r"L: .*\(6, 6, 6, 6\) takes 0.0104 MB"),
        (lambda m: m.force(Q, V).tensor(2, max_bytes=100), r"f: .*shape \(3, 7, 7\)"),
        (lambda m: m.lagrangian(Q, V).weighed([1.0]), "L: weighed: it is a single function"),
        (lambda m: m.constraint(Q).weighed([1.0, 2.0]), r"h: weights: got shape \(2,\)"),
    ],
)
def test_bad_questions_are_named(ask, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        ask(small())


def test_what_is_returned_is_frozen_and_can_be_sent_to_another_process() -> None:
    m = small()
    q = Q.copy()
    L = m.lagrangian(q, V)
    before = L.hessian.copy()
    q[:] = 0.0
    assert not L.gradient.flags.writeable
    assert not L.hessian.flags.writeable
    for function in (L, m.force(Q, V, [1.0], "motor"), m.constraint(Q).weighed([2.0]), m.potential(Q, "weight")):
        again = pickle.loads(pickle.dumps(function))
        np.testing.assert_array_equal(again.hessian, function.hessian)
        np.testing.assert_array_equal(again.evaluate(again.directions, np.ones(len(again.values)))[1], again.gradients)
    np.testing.assert_array_equal(L.along(q=V).along(v=V).hessian, m.lagrangian(Q, V).along(q=V).along(v=V).hessian)
    np.testing.assert_array_equal(L.hessian, before)


def test_elements_keep_their_places_under_other_numbers() -> None:
    m = small().with_parameters({"spring.stiffness": 5.0, "oil.a": 0.7})
    assert m.potential(Q, "spring").value == pytest.approx(2.5 * Q[1] ** 2)
    np.testing.assert_allclose(m.force(Q, V, element="oil").value, [-0.7 * V[0], 0.0, 0.0])


def test_a_mechanism_in_which_nothing_moves_has_derivatives_of_no_entries() -> None:
    post = Mechanism([tx(0.3, mass=1.0)], [Gravity((0.0, -9.81, 0.0))])
    L = post.lagrangian([], [])
    assert L.value == 0.0
    assert L.gradient.shape == L.along(q=[], v=[]).gradient.shape == (0,)
