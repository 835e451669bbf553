"""Masses of bodies as the compiler of MJCF makes them: from their inertials or their geoms, bounded and balanced."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf import geometry
from leastaction.io.mechanisms.mjcf.geometry import Moments
from leastaction.io.mechanisms.mjcf.meshes import Meshes
from leastaction.io.mechanisms.mjcf.spec import mujoco_module, orientation, pose_in_body
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.parts import LinkPart, MassPart
from leastaction.numerics.arrays import Array

PRIMITIVES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


def kind_of(geom: Any) -> str:
    """Return the kind of a geom: "box", "mesh", "plane" ..."""
    types = mujoco_module().mjtGeom
    return str(types(geom.type).name).removeprefix("mjGEOM_").lower()


class Masses:
    """What the bodies of a specification weigh."""

    def __init__(self, spec: Any, meshes: Meshes, left_out: list[LeftOut]) -> None:
        self._spec, self._left_out = spec, left_out
        self._meshes = meshes

    def of(self, body: Any, name: str) -> MassPart | None:
        """Return the mass of a body, or None if it has none."""
        compiler = body.compiler
        from_geom = mujoco_module().mjtInertiaFromGeom
        how = compiler.inertiafromgeom
        if how == from_geom.mjINERTIAFROMGEOM_TRUE or (
            how == from_geom.mjINERTIAFROMGEOM_AUTO and not body.explicitinertial
        ):
            part = self._from_geoms(body, name)
        else:
            part = None
        if part is None and body.explicitinertial:
            part = self._written(body)
        if compiler.boundmass > 0.0 or compiler.boundinertia > 0.0 or compiler.balanceinertia:
            # As the compiler has it, the centre of a body without any mass lies as far from it as it from its parent.
            place = pose_in_body(body, self._spec)[:3, 3]
            part = _bounded(part or MassPart(0.0, place, np.zeros((3, 3))), compiler)
        return part if part is not None and (part.mass or part.inertia.any()) else None

    def _written(self, body: Any) -> MassPart:
        place = np.nan_to_num(np.array(body.ipos, dtype=np.float64))
        full = np.array(body.fullinertia, dtype=np.float64)
        R = orientation(body.iquat, body.ialt, body.compiler, self._spec)
        if math.isnan(full[0]):
            moments = np.diag(body.inertia)
        else:
            xx, yy, zz, xy, xz, yz = full
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return MassPart(float(body.mass), place, R @ moments @ R.T)

    def _from_geoms(self, body: Any, name: str) -> MassPart | None:
        low, high = body.compiler.inertiagrouprange
        parts = []
        for geom in body.geoms:
            if not low <= geom.group <= high:
                continue
            part = self._geom(geom, name)
            if part is not None and part.mass > 0.0:
                parts.append(part)
        return _together(parts)

    def _geom(self, geom: Any, body: str) -> MassPart | None:
        if not math.isnan(geom.mass) and geom.mass == 0.0:
            return None
        moments = self._moments(geom, body)
        if moments is None or moments.amount == 0.0:
            return None
        mass = float(geom.density) * moments.amount if math.isnan(geom.mass) else float(geom.mass)
        pose = pose_in_body(geom, self._spec)
        R = pose[:3, :3]
        inertia = R @ (moments.inertia * (mass / moments.amount)) @ R.T
        return MassPart(mass, R @ moments.center + pose[:3, 3], inertia)

    def _moments(self, geom: Any, body: str) -> Moments | None:
        kind = kind_of(geom)
        hollow = geom.typeinertia == mujoco_module().mjtGeomInertia.mjINERTIA_SHELL
        if kind in PRIMITIVES and not geom.meshname:
            return (geometry.shell if hollow else geometry.solid)(kind, size_of(geom))
        if kind == "mesh" and geom.meshname in self._meshes:
            moments = self._meshes.moments(geom.meshname)
            if moments is None:
                file = self._meshes.wanted(geom.meshname)
                self._left_out.append(
                    LeftOut(f"mass of the mesh {file!r} on {body!r}", "the file is missing or is no mesh")
                )
            return moments
        if geom.meshname:
            self._left_out.append(
                LeftOut(f"mass of the geom on {body!r}", f"it is fitted to the mesh {geom.meshname!r}")
            )
        return None

    def scaled(self, links: Sequence[LinkPart]) -> list[LinkPart]:
        """Return links whose masses sum to what the file asks for, if it does."""
        wanted = float(self._spec.compiler.settotalmass)
        total = sum(link.mass.mass for link in links if link.mass is not None)
        if wanted <= 0.0 or total == 0.0:
            return list(links)
        factor = wanted / total
        return [
            link
            if link.mass is None
            else replace(link, mass=MassPart(factor * link.mass.mass, link.mass.com, factor * link.mass.inertia))
            for link in links
        ]


def size_of(geom: Any) -> Array:
    """Return the sizes of a primitive, the half length of one from a point to another put in."""
    size = np.array(geom.size, dtype=np.float64)
    if math.isnan(geom.fromto[0]):
        return size
    half = float(np.linalg.norm(np.array(geom.fromto[:3]) - np.array(geom.fromto[3:]))) / 2.0
    if kind_of(geom) in ("box", "ellipsoid"):
        return np.array([size[0], size[0], half])
    return np.array([size[0], half, 0.0])


def _together(parts: Sequence[MassPart]) -> MassPart | None:
    if not parts:
        return None
    mass = sum(part.mass for part in parts)
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        d = part.com - com
        inertia += part.inertia + part.mass * ((d @ d) * np.eye(3) - np.outer(d, d))
    return MassPart(mass, com, inertia)


def _bounded(part: MassPart, compiler: Any) -> MassPart:
    moments, axes = np.linalg.eigh(part.inertia)
    mass = max(part.mass, float(compiler.boundmass))
    moments = np.maximum(moments, float(compiler.boundinertia))
    if compiler.balanceinertia and moments[2] > moments[0] + moments[1]:
        moments = np.full(3, moments.mean())
    return MassPart(mass, part.com, (axes * moments) @ axes.T)
