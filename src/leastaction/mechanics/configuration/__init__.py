"""Configurations on the constraints: assembly, contradictions, equilibria."""

from __future__ import annotations
