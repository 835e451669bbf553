"""What a run in discrete time needs beside its iterate, to go on as one that was never stopped."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.step_quality import StepQuality


@dataclass(frozen=True)
class Place(Frozen):
    """A trajectory that a run may go back to.

    ``x`` (N+1, nx), ``u`` (N, nu): the trajectory. ``gain`` (N, nu, nx): by which it was reached. ``ease``: of its
    stage. ``worst_step``: its coarsest step.
    """

    x: Array
    u: Array
    gain: Array
    ease: float
    worst_step: StepQuality | None


@dataclass(frozen=True)
class Start(Frozen):
    """What a run began with: ``x`` (N+1, nx) or an initial state (nx,), and ``u`` (N, nu).

    ``is_lost``: whether x is a curve that its projection lost. ``was_found``: whether it is that of an earlier result.
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
class Memory(Frozen):
    """What a run remembers of its way.

    ``stride``, ``retries``: how much less ease the next stage has, and how often one may be made again. ``earlier``:
    where it stood before it began again. ``sound``: where the last stage ended that ended well. ``start``: what it
    began with, until another way is looked for from there. ``first``: the trajectory that it began with, until
    Newton's method alone is tried from there. ``here``: where it stands, if what is returned is `earlier`. ``gaps``:
    None of a trajectory. ``wanted``: what gaps are tried from once more.
    """

    stride: float = 1.0
    retries: int = 0
    earlier: Place | None = None
    sound: Place | None = None
    start: Start | None = None
    first: Start | None = None
    here: Place | None = None
    gaps: Gaps | None = None
    wanted: Start | None = None
