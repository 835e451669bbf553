"""Following a wanted motion, given by the names of variables and frames, with any mechanism."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, closest
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import State, Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array, as_times, as_wanted, read_only, require_instance, require_mapping
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult
from leastaction.systems.following.cost import following_cost
from leastaction.systems.following.curves import held_still, through, wanted_curve, with_inputs
from leastaction.systems.following.kinds import WantedKind, kind_of, quaternion_of
from leastaction.systems.following.ways import Ways
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.orientations import known_quaternions

_ROWS = "one row for each time"
_SMOOTHED = 0.1  # by which the length of a quaternion between samples may miss one


class Wanted(Protocol):
    """A motion by the names of variables, such as `leastaction.io.Motion`."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its variables."""

    @property
    def t(self) -> Array:
        """Times (N+1,) (s)."""

    def __getitem__(self, name: str) -> Array:
        """Return the values (N+1,) of a variable."""


@public
@dataclass(frozen=True, kw_only=True)
class Followed(Frozen):
    """A motion that follows a wanted one, the inputs that make it, and the gains that hold it.

    Frozen; threads may share it.

    Attributes
    ----------
    system : MidpointSystem
        Of the mechanism over the times of the motion, with multipliers in its state where it has constraints.
    wanted : mapping of str to ndarray
        What was wanted: (N+1,) of variables, (N+1, 4) of joints that turn as quaternions, (N+1, 3) or (N+1, 3, 3) of
        frames; NaN where nothing was.
    result : OptimizationResult
        Of `optimize`: states, inputs, gains, limits, and how it ended.
    way : str
        From where it was found, in words.
    """

    system: MidpointSystem = field(repr=False)
    wanted: Mapping[str, Array] = field(repr=False)
    result: OptimizationResult = field(repr=False)
    way: str

    def __post_init__(self) -> None:
        wanted = {name: read_only(each) for name, each in self.wanted.items()}
        object.__setattr__(self, "wanted", MappingProxyType(wanted))
        super().__post_init__()

    def __str__(self) -> str:
        off = ", ".join(f"{name} {value:.3g}" for name, value in self.errors.items())
        return f"Found {self.way}; off by (rms) {off}.\n{self.result}"

    @property
    def trajectory(self) -> Trajectory:
        """The motion, by names."""
        return self.system.trajectory(self.result.x, self.result.u)

    @property
    def t(self) -> Array:
        """Times of the states (N+1,) (s)."""
        return self.system.t

    def __getitem__(self, name: str) -> Array:
        """Return a state, an input or a multiplier over time by name, as the result does."""
        return self.result[name]

    @property
    def errors(self) -> dict[str, float]:
        """Root mean square distance from what was wanted, where anything was, by name (rad or m)."""
        m = self.system.mechanism
        q = np.ascontiguousarray(self.result.x[:, : m.nq])
        found = {}
        for name, goal in self.wanted.items():
            kind = kind_of(goal)
            if kind is WantedKind.VALUE:
                squares = (q[:, m.coordinates.index(name)] - goal) ** 2
            elif kind is WantedKind.PLACE:
                squares = (m.positions(q, [name])[:, 0] - goal) ** 2
                squares = np.where(np.isnan(goal).all(axis=1), np.nan, np.nansum(squares, axis=1))
            else:
                at = quaternion_of(m, name) if kind is WantedKind.TURN else slice(0)
                made = q[:, at] if kind is WantedKind.TURN else rotations.of_matrix(m.frame_pose(q, name)[:, :3, :3])
                wanted = goal if kind is WantedKind.TURN else rotations.of_matrix(goal)
                squares = np.sum(rotations.logarithm(rotations.product(rotations.inverse(wanted), made)) ** 2, axis=1)
            found[name] = float(np.sqrt(np.nanmean(squares)))
        return found


