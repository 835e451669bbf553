"""Captures of any kind become motions of a puppet whose strings pull: variants of made-up ones, and three real ones."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from leastaction.apps.cli import main
from leastaction.errors import ArgumentError
from leastaction.io import Motion, read_bvh
from leastaction.io.motion.capture import axis_rotation
from leastaction.models.marionette import JOINT_LIMITS, marionette
from leastaction_marionette import (
    VARIABLES,
    load_motion,
    load_run,
    resting,
    retarget,
    track,
    walk_in_place,
)
from leastaction_marionette.command.summary import _unit_of, run_summary
from leastaction_marionette.command.tables import as_text, summary_tables
from leastaction_marionette.retargeting.geometry import euler_zyx, rotation_zyx
from leastaction_marionette.retargeting.spins import FURTHEST, beside, without_spins
from leastaction_marionette.speeds import fastest
from leastaction_marionette.tracking import PuppetLimits
from marionette.motions import captured, leap
from marionette.puppet_bvh import CMU_NAMES, Y_UP, Z_UP, Convention, waving, write_puppet

MIXAMO = {role: f"mixamorig:{name}" for role, name in CMU_NAMES.items()}
KINECT = {
    f"{side}_{joint}": f"{joint.capitalize()}{side.capitalize()}"
    for side in ("left", "right")
    for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
}
ROKOKO = {
    f"{side}_{joint}": f"{side.capitalize()}{name}"
    for side in ("left", "right")
    for joint, name in (
        ("hip", "Thigh"), ("knee", "Shin"), ("ankle", "Foot"),
        ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"),
    )
}  # fmt: skip


def turned(turns: float, radius: float = 0.0) -> np.ndarray:
    """A lively motion whose heading makes so many turns, on a circle of that radius."""
    q = waving(200)
    angle = np.linspace(0.0, 2.0 * np.pi * turns, len(q))
    q[:, 3] += angle
    q[:, 0] += radius * (np.cos(angle) - 1.0)
    q[:, 1] += radius * np.sin(angle)
    return q


@pytest.mark.parametrize("names", [MIXAMO, KINECT, ROKOKO])
def test_names_of_other_skeletons(tmp_path: Path, names: dict[str, str]) -> None:
    q = waving()
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q, convention=Convention(names=names, unit=0.0254))))
    np.testing.assert_allclose(made.motion.columns(VARIABLES[6:]), q[:, 6:], atol=1e-6)


def test_hands_without_a_name_that_is_known(tmp_path: Path) -> None:
    names = {**CMU_NAMES, "left_wrist": "Paw1", "right_wrist": "Paw2"}
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", waving(), convention=Convention(names=names))))
    assert made.joints["left_wrist"] == "Paw1"


def test_a_person_who_turns_all_the_way_faces_ahead_at_first(tmp_path: Path) -> None:
    q = turned(1.0)
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q, frame_time=0.02)))
    assert made.motion["torso_rz"][0] == pytest.approx(0.0, abs=0.05)
    assert np.ptp(made.motion["torso_rz"]) == pytest.approx(np.ptp(q[:, 3]), abs=1e-6)


def test_a_walk_in_a_circle_goes_straight(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "a.bvh", turned(1.0, 1.0), frame_time=0.02)
    round_, straight = retarget(read_bvh(path)), retarget(read_bvh(path), heading="straight")
    assert np.ptp(round_.motion["torso_rz"]) > 6.0
    # The first and last quarter of a second feel the ends of the filter.
    assert np.ptp(straight.motion["torso_rz"]) < 1.5

    def way(motion: object) -> float:
        place = motion.q[:, :2]  # type: ignore[attr-defined]
        return float(np.sum(np.linalg.norm(np.diff(place, axis=0), axis=1)))

    assert way(straight.motion) == pytest.approx(way(round_.motion), rel=1e-6)
    np.testing.assert_allclose(straight.motion.columns(VARIABLES[6:]), round_.motion.columns(VARIABLES[6:]))
    assert straight.largest_error == pytest.approx(round_.largest_error, abs=1e-9)


def test_a_person_who_somersaults_is_upright_by_the_skeleton(tmp_path: Path) -> None:
    q = waving(100)
    q[:, 5] += np.linspace(0.0, 2.0 * np.pi, len(q), endpoint=False)
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q, convention=Convention(axes=Z_UP))))
    assert made.up == "z"


@pytest.mark.parametrize("prone", [True, False])
@pytest.mark.parametrize("axes", [Y_UP, Z_UP])
def test_a_person_who_lies_is_upright_by_the_skeleton(tmp_path: Path, prone: bool, axes: np.ndarray) -> None:
    q = waving(100)
    q[:, 5] += -0.5 * np.pi if prone else 0.5 * np.pi
    q[:, 2] = 0.35
    up = "y" if axes is Y_UP else "z"
    path = write_puppet(tmp_path / "a.bvh", q, convention=Convention(axes=axes))
    assert retarget(read_bvh(path)).up == up
    # A skeleton that lies in the file, and is turned up by it, stands on the ground along the other axis.
    lies = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    q = waving(100)
    q[:, 2] = 0.85
    write_puppet(path, q, convention=Convention(axes=lies @ axes))
    assert retarget(read_bvh(path)).up == {"y": "z", "z": "-y"}[up]


def test_a_torso_that_turns_over_sideways_passes_beside_its_singularity(tmp_path: Path) -> None:
    """As limbs do: a cartwheel."""
    q = waving(200)
    q[:, 3:6] = 0.0
    q[:, 4] = np.linspace(0.0, 2.0 * np.pi, len(q))
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q)), up="y", forward="z")
    assert np.abs(made.motion["torso_ry"]).max() <= FURTHEST
    assert np.abs(np.diff(made.motion.q[:, 3:6], axis=0)).max() / 0.02 < 20.0
    assert max(float(error.max()) for error in made.errors.values()) < 30.0


def test_a_capture_is_tracked_as_it_was_read(tmp_path: Path) -> None:
    """`track` takes what `load_motion` returns, as well as its motion alone."""
    read = load_motion(write_puppet(tmp_path / "a.bvh", waving(40)))
    run = track(marionette(), read, max_iterations=1)
    assert run.motion.names == read.motion.names[: len(run.motion.names)]
    np.testing.assert_array_equal(run.motion.q, read.motion.q)


def test_a_capture_of_a_few_frames_is_a_motion(tmp_path: Path) -> None:
    """It picks up speed as fast as there is time to."""
    motion = load_motion(write_puppet(tmp_path / "a.bvh", waving(5), frame_time=0.02)).motion
    assert motion.duration == pytest.approx(0.16)
    whole = load_motion(write_puppet(tmp_path / "a.bvh", waving(5), frame_time=0.02), start="moving").motion
    np.testing.assert_allclose(motion.q[[0, -1]], whole.q[[0, -1]], atol=1e-6)


def test_knees_that_a_skeleton_overstretches_point_ahead(tmp_path: Path) -> None:
    """A leg that is bent a little to the wrong side is a straight one, not one turned round."""
    q = np.zeros((40, len(VARIABLES)))
    q[:, VARIABLES.index("lknee_rx")] = 0.1
    q[:, VARIABLES.index("relbow_rx")] = 0.4 + 0.1 * np.sin(np.arange(40))
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q))).motion
    assert abs(made["lhip_rz"]).max() < 0.1
    assert abs(made["lknee_rx"]).max() < 1e-9


def spinning(miss: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles of a shoulder that passes that near its singularity, and the directions they stand for."""
    t = np.linspace(0.0, 1.0, 61)
    swing = 0.5 * np.pi + np.linspace(-0.8, 0.8, len(t))
    turns = euler_zyx(axis_rotation(0, np.full(len(t), miss)) @ axis_rotation(1, swing))
    return t, turns, axis_pair(turns)


