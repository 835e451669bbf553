"""The marionette's 22 joint variables, also with quaternions, its proportions, and where its joints are in space.

z is up, the puppet faces +y, its left is -x. In the zero pose it stands with its arms hanging.
From the world, ``torso_tx, _ty, _tz, _rz, _ry, _rx`` place the pelvis; hips and shoulders turn by
``rz, ry, rx``; knees and elbows by ``rx``. Every limb bone runs along -z of its frame: a knee bends
with ``rx < 0`` (foot to the back), an elbow with ``rx > 0`` (forearm to the front).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from leastaction.io import axis_rotation
from leastaction.models.marionette import FOREARM, HIP_WIDTH, SHOULDER_WIDTH, SPINE
from leastaction.numerics import Array
from leastaction_marionette.retargeting.geometry import rotation_zyx

VARIABLES: tuple[str, ...] = (
    "torso_tx",
    "torso_ty",
    "torso_tz",
    "torso_rz",
    "torso_ry",
    "torso_rx",
    *(f"{side}{name}" for side in "lr" for name in ("hip_rz", "hip_ry", "hip_rx", "knee_rx")),
    *(f"{side}{name}" for side in "lr" for name in ("shoulder_rz", "shoulder_ry", "shoulder_rx", "elbow_rx")),
)

_TURNING = ("torso", "lhip", "rhip", "lshoulder", "rshoulder")


def _with_quaternions(names: tuple[str, ...]) -> Iterator[str]:
    """Yield names of variables, with those of a quaternion where there are three angles of a joint."""
    for name in names:
        joint, _, axis = name.rpartition("_")
        if joint not in _TURNING or axis.startswith("t"):
            yield name
        elif axis == "rz":
            yield from (f"{joint}.q{letter}" for letter in "wxyz")


COORDINATES: tuple[str, ...] = tuple(_with_quaternions(VARIABLES))

Limb = Literal["leg", "arm"]
LIMBS: tuple[tuple[str, Limb], ...] = (("left", "leg"), ("right", "leg"), ("left", "arm"), ("right", "arm"))
#: Joint names from the root of a limb to its end.
CHAINS: dict[Limb, tuple[str, str, str]] = {"leg": ("hip", "knee", "ankle"), "arm": ("shoulder", "elbow", "wrist")}
#: How far the middle of the puppet's head is above its shoulders (m).
HEAD = 0.18
#: Sign of the hinge's variable when it bends the natural way.
BEND: dict[Limb, float] = {"leg": -1.0, "arm": 1.0}


@dataclass(frozen=True)
class Proportions:
    """Lengths of the puppet in metres.

    The defaults are the marionette's of the dissertation (section 5.3).
    """

    hip: float = HIP_WIDTH
    thigh: float = 0.4
    shin: float = 0.4
    shoulder: float = SHOULDER_WIDTH
    spine: float = SPINE
    upper_arm: float = 0.25
    forearm: float = FOREARM

    @property
    def leg(self) -> float:
        """Length of a straight leg."""
        return self.thigh + self.shin

    def attachment(self, side: str, limb: Limb) -> tuple[float, float, float]:
        """Position of a limb's first joint in the pelvis frame."""
        sign = -1.0 if side == "left" else 1.0
        if limb == "leg":
            return sign * self.hip, 0.0, 0.0
        return sign * self.shoulder, 0.0, self.spine

    def bones(self, limb: Limb) -> tuple[float, float]:
        """Lengths of a limb's two bones."""
        return (self.thigh, self.shin) if limb == "leg" else (self.upper_arm, self.forearm)


def limb_variables(side: str, limb: Limb) -> tuple[str, str, str, str]:
    """Names of the four variables of a limb: root rz, ry, rx and the hinge's rx."""
    root, hinge, _ = CHAINS[limb]
    letter = side[0]
    return (f"{letter}{root}_rz", f"{letter}{root}_ry", f"{letter}{root}_rx", f"{letter}{hinge}_rx")


def puppet_points(q: Array, *, proportions: Proportions | None = None) -> dict[str, Array]:
    """Where the puppet's joints are.

    Parameters
    ----------
    q : (N+1, 22) array
        Values of `VARIABLES`, in that order.
    proportions : Proportions, optional
        Lengths of the bones.

    Returns
    -------
    dict of (N+1, 3) arrays
        By name: ``pelvis``, ``spine_top``, and ``left_`` and ``right_`` ``hip``, ``knee``,
        ``ankle``, ``shoulder``, ``elbow``, ``wrist``.
    """
    sizes = proportions or Proportions()
    q = np.asarray(q, dtype=np.float64)
    column = {name: q[:, index] for index, name in enumerate(VARIABLES)}
    limbs = {}
    for side, limb in LIMBS:
        *turns, hinge = limb_variables(side, limb)
        limbs[side, limb] = rotation_zyx(np.stack([column[name] for name in turns], axis=1)), column[hinge]
    return placed(q[:, :3], rotation_zyx(q[:, 3:6]), limbs, sizes)


def placed(
    pelvis: Array, torso: Array, limbs: Mapping[tuple[str, Limb], tuple[Array, Array]], sizes: Proportions
) -> dict[str, Array]:
    """Return where the puppet's joints are, as `puppet_points` does.

    ``pelvis`` (F, 3): its place, ``torso`` (F, 3, 3): how it is turned. ``limbs``: rotations (F, 3, 3) of the upper
    bones against the torso, and angles (F,) of the hinges.
    """
    points = {"pelvis": pelvis, "spine_top": pelvis + sizes.spine * torso[:, :, 2]}
    for side, limb in LIMBS:
        own, hinge = limbs[side, limb]
        upper = torso @ own
        lower = upper @ axis_rotation(0, hinge)
        first, second = sizes.bones(limb)
        names = [f"{side}_{name}" for name in CHAINS[limb]]
        points[names[0]] = pelvis + torso @ np.array(sizes.attachment(side, limb))
        points[names[1]] = points[names[0]] - first * upper[:, :, 2]
        points[names[2]] = points[names[1]] - second * lower[:, :, 2]
    return points
