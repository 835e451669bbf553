"""What the links of a URDF look like, and where its meshes are."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.urdf.attributes import numbers, origin
from leastaction.mechanics.description.shapes import Shape

Color = tuple[float, float, float, float]
_GREY: Color = (0.62, 0.66, 0.71, 1.0)


def shapes_of(
    root: ET.Element, links: Mapping[str, ET.Element], path: Path, packages: Sequence[Path], left_out: list[LeftOut]
) -> list[Shape]:
    """Return what is to be seen of the links; of a file that has nothing to be seen, what collides."""
    colors = {str(material.get("name")): _color(material, {}) for material in root.findall("material")}
    tag = "visual" if any(link.find("visual") is not None for link in links.values()) else "collision"
    collisions = sum(len(link.findall("collision")) for link in links.values())
    if collisions:
        left_out.append(LeftOut(f"{collisions} collision shapes", "bodies pass through each other"))
    shapes: list[Shape] = []
    missing: list[str] = []
    for name, link in links.items():
        for element in link.findall(tag):
            shape = _shape(name, element, colors, path, packages, missing)
            if shape is not None:
                shapes.append(shape)
    left_out += [LeftOut(f"mesh {file!r}", "the file was not found; packages=[...] says where") for file in missing]
    return shapes


def _shape(
    link: str,
    element: ET.Element,
    colors: Mapping[str, Color],
    path: Path,
    packages: Sequence[Path],
    missing: list[str],
) -> Shape | None:
    what, geometry = f"link {link!r}: {element.tag}", element.find("geometry")
    pose, color = origin(element, what), _color(element.find("material"), colors)
    name = element.get("name") or ""
    for kind in () if geometry is None else list(geometry):
        if kind.tag == "box":
            size = numbers(kind, "size", "0 0 0", what)
            return Shape(frame=link, kind="box", size=size, pose=pose, color=color, name=name)
        if kind.tag == "sphere":
            size = numbers(kind, "radius", "0", what)
            return Shape(frame=link, kind="sphere", size=size, pose=pose, color=color, name=name)
        if kind.tag in ("cylinder", "capsule"):
            size = np.hstack([numbers(kind, "radius", "0", what), numbers(kind, "length", "0", what)])
            round_ends = kind.tag == "capsule"
            return Shape(
                frame=link, kind="capsule" if round_ends else "cylinder", size=size, pose=pose, color=color, name=name
            )
        if kind.tag == "mesh":
            address, size = kind.get("filename") or "", numbers(kind, "scale", "1 1 1", what)
            file = find_file(address, path, packages)
            if file is not None:
                return Shape(frame=link, kind="mesh", size=size, pose=pose, color=color, file=file, name=name)
            if address not in missing:
                missing.append(address)
    return None


def _color(material: ET.Element | None, known: Mapping[str, Color]) -> Color:
    if material is None:
        return _GREY
    color = material.find("color")
    if color is None:
        return known.get(str(material.get("name")), _GREY)
    r, g, b, a = numbers(color, "rgba", "0 0 0 1", f"material {material.get('name')!r}").tolist()
    return r, g, b, a


def find_file(address: str, path: Path, packages: Sequence[Path]) -> Path | None:
    """Return the file that an address in a URDF means, or None.

    ``package://name/rest`` is looked for as ``name/rest`` in each of the folders and those above the URDF, and as
    ``rest`` in folders that are called ``name``; anything else beside the URDF.
    """
    parts = urlparse(address)
    if parts.scheme not in ("package", "model"):
        plain = unquote(parts.path) if parts.scheme == "file" else address
        candidates = [path.parent / plain, *(folder / plain for folder in packages)]
        return next((file for file in candidates if file.is_file()), None)
    name, rest = parts.netloc, unquote(parts.path).lstrip("/")
    above = list(path.resolve().parents)
    for folder in [*packages, *above]:
        found = [folder / name / rest] + ([folder / rest] if folder.name == name or folder in packages else [])
        for file in found:
            if file.is_file():
                return file
    return None
