"""Dynamic embedding: a motion is found with help that any motion can be made with, and the help is then removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError, LeastActionError, unknown
from leastaction.mechanics.elements import Element, JointForce
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_number, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import given_start
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.options import Method
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.starts import HelpedCost, StartResult, StartStatus, continuation
from leastaction.optimal.starts.stages import StageCallback, StartStages, check_last_limits, check_options, check_stages
from leastaction.systems.midpoint import MidpointSystem

_ENOUGH = Status.CONVERGED, Status.STALLED, Status.SADDLE
_DECADES = 14  # of the price, at most
_REMOVALS = 4  # how often the help is taken away
_PROGRESS = 0.7  # of the help's effort, that a stage may leave which does not converge
_DEAR = 10.0  # without the help the motion is lost where it costs so much more


@public
def embed(
    system: MidpointSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike],
    help: Sequence[Element | str] | None = None,  # noqa: A002
    scale: ArrayLike | None = None,
    price: float | None = None,
    tolerance: float = 1e-3,
    stage_iterations: int = 60,
    stage_tolerance: float = 1e-2,
    max_stages: int = 60,
    resume: StartResult | None = None,
    callback: StageCallback | None = None,
    **options: Any,
) -> StartResult:
    """Find a motion with help that has a price, raise the price until the help does nothing, and remove it.

    With a force on every dynamic variable any motion can be followed, so a first trajectory is there at once, close to
    the wanted one. Then the help is made ever more expensive, by a factor that grows where that was easy and shrinks
    where a stage fails, until its effort is below the tolerance; the motion is projected onto the trajectories of the
    system without help, and optimised. Where that loses the motion, the price is raised further.

    Parameters
    ----------
    system : MidpointSystem
        What is steered, without the help.
    cost : Cost
        Of its motions.
    initial : (x, u)
        Where to start: x (N+1, nx) a curve, such as the wanted motion, or an initial state (nx,); u (N, nu).
    help : sequence of Element or str, optional
        The help: names of dynamic variables, on each of which a `JointForce` acts, or elements with inputs of their
        own (and no constraints). A force on every dynamic variable if left out.
    scale : array_like (n,) or float, optional
        What is much of each help (N or N m): prices and efforts count in it. If left out, of a force on a variable what
        carries it (the potential's gradient, at most along the curve) and accelerates its inertia by 1 m/s^2 or
        rad/s^2; of others 1.
    price : float, optional
        The first price of half the square of the help at each step, in its scale. If left out, help as large as its
        scale costs a hundredth of what the motion from `initial` without help costs.
    tolerance : float
        Effort at which the help may go: the largest root mean square of any help, in its scale.
    stage_iterations, stage_tolerance : int, float
        ``max_iterations`` and ``tolerance`` of the optimisations with help. They are tried by the automatic choice of
        method first, then by quasi-Newton's, then anew from the initial curve.
    max_stages : int
        Limit on their number.
    resume : StartResult, optional
        Go on from where an earlier search, with the same help, ended before the help was removed.
    callback : callable, optional
        Called with a `StageRecord` after every stage, whose value is the price (infinite without help); a true answer
        ends the search.
    **options
        Of `optimize`, for the last optimisation; its status is that of ``.result``. ``limits`` hold with help too.

    Returns
    -------
    StartResult
        A trajectory of `system`, if the status is COMPLETED. Where the search ended before, it is the last one with
        help (its u has the columns of the help after those of the other inputs), and `value` the price there.

    Raises
    ------
    ArgumentError
        Wrong shapes, unknown names, help that has no inputs of its own or adds constraints; or from `optimize`, where
        not even the first motion with help is found.

    Notes
    -----
    Dissertation 6.6.1, with an adaptive price.
    """
    require_instance(system, "system", MidpointSystem)
    require_instance(cost, "cost", Cost)
    check_options(options, "the last stage, which starts from the one before")
    check_stages(stage_iterations, stage_tolerance)
    check_last_limits(system, options)
    m, N = system.mechanism, system.N
    cost = cost.over(N)
    x, u = given_start(system, initial)
    limit = as_number(tolerance, "tolerance", above=0.0)

    elements = _helpers(m, help)
    helped_mechanism = m.with_elements(elements)
    columns = np.arange(m.n_inputs, helped_mechanism.n_inputs)
    _check(m, helped_mechanism, elements)
    helped = MidpointSystem(system.integrator.like(helped_mechanism), system.t, multipliers=system.multipliers)
    sizes = _scale(m, elements, np.atleast_2d(x), scale, len(columns))
    first = _price(system, cost, x, u, len(columns)) if price is None else as_number(price, "price", above=0.0)

    curve = x, np.insert(u, [m.n_inputs] * len(columns), 0.0, axis=1)
    how = {"max_iterations": stage_iterations, "tolerance": stage_tolerance, "limits": options.get("limits", ())}
    with_help = _Helped(helped, cost, columns, sizes, curve, how)
    found = resume
    if found is not None and (found.result is None or found.u.shape != (N, helped.nu)):
        raise ArgumentError(
            f"resume: got inputs of shape {found.u.shape}, expected ({N}, {helped.nu}), as of one that had help"
        )
    for _ in range(_REMOVALS):
        found = continuation(
            with_help.solve,
            first * 10.0 ** np.arange(_DECADES + 1),
            scale="log",
            name="price of the help",
            accept=with_help.goes_on,
            done=partial(with_help.does_little, limit),
            note=lambda result: f"effort of the help {with_help.effort(result):.2g}",
            max_stages=max_stages,
            resume=found,
            callback=callback,
        )
        if not found.success or found.result is None:
            return found
        found, is_last = _without_help(system, cost, columns, found, found.result, callback, options)
        if is_last:
            return found
        limit *= 0.1
    assert found is not None
    return found


@dataclass(eq=False)
class _Helped:
    """The problems with help, and how far each stage has come.

    ``columns``: where the help is among the inputs, and ``sizes``: what is much of it. ``curve``: where to start.
    ``how``: options of `optimize`.
    """

    system: MidpointSystem
    cost: Cost
    columns: NDArray[np.int64]
    sizes: Array
    curve: tuple[Array, Array]
    how: dict[str, Any]
    last: OptimizationResult | None = None  # from which the stage began

    def effort(self, result: OptimizationResult) -> float:
        """Return the largest root mean square of any help."""
        return float(np.sqrt(np.mean((result.u[:, self.columns] / self.sizes) ** 2, axis=0)).max())

    def does_little(self, limit: float, result: OptimizationResult) -> bool:
        """Whether the help may go."""
        return self.effort(result) <= limit

    def goes_on(self, result: OptimizationResult) -> bool:
        """Whether the next stage may begin with a result."""
        return self.last is None or self._progresses(result, self.last)

    def _progresses(self, result: OptimizationResult, earlier: OptimizationResult | None) -> bool:
        """Whether a stage converged, or else left the help less to do."""
        if result.status in _ENOUGH:
            return True
        if earlier is None:
            return result.status is Status.ITERATION_LIMIT
        return self.effort(result) < _PROGRESS * self.effort(earlier)

    def solve(self, value: float, earlier: OptimizationResult | None) -> OptimizationResult:
        """Return the motion at a price.

        Newton's method may follow cheap help to the edge of what the time step can follow, where nothing can be changed
        any more; quasi-Newton's stays away, and where it does not, the curve is followed anew at this price.
        """
        self.last = earlier
        ways: list[tuple[Any, Method]] = [(self.curve, "quasi-newton")]
        if earlier is None:
            ways.insert(0, (self.curve, "auto"))
        else:
            ways[:0] = [(earlier, "auto"), (earlier, "quasi-newton")]
        priced = HelpedCost(self.cost, self.columns, value / self.sizes**2)
        result: OptimizationResult | None = None
        failure: LeastActionError | None = None
        for start, method in ways:
            try:
                result = optimized(self.system, priced, initial=start, method=method, **self.how)
            except LeastActionError as error:
                failure = error
                continue
            if result.status is Status.INTERRUPTED or self._progresses(result, earlier):
                break
        if result is None:
            assert failure is not None
            raise failure
        return result


def _without_help(
    system: MidpointSystem,
    cost: Cost,
    columns: NDArray[np.int64],
    found: StartResult,
    helped: OptimizationResult,
    callback: StageCallback | None,
    options: dict[str, Any],
) -> tuple[StartResult, bool]:
    """Return the motion without the help that the last stage still had, or that stage; and whether that is the end."""
    stages = StartStages(callback, found.stages)
    start = helped.x, np.delete(helped.u, columns, axis=1)

    def keeps(result: OptimizationResult) -> bool:
        kept = result.success or result.status is not Status.DERIVATIVES_FAILED
        is_cheap = min(result.history.cost[0], result.cost) <= _DEAR * helped.cost
        return kept and bool(is_cheap or result.success)

    solve = partial(optimized, system, cost, initial=start, **options)
    result, accepted = stages.make("without help", np.inf, solve, accept=keeps)
    if result is not None and (accepted or stages.ended is not None):
        status = StartStatus.COMPLETED if accepted else stages.ended
        assert status is not None
        return stages.result(status, result.x, result.u, result.cost, np.inf, result), True
    lost = "Without the help the motion was lost" + (f": {stages.error}" if stages.error is not None else "")
    status = stages.ended or StartStatus.GAVE_UP
    found = stages.result(status, helped.x, helped.u, helped.cost, found.value, helped, lost)
    return found, stages.ended is not None


def _helpers(m: Mechanism, help: Sequence[Element | str] | None) -> list[Element]:  # noqa: A002
    """Return the elements that help."""
    if isinstance(help, (str, Element)):
        raise ArgumentError(f"help: got {help!r}, expected a list of names or elements")
    elements: list[Element] = []
    for it in m.dynamic if help is None else help:
        if isinstance(it, Element):
            elements.append(it)
        elif it in m.dynamic:
            elements.append(JointForce(it, f"help on {it}"))
        else:
            raise unknown("dynamic variable", it, m.dynamic, "help")
    return elements


def _check(m: Mechanism, helped: Mechanism, elements: list[Element]) -> None:
    """Complain about help that changes more than the inputs, or not even these."""
    if helped.nc != m.nc:
        raise ArgumentError("help: got elements that are constraints, expected forces with inputs of their own")
    if helped.n_inputs == m.n_inputs:
        raise ArgumentError(f"help: got {len(elements)} elements without new inputs, expected forces that have some")


def _scale(m: Mechanism, elements: list[Element], x: Array, scale: ArrayLike | None, n: int) -> Array:
    """Return what is much of each help."""
    if scale is not None:
        given = as_array(scale, "scale", (), (n,), meaning="one number, or (n,) for n inputs that help")
        sizes = np.broadcast_to(given, (n,)).copy()
        if not np.all(sizes > 0.0):
            raise ArgumentError(f"scale: got {sizes.min():g}, expected positive numbers")
        return sizes
    rest = np.zeros(m.nv)
    rows = x[:: max(1, len(x) // 50), : m.nq]
    carried = np.abs([m.core.gradient(np.ascontiguousarray(q), rest)[0] for q in rows]).max(axis=0)
    much = carried + np.diag(m.mass_matrix(x[0, : m.nq]))
    by_input = {
        e.input: float(much[m.variables.index(e.variable)])
        for e in elements
        if isinstance(e, JointForce) and isinstance(e.variable, str)
    }
    new = dict.fromkeys(name for e in elements for name in e.uses.inputs if name not in m.inputs)
    return np.array([by_input.get(name, 1.0) for name in new])


def _price(system: MidpointSystem, cost: Cost, x: Array, u: Array, n: int) -> float:
    """Return the price at which much help costs little, of what the motion costs as it starts."""
    N = system.N
    reference = np.tile(np.atleast_2d(x)[0], (N + 1, 1))
    values = [cost.value(reference, u)]
    if x.ndim == 2:
        values.append(cost.value(x, u))
    try:
        run = system.rollout(reference[0], reference, u, np.zeros((N, system.nu, system.ndx)), 0, N)
        if run.complete:
            values.append(cost.value(run.x, run.u))
    except LeastActionError:
        pass
    largest = max(value for value in values if np.isfinite(value)) if np.isfinite(values).any() else 0.0
    if largest <= 0.0:
        raise ArgumentError("price: the initial motion costs nothing, so there is no price to compare with; give one")
    return 0.02 * largest / (N * n)
