"""Costs of a trajectory: ``h(x, u) = sum_k l(x_k, u_k, k) + m(x_N)``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.pool import empty
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public
from leastaction.optimal.cost import Deviations, as_weight, clipped, deviations, final_of, matrix_of, owned_row, weigh
from leastaction.optimal.discrete.hessians import CostHessian, ModelHessian
from leastaction.optimal.discrete.system import check_window
from leastaction.optimal.looking_back import Need
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import System, space_of


class CostGradient(NamedTuple):
    """First derivatives of a cost along a trajectory.

    Attributes
    ----------
    q, r : ndarray (N, ndx), (N, nu)
        ``dl/dx`` and ``dl/du``.
    q_final : ndarray (ndx,)
        ``dm/dx``.
    """

    q: Array
    r: Array
    q_final: Array


class Cost(ABC):
    """A cost that is a sum over the stages and a final term.

    Everything is vectorised over time; the arrays given are read-only. Derivatives by states that are no plain vectors
    are by the dx of ``system.plus(x, dx)`` at zero: ndx is nx of all others. A cost whose methods are pure may serve
    several threads at once. `check_derivatives` holds a cost of yours to its identities.
    """

    __repr__ = printed

    nonnegative: bool = False
    """Whether no stage costs less than zero: a trial can then be given up as soon as its cost so far
    is past what it may cost in all."""

    needs: tuple[Need, ...] = ()
    """What it has to know of the step before, which `optimize` then makes a part of the state."""

    before: Array | None = None
    """Inputs (nu,) of the step before the first, where what it needs of them is known."""

    @abstractmethod
    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        """Return ``l(x_k, u_k, k)``, (n,), for ``x`` (n, nx), ``u`` (n, nu), k from `start` on."""

    @abstractmethod
    def final_value(self, x: Array) -> float:
        """Return ``m(x)`` for the last state (nx,)."""

    @abstractmethod
    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives along ``x`` (N+1, nx), ``u`` (N, nu)."""

    @abstractmethod
    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return the second derivatives along ``x`` (N+1, nx), ``u`` (N, nu)."""

    def convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return positive semidefinite second derivatives, for quadratic models that hold far from a minimum.

        Those of `own_convex_hessian`; else each stage's negative eigenvalues count as zero.
        """
        found = self.own_convex_hessian(x, u)
        if found is None:
            parts = self.own_model_hessian(x, u, convex=True)
            found = convex(self.hessian(x, u)) if parts is None else parts.whole()
        return found

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian | None:
        """Return positive semidefinite second derivatives of the cost's own, such as Gauss and Newton's.

        None of a cost that has none; of one that is convex, all of them.
        """

    def model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian:
        """Return the second derivatives as the optimiser's models take them.

        ``convex``: those of `convex_hessian`, else those of `hessian`.
        """
        found = self.own_model_hessian(x, u, convex=convex)
        return ModelHessian.of((self.convex_hessian if convex else self.hessian)(x, u)) if found is None else found

    def own_model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian | None:
        """Return the same with a part by a few entries of the state, which spares a whole matrix for each stage."""

    def value(self, x: Array, u: Array) -> float:
        """Return the cost of ``x`` (N+1, nx), ``u`` (N, nu)."""
        return float(np.add.reduce(self.stage_values(x[:-1], u, 0), axis=None)) + self.final_value(x[-1])

    def window(self, start: int, stop: int, *, N: int, nu: int) -> Cost:
        """Return the cost of the stages ``start .. stop-1`` of a horizon of N with nu inputs, as a cost of its own.

        At the end of the horizon the last state costs what it does there, before that what it costs as the state of
        stage `stop`, with inputs of zero.
        """
        found = self.own_window(start, stop, N=N, nu=nu)
        return WindowCost(self, start, stop, N=N, nu=nu) if found is None else found

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost | None:
        """Return the same as a cost that evaluates no other stages; None where there is no such."""

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        """Complain if the cost is not for N steps of nx states and nu inputs; optional."""

    def over(self, N: int) -> Cost:
        """Return the cost of N steps, where it is for any number of them; else itself."""
        found = self.own_over(N)
        return self if found is None else found

    def own_over(self, N: int) -> Cost | None:
        """Return the cost of N steps; None of a cost that is for a number of steps already."""

    @property
    def wanted_states(self) -> Array | None:
        """The wanted motion (N+1, nx); None if there is none.

        `optimize` may begin there with gaps between the steps (multiple shooting).
        """

    def remembering(self, system: Any) -> Cost | None:
        """Return a cost that `needs` something as one of the states of a given system, which hold that."""

    def misfit(self, x: Array) -> float | None:
        """Return by how much states (N+1, nx) miss what is wanted, where weights are one over the variances of noise.

        Its root mean square, in standard deviations; None where weights mean something else.
        """

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        """Return a cost that is easier to begin with, and the inputs (N, nu) that cost least; None if there is none.

        Its inputs are dearer by the factor `ease`, and its end cheaper, so that the larger the factor, the closer its
        minimum is to the motion under those inputs. `optimize` begins again with it where a search ends at no minimum.
        """


