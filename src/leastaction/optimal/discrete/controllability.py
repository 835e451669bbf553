"""What inputs can steer, along a trajectory: the controllability test of the linearised system (dissertation 3.3).

Over the steps of a window the inputs change the state at its end by ``dx = C du``, C = [A..AB ... AB B]. What is in
the range of C can be steered, for small changes, and so stabilised by a feedback there. The Gramian is ``C C^T``; the
test is on C itself, whose singular values it only squares, and on the directions in which the state may change at all:
the tangent space of the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_count, as_number
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.system import check_system

# Reach of an entry, as a fraction of the largest, below which it is rounding.
_NO_REACH = 1e-12
# Part of an entry in the directions that cannot be steered, below which it is not named.
_PART = 1e-3


@public
@dataclass(frozen=True)
class ControllabilityWindow(Frozen):
    """What inputs can steer over the steps of a window. Frozen, arrays included: threads may share it.

    Attributes
    ----------
    start, stop : int
        Its instants: the inputs of the steps ``start .. stop-1`` change the state at ``stop``.
    gramian : ndarray, shape (nx, nx)
        ``W = C C^T`` in the state's own units: a change ``dx`` in its range takes ``du . du = dx . W^+ dx`` at least.
    sizes : ndarray, shape (n,)
        Singular values of C with all states brought to one size, on the n directions in which the state may change;
        the largest first.
    rank : int
        How many of them are not zero.
    directions : ndarray, shape (nx, n - rank)
        Of unit length: the combinations ``d . dx`` of the scaled state that no input changes.
    unsteered : tuple of str
        Names of the entries of the state that take part in these, those with the largest part first.
    """

    start: int
    stop: int
    gramian: Array = field(repr=False)
    sizes: Array = field(repr=False)
    rank: int
    directions: Array = field(repr=False)
    unsteered: tuple[str, ...]

    @property
    def controllable(self) -> bool:
        """Whether the inputs steer every direction in which the state may change."""
        return self.rank == len(self.sizes)

    @property
    def smallest(self) -> float:
        """The smallest singular value: how close the window is to one that is not controllable."""
        return float(self.sizes[-1]) if len(self.sizes) else float("inf")

    def __str__(self) -> str:
        """Return what the window says in a line."""
        text = f"steps {self.start} to {self.stop}: rank {self.rank} of {len(self.sizes)}, smallest {self.smallest:.3g}"
        return text if self.controllable else f"{text}; cannot be steered: {', '.join(self.unsteered)}"


@public
@dataclass(frozen=True)
class Controllability:
    """What inputs can steer along a trajectory, window by window.

    Attributes
    ----------
    windows : tuple of ControllabilityWindow
    """

    windows: tuple[ControllabilityWindow, ...]

    @property
    def controllable(self) -> bool:
        """Whether every window is."""
        return all(window.controllable for window in self.windows)

    @property
    def worst(self) -> ControllabilityWindow:
        """The window with the smallest singular value."""
        return min(self.windows, key=lambda window: window.smallest)

    def __str__(self) -> str:
        """Return a line for each window."""
        return "\n".join(map(str, self.windows))


@public
def controllability(
    system: DiscreteSystem,
    x: Array,
    u: Array,
    *,
    window: int | None = None,
    scale: Array | None = None,
    tolerance: float = 1e-9,
) -> Controllability:
    """Test along a trajectory what the inputs can steer, and name what they cannot.

    Parameters
    ----------
    system : DiscreteSystem
        Such as a `MidpointSystem`, with its inputs: forces, and prescribed variables.
    x, u : array_like, shapes (N+1, nx) and (N, nu)
        A trajectory of it. A configuration is tested by one that stays there.
    window : int, optional
        Steps of each window; windows follow each other, and what is left over at the end is not tested. All N steps
        if not given. A window of fewer steps than ``nx / nu`` is never controllable, and over a short time the reach
        of what is moved through others is small.
    scale : array_like, shape (nx,), optional
        The size of each entry of the state that counts as large, to make the singular values comparable. Each entry's
        own reach in the window if not given, so that they do not depend on units.
    tolerance : float, optional
        Singular values below this fraction of the largest count as zero.

    Returns
    -------
    Controllability

    Raises
    ------
    ArgumentError
        For a system in continuous time, wrong shapes, values that are not finite, or numbers out of range.

    Notes
    -----
    Where a mechanism has constraints, only directions that keep them count. Multipliers in the state are left
    out: they follow the rest.
    """
    check_system(system, (DiscreteSystem,), ("nx", "nu", "N"))
    states = as_array(x, "x", (system.N + 1, system.nx), meaning="(N+1, nx)")
    inputs = as_array(u, "u", (system.N, system.nu), meaning="(N, nu)")
    steps = system.N if window is None else as_count(window, "window", 1)
    if steps > system.N:
        raise ArgumentError(f"window: got {steps} steps, expected at most the {system.N} of the trajectory")
    if scale is not None:
        scale = as_array(scale, "scale", (system.nx,))
        if not (scale > 0.0).all():
            raise ArgumentError(f"scale: got {scale.min():g}, expected positive sizes")
    fraction = as_number(tolerance, "tolerance", above=0.0, below=1.0)
    A, B = system.linearize(states, inputs)
    return Controllability(
        tuple(
            _look(system, states, A, B, start, start + steps, scale, fraction)
            for start in range(0, system.N - steps + 1, steps)
        )
    )


def _look(
    system: DiscreteSystem, x: Array, A: Array, B: Array, start: int, stop: int, scale: Array | None, tolerance: float
) -> ControllabilityWindow:
    C = _reach(A[start:stop], B[start:stop])
    size = scale
    if size is None:
        reach = np.linalg.norm(C, axis=1)
        # Rounding must not be taken for the reach of an entry that nothing moves.
        reached = reach > _NO_REACH * reach.max(initial=0.0)
        size, C = np.where(reached, reach, 1.0), np.where(reached[:, None], C, 0.0)
    # The directions in which the state may change, an orthonormal basis of them in the scaled state.
    allowed = np.linalg.qr(system.start_directions(x[stop], None) / size[:, None])[0]
    left, sizes, _ = np.linalg.svd(allowed.T @ (C / size[:, None]))
    n = allowed.shape[1]
    sizes = np.concatenate([sizes, np.zeros(n - len(sizes))])
    rank = int(np.sum(sizes > tolerance * sizes.max(initial=0.0)))
    directions = allowed @ left[:, rank:]
    parts = np.linalg.norm(directions, axis=1)
    names = system.quantity("state").names
    order = [int(i) for i in np.argsort(-parts, kind="stable") if parts[i] > _PART]
    return ControllabilityWindow(start, stop, C @ C.T, sizes, rank, directions, tuple(names[i] for i in order))


def _reach(A: Array, B: Array) -> Array:
    """Return a matrix with the range and the Gramian of [A..AB ... AB B], of nx columns at most."""
    nx = A.shape[1]
    after, blocks = np.eye(nx), np.zeros((nx, 0))
    for A_k, B_k in zip(A[::-1], B[::-1], strict=True):
        blocks = np.hstack([blocks, after @ B_k])
        if blocks.shape[1] > 8 * nx:
            blocks = np.linalg.qr(blocks.T)[1].T
        after = after @ A_k
    return blocks if blocks.shape[1] <= nx else np.linalg.qr(blocks.T)[1].T
