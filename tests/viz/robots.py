"""Robots for pictures: frames, joints and visuals of a URDF file, as little of it as a picture needs."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from leastaction import Body, Mechanism, free, pose, prismatic, revolute
from leastaction.mechanics.description.shapes import Shape


def _numbers(element: ET.Element | None, key: str, default: str) -> list[float]:
    return [float(x) for x in (default if element is None else element.get(key, default)).split()]


def _origin(element: ET.Element) -> np.ndarray[Any, Any]:
    at = element.find("origin")
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", _numbers(at, "rpy", "0 0 0")).as_matrix()
    result[:3, 3] = _numbers(at, "xyz", "0 0 0")
    return result


def robot(path: Path, packages: Path, *, floating: bool) -> tuple[Mechanism, tuple[Shape, ...]]:
    """Return a robot and its visuals; bodies are all a kilogram, as only pictures are made."""
    root = ET.parse(path).getroot()
    colours = {m.get("name"): _numbers(m.find("color"), "rgba", "0.62 0.66 0.71 1") for m in root.findall("material")}
    children: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        children.setdefault(joint.find("parent").get("link"), []).append(joint)  # type: ignore[union-attr, arg-type]
    moved = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    (base,) = [link.get("name") for link in root.findall("link") if link.get("name") not in moved]
    shapes: list[Shape] = []

    def below(link: str) -> list[Any]:
        result: list[Any] = []
        for joint in children.get(link, []):
            name, child = str(joint.get("name")), str(joint.find("child").get("link"))  # type: ignore[union-attr]
            axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
            body = {"name": f"{child}", "bodies": [Body(1.0, inertia=[0.01] * 3)]}
            kind = joint.get("type")
            if kind == "fixed":
                moving = pose(_origin(joint), **body)
                result += [moving, below(child)]
                continue
            make = prismatic if kind == "prismatic" else revolute
            result += [pose(_origin(joint), name=f"{name} base"), [make(name, axis=axis, **body), below(child)]]
        return result

    for link in root.findall("link"):
        for visual in link.findall("visual"):
            geometry = visual.find("geometry")
            assert geometry is not None
            material = visual.find("material")
            colour = (0.62, 0.66, 0.71, 1.0)
            if material is not None:
                own = material.find("color")
                colour = tuple(colours.get(material.get("name"), colour) if own is None else _numbers(own, "rgba", ""))  # type: ignore[assignment]
            common = {"frame": str(link.get("name")), "pose": _origin(visual), "color": colour}
            mesh, box, ball, rod = (geometry.find(tag) for tag in ("mesh", "box", "sphere", "cylinder"))
            if mesh is not None:
                file = packages / str(mesh.get("filename")).removeprefix("package://")
                shapes.append(Shape(kind="mesh", size=_numbers(mesh, "scale", "1 1 1"), file=file, **common))  # type: ignore[arg-type]
            elif box is not None:
                shapes.append(Shape(kind="box", size=_numbers(box, "size", ""), **common))  # type: ignore[arg-type]
            elif ball is not None:
                shapes.append(Shape(kind="sphere", size=_numbers(ball, "radius", ""), **common))  # type: ignore[arg-type]
            elif rod is not None:
                size = _numbers(rod, "radius", "") + _numbers(rod, "length", "")
                shapes.append(Shape(kind="cylinder", size=size, **common))  # type: ignore[arg-type]
    if floating:
        return Mechanism([free("root", name=base, mass=1.0, inertia=[0.1] * 3), below(str(base))]), tuple(shapes)
    if base == "world":
        return Mechanism(below("world")), tuple(shapes)
    return Mechanism([pose(np.eye(4), name=base), below(str(base))]), tuple(shapes)
