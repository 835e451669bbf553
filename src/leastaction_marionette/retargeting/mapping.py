"""Which joint of a captured skeleton is which joint of the puppet.

A mapping file is TOML, one line for each role that the built-in names do not find::

    [joints]
    left_hip = "Thigh_Left"            # a name of the capture's skeleton
    left_knee = ["Shin_Left", "Calf"]  # or several, in order of preference

A mapping file takes precedence over the built-in names, role by role.
"""

from __future__ import annotations

import re
import reprlib
import tomllib
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from importlib.resources import files
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

from leastaction.errors import MotionFileError
from leastaction.io import Capture
from leastaction_marionette.retargeting.skeleton import CHAINS, LIMBS

#: The joints a capture must have.
ROLES: tuple[str, ...] = tuple(f"{side}_{joint}" for side, limb in LIMBS for joint in CHAINS[limb])

#: Joints that it may have.
MORE_ROLES: tuple[str, ...] = ("head",)

JointNames = Mapping[str, tuple[str, ...]]

_MOST_BYTES = 1_000_000
_MOST_DOTS = 2000  # TOML's reader takes the square of the parts of a key
_MOST_NAMES = 200  # of a skeleton that a message lists or guesses among


def default_names() -> JointNames:
    """The built-in joint names for each role, in order of preference."""
    return _checked_names(_default_table()["joints"], "the built-in joint names")


