"""Longer studies behind the examples: what the tests hold the numbers of."""

from __future__ import annotations
