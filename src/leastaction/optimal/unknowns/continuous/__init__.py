"""Unknowns beside the inputs in continuous time: constant states on a mesh, whose time grows with the final time."""

from __future__ import annotations