def convex(hessian: CostHessian) -> CostHessian:
    """Return a Hessian whose stages' eigenvalues below zero are zero; itself where there are none."""
    Q, R, S, Q_final = hessian
    nx = len(Q_final)
    final = clipped(Q_final)
    if S is None:
        found = clipped(Q), clipped(R)
        same = found[0] is Q and found[1] is R and final is Q_final
        return hessian if same else CostHessian(*found, None, final)
    N = max((len(W) for W in (Q, R, S) if W.ndim == 3), default=1)
    whole = np.empty((N, nx + S.shape[-1], nx + S.shape[-1]))
    whole[:, :nx, :nx], whole[:, nx:, nx:], whole[:, :nx, nx:] = matrix_of(Q), matrix_of(R), S
    whole[:, nx:, :nx] = whole[:, :nx, nx:].transpose(0, 2, 1)
    less = clipped(whole)
    if less is whole:
        return hessian if final is Q_final else CostHessian(Q, R, S, final)
    return CostHessian(less[:, :nx, :nx], less[:, nx:, nx:], np.ascontiguousarray(less[:, :nx, nx:]), final)


@public
class QuadraticCost(Cost):
    """Half the weighted square of the distance from a wanted motion.

    ``1/2 sum_k { (x - x_wanted)'Q(x - x_wanted) + (u - u_wanted)'R(u - u_wanted) }
    + 1/2 (x_N - x_wanted_N)' Q_final (x_N - x_wanted_N)``

    Of states that are no plain vectors, ``x - x_wanted`` is ``space.difference(x, x_wanted)``, with ndx numbers.

    Parameters
    ----------
    x_wanted : array_like (N+1, nx) or (nx,)
        Wanted states, or one for all instants. They need not be a trajectory of the system.
    u_wanted : array_like (N, nu) or (nu,)
        Wanted inputs, or one for all steps. Where nothing is given by steps, the cost is for any number of them. Of one
        input, or one state, a number will do, here and for weights.
    Q, R : array_like
        Weights: a diagonal ``(n,)`` (fastest), a matrix ``(n, n)``, a diagonal per stage
        ``(N, n)`` or ``(N, n, 1)``, or a matrix per stage ``(N, n, n)``. An array ``(n, n)`` is one matrix,
        whatever N is. Q must be positive semidefinite, R positive definite.
    Q_final : array_like (nx,) or (nx, nx), optional
        Weight of the last state; that of Q's last stage if left out.
    space : StateSpace or System, optional
        How states differ: a space, or a system whose states are no plain vectors. Subtracted if left out.

    Raises
    ------
    ArgumentError
        Wrong shapes, values that are not finite, weights that are not symmetric or not definite.

    Notes
    -----
    It owns copies that cannot be written to, so any number of threads may share it.
    """

    nonnegative = True

    __setstate__ = restore_state

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in saved_state(self).items() if name != "core"}

    def __init__(
        self,
        x_wanted: ArrayLike,
        u_wanted: ArrayLike,
        *,
        Q: ArrayLike,
        R: ArrayLike,
        Q_final: ArrayLike | None = None,
        space: StateSpace | System | None = None,
    ) -> None:
        self.space = space_of(space)
        self.x_wanted, self.u_wanted = owned_row(x_wanted, "x_wanted"), owned_row(u_wanted, "u_wanted")
        x_shape, u_shape = self.x_wanted.shape, self.u_wanted.shape
        counts = {
            *({x_shape[0] - 1} if len(x_shape) == 2 else ()), *({u_shape[0]} if len(u_shape) == 2 else ()),
            *(each.shape[0] for each in map(np.asarray, (Q, R)) if each.ndim == 3),
        }  # fmt: skip
        if not {len(x_shape), len(u_shape)} <= {1, 2} or len(counts) > 1 or counts == {0}:
            raise ArgumentError(
                f"x_wanted, u_wanted: got shapes {x_shape} and {u_shape}, expected (N+1, nx) and "
                "(N, nu): one state more than inputs; or (nx,) and (nu,), the same at all of them."
            )
        self._steps: int | None = None
        N = counts.pop() if counts else None
        if N is not None:
            self._spread_over(N)
        x_shape, nu = self.x_wanted.shape, u_shape[-1]
        nx = x_shape[-1] if self.space is None else self.space.ndx
        if self.space is not None and self.space.nx != x_shape[-1]:
            raise ArgumentError(f"x_wanted: got shape {x_shape}, expected (N+1, {self.space.nx}), states of the space")
        if self.space is not None:
            self.space.check(np.atleast_2d(self.x_wanted), "x_wanted")
        self.Q = as_weight(Q, "Q", nx, stages=N, definite=False)
        self.R = as_weight(R, "R", nu, stages=N, definite=True)
        if Q_final is None:
            self.Q_final = final_of(self.Q)
        else:
            self.Q_final = as_weight(Q_final, "Q_final", nx, definite=False)

    @cached_property
    def core(self) -> _core.QuadraticCost:
        """The squares of what states, or differences of states, and inputs are off by."""
        x_wanted = self.x_wanted if self.space is None else np.zeros(self.space.ndx)
        return _core.QuadraticCost(x_wanted, self.u_wanted, self.Q, self.R, self.Q_final)

    def _spread_over(self, N: int) -> None:
        """Take constants for what is wanted at each of N steps."""
        self.x_wanted = np.broadcast_to(self.x_wanted, (N + 1, self.x_wanted.shape[-1]))
        self.u_wanted = np.broadcast_to(self.u_wanted, (N, self.u_wanted.shape[-1]))
        self._steps = N

    def own_over(self, N: int) -> Cost | None:
        if self._steps is not None:
            return None
        found = copy(self)
        found._spread_over(N)
        return found

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        rows = self._steps is not None
        for name, got, expected in (
            ("x_wanted", self.x_wanted.shape, (N + 1, nx) if rows else (nx,)),
            ("u_wanted", self.u_wanted.shape, (N, nu) if rows else (nu,)),
        ):
            if got != expected:
                raise ArgumentError(
                    f"cost.{name}: got shape {got}, expected {expected} to go with the system of "
                    f"N = {N} steps, nx = {nx} states and nu = {nu} inputs."
                )

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        if self.space is not None:
            wanted = self.x_wanted[start : start + len(u)] if self._steps else self.x_wanted
            x = self.space.difference(x, wanted)
        values: Array = empty((len(u),))
        self.core.stages(x, u, start, values)
        return values

    def final_value(self, x: Array) -> float:
        if self.space is not None:
            x = self.space.difference(x, self.x_wanted[-1] if self._steps else self.x_wanted)
        return self.core.last(x)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        if self.space is not None:
            stages, last = self._deviations(self.space, x)
            return CostGradient(stages.gradient, weigh(self.R, u - self.u_wanted), last.gradient[0])
        n = x.shape[1]
        found = CostGradient(empty((len(u), n)), empty(u.shape), empty((n,)))
        self.core.gradient(x, u, *found)
        return found

    def hessian(self, x: Array, u: Array) -> CostHessian:  # noqa: ARG002
        if self.space is None:
            return CostHessian(self.Q, self.R, None, self.Q_final)
        stages, last = self._deviations(self.space, x)
        return CostHessian(stages.squares + stages.bend, self.R, None, (last.squares + last.bend)[0])

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian | None:
        if type(self) is not QuadraticCost:
            return None
        if self.space is None:
            return self.hessian(x, u)
        stages, last = self._deviations(self.space, x)
        return CostHessian(stages.squares, self.R, None, last.squares[0])

    def own_model_hessian(self, x: Array, u: Array, *, convex: bool) -> ModelHessian | None:  # noqa: ARG002
        if type(self) is not QuadraticCost or self.space is not None:
            return None
        return ModelHessian(self.Q, self.R, None, self.Q_final)

    def _deviations(self, space: StateSpace, x: Array) -> tuple[Deviations, Deviations]:
        """Return the derivatives of what states cost: of the stages, and of the last."""
        wanted = np.broadcast_to(self.x_wanted, x.shape)
        stages = deviations(space, self.Q, x[:-1], wanted[:-1])
        return stages, deviations(space, self.Q_final, x[-1:], wanted[-1:])

    @property
    def wanted_states(self) -> Array | None:
        return self.x_wanted if self._steps else None

    def misfit(self, x: Array) -> float | None:
        if type(self) is not QuadraticCost:
            return None
        missed = x - self.x_wanted if self.space is None else self.space.difference(x, self.x_wanted)
        total = np.sum(missed[:-1] * weigh(self.Q, missed[:-1])) + np.sum(
            missed[-1:] * weigh(self.Q_final, missed[-1:])
        )
        count = np.count_nonzero(weigh(self.Q, np.ones_like(missed[:-1])))
        return float(np.sqrt(total / count)) if count else None

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        """Return the cost with R times `ease` and Q_final over its root, and the wanted inputs; see `Cost`."""
        if type(self) is not QuadraticCost:
            return None
        weights = {"Q": self.Q, "R": ease * self.R, "Q_final": self.Q_final / np.sqrt(ease)}
        return QuadraticCost(self.x_wanted, self.u_wanted, **weights, space=self.space), self.u_wanted

    def own_window(self, start: int, stop: int, *, N: int, nu: int) -> Cost | None:
        if type(self) is not QuadraticCost:
            return None
        check_window(start, stop, N)
        self.check_shapes(N, self.x_wanted.shape[-1], nu)
        if self._steps is None:
            return self
        part = slice(start, stop)
        return QuadraticCost(
            self.x_wanted[start : stop + 1],
            self.u_wanted[part],
            Q=_stages(self.Q, part),
            R=_stages(self.R, part),
            Q_final=self.Q_final if stop == N else _weight_at(self.Q, stop),
            space=self.space,
        )


