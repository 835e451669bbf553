"""Potentials: gravity and springs."""

from __future__ import annotations
