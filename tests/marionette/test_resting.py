"""What strings can hold at rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from leastaction import check_consistent, equilibrium
from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.models.marionette import REST, Count, marionette, strings_of
from leastaction_marionette import RestingPoses, TrackingRun, plot_resting, resting, track
from leastaction_marionette.retargeting import VARIABLES


def akimbo(strings: Count) -> TrackingRun:
    """A run that is to keep one elbow out to the side, which no single string at the wrist can hold."""
    q = np.zeros((11, len(VARIABLES)))
    for name, angle in (REST | {"lshoulder_ry": 0.7, "lelbow_rx": 1.2}).items():
        q[:, VARIABLES.index(name)] = angle
    motion = Motion(VARIABLES, np.linspace(0.0, 0.2, 11), q)
    return track(marionette(strings=strings), motion, planned=True, max_iterations=1)


def off(rest: RestingPoses, run: TrackingRun, name: str) -> float:
    i = run.mechanism.variables.index(name)
    return float(np.rad2deg(np.abs(rest.q - rest.wanted)[:, i]).max())


def test_a_second_string_holds_an_elbow_that_one_cannot() -> None:
    six, nine = (akimbo(strings) for strings in (6, 9))
    rests = [resting(run, instants=3) for run in (six, nine)]
    assert off(rests[0], six, "lshoulder_ry") > 10.0
    assert off(rests[1], nine, "lshoulder_ry") < 1.0
    assert [rest.missing for rest in rests] == [0, 0]
    assert rests[1].error < 1.0 < rests[0].error


def test_a_pose_is_one_in_which_the_puppet_rests() -> None:
    """By the strings' lengths and the equilibria of a mechanism with constraints, not by tensions."""
    run = akimbo(9)
    rest, m = resting(run, instants=1), run.mechanism
    assert rest.tension.min() >= 0.5 - 1e-9
    check_consistent(m, rest.q[0])
    found = equilibrium(m, rest.q[0], kind="any")
    np.testing.assert_allclose(found.q, rest.q[0], atol=1e-4)
    tension = [2.0 * rest.q[0, m.variables.index(s.length)] * found.multipliers[s.name] for s in strings_of(m)]
    np.testing.assert_allclose(tension, rest.tension[0], atol=1e-2)


def test_errors_of_joints_are_drawn(tmp_path: Path) -> None:
    run = akimbo(6)
    figure = plot_resting(run, resting(run, instants=2))
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert "lshoulder_ry" in labels
    assert "torso_tx" not in labels
    none = replace(resting(run, instants=1), t=np.empty(0), wanted=run.reference[:0], q=run.reference[:0])
    assert len(plot_resting(run, none).axes[0].containers) == 1  # the run alone
    with pytest.raises(ArgumentError, match="instants: got 0"):
        resting(run, instants=0)
