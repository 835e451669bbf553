"""What was identified: estimates with standard errors, and whether the residuals are noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from leastaction.errors import unknown
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UNLIKELY = 1e-4  # probability of residuals of that size, below which they are not what sigma says
# Correlation of neighbouring residuals, in its own standard deviations, from which on it is none of noise.
_COLOURED = 4.0
_FEW = 8  # residuals at least that are told from noise


@dataclass(frozen=True)
class Residuals(Frozen):
    """What is left of one thing that was measured. Frozen.

    Attributes
    ----------
    t, measured, predicted : ndarray (n,)
        Times (s), values that were measured, NaN in the gaps, and those of the motion that was found.
    scaled : ndarray (n,)
        Measured less predicted, in standard deviations of the noise.
    """

    t: Array
    measured: Array
    predicted: Array
    scaled: Array

    @property
    def size(self) -> float:
        """Their root mean square, about 1 of noise."""
        known = self.scaled[~np.isnan(self.scaled)]
        return float(np.sqrt(np.mean(known**2))) if known.size else np.nan

    @property
    def correlation(self) -> float:
        """Correlation of neighbouring ones, about 0 of noise, give or take ``1 / sqrt(n)``; 0 of few."""
        r = self.scaled - np.nanmean(self.scaled)
        pairs = ~np.isnan(r[1:] * r[:-1])
        total = float(np.nansum(r**2))
        if pairs.sum() < _FEW or total == 0.0:
            return 0.0
        return float(np.sum(r[1:][pairs] * r[:-1][pairs]) / total)

    @property
    def is_coloured(self) -> bool:
        """Whether neighbours have too much in common for noise."""
        return bool(abs(self.correlation) * np.sqrt(np.sum(~np.isnan(self.scaled))) > _COLOURED)


@public
@dataclass(frozen=True)
class Identification(Frozen):
    """Parameters of a mechanism, as measurements tell them. Frozen: threads may share it.

    Attributes
    ----------
    values : Mapping[str, float]
        Estimates by name.
    errors : Mapping[str, float]
        Their standard errors; infinite where the measurements do not tell them.
    covariance : ndarray (P, P)
        In the order of `values`: of the parameters, whatever the starts are.
    chi_squared, freedom : float, int
        Sum of the squared residuals in standard deviations, and of how many it would be of noise: measurements less
        what was found.
    sigma_known : bool
        Whether noise was given; else it is that of the residuals.
    residuals : tuple of Mapping[str, Residuals]
        Of every experiment, by what was measured.
    mechanism : Mechanism
        With the estimates.
    runs : tuple of Trajectory
        The motions of the experiments.
    converged : bool
        Whether the search ended at a minimum.
    message : str
        How it ended.
    doubts : tuple of str
        What speaks against the estimates: a search that has not ended, residuals that are not noise, what cannot be
        told. `identify` warns of each.
    horizons : tuple of float
        Parts of the experiments that were fitted one after the other.
    iterations : int
        Motions that were made of every experiment.
    """

    values: Mapping[str, float]
    errors: Mapping[str, float]
    covariance: Array
    chi_squared: float
    freedom: int
    sigma_known: bool
    residuals: tuple[Mapping[str, Residuals], ...] = field(repr=False)
    mechanism: Mechanism = field(repr=False)
    runs: tuple[Trajectory, ...] = field(repr=False)
    converged: bool
    message: str
    doubts: tuple[str, ...]
    horizons: tuple[float, ...]
    iterations: int

    def __post_init__(self) -> None:
        for name in ("values", "errors"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        super().__post_init__()

    def __getitem__(self, name: str) -> float:
        """Return an estimate by name; raises `ArgumentError` for an unknown one."""
        if name not in self.values:
            raise unknown("parameter", name, self.values)
        return self.values[name]

    @property
    def success(self) -> bool:
        """Whether the search ended at a minimum, and nothing speaks against it."""
        return self.converged and not self.doubts

    @property
    def reduced(self) -> float:
        """``chi_squared / freedom``: about 1 where sigma is that of the noise."""
        return self.chi_squared / self.freedom if self.freedom > 0 else np.nan

    @property
    def correlation(self) -> Array:
        """Correlations of the estimates (P, P)."""
        s = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.covariance / np.outer(s, s))

    def __str__(self) -> str:
        width = max(len(name) for name in self.values)
        lines = [self.message]
        lines += [f"{name:{width}s}  {value:12.6g} +- {self.errors[name]:.2g}" for name, value in self.values.items()]
        said = f"chi squared {self.chi_squared:.5g} of {self.freedom}"
        lines.append(said if self.sigma_known else f"noise {np.sqrt(self.reduced):.3g}, that of the residuals")
        return "\n".join([*lines, *(f"But {doubt}." for doubt in self.doubts)])

    def plot(self, *, title: str = "Identification") -> Figure:
        """Draw what was measured over the motion that was found, and what is left in standard deviations.

        Parameters
        ----------
        title : str
            Heading.

        Returns
        -------
        Figure
            Of Matplotlib: two panels for each thing that was measured, at most four of them for each experiment.
        """
        from leastaction.identification.plots import draw_residuals  # slow to import, and not needed by most

        # No line ends within one of them.
        told = [
            f"{name}\N{NO-BREAK SPACE}{value:.4g}\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}{self.errors[name]:.1g}"
            for name, value in self.values.items()
        ]
        return draw_residuals(self.residuals, f"{title}\n{', '.join(told)}")


def doubts_of(
    residuals: tuple[Mapping[str, Residuals], ...],
    names: tuple[str, ...],
    chi_squared: float,
    freedom: int,
    *,
    known: bool,
) -> list[str]:
    """Return what in residuals is not noise; ``names``: of the experiments, ``known``: whether sigma was given."""
    from scipy.special import gammainc, gammaincc  # slow to import

    found = []
    if known and freedom > 0:
        above, below = (float(f(0.5 * freedom, 0.5 * chi_squared)) for f in (gammaincc, gammainc))
        size = np.sqrt(chi_squared / freedom)
        if above < _UNLIKELY:
            found.append(
                f"the residuals are {size:.3g} times what sigma says: the model misses something, or the noise is "
                "larger; the standard errors are too small"
            )
        elif below < _UNLIKELY:
            found.append(f"the residuals are {size:.3g} times what sigma says: the noise is less than was given")
    coloured = [
        f"{label!r}{of} ({each.correlation:+.2f})"
        for name, channels in zip(names, residuals, strict=True)
        for of in [f" of {name}" if name else ""]
        for label, each in channels.items()
        if each.is_coloured
    ]
    if coloured:
        more = f" and {len(coloured) - 3} more" if len(coloured) > 3 else ""
        found.append(
            f"neighbouring residuals of {', '.join(coloured[:3])}{more} are alike, which noise is not: the model "
            "misses something there, and the standard errors are too small"
        )
    return found
