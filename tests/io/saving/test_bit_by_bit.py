"""What is saved comes back as it was, to the last bit, with its mechanism."""

from __future__ import annotations

import dataclasses
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import leastaction as la
from api.saving_cases import CASES, cost, optimised, optimised_continuously, system
from leastaction.errors import ArgumentError, ResultFileError
from leastaction.io import load_result, save_result
from leastaction.mechanics import PythonFunction, PythonPotential

DATA = Path(__file__).parents[1] / "data"
FUNCTIONS = {"dense", "law"}  # which no file can hold


def assert_same(first: Any, second: Any, where: str = "") -> None:
    """Hold two values to each other, with all that they are made of."""
    assert type(first) is type(second), where
    if isinstance(first, np.ndarray):
        assert first.dtype == second.dtype, where
        assert first.tobytes() == second.tobytes(), where
        assert second.flags.writeable <= first.flags.writeable, where
    elif isinstance(first, la.Mechanism):
        assert first == second
        assert (first.core.numbers == second.core.numbers).all()
    elif isinstance(first, (str, int, Enum, type(None))):
        assert first == second, where
    elif isinstance(first, float):
        assert np.float64(first).tobytes() == np.float64(second).tobytes(), where
    elif isinstance(first, (tuple, list)):
        assert len(first) == len(second), where
        for i, (one, other) in enumerate(zip(first, second, strict=True)):
            assert_same(one, other, f"{where}[{i}]")
    elif hasattr(first, "keys"):
        assert list(first) == list(second), where
        for key in first:
            assert_same(first[key], second[key], f"{where}[{key}]")
    elif isinstance(first, la.MidpointVI):
        assert_same(first._settings, second._settings, where)
        assert_same(first.mechanism, second.mechanism, where)
    else:
        names = (
            [field.name for field in dataclasses.fields(first)]
            if dataclasses.is_dataclass(first)
            else list(vars(first))
        )
        assert names, where
        for name in names:
            given = getattr(first, name)
            if not (isinstance(first, la.ContinuousTrajectory) and name in FUNCTIONS) and name not in (
                "core",
                "created",
            ):
                assert_same(given, getattr(second, name), f"{where}.{name}")


@pytest.mark.parametrize("ending", [".npz", ".h5", ".hdf5"])
@pytest.mark.parametrize("case", CASES)
def test_it_comes_back(case: str, ending: str, tmp_path: Path) -> None:
    if ending != ".npz":
        pytest.importorskip("h5py")
    given = CASES[case]()
    path = given.save(tmp_path / f"a{ending}")
    back = la.open(path)
    assert_same(given, back)
    # And through a second file nothing changes any more.
    again = la.open(back.save(tmp_path / f"b{ending}"))
    assert_same(back, again)
    if isinstance(given, la.OptimizationResult):
        assert (back.system is None) == (given.system is None)
        if given.system is not None:
            assert_same(given.trajectory, back.trajectory)


