"""PyTorch: motions of a system as a function with a gradient, by the system's own exact derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.control.bridge.derivatives import BatchedSystem
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.extras import extra
from leastaction.optimal.discrete.system import DiscreteSystem


def roll_out(system: DiscreteSystem) -> Callable[[Any, Any], Any]:
    """Return the motions of a system as a function for PyTorch.

    Parameters
    ----------
    system : DiscreteSystem

    Returns
    -------
    callable
        ``states(x0, u) -> (..., N+1, nx)`` of tensors x0 (..., nx) and u (..., N, nu), whose axes in front are a batch.
        Its gradient is one backward sweep of the adjoint; results have the type of u. The quaternion of a rotation may
        have any length in x0, which is without effect on the motion: the gradient is normal to it.

    Raises
    ------
    ArgumentError
        What is no discrete system.
    MissingExtraError
        PyTorch is not installed.
    """
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
    torch = extra("torch", of="torch", why="bridge.torch")
    batched = BatchedSystem(system)

    def array(tensor: Any) -> Any:
        return tensor.detach().cpu().numpy().astype(np.float64)

    class DifferentiableMotion(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(ctx: Any, x0: Any, u: Any) -> Any:
            x = batched.states(array(x0), array(u))
            ctx.motion = x, array(u)
            ctx.kinds = x0, u
            return torch.tensor(x).to(u)

        @staticmethod
        def backward(ctx: Any, weight: Any) -> Any:
            by_x0, by_u = batched.pull_back(batched.slopes(*ctx.motion), array(weight))
            return tuple(torch.as_tensor(by).to(like) for by, like in zip((by_x0, by_u), ctx.kinds, strict=True))

    return lambda x0, u: DifferentiableMotion.apply(x0, u)
