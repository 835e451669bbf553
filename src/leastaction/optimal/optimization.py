"""Trajectory optimisation by the projection operator (dissertation Alg. 1 to 3, 6.4).

``minimise h(x, u) over trajectories of x+ = f(x, u, k), or of x' = f(x, u, t), from a fixed initial state``

Every iterate is a trajectory, or becomes one (multiple shooting). An iteration linearises along it, minimises a
quadratic model over the tangent trajectories (a linear-quadratic problem), and follows the projection of that direction
as far as the cost falls enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, overload

from numpy.typing import ArrayLike

from leastaction.numerics.public import public
from leastaction.numerics.time_functions import TimeFunctionLike
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.loop import Callback
from leastaction.optimal.optimizer import Optimizer
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.system import check_system
from leastaction.optimal.unknowns.unknown import Unknown


@overload
def optimize(
    system: DiscreteSystem,
    cost: Cost,
    *,
    initial: tuple[object, ArrayLike | Mapping[str, float]] | OptimizationResult | None = ...,
    resume: OptimizationResult | None = ...,
    limits: Sequence[Limit] = ...,
    free_start: bool | Sequence[str] = ...,
    unknowns: Sequence[Unknown] = ...,
    options: Options | None = ...,
    callback: Callback | None = ...,
    **settings: Any,
) -> OptimizationResult: ...


@overload
def optimize(
    system: ContinuousSystem,
    cost: ContinuousCost,
    *,
    initial: DenseTrajectory | ContinuousOptimizationResult | tuple[TimeFunctionLike, TimeFunctionLike] | None = ...,
    horizon: tuple[float, float] | None = ...,
    resume: ContinuousOptimizationResult | None = ...,
    limits: Sequence[Limit] = ...,
    free_start: bool | Sequence[str] = ...,
    unknowns: Sequence[Unknown] = ...,
    options: Options | None = ...,
    callback: Callback | None = ...,
    **settings: Any,
) -> ContinuousOptimizationResult: ...


@public
def optimize(
    system: DiscreteSystem | ContinuousSystem,
    cost: Cost | ContinuousCost,
    *,
    initial: Any = None,
    horizon: tuple[float, float] | None = None,
    resume: OptimizationResult | None = None,
    limits: Sequence[Limit] = (),
    free_start: bool | Sequence[str] = False,
    unknowns: Sequence[Unknown] = (),
    options: Options | None = None,
    callback: Callback | None = None,
    **settings: Any,
) -> OptimizationResult:
    """Minimise a cost over the trajectories of a system, by default from a given initial state.

    Parameters
    ----------
    system : DiscreteSystem or ContinuousSystem
        What is steered.
    cost : Cost or ContinuousCost
        What is minimised, such as a `QuadraticCost` or a `ContinuousQuadraticCost`.
    initial : (x, u), OptimizationResult or DenseTrajectory
        Where to start. Of a discrete system x (N+1, nx) and u (N, nu), or one of all steps (nu,): if x is not a
        trajectory of the system, the projection of (x, u) is taken, by the gains of several regulators if the first
        leads far away; x (nx,) is an initial state alone, or a `State`, to which u is applied. One state or input may
        be given by name. Of an earlier result the trajectory is taken, and the duals, if its limits read as these do.
        Of a continuous system a curve, whose projection is taken; or x and u, of shapes (nx,) and (nu,), as constants,
        functions of one time or `PiecewisePolynomial`, where a constant x is an initial state.
    horizon : (t0, tf), optional
        Times (s); needed with ``(x, u)`` of a continuous system.
    resume : OptimizationResult, optional
        Go on from an earlier result instead of `initial`. The iterates are those of a run that was
        never stopped, if method, regulator, accuracy, cost and system are the same.
    limits : sequence of Limit, optional
        Inequalities and equations of the motion: `Bound`, `Equal`, `Within` and others. The start may violate them. In
        continuous time they hold at the points of a mesh (see `leastaction.optimal.collocation`), which is made finer
        until the motion is right to a thousand times the accuracy's `rtol`, a hundred-thousandth at most; or to an
        `rtol` that is larger than that.
    free_start : bool or sequence of str, optional
        Whether the initial state is found too, or which entries of it, by their names (see
        ``system.quantity("state")``) with wildcards. It stays on the constraints of a mechanism. The cost has to
        weigh what is free; at the start itself limits hold as well then. `Periodic` among the limits has it return.
    unknowns : sequence of Parameter or FinalTime, optional
        Numbers that are found too: parameters of a mechanism, the final time. What is found is in ``result.unknowns``,
        and the motion is one of ``system.with_parameters(result.unknowns)``. In continuous time all goes on a mesh, and
        the final time belongs to the horizon, not to the system.
    options : Options, optional
        All other settings; see `Options`, and the notes below.
    callback : callable, optional
        Called with an `IterationRecord` after every iteration, and once with the initial trajectory; a true answer
        stops the optimisation. `IterationTable` is one. In continuous time `x` and `u` of the record are samples at the
        ends of the trajectory's pieces, of which there are more or fewer from one iterate to the next.
    **settings
        Fields of `Options` by their names, such as ``max_iterations=50``, before those of `options`.

    Returns
    -------
    OptimizationResult
        Of a continuous system a `ContinuousOptimizationResult`. Frozen; `status` says how it ended.
        Ctrl-C gives the last iterate.

    Raises
    ------
    ArgumentError
        What is no system, or not yet one; settings, shapes or values that are wrong, or an initial curve that
        cannot be projected.

    Warns
    -----
    CoarseStepWarning, EnergyBalanceWarning
        What was found stands on steps of time that `simulate` would call too coarse, or its energy and work do not
        balance, so that shorter steps may have another minimum. The message says so too.
    ResidualWarning
        Parameters alone were fitted, without limits, and the states miss what is wanted by far more than
        ``1 / sqrt(Q)``.

    Notes
    -----
    *Models.* ``method="auto"`` starts with quasi-Newton, stays with it while it predicts the cost well, and goes to
    Newton otherwise. A Newton model without a minimum is damped; a method whose direction cannot be followed is
    replaced, for that iteration, by the next simpler one, and where none can, all of them are shortened by added
    weights. The history and the table show what was used. Whatever the method, convergence is judged by the exact
    second derivative of a discrete system that has one: at a saddle, "auto" and "newton" go on along negative
    curvature, the others end with `Status.SADDLE`.

    *Ways to begin again.* "auto" begins again where it ends without a minimum, or most of its first steps had to be
    shortened: with gaps between the steps (multiple shooting); with larger weights of the inputs at first
    (`Cost.eased`); and where its steps of time are too coarse, among the motions that they resolve
    (`DiscreteSystem.resolved_rates`): it ends with `Status.RESOLVED` where that limit is active at the minimum, and
    goes on without it where it is not. The note of the record says so, and the cost may rise there. ``without``
    switches any of them off.

    *Gaps.* With ``shooting="multiple"`` the start is a curve whose steps need not meet, the states are unknowns too,
    and the gaps close on the way, before a minimum over trajectories is looked for as ever. It is for starts that are
    known but no trajectories, such as the wanted motion with no inputs, and for motions that are unstable over a long
    time, whose projection diverges. For discrete systems. A run that ends before the gaps are closed says so (`gap` of
    the result). Meanwhile violated limits have their lowest prices. With `method` "auto" of a discrete system, "auto"
    tries gaps once, from the start: where that cannot be projected, where most of the first steps had to be shortened
    (within limits, if the projection of the start diverged), where it ends without a minimum within limits, or where it
    takes long without limits; with unknowns at once, where the projection leaves the given curve. Where gaps do not
    close soon, it goes on from the last trajectory, which is the result meanwhile; within limits from the projection of
    the curve.

    *Continuous time.* On a mesh, which is made finer until it resolves the motion, there is one recursion over its
    pieces: much the faster way, and weights may differ by any ratio. With ``collocate=False``, for problems without
    limits and with a given start, equations for nx (nx + 1) / 2 entries of a Riccati matrix are integrated in time
    instead. An optimum is found to about the square of the relative tolerance of `accuracy` in cost, and to the
    tolerance in the trajectory.
    """
    optimizer = Optimizer(
        system, cost, limits, horizon=horizon, free_start=free_start, unknowns=unknowns, options=options, **settings
    )
    return optimizer.run_once(initial, resume=resume, callback=callback, warn=True)


@public
def optimize_continuous(system: ContinuousSystem, cost: ContinuousCost, **options: Any) -> ContinuousOptimizationResult:
    """Return what `optimize` does, which takes systems in either kind of time: the older name."""
    check_system(system, (ContinuousSystem,), ())
    return optimize(system, cost, **options)
