"""Captured motions on the marionette: ``python -m benchmarks.captures [FILE ...] [--strings 6 9] [--speed 1 0.5]``.

BVH files are given as words, or as a list of paths in the environment variable ``CAPTURES`` (with colons between them);
without either only the made-up walk is made, which is always the last row. Each row is one motion: how it ended, the
error of the joints that strings hold (degrees, rms), in the plan and as a rig with slack strings, masses that are off
and late, noisy sensors plays it (`leastaction.apps.marionette.check`), the least tension (N), and the seconds it took,
also in the unit of the same run (`benchmarks.unit`, where Pinocchio is installed). A goal that is missed has a mark.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks import unit
from benchmarks.timing import Timing
from leastaction.apps.marionette import check, load_motion, track, walk_in_place
from leastaction.errors import LeastActionError
from leastaction.io import Motion
from leastaction.models.marionette import marionette

_SECONDS = 60.0  # for ten seconds of capture
_WALK = 0.8  # degrees, for the made-up walk
# Degrees that the held joints may be off on nine strings: at full speed, and at half of it.
_GOALS = {"cmu_02_01_walk": {1.0: 6.0, 0.5: 4.0}, "wave_hello": {1.0: 8.0, 0.5: 4.0}}
_PUSHES = -1e-6  # N


def row(name: str, motion: Motion, strings: int, goal: float | None, one: float | None, iterations: int) -> str:
    """Follow one motion, and return its line of the table."""
    began = time.perf_counter()
    try:
        run = track(marionette(strings=9 if strings == 9 else 6), motion, max_iterations=iterations)
    except LeastActionError as error:
        return f"{name:32s} {strings:7d}  ended in an error: {error}"
    seconds = time.perf_counter() - began
    off, least = run.held_error, float(run.tension.min())
    rig = check(run)
    missed = [
        text
        for text, met in (
            ("converges", run.result.success),
            ("no string pushes", least >= _PUSHES),
            (f"at most {goal} degrees", goal is None or off <= goal),
            ("a rig stays within twice the error", rig.passed),
            (f"within {_SECONDS:g} s for 10 s", seconds <= _SECONDS * max(1.0, motion.duration / 10.0)),
        )
        if not met
    ]
    units = f"{seconds / one:11.3g}" if one is not None else f"{'-':>11s}"
    return (
        f"{name:32s} {strings:7d} {motion.duration:8.2f} {run.result.status.name:>18s} {off:8.2f} {rig.error:8.2f} "
        f"{least:9.4f} {seconds:8.1f} {units}  " + ("; ".join(f"MISSED: {each}" for each in missed) or "all goals met")
    )


def motions(files: list[Path], speeds: list[float], dt: float) -> Iterator[tuple[str, Motion, float | None]]:
    """Yield names, motions and goals of the captures at all speeds, and of the made-up walk."""
    for file in files:
        for speed in speeds:
            try:
                motion = load_motion(file, dt=dt, speed=speed).motion
            except LeastActionError as error:
                print(f"{file.name}: skipped: {str(error).splitlines()[0]}")
                break
            yield f"{file.stem} x{speed:g}", motion, _GOALS.get(file.stem, {}).get(speed)
    yield "made-up walk", walk_in_place(10.0, dt), _WALK


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.captures", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="BVH files; those of CAPTURES if none are given")
    parser.add_argument("--strings", nargs="+", type=int, choices=(6, 9), default=[9])
    parser.add_argument("--speed", nargs="+", type=float, default=[1.0])
    parser.add_argument("--dt", type=float, default=0.01)
    parser.add_argument("--iterations", type=int, default=500)
    words = parser.parse_args()
    files = words.files or [Path(name) for name in os.environ.get("CAPTURES", "").split(os.pathsep) if name]
    before = unit.measure(0.5)
    one = before.best if isinstance(before, Timing) else None
    print(f"unit {1e6 * one:.1f} us" if one is not None else f"unit: {before}")
    titles = ("motion", "strings", "seconds", "status", "held deg", "rig deg", "tension N", "took s", "took units")
    print("{:32s} {:>7s} {:>8s} {:>18s} {:>8s} {:>8s} {:>9s} {:>8s} {:>11s}".format(*titles))
    for name, motion, goal in motions(files, words.speed, words.dt):
        for strings in words.strings if name != "made-up walk" else [6]:
            wanted = goal if strings == 9 or name == "made-up walk" else None
            print(row(name, motion, strings, wanted, one, words.iterations), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
