"""Prices on what a mechanism does, beside any other cost: on places of frames, on prescribed accelerations."""

from __future__ import annotations