def axis_pair(turns: np.ndarray) -> np.ndarray:
    return np.swapaxes(rotation_zyx(turns[:, :3])[:, :, ::2], 1, 2)


@pytest.mark.parametrize("degrees", [1.0, 3.0, 5.0])
def test_angles_do_not_spin_beside_a_singularity(degrees: float) -> None:
    t, turns, wanted = spinning(np.deg2rad(degrees))
    assert np.abs(np.diff(turns, axis=0)).max() * 60.0 > 15.0
    made = without_spins(t, turns, axis_pair, wanted)
    assert np.abs(np.diff(made, axis=0)).max() * 60.0 < 15.0
    miss = np.linalg.norm(axis_pair(made) - wanted, axis=2)
    assert np.rad2deg(miss.max()) < 1.5 * degrees
    assert np.rad2deg(miss[[0, -1]].max()) < 0.1
    slow = without_spins(10.0 * t, turns, axis_pair, wanted)
    np.testing.assert_array_equal(slow, turns)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_limb_that_swings_through_its_singularity_passes_beside_it(sign: float) -> None:
    t = np.linspace(0.0, 4.0, 401)
    turns = np.stack([0.3 + 0.0 * t, sign * (1.2 - 1.2 * np.cos(0.5 * np.pi * t)), 0.2 * t], axis=1)
    made = beside(t, turns)
    assert np.abs(made[:, 1]).max() <= FURTHEST
    assert np.abs(np.diff(made, axis=0)).max() * 100.0 < 15.0
    miss = np.arccos(np.clip(np.sum(rotation_zyx(made)[:, :, 2] * rotation_zyx(turns)[:, :, 2], axis=1), -1.0, 1.0))
    assert np.rad2deg(miss.max()) < 30.0
    # On either side of it the same rotations, and what never comes near is left as it is.
    far = np.abs(np.abs(turns[:, 1]) - 0.5 * np.pi) > 0.6
    np.testing.assert_allclose(rotation_zyx(made[far]), rotation_zyx(turns[far]), atol=1e-9)
    near = turns * [1.0, 0.5, 1.0]
    assert beside(t, near) is near
    # One that is on the other side all the time is told by the other angles.
    whole = np.column_stack([t, np.full_like(t, sign * 2.5), -t])
    np.testing.assert_allclose(rotation_zyx(beside(t, whole)), rotation_zyx(whole), atol=1e-9)


