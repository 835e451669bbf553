"""The result file: what goes in comes out, and a damaged or half-written file is never taken for a run."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction.errors import ArgumentError, LeastActionError, OutputError, ResultFileError
from leastaction.io.results.files import FORMAT_VERSION, load_record, save_record
from leastaction.io.results.record import RunRecord
from leastaction.numerics.files import atomic_write, prepare_output_folder, write_text

N, ND, NRHO, NF, NC = 6, 3, 2, 1, 2


@pytest.fixture
def record(rng: np.random.Generator) -> RunRecord:
    nu, nx = NF + NRHO, 2 * (ND + NRHO)
    return RunRecord(
        mechanism="two strings",
        variables=("x", "y", "theta", "left-length", "right-length"),
        n_dynamic=ND,
        inputs=("torque", "left-length", "right-length"),
        constraints=("left", "right"),
        t=np.linspace(0.0, 0.06, N + 1),
        q=rng.normal(size=(N + 1, ND + NRHO)),
        p=rng.normal(size=(N + 1, ND)),
        v=rng.normal(size=(N + 1, NRHO)),
        u=rng.normal(size=(N, nu)),
        lam=rng.normal(size=(N, NC)),
        x=rng.normal(size=(N + 1, nx)),
        K=rng.normal(size=(N, nu, nx)),
        q_wanted=rng.normal(size=(N + 1, ND + NRHO)),
        tension=rng.normal(size=(N, NC)),
        histories={"cost": np.array([3.0, 2.0]), "method": np.array(["quasi-newton", "newton"])},
        settings={"dt": 0.01, "weights": [1.0, 2.0], "note": "Ünïcode"},
        status="converged",
        message="The expected decrease is below 1e-6.",
    )


def test_everything_comes_back(record: RunRecord, tmp_path: Path) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    back = load_record(path)
    for field in dataclasses.fields(RunRecord):
        was, now = getattr(record, field.name), getattr(back, field.name)
        if isinstance(was, np.ndarray):
            np.testing.assert_array_equal(now, was, err_msg=field.name)
            assert now.dtype == was.dtype
        elif field.name == "histories":
            assert now.keys() == was.keys()
            assert all(np.array_equal(now[key], was[key]) for key in was)
        elif field.name not in ("versions", "created"):
            assert now == was, field.name
    assert {"leastaction", "numpy", "scipy", "python"} <= back.versions.keys()
    assert back.created.startswith("20")
    # And through a second file nothing changes any more.
    again = load_record(save_record(tmp_path / "again.npz", back))
    assert (again.created, again.versions) == (back.created, back.versions)


def test_numpy_alone_reads_it(record: RunRecord, tmp_path: Path) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    with np.load(path, allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["rho"], record.q[:, ND:])
        np.testing.assert_array_equal(archive["history_cost"], [3.0, 2.0])
        assert json.loads(str(archive["leastaction_record"]))["variables"] == list(record.variables)


def test_variables_by_name(record: RunRecord) -> None:
    np.testing.assert_array_equal(record.variable("theta"), record.q[:, 2])
    np.testing.assert_array_equal(record.rho, record.q[:, ND:])
    with pytest.raises(ArgumentError, match=r"'thet'.*there are: x, y, theta"):
        record.variable("thet")


@pytest.mark.parametrize("name", ["t", "q", "p", "v", "u", "lam", "x", "K", "q_wanted", "tension"])
def test_a_wrong_shape_is_named(record: RunRecord, name: str) -> None:
    with pytest.raises(ArgumentError, match=rf"^{'q' if name == 't' else name} has shape"):
        dataclasses.replace(record, **{name: getattr(record, name)[:-1]})


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.97, 0.999])
def test_a_file_cut_short_is_refused(record: RunRecord, tmp_path: Path, share: float) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultFileError, match=r"trajectory\.npz"):
        load_record(path)


def test_a_flipped_bit_is_refused(record: RunRecord, tmp_path: Path) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    content = bytearray(path.read_bytes())
    where = content.index(record.K.tobytes()) + 100
    content[where] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(ResultFileError, match="damaged"):
        load_record(path)


def test_files_that_are_not_ours(tmp_path: Path) -> None:
    text, array, other, pickled = (tmp_path / name for name in ("a.npz", "b.npy", "c.npz", "d.npy"))
    text.write_text("HIERARCHY\nROOT Hips\n", encoding="utf-8")
    np.save(array, np.zeros(3))
    np.savez(other, q=np.zeros(3))
    np.save(pickled, np.array([{}], dtype=object), allow_pickle=True)
    for path in (text, array, other, pickled):
        with pytest.raises(ResultFileError, match=path.name):
            load_record(path)
    with pytest.raises(ResultFileError, match="cannot read"):
        load_record(tmp_path / "absent.npz")
    with pytest.raises(ResultFileError, match="cannot read"):
        load_record(tmp_path)


def _rewrite(path: Path, change: dict[str, Any], *, drop: str = "") -> None:
    """Change the header of a result file, and leave out one array."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if name != drop}
    arrays["leastaction_record"] = np.array(
        json.dumps(json.loads(str(arrays["leastaction_record"])) | change)
    )
    np.savez(path, **arrays)


