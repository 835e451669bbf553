"""The keyframes of an MJCF, by variable instead of by place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from leastaction.io.mechanisms import rotations
from leastaction.io.mechanisms.model import Keyframe, LeftOut
from leastaction.io.mechanisms.names import Names


def keyframes_of(spec: Any, names: Names, inputs: Sequence[str | None]) -> tuple[dict[str, Keyframe], list[LeftOut]]:
    """Return the keyframes by name; ``inputs``: the input that each actuator has become, or None."""
    found: dict[str, Keyframe] = {}
    left_out: list[LeftOut] = []
    sizes = [rotations.size_in_file(joint) for joint in names.all_joints]
    rates = [{4: 3, 7: 6}.get(size, size) for size in sizes]
    for number, key in enumerate(spec.keys):
        name = key.name or f"key{number}"
        qpos, qvel, ctrl = (np.array(list(part), dtype=np.float64) for part in (key.qpos, key.qvel, key.ctrl))
        if len(qpos) not in (0, sum(sizes)):
            why = f"it has {len(qpos)} numbers of configuration, and the joints have {sum(sizes)}"
            left_out.append(LeftOut(f"keyframe {name!r}", why))
            continue
        q: dict[str, float] = {}
        v: dict[str, float] = {}
        places = np.split(qpos, np.cumsum(sizes)[:-1]) if len(qpos) else [None] * len(sizes)
        speeds = np.split(qvel, np.cumsum(rates)[:-1]) if len(qvel) == sum(rates) else [None] * len(sizes)
        for joint, place, speed in zip(names.all_joints, places, speeds, strict=True):
            if joint.name not in names.joints:
                continue
            several = joint.kind in ("ball", "free")
            if place is not None and (several or names.is_own(joint.name)):
                q.update(rotations.configuration_of(joint, place) if several else {joint.name: float(place[0])})
            if place is not None and speed is not None and speed.any():
                v.update(rotations.velocity_of(joint, q, speed) if several else {joint.name: float(speed[0])})
        given = {n: float(value) for n, value in zip(inputs, ctrl, strict=False) if n is not None}
        found[name] = Keyframe(q=q, v=v, inputs=given)
    return found, left_out
