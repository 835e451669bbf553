"""What numbers of a mechanism have to keep to for there to be such a mechanism, where they are to be found.

A body of positive mass has an inertia J about its centre for which ``S = 1/2 tr(J) E - J``, the second moment of its
mass, has no negative eigenvalue (P. M. Wensing, S. Kim and J.-J. E. Slotine, Linear matrix inequalities for physically
consistent inertial parameter identification, 2018, eq. 12): none of its principal moments is larger than the sum of the
others. Where J is diagonal these are the diagonal entries of S, else its leading minors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.parameters import AXES, BodyNumber, ElementNumber, Place, parameter_value
from leastaction.optimal.quantity import Entries, FunctionQuantity, Quantity
from leastaction.optimal.system import FINAL_TIME

_TINY = 1e-12  # of a number's size: so little below zero is refused already where negative numbers are


def conditions_of(m: Mechanism, names: Sequence[str]) -> list[Quantity]:
    """Return what must not be negative, as functions of the values (P,) of some parameters; of others it knows nothing.

    Raises `ArgumentError`: where no other values than those that a body has are possible.
    """
    known = {name: i for i, name in enumerate(names) if name != FINAL_TIME}
    # Of numbers that several share, what the first of them has to keep to.
    first = [m.members_of([name])[0][0] for name in known]
    places = dict(zip(known.values(), m.parameter_places(first).values(), strict=True))
    conditions: list[Quantity] = []
    signed = [i for i, place in places.items() if _has_a_sign(m, names[i], place)]
    if signed:
        conditions.append(Entries([names[i] for i in signed], signed, of_state=True))
    bodies = {
        (place.frame, place.body): None
        for place in places.values()
        if isinstance(place, BodyNumber) and place.field.startswith("inertia")
    }
    for frame, body in bodies:
        if not m.tree.frames[frame].frame.bodies[body].allow_nonphysical:
            found = {
                i: place.field[-2:]
                for i, place in places.items()
                if isinstance(place, BodyNumber)
                and (place.frame, place.body) == (frame, body)
                and place.field.startswith("inertia")
            }
            conditions.append(_inertia(m, frame, body, found, names))
    return conditions


def _has_a_sign(m: Mechanism, name: str, place: Place) -> bool:
    """Whether a parameter must not be negative, and may be positive."""
    if isinstance(place, BodyNumber):
        return place.field == "mass"
    if not isinstance(place, ElementNumber):
        return False
    tiny = _TINY * (1.0 + abs(parameter_value(m.tree, place, m.core.numbers)))
    return _takes(m, name, tiny) and not _takes(m, name, -tiny)


def _takes(m: Mechanism, name: str, value: float) -> bool:
    try:
        m.with_parameters({name: value})
    except DescriptionError:
        return False
    return True


def _inertia(m: Mechanism, frame: int, body: int, unknown: dict[int, str], names: Sequence[str]) -> Quantity:
    """Return what the inertia of a body has to keep to, some of whose entries are unknown: at these places."""
    given = m.tree.frames[frame].frame.bodies[body].inertia
    where = f"inertia of {m.tree.frames[frame].name}"
    fixed = [
        axis for axis in AXES if axis * 2 not in unknown.values() and given["xyz".index(axis)]["xyz".index(axis)] == 0.0
    ]
    free = [i for i, entry in unknown.items() if entry[0] == entry[1]]
    if fixed and free:
        raise ArgumentError(
            f"unknowns: got {names[free[0]]!r}, but {fixed[0] * 2} of the {where} is 0 and not to be found: the other "
            "two moments of a real body are equal then. Give the body an inertia, name all three moments, or say "
            "Body(..., allow_nonphysical=True)"
        )
    is_diagonal = (
        all(entry[0] == entry[1] for entry in unknown.values()) and not (given - np.diag(np.diag(given))).any()
    )
    size = float(np.trace(given)) or 1.0

    def second_moments(p: Any) -> Any:
        J = np.array(np.broadcast_to(given, (len(p), 3, 3)), dtype=p.dtype)
        for i, entry in unknown.items():
            a, b = AXES.index(entry[0]), AXES.index(entry[1])
            J[:, a, b] = J[:, b, a] = p[:, i]
        return 0.5 * np.einsum("kii->k", J)[:, None, None] * np.eye(3) - J

    def diagonal(p: Any) -> Any:
        return np.einsum("kii->ki", second_moments(p))

    def minors(p: Any) -> Any:
        (a, b, c), (_, d, e), (_, _, f) = second_moments(p).transpose(1, 2, 0)
        two = a * d - b * b
        return np.stack([a, two / size, (two * f - a * e * e - d * c * c + 2.0 * b * c * e) / size**2], axis=1)

    said = [f"{where}: {a * 2} <= {b * 2} + {c * 2}" for a, b, c in ("xyz", "yxz", "zxy")]
    if not is_diagonal:
        said = [f"{where}: that of a real body, {part}" for part in ("x", "x and y", "x, y and z")]
    function: Callable[[Any], Any] = diagonal if is_diagonal else minors
    quantity = FunctionQuantity(said, function, unit="kg m^2")
    quantity.says_all = True
    return quantity
