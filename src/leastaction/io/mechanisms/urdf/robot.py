"""The links and joints of a URDF, as parts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from leastaction.errors import ModelFileError, closest, some
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import JointPart, LinkPart, MassPart, Robot, world_name
from leastaction.io.mechanisms.urdf.attributes import named, number, numbers, origin
from leastaction.io.mechanisms.urdf.joints import joints_of
from leastaction.io.mechanisms.urdf.shapes import shapes_of

_GRAVITY = np.array([0.0, 0.0, -9.81])
_SILENT = {"link", "joint", "material"}


def read_urdf(root: ET.Element, path: Path, packages: Sequence[Path]) -> Robot:
    """Return the parts of a URDF.

    ``root``: its outermost element. ``packages``: folders in which packages are looked for. Raises `ModelFileError`.
    """
    try:
        return _read(root, path, packages)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None


def _read(root: ET.Element, path: Path, packages: Sequence[Path]) -> Robot:
    elements = {}
    for element in root.findall("link"):
        name = named(element, "a <link>")
        if name in elements:
            raise ModelFileError(f"two links are called {name!r}; names of links are unique")
        elements[name] = element
    left_out: list[LeftOut] = []
    links: list[LinkPart] = []
    places: dict[str, int] = {}
    for name, joint in _in_order(root, elements):
        parent = -1 if joint is None else places[_link_of(joint, "parent", elements)]
        what = f"link {name!r}"
        places[name] = len(links)
        links.append(
            LinkPart(
                name=name,
                parent=parent,
                pose=origin(joint, what),
                joints=() if joint is None else joints_of(joint, left_out),
                mass=_mass(elements[name].find("inertial"), what),
            )
        )
    links = [replace(link, joints=tuple(_settled(j, root, left_out) for j in link.joints)) for link in links]
    shapes = shapes_of(root, elements, path, packages, left_out)
    for tag, count in Counter(str(e.tag) for e in root if e.tag not in _SILENT).items():
        what = f"<{tag}>" if count == 1 else f"{count} <{tag}>"
        left_out.append(LeftOut(what, "a mechanism has no use for it"))
    return Robot(
        name=root.get("name") or path.stem,
        links=tuple(links),
        gravity=_GRAVITY,
        world=world_name(list(elements)),
        shapes=tuple(shapes),
        left_out=tuple(left_out),
    )


def _settled(joint: JointPart, root: ET.Element, left_out: list[LeftOut]) -> JointPart:
    """Return a joint that follows another if there is that other."""
    known = [str(element.get("name")) for element in root.findall("joint") if element.get("type") != "fixed"]
    if joint.mimic is None or joint.mimic.joint in known:
        return joint
    why = f"there is no joint {joint.mimic.joint!r} that moves; it has a variable of its own"
    left_out.append(LeftOut(f"mimic of the joint {joint.name!r}", why))
    return replace(joint, mimic=None)


def _link_of(joint: ET.Element, tag: str, links: dict[str, ET.Element]) -> str:
    what = f"joint {joint.get('name')!r}"
    end = joint.find(tag)
    name = None if end is None else end.get("link")
    if name is None:
        raise ModelFileError(f"{what}: its <{tag} link=...> is missing")
    if name not in links:
        raise ModelFileError(f"{what}: its {tag} is an unknown link {name!r}; {closest(name, links, what='links')}")
    return name


def _in_order(root: ET.Element, links: dict[str, ET.Element]) -> list[tuple[str, ET.Element | None]]:
    """Return the links with the joints before them, depth first in the order of the joints."""
    before: dict[str, ET.Element] = {}
    children: dict[str, list[str]] = {name: [] for name in links}
    for joint in root.findall("joint"):
        named(joint, "a <joint>")
        parent, child = _link_of(joint, "parent", links), _link_of(joint, "child", links)
        if child in before:
            both = f"{before[child].get('name')!r} and {joint.get('name')!r}"
            raise ModelFileError(
                f"the link {child!r} is the child of two joints, {both}; close the loop by a constraint"
            )
        before[child] = joint
        children[parent].append(child)
    stack: list[str] = [name for name in reversed(links) if name not in before]
    if len(stack) > 1:
        raise ModelFileError(
            f"{len(stack)} links are the child of no joint, {some([repr(n) for n in reversed(stack)], 6)}; expected "
            "one, the root: hang the others on it by joints, 'fixed' if they stand still, 'floating' if they are free"
        )
    order: list[tuple[str, ET.Element | None]] = []
    while stack:
        name = stack.pop()
        order.append((name, before.get(name)))
        stack.extend(reversed(children[name]))
    if len(order) < len(links):
        met = {name for name, _ in order}
        raise ModelFileError(f"the links {some([n for n in links if n not in met], 6)} hang on each other in a circle")
    return order


def _mass(inertial: ET.Element | None, what: str) -> MassPart | None:
    if inertial is None:
        return None
    mass = number(inertial.find("mass"), "value", 0.0, f"{what}: mass")
    at = origin(inertial, f"{what}: inertial")
    moments = inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (
        float(numbers(moments, entry, "0", f"{what}: inertia")[0])
        for entry in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    I = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # noqa: E741
    R = at[:3, :3]
    if not mass and not I.any():
        return None
    return MassPart(mass, at[:3, 3], R @ I @ R.T)
