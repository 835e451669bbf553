"""Continuous time: the marionette's accelerations and their derivatives, and Talos beside Pinocchio."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import numpy as np

from benchmarks.cases import ROOT, Array, Case
from benchmarks.settings import MICRO, Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import ContinuousDynamics, MidpointVI

GROUP = "continuous"
ROBOT = "talos"

# Points in one call; few enough for their results to stay in the cache.
_POINTS = 20


def rows(case: Case, settings: Settings) -> list[Row | Absent]:
    """Measure; per point, many points in one call, and one point alone."""
    return [*_marionette(case, settings), *_talos(settings)]


def _marionette(case: Case, settings: Settings) -> list[Row]:
    m = case.mechanism
    dynamics = ContinuousDynamics(m, threads=1)
    points = _motion(case)
    rng = np.random.default_rng(0)
    weights = [rng.normal(size=(_POINTS, n)) for n in (m.nd, m.nc)]
    core, budget = dynamics.core, settings.budget
    slopes = core.linearize(*points, 1).derivatives
    H = core.curvatures(*points, *weights, 1).derivatives
    one = [part[:1].copy() for part in points]
    accelerations = best_of(lambda: core.accelerations(*points, 1), budget=budget)
    first = best_of(lambda: core.linearize(*points, 1, slopes), budget=budget)
    second = best_of(lambda: core.curvatures(*points, *weights, 1, H), budget=budget)
    checked = [part[0] for part in points]
    return [
        timed(GROUP, "accelerations", accelerations / _POINTS, "point", target=10 * MICRO),
        timed(
            GROUP,
            "accelerations and first derivatives",
            first / _POINTS,
            "point",
            target=25 * MICRO,
        ),
        timed(
            GROUP,
            "accelerations, first and contracted second derivatives",
            second / _POINTS,
            "point",
            target=80 * MICRO,
        ),
        timed(
            GROUP,
            "accelerations, one point alone",
            best_of(lambda: [core.accelerations(*one, 1) for _ in range(_POINTS)], budget=budget) / _POINTS,
            "call",
        ),
        timed(
            GROUP,
            "accelerations, one point alone, arguments checked",
            best_of(lambda: [dynamics.accelerations(*checked) for _ in range(_POINTS)], budget=budget) / _POINTS,
            "call",
        ),
    ]


def _motion(case: Case) -> tuple[Array, Array, Array, Array]:
    """Return q, v, u and rho_a of points along the case's motion."""
    m = case.mechanism
    x = MidpointVI(m).core.roll_out(case.t, case.x0, None, case.u, None).x
    q = x[:, : m.nq]
    v = np.gradient(q, case.t, axis=0)
    rho_a = np.gradient(v[:, m.nd :], case.t, axis=0)
    at = np.linspace(0, case.steps, _POINTS).astype(int)
    return (
        q[at].copy(),
        v[at].copy(),
        case.u[at.clip(max=case.steps - 1), : m.nu].copy(),
        rho_a[at].copy(),
    )


def _talos(settings: Settings) -> list[Row | Absent]:
    """Forward dynamics and its derivatives by q, v and the forces on all 38 variables."""
    name = f"{ROBOT.capitalize()}, accelerations and first derivatives"
    try:
        import example_robot_data
        import pinocchio
    except ImportError as error:
        return [Absent(GROUP, name, f"{error.name} is not installed")]
    model = example_robot_data.load(ROBOT).model
    model.armature = np.zeros(model.nv)
    m = conversion().mechanism_of(model)
    core = ContinuousDynamics(m, threads=1).core
    rng = np.random.default_rng(0)
    q, v, tau = 0.5 * rng.normal(size=(3, 1, m.nq))
    none = np.zeros((1, 0))
    data = model.createData()
    theirs = pinocchio.integrate(model, pinocchio.neutral(model), q[0])
    speeds, forces = v[0].copy(), tau[0].copy()
    derivatives = pinocchio.computeABADerivatives

    def pinocchio_calls() -> None:
        for _ in range(_POINTS):
            derivatives(model, data, theirs, speeds, forces)

    def our_calls() -> None:
        for _ in range(_POINTS):
            core.linearize(q, v, tau, none, 1)

    ours = best_of(our_calls, budget=settings.budget) / _POINTS
    reference = best_of(pinocchio_calls, budget=settings.budget) / _POINTS
    return [
        timed(
            GROUP,
            name,
            ours,
            "call",
            note=f"{m.nq} variables: a free flyer as three translations and three angles",
        ),
        timed(GROUP, "Pinocchio computeABADerivatives, Talos", reference, "call", reference=True),
        Row(GROUP, "Talos / Pinocchio", ours.best / reference.best, unit="", target=1.5),
    ]


def conversion() -> ModuleType:
    """Return the tests' conversion of Pinocchio's models, which is no part of a package."""
    name, path = "_pinocchio_models", ROOT / "tests" / "oracles" / "pinocchio_models.py"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
