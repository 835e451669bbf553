"""Draws the picture of the README from a demo: python docs/images/draw.py demo/trajectory.npz."""

from __future__ import annotations

import sys
from pathlib import Path

from leastaction.apps.marionette import load_run, marionette_scene
from leastaction.viz import plot_snapshots, save_png

# One cycle of the walk.
TIMES = (2.2, 2.45, 2.65, 2.95, 3.2, 3.45, 3.65)

scene = marionette_scene(load_run(sys.argv[1]))
figure = plot_snapshots(scene, times=TIMES, ceiling=1.95, azimuth=28.0)
save_png(figure, Path(__file__).with_name("marionette.png"), dpi=110.0)