class AddedCost(Cost):
    """Another cost and a price of something beside it; as fit for several threads as the other cost.

    What the price changes nothing of is the other cost's. Subclasses say the prices and their derivatives.

    Parameters
    ----------
    cost : Cost
        The other cost.
    what : str
        What has a price, in the plural, for messages.
    sizes : tuple of int
        The N, nx, nu that the price is for.
    """

    __getstate__, __setstate__ = saved_state, restore_state

    can_be_eased: ClassVar[bool] = True
    """Whether the same price beside an easier cost leads to a motion from which this cost can be minimised."""

    def __init__(self, cost: Cost, what: str, sizes: tuple[int, int, int]) -> None:
        self.cost, self.nonnegative = cost.over(sizes[0]), cost.nonnegative
        self.needs, self.before = self.cost.needs, self.cost.before
        self._what, self._sizes = what, sizes

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        """Complain if the other cost, or what has a price, is of other sizes."""
        if (N, nx, nu) != self._sizes:
            raise ArgumentError(
                f"cost: {self._what} are those of a system of N, nx, nu = {self._sizes}, and this one has {(N, nx, nu)}"
            )
        self.cost.check_shapes(N, nx, nu)

    def stage_prices(self, x: Array, u: Array, start: int) -> Array | None:
        """Return the prices (n,) of stages, if they have some; arguments as of `stage_values`."""

    def final_price(self, x: Array) -> float | None:
        """Return the price of the last state (nx,), if it has one."""

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        values, prices = self.cost.stage_values(x, u, start), self.stage_prices(x, u, start)
        return values if prices is None else np.asarray(values + prices)

    def final_value(self, x: Array) -> float:
        value, price = self.cost.final_value(x), self.final_price(x)
        return value if price is None else value + price

    @property
    def wanted_states(self) -> Array | None:
        return self.cost.wanted_states

    def eased(self, ease: float) -> tuple[Cost, Array] | None:
        """Return the other cost eased, with the same price; see `Cost`."""
        found = self.cost.eased(ease) if self.can_be_eased else None
        return None if found is None else (self._beside(found[0]), found[1])

    def remembering(self, system: Any) -> Cost:
        found = self.own_remembering(system)
        if found is not None:
            return found
        other = self._beside(system.cost_of(self.cost))
        other.needs = ()
        return other

    def own_remembering(self, system: Any) -> Cost | None:
        """Return the same, where the price is what needs something; None where only the other cost does."""

    def _beside(self, cost: Cost, N: int | None = None) -> Self:
        """Return the same price beside another cost, of N steps where it is of others."""
        other = copy(self)
        other.cost, other.nonnegative = cost, cost.nonnegative
        if N is not None:
            other._sizes = (N, *self._sizes[1:])
        return other


