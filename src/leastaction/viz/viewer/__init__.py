"""The viewer: scenes as a page for browsers, as pictures, as movies and as glTF."""

from __future__ import annotations
