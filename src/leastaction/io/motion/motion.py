"""A motion: named configuration variables over time, and what is done to it beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly, CubicSpline
from scipy.signal import butter, sosfiltfilt

from leastaction.errors import ArgumentError, closest, some
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.dataset import Column, Dataset, Savable, table
from leastaction.numerics.public import public

_LENGTH_SUFFIXES = ("_tx", "_ty", "_tz")
_MOST_STEPS = 1_000_000
_SLOWEST = 1e-6  # of the samples' rate: filters of lower frequencies drown in rounding


@public
def count_steps(duration: float, dt: float) -> int:
    """Return the number of steps in a duration, rounded; `ArgumentError` if no memory could hold them."""
    steps = duration / dt
    if not steps <= _MOST_STEPS:
        raise ArgumentError(
            f"duration, dt: got {duration:g} s in steps of {dt:g} s, which is {steps:.3g} steps, expected "
            f"at most {_MOST_STEPS}. Take longer steps or a shorter duration"
        )
    return round(steps)


_LONGEST = 1e6  # s, of what is put before a motion


@public
@dataclass(frozen=True, eq=False)
class Motion(Savable):
    """Values of named variables over time.

    Immutable: every method returns a new motion. Between its samples a motion is the cubic spline through them.

    Attributes
    ----------
    names : tuple of str
        Names of the variables. Names that end in ``_tx``, ``_ty``, ``_tz`` are lengths in
        metres, all others angles in radians.
    t : (N+1,) array
        Increasing times in seconds, at least two.
    q : (N+1, n) array
        The values, time first.
    source : str
        Where the motion comes from, in words, for titles and reports.

    Raises
    ------
    ArgumentError
        Shapes that do not fit, NaN, times that do not increase, or a name used twice.
    """

    names: tuple[str, ...]
    t: Array
    q: Array
    source: str = ""

    def __post_init__(self) -> None:
        names = tuple(self.names)
        t, q = np.array(self.t, dtype=np.float64), np.array(self.q, dtype=np.float64)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ArgumentError(f"names: {', '.join(twice)} given twice; each name must be unique")
        if t.ndim != 1 or t.size < 2:
            raise ArgumentError(f"t: got shape {t.shape}, expected (N+1,) with N >= 1")
        if q.shape != (t.size, len(names)):
            raise ArgumentError(
                f"q: got shape {q.shape}, expected {(t.size, len(names))}: "
                "one row for each time, one column for each name"
            )
        if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
            raise ArgumentError("t: expected finite, strictly increasing times in seconds")
        if not np.all(np.isfinite(q)):
            row, column = np.argwhere(~np.isfinite(q))[0]
            raise ArgumentError(f"q: {names[column]} is {q[row, column]} at t = {t[row]:g} s, expected finite values")
        t.flags.writeable = q.flags.writeable = False
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "q", q)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    @property
    def angle_names(self) -> tuple[str, ...]:
        """Names of the variables that are angles."""
        return tuple(name for name in self.names if not name.endswith(_LENGTH_SUFFIXES))

    def angles_in_degrees(self) -> dict[str, Array]:
        """Every angle by name, (N+1,) in degrees."""
        return {name: np.rad2deg(self[name]) for name in self.angle_names}

    def __str__(self) -> str:
        """Say how many there are, for how long, and their names."""
        count = f"{len(self.names)} variable{'s' * (len(self.names) != 1)}"
        return f"{count} at {len(self.t)} times over {self.duration:g} s: {some(self.names)}"

    def __getitem__(self, name: str) -> Array:
        """Values (N+1,) of the variable called `name`."""
        return self.q[:, self._column(name)]

    def _column(self, name: str) -> int:
        if name not in self.names:
            hint = closest(name, self.names, what="variables")
            raise ArgumentError(f"the motion has no variable {name!r}; {hint}")
        return self.names.index(name)

    def columns(self, names: Sequence[str]) -> Array:
        """Values in the order of `names`, (N+1, len(names)).

        Raises
        ------
        ArgumentError
            The motion lacks one of the names.
        """
        return self.q[:, [self._column(name) for name in names]]

    def dataset(self) -> Dataset:
        lengths = tuple(name.endswith(_LENGTH_SUFFIXES) for name in self.names)
        units = ("m" if length else "rad" for length in lengths)
        columns = [Column(*each) for each in zip(self.names, units, self.q.T, strict=True)]
        return table(self.t, columns, kind="Motion", content={"source": self.source})

    def velocity(self) -> Array:
        """Time derivative of the spline through the samples, (N+1, n)."""
        return np.asarray(self._spline()(self.t, 1), dtype=np.float64)

    def resample(self, dt: float, *, duration: float | None = None, cutoff: float | None = None) -> Motion:
        """The same motion at equal steps, from time zero.

        Parameters
        ----------
        dt : float
            New step in seconds.
        duration : float, optional
            Seconds to keep, rounded to whole steps; the whole motion (rounded down) if not given.
        cutoff : float, optional
            Low-pass filter at this frequency in Hz first, see `low_pass`.

        Raises
        ------
        ArgumentError
            `dt` is not positive, or `duration` is longer than the motion (see `loop`).
        """
        as_number(dt, "dt", above=0.0)
        if duration is not None:
            as_number(duration, "duration", above=0.0)
        n_steps = count_steps(self.duration if duration is None else duration, dt)
        if duration is None:
            n_steps = int(np.floor(self.duration / dt + 1e-9))
        if n_steps < 1:
            raise ArgumentError(f"dt: got {dt:g} s, longer than the motion of {duration or self.duration:g} s")
        if n_steps * dt > self.duration + 1e-6 * max(dt, self.duration):
            raise ArgumentError(
                f"duration: got {n_steps * dt:g} s, the motion lasts {self.duration:g} s; "
                "ask for less, or repeat it with loop()"
            )
        motion = self if cutoff is None else self.low_pass(cutoff)
        t = dt * np.arange(n_steps + 1, dtype=np.float64)
        inside = np.minimum(self.t[0] + t, self.t[-1])
        return replace(self, t=t, q=motion._spline()(inside))

    def low_pass(self, cutoff: float) -> Motion:
        """Without its components above `cutoff` Hz, and without a phase shift.

        A Butterworth filter of order 2 run forwards and backwards, on samples at equal steps. The first and last pose
        stay what they are. A motion that has no such components (its samples too far apart) comes back as it is.

        Raises
        ------
        ArgumentError
            `cutoff` is not positive, or next to nothing beside the rate of the samples.
        """
        as_number(cutoff, "cutoff", above=0.0)
        n_steps = self.t.size - 1
        step = self.duration / n_steps
        if cutoff >= 0.5 / step or n_steps < 3:
            return self
        if cutoff * step < _SLOWEST:
            raise ArgumentError(
                f"cutoff: got {cutoff:g} Hz for samples at {1.0 / step:.3g} Hz, expected {_SLOWEST:g} of that at "
                "least. Are the times, or the speed, what they are meant to be?"
            )
        uniform = self.t[0] + step * np.arange(n_steps + 1)
        uniform[-1] = self.t[-1]
        values = self._spline()(uniform)
        sos = butter(2, cutoff, fs=1.0 / step, output="sos")
        # Odd reflection about the ends keeps value and slope there; a second long is longer than
        # the filter's memory for any useful cutoff.
        padding = min(n_steps, max(3, round(3.0 / (cutoff * step))))
        smooth = sosfiltfilt(sos, values, axis=0, padtype="odd", padlen=padding)
        return replace(self, t=uniform, q=smooth)

    def ease_in(self, seconds: float) -> Motion:
        """Start from rest: the first pose, at speed zero, then up to full speed.

        A time warp: the path is unchanged, and the speed along it rises smoothly (its slope zero
        at both ends) from 0 to 1 during the first `seconds`, in which half as much of the motion
        passes; the motion gets longer by ``seconds / 2``.

        Raises
        ------
        ArgumentError
            `seconds` is negative or more than twice the motion.
        """
        return self._warp(seconds, at_start=True)

    def ease_out(self, seconds: float) -> Motion:
        """Come to rest in the last pose: `ease_in` at the other end."""
        return self._warp(seconds, at_start=False)

    def _warp(self, seconds: float, *, at_start: bool) -> Motion:
        seconds = as_number(seconds, "seconds")
        if not 0.0 <= seconds <= 2.0 * self.duration:
            raise ArgumentError(
                f"seconds: got {seconds:g}, expected 0 to {2.0 * self.duration:g}, twice the duration of the motion"
            )
        if seconds == 0.0:
            return self
        step = self.duration / (self.t.size - 1)
        total = self.duration + 0.5 * seconds
        elapsed = np.linspace(0.0, total, max(2, round(total / step) + 1))
        # The motion's own time: the integral of the speed s^2 (3 - 2 s), s = elapsed / seconds.
        since = elapsed if at_start else total - elapsed
        share = np.minimum(since / seconds, 1.0)
        own = seconds * (share**3 - 0.5 * share**4) + np.maximum(since - seconds, 0.0)
        own = self.t[0] + own if at_start else self.t[-1] - own
        own = np.clip(own, self.t[0], self.t[-1])
        return replace(self, t=self.t[0] + elapsed, q=self._spline()(own))

    def lead_in(self, pose: Mapping[str, float] | ArrayLike, seconds: float) -> Motion:
        """Put a transition from `pose`, at rest, before the motion.

        Each variable follows the polynomial of degree five that starts in `pose` with velocity
        and acceleration zero and meets the motion's first pose, velocity and acceleration.

        Parameters
        ----------
        pose : mapping from name to value, or (n,) array
            Variables that a mapping does not name start at their first value.
        seconds : float
            Length of the transition, greater than zero.

        Returns
        -------
        Motion
            Starts at the old start time; `seconds` longer.
        """
        as_number(seconds, "seconds", above=0.0, below=_LONGEST)
        start = self.q[0].copy()
        if isinstance(pose, Mapping):
            for name, value in pose.items():
                start[self._column(name)] = value
        else:
            start = np.asarray(pose, dtype=np.float64)
        if start.shape != (len(self.names),) or not np.all(np.isfinite(start)):
            raise ArgumentError(f"pose: got shape {start.shape}, expected {len(self.names)} finite values")
        spline = self._spline()
        rest = np.zeros_like(start)
        first = np.stack([self.q[0], spline(self.t[0], 1), spline(self.t[0], 2)])
        polynomial = BPoly.from_derivatives([0.0, seconds], np.stack([[start, rest, rest], first]))
        step = self.duration / (self.t.size - 1)
        before = np.linspace(0.0, seconds, max(2, round(seconds / step) + 1))[:-1]
        return replace(
            self,
            t=np.concatenate([self.t[0] + before, self.t + seconds]),
            q=np.concatenate([polynomial(before), self.q]),
        )

    def loop(
        self, duration: float, *, shortest: float = 0.5, travelling: Sequence[str] = ("torso_tx", "torso_ty")
    ) -> Motion:
        """Repeat the motion's best cycle until it lasts `duration` seconds.

        The cycle is what lies between the two samples, at least `shortest` seconds apart, whose
        poses and velocities are most alike for the way the pose has gone between them. What is
        left of their difference is spread evenly over the cycle, so that the repetition has no
        jump; the `travelling` variables go on from where they are instead.

        Parameters
        ----------
        duration : float
            Seconds asked for; a shorter motion than that is repeated, a longer one is cut.
        shortest : float
            Shortest cycle in seconds; set it between one step and one stride.
        travelling : sequence of str
            Variables that advance from cycle to cycle; names that the motion lacks are ignored.

        Raises
        ------
        ArgumentError
            The motion is not longer than `shortest`.
        """
        as_number(duration, "duration", above=0.0)
        step = self.duration / (self.t.size - 1)
        n_steps = count_steps(duration, step)
        motion = self.resample(step)
        if n_steps <= motion.t.size - 1:
            return motion.resample(step, duration=n_steps * step)
        as_number(shortest, "shortest", above=0.0)
        gap = max(3, int(np.ceil(shortest / step)))
        if gap >= motion.t.size:
            raise ArgumentError(
                f"shortest: got {shortest:g} s, the motion lasts only {self.duration:g} s; a cycle must fit into it"
            )
        moving = np.array([name in travelling for name in self.names])
        first, last = _best_cycle(motion, gap, ~moving)
        period = last - first
        gain = motion.q[last] - motion.q[first]
        share = np.arange(period)[:, None] / period
        cycle = motion.q[first:last] - np.where(moving, 0.0, gain) * (share - 0.5)
        n_cycles = -(-(n_steps + 1) // period)
        turns = np.arange(n_cycles)[:, None, None] * np.where(moving, gain, 0.0)
        q = (cycle[None] + turns).reshape(-1, len(self.names))[: n_steps + 1]
        q = q - np.where(moving, q[0] - self.q[0], 0.0)
        return replace(self, t=step * np.arange(n_steps + 1, dtype=np.float64), q=q)

    def _spline(self) -> CubicSpline:
        return CubicSpline(self.t, self.q, axis=0)


def _best_cycle(motion: Motion, gap: int, compared: NDArray[np.bool_]) -> tuple[int, int]:
    """Indices of two samples, at least `gap` apart, that a cycle can run between.

    Those whose pose and velocity differ least, measured by how far the pose has moved from one to
    the other: standing still is no cycle.
    """
    velocity = motion.velocity()
    lengths = np.array([name.endswith(_LENGTH_SUFFIXES) for name in motion.names])
    # A metre counts as two radians; a difference of velocities as what it makes in 0.1 s.
    weight = np.where(lengths, 2.0, 1.0)
    pose = (motion.q * weight)[:, compared]
    state = np.concatenate([pose, 0.1 * velocity * weight], axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(pose, axis=0), axis=1))])
    best, pair = np.inf, (0, gap)
    for first in range(motion.t.size - gap):
        apart = np.linalg.norm(state[first + gap :] - state[first], axis=1)
        score = (apart + 1e-12) / (way[first + gap :] - way[first] + 1e-9)
        index = int(np.argmin(score))
        if score[index] < best:
            best, pair = float(score[index]), (first, first + gap + index)
    return pair
