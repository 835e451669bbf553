"""Markers: the few places of a body by which a motion can be followed instead of by the angles of its joints.

A motion says where they are in columns of its own, relative to the pelvis along the axes of the world, such as
``left_hand_tx``. Where it has none, they are where the puppet's would be if its joints did what is wanted.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.numerics import Array
from leastaction.viz import new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from leastaction.io import Motion

PELVIS: Final = "pelvis"
LIMB_MARKERS: Final[Mapping[str, str]] = MappingProxyType(
    {"head": "head_center", "left_hand": "lhand", "right_hand": "rhand", "left_foot": "lfoot", "right_foot": "rfoot"}
)
"""The markers besides the pelvis, and the puppet's frames at whose origins they are: at its wrists and ankles."""

MARKERS: Final = (PELVIS, *LIMB_MARKERS)
"""All markers, in their order."""

_COLUMNS: Final = tuple(f"{name}_t{axis}" for name in LIMB_MARKERS for axis in "xyz")


def with_markers(motion: Motion, places: Mapping[str, Array]) -> Motion:
    """Return a motion with columns of its markers; ``places``: (N+1, 3) by name, relative to the pelvis (m)."""
    q = np.hstack([motion.q, *(places[name] for name in LIMB_MARKERS)])
    return type(motion)((*motion.names, *_COLUMNS), motion.t, q, motion.source)


def with_places(motion: Motion, markers: Array) -> Motion:
    """Return a motion of the body with columns for markers (N+1, 6, 3) in the world."""
    apart = markers[:, 1:] - motion.q[:, None, :3]
    return with_markers(motion, {name: apart[:, i] for i, name in enumerate(LIMB_MARKERS)})


def wanted_markers(motion: Motion) -> Array | None:
    """Return where the columns of a motion want the markers, (N+1, 6, 3) in the world; None if it has none."""
    if not set(_COLUMNS) <= set(motion.names):
        return None
    pelvis = motion.columns(("torso_tx", "torso_ty", "torso_tz"))[:, None]
    return np.concatenate([pelvis, pelvis + motion.columns(_COLUMNS).reshape(len(motion.t), -1, 3)], axis=1)


def places_of(mechanism: Mechanism, q: Array) -> Array:
    """Return where the markers of the puppet are in configurations q (n, nq): (n, 6, 3)."""
    return np.asarray(mechanism.positions(np.ascontiguousarray(q), [PELVIS, *LIMB_MARKERS.values()]))


@styled
def plot_markers(t: Array, apart: Array) -> Figure:
    """Draw how far markers are from where they are wanted; ``t`` (N+1,) in s, ``apart`` (N+1, 6) in m."""
    figure = new_figure(9.0, 4.0)
    over_time, bars = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
    names = [name.replace("_", " ") for name in MARKERS]
    for i, name in enumerate(names):
        (line,) = over_time.plot(t, 1e3 * apart[:, i], linewidth=1.2, label=name)
        bars.barh(i, 1e3 * np.sqrt(np.mean(apart[:, i] ** 2)), 0.6, color=line.get_color())
    over_time.set(xlabel="time (s)", ylabel="off by (mm)", ylim=(0.0, None), xlim=(t[0], t[-1]))
    over_time.legend(frameon=False, fontsize=8, ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.2))
    bars.set_yticks(range(len(names)), names, fontsize=8)
    bars.invert_yaxis()
    bars.set(xlabel="off by (mm, rms)")
    return figure
