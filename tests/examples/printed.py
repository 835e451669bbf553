"""What pages show of what is printed: the same words, and numbers as near as machines and versions of the core are."""

from __future__ import annotations

import re

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")
_NOTHING = 1e-5  # below it a number is what rounding or differences leave
_ALIKE = 0.5  # of a number: iterations by another version of the core
_TIMED = re.compile(r"\d (us|ms)\b")


def assert_printed(shown: str, printed: str) -> None:
    """Hold what a page shows to what is printed; how long something takes may differ by as much as it likes."""
    lines = [[line.split() for line in text.strip().splitlines()] for text in (shown, printed)]
    assert len(lines[0]) == len(lines[1]), printed
    for page, now in zip(*(map(" ".join, each) for each in lines), strict=True):
        assert _NUMBER.sub("#", page) == _NUMBER.sub("#", now), f"the page says {page!r}, printed is {now!r}"
        if _TIMED.search(now):
            continue
        for a, b in zip(_NUMBER.findall(page), _NUMBER.findall(now), strict=True):
            most = max(abs(float(a)), abs(float(b)))
            assert most < _NOTHING or abs(float(a) - float(b)) <= _ALIKE * most, f"{page!r} for {now!r}"
