"""Many motions at once are the same motions one after the other, and sweeps keep what is done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from leastaction import Damping, Gravity, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, free, optimize
from leastaction.control import Failed, linearize_many, optimize_many, simulate_many, sweep
from leastaction.errors import ArgumentError, SweepError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.chain import pendulum_chain
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.models.marionette import marionette, rest_pose
from leastaction.optimal import LinearSystem

T = np.linspace(0.0, 0.5, 51)


def test_many_are_bit_for_bit_what_each_is_alone():
    rng = np.random.default_rng(0)
    vi = MidpointVI(cart_pendulum())
    x0, u, mass = rng.standard_normal((30, 4)), rng.standard_normal((30, 50, 1)), rng.uniform(0.5, 2.0, 30)
    many = simulate_many(vi, x0, T, u, parameters={"bob.mass": mass}, threads=1)
    assert many.complete
    for threads in (2, 3, 7):
        other = simulate_many(vi, x0, T, u, parameters={"bob.mass": mass}, threads=threads)
        np.testing.assert_array_equal(many.x, other.x)
    order = rng.permutation(30)[:11]
    some = simulate_many(vi, x0[order], T, u[order], parameters={"bob.mass": mass[order]}, threads=2)
    np.testing.assert_array_equal(many.x[order], some.x)
    alone = MidpointVI(cart_pendulum(bob_mass=float(mass[4])))
    start = alone.start(x0[4, :2], p=x0[4, 2:])
    run = alone.simulate(start, T, inputs=u[4])
    np.testing.assert_allclose(many.x[4, :, :2], run.q, rtol=1e-11, atol=1e-11)


@pytest.fixture(scope="module", params=["cart-pole", "four bars", "marionette", "chain of 14"])
def many_starts(request):
    """Return an integrator with a time step, and starts and inputs of many motions: some of the way is not straight."""
    rng, B, N = np.random.default_rng(3), 21, 40
    if request.param == "cart-pole":
        vi, dt = MidpointVI(cart_pendulum()), 0.01
        x0, u = rng.standard_normal((B, 4)), 20.0 * rng.standard_normal((B, N, 1))
        x0[::5, 3] = 40.0  # far turns, whose roots have to be followed
    elif request.param == "four bars":
        m = four_bars(2)
        vi, dt, u = MidpointVI(m), 0.005, np.zeros((B, N, 0))
        x0 = np.array([vi.start(*at_angle(m, angle, 1.0)).x for angle in rng.uniform(0.2, 2.9, B)])
    elif request.param == "marionette":
        m = marionette()
        vi, dt = MidpointVI(m), 0.01
        start = vi.start(rest_pose(m)).x
        x0 = np.tile(start, (B, 1))
        x0[:, m.nq : m.nq + m.nd] += 1e-3 * rng.standard_normal((B, m.nd))
        wave = 0.02 * np.sin(0.3 * np.arange(1, N + 1))[:, None] * rng.standard_normal((B, 1, m.nrho))
        u = np.concatenate([np.zeros((B, N, m.n_inputs)), start[m.nd : m.nq] + wave], axis=2)
    else:
        m = pendulum_chain(14)
        vi, dt, u = MidpointVI(m), 0.01, np.zeros((B, N, m.n_inputs + m.nrho))
        x0 = np.concatenate([rng.standard_normal((B, m.nq)), np.zeros((B, m.nq))], axis=1)
    return vi, dt * np.arange(N + 1), x0, u


def test_company_order_and_threads_leave_no_trace(many_starts):
    vi, t, x0, u = many_starts
    many = simulate_many(vi, x0, t, u, threads=1)
    assert many.complete
    for i in (0, 3, 10, 20):
        alone = simulate_many(vi, x0[i : i + 1], t, u[i : i + 1])
        np.testing.assert_array_equal(alone.x[0], many.x[i])
        np.testing.assert_array_equal(alone.lam[0], many.lam[i])
    order = np.random.default_rng(0).permutation(len(x0))[:13]
    some = simulate_many(vi, x0[order], t, u[order], threads=2)
    np.testing.assert_array_equal(some.x, many.x[order])


def test_side_by_side_they_go_where_each_goes_alone(many_starts):
    vi, t, x0, u = many_starts
    many = simulate_many(vi, x0, t, u)
    for i in (0, 5, 20):
        run = vi.core.roll_out(t, x0[i], None, u[i], None)
        scale = np.abs(run.x).max(axis=0) + 1e-3
        np.testing.assert_allclose(many.x[i] / scale, run.x / scale, atol=1e-9)
        np.testing.assert_allclose(many.lam[i], run.lam, atol=1e-8 * np.abs(run.lam).max(initial=1e-9))


def test_derivatives_of_many_are_those_of_each(many_starts):
    vi, t, x0, u = many_starts
    many = simulate_many(vi, x0, t, u)
    A, B = linearize_many(vi, t, many.x, many.u, threads=2)
    for i in (0, 10, 20):
        system = MidpointSystem(vi, t)
        theirs = system.linearize(np.array(many.x[i]), np.array(many.u[i]))
        for ours, their in zip((A[i], B[i]), theirs, strict=True):
            np.testing.assert_allclose(ours, their, atol=1e-9 * np.abs(their).max(initial=1.0))
        one = linearize_many(vi, t, many.x[i : i + 1], many.u[i : i + 1])
        np.testing.assert_array_equal(one[0][0], A[i])
        np.testing.assert_array_equal(one[1][0], B[i])


def test_derivatives_of_many_motions_with_rotations_are_those_of_each():
    spun = Mechanism([free("base", mass=1.0, inertia=(0.1, 0.2, 0.3))], [Gravity(), Damping(0.1)])
    vi, t = MidpointVI(spun), np.linspace(0.0, 0.5, 26)
    starts = [vi.start({}, {"base.wx": 3.0 * i, "base.wy": 0.1}).x for i in range(1, 4)]
    runs = simulate_many(vi, starts, t)
    A, B = linearize_many(vi, t, runs.x, runs.u, threads=2)
    for i in range(3):
        theirs = MidpointSystem(vi, t).linearize(np.array(runs.x[i]), np.array(runs.u[i]))
        np.testing.assert_array_equal(A[i], theirs.A)
        np.testing.assert_array_equal(B[i], theirs.B)
        np.testing.assert_array_equal(A[i], linearize_many(vi, t, runs.x[[i]], runs.u[[i]], threads=1)[0][0])
    x = np.array(runs.x)
    x[1, 9, 2] += 1e-3
    with pytest.raises(ArgumentError, match="x: step 8 of instance 1 is none of the mechanism"):
        linearize_many(vi, t, x, runs.u)


def test_what_is_no_motion_has_no_derivatives():
    vi, t = MidpointVI(cart_pendulum()), np.linspace(0.0, 0.5, 51)
    runs = simulate_many(vi, np.random.default_rng(1).standard_normal((5, 4)), t)
    x = np.array(runs.x)
    x[3, 20, 1] += 1e-3
    with pytest.raises(ArgumentError, match="x: step 19 of instance 3 is none of the mechanism"):
        linearize_many(vi, t, x, runs.u)


def test_a_neighbour_that_fails_leaves_no_trace():
    vi, t = MidpointVI(cart_pendulum()), np.linspace(0.0, 0.5, 51)
    x0 = np.random.default_rng(1).standard_normal((8, 4))
    sound = simulate_many(vi, x0, t)
    x0[[2, 5], 3] = 1e7, 1e9
    many = simulate_many(vi, x0, t)
    assert list(many.failures) == [2, 5]
    kept = [0, 1, 3, 4, 6, 7]
    np.testing.assert_array_equal(many.x[kept], sound.x[kept])


def test_one_that_fails_says_so_and_stops_nobody():
    x0 = np.zeros((6, 4))
    x0[:, 1] = 0.1 * np.arange(6)
    x0[3, 3] = 1e7
    many = simulate_many(MidpointVI(cart_pendulum()), x0, T, threads=2)
    assert list(many.failures) == [3]
    assert "could not be solved" in many.failures[3]
    assert np.isnan(many.x[3, many.steps[3] + 1 :]).all()
    assert (np.delete(many.steps, 3) == 50).all()
    assert np.isfinite(np.delete(many.x, 3, axis=0)).all()


@pytest.mark.parametrize("masses", [1.0, np.linspace(0.5, 2.0, 100)])
def test_ctrl_c_keeps_the_motions_that_are_made(monkeypatch, masses):
    vi, starts = MidpointVI(cart_pendulum()), np.tile([0.0, 0.5, 0.0, 0.0], (100, 1))
    whole = simulate_many(vi, starts, T, parameters={"bob.mass": masses}, threads=1)
    before = 2

    def interrupts() -> float:
        nonlocal before
        before -= 1
        if before < 0:
            raise KeyboardInterrupt
        return 0.0

    class Interrupted(ThreadPoolExecutor):
        def map(self, function, groups):
            for group in groups:
                interrupts()
                yield function(group)

    monkeypatch.setattr("leastaction.control.many.perf_counter", interrupts)
    monkeypatch.setattr("leastaction.control.many.ThreadPoolExecutor", Interrupted)
    some = simulate_many(vi, starts, T, parameters={"bob.mass": masses}, threads=1)
    made = len(starts) - len(some.failures)
    assert some.interrupted
    assert not whole.interrupted
    assert 0 < made < 100
    np.testing.assert_array_equal(some.x[:made], whole.x[:made])
    assert np.isnan(some.x[made:]).all()
    assert (some.steps == [50] * made + [0] * (100 - made)).all()
    assert some.failures[made] == "not made: interrupted"
    assert "ended early" in str(some)
    with pytest.raises(KeyboardInterrupt):  # before there is anything
        simulate_many(vi, starts, T, parameters={"bob.mass": masses}, threads=1)


def test_sizes_that_disagree_and_names_that_nobody_has():
    with pytest.raises(ArgumentError, match="x0: got no instance, expected one at least"):
        simulate_many(MidpointVI(cart_pendulum()), np.zeros((0, 4)), T)
    vi = MidpointVI(cart_pendulum())
    with pytest.raises(ArgumentError, match="inputs: got 3 instances, expected one for all, or 5 as of x0"):
        simulate_many(vi, np.zeros((5, 4)), T, np.zeros((3, 50, 1)))
    with pytest.raises(ArgumentError, match=r"unknown parameter 'bob\.mas'; did you mean 'bob\.mass'"):
        simulate_many(vi, np.zeros(4), T, parameters={"bob.mas": [1.0]})
    with pytest.raises(ValueError, match="parameters of instance 1"):
        simulate_many(vi, np.zeros(4), T, parameters={"bob.mass": [1.0, -1.0]})


def squared(x: float) -> float:
    if x < 0.0:
        raise ArgumentError("no root")
    return x * x


def deadly(x: float) -> float:
    if x == 2.0:
        os._exit(1)
    return x


def test_a_sweep_keeps_what_is_done_and_goes_on_from_there(tmp_path):
    seen, values = [], [1.0, 2.0, 3.0, 4.0]

    class Ended(Exception):
        pass

    def until_two(done: int, whole: int) -> None:
        seen.append((done, whole))
        if done == 2:
            raise Ended

    with pytest.raises(Ended):
        sweep(squared, values, workers=1, keep=tmp_path / "kept", progress=until_two)
    calls = []

    def counted(x: float) -> float:
        calls.append(x)
        return squared(x)

    assert sweep(counted, values, workers=1, keep=tmp_path / "kept") == [1.0, 4.0, 9.0, 16.0]
    assert calls == [3.0, 4.0]
    assert seen == [(0, 4), (1, 4), (2, 4)]
    # Another value in its place is computed anew, and so is what was cut off.
    (tmp_path / "kept" / "000001.pickle").write_bytes(b"cut")
    assert sweep(counted, [5.0, *values[1:]], workers=1, keep=tmp_path / "kept") == [25.0, 4.0, 9.0, 16.0]
    assert calls[2:] == [5.0, 2.0]


def test_on_processes_it_is_the_same_and_errors_stand_where_they_belong():
    pytest.importorskip("joblib")
    here = sweep(squared, [1.0, -1.0, 3.0], workers=1)
    there = sweep(squared, [1.0, -1.0, 3.0], workers=2)
    assert here == there
    assert here[1] == Failed("ArgumentError: no root")
    assert not here[1]


def test_workers_that_die_are_named_and_what_is_done_is_kept(tmp_path):
    pytest.importorskip("joblib")
    values = [0.0, 1.0, 3.0, 4.0, 5.0, 2.0]
    told = r"worker processes died after \d of 6 results: .*with `keep` the sweep goes on"
    with pytest.raises(SweepError, match=told) as died:
        sweep(deadly, values, workers=2, keep=tmp_path)
    assert died.value.done == {i: values[i] for i in died.value.done}
    seen = []
    assert sweep(abs, values, workers=1, keep=tmp_path, progress=lambda done, _: seen.append(done)) == values
    assert seen[0] == len(died.value.done)


def test_ctrl_c_keeps_what_is_done(tmp_path):
    pytest.importorskip("joblib")
    script = tmp_path / "slowly.py"
    script.write_text(
        "import sys, time\n"
        "from leastaction.control import sweep\n"
        "def slowly(x):\n"
        "    time.sleep(0.1)\n"
        "    return x * x\n"
        "sweep(slowly, range(200), workers=2, keep=sys.argv[1], progress=lambda done, _: print(done, flush=True))\n"
    )
    running = subprocess.Popen(
        [sys.executable, script, tmp_path / "kept"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    for line in running.stdout:
        if int(line) == 4:
            running.send_signal(signal.SIGINT)
            break
    assert "KeyboardInterrupt" in running.communicate(timeout=60)[1]
    seen = []
    found = sweep(lambda x: x * x, range(200), workers=1, keep=tmp_path / "kept", progress=lambda n, _: seen.append(n))
    assert found == [x * x for x in range(200)]
    assert 4 <= seen[0] < 200


def test_optima_of_many_starts_are_those_of_each():
    system = LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], N=20)
    cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[1.0, 0.1], R=[0.1])
    starts = [(np.array([a, 0.0]), np.zeros((20, 1))) for a in (1.0, 2.0)]
    found = optimize_many(system, cost, starts, workers=1)
    for start, result in zip(starts, found, strict=True):
        np.testing.assert_array_equal(result.u, optimize(system, cost, initial=start).u)
    with pytest.raises(ArgumentError, match="system: got int"):
        optimize_many(3, cost, starts)


def test_on_a_cluster_of_dask_it_is_the_same_and_goes_on_where_it_was(tmp_path):
    distributed = pytest.importorskip("dask.distributed", reason="Dask is not installed")
    joblib = pytest.importorskip("joblib")
    system = LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], N=20)
    cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[1.0, 0.1], R=[0.1])
    starts = [(np.array([a, 0.0]), np.zeros((20, 1))) for a in (1.0, 2.0, 3.0, 4.0)]

    class Ended(Exception):
        pass

    def until_two(done: int, whole: int) -> None:
        if done == 2:
            raise Ended

    here = optimize_many(system, cost, starts, workers=1)
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, distributed.Client(cluster), joblib.parallel_config(backend="dask"):
        with pytest.raises(Ended):
            optimize_many(system, cost, starts, keep=tmp_path, progress=until_two)
        assert len(list(tmp_path.glob("*.pickle"))) == 2
        counts = []
        there = optimize_many(system, cost, starts, keep=tmp_path, progress=lambda done, _: counts.append(done))
        assert counts == [2, 3, 4]
        assert sweep(squared, [1.0, -1.0], workers=2) == [1.0, Failed("ArgumentError: no root")]
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.u, other.u)


def test_many_motions_are_bands_of_what_chance_may_do():
    rng, t = np.random.default_rng(0), 0.02 * np.arange(26)
    starts = np.zeros((64, 4))
    starts[:, 1] = 0.1 * rng.standard_normal(64)
    vi = MidpointVI(cart_pendulum(), threads=1)
    runs = simulate_many(vi, starts, t)
    bands = runs.bands()
    assert str(runs) == str(bands)
    assert str(bands).startswith("64 runs to t = 0.5 s, 0 of them ended early")
    np.testing.assert_array_equal(bands["theta"], runs.x[:, :, 1])
    low, middle, high = bands.quantiles("theta", (0.0, 0.5, 1.0))
    np.testing.assert_array_equal(high, runs.x[:, :, 1].max(axis=0))
    assert (low < middle).all()
    assert not bands.failures
    pytest.importorskip("matplotlib").use("Agg")
    assert [axis.get_ylabel() for axis in bands.plot(["theta", "x-force"]).axes] == ["theta (°)", "x-force (N)"]
    (alone,) = bands.plot("theta").axes
    assert alone.get_xlabel() == "time (s)"
    np.testing.assert_allclose(alone.lines[0].get_ydata(), np.degrees(middle))
