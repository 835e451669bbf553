"""Captured motions on the marionette: ``python -m benchmarks.captures [FILE ...] [--strings 6 cross] [--speed 1 0.5]``.

BVH or AMC files are given as words, or as a list of paths in the environment variable ``CAPTURES`` (with colons between
them); without either only the made-up walk is made, which is always the last row. Each row is one motion: how it ended,
the error of the joints that strings hold (degrees, rms; with ``--follow markers`` that of the markers, mm), in the plan
and as a rig with slack strings, masses that are off and late, noisy sensors plays it
(`leastaction_marionette.check`), the least tension (N), and the seconds it took, also in the unit of the same run
(`benchmarks.unit`, where Pinocchio is installed). A goal that is missed has a mark.

``--picture FILE.png`` draws what each string buys: the errors over the number of strings. They are those of all joints
there, so that one number means the same with any set of strings.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchmarks import unit
from benchmarks.timing import Timing
from leastaction.errors import LeastActionError
from leastaction.io import Motion
from leastaction.models.marionette import CONTROLS, STRING_SETS, Hanging, marionette
from leastaction.viz import new_figure, save_png, styled
from leastaction_marionette import RigCheck, TrackingRun, check, load_motion, track, walk_in_place
from leastaction_marionette.choices import Follow

_SECONDS = 60.0  # for ten seconds of capture
_WALK = 0.8  # degrees, for the made-up walk
# Degrees that the held joints may be off on nine strings: at full speed, and at half of it.
_GOALS = {"cmu_02_01_walk": {1.0: 6.0, 0.5: 4.0}, "wave_hello": {1.0: 8.0, 0.5: 4.0}}
_PUSHES = -1e-6  # N


class Problem(NamedTuple):
    """A motion by its name, and how far its held joints may be off on nine strings (degrees)."""

    name: str
    motion: Motion
    goal: float | None


@dataclass(frozen=True)
class Row:
    """One motion on one set of strings."""

    problem: Problem
    strings: Hanging
    run: TrackingRun
    rig: RigCheck
    seconds: float

    @property
    def missed(self) -> list[str]:
        """The goals that are not met."""
        run, goal, duration = self.run, self.problem.goal, self.problem.motion.duration
        if (self.strings != 9 and self.problem.name != "made-up walk") or run.follow == "markers":
            goal = None
        goals = {
            "converges": run.result.success,
            "no string pushes": float(run.tension.min()) >= _PUSHES,
            f"at most {goal} degrees": goal is None or run.held_error <= goal,
            "a rig stays within twice the error": self.rig.passed,
            f"within {_SECONDS:g} s for 10 s": self.seconds <= _SECONDS * max(1.0, duration / 10.0),
        }
        return [text for text, met in goals.items() if not met]

    def line(self, one: float | None) -> str:
        """Return the line of the table; ``one``: the unit (s)."""
        run, problem = self.run, self.problem
        units = f"{self.seconds / one:11.3g}" if one is not None else f"{'-':>11s}"
        return (
            f"{problem.name:32s} {self.strings!s:>16s} {problem.motion.duration:8.2f} {run.result.status.name:>18s} "
            f"{run.off:8.2f} {self.rig.error:8.2f} {run.tension.min():9.4f} {self.seconds:8.1f} {units}  "
            + ("; ".join(f"MISSED: {each}" for each in self.missed) or "all goals met")
        )


def made(problem: Problem, strings: Hanging, iterations: int, follow: Follow) -> Row:
    """Follow one motion."""
    began = time.perf_counter()
    run = track(marionette(strings=strings), problem.motion, max_iterations=iterations, follow=follow)
    seconds = time.perf_counter() - began
    return Row(problem, strings, run, check(run), seconds)


def motions(files: list[Path], speeds: list[float], dt: float, *, markers: bool) -> Iterator[Problem]:
    """Yield the captures at all speeds, and the made-up walk."""
    for file in files:
        for speed in speeds:
            try:
                motion = load_motion(file, dt=dt, speed=speed, markers=markers).motion
            except LeastActionError as error:
                print(f"{file.name}: skipped: {str(error).splitlines()[0]}")
                break
            yield Problem(f"{file.stem} x{speed:g}", motion, _GOALS.get(file.stem, {}).get(speed))
    yield Problem("made-up walk", walk_in_place(10.0, dt), _WALK)


@styled
def draw(rows: Sequence[Row]) -> Figure:
    """Return the errors over the number of strings: of all joints, of the plan and on the rig."""
    figure = new_figure(7.0, 4.0)
    axes = figure.subplots()
    for name in dict.fromkeys(row.problem.name for row in rows):
        counted = [(row.strings, row) for row in rows if row.problem.name == name and isinstance(row.strings, int)]
        counts, own = zip(*sorted(counted, key=lambda each: each[0]), strict=True) if counted else ((), ())
        played = [
            np.inf if row.rig.played.failure is not None else row.run.errors_of(row.rig.played.q).joint_rms
            for row in own
        ]
        (plan,) = axes.plot(counts, [row.run.errors.joint_rms for row in own], "o-", label=name)
        axes.plot(counts, played, "x:", color=plan.get_color(), label=f"{name}, on the rig")
    axes.set(xlabel="strings", ylabel="all joints off by (degrees, rms)", ylim=(0.0, None))
    axes.set_xticks(sorted({row.strings for row in rows if isinstance(row.strings, int)}))
    axes.legend()
    return figure


def _hanging(word: str) -> int | str:
    """Return a number of strings, or the name of a control."""
    return int(word) if word.isdigit() else word


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.captures", description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="BVH or AMC files; those of CAPTURES if none are given")
    parser.add_argument("--strings", nargs="+", type=_hanging, choices=[*STRING_SETS, *CONTROLS], default=[9])
    parser.add_argument("--speed", nargs="+", type=float, default=[1.0])
    parser.add_argument("--dt", type=float, default=0.01)
    parser.add_argument("--iterations", type=int, default=500)
    parser.add_argument("--follow", choices=["joints", "markers"], default="joints")
    parser.add_argument("--picture", type=Path, help="where to draw the errors over the number of strings (PNG)")
    words = parser.parse_args()
    files = words.files or [Path(name) for name in os.environ.get("CAPTURES", "").split(os.pathsep) if name]
    unit_of_error = "deg" if words.follow == "joints" else "mm"
    before = unit.measure(0.5)
    one = before.best if isinstance(before, Timing) else None
    print(f"unit {1e6 * one:.1f} us" if one is not None else f"unit: {before}")
    off = f"off {unit_of_error}", f"rig {unit_of_error}"
    titles = ("motion", "strings", "seconds", "status", *off, "tension N", "took s", "took units")
    print("{:32s} {:>16s} {:>8s} {:>18s} {:>8s} {:>8s} {:>9s} {:>8s} {:>11s}".format(*titles))
    rows: list[Row] = []
    for problem in motions(files, words.speed, words.dt, markers=words.follow == "markers"):
        for strings in words.strings if problem.name != "made-up walk" else [6]:
            try:
                rows.append(made(problem, strings, words.iterations, words.follow))
            except LeastActionError as error:
                print(f"{problem.name:32s} {strings!s:>16s}  ended in an error: {error}", flush=True)
            else:
                print(rows[-1].line(one), flush=True)
    captured = [row for row in rows if row.problem.name != "made-up walk"]
    if words.picture is not None and captured:
        save_png(draw(captured), words.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
