"""Trajectory optimisation by the projection operator (dissertation Alg. 1 to 3).

``minimise h(x, u) over trajectories of x+ = f(x, u, k) from a fixed initial state``

Every iterate is a trajectory. An iteration linearises along it, minimises a quadratic model over the
tangent trajectories (a linear-quadratic problem), and follows the projection of that direction as far
as the cost falls enough.
"""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.optimal.costs import Cost
from leastaction.optimal.discrete.problem import DiscreteProblem
from leastaction.optimal.loop import Callback, Loop
from leastaction.optimal.protocol import DiscreteSystem
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.settings import check_settings

__all__ = ["Callback", "optimize"]


def optimize(
    system: DiscreteSystem,
    cost: Cost,
    *,
    initial: tuple[ArrayLike, ArrayLike] | None = None,
    resume: OptimizationResult | None = None,
    method: Literal["auto", "steepest", "quasi-newton", "newton"] = "auto",
    regulator: Literal["descent", "lqr"] = "descent",
    max_iterations: int = 100,
    tolerance: float = 1e-9,
    absolute_tolerance: float = 1e-14,
    alpha: float = 1e-4,
    beta: float = 0.5,
    max_backtracks: int = 20,
    chunk: int = 64,
    callback: Callback | None = None,
) -> OptimizationResult:
    """Minimise a cost over the trajectories of a system; the initial state stays as it is.

    Parameters
    ----------
    system : DiscreteSystem
        What is steered.
    cost : Cost
        What is minimised, such as a `QuadraticCost`.
    initial : (x, u)
        Where to start: x (N+1, nx) and u (N, nu). If x is not a trajectory of the system, the
        projection of (x, u) is taken. x (nx,) is an initial state alone: u is then applied to it.
    resume : OptimizationResult
        Go on from an earlier result instead of `initial`. The iterates are those of a run that was
        never stopped, if method, regulator, cost and system are the same.
    method : {"auto", "steepest", "quasi-newton", "newton"}
        The model of the descent direction. "auto" starts with quasi-Newton, stays with it while it
        foretells the cost well, and goes to Newton otherwise. A Newton model without a minimum is
        damped; a method whose direction cannot be followed is replaced, for that iteration, by the
        next simpler one. The history and the table show which was used.
    regulator : {"descent", "lqr"}
        Gains of the projection: those of the descent direction's own linear-quadratic problem, which
        cost nothing more, or an LQR with identities as weights (dissertation 6.3.1).
    max_iterations : int
        Limit on the iterations of this run.
    tolerance, absolute_tolerance : float
        Stop when the expected decrease ``-Dg . dxi`` is at most
        ``tolerance * |cost| + absolute_tolerance``.
    alpha, beta : float
        Armijo's: fraction of the linear decrease that is asked for, and factor between trial steps.
    max_backtracks : int
        Shorter steps tried along one direction.
    chunk : int
        Time steps simulated between two looks at the cost of a trial.
    callback : callable, optional
        Called with an `IterationRecord` after every iteration, and once with the initial trajectory;
        a true answer stops the optimisation. `IterationTable` is one.

    Returns
    -------
    OptimizationResult
        Frozen; `status` says how it ended. Ctrl-C gives the last iterate.

    Raises
    ------
    ArgumentError
        Settings, shapes or values that are wrong, or an initial curve that cannot be projected.
    """
    settings = check_settings(
        has_curvature=system.has_curvature,
        system=type(system).__name__,
        method=method,
        regulator=regulator,
        max_iterations=max_iterations,
        tolerance=tolerance,
        absolute_tolerance=absolute_tolerance,
        alpha=alpha,
        beta=beta,
        max_backtracks=max_backtracks,
        chunk=chunk,
    )
    cost.check_shapes(system.N, system.nx, system.nu)
    if (initial is None) == (resume is None):
        raise ArgumentError(
            f"initial, resume: got {'neither' if initial is None else 'both'}, expected one of them."
        )
    problem = DiscreteProblem(system, cost, settings)
    if resume is not None:
        problem.resume(resume)
    elif initial is not None:
        problem.start(*initial)
    return Loop(problem, settings, callback, resume).run()
