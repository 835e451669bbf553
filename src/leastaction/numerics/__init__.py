"""What every half shares and no mechanics: argument checks, names, files, functions of time."""

from __future__ import annotations
