"""Everything that a mechanism is asked, and how the answers are held to be numbers."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from leastaction.errors import CoarseStepWarning, LeastActionError, SingularityWarning
from leastaction.mechanics import (
    Force,
    Mechanism,
    MidpointVI,
    SimulationStatus,
    project_configuration,
    project_velocity,
)

STEPS, DT = 4, 0.01


@dataclasses.dataclass
class Answers:
    """What came of the questions: which answers are not finite, which errors were raised, how far it went."""

    undefined: list[str] = dataclasses.field(default_factory=list)
    errors: list[tuple[str, LeastActionError]] = dataclasses.field(default_factory=list)
    stepped: str = "not started"


def ask_all(m: Mechanism, seed: int) -> Answers:
    """Ask everything at a random place, then let the mechanism move."""
    rng = np.random.default_rng(seed)
    answers = Answers()
    view, page = str(m), m._repr_html_()
    assert view.startswith(m.frames[0])
    assert page.endswith("</div>")
    assert repr(m).startswith("<Mechanism")
    assert all(name in view for name in (*m.variables, *m.inputs, *m.constraints))
    q, v, u = rng.uniform(-1, 1, m.nq), rng.uniform(-1, 1, m.nq), rng.uniform(-1, 1, m.nu)
    frame = m.frames[int(rng.integers(len(m.frames)))]
    for name, ask in _questions(m, rng, q, v, u, frame):
        _note(answers, name, ask)
    _move(answers, m, rng, q, v)
    return answers


def _questions(m: Mechanism, rng: np.random.Generator, q: Any, v: Any, u: Any, frame: str) -> Iterator[tuple[str, Any]]:
    core = m.core
    yield "energy", lambda: dataclasses.astuple(m.energy(q, v))
    yield "momentum", lambda: m.momentum(q, v)
    yield "mass matrix", lambda: m.mass_matrix(q)
    yield "gradient", lambda: core.gradient(q, v)
    yield "hessian", lambda: core.hessian(q, v)
    yield "third", lambda: core.third(q, v, rng.uniform(-1, 1, m.nq), rng.uniform(-1, 1, m.nq))
    yield "force", lambda: core.force(q, v, u)
    yield "force jacobians", lambda: core.force_jacobians(q, v, u)
    yield "force curvature", lambda: core.force_curvature(q, v, u, rng.uniform(-1, 1, m.nq))
    yield "constraints", lambda: m.constraint_values(q)
    yield "constraint jacobian", lambda: m.constraint_jacobian(q)
    yield "constraint hessian", lambda: core.constraint_hessian(q, rng.uniform(-1, 1, m.nc))
    yield "degrees of freedom", lambda: m.degrees_of_freedom(q)
    yield "positions", lambda: m.positions(q)
    yield "pose", lambda: m.frame_pose(q, frame)
    yield "jacobian", lambda: m.frame_jacobian(q, frame, point=(0.1, 0.2, 0.3), axes="frame")
    yield "velocity", lambda: m.frame_velocity(q, v, frame)
    yield "jacobian derivative", lambda: m.frame_jacobian_derivative(q, frame)
    d = rng.uniform(-1, 1, m.nq)
    yield "pose derivatives", lambda: m.frame_pose_derivative(q, frame, order=3, along=[d, d])
    yield "velocity derivatives", lambda: m.frame_velocity_derivative(q, v, frame, order=2, along=[d], axes="frame")
    yield "lagrangian", lambda: m.lagrangian(q, v).along(q=d, v=d).hessian
    forces = [name for name, element in m.elements.items() if isinstance(element, Force)]
    yield "forces by element", lambda: [m.force(q, v, u, name).gradients for name in forces]
    yield "total momentum", lambda: m.total_momentum(q, v)
    if m.mass:
        yield "centre of mass", lambda: m.center_of_mass(q)
    yield "parameters", lambda: list(m.parameters.values())


def _note(answers: Answers, name: str, ask: Any) -> Any:
    try:
        value = ask()
    except LeastActionError as error:
        answers.errors.append((name, error))
        return None
    parts = value if isinstance(value, (tuple, list)) else (value,)
    if not all(np.isfinite(np.asarray(part, dtype=float)).all() for part in parts):
        answers.undefined.append(name)
    return value


def _move(answers: Answers, m: Mechanism, rng: np.random.Generator, q: Any, v: Any) -> None:
    """Bring a place onto the constraints, go a few steps from it, differentiate them."""
    lengths = [getattr(element, "length", None) for element in m.elements.values()]
    q = q.copy()
    for name in m.kinematic:
        if name in lengths:
            q[m.variables.index(name)] = rng.uniform(0.5, 2.0)
    vi = MidpointVI(m, threads=1)
    try:
        if m.nc:
            q = project_configuration(m, q, max_iterations=60).q
            v = project_velocity(m, q, v, hold=m.kinematic).v if m.nd else v
        start = vi.start(q, v)
    except LeastActionError as error:
        answers.errors.append(("start", error))
        answers.stepped = "no start"
        return
    times = np.linspace(0.0, STEPS * DT, STEPS + 1)
    rho = q[m.nd :] + np.outer(np.arange(STEPS + 1), v[m.nd :]) * DT
    try:
        with warnings.catch_warnings():
            # Random motions are wild.
            warnings.simplefilter("ignore", SingularityWarning)
            warnings.simplefilter("ignore", CoarseStepWarning)
            trajectory = vi.simulate(start, times, inputs=rng.uniform(-1, 1, m.nu), rho=rho)
    except LeastActionError as error:
        answers.errors.append(("simulate", error))
        answers.stepped = "no start"
        return
    assert str(trajectory)
    for field in ("t", "q", "p", "v_rho", "inputs", "lam"):
        assert np.isfinite(getattr(trajectory, field)).all(), f"{field} of the trajectory"
    completed = trajectory.status is SimulationStatus.COMPLETED
    assert completed == (trajectory.steps == STEPS)
    assert trajectory.message
    answers.stepped = "completed" if completed else "step failed"
    if trajectory.steps:
        d = _note(answers, "linearize", lambda: _fields(vi.linearize(trajectory, multipliers=True)))
        if d is not None and m.nx < 30:
            weights = rng.uniform(-1, 1, (trajectory.steps, m.nx))
            derivatives = vi.linearize(trajectory)
            _note(answers, "curvature", lambda: vi.curvature(trajectory, derivatives, weights))
        names = list(m.parameters)
        some = [names[i] for i in rng.permutation(len(names))[:3]]
        _note(answers, "by parameters", lambda: vi.differentiate_by(trajectory, some).x)


def _fields(d: Any) -> list[Any]:
    return [d.A, d.B, d.lam_dx, d.lam_du]


def changes(m: Mechanism, seed: int, how: Any) -> Any:
    """Return new values of some parameters: nudged, or all of them the same bad one."""
    if isinstance(how, tuple) and len(how) == 1:
        return how[0]
    rng = np.random.default_rng(seed)
    names = list(m.parameters)
    if how == "nudge":
        # Products of inertia and rests keep in range where others grow.
        chosen = [n for n in names if rng.random() < 0.5 and ".inertia." not in n and ".rest" not in n]
        return {n: 1.01 * m.parameters[n] for n in chosen}
    return {names[int(rng.integers(len(names)))]: how[1]} if names else {}
