"""The marionette follows a reference motion: gentle ones directly, others by dynamic embedding."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leastaction import Mechanism, MidpointVI, QuadraticCost, tx
from leastaction.errors import ArgumentError, ProjectionError, ResultFileError
from leastaction.io import Motion
from leastaction.io.results import save_record
from leastaction.mechanics import JointForce
from leastaction.models.marionette import JOINT_LIMITS, PLANE_HEIGHT, STRINGS, UNHELD, marionette
from leastaction.numerics.arrays import Array
from leastaction.optimal import IterationRecord, OptimizationResult, Status
from leastaction.systems import MidpointSystem, PulledSystem
from leastaction_marionette import walk_in_place
from leastaction_marionette.choices import Strings
from leastaction_marionette.command.summary import run_summary
from leastaction_marionette.tracking import (
    FORCED,
    GENTLE,
    PuppetLimits,
    TrackingCost,
    TrackingRun,
    TrackingSearch,
    TrackingWeights,
    files,
    load_run,
    load_unfinished,
    motors,
    pace,
    plan,
    save_run,
    save_search,
    settle,
    track,
    tracker,
)
from leastaction_marionette.tracking import run as run_module
from leastaction_marionette.tracking.found import Effort
from leastaction_marionette.tracking.poses import at_rest
from leastaction_marionette.tracking.problem import TrackingProblem
from marionette.motions import leap

PUPPET = marionette()


def check_is_a_motion_of_the_puppet(run: TrackingRun) -> None:
    motion, integrator = run.trajectory, MidpointVI(PUPPET)
    again = integrator.simulate(
        integrator.start(motion.q[0], p=motion.p[0], t=float(motion.t[0])),
        motion.t,
        rho=run.result.u,
    )
    np.testing.assert_allclose(again.q, motion.q, atol=1e-8)
    assert np.abs(PUPPET.constraint_values(motion.q)).max() < 1e-11


def joint_errors(run: TrackingRun) -> dict[str, float]:
    """Return the rms tracking error of every joint angle by name, in degrees."""
    errors = run.errors
    columns = zip(errors.names, errors.units, errors.rms, strict=True)
    return {name: float(rms) for name, unit, rms in columns if unit == "deg"}


def test_a_gentle_motion_is_followed_directly() -> None:
    # In 16 iterations of the 100 that it has for that; with the whole stride in 98, or 100 in another core.
    run = track(PUPPET, walk_in_place(1.0, 0.02, stride=0.2))
    assert not run.embedded
    assert run.result.status is Status.CONVERGED
    assert max(joint_errors(run).values()) < 4.0
    assert run.tension.sum(axis=1).mean() == pytest.approx(9.8 * 18.75, rel=0.1)
    check_is_a_motion_of_the_puppet(run)


def test_a_motion_that_needs_motors_at_first() -> None:
    said: list[str] = []
    run = track(PUPPET, leap(), progress=said.append, max_iterations=30)
    assert run.embedded
    assert said[0].startswith("motors at price 0.001")
    assert any("without motors" in each for each in said)
    # Every string pulls, and no hinge is overstretched.
    assert run.tension.min() >= 0.5 - 1e-6
    for name, (least, most) in JOINT_LIMITS.items():
        assert least - 1e-4 <= run.trajectory[name].min() <= run.trajectory[name].max() <= most + 1e-4
    held = [rms for name, rms in joint_errors(run).items() if name not in UNHELD]
    assert max(held) < 15.0
    assert abs(run.trajectory.q[-1, 1] - 0.5) < 0.1
    # The motors are gone: the strings alone make it.
    assert run.result.u.shape[1] == PUPPET.nrho
    check_is_a_motion_of_the_puppet(run)


def test_ctrl_c_ends_the_search_for_a_first_trajectory(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    real = motors.optimize

    def interrupted(*args: object, **kwargs: object) -> object:
        calls.append(1)
        result = real(*args, **kwargs)  # type: ignore[arg-type]
        return replace(result, status=Status.INTERRUPTED) if len(calls) == 2 else result

    monkeypatch.setattr(motors, "optimize", interrupted)
    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, leap())
    assert len(calls) == 2


def test_a_first_motion_that_cannot_be_followed_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run begins with a puppet that hangs; its strings pull."""

    def wild(wanted: tracker.Tracker, **_: object) -> tracker.Tracker:
        noise = np.random.default_rng(0).normal(scale=1e3, size=wanted.plan.x_reference.shape)
        return replace(wanted, start=(wanted.plan.x_reference + noise, wanted.plan.u_reference + 1e6))

    monkeypatch.setattr(run_module, "with_motors", wild)
    said: list[str] = []
    run = track(PUPPET, leap(), planned=True, max_iterations=2, progress=said.append)
    assert "begins with a puppet that is held still" in said[0]
    assert run.tension.min() >= 0.0


