"""MuJoCo's step of the same puppet, and its linearisation by finite differences.

The mechanism is written as MJCF: the same joints and bodies, semi-implicit Euler, every string a spatial
tendon from its upper end to its hook whose length an equality constraint prescribes.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.cases import Array, Case
from benchmarks.settings import MICRO, Settings
from benchmarks.timing import Absent, Row, Timing, best_of, timed
from leastaction.mechanics import Damping, Distance, Gravity, Mechanism
from leastaction.mechanics.description.tree import WORLD

GROUP = "mujoco"


def rows(case: Case, settings: Settings) -> list[Row | Absent]:
    """Measure MuJoCo."""
    try:
        import mujoco
    except ImportError:
        return [Absent(GROUP, "MuJoCo, the same puppet", "mujoco is not installed")]
    dt = float(case.t[1] - case.t[0])
    model = mujoco.MjModel.from_xml_string(mjcf(case.mechanism, case.x0, dt))
    data = mujoco.MjData(model)
    lengths = _lengths(case) - model.tendon_length0
    initial = _initial(mujoco, model, case)

    def reset() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = initial
        model.eq_data[:, 0] = lengths[0]
        mujoco.mj_forward(model, data)

    step = mujoco.mj_step
    errors: list[float] = []
    seconds = np.empty(case.steps)

    def run() -> None:
        # The clock runs over the step alone, so that setting the lengths from Python does not count.
        for k in range(case.steps):
            model.eq_data[:, 0] = lengths[k + 1]
            start = time.perf_counter()
            step(model, data)
            seconds[k] = time.perf_counter() - start
            errors.append(np.abs(data.ten_length - model.tendon_length0 - lengths[k]).max())

    reset()
    run()
    moving = max(errors)
    for _ in range(200):
        step(model, data)
    held = float(np.abs(data.ten_length - model.tendon_length0 - lengths[-1]).max())
    times = []
    for _ in range(2 if settings.quick else 15):
        reset()
        run()
        times.append(float(seconds.sum()) / case.steps)
    timing = Timing(min(times), float(np.median(times)), len(times))
    reset()
    for k in range(case.steps // 3):
        model.eq_data[:, 0] = lengths[k + 1]
        step(model, data)
    A = np.empty((2 * model.nv, 2 * model.nv))

    def linearise() -> None:
        mujoco.mjd_transitionFD(model, data, 1e-6, False, A, None, None, None)

    forward = best_of(linearise, budget=settings.budget)

    def linearise_centred() -> None:
        mujoco.mjd_transitionFD(model, data, 1e-6, True, A, None, None, None)

    centred = best_of(linearise_centred, budget=settings.budget)
    version = mujoco.__version__
    return [
        timed(
            GROUP,
            f"MuJoCo {version} mj_step, Euler",
            timing,
            "step",
            reference=True,
            note=f"strings wrong by {1e3 * held:.2g} mm when held, up to {1e3 * moving:.2g} mm when moved",
            details={
                "string_error_held_m": held,
                "string_error_moved_m": float(moving),
                "design_seconds": 12.9 * MICRO,
            },
        ),
        timed(
            GROUP,
            "MuJoCo mjd_transitionFD, forward",
            forward,
            "step",
            reference=True,
            note="by the state only: it has no derivative by the strings",
        ),
        timed(GROUP, "MuJoCo mjd_transitionFD, centred", centred, "step", reference=True),
    ]


def mjcf(mechanism: Mechanism, x0: Array, dt: float) -> str:
    """Return the mechanism as MJCF.

    Joints one behind the other with nothing between them share a MuJoCo body, since MuJoCo takes no
    massless ones. What the kinematic variables move stands where `x0` has it.
    """
    m, tree = mechanism, mechanism.tree
    children: dict[int, list[int]] = {}
    for index, joint in enumerate(tree.joints):
        children.setdefault(joint.parent, []).append(index)
    inertias = _composites(m)
    strings = [e for e in m.elements.values() if isinstance(e, Distance)]
    frames = {frame.name: frame for frame in tree.frames}
    ends = {name for s in strings for name in (s.frame1, s.frame2)}
    sites: dict[int, list[str]] = {}
    for name in ends:
        sites.setdefault(frames[name].joint, []).append(name)
    damping = _damping(m)

    def body(index: int) -> str:
        first = tree.joints[index]
        lines = [f"<body {_placed(first.pose)}>"]
        while True:
            joint = tree.joints[index]
            kind = "slide" if np.any(joint.twist[:3]) else "hinge"
            axis = joint.twist[:3] if kind == "slide" else joint.twist[3:]
            lines.append(
                f'<joint name="{joint.variables[0]}" type="{kind}" axis="{_numbers(axis)}" '
                f'damping="{damping[joint.variables[0]]}"/>'
            )
            below = children.get(index, [])
            if index in inertias or index in sites or len(below) != 1:
                break
            if not np.array_equal(tree.joints[below[0]].pose, np.eye(4)):
                break
            index = below[0]
        if index in inertias:
            mass, com, inertia = inertias[index]
            entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            lines.append(f'<inertial mass="{mass!r}" pos="{_numbers(com)}" fullinertia="{_numbers(entries)}"/>')
        lines += [f'<site name="{name}" pos="{_numbers(frames[name].pose[:3, 3])}"/>' for name in sites.get(index, [])]
        lines += [body(child) for child in children.get(index, [])]
        return "".join([*lines, "</body>"])

    moving = "".join(body(i) for i in children[WORLD] if not tree.joints[i].kinematic)
    fixed = [name for name in sorted(ends) if _kinematic_only(m, frames[name].joint)]
    places = m.positions(x0[: m.nq], fixed)
    anchors = "".join(
        f'<body name="at {name}" mocap="true" pos="{_numbers(place)}"><site name="{name}"/></body>'
        for name, place in zip(fixed, places, strict=True)
    )
    tendons = "".join(
        f'<spatial name="string{i}"><site site="{s.frame1}"/><site site="{s.frame2}"/></spatial>'
        for i, s in enumerate(strings)
    )
    equalities = "".join(f'<tendon tendon1="string{i}"/>' for i in range(len(strings)))
    gravity = next(e for e in m.elements.values() if isinstance(e, Gravity))
    return (
        f'<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{dt!r}" integrator="Euler" gravity="{_numbers(gravity.vector)}"/>'
        f"<worldbody>{moving}{anchors}</worldbody><tendon>{tendons}</tendon>"
        f"<equality>{equalities}</equality></mujoco>"
    )


def _initial(mujoco: Any, model: Any, case: Case) -> tuple[Array, Array]:
    """Return MuJoCo's positions and velocities of the first state."""
    m = case.mechanism
    q, p = case.x0[: m.nq], case.x0[m.nq : m.nq + m.nd]
    # The kinematic variables are at rest, so the momentum is the dynamic block's alone.
    v = np.linalg.solve(m.mass_matrix(q)[: m.nd, : m.nd], p)
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    for i, name in enumerate(m.dynamic):
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        qpos[model.jnt_qposadr[joint]] = q[i]
        qvel[model.jnt_dofadr[joint]] = v[i]
    return qpos, qvel


