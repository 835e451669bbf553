"""What inputs can steer: against the textbook's rank test and Gramian, and on mechanisms where the answer is known."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from leastaction import (
    Damping,
    Gravity,
    JointForce,
    LinearSpring,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    PointToPoint,
    controllability,
    project_configuration,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearSystem

DT = 0.02


def along(mechanism: Mechanism, q0, *, v=None, steps: int = 40, inputs=None, multipliers: bool = False):
    """A motion of a mechanism, as a system, states and inputs."""
    vi = MidpointVI(mechanism, threads=1)
    t = DT * np.arange(steps + 1)
    held = np.zeros((steps, mechanism.n_inputs)) if inputs is None else inputs(t[:-1])
    run = vi.simulate(vi.start(q0, v), t, inputs=held)
    assert run.steps == steps, run.message
    system = MidpointSystem(vi, t, multipliers=multipliers)
    x = run.x if not multipliers else np.hstack([run.x, np.vstack([np.zeros(mechanism.nc), run.lam])])
    return system, x, run.u


def pendulums(lengths, *, driven: str = "cart") -> Mechanism:
    """Two pendulums side by side on a cart, which is pushed."""
    arms = []
    for name, length in zip("ab", lengths, strict=True):
        arms += [rx(name), [tz(-length, name=f"bob_{name}", mass=0.5)]]
    return Mechanism([ty("cart", mass=1.0), arms], [Gravity(), JointForce(driven, "push")])


def test_the_rank_and_the_gramian_are_those_of_the_textbook() -> None:
    rng = np.random.default_rng(4)
    A, B = rng.normal(size=(5, 5)) / 3.0, rng.normal(size=(5, 2))
    A[3:, :3], B[3:] = 0.0, 0.0  # the last two move by themselves
    N = 9
    system = LinearSystem(np.tile(A, (N, 1, 1)), np.tile(B, (N, 1, 1)))
    found = controllability(system, np.zeros((N + 1, 5)), np.zeros((N, 2)))
    (window,) = found.windows
    blocks = [np.linalg.matrix_power(A, k) @ B for k in range(N)]
    np.testing.assert_allclose(window.gramian, sum(block @ block.T for block in blocks), atol=1e-12)
    assert window.rank == np.linalg.matrix_rank(np.hstack(blocks)) == 3
    assert set(window.unsteered) == {"x[3]", "x[4]"}
    assert window.smallest == 0.0
    assert not found.controllable
    np.testing.assert_allclose(window.directions.T @ np.hstack(blocks), 0.0, atol=1e-12)
    assert window.directions.shape == (5, 2)
    assert "rank 3 of 5" in str(found)
    assert "cannot be steered: x[" in str(found)


def test_many_steps_are_compressed_without_a_loss() -> None:
    rng = np.random.default_rng(5)
    N, A, B = 60, rng.normal(size=(60, 4, 4)) / 2.5, rng.normal(size=(60, 4, 2))
    window = controllability(LinearSystem(A, B), np.zeros((N + 1, 4)), np.zeros((N, 2))).windows[0]
    gramian = np.zeros((4, 4))
    for k in range(N):
        gramian = A[k] @ gramian @ A[k].T + B[k] @ B[k].T
    np.testing.assert_allclose(window.gramian, gramian, rtol=1e-10)
    assert window.controllable


def test_singular_values_do_not_depend_on_units_but_with_a_scale_of_ones_own() -> None:
    rng = np.random.default_rng(6)
    A, B = rng.normal(size=(8, 3, 3)), rng.normal(size=(8, 3, 1))
    units = np.array([1e3, 1.0, 1e-4])
    other = LinearSystem(units[:, None] * A / units, units[:, None] * B)
    zero = np.zeros((9, 3)), np.zeros((8, 1))
    first, second = (controllability(s, *zero).windows[0] for s in (LinearSystem(A, B), other))
    np.testing.assert_allclose(first.sizes, second.sizes, rtol=1e-8)
    scaled = controllability(other, *zero, scale=units).windows[0]
    plain = controllability(LinearSystem(A, B), *zero, scale=np.ones(3)).windows[0]
    np.testing.assert_allclose(scaled.sizes, plain.sizes, rtol=1e-8)
    np.testing.assert_allclose(plain.sizes**2, np.linalg.eigvalsh(plain.gramian)[::-1], rtol=1e-7)


@pytest.mark.parametrize("theta", [0.0, np.pi])
def test_a_cart_steers_its_pendulum(theta: float) -> None:
    m = cart_pendulum()
    q = m.configuration()
    q[m.variables.index("theta")] = theta
    found = controllability(*along(m, q))
    assert found.controllable
    assert found.worst.rank == 4


def test_equal_pendulums_on_a_cart_can_only_be_steered_together() -> None:
    equal = controllability(*along(pendulums([0.5, 0.5]), [0.0, 0.0, 0.0]))
    window = equal.windows[0]
    assert window.rank == 4
    assert set(window.unsteered) == {"a", "b", "p_a", "p_b"}
    # What no push changes is how the two differ.
    a, b, p_a, p_b = (("cart", "a", "b", "p_cart", "p_a", "p_b").index(name) for name in ("a", "b", "p_a", "p_b"))
    np.testing.assert_allclose(window.directions[[a, p_a]], -window.directions[[b, p_b]], atol=1e-6)
    different = controllability(*along(pendulums([0.5, 0.8]), [0.0, 0.0, 0.0]))
    assert different.controllable
    # Swinging apart, equal ones can be told apart.
    apart = controllability(*along(pendulums([0.5, 0.5]), [0.0, 0.9, -0.2]))
    assert apart.controllable


def test_what_no_input_reaches_is_named() -> None:
    m = Mechanism(
        [ry("arm"), [tz(-1.0, name="bob", mass=1.0)], tx("free", mass=1.0)],
        [Gravity(), JointForce("arm", "torque"), LinearSpring("world", "bob", stiffness=3.0, length=0.5)],
    )
    window = controllability(*along(m, [0.3, 0.0], v=[0.0, 0.2])).windows[0]
    assert window.rank == 2
    assert set(window.unsteered) == {"free", "p_free"}


def test_a_conserved_momentum_cannot_be_steered() -> None:
    """A falling cat of two links: the torque between them turns it, and leaves its spin as it is."""
    body = {"mass": 1.0, "com": (0.3, 0.0, 0.0), "inertia": (0.1, 0.1, 0.1)}
    m = Mechanism([rz("turn", **body), [rz("bend", **body)]], [JointForce("bend", "torque")])
    window = controllability(*along(m, [0.2, 0.5], inputs=lambda t: np.sin(9 * t)[:, None])).windows[0]
    assert window.unsteered[0] == "p_turn"
    assert window.rank < 4


def test_only_directions_that_keep_the_constraints_are_asked_for() -> None:
    link = {"mass": 0.5, "com": (0.25, 0.0, 0.0), "inertia": (0.01, 0.02, 0.02)}
    tree = [
        rz("a", **link), [tx(0.5), [rz("b", **link), [tx(1.0, name="tip")]]],
        tx(0.8), [rz("c", **link), [tx(0.7, name="end")]],
    ]  # fmt: skip
    m = Mechanism(tree, [PointToPoint("tip", "end", "xy"), JointForce("a", "torque"), Gravity((0.0, -9.81, 0.0))])
    q = project_configuration(m, [1.4, -1.0, 1.6]).q
    for multipliers in (False, True):
        found = controllability(*along(m, q, multipliers=multipliers))
        (window,) = found.windows
        assert len(window.sizes) == 2  # one degree of freedom, and its momentum
        assert found.controllable
    m = Mechanism(tree, [PointToPoint("tip", "end", "xy"), Damping(0.1)])
    none = controllability(*along(m, q, steps=5)).windows[0]
    assert none.rank == 0
    assert set(none.unsteered) == {"a", "b", "c", "p_a", "p_b", "p_c"}


def test_prescribed_variables_are_steered_over_two_steps() -> None:
    m = Mechanism([tx("hand", kinematic=True), [ry("swing"), [tz(-1.0, mass=1.0)]]], [Gravity()])
    system, x, u = along(m, [0.2, 0.0])
    assert controllability(system, x, u).controllable
    one = controllability(system, x, u, window=1)
    assert len(one.windows) == 40
    assert all(window.rank == 1 for window in one.windows)


def test_windows_follow_each_other() -> None:
    system, x, u = along(pendulums([0.5, 0.8]), [0.0, 0.4, -0.2])
    found = controllability(system, x, u, window=15)
    assert [(w.start, w.stop) for w in found.windows] == [(0, 15), (15, 30)]
    assert found.worst.smallest == min(w.smallest for w in found.windows)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.worst.gramian, found.worst.gramian)
    assert not again.worst.gramian.flags.writeable


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 0}, "window: got 0, expected a whole number, at least 1"),
        ({"window": 41}, "window: got 41 steps, expected at most the 40"),
        ({"scale": np.ones(3)}, r"scale: got shape \(3,\)"),
        ({"scale": np.zeros(6)}, "scale: got 0, expected positive sizes"),
        ({"tolerance": 0.0}, "tolerance: got 0"),
        ({"x": np.zeros((3, 6))}, r"x: got shape \(3, 6\).*\(N\+1, nx\)"),
        ({"u": np.full((40, 1), np.nan)}, "u: got nan"),
    ],
)
def test_bad_questions_are_named(options: dict, message: str) -> None:
    system, x, u = along(pendulums([0.5, 0.8]), [0.0, 0.4, -0.2])
    with pytest.raises(ArgumentError, match=message):
        controllability(system, **({"x": x, "u": u} | options))


def test_a_system_in_continuous_time_is_told_so() -> None:
    system = MechanismSystem(cart_pendulum())
    with pytest.raises(ArgumentError, match="system: got MechanismSystem, expected a DiscreteSystem"):
        controllability(system, np.zeros((2, 1)), np.zeros((1, 1)))
