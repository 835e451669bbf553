"""Small mechanisms and measures that the tests of the laws of mechanics share."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from leastaction.mechanics import (
    Distance,
    Element,
    Gravity,
    Mechanism,
    MidpointVI,
    Trajectory,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)

G = 9.81


def pendulum(gravity: float = G) -> Mechanism:
    """Return a point mass of 1 kg on a massless rod of 1 m; it hangs along -y at theta = 0."""
    return Mechanism([rz("theta"), [ty(-1.0, name="bob", mass=1.0)]], [Gravity((0, -gravity, 0))])


def mass_on_string(*, length: float | str = "length", gravity: float = G, copies: int = 1) -> Mechanism:
    """Return a point mass of 2 kg that moves in the x-z plane on a string from the origin."""
    strings = [Distance("bob", "anchor", length, name=f"string{c}") for c in range(copies)]
    return Mechanism(
        [tx("x"), [tz("z", name="bob", mass=2.0)], tx(0.0, name="anchor")],
        [Gravity((0, 0, -gravity)), *strings],
    )


def floating_chain(first: str = "rz", elements: Sequence[Element] = ()) -> Mechanism:
    """Return a free body with two jointed limbs; its first rotation is about a fixed axis of the world."""
    turns = {"rx": (rx, ry, rz), "ry": (ry, rz, rx), "rz": (rz, rx, ry)}[first]
    limbs = [
        rx("shoulder", mass=0.7, com=(0.0, 0.1, 0.5), inertia=(0.02, 0.03, 0.015)),
        [ry("elbow", mass=0.4, com=(0.2, 0.0, 0.3))],
        tz(-0.4),
        [rz("hip", mass=0.9, com=(0.3, 0.0, -0.2), inertia=(0.04, 0.05, 0.03, 0.01, 0.0, 0.005))],
    ]
    body = turns[2]("c", mass=3.0, com=(0.05, -0.1, 0.2), inertia=(0.3, 0.25, 0.2, 0.03, -0.02, 0.01))
    return Mechanism(
        [tx("x"), [ty("y"), [tz("z"), [turns[0]("a"), [turns[1]("b"), [body, limbs]]]]]],
        list(elements),
    )


def in_motion(mechanism: Mechanism, seed: int = 0, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a configuration and a velocity of no special kind."""
    q, v = np.random.default_rng(seed).uniform(-size, size, (2, mechanism.nq))
    return q, v


def times(end: float, steps: int) -> np.ndarray:
    return np.linspace(0.0, end, steps + 1)


def measured_order(error: Callable[[int], float], steps: Sequence[int]) -> float:
    """Return the slope of log(error) over log(time step), fitted over the given numbers of steps."""
    errors = [error(n) for n in steps]
    assert min(errors) > 1e-12, "rounding, not the error of the method"
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def complete(run: Trajectory) -> Trajectory:
    """Return the trajectory after checking that it went to its end."""
    assert run.status.name == "COMPLETED", run.message
    return run


def swing(mechanism: Mechanism, q: np.ndarray, v: np.ndarray, t: np.ndarray, **options) -> Trajectory:
    """Return the motion from a configuration and a velocity."""
    split = options.pop("split", "symmetric")
    vi = MidpointVI(mechanism, split=split, threads=1)
    return complete(vi.simulate(vi.start(q, v, t=float(t[0])), t, **options))
