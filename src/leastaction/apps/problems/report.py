"""What the solution of a problem leaves in its folder."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from leastaction.apps.problems.problem import ProblemFile
from leastaction.errors import OutputError
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.files import write_text
from leastaction.systems import Followed
from leastaction.viz import (
    Cord,
    mechanism_scene,
    plot_convergence,
    plot_limits,
    plot_tracking,
    save_png,
    write_animation,
)

RESULT: Final = "result.npz"
FILES: Final = {
    RESULT: "the result: leastaction.io.load_result",
    "motion.csv": "the motion and its inputs, by names",
    "summary.txt": "what was found, to read",
    "summary.json": "what was found, for programs",
    "convergence.png": "cost against iteration",
    "tracking.png": "what was wanted, and what was made",
    "limits.png": "room and duals of the limits",
    "motion.html": "the motion: open it in a browser",
}


def remove_report(folder: Path) -> None:
    """Remove what an earlier run left: pictures that would lie beside a result that is not theirs.

    Raises `OutputError`: a file cannot be removed.
    """
    for name in FILES:
        try:
            if name != RESULT:
                (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"cannot remove {folder / name} of an earlier run: {error.strerror}") from error


def write_report(
    problem: ProblemFile, found: Followed, folder: Path, *, plots: bool, animation: bool
) -> dict[str, str]:
    """Write everything but the result itself; return what there is, by file, in words."""
    result, run = found.result, found.trajectory
    written = [RESULT, "motion.csv", "summary.txt", "summary.json"]
    write_text(folder / "motion.csv", _table(found))
    limits = "" if result.limits is None else f"\n\n{result.limits}"
    write_text(folder / "summary.txt", f"{problem.title}\n\n{found}{limits}\n")
    write_text(folder / "summary.json", json.dumps(summary(problem, found), indent=1) + "\n")
    if plots:
        history = result.history
        figure = plot_convergence(history.cost, history.expected_decrease, history.method, title=problem.title)
        save_png(figure, folder / "convergence.png")
        written.append("convergence.png")
        columns = _wanted_columns(found)
        if columns is not None:
            wanted, made, names, lengths = columns
            save_png(
                plot_tracking(run.t, wanted, made, names, lengths=lengths, title=problem.title), folder / "tracking.png"
            )
            written.append("tracking.png")
        if result.limits is not None and result.limits.sides:
            save_png(plot_limits(problem.t, result.limits, title=problem.title), folder / "limits.png")
            written.append("limits.png")
    if animation:
        m = run.mechanism
        places = [name for name, goal in found.wanted.items() if goal.ndim == 2]
        scene = mechanism_scene(m, run.t, run.q, cords=_cords(m), traces=places, title=problem.title)
        write_animation(scene, folder / "motion.html")
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


def _table(found: Followed) -> str:
    """Return times, variables and inputs as CSV; the inputs of a step stand where it begins."""
    run = found.trajectory
    m = run.mechanism
    rows = [",".join(json.dumps(name) if "," in name else name for name in ("t", *m.variables, *m.inputs))]
    for k, t in enumerate(run.t.tolist()):
        inputs = run.inputs[k].tolist() if k < run.steps else [""] * m.n_inputs
        rows.append(",".join(map(str, [t, *run.q[k].tolist(), *inputs])))
    return "\n".join(rows) + "\n"


def _wanted_columns(found: Followed) -> tuple[Array, Array, list[str], list[str]] | None:
    """Return what was wanted all the time, what was made of it, the names, and which are lengths."""
    run = found.trajectory
    m = run.mechanism
    turning = {name for joint in m.tree.joints for name in joint.variables if joint.twist[3:].any()}
    wanted, made, names, lengths = [], [], [], []
    for name, goal in found.wanted.items():
        if np.isnan(goal).any():
            continue
        if goal.ndim == 1:
            wanted.append(goal)
            made.append(run[name])
            names.append(name)
            lengths += [] if name in turning else [name]
            continue
        places = m.positions(np.ascontiguousarray(run.q), [name])[:, 0]
        for axis, letter in enumerate("xyz"):
            wanted.append(goal[:, axis])
            made.append(places[:, axis])
            names.append(f"{name} {letter}")
            lengths.append(f"{name} {letter}")
    if not names:
        return None
    return np.stack(wanted, axis=1), np.stack(made, axis=1), names, lengths


def _cords(m: Mechanism) -> list[Cord]:
    """Return strings and springs as what is drawn between frames."""
    pieces = {
        name: [pair for path in element.strings for pair in pairwise(path)] for name, element in m.elements.items()
    }
    return [
        Cord(name=name if len(each) == 1 else f"{name} {i + 1}", start=a, end=b)
        for name, each in pieces.items()
        for i, (a, b) in enumerate(each)
    ]
