"""The marionette of `leastaction.models.marionette` as a scene, and its variables by limb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import STRINGS
from leastaction.viz.scene import Bone, Cord, Scene
from leastaction.viz.tracking import tracking_errors

Array = npt.NDArray[np.float64]


def _limb(side: str, name: str, hinge: str) -> tuple[str, ...]:
    """Names of a limb's four variables."""
    return (*(f"{side}{name}_{axis}" for axis in ("rz", "ry", "rx")), f"{side}{hinge}_rx")


GROUPS: Final[Mapping[str, Sequence[str]]] = MappingProxyType(
    {
        "Torso, position": ("torso_tx", "torso_ty", "torso_tz"),
        "Torso, rotation": ("torso_rz", "torso_ry", "torso_rx"),
        "Left leg": _limb("l", "hip", "knee"),
        "Right leg": _limb("r", "hip", "knee"),
        "Left arm": _limb("l", "shoulder", "elbow"),
        "Right arm": _limb("r", "shoulder", "elbow"),
    }
)
"""The puppet's variables by part of the body: the rows of a tracking plot."""

_SIDE_BONES: Final = (
    ("hip", "femur_end", 0.058),
    ("femur_end", "foot", 0.045),
    ("foot", "foot_end", 0.034),
    ("shoulder", "humerus_end", 0.040),
    ("humerus_end", "hand", 0.033),
    ("hand", "hand_end", 0.030),
)
_BODY_BONES: Final = (
    ("pelvis", "spine_top", 0.085),
    ("lshoulder", "rshoulder", 0.048),
    ("lhip", "rhip", 0.062),
    ("spine_top", "head", 0.038),
    ("head_center", "head_center", 0.095),
)
_STUB_RADIUS: Final = 0.009
# Each hook stands on a stub; the frame that carries it.
_STUBS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "left_leg_string_hook": "lfemur_end",
        "right_leg_string_hook": "rfemur_end",
        "left_arm_string_hook": "lhand",
        "right_arm_string_hook": "rhand",
        "upper_torso_string_hook": "spine_top",
        "lower_torso_string_hook": "spine_top",
    }
)


def marionette_scene(
    mechanism: Mechanism,
    t: npt.ArrayLike,
    q: npt.ArrayLike,
    *,
    q_wanted: npt.ArrayLike | None = None,
    tension: npt.ArrayLike | None = None,
    title: str = "Marionette",
) -> Scene:
    """Make a scene of a motion of the marionette.

    Parameters
    ----------
    mechanism
        From `leastaction.models.marionette.marionette`.
    t
        Times, (N+1,), s.
    q
        Configurations, (N+1, nq).
    q_wanted
        Wanted configurations, (N+1, nq); their body is drawn as a ghost.
    tension
        Tension of each string in the order of the constraints, (N, 6) or (N+1, 6), N.
    title
        Heading.

    Returns
    -------
    Scene
        Puppet, strings, ghost, tracking error in degrees, and the paths of both hands.

    Raises
    ------
    ArgumentError
        The arrays do not fit the mechanism or each other.
    """
    times, motion = np.asarray(t, dtype=float), np.asarray(q, dtype=float)
    bones = [Bone(start=a, end=b, radius=r) for a, b, r in _BODY_BONES]
    bones += [Bone(start=s + a, end=s + b, radius=r) for s in "lr" for a, b, r in _SIDE_BONES]
    bones += [Bone(start=a, end=b, radius=_STUB_RADIUS) for b, a in _STUBS.items()]
    body = list(dict.fromkeys(name for bone in bones for name in (bone.start, bone.end)))
    points = _points(mechanism, motion, [*body, *(string.control for string in STRINGS)])
    ghost: dict[str, Array] | None = None
    error: Array | None = None
    if q_wanted is not None:
        wanted = np.asarray(q_wanted, dtype=float)
        ghost = _points(mechanism, wanted, [name for name in body if name not in _STUBS])
        names = mechanism.dynamic
        nd = len(names)
        lengths = GROUPS["Torso, position"]
        error = tracking_errors(wanted[:, :nd], motion[:, :nd], names, lengths=lengths).over_time
    pulls: dict[str, Array] | None = None
    if tension is not None:
        array = np.asarray(tension, dtype=float)
        if array.ndim != 2 or array.shape[1] != len(STRINGS):
            raise ArgumentError(f"tension has shape {array.shape}, expected (N, {len(STRINGS)})")
        pulls = {_label(s.name): array[:, i] for i, s in enumerate(STRINGS)}
    return Scene(
        t=times,
        points=points,
        bones=tuple(bones),
        cords=tuple(Cord(name=_label(s.name), start=s.hook, end=s.control) for s in STRINGS),
        ghost=ghost,
        tension=pulls,
        error=error,
        traces=("lhand", "rhand"),
        focus="pelvis",
        title=title,
    )


def string_labels() -> list[str]:
    """Return the names of the strings as a person would say them, in the order of the constraints."""
    return [_label(string.name) for string in STRINGS]


def string_lengths(mechanism: Mechanism, q: npt.ArrayLike) -> Array:
    """Return the lengths of the strings, (N+1, 6), m, from configurations (N+1, nq)."""
    columns = [mechanism.variables.index(string.length) for string in STRINGS]
    return np.asarray(q, dtype=float)[:, columns]


def _label(name: str) -> str:
    return name.removesuffix("_string").replace("_", " ")


def _points(mechanism: Mechanism, q: Array, names: Sequence[str]) -> dict[str, Array]:
    """Return the paths of frames by name, each (N+1, 3)."""
    positions = mechanism.positions(q, names)
    return {name: positions[:, i] for i, name in enumerate(names)}
