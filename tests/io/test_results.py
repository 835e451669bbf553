"""Result files: what goes in comes out, and a damaged or half-written file is never taken for a result."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import errno
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction.errors import ArgumentError, LeastActionError, OutputError, ResultFileError
from leastaction.io.results import load_record, load_result, save_record, save_result
from leastaction.io.results.record import FORMAT_VERSION
from leastaction.mechanics import Damping, Gravity, JointForce, Mechanism, ry, tz
from leastaction.numerics.files import atomic_write, prepare_output_folder, write_text
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal import (
    Bound,
    ContinuousOptimizationResult,
    ContinuousQuadraticCost,
    FunctionSystem,
    OptimizationResult,
    QuadraticCost,
    Status,
    optimize,
)
from leastaction.systems import MechanismSystem

N, ITERATIONS = 20, 3
A, B = np.array([[1.0, 0.1], [-0.4, 1.0]]), np.array([0.0, 0.1])
SYSTEM = FunctionSystem(
    lambda x, u, k: A @ x + B * (2.0 * u[0] + np.sin(u[0])),
    nx=2,
    nu=1,
    N=N,
    derivatives=lambda x, u, k: (A, (B * (2.0 + np.cos(u[0])))[:, None]),
)
COST = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 1)), Q=[1.0, 0.1], R=[1.0])
START = (np.array([1.0, 0.0]), np.zeros((N, 1)))


@pytest.fixture(scope="module")
def result() -> OptimizationResult:
    """Return a result with a number that is none and a text that is no ASCII."""
    found = optimize(SYSTEM, COST, initial=START, max_iterations=ITERATIONS, tolerance=0.0)
    assert found.iterations == ITERATIONS
    return dataclasses.replace(found, status=Status.INTERRUPTED, message="Ünïcode", expected_decrease=np.nan)


def assert_same(first: Any, second: Any) -> None:
    """Hold two dataclasses to each other, field by field, to the last bit."""
    assert type(first) is type(second)
    for field in dataclasses.fields(first):
        was, now = getattr(first, field.name), getattr(second, field.name)
        if dataclasses.is_dataclass(was):
            assert_same(was, now)
        elif isinstance(was, (np.ndarray, float)):
            np.testing.assert_array_equal(now, was, err_msg=field.name)
            assert np.asarray(now).dtype == np.asarray(was).dtype
        else:
            assert now == was, field.name


def test_a_result_comes_back_as_it_was(result: OptimizationResult, tmp_path: Path) -> None:
    back = load_result(save_result(tmp_path / "a.npz", result))
    assert_same(result, back)
    # And through a second file nothing changes any more.
    assert_same(back, load_result(save_result(tmp_path / "b.npz", back)))
    record = load_record(tmp_path / "a.npz", OptimizationResult)
    assert {"leastaction", "numpy", "scipy", "python"} <= record.provenance.versions.keys()
    assert record.provenance.created.startswith("20")


def test_the_coarsest_step_comes_back(result: OptimizationResult, tmp_path: Path) -> None:
    for worst in (StepQuality(0.5, 1.25, 0.1, "crank"), StepQuality(0.5, np.nan, 0.0)):
        known = dataclasses.replace(result, worst_step=worst)
        back = load_result(save_result(tmp_path / "a.npz", known)).worst_step
        assert repr(back) == repr(worst)


def test_a_file_of_before_the_coarsest_step_was_known(result: OptimizationResult, tmp_path: Path) -> None:
    path = save_result(tmp_path / "a.npz", result)

    def older(text: dict[str, Any], arrays: dict[str, Any]) -> None:
        for name in ("worst_s", "worst_t"):
            del text["content"]["history"][name], arrays[f"history.{name}"]
        del text["content"]["worst_step"]

    rewrite(path, older)
    back = load_result(path)
    assert back.worst_step is None
    assert np.isnan(back.history.worst_s).all()
    assert len(back.history.worst_t) == ITERATIONS


def test_a_file_whose_options_switch_off_ways_that_are_none_any_more(
    result: OptimizationResult, tmp_path: Path
) -> None:
    settings = result.settings.changed(without=["easing"])
    path = save_result(tmp_path / "a.npz", dataclasses.replace(result, settings=settings))
    rewrite(path, lambda text, _: text["content"]["settings"].update(without=["given", "easing", "prices"]))
    assert load_result(path).settings == settings


def test_an_optimisation_goes_on_from_its_file(tmp_path: Path) -> None:
    whole = optimize(SYSTEM, COST, initial=START)
    half = optimize(SYSTEM, COST, initial=START, max_iterations=2)
    rest = optimize(SYSTEM, COST, resume=load_result(save_result(tmp_path / "half.npz", half)))
    assert whole.success
    assert whole.iterations > 2
    np.testing.assert_array_equal(rest.x, whole.x)
    np.testing.assert_array_equal(rest.K, whole.K)


def test_numpy_alone_reads_it(result: OptimizationResult, tmp_path: Path) -> None:
    path = save_record(tmp_path / "a.npz", result, arrays={"q": np.arange(3.0)})
    with np.load(path, allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["q"], [0.0, 1.0, 2.0])
        np.testing.assert_array_equal(archive["history.cost"], result.history.cost)
        assert json.loads(str(archive["leastaction_record"]))["content"]["status"] == "INTERRUPTED"


# Damaged files


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.97, 0.999])
def test_a_file_cut_short_is_refused(result: OptimizationResult, tmp_path: Path, share: float) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultFileError, match=r"trajectory\.npz"):
        load_result(path)


def test_a_flipped_bit_is_refused(result: OptimizationResult, tmp_path: Path) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    content = bytearray(path.read_bytes())
    where = content.index(result.K.tobytes()) + 100
    content[where] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(ResultFileError, match="damaged"):
        load_result(path)


def test_files_that_are_not_ours(tmp_path: Path) -> None:
    text, array, other, pickled = (tmp_path / name for name in ("a.npz", "b.npy", "c.npz", "d.npy"))
    text.write_text("HIERARCHY\nROOT Hips\n", encoding="utf-8")
    np.save(array, np.zeros(3))
    np.savez(other, q=np.zeros(3))
    np.save(pickled, np.array([{}], dtype=object), allow_pickle=True)
    for path in (text, array, other, pickled):
        with pytest.raises(ResultFileError, match=path.name):
            load_result(path)
    os.mkfifo(tmp_path / "pipe")
    for name in ("absent.npz", "", "pipe"):
        with pytest.raises(ResultFileError, match="cannot read"):
            load_result(tmp_path / name)


def rewrite(path: Path, change: Callable[[dict[str, Any], dict[str, Any]], object]) -> None:
    """Change text and arrays of a result file."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    text = json.loads(str(arrays.pop("leastaction_record")))
    change(text, arrays)
    np.savez(path, leastaction_record=np.array(json.dumps(text)), **arrays)


