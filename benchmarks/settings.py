"""What a run measures: in full, or in a few seconds."""

from __future__ import annotations

from dataclasses import dataclass

MICRO = 1e-6


@dataclass(frozen=True)
class Settings:
    """Sizes and patience of a run.

    ``budget``: seconds of repeats for a row. ``chain_links``: lengths of the chains. ``lift_segments``: of the lifts.
    ``stages``: of the linear-quadratic problems. ``steps``: of the optimisations. ``repeats``: of the optimisations.
    """

    quick: bool
    budget: float
    chain_links: tuple[int, ...]
    lift_segments: tuple[int, ...]
    stages: int
    steps: int
    repeats: int

    def target(self, value: float) -> float | None:
        """Return a target or figure that holds for a problem of full size, None if this is a quick run."""
        return None if self.quick else value


FULL = Settings(
    quick=False,
    budget=1.0,
    chain_links=(10, 20, 40, 80, 160, 320, 640, 1000),
    lift_segments=(10, 20, 40, 80, 120, 160, 200),
    stages=1000,
    steps=1000,
    repeats=3,
)
QUICK = Settings(
    quick=True, budget=0.02, chain_links=(10, 20, 40, 80), lift_segments=(5, 10), stages=50, steps=100, repeats=1
)
