"""JAX: motions of a system as functions that JAX differentiates, by the system's own exact derivatives.

Forward and backward, once and twice: a motion is linearised where JAX asks for its tangent, and the linearisation has
the exact second order for a tangent of its own. ``vmap`` simulates many at once. Nothing is traced: the core computes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.control.bridge.derivatives import BatchedSystem
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.extras import extra
from leastaction.optimal.discrete.system import DiscreteSystem


def roll_out(system: DiscreteSystem) -> Callable[[Any, Any], Any]:
    """Return the motions of a system as a function for JAX.

    Parameters
    ----------
    system : DiscreteSystem

    Returns
    -------
    callable
        ``states(x0, u) -> (N+1, nx)`` of an initial state (nx,) and inputs (N, nu). It may be differentiated, twice
        too (``jax.jvp``, ``grad``, ``hessian``), mapped (``vmap``) and compiled (``jit``). Numbers are as precise as
        JAX is told to be: ``jax.config.update("jax_enable_x64", True)`` for all digits.

    Raises
    ------
    ArgumentError
        What is no discrete system.
    MissingExtraError
        JAX is not installed.

    Examples
    --------
    The push that brings a mass to 1 m, by gradient descent through the motion::

        states = roll_out(system)
        loss = lambda u: (states(x0, u)[-1, 0] - 1.0) ** 2
        gradient = jax.jit(jax.grad(loss))
    """
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
    jax = extra("jax", of="jax", why="bridge.jax")
    jnp = extra("jax.numpy", of="jax", why="bridge.jax")
    batched = BatchedSystem(system)
    N, nx, n = system.N, system.nx, system.nx + system.nu

    def asked(function: Callable[..., Any], shape: tuple[int, ...], *arrays: Any) -> Any:
        kind = jnp.result_type(float)
        return jax.pure_callback(
            lambda *given: np.asarray(function(*(np.asarray(each) for each in given)), dtype=kind),
            jax.ShapeDtypeStruct(shape, kind),
            *(jnp.asarray(each, dtype=kind) for each in arrays),
            vmap_method="broadcast_all",
        )

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def states(x0: Any, u: Any) -> Any:
        return asked(batched.states, (N + 1, nx), x0, u)

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def slopes(x: Any, u: Any) -> Any:
        return asked(batched.slopes, (N, nx, n), x, u)

    @slopes.defjvp  # type: ignore[untyped-decorator]
    def slopes_jvp(primals: Any, tangents: Any) -> Any:
        x, u = primals
        dz = jnp.concatenate([tangents[0][:-1], tangents[1]], axis=1)
        bends = asked(batched.bends, (N, nx, n, n), x, u)
        return slopes(x, u), jnp.einsum("kaij,kj->kai", bends, dz)

    @states.defjvp  # type: ignore[untyped-decorator]
    def states_jvp(primals: Any, tangents: Any) -> Any:
        x0, u = primals
        x = states(x0, u)
        J = slopes(x, u)

        def step(dx: Any, row: Any) -> Any:
            slope, du = row
            after = slope @ jnp.concatenate([dx, du])
            return after, after

        kind = x.dtype
        dx0, du = (jnp.asarray(each, dtype=kind) for each in tangents)
        _, dx = jax.lax.scan(step, dx0, (J, du))
        return x, jnp.concatenate([dx0[None], dx])

    def checked(x0: Any, u: Any) -> Any:
        return states(jnp.asarray(x0, dtype=jnp.result_type(float)), jnp.asarray(u, dtype=jnp.result_type(float)))

    return checked
