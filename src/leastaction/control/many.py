"""Many motions of one mechanism at once: roll-outs side by side in registers, and blocks of them on threads.

The core computes without Python's lock, as many instances by one instruction as a register holds. The numbers of each
are the same to the last bit whatever runs beside it, in any order, on any number of threads. They agree with those of
`simulate` to rounding: that goes through the same steps with its own Newton matrices.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.bands import LoopBands
from leastaction.control.closed_loop import units_of
from leastaction.errors import ArgumentError, LeastActionError, unknown
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.prescribed import held
from leastaction.numerics.arrays import Array, as_array, as_count, as_times, read_only, require_instance
from leastaction.numerics.public import public
from leastaction.systems.midpoint import MidpointSystem

_BLOCK = 32
"""Instances of a thread between two looks for Ctrl-C, at least: four registers of the widest."""

_PATIENCE = 0.3
"""Time (s) after which Ctrl-C is looked for: what a person does not notice."""


@public
@dataclass(frozen=True, eq=False)
class ManyRuns:
    """Many motions of one mechanism.

    Attributes
    ----------
    t : ndarray (N+1,)
        Times (s).
    x : ndarray (B, N+1, nx)
        States ``[q; rho; p; v_rho]``; NaN from the step on that failed.
    u : ndarray (B, N, nu)
        Inputs and prescribed variables.
    lam : ndarray (B, N, nc)
        Multipliers.
    steps : ndarray of int (B,)
        How many steps each made: N, of those that did not fail.
    failures : mapping of int to str
        Which instances failed, and why.
    integrator : MidpointVI
    interrupted : bool
        Whether Ctrl-C ended it; those that were not made by then are among the failures.
    """

    t: Array
    x: Array
    u: Array
    lam: Array
    steps: np.ndarray[tuple[int], np.dtype[np.int64]]
    failures: Mapping[int, str]
    integrator: MidpointVI
    interrupted: bool = False

    @property
    def complete(self) -> bool:
        """Whether none failed."""
        return not self.failures

    def __str__(self) -> str:
        """Say how many there are, where they end, and which of them failed."""
        return str(self.bands())

    def bands(self) -> LoopBands:
        """Return them by name, with quantiles over all at every instant and pictures of these: what chance may do."""
        system = MidpointSystem(self.integrator, self.t)
        named = system.state_names, system.input_names, units_of(system)
        return LoopBands(self.t, self.x, self.u, tuple(self.failures.items()), *named)


@public
def simulate_many(
    integrator: MidpointVI,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None = None,
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    threads: int = 0,
) -> ManyRuns:
    """Simulate many motions at once.

    Those with the same parameters stand side by side in a register, eight of them where the processor has AVX-512; for
    mechanisms whose steps are sparse (long chains, many loops) or turn by quaternions, one after the other.

    Parameters
    ----------
    integrator : MidpointVI
    x0 : array_like (B, nx) or (nx,)
        Where each begins, ``[q; rho; p; v_rho]``; one for all of them.
    t : array_like (N+1,)
        Times (s), of all.
    inputs : array_like (B, N, nu), (N, nu) or (nu,), optional
        Inputs and prescribed variables ``[inputs; rho_next]`` of each, of all, or constant. If left out inputs are
        zero, and prescribed variables stay where they begin.
    parameters : mapping of str to array_like (B,) or float, optional
        Parameters of the mechanism by name, such as ``{"bob.mass": masses}``.
    threads : int, optional
        0: as many as there are cores. The result does not depend on it.

    Returns
    -------
    ManyRuns
        One that fails says so and stops nobody. Ctrl-C keeps those that are made.

    Raises
    ------
    ArgumentError
        Wrong shapes, numbers of instances that differ, or unknown parameters.
    DescriptionError
        A mass or a coefficient that cannot be.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import MidpointVI
    >>> from leastaction.control import simulate_many
    >>> from leastaction.models.cart_pendulum import cart_pendulum
    >>> starts = np.zeros((100, 4))
    >>> starts[:, 1] = np.linspace(0.1, 3.0, 100)
    >>> runs = simulate_many(MidpointVI(cart_pendulum()), starts, np.linspace(0.0, 1.0, 101))
    >>> runs.x.shape, runs.complete
    ((100, 101, 4), True)
    """
    require_instance(integrator, "integrator", MidpointVI, "MidpointVI(mechanism) makes one")
    m, times = integrator.mechanism, as_times(t)
    N, nx, nu = len(times) - 1, m.nx, m.n_inputs + m.nrho
    starts = as_array(x0, "x0", (nx,), (None, nx), meaning="(B, nx), or (nx,) for all")
    values = _numbers(m.parameters, parameters)
    given = None
    if inputs is not None:
        shapes = (nu,), (N, nu), (None, N, nu)
        given = as_array(inputs, "inputs", *shapes, meaning="(B, N, nu), (N, nu) for all, or a constant (nu,)")
    counts = {
        "x0": len(starts) if starts.ndim == 2 else 1,
        "inputs": len(given) if given is not None and given.ndim == 3 else 1,
        **{f"parameters[{name!r}]": len(each) for name, each in values.items()},
    }
    B = max(counts.values())
    if not all(counts.values()):
        raise ArgumentError(f"{min(counts, key=lambda what: counts[what])}: got no instance, expected one at least")
    for what, count in counts.items():
        if count not in (1, B):
            of = next(other for other, number in counts.items() if number == B)
            raise ArgumentError(f"{what}: got {count} instances, expected one for all, or {B} as of {of}")
    threads = as_count(threads, "threads", 0) or os.cpu_count() or 1
    starts = np.ascontiguousarray(np.broadcast_to(starts, (B, nx)))
    if given is None:
        resting = np.zeros((B, 1, nu))
        resting[:, 0, m.n_inputs :] = held(m, starts[:, m.first_rho : m.nq])
        given = np.broadcast_to(resting, (B, N, nu))
    u = np.ascontiguousarray(np.broadcast_to(given, (B, N, nu)))
    groups = _groups(integrator, values, B)
    x, lam = np.empty((B, N + 1, nx)), np.empty((B, N, m.nc))
    steps, status = np.zeros(B, dtype=np.int64), np.full(B, None)

    def run(core: Any, members: slice | list[int], threads: int) -> None:
        found = core.roll_out_many(times, starts[members], u[members], threads)
        x[members], lam[members], steps[members] = found.x, found.lam, found.steps
        status[members] = found.status

    interrupted = _in_blocks(run, groups, threads)
    if interrupted:
        left = np.array([each is None for each in status])
        if left.all():
            raise KeyboardInterrupt
        x[left], lam[left], steps[left] = np.nan, np.nan, 0
    failures = {
        i: f"step {done} at t = {times[done]:.6g} s could not be solved: {said.name}"
        if said is not None
        else "not made: interrupted"
        for i, (done, said) in enumerate(zip(steps.tolist(), status, strict=True))
        if done < N or said is None
    }
    return ManyRuns(times, read_only(x), read_only(u), read_only(lam), steps, failures, integrator, interrupted)


def _in_blocks(
    run: Callable[[Any, slice | list[int], int], None], groups: list[tuple[Any, list[int]]], threads: int
) -> bool:
    """Run the instances of all groups, block by block on as many threads; return whether Ctrl-C ended it between two.

    Instances of one group go in blocks that take as long as one is willing to wait; groups are what else there is.
    """
    if len(groups) > 1:
        with ThreadPoolExecutor(threads) as pool:
            try:
                list(pool.map(lambda group: run(group[0], group[1], 1), groups))
            except KeyboardInterrupt:
                pool.shutdown(cancel_futures=True)
                return True
        return False
    ((core, members),) = groups
    first, size = 0, _BLOCK * threads
    try:
        while first < len(members):
            began = perf_counter()
            run(core, slice(first, first + size), threads)
            first += size
            size = max(_BLOCK * threads, int(size * min(8.0, _PATIENCE / max(perf_counter() - began, 1e-6))))
    except KeyboardInterrupt:
        return True
    return False


@public
def linearize_many(
    integrator: MidpointVI, t: ArrayLike, x: ArrayLike, u: ArrayLike, *, threads: int = 0
) -> tuple[Array, Array]:
    """Return the derivatives of all steps of many motions, side by side as `simulate_many` computes them.

    Parameters
    ----------
    integrator : MidpointVI
    t : array_like (N+1,)
        Times (s), of all.
    x, u : array_like (B, N+1, nx), (B, N, nu)
        Motions, such as those of a `ManyRuns` none of which failed.
    threads : int, optional
        0: as many as there are cores. The result does not depend on it.

    Returns
    -------
    A, B : ndarray (B, N, ndx, ndx), (B, N, ndx, nu)
        Next states by states and by inputs, of each to the last bit what they are alone.

    Raises
    ------
    ArgumentError
        Wrong shapes, numbers that are not finite, or what is no motion of the mechanism.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import MidpointVI
    >>> from leastaction.control import linearize_many, simulate_many
    >>> from leastaction.models.cart_pendulum import cart_pendulum
    >>> vi, t = MidpointVI(cart_pendulum()), np.linspace(0.0, 1.0, 101)
    >>> runs = simulate_many(vi, np.zeros((10, 4)), t)
    >>> A, B = linearize_many(vi, t, runs.x, runs.u)
    >>> A.shape, B.shape
    ((10, 100, 4, 4), (10, 100, 4, 1))
    """
    require_instance(integrator, "integrator", MidpointVI, "MidpointVI(mechanism) makes one")
    m, times = integrator.mechanism, as_times(t)
    N = len(times) - 1
    states = np.ascontiguousarray(as_array(x, "x", (None, N + 1, m.nx), meaning="(B, N+1, nx)"))
    inputs = as_array(u, "u", (len(states), N, m.n_inputs + m.nrho), meaning="(B, N, nu)")
    count = as_count(threads, "threads", 0) or os.cpu_count() or 1
    A, B, done = integrator.core.linearize_many(times, states, np.ascontiguousarray(inputs), count)
    if done < len(states) * N:
        raise _no_step(*divmod(done, N))
    return A, B


def _no_step(instance: int, k: int) -> ArgumentError:
    return ArgumentError(
        f"x: step {k} of instance {instance} is none of the mechanism; give motions of `simulate_many`"
    )


def _numbers(known: Mapping[str, float], parameters: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Return the values (B,) or (1,) of parameters, checked."""
    found = {}
    for name, value in (parameters or {}).items():
        if name not in known:
            raise unknown("parameter", name, known, "parameters")
        found[name] = np.atleast_1d(as_array(value, f"parameters[{name!r}]", (), (None,), meaning="(B,)"))
    return found


def _groups(integrator: MidpointVI, values: Mapping[str, Array], B: int) -> list[tuple[Any, list[int]]]:
    """Return cores of the integrator, and which instances have their parameters."""
    if not values:
        return [(integrator.core, list(range(B)))]
    made: dict[tuple[float, ...], tuple[Any, list[int]]] = {}
    for i in range(B):
        numbers = {name: float(each[i if len(each) > 1 else 0]) for name, each in values.items()}
        key = tuple(numbers.values())
        if key not in made:
            try:
                made[key] = integrator.like(integrator.mechanism.with_parameters(numbers)).core, []
            except LeastActionError as error:
                error.args = (f"parameters of instance {i}: {error}", *error.args[1:])
                raise
        made[key][1].append(i)
    return list(made.values())
