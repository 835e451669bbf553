"""What msgspec says of data that do not fit a type, in the words of a message and with the names that do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import msgspec
import msgspec.inspect as inspect

from leastaction.errors import brief, closest

_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "object": "a mapping",
    "array": "a list",
    "null": "nothing",
}
_BOUNDS = (
    (r"`array` of length >= (\d+)", r"a list of \1 or more"),
    (r"`array` of length <= (\d+)", r"a list of \1 at most"),
    (r"`float`", "a number"),
    (r"`int`", "a whole number"),
)
_STEP = re.compile(r"\.(\w+)|\[(\d+)\]|\[(\.\.\.)\]")


def explained(error: msgspec.ValidationError, data: Any, kind: Any) -> tuple[tuple[str | int, ...], str]:
    """Return the place that an error is about, and what it says."""
    message, _, path = str(error).partition(" - at `$")
    place = tuple(_places(path, message, data))
    value = data
    for key in place:
        value = value[key]
    if match := re.match(r"Expected `(.+?)`(.*), got `(.+)`$", message):
        wanted = " or ".join(_WORDS.get(word, word) for word in match[1].split(" | "))
        return place, f"got {brief(repr(value))}, expected {wanted}{match[2]}{_hint(value, match[1])}"
    struct = _at(kind, data, place)
    if match := re.match(r"Object contains unknown field `(.+)`", message):
        known = [f.encode_name for s in struct for f in s.fields] + [s.tag_field for s in struct if s.tag_field]
        return (*place, match[1]), f"unknown key; {closest(match[1], dict.fromkeys(known), what='keys here')}"
    if match := re.match(r"Object missing required field `(.+)`", message):
        needed = [f.encode_name for s in struct for f in s.fields if f.required]
        more = f"; needed are {', '.join(dict.fromkeys(needed))}" if len(struct) == 1 else ""
        if len(struct) > 1 and match[1] == struct[0].tag_field:
            more = f"; {closest(None, [repr(s.tag) for s in struct], what='choices')}".replace('"', "")
        return place, f"the key {match[1]!r} is missing{more}"
    if message.startswith(("Invalid value", "Invalid enum value")):
        known = [str(s.tag) for s in _at(kind, data, place[:-1]) if s.tag_field == place[-1]] or _choices(
            kind, data, place
        )
        return place, f"got {value!r}; {closest(value, known, what='choices')}"
    return place, f"got {brief(repr(value))}, {_in_words(message)}"


def _in_words(message: str) -> str:
    """Return what else msgspec says, in words."""
    text = message[0].lower() + message[1:]
    for pattern, words in _BOUNDS:
        text = re.sub(pattern, words, text)
    return text.replace("`", "")


def _hint(value: object, wanted: str) -> str:
    if isinstance(value, str) and wanted.split(" | ")[0] in ("float", "int") and value[:1].isdigit():
        return "; without a unit: all are SI units and radians"
    return ""


def _places(path: str, message: str, data: Any) -> Iterator[str | int]:
    """Yield the keys of a path; which value of a mapping msgspec does not say, so the first that is wrong."""
    value = data
    for match in _STEP.finditer(path):
        key: str | int
        if match[3]:
            wanted = message.partition("`")[2].partition("`")[0]
            wrong = [k for k, v in value.items() if not _is(v, wanted)] if isinstance(value, dict) else []
            if not wrong:
                return
            key = wrong[0]
        else:
            key = match[1] if match[1] else int(match[2])
        if isinstance(value, dict) and key not in value:
            return
        yield key
        value = value[key]


def _is(value: object, words: str) -> bool:
    types: dict[str, Any] = {"float": (int, float), "int": int, "str": str, "bool": bool, "object": dict, "array": list}
    return any(
        isinstance(value, types.get(word, object)) and not (isinstance(value, bool) and word != "bool")
        for word in words.split(" | ")
    )


def _at(kind: Any, data: Any, place: tuple[str | int, ...]) -> list[inspect.StructType]:
    """Return the structs that may stand at a place; of those with tags the one that the data name."""
    return [each for each in _kinds(kind, data, place) if isinstance(each, inspect.StructType)]


def _choices(kind: Any, data: Any, place: tuple[str | int, ...]) -> list[str]:
    return [str(v) for each in _kinds(kind, data, place) if isinstance(each, inspect.LiteralType) for v in each.values]


def _kinds(kind: Any, data: Any, place: tuple[str | int, ...]) -> list[inspect.Type]:
    kinds, value = _flat(inspect.type_info(kind), data), data
    for key in place:
        inner: list[inspect.Type] = []
        value = value[key]
        for each in kinds:
            if isinstance(each, inspect.StructType):
                inner += [f.type for f in each.fields if f.encode_name == key]
            elif isinstance(each, inspect.CollectionType):
                inner.append(each.item_type)
            elif isinstance(each, inspect.DictType):
                inner.append(each.value_type)
        kinds = [flat for each in inner for flat in _flat(each, value)]
    return kinds


def _flat(kind: inspect.Type, value: Any) -> list[inspect.Type]:
    if isinstance(kind, inspect.Metadata):
        return _flat(kind.type, value)
    if not isinstance(kind, inspect.UnionType):
        return [kind]
    every = [flat for each in kind.types for flat in _flat(each, value)]
    named: list[inspect.Type] = [
        each
        for each in every
        if isinstance(each, inspect.StructType)
        and isinstance(value, dict)
        and value.get(each.tag_field or "") == each.tag
    ]
    return named or every
