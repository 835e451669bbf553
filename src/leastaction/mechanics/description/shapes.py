"""What a frame looks like: primitives and meshes, as data that files bring and pictures show.

A shape has no mass and touches nothing; bodies have the masses.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.frozen import Frozen

ShapeKind = Literal["box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh"]
SIZES: Final = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "ellipsoid": 3, "mesh": 3}


@dataclass(frozen=True, kw_only=True)
class Shape(Frozen):
    """A primitive or a mesh that is fixed to a frame.

    Parameters
    ----------
    frame : str
        The frame that carries it.
    kind : str
        "box", "sphere", "cylinder", "capsule", "ellipsoid" or "mesh".
    size : array_like
        Full side lengths (3) of a box, the radius (1) of a sphere, radius and length (2) of a cylinder or a capsule
        along z (that of a capsule without its caps), semi-axes (3) of an ellipsoid (m); factors (3) of a mesh.
    pose : array_like, shape (4, 4)
        Where its centre and axes, or the origin of the mesh, are in the frame.
    color : tuple of float
        Red, green, blue and opacity, 0 to 1.
    file : Path or None
        The mesh's file.
    vertices, triangles : ndarray (n, 3) and (m, 3), or None
        The mesh itself, where it is not in a file: places (m, before ``size``), and three indices for each triangle.
    name : str
        What it is called; may be empty.

    Raises
    ------
    DescriptionError
        For another kind, a size that does not fit it, or a mesh that has neither a file nor triangles.
    """

    frame: str
    kind: ShapeKind
    size: Array
    pose: Array = field(default_factory=lambda: np.eye(4))
    color: tuple[float, float, float, float] = (0.62, 0.66, 0.71, 1.0)
    file: Path | None = None
    vertices: Array | None = None
    triangles: Array | None = None
    name: str = ""

    def __post_init__(self) -> None:
        """Check what was given."""
        what = f"Shape on {self.frame!r}"
        if self.kind not in get_args(ShapeKind):
            raise DescriptionError(f"{what}: got the kind {self.kind!r}, expected one of {', '.join(SIZES)}")
        object.__setattr__(self, "size", as_array(self.size, f"{what}: size", (SIZES[self.kind],)))
        object.__setattr__(self, "pose", as_array(self.pose, f"{what}: pose", (4, 4)))
        if self.kind == "mesh" and self.file is None and (self.vertices is None or self.triangles is None):
            raise DescriptionError(f"{what}: a mesh needs a file, or vertices and triangles")
        super().__post_init__()

    @classmethod
    def rod(
        cls,
        frame: str,
        start: ArrayLike,
        end: ArrayLike,
        radius: float,
        color: tuple[float, float, float, float] = (0.62, 0.66, 0.71, 1.0),
    ) -> Self:
        """Return a capsule from one place (3,) in the frame to another (m).

        Raises
        ------
        DescriptionError
            Two places that are one.
        """
        a, b = (as_array(each, f"Shape on {frame!r}: {what}", (3,)) for each, what in ((start, "start"), (end, "end")))
        length = float(np.linalg.norm(b - a))
        if length == 0.0:
            raise DescriptionError(f"Shape on {frame!r}: got a rod from {a.tolist()} to itself, expected two places")
        z = (b - a) / length
        x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
        x /= np.linalg.norm(x)
        pose = np.eye(4)
        pose[:3] = np.stack([x, np.cross(z, x), z, 0.5 * (a + b)], axis=1)
        return cls(frame=frame, kind="capsule", size=np.array([radius, length]), pose=pose, color=color)
