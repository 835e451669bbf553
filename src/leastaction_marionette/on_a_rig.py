"""What a motion of the marionette is worth on a machine: strings that stretch and go slack, late and noisy sensors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from leastaction.control import play
from leastaction.mechanics import MidpointVI
from leastaction.systems import MidpointSystem, Played, Rig
from leastaction_marionette.choices import Follow
from leastaction_marionette.tracking.found import TrackingRun

_TIMES = 2.0  # the plan's error may a rig be off


@dataclass(frozen=True, kw_only=True)
class RigCheck:
    """A run of the marionette as a rig plays it under feedback.

    Attributes
    ----------
    planned : float
        Root mean square error of what the run follows, as planned: of the joints that strings hold (degrees), or of
        the markers (mm).
    error : float
        That of the rig; infinite if it could not be simulated to the end.
    rig : Rig
    played : Played
        What the rig did.
    follow : {"joints", "markers"}
        What the run follows.
    """

    planned: float
    error: float
    rig: Rig = field(repr=False)
    played: Played = field(repr=False)
    follow: Follow = "joints"

    @property
    def passed(self) -> bool:
        """Whether the rig stays within twice the plan's error."""
        return self.error <= _TIMES * self.planned

    def __str__(self) -> str:
        """Return a sentence for a person."""
        rig = self.rig
        strings = "rigid strings" if rig.stiffness is None else f"strings of {rig.stiffness:g} N/m that go slack"
        what, unit = ("held joints", "degrees") if self.follow == "joints" else ("markers", "mm")
        how = (
            f"on a rig ({strings}, masses off by {100.0 * rig.spread:g} %, readings off by {1e3 * rig.noise:g} mrad "
            f"and {1e3 * rig.delay:g} ms late) under feedback the {what} are"
        )
        if self.played.failure is not None:
            return f"{how} lost: {self.played.failure}"
        return f"{how} {self.error:.2f} {unit} (rms) off, {self.planned:.2f} as planned"


def check(run: TrackingRun, rig: Rig | None = None) -> RigCheck:
    """Play a run of the marionette on a rig, under a feedback along it.

    Parameters
    ----------
    run : TrackingRun
    rig : Rig, optional
        One with all its defaults if left out.

    Returns
    -------
    RigCheck

    Raises
    ------
    ArgumentError
        As of `leastaction.play`.
    """
    rig = Rig() if rig is None else rig
    system = MidpointSystem(MidpointVI(run.mechanism), run.trajectory.t, multipliers=True)
    played = play(system, run.result, rig)
    error = np.inf if played.failure is not None else run.off_of(played.q)
    return RigCheck(planned=run.off, error=error, rig=rig, played=played, follow=run.follow)
