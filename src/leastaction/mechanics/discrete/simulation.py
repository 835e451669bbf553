"""Simulation in steps of time: `simulate` is a method of `MidpointVI`, which is ``vi`` here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, CoarseStepWarning, RoundingWarning, StepError
from leastaction.mechanics.configuration.assembly import check_lengths
from leastaction.mechanics.discrete.balance import balance_of, tell
from leastaction.mechanics.discrete.feedback import MidpointLaw
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.outcome import quality_of, step_error
from leastaction.mechanics.discrete.prescribed import inputs_along, prescribed_rows
from leastaction.mechanics.discrete.refining import Controls, Refiner
from leastaction.mechanics.discrete.rounding import eaten
from leastaction.mechanics.discrete.trajectory import (
    SimulationStatus,
    State,
    Trajectory,
    check_state,
    state_of,
    trajectory_of,
    vector_of,
)
from leastaction.numerics.arrays import Array, as_array, as_choice, as_number, as_times, read_only
from leastaction.numerics.signals import Signal, StateLaw, signal_rows, takes_state
from leastaction.numerics.step_quality import StepQuality, coarsest
from leastaction.numerics.warn import warn

LawAt = Literal["start", "midpoint"]

_CHUNK = 2000  # steps from one call of `progress` to the next


def simulate(
    vi: Integrator,
    start: State,
    t: ArrayLike,
    *,
    inputs: Signal | StateLaw = None,
    rho: Signal = None,
    law_at: LawAt = "start",
    energy_tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Trajectory:
    """Simulate over given times, which need not be equidistant.

    Parameters
    ----------
    start : State
    t : array_like, shape (N+1,)
        Times (s), increasing, the first one that of the start.
    inputs : array_like (n_inputs,) or (N, n_inputs), or callable, optional
        Inputs: constant, one row a step, or a function of the time at the middle of a step, where they act: a motion
        whose rows are samples at the starts of its steps is of first order in dt, and of second with samples at their
        middles. Or a feedback
        ``(t, x)``, such as `Feedback`, of the time and the state ``x = [q; rho; p; v_rho]`` (see `law_at`).
        One input may be given as (N,), and all of them by name, ``{"push": 2.0, "lift": [...]}``. Zero if not given.
    rho : array_like (N+1, nrho) or (N, nrho), or callable, optional
        Kinematic variables at every instant (or at the ends of the steps), or a function of time. Of rotations that
        are quaternions these, in the order of `Mechanism.coordinates`, less than half a turn apart. By name too, as
        inputs. Unchanged if not given.
    law_at : {"start", "midpoint"}, optional
        Where in each step a feedback is evaluated: at its start, and held over it, as a digital controller does; or
        at its midpoint, where forces act (``q = (q1 + q2)/2``, ``v = (q2 - q1)/dt``, p = dL/dv). The closed loop is
        of first order with the former, of second with the latter, whose input is solved for with the step.
    energy_tolerance : float, optional
        What the length of a step may do to the energy (J). Where it does more, or where the step cannot be made,
        instants are added within it: a fast passage, a string that falls taut, a linkage near a dead point. The result
        then has more instants than `t`; its steps are like any, with all derivatives. Rows of `inputs` hold over all of
        their step, and rows of `rho` are joined by straight lines. A thousandth of the largest kinetic energy
        (``run.balance.scale``) keeps that of smooth motions, a tenth of this that of strings which fall taut often.
        None are added if it is not given; it does not go with a feedback.
    progress : callable, optional
        Called with the number of steps done and of all steps now and then.

    Returns
    -------
    Trajectory
        Up to the first step that failed, or to where Ctrl-C stopped it; its status says which, and whether energy and
        work balance.

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, times that do not increase, an unknown `law_at`, or an energy
        tolerance under a feedback.

    Warns
    -----
    CoarseStepWarning
        If the time step is so coarse somewhere that the solution is about to be lost; see `Trajectory.worst_step`.
    EnergyBalanceWarning
        If energy was lost or gained beside the work that was done; see `Trajectory.balance`.
    RoundingWarning
        If the motion is so far from the origin that rounding eats it.
    SingularityWarning
        If the motion comes near the singularity of a `ball` or `free` joint; once for every joint.
    """
    m = vi.mechanism
    check_state(start)
    times = as_times(t)
    if abs(times[0] - start.t) > 1e-9 * max(1.0, abs(start.t)):
        raise ArgumentError(f"t: the first time is {times[0]} s, but the start is at {start.t} s; they must agree")
    N = len(times) - 1
    middle = 0.5 * (times[1:] + times[:-1])
    rows = prescribed_rows(m, rho, times[1:], start.q)
    places = np.vstack([start.q[None, m.first_rho :], rows])
    if vi.reels:
        check_lengths(m, np.hstack([np.tile(start.q[: m.first_rho], (N, 1)), rows]), times[1:])
    law = inputs if takes_state(inputs) else None
    as_choice(law_at, "law_at", get_args(LawAt))
    forces = None if law is not None else cast(Signal, inputs)
    u = np.hstack([signal_rows(forces, middle, m.inputs, "inputs", np.zeros(m.n_inputs)), inputs_along(m, places)])
    first, refiner = u[0, : m.n_inputs].copy(), None
    if energy_tolerance is not None:
        most = as_number(energy_tolerance, "energy_tolerance", above=0.0)
        if law is not None:
            raise ArgumentError("energy_tolerance: got one and a feedback; it goes with inputs that are known before")
        controls = Controls(m, times, forces, rho, u, places)
        refiner = Refiner(vi, controls, most)
    run = _Run(vi, times, vector_of(m, start), u)
    status, message = run.go(law, law_at, refiner, progress)
    t, x, u, lam = run.made()
    passages = vi.watch.look(t, x[:, : m.nq])
    worst = coarsest(run.qualities)
    if worst is not None and worst.is_coarse and status is not SimulationStatus.STEP_FAILED:
        warn(str(worst), CoarseStepWarning)
    balance = balance_of(t, run.energies(t, x, u, lam))
    complaint = tell(balance)
    if complaint and status is SimulationStatus.COMPLETED:
        status, message = SimulationStatus.UNBALANCED, f"{message}, but {complaint}"
    failed = status is SimulationStatus.STEP_FAILED
    tried = t if len(t) > 1 else times[:2]  # the step that failed, if it was the first
    rounded = eaten(m, tried, x[:, : m.nq], first, balance.scale, failed=failed)
    if rounded and failed:
        message = f"the step at t = {t[-1]:.6g} s failed: {rounded}"
    elif rounded:
        warn(rounded, RoundingWarning)
        status, message = SimulationStatus.ROUNDED, f"{message}, but {rounded}"
    return trajectory_of(
        m,
        t,
        x,
        u,
        lam,
        status=status,
        message=message,
        rank_deficient=run.redundant,
        worst_step=worst,
        balance=balance,
        singularities=passages,
    )


class _Piece(NamedTuple):
    """Steps: their ends t (n,), controls, states at the ends, multipliers, and rows of energies, if there are any."""

    t: Array
    u: Array
    x: Array
    lam: Array
    energies: Array


class _Run:
    """A motion as it is made, piece by piece, between given instants and under given controls (N, n_inputs + nrho)."""

    def __init__(self, vi: Integrator, t: Array, start: Array, u: Array) -> None:
        self.vi, self.t, self.u = vi, t, u
        self.x = start  # at the last instant that was reached
        self.given = 0  # steps of those given that were made
        self.redundant = False
        self.qualities: list[StepQuality | None] = []
        nothing = np.empty((0, vi.mechanism.nc))
        self._pieces = [_Piece(t[:1], u[:0], start[None, :], nothing, np.empty((0, 5)))]

    def go(
        self, law: StateLaw | None, law_at: LawAt, refiner: Refiner | None, progress: Callable[[int, int], None] | None
    ) -> tuple[SimulationStatus, str]:
        """Make all steps, or as many as can be; return how that ended."""
        N = len(self.u)
        inside = MidpointLaw(self.vi, law) if law is not None and law_at == "midpoint" else None
        try:
            while self.given < N:
                if inside is not None:
                    self._keep(self._under(inside), 1)
                elif law is not None:
                    self._keep(self._after(law), 1)
                elif refiner is None or not self._refine(refiner):
                    count = 1 if refiner is not None else min(N - self.given, _CHUNK)
                    self._keep(self._rolled_out(count, energies=True), count)
                if progress is not None:
                    progress(self.given, N)
        except StepError as error:
            return SimulationStatus.STEP_FAILED, str(error)
        except KeyboardInterrupt:
            return SimulationStatus.INTERRUPTED, f"interrupted after {self.given} of {N} steps"
        return SimulationStatus.COMPLETED, f"completed {sum(len(piece.u) for piece in self._pieces)} steps"

    def made(self) -> tuple[Array, Array, Array, Array]:
        """Return times (n+1,), states (n+1, nx), controls and multipliers (n, ...) of what was made."""
        t, u, x, lam, _ = (np.concatenate(parts) for parts in zip(*self._pieces, strict=True))
        return t, x, u, lam

    def energies(self, t: Array, x: Array, u: Array, lam: Array) -> Array:
        """Return the rows of energies (n, 5) of what was made, which is given."""
        if any(len(piece.energies) < len(piece.u) for piece in self._pieces):
            return np.asarray(self.vi.core.energies(t, x, u, lam))
        rows, k = np.concatenate([piece.energies for piece in self._pieces]), 0
        for piece in self._pieces[1:-1]:  # the work from the last step of each piece to the first of the next
            k += len(piece.u)
            steps, instants = slice(k - 1, k + 1), slice(k - 1, k + 2)
            rows[k] = self.vi.core.energies(t[instants], x[instants], u[steps], lam[steps])[1]
        return rows

    def _refine(self, refiner: Refiner) -> bool:
        """Make the next of the given steps in parts; False where one of them cannot be made."""
        found = refiner.make(self.given, self.x)
        if not found:
            return False
        t, u, x, lam, qualities, redundant = zip(*found, strict=True)
        self._add(_Piece(np.array(t), np.array(u), np.array(x), np.array(lam), np.empty((0, 5))), 1)
        self.qualities += qualities
        self.redundant = self.redundant or any(redundant)
        return True

    def _under(self, law: MidpointLaw) -> _core.RollOut:
        """Make a step under a law at its midpoint."""
        k, n = self.given, self.vi.mechanism.n_inputs
        out, self.u[k, :n] = law.step(self.t[k : k + 2], self.x, self.u[k, n:])
        return out

    def _after(self, law: StateLaw) -> _core.RollOut:
        """Make a step with what a law gives at its start."""
        k, m = self.given, self.vi.mechanism
        at = float(self.t[k])
        given = law(at, read_only(self.x))
        self.u[k, : m.n_inputs] = as_array(given, f"inputs({at:g}, x)", (m.n_inputs,), names=m.inputs)
        return self._rolled_out(1)

    def _rolled_out(self, count: int, *, energies: bool = False) -> _core.RollOut:
        """Make some of the given steps, with the inputs that there are."""
        k, stop = self.given, self.given + count
        return self.vi.core.roll_out(
            self.t[k : stop + 1], self.x.copy(), None, self.u[k:stop], None, energies=energies, interruptible=energies
        )

    def _keep(self, out: _core.RollOut, wanted: int) -> None:
        """Keep what was made of so many of the given steps; raise where that were fewer."""
        k, n, m = self.given, out.steps, self.vi.mechanism
        self.qualities.append(quality_of(m, out, self.t[k:]))
        self.redundant = self.redundant or out.rank_deficient
        if n:
            t, u = self.t[k + 1 : k + n + 1], self.u[k : k + n]
            self._add(_Piece(t, u, out.x[1 : n + 1], out.lam[:n], out.energies[:n]), n)
        if out.interrupted:
            raise KeyboardInterrupt
        if n < wanted:
            last = state_of(m, float(self.t[self.given]), self.x)
            raise step_error(m, out, last, self.u[self.given, m.n_inputs :])

    def _add(self, piece: _Piece, given: int) -> None:
        """Add a piece that leads over so many of the given steps."""
        self._pieces.append(piece)
        self.x = np.ascontiguousarray(piece.x[-1])
        self.given += given
