"""The meshes of an MJCF: where their files are, and what is in them."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import MissingExtraError
from leastaction.io.mechanisms.mjcf.geometry import Moments, mesh
from leastaction.io.mechanisms.mjcf.spec import mujoco_module
from leastaction.io.mechanisms.poses import pose_of, rotation_of
from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class Triangles:
    """A mesh as it is in its file, before it is scaled: vertices (n, 3) and triangles (m, 3)."""

    vertices: Array
    triangles: npt.NDArray[np.int64]


class Meshes:
    """The meshes of a specification, each read at most once."""

    def __init__(self, spec: Any, path: Path) -> None:
        self._spec, self._path = spec, path
        self._named = {mesh.name or Path(mesh.file).stem: mesh for mesh in spec.meshes}
        self._read: dict[str, Triangles | None] = {}
        self._moments: dict[str, Moments | None] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._named

    def scale(self, name: str) -> Array:
        """Return the factors along the axes."""
        return np.array(self._named[name].scale, dtype=np.float64)

    def origin(self, name: str) -> Array:
        """Return the pose of the mesh's own axes in the geom's, scaled by the factors: from its ``refpos``."""
        each = self._named[name]
        R = rotation_of(each.refquat).T
        return pose_of(-self.scale(name) * (R @ np.array(each.refpos)), R)

    def file(self, name: str) -> Path | None:
        """Return the file, or None if it is not found or there is none."""
        each = self._named[name]
        if not each.file:
            return None
        file, folder = Path(each.file), Path(each.compiler.meshdir or self._spec.compiler.meshdir or "")
        candidates = [self._path.parent / folder / file, self._path.parent / file]
        if self._spec.strippath:
            candidates.append(self._path.parent / folder / file.name)
        return next((found for found in candidates if found.is_file()), None)

    def wanted(self, name: str) -> str:
        """Return the file as it is written, for messages."""
        return str(self._named[name].file or name)

    def inline(self, name: str) -> Triangles | None:
        """Return a mesh that is written in the MJCF itself; of one without triangles its hull."""
        vertices = np.array(list(self._named[name].uservert), dtype=np.float64).reshape(-1, 3)
        if not len(vertices):
            return None
        faces = np.array(list(self._named[name].userface), dtype=np.int64).reshape(-1, 3)
        return Triangles(vertices, faces) if len(faces) else hull(vertices)

    def moments(self, name: str) -> Moments | None:
        """Return the mass properties at unit density in the geom's axes; None if there is no mesh to be read."""
        if name not in self._moments:
            self._moments[name] = self._computed(name)
        return self._moments[name]

    def _computed(self, name: str) -> Moments | None:
        given = self.inline(name)
        if given is None:
            file = self.file(name)
            given = None if file is None else read_triangles(file)
        if given is None or not len(given.triangles):
            return None
        kinds = mujoco_module().mjtMeshInertia
        how = {
            int(kinds.mjMESH_INERTIA_CONVEX): "convex",
            int(kinds.mjMESH_INERTIA_EXACT): "exact",
            int(kinds.mjMESH_INERTIA_LEGACY): "legacy",
            int(kinds.mjMESH_INERTIA_SHELL): "shell",
        }[int(self._named[name].inertia)]
        each = self._named[name]
        R = rotation_of(each.refquat).T
        vertices = ((given.vertices - np.array(each.refpos)) @ R.T) * self.scale(name)
        triangles = given.triangles
        if np.prod(self.scale(name)) < 0.0:
            triangles = triangles[:, ::-1]
        if how == "convex":
            outside = hull(vertices)
            vertices, triangles = outside.vertices, outside.triangles
        return mesh(vertices, triangles, how)  # type: ignore[arg-type]


def hull(vertices: Array) -> Triangles:
    """Return the convex hull of points, its triangles turned outwards."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(vertices)
    triangles = found.simplices.copy()
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("ij,ij->i", normals, found.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return Triangles(vertices, triangles)


def read_triangles(file: Path) -> Triangles | None:
    """Return the triangles of a mesh file in single precision, as MuJoCo has them; None if it cannot be read."""
    if file.suffix.lower() == ".msh":
        return _legacy_msh(file)
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError(
            f"the mass of {file.name} is that of a mesh, which trimesh reads; install it with: "
            "pip install 'leastaction[models]'"
        ) from error
    try:
        loaded: Any = trimesh.load(file, process=False, force="mesh", skip_materials=True)
    except Exception:
        return None
    vertices = np.asarray(loaded.vertices, dtype=np.float32).astype(np.float64)
    return Triangles(vertices, np.asarray(loaded.faces, dtype=np.int64))


def _legacy_msh(file: Path) -> Triangles | None:
    data = file.read_bytes()
    if len(data) < 16:
        return None
    n, normals, coordinates, faces = struct.unpack("<4i", data[:16])
    vertices = np.frombuffer(data, "<f4", 3 * n, 16).astype(np.float64).reshape(-1, 3)
    at = 16 + 4 * (3 * n + 3 * normals + 2 * coordinates)
    return Triangles(vertices, np.frombuffer(data, "<i4", 3 * faces, at).astype(np.int64).reshape(-1, 3))
