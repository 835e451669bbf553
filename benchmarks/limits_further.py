"""Obstacles, strings that only pull, bounded reactions and gaits, beside Ipopt on the same discrete problems.

They are rows of ``python -m benchmarks.limits``. Ipopt gets them as direct multiple shooting by
`benchmarks.multiple_shooting`: multipliers are unknowns of every step, distances from obstacles and tensions are rows
beside the step's equations, and a motion that returns has a first state that is free and the same as its last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from benchmarks import cases as marionettes
from benchmarks import marionette
from benchmarks.casadi_mechanism import Symbolic
from benchmarks.cases import Array
from benchmarks.fatrop import solve_by
from benchmarks.multiple_shooting import EXACTLY, MultipleShooting, Solution, StepRows
from benchmarks.peers import Comparison, start_of
from benchmarks.robustness_problems import Given, arm, chain, constant, hung, posed, puppet_arm, slider_crank
from benchmarks.timing import fastest
from leastaction.mechanics import (
    Body,
    Damping,
    Distance,
    Element,
    Gravity,
    Mechanism,
    equilibrium,
    world,
)  # fmt: skip
from leastaction.models.broad_hand import broad_hand
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction.optimal import Bound, Limit, OptimizationResult, Periodic, QuadraticCost, optimize
from leastaction.systems import Ball, Keep, MidpointSystem

__all__ = ["CASES", "Case", "Kept", "compare"]


@dataclass(frozen=True)
class Kept:
    """A problem with limits, for both solvers.

    Attributes
    ----------
    given : Given
        Without multipliers in the state.
    limits : list of Limit
    paths : list of StepRows
        The same, but for bounds on inputs, for Ipopt.
    most : tuple of arrays
        Least and largest inputs, each to be broadcast to (N, nu).
    multipliers : bool
        Whether limits ask for the multipliers in the state.
    returns : bool
        Whether the motion returns, from a first state that is free.
    """

    given: Given
    limits: list[Limit]
    paths: list[StepRows] = field(default_factory=list)
    most: tuple[Any, Any] = (-np.inf, np.inf)
    multipliers: bool = False
    returns: bool = False


@dataclass(frozen=True)
class Case:
    """A name, the function that builds the problem of that name, and whether its first state is free."""

    name: str
    build: Callable[[], Kept]
    returns: bool = False


# ---- Limits for both ----------------------------------------------------------------------------


def _pushes(
    given: Given, most: float | Mapping[str, float], least: float | None = None
) -> tuple[list[Limit], tuple[Array, Array]]:
    """Return bounds on all inputs, or on those with names: on both sides if no least is given."""
    names = given.system.quantity("input").names
    chosen = most if isinstance(most, Mapping) else dict.fromkeys(names, most)
    low, high = np.full(given.system.nu, -np.inf), np.full(given.system.nu, np.inf)
    limits: list[Limit] = []
    for name, value in chosen.items():
        low[names.index(name)], high[names.index(name)] = -value if least is None else least, value
        limits.append(Bound(name, low[names.index(name)], value if np.isfinite(value) else None, of="input"))
    return limits, (low, high)


def _obstacles(
    frames: Sequence[str], balls: Sequence[tuple[Sequence[float], float]]
) -> tuple[list[Limit], list[StepRows]]:
    """Return what keeps the origins of frames outside of balls, each a centre and a radius."""
    limits: list[Limit] = [Keep(f, outside=Ball(center, radius)) for f in frames for center, radius in balls]
    radii = np.array([radius for _, radius in balls] * len(frames))

    def distances(model: Symbolic, x1: Any, u: Any, lam: Any, x2: Any) -> Any:  # noqa: ARG001
        apart = [model.position(frame) - ca.DM(center) for frame in frames for center, _ in balls]
        squares = ca.vertcat(*(ca.dot(each, each) for each in apart))
        return ca.Function("squares", [model.q], [squares])(x2[: model.mechanism.nq])

    return limits, [StepRows(distances, low=radii**2)]


def _tensions(
    given: Given, least: Mapping[str, float], most: float | None = None
) -> tuple[list[Limit], list[StepRows]]:
    """Return what keeps tensions of strings from falling below their least (N), and above the most if that is given."""
    limits: list[Limit] = [Bound(name, low, most, of="tension") for name, low in least.items()]
    dt = float(given.system.t[1] - given.system.t[0])

    def tensions(model: Symbolic, x1: Any, u: Any, lam: Any, x2: Any) -> Any:  # noqa: ARG001
        m, values = model.mechanism, []
        for name in least:
            length = m.elements[name].length
            size = x1[m.variables.index(length)] if isinstance(length, str) else length
            values.append(2.0 * size * lam[m.constraints.index(name)] / dt)
        return ca.vertcat(*values)

    return limits, [StepRows(tensions, np.array(list(least.values())), np.inf if most is None else most)]


def _reactions(given: Given, most: float) -> tuple[list[Limit], list[StepRows]]:
    """Return what keeps the reactions of all constraints within a bound on both sides (N)."""
    impulse = most * float(given.system.t[1] - given.system.t[0])
    kept = StepRows(lambda model, x1, u, lam, x2: lam, -impulse, impulse)  # noqa: ARG005
    return [Bound("*", -impulse, impulse, of="multiplier")], [kept]


# ---- Reaching between obstacles -------------------------------------------------------------------


def _reach(
    axes: str, start: dict[str, float], goal: dict[str, float], balls: Sequence[tuple[Sequence[float], float]]
) -> Kept:
    """Return an arm that reaches between balls with its hand, and with its elbow."""
    given = posed(arm(axes), start, constant(**goal), N=150, dt=0.01, Q=1.0, final=1e3, R=1e-3, kind="rest")
    limits, kept = _obstacles((f"end{len(axes) - 1}", f"end{len(axes) - 3}"), balls)
    bounds, most = _pushes(given, 32.0)
    return Kept(given, [*limits, *bounds], kept, most)


_PLANAR: tuple[Any, ...] = (
    "xxxx", {}, {"joint0": 1.3, "joint1": 0.4, "joint2": 0.5, "joint3": -0.6},
    [((0.0, 0.7, -1.55), 0.15), ((0.0, 1.5, -0.65), 0.12), ((0.0, 0.6, -0.75), 0.12)],
)  # fmt: skip
_SPATIAL: tuple[Any, ...] = (
    "zyxyzyx", {"joint1": 0.3}, {"joint0": 1.0, "joint1": 1.0, "joint2": 0.3, "joint3": 0.6, "joint5": 0.5},
    [((-1.05, -0.75, -2.2), 0.2), ((-1.3, -1.4, -1.2), 0.22), ((-0.75, -0.45, -1.45), 0.2)],
)  # fmt: skip


# ---- Strings that only pull -----------------------------------------------------------------------


def _hand_of_puppet(returns: bool) -> Kept:
    """Return a puppet's arm that waves about where it hangs, once or for ever, on strings that only pull."""
    m = puppet_arm(3)
    hangs = equilibrium(m, m.configuration(hung(0.6, 0.5, 0.3))).q
    start = dict(zip(m.variables, hangs, strict=True))
    given = posed(
        m, start, lambda t: {
            "joint0": start["joint0"] + 0.2 * np.sin(2.0 * np.pi * t / t[-1]),
            "joint1": start["joint1"] + 0.4 * np.sin(2.0 * np.pi * t / t[-1] + 1.0),
        }, N=150, dt=0.01, Q=10.0, final=10.0, R=1e-2, rates=1.0 if returns else 1e-2, kind="rest",
    )  # fmt: skip
    limits, kept = _tensions(given, dict.fromkeys(m.constraints, 1.5))
    return Kept(given, limits, kept, multipliers=True, returns=returns)