def test_a_newer_format_asks_for_an_upgrade(record: RunRecord, tmp_path: Path) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    _rewrite(path, {"format_version": FORMAT_VERSION + 1, "versions": {"leastaction": "9.9"}})
    with pytest.raises(ResultFileError, match=r"Upgrade leastaction.*9\.9"):
        load_record(path)


def test_an_incomplete_or_contradictory_file(record: RunRecord, tmp_path: Path) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    _rewrite(path, {}, drop="K")
    with pytest.raises(ResultFileError, match="lacks K"):
        load_record(path)
    save_record(path, record)
    _rewrite(path, {"n_dynamic": 4})
    with pytest.raises(ResultFileError, match="contradicts itself"):
        load_record(path)
    save_record(path, record)
    _rewrite(path, {}, drop="tension")
    assert load_record(path).tension is None


def test_what_cannot_be_saved_is_refused_before_writing(record: RunRecord, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.npz"
    for bad in ({"settings": {"f": object()}}, {"histories": {"step": np.array([object()])}}):
        with pytest.raises(ArgumentError):
            save_record(path, dataclasses.replace(record, **bad))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "failure", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")]
)
def test_a_write_that_breaks_off_leaves_the_old_file(
    record: RunRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    path = save_record(tmp_path / "trajectory.npz", record)
    before = path.read_bytes()

    def half_a_file(stream: Any, **arrays: Any) -> None:
        stream.write(b"PK half a file")
        raise failure

    monkeypatch.setattr(np, "savez", half_a_file)
    with pytest.raises((KeyboardInterrupt, OutputError)) as caught:
        save_record(path, dataclasses.replace(record, status="stopped"))
    if isinstance(failure, OSError):
        assert "No space left on device" in str(caught.value)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["trajectory.npz"]


def test_a_write_that_breaks_off_leaves_no_new_file(tmp_path: Path) -> None:
    def write_half() -> None:
        with atomic_write(tmp_path / "new.bin") as stream:
            stream.write(b"half")
            raise RuntimeError("killed")

    with pytest.raises(RuntimeError, match="killed"):
        write_half()
    assert list(tmp_path.iterdir()) == []


def test_files_get_the_usual_permissions(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.write_text("", encoding="utf-8")
    assert write_text(tmp_path / "atomic", "text").stat().st_mode == plain.stat().st_mode


def test_output_folder_is_made_and_left_empty(tmp_path: Path) -> None:
    folder = prepare_output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert list(folder.iterdir()) == []
    assert prepare_output_folder(folder) == folder


def test_output_folder_that_is_a_file_or_under_one(tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="is a file"):
        prepare_output_folder(file)
    with pytest.raises(OutputError, match="cannot make") as caught:
        prepare_output_folder(file / "below")
    assert isinstance(caught.value, LeastActionError)
    assert file.read_text(encoding="utf-8") == "mine"
    with pytest.raises(OutputError, match="cannot write"):
        write_text(tmp_path / "absent" / "x.txt", "text")


def test_output_folder_that_refuses_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Permissions do not stop a test that runs as root, so the refusal itself is made.
    def refuse(path: Path, content: bytes) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError, match=r"cannot write into.*Permission denied"):
        prepare_output_folder(tmp_path)
