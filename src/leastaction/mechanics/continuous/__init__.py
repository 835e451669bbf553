"""Continuous time: accelerations, their derivatives, and simulation with SciPy's solvers."""

from __future__ import annotations