def _platform() -> Kept:
    """Return a load on six strings that are reeled, two from each of three posts, that is carried and turned."""
    tree = world()
    place = tree.tx("x").ty("y").tz("z").rz("yaw").ry("pitch").rx("roll", name="hull")
    place.tx(0.0, name="load", bodies=[Body(5.0, inertia=(0.15, 0.15, 0.25))])
    elements: list[Element] = [Gravity(), Damping(0.05)]
    q0 = {"z": 0.5}
    for post in range(3):
        top = _around(120.0 * post, 2.0, 2.5)
        tree.pose(translation=top, name=f"post{post}")
        for side in (-1, 1):
            k = 2 * post + (side > 0)
            corner = _around(120.0 * post + 60.0 * side, 0.3, 0.1)
            place.pose(translation=corner, name=f"corner{k}")
            elements.append(Distance(f"corner{k}", f"post{post}", f"reel{k}", name=f"string{k}"))
            q0[f"reel{k}"] = float(np.linalg.norm(np.add(corner, (0.0, 0.0, 0.5)) - top))
    given = posed(
        Mechanism(tree, elements), q0, lambda t: {
            "x": 0.6 * np.sin(np.pi * t / t[-1]) ** 2, "y": 0.4 * np.sin(2.0 * np.pi * t / t[-1]),
            "z": 0.5 + 0.3 * np.sin(np.pi * t / t[-1]) ** 2, "yaw": 0.3 * np.sin(2.0 * np.pi * t / t[-1]),
        }, N=200, dt=0.01, Q=10.0, final=10.0, R=1e-2, kind="rest",
    )  # fmt: skip
    limits, kept = _tensions(given, {f"string{k}": 6.0 for k in range(6)}, 25.0)
    return Kept(given, limits, kept, multipliers=True)