class Killed(Exception):
    """The program ends without a word."""


def test_a_search_for_a_first_trajectory_goes_on_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed with motors, ended by Ctrl-C without them, each time gone on with from its file."""
    monkeypatch.setattr(motors, "PRICES", (1e-2, 1.0))
    monkeypatch.setattr(motors, "_ITERATIONS", 3)
    monkeypatch.setattr(motors, "_LAST_ITERATIONS", 4)
    monkeypatch.setattr(files, "PRICES", motors.PRICES)
    options = {"max_iterations": 2, "checkpoint_seconds": 0.0}
    said: list[str] = []
    whole = track(PUPPET, leap(), progress=said.append, **options)
    path = tmp_path / "search.npz"

    def ended_at(stage: int, how: type[BaseException]) -> Callable[[object], None]:
        def checkpoint(found: object) -> None:
            assert isinstance(found, TrackingSearch)
            save_search(path, found)
            if found.stage == stage:
                raise how

        return checkpoint

    with pytest.raises(Killed):
        track(PUPPET, leap(), checkpoint=ended_at(1, Killed), **options)
    search = load_unfinished(path)
    assert isinstance(search, TrackingSearch)
    assert search.stage == 1
    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, search.motion, resume=search, checkpoint=ended_at(2, KeyboardInterrupt), **options)
    search = load_unfinished(path)
    assert search.stage == 2
    again: list[str] = []
    run = track(PUPPET, search.motion, resume=search, progress=again.append, **options)
    assert again == said[2:]
    assert run.embedded
    np.testing.assert_array_equal(run.result.x, whole.result.x)
    np.testing.assert_array_equal(run.result.K, whole.result.K)
    with pytest.raises(ResultFileError, match="holds a TrackingSearch, expected a TrackingRun"):
        load_run(path)


def test_derivatives_of_the_tracking_cost() -> None:
    rng = np.random.default_rng(3)
    N, dt = 4, 0.1
    moved = Mechanism([tx("a", mass=1.0), tx("b", kinematic=True), tx("c", kinematic=True)], [JointForce("a", "push")])
    system = MidpointSystem(MidpointVI(moved), dt * np.arange(N + 1))
    nx, nu = system.nx, system.nu
    x_reference, u_reference = rng.normal(size=(N + 1, nx)), rng.normal(size=(N, nu))
    settings = {"Q": rng.uniform(size=nx), "R": rng.uniform(0.5, 1.0, size=nu)}
    cost = TrackingCost(x_reference, u_reference, **settings, system=system, acceleration=0.3)
    x, u = rng.normal(size=(N + 1, nx)), rng.normal(size=(N, nu))
    a = ((u[:, 1:3] - x[:-1, 1:3]) / dt - x[:-1, 4:6]) / dt
    plain = QuadraticCost(x_reference, u_reference, **settings).value(x, u)
    assert cost.value(x, u) == pytest.approx(plain + 0.15 * np.sum(a**2), rel=1e-12)
    gradient, hessian = cost.gradient(x, u), cost.hessian(x, u)
    assert hessian.S is not None
    dx, du = rng.normal(size=x.shape), rng.normal(size=u.shape)
    # Quadratic, so central differences are exact at any step.
    slope = (cost.value(x + dx, u + du) - cost.value(x - dx, u - du)) / 2.0
    expected = np.sum(gradient.q * dx[:-1]) + np.sum(gradient.r * du) + gradient.q_final @ dx[-1]
    assert slope == pytest.approx(expected, rel=1e-10)
    curvature = cost.value(x + dx, u + du) - 2.0 * cost.value(x, u) + cost.value(x - dx, u - du)
    final = dx[-1] @ (hessian.Q_final * dx[-1])
    stages = sum(
        a @ hessian.Q @ a + 2.0 * a @ hessian.S @ b + b @ hessian.R @ b for a, b in zip(dx[:-1], du, strict=True)
    )
    assert curvature == pytest.approx(stages + final, rel=1e-9)


def test_bad_input() -> None:
    walk = walk_in_place(0.5, 0.02)
    with pytest.raises(ArgumentError, match="tension is -1"):
        TrackingWeights(tension=-1.0)
    with pytest.raises(ArgumentError, match="string is 0"):
        replace(GENTLE, string=0.0)
    kept = tuple(n for n in walk.names if n != "lknee_rx")
    cut = Motion(kept, walk.t, walk.columns(kept), "cut")
    with pytest.raises(ArgumentError, match="no column for 'lknee_rx'"):
        track(PUPPET, cut)
    uneven = Motion(walk.names, walk.t**1.1, walk.q, "uneven")
    with pytest.raises(ArgumentError, match="equal steps"):
        track(PUPPET, uneven)
    with pytest.raises(ArgumentError, match=r"got 2 instants, expected 3 to \d+\. Take a shorter time step, or more"):
        track(PUPPET, walk_in_place(0.02, 0.02))
    with pytest.raises(ArgumentError, match="lacks the string variables"):
        track(Mechanism([tx("cart", mass=1.0)]), walk)


def test_a_plan_by_tensions_is_a_motion_by_lengths(tmp_path: Path) -> None:
    """What was planned by tensions and what strings of the lengths found do are the same motion and the same pulls."""
    run = track(PUPPET, leap(0.3), max_iterations=20)
    nd, strings = PUPPET.nd, len(STRINGS)
    np.testing.assert_allclose(run.result.x[:, :nd], run.plan.x[:, :nd], atol=1e-9)
    np.testing.assert_allclose(run.tension, run.plan.u[:, :strings], atol=1e-5)
    check_is_a_motion_of_the_puppet(run)
    again = load_run(save_run(tmp_path / "run.npz", run))
    np.testing.assert_array_equal(again.plan.u, run.plan.u)
    np.testing.assert_array_equal(again.tension, run.tension)


def test_limits_of_the_upper_ends_are_kept_to() -> None:
    limits = PuppetLimits(speed=0.8, tension=1.0)
    free = track(PUPPET, leap(), max_iterations=40, limits=PuppetLimits(speed=np.inf))
    run = track(PUPPET, leap(), max_iterations=40, limits=limits)
    ends = [name for s in STRINGS for name in (s.x, s.y)]

    def fastest(run: TrackingRun) -> float:
        dt = float(run.trajectory.t[1])
        return max(float(np.abs(np.diff(run.trajectory[name])).max()) / dt for name in ends)

    assert fastest(free) > 1.0
    assert fastest(run) < 0.8 * (1.0 + 1e-4)
    assert run.tension.min() > 1.0 - 1e-4


@pytest.mark.parametrize("strings", [6, "cross"])
def test_no_string_pulls_more_than_it_bears(strings: Strings) -> None:
    """A leap pulls by more than twice as much where it may."""
    puppet = marionette(strings=strings)
    free = track(puppet, leap(0.3), planned=True)
    run = track(puppet, leap(0.3), planned=True, limits=PuppetLimits(strength=0.5 * float(free.tension.max())))
    for each in (free, run):
        assert each.result.success
        assert each.tension.min() >= 0.5 * (1.0 - 1e-3)
    assert 0.95 * run.limits.strength < run.tension.max() <= run.limits.strength * (1.0 + 1e-3)
    assert strings == "cross" or run.off > free.off  # on a bar it is another minimum


def test_a_hanging_puppet_keeps_to_what_strings_bear() -> None:
    """A walk that the puppet all but makes by itself is not planned at all before a limit is broken."""
    walk = walk_in_place(2.0, 0.01)
    small = replace(walk, q=walk.q[0] + 0.2 * (walk.q - walk.q[0]))  # so that strings pull by themselves
    free = track(PUPPET, small)
    assert not free.embedded
    run = track(PUPPET, small, limits=PuppetLimits(strength=0.98 * float(free.tension.max())))
    assert run.result.success
    assert run.tension.max() <= run.limits.strength * (1.0 + 1e-6)


def test_what_strings_bear_holds_wherever_a_plan_begins() -> None:
    """The tensions at rest, a pose that is held, a roll-out that is clipped, and what motors begin with."""
    limits = PuppetLimits(strength=60.0)
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, leap(0.3), FORCED, PuppetLimits()))
    assert wanted.tension.max() > 70.0
    strings = len(STRINGS)
    assert at_rest(wanted)[1][:, :strings].max() > 65.0
    held = plan.TrackingPlan(TrackingProblem(PUPPET, leap(0.3), FORCED, limits))
    for tension in (held.tension, at_rest(held)[1][:, :strings]):
        assert tension.min() >= 0.5 - 1e-9
        assert tension.max() <= 60.0 + 1e-9
    u = held.u_reference.copy()
    u[::2, :strings], u[1::2, :strings] = 100.0, 0.0
    none = np.zeros((held.system.N, held.system.nu, held.system.nx))
    for off in (0.0, 0.02):
        pulls = held.clipped(held.x_reference, u, none, off)[1][:, :strings]
        by = off * held.tension.mean()
        np.testing.assert_allclose(pulls[:2], np.repeat([[60.0 - by], [0.5 + by]], strings, axis=1))
    assert motors.driven(held)[1][:, :strings].max() < 60.0 - 1.0


@pytest.mark.parametrize(
    ("tension", "share", "kept"),
    [
        ([0.5, 9.0], 0.0, True),
        ([0.49, 9.0], 0.0, False),
        ([0.5, 9.1], 0.0, False),
        ([0.49, 9.1], 0.05, True),
        ([0.4, 9.0], 0.05, False),
        ([0.5, 9.9], 0.05, False),
    ],
)
def test_tensions_keep_to_both_limits(tension: list[float], share: float, kept: bool) -> None:
    assert PuppetLimits(strength=9.0).keep(np.array(tension), share) == kept


def test_strings_that_do_not_bear_the_puppet_are_said_to_be_weak() -> None:
    with pytest.raises(ArgumentError, match=r"strength is 5 N, and 6 strings of that do not carry .* weighs \d+ N"):
        track(PUPPET, leap(0.2), limits=PuppetLimits(strength=5.0), planned=True)
    with pytest.raises(ArgumentError, match=r"strength is 0\.4, expected more than the least tension, 0\.5"):
        PuppetLimits(strength=0.4)


def found_with_motors(wanted: plan.TrackingPlan, said: list[str]) -> tuple[Array, Effort]:
    """Return what motors lead to from the beginning of a search for a leap, and the effort."""
    begun = tracker.Tracker(
        mechanism=PUPPET,
        motion=leap(),
        weights=None,
        limits=wanted.limits,
        follow="joints",
        method="auto",
        tolerance=None,
        callback=None,
        say=said.append,
        kept=tracker.Checkpoints(None, np.inf),
        threads=0,
        left=1,
        plan=wanted,
    )
    found = motors.with_motors(begun)
    assert isinstance(found.start, tuple)
    return found.start[0], found.effort


def test_a_motion_that_motors_cannot_make_begins_with_a_puppet_that_is_held_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, leap(), FORCED, PuppetLimits()))
    optimize, begun = motors.optimize, list[Array]()

    def without(system: PulledSystem, cost: TrackingCost, **options: Any) -> OptimizationResult:
        if system is wanted.by_motors:
            raise ProjectionError("lost")
        begun.append(options["initial"][0])
        return optimize(system, cost, **options)

    monkeypatch.setattr(motors, "optimize", without)
    said: list[str] = []
    x, effort = found_with_motors(wanted, said)
    assert said[0].endswith("it begins with a puppet that is held still")
    assert np.ptp(begun[0], axis=0).max() == 0.0
    assert np.ptp(x, axis=0).max() > 0.1
    assert effort.optimisations == 1


def test_tensions_that_no_pose_has_are_said_to_be_too_large() -> None:
    """By their name, and not by the first step that fails."""
    with pytest.raises(ArgumentError, match=r"a pose at rest is found in which all of them pull\. Lower the least"):
        track(PUPPET, leap(0.2), limits=PuppetLimits(tension=1e9), planned=True)


@pytest.mark.parametrize("how", ["stuck", "creeps", "is seen to creep"])
def test_where_a_search_is_stuck_or_creeps_it_begins_with_a_puppet_that_is_held_still(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimize, begun = tracker.optimize, list[Any]()

    def stuck_at_first(*problem: Any, **options: Any) -> OptimizationResult:
        begun.append(options["initial"])
        if len(begun) > (2 if how == "stuck" else 1) or how == "is seen to creep":
            return optimize(*problem, **options)
        found = optimize(*problem, **options | {"max_iterations": 0})
        return replace(found, status=Status.LINE_SEARCH_FAILED if how == "stuck" else Status.ITERATION_LIMIT)

    monkeypatch.setattr(tracker, "optimize", stuck_at_first)
    if how == "is seen to creep":
        monkeypatch.setattr(tracker.Pace, "creeps", lambda *_: len(begun) == 1)
    said: list[str] = []
    run = track(PUPPET, leap(0.3), planned=True, progress=said.append, max_iterations=60)
    assert any("held still" in each for each in said)
    assert np.ptp(begun[-1][0], axis=0).max() == 0.0
    assert run.result.success
    assert run.tension.min() >= 0.5 - 1e-6


@pytest.mark.parametrize("goes_on", [True, False])
def test_what_was_left_behind_and_is_nearer_is_gone_on_with(goes_on: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where what is found from a puppet at rest is dearer, or nothing is found."""
    optimize, begun = tracker.optimize, list[tuple[Any, Any]]()

    def creeping(*problem: Any, **options: Any) -> OptimizationResult:
        begun.append((options["initial"], options["resume"]))
        if len(begun) in (2, 3) and not goes_on:
            raise ProjectionError("nowhere")
        if len(begun) == 1:
            return replace(optimize(*problem, **options | {"max_iterations": 1}), status=Status.ITERATION_LIMIT)
        found = optimize(*problem, **options)
        return replace(found, cost=10.0 * found.cost) if len(begun) == 2 else found

    monkeypatch.setattr(tracker, "optimize", creeping)
    run = track(PUPPET, leap(0.3), planned=True, max_iterations=60)
    assert run.result.success == goes_on
    if goes_on:
        assert begun[2][1] is not None
    else:
        assert run.result.status is Status.ITERATION_LIMIT
    assert run.tension.min() >= 0.0


