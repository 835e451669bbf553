"""Every URDF of example-robot-data: it loads, and its dynamics equal Pinocchio's, on a fixed and on a free base."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("example_robot_data")

import example_robot_data as robots

import leastaction
from leastaction.errors import ModelFileError
from oracles import pinocchio_robots

FOLDER = (
    next(p for p in Path(robots.__file__).resolve().parents if p.name == "cmeel.prefix") / "share/example-robot-data"
)
FILES = sorted(FOLDER.rglob("*.urdf"))
NONE = {"falcon.urdf": "unknown link 'Z_propeller'", "ur3.urdf": "the file holds no robot"}
# The fingers and hands of these weigh nothing, or some inertia is negative: strictly an error.
MENDED = {
    "bluevolta_bravo7_gripper.urdf", "bravo7_gripper.urdf", "falcon_bravo7_gripper.urdf", "romeo.urdf",
    "romeo_laas_small.urdf", "tiago.urdf", "tiago_dual.urdf", "tiago_no_hand.urdf",
}  # fmt: skip


@pytest.mark.parametrize("floating", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize("file", FILES, ids=["/".join(file.parts[-3:]) for file in FILES])
def test_dynamics_equal_those_of_pinocchio(file: Path, floating: bool) -> None:
    if file.name in NONE:
        with pytest.raises(ModelFileError, match=NONE[file.name]):
            leastaction.load(file)
        return
    if file.name in MENDED:
        with pytest.raises(ModelFileError, match="inertia='repair'"):
            leastaction.load(file, floating=floating)
    inertia = "repair" if file.name in MENDED else "strict"
    model = leastaction.load(file, floating=floating, inertia=inertia)  # type: ignore[arg-type]
    if model.mechanism.nq:
        worst = pinocchio_robots.errors(file, model, floating)
        assert max(worst.values()) < 1e-10, worst
