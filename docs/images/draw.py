"""Draws pictures of the documents from runs: python docs/images/draw.py demo/trajectory.npz [control/trajectory.npz].

The first is that of ``leastaction demo --out demo``, the second of
``leastaction optimize marionette --strings cross+legs --duration 6 --out control``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from leastaction.viz import plot_snapshots, save_png
from leastaction_marionette import load_run, marionette_scene

# One cycle of the walk.
TIMES = (2.2, 2.45, 2.65, 2.95, 3.2, 3.45, 3.65)

for file, name, ceiling in zip(sys.argv[1:], ("marionette", "controls"), (1.95, None), strict=False):
    figure = plot_snapshots(marionette_scene(load_run(file)), times=TIMES, ceiling=ceiling, azimuth=28.0)
    save_png(figure, Path(__file__).with_name(f"{name}.png"), dpi=110.0)
