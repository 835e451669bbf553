"""Limits on the lengths of paths over frames, in either kind of time and from files."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import leastaction
from derivatives.differences import extrapolated
from leastaction import (
    ContinuousQuadraticCost,
    Gravity,
    JointForce,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    tz,
)
from leastaction.errors import ArgumentError
from leastaction.limits import Parameter, PathBound
from leastaction.optimal import LinearSystem, Status
from leastaction.optimal.quantity import Samples

ARM = Mechanism(
    [tz(0.3, name="hook"), rx("a"), [tz(-1.0, mass=1.0, name="elbow"), [rx("b"), [tz(-0.7, mass=0.5, name="hand")]]]],
    [Gravity(), JointForce("a", "ua"), JointForce("b", "ub")],
)
T = np.linspace(0.0, 1.0, 41)


def length(q, terms=(("hook", "elbow", "hand"),)):
    """Return the length from the frames' places."""
    places = {name: ARM.positions(q, [name])[:, 0] for name in ("hook", "elbow", "hand")}
    return sum(np.linalg.norm(places[b] - places[a], axis=1) for t in terms for a, b in pairwise(t))


def test_lengths_have_exact_derivatives(rng):
    limit = PathBound({("hook", "elbow", "hand"): 0.5, ("hook", "hand"): -2.0}, -9.0)
    system = MidpointSystem(MidpointVI(ARM), T)
    (row,) = limit.rows(system, 0)
    q, x, nothing = rng.normal(size=(3, 2)), rng.normal(size=(3, 4)), np.empty((3, 0))

    def at(q):
        return Samples(np.arange(3), np.hstack([q, x[:, 2:]]), nothing, nothing)

    quantity, dq, y = row.quantity, rng.normal(size=(3, 2)), rng.normal(size=(3, 1))
    np.testing.assert_allclose(
        quantity.values(at(q))[:, 0], 0.5 * length(q) - 2.0 * length(q, (("hook", "hand"),)), rtol=1e-13
    )
    wanted = extrapolated(lambda by: quantity.values(at(q + by * dq)), 0.0, 0.05)
    np.testing.assert_allclose(np.einsum("kmi,ki->km", quantity.jacobian(at(q)), dq), wanted, atol=1e-9)
    wanted = extrapolated(
        lambda by: np.einsum("kmi,km->ki", quantity.jacobian(at(q + by * dq)), y), 0.0, 0.05
    )  # fmt: skip
    np.testing.assert_allclose(np.einsum("kij,kj->ki", quantity.curvature(at(q), y), dq), wanted, atol=1e-8)


@pytest.mark.parametrize("kind", ["steps", "continuous"])
def test_a_motion_keeps_to_what_a_string_can_reach(kind):
    limit = PathBound(["hook", "hand"], 1.2, 2.1)
    wanted, weights = [1.0, -2.0, 0.0, 0.0], {"Q": [10.0, 10.0, 0.01, 0.01], "R": [0.01, 0.01]}
    if kind == "steps":
        system = MidpointSystem(MidpointVI(ARM), T)
        start = [0.0, 0.2, 0.0, 0.0], np.zeros((40, 2))
        result = optimize(system, QuadraticCost(wanted, [0.0, 0.0], **weights), initial=start, limits=[limit])
        q = result.x[:, :2]
    else:
        cost = ContinuousQuadraticCost(wanted, [0.0, 0.0], **weights)
        start = [0.0, 0.2, 0.0, 0.0], [0.0, 0.0]
        result = optimize(MechanismSystem(ARM), cost, initial=start, horizon=(0.0, 1.0), limits=[limit])
        q = result.dense.x(T)[:, :2]
    found = length(q, (("hook", "hand"),))
    assert result.success, result.message
    assert found.min() == pytest.approx(1.2, abs=2e-3)
    assert found.max() < 2.1 + 2e-3
    assert "length of hook - hand >= 1.2 m" in result.limits.labels


