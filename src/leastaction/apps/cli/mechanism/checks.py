"""What a mechanism is worth a look for before it is used: masses, inertias, loops, a pose at rest, derivatives."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction.errors import LeastActionError, some
from leastaction.mechanics import Mechanism, MidpointVI, equilibrium, project_configuration, project_velocity
from leastaction.mechanics.mechanism.turns import moved_by
from leastaction.numerics.arrays import Array
from leastaction.systems import MidpointSystem, check_derivatives

_CONDITION = 1e10  # of the mass matrix, above which rounding takes more than half of the digits of accelerations
_DERIVATIVES = 2e-3  # relative error beside differences, which stiff parts make rough


@dataclass(frozen=True)
class Check:
    """One thing that was looked at: what, whether it is as it should be, and what was found."""

    what: str
    good: bool
    found: str
    advice: str = ""


@dataclass(frozen=True)
class CheckReport:
    """All that was looked at."""

    name: str
    checks: tuple[Check, ...]
    left_out: tuple[dict[str, str], ...] = field(default=())

    @property
    def good(self) -> bool:
        """Whether all is as it should be."""
        return all(check.good for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self) | {"good": self.good}

    def table(self) -> RenderableType:
        """Return it as a table for the terminal."""
        table = Table(box=None, pad_edge=False, show_header=False)
        for check in self.checks:
            mark = Text("ok", style="green") if check.good else Text("look", style="bold yellow")
            text = Text(check.found)
            if check.advice:
                text.append(f"\n{check.advice}", style="dim")
            table.add_row(mark, check.what, text)
        parts: list[RenderableType] = [Text(self.name, style="bold", overflow="fold"), table]
        if self.left_out:
            parts.append(Text(f"Left out of the file: {len(self.left_out)}", style="bold"))
            parts += [Text(f"  {each['name']}: {each['why']}") for each in self.left_out]
        return Group(*parts)


def check_mechanism(m: Mechanism, q: Array, *, name: str, left_out: tuple[dict[str, str], ...] = ()) -> CheckReport:
    """Look at a mechanism in a configuration (nq,)."""
    looks = (_size(m, q), _masses(m), _mass_matrix(m, q), _loops(m, q), _rest(m, q), _step(m, q))
    return CheckReport(name, looks, left_out)


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _first(error: LeastActionError) -> str:
    """Return what is wrong, without what to do about it in Python."""
    return str(error).splitlines()[0].partition(". ")[0]


def _size(m: Mechanism, q: Array) -> Check:
    free = m.degrees_of_freedom(q)
    counts = ((m.nd, "dynamic variable"), (m.nrho, "prescribed one"), (m.n_inputs, "input"), (m.nc, "equation"))
    found = ", ".join(_counted(n, what) for n, what in (*counts, (free, "degree"))) + " of freedom"
    return Check("size", m.nd > 0, found)


def _masses(m: Mechanism) -> Check:
    bodies = [(frame.name, body) for frame in m.tree.frames for body in frame.frame.bodies]
    odd = []
    for frame, body in bodies:
        least, middle, largest = np.linalg.eigvalsh(body.inertia)
        if least < 0.0 or largest > (least + middle) * (1.0 + 1e-6):
            odd.append(frame)
    found = f"{m.mass:.6g} kg in {_counted(sum(body.mass > 0.0 for _, body in bodies), 'part')}"
    if odd:
        return Check("masses", False, f"{found}; no real body has the inertia of {some(odd)}", "correct their moments")
    return Check("masses", m.mass > 0.0, found, "" if m.mass else "nothing has a mass")


def _mass_matrix(m: Mechanism, q: Array) -> Check:
    matrix = m.mass_matrix(q)[: m.nd, : m.nd]
    scale = np.sqrt(np.diag(matrix))
    values = np.linalg.eigvalsh(matrix / np.outer(scale, scale))
    condition = float(values[-1] / values[0]) if values[0] > 0.0 else np.inf
    good = condition < _CONDITION
    advice = "" if good else "some motion moves nearly no mass there: an angle that is singular, or a very light link"
    return Check("mass matrix", good, f"condition {condition:.3g}, scaled to a diagonal of ones", advice)


def _loops(m: Mechanism, q: Array) -> Check:
    if not m.nc:
        return Check("loops", True, "none")
    off = max(abs(float(value)) for value in m.constraint_residuals(q).values())
    if m.constraint_rank(q) < m.constraint_rank(_near(m, q)):
        found = f"closed to {off:.2g}, in a singular configuration: equations that are independent elsewhere are not"
        return Check("loops", False, found, f"begin elsewhere (--set {m.dynamic[0]}=30deg)")
    redundant = m.redundancy(q)
    found = f"closed to {off:.2g}"
    if redundant:
        found += f"; following from others: {some(list(redundant))}"
    return Check("loops", off < 1e-8, found, "they run with the reactions of least norm" if redundant else "")


def _near(m: Mechanism, q: Array) -> Array:
    """Return a configuration near another, on the constraints, that nothing makes special."""
    by = np.random.default_rng(0).uniform(-0.3, 0.3, m.nv)
    if not m.nc:
        return moved_by(m, q, by)
    # Guesses that are off by less keep to lengths that a mechanism of small links can have.
    for part in (1.0, 0.3, 0.1, 0.03):
        with suppress(LeastActionError):
            return project_configuration(m, moved_by(m, q, part * by), attempts=3).q
    return q


def _rest(m: Mechanism, q: Array) -> Check:
    try:
        found = equilibrium(m, q)
    except LeastActionError as error:
        return Check("rest", True, f"no pose at rest without inputs was found near: {_first(error)}")
    moved = float(np.abs(found.q - q).max(initial=0.0))
    where = "here" if moved < 1e-9 else f"up to {moved:.3g} (rad or m) from here"
    text = f"{found.stability.value.partition(':')[0]}, {where}"
    if len(found.frequencies):
        hertz = found.frequencies / (2.0 * np.pi)
        text += f"; swings at {hertz[0]:.3g}" + (f" to {hertz[-1]:.3g} Hz" if len(hertz) > 1 else " Hz")
    return Check("rest", True, text)


def _step(m: Mechanism, q: Array) -> Check:
    vi, t, near = MidpointVI(m), np.linspace(0.0, 2e-3, 3), _near(m, q)
    v = np.random.default_rng(1).uniform(-1.0, 1.0, m.nv)
    try:
        run = vi.simulate(vi.start(near, project_velocity(m, near, v).v if m.nc else v), t)
        if run.steps < 2:
            return Check("derivatives", False, run.message, "steps of 1 ms cannot be made near by")
        report = check_derivatives(MidpointSystem(vi, t), run.x, run.u, tolerance=_DERIVATIVES)
    except LeastActionError as error:
        return Check("derivatives", False, _first(error), "steps of 1 ms cannot be made near by")
    worst = max(report.errors.values(), default=0.0)
    return Check("derivatives", bool(worst < _DERIVATIVES), f"of a step right to {worst:.2g}, beside differences")
