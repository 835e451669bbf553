"""What the search for a motion of the marionette finds: runs, searches cut short, and what they took."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError
from leastaction.io import Motion, Provenance
from leastaction.mechanics import Mechanism, MidpointVI, Trajectory
from leastaction.models.marionette import hang_strings
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult, Status
from leastaction.systems import MidpointSystem
from leastaction.viz import TrackingErrors, tracking_errors
from leastaction_marionette.choices import Follow
from leastaction_marionette.markers import places_of, wanted_markers
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.problem import ROOT, body_columns, unheld
from leastaction_marionette.turns import differences

CUT_SHORT: Final = (Status.INTERRUPTED, Status.STOPPED_BY_CALLBACK)
"""How a run ends that somebody ended."""

STUCK: Final = (Status.LINE_SEARCH_FAILED, Status.NO_DIRECTION, Status.SADDLE)
"""How one ends that found no way on."""

_NOT_RECORDED: Final = {"recorded": False}


@dataclass(frozen=True, kw_only=True)
class Effort:
    """What a run took from its beginning: its search, and all optimisations after it. Frozen: threads may share it.

    Attributes
    ----------
    optimisations, iterations : int
        How many, of all stages.
    first_cost : float
        Of the first motion that the strings make by themselves, in the last one's units; NaN before there is one.
    """

    optimisations: int = 0
    iterations: int = 0
    first_cost: float = np.nan

    def plus(
        self, found: OptimizationResult, *, before: OptimizationResult | None = None, scale: float | None = 1.0
    ) -> Effort:
        """Return the effort with an optimisation more.

        ``before``: the earlier result that it goes on from, if it does; then it is no other one. ``scale``: by which
        costs of its problem are those of the last one; None where motors help.
        """
        first = self.first_cost
        if np.isnan(first) and scale is not None and len(found.history.cost):
            first = scale * float(found.history.cost[0])
        return replace(
            self,
            optimisations=self.optimisations + (before is None),
            iterations=self.iterations + found.iterations - (0 if before is None else before.iterations),
            first_cost=first,
        )


@dataclass(frozen=True, kw_only=True)
class TrackingRun:
    """A motion of the marionette, what it was asked to do, and how it was found.

    Attributes
    ----------
    mechanism : Mechanism
    motion : Motion
        What was to be followed: the body, with its markers if they are known.
    embedded : bool
        Whether its first trajectory was sought, with motors on all joints or from a puppet held still; else it began
        with what hanging strings do.
    result : OptimizationResult
        On strings of prescribed lengths, with the gains that hold the motion; its states are
        ``[q; rho; p; v_rho; lam]``.
    plan : OptimizationResult
        The optimiser's own, by tensions, of which `result` says the same, or of a run that was cut short a motion near
        it in which strings pull. Its states are ``[q; rho; p; v_rho]``, its inputs the tensions and the next places of
        the upper ends.
    follow : {"joints", "markers"}
        What of the motion was followed.
    effort : Effort
        What it took in all.
    limits : PuppetLimits
        What it had to keep to.
    trajectory : Trajectory
        The motion that was found, by names: times, configurations, momenta, multipliers.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    motion: Motion
    embedded: bool
    result: OptimizationResult = field(repr=False)
    plan: OptimizationResult = field(repr=False)
    follow: Follow = "joints"
    effort: Effort = field(default_factory=Effort)
    limits: PuppetLimits = field(default_factory=PuppetLimits, repr=False)
    trajectory: Trajectory = field(default=cast("Trajectory", None), repr=False, metadata=_NOT_RECORDED)
    provenance: Provenance = field(default_factory=Provenance.now, metadata=_NOT_RECORDED)

    def __post_init__(self) -> None:
        x, u = self.result.x, self.result.u
        if cast("Trajectory | None", self.trajectory) is None and np.isfinite(x).all() and np.isfinite(u).all():
            system = MidpointSystem(MidpointVI(self.mechanism), self.motion.t, multipliers=True)
            object.__setattr__(self, "trajectory", system.trajectory(x, u))

    @property
    def source(self) -> str:
        """Where the motion comes from, in words."""
        return self.motion.source

    @cached_property
    def reference(self) -> Array:
        """The configurations to be followed (N+1, nq), with the strings that were guessed for them."""
        q = np.zeros((len(self.motion.t), self.mechanism.nq))
        q[:, : self.mechanism.first_rho] = body_columns(self.mechanism, self.motion)
        return hang_strings(self.mechanism, q)

    @cached_property
    def markers(self) -> Array | None:
        """Where the markers are wanted (N+1, 6, 3) (m), in the order of `MARKERS`, if that is known."""
        return wanted_markers(self.motion)

    @property
    def tension(self) -> Array:
        """String tensions (N), shape (N, nc), in the order of the constraints."""
        by_name = self.trajectory.tensions()
        tension = np.stack([by_name[name] for name in self.mechanism.constraints], axis=1)
        tension[0] *= 2.0  # the first impulse is that of half a step, see Trajectory.tensions
        return tension

    @property
    def errors(self) -> TrackingErrors:
        """How far each variable of the body is from the reference."""
        return self.errors_of(self.trajectory.q)

    def errors_of(self, q: Array) -> TrackingErrors:
        """Return how far each variable of the body is from the reference in configurations q (N+1, nq)."""
        apart = differences(self.mechanism, q, self.reference)[:, : self.mechanism.nd]
        return tracking_errors(np.zeros_like(apart), apart, self.mechanism.dynamic, lengths=ROOT)

    @property
    def held_error(self) -> float:
        """Root mean square error (degrees) of the angles behind which a string is tied."""
        return held_error(self.mechanism, self.reference, self.trajectory.q)

    def markers_apart(self, q: Array | None = None, rows: slice | NDArray[np.integer] = slice(None)) -> Array:
        """Return how far the markers are from where they are wanted (m): (n, 6).

        ``q``: configurations (n, nq) at some of the instants, ``rows``; those of the motion itself if left out. Raises
        `ArgumentError` if it is not known where markers are wanted.
        """
        if self.markers is None:
            raise ArgumentError("markers: the motion does not say where they are wanted; load it with markers=True")
        made = places_of(self.mechanism, self.trajectory.q if q is None else q)
        return np.asarray(np.linalg.norm(made - self.markers[rows], axis=2))

    @property
    def off(self) -> float:
        """How far what is followed is off, rms: joints that strings hold in degrees, or markers in millimetres."""
        return self.off_of(self.trajectory.q)

    def off_of(self, q: Array) -> float:
        """Return how far what is followed is `off` in configurations q (N+1, nq)."""
        if self.follow == "joints":
            return held_error(self.mechanism, self.reference, q)
        return 1e3 * float(np.sqrt(np.mean(self.markers_apart(q) ** 2)))

    @property
    def ended_early(self) -> bool:
        """Whether Ctrl-C or a callback ended it."""
        return self.result.status in CUT_SHORT


