"""The humanoid marionette on its strings (dissertation 5.3 and 6.7.3).

22 dynamic variables: the pelvis' three translations and three rotations, three angles at each hip and
shoulder, one at each knee and elbow. 18 kinematic variables: each string hangs from a point that moves in
the horizontal plane `PLANE_HEIGHT` above the origin, and is drawn in and let out; or strings are tied to bars
(`leastaction.models.puppet_controls`). There are no motors: the strings and gravity move the puppet.

Axes: x to the puppet's right, y ahead, z up. All angles are zero when it stands straight with its arms down.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Damping,
    Distance,
    Frame,
    Gravity,
    Mechanism,
    TendonForce,
    ball,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.models.puppet_controls import (
    CONTROLS,
    NINE_STRINGS,
    STRING_SETS,
    STRINGS,
    Bar,
    Control,
    Count,
    Hanging,
    PuppetString,
    TiedString,
    bars_of,
    held_strings,
    set_of,
    string_lengths,
    strings_of,
    strings_on,
    tied_strings,
)
from leastaction.models.puppet_turns import turns_of_angles
from leastaction.numerics.arrays import as_choice
from leastaction.numerics.public import public

__all__ = [
    "CONTROLS", "HOOK_REACH", "JOINT_LIMITS", "NINE_STRINGS", "PLANE_HEIGHT", "REST", "STRINGS", "STRING_SETS",
    "UNHELD", "Bar", "Control", "Count", "Hanging", "PuppetString", "TiedString", "axes_of", "bars_of", "hang_strings",
    "heading", "held_strings", "marionette", "rest_pose", "set_of", "string_lengths", "strings_of", "tie_strings",
    "tied_strings", "turns_of_angles",
]  # fmt: skip

PLANE_HEIGHT = 2.0
"""Height of the plane that the strings hang from (m)."""

SHOULDER_WIDTH = 0.158
HIP_WIDTH = 0.1
SPINE = 0.4913
FOREARM = 0.2577
HOOK_REACH = 0.1
"""How far ahead of knees and wrists their strings are tied, and to the sides of the spine (m)."""

REST = {"lhip_rx": 0.97, "rhip_rx": 0.97, "lknee_rx": -0.97, "rknee_rx": -0.97, "lelbow_rx": 1.57, "relbow_rx": 1.57}
"""Body angles of the rest pose (rad): thighs and forearms raised, the rest straight. In balance on the strings."""


UNHELD = ("lknee_rx", "rknee_rx")
"""Joints behind which no string is tied: they swing freely, so a motion can hardly be imposed on them."""

JOINT_LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **{f"{side}knee_rx": (-2.6, 0.0) for side in "lr"},
        **{f"{side}elbow_rx": (0.0, 2.6) for side in "lr"},
        **dict.fromkeys(("torso_ry", *(f"{side}{j}_ry" for side in "lr" for j in ("hip", "shoulder"))), (-1.4, 1.4)),
    }
)
"""Least and largest angles (rad): knees bend to the back, elbows to the front. What turns by three angles keeps ten
degrees off where the first and the third turn about one axis, and spin. The model has no stops there; who plans a
motion states them as limits."""


@public
def marionette(
    *,
    damping: float = 0.2,
    strings: Hanging = 6,
    by: Literal["length", "tension"] = "length",
    axes: Literal["zyx", "quaternion"] = "zyx",
) -> Mechanism:
    """Return the marionette.

    Parameters
    ----------
    damping : float, optional
        Damping of every dynamic variable (N s/m and N m s/rad).
    strings : {6, 7, 8, 9, 11} or {"cross", "cross+legs", "cross+hands", "cross+legs+hands"}, optional
        How many strings it hangs on, each held by a hand: one of `STRING_SETS`; or the control that it hangs on by
        seven strings: one of `CONTROLS`. Strings that are tied to a bar have the lengths with which the puppet stands
        straight, at the origin, below a level control; `tie_strings` gives them others.
    by : {"length", "tension"}, optional
        What is prescribed of a string besides its upper end: its length, as a kinematic variable of a constraint, or
        as its number if it is tied to a bar; or its tension, as an input of the string's name (N, positive where it
        pulls). `PulledSystem` makes the same motions of the second that `MidpointSystem` makes of the first.
    axes : {"zyx", "quaternion"}, optional
        How pelvis, hips and shoulders turn: by three angles, or as ball joints ``"torso"``, ``"lhip"``, ``"rhip"``,
        ``"lshoulder"`` and ``"rshoulder"``, to which no attitude is special; `turns_of_angles` says one by the other.

    Raises
    ------
    ArgumentError
        For strings or a way that there are not.
    """
    as_choice(axes, "axes", ("zyx", "quaternion"))
    turning = axes == "quaternion"
    if (strings not in STRING_SETS and strings not in CONTROLS) or by not in ("length", "tension"):
        raise ArgumentError(
            f"strings, by: got {strings!r} and {by!r}, expected {', '.join(map(str, STRING_SETS))} strings or one of "
            f"{', '.join(map(repr, CONTROLS))}, by 'length' or by 'tension'"
        )
    table = strings_on(strings)
    bars = next((bars for name, bars in CONTROLS.items() if name == strings), ())
    names = {string.name for string in table}
    feet, back, elbows, neck = (f"{part}_string" in names for part in ("left_foot", "back", "left_elbow", "neck"))
    pelvis: dict[str, Any] = {"name": "pelvis", "mass": 10.0, "inertia": (1.0, 1.0, 1.0)}
    body = [
        *_leg("l", "left", feet, turning),
        *_leg("r", "right", feet, turning),
        *([ty(-HOOK_REACH, name="back_string_hook")] if back else []),
        tz(SPINE, name="spine_top"), [
            tz(0.045, name="neck"), [
                tz(0.045, name="head"), [
                    tz(0.09, name="head_center", mass=0.75, inertia=(0.08, 0.08, 0.08)), [
                        tz(0.08, name="head_end"),
                    ],
                ],
            ],
            *_arm("l", "left", elbows, turning),
            *_arm("r", "right", elbows, turning),
            *([tz(0.0, name="neck_string_hook")] if neck else []),
            tx(-HOOK_REACH, name="upper_torso_string_hook"),
            tx(HOOK_REACH, name="lower_torso_string_hook"),
        ],
    ]  # fmt: skip
    puppet = [
        tx("torso_tx"), [ty("torso_ty"), [tz("torso_tz"), _turning("torso", body, turning=turning, **pelvis)]],
    ]  # fmt: skip
    upper_ends: list[Any] = []
    hands = [string for string in table if isinstance(string, PuppetString)]
    for string in hands:
        upper_ends += [tx(string.x, kinematic=True), [ty(string.y, name=string.control, kinematic=True)]]
    for bar in bars:
        upper_ends += bar.tree()
    pulls: list[Distance | TendonForce]
    if by == "length":
        pulls = [Distance(s.hook, s.control, s.length if s in hands else 1.0, name=s.name) for s in table]
        kinematic = [name for s in hands for name in (s.x, s.y, s.length)]
    else:
        pulls = [TendonForce((s.hook, s.control), s.name) for s in table]
        kinematic = [name for s in hands for name in (s.x, s.y)]
    result = Mechanism(
        [*puppet, tz(PLANE_HEIGHT, name="string_plane"), upper_ends],
        [Gravity((0.0, 0.0, -9.8)), Damping(damping), *pulls],
        kinematic=[*kinematic, *(name for bar in bars for name in bar.variables)],
    )
    return tie_strings(result, hang_strings(result, result.configuration())) if bars and by == "length" else result


@public
def tie_strings(mechanism: Mechanism, q: npt.ArrayLike) -> Mechanism:
    """Return a marionette whose strings on bars are as long as they are in configurations.

    Parameters
    ----------
    mechanism : Mechanism
        From `marionette`, by lengths.
    q : array_like, shape (nq,) or (N, nq)
        Of several configurations, as long as in the mean.

    Returns
    -------
    Mechanism
        The same one where hands hold all strings.
    """
    strings = tied_strings(mechanism)
    if not strings:
        return mechanism
    lengths = np.atleast_2d(string_lengths(mechanism, q)).mean(axis=0)
    names = [string.name for string in strings_of(mechanism)]
    return mechanism.with_parameters({s.length: float(lengths[names.index(s.name)]) for s in strings})


def _turning(joint: str, behind: list[Any], *, turning: bool, **frame: Any) -> list[Any]:
    """Return a joint that turns any way, by three angles or as a quaternion, and what is behind it."""
    if turning:
        return [ball(joint, axes="quaternion", **frame), behind]
    return [rz(f"{joint}_rz"), [ry(f"{joint}_ry"), [rx(f"{joint}_rx", **frame), behind]]]


def _leg(side: str, side_name: str, foot_string: bool, turning: bool) -> list[Frame | list[Any]]:
    """Return a leg from the hip down; the string is tied ahead of the knee."""
    sign = -1.0 if side == "l" else 1.0
    return [
        tx(sign * HIP_WIDTH, name=f"{side}hip"), [
            *_turning(f"{side}hip", [
                tz(-0.2, name=f"{side}femur_mass", mass=1.5, inertia=(0.3, 0.3, 0.1)),
                tz(-0.4, name=f"{side}femur_end"), [
                    ty(HOOK_REACH, name=f"{side_name}_leg_string_hook"),
                    rx(f"{side}knee_rx", name=f"{side}tibia"), [
                        tz(-0.2, name=f"{side}tibia_mass", mass=1.5, inertia=(0.3, 0.3, 0.1)),
                        tz(-0.4, name=f"{side}foot"), [
                            ty(0.2, name=f"{side}foot_end"),
                            *([ty(HOOK_REACH, name=f"{side_name}_foot_string_hook")] if foot_string else []),
                        ],
                    ],
                ],
            ], turning=turning, name=f"{side}femur"),
        ],
    ]  # fmt: skip


def _arm(side: str, side_name: str, elbow_string: bool, turning: bool) -> list[Frame | list[Any]]:
    """Return an arm from the shoulder down; the string is tied ahead of the wrist, another behind the elbow."""
    sign = -1.0 if side == "l" else 1.0
    return [
        tx(sign * SHOULDER_WIDTH, name=f"{side}shoulder"), [
            *_turning(f"{side}shoulder", [
                tz(-0.125, name=f"{side}humerus_mass", mass=0.5, inertia=(0.05, 0.05, 0.01)),
                tz(-0.25, name=f"{side}humerus_end"), [
                    *([ty(-HOOK_REACH, name=f"{side_name}_elbow_string_hook")] if elbow_string else []),
                    rx(f"{side}elbow_rx", name=f"{side}radius"), [
                        tz(-FOREARM / 2, name=f"{side}radius_mass", mass=0.5, inertia=(0.05, 0.05, 0.01)),
                        tz(-FOREARM, name=f"{side}hand"), [
                            ty(HOOK_REACH, name=f"{side_name}_arm_string_hook"),
                            tz(-0.09, name=f"{side}hand_end"),
                        ],
                    ],
                ],
            ], turning=turning, name=f"{side}humerus"),
        ],
    ]  # fmt: skip


@public
def rest_pose(mechanism: Mechanism) -> npt.NDArray[np.float64]:
    """Return the configuration in which the puppet hangs at rest with bent knees and elbows.

    Parameters
    ----------
    mechanism : Mechanism
        From `marionette`.

    Returns
    -------
    ndarray, shape (nq,)
        Satisfies the constraints: every string is straight above its hook. Gravity and the strings are in balance.
    """
    pose: Mapping[str, Any] = turns_of_angles(REST) if mechanism.tree.rotations else REST
    return hang_strings(mechanism, mechanism.configuration(pose))


@public
def axes_of(mechanism: Mechanism) -> Literal["zyx", "quaternion"]:
    """Return how pelvis, hips and shoulders of a marionette turn; ``mechanism``: from `marionette`."""
    return "quaternion" if mechanism.tree.rotations else "zyx"


@public
def heading(mechanism: Mechanism, q: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return how far the pelvis is turned to the left from facing along y (rad).

    Parameters
    ----------
    mechanism : Mechanism
        From `marionette`.
    q : array_like, shape (nq,) or (N, nq)
        Configurations; those of a motion in order.

    Returns
    -------
    ndarray, shape () or (N,)
        The turn about the vertical that is left of its attitude when it has been brought upright by the shortest way,
        without jumps from one configuration to the next.
    """
    q, order = np.asarray(q, dtype=np.float64), mechanism.coordinates
    if not mechanism.tree.rotations:
        return np.asarray(q[..., order.index("torso_rz")])
    half = np.arctan2(q[..., order.index("torso.qz")], q[..., order.index("torso.qw")])
    return np.asarray(2.0 * (np.unwrap(half, period=np.pi) if half.ndim else np.arctan(np.tan(half))))