NONSENSE: dict[str, tuple[Callable[[dict[str, Any], dict[str, Any]], object], str]] = {
    "NaN": (lambda _, a: a["x"].__setitem__(1, np.nan), "x holds numbers that are not finite"),
    "complex": (lambda _, a: a.update(x=a["x"] + 1j), r"complex128, expected float64.*\$\.x"),
    "single": (lambda _, a: a.update(u=a["u"].astype("f4")), "float32, expected float64"),
    "texts": (lambda _, a: a.update(u=a["u"].astype(str)), "expected float64"),
    "fractions of roll-outs": (
        lambda _, a: a.update({"history.rollouts": np.full(ITERATIONS, 0.5)}),
        "float64, expected int64",
    ),
    "a row less": (lambda _, a: a.update(K=a["K"][:-1]), "K has shape"),
    "no rows": (lambda _, a: a.update(u=np.zeros(()), x=np.zeros(())), "damaged"),
    "one dimension": (lambda _, a: a.update(u=np.zeros(3)), "contradicts itself"),
    "another start": (
        lambda _, a: a.update({"state.begun.given.u": np.zeros((2, 2))}),
        "state.begun.given.u has shape",
    ),
    "no array": (lambda _, a: a.pop("K"), r"an array is missing.*\$\.K"),
    "short history": (
        lambda _, a: a.update({"history.cost": np.zeros(2)}),
        "history.cost has 2 entries, expected 4",
    ),
    "number for a text": (lambda t, _: t["content"].update(message=3), "`str`, got `int`"),
    "text for a number": (lambda t, _: t["content"].update(cost="1"), "`float`, got `str`"),
    "unknown status": (lambda t, _: t["content"].update(status="FINE"), "FINE"),
    "status of another type": (lambda t, _: t["content"].update(status=[1]), "damaged"),
    "list for a table": (lambda t, _: t["content"].update(history=[]), "damaged"),
    "no settings": (lambda t, _: t["content"].pop("settings"), "settings"),
    "no content": (lambda t, _: t.pop("content"), "content"),
    "no version": (lambda t, _: t.pop("format_version"), "format_version"),
    "version of another type": (lambda t, _: t.update(format_version="2"), "format_version"),
    "version 0": (lambda t, _: t.update(format_version=0), "format_version"),
    "another format": (lambda t, _: t.update(format="leastaction song"), "format"),
    "another kind": (lambda t, _: t.update(kind="Song"), "holds a Song, expected"),
    "array over a table": (lambda _, a: a.update(history=np.zeros(3)), "damaged"),
    "array over a number": (lambda _, a: a.update(cost=np.zeros(3)), "damaged"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_is_refused_by_name(result: OptimizationResult, tmp_path: Path, case: str) -> None:
    change, message = NONSENSE[case]
    path = save_result(tmp_path / "trajectory.npz", result)
    rewrite(path, change)
    with pytest.raises(ResultFileError, match=message) as caught:
        load_result(path)
    assert "trajectory.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_formats_say_what_to_do(result: OptimizationResult, tmp_path: Path) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    newer = {"format_version": FORMAT_VERSION + 1, "versions": {"leastaction": "9.9"}}
    rewrite(path, lambda text, _: text.update(newer))
    with pytest.raises(ResultFileError, match=r"Upgrade leastaction.*9\.9"):
        load_result(path)
    rewrite(path, lambda text, _: text.update(newer | {"format_version": 1}))
    with pytest.raises(ResultFileError, match=r"has format 1, .*Run the optimisation again"):
        load_result(path)


def header(shape: str, dtype: str = "<f8") -> bytes:
    """Return the beginning of a NumPy file of that shape."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


BYTES: dict[str, bytes] = {
    "gigantic": header("(1000000000000,)"),
    "beyond all integers": header(f"({10**30},)"),
    "negative": header("(-3,)"),
    "many dimensions": header("(" + "1, " * 100 + ")") + bytes(8),
    "nothing": header("(0, 1000000000000)", "<U0"),
    "nested": header("(" * 300 + ")" * 300),
    "objects": header("(1,)", "|O") + bytes(8),
    "structures": header("(1,)", "V8") + bytes(8),
    "no header": b"\x93NUMPY",
    "unknown version": b"\x93NUMPY\x09\x00" + bytes(100),
    "no array": b"hello",
    "empty": b"",
    "more than it says": header("(1,)") + bytes(800),
}


@pytest.mark.parametrize("case", BYTES)
@pytest.mark.parametrize("name", ["x.npy", "leastaction_record.npy"])
def test_arrays_that_cannot_be(result: OptimizationResult, tmp_path: Path, case: str, name: str) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    replace_entry(path, name, BYTES[case])
    with pytest.raises(ResultFileError, match=r"trajectory\.npz"):
        load_result(path)


def replace_entry(path: Path, name: str, content: bytes, *, compression: int = zipfile.ZIP_STORED) -> None:
    with zipfile.ZipFile(path) as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()}
    with zipfile.ZipFile(path, "w", compression) as archive:
        for entry, old in entries.items():
            archive.writestr(entry, content if entry == name else old)


@pytest.mark.parametrize(
    "text",
    [
        np.array(3),
        np.array([["{}"]]),
        np.array(b"{}"),
        np.array(["a", "b"]),
        np.array("[" * 100_000 + "]" * 100_000),
        np.array('{"a":' * 100_000),
        np.array("{"),
        np.array("null"),
        np.array("{}"),
        np.array("\ud800"),
    ],
    ids=lambda text: str(text)[:8],
)
def test_odd_texts(result: OptimizationResult, tmp_path: Path, text: np.ndarray) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    np.savez(path, **{**arrays, "leastaction_record": text})
    with pytest.raises(ResultFileError, match=r"trajectory\.npz"):
        load_result(path)


def test_nothing_unfolds(result: OptimizationResult, tmp_path: Path) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    # A gigabyte of zeros in a megabyte: refused by what it claims, before a byte of it is read.
    bomb = header("(134217728,)") + bytes(2**27)
    for compression in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        replace_entry(path, "x.npy", bomb, compression=compression)
        with pytest.raises(ResultFileError, match="is compressed"):
            load_result(path)
        save_result(path, result)
    # An entry that says it is larger than the whole file.
    content = bytearray(path.read_bytes())
    directory = content.index(b"PK\x01\x02")
    for offset in (20, 24):
        content[directory + offset : directory + offset + 4] = (2**31).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(ResultFileError, match="claims to hold"):
        load_result(path)


def test_damage_anywhere_is_a_typed_error_or_none(
    result: OptimizationResult, tmp_path: Path, rng: np.random.Generator
) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    whole = path.read_bytes()
    for _ in range(600):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), size=rng.integers(1, 4)):
            content[place] = rng.integers(256)
        path.write_bytes(content)
        with contextlib.suppress(ResultFileError):
            load_result(path)


# Writing


def swung(limits: list[Bound], **options: Any) -> OptimizationResult:
    """Swing a pendulum in continuous time, with a bounded torque or without."""
    pendulum = Mechanism([ry("a"), [tz(-0.5, mass=1.0)]], [Gravity(), JointForce("a", input="motor"), Damping(0.1)])
    cost = ContinuousQuadraticCost([1.0, 0.0], [0.0], Q=[10.0, 0.1], R=[0.1])
    if "resume" not in options:
        options |= {"initial": ([0.0, 0.0], [0.0]), "horizon": (0.0, 1.0)}
    return optimize(MechanismSystem(pendulum), cost, limits=limits, **options)


@pytest.mark.parametrize("limits", [[], [Bound("motor", -3.0, 3.0)]], ids=["free", "limits"])
def test_a_result_in_continuous_time_comes_back(limits: list[Bound], tmp_path: Path, rng: np.random.Generator) -> None:
    part = swung(limits, max_iterations=2)
    path = save_result(tmp_path / "part.npz", part)
    loaded = load_result(path)
    assert isinstance(loaded, ContinuousOptimizationResult)
    assert isinstance(part, ContinuousOptimizationResult)
    assert (loaded.status, loaded.accuracy, loaded.jumps) == (part.status, part.accuracy, part.jumps)
    times = np.linspace(0.0, 1.0, 77)
    for one, other in ((loaded.dense.xu, part.dense.xu), (loaded.feedback, part.feedback)):
        np.testing.assert_array_equal(one(times), other(times))
    assert str(loaded.limits) == str(part.limits)
    assert not loaded.t.flags.writeable
    # What goes on from the file is what goes on from the result itself.
    rest, expected = (swung(limits, resume=each) for each in (loaded, part))
    assert rest.success, rest.message
    np.testing.assert_array_equal(rest.x, expected.x)
    np.testing.assert_array_equal(rest.u, expected.u)
    assert rest.iterations == expected.iterations
    # An existing file is replaced in one step, and what is damaged says so.
    assert load_result(save_result(path, rest)).cost == rest.cost
    assert list(tmp_path.iterdir()) == [path]
    whole = path.read_bytes()
    for _ in range(100):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), size=2):
            content[place] = rng.integers(256)
        path.write_bytes(content)
        with contextlib.suppress(ResultFileError):
            load_result(path)


def test_what_contradicts_itself_in_continuous_time_is_named(tmp_path: Path) -> None:
    part = swung([], max_iterations=1)
    assert isinstance(part, ContinuousOptimizationResult)
    fewer = PiecewisePolynomial(part.feedback.breaks[:-1], part.feedback.coefficients, part.feedback.shape)
    backwards = PiecewisePolynomial(part.feedback.breaks[::-1].copy(), part.feedback.coefficients, part.feedback.shape)
    for changes, what in (
        ({"t": part.t[1:]}, "x has shape"),
        ({"feedback": fewer}, r"feedback\.coefficients has shape"),
        ({"feedback": backwards}, r"feedback\.breaks does not increase"),
        ({"projection": part.feedback}, r"projection is of shape \(1, 2\), expected \(3,\)"),
        ({"x": np.full_like(part.x, np.inf)}, "x holds numbers that are not finite"),
    ):
        path = save_result(tmp_path / "changed.npz", dataclasses.replace(part, **changes))  # type: ignore[arg-type]
        with pytest.raises(ResultFileError, match=what):
            load_result(path)


def test_what_cannot_be_saved_is_refused_before_writing(result: OptimizationResult, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.npz"
    settings = copy.copy(result.settings)
    object.__setattr__(settings, "method", object())  # which no `Options` that was made takes
    with pytest.raises(ArgumentError):
        save_result(path, dataclasses.replace(result, settings=settings))
    with pytest.raises(ArgumentError, match=r"OptimizationResult: x: .* expected an array of numbers"):
        dataclasses.replace(result, x=np.array([object()]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_a_write_that_breaks_off_leaves_the_old_file(
    result: OptimizationResult,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    failure: BaseException,
) -> None:
    path = save_result(tmp_path / "trajectory.npz", result)
    before = path.read_bytes()

    def half_a_file(stream: Any, **arrays: Any) -> None:
        stream.write(b"PK half a file")
        raise failure

    monkeypatch.setattr(np, "savez", half_a_file)
    with pytest.raises((KeyboardInterrupt, OutputError)) as caught:
        save_result(path, result)
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


def test_settings_out_of_range_are_refused_when_a_file_is_read(result: OptimizationResult, tmp_path: Path) -> None:
    settings = copy.copy(result.settings)
    object.__setattr__(settings, "beta", 2.0)
    path = save_result(tmp_path / "trajectory.npz", dataclasses.replace(result, settings=settings))
    with pytest.raises(ResultFileError, match="beta"):
        load_result(path)