def test_part_of_a_capture_at_another_speed(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving(100), frame_time=0.02)
    options = {"start": "moving", "cutoff": None, "dt": 0.02}
    whole = load_motion(path, **options).motion
    half = load_motion(path, trim=(0.4, 1.0), speed=0.5, **options)
    assert half.motion.duration == pytest.approx(1.2)
    np.testing.assert_allclose(half.motion["lknee_rx"][::2], whole["lknee_rx"][20:51], atol=1e-9)
    assert half.motion["torso_tx"][0] == 0.0
    assert "speed 0.5" in half.summary()


def optimize(capsys: pytest.CaptureFixture[str], out: Path, *words: object) -> dict:
    with pytest.raises(SystemExit) as ended:
        main(["optimize", "marionette", "--out", str(out), "--no-plots", "--no-animation", *map(str, words)])
    said = capsys.readouterr()
    assert (ended.value.code, said.err) == (0, "")
    return dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))


def check(out: Path, within: float = 1e-3) -> None:
    """Every string pulls at every instant, and hinges are not overstretched."""
    run = load_run(out / "trajectory.npz")
    assert run.tension.min() >= 0.0
    for name, (least, most) in JOINT_LIMITS.items():
        assert least - within <= run.trajectory[name].min() <= run.trajectory[name].max() <= most + within


def test_a_lively_capture_in_one_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("leastaction_marionette.command.report.resting", partial(resting, instants=2))
    path = write_puppet(tmp_path / "a.bvh", turned(0.1), convention=Convention(names=MIXAMO), frame_time=0.02)
    words = ("--motion", path, "--dt", 0.02, "--speed", 0.5, "--trim", 0, 0.5, "--forward", "z", "--up", "y")
    numbers = optimize(capsys, tmp_path / "out", *words, "--tension", 0.8)
    run = load_run(tmp_path / "out" / "trajectory.npz")
    assert run.limits == PuppetLimits(tension=0.8)  # the command's, for the poses at rest too
    assert resting(run, instants=1).tension.min() == pytest.approx(0.8)
    assert numbers["run"]["status"] in ("CONVERGED", "STALLED")
    assert {entry["limit"] for entry in numbers["limits_reached"]}
    assert numbers["limits_broken"] == []
    check(tmp_path / "out")
    # Drawn again it says the same.
    pictures = tmp_path / "pictures"
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["draw", str(tmp_path / "out" / "trajectory.npz"), "--out", str(pictures), "--no-plots"])
    for name in ("summary.json", "summary.txt"):
        assert (pictures / name).read_bytes() == (tmp_path / "out" / name).read_bytes(), name


def test_limits_that_a_run_does_not_keep_to_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_puppet(tmp_path / "a.bvh", turned(0.1), frame_time=0.02)
    words = ("--motion", path, "--dt", 0.02, "--trim", 0, 0.5, "--max-iterations", 1)
    optimize(capsys, tmp_path / "out", *words)
    run = load_run(tmp_path / "out" / "trajectory.npz")
    ends = [name for name in run.mechanism.kinematic if name.endswith(("-x", "-y"))]
    fast = max(float(np.abs(np.diff(run.trajectory[name])).max()) for name in ends) / 0.02
    slower = PuppetLimits(speed=0.5 * fast)
    said = "speed of the strings' ends"
    broken = replace(run, limits=slower)
    assert said in run_summary(broken)["limits_broken"]
    assert said in as_text(summary_tables(run_summary(broken)))
    hardly = replace(run, limits=PuppetLimits(speed=fast / 1.01))
    assert said not in run_summary(hardly)["limits_broken"]