def creeping_from(
    begin: int, *, share: float = 1.0, fall: float = 1e-4, mu: Callable[[int], float] = lambda _: 1.0
) -> int | None:
    """Return the iteration at which a search is seen to creep, or None.

    ``begin``: from which on it expects ``share`` times as much from iteration to iteration, and gains ``fall`` of its
    cost in each. ``mu``: its barrier.
    """
    its = pace.Pace()
    for k in range(121):
        barrier = SimpleNamespace(limits=SimpleNamespace(mu=mu(k)))
        record = SimpleNamespace(
            iteration=k,
            cost=100.0 * (1.0 - fall) ** k,
            expected_decrease=share ** max(k - begin, 0) * 0.5 ** min(k, begin),
            snapshot=lambda barrier=barrier: barrier,
        )
        if its.creeps(record):  # type: ignore[arg-type]
            return k
    return None


def test_a_search_creeps_that_expects_as_much_from_each_iteration_as_long_before_and_gains_little() -> None:
    assert creeping_from(20) == creeping_from(5, share=1.01) == 60
    assert creeping_from(50) == 80
    assert creeping_from(0, share=0.95) is None  # it converges
    assert creeping_from(0, fall=1e-3) is None  # it gains 2 % in 20 iterations
    assert creeping_from(0, mu=lambda k: 0.1 ** (k // 15)) is None  # it goes on to other barriers


def test_a_search_that_only_leads_to_the_next_ends_where_its_cost_hardly_changes() -> None:
    def ended(fall: float) -> int | None:
        its = pace.Pace(hardly=0.002)
        for k in range(59):
            cost = 100.0 * (1.0 - (fall if k > 12 else 0.1)) ** k
            now = SimpleNamespace(limits=None)
            record = SimpleNamespace(iteration=k, cost=cost, expected_decrease=1.0, snapshot=lambda now=now: now)
            if its.creeps(record):  # type: ignore[arg-type]
                return k
        return None

    assert ended(1e-4) == 23  # ten iterations after the last large step
    assert ended(1e-3) is None


def test_a_search_is_there_where_it_expects_little_at_the_last_barrier() -> None:
    def there(expected: list[float], mu: float = 1.0) -> bool:
        its = pace.Pace()
        limits = SimpleNamespace(mu=mu, barrier=SimpleNamespace(last_mu=1.0))
        for k, value in enumerate(expected):
            now = SimpleNamespace(limits=limits)
            record = SimpleNamespace(iteration=k, cost=100.0, expected_decrease=value, snapshot=lambda now=now: now)
            its.creeps(record)  # type: ignore[arg-type]
        return its.is_there(record, 1e-2)  # type: ignore[arg-type]

    assert there([np.nan, 5.0, *[0.09] * 5])
    assert not there([0.09] * 4)  # too few
    assert not there([0.09, 0.2, 0.09, 0.09, 0.09])
    assert not there([0.09] * 5, mu=2.0)


def test_a_puppet_that_hangs_and_creeps_is_planned_by_tensions(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what is left of the iterations, from a start of its own; one that converges in time is not."""
    motion = walk_in_place(0.5, 0.02)
    assert not track(PUPPET, motion, max_iterations=60).embedded
    monkeypatch.setattr(run_module, "PATIENCE", 2)
    said: list[str] = []
    iterations: list[int] = []

    def count(record: IterationRecord) -> None:
        iterations.append(record.iteration)

    run = track(PUPPET, motion, max_iterations=60, progress=said.append, callback=count)
    assert said[0] == "a hanging puppet finds no way: a first trajectory is sought with motors"
    assert iterations[:3] == [0, 1, 2]
    assert run.embedded
    assert run.result.success
    assert run.result.iterations <= 58
    assert run.tension.min() >= 0.5 - 1e-6


def test_limits_that_help_leads_beyond_are_stated_when_it_is_taken_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without them the motion would go on beyond, and have to be pulled back in an optimisation of its own."""
    stated = []
    optimize = motors.optimize

    def seen(system: PulledSystem, cost: TrackingCost, **options: Any) -> OptimizationResult:
        limited = {limit.of for limit in options["limits"]}
        stated.append((system.integrator.mechanism.n_inputs, "state" in limited))
        return optimize(system, cost, **options)

    monkeypatch.setattr(motors, "optimize", seen)
    limits = PuppetLimits(speed=0.8)
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, leap(), FORCED, limits))
    x, _ = found_with_motors(wanted, [])
    released = [speed for inputs, speed in stated if inputs == len(STRINGS)]
    assert released == [True]
    assert not any(speed for inputs, speed in stated if inputs > len(STRINGS))
    speeds = np.diff(x[:, PUPPET.nd : wanted.mechanism.nq], axis=0) / wanted.dt
    assert np.abs(speeds).max() < 0.8 * 1.01


def test_nine_strings_hold_the_shins(tmp_path: Path) -> None:
    nine = marionette(strings=9)
    run = track(nine, walk_in_place(0.5, 0.02), max_iterations=30)
    assert run.tension.shape == (25, 9)
    assert run.tension.min() >= 0.0
    assert load_run(save_run(tmp_path / "nine.npz", run)).mechanism.constraints == nine.constraints
    with pytest.raises(ArgumentError, match="expected 6, 7, 8, 9, 11 strings"):
        marionette(strings=10)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="tension is -1"):
        PuppetLimits(tension=-1.0)
    with pytest.raises(ArgumentError, match="speed is 0"):
        PuppetLimits(speed=0.0)
    with pytest.raises(ArgumentError, match="expected the least first"):
        PuppetLimits(joints={"lknee_rx": (0.0, -1.0)})


