"""Samples lie close where things move fast and curved, and nowhere else."""

from __future__ import annotations

import numpy as np

from leastaction import Gravity, Mechanism, rz, show, simulate, tx, ty
from leastaction.viz import Bone, Scene
from leastaction.viz.viewer.sampling import needed, refined
from leastaction.viz.viewer.stage import staged


def test_lines_meet_the_tracks() -> None:
    t = np.linspace(0.0, 10.0, 4001)
    track = np.where(t < 8.0, 0.01 * t, np.sin(20.0 * (t - 8.0)))[:, None]
    keep = needed(t, track, np.array([1e-3]))
    assert keep[0] == 0
    assert keep[-1] == 4000
    off = np.abs(np.interp(t, t[keep], track[keep, 0]) - track[:, 0])
    assert off.max() <= 1e-3
    slow, fast = np.sum(t[keep] < 7.9), np.sum(t[keep] > 8.1)
    assert slow < 5
    assert fast > 150


def test_a_straight_motion_needs_two_samples() -> None:
    t = np.linspace(0.0, 2.0, 2001)
    path = np.column_stack((t, t, t))
    (stage,) = staged([Scene(t=t, points={"a": path}, bones=())])
    assert stage.samples().tolist() == [0, 2000]


def test_what_turns_is_sampled_by_how_far_it_goes() -> None:
    t = np.linspace(0.0, 1.0, 1001)
    counts = []
    for turns in (1.0, 4.0):
        angle = 2.0 * np.pi * turns * t
        path = np.column_stack((np.cos(angle), 0.0 * t, np.sin(angle)))
        still = np.zeros_like(path)
        scene = Scene(t=t, points={"o": still, "a": path}, bones=(Bone(start="o", end="a", radius=0.05),))
        (stage,) = staged([scene])
        counts.append(len(stage.samples()))
    assert 3.0 < counts[1] / counts[0] < 5.0


def test_a_long_motion_is_thinned_until_it_fits() -> None:
    t = np.linspace(0.0, 100.0, 10001)
    paths = {f"p{i}": np.column_stack((np.sin((3 + i) * t), np.cos((3 + i) * t), 0.0 * t)) for i in range(60)}
    (stage,) = staged([Scene(t=t, points=paths, bones=())])
    assert len(stage.samples()) * 60 * 6 * 4 / 3 <= 1.1e6


def test_instants_are_added_where_a_run_is_coarse() -> None:
    np.testing.assert_allclose(
        refined(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.9e-2]), 1e-3), [0, 1, *(1 + np.arange(1, 4) / 3)]
    )
    m = Mechanism([rz("a"), [ty(-1.0, mass=1.0)]], [Gravity((0.0, -9.81, 0.0))])
    (scene,) = show(simulate(m, [0.0], [12.0], np.linspace(0.0, 1.0, 6))).scenes  # two radians from one to the next
    assert scene.t.size > 40
    end = scene.points[m.frames[-1]]
    np.testing.assert_allclose(np.linalg.norm(end, axis=1), 1.0, atol=1e-9)
    assert np.linalg.norm(np.diff(end, axis=0), axis=1).max() < 0.2
    (slow,) = show(simulate(Mechanism([tx("x", mass=1.0)]), [0.0], [1.0], np.linspace(0.0, 1.0, 6))).scenes
    assert slow.t.size == 6
