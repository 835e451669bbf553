"""Loops that are closed in the wrong way first: other assembly modes are tried, or spoken of."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from leastaction import MidpointSystem, MidpointVI, QuadraticCost, StartStatus, Status, relax
from leastaction.optimal import Bound

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness_further import four_bar
from benchmarks.robustness_problems import slider_crank

N, DT = 50, 0.02
LOOP = "point_to_point(tip, end)"


def four_bar_at(a, side):
    """Return angles (..., 3) of the linkage at angles of its crank: where two circles meet, on either side."""
    crank = 0.3 * np.stack([np.sin(a), -np.cos(a)], axis=-1)
    across = np.array([0.8, 0.0]) - crank
    d = np.linalg.norm(across, axis=-1)
    along = (d**2 + 0.9**2 - 0.7**2) / (2.0 * d)
    height = side * np.sqrt(0.9**2 - along**2)
    e = across / d[..., None]
    tip = crank + along[..., None] * e + height[..., None] * np.stack([-e[..., 1], e[..., 0]], axis=-1)
    rod, rocker = tip - crank, tip - np.array([0.8, 0.0])
    c = np.unwrap(np.arctan2(rocker[..., 0], -rocker[..., 1]))
    return np.stack([a, np.unwrap(np.arctan2(rod[..., 0], -rod[..., 1]) - a), c], axis=-1)


def slider_crank_at(a, side):
    """Return angles and the piston's place at angles of the crank: the rod points down or up."""
    b = np.arcsin(-0.3 * np.sin(a) / 0.8)  # of the rod against the rail
    rod = b - a if side < 0 else np.pi - b - a
    return np.stack([a, rod, -0.3 * np.cos(a) - 0.8 * np.cos(a + rod)], axis=-1)


def asked(m, q):
    """Return a system that is to move through configurations (N+1, nq), and the cost of missing them."""
    wanted = np.zeros((N + 1, m.nx))
    wanted[:, : m.nq] = q
    Q = np.r_[np.full(m.nq, 10.0), np.full(m.nd, 1e-3)]
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=Q, R=[1e-3], Q_final=10.0 * Q)
    return MidpointSystem(MidpointVI(m, threads=1), DT * np.arange(N + 1)), cost


def begun(m, q):
    x = np.zeros(m.nx)
    x[: m.nq] = q
    return x, np.zeros((N, 1))


CRANK = 0.5 + 0.8 * np.sin(2.0 * DT * np.arange(N + 1))
CASES = [(four_bar, four_bar_at, LOOP), (slider_crank, slider_crank_at, "point_to_point(pin, piston)")]


@pytest.mark.parametrize(("make", "at", "name"), CASES)
@pytest.mark.parametrize("side", [-1, 1])
def test_a_loop_that_is_closed_on_the_wrong_side_is_closed_on_the_other(make, at, name, side):
    """A guess that is nearer to the wrong mode, from which no motion leads to the wanted one."""
    m = make()
    right, wrong = at(CRANK, side), at(CRANK[:1], -side)[0]
    assert np.abs([m.constraint_values(q) for q in [*right, wrong]]).max() < 1e-12  # the closed form is that of m
    system, cost = asked(m, right)
    seen = []
    start = 0.9 * wrong + 0.1 * right[0] + [0.0, 0.05, 0.05]
    found = relax(system, cost, initial=begun(m, start), callback=seen.append)
    assert found.status is StartStatus.COMPLETED
    assert found.result.status is Status.CONVERGED
    assert np.abs(found.x[:, : m.nq] - right).max() < 0.2
    assert seen[-1].name == "assembly mode 1"
    assert [stage.stage for stage in seen] == list(range(1, len(found.stages) + 1))
    assert found.cost < 1.0 < 1e-3 * max(stage.cost for stage in seen)
    assert f"As closed first '{name}' did not follow; this begins with" in found.message


def test_the_nearest_way_is_kept_where_it_follows():
    m = four_bar()
    right = four_bar_at(CRANK, 1)
    system, cost = asked(m, right)
    found = relax(system, cost, initial=begun(m, right[0] + [0.0, 0.1, 0.1]))
    assert found.stages[-1].name == "with its constraints"
    assert found.message == StartStatus.COMPLETED.value


def test_a_way_that_was_given_is_kept_and_the_better_one_named():
    """The state that the message names is the one of the closed form; a search that begins there needs no other."""
    m = four_bar()
    right, wrong = four_bar_at(CRANK, -1), four_bar_at(CRANK[:1], 1)[0]
    system, cost = asked(m, right)
    found = relax(system, cost, initial=begun(m, wrong))
    np.testing.assert_allclose(found.x[0, : m.nq], wrong, atol=1e-12)
    assert found.cost > 1e3
    place = ", ".join(f"{name} = {value:.6g}" for name, value in zip(m.variables, right[0], strict=True))
    assert f"decides how '{LOOP}' is closed. There is another way" in found.message
    assert f"begin with {place}." in found.message
    better = relax(system, cost, initial=begun(m, right[0]))
    assert better.cost < 1.0
    assert better.message == StartStatus.COMPLETED.value


def test_where_no_way_follows_the_message_says_so():
    """A rocker is to be where no crank brings it."""
    m = four_bar()
    system, cost = asked(m, four_bar_at(CRANK, 1))
    found = relax(
        system, cost, initial=begun(m, four_bar_at(CRANK[:1], -1)[0] + [0.0, 0.05, 0.05]),
        limits=[Bound("c", min=10.0, at=range(1, N + 1))], stage_iterations=10, max_iterations=30,
    )  # fmt: skip
    assert found.result.status is Status.INFEASIBLE
    assert f"No way to close '{LOOP}' was found that follows better (tried: a = " in found.message
    assert [stage.accepted for stage in found.stages if stage.name.startswith("assembly mode")] == [False]


def test_the_search_among_ways_can_be_stopped():
    m = four_bar()
    system, cost = asked(m, four_bar_at(CRANK, -1))
    start = begun(m, four_bar_at(CRANK[:1], 1)[0] + [0.0, 0.05, 0.05])
    found = relax(system, cost, initial=start, callback=lambda stage: stage.name == "assembly mode 1")
    assert found.status is StartStatus.STOPPED_BY_CALLBACK
    assert found.cost < 1.0
