"""Lengths of paths over frames, and frames and velocities of a run by name."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Gravity,
    Mechanism,
    MidpointVI,
    PathLength,
    TapeMeasure,
    rx,
    ry,
    simulate,
    tx,
    ty,
    tz,
)

FRAMES = ("world", "hook", "bob", "hand")


def arm() -> Mechanism:
    """Return two links in space on a prescribed slide, with a hook in the world."""
    far = [ry("b"), [tz(-0.7, mass=1.0, name="bob"), [rx("c"), [ty(0.4, mass=0.5, name="hand")]]]]
    return Mechanism([tx("s", kinematic=True), [rx("a"), far], tz(0.5, name="hook")], [Gravity()])


def test_a_length_and_its_derivatives(rng: np.random.Generator) -> None:
    m = arm()
    tape = TapeMeasure(m, FRAMES)
    q, v = rng.normal(size=(5, m.nq)), rng.normal(size=(5, m.nq))
    places = m.positions(q, FRAMES)
    length = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
    assert tape.length(q) == pytest.approx(length, rel=1e-14)
    assert tape.length(q[0]) == pytest.approx(length[0], rel=1e-14)
    h = 1e-5
    by_q, by_v = tape.rate_derivatives(q, v)
    for i, step in enumerate(h * np.eye(m.nq)):
        difference = (np.asarray(tape.length(q + step)) - tape.length(q - step)) / (2 * h)
        assert tape.gradient(q)[:, i] == pytest.approx(difference, abs=1e-8)
        difference = (tape.gradient(q + step) - tape.gradient(q - step)) / (2 * h)
        assert np.abs(tape.hessian(q)[:, i] - difference).max() < 1e-8
        difference = (np.asarray(tape.rate(q + step, v)) - tape.rate(q - step, v)) / (2 * h)
        assert by_q[:, i] == pytest.approx(difference, abs=1e-8)
    assert tape.rate(q, v) == pytest.approx(np.einsum("ni,ni->n", by_v, v))
    assert tape.hessian(q[1]).shape == (m.nq, m.nq)
    assert isinstance(tape.rate(q[1], v[1]), float)


def test_it_is_what_a_path_constraint_holds(rng: np.random.Generator) -> None:
    plain = arm()
    q = rng.normal(size=plain.nq)
    tape = TapeMeasure(plain, FRAMES)
    held = Mechanism(arm_tree(), [Gravity(), PathLength(FRAMES, tape.length(q), name="tape")])
    assert held.variables == plain.variables
    assert held.constraint_residuals(q)["tape"] == pytest.approx(0.0, abs=1e-12)
    assert held.constraint_jacobian(q)[0] == pytest.approx(tape.gradient(q), abs=1e-12)


def arm_tree() -> list[object]:
    far = [ry("b"), [tz(-0.7, mass=1.0, name="bob"), [rx("c"), [ty(0.4, mass=0.5, name="hand")]]]]
    return [tx("s", kinematic=True), [rx("a"), far], tz(0.5, name="hook")]


def test_bad_paths_are_named() -> None:
    m = arm()
    with pytest.raises(ArgumentError, match="expected a list of frames, got the string 'bob'"):
        TapeMeasure(m, "bob")
    with pytest.raises(ArgumentError, match="two frames or more"):
        TapeMeasure(m, ["bob"])
    with pytest.raises(ArgumentError, match="unknown frame 'bobb'; did you mean 'bob'"):
        TapeMeasure(m, ["world", "bobb"])
    with pytest.raises(ArgumentError, match="'bob' follows itself"):
        TapeMeasure(m, ["bob", "bob"])
    meeting = Mechanism([ty("y"), [tz("z", mass=1.0, name="p")]])
    tape = TapeMeasure(meeting, ["world", "p"])
    assert tape.length([0.0, 0.0]) == 0.0
    with pytest.raises(ArgumentError, match="'world' and 'p' meet"):
        tape.gradient([0.0, 0.0])


def test_frames_and_their_velocities_of_a_run_by_name() -> None:
    m = arm()
    vi, t = MidpointVI(m), np.linspace(0.0, 1.0, 1001)
    q, v = m.configuration({"a": 0.5, "b": -0.3}), m.configuration({"c": 1.0})
    run = vi.simulate(vi.start(q, v), t)
    assert run["hand"] == pytest.approx(m.positions(run.q, ["hand"])[:, 0], abs=1e-14)
    assert run["a"].shape == (1001,)
    velocity = run.velocity("hand")
    assert velocity.shape == (1000, 6)
    assert velocity[:, :3] == pytest.approx(np.diff(run["hand"], axis=0) / 1e-3, abs=1e-4)
    continuous = simulate(m, q, v, t)
    assert np.abs(continuous["hand"] - run["hand"]).max() < 1e-5
    assert np.abs(continuous.velocity("hand")[1:-1, :3] - np.gradient(continuous["hand"], t, axis=0)[1:-1]).max() < 1e-4
    with pytest.raises(ArgumentError, match="unknown name 'hnd'; did you mean 'hand'"):
        run["hnd"]
    with pytest.raises(ArgumentError, match="unknown variable 'hnd'"):
        run.velocity("hnd")
    with pytest.raises(ArgumentError, match="name: got 3"):
        run[3]
