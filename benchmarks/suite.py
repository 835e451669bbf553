"""The groups of rows, and a run over them between two measurements of the unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks import (
    cart_pendulum,
    chains,
    continuous,
    linear_quadratic,
    machine,
    marionette,
    mujoco_puppet,
    steps,
    tendons,
    unit,
)
from benchmarks.cases import Case
from benchmarks.cases import marionette as marionette_case
from benchmarks.settings import FULL, QUICK, Settings
from benchmarks.timing import Absent, Row, Timing

GROUPS: dict[str, Callable[[Case, Settings], list[Row | Absent]]] = {
    steps.GROUP: steps.rows,
    continuous.GROUP: continuous.rows,
    mujoco_puppet.GROUP: mujoco_puppet.rows,
    chains.GROUP: lambda _case, settings: chains.rows(settings),
    tendons.GROUP: lambda _case, settings: tendons.rows(settings),
    linear_quadratic.GROUP: linear_quadratic.rows,
    marionette.GROUP: marionette.rows,
    cart_pendulum.GROUP: lambda _case, settings: cart_pendulum.rows(settings),
}
"""Every group by the name that ``--only`` takes."""


@dataclass(frozen=True)
class Measured:
    """A finished run.

    ``unit_before``, ``unit_after``: the unit at both ends of the run, None where Pinocchio is absent.
    """

    machine: dict[str, Any]
    case: str
    quick: bool
    unit_before: Timing | None
    unit_after: Timing | None
    rows: list[Row]
    absent: list[Absent]

    @property
    def unit(self) -> float | None:
        """The unit in seconds: the better of the two."""
        both = [u.best for u in (self.unit_before, self.unit_after) if u is not None]
        return min(both, default=None)


def run(*, quick: bool, only: Sequence[str] | None, progress: Callable[[str], None]) -> Measured:
    """Measure the groups named, or all."""
    settings = QUICK if quick else FULL
    about = machine.describe()
    case = marionette_case()
    rows: list[Row] = []
    absent: list[Absent] = []
    progress("unit")
    before = unit.measure(settings.budget)
    if isinstance(before, str):
        absent.append(Absent("unit", "Pinocchio computeRNEADerivatives, Talos", before))
    for name, measure in GROUPS.items():
        if only and name not in only:
            continue
        progress(name)
        try:
            found = measure(case, settings)
        except Exception as error:
            # One group that fails must not take the others' times with it.
            found = [Absent(name, f"group {name}", f"failed: {type(error).__name__}: {error}")]
        for row in found:
            if isinstance(row, Row):
                rows.append(row)
            else:
                absent.append(row)
    after = before if isinstance(before, str) else unit.measure(settings.budget)
    return Measured(
        machine=about,
        case=case.name,
        quick=quick,
        unit_before=before if isinstance(before, Timing) else None,
        unit_after=after if isinstance(after, Timing) else None,
        rows=rows,
        absent=absent,
    )