@public
def hang_strings(mechanism: Mechanism, q: npt.ArrayLike, *, ahead: float = 0.0) -> npt.NDArray[np.float64]:
    """Return configurations with every string that a hand holds taut, straight above its hook or slanted ahead.

    Bars are held level over the pelvis and turned as it is, in the plane of the hands: the strings that are tied to
    them are as long there as they happen to be.

    Parameters
    ----------
    mechanism : Mechanism
        From `marionette`.
    q : array_like, shape (nq,) or (N, nq)
        The body variables are kept; the string variables may hold anything finite.
    ahead : float, optional
        How far ahead of the hooks, as the pelvis faces, the upper ends of the strings of arms and legs are
        (m). A vertical string cannot swing a limb whose hook is straight below its joint, as that of a
        leg stretched back is; a slanted one can.

    Returns
    -------
    ndarray, shape (nq,) or (N, nq)
        Satisfies the constraints, but those of strings on bars.

    Raises
    ------
    ArgumentError
        If a hook is not below the plane of the strings.
    """
    strings = strings_of(mechanism)
    hooks = mechanism.positions(q, [string.hook for string in strings])
    heights = PLANE_HEIGHT - hooks[..., 2]
    if np.any(heights <= 0.0):
        where = np.argwhere(heights <= 0.0)[0]
        name = strings[where[-1]].name
        row = f" in row {where[0]}" if len(where) > 1 else ""
        raise ArgumentError(
            f"{name}: its hook is at height {hooks[tuple(where)][2]:.3g} m{row}; expected less than the "
            f"{PLANE_HEIGHT:g} m of the plane that the strings hang from. Lower the puppet (torso_tz)"
        )
    result = np.array(q, dtype=np.float64)
    order = {name: index for index, name in enumerate(mechanism.coordinates)}
    yaw = heading(mechanism, q)
    for i, string in enumerate(strings):
        if not isinstance(string, PuppetString):
            continue
        slant = 0.0 if "torso" in string.name else ahead
        result[..., order[string.x]] = hooks[..., i, 0] - slant * np.sin(yaw)
        result[..., order[string.y]] = hooks[..., i, 1] + slant * np.cos(yaw)
        result[..., order[string.length]] = np.hypot(heights[..., i], slant)
    for bar in bars_of(mechanism):
        x, y, _ = bar.places
        result[..., [order[name] for name in bar.variables]] = 0.0
        result[..., order[x]] = result[..., order["torso_tx"]] - bar.ahead * np.sin(yaw)
        result[..., order[y]] = result[..., order["torso_ty"]] + bar.ahead * np.cos(yaw)
        result[..., order[bar.angles[0]]] = yaw
    return result
