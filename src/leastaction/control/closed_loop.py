"""A loop that is closed: a plant, readings that are noisy and late, an estimator and a controller.

At instant k the plant stands at ``x_k``. What is read of it, ``y_k = h(x_k) + v_k``, arrives after the delay. An
estimator makes a state of the readings that have arrived and carries it over the delay with the inputs given since;
without one the controller is given the reading itself. The input is held over the step, at whose end chance or a push
moves the plant.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.kalman import check_estimator
from leastaction.control.plants import Plant, plant_of
from leastaction.control.predictive import MPC
from leastaction.control.readings import Measured, Readings, Spread, Stated, covariance, covariance_of_states
from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, as_array, as_count, as_number, as_times, read_only
from leastaction.numerics.public import public
from leastaction.numerics.signals import StateLaw, takes_state
from leastaction.optimal.space import of_unit_length
from leastaction.optimal.system import System
from leastaction.systems.closed_loop import ClosedLoop

Disturbance = Spread | Callable[[float, Array], ArrayLike] | None
"""What moves the state at the end of each step: standard deviations as of noise, or a function of time and state."""

_MULTIPLE = 1e-6  # of a step by which a delay may be off a multiple


@public
def close_loop(
    plant: object,
    controller: MPC | StateLaw,
    x: Stated,
    t: ArrayLike,
    *,
    measure: Measured | None = None,
    noise: Spread = 0.0,
    delay: float = 0.0,
    estimator: Any = None,
    disturbance: Disturbance = None,
    substeps: int = 1,
    seed: int = 0,
) -> ClosedLoop:
    """Run a controller on a plant.

    Parameters
    ----------
    plant : MidpointVI, DiscreteSystem or ContinuousSystem
        What is steered: it need not be the controller's model. A `MidpointSystem` steps at the times given here, any
        other discrete system makes one of its own steps to each; what is in continuous time is integrated.
    controller : MPC or callable
        Or a law ``(t, x) -> (nu,)`` such as `Feedback`. It is given estimates, or readings without an estimator.
    x : array_like (nx,), State or mapping of str to float
        Where the plant begins; by name what is not given is zero.
    t : array_like (N+1,)
        When the controller is asked (s), the end included.
    measure : str, sequence of str, Quantity, callable or array_like, optional
        What is read, as of `KalmanFilter`. If left out what the estimator reads, and the whole state without one; of a
        mechanism in continuous time with momenta for velocities, where the model of estimator or controller has those.
    noise : float, array_like or mapping, optional
        Standard deviations of readings, or their covariance.
    delay : float, optional
        How late readings arrive (s): a multiple of the step. Before the first has arrived an estimator goes by what it
        begins with, and without one the controller is given the first.
    estimator : KalmanFilter, optional
        Or what has ``predict(u)``, ``correct(y)``, `x` and `system`.
    disturbance : float, array_like, mapping or callable, optional
        What is added to the plant's state at the end of each step: at random by standard deviations or a covariance,
        or a function ``(t, x) -> (ndx,)``. Constraints are kept.
    substeps : int, optional
        Steps of a `MidpointSystem` to each of the controller's.
    seed : int, optional
        Of what is drawn by chance: the same seed gives the same run.

    Returns
    -------
    ClosedLoop
        Up to where the plant or the controller had no next step, or Ctrl-C ended it; it says why.

    Raises
    ------
    ArgumentError
        Unknown names, wrong shapes, a delay that is no multiple of the step, or what is no plant or controller.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import JointForce, Mechanism, MidpointVI, tx
    >>> from leastaction.control import close_loop
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> run = close_loop(MidpointVI(slide), lambda t, x: -4.0 * x[:1] - 3.0 * x[1:], [1.0, 0.0], np.arange(101) * 0.1)
    >>> bool(abs(run["x"][-1]) < 1e-3)
    True
    """
    times = as_times(t)
    stood = plant_of(plant, times, as_count(substeps, "substeps", 1))
    late = _late(delay, times)
    ask = _asked(controller)
    if estimator is not None:
        check_estimator(estimator)
    readings, readable = _read_by(stood, measure, estimator, controller)
    drawn = as_count(seed, "seed", 0)
    rng, pushed = (np.random.default_rng([drawn, which]) for which in (1, 2))
    V = covariance(noise, readings.names, "noise", definite=False)
    names = stood.system.state_names
    root = None
    if disturbance is not None and not callable(disturbance):
        root = _root(covariance_of_states(disturbance, stood.system, "disturbance"))
    at = stood.system.state_given(x)
    space = stood.system.charts()
    if space is not None:
        space.check(at, "x")
    stood.system.check_start(at)
    N, noise_root = len(times) - 1, _root(V)
    states, read = [at], list[Array]()
    inputs, estimates, surprise, infos = list[Array](), list[Array](), list[float](), list[Any]()

    # Who is given readings for a state is given one: with rotations that noise has not lengthened.
    whole = measure is None and estimator is None

    def reading(k: int, state: Array) -> Array:
        found = readings(readable(state), k) + noise_root @ rng.standard_normal(readings.ny)
        return of_unit_length(space, found) if whole else found

    read.append(reading(0, at))

    def go(at: Array) -> str | None:
        """Close the loop, up to where it ends; return why, if early."""
        for k in range(N):
            now = float(times[k])
            said: Any = None
            try:
                if estimator is None:
                    seen_now = read[max(0, k - late)]
                else:
                    if k >= late:
                        if k > late:
                            estimator.predict(inputs[k - late - 1])
                        estimator.correct(read[k - late])
                    seen_now = _ahead(estimator, inputs[max(0, k - late) :], max(0, k - late))
                    estimates.append(seen_now)
                    surprise.append(float(getattr(estimator, "surprise", np.nan)))
                said = ask(now, seen_now)
                u = as_array(said, f"inputs({now:g}, x)", (stood.system.nu,), names=stood.system.input_names)
                if hasattr(controller, "info"):
                    infos.append(controller.info)
                after = stood.step(at, u, k)
            except LeastActionError as error:
                if k == 0 and isinstance(error, ArgumentError) and np.shape(said) != (stood.system.nu,):
                    raise  # what does not fit from the start is no end of a loop
                return f"the loop ended at t = {now:.6g} s: {error}"
            if disturbance is not None:
                if callable(disturbance):
                    off = as_array(
                        disturbance(float(times[k + 1]), read_only(after)), "disturbance(t, x)", (stood.system.ndx,)
                    )
                else:
                    assert root is not None
                    off = root @ pushed.standard_normal(len(root))
                if off.any():
                    after = stood.system.moved_start(after, off)
            if not np.isfinite(after).all():
                return f"the loop ended at t = {times[k + 1]:.6g} s: the plant's state is not finite"
            at = after
            states.append(at)
            inputs.append(u.copy())
            read.append(reading(k + 1, at))
        return None

    interrupted = False
    try:
        failure = go(at)
    except KeyboardInterrupt:
        interrupted, failure = True, "interrupted"
    # Where it was interrupted the last step may be there in part.
    done = min(len(inputs), len(states) - 1, len(read) - 1)
    if interrupted:
        failure = f"interrupted at t = {times[done]:.6g} s of {times[-1]:g} s"
    return ClosedLoop(
        read_only(times[: done + 1]),
        read_only(np.array(states[: done + 1])),
        read_only(np.array(inputs[:done]).reshape(done, stood.system.nu)),
        read_only(np.array(read[: done + 1])),
        read_only(np.array(estimates[:done])) if estimator is not None else None,
        read_only(np.array(surprise[:done])) if estimator is not None else None,
        tuple(infos),
        names,
        stood.system.input_names,
        failure,
        units_of(stood.system),
        tuple(readings.names),
        getattr(stood.system.told(), "mechanism", None),
        interrupted,
    )


def units_of(system: System) -> dict[str, str]:
    """Return the units of states and inputs by their names, where they are known."""
    names, units = (*system.state_names, *system.input_names), (*system.state_units, *system.input_units)
    return {name: unit for name, unit in zip(names, units, strict=True) if unit}


def _asked(controller: Any) -> Callable[[float, Array], Any]:
    """Return a controller as a law of time and state."""
    if not callable(controller) or not takes_state(controller):
        raise ArgumentError(
            f"controller: got {type(controller).__name__}, expected an MPC, or a function (t, x) of time and state "
            "such as a Feedback"
        )
    return controller


def _read_by(
    plant: Plant, measure: Measured | None, estimator: Any, controller: Any
) -> tuple[Readings, Callable[[Array], Array]]:
    """Return what is read, and how a state of the plant becomes the one of which that is read."""
    if measure is not None:
        return Readings(plant.system, measure), lambda state: state
    model = getattr(estimator, "system", None) or getattr(controller, "system", None)
    own = getattr(estimator, "readings", None)
    if own is not None and own.nx != plant.system.nx:
        raise ArgumentError(
            f"measure: got none, and the estimator reads states of {own.nx} numbers, of which the plant has "
            f"{plant.system.nx}; say what is read of the plant"
        )
    return own or Readings(plant.system, plant.system.state_names), plant.converts_for(model)


def _late(delay: float, times: Array) -> int:
    """Return a delay in steps."""
    seconds, steps = as_number(delay, "delay (s)", least=0.0), np.diff(times)
    if seconds == 0.0:
        return 0
    dt = float(steps[0])
    count = int(np.floor(seconds / dt + _MULTIPLE))
    if float(np.ptp(steps)) > _MULTIPLE * dt:
        raise ArgumentError("delay: got one with steps of different lengths, expected equal steps")
    if abs(seconds - count * dt) > _MULTIPLE * dt:
        raise ArgumentError(
            f"delay: got {seconds:g} s, which is no multiple of the step of {dt:g} s; expected "
            f"{count * dt:g} s or {(count + 1) * dt:g} s, or give times with a step that divides it"
        )
    return count


def _root(covariance: Array) -> Array:
    """Return a matrix whose square is a covariance."""
    values, vectors = np.linalg.eigh(covariance) if covariance.size else (np.zeros(0), covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _ahead(estimator: Any, inputs: list[Array], first: int) -> Array:
    """Return what the model says will have become of an estimate under the inputs that were given since."""
    x = np.asarray(estimator.x)
    system = getattr(estimator, "system", None)
    if system is None:
        return x
    for i, u in enumerate(inputs):
        x = np.asarray(system.f(x, u, min(first + i, system.N - 1)))
    return x
