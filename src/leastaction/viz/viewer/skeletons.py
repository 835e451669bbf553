"""What a mechanism is seen as without shapes: bars between frames, balls and boxes of bodies, and its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.mechanics import Body, Mechanism
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics.arrays import Array
from leastaction.viz.scene import Bone, JointMark

_SLENDERNESS = 0.04  # radius of a bar by the mean length of all
_GROUND = (0.45, 0.48, 0.53, 1.0)
_LINKS = (
    (0.33, 0.53, 0.72, 1.0), (0.87, 0.60, 0.33, 1.0), (0.42, 0.65, 0.53, 1.0), (0.72, 0.50, 0.66, 1.0),
    (0.83, 0.73, 0.42, 1.0), (0.50, 0.56, 0.63, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Skeleton:
    """Bars, and shapes of bodies that have none; ``radius``: that of a bar (m)."""

    bones: tuple[Bone, ...]
    shapes: tuple[Shape, ...]
    radius: float


def link_colour(joint: int) -> tuple[float, float, float, float]:
    """Return the colour of what a joint carries."""
    return _GROUND if joint < 0 else _LINKS[joint % len(_LINKS)]


def skeleton(mechanism: Mechanism, q: Array) -> Skeleton:
    """Return the bars of a mechanism, and boxes, balls and bars of the bodies that no bar shows.

    ``q`` (N, nq): where it is seen.
    """
    frames = mechanism.tree.frames
    places = mechanism.positions(q, list(mechanism.tree.index))
    seen_alone = _tips(mechanism)
    lengths = {}
    for i, at in enumerate(frames[1:], start=1):
        moves = bool(at.frame.variables)
        apart = float(np.linalg.norm(places[:, i] - places[:, at.parent], axis=1).max())
        # A frame that slides away from its parent is on a rail, not on a post.
        if not moves and apart > 1e-9:
            lengths[i] = apart
    spread = float(np.linalg.norm(np.ptp(places, axis=1), axis=1).max())
    thick = [length for i, length in lengths.items() if frames[i].name not in seen_alone]
    mean = float(np.mean(thick or list(lengths.values()))) if lengths else 0.0
    radius = _SLENDERNESS * (mean or spread or 1.0)
    bones = []
    for i, length in lengths.items():
        r = min(radius, 0.2 * length) * (0.35 if frames[i].name in seen_alone else 1.0)
        r *= 1.0 + 0.02 * (frames[i].joint % 4)  # where links meet, one of them is the outer
        carrier = frames[frames[i].parent].name
        bones.append(Bone(start=carrier, end=frames[i].name, radius=r, color=link_colour(frames[i].joint)))
    barred = {frames[i].joint for i in lengths if frames[i].name not in seen_alone}
    masses = [body.mass for at in frames for body in at.frame.bodies if body.mass > 0.0]
    usual = float(np.median(masses)) if masses else 1.0
    shapes: list[Shape] = []
    for at in frames:
        for body in at.frame.bodies:
            slides = at.joint >= 0 and not mechanism.tree.joints[at.joint].twist[3:].any()
            shapes += _of_body(body, at.name, at.joint, at.joint in barred, radius, usual, carriage=slides)
    return Skeleton(tuple(bones), tuple(shapes), radius)


def _tips(mechanism: Mechanism) -> set[str]:
    """Return frames at the end of a branch that only elements hold on to: hooks and via-points, on thin stubs."""
    frames = mechanism.tree.frames
    inner = {at.parent for at in frames}
    held = {name for element in mechanism.elements.values() for look in element.looks for name in look.frames}
    return {at.name for i, at in enumerate(frames) if i not in inner and not at.frame.bodies and at.name in held}


def _of_body(
    body: Body, frame: str, joint: int, barred: bool, radius: float, usual: float, *, carriage: bool
) -> list[Shape]:
    """Return what a body is seen as: nothing where a bar stands for it, a box on a rail, else a ball."""
    if body.mass <= 0.0:
        return []
    colour = link_colour(joint)
    sides, axes = equivalent_box(body)
    pose = np.eye(4)
    pose[:3, 3] = body.com
    if not barred and sides.min() > 0.02 * sides.max() > 0.0:
        pose[:3, :3] = axes
        return [Shape(frame=frame, kind="box", size=sides, pose=pose, color=colour)]
    shapes = []
    ball = 2.0 * radius * float(np.clip((body.mass / usual) ** (1.0 / 3.0), 0.6, 2.0))
    if carriage and not barred:
        shapes.append(Shape(frame=frame, kind="box", size=np.full(3, 2.2 * ball), pose=pose, color=colour))
    elif not body.inertia.any() or not barred:
        shapes.append(Shape(frame=frame, kind="sphere", size=np.array([ball]), pose=pose, color=colour))
    if not barred and np.linalg.norm(body.com) > ball:
        shapes.append(
            Shape(
                frame=frame,
                kind="capsule",
                size=np.array([radius, np.linalg.norm(body.com)]),
                pose=_along(body.com),
                color=colour,
            )
        )
    return shapes


def equivalent_box(body: Body) -> tuple[Array, Array]:
    """Return the sides (3,) of the box with the mass and inertia of a body, and its axes (3, 3); zeros where none has.

    Of principal moments I the sides are ``a_i^2 = 6 (sum of I - 2 I_i) / m``.
    """
    moments, axes = np.linalg.eigh(body.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    squares = 6.0 * (moments.sum() - 2.0 * moments) / body.mass
    return (np.sqrt(squares), axes) if squares.min() > 0.0 else (np.zeros(3), np.eye(3))


def _along(end: Array) -> Array:
    """Return the pose of a bar from the origin to a point: its middle, with z along it."""
    z = end / np.linalg.norm(end)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3] = np.column_stack((x, np.cross(z, x), z, 0.5 * end))
    return pose


def joint_marks(mechanism: Mechanism, q: Array, size: float) -> list[JointMark]:
    """Return where the joints of a mechanism are. ``q`` (N, nq): how far they move. ``size``: of the mechanism (m)."""
    tree = mechanism.tree
    free = {i for group, indices in tree.compositions if group.kind == "free" for i in indices}
    balls = {indices[0]: indices for group, indices in tree.compositions if group.kind == "ball"}
    in_ball = {i for indices in balls.values() for i in indices}
    values, offsets = tree.coupling(range(len(tree.joints)), mechanism.coordinates)
    travel = q @ values.T + offsets
    heavy = _heavy_joints(mechanism)
    marks = []
    for k, joint in enumerate(tree.joints):
        at = tree.frames[joint.frame]
        if joint.frame in free or k not in heavy:
            continue
        if joint.frame in in_ball:
            if joint.frame in balls:
                name = next(group.name for group, indices in tree.compositions if indices[0] == joint.frame)
                marks.append(JointMark(name=name, kind="ball", frame=at.name, point=np.zeros(3), axis=np.eye(3)[2]))
            continue
        v, w = joint.twist[:3], joint.twist[3:]
        name = ", ".join(joint.variables)
        turning = float(w @ w)
        if turning > 0.0:
            axis, point = w / np.sqrt(turning), np.cross(w, v) / turning
            marks.append(JointMark(name=name, kind="hinge", frame=at.name, point=point, axis=axis))
        elif not _floats(mechanism, k):
            # A rail stays with what carries it.
            carrier = tree.frames[tree.joints[joint.parent].frame].name if joint.parent >= 0 else tree.frames[0].name
            low, high = (float(x) * float(np.linalg.norm(v)) for x in (travel[:, k].min(), travel[:, k].max()))
            spare = max(0.1 * (high - low), 0.12 * size)
            marks.append(
                JointMark(
                    name=name,
                    kind="slide",
                    frame=carrier,
                    point=joint.pose[:3, 3],
                    axis=joint.pose[:3, :3] @ v / np.linalg.norm(v),
                    reach=(low - spare, high + spare),
                )
            )
    return marks


def _heavy_joints(mechanism: Mechanism) -> set[int]:
    """Return the joints that move a mass; the others only lead points."""
    tree = mechanism.tree
    own = np.zeros(len(tree.joints))
    for joint, body, _ in tree.bodies():
        if joint >= 0:
            own[joint] += body.is_massive
    return {k for k, mass in enumerate(tree.subtree_sums(own)) if mass > 0.0}


def _floats(mechanism: Mechanism, joint: int) -> bool:
    """Whether a slide is one of several in a row without a mass between them: what they carry floats, on no rails."""
    tree = mechanism.tree
    loaded = {k for k, body, _ in tree.bodies() if body.is_massive}

    def carries_a_slide(k: int) -> bool:
        """Whether a massless slide carries another one and nothing else."""
        above = [j for j, other in enumerate(tree.joints) if other.parent == k]
        return slides(k) and k not in loaded and len(above) == 1 and slides(above[0])

    def slides(k: int) -> bool:
        return k >= 0 and not tree.joints[k].twist[3:].any()

    return carries_a_slide(joint) or carries_a_slide(tree.joints[joint].parent)
