"""The tendons of an MJCF by themselves: their springs, damping, friction, inertia, limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from leastaction.io.mechanisms.joint_elements import FRICTION_SPEED
from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.muscles import Bare, slack_length
from leastaction.io.mechanisms.mjcf.places import Places
from leastaction.io.mechanisms.mjcf.scalars import Along, of_tendon
from leastaction.io.mechanisms.mjcf.spec import is_limited
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.mechanics import (
    Armature,
    CoulombFriction,
    Curve,
    ElasticString,
    JointSpring,
    NonlinearDamping,
    NonlinearSpring,
)
from leastaction.mechanics.elements import Element
from leastaction.optimal import Bound
from leastaction.systems import PathBound


def elements_of_tendons(spec: Any, names: Names, bare: Bare) -> Found:
    """Return what the tendons of a specification do by themselves."""
    places, found = Places(spec), Found()
    for tendon in spec.tendons:
        along = of_tendon(tendon.name, spec, names, places)
        if along is None:
            why = "it goes by a ball or a free joint, or by nothing that is known"
            found += Found(left_out=(LeftOut(f"tendon {tendon.name!r}", why),))
            continue
        found += Found(left_out=along.left_out)
        if not along.moves:
            found += Found(left_out=(LeftOut(f"tendon {tendon.name!r}", "no joint that moves changes its length"),))
            continue
        left_out: list[LeftOut] = []
        elements = tuple(_elements(tendon, along, left_out, partial(slack_length, along, names, bare)))
        limits = tuple(_limits(tendon, along))
        found += Found(elements=elements, limits=limits, left_out=tuple(left_out))
    return found


def _elements(tendon: Any, along: Along, left_out: list[LeftOut], slack: Callable[[], float]) -> Iterator[Element]:
    name = tendon.name
    stiffness, *higher = map(float, tendon.stiffness)
    if any(higher) or stiffness < 0.0:
        left_out.append(LeftOut(f"stiffness of the tendon {name!r} beyond a spring", "its spring is linear here"))
    if stiffness > 0.0:
        low, high = (slack() if rest == -1.0 else float(rest) for rest in tendon.springlength)
        yield spring(along, stiffness, low - along.offset, high - along.offset, f"spring.{name}")
    damping, *more = map(float, tendon.damping)
    if any(more) or damping < 0.0:
        left_out.append(LeftOut(f"damping of the tendon {name!r} beyond the linear", "it is linear here"))
    if damping > 0.0:
        yield NonlinearDamping(along.scalar, (damping,), name=f"damping.{name}")
    if tendon.frictionloss > 0.0:
        yield CoulombFriction(along.scalar, float(tendon.frictionloss), FRICTION_SPEED, name=f"friction.{name}")
    if tendon.armature > 0.0:
        if along.of_paths:
            left_out.append(LeftOut(f"armature of the tendon {name!r}", "an armature is geared to variables"))
        else:
            yield Armature(along.scalar, float(tendon.armature), name=f"armature.{name}")
    if is_limited(tendon.actfrclimited, tendon.actfrcrange, tendon.compiler):
        left_out.append(LeftOut(f"actuatorfrcrange of the tendon {name!r}", "only single inputs are bounded"))


def spring(along: Along, stiffness: float, low: float, high: float, name: str) -> Element:
    """Return a spring that is slack between two values of the scalar without its offset."""
    if low < high:
        below, above = [stiffness * (low - 1.0 - low), stiffness], [0.0, stiffness]
        curve = Curve.from_pieces([low - 1.0, low, high, high + 1.0], [below, [0.0, 0.0], above])
        return NonlinearSpring(along.scalar, curve, name=name)
    if not along.of_paths:
        return JointSpring(along.scalar, stiffness, low, name=name)
    if low > 0.0:
        return ElasticString(along.scalar, stiffness, low, tension_only=False, name=name)
    return NonlinearSpring(along.scalar, Curve.from_pieces([low, low + 1.0], [[0.0, stiffness]]), name=name)


def _limits(tendon: Any, along: Along) -> Iterator[Bound | PathBound]:
    if not is_limited(tendon.limited, tendon.range, tendon.compiler):
        return
    low, high = (float(end) - along.offset for end in tendon.range)
    if along.of_paths:
        yield PathBound(along.scalar, low, high, name=tendon.name)
    else:
        yield Bound(along.scalar, low, high, of="variable")
