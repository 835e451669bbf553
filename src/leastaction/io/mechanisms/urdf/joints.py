"""The joints of a URDF: what moves, how far, how fast, and what follows what."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from leastaction.errors import ModelFileError
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import JointPart, Mimic, Range
from leastaction.io.mechanisms.urdf.attributes import named, number, numbers
from leastaction.numerics.arrays import Array

_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


def joints_of(element: ET.Element, left_out: list[LeftOut]) -> tuple[JointPart, ...]:
    """Return the joints that one joint of a URDF is: none if it is fixed, three if it is planar."""
    name, kind = named(element, "a <joint>"), element.get("type")
    what = f"joint {name!r}"
    if kind not in _KINDS:
        raise ModelFileError(f"{what}: its type is {kind!r}, expected one of {', '.join(_KINDS)}")
    left_out += [
        LeftOut(f"{tag} of the joint {name!r}", "a mechanism has no use for it")
        for tag in ("safety_controller", "calibration")
        if element.find(tag) is not None
    ]
    if kind == "fixed":
        return ()
    if kind == "floating":
        return (JointPart(name=name, kind="free"),)
    axis = numbers(element.find("axis"), "xyz", "1 0 0", what)
    if not axis.any():
        raise ModelFileError(f"{what}: its axis is zero; expected a direction, such as '0 0 1'")
    if kind == "planar":
        return _planar(name, axis / np.linalg.norm(axis))
    joint = _simple(element, name, kind, axis, what)
    limit = element.find("limit")
    low, high = number(limit, "lower", 0.0, what), number(limit, "upper", 0.0, what)
    if kind != "continuous" and low > high:
        left_out.append(LeftOut(f"range of the joint {name!r}", f"it ends at {high:g}, below where it begins, {low:g}"))
    return (joint,)


def _simple(element: ET.Element, name: str, kind: str, axis: Array, what: str) -> JointPart:
    limit, dynamics, mimic = element.find("limit"), element.find("dynamics"), element.find("mimic")
    effort = number(limit, "effort", np.inf, what)
    speed = number(limit, "velocity", np.inf, what)
    follows = None
    if mimic is not None:
        other = mimic.get("joint")
        if not other:
            raise ModelFileError(f"{what}: its <mimic joint=...> is missing")
        follows = Mimic(other, number(mimic, "multiplier", 1.0, what), number(mimic, "offset", 0.0, what))
    return JointPart(
        name=name,
        kind="slide" if kind == "prismatic" else "hinge",
        axis=axis / np.linalg.norm(axis),
        range=(None, None) if kind == "continuous" or limit is None else _range(limit, what),
        speed=speed if 0.0 < speed < np.inf else None,
        effort=(-effort, effort) if 0.0 < effort < np.inf else (None, None),
        damping=(number(dynamics, "damping", 0.0, what),),
        friction=number(dynamics, "friction", 0.0, what),
        mimic=follows,
    )


def _range(limit: ET.Element, what: str) -> Range:
    low, high = number(limit, "lower", 0.0, what), number(limit, "upper", 0.0, what)
    if low >= high:  # nothing that could be meant: files write zeros for "not known"
        return None, None
    return (low if np.isfinite(low) else None), (high if np.isfinite(high) else None)


def _planar(name: str, normal: Array) -> tuple[JointPart, ...]:
    side = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(normal, np.cross(side, normal))
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    return (
        JointPart(name=f"{name}.x", kind="slide", axis=first),
        JointPart(name=f"{name}.y", kind="slide", axis=second),
        JointPart(name=f"{name}.rz", kind="hinge", axis=normal),
    )
