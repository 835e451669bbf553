"""Pictures of a run: convergence, tracking, strings, snapshots, and an animation for a browser.

Of any mechanism: `show` makes a `View` of a mechanism, a run or a result, which is a page for browsers, a picture, a
movie or a glTF file; figures are given arrays, or a `Scene` of points, bones, cords and shapes.

Every ``plot_*`` function takes arrays and returns a `matplotlib.figure.Figure` of its own, so nothing here touches
pyplot or a display; `save_png` writes one, whole or not at all. `animation_page` turns a `Scene` into one
self-contained HTML text. Matplotlib comes with the extra ``viz`` and is imported only when a figure is made.
"""

from __future__ import annotations

from leastaction.viz.animation import animation_page, write_animation
from leastaction.viz.convergence import plot_convergence
from leastaction.viz.figures import save_png
from leastaction.viz.limits import plot_limits
from leastaction.viz.scene import ActiveLimit, Arrow, Bone, Cord, JointMark, Scene, mechanism_scene
from leastaction.viz.snapshots import plot_snapshots
from leastaction.viz.strings import plot_strings
from leastaction.viz.tracking import TrackingErrors, plot_tracking, tracking_errors
from leastaction.viz.viewer.show import show
from leastaction.viz.viewer.view import View

__all__ = [
    "ActiveLimit", "Arrow", "Bone", "Cord", "JointMark", "Scene", "TrackingErrors", "View", "animation_page",
    "mechanism_scene", "plot_convergence", "plot_limits", "plot_snapshots", "plot_strings", "plot_tracking", "save_png",
    "show", "tracking_errors", "write_animation",
]  # fmt: skip
