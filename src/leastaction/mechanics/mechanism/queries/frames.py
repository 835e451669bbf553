"""Where the frames of a mechanism are and how they move: methods of `Mechanism`, which is ``m`` here."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.arguments import Compiled, batch, batch_of_states, frame_index, shaped
from leastaction.mechanics.mechanism.queries.frame_derivatives import Slots, jacobian_derivative, pose_derivative
from leastaction.mechanics.mechanism.queries.path_motion import Axes, PathMotion, inverted, origins_of, poses_of
from leastaction.numerics.arrays import Array, Row, as_array, as_count, as_flag
from leastaction.numerics.memory import MAX_BYTES, check_memory
from leastaction.numerics.names import as_names


def frame_pose(m: Compiled, q: Row, name: str, *, inverse: bool = False) -> Array:
    """Return the pose of a frame in the world.

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)
    name : str
        The frame.
    inverse : bool, optional
        Return its inverse: the pose of the world in the frame.

    Returns
    -------
    ndarray, shape (4, 4) or (N, 4, 4)
        Takes coordinates in the frame to coordinates in the world; the inverse takes them back.
    """
    values, one = batch(m, q)
    poses = poses_of(m.tree, frame_index(m, name), m.core.joint_poses(values))
    return shaped(inverted(poses) if as_flag(inverse, "inverse") else poses, one)


def frame_pose_derivative(
    m: Compiled,
    q: Row,
    frame: str,
    *,
    order: int = 1,
    along: Sequence[ArrayLike] = (),
    inverse: bool = False,
    max_bytes: float = MAX_BYTES,
) -> Array:
    """Return the derivative of `frame_pose` by the configuration, of any order (dissertation 2.11, 2.12).

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)
    frame : str
        The frame.
    order : int, optional
        How often it is differentiated.
    along : sequence of array_like, shape (nv,), optional
        Directions that the last of these derivatives are taken along, `order` of them at most.
    inverse : bool, optional
        Differentiate the inverse of the pose.
    max_bytes : float, optional
        What the result may take: ``128 N nv^(order - len(along))`` bytes.

    Returns
    -------
    ndarray, shape (4, 4, nv, ...) or (N, 4, 4, nv, ...)
        With one axis of nv for every derivative that is along no direction; symmetric in them. Of a rotation that is a
        quaternion they are by a turn in the axes of the body.

    Raises
    ------
    ArgumentError
        For an unknown frame, an order below one, a wrong shape, or, before anything is made, for a result that
        takes more.
    """
    values, one = batch(m, q)
    motion = PathMotion.of(m, values, frame, (0.0, 0.0, 0.0), "world")
    slots = _slots(m, motion, order, along, (len(values), 4, 4), max_bytes, "frame_pose_derivative")
    return shaped(_without(along, pose_derivative(motion, slots, inverse=as_flag(inverse, "inverse"))), one)


def positions(m: Compiled, q: Row, names: Sequence[str] | None = None) -> Array:
    """Return the origins of frames in the world.

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)
    names : sequence of str, optional
        The frames; all of them, in the order of `frames`, if not given.

    Returns
    -------
    ndarray, shape (len(names), 3) or (N, len(names), 3)
        Metres.
    """
    values, one = batch(m, q)
    indices = [frame_index(m, name) for name in (m.frames if names is None else as_names(names, "names", "frames"))]
    return shaped(origins_of(m.tree, indices, m.core.joint_poses(values)), one)


def frame_jacobian(
    m: Compiled, q: Row, frame: str, *, point: ArrayLike = (0.0, 0.0, 0.0), axes: Axes = "world"
) -> Array:
    """Return the Jacobian of a frame: its velocity is ``J v``.

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)
    frame : str
        The frame.
    point : array_like, shape (3,), optional
        The point whose velocity is meant, in the frame (m); its origin if not given.
    axes : {"world", "frame"}, optional
        The axes in which the velocities are resolved.

    Returns
    -------
    ndarray, shape (6, nv) or (N, 6, nv)
        Linear velocity of the point, then angular velocity, by the velocity of every variable.

    Raises
    ------
    ArgumentError
        For an unknown frame, other axes or a wrong shape.
    """
    values, one = batch(m, q)
    return shaped(PathMotion.of(m, values, frame, point, axes).jacobian(), one)


def frame_velocity(
    m: Compiled, q: Row, v: Row, frame: str, *, point: ArrayLike = (0.0, 0.0, 0.0), axes: Axes = "world"
) -> Array:
    """Return the velocity of a frame.

    Parameters
    ----------
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)
    frame, point, axes
        As in `frame_jacobian`.

    Returns
    -------
    ndarray, shape (6,) or (N, 6)
        Linear velocity of the point (m/s), then angular velocity (rad/s).
    """
    values, speeds, one = batch_of_states(m, q, v)
    return shaped(PathMotion.of(m, values, frame, point, axes).velocity(speeds), one)


def frame_jacobian_derivative(
    m: Compiled,
    q: Row,
    frame: str,
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    axes: Axes = "world",
    order: int = 1,
    along: Sequence[ArrayLike] = (),
    max_bytes: float = MAX_BYTES,
) -> Array:
    """Return the derivative of `frame_jacobian` by the configuration, of any order.

    With ``axes="frame"`` these are the derivatives of the body velocity by one velocity and `order` configuration
    variables (dissertation 2.14, 2.15).

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)
    frame, point, axes
        As in `frame_jacobian`.
    order, along, max_bytes
        As in `frame_pose_derivative`; the result takes ``48 N nv^(1 + order - len(along))`` bytes.

    Returns
    -------
    ndarray, shape (6, nv, nv, ...) or (N, 6, nv, nv, ...)
        Entry ``[a, i, j]`` is ``dJ[a, i] / dq_j``, of a rotation that is a quaternion by a turn about an axis of its
        own, for the first order. The linear half in world axes is symmetric in i and j,
        being the second derivative of a position; the angular one is not, since an angular velocity is
        no derivative of anything.

    Raises
    ------
    ArgumentError
        As `frame_jacobian` and `frame_pose_derivative`.
    """
    values, one = batch(m, q)
    motion = PathMotion.of(m, values, frame, point, axes)
    what = "frame_jacobian_derivative"
    if as_count(order, f"{what}: order", 1) == 1 and not len(along):  # ten times as fast as the rule for any order
        check_memory((len(values), 6, m.nv, m.nv), max_bytes, what, "give directions, along=[...]")
        return shaped(motion.jacobian_derivative(), one)
    slots = _slots(m, motion, order, along, (len(values), 6, m.nv), max_bytes, what)
    return shaped(_without(along, jacobian_derivative(motion, [motion.E[None], *slots])), one)


def frame_velocity_derivative(
    m: Compiled,
    q: Row,
    v: Row,
    frame: str,
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    axes: Axes = "world",
    order: int = 1,
    along: Sequence[ArrayLike] = (),
    max_bytes: float = MAX_BYTES,
) -> Array:
    """Return the derivative of `frame_velocity` by the configuration, of any order.

    By the velocity it is linear: `frame_jacobian` and its derivatives. With ``axes="frame"`` it is the derivative
    of the body velocity (dissertation 2.13).

    Parameters
    ----------
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)
    frame, point, axes
        As in `frame_jacobian`.
    order, along, max_bytes
        As in `frame_pose_derivative`; the result takes ``48 N nv^(order - len(along))`` bytes.

    Returns
    -------
    ndarray, shape (6, nv, ...) or (N, 6, nv, ...)
        With one axis of nv for every derivative that is along no direction; symmetric in them.

    Raises
    ------
    ArgumentError
        As `frame_jacobian` and `frame_pose_derivative`.
    """
    values, speeds, one = batch_of_states(m, q, v)
    motion = PathMotion.of(m, values, frame, point, axes)
    slots = _slots(m, motion, order, along, (len(values), 6), max_bytes, "frame_velocity_derivative")
    found = jacobian_derivative(motion, [(speeds @ motion.E.T)[:, :, None], *slots])[:, :, 0]
    return shaped(_without(along, found), one)


def _slots(
    m: Compiled,
    motion: PathMotion,
    order: int,
    along: Sequence[ArrayLike],
    lead: tuple[int, ...],
    max_bytes: float,
    what: str,
) -> Slots:
    """Return by what to differentiate: so often by all variables, and along directions; check the result's size."""
    count = as_count(order, f"{what}: order", 1)
    directions = as_array(along, f"{what}: along", (None, m.nv), names=m.variables) if len(along) else ()
    if len(directions) > count:
        raise ArgumentError(f"{what}: got {len(directions)} directions for derivatives of order {count}")
    free = count - len(directions)
    check_memory((*lead, *[m.nv] * free), max_bytes, what, "give directions, along=[...]")
    return [motion.E[None]] * free + [(motion.E @ direction)[None, :, None] for direction in directions]


def _without(along: Sequence[ArrayLike], result: Array) -> Array:
    """Return a result without its last axes, of length one, for directions."""
    return result.reshape(result.shape[: result.ndim - len(along)])
