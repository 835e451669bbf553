"""Views that tests look at."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from leastaction import (
    Gravity,
    HybridWrench,
    LinearDamper,
    LinearSpring,
    Mechanism,
    MidpointVI,
    Trajectory,
    load,
    project_configuration,
    show,
    simulate,
    tx,
    tz,
)  # fmt: skip
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.models.hand import hand, posture
from leastaction.viz import View


def robots() -> Path:
    """Return the folder of example-robot-data; skip the test where it is not installed."""
    pytest.importorskip("trimesh")
    data = pytest.importorskip("example_robot_data")
    for parent in Path(data.__file__).parents:
        if (found := parent / "share" / "example-robot-data" / "robots").is_dir():
            return found
    pytest.skip("example-robot-data has no robots")


@cache
def four_bar_run() -> Trajectory:
    """A four-bar linkage that falls for 2 s."""
    m = four_bars(1)
    q, v = at_angle(m, 0.7, 2.0)
    vi = MidpointVI(m)
    return vi.simulate(vi.start(q, v), np.linspace(0.0, 2.0, 81))


def four_bar() -> View:
    """The four-bar with a reference that lags behind, and the path of a joint."""
    run = four_bar_run()
    return show(run, reference=np.vstack((run.q[:1], run.q[:-1])), traces=["B0"], title="Four-bar")


def hexapod() -> View:
    """The Stewart platform of the examples, which leans as one motor pushes less."""
    pytest.importorskip("mujoco")
    model = load(Path(__file__).parents[2] / "examples" / "models" / "stewart.xml")
    m = model.mechanism
    vi = MidpointVI(m)
    q = project_configuration(m, m.configuration(model.reference)).q
    push = [52.2, 52.2, 52.2, 52.2, 49.0, 49.0]  # 52.2 N each carry it
    run = vi.simulate(vi.start(q), np.linspace(0.0, 0.6, 121), inputs=push)
    return show(run, shapes=model.shapes, title="Hexapod")


def suspended() -> View:
    """A block on a spring and a damper on a rail, with a force on it."""
    m = Mechanism(
        [
            *(tz(3.0, name="top"), tx(0.1, name="foot")),
            *(tz("z", name="block", mass=1.0, inertia=[0.02] * 3), [tx(0.1, name="hook")]),
        ],
        [
            Gravity(),
            LinearSpring("top", "block", 40.0, 1.0, name="spring"),
            LinearDamper("foot", "hook", 0.5, name="damper"),
            HybridWrench("block", force=("push", 0.0, 2.0), name="wind"),
        ],
    )
    return show(simulate(m, [1.5], None, np.linspace(0.0, 2.0, 41), inputs=[1.0]), forces=True, title="Block")


def bent_hand() -> View:
    """The hand with its tendons."""
    m = hand()
    return show(m, q=posture(m, 0.5), title="Hand")


def robot(name: str) -> View:
    """UR5, Go2 or Talos with their meshes."""
    folder = robots()
    file, floating, values = {
        "ur5": ("ur_description/urdf/ur5_robot.urdf", False, {"shoulder_lift_joint": -1.2, "elbow_joint": 1.4}),
        "go2": ("go2_description/urdf/go2.urdf", True, {}),
        "talos": ("talos_data/robots/talos_reduced.urdf", True, {}),
    }[name]
    model = load(folder / file, packages=[folder.parents[1]], floating=floating)
    bent = {v: 0.8 if "thigh" in v else -1.6 for v in model.mechanism.variables if "thigh" in v or "calf" in v}
    return show(model, q=model.mechanism.configuration({**values, **bent}), title=name)
