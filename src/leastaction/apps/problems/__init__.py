"""Problem files: a mechanism, what it is to do and has to keep to, as a text that `leastaction optimize` runs."""

from __future__ import annotations

from leastaction.apps.problems.problem import ProblemFile, load_problem
from leastaction.apps.problems.run import run_problem

__all__ = ["ProblemFile", "load_problem", "run_problem"]
