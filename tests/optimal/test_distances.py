"""The price of how far apart pairs of frames are."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Gravity, JointForce, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, optimize, rx, rz, ty
from leastaction.costs import DistanceCost
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.optimal import check_derivatives

PAIRS = [("hand", "post"), ("elbow", "hand")]
ARM = Mechanism(
    [
        rx("a"), [ty(0.3, mass=0.5, name="elbow"), [rz("b"), [ty(-0.4, mass=0.5, name="hand")]]],
        ty(1.0, name="post"),
    ],
    [Gravity(), JointForce("a", "f"), JointForce("b", "g")],
)  # fmt: skip
N = 20
SYSTEM = MidpointSystem(MidpointVI(ARM), np.linspace(0.0, 1.0, N + 1) ** 1.3)
PLAIN = QuadraticCost(np.zeros((N + 1, 4)), np.zeros((N, 2)), Q=[1.0, 0.0, 0.1, 0.1], R=[0.1, 0.1])


def apart(x: Array) -> Array:
    places = ARM.positions(x[:, :2], ["hand", "post", "elbow"])
    return np.linalg.norm(np.stack([places[:, 0] - places[:, 1], places[:, 2] - places[:, 0]], axis=1), axis=2)


def motion() -> tuple[Array, Array]:
    rng = np.random.default_rng(1)
    return rng.normal(size=(N + 1, 4)), rng.normal(size=(N, 2))


@pytest.mark.parametrize("each", [True, False])
def test_it_is_of_the_squares_of_distances_with_exact_derivatives(each: bool) -> None:
    """Of weights and distances for all instants, or for each."""
    rng, (x, u) = np.random.default_rng(2), motion()
    shape = (N + 1, 2) if each else (2,)
    wanted, weights = rng.uniform(0.5, 1.5, shape), rng.uniform(1.0, 3.0, shape)
    cost = DistanceCost(PLAIN, SYSTEM, PAIRS, wanted, weights)
    off = (apart(x) ** 2 - wanted**2) / (2.0 * wanted)
    assert cost.value(x, u) == pytest.approx(PLAIN.value(x, u) + 0.5 * np.sum(weights * off**2))
    assert check_derivatives(SYSTEM, 0.1 * x, 0.1 * u, cost=cost).ok
    # A part of it costs what it costs there.
    part = cost.window(2, 5, N=N, nu=2)
    np.testing.assert_allclose(part.stage_values(x[2:5], u[2:5], 0), cost.stage_values(x[2:5], u[2:5], 2))


def test_frames_that_are_nearly_as_far_apart_as_wanted_are_off_by_the_difference() -> None:
    x, u = motion()
    cost = DistanceCost(PLAIN, SYSTEM, PAIRS, apart(x) - 1e-4, 2.0)
    assert cost.value(x, u) - PLAIN.value(x, u) == pytest.approx((N + 1) * 2 * 1e-8, rel=1e-3)


def test_the_convex_model_feels_how_frames_that_are_too_far_apart_swing() -> None:
    """Else a search creeps among firm weights: it is most of what bends the price across the line between them."""
    x, u = motion()
    q, d, step = x[:-1, :2], apart(x)[:-1], 1e-6
    slopes = np.stack([(apart(x + step * e) - apart(x - step * e))[:-1] / (2.0 * step) for e in np.eye(4)[:2]], axis=2)
    jacobian = [ARM.frame_jacobian(q, name)[:, :3] for name in ("hand", "post", "elbow")]
    moved = np.stack([jacobian[0] - jacobian[1], jacobian[2] - jacobian[0]], axis=1)
    for times in (0.5, 2.0):
        L = d / times
        whole = np.vstack([L, L[-1:]])
        bent = [DistanceCost(PLAIN, SYSTEM, PAIRS, whole, w).convex_hessian(x, u).Q for w in (1.0, 0.0)]
        first = [each if each.ndim == 3 else np.array([np.diag(row) for row in np.atleast_2d(each)]) for each in bent]
        along = np.einsum("ks,ksi,ksj->kij", times**2 * np.ones_like(L), slopes, slopes)
        pull = np.maximum(d**2 - L**2, 0.0) / (2.0 * L**2)
        across = np.einsum("ks,ksai,ksaj->kij", pull, moved, moved)
        np.testing.assert_allclose((first[0] - first[1])[:, :2, :2], along + across, atol=1e-6)


def test_a_hand_stays_as_far_from_a_post_as_it_is_wanted() -> None:
    x0 = np.array([0.3, 0.2, 0.0, 0.0])
    wanted = apart(x0[None, :])[0, :1]
    plain = QuadraticCost(np.zeros((N + 1, 4)), np.zeros((N, 2)), Q=np.zeros(4), R=[1e-3, 1e-3])
    off = list[float]()
    for weight in (0.0, 1e4):
        cost = DistanceCost(plain, SYSTEM, PAIRS[:1], wanted, weight)
        result = optimize(SYSTEM, cost, initial=(x0, np.zeros((N, 2))))
        assert result.success
        off.append(float(np.abs(apart(result.x)[:, 0] - wanted[0]).max()))
    assert off[1] < 0.01 < 0.1 < off[0]


@pytest.mark.parametrize(
    ("pairs", "distances", "weights", "said"),
    [
        ([("hand", "ghost")], [1.0], 1.0, "ghost"),
        (PAIRS, [1.0], 1.0, "distances"),
        (PAIRS, [1.0, 0.0], 1.0, "distances: got 0, expected numbers > 0"),
        (PAIRS, [1.0, 1.0], [1.0, -1.0], "weights: got -1"),
        (PAIRS, [1.0, 1.0], np.ones((N, 2)), "weights"),
    ],
)
def test_what_is_wrong_is_told(
    pairs: list[tuple[str, str]], distances: list[float], weights: list[float] | float, said: str
) -> None:
    with pytest.raises(ArgumentError, match=said):
        DistanceCost(PLAIN, SYSTEM, pairs, distances, weights)