@public
class WindowCost(Cost):
    """The stages ``start .. stop-1`` of a cost, as a cost of its own; as fit for several threads as that is.

    Parameters
    ----------
    cost : Cost
    start, stop : int
        First stage, and one past the last.
    N, nu : int
        Number of stages of the whole cost, and of inputs.

    Raises
    ------
    ArgumentError
        For a window that is empty, or not within the horizon.
    """

    def __init__(self, cost: Cost, start: int, stop: int, *, N: int, nu: int) -> None:
        check_window(start, stop, N)
        self.cost = cost
        self.start, self.stop, self.horizon, self.nu = start, stop, N, nu
        self.nonnegative = cost.nonnegative

    def check_shapes(self, N: int, nx: int, nu: int) -> None:
        if (N, nu) != (self.stop - self.start, self.nu):
            raise ArgumentError(
                f"cost: got a window of {self.stop - self.start} steps with {self.nu} inputs, expected {N} with {nu}"
            )
        self.cost.check_shapes(self.horizon, nx, nu)

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return self.cost.stage_values(x, u, self.start + start)

    def final_value(self, x: Array) -> float:
        if self.stop == self.horizon:
            return self.cost.final_value(x)
        return float(self.cost.stage_values(x[None], np.zeros((1, self.nu)), self.stop)[0])

    def gradient(self, x: Array, u: Array) -> CostGradient:
        q, r, q_final = self.cost.gradient(*self._whole(x, u))
        part = slice(self.start, self.stop)
        return CostGradient(q[part], r[part], q_final if self.stop == self.horizon else q[self.stop])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        return self._part(self.cost.hessian(*self._whole(x, u)))

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        return self._part(self.cost.convex_hessian(*self._whole(x, u)))

    def _part(self, whole: CostHessian) -> CostHessian:
        Q, R, S, Q_final = whole
        part = slice(self.start, self.stop)
        last = Q_final if self.stop == self.horizon else _weight_at(Q, self.stop)
        return CostHessian(_stages(Q, part), _stages(R, part), None if S is None else _stages(S, part), last)

    def _whole(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return states and inputs of the whole horizon; those outside of the window are never looked at."""
        whole_x, whole_u = np.empty((self.horizon + 1, x.shape[1])), np.zeros((self.horizon, u.shape[1]))
        whole_x[: self.start], whole_x[self.stop + 1 :] = x[0], x[-1]
        whole_x[self.start : self.stop + 1] = x
        whole_u[self.start : self.stop] = u
        return read_only(whole_x), read_only(whole_u)


def _weight_at(weight: Array, k: int) -> Array:
    """Return the weight of stage k."""
    if weight.ndim < 3:
        return weight
    return weight[k, :, 0] if weight.shape[2] == 1 else weight[k]


def _stages(weight: Array, part: slice) -> Array:
    """Return a weight over some of the stages."""
    return weight if weight.ndim < 3 else weight[part]
