"""Pictures of a run: convergence, scenes, and an animation for a browser.

Every ``plot_*`` function takes arrays and returns a `matplotlib.figure.Figure` of its own, so
nothing here touches pyplot or a display; `save_png` writes one, whole or not at all.
`animation_page` turns a `Scene` into one self-contained HTML text. Matplotlib comes with the extra
``viz`` and is imported only when a figure is made.
"""

from __future__ import annotations

from leastaction.viz.animation import animation_page, write_animation
from leastaction.viz.convergence import plot_convergence
from leastaction.viz.figures import save_png
from leastaction.viz.scene import Bone, Cord, Scene

__all__ = [
    "Bone",
    "Cord",
    "Scene",
    "animation_page",
    "plot_convergence",
    "save_png",
    "write_animation",
]
