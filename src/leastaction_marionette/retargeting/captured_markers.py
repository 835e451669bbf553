"""Where a captured person's head, hands and feet are, at the puppet's size.

Each part of the body is scaled by itself: the puppet's trunk, shoulders, hips, arms and legs are as long as they are,
and a hand is where the person's is as seen from the shoulder, in lengths of the arm. So what the puppet has no joint
for is in the markers too: a spine that bends, a collar bone that lifts, hips that turn against the shoulders.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from leastaction.numerics import Array
from leastaction_marionette.retargeting.geometry import unit
from leastaction_marionette.retargeting.skeleton import CHAINS, HEAD, LIMBS, Proportions

_MARKER = {"leg": "foot", "arm": "hand"}


def captured_markers(points: Mapping[str, Array], torso: Array, sizes: Proportions) -> dict[str, Array]:
    """Return head, hands and feet relative to the pelvis, (F, 3) in metres by name.

    ``points``: joints (F, 3) by role in any unit, z up, with ``pelvis`` and ``spine_top``; ``head`` if there is one.
    ``torso`` (F, 3, 3): the puppet's.
    """
    spine = _scaled(points["spine_top"] - points["pelvis"], sizes.spine)
    places = {"head": spine + _head(points, torso)}
    for side, limb in LIMBS:
        chain = [points[f"{side}_{joint}"] for joint in CHAINS[limb]]
        lengths = [_length(b - a) for a, b in pairwise(chain)]
        middle, half, base = (
            ("pelvis", sizes.hip, np.zeros(3)) if limb == "leg" else ("spine_top", sizes.shoulder, spine)
        )
        root = base + _scaled(chain[0] - points[middle], half)
        places[f"{side}_{_MARKER[limb]}"] = root + sum(sizes.bones(limb)) / sum(lengths) * (chain[-1] - chain[0])
    return places


def _head(points: Mapping[str, Array], torso: Array) -> Array:
    """Return the head above the shoulders (F, 3): as the person's moves about where it is in the mean."""
    if "head" not in points:
        return HEAD * torso[:, :, 2]
    # A person's head is ahead of the shoulders, the puppet's above them: what counts is how it moves about its place.
    own = np.einsum("fji,fj->fi", torso, unit(points["head"] - points["spine_top"]))
    mean = unit(own.mean(axis=0))
    axis, cosine = np.cross(mean, [0.0, 0.0, 1.0]), mean[2]
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    up = np.eye(3) + cross + cross @ cross / max(1.0 + cosine, 1e-6)
    return np.asarray(HEAD * np.einsum("fij,jk,fk->fi", torso, up, own))


def _length(vectors: Array) -> float:
    return float(np.mean(np.linalg.norm(vectors, axis=1)))


def _scaled(vectors: Array, length: float) -> Array:
    """Return vectors (F, 3) that are of some length in the mean."""
    return vectors * (length / max(_length(vectors), 1e-300))
