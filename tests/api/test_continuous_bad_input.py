"""What is no simulation in continuous time is refused with what was given, what was expected, and what to do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from leastaction.errors import ArgumentError
from leastaction.mechanics import JointForce, Mechanism, MidpointVI, tx, ty
from leastaction.mechanics.continuous.events import Event
from leastaction.mechanics.continuous.legendre import to_momentum, to_velocity
from leastaction.mechanics.continuous.prescribed import PrescribedMotion
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.stabilisation import Baumgarte, Projection

T = [0.0, 0.5, 1.0]


def crane() -> Mechanism:
    """Return a mass that is pushed along x, behind a prescribed height."""
    return Mechanism([ty("height", kinematic=True), [tx("x", mass=1.0)]], [JointForce("x", input="push")])


def run(**options):
    m = crane()
    arguments = {"dynamics": m, "q0": [0.0, 0.0], "v0": None, "t": T} | options
    return simulate(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dynamics": "crane"}, r"dynamics: got str, expected a Mechanism"),
        ({"dynamics": MidpointVI(crane())}, r"dynamics: got MidpointVI"),
        ({"q0": [0.0]}, r"q0: got shape \(1,\), expected \(2,\); the last axis holds x, height"),
        ({"q0": [0.0, np.nan]}, r"q0: got nan at index \(1,\) for 'height'"),
        ({"v0": [np.inf, 0.0]}, r"v0: got inf at index \(0,\) for 'x'"),
        ({"v0": "fast"}, r"v0: got .*, expected real numbers"),
        ({"t": [0.0]}, r"t: got 1 times, expected at least two"),
        ({"t": [0.0, 1.0, 0.5]}, r"times must increase, but t\[1\]"),
        ({"t": 1.0}, r"t: got shape .*, expected \(any,\)"),
        ({"method": "Euler"}, r"method: unknown 'Euler'; the methods are 'RK23'"),
        ({"method": "radau"}, r"did you mean 'Radau'"),
        ({"rtol": 0.0}, r"rtol: got 0.0, expected a number from"),
        ({"rtol": 1e-16}, r"rtol: got 1e-16, expected"),
        ({"rtol": "small"}, r"rtol: got 'small' .*, expected a number"),
        ({"atol": -1e-6}, r"atol: got -1e-06, expected positive"),
        ({"atol": [1e-6, 1e-6]}, r"atol: got shape \(2,\), expected \(4,\)"),
        ({"max_step": 0.0}, r"max_step: got 0.0 s, expected a positive time"),
        ({"first_step": -1.0}, r"first_step: got -1.0 s"),
        ({"first_step": 2.0}, r"first_step: got 2.0 s, expected at most the 1 s"),
        ({"max_steps": 0}, r"max_steps: got 0, expected a whole number"),
        ({"max_steps": 1.5}, r"max_steps: got 1.5 .*, expected a whole number"),
        ({"constraints": "penalty"}, r"constraints: got 'penalty', expected 'project', 'baumgarte'"),
        ({"constraints": None}, r"constraints: got None, expected"),
        ({"constraints": Baumgarte(0.0)}, r"time_constant: got 0.0, expected a number > 0"),
        ({"constraints": Baumgarte(0.1, -1.0)}, r"damping_ratio: got -1.0, expected a number > 0"),
        ({"constraints": Projection(1.0)}, r"tolerance: got 1.0, expected a number between 0 and 0.01"),
    ],
)  # fmt: skip
def test_settings(options: dict, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        run(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inputs": [1.0, 2.0]}, r"inputs: .*expected \(1,\), .*rows are of shape \(2, 1\) or \(3, 1\); .* push"),
        ({"inputs": np.zeros((4, 1))}, r"inputs: got shape \(4, 1\), expected \(3, 1\)"),
        ({"inputs": [[0.0], [np.nan]]}, r"inputs: got nan at index \(1, 0\) for 'push'"),
        ({"inputs": lambda t, x, y: [0.0]}, r"inputs: it is called as inputs\(t\), or as .*but takes \(t, x, y\)"),
        ({"inputs": lambda t, x: [0.0, 1.0]}, r"inputs\(0, x\): got shape \(2,\), expected \(1,\)"),
        ({"inputs": lambda t, x: "push"}, r"inputs\(0, x\): got .*, expected real numbers"),
        ({"rho_a": [1.0, 2.0]}, r"rho_a: got shape .*, expected \(1,\).*holds height"),
        ({"rho_a": lambda t, x: [1.0, 2.0]}, r"rho_a\(0, x\): got shape .*, expected \(1,\)"),
        ({"rho": lambda t: [0.0]}, r"rho: got the function.*give a PrescribedMotion"),
        ({"rho": np.zeros((2, 1))}, r"rho: got shape \(2, 1\), expected \(3, 1\)"),
        ({"rho": [[0.0], [np.inf], [0.0]]}, r"rho: got inf at index \(1, 0\) for 'height'"),
        ({"rho": [[0.5], [0.0], [0.0]]}, r"q0: the start has 'height' at 0, but.*at 0.5; they must agree"),
        ({"rho": CubicSpline(T, [[0.0], [1.0], [4.0]]), "v0": [0.0, 5.0]}, r"v0: the start has 'height' at 5"),
        ({"rho": PrescribedMotion(lambda t: [0.0, 0.0], lambda t: [0.0], lambda t: [0.0])}, r"rho\(0\): got shape"),
        ({"rho": PrescribedMotion(lambda t: [0.0], lambda t: [0.0, 0.0], lambda t: [0.0])}, r"velocity of rho\(0\)"),
        ({"rho": PrescribedMotion(lambda t: [0.0], lambda t: [0.0], lambda t: [])}, r"acceleration of rho\(0\)"),
        ({"rho": np.zeros((3, 1)), "rho_a": [0.0]}, r"rho: got both rho and rho_a"),
        ({"u": lambda t, x: [0.0, 0.0], "inputs": [1.0]}, r"u: it gives all inputs, but inputs came too"),
        ({"u": [0.0, 0.0]}, r"u: got .* \(list\), expected a function"),
        ({"u": lambda t, x: [0.0]}, r"u\(0, x\): got shape .*, expected \(2,\).*acceleration of height"),
    ],
)  # fmt: skip
def test_inputs(options: dict, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        run(**options)


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ([Event("x")], r"events: got .* \(list\), expected a mapping of names"),
        ({"low": 3.0}, r"events\['low'\]: got float, expected an Event"),
        ({"low": "y"}, r"events\['low'\]: unknown variable 'y'; the variables are 'x', 'height'"),
        ({"low": Event("heigth")}, r"did you mean 'height'"),
        ({"low": Event("x", value=np.nan)}, r"events\['low'\]: value: got nan"),
        ({"low": Event("x", terminal=-1)}, r"terminal is -1, expected True, False"),
        ({"low": lambda t, x: "no"}, r"events\['low'\]: got 'no' at t = 0 s, expected a number"),
    ],
)
def test_events(events: object, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        run(events=events)


def test_events_of_other_kinds() -> None:
    with pytest.raises(ArgumentError, match=r"Event: direction: got 'up' .*, expected a number"):
        Event("x", direction="up")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"Event: terminal: got 0.5 .*, expected True or False or a whole number"):
        Event("x", terminal=0.5)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"Event: function: got None .*, expected a function or a word"):
        Event(None)  # type: ignore[arg-type]


def test_what_a_trajectory_is_asked_for() -> None:
    done = run(v0=[1.0, 0.0])
    for name, call in {
        "pull": lambda name: done[name],
        "hight": done.velocity,
        "push": done.acceleration,
    }.items():
        with pytest.raises(ArgumentError, match=f"unknown (name|variable) '{name}'"):
            call(name)
    with pytest.raises(ArgumentError, match=r"t: got 1.5 s, expected times from 0 to 1 s"):
        done([0.5, 1.5])
    with pytest.raises(ArgumentError, match=r"t: got nan at index \(0,\)"):
        done(np.nan)
    with pytest.raises(ArgumentError, match="no dense output; simulate with dense_output=True"):
        run(dense_output=False)(0.5)


def test_rows_and_motions() -> None:
    with pytest.raises(ArgumentError, match=r"degree: got 4, expected 3 or 5"):
        PrescribedMotion.through(T, np.zeros((3, 1)), degree=4)
    with pytest.raises(ArgumentError, match=r"rho: got shape .*, expected \(3, any\)"):
        PrescribedMotion.through(T, np.zeros((2, 1)))


def test_legendre_transform() -> None:
    m = crane()
    with pytest.raises(ArgumentError, match=r"v: got shape \(3,\), expected \(2,\)"):
        to_momentum(m, [0.0, 0.0], [0.0, 0.0, 0.0])
    with pytest.raises(ArgumentError, match=r"v: got shape \(1, 2\), expected \(2, 2\)"):
        to_momentum(m, np.zeros((2, 2)), np.zeros((1, 2)))
    with pytest.raises(ArgumentError, match=r"p: got shape \(2,\), expected \(1,\)"):
        to_velocity(m, [0.0, 0.0], [0.0, 0.0])
    with pytest.raises(ArgumentError, match=r"v_rho: got nan at index \(0,\) for 'height'"):
        to_velocity(m, [0.0, 0.0], [0.0], [np.nan])