def _lengths(case: Case) -> Array:
    """Return the lengths of the strings (N+1, strings)."""
    m = case.mechanism
    columns = [
        m.kinematic.index(e.length)
        for e in m.elements.values()
        if isinstance(e, Distance) and isinstance(e.length, str)
    ]
    rho = np.vstack([case.x0[m.nd : m.nq], case.u[:, m.nu :]])
    return rho[:, columns]


def _composites(mechanism: Mechanism) -> dict[int, tuple[float, Array, Array]]:
    """Return mass, centre and inertia about it of all bodies on each joint."""
    parts: dict[int, list[tuple[float, Array, Array]]] = {}
    for joint, body, pose in mechanism.tree.bodies():
        rotation, origin = pose[:3, :3], pose[:3, 3]
        parts.setdefault(joint, []).append(
            (body.mass, rotation @ body.com + origin, rotation @ body.inertia @ rotation.T)
        )
    result = {}
    for joint, bodies in parts.items():
        mass = sum(b[0] for b in bodies)
        com = sum((b[0] * b[1] for b in bodies), np.zeros(3)) / mass
        inertia = np.zeros((3, 3))
        for m, centre, own in bodies:
            d = centre - com
            inertia += own + m * (d @ d * np.eye(3) - np.outer(d, d))
        result[joint] = (mass, com, inertia)
    return result


def _damping(mechanism: Mechanism) -> dict[str, float]:
    """Return the damping of every dynamic variable."""
    total = dict.fromkeys(mechanism.dynamic, 0.0)
    for element in mechanism.elements.values():
        if isinstance(element, Damping):
            for name in total:
                total[name] += element.named.get(name, element.default)
    return total


def _kinematic_only(mechanism: Mechanism, joint: int) -> bool:
    tree = mechanism.tree
    return all(tree.joints[i].kinematic for i in tree.ancestors(joint))


def _placed(pose: Array) -> str:
    return f'pos="{_numbers(pose[:3, 3])}" xyaxes="{_numbers(pose[:3, :2].T.ravel())}"'


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(v)) for v in values)
