"""Constraints that say the same twice: the motion does not mind, and the run says so."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import (
    Distance,
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    rz,
    tx,
)
from leastaction.models.bricard import bricard
from leastaction.models.four_bars import at_angle, four_bars
from physics.laws import G, mass_on_string, swing, times


def run_bricard(end: float, steps: int) -> Trajectory:
    m = bricard()
    return swing(m, np.zeros(m.nq), np.zeros(m.nq), times(end, steps))


def test_a_run_names_the_equations_that_were_redundant() -> None:
    run = run_bricard(1.0, 200)
    assert run.rank_deficient
    assert list(run.redundant) == ["hinge.tilt2"]
    assert set(run.redundant["hinge.tilt2"]) <= {"hinge.x", "hinge.y", "hinge.z", "hinge.tilt1"}
    said = str(run)
    assert "200 steps" in said
    assert "redundant: hinge.tilt2 follows from hinge." in said
    assert "least norm" in said
    double = swing(mass_on_string(length=1.0, copies=2), [0.6, -0.8], [0.8, 0.6], times(0.5, 50))
    assert double.redundant == {"string1": ("string0",)}


def test_a_run_with_nothing_to_spare_says_nothing_of_it() -> None:
    run = swing(mass_on_string(length=1.0), [0.6, -0.8], [0.8, 0.6], times(0.5, 50))
    assert not run.rank_deficient
    assert run.redundant == {}
    assert "redundant" not in str(run)


def test_an_instant_in_a_singular_configuration_is_told_from_redundant_equations() -> None:
    m = four_bars(2)
    q, v = at_angle(m, 0.0, -4.0)
    assert set(m.redundancy(q)) == {"loop0.x", "loop1.x"}
    # A thousandth of a second: coming from there takes a small step, as no force acts along the cranks.
    run = swing(m, q, v, times(0.1, 100))
    assert run.rank_deficient
    assert run.redundant == {}
    assert "singular configuration" in str(run)


@pytest.mark.parametrize("steps", [200, 2000])
def test_the_multiplier_is_the_one_of_least_norm_at_every_step(steps: int) -> None:
    """Whatever the length of the run: what a guess has along the redundant combination must not stay in it."""
    run = run_bricard(10.0, steps)
    m = run.mechanism
    for k in range(1, steps, steps // 20):
        nothing = np.linalg.svd(m.constraint_jacobian(run.q[k]))[0][:, -1]
        assert abs(nothing @ run.lam[k]) < 1e-8 * np.linalg.norm(run.lam[k])
    exact = MidpointVI(m).linearize(run).lam
    assert np.abs(run.lam - exact).max() < 1e-6 * np.abs(exact).max()


def test_a_closed_chain_with_a_bar_to_spare_moves_as_without_it() -> None:
    """A parallelogram with a second coupler beside the first, of which either would do."""

    def parallel(couplers: int) -> Mechanism:
        bar = {"mass": 1.0, "com": (0.5, 0.0, 0.0), "inertia": (0.0, 1 / 12, 1 / 12)}
        first = [rz("a", **bar), [tx(1.0, name="A"), tx(0.5, name="A2")]]
        second = [tx(2.0), [rz("b", **bar), [tx(1.0, name="B"), tx(0.5, name="B2")]]]
        bars = [Distance("A", "B", 2.0, name="bar"), Distance("A2", "B2", 2.0, name="spare")]
        return Mechanism([*first, *second], [Gravity((0, -G, 0)), *bars[:couplers]])

    # From upright through the horizontal, where all bars are in line and all constraints lose their gradient.
    q, v, t = [1.0, 1.0], [0.5, 0.5], times(2.0, 400)
    one, two = swing(parallel(1), q, v, t), swing(parallel(2), q, v, t)
    assert two.redundant == {"spare": ("bar",)}
    assert np.abs(one.q - two.q).max() < 1e-9


def test_a_loop_in_the_plane_closed_in_space_runs() -> None:
    """A four-bar closed along all three axes: the one across its plane has no gradient."""
    bar = {"mass": 1.0, "com": (0.5, 0.0, 0.0), "inertia": (0.0, 1 / 12, 1 / 12)}

    def four(axes: str) -> Mechanism:
        chain = [rz("a", **bar), [tx(1.0), [rz("b", **bar), [tx(1.0, name="C")]]]]
        crank = [tx(1.0), [rz("c", **bar), [tx(1.0, name="D")]]]
        return Mechanism([*chain, *crank], [Gravity((0, -G, 0)), PointToPoint("C", "D", axes, name="loop")])

    q, t = [1.2, -1.2, 1.2], times(1.0, 200)
    plane, space = (swing(four(axes), q, np.zeros(3), t) for axes in ("xy", "xyz"))
    assert space.redundant == {"loop.z": ()}
    assert "loop.z has no gradient" in str(space)
    assert np.abs(plane.q - space.q).max() < 1e-10
    assert np.abs(space["loop.z"]).max() < 1e-12