def _around(angle: float, radius: float, height: float) -> tuple[float, float, float]:
    """Return a point at an angle (degrees) about the vertical."""
    return radius * float(np.cos(np.radians(angle))), radius * float(np.sin(np.radians(angle))), height


def _walk() -> Kept:
    """Return the marionette's walk with tensions of at least 30 % of their means in the wanted motion."""
    problem = marionette.problem(marionettes.package_marionette(), 100)
    given = Given(problem.system, problem.cost, problem.x, problem.u)
    wanted = problem.wanted.tensions()
    limits, kept = _tensions(given, {name: 0.3 * float(values.mean()) for name, values in wanted.items()})
    return Kept(given, limits, kept, multipliers=True)


def _hand() -> Kept:
    """Return the hand of 25 joints that closes and opens by 25 tendons that only pull."""
    closed = {"mcp": 0.7, "pip": 0.9, "dip": 0.5}
    m = broad_hand()
    given = posed(
        m, {}, lambda t: {
            name: closed.get(name.rpartition(".")[2], 0.0) * np.sin(np.pi * t / t[-1]) ** 2 for name in m.variables
        }, N=100, dt=0.02, Q=1.0, final=1.0, R=1e-2, rates=0.0, kind="rest",
    )  # fmt: skip
    bounds, most = _pushes(given, np.inf, least=0.0)
    return Kept(given, bounds, most=most)


# ---- Linkages and gaits ---------------------------------------------------------------------------


def _crank() -> Kept:
    given = posed(
        slider_crank(), {"crank": 0.5}, constant(crank=0.5 + np.pi), N=150, dt=0.01, Q={"crank": 0.1}, R=1e-2,
        final=1e4, kind="rest",
    )  # fmt: skip
    limits, kept = _reactions(given, 12.0)
    return Kept(given, limits, kept, multipliers=True)


def _lift() -> Kept:
    """Return a lift that is let down and raised, with reactions that are larger without limits."""
    m = scissor_lift(3, damping=0.05)

    def wanted(t: Array) -> dict[str, Array]:
        angles = 1.0 - 0.3 * np.sin(np.pi * t / t[-1]) ** 2
        return dict(zip(m.variables, np.array([at_angle(m, angle)[0] for angle in angles]).T, strict=True))

    start = dict(zip(m.variables, at_angle(m, 1.0)[0], strict=True))
    given = posed(m, start, wanted, N=150, dt=0.01, Q=10.0, R=1e-4, final=10.0, kind="rest")
    limits, kept = _reactions(given, 100.0)
    return Kept(given, limits, kept, multipliers=True)


