"""A motion followed by the places of head, hands, feet and pelvis instead of by the angles of joints."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from leastaction.apps.cli import main
from leastaction.errors import ArgumentError, ResultFileError
from leastaction.io import Motion, read_bvh
from leastaction.models.marionette import JOINT_LIMITS, REST, marionette
from leastaction_marionette import (
    MARKERS,
    PuppetLimits,
    TrackingRun,
    TrackingWeights,
    load_motion,
    plot_resting,
    resting,
    retarget,
    track,
)
from leastaction_marionette.markers import LIMB_MARKERS, places_of, wanted_markers, with_markers
from leastaction_marionette.tracking import (
    TrackingSearch,
    load_unfinished,
    motors,
    save_run,
    save_search,
)
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem
from marionette.motions import captured
from marionette.puppet_bvh import waving, write_puppet

PUPPET = marionette(strings=9)


def reaching(duration: float = 0.4, dt: float = 0.01) -> Motion:
    """Return a motion in which a hand is wanted 10 cm away from where the joints' angles bring it."""
    t = np.linspace(0.0, duration, round(duration / dt) + 1)
    q = np.zeros((len(t), PUPPET.nd))
    for name, angle in REST.items():
        q[:, PUPPET.dynamic.index(name)] = angle
    rise = (t / duration) ** 3 * (10.0 - 15.0 * t / duration + 6.0 * (t / duration) ** 2)
    q[:, PUPPET.dynamic.index("torso_ty")] = 0.2 * rise
    whole = np.hstack([q, np.zeros((len(t), PUPPET.nrho))])
    places = places_of(PUPPET, whole) - q[:, None, :3]
    places[:, MARKERS.index("left_hand"), 2] += 0.1
    body = Motion(PUPPET.dynamic, t, q, "reaching")
    return with_markers(body, {name: places[:, i] for i, name in enumerate(MARKERS)})


def rms(run: TrackingRun, marker: str) -> float:
    return float(np.sqrt(np.mean(run.markers_apart()[:, MARKERS.index(marker)] ** 2)))


@pytest.fixture(scope="module")
def reached() -> dict[str, TrackingRun]:
    """What following the joints comes to, and what following the markers does."""
    return {
        "joints": track(PUPPET, reaching(), planned=True, max_iterations=40),
        "markers": track(PUPPET, reaching(), planned=True, max_iterations=40, follow="markers"),
    }


def test_a_capture_of_the_puppet_has_its_markers(tmp_path: Path) -> None:
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", waving())))
    q = np.hstack([made.motion.q, np.zeros((len(made.motion.t), PUPPET.nrho))])
    places = places_of(PUPPET, q) - q[:, None, :3]
    for name in LIMB_MARKERS:
        np.testing.assert_allclose(made.markers[name], places[:, MARKERS.index(name)], atol=1e-6)


def test_markers_turn_with_a_walk_in_a_circle_that_is_straightened(tmp_path: Path) -> None:
    q = waving(200)
    q[:, 3] += np.linspace(0.0, 2.0 * np.pi, len(q))
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q, frame_time=0.02)), heading="straight")
    whole = np.hstack([made.motion.q, np.zeros((len(made.motion.t), PUPPET.nrho))])
    places = places_of(PUPPET, whole) - whole[:, None, :3]
    for name in LIMB_MARKERS:
        np.testing.assert_allclose(made.markers[name], places[:, MARKERS.index(name)], atol=1e-6)


def test_markers_of_a_capture_are_columns_of_its_motion(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving())
    plain, marked = load_motion(path).motion, load_motion(path, markers=True, trim=(0.2, 0.8)).motion
    assert wanted_markers(plain) is None
    places = wanted_markers(marked)
    assert places is not None
    assert places.shape == (len(marked.t), 6, 3)
    np.testing.assert_array_equal(places[:, 0], marked.columns(("torso_tx", "torso_ty", "torso_tz")))
    # Filtered and eased in as the angles are, they go along with these.
    q = np.hstack([marked.columns(PUPPET.dynamic), np.zeros((len(marked.t), PUPPET.nrho))])
    assert np.linalg.norm(places_of(PUPPET, q) - places, axis=2).max() < 0.02


