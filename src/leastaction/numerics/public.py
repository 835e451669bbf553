"""What every public function and class is called through: what is given is held against what the signature says.

Flags, numbers and functions are looked at before a call, for nothing in it would notice a wrong one; everything else
where the call fails with an error that is not the package's own, and after the construction of an object, which may
keep it for later. A function says more of what it wants than its signature does, so what it says itself comes first.
An `ArgumentError` that leaves a call gets the name of what was called. What a user's function raises passes unchanged,
and so does what the package calls of itself.
"""

from __future__ import annotations

import enum
import functools
import inspect
import os
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sized
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, KeywordError, LackingArgumentError, LeastActionError, brief
from leastaction.numerics.printed import printed

T = TypeVar("T")

_frame = sys._getframe

_UNTYPED = (TypeError, ValueError, AttributeError, LookupError, ArithmeticError)
_OURS = {"leastaction", "numpy", "scipy", "sympy", "h5py", "matplotlib", *sys.stdlib_module_names} - {"__main__"}
_CALLED_BY_USERS = ("__init__", "__call__", "__getitem__")
_DESCRIBES = (
    "leastaction.mechanics.description",
    "leastaction.mechanics.elements",
    "leastaction.mechanics.expressions",
    "leastaction.numerics.curve",
)


class Asked(NamedTuple):
    """What an annotation asks for: whether a value fits, in words, and whether nothing else would look at it."""

    fits: Callable[[object], bool]
    words: str
    early: bool = False


def public(it: T) -> T:
    """Return a public function that is called through checks; a class is changed in its place, with its methods.

    A class that does not say what it prints as prints what it was made of.
    Of what describes a mechanism keywords alone are checked: values are when it is compiled, and named by their place.
    """
    if inspect.isfunction(it):
        return _around(it, it.__name__)  # type: ignore[return-value]
    assert inspect.isclass(it)
    assert not issubclass(it, (BaseException, enum.Enum))
    if it.__repr__ is object.__repr__:
        it.__repr__ = printed  # type: ignore[method-assign]
    for name, found in list(vars(it).items()):
        if name != "__init__" and (_describes(it) or (name.startswith("_") and name not in _CALLED_BY_USERS)):
            continue
        if name.startswith("own_") and hasattr(it, name.removeprefix("own_")):
            # The method without these letters calls it, and is what users call.
            name = name.removeprefix("own_")
            found = vars(it).get(name, getattr(it, name))
        bound = type(found) if isinstance(found, (staticmethod, classmethod)) else None
        function = found.__func__ if isinstance(found, (staticmethod, classmethod)) else found
        if inspect.isfunction(function) and not hasattr(function, "__is_public__"):
            shown = "" if name == "__init__" else f".{name}"
            around = _around(function, f"{it.__name__}{shown}" if bound is staticmethod else shown)
            setattr(it, name, bound(around) if bound else around)
    return it


def checked(it: T) -> T:
    """Return a public function within its checks, for one that hands on what its own caller gave."""
    return it.__checks__  # type: ignore[attr-defined,no-any-return]


def called_publicly(function: Callable[..., Any]) -> _Signature:
    """Return what is known of the arguments of something public."""
    return _Signature(inspect.unwrap(function.__init__ if inspect.isclass(function) else function))


def _describes(it: Any) -> bool:
    return str(it.__module__).startswith(_DESCRIBES)


