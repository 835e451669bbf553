"""Elements as plain data, and back: their types in a file are made from the fields of their classes.

So an element that is new in `leastaction.mechanics.elements` is one in files too, as long as its fields hold names,
numbers, lists and mappings of those, curves, expressions, or frozen dataclasses of such.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from inspect import isabstract
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from leastaction.errors import DescriptionError, ModelFileError
from leastaction.mechanics import elements
from leastaction.mechanics.elements import Element, kinds
from leastaction.mechanics.mechanism.record.frames import UNIT
from leastaction.mechanics.mechanism.record.types import Matrix, Strict
from leastaction.numerics.curve import Curve
from leastaction.numerics.documents import Document, Place

THROUGH = " -> "
"""Between the frames of a path that is a key, as of a sum of paths by their factors."""


class CurveRecord(Strict, kw_only=True):
    """A smooth curve: through points (x, y), or of polynomials as a `Curve` has them."""

    x: list[float] | UnsetType = UNSET
    y: list[float] | UnsetType = UNSET
    breaks: list[float] | UnsetType = UNSET
    coefficients: list[list[float]] | UnsetType = UNSET


class ExpressionRecord(Strict, kw_only=True):
    """An expression, where text alone would be the name of a variable."""

    expression: str


class _Expression:
    """Stands for SymPy's expressions in the types of fields; SymPy itself need not be there."""


_SYMPY = {"sympy": SimpleNamespace(Expr=_Expression)}


class _UnwritableError(Exception):
    """A field holds what no file can say."""


# Types


@cache
def element_types() -> dict[str, type[Strict]]:
    """Return the types of the elements that files can hold, by the names of their classes."""
    found = {}
    for name, kind in _classes().items():
        try:
            found[name] = _struct(kind, tag=name)
        except _UnwritableError:
            continue
    return found


@cache
def _classes() -> dict[str, type[Element]]:
    """The classes of elements that can be made."""
    every = [vars(elements)[name] for name in elements.__all__]
    return {
        kind.__name__: kind
        for kind in every
        if isinstance(kind, type) and issubclass(kind, Element) and not isabstract(kind) and hasattr(kind, "called")
    }


def _struct(kind: type[Any], tag: str | None = None) -> type[Strict]:
    hints = get_type_hints(kind, localns=_SYMPY)
    entries: list[Any] = []
    for each in fields(kind):
        if not each.init:
            continue
        rotation = isinstance(each.metadata.get("kind"), kinds.Rotation)
        plain = Matrix if rotation else _plain_type(hints[each.name])
        needed = each.default is MISSING and each.default_factory is MISSING
        entries.append((each.name, plain) if needed else (each.name, plain | UnsetType, UNSET))
    made: Any = msgspec.defstruct(
        kind.__name__,
        entries,
        bases=(Strict,),
        tag=tag,
        tag_field="type" if tag else None,
        namespace={"__doc__": (kind.__doc__ or "").partition("\n")[0]},
        kw_only=True,
        forbid_unknown_fields=True,
    )
    return made  # type: ignore[no-any-return]


def _plain_type(hint: Any) -> Any:
    """Return what msgspec reads for a type of a field."""
    if hint in (float, int, str, bool, NoneType):
        return hint
    if hint is Curve:
        return CurveRecord
    if hint is _Expression:
        return str
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        # A name is text too, so an expression beside it says that it is one.
        texts = [
            ExpressionRecord if part is _Expression and str in arguments else _plain_type(part) for part in arguments
        ]
        return Union[tuple(texts)]  # noqa: UP007 - the list is made
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, _plain_type(arguments[1])]  # type: ignore[misc]
    if isinstance(origin, type) and issubclass(origin, Sequence):
        inner = {_plain_type(part) for part in arguments if part is not Ellipsis}
        return list[Union[tuple(inner)]]  # type: ignore[misc]  # noqa: UP007
    if isinstance(hint, type) and is_dataclass(hint):
        return _struct(hint)
    raise _UnwritableError(hint)


# Out


def element_data(element: Element) -> dict[str, Any]:
    """Return an element as plain data.

    Raises `ModelFileError` for one that calls Python, or that is no class of the package.
    """
    kind = type(element).__name__
    if _classes().get(kind) is not type(element):
        raise ModelFileError(f"{element.label}: it is a class of your own, which no file can say; use a pickle")
    if kind not in element_types():
        raise ModelFileError(
            f"{element.label}: it calls functions in Python, which no file can say; write it as an Expression "
            f"({kind.replace('Python', 'Expression')}), or use a pickle"
        )
    try:
        return {"type": kind, **_fields(element)}
    except DescriptionError as error:
        raise ModelFileError(f"{element.label}: {error}") from None