def test_where_a_motion_with_longer_steps_is_no_start_it_begins_with_a_puppet_that_hangs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def wild(self: plan.TrackingPlan, *_: Any) -> tuple[np.ndarray, np.ndarray]:
        return 1e3 * self.x_reference, 1e3 * self.u_reference

    monkeypatch.setattr("leastaction_marionette.tracking.tracker._FEW", 10)
    monkeypatch.setattr(plan.TrackingPlan, "finer", wild)
    said: list[str] = []
    run = track(PUPPET, leap(0.3), max_iterations=20, progress=said.append)
    assert any("begins with a puppet that is held still" in line for line in said)
    assert run.tension.min() >= 0.0


def test_motors_can_make_any_motion() -> None:
    """The search begins with the wanted motion itself, however wild, and with the motors that make it."""
    motion = leap(0.4)
    wild = replace(motion, q=motion.q + 0.5 * np.sin(40.0 * motion.t)[:, None])
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, wild, FORCED, PuppetLimits()))
    m = wanted.mechanism
    x, u = motors.driven(wanted)
    helpers = [JointForce(name, f"motor of {name}") for name in m.dynamic]
    system = PulledSystem(MidpointVI(m.with_elements(helpers)), wanted.t, at_instants=m.inputs)
    reached = np.array([system.f(x[k], u[k], k) for k in range(system.N)])
    np.testing.assert_allclose(reached, x[1:], atol=1e-10)
    np.testing.assert_allclose(x[6:, : m.nd], wanted.x_reference[6:, : m.nd], atol=1e-12)


