"""JAX: motions of a system, and optimal ones, as functions that JAX differentiates by the system's exact derivatives.

Forward and backward, once and twice: a motion is linearised where JAX asks for its tangent, and the linearisation has
the exact second order for a tangent of its own. ``vmap`` simulates many at once. An optimal motion is differentiated by
the implicit function theorem. Nothing is traced: the core computes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from leastaction.control.bridge.derivatives import BatchedSystem
from leastaction.control.bridge.optimal_motion import OptimalMotion, checked_names, with_values
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.extras import extra
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem


class Optimum(NamedTuple):
    """An optimal motion: its states x (N+1, nx), inputs u (N, nu), and its cost."""

    x: Any
    u: Any
    cost: Any


def roll_out(system: DiscreteSystem, *, parameters: Sequence[str] = ()) -> Callable[..., Any]:
    """Return the motions of a system as a function for JAX.

    Parameters
    ----------
    system : DiscreteSystem
    parameters : sequence of str, optional
        Parameters of the system, such as ``["bob.mass"]``, that the function has as its third argument.

    Returns
    -------
    callable
        ``states(x0, u) -> (N+1, nx)`` of an initial state (nx,) and inputs (N, nu). It may be differentiated, twice
        too (``jax.jvp``, ``grad``, ``hessian``), mapped (``vmap``) and compiled (``jit``). With parameters
        ``states(x0, u, values)``, values (P,), which may be differentiated once, by all three. Numbers are as precise
        as JAX is told to be: ``jax.config.update("jax_enable_x64", True)`` for all digits.

        A rotation has four numbers and three directions. Those of x0 may have any length, which is without effect on
        the motion, and so the derivative by these four numbers: what of it is along them is zero, the rest is by
        rotations alone. The next quaternions have length one, and their changes are normal to them.

    Raises
    ------
    ArgumentError
        What is no discrete system, or a parameter that it has not.
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
    batched, names = BatchedSystem(system), checked_names(system, parameters)
    N, nx, n = system.N, system.nx, system.nx + system.nu
    if names:
        return _roll_out_by(system, names)

    def asked(function: Callable[..., Any], shape: tuple[int, ...], *arrays: Any) -> Any:
        return _asked(function, [shape], *arrays, vmap_method="broadcast_all")[0]

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

    return _with_floats(states)


def optimum(
    system: DiscreteSystem, cost: Cost, *, parameters: Sequence[str] = (), u: Any = None, **settings: Any
) -> Callable[..., Optimum]:
    """Return the optimal motions of a system as a function for JAX.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    parameters : sequence of str, optional
        Parameters of the system, such as ``["bob.mass"]``, that the function has as its second argument.
    u : array_like (N, nu), optional
        Inputs to begin each search with; those of the cost's wanted inputs, or zero if left out.
    **settings
        Of `optimize`, such as ``tolerance``, 1e-9 if left out: derivatives are those at the optimum. No limits, free
        starts or unknowns.

    Returns
    -------
    callable
        ``best(x0) -> Optimum`` of an initial state (nx,), with parameters ``best(x0, values)``, values (P,). Its motion
        and its cost may be differentiated once, forward and backward, by the implicit function theorem: no search is
        traced, whatever the number of its iterations. Rotations as in `roll_out`. Where it ends in no optimum, or in
        one that is no strict minimum, it is an error.

    Raises
    ------
    ArgumentError
        Wrong arguments, limits, or a parameter that the system has not.
    MissingExtraError
        JAX is not installed.

    Examples
    --------
    How the least cost of a swing-up goes with the mass of the bob::

        best = optimum(system, cost, parameters=["bob.mass"])
        slope = jax.grad(lambda mass: best(x0, mass).cost)(jnp.array([1.0]))
    """
    require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
    jax = extra("jax", of="jax", why="bridge.jax")
    motion = OptimalMotion(system, cost, parameters, u, settings)
    N, nx, nu, P = system.N, system.nx, system.nu, len(motion.names)
    shapes = [(N + 1, nx), (N, nu)]

    def solved(x0: Any, values: Any) -> tuple[Any, ...]:
        x, inputs = motion.solve(x0, values)
        return x, inputs, motion.value(x, inputs)

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def best(x0: Any, values: Any) -> Optimum:
        return Optimum(*_asked(solved, [*shapes, ()], x0, values))

    @best.defjvp  # type: ignore[untyped-decorator]
    def best_jvp(primals: Any, tangents: Any) -> Any:
        found = best(*primals)
        by = [(*shape, nx + P) for shape in (*shapes, ())]
        slopes = _asked(motion.slopes, by, found.x, found.u, primals[1])
        change = extra("jax.numpy", of="jax", why="bridge.jax").concatenate(tangents)
        return found, Optimum(*(each @ change for each in slopes))

    of_both = _with_floats(best)
    return of_both if P else lambda x0: of_both(x0, np.zeros(0))


def _roll_out_by(system: DiscreteSystem, names: tuple[str, ...]) -> Callable[..., Any]:
    """Return motions as a function of an initial state, inputs, and values of parameters."""
    jax = extra("jax", of="jax", why="bridge.jax")
    jnp = extra("jax.numpy", of="jax", why="bridge.jax")
    N, nx, n = system.N, system.nx, system.nx + system.nu

    def moved(x0: Any, u: Any, values: Any) -> tuple[Any]:
        return (BatchedSystem(with_values(system, names, values)).states(x0, u),)

    def steps_by(x: Any, u: Any, values: Any) -> tuple[Any]:
        at = BatchedSystem(with_values(system, names, values))
        return (np.concatenate([at.slopes(x, u), at.by_parameters(x, u, names)], axis=2),)

    @jax.custom_jvp  # type: ignore[untyped-decorator]
    def states(x0: Any, u: Any, values: Any) -> Any:
        return _asked(moved, [(N + 1, nx)], x0, u, values)[0]

    @states.defjvp  # type: ignore[untyped-decorator]
    def states_jvp(primals: Any, tangents: Any) -> Any:
        x0, u, values = primals
        dx0, du, dvalues = tangents
        x = states(x0, u, values)
        (J,) = _asked(steps_by, [(N, nx, n + len(names))], x, u, values)

        def step(dx: Any, row: Any) -> Any:
            slope, change = row
            after = slope @ jnp.concatenate([dx, change, dvalues])
            return after, after

        _, dx = jax.lax.scan(step, dx0, (J, du))
        return x, jnp.concatenate([dx0[None], dx])

    return _with_floats(states)


def _asked(
    function: Callable[..., Any], shapes: Sequence[tuple[int, ...]], *arrays: Any, vmap_method: str = "sequential"
) -> list[Any]:
    """Return what a function of arrays returns, some of these shapes, where JAX computes."""
    jax = extra("jax", of="jax", why="bridge.jax")
    jnp = extra("jax.numpy", of="jax", why="bridge.jax")
    kind = jnp.result_type(float)

    def call(*given: Any) -> list[Any]:
        found = function(*(np.asarray(each) for each in given))
        return [np.asarray(each, dtype=kind) for each in (found if isinstance(found, tuple) else (found,))]

    return list(
        jax.pure_callback(
            call,
            [jax.ShapeDtypeStruct(shape, kind) for shape in shapes],
            *(jnp.asarray(each, dtype=kind) for each in arrays),
            vmap_method=vmap_method,
        )
    )


def _with_floats(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function whose arguments are made arrays of JAX's floats."""
    jnp = extra("jax.numpy", of="jax", why="bridge.jax")
    return lambda *arrays: function(*(jnp.asarray(each, dtype=jnp.result_type(float)) for each in arrays))