def held_error(mechanism: Mechanism, reference: Array, q: Array) -> float:
    """Return the root mean square error (degrees) of the angles behind which a string is tied.

    ``reference``, ``q`` (N+1, nq): the wanted configurations and those that were made.
    """
    free = (*ROOT, *unheld(mechanism))
    held = [i for i, name in enumerate(mechanism.dynamic) if name not in free]
    return float(np.rad2deg(np.sqrt(np.mean(differences(mechanism, q, reference)[:, held] ** 2))))


@dataclass(frozen=True, kw_only=True)
class TrackingSearch:
    """A search as far as it went, for a first trajectory or for strings on bars that keep their lengths.

    `track` goes on with it.

    Attributes
    ----------
    mechanism : Mechanism
    motion : Motion
        To be followed.
    stage : int
        Which of the optimisations with motors is next.
    result : OptimizationResult
        Of the one before it.
    follow : {"joints", "markers"}
        What of the motion.
    effort : Effort
        What it took so far.
    firmness : float or None
        Of strings on bars that are being tied: the weight of their lengths; None before that.
    parts : bool
        Whether a long motion is followed part by part: `result` has those so far, joined, and says how the last ended.
    provenance : Provenance
    """

    mechanism: Mechanism = field(repr=False)
    motion: Motion
    stage: int = 0
    result: OptimizationResult = field(repr=False)
    follow: Follow = "joints"
    effort: Effort = field(default_factory=Effort)
    firmness: float | None = None
    parts: bool = False
    provenance: Provenance = field(default_factory=Provenance.now, metadata=_NOT_RECORDED)