def test_whatever_was_found_ends_with_strings_that_pull() -> None:
    """Also where an optimisation left numbers that are none, or a motion that cannot be followed."""
    run = track(PUPPET, leap(0.3), max_iterations=1)
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, run.motion, FORCED, PuppetLimits()))
    strings = len(STRINGS)
    pushing, lost = run.plan.u.copy(), np.full_like(run.plan.u, np.nan)
    pushing[5:9, :strings] -= 30.0
    for u in (pushing, lost):
        kept = wanted.pulling(replace(run.plan, u=u))
        assert kept.u[:, :strings].min() >= 0.5
        assert np.isfinite(kept.x).all()
        for k in (0, 7, wanted.system.N - 1):
            np.testing.assert_array_equal(wanted.system.f(kept.x[k], kept.u[k], k), kept.x[k + 1])


def test_a_motion_that_pulls_a_little_less_than_it_should_is_no_other_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no roll-out near it holds; and what stands for a motion that pushes never says that it converged."""
    run = track(PUPPET, leap(0.3))
    assert run.plan.success
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, run.motion, FORCED, PuppetLimits()))
    clipped, hung = plan.TrackingPlan.clipped, wanted.hung()
    monkeypatch.setattr(plan.TrackingPlan, "clipped", lambda _, x, u, *_rest: (x[:3], u[:2]))
    monkeypatch.setattr(plan.TrackingPlan, "hung", lambda _: hung)
    less, pushing = run.plan.u.copy(), run.plan.u.copy()
    less[5, 0], pushing[5, 0] = 0.48, -0.1
    assert wanted.pulling(replace(run.plan, u=less)).success
    np.testing.assert_array_equal(wanted.pulling(replace(run.plan, u=less)).u, less)
    still = wanted.pulling(replace(run.plan, u=pushing))
    np.testing.assert_array_equal(still.x, hung[0])
    assert not still.success
    assert "hangs still" in still.message
    # A roll-out that costs much more is another motion too.
    monkeypatch.setattr(plan.TrackingPlan, "clipped", lambda *_: hung)
    np.testing.assert_array_equal(wanted.pulling(replace(run.plan, u=less)).u, less)
    monkeypatch.setattr(plan.TrackingPlan, "clipped", clipped)
    assert wanted.pulling(replace(run.plan, u=less)).u[:, : len(STRINGS)].min() >= 0.5


def test_rods_that_go_another_way_do_not_push(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where strings lose their grip, a roll-out by lengths may snap through: the motion stays what was planned."""
    run = track(PUPPET, leap(0.3))
    wanted = plan.TrackingPlan(TrackingProblem(PUPPET, run.motion, FORCED, PuppetLimits()))
    rollout = wanted.problem.system.rollout

    def snapped(*arguments: Any) -> object:
        done = rollout(*arguments)
        return replace(done, x=done.x - 1e-3)

    monkeypatch.setattr(wanted.problem.system, "rollout", snapped)
    made = settle.by_lengths(wanted, run.plan)
    np.testing.assert_allclose(made.x, run.result.x, atol=1e-7)


