"""Draws the puppet that swings its arms over the head and turns over, on nine strings: overhead.png."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from leastaction.io import Motion
from leastaction.models.marionette import REST, marionette
from leastaction.numerics import smooth_rise
from leastaction.viz import plot_snapshots, save_png
from leastaction_marionette import VARIABLES, TrackingRun, marionette_scene, track


def acrobat(dt: float = 0.01) -> Motion:
    """Return arms that go up to the sides, over the head and down again, and a body that turns over to its side."""
    t = np.arange(0.0, 4.0 + 0.5 * dt, dt)

    def between(start: float, end: float) -> np.ndarray:
        return smooth_rise((t - start) / (end - start))

    angles = dict.fromkeys(VARIABLES, 0.0 * t) | {name: angle + 0.0 * t for name, angle in REST.items()}
    arms = np.deg2rad(160.0) * (between(0.2, 1.1) - between(1.3, 2.2))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        angles[f"{side}shoulder_ry"] = sign * arms
        angles[f"{side}elbow_rx"] = 1.57 - 1.2 * (between(0.2, 1.0) - between(1.4, 2.2))
    angles["torso_ry"] = np.pi * between(2.0, 3.6)
    return Motion(VARIABLES, t, np.stack([angles[name] for name in VARIABLES], axis=1), "acrobat")


def main(folder: Path) -> TrackingRun:
    """Follow it, print and draw."""
    run = track(marionette(strings=9, axes="quaternion"), acrobat(), progress=print)
    print(f"{run.result.status.name}, {run.effort}, held joints off by {run.held_error:.2f} degrees")
    print(f"strings pull with {run.tension.min():.2f} to {run.tension.max():.0f} N")
    rows = [
        plot_snapshots(marionette_scene(run), times=times, azimuth=75.0, elevation=6.0)
        for times in ((0.0, 0.7, 1.2, 1.9), (2.5, 2.8, 3.1, 4.0))
    ]
    save_png(rows, folder / "overhead.png", dpi=110)
    return run


if __name__ == "__main__":
    main(Path(__file__).parent)
