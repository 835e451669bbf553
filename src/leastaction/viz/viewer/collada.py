"""Collada (.dae): the triangles of a file, in metres and with z up, each piece with its colour."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.viz.viewer.solids import Solid, Triangles

Colour = tuple[float, float, float, float]
_UP = {"X_UP": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "Y_UP": [[1, 0, 0], [0, 0, -1], [0, 1, 0]]}
_NO_TAG = "{*}"


@dataclass(frozen=True)
class ColouredMesh:
    """A piece of a mesh, and its colour where the file says one."""

    solid: Solid
    colour: Colour | None


def read_collada(path: Path) -> tuple[ColouredMesh, ...]:
    """Read the meshes of a file where its scene places them.

    Raises `ArgumentError`: the file is no Collada, or holds no triangles.
    """
    try:
        root = ET.parse(path).getroot()
        pieces = _ColladaReader(root).pieces()
    except (ET.ParseError, ValueError, IndexError, KeyError, AttributeError) as error:
        raise ArgumentError(f"{path}: this Collada file cannot be read: {error}") from error
    if not pieces:
        raise ArgumentError(f"{path}: this Collada file has no triangles")
    return tuple(pieces)


def _numbers(element: ET.Element | None, dtype: type = float) -> Array:
    return np.array((element.text or "").split() if element is not None else [], dtype=dtype)


class _ColladaReader:
    """One file: its elements by their ids."""

    def __init__(self, root: ET.Element) -> None:
        self.root = root
        self.ids = {each.get("id"): each for each in root.iter() if each.get("id")}
        unit = root.find(f"{_NO_TAG}asset/{_NO_TAG}unit")
        axis = root.findtext(f"{_NO_TAG}asset/{_NO_TAG}up_axis", "Y_UP").strip()
        self.base = np.eye(4)
        self.base[:3, :3] = np.array(_UP.get(axis, np.eye(3))) * (
            float(unit.get("meter", "1")) if unit is not None else 1.0
        )

    def of(self, url: str | None) -> ET.Element:
        return self.ids[(url or "").removeprefix("#")]

    def pieces(self) -> list[ColouredMesh]:
        """Return all meshes of the scene."""
        scene = self.root.find(f"{_NO_TAG}scene/{_NO_TAG}instance_visual_scene")
        where = self.of(scene.get("url")) if scene is not None else None
        found: list[ColouredMesh] = []
        for node in where.findall(f"{_NO_TAG}node") if where is not None else ():
            self._walk(node, self.base, found)
        return found

    def _walk(self, node: ET.Element, pose: Array, found: list[ColouredMesh]) -> None:
        for child in node:
            tag = child.tag.rpartition("}")[2]
            if tag in ("matrix", "translate", "rotate", "scale"):
                pose = pose @ _transform(tag, _numbers(child))
            elif tag == "node":
                self._walk(child, pose, found)
            elif tag == "instance_node":
                self._walk(self.of(child.get("url")), pose, found)
            elif tag == "instance_geometry":
                bound = {m.get("symbol"): m.get("target") for m in child.findall(f".//{_NO_TAG}instance_material")}
                for solid, material in self._geometry(self.of(child.get("url"))):
                    p = solid.p @ pose[:3, :3].T + pose[:3, 3]
                    found.append(ColouredMesh(Solid(p, solid.triangles), self._colour(bound.get(material, material))))

    def _geometry(self, geometry: ET.Element) -> list[tuple[Solid, str | None]]:
        found = []
        for kind in ("triangles", "polylist", "polygons"):
            for group in geometry.findall(f".//{_NO_TAG}{kind}"):
                inputs = {i.get("semantic"): i for i in group.findall(f"{_NO_TAG}input")}
                stride = 1 + max(int(i.get("offset", "0")) for i in inputs.values())
                vertex = inputs["VERTEX"]
                source = next(
                    i
                    for i in self.of(vertex.get("source")).findall(f".//{_NO_TAG}input")
                    if i.get("semantic") == "POSITION"
                )
                p = _numbers(self.of(source.get("source")).find(f"{_NO_TAG}float_array")).reshape(-1, 3)
                lists = [_numbers(each, np.int64) for each in group.findall(f"{_NO_TAG}p")]
                corners = [each[int(vertex.get("offset", "0")) :: stride].astype(np.int64) for each in lists]
                counts = _numbers(group.find(f"{_NO_TAG}vcount"), np.int64).astype(np.int64)
                if kind == "polygons":
                    counts = np.array([len(each) for each in corners], dtype=np.int64)
                index = np.concatenate(corners) if corners else np.empty(0, dtype=np.int64)
                triangles = index.reshape(-1, 3) if kind == "triangles" else _fans(index, counts)
                if len(triangles):
                    found.append((Solid(p, triangles), group.get("material")))
        return found

    def _colour(self, material: str | None) -> Colour | None:
        try:
            effect = self.of(self.of(material).find(f"{_NO_TAG}instance_effect").get("url"))  # type: ignore[union-attr]
        except (KeyError, AttributeError):
            return None
        values = _numbers(effect.find(f".//{_NO_TAG}diffuse/{_NO_TAG}color"))
        # A file's alpha has several meanings, and glass is drawn as badly as it is read; so all is opaque.
        return (float(values[0]), float(values[1]), float(values[2]), 1.0) if len(values) >= 3 else None


def _transform(tag: str, values: Array) -> Array:
    """Return one of the transformations of a node as a matrix (4, 4)."""
    result = np.eye(4)
    if tag == "matrix":
        return values.reshape(4, 4)
    if tag == "translate":
        result[:3, 3] = values
    elif tag == "scale":
        result[:3, :3] = np.diag(values)
    else:
        axis, angle = values[:3] / np.linalg.norm(values[:3]), np.radians(values[3])
        K = np.cross(np.eye(3), axis)
        result[:3, :3] = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return result


def _fans(index: Triangles, counts: Triangles) -> Triangles:
    """Return polygons as fans of triangles."""
    starts = np.concatenate(([0], np.cumsum(counts)[:-1])).astype(np.int64)
    found = []
    for size in np.unique(counts[counts >= 3]):
        at = starts[counts == size]
        found += [np.stack((index[at], index[at + k], index[at + k + 1]), -1) for k in range(1, size - 1)]
    return np.concatenate(found) if found else np.empty((0, 3), dtype=np.int64)