def test_derivatives_of_the_cost_of_markers() -> None:
    motion = reaching(0.1, 0.02)
    problem = TrackingProblem(PUPPET, motion, TrackingWeights(), PuppetLimits(), follow="markers")
    rng = np.random.default_rng(5)
    x = problem.x_reference + 0.01 * rng.normal(size=problem.x_reference.shape)
    u = problem.reference[1:, PUPPET.nd :]
    cost = problem.cost()
    dx, step = rng.normal(size=x.shape), 1e-4
    gradient, (Q, _, _, Q_final) = cost.gradient(x, u), cost.hessian(x, u)
    up, down = cost.gradient(x + step * dx, u), cost.gradient(x - step * dx, u)
    slope = (cost.value(x + step * dx, u) - cost.value(x - step * dx, u)) / (2.0 * step)
    assert slope == pytest.approx(np.sum(gradient.q * dx[:-1]) + gradient.q_final @ dx[-1], rel=1e-6)
    np.testing.assert_allclose(
        (up.q - down.q) / (2.0 * step), np.einsum("kij,kj->ki", Q, dx[:-1]), rtol=1e-4, atol=1e-4
    )
    np.testing.assert_allclose((up.q_final - down.q_final) / (2.0 * step), Q_final @ dx[-1], rtol=1e-4, atol=1e-4)


def test_motors_have_the_price_of_markers_too() -> None:
    problem = TrackingProblem(PUPPET, reaching(0.1, 0.02), TrackingWeights(), PuppetLimits(), follow="markers")
    own = TrackingPlan(problem)
    motored = own.cost(motor=1.0)
    motored.check_shapes(own.by_motors.N, own.by_motors.nx, own.by_motors.nu)
    x, u = own.x_reference, own.u_reference
    strings = len(own.strings)
    u_motors = np.hstack([u[:, :strings], np.zeros((len(u), PUPPET.nd)), u[:, strings:]])
    assert motored.value(x, u_motors) == pytest.approx(own.cost().value(x, u), rel=1e-12)
    # The reference itself costs what its left hand is off by, at every instant.
    apart = 0.5 * problem.weights.marker * 0.1**2 * len(problem.t)
    assert own.cost().value(x, u) - own.tracking_cost().value(x, u) == pytest.approx(apart, rel=1e-9)


def test_a_hand_goes_where_it_is_wanted_and_joints_see_to_it(reached: dict[str, TrackingRun]) -> None:
    by_joints, by_markers = reached["joints"], reached["markers"]
    assert by_joints.follow == "joints"
    assert rms(by_joints, "left_hand") > 0.08
    assert rms(by_markers, "left_hand") < 0.04
    assert by_markers.off == pytest.approx(1e3 * np.sqrt(np.mean(by_markers.markers_apart() ** 2)))
    assert by_markers.off < 0.6 * 1e3 * np.sqrt(np.mean(by_joints.markers_apart() ** 2))
    assert by_markers.tension.min() >= 0.5 - 1e-6
    for name, (least, most) in JOINT_LIMITS.items():
        assert least - 1e-4 <= by_markers.trajectory[name].min() <= by_markers.trajectory[name].max() <= most + 1e-4


def test_without_columns_markers_are_where_the_joints_would_bring_them() -> None:
    motion = reaching()
    body = Motion(PUPPET.dynamic, motion.t, motion.columns(PUPPET.dynamic))
    run = track(PUPPET, body, planned=True, max_iterations=1, follow="markers")
    assert run.markers is not None
    np.testing.assert_allclose(run.markers, places_of(PUPPET, run.reference), atol=1e-12)
    with pytest.raises(ArgumentError, match="does not say where they are wanted"):
        track(PUPPET, body, planned=True, max_iterations=0).markers_apart()


