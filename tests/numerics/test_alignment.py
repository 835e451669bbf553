"""Results do not depend on where in memory anything stands: bit for bit, in every variant of the core."""

from __future__ import annotations

from typing import Any

import pytest

from leastaction import _core
from numerics.preload import run

PROGRAM = """
import dataclasses
import hashlib

from leastaction.models import chain
from leastaction.optimal.discrete.linear_quadratic import (
    adjoint,
    solve_linear_quadratic,
    sweep_forward,
)


def at(offset, array):
    # A copy that stands so many numbers past a multiple of 64 bytes.
    room = np.empty(array.size + 16)
    first = -room.ctypes.data % 64 // 8 + offset
    room[first : first + array.size] = array.ravel()
    return room[first : first + array.size].reshape(array.shape)


def digest(*arrays):
    return hashlib.sha1(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def arrays_of(record):
    fields = record._fields if isinstance(record, tuple) else [f.name for f in dataclasses.fields(record)]
    return [a for a in (getattr(record, name) for name in fields) if isinstance(a, np.ndarray)]


def moved(name, mechanism, offset):
    integrator = MidpointVI(mechanism, threads=1)
    system = MidpointSystem(integrator, (1e-4 if name == "andrews" else 1e-3) * np.arange(4))
    start = started(name, integrator)
    rng = np.random.default_rng(1)
    x = at(offset, np.concatenate([start.q, start.p, np.zeros(mechanism.nrho)]))
    z, v = at(offset, rng.normal(size=system.nx)), at(offset, 0.1 * rng.normal(size=mechanism.nq))
    u = 0.01 * rng.normal(size=system.nu)
    u[system.nu - mechanism.nrho :] = start.q[mechanism.nd :]
    u, q = at(offset, u), at(offset, np.array(start.q))
    found = {}
    for k in range(system.N):
        found[f"derivatives of step {k}"] = digest(*system.derivatives(x, u, k))
        found[f"curvature of step {k}"] = digest(system.curvature(x, u, k, z))
        x = at(offset, system.f(x, u, k))
        found[f"step {k}"] = digest(x)
    dynamics = ContinuousDynamics(mechanism, threads=1)
    found["accelerations"] = digest(*arrays_of(dynamics.accelerations(q, v)))
    found["their derivatives"] = digest(*arrays_of(dynamics.linearize(q, v)))
    return found


def steered(nx, nu, offset):
    rng = np.random.default_rng(nx)
    N = 5

    def normal(*shape):
        return at(offset, rng.normal(size=shape))

    def weight(n):
        a = rng.normal(size=(N, n, n))
        return at(offset, a @ a.transpose(0, 2, 1) + np.eye(n))

    A, B, q, r, q_final = normal(N, nx, nx), normal(N, nx, nu), normal(N, nx), normal(N, nu), normal(nx)
    A *= rng.random(A.shape) < 0.4
    solution = solve_linear_quadratic(
        A, B, Q=weight(nx), R=weight(nu), S=0.01 * normal(N, nx, nu), H=0.01 * weight(nx + nu),
        q=q, r=r, c=normal(N, nx), Q_final=at(offset, weight(nx)[0]), q_final=q_final, keep_P=True,
    )  # fmt: skip
    return {
        "solution": digest(solution.K, solution.C, solution.P0, solution.b),
        "forward": digest(*sweep_forward(A, B, solution, normal(nx))),
        "adjoint": digest(adjoint(A, B, at(offset, solution.K), q, r, q_final)),
    }


def everything(remainder, offset):
    memory.place_blocks_at(remainder)
    found = {}
    builds = MODELS | {f"chain{n}": lambda n=n: chain.pendulum_chain(n) for n in (1, 2, 3, 4, 5, 6, 7, 13)}
    for name, build in builds.items():
        found |= {f"{name}: {what}": bits for what, bits in moved(name, build(), offset).items()}
    for nx, nu in ((2, 1), (3, 2), (5, 3), (7, 4), (12, 5), (17, 6), (40, 18)):
        found |= {f"{nx} states, {nu} inputs: {k}": d for k, d in steered(nx, nu, offset).items()}
    return found


at_once = everything(0, 0)
differ = set()
for remainder, offset in ((16, 1), (32, 2), (48, 3), (0, 5), (64, 0)):
    again = everything(remainder, offset)
    differ |= {name for name in at_once if again[name] != at_once[name]}
print(json.dumps({"results": len(at_once), "differ": sorted(differ)}))
"""


@pytest.mark.parametrize("variant", _core.available_variants())
def test_addresses_do_not_show(variant: str) -> None:
    found: dict[str, Any] = run(PROGRAM, variant=variant)
    assert found["results"] > 150
    assert found["differ"] == []
