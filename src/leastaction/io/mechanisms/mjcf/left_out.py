"""What an MJCF says that no mechanism has, a line for each kind."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.model import LeftOut


def left_out_of(spec: Any) -> list[LeftOut]:
    """Return what of a specification nothing is made of, counted by kind."""
    found: list[LeftOut] = []

    def count(what: str, number: int, why: str) -> None:
        if number:
            found.append(LeftOut(f"{number} {what if number == 1 else what.replace('body', 'bodie') + 's'}", why))

    touching = sum(bool(geom.contype or geom.conaffinity) for geom in spec.geoms)
    count("touching geom", touching if touching > 1 else 0, "bodies pass through each other")
    count("contact pair", len(spec.pairs), "bodies pass through each other")
    seen = "pictures have their own"
    count("camera", len(spec.cameras), seen)
    count("light", len(spec.lights), seen)
    count("skin", len(spec.skins), "bodies are rigid here, and shown by their shapes")
    count("flex body", len(spec.flexes), "bodies are rigid here")
    count("sensor", len(spec.sensors), "results have every place and force by name")
    count("plugin", len(spec.plugins), "their forces are not known")
    if spec.option.density or spec.option.viscosity:
        found.append(LeftOut("the medium (density, viscosity)", "its forces are not taken over; `Drag` is one by hand"))
    if any(spec.option.wind):
        found.append(LeftOut("the wind", "without a medium it does nothing; `Drag` takes a wind"))
    return found
