"""MJCF files of other projects: each loads or holds no robot, and its smooth dynamics equal MuJoCo's.

``LEASTACTION_MJCF`` names folders with such files, as of the wheels of dm-control, gymnasium-robotics and robosuite.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

import mujoco

import leastaction
from leastaction.errors import ModelFileError
from oracles import mujoco_models

FOLDERS = [Path(folder) for folder in os.environ.get("LEASTACTION_MJCF", "").split(os.pathsep) if folder]
FILES = sorted(file for folder in FOLDERS for file in folder.rglob("*.xml"))
pytestmark = [
    pytest.mark.skipif(not FILES, reason="LEASTACTION_MJCF names no folder with MJCF files"),
    pytest.mark.filterwarnings("ignore:.*settotalmass:UserWarning"),
]
# What MuJoCo says of files that it does not compile either, or that are no models.
HOLDS_NONE = (
    "holds no robot", "Error opening file", "repeated name", "Schema violation", "massless", "its inertia", "its mass",
)  # fmt: skip


@pytest.mark.parametrize("file", FILES, ids=["/".join(file.parts[-4:]) for file in FILES])
def test_smooth_dynamics_equal_those_of_mujoco(file: Path) -> None:
    try:
        model = leastaction.load(file)
    except ModelFileError as error:
        said = str(error)
    else:
        said = ""
    if said:
        assert any(part in said for part in HOLDS_NONE), said
        if "holds no robot" not in said:
            with pytest.raises(ValueError, match=r"."):
                mujoco.MjModel.from_xml_path(str(file))
        return
    try:
        mujoco_models.compiled(file)
    except ValueError as error:
        pytest.skip(f"MuJoCo does not compile it: {error}")
    if model.mechanism.nq:
        worst = mujoco_models.errors(file, model)
        actuated = mujoco_models.error_of_actuators(file, model)
        if actuated is not None:
            worst["actuators"] = actuated
        assert max(worst.values()) < 1e-8, worst
