"""Values that are wrong for nearly every argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Call = tuple[Callable[..., Any], dict[str, Any]]
"""A callable and its right arguments."""

WRONG: dict[str, Any] = {
    "None": None,
    "a word": "word",
    "no word": "",
    "bytes": b"word",
    "a whole number": 3,
    "a negative one": -1,
    "zero": 0,
    "half": 0.5,
    "nan": float("nan"),
    "infinity": float("inf"),
    "a huge number": 1e300,
    "a tiny number": 1e-300,
    "beyond all doubles": 10**400,
    "a complex number": 1 + 2j,
    "True": True,
    "an empty list": [],
    "a list of a number": [1.0],
    "a list of words": ["word", "word"],
    "a ragged list": [[1.0], [1.0, 2.0]],
    "a list of None": [None, None],
    "an empty dict": {},
    "a dict": {"word": 1.0},
    "a dict of numbers": {1: 2},
    "an object": object(),
    "a class": int,
    "a function": lambda *_: None,
    "a set": {1, 2},
    "an array of another shape": np.zeros((2, 3, 4)),
    "a matrix": np.eye(2),
    "an array of nan": np.full(2, np.nan),
    "an array of huge numbers": np.full(2, 1e300),
    "an array of words": np.array(["a", "b"]),
    "an array of objects": np.array([object(), None]),
    "an empty array": np.zeros(0),
}
