"""Tapes of the package's own elements: scalar functions that the core evaluates with all derivatives.

A tape is a list of instructions on numbered values: the inputs first, then the constants, then the
results; the last is the result. It is written as a plain formula::

    tape = TapeWriter(2)
    x, k = tape.inputs
    compiled = tape.end(k / x)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction import _core


@dataclass(frozen=True)
class Value:
    """A value of a tape that is being written: ``kind`` is input, constant or result, ``index`` counts it."""

    tape: TapeWriter
    kind: str
    index: int

    def __add__(self, other: Value) -> Value:
        return self.tape.apply("add", self, other)

    def __sub__(self, other: Value) -> Value:
        return self.tape.apply("sub", self, other)

    def __mul__(self, other: Value | float) -> Value:
        factor = other if isinstance(other, Value) else self.tape.constant(other)
        return self.tape.apply("mul", self, factor)

    def __truediv__(self, other: Value) -> Value:
        return self.tape.apply("div", self, other)

    def __neg__(self) -> Value:
        return self.tape.apply("neg", self)


class TapeWriter:
    """A tape that is being written.

    ``n_inputs``: how many inputs it has. ``inputs``: the inputs.
    """

    def __init__(self, n_inputs: int) -> None:
        self.inputs = [Value(self, "input", index) for index in range(n_inputs)]
        self._constants: list[float] = []
        self._instructions: list[tuple[str, Value, Value]] = []

    def constant(self, value: float) -> Value:
        """Add a constant."""
        self._constants.append(float(value))
        return Value(self, "constant", len(self._constants) - 1)

    def apply(self, operation: str, first: Value, second: Value | None = None) -> Value:
        """Add an instruction by its name in ``_core.Tape.operations``, such as ``"atan2"``."""
        self._instructions.append((operation, first, first if second is None else second))
        return Value(self, "result", len(self._instructions) - 1)

    def end(self, result: Value) -> _core.Tape:
        """Return the tape; the result must be that of the last instruction."""
        assert result == Value(self, "result", len(self._instructions) - 1)
        codes = list(_core.Tape.operations)
        rows = [
            (codes.index(operation), self._number(first), self._number(second))
            for operation, first, second in self._instructions
        ]
        return _core.Tape(len(self.inputs), np.array(rows, dtype=np.int64), np.array(self._constants))

    def _number(self, value: Value) -> int:
        first_constant = len(self.inputs)
        starts = {"input": 0, "constant": first_constant, "result": first_constant + len(self._constants)}
        return starts[value.kind] + value.index


def dot(first: Sequence[Value], second: Sequence[Value]) -> Value:
    """Return the inner product of two vectors of the same tape."""
    total = first[0] * second[0]
    for a, b in zip(first[1:], second[1:], strict=True):
        total = total + a * b
    return total
