"""The linear-quadratic problems along an iterate, and what was computed for them: once, until the iterate moves."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty
from leastaction.optimal.discrete.charts import read_at
from leastaction.optimal.discrete.cost import CostGradient
from leastaction.optimal.discrete.descent import escape, minimise_model
from leastaction.optimal.discrete.hessians import ModelHessian, shifted
from leastaction.optimal.discrete.linear_quadratic import Law, LinearQuadraticSolution, Workspace, adjoint_along, swept
from leastaction.optimal.discrete.own_projection import OwnProjection
from leastaction.optimal.discrete.system import DiscreteSystem, linearized
from leastaction.optimal.iterates.direction import DiscreteDirection, ModelMinimum
from leastaction.optimal.iterates.free_start import FreeStart
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.iterates.merit import Merit
from leastaction.optimal.iterates.work import Work
from leastaction.optimal.loop import DescentModels
from leastaction.optimal.space import sizes_of
from leastaction.optimal.system import Linearization


class Models(DescentModels[LinearQuadraticSolution, DiscreteDirection]):
    """Quadratic models of what is minimised, along the iterate.

    ``merit``: what is minimised. ``space``: of the states, as of `System.charts`. ``own``: the projection, if that has
    gains of its own. ``costates`` (N+1, ndx): multipliers of the dynamics along a curve with gaps; None of a
    trajectory, whose adjoint they are, and where nothing is known of them yet. ``quasi_newton``: the minimum of that
    model, if it is known; ``feedback`` (N, nu, ndx): gains about the iterate, if these are.
    """

    def __init__(
        self,
        system: DiscreteSystem,
        merit: Merit,
        here: Here,
        work: Work,
        start: FreeStart,
        own: OwnProjection | None = None,
    ) -> None:
        self.system, self.merit, self.here, self.work, self.start = system, merit, here, work, start
        self.space, self.own, self.has_curvature = system.charts(), own, system.has_curvature
        self.costates: Array | None = None
        self.linearization: Linearization | None = None
        self.curvature: Array | None = None
        self.quasi_newton: LinearQuadraticSolution | None = None
        self.feedback: Array | None = None

    def forget(self) -> None:
        """Drop all that was computed along the iterate."""
        self.merit.forget()
        self.leave()

    def leave(self) -> None:
        """Drop it where the merit has moved on already."""
        self.linearization = None
        self.start.forget()
        self._forget_solutions()

    def forget_stage(self) -> None:
        """Drop what the cost had a part in."""
        self.merit.forget_stage()
        self._forget_solutions()

    def _forget_solutions(self) -> None:
        self.curvature = self.quasi_newton = self.feedback = None

    # ---- What models are made of ------------------------------------------------------------------

    def linearize(self) -> Linearization:
        """Return the derivatives of the dynamics along the iterate."""
        if self.linearization is None:
            here, curve = self.here, self.here.curve
            with self.work.clock.linearize:
                if curve is None:
                    made = linearized(self.system, here.x, here.u, self.work.linearization)
                    self.work.linearization = made
                else:
                    made = self.system.linearize_each(here.x, here.u, curve.ends)
            if curve is not None and self.space is not None:
                made = read_at(self.space, made, curve.ends, here.x[1:])
            self.linearization = made
        return self.linearization

    def curved(self) -> Array:
        """Return the second derivatives of the dynamics, weighed with their multipliers."""
        if self.curvature is None:
            here, costates = self.here, self.costates if self.here.is_open else None
            if here.is_open and costates is None:
                # Nothing is known of them yet: those of a loop that is closed by some gains.
                here.gain = self.solve("quasi-newton", self.work.spare).K.copy()
            linearization = self.linearize()
            if costates is None:
                gradient = self.merit.lagrangian_gradient()
                with self.work.clock.lq:
                    A, B = linearization
                    costates = adjoint_along(A, B, here.gain, gradient, linearization.pattern)
            with self.work.clock.curvature:
                self.curvature = linearization.packed_curvature(costates)
        return self.curvature

    # ---- Models -----------------------------------------------------------------------------------

    def solve(
        self, method: str, workspace: Workspace, scale: float = 0.0, shift: float = 0.0
    ) -> LinearQuadraticSolution:
        """Solve the linear-quadratic problem of a method in some memory."""
        gradient = self.merit.gradient()
        hessian = self.merit.hessian(scale if method == "newton" else 0.0, self)
        if shift > 0.0:
            hessian = shifted(hessian, shift)
        return self._minimum(method, gradient, hessian, workspace, scale)

    def solved_with(
        self, direction: DiscreteDirection, gradient: CostGradient, hessian: ModelHessian
    ) -> ModelMinimum | None:
        """Return the minimum of a direction's model with another gradient and other weights; None if it has none.

        Its law stands where those of directions do.
        """
        method = direction.method.removesuffix("-shifted").removesuffix("-damped")
        spare, scale, shift = self.work.spare, direction.curvature_scale, direction.shift
        shifted_hessian = shifted(hessian, shift) if shift > 0.0 else hessian
        model = self._minimum(method, gradient, shifted_hessian, spare, scale)
        model = self.start.checked(model, self.here.x[0], lambda: shifted_hessian)
        if not model.definite:
            return None
        self.work.take_spare()
        own_gain = self.own_gain()
        if own_gain is None:
            self.feedback = None  # the next is written over it
        dx0 = self.start_step(model)
        dx, du = self.sweep(model, dx0)
        return ModelMinimum(least_of(model, dx0), dx, du, model.K if own_gain is None else own_gain, model.C)

    def left_of(self, gradient: CostGradient, hessian: ModelHessian) -> float | None:
        """Return the decrease that Newton's model expects with these derivatives; None if it has no minimum."""
        model = self._minimum("newton", gradient, hessian, self.work.free, 1.0)
        model = self.start.checked(model, self.here.x[0], lambda: hessian)
        return -2.0 * least_of(model, self.start_step(model)) if model.definite else None

    def tells_of_all(self, hessian: ModelHessian) -> bool:
        """Return whether the quasi-Newton model with other weights determines every unknown number."""
        model = self._minimum("quasi-newton", self.merit.gradient(), hessian, self.work.last, 0.0)
        self.start.checked(model, self.here.x[0], lambda: hessian)
        return not self.start.undetermined

    def last_motion(self, *, newton: bool) -> tuple[Array, Array] | None:
        """Return the motion along a direction that is not followed any more; None if there is none."""
        # In memory of its own: the feedback of the result may be in that of the iteration.
        method, scale = ("newton", 1.0) if newton else ("quasi-newton", 0.0)
        model = self.solve(method, self.work.last, scale)
        model = self.start.checked(model, self.here.x[0], lambda: self.merit.hessian(scale, self))
        return self.sweep(model, self.start_step(model)) if model.definite else None

    def _minimum(
        self,
        method: str,
        gradient: CostGradient,
        hessian: ModelHessian,
        workspace: Workspace,
        scale: float,
    ) -> LinearQuadraticSolution:
        linearization, curve = self.linearize(), self.here.curve
        curvature = self.curved() if method == "newton" else None
        gaps = None if curve is None else curve.gaps
        with self.work.clock.lq:
            return minimise_model(method, linearization, gradient, hessian, curvature, workspace, scale, gaps)

    @property
    def magnitude(self) -> float:
        return self.merit.magnitude()

    @property
    def knows_longest_step(self) -> bool:
        return self.merit.has_barriers

    def minimise(self, method: str, scale: float, shift: float = 0.0) -> LinearQuadraticSolution:
        """Return the minimum of a method's model, also over an initial state that is free."""
        model = self._minimised(method, scale, shift)
        # In exact numbers a convex model has a minimum.
        is_lost = method == "quasi-newton" and not model.definite
        self.is_below_rounding = self.merit.has_barriers and (is_lost or model.smallest_eigenvalue > 0.0)
        if self.is_below_rounding:
            # Beside stiff limits the rest of the curvature is lost in rounding: this is no saddle.
            self.tells_saddles = False
        return model

    def _minimised(self, method: str, scale: float, shift: float) -> LinearQuadraticSolution:
        self.own_gain()
        if method == "quasi-newton" and shift == 0.0 and self.quasi_newton is not None:
            model = self.quasi_newton
        else:
            model = self.solve(method, self.work.free, scale, shift)
        share = scale if method == "newton" else 0.0
        return self.start.checked(model, self.here.x[0], lambda: self.merit.hessian(share, self))

    def refined(self, direction: DiscreteDirection, *, holds: bool) -> DiscreteDirection:
        return self.merit.refined(direction, self, holds=holds)

    def remaining_decrease(self) -> float:
        if self.here.is_open or not self.has_curvature:
            return np.inf
        return self.merit.remaining_decrease(self)

    def keep_feedback(self, direction: DiscreteDirection) -> None:
        self.feedback = direction.gain
        self.merit.settle()

    def own_gain(self) -> Array | None:
        """Return the projection's own gains about the iterate, if it has any."""
        if self.own is None:
            return None
        if self.feedback is None:
            with self.work.clock.lq:
                self.here.gain = self.feedback = self.own.gains(self.linearize(), self.work.lqr)
        return self.here.gain

    # ---- Motions ----------------------------------------------------------------------------------

    def sweep(self, law: Law, dx0: Array | None, *, gaps: Array | None = None) -> tuple[Array, Array]:
        """Return the motion of the linear dynamics under a law, which closes gaps."""
        linearization = self.linearize()
        A, B = linearization
        return swept(A, B, law, dx0, gaps, linearization.pattern)

    def motion(self, direction: DiscreteDirection) -> tuple[Array, Array]:
        """Return the changes of states and inputs along a direction."""
        if direction.dx is None or direction.du is None:
            return self.sweep(direction, direction.dx0)
        return direction.dx, direction.du

    def start_step(self, model: LinearQuadraticSolution) -> Array | None:
        """Return the change of the initial state at a model's minimum; None if it is fixed."""
        return self.start.step(model, self.here.x[0])

    def negative_curvature(self, scale: float) -> DiscreteDirection | None:
        """Return a direction of negative curvature, where the undamped Newton model has one."""
        gradient, here = self.merit.gradient(), self.here
        found = escape(
            self.linearize(),
            gradient,
            lambda share: self.merit.hessian(share, self),
            self.curved(),
            self.work.free,
            scale,
        )
        if found is None:
            return None
        dx, du, slope, bend = found
        # A step that is expected to lower the cost by a tenth, but goes no further than a model may hold.
        length = np.sqrt(0.2 * abs(here.value) / -bend)
        reach = np.abs(dx).max(axis=0) / sizes_of(self.space, here.x)
        length = min(length, 0.3 / float(reach.max()))
        return DiscreteDirection(
            "negative-curvature",
            length * slope,
            1.0,
            bend=length**2 * bend,
            gain=here.gain,  # with which the curvature was computed
            C=du,
            dx=length * dx,
            du=length * du,
        )

    def where(self, direction: DiscreteDirection) -> str:
        """Return which input, and when, has most of the decrease that is expected of a direction."""
        linearization, gradient = self.linearize(), self.merit.gradient()
        A, B = linearization
        shares: Array = empty(gradient.r.shape)
        adjoint_along(A, B, direction.gain, gradient, linearization.pattern, shares)
        feedforward = direction.C
        if direction.dx is not None and direction.du is not None:
            feedforward = -direction.du - np.einsum("kux,kx->ku", direction.gain, direction.dx[:-1])
        # By the gains of the direction, its slope is that of the feedforward alone.
        shares *= feedforward
        k, i = divmod(int(shares.argmax()), shares.shape[1])
        return f"{self.system.input_name(i)!r} around {self.system.when(k)}"


def least_of(model: LinearQuadraticSolution, dx0: Array | None) -> float:
    """Return the value of a model at its minimum: that for ``dx_0 = 0``, and what its dx_0 adds, where that is free."""
    return model.constant if dx0 is None else model.constant + 0.5 * float(model.b[0] @ dx0)
