"""Numbers from measured rotations: quaternions, mean angular velocities, hands that are turned."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Damping, Gravity, JointForce, JointSpring, Mechanism, MidpointVI, ball, rz, tz
from leastaction.errors import ArgumentError
from leastaction.identification import Experiment, identify
from leastaction.identification.model import Measured
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array
from leastaction.optimal import Rotations

T = np.linspace(0.0, 1.2, 61)
NAMES = ["spring.stiffness", "head.mass", "damping.neck.wy"]


def bust(**numbers: float) -> Mechanism:
    """A head on a neck, a ball joint with a spring, on a hand that is turned and lifted."""
    head = ball("neck", name="head", mass=0.8, com=(0.02, 0.0, 0.15), inertia=(8e-3, 6e-3, 4e-3))
    springs = [JointSpring("neck.wx", 3.0, name="spring"), JointSpring("neck.wy", 2.0), JointSpring("neck.wz", 2.0)]
    tree = [
        tz("lift", kinematic=True),
        [ball("hand", kinematic=True), [head, [rz("jaw", mass=0.1, inertia=(1e-3,) * 3)]]],
    ]
    elements = [*springs, Damping({"neck.wx": 0.02, "neck.wy": 0.05, "jaw": 0.01}), JointForce("jaw", "u"), Gravity()]
    return Mechanism(tree, elements).with_parameters(numbers)


def tilt(t: float) -> Array:
    return rotations.exponential(np.array([0.5 * np.sin(3.0 * t), 0.0, 0.4 * t]))


def measured(sigma: float) -> tuple[dict[str, Array], dict[str, object], tuple[Array, Array]]:
    """Return what is measured of a head whose numbers are others, with what is done to it and how it begins."""
    m = bust(**{"spring.stiffness": 3.7, "head.mass": 0.95, "damping.neck.wy": 0.08})
    vi = MidpointVI(m)
    q0, v0 = m.configuration({"jaw": 0.3}), np.r_[1.0, -2.0, 0.5, 0.3, np.zeros(4)]
    q0[:4] = rotations.exponential(np.array([0.3, 0.2, -0.4]))
    lift = 0.1 * np.sin(4.0 * T)
    turns = np.array([tilt(t) for t in T])
    run = vi.simulate(vi.start(q0, v0), T, inputs=[0.05], rho=np.column_stack([lift, turns]))
    rng = np.random.default_rng(3)
    seen = Rotations().plus(run.q[:, :4], sigma * rng.standard_normal((61, 3)))
    seen[7] = np.nan
    rate, jaw = (each + sigma * rng.standard_normal(len(each)) for each in (run.v[:, 0], run["jaw"]))
    data = {"neck": seen, "rate of neck.wx": rate, "jaw": jaw}
    return data, {"u": 0.05, "lift": lift, "hand": turns}, (q0, v0)


def test_numbers_of_a_neck_are_found() -> None:
    data, inputs, _ = measured(1e-3)
    experiment = Experiment(T, data, 1e-3, inputs=inputs)
    found = identify(bust(), experiment, NAMES)
    for name, value in zip(NAMES, (3.7, 0.95, 0.08), strict=True):
        assert found[name] == pytest.approx(value, rel=0.05), name
    assert np.abs(found.runs[0].q[:, :4] - np.nan_to_num(data["neck"])).max(axis=1)[[0, 30, 60]].max() < 0.01


def test_residuals_have_their_derivatives() -> None:
    data, inputs, (q0, v0) = measured(1e-2)
    for free in (True, False):
        experiment = Experiment(T, data, 0.1, inputs=inputs, start=(q0, v0), free_start=free)
        model = Measured(experiment, MidpointVI(bust(), tolerance=1e-15), NAMES, 1)
        values, z = np.array([3.0, 0.8, 0.05]), np.zeros(model.n_start)
        _, J = model.residuals(values, z, 12)
        y = np.concatenate([values, z])
        for j in range(len(y)):
            h = 1e-4 * max(abs(y[j]), 0.1)
            ends = []
            for way in (1, -1, 2, -2):
                moved = y.copy()
                moved[j] += way * h
                ends.append(model.residuals(moved[:3], moved[3:], 12)[0])
            slope = (8.0 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12.0 * h)
            assert np.abs(J[:, j] - slope).max() < 2e-7 * max(1.0, np.abs(slope).max()), j


def test_functions_and_mistakes() -> None:
    data, inputs, start = measured(1e-3)
    by_function = {**inputs, "hand": tilt, "lift": lambda t: 0.1 * np.sin(4.0 * t)}
    runs = [
        identify(bust(), Experiment(T, data, 1e-3, inputs=each, start=start), NAMES) for each in (inputs, by_function)
    ]
    assert runs[0]["head.mass"] == pytest.approx(runs[1]["head.mass"], rel=1e-6)
    with pytest.raises(ArgumentError, match=r"'neck\.wx'; did you mean.*'neck'"):
        identify(bust(), Experiment(T, {"neck.wx": np.zeros(61)}, inputs=inputs), NAMES)
    with pytest.raises(ArgumentError, match=r"inputs\['hand'\].*unit quaternion"):
        identify(bust(), Experiment(T, data, inputs={"hand": np.ones((61, 4))}), NAMES)
