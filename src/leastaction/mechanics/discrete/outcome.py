"""What the core tells of steps, in words: how coarse they were, and why one failed."""

from __future__ import annotations

import numpy as np

from leastaction import _core
from leastaction.errors import InconsistentStartError, StepError, worst_first
from leastaction.mechanics.configuration.assembly import check_consistent
from leastaction.mechanics.configuration.contradiction import find_contradiction
from leastaction.mechanics.discrete.prescribed import reached
from leastaction.mechanics.discrete.trajectory import State
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import made
from leastaction.numerics.step_quality import StepQuality

_REASONS = {
    _core.StepStatus.no_convergence: "Newton's method did not converge in {iterations} iterations",
    _core.StepStatus.not_finite: "the equations of the step are not finite",
    _core.StepStatus.singular: "the equations of the step are singular",
    _core.StepStatus.too_coarse: "the time step is too coarse",
}


def quality_of(mechanism: Mechanism, out: _core.RollOut, t: Array) -> StepQuality | None:
    """Return the coarsest step of a roll-out over the times t; None if it made none."""
    worst = out.worst
    k, variable = worst.k, worst.variable
    if k < 0:
        return None
    name = mechanism.variables[variable] if variable >= 0 else ""
    return made(StepQuality, t=float(t[k]), s=worst.s, angle=worst.angle, variable=name)


def step_error(m: Mechanism, out: _core.RollOut, state: State, given: Array) -> StepError:
    """Return the error of a roll-out of the core that failed after `state`; ``given``: inputs of what is prescribed."""
    wanted = np.concatenate([state.q[: m.first_rho], reached(m, state.q[m.first_rho :], given)])
    found = find_contradiction(m, wanted) if np.all(np.isfinite(wanted)) else None
    advice = "Try a smaller time step, or prescribed variables and inputs that the mechanism can follow"
    if found is not None:
        advice = f"Where the prescribed variables go, {found}"
    elif np.all(np.isfinite(state.q)):
        try:
            now = m.at_time(state.t)
            check_consistent(now, state.q, tolerance=1e-6)
            advice = _overdetermined(now, state.q) or advice
        except InconsistentStartError as error:
            advice = f"Where the step begins, {error}"
    names = [f"dynamics of {name!r}" for name in m.dynamic]
    names += [f"constraint {name!r}" for name in m.constraints]
    residuals = worst_first(dict(zip(names, out.residual, strict=True)))
    reason = _REASONS[out.status].format(iterations=out.failed_iterations)
    quality = quality_of(m, out, np.full(out.steps + 1, state.t))
    if quality is not None and out.status == _core.StepStatus.too_coarse:
        reason += f": its solution can be followed from short ones up to {out.reached:.3g} s, "
        reason += f"where s = {quality.s:.3g}"
        if quality.variable:
            reason += f" and {quality.variable!r} moves at {quality.angle:.3g} rad a step"
    # Where Newton's method came to a solution, but not to that of short steps, they are all met.
    if not max(map(abs, residuals.values()), default=0.0) < 1e-9:
        shown = [f"{name}: {value:.2g}" for name, value in list(residuals.items())[:3]]
        reason += f"; largest residuals {', '.join(shown)}"
    return StepError(
        f"the step at t = {state.t:.6g} s failed: {reason}. {advice}",
        t=state.t,
        residuals=residuals,
        iteration=out.failed_iterations,
        state=state,
        quality=quality,
    )


def _overdetermined(m: Mechanism, q: Array) -> str:
    """Return which constraints ask prescribed variables to agree with each other; empty where none does.

    A constraint that follows from others leaves the dynamic variables nothing to meet it with.
    """
    jacobian = m.constraint_jacobian(q)
    if not np.all(np.isfinite(jacobian)):
        return ""
    for name, sources in m.redundancy(q).items():
        rows = [m.constraints.index(each) for each in (name, *sources)]
        prescribed = [m.kinematic[i] for i in np.flatnonzero(np.any(jacobian[rows, m.nd :], axis=0))]
        if sources and prescribed:
            return (
                f"{name!r} asks nothing of the dynamic variables that {', '.join(map(repr, sources))} do not ask, "
                f"so that the prescribed {', '.join(map(repr, prescribed))} have to agree with each other. "
                "Leave one of these constraints out, or put a force or a spring in its place"
            )
    return ""
