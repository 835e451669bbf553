"""Up is against gravity, and plane mechanisms are seen from their side."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Gravity, Mechanism, ball, rx, ry, rz, screw, show, tx, ty, tz
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.four_bars import four_bars
from leastaction.models.marionette import marionette
from leastaction.viz.viewer.sides import plane_normal, side, upright, upward

BOB = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}


def normal(m: Mechanism) -> np.ndarray | None:
    return plane_normal(m, np.full(m.nq, 0.3))


@pytest.mark.parametrize("g", [(0, 0, -9.81), (0, -9.81, 0), (3.0, 0, 0), (1.0, -2.0, 0.5)])
def test_up_is_against_gravity(g: tuple[float, float, float]) -> None:
    m = Mechanism([ball("b", axes="xyz", **BOB)], [Gravity(g)])
    up = upward(m, None, None)
    np.testing.assert_allclose(up, -np.array(g) / np.linalg.norm(g))
    turn = upright(up)
    np.testing.assert_allclose(turn @ up, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    (scene,) = show(m).scenes
    np.testing.assert_allclose(scene.poses[m.frames[-1]][0, :3, :3], turn, atol=1e-12)


def test_up_without_gravity_and_as_asked_for() -> None:
    m = Mechanism([rz("a"), [tx(1.0, **BOB)]])
    np.testing.assert_array_equal(upward(m, None, None), [0, 0, 1])
    np.testing.assert_array_equal(upward(m, None, normal(m)), [0, 1, 0])
    np.testing.assert_array_equal(upward(m, "-x", None), [-1, 0, 0])
    np.testing.assert_allclose(upward(m, (0, 3, 4), None), [0, 0.6, 0.8])
    with pytest.raises(ArgumentError, match=r"up: got 'w', expected one of -x, -y"):
        show(m, up="w")
    with pytest.raises(ArgumentError, match="up: got three zeros"):
        show(m, up=(0, 0, 0))


@pytest.mark.parametrize(
    ("m", "expected"),
    [
        (four_bars(2), [0, 0, 1]),
        (cart_pendulum(), [0, 0, 1]),
        (Mechanism([tx("x", **BOB), [tz("z", **BOB), [ry("a", **BOB)]]]), [0, 1, 0]),
        (Mechanism([tx("x", **BOB), [ty("y", **BOB)]]), [0, 0, 1]),
        (Mechanism([rx(0.7), [rz("a"), [tx(1.0), [rz("b", **BOB)]]]]), [0, -np.sin(0.7), np.cos(0.7)]),
        (Mechanism([tx("x", **BOB)]), None),
        (Mechanism([rz("a", **BOB), [rx("b", **BOB)]]), None),
        (Mechanism([rz("a", **BOB), [tz("b", **BOB)]]), None),
        (Mechanism([tx("x", **BOB), [ty("y", **BOB), [tz("z", **BOB)]]]), None),
        (Mechanism([screw("s", axis="z", pitch=0.1, **BOB)]), None),
        (marionette(), None),
    ],
)
def test_the_plane_in_which_everything_moves(m: Mechanism, expected: list[float] | None) -> None:
    found = normal(m)
    if expected is None:
        assert found is None
    else:
        assert found is not None
        assert abs(found @ expected) == pytest.approx(1.0)


def test_a_plane_is_seen_from_its_side() -> None:
    (scene,) = show(four_bars(1)).scenes  # gravity is along -y, the plane is that of x and y
    eye = np.array([np.cos(np.radians(scene.azimuth)), np.sin(np.radians(scene.azimuth)), 0.0])
    right = np.cross([0.0, 0.0, 1.0], eye)
    m = four_bars(1)
    q = np.array([0.4, 0.1, 0.2])[: m.nq]
    (scene,) = show(m, q=q).scenes
    x, y = m.positions(q, ["B0"])[0, :2]
    place = scene.points["B0"][0]
    assert place @ right == pytest.approx(x)  # x points to the right, y up, and nothing towards the eye
    assert place[2] == pytest.approx(y)
    assert place @ eye == pytest.approx(0.0, abs=1e-12)
    assert scene.elevation < 10.0
    assert side(None, np.eye(3)) is None
    found = side(np.array([0.0, 0.0, 1.0]), np.eye(3))
    assert found is not None
    assert found[1] > 60.0  # what lies on the floor is seen from above
