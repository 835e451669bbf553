"""Attributes of a URDF's elements, checked; every error names the link or joint."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from leastaction.errors import ModelFileError
from leastaction.io.mechanisms.poses import of_roll_pitch_yaw, pose_of
from leastaction.numerics.arrays import Array


def numbers(element: ET.Element | None, attribute: str, default: str, what: str) -> Array:
    """Return the numbers of an attribute, as many as the default has."""
    given = default if element is None else element.get(attribute, default)
    try:
        values = np.array([float(part) for part in given.split()])
    except ValueError:
        values = np.empty(0)
    count = len(default.split())
    if len(values) != count or not np.isfinite(values).all():
        tag = "" if element is None else f"<{element.tag}> "
        raise ModelFileError(f"{what}: {tag}{attribute}={given!r}, expected {count} number{'s' if count > 1 else ''}")
    return values


def number(element: ET.Element | None, attribute: str, default: float, what: str) -> float:
    """Return the number of an attribute; an infinite one, as some files write for none, too."""
    given = None if element is None else element.get(attribute)
    if given is None:
        return default
    try:
        value = float(given)
    except ValueError:
        value = np.nan
    if np.isnan(value):
        raise ModelFileError(f"{what}: {attribute}={given!r}, expected a number")
    return value


def origin(element: ET.Element | None, what: str) -> Array:
    """Return the pose (4, 4) of an element's ``<origin>``; the identity without one."""
    at = None if element is None else element.find("origin")
    place, angles = numbers(at, "xyz", "0 0 0", what), numbers(at, "rpy", "0 0 0", what)
    return pose_of(place, of_roll_pitch_yaw(angles.tolist()))


def named(element: ET.Element, what: str) -> str:
    """Return the name of an element."""
    name = (element.get("name") or "").strip()
    if not name:
        raise ModelFileError(f"{what}: a name is missing")
    return name
