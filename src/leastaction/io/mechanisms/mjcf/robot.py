"""The bodies and joints of an MJCF, as parts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.errors import ModelFileError
from leastaction.io.mechanisms.mjcf.equalities import extra_sites
from leastaction.io.mechanisms.mjcf.joints import joint_part
from leastaction.io.mechanisms.mjcf.masses import Masses
from leastaction.io.mechanisms.mjcf.meshes import Meshes
from leastaction.io.mechanisms.mjcf.shapes import shapes_of
from leastaction.io.mechanisms.mjcf.spec import mujoco_module, pose_in_body, read_spec
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import fresh
from leastaction.io.mechanisms.parts import LinkPart, Robot, SitePart


def read_mjcf(path: Path) -> tuple[Robot, Any]:
    """Return the parts of an MJCF, and its specification for what is read by its names."""
    spec = read_spec(path)
    bodies = list(_in_order(spec.worldbody, -1))
    if not bodies:
        raise ModelFileError(f"{path}: the file holds no robot: no <body> in it; it may be what others include")
    try:
        return _robot(spec, path, bodies), spec
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None


def _robot(spec: Any, path: Path, bodies: list[tuple[Any, int]]) -> Robot:
    left_out: list[LeftOut] = []
    taken = {"world", *(body.name for body, _ in bodies if body.name)}
    names = [body.name or fresh(_made_up(body, index), taken, "'") for index, (body, _) in enumerate(bodies)]
    joint_names = {joint.name for body, _ in bodies for joint in body.joints if joint.name}
    meshes = Meshes(spec, path)
    masses = Masses(spec, meshes, left_out)
    extra = extra_sites(spec)
    links = []
    for (body, parent), name in zip(bodies, names, strict=True):
        joints = []
        for joint in body.joints:
            called = joint.name or fresh(name, joint_names, ".joint")
            joints.append(joint_part(joint, called, spec))
        links.append(
            LinkPart(
                name=name,
                parent=parent,
                pose=pose_in_body(body, spec),
                joints=tuple(joints),
                mass=masses.of(body, name),
                sites=_sites(body, spec) + tuple(extra.get(body.name, ())),
                lift=float(body.gravcomp),
            )
        )
        if body.mocap:
            left_out.append(LeftOut(f"mocap of the body {name!r}", "it stands still where the file draws it"))
    no_gravity = spec.option.disableflags & int(mujoco_module().mjtDisableBit.mjDSBL_GRAVITY)
    framed = [(spec.worldbody, "world"), *((body, name) for (body, _), name in zip(bodies, names, strict=True))]
    shapes = shapes_of(spec, meshes, framed, left_out)
    return Robot(
        name=spec.modelname if spec.modelname and spec.modelname != "MuJoCo Model" else path.stem,
        links=tuple(masses.scaled(links)),
        gravity=np.zeros(3) if no_gravity else np.array(spec.option.gravity, dtype=np.float64),
        sites=_sites(spec.worldbody, spec) + tuple(extra.get("world", ())),
        shapes=tuple(shapes),
        left_out=(*left_out, *left_out_of(spec)),
    )


def _made_up(body: Any, index: int) -> str:
    joint = next((joint.name for joint in body.joints if joint.name), "")
    return f"{joint}.body" if joint else f"body{index + 1}"


def _in_order(body: Any, parent: int) -> Iterator[tuple[Any, int]]:
    """Yield the bodies behind one, depth first, with the index of each one's parent."""
    stack = [(child, parent) for child in reversed(body.bodies)]
    index = parent
    while stack:
        child, before = stack.pop()
        index += 1
        yield child, before
        stack.extend((grandchild, index) for grandchild in reversed(child.bodies))


def _sites(body: Any, spec: Any) -> tuple[SitePart, ...]:
    return tuple(SitePart(site.name, pose_in_body(site, spec)) for site in body.sites if site.name)


def left_out_of(spec: Any) -> list[LeftOut]:
    """Return what of a specification nothing is made of, counted by kind."""
    found: list[LeftOut] = []

    def count(what: str, number: int, why: str) -> None:
        if number:
            found.append(LeftOut(f"{number} {what if number == 1 else what.replace('body', 'bodie') + 's'}", why))

    touching = sum(bool(geom.contype or geom.conaffinity) for geom in spec.geoms)
    count("touching geom", touching if touching > 1 else 0, "bodies pass through each other")
    count("contact pair", len(spec.pairs), "bodies pass through each other")
    seen = "pictures have their own"
    count("camera", len(spec.cameras), seen)
    count("light", len(spec.lights), seen)
    count("skin", len(spec.skins), "bodies are rigid here, and shown by their shapes")
    count("flex body", len(spec.flexes), "bodies are rigid here")
    count("sensor", len(spec.sensors), "results have every place and force by name")
    count("plugin", len(spec.plugins), "their forces are not known")
    if spec.option.density or spec.option.viscosity:
        found.append(LeftOut("the medium (density, viscosity)", "its forces are not taken over; `Drag` is one by hand"))
    if any(spec.option.wind):
        found.append(LeftOut("the wind", "without a medium it does nothing; `Drag` takes a wind"))
    return found
