"""Problems with limits by fatrop, an interior point method whose linear algebra goes stage by stage: a peer.

Fatrop takes stages whose next state is given explicitly, and finds their structure by the identity in front of it. A
step of the midpoint rule is an equation, ``F(x, u, lam, x+) = 0``. So the next state is an input of its stage,
``x+ = v``, and the step a path constraint, as is what it is kept to besides. Bounds on the first state, which is held,
are left out; what a bound holds at one value is an equation. All is interpreted by CasADi.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.cases import Array
from benchmarks.multiple_shooting import MultipleShooting, Solution
from benchmarks.timing import BUDGET

__all__ = ["fatrop", "solve_by"]

_OPTIONS = {"print_level": 0, "tol": 1e-8, "max_iter": 1000}


def fatrop(peer: MultipleShooting, x: Array, u: Array) -> Solution:
    """Solve the problem of a peer whose first state is held, with its bounds, from a start (N+1, nx), (N, nu).

    Raises
    ------
    NotImplementedError
        The motion is to return: its ends are one condition of two stages.
    """
    if peer.returning:
        raise NotImplementedError("fatrop's stages do not know the first state at the last one")
    N, nx, nc = peer.N, peer.nx, peer.nc
    low, high = (peer.unpack(each) for each in (peer.lower, peer.upper))
    _, _, lam = peer.unpack(peer.pack(x, u))
    unknowns: list[Any] = []
    starts: list[Array] = []
    bounds: tuple[list[Array], list[Array]] = ([], [])
    equations: list[Any] = []
    ranges: list[tuple[Array, Array]] = []
    least, most = peer.kept_within
    value: Any = 0.0

    def unknown(name: str, start: Array, least: Array, most: Array) -> Any:
        unknowns.append(ca.MX.sym(name, len(start)))
        starts.append(start)
        held = least == most
        bounds[0].append(np.where(held, -np.inf, least))
        bounds[1].append(np.where(held, np.inf, most))
        return unknowns[-1]

    def held(of: Any, least: Array, most: Array) -> None:
        equations.extend(of[int(i)] - least[i] for i in np.flatnonzero(least == most))

    def note_equations() -> None:
        """Note that all rows since the last are equations."""
        rows = sum(each.numel() for each in equations) - sum(len(low) for low, _ in ranges)
        ranges.append((np.zeros(rows), np.zeros(rows)))

    free = np.full(nx, np.inf)
    state = unknown("x0", x[0], -free, free)
    for k in range(N):
        push = unknown(f"u{k}", u[k], low[1][k], high[1][k])
        force = unknown(f"lam{k}", lam[k], low[2][k], high[2][k]) if nc else ca.MX(0, 1)
        leads = unknown(f"v{k}", x[k + 1], -free, free)
        following = unknown(f"x{k + 1}", x[k + 1], low[0][k + 1], high[0][k + 1])
        equations.append(following - leads)
        if k == 0:
            equations.append(state - x[0])
        else:
            held(state, low[0][k], high[0][k])
        equations.append(peer.step(state, push, force, leads))
        if peer.paths:
            note_equations()
            equations.append(peer.kept(state, push, force, leads))
            ranges.append((least[k], most[k]))
        value += _stage(peer, k, state, push)
        state = following
    held(state, low[0][N], high[0][N])
    value += 0.5 * ca.bilin(ca.DM(_matrix(peer.cost.Q_final, N)), state - peer.cost.x_wanted[N])
    note_equations()
    g, (lowest, highest) = ca.vertcat(*equations), (np.concatenate(each) for each in zip(*ranges, strict=True))
    solver = ca.nlpsol(
        "peer",
        "fatrop",
        {"x": ca.vertcat(*unknowns), "f": value, "g": g},
        {
            "structure_detection": "auto",
            "equality": (lowest == highest).tolist(),
            "print_time": False,
            "fatrop": _OPTIONS,
        },
    )
    lower, upper = (np.concatenate(each) for each in bounds)
    began = time.process_time()
    found = solver(x0=np.concatenate(starts), lbx=lower, ubx=upper, lbg=lowest, ubg=highest)
    seconds = time.process_time() - began
    stats = solver.stats()
    parts = np.split(np.array(found["x"]).ravel(), np.cumsum([len(each) for each in starts])[:-1])
    count = 4 if nc else 3
    states, inputs = np.array([parts[0], *parts[count::count]]), np.array(parts[1::count])
    forces = np.array(parts[2::count]) if nc else np.empty((N, 0))
    status = "Solve_Succeeded" if stats["success"] else f"fatrop: {stats.get('return_status')}"
    return Solution(states, inputs, forces, float(found["f"]), status, int(stats.get("iter_count", -1)), seconds)


def _stage(peer: MultipleShooting, k: int, x: Any, u: Any) -> Any:
    cost = peer.cost
    of_state = ca.bilin(ca.DM(_matrix(cost.Q, k)), x - cost.x_wanted[k])
    return 0.5 * (of_state + ca.bilin(ca.DM(_matrix(cost.R, k)), u - cost.u_wanted[k]))


def _matrix(weight: Array, k: int) -> Array:
    """Return a weight of stage k as a matrix."""
    if weight.ndim == 3:
        weight = weight[k, :, 0] if weight.shape[2] == 1 else weight[k]
    return np.diag(weight) if weight.ndim == 1 else weight


def solve_by(
    peer: MultipleShooting, start: tuple[Array, Array], *, rounds: int, by_fatrop: bool, **options: Any
) -> Solution:
    """Return the fastest of so many solutions by Ipopt, and of as many as fit a `BUDGET`; or one by fatrop."""
    if by_fatrop:
        return fatrop(peer, *start)
    solver = peer.ipopt(**options)
    found: list[Solution] = []
    while len(found) < rounds or sum(each.seconds for each in found) < BUDGET:
        found.append(peer.solve(solver, *start))
    return min(found, key=lambda each: each.seconds)