@pytest.mark.parametrize("iterations", [0, 1])
def test_no_string_pushes_where_a_hanging_run_is_cut_short(iterations: int, tmp_path: Path) -> None:
    """Its strings push until their tensions are limited, which it does not live to see."""
    run = track(PUPPET, walk_in_place(1.0, 0.02), max_iterations=iterations)
    assert run.result.status is Status.ITERATION_LIMIT
    assert run.tension.min() >= 0.5 - 1e-6
    check_is_a_motion_of_the_puppet(run)
    stopped = track(PUPPET, walk_in_place(1.0, 0.02), callback=lambda record: True)
    assert stopped.result.status is Status.STOPPED_BY_CALLBACK
    assert stopped.tension.min() >= 0.5 - 1e-6
    # It is gone on with as a plan.
    again = track(PUPPET, run.motion, resume=load_run(save_run(tmp_path / "run.npz", run)), max_iterations=3)
    assert again.result.iterations == iterations + 3
    assert again.tension.min() >= 0.5 - 1e-6


def test_a_run_that_is_stuck_goes_on_from_inside_of_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    real, starts = tracker.optimize, []

    def stuck(*args: object, **kwargs: object) -> object:
        starts.append(kwargs["initial"])
        if len(starts) > 1:
            return real(*args, **kwargs)  # type: ignore[arg-type]
        result = real(*args, **{**kwargs, "max_iterations": 2})  # type: ignore[arg-type]
        return replace(result, status=Status.LINE_SEARCH_FAILED)

    monkeypatch.setattr(tracker, "optimize", stuck)
    run = track(PUPPET, leap(0.3))
    assert len(starts) > 1
    assert starts[1][1][:, : len(STRINGS)].min() >= 0.5 * (1.0 - 1e-9)
    assert run.result.success


