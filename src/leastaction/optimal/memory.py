"""What a run in discrete time needs beside its iterate, to go on as one that was never stopped."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.limit_report import LimitReport


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
    iterations after which the search is over.
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
    longest: int


@dataclass(frozen=True)
class Resolved(Frozen):
    """A search among the motions that the steps of time resolve.

    ``before``: where the search without that limit ended. ``angle``: the largest angle of a step there, or in the last
    trial (rad).
    """

    before: Place
    angle: float


@dataclass(frozen=True)
class Nearer(Frozen):
    """The end of a search with violated limits, and its report of them: the next search may violate them more."""

    place: Place
    limits: LimitReport


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
class Memory(Frozen):
    """The state of a run beside its iterate.

    ``taken``: names of the ways to begin again that it has taken. ``ease``: the factor of the weights of
    inputs in this stage. ``start``: what it began with, until another way is looked for from there.
    ``wanted``: what gaps are tried from once more. ``curve``: what it was given to begin with, where there are limits.
    ``first``: the trajectory that it began with. ``gaps``: None of a trajectory. ``earlier``: where it stood before
    there were gaps, which is what is returned until they are closed. ``resolved``: None where the steps of time are no
    limit. ``nearer``: where it ended before prices of limits were raised. ``mesh``: where the continuous horizon is on
    one. ``still``: steps in a row that lowered the cost by no more than its noise. ``roughness``: the error of the cost
    that was seen. ``tells_saddles``: whether Newton's model does, in this stage; None of files from before this was
    kept. ``remark``: a note for the next iteration.
    """

    taken: tuple[str, ...] = ()
    ease: float = 1.0
    start: Start | None = None
    wanted: Start | None = None
    curve: Start | None = None
    first: Start | None = None
    gaps: Gaps | None = None
    earlier: Place | None = None
    resolved: Resolved | None = None
    nearer: Nearer | None = None
    mesh: OnMesh | None = None
    still: int = 0
    roughness: float = 0.0
    tells_saddles: bool | None = None
    remark: str = ""
