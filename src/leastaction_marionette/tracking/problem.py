"""What is asked of the puppet: the motion to be followed as its reference, by lengths, and what is worth how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.io import Motion
from leastaction.mechanics import Mechanism, MidpointVI, to_momentum
from leastaction.models.marionette import (
    PLANE_HEIGHT,
    STRINGS,
    UNHELD,
    hang_strings,
    set_of,
    string_lengths,
    strings_of,
    tied_strings,
    turns_of_angles,
)
from leastaction.models.puppet_controls import ends_of, held_strings
from leastaction.numerics import Array
from leastaction.optimal import Cost
from leastaction.systems import MidpointSystem, PlaceCost
from leastaction_marionette.choices import Follow
from leastaction_marionette.markers import LIMB_MARKERS, places_of, wanted_markers
from leastaction_marionette.tracking.cost import TrackingCost
from leastaction_marionette.tracking.limits import PuppetLimits, pelvis_of
from leastaction_marionette.tracking.weights import TrackingWeights
from leastaction_marionette.turns import body_of, differences, rates_along, unit

ROOT = ("torso_tx", "torso_ty", "torso_tz")
MOST_STEPS = 100_000
"""More steps than these would want tens of gigabytes."""

_GOOD_START_ANGLE = np.deg2rad(15.0)  # largest rms error of a held joint in a first trajectory
_LEAST_LENGTH = 0.1  # m, of a string above its hook
_GOOD_START_DISTANCE = 0.15  # m, the same for the pelvis
_LEVER = 0.3  # m, about half a bar's size: a turn costs what it moves a bar's ends by


def unheld(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the joints behind which no string is tied: with a string at each foot there is none."""
    return () if set_of(mechanism) in (8, 9, 11) else UNHELD


def below_strings(mechanism: Mechanism, motion: Motion) -> tuple[Motion, float]:
    """Return a motion lowered where a hook would come too near to the plane of the strings, and by how much (m).

    Who climbs is followed as high as strings go; a motion that stays below comes back as it is.
    """
    q = np.zeros((len(motion.t), mechanism.nq))
    q[:, : mechanism.first_rho] = body_columns(mechanism, motion)
    hooks = mechanism.positions(q, [string.hook for string in strings_of(mechanism)])[..., 2]
    above = np.maximum(hooks.max(axis=1) - (PLANE_HEIGHT - _LEAST_LENGTH), 0.0)
    if not above.any():
        return motion, 0.0
    lowered = motion.q.copy()
    lowered[:, motion.names.index("torso_tz")] -= above
    return replace(motion, q=lowered), float(above.max())


