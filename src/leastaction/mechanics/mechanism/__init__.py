"""The compiled mechanism and what can be asked of it."""

from __future__ import annotations