def _swing() -> Kept:
    """Return a chain of six links with motors that swings for ever, its first motor weak."""
    given = posed(
        chain(6, "motors"), {}, lambda t: {
            f"link{k}": 0.3 * np.sin(2.0 * np.pi * t / t[-1] - 0.5 * k) for k in range(6)
        }, N=200, dt=0.01, Q=10.0, final=10.0, R=1e-3, kind="rest",
    )  # fmt: skip
    bounds, most = _pushes(given, {"motor0": 6.0, "motor1": 6.0})
    return Kept(given, bounds, most=most, returns=True)


CASES = (
    Case("planar arm of 4, reaching between 3 obstacles", lambda: _reach(*_PLANAR)),
    Case("arm of 7, reaching between 3 obstacles", lambda: _reach(*_SPATIAL)),
    Case("puppet's arm of 3, strings pull by 1.5 N", lambda: _hand_of_puppet(False)),
    Case("load on 6 strings, each pulls by 6 to 25 N", _platform),
    Case("marionette, walk, tensions 30 % of mean", _walk),
    Case("slider-crank, half a turn, reactions to 12 N", _crank),
    Case("lift of 3 segments, reactions to 100 N", _lift),
    Case("chain of 6, swings for ever, torques bounded", _swing, returns=True),
    Case("puppet's arm of 3, waves for ever, strings pull", lambda: _hand_of_puppet(True), returns=True),
    Case("hand, 25 tendons that only pull", _hand),
)


# ---- Comparison -----------------------------------------------------------------------------------


def solve(case: Kept, **options: Any) -> OptimizationResult:
    """Solve a case from its start; options are those of `optimize`."""
    system, cost, x = case.given.system, case.given.cost, case.given.x
    limits = [*([Periodic("*")] if case.returns else []), *case.limits]
    if case.multipliers:
        nc = system.integrator.mechanism.nc
        system = MidpointSystem(system.integrator, system.t, multipliers=True)
        none = np.zeros(nc)
        cost = QuadraticCost(
            np.hstack([cost.x_wanted, np.zeros((system.N + 1, nc))]), cost.u_wanted, Q=np.append(cost.Q, none),
            R=cost.R, Q_final=np.append(cost.Q_final, none),
        )  # fmt: skip
        x = np.concatenate([x, np.zeros((*x.shape[:-1], nc))], axis=-1)
    return optimize(system, cost, initial=(x, case.given.u), limits=limits, free_start=case.returns, **options)


def compare(
    case: Case,
    *,
    rounds: int = 3,
    compiled: bool = True,
    by_fatrop: bool = False,
    tolerance: float | None = None,
    meet: bool = False,
) -> Comparison:
    """Solve a case with both, to their own tolerances or one; by fatrop in the place of Ipopt if it is asked for.

    ``compiled``: with functions that the C compiler made, besides. ``meet``: the other begins at what is found, and
    that search once more at what it comes to: where there are many minima, whether there is one for both.
    """
    options: dict[str, Any] = {} if tolerance is None else {"tolerance": tolerance}
    kept = case.build()
    result, seconds = fastest(lambda: solve(kept, **options), rounds)
    to = EXACTLY if tolerance is None else {**EXACTLY, "tol": tolerance}

    def theirs(compiled: bool) -> Solution:
        system, paths = kept.given.system, kept.paths
        peer = MultipleShooting(system, kept.given.cost, compiled=compiled, paths=paths, returning=kept.returns)
        peer.bound((-np.inf, kept.most[0], -np.inf), (np.inf, kept.most[1], np.inf))
        start = (result.x[:, : peer.nx], result.u) if meet else start_of(kept.given)
        return solve_by(peer, start, rounds=rounds, by_fatrop=by_fatrop, **to)

    found = theirs(compiled=False)
    compiled_seconds = theirs(compiled=True).seconds if compiled else np.nan
    if meet:
        result = solve(replace(kept, given=replace(kept.given, x=found.x, u=found.u)), **options)
    return Comparison(
        case.name, result.cost, found.cost, result.status.name, found.status, seconds, found.seconds,
        result.iterations, found.iterations, verdict="", compiled_seconds=compiled_seconds,
    )  # fmt: skip