def _fields(given: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that are not what they are by default."""
    hints = get_type_hints(type(given), localns=_SYMPY)
    data = {}
    for each in fields(given):
        value = getattr(given, each.name)
        if each.default_factory is not MISSING:
            default: Any = each.default_factory()
        else:
            default = each.default
        if default is not MISSING and repr(_plain(value)) == repr(_plain(default)):
            continue
        plain = _plain(value)
        text = isinstance(plain, str) and not isinstance(value, str)
        if isinstance(value, str) and UNIT.match(value) and float in get_args(hints[each.name]):
            raise DescriptionError(
                f"{each.name}: the variable {value!r} is called like a number with a unit; rename it"
            )
        named = text and str in get_args(hints[each.name])
        data[each.name] = {"expression": plain} if named else plain
    return data


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return float(value)
    if isinstance(value, Mapping):
        return {_key(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Curve):
        return {"breaks": value.breaks.tolist(), "coefficients": value.coefficients.tolist()}
    if is_dataclass(value) and not isinstance(value, type):
        return _fields(value)
    from leastaction.mechanics.expressions.text import expression_text

    return expression_text(value)


def _key(key: str | tuple[str, ...]) -> str:
    """Return the key of a mapping as text: of a path through frames these, one after the other."""
    return key if isinstance(key, str) else THROUGH.join(key)


# In


def element_of(record: Strict, document: Document, place: Place) -> Element:
    """Return the element of a record; raise a `ModelFileError` with the place of what is wrong."""
    kind = _classes()[str(record.__struct_config__.tag)]
    try:
        made: Element = _made(kind, record)
    except DescriptionError as error:
        raise document.error(place, str(error)) from None
    return made


def _made(kind: type[Any], record: Strict) -> Any:
    hints = get_type_hints(kind, localns=_SYMPY)
    return kind(**{name: _value(value, hints[name], name) for name, value in record.given().items()})


def _value(value: Any, hint: Any, name: str) -> Any:
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if isinstance(value, CurveRecord):
        return _curve(value)
    if isinstance(value, ExpressionRecord) or (isinstance(value, str) and _Expression in parts and str not in parts):
        from leastaction.mechanics.expressions.terms import symbols

        symbols()  # or say that SymPy is needed
        from leastaction.mechanics.expressions.text import expression_of

        return expression_of(value.expression if isinstance(value, ExpressionRecord) else value)
    if isinstance(value, Strict):
        name_of = type(value).__name__
        return _made(next(part for part in _leaves(hint) if getattr(part, "__name__", "") == name_of), value)
    if isinstance(value, dict) and any(_by_paths(part) for part in parts):
        return {tuple(key.split(THROUGH)) if THROUGH in key else key: entry for key, entry in value.items()}
    if isinstance(value, list):
        inner = next((part for part in parts if get_args(part)), Any)
        return [_value(entry, Union[get_args(inner) or (Any,)], name) for entry in value]  # noqa: UP007
    if isinstance(value, str) and float in parts and UNIT.match(value):
        raise DescriptionError(f"{name}: got {value!r}, expected a number in SI units without a unit, or a variable")
    return value


def _by_paths(hint: Any) -> bool:
    """Whether a type is a mapping of paths."""
    arguments = get_args(hint)
    origin = get_origin(hint)
    mapping = isinstance(origin, type) and issubclass(origin, Mapping)
    return mapping and get_origin(arguments[0]) is tuple


def _leaves(hint: Any) -> Iterator[Any]:
    arguments = get_args(hint)
    if not arguments:
        yield hint
    for part in arguments:
        yield from _leaves(part)


def _curve(record: CurveRecord) -> Curve:
    given = record.given()
    if set(given) == {"x", "y"}:
        return Curve(given["x"], given["y"])
    if set(given) == {"breaks", "coefficients"}:
        return Curve.from_pieces(given["breaks"], given["coefficients"])
    raise DescriptionError(f"a curve has x and y, or breaks and coefficients; got {', '.join(given) or 'nothing'}")