@pytest.mark.parametrize("case", ["simulated", "limited", "optimised continuously", "of functions"])
def test_both_kinds_hold_the_same(case: str, tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    given = CASES[case]()
    assert_same(la.open(given.save(tmp_path / "a.h5")), la.open(given.save(tmp_path / "a.npz")))


def test_runs_go_on_from_a_file_as_they_would_have(tmp_path: Path) -> None:
    problem = system()
    whole = optimised(max_iterations=3)
    part = la.open(optimised(max_iterations=1).save(tmp_path / "part.npz"))
    assert isinstance(part, la.OptimizationResult)
    rest = la.optimize(problem, cost(problem), resume=part, max_iterations=2)
    assert rest.x.tobytes() == whole.x.tobytes()
    assert rest.K.tobytes() == whole.K.tobytes()
    assert isinstance(part.system, la.MidpointSystem)
    # And with nothing but the file.
    alone = la.optimize(part.system, cost(part.system), resume=part, max_iterations=2)
    assert alone.x.tobytes() == whole.x.tobytes()
    half = la.open(optimised_continuously().save(tmp_path / "half.npz"))
    weights = la.ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
    more = la.optimize(half.system, weights, resume=half, max_iterations=1)
    assert more.x.tobytes() == optimised_continuously(max_iterations=2).x.tobytes()


class Bent(PythonFunction):
    """A potential that no file can say."""

    def value(self, z):
        return z[0] ** 2

    def gradient(self, z):
        return 2.0 * z

    def hessian(self, z):
        return np.array([[2.0]], dtype=z.dtype)


def test_a_mechanism_with_functions_is_given_anew(tmp_path: Path) -> None:
    m = la.Mechanism(
        [la.tx("x", name="block", mass=1.0)], [PythonPotential(Bent(), variables=["x"]), la.JointForce("x", "push")]
    )
    vi = la.MidpointVI(m)
    run = vi.simulate(vi.start(m.configuration({"x": 0.1})), [0.0, 0.1, 0.2])
    path = run.save(tmp_path / "run.npz")
    with pytest.raises(ResultFileError, match=r"holds no mechanism.*mechanism=\.\.\."):
        la.open(path)
    back = la.open(path, mechanism=m)
    assert isinstance(back, la.Trajectory)
    assert back.q.tobytes() == run.q.tobytes()
    other = la.Mechanism([la.tx("y", name="block", mass=1.0)])
    with pytest.raises(ResultFileError, match="its variables are x, expected those of the mechanism: y"):
        la.open(path, mechanism=other)
    problem = la.MidpointSystem(vi, [0.0, 0.1, 0.2])
    result = la.optimize(problem, cost(problem), initial=([0.1, 0.0], np.zeros((2, 1))), max_iterations=1)
    path = result.save(tmp_path / "result.npz")
    alone = la.open(path)
    assert alone.x.tobytes() == result.x.tobytes()
    assert alone.state_names == ("x", "p_x")
    with pytest.raises(ArgumentError, match="knows no mechanism"):
        _ = alone.trajectory
    assert la.open(path, mechanism=m).trajectory.q.tobytes() == result.trajectory.q.tobytes()
    with pytest.raises(ResultFileError, match=r"has the states x, p_x .* expected those of the mechanism: y, p_y"):
        la.open(path, mechanism=other)
    with pytest.raises(ArgumentError, match="mechanism: got str, expected a Mechanism"):
        la.open(path, mechanism="m.yaml")


# Files of earlier versions, read for ever


@pytest.mark.parametrize(
    "name", sorted(path.name for path in DATA.glob("*_*.npz")) + sorted(p.name for p in DATA.glob("*.h5"))
)
def test_files_of_earlier_versions(name: str) -> None:
    if name.endswith(".h5"):
        pytest.importorskip("h5py")
    found = la.open(DATA / name)
    if isinstance(found, la.OptimizationResult):
        assert found.iterations >= 1
        assert np.isfinite(found.x).all()
        if name.startswith("format_2"):  # of before names and times were known
            assert found.system is None
            assert found.state_names == ("x[0]", "x[1]")
            assert found.t[-1] == (4.0 if "discrete" in name else 0.2)
        else:
            assert isinstance(found.trajectory, (la.Trajectory, la.ContinuousTrajectory))
            assert "elbow" in found.state_names
    else:
        assert isinstance(found, la.Trajectory)
        assert found["elbow"].shape == found.t.shape
    result = load_result(DATA / "format_2_discrete.npz")
    assert result.limits is not None
    # What it had in one memory is the state of each part now.
    assert result.state is not None
    assert result.state.begun.given is not None
    np.testing.assert_array_equal(result.state.begun.given.x, [0.3, 0.0])


def test_the_older_names_do_the_same(tmp_path: Path) -> None:
    result = optimised()
    assert_same(result, load_result(save_result(tmp_path / "a.npz", result)))
    run = CASES["simulated"]()
    with pytest.raises(ResultFileError, match="holds a Trajectory, expected the result of an optimisation"):
        load_result(run.save(tmp_path / "run.npz"))
    with pytest.raises(ArgumentError, match="got Trajectory"):
        save_result(tmp_path / "b.npz", run)
