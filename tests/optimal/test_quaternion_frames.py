"""What is priced and limited of frames and rates where rotations are quaternions, against SciPy and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction import (
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    ball,
    free,
    ry,
    tx,
    tz,
)
from leastaction.costs import OrientationCost, PlaceCost, SmoothCost
from leastaction.errors import ArgumentError
from leastaction.limits import Ball, Bound, Keep, Oriented, Pointing
from leastaction.numerics import rotations
from leastaction.numerics.differences import fourth_order
from leastaction.optimal import check_derivatives
from leastaction.optimal.cost import deviations
from leastaction.optimal.quantity import Samples

BODY = {"mass": 0.5, "inertia": (2e-3, 3e-3, 4e-3), "com": (0.02, 0.0, 0.05)}
N = 5


def system(*, multipliers: bool = False) -> MidpointSystem:
    """A floating body with an arm behind a ball joint, which has a hinge and a slide; and a cart beside it."""
    hand = ry("c", name="fore", **BODY), [tz("slide", name="hand", mass=0.1)]
    arm = [ball("a", axes="quaternion", name="upper", **BODY), [tz(0.2), list(hand)]]
    tree = [free("base", axes="quaternion", **BODY), [tx(0.3), arm]]
    cart = tx("rail", kinematic=True, name="cart", mass=0.1)
    m = Mechanism([*tree, cart], [Gravity(), JointForce("c", input="motor")])
    return MidpointSystem(MidpointVI(m), np.linspace(0.0, 0.1, N + 1), multipliers=multipliers)


SYSTEM = system()
M = SYSTEM.mechanism
RNG = np.random.default_rng(4)


def states(n: int) -> np.ndarray:
    """States anywhere: quaternions of unit length, and all else at random."""
    x = RNG.standard_normal((n, SYSTEM.nx))
    for first in ("base.qw", "a.qw"):
        i = M.coordinates.index(first)
        x[:, i : i + 4] /= np.linalg.norm(x[:, i : i + 4], axis=1, keepdims=True)
    return x


WANTED = Rotation.from_rotvec([0.4, -1.1, 0.3])
LIMITS = [
    Oriented("hand", WANTED.as_matrix()),
    Oriented("hand", WANTED.as_matrix(), within=0.4),
    Oriented("hand", WANTED.as_matrix(), origin="base"),
    Oriented("hand", WANTED.as_matrix(), within=2.0, origin="upper"),
    Pointing("hand", (1.0, 0.0, 0.5), (0.0, -1.0, 2.0), within=1.0),
    Pointing("hand", (1.0, 0.0, 0.5), (0.0, -1.0, 2.0), beyond=2.0, origin="base"),
    Keep("hand", inside=Ball((0.1, 0.2, 0.3), 0.5), point=(0.1, 0.0, 0.0)),
    Keep("hand", outside=Ball((0.1, 0.2, 0.3), 0.5), origin="base"),
    Bound(["base.w*", "a.wy", "c", "base.x"], -1.0, of="rate"),
]


@pytest.mark.parametrize("limit", LIMITS, ids=str)
def test_limits_have_the_derivatives_that_differences_have(limit) -> None:
    n, ndx, nu = 4, SYSTEM.ndx, SYSTEM.nu
    quantity = limit.rows(SYSTEM, 0)[0].quantity
    ahead = quantity.looks_ahead
    x, u = states(n), RNG.standard_normal((n, nu))
    x_next = SYSTEM.plus(x, 0.5 * RNG.standard_normal((n, ndx)))  # less than half a turn away
    y = RNG.standard_normal((n, len(quantity.names)))
    columns = quantity.columns(ndx, nu)

    def at(dz):
        """Samples moved by differences of x, u and x_next."""
        moved = SYSTEM.plus(x_next, np.tile(dz[ndx + nu :], (n, 1))) if ahead else np.empty((n, 0))
        return Samples(np.arange(n), SYSTEM.plus(x, np.tile(dz[:ndx], (n, 1))), u + dz[ndx : ndx + nu], moved)

    here = np.zeros(2 * ndx + nu)
    J, H = quantity.jacobian(at(here)), quantity.curvature(at(here), y)
    assert J.shape[1:] == (len(quantity.names), len(columns))
    H = np.zeros((n, len(columns), len(columns))) if H is None else H
    assert np.abs(J).max() > 1e-2
    assert np.abs(H - H.swapaxes(1, 2)).max() < 1e-12
    rest = np.setdiff1d(np.arange(len(here)), columns)
    for j in (*columns, *RNG.choice(rest, 3)):
        step = np.eye(len(here))[j]
        slope = fourth_order(lambda by, step=step: quantity.values(at(by * step)), 1e-3)
        expected = J[:, :, columns.tolist().index(j)] if j in columns else np.zeros(slope.shape)
        np.testing.assert_allclose(expected, slope, atol=1e-8)
    # Along any direction twice, which is all that a symmetric second derivative is.
    for _ in range(8):
        d = RNG.standard_normal(len(columns))
        along = np.zeros(len(here))
        along[columns] = d / np.linalg.norm(d)
        bend = _second(lambda by, along=along: np.einsum("km,km->k", y, quantity.values(at(by * along))))
        np.testing.assert_allclose(np.einsum("i,kij,j->k", along[columns], H, along[columns]), bend, atol=1e-5)


def _second(f, h=4e-3):
    return (-f(2 * h) + 16 * f(h) - 30 * f(0.0) + 16 * f(-h) - f(-2 * h)) / (12.0 * h * h)


def test_balls_that_are_limited_at_once_are_those_one_by_one() -> None:
    each = [Keep(frame, outside=Ball((0.1, 0.2, size), 0.5)) for frame, size in (("hand", 0.3), ("fore", 0.1))]
    one, other = (limit.rows(SYSTEM, 0)[0].quantity for limit in each)
    both = one.joined([other])
    assert both is not None
    at, y = Samples(np.arange(4), states(4), np.empty((4, 0)), np.empty((4, 0))), RNG.standard_normal((4, 2))
    for what in ("values", "jacobian"):
        np.testing.assert_allclose(
            getattr(both, what)(at), np.concatenate([getattr(q, what)(at) for q in (one, other)], 1)
        )
    bent = one.curvature(at, y[:, :1]) + other.curvature(at, y[:, 1:])
    np.testing.assert_allclose(both.curvature(at, y), bent, atol=1e-12)


def test_what_limits_say_is_what_scipy_says() -> None:
    x = states(6)
    at = Samples(np.arange(6), x, np.empty((6, 0)), np.empty((6, 0)))
    q = x[:, : M.nq]
    hand, base = (Rotation.from_matrix(M.frame_pose(q, name)[:, :3, :3]) for name in ("hand", "base"))
    off = (WANTED.inv() * base.inv() * hand).as_rotvec()
    assert LIMITS[2].rows(SYSTEM, 0)[0].quantity.values(at) == pytest.approx(off, abs=1e-12)
    axis, towards = np.array([1.0, 0.0, 0.5]) / np.sqrt(1.25), np.array([0.0, -1.0, 2.0]) / np.sqrt(5.0)
    angle = np.arccos(np.sum(hand.apply(axis) * towards, axis=1))
    room = LIMITS[4].rows(SYSTEM, 0)[0].quantity.values(at)[:, 0]
    assert (room > 0.0).tolist() == (angle < 1.0).tolist()
    assert room == pytest.approx((np.cos(angle) - np.cos(1.0)) / np.sin(1.0))
    angle = np.arccos(np.sum(hand.apply(axis) * base.apply(towards), axis=1))
    assert (LIMITS[5].rows(SYSTEM, 0)[0].quantity.values(at)[:, 0] > 0.0).tolist() == (angle > 2.0).tolist()


def test_rates_of_turns_are_mean_angular_velocities() -> None:
    x = states(3)
    x_next = SYSTEM.plus(x, 0.5 * RNG.standard_normal((3, SYSTEM.ndx)))
    rates = SYSTEM.quantity("rate").values(Samples(np.arange(3), x, np.empty((3, 0)), x_next))
    expected = SYSTEM.difference(x_next, x)[:, : M.nv] / np.diff(SYSTEM.t)[:3, None]
    assert rates == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("axes", ["world", "frame"])
def test_jacobians_of_frames_move_as_differences_say(axes) -> None:
    x, point = states(3), (0.1, -0.2, 0.3)

    def J(dx):
        moved = SYSTEM.plus(x, np.tile(np.r_[dx, np.zeros(SYSTEM.ndx - M.nv)], (3, 1)))
        return M.frame_jacobian(moved[:, : M.nq], "hand", point=point, axes=axes)

    found = M.frame_jacobian_derivative(x[:, : M.nq], "hand", point=point, axes=axes)
    assert found.shape == (3, 6, M.nv, M.nv)
    for j, step in enumerate(np.eye(M.nv)):
        slope = fourth_order(lambda by, step=step: J(by * step), 1e-3)
        np.testing.assert_allclose(found[..., j], slope, atol=1e-9)


def test_mixed_derivatives_of_the_logarithm() -> None:
    phi, w = RNG.standard_normal((4, 3)), RNG.standard_normal((4, 3))
    phi[0] *= 1e-3  # where series stand in

    def slope(d):
        moved = rotations.logarithm(rotations.product(rotations.exponential(phi), rotations.exponential(d)))
        return np.einsum("na,nai->ni", w, -rotations.logarithm_derivative(-moved))

    for j, step in enumerate(np.eye(3)):
        expected = fourth_order(lambda by, step=step: slope(np.tile(by * step, (4, 1))), 1e-3)
        assert rotations.logarithm_mixed(phi, w)[:, :, j] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("multipliers", [False, True])
def test_prices_keep_to_their_derivatives(multipliers: bool) -> None:
    of = system(multipliers=multipliers)
    zero = np.zeros(of.nx)
    zero[: M.nq] = M.configuration()
    plain = QuadraticCost(np.tile(zero, (N + 1, 1)), np.zeros((N, of.nu)), Q=np.full(of.ndx, 1e-3),
                          R=np.full(of.nu, 1e-2), space=of)  # fmt: skip
    cost = OrientationCost(plain, of, {"hand": WANTED.as_matrix(), "base": np.eye(3)}, {"hand": [3.0, 2.0, 1.0]})
    cost = SmoothCost(PlaceCost(cost, of, {"hand": [0.1, 0.2, 0.3]}, {"hand": 2.0}), of, {"rail": 1e-4})
    start = np.zeros(of.nx)
    moved = 0.3 * RNG.standard_normal(SYSTEM.ndx)
    moved[M.nv :] *= 0.01  # momenta, of bodies this light
    start[: SYSTEM.nx] = SYSTEM.plus(zero[: SYSTEM.nx], moved)
    run = of.rollout(start, np.tile(start, (N + 1, 1)), 0.01 * RNG.standard_normal((N, of.nu)),
                     np.zeros((N, of.nu, of.ndx)), 0, N)  # fmt: skip
    assert run.failure is None
    report = check_derivatives(of, run.x, run.u, cost=cost)
    assert report.ok, report


@pytest.mark.parametrize("diagonal", [True, False])
def test_half_squares_of_differences_are_derived_where_states_curve(diagonal: bool) -> None:
    space = SYSTEM.space
    assert space is not None
    x = states(3)
    y = SYSTEM.plus(x, 0.4 * RNG.standard_normal((3, SYSTEM.ndx)))
    W = np.diag(RNG.uniform(0.5, 1.0, SYSTEM.ndx)) if diagonal else np.cov(RNG.standard_normal((SYSTEM.ndx, 99)))
    found = deviations(space, np.diag(W) if diagonal else W, y, x)
    J, off = space.difference_derivative(y, x), space.difference(y, x)
    assert np.abs(J - np.eye(SYSTEM.ndx)).max() > 0.1
    np.testing.assert_allclose(found.gradient, np.einsum("kij,ki->kj", J, off @ W), atol=1e-13)
    np.testing.assert_allclose(found.squares, J.swapaxes(1, 2) @ W @ J, atol=1e-13)
    assert space.curved.sum() == 6


def test_what_is_no_cone_is_told() -> None:
    with pytest.raises(ArgumentError, match="expected an angle"):
        Pointing("hand", (1, 0, 0), (0, 0, 1))
    with pytest.raises(ArgumentError, match="within: got 4"):
        Pointing("hand", (1, 0, 0), (0, 0, 1), within=4.0)
    with pytest.raises(ArgumentError, match="axis: got a direction of length zero"):
        Pointing("hand", (0, 0, 0), (0, 0, 1), within=1.0)
    with pytest.raises(ArgumentError, match="hnad"):
        Pointing("hnad", (1, 0, 0), (0, 0, 1), within=1.0).rows(SYSTEM, 0)
    with pytest.raises(ArgumentError, match="bsae"):
        Oriented("hand", np.eye(3), origin="bsae").rows(SYSTEM, 0)
