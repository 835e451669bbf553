"""Options of the marionette: what it follows, and what it hangs on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter, Token

from leastaction.errors import ArgumentError
from leastaction_marionette.choices import Axes, Axis, Follow, Heading, Strings

if TYPE_CHECKING:
    from leastaction_marionette.tracking import PuppetLimits

MOTION = Group("Motion", sort_key=1)
PUPPET = Group("Strings", sort_key=2)


def speed_of(_: object, tokens: Sequence[Token]) -> float | Literal["auto"]:
    """Return what is said of a speed; what is neither a number nor the word is told in a user's terms."""
    said = tokens[0].value
    if said == "auto":
        return "auto"
    try:
        return float(said)
    except ValueError:
        raise ValueError(f"got {said!r}, expected a number such as 0.5, or auto") from None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """What is to be followed.

    Parameters
    ----------
    motion
        Motion capture to follow: a BVH file, or an AMC file. A walk on the spot is made up without it.
    mapping
        TOML file that says which joint of the capture is which joint of the puppet, where the usual names do not fit.
    skeleton
        The ASF file of an AMC file; the one beside it with whose name the motion's begins, if not given.
    frame_rate
        Frames per second of an AMC file that does not say it; 120 if not given.
    duration
        Length, s. A shorter capture is repeated by its best cycle. The whole capture (10 s of the
        made-up walk) if not given.
    dt
        Time step, s.
    follow
        What of the motion: the angles of all joints, or the places of head, hands, feet and pelvis, from which the
        optimiser finds the angles.
    start
        Begin at rest in the first pose and pick up speed, or begin as captured.
    in_place
        Leave out the travel over the ground.
    trim
        Part of the capture to use: from and to, s.
    speed
        Speed of the motion relative to the capture: 0.5 is half as fast. auto: as fast as the error allows; other
        speeds are tried, the fastest first, until slower is no better, and their errors are shown.
    error
        With --speed auto: largest root mean square error of the joints that strings hold, degrees; of the markers, mm,
        where these are followed.
    up
        The capture's axis that points up, such as y or -z; found from the poses if not given.
    forward
        The capture's axis that points ahead; found from the poses if not given.
    heading
        What is turned ahead: the way that the person faces, travels, or the capture's forward axis; straight
        takes out the slow turns of one who walks in a circle.
    """

    motion: Annotated[Path | None, Parameter(group=MOTION)] = None
    mapping: Annotated[Path | None, Parameter(group=MOTION)] = None
    skeleton: Annotated[Path | None, Parameter(group=MOTION)] = None
    frame_rate: Annotated[float | None, Parameter(group=MOTION)] = None
    duration: Annotated[float | None, Parameter(group=MOTION)] = None
    dt: Annotated[float, Parameter(group=MOTION)] = 0.01
    follow: Annotated[Follow, Parameter(group=MOTION)] = "joints"
    start: Annotated[Literal["rest", "moving"], Parameter(group=MOTION)] = "rest"
    in_place: Annotated[bool, Parameter(group=MOTION, negative=())] = False
    trim: Annotated[tuple[float, float] | None, Parameter(group=MOTION, negative=())] = None
    speed: Annotated[float | Literal["auto"], Parameter(group=MOTION, converter=speed_of)] = 1.0
    error: Annotated[float, Parameter(group=MOTION)] = 5.0
    up: Annotated[Axis | None, Parameter(group=MOTION)] = None
    forward: Annotated[Axis | None, Parameter(group=MOTION)] = None
    heading: Annotated[Heading, Parameter(group=MOTION)] = "facing"

    def check(self) -> None:
        """Complain about options of a motion capture file where none is given."""
        of_file = {
            "--mapping": self.mapping, "--skeleton": self.skeleton, "--frame-rate": self.frame_rate,
            "--trim": self.trim, "--up": self.up, "--forward": self.forward,
            "--speed": None if self.speed == 1.0 else self.speed,
            "--heading": None if self.heading == "facing" else self.heading,
        }  # fmt: skip
        for option, value in of_file.items():
            if value is not None and self.motion is None:
                raise ArgumentError(f"{option} belongs to a motion capture file: give --motion FILE too")

    def check_resumed(self) -> None:
        """Complain about what an earlier run that is resumed brings along."""
        if self.motion is not None or self.mapping is not None or self.duration is not None:
            # The motion is in the file; a second one could contradict it.
            raise ArgumentError(
                "--resume goes on with the motion of the earlier run: leave out --motion, --mapping and --duration"
            )
        if self.follow != "joints":
            raise ArgumentError("--resume follows what the earlier run did: leave out --follow")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PuppetOptions:
    """What the marionette hangs on.

    Parameters
    ----------
    strings
        How many strings: 6; 7, with one behind the pelvis; 8, with one at each foot; 9, two at each limb and one at the
        neck; 11, the six with feet, pelvis and elbows. Or what the seven are tied to, with fixed lengths: cross, a
        rigid bar for all; cross+legs, with a bar of their own for the knees; cross+hands, cross+legs+hands, where
        the strings of the puppet's hands are picked up by hands.
    axes
        How pelvis, hips and shoulders turn: zyx, by three angles, of which the second keeps off a right one; or
        quaternion, as ball joints, for arms that are swung overhead and bodies that turn over.
    tension
        Least tension of every string at every instant, N.
    strength
        Most tension of every string, N: with more it breaks. Plans on bars whose strings pull by hundreds of newtons
        are what rigs lose first.
    reach
        How far the strings' upper ends, and bars, may be from above the wanted pelvis along each axis, m.
    end_speed
        Largest speed of the upper ends, and bars, along each axis, m/s.
    end_acceleration
        Largest acceleration of the upper ends, and bars, along each axis, m/s^2.
    lift
        How far a bar may be lifted above the plane of the hands, and lowered, m.
    tilt
        How far a bar may be tilted from level about each axis, degrees.
    turn
        How far a bar may be turned about the vertical from where the pelvis is wanted to face, degrees.
    turn_speed
        Largest speed of a bar's turns about each axis, rad/s.
    turn_acceleration
        Largest acceleration of a bar's turns about each axis, rad/s^2.
    """

    strings: Annotated[Strings, Parameter(group=PUPPET)] = 6
    axes: Annotated[Axes, Parameter(group=PUPPET)] = "zyx"
    tension: Annotated[float, Parameter(group=PUPPET)] = 0.5
    strength: Annotated[float, Parameter(group=PUPPET)] = math.inf
    reach: Annotated[float, Parameter(group=PUPPET)] = 2.0
    end_speed: Annotated[float, Parameter(group=PUPPET)] = 8.0
    end_acceleration: Annotated[float, Parameter(group=PUPPET)] = 150.0
    lift: Annotated[float, Parameter(group=PUPPET)] = 0.5
    tilt: Annotated[float, Parameter(group=PUPPET)] = 57.0
    turn: Annotated[float, Parameter(group=PUPPET)] = 86.0
    turn_speed: Annotated[float, Parameter(group=PUPPET)] = 12.0
    turn_acceleration: Annotated[float, Parameter(group=PUPPET)] = 300.0

    def limits(self) -> PuppetLimits:
        """Return them as the limits of a run."""
        from leastaction_marionette.tracking.limits import PuppetLimits

        return PuppetLimits(
            tension=self.tension,
            strength=self.strength,
            reach=self.reach,
            speed=self.end_speed,
            acceleration=self.end_acceleration,
            lift=self.lift,
            tilt=math.radians(self.tilt),
            turn=math.radians(self.turn),
            turn_speed=self.turn_speed,
            turn_acceleration=self.turn_acceleration,
        )