class TrackingProblem:
    """A motion to be followed, by the puppet on strings of prescribed lengths.

    Attributes: ``reference`` (N+1, nq), the wanted configurations with strings that go with the body's; ``pelvis``
    (N+1, 3) of them, as `pelvis_of` says; ``markers`` (N+1, 6, 3), where they are wanted, or None; ``tension`` at rest
    where the motion starts, as impulses (nc,) of a step.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        motion: Motion,
        weights: TrackingWeights,
        limits: PuppetLimits,
        *,
        follow: Follow = "joints",
        threads: int = 0,
    ) -> None:
        self.mechanism, self.weights, self.limits = mechanism, weights, limits
        self.follow, self.threads, self.t = follow, threads, motion.t
        self.dt = float(self.t[1] - self.t[0])
        q = np.zeros((len(self.t), mechanism.nq))
        q[:, : mechanism.first_rho] = body_columns(mechanism, motion)
        self.reference = hang_strings(mechanism, q)
        self.pelvis = pelvis_of(mechanism, self.reference)
        self.markers = wanted_markers(motion)
        if self.markers is None and follow == "markers":
            self.markers = places_of(mechanism, self.reference)

    @cached_property
    def system(self) -> MidpointSystem:
        """The puppet by lengths."""
        return MidpointSystem(MidpointVI(self.mechanism, threads=self.threads), self.t, multipliers=True)

    @cached_property
    def x_reference(self) -> Array:
        """The wanted states (N+1, nx) by lengths: at rest to begin with, all along with the tensions at rest."""
        m = self.mechanism
        x = self.system.states_along(
            self.reference, to_momentum(m, self.reference, rates_along(m, self.reference, self.t))
        )
        x[0, m.nq : m.nx] = 0.0
        # Statics: gravity is carried by the constraints as well as they can, with the least forces.
        columns = -m.constraint_jacobian(self.reference[0])[:, : m.nd].T / self.dt
        x[:, m.nx :] = np.linalg.lstsq(columns, self.weight, rcond=1e-6)[0]
        return x

    @property
    def weight(self) -> Array:
        """What gravity pulls each variable of the body by (nd,) where the motion starts, negative downwards."""
        m = self.mechanism
        return np.asarray(-m.core.gradient(self.reference[0], np.zeros(m.nv))[0][: m.nd])

    def hang(self) -> tuple[Array, Array] | None:
        """Return what the puppet does under hanging strings, or None where that is no good start, as for bars."""
        m = self.mechanism
        if tied_strings(m):
            return None
        system, x = self.system, self.x_reference
        held = np.zeros((system.N, system.nu, system.ndx))
        run = system.rollout(x[0], x, self.reference[1:, m.first_rho :], held, 0, system.N)
        if not run.complete:
            return None
        rms = np.sqrt(np.mean(differences(m, run.x[:, : m.nq], self.reference)[:, : m.nd] ** 2, axis=0))
        far = [
            error > (_GOOD_START_DISTANCE if name in ROOT else _GOOD_START_ANGLE)
            for name, error in zip(m.dynamic, rms, strict=True)
            if name not in unheld(m)
        ]
        return None if any(far) else (run.x, run.u)

    def cost(self) -> Cost:
        """Return the cost by lengths."""
        # lam is an impulse for |p1 - p2|^2 - L^2: a newton of tension is dt / (2 L) of it.
        lengths = string_lengths(self.mechanism, self.reference[0])
        pull = self.weights.tension * (2.0 * lengths / self.dt) ** 2
        u = self.reference[1:, self.mechanism.first_rho :]
        cost = self.tracking_cost(self.system, self.x_reference, u, multipliers=pull)
        return self.with_markers(cost, self.system)

    def tracking_cost(
        self,
        system: MidpointSystem,
        x_reference: Array,
        u_reference: Array,
        *,
        inputs: Sequence[float] = (),
        multipliers: Array | tuple[()] = (),
    ) -> TrackingCost:
        """Return what is quadratic of the cost of the puppet, by lengths or by tensions.

        ``inputs``, ``multipliers``: weights of the inputs before the next places, and of the states behind the others.
        """
        m, w, free = system.mechanism, self.weights, unheld(self.mechanism)
        inertia = np.diag(m.mass_matrix(x_reference[0, : m.nq]))[: m.nd]
        rate = w.rate * np.array([w.unheld if n in free else 1.0 for n in m.dynamic]) / inertia**2
        # The pelvis is a marker whose place is in variables.
        root, share = (w.root, 1.0) if self.follow == "joints" else (w.marker, w.posture)
        body = [root if n in ROOT else share * (w.unheld if n in free else w.joint) for n in m.dynamic]
        turns = ends_of(m).angles
        squares = np.array([_LEVER if name in turns else 1.0 for name in m.kinematic]) ** 2
        return TrackingCost(
            x_reference,
            u_reference,
            Q=np.concatenate([body, squares * w.string, rate, np.zeros(m.nrho), multipliers]),
            R=np.concatenate([inputs, squares * (0.01 * w.string)]),
            system=system,
            acceleration=squares * w.string_acceleration,
        )

    def with_markers(self, cost: TrackingCost, system: MidpointSystem) -> Cost:
        """Return a tracking cost of a system with the price of where the markers are, if they are followed."""
        if self.follow == "joints" or self.markers is None:
            return cost
        places = {frame: self.markers[:, i] for i, frame in enumerate(LIMB_MARKERS.values(), start=1)}
        return PlaceCost(cost, system, places, dict.fromkeys(places, self.weights.marker))


def body_columns(mechanism: Mechanism, motion: Motion) -> Array:
    """Return how a motion wants the body to stand, (N+1, first_rho) in the order of the mechanism, checked.

    Of a motion that names angles where the mechanism has ball joints, the same by quaternions.
    """
    held = held_strings(mechanism) if strings_of(mechanism) else STRINGS
    needed = {name for string in held for name in (string.x, string.y, string.length)}
    if not needed <= set(mechanism.kinematic):
        missing = ", ".join(sorted(needed - set(mechanism.kinematic))[:4])
        raise ArgumentError(
            f"track: the mechanism lacks the string variables {missing}, ...; expected the marionette of "
            "leastaction.models.marionette. For another mechanism use MidpointSystem and optimize"
        )
    names, columns = body_of(mechanism), dict(zip(motion.names, motion.q.T, strict=True))
    if mechanism.tree.rotations and not set(names) <= set(columns):
        columns = dict(turns_of_angles(columns))
    for name in names:
        if name not in columns:
            raise ArgumentError(f"motion: no column for {name!r}; {closest(name, motion.names, what='columns')}")
    if not 3 <= len(motion.t) <= MOST_STEPS + 1:
        advice = "a shorter time step, or more" if len(motion.t) < 3 else "a longer time step, or a part"
        raise ArgumentError(
            f"motion: got {len(motion.t)} instants, expected 3 to {MOST_STEPS + 1}. Take {advice} of the motion"
        )
    steps = np.diff(motion.t)
    if np.ptp(steps) > 1e-6 * steps[0]:
        raise ArgumentError("motion: times must increase in equal steps; use Motion.resample(dt) to make them so")
    return unit(names, np.stack([columns[name] for name in names], axis=1))
