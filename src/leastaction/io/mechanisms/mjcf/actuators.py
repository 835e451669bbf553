"""The actuators of an MJCF as forces with an input each: motors, servos, muscles, propellers.

MuJoCo's force is ``gain u + bias`` with gain and bias affine in the length of the transmission and its rate.
States of activation are none here: the input is the activation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.muscles import Bare, inertia_along, muscle
from leastaction.io.mechanisms.mjcf.places import Places
from leastaction.io.mechanisms.mjcf.scalars import Along, of_joint, of_rotation, of_tendon
from leastaction.io.mechanisms.mjcf.spec import is_limited, mujoco_module
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import JointPart
from leastaction.mechanics import Armature, BodyWrench, JointForce, NonlinearDamping, Servo, TendonForce
from leastaction.mechanics.elements import Element
from leastaction.optimal import Bound


class _LeftOutError(Exception):
    """Why an actuator is left out."""


@dataclass(frozen=True)
class _ActuatorReader:
    """What reading an actuator needs, and what it finds beside elements."""

    spec: Any
    names: Names
    places: Places
    bare: Bare
    left_out: list[LeftOut] = field(default_factory=list)


def elements_of_actuators(spec: Any, names: Names, bare: Bare) -> Found:
    """Return the actuators of a specification, and the bounds of their inputs."""
    read = _ActuatorReader(spec, names, Places(spec), bare)
    elements: list[Element] = []
    limits: list[Bound] = []
    inputs: list[str | None] = []
    for number, actuator in enumerate(spec.actuators):
        name = actuator.name or f"{actuator.target}.motor{number}"
        u = names.input(name)
        try:
            found = list(_elements(actuator, name, u, read))
        except _LeftOutError as error:
            read.left_out.append(LeftOut(f"actuator {name!r}", str(error)))
            found = []
        if not found:
            inputs.append(None)
            continue
        elements += found
        inputs.append(u)
        bound = _bound(actuator, name, u, read)
        if bound is not None:
            limits.append(bound)
    return Found(tuple(elements), tuple(limits), tuple(read.left_out), tuple(inputs))


def _elements(actuator: Any, name: str, u: str, read: _ActuatorReader) -> Iterator[Element]:
    mujoco = mujoco_module()
    gains, biases, transmissions = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtTrn
    if actuator.dyntype == mujoco.mjtDyn.mjDYN_USER or actuator.plugin.active:
        raise _LeftOutError("its law is in a program of its own")
    if actuator.gaintype not in (gains.mjGAIN_FIXED, gains.mjGAIN_AFFINE, gains.mjGAIN_MUSCLE):
        raise _LeftOutError(f"a gain of the type {_word(actuator.gaintype)} is none that a servo or a muscle has")
    if actuator.biastype not in (biases.mjBIAS_NONE, biases.mjBIAS_AFFINE, biases.mjBIAS_MUSCLE):
        raise _LeftOutError(f"a bias of the type {_word(actuator.biastype)} is none that a servo or a muscle has")
    if actuator.dyntype != mujoco.mjtDyn.mjDYN_NONE:
        why = "the input is the activation itself"
        read.left_out.append(LeftOut(f"activation dynamics of the actuator {name!r}", why))
    if actuator.trntype == transmissions.mjTRN_SITE:
        yield from _at_site(actuator, name, u, read)
        return
    along = _transmission(actuator, read)
    if actuator.gaintype == gains.mjGAIN_MUSCLE:
        if not along.of_paths:
            raise _LeftOutError("a muscle pulls along a spatial tendon here")
        yield from muscle(actuator, name, along, u, read.names, read.bare, read.left_out)
    elif actuator.biastype == biases.mjBIAS_MUSCLE:
        raise _LeftOutError("the bias of a muscle without its gain")
    else:
        yield _affine(actuator, name, u, along, read)
    yield from _passive(actuator, name, along, read)


def _word(kind: Any) -> str:
    return str(kind).rpartition("_")[2].split(":")[0].lower()


def _transmission(actuator: Any, read: _ActuatorReader) -> Along:
    """Return the length of an actuator as MuJoCo counts it; raise where it has none here."""
    kinds = mujoco_module().mjtTrn
    along, gear = None, float(actuator.gear[0])
    if actuator.trntype in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
        joint = read.names.joints.get(actuator.target)
        if joint is not None and joint.kind in ("ball", "free"):
            along, gear = _on_rotation(actuator, joint), 1.0
        else:
            along = of_joint(actuator.target, read.names)
        what = f"there is no joint {actuator.target!r} that moves"
    elif actuator.trntype == kinds.mjTRN_TENDON:
        along = of_tendon(actuator.target, read.spec, read.names, read.places)
        what = f"the tendon {actuator.target!r} goes by a ball or a free joint"
    else:
        what = {
            kinds.mjTRN_SLIDERCRANK: "a slider-crank drives no joint; build its crank and rod as bodies",
            kinds.mjTRN_BODY: "adhesion needs contact, which bodies do not have here",
        }.get(actuator.trntype, "its transmission is not known")
    if along is None:
        raise _LeftOutError(what)
    if gear == 0.0 or not along.terms:
        raise _LeftOutError("its gear is zero")
    if not along.moves:
        raise _LeftOutError(f"nothing moves {actuator.target!r}")
    return along.times(gear)


def _on_rotation(actuator: Any, joint: JointPart) -> Along:
    """Return what a motor of a ball or a free joint acts along; raise where there is no such thing here."""
    mujoco = mujoco_module()
    if joint.axes != "quaternion":
        raise _LeftOutError(f"the {joint.kind} joint {joint.name!r} has three angles here, and its axes are the link's")
    if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINTINPARENT:
        raise _LeftOutError(f"its axes are those before the {joint.kind} joint {joint.name!r}, not behind it")
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.biastype != mujoco.mjtBias.mjBIAS_NONE:
        raise _LeftOutError(f"a servo needs a length, and the {joint.kind} joint {joint.name!r} has none")
    return of_rotation(joint, actuator.gear)


def _affine(actuator: Any, name: str, u: str, along: Along, read: _ActuatorReader) -> Element:
    """Return the force of a motor or a servo, without the offset of its length."""
    mujoco = mujoco_module()
    affine = actuator.gaintype == mujoco.mjtGain.mjGAIN_AFFINE
    biased = actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
    g0, g1, g2 = map(float, actuator.gainprm[:3]) if affine else (float(actuator.gainprm[0]), 0.0, 0.0)
    b0, b1, b2 = map(float, actuator.biasprm[:3]) if biased else (0.0, 0.0, 0.0)
    if not affine and biased and g0 == -b1 and b2 > 0.0:
        b2 = -_damping_by_ratio(b2, g0, along, read)
    g0, b0 = g0 + g1 * along.offset, b0 + b1 * along.offset
    if not (g0 or g1 or g2):
        raise _LeftOutError("its gain is zero")
    if g1 == g2 == b0 == b1 == b2 == 0.0:
        if along.of_paths:
            return TendonForce(along.scalar, u, -g0, name=f"motor.{name}")
        factors: Any = along.times(g0).terms
        return JointForce(factors, u, name=f"motor.{name}")

    def some(x: float) -> float | None:
        return x if x != 0.0 else None

    return Servo(along.scalar, u, g0, some(b0), some(-b1), some(-b2), some(g1), some(g2), name=f"servo.{name}")


def _damping_by_ratio(ratio: float, stiffness: float, along: Along, read: _ActuatorReader) -> float:
    """Return the damping of a servo of place by its ratio to the critical one, of the inertia at the reference."""
    return float(2.0 * ratio * np.sqrt(stiffness * inertia_along(along, read.names, read.bare)))


def _at_site(actuator: Any, name: str, u: str, read: _ActuatorReader) -> Iterator[Element]:
    """Yield the wrench of a propeller or a jet, in the axes of its site."""
    mujoco = mujoco_module()
    if actuator.refsite:
        raise _LeftOutError("a force between two sites in the axes of one of them is no element")
    if actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED or actuator.biastype != mujoco.mjtBias.mjBIAS_NONE:
        raise _LeftOutError("feedback of the velocity of a site is no element")
    if not read.places.movers(read.places.sites[actuator.target].parent, read.names):
        raise _LeftOutError(f"nothing moves the site {actuator.target!r}")
    sizes = [float(actuator.gainprm[0] * gear) for gear in actuator.gear]
    if not any(sizes):
        raise _LeftOutError("its gear is zero")
    force, torque = ([{u: size} if size else 0.0 for size in part] for part in (sizes[:3], sizes[3:]))
    yield BodyWrench(read.names.sites[actuator.target], force, torque, name=f"motor.{name}")


def _passive(actuator: Any, name: str, along: Along, read: _ActuatorReader) -> Iterator[Element]:
    """Yield the rotor and the damping of the actuator itself."""
    damping, *more = map(float, getattr(actuator, "damping", [0.0]))
    if any(more) or damping < 0.0:
        read.left_out.append(LeftOut(f"damping of the actuator {name!r} beyond the linear", "it is linear here"))
    if damping > 0.0:
        yield NonlinearDamping(along.scalar, (damping,), name=f"damping.{name}")
    armature = float(getattr(actuator, "armature", 0.0))
    if armature > 0.0:
        if along.of_paths:
            why = "an armature is geared to variables"
            read.left_out.append(LeftOut(f"armature of the actuator {name!r}", why))
        else:
            yield Armature(along.scalar, armature, name=f"armature.{name}")


def _bound(actuator: Any, name: str, u: str, read: _ActuatorReader) -> Bound | None:
    """Return the bound of an input, of what its force may be too where that is the input times a number."""
    mujoco = mujoco_module()
    integrates = actuator.dyntype == mujoco.mjtDyn.mjDYN_INTEGRATOR
    low, high = -np.inf, np.inf
    if actuator.dyntype == mujoco.mjtDyn.mjDYN_MUSCLE:
        low, high = 0.0, 1.0
    limited, given = (
        (actuator.actlimited, actuator.actrange) if integrates else (actuator.ctrllimited, actuator.ctrlrange)
    )
    inherited = _inherited(actuator, read)
    if inherited is not None:
        low, high = inherited
    elif is_limited(limited, given, actuator.compiler):
        low, high = max(low, float(given[0])), min(high, float(given[1]))
    if is_limited(actuator.forcelimited, actuator.forcerange, actuator.compiler):
        gain = float(actuator.gainprm[0])
        fixed = actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        if fixed and gain:
            least, most = sorted(float(end) / gain for end in actuator.forcerange)
            low, high = max(low, least), min(high, most)
        else:
            why = "its force is of the motion too, and only inputs are bounded"
            read.left_out.append(LeftOut(f"forcerange of the actuator {name!r}", why))
    if not low < high:
        return None
    ends = [None if np.isinf(end) else end for end in (low, high)]
    return None if ends == [None, None] else Bound(u, ends[0], ends[1], of="input")


def _inherited(actuator: Any, read: _ActuatorReader) -> tuple[float, float] | None:
    """Return the range of the place that a servo takes over from what it drives."""
    joint = read.names.joints.get(actuator.target)
    share = float(actuator.inheritrange)
    if share <= 0.0:
        return None
    if actuator.trntype == mujoco_module().mjtTrn.mjTRN_TENDON:
        tendon = next(each for each in read.spec.tendons if each.name == actuator.target)
        ends: tuple[float | None, ...] = tuple(map(float, tendon.range))
    else:
        ends = joint.range if joint is not None else (None, None)
    low, high = ends
    if low is None or high is None:
        return None
    middle, radius = 0.5 * (low + high), 0.5 * (high - low) * share
    return middle - radius, middle + radius
