"""`load`: a mechanism, and what belongs to it, from a URDF or an MJCF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, get_args

from leastaction.errors import ArgumentError, DescriptionError, ModelFileError, some
from leastaction.io.mechanisms import rotations
from leastaction.io.mechanisms.changes import with_axes, with_bodies, with_fixed, with_free_base
from leastaction.io.mechanisms.joint_elements import elements_of_joints, settling
from leastaction.io.mechanisms.joint_elements import motors as motors_of
from leastaction.io.mechanisms.kinds import OWN, is_mjcf, parse, read_text, require_urdf
from leastaction.io.mechanisms.limits import limits_of_joints, limits_of_motors, limits_of_rotations
from leastaction.io.mechanisms.masses import checked
from leastaction.io.mechanisms.model import Keyframe, Model
from leastaction.io.mechanisms.names import Names, settle
from leastaction.io.mechanisms.parts import Axes, Robot
from leastaction.io.mechanisms.rotation_elements import with_rotors
from leastaction.io.mechanisms.tree import tree_of
from leastaction.io.mechanisms.urdf import read_urdf
from leastaction.mechanics import Armature, Body, Gravity, JointForce, Mechanism
from leastaction.mechanics.elements import Element
from leastaction.numerics.arrays import as_choice, as_flag
from leastaction.numerics.public import public
from leastaction.optimal import Bound
from leastaction.systems import PathBound


@public
def load(
    path: str | PathLike[str],
    *,
    floating: bool = False,
    fixed: Sequence[str] = (),
    packages: Sequence[str | PathLike[str]] = (),
    motors: bool | Sequence[str] | None = None,
    bodies: Mapping[str, Body] | None = None,
    inertia: Literal["strict", "repair"] = "strict",
    axes: Axes = "quaternion",
    strict: bool = False,
) -> Model:
    """Return the mechanism of a URDF or an MJCF, with its limits, keyframes and shapes.

    Joints keep their names as variables, links and sites theirs as frames. A joint that follows another by a URDF's
    ``mimic`` moves with the other's variable, without a constraint. Ball and free joints have a unit quaternion
    ``name.qw`` ..., scalar first, and the angular velocity ``name.wx`` ..., as `ball` and `free`. Nothing is compiled
    by other programs; an MJCF needs the extra ``models``.

    Parameters
    ----------
    path : path
        The file: ``.urdf`` or ``.xml``, told apart by what is in it; or one that `Mechanism.save` wrote.
    floating : bool, optional
        Whether the root of a URDF is free in space, instead of standing still in the world.
    fixed : sequence of str, optional
        Joints to be welded at their reference, such as the fingers of a hand.
    packages : sequence of path, optional
        Folders in which ``package://name/...`` is looked for; those above the file are searched too.
    motors : bool or sequence of str, optional
        Which joints have a motor, an input ``joint.torque`` (N m) or ``joint.force`` (N): all, none, or those that are
        named, instead of the actuators of the file. By default the actuators of an MJCF, and of a URDF every joint
        whose effort is limited.
    bodies : mapping of str to Body, optional
        Masses and inertias of links, by name, in the place of what the file says of them.
    inertia : "strict" or "repair", optional
        Whether negative masses and inertias and joints that move no mass are errors, or are mended: by the nearest
        inertia that a body can have, and a small mass. ``left_out`` says what was changed.
    axes : "quaternion" or "xyz", optional
        How ball and free joints turn: by unit quaternions, or by three angles ``name.rx``, ``name.ry``, ``name.rz``.
    strict : bool, optional
        Whether anything left out is an error.

    Returns
    -------
    Model
        ``mechanism``, ``limits``, ``keyframes``, ``reference``, ``shapes`` and ``left_out``.

    Raises
    ------
    ModelFileError
        For a file that is not there, is broken or holds no robot, for masses that cannot be, and with ``strict`` for
        anything left out.
    ArgumentError
        For an unknown joint in ``fixed`` or ``motors``, an unknown link in ``bodies``, or another argument that cannot
        be.
    MissingExtraError
        For an MJCF without the package ``mujoco``.
    """
    file = Path(fspath(path))
    as_choice(inertia, "inertia", ("strict", "repair"))
    as_choice(axes, "axes", get_args(Axes))
    free, all_or_nothing = as_flag(floating, "floating"), as_flag(strict, "strict")
    text = read_text(file)
    if file.suffix.lower() in OWN:
        given = {
            "axes": axes != "quaternion",
            "floating": free,
            "fixed": fixed,
            "motors": motors is not None,
            "bodies": bodies is not None,
        }
        if asked := [name for name, value in given.items() if value]:
            raise ArgumentError(
                f"load: got {', '.join(asked)} for {file.name}, a file of ours, which says all of that itself; leave "
                "them out, or change the mechanism (with_frames, with_elements, with_parameters)"
            )
        return _own(file)
    spec = None
    if is_mjcf(text):
        from leastaction.io.mechanisms.mjcf import read_mjcf

        robot, spec = read_mjcf(file)
    else:
        root = parse(text, file)
        require_urdf(root, file)
        robot = read_urdf(root, file, [Path(fspath(folder)) for folder in packages])
    try:
        if bodies is not None:
            robot = with_bodies(robot, bodies)
        if free:
            robot = with_free_base(robot)
        robot = with_axes(robot, axes)
        model = _model(with_fixed(robot, fixed), robot, spec, motors, inertia == "repair")
    except ModelFileError as error:
        raise ModelFileError(f"{file}: {error}", line=error.line) from None
    if all_or_nothing and model.left_out:
        raise ModelFileError(
            f"{file}: strict=True, and {len(model.left_out)} things are left out: "
            f"{some([str(each) for each in model.left_out], 6)}"
        )
    return model


def _own(file: Path) -> Model:
    mechanism = Mechanism.load(file)
    return Model(mechanism=mechanism, name=file.stem)


def _model(robot: Robot, file: Robot, spec: Any, which: bool | Sequence[str] | None, repair: bool) -> Model:
    robot, changed = checked(with_rotors(robot), repair)
    names = settle(robot, file)
    elements, left_out = elements_of_joints(robot, names)
    driven: dict[str, JointForce] = {}
    limits: list[Bound | PathBound] = []
    keyframes: dict[str, Keyframe] = {}
    if spec is None or which is not None:
        driven = motors_of(names, which)
        elements += driven.values()
        limits += limits_of_motors(driven, names.joints)
    if spec is not None:
        from leastaction.io.mechanisms.mjcf import elements_of, keyframes_of

        rotors = [each for each in elements if isinstance(each, Armature)]

        def bare(more: Sequence[Element]) -> Mechanism:
            return _compiled(robot, names, [*rotors, *more])

        found = elements_of(spec, names, bare, actuators=which is None)
        elements += found.elements
        limits += found.limits
        left_out += found.left_out
        keyframes, lost = keyframes_of(spec, names, found.inputs)
        left_out += lost
    reference = _reference(robot, names)
    mechanism = _compiled(robot, names, [*_gravity(robot), *elements])
    if settled := settling(names, mechanism, reference):
        mechanism = mechanism.with_elements(settled)
    return Model(
        mechanism=mechanism,
        name=robot.name,
        limits=(*limits, *limits_of_joints(names), *limits_of_rotations(names, mechanism)),
        keyframes=keyframes,
        reference=reference,
        shapes=robot.shapes,
        left_out=(*changed, *robot.left_out, *left_out),
    )


def _gravity(robot: Robot) -> list[Element]:
    if not robot.gravity.any():
        return []
    elements: list[Element] = [Gravity(robot.gravity.tolist(), name="gravity")]
    for link in robot.links:
        if link.lift and link.mass is not None and link.mass.mass:
            lift = (-link.lift * robot.gravity).tolist()
            elements.append(Gravity(lift, [link.name], name=f"lift.{link.name}"))
    return elements


def _compiled(robot: Robot, names: Names, elements: Sequence[Element]) -> Mechanism:
    try:
        return Mechanism(tree_of(robot, names), elements)
    except DescriptionError as error:
        text = str(error)
        if text.startswith(("massless", "the dynamic variables")):
            missing = sum(each.name.startswith("mass of the mesh") for each in robot.left_out)
            text += f". {missing} meshes that bodies have their mass from were not found" if missing else ""
            text += (
                ". Of a file: give the link a mass there, weld the joint with fixed=[...], or load it with "
                "inertia='repair', which gives such links a small mass"
            )
        raise ModelFileError(text) from None


def _reference(robot: Robot, names: Names) -> dict[str, float]:
    values: dict[str, float] = {}
    for link in robot.links:
        for joint in link.joints:
            if joint.kind in ("ball", "free"):
                values.update(rotations.reference_of(joint, link.pose))
            elif names.is_own(joint.name):
                values[joint.name] = joint.reference
    return values
