"""What each way to begin again is worth: ``python -m benchmarks.ways [--json] [--only WORDS]``; a long study.

Every problem is solved under default settings: those of `benchmarks.robustness`, free and from curves, others, drawn
ones, drawn ones whose inputs are limited, such that have to end where their wanted motion does, masses that fly past
obstacles, and a puppet that walks on strings which pull, begun hanging on them. Then each way is switched off in turn,
and those problems are solved again on which it was taken: the rest do not notice. Told is how many lose their minimum,
how many end in a dearer or a cheaper one, and the processor time of the problems on which it was taken, without the way
in parts of that with it.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Iterator  # noqa: E402
from dataclasses import dataclass, field  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks.cases import package_marionette  # noqa: E402
from benchmarks.marionette import mean_tensions, with_tensions  # noqa: E402
from benchmarks.robustness_curves import CURVES  # noqa: E402
from benchmarks.robustness_drawn import drawn  # noqa: E402
from benchmarks.robustness_further import FURTHER  # noqa: E402
from benchmarks.robustness_others import OTHERS  # noqa: E402
from benchmarks.robustness_problems import PROBLEMS  # noqa: E402
from leastaction.errors import LeastActionError  # noqa: E402
from leastaction.mechanics import Gravity, JointForce, Mechanism, MidpointVI, ty, tz  # noqa: E402
from leastaction.optimal import Bound, Equal, FinalTime, Options, QuadraticCost, Status, optimize  # noqa: E402
from leastaction.optimal.options import WAY_NAMES  # noqa: E402
from leastaction.systems import Ball, Keep, MidpointSystem  # noqa: E402

__all__ = ["Ablation", "Case", "Solved", "cases", "solve"]

_SEEDS, _LIMITED, _ENDS, _OBSTACLES = (34, 35, 36, 37), (38,), (39, 40), 24
_PART = 0.7  # of what a problem's minimum uses of an input is its limit
_PARTS = 0.7, 2.0  # the same, at least and at most, of problems whose end is asked for
_TIMES = 0.2, 5.0  # final time at least and at most, where it is found too, in times the one that was drawn
_PULLS = (0.02, 0.1, 0.3), (100, 200)  # least tensions, in parts of their means; numbers of steps
_SAME = 1e-4  # relative difference of costs up to which minima are the same


@dataclass(frozen=True)
class Case:
    """A problem: its ``name``, and what `optimize` is given."""

    name: str
    system: Any
    cost: Any
    initial: Any
    limits: tuple[Any, ...] = ()
    unknowns: tuple[Any, ...] = ()
    free_start: bool = False


@dataclass(frozen=True)
class Solved:
    """How a case ended, the ways that were taken, and the processor time (s)."""

    status: str
    cost: float
    success: bool
    taken: tuple[str, ...]
    seconds: float


@dataclass
class Ablation:
    """What a way is worth. ``fired``: on how many problems it was taken. The others count those, but for the times."""

    way: str
    fired: int = 0
    lost: list[str] = field(default_factory=list)
    won: list[str] = field(default_factory=list)
    dearer: int = 0
    cheaper: int = 0
    with_it: float = 0.0
    without: float = 0.0

    def line(self) -> str:
        """Return a row of the table."""
        ratio = f"{self.without / self.with_it:.2f}" if self.with_it else ""
        return f"| {self.way} | {self.fired} | {len(self.lost)} | {self.dearer} / {self.cheaper} | {ratio} |"


def _past_obstacles() -> Iterator[Case]:
    """Yield masses that fly past balls of sizes and places drawn by chance."""
    m = Mechanism(
        [ty("y"), [tz("z", mass=1.0, name="drone")]],
        [Gravity(), JointForce("y", input="fy"), JointForce("z", input="fz")],
    )
    for seed in range(_OBSTACLES):
        rng = np.random.default_rng(seed)
        system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 3.0, 61))
        wanted, hover = np.zeros((61, 4)), np.tile([0.0, 9.81], (60, 1))
        wanted[:, 0] = system.t
        balls = [
            Keep("drone", outside=Ball((0.0, float(y), float(rng.normal()) * 0.1), float(rng.uniform(0.1, 0.35))))
            for y in np.linspace(0.7, 2.3, 1 + seed % 3)
        ]
        cost = QuadraticCost(wanted, hover, Q=[1.0, 1.0, 0.0, 0.0], R=[0.01, 0.01])
        yield Case(f"past {len(balls)} balls, {seed}", system, cost, (np.zeros(4), hover), (*balls, Equal("y", 3.0)))


def _hanging() -> Iterator[Case]:
    """Yield walks of a puppet whose strings pull at least by a part of what they do without limits."""
    case = package_marionette()
    for steps in _PULLS[1]:
        system, cost, start = with_tensions(case, steps)
        means = mean_tensions(system, optimize(system, cost, initial=start))
        for part in _PULLS[0]:
            limits = tuple(Bound(name, min=part * mean, of="tension") for name, mean in means.items())
            yield Case(f"walk of {steps} steps, strings pull by {part:g} of their means", system, cost, start, limits)


def _to_ends() -> Iterator[Case]:
    """Yield drawn problems whose last configuration, and rest where nothing is closed, is asked for by equations.

    Of a third the first state is found within bounds, of another third the final time.
    """
    for seed, problem in ((chosen, each) for chosen in _ENDS for each in drawn(chosen)):
        given = problem.build()
        found = _most_of_inputs(given)
        rng = np.random.default_rng([seed, len(problem.name)])
        if found is None:
            continue
        system, wanted = given.system, np.asarray(given.cost.x_wanted)[-1]
        m = system.integrator.mechanism
        asked = [name for name, value in zip(m.variables[: m.nd], wanted, strict=False) if value != 0.0]
        part = float(rng.uniform(*_PARTS))
        limits: list[Any] = [Bound(name, -part * each, part * each) for name, each in found.items()]
        limits += [Equal(name, float(wanted[m.variables.index(name)])) for name in asked]
        if not m.constraints:
            limits.append(Equal("*", 0.0, of="momentum"))
        kind, first, unknowns = int(rng.integers(3)), np.asarray(given.x), ()
        first = first if first.ndim == 1 else first[0]
        if kind == 1:
            limits += [
                Bound(name, first[i] - 0.3, first[i] + 0.3, of="variable", at="start")
                for i, name in enumerate(m.variables[: m.nd])
            ]
            limits.append(Bound("*", -0.3, 0.3, of="momentum", at="start"))
        if kind == 2:
            duration = float(system.t[-1] - system.t[0])
            unknowns = (FinalTime(_TIMES[0] * duration, _TIMES[1] * duration, price=1.0),)
        named = f"{problem.name}, to its end" + ("", ", free start", ", in free time")[kind]
        yield Case(named, system, given.cost, (given.x, given.u), tuple(limits), unknowns, kind == 1)


def _most_of_inputs(given: Any) -> dict[str, float] | None:
    """Return how much of each input the minimum without limits uses; None if none was found."""
    try:
        free = optimize(given.system, given.cost, initial=(given.x, given.u))
    except LeastActionError:
        return None
    most = {name: float(np.abs(free.u[:, j]).max()) for j, name in enumerate(given.system.quantity("input").names)}
    most = {name: each for name, each in most.items() if each > 0.0}
    return most if free.success and most else None


def cases() -> Iterator[Case]:
    """Yield all problems; limits of inputs follow from the minimum without."""
    for problem in [*PROBLEMS, *FURTHER, *CURVES, *OTHERS, *(each for seed in _SEEDS for each in drawn(seed))]:
        given = problem.build()
        yield Case(problem.name, given.system, given.cost, (given.x, given.u))
    for problem in (each for seed in _LIMITED for each in drawn(seed)):
        given = problem.build()
        most = _most_of_inputs(given)
        if most is not None:
            limits = tuple(Bound(name, -_PART * each, _PART * each) for name, each in most.items())
            yield Case(f"{problem.name}, limited", given.system, given.cost, (given.x, given.u), limits)
    yield from _to_ends()
    yield from _past_obstacles()
    yield from _hanging()


def solve(case: Case, without: tuple[str, ...] = ()) -> Solved:
    """Solve a case without some ways."""
    notes: list[str] = []
    began = time.process_time()
    try:
        result = optimize(
            case.system, case.cost, initial=case.initial, limits=case.limits, unknowns=case.unknowns,
            free_start=case.free_start, options=Options(without=without),
            callback=lambda record: notes.append(record.note),
        )  # fmt: skip
    except LeastActionError as error:
        return Solved(type(error).__name__, np.nan, False, (), time.process_time() - began)
    seconds = time.process_time() - began
    taken = () if result.state is None else result.state.run.taken
    if "gaps for unmet limits" in taken or any("with gaps between" in note for note in notes):
        taken = (*taken, "gaps")
    if "easing among resolved motions" in taken:
        taken = (*taken, "easing")
    success = result.status in (Status.CONVERGED, Status.STALLED, Status.RESOLVED)
    return Solved(result.status.name, result.cost, success, taken, seconds)


def compare(found: Ablation, name: str, with_it: Solved, without: Solved) -> None:
    """Count a problem on which a way was taken."""
    found.fired += 1
    found.with_it += with_it.seconds
    found.without += without.seconds
    if with_it.success and not without.success:
        found.lost.append(name)
    elif without.success and not with_it.success:
        found.won.append(name)
    elif with_it.success and abs(without.cost - with_it.cost) > _SAME * abs(with_it.cost):
        found.dearer += without.cost > with_it.cost
        found.cheaper += without.cost < with_it.cost


def main() -> int:
    """Solve, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--only", help="only problems whose name contains this")
    arguments = parser.parse_args()
    table = {way: Ablation(way) for way in WAY_NAMES}
    count = solved = 0
    seconds = 0.0
    for case in cases():
        if arguments.only is not None and arguments.only not in case.name:
            continue
        found = solve(case)
        count, solved, seconds = count + 1, solved + found.success, seconds + found.seconds
        for way in WAY_NAMES:
            if way in found.taken:
                compare(table[way], case.name, found, solve(case, (way,)))
    if arguments.json:
        print(json.dumps({"problems": count, "solved": solved, "ways": [vars(each) for each in table.values()]}))
        return 0
    print(f"{solved} of {count} problems end in a minimum, in {seconds:.0f} s\n")
    print("| way | taken | lost without it | dearer / cheaper without it | time without / with |")
    print("|---|---|---|---|---|")
    for each in table.values():
        print(each.line())
    for each in table.values():
        for name in each.lost:
            print(f"\nlost without {each.way}: {name}", end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
