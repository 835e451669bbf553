"""Discrete time: the midpoint variational integrator, its derivatives and its trajectories."""

from __future__ import annotations
