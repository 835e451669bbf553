"""A motion that stays in its plane goes on past steps in which it would buckle out of it, as in the plane alone."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    pose,
    project_configuration,
    rx,
    ry,
    rz,
    tx,
    tz,
)


def cable(rods: int, *, space: bool) -> Mechanism:
    """A cable between two poles, whose joints turn sideways too where it is in space."""
    piece, rest = 3.0 / rods, []
    inertia = 0.2 * piece**3 / 12
    rod = {"mass": 0.2 * piece, "com": (piece / 2, 0, 0), "inertia": (inertia / 5, inertia, inertia)}
    for i in reversed(range(rods)):
        end = [tx(piece, name=f"n{i}"), *([rest] if rest else [])]
        rest = [ry(f"p{i}"), [rz(f"y{i}", **rod), end]] if space else [ry(f"p{i}", **rod), end]
    hold = PointToPoint(f"n{rods - 1}", "pole", axes="xyz" if space else "xz", name="end")
    return Mechanism([*rest, pose(translation=(2.0, 0, 0), name="pole")], [Gravity(), hold])


@pytest.mark.parametrize("rods", [100, 200])
def test_a_cable_in_space_falls_as_in_its_plane(rods: int) -> None:
    runs = []
    for space in (False, True):
        m = cable(rods, space=space)
        q = np.zeros(m.nq)
        q[m.variables.index("p0")] = np.arccos(2 / 3)
        q[m.variables.index(f"p{rods // 2}")] = -2 * np.arccos(2 / 3)
        vi = MidpointVI(m)
        runs.append(vi.simulate(vi.start(project_configuration(m, q).q), np.linspace(0, 0.05, 51)))
    plane, in_space = runs
    assert in_space.status.name == "COMPLETED", in_space.message
    # The cable goes slack, so that it would buckle sideways within a step.
    assert in_space.worst_step.s != plane.worst_step.s
    for i in range(0, rods, rods // 10):
        assert in_space[f"p{i}"] == pytest.approx(plane[f"p{i}"], abs=1e-7)
        assert in_space[f"y{i}"] == pytest.approx(np.zeros(51), abs=1e-7)


def hanging(rods: int, *, balls: bool) -> Mechanism:
    """A chain that hangs from a fixed point, of balls or of hinges."""
    piece, rest = 2.5 / rods, []
    inertia = 0.1 * piece**3 / 12
    rod = {"mass": 0.1 * piece, "com": (0, 0, -piece / 2), "inertia": (inertia, inertia, inertia / 5)}
    for i in reversed(range(rods)):
        joint = ball(f"b{i}", **rod) if balls else rx(f"b{i}", **rod)
        rest = [joint, [tz(-piece, name=f"n{i}"), *([rest] if rest else [])]]
    return Mechanism(rest, [Gravity()])


@pytest.mark.parametrize(("rods", "dt", "steps"), [(120, 5e-4, 40), (120, 1e-3, 130), (300, 5e-3, 10)])
def test_a_long_chain_of_balls_swings_as_one_of_hinges(rods: int, dt: float, steps: int) -> None:
    """The determinant changes its sign in a step of a millisecond; that of 300 balls is beyond what numbers hold."""
    runs = []
    for balls, start in ((True, {"b0.qw": np.cos(0.2), "b0.qx": np.sin(0.2)}), (False, {"b0": 0.4})):
        m = hanging(rods, balls=balls)
        vi = MidpointVI(m)
        runs.append(vi.simulate(vi.start(m.configuration(start)), dt * np.arange(steps + 1)))
        assert runs[-1].status.name == "COMPLETED", runs[-1].message
    tips = [run.mechanism.positions(run.q, (f"n{rods - 1}",)) for run in runs]
    assert tips[0] == pytest.approx(tips[1], abs=1e-10)
    energies = runs[0].energy()
    assert np.ptp(energies.total) < 1e-4 * np.max(energies.kinetic)
