"""An optimisation that is made ready once and run as often as one likes: `optimize` is one run of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, ResidualWarning
from leastaction.numerics.arrays import Array, as_array, as_count, read_only, require_instance
from leastaction.numerics.blas import one_thread
from leastaction.numerics.frozen import changed
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.pool import Pool, kept
from leastaction.numerics.public import public
from leastaction.numerics.warn import warn as warn_of
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.problem import Collocation
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult
from leastaction.optimal.cost import check_space
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem, given_start
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.limits.limit import Limit, checked_limits
from leastaction.optimal.loop import Callback, Loop, Problem
from leastaction.optimal.options import USUAL, Options
from leastaction.optimal.remembered.extension import Remembered, needed_by
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.system import check_system
from leastaction.optimal.unknowns.continuous.extension import ContinuousExtension
from leastaction.optimal.unknowns.extension import Extension
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.unknown import Parameter, Unknown, checked_unknowns
from leastaction.optimal.ways import WAYS
from leastaction.optimal.ways.resolved import resumed as resume_within

_ON_MESH = (Collocation, ContinuousExtension)
_HERE = nullcontext()
_FAR_OFF = 3.0  # residuals of a fit, in standard deviations that its weights say, which are no noise


@public
class Optimizer:
    """A system, a cost, limits and options, ready to be optimised from one start after the other.

    It owns the memory that the iterations work in, which every run uses again: for predictive control, and wherever
    many runs of one problem follow each other. A run leaves nothing behind but what `again` starts from: `run` returns
    what `optimize` does. Threads do not share one.

    Parameters
    ----------
    system, cost, limits, horizon, free_start, unknowns, options, settings
        As of `optimize`.

    Raises
    ------
    ArgumentError
        What is no system, or not yet one; settings, shapes or values that are wrong.

    Examples
    --------
    A mass is brought to rest from one state after the other, as a predictive controller does:

    >>> import numpy as np
    >>> from leastaction import Bound, JointForce, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, tx
    >>> from leastaction.optimal import Optimizer
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 21))
    >>> cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[10.0, 1.0], R=[0.1])
    >>> optimizer = Optimizer(system, cost, [Bound("push", -5.0, 5.0)])
    >>> result = optimizer.run((np.array([1.0, 0.0]), np.zeros((20, 1))))
    >>> for _ in range(3):
    ...     result = optimizer.again(result.x[1], shift=1)
    >>> result.success
    True
    """

    def __init__(
        self,
        system: DiscreteSystem | ContinuousSystem,
        cost: Cost | ContinuousCost,
        limits: Sequence[Limit] = (),
        *,
        horizon: tuple[float, float] | None = None,
        free_start: bool | Sequence[str] = False,
        unknowns: Sequence[Unknown] = (),
        options: Options | None = None,
        **settings: Any,
    ) -> None:
        check_system(system, (DiscreteSystem, ContinuousSystem), ("nx", "nu"))
        self.system, self.cost, self.horizon = system, cost, horizon
        self.options = (options or USUAL).changed(**settings)
        if self.options.method == "newton" and not system.has_curvature:
            raise ArgumentError(
                f"method: got 'newton', but {type(system).__name__} has no second derivative. Give it a `curvature`, "
                "or use 'auto' or 'quasi-newton'."
            )
        kind = Cost if isinstance(system, DiscreteSystem) else ContinuousCost
        if not isinstance(cost, kind):
            raise ArgumentError(
                f"cost: got {type(cost).__name__}, expected a {kind.__name__} to go with {type(system).__name__}"
            )
        self.limits, self.free_start = checked_limits(limits), _checked_start(free_start, system)
        self.unknowns = checked_unknowns(unknowns)
        self.ways = [way for way in WAYS if way.name not in self.options.without]
        self.result: OptimizationResult | None = None
        self._pool = Pool()
        # From the system's own states to those of the problem, one after the other, and back again.
        self._around: list[Remembered | Extension | ContinuousExtension] = []
        self._is_discrete = isinstance(system, DiscreteSystem)
        self._problem = self._discrete() if self._is_discrete else self._continuous()

    # ---- Runs -------------------------------------------------------------------------------------

    def run(
        self, initial: Any = None, *, resume: OptimizationResult | None = None, callback: Callback | None = None
    ) -> OptimizationResult:
        """Return what `optimize` does from a start, or where an earlier run ended; without its warnings.

        Parameters
        ----------
        initial, resume, callback
            As of `optimize`.

        Raises
        ------
        ArgumentError
            As of `optimize`.
        """
        is_first = self.result is None
        with self._pool:
            result = self.run_once(initial, resume=resume, callback=callback)
            # The next run works where these stand.
            own = {name: kept(getattr(result, name)) for name in ("K", "projection_gain")}
            self.result = changed(result, **own)
        if is_first:
            self._pool.reserve()
        return self.result

    def run_once(
        self,
        initial: Any = None,
        *,
        resume: OptimizationResult | None = None,
        callback: Callback | None = None,
        warn: bool = False,
    ) -> OptimizationResult:
        """Return what `run` does, for an optimiser that does not run again: gains stand in its own memory.

        ``warn``: whether to warn of what the message says against the motion, in the name of who called `optimize`.
        """
        if (initial is None) == (resume is None):
            got = "neither" if initial is None else "both"
            raise ArgumentError(f"initial, resume: got {got}, expected one of them.")
        if callback is not None and not callable(callback):
            raise ArgumentError(f"callback: got {type(callback).__name__}, expected a function of an IterationRecord")
        if resume is not None:
            made = OptimizationResult if self._is_discrete else ContinuousOptimizationResult
            require_instance(resume, "resume", made, "optimize() returns one")
        if self._is_discrete and initial is not None:
            initial = self._checked(cast(DiscreteSystem, self.system), initial)
        for way in self._around:
            callback = way.callback(callback)
            if not isinstance(way, ContinuousExtension):  # which is the problem itself, and begins by itself
                resume = None if resume is None else way.resume(resume)
                initial = None if initial is None else way.start(initial)
        if resume is not None and not isinstance(self._problem, ContinuousExtension):
            _check_unknowns(resume, [each.name for each in self.unknowns])
        with one_thread() if isinstance(self._problem, _ON_MESH) else _HERE:
            loop = Loop(self._begun(initial, resume), self.options, callback, resume, self.ways)
            if resume is not None and resume.state is not None and resume.state.run.resolved is not None:
                resume_within(loop.progress, resume, resume.state)
            result = loop.run()
        for way in reversed(self._around):
            result = way.result(result)
        return self._doubted(result, warn=warn)

    def _checked(self, system: DiscreteSystem, initial: Any) -> OptimizationResult | tuple[Array, Array]:
        """Return what was given to start from, or complain."""
        if isinstance(initial, OptimizationResult):
            x, u = given_start(system, (initial.x, initial.u))
            # Multipliers of limits that could not be met say nothing of others.
            return (x, u) if initial.status is Status.INFEASIBLE else initial
        x, u = given_start(system, initial)
        if self.free_start is False:
            system.check_start(x if x.ndim == 1 else x[0])
        return x, u

    def _begun(self, initial: Any, resume: OptimizationResult | None) -> Problem[Any, Any, Any]:
        """Return the problem at its first iterate, with the memory that the last run has worked in."""
        given = self._problem
        if isinstance(given, DiscreteProblem):
            given.renew()
            if resume is None:
                given.start(initial)
            elif resume.state is None or resume.state.run.resolved is None:  # within that it stands elsewhere
                _check_resumed(resume, has=bool(given.parts.rows))
                given.resume(resume)
            return given
        if isinstance(given, _ON_MESH):
            return given.start(initial) if resume is None else given.resume(resume)
        problem = ContinuousProblem(given.system, given.cost, self.options, given.accuracy, self.horizon)
        if resume is None:
            problem.start(initial.dense if isinstance(initial, ContinuousOptimizationResult) else initial)
        else:
            _check_resumed(resume, has=False)
            problem.resume(resume)
        return problem

    def again(
        self,
        x0: ArrayLike | None = None,
        *,
        shift: int = 0,
        cost: Cost | None = None,
        callback: Callback | None = None,
    ) -> OptimizationResult:
        """Return the optimum from where the last one leads, with its multipliers: in discrete time.

        Parameters
        ----------
        x0 : array_like (nx,), optional
            Initial state; that of the last result, shifted, if left out. The start is the projection of that result.
        shift : int
            Steps by which the horizon has moved on: states and inputs of the last result are taken from there on, and
            the last ones are held.
        cost : Cost, optional
            Another cost from now on, such as one with another wanted motion.
        callback : callable, optional
            As of `optimize`.

        Raises
        ------
        ArgumentError
            If there was no run; wrong shapes; a system in continuous time.
        """
        last, system = self.result, self.system
        if last is None:
            raise ArgumentError("again: got no result to start from, expected a `run` before")
        if not isinstance(system, DiscreteSystem):
            raise ArgumentError(f"again: got a {type(system).__name__}, expected a discrete system; use run(result)")
        if cost is not None:
            self._replace_cost(system, cost)
        steps = as_count(shift, "shift", 0)
        x, u = last.x, last.u
        if steps:
            x, u = (np.concatenate([a[steps:], np.repeat(a[-1:], min(steps, len(a)), axis=0)]) for a in (x, u))
        if x0 is not None:
            x = np.array(x)
            x[0] = as_array(x0, "x0", (system.nx,), meaning="(nx,)")
        return self.run(replace(last, x=read_only(np.array(x)), u=read_only(np.array(u))), callback=callback)

    def _doubted(self, result: OptimizationResult, *, warn: bool) -> OptimizationResult:
        """Return a result whose message says what speaks against the motion that was found, whatever its cost."""
        # What is a minimum among resolved motions only says so itself.
        if result.gap > 0.0 or result.status not in (Status.CONVERGED, Status.STALLED):
            return result
        doubts = [*([] if result.system is None else result.system.doubts(result) or []), *self._of_fit(result)]
        for doubt in doubts if warn else ():
            warn_of(doubt)
        said = [result.message, *(f"But {doubt}." for doubt in doubts)]
        return changed(result, message=" ".join(said)) if doubts else result

    def _of_fit(self, result: OptimizationResult) -> list[Warning]:
        """Return that a fit of parameters, which nothing limits, is far off what its weights say of the noise."""
        fitted = [each for each in self.unknowns if isinstance(each, Parameter)]
        if not fitted or len(fitted) < len(self.unknowns) or self.limits or not isinstance(self.cost, Cost):
            return []
        missed = self.cost.misfit(result.x)
        if missed is None or missed <= _FAR_OFF:
            return []
        return [
            ResidualWarning(
                f"the states miss what is wanted by {missed:.3g} times what the weights Q say, as one over the "
                "variance of noise: the model misses something, or the minimum is a poor one"
            )
        ]

    # ---- The problem ------------------------------------------------------------------------------

    def _replace_cost(self, system: DiscreteSystem, cost: Cost) -> None:
        require_instance(cost, "cost", Cost, "such as a QuadraticCost")
        cost.check_shapes(system.N, system.nx, system.nu)
        check_space(cost, system)
        self.cost = cost
        if not self._around and isinstance(self._problem, DiscreteProblem):
            self._problem.parts.replace_cost(cost)
        else:
            self._problem = self._discrete()

    def _discrete(self) -> DiscreteProblem:
        """Return the problem in steps of time, with limits or without, of the extended system where there is one."""
        system, cost = cast(DiscreteSystem, self.system), cast(Cost, self.cost)
        settings, free, limits, final_time = self.options, self.free_start, self.limits, None
        self._around = []
        check_system(system, (DiscreteSystem,), ("N",))
        of_time = {"horizon": (self.horizon, None), "accuracy": (settings.accuracy, None)}
        for name, (value, usual) in {**of_time, "collocate": (settings.collocate, True)}.items():
            if value is not usual:
                raise ArgumentError(
                    f"{name}: got {value!r}, expected {usual}: {type(system).__name__} is a discrete system, which "
                    "brings its times along."
                )
        cost.check_shapes(system.N, system.nx, system.nu)
        cost = cost.over(system.N)
        check_space(cost, system)
        if isinstance(settings.projection, PiecewisePolynomial):
            raise ArgumentError("projection: got functions of time, expected gains (N, nu, nx) of a discrete system")
        needs = needed_by(limits, cost, system, 1 if free is False else 0)
        if needs:
            remembered = Remembered(system, cost, limits, needs)
            self._around.append(remembered)
            system, cost, limits = remembered.system, remembered.cost, remembered.limits
            settings = remembered.settings(settings)
        if self.unknowns or any(isinstance(limit, Periodic) for limit in limits):
            extension = Extension(system, cost, self.unknowns, limits, free)
            self._around.append(extension)
            rows, free, final_time = extension.rows(), True, extension.system.final_time
            system, cost, settings = extension.system, extension.cost, extension.settings(settings)
            gapped: Gapped = "where left"
        else:
            rows = [row for limit in limits for row in limit.rows(system, 1 if free is False else 0)]
            gapped = "where needed"
        if not settings.tries_gaps:
            gapped = "at once" if settings.shooting == "multiple" else "never"
        return DiscreteProblem(system, cost, settings, rows, free, gapped, final_time=final_time)

    def _continuous(self) -> Collocation | ContinuousProblem | ContinuousExtension:
        """Return the problem in continuous time, on a mesh where something asks for it."""
        system, cost, settings = cast(ContinuousSystem, self.system), cast(ContinuousCost, self.cost), self.options
        if settings.shooting == "multiple":
            raise ArgumentError(f"shooting: got {settings.shooting!r} for a continuous system, expected 'single'")
        check_space(cost, system)
        if system.space is None and system.charts() is not None:
            raise ArgumentError(
                f"system: got a {type(system).__name__} with a difference of states of its own, expected `space` in "
                "continuous time, where the numbers of states are steered"
            )
        accuracy = settings.accuracy or Accuracy()
        if self.unknowns or any(isinstance(limit, Periodic) for limit in self.limits):
            extension = ContinuousExtension(
                system, cost, self.unknowns, self.limits, settings, accuracy, self.horizon, self.free_start
            )
            self._around.append(extension)
            return extension
        if self.limits or self.free_start is not False or settings.collocate:
            return Collocation(system, cost, self.limits, settings, accuracy, self.horizon, self.free_start)
        return ContinuousProblem(system, cost, settings, accuracy, self.horizon)


def optimized(system: Any, cost: Any, *, initial: Any = None, **stated: Any) -> OptimizationResult:
    """Return what `optimize` does, without its warnings: for stages of something else."""
    resume, callback = (stated.pop(name, None) for name in ("resume", "callback"))
    return Optimizer(system, cost, **stated).run_once(initial, resume=resume, callback=callback)


def _check_unknowns(resume: OptimizationResult, names: Sequence[str]) -> None:
    others = [name for name in resume.unknowns if name not in names]
    if others:
        raise ArgumentError(
            f"resume: got a result with the unknown {others[0]!r}, expected those of this call. Name it among the "
            "unknowns, or give initial=result and system.with_parameters(result.unknowns)"
        )


def _check_resumed(resume: OptimizationResult, *, has: bool) -> None:
    """Check that there are limits in a run that goes on if there were any before."""
    had = resume.limits is not None
    if had != has:
        raise ArgumentError(
            f"resume: got a result {'with' if had else 'without'} limits, expected those of this call"
            f"{'' if has else ', none'}. Give initial=result to start from its trajectory"
        )


def _checked_start(free: bool | Sequence[str], system: DiscreteSystem | ContinuousSystem) -> bool | tuple[str, ...]:
    if isinstance(free, bool):
        return free
    if not isinstance(free, Iterable):
        raise ArgumentError(
            f"free_start: got {free!r}, expected True, False or names of entries of the state such as ['p_cart']"
        )
    names = (free,) if isinstance(free, str) else tuple(free)
    system.free_entries(names)
    return names
