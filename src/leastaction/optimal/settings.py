"""The settings of an optimisation, checked; the same in discrete and in continuous time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from leastaction.numerics.arrays import as_choice, as_count, as_number

Method = Literal["auto", "steepest", "quasi-newton", "newton"]
Regulator = Literal["descent", "lqr"]


@dataclass(frozen=True)
class Settings:
    """The settings of an optimisation; see `optimize` for their meaning.

    Raises
    ------
    ArgumentError
        A setting that does not exist or is out of range.
    """

    method: str
    regulator: str
    max_iterations: int
    tolerance: float
    absolute_tolerance: float
    alpha: float
    beta: float
    max_backtracks: int
    chunk: int

    def __post_init__(self) -> None:
        as_choice(self.method, "method", get_args(Method))
        as_choice(self.regulator, "regulator", get_args(Regulator))
        checked = {
            "max_iterations": as_count(self.max_iterations, "max_iterations", 0),
            "tolerance": as_number(self.tolerance, "tolerance", least=0.0),
            "absolute_tolerance": as_number(self.absolute_tolerance, "absolute_tolerance", least=0.0),
            "alpha": as_number(self.alpha, "alpha", above=0.0, below=0.5),
            "beta": as_number(self.beta, "beta", above=0.0, below=1.0),
            "max_backtracks": as_count(self.max_backtracks, "max_backtracks", 0),
            "chunk": as_count(self.chunk, "chunk", 1),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
