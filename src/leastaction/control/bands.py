"""How robust a closed loop is: many runs of it, with what is not known drawn by chance."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, some, unknown
from leastaction.numerics.arrays import Array, as_count, read_only
from leastaction.numerics.extras import extra
from leastaction.numerics.public import public
from leastaction.systems.closed_loop import ClosedLoop
from leastaction.viz.figures import BLUE, new_figure, styled
from leastaction.viz.signals import drawn_unit

_DEPTHS = {"all": 0.2, "90 %": 0.4, "50 %": 0.6}  # share of the colour in each band, of how many runs

LoopRun = Callable[[np.random.Generator], ClosedLoop]
"""One run of a loop, in which whatever is drawn is drawn from the generator given."""


@public
@dataclass(frozen=True, eq=False)
class LoopBands:
    """Many runs of a closed loop, or of a mechanism without one (`ManyRuns.bands`).

    Attributes
    ----------
    t : ndarray (N+1,)
        Times of the longest run (s).
    x, u : ndarray (B, N+1, nx), (B, N, nu)
        States and inputs of all runs; NaN after the end of one that ended early.
    failures : tuple of (int, str)
        Which runs ended early, and why.
    state_names, input_names : tuple of str
    units : mapping of str to str
        Of states and inputs by their names, where they are known.
    """

    t: Array
    x: Array
    u: Array
    failures: tuple[tuple[int, str], ...]
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        """Return an entry of the state, or an input, of all runs over time (B, N+1) or (B, N)."""
        if name in self.state_names:
            return np.asarray(self.x[:, :, self.state_names.index(name)])
        if name in self.input_names:
            return np.asarray(self.u[:, :, self.input_names.index(name)])
        raise unknown("name", name, (*self.state_names, *self.input_names), "name")

    def __str__(self) -> str:
        """Say how many runs there are, where they end, and which of them ended early."""
        lines = [f"{len(self.x)} runs to t = {self.t[-1]:g} s, {len(self.failures)} of them ended early"]
        if len(self.failures) < len(self.x):
            low, middle, high = np.nanquantile(self.x[:, -1], (0.05, 0.5, 0.95), axis=0)
            rows = zip(self.state_names, low, middle, high, strict=True)
            ends = [f"{name} {b:.4g} ({a:.4g} to {c:.4g})" for name, a, b, c in rows]
            lines.append(f"ends at, in the middle and nine in ten: {some(ends)}")
        return "\n".join([*lines, *(f"run {number}: {why}" for number, why in self.failures)])

    def quantiles(self, name: str, shares: ArrayLike = (0.05, 0.5, 0.95)) -> Array:
        """Return quantiles over the runs at every instant (len(shares), n), of those that got so far."""
        return np.asarray(np.nanquantile(self[name], np.asarray(shares), axis=0))

    def plot(self, names: Iterable[str], axes: Any = None) -> Any:
        """Draw the bands of some quantities, one over the other: all runs, nine in ten, half, and the median.

        Parameters
        ----------
        names : str or iterable of str
        axes : sequence of matplotlib.axes.Axes, optional
            One for each name; a new figure if left out.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingExtraError
            Matplotlib is not installed.
        """
        chosen = [names] if isinstance(names, str) else list(names)
        extra("matplotlib", of="viz", why="LoopBands.plot")
        return self._drawn(chosen, axes)

    @styled
    def _drawn(self, chosen: list[str], axes: Any) -> Any:
        from matplotlib.colors import to_rgb

        if axes is None:
            axes = new_figure(8.0, 0.5 + 1.9 * len(chosen)).subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axis, name in zip(axes, chosen, strict=True):
            factor, unit = drawn_unit(self.units.get(name, ""))
            bands = factor * self.quantiles(name, (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0))
            t = self.t[: bands.shape[1]]
            for i, (label, depth) in enumerate(_DEPTHS.items()):
                tint = [1.0 - depth * (1.0 - part) for part in to_rgb(BLUE)]
                axis.fill_between(t, bands[i], bands[-1 - i], color=tint, lw=0.0, label=label)
            axis.plot(t, bands[3], color=BLUE, label="median")
            axis.set_ylabel(name if unit in ("", "1") else f"{name} ({unit})")
            axis.set_xlim(self.t[0], self.t[-1])
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize="small", frameon=False)
        axes[-1].set_xlabel("time (s)")
        return axes[0].figure


@public
def monte_carlo(
    run: LoopRun, runs: int, *, seed: int = 0, progress: Callable[[int, int], None] | None = None
) -> LoopBands:
    """Run a closed loop many times, with what is drawn by chance drawn anew.

    Parameters
    ----------
    run : callable
        ``run(rng) -> ClosedLoop``: draws a start, parameters (``mechanism.with_parameters``) and noise from a
        ``numpy.random.Generator``, and closes the loop. Each run gets a generator of its own, by its number: which
        runs there are beside it changes nothing in one.
    runs : int
    seed : int, optional
    progress : callable, optional
        Called with the number of runs done and of all.

    Returns
    -------
    LoopBands
        Of fewer runs where Ctrl-C ended it.

    Raises
    ------
    ArgumentError
        No run, or one that returns something else.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import JointForce, Mechanism, MidpointVI, tx
    >>> from leastaction.control import close_loop, monte_carlo
    >>> def run(rng):
    ...     slide = Mechanism([tx("x", mass=rng.uniform(0.5, 2.0))], [JointForce("x", input="push")])
    ...     law = lambda t, x: -4.0 * x[:1] - 3.0 * x[1:]
    ...     return close_loop(MidpointVI(slide), law, [rng.normal(), 0.0], np.arange(101) * 0.1)
    >>> bands = monte_carlo(run, 20)
    >>> bands["x"].shape, bool(abs(bands["x"][:, -1]).max() < 0.05)
    ((20, 101), True)
    """
    count, first = as_count(runs, "runs", 1), as_count(seed, "seed", 0)
    found: list[ClosedLoop] = []
    for i in range(count):
        try:
            one = run(np.random.default_rng([first, i]))
        except KeyboardInterrupt:
            if not found:
                raise
            break
        if not isinstance(one, ClosedLoop):
            raise ArgumentError(f"run: got {type(one).__name__}, expected a function that returns a ClosedLoop")
        found.append(one)
        if one.interrupted:
            break
        if progress is not None:
            progress(i + 1, count)
    count = len(found)
    longest = max(found, key=lambda each: len(each.t))
    x = np.full((count, *longest.x.shape), np.nan)
    u = np.full((count, *longest.u.shape), np.nan)
    for i, one in enumerate(found):
        if one.state_names != longest.state_names:
            raise ArgumentError(f"run {i}: got states {one.state_names}, expected those of the others")
        x[i, : len(one.x)], u[i, : len(one.u)] = one.x, one.u
    failures = tuple((i, one.failure) for i, one in enumerate(found) if one.failure is not None)
    named = longest.state_names, longest.input_names, longest.units
    return LoopBands(longest.t, read_only(x), read_only(u), failures, *named)