def test_a_wrong_option_is_no_wild_motion() -> None:
    said: list[str] = []
    with pytest.raises(ArgumentError, match="max_iterations"):
        track(PUPPET, leap(0.1), planned=True, max_iterations=-1, progress=said.append)
    assert "hangs still" not in " ".join(said)


def test_a_run_of_a_version_that_stated_fewer_limits_goes_on_with_all() -> None:
    run = track(PUPPET, leap(0.2), max_iterations=2)
    report = run.plan.limits
    assert report is not None
    fewer = replace(run.plan, limits=replace(report, sides=report.sides[:8]))
    again = track(PUPPET, run.motion, resume=replace(run, plan=fewer))
    assert again.result.success
    assert again.plan.limits is not None
    assert again.plan.limits.labels == report.labels


def test_limits_are_kept(tmp_path: Path) -> None:
    run = track(PUPPET, leap(0.2), max_iterations=2, limits=PuppetLimits(speed=0.5))
    path = save_run(tmp_path / "run.npz", run)
    assert load_run(path).limits == PuppetLimits(speed=0.5)
    save_run(path, replace(run, limits=PuppetLimits(speed=np.inf)))
    assert load_run(path).limits == PuppetLimits(speed=np.inf)
    save_record(path, replace(run, mechanism=marionette(strings=9)))
    with pytest.raises(ResultFileError, match=r"contradicts itself|is damaged"):
        load_run(path)


