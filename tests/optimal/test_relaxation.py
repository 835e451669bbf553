"""Constraints that are soft at first, and strings by their tensions: starts for what cannot be begun as it is."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from leastaction import (
    Distance,
    Gravity,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    StageTable,
    StartStatus,
    Status,
    by_tensions,
    embed,
    optimize,
    relax,
    rx,
    tz,
)
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import ElasticString, LinearSpring, PathLength, PointToPoint, TendonForce
from leastaction.models.bricard import bricard
from leastaction.models.marionette import STRINGS, marionette, rest_pose
from leastaction.optimal import Bound
from optimal.systems import CartPendulum, is_trajectory

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness_further import FURTHER
from benchmarks.robustness_problems import PROBLEMS, posed, puppet_arm

BY_NAME = {problem.name: problem for problem in PROBLEMS + FURTHER}


def finer(given, parts):
    """Return the problem with every step of time in so many parts."""
    t, wanted = given.system.t, given.cost
    at = np.arange(given.system.N * parts + 1) / parts
    times = np.interp(at, np.arange(len(t)), t)
    x = np.stack([np.interp(at, np.arange(len(t)), column) for column in wanted.x_wanted.T], axis=1)
    u_wanted, u = (np.repeat(each, parts, axis=0) for each in (wanted.u_wanted, given.u))
    cost = QuadraticCost(x, u_wanted, Q=wanted.Q / parts, R=wanted.R / parts, Q_final=wanted.Q_final)
    return MidpointSystem(given.system.integrator, times), cost, u


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("slider-crank, half a turn, R 0.01, final 100, rest", 1),
        ("four-bar, a turn, R 0.01, final 100, rest", 1),
        ("four-bar, a turn, R 0.01, final 100, rest", 4),
    ],
)
def test_a_loop_that_is_open_at_the_start_is_closed_by_springs(name, parts):
    """Only the driven joint is known; the others are not where the loop would be closed."""
    given = BY_NAME[name].build()
    system, cost, u = finer(given, parts)
    m = system.integrator.mechanism
    x0 = np.array(given.x)
    x0[1:] = 0.0
    assert np.abs(m.constraint_values(x0[: m.nq])).max() > 0.3
    for shooting in ("single", "multiple"):
        with pytest.raises(ArgumentError, match=r"does not satisfy the constraints: .* `relax`"):
            optimize(system, cost, initial=(x0, u), shooting=shooting)
    seen = []
    found = relax(system, cost, initial=(x0, u), callback=seen.append)
    assert found.status is StartStatus.COMPLETED
    assert found.result.status is Status.CONVERGED
    assert np.abs([m.constraint_values(q) for q in found.x[:, : m.nq]]).max() < 1e-9
    assert is_trajectory(system, found.x, found.u)
    assert found.cost == pytest.approx(cost.value(found.x, found.u))
    assert [stage.stage for stage in seen] == list(range(1, len(found.stages) + 1))
    assert seen[0].name.startswith("stiffness = 10")
    assert "residual of the constraints" in seen[0].note
    # Rounding decides whether the motion of springs can be followed in steps as long as the four-bar's are at first.
    (closed,) = [k for k, stage in enumerate(seen) if stage.name == "with its constraints"]
    assert all(stage.name.startswith("assembly mode") for stage in seen[closed + 1 :])
    assert seen[-1].value == found.value == np.inf


def test_what_starts_well_ends_where_it_does_without_springs():
    given = BY_NAME["slider-crank, half a turn, R 0.01, final 100, rest"].build()
    alone = optimize(given.system, given.cost, initial=(given.x, given.u))
    found = relax(given.system, given.cost, initial=(given.x, given.u))
    assert found.cost == pytest.approx(alone.cost, rel=1e-7)


def test_a_search_with_springs_can_be_stopped():
    given = BY_NAME["slider-crank, half a turn, R 0.01, final 100, rest"].build()
    stopped = relax(given.system, given.cost, initial=(given.x, given.u), callback=lambda stage: stage.stage == 2)
    assert stopped.status is StartStatus.STOPPED_BY_CALLBACK
    assert len(stopped.stages) == 2


def arm(lengths):
    """Return motions of an arm on a string of which the length is a guess."""

    def wanted(t):
        return {"joint0": 0.6 + 0.3 * np.sin(3.0 * t), "joint1": 0.5 + 0.3 * np.sin(4.0 * t)}

    start = {"joint0": 0.6, "joint1": 0.5, "string1": lengths}
    return posed(puppet_arm(2), start, wanted, N=100, dt=0.01, Q=10.0, final=10.0, R=1e-2, kind="rest")


def test_strings_are_found_by_their_tensions(capsys):
    """Nothing has to be known of their lengths, with which the motion cannot even be begun."""
    given = arm(2.0)
    system, m = given.system, given.system.integrator.mechanism
    with pytest.raises(ArgumentError, match="cannot satisfy the constraints"):
        optimize(system, given.cost, initial=(given.x, given.u))
    found = by_tensions(system, given.cost, initial=(given.x, given.u), least=0.0, callback=StageTable())
    assert found.status is StartStatus.COMPLETED
    assert found.result.status is Status.CONVERGED
    assert [stage.name for stage in found.stages] == ["by tensions", "by lengths"]
    assert [stage.status for stage in found.stages] == ["CONVERGED", "CONVERGED"]
    assert "by lengths" in capsys.readouterr().out
    assert is_trajectory(system, found.x, found.u)
    assert np.abs([m.constraint_values(q) for q in found.x[:, : m.nq]]).max() < 1e-9
    # The length is that of the string, which is as long as from its hook to what it holds.
    ends = np.asarray(m.positions(found.x[:, : m.nq], ["end1", "hook1"]))
    np.testing.assert_allclose(found.x[:, 2], np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), rtol=1e-9)


def test_by_tensions_before_it_is_by_lengths():
    given = arm(2.0)
    stopped = by_tensions(given.system, given.cost, initial=(given.x, given.u), least=0.5, callback=lambda stage: True)
    assert stopped.status is StartStatus.STOPPED_BY_CALLBACK
    m = given.system.integrator.mechanism
    assert stopped.u.shape == (100, 1)
    assert stopped.u.min() >= 0.5 * (1.0 - 1e-6)
    assert stopped.x.shape == (101, 2 * m.nd)


ARM = [rx("a"), [tz(-0.4, mass=0.2), tz(-0.4, name="elbow"), [rx("b"), [tz(-0.4, mass=0.2, name="hand")]]]]


def test_others_take_the_place_of_elements():
    hook = tz(1.0, name="hook")
    m = Mechanism(
        [hook, ARM],
        [
            Gravity(),
            Distance("elbow", "hook", "L", name="one"),
            PathLength(("hand", "elbow", "hook"), "M", name="two"),
        ],
    )
    assert isinstance(m.elements["one"].as_spring(2.0), LinearSpring)
    assert isinstance(m.elements["two"].as_spring(2.0), ElasticString)
    assert isinstance(PointToPoint("hand", "hook").as_spring(2.0), LinearSpring)
    assert isinstance(m.elements["two"].as_force("T"), TendonForce)
    assert PointToPoint("hand", "hook").as_force("T") is None
    soft = m.with_exchanged({"one": [m.elements["one"].as_spring(50.0)]})
    assert soft.variables == m.variables
    assert soft.constraints == ("two",)
    assert soft.parameters["one.stiffness"] == 50.0
    pulled = m.with_exchanged({name: [m.elements[name].as_force(f"T {name}")] for name in ("one", "two")})
    assert pulled.variables == ("a", "b")
    assert pulled.inputs == ("T one", "T two")
    assert m.with_exchanged({"one": []}).kinematic == ("M",)
    # The generalised force of a tension is what the constraint's gradient says of it.
    q = np.array([0.3, 0.4])
    lengths = {"L": 0.0, "M": 0.0}
    h = m.constraint_jacobian(m.configuration({"a": 0.3, "b": 0.4, **lengths}))[:, :2]
    force = pulled.core.force(q, np.zeros(2), np.array([3.0, 0.0]))
    points = np.asarray(pulled.positions(q, ["elbow", "hook"])).reshape(2, 3)
    distance = np.linalg.norm(points[1] - points[0])
    np.testing.assert_allclose(force, -3.0 * h[0] / (2.0 * distance), atol=1e-12)
    with pytest.raises(ArgumentError, match="unknown element 'three'"):
        m.with_exchanged({"three": []})
    with pytest.raises(DescriptionError, match="two"):
        m.with_exchanged({"one": [m.elements["two"]]})


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"stiffness": (1e5, 10.0)}, "got 100000 first and 10 last, expected springs that get stiffer"),
        ({"stiffness": 1e5}, "expected the first and the last one"),
        ({"system": CartPendulum(20, 0.02)}, "system: got CartPendulum, expected a MidpointSystem"),
        ({"cost": 3}, "cost: got int"),
        ({"constraints": ["nothing"]}, "constraints: unknown constraint 'nothing'"),
        ({"stiffness": (0.0, 1.0)}, "stiffness"),
        ({"horizon": (0.0, 1.0)}, "horizon"),
    ],
)
def test_relax_names_what_is_wrong(changed, match):
    given = BY_NAME["slider-crank, half a turn, R 0.01, final 100, rest"].build()
    how = {"system": given.system, "cost": given.cost, "initial": (given.x, given.u), **changed}
    with pytest.raises(ArgumentError, match=match):
        relax(**how)


def test_by_tensions_names_what_is_wrong():
    given = BY_NAME["slider-crank, half a turn, R 0.01, final 100, rest"].build()
    with pytest.raises(ArgumentError, match="is no string whose length is a variable of its own"):
        by_tensions(given.system, given.cost, initial=(given.x, given.u))
    free = MidpointSystem(MidpointVI(Mechanism(ARM, [Gravity()])), 0.1 * np.arange(4))
    cost = QuadraticCost(
        np.zeros((4, 4)), np.zeros((3, 0)) if free.nu == 0 else np.zeros((3, free.nu)), Q=np.ones(4), R=[]
    )
    for search, what in ((by_tensions, "without strings"), (relax, "without constraints")):
        with pytest.raises(ArgumentError, match=what):
            search(free, cost, initial=(np.zeros(4), np.zeros((3, 0))))
    with pytest.raises(ArgumentError, match="multipliers"):
        relax(
            MidpointSystem(given.system.integrator, given.system.t, multipliers=True), given.cost,
            initial=(given.x, given.u),
        )  # fmt: skip


@pytest.mark.parametrize("search", [by_tensions, relax, embed])
@pytest.mark.parametrize(
    ("limit", "what"),
    [
        (Bound("*", min=0.0, of="tension"), "multipliers are no part of this system's state"),
        (Bound("elbows", max=1.0), "unknown name 'elbows'"),
        (Bound("*", min=np.zeros(7), of="variable"), "got shape"),
    ],
)
def test_limits_that_the_last_stage_does_not_have_are_named_before_the_first(search, limit, what):
    given, stages = arm(2.0), []
    with pytest.raises(ArgumentError, match=what):
        search(given.system, given.cost, initial=(given.x, given.u), limits=[limit], callback=stages.append)
    assert not stages


def test_a_constraint_without_a_spring_is_named():
    """And is none of those that are relaxed if none is named."""
    m = bricard()
    system = MidpointSystem(MidpointVI(m), 0.01 * np.arange(4))
    cost = QuadraticCost(np.zeros((4, system.nx)), np.zeros((3, system.nu)), Q=np.ones(system.nx), R=np.ones(system.nu))
    start = np.zeros(system.nx), np.zeros((3, system.nu))
    with pytest.raises(ArgumentError, match="no spring can take the place of HingeLoop 'hinge'"):
        relax(system, cost, initial=start, constraints=["hinge"])
    with pytest.raises(ArgumentError, match="no spring can take the place of any of them"):
        relax(system, cost, initial=start)


@pytest.mark.parametrize("shape", ["matrix", "of stages", "matrices of stages"])
def test_strings_are_found_with_weights_of_any_shape(shape):
    given = arm(2.0)
    cost, N = given.cost, given.system.N
    Q, R = cost.Q, cost.R
    alone = by_tensions(given.system, cost, initial=(given.x, given.u), least=0.0)
    if shape == "of stages":
        Q, R = np.tile(Q, (N, 1)), np.tile(R, (N, 1))
    else:
        Q, R = np.diag(Q), np.diag(R)
    if shape == "matrices of stages":
        Q, R = np.tile(Q, (N, 1, 1)), np.tile(R, (N, 1, 1))
    cost = QuadraticCost(cost.x_wanted, cost.u_wanted, Q=Q, R=R, Q_final=cost.Q_final)
    found = by_tensions(given.system, cost, initial=(given.x, given.u), least=0.0)
    assert found.cost == pytest.approx(alone.cost, rel=1e-9)


def test_strings_that_were_tensions_come_back_with_lengths_that_are_positive():
    """The equation of a string is that of the square of its length, so that the mirrored length solves it too."""
    m = marionette()
    vi = MidpointVI(m)
    q, t = rest_pose(m), np.linspace(0.0, 0.05, 6)
    x, u = vi.start(q).x, np.tile(q[m.nd :], (5, 1))
    wanted = np.tile(np.r_[q, np.zeros(m.nx - m.nq)], (6, 1))
    Q = np.full(m.nx, 0.01)
    Q[: m.nd] = 100.0
    cost = QuadraticCost(wanted, u, Q=Q, R=np.full(m.nrho, 0.01))
    found = by_tensions(MidpointSystem(vi, t), cost, initial=(x, u), price=1e-6)
    assert found.status is StartStatus.COMPLETED
    lengths = [m.variables.index(string.length) for string in STRINGS]
    np.testing.assert_allclose(found.x[0, lengths], q[lengths], rtol=1e-9)
