"""Pictures of a run: convergence, tracking, strings, snapshots, and an animation for a browser.

Of any mechanism: what is drawn is given as arrays, or as a `Scene` of points, bones and cords.

Every ``plot_*`` function takes arrays and returns a `matplotlib.figure.Figure` of its own, so nothing here touches
pyplot or a display; `save_png` writes one, whole or not at all. `animation_page` turns a `Scene` into one
self-contained HTML text. Matplotlib comes with the extra ``viz`` and is imported only when a figure is made.
"""

from __future__ import annotations

from leastaction.viz.animation import animation_page, write_animation
from leastaction.viz.convergence import plot_convergence
from leastaction.viz.figures import save_png
from leastaction.viz.limits import plot_limits
from leastaction.viz.scene import Bone, Cord, Scene, mechanism_scene
from leastaction.viz.snapshots import plot_snapshots
from leastaction.viz.strings import plot_strings
from leastaction.viz.tracking import TrackingErrors, plot_tracking, tracking_errors

__all__ = [
    "Bone", "Cord", "Scene", "TrackingErrors", "animation_page", "mechanism_scene", "plot_convergence",
    "plot_limits", "plot_snapshots", "plot_strings", "plot_tracking", "save_png", "tracking_errors", "write_animation",
]  # fmt: skip