@public
def follow(
    mechanism: Mechanism,
    motion: Wanted | Mapping[str, ArrayLike],
    weights: Mapping[str, float] | None = None,
    limits: Sequence[Limit] = (),
    *,
    t: ArrayLike | None = None,
    start: State | None = None,
    resume: OptimizationResult | None = None,
    max_iterations: int = 1000,
    tolerance: float = 1e-6,
    threads: int = 0,
    progress: Callable[[str], object] | None = None,
    **options: Any,
) -> Followed:
    """Find the motion of a mechanism that follows a wanted one best, with its inputs and gains.

    The wanted motion need not be possible, nor say anything of inputs, strings, or other variables. It is tried from
    the wanted motion itself, brought onto the constraints, with the inputs that it needs (inverse dynamics); from
    holding still where it begins; with limits, from what is found without them. Each of these has 60 iterations, then
    300, then all that are allowed, and the first that converges is taken. Where none does, dynamic embedding
    (`embed`) is tried, where forces on all variables help at first.

    Parameters
    ----------
    mechanism : Mechanism
        An arm, a cart, a puppet: what moves it are its inputs and its kinematic variables.
    motion : Wanted or mapping of str to array_like
        A `leastaction.io.Motion`, or by name what is wanted at all times: values (N+1,) of variables, places (N+1, 3)
        of the origins of frames (m), rotations of frames in the world, matrices (N+1, 3, 3) or unit quaternions
        (N+1, 4), scalar first, and such quaternions by the name of a ball or free joint that turns as one. NaN where
        anything is as good: of keyframes all but their instants.
    weights : mapping of str to float, optional
        By names or patterns of them, of half the squares of: the distance of a wanted variable, joint or frame from
        where it is wanted, of a rotation the vector of the one that is missing (1 if left out); the place of a
        kinematic variable that is not wanted, about where it goes along with the motion (1e-3); an input (1e-6);
        ``"acceleration of NAME"`` of a kinematic variable (1e-6); ``"momentum of NAME"``, about that of the wanted
        motion (0); a variable that is not wanted (0, but 1e-3 where frames are, about a pose that reaches them; 0 of
        one that only constraints take along). Later ones count.
    limits : sequence of Limit, optional
        As of `optimize`. Tensions can be limited.
    t : array_like (N+1,), optional
        Times (s); needed where the motion is a mapping, and only there.
    start : State, optional
        Where it begins. If left out, at rest in the first wanted configuration, and what that does not say is zero, as
        far as constraints let it: give one where there are strings.
    resume : OptimizationResult, optional
        Go on with what an earlier call of the same motion, weights and limits had found, without looking for another
        way.
    max_iterations, tolerance, **options
        Of `optimize`.
    threads : int, optional
        Of the integrator.
    progress : callable, optional
        Called with a line of text when another way is tried.

    Returns
    -------
    Followed
        Where no way converges, the motion that costs least of those that keep to their limits; its result says how it
        ended.

    Raises
    ------
    ArgumentError
        Unknown names, wrong shapes, negative weights, or no way that leads to any motion.
    InconsistentStartError
        A wanted motion that cannot be brought onto the constraints.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    weights = {} if weights is None else weights
    require_mapping(weights, "weights", "{'hand': 100.0}")
    m = mechanism
    wanted, times = _wanted(m, motion, t)
    if start is not None:
        require_instance(start, "start", State, "MidpointVI(mechanism).start(q) makes one of a configuration")
    system = MidpointSystem(MidpointVI(m, threads=threads), times, multipliers=m.nc > 0)
    x, u = wanted_curve(system, {name: through(times, values) for name, values in wanted.items()}, start)
    cost = following_cost(system, wanted, x, u, weights)
    if resume is not None:
        given = {"limits": limits, "max_iterations": max_iterations, "tolerance": tolerance, **options}
        result = optimized(system, cost, resume=resume, **given)
        return Followed(system=system, wanted=wanted, result=result, way="from where an earlier search was")
    starts = [(x, u), held_still(system, x)]
    if m.n_inputs:
        starts[0] = x, _cheaper(system, cost, x, [with_inputs(system, x, u), u])
    ways = Ways(system, cost, limits, starts, {"tolerance": tolerance, **options}, progress)
    way, result = ways.search(max_iterations)
    return Followed(system=system, wanted=wanted, result=result, way=way)


def _wanted(
    m: Mechanism, motion: Wanted | Mapping[str, ArrayLike], t: ArrayLike | None
) -> tuple[dict[str, Array], Array]:
    """Return what is wanted by names, and the times."""
    if isinstance(motion, Mapping):
        if t is None:
            raise ArgumentError("t: got none, expected the times of the motion, (N+1,)")
        times, given = as_times(t), dict(motion)
    else:
        if not all(hasattr(motion, name) for name in ("t", "names")):
            raise ArgumentError(
                f"motion: got {type(motion).__name__}, expected a Motion, or by name what is wanted: a mapping"
            )
        if t is not None:
            raise ArgumentError("t: the motion has times of its own, expected none; use its resample()")
        times, given = as_times(motion.t), {name: motion[name] for name in motion.names}
    if not given:
        raise ArgumentError("motion: got nothing that is wanted, expected values of variables or places of frames")
    # Of a quaternion neither its numbers nor its turns are wanted one by one.
    for each in m.tree.rotations:
        if all(name in given for name in each.quaternion):
            numbers = {name: given.pop(name) for name in each.quaternion}
            given[each.name] = _quaternions(numbers, len(times))
    plain, turns = [name for name in m.variables if name in m.coordinates], [each.name for each in m.tree.rotations]
    for frame in m.frames:
        axes = [f"{frame}.{axis}" for axis in "xyz"]
        if given.keys() >= set(axes) and not set(axes) & set(plain):
            rows = [as_wanted(given.pop(axis), f"motion: {axis!r}", (len(times),)) for axis in axes]
            given[frame] = np.stack(rows, axis=1)
    found = {}
    for name, values in given.items():
        if name not in plain and name not in m.frames and name not in turns:
            known = closest(name, (*plain, *turns, *m.frames), what="variables, joints and frames")
            raise ArgumentError(f"motion: nothing is called {name!r}; {known}")
        n, what = len(times), f"motion: {name!r}"
        shapes = [(n,)] * (name in plain) + [(n, 4)] * (name in turns or name in m.frames)
        wanted = as_wanted(values, what, *shapes, *[(n, 3), (n, 3, 3)] * (name in m.frames), meaning=_ROWS)
        if np.isnan(wanted).all():
            raise ArgumentError(f"{what}: got nothing but NaN, expected numbers where something is wanted")
        if kind_of(wanted) in (WantedKind.TURN, WantedKind.ORIENTATION):
            q, is_known = known_quaternions(wanted, what, times)
            if wanted.ndim == 2 and name not in turns:
                wanted = np.where(is_known[:, None, None], rotations.matrix(q), np.nan)
        found[name] = wanted
    return found, times


def _quaternions(numbers: Mapping[str, ArrayLike], n: int) -> Array:
    """Return quaternions (n, 4) of their numbers, which a motion has smoothed one by one: of length one again."""
    q = np.stack([as_wanted(each, f"motion: {name!r}", (n,)) for name, each in numbers.items()], axis=1)
    length = np.linalg.norm(q, axis=1, keepdims=True)
    return np.asarray(q / np.where(np.abs(length - 1.0) < _SMOOTHED, length, 1.0))


def _cheaper(system: MidpointSystem, cost: Cost, x: Array, candidates: Sequence[Array]) -> Array:
    """Return the inputs with which the projection of a curve costs least."""
    costs = []
    for u in candidates:
        try:
            costs.append(optimized(system, cost, initial=(x, u), max_iterations=0).cost)
        except LeastActionError:
            costs.append(np.inf)
    return candidates[int(np.argmin(costs))]
