"""What the solution of a problem leaves in its folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from leastaction.apps.problems.problem import ProblemFile
from leastaction.numerics.arrays import Array
from leastaction.numerics.files import write_text
from leastaction.systems import Followed
from leastaction.viz import plot_convergence, plot_limits, plot_run, save_png, show

RESULT: Final = "result.npz"
FILES: Final = {
    RESULT: "the result: leastaction.open",
    "motion.csv": "the motion and its inputs, by names",
    "summary.txt": "what was found, to read",
    "summary.json": "what was found, for programs",
    "convergence.png": "cost against iteration",
    "tracking.png": "variables and inputs, beside what was wanted",
    "limits.png": "room and duals of the limits",
    "motion.html": "the motion: open it in a browser",
}
BESIDE: Final = tuple(name for name in FILES if name != RESULT)


def write_report(
    problem: ProblemFile, found: Followed, folder: Path, *, plots: bool, animation: bool
) -> dict[str, str]:
    """Write everything but the result itself; return what there is, by file, in words."""
    result = found.result
    written = [RESULT, "motion.csv", "summary.txt", "summary.json"]
    found.trajectory.save(folder / "motion.csv")
    limits = "" if result.limits is None else f"\n\n{result.limits}"
    write_text(folder / "summary.txt", f"{problem.title}\n\n{found}{limits}\n")
    write_text(folder / "summary.json", json.dumps(summary(problem, found), indent=1) + "\n")
    if plots:
        save_png(plot_convergence(result, title=problem.title), folder / "convergence.png")
        save_png(plot_run(result, reference=_reference(found), title=problem.title), folder / "tracking.png")
        written += ["convergence.png", "tracking.png"]
        if result.limits is not None and result.limits.sides:
            save_png(plot_limits(result, title=problem.title), folder / "limits.png")
            written.append("limits.png")
    if animation:
        places = [name for name, goal in found.wanted.items() if goal.ndim == 2]
        show(result, shapes=problem.model.shapes, traces=places, title=problem.title).save(folder / "motion.html")
        written.append("motion.html")
    return {name: FILES[name] for name in written}


def summary(problem: ProblemFile, found: Followed) -> dict[str, Any]:
    """Return what was found, as plain data."""
    result = found.result
    return {
        "title": problem.title,
        "status": result.status.name,
        "success": bool(result.success),
        "way": found.way,
        "cost": float(result.cost),
        "iterations": int(result.iterations),
        "steps": len(problem.t) - 1,
        "final time": float(found.trajectory.t[-1]),
        "errors (rms, rad or m)": found.errors,
        "limits excess": None if result.limits is None else float(result.limits.excess),
        "unknowns": {name: float(value) for name, value in result.unknowns.items()},
        "largest inputs": _largest_inputs(found),
    }


def _largest_inputs(found: Followed) -> dict[str, float]:
    run = found.trajectory
    return {name: float(np.abs(run.inputs[:, i]).max()) for i, name in enumerate(run.mechanism.inputs)}


def _reference(found: Followed) -> Array:
    """Return what was wanted of the variables (N+1, nq); NaN where nothing was."""
    run = found.trajectory
    nothing = np.full(len(run.t), np.nan)
    goals = [found.wanted.get(name, nothing) for name in run.mechanism.variables]
    return np.stack([goal if goal.ndim == 1 else nothing for goal in goals], axis=1)
