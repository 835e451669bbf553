"""Elements of the user's own, from expressions or Python functions."""

from __future__ import annotations
