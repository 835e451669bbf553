"""Constraints: distances, couplings, guides and closed loops."""

from __future__ import annotations