def test_what_speaks_against_a_capture_is_said_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving())
    assert load_motion(path).warnings == ()
    lines = path.read_text().splitlines()
    # A quarter of all frames is not there, and elbows overstretch for half of the time.
    lines[-40:-25] = [" ".join("NaN" for _ in line.split()) for line in lines[-40:-25]]
    path.write_text("\n".join(lines))
    lost = load_motion(path)
    assert lost.lost == pytest.approx(0.25)
    (said,) = lost.warnings
    assert said.startswith("25 % of the samples are missing")
    q = waving()
    for name in ("lelbow_rx", "relbow_rx"):
        q[:, VARIABLES.index(name)] = 1.5 * np.sin(np.linspace(0.3, 2.0 * np.pi, len(q)))
    bent = write_puppet(tmp_path / "b.bvh", q)
    (said,) = load_motion(bent).warnings
    assert re.match(r"the puppet's joints cannot point its (left|right) forearm and 1 more as the capture does", said)
    monkeypatch.setattr("leastaction_marionette.command.session.run", lambda *_arguments, **_options: 0)
    with pytest.raises(SystemExit):
        main(["optimize", "marionette", "--motion", str(bent), "--out", str(tmp_path / "out")])
    assert "warning: the puppet's joints cannot point" in capsys.readouterr().out


def test_limits_that_were_reached_have_units() -> None:
    run = track(marionette(), leap(0.3), max_iterations=8, planned=True)
    found = run_summary(run)["limits_reached"]
    assert found
    assert all(entry["unit"] == "m" for entry in found if "_string-" in entry["limit"])
    for label, unit in (
        ("v_left_foot_string-x <= 8", "m/s"),
        ("acceleration of left_foot_string-x <= 150", "m/s²"),
        ("left_foot_string-x <= 2", "m"),
        ("tension of neck_string >= 0.5", "N"),
        ("lknee_rx <= 0", "rad"),
    ):
        assert _unit_of(label) == unit
    assert f"{found[0]['limit']} {found[0]['unit']}" in " ".join(as_text(summary_tables(run_summary(run))).split())


def test_a_limit_that_says_its_unit_itself_says_it_once() -> None:
    summary = run_summary(track(marionette(), walk_in_place(2.0, 0.01)))
    assert {entry["unit"] for entry in summary["limits_reached"]} == {"N"}
    assert ">= 0.5 N" in (text := as_text(summary_tables(summary)))
    assert "N N" not in " ".join(text.split())


def test_as_fast_as_an_error_allows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving(40), frame_time=0.02)
    out = tmp_path / "out"
    words = ("--motion", path, "--dt", 0.02, "--trim", 0, 0.3, "--speed", "auto", "--max-iterations", 6)
    with pytest.raises(SystemExit) as ended:
        main(["optimize", "marionette", "--out", str(out), "--no-animation", "--error", "60", *map(str, words)])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert "Error over speed: at most 60" in said
    assert (out / "speeds.png").stat().st_size > 10_000
    if load_run(out / "trajectory.npz").embedded:
        assert "in poses at rest" in " ".join(said.split())
        assert (out / "resting.png").stat().st_size > 10_000
    check(out)


def test_speeds_are_tried_until_one_is_slow_enough() -> None:
    walk = walk_in_place(0.4, 0.02)
    asked: list[float] = []

    def motion_at(speed: float) -> Motion:
        asked.append(speed)
        return walk

    def follow(motion: Motion) -> object:
        assert motion is walk
        return SimpleNamespace(off=10.0 * asked[-1], ended_early=False)

    tried = fastest(follow, motion_at, 6.0)  # type: ignore[arg-type]
    assert [each.speed for each in tried] == asked == [1.0, 0.8, 0.65, 0.5]
    assert tried[-1].error == 5.0
    # Where none is, the best is last.
    assert fastest(follow, motion_at, 1.0, speeds=(0.5, 0.2, 0.4))[-1].speed == 0.2  # type: ignore[arg-type]
    # Where slower is no better, strings are what is missing.
    errors = {1.0: 9.0, 0.8: 7.0, 0.65: 7.5, 0.5: 6.5, 0.4: 6.4, 0.3: 6.45, 0.2: 0.1}

    def flat(_: Motion) -> object:
        return SimpleNamespace(off=errors[asked[-1]], ended_early=False)

    asked.clear()
    tried = fastest(flat, motion_at, 5.0)  # type: ignore[arg-type]
    assert asked == [1.0, 0.8, 0.65, 0.5, 0.4, 0.3]
    assert tried[-1].speed == 0.4
    with pytest.raises(ArgumentError, match=r"error: got 0\.0, expected a number > 0"):
        fastest(follow, motion_at, 0.0)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="speeds: got none"):
        fastest(follow, motion_at, 1.0, speeds=())  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("file", ["cmu_02_01_walk", "wave_hello", "dab"])
