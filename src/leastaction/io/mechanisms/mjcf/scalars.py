"""`Along`: what actuators, tendons and equalities of an MJCF act along: values of joints, lengths of tendons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf.places import Places
from leastaction.io.mechanisms.mjcf.spec import mujoco_module, pose_in_body
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import JointPart
from leastaction.io.mechanisms.rotations import variables_of
from leastaction.mechanics.description.affine import Affine

Terms = Mapping[str, float] | Mapping[tuple[str, ...], float]


@dataclass(frozen=True)
class Along:
    """A scalar that MuJoCo counts: the sum of ``terms`` (variables, or paths of frames, by factors) and ``offset``.

    ``reference``: the whole where the file draws it. ``movers``: the joints that change it. ``left_out``: what of
    it the mechanism does not have.
    """

    terms: Terms
    offset: float
    reference: float
    movers: frozenset[str]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether anything changes it."""
        return bool(self.terms) and bool(self.movers)

    @property
    def of_paths(self) -> bool:
        """Whether it is made of lengths of paths."""
        return any(isinstance(key, tuple) for key in self.terms)

    @property
    def scalar(self) -> Any:
        """The terms as elements take them: a variable or a path alone where its factor is 1."""
        if len(self.terms) == 1:
            (key, factor) = next(iter(self.terms.items()))
            if factor == 1.0:
                return list(key) if isinstance(key, tuple) else key
        return dict(self.terms)

    def times(self, factor: float) -> Along:
        """Return it times a number that is not zero."""
        terms: Any = {key: factor * value for key, value in self.terms.items()}
        return replace(self, terms=terms, offset=factor * self.offset, reference=factor * self.reference)


def of_joint(name: str, names: Names) -> Along | None:
    """Return the value of a hinge or a slide; None of another joint."""
    if name not in names.values:
        return None
    reference = next(joint.reference for joint in names.all_joints if joint.name == name)
    return _of_value(names.values[name], reference, names)


def of_rotation(joint: JointPart, gear: Sequence[float]) -> Along:
    """Return what a motor of a ball or a free joint acts along: its velocities by ``gear``, as the file counts them.

    It has a rate only: MuJoCo's motors act along the axes of the link, of which no length is the integral.
    """
    names = variables_of(joint)
    return Along({n: float(g) for n, g in zip(names, gear, strict=False) if g}, 0.0, 0.0, frozenset({joint.name}))


def of_tendon(name: str, spec: Any, names: Names, places: Places) -> Along | None:
    """Return the length of a tendon; None of one that does not exist or has an unknown part."""
    tendon = next((each for each in spec.tendons if each.name == name), None)
    if tendon is None:
        return None
    wraps = [tendon.path[i] for i in range(len(tendon.path))]
    kinds = mujoco_module().mjtWrap
    if wraps and wraps[0].type == kinds.mjWRAP_JOINT:
        total, reference = Affine((), 0.0), 0.0
        for wrap in wraps:
            one = of_joint(wrap.target.name, names)
            if one is None:
                return None
            total = total + float(wrap.coef) * names.values[wrap.target.name]
            reference += float(wrap.coef) * one.reference
        return _of_value(total, reference, names)
    return _of_path(name, wraps, names, places)


def _of_value(value: Affine, reference: float, names: Names) -> Along:
    terms = {name: factor for name, factor in value.terms if factor != 0.0}
    moved = frozenset(names.joints)
    driven = frozenset(
        joint for joint in moved & names.values.keys() if not terms.keys().isdisjoint(names.values[joint].names)
    )
    return Along(terms, value.offset, reference, driven)


def _of_path(name: str, wraps: list[Any], names: Names, places: Places) -> Along:
    kinds = mujoco_module().mjtWrap
    branches: list[tuple[float, list[Any]]] = [(1.0, [])]
    wrapped: list[str] = []
    for wrap in wraps:
        if wrap.type == kinds.mjWRAP_PULLEY:
            branches.append((1.0 / float(wrap.divisor), []))
        elif wrap.type == kinds.mjWRAP_SITE:
            branches[-1][1].append(wrap.target)
        else:
            wrapped.append(wrap.target.name)
    terms: dict[tuple[str, ...], float] = {}
    reference, movers = 0.0, set[str]()
    for factor, sites in branches:
        kept = [site for i, site in enumerate(sites) if i == 0 or not _same_place(sites[i - 1], site, places)]
        if len(kept) < 2:
            continue
        path = tuple(names.sites[site.name] for site in kept)
        terms[path] = terms.get(path, 0.0) + factor
        points = [places.site_pose(site.name)[:3, 3] for site in kept]
        reference += factor * sum(float(np.linalg.norm(b - a)) for a, b in pairwise(points))
        for a, b in pairwise(kept):
            movers |= places.movers(a.parent, names) ^ places.movers(b.parent, names)
    around = ", ".join(dict.fromkeys(wrapped))
    left_out = (LeftOut(f"wrapping of the tendon {name!r} around {around}", "it goes straight"),) if wrapped else ()
    return Along(terms, 0.0, reference, frozenset(movers), left_out)


def _same_place(a: Any, b: Any, places: Places) -> bool:
    if a.parent.name != b.parent.name:
        return False
    first, second = (pose_in_body(site, places.spec)[:3, 3] for site in (a, b))
    return bool(np.abs(first - second).max() < 1e-12)
