"""Plans for strings that do not stretch, as machines make them whose strings do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from leastaction import (
    Distance,
    ElasticString,
    Gravity,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    Status,
    check_derivatives,
    play,
    project_configuration,
    tx,
    tz,
)
from leastaction.control.rigs import elastic
from leastaction.control.rigs.commands import reeled_in, with_lengths
from leastaction.control.rigs.elastic import nearest
from leastaction.control.rigs.pushing import Pushing, PushingCost
from leastaction.control.rigs.strings import Strings, as_springs
from leastaction.errors import ProjectionError
from leastaction.numerics.arrays import Array
from optimal.systems import rolled_out, strung_rig

N = 60
T = 0.02 * np.arange(N + 1)
LENGTHS = {"left": 0.5, "right": 0.4}
Q, R = np.array([100.0, 100.0, 0.1, 0.0, 0.0, 1.0]), np.ones(1)
RIG = strung_rig(200.0, 1e-5)
OWN = ElasticString(("ball", "hook"), 200.0, 0.5, smoothing=1e-5, name="string")
DROP = 0.5  # m/s^2, with which balls are planned to press on their strings at the least


@pytest.fixture(scope="module")
def plan() -> tuple[MidpointSystem, Array, Array]:
    """Two balls of 1 and 0.2 kg on strings of fixed lengths below one lift, which goes up and all but falls."""
    balls = [
        item
        for s, (x, mass) in {"left": (-0.3, 1.0), "right": (0.3, 0.2)}.items()
        for item in (tx(x), [tz(s, mass=mass, name=f"{s} ball")])
    ]
    lift = [tz("height", kinematic=True), [tx(-0.3, name="left end"), tx(0.3, name="right end")]]
    strings = [Distance(f"{s} ball", f"{s} end", length, name=f"{s} string") for s, length in LENGTHS.items()]
    m = Mechanism([*balls, *lift], [Gravity(), *strings])
    system = MidpointSystem(MidpointVI(m), T, multipliers=True)
    fastest = (9.81 - DROP) / (2.0 * np.pi / 0.6) ** 2
    height = fastest * (1.0 - np.cos(2.0 * np.pi * T / 0.6))
    start = project_configuration(m, m.configuration({s: -length for s, length in LENGTHS.items()}), hold=["height"]).q
    done = rolled_out(system, np.r_[system.integrator.start(start).x, 0.0, 0.0], height[1:, None])
    return system, done.x, done.u


def as_elastic(plan: tuple[MidpointSystem, Array, Array]) -> tuple[MidpointSystem, Array, Array, dict[str, float]]:
    """Return the model with elastic strings, the plan on strings reeled in, and their least stretches."""
    system, x, u = plan
    x, u, shorter, least = reeled_in(system, x, u, RIG)
    model = with_lengths(RIG.model(system.mechanism), shorter)
    return MidpointSystem(system.integrator.like(model), T), x, u, dict(least)


def test_a_machine_makes_what_is_nearest_to_a_plan(plan: tuple[MidpointSystem, Array, Array]) -> None:
    """By roll-outs of springs, and a cost that is written out: it is least in all directions of the inputs."""
    model, x, u, least = as_elastic(plan)
    assert min(least.values()) > 0.0
    found_x, found_u = nearest(model, x, u, Q=Q, R=R, least=least)
    springs = MidpointSystem(model.integrator.like(as_springs(model.mechanism)), T)
    strings = Strings(model.mechanism)
    short = np.array([least[name] for name in strings.names])

    def slack(states: Array) -> Array:
        return np.minimum(strings.stretches(np.ascontiguousarray(states[:, :3])) - short, 0.0)

    def cost(inputs: Array) -> float:
        states = rolled_out(springs, x[0], inputs).x
        away = 0.5 * np.sum(Q * (states - x) ** 2) + 0.5 * np.sum(R * (inputs - u) ** 2)
        return float(away + 0.5 * elastic._PUSHING * 200.0 * np.sum(slack(states) ** 2))

    np.testing.assert_allclose(rolled_out(springs, x[0], found_u).x, found_x, atol=1e-9)
    assert slack(found_x).any()  # the price of that counts
    best, chance = cost(found_u), np.random.default_rng(0)
    # What is planned is far from that: on such strings the balls bob, and push on them.
    assert best < 0.5 * cost(u)
    assert slack(found_x).min() > 0.3 * slack(rolled_out(springs, x[0], u).x).min()
    for _ in range(10):
        way = chance.standard_normal(u.shape)
        assert min(cost(found_u + 1e-3 * way), cost(found_u - 1e-3 * way)) > best
        slopes = [(cost(at + 1e-6 * way) - cost(at - 1e-6 * way)) / 2e-6 for at in (found_u, found_u + 1e-2 * way)]
        assert abs(slopes[0]) < 0.02 * abs(slopes[1])


def test_a_plan_that_has_no_such_motion_is_kept(
    plan: tuple[MidpointSystem, Array, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, x, u, least = as_elastic(plan)

    def fails(*_: object, **__: object) -> None:
        raise ProjectionError("none")

    monkeypatch.setattr(elastic, "optimized", fails)
    found_x, found_u = nearest(model, x, u, Q=Q, R=R, least=least)
    np.testing.assert_array_equal(found_x, x)
    np.testing.assert_array_equal(found_u, u)


def test_ctrl_c_ends_what_is_played(plan: tuple[MidpointSystem, Array, Array], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elastic, "optimized", lambda *_, **__: SimpleNamespace(status=Status.INTERRUPTED))
    with pytest.raises(KeyboardInterrupt):
        play(plan[0], plan[1:], RIG)


def test_strings_may_be_as_slack_as_they_are_planned() -> None:
    """A ball on an elastic string of its own that is taut, all but slack, and slack by 0.1 and 0.25 m."""
    m = Mechanism([tz("z", mass=0.5, name="ball"), tz("hook", kinematic=True, name="hook")], [Gravity(), OWN])
    q = np.array([[-0.52, 0.0], [-0.5, 0.0], [-0.4, 0.0], [-0.2, 0.05]])
    strings = Strings(m)
    pushing = Pushing(strings, strings.room_along(q), 500.0)
    assert not pushing.slack(q, 0).any()
    # What is higher by a centimetre is shorter by as much than where it may be; a taut one has as much to lose.
    up = np.array([1.0, 0.0])
    np.testing.assert_allclose(pushing.slack(q + 0.01 * up, 0)[:, 0], [0.0, -0.01, -0.01, -0.01], atol=1e-5)
    np.testing.assert_allclose(pushing.slack(q[2:] + 0.03 * up, 2)[:, 0], [-0.03, -0.03], atol=1e-5)


def test_the_price_of_springs_that_push_is_differentiated() -> None:
    """Strings along the vertical, whose stretches are linear, so that Gauss and Newton's derivatives are exact."""
    m = Mechanism([tz("z", mass=0.5, name="ball"), tz("hook", kinematic=True, name="hook")], [Gravity(), OWN])
    system = MidpointSystem(MidpointVI(as_springs(m)), T[:6])
    chance = np.random.default_rng(1)
    x, u = 0.1 * chance.standard_normal((6, 4)), 0.1 * chance.standard_normal((5, 1))
    x[:, 0] -= 0.4
    strings = Strings(m)
    pushing = Pushing(strings, np.full((6, 1), 0.05), 3.0)
    slack = pushing.slack(np.ascontiguousarray(x[:, :2]), 0)
    assert 0 < np.count_nonzero(slack) < 6
    cost = PushingCost(QuadraticCost(0.0 * x, 0.0 * u, Q=np.ones(4), R=np.ones(1)), system, pushing)
    report = check_derivatives(system, x, u, cost=cost)
    assert report.ok
    stages = 0.5 * np.sum(x[:-1] ** 2, axis=1) + 0.5 * np.sum(u**2, axis=1) + 0.5 * 600.0 * slack[:-1, 0] ** 2
    np.testing.assert_allclose(cost.stage_values(x[:-1], u, 0), stages, rtol=1e-12)