def test_a_run_that_follows_markers_is_kept_and_goes_on(reached: dict[str, TrackingRun], tmp_path: Path) -> None:
    cut = track(PUPPET, reaching(), planned=True, max_iterations=2, follow="markers")
    path = save_run(tmp_path / "trajectory.npz", cut)
    again = load_unfinished(path)
    assert isinstance(again, TrackingRun)
    assert again.follow == "markers"
    np.testing.assert_array_equal(again.markers, cut.markers)
    run = track(PUPPET, again.motion, resume=again, max_iterations=40)
    assert run.follow == "markers"
    assert run.off == pytest.approx(reached["markers"].off, rel=0.05)
    save_run(path, replace(cut, follow="toes"))  # type: ignore[arg-type]
    with pytest.raises(ResultFileError, match="toes"):
        load_unfinished(path)


def test_a_search_by_markers_is_kept_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motors, "_ITERATIONS", 2)
    path = tmp_path / "search.npz"

    def checkpoint(found: object) -> None:
        assert isinstance(found, TrackingSearch)
        save_search(path, found)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, reaching(), planned=True, follow="markers", checkpoint=checkpoint, checkpoint_seconds=0.0)
    search = load_unfinished(path)
    assert isinstance(search, TrackingSearch)
    assert search.follow == "markers"
    np.testing.assert_allclose(wanted_markers(search.motion), wanted_markers(reaching()), atol=1e-12)


def test_poses_at_rest_bring_markers_near(reached: dict[str, TrackingRun]) -> None:
    run = reached["markers"]
    rest = resting(run, instants=4)
    rows = np.searchsorted(run.trajectory.t, rest.t - 1e-9)
    assert rest.markers == pytest.approx(np.sqrt(np.mean(run.markers_apart(rest.q, rows) ** 2)))
    # Of the wanted pose the hand is 10 cm off, and no motion holds it back here.
    assert rest.markers < 0.5 * np.sqrt(np.mean(run.markers_apart(run.reference[rows], rows) ** 2))
    assert np.isnan(resting(reached["joints"], instants=2).markers)
    bars, over_time = plot_resting(run, rest).axes
    assert [label.get_text() for label in bars.get_yticklabels()] == [name.replace("_", " ") for name in MARKERS]
    assert over_time.get_ylabel() == "all markers off by (mm, rms)"
    last = over_time.lines[1].get_ydata()[-1]
    assert last == pytest.approx(1e3 * np.sqrt(np.mean(run.markers_apart(rest.q, rows)[-1] ** 2)))


def test_markers_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = write_puppet(tmp_path / "a.bvh", waving(40), frame_time=0.02), tmp_path / "out"
    words = ["optimize", "marionette", "--out", str(out), "--no-animation"]
    with pytest.raises(SystemExit) as ended:
        main([*words, *f"--motion {path} --dt 0.02 --trim 0 0.3 --max-iterations 6 --follow markers".split()])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert "Markers: rms" in said
    summary = json.loads((out / "summary.json").read_text())
    assert summary["follows"] == "markers"
    assert set(summary["markers"]["each"]) == set(MARKERS)
    assert "left hand" in (out / "summary.txt").read_text()
    assert (out / "markers.png").stat().st_size > 10_000
    with pytest.raises(SystemExit):
        main([*words, "--resume", str(out / "trajectory.npz"), "--follow", "markers"])
    assert "leave out --follow" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("file", ["cmu_02_01_walk", "wave_hello"])
def test_markers_of_captures(file: str) -> None:
    motion = load_motion(captured(f"{file}.bvh"), dt=0.02, markers=True).motion
    by_joints, by_markers = (track(PUPPET, motion, planned=True, follow=what) for what in ("joints", "markers"))
    assert by_markers.result.success
    assert by_markers.tension.min() >= 0.5 - 1e-6
    assert by_markers.off < 0.5e3 * np.sqrt(np.mean(by_joints.markers_apart() ** 2))
