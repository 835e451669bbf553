"""What other programs read: tables, MATLAB's files, HDF5 by itself, pandas and xarray."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import leastaction as la
from api.saving_cases import arm, integrated, limited, optimised, optimised_continuously, played, simulated
from leastaction.errors import ArgumentError, MissingExtraError, OutputError
from leastaction.io import Motion
from leastaction.numerics import extras
from leastaction.numerics.dataset import Table

UNITS = {
    "side": "m", "bob/z.1": "m", "arm": "rad", "hook": "m", "p_side": "kg m/s", "p_bob/z.1": "kg m/s",
    "p_arm": "kg m^2/s", "v_hook": "m/s", "push": "N", "motor": "N m", "string.1/a": "N s/m",
}  # fmt: skip


def test_a_table_has_names_units_and_every_digit(tmp_path: Path) -> None:
    run = simulated()
    path = run.save(tmp_path / "run.csv")
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    assert header == ["t [s]", *(f"{name} [{unit}]" for name, unit in UNITS.items())]
    columns = dict(zip(header, zip(*rows, strict=True), strict=True))
    assert [float(each) for each in columns["side [m]"]] == run["side"].tolist()
    assert [float(each) for each in columns["t [s]"]] == run.t.tolist()
    # What belongs to steps is blank at the last instant.
    assert columns["push [N]"][-1] == ""
    assert [float(each) for each in columns["push [N]"][:-1]] == run["push"].tolist()
    table = la.open(path)
    assert isinstance(table, Table)
    for name in ("side", "arm", "p_arm", "hook"):
        assert table[name].tobytes() == np.ascontiguousarray(run[name] if name[:2] != "p_" else run.p[:, 2]).tobytes()
    assert np.isnan(table["motor"][-1])
    assert {column.name: column.unit for column in table.columns} == UNITS
    with pytest.raises(ArgumentError, match="unknown name 'sid'; did you mean 'side'"):
        table["sid"]


def test_names_that_states_and_inputs_share_are_told_apart(tmp_path: Path) -> None:
    result = optimised()
    names = [column.name for column in result.dataset().columns]
    assert names == [*result.state_names, "push", "motor", "u.hook", "string.1/a"]
    np.testing.assert_array_equal(result.dataset()["u.hook"], result.u[:, 2])
    np.testing.assert_array_equal(result.dataset()["hook"], result["hook"])
    table = la.open(result.save(tmp_path / "result.csv"))
    np.testing.assert_array_equal(table["u.hook"][:-1], result.u[:, 2])


def test_pandas() -> None:
    pd = pytest.importorskip("pandas")
    result = optimised()
    frame = result.to_pandas()
    assert isinstance(frame, pd.DataFrame)
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame.index, result.t)
    np.testing.assert_array_equal(frame["arm"], result["arm"])
    np.testing.assert_array_equal(frame["motor"].to_numpy()[:-1], result["motor"])
    assert np.isnan(frame["motor"].iloc[-1])
    assert frame.attrs["units"]["string.1/a"] == "N s/m"
    assert frame.attrs["units"]["u.hook"] == "m"
    frame["arm"] = 0.0  # it is the reader's own
    made = integrated().to_pandas()
    assert {"a_arm", "v_arm", "arm", "motor", "string.1/a"} <= set(made.columns)
    assert made.attrs["units"]["a_arm"] == "rad/s^2"
    assert not made.isna().any().any()
    assert list(played().to_pandas().columns) == ["elbow", "p_elbow", "motor"]
    assert list(optimised_continuously().to_pandas().columns) == ["elbow", "v_elbow", "motor"]


def test_xarray() -> None:
    xr = pytest.importorskip("xarray")
    result = limited()
    found = result.to_xarray()
    assert isinstance(found, xr.Dataset)
    assert found["x"].dims == ("time", "state")
    assert found["u"].dims == ("step", "input")
    assert found["K"].dims == ("step", "input", "state")
    assert found["lam"].dims == ("step", "constraint")
    np.testing.assert_array_equal(found["time"], result.t)
    np.testing.assert_array_equal(found["x"].sel(state="arm"), result["arm"])
    np.testing.assert_array_equal(found["K"].sel(input="motor", state="p_arm"), result.K[:, 1, 6])
    assert str(found["x_units"].sel(state="p_arm").values) == "kg m^2/s"
    assert found["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(found["history.cost" if "history.cost" in found else "cost"], result.history.cost)
    again = optimised_continuously().to_xarray()
    assert again["x"].dims == ("time", "state")
    assert again["u"].dims == ("time", "input")


def test_matlab(tmp_path: Path) -> None:
    result = optimised()
    content = loadmat(result.save(tmp_path / "result.mat"), simplify_cells=True)
    np.testing.assert_array_equal(content["t"], result.t)
    np.testing.assert_array_equal(content["columns"]["arm"], result["arm"])
    np.testing.assert_array_equal(content["columns"]["bob_z_1"], result["bob/z.1"])
    np.testing.assert_array_equal(content["arrays"]["K"], result.K)
    np.testing.assert_array_equal(content["arrays"]["history_cost"], result.history.cost)
    assert content["names"]["bob_z_1"] == "bob/z.1"
    assert content["units"]["arm"] == "rad"
    assert list(content["labels"]["state"]) == list(result.state_names)


def test_hdf5_by_itself(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    result = limited()
    with h5py.File(result.save(tmp_path / "result.h5")) as file:
        np.testing.assert_array_equal(file["x"], result.x)
        np.testing.assert_array_equal(file["history/cost"], result.history.cost)
        assert list(file["x"].attrs["names of state"]) == list(result.state_names)
        assert list(file["x"].attrs["units"]) == list(result.state_units)
        assert list(file["K"].attrs["dimensions"]) == ["step", "input", "state"]
        assert file["t"].attrs["units"] == "s"
        text = json.loads(file["leastaction_record"].asstr()[()])
    assert text["format_version"] == 2
    assert text["content"]["status"] == result.status.name
    assert json.loads(text["model"])["leastaction"] == "mechanism 1"
    assert text["system"]["split"] == "left"


def test_motions_as_tables(tmp_path: Path) -> None:
    motion = Motion(
        ("torso_tx", "elbow"), np.array([0.0, 0.1, 0.3]), np.array([[0.1, 1 / 3], [0.2, 2.0], [0.3, -1e-17]])
    )
    path = motion.save(tmp_path / "walk.csv")
    assert path.read_text(encoding="utf-8").splitlines()[0] == "t [s],torso_tx [m],elbow [rad]"
    for back in (la.read_motion(path), la.open(path), la.open(motion.save(tmp_path / "walk.npz"))):
        assert isinstance(back, Motion)
        assert back.names == motion.names
        assert back.q.tobytes() == motion.q.tobytes()
        assert back.t.tobytes() == motion.t.tobytes()
    assert la.read_motion(path).source == "walk"
    bend = Motion(("elbow",), np.linspace(0.0, 0.2, 5), 0.1 * np.linspace(0.0, 0.2, 5)[:, None] ** 2)
    found = la.follow(arm(), la.read_motion(bend.save(tmp_path / "bend.csv")))
    assert found.errors["elbow"] < 1e-3


def test_degrees_and_millimetres_where_the_header_says_so(tmp_path: Path) -> None:
    path = tmp_path / "spreadsheet.csv"
    path.write_text(
        '\ufeff# from a spreadsheet\r\ntime [s],elbow [deg], knee [°] ,"reach, far [mm]",plain\r\n'
        "0,0,90,1000,1e-3\r\n\r\n0.5, 180 ,45,-2,2\r\n",
        encoding="utf-8",
    )
    motion = la.read_motion(path)
    assert motion.names == ("elbow", "knee", "reach, far", "plain")
    np.testing.assert_allclose(motion.q, [[0.0, np.pi / 2, 1.0, 1e-3], [np.pi, np.pi / 4, -0.002, 2.0]], rtol=1e-15)


def test_what_is_missing_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = simulated()

    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    path = run.save(tmp_path / "run.npz")
    monkeypatch.setattr(extras, "import_module", absent)
    for asked, module in (
        (run.to_pandas, "pandas"),
        (run.to_xarray, "xarray"),
        (lambda: run.save(tmp_path / "a.h5"), "h5py"),
    ):
        with pytest.raises(MissingExtraError, match=rf"needs {module}.*pip install 'leastaction\[data\]'"):
            asked()
    assert isinstance(la.open(path), la.Trajectory)
    assert not (tmp_path / "a.h5").exists()
    run.save(tmp_path / "a.csv")
    run.save(tmp_path / "a.mat")


def test_too_much_for_matlab_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.io

    def refuse(*args: object, **options: object) -> None:
        raise ValueError("Matrix too large to save with Matlab format 5")

    monkeypatch.setattr(scipy.io, "savemat", refuse)
    with pytest.raises(OutputError, match=r"too large.*Save it as \.h5"):
        simulated().save(tmp_path / "a.mat")
    assert list(tmp_path.iterdir()) == []