def _around(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function, or a method by its class, within its checks."""
    seen: _Signature | None = None
    makes = function.__name__ == "__init__"

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if _frame(1).f_globals.get("__name__", "")[:12] == "leastaction.":
            return function(*arguments, **named)
        return checks(*arguments, **named)

    def checks(*arguments: Any, **named: Any) -> Any:
        nonlocal seen
        if seen is None:
            seen = _Signature(function, of_object=not name or name.startswith("."))
        try:
            if named or seen.early:
                seen.check_early(arguments, named)
            result = function(*arguments, **named)
            if makes and seen.looks_at_values:
                seen.check(arguments, named)
            return result
        except ArgumentError as error:
            seen.tell(error, name, arguments)
            raise
        except LeastActionError:
            raise
        except _UNTYPED as error:
            if _is_ours(error.__traceback__):
                try:
                    seen.explain(error, arguments, named)
                except ArgumentError as named_error:
                    seen.tell(named_error, name, arguments)
                    raise
            raise

    call.__is_public__ = True  # type: ignore[attr-defined]
    call.__checks__ = checks  # type: ignore[attr-defined]
    return call


def _is_ours(traceback: TracebackType | None) -> bool:
    """Whether an error comes from the package, or from what it calls; else it is of a user's function."""
    module = ""
    while traceback is not None:
        module = traceback.tb_frame.f_globals.get("__name__", "").partition(".")[0]
        traceback = traceback.tb_next
    return module in _OURS


class _Signature:
    """The parameters of a function, with what their annotations ask for."""

    def __init__(self, function: Callable[..., Any], *, of_object: bool = False) -> None:
        self.of_object = of_object
        parameters = inspect.signature(function).parameters.values()
        plain = [p for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
        self.looks_at_values = not _describes(function)
        self.kinds = {p.name: kind_of(p.annotation, function) for p in plain}
        self.positional = [p.name for p in plain if p.kind != p.KEYWORD_ONLY]
        self.keywords = [p.name for p in plain[of_object:] if p.kind != p.POSITIONAL_ONLY]
        self.needed = [p.name for p in plain[of_object:] if p.default is p.empty]
        early = [(i, name) for i, name in enumerate(self.positional) if self.kinds[name].early]
        self.early = early if self.looks_at_values else []
        self.flags = [name for name, kind in self.kinds.items() if kind is _SIMPLE[bool]]
        self.takes_more = len(plain) < len(parameters) and any(p.kind == p.VAR_POSITIONAL for p in parameters)
        self.open = False
        for more in (p for p in parameters if p.kind == p.VAR_KEYWORD):
            options = resolved(more.annotation, function)
            self.open = typing.get_origin(options) is not typing.Unpack
            self.keywords += [] if self.open else list(typing.get_type_hints(typing.get_args(options)[0]))

    def tell(self, error: ArgumentError, name: str, arguments: tuple[Any, ...]) -> None:
        """Say in an error what was called, a method by the class of its object, and which keywords it has besides."""
        if not name or name.startswith("."):
            owner = arguments[0]
            name = f"{owner.__name__ if inspect.isclass(owner) else type(owner).__name__}{name}"
        error.function = name
        if isinstance(error, KeywordError):
            error.known.update(self.keywords)

    def check_early(self, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> None:
        """Raise an `ArgumentError` for what nobody else would look at."""
        for i, name in self.early:
            if i < len(arguments) and not self.kinds[name].fits(arguments[i]):
                raise _unfit(name, self.kinds[name], arguments[i])
        for name, value in named.items():
            kind = self.kinds.get(name, ANY)
            if kind.early and self.looks_at_values and not kind.fits(value):
                raise _unfit(name, kind, value)
            if name not in self.keywords and not self.open:
                raise KeywordError(name, self.keywords)

    def check(self, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> None:
        """Raise an `ArgumentError` for the first argument that is not what its annotation asks for."""
        for name, value in (*zip(self.positional, arguments, strict=False), *named.items()):
            kind = self.kinds.get(name, ANY)
            if not kind.fits(value):
                raise _unfit(name, kind, value)

    def explain(self, error: Exception, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> None:
        """Raise an `ArgumentError` for the argument that made a call fail, if there is one that does not fit."""
        if len(arguments) > len(self.positional) and not self.takes_more:
            places = self.positional[self.of_object :]
            words = [name for name in self.keywords if name not in self.positional]
            raise ArgumentError(
                f"got {len(arguments) - len(self.positional) + len(places)} arguments by their place, expected at most "
                f"{len(places)} ({', '.join(places) or 'none'}); the others go by their names: "
                f"{', '.join(f'{word}=' for word in words) or 'there are none'}"
            ) from error
        self.check(arguments, named)
        given = {**dict(zip(self.positional, arguments, strict=False)), **named}
        if lacking := [name for name in self.needed if name not in given]:
            raise LackingArgumentError(f"lacks {', '.join(lacking)}") from error
        for name, value in given.items():
            called = f"{getattr(value, '__name__', None)}()"
            if callable(value) and (inspect.isclass(value) or str(error).partition(" ")[0].endswith(called)):
                said = f"{name}: got {brief(repr(value))}, expected a function that can be called so: {error}"
                raise ArgumentError(said) from error
        numbers = {name: value for name, value in given.items() if name != "self" and value is not None}
        if numbers and all(map(_are_numbers, numbers.values())):
            shown = [
                f"{name} {f'of shape {n}' if (n := np.shape(value)) else value}" for name, value in numbers.items()
            ]
            raise ArgumentError(f"got {brief(', '.join(shown))}, which do not go together: {error}") from error


def _unfit(name: str, kind: Asked, value: object) -> ArgumentError:
    return ArgumentError(f"{name}: got {brief(repr(value))} ({type(value).__name__}), expected {kind.words}")


def resolved(annotation: object, function: Callable[..., Any]) -> object:
    """Return what an annotation means where its function stands; `Any` where that is known to type checkers alone."""
    if isinstance(annotation, str):
        try:
            return eval(annotation, inspect.unwrap(function).__globals__)
        except (NameError, TypeError, AttributeError):
            return Any
    return annotation


def kind_of(annotation: object, function: Callable[..., Any]) -> Asked:
    """Return what an annotation of a function asks for."""
    it: Any = resolved(annotation, function)
    simple = _SIMPLE.get(it) if it.__hash__ is not None else None
    if simple:
        return simple
    if it in (Any, object, inspect.Parameter.empty) or isinstance(it, TypeVar):
        return ANY
    origin, arguments = typing.get_origin(it), typing.get_args(it)
    if origin in (typing.Union, types.UnionType):
        arrays = set(typing.get_args(ArrayLike))
        # NumPy counts words among arrays; one that is meant stands before them.
        if arrays <= set(arguments):
            arrays -= {arguments[0]} & {str}
            return _any_of([NUMBERS, *(kind_of(each, function) for each in arguments if each not in arrays)])
        return _any_of([kind_of(each, function) for each in arguments])
    if origin is typing.Literal:
        return Asked(lambda value: isinstance(value, str) and value in arguments, " or ".join(map(repr, arguments)))
    if origin is typing.Unpack:
        return ANY
    if origin is np.ndarray:
        return ARRAY
    it = origin or it
    if not inspect.isclass(it) or getattr(it, "_is_protocol", False) or it.__module__ == "typing":
        return ANY
    if it.__name__ == "Callable":
        return FUNCTION
    if issubclass(it, Mapping):
        return _mapping_of(*(kind_of(each, function) for each in arguments or (Any, Any)))
    if it is os.PathLike:
        return Asked(lambda value: isinstance(value, it), "a path")
    if it is tuple and arguments and arguments[-1] is not Ellipsis:
        return _tuple_of([kind_of(each, function) for each in arguments])
    if issubclass(it, Iterable) and origin is not None:
        return _list_of(kind_of(arguments[0], function) if arguments else ANY)
    article = "an" if it.__name__[0] in "AEIOU" else "a"
    return Asked(lambda value: isinstance(value, it), f"{article} {it.__name__}")


def _any_of(kinds: list[Asked]) -> Asked:
    if ANY in kinds:
        return ANY
    return Asked(
        lambda value: any(kind.fits(value) for kind in kinds),
        " or ".join(dict.fromkeys(kind.words for kind in kinds)),
        all(kind.early for kind in kinds),
    )


def _list_of(entry: Asked) -> Asked:
    def fits(value: object) -> bool:
        if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
            return False
        return not hasattr(value, "__len__") or all(map(entry.fits, value))

    return Asked(fits, "a list" if entry is ANY else f"a list, each of it {entry.words}")


def _tuple_of(entries: list[Asked]) -> Asked:
    def fits(value: object) -> bool:
        if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Sized) or not isinstance(value, Iterable):
            return False
        return len(value) == len(entries) and all(asked.fits(each) for asked, each in zip(entries, value, strict=True))

    return Asked(fits, f"{len(entries)} of these: {', '.join(entry.words for entry in entries)}")


def _mapping_of(key: Asked, entry: Asked) -> Asked:
    def fits(value: object) -> bool:
        return isinstance(value, Mapping) and all(map(key.fits, value)) and all(map(entry.fits, value.values()))

    return Asked(fits, f"a mapping of {key.words} to {entry.words}")


def _is_number(value: object) -> bool:
    if type(value) is float:
        return True
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, int):
        return not isinstance(value, bool) and -_LARGEST < value < _LARGEST
    return isinstance(value, (float, np.integer, np.floating))


def _is_whole(value: object) -> bool:
    return hasattr(value, "__index__") and not isinstance(value, (bool, np.bool_, type)) and np.ndim(value) == 0  # type: ignore[arg-type]


_LARGEST = int(sys.float_info.max)


def _are_numbers(value: object) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except (TypeError, ValueError, OverflowError):
        return False


ANY = Asked(lambda _: True, "anything")
NUMBERS = Asked(_are_numbers, "numbers")
ARRAY = Asked(lambda value: isinstance(value, (np.ndarray, list, tuple)) and _are_numbers(value), "an array of numbers")
FUNCTION = Asked(callable, "a function", early=True)
_SIMPLE: dict[object, Asked] = {
    bool: Asked(lambda value: isinstance(value, (bool, np.bool_)), "True or False", early=True),
    int: Asked(_is_whole, "a whole number", early=True),
    float: Asked(_is_number, "a number", early=True),
    str: Asked(lambda value: isinstance(value, str), "a word"),
    None: Asked(lambda value: value is None, "None", early=True),
    type(None): Asked(lambda value: value is None, "None", early=True),
}
