"""The puppet whose pelvis, hips and shoulders are ball joints: nothing it does is near a singularity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leastaction.io import Motion, read_capture
from leastaction.models.marionette import REST, hang_strings, heading, marionette, turns_of_angles
from leastaction.numerics import Array, smooth_rise
from leastaction.optimal import Status
from leastaction_marionette import (
    FORCED,
    VARIABLES,
    PuppetLimits,
    TrackingRun,
    load_run,
    load_unfinished,
    resting,
    retarget,
    save_run,
    save_search,
    track,
)
from leastaction_marionette.command.report import write_report
from leastaction_marionette.tracking import TrackingSearch, motors, plan
from leastaction_marionette.tracking.poses import PoseSearch
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.turns import as_vectors, differences, moved, on_the_way
from marionette.puppet_bvh import write_puppet

PUPPET = marionette(strings=9, axes="quaternion")


def overhead(duration: float = 0.8, dt: float = 0.02) -> Motion:
    """Both arms go from level forearms up to the sides and over the head: their second angle passes a right one."""
    t = np.linspace(0.0, duration, round(duration / dt) + 1)
    rise = smooth_rise(t / duration)
    angles = dict.fromkeys(VARIABLES, 0.0 * t) | {name: angle + 0.0 * t for name, angle in REST.items()}
    angles["lshoulder_ry"], angles["rshoulder_ry"] = 2.7 * rise, -2.7 * rise
    for side in "lr":
        angles[f"{side}elbow_rx"] = 1.57 - 1.2 * rise
    return Motion(VARIABLES, t, np.stack([angles[name] for name in VARIABLES], axis=1), "arms overhead")


def planned(motion: Motion) -> plan.TrackingPlan:
    return plan.TrackingPlan(TrackingProblem(PUPPET, motion, FORCED, PuppetLimits()))


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    return track(PUPPET, overhead())


def test_angles_say_the_same_poses() -> None:
    rng = np.random.default_rng(1)
    by_angles = marionette(strings=9)
    angles = dict(zip(by_angles.dynamic, rng.uniform(-1.0, 1.0, size=(by_angles.nd, 20)), strict=True))
    turns = turns_of_angles(angles)
    q, other = np.zeros((20, by_angles.nq)), np.tile(PUPPET.configuration(), (20, 1))
    q[:, : by_angles.nd] = np.stack(list(angles.values()), axis=1)
    for name, values in turns.items():
        other[:, PUPPET.coordinates.index(name)] = values
    frames = ["lhand", "rhand", "lfoot", "rfoot", "head"]
    np.testing.assert_allclose(PUPPET.positions(other, frames), by_angles.positions(q, frames), atol=1e-12)
    assert np.allclose(
        hang_strings(PUPPET, PUPPET.configuration())[-1], hang_strings(by_angles, np.zeros(by_angles.nq))[-1]
    )


def test_heading_goes_on_over_the_top() -> None:
    """A somersault turns nobody round, a pirouette as far as it goes."""
    t = np.linspace(0.0, 1.0, 40)
    for name, expected in (("torso_rx", 0.3), ("torso_rz", 0.3 + 7.0 * t)):
        turned = turns_of_angles(
            {"torso_rz": np.full(40, 0.3), "torso_rx": 0.0 * t} | {name: 0.3 * (name == "torso_rz") + 7.0 * t}
        )
        q = np.tile(PUPPET.configuration(), (40, 1))
        for each, values in turned.items():
            q[:, PUPPET.coordinates.index(each)] = values
        if name == "torso_rx":
            np.testing.assert_allclose(np.exp(1j * heading(PUPPET, q)[t < 0.4]), np.exp(1j * 0.3), atol=1e-9)
        else:
            np.testing.assert_allclose(heading(PUPPET, q), expected, atol=1e-9)


def test_the_way_to_a_motion_is_about_one_axis() -> None:
    m, motion = PUPPET, overhead()
    wanted = planned(motion).problem.reference
    half = on_the_way(m.coordinates, wanted[0], wanted, 0.5)
    np.testing.assert_allclose(
        differences(m, wanted, half), differences(m, half, np.tile(wanted[0], (len(wanted), 1))), atol=1e-12
    )
    assert as_vectors(m, wanted)[-1, m.dynamic.index("lshoulder.wy")] == pytest.approx(2.7)


def test_a_capture_is_followed_exactly_where_angles_spin(tmp_path: Path) -> None:
    motion = overhead()
    turning = motion.q.copy()
    turning[:, VARIABLES.index("torso_ry")] = 3.0 * smooth_rise(motion.t / motion.duration)
    path = write_puppet(tmp_path / "overhead.bvh", turning)
    by_angles, by_turns = (retarget(read_capture(path), axes=axes) for axes in ("zyx", "quaternion"))
    assert by_angles.largest_error > 5.0
    assert by_turns.largest_error < 1e-3
    steps = np.diff(by_turns.motion.q[:, 3:7], axis=0)
    assert np.abs(steps).max() < 0.15


def test_motors_can_make_any_motion() -> None:
    wanted = planned(overhead())
    system = wanted.by_motors
    x, u = motors.driven(wanted)
    reached = np.array([system.f(x[k], u[k], k) for k in range(system.N)])
    np.testing.assert_allclose(system.difference(reached, x[1:]), 0.0, atol=1e-9)


def test_derivatives_of_poses_at_rest() -> None:
    search = PoseSearch(planned(overhead()))
    m, rng = search.mechanism, np.random.default_rng(2)
    pose = search.wanted(20)

    def moved_pose(step: Array) -> Array:
        return np.concatenate([moved(m, pose[None, : m.nq], step[None, : m.nv])[0], pose[m.nq :] + step[m.nv :]])

    for step in 1e-5 * rng.normal(size=(4, len(search.scale))):
        difference = search.net(moved_pose(step)) - search.net(moved_pose(-step))
        np.testing.assert_allclose(difference, 2.0 * search.net_derivative(pose) @ step, atol=1e-9)


def test_arms_go_over_the_head(run: TrackingRun, tmp_path: Path) -> None:
    assert run.result.status is Status.CONVERGED
    assert run.off < 5.0
    assert run.tension.min() >= 0.5 - 1e-6
    hands, head = (
        PUPPET.positions(run.trajectory.q[-1], ["lhand", "rhand"]),
        PUPPET.positions(run.trajectory.q[-1], ["head_end"]),
    )
    assert (hands[:, 2] > head[0, 2]).all()
    again = load_run(save_run(tmp_path / "run.npz", run))
    assert again.mechanism == run.mechanism
    np.testing.assert_array_equal(again.trajectory.q, run.trajectory.q)
    assert again.off == run.off
    rest = resting(run, instants=4)
    assert rest.missing == 0
    assert rest.error < 5.0


def test_everything_is_written(run: TrackingRun, tmp_path: Path) -> None:
    write_report(run, tmp_path, rest=resting(run, instants=3))
    assert {"tracking.png", "resting.png", "snapshots.png", "animation.html"} <= {
        each.name for each in tmp_path.iterdir()
    }
    assert "lshoulder.wy" in (tmp_path / "summary.txt").read_text(encoding="utf-8")


def test_a_search_is_kept_and_gone_on_with(tmp_path: Path) -> None:
    kept: list[TrackingRun | TrackingSearch] = []

    def keep(found: TrackingRun | TrackingSearch) -> None:
        kept.append(found)
        if len(kept) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, overhead(0.4), planned=True, checkpoint=keep, checkpoint_seconds=0.0)
    found = kept[-1]
    assert isinstance(found, TrackingSearch)
    search = load_unfinished(save_search(tmp_path / "search.npz", found))
    again = track(PUPPET, search.motion, resume=search)
    assert again.result.success
