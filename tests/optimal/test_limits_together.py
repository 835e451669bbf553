"""Limits that are taken at once, held to each of them alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from leastaction.mechanics import Distance, Gravity, JointForce, Mechanism, MidpointVI, rx, ry, tx, tz
from leastaction.optimal import Bound, Equal, FunctionQuantity, Limit, Parameter, QuadraticCost, Within
from leastaction.optimal.collocation.limits import stated
from leastaction.optimal.collocation.mesh import RadauMesh
from leastaction.optimal.limits.rows import Rows, Weights
from leastaction.optimal.limits.sides import SideLayout
from leastaction.optimal.limits.together import together
from leastaction.optimal.unknowns.extension import Extension
from leastaction.systems import Ball, Box, HalfSpace, Keep, MechanismSystem, MidpointSystem

N = 4


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    """A chain of two links on a carriage, and a weight on two strings, one of which is reeled."""
    tree = [
        tx("x", mass=1.0),
        [rx("a"), [tz(-1.0, name="elbow", mass=1.0), [ry("b"), [tz(-0.7, name="hand", mass=0.5)]]]],
        tx("y"), [tz("z"), [tz(0.0, name="A", mass=1.0)]], tx("u"), [tz("w"), [tz(0.0, name="B", mass=1.0)]],
    ]  # fmt: skip
    strings = [Distance("A", "world", "L", name="long"), Distance("B", "world", 1.3, name="short")]
    return Mechanism(tree, [Gravity(), JointForce("x", input="push"), *strings])


def _moving(t: float) -> list[float]:
    return [0.1 * t, 0.2, -0.3]


PLACES = [
    Keep("hand", outside=Ball((0.1, 0.2, -0.3), 0.4)),
    Keep("elbow", outside=Ball((0.5, 0.2, -0.3), 0.3)),
    Keep("hand", inside=Ball(_moving, 4.0)),
    Keep("hand", inside=Ball((0.0, 0.0, 0.0), 2.0), point=(0.1, 0.0, 0.2)),
]
OTHERS = [
    *PLACES, Keep("hand", outside=Ball((0.0, 0.0, 0.0), 0.2), origin="elbow"),
    Keep("elbow", inside=Box((-1.0, -1.0, -np.inf), (1.0, 2.0, 3.0))),
    Keep("hand", inside=HalfSpace((0.0, 1.0, 1.0), -3.0)),
]  # fmt: skip
OWN = FunctionQuantity(["p", "q"], lambda x: np.stack([np.sin(x[:, 0]) * x[:, 1], x[:, 2] ** 2], axis=1))
LIMITS: dict[str, tuple[list[Limit], int]] = {
    "balls": (list(PLACES), 1),
    "places": (list(OTHERS), 1),
    "some instants": ([*PLACES[:2], Keep("hand", outside=Ball((1.0, 1.0, 1.0), 0.4), at="end")], 2),
    "tensions": ([Bound("long", 1.0, 5.0, of="tension"), Bound("short", 2.0, of="tension")], 1),
    "rates": ([Bound("x", -1.0, 2.0, of="rate"), Bound(["a", "x"], max=3.0, of="rate")], 1),
    "accelerations": ([Bound("L", -1.0, 2.0, of="acceleration"), Bound("L", max=9.0, of="acceleration")], 1),
    "own": ([Within(OWN, -1.0, 2.0), Within(FunctionQuantity("r", lambda x: x[:, 0] * x[:, 2])), Equal(OWN, at=3)], 2),
}


def _hold(rows: Sequence[Rows], found: int, x: np.ndarray, u: np.ndarray, rng: np.random.Generator) -> None:
    """Hold what is taken together to its parts, with values, gradients, changes and second derivatives."""
    nx, nu = x.shape[1], u.shape[1]
    layout = SideLayout([row.bounds.shape for row in rows])
    groups = together(rows, range(len(rows)), layout, nx, nu)
    assert len(groups) == found
    y, sigma, c, dc = (layout.filled([rng.uniform(0.5, 1.0, shape) for shape in layout.shapes]) for _ in range(4))
    dynamics, dx, du = rng.normal(size=(len(u), nx, nx + nu)), rng.normal(size=x.shape), rng.normal(size=u.shape)
    columns = np.unique(np.concatenate([row.weighs(nx, nu) for row in rows]))
    sums = []
    for parts in ([(row, y[i], sigma[i]) for i, row in enumerate(rows)],
                  [(group.rows, group.of(y), group.of(sigma)) for group in groups]):  # fmt: skip
        q, r, weights = np.zeros_like(x), np.zeros_like(u), Weights(len(u), columns)
        for row, duals, stiff in parts:
            jacobian = row.jacobian(x, u)
            row.add_gradient(jacobian, duals, q, r)
            row.add_hessian(x, u, jacobian, duals, stiff, weights, dynamics)
        sums.append((q, r, weights.matrices))
    for apart, at_once in zip(*sums, strict=True):
        np.testing.assert_allclose(at_once, apart, atol=1e-10 * (1.0 + np.abs(apart).max()))
    for group in groups:
        c.flat[group.at] = group.rows.values(x, u)
        dc.flat[group.at] = group.rows.along(group.rows.jacobian(x, u), dx, du)
    for i, row in enumerate(rows):
        np.testing.assert_allclose(c[i], row.values(x, u), atol=1e-12)
        np.testing.assert_allclose(dc[i], row.along(row.jacobian(x, u), dx, du), atol=1e-11)


@pytest.mark.parametrize("name", LIMITS)
def test_limits_taken_together_are_those_of_each(name: str, mechanism: Mechanism, rng: np.random.Generator) -> None:
    limits, found = LIMITS[name]
    system = MidpointSystem(MidpointVI(mechanism, threads=1), [0.0, 0.1, 0.3, 0.35, 0.5], multipliers=True)
    x, u = rng.normal(size=(N + 1, system.nx)), rng.normal(size=(N, system.nu))
    _hold([row for limit in limits for row in limit.rows(system, 1)], found, x, u, rng)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("name", ["balls", "places", "tensions"])
def test_limits_taken_together_with_unknowns(
    name: str, free: bool, mechanism: Mechanism, rng: np.random.Generator
) -> None:
    system = MidpointSystem(MidpointVI(mechanism, threads=1), [0.0, 0.1, 0.3, 0.35, 0.5], multipliers=True)
    cost = QuadraticCost(np.zeros((N + 1, system.nx)), np.zeros((N, system.nu)), Q=np.ones(system.nx), R=[1.0, 1.0])
    unknowns = [] if free else [Parameter("elbow.mass")]
    extension = Extension(system, cost, unknowns, LIMITS[name][0], free_start=free)
    x, u = rng.normal(size=(N + 1, extension.system.nx)), rng.normal(size=(N, system.nu))
    x[:, extension.system.n_own :] = 0.7
    _hold([row for row in extension.rows() if row.is_asked], 1, x, u, rng)


SOLVED = [Bound("x", -1.0, 2.0, of="acceleration"), Bound(["a", "x"], max=9.0, of="acceleration")]


@pytest.mark.parametrize("limits", [PLACES, LIMITS["tensions"][0], SOLVED], ids=["balls", "tensions", "accelerations"])
def test_limits_taken_together_in_continuous_time(
    limits: list[Limit], mechanism: Mechanism, rng: np.random.Generator
) -> None:
    system, mesh = MechanismSystem(mechanism), RadauMesh(np.array([0.0, 0.3, 0.4]))
    sides = stated(limits, system, mesh, 1)
    rows = [rows for side in sides for rows in side.rows]
    nz = 3 * (system.nx + system.nu)
    x, u = rng.normal(scale=0.3, size=(3, nz)), rng.normal(size=(2, 3 * system.nu))
    _hold(rows, 3, x, u, rng)  # points of a piece
