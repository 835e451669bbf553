"""`simulate`, of either kind of time: under inputs that are known, or in a loop that is closed by a controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, KeywordError, LackingArgumentError
from leastaction.mechanics.continuous import simulation as continuous
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics, as_dynamics
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import State, Trajectory, state_of
from leastaction.mechanics.mechanism.arguments import rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, Row, as_array, as_times
from leastaction.numerics.public import checked, public
from leastaction.numerics.signals import Signal, StateLaw, signal_rows, takes_state
from leastaction.optimal.system import System

if TYPE_CHECKING:  # what closes loops is slow to import, and asked of few simulations
    from leastaction.control.closed_loop import Disturbance
    from leastaction.control.predictive import MPC
    from leastaction.control.readings import Measured, Spread
    from leastaction.mechanics.continuous.events import Event
    from leastaction.mechanics.continuous.prescribed import PrescribedMotion
    from leastaction.mechanics.continuous.signals import ContinuousSignal
    from leastaction.mechanics.continuous.stabilisation import Baumgarte, Projection
    from leastaction.mechanics.discrete.simulation import LawAt
    from leastaction.systems.closed_loop import ClosedLoop


class DiscreteOptions(TypedDict, total=False):
    """What `MidpointVI.simulate` takes besides."""

    rho: Signal
    law_at: LawAt
    energy_tolerance: float | None
    progress: Callable[[int, int], None] | None


class ContinuousOptions(TypedDict, total=False):
    """What `leastaction.mechanics.simulate` takes besides."""

    rho: PrescribedMotion | ArrayLike | Mapping[str, PrescribedMotion | ArrayLike] | None
    rho_a: ContinuousSignal
    u: StateLaw | None
    method: str
    rtol: float
    atol: float | ArrayLike
    max_step: float | None
    first_step: float | None
    max_steps: int | None
    max_seconds: float | None
    events: Mapping[str, Event | Callable[[float, Array], float] | str] | None
    constraints: str | Projection | Baumgarte
    dense_output: bool
    progress: Callable[[float, float], None] | None


class LoopOptions(TypedDict, total=False):
    """What closes a loop; see `close_loop`."""

    measure: Measured | None
    noise: Spread
    delay: float
    estimator: Any
    disturbance: Disturbance
    substeps: int
    seed: int


_LOOP = tuple(LoopOptions.__annotations__)


@overload
def simulate(
    dynamics: ContinuousDynamics | Mechanism | MidpointVI | System,
    q0: Row | State,
    v0: Row | None = ...,
    t: ArrayLike | None = ...,
    *,
    inputs: MPC,
    **options: Unpack[LoopOptions],
) -> ClosedLoop: ...


@overload
def simulate(  # type: ignore[overload-overlap]
    dynamics: ContinuousDynamics | Mechanism,
    q0: Row,
    v0: Row | None,
    t: ArrayLike,
    *,
    inputs: ContinuousSignal = ...,
    **options: Unpack[ContinuousOptions],
) -> ContinuousTrajectory: ...


@overload
def simulate(  # type: ignore[overload-overlap]
    dynamics: MidpointVI,
    q0: Row | State,
    v0: Row | None = ...,
    t: ArrayLike | None = ...,
    *,
    inputs: Signal | StateLaw = ...,
    **options: Unpack[DiscreteOptions],
) -> Trajectory: ...


@overload
def simulate(
    dynamics: ContinuousDynamics | Mechanism | MidpointVI | System,
    q0: Row | State,
    v0: Row | None = ...,
    t: ArrayLike | None = ...,
    *,
    inputs: Signal | StateLaw = ...,
    **options: Unpack[LoopOptions],
) -> ClosedLoop: ...


@public
def simulate(
    dynamics: ContinuousDynamics | Mechanism | MidpointVI | System,
    q0: Row | State,
    v0: Row | None = None,
    t: ArrayLike | None = None,
    *,
    inputs: Any = None,
    **options: Any,
) -> ContinuousTrajectory | Trajectory | ClosedLoop:
    """Simulate a mechanism or a system, in either kind of time, under inputs, a feedback or a controller.

    Parameters
    ----------
    dynamics : Mechanism, ContinuousDynamics, MidpointVI or System
        A mechanism moves in continuous time, a `MidpointVI` in steps from each time to the next. A system, of yours
        too, moves in a loop that is closed.
    q0 : array_like (nq,), mapping of str to float, or State
        Configuration at the start (m or rad), by name what is not given is zero; of a system, its state (nx,).
    v0 : array_like (nv,) or mapping of str to float, optional
        Velocity at the start (m/s or rad/s). None: at rest. A system's state, a `State` and a row of all numbers of a
        state have it: after these the times may stand in its place, ``simulate(vi, start, t)``.
    t : array_like (N+1,)
        Times of the result (s), increasing; the first is that of the start.
    inputs : array_like, callable or MPC, optional
        Force inputs: constant, rows (N, n_inputs), a function of time, a law ``(t, x) -> (n_inputs,)`` such as
        `Feedback`, or an `MPC`. Zero if not given.
    **options
        What closes the loop: ``measure=, noise=, delay=, estimator=, disturbance=, substeps=, seed=``, all of
        `leastaction.control.close_loop`. A controller is then asked at the times `t`, by what is read, and what it
        says is held over the step. So is what an `MPC` says, and what moves a system.
        Else what `leastaction.mechanics.simulate` takes of a mechanism in continuous time (``rho=, rtol=, events=,
        ...``), and `MidpointVI.simulate` of one in steps (``rho=, law_at=, energy_tolerance=, ...``).

    Returns
    -------
    ContinuousTrajectory, Trajectory or ClosedLoop
        The last where the loop is closed: with what was read and estimated, and what the controller says of its calls.

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, unknown names, times that do not increase, a start that does not
        agree with a prescribed motion, a delay that is no multiple of the step, or what does not go with a loop.
    InconsistentStartError
        If q0 or v0 violates the constraints; residuals by constraint name.

    Warns
    -----
    EnergyBalanceWarning
        If energy was lost or gained beside the work that was done.
    SingularityWarning
        If the motion comes near the singularity of a `ball` or `free` joint with angles; once for every joint.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import JointForce, Mechanism, simulate, tx
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> law = lambda t, x: -4.0 * x[:1] - 3.0 * x[1:]
    >>> run = simulate(slide, {"x": 1.0}, None, np.arange(101) * 0.1, inputs=law, noise=1e-3, delay=0.1, seed=1)
    >>> bool(abs(run["x"][-1]) < 0.01)
    True
    """
    whole = isinstance(q0, State) or isinstance(dynamics, System)
    if t is None and v0 is not None:
        if whole:
            v0, t = None, cast(ArrayLike, v0)
        elif (split := _split(dynamics, q0)) is not None:
            t = cast(ArrayLike, v0)
            q0, v0 = split(float(as_times(t)[0]))
            whole = isinstance(q0, State)
    if t is None:
        raise LackingArgumentError(
            "lacks t: call simulate(dynamics, q0, v0, t), where v0=None begins at rest; times in the place of v0 go "
            "with a State, or all (nx,) numbers of one, as q0"
        )
    if whole and v0 is not None:
        what = type(q0 if isinstance(q0, State) else dynamics).__name__
        raise ArgumentError(f"v0: got one beside a {what}, expected None: the state is given whole, as q0")
    own = DiscreteOptions if isinstance(dynamics, MidpointVI) else ContinuousOptions
    for name in options:
        if name not in (known := [*own.__annotations__, *_LOOP]):
            raise KeywordError(name, ["inputs", *known])
    closing = {name: options.pop(name) for name in _LOOP if name in options}
    if isinstance(dynamics, MidpointVI) and not isinstance(q0, State):
        q0, v0 = dynamics.start(q0, v0, t=float(as_times(t)[0])), None
    # What a controller says of itself is of one call, at an instant: it is asked by steps.
    if closing or hasattr(inputs, "info") or isinstance(dynamics, System):
        if options:
            raise ArgumentError(
                f"{', '.join(options)}: got {'it' if len(options) == 1 else 'them'} in a loop that is closed, expected "
                f"none but inputs, {', '.join(_LOOP)}"
            )
        return _closed(dynamics, q0, v0, as_times(t), inputs, closing)
    if isinstance(dynamics, MidpointVI):
        return checked(MidpointVI.simulate)(dynamics, cast(State, q0), t, inputs=inputs, **options)
    return checked(continuous.simulate)(as_dynamics(dynamics), cast(Row, q0), v0, t, inputs=inputs, **options)


def _split(dynamics: Any, row: Any) -> Callable[[float], tuple[Any, Any]] | None:
    """Return what gives q0 and v0 at a time, of a row of all numbers of a mechanism's state; None where it is none."""
    m: Mechanism = dynamics if isinstance(dynamics, Mechanism) else dynamics.mechanism
    if isinstance(row, Mapping) or np.shape(row) != ((m.nx if isinstance(dynamics, MidpointVI) else m.nq + m.nv),):
        return None
    x = as_array(row, "q0", np.shape(row))
    if isinstance(dynamics, MidpointVI):
        return lambda t: (state_of(m, t, x), None)
    return lambda _: (x[: m.nq], x[m.nq :])


def _closed(dynamics: Any, q0: Any, v0: Row | None, times: Array, inputs: Any, closing: dict[str, Any]) -> ClosedLoop:
    """Return what happens in a closed loop; inputs that are known are a law that looks at no state."""
    from leastaction.control.closed_loop import close_loop
    from leastaction.control.plants import plant_of
    from leastaction.systems.continuous import MechanismSystem

    start = q0
    if not isinstance(dynamics, (MidpointVI, System)):
        dynamics = MechanismSystem(as_dynamics(dynamics))
        m = dynamics.mechanism
        start = np.concatenate([single(m, q0, "q0"), np.zeros(m.nv) if v0 is None else rates(m, v0, "v0")])
    if not takes_state(inputs):
        names = plant_of(dynamics, times, 1).system.input_names
        middle = 0.5 * (times[1:] + times[:-1])
        rows = signal_rows(inputs, middle, names, "inputs", np.zeros(len(names)))

        def inputs(t: float, x: Array) -> Array:  # noqa: ARG001 - as of any law
            return np.asarray(rows[np.searchsorted(times[1:], t, side="right")])

    return checked(close_loop)(dynamics, inputs, start, times, **closing)
