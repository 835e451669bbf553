"""One meaning, three ways to say it: native elements, expressions and Python classes agree to rounding."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

pytest.importorskip("jax")

from derivatives.elements.cases import Plant
from leastaction.mechanics import (
    Distance,
    Element,
    ExpressionConstraint,
    ExpressionPotential,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PythonConstraint,
    PythonFunction,
    PythonPotential,
    State,
)
from leastaction.mechanics.expressions.terms import distance, parameter

SEEDS = (0, 1, 2)
STIFFNESS, LENGTH, DT = 12.0, 0.4, 0.01
WAYS = ("native", "expression", "python")


class Stretch(PythonFunction):
    """f = k/2 (|p1 - p2| - L)^2."""

    def value(self, z: np.ndarray) -> Any:
        return 0.5 * STIFFNESS * (self._length(z) - LENGTH) ** 2

    def gradient(self, z: np.ndarray) -> np.ndarray:
        slope = STIFFNESS * (1.0 - LENGTH / self._length(z)) * (z[:3] - z[3:])
        return np.concatenate([slope, -slope])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        d, length = z[:3] - z[3:], self._length(z)
        across = (1.0 - LENGTH / length) * np.eye(3)
        block = STIFFNESS * (across + LENGTH / length**3 * np.outer(d, d))
        return np.block([[block, -block], [-block, block]])

    def _length(self, z: np.ndarray) -> Any:
        d = z[:3] - z[3:]
        return np.sqrt(d @ d)


class Apart(PythonFunction):
    """f = |p1 - p2|^2 - L^2."""

    def __init__(self, length: float) -> None:
        self.length = length

    def value(self, z: np.ndarray) -> Any:
        d = z[:3] - z[3:]
        return d @ d - self.length**2

    def gradient(self, z: np.ndarray) -> np.ndarray:
        d = 2.0 * (z[:3] - z[3:])
        return np.concatenate([d, -d])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        block = 2.0 * np.eye(3)
        return np.block([[block, -block], [-block, block]])


def spring(p: Plant, way: str) -> Element:
    ends = (p.left, p.right)
    if way == "native":
        return LinearSpring(*ends, stiffness=STIFFNESS, length=LENGTH)
    if way == "python":
        return PythonPotential(Stretch(), points=ends)
    stretch = distance(*ends) - parameter("length", LENGTH)
    return ExpressionPotential(parameter("stiffness", STIFFNESS) / 2 * stretch**2)


def rod(p: Plant, way: str) -> Element:
    ends, length = (p.left, p.right), p.length(p.left, p.right)
    if way == "native":
        return Distance(*ends, length)
    if way == "python":
        return PythonConstraint(Apart(length), points=ends)
    return ExpressionConstraint(distance(*ends) ** 2 - parameter("length", length) ** 2)


@cache
def described(element: Callable[[Plant, str], Element], seed: int, way: str) -> tuple[Mechanism, Any]:
    """Return a mechanism with the element, and the configuration of the tree."""
    plant = Plant(seed, element.__name__)
    mechanism = plant.mechanism([element(plant, way)])
    return mechanism, plant.configuration(mechanism)


def agree(ours: np.ndarray, native: np.ndarray, tolerance: float) -> None:
    native = np.asarray(native)
    assert np.abs(native).max() > 1e-6, "nothing is compared with nothing"
    assert np.abs(np.asarray(ours) - native).max() < tolerance * np.abs(native).max()


@pytest.mark.parametrize("way", WAYS[1:])
@pytest.mark.parametrize("seed", SEEDS)
def test_spring(seed: int, way: str) -> None:
    (native, q), (m, _) = (described(spring, seed, w) for w in ("native", way))
    v, dq, dv = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, m.nq))
    agree(m.core.potential_energy(q), native.core.potential_energy(q), 1e-13)
    agree(m.core.gradient(q, v)[0], native.core.gradient(q, v)[0], 1e-13)
    agree(m.core.hessian(q, v)[0], native.core.hessian(q, v)[0], 1e-13)
    agree(m.core.third(q, v, dq, dv)[0], native.core.third(q, v, dq, dv)[0], 1e-12)


@pytest.mark.parametrize("way", WAYS[1:])
@pytest.mark.parametrize("seed", SEEDS)
def test_rod(seed: int, way: str) -> None:
    (native, q), (m, _) = (described(rod, seed, w) for w in ("native", way))
    lam = np.array([1.3])
    elsewhere = q + 0.2
    agree(m.constraint_values(elsewhere), native.constraint_values(elsewhere), 1e-13)
    agree(m.constraint_jacobian(q), native.constraint_jacobian(q), 1e-13)
    agree(m.core.constraint_hessian(q, lam), native.core.constraint_hessian(q, lam), 1e-13)


@pytest.mark.parametrize("way", WAYS[1:])
@pytest.mark.parametrize("element", [spring, rod])
@pytest.mark.parametrize("seed", SEEDS)
def test_step(seed: int, element: Callable[[Plant, str], Element], way: str) -> None:
    """The step, A, B and the contracted second order."""
    found = []
    for each in ("native", way):
        m, q = described(element, seed, each)
        rng = np.random.default_rng([seed, 1])
        v = rng.uniform(-1.0, 1.0, m.nq)
        Dh = m.constraint_jacobian(q)[:, : m.nd]
        v[: m.nd] -= np.linalg.pinv(Dh) @ (m.constraint_jacobian(q) @ v)
        vi = MidpointVI(m, threads=1)
        start = State(0.0, q, m.momentum(q, v)[: m.nd], v[m.nd :])
        run = vi.simulate(start, [0.0, DT], rho=(q + DT * v)[m.nd :])
        assert run.steps == 1, run.message
        d = vi.linearize(run)
        z, z_lam = rng.standard_normal((1, m.nx)), rng.standard_normal((1, m.nc))
        found.append((run.x[1], d.A, d.B, vi.curvature(run, d, z, z_lam=z_lam)))
    tolerances = (1e-12, 1e-11, 1e-11, 1e-9)
    for native, ours, tolerance in zip(*found, tolerances, strict=True):
        agree(ours, native, tolerance)
