"""Identification: parameters of a mechanism from noisy measurements, with standard errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily

if TYPE_CHECKING:
    from leastaction.identification.experiment import Experiment
    from leastaction.identification.least_squares import identify
    from leastaction.identification.result import Identification
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.identification.experiment": "Experiment",
            "leastaction.identification.least_squares": "identify",
            "leastaction.identification.result": "Identification",
        },
    )

__all__ = ["Experiment", "Identification", "identify"]
