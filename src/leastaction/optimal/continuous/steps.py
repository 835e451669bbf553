"""Steps from one trajectory to the next, in continuous time."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial, approximate
from leastaction.optimal.continuous.models import ContinuousDirection, ContinuousModels
from leastaction.optimal.continuous.projection import Follower, roll_out
from leastaction.optimal.continuous.riccati import ContinuousLinearQuadraticSolution
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Steps, along_parabola


class ContinuousSteps(Steps[ContinuousLinearQuadraticSolution, ContinuousDirection, DenseTrajectory]):
    """Steps from one trajectory to the next, which are projections."""

    def __init__(self, models: ContinuousModels) -> None:
        self.models, self.here = models, models.here

    def direction(
        self, method: str, model: ContinuousLinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> ContinuousDirection:
        feedback = model.feedback
        if self.models.own_regulator:
            feedback = self._with_own_gain(model)
        else:
            self.models.feedback = feedback
        # With dx(t0) = 0 the model's minimum is half of its linear part.
        return ContinuousDirection(method, 2.0 * model.constant, scale, shift, feedback=feedback)

    def _with_own_gain(self, model: ContinuousLinearQuadraticSolution) -> PiecewisePolynomial:
        """Return the projection's own gains, with the feedforward that follows the direction.

        ``ubar - K (x - xbar)`` of ``(xbar, ubar) = xi + s dxi`` is ``u - s (Kd dx + C - K dx) - K (x - x_now)``,
        where ``du = -Kd dx - C`` is the direction's own law.
        """
        assert self.models.feedback is not None
        own = self.models.feedback
        nx, nu = self.models.system.nx, self.models.system.nu
        size = self.models.size()
        tangent = self.models.sweep(model)

        def law(t: Array) -> Array:
            K, dxdu = own(t)[:, : nu * nx], tangent.xu(t)
            fed_back = np.einsum("nij,nj->ni", K.reshape(-1, nu, nx), dxdu[:, :nx])
            return np.hstack([K, -dxdu[:, nx:] - fed_back])

        least = np.zeros(nu * (nx + 1))
        least[nu * nx :] = size[nx:]
        mesh, values = approximate(law, Mesh(own.breaks), self.models.accuracy.sampling, least)
        return mesh.fit(values, (values.shape[1],))

    def first_step(self, direction: ContinuousDirection, length: float) -> float:  # noqa: ARG002
        return length

    def promised(self, direction: ContinuousDirection, length: float) -> float:
        return along_parabola(direction, length)

    def simulate(self, direction: ContinuousDirection, length: float, bound: float) -> Trial[DenseTrajectory] | Refusal:
        rollout = roll_out(
            self.models.system,
            Follower(self.here.trajectory, direction.feedback, length, self.models.system.charts()),
            accuracy=self.models.accuracy,
            jumps=self.models.jumps,
            cost=self.models.cost,
            cost_scale=abs(self.here.value),
            bound=bound,
        )
        if rollout.trajectory is None:
            return Refusal(f"the roll-out ended at {rollout.failure}", failed=True)
        if direction.bend < 0.0:
            # Along it short steps change the cost by less than the noise, which says nothing of where it falls.
            bound = min(bound, self.here.value - self.here.noise)
        # Not "cost > bound": a NaN is refused.
        if not rollout.cost <= bound:
            return Refusal(f"a cost of {rollout.cost:.10g}, where at most {bound:.10g} was wanted", cost=rollout.cost)
        return Trial(rollout.trajectory, rollout.cost)

    def accept(self, direction: ContinuousDirection, trial: Trial[DenseTrajectory]) -> None:
        self.here.trajectory, self.here.value = trial.iterate, trial.cost
        self.here.gain = direction.feedback
        self.models.forget()
