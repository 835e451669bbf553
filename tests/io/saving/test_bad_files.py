"""Files that are missing, damaged, of others, or cannot be written: a named error, and never half a file."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import leastaction as la
from api.saving_cases import limited, optimised, simulated
from leastaction.errors import ArgumentError, MotionFileError, OutputError, ResultFileError
from leastaction.numerics import files
from leastaction.numerics.dataset import Column, Table, table

ENDINGS = (".h5", ".npz", ".csv", ".mat")


@pytest.fixture(scope="module")
def run() -> la.Trajectory:
    return simulated()


# Writing


@pytest.mark.parametrize("name", ["run.xlsx", "run", "run.json", "run.h5.zip"])
def test_an_unknown_ending(run: la.Trajectory, name: str, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match=r"whose ending .* expected one of \.h5, \.hdf5, \.npz, \.csv, \.mat"):
        run.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_full_disk_leaves_the_old_file(
    run: la.Trajectory, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if ending == ".h5":
        pytest.importorskip("h5py")
    path = run.save(tmp_path / f"run{ending}")
    before = path.read_bytes()

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        optimised().save(path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
def test_an_interrupted_write_leaves_the_old_file(
    run: la.Trajectory, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if ending == ".h5":
        pytest.importorskip("h5py")
    path = run.save(tmp_path / f"run{ending}")
    before = path.read_bytes()

    def interrupted(handle: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        optimised().save(path)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
def test_where_nothing_may_be_written(
    run: la.Trajectory, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if ending == ".h5":
        pytest.importorskip("h5py")
    with pytest.raises(OutputError, match="No such file or directory"):
        run.save(tmp_path / "absent" / f"run{ending}")
    (tmp_path / f"folder{ending}").mkdir()
    with pytest.raises(OutputError, match="cannot write"):
        run.save(tmp_path / f"folder{ending}")
    opened = Path.open

    # Permissions do not stop a test that runs as root, so the refusal itself is made.
    def refuse(self: Path, mode: str = "r", *args: Any, **options: Any) -> Any:
        if "x" in mode or "w" in mode:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return opened(self, mode, *args, **options)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(OutputError, match="Permission denied"):
        run.save(tmp_path / f"run{ending}")


def test_names_that_a_table_cannot_hold(tmp_path: Path) -> None:
    t = np.array([0.0, 1.0])
    for name in ("t", "time", "x [m]", " x"):
        with pytest.raises(ArgumentError, match="cannot stand in the header of a table"):
            Table(table(t, [Column(name, "m", t)])).save(tmp_path / "a.csv")
    odd = Table(table(t, [Column('a,"b"\nc', "m", t), Column("é", "", t)]))
    back = la.open(odd.save(tmp_path / "a.csv"))
    assert back['a,"b"\nc'].tolist() == [0.0, 1.0]
    assert back["é"].tolist() == [0.0, 1.0]


# Reading


def test_what_is_no_run(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    for name in ("absent.h5", "absent.npz", "absent.csv", "absent"):
        with pytest.raises(ResultFileError, match=r"cannot read .*absent"):
            la.open(tmp_path / name)
    for name in ("a.h5", "a.npz", "a"):
        (tmp_path / name).write_text("HIERARCHY\nROOT Hips\n", encoding="utf-8")
        with pytest.raises(ResultFileError, match=r"a(\.\w+)? is (damaged|no run)"):
            la.open(tmp_path / name)
    (tmp_path / "robot.xml").write_text("<mujoco/>", encoding="utf-8")
    with pytest.raises(ResultFileError, match=r"robot\.xml is no run and no result.* Models are for leastaction\.load"):
        la.open(tmp_path / "robot.xml")
    (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0")
    with pytest.raises(ResultFileError, match=r"file for MATLAB.*Open the \.h5 or \.npz"):
        la.open(tmp_path / "a.mat")
    with pytest.raises(ResultFileError, match="cannot read"):
        la.open(tmp_path)


def test_hdf5_of_another_program(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["q"] = np.zeros(3)
    with pytest.raises(ResultFileError, match=r"other\.h5 is no result of leastaction: it lacks"):
        la.open(tmp_path / "other.h5")


@pytest.mark.parametrize("share", [0.001, 0.3, 0.7, 0.99])
@pytest.mark.parametrize("ending", [".h5", ".npz"])
def test_a_file_cut_short(run: la.Trajectory, share: float, ending: str, tmp_path: Path) -> None:
    if ending == ".h5":
        pytest.importorskip("h5py")
    path = run.save(tmp_path / f"run{ending}")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultFileError, match=path.name):
        la.open(path)


@pytest.mark.parametrize("ending", [".h5", ".npz"])
def test_a_flipped_bit(ending: str, tmp_path: Path) -> None:
    if ending == ".h5":
        pytest.importorskip("h5py")
    result = optimised()
    path = result.save(tmp_path / f"run{ending}")
    content = bytearray(path.read_bytes())
    content[content.index(result.K.tobytes()) + 100] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(ResultFileError, match=r"damaged|cannot read"):
        la.open(path)


def test_damage_anywhere_in_hdf5_is_a_typed_error_or_none(
    run: la.Trajectory, tmp_path: Path, rng: np.random.Generator
) -> None:
    pytest.importorskip("h5py")
    path = run.save(tmp_path / "run.h5")
    whole = path.read_bytes()
    for _ in range(150):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), size=rng.integers(1, 4)):
            content[place] = rng.integers(256)
        path.write_bytes(content)
        with contextlib.suppress(ResultFileError):
            la.open(path)


def test_links_out_of_the_file_are_not_followed(run: la.Trajectory, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["q"] = np.zeros((5, 4))
    for make in (
        lambda file: file.__setitem__("q", h5py.ExternalLink("secret.h5", "/q")),
        lambda file: file.__setitem__("q", h5py.SoftLink("/t")),
        lambda file: file.create_virtual_dataset("q", _virtual(h5py, tmp_path / "secret.h5")),
        lambda file: file.create_dataset("q", (5, 4), "f8", external=[(str(tmp_path / "raw"), 0, 160)]),
        lambda file: file.create_dataset("q", (10**9, 4), "f8", chunks=(1000, 4), compression="gzip"),
    ):
        path = run.save(tmp_path / "run.h5")
        with h5py.File(path, "a") as file:
            del file["q"]
            make(file)
        with pytest.raises(ResultFileError, match="damaged"):
            la.open(path)


def _virtual(h5py: Any, source: Path) -> Any:
    layout = h5py.VirtualLayout(shape=(5, 4), dtype="f8")
    layout[:] = h5py.VirtualSource(source, "q", shape=(5, 4))
    return layout


def rewritten(path: Path, change: Callable[[dict[str, Any], dict[str, Any]], object]) -> Path:
    """Change text and arrays of a file."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    text = json.loads(str(arrays.pop("leastaction_record")))
    change(text, arrays)
    np.savez(path, leastaction_record=np.array(json.dumps(text)), **arrays)
    return path


