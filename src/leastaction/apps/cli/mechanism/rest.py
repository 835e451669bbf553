"""A mechanism at rest: the inputs that hold it, its linear equations about it, and the regulator that keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from leastaction.errors import ArgumentError, some
from leastaction.mechanics import ContinuousDynamics, Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen

_AT_REST = 1e-6  # acceleration that is left, by the largest that inputs have to balance
_SHOWN = 1e-9  # part of the largest gain under which a gain is shown as none
_NUMBER = 10  # characters of a gain
_REACHED = 1e-9  # singular value under which a mode counts as out of reach, by the size of [A - s I, B]


@dataclass(frozen=True)
class LinearRest(Frozen):
    """The linear equations of a mechanism about a configuration at rest, on the freedoms that constraints leave.

    ``basis`` (nd, nf): directions of the freedoms. ``A`` (2 nf, 2 nf), ``B`` (2 nf, n_inputs): of ``d/dt [y; w] = A [y;
    w] + B du`` with ``dq = basis y``, ``dv = basis w``. ``u`` (n_inputs,): the inputs that hold it.
    """

    mechanism: Mechanism = field(repr=False)
    q: Array
    u: Array
    basis: Array
    A: Array
    B: Array

    def out_of_reach(self) -> list[tuple[complex, list[str]]]:
        """Return each mode that no input reaches and that does not die away: its eigenvalue, and what moves most."""
        values, vectors = np.linalg.eig(self.A)
        found = []
        half, size = self.basis.shape[1], np.linalg.norm(self.A) + np.linalg.norm(self.B) + 1e-300
        for value, vector in zip(values, vectors.T, strict=True):
            pencil = np.hstack([self.A - value * np.eye(len(self.A)), self.B])
            if value.real > -1e-9 * size and np.linalg.svd(pencil, compute_uv=False)[-1] < _REACHED * size:
                motion = np.abs(self.basis @ vector[:half]) + np.abs(self.basis @ vector[half:])
                names = [self.mechanism.dynamic[i] for i in np.argsort(-motion) if motion[i] > 0.3 * motion.max()]
                found.append((complex(value), names))
        return found


def linear_rest(mechanism: Mechanism, q: Array) -> LinearRest:
    """Return the linear equations about a configuration, with the inputs of least norm that hold it there.

    Raises `ArgumentError`: if no inputs hold it, or there are none.
    """
    m = mechanism
    if not m.n_inputs:
        raise ArgumentError("the mechanism has no inputs, so nothing can regulate it; add motors (JointForce)")
    dynamics, still = ContinuousDynamics(m), np.zeros(m.nv)
    alone = dynamics.accelerations(q, still).a
    by_inputs = dynamics.linearize(q, still).a_du
    u, *_ = np.linalg.lstsq(by_inputs, -alone, rcond=1e-12)
    left = dynamics.accelerations(q, still, u).a
    off = float(np.abs(left).max(initial=0.0))
    if off > _AT_REST * max(1.0, float(np.abs(alone).max(initial=0.0))):
        worst = [m.dynamic[i] for i in np.argsort(-np.abs(left))[:3] if abs(left[i]) > 0.1 * off]
        raise ArgumentError(
            f"no inputs hold the mechanism at rest there: {some(worst)} would accelerate by {off:.3g} (rad/s² or "
            "m/s²). Give a configuration in which it can rest (--set pole=180deg); `leastaction check` finds one"
        )
    d = dynamics.linearize(q, still, u)
    jacobian = m.constraint_jacobian(q)[:, : m.nd]
    basis = _null_space(jacobian)
    n, nd = basis.shape[1], m.nd
    A = np.block([[np.zeros((n, n)), np.eye(n)], [basis.T @ d.a_dq[:, :nd] @ basis, basis.T @ d.a_dv[:, :nd] @ basis]])
    B = np.vstack([np.zeros((n, m.n_inputs)), basis.T @ d.a_du])
    return LinearRest(m, np.asarray(q), np.asarray(u, dtype=float), basis, A, B)


def _null_space(jacobian: Array) -> Array:
    """Return an orthonormal basis of what the rows leave free; the identity where there are none."""
    nd = jacobian.shape[1]
    if not len(jacobian):
        return np.eye(nd)
    _, sizes, rows = np.linalg.svd(jacobian)
    rank = int(np.sum(sizes > 1e-10 * max(sizes[0], 1e-300)))
    return np.ascontiguousarray(rows[rank:].T)


@dataclass(frozen=True)
class RestRegulator(Frozen):
    """Gains that hold a mechanism at rest: ``u = u_rest - K [q - q_rest; v]``, ``K`` (n_inputs, 2 nd).

    ``eigenvalues`` (2 nf,): of the closed loop (1/s), or of a step where inputs are held over ``dt``.
    """

    K: Array
    eigenvalues: NDArray[np.complex128]
    dt: float | None


def regulator(rest: LinearRest, weights: Array, effort: Array, dt: float | None) -> RestRegulator:
    """Return the linear-quadratic regulator over an endless horizon.

    ``weights`` (2 nd,): of the squares of [dq; dv]. ``effort`` (n_inputs,): of those of du. ``dt``: inputs are held
    over steps so long (s); None for continuous time.

    Raises `ArgumentError`: if there is none; the message names what no input reaches.
    """
    from scipy.linalg import LinAlgError, solve_continuous_are, solve_discrete_are
    from scipy.signal import cont2discrete

    if weights.min(initial=0.0) < 0.0 or effort.min(initial=1.0) <= 0.0:
        raise ArgumentError(
            "weights are at least zero, and efforts above zero: what costs less than nothing has no best"
        )
    lost = rest.out_of_reach()
    if lost:
        modes = "; ".join(f"{some(names)} ({value:.3g} 1/s)" for value, names in lost)
        raise ArgumentError(f"no input reaches these motions, which do not die away by themselves: {modes}")
    n = rest.basis.shape[1]
    lift = np.kron(np.eye(2), rest.basis)
    Q, R = lift.T @ (weights[:, None] * lift), np.diag(effort)
    A, B = rest.A, rest.B
    try:
        if dt is None:
            P = solve_continuous_are(A, B, Q, R)
            K = np.linalg.solve(R, B.T @ P)
        else:
            A, B, *_ = cont2discrete((A, B, np.eye(2 * n), np.zeros_like(B)), dt)
            # The costs of a step are dt times these, of states and of inputs, which is no matter to the gains.
            P = solve_discrete_are(A, B, Q, R)
            K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    except (LinAlgError, ValueError) as error:
        raise ArgumentError(
            f"there is no steady regulator with these weights ({str(error).rstrip('.')}): every motion that does not "
            "die away needs a weight above zero (--weight), and so does every input (--effort)"
        ) from error
    return RestRegulator(K @ lift.T, np.linalg.eigvals(A - B @ K).astype(complex), dt)


def gain_table(K: Array, u: Array, inputs: Sequence[str], states: Sequence[str], width: int = 80) -> Table:
    """Return gains K (n_inputs, nx) and inputs at rest u (n_inputs,) as a table.

    Where a column for each input is wider than ``width`` characters, there is a row for each, with its largest gains.
    """
    least = _SHOWN * float(np.abs(K).max(initial=0.0))
    if max(map(len, states), default=0) + sum(max(len(name), _NUMBER) + 2 for name in inputs) > width:
        table = Table("input", "at rest", "gains", box=None, pad_edge=False)
        for name, gains, held in zip(inputs, K, u, strict=True):
            order = np.argsort(-np.abs(gains))[:4]
            most = ", ".join(f"{states[i]} {gains[i]:.4g}" for i in order if abs(gains[i]) > least)
            table.add_row(name, f"{held:.4g}" if abs(held) > 1e-9 else "0", most)
        table.caption = "the four largest gains of each input; --json prints all"
        return table
    table = Table("gain", *inputs, box=None, pad_edge=False)
    for name, column in zip(states, K.T, strict=True):
        table.add_row(name, *(f"{value:.5g}" if abs(value) > least else "-" for value in column))
    table.add_section()
    table.add_row("at rest", *(f"{value:.5g}" if abs(value) > 1e-9 else "0" for value in u))
    return table
