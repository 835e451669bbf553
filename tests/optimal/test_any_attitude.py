"""No attitude is special to the optimiser: the same problem in turned worlds, and Newton's tail in each."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction import BodyWrench, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, ball, optimize
from leastaction.costs import OrientationCost
from leastaction.limits import Bound, Oriented, Pointing
from leastaction.numerics import rotations
from leastaction.optimal import OptimizationResult, Status

N, T = 60, np.linspace(0.0, 3.0, 61)
TORQUES = ["a", "b", "c"]
BODY = Mechanism(
    [ball("body", axes="quaternion", mass=1.0, inertia=(1.0, 1.3, 0.7))], [BodyWrench("body", torque=TORQUES)]
)
# As it is; where the middle of three angles is a right one; on its head; anywhere.
WORLDS = [
    Rotation.identity(), Rotation.from_euler("y", 90.0, degrees=True), Rotation.from_euler("x", 180.0, degrees=True),
    *Rotation.random(3, rng=np.random.default_rng(3)),
]  # fmt: skip


def caught(world: Rotation, *, limits: bool) -> OptimizationResult:
    """A body that tumbles by more than two turns is caught and turned as wanted, in a world that is turned."""
    system = MidpointSystem(MidpointVI(BODY), T)
    attitude = rotations.of_matrix((world * Rotation.from_rotvec([0.2, -0.1, 0.4])).as_matrix())
    q = BODY.configuration(dict(zip(BODY.coordinates, attitude, strict=True)))
    start = system.integrator.start(q, [0.1, 4.0, 0.1])
    wanted = (world * Rotation.from_rotvec([1.0, 2.0, -1.5])).as_matrix()
    plain = QuadraticCost(
        np.r_[start.x[:4], np.zeros(3)], np.zeros((N, 3)), Q=np.zeros(6), R=np.full(3, 0.01),
        Q_final=np.r_[np.zeros(3), np.full(3, 20.0)], space=system,
    )  # fmt: skip
    asked = [Bound(TORQUES, -3.0, 3.0), Oriented("body", wanted, at="end"),
             Pointing("body", (0, 0, 1), wanted[:, 2], within=2.6)] if limits else []  # fmt: skip
    cost = plain if limits else OrientationCost(plain, system, {"body": wanted}, {"body": [1.0, 1.0, 2.0]})
    tight = {} if limits else {"tolerance": 1e-22, "absolute_tolerance": 0.0}
    return optimize(system, cost, initial=(start.x, np.zeros((N, 3))), limits=asked, **tight)


@pytest.mark.parametrize("limits", [False, True], ids=["priced", "limited"])
def test_a_turned_world_changes_nothing(limits: bool) -> None:
    runs = [caught(world, limits=limits) for world in WORLDS]
    first, *others = runs
    assert np.abs(first.trajectory.v).max() > 3.9
    for run, world in zip(others, WORLDS[1:], strict=True):
        assert run.status is first.status
        assert run.cost == pytest.approx(first.cost, rel=1e-9)
        np.testing.assert_allclose(run.u, first.u, atol=1e-6)
        turned = rotations.product(rotations.of_matrix(world.as_matrix()), first.x[:, :4])
        apart = rotations.logarithm(rotations.product(rotations.inverse(turned), run.x[:, :4]))
        np.testing.assert_allclose(apart, 0.0, atol=1e-6)


@pytest.mark.parametrize("world", WORLDS, ids=range(len(WORLDS)))
def test_newtons_tail_is_quadratic(world: Rotation) -> None:
    found = caught(world, limits=False)
    assert found.status in (Status.CONVERGED, Status.STALLED)  # so tight a tolerance is met, or rounding is before it
    decreases = np.array(found.history.expected_decrease)
    newton = [k for k, method in enumerate(found.history.method) if method == "newton" and k + 1 < len(decreases)]
    tail = [k for k in newton if k + 1 in newton and decreases[k] < 1e-2]
    assert tail
    for k in tail:
        assert decreases[k + 1] < 30.0 * decreases[k] ** 2 + 1e-17
