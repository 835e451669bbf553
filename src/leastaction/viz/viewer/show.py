"""`show`: scenes of a mechanism, a model, a run or a result, and what to do with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.mechanics.description.shapes import Shape
from leastaction.mechanics.mechanism.arguments import of_unit_length, single
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.names import as_names
from leastaction.numerics.public import public
from leastaction.optimal import LimitReport, LimitState
from leastaction.systems.closed_loop import ClosedLoop
from leastaction.systems.rig import Played
from leastaction.viz.scene import ActiveLimit, Arrow, Scene
from leastaction.viz.viewer.actions import Actions, cords_of
from leastaction.viz.viewer.kinematics import kinematics
from leastaction.viz.viewer.sampling import refined
from leastaction.viz.viewer.sides import plane_normal, side, upright, upward
from leastaction.viz.viewer.skeletons import joint_marks, skeleton
from leastaction.viz.viewer.view import View

_SHARP = 1e-3  # of the size: how far a straight line between two samples may be off


@public
def show(
    what: Any,
    *,
    q: ArrayLike | None = None,
    shapes: Sequence[Shape] | None = None,
    reference: Any = None,
    beside: Any = None,
    traces: Sequence[str] = (),
    up: str | Sequence[float] | None = None,
    joints: bool = False,
    forces: bool = False,
    title: str = "",
) -> View:
    """Show a mechanism, or how it moves.

    In a notebook the result shows itself; ``.open()`` shows it in a browser, and ``.save("x.html")``, ``.png``,
    ``.gif``, ``.mp4`` and ``.glb`` write it to a file.

    Parameters
    ----------
    what : Mechanism, Model, Trajectory, ContinuousTrajectory, Played, ClosedLoop, or a result with a ``trajectory``
        What is shown. A mechanism or a model stands still. A list of runs stands side by side. Limits of a result that
        are active are marked on the time bar.
    q : array_like, shape (nq,), optional
        Where a mechanism or a model stands; at zero if not given.
    shapes : sequence of Shape, optional
        What frames look like. Those of a model if not given; without any, bars between frames, and balls and boxes
        with the mass and inertia of bodies.
    reference : array_like, shape (N+1, nq) or (nq,), or a run of as many instants, optional
        What was to be followed, drawn as a translucent ghost.
    beside : as ``what``, optional
        Another one that is shown beside it.
    traces : sequence of str, optional
        Frames whose paths are drawn.
    up : {"x", "y", "z", "-x", "-y", "-z"} or array_like, shape (3,), optional
        Which way is up; if not given, against gravity, and without gravity z, or in the plane for a mechanism that
        moves in the plane of x and y.
    joints, forces : bool, optional
        Whether joints and their axes, forces, torques and reactions are shown from the start.
    title : str, optional
        Heading.

    Returns
    -------
    View

    Raises
    ------
    ArgumentError
        It is nothing that can be shown, an array does not fit the mechanism, a frame is unknown, or a mesh cannot be
        read.
    """
    listed = list(what) if isinstance(what, (list, tuple)) else [what]
    listed += [] if beside is None else [beside]
    if not listed:
        raise ArgumentError("show: got an empty list, expected mechanisms, models, runs or results")
    how = DrawnAs(shapes, reference, as_names(traces, "traces", "frames"), up, title)
    first, *others = listed
    scenes = [_scene(first, q, how), *(_scene(each, q, how._replace(reference=None)) for each in others)]
    return View(tuple(scenes), joints=joints, forces=forces)


class DrawnAs(NamedTuple):
    """How something is to be drawn, as `show` is asked."""

    shapes: Sequence[Shape] | None
    reference: Any
    traces: Sequence[str]
    up: str | Sequence[float] | None
    title: str


def _scene(what: Any, q: ArrayLike | None, how: DrawnAs) -> Scene:
    """Return the scene of one thing."""
    if isinstance(what, Scene):
        return what
    own = getattr(what, "shapes", ()) if how.shapes is None else how.shapes
    how = how._replace(shapes=tuple(own), title=how.title or getattr(what, "name", "") or "leastaction")
    moves = isinstance(what, BaseTrajectory | Played | ClosedLoop)
    if isinstance(what, Mechanism) or not (moves or hasattr(what, "trajectory")):
        m = what if isinstance(what, Mechanism) else getattr(what, "mechanism", None)
        if not isinstance(m, Mechanism):
            raise ArgumentError(
                f"show: got {type(what).__name__}, expected a Mechanism, a model that was loaded, a run, or a result "
                "that knows its trajectory; of another result show(system.trajectory(result.x, result.u))"
            )
        at = m.configuration() if q is None else single(m, q)
        return motion_scene(m, np.zeros(1), at[None], how)
    if q is not None:
        raise ArgumentError("q: only a mechanism or a model stands somewhere; a run has its own configurations")
    run = what if moves else what.trajectory
    if not isinstance(run, BaseTrajectory | Played | ClosedLoop) or run.mechanism is None:
        raise ArgumentError(f"show: what a {type(what).__name__} has over time is no motion of a mechanism")
    scene = _run_scene(run, how)
    report = getattr(getattr(what, "result", what), "limits", None)  # what was followed has its result within
    return replace(scene, limits=active_limits(report, run.t)) if isinstance(report, LimitReport) else scene


def _run_scene(run: Any, how: DrawnAs) -> Scene:
    """Return the scene of a motion, with more instants where it moves fast between its own."""
    m, t = run.mechanism, run.t
    times = t
    if len(t) > 1:
        places = m.positions(run.q)
        size = max(float(np.linalg.norm(np.ptp(places, axis=1), axis=1).max()), 1e-6)
        middle = _between(run, 0.5 * (t[1:] + t[:-1]))
        misses = np.linalg.norm(m.positions(middle) - 0.5 * (places[1:] + places[:-1]), axis=2).max(axis=1)
        times = refined(t, misses, _SHARP * size)
    q = _between(run, times)
    reference = how.reference
    if reference is not None:
        given = reference.q if isinstance(reference, BaseTrajectory) else reference
        array = np.atleast_2d(np.asarray(given, dtype=float))
        array = np.repeat(array, len(t), axis=0) if len(array) == 1 else array
        array = as_array(array, "reference", (len(t), m.nq), names=m.coordinates)
        reference = of_unit_length(m, np.column_stack([np.interp(times, t, column) for column in array.T]))
    acts = Actions(run, times, q) if isinstance(run, BaseTrajectory) else None  # others have no multipliers
    tension, arrows = (acts.tension(), acts.arrows()) if acts else (None, ())
    return motion_scene(m, times, q, how._replace(reference=reference), tension=tension, arrows=arrows)


def _between(run: Any, times: Array) -> Array:
    """Return the configurations of a run at any times, (n, nq): by its dense output, else on straight lines."""
    if getattr(run, "dense", None) is not None:
        states: Any = run
        return np.asarray(states(times)[:, : run.mechanism.nq])
    found = np.column_stack([np.interp(times, run.t, column) for column in run.q.T]).reshape(len(times), -1)
    return of_unit_length(run.mechanism, found)


def motion_scene(
    m: Mechanism,
    t: Array,
    q: Array,
    how: DrawnAs,
    *,
    tension: dict[str, Array] | None = None,
    arrows: Sequence[Arrow] = (),
) -> Scene:
    """Return the scene of a motion of a mechanism, upright and seen from its best side."""
    shapes, reference, traces, up, title = how
    assert shapes is not None
    for name in (*traces, *(shape.frame for shape in shapes)):
        m.frame_pose(q[0], name)  # which says what frames there are
    normal = plane_normal(m, q[0])
    turn = upright(upward(m, up, normal))
    drawn = skeleton(m, q)
    bones = () if shapes else drawn.bones
    solids = tuple(shape for shape in shapes if shape.color[3] > 0.0) or drawn.shapes
    cords = cords_of(m)
    size = max(float(np.linalg.norm(np.ptp(m.positions(q), axis=1), axis=1).max()), 0.1)
    # Where a file says what a mechanism looks like, its slides are seen without rails.
    marks = [mark for mark in joint_marks(m, q, size) if mark.kind != "slide" or not shapes]
    names = [name for bone in bones for name in (bone.start, bone.end)]
    names += [name for cord in cords for name in cord.path] + [*traces]
    focus = _floating(m)
    frames = dict.fromkeys([*names, *([focus] if focus else []), m.frames[0]])
    held = dict.fromkeys([*(s.frame for s in solids), *(mark.frame for mark in marks)])
    seen = side(normal, turn)

    def points(at: Array, of: Sequence[str]) -> dict[str, Array]:
        places = m.positions(at, of) @ turn.T
        return {name: places[:, i] for i, name in enumerate(of)}

    def poses(at: Array, of: Sequence[str]) -> dict[str, Array]:
        whole = np.eye(4)
        whole[:3, :3] = turn
        return {name: whole @ m.frame_pose(at, name) for name in of}

    wanted = None
    if reference is not None:
        given = as_array(reference, "reference", (len(t), m.nq), (m.nq,), names=m.coordinates)
        wanted = as_array(np.atleast_2d(given), "reference", (len(t), m.nq), names=m.coordinates)
    return Scene(
        t=t,
        kinematics=kinematics(m, q[0], turn, [*frames, *held], size) if len(t) == 1 and reference is None else None,
        points=points(q, list(frames)),
        bones=tuple(bones),
        cords=tuple(cords),
        ghost=points(wanted, list(dict.fromkeys([*names, m.frames[0]]))) if wanted is not None else None,
        tension=tension or None,
        traces=tuple(traces),
        focus=focus,
        base=m.frames[0],
        title=title,
        poses=poses(q, list(held)),
        ghost_poses=poses(wanted, list(dict.fromkeys(s.frame for s in solids))) if wanted is not None else None,
        shapes=solids,
        arrows=tuple(replace(a, place=a.place @ turn.T, vector=a.vector @ turn.T) for a in arrows),
        marks=tuple(marks),
        azimuth=seen[0] if seen else 40.0,
        elevation=seen[1] if seen else 16.0,
    )


def _floating(m: Mechanism) -> str:
    """Return the frame that a mechanism without a base is followed by; empty for one that stands in the world."""
    for group, indices in m.tree.compositions:
        if group.kind == "free":
            return m.tree.frames[indices[-1]].name
    row = [
        at.name
        for at in m.tree.frames[1:4]
        if at.frame.twist is not None and not at.frame.twist[3:].any() and at.frame.variables
    ]
    return row[-1] if len(row) == 3 else ""


def active_limits(report: LimitReport, t: Array) -> tuple[ActiveLimit, ...]:
    """Return when which limit of an optimisation holds the motion back. ``t`` (N+1,): the times of its instants."""
    found = [
        ActiveLimit(name=label, spans=_spans(state, column, t))
        for state in report.sides
        if not state.equation
        for column, label in enumerate(state.labels)
    ]
    return tuple(limit for limit in found if limit.spans)


def _spans(state: LimitState, column: int, t: Array) -> tuple[tuple[float, float], ...]:
    """Return from when to when a limit is active; each instant counts until the next."""
    times = state.t if state.t is not None else t[np.minimum(state.k, len(t) - 1)]
    ends = np.append(times[1:], min(2.0 * times[-1] - times[-2], t[-1]) if len(times) > 1 else times[-1])
    on = np.flatnonzero(state.active[:, column])
    groups = np.split(on, np.flatnonzero(np.diff(on) > 1) + 1) if len(on) else []
    return tuple((float(times[g[0]]), float(ends[g[-1]])) for g in groups)
