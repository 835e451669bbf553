"""Joints of several parameters as compositions of simple ones: universal, ball and free joints.

A composition stands in a description like a frame: bodies, a name and children belong to the last of its frames. Its
variables are the parameters of the simple joints, so everything that can be done with a variable can be done with them.

A ball (and the rotation of a free joint) is one rotation that is held as a unit quaternion and has no singularity: four
numbers ``name.qw name.qx name.qy name.qz`` in the configuration, scalar first, and three rates ``name.wx name.wy
name.wz``, the angular velocity in the axes of the moved frame. With ``axes="xyz"``, or other letters, it is three
rotations, hence Euler angles.

Angles have their singularity: where the middle angle is 90 degrees (any three different axes), or 0 (first and last
axis the same), the outer and the inner axis are parallel, the angles are not determined by the motion, and the mass
matrix is singular. No choice of three angles is free of it; choose ``axes`` so that the motion stays away from it.
`MidpointVI` warns (`SingularityWarning`) when a simulation comes near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import eq
from typing import Unpack

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.affine import CoordinateLike, as_affine
from leastaction.mechanics.description.frames import (
    QUATERNION,
    TWISTS,
    Frame,
    FrameOptions,
    Group,
    kinematic_names,
    moving,
)
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public


@public
@dataclass(frozen=True, eq=False)
class Composition:
    """Frames one behind the other that are described as one; made by `universal`, `ball` and `free`.

    Attributes
    ----------
    group : Group
        Its kind, name and axes.
    frames : tuple of Frame
        From the outermost on. The last one carries the bodies and the children.
    """

    group: Group
    frames: tuple[Frame, ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables that move it, each once."""
        return tuple(dict.fromkeys(name for frame in self.frames for name in frame.variables))

    def __repr__(self) -> str:
        return f"{self.group.kind}({', '.join(self.variables)}) {self.group.name!r}"


@public
def universal(
    variables: str | Sequence[CoordinateLike],
    *,
    axes: str = "xy",
    kinematic: bool | Sequence[str] = False,
    **options: Unpack[FrameOptions],
) -> Composition:
    """Rotate about two axes, one after the other: a universal (Cardan) joint.

    Parameters
    ----------
    variables : str or sequence of 2 coordinates
        The joint's name, for variables ``name.rx`` and ``name.ry`` (or as the axes are); or the two coordinates.
    axes : str, optional
        The axes, two different letters of ``xyz``.
    kinematic : bool or sequence of str, optional
        True if all its variables are prescribed, or the list of those that are.
    **options
        See `FrameOptions`. ``name`` is the name of the frame behind the joint; that of the joint if not given.

    Raises
    ------
    DescriptionError
        For other axes, another number of coordinates, or what a frame does not take.
    """
    return _compose("universal", variables, "", axes, 2, kinematic, options)


@public
def ball(
    variables: str | Sequence[CoordinateLike],
    *,
    axes: str | None = None,
    kinematic: bool | Sequence[str] = False,
    **options: Unpack[FrameOptions],
) -> Composition:
    """Rotate in any way: a ball joint.

    Its configuration is a unit quaternion ``name.qw``, ``name.qx``, ``name.qy``, ``name.qz``, scalar first, from the
    frame before the joint to that behind it; no rotation is 1, 0, 0, 0. Its rates are the angular velocity
    ``name.wx``, ``name.wy``, ``name.wz`` in the axes of the frame behind it (rad/s).

    Parameters
    ----------
    variables : str or sequence of 3 coordinates
        The joint's name; or of angles the three coordinates.
    axes : str, optional
        ``"quaternion"`` for that, as where it is left out of a joint with a name. Three letters of ``xyz``, no two
        neighbours the same, for Euler angles instead, rotations about these axes one after the other, ``"xyz"`` where
        it is left out of coordinates: variables ``name.rx``, ``name.ry`` and ``name.rz``, or as the axes are. If an
        axis comes twice, its second variable ends in ``2``, as in ``name.rz2``. Angles are singular where the middle
        one is 90 or -90 degrees, or 0 or 180 if the first and the last axis are the same; there they are not
        determined. A simulation that comes near warns (`SingularityWarning`).
    kinematic, **options
        As in `universal`, and so are the errors.
    """
    return _compose("ball", variables, "", axes, 3, kinematic, options)


