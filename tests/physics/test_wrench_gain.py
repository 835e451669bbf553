"""A gain of a wrench is a factor of its inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from derivatives.differences import extrapolated
from leastaction import Gravity, Mechanism, MidpointSystem, MidpointVI, free
from leastaction.elements import BodyWrench, HybridWrench, SpatialWrench

KINDS = (BodyWrench, HybridWrench, SpatialWrench)


def drone(kind, **wrench):
    body = free("hull", axes="xyz", mass=1.2, inertia=(0.02, 0.03, 0.04))
    return Mechanism([body], [Gravity(), kind("hull", name="rotor", **wrench)])


def test_a_gain_is_the_factor_of_every_input_without_one(tmp_path):
    u = np.array([[0.3, -0.1]])
    for kind in KINDS:
        gained = drone(kind, force=(0.3, 0.0, "n"), torque=({"m": 0.2}, 0.01, "n"), gain=0.7)
        plain = drone(kind, force=(0.3, 0.0, {"n": 0.7}), torque=({"m": 0.2}, 0.01, {"n": 0.7}))
        assert gained.parameters["rotor.gain"] == 0.7
        runs = [
            MidpointVI(m).simulate(
                MidpointVI(m).start(np.zeros(m.nq)), np.linspace(0.0, 0.2, 26), inputs=np.tile(u, (25, 1))
            )
            for m in (gained, plain)
        ]
        np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=1e-13, atol=1e-15)
        gained.save(tmp_path / "drone.yaml")
        assert Mechanism.load(tmp_path / "drone.yaml") == gained
        other = gained.with_parameters({"rotor.gain": 1.4})
        assert other.elements["rotor"] == replace(gained.elements["rotor"], gain=1.4)
        assert other.elements["rotor"].pushes[0].terms[-1] == ((0.0, 0.0, 1.4), "n")
        assert "gain 0.7" in gained.elements["rotor"].describe()


def test_an_input_of_a_gain_has_no_unit_that_is_known():
    assert drone(BodyWrench, force=(0, 0, "n")).units["n"] == "N"
    assert drone(BodyWrench, force=(0, 0, "n"), gain=0.02).units["n"] == ""


def test_steps_are_differentiated_by_a_gain(rng):
    m = drone(BodyWrench, force=(0.3, "m", "n"), torque=({"m": 0.2}, 0.1, "n"), gain=0.7)
    t = np.linspace(0.0, 0.3, 4)
    system = MidpointSystem(MidpointVI(m, threads=1), t)
    q, v, u = rng.uniform(-0.3, 0.3, 6), rng.uniform(-1.0, 1.0, 6), rng.normal(size=(3, 2))
    run = MidpointVI(m).simulate(MidpointVI(m).start(q, v), t, inputs=u)
    found = MidpointVI(m).differentiate_by(run, ["rotor.gain"]).x[:, :, 0]

    def ends(by):
        other = system.with_parameters({"rotor.gain": 0.7 + by})
        return np.stack([other.f(run.x[k], u[k], k) for k in range(3)])

    wanted = extrapolated(ends, 0.0, 0.05)
    np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())
    z = rng.normal(size=(3, system.nx))
    second = system.curvature_by_parameters(run.x, u, z, ["rotor.gain"])[:, 0]

    def slopes(by):
        other = system.with_parameters({"rotor.gain": 0.7 + by})
        parts = [other.derivatives(run.x[k], u[k], k) for k in range(3)]
        return np.stack([np.concatenate([z[k] @ A, z[k] @ B]) for k, (A, B) in enumerate(parts)])

    wanted = extrapolated(slopes, 0.0, 0.05)
    np.testing.assert_allclose(second[:, :-1], wanted, atol=1e-8 * np.abs(wanted).max())
