"""Every setting of an optimisation that is no part of the problem: the same in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args

from leastaction.errors import ArgumentError, KeywordError, closest
from leastaction.numerics.arrays import as_array, as_choice, as_count, as_number, read_only
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.numerics.public import public
from leastaction.optimal.accuracy import Accuracy

Method = Literal["auto", "steepest", "quasi-newton", "newton"]
Regulator = Literal["descent", "lqr"]
Shooting = Literal["auto", "single", "multiple"]

WAY_NAMES = ("freely", "gaps", "easing", "resolved")
"""Names of the ways to begin again (see `leastaction.optimal.ways`)."""


def _still_ways(names: list[str]) -> list[str]:
    """Return those that are ways today, of names in a file: older files may have switched off others."""
    return [name for name in names if name in WAY_NAMES]


@public
@dataclass(frozen=True, kw_only=True)
class Options:
    """The settings of an optimisation. Frozen: any number of runs and threads may share them.

    Parameters
    ----------
    method : {"auto", "steepest", "quasi-newton", "newton"}
        Model of the descent direction; "auto" goes from quasi-Newton to Newton, and begins again where it
        ends without a minimum.
    regulator : {"descent", "lqr"}
        Gains of the projection: those of the direction's own linear-quadratic problem, which cost nothing more, or an
        LQR with identities as weights (dissertation 6.3.1).
    projection : array_like, PiecewisePolynomial or mapping, optional
        Gains of the projection in your own hands, in place of those of `regulator`: gains (N, nu, nx), in continuous
        time a `PiecewisePolynomial` of (nu, nx), as they are; or weights of a regulator about each iterate, such as
        ``{"Q": ..., "R": ..., "Q_final": ...}`` (as of `regulate` and `regulate_continuous`).
    shooting : {"auto", "single", "multiple"}
        Whether the steps of a curve may miss the next states, until the gaps are closed: where it helps, never, or
        from the start.
    collocate : bool
        Whether a problem in continuous time is put on a mesh; else its equations are integrated in time, which takes
        many times as long, and knows neither limits nor a free start.
    max_iterations : int
        Limit on the iterations of a run.
    tolerance : float
        Expected decrease ``-Dg . dxi``, relative to the cost, at which a run has converged.
    absolute_tolerance : float
        The same in units of the cost, added: of a cost that goes to zero.
    alpha : float
        Armijo's fraction of the linear decrease that a step has to bring, in (0, 1/2).
    beta : float
        Factor from one trial step to the next, in (0, 1).
    max_backtracks : int
        Shorter steps tried along one direction.
    chunk : int
        Steps of time simulated between two looks at the cost of a trial, which may be given up early.
    accuracy : Accuracy, optional
        Integrator and tolerances in continuous time.
    without : iterable of str
        Ways to begin again that are not taken: "freely" (from the minimum without limits), "gaps" (multiple shooting),
        "easing" (dear inputs first), "resolved" (within what the steps of time resolve).

    Raises
    ------
    ArgumentError
        A setting that does not exist or is out of range.
    """

    method: str = "auto"
    regulator: str = "descent"
    projection: Any = field(default=None, compare=False)
    shooting: str = "auto"
    collocate: bool = True
    max_iterations: int = 1000
    tolerance: float = 1e-9
    absolute_tolerance: float = 1e-14
    alpha: float = 1e-4
    beta: float = 0.5
    max_backtracks: int = 20
    chunk: int = 256
    accuracy: Accuracy | None = None
    without: tuple[str, ...] = field(default=(), metadata={"earlier": ("without", _still_ways)})

    def __post_init__(self) -> None:
        as_choice(self.method, "method", get_args(Method))
        as_choice(self.regulator, "regulator", get_args(Regulator))
        as_choice(self.shooting, "shooting", get_args(Shooting))
        object.__setattr__(self, "projection", _as_projection(self.projection))
        given: Any = self.without
        without = (given,) if isinstance(given, str) or not isinstance(given, Iterable) else tuple(given)
        for name in without:
            as_choice(name, "without", WAY_NAMES)
        checked = {
            "max_iterations": as_count(self.max_iterations, "max_iterations", 0),
            "tolerance": as_number(self.tolerance, "tolerance", least=0.0),
            "absolute_tolerance": as_number(self.absolute_tolerance, "absolute_tolerance", least=0.0),
            "alpha": as_number(self.alpha, "alpha", above=0.0, below=0.5),
            "beta": as_number(self.beta, "beta", above=0.0, below=1.0),
            "max_backtracks": as_count(self.max_backtracks, "max_backtracks", 0),
            "chunk": as_count(self.chunk, "chunk", 1),
            "without": without,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def tries_gaps(self) -> bool:
        """Whether gaps between the steps may be tried where nobody asked for them: not with gains of its own."""
        own_gains = self.projection is not None or self.regulator == "lqr"
        return self.method == self.shooting == "auto" and not own_gains and "gaps" not in self.without

    def changed(self, **settings: Any) -> Options:
        """Return the options with other values of some.

        Raises
        ------
        ArgumentError
            As of `Options`; or a name that is none.
        """
        names = [each.name for each in fields(self)]
        for name in settings:
            if name not in names:
                raise KeywordError(name, names)
        return replace(self, **settings) if settings else self


_OF_THE_PROBLEM = ("horizon", "limits", "free_start", "unknowns", "resume", "options", "callback")


def check_settings(settings: Mapping[str, Any]) -> None:
    """Complain about settings that are passed on to `optimize`, before anything is computed."""
    Options().changed(**{name: value for name, value in settings.items() if name not in _OF_THE_PROBLEM})


def _as_projection(given: Any) -> Any:
    """Return gains or weights of a projection, owned, as far as they can be checked without a system."""
    if given is None or isinstance(given, PiecewisePolynomial):
        return given
    if not isinstance(given, Mapping):
        return read_only(as_array(given, "projection", (None, None, None), meaning="(N, nu, nx), gains").copy())
    for name in given:
        if name not in _WEIGHTS:
            raise ArgumentError(f"projection: {name!r} is no weight; {closest(str(name), _WEIGHTS, what='weights')}")
    return dict(given)


_WEIGHTS = ("Q", "R", "Q_final")

USUAL = Options()
"""Those that nobody has changed."""
