"""A document: plain data of a file, and where in the file each part stands."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from leastaction.errors import ModelFileError, brief
from leastaction.numerics.documents import types
from leastaction.numerics.documents.dialect import loader

T = TypeVar("T")
Place = tuple[str | int, ...]
"""Where something stands in a document: keys, and places in lists."""

Notation = Literal["yaml", "json"]
NOTATIONS: dict[str, Notation] = {".yaml": "yaml", ".yml": "yaml", ".json": "json"}


def shown(place: Place) -> str:
    """Return a place as text, such as ``frames[3].children[0].mass``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).removeprefix(".")


@dataclass(frozen=True)
class Document:
    """Plain data as it was read. ``title``: what the file is called in messages. ``folder``: where it lies."""

    title: str
    data: Any
    text: str = field(repr=False)
    folder: Path = Path()

    def error(self, place: Place, message: str) -> ModelFileError:
        """Return the error of a place, with its path and its line."""
        where = shown(place)
        line = self.line(place)
        at = f", line {line}" if line else ""
        return ModelFileError(f"{self.title}{at}: {where + ': ' if where else ''}{message}", line=line)

    def line(self, place: Place) -> int | None:
        """Return the line of a place, or of what holds it where it is not there; None where there is no text."""
        import yaml

        if not self.text:
            return None
        try:
            node = yaml.compose(self.text, Loader=loader())
        except (yaml.YAMLError, RecursionError):
            return None  # JSON that is no YAML, such as with tabs
        line = node.start_mark.line
        for key in place:
            if isinstance(node, yaml.MappingNode):
                found = [(k, v) for k, v in node.value if k.value == str(key)]
                if not found:
                    break
                line, node = found[0][0].start_mark.line, found[0][1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
                node = node.value[key]
                line = node.start_mark.line
            else:
                break
        return int(line) + 1

    def value(self, place: Place) -> Any:
        """Return what stands at a place."""
        value = self.data
        for key in place:
            value = value[key]
        return value

    def read_as(self, kind: type[T], **hooks: Any) -> T:
        """Return the data as a type of msgspec's.

        ``hooks``: of `msgspec.convert`. Raises `ModelFileError` with the place of what does not fit.
        """
        try:
            found: T = msgspec.convert(self.data, kind, **hooks)
            return found
        except msgspec.ValidationError as error:
            place, message = types.explained(error, self.data, kind)
            raise self.error(place, message) from None
        except RecursionError:
            raise self.too_deep() from None

    def too_deep(self) -> ModelFileError:
        """Return the error of a file that nests too deeply."""
        return ModelFileError(f"{self.title}: it is nested too deeply to be read; name a `parent:` instead of nesting")


def read_document(path: str | os.PathLike[str]) -> Document:
    """Read a file in YAML (``.yaml``, ``.yml``) or JSON (``.json``).

    Raises `ModelFileError` for a file that is not there, is a folder or is broken, with the line; for another ending.
    """
    file = Path(path)
    notation = NOTATIONS.get(file.suffix.lower())
    if notation is None:
        raise ModelFileError(f"{file}: got the ending {file.suffix!r}, expected one of {', '.join(NOTATIONS)}")
    try:
        content = file.read_bytes()
    except FileNotFoundError:
        raise ModelFileError(f"{file}: there is no such file; check the path") from None
    except IsADirectoryError:
        raise ModelFileError(f"{file}: it is a folder; name a file in it") from None
    except OSError as error:
        raise ModelFileError(f"{file}: it cannot be read: {error.strerror or error}") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ModelFileError(f"{file}, line {line}: it is no text in UTF-8; save it as that", line=line) from None
    return document_of(text, notation, title=str(file), folder=file.parent)


def document_of(text: str, notation: Notation, *, title: str = "the text", folder: Path = Path()) -> Document:
    """Return the document that a text is, as `read_document` does of a file."""
    if not text.strip():
        raise ModelFileError(f"{title}: it is empty")
    data = _json(text, title) if notation == "json" else _yaml(text, title)
    if not isinstance(data, dict):
        raise ModelFileError(f"{title}: got {brief(repr(data))}, expected a mapping of keys to values, `key: value`")
    return Document(title, data, text, folder)


def check_format(document: Document, expected: str) -> None:
    """Raise a `ModelFileError` unless a document says that it is of a format, such as ``"mechanism 1"``."""
    found = document.data.get("leastaction")
    if found is None:
        raise document.error((), f"the key 'leastaction' is missing; the first line is `leastaction: {expected}`")
    if found == expected:
        return
    kind, _, version = str(found).partition(" ")
    if kind == expected.partition(" ")[0] and version.isdigit():
        raise document.error(("leastaction",), f"got version {version}, expected {expected!r}; update leastaction")
    raise document.error(("leastaction",), f"got {found!r}, expected {expected!r}")


def _json(text: str, title: str) -> Any:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise ModelFileError(f"{title}: the key {twice!r} stands twice in one object; name it once")
        return found

    try:
        return json.loads(text, object_pairs_hook=once)
    except json.JSONDecodeError as error:
        raise ModelFileError(
            f"{title}, line {error.lineno}, column {error.colno}: no JSON: {error.msg}", line=error.lineno
        ) from None
    except RecursionError:
        raise Document(title, None, "").too_deep() from None


def _yaml(text: str, title: str) -> Any:
    import yaml

    try:
        return yaml.load(text, Loader=loader())  # the loader is a safe one
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        where = "" if mark is None else f", line {line}, column {mark.column + 1}"
        context = f"{error.context}: " if error.context else ""
        raise ModelFileError(f"{title}{where}: no YAML: {context}{error.problem}", line=line) from None
    except (yaml.YAMLError, ValueError) as error:
        raise ModelFileError(f"{title}: no YAML: {error}") from None
    except RecursionError:
        raise Document(title, None, "").too_deep() from None
