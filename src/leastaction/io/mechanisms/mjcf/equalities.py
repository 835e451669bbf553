"""The equality constraints of an MJCF: bodies that are connected or welded, joints and tendons that are coupled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.places import Places
from leastaction.io.mechanisms.mjcf.scalars import Along, of_joint, of_tendon
from leastaction.io.mechanisms.mjcf.spec import mujoco_module
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.io.mechanisms.parts import SitePart
from leastaction.io.mechanisms.poses import rotation_of
from leastaction.mechanics import Coupling, FixedOrientation, PathLength, PointToPoint, PolynomialCoupling
from leastaction.mechanics.elements import Element
from leastaction.numerics.arrays import Array


class _NoEqualityError(Exception):
    """Why an equality is left out."""


def elements_of_equalities(spec: Any, names: Names) -> Found:
    """Return the equality constraints of a specification; they hold exactly here, where MuJoCo's are soft."""
    places, found = Places(spec), Found()
    for number, equality in enumerate(spec.equalities):
        name = _name(equality, number)
        try:
            found += Found(elements=tuple(_elements(equality, name, number, spec, names, places)))
        except _NoEqualityError as error:
            found += Found(left_out=(LeftOut(f"equality {name!r}", str(error)),))
    return found


def extra_sites(spec: Any) -> dict[str, list[SitePart]]:
    """Return the places on bodies, by their names, that equality constraints need frames at."""
    places = Places(spec)
    found: dict[str, list[SitePart]] = {}
    for number, equality in enumerate(spec.equalities):
        if not _of_bodies(equality):
            continue
        for end, (body, pose) in enumerate(_ends(equality, places), 1):
            found.setdefault(body or "world", []).append(SitePart(_end(equality, number, end), pose))
    return found


def _name(equality: Any, number: int) -> str:
    return equality.name or f"{equality.name1}.equality{number}"


def _end(equality: Any, number: int, end: int) -> str:
    return f"{_name(equality, number)}.end{end}"


def _of_bodies(equality: Any) -> bool:
    mujoco = mujoco_module()
    by_body = equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
    return bool(by_body and equality.active and equality.objtype != mujoco.mjtObj.mjOBJ_SITE)


def _ends(equality: Any, places: Places) -> tuple[tuple[str, Array], tuple[str, Array]]:
    """Return both bodies, and the poses in them of the frames that are to coincide."""
    first, second = (places.body(name) for name in (equality.name1, equality.name2))
    relative = np.linalg.inv(places.body_pose(first)) @ places.body_pose(second)
    at1, at2 = np.eye(4), np.eye(4)
    if equality.type == mujoco_module().mjtEq.mjEQ_CONNECT:
        at1[:3, 3] = equality.data[:3]
        at2[:3, 3] = (np.linalg.inv(relative) @ at1)[:3, 3]
        return (equality.name1, at1), (equality.name2, at2)
    at2[:3, 3] = equality.data[:3]
    if not np.any(equality.data[6:10]):
        return (equality.name1, relative @ at2), (equality.name2, at2)
    # A pose that is given is where the anchor of the second body is in the first.
    at1[:3, 3], at1[:3, :3] = equality.data[3:6], rotation_of(equality.data[6:10])
    return (equality.name1, at1), (equality.name2, at2)


def _elements(equality: Any, name: str, number: int, spec: Any, names: Names, places: Places) -> Iterator[Element]:
    mujoco = mujoco_module()
    kinds = mujoco.mjtEq
    if not equality.active:
        raise _NoEqualityError("it is not active")
    if equality.type in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
        by_site = equality.objtype == mujoco.mjtObj.mjOBJ_SITE
        if by_site:
            bodies = [places.sites[each].parent for each in (equality.name1, equality.name2)]
            ends = [names.sites[each] for each in (equality.name1, equality.name2)]
        else:
            bodies = [places.body(each) for each in (equality.name1, equality.name2)]
            ends = [names.sites[_end(equality, number, end)] for end in (1, 2)]
        apart = places.movers(bodies[0], names) ^ places.movers(bodies[1], names)
        if not apart:
            raise _NoEqualityError("nothing moves its ends relative to each other")
        yield PointToPoint(*ends, name=name)
        if equality.type == kinds.mjEQ_WELD:
            yield FixedOrientation(*ends, name=f"{name}.turn")
    elif equality.type == kinds.mjEQ_JOINT:
        yield from _coupling(equality, name, [of_joint(each, names) for each in _named(equality)])
    elif equality.type == kinds.mjEQ_TENDON:
        yield from _coupling(equality, name, [of_tendon(each, spec, names, places) for each in _named(equality)])
    else:
        raise _NoEqualityError("only connect, weld, joint and tendon are taken over")


def _named(equality: Any) -> list[str]:
    return [each for each in (equality.name1, equality.name2) if each]


def _coupling(equality: Any, name: str, given: list[Along | None]) -> Iterator[Element]:
    """Yield what says ``y - y0 = c0 + c1 (x - x0) + ...``, both counted as MuJoCo does."""
    sides = [each for each in given if each is not None]
    if len(sides) < len(given):
        raise _NoEqualityError("one side is no joint of one variable, and no tendon of such")
    y, x = sides[0], sides[1] if len(sides) > 1 else None
    polynomial = Polynomial(np.trim_zeros(np.array(equality.data[:5], dtype=float), "b"))
    if x is None or polynomial.degree() == 0 or not x.moves:
        at = 0.0 if x is None or x.moves else x.offset - x.reference
        _hold_if_moving(y)
        yield _held(y, float(polynomial(at)) + y.reference - y.offset, name)
        return
    # In the sums without their offsets.
    whole = polynomial(Polynomial([x.offset - x.reference, 1.0])) + (y.reference - y.offset)
    if not y.moves and whole.degree() > 1:
        raise _NoEqualityError("the side that moves is the one that the polynomial is of")
    if whole.degree() > 1 or y.of_paths or x.of_paths:
        _hold_if_moving(y)
        yield PolynomialCoupling(y.scalar, x.scalar, tuple(map(float, whole.coef)), name=name)
        return
    factors: dict[Any, float] = dict(y.terms)
    for key, factor in x.terms.items():
        factors[key] = factors.get(key, 0.0) - float(whole.coef[1]) * factor
    factors = {key: factor for key, factor in factors.items() if factor != 0.0}
    if not factors:
        raise _NoEqualityError("both sides follow the same variable already")
    yield Coupling(factors, float(whole.coef[0]), name=name)


def _hold_if_moving(y: Along) -> None:
    if not y.moves:
        raise _NoEqualityError("nothing moves it")


def _held(y: Along, value: float, name: str) -> Element:
    if y.of_paths:
        return PathLength(y.scalar, value, name=name)
    factors: Any = y.terms
    return Coupling(factors, value, name=name)
