"""Bridges to other programs, each imported where it is used: JAX, PyTorch, Gymnasium, python-control."""

from __future__ import annotations