def test_who_climbs_is_followed_as_high_as_strings_go() -> None:
    walk = walk_in_place(0.6, 0.02)
    q = walk.q.copy()
    q[:, walk.names.index("torso_tz")] += 2.0 * walk.t / walk.t[-1]
    said: list[str] = []
    run = track(PUPPET, replace(walk, q=q), max_iterations=2, progress=said.append)
    assert any("above the plane of the strings" in line for line in said)
    hooks = PUPPET.positions(run.reference, [string.hook for string in STRINGS])[..., 2]
    assert hooks.max() == pytest.approx(PLANE_HEIGHT - 0.1, abs=1e-9)
    assert np.isfinite(run.trajectory.q).all()


def test_a_run_says_what_it_took_from_its_beginning(tmp_path: Path) -> None:
    """All optimisations of the search and after it; a file keeps it, and a run that goes on adds to it."""
    made: list[int] = []
    whole: list[OptimizationResult] = []
    real_search, real_run = motors.optimize, tracker.optimize

    def counted(real: Callable[..., OptimizationResult]) -> Callable[..., OptimizationResult]:
        def call(*problem: Any, **options: Any) -> OptimizationResult:
            found = real(*problem, **options)
            resumed = options.get("resume")
            made.append(found.iterations - (0 if resumed is None else resumed.iterations))
            whole.append(found)
            return found

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motors, "optimize", counted(real_search))
        patch.setattr(tracker, "optimize", counted(real_run))
        run = track(PUPPET, leap(0.3), max_iterations=4)
        at_first = len(made)
        again = track(PUPPET, run.motion, resume=load_run(save_run(tmp_path / "run.npz", run)), max_iterations=2)
    assert run.effort.iterations == sum(made[:at_first]) > run.result.iterations
    assert run.effort.optimisations == at_first
    assert np.isfinite(run.effort.first_cost)
    summary = run_summary(run)
    assert summary["run"]["iterations"] == sum(made[:at_first])
    assert summary["cost"]["first"] == run.effort.first_cost
    path = tmp_path / "run.npz"
    assert load_run(path).effort == run.effort == pickle.loads(pickle.dumps(run.effort))
    assert again.effort.iterations == sum(made)
    assert again.effort.first_cost == run.effort.first_cost