def test_real_captures(tmp_path: Path, capsys: pytest.CaptureFixture[str], file: str) -> None:
    path = captured(f"{file}.bvh")
    optimize(capsys, tmp_path / "out", "--motion", path, "--dt", 0.02, "--trim", 0, 1, "--max-iterations", 30)
    check(tmp_path / "out", within=0.02)


def _boxer(t: np.ndarray) -> dict[str, np.ndarray | float]:
    """Fast punches, one hand after the other, on bent knees."""
    blow = {side: sum(np.exp(-(((t - at) / 0.09) ** 2)) for at in times) for side, times in _BLOWS.items()}
    arms = {f"{side}elbow_rx": 2.2 - 2.0 * each for side, each in blow.items()}
    arms |= {f"{side}shoulder_rx": 0.4 + 1.1 * each for side, each in blow.items()}
    turned = -0.4 - 0.4 * blow["l"] + 0.7 * blow["r"]
    return arms | {"torso_rz": turned, "torso_rx": -0.2, "lhip_rx": 0.5, "lknee_rx": -0.5, "rknee_rx": -0.5}


def _skipper(t: np.ndarray) -> dict[str, np.ndarray | float]:
    """Hops along a circle of two metres."""
    at, beat = 0.9 * t, 2.0 * np.pi * 1.1 * t
    found = {"torso_tx": 2.0 * (np.cos(at) - 1.0), "torso_ty": 2.0 * np.sin(at), "torso_rz": at}
    found["torso_tz"] = 0.15 * np.abs(np.sin(beat))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        lift = np.maximum(sign * np.sin(beat), 0.0)
        found |= {f"{side}hip_rx": 1.1 * lift, f"{side}knee_rx": -0.15 - 1.2 * lift}
        found |= {f"{side}shoulder_rx": -0.8 * sign * np.sin(beat), f"{side}elbow_rx": 0.9 + 0.0 * t}
    return found


def _turner(t: np.ndarray) -> dict[str, np.ndarray | float]:
    """Turns around within half a second, both arms flung out, and once more the other way; some samples are wrong."""
    around = 0.5 * np.pi * (1.0 + np.tanh((t - 1.2) / 0.18)) - np.pi * (1.0 + np.tanh((t - 2.6) / 0.25))
    out = np.exp(-(((t - 1.4) / 0.4) ** 2))
    found = {"torso_rz": around, "lshoulder_ry": 1.2 * out, "rshoulder_ry": -1.2 * out, "lelbow_rx": 0.3 + 0.0 * t}
    found["rhip_rx"] = 0.05 + 0.8 * (np.arange(len(t)) == 100)
    return found | {"lknee_rx": -0.1, "rknee_rx": -0.1, "relbow_rx": 0.3}


_BLOWS = {"l": (1.0, 1.35, 2.6), "r": (1.7, 3.0)}
_KINDS = {
    "boxer": (_boxer, Convention(axes=Y_UP, unit=0.0254), 5.0),
    "skipper": (_skipper, Convention(axes=Y_UP, unit=0.01, names=KINECT, order="YXZ"), 12.0),
    "turner": (_turner, Convention(axes=Z_UP, unit=0.0254, names=MIXAMO), 9.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", _KINDS)
def test_kinds_of_motion_that_nothing_was_made_for(kind: str, tmp_path: Path) -> None:
    made, convention, most = _KINDS[kind]
    t = np.arange(0.0, 3.5, 1.0 / 60.0)
    q = np.zeros((len(t), len(VARIABLES)))
    for name, values in made(t).items():
        q[:, VARIABLES.index(name)] = values
    q += 0.01 * np.random.default_rng(0).normal(size=q.shape) * np.where(np.arange(q.shape[1]) < 3, 0.2, 1.0)
    path = write_puppet(tmp_path / f"{kind}.bvh", q, frame_time=1.0 / 60.0, convention=convention)
    run = track(marionette(strings=9), load_motion(path, dt=0.02).motion)
    assert run.result.success
    assert run.tension.min() >= 0.5 - 1e-6
    assert run.held_error < most