NONSENSE: dict[str, tuple[Callable[[dict[str, Any], dict[str, Any]], object], str]] = {
    "newer": (lambda t, _: t.update(format_version=3), "has format 3, this leastaction reads 2. Upgrade"),
    "older": (lambda t, _: t.update(format_version=1), "has format 1"),
    "song": (lambda t, _: t.update(kind="Song"), "holds a Song, expected one of OptimizationResult"),
    "marionette": (lambda t, _: t.update(kind="MarionetteRun"), "marionette.load_run reads it"),
    "a row less": (lambda _, a: a.update(q=a["q"][:-1]), r"q has shape \(4, 4\), expected \(5, 4\)"),
    "no array": (lambda _, a: a.pop("p"), "an array is missing"),
    "NaN": (lambda _, a: a["q"].__setitem__(1, np.nan), "q holds numbers that are not finite"),
    "back in time": (lambda _, a: a.update(t=a["t"][::-1].copy()), "t does not increase"),
    "no status": (lambda t, _: t["content"].update(status="FINE"), "FINE"),
    "other names": (lambda t, _: t["labels"].update(variable=["a", "b", "c", "d"]), "its variables are a, b, c, d"),
    "no mechanism": (lambda t, _: t.update(model="{}"), "its mechanism cannot be made: .*'leastaction' is missing"),
    "broken mechanism": (lambda t, _: t.update(model="{"), "its mechanism cannot be made"),
    "another mechanism": (
        lambda t, _: t.update(model=t["model"].replace("bob/z.1", "bob")),
        "expected those of the mechanism",
    ),
    "units of another type": (lambda t, _: t.update(units=3), "damaged"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_refused_by_name(case: str, run: la.Trajectory, tmp_path: Path) -> None:
    change, message = NONSENSE[case]
    with pytest.raises(ResultFileError, match=message) as caught:
        la.open(rewritten(run.save(tmp_path / "run.npz"), change))
    assert "run.npz" in str(caught.value)


def test_nonsense_about_a_system(tmp_path: Path) -> None:
    result = limited()
    for change, message in (
        ({"split": "middle"}, "the system of its result cannot be made: split: got 'middle'"),
        ({"tolerance": "small"}, "the system of its result cannot be made: Expected `float`"),
        ({"name": "Song"}, "the system of its result cannot be made"),
        ({"at_instants": ["pull"]}, "the system of its result cannot be made: .*'pull'"),
        ({"multipliers": True}, "has the states .* expected those of the mechanism"),
    ):
        path = rewritten(result.save(tmp_path / "a.npz"), lambda text, _, change=change: text["system"].update(change))
        with pytest.raises(ResultFileError, match=message):
            la.open(path)
    tables = Table(table(np.array([0.0, 1.0]), [Column("x", "m", np.zeros(2))]))
    for change, message in (
        (lambda t, _: t["labels"].update(column=["x", "y"]), "values has 1 entries along column, of which there are 2"),
        (lambda _, a: a.pop("values"), "values is no array of 2 dimensions"),
        (lambda t, _: t["units"].update(values=["m", "m"]), "values has 2 units"),
    ):
        with pytest.raises(ResultFileError, match=message):
            la.open(rewritten(tables.save(tmp_path / "b.npz"), change))


TABLES = {
    "empty": ("", "is empty"),
    "only a header": ("t [s],x [m]\n", "holds a header and no numbers"),
    "no time": ("x [m],y\n0,0\n1,1\n", "line 1: the first column is 'x', expected the time"),
    "milliseconds": ("t [ms],x\n0,0\n1,1\n", "line 1: the time is in 'ms', expected seconds"),
    "twice": ("t,x [m],x [rad]\n0,0,0\n1,1,1\n", "line 1: the name 'x' comes twice"),
    "no name": ("t,,x\n0,0,0\n1,1,1\n", "line 1: column 2 has no name"),
    "short line": ("t,x,y\n0,0,0\n1,1\n", "line 3: 2 fields, expected 3 as in the header"),
    "long line": ("t,x\n0,0\n1,1,1\n", "line 3: 3 fields, expected 2"),
    "word": ("# note\nt,x\n0,0\n1,one\n", "line 4: x is 'one', expected a number"),
    "other digits": ("t,x\n0,0\n1,1_0\n", "line 3: x is '1_0'"),
    "back": ("t,x\n0,0\n2,1\n1,2\n", "line 4: the time is 1, expected times that increase"),
    "no time there": ("t,x\n0,0\n,1\n", "line 3: the time is nan"),
    "open quote": ('t,x\n0,"0\n1,1\n', "line 3"),
}


@pytest.mark.parametrize("case", TABLES)
def test_tables_that_are_none(case: str, tmp_path: Path) -> None:
    text, message = TABLES[case]
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ResultFileError, match=message):
        la.open(path)
    with pytest.raises(MotionFileError, match=message):
        la.read_motion(path)


def test_tables_that_are_no_motion(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for text, message in (
        ("t,x [N]\n0,0\n1,1\n", "x is in 'N', expected an angle or a length: rad, m, mm"),
        ("t,x\n0,0\n1,\n", "x is nan at t = 1 s, expected finite values"),
        ("t,x\n0,0\n", "holds 1 instant"),
        ("t\n0\n1\n", "holds no columns but the time"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(MotionFileError, match=message):
            la.read_motion(path)
    path.write_bytes(b"\xff\xfe\x00t")
    with pytest.raises(MotionFileError, match="bytes that are no text"):
        la.read_motion(path)
    for name, right in (("a.bvh", "read_capture"), ("a.amc", "read_capture"), ("a.c3d", "read_markers")):
        with pytest.raises(MotionFileError, match=rf"is a capture.*`leastaction\.io\.{right}` reads it"):
            la.read_motion(tmp_path / name)


def test_streams_are_no_paths(run: la.Trajectory) -> None:
    with pytest.raises(ArgumentError, match=r"Trajectory.save: path: got .* \(BytesIO\), expected a word or a path"):
        run.save(io.BytesIO())  # type: ignore[arg-type]
