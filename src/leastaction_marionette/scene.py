"""The marionette of `leastaction.models.marionette` as a scene, and its variables by limb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.models.marionette import PuppetString, bars_of, strings_of
from leastaction.numerics import Array
from leastaction.viz import Bone, Cord, Scene, mechanism_scene
from leastaction_marionette.retargeting.skeleton import CHAINS, LIMBS
from leastaction_marionette.tracking.found import TrackingRun

_PARTS: Final[Mapping[str, Sequence[str]]] = MappingProxyType(
    {
        "Torso, position": ("torso_t",),
        "Torso, rotation": ("torso_r", "torso."),
        **{f"{side} {limb}".capitalize(): [f"{side[0]}{joint}" for joint in CHAINS[limb]] for side, limb in LIMBS},
    }
)

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
_BONES: Final = (
    *(Bone(start=a, end=b, radius=r) for a, b, r in _BODY_BONES),
    *(Bone(start=s + a, end=s + b, radius=r) for s in "lr" for a, b, r in _SIDE_BONES),
)
_BAR: Final = 0.015  # m, half the thickness of a bar
# Each hook stands on a stub on the frame that carries it; that at the neck is at the end of the spine itself.
_CARRIERS: Final = {
    "left_leg_string_hook": "lfemur_end",
    "right_leg_string_hook": "rfemur_end",
    "left_arm_string_hook": "lhand",
    "right_arm_string_hook": "rhand",
    "upper_torso_string_hook": "spine_top",
    "lower_torso_string_hook": "spine_top",
    "left_foot_string_hook": "lfoot",
    "right_foot_string_hook": "rfoot",
    "left_elbow_string_hook": "lhumerus_end",
    "right_elbow_string_hook": "rhumerus_end",
    "back_string_hook": "pelvis",
}


def marionette_scene(run: TrackingRun, *, title: str = "") -> Scene:
    """Make a scene of a run of the marionette.

    Parameters
    ----------
    run : TrackingRun
    title : str, optional
        Heading; the source of the reference motion if not given.

    Returns
    -------
    Scene
        Puppet, strings, bars, the reference as a ghost, tracking error in degrees, and the paths of both hands.
    """
    strings = strings_of(run.mechanism)
    stubs = [Bone(start=_CARRIERS[s.hook], end=s.hook, radius=0.009) for s in strings if s.hook in _CARRIERS]
    bars = _bars(run.mechanism)
    scene = mechanism_scene(
        run.mechanism,
        run.trajectory.t,
        run.trajectory.q,
        bones=(*_BONES, *stubs, *bars),
        cords=[Cord(name=string_label(s.name), start=s.hook, end=s.control) for s in strings],
        reference=run.reference,
        tension=run.tension,
        error=run.errors.over_time,
        traces=("lhand", "rhand"),
        focus="pelvis",
        title=title or f"Marionette: {run.source or 'motion'}",
    )
    # Nothing is wanted of bars.
    others = {name for bone in bars for name in (bone.start, bone.end)}
    ghost = {name: path for name, path in (scene.ghost or {}).items() if name not in others}
    return replace(scene, ghost=ghost) if bars else scene


def by_parts(mechanism: Mechanism) -> dict[str, list[str]]:
    """Return the puppet's variables by part of the body: the rows of a tracking plot."""
    return {
        part: [name for name in mechanism.dynamic if name.startswith(tuple(begins))] for part, begins in _PARTS.items()
    }


def _bars(mechanism: Mechanism) -> list[Bone]:
    """Return what is drawn of the bars: beams to their ends, and what joins the beams."""
    bones = []
    controls = {string.name: string.control for string in strings_of(mechanism)}
    for bar in bars_of(mechanism):
        along = sorted(bar.ends, key=lambda string: bar.ends[string][1])
        middle = bar.beam(along[0]), bar.beam(along[-1])
        if bar.ends[along[0]][1] < bar.ends[along[-1]][1]:
            bones.append(Bone(start=middle[0], end=middle[1], radius=_BAR))
        bones += [
            Bone(start=bar.beam(string), end=controls[string], radius=_BAR)
            for string, (across, _) in bar.ends.items()
            if across != 0.0
        ]
    return bones


def own_string_lengths(run: TrackingRun) -> Array:
    """Return the lengths of the strings (m), taut or not, shape (N+1, strings), in the order of the constraints.

    How far their ends are apart says `leastaction.models.marionette.string_lengths`.
    """
    m, steps = run.mechanism, np.ones(len(run.trajectory.t))
    return np.stack(
        [
            run.trajectory[s.length] if isinstance(s, PuppetString) else m.parameters[s.length] * steps
            for s in strings_of(m)
        ],
        axis=1,
    )


def string_label(name: str) -> str:
    """Return the name of a string as a person would say it."""
    return name.removesuffix("_string").replace("_", " ")