def test_a_path_follows_the_length_that_moves_it():
    system = MidpointSystem(MidpointVI(ARM), T)
    cost = QuadraticCost([1.0, -2.0, 0.0, 0.0], [0.0, 0.0], Q=[10.0, 10.0, 0.01, 0.01], R=[0.01, 0.01])
    start = [0.0, 0.2, 0.0, 0.0], np.zeros((40, 2))
    result = optimize(
        system, cost, initial=start, limits=[PathBound(["hook", "hand"], 1.2, name="rope")],
        unknowns=[Parameter("hand.value", -1.0, -0.4, weight=1e-2)],
    )  # fmt: skip
    assert result.success, result.message
    run = result.trajectory
    places = run.mechanism.positions(run.q, ["hook", "hand"])
    assert np.linalg.norm(places[:, 1] - places[:, 0], axis=1).min() == pytest.approx(1.2, abs=1e-6)
    assert result.unknowns["hand.value"] != pytest.approx(-0.7, abs=1e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((["hook"], 1.0), "two frames or more"),
        (("hook", 1.0), "two frames or more"),
        ((["hook", "hand"],), "neither min nor max"),
        (({("hook", "hand"): 0.0}, 1.0), "factor of 0"),
    ],
)
def test_what_is_no_path_is_said(given, words):
    with pytest.raises(ArgumentError, match=words):
        PathBound(*given)


def test_what_has_no_such_frames_is_said():
    system = MidpointSystem(MidpointVI(ARM), T)
    with pytest.raises(ArgumentError, match="hnad"):
        PathBound(["hook", "hnad"], 1.0).rows(system, 0)
    with pytest.raises(ArgumentError, match="LinearSystem"):
        PathBound(["hook", "hand"], 1.0).rows(LinearSystem(np.eye(2), np.ones((2, 1)), N=3), 0)


FILE = """
<mujoco><worldbody><site name="top" pos="0 .1 0"/>
 <body><joint name="a" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1"/>
  <site name="knee" pos="0 .03 -.4"/>
  <body pos="0 0 -.5"><joint name="b" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass=".6"/>
   <site name="foot" pos="0 -.02 -.35"/></body></body></worldbody>
 <tendon><spatial name="cord" limited="true" range=".72 .9"><site site="top"/><site site="knee"/><site site="foot"/>
  </spatial></tendon>
 <actuator><motor name="ma" joint="a"/><motor name="mb" joint="b"/></actuator></mujoco>
"""


def test_the_range_of_a_tendon_is_a_limit(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    file = tmp_path / "leg.xml"
    file.write_text(FILE)
    model = leastaction.load(file)
    assert not any("tendon" in each.name for each in model.left_out)
    (limit,) = [each for each in model.limits if each.of == "length"]
    system = MidpointSystem(MidpointVI(model.mechanism), T)
    rows = limit.rows(system, 0)
    own = mujoco.MjModel.from_xml_string(FILE)
    data, nothing = mujoco.MjData(own), np.empty((1, 0))
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (4, 2)):
        data.qpos[:] = q
        mujoco.mj_forward(own, data)
        x = np.concatenate([q, np.zeros(2)])[None]
        found = rows[0].quantity.values(Samples(np.zeros(1, dtype=np.intp), x, nothing, nothing))
        assert found[0, 0] == pytest.approx(data.ten_length[0], rel=1e-12)
    cost = QuadraticCost([0.3, 2.0, 0.0, 0.0], [0.0, 0.0], Q=[10.0, 10.0, 0.01, 0.01], R=[0.01, 0.01])
    free = optimize(system, cost, initial=([0.0, 0.3, 0.0, 0.0], np.zeros((40, 2))))
    held = optimize(system, cost, initial=([0.0, 0.3, 0.0, 0.0], np.zeros((40, 2))), limits=list(model.limits))
    assert held.status is Status.CONVERGED
    ends = []
    for result in (free, held):
        data.qpos[:] = result.x[-1, :2]
        mujoco.mj_forward(own, data)
        ends.append(data.ten_length[0])
    assert ends[1] == pytest.approx(0.72, abs=0.03)
    assert 0.72 - 1e-6 < ends[1] < 0.9 + 1e-6
    assert ends[0] < 0.7
