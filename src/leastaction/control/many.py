"""Many motions of one mechanism at once: roll-outs side by side on threads.

Each instance is a roll-out of its own in the core, which computes without Python's lock: its numbers are the same to
the last bit whatever runs beside it, in any order, on any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, unknown
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.prescribed import held
from leastaction.numerics.arrays import Array, as_array, as_count, as_times, read_only, require_instance
from leastaction.numerics.public import public

_BLOCKS = 4  # of instances to each thread, so that none waits long for another


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
    """

    t: Array
    x: Array
    u: Array
    lam: Array
    steps: np.ndarray[tuple[int], np.dtype[np.int64]]
    failures: Mapping[int, str]

    @property
    def complete(self) -> bool:
        """Whether none failed."""
        return not self.failures


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
        One that fails says so and stops nobody.

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
    for what, count in counts.items():
        if count not in (1, B):
            raise ArgumentError(f"{what}: got {count} instances, expected {B} or one for all")
    threads = as_count(threads, "threads", 0) or os.cpu_count() or 1
    starts = np.ascontiguousarray(np.broadcast_to(starts, (B, nx)))
    if given is None:
        resting = np.zeros((B, 1, nu))
        resting[:, 0, m.n_inputs :] = held(m, starts[:, m.first_rho : m.nq])
        given = np.broadcast_to(resting, (B, N, nu))
    u = np.ascontiguousarray(np.broadcast_to(given, (B, N, nu)))
    cores = _cores(integrator, values, B)
    x, lam = np.full((B, N + 1, nx), np.nan), np.full((B, N, m.nc), np.nan)
    steps, failures = np.zeros(B, dtype=np.int64), dict[int, str]()

    def run(block: Any) -> None:
        for i in block:
            out = cores[i].roll_out(times, starts[i], None, u[i], None)
            done = out.steps
            x[i, : done + 1], lam[i, :done], steps[i] = out.x[: done + 1], out.lam[:done], done
            if done < N:
                failures[i] = f"step {done} at t = {times[done]:.6g} s could not be solved: {out.status.name}"

    blocks = [block for block in np.array_split(np.arange(B), min(B, _BLOCKS * threads)) if len(block)]
    if threads == 1 or len(blocks) == 1:
        for block in blocks:
            run(block.tolist())
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, [block.tolist() for block in blocks]))
    told = dict(sorted(failures.items()))
    return ManyRuns(times, read_only(x), read_only(u), read_only(lam), steps, told)


def _numbers(known: Mapping[str, float], parameters: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Return the values (B,) or (1,) of parameters, checked."""
    found = {}
    for name, value in (parameters or {}).items():
        if name not in known:
            raise unknown("parameter", name, known, "parameters")
        found[name] = np.atleast_1d(as_array(value, f"parameters[{name!r}]", (), (None,), meaning="(B,)"))
    return found


def _cores(integrator: MidpointVI, values: Mapping[str, Array], B: int) -> list[Any]:
    """Return the core of the integrator for each instance: the same for those with the same parameters."""
    if not values:
        return [integrator.core] * B
    made: dict[tuple[float, ...], Any] = {}
    found = []
    for i in range(B):
        numbers = {name: float(each[i if len(each) > 1 else 0]) for name, each in values.items()}
        key = tuple(numbers.values())
        if key not in made:
            try:
                made[key] = integrator.like(integrator.mechanism.with_parameters(numbers)).core
            except LeastActionError as error:
                error.args = (f"parameters of instance {i}: {error}", *error.args[1:])
                raise
        found.append(made[key])
    return found
