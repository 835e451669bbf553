"""A walk on the spot for the marionette, made by formula.

The puppet is held at the knees, the hands and the shoulders. At rest its thighs are raised by the knee strings, its
shins hang straight down and its forearms lie level. In the walk the knees go up and down in turn, each arm with the leg
of the other side, twice a cycle the body bobs, and once it sways and turns a little. The shins have no string: they
swing as the pendulums they are, by the steady response of a hanging rigid body to the motion of the knee.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.io import Motion, count_steps
from leastaction.models.marionette import REST
from leastaction.numerics import Array, as_number, smooth_rise
from leastaction_marionette.retargeting.skeleton import VARIABLES, Proportions

# A shin of the marionette about its knee: mass times lever 1.5 kg 0.2 m, inertia about the knee
# (0.3 + 1.5 0.2^2) kg m^2, so it swings freely at 0.455 Hz.
_SHIN_MOMENT, _SHIN_INERTIA, _GRAVITY = 0.3, 0.36, 9.81


def walk_in_place(
    duration: float = 10.0,
    dt: float = 0.01,
    *,
    cadence: float = 0.7,
    stride: float = 0.28,
    ramp: float = 1.5,
    rest: Mapping[str, float] | None = None,
) -> Motion:
    """A walk on the spot that starts and ends at rest.

    Parameters
    ----------
    duration : float
        Seconds.
    dt : float
        Step in seconds; `duration` is rounded to whole steps.
    cadence : float
        Cycles (two steps each) per second.
    stride : float
        Amplitude of the thighs in radians; everything else is in proportion to it.
    ramp : float
        Seconds in which the walk grows at the start and dies away at the end; shortened to half of
        `duration` where that is less. Value, velocity and acceleration there begin and end at zero.
    rest : mapping from name to value, optional
        Pose about which the puppet walks; the marionette's pose of rest if not given.

    Returns
    -------
    Motion
        The 22 variables of the marionette (`leastaction_marionette.retargeting.skeleton.VARIABLES`).

    Raises
    ------
    ArgumentError
        A number that is not positive, or a name in `rest` that the puppet does not have.
    """
    options = {"duration": duration, "dt": dt, "cadence": cadence, "ramp": ramp}
    for name, value in options.items():
        as_number(value, name, above=0.0)
    if not 0.0 <= stride <= 0.6:
        raise ArgumentError(f"stride: got {stride!r}, expected 0 to 0.6 radians")
    n_steps = count_steps(duration, dt)
    if n_steps < 1:
        raise ArgumentError(f"dt: got {dt:g} s, expected less than the duration, {duration:g} s")
    pose = dict(REST if rest is None else rest)
    if unknown := sorted(set(pose) - set(VARIABLES)):
        raise ArgumentError(f"rest: unknown variables {', '.join(unknown)}; the puppet has {', '.join(VARIABLES)}")

    t = dt * np.arange(n_steps + 1, dtype=np.float64)
    envelope = _rise(t, t[-1], min(ramp, 0.5 * t[-1]))
    phase = 2.0 * np.pi * cadence * t
    once = stride * envelope * np.sin(phase)
    # Twice a cycle, and never above the rest height: the strings let the body down, not up.
    twice = stride * envelope * 0.5 * (1.0 - np.cos(2.0 * phase))
    change = {
        "torso_tx": -0.03 * once,
        "torso_tz": -0.03 * twice,
        "torso_rz": 0.1 * once,
        "torso_ry": 0.03 * once,
        "torso_rx": -0.03 * twice,
    }
    for side, sign in (("l", 1.0), ("r", -1.0)):
        thigh = sign * once
        raised = pose.get(f"{side}hip_rx", 0.0) + pose.get("torso_rx", 0.0)
        # The knee's way to the front, to second order: y = l sin(raised + thigh).
        length = Proportions().thigh
        slow = length * np.cos(raised) * thigh
        fast = length * np.sin(raised) * (0.5 * stride * envelope) ** 2 * np.cos(2.0 * phase)
        shin = _hanging(cadence) * slow + _hanging(2.0 * cadence) * fast
        change[f"{side}hip_rx"] = thigh
        change[f"{side}knee_rx"] = shin - thigh - change["torso_rx"]
        # The hook of the hand stands above the level forearm, so a rising forearm takes it back;
        # hanging on its string it pushes the elbow forward in return.
        change[f"{side}shoulder_rx"] = -0.35 * sign * once
        change[f"{side}elbow_rx"] = -1.1 * sign * once
    q = np.zeros((t.size, len(VARIABLES)))
    for column, name in enumerate(VARIABLES):
        q[:, column] = pose.get(name, 0.0) + change.get(name, 0.0)
    return Motion(VARIABLES, t, q, source="walk in place")


def _hanging(frequency: float) -> float:
    """Swing in radians of a hanging shin for one metre of its knee's way at `frequency` in Hz.

    Steady response of the linear pendulum ``J a'' + m g d a = -m d y''`` to the knee's horizontal
    motion y; limited near resonance, where only damping would limit it.
    """
    omega2 = (2.0 * np.pi * frequency) ** 2
    stiffness = _SHIN_MOMENT * _GRAVITY - _SHIN_INERTIA * omega2
    drive = _SHIN_MOMENT * omega2
    if abs(stiffness) < 0.4 * drive:
        return float(np.copysign(2.5, stiffness))
    return float(drive / stiffness)


def _rise(t: Array, end: float, ramp: float) -> Array:
    """1 in the middle, falling to 0 at both ends over `ramp` with two zero derivatives there."""
    return smooth_rise(np.minimum(t, end - t) / ramp)