@public
def free(
    variables: str | Sequence[CoordinateLike],
    *,
    axes: str | None = None,
    kinematic: bool | Sequence[str] = False,
    **options: Unpack[FrameOptions],
) -> Composition:
    """Translate along x, y and z, then rotate as a `ball`: a body that nothing holds.

    Its configuration is ``name.x``, ``name.y``, ``name.z`` (m), then that of the ball.

    Parameters
    ----------
    variables : str or sequence of 6 coordinates
        The joint's name; or, with angles, the six coordinates.
    axes : str, optional
        As of `ball`: a quaternion, or the axes of three angles.
    kinematic, **options
        As in `universal`, and so are the errors.
    """
    return _compose("free", variables, "xyz", axes, 3, kinematic, options)


def _compose(
    kind: str,
    variables: str | Sequence[CoordinateLike],
    slides: str,
    axes: str | None,
    turns: int,
    kinematic: bool | Sequence[str],
    options: FrameOptions,
) -> Composition:
    if axes is None:
        axes = QUATERNION if isinstance(variables, str) else "xyz"
    quaternion = str(axes) == QUATERNION and turns == 3
    if quaternion and not (isinstance(variables, str) and kinematic is False):
        raise DescriptionError(
            f"{kind}: with axes={QUATERNION!r} expected the name of a joint that is not kinematic, got {variables!r} "
            f"and kinematic={kinematic!r}; coordinates of your own and prescribed ones are angles: give their axes"
        )
    if not quaternion:
        _check_axes(axes, turns, kind)
    turned = "xyz" if quaternion else axes
    transforms = [f"t{axis}" for axis in slides] + [f"r{axis}" for axis in turned]
    own = options.copy()
    if isinstance(variables, str):
        prefix = check_name(variables, f"the name of a {kind} joint")
        letter = "w" if quaternion else "r"
        turns_of = [f"{letter}{axis}{'2' if axis in turned[:i] else ''}" for i, axis in enumerate(turned)]
        suffixes = [*slides, *turns_of]
        coordinates: list[CoordinateLike] = [f"{prefix}.{suffix}" for suffix in suffixes]
        if own.get("name") is None:
            own["name"] = prefix
    elif isinstance(variables, (list, tuple)) and len(variables) == len(transforms):
        prefix, coordinates = None, list(variables)
    else:
        raise DescriptionError(
            f"{kind}: expected a name or a list of {len(transforms)} coordinates "
            f"({', '.join(transforms)}), got {variables!r}"
        )
    parts = [as_affine(a, f"{kind}: {t}") for a, t in zip(coordinates, transforms, strict=True)]
    every = tuple(dict.fromkeys(name for part in parts for name in part.names))
    label = f"{kind}({', '.join(every)})"
    prescribed = kinematic_names(kinematic, every, label)
    group = Group(kind, prefix or own.get("name") or label, axes)
    last = len(transforms) - 1
    return Composition(
        group,
        tuple(
            moving(
                transform,
                TWISTS[transform],
                part,
                group=group,
                kinematic=[name for name in part.names if name in prescribed],
                **(own if index == last else {}),
            )
            for index, (transform, part) in enumerate(zip(transforms, parts, strict=True))
        ),
    )


def _check_axes(axes: object, count: int, kind: str) -> None:
    good = isinstance(axes, str) and len(axes) == count and set(axes) <= set("xyz")
    if not good or any(map(eq, str(axes), str(axes)[1:])):
        raise DescriptionError(
            f"{kind}: got axes {axes!r}, expected {count} letters of 'xyz', no two neighbours the same"
            f"{', or ' + repr(QUATERNION) if count == 3 else ''}"
        )
