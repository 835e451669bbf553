"""The robots of example-robot-data: mass matrix, bias, forward dynamics and its derivatives, as Pinocchio has them."""

from __future__ import annotations

import contextlib
import io
from functools import cache
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("example_robot_data")
pytest.importorskip("sympy")

import example_robot_data as robots
import pinocchio as pin

from leastaction.mechanics import ContinuousDynamics
from oracles.pinocchio_models import Coordinates, mechanism_of

FIXED = ("double_pendulum", "finger_edu", "ur5", "panda", "kinova", "baxter", "talos_arm", "z1")
FLOATING = ("hector", "bolt", "solo12", "anymal", "hyq", "a1", "simple_humanoid", "talos")
RELATIVE = 1e-10


@cache
def model_of(name: str) -> Any:
    with contextlib.redirect_stdout(io.StringIO()):
        model = robots.load(name).model
    # A rotor's inertia seen through its gear, which is on the diagonal of the mass matrix and nowhere else.
    model.armature = np.zeros(model.nv)
    return model


@cache
def dynamics_of(name: str) -> ContinuousDynamics:
    return ContinuousDynamics(mechanism_of(model_of(name)), threads=1)


class Point:
    """A random point in both programs' coordinates: unprimed ours, `their_` theirs."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.model = model_of(name)
        self.data = self.model.createData()
        n = self.model.nv
        rng = np.random.default_rng([seed, n])
        self.q = rng.uniform(-0.8, 0.8, n)
        self.v, self.a = rng.standard_normal((2, n))
        self.tau = 10.0 * rng.standard_normal(n)
        self.map = Coordinates.at(self.model, self.q)
        T, rate = self.map.T, self.map.rate(self.v)
        self.their_q = self.map.theirs(self.model)
        self.their_v = T @ self.v
        self.their_a = T @ self.a + rate @ self.v
        self.their_tau = np.linalg.solve(T.T, self.tau)

    def aba(self) -> np.ndarray:
        """Return Pinocchio's accelerations in our coordinates."""
        theirs = pin.aba(self.model, self.data, self.their_q, self.their_v, self.their_tau)
        return np.linalg.solve(self.map.T, theirs - self.map.rate(self.v) @ self.v)

    def aba_derivatives(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return their derivatives by q, v and tau.

        From ``T a + T' v = aba(q', T v, T^-T tau)``, differentiated; a step dq moves theirs along T dq.
        """
        T, T_q, v = self.map.T, self.map.T_q, self.v
        a = self.aba()
        by_q, by_v, by_tau = pin.computeABADerivatives(
            self.model, self.data, self.their_q, self.their_v, self.their_tau
        )
        by_tau = np.triu(by_tau) + np.triu(by_tau, 1).T  # they leave the lower half as it is
        # d(T^-T tau)/dq_k = -T^-T (dT/dq_k)' T^-T tau
        force = -np.linalg.solve(T.T, np.einsum("jik,j->ik", T_q, self.their_tau))
        d_q = by_q @ T + by_v @ np.einsum("ijk,j->ik", T_q, v) + by_tau @ force
        d_q -= np.einsum("ijk,j->ik", T_q, a)
        d_q -= np.einsum("ijlk,l,j->ik", self.map.T_qq, v, v)
        # T' v = T_q[:, j, k] v_j v_k
        d_v = by_v @ T - np.einsum("ijk,j->ik", T_q, v) - np.einsum("ijk,k->ij", T_q, v)
        d_tau = np.linalg.solve(T, by_tau.T).T
        return tuple(np.linalg.solve(T, d) for d in (d_q, d_v, d_tau))  # type: ignore[return-value]


def assert_close(ours: np.ndarray, theirs: np.ndarray, what: str) -> None:
    assert ours.shape == theirs.shape
    size = np.abs(theirs).max()
    assert size > 1e-6, f"{what}: nothing is compared with nothing"
    error = np.abs(ours - theirs).max() / size
    assert error < RELATIVE, f"{what}: off by {error:.2g} of {size:.3g}"


every_robot = pytest.mark.parametrize("name", FIXED + FLOATING)


@every_robot
def test_mass_matrix(name: str) -> None:
    at, m = Point(name), dynamics_of(name).mechanism
    theirs = pin.crba(at.model, at.data, at.their_q)
    upper = np.triu(theirs)
    full = upper + np.triu(theirs, 1).T
    assert_close(m.mass_matrix(at.q), at.map.T.T @ full @ at.map.T, "M")


@every_robot
def test_bias_and_inverse_dynamics(name: str) -> None:
    at, dynamics = Point(name), dynamics_of(name)
    # Forces at rest of a = 0 in our coordinates, which is not theirs for a free flyer.
    drift = at.map.rate(at.v) @ at.v
    bias = at.map.T.T @ pin.rnea(at.model, at.data, at.their_q, at.their_v, drift)
    assert_close(dynamics.inverse_dynamics(at.q, at.v, 0.0 * at.a), bias, "bias")
    if name in FIXED:
        nle = pin.nonLinearEffects(at.model, at.data, at.their_q, at.their_v)
        assert_close(dynamics.inverse_dynamics(at.q, at.v, 0.0 * at.a), nle, "nle")
    tau = at.map.T.T @ pin.rnea(at.model, at.data, at.their_q, at.their_v, at.their_a)
    assert_close(dynamics.inverse_dynamics(at.q, at.v, at.a), tau, "inverse dynamics")


@every_robot
def test_forward_dynamics(name: str) -> None:
    at, dynamics = Point(name), dynamics_of(name)
    assert_close(dynamics.accelerations(at.q, at.v, at.tau).a, at.aba(), "aba")


@every_robot
def test_derivatives_of_forward_dynamics(name: str) -> None:
    at, dynamics = Point(name), dynamics_of(name)
    d = dynamics.linearize(at.q, at.v, at.tau)
    for what, theirs in zip(("a_dq", "a_dv", "a_du"), at.aba_derivatives(), strict=True):
        assert_close(getattr(d, what), theirs, what)


@pytest.mark.parametrize("name", ["panda", "solo12"])
def test_comparison_sees_another_robot(name: str) -> None:
    """A joint a millimetre elsewhere, a mass of one per mille more: both are seen."""
    at = Point(name)
    changed = at.model.copy()
    changed.inertias[2].mass *= 1.001
    ours = ContinuousDynamics(mechanism_of(changed), threads=1).accelerations(at.q, at.v, at.tau)
    with pytest.raises(AssertionError, match="aba"):
        assert_close(ours.a, at.aba(), "aba")
    moved = at.model.copy()
    moved.jointPlacements[2].translation += 1e-3
    ours = ContinuousDynamics(mechanism_of(moved), threads=1).accelerations(at.q, at.v, at.tau)
    with pytest.raises(AssertionError, match="aba"):
        assert_close(ours.a, at.aba(), "aba")