def read_mapping(path: str | PathLike[str]) -> JointNames:
    """Read a mapping file.

    Parameters
    ----------
    path : path
        A TOML file as in the module's description.

    Returns
    -------
    mapping from role to names
        Only the roles that the file names.

    Raises
    ------
    MotionFileError
        The file cannot be read, is no TOML, has no ``[joints]``, or names an unknown role.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise MotionFileError(f"{path}: is too large, expected a joint mapping file of at most {_MOST_BYTES} bytes")
        if content.count(b".") > _MOST_DOTS:
            raise MotionFileError(
                f"{path}: has {content.count(b'.')} dots, expected a joint mapping file, which nests nothing, with at "
                f"most {_MOST_DOTS}"
            )
        table = tomllib.loads(content.decode("utf-8"))
    except MotionFileError:
        raise
    except OSError as error:
        raise MotionFileError(
            f"{path}: cannot be read ({error.strerror or error}); expected a joint mapping file"
        ) from error
    except (ValueError, RecursionError) as error:
        raise MotionFileError(
            f"{path}: is no TOML ({error}); expected a joint mapping file such as\n{_example()}"
        ) from error
    joints = table.get("joints")
    other = sorted(set(table) - {"joints"})
    if not isinstance(joints, dict) or not joints or other:
        found = f"the entries {', '.join(other)}" if other else "no table [joints]"
        raise MotionFileError(f"{path}: has {found}; expected one table [joints], such as\n{_example()}")
    return _checked_names(joints, str(path))


def map_joints(capture: Capture, names: JointNames | None = None) -> dict[str, int]:
    """Find the joint of a capture for every role.

    Parameters
    ----------
    capture : Capture
    names : mapping from role to joint names, optional
        Looked up first, as written; see `read_mapping`. Other roles use `default_names`.

    Raises
    ------
    MotionFileError
        A role has no joint, two roles have the same one, or a knee does not hang from its hip (an
        elbow from its shoulder, and so on). The message lists all such roles, the names in the
        file, and what to write into a mapping file.
    """
    given = {role: each for role, each in (names or {}).items() if role in ROLES}
    exact = {name: index for index, name in enumerate(capture.names)}
    plain = _plain_names(capture)
    found: dict[str, int] = {}
    missing: dict[str, tuple[str, ...]] = {}
    for role, candidates in {**default_names(), **given}.items():
        places = exact if role in given else {}
        for name in candidates:
            place = places.get(name, plain.get(_plain(name, ())))
            if place is not None:
                found[role] = place
                break
        else:
            missing[role] = candidates
    ends = _ends(capture, found, missing)
    if len(ends) == len(missing):
        found |= ends
    else:
        raise MotionFileError(_missing_message(capture, found, missing))
    _check_tree(capture, found)
    return {role: found[role] for role in ROLES}


def more_joints(capture: Capture, names: JointNames | None = None) -> dict[str, int]:
    """Return the joints of a capture for `MORE_ROLES`, as far as it has them; ``names`` as of `map_joints`."""
    plain = _plain_names(capture)
    candidates = {**_checked_names(_default_table()["more"], "the built-in joint names"), **(names or {})}
    found = {
        role: next((plain[key] for name in candidates[role] if (key := _plain(name, ())) in plain), None)
        for role in MORE_ROLES
    }
    return {role: index for role, index in found.items() if index is not None}


def _ends(capture: Capture, found: Mapping[str, int], missing: Collection[str]) -> dict[str, int]:
    """Return what hangs as the only one from knees and elbows whose ankles and wrists have no known name."""
    ends = {}
    for side, limb in LIMBS:
        _, hinge, end = (f"{side}_{joint}" for joint in CHAINS[limb])
        if end in missing and hinge in found:
            below = [i for i, joint in enumerate(capture.joints) if joint.parent == found[hinge]]
            if len(below) == 1 and below[0] not in found.values():
                ends[end] = below[0]
    return ends


def _check_tree(capture: Capture, found: Mapping[str, int]) -> None:
    owner: dict[int, str] = {}
    for role in ROLES:
        index = found[role]
        if index in owner:
            raise MotionFileError(
                f"{capture.path}: {owner[index]} and {role} are both mapped to the joint "
                f"{capture.names[index]!r}; expected a joint of its own for each. "
                f"Write a mapping file:\n{_example(capture, found)}"
            )
        owner[index] = role
    for side, limb in LIMBS:
        chain = [f"{side}_{joint}" for joint in CHAINS[limb]]
        for upper, lower in pairwise(chain):
            if not capture.is_below(found[lower], found[upper]):
                raise MotionFileError(
                    f"{capture.path}: {lower} is mapped to {capture.names[found[lower]]!r}, which "
                    f"does not hang from {capture.names[found[upper]]!r}, mapped to {upper}. "
                    f"Write a mapping file:\n{_example(capture, found)}"
                )


def _missing_message(capture: Capture, found: Mapping[str, int], missing: Mapping[str, tuple[str, ...]]) -> str:
    taken = {capture.names[index] for index in found.values()}
    names = capture.joint_names[:_MOST_NAMES]
    more = len(capture.joint_names) - len(names)
    free = [name for name in names if name not in taken]
    lines = [f"{capture.path}: these joints could not be found by their names:"]
    for role, candidates in missing.items():
        tried = ", ".join(candidates[:4]) + (", ..." if len(candidates) > 4 else "")
        near = _close(role, candidates, free)
        hint = f"; perhaps {' or '.join(repr(name) for name in near)}" if near else ""
        lines.append(f"  {role}: looked for {tried}{hint}")
    lines.append("The file's joints are: " + ", ".join(names) + (f" and {more} more." if more else "."))
    lines.append("Say which is which in a mapping file (--mapping FILE), such as:")
    lines.append(_example(capture, found, missing, free))
    return "\n".join(lines)


def _close(role: str, candidates: tuple[str, ...], free: list[str]) -> list[str]:
    """Joint names that resemble one of the names looked for, best first."""
    plain = {_plain(name, ()): name for name in free}
    near: list[str] = []
    for sought in (*candidates, role):
        for match in get_close_matches(_plain(sought, ()), plain, n=1, cutoff=0.75):
            if plain[match] not in near:
                near.append(plain[match])
    return near[:2]


def _example(
    capture: Capture | None = None,
    found: Mapping[str, int] | None = None,
    missing: Mapping[str, tuple[str, ...]] | None = None,
    free: list[str] | None = None,
) -> str:
    """A mapping file: the missing roles with guesses, else all roles with what they have now."""
    lines = ["[joints]"]
    for role in missing or ROLES:
        value = "name of the joint in the file"
        if missing is not None:
            value = next(iter(_close(role, missing[role], free or [])), value)
        elif capture is not None and found is not None:
            value = capture.names[found[role]]
        lines.append(f'{role} = "{value}"')
    return "\n".join(lines)


def _plain(name: str, prefixes: tuple[str, ...]) -> str:
    """`name` reduced to lower-case letters and digits, without name space and prefix."""
    plain = re.sub(r"[^a-z0-9]", "", name.rsplit(":", 1)[-1].lower())
    for prefix in prefixes:
        if plain.startswith(prefix) and len(plain) > len(prefix):
            return plain[len(prefix) :]
    return plain


def _plain_names(capture: Capture) -> dict[str, int]:
    """Return the joints of a capture by their plain names; of several of one name the first."""
    prefixes = tuple(_default_table()["prefixes"])
    plain: dict[str, int] = {}
    for index, name in enumerate(capture.names):
        plain.setdefault(_plain(name, prefixes), index)
    return plain


def _default_table() -> dict[str, Any]:
    text = files("leastaction_marionette.retargeting").joinpath("joint_names.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _checked_names(joints: object, where: str) -> JointNames:
    names: dict[str, tuple[str, ...]] = {}
    if not isinstance(joints, dict):
        raise MotionFileError(f"{where}: expected a table of roles and joint names")
    for role, value in joints.items():
        if role not in (*ROLES, *MORE_ROLES):
            near = get_close_matches(role, (*ROLES, *MORE_ROLES), n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise MotionFileError(
                f"{where}: unknown role {reprlib.repr(role)}; {hint}The roles are: {', '.join((*ROLES, *MORE_ROLES))}"
            )
        listed = [value] if isinstance(value, str) else value
        if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
            raise MotionFileError(
                f"{where}: role {role} is {reprlib.repr(value)}; expected a joint name or a list of them"
            )
        names[role] = tuple(listed)
    return names
