"""What readers of motion capture files share: text of bounded size, numbers as files write them, errors with a line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from leastaction.errors import MotionFileError

_MOST_BYTES = 2**30
# Indefinite numbers of Microsoft's libraries before 2015, rounded as digits would be: 1.#IND, 1.#QNAN0, 1.#IO, 1.#J.
_SPECIAL = re.compile(r"[+-]?[0-9]+[.,]#")
_MISSING = re.compile(
    r"[+-]?(?:nan[qs]?(?:\(\w*\))?|[0-9]+[.,](?:#(?:ind|qnan|snan)[0-9]*|#(?:i[no]|j|r|qn?|qo|qnb|s|sn|so|snb)|\$))",
    re.IGNORECASE | re.ASCII,
)
SHORTEST, LONGEST = 1e-9, 1e6
"""Seconds from one frame to the next: what is out of that is no capture."""


class MotionText:
    """The lines of a motion capture file, and the one being looked at. For one thread."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.lines = text.splitlines()
        self.line = 0  # being looked at, from 1, for messages

    def uncommented(self) -> Iterator[list[str]]:
        """Words of each line that has some, without comments (from # on); the last line is looked at after them."""
        for number, line in enumerate(self.lines, start=1):
            self.line = number
            if words := _uncommented(line):
                yield words
        self.line = max(1, len(self.lines))

    def fail(self, found: str, expected: str) -> NoReturn:
        """Raise `MotionFileError` that names the line, what was found, and what was expected."""
        raise MotionFileError(
            f"{self.path}, line {self.line}: {found}; expected {expected}. Export or fetch the file again."
        )


def read_text(path: Path, kind: str) -> str:
    """Return the text of a file; ``kind`` is what it is to be, such as "a BVH".

    Raises `MotionFileError`: it cannot be read, is no text, or is too large.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise MotionFileError(
            f"{path}: cannot be read ({error.strerror or error}); expected {kind} motion capture file. Check the path."
        ) from error
    except UnicodeDecodeError as error:
        raise MotionFileError(
            f"{path}: holds bytes that are no text; expected {kind} motion capture file, which is "
            f"text. Export the motion as {kind.split()[-1]}."
        ) from error
    if len(content) > _MOST_BYTES:
        raise MotionFileError(
            f"{path}: is larger than {_MOST_BYTES} bytes; expected {kind} motion capture file. Cut it."
        )
    return text


def number_of(word: str) -> float:
    """Return the number that `word` spells, NaN if it spells none.

    Python's float() knows more numbers than other programs do, such as 1_0 and those in other digits.
    """
    if "_" in word or not word.isascii():
        return float("nan")
    try:
        return float(word)
    except ValueError:
        return float("nan")


def is_missing(word: str) -> bool:
    """Whether a word says that there is no number: NaN, as C, C++, Python, AIX and Microsoft's libraries print it."""
    return bool(_MISSING.fullmatch(word))


def _uncommented(line: str) -> list[str]:
    """Return the words of a line before its comment; # after digits and a point belongs to a value, as in 1.#QNAN."""
    if "#" not in line:
        return line.split()
    words: list[str] = []
    for word in line.split():
        before, mark, _ = word.partition("#")
        if mark and not _SPECIAL.match(word):
            return [*words, before] if before else words
        words.append(word)
    return words


def shown(text: str, limit: int = 60) -> str:
    """Return `text` quoted, made printable and cut to a length that fits a message."""
    return repr(text if len(text) <= limit else text[:limit] + "...")
