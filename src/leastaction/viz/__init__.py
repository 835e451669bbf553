"""Pictures of a run: what it did, how it was found, and an animation for a browser.

``plot_run``, ``plot_energy``, ``plot_residuals``, ``plot_reactions`` take a run or a result of the optimiser;
``plot_convergence``, ``plot_limits``, ``plot_feedback`` a result; ``plot_descent`` a problem. What else is drawn is
given as arrays, or as a `Scene` of points, bones and cords.
Of any mechanism: `show` makes a `View` of a mechanism, a run or a result, which is a page for browsers, a picture, a
movie or a glTF file; figures are given arrays, or a `Scene` of points, bones, cords and shapes.

Every ``plot_*`` function returns a `matplotlib.figure.Figure` of its own, so nothing here touches pyplot or a display;
`save_png` writes one, whole or not at all. `animation_page` turns a `Scene` into one self-contained HTML text.
Matplotlib comes with the extra ``viz`` and is imported only when a figure is made.
"""

from __future__ import annotations

from leastaction.viz.convergence import plot_convergence
from leastaction.viz.descent import plot_descent
from leastaction.viz.energy import plot_energy
from leastaction.viz.feedback import plot_feedback
from leastaction.viz.figures import BLUE, GREY, ORANGE, PALE, VERMILION, new_figure, save_png, styled
from leastaction.viz.limits import plot_limits
from leastaction.viz.poses import plot_poses
from leastaction.viz.reactions import plot_reactions
from leastaction.viz.residuals import plot_residuals
from leastaction.viz.run import plot_run
from leastaction.viz.scene import ActiveLimit, Arrow, Bone, Cord, JointMark, Scene, mechanism_scene
from leastaction.viz.snapshots import plot_snapshots
from leastaction.viz.strings import plot_strings
from leastaction.viz.tracking import TrackingErrors, plot_tracking, tracking_errors
from leastaction.viz.viewer.animation import animation_page, write_animation
from leastaction.viz.viewer.show import show
from leastaction.viz.viewer.view import View

__all__ = [
    "BLUE", "GREY", "ORANGE", "PALE", "VERMILION", "ActiveLimit", "Arrow", "Bone", "Cord", "JointMark", "Scene",
    "TrackingErrors", "View", "animation_page", "mechanism_scene", "new_figure", "plot_convergence", "plot_descent",
    "plot_energy", "plot_feedback", "plot_limits", "plot_poses", "plot_reactions", "plot_residuals", "plot_run",
    "plot_snapshots", "plot_strings", "plot_tracking", "save_png", "show", "styled", "tracking_errors",
    "write_animation",
]  # fmt: skip
