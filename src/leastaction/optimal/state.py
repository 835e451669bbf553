"""What the parts of a search need beside the iterate, to go on as one that was never stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.step_quality import StepQuality


@dataclass(frozen=True)
class Place(Frozen):
    """A trajectory to which a run may return.

    ``x`` (N+1, nx), ``u`` (N, nu): the trajectory. ``gain`` (N, nu, nx): by which it was reached. ``worst_step``: its
    coarsest step.
    """

    x: Array
    u: Array
    gain: Array
    worst_step: StepQuality | None


@dataclass(frozen=True)
class Start(Frozen):
    """What a run began with: ``x`` (N+1, nx) or an initial state (nx,), and ``u`` (N, nu).

    ``is_lost``: whether x is a curve whose projection diverged. ``was_found``: whether it is that of an earlier result.
    """

    x: Array
    u: Array
    is_lost: bool = False
    was_found: bool = False


@dataclass(frozen=True)
class Gaps(Frozen):
    """Where a search among curves with gaps stands.

    ``x`` (N+1, nx), ``u`` (N, nu): the curve. ``gain`` (N, nu, nx): of the model that led to it. ``size`` (nx,): of the
    states, in which gaps are measured. ``costates`` (N+1, nx): multipliers of the dynamics; no rows where nothing is
    known of them yet. ``filter`` (n, 2): sums of gaps, with costs, that no later curve may be worse than in both.
    ``first``: the sum of gaps it began with. ``penalty``: of the gaps. ``length``: of the last step. ``longest``:
    iterations after which the search is over; None: it goes on.
    """

    x: Array
    u: Array
    gain: Array
    size: Array
    costates: Array
    filter: Array
    first: float
    penalty: float
    length: float
    longest: int | None


@dataclass(frozen=True)
class Resolved(Frozen):
    """A search among the motions that the steps of time resolve.

    ``before``: where the search without that limit ended. ``angle``: the largest angle of a step there, or in the last
    trial (rad).
    """

    before: Place
    angle: float


@dataclass(frozen=True)
class OnMesh(Frozen):
    """Where a search on a mesh of a continuous horizon stands.

    ``breaks`` (N+1,): ends of the pieces (s). ``x`` (N+1, nz), ``u`` (N, nv): states and inputs of the discrete system.
    ``gain`` (N, nv, nz): by which it was reached. ``rounds``: how often the mesh was made finer. ``moved``: whether a
    step was made on this one.
    """

    breaks: Array
    x: Array
    u: Array
    gain: Array
    rounds: int
    moved: bool


@dataclass(frozen=True)
class RunState(Frozen):
    """What a run remembers from one iteration to the next.

    ``taken``: names of the ways to begin again that it has taken. ``resolved``: None where the steps of time are no
    limit. ``still``: steps in a row that lowered the cost by no more than its noise. ``roughness``: what the cost was
    seen to be off by. ``tells_saddles``: whether Newton's model does, in this stage; None of files from before this was
    kept. ``remark``: what is to be said of the next iteration.
    """

    taken: tuple[str, ...] = ()
    resolved: Resolved | None = None
    still: int = 0
    roughness: float = 0.0
    tells_saddles: bool | None = None
    remark: str = ""


@dataclass(frozen=True)
class Begun(Frozen):
    """What a search began with, and where it may begin again.

    ``given``: the start, until gaps were tried from there. ``curve``: what was given to begin with, where there are
    limits. ``wanted``: what gaps are tried from once more. ``first``: the trajectory that it began with. ``earlier``:
    where it stood before there were gaps, which is what is returned until they are closed. ``ease``: how much dearer
    inputs are in this stage than asked for.
    """

    given: Start | None = None
    curve: Start | None = None
    wanted: Start | None = None
    first: Start | None = None
    earlier: Place | None = None
    ease: float = 1.0


NOT_BEGUN, NOT_RUN = Begun(), RunState()
"""What a search and a run remember before there was anything."""


@dataclass(frozen=True)
class SearchState(Frozen):
    """What the parts of a search need to go on where it ended: each puts its own back.

    ``run``: of the loop. ``begun``: of where it begins. ``gaps``: of curves with gaps; None of trajectories. ``mesh``:
    of a mesh, where the horizon is continuous.
    """

    run: RunState = NOT_RUN
    begun: Begun = NOT_BEGUN
    gaps: Gaps | None = None
    mesh: OnMesh | None = None


_RUN = ("taken", "resolved", "still", "roughness", "tells_saddles", "remark")
_BEGUN = {"start": "given", **{name: name for name in ("curve", "wanted", "first", "earlier", "ease")}}


def from_memory(earlier: Any) -> Any:
    """Return the content of a file's state from that of an older file, which had all in one."""
    if not isinstance(earlier, dict):
        return earlier
    return {
        "run": {name: earlier[name] for name in _RUN if name in earlier},
        "begun": {new: earlier[name] for name, new in _BEGUN.items() if name in earlier},
        **{name: earlier[name] for name in ("gaps", "mesh") if name in earlier},
    }
