"""The marionette walks on the spot: 40 variables, six strings that only pull, and a motion that no puppet made.

The wanted walk gives the angles of the joints; found are the strings, their upper ends' motion and their tensions, with
at least half a newton in each.

    python examples/18_marionette.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

from leastaction.models.marionette import marionette
from leastaction.viz import plot_reactions, plot_run, plot_snapshots, save_png
from leastaction_marionette import TrackingRun, marionette_scene, track, walk_in_place


def main(output: Path) -> TrackingRun:
    """Follow the walk, print and draw."""
    run = track(marionette(strings=6), walk_in_place(1.5))
    m = run.mechanism
    print(f"{m.nq} variables, {m.nc} strings, {run.trajectory.steps} steps of {run.trajectory.t[1]:g} s")
    print(f"{run.result.status.name} in {run.result.iterations} iterations")
    print(f"joints off by {run.errors.joint_rms:.2f} degrees (rms)")
    for name, tension in zip(m.constraints, run.tension[1:].T, strict=True):  # the first step takes up the start
        print(f"{name.replace('_', ' '):20} pulls with {tension.min():.2f} to {tension.max():.1f} N")
    output.mkdir(parents=True, exist_ok=True)
    figures = [
        plot_snapshots(marionette_scene(run), count=7),
        plot_run(run.trajectory, ["relbow_rx", "lknee_rx"], reference=run.reference),
        plot_reactions(run.trajectory, title="What the strings pull with"),
    ]
    save_png(figures, output / "18_marionette.png", dpi=110)
    return run


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
