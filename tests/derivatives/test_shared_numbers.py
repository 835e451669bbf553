"""One number that several elements, bodies or frames share: changed at once, differentiated by as one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from derivatives.differences import extrapolated
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import (
    Gravity,
    JointSpring,
    LinearDamper,
    LinearSpring,
    Mechanism,
    MidpointVI,
    momentum_by,
    rx,
    ry,
    tx,
    tz,
)
from leastaction.optimal import Parameter, QuadraticCost, check_derivatives, optimize
from leastaction.optimal.unknowns.system import ExtendedSystem
from leastaction.systems import MidpointSystem

SHARED = {
    "k": ["left.stiffness", "right.stiffness", "turn.stiffness"],
    "c": ["left damper.coefficient", "right damper.coefficient"],
    "link": ["upper.value", "lower.value"],
    "m": ["upper.mass", "lower.mass"],
}
NAMES = [*SHARED, "turn.rest"]


def double_pendulum(shared: dict[str, list[str]] | None) -> Mechanism:
    return Mechanism(
        [
            tx(0.5, name="post"),
            rx("a"), [tz(-0.7, mass=0.4, name="upper"), [ry("b"), [rx("c"), [tz(-0.7, mass=0.4, name="lower")]]]],
        ],
        [
            Gravity(),
            LinearSpring("post", "upper", 3.0, name="left"),
            LinearSpring("post", "lower", 3.0, name="right"),
            JointSpring("a", 3.0, 0.1, name="turn"),
            JointSpring("b", 5.0, name="hold"),
            LinearDamper("post", "upper", 0.2, name="left damper"),
            LinearDamper("post", "lower", 0.2, name="right damper"),
        ],
        shared=shared,
    )  # fmt: skip


@pytest.fixture
def mechanism() -> Mechanism:
    return double_pendulum(SHARED)


Q, V = np.array([0.4, 0.3, -0.5]), np.array([1.0, -0.4, 0.6])


def test_it_stands_in_the_place_of_those_that_share_it(mechanism: Mechanism) -> None:
    own = double_pendulum(None)
    members = [name for group in SHARED.values() for name in group]
    assert set(mechanism.parameters) == set(own.parameters) - set(members) | set(SHARED)
    assert (mechanism.parameters["k"], mechanism.parameters["link"]) == (3.0, -0.7)
    assert mechanism.shared == {name: tuple(group) for name, group in SHARED.items()}
    changed = {"k": 4.5, "link": -0.9, "m": 0.7, "turn.rest": 0.0}
    each = {member: value for name, value in changed.items() for member in SHARED.get(name, [name])}
    first, second = mechanism.with_parameters(changed), own.with_parameters(each)
    assert {name: first.parameters[name] for name in changed} == changed
    np.testing.assert_array_equal(first.core.gradient(Q, V), second.core.gradient(Q, V))
    only = mechanism.with_parameters({"c": 0.3})  # numbers of elements alone
    assert (only.parameters["c"], only.shared) == (0.3, mechanism.shared)
    assert only.elements["right damper"].coefficient == 0.3


def test_derivatives_are_sums_and_those_of_changed_mechanisms(mechanism: Mechanism) -> None:
    own, t = double_pendulum(None), np.array([0.0, 0.02, 0.05, 0.07])
    vi = MidpointVI(mechanism, threads=1)
    run = vi.simulate(vi.start(Q, V), t)
    by = vi.differentiate_by(run, NAMES).x
    for column, name in enumerate(NAMES):
        members = SHARED.get(name, [name])
        summed = MidpointVI(own, threads=1).differentiate_by(run, members).x.sum(axis=2)
        np.testing.assert_allclose(by[:, :, column], summed, rtol=1e-13, atol=1e-15)

        def ends(by_value: float, name: str = name) -> np.ndarray:
            changed = MidpointVI(mechanism.with_parameters({name: mechanism.parameters[name] + by_value}), threads=1)
            steps = [changed.step(run.state(k), t[k + 1] - t[k]).state.x for k in range(3)]
            return np.array(steps)

        np.testing.assert_allclose(by[:, :, column], extrapolated(ends, 0.0, 1e-2), atol=1e-8 * (1 + np.abs(by).max()))
    columns = momentum_by(mechanism, Q, V, ["m", "link"])
    for column, name in enumerate(["m", "link"]):
        np.testing.assert_allclose(columns[:, column], momentum_by(own, Q, V, SHARED[name]).sum(axis=1), rtol=1e-13)


@pytest.mark.parametrize("names", [["k", "c"], ["link", "k"], ["m"]])
def test_second_derivatives(mechanism: Mechanism, names: list[str]) -> None:
    vi = MidpointVI(mechanism, threads=1)
    system = MidpointSystem(vi, [0.0, 0.02, 0.05, 0.07])
    run = vi.simulate(vi.start(Q, V), system.t)
    extended = ExtendedSystem(system, names, [], free_start=True)
    x = extended.extended(run.x, np.array([mechanism.parameters[name] for name in names]))
    report = check_derivatives(extended, x, np.zeros((3, 0)))
    assert report.ok, report


def test_a_shared_number_is_found_in_a_motion(mechanism: Mechanism) -> None:
    t = np.linspace(0.0, 1.0, 51)
    vi = MidpointVI(mechanism)
    seen = vi.simulate(vi.start(Q, V), t)
    guess = MidpointSystem(MidpointVI(mechanism.with_parameters({"k": 4.0})), t)
    cost = QuadraticCost(seen.x, np.zeros((50, 0)), Q=np.ones(6), R=np.zeros(0))
    found = optimize(guess, cost, initial=(seen.x[0], np.zeros((50, 0))), unknowns=[Parameter("k", 0.5, 10.0)])
    assert found.unknowns["k"] == pytest.approx(3.0, rel=1e-5)


def test_it_stays_in_files_and_with_changes(mechanism: Mechanism, tmp_path: Path) -> None:
    for ending in ("yaml", "json"):
        again = Mechanism.load(mechanism.save(tmp_path / f"shared.{ending}"))
        assert again == mechanism
        assert again.shared == mechanism.shared
    assert mechanism != double_pendulum(None)
    assert mechanism.with_elements([JointSpring("c", 1.0)]).shared == mechanism.shared
    assert mechanism.with_frames("lower", [tx(0.1, name="tip")]).shared == mechanism.shared
    fewer = mechanism.with_exchanged({"left": [], "left damper": [], "right damper": []}).shared
    assert fewer["k"] == ("right.stiffness", "turn.stiffness")
    assert "c" not in fewer


@pytest.mark.parametrize(
    ("shared", "message"),
    [
        (
            {"k": ["left.stiffness", "hold.stiffness"]},
            "'k' has one value, but 'left.stiffness' = 3, 'hold.stiffness' = 5",
        ),
        ({"k": ["left.stiffness", "left.stifness"]}, "'k'.*left.stifness.*left.stiffness"),
        ({"post.value": ["left.stiffness"]}, "'post.value' is a parameter of its own"),
        ({"k": ["left.stiffness"], "j": ["left.stiffness"]}, "listed under 'k' and under 'j'"),
        ({"k": ["left.stiffness", "left.stiffness"]}, "listed under 'k' and under 'k'"),
        ({"k": "left.stiffness"}, "'k'.*expected a list of parameters"),
        ({"k": []}, "'k'.*expected a list of parameters"),
        ({"k": [3]}, "'k'.*expected a list of parameters"),
        ({3: ["left.stiffness"]}, "got the name 3"),
        (["left.stiffness"], "shared: got .*expected names"),
    ],
)
def test_what_cannot_be_shared_is_named(shared: object, message: str) -> None:
    with pytest.raises(DescriptionError, match=f"(?s){message}"):
        double_pendulum(shared)


def test_those_that_share_it_have_no_value_of_their_own(mechanism: Mechanism) -> None:
    with pytest.raises(ArgumentError, match=r"'left\.stiffness' is shared with others as 'k'; name that"):
        mechanism.with_parameters({"left.stiffness": 1.0})
    vi = MidpointVI(mechanism)
    run = vi.simulate(vi.start(Q, V), [0.0, 0.01])
    with pytest.raises(ArgumentError, match=r"'lower\.mass' is shared with others as 'm'"):
        vi.differentiate_by(run, ["lower.mass"])
    with pytest.raises(ArgumentError, match="kk"):
        vi.differentiate_by(run, ["kk"])
